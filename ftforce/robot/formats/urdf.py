"""Reading of a URDF file into a checked `ftforce.robot.formats.tree.UrdfTree`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ftforce.errors import URDFError, listed
from ftforce.io.text import LARGEST_NUMBER, parse_xml, read_numbers, read_text
from ftforce.robot.formats.tree import (
    JOINT_TYPES,
    MOMENTS,
    MOVING,
    Mimic,
    UrdfJoint,
    UrdfLink,
    build_tree,
    did_you_mean,
)

if TYPE_CHECKING:
    from os import PathLike
    from xml.etree.ElementTree import Element

    from ftforce.robot.formats.tree import Numbers, UrdfTree

MAX_LINKS = 5_000  # far more than any robot has; Pinocchio takes a second for them
_SHORTEST_AXIS = 1e-6  # shorter axes are zero up to rounding error
_SMALLEST_STEP = 1e-50  # of an origin, m or rad; with smaller lever arms, forces overflow
_SMALLEST_MOMENT = 1e-12  # kg·m², 1 mg at 1 mm; smaller negative moments are rounding error

_DIAGONAL = frozenset({"ixx", "iyy", "izz"})
_ZERO3 = (0.0, 0.0, 0.0)
_LIMITED = frozenset({"revolute", "prismatic"})
_Named = TypeVar("_Named", UrdfLink, UrdfJoint)


def read_urdf(path: str | PathLike[str]) -> UrdfTree:
    """Read and check a URDF.

    Raises
    ------
    URDFError
        The file cannot be read, is not a URDF, or does not describe a tree of links and joints.
    """
    root = _robot_element(path)
    reader = _Reader(str(path))
    elements = root.findall("link")
    if not elements:
        raise reader.error("contains no <link>")
    if len(elements) > MAX_LINKS:
        raise reader.error(f"contains {len(elements)} links; at most {MAX_LINKS} are supported")
    links = reader.unique([reader.link(e) for e in elements], "link")
    joints = reader.unique([reader.joint(e) for e in root.findall("joint")], "joint")
    name = root.get("name", "").strip() or Path(path).stem
    label = "".join(letter if letter.isprintable() else "?" for letter in name)
    return build_tree(str(path), label, links, joints)


def _robot_element(path: str | PathLike[str]) -> Element:
    text = read_text(path, URDFError, "a URDF")
    convert = "`xacro FILE.xacro > FILE.urdf` (pip install xacro, or any ROS installation)"
    xacro = URDFError(path, f"is a xacro file; convert it to URDF first: {convert}")
    try:
        root = parse_xml(text, path, URDFError)
    except URDFError as problem:
        if "unbound prefix" in problem.reason and "<xacro:" in text:
            raise xacro from None
        raise
    if str(path).endswith(".xacro") or any(map(_is_xacro, root.iter())):
        raise xacro
    if root.tag != "robot":
        raise URDFError(path, f"is not a URDF: its root element is <{root.tag}>, not <robot>")
    return root


def _is_xacro(element: Element) -> bool:
    tag = element.tag
    return isinstance(tag, str) and tag.startswith("{") and "xacro" in tag[: tag.index("}")]


class _Reader:
    """Converts XML elements to links and joints; errors carry the path of the file."""

    def __init__(self, path: str) -> None:
        self.path = path

    def error(self, reason: str) -> URDFError:
        return URDFError(self.path, reason)

    def unique(self, things: list[_Named], kind: str) -> dict[str, _Named]:
        by_name = {thing.name: thing for thing in things}
        if len(by_name) < len(things):
            names = [thing.name for thing in things]
            twice = next(name for name in by_name if names.count(name) > 1)
            raise self.error(f"two {kind}s are named {twice!r}; names must be unique")
        return by_name

    def link(self, element: Element) -> UrdfLink:
        name = self.name(element, "link")
        where = f"link {name!r}"
        inertial = element.find("inertial")
        if inertial is None:
            return UrdfLink(name, None, _ZERO3, _ZERO3, _ZERO3 + _ZERO3)
        mass = self.number(inertial.find("mass"), "value", f"{where}: mass")
        if mass is not None and mass < 0.0:
            raise self.error(f"{where}: mass {mass:g} kg is negative; it must be 0 or more")
        moments = self.moments(inertial.find("inertia"), where)
        return UrdfLink(name, mass, *self.origin(inertial, where), moments)

    def moments(self, matrix: Element | None, where: str) -> Numbers:
        values = [self.number(matrix, key, f"{where}: inertia {key}") or 0.0 for key in MOMENTS]
        for key, value in zip(MOMENTS, values, strict=True):
            if key in _DIAGONAL and value < -_SMALLEST_MOMENT:
                what = f"{where}: inertia {key} {value:g} kg·m²"
                raise self.error(f"{what} is negative; it must be 0 or more")
        return tuple(values)

    def joint(self, element: Element) -> UrdfJoint:
        name = self.name(element, "joint")
        where = f"joint {name!r}"
        kind = element.get("type", "")
        if kind not in JOINT_TYPES:
            hint = did_you_mean(kind, JOINT_TYPES)
            raise self.error(
                f"{where}: unknown type {kind!r}; available: {listed(JOINT_TYPES)}{hint}"
            )
        parent, child = (self.reference(element, role, where) for role in ("parent", "child"))
        lower, upper = self.bounds(element.find("limit"), kind, where)
        effort, velocity = (
            self.largest(element.find("limit"), key, where) for key in ("effort", "velocity")
        )
        xyz, rpy = self.origin(element, where)
        axis, mimic = self.axis(element, kind, where), self.mimic(element, kind, where)
        return UrdfJoint(
            name, kind, parent, child, xyz, rpy, axis, lower, upper, effort, velocity, mimic
        )

    def name(self, element: Element, kind: str) -> str:
        name = element.get("name", "")
        if not name.strip():
            raise self.error(f"a <{kind}> has no name")
        if not name.isprintable():  # e.g. a line break or a terminal control sequence
            raise self.error(f"the {kind} name {name!r} contains unprintable characters")
        return name

    def reference(self, element: Element, role: str, where: str) -> str:
        found = element.find(role)
        link = found.get("link", "") if found is not None else ""
        if not link:
            raise self.error(f'{where}: <{role} link="…"/> is missing')
        return link

    def origin(self, element: Element, where: str) -> tuple[Numbers, Numbers]:
        found = element.find("origin")
        if found is None:
            return _ZERO3, _ZERO3
        xyz, rpy = (
            self.numbers(found.get(key, "0 0 0"), 3, f"{where}: origin {key}")
            for key in ("xyz", "rpy")
        )
        return _without_traces(xyz), _without_traces(rpy)

    def axis(self, element: Element, kind: str, where: str) -> Numbers:
        found = element.find("axis")
        if found is None:
            return (1.0, 0.0, 0.0)  # default of the URDF format
        axis = self.numbers(found.get("xyz", "1 0 0"), 3, f"{where}: axis")
        length = math.hypot(*axis)
        if length < _SHORTEST_AXIS:
            if kind in MOVING or kind == "planar":
                raise self.error(f"{where}: its axis is zero; give a direction, e.g. 0 0 1")
            return (1.0, 0.0, 0.0)  # the axis of a fixed joint is irrelevant
        return axis if length == 1.0 else tuple(x / length for x in axis)

    def bounds(
        self, limit: Element | None, kind: str, where: str
    ) -> tuple[float, float] | tuple[None, None]:
        if kind not in _LIMITED:
            return None, None
        if limit is None:
            other = " (or type continuous)" if kind == "revolute" else ""
            raise self.error(f'{where}: a {kind} joint needs <limit lower="…" upper="…"/>{other}')
        # In the URDF format, a missing bound defaults to 0.
        lower, upper = (
            self.number(limit, key, f"{where}: limit {key}", math.inf) or 0.0
            for key in ("lower", "upper")
        )
        if lower > upper:
            missing = any(limit.get(key) is None for key in ("lower", "upper"))
            hint = " (a missing limit defaults to 0)" if missing else ""
            raise self.error(f"{where}: lower limit {lower:g} exceeds upper limit {upper:g}{hint}")
        return lower, upper

    def largest(self, limit: Element | None, key: str, where: str) -> float | None:
        value = self.number(limit, key, f"{where}: limit {key}", math.inf)
        if value is not None and value < 0.0:
            raise self.error(f"{where}: {key} limit {value:g} is negative; 0 means unknown")
        return value

    def mimic(self, element: Element, kind: str, where: str) -> Mimic | None:
        found = element.find("mimic")
        if found is None or kind not in MOVING:
            return None
        leader = found.get("joint", "")
        if not leader:
            raise self.error(f'{where}: <mimic joint="…"/> is missing its joint')
        factor = self.number(found, "multiplier", f"{where}: mimic multiplier")
        offset = self.number(found, "offset", f"{where}: mimic offset")
        return Mimic(leader, 1.0 if factor is None else factor, offset or 0.0)

    def number(
        self, element: Element | None, key: str, what: str, largest: float = LARGEST_NUMBER
    ) -> float | None:
        text = element.get(key) if element is not None else None
        return None if text is None else self.numbers(text, 1, what, largest)[0]

    def numbers(self, text: str, count: int, what: str, largest: float = LARGEST_NUMBER) -> Numbers:
        try:
            return read_numbers(text, count, largest)
        except ValueError as problem:
            hint = " (contains an unexpanded xacro expression)" if "$" in text else ""
            raise self.error(f"{what} {problem}{hint}") from None


def _without_traces(numbers: Numbers) -> Numbers:
    return tuple(x if abs(x) >= _SMALLEST_STEP else 0.0 * x for x in numbers)  # signed zeros
