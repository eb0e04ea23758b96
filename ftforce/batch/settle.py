"""What the fast part left undecided: the accurate analysis of single postures and fault sets."""

from __future__ import annotations

import math

from ftforce.batch import exact, lanes
from ftforce.batch.fast import UNDECIDED
from ftforce.batch.jit import inner, kernel
from ftforce.batch.lanes import LANES


@kernel
def settle(mechanism, faults, question, q, answers, work, one):
    """Answer what `ftforce.batch.fast.evaluate` left undecided, with its arguments.

    The postures concerned are collected until there are enough of them for the lanes.
    """
    k, count = q.shape[0], 0
    for at in range(k):
        if is_undecided(answers, at):
            work.chosen[count] = at
            count += 1
        if count == LANES or (count > 0 and at == k - 1):
            for b in range(count, LANES):
                work.chosen[b] = work.chosen[0]
            lanes.place_frames(mechanism, q, work.chosen, work)
            lanes.task_jacobian(mechanism, question, work)
            if question.weighs:
                lanes.weight_torque(mechanism, work)
            for b in range(count):
                settle_posture(faults, question, work.chosen[b], b, work, one, answers)
            count = 0


@inner
def is_undecided(answers, at):
    """Return whether something about a posture was left undecided."""
    if answers.rank[at] == UNDECIDED:
        return True
    for s in range(answers.verdict.shape[0]):  # noqa: SIM110 - numba knows no generators here
        if answers.verdict[s, at] == UNDECIDED:
            return True
    return False


@inner
def settle_posture(faults, question, at, b, work, one, answers):
    """Answer what was left undecided about one posture."""
    m = one.s.size
    learn(question, work, b, one)
    if answers.rank[at] == UNDECIDED:
        answers.rank[at] = one.rank[0]
        answers.healthy_margin[at] = ratio(one.s[m - 1], one.s[0])
    for s in range(answers.verdict.shape[0]):
        if answers.verdict[s, at] == UNDECIDED:
            settle_set(faults, question, s, at, one, answers)


@inner
def ratio(x, scale):
    """Return x / scale, 0 without a scale."""
    return x / scale if scale > 0.0 else 0.0


@inner
def learn(question, work, b, one):
    """Decompose J of a lane, and find the force that the healthy arm exerts, F̂ = J J† F."""
    m, n = one.J.shape
    for i in range(m):
        for k in range(n):
            one.J[i, k] = work.J[i, k, b]
    exact.copy_matrix(one.J, one.W)
    exact.decompose(one.W, one.U, one.s)
    one.rank[0] = exact.rank_of(one.s, question.rtol * one.s[0])
    for k in range(n):
        one.rnea[k] = work.weight[k, b]
    lanes.turn_vector(question, question.direction, work.tip, work.vector)
    for i in range(question.direction.size):
        one.d[i] = work.vector[i, b]
    lanes.turn_vector(question, question.force, work.tip, work.vector)
    for i in range(question.force.size):
        one.F[i] = work.vector[i, b]
    if one.rank[0] < m:
        exact.project(one.U, 0, one.rank[0], one.F, one.kept)
        # What only rounding left is no force: its direction would be judged.
        is_real = exact.norm(one.kept) > 1e-12 * exact.norm(one.F)
        for i in range(m):
            one.F[i] = one.kept[i] if is_real else 0.0


@inner
def settle_set(faults, question, s, at, one, answers):
    """Answer for one posture and one fault set by singular values, as `ftforce.analyze` does."""
    m, scale, rank = question.rows.size, one.s[0], one.rank[0]
    locked, free = faults.locked[s], faults.free[s]
    asks, swings = question.force.size > 0, faults.swings[s]
    if swings:
        answers.verdict[s, at] = exact.judge_free(
            one, locked, free, question.rtol, question.wary, asks
        )
    unbalanced = reduce(one, locked, free, swings, question.rtol * scale)
    after = exact.rank_of(one.t, question.rtol * scale)
    answers.rank_lost[s, at] = rank - after
    answers.sigma_min[s, at] = one.t[m - 1]
    answers.margin[s, at] = ratio(one.t[m - 1], scale)
    answers.rho[s, at] = relative_manipulability(one, rank)
    if not swings:
        answers.verdict[s, at] = exact.judge_locked(one, asks, question.rtol, question.wary)
    if asks:
        write_jump(question, s, at, after, unbalanced, one, answers)
    if question.direction.size:
        for k in range(free.size):
            motor = 0.0 if free[k] else question.effort[k]
            one.limit[k] = question.brake[k] if locked[k] else motor
        answers.capability[s, at] = exact.reach(one, after, unbalanced, question.rtol)


@inner
def reduce(one, locked, free, swings, lost):
    """Decompose K; leave F0, and return the torque that nothing balances."""
    exact.reduce_columns(one.J, locked, one.K)
    unbalanced = 0.0
    if swings:
        unbalanced, _ = exact.swing_out(one, free, lost)
    else:
        for i in range(one.F0.size):
            one.F0[i] = 0.0
    exact.decompose(one.K, one.V, one.t)
    return unbalanced


@inner
def relative_manipulability(one, rank):
    """Return ρ = w(K)/w(J), NaN where w(J) = 0."""
    if rank < one.s.size:
        return math.nan
    product = 1.0
    for i in range(one.s.size):
        product *= one.t[i] / one.s[i]
    return product


@inner
def write_jump(question, s, at, after, unbalanced, one, answers):
    """Write the jump ΔF = F̂ - F', its forces and its moments apart."""
    m = one.F.size
    if unbalanced > question.rtol:  # nothing holds the arm
        answers.jump[s, at] = math.nan
        answers.relative_jump[s, at] = 1.0
        if answers.moment_jump.size:
            answers.moment_jump[s, at] = math.nan
        return
    exact.project(one.V, after, m, one.F, one.kept)
    forces, moments, jump = 0.0, 0.0, 0.0
    for i in range(m):
        lost = one.kept[i] - one.F0[i] if after < m else 0.0
        jump += lost * lost
        if question.rows[i] < 3:
            forces += lost * lost
        else:
            moments += (lost * question.weights[i]) ** 2
    size = exact.norm(one.F)
    answers.relative_jump[s, at] = math.sqrt(jump) / size if size > 0.0 else 0.0
    answers.jump[s, at] = math.sqrt(forces)
    if answers.moment_jump.size:
        answers.moment_jump[s, at] = math.sqrt(moments)
    elif question.rows[0] >= 3:
        answers.jump[s, at] = math.sqrt(moments)
