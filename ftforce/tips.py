"""Which link is the tool when nobody said so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ftforce.errors import InputError, UnknownNameError, listed, printable
from ftforce.robot.formats.tree import MOVING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree
    from ftforce.robot.srdf import Srdf

GIVEN = "given"


def choose_tip(tree: UrdfTree, srdf: Srdf, tip: str | None, base: str | None) -> tuple[str, str]:
    """Return the tip link and where it comes from.

    The order is: the caller's; the SRDF's only end effector; the SRDF's only chain tip; the last
    link before the tree branches into several moving parts.

    Raises
    ------
    UnknownNameError
        The given tip or base is no link.
    InputError
        Nothing singles out one tip; the message lists the candidates.
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
    """Return the base link and where it comes from: given, the SRDF chain's, or the root.

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
                f"there is: {listed(above)}"
            )
        return base, GIVEN
    bases = [start for start, end in srdf.chains if end == tip and start in above]
    return (bases[0], "SRDF chain") if len(bases) == 1 else (tree.root, "root link")


def links_above(tree: UrdfTree, tip: str) -> list[str]:
    """Return the links that could be the base of a tip, the root first."""
    return [joint.parent for joint in tree.path_to(tip)]


def moving_path(tree: UrdfTree, base: str, tip: str) -> tuple[UrdfJoint, ...]:
    """Return the joints from base to tip that move, followers included."""
    joints = tree.path_to(tip)
    children = [joint.child for joint in joints]
    start = children.index(base) + 1 if base in children else 0
    return tuple(joint for joint in joints[start:] if joint.type in MOVING)


def tip_candidates(tree: UrdfTree) -> dict[str, int]:
    """Return links that could be a tip, with the number of moving joints above them, most first.

    A candidate is the end of a part that moves (below it nothing does), or a link that carries
    several moving parts, such as a hand with its fingers.
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
        return 0  # several SRDFs name links that their URDF lacks
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
            raise InputError(f"{printable(tree.path)}: no joint moves below the link {start!r}")
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
    """Return the child joints that move or carry something that does."""
    return [
        joint
        for joint in tree.child_joints[link]
        if joint.type in MOVING or any(j.type in MOVING for j in tree.below(joint.child))
    ]


def _follow_fixed(tree: UrdfTree, link: str) -> str:
    """Return the end of the fixed links on ``link``, or the last one before they branch."""
    while len(tree.child_joints[link]) == 1 and not _moving_children(tree, link):
        link = tree.child_joints[link][0].child
    return link
