"""One posture, all fault sets up to a size: which is the worst, which joint is the critical one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from ftforce import metrics
from ftforce.analysis import tip_load
from ftforce.arrays import Svd, Vector, read_only
from ftforce.changes import split_norms
from ftforce.closed_forms import force_jump
from ftforce.display import Displayed
from ftforce.errors import InputError
from ftforce.faults import FaultSet, count_fault_sets, fault_sets
from ftforce.kinematics import task_jacobian
from ftforce.metrics import Verdict
from ftforce.posture import Posture, choose_posture
from ftforce.reduced import RTOL, WARY, check_tolerances, reduce_decomposed
from ftforce.task import Axes, Task

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.robot import Robot

MOST_SETS = 1_000_000  # about a minute and a gigabyte; a sweep keeps no single sets

_SEVERITY = {Verdict.NOT_TOLERATED: 0, Verdict.BORDERLINE: 1, Verdict.TOLERATED: 2}


class Progress(Protocol):
    """Called with how many fault sets are done, of how many."""

    def __call__(self, done: int, total: int, /) -> None:
        """Take note."""


@dataclass(frozen=True, slots=True, eq=False)
class SetReport:
    """What one fault set does.

    Attributes
    ----------
    faults :
        The set.
    after, jump :
        Force still commanded and force jump, N and N·m, shape (m,); ``None`` without a force.
    jump_norm, moment_jump_norm :
        Norms of the jump's forces (N) and moments (N·m); ``None`` where there are none.
    relative_jump :
        ‖ΔF‖/‖F̂‖, weighted; without a force 1 if a direction is lost.
    rank_after, rank_lost :
        Rank of K, and how much less it is than J's.
    sigma_min_after, margin, relative_manipulability :
        Smallest singular value of K; over σ_max(J); ρ = w(K)/w(J), NaN where w(J) = 0.
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
    robot, task, posture :
        What was analysed.
    largest :
        Size of the largest sets.
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
    largest: int
    rtol: float
    wary: float
    requested: Vector | None
    before: Vector | None
    rank: int
    sets: tuple[SetReport, ...]
    joints: tuple[JointReport, ...]

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
    force: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rtol: float = RTOL,
    wary: float = WARY,
    progress: Progress | None = None,
) -> Census:
    """Analyse every set of up to ``faults`` locked joints in one posture (eq. 12-13).

    Parameters
    ----------
    robot, q, force, torque, task, length, axes, posture, rtol, wary :
        As in `ftforce.analyze`.
    faults :
        Size of the largest sets.
    progress :
        Called after every set.

    Returns
    -------
    :
        The sets, worst first: not tolerated, then borderline, then tolerated; the larger jump
        first, and without a jump the smaller margin.

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
    wanted = Task.parse(task, axes, length)
    place = choose_posture(robot, q, posture)
    healthy = Svd(wanted.weigh_jacobian(task_jacobian(robot, place.q, wanted)))
    whole = reduce_decomposed(healthy, FaultSet().mask(robot.n), rtol)
    load = tip_load(robot, whole, wanted, force, torque)
    F = None if load is None else load.F
    total = count_fault_sets(robot.n, faults)
    reports = []
    for done, fault_set in enumerate(fault_sets(robot.n, faults), start=1):
        reports.append(_report(healthy, fault_set, wanted, F, rtol=rtol, wary=wary))
        if progress is not None:
            progress(done, total)
    return Census(
        robot=robot,
        task=wanted,
        posture=place,
        largest=faults,
        rtol=rtol,
        wary=wary,
        requested=None if load is None else load.requested,
        before=None if F is None else read_only(wanted.unweigh_force(F)),
        rank=whole.rank,
        sets=tuple(sorted(reports, key=_badness)),
        joints=_rank_joints(robot, reports),
    )


def _check_size(robot: Robot, faults: int) -> None:
    if isinstance(faults, bool) or not isinstance(faults, int) or not 1 <= faults <= robot.n:
        raise InputError(f"faults must be a number from 1 to {robot.n}, got {faults!r}")
    total = count_fault_sets(robot.n, faults)
    if total > MOST_SETS:
        raise InputError(
            f"{total:,} fault sets of up to {faults} of {robot.n} joints are more than one census "
            f"takes ({MOST_SETS:,}); ask for smaller sets"
        )


def _report(
    healthy: Svd, faults: FaultSet, task: Task, F: Vector | None, *, rtol: float, wary: float
) -> SetReport:
    reduced = reduce_decomposed(healthy, faults.mask(healthy.A.shape[1]), rtol)
    rank_lost = reduced.rank - reduced.rank_after
    after = jump = linear = angular = None
    relative = float(rank_lost > 0)
    if F is not None:
        change = force_jump(reduced, F)
        after = read_only(task.unweigh_force(change.F_after))
        jump = read_only(task.unweigh_force(change.jump))
        linear, angular = split_norms(task, jump)
        size = math.sqrt(F.dot(F))
        relative = change.jump_norm / size if size > 0.0 else 0.0
    return SetReport(
        faults=faults,
        after=after,
        jump=jump,
        jump_norm=linear,
        moment_jump_norm=angular,
        relative_jump=relative,
        rank_after=reduced.rank_after,
        rank_lost=rank_lost,
        sigma_min_after=reduced.damaged.s[-1],
        margin=metrics.margin(reduced),
        relative_manipulability=metrics.relative_manipulability(reduced),
        verdict=metrics.verdict(reduced, F, wary),
    )


def _badness(report: SetReport) -> tuple[float, ...]:
    """Sort key: worst first; of equal jumps the one that takes fewer faults."""
    jump = round(report.relative_jump, 9)
    size = len(report.faults) if jump > 0.0 else 0
    return (
        _SEVERITY[report.verdict], -jump, -report.rank_lost, size, round(report.margin, 9),
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
