"""Simple solids as triangles, and what is done to triangles. Arrays only."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.arrays import Matrix, Vector

Faces: TypeAlias = NDArray[np.uint32]

ROUND = 32  # sides of what is round


class Mesh(NamedTuple):
    """Triangles.

    Attributes
    ----------
    vertices :
        Shape (k, 3), m. Vertices are shared by triangles that meet smoothly: the page shades
        them as one surface.
    faces :
        Indices into ``vertices``, shape (f, 3), anticlockwise from outside.
    """

    vertices: Matrix
    faces: Faces


def box(x: float, y: float, z: float) -> Mesh:
    """Return a box around the origin, sides in m."""
    square = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) / 2.0
    sides = [np.roll(sign * square, turn, axis=1) for turn in range(3) for sign in (1, -1)]
    face = np.array([[0, 1, 2], [0, 2, 3]])
    flipped = face[:, ::-1]  # mirrored through the origin a square turns the other way
    faces = [(face if side % 2 == 0 else flipped) + 4 * side for side in range(6)]
    return Mesh(np.concatenate(sides) * [x, y, z], _faces(np.concatenate(faces)))


def sphere(radius: float) -> Mesh:
    """Return a sphere around the origin, radius in m."""
    return _turned(*_half_circle(radius, 0.0))


def capsule(radius: float, length: float) -> Mesh:
    """Return a cylinder on z with a half sphere at each end; ``length`` is the cylinder's, m."""
    return _turned(*_half_circle(radius, length))


def cylinder(radius: float, length: float) -> Mesh:
    """Return a cylinder on z around the origin, m."""
    z = np.array([-length, length]) / 2.0
    wall = _turned(np.array([radius, radius]), z)
    bottom = _turned(np.array([0.0, radius]), z[[0, 0]])
    top = _turned(np.array([radius, 0.0]), z[[1, 1]])
    return merged([wall, bottom, top])


def between(start: Vector, end: Vector, radius: float) -> Mesh:
    """Return a capsule from one point to another, m, shape (3,) each."""
    along = end - start
    length = float(np.linalg.norm(along))
    return moved(capsule(radius, length), turned_to(along), (start + end) / 2.0)


def turned_to(direction: Vector) -> Matrix:
    """Return a rotation that turns z to a direction, shape (3, 3); none if it is zero."""
    length = np.linalg.norm(direction)
    if length < 1e-9:
        return np.eye(3)
    z = direction / length
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def moved(mesh: Mesh, rotation: Matrix, translation: Vector) -> Mesh:
    """Return the mesh, turned and then shifted (m)."""
    return Mesh(mesh.vertices @ rotation.T + translation, mesh.faces)


def scaled(mesh: Mesh, factors: Sequence[float]) -> Mesh:
    """Return the mesh with its coordinates multiplied; a mirror image keeps its outside out."""
    faces = mesh.faces[:, ::-1] if np.prod(np.sign(factors)) < 0 else mesh.faces
    return Mesh(mesh.vertices * factors, np.ascontiguousarray(faces))


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one."""
    if not meshes:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint32))
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), _faces(np.concatenate(faces)))


def joined(corners: NDArray[np.float32]) -> Mesh:
    """Return triangles with vertices at the same place made one.

    Parameters
    ----------
    corners :
        Of each triangle, shape (f, 3, 3), m.
    """
    points = np.ascontiguousarray(corners.reshape(-1, 3), dtype=np.float32) + np.float32(0.0)
    bits = points.view(np.uint32).astype(np.uint64)  # after + 0.0, which makes -0 a 0
    keys = (bits[:, 0] << np.uint64(32)) | bits[:, 1]
    keys = keys * np.uint64(0x9E3779B97F4A7C15) ^ (bits[:, 2] * np.uint64(0xC2B2AE3D27D4EB4F))
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    vertices = points[first]
    if not np.array_equal(vertices[inverse], points):  # two places have one key
        vertices, inverse = np.unique(points, axis=0, return_inverse=True)
    faces = inverse.reshape(-1, 3)
    return Mesh(vertices.astype(np.float64), _faces(faces[~_is_degenerate(faces)]))


def coarser(mesh: Mesh, cell: float) -> Mesh:
    """Return the mesh with all vertices in a cell of a grid (m) made one, at their mean."""
    if not len(mesh.vertices):
        return mesh
    places = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    spans = places.max(axis=0) + 1
    keys = (places[:, 0] * spans[1] + places[:, 1]) * spans[2] + places[:, 2]
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse, mesh.vertices[:, axis]) for axis in range(3)]
    faces = inverse[mesh.faces]
    faces = faces[~_is_degenerate(faces)]
    return Mesh(np.column_stack(sums) / counts[:, None], _faces(_without_doubles(faces)))


def _is_degenerate(faces: NDArray[np.intp]) -> NDArray[np.bool_]:
    a, b, c = faces.T
    degenerate: NDArray[np.bool_] = (a == b) | (b == c) | (a == c)
    return degenerate


def _without_doubles(faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the triangles without those that have the same three corners as another."""
    a, b, c = np.sort(faces, axis=1).astype(np.uint64).T
    if not len(faces) or int(c.max()) >= 2**21:  # three indices would not fit into one number
        return faces
    keys = (a << np.uint64(42)) | (b << np.uint64(21)) | c
    return faces[np.unique(keys, return_index=True)[1]]


def _half_circle(radius: float, length: float) -> tuple[Vector, Vector]:
    """Return distances from the axis and heights of half a circle whose halves are apart."""
    quarter = np.linspace(0.0, np.pi / 2.0, ROUND // 4 + 1)
    r, z = radius * np.cos(quarter), length / 2.0 + radius * np.sin(quarter)
    return np.concatenate([r[::-1], r]), np.concatenate([-z[::-1], z])


def _turned(r: Vector, z: Vector) -> Mesh:
    """Return what a line in the half plane makes when it turns about z."""
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.concatenate(
        [
            np.column_stack([radius * ring, np.full(ROUND, height)])
            for radius, height in zip(r, z, strict=True)
        ]
    )
    i = np.arange(ROUND)
    j = (i + 1) % ROUND
    quads = [
        np.concatenate(
            [np.column_stack([i, j, j + ROUND]), np.column_stack([i, j + ROUND, i + ROUND])]
        )
        + k * ROUND
        for k in range(len(r) - 1)
    ]
    faces = np.concatenate(quads)
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return Mesh(vertices, _faces(faces[area > 1e-9 * area.max(initial=0.0)]))  # none at the poles


def _faces(faces: NDArray[np.intp]) -> Faces:
    return np.ascontiguousarray(faces, dtype=np.uint32)
