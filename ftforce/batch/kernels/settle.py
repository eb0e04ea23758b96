"""Decide by singular values, as `ftforce.analyze` does, what the fast part left undecided.

Pairs of a posture and a set of locked joints are collected until K can be decomposed for LANES of
them side by side. Sets with free-swinging joints are evaluated one by one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.batch.kernels import exact, lanes, spectrum
from ftforce.batch.kernels.jit import inner, kernel
from ftforce.batch.kernels.layout import LANES, UNDECIDED, aligned_zeros

if TYPE_CHECKING:
    from ftforce.batch.kernels.exact import Scratch
    from ftforce.batch.kernels.spectrum import Spectrum


class Pairs(NamedTuple):
    """Pairs of posture and fault set that are decided together."""

    K: np.ndarray  # (m, n, LANES): eq. (25), (26)
    spectrum: Spectrum  # of K
    lane: np.ndarray  # (LANES,): lane of the posture in the workspace
    set: np.ndarray  # (LANES,): index of the fault set
    one: Scratch  # the pair being decided


def pairs(m, n):
    """Return a workspace."""
    pair = (aligned_zeros(LANES, np.int64), aligned_zeros(LANES, np.int64))
    return Pairs(aligned_zeros((m, n, LANES)), spectrum.spectrum(m, n), *pair, exact.scratch(m, n))


def settle(mechanism, faults, question, q, answers, work, group):
    """Evaluate the cases that `fast.evaluate` left undecided, with the same arguments.

    Only the kernels that are needed are called, and hence compiled.
    """
    given = (mechanism, faults, question, q, answers, work.arm, work.spectrum)
    has_free = faults.has_free
    if has_free.any() and (answers.verdict[has_free] == UNDECIDED).any():
        settle_free(*given, group.one)
    if (answers.rank == UNDECIDED).any() or (answers.verdict[~has_free] == UNDECIDED).any():
        settle_locked(*given, group)


@kernel
def settle_free(mechanism, faults, question, q, answers, arm, spec, one):
    """Evaluate the undecided sets with free-swinging joints."""
    start, count = 0, 1
    while count > 0:
        start, count = collect(start, faults.has_free, True, answers, arm.chosen)
        if count > 0:
            decompose_healthy(mechanism, question, q, count, answers, arm, spec, one)
        for s in range(faults.locked.shape[0]):
            if not faults.has_free[s]:
                continue
            for b in range(count):
                at = arm.chosen[b]
                if answers.verdict[s, at] == UNDECIDED:
                    take(question, b, arm, spec.sigma, one)
                    evaluate_free(faults.locked[s], faults.free[s], question, s, at, one, answers)


@kernel
def settle_locked(mechanism, faults, question, q, answers, arm, spec, group):
    """Evaluate the undecided sets of locked joints, and undecided ranks of the healthy arm."""
    start, count = 0, 1
    while count > 0:
        start, count = collect(start, faults.has_free, False, answers, arm.chosen)
        if count > 0:
            decompose_healthy(mechanism, question, q, count, answers, arm, spec, group.one)
        s, b, waiting = 0, 0, 0
        while s < faults.locked.shape[0] and count > 0:
            if answers.verdict[s, arm.chosen[b]] == UNDECIDED:
                wait(faults.locked[s], s, b, waiting, arm.J, group.K, group.lane, group.set)
                waiting += 1
            b += 1
            if b == count:
                s, b = s + 1, 0
            if waiting == LANES or (waiting > 0 and s == faults.locked.shape[0]):
                spectrum.decompose(group.K, group.spectrum)
                for slot in range(waiting):
                    at, which = group.lane[slot], group.set[slot]
                    take(question, at, arm, spec.sigma, group.one)
                    lock(
                        faults.locked[which], faults.free[which], question, which, arm.chosen[at],
                        slot, group.spectrum.sigma, group.spectrum.W, group.one, answers,
                    )  # fmt: skip
                waiting = 0


@inner
def collect(start, has_free, is_free, answers, chosen):
    """Choose up to LANES undecided postures; return where to continue, and their number."""
    at, count = start, 0
    while at < answers.rank.size and count < LANES:
        left = answers.rank[at] == UNDECIDED and not is_free
        for s in range(has_free.size):
            left |= has_free[s] == is_free and answers.verdict[s, at] == UNDECIDED
        if left:
            chosen[count] = at
            count += 1
        at += 1
    for b in range(count, LANES):
        chosen[b] = chosen[0]
    return at, count


@inner
def decompose_healthy(mechanism, question, q, count, answers, arm, spec, one):
    """Decompose J of the chosen postures, and compute the forces the healthy arm exerts."""
    m = arm.J.shape[0]
    lanes.place(mechanism, question, q, arm)
    spectrum.decompose(arm.J, spec)
    for b in range(count):
        at, rank = arm.chosen[b], rank_of(spec.sigma, b, question.rtol)
        if answers.rank[at] == UNDECIDED:
            answers.rank[at] = rank
            answers.healthy_margin[at] = ratio(spec.sigma[m - 1, b], spec.sigma[0, b])
        if rank < m and question.force.size:
            keep_exerted(spec.W, b, rank, arm.force, one)


@inner
def keep_exerted(W, b, rank, force, one):
    """Replace F by the force that the healthy arm exerts, F̂ = J J† F."""
    m = W.shape[0]
    for i in range(m):
        one.F[i] = force[i, b]
    take_left_vectors(W, b, rank, one.V)
    exact.project(one.V, 0, rank, one.F, one.kept)
    # A force that is only rounding error counts as zero, or its direction would affect the verdict.
    is_real = exact.norm(one.kept) > 1e-12 * exact.norm(one.F)
    for i in range(m):
        force[i, b] = one.kept[i] if is_real else 0.0


@inner
def rank_of(sigma, b, rtol):
    """Return the rank of J in a lane."""
    rank = sigma.shape[0]
    while rank > 0 and sigma[rank - 1, b] <= rtol * sigma[0, b]:
        rank -= 1
    return rank


@inner
def ratio(x, scale):
    """Return x / scale, 0 if the scale is 0."""
    return x / scale if scale > 0.0 else 0.0


@inner
def take_left_vectors(W, b, rank, U):
    """Copy the left singular vectors of a lane into columns, and complete them to a basis.

    Each added column starts from the unit vector farthest from the span of the previous ones.
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
        for j in range(2 * i):  # orthogonalize twice, for accuracy
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
def take(question, b, arm, sigma, one):
    """Copy the posture of a lane into the workspace of `exact`."""
    m, n = one.J.shape
    for i in range(m):
        for k in range(n):
            one.J[i, k] = arm.J[i, k, b]
        one.s[i] = sigma[i, b]
    one.rank[0] = rank_of(sigma, b, question.rtol)
    for k in range(n):
        one.rnea[k] = arm.weight[k, b]
    for i in range(question.direction.size):
        one.d[i] = arm.direction[i, b]
    for i in range(question.force.size):
        one.F[i] = arm.force[i, b]


