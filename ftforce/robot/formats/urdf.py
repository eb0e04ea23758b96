"""Reading of a URDF file into a checked `ftforce.robot.formats.tree.UrdfTree`."""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeAlias, TypeVar
from xml.etree import ElementTree

from ftforce.errors import InputError, URDFError, listed, printable
from ftforce.io.text import LARGEST_NUMBER, check_name, read_numbers
from ftforce.io.xml_text import XmlFile, read_xml
from ftforce.robot.formats.converted import Converted
from ftforce.robot.formats.held import interpret_limits
from ftforce.robot.formats.tree import (
    JOINT_TYPES,
    LIMITED,
    MOMENTS,
    MOVING,
    Flaw,
    Mimic,
    UrdfJoint,
    UrdfLink,
    build_tree,
    did_you_mean,
)
from ftforce.robot.formats.xacro import PLAIN, XacroOptions, expand, is_xacro

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from os import PathLike
    from xml.etree.ElementTree import Element

    from ftforce.robot.formats.tree import Numbers, UrdfTree

MAX_LINKS = 5_000  # far more than any robot has; Pinocchio takes a second for them
_SHORTEST_AXIS = 1e-6  # shorter axes are zero up to rounding error
_SMALLEST_STEP = 1e-50  # of an origin, m or rad; with smaller lever arms, forces overflow
_SMALLEST_MOMENT = 1e-12  # kg·m², 1 mg at 1 mm; smaller negative moments are rounding error

_DIAGONAL = frozenset({"ixx", "iyy", "izz"})
_ZERO3: Numbers = (0.0, 0.0, 0.0)
_X: Numbers = (1.0, 0.0, 0.0)  # default axis of the URDF format
_ONLY_MACROS = (
    "expands to no <link>: it may only define macros; give the file that uses them, often "
    "NAME.urdf.xacro"
)
_NEVER_EVALUATED = (
    "contains xacro that is not expanded, and a .urdf is never evaluated; a xacro file needs a "
    "name that ends in .xacro"
)
_DEFINITIONS = frozenset({"property", "arg", "macro"})  # xacro elements that add no parts
_Body: TypeAlias = "tuple[float | None, Numbers, Numbers, Numbers]"
_NO_BODY: _Body = (None, _ZERO3, _ZERO3, _ZERO3 + _ZERO3)
_Named = TypeVar("_Named", UrdfLink, UrdfJoint)
_Part = TypeVar("_Part")
_Given = ParamSpec("_Given")


def read_urdf(path: str | PathLike[str], options: XacroOptions = PLAIN) -> UrdfTree:
    """Read and check a URDF, or that of a DH table or a xacro file.

    Flaws of single links and joints are recorded in the tree, with stand-ins for what is
    malformed: whether they matter depends on the chain.

    Parameters
    ----------
    path :
        The file.
    options :
        What a xacro file needs besides itself.

    Raises
    ------
    FileError
        The file cannot be read, is none of these, or does not describe a tree of links and joints.
    """
    return tree_of(_converted(path, options), path)


def tree_of(source: Converted, path: str | PathLike[str]) -> UrdfTree:
    """Return the tree that the root element of a URDF describes.

    Parameters
    ----------
    source :
        The root element, and what is known besides.
    path :
        Path of the file.

    Raises
    ------
    URDFError
        It does not describe a tree of links and joints.
    """
    reader, root = _Reader(str(path)), source.root
    elements, moved = root.findall("link"), root.findall("joint")
    if not elements:
        raise reader.error("contains no <link>")
    for kind, count in (("links", len(elements)), ("joints", len(moved))):
        if count > MAX_LINKS:
            raise reader.error(f"contains {count} {kind}; at most {MAX_LINKS} are supported")
    reader.actuators(root.findall("transmission"))
    links = reader.unique([reader.link(e) for e in elements], "link")
    joints = reader.unique([reader.joint(e) for e in moved], "joint")
    name = root.get("name", "").strip() or Path(path).stem
    label = "".join(letter if letter.isprintable() else "?" for letter in name)
    tree = build_tree(
        str(path),
        label,
        links,
        joints,
        flaws=(*source.flaws, *reader.flaws),
        notes=(*source.notes, *reader.notes),
    )
    own = {key: getattr(source, key) for key in ("states", "gravity", "incomplete")}
    return interpret_limits(replace(tree, **own))


