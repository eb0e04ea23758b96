"""Tables of an analysis with one row per joint."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.analyze import limit_of, shown_limits
from ftforce.report import text as words
from ftforce.report.text import number
from ftforce.show.tables.parts import (
    Components,
    TitledTable,
    fault_text,
    listing,
    spaced,
    table,
    vectors,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType
    from rich.text import Text

    from ftforce.analysis.analyze import Analysis
    from ftforce.core.arrays import Vector
    from ftforce.core.changes import TorqueChange, VelocityChange
    from ftforce.robot.robot import Joint, Robot


def torque_table(analysis: Analysis, torque: TorqueChange, *, degrees: bool) -> TitledTable:
    """Return the torques before and after: force part, gravity and inertial part, and sum."""
    positions = _positions(analysis, degrees=degrees)
    rows = [_torque_row(analysis, torque, i, x) for i, x in enumerate(positions)]
    part = f"weight{' and motion' if analysis.conditions.moves else ''}"
    result = listing(f"Motor torque [N·m] = force part JᵀF + {part}", rows, left=3, folded=(1,))
    notes = []
    if not analysis.rnea.is_known:
        more = "" if analysis.conditions.payload is None else " and the payload"
        notes.append(f"? unknown: the URDF has no masses; used: of the force part{more}")
    if analysis.limits is None:
        notes.append("limits are those of the URDF and not enforced")
    result.caption = "; ".join(notes)
    return result


def _torque_row(
    analysis: Analysis, torque: TorqueChange, i: int, position: tuple[str, str]
) -> Iterator[tuple[str, str | Text]]:
    rnea, unit = analysis.rnea, _unit(analysis.robot.joints[i])
    load = _load(analysis, torque, i)
    lower, upper = (float(side[i]) for side in shown_limits(analysis))
    yield from _joint(analysis, i)
    yield position
    yield "force\nbefore", _shown(torque.before, i, unit)
    yield "part\nafter", _shown(torque.after, i, unit)
    heading = "weight\n+motion" if analysis.conditions.moves else "\nweight"
    yield heading, _shown(rnea.after if rnea.is_known else None, i, unit, unknown="?")
    held = bool(analysis.reduced.locked[i])
    yield "motor\nafter", "brake" if held else _shown(torque.total_after, i, unit)
    shown = f"{upper:g}" if lower == -upper else f"{lower + 0.0:g} … {upper:g}"
    yield "\nlimit", "unknown" if math.isnan(upper) else shown + unit
    yield "used\n[%]", _used(load, limit_of(load, lower, upper))


def _joint(analysis: Analysis, i: int) -> list[tuple[str, str | Text]]:
    joint = analysis.robot.joints[i]
    fault = next((fault for fault in analysis.faults.faults if fault.joint == i), None)
    return [("#", str(joint.number)), ("joint", joint.name), ("state", fault_text(fault))]


def _unit(joint: Joint) -> str:
    """Return the unit to add to a cell if it differs from the heading's N·m."""
    return " N" if joint.type == "prismatic" else ""


def _load(analysis: Analysis, torque: TorqueChange, i: int) -> float:
    """Return the motor or brake load of a joint after the fault; NaN if the arm falls."""
    if torque.after is None or torque.brake_load is None:
        return math.nan
    if analysis.reduced.locked[i]:
        return float(torque.brake_load[i])
    if torque.total_after is not None:
        return float(torque.total_after[i])
    own = analysis.reduced.commanding[i]  # of the payload, if any: the arm's weight is unknown
    return float(torque.after[i] + (analysis.rnea.after[i] if own else 0.0))


def _shown(torque: Vector | None, i: int, unit: str, unknown: str = "–") -> str:
    if torque is None or math.isnan(torque[i]):
        return unknown
    return number(float(torque[i])) + unit


def _used(load: float, limit: float) -> str:
    if math.isnan(limit) or math.isnan(load):
        return "?"
    return f"{100.0 * abs(load) / limit:.0f}" if limit > 0.0 else "–"


def motion_table(analysis: Analysis) -> TitledTable | None:
    """Return the gravity and inertial torques before and after; ``None`` for an arm at rest."""
    rnea = analysis.rnea
    if not analysis.conditions.moves or rnea.motion_before is None or rnea.motion_after is None:
        return None
    headings = ("#", "joint", "\nweight", "motion\nbefore", "\nafter", "sum\nbefore", "\nafter")
    title = "Weight and motion [N·m]: the parts of rnea(q, v, a)"
    result = table(title, *headings, left=2, folded=(1,))
    columns = (rnea.gravity, rnea.motion_before, rnea.motion_after, rnea.before, rnea.after)
    for i, joint in enumerate(analysis.robot.joints):
        cells = (_shown(column, i, _unit(joint)) for column in columns)
        result.add_row(str(joint.number), joint.name, *cells)
    result.caption = "after: v and a of locked joints are zero, those of the others unchanged"
    return result


