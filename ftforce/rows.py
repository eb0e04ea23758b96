"""Results as rows of a table with names and units: what a CSV file holds."""

from __future__ import annotations

import math
from functools import singledispatch
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ftforce import words
from ftforce.analysis import Analysis
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.comparison_documents import comparison_rows
from ftforce.document_parts import finite
from ftforce.errors import InputError
from ftforce.fault_census import Census
from ftforce.fault_timeline import Timeline
from ftforce.faults import FaultMode
from ftforce.feasible import Reading
from ftforce.force_capability import Amount, Capability
from ftforce.history import VERDICTS
from ftforce.map_documents import map_rows
from ftforce.replicate import Replication
from ftforce.robot import Robot
from ftforce.sweep_documents import sweep_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.arrays import Vector
    from ftforce.limits import Limits
    from ftforce.set_reports import SetReport

Row: TypeAlias = tuple[Any, ...]


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
    task = census.task
    header = (
        "fault_set", "locked", "free", "size", "verdict", "jump_norm [N]", "moment_jump_norm [N·m]",
        *(f"jump_{name} [{unit}]" for name, unit in zip(task.components, task.units, strict=True)),
        "margin", "relative_manipulability", "rank_after", "rank_lost",
        "can_stand_still", "share", "binding", "commanded", "held", "least",
        "end", "held_end",
        "axes", "task", "length [m]", "limits", "rtol", "wary",
    )  # fmt: skip
    conventions = (task.axes, str(task), task.length if task.moment_rows else "",
                   _source(census.limits),
                   census.rtol, census.wary)  # fmt: skip
    names = census.robot.names
    rows = [
        (
            str(report.faults),
            " ".join(names[i] for i in report.faults.in_mode(FaultMode.LOCKED)),
            " ".join(names[i] for i in report.faults.in_mode(FaultMode.FREE)),
            len(report.faults),
            report.verdict.value,
            report.jump_norm,
            report.moment_jump_norm,
            *([""] * task.m if report.jump is None else report.jump.tolist()),
            report.margin,
            finite(report.relative_manipulability),
            report.rank_after,
            report.rank_lost,
            report.can_stand_still,
            report.share,
            " ".join(names[j] for j in report.binding),
            *_capability_cells(report),
            *conventions,
        )
        for report in census.sets
    ]
    return [header, *rows]


def _source(limits: Limits | None) -> str:
    return "none" if limits is None else limits.source


def _capability_cells(report: SetReport) -> tuple[Any, ...]:
    if report.capability is None:
        return ("",) * 5
    found = report.capability
    amounts = (finite(x) for x in (found.commanded, found.held, found.least))
    return *amounts, found.end.value, found.held_end.value


@to_rows.register(Capability)
def _capability(capability: Capability) -> list[Row]:
    analysis, task = capability.analysis, capability.analysis.task
    names = analysis.robot.names
    header = (
        "quantity", "unit", "when", "reading", "most", "least", "end", "stops",
        *(f"direction_{name}" for name in task.components),
        "fault_set", "axes", "task", "length [m]", "limits",
    )  # fmt: skip
    conventions = (str(analysis.faults), task.axes, str(task),
                   task.length if task.moment_rows else "", _source(analysis.limits))  # fmt: skip

    def row(name: str, unit: str, when: str, reading: str, amount: Amount) -> Row:
        stops = " ".join(names[j] for j in amount.stops)
        direction = amount.direction.tolist()
        if not direction or (name == capability.weakest.name and not math.isfinite(amount.most)):
            direction = [""] * task.m
        most, least = finite(amount.most), finite(amount.least)
        return (name, unit, when, reading, most, least, amount.end.value, stops, *direction,
                *conventions)  # fmt: skip

    reports = [(report, report.unit) for report in capability.directions]
    reports.append((capability.weakest, words.unit_of_size(task)))
    rows = [
        row(report.name, unit, when, reading.value, amounts[reading])
        for report, unit in reports
        for when, amounts in (("before", report.before), ("after", report.after))
        for reading in Reading
    ]
    loads = zip(("before", "after"), capability.payload, strict=True)
    rows += [row("payload", "kg", when, "held", amount) for when, amount in loads]
    return [header, *rows]


