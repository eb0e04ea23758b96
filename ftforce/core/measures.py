"""Measures of a fault set: margin, manipulability, lost directions, verdict (docs/theory)."""

from __future__ import annotations

import math
from enum import StrEnum
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import Matrix, Vector, over, read_only

if TYPE_CHECKING:
    from ftforce.core.reduced_jacobian import ReducedJacobian


class Verdict(StrEnum):
    """Whether the force at the tip survives the fault."""

    TOLERATED = "tolerated"
    """The healthy joints can go on exerting the whole force."""
    BORDERLINE = "borderline"
    """The answer depends on the tolerance: the arm is close to losing, or keeping, the force."""
    NOT_TOLERATED = "not tolerated"
    """Part of the force can no longer be commanded."""


def margin(reduced: ReducedJacobian) -> float:
    """Return σ_min(K) / σ_max(J): 0 where a direction is lost; 0 too for an arm with J = 0."""
    return over(reduced.damaged.s[-1], reduced.sigma_max, 0.0)


def relative_manipulability(reduced: ReducedJacobian) -> float:
    """Return ρ = w(K)/w(J) (Roberts & Maciejewski 1996); NaN where the healthy arm has w(J) = 0."""
    if reduced.rank < reduced.m:
        return math.nan
    return math.prod(a / b for a, b in zip(reduced.damaged.s, reduced.healthy.s, strict=True))


def condition_number(reduced: ReducedJacobian) -> float:
    """Return σ_max(K)/σ_min(K); infinite where a direction is lost."""
    smallest = reduced.damaged.s[-1]
    return reduced.damaged.s[0] / smallest if reduced.rank_after == reduced.m else math.inf


def force_error(reduced: ReducedJacobian) -> float:
    """Return the largest error of the tip's force per unit of torque error at the healthy joints.

    It is 1/σ of the smallest singular value of K that is not lost, (N or weighted N) per N·m;
    infinite if no direction is left.
    """
    r = reduced.rank_after
    return 1.0 / reduced.damaged.s[r - 1] if r else math.inf


def worst_manipulability_bound(n: int, m: int, f: int) -> float:
    """Return √(C(n-m, f)/C(n, f)): no posture's worst ρ over f locked joints is better."""
    return math.sqrt(comb(n - m, f) / comb(n, f)) if n >= m else 0.0


def lost_directions(reduced: ReducedJacobian) -> Matrix:
    """Return directions of force that the healthy arm has and the damaged one has not.

    Returns
    -------
    :
        Orthonormal rows in weighted task coordinates, shape (rank - rank_after, m), chosen along
        task axes where the lost space allows it, largest component positive.
    """
    count = reduced.rank - reduced.rank_after
    if count <= 0:
        return read_only(np.zeros((0, reduced.m)))
    lost = reduced.damaged.U[:, reduced.rank_after :]
    if reduced.rank < reduced.m:
        # Directions that even the healthy arm lacks are part of the complement of range(K);
        # take them out.
        lacking = lost.T @ reduced.healthy.U[:, reduced.rank :]
        lost = lost @ np.linalg.svd(lacking)[0][:, lacking.shape[1] :]
    return read_only(_along_axes(lost @ lost.T, count))


def _along_axes(projector: Matrix, count: int) -> Matrix:
    """Return an orthonormal basis of a projector's range: Gram-Schmidt from its longest columns."""
    rest = projector.copy()
    rows = []
    for _ in range(count):
        lengths = np.einsum("ij,ij->j", rest, rest)
        # Rounded, so that the first of equally long columns wins whatever the last bits are.
        row = rest[:, int(np.argmax(np.round(lengths, 9)))]
        row = row / np.linalg.norm(row)
        row = np.where(np.abs(row) < 1e-14, 0.0, row)
        rest = rest - np.outer(row, row @ rest)
        rows.append(row * math.copysign(1.0, row[int(np.argmax(np.round(np.abs(row), 9)))]))
    return np.array(rows)


