"""Heat maps of timelines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.errors import InputError, UnknownNameError
from ftforce.report import text
from ftforce.show.plots.canvas import NO_FAULT, NOTHING, ROW, Options, canvas, head, mark, shortened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.faults import FaultSet
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.timeline import Timeline, WorstInstant

Quantity = Literal["jump", "margin", "capability"]

QUANTITIES = ("jump", "margin", "capability")
MOST_COLUMNS = 1000  # beyond the resolution of print
_LONGEST_LABEL = 34  # characters


class Cells(NamedTuple):
    """The cells of a heat map.

    Attributes
    ----------
    title, label :
        The quantity in words, and its label with unit.
    edges :
        Column edges, s, shape (columns + 1,).
    values :
        Shape (rows, columns): NaN where the arm falls, infinite without a known limit.
    rows :
        Worst instant of each row's fault set; the healthy arm is the last row.
    marks :
        Times of these instants, s, shape (rows,).
    """

    title: str
    label: str
    edges: Vector
    values: Matrix
    rows: Sequence[WorstInstant]
    marks: Vector


def heat_map(
    timeline: Timeline, *, quantity: Quantity = "jump", most: int = 40, ax: Axes | None = None
) -> Axes:
    """Draw the severity of each fault set over time, darker where it is worse.

    Parameters
    ----------
    timeline :
        All fault sets at all instants.
    quantity :
        ``jump``, ``margin`` or ``capability``.
    most :
        Maximum number of fault sets shown, worst first.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The quantity is unknown or is a jump without a force, or ``ax`` is not two-dimensional.
    """
    cells = cells_of(timeline, quantity, most)
    with canvas(ax, 1.1 + ROW * len(cells.rows)) as axes:
        _paint(axes, cells, high_is_bad=quantity == "jump")
        labels = set_labels(timeline.robot, [worst.faults for worst in cells.rows])
        axes.set_yticks(range(len(labels)), labels)
        axes.set_ylim(len(labels) - 0.5, -0.5)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"{timeline.mode.value} joints")
        head(axes, cells.title + cut(len(labels) - 1, len(timeline.sets)), _notes(cells))
    return axes


def cells_of(timeline: Timeline, quantity: str, most: int) -> Cells:
    """Return the cells of the worst fault sets, in the timeline's order, then the healthy arm's.

    Raises
    ------
    InputError
        The quantity is unknown, or requires a force and the timeline has none.
    """
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity", quantity, QUANTITIES)
    if quantity == "jump" and timeline.force is None:
        raise InputError("without a force there is no jump; ask for the margin or the capability")
    order = {faults: column for column, faults in enumerate(timeline.sets)}
    rows = sorted(timeline.worst()[: max(most, 1)], key=lambda worst: order[worst.faults])
    title, label = _words(timeline, quantity)
    values = getattr(timeline, quantity)[:, [order[worst.faults] for worst in rows]]
    values = np.column_stack([values, getattr(timeline.healthy, quantity)])
    rows.append(timeline.healthy_worst)
    edges, values = _columns(timeline.t, values, largest=quantity == "jump")
    at = "capability_time" if quantity == "capability" else "time"
    marks = np.array([getattr(worst, at) for worst in rows])
    return Cells(title, label, edges, read_only(values.T), rows, read_only(marks))


def _words(timeline: Timeline, quantity: str) -> tuple[str, str]:
    if quantity == "jump":
        return jump_words(timeline.task.units)
    if quantity == "margin":
        return MARGIN
    unit = text.unit_of_size(timeline.task, timeline.direction)
    return capability_words(unit, timeline.direction)


MARGIN = ("Margin", "σ_min(K) / σ_max(J)")


def jump_words(units: Sequence[str]) -> tuple[str, str]:
    """Return title and label of a jump; moments are used only for tasks without forces."""
    return ("Force jump", "‖ΔF‖ [N]") if "N" in units else ("Moment jump", "‖ΔF‖ [N·m]")


def capability_words(unit: str, direction: Vector | None) -> tuple[str, str]:
    """Return title and label of a capability."""
    what = "moment" if unit == "N·m" else "force"
    where = "weakest direction"
    if direction is not None:
        where = f"along {text.vector_in_words(direction)}"
    return f"Largest commanded {what}, {where}", f"{what} [{unit}]"


def _columns(t: Vector, values: Matrix, *, largest: bool) -> tuple[Vector, Matrix]:
    """Return column edges and values; a column shows its worst instant."""
    width = -(-len(t) // MOST_COLUMNS)
    starts = np.arange(0, len(t), width)
    worst = np.maximum if largest else np.minimum  # both propagate NaN, the worst value
    middles = 0.5 * (t[starts[1:] - 1] + t[starts[1:]])
    end = t[-1] if t[-1] > t[0] else t[0] + 1.0
    edges = np.concatenate([t[:1], middles, [end]])
    return read_only(edges), worst.reduceat(values, starts, axis=0)


def set_labels(robot: Robot, sets: Sequence[FaultSet]) -> list[str]:
    """Label fault sets by joint numbers and names, or only numbers where that is too long."""
    named = [", ".join(f"{j + 1} {robot.names[j]}" for j in one.joints) or NO_FAULT for one in sets]
    if max(map(len, named)) <= _LONGEST_LABEL:
        return named
    return [
        shortened(name, _LONGEST_LABEL) if len(one) < 2 else text.set_of(one.joints).strip("{}")
        for name, one in zip(named, sets, strict=True)
    ]


def cut(shown: int, sets: int) -> str:
    """Return a note on the number of fault sets shown; empty if all are."""
    return f", the worst {shown} of {sets} sets" if shown < sets else ""


def _paint(ax: Axes, cells: Cells, *, high_is_bad: bool) -> None:
    """Draw the cells with a colour bar, darker is worse; cells without a value are hatched.

    The hatching is the background, visible where no cell is drawn.
    """
    values, edges, rows = cells.values, cells.edges, np.arange(len(cells.rows) + 1) - 0.5
    finite = np.isfinite(values)
    top = float(values[finite].max(initial=0.0))
    ax.set_facecolor("0.8")
    ax.patch.set(hatch="////", edgecolor="0.3", linewidth=0.0)
    colours = "cividis_r" if high_is_bad else "cividis"
    scale: Options = {"vmin": 0.0, "vmax": top if top > text.NEGLIGIBLE else 1.0, "cmap": colours}
    shown = np.ma.masked_where(~finite, values)
    painted = ax.pcolormesh(edges, rows, shown, **scale, rasterized=True)
    if np.isinf(values).any():
        white = np.ma.masked_where(~np.isinf(values), np.zeros_like(values))
        ax.pcolormesh(edges, rows, white, cmap="gray_r", vmin=0.0, vmax=1.0, rasterized=True)
    diamond: Options = {"marker": "D", "facecolor": "white", "edgecolor": "black", "linewidth": 0.8}
    ax.scatter(cells.marks, np.arange(len(cells.rows)), s=14.0, **diamond, zorder=4, clip_on=False)
    figure = ax.get_figure(root=False)
    if finite.any() and figure is not None:
        figure.colorbar(painted, ax=ax, label=cells.label, pad=0.02, fraction=0.05)


def _notes(cells: Cells) -> list[Any]:
    """Return the legend handles."""
    from matplotlib.patches import Patch

    found: list[Any] = [mark("D", "white", 4.0, "worst instant", markeredgecolor="black")]
    if np.isnan(cells.values).any():
        found.append(Patch(facecolor="0.8", edgecolor="0.3", hatch="//////", label=NOTHING))
    if np.isinf(cells.values).any():
        found.append(Patch(facecolor="white", edgecolor="black", label="no known limit"))
    return found
