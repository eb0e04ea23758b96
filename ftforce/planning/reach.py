"""The failure-tolerant workspace: where the tip still gets to, whichever joint locks anywhere.

A tip point counts if the arm reaches it within its limits and, for every joint and every position
within its limits at which it may lock, the other joints still reach it. Two bounds are given: cells
of which every point is shown to count, and cells that are not shown to hold no such point. Between
them lies an estimate: the cells whose middles are shown to count.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.analysis.question import check_progress
from ftforce.core.arrays import is_number, read_only
from ftforce.core.display import Displayed
from ftforce.core.faults import FaultMode
from ftforce.errors import InputError, check_word
from ftforce.planning.joint_ranges import JointRanges
from ftforce.planning.reachable import Reachable
from ftforce.planning.tip_point import TipPoint
from ftforce.planning.unreachable import Unreachable
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.question import Progress
    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.task import Task
    from ftforce.planning.joint_ranges import RangesLike
    from ftforce.robot.robot import Robot

LOST, UNDECIDED, KEPT = 0, 1, 2
"""States of a cell: shown not to belong, neither, shown to belong."""

_PLANE_CELLS, _SPACE_CELLS = 96, 24  # along the reach
_MOST_CELLS = 4_000_000
_POSITIONS = 9  # at which a joint is locked to show that cells do not belong
_LEVELS = 3  # of blocks; the largest are 2**3 cells wide
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class FailureTolerantWorkspace(Displayed):
    """Bounds on the failure-tolerant workspace, made by `ftforce.reach`.

    Attributes
    ----------
    robot :
        The arm.
    rows :
        Coordinates of the root's axes that the cells have: (0, 1, 2), or two for a planar arm.
    ranges :
        Limits in force: the arm's own, the given or the softened ones.
    release :
        Whether the arm's own limits hold after the fault.
    softened :
        Whether the limits were chosen by ftforce.
    around :
        Box that the limits were chosen for, lower and upper ends, m, shape (2, m).
    origin, edge :
        Corner of the first cell, m, shape (m,), and edge of the cells, m.
    healthy :
        States of the cells for the healthy arm, one axis per coordinate: 2 if every point is shown
        to be reached, 0 if none is, 1 otherwise.
    tolerated :
        The same for the failure-tolerant workspace.
    healthy_middles, tolerated_middles :
        Whether the middle of each cell is shown to be reached by the healthy arm, and whichever
        joint locks; an axis per coordinate.
    lost_by :
        Volume of the cells that the healthy arm may reach and that are shown to be lost to a lock
        of each joint, m³ or m², shape (n,).
    moving :
        Number of joints, from the base, that move the tip point at all.
    is_whole :
        Whether the search was finished; the bounds hold if it was not.
    """

    robot: Robot
    rows: tuple[int, ...]
    ranges: JointRanges
    release: bool
    softened: bool
    around: Matrix | None
    origin: Vector
    edge: float
    healthy: NDArray[np.int8]
    tolerated: NDArray[np.int8]
    healthy_middles: NDArray[np.bool_]
    tolerated_middles: NDArray[np.bool_]
    lost_by: Vector
    moving: int
    is_whole: bool

    @property
    def m(self) -> int:
        """Number of coordinates."""
        return len(self.rows)

    @property
    def unit(self) -> str:
        """Unit of the volumes: m³, or m² for a planar arm."""
        return "m³" if self.m == 3 else "m²"

    @property
    def task(self) -> str:
        """The task: ``force``, or two components."""
        return "force" if self.m == 3 else ",".join(f"f{'xyz'[i]}" for i in self.rows)

    @property
    def inner(self) -> float:
        """Volume shown to tolerate a lock of any joint, m³ or m²."""
        return self._volume(self.tolerated == KEPT)

    @property
    def outer(self) -> float:
        """Volume not shown to be without such points, m³ or m²."""
        return self._volume(self.tolerated != LOST)

    @property
    def healthy_inner(self) -> float:
        """Volume shown to be reached by the healthy arm within the limits, m³ or m²."""
        return self._volume(self.healthy == KEPT)

    @property
    def healthy_outer(self) -> float:
        """Volume not shown to be beyond its reach, m³ or m²."""
        return self._volume(self.healthy != LOST)

    @property
    def proved(self) -> Mask:
        """Whether every point of each cell is shown to tolerate a lock of any joint."""
        proved: Mask = self.tolerated == KEPT
        return proved

    @property
    def estimate(self) -> float:
        """Volume of the cells whose middles tolerate a lock of any joint, m³ or m²."""
        return self._volume(self.tolerated_middles)

    @property
    def healthy_estimate(self) -> float:
        """Volume of the cells whose middles the healthy arm reaches, m³ or m²."""
        return self._volume(self.healthy_middles)

    @property
    def share(self) -> float:
        """Share of the healthy reach that tolerates a lock of any joint, of the estimates."""
        return self.estimate / self.healthy_estimate if self.healthy_estimate else math.nan

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the bounds."""
        found = ["collisions are not checked, neither of the arm with itself nor with anything"]
        if not self.is_whole:
            found.append("interrupted: both bounds hold, but a finished search is tighter")
        return tuple(found)

    def places(self, chosen: Mask) -> Matrix:
        """Return the middles of cells in root axes, m, shape (k, m).

        Parameters
        ----------
        chosen :
            Which cells, of the shape of ``tolerated``.
        """
        places: Matrix = self.origin + (np.argwhere(chosen) + 0.5) * self.edge
        return places

    def state_at(self, point: ArrayLike) -> int:
        """Return the state of the cell that holds a point: 2, 1 or 0 as in ``tolerated``.

        Parameters
        ----------
        point :
            The point in root axes, m, shape (m,).
        """
        place = np.asarray(point, dtype=np.float64)
        if place.shape != (self.m,) or not np.isfinite(place).all():
            raise InputError(f"a point has {self.m} finite coordinates, m, got {point!r}")
        cell = np.floor((place - self.origin) / self.edge).astype(int)
        if (cell < 0).any() or (cell >= self.tolerated.shape).any():
            return LOST
        return int(self.tolerated[tuple(cell)])

    def _volume(self, chosen: Mask) -> float:
        return float(np.count_nonzero(chosen) * self.edge**self.m)


