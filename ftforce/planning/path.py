"""Joint paths along a tool path that keep the most after the worst fault at the worst instant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.question import AllFaultSets, AnsweredForAll, counted
from ftforce.batch.postures.drawn import check_seed
from ftforce.core.arrays import read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.errors import InputError
from ftforce.planning.guarantee import ForceKept, Guarantee, guarantee_of
from ftforce.planning.locks import Locks
from ftforce.planning.objective import Objective
from ftforce.planning.search import TIP_TOLERANCE, Found, Rates, Search, Usual, spline_of
from ftforce.planning.tool_path import ToolPath
from ftforce.trajectory.fault_events import Phase
from ftforce.trajectory.motion import advance
from ftforce.trajectory.path import Path
from ftforce.trajectory.recording import Recording
from ftforce.trajectory.reference import Motion
from ftforce.trajectory.start import start_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress, Question
    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.task import Axes, Task
    from ftforce.planning.lattice import Breaks
    from ftforce.planning.locks import LocksLike
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.start import Smooth, Start, Trajectory

_HEALTHY = FaultSet()
_ON_PATH, _FOLLOWED = 1e-3, 100  # m; instants
_RESERVE = 0.9  # of the velocity limits: the spline through the waypoints is a little faster


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
        Largest distance, m, and angle, rad, of the tip from the tool path where it is reached,
        between instants too.
    locks :
        Joints that have locked before the path, or while the arm was on it.
    reached :
        Whether the tip of the planned path is on the tool path, shape (N,).
    deviation :
        How far it is from there, m and rad, shape (N, 2).
    guarantee :
        Whether the arm can finish whichever joint locks, if that was asked.
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
    locks: Locks | None
    reached: Mask
    deviation: Matrix
    guarantee: Guarantee | None = None
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

    def motion(self) -> Motion:
        """Return positions, velocities and accelerations of the planned path, (N, n) each."""
        spline = spline_of(self.t, self.after.q)
        return Motion(self.after.q, spline(self.t, 1), spline(self.t, 2))

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
    force: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    payload: PayloadLike = None,
    limits: LimitsLike = None,
    friction: FrictionLike = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    speed: float | None = None,
    keep_orientation: bool = False,
    waypoints: int = 100,
    max_acceleration: float | ArrayLike | None = None,
    keep_start: bool = False,
    locked: LocksLike = None,
    guarantee: bool = False,
    rate: float | None = None,
    max_gap: float | None = None,
    topic: str | None = None,
    smooth: Smooth = "auto",
    seed: int = 0,
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    progress: Progress | None = None,
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
    force :
        Force the tool exerts on its environment, N and N·m, in task axes, shape (m,): that of the
        jump, or along which the capability is.
    direction :
        Direction of the capability, in task axes, shape (m,); by default that of the force.
    limits :
        As in `ftforce.analyze`; for capability and payload by default those of the URDF.
    gravity, payload, friction, task, length, joint_length, axes, rtol, wary :
        As in `ftforce.analyze`.
    keep_orientation :
        Whether the tip keeps its orientation: the initial one along lines, that of every instant
        of a recording.
    waypoints :
        Number of points on the tool path at which postures are compared.
    max_acceleration :
        Largest joint accelerations, rad/s² or m/s², one number or shape (n,).
    keep_start :
        Whether the path starts in the posture of the usual one.
    locked :
        Joints that have locked, by number (from 1) or name, and where, rad or m: ``"3@0.7"`` or
        ``{3: 0.7}``; or when, to plan the rest of the path from the usual one: ``"3@2s"``. They
        count among ``faults``. The tip is where the arm comes closest while it cannot reach its
        path.
    guarantee :
        Whether to prefer a path on which the arm can finish whichever joint locks at whichever
        waypoint, and to say where it can. With a ``force``, that is kept within the limits.
    seed :
        Seed of the postures that are tried.
    progress :
        Called with the number of steps completed and their total.

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
    asked: dict[str, Any] = {
        "force": force, "gravity": gravity, "payload": payload, "limits": limits,
        "friction": friction, "task": task, "length": length, "joint_length": joint_length,
        "axes": axes, "rtol": rtol, "wary": wary,
    }  # fmt: skip
    objective = Objective.parse(robot, maximize, all_sets, direction=direction, **asked)
    locks = Locks.parse(robot, locked)
    if locks is not None:
        objective = replace(objective, sets=_sets_after(locks, all_sets))
    F = objective.question.F
    has_force = F is not None and bool(F.any())
    kept = ForceKept.parse(robot, locks, **asked) if guarantee and has_force else None
    count = _checked_count(waypoints)
    check_seed(seed)
    rates = Rates.of(robot, max_acceleration)
    tick = counted(progress, count * (1 + bool(guarantee)))
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
    tool = ToolPath(robot, start.reference, keeps, np.zeros(robot.n, dtype=np.bool_))
    usual, notes = _usual(objective.question, start, tool)
    search = Search(objective, tool, rates, usual, keep_start, seed)
    if locks is not None:
        search, locks = _damaged(search, locks, count)
    found = _best(search, count, tick)
    certificate = None
    if guarantee:
        guarded = search.best(count, tick, is_guarded=True)
        found, certificate = _safest(search, (found, guarded), kept)
    usual, first = search.usual, search.usual.t[0]
    return PathPlan(
        objective=objective,
        all_sets=all_sets,
        course=start.words,
        start=start.source,
        keeps_orientation=keeps,
        t=read_only(first + (found.t - first) * found.slow_down),
        before=_along(objective, usual.at(found.t)),
        after=_along(objective, found.q),
        waypoints=found.waypoints,
        breaks=found.breaks._replace(slow_down=found.slow_down),
        tip_error=found.error,
        locks=locks,
        reached=read_only(found.reached),
        deviation=read_only(search.tool.deviation(found.q, found.t)),
        guarantee=certificate,
        warnings=start.warnings,
        notes=(*start.notes, *notes),
    )


def _sets_after(locks: Locks, all_sets: AllFaultSets) -> tuple[FaultSet, ...]:
    """Return the sets of the joints that have locked, and of others that may fail too.

    Raises
    ------
    InputError
        More joints have locked than may fail.
    """
    if len(locks.joints) > all_sets.largest:
        raise InputError(
            f"{len(locks.joints)} joints have locked, which count among the faults: ask for sets "
            f"of at least {len(locks.joints)} (faults), not {all_sets.largest}"
        )
    return locks.with_others(all_sets, all_sets.largest)


def _damaged(search: Search, locks: Locks, count: int) -> tuple[Search, Locks]:
    """Return the search for the path of the arm after the locks, and where its joints locked.

    Of the paths with the least motion from some postures at the start, the usual one is then that
    which is on the tool path longest.

    Raises
    ------
    InputError
        The joints lock after the path.
    """
    end = float(search.usual.t[-1])
    if locks.time >= end:
        raise InputError(
            f"the joints lock at {locks.time:g} s, when the path of {end:.4g} s is done"
        )
    (q,) = search.usual.at(np.array([locks.time]))
    locks = locks.where(q)
    tool = replace(search.tool, locked=locks.mask)
    times = np.linspace(locks.time, end, count)
    starts = locks.applied(q)[None]
    keep_start = search.keep_start or locks.time > 0.0
    if not keep_start:
        starts = np.concatenate([starts, tool.starts(starts[0], times[0], search.seed)])
    paths, reached = tool.followed(starts, times, _RESERVE * search.rates.velocity)
    off = [float(tool.deviation(path, times).max()) for path in paths.transpose(1, 0, 2)]
    best = min(range(len(starts)), key=lambda i: (-int(reached[:, i].sum()), off[i]))
    usual = Usual(times, paths[:, best])
    return search._replace(tool=tool, usual=usual, keep_start=keep_start), locks


def _best(search: Search, count: int, tick: Callable[[int], None]) -> Found:
    """Return the best path that is found, or the usual one if that is better.

    Raises
    ------
    InputError
        Nothing bounds the measure.
    """
    found = search.best(count, tick)
    if found.worst == np.inf:
        raise InputError(
            f"the {search.objective.name} is unbounded along the whole path: there is nothing to "
            "choose"
        )
    if not (found.holds_between or search.tool.locked.any()):  # once more, with more waypoints
        found = max(found, search.best(2 * count, _silent), key=lambda one: one.worst)
    robot, rates, usual = search.tool.robot, search.rates, search.usual.at(found.t)
    is_usual_better = found.worst < search.objective.values(usual).min()
    if is_usual_better and found.reached.all() and _is_allowed(robot, rates, found.t, usual):
        off = float(search.tool.deviation(usual, found.t).max())
        if off <= TIP_TOLERANCE:
            return found._replace(q=usual, slow_down=1.0, error=off)
    return found


def _safest(
    search: Search, paths: Sequence[Found], kept: ForceKept | None
) -> tuple[Found, Guarantee]:
    """Return the path on which most locks at waypoints are survived, and its certificates."""

    def certified(found: Found) -> Guarantee:
        t, q = found.t[found.at_waypoints], found.q[found.at_waypoints]
        slowed = usual_start + (t - usual_start) * found.slow_down
        steps = np.diff(slowed)[:, None] * search.rates.velocity
        return guarantee_of(search.tool, q, t, steps, kept)

    usual_start = search.usual.t[0]
    pairs = [(found, certified(found)) for found in paths]
    return max(pairs, key=lambda pair: (pair[1].share, pair[0].worst))


def _checked_count(waypoints: object) -> int:
    is_count = isinstance(waypoints, (int, np.integer)) and not isinstance(waypoints, bool)
    if not is_count or not 2 <= int(waypoints) <= 10_000:  # type: ignore[call-overload]
        raise InputError(f"waypoints must be an integer from 2 to 10,000, got {waypoints!r}")
    return int(waypoints)  # type: ignore[call-overload, no-any-return] # an integer


def _usual(question: Question, start: Start, tool: ToolPath) -> tuple[Usual, tuple[str, ...]]:
    """Return the path that resolved-rate control takes, or the recorded one, and notes about it."""
    phase = Phase(0.0, _HEALTHY, _HEALTHY)
    motion = advance(
        question.robot, start.reference, start.q, start.times, (phase,), scale=question.scale,
        tick=_silent,
    ).motion  # fmt: skip
    off = float(tool.deviation(motion.q, start.times)[:, 0].max())
    if off <= _ON_PATH:
        return Usual(start.times, motion.q), ()
    times = np.linspace(0.0, start.times[-1], _FOLLOWED)
    followed, _ = tool.followed(start.q[None], times, np.full(question.robot.n, np.inf))
    note = (
        f"at its speed limits, the usual path leaves the tool path by up to {off:.2g} m; it is "
        "compared as if its joints were fast enough"
    )
    return Usual(times, followed[:, 0]), (note,)


def _silent(_: int) -> None:
    """Report no progress."""


def _is_allowed(robot: Robot, rates: Rates, t: Vector, q: Matrix) -> bool:
    """Return whether a path is within the limits of positions, velocities and accelerations."""
    is_inside = ((q >= robot.lower) & (q <= robot.upper)).all()
    return bool(is_inside) and rates.slow_down(t, q) <= 1.0


def _along(objective: Objective, q: Matrix) -> Along:
    value = objective.values(q)
    value = -value if objective.measure.is_cost else value
    return Along(read_only(q), read_only(value), objective.worst_sets(q))
