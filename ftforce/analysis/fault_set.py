"""Effect of one fault set among many in a posture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.analysis.conditions import rnea_change
from ftforce.analysis.question import HEALTHY
from ftforce.core import measures
from ftforce.core.arrays import Vector, read_only
from ftforce.core.bounded_remap import BoundedRemap, overloaded, remap_inside
from ftforce.core.changes import RneaChange, split_norms
from ftforce.core.feasible_forces import (
    LimitingFactor,
    LockModel,
    feasible_forces,
    is_beyond_arm,
    limiting_factor,
    reach,
    weakest_direction,
)
from ftforce.core.reduced_jacobian import ReducedJacobian, reduce_decomposed
from ftforce.core.remap import force_jump
from ftforce.core.svd import Svd
from ftforce.core.verdict import judge
from ftforce.robot.dynamics import rnea_torque
from ftforce.robot.kinematics import task_jacobian

if TYPE_CHECKING:
    from ftforce.analysis.question import Question
    from ftforce.core.faults import FaultSet
    from ftforce.core.feasible_forces import FeasibleForces, Reach
    from ftforce.core.verdict import Verdict


@dataclass(frozen=True, slots=True, eq=False)
class SetCapability:
    """Largest force that can be held with one fault set, N (N·m for a pure moment).

    Attributes
    ----------
    commanded, held :
        Capability under each lock model; infinite if no known limit bounds it, NaN if the arm
        cannot be held with any force in this direction.
    minimum :
        Smallest commanded force; nonzero only with free-swinging joints or if weight alone exceeds
        a limit, NaN where ``commanded`` is.
    end, held_end :
        What limits the commanded force, and what limits the held force.
    limiting_joints :
        Indices of the joints that limit the commanded force.
    """

    commanded: float
    held: float
    minimum: float
    end: LimitingFactor
    held_end: LimitingFactor
    limiting_joints: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SetReport:
    """Effect of one fault set.

    Attributes
    ----------
    faults :
        The fault set.
    after, jump :
        Force that can still be held, and force jump, N and N·m, shape (m,); ``None`` without a
        force, or if the arm cannot be held.
    jump_norm, moment_jump_norm :
        Norms of the force components (N) and of the moment components (N·m) of the jump; ``None``
        if it has none.
    relative_jump :
        ‖ΔF‖/‖F̂‖, weighted. Without a force, 1 if a direction is lost and 0 otherwise; 1 if the arm
        cannot be held.
    kept :
        F̂ᵀF'/F̂ᵀF̂, weighted: the share of the force that is still exerted along it; ``None`` without
        a force, or if the arm cannot be held.
    rank_after, rank_lost :
        Rank of K, and rank of J minus rank of K.
    sigma_min_after, margin, condition_number, relative_manipulability :
        σ_min(K); σ_min(K)/σ_max(J); σ_max(K)/σ_min(K), infinite if K does not have full
        rank; ρ = w(K)/w(J), NaN where w(J) = 0.
    can_stand_still :
        Whether motors, brakes and some tip force can hold the arm.
    share :
        Largest fraction of the force that can be commanded in its direction; ``None`` without a
        force, with neither limits nor free-swinging joints, or if no fraction is feasible.
    binding :
        Indices of joints at their limits.
    capability :
        The capability; ``None`` unless the census ranks by it.
    verdict :
        Verdict, as in `ftforce.analyze`.
    """

    faults: FaultSet
    after: Vector | None
    jump: Vector | None
    jump_norm: float | None
    moment_jump_norm: float | None
    relative_jump: float
    kept: float | None
    rank_after: int
    rank_lost: int
    sigma_min_after: float
    margin: float
    condition_number: float
    relative_manipulability: float
    can_stand_still: bool
    share: float | None
    binding: tuple[int, ...]
    capability: SetCapability | None
    verdict: Verdict


class SharedCase(NamedTuple):
    """Data shared by all fault sets in a posture.

    Attributes
    ----------
    question :
        What is asked, in this posture.
    healthy :
        Weighted Jacobian of the healthy arm, decomposed and reduced by no fault.
    rnea :
        Weighted torques for weight and motion of the healthy arm.
    F :
        Weighted force that the healthy arm exerts, shape (m,); ``None`` without a force.
    direction :
        Direction of the capability, shape (m,); ``None`` for the weakest of each set.
    """

    question: Question
    healthy: ReducedJacobian
    rnea: RneaChange
    F: Vector | None
    direction: Vector | None

    @classmethod
    def of(cls, question: Question) -> SharedCase:
        """Return the data of a posture, with eq. (8) for a force and (Jᵀ)† τ for torques.

        Raises
        ------
        InputError
            The dynamic inverse needs masses, and the URDF has none.
        """
        robot, q, scale = question.robot, question.q, question.scale
        no_joint = HEALTHY.mask(robot.n)
        svd = Svd(question.weigh_jacobian(task_jacobian(robot, q, question.task)))
        healthy = reduce_decomposed(svd, no_joint, question.rtol)
        load = question.load(healthy)
        F = None if load is None else load.F
        rnea = rnea_change(robot, q, question.conditions, no_joint).weighed(scale)
        return cls(question, healthy, rnea, F, question.direction_or_that_of(F))

    def reduce(self, faults: FaultSet) -> ReducedJacobian:
        """Return the Jacobians before and after a fault set."""
        n, whole = self.question.robot.n, self.healthy
        free = self.question.free_joints(faults)
        return reduce_decomposed(whole.healthy, faults.mask(n), whole.rtol, free)

    def rnea_after(self, faults: FaultSet) -> Vector:
        """Return the weighted torques for weight and motion after a fault set, shape (n,)."""
        robot, q, conditions = self.question.robot, self.question.q, self.question.conditions
        if not conditions.moves:
            return self.rnea.after
        locked, still = faults.mask(robot.n), robot.at_rest
        v, a = (
            still if x is None else np.where(locked, 0.0, x)
            for x in (conditions.velocity, conditions.acceleration)
        )
        own = None if conditions.is_model_gravity else conditions.gravity
        terms = conditions.terms_after(faults.free_mask(robot.n))
        rnea = rnea_torque(robot, q, v, a, gravity=own, payload=conditions.payload, drives=terms)
        return self.question.scale.weigh_torque(rnea)


def report_set(
    case: SharedCase, faults: FaultSet, reduced: ReducedJacobian, *, by_capability: bool = False
) -> SetReport:
    """Return the report of one fault set.

    Parameters
    ----------
    case :
        Data shared by all sets.
    faults, reduced :
        The fault set, and its Jacobians, `SharedCase.reduce`.
    by_capability :
        Whether the report includes the capability.
    """
    question, F = case.question, case.F
    task, largest = question.task, question.largest_torques(faults)
    bounded, rnea = None, case.rnea.after
    if largest is not None or reduced.free is not None:
        rnea = case.rnea_after(faults)
        bounded = remap_inside(reduced, np.zeros(task.m) if F is None else F, rnea, largest)
    after, lost = _outcome(reduced, F, bounded)
    can_stand_still = bounded is None or bounded.F_after is not None
    jump = None if lost is None else read_only(task.unweigh_force(lost))
    linear, angular = (None, None) if jump is None else split_norms(task, jump)
    return SetReport(
        faults=faults,
        after=None if after is None else read_only(task.unweigh_force(after)),
        jump=jump,
        jump_norm=linear,
        moment_jump_norm=angular,
        relative_jump=_relative_jump(reduced, F, lost) if can_stand_still else 1.0,
        kept=_kept(F, after),
        rank_after=reduced.rank_after,
        rank_lost=reduced.rank - reduced.rank_after,
        sigma_min_after=reduced.damaged.s[-1],
        margin=measures.margin(reduced),
        condition_number=measures.condition_number(reduced),
        relative_manipulability=measures.relative_manipulability(reduced),
        can_stand_still=can_stand_still,
        share=None if bounded is None or F is None else bounded.share,
        binding=() if bounded is None else bounded.binding,
        capability=set_capability(case, reduced, rnea, largest) if by_capability else None,
        verdict=judge(reduced, F, question.wary, bounded, largest),
    )


def _outcome(
    reduced: ReducedJacobian, F: Vector | None, bounded: BoundedRemap | None
) -> tuple[Vector | None, Vector | None]:
    """Return weighted force after the fault and jump; ``None`` without a force or if infeasible."""
    if F is None:
        return None, None
    if bounded is not None:
        return bounded.F_after, bounded.jump
    change = force_jump(reduced, F)
    return change.F_after, change.jump


def _relative_jump(reduced: ReducedJacobian, F: Vector | None, jump: Vector | None) -> float:
    if F is None or jump is None:
        return float(reduced.rank_after < reduced.rank)
    size = math.sqrt(F.dot(F))
    return math.sqrt(jump.dot(jump)) / size if size > 0.0 else 0.0


def _kept(F: Vector | None, after: Vector | None) -> float | None:
    if F is None or after is None:
        return None
    size = float(F.dot(F))
    return float(F.dot(after)) / size if size > 0.0 else None


def set_capability(
    case: SharedCase, reduced: ReducedJacobian, rnea: Vector, largest: Vector | None
) -> SetCapability:
    """Return the largest force that can be held with one fault set.

    Parameters
    ----------
    case :
        Data shared by all sets.
    reduced :
        The decomposed Jacobians of the set.
    rnea, largest :
        Weighted torques for weight and motion, and torque limits, after the fault, shape (n,).
    """
    rays, ends, stops = [], [], []
    for reading in LockModel:
        feasible = feasible_forces(reduced, rnea, largest, reading)
        direction, ray, size = _ray(case, feasible)
        beyond = is_beyond_arm(reduced, direction)
        end = limiting_factor(feasible, ray, beyond_arm=beyond)
        rays.append(ray)
        ends.append(end)
        stops.append(
            ray.limiting_joints
            if end in {LimitingFactor.LIMIT, LimitingFactor.FRICTION}
            else overloaded(feasible)
            if end is LimitingFactor.WEIGHT
            else ()
        )
    commanded, held = (math.nan if ray.is_empty else ray.maximum * size for ray in rays)
    least = math.nan if rays[0].is_empty else rays[0].minimum * size
    return SetCapability(commanded, held, least, ends[0], ends[1], stops[0])


def commanded_and_held(
    case: SharedCase, reduced: ReducedJacobian, rnea: Vector, largest: Vector | None
) -> tuple[float, ...]:
    """Return the commanded and the held capability of a fault set, N (N·m); NaN for none.

    Parameters
    ----------
    case, reduced, rnea, largest :
        As in `set_capability`.
    """
    rays = (_ray(case, feasible_forces(reduced, rnea, largest, model)) for model in LockModel)
    return tuple(math.nan if ray.is_empty else ray.maximum * size for _, ray, size in rays)


def _ray(case: SharedCase, feasible: FeasibleForces) -> tuple[Vector, Reach, float]:
    """Return the direction, the case's or the weakest, the reach in it, and its unit factor."""
    task = case.question.task
    if case.direction is not None:
        direction = task.weigh_force(case.direction)
        return direction, reach(feasible, direction), 1.0
    space = case.healthy.healthy.U[:, : case.healthy.rank]
    return *weakest_direction(feasible, space), task.weighted_unit
