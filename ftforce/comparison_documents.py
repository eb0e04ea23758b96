"""Comparisons as dictionaries and rows: what JSON and CSV hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ftforce.batch.arm_report import CONFIDENCE
from ftforce.comparison_words import KEY, comparison_sentence
from ftforce.document_parts import Document, finite

if TYPE_CHECKING:
    from ftforce.batch.arm_report import ArmReport, SizeReport
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.criticality import Estimate
    from ftforce.batch.result import SweepSetting

    Row = tuple[Any, ...]


def comparison_document(comparison: Comparison) -> Document:
    """Return a comparison: what was asked, and the arms, best first."""
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
        "force": None if asked.force is None else list(asked.force),
        "direction": None if asked.direction is None else list(asked.direction),
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
        "tolerated": _estimate(arm.tolerated),
        "every": _estimate(arm.every),
        "full_rank": arm.full_rank,
        "worst_rho": _estimate(arm.worst_rho),
        "evenness": finite(arm.evenness),
        "critical_joint": {
            "joint": setting.joints[critical.joint],
            "number": critical.joint + 1,
            "tolerated": arm.critical_tolerated,
            "not_tolerated": _estimate(critical.not_tolerated),
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
        "tolerated": _estimate(one.tolerated),
        "borderline": one.borderline,
        "margin": _pair(one.margin, "q05", "q50"),
        "rho": _pair(one.rho, "q05", "q50"),
        "rho_bound": finite(one.rho_bound),
        "jump": _pair(one.jump, "q50", "q95"),
        "capability": _pair(one.capability, "q05", "q50"),
    }


def _estimate(found: Estimate) -> Document:
    """Return a number and its interval; ``None`` where undefined or without end."""
    return {"value": finite(found.value), "low": finite(found.low), "high": finite(found.high)}


def _pair(found: tuple[Estimate, Estimate] | None, first: str, second: str) -> Document | None:
    return None if found is None else {first: _estimate(found[0]), second: _estimate(found[1])}


def comparison_rows(comparison: Comparison) -> list[Row]:
    """Return one row per arm and size of fault sets, best arm first, after the header."""
    asked = comparison.question
    unit = asked.capability_unit
    header = (
        "arm", "rank_first", "rank_last", "joints", "postures",
        "tolerated", "tolerated_low", "tolerated_high", "every", "every_low", "every_high",
        "full_rank", "critical_joint", "critical_tolerated", "worst_rho", "evenness",
        "size", "sets", "size_tolerated", "size_low", "size_high", "size_borderline",
        "margin_q05", "margin_q50", "rho_q05", "rho_q50", "rho_bound", "jump_q50", "jump_q95",
        f"healthy_capability_q05 [{unit}]", f"healthy_capability_q50 [{unit}]",
        f"capability_q05 [{unit}]", f"capability_q50 [{unit}]",
        "reach [m]", "cell [m]", "visited [m³]", "survived [m³]", "some [m³]",
        "axes", "task", "length [m]", "mode", "limits", "rtol", "wary",
    )  # fmt: skip
    return [header, *(_row(arm, one) for arm in comparison.arms for one in arm.sizes)]


def _row(arm: ArmReport, one: SizeReport) -> Row:
    setting, place = arm.setting, arm.workspace
    jump, healthy, after = one.jump, arm.healthy_capability, one.capability
    return (
        arm.name, arm.first, arm.last, setting.n, arm.postures,
        *arm.tolerated, *arm.every,
        arm.full_rank, setting.joints[arm.critical.joint], arm.critical_tolerated,
        finite(arm.worst_rho.value), finite(arm.evenness),
        one.size, one.sets, *one.tolerated, one.borderline,
        *_values(one.margin), *_values(one.rho), finite(one.rho_bound), *_values(jump),
        *_values(healthy), *_values(after),
        place.reach, place.cell, place.visited, place.survived, place.some,
        setting.axes, setting.task, setting.length if _has_moments(setting) else "",
        setting.mode, setting.limits or "none", setting.rtol, setting.wary,
    )  # fmt: skip


def _values(pair: tuple[Estimate, Estimate] | None) -> tuple[float | None, float | None]:
    return (None, None) if pair is None else (finite(pair[0].value), finite(pair[1].value))
