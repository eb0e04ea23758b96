"""A URDF as a checked tree of links and joints; `ftforce.robot.formats.urdf` reads it from a file.

Pinocchio's parser (urdfdom) silently accepts many errors, prints others to stderr and recurses
without a limit. ftforce therefore reads and checks the file itself and passes Pinocchio a new URDF
generated from the checked tree, without geometry: meshes are never needed, and both use the same
numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

from ftforce.errors import URDFError, closest, listed
from ftforce.io.text import LARGEST_NUMBER

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

MOVING = frozenset({"revolute", "continuous", "prismatic"})
LIMITED = frozenset({"revolute", "prismatic"})
HELD = frozenset({"floating", "planar"})  # held fixed: no single motor drives them
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Pinocchio recurses along the tree, 2.2 kB of stack per link: a thread with 8 MB of stack overflows
# at a depth of 3700 links, one with 512 kB at 200.
MAX_DEPTH = 150
_MAX_HINTS = 3  # flaws that suggest another name, for which all names are compared

Numbers: TypeAlias = tuple[float, ...]


PartKind: TypeAlias = Literal["link", "joint"]


class Flaw(NamedTuple):
    """Something malformed in one link or joint, and what it is replaced by in the tree.

    Attributes
    ----------
    kind, name :
        The link or joint.
    reason :
        What is malformed, as a sentence that names the part.
    hides_motion :
        Whether a joint that may move is taken for a fixed one.
    """

    kind: PartKind
    name: str
    reason: str
    hides_motion: bool = False


class Mimic(NamedTuple):
    """Mimic relation ``q_follower = multiplier · q_leader + offset``."""

    leader: str
    multiplier: float
    offset: float


class UrdfJoint(NamedTuple):
    """One joint as given in the URDF (rad, m, N·m or N; ``None`` where not given).

    Limits are as written, which may be infinite or negative; `ftforce.load_robot` interprets them.
    So are Coulomb friction (N·m or N), viscous damping (N·m·s/rad or N·s/m) and armature, the rotor
    inertia reflected to the joint (kg·m² or kg).
    """

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
    friction: float | None
    mimic: Mimic | None
    damping: float | None = None
    armature: float | None = None


class UrdfLink(NamedTuple):
    """One link; ``inertia`` is ixx, ixy, ixz, iyy, iyz, izz in kg·m² about the centre of mass."""

    name: str
    mass: float | None
    xyz: Numbers
    rpy: Numbers
    inertia: Numbers


@dataclass(frozen=True, slots=True, eq=False)
class UrdfTree:
    """A URDF whose joints form a single tree, and whose numbers are finite except for limits.

    Attributes
    ----------
    path, name :
        Path of the file and name of the robot.
    links, joints :
        Links and joints by name, in file order.
    root :
        The link that is not the child of any joint.
    parent_joint, child_joints :
        The joints directly above and below each link, by link name.
    flaws :
        What is malformed in single links and joints; the tree has stand-ins for it.
    notes :
        Remarks on the file.
    states :
        Named postures that the file itself has, by joint name (rad, m).
    gravity :
        Gravity in root axes, m/s²; ``None`` if the file does not set it.
    incomplete :
        Links that lack a part of their mass, as a file that it follows from cannot be read.
    """

    path: str
    name: str
    links: Mapping[str, UrdfLink]
    joints: Mapping[str, UrdfJoint]
    root: str
    parent_joint: Mapping[str, UrdfJoint]
    child_joints: Mapping[str, tuple[UrdfJoint, ...]]
    flaws: tuple[Flaw, ...] = ()
    notes: tuple[str, ...] = ()
    states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    gravity: Numbers | None = None
    incomplete: frozenset[str] = frozenset()

    def path_to(self, link: str) -> tuple[UrdfJoint, ...]:
        """Return the joints from the root to ``link``.

        Parameters
        ----------
        link :
            Name of the link.
        """
        joints: list[UrdfJoint] = []
        while (joint := self.parent_joint.get(link)) is not None:
            joints.append(joint)
            link = joint.parent
        return tuple(reversed(joints))

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Yield the joints of the subtree below ``link``, parents first.

        Parameters
        ----------
        link :
            Name of the link.
        """
        waiting = [link]
        while waiting:
            for joint in self.child_joints[waiting.pop()]:
                yield joint
                waiting.append(joint.child)

    def link_codes(self) -> dict[str, str]:
        """Return the code of each link in `to_xml`, e.g. ``link 7``."""
        return {name: f"link {i}" for i, name in enumerate(self.links)}

    def joint_codes(self) -> dict[str, str]:
        """Return the code of each joint in `to_xml`, e.g. ``joint 3``."""
        return {name: f"joint {i}" for i, name in enumerate(self.joints)}

    def to_xml(self) -> str:
        """Return the tree as URDF text without geometry, with all numbers in full precision.

        Names are replaced by codes: a URDF may use the same name for a link and a joint, or the
        name ``universe``, and Pinocchio cannot reduce such a model.
        """
        links, joints = self.link_codes(), self.joint_codes()
        body = [_link_xml(link, links[link.name]) for link in self.links.values()]
        body += [_joint_xml(joint, joints[joint.name], links) for joint in self.joints.values()]
        return f'<robot name="robot">{"".join(body)}</robot>'


