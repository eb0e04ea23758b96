"""Recorded joint motions, from arrays or CSV files."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_floats, check_finite, is_number, read_only
from ftforce.errors import DimensionError, InputError, TrajectoryError, printable
from ftforce.io.csv_table import POSITION_UNITS, Table, find_columns, split_unit
from ftforce.io.text import read_text, shortened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from os import PathLike

    from numpy.typing import ArrayLike

    from ftforce.robot.robot import Robot

_LARGEST_FILE = 2_000_000_000  # bytes
_GAP = 10.0  # times the median step; longer gaps are not interpolated
_NO_NUMBERS = "expected a header followed by rows of numbers"
_KIND = "a CSV file of a trajectory (columns t and joint names, or x,y,z)"
_SHORTEST = 1e-6  # s: smaller steps are indistinguishable from rounding error
_LARGEST = 1e12  # largest number accepted in a file; times may be Unix timestamps
_MISFIT = 0.1  # of a joint's travel: tolerated error of its integrated velocity
_NOISE = 1e-3  # rad or m: added to it, for encoder noise of joints at rest


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Joint positions over time, interpolated by a cubic spline.

    Attributes
    ----------
    t :
        Times, s, increasing, shape (N,), N ≥ 4.
    q :
        Joint positions along the chain, rad or m, shape (N, n).
    v :
        Joint velocities, shape (N, n); ``None`` if they were not recorded.
    source :
        Where the recording comes from.
    """

    t: Vector
    q: Matrix
    v: Matrix | None = None
    source: str = "given"

    @classmethod
    def of(
        cls,
        robot: Robot,
        t: ArrayLike,
        q: ArrayLike,
        v: ArrayLike | None = None,
        *,
        max_gap: float | None = None,
        source: str = "given",
    ) -> Recording:
        """Return a recorded motion after checking it.

        Parameters
        ----------
        robot :
            The arm.
        t :
            Times, s, shape (N,), N ≥ 4.
        q, v :
            Joint positions and velocities along the chain, rad or m, and per s, shape (N, n).
        max_gap :
            Longest time between two samples, s; by default ten times the median step.
        source :
            Where the recording comes from.

        Raises
        ------
        InputError
            Shapes do not match, times do not increase, or there is a gap.
        """
        times = as_floats(t, "t")
        if times.ndim != 1 or len(times) < 4:
            raise InputError(
                f"a recording needs 4 or more times, got an array of shape {times.shape}"
            )
        check_finite(times, "t")
        _check_times(times, max_gap, lambda i: f"sample {i + 1}")
        positions = _samples(robot, q, "q", len(times))
        velocities = None if v is None else _samples(robot, v, "v", len(times))
        return cls(read_only(times), positions, velocities, source)

    @classmethod
    def read(
        cls, robot: Robot, path: str | PathLike[str], *, max_gap: float | None = None
    ) -> Recording:
        """Read a CSV file with a column ``t``, one per joint, and ``v_`` columns for velocities.

        A header may carry a unit in brackets: ``t [s]``, ``elbow [deg]``, ``v_elbow [rad/s]``; the
        defaults are s, rad and m.

        Parameters
        ----------
        robot :
            The arm.
        path :
            The file.
        max_gap :
            As in `Recording.of`.

        Raises
        ------
        TrajectoryError
            The file cannot be read; a column is unknown or missing; a cell is empty or not a
            number; times do not increase or leave a gap.
        """
        return recording_of(robot, Sheet.read(path), max_gap)

    def warnings(self, names: Sequence[str]) -> Iterator[str]:
        """Yield a warning for each joint whose recorded velocities do not match its positions.

        Parameters
        ----------
        names :
            Joint names.
        """
        if self.v is None:
            return
        moved = np.unwrap(self.q, axis=0) - self.q[0]
        steps = 0.5 * (self.v[1:] + self.v[:-1]) * np.diff(self.t)[:, None]
        off = np.abs(moved[1:] - np.cumsum(steps, axis=0)).max(axis=0)
        size = np.maximum(np.abs(moved).max(axis=0), np.abs(steps).sum(axis=0))
        for i in np.flatnonzero(off > _MISFIT * size + _NOISE).tolist():
            yield (
                f"the recorded velocities of {names[i]} do not match its positions: their integral "
                f"is off by {off[i]:.3g}; check the units"
            )

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.t[-1] - self.t[0])


