"""The fast part of the fault analysis: σ_min and ρ of every fault set, LANES postures at a time.

J is never kept: it lives in the workspace of LANES postures, which fits into the processor's
caches. Three rows have closed forms (`ftforce.batch.three`), others one decomposition of J for all
sets that lock one joint (`ftforce.batch.secular`); some sets lose directions wherever the arm
stands (`ftforce.batch.lost`). Where a tolerance is near nothing is decided, and what none of these
answers is left to `ftforce.batch.settle`.
"""

from __future__ import annotations

import math

from ftforce.batch import lanes, lost, secular, spectrum, three
from ftforce.batch.jit import inner, kernel
from ftforce.batch.layout import CLEAR, LANES, UNDECIDED
from ftforce.batch.parts import part
from ftforce.batch.results import TOLERATED


@kernel
def evaluate(mechanism, faults, question, q, answers, work):
    """Fill the answers for the postures q, shape (k, n), where no bound is near."""
    k, m, n = q.shape[0], work.J.shape[0], work.J.shape[1]
    shares, loses = common_work(faults, m, n)
    forget(answers)
    for first in range(0, k, LANES):
        count = min(LANES, k - first)
        for b in range(LANES):
            work.chosen[b] = min(first + b, k - 1)
        lanes.place(mechanism, question, q, work)
        for i in range(3):
            for b in range(count):
                answers.tip[first + b, i] = work.tip[9 + i, b]
        if m == 3:
            three.evaluate_healthy(question, first, count, work, answers)
        else:
            evaluate_healthy(question, first, count, shares, loses, work, answers)
        if question.direction.size:
            reaches(question, work)
        for s in range(faults.locked.shape[0]):
            answer(faults, question, s, first, count, work, answers)


@inner
def common_work(faults, m, n):
    """Return whether roots, and whether lost directions, serve some of the fault sets."""
    shares, loses = False, False
    for s in range(faults.locked.shape[0]):
        f = faults.start[s + 1] - faults.start[s]
        if not faults.swings[s]:
            shares |= f == 1 or (f == 2 and n == m + 1)
            loses |= f > n - m
    return shares and n > m, loses and n >= m


@inner
def forget(answers):
    """Write what holds where nothing is lost: zeros."""
    answers.verdict[:] = TOLERATED
    answers.rank_lost[:] = 0
    for jump in (answers.jump, answers.moment_jump, answers.relative_jump):
        jump[:] = 0.0


@part
def evaluate_healthy(question, first, count, shares, loses, work, answers):
    """Decompose J, and do what many fault sets share."""
    spec, one = work.spectrum, work.secular
    m, n = work.J.shape[0], work.J.shape[1]
    smallest, largest, over = work.smallest, work.largest, work.over
    spectrum.decompose(work.J, spec)
    least = max(question.rtol * CLEAR, secular.LEAST) ** 2
    for b in range(LANES):
        smallest[b], largest[b] = spec.square[m - 1, b], spec.square[0, b]
        over[0, b] = 1.0 / spec.sigma[0, b]
        work.x[b] = spec.sigma[m - 1, b] * over[0, b]
        is_clear = (smallest[b] > least * largest[b]) & (spec.fails[b] == 0.0)
        largest[b] = largest[b] if is_clear else math.nan
    for b in range(count):
        answers.rank[first + b] = m if largest[b] > 0.0 else UNDECIDED
        answers.healthy_margin[first + b] = work.x[b]
    secular.prepare(work.J, spec, work.force, question.force.size > 0, one)
    secular.prepare_bound(spec, largest, question.wary, one)
    if shares:
        for k in range(n):
            secular.find_root(k, spec, largest, least, one)
    if loses:
        lost.prepare(spec, one.V, work.lost)


