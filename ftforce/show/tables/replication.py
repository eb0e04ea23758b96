"""Tables of the replication of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from ftforce.analysis.paper import ERRATA, Check, Outcome, Replication
from ftforce.report.robot import replication_sentence
from ftforce.report.text import number
from ftforce.show.tables.analysis import force_fact, task_facts
from ftforce.show.tables.parts import TitledTable, arm_facts, facts, spaced, table

if TYPE_CHECKING:
    from rich.console import RenderableType

_UNITS = {
    "J, eq. (34)": " (m/rad)",
    "¹J, eq. (35)": " (m/rad)",
    "Table 2": " (torques in N·m, shares without unit)",
    "Ẋ, section IV": " (printed in cm/s; the printed numbers are m/s)",
}
_MARK = {Outcome.PASS: ("✓", "green"), Outcome.ERRATUM: ("e", "yellow"), Outcome.FAIL: ("✗", "red")}


def replication_view(result: Replication) -> RenderableType:
    """Return the paper's tables, with printed value, computed value and outcome of each number."""
    names = dict.fromkeys(check.table for check in result.checks)
    tables = (_table(name, [c for c in result.checks if c.table == name]) for name in names)
    if result.is_of_another_arm:
        return spaced(facts(_asked(result)), *tables)
    legend = "Each cell: printed, computed, and ✓ pass, e explained by an erratum, ✗ fail."
    return spaced(
        Text(legend, style="dim"),
        *tables,
        _explanations(result),
        _errata(),
        _summary(result),
    )


def _asked(result: Replication) -> list[tuple[str, str]]:
    """Return the arm, its posture, and the force and velocity for which the tables are."""
    healthy = result.healthy
    velocity = healthy.question.conditions.velocity
    assert velocity is not None
    slides = [str(joint.number) for joint in healthy.robot.joints if joint.unit == "m"]
    units = f"of the slides ({', '.join(slides)}): J in m/m, torques in N, velocity in m/s"
    return [
        *arm_facts(healthy.robot.name, healthy.robot),
        *task_facts(healthy.task),
        ("Posture", healthy.posture.source),
        force_fact(healthy.task, healthy.question.force),
        ("Velocity", ", ".join(f"{v:g}" for v in velocity.tolist()) + " rad/s"),
        *([("Units", units)] if slides else []),
    ]


def _table(name: str, checks: list[Check]) -> TitledTable:
    columns = list(dict.fromkeys(check.column for check in checks))
    rows = dict.fromkeys(check.row for check in checks)
    cells = {(check.row, check.column): _cell(check) for check in checks}
    unit = _UNITS.get(name, " (torques in N·m, force jump in N)")
    if "m/s" in columns:  # of another arm
        unit = ""
    result = table(name + unit, "", *columns)
    for row in rows:
        result.add_row(row, *(cells[row, column] for column in columns))
    return result


def _cell(check: Check) -> Text:
    if check.outcome is Outcome.COMPUTED:
        return Text(number(check.computed))
    mark, style = _MARK[check.outcome]
    text = Text(f"{check.printed} {number(check.computed, check.decimals)} ")
    return text.append(mark, style=style)


def _explanations(result: Replication) -> RenderableType | None:
    explained = dict.fromkeys(
        check.erratum for check in result.checks if check.outcome is Outcome.ERRATUM
    )
    if not explained:
        return None
    return Group(*(Text(f"e  {erratum}", style="yellow") for erratum in explained))


def _errata() -> TitledTable:
    result = table("Errata of the paper", "where", "printed", "correct", left=3, folded=(0, 1, 2))
    for erratum in ERRATA:
        result.add_row(*erratum)
    return result


def _summary(result: Replication) -> Text:
    style = "bold green" if result.is_successful else "bold red"
    return Text(replication_sentence(result), style=style)
