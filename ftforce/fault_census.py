"""One posture, all fault sets up to a size: which is the worst, which joint is the critical one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, get_args

import numpy as np

from ftforce import metrics
from ftforce.arrays import Svd, Vector, as_vector, read_only
from ftforce.bounded import BoundedRemap, remap_inside
from ftforce.changes import RneaChange, split_norms
from ftforce.closed_forms import force_jump
from ftforce.conditions import Conditions, Inverse, mass_matrix_for, rnea_change, tip_load
from ftforce.display import Displayed
from ftforce.errors import InputError, UnknownNameError, listed
from ftforce.faults import FaultMode, FaultSet, count_fault_sets, fault_sets
from ftforce.feasible import Reading, feasible_forces, reach, weakest_direction
from ftforce.kinematics import task_jacobian
from ftforce.limits import Limits
from ftforce.limits_reader import URDF, choose_limits
from ftforce.metrics import Verdict
from ftforce.posture import Posture, choose_posture
from ftforce.reduced import RTOL, WARY, ReducedJacobian, check_tolerances, reduce_decomposed
from ftforce.task import Axes, Task
from ftforce.verdicts import judge

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.dynamics import Payload
    from ftforce.limits_reader import LimitsLike
    from ftforce.robot import Robot

MOST_SETS = 1_000_000  # about a minute and a gigabyte; a sweep keeps no single sets

RankBy = Literal["jump", "capability"]

_RANKINGS: tuple[str, ...] = get_args(RankBy)
_SEVERITY = {Verdict.NOT_TOLERATED: 0, Verdict.BORDERLINE: 1, Verdict.TOLERATED: 2}


class Progress(Protocol):
    """Called with how many fault sets are done, of how many."""

    def __call__(self, done: int, total: int, /) -> None:
        """Take note."""


@dataclass(frozen=True, slots=True, eq=False)
class SetCapability:
    """The largest force that can be held with one fault set, N (N·m for a moment alone).

    Attributes
    ----------
    commanded, held :
        In both readings of a lock; infinite if no known limit ends it, NaN if the arm cannot
        stand still.
    stops :
        Indices of the joints whose limits end what can be commanded.
    """

    commanded: float
    held: float
    stops: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SetReport:
    """What one fault set does.

    Attributes
    ----------
    faults :
        The set.
    after, jump :
        Force that can still be held and force jump, N and N·m, shape (m,); ``None`` without a
        force, or if the arm cannot stand still.
    jump_norm, moment_jump_norm :
        Norms of the jump's forces (N) and moments (N·m); ``None`` where there are none.
    relative_jump :
        ‖ΔF‖/‖F̂‖, weighted; without a force 1 if a direction is lost; 1 if the arm cannot stand
        still.
    rank_after, rank_lost :
        Rank of K, and how much less it is than J's.
    sigma_min_after, margin, relative_manipulability :
        Smallest singular value of K; over σ_max(J); ρ = w(K)/w(J), NaN where w(J) = 0.
    can_stand_still :
        Whether motors, brakes and some force at the tip can hold the arm.
    share :
        Largest share of the force that keeps its direction; ``None`` without limits and joints
        without torque, without a force, or if there is none.
    binding :
        Indices of joints at their limits.
    capability :
        ``None`` unless the census ranks by it.
    verdict :
        As for one analysis.
    """

    faults: FaultSet
    after: Vector | None
    jump: Vector | None
    jump_norm: float | None
    moment_jump_norm: float | None
    relative_jump: float
    rank_after: int
    rank_lost: int
    sigma_min_after: float
    margin: float
    relative_manipulability: float
    can_stand_still: bool
    share: float | None
    binding: tuple[int, ...]
    capability: SetCapability | None
    verdict: Verdict


@dataclass(frozen=True, slots=True, eq=False)
class JointReport:
    """How critical one joint is.

    Attributes
    ----------
    joint :
        Index from 0.
    alone :
        The set in which only this joint fails.
    sets, not_tolerated, borderline :
        How many sets hold the joint, and how many of them are not tolerated or borderline.
    mean_relative_jump :
        Mean of ‖ΔF‖/‖F̂‖ over the sets that hold the joint.
    """

    joint: int
    alone: SetReport
    sets: int
    not_tolerated: int
    borderline: int
    mean_relative_jump: float


@dataclass(frozen=True, slots=True, eq=False)
class Census(Displayed):
    """All fault sets of one posture, worst first.

    Attributes
    ----------
    robot, task, posture, conditions, limits :
        What was analysed; ``limits`` is ``None`` if none are counted.
    mode :
        How the joints fail.
    largest :
        Size of the largest sets.
    rank_by :
        What the sets are sorted by.
    direction :
        Of the capability, in the task's axes, shape (m,); ``None`` for the weakest.
    rtol, wary :
        Tolerances.
    requested, before :
        Force asked for and force the healthy arm exerts, N and N·m, shape (m,); ``None`` without.
    rank :
        Rank of the healthy arm.
    sets :
        Every fault set, worst first.
    joints :
        Every joint, most critical first.
    """

    robot: Robot
    task: Task
    posture: Posture
    conditions: Conditions
    limits: Limits | None
    mode: FaultMode
    largest: int
    rank_by: RankBy
    direction: Vector | None
    rtol: float
    wary: float
    requested: Vector | None
    before: Vector | None
    rank: int
    sets: tuple[SetReport, ...]
    joints: tuple[JointReport, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the answer doubtful."""
        doubts = list(self.posture.warnings)
        matters = self.limits is not None or self.mode is FaultMode.FREE
        if matters and not self.is_weight_known:
            doubts.append("the URDF has no masses: the weight of the arm is missing")
        if self.limits is not None:
            unknown = [self.robot.names[i] for i in np.flatnonzero(np.isnan(self.limits.effort))]
            if unknown:
                doubts.append(f"unknown effort limits count as none: {listed(unknown)}")
        return tuple(doubts)

    @property
    def is_weight_known(self) -> bool:
        """Whether the URDF has masses, or nothing weighs."""
        return self.robot.mass > 0.0 or not (self.conditions.gravity.any() or self.conditions.moves)

    def worst_manipulability(self, size: int = 1) -> tuple[float, float]:
        """Return the smallest ρ over sets of one size, and the bound no posture can exceed."""
        rho = [report.relative_manipulability for report in self.sets if len(report.faults) == size]
        bound = metrics.worst_manipulability_bound(self.robot.n, self.task.m, size)
        return min(rho, default=math.nan), bound


