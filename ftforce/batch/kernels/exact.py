"""The accurate part of the fault analysis: one posture and one fault set, as in `analyze`.

One-sided Jacobi rotations compute small singular values to high relative accuracy (Demmel and
Veselić 1992), on which the ranks are decided. The rest reimplements `reduced_jacobian`, `measures`,
`verdict` and `feasible_forces` of `ftforce.core` on arrays, without limits on the force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ftforce.batch.kernels.jit import inner
from ftforce.batch.kernels.layout import (
    BORDERLINE,
    NOT_TOLERATED,
    TOLERATED,
    aligned_arrays,
    aligned_zeros,
)

_SWEEPS = 40  # most sweeps of Jacobi rotations
_ORTHOGONAL = 4e-16  # cosine of the angle between rows that need no rotation
_NEGLIGIBLE = 1e-18  # relative to the longest row
_ROUNDING = 1e-12  # relative to the gravity torques


class Scratch(NamedTuple):
    """Workspace for one posture and one fault set."""

    rank: np.ndarray  # (1,): of J
    J: np.ndarray  # (m, n)
    U: np.ndarray  # (m, m): of J = U diag(s) Vᵀ
    s: np.ndarray  # (m,)
    F: np.ndarray  # (m,): F̂, 0 without a force
    d: np.ndarray  # (m,): direction
    rnea: np.ndarray  # (n,): gravity torques
    K: np.ndarray  # (m, n); after decomposition, diag(t) times the right singular vectors
    V: np.ndarray  # (m, m): left singular vectors of K
    t: np.ndarray  # (m,): singular values of K
    F0: np.ndarray  # (m,): force that balances the free-swinging joints
    W: np.ndarray  # (m, n): columns of the free-swinging joints
    projected: np.ndarray  # (m,): output of `project`
    residual: np.ndarray  # (n,): torques of the free-swinging joints that F0 does not balance
    limit: np.ndarray  # (n,): torque limits


def workspace(m, n):
    """Return a workspace for one posture.

    Parameters
    ----------
    m, n :
        Numbers of task rows and of joints.
    """
    posture = [(m, n), (m, m), m, m, m, n]
    fault_set = [(m, n), (m, m), m, m, (m, n), m, n, n]
    return Scratch(aligned_zeros(1, np.int64), *aligned_arrays([*posture, *fault_set]))


@inner
def decompose(W, U, s):
    """Compute the SVD W = U diag(s) Vᵀ in place: rows become s_i v_iᵀ, sorted by decreasing s.

    Parameters
    ----------
    W :
        The matrix, shape (m, n); then the rows s_i v_iᵀ.
    U :
        Filled with the left singular vectors as columns, shape (m, m).
    s :
        Filled with the singular values, shape (m,).
    """
    m = W.shape[0]
    U[:] = 0.0
    for i in range(m):
        U[i, i] = 1.0
    negligible = 0.0  # rows of at most this norm are rounding errors
    for i in range(m):
        negligible = max(negligible, _NEGLIGIBLE * norm(W[i]))
    for _ in range(_SWEEPS):
        rotated = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                rotated |= _rotate(W, U, i, j, negligible)
        if not rotated:
            break
    for i in range(m):
        s[i] = norm(W[i])
    for i in range(m - 1):
        largest = i
        for j in range(i + 1, m):
            if s[j] > s[largest]:
                largest = j
        if largest != i:
            s[i], s[largest] = s[largest], s[i]
            for c in range(W.shape[1]):
                W[i, c], W[largest, c] = W[largest, c], W[i, c]
            for c in range(m):
                U[c, i], U[c, largest] = U[c, largest], U[c, i]


@inner
def _rotate(W, U, i, j, negligible):
    """Make rows i and j orthogonal, and return whether a rotation of nonzero rows was needed."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(W.shape[1]):
        a += W[i, k] * W[i, k]
        b += W[j, k] * W[j, k]
        c += W[i, k] * W[j, k]
    a_norm, b_norm = math.sqrt(a), math.sqrt(b)
    if not (abs(c) > _ORTHOGONAL * a_norm * b_norm and min(a_norm, b_norm) > negligible):
        return False
    zeta = (b - a) / (2.0 * c)
    t = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    sine = cosine * t
    for k in range(W.shape[1]):
        x, y = W[i, k], W[j, k]
        W[i, k] = cosine * x - sine * y
        W[j, k] = sine * x + cosine * y
    for k in range(U.shape[0]):
        x, y = U[k, i], U[k, j]
        U[k, i] = cosine * x - sine * y
        U[k, j] = sine * x + cosine * y
    return True


