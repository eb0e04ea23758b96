"""Tables of what can be held."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text

from ftforce import capability_words, words
from ftforce.document_parts import MOST_DRAWN
from ftforce.feasible import Reading
from ftforce.show.analysis import situation
from ftforce.show.tables import TitledTable, facts, spaced, table, warning_lines
from ftforce.words import size

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.force_capability import Amount, Capability, DirectionReport
    from ftforce.polytope import Polytope


def capability_view(capability: Capability) -> RenderableType:
    """Return the tables of a capability."""
    return spaced(
        facts(situation(capability.analysis)),
        _directions(capability),
        _weakest(capability),
        _payload(capability),
        _polytopes(capability),
        warning_lines(capability.analysis.warnings),
        Text(capability_words.capability_sentence(capability), style="bold"),
    )


def _directions(capability: Capability) -> TitledTable:
    result = table(
        "Largest force at the tip: commanded by the motors, or held with the locks' help",
        "direction", "unit", "before\ncommanded", "\nheld", "after\ncommanded", "\nheld",
        "commanded force ends at", left=2, folded=(6,),
    )  # fmt: skip
    for report in capability.directions:
        after = report.after[Reading.COMMANDED]
        end = capability_words.end_in_words(capability.analysis, after)
        result.add_row(_name(report), report.unit, *_cells(report), end)
    result.caption = "– the arm cannot stand still with any force in this direction"
    if not _any_missing(capability.directions):
        result.caption = ""
    if any(_least(amount) for report in capability.directions for amount in report.after.values()):
        result.caption = "a range a to b: less than a does not hold the arm either"
    return result


def _any_missing(reports: tuple[DirectionReport, ...]) -> bool:
    return any("–" in cell for report in reports for cell in _cells(report))


def _name(report: DirectionReport) -> str:
    if report.name != "direction":
        return report.name
    vector = report.before[Reading.COMMANDED].direction.tolist()
    return f"({', '.join(words.number(x) for x in vector)})"


def _cells(report: DirectionReport) -> list[str]:
    return [_cell(amounts[r]) for amounts in (report.before, report.after) for r in Reading]


def _least(amount: Amount) -> bool:
    return amount.least > words.NEGLIGIBLE


def _cell(amount: Amount) -> str:
    if amount.most != amount.most:
        return "–"
    most = "no limit" if amount.most == float("inf") else size(amount.most, 1)
    return f"{size(amount.least, 1)} to {most}" if _least(amount) else most


def _weakest(capability: Capability) -> TitledTable:
    task, report = capability.analysis.task, capability.weakest
    result = table(
        "Weakest direction", "when", "lock", f"largest\n[{report.unit}]", *task.components,
        "ends at", left=2, folded=(3 + task.m,),
    )  # fmt: skip
    for when, amounts in (("before", report.before), ("after", report.after)):
        for reading in Reading:
            amount = amounts[reading]
            parts = (words.number(x) for x in amount.direction.tolist())
            end = capability_words.end_in_words(capability.analysis, amount)
            result.add_row(when, reading.value, _cell(amount), *parts, end)
    return result


def _payload(capability: Capability) -> TitledTable:
    already = capability.analysis.conditions.payload
    title = "Payload [kg] that the tip can carry" + (
        ", on top of the present one" if already else ""
    )
    result = table(title, "when", "kg", "ends at", left=1, folded=(2,))
    for when, amount in zip(("before", "after"), capability.payload, strict=True):
        mass = "–" if amount.most != amount.most else size(amount.most)
        result.add_row(when, "no limit" if mass == "inf" else mass,
                       capability_words.end_in_words(capability.analysis, amount))  # fmt: skip
    return result


def _polytopes(capability: Capability) -> RenderableType | None:
    if capability.analysis.task.m > MOST_DRAWN:
        return None
    lines = []
    for when, late in (("before", False), ("after", True)):
        for reading in Reading:
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