class Sheet(NamedTuple):
    """A CSV file of numbers.

    Attributes
    ----------
    path :
        The file.
    table :
        The parsed text.
    values :
        The numbers, shape (rows, columns).
    """

    path: str
    table: Table
    values: Matrix

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Sheet:
        """Read a CSV file of numbers.

        Raises
        ------
        TrajectoryError
            The file cannot be read, or a cell is empty or not a number.
        """
        text = read_text(path, TrajectoryError, _KIND, _LARGEST_FILE)
        try:
            table = _table(text)
            values = table.numbers(range(len(table.header)), _LARGEST)
            if not len(values):
                raise InputError(_NO_NUMBERS)
            return cls(printable(path), table, values)
        except InputError as problem:
            raise TrajectoryError(path, printable(problem)) from None

    @property
    def holds_points(self) -> bool:
        """Whether the file is a list of waypoints rather than a joint motion."""
        return sorted(split_unit(cell)[0].lower() for cell in self.table.header) == list("xyz")

    def place(self, row: int) -> str:
        """Return the location of a row in the file, e.g. ``line 2``."""
        line, _ = next(islice(self.table.rows(), row, None))
        return f"line {line}"

    def points(self) -> Matrix:
        """Return the waypoints x, y, z, m, shape (k, 3).

        Raises
        ------
        TrajectoryError
            A column has a unit other than m.
        """
        names = []
        for cell in self.table.header:
            name, unit = split_unit(cell)
            if unit not in {"", "m"}:
                raise TrajectoryError(self.path, f"column {cell!r}: waypoints must be in m")
            names.append(name.lower())
        return self.values[:, [names.index(axis) for axis in "xyz"]]


def _table(text: str) -> Table:
    table = Table.of(text)
    if table is None:
        raise InputError(_NO_NUMBERS)
    if len(table.header) < 2:
        got = shortened(table.header[0])
        raise InputError(
            f"expected the header t,JOINT,… or x,y,z, got {got}; cells are separated by commas"
        )
    return table


def recording_of(robot: Robot, sheet: Sheet, max_gap: float | None = None) -> Recording:
    """Return the recorded motion in a file, see `Recording.read`.

    Parameters
    ----------
    robot :
        The arm.
    sheet :
        The file.
    max_gap :
        As in `Recording.of`.
    """
    try:
        columns = _columns(robot, sheet.table.header)
        t = read_only(sheet.values[:, columns["t"][0]].copy())
        if len(t) < 4:
            raise InputError(f"a recording needs 4 or more samples, got {len(t)}")
        _check_times(t, max_gap, sheet.place)
    except InputError as problem:
        raise TrajectoryError(sheet.path, str(problem)) from None

    def matrix(names: Sequence[str]) -> Matrix:
        numbers, scales = zip(*(columns[name] for name in names), strict=True)
        return read_only(sheet.values[:, numbers] * scales)

    velocities = [f"v_{name}" for name in robot.names]
    v = matrix(velocities) if columns.keys() >= set(velocities) else None
    return Recording(t, matrix(robot.names), v, sheet.path)


def _samples(robot: Robot, x: ArrayLike, name: str, count: int) -> Matrix:
    values = as_floats(x, name)
    if values.shape != (count, robot.n):
        hint = f"one row per time, one column per joint, {robot.numbered()}"
        raise DimensionError(name, (count, robot.n), values.shape, hint)
    check_finite(values, name)
    return read_only(values)


def _columns(robot: Robot, header: tuple[str, ...]) -> dict[str, tuple[int, float]]:
    """Return column number and scale of ``t``, of each joint and of each velocity (``v_``)."""
    positions = {joint.name: POSITION_UNITS[joint.unit] for joint in robot.joints}
    velocities = {
        f"v_{name}": {unit and f"{unit}/s": scale for unit, scale in units.items()}
        for name, units in positions.items()
    }
    units = {**velocities, **positions, "t": {"": 1.0, "s": 1.0}}
    needed = ("t", *robot.names)
    columns = find_columns(header, units, needed)
    if missing := [name for name in needed if name not in columns]:
        raise InputError(
            f"missing columns: {', '.join(missing)}; a recording needs t and every joint: "
            f"{robot.numbered()}"
        )
    if len(needed) < len(columns) < len(units):
        raise InputError(
            "contains velocities of some joints only; give those of all joints or of none"
        )
    return columns


def _check_times(t: Vector, max_gap: float | None, place: Callable[[int], str]) -> None:
    """Check that times increase without a gap.

    Raises
    ------
    InputError
        They do not; the message says where.
    """
    steps = np.diff(t)
    if (steps < _SHORTEST).any():
        i = int((steps < _SHORTEST).argmax())
        what = "appears twice" if steps[i] == 0.0 else f"comes after {t[i]:.12g} s"
        rule = "increase" if steps[i] <= 0.0 else f"increase by {_SHORTEST:g} s or more"
        raise InputError(f"{place(i + 1)}: the time {t[i + 1]:.12g} s {what}; times must {rule}")
    usual = float(np.median(steps))
    if max_gap is not None and not (is_number(max_gap) and max_gap > 0.0):
        raise InputError(f"the longest gap in s must be positive and finite, got {max_gap!r}")
    longest = _GAP * usual if max_gap is None else float(max_gap)
    if steps.max() > longest * (1.0 + 1e-9):
        i = int(steps.argmax())
        raise InputError(
            f"{place(i + 1)}: a gap of {steps[i]:g} s after {t[i]:.12g} s; the median step is "
            f"{usual:g} s, and gaps up to {longest:g} s are interpolated (--max-gap, max_gap)"
        )
