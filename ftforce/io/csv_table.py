"""CSV tables: a header with names and units, and numeric columns.

Errors give the line and, where possible, the column: ``line 3, 'elbow': 'x' is not a number``.
"""

from __future__ import annotations

import csv
import io
import math
import re
from contextlib import suppress
from itertools import takewhile
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

_BEGINNING = 1 << 17  # characters in which a row of units and decimal commas are looked for
_MOST_COLUMNS = 10_000

# Units as they are written, and as they are called here.
_UNITS = {
    **{unit: unit for unit in ("s", "ms", "us", "µs", "ns", "rad", "deg", "m", "rad/s", "deg/s")},
    **{unit: unit for unit in ("m/s", "mm", "N", "Nm", "N·m", "N m", "A", "V", "W", "Hz", "°C")},
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("usec", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("°", "degree", "degrees"), "deg"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("°/s", "degrees/s"), "deg/s"),
}
_NO_UNITS = frozenset({"", "-", "1"})
_SLICE = re.compile(r"\[:\]\{[^{}]*==\s*\\?[\"'](?P<name>[^{}\"'\\]+)\\?[\"']\s*\}")
_COMMAS = re.compile(
    r'(?:^|[;\t"])[ ]*[-+]?[0-9]+,[0-9]+(?:[eE][-+]?[0-9]+)?[ ]*(?:$|[;\t"])', re.M
)
_POINTS = re.compile(
    r'(?:^|[;\t"])[ ]*[-+]?[0-9]*\.[0-9]+(?:[eE][-+]?[0-9]+)?[ ]*(?:$|[;\t"])', re.M
)

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
    has_commas :
        Whether decimals are separated by commas.
    """

    header: tuple[str, ...]
    text: str
    line: int
    one_line: bool = False
    delimiter: str = ","
    has_commas: bool = False

    @classmethod
    def of(cls, text: str, *, one_line: bool = False) -> Table | None:
        """Return the table whose header is the first nonblank row, or ``None`` if text is blank.

        Comments above the header (lines that begin with ``#``) are skipped; where numbers follow
        them at once, the last one is the header. A row of units below the header is taken into it;
        what ``ros2 topic echo --csv`` writes of joint states gets a header.

        Parameters
        ----------
        text :
            The whole text.
        one_line :
            Whether cells with line breaks are rejected.

        Raises
        ------
        InputError
            The header is not valid CSV, or has too many columns.
        """
        text = _uncommented(text)
        for part in (text[: text.rfind("\n", 0, _PIECE) + 1], text):  # StringIO takes 4 × its size
            stream, delimiter = io.StringIO(part, newline=""), _delimiter(part)
            try:
                for line, cells in _rows(stream, 1, one_line, delimiter):
                    header, rest = tuple(map(str.strip, cells)), text[stream.tell() :]
                    table = cls(header, rest, line + 1, one_line, delimiter)
                    return table._understood(part, text)
            except InputError:
                if part is text:
                    raise
        return None

    def _understood(self, part: str, text: str) -> Table:
        """Return the table with names and units of its columns in the usual form.

        Raises
        ------
        InputError
            There are too many columns.
        """
        if len(self.header) > _MOST_COLUMNS:
            raise InputError(
                f"has {len(self.header):,} columns; at most {_MOST_COLUMNS:,} are read"
            )
        start = len(text) - len(self.text)
        below = part[start : start + _BEGINNING]
        if header := _of_joint_states(self.header):
            start = text.rfind(text[:start].strip().splitlines()[-1], 0, start)
            return self._replace(header=header, text=text[start:], line=self.line - 1)
        units: list[str] = []
        after = self.line, len(self.text)
        with suppress(InputError):  # said when the rows are read
            stream = io.StringIO(below, newline="")
            line, cells = next(_rows(stream, self.line, self.one_line, self.delimiter), (0, []))
            units = _units_in(cells) if len(cells) == len(self.header) else []
            after = line + 1, len(self.text) - stream.tell()
        names = [_usual(cell) for cell in self.header]
        table = self
        if units:
            names = [_with_unit(name, unit) for name, unit in zip(names, units, strict=True)]
            table = self._replace(line=after[0], text=self.text[len(self.text) - after[1] :])
        has_commas = self.delimiter != "," and _has_decimal_commas(below)
        return table._replace(header=tuple(names), has_commas=has_commas)

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

    def same_texts(
        self, columns: Sequence[int], among: Container[str], first: Sequence[str] = ()
    ) -> list[str]:
        """Return the texts in columns that have the same text in all rows.

        Parameters
        ----------
        columns :
            Column indices, from 0.
        among :
            What some of them should be; if none in the first row is, nothing is returned.
        first :
            Those in the first row, if the table is not the first part of a file.

        Raises
        ------
        InputError
            As `rows`, or a text differs from that in the first row.
        """
        for line, cells in self.rows():
            texts = [cells[i].strip() for i in columns]
            if not any(text in among for text in texts):
                return []
            if first and texts != first:
                i = next(k for k, text in enumerate(texts) if text != first[k])
                where = f"line {line}, {shortened(self.header[columns[i]])}"
                raise InputError(f"{where}: {texts[i]!r} instead of {first[i]!r} as above")
            first = texts
        return list(first)

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
        if self.has_commas:
            plain = self._replace(text=self.text.replace(",", "."), has_commas=False)
            return plain.numbers(columns, largest)
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


def _usual(cell: str) -> str:
    """Return the name of a column with its unit in brackets; what Foxglove selects, as a path."""
    cell = _SLICE.sub(r".\g<name>", cell)
    for opened, closed in ("[]", "()"):
        name, mark, unit = cell.removesuffix(closed).rpartition(opened)
        unit = unit.strip()
        if mark and cell.endswith(closed) and unit in _UNITS and name.strip():
            return f"{name.strip()} [{_UNITS[unit]}]"
    return cell


def _units_in(cells: list[str]) -> list[str]:
    """Return the units of a row that holds nothing else, else an empty list."""
    units = [cell.strip().strip("[]()").strip() for cell in cells]
    if not any(units) or not all(unit in _UNITS or unit in _NO_UNITS for unit in units):
        return []
    return ["" if unit in _NO_UNITS else _UNITS[unit] for unit in units]


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit and not split_unit(name)[1] else name


def _has_decimal_commas(text: str) -> bool:
    """Return whether numbers have decimal commas, and none a point."""
    return bool(_COMMAS.search(text)) and not _POINTS.search(text)


def _of_joint_states(cells: tuple[str, ...]) -> tuple[str, ...]:
    """Return a header if the cells are those of a joint state, else an empty tuple.

    These are seconds, nanoseconds, the frame, names, and as many positions, velocities and efforts,
    of which only positions have to be there.
    """
    if len(cells) < 5 or not (cells[0].isdecimal() and cells[1].isdecimal()):
        return ()
    names = list(takewhile(lambda cell: cell and not _is_number(cell), cells[3:]))
    numbers = cells[3 + len(names) :]
    count = len(numbers) // len(names) if names else 0
    if not 1 <= count <= 3 or count * len(names) != len(numbers):
        return ()
    if not all(map(_is_number, numbers)):
        return ()
    kinds = ("position", "velocity" if count == 3 else "unknown", "effort")[:count]
    stamp = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
    parts = (f"{kind}[{i}]" for kind in ("name", *kinds) for i in range(len(names)))
    return (*stamp, *parts)


def _uncommented(text: str) -> str:
    """Return text with blanks in place of comments above the header, of the same length."""
    last = start = 0
    while text.startswith(("#", "sep="), start):  # the latter is for Excel
        last, start = start, text.find("\n", start) + 1 or len(text)
    if start == 0:
        return text
    end = text.find("\n", start)
    first = re.split(r"[,;\s]\s*", text[start : end if end >= 0 else len(text)].strip())
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
