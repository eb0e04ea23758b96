"""Sweeps as text, JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from ftforce.core.verdict import Verdict
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
from ftforce.report.text import joined, percent, share, vector_in_words, with_units

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.batch.result import Sweep, SweepSetting
    from ftforce.batch.summary.criticality import Estimate, JointCriticality
    from ftforce.core.ranks import Rank

_HOW = {
    "locked": ("joint locks", "joints lock"),
    "free": ("joint becomes free-swinging", "joints become free-swinging"),
}
_HARDLY = 1e-3  # up to this fraction not tolerated, borderline cases say more


def sweep_sentence(sweep: Sweep) -> str:
    """Describe how many postures keep the force, and which joint is critical."""
    if not sweep.done:
        return "No posture has been analysed yet."
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
    if seldom <= 0.0:  # then the first is the one that is borderline most often
        return (
            f"Nothing is lost; the most critical joint is {names[first.joint]}: "
            f"{percent(first.borderline)} of {_cases(first)} are borderline."
        )
    if seldom <= _HARDLY and doubtful.borderline > 10.0 * seldom:
        return (
            f"Almost nothing is lost; the most critical joint is {names[first.joint]}: "
            f"{_share_of(first)}. {names[doubtful.joint]} is borderline most often: in "
            f"{percent(doubtful.borderline)} of {_cases(doubtful)}."
        )
    alike = [joint for joint in sweep.joints if _overlap(joint.not_tolerated, first.not_tolerated)]
    if len(alike) == len(names) > 1:
        share = _share_of(first, f"the failure of {names[first.joint]}")
        return f"No joint is more critical than the others: {share}."
    if len(alike) > 1:
        together = joined(names[joint.joint] for joint in alike)
        share = _share_of(first, f"the failure of {names[first.joint]}")
        return f"The critical joints are {together}, too close to tell apart: {share}."
    return f"The critical joint is {names[first.joint]}: {_share_of(first)}."


def _borderline(joint: JointCriticality) -> float:
    return joint.borderline


def _cases(joint: JointCriticality) -> str:
    return "the postures" if joint.sets == 1 else f"the cases ({joint.sets} sets per posture)"


def _share_of(joint: JointCriticality, failure: str = "its failure") -> str:
    return f"{percent(joint.not_tolerated.value)} of {_cases(joint)} do not tolerate {failure}"


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
        return "not evaluated (no force or direction)"
    axis = vector_in_words(setting.direction)
    return f"the largest commanded force along {axis}, limits: {setting.limits}"


def interval(one: Estimate) -> str:
    """Format a fraction in percent with its confidence interval."""
    if math.isnan(one.value):
        return "–"
    return f"{share(one.value)} ({share(one.low)}–{share(one.high)})"


# fmt: off
_JUMP = Field("jump", "‖ΔF‖, `null` above the force itself; `null` without a force", parts.FORCE)
_CAPABILITY = Field("capability", "largest force that can be commanded; a quantile without a known "
    "limit is `null`; `null` if the capability is not evaluated", parts.FORCE)
# fmt: on


def _measures(
    jump: str = parts.FORCE, capability: str = parts.FORCE, rho: str = RHO.key
) -> tuple[Field, ...]:
    """Return the quantiles of a fault set's measures, with units and the key of ρ."""
    return (
        parts.quantiles(MARGIN, ("5", "50")),
        parts.quantiles(replace(RHO, key=rho), ("5", "50"), "rho"),
        parts.quantiles(replace(_JUMP, unit=jump), ("50", "95", "most")),
        parts.quantiles(replace(_CAPABILITY, unit=capability), ("5", "50")),
    )


_VERDICTS = tuple(
    parts.estimate(verdict.name.lower(), f"share of the postures at which it is {verdict.value}")
    for verdict in Verdict
)
# fmt: off
_SHARES = (
    Field("loses_rank", "share of the postures in which a direction of force is lost", "1"),
    Field("falls", "share in which the arm cannot be held in static equilibrium; `null` without a "
        "force", "1"),
)
_SET = (
    parts.FAILED,
    *_VERDICTS,
    *_SHARES,
    *_measures(),
)
_JOINT = (
    Field("joint", "name", shape="name"),
    Field("sets", "number of sets that contain it"),
    parts.estimate("not_tolerated", "share of postures × these sets"),
    Field("borderline", "share of postures × these sets", "1"),
    parts.estimate("alone", "share of the postures not tolerated when it fails alone"),
    parts.quantiles(MARGIN, ("5", "50"), parts=parts.ESTIMATE),
    parts.quantiles(RHO, ("5", "50"), "rho", parts.ESTIMATE),
    parts.estimate("capability", "median when it fails alone; `null` if the capability is not "
        "evaluated", parts.FORCE),
)
class _Ranked(NamedTuple):
    """A fault set or joint, and its rank."""

    rank: Rank
    one: Any


def _ranked(ranks: Sequence[Rank], ones: Sequence[Any]) -> list[_Ranked]:
    return [_Ranked(*pair) for pair in zip(ranks, ones, strict=True)]


