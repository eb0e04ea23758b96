"""Tables of one analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from ftforce import words
from ftforce.show.tables import (
    VERDICT_STYLE,
    Components,
    TitledTable,
    defined,
    facts,
    spaced,
    state_text,
    table,
    vectors,
    warning_lines,
)
from ftforce.words import number, ratio

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.analysis import Analysis
    from ftforce.arrays import Vector
    from ftforce.changes import ForceChange, TorqueChange
    from ftforce.robot import Robot
    from ftforce.task import Task


def analysis_view(analysis: Analysis, *, degrees: bool = False) -> RenderableType:
    """Return the tables of one analysis; positions of turning joints in degrees if asked."""
    force, torque = analysis.force, analysis.torque
    return spaced(
        facts(_situation(analysis)),
        _joints(analysis, torque, degrees=degrees)
        if torque
        else _unit_torques(analysis, degrees=degrees),
        _velocities(analysis),
        _tip(analysis.task, force) if force else _unit_tip(analysis),
        facts(_measures(analysis)),
        warning_lines(analysis.warnings),
        Text(words.verdict_sentence(analysis), style=VERDICT_STYLE[analysis.verdict]),
    )


def _situation(analysis: Analysis) -> list[tuple[str, str]]:
    robot, task = analysis.robot, analysis.task
    length = f", characteristic length {task.length:g} m" if task.moment_rows else ""
    failed = ", ".join(analysis.locked)
    return [
        ("Robot", f"{robot.name}: {robot.n} joints, {robot.base} → {robot.tip}"),
        ("Tip", f"{robot.tip} ({robot.tip_source})"),
        ("Axes", f"{task.axes}: vectors are in the axes of {words.axes_in_words(task)}"),
        ("Task", f"{task} ({', '.join(task.components)}){length}"),
        ("Posture", analysis.posture.source),
        ("Locked", f"{analysis.faults} {failed}" if failed else "none"),
        ("Sign", "force by the robot on its environment; torques are its force part"),
    ]


def _joints(analysis: Analysis, torque: TorqueChange, *, degrees: bool) -> TitledTable:
    shares = () if analysis.force_contributions is None else analysis.force_contributions.tolist()
    angle = "deg" if degrees else "rad"
    result = table(
        "Joints", "#", "joint", "state", f"q\n[{angle}]", "torque\nbefore\n[N·m]", "\nafter\n[N·m]",
        "\nchange\n[N·m]", "limit\n[N·m]", "used\n[%]", "contri-\nbution", left=3, folded=(1,),
    )  # fmt: skip
    positions = _positions(analysis.robot, analysis.posture.q, degrees=degrees)
    rows = zip(
        analysis.robot.joints,
        positions,
        torque.before.tolist(),
        torque.after.tolist(),
        shares,
        strict=True,
    )
    for joint, q, before, after, share in rows:
        unit = " N" if joint.type == "prismatic" else ""
        used = "?" if joint.effort is None else f"{100.0 * abs(after) / joint.effort:.0f}"
        result.add_row(
            str(joint.number),
            joint.name,
            state_text(joint.name in analysis.locked),
            q,
            number(before) + unit,
            number(after) + unit,
            number(after - before) + unit,
            "unknown" if joint.effort is None else f"{joint.effort:g}{unit}",
            used,
            number(share),
        )
    return result


def _positions(robot: Robot, q: Vector, *, degrees: bool) -> list[str]:
    shown = []
    for joint, value in zip(robot.joints, q.tolist(), strict=True):
        if joint.type == "prismatic":
            shown.append(f"{number(value, 3)} m")
        else:
            shown.append(number(value * 57.29577951308232, 2) if degrees else number(value, 3))
    return shown


def _velocities(analysis: Analysis) -> RenderableType | None:
    velocity, shares = analysis.velocity, analysis.velocity_contributions
    if velocity is None or shares is None:
        return None
    joints = table(
        "Joint velocities (Appendix A)", "#", "joint", "unit", "before", "after", "change",
        "contribution\nto tip velocity", left=3, folded=(1,),
    )  # fmt: skip
    before, after = velocity.before.tolist(), velocity.after.tolist()
    rows = zip(analysis.robot.joints, before, after, shares.tolist(), strict=True)
    for joint, b, a, share in rows:
        cells = (number(x, 4) for x in (b, a, a - b))
        name = joint.name
        joints.add_row(str(joint.number), name, f"{joint.unit}/s", *cells, number(share))
    task = analysis.task
    norms = [("|v|", "m/s", task.force_rows), ("|w|", "rad/s", task.moment_rows)]
    components = Components(task.velocity_components, task.velocity_units, norms)
    columns = {"before": velocity.tip_before, "after": velocity.tip_after, "jump": velocity.jump}
    return spaced(joints, vectors("Tip velocity", components, columns, digits=5))


def _tip(task: Task, force: ForceChange) -> TitledTable:
    columns = {"before": force.before, "after": force.after, "jump": force.jump}
    if force.requested is not None and words.is_noticeable(force.unsupported):
        beyond = {"requested": force.requested, "unsupported": force.unsupported}
        columns = beyond | columns
    norms = [("|force|", "N", task.force_rows), ("|moment|", "N·m", task.moment_rows)]
    components = Components(task.components, task.units, norms)
    return vectors("Force at the tip", components, columns, digits=2)


def _unit_torques(analysis: Analysis, *, degrees: bool) -> TitledTable:
    task = analysis.task
    few = task.m <= 3
    digits = 3 if few else 2  # six components need the room
    titles = [f"{name}\n1 {unit}" for name, unit in zip(task.components, task.units, strict=True)]
    angle = "deg" if degrees else "rad"
    result = table(
        "Motor torque [N·m] for each unit force: before, → after where it changes",
        "#", "joint", *(["state"] if few else []), f"q\n[{angle}]", *titles,
        left=3 if few else 2, folded=(1,),
    )  # fmt: skip
    positions = _positions(analysis.robot, analysis.posture.q, degrees=degrees)
    for i, joint in enumerate(analysis.robot.joints):
        unit = " N" if joint.type == "prismatic" else ""
        locked = joint.name in analysis.locked
        after = "→0" if locked else ""
        cells = [number(float(t.before[i]), digits) + unit + after for _, t in analysis.unit_forces]
        state = [state_text(locked)] if few else []
        result.add_row(str(joint.number), joint.name, *state, positions[i], *cells)
    return result


def _unit_tip(analysis: Analysis) -> TitledTable:
    task = analysis.task
    sizes = [("jump\n[N]", task.force_rows), ("jump\n[N·m]", task.moment_rows)]
    sizes = [(title, rows) for title, rows in sizes if rows]
    result = table(
        "Force at the tip after the fault, for each unit force",
        "asked", *task.components, *(title for title, _ in sizes),
    )  # fmt: skip
    for (force, _), name, unit in zip(
        analysis.unit_forces, task.components, task.units, strict=True
    ):
        beyond = "*" if words.is_noticeable(force.unsupported) else ""
        after = [number(x, 3) for x in force.after.tolist()]
        jumps = [number(float(np.linalg.norm(force.jump[list(rows)])), 3) for _, rows in sizes]
        result.add_row(f"{name} 1 {unit}{beyond}", *after, *jumps)
    if any(words.is_noticeable(force.unsupported) for force, _ in analysis.unit_forces):
        result.caption = "* partly beyond even the healthy arm; that part is no jump"
    return result


def _measures(analysis: Analysis) -> list[tuple[str, str]]:
    reduced, task = analysis.reduced, analysis.task
    rho = analysis.relative_manipulability
    tolerances = f"rank tolerance {reduced.rtol:g}, wary below {analysis.wary:g}"
    measures = [
        ("Margin σ_min(K)/σ_max(J)", f"{ratio(analysis.margin)}  ({tolerances})"),
        ("Rank", f"{reduced.rank_after} of {reduced.m} (healthy arm: {reduced.rank})"),
        ("Relative manipulability ρ", defined(rho)),
        ("Lost directions", words.lost_directions(task, list(analysis.lost_directions))),
        ("Tip force error", _force_error(analysis)),
    ]
    if analysis.torque is not None:
        measures.append(("Brake load (force part)", _brake_loads(analysis, analysis.torque)))
        if analysis.force is not None and analysis.force.requested is None:
            moved = _by_unit(analysis.robot, analysis.torque.self_motion)
            measures.append(("Torque into self-motion", f"{moved} (norm; exerts no force)"))
    return measures


def _force_error(analysis: Analysis) -> str:
    task = analysis.task
    if analysis.reduced.rank_after == 0:
        return "– (no direction is left)"
    unit = "weighted N" if task.moment_rows and task.force_rows else task.units[0]
    sliding = any(joint.type == "prismatic" for joint in analysis.robot.joints)
    per = "N·m or N" if sliding else "N·m"
    return f"up to {ratio(analysis.force_error)} {unit} per {per} of torque error"


def _by_unit(robot: Robot, torque: Vector) -> str:
    """Say the norm of torques, those of prismatic joints apart: units are never mixed."""
    parts = []
    for unit in ("N·m", "N"):
        own = [i for i, joint in enumerate(robot.joints) if joint.torque_unit == unit]
        if own:
            parts.append(f"{number(float(np.linalg.norm(torque[own])))} {unit}")
    return " and ".join(parts)


def _brake_loads(analysis: Analysis, torque: TorqueChange) -> str:
    joints = [analysis.robot.joints[i] for i in analysis.faults.joints]
    loads = [float(torque.brake_load[joint.number - 1]) for joint in joints]
    parts = (
        f"{joint.name} {number(load)} {joint.torque_unit}"
        for joint, load in zip(joints, loads, strict=True)
    )
    return ", ".join(parts) or "none"
