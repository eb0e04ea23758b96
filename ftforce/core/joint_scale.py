"""Weights of joints that turn against joints that slide (theory §2.7)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import Matrix, Vector, is_number, read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

DEFAULT_JOINT_LENGTH = 1.0
_SHORTEST, _LONGEST = 1e-6, 1e6  # m; outside this range, hinges or slides vanish in rounding error


@dataclass(frozen=True, eq=False)
class JointScale:
    """Joint weights c: 1/L at hinges and 1 at slides, where a chain has both.

    The Jacobian columns of hinges (m/rad) and slides (m/m) have different units but share singular
    values. The joint length L, in m per rad, says how far a slide has to move to count as much as
    1 rad. With C = diag(c), ``J̃ = J C``, ``τ̃ = C τ``, ``ṽ = C⁻¹ v`` and ``M̃ = C M C``, so that
    ``τ̃ = J̃ᵀF`` and ``J̃ ṽ = J v``: forces at the tip keep their meaning.

    Attributes
    ----------
    length :
        Joint length L, m per rad, from 1e-6 to 1e6.
    is_mixed :
        Whether the chain has both hinges and slides. If not, all columns have the same unit, the
        length has no effect.
    weights :
        The joint weights c, shape (n,); ``None`` if all are 1.
    """

    length: float = DEFAULT_JOINT_LENGTH
    is_mixed: bool = False
    weights: Vector | None = None

    @classmethod
    def of(cls, units: Iterable[str], length: float | None = None) -> JointScale:
        """Return the weights of the joints of a chain.

        Parameters
        ----------
        units :
            Units of the joint positions, ``rad`` or ``m``.
        length :
            Joint length, m per rad; 1 m by default.

        Raises
        ------
        InputError
            The length is not a number in range.
        """
        length = DEFAULT_JOINT_LENGTH if length is None else length
        if not is_number(length) or not _SHORTEST <= length <= _LONGEST:
            raise InputError(
                f"the joint length must lie between {_SHORTEST:g} and {_LONGEST:g} m (m of a slide "
                f"that weigh as much as 1 rad of a hinge), got {length}"
            )
        return _scale(tuple(units), float(length))

    @property
    def effective_length(self) -> float | None:
        """The joint length; ``None`` if it has no effect."""
        return self.length if self.is_mixed else None

    def weigh_jacobian(self, J: Matrix) -> Matrix:
        """Return J̃ = J C, shape (..., m, n).

        Parameters
        ----------
        J :
            Jacobian, shape (..., m, n).
        """
        return J if self.weights is None else J * self.weights

    def weigh_torque(self, torque: Vector) -> Vector:
        """Return τ̃ = C τ, shape (..., n).

        Parameters
        ----------
        torque :
            Joint torques or their limits, N·m (N), shape (..., n).
        """
        return torque if self.weights is None else torque * self.weights

    def unweigh_torque(self, torque: Vector) -> Vector:
        """Return τ = C⁻¹ τ̃, N·m (N), shape (..., n).

        Parameters
        ----------
        torque :
            Weighted joint torques, shape (..., n).
        """
        return torque if self.weights is None else torque / self.weights

    def weigh_velocity(self, v: Vector) -> Vector:
        """Return ṽ = C⁻¹ v, shape (..., n).

        Parameters
        ----------
        v :
            Joint positions or velocities, rad or m (per s), shape (..., n).
        """
        return v if self.weights is None else v / self.weights

    def unweigh_velocity(self, v: Vector) -> Vector:
        """Return v = C ṽ, rad or m (per s), shape (..., n).

        Parameters
        ----------
        v :
            Weighted joint positions or velocities, shape (..., n).
        """
        return v if self.weights is None else v * self.weights

    def weigh_mass_matrix(self, M: Matrix) -> Matrix:
        """Return M̃ = C M C, shape (n, n).

        Parameters
        ----------
        M :
            Mass matrix, shape (n, n).
        """
        return M if self.weights is None else M * np.outer(self.weights, self.weights)


@lru_cache(maxsize=64)  # the same for millions of postures
def _scale(units: tuple[str, ...], length: float) -> JointScale:
    is_mixed, weights = len(set(units)) > 1, None
    if is_mixed and length != 1.0:
        weights = read_only(np.array([1.0 if unit == "m" else 1.0 / length for unit in units]))
    return JointScale(length, is_mixed, weights)


UNWEIGHTED = JointScale()
"""Of a chain whose joints all turn or all slide."""
