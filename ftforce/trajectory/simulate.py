"""Simulate an arm along a trajectory while joints fail: healthy, without and with the remap."""

from __future__ import annotations

import math
import os
import warnings
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.analysis.conditions import known_mass_matrix
from ftforce.analysis.fault_set import SharedCase, report_set
from ftforce.analysis.limits_files import NONE, URDF
from ftforce.analysis.question import Question, counted
from ftforce.core.arrays import is_number, read_only
from ftforce.core.changes import change_of_velocity, impact_of_lock
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, reduce
from ftforce.core.task import Task
from ftforce.core.verdict import VERDICTS
from ftforce.errors import InputError
from ftforce.io.text import file_digest
from ftforce.robot.dynamics import numbers_of
from ftforce.robot.kinematics import task_jacobian
from ftforce.robot.posture import Posture
from ftforce.trajectory.evaluation import TipPath, run_of
from ftforce.trajectory.fault_events import Events, FaultEvent, Phase, joined, phases, read_events
from ftforce.trajectory.history import (
    QUANTITIES,
    EventReport,
    History,
    JointInfo,
    Run,
    Setting,
    width,
)
from ftforce.trajectory.motion import State, advance
from ftforce.trajectory.start import Start, start_of
from ftforce.trajectory.warnings import history_warnings, noise_warnings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.core.limits import Limits
    from ftforce.core.task import Axes
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.start import Smooth, Trajectory

_LINEAR = Task(axes="world")  # linear tip velocity, in root axes
NEVER = math.inf
_LARGE = 1e9  # bytes of memory: histories that take more are announced


