"""Complete figures of results, 180 mm wide for print, and their files."""

from __future__ import annotations

import io
import re
import warnings
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ftforce.__version__ import __version__
from ftforce.analysis.capability import Capability
from ftforce.analysis.census import Census
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.errors import InputError, listed, printable
from ftforce.io.text import write_whole
from ftforce.planning.path import PathPlan
from ftforce.planning.posture import BestPosture
from ftforce.planning.reach import FailureTolerantWorkspace
from ftforce.report.provenance import origin_line
from ftforce.show import plots
from ftforce.show.plots.canvas import (
    HIGHEST,
    PRINT,
    ROW,
    WIDTH,
    Options,
    draw_literally,
    fit_ticks,
    needs_matplotlib,
    texts_of,
)
from ftforce.show.plots.comparison import lay_out
from ftforce.show.plots.workspace_page import draw_map, draw_sweep
from ftforce.trajectory.history import History
from ftforce.trajectory.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from os import PathLike

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ftforce.show.plots.timeline import Quantity
    from ftforce.show.plots.trajectory import Kind

# Format: key of the program, key of where the result comes from, and what is dropped: dates and
# versions of libraries, so that equal results give identical files.
_METADATA: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "png": ("Software", "Comment", ()),
    "pdf": ("Creator", "Subject", ("CreationDate", "Producer")),
    "svg": ("Creator", "Description", ("Date",)),
}
_GLYPH = re.compile(r"Glyph (\d+) .*missing from", re.DOTALL)  # of matplotlib's warnings
_MOST_BARS = 40
_TITLE_AND_AXIS = 1.0  # in; a plot's height in addition to its rows


Drawable: TypeAlias = (
    History
    | Timeline
    | Census
    | Capability
    | Sweep
    | WorkspaceMap
    | Comparison
    | PathPlan
    | BestPosture
    | FailureTolerantWorkspace
)


def figure(result: Drawable) -> Figure:
    """Draw the complete figure of a result.

    Parameters
    ----------
    result :
        A simulation history, timeline, plan, best posture, census, capability, comparison, sweep,
        or map of a sweep.

    Raises
    ------
    InputError
        There is no figure for such a result, or the capability has only one component.
    """
    needs_matplotlib()
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    draw = next((draw for kind, draw in _LAYOUTS.items() if isinstance(result, kind)), None)
    if draw is None:
        names = ", ".join(kind.__name__ for kind in _LAYOUTS)
        raise InputError(f"no figure for {type(result).__name__}; available for: {names}")
    with rc_context({**PRINT, "axes.titlelocation": "left"}):
        drawn = Figure(layout="constrained")
        draw(drawn, result)
        fit_ticks(drawn)
        draw_literally(texts_of(drawn))
    return drawn


def save_figure(result: Drawable, path: str | PathLike[str]) -> Path:
    """Draw a result and save it as a ``.png``, ``.pdf`` or ``.svg`` file.

    Equal results give identical bytes. The file is written atomically.

    Parameters
    ----------
    result :
        A result, as for `figure`.
    path :
        File to write; its extension determines the format.

    Raises
    ------
    InputError
        The file extension is not supported, or there is no figure for such a result.
    OutputError
        The file cannot be written; no partial file remains.
    """
    return write_whole(path, figure_bytes(result, path))


def figure_bytes(result: Drawable, path: str | PathLike[str]) -> bytes:
    """Draw a result and return the content of its file.

    Raises
    ------
    InputError
        The file extension is not supported, or there is no figure for such a result.
    """
    form = Path(path).suffix.lower().removeprefix(".")
    if form not in _METADATA:
        endings = ", ".join(f".{one}" for one in _METADATA)
        raise InputError(f"{printable(path)}: the name of a figure must end in one of {endings}")
    needs_matplotlib()
    from matplotlib import rc_context, rcParamsDefault

    # A file does not depend on the user's matplotlibrc, which may ask for LaTeX or another size.
    settings: Any = {k: x for k, x in rcParamsDefault.items() if not k.startswith("backend")}
    # The salt makes SVG ids reproducible; many journals reject Type 3 fonts in PDF files.
    settings |= {"svg.hashsalt": "ftforce", "pdf.fonttype": 42, "savefig.bbox": None}
    with rc_context(settings), _missing_glyphs():
        drawn, stream = figure(result), io.BytesIO()
        _settle(drawn)
        drawn.savefig(stream, format=form, dpi=300, metadata=_metadata(form, result))
    return stream.getvalue()


