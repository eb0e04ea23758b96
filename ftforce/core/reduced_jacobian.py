"""The reduced Jacobian K = ᔆJ of eq. (8)-(16), decomposed once for everything that follows.

Columns of locked joints are zeroed rather than dropped: range, projector and singular values are
the same, and every vector keeps one number per joint.

A joint without torque (free-swinging) cannot balance anything: of the forces in the range of K
only those are left that need no torque at it, ``J_kᵀ F' = 0`` apart from its weight. So K is
projected onto the complement of the swinging columns, and every law that holds for K goes on.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Mask, Matrix, Vector, as_floats, check_finite, read_only
from ftforce.core.svd import Svd
from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

RTOL = 1e-6
"""Default rank tolerance, relative to σ_max of the healthy arm: URDFs carry rounded angles."""

BORDERLINE_RTOL = 1e-2
"""Default upper end of the tolerances that are tried before a verdict counts as certain."""


class Swinging(NamedTuple):
    """The columns of joints without torque, decomposed.

    Attributes
    ----------
    joints :
        Their indices, f of them.
    U, s, Vt :
        Singular value decomposition of the columns J_S: (m, m), (min(m, f),) and (f, f).
    rank :
        Number of singular values above ``rtol · σ_max(J)``.
    """

    joints: list[int]
    U: Matrix
    s: Vector
    Vt: Matrix
    rank: int

    def support(self, rnea: Vector) -> Vector:
        """Return the smallest force that balances the joints, -(J_Sᵀ)† [rnea]_S, shape (m,)."""
        r = self.rank
        force: Vector = -self.U[:, :r].dot(self.Vt[:r].dot(rnea[self.joints]) / self.s[:r])
        return force

    def unbalanced(self, rnea: Vector) -> Vector:
        """Return the torque at the joints that no force at the tip balances, shape (f,)."""
        V = self.Vt[self.rank :]
        torque: Vector = V.dot(rnea[self.joints]).dot(V)
        return torque


class ReducedJacobian(NamedTuple):
    """Jacobian before and after joints fail, with the ranks that one tolerance gives them.

    Attributes
    ----------
    healthy :
        Decomposition of the weighted task Jacobian J, shape (m, n).
    damaged :
        Decomposition of K, shape (m, n): J with the columns of locked joints zeroed, and projected
        onto the complement of the columns of joints without torque.
    locked :
        True at locked joints, shape (n,).
    rank, rank_after :
        Number of singular values above ``rtol · σ_max(J)`` of J and of K.
    rtol :
        The tolerance.
    swinging :
        The joints without torque; ``None`` if there are none.
    """

    healthy: Svd
    damaged: Svd
    locked: Mask
    rank: int
    rank_after: int
    rtol: float
    swinging: Swinging | None = None

    @property
    def J(self) -> Matrix:
        """Weighted task Jacobian of the healthy arm, shape (m, n)."""
        return self.healthy.A

    @property
    def K(self) -> Matrix:
        """The reduced Jacobian, shape (m, n)."""
        return self.damaged.A

    @property
    def commanding(self) -> Mask:
        """True at the joints whose motors still give torque, shape (n,)."""
        mask = ~self.locked
        if self.swinging is not None:
            mask[self.swinging.joints] = False
        return mask

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


def reduce(
    J: Matrix, locked: Mask, rtol: float = RTOL, swinging: Mask | None = None
) -> ReducedJacobian:
    """Decompose J and K. The arguments are trusted: see `check_core_input`."""
    return reduce_decomposed(Svd(J), locked, rtol, swinging)


def reduce_decomposed(
    healthy: Svd, locked: Mask, rtol: float, swinging: Mask | None = None
) -> ReducedJacobian:
    """Decompose K for one of many fault sets of a Jacobian that is decomposed already."""
    lost = rtol * healthy.s[0]  # all ranks are judged by the healthy arm
    damaged, columns = healthy, None
    if True in locked.tolist():
        K = healthy.A.copy()
        np.copyto(K, 0.0, where=locked)  # eq. (25), (26)
        damaged = Svd(read_only(K), left_only=True)
    if swinging is not None:
        columns = _swinging(healthy.A, swinging, lost)
        U = columns.U[:, columns.rank :]
        K = U.dot(U.T.dot(damaged.A))  # (I - J_S J_S†) K
        np.copyto(K, 0.0, where=swinging)
        damaged = Svd(read_only(K), left_only=True)
    return ReducedJacobian(
        healthy, damaged, locked, healthy.rank(lost), damaged.rank(lost), rtol, columns
    )


def _swinging(J: Matrix, mask: Mask, lost: float) -> Swinging:
    joints = np.flatnonzero(mask).tolist()
    U, s, Vt = np.linalg.svd(J[:, joints])
    return Swinging(joints, U, s, Vt, int(np.count_nonzero(s > lost)))


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
    return read_only(J), check_mask(locked, J.shape[1], "locked")


def check_mask(joints: ArrayLike, n: int, name: str) -> Mask:
    """Check a mask of joints that comes from outside, one entry per column of J.

    Raises
    ------
    InputError
        The mask is not boolean, or has not n entries.
    """
    mask = np.array(joints)
    if mask.dtype != np.bool_:
        raise InputError(
            f"{name} needs a boolean mask of shape ({n},), one entry per column of J, "
            f"got {joints!r}; joint numbers and names are for analyze()"
        )
    if mask.shape != (n,):
        raise DimensionError(name, (n,), mask.shape, "one entry per column of J")
    return read_only(mask)


def check_tolerances(rtol: float, wary: float = BORDERLINE_RTOL) -> None:
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
