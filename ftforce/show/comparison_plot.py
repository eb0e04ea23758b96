"""Dots and intervals of a comparison, one row per arm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from ftforce.comparison_words import fault_words, ranks
from ftforce.errors import UnknownNameError
from ftforce.show.canvas import (
    BLUE,
    LONGEST_NAME,
    ROW,
    VERMILION,
    WIDTH,
    canvas,
    head,
    shortened,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ftforce.arrays import Vector
    from ftforce.batch.arm_report import ArmReport
    from ftforce.batch.comparison import Comparison

Shown = Literal["tolerated", "every", "rho", "margin"]

SHOWN: tuple[str, ...] = get_args(Shown)
_TITLES = {
    "tolerated": ("Tolerated", "postures × sets [%]"),
    "every": ("Every set tolerated", "postures [%]"),
    "rho": ("ρ", "w(K) / w(J)"),
    "margin": ("Margin", "σ_min(K) / σ_max(J)"),
}
_HIGHEST = 9.6  # in; a page of A4 with its caption


class Marks(NamedTuple):
    """What a plot shows of the arms.

    Attributes
    ----------
    value :
        Where the dot stands, shape (arms,); NaN where nothing is known.
    low, high :
        Ends of the line through it, shape (arms,).
    bound :
        Where the most that there can be is marked, shape (arms,); NaN for no mark.
    """

    value: Vector
    low: Vector
    high: Vector
    bound: Vector


def comparison(result: Comparison, *, shown: Shown = "tolerated", ax: Axes | None = None) -> Axes:
    """Draw a dot per arm, the best on top, with an interval.

    Parameters
    ----------
    result :
        The arms.
    shown :
        ``tolerated`` or ``every``, shares with their intervals of confidence; ``rho`` or
        ``margin`` of the largest sets: the median, and a line that begins at the 5 % quantile.
    ax :
        Axes to draw on; a new figure's if not given.

    Raises
    ------
    InputError
        There is no such quantity, or the axes are none of two dimensions.
    """
    if shown not in SHOWN:
        raise UnknownNameError("quantity", shown, SHOWN)
    marks = marks_of(result, shown)
    with canvas(ax, 1.0 + ROW * len(result.arms)) as axes:
        _draw(axes, marks)
        names = [f"{shortened(arm.name, LONGEST_NAME)}  {ranks(arm)}" for arm in result.arms]
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        title, label = _TITLES[shown]
        axes.set_xlabel(label)
        head(axes, title, _key(marks, is_share=shown in {"tolerated", "every"}))
    return axes


def marks_of(result: Comparison, shown: str) -> Marks:
    """Return what a plot shows of the arms, best first; shares in percent."""
    rows = np.array([_row(arm, shown) for arm in result.arms])
    return Marks(*(rows[:, k] for k in range(4)))


def _row(arm: ArmReport, shown: str) -> tuple[float, float, float, float]:
    if shown in {"tolerated", "every"}:
        value, low, high = (100.0 * x for x in getattr(arm, shown))
        return value, low, high, math.nan
    few, half = getattr(arm.largest, shown)
    bound = arm.largest.rho_bound if shown == "rho" else math.nan
    return half.value, few.value, half.value, bound


def _draw(ax: Axes, marks: Marks) -> None:
    rows = np.arange(len(marks.value))
    ax.grid(color="0.9", linewidth=0.5)
    ax.set_axisbelow(True)
    ax.hlines(rows, marks.low, marks.high, color=BLUE, linewidth=1.6)
    ax.plot(marks.value, rows, linestyle="none", marker="o", color=BLUE, clip_on=False, zorder=3)
    ax.plot(
        marks.bound, rows, linestyle="none", marker="|", color=VERMILION, markersize=7.0,
        markeredgewidth=1.4, zorder=4,
    )  # fmt: skip
    if not np.isfinite(marks.value).any():
        ax.set_xlim(0.0, 1.0)


def _key(marks: Marks, *, is_share: bool) -> list[Any]:
    from matplotlib.lines import Line2D

    words = "share, 95 % interval" if is_share else "median, from the 5 % quantile"
    found = [Line2D([], [], color=BLUE, marker="o", linewidth=1.6, label=words)]
    if np.isfinite(marks.bound).any():
        found.append(
            Line2D([], [], linestyle="none", marker="|", color=VERMILION, markersize=7.0,
                   markeredgewidth=1.4, label="mean of each posture")
        )  # fmt: skip
    return found


def lay_out(drawn: Figure, result: Comparison) -> None:
    """Draw all that is shown of a comparison, the rows of one arm on one line.

    Parameters
    ----------
    drawn :
        An empty figure.
    result :
        The arms.
    """
    height = min(1.3 + ROW * max(len(result.arms), 4), _HIGHEST)
    drawn.set_size_inches(WIDTH, height)
    axes = drawn.subplots(1, len(SHOWN), sharey=True)
    for ax, shown in zip(axes, SHOWN, strict=True):
        comparison(result, shown=shown, ax=ax)  # type: ignore[arg-type] # one of SHOWN
        ax.get_legend().set_visible(False)
    _one_legend(drawn, axes[2])
    asked = result.question
    with_force = "" if asked.force is None else ", one force"
    drawn.suptitle(
        f"{fault_words(asked).capitalize()}{with_force}; ranks beside the names", x=0.01, ha="left",
        fontsize=8.0,
    )  # fmt: skip


def _one_legend(drawn: Figure, ax: Axes) -> None:
    from matplotlib.lines import Line2D

    found = [Line2D([], [], color=BLUE, marker="o", linewidth=1.6,
                    label="shares: 95 % interval; ρ, margin: from 5 % quantile to median")]  # fmt: skip
    found += [one for one in ax.get_lines() if one.get_marker() == "|"][:1]
    if len(found) > 1:
        found[1].set_label("ρ: root mean square of every posture, which its worst cannot exceed")
    drawn.legend(handles=found, loc="outside lower center", ncols=1, frameon=False)
