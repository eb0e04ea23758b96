"""Triangles from a file: STL by NumPy, COLLADA and OBJ by coal, which comes with Pinocchio."""

from __future__ import annotations

from itertools import chain
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.errors import FileError
from ftforce.source import read_bytes
from ftforce.stderr import captured_stderr
from ftforce.view.shapes import Mesh, joined
from ftforce.view.visuals import LARGEST_LENGTH

if TYPE_CHECKING:
    from pathlib import Path

LARGEST_MESH = 64_000_000  # bytes of one file; the largest of the known robots has 6 MB
MOST_TRIANGLES = 1_000_000  # of one file

_SMALLEST_SCALE = 1e-4  # of a mesh in the URDF: many are in mm
_HEADER = 84  # bytes before the triangles of a binary STL; the last four count them
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNERS = itemgetter(0, 1, 2)


def read_mesh(path: Path) -> Mesh:
    """Read a mesh.

    Parameters
    ----------
    path :
        A file that ends in one of `ftforce.view.visuals.MESH_ENDINGS`.

    Raises
    ------
    FileError
        It cannot be read, is too large, or holds no triangles.
    """
    data = read_bytes(path, FileError, "a mesh", LARGEST_MESH)
    corners = _binary_stl(data) if path.suffix.lower() == ".stl" else None
    mesh = _by_coal(path) if corners is None else _joined(corners, path)
    if not len(mesh.faces):
        raise FileError(path, "holds no triangles")
    if not np.abs(mesh.vertices).max() <= LARGEST_LENGTH / _SMALLEST_SCALE:  # nor NaN
        raise FileError(path, "has vertices that are not finite, or far away")
    return mesh


def _binary_stl(data: bytes) -> np.ndarray[Any, np.dtype[np.float32]] | None:
    """Return the corners of a binary STL, shape (f, 3, 3); ``None`` if it is none."""
    if len(data) < _HEADER:
        return None
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    if len(data) != _HEADER + count * _TRIANGLE.itemsize:
        return None
    corners: np.ndarray[Any, np.dtype[np.float32]]
    corners = np.frombuffer(data, _TRIANGLE, count, _HEADER)["corners"]
    return corners


def _joined(corners: np.ndarray[Any, np.dtype[np.float32]], path: Path) -> Mesh:
    _check_count(len(corners), path)
    return joined(corners)


def _by_coal(path: Path) -> Mesh:
    import coal

    # Boxes along the axes are the cheapest tree that a loader of coal's can build: twice as fast.
    loader = coal.MeshLoader(coal.NODE_TYPE.BV_AABB)
    try:
        with captured_stderr():
            model = loader.load(str(path), np.ones(3))
    except (ValueError, RuntimeError) as problem:
        reason = " ".join(str(problem).split())
        raise FileError(path, f"cannot be read as a mesh ({reason[:200]})") from None
    count = int(model.num_tris)
    _check_count(count, path)
    vertices = np.array(model.vertices(), dtype=np.float64)  # a copy: coal's memory goes
    corners = map(_CORNERS, map(model.tri_indices, range(count)))
    faces = np.fromiter(chain.from_iterable(corners), np.uint32, 3 * count)
    return Mesh(vertices.reshape(-1, 3), faces.reshape(-1, 3))


def _check_count(count: int, path: Path) -> None:
    if count > MOST_TRIANGLES:
        raise FileError(path, f"holds {count} triangles; at most {MOST_TRIANGLES} are shown")
