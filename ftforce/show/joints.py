"""Tables of an analysis with one row per joint."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce import words
from ftforce.show.tables import Components, TitledTable, fault_text, spaced, table, vectors
from ftforce.words import number

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.analysis import Analysis
    from ftforce.arrays import Vector
    from ftforce.changes import TorqueChange
    from ftforce.faults import Fault
    from ftforce.robot import Robot


def torque_table(analysis: Analysis, torque: TorqueChange, *, degrees: bool) -> TitledTable:
    """Return the torques before and after: force part, weight and motion, and their sum."""
    moves = analysis.conditions.moves
    angle = "deg" if degrees else "rad"
    result = table(
        f"Motor torque [N·m] = force part JᵀF + weight{' and motion' if moves else ''}",
        "#", "joint", "state", f"q\n[{angle}]", "force\nbefore", "part\nafter",
        "weight\n+motion" if moves else "\nweight", "motor\nafter", "\nlimit", "used\n[%]",
        left=3, folded=(1,),
    )  # fmt: skip
    largest = _limits(analysis)
    positions = shown_positions(analysis.robot, analysis.posture.q, degrees=degrees)
    for i, joint in enumerate(analysis.robot.joints):
        fault = faults_by_joint(analysis).get(i)
        unit = " N" if joint.type == "prismatic" else ""
        load, limit = _load(analysis, torque, i), float(largest[i])
        weight = analysis.rnea.after[i] if analysis.rnea.is_known else math.nan
        is_locked = bool(analysis.reduced.locked[i])
        result.add_row(
            str(joint.number),
            joint.name,
            fault_text(fault),
            positions[i],
            number(float(torque.before[i])) + unit,
            _shown(torque.after, i, unit),
            "?" if math.isnan(weight) else number(float(weight)) + unit,
            "brake" if is_locked else _shown(torque.total_after, i, unit),
            "unknown" if math.isnan(limit) else f"{limit:g}{unit}",
            _used(load, limit),
        )
    notes = []
    if not analysis.rnea.is_known:
        notes.append("? unknown: the URDF has no masses; used: of the force part")
    if analysis.limits is None:
        notes.append("limits are the URDF's and not counted")
    result.caption = "; ".join(notes)
    return result


def _limits(analysis: Analysis) -> Vector:
    """Return the limits that are shown: those that count, or the URDF's motors'."""
    if analysis.limits is None:
        return np.where(analysis.reduced.locked, np.nan, analysis.robot.effort)
    return analysis.limits.largest_torques(analysis.faults)


def _load(analysis: Analysis, torque: TorqueChange, i: int) -> float:
    """Return what motor or brake of one joint gives after the fault, NaN if nothing does."""
    if torque.after is None or torque.brake_load is None:
        return math.nan
    if analysis.reduced.locked[i]:
        return float(torque.brake_load[i])
    return float((torque.after if torque.total_after is None else torque.total_after)[i])


def _shown(torque: Vector | None, i: int, unit: str) -> str:
    return "–" if torque is None else number(float(torque[i])) + unit


def _used(load: float, limit: float) -> str:
    if math.isnan(limit) or math.isnan(load):
        return "?"
    return f"{100.0 * abs(load) / limit:.0f}" if limit > 0.0 else "–"


def motion_table(analysis: Analysis) -> TitledTable | None:
    """Return weight and motion apart, before and after; ``None`` for an arm at rest."""
    rnea = analysis.rnea
    if not analysis.conditions.moves or rnea.motion_before is None or rnea.motion_after is None:
        return None
    result = table(
        "Weight and motion [N·m]: what rnea(q, v, a) is made of",
        "#", "joint", "\nweight", "motion\nbefore", "\nafter", "sum\nbefore", "\nafter",
        left=2, folded=(1,),
    )  # fmt: skip
    columns = (rnea.gravity, rnea.motion_before, rnea.motion_after, rnea.before, rnea.after)
    for i, joint in enumerate(analysis.robot.joints):
        unit = " N" if joint.type == "prismatic" else ""
        cells = (_shown(column, i, unit) for column in columns)
        result.add_row(str(joint.number), joint.name, *cells)
    result.caption = "after: v and a of locked joints are zero, those of the others as before"
    return result


def unit_torque_tables(analysis: Analysis, *, degrees: bool) -> RenderableType:
    """Return the torques for a force of 1 N (1 N·m) along each task axis, three in a table."""
    m = analysis.task.m
    parts = [range(first, min(first + 3, m)) for first in range(0, m, 3)]
    return spaced(*(_unit_torque_table(analysis, axes, degrees=degrees) for axes in parts))


def _unit_torque_table(analysis: Analysis, axes: range, *, degrees: bool) -> TitledTable:
    task, gravity = analysis.task, analysis.rnea.gravity
    angle = "deg" if degrees else "rad"
    result = table(
        "Motor torque [N·m] for each unit force: before, → after where it changes",
        "#", "joint", "state", f"q\n[{angle}]",
        *(f"{task.components[k]}\n1 {task.units[k]}" for k in axes), "\nweight",
        left=3, folded=(1,),
    )  # fmt: skip
    positions = shown_positions(analysis.robot, analysis.posture.q, degrees=degrees)
    faults = faults_by_joint(analysis)
    for i, joint in enumerate(analysis.robot.joints):
        unit = " N" if joint.type == "prismatic" else ""
        cells = [_unit_cell(analysis.unit_forces[k][1], i) + unit for k in axes]
        weight = "?" if gravity is None else number(float(gravity[i])) + unit
        state = fault_text(faults.get(i))
        result.add_row(str(joint.number), joint.name, state, positions[i], *cells, weight)
    result.caption = "weight comes on top of each"
    return result


def _unit_cell(torque: TorqueChange, i: int) -> str:
    before = number(float(torque.before[i]), 3)
    after = "–" if torque.after is None else number(float(torque.after[i]), 3)
    if after == before:
        return before
    gone = torque.after is not None and abs(torque.after[i]) <= words.NEGLIGIBLE
    return f"{before}→{'0' if gone else after}"


def velocity_tables(analysis: Analysis) -> RenderableType | None:
    """Return joint and tip velocities before, at the impact and after the remap."""
    velocity, shares, impact = analysis.velocity, analysis.velocity_contributions, analysis.impact
    if velocity is None or shares is None:
        return None
    hit = ["at\nimpact"] if impact is not None else []
    joints = table(
        "Joint velocities: Appendix A's remap" + (", and right after the lock" if hit else ""),
        "#", "joint", "\nunit", "\nbefore", *hit, "after\nremap", "\nchange",
        "share of\ntip velocity", left=3, folded=(1,),
    )  # fmt: skip
    for i, joint in enumerate(analysis.robot.joints):
        b, a = float(velocity.before[i]), float(velocity.after[i])
        struck = [float(impact.after[i])] if impact is not None else []
        cells = (number(x, 4) for x in (b, *struck, a, a - b))
        name, share = joint.name, number(float(shares[i]))
        joints.add_row(str(joint.number), name, f"{joint.unit}/s", *cells, share)
    if analysis.reduced.swinging is not None:
        joints.caption = "a joint without torque is taken to keep its velocity"
    task = analysis.task
    norms = [("|v|", "m/s", task.force_rows), ("|w|", "rad/s", task.moment_rows)]
    components = Components(task.velocity_components, task.velocity_units, norms)
    columns = {"before": velocity.tip_before}
    if impact is not None:
        columns |= {"at impact": impact.tip_after, "jump": impact.jump}
    columns |= {"remapped": velocity.tip_after, "jump ": velocity.jump}
    return spaced(joints, vectors("Tip velocity", components, columns, digits=5))


def shown_positions(robot: Robot, q: Vector, *, degrees: bool) -> list[str]:
    """Return joint positions as text, sliding ones with their unit."""
    shown = []
    for joint, value in zip(robot.joints, q.tolist(), strict=True):
        if joint.type == "prismatic":
            shown.append(f"{number(value, 3)} m")
        else:
            shown.append(number(math.degrees(value), 2) if degrees else number(value, 3))
    return shown


def faults_by_joint(analysis: Analysis) -> dict[int, Fault]:
    """Return the faults by index of their joint."""
    return {fault.joint: fault for fault in analysis.faults.faults}


def by_joint(robot: Robot, torque: Vector, joints: tuple[int, ...]) -> str:
    """Say torques of some joints with names and units, or ``none``."""
    parts = (
        f"{robot.names[i]} {number(float(torque[i]))} {robot.joints[i].torque_unit}" for i in joints
    )
    return ", ".join(parts) or "none"


def by_unit(robot: Robot, torque: Vector) -> str:
    """Say the norm of torques, those of prismatic joints apart: units are never mixed."""
    parts = []
    for unit in ("N·m", "N"):
        own = [i for i, joint in enumerate(robot.joints) if joint.torque_unit == unit]
        if own:
            parts.append(f"{words.number(float(np.linalg.norm(torque[own])))} {unit}")
    return " and ".join(parts)
