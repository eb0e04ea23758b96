"""Joints that cannot move: equal position limits, which URDFs use for two different purposes.

A joint whose limits are equal is a fixed joint in disguise, e.g. an anchor, or a sensor that a
simulator would otherwise merge with its neighbour: it is held at that position. But exporters also
write 0 and 0 for limits that nobody filled in. They do so for (nearly) all joints, so where more
than half of the joints between the root and the end of a branch have 0 and 0, these limits count as
unknown.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ftforce.errors import listed
from ftforce.robot.formats.tree import LIMITED, build_tree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree

_SLACK = 1e-6  # rad or m; closer limits are equal


def interpret_limits(tree: UrdfTree) -> UrdfTree:
    """Return the tree with joints of equal limits fixed, and without limits left at 0.

    Mimic joints that follow a held joint are held, too.
    """
    equal = {joint.name: joint for joint in tree.joints.values() if _has_equal_limits(joint)}
    unfilled = _unfilled(tree, equal)
    held = {name: _position(joint) for name, joint in equal.items() if name not in unfilled}
    joints = dict(tree.joints)
    for joint in tree.joints.values():
        if joint.name in unfilled:
            joints[joint.name] = joint._replace(lower=None, upper=None)
        elif joint.name in held:
            joints[joint.name] = _fixed(joint, held[joint.name])
        elif joint.mimic is not None and joint.mimic.leader in held:
            position = joint.mimic.multiplier * held[joint.mimic.leader] + joint.mimic.offset
            joints[joint.name] = _fixed(joint, position)
    notes = []
    if absent := _absent(tree):
        notes.append(f"position limits are missing, which counts as unknown: {listed(absent)}")
    if unfilled:
        notes.append(f"position limits are 0 and 0, which counts as unknown: {listed(unfilled)}")
    if held:
        words = (f"{name} at {position:g}" for name, position in held.items())
        notes.append(f"held fixed, as the lower limit equals the upper one: {listed(words)}")
    tree = replace(tree, notes=(*tree.notes, *notes)) if notes else tree
    if joints == tree.joints:
        return tree
    built = build_tree(tree.path, tree.name, tree.links, joints, flaws=tree.flaws, notes=tree.notes)
    return replace(built, states=tree.states, gravity=tree.gravity, incomplete=tree.incomplete)


def _absent(tree: UrdfTree) -> list[str]:
    """Return the joints of limited range without limits, except for malformed ones."""
    flawed = {flaw.name for flaw in tree.flaws if flaw.kind == "joint"}
    return [
        joint.name
        for joint in tree.joints.values()
        if joint.type in LIMITED and joint.lower is None and joint.mimic is None
        if joint.name not in flawed
    ]


def _has_equal_limits(joint: UrdfJoint) -> bool:
    if joint.mimic is not None or joint.lower is None or joint.upper is None:
        return False
    return joint.upper - joint.lower < _SLACK


def _position(joint: UrdfJoint) -> float:
    """Return the position, rad or m, of a joint with equal limits."""
    assert joint.lower is not None
    return joint.lower


def _unfilled(tree: UrdfTree, equal: dict[str, UrdfJoint]) -> list[str]:
    """Return the joints whose limits of 0 and 0 stand for unknown limits."""
    zero = {name for name, joint in equal.items() if joint.lower == joint.upper == 0.0}
    found: dict[str, None] = {}
    for branch in _branches(tree) if zero else ():
        limited = [one.name for one in branch if one.mimic is None and one.lower is not None]
        without = [name for name in limited if name in zero]
        if 2 * len(without) > len(limited):
            found |= dict.fromkeys(without)
    return [name for name in tree.joints if name in found]


def _branches(tree: UrdfTree) -> Iterator[tuple[UrdfJoint, ...]]:
    """Yield the joints from the root to the end of every branch."""
    for link, below in tree.child_joints.items():
        if not below:
            yield tree.path_to(link)


def _fixed(joint: UrdfJoint, position: float) -> UrdfJoint:
    """Return a fixed joint in the place of one that is held at a position, rad or m."""
    import pinocchio as pin

    at = pin.SE3(pin.rpy.rpyToMatrix(*joint.rpy), np.array(joint.xyz))
    axis = np.array(joint.axis)
    moved = joint._replace(type="fixed", lower=None, upper=None, mimic=None)
    if position == 0.0:
        return moved
    if joint.type == "prismatic":
        shift = at.act(position * axis)
        return moved._replace(xyz=tuple(shift.tolist()))
    turned = at.rotation @ pin.AngleAxis(position, axis).matrix()
    return moved._replace(rpy=tuple(pin.rpy.matrixToRpy(turned).tolist()))
