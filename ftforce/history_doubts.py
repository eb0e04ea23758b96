"""What makes a simulation doubtful, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.faults import FaultMode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.arrays import Matrix
    from ftforce.faults import FaultSet
    from ftforce.history import History
    from ftforce.limits import Limits
    from ftforce.robot import Robot

ON_PATH = 1e-5  # m: away from singularities and limits the tip is no farther from its path
_SLACK = 1e-6  # rad, m, or relative: limits are printed rounded


def history_doubts(
    robot: Robot, limits: Limits | None, faults: FaultSet, history: History
) -> Iterator[str]:
    """Name what makes a simulation doubtful.

    Parameters
    ----------
    robot, limits :
        The arm, and the limits that count.
    faults :
        All that happen.
    history :
        What was found.
    """
    if robot.mass == 0.0:
        yield "the URDF has no masses: weight and motion of the arm are missing from the torques"
    yield from _off_path(history)
    yield from _unsupported(history)
    q = np.vstack([run.q for run in history.runs.values()])
    v = np.vstack([run.v for run in history.runs.values()])
    yield from _outside(robot, q)
    yield from _too_fast(robot, v)
    yield from _unjudged(robot, limits, faults)
    if limits is None:
        yield from _beyond_effort(robot, history)


def _off_path(history: History) -> Iterator[str]:
    error = history.healthy.path_error_norm
    worst = int(error.argmax())
    if error[worst] > ON_PATH:
        yield (
            f"even the healthy arm leaves its path, by {length_in_words(float(error[worst]))} at "
            f"{history.t[worst]:g} s: it is close to a singularity or to its limits there"
        )


def _unsupported(history: History) -> Iterator[str]:
    """Say that even the healthy arm lacks a part of the force: no fault takes it."""
    task, run = history.setting.task, history.healthy
    lacking = np.array(history.setting.force) - (run.force + run.jump)
    for rows, unit in ((task.force_rows, "N"), (task.moment_rows, "N·m")):
        size = np.linalg.norm(np.nan_to_num(lacking[:, list(rows)]), axis=1)
        if size.max(initial=0.0) > _SLACK * np.abs(history.setting.force).max():
            worst = int(size.argmax())
            yield (
                f"even the healthy arm cannot exert {size[worst]:.3g} {unit} of the force at "
                f"{history.t[worst]:g} s: it has no such direction there"
            )


def _outside(robot: Robot, q: Matrix) -> Iterator[str]:
    low, high = q.min(axis=0) < robot.lower - _SLACK, q.max(axis=0) > robot.upper + _SLACK
    for i in np.flatnonzero(low | high):
        joint = robot.joints[i]
        yield (
            f"joint {joint.number} {joint.name} goes from {q[:, i].min():.4g} to "
            f"{q[:, i].max():.4g} {joint.unit}, outside its limits {joint.lower:g} to "
            f"{joint.upper:g}"
        )


def _too_fast(robot: Robot, v: Matrix) -> Iterator[str]:
    fastest = np.abs(v).max(axis=0).tolist()
    for joint, speed in zip(robot.joints, fastest, strict=True):
        if joint.velocity is not None and speed > joint.velocity * (1.0 + _SLACK):
            yield (
                f"joint {joint.number} {joint.name} moves with up to {speed:.3g} {joint.unit}/s; "
                f"its limit is {joint.velocity:g}"
            )


def _unjudged(robot: Robot, limits: Limits | None, faults: FaultSet) -> Iterator[str]:
    for fault in faults.faults:
        if fault.mode is not FaultMode.WEAK or fault.has_no_torque:
            continue
        name = f"joint {fault.joint + 1} {robot.names[fault.joint]} is weak, but"
        if limits is None:
            yield f"{name} no limits are counted: it counts as healthy"
        elif np.isnan(limits.effort[fault.joint]):
            yield f"{name} its limit is unknown: it counts as none"


def _beyond_effort(robot: Robot, history: History) -> Iterator[str]:
    """Name motors that are asked for more than the URDF says they can."""
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
                "(limits are not counted)"
            )


def length_in_words(x: float) -> str:
    """Write a distance in a unit that suits it."""
    for unit, scale in (("m", 1.0), ("mm", 1e3), ("µm", 1e6)):
        if x * scale >= 0.9995:
            return f"{x * scale:.3g} {unit}"
    return "< 1 µm"
