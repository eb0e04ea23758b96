"""Results as Excel workbooks, by xlsxwriter."""

from __future__ import annotations

import io
import math
import os
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError, InputError, printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.report.fields import Row

MAX_ROWS, MAX_COLUMNS = 1_048_576, 16_384  # of a sheet
_LONGEST = 32_767  # characters of a cell
_WIDEST = 40  # characters of a column
_EPOCH, _LATEST = 315_532_800, 4_102_444_800  # 1980 and 2100, what dates of archives can be


def workbook(sheets: Sequence[tuple[str, Sequence[Row]]]) -> bytes:
    """Return a workbook in which numbers are numbers, texts are texts, and nothing is a formula.

    The same rows give the same bytes: its date is that of ``SOURCE_DATE_EPOCH``, by default 1980.

    Parameters
    ----------
    sheets :
        Name and rows of each sheet, the header first.

    Raises
    ------
    FtforceError
        xlsxwriter is not installed.
    InputError
        A sheet would have more rows or columns than Excel can read.
    """
    needs_xlsxwriter()
    import xlsxwriter

    stream = io.BytesIO()
    options = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}
    book = xlsxwriter.Workbook(stream, {**options, "strings_to_numbers": False})
    book.set_properties({"created": _date(), "author": "ftforce"})
    bold = book.add_format({"bold": True, "bottom": 1})
    for name, rows in sheets:
        _check_size(name, rows)
        sheet = book.add_worksheet(name)
        for i, row in enumerate(rows):
            for j, value in enumerate(row):
                _write(sheet, i, j, value, None if i else bold)
        _fit(sheet, rows)
    book.close()
    return stream.getvalue()


def needs_xlsxwriter() -> None:
    """Check that xlsxwriter is installed.

    Raises
    ------
    FtforceError
        It is not, and the message says how to install it.
    """
    try:
        import xlsxwriter  # noqa: F401
    except ImportError:
        raise FtforceError("Excel files need xlsxwriter: pip install 'ftforce[report]'") from None


def _check_size(name: str, rows: Sequence[Row]) -> None:
    wide = max(map(len, rows), default=0)
    if len(rows) > MAX_ROWS or wide > MAX_COLUMNS:
        raise InputError(
            f"the sheet {name!r} would have {len(rows):,} rows and {wide:,} columns, and Excel "
            f"reads {MAX_ROWS:,} and {MAX_COLUMNS:,}; write .csv instead"
        )


def _write(sheet: Any, i: int, j: int, value: Any, style: Any) -> None:
    if value is None or value == "":
        return
    if isinstance(value, bool):
        sheet.write_boolean(i, j, value, style)
    elif isinstance(value, (int, float)):
        if math.isfinite(value):
            sheet.write_number(i, j, value, style)
    else:
        sheet.write_string(i, j, printable(str(value))[:_LONGEST], style)


def _fit(sheet: Any, rows: Sequence[Row]) -> None:
    """Fit the widths of the columns, keep the header in view, and let rows be filtered."""
    if not rows:
        return
    for j in range(len(rows[0])):
        texts = (len(_shown(row[j])) for row in rows[:1000] if j < len(row))
        sheet.set_column(j, j, min(max(texts, default=0) + 1, _WIDEST))
    sheet.freeze_panes(1, 0)
    sheet.autofilter(0, 0, len(rows) - 1, len(rows[0]) - 1)


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str("" if value is None else value)


def _date() -> datetime:
    try:
        seconds = min(max(int(os.environ["SOURCE_DATE_EPOCH"]), _EPOCH), _LATEST)
    except (KeyError, ValueError):
        seconds = _EPOCH
    return datetime.fromtimestamp(seconds, UTC).replace(tzinfo=None)
