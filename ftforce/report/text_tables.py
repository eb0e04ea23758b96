"""Results as tables for LaTeX and for pull requests (Markdown)."""

from __future__ import annotations

import math
import re
import unicodedata
from typing import TYPE_CHECKING, Any

from ftforce.errors import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.report.fields import Row

_ROUNDING = 1e-12  # in the unit of a column; a probability, which has none, may be as small
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
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"{\char34}",
    "`": r"\textasciigrave{}", "'": r"\textquotesingle{}",
    "→": r"$\to$", "−": "$-$", "≤": r"$\le$", "≥": r"$\ge$", "×": r"$\times$", "°": r"$^\circ$",
    "±": r"$\pm$", "√": r"$\surd$", "‖": r"$\|$", "†": r"\textdagger{}", "…": r"\ldots{}",
    "–": r"\textendash{}",
    "µ": r"$\mu$", "§": r"\S{}", "∞": r"$\infty$", "α": r"$\alpha$", "β": r"$\beta$",
    "γ": r"$\gamma$", "δ": r"$\delta$", "θ": r"$\theta$", "λ": r"$\lambda$", "μ": r"$\mu$",
    "π": r"$\pi$", "ρ": r"$\rho$", "σ": r"$\sigma$", "τ": r"$\tau$", "φ": r"$\varphi$",
    "ω": r"$\omega$", "Δ": r"$\Delta$", "Σ": r"$\Sigma$", "Ω": r"$\Omega$",
}  # fmt: skip
_ACCENTS = {
    "\u0300": "`", "\u0301": "'", "\u0302": "^", "\u0303": "~", "\u0304": "=", "\u0306": "u",
    "\u0307": ".", "\u0308": '"', "\u030a": "r", "\u030b": "H", "\u030c": "v", "\u0327": "c",
    "\u0328": "k",
}  # fmt: skip
_SCRIPTS = {"<super>": "^", "<sub>": "_"}  # as Unicode decomposes ² and ₂
_PAGE = 330.0  # pt, a little less than the text width of LaTeX's article, as widths are estimates
_LETTER, _GAP, _POWER = 5.0, 12.0, 22.0  # pt, of its font: a letter, between columns, × 10
_KEYS = 2 / 3  # of a page at most, for columns that every table repeats
_LONG = 28  # letters; a longer text is broken into lines
_NUMBER = re.compile(r"(-?)(\d+)(?:\.(\d+))?(?:e\+?(-?)(\d+))?")
_HEADING = re.compile(r"(?P<name>.*) \[(?P<unit>[^\]]*)\]")


def to_latex(rows: Sequence[Row], about: Sequence[tuple[str, str]]) -> str:
    r"""Return rows as a table of booktabs with units of siunitx, to be taken in by ``\input``.

    It may run over several pages. Columns without a value are left out. Columns that do not fit the
    width of a page follow in further tables, which repeat the columns that tell the rows apart.

    Parameters
    ----------
    rows :
        The rows, the header first.
    about :
        Names and texts for the comment above it.
    """
    rows = _without_rounding(_without_empty_columns(rows))
    said = [f"% {name}: {text}" for name, text in about]
    if not rows:
        return "\n".join([*said, "% no rows", ""])
    tables = [_longtable([[row[j] for j in kept] for row in rows]) for kept in _blocks(rows)]
    packages = "% needs \\usepackage{booktabs,siunitx,textcomp,longtable}, siunitx of 2021 or later"
    return "\n".join([*said, packages, *tables])


def _longtable(rows: Sequence[Sequence[Any]]) -> str:
    header, *body = rows
    lines = [_joined(map(_latex_cell, row, header)) for row in body]
    return "\n".join(
        [
            f"\\begin{{longtable}}{{{''.join(map(_latex_column, zip(*rows, strict=True)))}}}",
            "\\toprule",
            _joined(f"{{{_latex_heading(str(cell))}}}" for cell in header),
            "\\midrule",
            "\\endhead",
            *lines,
            "\\bottomrule",
            "\\end{longtable}",
            "",
        ]
    )


def _blocks(rows: Sequence[Row]) -> list[list[int]]:
    """Return the columns of each table that fits a page; all begin with what tells rows apart."""
    widths = list(map(_width, zip(*rows, strict=True)))
    keys = list(range(_key_columns(rows, widths)))
    blocks = [keys]
    for j in range(len(keys), len(widths)):
        if len(blocks[-1]) > len(keys) and sum(widths[i] for i in blocks[-1]) + widths[j] > _PAGE:
            blocks.append(keys)
        blocks[-1] = [*blocks[-1], j]
    return blocks


def _key_columns(rows: Sequence[Row], widths: Sequence[float]) -> int:
    """Return how many of the first columns tell all rows apart; 1 if too many."""
    for count in range(1, len(widths)):
        if sum(widths[:count]) > _KEYS * _PAGE:
            break
        if len({row[:count] for row in rows}) == len(rows):
            return count
    return 1


