"""Criticality bars and histograms of a sweep's joints, in the same order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ftforce.batch.summary.intervals import quantile, wilson
from ftforce.batch.workspace_map import check_quantity
from ftforce.core.verdict import Verdict
from ftforce.report.text import share
from ftforce.show.plots.canvas import (
    BLACK,
    FLOOR,
    LONGEST_NAME,
    NO_FAULT,
    SKY,
    VERMILION,
    Options,
    canvas,
    grid,
    head,
    mark,
    shortened,
    width_of,
    wrapped,
)
from ftforce.show.plots.census import look, mark_zeros, verdict_key

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ftforce.batch.result import Sweep
    from ftforce.batch.summary.cells import Counts, Values
    from ftforce.core.arrays import Vector

    Quantity = Literal["rho", "margin", "jump", "capability"]

ROW_HEIGHT = 0.28  # in; per joint
_PEAK = 0.86  # share of a row's height
_LINEAR, _LOGARITHMIC = 20, 10  # bins of the sweep merged into one bin of the plot
_NUMBERS = 82.0  # pt; width of the numbers beside a bar
_HEAD = 1.2  # in; a plot's height in addition to its rows


class Histogram(NamedTuple):
    """The histogram of one joint.

    Attributes
    ----------
    edges :
        Bin edges, shape (b + 1,).
    counts :
        Postures per bin, shape (b,).
    bad :
        Quantile that bounds the worst 5 %.
    median :
        The median.
    notes :
        Postures outside all bins, with their shares.
    """

    edges: Vector
    counts: Counts
    bad: float
    median: float
    notes: list[str]


_UNKNOWN = {"rho": "unknown", "margin": "J = 0", "jump": "falls"}
WORDS = {
    "rho": ("Relative manipulability", "ρ = w(K) / w(J)"),
    "margin": ("Margin", "σ_min(K) / σ_max(J)"),
    "jump": ("Force jump", "‖ΔF‖"),
    "capability": ("Largest commanded force", "force"),
}


def histogram(sweep: Sweep, quantity: Quantity = "rho", *, ax: Axes | None = None) -> Axes:
    """Draw the distribution of a quantity over the postures when each joint fails alone.

    One row per joint, the most critical on top, then the healthy arm, each scaled to its fullest
    bin. A diamond marks the
    median, a triangle the worst 5 %: small values of ρ, margin and capability, large jumps.
    Postures outside all bins, such as those without a jump, are listed beside the row.

    Parameters
    ----------
    sweep :
        The sweep.
    quantity :
        ``rho``, ``margin``, ``jump`` or ``capability``.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The quantity is unknown or not part of the sweep, or ``ax`` is not two-dimensional.
    """
    check_quantity(sweep, quantity)
    found = histograms_of(sweep, quantity)
    with canvas(ax, _HEAD + ROW_HEIGHT * len(found)) as axes:
        draw_rows(axes, found, logarithmic=quantity == "capability")
        name_rows(axes, sweep)
        title, label = words_of(sweep, quantity)
        axes.set_xlabel(label)
        how = f"each joint {_fails(sweep)} alone; heights: each row by itself"
        head(axes, wrapped(axes, [title, how]), mark_key(quantity))
        without_ticks_above(axes)
    return axes


def without_ticks_above(ax: Axes) -> None:
    """Remove the minor ticks that the blank top axis inherits from a logarithmic axis."""
    for above in ax.child_axes:
        above.minorticks_off()


def histograms_of(sweep: Sweep, quantity: str) -> list[Histogram]:
    """Return the histograms of all joints, most critical first, and that of the healthy arm."""
    joints = [_histogram_of(sweep, quantity, one.joint) for one in sweep.joints]
    return [*joints, _of_healthy(sweep, quantity)]


def _of_healthy(sweep: Sweep, quantity: str) -> Histogram:
    summary, total = sweep.summary, int(sweep.summary.postures)
    edges = np.asarray(summary.bins.share)
    counts = np.zeros(len(edges) - 1, dtype=np.int64)
    if quantity == "margin":
        low, middle = sweep.healthy_margin
        counts += np.asarray(summary.healthy_margin)[: len(counts)]
        return _grouped(edges, counts, (low, middle), {})
    if quantity == "rho":  # w(J)/w(J)
        counts[-1] = total
        return _grouped(edges, counts, (1.0, 1.0), {})
    if quantity == "jump":
        return _grouped(np.asarray(summary.bins.jump), counts, (0.0, 0.0), {"no jump": 1.0})
    edges = np.asarray(summary.bins.capability)
    return Histogram(
        edges[::_LOGARITHMIC],
        np.zeros(len(edges[::_LOGARITHMIC]) - 1, dtype=np.int64),
        math.nan,
        math.nan,
        ["–"],
    )


def _grouped(
    edges: Vector, counts: Counts, marks: tuple[float, float], notes: dict[str, float]
) -> Histogram:
    words = [f"{name}: {share(one, short=True)} %" for name, one in notes.items()]
    return Histogram(edges[::_LINEAR], counts.reshape(-1, _LINEAR).sum(axis=1), *marks, words)


def _histogram_of(sweep: Sweep, quantity: str, joint: int) -> Histogram:
    """Return the histogram for a joint (from 0) that fails alone, in bins wide enough to see."""
    summary, bins = sweep.summary, sweep.summary.bins
    place = sweep.index_of((joint + 1,))
    counts = np.asarray(getattr(summary, quantity)[place])
    unknown = int(getattr(summary, f"{quantity}_unknown")[place])
    total = int(summary.postures)
    if quantity == "capability":
        unlimited = np.asarray(summary.capability_unlimited)[place]
        return _of_capability(counts, np.asarray(bins.capability), unknown, int(unlimited), total)
    edges = np.asarray(bins.jump if quantity == "jump" else bins.share)
    bad, median = (float(quantile(counts, edges, p)) for p in (_bad(quantity), 0.5))
    notes = {_UNKNOWN[quantity]: unknown}
    shown = counts[: len(edges) - 1].copy()
    if quantity == "jump":  # most postures: their bar would dwarf all others
        notes = {"no jump": int(shown[0]), **notes, "more": int(counts[-1])}
        shown[0] = 0
    grouped = shown.reshape(-1, _LINEAR).sum(axis=1)
    return Histogram(edges[::_LINEAR], grouped, bad, median, _shares(notes, total))


def _of_capability(
    counts: Counts, edges: Vector, unknown: int, unlimited: int, total: int
) -> Histogram:
    """Return a histogram over decades; infeasible counts as 0, unlimited as infinite."""
    every = counts.copy()
    every[0] += unknown
    every[-1] += unlimited
    bad, median = (float(quantile(every, edges, p)) for p in (0.05, 0.5))
    notes = {
        "0": int(counts[0]),
        "no force": unknown,
        "no known limit": unlimited + int(counts[-1]),
    }
    grouped = counts[1:-1].reshape(-1, _LOGARITHMIC).sum(axis=1)
    return Histogram(edges[::_LOGARITHMIC], grouped, bad, median, _shares(notes, total))


def _bad(quantity: str) -> float:
    return 0.95 if quantity == "jump" else 0.05


def _shares(notes: dict[str, int], total: int) -> list[str]:
    return [f"{words}: {share(n / total, short=True)} %" for words, n in notes.items() if n]


def draw_rows(ax: Axes, rows: list[Histogram], *, logarithmic: bool) -> None:
    """Draw one step histogram per row, the first on top, with marks and notes."""
    low, high = _window(rows, logarithmic=logarithmic)
    if logarithmic:
        ax.set_xscale("log")
    ax.set_xlim(low, high)
    for row, one in enumerate(rows):
        peak = max(int(one.counts.max(initial=0)), 1)
        base = row + 0.5
        steps = base - _PEAK * one.counts / peak
        bars: Options = {"facecolor": SKY, "edgecolor": BLACK, "linewidth": 0.6}
        ax.stairs(steps, one.edges, baseline=base, fill=True, **bars, zorder=2)
        ax.axhline(base, color="0.6", linewidth=0.5, zorder=1)
        for x, height, marker, colour, size in (
            (one.median, 0.45, "D", "white", 14.0),
            (one.bad, 0.06, "^", VERMILION, 20.0),
        ):
            if math.isfinite(x) and low <= x <= high:  # stack coinciding marks
                look: Options = {
                    "marker": marker,
                    "facecolor": colour,
                    "edgecolor": BLACK,
                    "linewidth": 0.7,
                }
                ax.scatter([x], [base - height], s=size, **look, zorder=4, clip_on=False)
        if one.notes:
            ax.annotate(
                "\n".join(one.notes),
                (1.0, row),
                (3.0, 0.0),
                va="center",
                xycoords=("axes fraction", "data"),
                textcoords="offset points",
                annotation_clip=False,
                linespacing=0.95,
            )
    ax.set_ylim(len(rows) - 0.4, -0.55)
    grid(ax, "x")


def _window(rows: list[Histogram], *, logarithmic: bool) -> tuple[float, float]:
    edges = rows[0].edges
    if not logarithmic:
        return float(edges[0]), float(edges[-1])
    filled = np.flatnonzero(sum(one.counts for one in rows))
    if not filled.size:
        return 1.0, 1000.0
    return float(edges[max(filled[0] - 1, 0)]), float(edges[min(filled[-1] + 2, len(edges) - 1)])


def mark_key(quantity: str) -> list[Any]:
    """Return the legend handles of the histograms."""
    worst = "95 %" if quantity == "jump" else "5 %"
    looks = (("^", VERMILION, 4.5, worst), ("D", "white", 4.0, "median"))
    return [mark(*look, markeredgewidth=0.7) for look in looks]


def words_of(sweep: Sweep, quantity: str) -> tuple[str, str]:
    """Return the title and axis label of a histogram."""
    title, label = WORDS[quantity]
    setting = sweep.setting
    unit = setting.capability_unit if quantity == "capability" else setting.size_unit
    if quantity in {"jump", "capability"}:
        kind = "Moment" if unit == "N·m" else "Force"
        title = title.replace("Force", kind).replace("force", kind.lower())
        label = f"{label.replace('force', kind.lower())} [{unit}]"
    return title, label


def _fails(sweep: Sweep) -> str:
    return "is free-swinging" if sweep.setting.mode == "free" else "locks"


def name_rows(ax: Axes, sweep: Sweep, most: int = LONGEST_NAME) -> None:
    """Label the rows with joint numbers and names of at most ``most`` characters."""
    names = [
        f"{one.joint + 1} {shortened(sweep.setting.joints[one.joint], most)}"
        for one in sweep.joints
    ]
    names.append(NO_FAULT)
    ax.set_yticks(range(len(names)), names)
    ax.tick_params(axis="y", length=0.0)


def criticality(sweep: Sweep, *, ax: Axes | None = None) -> Axes:
    """Draw the joints, most critical on top, by the share of cases that are not tolerated.

    A case is a posture with a fault set that contains the joint. Whiskers are 95 % intervals of the
    share that is not tolerated, and of the share that is not tolerated or borderline; the numbers
    refer to the latter. For postures that were not drawn at random, the intervals only indicate the
    effect of the number of postures.

    Parameters
    ----------
    sweep :
        The sweep.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    with canvas(ax, _HEAD + ROW_HEIGHT * (len(sweep.joints) + 1)) as axes:
        draw_ranking(axes, sweep)
        name_rows(axes, sweep)
        lines = ["Joints, most critical on top", *_cases(sweep)]
        head(axes, wrapped(axes, lines), ranking_key())
    return axes


