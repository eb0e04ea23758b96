"""Evaluate every fault set at every instant of a trajectory, to find the worst time to fail."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.analysis.fault_set import SharedCase, commanded_and_held, report_set
from ftforce.analysis.limits_files import URDF, choose_limits
from ftforce.analysis.question import HEALTHY, AllFaultSets, AnsweredForAll, Question, counted
from ftforce.analysis.warnings import implausible
from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.ranks import Rank, ranks_of
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.verdict import CODES, VERDICTS, Verdict
from ftforce.errors import InputError, listed
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

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.core.limits import Limits
    from ftforce.core.task import Axes, Task
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.start import Smooth, Start, Trajectory

_MAX_CELLS = 20_000_000
_AT_ONCE = 200_000  # instants times sets times joints, which bounds the memory


@dataclass(frozen=True, slots=True, eq=False)
class WorstInstant:
    """The worst instant of a fault set.

    Attributes
    ----------
    faults :
        The fault set; empty for the healthy arm.
    index, time :
        The instant with the worst verdict; ties go to the largest jump, then to the smallest
        margin. Time in s.
    jump, margin, verdict :
        Values at that instant; the jump is ‖ΔF‖, N (N·m for a task of moments), NaN without a
        force.
    kept :
        Share of the force that is still exerted along it at that instant, F̂ᵀF'/F̂ᵀF̂; NaN without a
        force, or if the arm cannot be held.
    capability, capability_time :
        Smallest commanded capability over all instants, N (N·m), and its time, s; infinite if no
        known limit bounds it, NaN if the arm cannot be held.
    capability_kept :
        The capability over that of the healthy arm at the same time; NaN if unknown.
    held, held_time :
        Smallest held capability over all instants, likewise.
    not_tolerated :
        Fraction of the instants at which the set is not tolerated.
    """

    faults: FaultSet
    index: int
    time: float
    jump: float
    margin: float
    verdict: Verdict
    kept: float
    capability: float
    capability_time: float
    capability_kept: float
    held: float
    held_time: float
    not_tolerated: float


class OverTime(NamedTuple):
    """A fault set, or the healthy arm, over time: shape (N,) each, as the arrays of `Timeline`."""

    jump: Vector
    margin: Vector
    capability: Vector
    held: Vector
    verdict: NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
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
    held :
        Largest force that motors and brakes can hold, likewise.
    kept :
        Share of the force that each set keeps at its worst instant, shape (S + 1,), the healthy arm
        last; see `WorstInstant`.
    healthy :
        The healthy arm over time.
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
    held: Matrix
    verdict: NDArray[np.int8]
    kept: Vector
    healthy: OverTime
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
        instants = [
            self._worst_of(faults, self._values(column), column)
            for column, faults in enumerate(self.sets)
        ]
        return tuple(sorted(instants, key=lambda one: (*_by_severity(one), *_by_size(one))))

    def _values(self, column: int) -> OverTime:
        jump, margin = self.jump[:, column], self.margin[:, column]
        capability, held = self.capability[:, column], self.held[:, column]
        return OverTime(jump, margin, capability, held, self.verdict[:, column])

    def ranks(self) -> tuple[Rank, ...]:
        """Return the ranks of the worst instants, in their order; ties share one."""
        return ranks_of(map(_by_severity, self.worst()))

    @property
    def healthy_worst(self) -> WorstInstant:
        """The worst instant of the healthy arm."""
        return self._worst_of(HEALTHY, self.healthy, -1)

    def _worst_of(self, faults: FaultSet, values: OverTime, column: int) -> WorstInstant:
        index, codes = _worst_index(values, self.force is not None), values.verdict
        capability, held = values.capability, values.held
        least, least_held = (
            int(np.where(np.isnan(x), -1.0, x).argmin()) for x in (capability, held)
        )
        before = self.healthy.capability[least]
        return WorstInstant(
            faults=faults,
            index=index,
            time=float(self.t[index]),
            jump=float(values.jump[index]),
            margin=float(values.margin[index]),
            verdict=VERDICTS[int(codes[index])],
            kept=float(self.kept[column]),
            capability=float(capability[least]),
            capability_time=float(self.t[least]),
            capability_kept=float(share_of(capability[least], before)),
            held=float(held[least_held]),
            held_time=float(self.t[least_held]),
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
    payload: PayloadLike = None,
    limits: LimitsLike = None,
    friction: FrictionLike = None,
    joint_friction: bool = False,
    armature: bool = False,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rate: float | None = None,
    speed: float | None = None,
    keep_orientation: bool = False,
    max_gap: float | None = None,
    topic: str | None = None,
    smooth: Smooth = "auto",
    static: bool = False,
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    progress: Progress | None = None,
) -> Timeline:
    """Evaluate every fault set at every instant of a trajectory.

    Parameters
    ----------
    robot, trajectory, q, posture, rate, speed, keep_orientation, max_gap, topic, smooth, static :
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
    joint_friction, armature :
        As in `ftforce.analyze`.
    gravity, payload, friction, task, length, joint_length, axes, rtol, wary :
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
        friction=friction,
        joint_friction=joint_friction,
        armature=armature,
        task=task,
        length=length,
        joint_length=joint_length,
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
        topic=topic,
        smooth=smooth,
        static=static,
        problem=question.problem_in,
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
    sets, tick = tuple(all_sets), counted(progress, 2 * len(start.times))
    phase = Phase(0.0, HEALTHY, HEALTHY)
    motion = advance(
        question.robot,
        start.reference,
        start.q,
        start.times,
        (phase,),
        scale=question.scale,
        tick=tick,
    ).motion
    loaded = motion
    if start.is_static:
        loaded = Motion(motion.q, np.zeros_like(motion.v), np.zeros_like(motion.a))
    cells = _cells(question, loaded, (*sets, HEALTHY), capability_limits, tick)
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
        jump=cells.jump[:, :-1],
        margin=cells.margin[:, :-1],
        capability=cells.capability[:, :-1],
        held=cells.held[:, :-1],
        verdict=cells.verdict[:, :-1],
        kept=_kept(question, loaded, (*sets, HEALTHY), cells),
        healthy=cells.of(-1),
        warnings=(
            *_warnings(question, start, motion, cells.exerted),
            *_unknown_limits(question.robot, capability_limits),
            *doubts,
        ),
        notes=start.notes,
    )


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
    held: Matrix
    verdict: NDArray[np.int8]

    def of(self, column: int) -> OverTime:
        """Return the values of one fault set."""
        jump, margin, capability, held = (x[:, column] for x in self[1:5])
        return OverTime(jump, margin, capability, held, self.verdict[:, column])


