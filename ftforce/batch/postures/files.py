"""Postures from NPY, CSV and Parquet files of any size, read block by block.

Opening a file reads it once completely, to check every number and compute its SHA-256. After that,
a block reads only its own part, and nothing of the file stays in memory.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from ftforce.batch.postures.csv import CsvReader, open_csv
from ftforce.batch.postures.npy_parquet import matched, open_npy, open_parquet
from ftforce.batch.postures.postures import checked_block
from ftforce.core.arrays import read_only
from ftforce.errors import FtforceError, InputError, TrajectoryError, printable
from ftforce.io.bag import ENDINGS, is_bag, read_motion
from ftforce.io.bag_files import files_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.io.joint_columns import NamesIn
    from ftforce.robot.robot import Robot

_FORMATS = ("npy", "csv", "parquet", *(ending[1:] for ending in ENDINGS))
_KIND = "a posture file (.npy, .csv or .parquet, or a bag: .mcap, .db3 or .bag)"


class Reader(Protocol):
    """Reads rows of a file, without unit conversion."""

    @property
    def count(self) -> int:
        """Number of rows."""

    def read(self, path: str, start: int, stop: int) -> Matrix:
        """Return the rows ``start`` to ``stop`` - 1, shape (stop - start, n).

        Parameters
        ----------
        path :
            The file.
        start, stop :
            Half-open range of rows, from 0.
        """


class Stamp(NamedTuple):
    """Size of a file, bytes, and its modification time, ns, to detect changes."""

    size: int
    written: int

    @classmethod
    def of(cls, path: str) -> Stamp:
        """Return the stamp of a file, or of a bag's folder with all of its files."""
        about = [file.stat() for file in _files(path)]
        return cls(sum(one.st_size for one in about), max(one.st_mtime_ns for one in about))


