"""Exact planar slices of the feasible forces, computed and drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.core.faults import FaultMode
from ftforce.core.feasible_forces import LockModel
from ftforce.core.polytope import Polytope, force_polytope
from ftforce.errors import InputError, UnknownNameError
from ftforce.report import text as words
from ftforce.show.plots.canvas import BLACK, NOTHING, SKY, VERMILION, Options, canvas, key, wrapped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from ftforce.analysis.capability import Capability
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.feasible_forces import FeasibleForces
    from ftforce.core.task import Task

Rows = tuple[int, int]


class Slice(NamedTuple):
    """A planar slice of the feasible forces before or after the fault.

    Attributes
    ----------
    when, words :
        Short label, and legend text.
    polytope :
        The feasible forces, N (N·m), in the plane's two components.
    look :
        Drawing options.
    """

    when: str
    words: str
    polytope: Polytope
    look: dict[str, Any]


def capability(
    result: Capability, components: Sequence[str] | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw the feasible forces in two components before and after the fault.

    The sets are exact slices of the force polytope, not projections: the task's other components
    are zero, so a point is a force exerted in this plane only. With locked joints there are two
    sets after the fault: forces that the motors can command, and forces of an existing load that
    motors and brakes can hold together.

    Parameters
    ----------
    result :
        The force capability.
    components :
        Two task components, for the x and y axes; by default the first two.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The task has no such components, or only one, or ``ax`` is not two-dimensional.
    """
    task = result.analysis.task
    rows = _rows(task, components)
    names, units = ([x[i] for i in rows] for x in (task.components, task.units))
    slices = slices_of(result, rows)
    corners = np.vstack([np.zeros((1, 2)), *(one.polytope.vertices for one in slices)])
    far = 100.0 * (float(np.abs(corners).max()) or 1.0)
    with canvas(ax, 3.2) as axes:
        axes.axhline(0.0, color="0.7", linewidth=0.6)
        axes.axvline(0.0, color="0.7", linewidth=0.6)
        for one in slices:
            _draw(axes, _outline(one.polytope, far, _weights(task, rows)), one)
        _window(axes, corners, same_unit=units[0] == units[1])
        axes.set_xlabel(f"{names[0]} [{units[0]}]")
        axes.set_ylabel(f"{names[1]} [{units[1]}]")
        title = [f"{' and '.join(names)}, {task.axes} axes", *_notes(task, rows, slices)]
        axes.set_title(wrapped(axes, title))
        key(axes)
    return axes


def slices_of(result: Capability, rows: Rows) -> list[Slice]:
    """Return the slices in the plane of two components, before and after the fault."""
    faults, weights = result.analysis.faults, result.analysis.task.weights
    found = []
    locked = faults.in_mode(FaultMode.LOCKED)
    for when, label, after, reading, look in _LOOKS:
        if (after and not faults) or (reading is LockModel.HELD and not locked):
            continue
        feasible = result.feasible(after=after, reading=reading)
        found.append(Slice(when, label, _plane_slice(feasible, rows, weights), look))
    return found


# Wide outlines are drawn first, so that coinciding outlines all remain visible.
_LOOKS: tuple[tuple[str, str, bool, LockModel, dict[str, Any]], ...] = (
    (
        "before",
        "before the fault",
        False,
        LockModel.COMMANDED,
        {"facecolor": "#D9EEF9", "edgecolor": SKY, "linewidth": 2.4},
    ),
    (
        "after",
        "after, commanded by motors",
        True,
        LockModel.COMMANDED,
        {"facecolor": "none", "edgecolor": VERMILION, "linewidth": 1.4, "hatch": "////"},
    ),
    (
        "with locks",
        "after, held with locks",
        True,
        LockModel.HELD,
        {"facecolor": "none", "edgecolor": BLACK, "linewidth": 1.0, "linestyle": (0, (4, 2))},
    ),
)


def _plane_slice(feasible: FeasibleForces, rows: Rows, weights: Vector | None = None) -> Polytope:
    """Return the slice of the feasible forces in the plane of two components.

    The slice of ``{F₀ + Z z}`` with its limits has the same form with two rows, so its vertices are
    found in the same way as those of the full set, without sampling.

    Parameters
    ----------
    feasible :
        The feasible forces, weighted.
    rows :
        Rows of the two components.
    weights :
        Row weights of the task; ``None`` if all are 1.
    """
    # A force E x in the plane is feasible if (I - ZZᵀ) E x = F₀; F₀ is orthogonal to Z.
    m = len(feasible.F0)
    beyond = (np.eye(m) - feasible.Z @ feasible.Z.T)[:, rows]
    U, s, Vt = np.linalg.svd(beyond, full_matrices=False)
    rank = int(np.count_nonzero(s > feasible.rtol))  # sines of the angles between the plane and Z
    F0 = ((U.T @ feasible.F0)[:rank] / s[:rank]) @ Vt[:rank]
    miss = float(np.linalg.norm(beyond @ F0 - feasible.F0))
    if miss > feasible.rtol * float(np.linalg.norm(feasible.F0)):
        nothing = read_only(np.zeros((0, 2)))
        return Polytope(nothing, (), 0, nothing)
    flat = feasible._replace(
        F0=read_only(F0), Z=read_only(Vt[rank:].T), rows=read_only(feasible.rows[:, rows])
    )
    return force_polytope(flat, None if weights is None else weights[list(rows)])


