"""Friction and rotor inertia of the drives, counted on request (docs/conventions)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.core.limits import DriveTerms
from ftforce.errors import InputError, listed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Mask, Vector
    from ftforce.core.limits import Limits
    from ftforce.robot.robot import Robot


class Drives(NamedTuple):
    """What the drives add to the torques and to the mass matrix.

    Attributes
    ----------
    terms :
        Friction, damping and armature of each joint; 0 where unknown or not requested.
    has_friction, has_armature :
        Whether friction (Coulomb and viscous) and rotor inertia were requested.
    unknown_friction, unknown_armature :
        Names of the joints of which they are unknown.
    """

    terms: DriveTerms
    has_friction: bool
    has_armature: bool
    unknown_friction: tuple[str, ...]
    unknown_armature: tuple[str, ...]

    def after(self, free: Mask | None) -> DriveTerms:
        """Return the terms after a fault, without the friction of free-swinging joints.

        Parameters
        ----------
        free :
            True at the free-swinging joints, shape (n,); ``None`` if there are none.
        """
        return self.terms if free is None else self.terms.without_friction(free)

    def __str__(self) -> str:
        """Say what is counted."""
        friction = ["joint friction (Coulomb and viscous)"] if self.has_friction else []
        return " and ".join([*friction, *(["rotor inertia"] if self.has_armature else [])])

    def warnings(self) -> Iterator[str]:
        """Yield warnings about joints of which nothing is known."""
        if self.has_friction and self.unknown_friction:
            yield f"unknown joint friction counts as zero: {listed(self.unknown_friction)}"
        if self.has_armature and self.unknown_armature:
            yield f"unknown rotor inertia counts as zero: {listed(self.unknown_armature)}"


def choose_drives(
    robot: Robot, limits: Limits | None, *, joint_friction: bool, armature: bool
) -> Drives | None:
    """Return what the drives add; ``None`` if nothing is requested.

    Parameters
    ----------
    robot :
        The arm.
    limits :
        Torque limits in force; what their file says of drives precedes the URDF.
    joint_friction :
        Whether Coulomb and viscous friction count.
    armature :
        Whether rotor inertia counts.

    Raises
    ------
    InputError
        A switch is neither true nor false.
    """
    for name, value in (("joint_friction", joint_friction), ("armature", armature)):
        if not isinstance(value, (bool, np.bool_)):
            raise InputError(f"{name} must be True or False, got {value!r}")
    if not (joint_friction or armature):
        return None
    found = DriveTerms(robot.friction, robot.damping, robot.armature)
    if limits is not None and limits.terms is not None:
        pairs = zip(limits.terms, found, strict=True)
        found = DriveTerms(*(np.where(np.isnan(own), urdf, own) for own, urdf in pairs))
    is_known = [~np.isnan(x) for x in found]
    friction, damping, rotors = (np.nan_to_num(x) for x in found)
    off = np.zeros(robot.n)

    def without(known: Mask) -> tuple[str, ...]:
        return tuple(name for name, has in zip(robot.names, known.tolist(), strict=True) if not has)

    def switched(values: Vector, is_on: bool) -> Vector:
        return read_only(values if is_on else off.copy())

    terms = DriveTerms(
        switched(friction, joint_friction),
        switched(damping, joint_friction),
        switched(rotors, armature),
    )
    unknown = without(is_known[0] | is_known[1]), without(is_known[2])
    return Drives(terms, bool(joint_friction), bool(armature), *unknown)
