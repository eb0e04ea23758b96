"""Tables of a timeline."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.core.faults import FaultMode
from ftforce.report import text
from ftforce.report.measures import MARGIN
from ftforce.report.text import ratio, share, size
from ftforce.report.timeline import timeline_sentence
from ftforce.show.tables.analysis import (
    conditions_facts,
    force_fact,
    friction_facts,
    task_facts,
)
from ftforce.show.tables.parts import (
    ABOVE_HEALTHY,
    HEALTHY_ROW,
    amount,
    arm_facts,
    facts,
    listing,
    percent_kept,
    spaced,
    verdict_text,
    warning_lines,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.show.tables.parts import TitledTable
    from ftforce.trajectory.timeline import Timeline, WorstInstant

_MORE = 1.005  # shown as more than 100 %
MOST_SETS = 40
"""Maximum number of fault sets in a timeline's table, worst first."""


def timeline_view(timeline: Timeline, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a timeline, with the ``most`` worst fault sets."""
    return spaced(
        facts(_situation(timeline)),
        _sets(timeline, most),
        _capabilities(timeline, most),
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
        *arm_facts(robot.name, robot),
        ("Joints", robot.numbered()),
        *task_facts(timeline.task),
        *text.joint_kinds(timeline.scale),
        ("Path", f"{timeline.course} (points in the root's axes)"),
        ("Start", timeline.start),
        force_fact(timeline.task, timeline.force),
        ("Capability", f"the largest force that can be commanded {where}"),
        *conditions_facts(timeline.conditions),
        *(friction_facts(timeline.question) if timeline.mode is FaultMode.FREE else []),
        ("Limits", counted),
        ("Instants", f"{len(timeline.t):,} from 0 to {timeline.t[-1]:g} s"),
    ]


def _sets(timeline: Timeline, most: int) -> TitledTable:
    instants = timeline.worst()
    ranked = list(zip(map(str, timeline.ranks()), instants, strict=True))[:most]
    result = listing(
        f"The worst instant of each fault set ({timeline.mode}), worst set first",
        [_row(timeline, rank, worst) for rank, worst in (*ranked, ("", timeline.healthy_worst))],
        left=3,
        folded=(2, 3),
    )
    result.caption = (
        "rank: by verdict, not tolerated, jump, margin; equal ranks: a tie\n"
        f"not tolerated: of the instants; {HEALTHY_ROW}: healthy arm"
    )
    if timeline.force is not None:
        result.caption += "\nkept: share of the force that is still exerted along it"
    if len(instants) > most:
        result.caption += f"\n{len(instants) - most} more sets are not shown (--top)"
    return result


def _row(timeline: Timeline, rank: str, worst: WorstInstant) -> Iterator[tuple[str, str | Text]]:
    yield "rank", rank
    yield from _set(timeline, worst)
    yield "verdict", verdict_text(worst.verdict)
    yield "not tol.\n[%]", share(worst.not_tolerated)
    yield "at", f"{worst.time:g} s"
    if timeline.force is not None:
        jump = "–" if math.isnan(worst.jump) else size(worst.jump)
        yield f"jump\n[{timeline.task.size_unit}]", jump
        yield "kept\n[%]", percent_kept(worst.kept)
    yield MARGIN.symbol, ratio(worst.margin)


def _set(timeline: Timeline, worst: WorstInstant) -> Iterator[tuple[str, str]]:
    names = timeline.robot.names
    yield "set", text.set_of(worst.faults.joints) if worst.faults else HEALTHY_ROW
    yield "joints", ", ".join(names[i] for i in worst.faults.joints)


def _capabilities(timeline: Timeline, most: int) -> TitledTable:
    instants = (*timeline.worst()[:most], timeline.healthy_worst)
    unit = text.unit_of_size(timeline.task, timeline.direction)
    result = listing(
        f"Smallest capability over time [{unit}], sets in the same order",
        [_capability(timeline, worst) for worst in instants],
        left=2,
        folded=(1,),
    )
    result.caption = "kept: commanded, of that of the healthy arm at the same time"
    if any(math.isnan(x) for worst in instants for x in (worst.capability, worst.held)):
        result.caption += "\n–: no force in this direction holds the arm"
    if any(worst.capability_kept > _MORE for worst in instants):
        result.caption += f"\n{ABOVE_HEALTHY}"
    return result


def _capability(timeline: Timeline, worst: WorstInstant) -> Iterator[tuple[str, str]]:
    yield from _set(timeline, worst)
    yield "commanded", _least(worst.capability)
    yield "kept [%]", percent_kept(worst.capability_kept)
    yield "at", f"{worst.capability_time:g} s"
    yield "held", _least(worst.held)
    yield "at ", f"{worst.held_time:g} s"


def _least(capability: float) -> str:
    return amount(capability, 2)