@to_rows.register(Timeline)
def _timeline(timeline: Timeline) -> list[Row]:
    names, task = timeline.robot.names, timeline.task
    unit = words.unit_of_size(task, timeline.direction)
    jump_unit = task.size_unit
    header = ("t [s]", "fault_set", "joints", f"jump [{jump_unit}]", "margin",
              f"capability [{unit}]", "verdict", "axes", "task", "length [m]", "limits",
              "capability_limits", "rtol", "wary")  # fmt: skip
    conventions = (task.axes, str(task), task.length if task.moment_rows else "",
                   _source(timeline.limits), _source(timeline.capability_limits),
                   timeline.rtol, timeline.wary)  # fmt: skip
    rows: list[Row] = [header]
    for j, faults in enumerate(timeline.sets):
        about = (str(faults), " ".join(names[i] for i in faults.joints))
        arrays = (timeline.jump, timeline.margin, timeline.capability)
        columns = ([finite(x) for x in array[:, j].tolist()] for array in arrays)
        verdicts = (VERDICTS[code].value for code in timeline.verdict[:, j].tolist())
        cells = zip(timeline.t.tolist(), *columns, verdicts, strict=True)
        rows += [(t, *about, *values, *conventions) for t, *values in cells]
    return rows


to_rows.register(Comparison, comparison_rows)
to_rows.register(WorkspaceMap, map_rows)
to_rows.register(Sweep, sweep_rows)


@to_rows.register(Robot)
def _robot(robot: Robot) -> list[Row]:
    header = ("number", "joint", "type", "lower", "upper", "unit", "effort", "effort_unit", "speed")
    return [
        header,
        *(
            (joint.number, joint.name, joint.type, finite(joint.lower), finite(joint.upper),
             joint.unit, joint.effort, joint.torque_unit, joint.velocity)
            for joint in robot.joints
        ),
    ]  # fmt: skip


@to_rows.register(Replication)
def _replication(result: Replication) -> list[Row]:
    header = ("table", "row", "column", "printed", "computed", "outcome", "erratum")
    return [
        header,
        *(
            (check.table, check.row, check.column, check.printed, check.computed,
             check.outcome.value, check.erratum)
            for check in result.checks
        ),
    ]  # fmt: skip


def _convention_rows(analysis: Analysis) -> list[Row]:
    task, reduced, limits = analysis.task, analysis.reduced, analysis.limits
    gravity, payload = analysis.conditions.gravity.tolist(), analysis.conditions.payload
    return [
        ("convention", "robot", "", analysis.robot.name, "", ""),
        ("convention", "tip", "", analysis.robot.tip, "", ""),
        ("convention", "axes", "", task.axes, "", ""),
        ("convention", "task", "", str(task), "", ""),
        ("convention", "length", "m", task.length if task.moment_rows else "", "", ""),
        ("convention", "limits", "", _source(limits), "", ""),
        *(("convention", f"gravity_{axis}", "m/s²", g, "", "")
          for axis, g in zip("xyz", gravity, strict=True)),
        ("convention", "payload", "kg", 0.0 if payload is None else payload.mass, "", ""),
        ("convention", "rtol", "", reduced.rtol, "", ""),
        ("convention", "wary", "", analysis.wary, "", ""),
        ("verdict", "verdict", "", "", analysis.verdict.value, ""),
        ("jacobian", "rank", "", reduced.rank, reduced.rank_after, ""),
        ("jacobian", "margin", "", _healthy_margin(analysis), analysis.margin, ""),
        ("jacobian", "relative_manipulability", "", 1.0,
         finite(analysis.relative_manipulability), ""),
    ]  # fmt: skip


def _healthy_margin(analysis: Analysis) -> float:
    largest = analysis.reduced.sigma_max
    return analysis.reduced.healthy.s[-1] / largest if largest > 0.0 else 0.0


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
            rows += _changes("velocity at impact", robot.names, units, velocity.before,
                             impact.after)  # fmt: skip
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
    if velocity is not None and (impact := analysis.impact) is not None:
        rows += _changes("tip velocity at impact", names, units, velocity.tip_before,
                         impact.tip_after)  # fmt: skip
    return rows
