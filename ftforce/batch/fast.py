"""The fast part of the fault analysis: σ_min and ρ of every fault set, LANES postures at a time.

J is never kept: it lives in the workspace of LANES postures, which fits into the processor's
caches. Per posture and fault set the smallest eigenvalue and the determinant of
K Kᵀ = J Jᵀ - Σ J_k J_kᵀ are taken. Where σ_min(K) is clearly larger than every tolerance no
direction is lost and no force jumps, and that is all; everything else is left undecided, for
`ftforce.batch.settle`.
"""

from __future__ import annotations

import math

from ftforce.batch import eigenvalues, lanes
from ftforce.batch.jit import inner, kernel
from ftforce.batch.lanes import LANES
from ftforce.batch.results import BORDERLINE, TOLERATED

UNDECIDED = -1
LEAST_MARGIN = 2e-4
"""Below, the root of an eigenvalue of K Kᵀ has lost too many digits: against an SVD the worst
relative errors of σ_min and ρ were 3e-9 (Panda) and 2e-8 (UR5) at 2e-4, and 5e-9 from 4e-4 on."""
_CLEAR = 1.0 + 1e-6  # closer to a bound than this nothing is decided here


@kernel
def evaluate(mechanism, faults, question, q, answers, work):
    """Fill the answers for the postures q, shape (k, n), where no bound is near."""
    k = q.shape[0]
    forget(answers)
    for first in range(0, k, LANES):
        count = min(LANES, k - first)
        for b in range(LANES):
            work.chosen[b] = min(first + b, k - 1)
        lanes.place_frames(mechanism, q, work.chosen, work)
        lanes.task_jacobian(mechanism, question, work)
        for i in range(3):
            for b in range(count):
                answers.tip[first + b, i] = work.tip[9 + i, b]
        lanes.gram(work.J, work.A)
        evaluate_healthy(question, first, count, work, answers)
        if question.direction.size:
            if question.weighs:
                lanes.weight_torque(mechanism, work)
            reaches(question, work)
        for s in range(faults.locked.shape[0]):
            if faults.swings[s]:  # a joint without torque always takes a direction
                leave(answers.verdict[s], first, count)
                continue
            joints = faults.joints[faults.start[s] : faults.start[s + 1]]
            lanes.downdate(work.A, work.J, joints, work.B)
            outermost_eigenvalue(-1.0, work)
            if mark_clear(question, work):
                decide(question, work, answers.verdict[s], first, count)
            write(work, answers.sigma_min[s], answers.margin[s], answers.rho[s], first, count)
            if question.direction.size:
                write_capability(faults.locked[s], work, answers.capability[s], first, count)


@inner
def forget(answers):
    """Write what holds where nothing is lost: zeros."""
    answers.verdict[:] = 0
    answers.rank_lost[:] = 0
    for jump in (answers.jump, answers.moment_jump, answers.relative_jump):
        jump[:] = 0.0


@inner
def evaluate_healthy(question, first, count, work, answers):
    """Take σ_max(J), σ_min(J) and w(J) of J Jᵀ, and what divides by them."""
    m = work.J.shape[0]
    x, step, largest = work.x, work.step, work.largest
    lanes.downdate(work.A, work.J, work.chosen[:0], work.B)
    outermost_eigenvalue(1.0, work)
    for b in range(LANES):
        largest[b] = x[b] if abs(step[b]) <= eigenvalues.CLOSE * x[b] else math.nan
    lanes.downdate(work.A, work.J, work.chosen[:0], work.B)
    outermost_eigenvalue(-1.0, work)
    mark_clear(question, work)
    for b in range(LANES):
        work.over[0, b] = 1.0 / math.sqrt(max(largest[b], 0.0))
    for b in range(LANES):
        work.over[1, b] = 1.0 / math.sqrt(max(work.determinant[b], 0.0))
    for b in range(count):
        answers.rank[first + b] = m if work.clear[b] > 0.0 else UNDECIDED
        answers.healthy_margin[first + b] = math.sqrt(max(x[b], 0.0)) * work.over[0, b]