@inner
def norm(x):
    """Return ‖x‖."""
    total = 0.0
    for i in range(x.size):
        total += x[i] * x[i]
    return math.sqrt(total)


@inner
def rank_of(s, threshold):
    """Return the number of singular values above a threshold.

    Parameters
    ----------
    s :
        Singular values, decreasing, shape (m,).
    threshold :
        Those up to it count as zero.
    """
    rank = s.size
    while rank > 0 and s[rank - 1] <= threshold:
        rank -= 1
    return rank


@inner
def project(U, first, last, x, out):
    """Project x onto the span of the columns first … last - 1 of U, into ``out``.

    Parameters
    ----------
    U :
        Orthonormal columns, shape (m, m).
    first, last :
        Half-open range of columns.
    x :
        Vector, shape (m,).
    out :
        Filled with the projection, shape (m,).
    """
    m = U.shape[0]
    for i in range(m):
        out[i] = 0.0
    for j in range(first, last):
        along = 0.0
        for i in range(m):
            along += U[i, j] * x[i]
        for i in range(m):
            out[i] += along * U[i, j]


@inner
def reduce_columns(J, locked, K):
    """Set K to J with the columns of locked joints zeroed (eq. 25, 26).

    Parameters
    ----------
    J :
        Task Jacobian, shape (m, n).
    locked :
        True at the locked joints, shape (n,).
    K :
        Filled with the reduced Jacobian, shape (m, n).
    """
    for i in range(J.shape[0]):
        for k in range(J.shape[1]):
            K[i, k] = 0.0 if locked[k] else J[i, k]


@inner
def project_out_free(scratch, free, threshold):
    """Project K onto the orthogonal complement of the columns of free-swinging joints.

    Stores in F0 the smallest force that balances these joints. Returns the torque at them that no
    force can balance, relative to the gravity torques of the arm, and the smallest singular value
    of their columns above ``threshold`` (infinite if there is none), the next one that a larger
    tolerance would treat as zero.

    Parameters
    ----------
    scratch :
        Workspace with J, K and the gravity torques.
    free :
        True at the free-swinging joints, shape (n,).
    threshold :
        Singular values of their columns up to it count as zero.
    """
    m, n = scratch.J.shape
    W, s, rest = scratch.W, scratch.t, scratch.projected
    for k in range(n):
        for i in range(m):
            W[i, k] = scratch.J[i, k] if free[k] else 0.0
    decompose(W, scratch.V, s)
    rank = rank_of(s, threshold)
    for k in range(n):
        project(scratch.V, rank, m, scratch.K[:, k], rest)
        for i in range(m):
            scratch.K[i, k] = 0.0 if free[k] else rest[i]
    unbalanced = balance_free(scratch, free, rank)
    return unbalanced, s[rank - 1] if rank > 0 else math.inf