_RANK = replace(parts.RANK, meaning="first and last rank: those whose intervals overlap share "
    "theirs")
_CONVENTIONS = (
    *parts.SETTING_TASK[:2],
    parts.SETTING_COMPONENTS,
    *parts.SETTING_TASK[2:],
    parts.SIGN,
    Field("units", "units of jump, capability and positions", shape="by quantity",
        get=lambda x: {"jump": x.size_unit, "capability": x.capability_unit, "place": "m"}),
    *constants({
        "quantiles": "of histograms, to one bin: 0.001 of margin and rho, 0.001 of the force "
        "for jumps, a hundredth of a decade for capabilities",
        "intervals": "95 %",
    }),
    parts.GRAVITY,
    *parts.SETTING_PAYLOAD,
    parts.RTOL,
    parts.WARY,
)
_SURVIVAL = (
    Field("edge", "edge length of a cell", "m", get="workspace.edge"),
    Field("origin", "lowest corner of the grid, in the axes of the root", "m", "3",
        "workspace.origin"),
    Field("shape", "number of cells along x, y, z", shape="3", get="workspace.shape"),
    Field("visited_cells", "cells with postures", get=lambda x: int((x.cell_postures > 0).sum())),
    Field("outside", "postures whose tip lies outside the grid; they count in the outermost cells",
        get=lambda summary: int(summary.outside)),
)
SWEEP = (
    Field("robot", "the kinematic chain", get="setting", parts=parts.SETTING_ARM),
    Field("conventions", "conventions of the document", get="setting", parts=_CONVENTIONS),
    Field("postures", "the analysed postures", get=whole, parts=(
        Field("source", "description", get="setting.postures"),
        *parts.SWEEP_POSTURES,
    )),
    Field("faults", "size of the largest sets", get="setting.largest"),
    Field("mode", "`locked` or `free`", get="setting.mode"),
    Field("force", "requested force; `null` without", parts.FORCE, "m", "setting.force"),
    Field("direction", "of the capability; `null` without", "1", "m", "setting.direction"),
    Field("friction", "of free-swinging joints, in words; `null` if joints do not swing",
        get="setting.friction"),
    Field("limits", "torque limits of the capability; `null` if it is not evaluated",
        get=lambda sweep: parts.limited(sweep.setting), parts=(
        Field("source", "source of the limits", get="limits"),
        Field("unknown", "joints whose limit is unknown", shape="list of names",
            get="unknown_limits"),
    )),
    parts.estimate("every_set_tolerated", "share of the postures that tolerate every set",
        get="every_set"),
    Field("workspace", "grid of cells", get="summary", parts=_SURVIVAL),
    Field("healthy", "the healthy arm, the baseline", get=whole, parts=(
        parts.quantiles(replace(MARGIN, meaning="σ_min(J̃)/σ_max(J̃)"), ("5", "50"),
            "healthy_margin"),
    )),
    Field("sets", "every fault set, worst first", shape="list",
        get=lambda sweep: _ranked(sweep.set_ranks, sweep.ranked),
        parts=(_RANK, *under("one", _SET))),
    Field("joints", "every joint, most critical first", shape="list",
        get=lambda sweep: _ranked(sweep.joint_ranks, sweep.joints),
        parts=(_RANK, *under("one", _JOINT))),
    Field("stored", "path of the Zarr group; `null` in memory", get="path"),
    Field("computed_with", "`kernels`, the compiled ones, or `numpy`, with the same counts",
        get="setting.computed_with"),
    replace(parts.SUMMARY, get=sweep_sentence),
    parts.WARNINGS,
)
# fmt: on


def sweep_document(sweep: Sweep) -> Document:
    """Return the summary of a sweep as a JSON document; samples stay in its Zarr group."""
    return document(SWEEP, sweep, sweep.setting.joints)


def sweep_columns(
    jump: str = parts.FORCE, capability: str = parts.FORCE, postures: int = 0
) -> tuple[Field, ...]:
    """Return the CSV columns, with the units of jump and capability and the number of postures."""
    tolerated, borderline, not_tolerated = _VERDICTS
    one = (
        parts.FAULT_SET,
        parts.FAILED,
        Field("postures", "number of postures analysed", get=lambda _: postures),
        tolerated,
        replace(borderline, parts=parts.ESTIMATE[:1]),
        not_tolerated,
        *_SHARES,
        *_measures(jump, capability, "rho"),
    )
    return (*under("one", one), *parts.RANK_COLUMNS)


def sweep_rows(sweep: Sweep) -> list[Row]:
    """Return a sweep as table rows, header first: one per fault set, worst first."""
    setting = sweep.setting
    names, about = setting.joints, columns(parts.SETTING_COLUMNS, setting)
    fields = sweep_columns(setting.size_unit, setting.capability_unit, sweep.done)
    ranked = _ranked(sweep.set_ranks, sweep.ranked)
    return rows_of(columns(fields, one, names) | about for one in ranked)
