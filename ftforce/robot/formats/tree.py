"""A URDF as a checked tree of links and joints; `ftforce.robot.formats.urdf` makes it from a file.

Pinocchio's parser (urdfdom) accepts much that is wrong in silence, prints the rest on stderr and
recurses without end. So a file is read and checked by us, and Pinocchio is given a URDF written
anew from what was checked, without geometry: meshes are never needed, and both sides see the same
numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from ftforce.errors import URDFError, closest, listed
from ftforce.io.text import LARGEST_NUMBER

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

MOVING = frozenset({"revolute", "continuous", "prismatic"})
HELD = frozenset({"floating", "planar"})  # held fixed: they have no single motor that could fail
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Pinocchio recurses along the tree, 2.2 kB a link: a thread with 8 MB of stack ends at 3700 links
# in a row, one with 512 kB at 200.
MAX_DEPTH = 150

Numbers: TypeAlias = tuple[float, ...]


class Mimic(NamedTuple):
    """``q_follower = multiplier · q_leader + offset``; the leader follows no other joint."""

    leader: str
    multiplier: float
    offset: float


class UrdfJoint(NamedTuple):
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


class UrdfLink(NamedTuple):
    """One link; ``inertia`` is ixx, ixy, ixz, iyy, iyz, izz in kg·m² about the centre of mass."""

    name: str
    mass: float | None
    xyz: Numbers
    rpy: Numbers
    inertia: Numbers


@dataclass(frozen=True, slots=True, eq=False)
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
    parent_joint, child_joints :
        The joints above and below a link, by its name.
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

    def link_codes(self) -> dict[str, str]:
        """Return what each link is called in `to_xml`, e.g. ``link 7``."""
        return {name: f"link {i}" for i, name in enumerate(self.links)}

    def joint_codes(self) -> dict[str, str]:
        """Return what each joint is called in `to_xml`, e.g. ``joint 3``."""
        return {name: f"joint {i}" for i, name in enumerate(self.joints)}

    def to_xml(self) -> str:
        """Write the tree as a URDF without geometry, with every number in full precision.

        In a URDF a link and a joint may share a name, and both may be called ``universe``;
        Pinocchio cannot reduce such a model. So every name is replaced by a code.
        """
        links, joints = self.link_codes(), self.joint_codes()
        body = [_link_xml(link, links[link.name]) for link in self.links.values()]
        body += [_joint_xml(joint, joints[joint.name], links) for joint in self.joints.values()]
        return f'<robot name="robot">{"".join(body)}</robot>'


def build_tree(
    path: str, name: str, links: Mapping[str, UrdfLink], joints: Mapping[str, UrdfJoint]
) -> UrdfTree:
    """Hang the links on each other.

    Parameters
    ----------
    path, name :
        The file, for messages, and the robot's name.
    links, joints :
        By name. A mimic joint may follow a follower; in the tree it follows the first leader.

    Raises
    ------
    URDFError
        A joint's link or leader is missing, there are loops, several roots, circles of followers,
        or too many links in a row.
    """
    joints = _without_mimic_chains(path, joints)
    parent_joint: dict[str, UrdfJoint] = {}
    children: dict[str, list[UrdfJoint]] = {link: [] for link in links}
    for joint in joints.values():
        _check_ends(path, joint, links)
        if (other := parent_joint.get(joint.child)) is not None:
            raise URDFError(
                path,
                f"link {joint.child!r} hangs on two joints, {other.name!r} and {joint.name!r}; "
                "a URDF is a tree and cannot hold closed loops",
            )
        parent_joint[joint.child] = joint
        children[joint.parent].append(joint)
    tree = UrdfTree(
        path=path,
        name=name,
        links=MappingProxyType(dict(links)),
        joints=MappingProxyType(joints),
        root=_root(path, links, parent_joint),
        parent_joint=MappingProxyType(parent_joint),
        child_joints=MappingProxyType({link: tuple(below) for link, below in children.items()}),
    )
    _check_depth(tree)
    return tree


def did_you_mean(name: str, available: Iterable[str]) -> str:
    """Return the end of a message that names what looks most like ``name``, if anything does."""
    return f"; did you mean {close!r}?" if (close := closest(name, available)) else ""


def _without_mimic_chains(path: str, joints: Mapping[str, UrdfJoint]) -> dict[str, UrdfJoint]:
    """Let every follower name the joint at the end of its chain of leaders."""
    done = {name: joint for name, joint in joints.items() if joint.mimic is None}
    for first in joints.values():
        joint, chain = first, dict[str, UrdfJoint]()
        while joint.name not in done:
            if joint.name in chain:
                raise URDFError(path, f"the joints {listed(chain)} mimic each other in a circle")
            chain[joint.name] = joint
            joint = _leader(path, joint, joints)
        for follower in reversed(chain.values()):
            done[follower.name] = _follow(path, follower, done)
    return {name: done[name] for name in joints}


def _leader(path: str, joint: UrdfJoint, joints: Mapping[str, UrdfJoint]) -> UrdfJoint:
    """Return the joint that ``joint``, a follower, mimics."""
    name = joint.mimic.leader if joint.mimic else ""
    leader = joints.get(name)
    if leader is None:
        reason = f"does not exist{did_you_mean(name, joints)}"
    elif leader.type not in MOVING:
        reason = f"is {leader.type}"
    else:
        return leader
    raise URDFError(path, f"joint {joint.name!r} mimics {name!r}, which {reason}")


def _follow(path: str, joint: UrdfJoint, done: Mapping[str, UrdfJoint]) -> UrdfJoint:
    """Return the follower with the leader of its leader, which is done already."""
    own = joint.mimic
    if own is None or (above := done[own.leader].mimic) is None:
        return joint
    multiplier = own.multiplier * above.multiplier
    offset = own.multiplier * above.offset + own.offset
    if max(abs(multiplier), abs(offset)) > LARGEST_NUMBER:
        raise URDFError(path, f"joint {joint.name!r}: its mimic multipliers grow beyond all bounds")
    return joint._replace(mimic=Mimic(above.leader, multiplier, offset))


def _check_ends(path: str, joint: UrdfJoint, links: Mapping[str, UrdfLink]) -> None:
    for role, link in (("parent", joint.parent), ("child", joint.child)):
        if link not in links:
            where = f"joint {joint.name!r}: its {role} link {link!r}"
            raise URDFError(path, f"{where} does not exist{did_you_mean(link, links)}")


def _root(path: str, links: Mapping[str, UrdfLink], parent_joint: Mapping[str, UrdfJoint]) -> str:
    roots = [link for link in links if link not in parent_joint]
    if not roots:
        raise URDFError(path, "has no root link: its joints form a loop")
    if len(roots) > 1:
        raise URDFError(path, f"has {len(roots)} root links ({listed(roots)}); a URDF has one")
    return roots[0]


def _check_depth(tree: UrdfTree) -> None:
    depths = {tree.root: 1}
    for joint in tree.below(tree.root):
        depths[joint.child] = depths[joint.parent] + 1
    if looped := [link for link in tree.links if link not in depths]:
        raise URDFError(
            tree.path, f"the links {listed(looped)} form a loop apart from the root {tree.root!r}"
        )
    if (deepest := max(depths.values())) > MAX_DEPTH:
        raise URDFError(tree.path, f"has {deepest} links in a row; at most {MAX_DEPTH} are read")


def _text(numbers: Numbers) -> str:
    return '"' + " ".join(map(repr, numbers)) + '"'


def _link_xml(link: UrdfLink, code: str) -> str:
    if link.mass is None:
        return f'<link name="{code}"/>'
    moments = " ".join(f'{k}="{v!r}"' for k, v in zip(MOMENTS, link.inertia, strict=True))
    return (
        f'<link name="{code}"><inertial>'
        f"<origin xyz={_text(link.xyz)} rpy={_text(link.rpy)}/>"
        f'<mass value="{link.mass!r}"/><inertia {moments}/></inertial></link>'
    )


def _joint_xml(joint: UrdfJoint, code: str, links: Mapping[str, str]) -> str:
    # Limits are ours to keep (see UrdfJoint); urdfdom only wants all four to be there.
    return (
        f'<joint name="{code}" type="{joint.type}">'
        f'<parent link="{links[joint.parent]}"/><child link="{links[joint.child]}"/>'
        f"<origin xyz={_text(joint.xyz)} rpy={_text(joint.rpy)}/><axis xyz={_text(joint.axis)}/>"
        f'<limit lower="{joint.lower or 0.0!r}" upper="{joint.upper or 0.0!r}"'
        f' effort="{joint.effort or 0.0!r}" velocity="{joint.velocity or 0.0!r}"/></joint>'
    )
