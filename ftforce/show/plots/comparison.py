"""Dot plot of a comparison, with intervals, one row per arm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from ftforce.errors import UnknownNameError
from ftforce.report.comparison import fault_words, ranks
from ftforce.show.plots.canvas import (
    BLUE,
    FLOOR,
    HIGHEST,
    LONGEST_NAME,
    ROW,
    TITLE,
    VERMILION,
    WIDTH,
    canvas,
    grid,
    head,
    shortened,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ftforce.batch.arm_report import ArmReport
    from ftforce.batch.comparison import Comparison
    from ftforce.core.arrays import Vector

Shown = Literal["tolerated", "every", "rho", "margin"]

SHOWN: tuple[str, ...] = get_args(Shown)
_SHARES = {"tolerated", "every"}
_TITLES = {
    "tolerated": ("Tolerated", "postures × sets [%]"),
    "every": ("Every set tolerated", "postures [%]"),
    "rho": ("ρ", "w(K) / w(J)"),
    "margin": ("Margin", "σ_min(K) / σ_max(J)"),
}
_BOUND: Any = {
    "linestyle": "none",
    "marker": "|",
    "color": VERMILION,
    "markersize": 7.0,
    "markeredgewidth": 1.4,
}


class Marks(NamedTuple):
    """The marks of a plot, one entry per arm.

    Attributes
    ----------
    value :
        Position of the dot, shape (arms,); NaN if unknown.
    low, high :
        Ends of the line through it, shape (arms,).
    bound :
        Position of the mark for the upper bound, shape (arms,); NaN for no mark.
    """

    value: Vector
    low: Vector
    high: Vector
    bound: Vector


_MOST = 50
"""Maximum number of arms in a figure, best first."""


def comparison(
    result: Comparison, *, shown: Shown = "tolerated", most: int = _MOST, ax: Axes | None = None
) -> Axes:
    """Draw one dot with an interval per arm, best arm on top.

    Parameters
    ----------
    result :
        The comparison.
    shown :
        ``tolerated`` or ``every``: shares with confidence intervals; ``rho`` or ``margin``, for
        the largest fault sets: the median, with a line from the 5 % quantile.
    most :
        Maximum number of arms shown, best first.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The quantity is unknown, or ``ax`` is not two-dimensional.
    """
    if shown not in SHOWN:
        raise UnknownNameError("quantity", shown, SHOWN)
    arms = result.arms[: max(most, 1)]
    with canvas(ax, 1.0 + ROW * len(arms)) as axes:
        marks = _panel(axes, arms, shown)
        title = _title(result, shown) + _cut(len(arms), len(result.arms))
        head(axes, title, _key(marks, is_share=shown in _SHARES))
    return axes


def _title(result: Comparison, shown: str) -> str:
    size = result.question.largest
    of_sets = f", {size} joints" if size > 1 and shown in {"rho", "margin"} else ""
    return _TITLES[shown][0] + of_sets


def _cut(shown: int, arms: int) -> str:
    return f", the best {shown} of {arms} arms" if shown < arms else ""


def _panel(ax: Axes, arms: Sequence[ArmReport], shown: str) -> Marks:
    """Draw the dots without title and legend; return the marks."""
    marks = _marks_of(arms, shown)
    _draw(ax, marks, is_share=shown in _SHARES)
    names = [f"{shortened(arm.name, LONGEST_NAME)}  {ranks(arm)}" for arm in arms]
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlabel(_TITLES[shown][1])
    return marks


def _marks_of(arms: Sequence[ArmReport], shown: str) -> Marks:
    """Return the marks of arms in the given order; shares in percent."""
    rows = np.array([_row(arm, shown) for arm in arms])
    return Marks(*(rows[:, k] for k in range(4)))


def _row(arm: ArmReport, shown: str) -> tuple[float, float, float, float]:
    if shown in _SHARES:
        value, low, high = (100.0 * x for x in getattr(arm, shown))
        return value, low, high, math.nan
    few, half = getattr(arm.largest, shown)
    bound = arm.largest.rho_bound if shown == "rho" else math.nan
    return half.value, few.value, half.value, bound


def _draw(ax: Axes, marks: Marks, *, is_share: bool) -> None:
    rows = np.arange(len(marks.value))
    grid(ax)
    ax.hlines(rows, marks.low, marks.high, color=BLUE, linewidth=1.6)
    ax.plot(marks.value, rows, linestyle="none", marker="o", color=BLUE, clip_on=False, zorder=3)
    ax.plot(marks.bound, rows, **_BOUND, zorder=4)
    ends = np.concatenate([marks.value, marks.high, marks.bound])
    # Shares have one scale, so that plots beside each other can be compared.
    top = 100.0 if is_share else float(ends[np.isfinite(ends)].max(initial=0.0)) or 1.0
    ax.set_xlim(-FLOOR * top, (1.0 + FLOOR) * top)


def _key(marks: Marks, *, is_share: bool) -> list[Any]:
    from matplotlib.lines import Line2D

    words = "share, 95 % interval" if is_share else "median, from the 5 % quantile"
    found = [Line2D([], [], color=BLUE, marker="o", linewidth=1.6, label=words)]
    if np.isfinite(marks.bound).any():
        found.append(Line2D([], [], **_BOUND, label="root mean square"))
    return found


def lay_out(drawn: Figure, result: Comparison) -> None:
    """Draw the full figure of a comparison, with aligned rows for each arm.

    Parameters
    ----------
    drawn :
        An empty figure.
    result :
        The comparison.
    """
    arms = result.arms[:_MOST]
    height = min(1.3 + ROW * max(len(arms), 4), HIGHEST)
    drawn.set_size_inches(WIDTH, height)
    axes = drawn.subplots(1, len(SHOWN), sharey=True)
    for ax, shown in zip(axes, SHOWN, strict=True):
        marks = _panel(ax, arms, shown)
        ax.set_title(_title(result, shown))
        if shown == "rho":
            handles = _key(marks, is_share=False)
    words = (
        "shares: 95 % interval; ρ and margin: from the 5 % quantile to the median",
        "ρ: root mean square of every posture, which its worst cannot exceed",
    )
    for handle, label in zip(handles, words, strict=False):
        handle.set_label(label)
    drawn.legend(handles=handles, loc="outside lower center", ncols=1, frameon=False)
    asked = result.question
    force = "" if asked.force is None else ", one force"
    title = f"{fault_words(asked).capitalize()}{force}; beside each name its ranks"
    title += _cut(len(arms), len(result.arms))
    drawn.suptitle(title, x=0.01, ha="left", fontsize=TITLE)
