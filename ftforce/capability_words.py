"""Capabilities in plain words, for tables and files alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.faults import FaultMode
from ftforce.feasible import End, Reading
from ftforce.sentences import faults_in_words
from ftforce.words import joined, size

if TYPE_CHECKING:
    from ftforce.analysis import Analysis
    from ftforce.force_capability import Amount, Capability


def capability_sentence(capability: Capability) -> str:
    """Say what is left of the weakest direction and of the payload."""
    analysis = capability.analysis
    before, after = (
        amounts[Reading.COMMANDED]
        for amounts in (capability.weakest.before, capability.weakest.after)
    )
    unit = capability.weakest.unit
    sentence = f"W{faults_in_words(analysis)[1:]}, "  # names keep their capitals
    if math.isnan(after.most):
        sentence += f"the arm cannot hold itself ({end_in_words(analysis, after)})"
    elif after.most == 0.0:
        sentence += "no motor can command a force along the weakest direction"
    else:
        sentence += (
            f"the motors can command {amount_in_words(after, unit)} in every direction that the "
            f"healthy arm has ({amount_in_words(before, unit)} before)"
        )
    loads = (amount_in_words(x, "kg") for x in capability.payload)
    healthy, damaged = loads
    return f"{sentence}; the tip carries {damaged} ({healthy} before)."


def amount_in_words(amount: Amount, unit: str) -> str:
    """Say an amount: nothing, a number, or no limit that is known."""
    if math.isnan(amount.most):
        return "nothing"
    if math.isinf(amount.most):
        return f"any {'payload' if unit == 'kg' else 'force'} (no limit is known)"
    return f"{size(amount.most)} {unit}"


def end_in_words(analysis: Analysis, amount: Amount) -> str:
    """Say what ends an amount."""
    names = [analysis.robot.names[j] for j in amount.stops]
    if amount.end is End.NOTHING:
        return "no known limit"
    if amount.end is End.WEIGHT:
        return f"weight overloads {joined(names)}" if names else "weight"
    if amount.end is End.FAULT:
        return f"fault of {joined(names)}" if names else "the arm lacks it"
    locked = set(analysis.faults.in_mode(FaultMode.LOCKED))
    words = (
        f"{'brake of ' if j in locked else ''}{name}"
        for j, name in zip(amount.stops, names, strict=True)
    )
    return joined(words)
