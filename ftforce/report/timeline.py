"""Timelines as text, JSON and table rows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.report import text
from ftforce.report.parts import (
    Document,
    Row,
    arm_part,
    conventions_part,
    finite,
    limits_part,
    limits_source,
    listed,
    modes_part,
    task_columns,
)
from ftforce.report.text import joined, percent, ratio, size

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix
    from ftforce.core.faults import FaultSet
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.timeline import Timeline, WorstInstant


def timeline_sentence(timeline: Timeline) -> str:
    """Describe the worst fault set and its worst instant."""
    worst = timeline.worst()[0]
    name = faults_in_words(timeline.robot, worst.faults)
    when = f"Worst: {name}, at {worst.time:g} s"
    if worst.verdict is Verdict.TOLERATED:
        kept = "every force" if timeline.force is None else "the force"
        return (
            f"Tolerated: whichever of these faults happens, and when, {kept} can be kept. The "
            f"smallest margin, {ratio(worst.margin)}, is left by {name} at {worst.time:g} s."
        )
    share = f"At {percent(worst.not_tolerated)} of all instants it is not tolerated"
    if worst.verdict is Verdict.BORDERLINE:
        return f"Borderline. {when}, with a margin of {ratio(worst.margin)}."
    return f"Not tolerated. {when}: {jump_in_words(timeline, worst)}. {share}."


def jump_in_words(timeline: Timeline, worst: WorstInstant) -> str:
    """Describe what is lost at the worst instant."""
    if timeline.force is None:
        return "a direction of force is lost"
    if math.isnan(worst.jump):
        return "nothing holds the arm"
    unit = timeline.task.size_unit
    return f"the force jumps by {size(worst.jump)} {unit}"


def faults_in_words(robot: Robot, faults: FaultSet) -> str:
    """Format the joints of a set: ``2 joint2 and 4 joint4 locked``."""
    names = joined(f"{i + 1} {robot.names[i]}" for i in faults.joints)
    return f"{names} {faults.faults[0].mode}"


def timeline_document(timeline: Timeline) -> Document:
    """Return a timeline as a JSON document: each fault set at its worst, and all values."""
    names, task = timeline.robot.names, timeline.task
    limits = timeline.limits
    bearing = timeline.capability_limits
    return {
        "robot": arm_part(timeline.robot),
        "conventions": conventions_part(task, timeline.rtol, timeline.wary, timeline.conditions),
        "course": timeline.course,
        "start": {"q": timeline.q[0].tolist(), "source": timeline.start},
        "mode": timeline.mode.value,
        "faults": timeline.largest,
        "force": listed(timeline.force),
        "direction": listed(timeline.direction),
        "limits": None if limits is None else limits_part(names, limits),
        "capability_limits": None if bearing is None else limits_part(names, bearing),
        "sets": [
            {**modes_part(names, worst.faults), **_worst(worst)} for worst in timeline.worst()
        ],
        "times": timeline.t.tolist(),
        "columns": [modes_part(names, faults) for faults in timeline.sets],
        "jump": _rows(timeline.jump),
        "margin": _rows(timeline.margin),
        "capability": _rows(timeline.capability),
        "summary": timeline_sentence(timeline),
        "notes": list(timeline.notes),
        "warnings": list(timeline.warnings),
    }


def _worst(worst: WorstInstant) -> Document:
    return {
        "time": worst.time,
        "jump": finite(worst.jump),
        "margin": worst.margin,
        "verdict": worst.verdict.value,
        "not_tolerated": worst.not_tolerated,
        "capability": finite(worst.capability),
        "capability_time": worst.capability_time,
    }


def _rows(values: Matrix) -> list[list[float | None]]:
    return [[finite(x) for x in row] for row in values.tolist()]


def timeline_rows(timeline: Timeline) -> list[Row]:
    """Return a timeline as table rows, one per instant and fault set."""
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
