"""Tables of a workspace map."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from ftforce.batch.summary.cells import AXES, Cells, pooled
from ftforce.batch.summary.intervals import quantile
from ftforce.core.ranks import ranks_of
from ftforce.report.map import cells_in_words, faults_in_words, map_sentence
from ftforce.report.measures import MARGIN
from ftforce.report.text import NEGLIGIBLE, number, ratio, share, size
from ftforce.show.plots.workspace import UNSURE
from ftforce.show.tables.parts import TitledTable, facts, listing, spaced, warning_lines
from ftforce.show.tables.sweep import joints_table, sweep_facts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.batch.summary.cells import Flat, Located
    from ftforce.batch.workspace_map import WorkspaceMap

_MOST_CELLS = 8
"""Maximum number of cells in the table of the worst cells."""
_FACTS = ("Robot", "Tip", "Axes", "Task", "Joint kinds", "Postures", "Faults", "Force", "Stored")
_COLUMNS = 24  # three-character cells that fit beside a row label in 80 columns
_SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
_LABEL = 8  # characters of a row label
_ALL = "·"


def map_view(found: WorkspaceMap, *, most: int = _MOST_CELLS) -> RenderableType:
    """Return the map as text and its tables, with the ``most`` worst cells."""
    asked = [pair for pair in sweep_facts(found.sweep) if pair[0] in _FACTS]
    shown = f"{faults_in_words(found.sweep, found.joints)}; {cells_in_words(found, found.flat)}"
    return spaced(
        facts([*asked, ("Map", shown)]),
        _map(found, found.flat),
        _worst(found, most) if found.worst(1) else None,
        joints_table(found.sweep),
        *(_quantiles(found, quantity) for quantity in found.quantities),
        warning_lines(found.warnings),
        Text(map_sentence(found), style="bold"),
    )


def _map(found: WorkspaceMap, flat: Flat) -> Text:
    """Return the map in percent; cells that tolerate everything are dots, so bad ones stand out."""
    cells, first, second, edge = _blocks(found, flat)
    right, up = list(flat.plane)
    shown = Text(f"Tolerated [% of the postures], {up} upwards, {right} to the right [m]\n", "bold")
    digits = 2 if edge >= 0.0999 else 3
    every = 3 if digits == 3 else 2
    longest = 3 + digits  # right-aligned with its column
    shown.append(" " * (_LABEL + 3 - longest))
    for i, x in enumerate(first[::every]):
        shown.append(f"{number(x, digits):>{3 * every if i else longest}}", style="dim")
    shown.append("\n")
    for j in range(len(second) - 1, -1, -1):
        shown.append(f"{number(second[j], digits):>{_LABEL - 1}} ", style="dim")
        for i in range(len(first)):
            shown.append_text(_cell(cells, i, j))
        shown.append("\n")
    shown.append(_legend(edge, found), style="dim")
    return shown


def _blocks(found: WorkspaceMap, flat: Flat) -> tuple[Cells, list[float], list[float], float]:
    """Return the occupied part, pooled to fit, its column and row centres, and the cell edge."""
    workspace = found.sweep.summary.workspace
    postures, tolerated = flat.cells.postures, flat.cells.tolerated
    windows = []
    for axis in (0, 1):
        layers = np.flatnonzero(postures.sum(1 - axis))
        windows.append((int(layers.min()), int(layers.max()) + 1))
    (left, right), (low, high) = windows
    factor = -(-(right - left) // _COLUMNS)
    counts = [pooled(one[left:right, low:high], factor) for one in (postures, tolerated)]
    edge = factor * workspace.edge
    middles = [
        [float(edges[start]) + (i + 0.5) * edge for i in range(count)]
        for edges, start, count in zip(flat.edges, (left, low), counts[0].shape, strict=True)
    ]
    return Cells.of(*counts), middles[0], middles[1], edge


def _cell(cells: Cells, i: int, j: int) -> Text:
    """Format a cell in three characters; percentages are rounded down, never up to 100."""
    postures, tolerated = int(cells.postures[i, j]), int(cells.tolerated[i, j])
    if not postures:
        return Text("   ")
    unsure = cells.high[i, j] - cells.low[i, j] > UNSURE
    if tolerated == postures:
        return Text(f"  {_ALL}", "dim")
    whole = 100 * tolerated // postures
    return Text(f"{whole:3d}", "dim" if unsure else "bold red" if whole < 50 else "")


def _legend(edge: float, found: WorkspaceMap) -> str:
    pooled_words = ""
    if edge > 1.5 * found.sweep.summary.workspace.edge:
        pooled_words = f"; pooled to cells of {edge:g} m"
    return f"{_ALL} all tolerated, blank: no posture; rounded down{pooled_words}"


def _worst(found: WorkspaceMap, most: int) -> TitledTable:
    blocks = found.blocks
    cells = blocks.cells
    what = "cells" if blocks.edge < 1.5 * found.located.edge else "blocks"
    order = found.worst(len(cells.postures))
    keys = [(round(float(cells.high[i]), 9), round(float(cells.share[i]), 9)) for i in order]
    pairs = list(zip(order, map(str, ranks_of(keys)), strict=True))[:most]
    rows = [_worst_row(blocks, *pair) for pair in pairs]
    title = f"{what.capitalize()} of {blocks.edge:g} m, worst first"
    result = listing(title, rows, left=1, folded=())
    bad = int((cells.tolerated < cells.postures).sum())
    result.caption = (
        f"centres of {what}; at most: upper end of the 95 % interval, by which they rank\n"
        f"{bad:,} of {len(cells.postures):,} {what} contain postures that do not tolerate it"
    )
    return result


def _worst_row(blocks: Located, i: int, rank: str) -> Iterator[tuple[str, str]]:
    cells = blocks.cells
    yield "rank", rank
    for axis, x in zip(AXES, blocks.place[i].tolist(), strict=True):
        yield f"{axis} [m]", number(x, 3)
    yield "postures", f"{int(cells.postures[i]):,}"
    yield "tolerated", f"{int(cells.tolerated[i]):,}"
    yield "[%]", share(float(cells.share[i]))
    yield "at least", share(float(cells.low[i]))
    yield "at most", share(float(cells.high[i]))


_NAMES = {
    "rho": "ρ = w(K)/w(J)",
    "margin": MARGIN.label,
    "jump": "Jump ‖ΔF‖",
    "capability": "Capability",
}


def _quantiles(found: WorkspaceMap, quantity: str) -> TitledTable:
    sweep, summary = found.sweep, found.sweep.summary
    units = {"jump": sweep.setting.size_unit, "capability": sweep.setting.capability_unit}
    unit = f" [{units[quantity]}]" if quantity in units else ""
    is_jump = quantity == "jump"
    rows = []
    counts = np.asarray(getattr(summary, quantity))
    edges = np.asarray(getattr(summary.bins, quantity if unit else "share"))
    extremes = getattr(summary, f"{'max' if is_jump else 'min'}_{quantity}")
    for one in sweep.joints:
        place = sweep.index_of((one.joint + 1,))
        histogram, extreme = counts[place].copy(), float(extremes[place])
        if quantity == "capability":  # infeasible counts as 0, as in the joint table
            histogram[0] += np.asarray(summary.capability_unknown)[place]
            histogram[-1] += np.asarray(summary.capability_unlimited)[place]
        values = [float(quantile(histogram, edges, p)) for p in _SHARES]
        if quantity != "capability":  # the extreme is more accurate than the bins
            within = min if is_jump else max
            values = [within(x, extreme) if math.isfinite(x) else x for x in values]
        least = 0.0 if quantity == "capability" else float(edges[1])
        above = f">{ratio(float(edges[-1]))}" if is_jump else "no limit"
        cells = [_written(x, least, above, amount=bool(unit)) for x in values]
        last = _written(extreme, 0.0, "–", amount=bool(unit))
        quantiles = [(f"{100.0 * p:g} %", cell) for p, cell in zip(_SHARES, cells, strict=True)]
        end = ("most" if is_jump else "least", last)
        rows.append(
            [
                ("#", str(one.joint + 1)),
                ("joint", sweep.setting.joints[one.joint]),
                *([*quantiles, end] if is_jump else [end, *quantiles]),
            ]
        )
    title = f"{_NAMES[quantity]}{unit} when the joint fails alone, quantiles over the postures"
    result = listing(title, rows, left=2, folded=(1,))
    result.caption = "joints in the order of the table above"
    return result


def _written(x: float, least: float, above: str, *, amount: bool) -> str:
    """Format a number; below ``least``, in the first bin, it cannot be distinguished from 0."""
    if math.isnan(x) or x == -math.inf:
        return "–"
    if math.isinf(x):
        return above
    if abs(x) <= NEGLIGIBLE:
        return "0"
    if x < least:
        return f"<{ratio(least)}"
    return size(x, 1) if amount else ratio(x)
