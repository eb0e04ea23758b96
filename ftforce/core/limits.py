"""Torque limits of motors and brakes, known or unknown, and the effect of faults on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import Vector, as_floats, read_only
from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

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
    brake :
        Brake limits, shape (n,).
    source :
        Origin of the limits: ``urdf``, a file, or ``given``.
    """

    effort: Vector
    brake: Vector
    source: str = "given"

    @classmethod
    def of(cls, effort: ArrayLike, brake: ArrayLike | None = None, source: str = "given") -> Limits:
        """Return validated limits.

        Parameters
        ----------
        effort, brake :
            Motor and brake limits, positive, NaN where unknown, shape (n,). If ``brake`` is not
            given, all brake limits are unknown.
        source :
            Origin of the limits.

        Raises
        ------
        InputError
            A limit is not positive, or the two have different lengths.
        """
        motors = checked_limits(effort, "effort limits")
        brakes = (
            np.full(len(motors), np.nan) if brake is None else checked_limits(brake, "brake limits")
        )
        if len(brakes) != len(motors):
            raise DimensionError("brake limits", motors.shape, brakes.shape, "one per joint")
        return cls(read_only(motors), read_only(brakes), source)

    def largest_torques(self, faults: FaultSet) -> Vector:
        """Return the maximum torque of each joint after the given faults, shape (n,).

        This is the brake limit at a locked joint, the reduced motor limit at a weak joint, and 0
        at a free-swinging joint; NaN where unknown.

        Parameters
        ----------
        faults :
            The fault set.

        Raises
        ------
        InputError
            A joint index is out of range.
        """
        n = len(self.effort)
        factors = faults.factors(n)
        # Avoid underflow to 0, which would mean a free-swinging joint.
        motors = np.maximum(self.effort * factors, _SMALLEST)
        motors = np.where(factors > 0.0, motors, 0.0)  # also 0 where the limit is unknown
        return read_only(np.where(faults.mask(n), self.brake, motors))


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
