"""The accurate part of the fault analysis: one posture and one fault set, as in `analyze`.

One-sided Jacobi rotations compute small singular values to high relative accuracy (Demmel and
Veselić 1992), on which the ranks are decided. The rest reimplements `reduced_jacobian`, `measures`,
`verdict`, `feasible_forces` and `bounded_remap` of `ftforce.core` on arrays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ftforce.batch.kernels import slabs
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
SLIGHT = 1e-3
"""Of the friction of a joint: a smaller weight asks for no force at the tip."""

SHARE_OF_WEIGHT = 1e-3
"""Friction of a joint whose friction is unknown, relative to the largest gravity torque."""


class Scratch(NamedTuple):
    """Workspace for one posture and one fault set."""

    rank: np.ndarray  # (2,): of J, and of the columns of the free-swinging joints with a lever
    slabs: slabs.Slabs
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
    residual: np.ndarray  # (n,): torques of the free-swinging joints that no force balances
    limit: np.ndarray  # (n,): torque limits
    friction: np.ndarray  # (n,): ε, torque that the friction of each joint bears
    fixed: np.ndarray  # (m, m): left singular vectors of the free columns with a lever
    jump: np.ndarray  # (m,): ΔF
    middle: np.ndarray  # (n,): middle of the two torque limits, 0 if they are the same


def workspace(m, n):
    """Return a workspace for one posture.

    Parameters
    ----------
    m, n :
        Numbers of task rows and of joints.
    """
    posture = [(m, n), (m, m), m, m, m, n]
    fault_set = [(m, n), (m, m), m, m, (m, n), m, n, n, n, (m, m), m, n]
    return Scratch(
        aligned_zeros(2, np.int64),
        slabs.Slabs(*aligned_arrays(slabs.shapes(m, n))),
        *aligned_arrays([*posture, *fault_set]),
    )


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
def friction_under_weight(friction, rnea, out):
    """Fill in the friction of each joint, with a share of the weight where it is unknown.

    Parameters
    ----------
    friction :
        N·m (N), NaN where unknown, shape (n,).
    rnea :
        Gravity torques, shape (n,).
    out :
        Filled in, shape (n,).
    """
    largest = 0.0
    for k in range(rnea.size):
        largest = max(largest, abs(rnea[k]))
    for k in range(rnea.size):
        out[k] = SHARE_OF_WEIGHT * largest if math.isnan(friction[k]) else friction[k]


@inner
def is_ideal(friction, free):
    """Return whether no free-swinging joint has friction.

    Parameters
    ----------
    friction :
        N·m (N), NaN where unknown, shape (n,).
    free :
        True at the free-swinging joints, shape (n,).
    """
    found = True
    for k in range(free.size):
        found &= not (free[k] and friction[k] != 0.0)
    return found


@inner
def project_out_free(scratch, free, shortest, least):
    """Project K onto the orthogonal complement of the columns of free-swinging joints.

    Stores in F0 the smallest force that balances these joints, in ``fixed`` the basis of the forces
    that they determine, and in ``residual`` the torques at them that no force can balance. Returns
    the smallest singular value of their columns above ``shortest`` (infinite if there is none), the
    next one that a larger tolerance would treat as zero.

    Parameters
    ----------
    scratch :
        Workspace with J, K and the gravity torques.
    free :
        True at the free-swinging joints, shape (n,).
    shortest :
        Singular values of their columns up to it are no lever.
    least :
        Singular values up to it count as zero.
    """
    m, n = scratch.J.shape
    W, s, rest = scratch.W, scratch.t, scratch.projected
    for k in range(n):
        for i in range(m):
            W[i, k] = scratch.J[i, k] if free[k] else 0.0
    decompose(W, scratch.V, s)
    rank = rank_of(s, shortest)
    scratch.rank[1] = rank
    for i in range(m):
        for j in range(m):
            scratch.fixed[i, j] = scratch.V[i, j]
    for k in range(n):
        project(scratch.V, rank, m, scratch.K[:, k], rest)
        for i in range(m):
            scratch.K[i, k] = 0.0 if free[k] else rest[i]
    balance_free(scratch, free, rank, rank_of(s, least))
    return s[rank - 1] if rank > 0 else math.inf


@inner
def _weight_of(scratch, k, total):
    """Return the weight torque of a free-swinging joint, 0 if it is rounding."""
    w = scratch.rnea[k]
    return w if abs(w) > _ROUNDING * total else 0.0


@inner
def balance_free(scratch, free, rank, movable):
    """Set F0 to the smallest force that balances the free-swinging joints, -(J_Sᵀ)† [rnea]_S.

    The rows of W are σ_i v_iᵀ.

    Parameters
    ----------
    scratch :
        Workspace with the decomposed columns of the free-swinging joints.
    free :
        True at these joints, shape (n,).
    rank :
        Number of singular values that are a lever.
    movable :
        Number of those that are not zero; what they leave, no force balances.
    """
    m, n = scratch.J.shape
    residual, F0 = scratch.residual, scratch.F0
    for i in range(m):
        F0[i] = 0.0
    total, size = norm(scratch.rnea), 0.0
    for k in range(n):
        residual[k] = _weight_of(scratch, k, total) if free[k] else 0.0
        size += residual[k] * residual[k]
    if size == 0.0:
        return
    for i in range(max(rank, movable)):
        along = 0.0  # v_iᵀ [rnea]_S
        for k in range(n):
            if free[k]:
                along += scratch.W[i, k] * _weight_of(scratch, k, total) / scratch.t[i]
        if i < rank and abs(along) > _ROUNDING * math.sqrt(size):
            for k in range(m):
                F0[k] -= along / scratch.t[i] * scratch.V[k, i]
        if i < movable:
            for k in range(n):
                residual[k] -= along * (scratch.W[i, k] / scratch.t[i])


@inner
def is_balanced(scratch, free, ideal, tolerance):
    """Return whether some tip force, or friction, balances each free-swinging joint.

    Parameters
    ----------
    scratch :
        Workspace, after `project_out_free`.
    free :
        True at the free-swinging joints, shape (n,).
    ideal :
        Whether they have no friction.
    tolerance :
        Torques up to this share of all gravity torques count as zero.
    """
    rounding = tolerance * norm(scratch.rnea)
    if ideal:
        return norm(scratch.residual) <= rounding
    total, least, found = norm(scratch.rnea), tolerance * scratch.s[0], True
    for k in range(free.size):
        has_lever = norm(scratch.J[:, k]) > least
        weight = _weight_of(scratch, k, total)
        found &= not free[k] or has_lever or abs(weight) <= max(scratch.friction[k], rounding)
    return found


@inner
def lever_of(scratch, k, x):
    """Return J_kᵀ x."""
    lever = 0.0
    for i in range(x.size):
        lever += scratch.J[i, k] * x[i]
    return lever


@inner
def is_borne(scratch, free, limit, after, rtol, wary):
    """Return whether friction bears the force F̂ as it is (`Bearings.bears`), within the limits.

    Parameters
    ----------
    scratch :
        Workspace, with K decomposed.
    free :
        True at the free-swinging joints, shape (n,).
    limit :
        Largest torques, NaN where unknown, shape (n,); ``None`` for no limits.
    after :
        Rank of K.
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    """
    F, total = scratch.F, norm(scratch.rnea)
    size = norm(F)
    if limit is not None:
        for k in range(free.size):
            lever = lever_of(scratch, k, F)
            torque = lever if abs(lever) > rtol * scratch.s[0] * size else 0.0
            torque += scratch.rnea[k] - scratch.middle[k]
            if limit[k] > 0.0 and abs(torque) > limit[k]:
                return False
    for k in range(free.size):
        if free[k]:
            lever, weight = lever_of(scratch, k, F), _weight_of(scratch, k, total)
            most = max(scratch.friction[k], rtol * total)
            if abs(lever + weight) > most or abs(lever) > wary * scratch.s[0] * size:
                return False
            if abs(lever) <= rtol * scratch.s[0] * size and abs(weight) > most:
                return False
    return beyond_of(scratch, after, F) <= rtol * size


@inner
def beyond_of(scratch, after, x):
    """Return the size of the part of x that neither motors nor free-swinging joints decide.

    Parameters
    ----------
    scratch :
        Workspace, with K decomposed.
    after :
        Rank of K.
    x :
        Force, shape (m,).
    """
    beyond, m = scratch.projected, x.size
    project(scratch.V, after, m, x, beyond)
    for j in range(scratch.rank[1]):
        along = 0.0
        for i in range(m):
            along += scratch.fixed[i, j] * beyond[i]
        for i in range(m):
            beyond[i] -= along * scratch.fixed[i, j]
    return norm(beyond)


@inner
def hold(scratch, free, limit, after, ideal, rtol, wary):
    """Store in ``jump`` how far the closest force that can be held is from F̂, if there is one.

    As `ftforce.core.bounded_remap.nearest_force`, for joints that are balanced.

    Parameters
    ----------
    scratch :
        Workspace, with K decomposed.
    free :
        True at the free-swinging joints, shape (n,).
    limit :
        Largest torques, NaN where unknown and 0 at free-swinging joints, shape (n,); ``None`` for
        no limits.
    after :
        Rank of K.
    ideal :
        Whether they have no friction.
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    """
    m, F, jump = scratch.F.size, scratch.F, scratch.jump
    if not ideal and is_borne(scratch, free, limit, after, rtol, wary):
        for i in range(m):
            jump[i] = 0.0
        return True
    lose(scratch, after)
    count = 0
    for k in range(free.size):
        count += 1 if free[k] else 0
    has_friction = not ideal and count > scratch.rank[1]
    if limit is None and not has_friction:
        return True
    total, within, work = norm(scratch.rnea), True, scratch.slabs
    for k in range(free.size):
        most, weight = -1.0, scratch.rnea[k]
        if limit is not None:  # noqa: SIM102 # numba leaves it out where it is None
            if limit[k] > 0.0:
                most = limit[k]
                weight -= scratch.middle[k]
        if free[k] and has_friction:
            most, weight = max(scratch.friction[k], rtol * total), _weight_of(scratch, k, total)
        work.width[k] = most
        if most >= 0.0:
            torque = weight + lever_of(scratch, k, F) - lever_of(scratch, k, jump)
            within &= abs(torque) <= most
            project(scratch.V, 0, after, scratch.J[:, k], scratch.projected)
            for i in range(m):
                work.rows[i, k] = scratch.projected[i]
            work.middle[k] = -weight - lever_of(scratch, k, scratch.F0)
    if within:
        return True
    z = jump
    for i in range(m):
        z[i] = F[i] - jump[i] - scratch.F0[i]
    found = slabs.nearest(work, z, rtol * scratch.s[0])
    for i in range(m):
        jump[i] = F[i] - scratch.F0[i] - z[i]
    return found


@inner
def lose(scratch, after):
    """Store in ``jump`` the jump ΔF = (I - K K†) F̂ - F₀ (eq. 33, 40).

    Parameters
    ----------
    scratch :
        Workspace, with K decomposed.
    after :
        Rank of K.
    """
    m, jump = scratch.F.size, scratch.jump
    project(scratch.V, after, m, scratch.F, jump)
    for i in range(m):
        jump[i] = 0.0 if after == m else jump[i] - scratch.F0[i]


@inner
def _losing_tolerance(s, scale):
    """Return the smallest tolerance t that treats a singular value as zero, s ≤ t · scale."""
    t = s / scale
    return t if s <= t * scale else np.nextafter(t, math.inf)


@inner
def verdict_of(accepted, rejected):
    """Return the verdict, given whether any tolerance accepts and any rejects the fault set.

    Parameters
    ----------
    accepted, rejected :
        Whether there is such a tolerance.
    """
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
        return verdict_of(kept or kept_at_wary, not (kept and kept_at_wary))
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
            return verdict_of(accepted, rejected)
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
def reduce(scratch, locked, free, ideal, wary, tolerance):
    """Set K, and what `project_out_free` stores, for a tolerance; return what that returns.

    Parameters
    ----------
    scratch :
        Workspace with J and the gravity torques.
    locked, free :
        True at the locked, and at the free-swinging joints, shape (n,).
    ideal :
        Whether the latter have no friction.
    wary :
        Relative tolerance of the borderline verdict.
    tolerance :
        Relative tolerance of the rank.
    """
    scale, has_free = scratch.s[0], False
    reduce_columns(scratch.J, locked, scratch.K)
    for k in range(free.size):
        has_free |= free[k]
        scratch.residual[k] = 0.0
    for i in range(scratch.F0.size):
        scratch.F0[i] = 0.0
    scratch.rank[1] = 0
    if not has_free:
        return math.inf
    shortest = (tolerance if ideal else wary) * scale
    return project_out_free(scratch, free, shortest, tolerance * scale)


@inner
def judge_free(scratch, locked, free, limit, friction, rtol, wary, has_force):
    """Return the verdict with free-swinging joints and limits (`ftforce.core.verdict.judge`).

    Reevaluated at every change of rank, since K changes when the column of an ideal free joint is
    treated as zero. Overwrites K, its decomposition, F0 and ΔF.

    Parameters
    ----------
    scratch :
        Workspace with J decomposed, and with the friction of the joints.
    locked, free :
        True at the locked, and at the free-swinging joints, shape (n,).
    limit :
        As in `hold`.
    friction :
        As given, NaN where unknown, shape (n,).
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    has_force :
        Whether a force is requested.
    """
    scale, rank = scratch.s[0], scratch.rank[0]
    ideal = is_ideal(friction, free)
    accepted, rejected, start = False, False, rtol
    while True:
        nearest = reduce(scratch, locked, free, ideal, wary, start)
        nearest = nearest if ideal else math.inf  # friction does not depend on the tolerance
        decompose(scratch.K, scratch.V, scratch.t)
        after = rank_of(scratch.t, start * scale)
        jump = math.inf
        if hold(scratch, free, limit, after, ideal, rtol, wary):
            jump = relative_jump(scratch, scale)
        if not has_force and after < rank:
            jump = math.inf  # a direction is lost
        for i in range(scratch.s.size):
            if scratch.t[i] > start * scale:
                nearest = min(nearest, scratch.t[i])
        ends = not nearest <= wary * scale
        end = wary if ends else _losing_tolerance(nearest, scale)
        at_start = is_balanced(scratch, free, ideal, start if ideal else rtol) and jump <= start
        at_end = is_balanced(scratch, free, ideal, end if ideal else rtol) and jump <= end
        accepted |= at_start or at_end
        rejected |= not (at_start and at_end)
        if ends:
            return verdict_of(accepted, rejected)
        start = end


@inner
def relative_jump(scratch, scale):
    """Return ‖ΔF‖/‖F̂‖; without a force, the required support relative to the weight.

    Parameters
    ----------
    scratch :
        Workspace.
    scale :
        σ_max(J).
    """
    jump, size, weight = norm(scratch.jump), norm(scratch.F), norm(scratch.rnea)
    if jump == 0.0:
        return 0.0
    if size > 0.0:
        return jump / size
    return jump * scale / weight if weight > 0.0 else math.inf


@inner
def largest_multiple(scratch, free, rank, ideal, rtol, wary):
    """Return the largest s for which s·d can be commanded, NaN if there is none.

    The ratio test of `ftforce.core.feasible_forces.reach`.

    Parameters
    ----------
    scratch :
        Workspace with K decomposed, d, F0, the torque limits and the friction.
    free :
        True at the free-swinging joints, which are balanced, shape (n,).
    rank :
        Rank of K.
    ideal :
        Whether the free-swinging joints have no friction.
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    """
    d, limit, rnea = scratch.d, scratch.limit, scratch.rnea
    size = norm(d)
    min_lever = rtol * scratch.s[0] * size
    shortest = (rtol if ideal else wary) * scratch.s[0] * size
    s_min, s_max = _multiples_borne(scratch, free, min_lever, shortest, rtol)
    if rank < d.size and beyond_of(scratch, rank, d) > rtol * size:
        s_max = min(s_max, 0.0)
    for k in range(limit.size):
        if free[k] or not limit[k] > 0.0:  # accounted for, or unknown
            continue
        lever = lever_of(scratch, k, d)
        rest = rnea[k] - scratch.middle[k]
        lower, upper = -limit[k] - rest, limit[k] - rest
        if abs(lever) <= min_lever:
            if lower > 0.0 or upper < 0.0:
                return math.nan
            continue
        first, last = lower / lever, upper / lever
        s_min = max(s_min, min(first, last))
        s_max = min(s_max, max(first, last))
    return math.nan if s_max < s_min else s_max


@inner
def _multiples_borne(scratch, free, min_lever, shortest, rtol):
    """Return the interval of s in which the free-swinging joints bear s·d (`Bearings.interval`)."""
    total, s_min, s_max = norm(scratch.rnea), 0.0, math.inf
    along, square, at_rest = 0.0, 0.0, True
    for k in range(free.size):
        if free[k]:
            lever, weight = lever_of(scratch, k, scratch.d), _weight_of(scratch, k, total)
            most = max(scratch.friction[k], rtol * total)
            at_rest &= abs(weight) <= most
            if abs(lever) > shortest:  # an equation, [rnea]_k + s J_kᵀ d = 0
                along += lever * (weight if abs(weight) > SLIGHT * most else 0.0)
                square += lever * lever
            elif abs(lever) > min_lever:
                first, last = (-most - weight) / lever, (most - weight) / lever
                s_min = max(s_min, min(first, last))
                s_max = min(s_max, max(first, last))
            elif abs(weight) > most:
                return 0.0, -1.0
    if square == 0.0:
        return s_min, s_max
    s = -along / square
    fits = s >= 0.0
    for k in range(free.size):
        if free[k]:
            lever, weight = lever_of(scratch, k, scratch.d), _weight_of(scratch, k, total)
            most = max(scratch.friction[k], rtol * total)
            weight = weight if abs(weight) > SLIGHT * most else 0.0
            fits &= not (abs(lever) > shortest and abs(s * lever + weight) > most)
    if not (fits or at_rest):
        return 0.0, -1.0
    s = s if fits else 0.0
    return max(s_min, s), min(s_max, s)
