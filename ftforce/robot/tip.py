"""Choice of the tip: which branch of the tree is the arm, and which link is its tool frame."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from ftforce.errors import InputError, UnknownNameError, listed, printable
from ftforce.robot.formats.tree import MOVING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree
    from ftforce.robot.srdf import Srdf

GIVEN = "given"
BY_NAME = "tool frame by name"
_CLEARLY = 2  # a branch is clearly the longest with this many joints more than any other
_MOST_OF_A_GRIPPER = 2  # joints, in series and in all, that may lie beyond the tip unasked

# Names of tool frames, best first. A name is compared word by word: panda_hand_tcp, linkEE.
# Patterns are compiled when they are needed (by `re`, which keeps them): often an SRDF has the tip.
_TOOL_FRAMES = tuple(
    rf"(?:^|_)(?:{words})(?:_|$)"
    for words in (
        r"tool_?0",
        r"tcp\d*|tool_?cent(?:er|re)_?point",
        r"eef?(?:link|frame)?",
        r"tool[a-z]*\d*",
        r"end_?effector\d*|end_?point",
        r"[a-z]*flange\d*",
        r"grasp[a-z]*|grip(?:per)?_(?:frame|cent(?:er|re)|point|tip|site)",
    )
)
_GRIPPER = r"(?:^|_)gripper$"  # the gripper itself: better than nothing
_FINGER = (
    r"finger|thumb|knuckle|(?:^|_)(?:jaws?|claws?|pincers?|digit)(?:_|\d|$)"
    r"|hand_.*(?:index|middle|ring|little|pinky|mrl)"
)
_JAW = r"gripper"  # also the name of a whole gripper, and of the wrist that turns it
_NO_JAW = r"yaw|roll|pitch|rot|wrist|base|palm|body|flange|tool|mount"
_NO_ARM = (
    r"wheel|caster|rotor|propeller|camera|kinect|xtion|realsense|lidar|laser|velodyne|hokuyo|sonar"
    r"|sensor|antenna|display|screen|spring|balanc|counter_?weight"
    r"|(?:^|_)(?:imu|head|neck|ptu|pan_tilt|eye|eyes|eyelid|jaw|rocker|bogie|cam)(?:_|\d|$)"
)


class Tip(NamedTuple):
    """The tip link, how it was chosen, and the tool frames that could have been meant instead."""

    link: str
    source: str
    others: Mapping[str, tuple[float, float]] = {}  # by link: distance in m, angle in rad


def choose_tip(tree: UrdfTree, srdf: Srdf, tip: str | None, base: str | None) -> Tip:
    """Return the tip link, how it was chosen, and what else could have been meant.

    In order of precedence: the given link; the only end effector of the SRDF; the only chain tip of
    the SRDF; the tool frame at the end of the arm.

    The arm is followed from the base. Where several branches move, those that merely follow a joint
    elsewhere (mimic), and those that are named after fingers, wheels, heads, sensors or
    counterweights (unless a named tool frame is beyond them), are left aside. Of the others the arm
    is the one with a named tool frame, or the one with at least two joints in series more than any
    other. The arm ends where nothing is left, where several short branches are (fingers), and
    before a gripper: at most two joints beyond a named tool frame, or a joint that is named after a
    jaw or that other joints beside it mimic.

    Of the links fixed to its last moving link, the tip is the first of ``tool0``, ``tcp``,
    ``ee_link``, ``tool…``, ``end_effector``, ``flange``, ``grasp…`` (also as parts of a name; of
    several of one kind the plainest, then the outermost). Without such a name it is the last link,
    or the last one before several moving parts.

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
        It is not clear which branch is the arm, or more than two joints that are not a gripper's
        lie beyond its end; the message lists the candidates, best first.
    """
    for kind, link in (("base link", base), ("tip link", tip)):
        if link is not None and link not in tree.links:
            raise UnknownNameError(kind, link, tree.links, f"in {printable(tree.path)}")
    if tip is not None:
        return Tip(tip, GIVEN)
    start = tree.root if base is None else base
    chain_tips = dict.fromkeys(tip for base, tip in srdf.chains if _count_joints(tree, base, tip))
    for links, what in ((srdf.end_effectors, "SRDF end effector"), (chain_tips, "SRDF chain tip")):
        usable = [link for link in links if _count_joints(tree, start, link) > 0]
        if len(usable) == 1:
            return Tip(usable[0], what)
        if len(usable) > 1:
            raise InputError(
                f"{printable(srdf.path)} names several {what}s; choose one as the tip (--tip): "
                f"{listed(sorted(usable, key=lambda link: _rank(_Bodies(tree), link)))}"
            )
    bodies = _Bodies(tree)
    return _tool_of(bodies, _end_of_arm(bodies, start))


def _count_joints(tree: UrdfTree, base: str, tip: str) -> int:
    """Return the number of moving joints from base to tip; 0 if base is not above the tip.

    Parameters
    ----------
    tree :
        Contents of the URDF.
    base, tip :
        Base and tip link.
    """
    if tip not in tree.links:
        return 0  # some SRDFs name links that are not in their URDF
    joints = tree.path_to(tip)
    above = [joint.parent for joint in joints]
    if base not in above:
        return 0
    return sum(joint.type in MOVING for joint in joints[above.index(base) :])


def tip_candidates(tree: UrdfTree) -> dict[str, int]:
    """Return candidate tip links with the number of moving joints above each, best first.

    Candidates are the tool frames of the ends of all moving branches, and of the links that carry
    several moving parts, such as a hand with fingers. Named tool frames come first, then the ends
    with most joints; fingers, wheels, heads and sensors come last.

    Parameters
    ----------
    tree :
        Contents of the URDF.
    """
    return _candidates(_Bodies(tree))


def _candidates(bodies: _Bodies) -> dict[str, int]:
    found: dict[str, int] = {}
    for link in (joint.child for joint in bodies.tree.joints.values() if joint.type in MOVING):
        path, exits = bodies.path_to(link), bodies.exits[link]
        if len(exits) != 1 or _is_gripper(bodies, link, exits[0], path):
            found[_tool_of(bodies, link).link] = len(path)
    return dict(sorted(found.items(), key=lambda item: _rank(bodies, item[0])))


def _rank(bodies: _Bodies, link: str) -> tuple[bool, bool, int]:
    """Return the key by which candidate tips are sorted, best first."""
    path = bodies.path_to(link)
    aside = any(joint.name in bodies.aside for joint in path[1:]) or _has_name(path[:1], _NO_ARM)
    return aside, _kind(link) is None, -len(path)


# ---- the arm ---------------------------------------------------------------------------------


class _Bodies:
    """The tree with links that are fixed to each other taken together.

    Attributes
    ----------
    tree :
        Contents of the URDF.
    links, exits :
        Links that are fixed to each moving link (and to the root), itself first, and the moving
        joints that begin there. Floating and planar joints are held, so they count as fixed.
    length :
        Independent joints in series in the branch that begins with a joint: no followers.
    beyond :
        Independent joints in that branch.
    named :
        Joints whose branch has a named tool frame.
    aside :
        Joints whose branch is no arm.
    """

    def __init__(self, tree: UrdfTree) -> None:
        self.tree = tree
        moving_link = {tree.root: tree.root}
        self.links: dict[str, list[str]] = {tree.root: [tree.root]}
        self.exits: dict[str, list[UrdfJoint]] = {tree.root: []}
        joints: list[UrdfJoint] = []
        for joint in tree.below(tree.root):
            parent = moving_link[joint.parent]
            if joint.type in MOVING:
                joints.append(joint)
                self.exits[parent].append(joint)
                self.links[joint.child], self.exits[joint.child] = [], []
                parent = joint.child
            moving_link[joint.child] = parent
            self.links[parent].append(joint.child)
        self.length: dict[str, int] = {}
        self.beyond: dict[str, int] = {}
        self.named: set[str] = set()
        for joint in reversed(joints):
            own, after = int(joint.mimic is None), [one.name for one in self.exits[joint.child]]
            self.length[joint.name] = own + max((self.length[one] for one in after), default=0)
            self.beyond[joint.name] = own + sum(self.beyond[one] for one in after)
            kinds = {_kind(link) for link in self.links[joint.child]}
            if kinds - {None, _WEAK} or not self.named.isdisjoint(after):
                self.named.add(joint.name)
        self.aside = {one.name for exits in self.exits.values() for one in self._aside_of(exits)}

    def _aside_of(self, exits: list[UrdfJoint]) -> Iterator[UrdfJoint]:
        """Yield those of the branches that begin on one moving link that are no arms."""
        are_fingers = _has_name(exits, _FINGER)  # a thumb's neighbours, too
        for joint in exits:
            is_other = are_fingers or _has_name([joint], _NO_ARM) or _is_follower(self.tree, joint)
            if _has_name([joint], _FINGER) or (is_other and joint.name not in self.named):
                yield joint

    def path_to(self, link: str) -> list[UrdfJoint]:
        """Return the moving joints from the root to a link."""
        return [joint for joint in self.tree.path_to(link) if joint.type in MOVING]

    def moving_link(self, link: str) -> str:
        """Return the moving link, or the root, to which a link is fixed."""
        path = self.path_to(link)
        return path[-1].child if path else self.tree.root


def _is_follower(tree: UrdfTree, joint: UrdfJoint) -> bool:
    """Return whether all joints of a branch mimic joints outside it."""
    if joint.mimic is None:
        return False
    branch = [joint, *(one for one in tree.below(joint.child) if one.type in MOVING)]
    names = {one.name for one in branch}
    return all(one.mimic is not None and one.mimic.leader not in names for one in branch)


def _end_of_arm(bodies: _Bodies, start: str) -> str:
    """Return the last moving link of the arm that begins at ``start``."""
    tree = bodies.tree
    link, exits = start, _exits_below(bodies, start)
    path: list[UrdfJoint] = []
    while (joint := _next(bodies, link, exits, path)) is not None:
        link, exits = joint.child, bodies.exits[joint.child]
        path.append(joint)
    if not path:
        raise InputError(f"{printable(tree.path)}: no movable joint below the link {start!r}")
    beyond = 0 if _has_name(exits, _FINGER) else sum(bodies.beyond[one.name] for one in exits)
    if beyond > _MOST_OF_A_GRIPPER:
        tip = _tool_of(bodies, link).link
        raise _which_tip(bodies, f"{beyond} moving joints lie beyond {tip!r}")
    return link


def _exits_below(bodies: _Bodies, start: str) -> list[UrdfJoint]:
    """Return the moving joints that begin on a link or on what is fixed below it."""
    exits = bodies.exits[bodies.moving_link(start)]
    above = {joint.child for joint in bodies.tree.path_to(start)}
    fixed = {start, *(joint.child for joint in bodies.tree.below(start))}
    return [joint for joint in exits if joint.parent in fixed and joint.child not in above]


def _next(
    bodies: _Bodies, link: str, exits: list[UrdfJoint], path: list[UrdfJoint]
) -> UrdfJoint | None:
    """Return the arm's next joint beyond a moving link; ``None`` where the arm ends."""
    arms = [joint for joint in exits if joint.name not in bodies.aside]
    if len(exits) == 1 or not (path or arms):  # wheels or fingers alone
        arms = exits
    if len(arms) > 1:
        arms = _longest(bodies, arms)
    if len(arms) == 1:
        return None if _is_gripper(bodies, link, arms[0], path) else arms[0]
    if not exits or (path and all(bodies.length[j.name] <= _MOST_OF_A_GRIPPER for j in arms)):
        return None
    fork = _fork(bodies.tree, link)
    raise _which_tip(bodies, f"the tree branches into several moving parts at the link {fork!r}")


