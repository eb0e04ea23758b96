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

_ROUNDING = 1e-12  # in the unit of a column
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
    said = [f"% {name}: {text}" for name, text in about]
    if not rows:
        return "\n".join([*said, "% no rows", ""])
    header, *body = rows
    numeric = [_is_numeric(row[j] for row in body) for j in range(len(header))]
    columns = "".join("S" if one else "l" for one in numeric)
    heads = [f"{{{_latex_heading(str(cell))}}}" for cell in header]
    lines = [_joined(heads), *(_joined(map(_latex_cell, row, header)) for row in body)]
    return "\n".join(
        [
            *said,
            "% needs \\usepackage{booktabs,siunitx,textcomp,longtable}, siunitx of 2021 or later",
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


def _is_numeric(cells: Any) -> bool:
    """Return whether a column is one of numbers, of which few cells are texts."""
    found = [cell for cell in cells if cell not in {None, ""}]
    texts = sum(isinstance(cell, (str, bool)) for cell in found)
    return 2 * texts < len(found)


def _rounded(value: float) -> str:
    """Return a number as text; one that is nothing but rounding error is 0."""
    if isinstance(value, int):
        return str(value)
    return "0" if abs(value) <= _ROUNDING else f"{value:.{_DIGITS}g}"


def _joined(cells: Any) -> str:
    return " & ".join(cells) + r" \\"


def _latex_cell(value: Any, heading: str) -> str:
    if value is None or value == "":
        return ""
    if value in _UNITS and heading.endswith("unit"):
        return f"{{\\unit{{{_UNITS[value]}}}}}"
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