@inner
def outermost_eigenvalue(side, work):
    """Leave in work.x the smallest (-1) or largest (1) eigenvalue of B, which is used up.

    For the smallest the determinant is left, too.
    """
    m, x, step = work.B.shape[0], work.x, work.step
    if m == 3:
        eigenvalues.outermost_of_three(work.B, side, x, work.determinant)
        for b in range(LANES):
            step[b] = 0.0
        return
    diagonal, square, p = work.terms[5, :m], work.terms[1], work.terms[2]
    slope, bend = work.terms[3], work.terms[4]
    for b in range(LANES):
        x[b] = 0.0
    if side > 0.0:
        for i in range(m):
            for b in range(LANES):
                x[b] += work.B[i, i, b]
    eigenvalues.tridiagonalize(work.B, diagonal, square, p, slope)
    if side < 0.0:
        eigenvalues.tridiagonal_values(diagonal, square, x, p, slope, bend)
        for b in range(LANES):
            work.determinant[b] = p[0, b]
    eigenvalues.tridiagonal_root(diagonal, square, x, step, p, slope, bend)


@inner
def mark_clear(question, work):
    """Mark with 1 where σ_min is clearly larger than every tolerance; return whether not all are.

    With 0.5 it is known well and clearly larger than rtol: no direction is lost, but with a larger
    tolerance one might be.
    """
    x, step, largest, clear = work.x, work.step, work.largest, work.clear
    least = max(question.rtol * _CLEAR, LEAST_MARGIN) ** 2
    safe = max(question.wary * _CLEAR, LEAST_MARGIN) ** 2
    unclear = 0
    for b in range(LANES):
        converged = abs(step[b]) <= eigenvalues.CLOSE * x[b]
        known = converged & (x[b] > least * largest[b])
        far = converged & (x[b] > safe * largest[b])
        clear[b] = 1.0 if far else (0.5 if known else 0.0)
        unclear += 0 if far else 1
    return unclear > 0


@inner
def decide(question, work, verdict, first, count):
    """Judge where one direction, and no more, would be lost by a larger tolerance.

    That tolerance is the margin. The force is kept with smaller ones, and with larger ones if its
    share along the direction, which then jumps, is below.
    """
    asks, m = question.force.size > 0, work.B.shape[0]
    below, share = work.bound, work.share
    if m > 1:
        only_one_below(question.wary / _CLEAR, work, below)
    if asks:
        lanes.turn_vector(question, question.force, work.tip, work.vector)
        share_of_smallest(work, share)
    for b in range(count):
        if work.clear[b] == 1.0:
            continue
        margin2 = work.x[b] / work.largest[b]
        certain = work.clear[b] == 0.5 and (m == 1 or below[b] == 1.0)
        certain = certain and margin2 * _CLEAR < (question.wary / _CLEAR) ** 2
        code = BORDERLINE
        if asks:
            close = abs(share[b] - margin2) <= (_CLEAR - 1.0) * margin2
            certain = certain and not close and share[b] >= 0.0
            code = TOLERATED if share[b] < margin2 else BORDERLINE
        verdict[first + b] = code if certain else UNDECIDED


@inner
def only_one_below(wary, work, below):
    """Count the eigenvalues of K Kᵀ that a tolerance just above ``wary`` would take for lost."""
    m, largest, bound = work.B.shape[0], work.largest, work.share
    for b in range(LANES):
        bound[b] = (wary * _CLEAR * _CLEAR * _CLEAR) ** 2 * largest[b]
    if m > 3 or m == 2:
        eigenvalues.count_below(work.terms[5, :m], work.terms[1], bound, below, work.terms[2, 0])
        return
    third, unused = work.terms[0, 0], work.terms[0, 1]
    eigenvalues.outermost_of_three(work.B, 1.0, third, unused)
    for b in range(LANES):
        second = work.B[0, 0, b] + work.B[1, 1, b] + work.B[2, 2, b] - third[b] - work.x[b]
        below[b] = 1.0 if second > bound[b] else 2.0


