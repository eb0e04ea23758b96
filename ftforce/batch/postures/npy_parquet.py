"""Postures in an array that NumPy wrote to a file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.posture_columns import ROWS, check_numbers
from ftforce.core.arrays import read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class NpyReader:
    """Rows of an array in a file of NumPy's.

    It is read, not mapped into memory: a mapped file that is cut short ends the program.

    Attributes
    ----------
    count, n :
        Shape of the array.
    dtype :
        Type of its numbers.
    offset :
        Where they begin, bytes.
    by_columns :
        Whether it stands there column by column.
    """

    count: int
    n: int
    dtype: np.dtype[Any]
    offset: int
    by_columns: bool

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return rows, see `Reader.read`."""
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
        with np.errstate(over="ignore"):  # what is too large is refused as infinite
            return numbers.astype(np.float64, copy=False)

    def blocks(self, path: str) -> Iterator[Matrix]:
        """Yield all rows."""
        for start in range(0, self.count, ROWS):
            yield self.read(path, start, min(start + ROWS, self.count))


def open_npy(robot: Robot, path: str, degrees: bool) -> tuple[NpyReader, Vector]:
    """Check a file and return what reads it, and what turns its columns into rad or m.

    Raises
    ------
    InputError
        It holds another array than postures of the robot.
    OSError, ValueError
        It cannot be read, or is no NPY file.
    """
    array = np.lib.format.open_memmap(path, mode="r")
    if array.ndim != 2 or array.shape[1] != robot.n or not len(array):
        raise InputError(
            f"needs an array of shape k x {robot.n}, one row per posture and one column per "
            f"joint, got the shape {array.shape}: {robot.numbered()}"
        )
    if array.dtype.kind not in "fiu":
        raise InputError(f"needs real numbers, got an array of type {array.dtype}")
    by_columns = not array.flags.c_contiguous
    reader = NpyReader(len(array), robot.n, array.dtype, array.offset, by_columns)
    check_numbers(reader.blocks(path), robot.names)
    turn = math.radians(1.0) if degrees else 1.0
    scales = np.array([1.0 if joint.type == "prismatic" else turn for joint in robot.joints])
    return reader, read_only(scales)
