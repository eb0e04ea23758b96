"""Tables of a census."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce import sentences, words
from ftforce.errors import listed
from ftforce.faults import FaultMode
from ftforce.feasible import Reading
from ftforce.show.analysis import conditions_facts, limits_in_words
from ftforce.show.tables import (
    TitledTable,
    defined,
    facts,
    spaced,
    table,
    verdict_text,
    warning_lines,
)
from ftforce.words import number, ratio, size

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.fault_census import Census
    from ftforce.set_reports import SetReport

MOST_SETS = 40
"""How many fault sets a census table shows, worst first."""


def census_view(census: Census, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a census, with the ``most`` worst fault sets."""
    return spaced(
        facts(_census_situation(census)),
        _sets(census, most),
        _critical_joints(census),
        facts(bounds) if (bounds := _bounds(census)) else None,
        warning_lines(census.warnings),
        Text(sentences.critical_joint(census), style="bold"),
    )


def _census_situation(census: Census) -> list[tuple[str, str]]:
    robot, task = census.robot, census.task
    length = f", characteristic length {task.length:g} m" if task.moment_rows else ""
    force = "every direction (none given)"
    if census.before is not None:
        parts = zip(census.before.tolist(), task.components, task.units, strict=True)
        force = ", ".join(f"{name} {number(x)} {unit}" for x, name, unit in parts)
    return [
        ("Robot", f"{robot.name}: {robot.n} joints, {robot.base} → {robot.tip}"),
        ("Joints", robot.numbered()),
        ("Axes", f"{task.axes}: vectors are in the axes of {words.axes_in_words(task)}"),
        ("Task", f"{task} ({', '.join(task.components)}){length}"),
        ("Posture", census.posture.source),
        *conditions_facts(census.conditions),
        ("Limits", limits_in_words(census.limits, (), robot, ()) + _unknown_brakes(census)),
        ("Force", force),
        ("Tolerance", f"rank {census.rtol:g}, wary below {census.wary:g}"),
    ]


def _unknown_brakes(census: Census) -> str:
    """Say which brakes are unknown, if locks count; a warning names unknown motors."""
    if census.limits is None or census.mode is not FaultMode.LOCKED:
        return ""
    unknown = [
        name
        for name, brake in zip(census.robot.names, census.limits.brake.tolist(), strict=True)
        if math.isnan(brake)
    ]
    if len(unknown) == census.robot.n:
        return "; brakes are unknown and count as none"
    return f"; unknown, count as none: brakes of {listed(unknown)}" if unknown else ""


def _sets(census: Census, most: int) -> TitledTable:
    task, forced = census.task, census.before is not None
    jumps = []
    if forced and task.force_rows:
        jumps.append("jump\n[N]")
    if forced and task.moment_rows:
        jumps.append("jump\n[N·m]")
    shared = forced and any(report.share is not None for report in census.sets)
    ranked = [r.value for r in Reading] if census.rank_by == "capability" else []
    order = "least capability first" if ranked else "worst first"
    result = table(
        f"Fault sets, {census.mode}, {order} ({len(census.sets)} of 1 to {census.largest} joints)",
        census.mode.value, "verdict", *jumps, *(["share\n[%]"] if shared else []), *ranked,
        "margin", "ρ", "rank\nlost", left=2,
    )  # fmt: skip
    for report in census.sets[:most]:
        norms = [report.jump_norm] * bool(forced and task.force_rows)
        norms += [report.moment_jump_norm] * bool(forced and task.moment_rows)
        share = "–" if report.share is None else f"{100.0 * report.share:.0f}"
        falls = "" if report.can_stand_still else "*"
        result.add_row(
            "{" + ", ".join(str(i + 1) for i in report.faults.joints) + "}" + falls,
            verdict_text(report.verdict),
            *("–" if norm is None else size(norm) for norm in norms),
            *([share] if shared else []),
            *_capability_cells(report),
            ratio(report.margin),
            defined(report.relative_manipulability),
            str(report.rank_lost),
        )
    result.caption = _caption(census, most)
    return result