def is_dh_table(path: object) -> bool:
    """Return whether a path is that of a DH table, by its extension, ``.toml``."""
    return isinstance(path, (str, os.PathLike)) and Path(path).suffix.lower() == ".toml"


def robot_element(path: str | PathLike[str], options: XacroOptions = PLAIN) -> XmlFile:
    """Return the root element of a URDF, ``<robot>``, and remarks on the file.

    That of a DH table (.toml) or an MJCF file is generated, a xacro file (.xacro) is expanded.

    Parameters
    ----------
    path :
        The file.
    options :
        What a xacro file needs besides itself.

    Raises
    ------
    FileError
        The file cannot be read, or is none of these.
    InputError
        There are options, but the file is not a xacro file.
    """
    found = _converted(path, options)
    return XmlFile(found.root, found.notes)


def _converted(path: str | PathLike[str], options: XacroOptions) -> Converted:
    """Return the URDF of a file of any format."""
    if is_xacro(path):
        root, notes = expand(path, options)
        if root.tag == "robot" and root.find("link") is None:
            raise URDFError(path, _ONLY_MACROS)
        return Converted(_checked_root(root, path), notes)
    if is_dh_table(path):
        _refuse_options(path, options)
        from ftforce.robot.formats.dh import read_dh_table  # not needed for a URDF
        from ftforce.robot.formats.dh_to_urdf import to_urdf

        return Converted(ElementTree.fromstring(to_urdf(read_dh_table(path))))
    root, notes = read_xml(path, URDFError, "a URDF")
    if root.tag == "mujoco":
        from ftforce.robot.formats import mjcf  # not needed for a URDF

        if options.args:
            raise InputError(f"{printable(path)} is an MJCF file: it takes no arguments")
        return mjcf.convert(root, path, options.packages)
    _refuse_options(path, options)
    generators, leftovers, has_expressions = _xacro_parts(root)
    is_unused = leftovers and not has_expressions and root.find("link") is not None
    if generators or (leftovers and not is_unused):
        raise URDFError(path, _NEVER_EVALUATED)
    if leftovers:
        names = listed(f"<xacro:{name}>" for name in sorted(leftovers))
        notes = (*notes, f"remains of xacro are ignored: {names}")
    return Converted(_checked_root(root, path), notes)


def _refuse_options(path: str | PathLike[str], options: XacroOptions) -> None:
    if options != PLAIN:
        raise InputError(
            f"{printable(path)} is not a xacro file (*.xacro), so it takes neither arguments nor a "
            "package path"
        )


def _checked_root(root: Element, path: str | PathLike[str]) -> Element:
    if root.tag != "robot":
        raise URDFError(path, f"is not a URDF: its root element is <{root.tag}>, not <robot>")
    return root


def _xacro_parts(root: Element) -> tuple[set[str], set[str], bool]:
    """Return the xacro elements that add parts, those that do not, and whether ``${`` is used.

    Only what can add to links and joints counts, not e.g. what stands in ``<gazebo>``.
    """
    names: set[str] = set()
    has_expressions = False
    any_xacro = any(map(_xacro_name, {element.tag for element in root.iter()}))
    waiting = [root] if any_xacro else []  # most files have none
    while waiting:
        parent = waiting.pop()
        for element in parent:
            if name := _xacro_name(element.tag):
                names.add(name)  # what is defined within is unused if nothing calls it
            elif parent is not root or element.tag in {"link", "joint"}:
                has_expressions |= any("${" in x or "$(" in x for x in element.attrib.values())
                waiting.append(element)
    return names - _DEFINITIONS, names & _DEFINITIONS, has_expressions


