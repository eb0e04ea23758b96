"""What the fast part left undecided, answered by singular values, as `ftforce.analyze` does it.

Pairs of a posture and a fault set of locked joints are collected until there are enough of them to
decompose K for LANES of them side by side. Joints without torque are taken one by one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.batch import exact, lanes, spectrum
from ftforce.batch.jit import inner, kernel
from ftforce.batch.layout import LANES, UNDECIDED
from ftforce.batch.parts import part

if TYPE_CHECKING:
    from ftforce.batch.exact import Scratch
    from ftforce.batch.spectrum import Spectrum


class Pairs(NamedTuple):
    """Postures and fault sets that are settled together."""

    K: np.ndarray  # (m, n, LANES): eq. (25), (26)
    spectrum: Spectrum  # of K
    lane: np.ndarray  # (LANES,): where in the workspace the posture is
    set: np.ndarray  # (LANES,): which fault set
    one: Scratch  # the one that is being judged


@kernel
def pairs(m, n):
    """Return a workspace."""
    return Pairs(
        np.zeros((m, n, LANES)), spectrum.spectrum(m, n), np.zeros(LANES, dtype=np.int64),
        np.zeros(LANES, dtype=np.int64), exact.scratch(m, n),
    )  # fmt: skip


@kernel
def settle(mechanism, faults, question, q, answers, work, group):
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
            settle_postures(mechanism, faults, question, q, count, answers, work, group)
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


@part
def settle_postures(mechanism, faults, question, q, count, answers, work, group):
    """Answer what was left undecided about the postures in the lanes."""
    lanes.place(mechanism, question, q, work)
    spectrum.decompose(work.J, work.spectrum)
    for b in range(count):
        settle_healthy(question, b, answers, work, group.one)
    waiting = 0
    for s in range(faults.locked.shape[0]):
        for b in range(count):
            if answers.verdict[s, work.chosen[b]] != UNDECIDED:
                continue
            if faults.swings[s]:
                take(question, b, work, group.one)
                swing(faults, question, s, work.chosen[b], group.one, answers)
                continue
            wait(faults.locked[s], s, b, waiting, work.J, group)
            waiting += 1
            if waiting == LANES:
                settle_pairs(faults, question, waiting, answers, work, group)
                waiting = 0
        # the last ones do not wait for more
        if waiting > 0 and s == faults.locked.shape[0] - 1:
            settle_pairs(faults, question, waiting, answers, work, group)


@inner
def settle_healthy(question, b, answers, work, one):
    """Take the rank of J, and the force that the healthy arm exerts, F̂ = J J† F."""
    m, at, spec = work.J.shape[0], work.chosen[b], work.spectrum
    rank = rank_of(spec.sigma, b, question.rtol)
    if answers.rank[at] == UNDECIDED:
        answers.rank[at] = rank
        answers.healthy_margin[at] = ratio(spec.sigma[m - 1, b], spec.sigma[0, b])
    if rank == m or question.force.size == 0:
        return
    for i in range(m):
        one.F[i] = work.force[i, b]
    take_left_vectors(spec.W, b, rank, one.V)
    exact.project(one.V, 0, rank, one.F, one.kept)
    # What only rounding left is no force: its direction would be judged.
    is_real = exact.norm(one.kept) > 1e-12 * exact.norm(one.F)
    for i in range(m):
        work.force[i, b] = one.kept[i] if is_real else 0.0


@inner
def rank_of(sigma, b, rtol):
    """Return the rank of J in a lane."""
    rank = sigma.shape[0]
    while rank > 0 and sigma[rank - 1, b] <= rtol * sigma[0, b]:
        rank -= 1
    return rank


@inner
def ratio(x, scale):
    """Return x / scale, 0 without a scale."""
    return x / scale if scale > 0.0 else 0.0


@inner
def take_left_vectors(W, b, rank, U):
    """Copy the left vectors of a lane into columns, and complete them to a basis.

    Of the unit vectors the one that is farthest from those found yet comes next.
    """
    m = W.shape[0]
    for i in range(rank):
        for r in range(m):
            U[r, i] = W[i, r, b]
    for i in range(rank, m):
        farthest, least = 0, math.inf
        for r in range(m):
            along = 0.0
            for j in range(i):
                along += U[r, j] * U[r, j]
            if along < least:
                farthest, least = r, along
        for r in range(m):
            U[r, i] = 1.0 if r == farthest else 0.0
        for j in range(2 * i):  # twice
            along = 0.0
            for r in range(m):
                along += U[r, j % i] * U[r, i]
            for r in range(m):
                U[r, i] -= along * U[r, j % i]
        length = 0.0
        for r in range(m):
            length += U[r, i] * U[r, i]
        for r in range(m):
            U[r, i] /= math.sqrt(length)


@inner
def take(question, b, work, one):
    """Copy what is known of a lane's posture."""
    m, n = one.J.shape
    for i in range(m):
        for k in range(n):
            one.J[i, k] = work.J[i, k, b]
        one.s[i] = work.spectrum.sigma[i, b]
    one.rank[0] = rank_of(work.spectrum.sigma, b, question.rtol)
    for k in range(n):
        one.rnea[k] = work.weight[k, b]
    for i in range(question.direction.size):
        one.d[i] = work.direction[i, b]
    for i in range(question.force.size):
        one.F[i] = work.force[i, b]