def census(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    *,
    faults: int = 1,
    mode: FaultMode | str = FaultMode.LOCKED,
    force: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    payload: Payload | float | str | tuple[float, ArrayLike] | None = None,
    limits: LimitsLike = None,
    inverse: Inverse = "euclidean",
    rank_by: RankBy = "jump",
    direction: ArrayLike | None = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rtol: float = RTOL,
    wary: float = WARY,
    progress: Progress | None = None,
) -> Census:
    """Analyse every set of up to ``faults`` failed joints in one posture (eq. 12-13).

    Parameters
    ----------
    robot, q, force, torque, velocity, acceleration, gravity, payload, inverse :
        As in `ftforce.analyze`.
    task, length, axes, posture, rtol, wary :
        As in `ftforce.analyze`.
    faults :
        Size of the largest sets.
    mode :
        ``locked`` or ``free``.
    limits :
        As in `ftforce.analyze`; if not given the URDF's where the ranking needs them, else none.
    rank_by :
        ``jump``, or ``capability``: the force that can still be held.
    direction :
        Direction of the capability, in the task's axes, shape (m,); the force's if not given, and
        without a force the weakest of each set.
    progress :
        Called after every set.

    Returns
    -------
    :
        The sets, worst first. By jump: not tolerated, then borderline, then tolerated; the larger
        jump first, and without a jump the smaller margin. By capability: the smallest commanded
        force first, then the smallest held one.

    Raises
    ------
    InputError
        A malformed value, or more than a million sets.

    Examples
    --------
    >>> import ftforce
    >>> result = ftforce.census(ftforce.load_robot("dh5"), force=[80, 50, 10])
    >>> print(result.sets[0].faults, result.sets[0].verdict.value)
    {3} not tolerated
    """
    check_tolerances(rtol, wary)
    _check_size(robot, faults)
    how = _checked_mode(mode)
    if rank_by not in _RANKINGS:
        raise UnknownNameError("ranking", rank_by, _RANKINGS)
    wanted = Task.parse(task, axes, length)
    place = choose_posture(robot, q, posture)
    conditions = Conditions.of(
        robot, velocity=velocity, acceleration=acceleration, gravity=gravity, payload=payload
    )
    by_capability = rank_by == "capability"
    counted = choose_limits(robot, URDF if limits is None and by_capability else limits)
    healthy = Svd(wanted.weigh_jacobian(task_jacobian(robot, place.q, wanted)))
    nothing = FaultSet().mask(robot.n)
    whole = reduce_decomposed(healthy, nothing, rtol)
    M = mass_matrix_for(robot, place.q, conditions, inverse)
    load = tip_load(robot, whole, wanted, force, torque, M)
    F = None if load is None else load.F
    ray = _direction(wanted, direction, F)
    case = _Case(
        robot, wanted, place, conditions, counted, healthy, whole,
        rnea_change(robot, place.q, conditions, nothing), F, by_capability, ray, rtol, wary,
    )  # fmt: skip
    total = count_fault_sets(robot.n, faults)
    reports = []
    for done, fault_set in enumerate(fault_sets(robot.n, faults, how), start=1):
        reports.append(_report(case, fault_set))
        if progress is not None:
            progress(done, total)
    return Census(
        robot=robot,
        task=wanted,
        posture=place,
        conditions=conditions,
        limits=counted,
        mode=how,
        largest=faults,
        rank_by=rank_by,
        direction=ray if by_capability else None,
        rtol=rtol,
        wary=wary,
        requested=None if load is None else load.requested,
        before=None if F is None else read_only(wanted.unweigh_force(F)),
        rank=whole.rank,
        sets=tuple(sorted(reports, key=_weakness if by_capability else _badness)),
        joints=_rank_joints(robot, reports),
    )