def _cases(sweep: Sweep) -> list[str]:
    if sweep.setting.largest == 1:
        return []
    return [f"cases: postures × sets of up to {sweep.setting.largest} joints that hold the joint"]


def draw_ranking(ax: Axes, sweep: Sweep) -> None:
    """Draw the bars, whiskers and numbers of the ranking."""
    joints, postures = sweep.joints, int(sweep.summary.postures)
    lost = 100.0 * np.nan_to_num([one.not_tolerated.value for one in joints])
    doubtful = 100.0 * np.nan_to_num([one.borderline for one in joints])
    low, high = (100.0 * x for x in wilson(0.01 * (lost + doubtful) * postures, postures))
    rows = np.arange(len(joints), dtype=np.float64)
    ax.barh(rows, lost, left=np.zeros(len(rows)), height=0.62, **look(Verdict.NOT_TOLERATED))
    ax.barh(rows, doubtful, left=lost, height=0.62, **look(Verdict.BORDERLINE))
    ends = np.array([[one.not_tolerated.low, one.not_tolerated.high] for one in joints])
    _whiskers(ax, rows + 0.16, lost, 100.0 * ends.T)
    _whiskers(ax, rows - 0.16, lost + doubtful, np.array([low, high]))
    _window_of_shares(ax, float(np.nanmax(high, initial=0.0)))
    mark_zeros(ax, np.append(lost + doubtful, 0.0))  # the healthy arm loses nothing
    for row, total, start, end in zip(rows, lost + doubtful, low, high, strict=True):
        value, low_end, high_end = (share(0.01 * x, short=True) for x in (total, start, end))
        words = f"{value} ({low_end}–{high_end})"
        place: Options = {"textcoords": "offset points", "va": "center_baseline"}
        ax.annotate(words, (end, row), (4.0, 0.0), **place)
    ax.set_ylim(len(rows) + 0.6, -0.55)
    grid(ax, "x")
    what = "postures" if sweep.setting.largest == 1 else "cases"
    ax.set_xlabel(f"share of the {what} [%] (95 % interval)" + _none(sweep))


