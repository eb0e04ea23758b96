"""Primitive shapes as triangle meshes, and mesh operations."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from trimesh import Trimesh

    from ftforce.core.arrays import Matrix, Vector

SEGMENTS = 32  # of a circle
_SMOOTH = np.radians(30.0)  # edges with smaller angles are shaded smoothly


def box(x: float, y: float, z: float) -> Trimesh:
    """Return a box centred at the origin, with side lengths in m.

    Parameters
    ----------
    x, y, z :
        Side lengths, m.
    """
    return _unit_box().copy().apply_scale((x, y, z))


def sphere(radius: float) -> Trimesh:
    """Return a sphere centred at the origin, radius in m."""
    return capsule(radius, 0.0)


def capsule(radius: float, length: float) -> Trimesh:
    """Return a capsule along z; ``length`` is that of its cylindrical part, m.

    Parameters
    ----------
    radius, length :
        Radius, and length of the cylindrical part, m.
    """
    from trimesh import creation

    # trimesh's own capsule has its full width only since version 5.
    quarter = np.linspace(0.0, np.pi / 2.0, SEGMENTS // 4 + 1)
    half = np.column_stack([np.cos(quarter), np.sin(quarter)]) * radius + [0.0, length / 2.0]
    return creation.revolve(np.concatenate([half[::-1] * [1.0, -1.0], half]), sections=SEGMENTS)


def cylinder(radius: float, length: float) -> Trimesh:
    """Return a cylinder along z, centred at the origin, m.

    Parameters
    ----------
    radius, length :
        m.
    """
    return _unit_cylinder().copy().apply_scale((radius, radius, length))


def between(start: Vector, end: Vector, radius: float) -> Trimesh:
    """Return a capsule between two points.

    Parameters
    ----------
    start, end :
        The points, m, shape (3,).
    radius :
        m.
    """
    mesh = aligned(capsule(radius, float(np.linalg.norm(end - start))), end - start)
    return mesh.apply_translation((start + end) / 2.0)


def aligned(mesh: Trimesh, direction: Vector) -> Trimesh:
    """Return the mesh, rotated about the origin so that its z axis points in a direction.

    Parameters
    ----------
    mesh :
        The mesh, which is modified.
    direction :
        Nonzero, shape (3,).
    """
    from trimesh.geometry import align_vectors

    return mesh.apply_transform(align_vectors([0.0, 0.0, 1.0], direction))


def decimated(mesh: Trimesh, cell: Vector) -> Trimesh:
    """Return the mesh with all vertices in a grid cell merged at their mean.

    Parameters
    ----------
    mesh :
        The mesh.
    cell :
        Cell size along x, y and z, in the mesh's unit, shape (3,).
    """
    from trimesh import Trimesh
    from trimesh.grouping import unique_rows

    if mesh.is_empty:
        return mesh
    points: Matrix = np.asarray(mesh.vertices)
    places = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    _, inverse = unique_rows(places)
    sums = [np.bincount(inverse, points[:, axis]) for axis in range(3)]
    vertices = np.column_stack(sums) / np.bincount(inverse)[:, None]
    faces = inverse[np.asarray(mesh.faces)]
    faces = faces[~is_degenerate(faces)]
    first, _ = unique_rows(np.sort(faces, axis=1))
    return Trimesh(vertices, faces[first], process=False)


def is_degenerate(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which triangles use a vertex twice."""
    a, b, c = faces.T
    degenerate: NDArray[np.bool_] = (a == b) | (b == c) | (a == c)
    return degenerate


@cache
def _unit_box() -> Trimesh:
    from trimesh import creation

    return _with_sharp_edges(creation.box())


@cache
def _unit_cylinder() -> Trimesh:
    from trimesh import creation

    return _with_sharp_edges(creation.cylinder(radius=1.0, height=1.0, sections=SEGMENTS))


def _with_sharp_edges(mesh: Trimesh) -> Trimesh:
    """Return the mesh with vertices duplicated at sharp edges, to keep them from being smoothed."""
    from trimesh.graph import smooth_shade

    return smooth_shade(mesh, angle=_SMOOTH, facet_minarea=None)
