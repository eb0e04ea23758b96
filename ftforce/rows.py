"""Results as rows of a table with names and units: what a CSV file holds."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any, TypeAlias

from ftforce.analysis import Analysis
from ftforce.documents import finite
from ftforce.errors import InputError
from ftforce.fault_census import Census
from ftforce.replicate import Replication
from ftforce.robot import Robot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.arrays import Vector

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
        "fault_set", "locked", "size", "verdict", "jump_norm [N]", "moment_jump_norm [N·m]",
        *(f"jump_{name} [{unit}]" for name, unit in zip(task.components, task.units, strict=True)),
        "margin", "relative_manipulability", "rank_after", "rank_lost",
        "axes", "task", "length [m]", "rtol", "wary",
    )  # fmt: skip
    conventions = (task.axes, str(task), task.length if task.moment_rows else "", census.rtol,
                   census.wary)  # fmt: skip
    rows = [
        (
            str(report.faults),
            " ".join(census.robot.names[i] for i in report.faults.joints),
            len(report.faults),
            report.verdict.value,
            report.jump_norm,
            report.moment_jump_norm,
            *([""] * task.m if report.jump is None else report.jump.tolist()),
            report.margin,
            finite(report.relative_manipulability),
            report.rank_after,
            report.rank_lost,
            *conventions,
        )
        for report in census.sets
    ]
    return [header, *rows]


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
    task, reduced = analysis.task, analysis.reduced
    return [
        ("convention", "robot", "", analysis.robot.name, "", ""),
        ("convention", "tip", "", analysis.robot.tip, "", ""),
        ("convention", "axes", "", task.axes, "", ""),
        ("convention", "task", "", str(task), "", ""),
        ("convention", "length", "m", task.length if task.moment_rows else "", "", ""),
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
    rows: list[Row] = []
    for joint, q in zip(robot.joints, analysis.posture.q.tolist(), strict=True):
        rows.append(("position", joint.name, joint.unit, q, q, 0.0))
    for joint in robot.joints:
        state = "locked" if joint.name in analysis.locked else "healthy"
        rows.append(("state", joint.name, "", "healthy", state, ""))
    if (torque := analysis.torque) is not None:
        units = [joint.torque_unit for joint in robot.joints]
        rows += _changes("torque", robot.names, units, torque.before, torque.after)
        for i in analysis.faults.joints:
            rows.append(
                ("brake_load", robot.names[i], units[i], "", float(torque.brake_load[i]), "")
            )
    if (velocity := analysis.velocity) is not None:
        units = [f"{joint.unit}/s" for joint in robot.joints]
        rows += _changes("velocity", robot.names, units, velocity.before, velocity.after)
    return rows


def _changes(
    quantity: str, names: Sequence[str], units: Sequence[str], before: Vector, after: Vector
) -> list[Row]:
    values = zip(names, units, before.tolist(), after.tolist(), strict=True)
    return [(quantity, name, unit, b, a, a - b) for name, unit, b, a in values]


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
    return rows
