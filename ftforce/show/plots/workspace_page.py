"""The figure of a sweep: workspace maps, joint criticality, histograms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ftforce.batch.summary.cells import AXES, PLANES
from ftforce.batch.workspace_map import workspace_map
from ftforce.report.map import depth_in_words, faults_in_words
from ftforce.show.plots import sweep as histograms
from ftforce.show.plots.canvas import HIGHEST, WIDTH, Options, head
from ftforce.show.plots.workspace import (
    colour_bar,
    map_key,
    paint_flat,
    paint_solid,
    scale_of,
    solid_in_words,
    spans_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from ftforce.batch.result import Sweep
    from ftforce.batch.workspace_map import WorkspaceMap

_PANELS = 5.0  # in; width of the maps without tick labels and colour bar
_MAP_HEAD, _ROWS_HEAD = 1.2, 1.1  # in; titles, legend, tick labels
_SINGLE, _SOLID = 3.2, 3.8  # in; height of a single map
_LONGEST = 20  # characters of a joint's name
_SHORT = {"rho": "ρ", "margin": "Margin", "jump": "Jump", "capability": "Capability"}
_BESIDE = 2  # histograms beside the ranking


def draw_sweep(drawn: Figure, sweep: Sweep) -> None:
    """Draw a sweep: three projections of the workspace, the ranking, histograms of ρ and margin."""
    draw_map(drawn, workspace_map(sweep))


def draw_map(drawn: Figure, found: WorkspaceMap) -> None:
    """Draw the figure of a workspace map."""
    rows = [found.quantities[:_BESIDE], found.quantities[_BESIDE:]]
    rows = [row for i, row in enumerate(rows) if row or i == 0]
    top = _MAP_HEAD + _height(found)
    each = _ROWS_HEAD + histograms.ROW_HEIGHT * (len(found.sweep.joints) + 1)
    each = min(each, (HIGHEST - top) / len(rows))
    heights = [top, *(each for _ in rows)]
    drawn.set_size_inches(WIDTH, sum(heights))
    parts = drawn.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    parts[0].suptitle("\n".join(_headline(found)), x=0.01, ha="left", fontsize=8.0)
    (_draw_solid if found.solid else _draw_flat)(parts[0], found)
    for i, (part, quantities) in enumerate(zip(parts[1:], rows, strict=True)):
        _draw_rows(part, found.sweep, quantities, ranked=i == 0)


def _height(found: WorkspaceMap) -> float:
    """Return the height of the maps, in."""
    if found.solid:
        return _SOLID
    if found.plane is not None:
        return _SINGLE
    x, y, z = spans_of(found)
    return _PANELS / (2.0 * x + y) * max(y, z)


def _headline(found: WorkspaceMap) -> list[str]:
    setting, done = found.sweep.setting, int(found.sweep.summary.postures)
    of = "" if done == setting.count else f" of {setting.count:,} (not complete)"
    force = "every direction of force"
    if setting.force is not None:
        numbers = ", ".join(f"{x:g}".replace("-", "−") for x in setting.force)
        unit = f" {setting.size_unit}" if len({c[0] for c in setting.components}) == 1 else ""
        force = f"{setting.task} ({numbers}){unit} in {setting.axes} axes"
    edge = found.sweep.summary.workspace.edge
    cells = "" if found.solid else f"; cells of {edge:g} m"
    return [
        f"{setting.robot}: postures that tolerate {faults_in_words(found.sweep, found.joints)}",
        f"{done:,}{of} postures; {force}{cells}",
    ]


def _draw_flat(part: SubFigure, found: WorkspaceMap) -> None:
    planes = PLANES if found.plane is None else (found.plane,)
    spans = dict(zip(AXES, spans_of(found), strict=True))
    axes = part.subplots(
        1, len(planes), squeeze=False, width_ratios=[spans[plane[0]] for plane in planes]
    )[0]
    flats = [found.projected(plane) for plane in planes]
    one = scale_of(*(flat.cells for flat in flats))
    for ax, flat in zip(axes, flats, strict=True):
        paint_flat(ax, found, flat, one)
        ax.set_title(depth_in_words(found, flat))
    colour_bar(axes[-1], list(axes), one, aspect=16.0)
    handles = map_key([flat.cells for flat in flats])
    place: Options = {"loc": "outside lower left", "ncols": 3}
    part.legend(handles=handles, **place, frameon=False, handlelength=1.8)


def _draw_solid(part: SubFigure, found: WorkspaceMap) -> None:
    ax: Axes = part.add_subplot(projection="3d")
    blocks = found.blocks
    one = scale_of(blocks.cells)
    paint_solid(ax, blocks, one, 72.0 * _SOLID)
    colour_bar(ax, [ax], one, pad=0.08, shrink=0.8)
    ax.set_title("\n".join(solid_in_words(blocks)))


def _draw_rows(part: SubFigure, sweep: Sweep, quantities: tuple[str, ...], *, ranked: bool) -> None:
    """Draw the ranking and histograms side by side, with aligned joints."""
    count = len(quantities) + ranked
    widths = [1.25 if ranked and i == 0 else 1.0 for i in range(count)]
    axes: list[Any] = list(part.subplots(1, count, squeeze=False, width_ratios=widths)[0])
    if ranked:
        histograms.draw_ranking(axes[0], sweep)
        head(axes[0], "Joints, most critical on top", histograms.ranking_key())
    for ax, quantity in zip(axes[ranked:], quantities, strict=True):
        rows = histograms.histograms_of(sweep, quantity)
        histograms.draw_rows(ax, rows, logarithmic=quantity == "capability")
        _, label = histograms.words_of(sweep, quantity)
        ax.set_xlabel(label)
        head(ax, f"{_SHORT[quantity]}, joint fails alone", histograms.mark_key(quantity))
        histograms.without_ticks_above(ax)
    histograms.name_rows(axes[0], sweep, _LONGEST)
    for ax in axes[1:]:
        ax.set_yticks([])
