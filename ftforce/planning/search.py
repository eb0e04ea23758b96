"""The search for the best joint path along a tool path.

Every waypoint has a layer of postures that reach it. Dynamic programming chooses the best path
through them (`ftforce.planning.lattice`), layers around that path are drawn more densely and
searched again, and the result is smoothed along the self-motion, which leaves the tip where it is.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import is_number
from ftforce.errors import InputError
from ftforce.planning.lattice import Breaks, Layer, best_path, breaks_of
from ftforce.planning.target import residual
from ftforce.planning.tool_path import with_target

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.objective import Objective
    from ftforce.planning.target import TipTarget
    from ftforce.planning.tool_path import ToolPath
    from ftforce.robot.robot import Robot

_RESERVES = (0.9, 0.7, 0.5)
"""Shares of the velocity limits within which waypoints are joined, until the spline through them is
within the limits."""
_SAMPLES = 100  # postures per layer
_FRESH, _EVERY = 32, 5  # of them drawn anew, at every fifth waypoint
_BEST, _TRIES = 16, 10  # postures that are followed, and trials around each
_CLIMB = (0.4, 0.2, 0.2, 0.1, 0.1, 0.05, 0.03)  # how far trials are from them, rad or m
_ROUNDS = ((30, 0.15), (30, 0.05), (24, 0.02))  # postures around the best path, rad or m apart
_FARTHEST = (0.1, 0.25)  # m and rad, from one waypoint to the next
_UNBOUNDED = 1e12  # a force or mass that nothing bounds, so that sums remain numbers
_KEPT = 0.98  # of the objective, after smoothing
_SMOOTHING = 60  # passes
TIP_TOLERANCE = 1e-5  # m and rad: of the tip between the instants of a planned path
_MOST_INSTANTS = 20_000
_FINEST = 8  # instants per waypoint, of a path that leaves its tool path


class Usual(NamedTuple):
    """The path with which that of the search is compared.

    Attributes
    ----------
    t, q :
        Times, s, and joint positions, rad or m, shapes (N,) and (N, n).
    """

    t: Vector
    q: Matrix

    def at(self, t: Vector) -> Matrix:
        """Return joint positions at other times, shape (k, n).

        Parameters
        ----------
        t :
            Times, s, shape (k,).
        """
        return np.column_stack([np.interp(t, self.t, x) for x in self.q.T])


class Found(NamedTuple):
    """A path that was found.

    Attributes
    ----------
    t, q :
        Times, s, before any slow-down, and joint positions, shapes (N,) and (N, n).
    worst :
        The objective at its worst instant.
    holds_between :
        Whether it is hardly smaller between the waypoints than at them.
    breaks, slow_down :
        Where velocity limits break every path, and the factor on the times.
    error :
        Largest distance, m, and angle, rad, from the tool path where it is reached.
    reached :
        Whether the tip is on its path, shape (N,).
    waypoints :
        Their number.
    """

    t: Vector
    q: Matrix
    worst: float
    holds_between: bool
    breaks: Breaks
    slow_down: float
    error: float
    reached: Mask
    waypoints: int

    @property
    def at_waypoints(self) -> slice:
        """The instants of the waypoints."""
        return slice(None, None, (len(self.t) - 1) // (self.waypoints - 1))


class Search(NamedTuple):
    """A search for the best joint path.

    Attributes
    ----------
    objective, tool, rates :
        What is maximised, the path of the tip, and the limits of the joints.
    usual :
        The usual path, which is among those compared.
    keep_start :
        Whether the path starts as the usual one.
    seed :
        Seed of the postures that are tried.
    """

    objective: Objective
    tool: ToolPath
    rates: Rates
    usual: Usual
    keep_start: bool
    seed: int

    def best(self, count: int, tick: Callable[[int], None], *, is_guarded: bool = False) -> Found:
        """Return the best path through a number of waypoints.

        Parameters
        ----------
        count :
            Number of waypoints.
        tick :
            Called for each.
        is_guarded :
            Whether it counts first how many joints may lock where they are, so that the others
            still reach the rest of the tool path.

        Raises
        ------
        InputError
            A waypoint cannot be reached, and no joint is locked.
        """
        times = np.linspace(self.usual.t[0], self.usual.t[-1], count)
        lattice = _Lattice(self, times, tick, is_guarded=is_guarded)
        for reserve in _RESERVES:
            q, breaks = lattice.path(reserve)
            worst = float(self.objective.values(q).min())
            t, dense, error, reached = _dense(self.tool, times, q, lattice.missed)
            slow_down = max(breaks.slow_down, self.rates.slow_down(t, dense), 1.0)
            if slow_down == 1.0 or breaks.waypoints:
                break
        between = float(self.objective.values(dense).min())
        holds = between >= worst - (1.0 - _KEPT) * abs(worst)
        return Found(t, dense, between, holds, breaks, slow_down, error, reached, count)


class Rates(NamedTuple):
    """Largest joint velocities and accelerations, infinite where unknown, shape (n,)."""

    velocity: Vector
    acceleration: Vector

    @classmethod
    def of(cls, robot: Robot, acceleration: object) -> Rates:
        """Return the limits of an arm, with accelerations as given.

        Raises
        ------
        InputError
            The accelerations are not positive numbers, one or one per joint.
        """
        velocity = np.array([joint.velocity or np.inf for joint in robot.joints])
        if acceleration is None:
            return cls(velocity, np.full(robot.n, np.inf))
        given = acceleration
        if is_number(given):
            given = np.full(robot.n, float(given))  # type: ignore[arg-type] # a number
        most = robot.vector(given, "max_acceleration")  # type: ignore[arg-type] # which is checked
        if not (most > 0.0).all():
            raise InputError(f"accelerations must be positive, got {most.tolist()}")
        return cls(velocity, most)

    def slow_down(self, t: Vector, q: Matrix) -> float:
        """Return the factor on all times by which a motion keeps the limits, 1 if it does."""
        spline = spline_of(t, q)
        fine = _with_middles(t)
        velocity = np.abs(spline(fine, 1)).max(axis=0) / self.velocity
        acceleration = np.abs(spline(fine, 2)).max(axis=0) / self.acceleration
        factor = max(float(velocity.max()), float(np.sqrt(acceleration.max())), 1.0)
        return factor if factor > 1.0 + 1e-9 else 1.0


class _Lattice:
    """Layers of postures along the path of the tip, and the best path through them.

    Parameters
    ----------
    search :
        What is searched for.
    times :
        Times of the waypoints, s, shape (k,).
    tick :
        Called for each waypoint.
    is_guarded :
        As of `Search.best`.

    Raises
    ------
    InputError
        A waypoint cannot be reached.
    """

    def __init__(
        self, search: Search, times: Vector, tick: Callable[[int], None], *, is_guarded: bool
    ) -> None:
        self.objective, self.tool, self.robot = search.objective, search.tool, search.tool.robot
        self.targets = self.tool.at(times)
        self.steps = np.diff(times)[:, None] * search.rates.velocity
        self.wraps = np.isinf(self.robot.upper) & np.isinf(self.robot.lower)
        self.keep_start, self.tick = search.keep_start, tick
        self.rng = np.random.default_rng(search.seed)
        self.missed = np.zeros(len(times), dtype=np.bool_)
        drawn = self._drawn(search.usual.at(times))
        values = self.objective.values(np.concatenate(drawn))
        self.room = _Room.of(list(map(self._within_a_turn, drawn)), values)
        self.is_guarded = is_guarded
        self.layers = self._valued(self._with_followed(drawn))

    def path(self, reserve: float) -> tuple[Matrix, Breaks]:
        """Return the best joint path, shape (k, n), and where velocity limits break every path.

        Steps that are so long that the objective may be much less between two waypoints are taken
        only where there are no others.

        Parameters
        ----------
        reserve :
            Share of the velocity limits that may be used.
        """
        breaks = Breaks((), 1.0)
        slides = np.array([unit == "m" for unit in self.robot.units])
        steps = np.minimum(reserve * self.steps, np.where(slides, *_FARTHEST))
        best = best_path(self.layers, steps, self.wraps)
        if best is None:
            steps = reserve * self.steps
            best = best_path(self.layers, steps, self.wraps)
        if best is None:
            breaks = breaks_of(self.layers, self.steps, self.wraps)
            steps = self.steps * (max(breaks.slow_down, 1.0) * (1.0 + 1e-9))
            best = best_path(self.layers, steps, self.wraps)
            assert best is not None
        q = self._taken(self.layers, best.chosen)
        for count, spread in _ROUNDS:
            layers = self._valued(self._near(q, count, spread))
            best = best_path(layers, steps, self.wraps)
            assert best is not None  # the path before is among them
            q = self._taken(layers, best.chosen)
        return self._smoothed(q, steps, best.worst), breaks

    def _valued(self, postures: Sequence[Matrix]) -> list[Layer]:
        """Return layers of postures with the objective."""
        counts = [len(q) for q in postures]
        values = self._values(np.concatenate(postures), np.repeat(np.arange(len(counts)), counts))
        values = np.minimum(values, _UNBOUNDED)
        return list(map(Layer, postures, np.split(values, np.cumsum(counts)[:-1])))

    def _values(self, q: Matrix, waypoints: NDArray[np.intp]) -> Vector:
        """Return what is maximised in postures at some waypoints, shape (N,)."""
        value = self.objective.values(q)
        if not self.is_guarded:
            return value
        return self.room.guarded(self._within_a_turn(q), waypoints, value)

    def _within_a_turn(self, q: Matrix) -> Matrix:
        """Return joint positions, those of endless joints from -π to π."""
        return np.where(self.wraps, (q + np.pi) % (2.0 * np.pi) - np.pi, q)

    def _taken(self, layers: Sequence[Layer], chosen: NDArray[np.intp]) -> Matrix:
        """Return the chosen postures, without jumps of endless joints by a turn, shape (k, n)."""
        q = np.array([layer.q[i] for layer, i in zip(layers, chosen, strict=True)])
        return np.where(self.wraps, np.unwrap(q, axis=0), q)

    def _drawn(self, usual: Matrix) -> list[Matrix]:
        """Return postures that reach each waypoint: those of the one before, moved on, and new."""
        lower, upper = self.robot.ranges
        found: list[Matrix] = []
        for k, own in enumerate(usual):
            target = self.targets.at(k)
            is_new = not found or self.missed[k - 1]
            count = 3 * _SAMPLES if is_new else _FRESH * (k % _EVERY == 0)
            new = lower + self.rng.random((count, self.robot.n)) * (upper - lower)
            seeds = np.concatenate([own[None], *found[-1:], np.where(self.tool.locked, own, new)])
            if k == 0 and self.keep_start:
                seeds = seeds[:1]
            q, reached = self.tool.project(seeds, target)
            is_on = reached[0] and np.abs(q[0] - own).max() <= TIP_TOLERANCE
            if self.tool.locked.any() and not is_on:
                # The usual path of a damaged arm has left the tool path; so does every other.
                self.missed[k] = True
                self.targets = with_target(self.targets, k, self.robot, own)
                q, reached = own[None], np.ones(1, dtype=np.bool_)
            elif not reached.any():
                raise self._unreached(k, len(usual), target, q)
            q = q[reached]
            if len(q) > _SAMPLES:
                kept = self.rng.permutation(np.arange(1, len(q)))[: _SAMPLES - 1]
                q = q[np.concatenate([[0], np.sort(kept)])]
            found.append(q)
            self.tick(1)
        return found

    def _with_followed(self, drawn: Sequence[Matrix]) -> list[Matrix]:
        """Return layers with the best postures of some waypoints, followed along the whole path.

        Random postures alone are too few where the self-motion has several dimensions.
        """
        last = len(drawn) - 1
        is_open = ~self.missed
        is_open[0] &= not self.keep_start
        best = {k: self._climbed(k, drawn[k]) for k in {0, last // 2, last} if is_open[k]}
        layers = [[q] for q in drawn]
        for k, q in best.items():
            layers[k].append(q)
        for way in (range(last + 1), range(last, -1, -1)):
            q = drawn[0][:0]
            for k in way:
                if not is_open[k]:
                    q = q[:0]
                elif len(q):
                    q, reached = self.tool.project(q, self.targets.at(k))
                    q = q[reached]
                    layers[k].append(q)
                q = np.concatenate([q, best.get(k, q[:0])])
        return [np.concatenate(parts) for parts in layers]

    def _climbed(self, k: int, q: Matrix) -> Matrix:
        """Return the best postures around those of a waypoint, shape (s, n)."""
        target = self.targets.at(k)
        for spread in _CLIMB:
            value = self._values(q, np.full(len(q), k))
            q = q[np.argsort(-np.nan_to_num(value, nan=-np.inf), kind="stable")[:_BEST]]
            moved = q + self.rng.normal(0.0, spread, (_TRIES, *q.shape))
            moved = np.where(self.tool.locked, q, moved).reshape(-1, q.shape[1])
            found, reached = self.tool.project(moved, target)
            q = np.concatenate([q, found[reached]])
        value = self._values(q, np.full(len(q), k))
        return q[np.argsort(-np.nan_to_num(value, nan=-np.inf), kind="stable")[:_BEST]]

    def _near(self, q: Matrix, count: int, spread: float) -> list[Matrix]:
        """Return layers of postures around a path, and the path itself."""
        k, n = q.shape
        # Half of them are moved alike along the path: neighbours stay within reach in time.
        shared = self.rng.normal(0.0, spread, (count // 2, 1, n))
        own = self.rng.normal(0.0, spread, (count - count // 2, k, n))
        moved = np.concatenate([q + shared, q + own]).transpose(1, 0, 2)  # (k, count, n)
        seeds = np.where(self.tool.locked, q[:, None], moved).reshape(-1, n)
        which = np.repeat(np.arange(k), count)
        found, reached = self.tool.project(seeds, self.targets.at(which))
        layers = []
        for i, own_q in enumerate(q):
            rows = np.flatnonzero((which == i) & reached)
            others = found[rows[:0] if self.keep_start and i == 0 else rows]
            layers.append(np.concatenate([own_q[None], others]))
        return layers

    def _unreached(self, k: int, count: int, target: TipTarget, q: Matrix) -> InputError:
        """Return the error for a waypoint that no posture reaches."""
        missing = residual(self.robot, self.tool.closest(q, target), target)
        far = f"{np.linalg.norm(missing[:3]):.3g} m"
        pose = ""
        if target.keeps_orientation:
            far += f" and {np.rad2deg(np.linalg.norm(missing[3:])):.3g}°"
            pose = " with its orientation"
        place = ", ".join(f"{x:.4g}" for x in target.position.tolist())
        return InputError(
            f"the tip cannot reach waypoint {k + 1} of {count}, ({place}) m in root axes{pose}, "
            f"within the joint limits; the closest posture found misses it by {far}"
        )

    def _smoothed(self, q: Matrix, steps: Matrix, worst: float) -> Matrix:
        """Return a smoother path, with the tip where it is and no less of the objective.

        Every waypoint moves towards the middle of its neighbours along the self-motion.
        """
        least = worst - (1.0 - _KEPT) * abs(worst)
        first, every = int(self.keep_start), np.arange(len(q))
        for _ in range(_SMOOTHING):
            wanted = q.copy()
            wanted[1:-1] = 0.5 * q[1:-1] + 0.25 * (q[:-2] + q[2:])
            wanted[0], wanted[-1] = 0.5 * (q[0] + q[1]), 0.5 * (q[-1] + q[-2])
            moved, reached = self.tool.project(wanted, self.targets)
            fits = reached & (self._values(moved, every) >= least)
            fits[:first] = False
            trial = np.where(fits[:, None], moved, q)
            if _is_within(trial, steps) or not _is_within(q, steps):
                q = trial
            else:
                break
        return q


class _Room(NamedTuple):
    """Where joints may lock, so that the others still reach the rest of the tool path.

    Attributes
    ----------
    low, high :
        Range of each joint from which all later waypoints were reached, rad or m, shape (k, n).
    worst, best :
        Least and largest value of the objective.
    """

    low: Matrix
    high: Matrix
    worst: float
    best: float

    @classmethod
    def of(cls, layers: Sequence[Matrix], values: Vector) -> _Room:
        """Return what the postures that reach the waypoints leave.

        Parameters
        ----------
        layers :
            Postures that reach each waypoint, rad or m, shape (s, n) each.
        values :
            The objective in all of them.
        """
        low = np.array([q.min(axis=0) for q in layers])[::-1]
        high = np.array([q.max(axis=0) for q in layers])[::-1]
        return cls(
            np.maximum.accumulate(low)[::-1], np.minimum.accumulate(high)[::-1],
            float(values.min()), float(values.max()),
        )  # fmt: skip

    def guarded(self, q: Matrix, waypoints: NDArray[np.intp], value: Vector) -> Vector:
        """Return how many joints may lock, and between 0 and 0.5 for the objective, shape (N,).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (N, n).
        waypoints :
            Where they are taken, shape (N,).
        value :
            The objective, shape (N,).
        """
        counts = ((q >= self.low[waypoints]) & (q <= self.high[waypoints])).sum(axis=1)
        span = max(self.best - self.worst, 1e-300)
        small = 0.5 * np.clip((value - self.worst) / span, 0.0, 1.0)
        guarded: Vector = counts + np.nan_to_num(small)
        return guarded


def _is_within(q: Matrix, steps: Matrix) -> bool:
    """Return whether a path is within the largest steps."""
    return bool((np.abs(np.diff(q, axis=0)) <= steps * (1.0 + 1e-9)).all())


def spline_of(t: Vector, q: Matrix) -> Any:
    """Return the cubic spline through joint positions.

    Parameters
    ----------
    t, q :
        Times, s, shape (N,), and joint positions, rad or m, shape (N, n).
    """
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, q)


def _with_middles(t: Vector) -> Vector:
    """Return times and the middles between them."""
    return np.sort(np.concatenate([t, 0.5 * (t[1:] + t[:-1])]))


def _dense(
    tool: ToolPath, times: Vector, q: Matrix, missed: Mask
) -> tuple[Vector, Matrix, float, Mask]:
    """Return a path at so many instants that a spline through them keeps the tip on its path.

    Beside waypoints that are out of reach, the path is the spline through the waypoints.

    Returns
    -------
    t, q :
        Times, s, shape (N,), and joint positions, shape (N, n).
    error :
        Largest distance, m, or angle, rad, from the path where it is reached, between the instants
        too.
    reached :
        Whether the tip is on its path, shape (N,).
    """
    robot = tool.robot
    in_reach = ~(missed[1:] | missed[:-1])  # from one waypoint to the next
    for parts in (2**i for i in itertools.count(1)):
        t = np.linspace(times[0], times[-1], (len(times) - 1) * parts + 1)
        through = np.clip(spline_of(times, q)(t), robot.lower, robot.upper)
        through = np.where(tool.locked, q[0], through)
        found, reached = tool.project(through, tool.at(t))
        inside = np.append(np.repeat(in_reach, parts), True)
        inside[::parts] = ~missed
        if not (reached | ~inside).all() and not tool.locked.any():
            raise InputError(
                f"the tip cannot stay on its path at {t[np.argmin(reached)]:.4g} s, between "
                "waypoints that it reaches; ask for more waypoints"
            )
        reached &= inside
        found = np.where(reached[:, None], found, through)
        middle = 0.5 * (t[1:] + t[:-1])
        off = np.abs(residual(robot, spline_of(t, found)(middle), tool.at(middle))).max(axis=1)
        error = float(off[reached[1:] & reached[:-1]].max(initial=0.0))
        if error <= TIP_TOLERANCE or len(t) > _MOST_INSTANTS or (missed.any() and parts >= _FINEST):
            return t, found, error, reached
    raise AssertionError
