"""Recorded joint motions, from arrays or CSV files.

Files come from many recorders: columns are matched by name, what is not needed is ignored, and
angles that a driver wrapped to ±π are unwrapped. Whatever was decided is said in a note.
"""

from __future__ import annotations

import math
import re
from array import array
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_floats, check_finite, is_number, read_only
from ftforce.errors import DimensionError, InputError, TrajectoryError, listed, printable
from ftforce.io.bag import is_bag, read_motion
from ftforce.io.csv_table import POSITION_UNITS, Table, find_columns, split_unit
from ftforce.io.joint_columns import joint_columns
from ftforce.io.text import read_text, shortened
from ftforce.robot.posture import looks_like_degrees
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from os import PathLike

    from numpy.typing import ArrayLike, NDArray

    from ftforce.robot.robot import Joint, Robot

_LARGEST_FILE = 2_000_000_000  # bytes
_GAP = 10.0  # times the median step; longer gaps are not interpolated
_NO_NUMBERS = "expected a header followed by rows of numbers"
_KIND = "a CSV file of a trajectory (columns t and joint names, or x,y,z)"
_SHORTEST = 1e-6  # s: smaller steps are indistinguishable from rounding error
_LARGEST = 1e12  # largest number accepted in a file; times may be Unix timestamps
_MISFIT = 0.1  # of a joint's travel: tolerated error of its integrated velocity
_SINCE_1970 = 1e8  # s: larger times are counted since then
_SLOWEST = 5.0  # s: longer steps are more likely in another unit
_LARGEST_TIME = 1e19  # nanoseconds since 1970 are 1.8e18
_TIMES = (  # in this order
    *("t", "time", "timestamp", "stamp", "times", "__time", "seconds", "%time"),
    *("elapsed", "elapsed_time"),
)
_WITH_UNIT = re.compile(r"(?P<word>_*[a-z]+(?:_time)?)_(?P<unit>s|ms|us|ns)")
_DATE = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d)[T ](?P<time>\d\d:\d\d:\d\d)([.,](?P<fraction>\d+))?"
    r"\s?(?P<zone>Z|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
_1970 = datetime(1970, 1, 1, tzinfo=UTC)
_PAIRS = (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec"), ("seconds", "nanoseconds"))
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
        cls,
        robot: Robot,
        path: str | PathLike[str],
        *,
        max_gap: float | None = None,
        topic: str | None = None,
    ) -> Recording:
        """Read a bag of ROS, or a CSV file with a column of times and one per joint.

        A header of CSV may carry a unit in brackets: ``t [s]``, ``elbow [deg]``,
        ``v_elbow [rad/s]``; the defaults are s, rad and m. The times are called ``t``, ``time``,
        ``timestamp``, ``stamp`` or ``__time``; without a unit, counts since 1970 in ns, us or ms
        are recognised, and dates of ISO 8601. A sample that repeats the time and positions of the
        one before is left out. Velocities are columns ``v_…``. Other names of joint columns are
        those of ``ftforce.io.joint_columns``; columns may have any order, and others are ignored.

        Parameters
        ----------
        robot :
            The arm.
        path :
            The file: CSV, or a bag (``.mcap``, ``.db3``, ``.bag``, or the folder of a bag).
        max_gap :
            As in `Recording.of`.
        topic :
            Topic of the bag; by default the only one that has the joints.

        Raises
        ------
        TrajectoryError
            The file cannot be read; a column is missing; a cell is empty or not a number; times do
            not increase, are repeated with other positions, or leave a gap; an angle jumps by a
            turn that its limits do not allow.
        """
        if is_bag(path):
            return _from_bag(robot, path, max_gap, topic)
        if topic is not None:
            raise TrajectoryError(path, f"is not a bag, so it has no topic {topic!r}")
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

    def numbers(self, columns: Sequence[int], largest: float = _LARGEST) -> Matrix:
        """Return columns as numbers, shape (rows, columns).

        Parameters
        ----------
        columns :
            Indices of the columns, from 0.
        largest :
            Largest absolute value accepted.

        Raises
        ------
        InputError
            There are no rows, or a cell is empty or not a number.
        """
        values = self.table.numbers(columns, largest)
        if not len(values):
            raise InputError(_NO_NUMBERS)
        return values

    def dates(self, columns: Sequence[int]) -> Vector | None:
        """Return the times in a column of dates, s from the first; ``None`` if it holds numbers.

        Parameters
        ----------
        columns :
            Index of the column, from 0; several are numbers.

        Raises
        ------
        InputError
            The first cell is a date, such as ``2026-11-01T12:00:00.5Z``, and another is not.
        """
        first = next(self.table.rows(), None)
        if first is None or len(columns) != 1 or _nanoseconds(first[1][columns[0]]) is None:
            return None
        found = array("q")
        for line, cells in self.table.rows():
            cell = cells[columns[0]]
            if (instant := _nanoseconds(cell)) is None:
                where = f"line {line}, {shortened(self.table.header[columns[0]])}"
                raise InputError(f"{where}: {shortened(cell)} is no date and time as above")
            found.append(instant)
        since = np.array(found) - found[0]
        return 1e-9 * since.astype(np.float64)

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


