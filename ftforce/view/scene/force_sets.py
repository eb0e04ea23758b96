"""Sets of exertable forces before and after the fault, as surfaces. Arrays only."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ftforce.errors import InputError
from ftforce.report.text import size
from ftforce.view.scene.arrows import MAX_LENGTH, TipAxes, has_both, norm, spatial
from ftforce.view.scene.colours import AFTER_SOLID, BEFORE_SOLID, Colour

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix
    from ftforce.core.polytope import Polytope
    from ftforce.core.task import Task
    from ftforce.view.model.answer import Answer

Faces: TypeAlias = NDArray[np.uint32]

_CIRCLE = 24
_LOOKS = {"before": BEFORE_SOLID, "after": AFTER_SOLID}


class Solid(NamedTuple):
    """A set of forces drawn around the tip: vertices in root axes, m, shape (k, 3)."""

    vertices: Matrix
    faces: Faces
    colour: Colour
    label: str


def polytopes_of(answer: Answer) -> tuple[tuple[Polytope, ...], tuple[str, ...]]:
    """Return the force polytopes before and after, if shown, and notes if unavailable."""
    found, task = answer.capability, answer.analysis.task
    if found is None or answer.state.shown.solid != "polytope":
        return (), ()
    if has_both(task):
        return (), ("polytopes are drawn only for tasks of forces or of moments",)
    try:
        both = found.polytope(after=False), found.polytope(after=True)
    except InputError as problem:  # too many joints
        return (), (str(problem),)
    if not all(one.is_bounded for one in both):
        return (), ("no polytope: known limits do not bound the forces",)
    return both, ()


def solids_of(
    answer: Answer, axes: TipAxes, polytopes: tuple[Polytope, ...], scale: float, extent: float
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    """Return the sets of forces to draw, and notes for the legend.

    Parameters
    ----------
    answer :
        The answer.
    axes :
        Task axes at the tip.
    polytopes :
        As returned by `polytopes_of`.
    scale :
        Length per N (N·m), m.
    extent :
        Size of the scene, m.
    """
    if polytopes:
        return _polytopes(polytopes, answer.analysis.task, axes, scale)
    if answer.state.shown.solid != "ellipsoid":
        return (), ()
    if has_both(answer.analysis.task):
        return (), ("ellipsoids are drawn only for tasks of forces or of moments",)
    return _ellipsoids(answer, axes, extent)


def _polytopes(
    polytopes: tuple[Polytope, ...], task: Task, axes: TipAxes, scale: float
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    solids, empty, flat = [], [], []
    for polytope, (when, colour) in zip(polytopes, _LOOKS.items(), strict=True):
        label = f"forces {when} the fault"
        faces = triangles(polytope.faces)
        if polytope.is_empty:
            empty.append(f"forces {when} the fault: no static equilibrium")
        elif not len(faces):
            flat.append(_flat(label))
        else:
            corners = axes.point(spatial(task, polytope.vertices), scale)
            solids.append(Solid(corners, faces, colour, label))
    return tuple(solids), (*empty, *flat)


def triangles(faces: tuple[tuple[int, ...], ...]) -> Faces:
    """Triangulate convex polygons, shape (k, 3); a segment yields none."""
    fans = [(face[0], *edge) for face in faces for edge in pairwise(face[1:])]
    return np.array(fans, dtype=np.uint32).reshape(-1, 3)


def _ellipsoids(
    answer: Answer, tip: TipAxes, extent: float
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    """Return {F : ‖JᵀF‖ ≤ 1 N·m} before and after the fault, the latter in range(K)."""
    reduced, task = answer.analysis.reduced, answer.analysis.task
    weighted = task.weighted_unit
    before = _axes_of(reduced.healthy.U, reduced.healthy.s, reduced.rank) * weighted
    after = _axes_of(reduced.damaged.U, reduced.damaged.s, reduced.rank_after) * weighted
    longest = max((norm(axis) for axis in (*before, *after)), default=0.0)
    if longest == 0.0:
        return (), ("no ellipsoid: no force can be commanded",)
    scale = MAX_LENGTH * extent / longest
    solids, flat = [], []
    for axes, (when, colour) in zip((before, after), _LOOKS.items(), strict=True):
        label = f"ellipsoid {when} the fault"
        if len(axes) > 1:
            vertices, faces = ellipsoid(spatial(task, axes))
            solids.append(Solid(tip.point(vertices, scale), faces, colour, label))
        else:
            flat.append(_flat(label) if len(axes) else f"{label}: no force can be commanded")
    per = f"{size(longest, 1)} {task.size_unit} for joint torques of norm 1"
    return tuple(solids), (f"ellipsoids, at their own scale: longest semi-axis {per}", *flat)


def _flat(label: str) -> str:
    return f"{label}: a line segment, not drawn"


def _axes_of(U: Matrix, s: list[float], rank: int) -> Matrix:
    """Return the semi-axes u_i/σ_i of the retained directions as rows, shape (rank, m)."""
    axes: Matrix = U[:, :rank].T / np.array(s[:rank])[:, None]
    return axes


def ellipsoid(axes: Matrix) -> tuple[Matrix, Faces]:
    """Return the surface of an ellipsoid centred at the origin, or a disk for two semi-axes.

    Parameters
    ----------
    axes :
        Two or three semi-axes as rows, shape (2 or 3, 3).
    """
    if len(axes) == 3:
        vertices, faces = _sphere()
        return vertices @ axes, faces
    angle = np.linspace(0.0, 2.0 * math.pi, _CIRCLE, endpoint=False)
    disk = np.vstack([np.column_stack([np.cos(angle), np.sin(angle)]), np.zeros((1, 2))])
    i = np.arange(_CIRCLE)
    fan = np.column_stack([i, (i + 1) % _CIRCLE, np.full(_CIRCLE, _CIRCLE)])
    return disk @ axes, fan.astype(np.uint32)


@cache
def _sphere() -> tuple[Matrix, Faces]:
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=3)
    return np.array(sphere.vertices), sphere.faces.astype(np.uint32)
