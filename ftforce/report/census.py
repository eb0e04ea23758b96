"""Censuses as text, JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict
from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, columns, document, rows_of, under, whole
from ftforce.report.measures import MEASURES, RANK_AFTER, SIGMA_MIN_AFTER
from ftforce.report.text import joined, percent, ratio, size, unit_of_size, vector_in_words

if TYPE_CHECKING:
    from ftforce.analysis.census import Census, JointReport
    from ftforce.analysis.fault_set import SetReport
    from ftforce.core.arrays import Vector
    from ftforce.core.ranks import Rank


def critical_joint(census: Census) -> str:
    """Describe the critical joint, or those that tie."""
    worst, ties = census.joints[0], census.most_critical
    name = joined(f"{one.joint + 1} {census.robot.names[one.joint]}" for one in ties)
    tie = len(ties) > 1
    critical = f"Critical joints, tied: {name}" if tie else f"Critical joint: {name}"
    alone = "When one of them fails alone" if tie else "When it fails alone"
    if worst.alone.capability is not None:
        return f"{critical}. {alone}, {_left(census, worst.alone)}."
    for count, verdict in (
        (worst.not_tolerated, Verdict.NOT_TOLERATED),
        (worst.borderline, Verdict.BORDERLINE),
    ):
        if count and worst.sets == 1:
            return f"{critical}. {'Each' if tie else 'Its'} fault is {verdict.value}."
        if count:
            share = "all" if count == worst.sets else f"{count} of"
            return (
                f"{critical}. Of the fault sets that contain {'each of them' if tie else 'it'}, "
                f"{share} {worst.sets} {'is' if count == 1 else 'are'} {verdict.value}."
            )
    leaves = f"joints {name} leave" if tie else f"joint {name} leaves"
    when = "one of them" if tie else "it"
    return (
        f"Every fault set is tolerated here; {leaves} the smallest margin, "
        f"{ratio(worst.alone.margin)}, when {when} fails alone."
    )


def _left(census: Census, report: SetReport) -> str:
    """Describe the force that remains with a fault set."""
    found, kept = report.capability, census.capability_kept(report)
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
    share = "" if kept is None else f", {percent(kept)} of the healthy arm's"
    return f"the motors can command {size(found.commanded)} {unit} {where}{share}"


class _Ranked(NamedTuple):
    """A fault set of a census, or the healthy arm, which has no rank."""

    report: SetReport
    rank: Rank | None
    capability_kept: float | None
    torque: Vector | None

    @classmethod
    def of(cls, census: Census, report: SetReport, rank: Rank | None) -> _Ranked:
        kept, torque = census.capability_kept(report), census.torque_to_command(report)
        return cls(report, rank, kept, torque)


def _healthy(census: Census) -> _Ranked:
    return _Ranked.of(census, census.healthy, None)


def _sets(census: Census) -> list[_Ranked]:
    pairs = zip(census.sets, census.set_ranks, strict=True)
    return [_Ranked.of(census, report, rank) for report, rank in pairs]


class _RankedJoint(NamedTuple):
    """A joint of a census."""

    report: JointReport
    rank: Rank
    alone: _Ranked


def _joints(census: Census) -> list[_RankedJoint]:
    sets = {one.report.faults: one for one in _sets(census)}
    pairs = zip(census.joints, census.joint_ranks, strict=True)
    return [_RankedJoint(joint, rank, sets[joint.alone.faults]) for joint, rank in pairs]


# fmt: off
_RANK_LOST = Field("rank_lost", "rank of J minus rank of K")
_RELATIVE = (
    Field("relative_jump", "‖ΔF‖/‖F̂‖, weighted, 1 if the arm cannot be held; without a force, 1 if "
        "a direction is lost and 0 if not", "1"),
    Field("kept", "share of the force that is still exerted along it, F̂ᵀF'/F̂ᵀF̂", "1"),
)
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
        parts=(RANK_AFTER, _RANK_LOST, SIGMA_MIN_AFTER, *MEASURES)),
    Field("force", "its values are `null` without a force", get=whole,
        parts=(*parts.JUMP, *_RELATIVE)),
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
_KEPT = Field("capability_kept", "`commanded` over that of the healthy arm; `null` unless ranked "
    "by it, or if unknown", "1")
_TORQUE = Field("torque", "motor torques to command, weight and motion included, 0 at locked and "
    "free-swinging joints; `null` without a force, if the arm cannot be held, or if the URDF has "
    "no masses", parts.TORQUE, "by joint")
_RANKED_SET = (parts.RANK, *under("report", _SET), _KEPT, _TORQUE)
CENSUS = (
    parts.ROBOT,
    Field("conventions", "conventions of the document",
        get=lambda x: parts.Asked(x.task, x.scale, x.rtol, x.wary, x.conditions),
        parts=parts.CONVENTIONS),
    parts.POSTURE,
    Field("faults", "size of the largest sets", get="largest"),
    Field("mode", "`locked` or `free`"),
    Field("rank_by", "`jump` or `capability`"),
    Field("direction", "of the capability; `null` for the weakest, or if the ranking is by jump",
        "1", "m"),
    Field("limits", parts.LIMITS_MEANING, get=parts.limited, parts=parts.LIMITS_IN_FORCE),
    Field("force", "tip force", get=whole, parts=(parts.REQUESTED, parts.BEFORE)),
    Field("healthy", "the baseline, no joint failed; keys as an element of `sets`",
        shape="as of `sets`", get=_healthy, parts=_RANKED_SET),
    Field("sets", "every fault set, worst first", shape="list", get=_sets, parts=_RANKED_SET),
    Field("joints", "every joint, most critical first", shape="list", get=_joints, parts=(
        parts.RANK,
        Field("joint", "its name", shape="name", get="report.joint"),
        Field("alone", "the set in which only it fails; keys as an element of `sets`",
            shape="as of `sets`", parts=_RANKED_SET),
        *under("report", (
            Field("sets", "number of sets that contain it"),
            Field("not_tolerated", "how many of them are not tolerated"),
            Field("borderline", "how many of them are borderline"),
            Field("falls", "with how many of them the arm cannot be held in static equilibrium"),
            Field("mean_relative_jump", "mean of ‖ΔF‖/‖F̂‖ over them", "1"),
            Field("least_capability", "smallest force over them that can be commanded; `null` "
                "unless ranked by it, if no known limit bounds it, or if the arm cannot be held",
                parts.FORCE),
        )),
    )),
    replace(parts.SUMMARY, get=critical_joint),
    parts.WARNINGS,
)
# fmt: on


def census_document(census: Census) -> Document:
    """Return a census as a JSON document."""
    return document(CENSUS, census, census.robot.names)


# fmt: off
_SET_COLUMNS = (
    parts.FAULT_SET,
    parts.LOCKED,
    Field("free", "free-swinging joints", shape="names",
        get=lambda x: x.faults.in_mode(FaultMode.FREE)),
    Field("size", "number of failed joints", get=lambda report: len(report.faults)),
    parts.VERDICT,
    *parts.JUMP[2:],
    *_RELATIVE,
    parts.JUMP[1],
    *MEASURES,
    RANK_AFTER,
    _RANK_LOST,
    _STANDS,
    _SHARE,
    _BINDING,
    *under("capability", _CAPABILITY),
)
SET_COLUMNS = (*under("report", _SET_COLUMNS), _KEPT, *parts.RANK_COLUMNS, _TORQUE)
# fmt: on
QUESTION_COLUMNS = (*parts.TASK_COLUMNS, parts.LIMITS_SOURCE, parts.RTOL, parts.WARY)


def census_rows(census: Census) -> list[Row]:
    """Return a census as table rows, one per fault set, then one of the healthy arm."""
    names, about = census.robot.names, columns(QUESTION_COLUMNS, census)
    components = dict(zip(census.task.components, census.task.units, strict=True))
    units = [joint.torque_unit for joint in census.robot.joints]
    return rows_of(
        columns(SET_COLUMNS, one, names, components, units) | about
        for one in (*_sets(census), _healthy(census))
    )
