"""Rendering of results: selection of the tables, and conversion to text, SVG and HTML."""

from __future__ import annotations

import io
from functools import singledispatch
from html import escape

from rich.console import Console, RenderableType
from rich.text import Text

from ftforce.analysis.analyze import Analysis
from ftforce.analysis.capability import Capability
from ftforce.analysis.census import Census
from ftforce.analysis.paper import Replication
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.core.remap import Remap
from ftforce.planning.path import PathPlan
from ftforce.planning.posture import BestPosture
from ftforce.planning.reach import FailureTolerantWorkspace
from ftforce.robot.robot import Robot
from ftforce.show.tables.analysis import analysis_view, remap_view
from ftforce.show.tables.capability import capability_view
from ftforce.show.tables.census import census_view
from ftforce.show.tables.comparison import comparison_view
from ftforce.show.tables.history import history_view
from ftforce.show.tables.map import map_view
from ftforce.show.tables.plan import plan_view
from ftforce.show.tables.posture import posture_view
from ftforce.show.tables.reach import reach_view
from ftforce.show.tables.replication import replication_view
from ftforce.show.tables.robot import robot_view
from ftforce.show.tables.sweep import sweep_view
from ftforce.show.tables.timeline import timeline_view
from ftforce.trajectory.history import History
from ftforce.trajectory.timeline import Timeline


@singledispatch
def render(result: object) -> RenderableType:
    """Return the rich renderable for a result."""
    return Text(repr(result))


render.register(Analysis, analysis_view)
render.register(BestPosture, posture_view)
render.register(FailureTolerantWorkspace, reach_view)
render.register(Capability, capability_view)
render.register(Census, census_view)
render.register(Comparison, comparison_view)
render.register(History, history_view)
render.register(PathPlan, plan_view)
render.register(Remap, remap_view)
render.register(Replication, replication_view)
render.register(Robot, robot_view)
render.register(Sweep, sweep_view)
render.register(Timeline, timeline_view)
render.register(WorkspaceMap, map_view)


WIDTH = 80


def to_text(shown: RenderableType, width: int = WIDTH) -> str:
    """Render as plain text without colours."""
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None, force_jupyter=False).print(shown)
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def to_svg(shown: RenderableType, title: str, width: int = WIDTH, origin: str = "") -> str:
    """Render as an SVG image of a terminal window, and say where it comes from."""
    image = _recorded(shown, width).export_svg(title=title, unique_id="ftforce")
    if not origin:
        return image
    head, end, rest = image.rpartition("</svg>")
    return f"{head}<metadata>{escape(origin)}</metadata>\n{end}{rest}"


def to_html(shown: RenderableType, width: int = 100) -> str:
    """Render as an HTML fragment for notebooks; text is escaped."""
    style = "font-family:Menlo,Consolas,'DejaVu Sans Mono',monospace;line-height:1.25"
    return _recorded(shown, width).export_html(
        inline_styles=True, code_format=f'<pre style="{style}"><code>{{code}}</code></pre>'
    )


def to_page(shown: RenderableType, title: str, origin: str = "") -> str:
    """Render as an HTML page that says where it comes from."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="generator" content="ftforce; {escape(origin)}">'
        f"<title>{escape(title)}</title></head>\n<body>{to_html(shown)}</body></html>\n"
    )


def _recorded(shown: RenderableType, width: int) -> Console:
    console = Console(
        file=io.StringIO(),
        record=True,
        width=width,
        force_terminal=True,
        force_jupyter=False,  # in a notebook, rich would display it, too
        color_system="truecolor",
    )
    console.print(shown)
    return console
