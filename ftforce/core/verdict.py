"""Verdicts: for locked joints alone, and for all fault modes with gravity and torque limits."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

from ftforce.core.arrays import Vector, norm
from ftforce.core.reduced_jacobian import reduce_decomposed

if TYPE_CHECKING:
    from ftforce.core.bounded_remap import BoundedRemap
    from ftforce.core.feasible_forces import FeasibleForces
    from ftforce.core.reduced_jacobian import ReducedJacobian


class Verdict(StrEnum):
    """Whether the tip force can be maintained after the fault."""

    TOLERATED = "tolerated"
    """The healthy joints can still exert the full force."""
    BORDERLINE = "borderline"
    """The verdict depends on the tolerance: the arm is close to losing or keeping the force."""
    NOT_TOLERATED = "not tolerated"
    """Part of the force can no longer be produced by the motors."""


def verdict(reduced: ReducedJacobian, F: Vector | None, wary: float) -> Verdict:
    """Return the verdict for one force, or for all forces that the healthy arm can exert.

    A single tolerance t decides which directions are lost, σ_i(K) ≤ t·σ_max(J), and which jumps
    are negligible, ‖ΔF‖ ≤ t·‖F̂‖. The verdict is ``BORDERLINE`` unless every t from
    ``reduced.rtol`` to ``wary`` gives the same answer.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂ that the healthy arm exerts, shape (m,); ``None`` for all forces.
    wary :
        Largest tolerance considered.
    """
    if reduced.rank == 0:
        return Verdict.NOT_TOLERATED  # the healthy arm has nothing to keep (theory §2.6)
    if reduced.damaged.s[-1] > wary * reduced.sigma_max:
        return Verdict.TOLERATED  # no direction is lost at any tolerance
    outcomes = _outcomes_for_all_forces(reduced, wary) if F is None else _outcomes(reduced, F, wary)
    if len(outcomes) > 1:
        return Verdict.BORDERLINE
    return Verdict.TOLERATED if True in outcomes else Verdict.NOT_TOLERATED


def _outcomes_for_all_forces(reduced: ReducedJacobian, wary: float) -> set[bool]:
    """Return whether all forces are kept, at the two ends of the (monotonic) tolerance range."""
    kept_at_wary = sum(s > wary * reduced.sigma_max for s in reduced.damaged.s)
    return {reduced.rank_after >= reduced.rank, kept_at_wary >= reduced.rank}


def _outcomes(reduced: ReducedJacobian, F: Vector, wary: float) -> set[bool]:
    """Return whether one force is kept, as the set of outcomes for tolerances rtol to wary."""
    largest = max(map(abs, F.tolist()))
    if largest == 0.0:
        return {True}
    if not 1e-100 < largest < 1e100:  # its square could underflow or overflow
        F = F / largest
    size = float(F.dot(F))
    share = [c * c / size for c in F.dot(reduced.damaged.U).tolist()]  # of ‖F̂‖², per left vector
    scale, rtol, singular_values = reduced.sigma_max, reduced.rtol, reduced.damaged.s
    # Between neighbouring σ_i the jump does not depend on t, so only the two ends of the
    # interval need checking.
    lowest, highest = rtol * scale, wary * scale
    losses = [tolerance_that_loses(s, scale) for s in singular_values if lowest < s <= highest]
    losses.reverse()  # ascending, as singular values descend
    outcomes = set()
    for start, end in zip([rtol, *losses], [*losses, wary], strict=True):
        lost = [c for c, s in zip(share, singular_values, strict=True) if s <= start * scale]
        relative_jump = math.sqrt(sum(lost))
        outcomes |= {relative_jump <= start, relative_jump <= end}
    return outcomes


def tolerance_that_loses(s: float, scale: float) -> float:
    """Return the smallest tolerance t at which a singular value is lost, s ≤ t · scale.

    Parameters
    ----------
    s :
        Singular value.
    scale :
        σ_max(J).
    """
    t = s / scale
    return t if s <= t * scale else math.nextafter(t, math.inf)  # the quotient may be rounded down


def judge(
    reduced: ReducedJacobian,
    F: Vector | None,
    wary: float,
    bounded: BoundedRemap | None = None,
    largest: Vector | None = None,
) -> Verdict:
    """Return the verdict for one or all forces, with free-swinging joints and torque limits.

    A single tolerance t decides which directions are lost, which jumps are negligible,
    ‖ΔF‖ ≤ t·‖F̂‖, and which torques count as balanced at ideal free-swinging joints; for others
    their friction does. The verdict is
    ``BORDERLINE`` unless every t from ``reduced.rtol`` to ``wary`` gives the same answer.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂ that the healthy arm exerts, shape (m,); ``None`` for all forces, in which case
        limits only decide whether the arm can support itself.
    wary :
        Largest tolerance considered.
    bounded :
        The remap within limits or with free-swinging joints; ``None`` if there are neither.
    largest :
        Maximum torques used for ``bounded``.
    """
    if bounded is None or reduced.rank == 0:
        return verdict(reduced, F, wary)
    outcomes = _outcomes_with_limits(reduced, F, wary, bounded, largest)
    if len(outcomes) > 1:
        return Verdict.BORDERLINE
    return Verdict.TOLERATED if True in outcomes else Verdict.NOT_TOLERATED


def _outcomes_with_limits(
    reduced: ReducedJacobian,
    F: Vector | None,
    wary: float,
    bounded: BoundedRemap,
    largest: Vector | None,
) -> set[bool]:
    # Imported lazily: needed only with limits or free-swinging joints.
    from ftforce.core.bounded_remap import nearest_force
    from ftforce.core.feasible_forces import feasible_forces

    def force_at(here: ReducedJacobian, t: float) -> tuple[FeasibleForces, Vector | None]:
        balance = t if is_ideal else reduced.rtol  # friction does not depend on the tolerance
        feasible = feasible_forces(here, bounded.rnea, largest, balance=balance)
        return feasible, nearest_force(feasible, bounded.nearest.F).F_after

    def is_kept(t: float) -> bool:
        is_lost = F is None and here.rank_after < reduced.rank
        return not is_lost and _relative_jump(feasible, F_after, bounded) <= t

    free = None if reduced.free is None else reduced.free.given
    is_ideal = free is not None and free.is_ideal
    here, feasible, F_after = reduced, bounded.feasible, bounded.F_after
    outcomes: set[bool] = set()
    start: float | None = reduced.rtol
    while start is not None:  # from one change of rank to the next
        if start != reduced.rtol:
            here = reduce_decomposed(reduced.healthy, reduced.locked, start, free)
            feasible, F_after = force_at(here, start)
        outcomes.add(is_kept(start))
        end = _next_change(here, wary)
        if is_ideal and not feasible.is_balanced:  # it may be at a larger tolerance
            feasible, F_after = force_at(here, end or wary)
        outcomes.add(is_kept(end or wary))
        start = end
    return outcomes


def _next_change(reduced: ReducedJacobian, wary: float) -> float | None:
    """Return the next tolerance up to wary at which a rank changes, or ``None``.

    Recomputed at every change: K changes when the column of a free-swinging joint counts as zero.
    """
    scale = reduced.sigma_max
    values = list(reduced.damaged.s)
    if reduced.free is not None and reduced.free.given.is_ideal:
        values += reduced.free.s.tolist()
    lowest, highest = reduced.rtol * scale, wary * scale
    above = [s for s in values if lowest < s <= highest]
    return tolerance_that_loses(min(above), scale) if above else None


def _relative_jump(
    feasible: FeasibleForces, F_after: Vector | None, bounded: BoundedRemap
) -> float:
    """Return ‖ΔF‖/‖F̂‖; for zero force, the supporting force relative to the gravity torques."""
    if F_after is None:
        return math.inf
    F, rnea = bounded.nearest.F, bounded.rnea
    jump = norm(F - F_after)
    if jump == 0.0:
        return 0.0
    if size := norm(F):
        return jump / size
    weight = norm(rnea)
    return jump * feasible.scale / weight if weight > 0.0 else math.inf


VERDICTS = tuple(Verdict)  # codes are indices into this tuple; larger is worse
CODES = {verdict: code for code, verdict in enumerate(VERDICTS)}