@inner
def wait(locked, s, b, slot, J, group):
    """Let a pair wait for others."""
    group.lane[slot], group.set[slot] = b, s
    for i in range(J.shape[0]):
        for k in range(J.shape[1]):
            group.K[i, k, slot] = 0.0 if locked[k] else J[i, k, b]


@part
def settle_pairs(faults, question, waiting, answers, work, group):
    """Decompose K for the pairs that wait, and answer."""
    if waiting == 0:
        return
    spectrum.decompose(group.K, group.spectrum)
    one, spec = group.one, group.spectrum
    m = one.s.size
    for slot in range(waiting):
        s, b = group.set[slot], group.lane[slot]
        take(question, b, work, one)
        for i in range(m):
            one.t[i] = spec.sigma[i, slot]
            one.F0[i] = 0.0
        after = exact.rank_of(one.t, question.rtol * one.s[0])
        take_left_vectors(spec.W, slot, after, one.V)
        at = work.chosen[b]
        asks = question.force.size > 0
        answers.verdict[s, at] = exact.judge_locked(one, asks, question.rtol, question.wary)
        write(faults, question, s, at, after, 0.0, one, answers)


@inner
def swing(faults, question, s, at, one, answers):
    """Answer for a set with joints without torque."""
    locked, free, asks = faults.locked[s], faults.free[s], question.force.size > 0
    answers.verdict[s, at] = exact.judge_free(one, locked, free, question.rtol, question.wary, asks)
    lost = question.rtol * one.s[0]
    exact.reduce_columns(one.J, locked, one.K)
    unbalanced, _ = exact.swing_out(one, free, lost)
    exact.decompose(one.K, one.V, one.t)
    write(faults, question, s, at, exact.rank_of(one.t, lost), unbalanced, one, answers)


@inner
def write(faults, question, s, at, after, unbalanced, one, answers):
    """Write all but the verdict."""
    m, scale, rank = one.s.size, one.s[0], one.rank[0]
    answers.rank_lost[s, at] = rank - after
    answers.sigma_min[s, at] = one.t[m - 1]
    answers.margin[s, at] = ratio(one.t[m - 1], scale)
    answers.rho[s, at] = relative_manipulability(one, rank)
    if question.force.size:
        write_jump(question, s, at, after, unbalanced, one, answers)
    if question.direction.size:
        locked, free = faults.locked[s], faults.free[s]
        for k in range(free.size):
            motor = 0.0 if free[k] else question.effort[k]
            one.limit[k] = question.brake[k] if locked[k] else motor
        answers.capability[s, at] = exact.reach(one, after, unbalanced, question.rtol)


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
