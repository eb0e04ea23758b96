"""Sweeps as text, JSON and table rows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.report import text
from ftforce.report.parts import (
    Document,
    Row,
    estimate_part,
    finite,
    interval_columns,
    listed,
    rows_of,
    setting_part,
)
from ftforce.report.text import joined, percent, share, vector_in_words, with_units

if TYPE_CHECKING:
    from ftforce.batch.result import Sweep, SweepSetting
    from ftforce.batch.summary.criticality import Estimate, JointCriticality, SetSummary

_HOW = {
    "locked": ("joint locks", "joints lock"),
    "free": ("joint swings free", "joints swing free"),
}
_HARDLY = 1e-3  # up to this fraction not tolerated, borderline cases say more


def sweep_sentence(sweep: Sweep) -> str:
    """Describe how many postures keep the force, and which joint is critical."""
    if not sweep.done:
        return "No posture is done yet."
    one, more = _HOW[sweep.setting.mode]
    largest = sweep.setting.largest
    fault = one if largest == 1 else f"{largest} {more}"
    kept = "the force" if sweep.setting.force is not None else "every direction of force"
    share_left = percent(sweep.every_set.value)
    return f"{share_left} of {sweep.done:,} postures keep {kept} whichever {fault}. " + _critical(
        sweep
    )


def _critical(sweep: Sweep) -> str:
    first, names = sweep.joints[0], sweep.setting.joints
    if first.not_tolerated.value + first.borderline <= 0.0:
        return "No joint is critical: every set is tolerated in every posture."
    doubtful = max(sweep.joints, key=_borderline)
    seldom = first.not_tolerated.value
    if seldom <= _HARDLY and doubtful.borderline > 10.0 * seldom:
        never = "Nothing is not tolerated" if seldom <= 0.0 else "Hardly anything is lost"
        return (
            f"{never}; closest to it is {names[doubtful.joint]}: "
            f"{percent(doubtful.borderline)} of {_cases(doubtful)} are borderline."
        )
    alike = [joint for joint in sweep.joints if _overlap(joint.not_tolerated, first.not_tolerated)]
    if len(alike) == len(names) > 1:
        return f"No joint is more critical than the others: {_share_of(first)}."
    if len(alike) > 1:
        together = joined(names[joint.joint] for joint in alike)
        return f"The critical joints are {together}, too close to tell apart: {_share_of(first)}."
    return f"The critical joint is {names[first.joint]}: {_share_of(first)}."


def _borderline(joint: JointCriticality) -> float:
    return joint.borderline


def _cases(joint: JointCriticality) -> str:
    return "the postures" if joint.sets == 1 else f"the cases ({joint.sets} sets per posture)"


def _share_of(joint: JointCriticality) -> str:
    return f"{percent(joint.not_tolerated.value)} of {_cases(joint)} do not tolerate its failure"


def _overlap(one: Estimate, other: Estimate) -> bool:
    return one.low <= other.high and other.low <= one.high


def force_in_words(setting: SweepSetting) -> str:
    """Describe the requested force."""
    if setting.force is None:
        return "every direction (none given)"
    units = ("N" if name[0] == "f" else "N·m" for name in setting.components)
    return with_units(setting.components, setting.force, units)


def direction_in_words(setting: SweepSetting) -> str:
    """Describe the requested capability and the torque limits."""
    if setting.direction is None or setting.limits is None:
        return "not asked (no force or direction)"
    axis = vector_in_words(setting.direction)
    return f"the largest force commanded along {axis}, limits: {setting.limits}"


def interval(one: Estimate) -> str:
    """Format a fraction in percent with its confidence interval."""
    if math.isnan(one.value):
        return "–"
    return f"{share(one.value)} ({share(one.low)}–{share(one.high)})"


def sweep_document(sweep: Sweep) -> Document:
    """Return the summary of a sweep as a JSON document; samples stay in its Zarr group."""
    setting = sweep.setting
    names = setting.joints
    return {
        "robot": setting_part(setting),
        "conventions": _conventions(sweep),
        "postures": {
            "source": setting.postures,
            "count": setting.count,
            "done": sweep.done,
            "random": setting.is_random,
        },
        "faults": setting.largest,
        "mode": setting.mode,
        "force": listed(setting.force),
        "direction": listed(setting.direction),
        "limits": None
        if setting.limits is None
        else {"source": setting.limits, "unknown": list(setting.unknown_limits)},
        "every_set_tolerated": estimate_part(sweep.every_set),
        "workspace": _workspace(sweep),
        "sets": [_set(names, one) for one in sweep.ranked],
        "joints": [_joint(names, one) for one in sweep.joints],
        "stored": sweep.path,
        "summary": sweep_sentence(sweep),
        "warnings": list(sweep.warnings),
    }


def _conventions(sweep: Sweep) -> Document:
    setting = sweep.setting
    has_moments = any(name[0] == "m" for name in setting.components)
    return {
        "axes": setting.axes,
        "task": setting.task,
        "components": list(setting.components),
        "length": setting.length if has_moments else None,
        "sign": text.SIGN,
        "units": {"jump": setting.size_unit, "capability": setting.capability_unit, "place": "m"},
        "quantiles": "of histograms, to one bin: 0.001 of margin and rho, 0.001 of the force for "
        "jumps, a hundredth of a decade for capabilities",
        "intervals": "95 %",
        "gravity": list(setting.gravity),
        "payload": setting.payload,
        "rtol": setting.rtol,
        "wary": setting.wary,
    }


def _workspace(sweep: Sweep) -> Document:
    summary = sweep.summary
    visited = summary.cell_postures > 0
    return {
        "edge": summary.workspace.edge,
        "origin": list(summary.workspace.origin),
        "shape": list(summary.workspace.shape),
        "visited_cells": int(visited.sum()),
        "outside": int(summary.outside),
    }


def _set(names: tuple[str, ...], one: SetSummary) -> Document:
    jump = one.jump or (math.nan,) * 3
    capability = one.capability or (math.nan,) * 2
    return {
        "joints": [names[i] for i in one.faults.joints],
        "tolerated": estimate_part(one.tolerated),
        "borderline": estimate_part(one.borderline),
        "not_tolerated": estimate_part(one.not_tolerated),
        "loses_rank": finite(one.loses_rank),
        "falls": finite(one.falls),
        "margin": _quantiles(("5", "50"), one.margin),
        "relative_manipulability": _quantiles(("5", "50"), one.rho),
        "jump": None if one.jump is None else _quantiles(("50", "95", "most"), jump),
        "capability": None if one.capability is None else _quantiles(("5", "50"), capability),
    }


def _quantiles(keys: tuple[str, ...], values: tuple[float, ...]) -> Document:
    return {key: finite(value) for key, value in zip(keys, values, strict=True)}


def _joint(names: tuple[str, ...], one: JointCriticality) -> Document:
    return {
        "joint": names[one.joint],
        "sets": one.sets,
        "not_tolerated": estimate_part(one.not_tolerated),
        "borderline": finite(one.borderline),
        "alone": estimate_part(one.alone),
        "margin": {"5": estimate_part(one.margin[0]), "50": estimate_part(one.margin[1])},
        "relative_manipulability": {
            "5": estimate_part(one.rho[0]),
            "50": estimate_part(one.rho[1]),
        },
        "capability": None if one.capability is None else estimate_part(one.capability),
    }


def sweep_rows(sweep: Sweep) -> list[Row]:
    """Return a sweep as table rows, header first: one per fault set, worst first."""
    return rows_of(_columns(sweep, one) for one in sweep.ranked)


def _columns(sweep: Sweep, one: SetSummary) -> Document:
    setting = sweep.setting
    has_moments = any(name[0] == "m" for name in setting.components)
    jump, capability = one.jump or (math.nan,) * 3, one.capability or (math.nan,) * 2
    numbers = {
        **interval_columns("tolerated", one.tolerated),
        "borderline": one.borderline.value,
        **interval_columns("not_tolerated", one.not_tolerated),
        "loses_rank": one.loses_rank,
        "falls": one.falls,
        "margin_5": one.margin[0],
        "margin_50": one.margin[1],
        "rho_5": one.rho[0],
        "rho_50": one.rho[1],
        f"jump_50 [{setting.size_unit}]": jump[0],
        f"jump_95 [{setting.size_unit}]": jump[1],
        f"jump_most [{setting.size_unit}]": jump[2],
        f"capability_5 [{setting.capability_unit}]": capability[0],
        f"capability_50 [{setting.capability_unit}]": capability[1],
    }
    return {
        "fault_set": str(one.faults),
        "joints": " ".join(setting.joints[i] for i in one.faults.joints),
        "postures": sweep.done,
        **{name: finite(x) for name, x in numbers.items()},
        "axes": setting.axes,
        "task": setting.task,
        "length [m]": setting.length if has_moments else "",
        "limits": setting.limits or "none",
        "rtol": setting.rtol,
        "wary": setting.wary,
    }