def _checked_mode(mode: FaultMode | str) -> FaultMode:
    how = FaultMode.parse(mode)
    if how is FaultMode.WEAK:
        raise InputError("a census takes locked or free joints; ask analyze about weak ones")
    return how


def _direction(task: Task, direction: ArrayLike | None, F: Vector | None) -> Vector | None:
    """Return the capability's direction, unweighted and of unit length; ``None`` if open."""
    if direction is not None:
        names = ", ".join(task.components)
        vector = as_vector(direction, task.m, "direction", f"{names} of the task '{task}'")
        if not vector.any():
            raise InputError("the direction needs a component that is not zero")
        return read_only(vector / task.size(vector))
    if F is None or not F.any():
        return None
    plain = task.unweigh_force(F)
    return read_only(plain / task.size(plain))


def _check_size(robot: Robot, faults: int) -> None:
    if isinstance(faults, bool) or not isinstance(faults, int) or not 1 <= faults <= robot.n:
        raise InputError(f"faults must be a number from 1 to {robot.n}, got {faults!r}")
    total = count_fault_sets(robot.n, faults)
    if total > MOST_SETS:
        raise InputError(
            f"{total:,} fault sets of up to {faults} of {robot.n} joints are more than one census "
            f"takes ({MOST_SETS:,}); ask for smaller sets"
        )


class _Case(NamedTuple):
    """What all sets of a census share."""

    robot: Robot
    task: Task
    posture: Posture
    conditions: Conditions
    limits: Limits | None
    healthy: Svd
    whole: ReducedJacobian
    rnea: RneaChange
    F: Vector | None
    by_capability: bool
    direction: Vector | None
    rtol: float
    wary: float

    def rnea_after(self, faults: FaultSet) -> Vector:
        if not self.conditions.moves:
            return self.rnea.after
        mask = faults.mask(self.robot.n)
        return rnea_change(self.robot, self.posture.q, self.conditions, mask).after


