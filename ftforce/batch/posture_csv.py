"""A CSV file of any size as rows of numbers, any of which can be read without those before it.

It is read in pieces of some 256 kB that end where a line does. Where each begins, and with which
row, is kept: that is all that is needed to find a row again.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from ftforce.arrays import read_only
from ftforce.errors import InputError, printable
from ftforce.source import LARGEST_NUMBER, read_numbers, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from ftforce.arrays import Matrix

PIECE = 1 << 18  # bytes
_MARK = b"\xef\xbb\xbf"  # of a file in UTF-8 that says so


class Table(NamedTuple):
    """How rows are read.

    Attributes
    ----------
    header :
        Names of all columns.
    columns :
        Those that are read, in this order.
    """

    header: tuple[str, ...]
    columns: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class CsvReader:
    """Rows of a CSV file that was checked.

    Attributes
    ----------
    table :
        How rows are read.
    starts :
        First row of each piece, and the number of rows.
    offsets :
        Where each piece begins, bytes, and where the last one ends.
    """

    table: Table
    starts: NDArray[np.int64]
    offsets: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.starts[-1])

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return the rows ``start`` to ``stop`` - 1, shape (stop - start, n)."""
        if start == stop:
            return np.empty((0, len(self.table.columns)))
        first = int(np.searchsorted(self.starts, start, "right")) - 1
        last = int(np.searchsorted(self.starts, stop, "left"))
        blocks = []
        with Path(path).open("rb") as stream:
            stream.seek(int(self.offsets[first]))
            for size in np.diff(self.offsets[first : last + 1]).tolist():
                blocks.append(_numbers(_decoded(stream.read(size)), self.table, 1))  # noqa: PERF401
        skipped = start - int(self.starts[first])
        return np.concatenate(blocks)[skipped : skipped + stop - start].copy()


def open_csv(path: str, choose: Callable[[tuple[str, ...]], tuple[int, ...]]) -> CsvReader:
    """Read a file once as a whole, check it, and note where its rows stand.

    Parameters
    ----------
    path :
        The file.
    choose :
        Returns which columns are wanted, of the names of all.

    Raises
    ------
    InputError
        It is no CSV file of numbers; the message says where.
    OSError
        It cannot be read.
    """
    with Path(path).open("rb") as stream:
        header, offset, line = _header(stream.read(PIECE))
        table = Table(header, choose(header))
        stream.seek(offset)
        starts, offsets = [0], [offset]
        for piece in _pieces(stream):
            text = _decoded(piece, f"after line {line - 1}")
            starts.append(starts[-1] + len(_numbers(text, table, line)))
            offsets.append(offsets[-1] + len(piece))
            line += text.count("\n") + text.count("\r") - text.count("\r\n")
    if not starts[-1]:
        raise InputError("holds no postures below its header")
    return CsvReader(table, read_only(np.array(starts)), read_only(np.array(offsets)))


def _header(data: bytes) -> tuple[tuple[str, ...], int, int]:
    """Return the header's cells, where the next line begins, and its number."""
    offset = len(_MARK) if data.startswith(_MARK) else 0
    complete = data if len(data) < PIECE else data[: _end_of_lines(data)]
    for number, line in enumerate(io.StringIO(_decoded(complete[offset:]), newline=""), start=1):
        offset += len(line.encode())
        for row in _rows(line, number):
            if any(map(str.strip, row)):
                return tuple(cell.strip() for cell in row), offset, number + 1
    raise InputError("holds no header with the joints' names")


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    rest = b""
    while data := stream.read(PIECE):
        data = rest + data
        end = _end_of_lines(data)
        if not end and len(data) > PIECE:
            raise InputError(f"has a line of more than {PIECE:,} bytes: is it a CSV file?")
        if end:
            yield data[:end]
        rest = data[end:]
    if rest:
        yield rest


def _end_of_lines(data: bytes) -> int:
    """Return the length of the complete lines; a return at the end may be half of CR LF."""
    return data.rfind(b"\n") + 1 or data.rfind(b"\r", 0, len(data) - 1) + 1


def _decoded(data: bytes, where: str = "at its beginning") -> str:
    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise InputError(f"is not UTF-8 text ({where})") from None
    if "\0" in text:
        raise InputError(f"is a binary file ({where}); CSV was expected")
    return text


def _rows(text: str, line: int) -> Iterator[list[str]]:
    """Yield the rows of a text that begins at a line; one that is empty for an empty line."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, skipinitialspace=True)
    try:
        for number, row in enumerate(reader, start=1):
            if reader.line_num != number:  # a piece could end within
                raise InputError(f"line {line + number - 1}: a cell goes on in the next line")
            yield row
    except csv.Error as problem:
        raise InputError(
            f"line {line + reader.line_num - 1}: is not CSV: {printable(problem)}"
        ) from None


def _numbers(text: str, table: Table, line: int) -> Matrix:
    """Return the numbers of the wanted columns, shape (rows, n).

    Raises
    ------
    InputError
        A row has another length or a cell is no number.
    """
    try:
        return _fast_numbers(text, table)
    except (ValueError, csv.Error):  # InputError is one, too: only the careful way says where
        rows = [
            _careful_row(row, table, f"line {number}")
            for number, row in enumerate(_rows(text, line), start=line)
            if any(map(str.strip, row))
        ]
        return np.array(rows).reshape(-1, len(table.columns))


def _fast_numbers(text: str, table: Table) -> Matrix:
    if '"' in text:
        raise ValueError("a cell could go on in the next line")
    # float() reads 1_000 and the digits of every script.
    number: Callable[[str], float] = float if text.isascii() and "_" not in text else _number
    width, wanted = len(table.header), _picker(table.columns)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, skipinitialspace=True)
    rows = [list(map(number, wanted(row))) for row in reader if row and _has(row, width)]
    values = np.array(rows).reshape(-1, len(table.columns))
    if not (np.abs(values) <= LARGEST_NUMBER).all():
        raise ValueError("too large or not finite")
    return values


def _picker(columns: tuple[int, ...]) -> Callable[[list[str]], tuple[str, ...]]:
    """Return what takes these cells of a row; of one cell `itemgetter` makes no tuple."""
    pick: Any = itemgetter(*columns)
    return pick if len(columns) > 1 else lambda row: (pick(row),)


def _has(row: list[str], width: int) -> bool:
    if len(row) != width:
        raise ValueError("another number of cells")
    return True


def _careful_row(row: list[str], table: Table, where: str) -> list[float]:
    if len(row) != len(table.header):
        raise InputError(f"{where}: needs {len(table.header)} cells, got {len(row)}")
    numbers = []
    for i in table.columns:
        if not row[i].strip():
            raise InputError(
                f"{where}, {shortened(table.header[i])}: the cell is empty; every posture needs "
                "every joint"
            )
        try:
            numbers.append(_number(row[i]))
        except ValueError as problem:
            raise InputError(f"{where}, {shortened(table.header[i])}: {problem}") from None
    return numbers


def _number(cell: str) -> float:
    return read_numbers(cell, 1)[0]