def _longest(bodies: _Bodies, arms: list[UrdfJoint]) -> list[UrdfJoint]:
    """Return the branch that is the arm, or all of them if that is not clear."""
    length = {joint.name: bodies.length[joint.name] for joint in arms}
    named = [joint for joint in arms if joint.name in bodies.named]
    if len(named) == 1 and length[named[0].name] > max(length.values()) - _CLEARLY:
        return named
    first, second, *_ = sorted(arms, key=lambda joint: -length[joint.name])
    is_clear = length[first.name] >= length[second.name] + _CLEARLY
    return [first] if is_clear and (not named or first in named) else arms


def _is_gripper(bodies: _Bodies, link: str, joint: UrdfJoint, path: list[UrdfJoint]) -> bool:
    """Return whether a joint beyond a moving link of the arm, and all beyond it, is a gripper."""
    length = bodies.length[joint.name]
    if not path or length > _MOST_OF_A_GRIPPER or joint.name in bodies.named:
        return False
    if any(_kind(one) is not None for one in bodies.links[link]):
        return True
    if _has_name([joint], _FINGER) and not _has_name(path, _FINGER):
        return True
    last = not bodies.exits[joint.child]
    if last and _has_name([joint], _JAW) and not _has_name([joint], _NO_JAW):
        return True
    beside = (one.mimic for one in bodies.exits[link] if one is not joint)
    return length == 1 and any(mimic is not None and mimic.leader == joint.name for mimic in beside)


