"""What motors and brakes can bear: torque limits, known or unknown, and faults in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.arrays import Vector, as_floats, read_only
from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.faults import FaultSet


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
        motors = _checked(effort, "effort limits")
        brakes = np.full(len(motors), np.nan) if brake is None else _checked(brake, "brake limits")
        if len(brakes) != len(motors):
            raise DimensionError("brake limits", motors.shape, brakes.shape, "one per joint")
        return cls(read_only(motors), read_only(brakes), source)

    def largest_torques(self, faults: FaultSet) -> Vector:
        """Return what each joint can bear with these faults, NaN where unknown, shape (n,).

        A locked joint bears what its brake does, a weak one its share, a free one nothing.
        """
        n = len(self.effort)
        factors = faults.factors(n)
        motors = np.where(factors > 0.0, self.effort * factors, 0.0)  # no torque needs no limit
        return read_only(np.where(faults.mask(n), self.brake, motors))


def _checked(limits: ArrayLike, name: str) -> Vector:
    values = as_floats(limits, name)
    if values.ndim != 1:
        raise InputError(f"{name} need one number per joint, got an array of shape {values.shape}")
    if not np.all((values > 0.0) | np.isnan(values)):
        raise InputError(f"{name} must be positive, NaN where unknown; got {values.tolist()}")
    values[np.isinf(values)] = np.nan
    return values
