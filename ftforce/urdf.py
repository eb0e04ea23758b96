"""A URDF as a checked tree of links and joints.

Pinocchio's parser (urdfdom) accepts much that is wrong in silence, prints the rest on stderr and
can recurse without end. So the file is read here first, every number and every link is checked, and
Pinocchio is given a URDF written anew from what was checked, without geometry: meshes are never
needed, and both sides see the same numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from ftforce.errors import URDFError, closest, listed
from ftforce.source import parse_xml, read_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from os import PathLike
    from xml.etree.ElementTree import Element

MOVING = frozenset({"revolute", "continuous", "prismatic"})
HELD = frozenset({"floating", "planar"})  # held fixed: they have no single motor that could fail
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOST_LINKS = 5_000  # Pinocchio recurses along the tree; far above any robot, far below its stack
XACRO = (
    "{http://www.ros.org/wiki/xacro}",
    "{http://wiki.ros.org/xacro}",
    "{http://ros.org/wiki/xacro}",
)

Numbers: TypeAlias = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Mimic:
    """``q_follower = multiplier · q_leader + offset``."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """One joint as the URDF states it (rad, m, N·m or N; ``None`` where it states nothing)."""

    name: str
    type: str
    parent: str
    child: str
    xyz: Numbers
    rpy: Numbers
    axis: Numbers
    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None
    mimic: Mimic | None


@dataclass(frozen=True, slots=True)
class UrdfLink:
    """One link; ``inertia`` is ixx, ixy, ixz, iyy, iyz, izz in kg·m² about the centre of mass."""

    name: str
    mass: float | None
    xyz: Numbers
    rpy: Numbers
    inertia: Numbers


_Named = TypeVar("_Named", UrdfLink, UrdfJoint)


@dataclass(frozen=True, slots=True)
class UrdfTree:
    """A URDF whose numbers are finite and whose joints form one tree.

    Attributes
    ----------
    path, name :
        The file and the robot's name.
    links, joints :
        By name, in the order of the file.
    root :
        The link that is no joint's child.
    """

    path: str
    name: str
    links: Mapping[str, UrdfLink]
    joints: Mapping[str, UrdfJoint]
    root: str
    parent_joint: Mapping[str, UrdfJoint]
    child_joints: Mapping[str, tuple[UrdfJoint, ...]]

    def path_to(self, link: str) -> tuple[UrdfJoint, ...]:
        """Return the joints from the root to ``link``."""
        joints: list[UrdfJoint] = []
        while (joint := self.parent_joint.get(link)) is not None:
            joints.append(joint)
            link = joint.parent
        return tuple(reversed(joints))

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Yield the joints of the subtree that hangs on ``link``, parents first."""
        waiting = [link]
        while waiting:
            for joint in self.child_joints[waiting.pop()]:
                yield joint
                waiting.append(joint.child)

    def to_xml(self) -> str:
        """Write the tree as a URDF without geometry, with every number in full precision."""
        body = "".join(map(_link_xml, self.links.values()))
        body += "".join(map(_joint_xml, self.joints.values()))
        return f"<robot name={_quoted(self.name)}>{body}</robot>"


def read_urdf(path: str | PathLike[str]) -> UrdfTree:
    """Read and check a URDF.

    Raises
    ------
    URDFError
        The file cannot be read, is not a URDF, or describes no tree of links and joints.
    """
    root = parse_xml(read_text(path, URDFError, "a URDF"), path, URDFError)
    _refuse_other_formats(root, path)
    reader = _Reader(str(path))
    links = reader.unique([reader.link(e) for e in root.findall("link")], "link")
    joints = reader.unique([reader.joint(e) for e in root.findall("joint")], "joint")
    if not links:
        raise reader.error("holds no <link>")
    if len(links) > MOST_LINKS:
        raise reader.error(f"holds {len(links)} links; at most {MOST_LINKS} are read")
    name = root.get("name", "").strip() or Path(path).stem
    return _tree(reader, name, links, joints)


def _refuse_other_formats(root: Element, path: str | PathLike[str]) -> None:
    has_xacro = any(isinstance(e.tag, str) and e.tag.startswith(XACRO) for e in root.iter())
    if has_xacro or str(path).endswith(".xacro"):
        convert = "`xacro FILE.xacro > FILE.urdf` (pip install xacro, or any ROS installation)"
        raise URDFError(path, f"is xacro, a macro language; turn it into a URDF first: {convert}")
    if root.tag != "robot":
        raise URDFError(path, f"is no URDF: its root element is <{root.tag}>, not <robot>")


