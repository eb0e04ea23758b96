"""How an arm moves along its course while joints fail, by resolved rates.

The motion solves ``q̇ = g(t, q)``, where g gives the tip the velocity ``ẋ + k (x - f(q))`` of its
course. After a lock, g is Appendix A's: the velocities of the healthy arm, and the smallest change
of them that makes up for the joints that stand still.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ftforce.core.faults import FaultMode
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.resolved_rates import Bounds, damped_inverse, resolved_rates, without
from ftforce.core.svd import Svd
from ftforce.robot.kinematics import frame_jacobian, rotation_vector
from ftforce.trajectory.reference import Motion

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.faults import FaultSet
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.fault_events import Phase
    from ftforce.trajectory.reference import ReferenceTrajectory

GAIN = 10.0  # 1/s: with which the tip returns to its course
LIMIT_GAIN = 5.0  # 1/s: at a distance d from its limit a joint moves there with at most this · d
SLOWEST = 1e-3  # m/s: the tip may return to its course this fast, however slow that is
_AT_BOUND = 1e-9  # rad/s or m/s: so close to a bound a joint has no room
_RTOL, _ATOL = 1e-8, 1e-9  # of the integration, rad or m
_FINEST = 1e-4  # s: adaptive steps below this get nowhere
_SMALL_STEP = 1e-3  # s: of the fixed ones that then lead on,
_PATIENCE = 0.02  # s: for so long at first
_DENSE = 0.02  # s: up to this step velocities may be splined,
_KINK = 0.01  # but not where their slope changes by this share of the largest,
_REACH = 6  # nor so many samples beside it or an end
_QUOTIENT = 1e-6  # s: step of a difference quotient

Law: TypeAlias = "Callable[[float, Vector], Vector]"
Tick: TypeAlias = "Callable[[int], None]"


class State(NamedTuple):
    """Position, velocity and acceleration of all joints at an instant, shape (n,) each."""

    q: Vector
    v: Vector
    a: Vector


class Progression(NamedTuple):
    """A motion, and what precedes each phase.

    Attributes
    ----------
    motion :
        At the times asked for.
    arrivals :
        The state right before each phase but the first, by its start.
    """

    motion: Motion
    arrivals: dict[float, State]


def advance(
    robot: Robot,
    course: ReferenceTrajectory,
    q: Vector,
    times: Vector,
    phases: Sequence[Phase],
    *,
    planned: Progression | None = None,
    tick: Tick,
) -> Progression:
    """Return how an arm follows its course while joints fail.

    A joint that locks stops at once. Until the controller knows, the others go on as planned; from
    then on they follow the course again.

    Parameters
    ----------
    robot, course :
        The arm and what it is to follow.
    q :
        Joint positions at the start, shape (n,).
    times :
        Of the samples, s, rising from 0, shape (N,).
    phases :
        The faults, and what is known of them, none of it after the last sample.
    planned :
        How the healthy arm moves, with the same phases; found anew if not given.
    tick :
        Called with the number of samples that are done.
    """
    whole = Motion(*(np.empty((len(times), robot.n)) for _ in range(3)))
    arrivals: dict[float, State] = {}
    known, nothing = phases[0].known, robot.at_rest
    here = start = q  # where the arm is, and where it would be if it had no fault but the known
    ends = [phase.start for phase in phases[1:]] + [float(times[-1])]
    for i, (phase, end) in enumerate(zip(phases, ends, strict=True)):
        locked = phase.known.mask(robot.n)
        if phase.known != known and locked.any():
            start = here
        known, stuck = phase.known, phase.actual.mask(robot.n) & ~locked
        last = i == len(phases) - 1
        rows = slice(*np.searchsorted(times, (phase.start, np.inf if last else end)))
        if planned is not None and not locked.any():
            stretch = Motion(*(x[rows] for x in planned.motion))
            tick(len(stretch.q))
            state = None if last else planned.arrivals[end]
        else:
            span = (phase.start, end)
            stretch, state = _stretch(
                robot, course, start, times[rows], span=span, known=known, tick=tick
            )
        for x, samples, held in zip(whole, stretch, (here, nothing, nothing), strict=True):
            x[rows] = np.where(stuck, held, samples)
        if state is not None and not last:
            arrivals[end] = State(*map(np.where, [stuck] * 3, (here, nothing, nothing), state))
            start, here = state.q, arrivals[end].q
    return Progression(whole, arrivals)


def rates_law(robot: Robot, course: ReferenceTrajectory, known: FaultSet) -> Law:
    """Return the joint velocities that follow a course, as a function of time and posture.

    Parameters
    ----------
    robot, course :
        The arm and what it is to follow.
    known :
        The faults that the controller knows.
    """
    top, orientation = max(course.top_speed, SLOWEST), course.orientation
    speeds = np.array([joint.velocity or np.inf for joint in robot.joints])
    rates = _Rates(speeds, robot.lower, robot.upper)
    locked = known.mask(robot.n)
    swinging = known.swinging_mask(robot.n)
    passive = locked if swinging is None else locked | swinging
    nobody = np.zeros(robot.n, dtype=np.bool_)
    any_locked = bool(locked.any())

    def velocities(t: float, q: Vector) -> Vector:
        J = frame_jacobian(robot, q, "world")  # places the tip, too
        place = robot.data.oMf[robot.tip_frame]
        target = course.at(t)
        x_dot = target.x_dot + _at_most(top, GAIN * (target.x - place.translation))
        turn = None  # the angular velocity that brings the orientation back
        if orientation is not None:
            # No faster than the tip moves, 1 rad for 1 m: where the orientation cannot be kept,
            # chasing it would drive the arm to where its place cannot be kept either.
            turn = _at_most(top, GAIN * rotation_vector(orientation @ place.rotation.T))
        healthy, v = Svd(J[:3], left_only=True), target.nominal_velocity
        damped_below = BORDERLINE_RTOL * healthy.s[0]
        v = rates.moved(healthy, x_dot - healthy.A.dot(v), q, v, damped_below)
        if turn is not None:
            v = rates.turned(J, turn, nobody, q, v)
        if any_locked:  # Appendix A; a joint without torque goes on as it would
            v = np.where(locked, 0.0, v)
            K = without(healthy.A, passive)
            v = rates.moved(K, x_dot - healthy.A.dot(v), q, v, damped_below)
            if turn is not None:
                v = rates.turned(J, turn, passive, q, v)
        return v

    return velocities


class _Rates(NamedTuple):
    """Resolved rates within an arm's limits of speed and position, shape (n,) each."""

    speeds: Vector
    low: Vector
    high: Vector

    def bounds(self, q: Vector) -> Bounds:
        """Return the velocities that the limits leave; beyond a limit a joint returns."""
        lower = np.maximum(-self.speeds, LIMIT_GAIN * (self.low - q))
        upper = np.minimum(self.speeds, LIMIT_GAIN * (self.high - q))
        return Bounds(np.minimum(lower, self.speeds), np.maximum(upper, -self.speeds))

    def moved(self, K: Svd, missing: Vector, q: Vector, v0: Vector, damped_below: float) -> Vector:
        """Return velocities that give the tip's place what it misses: `resolved_rates`."""
        v: Vector = v0 + damped_inverse(K, missing, damped_below)
        ahead = q + v / LIMIT_GAIN
        if not ((np.abs(v) > self.speeds) | (ahead > self.high) | (ahead < self.low)).any():
            return v  # the usual case, in which bounds are not needed
        return resolved_rates(K, missing, v0, self.bounds(q), damped_below)

    def turned(self, J: Matrix, turn: Vector, passive: Mask, q: Vector, v: Vector) -> Vector:
        """Return velocities that turn the tip, too, as far as its place and the bounds allow.

        The place comes first: what is left for the turn moves no place (Nakamura 1991).

        Parameters
        ----------
        J :
            Linear and angular rows, (6, n).
        turn :
            Angular velocity of the tip, shape (3,).
        passive :
            Joints that cannot be commanded, shape (n,).
        q, v :
            Joint positions, and velocities that move the place as it should.
        """
        lower, upper = self.bounds(q)
        full = (v >= upper - _AT_BOUND) | (v <= lower + _AT_BOUND)
        fixed = passive | full
        K = without(J[:3], fixed)
        V = K.A.T.dot(K.U[:, [s > RTOL * K.s[0] for s in K.s]])
        V = np.linalg.qr(V)[0]
        angular = np.where(fixed, 0.0, J[3:])
        left = Svd(angular - angular.dot(V).dot(V.T), left_only=True)
        scale = Svd(np.ascontiguousarray(J[3:]), left_only=True).s[0]
        change = damped_inverse(left, turn - J[3:].dot(v), BORDERLINE_RTOL * scale)
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(change > 0.0, upper - v, lower - v) / change
        share = np.nanmin(np.where(change == 0.0, np.inf, room), initial=1.0)
        return v + max(float(share), 0.0) * change