def _metadata(form: str, result: Drawable) -> dict[str, str | None]:
    program, origin, dropped = _METADATA[form]
    program_name = f"ftforce {__version__}"
    return {**dict.fromkeys(dropped), program: program_name, origin: origin_line(result)}


@contextmanager
def _missing_glyphs() -> Iterator[None]:
    """Say in one warning which characters the font lacks; matplotlib says so many times."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    lacking: dict[str, None] = {}
    for one in caught:
        if found := _GLYPH.match(str(one.message)):
            lacking[printable(chr(int(found[1])))] = None
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    if lacking:
        text = f"the plot shows boxes for characters that its font lacks: {listed(lacking)}"
        warnings.warn(text, RuntimeWarning, stacklevel=4)


def _settle(drawn: Figure) -> None:
    """Freeze the layout: the last digits of a repeated layout depend on memory addresses."""
    drawn.draw_without_rendering()
    drawn.set_layout_engine("none")
    for ax in drawn.axes:
        x, y, width, height = np.round(ax.get_position(original=True).bounds, 6).tolist()
        ax.set_position((x, y, width, height))


def _of_history(drawn: Figure, history: History) -> None:
    task = history.setting.task
    kinds: list[Kind] = ["force"] if task.force_rows else []
    kinds += ["moment"] if task.moment_rows else []
    heights = [1.6, 1.6, *(1.5 for _ in kinds), 1.2, 1.2]
    drawn.set_size_inches(WIDTH, min(sum(heights) + 0.35 * len(heights), HIGHEST))
    grid = drawn.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=(1.0, 1.0))
    answer = "unremapped" if history.remapped is None else "remapped"
    first = plots.torques(history, "healthy", ax=drawn.add_subplot(grid[0, :]))
    plots.torques(history, answer, ax=drawn.add_subplot(grid[1, :], sharey=first))
    for row, kind in enumerate(kinds, start=2):
        plots.force(history, kind=kind, ax=drawn.add_subplot(grid[row, :]))
    for row, plot in ((-2, plots.jump), (-1, plots.path_error)):
        legend = plot(history, ax=drawn.add_subplot(grid[row, 0])).get_legend()
        if legend is not None:
            legend.remove()  # same as the legend of the path
    plots.path(history, ax=drawn.add_subplot(grid[-2:, 1], projection="3d"))


def _of_timeline(drawn: Figure, timeline: Timeline) -> None:
    quantities: list[Quantity] = ["margin"] if timeline.force is None else ["jump", "margin"]
    quantities += ["capability"] if np.isfinite(timeline.capability).any() else []
    most = int((HIGHEST / len(quantities) - _TITLE_AND_AXIS) / ROW) - 1
    rows = min(most, len(timeline.sets)) + 1
    drawn.set_size_inches(WIDTH, len(quantities) * (_TITLE_AND_AXIS + ROW * max(rows, 4)))
    axes = drawn.subplots(len(quantities), squeeze=False)
    for quantity, ax in zip(quantities, axes[:, 0], strict=True):
        plots.heat_map(timeline, quantity=quantity, most=most, ax=ax)


def _of_plan(drawn: Figure, plan: PathPlan) -> None:
    drawn.set_size_inches(WIDTH, 5.0)
    upper, lower = drawn.subplots(2, sharex=True, height_ratios=(2, 3))
    plots.objective_over_time(plan, ax=upper)
    plots.planned_positions(plan, ax=lower)


def _of_posture(drawn: Figure, found: BestPosture) -> None:
    drawn.set_size_inches(WIDTH, 3.2)
    plots.along_self_motion(found, ax=drawn.subplots())


def _of_reach(drawn: Figure, found: FailureTolerantWorkspace) -> None:
    if found.m == 2:
        drawn.set_size_inches(WIDTH, 4.8)
        plots.reach_map(found, ax=drawn.subplots())
        return
    drawn.set_size_inches(WIDTH, 4.2)
    for plane, ax in zip(("xz", "xy"), drawn.subplots(1, 2), strict=True):
        plots.reach_map(found, plane, ax=ax)
    keys = [ax.get_legend() for ax in drawn.axes]
    kinds: dict[str, Any] = {}
    for key in keys:
        if key is not None:
            words = [text.get_text() for text in key.texts]
            kinds |= dict(zip(words, key.legend_handles, strict=True))
            key.remove()
    place: Options = {"loc": "outside lower center", "ncols": 2}
    drawn.legend(list(kinds.values()), list(kinds), **place, frameon=False)


def _of_census(drawn: Figure, census: Census) -> None:
    rows = min(_MOST_BARS, len(census.sets))
    drawn.set_size_inches(WIDTH, _TITLE_AND_AXIS + ROW * (rows + 1))
    plots.census(census, most=rows, ax=drawn.add_subplot())


def _of_capability(drawn: Figure, capability: Capability) -> None:
    task = capability.analysis.task
    alike = [*combinations(task.force_rows, 2), *combinations(task.moment_rows, 2)]
    pairs: list[tuple[int, ...]] = [*alike] or [tuple(range(task.m))[:2]]
    rows = -(-len(pairs) // 3)
    columns = min(len(pairs), 3)
    drawn.set_size_inches(WIDTH, 2.5 * rows + 0.3)
    grid = drawn.add_gridspec(rows, columns)
    for place, pair in enumerate(pairs):
        ax = drawn.add_subplot(grid[place // columns, place % columns])
        plots.capability(capability, [task.components[i] for i in pair], ax=ax)
    _one_scale(drawn.axes)
    lines = max(ax.get_title(loc="left").count("\n") for ax in drawn.axes)
    drawn.set_size_inches(WIDTH, (2.5 + ROW * lines) * rows + 0.3)
    _one_legend(drawn)


def _one_scale(axes: Sequence[Axes]) -> None:
    """Give planes of equal units the same limits, so that they can be compared."""
    from matplotlib.ticker import MaxNLocator

    for unit in ("[N]", "[N·m]"):
        alike = [ax for ax in axes if all(one.endswith(unit) for one in _labels(ax))]
        ends = np.array([(*ax.get_xlim(), *ax.get_ylim()) for ax in alike])
        for ax in alike:
            ax.set(xlim=(ends.min(), ends.max()), ylim=(ends.min(), ends.max()))
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_locator(MaxNLocator(4))


def _labels(ax: Axes) -> tuple[str, str]:
    return ax.get_xlabel(), ax.get_ylabel()


def _one_legend(drawn: Figure) -> None:
    """Merge the plots' legends into one below them."""
    found: dict[str, Any] = {}
    for ax in drawn.axes:
        handles, labels = ax.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
        legend = ax.get_legend()
        if legend is not None:
            legend.remove()
    place: Options = {"loc": "outside lower center", "ncols": len(found)}
    drawn.legend(list(found.values()), list(found), **place, frameon=False)


_LAYOUTS: dict[type[Any], Any] = {
    History: _of_history,
    Timeline: _of_timeline,
    Census: _of_census,
    Capability: _of_capability,
    Comparison: lay_out,
    PathPlan: _of_plan,
    BestPosture: _of_posture,
    FailureTolerantWorkspace: _of_reach,
    Sweep: draw_sweep,
    WorkspaceMap: draw_map,
}
