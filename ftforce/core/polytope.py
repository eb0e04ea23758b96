"""The force polytope: vertices and faces of the set of forces that an arm can hold."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product
from math import comb
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ftforce.core.feasible_forces import FeasibleForces

_Indices: TypeAlias = "NDArray[np.intp]"
_Sides: TypeAlias = "NDArray[np.bool_]"

_MAX_INTERSECTIONS = 2_000_000  # plane intersections; a few seconds and 500 MB
_CHUNK = 20_000
_NEAR = 1e-9  # of a limit: smaller violations are tolerated
_AT_BOUND = 1e-7  # of a limit: a torque closer than this is at its limit
_ROUNDING = 1e-14  # of a point's distance from 0: rounding error of the torques there
_PARALLEL = 1e-12  # of the largest determinant: below it, planes count as parallel


@dataclass(frozen=True, slots=True, eq=False)
class Polytope:
    """The convex set of forces that an arm can hold.

    Attributes
    ----------
    vertices :
        Vertices, N (N·m), in the task axes, shape (k, m); k = 0 if no force can be held.
    faces :
        Vertices of each face, as row indices of ``vertices``. In three dimensions they are ordered
        around the face; in two, the polygon itself is the only face; in more, they are in
        ascending order.
    dimension :
        Dimension of the set: 0 for a point, 1 for a segment, 2 for a polygon …
    unlimited :
        Orthonormal directions in which no known limit bounds the set, as rows, in weighted task
        coordinates, shape (u, m). The vertices are those of the section orthogonal to them.
    """

    vertices: Matrix
    faces: tuple[tuple[int, ...], ...]
    dimension: int
    unlimited: Matrix

    @property
    def is_empty(self) -> bool:
        """Whether no force can be held."""
        return len(self.vertices) == 0

    @property
    def is_bounded(self) -> bool:
        """Whether limits bound the set in every direction."""
        return len(self.unlimited) == 0


def force_polytope(feasible: FeasibleForces, weights: Vector | None = None) -> Polytope:
    """Return the vertices and faces of the set of feasible forces.

    Any d independent planes ``J_iᵀ F = bound`` intersect in one point of the d-dimensional space of
    the set; the vertices are the points that satisfy all other limits.

    Parameters
    ----------
    feasible :
        The feasible forces, weighted.
    weights :
        Row weights of the task, shape (m,); ``None`` if all are 1.

    Raises
    ------
    InputError
        There are too many plane intersections.
    """
    m = len(feasible.F0)
    nothing = Polytope(read_only(np.zeros((0, m))), (), 0, read_only(np.zeros((0, m))))
    if not feasible.is_balanced:
        return nothing
    A = feasible.rows.dot(feasible.Z)
    offset = feasible.rows.dot(feasible.F0)
    lower, upper = feasible.lower - offset, feasible.upper - offset
    lever = np.sqrt(np.einsum("ij,ij->i", A, A))
    loaded = lever > feasible.rtol * feasible.scale
    if (upper[~loaded] < 0.0).any() or (lower[~loaded] > 0.0).any():
        return nothing
    A, lever = A[loaded] / lever[loaded, None], lever[loaded]
    basis, unlimited = _limited_space(A, feasible.rtol)
    A = A @ basis
    corners, at_bounds = _corners(A, lower[loaded] / lever, upper[loaded] / lever)
    if not len(corners):
        return nothing
    vertices = feasible.F0 + corners @ (feasible.Z @ basis).T
    corners = _within_their_plane(corners, A, at_bounds)
    if weights is not None:
        vertices = vertices * weights
    return Polytope(
        read_only(vertices),
        tuple(_faces(corners, at_bounds)),
        corners.shape[1],
        read_only((feasible.Z @ unlimited).T),
    )


def _limited_space(A: Matrix, rtol: float) -> tuple[Matrix, Matrix]:
    """Return bases of the directions bounded by limits, and of the unbounded ones."""
    d = A.shape[1]
    if not len(A):
        return np.zeros((d, 0)), np.eye(d)
    _, s, Vt = np.linalg.svd(A)
    rank = int(np.count_nonzero(s > rtol * s[0]))
    return Vt[:rank].T, Vt[rank:].T


def _corners(A: Matrix, lower: Vector, upper: Vector) -> tuple[Matrix, _Sides]:
    """Return the distinct vertices of ``lower ≤ A z ≤ upper`` and the bounds active at each.

    The rows of A are unit vectors. Tolerances are relative to each limit, plus rounding error,
    which may exceed the limit; whether planes are parallel is decided relative to the strongest
    rows in each direction.
    """
    k, d = A.shape
    if d == 0:
        return np.zeros((1, 0)), np.zeros((1, 2 * k), dtype=np.bool_)
    if comb(k, d) * 2**d > _MAX_INTERSECTIONS:
        raise InputError(
            f"the polytope has {comb(k, d) * 2**d:,} candidate vertices ({k} joints with limits, "
            f"{d} dimensions); at most {_MAX_INTERSECTIONS:,} are supported: choose a smaller task"
        )
    sides = np.array(list(product((False, True), repeat=d)))
    evened = np.linalg.svd(A, full_matrices=False)[0]
    size = np.linalg.norm(evened, axis=1)
    limit = 0.5 * (upper - lower)
    found: list[Matrix] = []
    for chosen in _chunks(k, d):
        volume = np.abs(np.linalg.det(evened[chosen]))
        rows = chosen[volume > _PARALLEL * size[chosen].prod(axis=1)]
        bounds = np.where(sides[:, None, :], upper[rows], lower[rows])  # (sides, c, d)
        points = np.linalg.solve(A[rows], bounds.transpose(1, 2, 0)).transpose(0, 2, 1)
        points = points.reshape(-1, d)
        above, below, rounding = _distances(points, A, lower, upper)
        inside = (np.minimum(above, below) >= -_NEAR * limit - rounding).all(axis=1)
        found.append(points[inside])
    points = np.concatenate(found)
    above, below, rounding = _distances(points, A, lower, upper)
    near = _AT_BOUND * limit + 100.0 * rounding
    # More than d planes may meet in one vertex, which is then found repeatedly.
    at_bounds, first = np.unique(
        np.hstack([below <= near, above <= near]), axis=0, return_index=True
    )
    return points[first], at_bounds


def _distances(
    points: Matrix, A: Matrix, lower: Vector, upper: Vector
) -> tuple[Matrix, Matrix, Matrix]:
    """Return distances above lower bounds and below upper ones, and their rounding errors."""
    torque = points @ A.T
    size: Matrix = np.linalg.norm(points, axis=1)[:, None]
    return torque - lower, upper - torque, _ROUNDING * size


def _within_their_plane(corners: Matrix, A: Matrix, at_bounds: _Sides) -> Matrix:
    """Return vertex coordinates in their affine hull: the limits may flatten the set."""
    always: _Sides = np.logical_and.reduce(at_bounds, axis=0)
    normals = A[always[: len(A)] | always[len(A) :]]
    if not len(normals):
        return corners
    _, s, Vt = np.linalg.svd(normals)
    coordinates: Matrix = corners @ Vt[np.count_nonzero(s > _NEAR * s[0]) :].T
    return coordinates


def _chunks(k: int, d: int) -> Iterator[_Indices]:
    rows: list[tuple[int, ...]] = []
    for chosen in combinations(range(k), d):
        rows.append(chosen)
        if len(rows) == _CHUNK:
            yield np.array(rows)
            rows = []
    if rows:
        yield np.array(rows)


def _faces(corners: Matrix, at_bounds: _Sides) -> Iterator[tuple[int, ...]]:
    """Yield the faces: the maximal sets of vertices on a common bound."""
    d = corners.shape[1]
    if d <= 2:
        if len(corners) >= 2 and d:
            yield _around(corners, np.arange(len(corners)))
        return
    members = np.unique(at_bounds.T, axis=0)
    members = members[(members.sum(axis=1) >= d) & ~members.all(axis=1)]
    for member in members:
        others = (members >= member).all(axis=1).sum() - 1  # that contain all its vertices
        if others:
            continue  # this bound touches the set in an edge or a vertex only
        indices = np.flatnonzero(member)
        yield _around(corners, indices) if d == 3 else tuple(indices.tolist())


def _around(corners: Matrix, members: _Indices) -> tuple[int, ...]:
    """Return the vertices of a polygon in order around it."""
    points = corners[members] - corners[members].mean(axis=0)
    plane = np.linalg.svd(points, full_matrices=False)[2][:2]
    if len(plane) < 2:  # a segment
        return tuple(np.argsort(points[:, 0]).tolist())
    x, y = plane @ points.T
    return tuple(members[np.argsort(np.arctan2(y, x))].tolist())
