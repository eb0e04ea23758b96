"""The reduced Jacobian K = ᔆJ of eq. (8)-(16), decomposed once for everything that follows.

Columns of locked joints are zeroed rather than dropped: range, projector and singular values are
the same, and every vector keeps one number per joint.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.arrays import Mask, Matrix, Svd, as_floats, check_finite, read_only
from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

RTOL = 1e-6
"""Default rank tolerance, relative to σ_max of the healthy arm: URDFs carry rounded angles."""

WARY = 1e-2
"""Default upper end of the tolerances that are tried before a verdict counts as certain."""


class ReducedJacobian(NamedTuple):
    """Jacobian before and after joints lock, with the ranks that one tolerance gives them.

    Attributes
    ----------
    healthy :
        Decomposition of the weighted task Jacobian J, shape (m, n).
    damaged :
        Decomposition of K, which is J with the columns of locked joints zeroed, shape (m, n).
    locked :
        True at locked joints, shape (n,).
    rank, rank_after :
        Number of singular values above ``rtol · σ_max(J)`` of J and of K.
    rtol :
        The tolerance.
    """

    healthy: Svd
    damaged: Svd
    locked: Mask
    rank: int
    rank_after: int
    rtol: float

    @property
    def J(self) -> Matrix:
        """Weighted task Jacobian of the healthy arm, shape (m, n)."""
        return self.healthy.A

    @property
    def K(self) -> Matrix:
        """The same with the columns of locked joints zeroed, shape (m, n)."""
        return self.damaged.A

    @property
    def sigma_max(self) -> float:
        """Largest singular value of J, the scale of every tolerance."""
        return self.healthy.s[0]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.locked)

    @property
    def m(self) -> int:
        """Number of task rows."""
        return len(self.healthy.s)


def reduce(J: Matrix, locked: Mask, rtol: float = RTOL) -> ReducedJacobian:
    """Decompose J and K. The arguments are trusted: see `check_core_input`."""
    return reduce_decomposed(Svd(J), locked, rtol)


def reduce_decomposed(healthy: Svd, locked: Mask, rtol: float) -> ReducedJacobian:
    """Decompose K for one of many fault sets of a Jacobian that is decomposed already."""
    damaged = healthy
    if True in locked.tolist():
        K = healthy.A.copy()
        np.copyto(K, 0.0, where=locked)  # eq. (25), (26)
        damaged = Svd(read_only(K), left_only=True)
    lost = rtol * healthy.s[0]  # both ranks are judged by the healthy arm
    return ReducedJacobian(healthy, damaged, locked, healthy.rank(lost), damaged.rank(lost), rtol)


def check_core_input(J: ArrayLike, locked: ArrayLike) -> tuple[Matrix, Mask]:
    """Check a Jacobian and a mask that come from outside.

    Parameters
    ----------
    J :
        Task Jacobian, shape (m, n), m ≤ 6 not required.
    locked :
        Boolean mask, shape (n,).

    Raises
    ------
    DimensionError
        J is no matrix, or the mask has another length than J has columns.
    InputError
        J holds NaN or infinity, or the mask is not boolean.
    """
    J = as_floats(J, "J")  # a copy: results keep it
    if J.ndim != 2 or not J.size:
        raise InputError(f"J needs the shape (m, n), got {J.shape}")
    check_finite(J, "J")
    mask = np.array(locked)
    if mask.dtype != np.bool_:
        raise InputError(
            f"locked needs a boolean mask of shape ({J.shape[1]},), one entry per column of J, "
            f"got {locked!r}; joint numbers and names are for analyze()"
        )
    if mask.shape != (J.shape[1],):
        raise DimensionError("locked", (J.shape[1],), mask.shape, "one entry per column of J")
    return read_only(J), read_only(mask)


def check_tolerances(rtol: float, wary: float = WARY) -> None:
    """Check the rank tolerance and the upper end of the wary range.

    Raises
    ------
    InputError
        Not ``1e-14 ≤ rtol ≤ wary < 1``.
    """
    if not (math.isfinite(rtol) and 1e-14 <= rtol < 1.0):
        raise InputError(f"rtol must lie between 1e-14 and 1, got {rtol}")
    if not (math.isfinite(wary) and rtol <= wary < 1.0):
        raise InputError(f"wary must lie between rtol = {rtol:g} and 1, got {wary}")
