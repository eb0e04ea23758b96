"""Tables in CSV files: a header with names and units, rows with their places, columns of numbers.

An error names the line and, where it can, the column: ``line 3, 'elbow': 'x' is not a number``.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.errors import InputError, UnknownNameError, printable
from ftforce.source import LARGEST_NUMBER, read_numbers, shortened

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from typing import TextIO

    from ftforce.arrays import Matrix

# The units that a column of positions may be in, and what turns them into the first.
POSITION_UNITS = {"rad": {"rad": 1.0, "deg": math.radians(1.0)}, "m": {"m": 1.0}}


def split_unit(cell: str) -> tuple[str, str]:
    """Return name and unit of ``name [unit]``."""
    name, bracket, unit = cell.removesuffix("]").rpartition("[")
    if not bracket or not cell.endswith("]"):
        return cell, ""
    return name.strip(), unit.strip()


class Column(NamedTuple):
    """Where a column stands.

    Attributes
    ----------
    number :
        Its number, from 0.
    unit :
        Its unit; empty if the header has none.
    """

    number: int
    unit: str


def find_columns(
    header: tuple[str, ...],
    units: Mapping[str, Mapping[str, float]],
    expected: tuple[str, ...] | None = None,
) -> dict[str, Column]:
    """Find the columns of these names among others.

    Parameters
    ----------
    header :
        Names of all columns, which may carry a unit in brackets, ``elbow [deg]``.
    units :
        Which units each name may have.
    expected :
        Names for the message that refuses a column of another name; such columns are skipped if
        not given.

    Raises
    ------
    InputError
        A column is there twice, or has a unit that it cannot have.
    """
    found: dict[str, Column] = {}
    for i, cell in enumerate(header):
        name, unit = (cell, "") if cell in units else split_unit(cell)
        if name not in units:
            if expected is None:
                continue
            raise UnknownNameError("column", name, expected, "is expected")
        if name in found:
            raise InputError(f"column {name!r} is there twice")
        if unit and unit not in units[name]:
            raise InputError(f"column {cell!r}: its unit can be {' or '.join(units[name])}")
        found[name] = Column(i, unit)
    return found


def read_rows(
    stream: TextIO, line: int = 1, width: int | None = None, *, one_line: bool = False
) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that are not blank, with the line on which each ends.

    Parameters
    ----------
    stream :
        Text whose line ends were not translated.
    line :
        Number of its first line.
    width :
        How many cells a row needs; any number if not given.
    one_line :
        Whether to refuse cells with line breaks.

    Raises
    ------
    InputError
        The text is not CSV, or a row has another number of cells.
    """
    reader = csv.reader(stream, strict=True, skipinitialspace=True)
    begin = line
    try:
        for cells in reader:
            end = line + reader.line_num - 1
            if one_line and end > begin:
                raise InputError(f"line {begin}: a cell goes on in the next line")
            if any(map(str.strip, cells)):
                if width not in {None, len(cells)}:
                    raise InputError(f"line {end}: needs {width} cells, got {len(cells)}")
                yield end, cells
            begin = end + 1
    except csv.Error as problem:
        raise InputError(f"line {begin}: is not CSV: {printable(problem)}") from None


class Header(NamedTuple):
    """The first row of a table.

    Attributes
    ----------
    cells :
        Names of all columns.
    end :
        How many characters it takes, with the lines before it.
    line :
        Number of the line after it.
    """

    cells: tuple[str, ...]
    end: int
    line: int

    def rows_below(self, text: str) -> Iterator[tuple[int, list[str]]]:
        """Yield the rows of the same text that follow, see `read_rows`."""
        return read_rows(io.StringIO(text[self.end :], newline=""), self.line, len(self.cells))


def read_header(text: str, *, one_line: bool = False) -> Header | None:
    """Read the header of a table; ``None`` if every line is blank.

    Raises
    ------
    InputError
        It is not CSV.
    """
    stream = io.StringIO(text, newline="")
    for line, cells in read_rows(stream, one_line=one_line):
        return Header(tuple(cell.strip() for cell in cells), stream.tell(), line + 1)
    return None


@dataclass(frozen=True)
class NumberReader:
    """Reads columns of numbers.

    Attributes
    ----------
    header :
        Names of all columns.
    columns :
        Those that are read, in this order.
    row :
        What a row holds, for messages, e.g. ``posture``.
    largest :
        The largest absolute value that is taken.
    one_line :
        Whether to refuse cells with line breaks.
    """

    header: tuple[str, ...]
    columns: tuple[int, ...]
    row: str
    largest: float = LARGEST_NUMBER
    one_line: bool = False

    def read(self, text: str, line: int) -> Matrix:
        """Return the numbers of some lines, shape (rows, columns).

        Parameters
        ----------
        text :
            Lines below the header.
        line :
            Number of the first of them.

        Raises
        ------
        InputError
            A row has another length or a cell is no number.
        """
        try:
            return self._read_at_once(text)
        except ValueError:  # quotes, blanks, or a mistake: cell by cell it is found
            stream = io.StringIO(text, newline="")
            rows = read_rows(stream, line, len(self.header), one_line=self.one_line)
            numbers = [[self._number(cells, i, end) for i in self.columns] for end, cells in rows]
            return np.array(numbers).reshape(-1, len(self.columns))

    def _read_at_once(self, text: str) -> Matrix:
        if not text or text.isspace():
            return np.empty((0, len(self.columns)))
        if '"' in text:
            raise ValueError("a cell could go on in the next line")
        # Other columns are read, too, as one letter each: so the cells of every row are counted.
        kinds = [(str(i), "f8" if i in self.columns else "U1") for i in range(len(self.header))]
        # NumPy would skip blanks of other scripts around a number.
        stream = io.StringIO(text.encode("ascii", "replace").decode(), newline="")
        rows = np.loadtxt(stream, kinds, comments=None, delimiter=",", ndmin=1)
        values = np.stack([rows[str(i)] for i in self.columns], axis=1)
        if not (np.abs(values) <= self.largest).all():
            raise ValueError("too large or not finite")
        return values

    def _number(self, cells: list[str], i: int, line: int) -> float:
        where = f"line {line}, {shortened(self.header[i])}"
        if not cells[i].strip():
            raise InputError(f"{where}: the cell is empty; every {self.row} needs every joint")
        try:
            return read_numbers(cells[i], 1, self.largest)[0]
        except ValueError as problem:
            raise InputError(f"{where}: {problem}") from None
