"""Tables of a census."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.core.faults import FaultMode
from ftforce.errors import listed
from ftforce.report import text
from ftforce.report.census import critical_joint
from ftforce.report.measures import MARGIN, MEASURES, RHO
from ftforce.report.text import ratio, size
from ftforce.show.tables.analysis import (
    arm_fact,
    conditions_facts,
    force_fact,
    friction_facts,
    limits_in_words,
    task_facts,
    tip_facts,
)
from ftforce.show.tables.parts import (
    ABOVE_HEALTHY,
    HEALTHY_ROW,
    TitledTable,
    amount,
    defined,
    facts,
    listing,
    percent_kept,
    spaced,
    verdict_text,
    warning_lines,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from ftforce.analysis.census import Census, JointReport
    from ftforce.analysis.fault_set import SetCapability, SetReport
    from ftforce.report.fields import Field

MOST_SETS = 40
"""Maximum number of fault sets in a census table, worst first."""


def census_view(census: Census, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a census, with the ``most`` worst fault sets."""
    return spaced(
        facts(_census_situation(census)),
        _sets(census, most),
        _critical_joints(census),
        facts(bounds) if (bounds := _bounds(census)) else None,
        warning_lines(census.warnings),
        Text(critical_joint(census), style="bold"),
    )


def _census_situation(census: Census) -> list[tuple[str, str]]:
    robot = census.robot
    return [
        arm_fact(robot.name, robot.n, robot.base, robot.tip),
        *tip_facts(robot),
        ("Joints", robot.numbered()),
        *task_facts(census.task),
        ("Posture", census.posture.source),
        *conditions_facts(census.conditions),
        *(friction_facts(census.question) if census.mode is FaultMode.FREE else []),
        ("Limits", limits_in_words(census.limits, (), robot, ()) + _unknown_brakes(census)),
        force_fact(census.task, census.before),
        ("Tolerance", f"rank {census.rtol:g}, borderline below {census.wary:g}"),
    ]


def _unknown_brakes(census: Census) -> str:
    """Return which brake limits are unknown if they apply; a warning lists unknown motor limits."""
    if census.limits is None or census.mode is not FaultMode.LOCKED:
        return ""
    unknown = [
        name
        for name, brake in zip(census.robot.names, census.limits.brake.tolist(), strict=True)
        if math.isnan(brake)
    ]
    if len(unknown) == census.robot.n:
        return "; brake limits are unknown and ignored"
    return f"; unknown and ignored: brakes of {listed(unknown)}" if unknown else ""


_RANKED_BY = {
    "jump": "rank: by verdict, jump, rank lost, margin",
    "capability": "rank: by commanded, then held",
}


def _sets(census: Census, most: int) -> TitledTable:
    order = "least capability first" if census.rank_by == "capability" else "worst first"
    sizes = "1 joint" if census.largest == 1 else f"1 to {census.largest} joints"
    ranks = map(str, census.set_ranks)
    ranked = list(zip(census.sets, ranks, strict=True))[:most]
    result = listing(
        f"Fault sets, {census.mode}, {order} ({len(census.sets)} of {sizes})",
        [_set(census, report, rank) for report, rank in (*ranked, (census.healthy, ""))],
        left=3,
        folded=(),
    )
    result.caption = _caption(census, most)
    return result


def _set(census: Census, report: SetReport, rank: str) -> Iterator[tuple[str, str | Text]]:
    falls = "" if report.can_stand_still else "*"
    has_moments, by_capability = bool(census.task.moment_rows), report.capability is not None
    yield "rank", rank
    name = text.set_of(report.faults.joints) if report.faults else HEALTHY_ROW
    yield census.mode.value, name + falls
    yield "verdict", verdict_text(report.verdict)
    if census.before is not None and census.task.force_rows:
        yield "jump\n[N]", _jump(report.jump_norm)
    if census.before is not None and has_moments:
        yield "jump\n[N·m]", _jump(report.moment_jump_norm)
    if census.before is not None and not by_capability:
        if has_moments and census.task.force_rows:  # together they decide the rank
            yield "\n[%]", percent_kept(report.relative_jump)
        yield "kept\n[%]", percent_kept(report.kept)
    if census.before is not None and any(one.share is not None for one in census.sets):
        yield "share\n[%]", "–" if report.share is None else f"{100.0 * report.share:.0f}"
    if report.capability is not None:
        headings = ("com-\nmanded", "\nheld")
        yield from zip(headings, _capability_cells(report.capability), strict=True)
        yield "kept\n[%]", percent_kept(census.capability_kept(report))
    for measure in _measures(census):
        yield measure.symbol, defined(measure.value(report))
    yield "rank\nlost", str(report.rank_lost)


def _measures(census: Census) -> tuple[Field, ...]:
    """Return the measures for which 80 columns have room beside jumps and capabilities."""
    if census.rank_by == "capability":
        return (MARGIN,)
    return (MARGIN, RHO) if census.before is not None and census.task.moment_rows else MEASURES


def _jump(norm: float | None) -> str:
    return "–" if norm is None else size(norm)