@part
def answer(faults, question, s, first, count, work, answers):
    """Answer for one fault set."""
    m, n = work.J.shape[0], work.J.shape[1]
    joints = faults.joints[faults.start[s] : faults.start[s + 1]]
    size = 0  # of what is lost wherever the arm stands
    if faults.swings[s]:
        k = only_one(faults.free[s])
        if k >= 0 and joints.size == 0:
            lost.lose_column(k, question.wary, work, work.lost)
            size = 1
    elif m == 3 and n - joints.size >= 3:
        three.answer(question, joints, s, first, count, work, answers)
        limit(faults, question, s, first, count, work, answers, False)
        return
    elif m != 3 and (joints.size == 0 or (joints.size == 1 and n > m)):
        answer_single(question, joints, s, first, count, work, answers)
        limit(faults, question, s, first, count, work, answers, False)
        return
    elif m != 3 and n == m:
        lost.lose_span(joints, work.smallest, work.lost)
        size = joints.size
    elif m != 3 and n == m + 1 and joints.size == 2:
        lost.lose_pair(joints[0], joints[1], work.secular, work.lost)
        size = 1
    if size == 0:
        for b in range(count):
            answers.verdict[s, first + b] = UNDECIDED
        return
    swings = faults.swings[s]
    if question.direction.size:
        lost.limit_capability(question, size, swings, work, work.lost)
        limit(faults, question, s, first, count, work, answers, True)
    lost.write(question, s, size, swings, first, count, work, work.lost, answers)
    if swings:
        lost.keep_idle(question, s, first, count, work, work.lost, answers)


@inner
def only_one(mask):
    """Return the index where a mask is true, -1 if it is not true just once."""
    found, count = -1, 0
    for k in range(mask.size):
        if mask[k]:
            found, count = k, count + 1
    return found if count == 1 else -1


@inner
def answer_single(question, joints, s, first, count, work, answers):
    """Answer for a set that locks no joint, or one."""
    one, spec, x, share, below = work.secular, work.spectrum, work.x, work.share, work.below
    m, asks = work.J.shape[0], question.force.size > 0
    if joints.size == 0:
        for b in range(LANES):
            x[b], work.determinant[b] = work.smallest[b], 1.0
            below[b] = one.below[b]
            share[b] = one.F[m - 1, b] ** 2 / one.size[b] if asks else 0.0
    else:
        k = joints[0]
        for b in range(LANES):
            x[b], work.determinant[b] = one.x[k, b], one.rest[k, b]
        secular.count_below(k, one, below)
        if asks:
            secular.share_along(k, spec, one, share)
    write(work, answers.sigma_min[s], answers.margin[s], answers.rho[s], first, count)
    safe = max(question.wary * CLEAR, secular.LEAST) ** 2
    for b in range(count):
        if not x[b] > safe * work.largest[b]:
            code = UNDECIDED
            if x[b] > 0.0 and below[b] == 1.0:
                code = three.judge(question, x[b] / work.largest[b], share[b])
            answers.verdict[s, first + b] = code


@inner
def write(work, sigma_min, margin, rho, first, count):
    """Write the measures; where they are not good enough they will be written over."""
    for b in range(count):
        sigma = math.sqrt(work.x[b])
        sigma_min[first + b] = sigma
        margin[first + b] = sigma * work.over[0, b]
        rho[first + b] = math.sqrt(work.determinant[b])


@inner
def limit(faults, question, s, first, count, work, answers, is_lost):
    """Write how far s·d goes: what is left of it is what the narrowest limit leaves."""
    if not question.direction.size:
        return
    least, most, reach = work.line[0], work.line[1], work.reach
    locked, free = faults.locked[s], faults.free[s]
    for b in range(LANES):
        least[b] = work.lost.least[b] if is_lost else 0.0
        most[b] = work.lost.most[b] if is_lost else math.inf
    for k in range(locked.size):
        if free[k]:
            continue
        side = 2 if locked[k] else 0
        for b in range(LANES):
            least[b] = max(least[b], reach[k, side, b])
        for b in range(LANES):
            most[b] = min(most[b], reach[k, side + 1, b])
    for b in range(count):
        answers.capability[s, first + b] = most[b] if most[b] >= least[b] else math.nan


@inner
def reaches(question, work):
    """Interval of s·d that each joint's motor, and brake, allows (`ftforce.feasible.reach`)."""
    m, n = work.J.shape[0], work.J.shape[1]
    lever, d = work.line[0], work.direction
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