def _outline(polytope: Polytope, far: float, weights: Vector | None = None) -> Matrix:
    """Return the ordered corners of a slice; unbounded directions end at a distance ``far``.

    Parameters
    ----------
    polytope :
        The slice.
    far :
        Distance, N (N·m).
    weights :
        Row weights of the two components; ``None`` if both are 1.
    """
    order = polytope.faces[0] if polytope.faces else range(len(polytope.vertices))
    corners = polytope.vertices[list(order)]
    for direction in polytope.unlimited if weights is None else polytope.unlimited * weights:
        step = far * direction / np.linalg.norm(direction)
        corners = np.vstack([corners + step, corners[::-1] - step])
    return corners


def _rows(task: Task, components: Sequence[str] | None) -> Rows:
    """Return the rows of two components."""
    chosen = task.components[:2] if components is None else tuple(components)
    for name in chosen:
        if name not in task.components:
            raise UnknownNameError("component", name, task.components, f"in the task '{task}'")
    if len(chosen) != 2 or chosen[0] == chosen[1]:
        raise InputError(
            "a plane needs two different components of the task, which has "
            f"{', '.join(task.components)}; got {', '.join(chosen) or 'none'}"
        )
    return task.components.index(chosen[0]), task.components.index(chosen[1])


def _weights(task: Task, rows: Rows) -> Vector | None:
    return None if task.weights is None else task.weights[list(rows)]


def _notes(task: Task, rows: Rows, slices: Sequence[Slice]) -> list[str]:
    """Return notes on slices that are empty, a single point, or unbounded."""
    found: dict[str, list[str]] = {}
    for one in slices:
        found.setdefault(_note(task, rows, one.polytope), []).append(one.when)
    return [f"{', '.join(whens)}: {note}" for note, whens in found.items() if note]


def _note(task: Task, rows: Rows, polytope: Polytope) -> str:
    if polytope.is_empty:
        return NOTHING
    if len(polytope.unlimited) == 2:
        return "no known limit"
    if len(polytope.unlimited) == 1:
        return f"no known limit along {_along(task, rows, polytope.unlimited[0])}"
    if len(polytope.vertices) > 1:
        return ""
    return "no force" if np.abs(polytope.vertices).max() <= words.NEGLIGIBLE else "one force alone"


def _along(task: Task, rows: Rows, weighted: Vector) -> str:
    """Return a direction in the plane in words: its component's name, or both coordinates."""
    weights = _weights(task, rows)
    direction = weighted if weights is None else weighted * weights
    direction = direction / np.linalg.norm(direction)
    largest = int(np.abs(direction).argmax())
    if abs(direction[1 - largest]) < 1e-3:
        return task.components[rows[largest]]
    return words.vector_in_words(direction * np.sign(direction[largest]))


def _draw(ax: Axes, corners: Matrix, one: Slice) -> None:
    """Draw a polygon, or a line or point if it is degenerate."""
    from matplotlib.patches import Polygon

    look = one.look
    if len(corners) > 2:
        ax.add_patch(Polygon(corners, closed=True, label=one.words, **look))
    elif len(corners):
        style: Options = {
            "linewidth": 1.5 * look["linewidth"],
            "linestyle": look.get("linestyle", "-"),
        }
        points: Options = {"color": look["edgecolor"], "marker": "X", "markersize": 6.0}
        ax.plot(*corners.T, label=one.words, **points, **style, zorder=3)


def _window(ax: Axes, corners: Matrix, *, same_unit: bool) -> None:
    """Fit the axes to all corners, with equal scales if both components have the same unit."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    span = high - low
    if same_unit:
        span = np.full(2, span.max())
        ax.set_aspect("equal")
    half = 0.56 * np.where(span > words.NEGLIGIBLE, span, 1.0)
    middle = 0.5 * (low + high)
    ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
    ax.set_ylim(middle[1] - half[1], middle[1] + half[1])
