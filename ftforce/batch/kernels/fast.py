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

    from ftforce.batch.kernels.lanes import Kinematics
    from ftforce.batch.kernels.lost import Lost
    from ftforce.batch.kernels.secular import Secular
    from ftforce.batch.kernels.spectrum import SVD


class Lane(NamedTuple):
    """Intermediate results of LANES postures and one fault set; n joints."""

    A: np.ndarray  # (3, 3, LANES): J Jᵀ of three rows
    B: np.ndarray  # (3, 3, LANES): K Kᵀ of three rows
    x: np.ndarray  # (LANES,): smallest eigenvalue of K Kᵀ
    smallest: np.ndarray  # (LANES,): eigenvalue of J Jᵀ
    largest: np.ndarray  # (LANES,): eigenvalue of J Jᵀ, NaN where the lane is left undecided
    inverse: np.ndarray  # (2, LANES): 1/σ_max(J) and 1/w(J)
    reach: np.ndarray  # (n, 4, LANES): bounds on s in s·d from each motor, and from each brake
    s_min: np.ndarray  # (LANES,): interval of s in s·d
    s_max: np.ndarray  # (LANES,)
    a: np.ndarray  # (LANES,): workspace


class Workspace(NamedTuple):
    """Workspace of `evaluate`, in parts: kernels with fewer arguments compile faster."""

    arm: Kinematics
    lane: Lane
    svd: SVD
    secular: Secular
    lost: Lost


def workspace(joints, n, m):
    """Return a workspace.

    Parameters
    ----------
    joints :
        Number of joints of the mechanism.
    n, m :
        Numbers of joints of the chain and of task rows.
    """
    rows, line = [(3, 3, LANES), (3, 3, LANES)], (LANES,)
    ends = [(2, LANES), (n, 4, LANES), line, line, line]
    lane = Lane(*aligned_arrays([*rows, line, line, line, *ends]))
    parts = (spectrum.workspace(m, n), secular.workspace(m, n), lost.workspace(m, n))
    return Workspace(lanes.workspace(joints, n, m), lane, *parts)


def evaluate(mechanism, faults, question, q, answers, work):
    """Fill in the results for the postures q, shape (k, n), where no tolerance is near.

    Only the kernels that the question needs are called, and hence compiled.

    Parameters
    ----------
    mechanism, faults, question :
        The arm, the fault sets and what to compute, see `layout`.
    q :
        Joint positions, rad or m, shape (k, n).
    answers :
        Filled with the results; verdicts and ranks left open are `UNDECIDED`.
    work :
        Workspace.
    """
    common = (mechanism, faults, question, q, answers, work.arm, work.lane)
    if question.rows.size == 3:
        _evaluate_three(*common)
    else:
        _evaluate_others(*common, work.svd, work.secular, work.lost)
    if faults.has_free.any():
        _evaluate_free(*common, work.svd, work.lost)


@kernel
def _evaluate_three(mechanism, faults, question, q, answers, arm, lane):
    """Evaluate sets of locked joints for a task of three rows."""
    _reset_verdicts(answers.verdict, answers.rank_lost)
    _reset_jumps(answers.jump, answers.moment_jump, answers.relative_jump)
    for first in range(0, q.shape[0], LANES):
        count = _place(mechanism, question, q, first, arm)
        three.evaluate_healthy(question.rtol, arm.J, lane)
        _write_healthy(3, first, count, arm.tip, lane, answers)
        if question.direction.size:
            _joint_intervals(question, arm.J, arm.direction, arm.weight, lane)
        for s in range(faults.locked.shape[0]):
            joints = faults.joints[faults.start[s] : faults.start[s + 1]]
            if faults.has_free[s] or arm.J.shape[1] - joints.size < 3:
                _leave_undecided(first, count, answers.verdict[s])
                continue
            three.evaluate_set(
                question.rtol, question.wary, joints, arm.J, arm.force[: question.force.size],
                first, count, lane, answers.sigma_min[s], answers.margin[s], answers.rho[s],
                answers.verdict[s],
            )  # fmt: skip
            if question.direction.size:
                _reset_interval(lane.s_min, lane.s_max)
                _write_capability(
                    faults.locked[s], faults.free[s], lane.reach, lane.s_min, lane.s_max, first,
                    count, answers.capability[s],
                )  # fmt: skip