def _tree(
    reader: _Reader, name: str, links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]
) -> UrdfTree:
    parent_joint: dict[str, UrdfJoint] = {}
    children: dict[str, list[UrdfJoint]] = {link: [] for link in links}
    for joint in joints.values():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                hint = f"; did you mean {close!r}?" if (close := closest(link, links)) else ""
                raise reader.error(
                    f"joint {joint.name!r}: its {role} link {link!r} does not exist{hint}"
                )
        if (other := parent_joint.get(joint.child)) is not None:
            raise reader.error(
                f"link {joint.child!r} hangs on two joints, {other.name!r} and {joint.name!r}; "
                "a URDF is a tree and cannot hold closed loops"
            )
        parent_joint[joint.child] = joint
        children[joint.parent].append(joint)
    reader.check_mimics(joints)
    tree = UrdfTree(
        path=reader.path,
        name=name,
        links=MappingProxyType(links),
        joints=MappingProxyType(joints),
        root=reader.root(links, parent_joint),
        parent_joint=MappingProxyType(parent_joint),
        child_joints=MappingProxyType({link: tuple(below) for link, below in children.items()}),
    )
    reached = {tree.root, *(joint.child for joint in tree.below(tree.root))}
    if looped := [link for link in links if link not in reached]:
        raise reader.error(
            f"the links {listed(looped)} form a loop apart from the root {tree.root!r}"
        )
    return tree


class _Reader:
    """Turns elements into links and joints; knows the file's name for its messages."""

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
        mass = self.number(inertial.find("mass"), "value", f"{where}: <mass>")
        if mass is not None and mass < 0.0:
            raise self.error(f"{where}: mass {mass:g} kg is negative")
        matrix = inertial.find("inertia")
        moments = [self.number(matrix, key, f"{where}: <inertia>") or 0.0 for key in _MOMENTS]
        return UrdfLink(name, mass, *self.origin(inertial, where), tuple(moments))

    def joint(self, element: Element) -> UrdfJoint:
        name = self.name(element, "joint")
        where = f"joint {name!r}"
        kind = element.get("type", "")
        if kind not in JOINT_TYPES:
            hint = f"; did you mean {close!r}?" if (close := closest(kind, JOINT_TYPES)) else ""
            raise self.error(
                f"{where}: unknown type {kind!r}; there is: {listed(JOINT_TYPES)}{hint}"
            )
        parent, child = (self.reference(element, role, where) for role in ("parent", "child"))
        lower, upper, effort, velocity = self.limits(element, kind, where)
        xyz, rpy = self.origin(element, where)
        axis, mimic = self.axis(element, kind, where), self.mimic(element, kind, where)
        return UrdfJoint(
            name, kind, parent, child, xyz, rpy, axis, lower, upper, effort, velocity, mimic
        )

    def name(self, element: Element, kind: str) -> str:
        name = element.get("name", "")
        if not name.strip():
            raise self.error(f"a <{kind}> has no name")
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
        xyz = self.numbers(found.get("xyz", "0 0 0"), 3, f"{where}: origin xyz")
        return xyz, self.numbers(found.get("rpy", "0 0 0"), 3, f"{where}: origin rpy")

    def axis(self, element: Element, kind: str, where: str) -> Numbers:
        found = element.find("axis")
        if found is None:
            return (1.0, 0.0, 0.0)  # the URDF's default
        axis = self.numbers(found.get("xyz", "1 0 0"), 3, f"{where}: axis")
        length = math.hypot(*axis)
        if length == 0.0:
            if kind in MOVING or kind == "planar":
                raise self.error(f"{where}: its axis is zero; give a direction, e.g. 0 0 1")
            return (1.0, 0.0, 0.0)  # a fixed joint has no use for its axis
        return axis if length == 1.0 else tuple(x / length for x in axis)

    def limits(
        self, element: Element, kind: str, where: str
    ) -> tuple[float | None, float | None, float | None, float | None]:
        found = element.find("limit")
        if found is None and kind in {"revolute", "prismatic"}:
            other = " (or type continuous)" if kind == "revolute" else ""
            raise self.error(f'{where}: a {kind} joint needs <limit lower="…" upper="…"/>{other}')
        effort, velocity = (
            self.number(found, key, f"{where}: <limit>") for key in ("effort", "velocity")
        )
        if effort is not None and effort < 0.0:
            raise self.error(f"{where}: effort limit {effort:g} is negative; 0 means unknown")
        if kind not in {"revolute", "prismatic"}:
            return None, None, effort, velocity
        # The URDF's default for a bound that is not given is 0.
        lower, upper = (
            self.number(found, key, f"{where}: <limit>") or 0.0 for key in ("lower", "upper")
        )
        if lower > upper:
            raise self.error(f"{where}: lower limit {lower:g} is above its upper limit {upper:g}")
        return lower, upper, effort, velocity

    def mimic(self, element: Element, kind: str, where: str) -> Mimic | None:
        found = element.find("mimic")
        if found is None or kind not in MOVING:
            return None
        leader = found.get("joint", "")
        if not leader:
            raise self.error(f'{where}: <mimic joint="…"/> names no joint')
        factor = self.number(found, "multiplier", f"{where}: <mimic>")
        offset = self.number(found, "offset", f"{where}: <mimic>")
        return Mimic(leader, 1.0 if factor is None else factor, offset or 0.0)

    def number(self, element: Element | None, key: str, what: str) -> float | None:
        text = element.get(key) if element is not None else None
        return None if text is None else self.numbers(text, 1, f"{what} {key}")[0]

    def numbers(self, text: str, count: int, what: str) -> Numbers:
        try:
            values = tuple(map(float, text.split()))
        except ValueError:
            hint = " (a ${…} is left from xacro)" if "$" in text else ""
            raise self.error(f"{what} {text!r} is not a number{hint}") from None
        if len(values) != count:
            raise self.error(f"{what} needs {count} numbers, got {text!r}")
        if not all(map(math.isfinite, values)):
            raise self.error(f"{what} {text!r} is not finite")
        return values

    def check_mimics(self, joints: dict[str, UrdfJoint]) -> None:
        for joint in joints.values():
            seen = [joint.name]
            while joint.mimic is not None:
                leader = joints.get(joint.mimic.leader)
                if leader is None or leader.type not in MOVING:
                    state = "does not exist" if leader is None else f"is {leader.type}"
                    raise self.error(
                        f"joint {joint.name!r} mimics {joint.mimic.leader!r}, which {state}"
                    )
                if leader.name in seen:
                    raise self.error(f"the joints {listed(seen)} mimic each other in a circle")
                seen.append(leader.name)
                joint = leader  # noqa: PLW2901 - a follower may follow a follower

    def root(self, links: dict[str, UrdfLink], parent_joint: dict[str, UrdfJoint]) -> str:
        roots = [link for link in links if link not in parent_joint]
        if not roots:
            raise self.error("has no root link: its joints form a loop")
        if len(roots) > 1:
            raise self.error(f"has {len(roots)} root links ({listed(roots)}); a URDF has one")
        return roots[0]