def _none(sweep: Sweep) -> str:
    """Return a note if no case is "not tolerated": its interval is too small to see."""
    if any(one.not_tolerated.value > 0.0 for one in sweep.joints):
        return ""
    most = max(one.not_tolerated.high for one in sweep.joints)
    return f"\nnot tolerated: none (at most {share(most, short=True)} %)"


def _window_of_shares(ax: Axes, top: float) -> None:
    """Leave space for the numbers beside the bars, without ticks beyond 100 %."""
    from matplotlib.ticker import FixedLocator, MaxNLocator

    room = min(_NUMBERS / width_of(ax), 0.6)
    ticks = [x for x in MaxNLocator(3).tick_values(0.0, top) if x <= min(100.0, 1.05 * top)]
    end = top / (1.0 - room) if top > 0.0 else 1.0
    ax.set_xlim(-0.5 * FLOOR * end, end)
    ax.xaxis.set_major_locator(FixedLocator(ticks))


def _whiskers(ax: Axes, rows: Values, values: Values, ends: Any) -> None:
    reach = np.abs(np.nan_to_num(ends - values))
    look: Options = {"ecolor": BLACK, "elinewidth": 0.8, "capsize": 1.6, "capthick": 0.8}
    ax.errorbar(values, rows, xerr=reach, fmt="none", **look, zorder=4)


def ranking_key() -> list[Any]:
    """Return the legend handles of the ranking."""
    return verdict_key((Verdict.NOT_TOLERATED, Verdict.BORDERLINE))
