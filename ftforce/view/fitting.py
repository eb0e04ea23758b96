"""Whether what was stored is of the arm at hand: names alone do not tell a UR5 from a UR10."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import printable
from ftforce.kinematics import tip_pose

if TYPE_CHECKING:
    from ftforce.arrays import Vector
    from ftforce.robot import Robot

_SAME = 1e-5  # m: stored in single precision, an arm of some metres is known to this


class Stored(NamedTuple):
    """The arm of a history or of a sweep.

    Attributes
    ----------
    robot, base, tip :
        Names.
    joints, units :
        Of the chain, ``rad`` or ``m``.
    """

    robot: str
    base: str
    tip: str
    joints: tuple[str, ...]
    units: tuple[str, ...]


def difference(robot: Robot, stored: Stored) -> str:
    """Say how the arm that was stored differs from the one at hand; empty if it does not."""
    units = tuple(joint.unit for joint in robot.joints)
    if (stored.joints, stored.units) != (robot.names, units):
        names, own = (", ".join(map(printable, x)) for x in (stored.joints, robot.names))
        return f"is of another arm: its joints are {names}; here: {own}"
    if stored.robot != robot.name:
        return f"is of another arm, {printable(stored.robot)}; here: {printable(robot.name)}"
    if (stored.base, stored.tip) != (robot.base, robot.tip):
        there = f"--base {printable(stored.base)} --tip {printable(stored.tip)}"
        here = f"{printable(robot.base)} to {printable(robot.tip)}"
        return f"is of another chain: {there}; here: {here}"
    return ""


def displacement(robot: Robot, q: Vector, place: Vector) -> str:
    """Say how far the tip is from where it was stored; empty if it is there.

    Parameters
    ----------
    robot :
        The arm at hand.
    q :
        Joint positions, rad or m, shape (n,).
    place :
        Where the tip was then, in the root's axes, m, shape (3,).
    """
    _, here = tip_pose(robot, q)
    distance = math.dist(here, place)
    if distance <= _SAME * max(1.0, math.hypot(*place)):
        return ""
    return (
        f"is of another arm, or of one whose other joints are held elsewhere (--posture): its tip "
        f"was {distance:.2g} m away from where this arm has it"
    )
