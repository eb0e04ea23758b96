"""Analyse all fault sets up to a given size in one posture, and rank sets and joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ftforce.analysis.conditions import rnea_change
from ftforce.analysis.fault_set import SetReport, SharedCase, report_set
from ftforce.analysis.limits_files import URDF
from ftforce.analysis.question import (
    HEALTHY,
    AllFaultSets,
    AnsweredForAll,
    Progress,
    Question,
    check_progress,
)
from ftforce.analysis.warnings import implausible
from ftforce.core import measures
from ftforce.core.arrays import Vector, read_only
from ftforce.core.faults import FaultMode
from ftforce.core.ranks import Rank, ranks_of
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.verdict import Verdict
from ftforce.errors import InputError, check_word, listed
from ftforce.robot.kinematics import task_jacobian

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import Inverse, PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.core.task import Axes, Task
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot

RankBy = Literal["jump", "capability"]

_RANKINGS: tuple[str, ...] = get_args(RankBy)
_SEVERITY = {Verdict.NOT_TOLERATED: 0, Verdict.BORDERLINE: 1, Verdict.TOLERATED: 2}


@dataclass(frozen=True, slots=True, eq=False)
class JointReport:
    """Criticality of one joint.

    Attributes
    ----------
    joint :
        Index from 0.
    alone :
        Report of the set in which only this joint fails.
    sets, not_tolerated, borderline :
        Number of sets that contain the joint, and how many of them are not tolerated or borderline.
    falls :
        Number of sets that contain the joint and with which the arm cannot be held.
    mean_relative_jump :
        Mean of ‖ΔF‖/‖F̂‖ over the sets that contain the joint.
    least_capability :
        Smallest commanded force over these sets; infinite if no known limit bounds it, NaN if the
        arm cannot be held with one of them, ``None`` unless the census ranks by capability.
    """

    joint: int
    alone: SetReport
    sets: int
    not_tolerated: int
    borderline: int
    falls: int
    mean_relative_jump: float
    least_capability: float | None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Census(AnsweredForAll):
    """All fault sets of one posture, worst first.

    Attributes
    ----------
    question, all_sets :
        What was asked, and of which sets. Their parts are attributes too: robot, task, posture,
        conditions, limits, rtol and wary; mode and largest.
    rank_by :
        Ranking criterion.
    direction :
        Direction of the capability, in task axes, shape (m,); ``None`` for the weakest.
    before :
        Force that the healthy arm exerts, N and N·m, shape (m,); ``None`` if no force was given.
    rank :
        Rank of the healthy arm.
    healthy :
        Report of the healthy arm, without any fault: the baseline.
    sets :
        Reports of all fault sets, worst first.
    joints :
        Reports of all joints, most critical first.
    """

    question: Question
    all_sets: AllFaultSets
    rank_by: RankBy
    direction: Vector | None
    before: Vector | None
    rank: int
    healthy: SetReport
    sets: tuple[SetReport, ...]
    joints: tuple[JointReport, ...]

    @property
    def posture(self) -> Posture:
        """The posture, with its source."""
        return self.question.place

    @property
    def requested(self) -> Vector | None:
        """Requested force, N and N·m, shape (m,); ``None`` if none was given."""
        return self.question.force

    @property
    def set_ranks(self) -> tuple[Rank, ...]:
        """Ranks of the sets, in their order; sets that the ranking cannot tell apart share one."""
        key = _by_capability if self.rank_by == "capability" else _by_severity
        return ranks_of(map(key, self.sets))

    @property
    def joint_ranks(self) -> tuple[Rank, ...]:
        """Ranks of the joints, in their order; ties share one."""
        return ranks_of(map(_joint_key(self.rank_by == "capability"), self.joints))

    @property
    def most_critical(self) -> tuple[JointReport, ...]:
        """The first joint, and those that tie with it."""
        return self.joints[: self.joint_ranks[0].last]

    def capability_kept(self, report: SetReport) -> float | None:
        """Return the commanded force with a fault set over that of the healthy arm.

        Parameters
        ----------
        report :
            Report of the set.

        Returns
        -------
        :
            ``None`` unless the census ranks by capability, or if one of them is not a finite
            force, or the healthy arm has none.
        """
        before, after = self.healthy.capability, report.capability
        if before is None or after is None or not 0.0 < before.commanded < math.inf:
            return None
        share = after.commanded / before.commanded
        return share if math.isfinite(share) else None

    def torque_to_command(self, report: SetReport) -> Vector | None:
        """Return the motor torques with a fault set, weight and motion included, N·m (N).

        They are ``rnea + Jᵀ F'`` (eq. 20, 24), and 0 at locked and free-swinging joints.

        Parameters
        ----------
        report :
            Report of the set.

        Returns
        -------
        :
            Shape (n,); ``None`` without a force, if the arm cannot be held, or if the URDF has no
            masses.
        """
        if report.after is None or not self.is_weight_known:
            return None
        n, q = self.robot.n, self.posture.q
        locked, free = report.faults.mask(n), report.faults.free_mask(n)
        J = task_jacobian(self.robot, q, self.task)
        rnea = rnea_change(self.robot, q, self.conditions, locked, free)
        torque = rnea.after + report.after.dot(J)
        torque[locked if free is None else locked | free] = 0.0
        return read_only(torque)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result."""
        found = list(self.posture.warnings)
        matters = self.limits is not None or self.mode is FaultMode.FREE
        if matters and not self.is_weight_known:
            found.append("the URDF has no masses: the weight of the arm is missing")
        moves = matters and self.conditions.moves
        moves |= self.question.inverse == "dynamic"
        found += implausible(self.question, needs_gravity=matters, needs_inertia=moves)
        if self.limits is not None:
            unknown = [self.robot.names[i] for i in np.flatnonzero(~self.limits.is_known)]
            if unknown:
                found.append(f"unknown effort limits are not enforced: {listed(unknown)}")
        return tuple(found)

    @property
    def is_weight_known(self) -> bool:
        """Whether the URDF has masses, or neither gravity nor motion loads the joints."""
        return self.robot.mass > 0.0 or not (self.conditions.gravity.any() or self.conditions.moves)

    def worst_manipulability(self, size: int = 1) -> tuple[float, float]:
        """Return the smallest ρ over the sets of one size, and the bound that holds in any posture.

        Parameters
        ----------
        size :
            Number of failed joints.
        """
        rho = [report.relative_manipulability for report in self.sets if len(report.faults) == size]
        bound = measures.worst_manipulability_bound(self.robot.n, self.task.m, size)
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
    payload: PayloadLike = None,
    limits: LimitsLike = None,
    friction: FrictionLike = None,
    joint_friction: bool = False,
    armature: bool = False,
    inverse: Inverse = "euclidean",
    rank_by: RankBy = "jump",
    direction: ArrayLike | None = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    progress: Progress | None = None,
) -> Census:
    """Analyse every set of up to ``faults`` failed joints in one posture (eq. 12-13).

    Parameters
    ----------
    joint_friction, armature :
        As in `ftforce.analyze`.
    robot, q, force, torque, velocity, acceleration, gravity, payload, friction, inverse :
        As in `ftforce.analyze`.
    task, length, joint_length, axes, posture, rtol, wary :
        As in `ftforce.analyze`.
    faults :
        Size of the largest sets.
    mode :
        ``locked`` or ``free``.
    limits :
        As in `ftforce.analyze`; by default those of the URDF if the ranking needs them, otherwise
        none.
    rank_by :
        ``jump``, or ``capability``: the force that can still be held.
    direction :
        Direction of the capability, in task axes, shape (m,); by default that of the force, or the
        weakest direction of each set if no force is given.
    progress :
        Called after every set.

    Returns
    -------
    :
        The sets, worst first. By jump: not tolerated, then borderline, then tolerated; within each
        by decreasing jump (tolerated sets have none), then by decreasing loss of rank, then by
        increasing margin. By capability: by increasing commanded force, then by increasing held
        force. Sets that these do not tell apart share a rank, `Census.set_ranks`.

    Raises
    ------
    InputError
        An argument is invalid, or there are more than a million sets.

    Examples
    --------
    >>> import ftforce
    >>> result = ftforce.census(ftforce.load_robot("dh5"), force=[80, 50, 10])
    >>> print(result.sets[0].faults, result.sets[0].verdict.value)
    {3} not tolerated
    """
    question = Question.parse(
        robot,
        force=force,
        torque=torque,
        direction=direction,
        velocity=velocity,
        acceleration=acceleration,
        gravity=gravity,
        payload=payload,
        limits=URDF if limits is None and rank_by == "capability" else limits,
        friction=friction,
        joint_friction=joint_friction,
        armature=armature,
        inverse=inverse,
        task=task,
        length=length,
        joint_length=joint_length,
        axes=axes,
        rtol=rtol,
        wary=wary,
    ).placed(q, posture)
    check_progress(progress)
    return census_of(question, AllFaultSets.parse(robot, faults, mode), rank_by, progress)


