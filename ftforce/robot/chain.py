"""Selection of the kinematic chain: base, and the joints between it and the tip."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import InputError, listed, printable
from ftforce.robot.formats.tree import MOVING
from ftforce.robot.tip import GIVEN, choose_tip, tip_candidates

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree
    from ftforce.robot.known_robots import KnownRobot
    from ftforce.robot.srdf import Srdf
    from ftforce.robot.tip import Tip


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
    end :
        The tip, how it was chosen, and the tool frames that could have been meant instead.
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
    end: Tip
    base: str
    base_source: str
    leaders: tuple[UrdfJoint, ...]
    followers: Mapping[str, tuple[Follower, ...]]
    moving: frozenset[str]

    @property
    def tip(self) -> str:
        """Tip link."""
        return self.end.link

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
    end = choose_tip(tree, srdf, known.tip if known and tip is None else tip, base)
    if known and tip is None:
        end = end._replace(source=f"known robot {known.name}")
    tip_link = end.link
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
    joints = tuple(leaders.values())
    return Chain(tree, end, base_link, base_source, joints, followers, frozenset(moving))


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
