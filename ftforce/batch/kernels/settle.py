"""Decide by singular values, as `ftforce.analyze` does, the cases left by the fast part.

Pairs of a posture and a set of locked joints are collected until K can be decomposed for LANES of
them side by side. Sets with free-swinging joints are evaluated one by one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.batch.kernels import exact, lanes, spectrum
from ftforce.batch.kernels.jit import inner, kernel
from ftforce.batch.kernels.layout import LANES, NOT_TOLERATED, UNDECIDED, aligned_zeros

if TYPE_CHECKING:
    from ftforce.batch.kernels.exact import Scratch
    from ftforce.batch.kernels.spectrum import SVD


class Pairs(NamedTuple):
    """Pairs of posture and fault set that are decided together."""

    K: np.ndarray  # (m, n, LANES): eq. (25), (26)
    svd: SVD  # of K
    lane: np.ndarray  # (LANES,): lane of the posture in the workspace
    set: np.ndarray  # (LANES,): index of the fault set
    scratch: Scratch  # the pair being decided


def workspace(m, n):
    """Return a workspace.

    Parameters
    ----------
    m, n :
        Numbers of task rows and of joints.
    """
    pair = (aligned_zeros(LANES, np.int64), aligned_zeros(LANES, np.int64))
    return Pairs(
        aligned_zeros((m, n, LANES)), spectrum.workspace(m, n), *pair, exact.workspace(m, n)
    )


def settle(mechanism, faults, question, q, answers, work, pairs):
    """Evaluate the cases that `fast.evaluate` left undecided, with the same arguments.

    Only the kernels that are needed are called, and hence compiled.

    Parameters
    ----------
    mechanism, faults, question, q, answers, work :
        As in `fast.evaluate`.
    pairs :
        Workspace.
    """
    common = (mechanism, faults, question, q, answers, work.arm, work.svd)
    has_free = faults.has_free
    if has_free.any() and (answers.verdict[has_free] == UNDECIDED).any():
        _settle_free(*common, pairs.scratch)
    if (answers.rank == UNDECIDED).any() or (answers.verdict[~has_free] == UNDECIDED).any():
        _settle_locked(*common, pairs)


@kernel
def _settle_free(mechanism, faults, question, q, answers, arm, svd, scratch):
    """Evaluate the undecided sets with free-swinging joints."""
    start, count = 0, 1
    while count > 0:
        start, count = _collect(start, faults.has_free, True, answers, arm.chosen)
        if count > 0:
            _decompose_healthy(mechanism, question, q, count, answers, arm, svd, scratch)
        for s in range(faults.locked.shape[0]):
            if not faults.has_free[s]:
                continue
            for b in range(count):
                at = arm.chosen[b]
                if answers.verdict[s, at] == UNDECIDED:
                    _load(question, b, arm, svd.sigma, scratch)
                    _evaluate_free(
                        faults.locked[s], faults.free[s], question, s, at, scratch, answers
                    )


@kernel
def _settle_locked(mechanism, faults, question, q, answers, arm, svd, pairs):
    """Evaluate the undecided sets of locked joints, and undecided ranks of the healthy arm."""
    start, count = 0, 1
    while count > 0:
        start, count = _collect(start, faults.has_free, False, answers, arm.chosen)
        if count > 0:
            _decompose_healthy(mechanism, question, q, count, answers, arm, svd, pairs.scratch)
        s, b, queued = 0, 0, 0
        while s < faults.locked.shape[0] and count > 0:
            if answers.verdict[s, arm.chosen[b]] == UNDECIDED:
                _queue(faults.locked[s], s, b, queued, arm.J, pairs.K, pairs.lane, pairs.set)
                queued += 1
            b += 1
            if b == count:
                s, b = s + 1, 0
            if queued == LANES or (queued > 0 and s == faults.locked.shape[0]):
                spectrum.decompose(pairs.K, pairs.svd)
                for slot in range(queued):
                    at, which = pairs.lane[slot], pairs.set[slot]
                    _load(question, at, arm, svd.sigma, pairs.scratch)
                    _decide_locked(
                        faults.locked[which], faults.free[which], question, which, arm.chosen[at],
                        slot, pairs.svd.sigma, pairs.svd.W, pairs.scratch, answers,
                    )  # fmt: skip
                queued = 0


@inner
def _collect(start, has_free, is_free, answers, chosen):
    """Choose up to LANES undecided postures; return where to continue, and their number."""
    at, count = start, 0
    while at < answers.rank.size and count < LANES:
        is_undecided = answers.rank[at] == UNDECIDED and not is_free
        for s in range(has_free.size):
            is_undecided |= has_free[s] == is_free and answers.verdict[s, at] == UNDECIDED
        if is_undecided:
            chosen[count] = at
            count += 1
        at += 1
    for b in range(count, LANES):
        chosen[b] = chosen[0]
    return at, count


@inner
def _decompose_healthy(mechanism, question, q, count, answers, arm, svd, scratch):
    """Decompose J of the chosen postures, and compute the forces the healthy arm exerts."""
    m = arm.J.shape[0]
    lanes.place(mechanism, question, q, arm)
    spectrum.decompose(arm.J, svd)
    for b in range(count):
        at, rank = arm.chosen[b], _rank_of(svd.sigma, b, question.rtol)
        if answers.rank[at] == UNDECIDED:
            answers.rank[at] = rank
            answers.healthy_margin[at] = _ratio(svd.sigma[m - 1, b], svd.sigma[0, b])
        if rank < m and question.force.size:
            _project_force(svd.W, b, rank, arm.force, scratch)


@inner
def _project_force(W, b, rank, force, scratch):
    """Replace F by the force that the healthy arm exerts, F̂ = J J† F."""
    m = W.shape[0]
    for i in range(m):
        scratch.F[i] = force[i, b]
    _copy_left_vectors(W, b, rank, scratch.V)
    exact.project(scratch.V, 0, rank, scratch.F, scratch.projected)
    # A force that is only rounding error is treated as zero, or its direction would matter.
    is_real = exact.norm(scratch.projected) > 1e-12 * exact.norm(scratch.F)
    for i in range(m):
        force[i, b] = scratch.projected[i] if is_real else 0.0


@inner
def _rank_of(sigma, b, rtol):
    """Return the rank of J in a lane."""
    rank = sigma.shape[0]
    while rank > 0 and sigma[rank - 1, b] <= rtol * sigma[0, b]:
        rank -= 1
    return rank


@inner
def _ratio(x, scale):
    """Return x / scale, 0 if the scale is 0."""
    return x / scale if scale > 0.0 else 0.0


@inner
def _copy_left_vectors(W, b, rank, U):
    """Copy the left singular vectors of a lane into columns, and complete them to a basis.

    Each added column starts from the unit vector farthest from the span of the previous ones.
    """
    m = W.shape[0]
    for i in range(rank):
        for r in range(m):
            U[r, i] = W[i, r, b]
    for i in range(rank, m):
        farthest, smallest = 0, math.inf
        for r in range(m):
            along = 0.0
            for j in range(i):
                along += U[r, j] * U[r, j]
            if along < smallest:
                farthest, smallest = r, along
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
def _load(question, b, arm, sigma, scratch):
    """Copy the posture of a lane into the workspace of `exact`."""
    m, n = scratch.J.shape
    for i in range(m):
        for k in range(n):
            scratch.J[i, k] = arm.J[i, k, b]
        scratch.s[i] = sigma[i, b]
    scratch.rank[0] = _rank_of(sigma, b, question.rtol)
    for k in range(n):
        scratch.rnea[k] = arm.weight[k, b]
    exact.friction_under_weight(question.friction, scratch.rnea, scratch.friction)
    for i in range(question.direction.size):
        scratch.d[i] = arm.direction[i, b]
    for i in range(question.force.size):
        scratch.F[i] = arm.force[i, b]


@inner
def _queue(locked, s, b, slot, J, K, lane, which):
    """Queue a pair, with its K, in a slot."""
    lane[slot], which[slot] = b, s
    for i in range(J.shape[0]):
        for k in range(J.shape[1]):
            K[i, k, slot] = 0.0 if locked[k] else J[i, k, b]


@inner
def _has_force_to_keep(scratch, has_force):
    """Return whether the healthy arm can exert any of what is asked (theory §2.6)."""
    return scratch.rank[0] > 0 and (not has_force or exact.norm(scratch.F) > 0.0)


@inner
def _decide_locked(locked, free, question, s, at, slot, sigma, W, scratch, answers):
    """Evaluate a set of locked joints, whose K is decomposed in a slot."""
    scratch.rank[1] = 0
    for i in range(scratch.t.size):
        scratch.t[i] = sigma[i, slot]
        scratch.F0[i] = 0.0
    after = exact.rank_of(scratch.t, question.rtol * scratch.s[0])
    has_force = question.force.size > 0
    _copy_left_vectors(W, slot, after, scratch.V)
    answers.verdict[s, at] = NOT_TOLERATED
    if _has_force_to_keep(scratch, has_force):
        answers.verdict[s, at] = exact.judge_locked(
            scratch, has_force, question.rtol, question.wary
        )
    exact.lose(scratch, after)
    _write_results(locked, free, question, s, at, after, True, True, True, scratch, answers)


@inner
def _evaluate_free(locked, free, question, s, at, scratch, answers):
    """Evaluate a set with free-swinging joints."""
    has_force, scale = question.force.size > 0, scratch.s[0]
    rtol, wary, friction = question.rtol, question.wary, question.friction
    answers.verdict[s, at] = NOT_TOLERATED
    if _has_force_to_keep(scratch, has_force):
        answers.verdict[s, at] = exact.judge_free(
            scratch, locked, free, None, friction, rtol, wary, has_force
        )
    ideal = exact.is_ideal(friction, free)
    exact.reduce(scratch, locked, free, ideal, wary, rtol)
    exact.decompose(scratch.K, scratch.V, scratch.t)
    after = exact.rank_of(scratch.t, rtol * scale)
    balanced = exact.is_balanced(scratch, free, ideal, rtol)
    stands = balanced and exact.hold(scratch, free, None, after, ideal, rtol, wary)
    _write_results(locked, free, question, s, at, after, ideal, balanced, stands, scratch, answers)


@inner
def _write_results(locked, free, question, s, at, after, ideal, balanced, stands, scratch, answers):
    """Write all results except the verdict."""
    m, scale, rank = scratch.s.size, scratch.s[0], scratch.rank[0]
    answers.rank_lost[s, at] = rank - after
    answers.sigma_min[s, at] = scratch.t[m - 1]
    answers.margin[s, at] = _ratio(scratch.t[m - 1], scale)
    answers.rho[s, at] = _relative_manipulability(scratch, rank)
    if question.force.size:
        _write_jump(question, s, at, stands, scratch, answers)
    if question.direction.size:
        for k in range(free.size):
            motor = 0.0 if free[k] else question.effort[k]
            scratch.limit[k] = question.brake[k] if locked[k] else motor
            scratch.middle[k] = 0.0 if locked[k] or free[k] else question.middle[k]
        answers.capability[s, at] = math.nan
        if balanced:
            answers.capability[s, at] = exact.largest_multiple(
                scratch, free, after, ideal, question.rtol, question.wary
            )


@inner
def _relative_manipulability(scratch, rank):
    """Return ρ = w(K)/w(J), NaN where w(J) = 0."""
    if rank < scratch.s.size:
        return math.nan
    product = 1.0
    for i in range(scratch.s.size):
        product *= scratch.t[i] / scratch.s[i]
    return product


@inner
def _write_jump(question, s, at, stands, scratch, answers):
    """Write the norms of the jump ΔF = F̂ - F', separately for forces and moments."""
    if not stands:  # the arm cannot be held in static equilibrium
        answers.jump[s, at] = math.nan
        answers.relative_jump[s, at] = 1.0
        if answers.moment_jump.size:
            answers.moment_jump[s, at] = math.nan
        return
    forces, moments, jump = 0.0, 0.0, 0.0
    for i in range(scratch.F.size):
        lost = scratch.jump[i]
        jump += lost * lost
        if question.rows[i] < 3:
            forces += lost * lost
        else:
            moments += (lost * question.weights[i]) ** 2
    size = exact.norm(scratch.F)
    answers.relative_jump[s, at] = math.sqrt(jump) / size if size > 0.0 else 0.0
    answers.jump[s, at] = math.sqrt(forces)
    if answers.moment_jump.size:
        answers.moment_jump[s, at] = math.sqrt(moments)
    elif question.rows[0] >= 3:
        answers.jump[s, at] = math.sqrt(moments)
