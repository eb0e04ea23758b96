"""What motors and brakes can bear: torque limits, known or unknown, and faults in them."""

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

_LEAST = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Largest torques of an arm's motors and brakes, N·m (N if prismatic); NaN where unknown.

    An unknown limit counts as none: it never binds, and it is named wherever limits are shown.

    Attributes
    ----------
    effort :
        Of the motors, shape (n,).
    brake :
        Of the brakes, shape (n,).
    source :
        Where they come from: ``urdf``, a file, ``given``.
    """

    effort: Vector
    brake: Vector
    source: str = "given"

    @classmethod
    def of(cls, effort: ArrayLike, brake: ArrayLike | None = None, source: str = "given") -> Limits:
        """Check limits and wrap them.

        Parameters
        ----------
        effort, brake :
            Shape (n,), positive; NaN where unknown. Without ``brake`` all are unknown.
        source :
            Where they come from.

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
        """Return what each joint can bear with these faults, NaN where unknown, shape (n,).

        A locked joint bears what its brake does, a weak one its share, a free one nothing.
        """
        n = len(self.effort)
        factors = faults.factors(n)
        # A product that vanishes is no torque at all, which only a factor of 0 means.
        motors = np.maximum(self.effort * factors, _LEAST)
        motors = np.where(factors > 0.0, motors, 0.0)  # no torque needs no limit
        return read_only(np.where(faults.mask(n), self.brake, motors))


def checked_limits(limits: ArrayLike, name: str) -> Vector:
    """Return a copy of limits, NaN where they are unknown or infinite.

    Raises
    ------
    InputError
        No vector of numbers, or one that is not positive.
    """
    values = as_floats(limits, name)
    if values.ndim != 1:
        raise InputError(f"{name} need one number per joint, got an array of shape {values.shape}")
    numbers = values.tolist()  # of a handful; NaN is neither zero nor less
    if any(x <= 0.0 for x in numbers):
        raise InputError(f"{name} must be positive, NaN where unknown; got {numbers}")
    if math.inf in numbers:
        values[np.isinf(values)] = np.nan
    return values