def _nanoseconds(cell: str) -> int | None:
    """Return the time since 1970 of a date and time of ISO 8601, ns; UTC if it has no zone."""
    if (found := _DATE.fullmatch(cell.strip())) is None:
        return None
    zone = found["zone"] or "Z"
    try:
        since = datetime.fromisoformat(f"{found['date']}T{found['time']}{zone}") - _1970
    except (ValueError, OverflowError):  # such as a month 13
        return None
    fraction = int((found["fraction"] or "")[:9].ljust(9, "0"))
    return (since.days * 86_400 + since.seconds) * 1_000_000_000 + fraction


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
        times, columns, notes = _columns(robot, sheet)
        t, values, said = _values(sheet, times, columns)
        kept, repeated = _distinct(robot, t, values[:, : robot.n], sheet.place)
        t, values = t[kept], values[kept]

        def place(row: int) -> str:
            return sheet.place(int(kept[row]))

        if len(t) < 4:
            raise InputError(f"a recording needs 4 or more samples, got {len(t)}")
        _check_times(read_only(t), max_gap, place)
        step = float(np.median(np.diff(t)))
        if (np.diff(t) == 1.0).all() or (not times.has_unit and step >= _SLOWEST):
            how = "one by one" if step == 1.0 else f"by {step:g}"
            said = (*said, f"the times count seconds {how}; for others, write t [ms] or [us]")
        q = read_only(values[:, : robot.n].copy())
        q, unwrapped = _unwrapped(robot, t, q, place)
    except InputError as problem:
        raise TrajectoryError(sheet.path, printable(problem)) from None
    v = read_only(values[:, robot.n :].copy()) if len(columns) > robot.n else None
    return Recording(t, q, v, sheet.path, (*notes, *said, *repeated, *unwrapped))


def _values(
    sheet: Sheet, times: _Times, columns: Mapping[str, tuple[int, float]]
) -> tuple[Vector, Matrix, tuple[str, ...]]:
    """Return the times, s, the columns of the joints, in rad or m, and notes."""
    numbers, scales = zip(*columns.values(), strict=True)
    if (dates := sheet.dates(times.columns)) is not None:
        return dates, sheet.numbers(numbers) * scales, ()
    k = len(times.columns)
    values = sheet.numbers((*times.columns, *numbers), _LARGEST_TIME)
    if np.abs(values[:, k:]).max() > _LARGEST:
        sheet.numbers(numbers)  # which says where
    if times.scales != (1.0,) and abs(values[0, 0] * times.scales[0]) > _SINCE_1970:
        values[:, :k] -= values[0, :k]  # first, which loses no digits
    values *= (*times.scales, *scales)
    t = values[:, :k].sum(axis=1)
    unit = ""
    if not times.has_unit:
        t, unit = _in_seconds(t)
    said = (f"the times have no unit and are taken for {unit}",) * bool(unit)
    return t, values[:, k:], said


