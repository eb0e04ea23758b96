"""Tables in CSV files: a header with names and units, rows with their places, columns of numbers.

An error names the line and, where it can, the column: ``line 3, 'elbow': 'x' is not a number``.
"""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.errors import InputError, UnknownNameError, printable
from ftforce.io.text import LARGEST_NUMBER, read_numbers, shortened

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import TextIO

    from numpy.typing import NDArray

# Of a joint's unit, those that its column may be in, and what turns them into it.
POSITION_UNITS = {
    "rad": {"": 1.0, "rad": 1.0, "deg": math.radians(1.0)},
    "m": {"": 1.0, "m": 1.0},
}


def split_unit(cell: str) -> tuple[str, str]:
    """Return name and unit of ``name [unit]``."""
    name, bracket, unit = cell.removesuffix("]").rpartition("[")
    if not bracket or not cell.endswith("]"):
        return cell, ""
    return name.strip(), unit.strip()


def find_columns(
    header: tuple[str, ...],
    units: Mapping[str, Mapping[str, float]],
    expected: tuple[str, ...] | None = None,
) -> dict[str, tuple[int, float]]:
    """Return the numbers of columns, from 0, and what they are multiplied by, by name.

    Parameters
    ----------
    header :
        Names of all columns, which may carry a unit in brackets, ``elbow [deg]``.
    units :
        For each name the units it may have and their factors; ``""`` is for none.
    expected :
        The names that are listed when another column is refused; if not given it is skipped.

    Raises
    ------
    InputError
        A column is there twice, or has a unit that it cannot have.
    """
    found: dict[str, tuple[int, float]] = {}
    for i, cell in enumerate(header):
        name, unit = (cell, "") if cell in units else split_unit(cell)
        if name not in units:
            if expected is None:
                continue
            raise UnknownNameError("column", name, expected, "is expected")
        if name in found:
            raise InputError(f"column {name!r} is there twice")
        if unit not in units[name]:
            known = " or ".join(filter(None, units[name]))
            raise InputError(f"column {cell!r}: its unit can be {known}")
        found[name] = i, units[name][unit]
    return found


class Table(NamedTuple):
    """A header, and lines of text below it.

    Attributes
    ----------
    header :
        Names of all columns.
    text :
        The lines; their ends were not translated.
    line :
        Number of the first of them.
    one_line :
        Whether cells with line breaks are refused.
    """

    header: tuple[str, ...]
    text: str
    line: int
    one_line: bool = False

    @classmethod
    def of(cls, text: str, *, one_line: bool = False) -> Table | None:
        """Take the first row that is not blank for the header; ``None`` if there is none.

        Raises
        ------
        InputError
            It is not CSV.
        """
        stream = io.StringIO(text, newline="")
        for line, cells in _rows(stream, 1, one_line):
            return cls(tuple(map(str.strip, cells)), stream.read(), line + 1, one_line)
        return None

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the rows that are not blank, with the line on which each ends.

        Raises
        ------
        InputError
            They are not CSV, or one has another number of cells than the header.
        """
        for line, cells in _rows(io.StringIO(self.text, newline=""), self.line, self.one_line):
            if len(cells) != len(self.header):
                raise InputError(f"line {line}: needs {len(self.header)} cells, got {len(cells)}")
            yield line, cells

    def numbers(
        self, columns: Sequence[int], largest: float = LARGEST_NUMBER
    ) -> NDArray[np.float64]:
        """Return the numbers of some columns, up to the largest, shape (rows, columns).

        Raises
        ------
        InputError
            As `rows`, or a cell is no number.
        """
        try:
            return self._numbers_at_once(columns, largest)
        except ValueError:  # quotes, blanks, or a mistake: cell by cell it is found
            found = [
                [self._number(line, i, cells[i], largest) for i in columns]
                for line, cells in self.rows()
            ]
            return np.array(found).reshape(-1, len(columns))

    def _numbers_at_once(self, columns: Sequence[int], largest: float) -> NDArray[np.float64]:
        if not self.text or self.text.isspace():
            return np.empty((0, len(columns)))
        if '"' in self.text:
            raise ValueError("a cell could go on in the next line")
        # Other columns are read, too, as one letter each: so the cells of every row are counted.
        kinds = [(str(i), "f8" if i in columns else "U1") for i in range(len(self.header))]
        # NumPy would skip blanks of other scripts around a number.
        stream = io.StringIO(self.text.encode("ascii", "replace").decode(), newline="")
        rows = np.loadtxt(stream, kinds, comments=None, delimiter=",", ndmin=1)
        values = np.stack([rows[str(i)] for i in columns], axis=1)
        if not (np.abs(values) <= largest).all():
            raise ValueError("too large or not finite")
        return values

    def _number(self, line: int, column: int, cell: str, largest: float) -> float:
        where = f"line {line}, {shortened(self.header[column])}"
        if not cell.strip():
            raise InputError(f"{where}: the cell is empty; every row needs every joint")
        try:
            return read_numbers(cell, 1, largest)[0]
        except ValueError as problem:
            raise InputError(f"{where}: {problem}") from None


def _rows(stream: TextIO, line: int, one_line: bool) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(stream, strict=True, skipinitialspace=True)
    begin = line
    try:
        for cells in reader:
            end = line + reader.line_num - 1
            if one_line and end > begin:
                raise InputError(f"line {begin}: a cell goes on in the next line")
            if any(map(str.strip, cells)):
                yield end, cells
            begin = end + 1
    except csv.Error as problem:
        raise InputError(f"line {begin}: is not CSV: {printable(problem)}") from None
