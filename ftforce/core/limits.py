"""Torque limits of motors and brakes, known or unknown, and the effect of faults on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Vector, as_floats, read_only
from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.core.arrays import Mask
    from ftforce.core.faults import FaultSet

_LARGEST = 1e150  # N·m: sums and squares stay finite
_SMALLEST = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Maximum motor and brake torques, N·m (N for prismatic joints); NaN where unknown.

    Unknown limits are never active, and are reported wherever limits are shown.

    Attributes
    ----------
    effort :
        Motor limits, shape (n,).
        Where the lower limit differs, the upper one.
    brake :
        Brake limits, shape (n,).
    source :
        Origin of the limits: ``urdf``, a file, or ``given``.
    lower :
        Lower motor limits, negative, NaN where unknown, shape (n,); ``None`` if they are
        ``-effort``.
    line :
        Torque-speed lines of the motors; ``None`` if there are none.
    terms :
        Friction, damping and armature that the file contains; ``None`` if it has none.
    notes :
        Remarks on the file.
    """

    effort: Vector
    brake: Vector
    source: str = "given"
    lower: Vector | None = None
    line: TorqueSpeedLine | None = None
    terms: DriveTerms | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        effort: ArrayLike,
        brake: ArrayLike | None = None,
        source: str = "given",
        *,
        lower: ArrayLike | None = None,
        line: TorqueSpeedLine | None = None,
    ) -> Limits:
        """Return validated limits.

        Parameters
        ----------
        effort, brake :
            Motor and brake limits, positive, NaN where unknown, shape (n,). If ``brake`` is not
            given, all brake limits are unknown.
        source :
            Origin of the limits.
        lower :
            Lower motor limits, negative, NaN where unknown, shape (n,), where they are not
            ``-effort``; then ``effort`` are the upper ones.
        line :
            Torque-speed lines of the motors.

        Raises
        ------
        InputError
            A limit is not positive, or a lower one not negative, or only one of the two is known,
            or the lengths differ.
        """
        motors = checked_limits(effort, "effort limits")
        brakes = (
            np.full(len(motors), np.nan) if brake is None else checked_limits(brake, "brake limits")
        )
        if len(brakes) != len(motors):
            raise DimensionError("brake limits", motors.shape, brakes.shape, "one per joint")
        if line is not None and line.stall_torque.shape != motors.shape:
            raise DimensionError(
                "torque-speed lines", motors.shape, line.stall_torque.shape, "one per joint"
            )
        below = None
        if lower is not None:
            below = -checked_limits(-as_floats(lower, "lower limits"), "lower limits, negated,")
            if below.shape != motors.shape:
                raise DimensionError("lower limits", motors.shape, below.shape, "one per joint")
            if (np.isnan(below) != np.isnan(motors)).any():
                raise InputError("a joint needs both a lower and an upper limit, or neither")
            below = None if np.array_equal(below, -motors, equal_nan=True) else read_only(below)
        return cls(read_only(motors), read_only(brakes), source, below, line)

    @property
    def is_known(self) -> Mask:
        """Whether a limit of each motor is known, shape (n,)."""
        return ~np.isnan(self.motor_bounds()[1])

    def motor_bounds(self, v: Vector | None = None) -> tuple[Vector, Vector]:
        """Return the lower and the upper torque of each motor, NaN where unknown, shapes (..., n).

        Parameters
        ----------
        v :
            Joint velocities, rad/s or m/s, shape (..., n); at rest by default.
        """
        upper = self.effort
        lower = -upper if self.lower is None else self.lower
        if self.line is not None:
            drive, brake = self.line.at(np.zeros(len(upper)) if v is None else v)
            upper, lower = np.fmin(upper, drive), np.fmax(lower, -brake)
        return lower, upper

    def largest_torques(self, faults: FaultSet, v: Vector | None = None) -> Vector:
        """Return the maximum torque of each joint after the given faults, shape (n,).

        This is the brake limit at a locked joint, the reduced motor limit at a weak joint, and 0
        at a free-swinging joint; NaN where unknown. If lower and upper limits differ, both of them
        are returned, as rows, shape (2, n).

        Parameters
        ----------
        faults :
            The fault set.
        v :
            Joint velocities, rad/s or m/s, shape (n,); at rest by default.

        Raises
        ------
        InputError
            A joint index is out of range.
        """
        if self.lower is None and self.line is None:
            return read_only(self._after(faults, self.effort))
        least, most = self.bounds_after(faults, v)
        if np.array_equal(least, -most, equal_nan=True):
            return read_only(most)
        return read_only(np.array([least, most]))

    def bounds_after(self, faults: FaultSet, v: Vector | None = None) -> tuple[Vector, Vector]:
        """Return the lower and the upper torque of each joint after the given faults.

        Parameters
        ----------
        faults :
            The fault set.
        v :
            Joint velocities, rad/s or m/s, shape (..., n); at rest by default.

        Returns
        -------
        :
            As in `largest_torques`; shapes (..., n), without a line (n,).
        """
        lower, upper = self.motor_bounds(v)
        return -self._after(faults, -lower), self._after(faults, upper)

    def _after(self, faults: FaultSet, most: Vector) -> Vector:
        """Return the limits in one direction after faults, from those of the healthy motors."""
        n = most.shape[-1]
        factors = faults.factors(n)
        # Avoid underflow to 0, which would mean a free-swinging joint.
        motors = np.maximum(most * factors, _SMALLEST)
        motors = np.where(factors > 0.0, motors, 0.0)  # also 0 where the limit is unknown
        return np.where(faults.mask(n), self.brake, motors)


