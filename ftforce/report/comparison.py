"""Comparisons in plain words, for tables and files alike."""

from __future__ import annotations

import math
from operator import itemgetter
from typing import TYPE_CHECKING

from ftforce.report.text import NEGLIGIBLE, joined, share, size, vector_in_words

if TYPE_CHECKING:
    from ftforce.batch.arm_report import ArmReport
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.result import SweepSetting

_MOST_NAMED = 4

KEY = (
    "the share of postures x fault sets that are tolerated, every size of sets weighing the same; "
    "borderline is not tolerated"
)
"""What arms are ranked by."""


def ranks(arm: ArmReport) -> str:
    """Write the rank, or the ranks that the intervals leave open."""
    return str(arm.first) if arm.first == arm.last else f"{arm.first}–{arm.last}"


def fault_words(setting: SweepSetting) -> str:
    """Say which faults were asked about: ``one joint locked``."""
    state = "swinging freely" if setting.mode == "free" else setting.mode
    if setting.largest == 1:
        return f"one joint {state}"
    return f"up to {setting.largest} joints {state}"


def critical_words(arm: ArmReport) -> str:
    """Name the critical joint: ``2 shoulder``."""
    joint = arm.critical.joint
    return f"{joint + 1} {arm.setting.joints[joint]}"


def comparison_sentence(comparison: Comparison) -> str:
    """Say which arm degrades best, which worst, and which pushes most after a fault."""
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
    """Say which arm can push most after one fault: a matter of size, not of grace."""
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
