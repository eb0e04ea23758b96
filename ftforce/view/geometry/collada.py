"""Triangles from COLLADA files, parsed by pycollada within size limits.

pycollada is called directly rather than through trimesh, which ignores errors in a file and
expands polygons and instances before they could be counted. As in ROS, the file's unit is applied
and its up axis is ignored.
"""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, TypeAlias
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ftforce.errors import FileError, printable
from ftforce.io.xml_text import parse_xml

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from xml.etree.ElementTree import Element

    from collada import Collada
    from collada.geometry import Geometry
    from collada.primitive import Primitive
    from trimesh import Trimesh

    from ftforce.core.arrays import Matrix

Faces: TypeAlias = NDArray[np.int64]

_MAX_NODES = 10_000
_MAX_READ = 1_000_000  # elements of the scene, counting repeated reads by pycollada
_MAX_ENTRY = 1e9  # bound on the entries of a transformation, in the file's unit
_NAMESPACE = "http://www.collada.org/2005/11/COLLADASchema"

_SCENES = ("library_nodes", "library_visual_scenes")
_TRIANGLES = ("triangles", "tristrips", "trifans", "polylist", "polygons")
_TRANSFORMATIONS = ("matrix", "translate", "rotate", "scale")
_READ = {
    "COLLADA": ("library_geometries", *_SCENES, "scene"),
    "mesh": ("source", "vertices", *_TRIANGLES),
    "node": ("node", "instance_node", "instance_geometry", *_TRANSFORMATIONS),
    "instance_geometry": (),
}


def read_collada(text: str, path: Path, max_triangles: int) -> Trimesh:
    """Read the triangles of a COLLADA file.

    Parameters
    ----------
    text, path :
        Content of the file, and its path for error messages.
    max_triangles :
        Maximum number of triangles.

    Raises
    ------
    FileError
        The text is not valid COLLADA, or uses unsupported features.
    """
    root = parse_xml(text, path, FileError)
    if root.tag != "COLLADA":
        raise FileError(path, f"is not a COLLADA file: its root element is <{root.tag}>")
    try:
        metre = _metre(root)
        return _scene(_parsed(root), max_triangles).apply_scale(metre)
    except MemoryError:
        raise
    except Exception as problem:  # pycollada raises all kinds of exceptions on invalid input
        reason = printable(getattr(problem, "msg", problem))[:200]
        raise FileError(path, f"cannot be read as COLLADA ({reason})") from None


def _metre(root: Element) -> float:
    unit = root.find("asset/unit")
    metre = float(unit.get("meter", "1")) if unit is not None else 1.0
    if not (math.isfinite(metre) and metre > 0.0):
        raise ValueError("its unit is not a positive length")
    return metre


def _parsed(root: Element) -> Collada:
    """Parse the geometries and the scene with pycollada.

    All other elements are removed first, so materials, images and cameras can neither cause errors
    nor refer to files. pycollada parses the rewritten document: exactly what was checked.
    """
    from collada import Collada

    for parent in root.iter():
        if parent.tag in _READ:
            parent[:] = [child for child in parent if child.tag in _READ[parent.tag]]
    scene = [
        node.tag for tag in _SCENES for library in root.findall(tag) for node in library.iter()
    ]
    # A node is read again for each node that it references and that is defined later.
    if len(scene) * (1 + scene.count("instance_node")) > _MAX_READ:
        raise ValueError("its scene has too many nodes")
    for rotation in root.iter("rotate"):
        rotation.text = _of_unit_axis(rotation.text or "")
    root.set("xmlns", _NAMESPACE)
    return Collada(io.BytesIO(ElementTree.tostring(root)))


def _of_unit_axis(rotation: str) -> str:
    """Normalize the axis of a rotation: pycollada assumes unit axes."""
    x, y, z, angle = map(float, rotation.split())
    length = math.hypot(x, y, z) or 1.0
    return f"{x / length} {y / length} {z / length} {angle}"


def _scene(file: Collada, maximum: int) -> Trimesh:
    from trimesh.util import concatenate

    done: dict[int, Trimesh] = {}
    meshes, count = [], 0
    for geometry, pose in _instances(file):
        if id(geometry) not in done:
            done[id(geometry)] = _mesh(geometry, maximum)
        mesh = done[id(geometry)]
        count += len(mesh.faces)
        _check_count(count, maximum)
        meshes.append(mesh.copy().apply_transform(pose))
    return concatenate(meshes)


def _instances(file: Collada) -> Iterator[tuple[Geometry, Matrix]]:
    """Yield geometries and their poses."""
    from collada.scene import GeometryNode, Node

    scene = file.scene or next(iter(file.scenes), None)
    if scene is None:  # the file has geometries but no scene
        yield from ((geometry, np.eye(4)) for geometry in file.geometries)
        return
    queue = [(node, np.eye(4)) for node in scene.nodes]
    for _ in range(_MAX_NODES):
        if not queue or len(queue) > _MAX_NODES:
            break
        node, above = queue.pop()
        if isinstance(node, GeometryNode):
            yield node.geometry, above
        elif isinstance(node, Node):
            pose = above @ node.matrix
            if not np.abs(pose).max() < _MAX_ENTRY:  # also rejects NaN
                raise ValueError("the transformation of a node is too large or not finite")
            queue += [(child, pose) for child in node.children]
    if queue:
        raise ValueError("its scene has too many nodes")


def _mesh(geometry: Geometry, maximum: int) -> Trimesh:
    """Return a geometry in its own axes and unit."""
    import trimesh

    meshes, count = [], 0
    for part in geometry.primitives:
        count += _count(part)
        _check_count(count, maximum)
        meshes.append(_triangles(part))
    if not meshes:
        return trimesh.Trimesh()
    vertices, faces = trimesh.util.append_faces(*zip(*meshes, strict=True))
    return trimesh.Trimesh(vertices, faces, process=False)


def _count(part: Primitive) -> int:
    """Return the number of triangles of a part; at least 1, as empty parts take time too."""
    from collada.polylist import Polylist

    if not isinstance(part, Polylist):
        return max(len(part), 1)
    if len(part) and (part.vcounts.min() < 0 or part.nvertices > len(part.index)):
        raise ValueError("polygons have more corners than the file defines")
    return max(int(np.maximum(part.vcounts - 2, 0).sum()), 1)


def _triangles(part: Primitive) -> tuple[Matrix, Faces]:
    """Return the vertices that a part uses, and its triangles."""
    from collada.polylist import Polylist

    triangles = part.triangleset() if isinstance(part, Polylist) else part
    if not len(triangles):
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    used, faces = np.unique(triangles.vertex_index, return_inverse=True)
    if used[0] < 0:  # pycollada checks only the largest index
        raise ValueError("a triangle refers to a vertex that does not exist")
    return triangles.vertex[used], faces.reshape(-1, 3)


def _check_count(count: int, maximum: int) -> None:
    if count > maximum:
        raise ValueError(f"more than {maximum} triangles")
