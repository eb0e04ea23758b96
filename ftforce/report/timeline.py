"""Timelines as text, JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

from ftforce.analysis.question import HEALTHY
from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.report import parts, text
from ftforce.report.fields import Document, Field, Row, columns, document, plain, under, whole
from ftforce.report.measures import MARGIN
from ftforce.report.text import joined, percent, ratio, set_of, size
from ftforce.trajectory.timeline import share_of

if TYPE_CHECKING:
    from ftforce.core.faults import FaultSet
    from ftforce.core.ranks import Rank
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.timeline import Timeline, WorstInstant


_MOST_TIED = 4  # sets named in the sentence


def timeline_sentence(timeline: Timeline) -> str:
    """Describe the worst fault set and its worst instant."""
    worst, tie = timeline.worst()[0], _tied(timeline)
    name = faults_in_words(timeline.robot, worst.faults)
    when = f"Worst: {name}, at {worst.time:g} s"
    if worst.verdict is Verdict.TOLERATED:
        kept = "every force" if timeline.force is None else "the force"
        return (
            f"Tolerated: whichever of these faults happens, and when, {kept} can be kept. The "
            f"smallest margin, {ratio(worst.margin)}, is left by {name} at {worst.time:g} s{tie}."
        )
    share = f"At {percent(worst.not_tolerated)} of all instants it is not tolerated"
    if worst.verdict is Verdict.BORDERLINE:
        return f"Borderline. {when}, with a margin of {ratio(worst.margin)}{tie}."
    return f"Not tolerated. {when}: {_jump_in_words(timeline, worst)}{tie}. {share}."


def _tied(timeline: Timeline) -> str:
    """Name the sets that tie with the worst one."""
    others = [set_of(one.faults.joints) for one in timeline.worst()[1 : timeline.ranks()[0].last]]
    if len(others) > _MOST_TIED:
        others[_MOST_TIED:] = [f"{len(others) - _MOST_TIED} more"]
    return f"; tied with {joined(others)}" if others else ""


def _jump_in_words(timeline: Timeline, worst: WorstInstant) -> str:
    """Describe what is lost at the worst instant."""
    if timeline.force is None:
        return "a direction of force is lost"
    if math.isnan(worst.jump):
        return "the arm cannot be held in static equilibrium"
    unit = timeline.task.size_unit
    return f"the force jumps by {size(worst.jump)} {unit}"


def faults_in_words(robot: Robot, faults: FaultSet) -> str:
    """Format the joints of a set: ``2 joint2 and 4 joint4 locked``."""
    names = joined(f"{i + 1} {robot.names[i]}" for i in faults.joints)
    return f"{names} {faults.faults[0].mode}"


# fmt: off
_JUMP = Field("jump", "‖ΔF‖; `null` without a force, or if the arm cannot be held", parts.FORCE)
_CAPABILITY = Field("capability", "largest force that can be commanded; `null` if no known limit "
    "bounds it, or if the arm cannot be held", parts.FORCE)
_HELD = Field("held", "largest force that motors and brakes can hold; likewise", parts.FORCE)
_CAPABILITY_KEPT = Field("capability_kept", "`capability` over that of the healthy arm at the same "
    "time; `null` if unknown", "1")
_MEASURED = (_JUMP, MARGIN, _CAPABILITY, _HELD)
_OVER_TIME = tuple(replace(one, shape="N × S") for one in _MEASURED)
_SET = (
    *parts.MODES,
    Field("time", "time of the worst instant", "s"),
    _JUMP,
    Field("kept", "share of the force that is still exerted along it at the worst instant, "
        "F̂ᵀF'/F̂ᵀF̂; `null` without a force, or if the arm cannot be held", "1"),
    MARGIN,
    parts.VERDICT,
    Field("not_tolerated", "fraction of the instants at which the set is not tolerated", "1"),
    replace(_CAPABILITY, meaning=f"smallest {_CAPABILITY.meaning} over time"),
    Field("capability_time", "time of the smallest capability", "s"),
    _CAPABILITY_KEPT,
    replace(_HELD, meaning="smallest held force over time; `null` likewise"),
    Field("held_time", "time of the smallest held force", "s"),
)


class _Ranked(NamedTuple):
    """The worst instant of a set, or of the healthy arm, which has no rank."""

    rank: Rank | None
    worst: WorstInstant


def _ranked(timeline: Timeline) -> list[_Ranked]:
    return [_Ranked(*pair) for pair in zip(timeline.ranks(), timeline.worst(), strict=True)]


TIMELINE = (
    replace(parts.ROBOT, shape="as of an analysis"),
    Field("conventions", "as of an analysis", shape="as of an analysis",
        get=lambda x: parts.Asked(x.task, x.scale, x.rtol, x.wary, x.conditions),
        parts=parts.CONVENTIONS),
    Field("course", "description of the trajectory"),
    Field("start", "initial posture", get=whole, parts=(
        Field("q", "joint positions at the start", "rad, m", "n", lambda x: x.q[0]),
        Field("source", "where they come from", get="start"),
    )),
    Field("mode", "`locked` or `free`"),
    Field("faults", "size of the largest sets", get="largest"),
    Field("force", "requested force; `null` if none was given", parts.FORCE, "m"),
    Field("direction", "of the capability; `null` for the weakest", "1", "m"),
    Field("limits", "torque limits in force for jump and verdict; `null` if there are none",
        shape="as of an analysis", parts=parts.LIMITS),
    Field("capability_limits", "torque limits in force for the capability",
        shape="as of an analysis", parts=parts.LIMITS),
    Field("sets", "the worst instant of each set, worst set first", shape="list", get=_ranked,
        parts=(parts.RANK, *under("worst", _SET))),
    Field("healthy", "the baseline, no joint failed: its worst instant, and its values over time",
        get=whole, parts=(
        *under("healthy_worst", _SET),
        Field("over_time", "values at the instants", get="healthy",
            parts=tuple(replace(one, shape="N") for one in _MEASURED)),
    )),
    Field("times", "times of the instants", "s", "N", "t"),
    Field("columns", "the fault set of each column of the following arrays", shape="list of S",
        get=lambda timeline: [SimpleNamespace(faults=one) for one in timeline.sets],
        parts=parts.MODES),
    *_OVER_TIME,
    replace(parts.SUMMARY, get=timeline_sentence),
    Field("notes", "what was decided about a recording: columns, wrapped angles, smoothing with "
        "its noise and residual", shape="list"),
    parts.WARNINGS,
)
# fmt: on


def timeline_document(timeline: Timeline) -> Document:
    """Return a timeline as a JSON document: each fault set at its worst, and all values."""
    return document(TIMELINE, timeline, timeline.robot.names)


def timeline_columns(
    force_unit: str = parts.FORCE, capability_unit: str = parts.FORCE
) -> tuple[Field, ...]:
    """Return the CSV columns, with the units of the task."""
    capability_limits = "source of the limits of the capability, or `none`"
    return (
        Field("t", "time", "s"),
        parts.FAULT_SET,
        parts.FAILED,
        replace(_JUMP, unit=force_unit),
        MARGIN,
        replace(_CAPABILITY, unit=capability_unit),
        replace(_HELD, unit=capability_unit),
        _CAPABILITY_KEPT,
        parts.VERDICT,
        *parts.TASK_COLUMNS,
        parts.LIMITS_SOURCE,
        Field("capability_limits", capability_limits, get=lambda x: x.capability_limits.source),
        parts.RTOL,
        parts.WARY,
    )


def timeline_rows(timeline: Timeline) -> list[Row]:
    """Return a timeline as table rows: every instant of each fault set, then of the healthy arm."""
    names, task, healthy = timeline.robot.names, timeline.task, timeline.healthy
    fields = timeline_columns(task.size_unit, text.unit_of_size(task, timeline.direction))
    about = tuple(columns(fields[9:], timeline).values())
    rows: list[Row] = [tuple(field.heading for field in fields)]
    over_time = [field.value(timeline) for field in _MEASURED]
    values = [
        [*array.T, field.value(healthy)] for array, field in zip(over_time, _MEASURED, strict=True)
    ]
    codes = [*timeline.verdict.T, healthy.verdict]
    for j, faults in enumerate((*timeline.sets, HEALTHY)):
        joints = columns(fields[1:3], SimpleNamespace(faults=faults), names).values()
        own = [one[j] for one in values]
        own.append(share_of(own[2], healthy.capability))
        verdicts = (VERDICTS[code].value for code in codes[j].tolist())
        cells = zip(timeline.t.tolist(), *map(plain, own), verdicts, strict=True)
        rows += [(t, *joints, *found, *about) for t, *found in cells]
    return rows