def _capability_cells(found: SetCapability) -> tuple[str, str]:
    mark = "!" if found.minimum > text.NEGLIGIBLE else ""
    return amount(found.commanded) + mark, amount(found.held)


def _caption(census: Census, most: int) -> str:
    notes, shown = [], census.sets[:most]
    notes.append(f"{_RANKED_BY[census.rank_by]}; equal ranks: a tie; {HEALTHY_ROW}: healthy arm")
    if not all(report.can_stand_still for report in shown):
        notes.append("* the arm cannot be held in static equilibrium")
    if census.before is not None and census.rank_by != "capability":
        notes.append("kept: share of the force that is still exerted along it")
    if any(report.share is not None for report in census.sets):
        notes.append("share: of the force, if its direction must not change")
        if any(report.share is None and report.can_stand_still for report in shown):
            notes[-1] += "; –: no fraction of it is feasible"
    notes += _capability_notes(census, shown)
    if len(census.sets) > most:
        notes.append(f"… and {len(census.sets) - most} more; --format csv writes all")
    return "\n".join(notes)


def _capability_notes(census: Census, shown: Sequence[SetReport]) -> list[str]:
    notes: list[str] = []
    if census.rank_by == "capability":
        where, none = "in the weakest direction of each set", "without a force"
        if census.direction is not None:
            where = none = f"along {text.vector_in_words(census.direction)}"
            none = "with a force along it"
        unit = text.unit_of_size(census.task, census.direction)
        notes.append("kept: commanded, of that of the healthy arm")
        if any((census.capability_kept(report) or 0.0) > 1.005 for report in shown):
            notes.append(ABOVE_HEALTHY)
        notes.append(f"commanded, held: largest force {where} [{unit}]")
        if any(math.isnan(report.capability.commanded) for report in shown if report.capability):
            notes[-1] += f"; –: the arm cannot be held {none}"
        if any(x.capability.minimum > text.NEGLIGIBLE for x in shown if x.capability):
            notes.append("! with a smaller force, or none, the arm cannot be held")
    return notes


def _critical_joints(census: Census) -> TitledTable:
    ranked = census.rank_by == "capability"
    order = "least capability first" if ranked else "most critical first"
    ranks = map(str, census.joint_ranks)
    rows = [_joint(census, *pair) for pair in zip(census.joints, ranks, strict=True)]
    rows.append(_healthy(census))
    result = listing(f"Joints, {order}", rows, left=4, folded=(2,))
    result.caption = "mean jump: jump over force, averaged over the sets that contain the joint"
    if census.before is None:
        full = "a lost direction counts as 100%"
        result.caption = f"mean jump: over the sets that contain the joint; {full}"
    if ranked:
        result.caption = "least of all: commanded, over the sets that contain the joint"
    elif not all(report.can_stand_still for report in census.sets):
        result.caption += "\nan arm that cannot be held counts as a jump of 100%"
    return result


def _joint(census: Census, report: JointReport, rank: str) -> Iterator[tuple[str, str | Text]]:
    alone, least = report.alone, report.least_capability
    yield "rank", rank
    yield "#", str(report.joint + 1)
    yield "joint", census.robot.names[report.joint]
    yield from _alone(alone, least)
    yield "sets not\ntolerated", f"{report.not_tolerated} of {report.sets}"
    yield "border-\nline", str(report.borderline)
    if least is None:
        if any(one.falls for one in census.joints):
            yield "falls", str(report.falls)
        yield "mean\njump [%]", f"{100.0 * report.mean_relative_jump:.1f}"


def _healthy(census: Census) -> Iterator[tuple[str, str | Text]]:
    healthy, found = census.healthy, census.healthy.capability
    yield from (("", ""), ("", ""), ("", HEALTHY_ROW))
    yield from _alone(healthy, None if found is None else found.commanded)
    yield from [("", "")] * 2
    if found is None:
        yield from [("", "")] * (1 + any(one.falls for one in census.joints))


def _alone(report: SetReport, least: float | None) -> Iterator[tuple[str, str | Text]]:
    """Yield the cells of the set in which a joint fails alone, or of the healthy arm."""
    yield "fails alone", verdict_text(report.verdict)
    if report.capability is not None and least is not None:
        headings = ("com-\nmanded", "\nheld")
        yield from zip(headings, _capability_cells(report.capability), strict=True)
        yield "least\nof all", amount(least)
    else:
        yield "rank\nlost", str(report.rank_lost)
    yield MARGIN.symbol, ratio(report.margin)


def _bounds(census: Census) -> list[tuple[str, str]]:
    lines: list[tuple[str, str]] = []
    if census.mode is not FaultMode.LOCKED:
        return lines  # the bound applies only to locked joints
    for f in range(1, census.largest + 1):
        worst, bound = census.worst_manipulability(f)
        if not math.isnan(worst) and bound > 0.0:
            best = f"{worst / bound:.0%} of {ratio(bound)}, the most that any posture can have"
            name = f"Worst ρ of {f} joint{'s' if f > 1 else ''}"
            lines.append((name, f"{ratio(worst)} ({best})"))
    return lines
