"""Building blocks of the tables, for an 80-column terminal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from ftforce.core.faults import Fault, FaultMode
from ftforce.core.verdict import Verdict
from ftforce.report.text import number, ratio, size, tip_in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from rich.console import RenderableType

    from ftforce.batch.result import SweepSetting
    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import Setting

_DIFFERENCES = ("jump", "jump ", "unsupported")  # printed also when small

VERDICT_STYLE = {
    Verdict.TOLERATED: "bold green",
    Verdict.BORDERLINE: "bold yellow",
    Verdict.NOT_TOLERATED: "bold red",
}


def facts(pairs: Iterable[tuple[str, str]]) -> Table:
    """Return names and values in two columns, without lines."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in pairs:
        grid.add_row(Text(name), Text(value))
    return grid


def arm_facts(name: str, arm: Robot | SweepSetting | Setting) -> list[tuple[str, str]]:
    """Return the arm with its base and tip, and how the tip was chosen."""
    joints = "1 joint" if len(arm.joints) == 1 else f"{len(arm.joints)} joints"
    return [
        ("Robot", f"{name}: {joints}, {arm.base} → {arm.tip}"),
        ("Tip", tip_in_words(arm)),
    ]


class TitledTable:
    """A table with a title that may be wider than the table."""

    def __init__(self, title: str, body: Table) -> None:
        self.title, self.body = title, body
        self.caption = ""

    def add_row(self, *cells: str | Text, style: str = "") -> None:
        """Add a row as plain text, so that URDF names are not interpreted as markup."""
        texts = (Text(cell) if isinstance(cell, str) else cell for cell in cells)
        self.body.add_row(*texts, style=style)

    def __rich__(self) -> RenderableType:
        """Return title, table and caption."""
        parts: list[RenderableType] = [Text(self.title, style="bold"), self.body]
        return Group(*parts, *([Text(self.caption, style="dim")] if self.caption else []))


def table(title: str, *columns: str, left: int = 1, folded: Sequence[int] = (0,)) -> TitledTable:
    """Return an empty table whose first ``left`` columns, and ``folded`` ones, are text."""
    body = Table(box=None, padding=(0, 1, 0, 0), header_style="dim", pad_edge=False)
    for i, column in enumerate(columns):
        body.add_column(
            Text(column),
            justify="left" if i < left or i in folded else "right",
            overflow="fold" if i in folded else "ellipsis",
            no_wrap=i not in folded,
        )
    return TitledTable(title, body)


def listing(
    title: str,
    rows: Iterable[Iterable[tuple[str, str | Text]]],
    *,
    left: int = 1,
    folded: Sequence[int] = (0,),
) -> TitledTable:
    """Return a table of rows of (heading, cell) pairs, with the same headings in all rows."""
    all_rows = [tuple(row) for row in rows] or [()]
    result = table(title, *(heading for heading, _ in all_rows[0]), left=left, folded=folded)
    for row in all_rows:
        result.add_row(*(cell for _, cell in row))
    return result


def spaced(*parts: RenderableType | None) -> Group:
    """Join the parts with blank lines."""
    shown: list[RenderableType] = []
    for part in parts:
        if part is not None:
            shown += [Text(""), part] if shown else [part]
    return Group(*shown)


def warning_lines(warnings: Iterable[str]) -> Text | None:
    """Return warnings as text; ``None`` if there are none."""
    lines = [f"Warning: {warning}." for warning in warnings]
    return Text("\n".join(lines), style="yellow") if lines else None


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Component names and units of a vector, and the norms defined on it.

    Attributes
    ----------
    names, units :
        One per component.
    norms :
        Name, unit and components of each norm; units are never mixed.
    """

    names: Sequence[str]
    units: Sequence[str]
    norms: Sequence[tuple[str, str, Sequence[int]]]


def vectors(
    title: str, components: Components, columns: Mapping[str, Vector], digits: int
) -> TitledTable:
    """Return a table of vectors side by side, by component, followed by their norms."""
    result = table(title, "", "unit", *columns, left=2)
    writers = [size if name in _DIFFERENCES else number for name in columns]
    columns_and_writers = list(zip(columns.values(), writers, strict=True))
    for i, (name, unit) in enumerate(zip(components.names, components.units, strict=True)):
        cells = (write(float(x[i]), digits) for x, write in columns_and_writers)
        result.add_row(name, unit, *cells)
    for name, unit, rows in components.norms:
        if rows:
            norms = ((float(np.linalg.norm(x[list(rows)])), w) for x, w in columns_and_writers)
            result.add_row(name, unit, *(write(x, digits) for x, write in norms), style="bold")
    return result


def verdict_text(verdict: Verdict) -> Text:
    """Return a verdict in words and colour."""
    return Text(verdict.value, style=VERDICT_STYLE[verdict])


_FAULT_STYLE = {
    FaultMode.LOCKED: "bold red",
    FaultMode.FREE: "bold magenta",
    FaultMode.WEAK: "bold yellow",
}


def fault_text(fault: Fault | None) -> Text:
    """Return a joint's state in words and colour."""
    return Text("healthy") if fault is None else Text(str(fault), style=_FAULT_STYLE[fault.mode])


def state_text(locked: bool) -> Text:
    """Return the state of a locked or healthy joint in words and colour."""
    return fault_text(Fault(0) if locked else None)


def amount(x: float, digits: int = 1) -> str:
    """Format a force that can be held: a dash for none, in words if unlimited."""
    return "–" if math.isnan(x) else "no limit" if math.isinf(x) else size(x, digits)


HEALTHY_ROW = "none"
"""Name of the row of the healthy arm among fault sets and joints: no joint failed."""


ABOVE_HEALTHY = "above 100: the brake holds a locked joint, and its motor's limit no longer applies"


def percent_kept(share: float | None) -> str:
    """Format a share in percent for a column [%]; a dash if unknown."""
    return "–" if share is None or math.isnan(share) else number(100.0 * share, 0)


def defined(x: float) -> str:
    """Format a ratio; a dash if undefined."""
    return "–" if math.isnan(x) else "∞" if math.isinf(x) else ratio(x)
