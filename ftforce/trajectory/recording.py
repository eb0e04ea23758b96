"""Recorded joint motions, from arrays or CSV files.

Files come from many recorders: columns are matched by name, what is not needed is ignored, and
angles that a driver wrapped to ±π are unwrapped. Whatever was decided is said in a note.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_floats, check_finite, is_number, read_only
from ftforce.errors import DimensionError, InputError, TrajectoryError, listed, printable
from ftforce.io.csv_table import POSITION_UNITS, Table, find_columns, split_unit
from ftforce.io.text import read_text, shortened
from ftforce.robot.posture import looks_like_degrees
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from os import PathLike

    from numpy.typing import ArrayLike

    from ftforce.robot.robot import Joint, Robot

_LARGEST_FILE = 2_000_000_000  # bytes
_GAP = 10.0  # times the median step; longer gaps are not interpolated
_NO_NUMBERS = "expected a header followed by rows of numbers"
_KIND = "a CSV file of a trajectory (columns t and joint names, or x,y,z)"
_SHORTEST = 1e-6  # s: smaller steps are indistinguishable from rounding error
_LARGEST = 1e12  # largest number accepted in a file; times may be Unix timestamps
_MISFIT = 0.1  # of a joint's travel: tolerated error of its integrated velocity
_TIMES = ("t", "time", "timestamp", "stamp", "times", "time_s", "seconds", "%time")  # in this order
_POSITIONS = frozenset({"q", "j", "joint", "pos", "position", "positions", "angle", "theta"})
_WISHES = frozenset(
    {"target", "desired", "commanded", "command", "cmd", "goal", "ref", "reference"}
)
_TIME_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_FASTER = 1.5  # times the velocity limit: faster than that, an angle has been wrapped
_SLACK = 1e-6  # rad: limits are often rounded
_NOISE = 1e-3  # rad or m: added to it, for encoder noise of joints at rest


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Joint positions over time.

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
    notes :
        What was decided while reading it: columns that were ignored, angles that were unwrapped.
    """

    t: Vector
    q: Matrix
    v: Matrix | None = None
    source: str = "given"
    notes: tuple[str, ...] = ()

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
            Shapes do not match, times do not increase, there is a gap, or an angle jumps by a turn
            and leaves its limits when it is unwrapped.
        """
        require_robot(robot)
        times = as_floats(t, "t")
        if times.ndim != 1 or len(times) < 4:
            raise InputError(
                f"a recording needs 4 or more times, got an array of shape {times.shape}"
            )
        check_finite(times, "t")
        _check_times(times, max_gap, _sample)
        positions = _samples(robot, q, "q", len(times))
        velocities = None if v is None else _samples(robot, v, "v", len(times))
        positions, notes = _unwrapped(robot, times, positions, _sample)
        return cls(read_only(times), positions, velocities, source, notes)

    @classmethod
    def read(
        cls, robot: Robot, path: str | PathLike[str], *, max_gap: float | None = None
    ) -> Recording:
        """Read a CSV file with a column of times, one per joint, and ``v_`` columns for velocities.

        A header may carry a unit in brackets: ``t [s]``, ``elbow [deg]``, ``v_elbow [rad/s]``; the
        defaults are s, rad and m. The times are called ``t``, ``time``, ``timestamp`` or ``stamp``.
        Columns may have any order, and others are ignored. Where none has the name of a joint,
        numbered positions (``q1`` …, ``actual_q_0`` …) are taken in the order of the joints.

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
            The file cannot be read; a column is missing; a cell is empty or not a number; times do
            not increase or leave a gap; an angle jumps by a turn that its limits do not allow.
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
        Its header and the text below.
    """

    path: str
    table: Table

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Sheet:
        """Read a CSV file.

        Parameters
        ----------
        path :
            The file.

        Raises
        ------
        TrajectoryError
            The file cannot be read or has no header.
        """
        text = read_text(path, TrajectoryError, _KIND, _LARGEST_FILE)
        try:
            return cls(printable(path), _table(text))
        except InputError as problem:
            raise TrajectoryError(path, printable(problem)) from None

    @property
    def holds_points(self) -> bool:
        """Whether the file is a list of waypoints rather than a joint motion."""
        return sorted(split_unit(cell)[0].lower() for cell in self.table.header) == list("xyz")

    def numbers(self, columns: Sequence[int]) -> Matrix:
        """Return columns as numbers, shape (rows, columns).

        Parameters
        ----------
        columns :
            Names of the columns.

        Raises
        ------
        InputError
            There are no rows, or a cell is empty or not a number.
        """
        values = self.table.numbers(columns, _LARGEST)
        if not len(values):
            raise InputError(_NO_NUMBERS)
        return values

    def place(self, row: int) -> str:
        """Return the location of a row in the file, e.g. ``line 2``.

        Parameters
        ----------
        row :
            Index of the row, from 0.
        """
        line, _ = next(islice(self.table.rows(), row, None))
        return f"line {line}"

    def points(self) -> Matrix:
        """Return the waypoints x, y, z, m, shape (k, 3).

        Raises
        ------
        TrajectoryError
            A column has a unit other than m, or a cell is empty or not a number.
        """
        names = []
        for cell in self.table.header:
            name, unit = split_unit(cell)
            if unit not in {"", "m"}:
                raise TrajectoryError(self.path, f"column {cell!r}: waypoints must be in m")
            names.append(name.lower())
        try:
            return self.numbers([names.index(axis) for axis in "xyz"])
        except InputError as problem:
            raise TrajectoryError(self.path, printable(problem)) from None


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
        columns, notes = _columns(robot, sheet.table.header)
        numbers, scales = zip(*columns.values(), strict=True)
        values = sheet.numbers(numbers)
        values *= scales
        t = read_only(values[:, 0].copy())
        if len(t) < 4:
            raise InputError(f"a recording needs 4 or more samples, got {len(t)}")
        _check_times(t, max_gap, sheet.place)
        if (np.diff(t) == 1.0).all():
            notes = (*notes, "the times count seconds one by one; for others, write t [ms] or [us]")
        q = read_only(values[:, 1 : 1 + robot.n].copy())
        q, unwrapped = _unwrapped(robot, t, q, sheet.place)
    except InputError as problem:
        raise TrajectoryError(sheet.path, printable(problem)) from None
    v = read_only(values[:, 1 + robot.n :].copy()) if len(numbers) > 1 + robot.n else None
    return Recording(t, q, v, sheet.path, (*notes, *unwrapped))


def _sample(row: int) -> str:
    return f"sample {row + 1}"


def _samples(robot: Robot, x: ArrayLike, name: str, count: int) -> Matrix:
    values = as_floats(x, name)
    if values.shape != (count, robot.n):
        hint = f"one row per time, one column per joint, {robot.numbered()}"
        raise DimensionError(name, (count, robot.n), values.shape, hint)
    check_finite(values, name)
    return read_only(values)


def _columns(
    robot: Robot, header: tuple[str, ...]
) -> tuple[dict[str, tuple[int, float]], tuple[str, ...]]:
    """Return column number and scale of the time, each joint and each velocity, and a note."""
    given, header = header, _named_by_number(robot, header)
    positions = {joint.name: POSITION_UNITS[joint.unit] for joint in robot.joints}
    velocities = {
        f"v_{name}": {unit and f"{unit}/s": scale for unit, scale in units.items()}
        for name, units in positions.items()
    }
    time = _time_column(header, {**positions, **velocities})
    units = {time: _TIME_UNITS, **positions, **velocities}
    found = find_columns(header, units)
    if missing := [name for name in (time, *robot.names) if name not in found]:
        raise InputError(
            f"missing columns: {', '.join(missing)}; a recording needs t and every joint: "
            f"{robot.numbered()}; the columns are: {listed(map(shortened, given))}"
        )
    if 1 + robot.n < len(found) < len(units):
        raise InputError(
            "contains velocities of some joints only; give those of all joints or of none"
        )
    notes = [f"the times are column {shortened(time)}"] * (time != "t")
    if given != header:
        ends = (shortened(given[found[robot.names[i]][0]]) for i in (0, -1))
        taken = f"columns {' to '.join(ends)} are taken for the joints 1 to {robot.n}"
        notes.append(f"{taken}, as no column has the name of a joint")
    numbers = {number for number, _ in found.values()}
    rest = [shortened(cell) for i, cell in enumerate(header) if i not in numbers]
    if rest:
        notes.append(f"columns that are no times or joints are ignored: {listed(rest)}")
    ordered = {name: found[name] for name in units if name in found}
    return ordered, ("; ".join(notes),) if notes else ()


def _named_by_number(robot: Robot, header: tuple[str, ...]) -> tuple[str, ...]:
    """Return the header with names of joints in place of numbers, if it has none of their names.

    Measured positions that are numbered from 0 or 1, such as ``actual_q_0`` or ``q1``, are those of
    the joints in their order, if there is one such group of columns and it has all numbers.
    """
    names = [split_unit(cell) for cell in header]
    if any(
        cell in robot.names or name in robot.names
        for cell, (name, _) in zip(header, names, strict=True)
    ):
        return header
    groups: dict[str, dict[int, int]] = {}
    for i, (name, _) in enumerate(names):
        stem = name.rstrip("0123456789")
        number = name[len(stem) :]
        words = re.findall("[a-z]+", stem.lower())
        if number and words and words[-1] in _POSITIONS and _WISHES.isdisjoint(words):
            groups.setdefault(stem, {})[int(number)] = i
    fitting = [
        [group[number] for number in sorted(group)]
        for group in groups.values()
        if sorted(group) in (list(range(robot.n)), list(range(1, robot.n + 1)))
    ]
    if len(fitting) != 1:
        return header
    found = list(header)
    for joint, i in zip(robot.names, fitting[0], strict=True):
        found[i] = f"{joint} [{names[i][1]}]" if names[i][1] else joint
    return tuple(found)


def _time_column(header: tuple[str, ...], joints: Mapping[str, object]) -> str:
    """Return the name of the column of times, ``t`` if there is none."""
    names = [split_unit(cell)[0] for cell in header if cell not in joints]
    for word in _TIMES:
        for name in names:
            if name not in joints and name.lower() == word:
                return name
    return "t"


def _unwrapped(
    robot: Robot, t: Vector, q: Matrix, place: Callable[[int], str]
) -> tuple[Matrix, tuple[str, ...]]:
    """Return positions with the angles of revolute joints unwrapped, and a note.

    A step of more than half a turn, faster than the joint turns, is one that a driver made by
    wrapping its angle. Continuous joints are unwrapped where the motion is made.

    Raises
    ------
    InputError
        An unwrapped angle leaves its limits; the message says where it jumps.
    """
    if looks_like_degrees(robot, q):
        return q, ()  # a warning says so
    found, words = {}, []
    for i in np.flatnonzero(np.ptp(q, axis=0) > np.pi).tolist():
        joint, jumps = robot.joints[i], np.abs(np.diff(q[:, i]))
        jumps[jumps <= (joint.velocity or 0.0) * _FASTER * np.diff(t)] = 0.0
        rows = np.flatnonzero(jumps > np.pi).tolist() if joint.type == "revolute" else []
        if not rows:
            continue
        unwrapped = _inside(joint, np.unwrap(q[:, i]))
        where = place(rows[0] + 1)
        if unwrapped is None:
            before, after = q[rows[0] : rows[0] + 2, i].tolist()
            raise InputError(
                f"{where}: {joint.name} jumps from {before:.4g} to {after:.4g} rad, faster than it "
                f"turns; as a wrapped angle it would leave its limits, {joint.lower:g} to "
                f"{joint.upper:g} rad"
            )
        found[i] = unwrapped
        times = "" if len(rows) == 1 else f"{len(rows)} times, first "
        words.append(f"{joint.name} ({times}at {where})")
    if not words:
        return q, ()
    q = q.copy()
    for i, unwrapped in found.items():
        q[:, i] = unwrapped
    return read_only(q), (f"angles that jump by a turn were unwrapped: {', '.join(words)}",)


def _inside(joint: Joint, x: Vector) -> Vector | None:
    """Return an angle, plus whole turns if need be, within its limits; ``None`` if none are."""
    middle = 0.5 * (joint.lower + joint.upper) - 0.5 * float(x.min() + x.max())
    for turns in (0.0, 2.0 * np.pi * round(middle / (2.0 * np.pi))):
        low, high = x.min() + turns, x.max() + turns
        if joint.lower - _SLACK <= low and high <= joint.upper + _SLACK:
            return x + turns
    return None


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
