"""Comparisons of arms as text, JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.arm_report import CONFIDENCE
from ftforce.report import parts
from ftforce.report.fields import (
    Document,
    Field,
    Row,
    columns,
    constants,
    document,
    rows_of,
    under,
    whole,
)
from ftforce.report.measures import MARGIN, RHO
from ftforce.report.provenance import ROBOT, ROBOT_SHA256
from ftforce.report.text import NEGLIGIBLE, joined, share, size, vector_in_words

if TYPE_CHECKING:
    from ftforce.batch.arm_report import ArmReport, SizeReport
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.result import SweepSetting

_MOST_NAMED = 4

_KEY = (
    "the share of postures x fault sets that are tolerated, every size of sets weighing the same; "
    "borderline is not tolerated"
)
"""Ranking criterion of the arms."""


def ranks(arm: ArmReport) -> str:
    """Format the rank of an arm, or the range of ranks that the intervals allow."""
    return str(arm.first) if arm.first == arm.last else f"{arm.first}–{arm.last}"


def fault_words(setting: SweepSetting) -> str:
    """Describe the faults of a sweep: ``one joint locked``."""
    state = "free-swinging" if setting.mode == "free" else setting.mode
    if setting.largest == 1:
        return f"one joint {state}"
    return f"up to {setting.largest} joints {state}"


def critical_words(arm: ArmReport) -> str:
    """Format number and name of the critical joint: ``2 shoulder``."""
    joint = arm.critical.joint
    return f"{joint + 1} {arm.setting.joints[joint]}"


def comparison_sentence(comparison: Comparison) -> str:
    """Describe which arm degrades best, which worst, and which keeps the largest force."""
    return " ".join((_best(comparison), *_worst(comparison), *_strongest(comparison)))


def _best(comparison: Comparison) -> str:
    best, *others = comparison.best
    rest = [arm.name for arm in others]
    found = (
        f"{best.name} degrades most gracefully: with {fault_words(best.setting)} it {_keeps(best)} "
        f"for {share(best.tolerated.value)}% of all combinations of posture and fault set "
        f"({share(best.tolerated.low)} to {share(best.tolerated.high)}%)."
    )
    if not rest:
        return found
    named = joined(rest[:_MOST_NAMED])
    if len(rest) > _MOST_NAMED:
        named = f"{', '.join(rest[:_MOST_NAMED])} and {len(rest) - _MOST_NAMED} more"
    return f"{found} {named} may be as good: the intervals overlap."


def _keeps(arm: ArmReport) -> str:
    if arm.setting.force is None:
        return "keeps every direction of force"
    return "keeps the force"


def _worst(comparison: Comparison) -> list[str]:
    worst = comparison.arms[-1]
    if worst.first == 1:
        return []
    found = f"{worst.name} degrades least gracefully: {share(worst.tolerated.value)}%"
    return [f"{found}; its critical joint is {critical_words(worst)}."]


def _strongest(comparison: Comparison) -> list[str]:
    """Describe which arm can exert the largest force after a single fault."""
    found = [
        (arm.sizes[0].capability[1].value, arm)
        for arm in comparison.arms
        if arm.sizes[0].capability is not None
    ]
    finite = [(x, arm) for x, arm in found if math.isfinite(x)]
    if not finite:
        return []
    most, arm = max(finite, key=itemgetter(0))
    if most <= NEGLIGIBLE:
        return []
    unit = arm.setting.capability_unit
    known = "" if len(finite) == len(found) else " of those whose limits are known"
    where = f"along {vector_in_words(arm.setting.direction or ())}{known}"
    amount = f"{size(most, 0)} {unit}, the median after a single fault"
    return [f"{arm.name} retains the largest force {where}: {amount}."]


_LOW, _HIGH = ("q05", "q50"), ("q50", "q95")
# fmt: off
_RHO = replace(RHO, key="rho")
_EVERY = "share of the postures that tolerate every set"
_JUMP = Field("jump", "jump over force; `null` without a force", "1")
_CAPABILITY = Field("capability", "largest force that can be commanded; `null` if it is not "
    "evaluated", parts.FORCE)
_HEALTHY = Field("healthy_capability", "before a fault; `null` if unknown", parts.FORCE)
_RHO_BOUND = Field("rho_bound", "√(C(n−m, f)/C(n, f))", "1")
_CASES = "share of postures × sets"
_ARM = (
    parts.estimate("tolerated", _CASES),
    parts.estimate("every", _EVERY),
    Field("full_rank", "share of the postures at which the healthy arm has full rank", "1"),
)
_WORST_RHO = parts.estimate("worst_rho", "median of a posture's smallest ρ")
_EVENNESS = Field("evenness", "`worst_rho` over the root mean square of ρ, which it cannot exceed",
    "1")
_VOLUMES = (
    Field("visited", "volume of the cells with postures", "m³"),
    Field("survived", "volume of the cells in which `enough` of the postures tolerate every set",
        "m³"),
    Field("some", "volume of the cells in which at least one posture does", "m³"),
)
_CELL = Field("cell", "edge length of a cell", "m")
_REACH = Field("reach", "distance from the first joint to the farthest visited cell", "m")
_SIZE = (Field("size", "number of joints that fail together"), Field("sets", "number of such sets"))
_MODE = Field("mode", "`locked` or `free`")
_ASKED = (
    parts.SETTING_TASK[1],
    parts.SETTING_COMPONENTS,
    parts.SETTING_TASK[0],
    parts.SETTING_TASK[2],
    replace(parts.SETTING_TASK[3], meaning="travel of a slide that weighs as much as 1 rad of a "
        "hinge, in arms that have both", get="joint_length"),
    _MODE,
    Field("faults", "size of the largest sets", get="largest"),
    Field("force", "requested force; `null` without", parts.FORCE, "m"),
    Field("direction", "of the capability; `null` without", "1", "m"),
    Field("limits_count", "whether torque limits bound the capability",
        get=lambda asked: asked.limits is not None),
    parts.GRAVITY,
    *parts.SETTING_PAYLOAD,
    parts.RTOL,
    parts.WARY,
)
_CRITICAL = (
    Field("joint", "name", get=lambda arm: arm.setting.joints[arm.critical.joint]),
    Field("number", "number from 1", get=lambda arm: arm.critical.joint + 1),
    Field("tolerated", "share of the cases that contain it", "1", get="critical_tolerated"),
    *under("critical",
        (parts.estimate("not_tolerated", "likewise"), Field("borderline", "likewise", "1"))),
)
_ARMS = (
    Field("name", "name of the arm, unique in the comparison"),
    Field("rank", "first and last rank: arms whose intervals overlap share theirs", shape="2",
        get=lambda arm: (arm.first, arm.last)),
    *under("setting", (replace(parts.SETTING_ARM[0], key="robot"), *parts.SETTING_ARM[1:])),
    *under("setting", (ROBOT_SHA256,)),
    Field("sweep", "path of its stored sweep; `null` if it was made for this", get="path"),
    Field("postures", "the analysed postures", get=whole, parts=(
        Field("count", "number analysed", get="postures"),
        Field("source", "description", get="setting.postures"),
    )),
    Field("limits", "source of its torque limits; `null` if none apply", get="setting.limits"),
    Field("unknown_limits", "joints whose limit is unknown", shape="list of names",
        get="setting.unknown_limits"),
    *_ARM,
    _WORST_RHO,
    _EVENNESS,
    Field("critical_joint", "the critical joint", get=whole, parts=_CRITICAL),
    Field("sizes", "one for each number of joints that fail together", shape="list", parts=(
        *_SIZE,
        parts.estimate("tolerated", _CASES),
        Field("borderline", _CASES, "1"),
        parts.quantiles(MARGIN, _LOW, parts=parts.ESTIMATE),
        parts.quantiles(_RHO, _LOW, parts=parts.ESTIMATE),
        _RHO_BOUND,
        parts.quantiles(_JUMP, _HIGH, parts=parts.ESTIMATE),
        parts.quantiles(_CAPABILITY, _LOW, parts=parts.ESTIMATE),
    )),
    parts.quantiles(_HEALTHY, _LOW, parts=parts.ESTIMATE),
    Field("capability_kept", "median after over median before; `null` if unknown", "1"),
    Field("workspace", "volumes visited and survived",
        parts=(_CELL, *_VOLUMES, Field("share", "survived of visited", "1"), _REACH)),
)
COMPARISON = (
    Field("question", "what was asked of every arm", parts=_ASKED),
    *constants({"ranked_by": _KEY}),
    Field("confidence", "confidence level of the intervals", "1", get=lambda _: CONFIDENCE),
    Field("enough", "share of tolerated postures from which a cell counts as survived", "1"),
    Field("units", "units of the quantities of an arm", shape="by quantities",
        get=lambda comparison: {
        "tolerated, every, borderline, full_rank, share": "1",
        "margin, rho, evenness": "1",
        "jump": "share of the force",
        "capability": comparison.question.capability_unit,
        "visited, survived, some": "m³",
        "cell, reach": "m",
    }),
    Field("arms", "best first", shape="list", parts=_ARMS),
    replace(parts.SUMMARY, get=comparison_sentence),
    parts.WARNINGS,
)
# fmt: on


def comparison_document(comparison: Comparison) -> Document:
    """Return a comparison as a JSON document: the question, and the arms, best first."""
    return document(COMPARISON, comparison)


class _Case(NamedTuple):
    """A row of a comparison's table."""

    arm: ArmReport
    one: SizeReport