def census_of(
    question: Question,
    all_sets: AllFaultSets,
    rank_by: RankBy = "jump",
    progress: Progress | None = None,
) -> Census:
    """Return the census of a posture.

    Parameters
    ----------
    question, all_sets :
        What is asked, and of which sets.
    rank_by, progress :
        As in `census`.

    Raises
    ------
    InputError
        The ranking is unknown, or the dynamic inverse needs masses, and the URDF has none.
    """
    check_word("ranking", rank_by, _RANKINGS)
    by_capability = rank_by == "capability"
    if question.direction is not None and not by_capability:
        raise InputError("a direction is that of the capability: give it with rank_by='capability'")
    case = SharedCase.of(question)
    if not question.has_force_to_keep(case.healthy, case.F):
        raise question.nothing_to_keep()
    reports = []
    for done, faults in enumerate(all_sets, start=1):
        reports.append(report_set(case, faults, case.reduce(faults), by_capability=by_capability))
        if progress is not None:
            progress(done, len(all_sets))
    return Census(
        question=question,
        all_sets=all_sets,
        rank_by=rank_by,
        direction=case.direction if by_capability else None,
        before=None if case.F is None else read_only(question.task.unweigh_force(case.F)),
        rank=case.healthy.rank,
        healthy=report_set(case, HEALTHY, case.healthy, by_capability=by_capability),
        sets=tuple(sorted(reports, key=_order(by_capability))),
        joints=_rank_joints(question.robot, reports, by_capability),
    )


