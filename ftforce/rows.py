"""Results as rows of a table with names and units: what a CSV file holds."""

from __future__ import annotations

import math
from functools import singledispatch
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.analyze import Analysis
from ftforce.analysis.capability import Amount, Capability
from ftforce.analysis.census import Census
from ftforce.analysis.paper import Replication
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.comparison_documents import comparison_rows
from ftforce.core.arrays import over
from ftforce.core.faults import FaultMode
from ftforce.core.feasible_forces import Reading
from ftforce.core.verdict import VERDICTS
from ftforce.errors import InputError
from ftforce.map_documents import map_rows
from ftforce.report import text
from ftforce.report.parts import (
    Document,
    Row,
    check_part,
    finite,
    limits_source,
    rows_of,
    task_columns,
)
from ftforce.robot.robot import Robot
from ftforce.sweep_documents import sweep_rows
from ftforce.trajectory.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.analysis.fault_set import SetReport
    from ftforce.core.arrays import Vector


@singledispatch
def to_rows(result: object) -> list[Row]:
    """Return a result or a robot as rows, the header first.

    An analysis has one row per quantity and joint or component, a census one per fault set, a robot
    one per joint, a replication one per printed number.

    Raises
    ------
    InputError
        It is something else.
    """
    raise InputError(f"a result or a robot can be written, not a {type(result).__name__}")


@to_rows.register(Analysis)
def _analysis(analysis: Analysis) -> list[Row]:
    header = ("quantity", "name", "unit", "before", "after", "change")
    return [header, *_convention_rows(analysis), *_joint_rows(analysis), *_tip_rows(analysis)]


@to_rows.register(Census)
def _census(census: Census) -> list[Row]:
    return rows_of(_set(census, report) for report in census.sets)


def _set(census: Census, report: SetReport) -> Document:
    task, names, faults = census.task, census.robot.names, report.faults
    jump = [""] * task.m if report.jump is None else report.jump.tolist()
    jumps = zip(task.components, task.units, jump, strict=True)
    found = report.capability
    return {
        "fault_set": str(faults),
        "locked": " ".join(names[i] for i in faults.in_mode(FaultMode.LOCKED)),
        "free": " ".join(names[i] for i in faults.in_mode(FaultMode.FREE)),
        "size": len(faults),
        "verdict": report.verdict.value,
        "jump_norm [N]": report.jump_norm,
        "moment_jump_norm [N·m]": report.moment_jump_norm,
        **{f"jump_{name} [{unit}]": x for name, unit, x in jumps},
        "margin": report.margin,
        "relative_manipulability": finite(report.relative_manipulability),
        "rank_after": report.rank_after,
        "rank_lost": report.rank_lost,
        "can_stand_still": report.can_stand_still,
        "share": report.share,
        "binding": " ".join(names[j] for j in report.binding),
        "commanded": "" if found is None else finite(found.commanded),
        "held": "" if found is None else finite(found.held),
        "least": "" if found is None else finite(found.least),
        "end": "" if found is None else found.end.value,
        "held_end": "" if found is None else found.held_end.value,
        **task_columns(task),
        "limits": limits_source(census.limits),
        "rtol": census.rtol,
        "wary": census.wary,
    }


@to_rows.register(Capability)
def _capability(capability: Capability) -> list[Row]:
    reports = [(report, report.unit) for report in capability.directions]
    reports.append((capability.weakest, text.unit_of_size(capability.analysis.task)))
    found = [
        ((report.name, unit, when, reading.value), amounts[reading])
        for report, unit in reports
        for when, amounts in (("before", report.before), ("after", report.after))
        for reading in Reading
    ]
    loads = zip(("before", "after"), capability.payload, strict=True)
    found += [(("payload", "kg", when, "held"), amount) for when, amount in loads]
    return rows_of(_amount(capability, *one) for one in found)


def _amount(capability: Capability, about: tuple[str, str, str, str], amount: Amount) -> Document:
    analysis, task = capability.analysis, capability.analysis.task
    names, direction = analysis.robot.names, amount.direction.tolist()
    if not direction or (about[0] == capability.weakest.name and not math.isfinite(amount.most)):
        direction = [""] * task.m
    return {
        **dict(zip(("quantity", "unit", "when", "reading"), about, strict=True)),
        "most": finite(amount.most),
        "least": finite(amount.least),
        "end": amount.end.value,
        "stops": " ".join(names[j] for j in amount.stops),
        **{f"direction_{axis}": x for axis, x in zip(task.components, direction, strict=True)},
        "fault_set": str(analysis.faults),
        **task_columns(task),
        "limits": limits_source(analysis.limits),
    }


@to_rows.register(Timeline)
def _timeline(timeline: Timeline) -> list[Row]:
    names, task = timeline.robot.names, timeline.task
    unit = text.unit_of_size(task, timeline.direction)
    conventions = {
        **task_columns(task),
        "limits": limits_source(timeline.limits),
        "capability_limits": limits_source(timeline.capability_limits),
        "rtol": timeline.rtol,
        "wary": timeline.wary,
    }
    quantities = (f"jump [{task.size_unit}]", "margin", f"capability [{unit}]", "verdict")
    rows: list[Row] = [("t [s]", "fault_set", "joints", *quantities, *conventions)]
    for j, faults in enumerate(timeline.sets):
        about = (str(faults), " ".join(names[i] for i in faults.joints))
        arrays = (timeline.jump, timeline.margin, timeline.capability)
        columns = ([finite(x) for x in array[:, j].tolist()] for array in arrays)
        verdicts = (VERDICTS[code].value for code in timeline.verdict[:, j].tolist())
        cells = zip(timeline.t.tolist(), *columns, verdicts, strict=True)
        rows += [(t, *about, *values, *conventions.values()) for t, *values in cells]
    return rows


