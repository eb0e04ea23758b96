"""Capabilities as text, JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ftforce.core.faults import FaultMode
from ftforce.core.feasible_forces import LimitingFactor, LockModel
from ftforce.report import parts, text
from ftforce.report.analysis import SITUATION, UNKNOWN_LIMITS, faults_in_words
from ftforce.report.fields import Document, Field, Row, columns, document, rows_of, under, whole
from ftforce.report.text import NEGLIGIBLE, direction, joined, size, unit_of_size

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.analysis.analyze import Analysis
    from ftforce.analysis.capability import Capability, CapabilityRange
    from ftforce.core.arrays import Vector


def capability_sentence(capability: Capability) -> str:
    """Describe what remains of the weakest direction and of the payload."""
    faults = faults_in_words(capability.analysis)
    # str.capitalize would change the case of joint names.
    return f"W{faults[1:]}, {_about_force(capability)}; {_about_payload(capability)}."


def _about_force(capability: Capability) -> str:
    analysis, weakest = capability.analysis, capability.weakest
    before, after = (x[LockModel.COMMANDED] for x in (weakest.before, weakest.after))
    everywhere = "in every direction that the healthy arm has"
    unit = unit_of_size(analysis.task)
    earlier = _earlier(capability, before, after, unit)
    if math.isfinite(after.maximum) and after.maximum > 0.0:
        return f"the motors can command {amount_in_words(after, unit)} {everywhere}{earlier}"
    if math.isinf(after.maximum):
        return f"no known limit bounds the force that the motors can command{earlier}"
    if (
        math.isfinite(before.maximum) and after.maximum != before.maximum
    ):  # the ranges belong to different directions
        earlier = f" (before: {amount_in_words(before, unit)} in every direction)"
    if math.isnan(after.maximum):
        why = f"{end_in_words(analysis, after)} and " if after.end is LimitingFactor.WEIGHT else ""
        if analysis.can_stand_still:
            return f"{why}the arm can be held only with a force at the tip{earlier}"
        return f"{why}the arm cannot be held in static equilibrium{earlier}"
    lost = direction(analysis.task, analysis.task.weigh_force(after.direction))
    return f"no motor torque can produce {lost}{earlier}"


def _about_payload(capability: Capability) -> str:
    before, after = capability.payload
    more = " more" if capability.analysis.conditions.payload is not None else ""
    earlier = _earlier(capability, before, after, "kg")
    if math.isnan(after.maximum):
        return f"the arm cannot be held with any payload{earlier}"
    if math.isinf(after.maximum):
        return f"no known limit bounds the payload{earlier}"
    if after.maximum == 0.0:
        return f"the tip can carry no payload{earlier}"
    return f"the tip carries {amount_in_words(after, 'kg')}{more}{earlier}"


def _earlier(
    capability: Capability, before: CapabilityRange, after: CapabilityRange, unit: str
) -> str:
    if not capability.analysis.faults.faults:
        return ""
    then, now = (amount_in_words(amount, unit) for amount in (before, after))
    return ", as before" if then == now else f" ({then} before)"


def amount_in_words(amount: CapabilityRange, unit: str) -> str:
    """Describe a capability range: nothing, a value, an interval, or no known limit."""
    if math.isnan(amount.maximum):
        return "nothing"
    most = "no known limit" if math.isinf(amount.maximum) else f"{size(amount.maximum)} {unit}"
    if amount.minimum <= NEGLIGIBLE:
        return most
    return f"only {most}" if is_point(amount) else f"only {size(amount.minimum)} {unit} to {most}"


def is_point(amount: CapabilityRange) -> bool:
    """Return whether the range is a single nonzero value."""
    least, most = amount.minimum, amount.maximum
    if least <= NEGLIGIBLE or math.isinf(most):
        return False
    return most - least <= NEGLIGIBLE * max(1.0, most)


def end_in_words(analysis: Analysis, amount: CapabilityRange, *, after: bool = True) -> str:
    """Describe what limits a range, before or after the fault; no joint is braked before."""
    names = [analysis.robot.names[j] for j in amount.limiting_joints]
    if amount.end is LimitingFactor.UNLIMITED:
        return "no known limit"
    if amount.end is LimitingFactor.WEIGHT:
        return f"weight overloads {joined(names)}" if names else "weight"
    if amount.end is LimitingFactor.DIRECTION:
        return "the arm lacks it"
    if amount.end is LimitingFactor.FAULT:
        return f"fault of {joined(names)}" if names else "beyond the healthy arm"
    if amount.end is LimitingFactor.FRICTION:
        return f"friction of {joined(names)}"
    locked = set(analysis.faults.in_mode(FaultMode.LOCKED)) if after else set()
    words = (
        f"{'brake of ' if j in locked else ''}{name}"
        for j, name in zip(amount.limiting_joints, names, strict=True)
    )
    return joined(words)


# fmt: off
CAPABILITY_FIELDS = (
    *under("analysis", SITUATION),
    *under("analysis", parts.MODES),
    Field("limits", parts.LIMITS_MEANING, get=lambda capability: parts.limited(capability.analysis),
        parts=(*parts.LIMITS_IN_FORCE, UNKNOWN_LIMITS)),
    Field("capability", "forces and payload that can be held", get=whole, parts=parts.CAPABILITY),
    parts.POLYTOPE,
    replace(parts.SUMMARY, get=capability_sentence),
    *under("analysis", [parts.WARNINGS]),
)
# fmt: on


def capability_document(capability: Capability) -> Document:
    """Return a capability as a JSON document."""
    return document(CAPABILITY_FIELDS, capability, capability.analysis.robot.names)


class _Entry(NamedTuple):
    """A row of a capability's table; no direction for a payload, or if none is the weakest."""

    analysis: Analysis
    quantity: str
    unit: str
    when: str
    reading: str
    amount: CapabilityRange
    direction: Vector | None = None


# fmt: off
CAPABILITY_COLUMNS = (
    Field("quantity", "`+fx`, `-fx`, …, `direction`, `weakest` or `payload`"),
    Field("unit", "`N`, `N·m` or `kg`"),
    Field("when", "`before` or `after`"),
    Field("reading", "`commanded` or `held`"),
    *under("amount", parts.AMOUNT),
    Field("direction", "in the axes of the task; empty for a payload", "1", "m"),
    *under("analysis", (parts.FAULT_SET, *parts.TASK_COLUMNS, parts.LIMITS_SOURCE)),
)
# fmt: on


def capability_rows(capability: Capability) -> list[Row]:
    """Return a capability as table rows, one per direction, time and lock model."""
    analysis, components = capability.analysis, capability.analysis.task.components
    names, units = analysis.robot.names, dict.fromkeys(components, "")
    return rows_of(
        columns(CAPABILITY_COLUMNS, entry, names, units) for entry in _entries(capability)
    )


def _entries(capability: Capability) -> Iterator[_Entry]:
    analysis, weakest = capability.analysis, capability.weakest
    for report in (*capability.directions, weakest):
        unit = text.unit_of_size(analysis.task) if report is weakest else report.unit
        for when, amounts in (("before", report.before), ("after", report.after)):
            for reading in LockModel:
                amount = amounts[reading]
                direction = parts.WEAKEST.value(amount) if report is weakest else amount.direction
                yield _Entry(analysis, report.name, unit, when, reading.value, amount, direction)
    for when, amount in zip(("before", "after"), capability.payload, strict=True):
        yield _Entry(analysis, "payload", "kg", when, "held", amount)
