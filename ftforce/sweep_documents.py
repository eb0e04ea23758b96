"""Sweeps as dictionaries and rows: what JSON and CSV hold of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ftforce import words
from ftforce.document_parts import Document, finite
from ftforce.sweep_words import sweep_sentence

if TYPE_CHECKING:
    from ftforce.batch.criticality import Estimate, JointCriticality
    from ftforce.batch.result import Sweep
    from ftforce.batch.set_summaries import SetSummary


def sweep_document(sweep: Sweep) -> Document:
    """Return a sweep's summary as plain values; the samples stay in its Zarr group."""
    setting = sweep.setting
    names = setting.joints
    return {
        "robot": {
            "name": setting.robot,
            "base": setting.base,
            "tip": setting.tip,
            "joints": list(names),
        },
        "conventions": _conventions(sweep),
        "postures": {
            "source": setting.postures,
            "count": setting.count,
            "done": sweep.done,
            "random": setting.is_random,
        },
        "faults": setting.largest,
        "mode": setting.mode,
        "force": _listed(setting.force),
        "direction": _listed(setting.direction),
        "limits": None
        if setting.limits is None
        else {"source": setting.limits, "unknown": list(setting.unknown_limits)},
        "every_set_tolerated": _estimate(sweep.every_set),
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
        "sign": words.SIGN,
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


def _listed(vector: tuple[float, ...] | None) -> list[float] | None:
    return None if vector is None else list(vector)


def _estimate(one: Estimate) -> Document:
    return {"value": finite(one.value), "low": finite(one.low), "high": finite(one.high)}


def _set(names: tuple[str, ...], one: SetSummary) -> Document:
    jump = one.jump or (math.nan,) * 3
    capability = one.capability or (math.nan,) * 2
    return {
        "joints": [names[i] for i in one.faults.joints],
        "tolerated": _estimate(one.tolerated),
        "borderline": _estimate(one.borderline),
        "not_tolerated": _estimate(one.not_tolerated),
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
        "not_tolerated": _estimate(one.not_tolerated),
        "borderline": finite(one.borderline),
        "alone": _estimate(one.alone),
        "margin": {"5": _estimate(one.margin[0]), "50": _estimate(one.margin[1])},
        "relative_manipulability": {"5": _estimate(one.rho[0]), "50": _estimate(one.rho[1])},
        "capability": None if one.capability is None else _estimate(one.capability),
    }


def sweep_rows(sweep: Sweep) -> list[tuple[Any, ...]]:
    """Return one row per fault set, worst first, the header before them."""
    setting, unit = sweep.setting, sweep.setting.size_unit
    of_capability = setting.capability_unit
    header = (
        "fault_set", "joints", "postures", "tolerated", "tolerated_low", "tolerated_high",
        "borderline", "not_tolerated", "not_tolerated_low", "not_tolerated_high", "loses_rank",
        "falls", "margin_5", "margin_50", "rho_5", "rho_50", f"jump_50 [{unit}]",
        f"jump_95 [{unit}]", f"jump_most [{unit}]", f"capability_5 [{of_capability}]",
        f"capability_50 [{of_capability}]", "axes", "task", "length [m]", "limits", "rtol", "wary",
    )  # fmt: skip
    has_moments = any(name[0] == "m" for name in setting.components)
    conventions = (setting.axes, setting.task, setting.length if has_moments else "",
                   setting.limits or "none", setting.rtol, setting.wary)  # fmt: skip
    rows: list[tuple[Any, ...]] = [header]
    for one in sweep.ranked:
        numbers = (
            *one.tolerated, one.borderline.value, *one.not_tolerated, one.loses_rank, one.falls,
            *one.margin, *one.rho, *(one.jump or (math.nan,) * 3),
            *(one.capability or (math.nan,) * 2),
        )  # fmt: skip
        about = (str(one.faults), " ".join(setting.joints[i] for i in one.faults.joints))
        rows.append((*about, sweep.done, *map(finite, numbers), *conventions))
    return rows