def simulate(
    robot: Robot,
    trajectory: Trajectory,
    q: ArrayLike | Posture | None = None,
    *,
    force: ArrayLike,
    faults: Events = (),
    delay: float = 0.0,
    remap: bool = True,
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
) -> History:
    """Move an arm along a trajectory while its tip exerts a force and joints fail.

    Parameters
    ----------
    robot :
        The arm.
    trajectory :
        `ftforce.trajectory.Path`, `ftforce.trajectory.Recording`, or a CSV file with ``t`` and
        joint positions, or with waypoints ``x,y,z``.
    q, posture :
        Initial guess for the posture at the start of a path, as in `ftforce.analyze`.
    force :
        Force the tool exerts on its environment, N and N·m, in task axes, shape (m,); zeros for
        free motion.
    faults :
        Failing joints and fault times, s: ``"3@50"``, ``"3,4@50"``, ``"free:2@10"``,
        ``"weak:3:0.5@5"``, or a list of these or of `ftforce.trajectory.FaultEvent`.
    delay :
        Time from a fault until the remap takes effect, s.
    remap :
        Whether the controller applies the remap at all.
    joint_friction, armature :
        As in `ftforce.analyze`.
    gravity, payload, limits, friction, task, length, joint_length, axes, rtol, wary :
        As in `ftforce.analyze`.
    rate :
        Samples per second; by default 100 along a path, or the recording's own times.
    speed, keep_orientation :
        Largest speed, m/s, and whether the tip keeps its orientation; for waypoints from a file.
    topic :
        For a bag: the topic of the motion; by default the only one that has the joints.
    max_gap :
        Longest time between two samples of a recording from a file, s; by default ten times the
        median step.
    smooth :
        How a recorded motion is smoothed: ``auto`` by splines whose knots follow from the noise
        found in it, a number by splines with knots that far apart, s; ``none`` interpolates it.
    static :
        Whether only the weight loads the arm, without the torques of velocities and accelerations.
    progress :
        Called with the number of instants completed and their total.

    Returns
    -------
    :
        The histories of the healthy arm, without the remap and with it.

    Raises
    ------
    InputError
        An argument is invalid; the message says what is expected.
    TrajectoryError, LimitsError
        A file cannot be read or does not fit the robot.
    MemoryError
        The machine has less memory than the history takes: about 750 B for each run and instant of
        an arm with seven joints.

    Examples
    --------
    >>> import ftforce
    >>> from ftforce.trajectory import Path
    >>> arm = ftforce.load_robot("dh5")
    >>> line = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.05)
    >>> history = ftforce.simulate(arm, line, force=[80, 50, 10], faults="3@2")
    >>> history.answer.verdicts[-1].value
    'tolerated'
    """
    endless = isinstance(delay, float) and math.isinf(delay)
    if not (endless or is_number(delay)) or delay < 0.0:
        raise InputError(f"the delay must be 0 s or more, got {delay!r}")
    if delay and not remap:
        raise InputError("a delay is until the remap acts; leave it out if it never does")
    events = read_events(robot, faults)
    if limits is None and any(event.faults.in_mode(FaultMode.WEAK) for event in events):
        limits = URDF  # even if the joint locks later
    question = Question.parse(
        robot,
        force=force,
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
    if question.force is None:
        raise InputError("the force is missing; e.g. force=[80, 50, 10], zeros for free motion")
    return history_of(question, start, events, float(delay) if remap else NEVER, progress)


def history_of(
    question: Question,
    start: Start,
    events: tuple[FaultEvent, ...],
    delay: float,
    progress: Progress | None = None,
) -> History:
    """Return the history of a motion with faults.

    Parameters
    ----------
    question :
        What is asked at every instant; it has a force.
    start, events :
        The trajectory, and the faults in the order of their times.
    delay :
        Time from a fault until the remap takes effect, s; infinite if it never does.
    progress :
        Called with the number of instants completed and their total.

    Raises
    ------
    InputError
        A fault comes after the end of the trajectory, or the healthy arm cannot exert the force at
        any instant of it.
    MemoryError
        The machine has less memory than the history takes.
    """
    _check_times(events, start)
    _check_memory(question, len(start.times), 3 if delay < NEVER else 2)
    # An instant of a run counts for its motion and its evaluation.
    tick = counted(progress, 2 * len(start.times) * (3 if delay < NEVER else 2))
    scene = _Scene(question, start, events, _tip_path(start), tick)
    healthy, unremapped, remapped, arrivals = _runs(scene, delay)
    if _has_nothing_to_keep(question, healthy):
        raise question.nothing_to_keep("at any instant of the trajectory")
    reports = tuple(
        _event_report(scene, event, arrivals.get(event.time), healthy) for event in events
    )
    setting = _setting(scene, reports, delay)
    history = History(setting, start.times, scene.path.x, healthy, unremapped, remapped)
    if delay == 0.0:  # keep the fault reports consistent with the samples
        reports = tuple(_as_sampled(history, event) for event in reports)
        history = replace(history, setting=replace(history.setting, events=reports))
    found = history_warnings(question, joined(events), history, is_static=start.is_static)
    noisy = noise_warnings(question, start, healthy)
    said = (*start.warnings, *noisy, *found)
    return replace(history, setting=replace(history.setting, warnings=said))


def _has_nothing_to_keep(question: Question, healthy: Run) -> bool:
    """Return whether the healthy arm exerts none of the force at any instant (theory §2.6)."""
    assert question.force is not None
    # Where the arm cannot be held the force is NaN, which is not zero.
    return bool(question.force.any()) and not (healthy.force + healthy.jump).any()


class _Scene(NamedTuple):
    """Data shared by the runs; ``path`` holds the reference position and velocity of the tip."""

    question: Question
    start: Start
    events: tuple[FaultEvent, ...]
    path: TipPath
    tick: Callable[[int], None]


def _runs(scene: _Scene, delay: float) -> tuple[Run, Run, Run | None, Mapping[float, State]]:
    """Return the three runs, and the states just before the faults in the last of them."""
    question, start, events, path, tick = scene
    last = float(start.times[-1])
    never, later = phases(events, NEVER), phases(events, delay)
    later = tuple(phase for phase in later if phase.start <= last)
    stops = sorted({phase.start for phase in (*never, *later)})
    whole = tuple(Phase(stop, FaultSet(), FaultSet()) for stop in stops)
    follow = partial(
        advance,
        question.robot,
        start.reference,
        start.q,
        start.times,
        scale=question.scale,
        tick=tick,
    )
    evaluate = partial(
        run_of,
        question,
        reference=path,
        times=start.times,
        tick=tick,
        is_static=start.is_static,
    )
    planned = follow(whole)
    healthy = evaluate(planned.motion, phases=whole)
    without_remap = follow(never, planned=planned)
    unremapped = evaluate(without_remap.motion, phases=never, same=healthy)
    if math.isinf(delay):
        return healthy, unremapped, None, without_remap.arrivals
    with_remap = follow(later, planned=planned)
    remapped = evaluate(with_remap.motion, phases=later, same=healthy)
    return healthy, unremapped, remapped, with_remap.arrivals


def _tip_path(start: Start) -> TipPath:
    x, x_dot = map(read_only, start.reference.tip(start.times))
    return TipPath(x, x_dot, start.reference.orientation)


def _check_times(events: Sequence[FaultEvent], start: Start) -> None:
    last = float(start.times[-1])
    for event in events:
        if event.time > last:
            raise InputError(
                f"the fault at {event.time:g} s comes after the end of the trajectory, {last:g} s"
            )


def _check_memory(question: Question, instants: int, runs: int) -> None:
    """Say how much memory a long history takes, before the work begins.

    Raises
    ------
    MemoryError
        The machine has less.
    """
    n, m = question.robot.n, question.task.m
    size = 8 * instants * runs * sum(width(name, n, m) or 1 for name in QUANTITIES)
    words = (
        f"the history of {instants:,} instants takes about {size / 1e9:.1f} GB of memory; a lower "
        "rate (--rate) takes less"
    )
    if size > _memory():
        raise MemoryError(words)
    if size > _LARGE:
        warnings.warn(words, stacklevel=2)


def _memory(control_groups: Path = Path("/sys/fs/cgroup")) -> float:
    """Return the memory of the machine or the container, bytes; infinite where it is not told."""
    sizes = [math.inf]
    with suppress(AttributeError, OSError, ValueError):
        sizes.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    for name in ("memory.max", "memory/memory.limit_in_bytes"):  # of versions 2 and 1
        with suppress(OSError, ValueError):  # "max" is no limit
            sizes.append(float((control_groups / name).read_text()))
    return min(sizes)


def _event_report(
    scene: _Scene, event: FaultEvent, arrival: State | None, healthy: Run
) -> EventReport:
    """Return the report of a fault; without an arrival it occurs at the first sample."""
    robot, task = scene.question.robot, scene.question.task
    state = arrival or State(healthy.q[0], healthy.v[0], healthy.a[0])
    so_far = joined([other for other in scene.events if other.time <= event.time])
    impact, velocity = _velocity_jumps(scene.question, state, so_far)
    place = Posture(state.q, "along the trajectory")
    still = robot.at_rest
    v, a = (still, still) if scene.start.is_static else (state.v, state.a)
    case = SharedCase.of(scene.question.at(place, v, a))
    found = report_set(case, so_far, case.reduce(so_far))
    force_jump = found.jump_norm if task.force_rows else found.moment_jump_norm
    return EventReport(
        time=event.time,
        faults=_in_words(robot, event.faults),
        all_faults=_in_words(robot, so_far),
        impact_jump=impact,
        velocity_jump=velocity,
        force_jump=force_jump,
        verdict=found.verdict,
    )


def _as_sampled(history: History, event: EventReport) -> EventReport:
    """Return the report with the force jump and verdict of the first sample with the fault.

    The original values belong to the state just before it. Accelerations change with the fault, and
    with them the force that a free-swinging joint leaves.
    """
    run = history.answer
    i = int(np.searchsorted(history.t, event.time))
    jump = float(history.jump_norm(run)[i])
    known = None if math.isnan(jump) else jump
    return replace(event, force_jump=known, verdict=VERDICTS[run.verdict[i]])


def _velocity_jumps(
    question: Question, state: State, faults: FaultSet
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the tip velocity jumps at impact and after the remap, in root axes."""
    robot = question.robot
    locked = faults.mask(robot.n)
    if not locked.any():
        return (), ()
    J = read_only(task_jacobian(robot, state.q, _LINEAR))
    weighted, v = question.scale.weigh_jacobian(J), question.scale.weigh_velocity(state.v)
    free = question.free_joints(faults)
    reduced = reduce(read_only(weighted), locked, question.rtol, free)
    remapped = tuple(change_of_velocity(reduced, _LINEAR, v).jump.tolist())
    M = known_mass_matrix(robot, state.q, question.conditions)
    if M is None:
        return (), remapped
    return tuple(impact_of_lock(reduced, _LINEAR, J, M, state.v).jump.tolist()), remapped


def _in_words(robot: Robot, faults: FaultSet) -> str:
    return ", ".join(f"{f.joint + 1} {robot.names[f.joint]} {f}" for f in faults.faults)


def _setting(scene: _Scene, reports: tuple[EventReport, ...], delay: float) -> Setting:
    question, start = scene.question, scene.start
    robot, conditions, limits = question.robot, question.conditions, question.limits
    assert question.force is not None
    return Setting(
        robot=robot.name,
        robot_sha256=file_digest(robot.path),
        base=robot.base,
        tip=robot.tip,
        tip_source=robot.tip_source,
        other_tips=dict(robot.other_tips),
        joints=tuple(JointInfo(joint.name, joint.type) for joint in robot.joints),
        task=question.task,
        force=tuple(question.force.tolist()),
        course=start.words,
        start=start.source,
        events=reports,
        delay=delay,
        limits=NONE if limits is None else limits.source,
        effort=tuple((robot.effort if limits is None else limits.motor_bounds()[1]).tolist()),
        effort_lower=() if limits is None else _lower_limits(limits),
        gravity=tuple(conditions.gravity.tolist()),
        payload="" if conditions.payload is None else str(conditions.payload),
        **numbers_of(conditions.payload),
        has_masses=robot.mass > 0.0,
        rtol=question.rtol,
        wary=question.wary,
        joint_length=question.scale.length,
        notes=(*start.notes, *_drive_notes(question), *_friction_note(scene)),
    )


def _lower_limits(limits: Limits) -> tuple[float, ...]:
    """Return the lower limits of the motors at rest; none if they are always the upper ones."""
    is_symmetric = limits.lower is None and limits.line is None
    return () if is_symmetric else tuple(limits.motor_bounds()[0].tolist())


def _drive_notes(question: Question) -> Iterator[str]:
    """Say what of the drives counts."""
    if question.limits is not None and question.limits.line is not None:
        yield "limits follow torque-speed lines; those shown are the ones at rest"
    if question.conditions.drives is not None:
        yield f"counted: {question.conditions.drives}"


def _friction_note(scene: _Scene) -> tuple[str, ...]:
    """Say which friction is assumed, if a joint swings freely."""
    question = scene.question
    joints = sorted({j for event in scene.events for j in event.faults.free})
    if not joints:
        return ()
    return (
        f"friction of free-swinging joints: {question.friction.in_words(question.robot, joints)}",
    )
