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

_SWEEPS = 40
_ORTHOGONAL = 4e-16
_LEAST = 1e-18
_ROUNDING = 1e-12


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
    F0: np.ndarray  # (m,)
    W: np.ndarray  # (m, n)
    kept: np.ndarray  # (m,)
    left: np.ndarray  # (n,)
    limit: np.ndarray  # (n,)


def scratch(m, n):
    """Return a workspace for one posture."""
    posture = [(m, n), (m, m), m, m, m, n]
    fault_set = [(m, n), (m, m), m, m, (m, n), m, n, n]
    return Scratch(aligned_zeros(1, np.int64), *aligned_arrays([*posture, *fault_set]))


@inner
def decompose(W, U, s):
    """Compute the SVD W = U diag(s) Vᵀ in place: rows become s_i v_iᵀ, sorted by decreasing s."""
    m = W.shape[0]
    U[:] = 0.0
    for i in range(m):
        U[i, i] = 1.0
    nothing = 0.0  # rows of at most this norm are rounding errors
    for i in range(m):
        nothing = max(nothing, _LEAST * norm(W[i]))
    for _ in range(_SWEEPS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                turned |= rotate(W, U, i, j, nothing)
        if not turned:
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
def rotate(W, U, i, j, nothing):
    """Make rows i and j orthogonal, and return whether a rotation of nonzero rows was needed."""
    a, b, c = 0.0, 0.0, 0.0
    for k in range(W.shape[1]):
        a += W[i, k] * W[i, k]
        b += W[j, k] * W[j, k]
        c += W[i, k] * W[j, k]
    a_norm, b_norm = math.sqrt(a), math.sqrt(b)
    if not (abs(c) > _ORTHOGONAL * a_norm * b_norm and min(a_norm, b_norm) > nothing):
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
    """Return the number of singular values above a threshold."""
    rank = s.size
    while rank > 0 and s[rank - 1] <= threshold:
        rank -= 1
    return rank


@inner
def project(U, first, last, x, out):
    """Project x onto the span of the columns first … last - 1 of U, into ``out``."""
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
    """Set K to J with the columns of locked joints zeroed (eq. 25, 26)."""
    for i in range(J.shape[0]):
        for k in range(J.shape[1]):
            K[i, k] = 0.0 if locked[k] else J[i, k]


@inner
def project_out_free(one, free, lost):
    """Project K onto the orthogonal complement of the columns of free-swinging joints.

    Stores in F0 the smallest force that balances these joints. Returns the torque at them that no
    force can balance, relative to the gravity torques of the arm, and the smallest singular value
    of their columns above ``lost`` (infinite if there is none), the next one that a larger
    tolerance would treat as zero.
    """
    m, n = one.J.shape
    W, s, rest = one.W, one.t, one.kept
    for k in range(n):
        for i in range(m):
            W[i, k] = one.J[i, k] if free[k] else 0.0
    decompose(W, one.V, s)
    rank = rank_of(s, lost)
    for k in range(n):
        project(one.V, rank, m, one.K[:, k], rest)
        for i in range(m):
            one.K[i, k] = 0.0 if free[k] else rest[i]
    unbalanced = support(one, free, rank)
    return unbalanced, s[rank - 1] if rank > 0 else math.inf


@inner
def support(one, free, rank):
    """Set F0 to the smallest force that balances the free-swinging joints, -(J_Sᵀ)† [rnea]_S.

    Returns the unbalanced torque, relative to the gravity torques. The rows of W are σ_i v_iᵀ.
    """
    m, n = one.J.shape
    left, F0 = one.left, one.F0
    for i in range(m):
        F0[i] = 0.0
    for k in range(n):
        left[k] = one.rnea[k] if free[k] else 0.0
    total = norm(one.rnea)
    if not norm(left) > _ROUNDING * total:
        return 0.0
    for i in range(rank):
        along = 0.0
        for k in range(n):
            along += one.W[i, k] * one.rnea[k]
        along /= one.t[i] * one.t[i]
        for k in range(m):
            F0[k] -= along * one.V[k, i]
        for k in range(n):
            left[k] -= along * one.W[i, k]
    return norm(left) / total


@inner
def tolerance_that_loses(s, scale):
    """Return the smallest tolerance t that treats a singular value as zero, s ≤ t · scale."""
    t = s / scale
    return t if s <= t * scale else np.nextafter(t, math.inf)


@inner
def verdict_of(yes, no):
    """Return the verdict, given whether any tolerance accepts and any rejects the fault set."""
    if yes and no:
        return BORDERLINE
    return TOLERATED if yes else NOT_TOLERATED


@inner
def judge_locked(one, asks, rtol, wary):
    """Return the verdict for locked joints only (`ftforce.core.verdict.verdict`)."""
    s, scale, m = one.t, one.s[0], one.t.size
    if s[m - 1] > wary * scale:
        return TOLERATED
    if not asks:
        kept = rank_of(s, rtol * scale) >= one.rank[0]
        kept_at_wary = rank_of(s, wary * scale) >= one.rank[0]
        return verdict_of(kept or kept_at_wary, not (kept and kept_at_wary))
    size = norm(one.F)
    if size == 0.0:
        return TOLERATED
    yes, no, start = False, False, rtol
    left = rank_of(s, rtol * scale)
    lost = 0.0  # share of ‖F̂‖² along lost directions
    for i in range(left, m):
        lost += share(one, i, size)
    while True:  # from one change of the rank to the next
        ends = left == 0 or not s[left - 1] <= wary * scale
        end = wary if ends else tolerance_that_loses(s[left - 1], scale)
        jump = math.sqrt(lost)
        yes |= jump <= start or jump <= end
        no |= not (jump <= start and jump <= end)
        if ends:
            return verdict_of(yes, no)
        start = end
        while left > 0 and s[left - 1] <= start * scale:
            left -= 1
            lost += share(one, left, size)


@inner
def share(one, i, size):
    """Return the share of ‖F̂‖² along the i-th left singular vector of K."""
    along = 0.0
    for k in range(one.F.size):
        along += one.V[k, i] * (one.F[k] / size)
    return along * along


@inner
def judge_free(one, locked, free, rtol, wary, asks):
    """Return the verdict with free-swinging joints (`ftforce.core.verdict.judge` without limits).

    Reevaluated at every change of rank, since K changes when the column of a free joint counts as
    zero. Overwrites K, its decomposition and F0.
    """
    m, scale, rank = one.s.size, one.s[0], one.rank[0]
    yes, no, start = False, False, rtol
    while True:
        reduce_columns(one.J, locked, one.K)
        unbalanced, nearest = project_out_free(one, free, start * scale)
        decompose(one.K, one.V, one.t)
        after = rank_of(one.t, start * scale)
        project(one.V, 0, after, one.F, one.kept)
        jump = relative_jump(one.F, one.F0, one.kept, after == m, scale, one.rnea)
        if not asks and after < rank:
            jump = math.inf  # a direction is lost
        for i in range(m):
            if one.t[i] > start * scale:
                nearest = min(nearest, one.t[i])
        ends = not nearest <= wary * scale
        end = wary if ends else tolerance_that_loses(nearest, scale)
        at_start = unbalanced <= start and jump <= start
        at_end = unbalanced <= end and jump <= end
        yes |= at_start or at_end
        no |= not (at_start and at_end)
        if ends:
            return verdict_of(yes, no)
        start = end


@inner
def relative_jump(F, F0, kept, is_whole, scale, rnea):
    """Return ‖ΔF‖/‖F̂‖; without a force, the required support relative to the weight."""
    jump, size = 0.0, 0.0
    for i in range(F.size):
        after = F[i] if is_whole else F0[i] + kept[i]
        jump += (F[i] - after) * (F[i] - after)
        size += F[i] * F[i]
    if jump == 0.0:
        return 0.0
    if size > 0.0:
        return math.sqrt(jump) / math.sqrt(size)
    weight = norm(rnea)
    return math.sqrt(jump) * scale / weight if weight > 0.0 else math.inf


@inner
def reach(one, rank, unbalanced, rtol):
    """Return the largest s for which s·d can be commanded, NaN if there is none.

    The ratio test of `ftforce.core.feasible_forces.reach`.
    """
    if unbalanced > rtol:
        return math.nan
    d, limit, rnea = one.d, one.limit, one.rnea
    least, most = on_plane(one, rank, rtol)
    size = rtol * one.s[0] * norm(d)
    for k in range(limit.size):
        if not limit[k] > 0.0:  # unknown, or a free joint, already accounted for in F0 and K
            continue
        lever = 0.0
        for i in range(d.size):
            lever += one.J[i, k] * d[i]
        lower, upper = -limit[k] - rnea[k], limit[k] - rnea[k]
        if abs(lever) <= size:
            if lower > 0.0 or upper < 0.0:
                return math.nan
            continue
        first, last = lower / lever, upper / lever
        least = max(least, min(first, last))
        most = min(most, max(first, last))
    return math.nan if most < least else most


@inner
def on_plane(one, rank, rtol):
    """Return the interval of s for which s·d lies in the affine hull of the feasible forces."""
    m, F0, beyond = one.d.size, one.F0, one.kept
    offset = norm(F0)
    if rank == m and offset == 0.0:
        return 0.0, math.inf
    project(one.V, rank, m, one.d, beyond)
    size = norm(beyond)
    if size <= rtol * norm(one.d):
        return 0.0, (math.inf if offset == 0.0 else -1.0)
    if offset == 0.0:
        return 0.0, 0.0
    s, miss = 0.0, 0.0
    for i in range(m):
        s += (F0[i] / size) * (beyond[i] / size)
    for i in range(m):
        miss += (s * beyond[i] - F0[i]) ** 2
    if s >= 0.0 and math.sqrt(miss) <= rtol * offset:
        return s, s
    return 0.0, -1.0