def reach(
    robot: Robot,
    *,
    faults: int = 1,
    mode: str = "locked",
    task: str | Iterable[str] | Task | None = None,
    within: RangesLike = None,
    release: bool = False,
    soften: bool = False,
    around: ArrayLike | None = None,
    cell: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> FailureTolerantWorkspace:
    """Return bounds on the failure-tolerant workspace of an arm.

    Parameters
    ----------
    robot :
        The arm.
    faults :
        Number of joints that lock: 1.
    mode :
        How joints fail: ``locked``.
    task :
        ``force`` for points in space, or the two components of a planar arm, such as ``fx,fy``. By
        default what suits the arm.
    within :
        Artificial limits before the fault, at most the arm's own: a TOML or YAML file, or lower and
        upper limits, rad or m, by joint or of shape (n, 2). By default the arm's own.
    release :
        Whether the arm's own limits hold after the fault, instead of the artificial ones.
    soften :
        Whether to choose artificial limits that make the tolerated region large, within those of
        ``within``.
    around :
        Box that the softened limits are to tolerate first, lower and upper corner, m, shape (2, m).
    cell :
        Edge of the cells, m. By default a 96th of the reach's width in the plane, a 24th in space.
    seed :
        Seed of the postures from which searches start.
    progress :
        Called with the steps done and their total.

    Raises
    ------
    InputError
        An argument does not suit the arm.
    LimitsError
        The file of limits cannot be read or does not fit the arm.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("dh5")
    >>> found = ftforce.reach(arm, cell=0.25)
    >>> found.inner <= found.estimate <= found.outer <= found.healthy_outer
    True
    """
    search = Search.of(
        robot, faults=faults, mode=mode, task=task, within=within, release=release, soften=soften,
        around=around, cell=cell, seed=seed,
    )  # fmt: skip
    search.run(progress)
    return search.result()


@dataclass(eq=False)
class Search:
    """A search for the bounds, which can be interrupted: what is found so far holds.

    Attributes
    ----------
    tip, ranges, release, seed :
        The tip point, the limits, whether they are released, and the seed of the searches.
    origin, edge, shape :
        Corner of the first cell, edge, and numbers of cells.
    healthy, tolerated, healthy_middles, tolerated_middles, lost_by, is_whole :
        As of `FailureTolerantWorkspace`.
    """

    tip: TipPoint
    ranges: JointRanges
    release: bool
    seed: int
    origin: Vector
    edge: float
    shape: tuple[int, ...]
    healthy: NDArray[np.int8]
    tolerated: NDArray[np.int8]
    healthy_middles: NDArray[np.bool_]
    tolerated_middles: NDArray[np.bool_]
    lost_by: Vector
    is_whole: bool = False
    softened: bool = False
    around: Matrix | None = None
    _done: int = field(default=0, init=False)

    @classmethod
    def of(
        cls,
        robot: Robot,
        *,
        faults: int = 1,
        mode: str = "locked",
        task: str | Iterable[str] | Task | None = None,
        within: RangesLike = None,
        release: bool = False,
        soften: bool = False,
        around: ArrayLike | None = None,
        cell: float | None = None,
        seed: int = 0,
    ) -> Search:
        """Return a search that has not begun.

        Parameters
        ----------
        robot, faults, mode, task, within, release, soften, around, cell, seed :
            As in `ftforce.reach`.

        Raises
        ------
        InputError
            As in `ftforce.reach`.
        LimitsError
            As in `ftforce.reach`.
        """
        require_robot(robot)
        if faults != 1 or isinstance(faults, bool):
            raise InputError(
                f"the failure-tolerant workspace is of single faults: faults = 1, got {faults!r}"
            )
        check_word("mode", mode, (FaultMode.LOCKED.value,))
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            raise InputError(f"the seed is a whole number of at least 0, got {seed!r}")
        tip = TipPoint.of(robot, task)
        ranges = JointRanges.of(robot, within)
        for name, value in (("release", release), ("soften", soften)):
            if not isinstance(value, bool):
                raise InputError(f"{name} is True or False, got {value!r}")
        if around is not None and not soften:
            raise InputError("around is the box for which limits are softened: ask for soften")
        origin, edge, shape = _cells(tip, cell)
        return cls(
            tip=tip,
            ranges=ranges,
            release=release,
            seed=seed,
            origin=origin,
            edge=edge,
            shape=shape,
            healthy=np.full(shape, UNDECIDED, dtype=np.int8),
            tolerated=np.full(shape, UNDECIDED, dtype=np.int8),
            healthy_middles=np.zeros(shape, dtype=np.bool_),
            tolerated_middles=np.zeros(shape, dtype=np.bool_),
            lost_by=np.zeros(robot.n),
            softened=soften,
            around=None if around is None else _box(tip, around),
        )

    def run(self, progress: Progress | None = None) -> None:
        """Search for both bounds.

        Parameters
        ----------
        progress :
            As in `ftforce.reach`.
        """
        check_progress(progress)
        moving = self.tip.moving
        steps = 1 + moving * _POSITIONS + (2 * _LEVELS + 3) * (moving + 1)
        self._done = 0
        if self.softened:
            self.soften(progress)

        def tick() -> None:
            self._done += 1
            if progress is not None:
                progress(min(self._done, steps), steps)

        self._exclude(tick)
        self._prove(tick)
        self.is_whole = True
        if progress is not None:
            progress(steps, steps)

    def result(self) -> FailureTolerantWorkspace:
        """Return the bounds found so far."""
        return FailureTolerantWorkspace(
            robot=self.tip.robot,
            rows=self.tip.rows,
            ranges=self.ranges,
            release=self.release,
            softened=self.softened,
            around=self.around,
            origin=read_only(self.origin),
            edge=self.edge,
            healthy=_frozen(self.healthy),
            tolerated=_frozen(self.tolerated),
            healthy_middles=_frozen(self.healthy_middles),
            tolerated_middles=_frozen(self.tolerated_middles),
            lost_by=read_only(self.lost_by.copy()),
            moving=self.tip.moving,
            is_whole=self.is_whole,
        )

    @property
    def after(self) -> JointRanges:
        """Limits that hold after the fault."""
        return self.ranges.own() if self.release else self.ranges

    def soften(self, progress: Progress | None = None) -> None:
        """Choose limits before the search.

        Parameters
        ----------
        progress :
            As in `ftforce.reach`.
        """
        from ftforce.planning.soften import softened

        def tick(done: int, total: int) -> None:
            if progress is not None:
                progress(done, total)

        self.ranges = softened(
            self.tip, self.ranges, release=self.release, around=self.around, seed=self.seed,
            tick=tick,
        )  # fmt: skip

    # ---- outer bound -------------------------------------------------------------------------

    def _exclude(self, tick: Callable[[], None]) -> None:
        """Show that cells do not belong: the whole of each is out of reach."""
        before = Unreachable(self.tip, self.ranges.swept, self.edge)
        behind = before.fields()
        half = 0.5 * self.edge * math.sqrt(self.tip.m)  # of a cell's diagonal
        beyond = np.flatnonzero(before.healthy(behind, self._places()) > half**2)
        self.healthy.flat[beyond] = LOST
        self.tolerated.flat[beyond] = LOST
        tick()
        if self.release:
            before = Unreachable(self.tip, self.after.swept, self.edge)
            behind = before.fields()
        may = np.flatnonzero(self.healthy != LOST)
        places = self._places()[may]
        for joint in range(self.tip.moving):
            lost = np.zeros(len(may), dtype=bool)
            for position in self._positions(joint):
                rest = np.flatnonzero(~lost)
                square = before.locked(behind, joint, position, places[rest])
                lost[rest] = square > half**2
                tick()
            self.tolerated.flat[may[lost]] = LOST
            self.lost_by[joint] = np.count_nonzero(lost) * self.edge**self.tip.m

    def _positions(self, joint: int) -> list[float]:
        low, high = self.ranges.swept[joint].tolist()
        return [low] if high == low else np.linspace(low, high, _POSITIONS).tolist()

    def _places(self) -> Matrix:
        lines = [
            start + (np.arange(count) + 0.5) * self.edge
            for start, count in zip(self.origin.tolist(), self.shape, strict=True)
        ]
        return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, self.tip.m)

    # ---- inner bound -------------------------------------------------------------------------

    def _prove(self, tick: Callable[[], None]) -> None:
        """Show that cells belong, in blocks that are split where the proof fails."""
        before = Reachable(self.tip, self.ranges.limits, self.ranges.swept, self.seed)
        after = before
        if self.release:
            after = Reachable(self.tip, self.after.limits, self.after.swept, self.seed)
        order = np.argsort(-self.lost_by[: self.tip.moving], kind="stable").tolist()
        locked = [
            Reachable(self.tip, after.limits, self._drawn(after, joint), self.seed)
            for joint in range(self.tip.moving)
        ]

        def tolerates(places: Matrix, proved: Mask, half: float) -> Mask:
            for joint in order:
                left = np.flatnonzero(proved)
                swept = tuple(self.ranges.swept[joint].tolist())
                proved[left] = locked[joint].tolerates(places[left], half, joint, swept)
                tick()
            return proved

        places, may = self._places(), np.flatnonzero(self.healthy != LOST)
        reached = before.reaches(places[may], 0.0)
        self.healthy_middles.flat[may] = reached
        tick()
        may = may[reached & (self.tolerated.ravel()[may] != LOST)]
        shown = tolerates(places[may], np.ones(len(may), dtype=np.bool_), 0.0)
        self.tolerated_middles.flat[may] = shown
        for level in range(_LEVELS, -1, -1):
            half = 0.5 * self.edge * 2**level
            for block, middles in self._blocks(self.tolerated, self.tolerated_middles, level):
                proved = before.reaches(middles, half)
                tick()
                self._keep(self.tolerated, block[tolerates(middles, proved, half)], level)
        self.healthy[self.tolerated == KEPT] = KEPT
        for level in range(_LEVELS, -1, -1):
            half = 0.5 * self.edge * 2**level
            for block, middles in self._blocks(self.healthy, self.healthy_middles, level):
                self._keep(self.healthy, block[before.reaches(middles, half)], level)
                tick()

    def _drawn(self, after: Reachable, joint: int) -> Matrix:
        drawn = after.drawn.copy()
        drawn[joint] = self.ranges.swept[joint]
        return drawn

    def _blocks(
        self, states: NDArray[np.int8], shown: NDArray[np.bool_], level: int
    ) -> Iterator[tuple[NDArray[np.intp], Matrix]]:
        """Yield the open blocks of a level, of whose cells all middles are shown, and middles."""
        size = 2**level
        is_open = (states == UNDECIDED) & shown
        for axis in range(self.tip.m):
            starts = np.arange(0, self.shape[axis], size)
            is_open = np.logical_and.reduceat(is_open, starts, axis=axis)
        block = np.argwhere(is_open)
        if len(block):
            yield block, self.origin + (block + 0.5) * size * self.edge

    def _keep(self, states: NDArray[np.int8], blocks: NDArray[np.intp], level: int) -> None:
        size = 2**level
        for offset in itertools.product(range(size), repeat=self.tip.m):
            states[tuple((blocks * size + offset).T)] = KEPT


