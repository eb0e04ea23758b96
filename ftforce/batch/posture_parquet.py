"""Postures in a Parquet file, a column per joint, read batch by batch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.posture_columns import ROWS, check_numbers, matched
from ftforce.errors import FtforceError, InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class ParquetReader:
    """Rows of a Parquet file.

    Attributes
    ----------
    names :
        Columns of the joints, n.
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
        """Return rows, see `Reader.read`; in a row group, those before them are read too."""
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
            # Without threads: at exit they may end the interpreter with an error.
            batches = file.iter_batches(
                ROWS, row_groups=groups, columns=list(self.names), use_threads=False
            )
            yield from batches if groups else ()

    def _matrix(self, batch: Any) -> Matrix:
        q = np.empty((batch.num_rows, len(self.names)))
        for j, name in enumerate(self.names):
            q[:, j] = batch.column(name).to_numpy(zero_copy_only=False)
        return q


def open_parquet(robot: Robot, path: str, degrees: bool) -> tuple[ParquetReader, Vector]:
    """Check a file and return what reads it, and what turns its columns into rad or m.

    Raises
    ------
    InputError
        A joint is missing, or something is no finite number.
    FtforceError
        Without pyarrow.
    OSError, ValueError
        It cannot be read, or is no Parquet file.
    """
    with _parquet_file(path) as file:
        schema, about = file.schema_arrow, file.metadata
        groups = [about.row_group(g).num_rows for g in range(about.num_row_groups)]
    columns, scales = matched(robot, tuple(schema.names), degrees)
    for i in columns:
        _check_type(schema.field(i))
    if not sum(groups):
        raise InputError("holds no postures")
    starts = (0, *np.cumsum(groups).tolist())
    reader = ParquetReader(tuple(schema.names[i] for i in columns), starts)
    check_numbers(reader.blocks(path), robot.names)
    return reader, scales


def _check_type(column: Any) -> None:
    from pyarrow import types

    if not (types.is_floating(column.type) or types.is_integer(column.type)):
        raise InputError(f"column {column.name!r} needs numbers, holds {column.type}")


def _parquet_file(path: str) -> Any:
    try:
        from pyarrow.parquet import ParquetFile
    except ImportError:
        raise FtforceError(
            "Parquet files need pyarrow: pip install 'ftforce[parquet]'; .npy and .csv need nothing"
        ) from None
    # Through a buffer: otherwise the row group's columns are in memory as a whole.
    return ParquetFile(path, pre_buffer=False, buffer_size=1 << 16)
