"""The joints that count: from the base to the tip, each follower with its leader."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import InputError, listed, printable
from ftforce.tips import choose_base, choose_tip, links_above, moving_path, tip_candidates

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree
    from ftforce.robot.known_robots import KnownRobot
    from ftforce.robot.srdf import Srdf

MOST_JOINTS = 100  # Pinocchio's workspace grows with their cube: 70 MB for 100, 8 GB for 500


class Follower(NamedTuple):
    """A mimic joint: ``q = multiplier · q_leader + offset``."""

    name: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The part of a tree that is analysed.

    Attributes
    ----------
    tree :
        The whole URDF.
    tip, tip_source :
        Tip link, and what singled it out.
    base, base_source :
        Base link, and what singled it out.
    leaders :
        The n joints, in the order of the path from base to tip. Where a follower lies on the path,
        its leader stands in its place.
    followers :
        What moves with each of them.
    moving :
        Names of all joints that stay free in the model. A leader above the base is not among them:
        for the chain only what follows it moves.
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
        What the files say.
    known :
        The registry's entry: its tip if none is given, and its base where that lies above the tip.
    tip, base :
        The caller's links.

    Raises
    ------
    InputError
        Unknown tip or base; no tip is singled out; no joint, or too many, move the tip.
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
            f"{printable(tree.path)}: no joint moves the tip {tip_link!r} against the base "
            f"{base_link!r}; tips to choose from: {listed(tip_candidates(tree))}"
        )
    followers = _followers(tree, leaders)
    moving = {*leaders, *(one.name for all_of in followers.values() for one in all_of)}
    moving -= {joint.name for joint in tree.path_to(base_link)}
    if len(moving) > MOST_JOINTS:
        raise InputError(
            f"{printable(tree.path)}: {len(moving)} joints move between {base_link!r} and "
            f"{tip_link!r}; at most {MOST_JOINTS} can be analysed"
        )
    ends = (tip_link, tip_source, base_link, base_source)
    return Chain(tree, *ends, tuple(leaders.values()), followers, frozenset(moving))


def leaders_of(tree: UrdfTree, joints: tuple[UrdfJoint, ...]) -> dict[str, UrdfJoint]:
    """Return the joints, each follower replaced by its leader, each once."""
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
    return MappingProxyType({name: tuple(all_of) for name, all_of in found.items()})
