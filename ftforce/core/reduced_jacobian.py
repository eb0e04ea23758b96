"""The reduced Jacobian K = ᔆJ of eq. (8)-(16), decomposed once and reused by the other modules.

Columns of locked joints are zeroed rather than dropped: the range, the projector and the nonzero
singular values are unchanged, and every vector keeps one entry per joint.

A free-swinging joint k transmits no torque, so only forces in range(K) that do not load it remain
available: ``J_kᵀ F' = 0``, apart from its gravity torque. K is therefore projected onto the
orthogonal complement of the columns of the free-swinging joints, and all results for K still hold.
Columns too short to balance anything do not count: there the friction of the joint decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import (
    Mask,
    Matrix,
    Vector,
    as_floats,
    check_finite,
    is_number,
    norm,
    read_only,
)
from ftforce.core.svd import Svd
from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

RTOL = 1e-6
"""Default rank tolerance relative to σ_max of the healthy arm; URDFs contain rounded angles."""

BORDERLINE_RTOL = 1e-2
"""Default upper end of the range of tolerances over which a verdict must not change."""

_ROUNDING = 1e-12  # smaller torques, relative to the others, count as zero


class FreeJoints(NamedTuple):
    """Free-swinging joints, and how much torque their friction bears.

    Attributes
    ----------
    mask :
        True at these joints, shape (n,).
    friction :
        Largest torque that friction bears, N·m (N), NaN where it follows from the weight of the
        arm, shape (n,).
    lever :
        Where there is friction, singular values of the columns up to ``lever · σ_max(J)`` are too
        short a lever to balance anything (theory §4).
    is_ideal :
        Whether none of these joints has any friction.
    """

    mask: Mask
    friction: Vector
    lever: float
    is_ideal: bool

    @classmethod
    def of(cls, mask: Mask, friction: Vector, lever: float) -> FreeJoints:
        """Return the joints with their friction.

        Parameters
        ----------
        mask, friction, lever :
            As of the class.
        """
        return cls(mask, friction, lever, not friction[mask].any())  # NaN is some friction


class FreeColumns(NamedTuple):
    """Singular value decomposition of the Jacobian columns of the free-swinging joints.

    Attributes
    ----------
    given :
        The joints and their friction.
    joints :
        Indices of the f joints, from 0.
    U, s, Vt :
        Decomposition of the columns J_S, shapes (m, m), (min(m, f),) and (f, f).
    rank :
        Number of singular values that are a lever: above ``lever · σ_max(J)``, or for ideal joints
        above ``rtol · σ_max(J)``.
    """

    given: FreeJoints
    joints: list[int]
    U: Matrix
    s: Vector
    Vt: Matrix
    rank: int

    def support(self, torque: Vector) -> Vector:
        """Return the minimum-norm balancing force, -(J_Sᵀ)† [rnea]_S, shape (m,).

        Parameters
        ----------
        torque :
            Gravity and motion torques of these joints, [rnea]_S, shape (f,).
        """
        r = self.rank
        along = self.Vt[:r].dot(torque)
        along[np.abs(along) <= _ROUNDING * norm(torque)] = 0.0
        force: Vector = -self.U[:, :r].dot(along / self.s[:r])
        return force

    def without_lever(self, torque: Vector, shortest: float) -> Vector:
        """Return the part of the torque at these joints that no force changes, shape (f,).

        Parameters
        ----------
        torque :
            Gravity and motion torques of these joints, [rnea]_S, shape (f,).
        shortest :
            Singular values of the columns up to it are no lever.
        """
        V = self.Vt[int(np.count_nonzero(self.s > shortest)) :]
        left: Vector = V.dot(torque).dot(V)
        return left


class ReducedJacobian(NamedTuple):
    """Task Jacobian before and after a fault, with their ranks under a common tolerance.

    Attributes
    ----------
    healthy :
        Decomposition of the weighted task Jacobian J, shape (m, n).
    damaged :
        Decomposition of K, shape (m, n): J with the columns of locked joints zeroed, projected
        onto the orthogonal complement of the columns of the free-swinging joints.
    locked :
        True at locked joints, shape (n,).
    rank, rank_after :
        Number of singular values of J and of K above ``rtol · σ_max(J)``.
    rtol :
        Rank tolerance.
    free :
        The free-swinging joints; ``None`` if there are none.
    """

    healthy: Svd
    damaged: Svd
    locked: Mask
    rank: int
    rank_after: int
    rtol: float
    free: FreeColumns | None = None

    @property
    def J(self) -> Matrix:
        """Weighted task Jacobian of the healthy arm, shape (m, n)."""
        return self.healthy.A

    @property
    def K(self) -> Matrix:
        """Reduced Jacobian, shape (m, n)."""
        return self.damaged.A

    @property
    def commanding(self) -> Mask:
        """True at joints whose motors still produce torque, shape (n,)."""
        mask = ~self.locked
        if self.free is not None:
            mask[self.free.joints] = False
        return mask

    @property
    def sigma_max(self) -> float:
        """Largest singular value of J, to which all tolerances are relative."""
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
    J: Matrix, locked: Mask, rtol: float = RTOL, free: FreeJoints | Mask | None = None
) -> ReducedJacobian:
    """Decompose J and K; arguments are not validated (see `check_core_input`).

    Parameters
    ----------
    J :
        Weighted task Jacobian, read-only, shape (m, n).
    locked :
        True at locked joints, shape (n,).
    rtol :
        Rank tolerance, relative to σ_max(J).
    free :
        The free-swinging joints, or a mask of ideal ones, shape (n,); ``None`` if there are none.
    """
    return reduce_decomposed(Svd(J), locked, rtol, free)


def reduce_decomposed(
    healthy: Svd, locked: Mask, rtol: float, free: FreeJoints | Mask | None = None
) -> ReducedJacobian:
    """Decompose K for a fault set, given the decomposition of J.

    Parameters
    ----------
    healthy :
        Decomposition of J.
    locked, rtol, free :
        As in `reduce`.
    """
    threshold = rtol * healthy.s[0]  # ranks are relative to the healthy arm
    damaged, columns = healthy, None
    if True in locked.tolist():
        K = healthy.A.copy()
        np.copyto(K, 0.0, where=locked)  # eq. (25), (26)
        damaged = Svd(read_only(K), left_only=True)
    if free is not None:
        if not isinstance(free, FreeJoints):
            free = FreeJoints.of(free, np.zeros(len(free)), rtol)
        columns = _free_columns(healthy.A, free, healthy.s[0], rtol)
        U = columns.U[:, columns.rank :]
        K = U.dot(U.T.dot(damaged.A))  # (I - J_S J_S†) K
        np.copyto(K, 0.0, where=free.mask)
        damaged = Svd(read_only(K), left_only=True)
    return ReducedJacobian(
        healthy, damaged, locked, healthy.rank(threshold), damaged.rank(threshold), rtol, columns
    )


def _free_columns(J: Matrix, free: FreeJoints, scale: float, rtol: float) -> FreeColumns:
    joints = np.flatnonzero(free.mask).tolist()
    U, s, Vt = np.linalg.svd(J[:, joints])
    shortest = rtol if free.is_ideal else free.lever
    return FreeColumns(free, joints, U, s, Vt, int(np.count_nonzero(s > shortest * scale)))


def check_core_input(J: ArrayLike, locked: ArrayLike) -> tuple[Matrix, Mask]:
    """Validate a user-supplied Jacobian and joint mask and return read-only copies.

    Parameters
    ----------
    J :
        Task Jacobian, shape (m, n); m may exceed 6.
    locked :
        Boolean mask, shape (n,).

    Raises
    ------
    DimensionError
        The mask does not have one entry per column of J.
    InputError
        J is not a nonempty matrix or contains NaN or infinity, or the mask is not boolean.
    """
    J = as_floats(J, "J")  # a copy, because results keep it
    if J.ndim != 2 or not J.size:
        raise InputError(f"J must have the shape (m, n), got {J.shape}")
    check_finite(J, "J")
    return read_only(J), check_mask(locked, J.shape[1], "locked")


def check_mask(joints: ArrayLike, n: int, name: str) -> Mask:
    """Validate a user-supplied joint mask, one entry per column of J.

    Parameters
    ----------
    joints :
        Boolean mask, shape (n,).
    n :
        Number of joints.
    name :
        Name of the mask, for error messages.

    Raises
    ------
    InputError
        The mask is not boolean or does not have n entries.
    """
    try:
        mask = np.array(joints)
    except ValueError:  # a ragged list
        mask = np.array(None)
    if mask.dtype != np.bool_:
        raise InputError(
            f"{name} must be a boolean mask of shape ({n},), one entry per column of J, "
            f"got {joints!r}; analyze() accepts joint numbers and names"
        )
    if mask.shape != (n,):
        raise DimensionError(name, (n,), mask.shape, "one entry per column of J")
    return read_only(mask)


def check_tolerances(rtol: float, wary: float = BORDERLINE_RTOL) -> None:
    """Check the rank tolerance and the borderline tolerance.

    Parameters
    ----------
    rtol :
        Rank tolerance, relative to σ_max(J).
    wary :
        Largest tolerance considered for a borderline verdict.

    Raises
    ------
    InputError
        Unless ``1e-14 ≤ rtol ≤ wary < 1``.
    """
    if not (is_number(rtol) and 1e-14 <= rtol < 1.0):
        raise InputError(f"rtol must lie between 1e-14 and 1, got {rtol}")
    if not (is_number(wary) and rtol <= wary < 1.0):
        raise InputError(f"wary must lie between rtol = {float(rtol):g} and 1, got {wary}")
