"""Warnings about simulations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.conditions import known_mass_matrix
from ftforce.analysis.warnings import implausible, unjudged
from ftforce.robot.dynamics import rnea_torque
from ftforce.robot.posture import DEGREES, looks_like_degrees

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.analysis.question import Question
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.faults import FaultSet
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import History, Run
    from ftforce.trajectory.reference import Motion
    from ftforce.trajectory.start import Start

ON_PATH = 1e-5  # m: larger tracking errors occur only near singularities and limits
ORIENTED = 1e-5  # rad: the same for the orientation
_SLACK = 1e-6  # rad, m, or relative: limits in the URDF are rounded
_INSTANTS = 50  # at which the effect of noise is estimated
_NOISY = np.array([0.01, 0.005])  # of the largest torque: noise that is reported, and at the ends
_AT_ONCE = 4096  # instants
_STEP = 0.05  # of the largest speed: unexplained velocity step that is reported


def history_warnings(
    question: Question, faults: FaultSet, history: History, *, is_static: bool = False
) -> Iterator[str]:
    """Yield the warnings of a simulation.

    Parameters
    ----------
    question :
        What is asked at every instant.
    faults :
        All faults that occur.
    history :
        The simulated history.
    is_static :
        Whether accelerations are left out of the torques.
    """
    robot, limits = question.robot, question.limits
    if robot.mass == 0.0:
        yield "the URDF has no masses: gravity and motion torques of the arm are not included"
    yield from implausible(question, needs_gravity=True, needs_inertia=True)
    healthy, t = history.healthy, history.t
    yield from off_path(t, healthy.path_error_norm, healthy.orientation_error_norm)
    yield from force_warnings(t, history.setting.task, unsupported(history))
    parts = [(run, run.until_fall) for run in history.runs.values()]
    q = np.concatenate([_extremes(run.q[part]) for run, part in parts])
    v = np.concatenate([_extremes(run.v[part]) for run, part in parts])
    yield from limit_warnings(robot, q, v)
    if not is_static:
        yield from _steps(history)
    for event in history.setting.events:
        acts = event.time + history.setting.delay
        if math.isfinite(acts) and acts > history.t[-1]:
            yield (
                f"the remap of the fault at {event.time:g} s would take effect at {acts:g} s, "
                f"after the end of the trajectory at {history.t[-1]:g} s"
            )
    yield from unjudged(robot, faults, limits)
    if limits is None:
        yield from _beyond_effort(robot, history)


def _extremes(x: Matrix) -> Matrix:
    """Return the least and the largest value of each column, shape (2, n)."""
    return np.array([x.min(axis=0), x.max(axis=0)])


def off_path(t: Vector, error: Vector, turn: Vector) -> Iterator[str]:
    """Warn if even the healthy arm deviates from its path or the prescribed orientation.

    Parameters
    ----------
    t :
        Times, s, shape (N,).
    error, turn :
        Position error, m, and orientation error, rad, shape (N,).
    """
    where = "it is close to a singularity or to its joint limits there"
    worst = int(error.argmax())
    if error[worst] > ON_PATH:
        off = length_in_words(float(error[worst]))
        yield f"even the healthy arm deviates from its path, by {off} at {t[worst]:g} s: {where}"
    worst = int(turn.argmax())
    if turn[worst] > ORIENTED:
        degrees = math.degrees(float(turn[worst]))
        yield (
            f"even the healthy arm deviates from its tip orientation, by {degrees:.3g}° at "
            f"{t[worst]:g} s: {where}"
        )


def noise_warnings(question: Question, start: Start, motion: Motion | Run) -> Iterator[str]:
    """Warn if noise in a recording makes up much of the torques, which its data do not support.

    Noise of size s in the accelerations makes torques of size sqrt(Σ_k (M_ik s_k)²). At the ends of
    a recording, where there are samples on one side only, it is larger.

    Parameters
    ----------
    question :
        What is asked at every instant.
    start :
        The trajectory.
    motion :
        Joint positions, velocities and accelerations of the healthy arm over time.
    """
    smoothing = start.reference.smoothing
    robot, conditions = question.robot, question.conditions
    if smoothing is None or start.is_static:
        return
    own = None if conditions.is_model_gravity else conditions.gravity
    rows = np.unique(np.linspace(0, len(motion.q) - 1, _INSTANTS).astype(int))
    made, whole = np.zeros((2, robot.n)), np.zeros(robot.n)
    for i in rows.tolist():
        q, v, a = motion.q[i], motion.v[i], motion.a[i]
        M = known_mass_matrix(robot, q, conditions)
        if M is None:
            return
        for place in [0] if i not in {0, rows[-1]} else [0, 1]:
            size = np.hypot.reduce(M * smoothing.acceleration_noise[place], axis=1)
            made[place] = np.maximum(made[place], size)
        torque = rnea_torque(
            robot, q, v, a, gravity=own, payload=conditions.payload, drives=conditions.terms
        )
        whole = np.maximum(whole, np.abs(torque))
    least = _NOISY * whole.max(initial=1e-300)
    place = 0 if (made[0] > least[0]).any() else 1
    i = int(made[place].argmax())
    if made[place, i] > least[place]:
        joint = robot.joints[i]
        where, advice = (
            ("", "smooth it more (--smooth SECONDS) or count the weight only (--static)"),
            (
                " at its ends, where there are samples on one side only",
                "record for longer, or count the weight only (--static)",
            ),
        )[place]
        yield (
            f"noise in the recording makes about ±{made[place, i]:.2g} {joint.torque_unit} of the "
            f"torque of joint {joint.number} {joint.name}{where} (the largest torque of any joint "
            f"is {whole.max():.3g}): its data do not support such accelerations; {advice}"
        )


def unsupported(history: History) -> Matrix:
    """Return the part of the force the healthy arm cannot exert, N and N·m, shape (N, m)."""
    run, asked = history.healthy, np.array(history.setting.force)
    return missing_force(asked, run.force + run.jump)


def missing_force(asked: Vector, exerted: Matrix) -> Matrix:
    """Return requested minus exerted force, with rounding errors set to zero, shape (N, m).

    Parameters
    ----------
    asked :
        Requested force, N and N·m, shape (m,).
    exerted :
        Exerted force over time, shape (N, m).
    """
    missing = np.nan_to_num(asked - exerted)
    return np.where(np.abs(missing) > _SLACK * np.abs(asked).max(initial=0.0), missing, 0.0)


def force_warnings(t: Vector, task: Task, missing: Matrix) -> Iterator[str]:
    """Warn if even the healthy arm cannot exert part of the requested force.

    Parameters
    ----------
    t :
        Times, s, shape (N,).
    task :
        The task.
    missing :
        Part of the force that cannot be exerted, N and N·m, shape (N, m).
    """
    for rows, unit in ((task.force_rows, "N"), (task.moment_rows, "N·m")):
        size = np.linalg.norm(missing[:, list(rows)], axis=1)
        if size.any():
            worst = int(size.argmax())
            yield (
                f"even the healthy arm cannot exert {size[worst]:.3g} {unit} of the force at "
                f"{t[worst]:g} s: its Jacobian is rank deficient there"
            )


def limit_warnings(robot: Robot, q: Matrix, v: Matrix) -> Iterator[str]:
    """Warn about joints beyond their position or velocity limits.

    Parameters
    ----------
    robot :
        The arm.
    q, v :
        Joint positions and velocities, rad or m, and per s, shape (N, n).
    """
    yield from _outside(robot, q)
    yield from _too_fast(robot, v)


def _steps(history: History) -> Iterator[str]:
    """Warn about velocity steps without a fault: they would need infinite acceleration."""
    run, t, setting = history.answer, history.t, history.setting
    v, a = run.v[run.until_fall], run.a[run.until_fall]
    sizes = np.zeros(len(v) - 1)
    for start in range(0, len(sizes), _AT_ONCE):
        here = slice(start, start + _AT_ONCE + 1)
        by_a = 0.5 * np.diff(t[: len(v)][here])[:, None] * (a[here][1:] + a[here][:-1])
        sizes[here][:_AT_ONCE] = np.abs(np.diff(v[here], axis=0) - by_a).max(axis=1)
    for event in setting.events:  # steps are expected here
        for time in (event.time, event.time + setting.delay):
            sizes[max(int(np.searchsorted(t, time)) - 1, 0) :][:1] = 0.0
    if len(sizes) and sizes.max() > _STEP * np.abs(_extremes(v)).max() > 0.0:
        yield (
            f"joint velocities change abruptly at {t[int(sizes.argmax())]:g} s (a limit, a "
            "singularity or a low sampling rate): accelerations and torques there are unreliable"
        )


def _outside(robot: Robot, q: Matrix) -> Iterator[str]:
    low, high = q.min(axis=0) < robot.lower - _SLACK, q.max(axis=0) > robot.upper + _SLACK
    hint = f"{DEGREES} (columns [deg])" if looks_like_degrees(robot, q) else ""
    for i in np.flatnonzero(low | high):
        joint = robot.joints[i]
        yield (
            f"joint {joint.number} {joint.name} moves from {q[:, i].min():.4g} to "
            f"{q[:, i].max():.4g} {joint.unit}, outside its limits {joint.lower:g} to "
            f"{joint.upper:g}{hint}"
        )


def _too_fast(robot: Robot, v: Matrix) -> Iterator[str]:
    fastest = np.abs(v).max(axis=0).tolist()
    for joint, speed in zip(robot.joints, fastest, strict=True):
        if joint.velocity is not None and speed > joint.velocity * (1.0 + _SLACK):
            yield (
                f"joint {joint.number} {joint.name} reaches {speed:.3g} {joint.unit}/s; "
                f"its velocity limit is {joint.velocity:g} {joint.unit}/s"
            )


def _beyond_effort(robot: Robot, history: History) -> Iterator[str]:
    """Warn about motors that need more torque than their effort limit in the URDF."""
    motor = np.abs(history.answer.motor)
    for i, joint in enumerate(robot.joints):
        if joint.effort is None or np.isnan(motor[:, i]).all():
            continue
        worst = int(np.nanargmax(motor[:, i]))
        if motor[worst, i] > joint.effort * (1.0 + _SLACK):
            yield (
                f"joint {joint.number} {joint.name} would need "
                f"{100.0 * motor[worst, i] / joint.effort:.4g}% of its effort limit of "
                f"{joint.effort:g} {joint.torque_unit} at {history.t[worst]:g} s "
                "(limits are not enforced)"
            )


def length_in_words(x: float) -> str:
    """Format a distance in m, mm or µm, whichever suits its size."""
    for unit, scale in (("m", 1.0), ("mm", 1e3), ("µm", 1e6)):
        if x * scale >= 0.9995:
            return f"{x * scale:.3g} {unit}"
    return "< 1 µm"
