"""CSV tables: a header with names and units, and numeric columns.

Errors give the line and, where possible, the column: ``line 3, 'elbow': 'x' is not a number``.
"""

from __future__ import annotations

import csv
import io
import math
import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.errors import InputError, UnknownNameError, printable
from ftforce.io.text import LARGEST_NUMBER, read_numbers, shortened

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

_PIECE = 1 << 20  # characters
_LONG = 1 << 17  # characters: shorter texts are read before Arrow is imported

_LINE = r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+"  # StringIO takes 4 × the size of a text

# For each joint unit, the accepted column units and their conversion factors.
POSITION_UNITS = {
    "rad": {"": 1.0, "rad": 1.0, "deg": math.radians(1.0)},
    "m": {"": 1.0, "m": 1.0},
}


def split_unit(cell: str) -> tuple[str, str]:
    """Split ``name [unit]`` into name and unit; the unit is empty if none is given."""
    name, bracket, unit = cell.removesuffix("]").rpartition("[")
    if not bracket or not cell.endswith("]"):
        return cell, ""
    return name.strip(), unit.strip()


def find_columns(
    header: tuple[str, ...],
    units: Mapping[str, Mapping[str, float]],
    expected: tuple[str, ...] | None = None,
) -> dict[str, tuple[int, float]]:
    """Return the index (from 0) and the conversion factor of each known column, by name.

    Parameters
    ----------
    header :
        Names of all columns, optionally with a unit in brackets, e.g. ``elbow [deg]``.
    units :
        For each name, the accepted units and their conversion factors; ``""`` stands for a
        missing unit.
    expected :
        Names to list in the error for an unknown column; if not given, unknown columns are
        ignored.

    Raises
    ------
    InputError
        A column is unknown, appears twice, or has an unsupported unit.
    """
    found: dict[str, tuple[int, float]] = {}
    for i, cell in enumerate(header):
        name, unit = (cell, "") if cell in units else split_unit(cell)
        if name not in units:
            if expected is None:
                continue
            raise UnknownNameError("column", name, expected)
        if name in found:
            raise InputError(f"column {name!r} appears twice")
        if unit not in units[name]:
            known = " or ".join(filter(None, units[name]))
            raise InputError(f"column {cell!r}: unknown unit; use {known}")
        found[name] = i, units[name][unit]
    return found


