"""Triangles from COLLADA, as far as robots use it.

coal, which Pinocchio loads meshes with, mixes up the corners of a mesh of several materials: most
of Baxter's and the UR arms' look torn. As ROS does, a file's unit counts and its up axis does not.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ftforce.errors import FileError
from ftforce.source import parse_xml
from ftforce.view.shapes import Mesh, merged, moved, scaled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from xml.etree.ElementTree import Element

    from ftforce.arrays import Matrix

Indices: TypeAlias = NDArray[np.intp]

MOST_NODES = 10_000
DEEPEST = 50
_FARTHEST = 1e9  # of a transformation's numbers, in the file's unit


class _Placed(NamedTuple):
    """An element of the scene and the transformation from it to the scene, shape (4, 4)."""

    element: Element
    pose: Matrix
    depth: int


def read_collada(text: str, path: Path, most_triangles: int) -> Mesh:
    """Read the triangles of a COLLADA file.

    Parameters
    ----------
    text, path :
        The file's text, and its name for messages.
    most_triangles :
        How many it may have.

    Raises
    ------
    FileError
        It is no COLLADA, or uses what is not read here.
    """
    root = parse_xml(text, path, FileError)
    if root.tag != "COLLADA":
        raise FileError(path, f"is no COLLADA: its root element is <{root.tag}>")
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused later
            return _File(root, most_triangles).mesh()
    except (ValueError, IndexError, KeyError, OverflowError) as problem:
        raise FileError(path, f"cannot be read as COLLADA ({problem})") from None


class _File:
    """What a file's elements refer to."""

    def __init__(self, root: Element, most_triangles: int) -> None:
        self.root, self.most = root, most_triangles
        self.by_id = {key: one for one in root.iter() if (key := one.get("id")) is not None}
        self.done: dict[str, Mesh] = {}

    def mesh(self) -> Mesh:
        meshes, count = [], 0
        for url, pose in self.instances():
            mesh = self.geometry(url)
            count += len(mesh.faces)
            if count > self.most:
                raise ValueError(f"over {self.most} triangles")
            meshes.append(_transformed(mesh, pose))
        unit = self.root.find("asset/unit")
        metre = float(unit.get("meter", "1")) if unit is not None else 1.0
        if not (math.isfinite(metre) and metre > 0.0):
            raise ValueError("its unit is no length")
        return scaled(merged(meshes), (metre, metre, metre))

    def to(self, url: str) -> Element:
        """Return the element that is meant by a reference within the file."""
        if not url.startswith("#") or url[1:] not in self.by_id:
            raise ValueError(f"it refers to {url[:60]!r}, which it does not hold")
        return self.by_id[url[1:]]

    # ---- the scene -----------------------------------------------------------------------

    def instances(self) -> Iterator[tuple[str, Matrix]]:
        """Yield references to geometries, and where each stands."""
        chosen = self.root.find("scene/instance_visual_scene")
        if chosen is not None:
            scene: Element | None = self.to(chosen.get("url", ""))
        else:
            scene = self.root.find("library_visual_scenes/visual_scene")
        if scene is None:  # geometries alone
            for geometry in self.root.iter("geometry"):
                yield f"#{geometry.get('id', '')}", np.eye(4)
            return
        waiting = [_Placed(node, np.eye(4), 0) for node in scene.findall("node")]
        for _ in range(MOST_NODES):
            if not waiting:
                return
            element, above, depth = waiting.pop()
            if depth > DEEPEST:
                raise ValueError("its scene has too many nodes, one in the other")
            pose = above @ _pose(element)
            for one in element.findall("instance_geometry"):
                yield one.get("url", ""), pose
            inner = element.findall("node")
            inner += [self.to(one.get("url", "")) for one in element.findall("instance_node")]
            waiting += [_Placed(node, pose, depth + 1) for node in inner]
        if waiting:
            raise ValueError("its scene has too many nodes")

    # ---- geometries ----------------------------------------------------------------------

    def geometry(self, url: str) -> Mesh:
        """Return a geometry, in its own axes and unit."""
        if url not in self.done:
            mesh = self.to(url).find("mesh")
            parts = (
                [] if mesh is None else [part for kind in _READERS for part in mesh.findall(kind)]
            )
            self.done[url] = merged([self.part(part) for part in parts])
        return self.done[url]

    def part(self, part: Element) -> Mesh:
        """Return the triangles of one material."""
        inputs = part.findall("input")
        offsets = [int(one.get("offset", "0")) for one in inputs]
        step = max(offsets, default=0) + 1
        corner = next((one for one in inputs if one.get("semantic") == "VERTEX"), None)
        if corner is None:
            raise ValueError(f"a <{part.tag}> has no vertices")
        offset = int(corner.get("offset", "0"))
        if not 0 <= offset < step <= 64:
            raise ValueError(f"a <{part.tag}> has wrong offsets")
        points = self.points(corner.get("source", ""))
        faces = _READERS[part.tag](part, step, offset)
        used, inverse = np.unique(faces, return_inverse=True)
        if len(used) and not 0 <= used[0] <= used[-1] < len(points):
            raise ValueError(f"a <{part.tag}> names vertices that do not exist")
        return Mesh(points[used], inverse.reshape(-1, 3).astype(np.uint32))

    def points(self, url: str) -> Matrix:
        """Return positions, shape (k, 3)."""
        for one in self.to(url).findall("input"):
            if one.get("semantic") == "POSITION":
                return self.source(self.to(one.get("source", "")))
        raise ValueError("vertices have no positions")

    @staticmethod
    def source(source: Element) -> Matrix:
        numbers = _numbers(source.find("float_array"))
        accessor = source.find("technique_common/accessor")
        step = int(accessor.get("stride", "3")) if accessor is not None else 3
        first = int(accessor.get("offset", "0")) if accessor is not None else 0
        if not (3 <= step <= 64 and 0 <= first <= len(numbers)):
            raise ValueError("positions have other than 3 numbers")
        rows = (len(numbers) - first) // step
        return numbers[first : first + rows * step].reshape(rows, step)[:, :3]