@dataclass(frozen=True, slots=True, eq=False)
class TorqueSpeedLine:
    """Straight lines from the stall torque at rest to none at the no-load speed; NaN for no line.

    A motor that drives its joint in the direction of motion has at most
    ``stall_torque · (1 - |v| / no_load_speed)``, and nothing beyond the no-load speed. A motor that
    brakes has at most the stall torque.

    Attributes
    ----------
    stall_torque :
        N·m (N), shape (n,).
    no_load_speed :
        rad/s (m/s), shape (n,).
    """

    stall_torque: Vector
    no_load_speed: Vector

    @classmethod
    def of(cls, stall_torque: ArrayLike, no_load_speed: ArrayLike) -> TorqueSpeedLine:
        """Return validated lines.

        Parameters
        ----------
        stall_torque, no_load_speed :
            Positive, NaN where a joint has no line, shape (n,).

        Raises
        ------
        InputError
            A number is not positive, a joint has only one of the two, or the lengths differ.
        """
        stall = checked_limits(stall_torque, "stall torques")
        speed = checked_limits(no_load_speed, "no-load speeds")
        if stall.shape != speed.shape:
            raise DimensionError("no-load speeds", stall.shape, speed.shape, "one per joint")
        if (np.isnan(stall) != np.isnan(speed)).any():
            raise InputError("a torque-speed line needs both stall_torque and no_load_speed")
        return cls(read_only(stall), read_only(speed))

    def at(self, v: Vector) -> tuple[Vector, Vector]:
        """Return the largest torques in the positive and in the negative direction, as v is.

        Parameters
        ----------
        v :
            Joint velocities, rad/s or m/s, shape (..., n).
        """
        positive, negative = (
            self.stall_torque * (1.0 - np.clip(x / self.no_load_speed, 0.0, 1.0)) for x in (v, -v)
        )
        return positive, negative


class DriveTerms(NamedTuple):
    """What a joint's drive adds to the dynamics of the links, per joint, shape (n,).

    Attributes
    ----------
    friction :
        Coulomb friction, N·m (N).
    damping :
        Viscous friction, N·m·s/rad (N·s/m).
    armature :
        Rotor inertia reflected to the joint, kg·m² (kg).
    """

    friction: Vector
    damping: Vector
    armature: Vector

    def torque(self, v: Vector, a: Vector) -> Vector:
        """Return ``armature · a + damping · v + friction · sign(v)``, shape (..., n).

        Parameters
        ----------
        v, a :
            Joint velocities and accelerations, shape (..., n).
        """
        torque: Vector = self.armature * a + self.damping * v + self.friction * np.sign(v)
        return torque

    def without_friction(self, mask: Mask) -> DriveTerms:
        """Return the terms without the friction of some joints.

        Parameters
        ----------
        mask :
            True at these joints, shape (..., n).
        """
        friction, damping = (np.where(mask, 0.0, x) for x in (self.friction, self.damping))
        return DriveTerms(friction, damping, self.armature)


def both_sides(largest: Vector) -> tuple[Vector, Vector]:
    """Return lower and upper torque limits, each of shape (..., n).

    Parameters
    ----------
    largest :
        Largest torques, shape (n,), or lower and upper limits as rows, shape (2, n).
    """
    return (-largest, largest) if largest.ndim == 1 else (largest[0], largest[1])


def middle_and_half(largest: Vector) -> tuple[Vector, Vector]:
    """Return the middle and half the width between torque limits, each of shape (..., n).

    ``lower ≤ τ ≤ upper`` is ``|τ - middle| ≤ half``: a kernel for symmetric limits needs the middle
    only as part of the torques for weight and motion, ``(rnea - middle) + JᵀF``.

    Parameters
    ----------
    largest :
        As in `both_sides`; lower and upper limits may have any shape (2, ..., n).
    """
    if largest.ndim == 1:
        return np.zeros_like(largest), largest
    lower, upper = largest
    middle = 0.5 * (lower + upper)
    return np.where(np.isnan(middle), 0.0, middle), 0.5 * (upper - lower)


def checked_limits(limits: ArrayLike, name: str) -> Vector:
    """Return a validated copy of limits, NaN where unknown or infinite.

    Parameters
    ----------
    limits :
        Torque limits, N·m or N, shape (n,).
    name :
        Name of the limits, for error messages.

    Raises
    ------
    InputError
        The limits are not a vector of positive numbers, or too large.
    """
    values = as_floats(limits, name)
    if values.ndim != 1:
        raise InputError(f"{name} need one number per joint, got an array of shape {values.shape}")
    numbers = values.tolist()  # faster than NumPy for a few joints; NaN passes the comparison
    if any(x <= 0.0 for x in numbers):
        raise InputError(f"{name} must be positive, NaN where unknown; got {numbers}")
    if any(_LARGEST < x < math.inf for x in numbers):
        raise InputError(f"{name} contain numbers too large to compute with; got {numbers}")
    if math.inf in numbers:
        values[np.isinf(values)] = np.nan
    return values