to_rows.register(Comparison, comparison_rows)
to_rows.register(WorkspaceMap, map_rows)
to_rows.register(Sweep, sweep_rows)


@to_rows.register(Robot)
def _robot(robot: Robot) -> list[Row]:
    return rows_of(
        {
            "number": joint.number,
            "joint": joint.name,
            "type": joint.type,
            "lower": finite(joint.lower),
            "upper": finite(joint.upper),
            "unit": joint.unit,
            "effort": joint.effort,
            "effort_unit": joint.torque_unit,
            "speed": joint.velocity,
        }
        for joint in robot.joints
    )


@to_rows.register(Replication)
def _replication(result: Replication) -> list[Row]:
    return rows_of(map(check_part, result.checks))


def _convention_rows(analysis: Analysis) -> list[Row]:
    task, reduced, conditions = analysis.task, analysis.reduced, analysis.conditions
    healthy = over(reduced.healthy.s[-1], reduced.sigma_max, 0.0)
    gravity = zip("xyz", conditions.gravity.tolist(), strict=True)
    said = [
        ("robot", "", analysis.robot.name),
        ("tip", "", analysis.robot.tip),
        ("axes", "", task.axes),
        ("task", "", str(task)),
        ("length", "m", task.length if task.moment_rows else ""),
        ("limits", "", limits_source(analysis.limits)),
        *((f"gravity_{axis}", "m/s²", x) for axis, x in gravity),
        ("payload", "kg", 0.0 if conditions.payload is None else conditions.payload.mass),
        ("rtol", "", reduced.rtol),
        ("wary", "", analysis.wary),
    ]
    rho = finite(analysis.relative_manipulability)
    return [
        *(("convention", name, unit, value, "", "") for name, unit, value in said),
        ("verdict", "verdict", "", "", analysis.verdict.value, ""),
        ("jacobian", "rank", "", reduced.rank, reduced.rank_after, ""),
        ("jacobian", "margin", "", healthy, analysis.margin, ""),
        ("jacobian", "relative_manipulability", "", 1.0, rho, ""),
    ]


def _joint_rows(analysis: Analysis) -> list[Row]:
    robot = analysis.robot
    faults = {fault.joint: fault for fault in analysis.faults.faults}
    rows: list[Row] = []
    for joint, q in zip(robot.joints, analysis.posture.q.tolist(), strict=True):
        rows.append(("position", joint.name, joint.unit, q, q, 0.0))
    for joint in robot.joints:
        fault = faults.get(joint.number - 1, "healthy")
        rows.append(("state", joint.name, "", "healthy", str(fault), ""))
    units = [joint.torque_unit for joint in robot.joints]
    rnea, torque = analysis.rnea, analysis.torque
    rows += _changes("gravity", robot.names, units, rnea.gravity, rnea.gravity)
    rows += _changes("motion", robot.names, units, rnea.motion_before, rnea.motion_after)
    if torque is not None:
        rows += _changes("torque", robot.names, units, torque.before, torque.after)
        after = torque.total_after
        if after is not None:  # what a lock carries is its brake's
            after = np.where(analysis.reduced.locked, np.nan, after)
        rows += _changes("total", robot.names, units, torque.total_before, after)
        if torque.brake_load is not None:
            for i in analysis.faults.in_mode(FaultMode.LOCKED):
                load = float(torque.brake_load[i])
                rows.append(("brake_load", robot.names[i], units[i], "", load, ""))
    if (velocity := analysis.velocity) is not None:
        units = [f"{joint.unit}/s" for joint in robot.joints]
        rows += _changes("velocity", robot.names, units, velocity.before, velocity.after)
        if (impact := analysis.impact) is not None:
            name = "velocity at impact"
            rows += _changes(name, robot.names, units, velocity.before, impact.after)
    return rows


def _changes(
    quantity: str,
    names: Sequence[str],
    units: Sequence[str],
    before: Vector | None,
    after: Vector | None,
) -> list[Row]:
    """Return one row per name; what is unknown stays empty."""
    rows = []
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        b = None if before is None else finite(float(before[i]))
        a = None if after is None else finite(float(after[i]))
        rows.append((quantity, name, unit, b, a, None if b is None or a is None else a - b))
    return rows


def _tip_rows(analysis: Analysis) -> list[Row]:
    task = analysis.task
    forces = [("force", analysis.force)] if analysis.force else []
    forces += [
        (f"force for unit {name}", force)
        for name, (force, _) in zip(task.components, analysis.unit_forces, strict=False)
    ]
    rows: list[Row] = []
    for quantity, force in forces:
        rows += _changes(quantity, task.components, task.units, force.before, force.after)
    if (velocity := analysis.velocity) is not None:
        names, units = task.velocity_components, task.velocity_units
        rows += _changes("tip velocity", names, units, velocity.tip_before, velocity.tip_after)
        if (impact := analysis.impact) is not None:
            name = "tip velocity at impact"
            rows += _changes(name, names, units, velocity.tip_before, impact.tip_after)
    return rows
