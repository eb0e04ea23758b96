"""Selection of the kinematic chain: tip, base and the joints between them."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import InputError, UnknownNameError, listed, printable
from ftforce.robot.formats.tree import MOVING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree
    from ftforce.robot.known_robots import KnownRobot
    from ftforce.robot.srdf import Srdf


GIVEN = "given"


def choose_tip(tree: UrdfTree, srdf: Srdf, tip: str | None, base: str | None) -> tuple[str, str]:
    """Return the tip link and how it was chosen.

    In order of precedence: the given link; the only end effector of the SRDF; the only chain tip of
    the SRDF; the last link before the tree branches into several moving parts.

    Parameters
    ----------
    tree, srdf :
        Contents of URDF and SRDF.
    tip, base :
        Links given by the caller, or ``None``.

    Raises
    ------
    UnknownNameError
        The given tip or base is not a link.
    InputError
        The tip is ambiguous; the message lists the candidates.
    """
    for kind, link in (("base link", base), ("tip link", tip)):
        if link is not None and link not in tree.links:
            raise UnknownNameError(kind, link, tree.links, f"in {printable(tree.path)}")
    if tip is not None:
        return tip, GIVEN
    start = tree.root if base is None else base
    chain_tips = dict.fromkeys(tip for base, tip in srdf.chains if _count_joints(tree, base, tip))
    for links, what in ((srdf.end_effectors, "SRDF end effector"), (chain_tips, "SRDF chain tip")):
        usable = [link for link in links if _count_joints(tree, start, link) > 0]
        if len(usable) == 1:
            return usable[0], what
        if len(usable) > 1:
            raise InputError(
                f"{printable(srdf.path)} names several {what}s; choose one as the tip (--tip): "
                f"{listed(usable)}"
            )
    return _before_branching(tree, start)


def choose_base(tree: UrdfTree, srdf: Srdf, tip: str, base: str | None) -> tuple[str, str]:
    """Return the base link and how it was chosen: given, from the SRDF chain, or the root.

    Parameters
    ----------
    tree, srdf :
        Contents of URDF and SRDF.
    tip :
        Tip link.
    base :
        Base link given by the caller, or ``None``.

    Raises
    ------
    InputError
        The given base does not lie between the root and the tip.
    """
    above = links_above(tree, tip)
    if base is not None:
        if base not in above:
            raise InputError(
                f"base link {base!r} does not lie between the root and the tip {tip!r}; "
                f"available: {listed(above)}"
            )
        return base, GIVEN
    bases = [start for start, end in srdf.chains if end == tip and start in above]
    return (bases[0], "SRDF chain") if len(bases) == 1 else (tree.root, "root link")


def links_above(tree: UrdfTree, tip: str) -> list[str]:
    """Return the links that can be the base for a tip, root first.

    Parameters
    ----------
    tree :
        Contents of the URDF.
    tip :
        Tip link.
    """
    return [joint.parent for joint in tree.path_to(tip)]


def moving_path(tree: UrdfTree, base: str, tip: str) -> tuple[UrdfJoint, ...]:
    """Return the moving joints from base to tip, including followers.

    Parameters
    ----------
    tree :
        Contents of the URDF.
    base, tip :
        Base and tip link.
    """
    joints = tree.path_to(tip)
    children = [joint.child for joint in joints]
    start = children.index(base) + 1 if base in children else 0
    return tuple(joint for joint in joints[start:] if joint.type in MOVING)


def tip_candidates(tree: UrdfTree) -> dict[str, int]:
    """Return candidate tip links with the number of moving joints above each, most joints first.

    A candidate is the end of a moving branch, or a link that carries several moving parts, such as
    a hand with fingers.
    """
    counts: dict[str, int] = {}
    for link in tree.links:
        above = sum(joint.type in MOVING for joint in tree.path_to(link))
        joint = tree.parent_joint.get(link)
        below = len(_moving_children(tree, link))
        if above and below > 1:
            counts[link] = above
        elif joint is not None and joint.type in MOVING and not below:
            counts[_follow_fixed(tree, link)] = above
    return dict(sorted(counts.items(), key=lambda item: -item[1]))


def _count_joints(tree: UrdfTree, base: str, tip: str) -> int:
    if tip not in tree.links:
        return 0  # some SRDFs name links that are not in their URDF
    return len(moving_path(tree, base, tip)) if base in links_above(tree, tip) else 0


def _before_branching(tree: UrdfTree, start: str) -> tuple[str, str]:
    link, moved = start, False
    while True:
        children = _moving_children(tree, link)
        if len(children) != 1:
            break
        moved = moved or children[0].type in MOVING
        link = children[0].child
    if not moved:
        if not children:
            raise InputError(f"{printable(tree.path)}: no movable joint below the link {start!r}")
        raise InputError(
            f"{printable(tree.path)}: the tree branches into several moving parts at the link "
            f"{link!r}; choose a tip (--tip): {_counted(tip_candidates(tree))}"
        )
    tip = _follow_fixed(tree, link) if not children else link
    branches = "last link" if not children else "last link before several moving parts"
    return tip, branches


def _counted(tips: Mapping[str, int]) -> str:
    return listed(
        f"{name} (1 joint)" if count == 1 else f"{name} ({count} joints)"
        for name, count in tips.items()
    )


def _moving_children(tree: UrdfTree, link: str) -> list[UrdfJoint]:
    """Return the child joints that move or have moving joints below them."""
    return [
        joint
        for joint in tree.child_joints[link]
        if joint.type in MOVING or any(j.type in MOVING for j in tree.below(joint.child))
    ]


def _follow_fixed(tree: UrdfTree, link: str) -> str:
    """Return the last link fixed to ``link``, or the last one before a branch."""
    while len(tree.child_joints[link]) == 1 and not _moving_children(tree, link):
        link = tree.child_joints[link][0].child
    return link


MAX_JOINTS = 100  # Pinocchio's data grow with the cube of it: 70 MB for 100, 8 GB for 500


class Follower(NamedTuple):
    """A mimic joint: ``q = multiplier · q_leader + offset``."""

    name: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The kinematic chain that is analysed.

    Attributes
    ----------
    tree :
        The whole URDF.
    tip, tip_source :
        Tip link, and how it was chosen.
    base, base_source :
        Base link, and how it was chosen.
    leaders :
        The n joints, in order from base to tip; a follower on the path is replaced by its leader.
    followers :
        Mimic joints of each leader, by its name.
    moving :
        Names of all joints that remain movable in the model. Leaders above the base are excluded:
        within the chain only their followers move.
    """

    tree: UrdfTree
    tip: str
    tip_source: str
    base: str
    base_source: str
    leaders: tuple[UrdfJoint, ...]
    followers: Mapping[str, tuple[Follower, ...]]
    moving: frozenset[str]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n joints."""
        return tuple(joint.name for joint in self.leaders)


def choose_chain(
    tree: UrdfTree, srdf: Srdf, known: KnownRobot | None, tip: str | None, base: str | None
) -> Chain:
    """Return the chain from base to tip.

    Parameters
    ----------
    tree, srdf :
        Contents of URDF and SRDF.
    known :
        Registry entry; provides the tip if none is given, and the base if it lies above the tip.
    tip, base :
        Links given by the caller.

    Raises
    ------
    InputError
        The tip or base is unknown, the tip is ambiguous, or no joints, or too many, move it.
    """
    tip_link, tip_source = choose_tip(tree, srdf, known.tip if known and tip is None else tip, base)
    if known and tip is None:
        tip_source = f"known robot {known.name}"
    above = links_above(tree, tip_link)
    if known and base is None and known.base in above:
        base_link, base_source = known.base, f"known robot {known.name}"
    else:
        base_link, base_source = choose_base(tree, srdf, tip_link, base)
    leaders = leaders_of(tree, moving_path(tree, base_link, tip_link))
    if not leaders:
        raise InputError(
            f"{printable(tree.path)}: no joint moves the tip {tip_link!r} relative to the base "
            f"{base_link!r}; available tips: {listed(tip_candidates(tree))}"
        )
    followers = _followers(tree, leaders)
    moving = {*leaders, *(joint.name for group in followers.values() for joint in group)}
    moving -= {joint.name for joint in tree.path_to(base_link)}
    if len(moving) > MAX_JOINTS:
        raise InputError(
            f"{printable(tree.path)}: {len(moving)} joints move between {base_link!r} and "
            f"{tip_link!r}; at most {MAX_JOINTS} can be analysed"
        )
    ends = (tip_link, tip_source, base_link, base_source)
    return Chain(tree, *ends, tuple(leaders.values()), followers, frozenset(moving))


def leaders_of(tree: UrdfTree, joints: tuple[UrdfJoint, ...]) -> dict[str, UrdfJoint]:
    """Return the distinct joints after replacing each follower by its leader.

    Parameters
    ----------
    tree :
        Contents of the URDF.
    joints :
        Moving joints, from base to tip.
    """
    names = (joint.mimic.leader if joint.mimic else joint.name for joint in joints)
    return {name: tree.joints[name] for name in names}


def _followers(
    tree: UrdfTree, leaders: Mapping[str, UrdfJoint]
) -> Mapping[str, tuple[Follower, ...]]:
    found: dict[str, list[Follower]] = {name: [] for name in leaders}
    for joint in tree.joints.values():
        if (mimic := joint.mimic) is not None and mimic.leader in found:
            follower = Follower(joint.name, mimic.multiplier, mimic.offset)
            found[mimic.leader].append(follower)
    return MappingProxyType({name: tuple(group) for name, group in found.items()})
