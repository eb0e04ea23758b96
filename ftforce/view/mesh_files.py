"""Triangles from a file: STL, COLLADA and OBJ, read in Python, so that no file can do harm."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ftforce.errors import FileError
from ftforce.source import read_bytes, read_text
from ftforce.view.collada import read_collada
from ftforce.view.shapes import Mesh, joined
from ftforce.view.visuals import LARGEST_LENGTH

if TYPE_CHECKING:
    from pathlib import Path

LARGEST_MESH = 64_000_000  # bytes of one file; the largest of the known robots has 6 MB
MOST_TRIANGLES = 1_000_000  # of one file

_SMALLEST_SCALE = 1e-4  # of a mesh in the URDF: many are in mm
_HEADER = 84  # bytes before the triangles of a binary STL; the last four count them
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")

_Corners: TypeAlias = NDArray[np.float32]


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
    ending = path.suffix.lower()
    if ending == ".stl":
        mesh = _stl(read_bytes(path, FileError, "a mesh", LARGEST_MESH), path)
    else:
        text = read_text(path, FileError, "a mesh", LARGEST_MESH)
        mesh = read_collada(text, path, MOST_TRIANGLES) if ending == ".dae" else _obj(text, path)
    if not len(mesh.faces):
        raise FileError(path, "holds no triangles")
    if not np.abs(mesh.vertices).max() <= LARGEST_LENGTH / _SMALLEST_SCALE:  # nor NaN
        raise FileError(path, "has vertices that are not finite, or far away")
    return mesh


def _stl(data: bytes, path: Path) -> Mesh:
    corners = _binary_stl(data)
    if corners is None:
        corners = _text_stl(data, path)
    _check_count(len(corners), path)
    return joined(corners)


def _binary_stl(data: bytes) -> _Corners | None:
    """Return the corners of a binary STL, shape (f, 3, 3); ``None`` if it is none."""
    if len(data) < _HEADER:
        return None
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    if len(data) != _HEADER + count * _TRIANGLE.itemsize:
        return None
    corners: _Corners = np.frombuffer(data, _TRIANGLE, count, _HEADER)["corners"]
    return corners


def _text_stl(data: bytes, path: Path) -> _Corners:
    try:
        numbers = [float(word) for vertex in _VERTEX.findall(data) for word in vertex]
        with np.errstate(over="ignore"):  # what becomes infinite is refused
            return np.array(numbers, dtype=np.float32).reshape(-1, 3, 3)
    except ValueError as problem:
        raise FileError(path, f"cannot be read as an STL ({problem})") from None


def _obj(text: str, path: Path) -> Mesh:
    """Return the polygons of an OBJ as fans of triangles; all its objects together."""
    points: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    try:
        for line in text.splitlines():
            kind, *words = line.split() or [""]
            if kind == "v":
                points.append([float(word) for word in words[:3]])
            elif kind == "f":
                corners = [_obj_index(word, len(points)) for word in words]
                faces += [(corners[0], *pair) for pair in pairwise(corners[1:])]
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3)
    except (ValueError, IndexError) as problem:
        raise FileError(path, f"cannot be read as an OBJ ({problem})") from None
    _check_count(len(faces), path)
    return Mesh(vertices, np.array(faces, dtype=np.uint32).reshape(-1, 3))


def _obj_index(word: str, count: int) -> int:
    """Return the index, from 0, of a corner such as 3/1/2; negative ones count from the end."""
    number = int(word.partition("/")[0])
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"there is no vertex {number}")
    return index


def _check_count(count: int, path: Path) -> None:
    if count > MOST_TRIANGLES:
        raise FileError(path, f"holds {count} triangles; at most {MOST_TRIANGLES} are shown")
