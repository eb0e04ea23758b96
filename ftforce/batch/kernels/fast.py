"""The fast part of the fault analysis: σ_min and ρ of every fault set, LANES postures at a time.

J is not stored: it exists only in the workspace of LANES postures, which fits in cache. Tasks of
three rows have closed forms (`three`); for others, one decomposition of J serves all sets that
lock one joint (`secular`); some sets lose directions in every posture (`lost`). Cases close to a
tolerance, and those covered by none of these, are left undecided for `settle`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.kernels import lanes, lost, secular, spectrum, three
from ftforce.batch.kernels.jit import inner, kernel
from ftforce.batch.kernels.layout import GUARD_BAND, LANES, TOLERATED, UNDECIDED, aligned_arrays

if TYPE_CHECKING:
    import numpy as np

    from ftforce.batch.kernels.lanes import Work
    from ftforce.batch.kernels.lost import Lost
    from ftforce.batch.kernels.secular import Secular
    from ftforce.batch.kernels.spectrum import Spectrum


class Lane(NamedTuple):
    """Intermediate results of LANES postures and one fault set; n joints."""

    A: np.ndarray  # (3, 3, LANES): J Jᵀ of three rows
    B: np.ndarray  # (3, 3, LANES): K Kᵀ of three rows
    x: np.ndarray  # (LANES,): smallest eigenvalue of K Kᵀ
    smallest: np.ndarray  # (LANES,): eigenvalue of J Jᵀ
    largest: np.ndarray  # (LANES,): eigenvalue of J Jᵀ, NaN where nothing may be decided
    over: np.ndarray  # (2, LANES): 1/σ_max(J) and 1/w(J)
    reach: np.ndarray  # (n, 4, LANES): bounds on s·d from each motor, and from each brake
    least: np.ndarray  # (LANES,): interval of s·d
    most: np.ndarray  # (LANES,)
    a: np.ndarray  # (LANES,): workspace


class Workspace(NamedTuple):
    """Workspace of `evaluate`, in parts: kernels with fewer arguments compile faster."""

    arm: Work
    lane: Lane
    spectrum: Spectrum
    secular: Secular
    lost: Lost


def bench(joints, n, m):
    """Return a workspace."""
    rows, line = [(3, 3, LANES), (3, 3, LANES)], (LANES,)
    ends = [(2, LANES), (n, 4, LANES), line, line, line]
    lane = Lane(*aligned_arrays([*rows, line, line, line, *ends]))
    parts = (spectrum.spectrum(m, n), secular.secular(m, n), lost.lost(m, n))
    return Workspace(lanes.workspace(joints, n, m), lane, *parts)


def evaluate(mechanism, faults, question, q, answers, work):
    """Fill in the results for the postures q, shape (k, n), where no tolerance is near.

    Only the kernels that the question needs are called, and hence compiled.
    """
    given = (mechanism, faults, question, q, answers, work.arm, work.lane)
    if question.rows.size == 3:
        evaluate_three(*given)
    else:
        evaluate_others(*given, work.spectrum, work.secular, work.lost)
    if faults.has_free.any():
        evaluate_free(*given, work.spectrum, work.lost)


@kernel
def evaluate_three(mechanism, faults, question, q, answers, arm, lane):
    """Evaluate sets of locked joints for a task of three rows."""
    forget(answers.verdict, answers.rank_lost)
    forget_jump(answers.jump, answers.moment_jump, answers.relative_jump)
    for first in range(0, q.shape[0], LANES):
        count = place(mechanism, question, q, first, arm)
        three.evaluate_healthy(question.rtol, arm.J, lane)
        write_healthy(3, first, count, arm.tip, lane, answers)
        if question.direction.size:
            reaches(question, arm.J, arm.direction, arm.weight, lane)
        for s in range(faults.locked.shape[0]):
            joints = faults.joints[faults.start[s] : faults.start[s + 1]]
            if faults.has_free[s] or arm.J.shape[1] - joints.size < 3:
                leave(first, count, answers.verdict[s])
                continue
            three.answer(
                question.rtol, question.wary, joints, arm.J, arm.force[: question.force.size],
                first, count, lane, answers.sigma_min[s], answers.margin[s], answers.rho[s],
                answers.verdict[s],
            )  # fmt: skip
            if question.direction.size:
                start_whole(lane.least, lane.most)
                limit(
                    faults.locked[s], faults.free[s], lane.reach, lane.least, lane.most, first,
                    count, answers.capability[s],
                )  # fmt: skip


@kernel
def evaluate_others(mechanism, faults, question, q, answers, arm, lane, spec, one, gone):
    """Evaluate sets of locked joints for a task of any other number of rows."""
    m, n = arm.J.shape[0], arm.J.shape[1]
    asks, moves = question.force.size > 0, question.direction.size > 0
    shares, loses = common_work(faults.start, faults.has_free, m, n)
    forget(answers.verdict, answers.rank_lost)
    forget_jump(answers.jump, answers.moment_jump, answers.relative_jump)
    for first in range(0, q.shape[0], LANES):
        count = place(mechanism, question, q, first, arm)
        evaluate_healthy(question.rtol, arm.J, lane, spec)
        write_healthy(m, first, count, arm.tip, lane, answers)
        secular.prepare(arm.J, spec, arm.force, asks, one)
        secular.prepare_bound(spec.square, lane.largest, question.wary, one)
        if shares:
            for k in range(n):
                secular.find_root(k, spec.square, lane.largest, question.rtol, one)
        if loses:
            lost.prepare(spec.W, spec.sigma, one.V, gone)
        if moves:
            reaches(question, arm.J, arm.direction, arm.weight, lane)
        for s in range(faults.locked.shape[0]):
            joints = faults.joints[faults.start[s] : faults.start[s + 1]]
            size = 0  # number of directions lost in every posture
            keeps = joints.size == 0 or (joints.size == 1 and n > m)
            if faults.has_free[s]:
                keeps = False
            elif keeps:
                answer_single(
                    question.wary, joints, asks, first, count, lane, spec, one,
                    answers.sigma_min[s], answers.margin[s], answers.rho[s], answers.verdict[s],
                )  # fmt: skip
            elif n == m:
                lost.lose_span(joints, lane.smallest, gone)
                size = joints.size
            elif n == m + 1 and joints.size == 2:
                lost.lose_pair(joints[0], joints[1], one, gone)
                size = 1
            if moves and (keeps or size > 0):
                start_whole(lane.least, lane.most)
                if size > 0:
                    lost.limit_capability(
                        question.direction, question.rtol, size, False, arm.direction[:m], gone,
                        lane.least, lane.most,
                    )  # fmt: skip
                limit(
                    faults.locked[s], faults.free[s], lane.reach, lane.least, lane.most, first,
                    count, answers.capability[s],
                )  # fmt: skip
            if size > 0:
                write_lost(
                    question, s, size, False, first, count, arm.force, lane.largest, gone, answers
                )
            elif not keeps:
                leave(first, count, answers.verdict[s])


@kernel
def evaluate_free(mechanism, faults, question, q, answers, arm, lane, spec, gone):
    """Evaluate sets of one free-swinging joint."""
    m = arm.J.shape[0]
    for first in range(0, q.shape[0], LANES):
        count = place(mechanism, question, q, first, arm)
        evaluate_healthy(question.rtol, arm.J, lane, spec)
        if question.direction.size:
            reaches(question, arm.J, arm.direction, arm.weight, lane)
        for s in range(faults.locked.shape[0]):
            k = only_one(faults.free[s])
            if k < 0 or faults.start[s + 1] > faults.start[s]:
                continue
            lost.lose_column(k, question.wary, arm.J, arm.weight, lane.smallest, lane.largest, gone)
            if question.direction.size:
                lost.limit_capability(
                    question.direction,
                    question.rtol,
                    1,
                    True,
                    arm.direction[:m],
                    gone,
                    lane.least,
                    lane.most,
                )
                limit(
                    faults.locked[s], faults.free[s], lane.reach, lane.least, lane.most, first,
                    count, answers.capability[s],
                )  # fmt: skip
            write_lost(question, s, 1, True, first, count, arm.force, lane.largest, gone, answers)
            lost.keep_idle(question, s, first, count, lane.largest, gone, answers)


@inner
def place(mechanism, question, q, first, arm):
    """Compute the kinematics of the next postures, and return how many lanes they fill."""
    count = min(LANES, q.shape[0] - first)
    for b in range(LANES):
        arm.chosen[b] = first + min(b, count - 1)
    lanes.place(mechanism, question, q, arm)
    return count


@inner
def common_work(start, has_free, m, n):
    """Return whether any fault set needs the secular equation, and any the lost directions."""
    shares, loses = False, False
    for s in range(has_free.size):
        f = start[s + 1] - start[s]
        if not has_free[s]:
            shares |= f == 1 or (f == 2 and n == m + 1)
            loses |= f > n - m
    return shares and n > m, loses and n >= m


@inner
def forget(verdict, rank_lost):
    """Initialize a set as tolerated, with no rank lost."""
    verdict[:] = TOLERATED
    rank_lost[:] = 0


@inner
def forget_jump(jump, moment_jump, relative_jump):
    """Initialize the jumps to zero."""
    jump[:] = 0.0
    moment_jump[:] = 0.0
    relative_jump[:] = 0.0


@inner
def leave(first, count, verdict):
    """Leave a set undecided."""
    for b in range(count):
        verdict[first + b] = UNDECIDED


@inner
def write_healthy(m, first, count, tip, lane, answers):
    """Write the results of the healthy arm."""
    for b in range(count):
        for i in range(3):
            answers.tip[first + b, i] = tip[9 + i, b]
        answers.rank[first + b] = m if lane.largest[b] > 0.0 else UNDECIDED
        answers.healthy_margin[first + b] = lane.x[b]


@inner
def evaluate_healthy(rtol, J, lane, spec):
    """Decompose J, and mark the lanes whose rank is not certain."""
    m = J.shape[0]
    spectrum.decompose(J, spec)
    least = max(rtol * GUARD_BAND, secular.LEAST) ** 2
    for b in range(LANES):
        lane.smallest[b], lane.largest[b] = spec.square[m - 1, b], spec.square[0, b]
        lane.over[0, b] = 1.0 / spec.sigma[0, b]
        lane.x[b] = spec.sigma[m - 1, b] * lane.over[0, b]
        is_clear = (lane.smallest[b] > least * lane.largest[b]) & (spec.fails[b] == 0.0)
        lane.largest[b] = lane.largest[b] if is_clear else math.nan


@inner
def start_whole(least, most):
    """Initialize the interval of s·d to s ≥ 0."""
    for b in range(LANES):
        least[b], most[b] = 0.0, math.inf


@inner
def write_lost(question, s, size, has_free, first, count, force, largest, gone, answers):
    """Write the results of a set that loses ``size`` directions."""
    m = gone.part.shape[0]
    for b in range(LANES):
        gone.relative[b] = math.inf
    if question.force.size:
        lost.project(force[:m], size, has_free, gone)
        lost.write_jump(question.rows, question.weights, force[:m], gone)
        jump = gone.forces if question.rows[0] < 3 else gone.moments
        for b in range(count):
            answers.jump[s, first + b] = jump[b]
            answers.relative_jump[s, first + b] = gone.relative[b]
        if answers.moment_jump.size:
            for b in range(count):
                answers.moment_jump[s, first + b] = gone.moments[b]
    for b in range(count):
        answers.rank_lost[s, first + b] = size
        answers.sigma_min[s, first + b] = 0.0
        answers.margin[s, first + b] = 0.0
        answers.rho[s, first + b] = 0.0
    lost.judge(question.rtol, question.wary, largest, first, count, gone, answers.verdict[s])


@inner
def only_one(mask):
    """Return the index of the only true element of a mask, -1 unless there is exactly one."""
    found, count = -1, 0
    for k in range(mask.size):
        if mask[k]:
            found, count = k, count + 1
    return found if count == 1 else -1


@inner
def answer_single(
    wary, joints, asks, first, count, lane, spec, one, sigma_min, margin, rho, verdict
):
    """Evaluate a set that locks no joint, or one."""
    x, square, share, below = lane.x, lane.least, lane.most, lane.a
    m = spec.square.shape[0]
    if joints.size == 0:
        for b in range(LANES):
            x[b], square[b] = lane.smallest[b], 1.0
            below[b] = one.below[b]
            share[b] = one.F[m - 1, b] ** 2 / one.size[b]
    else:
        k = joints[0]
        for b in range(LANES):
            x[b], square[b] = one.x[k, b], one.rest[k, b]
        secular.count_below(k, one, below)
        if asks:
            secular.share_along(k, spec.sigma, spec.square, one, share)
    safe = max(wary * GUARD_BAND, secular.LEAST) ** 2
    for b in range(count):
        sigma = math.sqrt(x[b])
        sigma_min[first + b] = sigma
        margin[first + b] = sigma * lane.over[0, b]
        rho[first + b] = math.sqrt(square[b])
    for b in range(count):
        if not x[b] > safe * lane.largest[b]:
            code = UNDECIDED
            if x[b] > 0.0 and below[b] == 1.0:
                code = three.judge(wary, x[b] / lane.largest[b], asks, share[b])
            verdict[first + b] = code


@inner
def limit(locked, free, reach, least, most, first, count, capability):
    """Write the capability: the interval of s·d intersected with those of all limits."""
    for k in range(locked.size):
        if free[k]:
            continue
        side = 2 if locked[k] else 0
        for b in range(LANES):
            least[b] = max(least[b], reach[k, side, b])
            most[b] = min(most[b], reach[k, side + 1, b])
    for b in range(count):
        capability[first + b] = most[b] if most[b] >= least[b] else math.nan


@inner
def reaches(question, J, d, weight, lane):
    """Compute the interval of s·d that each joint's motor, and brake, allows."""
    m, n = J.shape[0], J.shape[1]
    lever = lane.a
    size = 0.0
    for i in range(m):
        size += question.direction[i] ** 2
    idle = question.rtol * math.sqrt(size)
    for k in range(n):
        for b in range(LANES):
            lever[b] = 0.0
        for i in range(m):
            for b in range(LANES):
                lever[b] += J[i, k, b] * d[i, b]
        interval(question.effort[k], idle, lever, weight[k], lane.largest, lane.reach[k, :2])
        interval(question.brake[k], idle, lever, weight[k], lane.largest, lane.reach[k, 2:])


@inner
def interval(limit, idle, lever, weight, largest, ends):
    """Compute the interval of s·d within one limit; without a lever arm only gravity counts."""
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
