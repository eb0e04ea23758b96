"""Fault sets that lose directions of force in every posture, LANES postures at a time.

With fewer healthy joints than task rows, the directions Null(Kᵀ) are lost; with one free-swinging
joint, the direction of its column. The remaining eigenvalues of K Kᵀ, or of (I - ûûᵀ) J Jᵀ
(I - ûûᵀ), interlace with those of J Jᵀ (Cauchy), so the rank follows without another decomposition.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.kernels.exact import SHARE_OF_WEIGHT, SLIGHT
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

_INDEPENDENT = 1e-6
"""A vector with a smaller squared distance from the span of the others, relative to its squared
norm, is left to `settle`."""

_ZERO = 1e-14  # relative to σ_max; smaller columns are rounding errors
_ROUNDING = 1e-12  # smaller torques are rounding errors in `exact.balance_free`


class Lost(NamedTuple):
    """Lost directions of LANES postures."""

    P: np.ndarray  # (n, m, LANES): (J Jᵀ)⁻¹ J_k, one row per joint
    basis: np.ndarray  # (m, m, LANES): orthonormal rows
    lost_force: np.ndarray  # (m, LANES): lost part of the force
    retained: np.ndarray  # (LANES,): lower bound on the remaining eigenvalues; NaN if unknown
    offset: np.ndarray  # (LANES,): force along the only lost direction that carries the weight
    # (LANES,): torque that no force balances, relative to all; -1 if a force does
    unbalanced: np.ndarray
    length: np.ndarray  # (LANES,): ‖J_k‖ of the free-swinging joint
    weight: np.ndarray  # (LANES,): its gravity torque
    friction: np.ndarray  # (LANES,): ε, torque that its friction bears
    a: np.ndarray  # (LANES,): workspace, like the rest
    relative: np.ndarray  # (LANES,): ‖ΔF‖/‖F̂‖, written by `write_jump`
    forces: np.ndarray  # (LANES,): norms of the jump
    moments: np.ndarray  # (LANES,)


def workspace(m, n):
    """Return a workspace.

    Parameters
    ----------
    m, n :
        Numbers of task rows and of joints.
    """
    return Lost(*aligned_arrays([(n, m, LANES), (m, m, LANES), (m, LANES), *[LANES] * 10]))


@inner
def prepare(W, sigma, V, lost):
    """Compute P = U diag(1/σ) Vᵀ = (J Jᵀ)⁻¹ J.

    Parameters
    ----------
    W, sigma :
        Left singular vectors and singular values of J, see `SVD`.
    V :
        Right singular vectors, shape (n, m, LANES).
    lost :
        Workspace; its P is filled in.
    """
    inverse_sigma = lost.a
    lost.P[:] = 0.0
    for i in range(W.shape[0]):
        for b in range(LANES):
            inverse_sigma[b] = 1.0 / sigma[i, b]
        for k in range(V.shape[0]):
            for r in range(W.shape[0]):
                for b in range(LANES):
                    lost.P[k, r, b] += W[i, r, b] * V[k, i, b] * inverse_sigma[b]


@inner
def _add_to_basis(size, lost):
    """Make row ``size`` of the basis a unit vector orthogonal to the earlier ones."""
    row, before, after, along = lost.basis[size], lost.a, lost.relative, lost.forces
    m, retained = row.shape[0], lost.retained
    _square_norm(row, before)
    for j in range(2 * size):  # orthogonalize twice, for accuracy
        other = lost.basis[j % size]
        _dot(other, row, along)
        for i in range(m):
            for b in range(LANES):
                row[i, b] -= along[b] * other[i, b]
    _square_norm(row, after)
    for b in range(LANES):
        retained[b] = retained[b] if after[b] > _INDEPENDENT * before[b] else math.nan
        after[b] = 1.0 / math.sqrt(after[b])
    for i in range(m):
        for b in range(LANES):
            row[i, b] *= after[b]


@inner
def _square_norm(row, total):
    """Set total = ‖row‖²."""
    _dot(row, row, total)


@inner
def _dot(x, y, total):
    """Set total = xᵀy."""
    for b in range(LANES):
        total[b] = x[0, b] * y[0, b]
    for i in range(1, x.shape[0]):
        for b in range(LANES):
            total[b] += x[i, b] * y[i, b]


@inner
def lose_span(joints, smallest, lost):
    """With as many joints as rows, each locked joint loses one direction, its row of J⁻¹.

    Parameters
    ----------
    joints :
        Indices of the locked joints.
    smallest :
        Smallest eigenvalue of J Jᵀ, shape (LANES,).
    lost :
        Workspace, after `prepare`.
    """
    for b in range(LANES):
        lost.retained[b] = smallest[b]
    for at in range(joints.size):
        row, P = lost.basis[at], lost.P[joints[at]]
        for i in range(row.shape[0]):
            for b in range(LANES):
                row[i, b] = P[i, b]
        _add_to_basis(at, lost)


@inner
def lose_pair(i, j, secular, lost):
    """With one joint more than rows, locking i < j loses P_S a with N_SS a = 0: N has rank one.

    The remaining eigenvalues are no smaller than with either joint locked alone.

    Parameters
    ----------
    i, j :
        Indices of the locked joints.
    secular :
        Workspace of `secular`, with N and the smallest eigenvalues.
    lost :
        Workspace, after `prepare`.
    """
    x, N_kk, row, retained = secular.x, secular.N_kk, lost.basis[0], lost.retained
    N, first, second = secular.N[j, i], lost.a, lost.relative
    for b in range(LANES):
        larger = N_kk[j, b] > N_kk[i, b]
        first[b] = N_kk[j, b] if larger else N[b]
        second[b] = -N[b] if larger else -N_kk[i, b]
        retained[b] = x[j, b] if larger else x[i, b]
    for r in range(row.shape[0]):
        for b in range(LANES):
            row[r, b] = first[b] * lost.P[i, r, b] + second[b] * lost.P[j, r, b]
    for b in range(LANES):  # reject if the difference of the two cancels
        retained[b] = retained[b] if max(N_kk[i, b], N_kk[j, b]) > _INDEPENDENT else math.nan
    _add_to_basis(0, lost)


@inner
def lose_column(k, question, J, weight, smallest, largest, lost):
    """With joint k free-swinging, J_kᵀ F' + [rnea]_k = 0 loses the direction of its column.

    F' = F - û (ûᵀF + [rnea]_k/‖J_k‖), so the component of F' along û is fixed. If the column is
    zero, the tip lies on the joint's axis: no force balances the joint, only its friction, and no
    direction is lost.

    Parameters
    ----------
    k :
        Index of the free-swinging joint.
    question :
        Friction and tolerances.
    J :
        Task Jacobian, shape (m, n, LANES).
    weight :
        Gravity torques, shape (n, LANES).
    smallest, largest :
        Extreme eigenvalues of J Jᵀ, shape (LANES,).
    lost :
        Workspace.
    """
    row, size, total, most = lost.basis[0], lost.moments, lost.a, lost.friction
    retained, offset, unbalanced = lost.retained, lost.offset, lost.unbalanced
    m, n, given = J.shape[0], J.shape[1], question.friction[k]
    for i in range(m):
        for b in range(LANES):
            row[i, b] = J[i, k, b]
    _square_norm(row, size)
    _add_to_basis(0, lost)
    for b in range(LANES):
        retained[b] = smallest[b]
        total[b], most[b] = 0.0, 0.0
    for j in range(n):
        for b in range(LANES):
            total[b] += weight[j, b] * weight[j, b]
            most[b] = max(most[b], abs(weight[j, b]))
    for b in range(LANES):
        most[b] = SHARE_OF_WEIGHT * most[b] if math.isnan(given) else given
        most[b] = max(most[b], question.rtol * math.sqrt(total[b]))
        share = weight[k, b] * weight[k, b]
        is_significant = share > (2.0 * _ROUNDING) ** 2 * total[b]
        is_negligible = not share > (0.5 * _ROUNDING) ** 2 * total[b]
        lost.length[b] = math.sqrt(size[b])
        lost.weight[b] = weight[k, b] if is_significant else 0.0
        offset[b] = lost.weight[b] / lost.length[b] if is_significant else 0.0
        is_column = size[b] > (question.wary * GUARD_BAND) ** 2 * largest[b]  # whatever tolerance
        is_zero = size[b] <= _ZERO * _ZERO * largest[b]
        torque = math.sqrt(share / total[b]) if is_significant else 0.0
        if given != 0.0:
            torque = math.inf if abs(lost.weight[b]) > most[b] else 0.0
        unbalanced[b] = torque if is_zero else -1.0
        is_known = (is_column | is_zero) & (is_significant | is_negligible)
        retained[b] = retained[b] if is_known else math.nan


@inner
def project(force, size, lost):
    """Store in ``lost_force`` the projection of the force onto the lost directions.

    Parameters
    ----------
    force :
        Requested force, weighted, shape (m, LANES).
    size :
        Number of lost directions.
    lost :
        Workspace with the lost directions.
    """
    along, lost_force = lost.a, lost.lost_force
    for i in range(lost_force.shape[0]):
        for b in range(LANES):
            lost_force[i, b] = 0.0
    for j in range(size):
        _dot(lost.basis[j], force, along)
        for i in range(lost_force.shape[0]):
            for b in range(LANES):
                lost_force[i, b] += along[b] * lost.basis[j, i, b]


@inner
def project_on_column(force, k, question, largest, lost):
    """Store in ``lost_force`` what a free-swinging joint takes from the force, with its own weight.

    Nothing, if friction bears the force as it is (`exact.is_borne`).

    Parameters
    ----------
    force :
        Requested force, weighted, shape (m, LANES).
    k :
        Index of the joint.
    question :
        Friction and tolerances.
    largest :
        Largest eigenvalue of J Jᵀ, shape (LANES,).
    lost :
        Workspace, after `lose_column`.
    """
    along, whole, lost_force = lost.a, lost.relative, lost.lost_force
    has_friction = question.friction[k] != 0.0
    _dot(lost.basis[0], force, along)
    _square_norm(force, whole)
    for b in range(LANES):
        size = math.sqrt(largest[b] * whole[b])
        lever = along[b] * lost.length[b]
        is_short = abs(lever) <= question.wary * size
        is_borne = has_friction & is_short & (abs(lever + lost.weight[b]) <= lost.friction[b])
        is_resting = abs(lost.weight[b]) <= lost.friction[b]
        is_borne &= is_resting | (abs(lever) > question.rtol * size)
        along[b] = 0.0 if is_borne else along[b] + lost.offset[b]
        close = _is_close(abs(lever), question.wary * size)
        close |= _is_close(abs(lever), question.rtol * size)
        lost.retained[b] = math.nan if has_friction & close else lost.retained[b]
    for i in range(lost_force.shape[0]):
        for b in range(LANES):
            lost_force[i, b] = along[b] * lost.basis[0, i, b]


@inner
def _is_close(x, threshold):
    """Return whether x is too close to a threshold to tell on which side it is."""
    return abs(x - threshold) <= (GUARD_BAND - 1.0) * threshold


@inner
def judge(rtol, wary, largest, first, count, lost, verdict):
    """Decide the verdict from the relative jump of `write_jump`, infinite without a force.

    Parameters
    ----------
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    largest :
        Largest eigenvalue of J Jᵀ, shape (LANES,).
    first, count :
        Index of the first posture, and how many lanes are filled.
    lost :
        Workspace, after `write_jump`.
    verdict :
        Filled in, shape (k,).
    """
    retained, relative = lost.retained, lost.relative
    for b in range(count):
        left, jump = retained[b], relative[b]
        code = UNDECIDED
        if left > 0.0 and largest[b] > 0.0:
            if jump > wary * GUARD_BAND:
                code = NOT_TOLERATED
            elif left > (wary * GUARD_BAND) ** 2 * largest[b]:  # no other direction is at risk
                code = _verdict_of_jump(jump, rtol, wary)
        verdict[first + b] = code


@inner
def _verdict_of_jump(jump, rtol, wary):
    """Return the verdict where the jump itself does not depend on the tolerance."""
    if jump > wary * GUARD_BAND:
        return NOT_TOLERATED
    if jump < rtol / GUARD_BAND:
        return TOLERATED
    return BORDERLINE if rtol * GUARD_BAND < jump < wary / GUARD_BAND else UNDECIDED


@inner
def write_jump(rows, weights, force, lost):
    """Compute ‖ΔF‖/‖F̂‖ and the norms of forces and moments, in the last three fields of `Lost`.

    Parameters
    ----------
    rows, weights :
        Rows of the task and their weights, shape (m,).
    force :
        Requested force, weighted, shape (m, LANES).
    lost :
        Workspace, after `project`.
    """
    lost_force, whole, relative = lost.lost_force, lost.a, lost.relative
    forces, moments = lost.forces, lost.moments
    _dot(force, force, whole)
    _square_norm(lost_force, relative)
    for b in range(LANES):
        relative[b] = math.sqrt(relative[b]) / math.sqrt(whole[b])
        forces[b], moments[b] = 0.0, 0.0
    for i in range(lost_force.shape[0]):
        weight = weights[i]
        if rows[i] < 3:
            for b in range(LANES):
                forces[b] += lost_force[i, b] * lost_force[i, b]
        else:
            for b in range(LANES):
                moments[b] += (lost_force[i, b] * weight) ** 2
    for b in range(LANES):
        forces[b], moments[b] = math.sqrt(forces[b]), math.sqrt(moments[b])


@inner
def limit_capability(direction, rtol, size, d, lost, s_min, s_max):
    """Compute the interval of s for which s·d can be commanded, without limits.

    As `exact.largest_multiple`, for locked joints.

    Parameters
    ----------
    direction :
        Weighted direction, shape (m,).
    rtol :
        Relative tolerance.
    size :
        Number of lost directions.
    d :
        The direction in the axes of the rows, shape (m, LANES).
    lost :
        Workspace with the lost directions.
    s_min, s_max :
        Filled with the ends of the interval, shape (LANES,).
    """
    along, whole, retained = lost.a, lost.relative, lost.retained
    for b in range(LANES):
        whole[b] = 0.0
    for j in range(size):
        _dot(lost.basis[j], d, along)
        for b in range(LANES):
            whole[b] += along[b] * along[b]
    square = 0.0
    for i in range(direction.size):
        square += direction[i] ** 2
    threshold = rtol**2 * square
    for b in range(LANES):
        is_orthogonal = whole[b] <= threshold
        retained[b] = math.nan if _is_close(whole[b], threshold) else retained[b]
        s_min[b], s_max[b] = 0.0, (math.inf if is_orthogonal else 0.0)


@inner
def limit_by_column(k, question, d, largest, lost, s_min, s_max):
    """Compute the interval of s in which a free-swinging joint bears s·d.

    As `ftforce.core.feasible_forces.Bearings.interval`.

    Parameters
    ----------
    k :
        Index of the joint.
    question :
        Direction, friction and tolerances.
    d :
        The direction in the axes of the rows, shape (m, LANES).
    largest :
        Largest eigenvalue of J Jᵀ, shape (LANES,).
    lost :
        Workspace, after `lose_column`.
    s_min, s_max :
        Filled with the ends of the interval, shape (LANES,).
    """
    lever, square = lost.a, 0.0
    longest = question.wary if question.friction[k] != 0.0 else question.rtol
    for i in range(question.direction.size):
        square += question.direction[i] ** 2
    _dot(lost.basis[0], d, lever)
    for b in range(LANES):
        size = math.sqrt(largest[b] * square)
        x, w, most = lever[b] * lost.length[b], lost.weight[b], lost.friction[b]
        x = 0.0 if lost.unbalanced[b] >= 0.0 else x  # the column is zero
        is_resting, is_zero = abs(w) <= most, abs(x) <= question.rtol * size
        is_long = abs(x) > longest * size
        first, last = (-most - w) / x, (most - w) / x
        low, high = max(min(first, last), 0.0), max(first, last)
        if is_zero:
            low, high = 0.0, (math.inf if is_resting else -1.0)
        if is_long:  # an equation, [rnea]_k + s J_kᵀ d = 0
            s = -w / x if abs(w) > SLIGHT * most else 0.0
            low, high = s, s
            if s < 0.0:
                low, high = 0.0, (0.0 if is_resting else -1.0)
        s_min[b], s_max[b] = low, high
        close = _is_close(abs(x), longest * size) | _is_close(abs(x), question.rtol * size)
        lost.retained[b] = math.nan if close else lost.retained[b]


@inner
def write_zero_columns(question, s, first, count, largest, lost, answers):
    """Write the results where the column of the free-swinging joint is zero.

    Parameters
    ----------
    question :
        What to compute.
    s :
        Index of the fault set.
    first, count :
        Index of the first posture, and how many lanes are filled.
    largest :
        Largest eigenvalue of J Jᵀ, shape (LANES,).
    lost :
        Workspace, after `lose_column`.
    answers :
        Updated in place.
    """
    rtol, wary = question.rtol, question.wary
    for b in range(count):
        at, unbalanced, left = first + b, lost.unbalanced[b], lost.retained[b]
        if unbalanced < 0.0:
            continue
        answers.rank_lost[s, at] = 0
        answers.sigma_min[s, at] = math.sqrt(left)
        answers.margin[s, at] = math.sqrt(left / largest[b])
        answers.rho[s, at] = 1.0
        code = UNDECIDED
        if left > (wary * GUARD_BAND) ** 2 * largest[b]:  # no tolerance removes a direction
            code = _verdict_of_jump(unbalanced, rtol, wary)
        answers.verdict[s, at] = code
        falls = unbalanced > rtol  # the arm cannot be held in static equilibrium
        if question.force.size:
            answers.jump[s, at] = math.nan if falls else 0.0
            answers.relative_jump[s, at] = 1.0 if falls else 0.0
            if answers.moment_jump.size:
                answers.moment_jump[s, at] = math.nan if falls else 0.0