def _width(column: Sequence[Any]) -> float:
    """Return about how wide a column is, in pt."""
    heading, *cells = column
    numbers = list(filter(_is_number, cells))
    texts = [str(cell) for cell in cells if cell is not None and not _is_number(cell)]
    kind = _latex_column(column)
    limit = _LONG if kind.startswith("p") else math.inf
    letters = [min(max(map(len, texts), default=0), limit), len(str(heading))]
    power = _POWER if "e" in kind else 0.0
    digits = sum(map(int, re.findall(r"\d+", kind))) if kind.startswith("S") else 0
    widest = max(_LETTER * max(letters), _LETTER * (digits + 2) + power if numbers else 0.0)
    return widest + _GAP


def _latex_column(column: Sequence[Any]) -> str:
    """Return the type of a column, heading first: numbers, text, or text of several lines."""
    _, *cells = column
    if _is_numeric(cells) and any(map(_is_number, cells)):
        return f"S[table-format={_number_format(filter(_is_number, cells))}]"
    is_long = max(len(_shown(cell)) for cell in cells) > _LONG
    return f"p{{{_LETTER * _LONG:g}pt}}" if is_long else "l"


def _number_format(numbers: Any) -> str:
    """Return the digits of numbers for siunitx: ``-3.4e-2`` has room for -123.4567e-89."""
    found = [_NUMBER.fullmatch(_rounded(number)) for number in numbers]
    parts = [one.groups(default="") for one in found if one is not None]
    sign, whole, decimals, minus, power = (max(map(len, one)) for one in zip(*parts, strict=True))
    shown = f"{'-' if sign else ''}{whole}.{decimals}" if decimals else f"{'-' * sign}{whole}"
    return f"{shown}e{'-' if minus else ''}{power}" if power else shown


def _is_number(cell: Any) -> bool:
    """Return whether a cell is shown as a number."""
    return isinstance(cell, (int, float)) and not isinstance(cell, bool) and math.isfinite(cell)


def _shown(cell: Any) -> str:
    return _rounded(cell) if isinstance(cell, float) else str(cell)


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
    rows = _without_rounding(_without_empty_columns(rows))
    said = " · ".join(f"{name} {_markdown_cell(text)}" for name, text in about)
    if not rows:
        return f"{said}\n"
    header, *body = rows
    numeric = [_is_numeric(row[j] for row in body) for j in range(len(header))]
    rule = ["---:" if one else "---" for one in numeric]
    table = [list(map(_markdown_cell, row)) for row in (header, *body)]
    lines = [f"| {' | '.join(cells)} |" for cells in (table[0], rule, *table[1:])]
    return "\n".join([*lines, "", said, ""])


def _without_empty_columns(rows: Sequence[Row]) -> list[Row]:
    if not rows:
        return []
    kept = [j for j in range(len(rows[0])) if any(row[j] not in {None, ""} for row in rows[1:])]
    return [tuple(row[j] for j in kept) for row in rows] if kept else []


def _without_rounding(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with 0 where a quantity with a unit is nothing but rounding error."""
    if not rows:
        return []
    header, *body = rows
    has_unit = [_HEADING.fullmatch(str(head)) is not None for head in header]

    def cleared(cell: Any, has_unit: bool) -> Any:
        return 0.0 if has_unit and _is_number(cell) and abs(cell) <= _ROUNDING else cell

    return [header, *(tuple(map(cleared, row, has_unit)) for row in body)]


def _is_numeric(cells: Any) -> bool:
    """Return whether a column is one of numbers, of which few cells are texts."""
    found = [cell for cell in cells if cell not in {None, ""}]
    texts = sum(isinstance(cell, (str, bool)) for cell in found)
    return 2 * texts < len(found)


def _rounded(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value + 0.0:.{_DIGITS}g}"  # never -0


def _joined(cells: Any) -> str:
    return " & ".join(cells) + r" \\"


def _latex_cell(value: Any, heading: str) -> str:
    if value is None or value == "":
        return ""
    if value in _UNITS and heading.endswith("unit"):
        return f"{{\\unit{{{_UNITS[value]}}}}}"
    if _is_number(value):
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
    """Return a text for LaTeX, with the Latin letters and signs that pdflatex does not know."""
    signs = map(_latex_sign, re.findall(".[\u0300-\u036f]*", printable(text)))
    return re.sub("([-,])(?=\\1)", r"\1{}", "".join(signs))  # -- and ,, would be ligatures


def _latex_sign(sign: str) -> str:
    """Return a character with its combining accents for LaTeX; other scripts stay as they are."""
    if sign in _LATEX or sign.isascii():
        return _LATEX.get(sign, sign)
    kind, _, code = unicodedata.decomposition(sign[0]).partition(" ")
    if kind in _SCRIPTS and (found := chr(int(code, 16))).isascii():
        return f"${_SCRIPTS[kind]}{{{found}}}$"
    letter, *accents = list(unicodedata.normalize("NFD", sign))
    if not letter.isascii() or not all(one in _ACCENTS for one in accents):
        return sign
    shown = _LATEX.get(letter, letter)
    for accent in accents:
        shown = f"\\{_ACCENTS[accent]}{{{shown}}}"
    return shown


def _markdown_cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _rounded(value)
    text = printable(str(value)).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_|\[\]~#$@])", r"\\\1", text)