def _fork(tree: UrdfTree, link: str) -> str:
    """Return the link at which the moving parts beyond a link separate."""
    while len(below := _moving_children(tree, link)) == 1 and below[0].type not in MOVING:
        link = below[0].child
    return link


def _moving_children(tree: UrdfTree, link: str) -> list[UrdfJoint]:
    """Return the child joints that move or have moving joints below them."""
    return [
        joint
        for joint in tree.child_joints[link]
        if joint.type in MOVING or any(j.type in MOVING for j in tree.below(joint.child))
    ]


def _which_tip(bodies: _Bodies, why: str) -> InputError:
    tips = _candidates(bodies)
    best = {link: n for link, n in tips.items() if not _rank(bodies, link)[0]} or tips
    counted = [f"{link} ({n} joint{'s' if n > 1 else ''})" for link, n in best.items()]
    left = len(tips) - len(best)
    rest = f"; or one of {left} on fingers, wheels, heads, sensors, …" if left else ""
    return InputError(
        f"{printable(bodies.tree.path)}: which tip? {why}; choose a tip (--tip): {listed(counted)}"
        f"{rest}"
    )


# ---- the tool frame --------------------------------------------------------------------------

_WEAK = len(_TOOL_FRAMES)


def _tool_of(bodies: _Bodies, link: str) -> Tip:
    """Return the tool frame among the links that are fixed to a moving link."""
    tree = bodies.tree
    plain, source = _last_link(bodies, link)
    frames = _fixed_frames(bodies, link)
    named = [name for name in frames if _kind(name) is not None]
    if not named:
        return Tip(plain, source)
    ranked = sorted(named, key=lambda name: _precedence(tree, name))
    tip = ranked[0]
    others = {}
    for name in ranked[1:]:
        away = frames[tip].actInv(frames[name])
        distance, angle = float(np.linalg.norm(away.translation)), float(_angle(away.rotation))
        if _kind(name) != _WEAK and (distance >= 1e-3 or angle >= np.deg2rad(1.0)):
            others[name] = (distance, angle)
    return Tip(tip, source if tip == plain else BY_NAME, others)


