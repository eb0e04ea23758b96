"""Sweeps in plain sentences, for tables and files alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.report.text import joined, percent, share, vector_in_words, with_units

if TYPE_CHECKING:
    from ftforce.batch.result import Sweep, SweepSetting
    from ftforce.batch.summary.criticality import Estimate, JointCriticality

_HOW = {
    "locked": ("joint locks", "joints lock"),
    "free": ("joint swings free", "joints swing free"),
}
_HARDLY = 1e-3  # share up to which what is borderline tells more than what is not tolerated


def sweep_sentence(sweep: Sweep) -> str:
    """Say how much survives, and which joint is the critical one."""
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
    """Say which force is asked for."""
    if setting.force is None:
        return "every direction (none given)"
    units = ("N" if name[0] == "f" else "N·m" for name in setting.components)
    return with_units(setting.components, setting.force, units)


def direction_in_words(setting: SweepSetting) -> str:
    """Say which capability is asked for, and inside which limits."""
    if setting.direction is None or setting.limits is None:
        return "not asked (no force or direction)"
    axis = vector_in_words(setting.direction)
    return f"the largest force commanded along {axis}, limits: {setting.limits}"


def interval(one: Estimate) -> str:
    """Write a share in percent with its confidence interval."""
    if math.isnan(one.value):
        return "–"
    return f"{share(one.value)} ({share(one.low)}–{share(one.high)})"