def _triangles(part: Element, step: int, offset: int) -> Indices:
    return _corners(part.find("p"), step, offset).reshape(-1, 3)


def _polylist(part: Element, step: int, offset: int) -> Indices:
    corners = _corners(part.find("p"), step, offset)
    counts = _integers(part.find("vcount"))
    if len(counts) and counts.min() < 0:
        raise ValueError("a polygon has fewer than 0 corners")
    if counts.sum() > len(corners):
        raise ValueError("polygons have more corners than there are")
    starts = np.cumsum(counts) - counts
    faces = [np.zeros((0, 3), dtype=np.intp)]
    for count in np.unique(counts[counts >= 3]):  # a fan from each polygon's first corner
        polygons = corners[starts[counts == count][:, None] + np.arange(count)]
        first, second, third = polygons[:, :1], polygons[:, 1:-1], polygons[:, 2:]
        fan = np.stack([np.broadcast_to(first, second.shape), second, third], axis=-1)
        faces.append(fan.reshape(-1, 3))
    return np.concatenate(faces)


def _polygons(part: Element, step: int, offset: int) -> Indices:
    faces = [np.zeros((0, 3), dtype=np.intp)]
    for polygon in part.findall("p"):
        corners = _corners(polygon, step, offset)
        fan = [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
        faces.append(np.array(fan, dtype=np.intp).reshape(-1, 3))
    return np.concatenate(faces)


_READERS: dict[str, Callable[[Element, int, int], Indices]] = {
    "triangles": _triangles,
    "polylist": _polylist,
    "polygons": _polygons,
}


def _corners(p: Element | None, step: int, offset: int) -> Indices:
    return _integers(p).reshape(-1, step)[:, offset]


def _integers(element: Element | None) -> Indices:
    words = _words(element)
    return np.fromiter(map(int, words), np.intp, len(words))


def _numbers(element: Element | None) -> NDArray[np.float64]:
    words = _words(element)
    return np.fromiter(map(float, words), np.float64, len(words))


def _words(element: Element | None) -> list[str]:
    return [] if element is None or element.text is None else element.text.split()


# ---- transformations -------------------------------------------------------------------------


def _pose(node: Element) -> Matrix:
    """Return the transformation of a node, shape (4, 4)."""
    pose = np.eye(4)
    for one in node:
        if one.tag in _STEPS:
            pose = pose @ _STEPS[one.tag](_numbers(one))
    if not np.abs(pose).max() < _FARTHEST:  # nor NaN
        raise ValueError("a node's place is not finite, or far away")
    return pose


def _matrix(numbers: NDArray[np.float64]) -> Matrix:
    return numbers.reshape(4, 4)


def _translate(numbers: NDArray[np.float64]) -> Matrix:
    pose = np.eye(4)
    pose[:3, 3] = numbers
    return pose


def _scale(numbers: NDArray[np.float64]) -> Matrix:
    return np.diag([*numbers.reshape(3), 1.0])


def _rotate(numbers: NDArray[np.float64]) -> Matrix:
    """Return a rotation about an axis by an angle in degrees."""
    x, y, z, angle = numbers.reshape(4).tolist()
    length = math.hypot(x, y, z)
    pose = np.eye(4)
    if length > 0.0:
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / length
        turn = math.radians(angle)
        pose[:3, :3] += math.sin(turn) * K + (1.0 - math.cos(turn)) * K @ K
    return pose


_STEPS: dict[str, Callable[[NDArray[np.float64]], Matrix]] = {
    "matrix": _matrix,
    "translate": _translate,
    "scale": _scale,
    "rotate": _rotate,
}


def _transformed(mesh: Mesh, pose: Matrix) -> Mesh:
    placed = moved(mesh, pose[:3, :3], pose[:3, 3])
    if np.linalg.det(pose[:3, :3]) < 0.0:  # a mirror image keeps its outside out
        return Mesh(placed.vertices, np.ascontiguousarray(placed.faces[:, ::-1]))
    return placed