def share_of(after: ArrayLike, before: ArrayLike) -> Matrix:
    """Return the capability after a fault over that before it; NaN where it is unknown.

    Parameters
    ----------
    after, before :
        Capabilities, N (N·m), of shapes that broadcast.
    """
    after, before = np.asarray(after, dtype=float), np.asarray(before, dtype=float)
    known = np.isfinite(after) & np.isfinite(before) & (before > 0.0)
    return read_only(np.where(known, after, np.nan) / np.where(known, before, 1.0))


def _worst_index(values: OverTime, forced: bool) -> int:
    """Return the worst instant: by verdict, then jump, then margin.

    Parameters
    ----------
    values :
        Values of one fault set.
    forced :
        Whether a force was requested.
    """
    jump, margin = values.jump, values.margin
    # Where the arm cannot be held the jump is NaN: worse than any jump.
    size = np.where(np.isnan(jump), np.inf, jump) if forced else 0.0 * margin
    size = np.where(values.verdict == CODES[Verdict.TOLERATED], 0.0, size)
    order = np.lexsort((np.round(margin, 9), -np.round(size, 9), -values.verdict))
    return int(order[0])


def _kept(question: Question, motion: Motion, sets: tuple[FaultSet, ...], cells: _Cells) -> Vector:
    """Return the share of the force that each set keeps at its worst instant; NaN for none."""
    kept = np.full(len(sets), math.nan)
    for j, faults in enumerate(sets if question.force is not None else ()):
        i = _worst_index(cells.of(j), forced=True)
        at = question.at(Posture(motion.q[i], "along the trajectory"), motion.v[i], motion.a[i])
        case = SharedCase.of(at)
        found = report_set(case, faults, case.reduce(faults)).kept
        kept[j] = math.nan if found is None else found
    return read_only(kept)