def unit_torque_tables(analysis: Analysis, *, degrees: bool) -> RenderableType:
    """Return the torques for 1 N (1 N·m) along each task axis, three axes per table."""
    m = analysis.task.m
    parts = [range(first, min(first + 3, m)) for first in range(0, m, 3)]
    return spaced(*(_unit_torque_table(analysis, axes, degrees=degrees) for axes in parts))


def _unit_torque_table(analysis: Analysis, axes: range, *, degrees: bool) -> TitledTable:
    positions = _positions(analysis, degrees=degrees)
    rows = [_unit_torque_row(analysis, axes, i, x) for i, x in enumerate(positions)]
    title = "Motor torque [N·m] for each unit force: before, → after where it changes"
    result = listing(title, rows, left=3, folded=(1,))
    result.caption = "the weight torque is added to each"
    return result


def _unit_torque_row(
    analysis: Analysis, axes: range, i: int, position: tuple[str, str]
) -> Iterator[tuple[str, str | Text]]:
    task, unit = analysis.task, _unit(analysis.robot.joints[i])
    yield from _joint(analysis, i)
    yield position
    for k in axes:
        cell = _unit_cell(analysis.unit_forces[k][1], i)
        yield f"{task.components[k]}\n1 {task.units[k]}", cell + unit
    yield "\nweight", _shown(analysis.rnea.gravity, i, unit, unknown="?")


def _unit_cell(torque: TorqueChange, i: int) -> str:
    before = number(float(torque.before[i]), 3)
    after = "–" if torque.after is None else number(float(torque.after[i]), 3)
    if after == before:
        return before
    gone = torque.after is not None and abs(torque.after[i]) <= words.NEGLIGIBLE
    return f"{before}→{'0' if gone else after}"


def velocity_tables(analysis: Analysis) -> RenderableType | None:
    """Return joint and tip velocities before the fault, at impact and after the remap."""
    velocity, impact = analysis.velocity, analysis.impact
    if velocity is None:
        return None
    rows = [_velocity_row(analysis, velocity, i) for i in range(analysis.robot.n)]
    title = "Joint velocities: Appendix A's remap"
    title += "" if impact is None else ", and immediately after the lock"
    joints = listing(title, rows, left=3, folded=(1,))
    if analysis.reduced.free is not None:
        joints.caption = "a joint without torque is assumed to keep its velocity"
    task = analysis.task
    norms = [("|v|", "m/s", task.force_rows), ("|w|", "rad/s", task.moment_rows)]
    components = Components(task.velocity_components, task.velocity_units, norms)
    columns = {"before": velocity.tip_before}
    if impact is not None:
        columns |= {"at impact": impact.tip_after, "jump": impact.jump}
    columns |= {"remapped": velocity.tip_after, "jump ": velocity.jump}
    return spaced(joints, vectors("Tip velocity", components, columns, digits=5))


def _velocity_row(
    analysis: Analysis, velocity: VelocityChange, i: int
) -> Iterator[tuple[str, str]]:
    joint, shares, impact = (
        analysis.robot.joints[i],
        analysis.velocity_contributions,
        analysis.impact,
    )
    before, after = float(velocity.before[i]), float(velocity.after[i])
    yield "#", str(joint.number)
    yield "joint", joint.name
    yield "\nunit", f"{joint.unit}/s"
    yield "\nbefore", number(before, 4)
    if impact is not None:
        yield "at\nimpact", number(float(impact.after[i]), 4)
    yield "after\nremap", number(after, 4)
    yield "\nchange", number(after - before, 4)
    assert shares is not None  # set whenever there is a velocity
    yield "share of\ntip velocity", number(float(shares[i]))


def _positions(analysis: Analysis, *, degrees: bool) -> list[tuple[str, str]]:
    """Return joint positions with their heading, those of prismatic joints with their unit."""
    shown = []
    for joint, value in zip(analysis.robot.joints, analysis.posture.q.tolist(), strict=True):
        if joint.type == "prismatic":
            shown.append(f"{number(value, 3)} m")
        else:
            shown.append(number(math.degrees(value), 2) if degrees else number(value, 3))
    return [(f"q\n[{'deg' if degrees else 'rad'}]", text) for text in shown]


def by_joint(robot: Robot, torque: Vector, joints: tuple[int, ...]) -> str:
    """Format the torques of some joints with names and units; ``none`` if there are none."""
    parts = (
        f"{robot.names[i]} {number(float(torque[i]))} {robot.joints[i].torque_unit}" for i in joints
    )
    return ", ".join(parts) or "none"


def by_unit(robot: Robot, torque: Vector) -> str:
    """Format norms of torques, separately for prismatic joints: units are never mixed."""
    parts = []
    for unit in ("N·m", "N"):
        own = [i for i, joint in enumerate(robot.joints) if joint.torque_unit == unit]
        if own:
            parts.append(f"{words.number(float(np.linalg.norm(torque[own])))} {unit}")
    return " and ".join(parts)
