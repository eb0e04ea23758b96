"""Tables of a timeline."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.report import text
from ftforce.report.measures import MARGIN
from ftforce.report.text import ratio, size
from ftforce.report.timeline import timeline_sentence
from ftforce.show.tables.analysis import (
    arm_fact,
    conditions_facts,
    force_fact,
    task_facts,
    tip_facts,
)
from ftforce.show.tables.parts import amount, facts, listing, spaced, verdict_text, warning_lines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.show.tables.parts import TitledTable
    from ftforce.trajectory.timeline import Timeline, WorstInstant

MOST_SETS = 40
"""Maximum number of fault sets in a timeline's table, worst first."""


def timeline_view(timeline: Timeline, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a timeline, with the ``most`` worst fault sets."""
    return spaced(
        facts(_situation(timeline)),
        _sets(timeline, most),
        facts([("Assumed", note) for note in timeline.notes]) if timeline.notes else None,
        warning_lines(timeline.warnings),
        Text(timeline_sentence(timeline), style="bold"),
    )


def _situation(timeline: Timeline) -> list[tuple[str, str]]:
    robot = timeline.robot
    where = "in the weakest direction"
    if timeline.direction is not None:
        where = f"along {text.vector_in_words(timeline.direction)}"
    bearing = timeline.capability_limits
    counted = "not enforced" if timeline.limits is None else timeline.limits.source
    if bearing is not None and timeline.limits is None:
        counted = f"none for jump and verdict, {bearing.source} for the capability"
    return [
        arm_fact(robot.name, robot.n, robot.base, robot.tip),
        *tip_facts(robot),
        ("Joints", robot.numbered()),
        *task_facts(timeline.task),
        ("Path", f"{timeline.course} (points in the root's axes)"),
        ("Start", timeline.start),
        force_fact(timeline.task, timeline.force),
        ("Capability", f"the largest force that can be commanded {where}"),
        *conditions_facts(timeline.conditions),
        ("Limits", counted),
        ("Instants", f"{len(timeline.t):,} from 0 to {timeline.t[-1]:g} s"),
    ]


def _sets(timeline: Timeline, most: int) -> TitledTable:
    unit = text.unit_of_size(timeline.task, timeline.direction)
    instants = timeline.worst()
    result = listing(
        f"The worst instant of each fault set ({timeline.mode}), worst set first",
        [_row(timeline, worst, unit) for worst in instants[:most]],
        left=2,
        folded=(1, 5),
    )
    result.caption = f"least: smallest capability over time, {unit}"
    if len(instants) > most:
        result.caption += f"; {len(instants) - most} more sets are not shown (--top)"
    return result


def _row(timeline: Timeline, worst: WorstInstant, unit: str) -> Iterator[tuple[str, str | Text]]:
    names = timeline.robot.names
    yield "set", text.set_of(worst.faults.joints)
    yield "joints", ", ".join(names[i] for i in worst.faults.joints)
    yield "at", f"{worst.time:g} s"
    jump = "–" if math.isnan(worst.jump) else size(worst.jump)
    yield f"jump [{timeline.task.size_unit}]", jump
    yield MARGIN.symbol, ratio(worst.margin)
    yield "verdict", verdict_text(worst.verdict)
    least = "falls" if math.isnan(worst.capability) else amount(worst.capability, 2)
    yield f"least [{unit}]", least
    yield "at ", f"{worst.capability_time:g} s"