def _unknown_limits(robot: Robot, limits: Limits | None) -> Iterator[str]:
    unknown = [] if limits is None else np.flatnonzero(~limits.is_known).tolist()
    if unknown:
        names = listed([robot.names[i] for i in unknown])
        yield f"unknown effort limits are not enforced: {names}"


def _cells(
    question: Question,
    motion: Motion,
    sets: tuple[FaultSet, ...],
    capability_limits: Limits | None,
    tick: Callable[[int], None],
) -> _Cells:
    shape = len(motion.q), len(sets)
    jump, margin, capability, held = (np.full(shape, math.nan) for _ in range(4))
    verdict, exerted = np.zeros(shape, dtype=np.int8), np.zeros((shape[0], question.task.m))
    has_line = capability_limits is not None and capability_limits.line is not None
    largest = _largest(question, sets, capability_limits)
    count = max(_AT_ONCE // (len(sets) * question.robot.n), 1)
    for start in range(0, shape[0], count):
        here = slice(start, start + count)
        part = Motion(*(x[here] for x in motion))
        done = np.zeros((len(part.q), len(sets)), dtype=np.bool_)
        if (found := certain_cells(question, part, sets, capability_limits)) is not None:
            done = found.known
            jump[here], margin[here] = found.jump, found.margin
            capability[here], held[here] = found.capability, found.held
            verdict[here] = found.verdict
            exerted[here] = 0.0 if question.F is None else question.F
        for i in np.flatnonzero(~done.all(axis=1)).tolist():
            q, v, a = (x[i] for x in part)
            at = start + i
            case = SharedCase.of(question.at(Posture(q, "along the trajectory"), v, a))
            exerted[at] = 0.0 if case.F is None else case.F
            if has_line:  # other limits at every speed
                largest = _largest(case.question, sets, capability_limits)
            for j in np.flatnonzero(~done[i]).tolist():
                reduced = case.reduce(sets[j])
                report = report_set(case, sets[j], reduced)
                size = report.jump_norm if question.task.force_rows else report.moment_jump_norm
                jump[at, j] = math.nan if size is None else size
                margin[at, j], verdict[at, j] = report.margin, CODES[report.verdict]
                rnea = case.rnea_after(sets[j])
                both = commanded_and_held(case, reduced, rnea, largest[j])
                capability[at, j], held[at, j] = both
        tick(len(part.q))
    return _Cells(*map(read_only, (exerted, jump, margin, capability, held, verdict)))


def _largest(
    question: Question, sets: Iterable[FaultSet], limits: Limits | None
) -> list[Vector | None]:
    """Return the weighted limits of the capability with each set, at the question's velocity."""
    return [None if limits is None else question.largest_torques(one, limits) for one in sets]


def _check_count(instants: int, all_sets: AllFaultSets) -> None:
    if instants * len(all_sets) > _MAX_CELLS:
        raise InputError(
            f"{instants:,} instants of {len(all_sets):,} fault sets exceed the maximum of "
            f"{_MAX_CELLS:,} cells; ask for a lower rate or smaller sets"
        )


def _by_severity(instant: WorstInstant) -> tuple[float, ...]:
    """Rank worst first; a tolerated set has no jump."""
    jump = math.inf if math.isnan(instant.jump) else round(instant.jump, 9)
    jump = 0.0 if instant.verdict is Verdict.TOLERATED else jump
    return -CODES[instant.verdict], -instant.not_tolerated, -jump, round(instant.margin, 9)


def _by_size(instant: WorstInstant) -> tuple[int, ...]:
    return len(instant.faults), *instant.faults.joints