def _xacro_name(tag: str) -> str:
    """Return the name of a xacro element without its prefix; empty for other elements."""
    space, _, name = tag[1:].rpartition("}") if tag.startswith("{") else tag.rpartition(":")
    return name if "xacro" in space else ""


class _Reader:
    """Converts XML elements to links and joints; errors carry the path of the file.

    What is malformed in a link or joint becomes a flaw and is replaced by a stand-in.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.flaws: list[Flaw] = []
        self.notes: list[str] = []
        self.rotors: dict[str, float] = {}  # rotor inertia reflected to the joint, by its name

    def error(self, reason: str) -> URDFError:
        return URDFError(self.path, reason)

    def unique(self, things: list[_Named], kind: str) -> dict[str, _Named]:
        by_name = {thing.name: thing for thing in things}
        if len(by_name) < len(things):
            counts = Counter(thing.name for thing in things)
            twice = next(name for name in by_name if counts[name] > 1)
            raise self.error(f"two {kind}s are named {twice!r}; names must be unique")
        return by_name

    def part(
        self,
        flaw: Flaw,
        stand_in: _Part,
        read: Callable[_Given, _Part],
        *given: _Given.args,
        **named: _Given.kwargs,
    ) -> _Part:
        """Return what ``read`` returns; where that is malformed, note the flaw, with a stand-in."""
        try:
            return read(*given, **named)
        except URDFError as error:
            self.flaws.append(flaw._replace(reason=error.reason))
            return stand_in

    def link(self, element: Element) -> UrdfLink:
        name = self.name(element, "link")
        inertial = element.find("inertial")
        if inertial is None:
            return UrdfLink(name, *_NO_BODY)
        flaw = Flaw("link", name, "")
        return UrdfLink(name, *self.part(flaw, _NO_BODY, self.body, inertial, f"link {name!r}"))

    def body(self, inertial: Element, where: str) -> _Body:
        mass = self.number(inertial.find("mass"), "value", f"{where}: mass")
        if mass is not None and mass < 0.0:
            raise self.error(f"{where}: mass {mass:g} kg is negative; it must be 0 or more")
        moments = self.moments(inertial.find("inertia"), where)
        return mass, *self.origin(inertial, where), moments

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
        parent, child = (self.reference(element, role, where) for role in ("parent", "child"))
        limit, flaw = element.find("limit"), Flaw("joint", name, "")
        kind = self.part(flaw._replace(hides_motion=True), "fixed", self.kind, element, where)
        xyz, rpy = self.part(flaw, (_ZERO3, _ZERO3), self.origin, element, where)
        axis = self.part(flaw, _X, self.axis, element, kind, where)
        lower, upper = self.part(flaw, (None, None), self.bounds, limit, kind, where)
        effort, velocity = self.part(flaw, (None, None), self.largest, limit, where)
        friction = self.part(flaw, None, self.friction, element, where)
        damping, armature = (
            self.optional(element.find("dynamics"), key, f"{where}: {key}")
            for key in ("damping", "armature")  # the latter is no standard
        )
        mimic = self.part(flaw, None, self.mimic, element, kind, where)
        limits = (lower, upper, effort, velocity)
        return UrdfJoint(
            name,
            kind,
            parent,
            child,
            xyz,
            rpy,
            axis,
            *limits,
            friction,
            mimic,
            damping,
            self.rotors.get(name) if armature is None else armature,
        )

    def kind(self, element: Element, where: str) -> str:
        kind = element.get("type", "")
        if kind not in JOINT_TYPES:
            hint = did_you_mean(kind, JOINT_TYPES)
            available = listed(JOINT_TYPES)
            raise self.error(f"{where}: unknown type {kind!r}; available: {available}{hint}")
        return kind

    def name(self, element: Element, kind: str) -> str:
        name = element.get("name", "")
        if not name.strip():
            raise self.error(f"a <{kind}> has no name")
        try:
            check_name(name, kind)
        except ValueError as problem:
            raise self.error(str(problem)) from None
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
            return _X
        axis = self.numbers(found.get("xyz", "1 0 0"), 3, f"{where}: axis")
        length = math.hypot(*axis)
        if length < _SHORTEST_AXIS:
            if kind in MOVING or kind == "planar":
                raise self.error(f"{where}: its axis is zero; give a direction, e.g. 0 0 1")
            return _X  # the axis of a fixed joint is irrelevant
        return axis if length == 1.0 else tuple(x / length for x in axis)

    def bounds(
        self, limit: Element | None, kind: str, where: str
    ) -> tuple[float, float] | tuple[None, None]:
        if kind not in LIMITED:
            return None, None
        if limit is None:
            other = " (or type continuous)" if kind == "revolute" else ""
            raise self.error(f'{where}: a {kind} joint needs <limit lower="…" upper="…"/>{other}')
        if limit.get("lower") is None and limit.get("upper") is None:
            return None, None  # by the URDF format 0 and 0, by which nothing could move
        # In the URDF format, a missing bound defaults to 0.
        lower, upper = (
            self.number(limit, key, f"{where}: limit {key}", None) or 0.0
            for key in ("lower", "upper")
        )
        if lower > upper:
            missing = any(limit.get(key) is None for key in ("lower", "upper"))
            hint = " (a missing limit defaults to 0)" if missing else ""
            raise self.error(f"{where}: lower limit {lower:g} exceeds upper limit {upper:g}{hint}")
        return lower, upper

    def largest(self, limit: Element | None, where: str) -> tuple[float | None, float | None]:
        return (
            self.number(limit, "effort", f"{where}: limit effort", None),
            self.number(limit, "velocity", f"{where}: limit velocity", None),
        )

    def friction(self, element: Element, where: str) -> float | None:
        return self.number(element.find("dynamics"), "friction", f"{where}: friction", None)

    def optional(self, element: Element | None, key: str, what: str) -> float | None:
        """Return a number that counts on request only; where it is malformed, a note says so."""
        try:
            return self.number(element, key, what, None)
        except URDFError as error:
            self.notes.append(f"{error.reason}; it counts as unknown")
            return None

    def actuators(self, transmissions: Iterable[Element]) -> None:
        """Read the rotor inertias that Drake keeps in transmissions, reflected by the gear."""
        for element in transmissions:
            joint, actuator = element.find("joint"), element.find("actuator")
            if joint is None or actuator is None:
                continue
            name, values = joint.get("name", ""), dict[str, float | None]()
            for part in actuator:
                key = part.tag.rpartition("}")[2].removeprefix("drake:")
                if key in {"rotor_inertia", "gear_ratio"}:
                    values[key] = self.optional(part, "value", f"joint {name!r}: {key}")
            if (inertia := values.get("rotor_inertia")) is not None:
                gear = values.get("gear_ratio")
                self.rotors[name] = inertia * (1.0 if gear is None else gear) ** 2

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
        self,
        element: Element | None,
        key: str,
        what: str,
        largest: float | None = LARGEST_NUMBER,
    ) -> float | None:
        text = element.get(key) if element is not None else None
        return None if text is None else self.numbers(text, 1, what, largest)[0]

    def numbers(
        self, text: str, count: int, what: str, largest: float | None = LARGEST_NUMBER
    ) -> Numbers:
        try:
            return read_numbers(text, count, largest)
        except ValueError as problem:
            hint = " (contains an unexpanded xacro expression)" if "$" in text else ""
            raise self.error(f"{what} {problem}{hint}") from None


def _without_traces(numbers: Numbers) -> Numbers:
    return tuple(x if abs(x) >= _SMALLEST_STEP else 0.0 * x for x in numbers)  # signed zeros