@inner
def balance_free(scratch, free, rank):
    """Set F0 to the smallest force that balances the free-swinging joints, -(J_Sᵀ)† [rnea]_S.

    Returns the unbalanced torque, relative to the gravity torques. The rows of W are σ_i v_iᵀ.

    Parameters
    ----------
    scratch :
        Workspace with the decomposed columns of the free-swinging joints.
    free :
        True at these joints, shape (n,).
    rank :
        Rank of their columns.
    """
    m, n = scratch.J.shape
    residual, F0 = scratch.residual, scratch.F0
    for i in range(m):
        F0[i] = 0.0
    for k in range(n):
        residual[k] = scratch.rnea[k] if free[k] else 0.0
    total = norm(scratch.rnea)
    if not norm(residual) > _ROUNDING * total:
        return 0.0
    for i in range(rank):
        along = 0.0
        for k in range(n):
            along += scratch.W[i, k] * scratch.rnea[k]
        along /= scratch.t[i] * scratch.t[i]
        for k in range(m):
            F0[k] -= along * scratch.V[k, i]
        for k in range(n):
            residual[k] -= along * scratch.W[i, k]
    return norm(residual) / total


@inner
def _losing_tolerance(s, scale):
    """Return the smallest tolerance t that treats a singular value as zero, s ≤ t · scale."""
    t = s / scale
    return t if s <= t * scale else np.nextafter(t, math.inf)


@inner
def _verdict_of(accepted, rejected):
    """Return the verdict, given whether any tolerance accepts and any rejects the fault set."""
    if accepted and rejected:
        return BORDERLINE
    return TOLERATED if accepted else NOT_TOLERATED


@inner
def judge_locked(scratch, has_force, rtol, wary):
    """Return the verdict for locked joints only (`ftforce.core.verdict.verdict`).

    Parameters
    ----------
    scratch :
        Workspace with K decomposed.
    has_force :
        Whether a force is requested.
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    """
    s, scale, m = scratch.t, scratch.s[0], scratch.t.size
    if s[m - 1] > wary * scale:
        return TOLERATED
    if not has_force:
        kept = rank_of(s, rtol * scale) >= scratch.rank[0]
        kept_at_wary = rank_of(s, wary * scale) >= scratch.rank[0]
        return _verdict_of(kept or kept_at_wary, not (kept and kept_at_wary))
    size = norm(scratch.F)
    if size == 0.0:
        return TOLERATED
    accepted, rejected, start = False, False, rtol
    rank = rank_of(s, rtol * scale)
    lost = 0.0  # share of ‖F̂‖² along lost directions
    for i in range(rank, m):
        lost += _share(scratch, i, size)
    while True:  # from one change of the rank to the next
        ends = rank == 0 or not s[rank - 1] <= wary * scale
        end = wary if ends else _losing_tolerance(s[rank - 1], scale)
        jump = math.sqrt(lost)
        accepted |= jump <= start or jump <= end
        rejected |= not (jump <= start and jump <= end)
        if ends:
            return _verdict_of(accepted, rejected)
        start = end
        while rank > 0 and s[rank - 1] <= start * scale:
            rank -= 1
            lost += _share(scratch, rank, size)


@inner
def _share(scratch, i, size):
    """Return the share of ‖F̂‖² along the i-th left singular vector of K."""
    along = 0.0
    for k in range(scratch.F.size):
        along += scratch.V[k, i] * (scratch.F[k] / size)
    return along * along


@inner
def judge_free(scratch, locked, free, rtol, wary, has_force):
    """Return the verdict with free-swinging joints (`ftforce.core.verdict.judge` without limits).

    Reevaluated at every change of rank, since K changes when the column of a free joint is treated
    as zero. Overwrites K, its decomposition and F0.

    Parameters
    ----------
    scratch :
        Workspace with J decomposed.
    locked, free :
        True at the locked, and at the free-swinging joints, shape (n,).
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    has_force :
        Whether a force is requested.
    """
    m, scale, rank = scratch.s.size, scratch.s[0], scratch.rank[0]
    accepted, rejected, start = False, False, rtol
    while True:
        reduce_columns(scratch.J, locked, scratch.K)
        unbalanced, nearest = project_out_free(scratch, free, start * scale)
        decompose(scratch.K, scratch.V, scratch.t)
        after = rank_of(scratch.t, start * scale)
        project(scratch.V, 0, after, scratch.F, scratch.projected)
        F0, kept = scratch.F0, scratch.projected
        jump = _relative_jump(scratch.F, F0, kept, after == m, scale, scratch.rnea)
        if not has_force and after < rank:
            jump = math.inf  # a direction is lost
        for i in range(m):
            if scratch.t[i] > start * scale:
                nearest = min(nearest, scratch.t[i])
        ends = not nearest <= wary * scale
        end = wary if ends else _losing_tolerance(nearest, scale)
        at_start = unbalanced <= start and jump <= start
        at_end = unbalanced <= end and jump <= end
        accepted |= at_start or at_end
        rejected |= not (at_start and at_end)
        if ends:
            return _verdict_of(accepted, rejected)
        start = end


