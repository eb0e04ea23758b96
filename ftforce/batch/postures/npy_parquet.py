"""Postures in NPY and Parquet files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.errors import FtforceError, InputError, listed
from ftforce.io.csv_table import POSITION_UNITS, find_columns
from ftforce.io.joint_columns import joint_columns
from ftforce.io.text import LARGEST_NUMBER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.io.joint_columns import NamesIn
    from ftforce.robot.robot import Robot

_ROWS = 1 << 16  # rows checked at a time


def matched(
    robot: Robot, header: tuple[str, ...], degrees: bool, names_in: NamesIn | None = None
) -> tuple[tuple[int, ...], Vector, tuple[str, ...]]:
    """Return the columns of a robot's joints in a table.

    Parameters
    ----------
    robot :
        The arm.
    header :
        Names of all columns; that of a joint may end with a unit in brackets, ``elbow [deg]``.
    degrees :
        Whether angles without a unit are in degrees.
    names_in :
        As in `joint_columns`.

    Returns
    -------
    :
        The column of each joint, from 0, the factor that converts it to rad or m, shape (n,), and
        what was decided.

    Raises
    ------
    InputError
        A joint is missing, appears twice, or has an invalid unit.
    """
    given = header
    header, notes = joint_columns(header, robot.names, names_in)
    units = {joint.name: POSITION_UNITS[joint.unit] for joint in robot.joints}
    if degrees:
        units = {name: {**known, "": known.get("deg", 1.0)} for name, known in units.items()}
    columns = find_columns(header, units)
    if missing := [name for name in robot.names if name not in columns]:
        raise InputError(
            f"missing column{'s' if len(missing) > 1 else ''}: {listed(missing)}; expected one "
            f"column per joint, with its name; columns found: {listed(given)}"
        )
    numbers, scales = zip(*(columns[name] for name in robot.names), strict=True)
    return numbers, read_only(np.array(scales)), notes


def _check_numbers(blocks: Iterator[Matrix], names: tuple[str, ...]) -> None:
    """Check that all numbers are finite and of plausible size.

    Parameters
    ----------
    blocks :
        Consecutive rows, shape (k, n).
    names :
        Names of the n joints, for the message.

    Raises
    ------
    InputError
        One is not; the message says where.
    """
    first = 0
    for block in blocks:
        wrong = ~(np.abs(block) <= LARGEST_NUMBER)  # negated, so that NaN is wrong
        if wrong.any():
            i, j = np.argwhere(wrong)[0].tolist()
            raise InputError(
                f"row {first + i + 1}, joint {names[j]}: invalid position {block[i, j]:g}; "
                f"expected a finite number of magnitude at most {LARGEST_NUMBER:g}"
            )
        first += len(block)


@dataclass(frozen=True, eq=False)
class NpyReader:
    """Reader of an NPY file.

    The file is read, not memory-mapped: truncating a mapped file crashes the process.

    Attributes
    ----------
    count, n :
        Shape of the array.
    dtype :
        Data type of the array.
    offset :
        Offset of the data, bytes.
    by_columns :
        Whether the array is stored in column-major order.
    """

    count: int
    n: int
    dtype: np.dtype[Any]
    offset: int
    by_columns: bool

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return the rows ``start`` to ``stop`` - 1, see `Reader.read`.

        Parameters
        ----------
        path :
            The file.
        start, stop :
            Half-open range of rows, from 0.
        """
        with Path(path).open("rb") as stream:
            if not self.by_columns:
                rows = self._numbers(stream, start * self.n, (stop - start) * self.n)
                return rows.reshape(-1, self.n)
            columns = (
                self._numbers(stream, j * self.count + start, stop - start) for j in range(self.n)
            )
            return np.stack(list(columns), axis=1)

    def _numbers(self, stream: Any, first: int, count: int) -> Vector:
        stream.seek(self.offset + first * self.dtype.itemsize)
        numbers = np.fromfile(stream, self.dtype, count)
        with np.errstate(over="ignore"):  # overflow to infinity is rejected by the check
            return numbers.astype(np.float64, copy=False)

    def blocks(self, path: str) -> Iterator[Matrix]:
        """Yield all rows."""
        for start in range(0, self.count, _ROWS):
            yield self.read(path, start, min(start + _ROWS, self.count))