@inner
def wait(locked, s, b, slot, J, K, lane, which):
    """Queue a pair, with its K, in a slot."""
    lane[slot], which[slot] = b, s
    for i in range(J.shape[0]):
        for k in range(J.shape[1]):
            K[i, k, slot] = 0.0 if locked[k] else J[i, k, b]


@inner
def lock(locked, free, question, s, at, slot, sigma, W, one, answers):
    """Evaluate a set of locked joints, whose K is decomposed in a slot."""
    for i in range(one.t.size):
        one.t[i] = sigma[i, slot]
        one.F0[i] = 0.0
    after, asks = exact.rank_of(one.t, question.rtol * one.s[0]), question.force.size > 0
    take_left_vectors(W, slot, after, one.V)
    answers.verdict[s, at] = exact.judge_locked(one, asks, question.rtol, question.wary)
    write(locked, free, question, s, at, after, 0.0, one, answers)


@inner
def evaluate_free(locked, free, question, s, at, one, answers):
    """Evaluate a set with free-swinging joints."""
    asks, lost = question.force.size > 0, question.rtol * one.s[0]
    answers.verdict[s, at] = exact.judge_free(one, locked, free, question.rtol, question.wary, asks)
    exact.reduce_columns(one.J, locked, one.K)
    unbalanced, _ = exact.project_out_free(one, free, lost)
    exact.decompose(one.K, one.V, one.t)
    write(locked, free, question, s, at, exact.rank_of(one.t, lost), unbalanced, one, answers)


@inner
def write(locked, free, question, s, at, after, unbalanced, one, answers):
    """Write all results except the verdict."""
    m, scale, rank = one.s.size, one.s[0], one.rank[0]
    answers.rank_lost[s, at] = rank - after
    answers.sigma_min[s, at] = one.t[m - 1]
    answers.margin[s, at] = ratio(one.t[m - 1], scale)
    answers.rho[s, at] = relative_manipulability(one, rank)
    if question.force.size:
        write_jump(question, s, at, after, unbalanced, one, answers)
    if question.direction.size:
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
    """Write the norms of the jump ΔF = F̂ - F', separately for forces and moments."""
    m = one.F.size
    if unbalanced > question.rtol:  # the arm cannot stand still
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