@dataclass(frozen=True, eq=False)
class FilePostures:
    """Postures in a file, made by `postures_from_file`.

    Attributes
    ----------
    path :
        Absolute path of the file.
    reader :
        Reader of its format.
    scales :
        Factors that convert its columns to rad or m, shape (n,).
    stamp :
        Its size and modification time.
    sha256 :
        SHA-256 of its content.
    notes :
        What was decided while reading it.
    """

    path: str
    reader: Reader
    scales: Vector
    stamp: Stamp
    sha256: str
    notes: tuple[str, ...] = ()

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

        Parameters
        ----------
        start, stop :
            Half-open range of indices, from 0.

        Raises
        ------
        InputError
            The range is invalid.
        TrajectoryError
            The file can no longer be read, or has changed since it was opened.
        """
        start, stop = checked_block(start, stop, self.count)
        try:
            self._check_unchanged()
            q = self.reader.read(self.path, start, stop)
            self._check_unchanged()
        except MemoryError:
            raise
        except Exception as problem:  # the reader of a file that changes can raise anything
            raise _as_error(self.path, problem) from None
        if len(q) != stop - start:
            raise TrajectoryError(
                self.path, f"rows {start + 1} to {stop} are missing; is the file damaged?"
            )
        q *= self.scales
        return q

    def _check_unchanged(self) -> None:
        if (now := Stamp.of(self.path)) != self.stamp:
            sizes = f" ({now.size:,} bytes instead of {self.stamp.size:,})"
            what = sizes if now.size != self.stamp.size else " (it was rewritten)"
            raise InputError(f"has changed since it was opened{what}; open it again")

    def identity(self) -> dict[str, Any]:
        """Return the name, size, SHA-256 and scales."""
        return {
            "source": "file",
            "name": Path(self.path).name,
            "bytes": self.stamp.size,
            "sha256": self.sha256,
            "scales": self.scales.tolist(),
        }

    def __str__(self) -> str:
        """Return the number of postures and the file name."""
        name = printable(Path(self.path).name)
        said = f" ({'; '.join(self.notes)})" if self.notes else ""
        return f"{self.count:,} posture{'s' if self.count > 1 else ''} from {name}{said}"


def postures_from_file(
    robot: Robot, path: str | PathLike[str], *, degrees: bool = False, topic: str | None = None
) -> FilePostures:
    """Open a file of postures, which may be larger than memory unless it is a bag.

    CSV files and Parquet files have one named column per joint, in any order, or columns in another
    form of ``ftforce.io.joint_columns``; other columns are ignored. A column name may end with a
    unit in brackets, ``elbow [deg]``. An NPY file holds an array of shape (k, n). Postures outside
    the joint limits are kept.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file, with extension ``.npy``, ``.csv``, ``.parquet``, ``.mcap``, ``.db3`` or ``.bag``,
        or the folder of a bag.
    degrees :
        Whether angles without a unit are in degrees; those of a bag never are.
    topic :
        Topic of a bag; by default the only one that has the joints.

    Raises
    ------
    InputError
        The extension is not supported.
    TrajectoryError
        The file cannot be read, lacks a joint, or contains a value that is not a finite number.
    FtforceError
        The file is Parquet, and pyarrow is not installed.

    Examples
    --------
    >>> import ftforce
    >>> robot = ftforce.load_robot("dh5")
    >>> postures = postures_from_file(robot, "fleet.parquet")  # doctest: +SKIP
    """
    form = Path(path).suffix.lower().removeprefix(".")
    bagged = is_bag(path)
    if form not in _FORMATS and not bagged:
        raise InputError(f"{printable(path)}: unknown file extension; expected {_KIND}")
    if (topic is not None and not bagged) or (degrees and bagged):
        what = "degrees" if bagged else f"topic {topic!r}"
        kind = "the folder of a bag" if Path(path).is_dir() else f"a .{form} file"
        raise InputError(f"{printable(path)}: {kind} has no {what}")
    try:
        file = _checked_file(path)
        stamp = Stamp.of(file)
        if not stamp.size:
            raise InputError(f"is empty; expected {_KIND}")
        notes: tuple[str, ...] = ()
        if bagged:
            motion = read_motion(file, robot.names, topic)
            notes = tuple(note for note in motion.notes if not note.startswith("the times"))
            opened: tuple[Reader, Vector] = _Read(motion.q), read_only(np.ones(robot.n))
        elif form == "csv":
            reader, scales, notes = _open_csv(robot, file, degrees)
            opened = reader, scales
        else:
            opened = _OPEN[form](robot, file, degrees)
        postures = FilePostures(file, *opened, stamp, _sha256(file), notes)
        postures._check_unchanged()
    except MemoryError:
        raise
    except Exception as problem:  # the reader of a damaged file can raise anything
        raise _as_error(path, problem) from None
    return postures


def _as_error(path: str | PathLike[str], problem: Exception) -> FtforceError:
    if isinstance(problem, FtforceError) and not isinstance(problem, InputError):
        return problem
    if isinstance(problem, InputError):
        return TrajectoryError(path, printable(problem))
    if isinstance(problem, OSError) and problem.strerror:
        return TrajectoryError(path, f"cannot be read ({printable(problem.strerror)})")
    return TrajectoryError(path, f"is damaged or not {_KIND}: {printable(problem)}")


def _files(path: str) -> list[Path]:
    """Return a file, or the files in the folder of a bag."""
    file = Path(path)
    return [file / "metadata.yaml", *files_of(file)] if file.is_dir() else [file]


def _checked_file(path: str | PathLike[str]) -> str:
    file = Path(path)
    if is_bag(file):
        files_of(file)
        return str(file.absolute())
    if not file.exists():
        raise InputError(f"no such file; expected {_KIND}")
    if not file.is_file():  # blocks are read in any order, which a pipe does not support
        what = "a folder" if file.is_dir() else "not a regular file"
        raise InputError(f"is {what}; expected {_KIND}")
    return str(file.absolute())


def _sha256(path: str) -> str:
    digest = hashlib.sha256()
    for file in _files(path):
        with file.open("rb") as stream:
            while piece := stream.read(1 << 16):
                digest.update(piece)
    return digest.hexdigest()


def _open_csv(robot: Robot, path: str, degrees: bool) -> tuple[CsvReader, Vector, tuple[str, ...]]:
    found: list[tuple[Vector, tuple[str, ...]]] = []

    def choose(header: tuple[str, ...], names_in: NamesIn) -> tuple[int, ...]:
        columns, scales, notes = matched(robot, header, degrees, names_in)
        found.append((scales, notes))
        return columns

    reader = open_csv(path, choose)
    return reader, *found[0]


@dataclass(frozen=True, eq=False)
class _Read:
    """Postures that were read as a whole, as those of a bag are."""

    q: Matrix

    @property
    def count(self) -> int:
        """Number of postures."""
        return len(self.q)

    def read(self, path: str, start: int, stop: int) -> Matrix:  # noqa: ARG002 # of the protocol
        return self.q[start:stop].copy()


_OPEN: dict[str, Callable[[Robot, str, bool], tuple[Reader, Vector]]] = {
    "npy": open_npy,
    "parquet": open_parquet,
}