def open_npy(robot: Robot, path: str, degrees: bool) -> tuple[NpyReader, Vector]:
    """Check a file and return its reader, and the factors that convert its columns to rad or m.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file.
    degrees :
        Whether angles are in degrees.

    Raises
    ------
    InputError
        It does not hold an array of the robot's postures.
    OSError, ValueError
        It cannot be read, or is not an NPY file.
    """
    array = np.lib.format.open_memmap(path, mode="r")
    if array.ndim != 2 or array.shape[1] != robot.n or not len(array):
        raise InputError(
            f"expected an array of shape (k, {robot.n}), one row per posture and one column per "
            f"joint ({robot.numbered()}), got shape {array.shape}"
        )
    if array.dtype.kind not in "fiu":
        raise InputError(f"expected an array of real numbers, got dtype {array.dtype}")
    by_columns = not array.flags.c_contiguous
    reader = NpyReader(len(array), robot.n, array.dtype, array.offset, by_columns)
    _check_numbers(reader.blocks(path), robot.names)
    unit = math.radians(1.0) if degrees else 1.0
    scales = np.array([1.0 if joint.type == "prismatic" else unit for joint in robot.joints])
    return reader, read_only(scales)


@dataclass(frozen=True, eq=False)
class ParquetReader:
    """Reader of a Parquet file.

    Attributes
    ----------
    names :
        Names of the n columns of joints.
    starts :
        First row of each row group, and the number of rows.
    """

    names: tuple[str, ...]
    starts: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.starts[-1]

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return the rows ``start`` to ``stop`` - 1, see `Reader.read`.

        Preceding rows of the row group are read as well.

        Parameters
        ----------
        path :
            The file.
        start, stop :
            Half-open range of rows, from 0.
        """
        groups = range(len(self.starts) - 1)
        wanted = [g for g in groups if self.starts[g] < stop and self.starts[g + 1] > start]
        q = np.empty((stop - start, len(self.names)))
        at = self.starts[wanted[0]] if wanted else stop
        for batch in self._batches(path, wanted):
            low, high = max(at, start), min(at + batch.num_rows, stop)
            if low < high:
                q[low - start : high - start] = self._matrix(batch.slice(low - at, high - low))
            at += batch.num_rows
            if at >= stop:
                return q
        return q[: max(0, at - start)]

    def blocks(self, path: str) -> Iterator[Matrix]:
        """Yield all rows."""
        yield from map(self._matrix, self._batches(path, list(range(len(self.starts) - 1))))

    def _batches(self, path: str, groups: list[int]) -> Iterator[Any]:
        with _parquet_file(path) as file:
            # Without threads, which may crash the interpreter at exit.
            batches = file.iter_batches(
                _ROWS, row_groups=groups, columns=list(self.names), use_threads=False
            )
            yield from batches if groups else ()

    def _matrix(self, batch: Any) -> Matrix:
        q = np.empty((batch.num_rows, len(self.names)))
        for j, name in enumerate(self.names):
            q[:, j] = batch.column(name).to_numpy(zero_copy_only=False)
        return q


def open_parquet(robot: Robot, path: str, degrees: bool) -> tuple[ParquetReader, Vector]:
    """Check a file and return its reader, and the factors that convert its columns to rad or m.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file.
    degrees :
        Whether angles without a unit are in degrees.

    Raises
    ------
    InputError
        A joint is missing, or a value is not a finite number.
    FtforceError
        pyarrow is not installed.
    OSError, ValueError
        It cannot be read, or is not a Parquet file.
    """
    with _parquet_file(path) as file:
        schema, about = file.schema_arrow, file.metadata
        groups = [about.row_group(g).num_rows for g in range(about.num_row_groups)]
    columns, scales, _ = matched(robot, tuple(schema.names), degrees)
    for i in columns:
        _check_type(schema.field(i))
    if not sum(groups):
        raise InputError("contains no postures")
    starts = (0, *np.cumsum(groups).tolist())
    reader = ParquetReader(tuple(schema.names[i] for i in columns), starts)
    _check_numbers(reader.blocks(path), robot.names)
    return reader, scales


def _check_type(column: Any) -> None:
    from pyarrow import types

    if not (types.is_floating(column.type) or types.is_integer(column.type)):
        raise InputError(f"column {column.name!r} must be numeric, got type {column.type}")


def _parquet_file(path: str) -> Any:
    try:
        from pyarrow.parquet import ParquetFile
    except ImportError:
        raise FtforceError(
            "reading Parquet files requires pyarrow (pip install 'ftforce[parquet]'); "
            ".npy and .csv files do not"
        ) from None
    # Buffered: otherwise the columns of a row group are loaded into memory completely.
    return ParquetFile(path, pre_buffer=False, buffer_size=1 << 16, page_checksum_verification=True)
