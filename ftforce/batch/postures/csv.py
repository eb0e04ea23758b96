"""Random access to the rows of a CSV file of any size.

The file is read in pieces of about 256 kB that end at a line break. The byte offset and the first
row of each piece form an index that locates any row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeAlias

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.errors import InputError
from ftforce.io.csv_table import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator, Sequence

    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix
    from ftforce.io.joint_columns import NamesIn

PIECE = 1 << 18  # bytes
_MARK = b"\xef\xbb\xbf"  # UTF-8 byte order mark


@dataclass(frozen=True, eq=False)
class CsvReader:
    """Reader of a checked CSV file.

    Attributes
    ----------
    table :
        Header of the file.
    columns :
        Columns to read, in this order.
    starts :
        First row of each piece, and the number of rows.
    offsets :
        Offset of each piece, bytes, and the end of the last one.
    """

    table: Table
    columns: tuple[int, ...]
    starts: NDArray[np.int64]
    offsets: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.starts[-1])

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return the rows ``start`` to ``stop`` - 1, shape (stop - start, n), unconverted.

        Parameters
        ----------
        path :
            The file.
        start, stop :
            Half-open range of rows, from 0.
        """
        if start == stop:
            return np.empty((0, len(self.columns)))
        first = int(np.searchsorted(self.starts, start, "right")) - 1
        last = int(np.searchsorted(self.starts, stop, "left"))
        blocks = []
        with Path(path).open("rb") as stream:
            stream.seek(int(self.offsets[first]))
            for size in np.diff(self.offsets[first : last + 1]).tolist():
                piece = self.table._replace(text=_decoded(stream.read(size)))
                blocks.append(piece.numbers(self.columns))
        skipped = start - int(self.starts[first])
        return np.concatenate(blocks)[skipped : skipped + stop - start].copy()


Choose: TypeAlias = "Callable[[tuple[str, ...], NamesIn], tuple[int, ...]]"


def open_csv(path: str, choose: Choose) -> CsvReader:
    """Read a file once completely, check it, and index its rows.

    Parameters
    ----------
    path :
        The file.
    choose :
        Function that maps the names of all columns to the indices of those to read; its second
        argument returns the texts in some columns, which are the same in all rows.

    Raises
    ------
    InputError
        It is not a CSV file of numbers; the message says where.
    OSError
        It cannot be read.
    """
    with Path(path).open("rb") as stream:
        table, offset = _header(stream.read(PIECE))
        columns = choose(table.header, partial(_same_texts, stream, table, offset))
        starts, offsets = [0], [offset]
        for part, size in _parts(stream, table, offset):
            starts.append(starts[-1] + len(part.numbers(columns)))
            offsets.append(offsets[-1] + size)
    if not starts[-1]:
        raise InputError("has a header but no postures")
    return CsvReader(table, columns, read_only(np.array(starts)), read_only(np.array(offsets)))


def _header(data: bytes) -> tuple[Table, int]:
    """Return the table header, and the offset of the first data line."""
    offset = len(_MARK) if data.startswith(_MARK) else 0
    complete = data if len(data) < PIECE else data[: _end_of_lines(data)]
    table = Table.of(_decoded(complete[offset:]), one_line=True)
    if table is None:
        raise InputError("has no header with the joint names")
    return table._replace(text=""), len(complete) - len(table.text.encode())


def _parts(stream: BinaryIO, table: Table, offset: int) -> Iterator[tuple[Table, int]]:
    """Yield the table in parts, and their sizes in bytes."""
    line = table.line
    stream.seek(offset)
    for piece in _pieces(stream):
        text = _decoded(piece, f"after line {line - 1}")
        yield table._replace(text=text, line=line), len(piece)
        line += text.count("\n") + text.count("\r") - text.count("\r\n")


def _same_texts(
    stream: BinaryIO, table: Table, offset: int, columns: Sequence[int], among: Container[str]
) -> list[str]:
    """Return the texts in columns that have the same text in all rows, as `Table.same_texts`."""
    texts: list[str] = []
    for part, _ in _parts(stream, table, offset):
        texts = part.same_texts(columns, among, texts)
        if not texts:
            break
    return texts


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    rest = b""
    while data := stream.read(PIECE):
        data = rest + data
        end = _end_of_lines(data)
        if not end and len(data) > PIECE:
            raise InputError(f"has a line longer than {PIECE:,} bytes; is it a CSV file?")
        if end:
            yield data[:end]
        rest = data[end:]
    if rest:
        yield rest


def _end_of_lines(data: bytes) -> int:
    """Return the length of the complete lines; a CR at the end may be the first half of CR LF."""
    return data.rfind(b"\n") + 1 or data.rfind(b"\r", 0, len(data) - 1) + 1


def _decoded(data: bytes, where: str = "at its beginning") -> str:
    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise InputError(f"is not UTF-8 text ({where})") from None
    if "\0" in text:
        raise InputError(f"contains binary data ({where}); expected CSV text")
    return text