def _distinct(
    robot: Robot, t: Vector, q: Matrix, place: Callable[[int], str]
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Return the rows without those that repeat the one before, time and positions, and a note.

    Raises
    ------
    InputError
        A time is repeated with different positions: which of them are right, is not known.
    """
    again = np.diff(t) == 0.0
    same = again & (q[1:] == q[:-1]).all(axis=1)
    if (again & ~same).any():
        i = int((again & ~same).argmax())
        k = int((q[i + 1] != q[i]).argmax())
        raise InputError(
            f"{place(i + 1)}: the time {t[i + 1]:.12g} s appears twice; times must increase, and "
            f"these positions differ ({robot.names[k]}: {q[i, k]:.6g} and {q[i + 1, k]:.6g})"
        )
    kept = np.flatnonzero(np.concatenate([[True], ~same]))
    if not same.any():
        return kept, ()
    first, count = place(int(same.argmax()) + 1), int(same.sum())
    what = "one sample that repeats" if count == 1 else f"{count:,} samples that repeat"
    return kept, (f"{what} time and positions of the one before (first at {first}) left out",)


def _from_bag(
    robot: Robot, path: str | PathLike[str], max_gap: float | None, topic: str | None
) -> Recording:
    """Return the recorded motion in a bag, see `Recording.read`."""
    try:
        motion = read_motion(path, robot.names, topic)
        kept, repeated = _distinct(robot, motion.t, motion.q, _sample)
        t, q = motion.t[kept], motion.q[kept]

        def place(row: int) -> str:
            return _sample(int(kept[row]))

        if len(t) < 4:
            raise InputError(f"a recording needs 4 or more samples, got {len(t)}")
        _check_times(t, max_gap, place)
        q, unwrapped = _unwrapped(robot, t, read_only(q), place)
    except InputError as problem:
        raise TrajectoryError(path, printable(problem)) from None
    v = None if motion.v is None else read_only(motion.v[kept])
    notes = (*motion.notes, *repeated, *unwrapped)
    return Recording(read_only(t), q, v, printable(path), notes)


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
    robot: Robot, sheet: Sheet
) -> tuple[_Times, dict[str, tuple[int, float]], tuple[str, ...]]:
    """Return the columns of the times, those of the joints with their scales, and notes."""
    given = sheet.table.header
    header, notes = joint_columns(given, robot.names, sheet.table.same_texts)
    positions = {joint.name: POSITION_UNITS[joint.unit] for joint in robot.joints}
    velocities = {
        f"v_{name}": {unit and f"{unit}/s": scale for unit, scale in units.items()}
        for name, units in positions.items()
    }
    units = {**positions, **velocities}
    times, found = _time_columns(header, units), find_columns(header, units)
    missing = [name for name in robot.names if name not in found]
    if times is None or missing:
        raise InputError(
            f"missing columns: {', '.join(['t'] * (times is None) + missing)}; a recording needs t "
            f"and every joint: {robot.numbered()}; the columns are: {listed(map(shortened, given))}"
        )
    if robot.n < len(found) < len(units):
        raise InputError(
            "contains velocities of some joints only; give those of all joints or of none"
        )
    said = [f"the times are column {shortened(times.name)}"] * (times.name != "t")
    numbers = {*times.columns, *(number for number, _ in found.values())}
    said += ["decimals are separated by commas"] * sheet.table.has_commas
    rest = [shortened(cell) for i, cell in enumerate(given) if i not in numbers]
    if rest:
        said.append(f"columns that are no times or joints are ignored: {listed(rest)}")
    ordered = {name: found[name] for name in units if name in found}
    said = [*said[:-1], *notes, *said[-1:]] if rest else [*said, *notes]
    return times, ordered, ("; ".join(said),) if said else ()


class _Times(NamedTuple):
    """The columns of the times, one or seconds and nanoseconds, and their factors."""

    columns: tuple[int, ...]
    scales: tuple[float, ...]
    name: str
    has_unit: bool


def _time_columns(header: tuple[str, ...], joints: Mapping[str, object]) -> _Times | None:
    """Return the columns of the times; ``None`` if there are none.

    Raises
    ------
    InputError
        The unit is unknown, or a column appears twice.
    """
    candidates: dict[str, list[tuple[int, str, str]]] = {}
    for i, cell in enumerate(header):
        name, unit = split_unit(cell)
        if cell in joints or name in joints:
            continue
        word = re.split(r"[/.]", name.partition("(")[0].rstrip())[-1].lower()  # time (receive)
        if found := _WITH_UNIT.fullmatch(word):
            word, unit = found["word"], unit or found["unit"]
        candidates.setdefault(word, []).append((i, name, unit))
    for word in _TIMES:
        if not (given := candidates.get(word)):
            continue
        if len(given) > 1:
            raise InputError(f"column {given[0][1]!r} appears twice")
        i, name, unit = given[0]
        if unit not in _TIME_UNITS:
            known = " or ".join(filter(None, _TIME_UNITS))
            raise InputError(f"column {header[i]!r}: unknown unit; use {known}")
        return _Times((i,), (_TIME_UNITS[unit],), name, bool(unit))
    for whole, part in _PAIRS:
        seconds, rest = candidates.get(whole, ()), candidates.get(part, ())
        if len(seconds) == len(rest) == 1:
            columns = (seconds[0][0], rest[0][0])
            return _Times(columns, (1.0, 1e-9), f"{seconds[0][1]} and {rest[0][1]}", True)
    return None


def _in_seconds(t: Vector) -> tuple[Vector, str]:
    """Return times without a unit in s, and what they were taken for; empty for s.

    Counts of nanoseconds, microseconds or milliseconds since 1970 are told by their size, others by
    whole steps that no recorder of joints makes in seconds.
    """
    size, steps = float(np.median(np.abs(t))), np.diff(t)
    usual = float(np.median(np.abs(steps))) if len(steps) else 0.0
    is_whole = bool((t == np.floor(t)).all())
    for unit, since_1970, step in (("ns", 1e17, 1e5), ("us", 1e14, 1e3), ("ms", 1e11, math.inf)):
        if size > since_1970 or (is_whole and usual >= step):
            start = t[0] if size > since_1970 else 0.0
            return (t - start) * _TIME_UNITS[unit], unit
    return t, ""


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
