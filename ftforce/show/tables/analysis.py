"""Tables of an analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from ftforce.analysis.analyze import load_without_force
from ftforce.core.faults import FaultMode
from ftforce.errors import listed, printable
from ftforce.report import analysis as sentences
from ftforce.report import text
from ftforce.report.measures import MEASURES
from ftforce.report.text import number, ratio
from ftforce.show.tables.joints import (
    by_joint,
    by_unit,
    motion_table,
    torque_table,
    unit_torque_tables,
    velocity_tables,
)
from ftforce.show.tables.parts import (
    VERDICT_STYLE,
    Components,
    TitledTable,
    arm_facts,
    defined,
    facts,
    listing,
    spaced,
    state_text,
    table,
    vectors,
    warning_lines,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rich.console import RenderableType

    from ftforce.analysis.analyze import Analysis
    from ftforce.analysis.conditions import Conditions
    from ftforce.analysis.question import Question
    from ftforce.core.bounded_remap import BoundedRemap
    from ftforce.core.changes import ForceChange
    from ftforce.core.faults import FaultSet
    from ftforce.core.limits import Limits
    from ftforce.core.remap import Remap
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot


def analysis_view(analysis: Analysis, *, degrees: bool = False) -> RenderableType:
    """Return the tables of an analysis; with ``degrees``, revolute joint positions in degrees."""
    force, torque = analysis.force, analysis.torque
    return spaced(
        facts(situation(analysis)),
        torque_table(analysis, torque, degrees=degrees)
        if torque
        else unit_torque_tables(analysis, degrees=degrees),
        motion_table(analysis),
        velocity_tables(analysis),
        _tip(analysis.task, force) if force else _unit_tip(analysis),
        facts(_measures(analysis)),
        warning_lines(analysis.warnings),
        Text(sentences.verdict_sentence(analysis), style=VERDICT_STYLE[analysis.verdict]),
    )


def situation(analysis: Analysis) -> list[tuple[str, str]]:
    """Return the question: robot, axes, task, posture, faults, conditions."""
    robot = analysis.robot
    return [
        *arm_facts(robot.name, robot),
        *task_facts(analysis.task),
        *text.joint_kinds(analysis.scale),
        ("Posture", analysis.posture.source),
        _faults(robot, analysis.faults),
        *friction_facts(analysis.question, analysis.faults.free),
        *conditions_facts(analysis.conditions),
        ("Limits", _limits(analysis)),
        ("Sign", "force by the robot on its environment; motor torque = rnea + JᵀF"),
    ]


def friction_facts(
    question: Question, joints: Sequence[int] | None = None
) -> list[tuple[str, str]]:
    """Return the friction of joints that swing freely; ``None`` for all of them in turn."""
    if joints is not None and not joints:
        return []
    friction = question.friction.in_words(question.robot, joints)
    own = "" if question.given_friction else "; --friction sets it"
    return [("Friction", f"{friction}{own}")]


def task_facts(task: Task, vectors: str = "vectors") -> list[tuple[str, str]]:
    """Return the axes and components of a task."""
    length = f", characteristic length {task.length:g} m" if task.moment_rows else ""
    return [
        ("Axes", f"{task.axes}: {vectors} are in the axes of {text.axes_in_words(task)}"),
        ("Task", f"{task} ({', '.join(task.components)}){length}"),
    ]


def force_fact(task: Task, force: Iterable[float] | None) -> tuple[str, str]:
    """Return the requested force."""
    if force is None:
        return "Force", "every direction (none given)"
    return "Force", text.with_units(task.components, force, task.units)


def _limits(analysis: Analysis) -> str:
    locked = analysis.faults.in_mode(FaultMode.LOCKED)
    return limits_in_words(analysis.limits, analysis.unknown_limits, analysis.robot, locked)


def _faults(robot: Robot, faults: FaultSet) -> tuple[str, str]:
    if any(fault.mode is not FaultMode.LOCKED for fault in faults.faults):
        parts = (f"{robot.names[fault.joint]} {fault}" for fault in faults.faults)
        return "Faults", f"{faults} {', '.join(parts)}"
    names = ", ".join(robot.names[i] for i in faults.joints)
    return "Locked", f"{faults} {names}" if names else "none"


def _down(conditions: Conditions) -> str:
    """Return which axis of the root points down, if one does."""
    g = conditions.gravity
    along = np.flatnonzero(g)
    if len(along) != 1:
        return ""
    return f": {'-' if g[along[0]] < 0.0 else '+'}{'xyz'[along[0]]} points down"


def conditions_facts(conditions: Conditions) -> list[tuple[str, str]]:
    """Return gravity, payload and motion in words."""
    gravity = ", ".join(f"{x:g}" for x in conditions.gravity.tolist())
    own = " (the model's)" if conditions.is_model_gravity else _down(conditions)
    facts = [("Gravity", f"({gravity}) m/s² in the root's axes{own}")]
    if conditions.payload is not None:
        place = "in the tool's axes" if conditions.payload.offset.any() else "at the tip"
        facts.append(("Payload", f"{conditions.payload} {place}"))
    if conditions.drives is not None:
        facts.append(("Drives", f"{conditions.drives} counted"))
    return facts


def limits_in_words(
    limits: Limits | None, unknown: tuple[int, ...], robot: Robot, locked: tuple[int, ...]
) -> str:
    """Return which limits apply, and which are unknown, in words."""
    if limits is None:
        return "not enforced (--limits urdf enforces them)"
    motors = [robot.names[i] for i in unknown if i not in locked]
    brakes = [robot.names[i] for i in unknown if i in locked]
    missing = [f"motors of {listed(motors)}"] if motors else []
    missing += [f"brakes of {listed(brakes)}"] if brakes else []
    unknown_ones = f"; unknown and ignored: {'; '.join(missing)}" if missing else ""
    return printable(limits.source) + unknown_ones


def _tip(task: Task, force: ForceChange) -> TitledTable:
    columns = {"before": force.before}
    if force.after is not None and force.jump is not None:
        columns |= {"after": force.after, "jump": force.jump}
    if force.requested is not None and text.is_noticeable(force.unsupported):
        beyond = {"requested": force.requested, "unsupported": force.unsupported}
        columns = beyond | columns
    norms = [("|force|", "N", task.force_rows), ("|moment|", "N·m", task.moment_rows)]
    components = Components(task.components, task.units, norms)
    return vectors("Force at the tip", components, columns, digits=2)


def _unit_tip(analysis: Analysis) -> TitledTable:
    task = analysis.task
    sizes = [("jump\n[N]", task.force_rows), ("jump\n[N·m]", task.moment_rows)]
    rows = []
    for (force, _), name, unit in zip(
        analysis.unit_forces, task.components, task.units, strict=True
    ):
        beyond = "*" if text.is_noticeable(force.unsupported) else ""
        assert force.after is not None  # unit forces ignore weight and limits
        assert force.jump is not None
        after = (number(x, 3) for x in force.after.tolist())
        jumps = (
            (title, number(float(np.linalg.norm(force.jump[list(own)])), 3))
            for title, own in sizes
            if own
        )
        asked = ("requested", f"{name} 1 {unit}{beyond}")
        rows.append([asked, *zip(task.components, after, strict=True), *jumps])
    result = listing("Force at the tip after the fault, for each unit force", rows)
    if any(text.is_noticeable(force.unsupported) for force, _ in analysis.unit_forces):
        result.caption = "* partly beyond even the healthy arm; that part is not counted as a jump"
    return result


def _measures(analysis: Analysis) -> list[tuple[str, str]]:
    reduced, task = analysis.reduced, analysis.task
    tolerances = f"rank tolerance {reduced.rtol:g}, borderline below {analysis.wary:g}"
    (margin, value), *others = ((one.label, defined(one.value(analysis))) for one in MEASURES)
    measures = [
        (margin, f"{value}  ({tolerances})"),
        ("Rank", f"{reduced.rank_after} of {reduced.m} (healthy arm: {reduced.rank})"),
        *others,
        ("Lost directions", text.lost_directions(task, list(analysis.lost_directions))),
        ("Tip force error", _force_error(analysis)),
    ]
    if (bounded := analysis.bounded) is not None and bounded.F_after is not None:
        measures += _limit_measures(analysis, bounded)
    return [*measures, *_load_measures(analysis)]


def _limit_measures(analysis: Analysis, bounded: BoundedRemap) -> list[tuple[str, str]]:
    names = analysis.robot.names
    measures = []
    if analysis.limits is not None:
        measures.append(("At its limit", ", ".join(names[j] for j in bounded.binding) or "none"))
    if analysis.force is not None and bounded.nearest.F.any():
        share = sentences.share_in_words(bounded.share).removesuffix(" in its own direction")
        measures.append(("Share in its direction", share))
    return measures


def _load_measures(analysis: Analysis) -> list[tuple[str, str]]:
    """Return brake loads, contributions of the joints, and torque that exerts no force."""
    robot, torque = analysis.robot, analysis.torque
    locked = analysis.faults.in_mode(FaultMode.LOCKED)
    known = "force part" if analysis.conditions.payload is None else "without the arm's weight"
    kind = "" if analysis.rnea.is_known else f" ({known})"
    if torque is None:
        if not analysis.rnea.is_known or not locked or not analysis.can_stand_still:
            return []
        return [("Brake load, no force", by_joint(robot, load_without_force(analysis), locked))]
    measures = []
    if torque.brake_load is not None:
        measures.append((f"Brake load{kind}", by_joint(robot, torque.brake_load, locked)))
    if (shares := analysis.force_contributions) is not None:
        parts = zip(robot.names, shares.tolist(), strict=True)
        shown = ", ".join(f"{name} {number(share)}" for name, share in parts)
        measures.append(("Contributions", shown))
    if analysis.force is not None and analysis.force.requested is None:
        moved = by_unit(robot, torque.self_motion)
        note = f"norm; exerts no force; {analysis.inverse} inverse"
        measures.append(("Torque into self-motion", f"{moved} ({note})"))
    return measures


def _force_error(analysis: Analysis) -> str:
    task = analysis.task
    if analysis.reduced.rank_after == 0:
        return "– (no direction remains)"
    unit = text.unit_of_size(task)
    units = sorted({joint.torque_unit for joint in analysis.robot.joints})
    per = units[-1]
    if analysis.scale.is_mixed:
        per = f"N (N·m divided by {analysis.scale.length:g} m)"
    return f"up to {ratio(analysis.force_error)} {unit} per {per} of torque error"


def remap_view(result: Remap) -> RenderableType:
    """Return the tables of a remap from the array core; joints and rows count from 0."""
    joints = table("Torque remap", "column", "state", "before", "after", "brake load", left=2)
    columns = (result.tau, result.U, result.brake_load)
    locked = result.reduced.locked.tolist()
    for i, failed in enumerate(locked):
        values = [number(float(x[i]), 4) for x in columns]
        joints.add_row(str(i), state_text(failed), *(values if failed else [*values[:2], ""]))
    force = table("Force", "row", "before", "after", "jump")
    for i in range(result.reduced.m):
        cells = (number(float(x[i]), 4) for x in (result.F, result.F_after, result.jump))
        force.add_row(str(i), *cells)
    norm = facts([("Jump norm", number(result.jump_norm, 4))])
    return spaced(joints, force, norm)
