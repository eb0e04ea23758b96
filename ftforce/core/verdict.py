"""The verdict for every fault mode, with weight and limits (docs/theory/verdict)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.core.arrays import norm
from ftforce.core.bounded_remap import nearest_force
from ftforce.core.feasible_forces import feasible_forces
from ftforce.core.measures import Verdict, tolerance_that_loses, verdict
from ftforce.core.reduced_jacobian import reduce_decomposed

if TYPE_CHECKING:
    from ftforce.core.arrays import Vector
    from ftforce.core.bounded_remap import BoundedRemap
    from ftforce.core.feasible_forces import FeasibleForces
    from ftforce.core.reduced_jacobian import ReducedJacobian


def judge(
    reduced: ReducedJacobian,
    F: Vector | None,
    wary: float,
    bounded: BoundedRemap | None = None,
    largest: Vector | None = None,
) -> Verdict:
    """Judge a fault set for a force, or for every force that the healthy arm can exert.

    One tolerance t decides what is lost, what counts as no jump, ‖ΔF‖ ≤ t·‖F̂‖, and which torque
    counts as balanced at a joint without torque. The verdict is `BORDERLINE` if not every t from
    ``reduced.rtol`` to ``wary`` gives the same answer.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂ that the healthy arm exerts, shape (m,); ``None`` asks about all of them: then
        limits are asked only whether the arm can carry itself.
    wary :
        Largest tolerance tried.
    bounded :
        The remap inside limits, or with joints without torque; ``None`` if there is neither.
    largest :
        Largest torques that it was made with.
    """
    if bounded is None:
        return verdict(reduced, F, wary)
    answers = _answers(reduced, F, wary, bounded, largest)
    if len(answers) > 1:
        return Verdict.BORDERLINE
    return Verdict.TOLERATED if True in answers else Verdict.NOT_TOLERATED


def _answers(
    reduced: ReducedJacobian,
    F: Vector | None,
    wary: float,
    bounded: BoundedRemap,
    largest: Vector | None,
) -> set[bool]:
    mask = None
    if reduced.swinging is not None:
        mask = ~(reduced.commanding | reduced.locked)
    answers: set[bool] = set()
    here, feasible, F_after = reduced, bounded.feasible, bounded.F_after
    start: float | None = reduced.rtol
    while start is not None:  # from one change of a rank to the next
        if start != reduced.rtol:
            here = reduce_decomposed(reduced.healthy, reduced.locked, start, mask)
            feasible = feasible_forces(here, bounded.rnea, largest)
            F_after = None
        if F_after is None:  # also where a larger tolerance takes the arm for standing still
            F_after = nearest_force(feasible._replace(unbalanced=0.0), bounded.nearest.F).F_after
        jump = _relative_jump(feasible, F_after, bounded)
        if F is None and here.rank_after < reduced.rank:
            jump = math.inf  # a direction is lost
        end = _next_change(here, wary)
        answers |= {feasible.unbalanced <= t and jump <= t for t in (start, end or wary)}
        start = end
    return answers


def _next_change(reduced: ReducedJacobian, wary: float) -> float | None:
    """Return the next larger tolerance at which a rank changes, ``None`` if up to wary none does.

    Asked anew at every change: when a swinging column counts as zero, K gets other values.
    """
    scale = reduced.sigma_max
    values = list(reduced.damaged.s)
    if reduced.swinging is not None:
        values += reduced.swinging.s.tolist()
    lowest, highest = reduced.rtol * scale, wary * scale
    above = [s for s in values if lowest < s <= highest]
    return tolerance_that_loses(min(above), scale) if above else None


def _relative_jump(
    feasible: FeasibleForces, F_after: Vector | None, bounded: BoundedRemap
) -> float:
    """Return ‖ΔF‖/‖F̂‖; without a force, the support that is needed in relation to the weight."""
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