@kernel
def _evaluate_others(
    mechanism, faults, question, q, answers, arm, lane, svd, secular_work, lost_work
):
    """Evaluate sets of locked joints for a task of any other number of rows."""
    m, n = arm.J.shape[0], arm.J.shape[1]
    has_force, has_direction = question.force.size > 0, question.direction.size > 0
    needs_secular, needs_lost = _needed_parts(faults.start, faults.has_free, m, n)
    _reset_verdicts(answers.verdict, answers.rank_lost)
    _reset_jumps(answers.jump, answers.moment_jump, answers.relative_jump)
    for first in range(0, q.shape[0], LANES):
        count = _place(mechanism, question, q, first, arm)
        _evaluate_healthy(question.rtol, arm.J, lane, svd)
        _write_healthy(m, first, count, arm.tip, lane, answers)
        secular.prepare(arm.J, svd, arm.force, has_force, secular_work)
        secular.prepare_bound(svd.square, lane.largest, question.wary, secular_work)
        if needs_secular:
            for k in range(n):
                secular.find_root(k, svd.square, lane.largest, question.rtol, secular_work)
        if needs_lost:
            lost.prepare(svd.W, svd.sigma, secular_work.V, lost_work)
        if has_direction:
            _joint_intervals(question, arm.J, arm.direction, arm.weight, lane)
        for s in range(faults.locked.shape[0]):
            joints = faults.joints[faults.start[s] : faults.start[s + 1]]
            size = 0  # number of directions lost in every posture
            is_secular = joints.size == 0 or (joints.size == 1 and n > m)
            if faults.has_free[s]:
                is_secular = False
            elif is_secular:
                _evaluate_one_locked(
                    question.wary, joints, has_force, first, count, lane, svd, secular_work,
                    answers.sigma_min[s], answers.margin[s], answers.rho[s], answers.verdict[s],
                )  # fmt: skip
            elif n == m:
                lost.lose_span(joints, lane.smallest, lost_work)
                size = joints.size
            elif n == m + 1 and joints.size == 2:
                lost.lose_pair(joints[0], joints[1], secular_work, lost_work)
                size = 1
            if has_direction and (is_secular or size > 0):
                _reset_interval(lane.s_min, lane.s_max)
                if size > 0:
                    lost.limit_capability(
                        question.direction, question.rtol, size, arm.direction[:m], lost_work,
                        lane.s_min, lane.s_max,
                    )  # fmt: skip
                _write_capability(
                    faults.locked[s], faults.free[s], lane.reach, lane.s_min, lane.s_max, first,
                    count, answers.capability[s],
                )  # fmt: skip
            if size > 0:
                if has_force:
                    lost.project(arm.force[:m], size, lost_work)
                _write_lost(
                    question, s, size, first, count, arm.force, lane.largest, lost_work, answers
                )
            elif not is_secular:
                _leave_undecided(first, count, answers.verdict[s])


@kernel
def _evaluate_free(mechanism, faults, question, q, answers, arm, lane, svd, lost_work):
    """Evaluate sets of one free-swinging joint."""
    m = arm.J.shape[0]
    for first in range(0, q.shape[0], LANES):
        count = _place(mechanism, question, q, first, arm)
        _evaluate_healthy(question.rtol, arm.J, lane, svd)
        if question.direction.size:
            _joint_intervals(question, arm.J, arm.direction, arm.weight, lane)
        for s in range(faults.locked.shape[0]):
            k = _only_index(faults.free[s])
            if k < 0 or faults.start[s + 1] > faults.start[s]:
                continue
            lost.lose_column(k, question, arm.J, arm.weight, lane.smallest, lane.largest, lost_work)
            if question.direction.size:
                lost.limit_by_column(
                    k, question, arm.direction[:m], lane.largest, lost_work, lane.s_min, lane.s_max
                )
                _write_capability(
                    faults.locked[s], faults.free[s], lane.reach, lane.s_min, lane.s_max, first,
                    count, answers.capability[s],
                )  # fmt: skip
            if question.force.size:
                lost.project_on_column(arm.force[:m], k, question, lane.largest, lost_work)
            _write_lost(question, s, 1, first, count, arm.force, lane.largest, lost_work, answers)
            lost.write_zero_columns(question, s, first, count, lane.largest, lost_work, answers)


