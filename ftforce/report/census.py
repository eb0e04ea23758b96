"""Censuses as text, JSON and table rows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict
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
    posture_part,
    rows_of,
    task_columns,
)
from ftforce.report.text import ratio, size, unit_of_size, vector_in_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.analysis.census import Census
    from ftforce.analysis.fault_set import SetReport


def critical_joint(census: Census) -> str:
    """Describe the critical joint."""
    worst, robot = census.joints[0], census.robot
    name = f"{robot.joints[worst.joint].number} {robot.names[worst.joint]}"
    if worst.alone.capability is not None:
        return f"Critical joint: {name}. When it fails alone, {_left(census, worst.alone)}."
    for count, verdict in (
        (worst.not_tolerated, Verdict.NOT_TOLERATED),
        (worst.borderline, Verdict.BORDERLINE),
    ):
        if count and worst.sets == 1:
            return f"Critical joint: {name}. Its fault is {verdict.value}."
        if count:
            share = "all" if count == worst.sets else f"{count} of"
            return (
                f"Critical joint: {name}. Of the fault sets that hold it, {share} "
                f"{worst.sets} {'is' if count == 1 else 'are'} {verdict.value}."
            )
    return (
        f"Every fault set is tolerated here; joint {name} leaves the smallest margin, "
        f"{ratio(worst.alone.margin)}, when it fails alone."
    )


def _left(census: Census, report: SetReport) -> str:
    """Describe the force that remains with a fault set."""
    found = report.capability
    assert found is not None
    where = "in the weakest direction"
    if census.direction is not None:
        where = f"along {vector_in_words(census.direction)}"
    if not report.can_stand_still:
        return "the arm cannot stand still"
    if math.isnan(found.commanded) and census.direction is None:
        return "the arm stands still only with a force at the tip"
    if math.isnan(found.commanded):
        return f"the arm does not stand still with any force {where}"
    if math.isinf(found.commanded):
        return f"no known limit ends the force {where} that the motors can command"
    if found.commanded == 0.0:
        return f"the motors can command no force {where}"
    unit = unit_of_size(census.task, census.direction)
    return f"the motors can command {size(found.commanded)} {unit} {where}"


def census_document(census: Census) -> Document:
    """Return a census as a JSON document."""
    names = census.robot.names
    return {
        "robot": arm_part(census.robot),
        "conventions": conventions_part(census.task, census.rtol, census.wary, census.conditions),
        "posture": posture_part(census.posture),
        "faults": census.largest,
        "mode": census.mode.value,
        "rank_by": census.rank_by,
        "direction": listed(census.direction),
        "limits": None if census.limits is None else limits_part(names, census.limits),
        "force": {"requested": listed(census.requested), "before": listed(census.before)},
        "sets": [_set_document(names, report) for report in census.sets],
        "joints": [
            {
                "joint": names[report.joint],
                "alone": _set_document(names, report.alone),
                "sets": report.sets,
                "not_tolerated": report.not_tolerated,
                "borderline": report.borderline,
                "mean_relative_jump": report.mean_relative_jump,
                "least_capability": None
                if report.least_capability is None
                else finite(report.least_capability),
            }
            for report in census.joints
        ],
        "summary": critical_joint(census),
        "warnings": list(census.warnings),
    }


def _set_document(names: Sequence[str], report: SetReport) -> Document:
    return {
        "locked": [names[i] for i in report.faults.in_mode(FaultMode.LOCKED)],
        **modes_part(names, report.faults),
        "jacobian": {
            "rank_after": report.rank_after,
            "rank_lost": report.rank_lost,
            "sigma_min_after": report.sigma_min_after,
            "margin": report.margin,
            "relative_manipulability": finite(report.relative_manipulability),
        },
        "force": {
            "after": listed(report.after),
            "jump": listed(report.jump),
            "jump_norm": report.jump_norm,
            "moment_jump_norm": report.moment_jump_norm,
        },
        "can_stand_still": report.can_stand_still,
        "share": report.share,
        "binding": [names[j] for j in report.binding],
        "capability": None
        if report.capability is None
        else {
            "commanded": finite(report.capability.commanded),
            "held": finite(report.capability.held),
            "least": finite(report.capability.minimum),
            "end": report.capability.end.value,
            "held_end": report.capability.held_end.value,
            "stops": [names[j] for j in report.capability.limiting_joints],
        },
        "verdict": report.verdict.value,
    }


def census_rows(census: Census) -> list[Row]:
    """Return a census as table rows, one per fault set."""
    return rows_of(_set_record(census, report) for report in census.sets)


def _set_record(census: Census, report: SetReport) -> Document:
    task, names, faults = census.task, census.robot.names, report.faults
    jump = [""] * task.m if report.jump is None else report.jump.tolist()
    jumps = zip(task.components, task.units, jump, strict=True)
    found = report.capability
    return {
        "fault_set": str(faults),
        "locked": " ".join(names[i] for i in faults.in_mode(FaultMode.LOCKED)),
        "free": " ".join(names[i] for i in faults.in_mode(FaultMode.FREE)),
        "size": len(faults),
        "verdict": report.verdict.value,
        "jump_norm [N]": report.jump_norm,
        "moment_jump_norm [N·m]": report.moment_jump_norm,
        **{f"jump_{name} [{unit}]": x for name, unit, x in jumps},
        "margin": report.margin,
        "relative_manipulability": finite(report.relative_manipulability),
        "rank_after": report.rank_after,
        "rank_lost": report.rank_lost,
        "can_stand_still": report.can_stand_still,
        "share": report.share,
        "binding": " ".join(names[j] for j in report.binding),
        "commanded": "" if found is None else finite(found.commanded),
        "held": "" if found is None else finite(found.held),
        "least": "" if found is None else finite(found.minimum),
        "end": "" if found is None else found.end.value,
        "held_end": "" if found is None else found.held_end.value,
        **task_columns(task),
        "limits": limits_source(census.limits),
        "rtol": census.rtol,
        "wary": census.wary,
    }
