"""Evaluate every fault set at every instant of a trajectory, to find the worst time to fail."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.conditions import Conditions, rnea_change, without_rounding
from ftforce.analysis.fault_set import SharedCase, commanded_force, report_set
from ftforce.analysis.limits_files import URDF, choose_limits
from ftforce.analysis.question import check_size, checked_mode, direction_or_force
from ftforce.core.arrays import Matrix, Vector, as_vector, read_only
from ftforce.core.display import Displayed
from ftforce.core.faults import FaultMode, FaultSet, count_fault_sets, fault_sets
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, check_tolerances, reduce_decomposed
from ftforce.core.remap import supported_force
from ftforce.core.svd import Svd
from ftforce.core.task import Axes, Task
from ftforce.core.verdict import CODES, VERDICTS, Verdict
from ftforce.errors import InputError
from ftforce.robot.kinematics import rotation_vector, task_jacobian, tip_pose
from ftforce.robot.posture import Posture
from ftforce.trajectory.fault_events import Phase
from ftforce.trajectory.motion import advance
from ftforce.trajectory.start import start_of
from ftforce.trajectory.warnings import force_warnings, limit_warnings, missing_force, off_path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.core.limits import Limits
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.reference import Motion
    from ftforce.trajectory.start import Start, Trajectory

MOST_CELLS = 20_000_000


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
class Timeline(Displayed):
    """Results of all S fault sets at all N instants of a trajectory.

    Attributes
    ----------
    robot, task, conditions :
        The analysed arm, task and conditions.
    course :
        One-line description of the trajectory.
    start :
        Where the initial posture comes from.
    mode :
        Fault mode of the joints.
    largest :
        Size of the largest fault sets.
    limits :
        Torque limits applied to jump and verdict; ``None`` if none.
    capability_limits :
        Torque limits applied to the capability.
    force, direction :
        Requested force, and direction of the capability, in task axes, shape (m,); ``None`` for all
        forces, and for the weakest direction.
    rtol, wary :
        Tolerances.
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
    warnings :
        Warnings about the result.
    verdict :
        Index into ``ftforce.core.verdict.VERDICTS``, shape (N, S): 0 tolerated, 1 borderline, 2 not
        tolerated.
    """

    robot: Robot
    task: Task
    conditions: Conditions
    course: str
    start: str
    mode: FaultMode
    largest: int
    limits: Limits | None
    capability_limits: Limits | None
    force: Vector | None
    direction: Vector | None
    rtol: float
    wary: float
    t: Vector
    q: Matrix
    sets: tuple[FaultSet, ...]
    jump: Matrix
    margin: Matrix
    capability: Matrix
    verdict: NDArray[np.int8]
    warnings: tuple[str, ...] = ()

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
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    progress: Progress | None = None,
) -> Timeline:
    """Evaluate every fault set at every instant of a trajectory.

    Parameters
    ----------
    robot, trajectory, q, posture, rate, speed, keep_orientation, max_gap :
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
    check_tolerances(rtol, wary)
    check_size(robot, faults)
    how = checked_mode(mode)
    wanted = Task.parse(task, axes, length)
    conditions = Conditions.of(robot, gravity=gravity, payload=payload)
    asked = None
    if force is not None:
        names = ", ".join(wanted.components)
        asked = as_vector(force, wanted.m, "force", f"{names} of the task '{wanted}'")
    F = None if asked is None else wanted.weigh_force(asked)
    counted = choose_limits(robot, limits)
    bearing = choose_limits(robot, URDF) if limits is None else counted
    start = start_of(
        robot,
        trajectory,
        q,
        posture,
        rate=rate,
        speed=speed,
        keep_orientation=keep_orientation,
        max_gap=max_gap,
    )
    sets = tuple(fault_sets(robot.n, faults, how))
    _check_count(len(start.times), robot, faults)
    ray = direction_or_force(wanted, direction, F)
    case = _Case(robot, wanted, conditions, counted, bearing, F, ray, rtol, wary)
    tick = _counted(progress, 2 * len(start.times))
    phase = Phase(0.0, FaultSet(), FaultSet())
    motion = advance(robot, start.reference, start.q, start.times, (phase,), tick=tick).motion
    exerted, jump, margin, capability, verdict = _cells(case, motion, sets, tick)
    return Timeline(
        robot=robot,
        task=wanted,
        conditions=conditions,
        course=start.words,
        start=start.source,
        mode=how,
        largest=faults,
        limits=counted,
        capability_limits=bearing,
        force=asked,
        direction=ray,
        rtol=rtol,
        wary=wary,
        t=start.times,
        q=read_only(motion.q),
        sets=sets,
        jump=jump,
        margin=margin,
        capability=capability,
        verdict=verdict,
        warnings=tuple(_doubts(case, start, motion, exerted)),
    )