@inner
def _place(mechanism, question, q, first, arm):
    """Compute the kinematics of the next postures, and return how many lanes they fill."""
    count = min(LANES, q.shape[0] - first)
    for b in range(LANES):
        arm.chosen[b] = first + min(b, count - 1)
    lanes.place(mechanism, question, q, arm)
    return count


@inner
def _needed_parts(start, has_free, m, n):
    """Return whether any fault set needs the secular equation, and any the lost directions."""
    needs_secular, needs_lost = False, False
    for s in range(has_free.size):
        f = start[s + 1] - start[s]
        if not has_free[s]:
            needs_secular |= f == 1 or (f == 2 and n == m + 1)
            needs_lost |= f > n - m
    return needs_secular and n > m, needs_lost and n >= m


@inner
def _reset_verdicts(verdict, rank_lost):
    """Initialize all results as tolerated, with no rank lost."""
    verdict[:] = TOLERATED
    rank_lost[:] = 0


@inner
def _reset_jumps(jump, moment_jump, relative_jump):
    """Initialize the jumps to zero."""
    jump[:] = 0.0
    moment_jump[:] = 0.0
    relative_jump[:] = 0.0


@inner
def _leave_undecided(first, count, verdict):
    """Leave a set undecided."""
    for b in range(count):
        verdict[first + b] = UNDECIDED


@inner
def _write_healthy(m, first, count, tip, lane, answers):
    """Write the results of the healthy arm."""
    for b in range(count):
        for i in range(3):
            answers.tip[first + b, i] = tip[9 + i, b]
        answers.rank[first + b] = m if lane.largest[b] > 0.0 else UNDECIDED
        answers.healthy_margin[first + b] = lane.x[b]


@inner
def _evaluate_healthy(rtol, J, lane, svd):
    """Decompose J, and mark the lanes whose rank is not certain."""
    m = J.shape[0]
    spectrum.decompose(J, svd)
    threshold = max(rtol * GUARD_BAND, secular.MIN_MARGIN) ** 2
    for b in range(LANES):
        lane.smallest[b], lane.largest[b] = svd.square[m - 1, b], svd.square[0, b]
        lane.inverse[0, b] = 1.0 / svd.sigma[0, b]
        lane.x[b] = svd.sigma[m - 1, b] * lane.inverse[0, b]
        is_clear = (lane.smallest[b] > threshold * lane.largest[b]) & (svd.fails[b] == 0.0)
        lane.largest[b] = lane.largest[b] if is_clear else math.nan


@inner
def _reset_interval(s_min, s_max):
    """Initialize the interval of s to s ≥ 0."""
    for b in range(LANES):
        s_min[b], s_max[b] = 0.0, math.inf


@inner
def _write_lost(question, s, size, first, count, force, largest, lost_work, answers):
    """Write the results of a set that loses ``size`` directions."""
    m = lost_work.lost_force.shape[0]
    for b in range(LANES):
        lost_work.relative[b] = math.inf
    if question.force.size:
        lost.write_jump(question.rows, question.weights, force[:m], lost_work)
        jump = lost_work.forces if question.rows[0] < 3 else lost_work.moments
        for b in range(count):
            answers.jump[s, first + b] = jump[b]
            answers.relative_jump[s, first + b] = lost_work.relative[b]
        if answers.moment_jump.size:
            for b in range(count):
                answers.moment_jump[s, first + b] = lost_work.moments[b]
    for b in range(count):
        answers.rank_lost[s, first + b] = size
        answers.sigma_min[s, first + b] = 0.0
        answers.margin[s, first + b] = 0.0
        answers.rho[s, first + b] = 0.0
    lost.judge(question.rtol, question.wary, largest, first, count, lost_work, answers.verdict[s])