def _report(case: _Case, faults: FaultSet) -> SetReport:
    n, task, F = case.robot.n, case.task, case.F
    swinging = faults.swinging_mask(n)
    reduced = reduce_decomposed(case.healthy, faults.mask(n), case.rtol, swinging)
    largest = None if case.limits is None else case.limits.largest_torques(faults)
    bounded, rnea = None, case.rnea.after
    if largest is not None or swinging is not None:
        rnea = case.rnea_after(faults)
        asked = np.zeros(task.m) if F is None else F
        bounded = remap_inside(reduced, asked, rnea, largest)
    after, jump = _outcome(reduced, F, bounded)
    can_stand_still = bounded is None or bounded.F_after is not None
    linear, angular = (None, None) if jump is None else split_norms(task, task.unweigh_force(jump))
    return SetReport(
        faults=faults,
        after=None if after is None else read_only(task.unweigh_force(after)),
        jump=None if jump is None else read_only(task.unweigh_force(jump)),
        jump_norm=linear,
        moment_jump_norm=angular,
        relative_jump=_relative_jump(reduced, F, jump) if can_stand_still else 1.0,
        rank_after=reduced.rank_after,
        rank_lost=reduced.rank - reduced.rank_after,
        sigma_min_after=reduced.damaged.s[-1],
        margin=metrics.margin(reduced),
        relative_manipulability=metrics.relative_manipulability(reduced),
        can_stand_still=can_stand_still,
        share=None if bounded is None or F is None else bounded.share,
        binding=() if bounded is None else bounded.binding,
        capability=_capability(case, reduced, rnea, largest) if case.by_capability else None,
        verdict=judge(reduced, F, case.wary, bounded, largest),
    )


def _outcome(
    reduced: ReducedJacobian, F: Vector | None, bounded: BoundedRemap | None
) -> tuple[Vector | None, Vector | None]:
    """Return force after and jump, weighted; ``None`` without a force or if nothing is feasible."""
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


def _capability(
    case: _Case, reduced: ReducedJacobian, rnea: Vector, largest: Vector | None
) -> SetCapability:
    task, amounts, stops = case.task, [], []
    for reading in Reading:
        feasible = feasible_forces(reduced, rnea, largest, reading)
        if case.direction is None:
            space = case.whole.healthy.U[:, : case.whole.rank]
            worst = weakest_direction(feasible, space)
            ray, size = worst.reach, task.size(task.unweigh_force(worst.direction))
        else:
            ray, size = reach(feasible, task.weigh_force(case.direction)), 1.0
        amounts.append(math.nan if ray.is_empty else ray.most * size)
        stops.append(ray.stops)
    return SetCapability(amounts[0], amounts[1], stops[0])


def _weakness(report: SetReport) -> tuple[float, ...]:
    """Sort key: the smallest capability first; an arm that cannot stand still before all."""
    found = report.capability
    assert found is not None
    commanded, held = (-1.0 if math.isnan(x) else x for x in (found.commanded, found.held))
    return round(commanded, 9), round(held, 9), len(report.faults), *report.faults.joints


def _badness(report: SetReport) -> tuple[float, ...]:
    """Sort key: worst first; of equal jumps the one that takes fewer faults."""
    jump = round(report.relative_jump, 9)
    size = len(report.faults) if jump > 0.0 else 0
    return (
        _SEVERITY[report.verdict], report.can_stand_still, -jump, -report.rank_lost, size, round(report.margin, 9),
        *report.faults.joints,
    )  # fmt: skip


def _rank_joints(robot: Robot, reports: list[SetReport]) -> tuple[JointReport, ...]:
    joints = []
    for i in range(robot.n):
        own = [report for report in reports if i in report.faults.joints]
        verdicts = [report.verdict for report in own]
        joints.append(
            JointReport(
                joint=i,
                alone=next(report for report in own if len(report.faults) == 1),
                sets=len(own),
                not_tolerated=verdicts.count(Verdict.NOT_TOLERATED),
                borderline=verdicts.count(Verdict.BORDERLINE),
                mean_relative_jump=math.fsum(r.relative_jump for r in own) / len(own),
            )
        )
    return tuple(
        sorted(
            joints,
            key=lambda j: (
                -j.not_tolerated,
                -j.borderline,
                -round(j.mean_relative_jump, 9),
                j.alone.margin,
            ),
        )
    )