def _last_link(bodies: _Bodies, link: str) -> tuple[str, str]:
    """Return the last link fixed to a moving link, or the last before several parts."""
    tree = bodies.tree
    if bodies.exits[link]:
        return _fork(tree, link), "last link before several moving parts"
    while below := [one.child for one in tree.child_joints[link] if one.type == "fixed"]:
        following = [name for name in below if name == _next_number(link)]  # link7, link8
        if len(below) > 1 and not following:
            break
        link = (following or below)[0]
    return link, "last link"


def _next_number(name: str) -> str:
    """Return a name with the last number in it increased by one."""
    return re.sub(r"\d+(?=\D*$)", lambda found: str(int(found[0]) + 1), name)


def _fixed_frames(bodies: _Bodies, link: str) -> dict[str, pin.SE3]:
    """Return the pose of each link that is fixed to a moving link, relative to it."""
    frames = {link: pin.SE3.Identity()}
    for name in bodies.links[link][1:]:
        joint = bodies.tree.parent_joint[name]
        if joint.type == "fixed" and joint.parent in frames:
            placement = pin.SE3(pin.rpy.rpyToMatrix(*joint.rpy), np.array(joint.xyz))
            frames[name] = frames[joint.parent] * placement
    return frames


def _angle(R: np.ndarray) -> float:
    return float(np.linalg.norm(pin.log3(R)))


def _precedence(tree: UrdfTree, name: str) -> tuple[int, bool, int]:
    """Return the key by which tool frames are sorted: kind, plain name, outermost."""
    words, kind = re.sub(r"(?:_link|_frame)$", "", _words(name)), _kind(name) or 0
    plain = kind == _WEAK or any(
        m.end() == len(words) for m in re.finditer(_TOOL_FRAMES[kind], words)
    )
    return kind, not plain, -len(tree.path_to(name))


def _kind(link: str) -> int | None:
    """Return the rank of a link's name among those of tool frames; ``None`` if it is no such."""
    words = _words(link)
    for rank, pattern in enumerate(_TOOL_FRAMES):
        if re.search(pattern, words):
            return rank
    return _WEAK if re.search(_GRIPPER, words) else None


def _words(name: str) -> str:
    """Return a name in lower case, its words separated by underscores."""
    separated = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    return re.sub(r"[^a-z0-9]+", "_", separated.lower())


def _has_name(joints: Iterable[UrdfJoint], pattern: str) -> bool:
    return any(re.search(pattern, _words(name)) for one in joints for name in (one.name, one.child))
