"""Results as tables for LaTeX and for pull requests (Markdown)."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

from ftforce.errors import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.report.fields import Row

_DIGITS = 4  # significant ones; all of them are in .csv, .json and .xlsx
_UNITS = {
    "N·m": r"\newton\metre", "N": r"\newton", "m": r"\metre", "rad": r"\radian", "kg": r"\kilogram",
    "s": r"\second", "rad/s": r"\radian\per\second", "m/s": r"\metre\per\second",
    "m/s²": r"\metre\per\second\squared", "m²": r"\metre\squared", "m³": r"\metre\cubed",
    "%": r"\percent",
}  # fmt: skip
_LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#",
    "_": r"\_", "%": r"\%", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "·": r"$\cdot$",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}",
    "→": r"$\to$", "−": "$-$", "≤": r"$\le$", "≥": r"$\ge$", "×": r"$\times$", "²": r"$^2$",
    "³": r"$^3$", "°": r"$^\circ$", "`": r"\textasciigrave{}", "'": r"\textquotesingle{}",
}  # fmt: skip
_HEADING = re.compile(r"(?P<name>.*) \[(?P<unit>[^\]]*)\]")


def to_latex(rows: Sequence[Row], about: Sequence[tuple[str, str]]) -> str:
    r"""Return rows as a table of booktabs with units of siunitx, to be taken in by ``\input``.

    It may run over several pages. Columns without a value are left out.

    Parameters
    ----------
    rows :
        The rows, the header first.
    about :
        Names and texts for the comment above it.
    """
    rows = _without_empty_columns(rows)
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    numeric = [_is_numeric(row[j] for row in body) for j in range(len(header))]
    columns = "".join("S" if one else "l" for one in numeric)
    said = [f"% {name}: {text}" for name, text in about]
    heads = [f"{{{_latex_heading(str(cell))}}}" for cell in header]
    lines = [_joined(heads), *(_joined(map(_latex_cell, row)) for row in body)]
    return "\n".join(
        [
            *said,
            "% needs \\usepackage{booktabs,siunitx,textcomp,longtable}",
            f"\\begin{{longtable}}{{{columns}}}",
            "\\toprule",
            lines[0],
            "\\midrule",
            "\\endhead",
            *lines[1:],
            "\\bottomrule",
            "\\end{longtable}",
            "",
        ]
    )


def to_markdown(rows: Sequence[Row], about: Sequence[tuple[str, str]]) -> str:
    """Return rows as a table of GitHub's Markdown, and a line that says where it comes from.

    Columns without a value are left out.

    Parameters
    ----------
    rows :
        The rows, the header first.
    about :
        Names and texts for the line below it.
    """
    rows = _without_empty_columns(rows)
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    numeric = [_is_numeric(row[j] for row in body) for j in range(len(header))]
    rule = ["---:" if one else "---" for one in numeric]
    table = [list(map(_markdown_cell, row)) for row in (header, *body)]
    lines = [f"| {' | '.join(cells)} |" for cells in (table[0], rule, *table[1:])]
    said = " · ".join(f"{name} {_markdown_cell(text)}" for name, text in about)
    return "\n".join([*lines, "", said, ""])


def _without_empty_columns(rows: Sequence[Row]) -> list[Row]:
    if not rows:
        return []
    kept = [j for j in range(len(rows[0])) if any(row[j] not in {None, ""} for row in rows[1:])]
    return [tuple(row[j] for j in kept) for row in rows]


def _is_numeric(cells: Any) -> bool:
    found = [cell for cell in cells if cell not in {None, ""}]
    return all(isinstance(cell, (int, float)) and not isinstance(cell, bool) for cell in found)


def _rounded(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.{_DIGITS}g}"


def _joined(cells: Any) -> str:
    return " & ".join(cells) + r" \\"


def _latex_cell(value: Any) -> str:
    if value is None or value == "":
        return ""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return _rounded(value)
    return f"{{{_latex_text(str(value))}}}"


def _latex_heading(heading: str) -> str:
    found = _HEADING.fullmatch(heading)
    if found is None:
        return _latex_text(heading)
    unit = _UNITS.get(found["unit"])
    shown = rf"\unit{{{unit}}}" if unit else _latex_text(found["unit"])
    return rf"{_latex_text(found['name'])} / {shown}"


def _latex_text(text: str) -> str:
    return "".join(_LATEX.get(c, c) for c in printable(text))


def _markdown_cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _rounded(value)
    text = printable(str(value)).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_|\[\]~#$@])", r"\\\1", text)