def _counted(progress: Progress | None, total: int) -> Callable[[int], None]:
    done = 0

    def tick(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, total)

    return tick


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """Data shared by all instants."""

    robot: Robot
    task: Task
    conditions: Conditions
    limits: Limits | None
    bearing: Limits | None
    F: Vector | None
    ray: Vector | None
    rtol: float
    wary: float

    def at(self, q: Vector, v: Vector, a: Vector) -> SharedCase:
        """Return the data shared by all fault sets at an instant."""
        robot, nothing = self.robot, FaultSet().mask(self.robot.n)
        moving = self.conditions._replace(velocity=v, acceleration=a)
        healthy = Svd(self.task.weigh_jacobian(task_jacobian(robot, q, self.task)))
        whole = reduce_decomposed(healthy, nothing, self.rtol)
        F = None
        if self.F is not None:
            F = supported_force(whole, self.F)
            F = without_rounding(F, F, self.F)
        place, rnea = Posture(q, "along the trajectory"), rnea_change(robot, q, moving, nothing)
        asked = (F, False, self.ray, self.rtol, self.wary)
        return SharedCase(
            robot, self.task, place, moving, self.limits, healthy, whole, rnea, *asked
        )


def _doubts(case: _Case, start: Start, motion: Motion, exerted: Matrix) -> Iterator[str]:
    """Yield the warnings; ``exerted`` holds weighted forces of the healthy arm, shape (N, m)."""
    robot, task, t = case.robot, case.task, start.times
    yield from start.warnings
    if robot.mass == 0.0 and case.conditions.gravity.any():
        yield "the URDF has no masses: weight and motion of the arm are missing"
    kept = start.reference.orientation
    error, turn = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for i, (time, q) in enumerate(zip(t.tolist(), motion.q, strict=True)):
        R, x = tip_pose(robot, q)
        error[i] = start.reference.at(time).x - x
        if kept is not None:
            turn[i] = rotation_vector(kept @ R.T)
    yield from off_path(t, np.linalg.norm(error, axis=1), np.linalg.norm(turn, axis=1))
    yield from limit_warnings(robot, motion.q, motion.v)
    if case.F is not None:
        missing = missing_force(task.unweigh_force(case.F), task.unweigh_force(exerted))
        yield from force_warnings(t, task, missing)


def _cells(
    case: _Case, motion: Motion, sets: tuple[FaultSet, ...], tick: Callable[[int], None]
) -> tuple[Matrix, Matrix, Matrix, Matrix, NDArray[np.int8]]:
    """Return exerted forces, jumps, margins, capabilities and verdicts of all sets over time."""
    robot, count = case.robot, len(motion.q)
    jump, margin, capability = (np.full((count, len(sets)), math.nan) for _ in range(3))
    verdict = np.zeros((count, len(sets)), dtype=np.int8)
    exerted = np.zeros((count, case.task.m))
    masks = [
        (
            faults.mask(robot.n),
            faults.free_mask(robot.n),
            None if case.bearing is None else case.bearing.largest_torques(faults),
        )
        for faults in sets
    ]
    for i in range(count):
        here = case.at(motion.q[i], motion.v[i], motion.a[i])
        exerted[i] = 0.0 if here.F is None else here.F
        for j, (faults, (locked, free, largest)) in enumerate(zip(sets, masks, strict=True)):
            report = report_set(here, faults)
            size = report.jump_norm if case.task.force_rows else report.moment_jump_norm
            jump[i, j] = math.nan if size is None else size
            margin[i, j] = report.margin
            verdict[i, j] = CODES[report.verdict]
            reduced = reduce_decomposed(here.healthy, locked, case.rtol, free)
            rnea = here.rnea_after(faults)
            capability[i, j] = commanded_force(here, reduced, rnea, largest)
        tick(1)
    jump, margin, capability = map(read_only, (jump, margin, capability))
    return exerted, jump, margin, capability, read_only(verdict)


def _check_count(instants: int, robot: Robot, faults: int) -> None:
    cells = instants * count_fault_sets(robot.n, faults)
    if cells > MOST_CELLS:
        raise InputError(
            f"{instants:,} instants of {count_fault_sets(robot.n, faults):,} fault sets are more "
            f"than {MOST_CELLS:,} in all; ask for a lower rate or smaller sets"
        )


def _by_severity(instant: WorstInstant) -> tuple[float, ...]:
    jump = math.inf if math.isnan(instant.jump) else round(instant.jump, 9)
    worst = (-CODES[instant.verdict], -instant.not_tolerated, -jump, round(instant.margin, 9))
    return *worst, len(instant.faults), *instant.faults.joints
