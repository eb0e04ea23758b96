"""Bar chart of a census."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.core.verdict import Verdict
from ftforce.report import text
from ftforce.show.plots.canvas import (
    BLACK,
    FLOOR,
    NOTHING,
    ROW,
    SKY,
    VERMILION,
    YELLOW,
    Options,
    canvas,
    grid,
    head,
)
from ftforce.show.plots.timeline import MARGIN, capability_words, cut, jump_words, set_labels

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes

    from ftforce.analysis.census import Census
    from ftforce.analysis.fault_set import SetReport
    from ftforce.core.arrays import Vector

# Distinguishable also without colour, by brightness and hatching.
LOOKS = {
    Verdict.NOT_TOLERATED: (VERMILION, ""),
    Verdict.BORDERLINE: (YELLOW, "////"),
    Verdict.TOLERATED: (SKY, "...."),
}


def census(result: Census, *, most: int = 20, ax: Axes | None = None) -> Axes:
    """Draw a bar chart of the worst fault sets and the healthy arm, by the ranking's measure.

    Without a force there is no jump; the bars then show margins.

    Parameters
    ----------
    result :
        The census of a posture.
    most :
        Maximum number of fault sets shown, worst first.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    sets = (*result.sets[: max(most, 1)], result.healthy)
    title, label = _words(result)
    values = np.array([_value(result, report) for report in sets])
    with canvas(ax, 1.0 + ROW * len(sets)) as axes:
        _draw(axes, values, sets)
        axes.set_yticks(range(len(sets)), set_labels(result.robot, [one.faults for one in sets]))
        axes.set_ylim(len(sets) - 0.4, -0.6)
        axes.set_xlabel(label)
        axes.set_ylabel(f"{result.mode.value} joints")
        head(
            axes,
            title + cut(len(sets) - 1, len(result.sets)),
            verdict_key(one.verdict for one in sets),
        )
    return axes


def _words(result: Census) -> tuple[str, str]:
    if result.rank_by == "capability":
        unit = text.unit_of_size(result.task, result.direction)
        return capability_words(unit, result.direction)
    return MARGIN if result.before is None else jump_words(result.task.units)


def _value(result: Census, report: SetReport) -> float:
    """Return the value of a bar; NaN if the arm falls."""
    if report.capability is not None:
        return report.capability.commanded
    if result.before is None:
        return report.margin
    jump = report.jump_norm if result.task.force_rows else report.moment_jump_norm
    return math.nan if jump is None else jump


def _draw(ax: Axes, values: Vector, sets: Sequence[SetReport]) -> None:
    lengths = np.where(np.isfinite(values), values, 0.0)
    top = float(lengths.max())
    top = top if top > text.NEGLIGIBLE else 0.85
    ax.set_xlim(-0.5 * FLOOR * top, 1.15 * top)
    grid(ax, "x")
    mark_zeros(ax, lengths)
    bars = ax.barh(range(len(sets)), lengths, height=0.72)
    for row, (bar, report) in enumerate(zip(bars, sets, strict=True)):
        bar.set(**look(report.verdict))
        place: Options = {"textcoords": "offset points", "va": "center_baseline"}
        end = (float(lengths[row]), row)
        ax.annotate(_in_words(float(values[row])), end, (3.0, 0.0), **place)


def mark_zeros(ax: Axes, lengths: Vector) -> None:
    """Draw the line from which bars start, and a mark where a bar has no length."""
    ax.axvline(0.0, color="0.4", linewidth=0.6, zorder=1)
    rows = np.flatnonzero(lengths <= text.NEGLIGIBLE)
    look: Options = {"color": BLACK, "marker": "|", "markersize": 6.0, "markeredgewidth": 1.2}
    ax.plot(np.zeros(len(rows)), rows, linestyle="none", **look, zorder=3)


def _in_words(value: float) -> str:
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "no known limit"
    return "0" if value <= text.NEGLIGIBLE else f"{value:.3g}"


def look(verdict: Verdict) -> dict[str, Any]:
    """Return the bar style of a verdict."""
    colour, hatch = LOOKS[verdict]
    return {"facecolor": colour, "hatch": hatch, "edgecolor": BLACK, "linewidth": 0.5}


def verdict_key(verdicts: Iterable[Verdict]) -> list[Any]:
    """Return the legend handles of verdicts, worst first."""
    from matplotlib.patches import Patch

    found = set(verdicts)
    return [Patch(**look(verdict), label=verdict.value) for verdict in LOOKS if verdict in found]