def _stretch(
    robot: Robot,
    course: ReferenceTrajectory,
    q: Vector,
    times: Vector,
    *,
    span: tuple[float, float],
    known: FaultSet,
    tick: Tick,
) -> tuple[Motion, State]:
    """Return the motion from one time to another, at some times between, and the last state."""
    if not known.in_mode(FaultMode.LOCKED) and (given := course.motion(times)) is not None:
        last = course.motion(np.array([span[1]]))
        assert last is not None
        tick(len(times))
        return given, State(*(x[0] for x in last))
    law = rates_law(robot, course, known)
    samples, q_end = _integrate(law, q, times, span, tick)
    v = np.empty_like(samples)
    for i, t in enumerate(times.tolist()):
        v[i] = law(t, samples[i])
    return Motion(samples, v, _accelerations(law, times, samples, v)), _state(law, span[1], q_end)


def _integrate(
    law: Law, q: Vector, times: Vector, span: tuple[float, float], tick: Tick
) -> tuple[Matrix, Vector]:
    """Return the solution of q̇ = g(t, q) at some times, (N, n), and at the end, (n,).

    Where g has steps, as at the edge of the workspace, where one joint's limit takes over from
    another's, an adaptive method finds no step that is small enough. Small fixed ones lead on.
    """
    from scipy.integrate import DOP853

    samples = np.empty((len(times), len(q)))
    done = int(np.searchsorted(times, span[0], side="right"))
    samples[:done] = q
    tick(done)
    t, end = span
    patience = _PATIENCE
    while t < end:
        solver = DOP853(law, t, q, end, rtol=_RTOL, atol=_ATOL)
        while solver.status == "running" and solver.step() is None:
            t, q = solver.t, solver.y
            reached = int(np.searchsorted(times, t, side="right"))
            if reached > done:
                samples[done:reached] = solver.dense_output()(times[done:reached]).T
                tick(reached - done)
                done = reached
            if solver.step_size < _FINEST < end - t:
                break
            patience = max(_PATIENCE, patience - solver.step_size)
        if t < end:
            until = min(t + patience, end)
            reached = int(np.searchsorted(times, until, side="right"))
            samples[done:reached], q = _in_small_steps(law, q, (t, until), times[done:reached])
            tick(reached - done)
            t, done, patience = until, reached, 2.0 * patience
    return samples, q


