"""Check that stored results belong to the current arm.

Joint names are not enough: those of a UR5 and a UR10 are the same.
"""

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

_TOLERANCE = 1e-5  # m, for an arm of a few metres stored in single precision


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
    if (joints, units) != (robot.names, robot.units):
        names, own = (", ".join(map(printable, x)) for x in (joints, robot.names))
        return f"belongs to another arm, with joints {names} instead of {own}"
    if setting.robot != robot.name:
        return (
            f"belongs to another arm, {printable(setting.robot)} instead of {printable(robot.name)}"
        )
    if (setting.base, setting.tip) != (robot.base, robot.tip):
        stored = f"--base {printable(setting.base)} --tip {printable(setting.tip)}"
        current = f"--base {printable(robot.base)} --tip {printable(robot.tip)}"
        return f"belongs to another chain, {stored} instead of {current}"
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
    _, tip = tip_pose(robot, q)
    distance = math.dist(tip, place)
    if distance <= _TOLERANCE * max(1.0, math.hypot(*place)):
        return ""
    return (
        f"belongs to another arm, or to one whose joints outside the chain are at other positions "
        f"(--posture): its tip is {distance:.2g} m away from that of this arm"
    )