def comparison_columns(unit: str = parts.FORCE) -> tuple[Field, ...]:
    """Return the CSV columns, with the unit of the capability."""
    arm = (
        Field("arm", "name of the arm", get="name"),
        Field("rank_first", "first rank", get="first"),
        Field("rank_last", "last rank", get="last"),
        Field("joints", "number of joints", get="setting.n"),
        Field("postures", "number of postures analysed"),
        *_ARM,
        replace(_CRITICAL[0], key="critical_joint"),
        replace(_CRITICAL[2], key="critical_tolerated"),
        replace(_WORST_RHO, parts=parts.ESTIMATE[:1]),
        _EVENNESS,
    )
    size = (
        *_SIZE,
        Field("size_tolerated", _CASES, "1", get="tolerated.value"),
        Field("size_low", "lower end of its 95 % interval", "1", get="tolerated.low"),
        Field("size_high", "upper end of its 95 % interval", "1", get="tolerated.high"),
        Field("size_borderline", _CASES, "1", get="borderline"),
        parts.quantiles(MARGIN, _LOW, parts=parts.ESTIMATE[:1]),
        parts.quantiles(_RHO, _LOW, parts=parts.ESTIMATE[:1]),
        _RHO_BOUND,
        parts.quantiles(_JUMP, _HIGH, parts=parts.ESTIMATE[:1]),
    )
    healthy, capability = (
        parts.quantiles(replace(one, unit=unit), _LOW, parts=parts.ESTIMATE[:1])
        for one in (_HEALTHY, _CAPABILITY)
    )
    axes, task, length, joint_length, *others = parts.SETTING_COLUMNS
    return (
        *under("arm", arm),
        *under("one", size),
        *under("arm", [healthy]),
        *under("one", [capability]),
        *under("arm.workspace", (_REACH, _CELL, *_VOLUMES)),
        *under("arm.setting", (axes, task, length, joint_length, _MODE, *others)),
        *under("arm.setting", (ROBOT, ROBOT_SHA256)),
    )


def comparison_rows(comparison: Comparison) -> list[Row]:
    """Return a comparison as table rows, header first: one per arm and set size, best first."""
    fields = comparison_columns(comparison.question.capability_unit)
    cases = (_Case(arm, one) for arm in comparison.arms for one in arm.sizes)
    return rows_of(columns(fields, case) for case in cases)
