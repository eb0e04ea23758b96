"""Fault sets that lose directions of force in every posture, LANES postures at a time.

With fewer healthy joints than task rows, the directions Null(Kᵀ) are lost; with one free-swinging
joint, the direction of its column. The remaining eigenvalues of K Kᵀ, or of (I - ûûᵀ) J Jᵀ
(I - ûûᵀ), interlace with those of J Jᵀ (Cauchy), so the rank follows without another decomposition.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.kernels.jit import inner
from ftforce.batch.kernels.layout import (
    BORDERLINE,
    GUARD_BAND,
    LANES,
    NOT_TOLERATED,
    TOLERATED,
    UNDECIDED,
    aligned_arrays,
)

if TYPE_CHECKING:
    import numpy as np

_FIRM = 1e-6
"""Sets of vectors with a smaller relative squared distance are left to `settle`."""

_ZERO = 1e-14  # relative to σ_max; smaller columns are rounding errors
_ROUNDING = 1e-12  # smaller torques are rounding errors in `exact.support`


class Lost(NamedTuple):
    """Lost directions of LANES postures."""

    P: np.ndarray  # (n, m, LANES): (J Jᵀ)⁻¹ J_k, one row per joint
    basis: np.ndarray  # (m, m, LANES): orthonormal rows
    part: np.ndarray  # (m, LANES): lost part of the force
    retained: np.ndarray  # (LANES,): lower bound on the remaining eigenvalues; NaN if unknown
    offset: np.ndarray  # (LANES,): force along the only lost direction that carries the weight
    idle: np.ndarray  # (LANES,): torque that no force balances, relative to all; -1 if one does
    a: np.ndarray  # (LANES,): workspace, like the rest
    relative: np.ndarray  # (LANES,): ‖ΔF‖/‖F̂‖, written by `write_jump`
    forces: np.ndarray  # (LANES,): norms of the jump
    moments: np.ndarray  # (LANES,)


def lost(m, n):
    """Return a workspace."""
    return Lost(*aligned_arrays([(n, m, LANES), (m, m, LANES), (m, LANES), *[LANES] * 7]))


@inner
def prepare(W, sigma, V, one):
    """Compute P = U diag(1/σ) Vᵀ = (J Jᵀ)⁻¹ J."""
    over = one.a
    one.P[:] = 0.0
    for i in range(W.shape[0]):
        for b in range(LANES):
            over[b] = 1.0 / sigma[i, b]
        for k in range(V.shape[0]):
            for r in range(W.shape[0]):
                for b in range(LANES):
                    one.P[k, r, b] += W[i, r, b] * V[k, i, b] * over[b]


@inner
def add_to_basis(size, one):
    """Make row ``size`` of the basis a unit vector orthogonal to the earlier ones."""
    row, before, after, along = one.basis[size], one.a, one.relative, one.forces
    m, retained = row.shape[0], one.retained
    add_squares(row, before)
    for j in range(2 * size):  # orthogonalize twice, for accuracy
        other = one.basis[j % size]
        dot(other, row, along)
        for i in range(m):
            for b in range(LANES):
                row[i, b] -= along[b] * other[i, b]
    add_squares(row, after)
    for b in range(LANES):
        retained[b] = retained[b] if after[b] > _FIRM * before[b] else math.nan
        after[b] = 1.0 / math.sqrt(after[b])
    for i in range(m):
        for b in range(LANES):
            row[i, b] *= after[b]


@inner
def add_squares(row, total):
    """Set total = ‖row‖²."""
    dot(row, row, total)


@inner
def dot(x, y, total):
    """Set total = xᵀy."""
    for b in range(LANES):
        total[b] = x[0, b] * y[0, b]
    for i in range(1, x.shape[0]):
        for b in range(LANES):
            total[b] += x[i, b] * y[i, b]


@inner
def lose_span(joints, smallest, one):
    """With as many joints as rows, each locked joint loses one direction, its row of J⁻¹."""
    for b in range(LANES):
        one.retained[b] = smallest[b]
    for at in range(joints.size):
        row, P = one.basis[at], one.P[joints[at]]
        for i in range(row.shape[0]):
            for b in range(LANES):
                row[i, b] = P[i, b]
        add_to_basis(at, one)


@inner
def lose_pair(i, j, secular, one):
    """With one joint more than rows, locking i < j loses P_S a with N_SS a = 0: N has rank one.

    The remaining eigenvalues are no smaller than with either joint locked alone.
    """
    x, rest, row, retained = secular.x, secular.rest, one.basis[0], one.retained
    N, first, second = secular.N[j, i], one.a, one.relative
    for b in range(LANES):
        larger = rest[j, b] > rest[i, b]
        first[b] = rest[j, b] if larger else N[b]
        second[b] = -N[b] if larger else -rest[i, b]
        retained[b] = x[j, b] if larger else x[i, b]
    for r in range(row.shape[0]):
        for b in range(LANES):
            row[r, b] = first[b] * one.P[i, r, b] + second[b] * one.P[j, r, b]
    for b in range(LANES):  # reject if the difference of the two cancels
        retained[b] = retained[b] if max(rest[i, b], rest[j, b]) > _FIRM else math.nan
    add_to_basis(0, one)


@inner
def lose_column(k, wary, J, weight, smallest, largest, one):
    """With joint k free-swinging, J_kᵀ F' + [rnea]_k = 0 loses the direction of its column.

    F' = F - û (ûᵀF + [rnea]_k/‖J_k‖), so the component of F' along û is fixed. If the column is
    zero, the tip lies on the joint's axis: no force balances the joint, and none is lost.
    """
    row, size, total = one.basis[0], one.moments, one.a
    retained, offset, idle = one.retained, one.offset, one.idle
    m, n = J.shape[0], J.shape[1]
    for i in range(m):
        for b in range(LANES):
            row[i, b] = J[i, k, b]
    add_squares(row, size)
    add_to_basis(0, one)
    for b in range(LANES):
        retained[b] = smallest[b]
        total[b] = 0.0
    for j in range(n):
        for b in range(LANES):
            total[b] += weight[j, b] * weight[j, b]
    for b in range(LANES):
        share = weight[k, b] * weight[k, b]
        is_some = share > (2.0 * _ROUNDING) ** 2 * total[b]
        is_none = not share > (0.5 * _ROUNDING) ** 2 * total[b]
        offset[b] = weight[k, b] / math.sqrt(size[b]) if is_some else 0.0
        is_column = size[b] > (wary * GUARD_BAND) ** 2 * largest[b]  # whatever the tolerance
        is_zero = size[b] <= _ZERO * _ZERO * largest[b]
        idle[b] = (math.sqrt(share / total[b]) if is_some else 0.0) if is_zero else -1.0
        is_known = (is_column | is_zero) & (is_some | is_none)
        retained[b] = retained[b] if is_known else math.nan


@inner
def project(force, size, has_free, one):
    """Store in ``part`` the lost part of the force, its projection onto the lost directions.

    It includes the force that carries the weight of a free-swinging joint.
    """
    along, part = one.a, one.part
    for i in range(part.shape[0]):
        for b in range(LANES):
            part[i, b] = 0.0
    for j in range(size):
        dot(one.basis[j], force, along)
        if has_free:
            for b in range(LANES):
                along[b] += one.offset[b]
        for i in range(part.shape[0]):
            for b in range(LANES):
                part[i, b] += along[b] * one.basis[j, i, b]


@inner
def judge(rtol, wary, largest, first, count, one, verdict):
    """Decide the verdict by the relative jump from `write_jump`; infinite without a force."""
    retained, relative = one.retained, one.relative
    for b in range(count):
        left, jump = retained[b], relative[b]
        code = UNDECIDED
        if left > 0.0 and largest[b] > 0.0:
            if jump > wary * GUARD_BAND:
                code = NOT_TOLERATED
            elif (
                left > (wary * GUARD_BAND) ** 2 * largest[b]
            ):  # no tolerance removes another direction
                code = by_tolerance(jump, rtol, wary)
        verdict[first + b] = code


@inner
def by_tolerance(jump, rtol, wary):
    """Return the verdict where the jump itself does not depend on the tolerance."""
    if jump > wary * GUARD_BAND:
        return NOT_TOLERATED
    if jump < rtol / GUARD_BAND:
        return TOLERATED
    return BORDERLINE if rtol * GUARD_BAND < jump < wary / GUARD_BAND else UNDECIDED


@inner
def write_jump(rows, weights, force, one):
    """Compute ‖ΔF‖/‖F̂‖ and the norms of forces and moments, in the last three fields of `Lost`."""
    part, whole, relative = one.part, one.a, one.relative
    forces, moments = one.forces, one.moments
    dot(force, force, whole)
    add_squares(part, relative)
    for b in range(LANES):
        relative[b] = math.sqrt(relative[b]) / math.sqrt(whole[b])
        forces[b], moments[b] = 0.0, 0.0
    for i in range(part.shape[0]):
        weight = weights[i]
        if rows[i] < 3:
            for b in range(LANES):
                forces[b] += part[i, b] * part[i, b]
        else:
            for b in range(LANES):
                moments[b] += (part[i, b] * weight) ** 2
    for b in range(LANES):
        forces[b], moments[b] = math.sqrt(forces[b]), math.sqrt(moments[b])


@inner
def limit_capability(direction, rtol, size, has_free, d, one, least, most):
    """Compute the interval of s·d that can be commanded (`exact.on_plane`), without limits."""
    along, whole, retained = one.a, one.relative, one.retained
    for b in range(LANES):
        whole[b] = 0.0
    for j in range(size):
        dot(one.basis[j], d, along)
        for b in range(LANES):
            whole[b] += along[b] * along[b]
    square = 0.0
    for i in range(direction.size):
        square += direction[i] ** 2
    nothing = rtol**2 * square
    for b in range(LANES):
        offset = one.offset[b] if has_free else 0.0
        is_aside = whole[b] <= nothing
        close = abs(whole[b] - nothing) <= (GUARD_BAND - 1.0) * nothing
        retained[b] = math.nan if close else retained[b]
        reach = -offset / along[b]
        if has_free and one.idle[b] >= 0.0:
            falls = one.idle[b] > rtol
            least[b], most[b] = 0.0, (-1.0 if falls else math.inf)
        elif offset == 0.0:
            least[b], most[b] = 0.0, (math.inf if is_aside else 0.0)
        else:
            is_reached = (not is_aside) & (reach >= 0.0)
            least[b], most[b] = (reach, reach) if is_reached else (0.0, -1.0)


@inner
def keep_idle(question, s, first, count, largest, one, answers):
    """Write the results where the column of the free-swinging joint is zero."""
    rtol, wary = question.rtol, question.wary
    for b in range(count):
        at, idle, left = first + b, one.idle[b], one.retained[b]
        if idle < 0.0:
            continue
        answers.rank_lost[s, at] = 0
        answers.sigma_min[s, at] = math.sqrt(left)
        answers.margin[s, at] = math.sqrt(left / largest[b])
        answers.rho[s, at] = 1.0
        is_sure = left > (wary * GUARD_BAND) ** 2 * largest[b]  # no tolerance removes a direction
        answers.verdict[s, at] = by_tolerance(idle, rtol, wary) if is_sure else UNDECIDED
        falls = idle > rtol  # the arm cannot stand still
        if question.force.size:
            answers.jump[s, at] = math.nan if falls else 0.0
            answers.relative_jump[s, at] = 1.0 if falls else 0.0
            if answers.moment_jump.size:
                answers.moment_jump[s, at] = math.nan if falls else 0.0
