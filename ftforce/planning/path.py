"""Joint paths along a tool path that keep the most after the worst fault at the worst instant.

Every waypoint has a layer of postures that reach it. Dynamic programming chooses the best path
through them (`ftforce.planning.lattice`), layers around that path are drawn more densely and
searched again, and the result is smoothed along the self-motion, which leaves the tip where it is.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.question import AllFaultSets, AnsweredForAll, counted
from ftforce.core.arrays import is_number, read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.errors import InputError
from ftforce.planning.lattice import Breaks, Layer, best_path, breaks_of
from ftforce.planning.objective import Objective
from ftforce.planning.tool_path import ToolPath, placed, project, residual
from ftforce.trajectory.fault_events import Phase
from ftforce.trajectory.motion import advance
from ftforce.trajectory.path import Path
from ftforce.trajectory.recording import Recording
from ftforce.trajectory.start import start_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.question import Progress, Question
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.planning.tool_path import TipTargets
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.start import Smooth, Start, Trajectory

_HEALTHY = FaultSet()
_RESERVES = (0.9, 0.7, 0.5)
"""Shares of the velocity limits within which waypoints are joined, until the spline through them is
within the limits."""
_SAMPLES, _FRESH = 160, 16  # postures per layer, and how many of them are drawn anew
_ROUNDS = ((40, 0.2), (40, 0.06), (30, 0.02))  # postures around the best path, rad or m apart
_KEPT = 0.98  # of the objective, after smoothing
_SMOOTHING = 60  # passes
TIP_TOLERANCE = 1e-5  # m and rad: of the tip between the instants of a planned path
_MOST_INSTANTS = 20_000


class Along(NamedTuple):
    """A joint path and what is left on it after the worst fault set.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (N, n).
    value :
        The measure after the worst fault set, in its unit, shape (N,).
    worst_set :
        Index of that set, shape (N,).
    """

    q: Matrix
    value: Vector
    worst_set: NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PathPlan(AnsweredForAll):
    """A joint path that keeps the most after the worst fault, and the usual one.

    Attributes
    ----------
    objective :
        What is maximised over the worst instant and the worst fault set.
    all_sets :
        The fault sets.
    course :
        One-line description of the tool path.
    start :
        Where the initial posture of the usual path comes from.
    keeps_orientation :
        Whether the orientation of the tip is kept, besides its position.
    t :
        Times, s, shape (N,).
    before, after :
        The usual resolved-rate path, and the planned one.
    waypoints :
        Number of layers of the lattice.
    breaks :
        Where the velocity limits break every path at the speed that was asked for, and the factor
        by which ``t`` is slower.
    tip_error :
        Largest distance, m, and angle, rad, of the tip from the tool path, between instants too.
    warnings, notes :
        Warnings about the result, and what was chosen.
    """

    objective: Objective
    all_sets: AllFaultSets
    course: str
    start: str
    keeps_orientation: bool
    t: Vector
    before: Along
    after: Along
    waypoints: int
    breaks: Breaks
    tip_error: float
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def question(self) -> Question:  # type: ignore[override] # that of the objective
        """What is asked about the arm."""
        return self.objective.question

    @property
    def sets(self) -> tuple[FaultSet, ...]:
        """The fault sets."""
        return self.objective.sets

    def worst_of(self, path: Along) -> int:
        """Return the index of the worst instant of a path.

        Parameters
        ----------
        path :
            ``before`` or ``after``.
        """
        is_cost = self.objective.measure.is_cost
        return int(path.value.argmax() if is_cost else path.value.argmin())

    def recording(self) -> Recording:
        """Return the planned motion, for `ftforce.simulate` and `ftforce.timeline`."""
        return Recording(self.t, self.after.q, source="the plan")


def plan(
    robot: Robot,
    trajectory: Trajectory,
    q: ArrayLike | Posture | None = None,
    *,
    faults: int = 1,
    mode: FaultMode | str = FaultMode.LOCKED,
    maximize: str = "margin",
    posture: str | None = None,
    speed: float | None = None,
    keep_orientation: bool = False,
    waypoints: int = 100,
    acceleration: float | ArrayLike | None = None,
    keep_start: bool = False,
    rate: float | None = None,
    max_gap: float | None = None,
    topic: str | None = None,
    smooth: Smooth = "auto",
    seed: int = 0,
    progress: Progress | None = None,
    **asked: Any,
) -> PathPlan:
    """Plan the joint path along a tool path that keeps the most after the worst fault.

    The worst instant counts, then the mean over the path. The joints stay within their position
    and velocity limits; collisions are not checked.

    Parameters
    ----------
    robot, trajectory, q, posture, speed, rate, max_gap, topic, smooth :
        As in `ftforce.timeline`. Of a recorded motion only the path of the tip is kept.
    faults, mode :
        Size of the largest fault sets, ``locked`` or ``free``.
    maximize :
        ``margin``, ``rho``, ``capability``, ``payload``, or ``jump``, which is minimised.
    keep_orientation :
        Whether the tip keeps its orientation: the initial one along lines, that of every instant
        of a recording.
    waypoints :
        Number of points on the tool path at which postures are compared.
    acceleration :
        Largest joint accelerations, rad/s² or m/s², one number or shape (n,).
    keep_start :
        Whether the path starts in the posture of the usual one.
    seed :
        Seed of the postures that are tried.
    progress :
        Called with the number of steps completed and their total.
    **asked :
        Force, direction, gravity, payload, limits, friction, task, length, joint_length, axes, rtol
        and wary, as in `ftforce.analyze`.

    Raises
    ------
    InputError
        An argument is invalid, or a point of the tool path cannot be reached.
    TrajectoryError, LimitsError
        A file cannot be read or does not fit the robot.

    Examples
    --------
    >>> import ftforce
    >>> from ftforce.planning.path import plan
    >>> from ftforce.trajectory import Path
    >>> arm = ftforce.load_robot("panda")
    >>> line = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1)
    >>> found = plan(arm, line, maximize="margin", waypoints=20)
    >>> found.after.value.min() > found.before.value.min()
    True
    """
    all_sets = AllFaultSets.parse(robot, faults, mode)
    objective = Objective.parse(robot, maximize, all_sets, **asked)
    count = _checked_count(waypoints)
    rates = _Rates.of(robot, acceleration)
    tick = counted(progress, count + 1)
    follow = partial(
        start_of, robot, q=q, posture=posture, rate=rate, speed=speed, max_gap=max_gap,
        topic=topic, smooth=smooth, problem=objective.question.problem_in,
    )  # fmt: skip
    start = follow(trajectory)
    if keep_orientation and start.reference.smoothing is None:  # lines, not a recording
        if isinstance(trajectory, Path):
            start = follow(replace(trajectory, keeps_orientation=True))
        else:
            start = follow(trajectory, keep_orientation=True)
    keeps = keep_orientation or start.reference.orientation is not None
    usual = _usual(objective.question, start)
    tool = ToolPath(robot, start.reference, keeps)
    times = np.linspace(0.0, float(start.times[-1]), count)
    search = _Search(
        objective, tool, rates, times, _at(times, start.times, usual), keep_start=keep_start,
        rng=np.random.default_rng(seed), tick=tick,
    )  # fmt: skip
    for reserve in _RESERVES:
        found, breaks = search.path(reserve)
        t, dense, error = _dense(tool, times, found)
        slow_down = max(breaks.slow_down, rates.slow_down(t, dense))
        if slow_down <= 1.0 or breaks.waypoints:
            break
    tick(1)
    before = _at(t, start.times, usual)
    return PathPlan(
        objective=objective,
        all_sets=all_sets,
        course=start.words,
        start=start.source,
        keeps_orientation=keeps,
        t=read_only(t * slow_down),
        before=_along(objective, before),
        after=_along(objective, dense),
        waypoints=count,
        breaks=breaks._replace(slow_down=slow_down),
        tip_error=error,
        warnings=start.warnings,
        notes=start.notes,
    )


def _checked_count(waypoints: object) -> int:
    is_count = isinstance(waypoints, (int, np.integer)) and not isinstance(waypoints, bool)
    if not is_count or not 2 <= int(waypoints) <= 10_000:  # type: ignore[call-overload]
        raise InputError(f"waypoints must be an integer from 2 to 10,000, got {waypoints!r}")
    return int(waypoints)  # type: ignore[call-overload, no-any-return] # an integer


def _usual(question: Question, start: Start) -> Matrix:
    """Return the path that resolved-rate control takes, or the recorded one, shape (N, n)."""
    phase = Phase(0.0, _HEALTHY, _HEALTHY)
    motion = advance(
        question.robot, start.reference, start.q, start.times, (phase,), scale=question.scale,
        tick=lambda _: None,
    ).motion  # fmt: skip
    return motion.q


def _along(objective: Objective, q: Matrix) -> Along:
    value = objective.values(q)
    value = -value if objective.measure.is_cost else value
    return Along(read_only(q), read_only(value), objective.worst_sets(q))


def _at(t: Vector, times: Vector, q: Matrix) -> Matrix:
    """Return joint positions at other times, shape (k, n)."""
    return np.column_stack([np.interp(t, times, x) for x in q.T])


class _Rates(NamedTuple):
    """Largest joint velocities and accelerations, infinite where unknown, shape (n,)."""

    velocity: Vector
    acceleration: Vector

    @classmethod
    def of(cls, robot: Robot, acceleration: object) -> _Rates:
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
        most = robot.vector(given, "acceleration")  # type: ignore[arg-type] # which is checked
        if not (most > 0.0).all():
            raise InputError(f"accelerations must be positive, got {most.tolist()}")
        return cls(velocity, most)

    def slow_down(self, t: Vector, q: Matrix) -> float:
        """Return the factor on all times by which a motion keeps the limits, 1 if it does."""
        spline = _spline(t, q)
        fine = _with_middles(t)
        velocity = np.abs(spline(fine, 1)).max(axis=0) / self.velocity
        acceleration = np.abs(spline(fine, 2)).max(axis=0) / self.acceleration
        factor = max(float(velocity.max()), float(np.sqrt(acceleration.max())), 1.0)
        return factor if factor > 1.0 + 1e-9 else 1.0


class _Search:
    """The search for the best path.

    Parameters
    ----------
    objective, tool, rates :
        What is maximised, the path of the tip, and the limits of velocities.
    times :
        Times of the waypoints, s, shape (k,).
    usual :
        The usual path, which is among those compared, shape (k, n).
    keep_start :
        Whether the path starts as the usual one.
    rng :
        Draws the postures that are tried.
    tick :
        Called for each step.

    Raises
    ------
    InputError
        A waypoint cannot be reached.
    """

    def __init__(
        self,
        objective: Objective,
        tool: ToolPath,
        rates: _Rates,
        times: Vector,
        usual: Matrix,
        *,
        keep_start: bool,
        rng: np.random.Generator,
        tick: Callable[[int], None],
    ) -> None:
        self.objective, self.tool, self.robot = objective, tool, tool.robot
        self.targets = tool.at(times)
        self.steps = np.diff(times)[:, None] * rates.velocity
        self.wraps = np.isinf(self.robot.upper) & np.isinf(self.robot.lower)
        self.keep_start, self.rng, self.tick = keep_start, rng, tick
        self.layers = self._valued(self._drawn(usual))

    def path(self, reserve: float) -> tuple[Matrix, Breaks]:
        """Return the best joint path, shape (k, n), and where velocity limits break every path.

        Parameters
        ----------
        reserve :
            Share of the velocity limits that may be used.
        """
        steps, breaks = reserve * self.steps, Breaks((), 1.0)
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
        values = self.objective.values(np.concatenate(postures))
        ends = np.cumsum([len(q) for q in postures])[:-1]
        return list(map(Layer, postures, np.split(values, ends)))

    def _taken(self, layers: Sequence[Layer], chosen: NDArray[np.intp]) -> Matrix:
        """Return the chosen postures, without jumps of endless joints by a turn, shape (k, n)."""
        q = np.array([layer.q[i] for layer, i in zip(layers, chosen, strict=True)])
        return np.where(self.wraps, np.unwrap(q, axis=0), q)

    def _drawn(self, usual: Matrix) -> list[Matrix]:
        """Return postures that reach each waypoint: those of the one before, moved on, and new."""
        lower, upper = self.robot.ranges
        found: list[Matrix] = []
        for k, own in enumerate(usual):
            count = _FRESH if found else 2 * _SAMPLES
            new = lower + self.rng.random((count, self.robot.n)) * (upper - lower)
            seeds = np.concatenate([own[None], *found[-1:], new])
            target = self.targets.one(k)
            if k == 0 and self.keep_start:
                seeds = seeds[:1]
            q, reached = project(self.robot, seeds, target)
            if not reached.any():
                raise self._unreached(k, len(usual), target, q)
            q = q[reached]
            if len(q) > _SAMPLES:
                kept = self.rng.permutation(np.arange(reached[0], len(q)))[: _SAMPLES - 1]
                q = q[np.concatenate([[0], np.sort(kept)])]
            found.append(q)
            self.tick(1)
        return found

    def _near(self, q: Matrix, count: int, spread: float) -> list[Matrix]:
        """Return layers of postures around a path, and the path itself."""
        k, n = q.shape
        # Half of them are moved alike along the path: neighbours stay within reach in time.
        shared = self.rng.normal(0.0, spread, (count // 2, 1, n))
        own = self.rng.normal(0.0, spread, (count - count // 2, k, n))
        seeds = np.concatenate([q + shared, q + own]).transpose(1, 0, 2)  # (k, count, n)
        which = np.repeat(np.arange(k), count)
        found, reached = project(self.robot, seeds.reshape(-1, n), self.targets.at(which))
        layers = []
        for i, own_q in enumerate(q):
            rows = np.flatnonzero((which == i) & reached)
            others = found[rows[:0] if self.keep_start and i == 0 else rows]
            layers.append(np.concatenate([own_q[None], others]))
        return layers

    def _unreached(self, k: int, count: int, target: TipTargets, q: Matrix) -> InputError:
        """Return the error for a waypoint that no posture reaches."""
        missing = residual(target, placed(self.robot, q))
        nearest = int(np.linalg.norm(missing[:, :3], axis=1).argmin())
        far = float(np.linalg.norm(missing[nearest, :3]))
        place = ", ".join(f"{x:.4g}" for x in np.reshape(target.position, -1).tolist())
        pose = " with its orientation" if self.tool.keeps_orientation else ""
        return InputError(
            f"the tip cannot reach waypoint {k + 1} of {count}, ({place}) m in root axes{pose}, "
            f"within the joint limits: the closest position found is {far:.3g} m away"
        )

    def _smoothed(self, q: Matrix, steps: Matrix, worst: float) -> Matrix:
        """Return a smoother path, with the tip where it is and no less of the objective.

        Every waypoint moves towards the middle of its neighbours along the self-motion.
        """
        least = worst - (1.0 - _KEPT) * abs(worst)
        first = int(self.keep_start)
        for _ in range(_SMOOTHING):
            wanted = q.copy()
            wanted[1:-1] = 0.5 * q[1:-1] + 0.25 * (q[:-2] + q[2:])
            wanted[0], wanted[-1] = 0.5 * (q[0] + q[1]), 0.5 * (q[-1] + q[-2])
            moved, reached = project(self.robot, wanted, self.targets)
            fits = reached & (self.objective.values(moved) >= least)
            fits[:first] = False
            trial = np.where(fits[:, None], moved, q)
            if _is_within(trial, steps) or not _is_within(q, steps):
                q = trial
            else:
                break
        return q


def _is_within(q: Matrix, steps: Matrix) -> bool:
    """Return whether a path is within the largest steps."""
    return bool((np.abs(np.diff(q, axis=0)) <= steps * (1.0 + 1e-9)).all())


def _spline(t: Vector, q: Matrix) -> Any:
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, q)


def _with_middles(t: Vector) -> Vector:
    """Return times and the middles between them."""
    return np.sort(np.concatenate([t, 0.5 * (t[1:] + t[:-1])]))


def _dense(tool: ToolPath, times: Vector, q: Matrix) -> tuple[Vector, Matrix, float]:
    """Return a path at so many instants that a spline through them keeps the tip on its path.

    Returns
    -------
    t, q :
        Times, s, shape (N,), and joint positions, shape (N, n).
    error :
        Largest distance, m, or angle, rad, from the path, between the instants too.
    """
    for parts in (2**i for i in itertools.count(1)):
        spline = _spline(times, q)
        t = np.linspace(times[0], times[-1], (len(times) - 1) * parts + 1)
        found, reached = project(tool.robot, spline(t), tool.at(t))
        if not reached.all():
            raise InputError(
                f"the tip cannot stay on its path at {t[np.argmin(reached)]:.4g} s, between "
                "waypoints that it reaches; ask for more waypoints"
            )
        middle = 0.5 * (t[1:] + t[:-1])
        off = residual(tool.at(middle), placed(tool.robot, _spline(t, found)(middle)))
        error = float(np.abs(off).max())
        if error <= TIP_TOLERANCE or len(t) > _MOST_INSTANTS:
            return t, found, error
    raise AssertionError