@inner
def _only_index(mask):
    """Return the index of the only true element of a mask, -1 unless there is exactly one."""
    found, count = -1, 0
    for k in range(mask.size):
        if mask[k]:
            found, count = k, count + 1
    return found if count == 1 else -1


@inner
def _evaluate_one_locked(
    wary, joints, has_force, first, count, lane, svd, secular_work, sigma_min, margin, rho, verdict
):
    """Evaluate a set that locks at most one joint."""
    x, square, share, below = lane.x, lane.s_min, lane.s_max, lane.a
    m = svd.square.shape[0]
    if joints.size == 0:
        for b in range(LANES):
            x[b], square[b] = lane.smallest[b], 1.0
            below[b] = secular_work.below[b]
            share[b] = secular_work.F[m - 1, b] ** 2 / secular_work.F_squared[b]
    else:
        k = joints[0]
        for b in range(LANES):
            x[b], square[b] = secular_work.x[k, b], secular_work.N_kk[k, b]
        secular.count_below(k, secular_work, below)
        if has_force:
            secular.force_share(k, svd.sigma, svd.square, secular_work, share)
    safe = max(wary * GUARD_BAND, secular.MIN_MARGIN) ** 2
    for b in range(count):
        sigma = math.sqrt(x[b])
        sigma_min[first + b] = sigma
        margin[first + b] = sigma * lane.inverse[0, b]
        rho[first + b] = math.sqrt(square[b])
    for b in range(count):
        if not x[b] > safe * lane.largest[b]:
            code = UNDECIDED
            if x[b] > 0.0 and below[b] == 1.0:
                code = three.judge(wary, x[b] / lane.largest[b], has_force, share[b])
            verdict[first + b] = code


@inner
def _write_capability(locked, free, reach, s_min, s_max, first, count, capability):
    """Write the capability: the interval of s intersected with those of all limits."""
    for k in range(locked.size):
        if free[k]:
            continue
        side = 2 if locked[k] else 0
        for b in range(LANES):
            s_min[b] = max(s_min[b], reach[k, side, b])
            s_max[b] = min(s_max[b], reach[k, side + 1, b])
    for b in range(count):
        capability[first + b] = s_max[b] if s_max[b] >= s_min[b] else math.nan


@inner
def _joint_intervals(question, J, d, weight, lane):
    """Compute the interval of s in s·d that each joint's motor, and brake, allows."""
    m, n = J.shape[0], J.shape[1]
    lever = lane.a
    size = 0.0
    for i in range(m):
        size += question.direction[i] ** 2
    min_lever = question.rtol * math.sqrt(size)
    for k in range(n):
        for b in range(LANES):
            lever[b] = 0.0
        for i in range(m):
            for b in range(LANES):
                lever[b] += J[i, k, b] * d[i, b]
        motor, brake = lane.reach[k, :2], lane.reach[k, 2:]
        own, middle = question.effort[k], question.middle[k]
        _joint_interval(own, middle, min_lever, lever, weight[k], lane.largest, motor)
        _joint_interval(question.brake[k], 0.0, min_lever, lever, weight[k], lane.largest, brake)


@inner
def _joint_interval(limit, middle, min_lever, lever, weight, largest, ends):
    """Compute the interval of s in which the torque is within ``middle ± limit``.

    Without a lever arm only gravity matters.
    """
    if not limit > 0.0:  # unknown
        for b in range(LANES):
            ends[0, b] = -math.inf
            ends[1, b] = math.inf
        return
    for b in range(LANES):
        rest = weight[b] - middle
        lower, upper = -limit - rest, limit - rest
        first, second = lower / lever[b], upper / lever[b]
        has_no_lever = abs(lever[b]) <= min_lever * math.sqrt(largest[b])
        beyond = (lower > 0.0) | (upper < 0.0)
        ends[0, b] = (math.inf if beyond else -math.inf) if has_no_lever else min(first, second)
        ends[1, b] = (-math.inf if beyond else math.inf) if has_no_lever else max(first, second)