def build_tree(
    path: str,
    name: str,
    links: Mapping[str, UrdfLink],
    joints: Mapping[str, UrdfJoint],
    *,
    flaws: Iterable[Flaw] = (),
    notes: Iterable[str] = (),
) -> UrdfTree:
    """Build the tree of links and joints and check it.

    Parameters
    ----------
    path, name :
        Path of the file, for messages, and name of the robot.
    links, joints :
        Links and joints by name. Chains of mimic joints are resolved to their first leader.
    flaws, notes :
        What is malformed in single links and joints, and remarks on the file. Mimic relations that
        cannot be resolved are dropped and added to the flaws.

    Raises
    ------
    URDFError
        The link of a joint is missing, the tree has loops or several roots, or it is too deep.
    """
    found = list(flaws)
    joints = _without_mimic_chains(joints, found)
    parent_joint: dict[str, UrdfJoint] = {}
    children: dict[str, list[UrdfJoint]] = {link: [] for link in links}
    for joint in joints.values():
        _check_ends(path, joint, links)
        if (other := parent_joint.get(joint.child)) is not None:
            raise URDFError(
                path,
                f"link {joint.child!r} has two parent joints, {other.name!r} and {joint.name!r}; "
                "a URDF is a tree and cannot contain closed loops",
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
        flaws=tuple(found),
        notes=tuple(notes),
    )
    _check_depth(tree)
    return tree


def did_you_mean(name: str, available: Iterable[str]) -> str:
    """Return the end of a message that suggests the closest name, or an empty string.

    Parameters
    ----------
    name :
        The unknown name.
    available :
        The available names.
    """
    return f"; did you mean {close!r}?" if (close := closest(name, available)) else ""


def _without_mimic_chains(
    joints: Mapping[str, UrdfJoint], flaws: list[Flaw]
) -> dict[str, UrdfJoint]:
    """Return the joints with every mimic relation resolved to its first leader.

    Those that cannot be resolved are dropped and added to the flaws.
    """
    done = {name: joint for name, joint in joints.items() if joint.mimic is None}

    def drop(joint: UrdfJoint, reason: str) -> None:
        flaws.append(Flaw("joint", joint.name, reason))
        done[joint.name] = joint._replace(mimic=None)

    for first in joints.values():
        joint, chain = first, dict[str, UrdfJoint]()
        while joint.name not in done:
            if joint.name in chain:
                reason = f"the joints {listed(chain)} mimic each other in a cycle"
                for follower in chain.values():
                    drop(follower, reason)
            elif problem := _missing_leader(joint, joints, hints=len(flaws) < _MAX_HINTS):
                drop(joint, problem)
            else:
                chain[joint.name] = joint
                joint = joints[_leader(joint)]
        for follower in reversed(chain.values()):
            if follower.name not in done:
                resolved = _follow(follower, done)
                if resolved.mimic and max(map(abs, resolved.mimic[1:])) > LARGEST_NUMBER:
                    drop(follower, _TOO_LARGE.format(follower.name))
                else:
                    done[follower.name] = resolved
    return {name: done[name] for name in joints}


_TOO_LARGE = (
    "joint {!r}: its multiplier or offset, multiplied along the chain of mimic joints, exceeds "
    f"{LARGEST_NUMBER:g}"
)


def _leader(joint: UrdfJoint) -> str:
    return joint.mimic.leader if joint.mimic else ""


def _missing_leader(
    joint: UrdfJoint, joints: Mapping[str, UrdfJoint], *, hints: bool = True
) -> str:
    """Return why a follower cannot follow its leader; empty if it can.

    With ``hints``, another name is suggested.
    """
    name = _leader(joint)
    leader = joints.get(name)
    if leader is None:
        reason = f"does not exist{did_you_mean(name, joints) if hints else ''}"
    elif leader.type not in MOVING:
        reason = f"is {leader.type}"
    else:
        return ""
    return f"joint {joint.name!r} mimics {name!r}, which {reason}"


def _follow(joint: UrdfJoint, done: Mapping[str, UrdfJoint]) -> UrdfJoint:
    """Return the follower with its leader's mimic relation, already resolved, substituted."""
    own = joint.mimic
    if own is None or (above := done[own.leader].mimic) is None:
        return joint
    multiplier = own.multiplier * above.multiplier
    offset = own.multiplier * above.offset + own.offset
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
        raise URDFError(
            path, f"has {len(roots)} root links ({listed(roots)}); a URDF has exactly one"
        )
    return roots[0]


def _check_depth(tree: UrdfTree) -> None:
    depths = {tree.root: 1}
    for joint in tree.below(tree.root):
        depths[joint.child] = depths[joint.parent] + 1
    if looped := [link for link in tree.links if link not in depths]:
        raise URDFError(
            tree.path,
            f"the links {listed(looped)} form a loop disconnected from the root {tree.root!r}",
        )
    if (deepest := max(depths.values())) > MAX_DEPTH:
        raise URDFError(tree.path, f"is {deepest} links deep; at most {MAX_DEPTH} are supported")


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
    # ftforce keeps the limits itself (see UrdfJoint); urdfdom requires all four attributes, finite,
    # and Pinocchio no negative efforts.
    limits = (joint.lower, joint.upper, joint.effort, joint.velocity)
    lower, upper, effort, velocity = (x if x and math.isfinite(x) else 0.0 for x in limits)
    effort, velocity = max(effort, 0.0), max(velocity, 0.0)
    return (
        f'<joint name="{code}" type="{joint.type}">'
        f'<parent link="{links[joint.parent]}"/><child link="{links[joint.child]}"/>'
        f"<origin xyz={_text(joint.xyz)} rpy={_text(joint.rpy)}/><axis xyz={_text(joint.axis)}/>"
        f'<limit lower="{lower!r}" upper="{upper!r}" effort="{effort!r}" velocity="{velocity!r}"/>'
        "</joint>"
    )