def _order(by_capability: bool) -> Callable[[SetReport], tuple[float, ...]]:
    """Return the sort key of fault sets: that of the ranking, then size and joints."""
    key = _by_capability if by_capability else _by_severity
    return lambda report: (*key(report), len(report.faults), *report.faults.joints)


def _by_capability(report: SetReport) -> tuple[float, ...]:
    """Rank by increasing capability; sets with which the arm cannot be held come first."""
    found = report.capability
    assert found is not None
    return _amount_key(found.commanded), _amount_key(found.held)


def _amount_key(amount: float) -> float:
    """Return a force for ranking, to nine digits; without equilibrium, less than any."""
    return -1.0 if math.isnan(amount) else _rounded(amount)


def _rounded(x: float) -> float:
    return float(f"{x:.9g}") if abs(x) > 1e-9 else 0.0


def _by_severity(report: SetReport) -> tuple[float, ...]:
    """Rank worst first; among equal jumps, smaller fault sets first."""
    is_kept = report.verdict is Verdict.TOLERATED
    jump = 0.0 if is_kept else _rounded(report.relative_jump)
    size = len(report.faults) if jump > 0.0 else 0
    worst = (_SEVERITY[report.verdict], report.can_stand_still, -jump, -report.rank_lost, size)
    return *worst, _rounded(report.margin)


def _rank_joints(
    robot: Robot, reports: list[SetReport], by_capability: bool
) -> tuple[JointReport, ...]:
    joints = []
    with_joint: list[list[SetReport]] = [[] for _ in range(robot.n)]
    for report in reports:
        for i in report.faults.joints:
            with_joint[i].append(report)
    for i, own in enumerate(with_joint):
        verdicts = [report.verdict for report in own]
        joints.append(
            JointReport(
                joint=i,
                alone=next(report for report in own if len(report.faults) == 1),
                sets=len(own),
                not_tolerated=verdicts.count(Verdict.NOT_TOLERATED),
                borderline=verdicts.count(Verdict.BORDERLINE),
                falls=sum(not report.can_stand_still for report in own),
                mean_relative_jump=math.fsum(r.relative_jump for r in own) / len(own),
                least_capability=_least(own) if by_capability else None,
            )
        )
    key = _joint_key(by_capability)
    return tuple(sorted(joints, key=lambda joint: (*key(joint), joint.joint)))


def _least(reports: list[SetReport]) -> float:
    """Return the smallest commanded force, or NaN if the arm cannot be held with some set."""
    amounts = [report.capability.commanded for report in reports if report.capability is not None]
    return math.nan if any(map(math.isnan, amounts)) else min(amounts)


def _joint_key(by_capability: bool) -> Callable[[JointReport], tuple[float, ...]]:
    return _by_least_capability if by_capability else _by_criticality


def _by_criticality(joint: JointReport) -> tuple[float, ...]:
    """Rank by the verdicts of the sets with the joint, then their jumps, then it alone."""
    is_kept = not joint.not_tolerated and not joint.borderline
    mean, alone = 0.0 if is_kept else _rounded(joint.mean_relative_jump), joint.alone
    verdicts = (-joint.not_tolerated, -joint.borderline, -joint.falls)
    return *verdicts, -mean, -alone.rank_lost, _rounded(alone.margin)


def _by_least_capability(joint: JointReport) -> tuple[float, ...]:
    """Rank by the capability left when the joint fails alone, then together with others."""
    least = joint.least_capability
    assert least is not None
    return *_by_capability(joint.alone), _amount_key(least)
