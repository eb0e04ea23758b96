"""Whether stored results belong to the current arm; joint names do not tell a UR5 from a UR10."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.errors import printable
from ftforce.robot.kinematics import tip_pose

if TYPE_CHECKING:
    from ftforce.batch.result import SweepSetting
    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import Setting

_SAME = 1e-5  # m: accuracy of single-precision storage for an arm of a few metres


def difference(
    robot: Robot, setting: Setting | SweepSetting, joints: tuple[str, ...], units: tuple[str, ...]
) -> str:
    """Return how the arm of a stored result differs from the current one; empty if it does not.

    Parameters
    ----------
    robot :
        The current arm.
    setting :
        Setting of the stored result, which names its arm.
    joints, units :
        Joint names of the stored chain and their units, ``rad`` or ``m``.
    """
    if (joints, units) != (robot.names, tuple(joint.unit for joint in robot.joints)):
        names, own = (", ".join(map(printable, x)) for x in (joints, robot.names))
        return f"is of another arm: its joints are {names}; here: {own}"
    if setting.robot != robot.name:
        return f"is of another arm, {printable(setting.robot)}; here: {printable(robot.name)}"
    if (setting.base, setting.tip) != (robot.base, robot.tip):
        there = f"--base {printable(setting.base)} --tip {printable(setting.tip)}"
        here = f"{printable(robot.base)} to {printable(robot.tip)}"
        return f"is of another chain: {there}; here: {here}"
    return ""


def displacement(robot: Robot, q: Vector, place: Vector) -> str:
    """Return how far the tip is from its stored position, in words; empty if it agrees.

    Parameters
    ----------
    robot :
        The current arm.
    q :
        Joint positions, rad or m, shape (n,).
    place :
        Stored tip position in root axes, m, shape (3,).
    """
    _, here = tip_pose(robot, q)
    distance = math.dist(here, place)
    if distance <= _SAME * max(1.0, math.hypot(*place)):
        return ""
    return (
        f"is of another arm, or of one whose other joints are held elsewhere (--posture): its tip "
        f"was {distance:.2g} m away from where this arm has it"
    )
