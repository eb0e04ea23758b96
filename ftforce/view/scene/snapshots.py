"""The state of a history at a given time: numbers, description and scene.

All numbers are read from the history's arrays; nothing is computed here.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.core.verdict import VERDICTS
from ftforce.report import text
from ftforce.show.plots.canvas import STROKES
from ftforce.view.model.answer import JointLoad
from ftforce.view.scene.arrows import Scales, TipAxes, arrows_of, scales_for
from ftforce.view.scene.colours import NEUTRAL
from ftforce.view.scene.picture import Picture, joint_colours, joint_poses, pose_of

if TYPE_CHECKING:
    from ftforce.core.arrays import Vector
    from ftforce.core.verdict import Verdict
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import History, Run

ROUNDING = 1e-9  # s: tolerance between a slider time and a sample time
_WEAK = re.compile(r"weak (\S+)")


class Snapshot(NamedTuple):
    """The state of a run at one sample.

    Attributes
    ----------
    sample :
        Index of the sample.
    time :
        Time of the sample, s.
    q :
        Joint positions, rad or m, shape (n,); the last known ones once the arm falls.
    run, healthy :
        The run shown, and the run without faults.
    faults :
        Joints that have failed so far.
    requested, kept, lost :
        Requested tip force, force kept and force lost, N and N·m, in task axes, shape (m,);
        ``None`` once the arm falls.
    loads :
        Load of each joint; ``before`` refers to the healthy run.
    verdict :
        Verdict at this sample.
    """

    sample: int
    time: float
    q: Vector
    run: Run
    healthy: Run
    faults: FaultSet
    requested: Vector
    kept: Vector | None
    lost: Vector | None
    loads: tuple[JointLoad, ...]
    verdict: Verdict


def faults_at(history: History, time: float) -> FaultSet:
    """Return the faults that have occurred by a given time.

    Parameters
    ----------
    history :
        The history.
    time :
        Time, s.
    """
    events = [event.all_faults for event in history.setting.events if event.time <= time + ROUNDING]
    if not events:
        return FaultSet()
    found, rest = [], events[-1]
    for i, joint in enumerate(history.setting.joints):  # fault sets are listed in joint order
        start = f"{i + 1} {joint.name} "
        if rest.startswith(start):
            mode, _, rest = rest.removeprefix(start).partition(", ")
            found.append(_fault(i, mode))
    return FaultSet(tuple(found))


def _fault(joint: int, mode: str) -> Fault:
    weak = _WEAK.fullmatch(mode)
    return Fault(joint, FaultMode.WEAK, float(weak[1])) if weak else Fault(joint, FaultMode(mode))


def snapshot(history: History, name: str, time: float) -> Snapshot:
    """Return the state of a run at a given time.

    Parameters
    ----------
    history :
        The history.
    name :
        Name of the run, one of `ftforce.trajectory.history.RUNS`.
    time :
        Time, s; the last sample at or before it is used.
    """
    i, run = history.index(time + ROUNDING), history.runs[name]
    at, fall = float(history.t[i]), run.falls_from
    faults = FaultSet() if name == "healthy" else faults_at(history, at)
    is_held = fall is None or i < fall
    return Snapshot(
        sample=i,
        time=at,
        q=run.q[i if is_held else fall],
        run=run,
        healthy=history.healthy,
        faults=faults,
        requested=np.array(history.setting.force),
        kept=run.force[i] if is_held else None,
        lost=run.jump[i] if is_held else None,
        loads=_loads(history, run, i, faults, is_held),
        verdict=VERDICTS[int(run.verdict[i])],
    )


def first_with(history: History, time: float) -> float:
    """Return the time of the first sample that includes an event, s.

    Parameters
    ----------
    history :
        The history.
    time :
        Time of the event, s.
    """
    i = int(np.searchsorted(history.t, time - ROUNDING))
    return float(history.t[min(i, len(history.t) - 1)])


def _loads(
    history: History, run: Run, i: int, faults: FaultSet, is_held: bool
) -> tuple[JointLoad, ...]:
    by_joint = {fault.joint: fault for fault in faults.faults}
    rows = []
    for j, joint in enumerate(history.setting.joints):
        fault = by_joint.get(j)
        is_locked = fault is not None and fault.mode is FaultMode.LOCKED
        rows.append(
            JointLoad(
                number=j + 1,
                name=joint.name,
                unit=joint.torque_unit,
                fault=fault,
                before=float(history.healthy.motor[i, j]),
                after=float(run.motor[i, j]) if is_held else math.nan,
                part_before=float(run.force_part[i, j]),
                part_after=float(run.U[i, j]) if is_held else math.nan,
                brake=float(run.brake[i, j]) if is_locked and is_held else math.nan,
                limit=_limit(history, run, i, j, fault),
                used=float(run.used[i, j]) if is_held else math.nan,
            )
        )
    return tuple(rows)


def _limit(history: History, run: Run, i: int, j: int, fault: Fault | None) -> float:
    """Return the torque limit of a joint's motor or brake, N·m (N); NaN if unknown."""
    if fault is not None and fault.mode is FaultMode.LOCKED:  # limit from load and share
        used = float(run.used[i, j])
        return abs(float(run.brake[i, j])) / used if used > 0.0 else math.nan
    if history.setting.effort_lower and run.used[i, j] > 0.0:  # it depends on direction or speed
        return abs(float(run.motor[i, j])) / float(run.used[i, j])
    share = 1.0 if fault is None or fault.mode is not FaultMode.WEAK else fault.factor
    return share * history.setting.effort[j]