def _in_small_steps(
    law: Law, q: Vector, span: tuple[float, float], times: Vector
) -> tuple[Matrix, Vector]:
    """Return the solution at some times and at the end, by the midpoint rule."""
    count = max(math.ceil((span[1] - span[0]) / _SMALL_STEP), 1)
    t = np.linspace(*span, count + 1)
    steps = [q]
    for start, step in zip(t.tolist(), np.diff(t).tolist(), strict=False):
        middle = q + 0.5 * step * law(start, q)
        q = q + step * law(start + 0.5 * step, middle)
        steps.append(q)
    samples = [np.interp(times, t, x) for x in np.array(steps).T]
    return np.column_stack(samples), q


def _accelerations(law: Law, t: Vector, q: Matrix, v: Matrix) -> Matrix:
    """Return the derivative of the velocities, shape (N, n).

    A spline through the velocities has it at half the cost, but not near its ends, nor where the
    law has a kink (a limit takes over): there it is a quotient of what follows.
    """
    a, rough = np.empty_like(v), np.ones(len(t), dtype=np.bool_)
    if len(t) > 4 * _REACH and (steps := np.diff(t)).max() <= _DENSE:
        from scipy.interpolate import CubicSpline

        slopes = np.diff(v, axis=0) / steps[:, None]
        kinks = np.abs(np.diff(slopes, axis=0)).max(axis=1) > _KINK * np.abs(slopes).max()
        rough[1:-1] = np.convolve(kinks, np.ones(2 * _REACH + 1), "same") > 0.0
        rough[: _REACH + 1] = rough[-_REACH - 1 :] = True
        a = CubicSpline(t, v)(t, 1)
    for i in np.flatnonzero(rough).tolist():
        a[i] = (law(t[i] + _QUOTIENT, q[i] + _QUOTIENT * v[i]) - v[i]) / _QUOTIENT
    return a


def _state(law: Law, t: float, q: Vector) -> State:
    """Return the state right before a time at which something may change."""
    v = law(t, q)
    return State(q, v, (v - law(t - _QUOTIENT, q - _QUOTIENT * v)) / _QUOTIENT)


def _at_most(size: float, x: Vector) -> Vector:
    """Return x, or a vector of its direction and this size if x is longer."""
    square = x.dot(x)
    return x if square <= size * size else x * (size / np.sqrt(square))