def _cells(tip: TipPoint, cell: float | None) -> tuple[Vector, float, tuple[int, ...]]:
    """Return corner, edge and numbers of the cells that cover the reach of an arm."""
    rows = list(tip.rows)
    radius = float(tip.reaches[0])
    if tip.is_prismatic[0]:
        radius += float(np.abs([tip.robot.lower[0], tip.robot.upper[0]]).max())
    if cell is None:
        cell = _rounded(2.0 * radius / (_PLANE_CELLS if tip.m == 2 else _SPACE_CELLS))
    if not (is_number(cell) and 0.0 < cell <= 2.0 * radius):
        raise InputError(
            f"the edge of the cells must lie between 0 and the width of the reach, "
            f"{2.0 * radius:.4g} m, got {cell}"
        )
    largest = 2**_LEVELS
    count = 2 * largest * math.ceil(radius / cell / largest - _ROUNDING)
    if count**tip.m > _MOST_CELLS:
        least = 2.0 * radius / (_MOST_CELLS ** (1.0 / tip.m) - 2 * largest)
        raise InputError(
            f"cells of {cell:g} m are {count**tip.m:,}, more than {_MOST_CELLS:,}; "
            f"choose at least {least:.2g} m"
        )
    origin = tip.points[0][rows] - 0.5 * count * cell
    return origin, float(cell), (count,) * tip.m


def _box(tip: TipPoint, around: ArrayLike) -> Matrix:
    """Return the corners of a box, lower and upper, m, shape (2, m).

    Raises
    ------
    InputError
        They are malformed.
    """
    try:
        box = np.array(around, dtype=np.float64)
    except (TypeError, ValueError):
        box = np.zeros(0)
    if box.shape != (2, tip.m) or not np.isfinite(box).all() or (box[0] > box[1]).any():
        raise InputError(
            f"around is a lower and an upper corner of {tip.m} finite coordinates each, m, got "
            f"{around!r}"
        )
    return read_only(box)


def _rounded(x: float) -> float:
    """Return a number rounded to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(x))
    return float(
        power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(step * power / x)))
    )


def _frozen(states: NDArray[Any]) -> Any:
    copy = states.copy()
    copy.flags.writeable = False
    return copy