def verdict(reduced: ReducedJacobian, F: Vector | None, wary: float) -> Verdict:
    """Judge a fault set for a force, or for every force that the healthy arm can exert.

    One tolerance t decides both what is lost, σ_i(K) ≤ t·σ_max(J), and what counts as no jump,
    ‖ΔF‖ ≤ t·‖F̂‖. The verdict is `BORDERLINE` if not every t from ``reduced.rtol`` to ``wary``
    gives the same answer.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂ that the healthy arm exerts, shape (m,); ``None`` asks about all of them.
    wary :
        Largest tolerance tried.
    """
    if reduced.damaged.s[-1] > wary * reduced.sigma_max:
        return Verdict.TOLERATED  # no tolerance gives a direction away
    answers = _answers_for_all(reduced, wary) if F is None else _answers(reduced, F, wary)
    if len(answers) > 1:
        return Verdict.BORDERLINE
    return Verdict.TOLERATED if True in answers else Verdict.NOT_TOLERATED


def _answers_for_all(reduced: ReducedJacobian, wary: float) -> set[bool]:
    """Return whether every force is kept, at both ends of the tolerances (it is monotonous)."""
    kept_at_wary = sum(s > wary * reduced.sigma_max for s in reduced.damaged.s)
    return {reduced.rank_after >= reduced.rank, kept_at_wary >= reduced.rank}


def _answers(reduced: ReducedJacobian, F: Vector, wary: float) -> set[bool]:
    """Return the set of answers that the tolerances from rtol to wary give for one force."""
    largest = max(map(abs, F.tolist()))
    if largest == 0.0:
        return {True}
    if not 1e-100 < largest < 1e100:  # its square could vanish or overflow
        F = F / largest
    size = float(F.dot(F))
    share = [c * c / size for c in F.dot(reduced.damaged.U).tolist()]  # of ‖F̂‖², per left vector
    scale = reduced.sigma_max
    # Between neighbouring σ_i the jump is the same for all t, and t is allowed to be anything
    # from the interval's start (strictest) to its end.
    doubtful = sorted(
        tolerance_that_loses(s, scale)
        for s in reduced.damaged.s
        if reduced.rtol * scale < s <= wary * scale
    )
    starts = [reduced.rtol, *doubtful]
    answers = set()
    for start, end in zip(starts, [*doubtful, wary], strict=True):
        lost = sum(c for c, s in zip(share, reduced.damaged.s, strict=True) if s <= start * scale)
        relative_jump = math.sqrt(lost)
        answers |= {relative_jump <= start, relative_jump <= end}
    return answers


def tolerance_that_loses(s: float, scale: float) -> float:
    """Return the least tolerance t that gives a singular value away, s ≤ t · scale."""
    t = s / scale
    return t if s <= t * scale else math.nextafter(t, math.inf)  # a quotient may be rounded down


def force_contributions(reduced: ReducedJacobian, tau: Vector, F: Vector) -> Vector:
    """Return ‖(Jᵀ)†_k τ_k‖/‖F̂‖, each joint's share in the tip's force (Table 2), shape (n,)."""
    units = np.eye(reduced.n)
    columns = [reduced.healthy.solve_transposed(unit, reduced.rtol) for unit in units]
    shares = _norms(np.array(columns), axis=1) * np.abs(tau)
    return read_only(over(shares, float(_norms(F)), np.zeros_like(shares)))


def velocity_contributions(J: Matrix, v: Vector) -> Vector:
    """Return ‖J_k v_k‖/‖J v‖, each joint's share in the tip's velocity (Table 2), shape (n,)."""
    shares = _norms(J * v, axis=0)
    return read_only(over(shares, float(_norms(J @ v)), np.zeros_like(shares)))


def _norms(A: Matrix, axis: int | None = None) -> Vector:
    """Return the norm; a power of two, which rounds nothing, keeps the squares in range."""
    _, exponents = np.frexp(np.abs(A).max(axis=axis, keepdims=True))
    scaled = np.asarray(np.linalg.norm(np.ldexp(A, -exponents), axis=axis))
    norms: Vector = np.ldexp(scaled, exponents.reshape(scaled.shape))
    return norms
