"""Triangles from STL, COLLADA and OBJ files, with limits that make untrusted files safe."""

from __future__ import annotations

import io
import warnings
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ftforce.errors import FileError, printable
from ftforce.io.text import read_bytes, read_text
from ftforce.view.geometry.collada import read_collada
from ftforce.view.geometry.shapes import is_degenerate
from ftforce.view.geometry.visuals import MAX_LENGTH

if TYPE_CHECKING:
    from pathlib import Path

    from trimesh import Trimesh

MAX_BYTES = 64_000_000  # bytes per file; the largest file of the known robots has 6 MB
MAX_TRIANGLES = 1_000_000  # per file

_MIN_SCALE = 1e-4  # of a mesh in the URDF; many are in mm
_MAX_SOLIDS = 1_000  # per ASCII STL


def read_mesh(path: Path) -> Trimesh:
    """Read a mesh file.

    Parameters
    ----------
    path :
        File with one of the extensions in `ftforce.view.geometry.visuals.MESH_EXTENSIONS`.

    Raises
    ------
    FileError
        The file cannot be read, is too large, or contains no triangles.
    """
    with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
        # Older numpy versions only warn about non-numeric text and return the numbers before it.
        warnings.filterwarnings("error", "string or file could not be read")
        mesh = _read(path)
    if len(mesh.faces) > MAX_TRIANGLES:
        count = len(mesh.faces)
        raise FileError(path, f"has {count} triangles, more than the maximum of {MAX_TRIANGLES}")
    if not np.abs(mesh.vertices).max(initial=0.0) <= MAX_LENGTH / _MIN_SCALE:  # also NaN
        raise FileError(path, "has vertices that are too far away or not finite")
    if path.suffix.lower() == ".stl":  # STL stores three separate vertices per triangle
        mesh.merge_vertices()
        mesh.update_faces(~is_degenerate(np.asarray(mesh.faces)))
    if not len(mesh.faces):
        raise FileError(path, "contains no triangles")
    return mesh


def _read(path: Path) -> Trimesh:
    extension = path.suffix.lower()
    if extension == ".stl":
        return _stl(read_bytes(path, FileError, "a mesh", MAX_BYTES), path)
    text = read_text(path, FileError, "a mesh", MAX_BYTES)
    return read_collada(text, path, MAX_TRIANGLES) if extension == ".dae" else _obj(text, path)


def _stl(data: bytes, path: Path) -> Trimesh:
    import trimesh

    try:
        if data.lower().count(b"endsolid") > _MAX_SOLIDS:  # trimesh gives each a unique name
            raise ValueError(f"more than {_MAX_SOLIDS} solids")
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type="stl", process=False)
    except MemoryError:
        raise
    except Exception as problem:  # trimesh raises all kinds of exceptions on invalid input
        raise FileError(path, f"cannot be read as an STL ({printable(problem)[:200]})") from None
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)  # drops normals and attributes


def _obj(text: str, path: Path) -> Trimesh:
    """Return the polygons of an OBJ file as triangle fans, with all its objects merged.

    trimesh would count relative indices from the end of the file, and treat 0 as the first vertex.
    """
    import trimesh

    points: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    try:
        for line in text.splitlines():
            kind, *words = line.split() or [""]
            if kind == "v":
                if len(words) < 3:
                    found = f"vertex {len(points) + 1} has {len(words)} coordinates"
                    raise ValueError(f"{found}; x, y and z are needed")
                points.append([float(word) for word in words[:3]])
            elif kind == "f":
                corners = [_obj_index(word, len(points)) for word in words]
                faces += [(corners[0], *pair) for pair in pairwise(corners[1:])]
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3)
    except (ValueError, IndexError) as problem:
        raise FileError(path, f"cannot be read as an OBJ ({problem})") from None
    return trimesh.Trimesh(vertices, np.array(faces).reshape(-1, 3), process=False)


def _obj_index(word: str, count: int) -> int:
    """Return the index (from 0) of a corner such as 3/1/2; negative numbers count backwards."""
    number = int(word.partition("/")[0])
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"there is no vertex {number}")
    return index