# ---- description -----------------------------------------------------------------------------


def sentence(history: History, name: str, now: Snapshot) -> str:
    """Return a sentence on the force that a run keeps at one instant.

    Parameters
    ----------
    history :
        The history.
    name :
        Name of the run, one of `ftforce.trajectory.history.RUNS`.
    now :
        Its state at that instant.
    """
    events = [event for event in history.setting.events if event.time <= now.time + ROUNDING]
    faults = events[-1].all_faults if events else "every joint healthy"
    parts = [
        f"{now.time:.2f} s, {STROKES[name].words}, {faults}: {now.verdict}.",
        _kept(now, history),
    ]
    effective = [event.time + history.setting.delay for event in events]
    pending = [f"{time:g} s" for time in effective if now.time < time - ROUNDING]
    if name == "remapped" and pending:
        parts.append(f"The remap takes effect at {text.joined(pending)}.")
    if now.kept is None and (fall := now.run.falls_from) is not None:
        parts.append(
            f"This has been so since {history.t[fall]:g} s; the resulting motion is not simulated."
        )
    return " ".join(parts)


def _kept(now: Snapshot, history: History) -> str:
    task = history.setting.task
    if now.kept is None or now.lost is None:
        return "The arm cannot be held in static equilibrium."
    if text.is_noticeable(now.lost):
        lost = text.amounts(task, now.lost)
        return f"{lost} of {text.amounts(task, now.requested)} is lost at the tip."
    if not now.requested.any():
        return "The arm carries its own weight."
    whole = text.amounts(task, now.requested)
    if text.is_noticeable(now.requested - now.kept):
        return f"The arm exerts as much of the {whole} as the healthy arm can."
    return f"The full {whole} is exerted."


# ---- the scene -------------------------------------------------------------------------------


def history_scales(history: History, extent: float) -> Scales:
    """Return scales at which the largest force and the largest moment of a history fit.

    Parameters
    ----------
    history :
        The history.
    extent :
        Size of the scene, m.
    """
    vectors = [np.array(history.setting.force)]
    vectors += [x for run in history.runs.values() for x in (run.force, run.jump)]
    return scales_for(history.setting.task, vectors, extent)


def scene(
    robot: Robot, history: History, now: Snapshot, scales: Scales, see_through: bool
) -> Picture:
    """Return the scene at one instant.

    Parameters
    ----------
    robot :
        The arm.
    history :
        A history of this arm.
    now :
        Its state at that instant.
    scales :
        Arrow scales.
    see_through :
        Whether the arm is transparent.
    """
    task = history.setting.task
    poses, (tip_rotation, place) = joint_poses(robot, now.q)
    axes = TipAxes(place, tip_rotation if task.axes == "tool" else np.eye(3))
    forces = {
        "requested": now.requested,
        "kept": now.kept,
        "lost": now.lost,
    }
    return Picture(
        joints=poses,
        colours=joint_colours(robot, now.loads),
        tip=pose_of(axes.rotation, place),
        arrows=arrows_of(task, forces, axes, scales),
        lines=(),
        solids=(),
        scales=scales,
        notes=scales.notes(),
        see_through=see_through,
        can_drag=False,
    )


def ghost(robot: Robot, picture: Picture, q: Vector, offset: Vector) -> Picture:
    """Return the healthy arm as a picture without forces.

    Parameters
    ----------
    robot :
        The arm.
    picture :
        Picture of the faulty arm.
    q :
        Joint positions, rad or m, shape (n,).
    offset :
        Offset from the faulty arm's root, m, shape (3,).
    """
    poses, _ = joint_poses(robot, q)
    return replace(
        picture,
        joints=tuple(pose._replace(position=pose.position + offset) for pose in poses),
        colours=(NEUTRAL,) * len(poses),
        arrows=(),
        notes=(),
        see_through=True,
    )