class Table(NamedTuple):
    """The header of a CSV table and the unparsed text below it.

    Attributes
    ----------
    header :
        Names of all columns.
    text :
        The text below the header, with its original line endings.
    line :
        Line number of the start of ``text``, from 1.
    one_line :
        Whether cells with line breaks are rejected.
    delimiter :
        What separates the cells: a comma, or a semicolon, a tab or a blank if the header has no
        comma.
    """

    header: tuple[str, ...]
    text: str
    line: int
    one_line: bool = False
    delimiter: str = ","

    @classmethod
    def of(cls, text: str, *, one_line: bool = False) -> Table | None:
        """Return the table whose header is the first nonblank row, or ``None`` if text is blank.

        Comments above the header (lines that begin with ``#``) are skipped; where numbers follow
        them at once, the last one is the header.

        Parameters
        ----------
        text :
            The whole text.
        one_line :
            Whether cells with line breaks are rejected.

        Raises
        ------
        InputError
            The header is not valid CSV.
        """
        text = _uncommented(text)
        for part in (text[: text.rfind("\n", 0, _PIECE) + 1], text):  # StringIO takes 4 × its size
            stream, delimiter = io.StringIO(part, newline=""), _delimiter(part)
            try:
                for line, cells in _rows(stream, 1, one_line, delimiter):
                    rest = text[stream.tell() :]
                    return cls(tuple(map(str.strip, cells)), rest, line + 1, one_line, delimiter)
            except InputError:
                if part is text:
                    raise
        return None

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the nonblank rows, each with the number of its last line.

        Raises
        ------
        InputError
            The text is not valid CSV, or a row and the header differ in length.
        """
        lines = (found.group() for found in re.finditer(_LINE, self.text))
        for line, cells in _rows(lines, self.line, self.one_line, self.delimiter):
            if len(cells) != len(self.header):
                raise InputError(
                    f"line {line}: expected {len(self.header)} cells, got {len(cells)}"
                )
            yield line, cells

    def same_texts(self, columns: Sequence[int], among: Container[str]) -> list[str]:
        """Return the texts in columns that have the same text in all rows.

        Parameters
        ----------
        columns :
            Column indices, from 0.
        among :
            What some of them should be; if none in the first row is, nothing is returned.

        Raises
        ------
        InputError
            As `rows`, or a text differs from that in the first row.
        """
        first: list[str] = []
        for line, cells in self.rows():
            texts = [cells[i].strip() for i in columns]
            if not any(text in among for text in texts):
                return []
            if first and texts != first:
                i = next(k for k, text in enumerate(texts) if text != first[k])
                where = f"line {line}, {shortened(self.header[columns[i]])}"
                raise InputError(f"{where}: {texts[i]!r} instead of {first[i]!r} as above")
            first = texts
        return first

    def numbers(
        self, columns: Sequence[int], largest: float = LARGEST_NUMBER
    ) -> NDArray[np.float64]:
        """Return selected columns as numbers, shape (rows, columns).

        Parameters
        ----------
        columns :
            Column indices, from 0.
        largest :
            Largest absolute value accepted.

        Raises
        ------
        InputError
            As `rows`, or a cell is not a number of absolute value up to ``largest``.
        """
        try:
            values = np.concatenate([one._numbers_at_once(columns) for one in self._pieces()])
            if not -largest <= values.min(initial=0.0) <= values.max(initial=0.0) <= largest:
                raise ValueError("too large or not finite")
            return values
        except ValueError:  # quotes, blanks or an error: parse cell by cell
            found = (
                self._number(line, i, cells[i], largest)
                for line, cells in self.rows()
                for i in columns
            )
            return np.fromiter(found, np.float64).reshape(-1, len(columns))

    def _pieces(self) -> Iterator[Table]:
        """Yield the table in pieces that end with a line, which bounds the memory for parsing."""
        start = 0
        while True:
            end = len(self.text)
            if end - start > _PIECE:
                end = self.text.rfind("\n", start, start + _PIECE) + 1 or end
            yield self._replace(text=self.text[start:end])
            if end == len(self.text):
                return
            start = end

    def _numbers_at_once(self, columns: Sequence[int]) -> NDArray[np.float64]:
        if not self.text or self.text.isspace():
            return np.empty((0, len(columns)))
        if '"' in self.text:
            raise ValueError("a quoted cell may continue on the next line")
        if len(self.text) > _LONG and (found := self._numbers_by_arrow(columns)) is not None:
            return found
        # The other columns are read as one character each; thus row lengths are still checked.
        kinds = [(str(i), "f8" if i in columns else "U1") for i in range(len(self.header))]
        # NumPy would accept non-ASCII whitespace around a number.
        stream = io.StringIO(self.text.encode("ascii", "replace").decode(), newline="")
        rows = np.loadtxt(stream, kinds, comments=None, delimiter=self.delimiter, ndmin=1)
        return np.stack([rows[str(i)] for i in columns], axis=1)

    def _numbers_by_arrow(self, columns: Sequence[int]) -> NDArray[np.float64] | None:
        """Return the numbers seven times faster than NumPy; ``None`` if Arrow cannot."""
        try:
            from pyarrow import ArrowInvalid, BufferReader, csv, float64  # extra `parquet`
        except ImportError:
            return None
        names = list(map(str, range(len(self.header))))
        wanted = [names[i] for i in columns]
        kinds = {"column_types": dict.fromkeys(wanted, float64()), "null_values": []}
        try:
            table = csv.read_csv(
                BufferReader(self.text.encode("ascii", "replace")),
                csv.ReadOptions(column_names=names, use_threads=False),
                csv.ParseOptions(delimiter=self.delimiter),
                csv.ConvertOptions(include_columns=wanted, **kinds),
            ).combine_chunks()
        except ArrowInvalid:
            return None
        cells = (table.column(name).chunk(0) for name in wanted)
        return np.stack([np.from_dlpack(cell) for cell in cells], axis=1)

    def _number(self, line: int, column: int, cell: str, largest: float) -> float:
        where = f"line {line}, {shortened(self.header[column])}"
        if not cell.strip():
            raise InputError(f"{where}: empty cell; every row needs a value for every joint")
        try:
            return read_numbers(cell, 1, largest)[0]
        except ValueError as problem:
            raise InputError(f"{where}: {problem}") from None


def _uncommented(text: str) -> str:
    """Return text with blanks in place of comments above the header, of the same length."""
    last = start = 0
    while text.startswith("#", start):
        last, start = start, text.find("\n", start) + 1 or len(text)
    if start == 0:
        return text
    end = text.find("\n", start)
    first = text[start : end if end >= 0 else len(text)].split(",")
    kept = last + 1 if all(map(_is_number, first)) else start  # as numpy.savetxt writes it
    return "".join(c if c in "\r\n" else " " for c in text[:kept]) + text[kept:]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _delimiter(text: str) -> str:
    """Return what separates the cells of the first row that is not blank."""
    found = re.search(r"\S[^\r\n]*", text)
    first = found.group() if found else ""
    for mark in ",;\t":
        if mark in first:
            return mark
    return " " if " " in first.strip() and " [" not in first else ","  # t [s] is one cell


def _rows(
    stream: Iterable[str], line: int, one_line: bool, delimiter: str = ","
) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(stream, strict=True, skipinitialspace=True, delimiter=delimiter)
    begin = line
    try:
        for cells in reader:
            end = line + reader.line_num - 1
            if one_line and end > begin:
                raise InputError(f"line {begin}: a cell continues on the next line")
            if any(map(str.strip, cells)):
                yield end, cells
            begin = end + 1
    except csv.Error as problem:
        raise InputError(f"line {begin}: not valid CSV: {printable(problem)}") from None