@inner
def _relative_jump(F, F0, projected, is_whole, scale, rnea):
    """Return ‖ΔF‖/‖F̂‖; without a force, the required support relative to the weight."""
    jump, size = 0.0, 0.0
    for i in range(F.size):
        after = F[i] if is_whole else F0[i] + projected[i]
        jump += (F[i] - after) * (F[i] - after)
        size += F[i] * F[i]
    if jump == 0.0:
        return 0.0
    if size > 0.0:
        return math.sqrt(jump) / math.sqrt(size)
    weight = norm(rnea)
    return math.sqrt(jump) * scale / weight if weight > 0.0 else math.inf


@inner
def largest_multiple(scratch, rank, unbalanced, rtol):
    """Return the largest s for which s·d can be commanded, NaN if there is none.

    The ratio test of `ftforce.core.feasible_forces.reach`.

    Parameters
    ----------
    scratch :
        Workspace with K decomposed, d, F0 and the torque limits.
    rank :
        Rank of K.
    unbalanced :
        Torque at free-swinging joints that no force balances, relative to all gravity torques.
    rtol :
        Relative tolerance.
    """
    if unbalanced > rtol:
        return math.nan
    d, limit, rnea = scratch.d, scratch.limit, scratch.rnea
    s_min, s_max = multiples_in_hull(scratch, rank, rtol)
    min_lever = rtol * scratch.s[0] * norm(d)
    for k in range(limit.size):
        if not limit[k] > 0.0:  # unknown, or a free joint, already accounted for in F0 and K
            continue
        lever = 0.0
        for i in range(d.size):
            lever += scratch.J[i, k] * d[i]
        lower, upper = -limit[k] - rnea[k], limit[k] - rnea[k]
        if abs(lever) <= min_lever:
            if lower > 0.0 or upper < 0.0:
                return math.nan
            continue
        first, last = lower / lever, upper / lever
        s_min = max(s_min, min(first, last))
        s_max = min(s_max, max(first, last))
    return math.nan if s_max < s_min else s_max


@inner
def multiples_in_hull(scratch, rank, rtol):
    """Return the interval of s for which s·d lies in the affine hull of the feasible forces.

    Parameters
    ----------
    scratch :
        Workspace with K decomposed, d and F0.
    rank :
        Rank of K.
    rtol :
        Relative tolerance.
    """
    m, F0, beyond = scratch.d.size, scratch.F0, scratch.projected
    offset = norm(F0)
    if rank == m and offset == 0.0:
        return 0.0, math.inf
    project(scratch.V, rank, m, scratch.d, beyond)
    size = norm(beyond)
    if size <= rtol * norm(scratch.d):
        return 0.0, (math.inf if offset == 0.0 else -1.0)
    if offset == 0.0:
        return 0.0, 0.0
    s, error = 0.0, 0.0
    for i in range(m):
        s += (F0[i] / size) * (beyond[i] / size)
    for i in range(m):
        error += (s * beyond[i] - F0[i]) ** 2
    if s >= 0.0 and math.sqrt(error) <= rtol * offset:
        return s, s
    return 0.0, -1.0