_ZERO3 = (0.0, 0.0, 0.0)
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _quoted(name: str) -> str:
    # html.escape, because xml.sax.saxutils imports urllib and ssl, a tenth of the start-up time.
    return f'"{escape(name)}"'


def _text(numbers: Numbers) -> str:
    return '"' + " ".join(map(repr, numbers)) + '"'


def _link_xml(link: UrdfLink) -> str:
    if link.mass is None:
        return f"<link name={_quoted(link.name)}/>"
    moments = " ".join(f'{k}="{v!r}"' for k, v in zip(_MOMENTS, link.inertia, strict=True))
    return (
        f"<link name={_quoted(link.name)}><inertial>"
        f"<origin xyz={_text(link.xyz)} rpy={_text(link.rpy)}/>"
        f'<mass value="{link.mass!r}"/><inertia {moments}/></inertial></link>'
    )


def _joint_xml(joint: UrdfJoint) -> str:
    # urdfdom wants all four limits; what is unknown stays unknown in UrdfJoint.
    lower, upper = joint.lower or 0.0, joint.upper or 0.0
    return (
        f'<joint name={_quoted(joint.name)} type="{joint.type}">'
        f"<parent link={_quoted(joint.parent)}/><child link={_quoted(joint.child)}/>"
        f"<origin xyz={_text(joint.xyz)} rpy={_text(joint.rpy)}/><axis xyz={_text(joint.axis)}/>"
        f'<limit lower="{lower!r}" upper="{upper!r}" effort="{joint.effort or 0.0!r}"'
        f' velocity="{joint.velocity or 0.0!r}"/></joint>'
    )
