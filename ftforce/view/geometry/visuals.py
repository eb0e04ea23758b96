"""What a URDF says its links look like: the ``<visual>`` elements, checked.

A robot's look is no reason to refuse it. What is wrong with a visual becomes a note, and the rest
is shown.
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
from ftforce.errors import URDFError, printable
from ftforce.io.text import parse_xml, read_numbers, read_text, shortened

if TYPE_CHECKING:
    from collections.abc import Iterator
    from xml.etree.ElementTree import Element

    from ftforce.robot.formats.tree import Numbers

MESH_ENDINGS = (".stl", ".dae", ".obj")
MOST_VISUALS = 5_000  # far above any robot
LARGEST_LENGTH = 1e3  # m; what is larger is no part of an arm

_NUMBERS = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}
_COUNT = {"size": 3, "radius": 1, "length": 1}


@dataclass(frozen=True, slots=True, eq=False)
class Visual:
    """One shape of a link.

    Attributes
    ----------
    link :
        The link's name.
    placement :
        From the shape's axes to the link's, homogeneous, m, shape (4, 4).
    shape :
        ``box``, ``cylinder``, ``sphere`` or ``mesh``.
    size :
        Of a box: x, y, z, m; of a cylinder: radius and length, m; of a sphere: radius, m; of a
        mesh: its scale along x, y, z.
    path :
        The file of a mesh; ``None`` if it was not found, and for other shapes.
    named :
        What the URDF calls that file; empty for other shapes.
    """

    link: str
    placement: Matrix
    shape: str
    size: Numbers
    path: Path | None = None
    named: str = ""


class Visuals(NamedTuple):
    """The shapes of a URDF, and what could not be read of them, in words."""

    shapes: tuple[Visual, ...]
    notes: tuple[str, ...]


def read_visuals(path: str | os.PathLike[str]) -> Visuals:
    """Read the shapes of a URDF's links.

    Raises
    ------
    URDFError
        The file cannot be read or is no XML.
    """
    root = parse_xml(read_text(path, URDFError, "a URDF"), path, URDFError)
    shapes: list[Visual] = []
    notes: list[str] = []
    for link, element in _elements(root):
        if len(shapes) + len(notes) >= MOST_VISUALS:
            notes.append(f"only the first {MOST_VISUALS} <visual> elements are shown")
            break
        try:
            shapes.append(_visual(link, element, Path(path)))
        except ValueError as problem:
            notes.append(f"link {printable(link)!r}: a <visual> is not shown: {problem}")
    return Visuals(tuple(shapes), tuple(notes))


def find_mesh(named: str, urdf: Path) -> Path | None:
    """Return the file that a URDF calls by a name; ``None`` if there is none.

    Parameters
    ----------
    named :
        A path, from the URDF's folder or absolute, or one that begins with ``file://`` or
        ``package://``. Packages are looked for in every folder above the URDF, then where ROS
        keeps them (``ROS_PACKAGE_PATH``, ``AMENT_PREFIX_PATH``).
    urdf :
        The URDF.

    Raises
    ------
    ValueError
        It is no local file, or none of a kind that can be read.
    """
    scheme, is_url, rest = named.partition("://")
    if is_url and scheme not in {"package", "model", "file"}:
        raise ValueError(f"{shortened(named)} is no local file; nothing is fetched for it")
    local = Path(unquote(rest) if scheme == "file" else rest) if is_url else Path(named)
    if local.suffix.lower() not in MESH_ENDINGS:
        raise ValueError(f"{shortened(named)}: meshes end in {', '.join(MESH_ENDINGS)}")
    if "\0" in named:
        raise ValueError(f"{shortened(named)} is no file name")
    if is_url and scheme != "file" and (local.is_absolute() or ".." in local.parts):
        raise ValueError(f"{shortened(named)} leads out of its package")
    return next((place for place in _places(local, urdf) if _is_file(place)), None)


def _places(local: Path, urdf: Path) -> Iterator[Path]:
    """Yield where a mesh could be; the first that exists counts."""
    if local.is_absolute():
        yield local
        return
    folders = Path(os.path.abspath(urdf)).parents  # noqa: PTH100 # resolve() would follow links
    inside = Path(*local.parts[1:])  # without the package: its folder may have another name
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
    except OSError:  # a name that is too long
        return False


def _elements(root: Element) -> Iterator[tuple[str, Element]]:
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            yield link.get("name", ""), visual


def _visual(link: str, element: Element, urdf: Path) -> Visual:
    """Return a shape.

    Raises
    ------
    ValueError
        With what is wrong with it.
    """
    geometry = element.find("geometry")
    kinds = [] if geometry is None else [child for child in geometry if child.tag in _SHAPES]
    if not kinds:
        raise ValueError(f"it has no {', '.join(_SHAPES[:-1])} or {_SHAPES[-1]}")
    placement, shape = _placement(element.find("origin")), kinds[0]
    if shape.tag == "mesh":
        named = shape.get("filename", "").strip()
        scale = _read(shape.get("scale", "1 1 1"), 3, "scale")
        return Visual(link, placement, "mesh", scale, find_mesh(named, urdf), named)
    size = _sizes(shape)
    return Visual(link, placement, shape.tag, size)


_SHAPES = (*_NUMBERS, "mesh")


def _sizes(shape: Element) -> Numbers:
    size: Numbers = ()
    for key in _NUMBERS[shape.tag]:
        size += _read(shape.get(key, ""), _COUNT[key], key)
    if min(size) <= 0.0:
        raise ValueError(f"the {shape.tag} has no size")
    return size


def _placement(origin: Element | None) -> Matrix:
    placement = np.eye(4)
    if origin is not None:
        placement[:3, :3] = pin.rpy.rpyToMatrix(*_read(origin.get("rpy", "0 0 0"), 3, "origin rpy"))
        placement[:3, 3] = _read(origin.get("xyz", "0 0 0"), 3, "origin xyz")
    return read_only(placement)


def _read(text: str, count: int, what: str) -> Numbers:
    try:
        return read_numbers(text, count, LARGEST_LENGTH)
    except ValueError as problem:
        raise ValueError(f"{what} {problem}") from None
