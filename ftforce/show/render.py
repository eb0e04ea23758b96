"""Which table shows which result."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.analysis.analyze import Analysis
from ftforce.analysis.capability import Capability
from ftforce.analysis.census import Census
from ftforce.analysis.paper import Replication
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.core.remap import Remap
from ftforce.robot.robot import Robot
from ftforce.show.remap import remap_view
from ftforce.show.tables.analysis import analysis_view
from ftforce.show.tables.capability import capability_view
from ftforce.show.tables.census import census_view
from ftforce.show.tables.comparison import comparison_view
from ftforce.show.tables.history import history_view
from ftforce.show.tables.map import map_view
from ftforce.show.tables.replication import replication_view
from ftforce.show.tables.robot import robot_view
from ftforce.show.tables.sweep import sweep_view
from ftforce.show.tables.timeline import timeline_view
from ftforce.trajectory.history import History
from ftforce.trajectory.timeline import Timeline

if TYPE_CHECKING:
    from rich.console import RenderableType


@singledispatch
def render(result: object) -> RenderableType:
    """Return what rich prints of a result."""
    return Text(repr(result))


render.register(Analysis, analysis_view)
render.register(Capability, capability_view)
render.register(Census, census_view)
render.register(Comparison, comparison_view)
render.register(History, history_view)
render.register(Remap, remap_view)
render.register(Replication, replication_view)
render.register(Robot, robot_view)
render.register(Sweep, sweep_view)
render.register(Timeline, timeline_view)
render.register(WorkspaceMap, map_view)
