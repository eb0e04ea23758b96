"""Tables of a force capability."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.core.feasible_forces import LockModel
from ftforce.report import capability as capability_words
from ftforce.report import text
from ftforce.report.capability import is_point
from ftforce.report.parts import MOST_DRAWN
from ftforce.report.text import size
from ftforce.show.tables.analysis import situation
from ftforce.show.tables.parts import TitledTable, facts, listing, spaced, table, warning_lines
from ftforce.show.tables.parts import amount as in_words

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.analysis.capability import Capability, CapabilityRange, DirectionReport
    from ftforce.core.polytope import Polytope


def capability_view(capability: Capability) -> RenderableType:
    """Return the tables of a capability."""
    return spaced(
        facts([*situation(capability.analysis), *_direction(capability)]),
        _directions(capability),
        _weakest(capability),
        _payload(capability),
        _polytopes(capability),
        warning_lines(capability.analysis.warnings),
        Text(capability_words.capability_sentence(capability), style="bold"),
    )


def _direction(capability: Capability) -> list[tuple[str, str]]:
    if capability.direction is None:
        return []
    return [("Direction", f"{text.vector_in_words(capability.direction)}, requested")]


def _directions(capability: Capability) -> TitledTable:
    title = "Largest force at the tip: commanded by the motors, or held with the locks"
    each = ("before\ncommanded", "\nheld", "after\ncommanded", "\nheld")
    end = "after, commanded:\nlimited by"
    result = table(title, "direction", "unit", *each, end, left=2, folded=(6,))
    for report in capability.directions:
        end = capability_words.end_in_words(capability.analysis, report.after[LockModel.COMMANDED])
        name = "requested" if report.name == "direction" else report.name
        result.add_row(name, report.unit, *map(_cell, _amounts(report)), end)
    amounts = [amount for report in capability.directions for amount in _amounts(report)]
    notes = []
    if any(math.isnan(amount.maximum) for amount in amounts):
        notes.append("– the arm cannot be held with any force in this direction")
    if any(amount.minimum > text.NEGLIGIBLE for amount in amounts):
        notes.append("only a, a to b: with less than a the arm cannot be held either")
    result.caption = "\n".join(notes)
    return result


def _amounts(report: DirectionReport) -> list[CapabilityRange]:
    return [amounts[r] for amounts in (report.before, report.after) for r in LockModel]


def _cell(amount: CapabilityRange, digits: int = 1) -> str:
    most = in_words(amount.maximum, digits)
    if math.isnan(amount.maximum) or amount.minimum <= text.NEGLIGIBLE:
        return most
    return f"only {most}" if is_point(amount) else f"{size(amount.minimum, digits)} to {most}"


def _weakest(capability: Capability) -> TitledTable:
    task, report = capability.analysis.task, capability.weakest
    rows = [
        _weakest_row(capability, when, reading, amounts[reading])
        for when, amounts in (("before", report.before), ("after", report.after))
        for reading in LockModel
    ]
    title = "Weakest direction: the one in which the least force can be held"
    return listing(title, rows, left=2, folded=(3 + task.m,))


def _weakest_row(
    capability: Capability, when: str, reading: LockModel, amount: CapabilityRange
) -> Iterator[tuple[str, str]]:
    analysis, task = capability.analysis, capability.analysis.task
    yield "when", when
    yield "force", reading.value
    yield f"largest\n[{text.unit_of_size(task)}]", _cell(amount)
    for name, x in zip(task.components, amount.direction.tolist() or [0.0] * task.m, strict=True):
        # unbounded: there is no weakest direction
        yield name, text.number(x) if math.isfinite(amount.maximum) else "–"
    yield "limited by", capability_words.end_in_words(analysis, amount, after=when == "after")


def _payload(capability: Capability) -> TitledTable:
    already = capability.analysis.conditions.payload
    title = "Payload [kg] that the tip can carry" + (
        ", in addition to the present one" if already else ""
    )
    result = table(title, "when", "kg", "limited by", left=1, folded=(2,))
    for when, amount in zip(("before", "after"), capability.payload, strict=True):
        late = when == "after"
        end = capability_words.end_in_words(capability.analysis, amount, after=late)
        result.add_row(when, _cell(amount, 2), end)
    if any(math.isnan(amount.maximum) for amount in capability.payload):
        result.caption = "– the arm cannot be held with any payload"
    return result


def _polytopes(capability: Capability) -> RenderableType | None:
    if capability.analysis.task.m > MOST_DRAWN:
        return None
    lines = []
    for when, late in (("before", False), ("after", True)):
        for reading in LockModel:
            polytope = capability.polytope(after=late, reading=reading)
            lines.append((f"Polytope {when}, {reading}", _polytope(polytope)))
    return facts(lines)


def _polytope(polytope: Polytope) -> str:
    if polytope.is_empty:
        return "empty: no force can be held"
    corners, faces = len(polytope.vertices), len(polytope.faces)
    shape = {0: "a point", 1: "a segment", 2: "a flat polygon"}.get(
        polytope.dimension, f"{faces} faces"
    )
    free = len(polytope.unlimited)
    ends = f", unlimited in {free} direction{'s' if free != 1 else ''}" if free else ""
    return f"{corners} corner{'s' if corners != 1 else ''}, {shape}{ends}"