@inner
def share_of_smallest(work, share):
    """Share of the force along the direction of the smallest eigenvalue of K Kᵀ."""
    m, terms = work.B.shape[0], work.terms
    if m == 3:
        eigenvalues.share_of_three(work.B, work.x, work.vector, share)
    else:
        eigenvalues.share_of_tridiagonal(
            work.B, terms[5, :m], terms[1], work.x, work.vector, share, terms[2], terms[3], terms[4]
        )


@inner
def leave(verdict, first, count):
    """Leave all postures undecided."""
    for b in range(count):
        verdict[first + b] = UNDECIDED


@inner
def write(work, sigma_min, margin, rho, first, count):
    """Write the measures; where they are not good enough they will be written over."""
    sigma, value, over = work.x, work.step, work.over
    for b in range(LANES):
        sigma[b] = math.sqrt(max(sigma[b], 0.0))
    copy(sigma, sigma_min, first, count)
    for b in range(LANES):
        value[b] = sigma[b] * over[0, b]
    copy(value, margin, first, count)
    for b in range(LANES):
        value[b] = math.sqrt(max(work.determinant[b], 0.0)) * over[1, b]
    copy(value, rho, first, count)


@inner
def copy(lane, row, first, count):
    """Copy the lanes that are postures."""
    for b in range(count):
        row[first + b] = lane[b]


@inner
def write_capability(locked, work, capability, first, count):
    """Write how far s·d goes: what is left of it is what the narrowest limit leaves."""
    least, most, reach = work.x, work.step, work.reach  # the first two are done with
    for b in range(LANES):
        least[b], most[b] = 0.0, math.inf
    for k in range(locked.size):
        side = 2 if locked[k] else 0
        for b in range(LANES):
            least[b] = max(least[b], reach[k, side, b])
        for b in range(LANES):
            most[b] = min(most[b], reach[k, side + 1, b])
    for b in range(LANES):
        most[b] = most[b] if most[b] >= least[b] else math.nan
    copy(most, capability, first, count)


@inner
def reaches(question, work):
    """Interval of s·d that each joint's motor, and brake, allows (`ftforce.feasible.reach`)."""
    m, n = work.J.shape[0], work.J.shape[1]
    lever, d = work.step, work.vector
    lanes.turn_vector(question, question.direction, work.tip, d)
    size = 0.0
    for i in range(m):
        size += question.direction[i] ** 2
    idle = question.rtol * math.sqrt(size)
    for k in range(n):
        for b in range(LANES):
            lever[b] = 0.0
        for i in range(m):
            for b in range(LANES):
                lever[b] += work.J[i, k, b] * d[i, b]
        interval(question.effort[k], idle, lever, work.weight[k], work.largest, work.reach[k, :2])
        interval(question.brake[k], idle, lever, work.weight[k], work.largest, work.reach[k, 2:])


@inner
def interval(limit, idle, lever, weight, largest, ends):
    """Interval of s·d that one limit allows; without a lever it only has to bear the weight."""
    if not limit > 0.0:  # unknown
        for b in range(LANES):
            ends[0, b] = -math.inf
            ends[1, b] = math.inf
        return
    for b in range(LANES):
        lower, upper = -limit - weight[b], limit - weight[b]
        one, other = lower / lever[b], upper / lever[b]
        is_idle = abs(lever[b]) <= idle * math.sqrt(largest[b])
        beyond = (lower > 0.0) | (upper < 0.0)
        ends[0, b] = (math.inf if beyond else -math.inf) if is_idle else min(one, other)
        ends[1, b] = (-math.inf if beyond else math.inf) if is_idle else max(one, other)