def _capability_cells(report: SetReport) -> list[str]:
    found = report.capability
    if found is None:
        return []
    mark = "!" if found.least > words.NEGLIGIBLE else ""
    return [_amount(found.commanded) + mark, _amount(found.held)]


def _amount(x: float) -> str:
    return "–" if math.isnan(x) else "no limit" if math.isinf(x) else size(x, 1)


def _caption(census: Census, most: int) -> str:
    notes, shown = [], census.sets[:most]
    if not all(report.can_stand_still for report in shown):
        notes.append("* the arm cannot stand still")
    if any(report.share is not None for report in census.sets):
        notes.append("share: of the force, if its direction must not change")
        if any(report.share is None and report.can_stand_still for report in shown):
            notes[-1] += "; –: with no share of it alone does the arm stand still"
    if census.rank_by == "capability":
        where, none = "in the weakest direction of each set", "without a force"
        if census.direction is not None:
            where = none = f"along {words.vector_in_words(census.direction)}"
            none = "with a force along it"
        unit = words.unit_of_size(census.task, census.direction)
        notes.append(f"commanded, held: largest force {where} [{unit}]")
        if any(math.isnan(report.capability.commanded) for report in shown if report.capability):
            notes[-1] += f"; –: the arm does not stand still {none}"
        if any(x.capability.least > words.NEGLIGIBLE for x in shown if x.capability):
            notes.append("! less than that, or nothing at all, does not hold the arm")
    if len(census.sets) > most:
        notes.append(f"… and {len(census.sets) - most} more; --format csv writes all")
    return "\n".join(notes)


def _critical_joints(census: Census) -> TitledTable:
    ranked = census.rank_by == "capability"
    order = "least capability first" if ranked else "most critical first"
    measures = ["com-\nmanded", "\nheld", "least\nof all", "margin"] if ranked else ["margin", "ρ"]
    result = table(
        f"Joints, {order}", "#", "joint", "fails alone", *measures,
        "sets not\ntolerated", "border-\nline", *([] if ranked else ["mean jump\n[%]"]),
        left=3, folded=(1,),
    )  # fmt: skip
    for report in census.joints:
        alone, least = report.alone, report.least_capability
        rho = [] if ranked else [defined(alone.relative_manipulability)]
        result.add_row(
            str(report.joint + 1),
            census.robot.names[report.joint],
            verdict_text(alone.verdict),
            *_capability_cells(alone),
            *([_amount(least)] if least is not None else []),
            ratio(alone.margin),
            *rho,
            f"{report.not_tolerated} of {report.sets}",
            str(report.borderline),
            *([] if ranked else [f"{100.0 * report.mean_relative_jump:.1f}"]),
        )
    result.caption = "mean jump: jump over force, averaged over the sets that hold the joint"
    if census.before is None:
        full = "a lost direction counts as 100%"
        result.caption = f"mean jump: over the sets that hold the joint; {full}"
    if ranked:
        result.caption = "least of all: commanded, over the sets that hold the joint"
    elif not all(report.can_stand_still for report in census.sets):
        result.caption += "\nan arm that cannot stand still counts as a jump of 100%"
    return result


def _bounds(census: Census) -> list[tuple[str, str]]:
    lines: list[tuple[str, str]] = []
    if census.mode is not FaultMode.LOCKED:
        return lines  # the bound is one of locked joints
    for f in range(1, census.largest + 1):
        worst, bound = census.worst_manipulability(f)
        if not math.isnan(worst) and bound > 0.0:
            best = f"{worst / bound:.0%} of {ratio(bound)}, the most that any posture can have"
            name = f"Worst ρ of {f} joint{'s' if f > 1 else ''}"
            lines.append((name, f"{ratio(worst)} ({best})"))
    return lines
