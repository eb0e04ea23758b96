"""Motion of an arm along its reference trajectory while joints fail, by resolved-rate control.

The motion solves ``q̇ = g(t, q)``, where g gives the tip the velocity ``ẋ + k (x - f(q))`` of the
reference trajectory. After a lock, g follows Appendix A: the healthy velocities plus the smallest
change that compensates for the locked joints.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ftforce.core.faults import FaultMode
from ftforce.core.joint_scale import UNWEIGHTED
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.resolved_rates import Bounds, damped_inverse, resolved_rates, without_columns
from ftforce.core.svd import Svd
from ftforce.robot.kinematics import rotation_vector, tip_pose_and_jacobian
from ftforce.trajectory.reference import Motion

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.faults import FaultSet
    from ftforce.core.joint_scale import JointScale
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.fault_events import Phase
    from ftforce.trajectory.reference import ReferenceTrajectory

GAIN = 10.0  # 1/s: feedback gain on the position error of the tip
LIMIT_GAIN = 5.0  # 1/s: a joint at distance d from its limit approaches it at no more than this · d
_SLOWEST = 1e-3  # m/s: least bound on the feedback velocity, for slow trajectories
_AT_BOUND = 1e-9  # rad/s or m/s: a velocity this close to a bound counts as saturated
_RTOL, _ATOL = 1e-8, 1e-9  # integration tolerances, rad or m
_FINEST = 1e-4  # s: below this step size the adaptive method is abandoned
_SMALL_STEP = 1e-3  # s: fixed step size used instead
_PATIENCE = 0.02  # s: initial duration of a run of fixed steps
_DENSE = 0.02  # s: largest sample spacing at which velocities are splined
_KINK = 0.01  # relative to the largest slope: a larger change of slope is a kink
_MARGIN = 6  # samples next to a kink or an end, where the spline is not used
_QUOTIENT = 1e-6  # s: step of a difference quotient

Law: TypeAlias = "Callable[[float, Vector], Vector]"
Tick: TypeAlias = "Callable[[int], None]"


class State(NamedTuple):
    """Joint positions, velocities and accelerations at one instant, each of shape (n,)."""

    q: Vector
    v: Vector
    a: Vector


class Progression(NamedTuple):
    """A motion, and the state before each phase.

    Attributes
    ----------
    motion :
        The motion at the sample times.
    arrivals :
        State just before each phase except the first, keyed by the start time of the phase.
    """

    motion: Motion
    arrivals: dict[float, State]


def advance(
    robot: Robot,
    reference: ReferenceTrajectory,
    q: Vector,
    times: Vector,
    phases: Sequence[Phase],
    *,
    scale: JointScale = UNWEIGHTED,
    planned: Progression | None = None,
    tick: Tick,
) -> Progression:
    """Return the motion of an arm that follows its reference trajectory while joints fail.

    A joint that locks stops instantaneously. Until the controller knows, the other joints move as
    planned; afterwards they compensate and the tip follows the reference again.

    Parameters
    ----------
    robot, reference :
        The arm and its reference trajectory.
    q :
        Joint positions at the start, shape (n,).
    times :
        Sample times, s, increasing from 0, shape (N,).
    phases :
        Actual and known faults over time; no phase starts after the last sample.
    scale :
        Weights of hinges against slides.
    planned :
        Motion of the healthy arm over the same phases; computed if not given.
    tick :
        Called with the number of samples just completed.
    """
    whole = Motion(*(np.empty((len(times), robot.n)) for _ in range(3)))
    arrivals: dict[float, State] = {}
    known, nothing = phases[0].known, robot.at_rest
    here = start = q  # actual posture, and the posture with only the known faults
    ends = [phase.start for phase in phases[1:]] + [float(times[-1])]
    for i, (phase, end) in enumerate(zip(phases, ends, strict=True)):
        locked = phase.known.mask(robot.n)
        if phase.known != known and locked.any():
            start = here
        known, undetected = phase.known, phase.actual.mask(robot.n) & ~locked
        last = i == len(phases) - 1
        rows = slice(*np.searchsorted(times, (phase.start, np.inf if last else end)))
        if planned is not None and not locked.any():
            segment = Motion(*(x[rows] for x in planned.motion))
            tick(len(segment.q))
            state = None if last else planned.arrivals[end]
        else:
            span = (phase.start, end)
            segment, state = _segment(
                partial(rates_law, robot, reference, scale=scale),
                reference,
                start,
                times[rows],
                span=span,
                known=known,
                tick=tick,
            )
        for x, samples, held in zip(whole, segment, (here, nothing, nothing), strict=True):
            x[rows] = np.where(undetected, held, samples)
        if state is not None and not last:
            arrivals[end] = State(*map(np.where, [undetected] * 3, (here, nothing, nothing), state))
            start, here = state.q, arrivals[end].q
    return Progression(whole, arrivals)


def rates_law(
    robot: Robot,
    reference: ReferenceTrajectory,
    known: FaultSet,
    scale: JointScale = UNWEIGHTED,
) -> Law:
    """Return the joint velocities that follow a trajectory, as a function of time and posture.

    Parameters
    ----------
    robot, reference :
        The arm and its reference trajectory.
    known :
        Faults known to the controller.
    scale :
        Weights of hinges against slides: the smallest velocities are those of least weighted norm.
    """
    top, orientation = max(reference.top_speed, _SLOWEST), reference.orientation
    speeds = np.array([joint.velocity or np.inf for joint in robot.joints])
    rates = _Rates(*map(scale.weigh_velocity, (speeds, robot.lower, robot.upper)))
    locked = known.mask(robot.n)
    free = known.free_mask(robot.n)
    uncommanded = locked if free is None else locked | free
    none = np.zeros(robot.n, dtype=np.bool_)
    any_locked = bool(locked.any())

    def velocities(t: float, q: Vector) -> Vector:
        R, x, J = tip_pose_and_jacobian(robot, q)
        J, q = scale.weigh_jacobian(J), scale.weigh_velocity(q)  # J̃ and q̃ from here on
        target = reference.at(t)
        x_dot = target.x_dot + _at_most(top, GAIN * (target.x - x))
        turn = None  # angular velocity that corrects the orientation error
        if orientation is not None:
            # Bounded like the tip speed, 1 rad for 1 m: where the orientation cannot be kept,
            # chasing it would drive the arm to postures where the position is lost as well.
            turn = _at_most(top, GAIN * rotation_vector(orientation @ R.T))
        healthy = Svd(J[:3], left_only=True)
        v = scale.weigh_velocity(target.nominal_velocity)
        damped_below = BORDERLINE_RTOL * healthy.s[0]
        v = rates.track_position(healthy, x_dot - healthy.A.dot(v), q, v, damped_below)
        if turn is not None:
            v = rates.track_orientation(J, turn, none, q, v)
        if any_locked:  # Appendix A; a free-swinging joint keeps its planned velocity
            v = np.where(locked, 0.0, v)
            K = without_columns(healthy.A, uncommanded)
            v = rates.track_position(K, x_dot - healthy.A.dot(v), q, v, damped_below)
            if turn is not None:
                v = rates.track_orientation(J, turn, uncommanded, q, v)
        return scale.unweigh_velocity(v)

    return velocities


class _Rates(NamedTuple):
    """Resolved rates within velocity and position limits, each of shape (n,)."""

    speeds: Vector
    low: Vector
    high: Vector

    def bounds(self, q: Vector) -> Bounds:
        """Return the admissible velocities at q; a joint beyond its limit moves back inside."""
        lower = np.maximum(-self.speeds, LIMIT_GAIN * (self.low - q))
        upper = np.minimum(self.speeds, LIMIT_GAIN * (self.high - q))
        return Bounds(np.minimum(lower, self.speeds), np.maximum(upper, -self.speeds))

    def track_position(
        self, K: Svd, missing: Vector, q: Vector, v0: Vector, damped_below: float
    ) -> Vector:
        """Return joint velocities that add the missing tip velocity to v0: `resolved_rates`."""
        v: Vector = v0 + damped_inverse(K, missing, damped_below)
        ahead = q + v / LIMIT_GAIN
        if not ((np.abs(v) > self.speeds) | (ahead > self.high) | (ahead < self.low)).any():
            return v  # the usual case: no bound is active
        return resolved_rates(K, missing, v0, self.bounds(q), damped_below)

    def track_orientation(
        self, J: Matrix, turn: Vector, uncommanded: Mask, q: Vector, v: Vector
    ) -> Vector:
        """Return velocities that also rotate the tip, as far as its position and the bounds allow.

        Position has priority: the rotation uses the null space of the position task (Nakamura
        1991).

        Parameters
        ----------
        J :
            Linear and angular rows, shape (6, n).
        turn :
            Angular velocity of the tip, rad/s, shape (3,).
        uncommanded :
            Joints that cannot be commanded, shape (n,).
        q, v :
            Joint positions, and joint velocities that solve the position task, shape (n,).
        """
        lower, upper = self.bounds(q)
        full = (v >= upper - _AT_BOUND) | (v <= lower + _AT_BOUND)
        fixed = uncommanded | full
        K = without_columns(J[:3], fixed)
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


def _segment(
    law_for: Callable[[FaultSet], Law],
    reference: ReferenceTrajectory,
    q: Vector,
    times: Vector,
    *,
    span: tuple[float, float],
    known: FaultSet,
    tick: Tick,
) -> tuple[Motion, State]:
    """Return the motion at the sample times within a time span, and the state at its end."""
    if not known.in_mode(FaultMode.LOCKED) and (given := reference.motion(times)) is not None:
        last = reference.motion(np.array([span[1]]))
        assert last is not None
        tick(len(times))
        return given, State(*(x[0] for x in last))
    law = law_for(known)
    samples, q_end = _integrate(law, q, times, span, tick)
    v = np.empty_like(samples)
    for i, t in enumerate(times.tolist()):
        v[i] = law(t, samples[i])
    return Motion(samples, v, _accelerations(law, times, samples, v)), _state(law, span[1], q_end)


def _integrate(
    law: Law, q: Vector, times: Vector, span: tuple[float, float], tick: Tick
) -> tuple[Matrix, Vector]:
    """Return the solution of q̇ = g(t, q) at the sample times, (N, n), and at the end, (n,).

    Where g is discontinuous, for example at the workspace boundary where the active joint limit
    switches, adaptive step size control does not converge; fixed small steps bridge these
    intervals.
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
    """Return the solution at the sample times and at the end, by the midpoint rule."""
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
    """Return the time derivative of the velocities, shape (N, n).

    A spline through the velocities is used where it is accurate, at half the cost; near its ends
    and near kinks of the law (a limit becomes active) a forward difference quotient is used.
    """
    a, rough = np.empty_like(v), np.ones(len(t), dtype=np.bool_)
    if len(t) > 4 * _MARGIN and (steps := np.diff(t)).max() <= _DENSE:
        from scipy.interpolate import CubicSpline

        steepest, change = 0.0, np.zeros(len(t) - 2)
        for i, column in enumerate(v.T):  # one by one: a spline takes four times its samples
            slopes = np.diff(column) / steps
            steepest = max(steepest, np.abs(slopes).max())
            change = np.maximum(change, np.abs(np.diff(slopes)))
            a[:, i] = CubicSpline(t, column)(t, 1)
        kinks = change > _KINK * steepest
        rough[1:-1] = np.convolve(kinks, np.ones(2 * _MARGIN + 1), "same") > 0.0
        rough[: _MARGIN + 1] = rough[-_MARGIN - 1 :] = True
    for i in np.flatnonzero(rough).tolist():
        a[i] = (law(t[i] + _QUOTIENT, q[i] + _QUOTIENT * v[i]) - v[i]) / _QUOTIENT
    return a


def _state(law: Law, t: float, q: Vector) -> State:
    """Return the state just before time ``t``, with a backward difference for the acceleration."""
    v = law(t, q)
    return State(q, v, (v - law(t - _QUOTIENT, q - _QUOTIENT * v)) / _QUOTIENT)


def _at_most(size: float, x: Vector) -> Vector:
    """Return x, scaled down to the given norm if it is longer."""
    square = x.dot(x)
    return x if square <= size * size else x * (size / np.sqrt(square))
