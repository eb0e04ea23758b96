"""Comparisons of arms as text, JSON and table rows."""

from __future__ import annotations

import math
from operator import itemgetter
from typing import TYPE_CHECKING

from ftforce.batch.arm_report import CONFIDENCE
from ftforce.report.parts import (
    Document,
    Row,
    estimate_part,
    finite,
    interval_columns,
    listed,
    rows_of,
)
from ftforce.report.text import NEGLIGIBLE, joined, share, size, vector_in_words

if TYPE_CHECKING:
    from ftforce.batch.arm_report import ArmReport, SizeReport
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.result import SweepSetting
    from ftforce.batch.summary.criticality import Estimate

_MOST_NAMED = 4

KEY = (
    "the share of postures x fault sets that are tolerated, every size of sets weighing the same; "
    "borderline is not tolerated"
)
"""Ranking criterion of the arms."""


def ranks(arm: ArmReport) -> str:
    """Format the rank of an arm, or the range of ranks that the intervals allow."""
    return str(arm.first) if arm.first == arm.last else f"{arm.first}–{arm.last}"


def fault_words(setting: SweepSetting) -> str:
    """Describe the faults of a sweep: ``one joint locked``."""
    state = "swinging freely" if setting.mode == "free" else setting.mode
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
        f"{best.name} degrades best: with {fault_words(best.setting)} it {_keeps(best)} at "
        f"{share(best.tolerated.value)}% of the postures and fault sets "
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
        return "can still command every force that it could"
    return "keeps the force"


def _worst(comparison: Comparison) -> list[str]:
    worst = comparison.arms[-1]
    if worst.first == 1:
        return []
    found = f"{worst.name} degrades worst: {share(worst.tolerated.value)}%"
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
    return [f"{arm.name} can still command most {where}: {amount}."]


def comparison_document(comparison: Comparison) -> Document:
    """Return a comparison as a JSON document: the question, and the arms, best first."""
    asked = comparison.question
    return {
        "question": _question(asked),
        "ranked_by": KEY,
        "confidence": CONFIDENCE,
        "enough": comparison.enough,
        "units": {
            "tolerated, every, borderline, full_rank, share": "1",
            "margin, rho, evenness": "1",
            "jump": "share of the force",
            "capability": asked.capability_unit,
            "visited, survived, some": "m³",
            "cell, reach": "m",
        },
        "arms": [_arm(arm) for arm in comparison.arms],
        "summary": comparison_sentence(comparison),
        "warnings": list(comparison.warnings),
    }


def _question(asked: SweepSetting) -> Document:
    return {
        "task": asked.task,
        "components": list(asked.components),
        "axes": asked.axes,
        "length": asked.length if _has_moments(asked) else None,
        "mode": asked.mode,
        "faults": asked.largest,
        "force": listed(asked.force),
        "direction": listed(asked.direction),
        "limits_count": asked.limits is not None,
        "gravity": list(asked.gravity),
        "payload": asked.payload,
        "rtol": asked.rtol,
        "wary": asked.wary,
    }


def _has_moments(asked: SweepSetting) -> bool:
    return any(name[0] == "m" for name in asked.components)


def _arm(arm: ArmReport) -> Document:
    setting, place, critical = arm.setting, arm.workspace, arm.critical
    return {
        "name": arm.name,
        "rank": [arm.first, arm.last],
        "robot": setting.robot,
        "base": setting.base,
        "tip": setting.tip,
        "joints": list(setting.joints),
        "sweep": arm.path,
        "postures": {"count": arm.postures, "source": setting.postures},
        "limits": setting.limits,
        "unknown_limits": list(setting.unknown_limits),
        "tolerated": estimate_part(arm.tolerated),
        "every": estimate_part(arm.every),
        "full_rank": arm.full_rank,
        "worst_rho": estimate_part(arm.worst_rho),
        "evenness": finite(arm.evenness),
        "critical_joint": {
            "joint": setting.joints[critical.joint],
            "number": critical.joint + 1,
            "tolerated": arm.critical_tolerated,
            "not_tolerated": estimate_part(critical.not_tolerated),
            "borderline": critical.borderline,
        },
        "sizes": [_size(one) for one in arm.sizes],
        "healthy_capability": _pair(arm.healthy_capability, "q05", "q50"),
        "capability_kept": finite(arm.capability_kept),
        "workspace": {
            "cell": place.cell,
            "visited": place.visited,
            "survived": place.survived,
            "some": place.some,
            "share": finite(place.share),
            "reach": place.reach,
        },
    }


def _size(one: SizeReport) -> Document:
    return {
        "size": one.size,
        "sets": one.sets,
        "tolerated": estimate_part(one.tolerated),
        "borderline": one.borderline,
        "margin": _pair(one.margin, "q05", "q50"),
        "rho": _pair(one.rho, "q05", "q50"),
        "rho_bound": finite(one.rho_bound),
        "jump": _pair(one.jump, "q50", "q95"),
        "capability": _pair(one.capability, "q05", "q50"),
    }


def _pair(found: tuple[Estimate, Estimate] | None, first: str, second: str) -> Document | None:
    return (
        None if found is None else {first: estimate_part(found[0]), second: estimate_part(found[1])}
    )


def comparison_rows(comparison: Comparison) -> list[Row]:
    """Return a comparison as table rows, header first: one per arm and set size, best first."""
    unit = comparison.question.capability_unit
    return rows_of(_columns(arm, one, unit) for arm in comparison.arms for one in arm.sizes)


def _columns(arm: ArmReport, one: SizeReport, unit: str) -> Document:
    setting, place = arm.setting, arm.workspace
    return {
        "arm": arm.name,
        "rank_first": arm.first,
        "rank_last": arm.last,
        "joints": setting.n,
        "postures": arm.postures,
        **interval_columns("tolerated", arm.tolerated),
        **interval_columns("every", arm.every),
        "full_rank": arm.full_rank,
        "critical_joint": setting.joints[arm.critical.joint],
        "critical_tolerated": arm.critical_tolerated,
        "worst_rho": finite(arm.worst_rho.value),
        "evenness": finite(arm.evenness),
        "size": one.size,
        "sets": one.sets,
        "size_tolerated": one.tolerated.value,
        "size_low": one.tolerated.low,
        "size_high": one.tolerated.high,
        "size_borderline": one.borderline,
        **_quantiles("margin", one.margin),
        **_quantiles("rho", one.rho),
        "rho_bound": finite(one.rho_bound),
        **_quantiles("jump", one.jump, ("q50", "q95")),
        **_quantiles("healthy_capability", arm.healthy_capability, unit=f" [{unit}]"),
        **_quantiles("capability", one.capability, unit=f" [{unit}]"),
        "reach [m]": place.reach,
        "cell [m]": place.cell,
        "visited [m³]": place.visited,
        "survived [m³]": place.survived,
        "some [m³]": place.some,
        "axes": setting.axes,
        "task": setting.task,
        "length [m]": setting.length if _has_moments(setting) else "",
        "mode": setting.mode,
        "limits": setting.limits or "none",
        "rtol": setting.rtol,
        "wary": setting.wary,
    }


def _quantiles(
    name: str,
    pair: tuple[Estimate, Estimate] | None,
    ends: tuple[str, str] = ("q05", "q50"),
    unit: str = "",
) -> Document:
    values = (None, None) if pair is None else (finite(one.value) for one in pair)
    return {f"{name}_{end}{unit}": x for end, x in zip(ends, values, strict=True)}
