"""Evaluate every fault set at every instant of a trajectory, to find the worst time to fail."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.analysis.fault_set import SharedCase, commanded_force, report_set
from ftforce.analysis.limits_files import URDF, choose_limits
from ftforce.analysis.question import HEALTHY, AllFaultSets, AnsweredForAll, Question
from ftforce.analysis.warnings import implausible
from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.verdict import CODES, VERDICTS, Verdict
from ftforce.errors import InputError
from ftforce.robot.kinematics import rotation_vector, tip_pose
from ftforce.robot.posture import Posture
from ftforce.trajectory.certain import certain_cells
from ftforce.trajectory.fault_events import Phase
from ftforce.trajectory.motion import advance
from ftforce.trajectory.reference import Motion
from ftforce.trajectory.start import start_of
from ftforce.trajectory.warnings import (
    force_warnings,
    limit_warnings,
    missing_force,
    noise_warnings,
    off_path,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.core.limits import Limits
    from ftforce.core.task import Axes, Task
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.start import Smooth, Start, Trajectory

MAX_CELLS = 20_000_000
_AT_ONCE = 200_000  # instants times sets times joints, which bounds the memory


@dataclass(frozen=True, slots=True, eq=False)
class WorstInstant:
    """The worst instant of a fault set.

    Attributes
    ----------
    faults :
        The fault set.
    index, time :
        The instant with the worst verdict; ties go to the largest jump, then to the smallest
        margin. Time in s.
    jump, margin, verdict :
        Values at that instant; the jump is ‖ΔF‖, N (N·m for a task of moments), NaN without a
        force.
    capability, capability_time :
        Smallest capability over all instants, N (N·m), and its time, s; infinite if no known limit
        bounds it, NaN if the arm cannot be held.
    not_tolerated :
        Fraction of the instants at which the set is not tolerated.
    """

    faults: FaultSet
    index: int
    time: float
    jump: float
    margin: float
    verdict: Verdict
    capability: float
    capability_time: float
    not_tolerated: float


@dataclass(frozen=True, slots=True, eq=False)
class Timeline(AnsweredForAll):
    """Results of all S fault sets at all N instants of a trajectory.

    Attributes
    ----------
    question, all_sets :
        What was asked, and of which sets. Their parts are attributes too: robot, task, conditions,
        limits (applied to jump and verdict), force, direction, rtol and wary; mode and largest.
    course :
        One-line description of the trajectory.
    start :
        Where the initial posture comes from.
    capability_limits :
        Torque limits applied to the capability.
    t :
        Times, s, shape (N,).
    q :
        Joint positions, shape (N, n).
    sets :
        The fault sets, in order of size.
    jump :
        ‖ΔF‖, N (N·m for a task of moments), shape (N, S); NaN without a force, and where the arm
        cannot be held.
    margin :
        σ_min(K)/σ_max(J), shape (N, S).
    capability :
        Largest force that can be commanded, N (N·m), shape (N, S); infinite if no known limit
        bounds it, NaN where the arm cannot be held.
    warnings, notes :
        Warnings about the result, and what was decided about a recording.
    verdict :
        Index into ``ftforce.core.verdict.VERDICTS``, shape (N, S): 0 tolerated, 1 borderline, 2 not
        tolerated.
    """

    question: Question
    all_sets: AllFaultSets
    course: str
    start: str
    capability_limits: Limits | None
    t: Vector
    q: Matrix
    sets: tuple[FaultSet, ...]
    jump: Matrix
    margin: Matrix
    capability: Matrix
    verdict: NDArray[np.int8]
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def force(self) -> Vector | None:
        """Requested force, N and N·m, in task axes, shape (m,); ``None`` for all forces."""
        return self.question.force

    @property
    def direction(self) -> Vector | None:
        """Direction of the capability, in task axes, shape (m,); ``None`` for the weakest."""
        return self.question.direction

    def worst(self) -> tuple[WorstInstant, ...]:
        """Return the worst instant of each fault set, worst set first."""
        instants = [self._worst_of(column) for column in range(len(self.sets))]
        return tuple(sorted(instants, key=_by_severity))

    def _worst_of(self, column: int) -> WorstInstant:
        jump, margin = self.jump[:, column], self.margin[:, column]
        # Where the arm cannot be held the jump is NaN: worse than any jump.
        size = np.where(np.isnan(jump), np.inf, jump) if self.force is not None else 0.0 * margin
        codes = self.verdict[:, column]
        index = int(np.lexsort((np.round(margin, 9), -np.round(size, 9), -codes))[0])
        capability = self.capability[:, column]
        least = int(np.where(np.isnan(capability), -1.0, capability).argmin())
        return WorstInstant(
            faults=self.sets[column],
            index=index,
            time=float(self.t[index]),
            jump=float(jump[index]),
            margin=float(margin[index]),
            verdict=VERDICTS[int(codes[index])],
            capability=float(capability[least]),
            capability_time=float(self.t[least]),
            not_tolerated=float(np.mean(codes == CODES[Verdict.NOT_TOLERATED])),
        )


def timeline(
    robot: Robot,
    trajectory: Trajectory,
    q: ArrayLike | Posture | None = None,
    *,
    faults: int = 1,
    mode: FaultMode | str = FaultMode.LOCKED,
    force: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    payload: Payload | float | str | tuple[float, ArrayLike] | None = None,
    limits: LimitsLike = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rate: float | None = None,
    speed: float | None = None,
    keep_orientation: bool = False,
    max_gap: float | None = None,
    smooth: Smooth = "auto",
    static: bool = False,
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    progress: Progress | None = None,
) -> Timeline:
    """Evaluate every fault set at every instant of a trajectory.

    Parameters
    ----------
    robot, trajectory, q, posture, rate, speed, keep_orientation, max_gap, smooth, static :
        As in `ftforce.simulate`; the motion is that of the healthy arm.
    faults :
        Size of the largest fault sets.
    mode :
        ``locked`` or ``free``.
    force :
        Force the tool exerts on its environment, N and N·m, in task axes, shape (m,); by default
        all forces are considered.
    direction :
        Direction of the capability, in task axes, shape (m,); by default that of the force, or the
        weakest direction if no force is given.
    limits :
        As in `ftforce.analyze`; by default none for jump and verdict, and those of the URDF for the
        capability.
    gravity, payload, task, length, axes, rtol, wary :
        As in `ftforce.analyze`.
    progress :
        Called with the number of steps completed and their total.

    Raises
    ------
    InputError
        An argument is invalid, or there are too many instants and fault sets.
    TrajectoryError, LimitsError
        A file cannot be read or does not fit the robot.

    Examples
    --------
    >>> import ftforce
    >>> from ftforce.trajectory import Path
    >>> arm = ftforce.load_robot("dh5")
    >>> line = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.05)
    >>> result = ftforce.timeline(arm, line, force=[80, 50, 10], rate=5)
    >>> print(result.worst()[0].faults)
    {3}
    """
    all_sets = AllFaultSets.parse(robot, faults, mode)
    question = Question.parse(
        robot,
        force=force,
        direction=direction,
        gravity=gravity,
        payload=payload,
        limits=limits,
        task=task,
        length=length,
        axes=axes,
        rtol=rtol,
        wary=wary,
    )
    start = start_of(
        robot,
        trajectory,
        q,
        posture,
        rate=rate,
        speed=speed,
        keep_orientation=keep_orientation,
        max_gap=max_gap,
        smooth=smooth,
        static=static,
    )
    bearing = choose_limits(robot, URDF) if limits is None else question.limits
    return timeline_of(question, start, all_sets, bearing, progress)


def timeline_of(
    question: Question,
    start: Start,
    all_sets: AllFaultSets,
    capability_limits: Limits | None,
    progress: Progress | None = None,
) -> Timeline:
    """Return the timeline of a trajectory.

    Parameters
    ----------
    question, all_sets :
        What is asked at every instant, and of which sets.
    start :
        The trajectory.
    capability_limits :
        Torque limits of the capability; ``None`` for none.
    progress :
        Called with the number of steps completed and their total.

    Raises
    ------
    InputError
        There are too many instants and fault sets, or the healthy arm cannot exert the force at any
        instant.
    """
    _check_count(len(start.times), all_sets)
    direction = question.direction_or_that_of(question.F)
    question = replace(question, direction=direction)
    sets, tick = tuple(all_sets), _counted(progress, 2 * len(start.times))
    phase = Phase(0.0, HEALTHY, HEALTHY)
    motion = advance(
        question.robot, start.reference, start.q, start.times, (phase,), tick=tick
    ).motion
    loaded = motion
    if start.is_static:
        loaded = Motion(motion.q, np.zeros_like(motion.v), np.zeros_like(motion.a))
    cells = _cells(question, loaded, sets, capability_limits, tick)
    if question.force is not None and question.force.any() and not cells.exerted.any():
        raise question.nothing_to_keep("at any instant of the trajectory")
    limited = replace(question, limits=capability_limits)
    doubts = implausible(limited, needs_gravity=True, needs_inertia=True)
    return Timeline(
        question=question,
        all_sets=all_sets,
        course=start.words,
        start=start.source,
        capability_limits=capability_limits,
        t=start.times,
        q=read_only(motion.q),
        sets=sets,
        jump=cells.jump,
        margin=cells.margin,
        capability=cells.capability,
        verdict=cells.verdict,
        warnings=(*_warnings(question, start, motion, cells.exerted), *doubts),
        notes=start.notes,
    )


def _counted(progress: Progress | None, total: int) -> Callable[[int], None]:
    done = 0

    def tick(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, total)

    return tick


def _warnings(question: Question, start: Start, motion: Motion, exerted: Matrix) -> Iterator[str]:
    """Yield the warnings; ``exerted`` holds weighted forces of the healthy arm, shape (N, m)."""
    robot, task, t = question.robot, question.task, start.times
    yield from start.warnings
    yield from noise_warnings(question, start, motion)
    moves = bool(motion.v.any() or motion.a.any())
    if robot.mass == 0.0 and (moves or question.conditions.gravity.any()):
        yield "the URDF has no masses: gravity and motion torques of the arm are not included"
    kept = start.reference.orientation
    if start.reference.smoothing is None:  # a recorded motion is its own path
        error, turn = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        for i, (time, q) in enumerate(zip(t.tolist(), motion.q, strict=True)):
            R, x = tip_pose(robot, q)
            error[i] = start.reference.at(time).x - x
            if kept is not None:
                turn[i] = rotation_vector(kept @ R.T)
        yield from off_path(t, np.linalg.norm(error, axis=1), np.linalg.norm(turn, axis=1))
    yield from limit_warnings(robot, motion.q, motion.v)
    if question.force is not None:
        missing = missing_force(question.force, task.unweigh_force(exerted))
        yield from force_warnings(t, task, missing)


class _Cells(NamedTuple):
    """Values of S fault sets at N instants, shape (N, S), and exerted forces, shape (N, m)."""

    exerted: Matrix
    jump: Matrix
    margin: Matrix
    capability: Matrix
    verdict: NDArray[np.int8]


def _cells(
    question: Question,
    motion: Motion,
    sets: tuple[FaultSet, ...],
    capability_limits: Limits | None,
    tick: Callable[[int], None],
) -> _Cells:
    shape = len(motion.q), len(sets)
    jump, margin, capability = (np.full(shape, math.nan) for _ in range(3))
    verdict, exerted = np.zeros(shape, dtype=np.int8), np.zeros((shape[0], question.task.m))
    largest = [
        None if capability_limits is None else capability_limits.largest_torques(faults)
        for faults in sets
    ]
    count = max(_AT_ONCE // (len(sets) * question.robot.n), 1)
    for start in range(0, shape[0], count):
        here = slice(start, start + count)
        part = Motion(*(x[here] for x in motion))
        done = np.zeros((len(part.q), len(sets)), dtype=np.bool_)
        if (found := certain_cells(question, part, sets, capability_limits)) is not None:
            done = found.known
            jump[here], margin[here] = found.jump, found.margin
            capability[here], verdict[here] = found.capability, found.verdict
            exerted[here] = 0.0 if question.F is None else question.F
        for i in np.flatnonzero(~done.all(axis=1)).tolist():
            q, v, a = (x[i] for x in part)
            at = start + i
            case = SharedCase.of(question.at(Posture(q, "along the trajectory"), v, a))
            exerted[at] = 0.0 if case.F is None else case.F
            for j in np.flatnonzero(~done[i]).tolist():
                reduced = case.reduce(sets[j])
                report = report_set(case, sets[j], reduced)
                size = report.jump_norm if question.task.force_rows else report.moment_jump_norm
                jump[at, j] = math.nan if size is None else size
                margin[at, j], verdict[at, j] = report.margin, CODES[report.verdict]
                rnea = case.rnea_after(sets[j])
                capability[at, j] = commanded_force(case, reduced, rnea, largest[j])
        tick(len(part.q))
    return _Cells(*map(read_only, (exerted, jump, margin, capability, verdict)))


def _check_count(instants: int, all_sets: AllFaultSets) -> None:
    if instants * len(all_sets) > MAX_CELLS:
        raise InputError(
            f"{instants:,} instants of {len(all_sets):,} fault sets exceed the maximum of "
            f"{MAX_CELLS:,} cells; ask for a lower rate or smaller sets"
        )


def _by_severity(instant: WorstInstant) -> tuple[float, ...]:
    jump = math.inf if math.isnan(instant.jump) else round(instant.jump, 9)
    worst = (-CODES[instant.verdict], -instant.not_tolerated, -jump, round(instant.margin, 9))
    return *worst, len(instant.faults), *instant.faults.joints
