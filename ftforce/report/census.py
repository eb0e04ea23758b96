"""Censuses as text, JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict
from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, columns, document, rows_of, under, whole
from ftforce.report.measures import MEASURES, RANK_AFTER, SIGMA_MIN_AFTER
from ftforce.report.text import ratio, size, unit_of_size, vector_in_words

if TYPE_CHECKING:
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
        return "the arm cannot be held in static equilibrium"
    if math.isnan(found.commanded) and census.direction is None:
        return "the arm can be held only with a force at the tip"
    if math.isnan(found.commanded):
        return f"the arm cannot be held with any force {where}"
    if math.isinf(found.commanded):
        return f"no known limit bounds the force {where} that the motors can command"
    if found.commanded == 0.0:
        return f"no motor torque can produce force {where}"
    unit = unit_of_size(census.task, census.direction)
    return f"the motors can command {size(found.commanded)} {unit} {where}"


# fmt: off
RANK_LOST = Field("rank_lost", "rank of J minus rank of K")
_SHARE = Field("share", "largest fraction of the force that can be commanded in its direction; "
    "`null` without a force, with neither limits nor free-swinging joints, or if no fraction is "
    "feasible", "1")
_STANDS = Field("can_stand_still", "whether motors, brakes and some tip force can hold the arm in "
    "static equilibrium")
_BINDING = Field("binding", "joints at their limits", shape="names")
_CAPABILITY = (
    Field("commanded", "largest force that the motors can exert; `null` if no known limit bounds "
        "it (`end` is `unlimited`), or if the arm cannot be held with any force in this direction",
        parts.FORCE),
    Field("held", "largest force that motors and brakes can bear; likewise", parts.FORCE),
    Field("least", "smallest force that can be commanded, nonzero only with free-swinging joints "
        "or if weight alone exceeds a limit; `null` if there is none", parts.FORCE, get="minimum"),
    Field("end", "what limits `commanded`: `limit`, `fault`, `weight`, `unlimited`, or "
        "`direction`: even the healthy arm exerts no force in this direction"),
    Field("held_end", "what limits `held`"),
)
_SET = (
    parts.LOCKED,
    *parts.MODES,
    Field("jacobian", "before and after the fault", get=whole,
        parts=(RANK_AFTER, RANK_LOST, SIGMA_MIN_AFTER, *MEASURES)),
    Field("force", "its values are `null` without a force", get=whole, parts=parts.JUMP),
    _STANDS,
    _SHARE,
    _BINDING,
    Field("capability", "`null` unless ranked by it; without a direction, for a task with forces "
        "and moments, in weighted N", parts=(
        *_CAPABILITY,
        Field("stops", "joints whose limits end what can be commanded", shape="names",
            get="limiting_joints"),
    )),
    parts.VERDICT,
)
CENSUS = (
    parts.ROBOT,
    Field("conventions", "conventions of the document",
        get=lambda x: parts.Asked(x.task, x.rtol, x.wary, x.conditions), parts=parts.CONVENTIONS),
    parts.POSTURE,
    Field("faults", "size of the largest sets", get="largest"),
    Field("mode", "`locked` or `free`"),
    Field("rank_by", "`jump` or `capability`"),
    Field("direction", "of the capability; `null` for the weakest, or if the ranking is by jump",
        "1", "m"),
    Field("limits", parts.LIMITS_MEANING, get=parts.limited, parts=parts.LIMITS_IN_FORCE),
    Field("force", "tip force", get=whole, parts=(parts.REQUESTED, parts.BEFORE)),
    Field("sets", "every fault set, worst first", shape="list", parts=_SET),
    Field("joints", "every joint, most critical first", shape="list", parts=(
        Field("joint", "its name", shape="name"),
        Field("alone", "the set in which only it fails; keys as an element of `sets`",
            shape="as of `sets`", parts=_SET),
        Field("sets", "number of sets that contain it"),
        Field("not_tolerated", "how many of them are not tolerated"),
        Field("borderline", "how many of them are borderline"),
        Field("mean_relative_jump", "mean of ‖ΔF‖/‖F̂‖ over them", "1"),
        Field("least_capability", "smallest force over them that can be commanded; `null` unless "
            "ranked by it, if no known limit bounds it, or if the arm cannot be held", parts.FORCE),
    )),
    replace(parts.SUMMARY, get=critical_joint),
    parts.WARNINGS,
)
# fmt: on


def census_document(census: Census) -> Document:
    """Return a census as a JSON document."""
    return document(CENSUS, census, census.robot.names)


# fmt: off
SET_COLUMNS = (
    parts.FAULT_SET,
    parts.LOCKED,
    Field("free", "free-swinging joints", shape="names",
        get=lambda x: x.faults.in_mode(FaultMode.FREE)),
    Field("size", "number of failed joints", get=lambda report: len(report.faults)),
    parts.VERDICT,
    *parts.JUMP[2:],
    parts.JUMP[1],
    *MEASURES,
    RANK_AFTER,
    RANK_LOST,
    _STANDS,
    _SHARE,
    _BINDING,
    *under("capability", _CAPABILITY),
)
# fmt: on
QUESTION_COLUMNS = (*parts.TASK_COLUMNS, parts.LIMITS_SOURCE, parts.RTOL, parts.WARY)


def census_rows(census: Census) -> list[Row]:
    """Return a census as table rows, one per fault set."""
    names, about = census.robot.names, columns(QUESTION_COLUMNS, census)
    components = dict(zip(census.task.components, census.task.units, strict=True))
    return rows_of(
        columns(SET_COLUMNS, report, names, components) | about for report in census.sets
    )
