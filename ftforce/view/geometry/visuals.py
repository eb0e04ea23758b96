"""The ``<visual>`` elements of a URDF, validated.

Invalid visuals do not make a robot unusable: each problem becomes a note, and the remaining
visuals are shown.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import unquote

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import Matrix, read_only
from ftforce.errors import printable
from ftforce.io.text import read_numbers, shortened
from ftforce.robot.formats.urdf import robot_element

if TYPE_CHECKING:
    from collections.abc import Iterator
    from xml.etree.ElementTree import Element

    from ftforce.robot.formats.tree import Numbers

MESH_EXTENSIONS = (".stl", ".dae", ".obj")
_MAX_VISUALS = 5_000  # far more than any robot has
MAX_LENGTH = 1e3  # m; anything larger cannot be part of an arm

_NUMBERS = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "ellipsoid": ("radii",),  # of MJCF files
}
_COUNT = {"size": 3, "radius": 1, "length": 1, "radii": 3}


@dataclass(frozen=True, slots=True, eq=False)
class Visual:
    """One shape of a link.

    Attributes
    ----------
    link :
        Name of the link.
    placement :
        Homogeneous transform from shape to link axes, m, shape (4, 4).
    shape :
        ``box``, ``cylinder``, ``sphere``, ``ellipsoid`` or ``mesh``.
    size :
        Box: x, y, z, m; cylinder: radius and length, m; sphere: radius, m; ellipsoid: radii along
        x, y, z, m; mesh: scale along x, y, z.
    path :
        Mesh file; ``None`` if it was not found, and for other shapes.
    named :
        Mesh file name as given in the URDF; empty for other shapes, and for a mesh of an MJCF file
        that is in no file by itself.
    """

    link: str
    placement: Matrix
    shape: str
    size: Numbers
    path: Path | None = None
    named: str = ""


class Visuals(NamedTuple):
    """The shapes of a URDF, and descriptions of those that could not be read."""

    shapes: tuple[Visual, ...]
    notes: tuple[str, ...]


def read_visuals(path: str | os.PathLike[str], root: Element | None = None) -> Visuals:
    """Read the shapes of a URDF's links.

    Parameters
    ----------
    path :
        The file.
    root :
        Its root element, if it is known or must be generated.

    Raises
    ------
    FileError
        The file cannot be read, or is not a robot description.
    """
    root = robot_element(path).root if root is None else root
    shapes: list[Visual] = []
    notes: list[str] = []
    for link, element in _elements(root):
        if len(shapes) + len(notes) >= _MAX_VISUALS:
            notes.append(f"only the first {_MAX_VISUALS} <visual> elements are shown")
            break
        try:
            shapes.append(_visual(link, element, Path(path)))
        except ValueError as problem:
            notes.append(f"link {printable(link)!r}: a <visual> is not shown: {problem}")
    return Visuals(tuple(shapes), tuple(notes))


def find_mesh(named: str, urdf: Path) -> Path | None:
    """Resolve the name of a mesh in a URDF to a file; ``None`` if there is no such file.

    Parameters
    ----------
    named :
        A path, absolute or relative to the URDF's folder, or a ``file://`` or ``package://`` URL.
        Packages are searched for in all parent folders of the URDF, then in the folders known to
        ROS (``ROS_PACKAGE_PATH``, ``AMENT_PREFIX_PATH``).
    urdf :
        Path of the URDF.

    Raises
    ------
    ValueError
        The name does not refer to a local file, or the file format is not supported.
    """
    scheme, is_url, rest = named.partition("://")
    if is_url and scheme not in {"package", "model", "file"}:
        raise ValueError(f"{shortened(named)} is not a local file; remote files are not fetched")
    local = Path(unquote(rest) if scheme == "file" else rest) if is_url else Path(named)
    if local.suffix.lower() not in MESH_EXTENSIONS:
        raise ValueError(
            f"{shortened(named)}: unknown mesh format; expected {', '.join(MESH_EXTENSIONS)}"
        )
    if "\0" in named:
        raise ValueError(f"{shortened(named)} is not a valid file name")
    if is_url and scheme != "file" and (local.is_absolute() or ".." in local.parts):
        raise ValueError(f"{shortened(named)} is outside its package")
    return next((place for place in _places(local, urdf) if _is_file(place)), None)


def _places(local: Path, urdf: Path) -> Iterator[Path]:
    """Yield candidate locations of a mesh in order of precedence."""
    if local.is_absolute():
        yield local
        return
    folders = Path(os.path.abspath(urdf)).parents  # noqa: PTH100 # resolve() would follow links
    inside = Path(*local.parts[1:])  # without the package name, which may differ from its folder's
    for folder in folders:
        yield folder / local
        if inside.parts:
            yield folder / inside
    for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for entry in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(entry) / below / local


def _is_file(place: Path) -> bool:
    try:
        return place.is_file()
    except OSError:  # for example, the name is too long
        return False


def _elements(root: Element) -> Iterator[tuple[str, Element]]:
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            yield link.get("name", ""), visual


def _visual(link: str, element: Element, urdf: Path) -> Visual:
    """Read one ``<visual>`` element.

    Raises
    ------
    ValueError
        The element is invalid; the message describes the problem.
    """
    geometry = element.find("geometry")
    kinds = [] if geometry is None else [child for child in geometry if child.tag in _SHAPES]
    if not kinds:
        raise ValueError("it has no box, cylinder, sphere or mesh")
    placement, shape = _placement(element.find("origin")), kinds[0]
    if shape.tag == "mesh":
        named = shape.get("filename", "").strip()
        scale = _read(shape.get("scale", "1 1 1"), 3, "scale")
        if not shape.attrib:
            return Visual(link, placement, "mesh", scale)
        return Visual(link, placement, "mesh", scale, find_mesh(named, urdf), named)
    size = _sizes(shape)
    return Visual(link, placement, shape.tag, size)


_SHAPES = (*_NUMBERS, "mesh")


def _sizes(shape: Element) -> Numbers:
    size: Numbers = ()
    for key in _NUMBERS[shape.tag]:
        size += _read(shape.get(key, ""), _COUNT[key], key)
    if min(size) <= 0.0:
        raise ValueError(f"the dimensions of a {shape.tag} must be positive")
    return size


def _placement(origin: Element | None) -> Matrix:
    placement = np.eye(4)
    if origin is not None:
        placement[:3, :3] = pin.rpy.rpyToMatrix(*_read(origin.get("rpy", "0 0 0"), 3, "origin rpy"))
        placement[:3, 3] = _read(origin.get("xyz", "0 0 0"), 3, "origin xyz")
    return read_only(placement)


def _read(text: str, count: int, what: str) -> Numbers:
    try:
        return read_numbers(text, count, MAX_LENGTH)
    except ValueError as problem:
        raise ValueError(f"{what} {problem}") from None
