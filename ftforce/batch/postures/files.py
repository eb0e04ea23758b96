"""Postures from files of any size: NPY, CSV and Parquet, a block at a time.

A file is read once as a whole when it is opened: every number is checked and its SHA-256 is taken.
After that a block reads its own part only, and nothing of the file stays in memory.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from ftforce.batch.postures.csv import CsvReader, open_csv
from ftforce.batch.postures.npy_parquet import matched, open_npy, open_parquet
from ftforce.batch.postures.postures import checked_block
from ftforce.errors import FtforceError, InputError, TrajectoryError, printable

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

FORMATS = ("npy", "csv", "parquet")
_KIND = "a file of postures (.npy, .csv or .parquet)"


class Reader(Protocol):
    """Reads rows of a file, as they stand there."""

    @property
    def count(self) -> int:
        """Number of rows."""

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return the rows ``start`` to ``stop`` - 1, shape (stop - start, n)."""


class Stamp(NamedTuple):
    """What tells that a file has changed: its size in bytes, and when it was written, ns."""

    size: int
    written: int

    @classmethod
    def of(cls, path: str) -> Stamp:
        """Return a file's."""
        about = Path(path).stat()
        return cls(about.st_size, about.st_mtime_ns)


@dataclass(frozen=True, eq=False)
class FilePostures:
    """Postures in a file. Made by `postures_from_file`.

    Attributes
    ----------
    path :
        The file, from the root.
    reader :
        Of its format.
    scales :
        What its columns are multiplied by, to rad or m, shape (n,).
    stamp :
        Its size and when it was written.
    sha256 :
        Of its content.
    """

    path: str
    reader: Reader
    scales: Vector
    stamp: Stamp
    sha256: str

    @property
    def count(self) -> int:
        """Number of postures."""
        return self.reader.count

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.scales)

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`.

        Raises
        ------
        InputError
            There are no such postures.
        TrajectoryError
            The file cannot be read any more, or it has changed since it was opened.
        """
        start, stop = checked_block(start, stop, self.count)
        try:
            self._check_unchanged()
            q = self.reader.read(self.path, start, stop)
            self._check_unchanged()
        except Exception as problem:  # whatever a file that changes makes of its reader
            raise _as_error(self.path, problem) from None
        if len(q) != stop - start:
            raise TrajectoryError(self.path, f"lacks rows {start + 1} to {stop}: is it damaged?")
        q *= self.scales
        return q

    def _check_unchanged(self) -> None:
        if (now := Stamp.of(self.path)) != self.stamp:
            sizes = f": {now.size:,} bytes instead of {self.stamp.size:,}"
            what = sizes if now.size != self.stamp.size else ": it was written anew"
            raise InputError(f"has changed since it was opened{what}; open it again")

    def identity(self) -> dict[str, Any]:
        """Return name, size, SHA-256 and scales."""
        return {
            "source": "file",
            "name": Path(self.path).name,
            "bytes": self.stamp.size,
            "sha256": self.sha256,
            "scales": self.scales.tolist(),
        }

    def __str__(self) -> str:
        """Return number and file name."""
        name = printable(Path(self.path).name)
        return f"{self.count:,} posture{'s' if self.count > 1 else ''} from {name}"


def postures_from_file(
    robot: Robot, path: str | PathLike[str], *, degrees: bool = False
) -> FilePostures:
    """Open a file of postures, which may be larger than the memory.

    A CSV file has a header, a Parquet file names, with a column per joint in any order; other
    columns are ignored. A name may carry a unit in brackets, ``elbow [deg]``. An NPY file holds an
    array of shape (k, n). Postures beyond the limits of the joints are kept.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file; its name ends in ``.npy``, ``.csv`` or ``.parquet``.
    degrees :
        Whether angles are in degrees where no unit says otherwise.

    Raises
    ------
    InputError
        The name ends otherwise.
    TrajectoryError
        The file cannot be read, lacks a joint, or holds something that is no finite number.
    FtforceError
        Parquet without pyarrow.

    Examples
    --------
    >>> import ftforce
    >>> robot = ftforce.load_robot("dh5")
    >>> postures = postures_from_file(robot, "fleet.parquet")  # doctest: +SKIP
    """
    form = Path(path).suffix.lower().removeprefix(".")
    if form not in FORMATS:
        raise InputError(
            f"{printable(path)}: the name of a file of postures ends in .npy, .csv or .parquet"
        )
    try:
        file = _checked_file(path)
        stamp = Stamp.of(file)
        if not stamp.size:
            raise InputError(f"is empty; {_KIND} was expected")
        postures = FilePostures(file, *_OPEN[form](robot, file, degrees), stamp, _sha256(file))
        postures._check_unchanged()
    except Exception as problem:  # whatever a damaged file makes of its reader
        raise _as_error(path, problem) from None
    return postures


def _as_error(path: str | PathLike[str], problem: Exception) -> FtforceError:
    if isinstance(problem, FtforceError) and not isinstance(problem, InputError):
        return problem
    if isinstance(problem, InputError):
        return TrajectoryError(path, printable(problem))
    if isinstance(problem, OSError) and problem.strerror:
        return TrajectoryError(path, f"cannot be read ({printable(problem.strerror)})")
    return TrajectoryError(path, f"is damaged, or no {_KIND[2:]} ({printable(problem)})")


def _checked_file(path: str | PathLike[str]) -> str:
    file = Path(path)
    if not file.exists():
        raise InputError(f"no such file; {_KIND} was expected")
    if not file.is_file():  # blocks are read in any order, which a pipe cannot
        what = "a folder" if file.is_dir() else "not a regular file"
        raise InputError(f"is {what}; {_KIND} was expected")
    return str(file.absolute())


def _sha256(path: str) -> str:
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _open_csv(robot: Robot, path: str, degrees: bool) -> tuple[CsvReader, Vector]:
    scales: list[Vector] = []

    def choose(header: tuple[str, ...]) -> tuple[int, ...]:
        columns, found = matched(robot, header, degrees)
        scales.append(found)
        return columns

    return open_csv(path, choose), scales[0]


_OPEN: dict[str, Callable[[Robot, str, bool], tuple[Reader, Vector]]] = {
    "npy": open_npy,
    "csv": _open_csv,
    "parquet": open_parquet,
}
