"""Tables of a timeline."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce import words
from ftforce.history_words import timeline_sentence
from ftforce.show.analysis import conditions_facts
from ftforce.show.tables import facts, spaced, table, verdict_text, warning_lines
from ftforce.words import number, ratio, size

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.fault_timeline import Timeline, WorstInstant
    from ftforce.show.tables import TitledTable

MOST_SETS = 40
"""How many fault sets a timeline's table shows, worst first."""


def timeline_view(timeline: Timeline, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a timeline, with the ``most`` worst fault sets."""
    return spaced(
        facts(_situation(timeline)),
        _sets(timeline, most),
        warning_lines(timeline.warnings),
        Text(timeline_sentence(timeline), style="bold"),
    )


def _situation(timeline: Timeline) -> list[tuple[str, str]]:
    robot, task = timeline.robot, timeline.task
    length = f", characteristic length {task.length:g} m" if task.moment_rows else ""
    force = "every direction (none given)"
    if timeline.force is not None:
        parts = zip(timeline.force.tolist(), task.components, task.units, strict=True)
        force = ", ".join(f"{name} {number(x)} {unit}" for x, name, unit in parts)
    where = "in the weakest direction"
    if timeline.direction is not None:
        where = f"along {words.vector_in_words(timeline.direction)}"
    bearing = timeline.capability_limits
    counted = "none are counted" if timeline.limits is None else timeline.limits.source
    if bearing is not None and timeline.limits is None:
        counted = f"none for jump and verdict, {bearing.source} for the capability"
    return [
        ("Robot", f"{robot.name}: {robot.n} joints, {robot.base} → {robot.tip}"),
        ("Joints", robot.numbered()),
        ("Axes", f"{task.axes}: vectors are in the axes of {words.axes_in_words(task)}"),
        ("Task", f"{task} ({', '.join(task.components)}){length}"),
        ("Path", f"{timeline.course} (points in the root's axes)"),
        ("Start", timeline.start),
        ("Force", force),
        ("Capability", f"the largest force that can be commanded {where}"),
        *conditions_facts(timeline.conditions),
        ("Limits", counted),
        ("Instants", f"{len(timeline.t):,} from 0 to {timeline.t[-1]:g} s"),
    ]


def _sets(timeline: Timeline, most: int) -> TitledTable:
    unit = words.unit_of_size(timeline.task, timeline.direction)
    of_jump = timeline.task.size_unit
    instants = timeline.worst()
    result = table(
        f"The worst instant of each fault set ({timeline.mode}), worst set first",
        "set", "joints", "at", f"jump [{of_jump}]", "margin", "verdict",
        f"least [{unit}]", "at ", left=2, folded=(1, 5),
    )  # fmt: skip
    for worst in instants[:most]:
        result.add_row(*_row(timeline, worst))
    result.caption = f"least: smallest capability over time, {unit}"
    if len(instants) > most:
        result.caption += f"; {len(instants) - most} more sets are not shown (--top)"
    return result


def _row(timeline: Timeline, worst: WorstInstant) -> tuple[str | Text, ...]:
    names = ", ".join(timeline.robot.names[i] for i in worst.faults.joints)
    jump = "–" if math.isnan(worst.jump) else size(worst.jump)
    least = size(worst.capability)
    if math.isnan(worst.capability):
        least = "falls"
    elif math.isinf(worst.capability):
        least = "no limit"
    numbers = "{" + ", ".join(str(i + 1) for i in worst.faults.joints) + "}"
    return (
        numbers, names, f"{worst.time:g} s", jump, ratio(worst.margin),
        verdict_text(worst.verdict), least, f"{worst.capability_time:g} s",
    )  # fmt: skip
