"""Reference trajectories: a tip path, or a recorded joint motion and the tip path it implies."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from ftforce.core.smoothing import Spline, noise_of, uncertainty_of
from ftforce.robot.kinematics import tip_pose, tip_pose_and_jacobian
from ftforce.trajectory.path import Path, leg_at

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.smoothing import Noise
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.recording import Recording

_AT_ONCE = 4096  # instants of a recording, whose splines are evaluated together


class Target(NamedTuple):
    """Reference of the tip at one instant, in root axes.

    Attributes
    ----------
    x, x_dot :
        Position, m, and velocity, m/s, shape (3,).
    nominal_velocity :
        Joint velocities that the solution stays close to, shape (n,).
    """

    x: Vector
    x_dot: Vector
    nominal_velocity: Vector


class Motion(NamedTuple):
    """Joint positions, velocities and accelerations over time, each of shape (N, n)."""

    q: Matrix
    v: Matrix
    a: Matrix


class Smoothing(NamedTuple):
    """How a recording was smoothed, per joint, shape (n,).

    Attributes
    ----------
    spacing :
        Time between the knots of the splines, s; 0 where the samples are interpolated.
    residual :
        Root mean square of recorded minus smoothed positions, rad or m.
    noise :
        Standard deviation of the noise found in the positions, rad or m; 0 where none was found.
    acceleration_noise :
        Uncertainty that noise leaves in the accelerations: their standard deviation, rad/s² or
        m/s², in the middle and at the worse end, shape (2, n).
    """

    spacing: Vector
    residual: Vector
    noise: Vector
    acceleration_noise: Vector


class ReferenceTrajectory(Protocol):
    """A trajectory for the arm to follow."""

    @property
    def duration(self) -> float:
        """Duration, s."""

    @property
    def top_speed(self) -> float:
        """Largest tip speed, m/s."""

    @property
    def orientation(self) -> Matrix | None:
        """Tip orientation to keep, shape (3, 3); ``None`` if it is unconstrained."""

    @property
    def smoothing(self) -> Smoothing | None:
        """How a recording was smoothed; ``None`` for a path."""

    def at(self, t: float) -> Target:
        """Return the target at time ``t``, s."""

    def tip(self, t: Vector) -> tuple[Matrix, Matrix]:
        """Return positions, m, and velocities, m/s, of the tip at times ``t``, shape (N, 3).

        Parameters
        ----------
        t :
            Times, s, shape (N,).
        """

    def motion(self, t: Vector) -> Motion | None:
        """Return the joint motion at times ``t``; ``None`` if only the tip path is prescribed.

        Parameters
        ----------
        t :
            Times, s, shape (N,).
        """


class PathReference:
    """Reference trajectory along a path of the tip.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The path.
    q :
        Joint positions at its start, rad or m, shape (n,).
    """

    smoothing = None

    def __init__(self, robot: Robot, path: Path, q: Vector) -> None:
        self._legs, self._nominal_velocity = path.legs(), robot.at_rest
        self.duration, self.top_speed = path.duration, path.speed
        self.orientation = tip_pose(robot, q)[0] if path.keeps_orientation else None

    def at(self, t: float) -> Target:
        """Return the target at time ``t``, s; the nominal joint velocity is zero."""
        return Target(*leg_at(self._legs, t).at(t), self._nominal_velocity)

    def tip(self, t: Vector) -> tuple[Matrix, Matrix]:
        """Return positions, m, and velocities, m/s, of the tip at times ``t``, shape (N, 3).

        Parameters
        ----------
        t :
            Times, s, shape (N,).
        """
        x, x_dot = np.empty((2, len(t), 3))
        for i, time in enumerate(t.tolist()):
            x[i], x_dot[i], _ = self.at(time)
        return x, x_dot

    def motion(self, t: Vector) -> None:
        """Return ``None``: inverse kinematics determines the motion."""


class RecordedReference:
    """Reference trajectory along a recorded motion; time starts at 0.

    Positions of continuous joints are unwrapped, because drivers may report them modulo 2π.

    Parameters
    ----------
    robot :
        The arm.
    recording :
        The recorded motion.
    smooth :
        Time between the knots of the splines, s; 0 interpolates the samples. By default it follows
        from the noise found (`ftforce.core.smoothing`).

    Attributes
    ----------
    smoothing :
        How the recording was smoothed.
    """

    orientation = None

    def __init__(self, robot: Robot, recording: Recording, smooth: float | None = None) -> None:
        t, q, v = recording.t - recording.t[0], recording.q, recording.v
        endless = np.array([joint.type == "continuous" for joint in robot.joints])
        if endless.any():
            q = np.where(endless, np.unwrap(q, axis=0), q)
        self._robot, self.duration, self._t = robot, recording.duration, t
        place = _noise(t, q, smooth)
        self._q = self._v = Spline(t, q, place.spacing, place.ratio)
        self._rated = np.zeros(robot.n, dtype=np.bool_)  # whether recorded velocities count
        unsure = uncertainty_of(t, place, 2)
        if v is not None:
            rates = _noise(t, v, smooth)
            self._v = Spline(t, v, rates.spacing, rates.ratio)
            other = uncertainty_of(t, rates, 1)
            self._rated = other[0] <= unsure[0]
            unsure = np.where(self._rated, other, unsure)
            if not place.spacing.any() and not rates.spacing.any():
                self._q = _through(t, q, v)
        residual = np.sqrt(np.mean((self._q(t) - q) ** 2, axis=0))
        self.smoothing = Smoothing(place.spacing, residual, place.level, unsure)

    @cached_property
    def top_speed(self) -> float:
        """Largest tip speed at the samples, m/s."""
        return float(max(map(np.linalg.norm, self.tip(self._t)[1])))

    def at(self, t: float) -> Target:
        """Return the target at time ``t``, s, from forward kinematics of the recorded motion."""
        q, v = self._q(t), self._derivative(t, 1)
        _, x, J = tip_pose_and_jacobian(self._robot, q)
        return Target(x, J[:3].dot(v), v)

    def tip(self, t: Vector) -> tuple[Matrix, Matrix]:
        """Return positions, m, and velocities, m/s, of the tip at times ``t``, shape (N, 3).

        Parameters
        ----------
        t :
            Times, s, shape (N,).
        """
        x, x_dot = np.empty((2, len(t), 3))
        for start in range(0, len(t), _AT_ONCE):
            times = t[start : start + _AT_ONCE]
            motion = zip(self._q(times), self._derivative(times, 1), strict=True)
            for i, (q, v) in enumerate(motion, start):
                _, x[i], J = tip_pose_and_jacobian(self._robot, q)
                x_dot[i] = J[:3].dot(v)
        return x, x_dot

    def motion(self, t: Vector) -> Motion:
        """Return the recorded joint motion at times ``t``.

        Parameters
        ----------
        t :
            Times, s, shape (N,).
        """
        return Motion(self._q(t), self._derivative(t, 1), self._derivative(t, 2))

    def _derivative(self, t: Vector | float, order: int) -> Any:
        """Return velocities or accelerations, from what leaves accelerations the least noise."""
        found = self._q(t, order)
        if self._rated.any():
            found = np.where(self._rated, self._v(t, order - 1), found)
        return found


def _noise(t: Vector, x: Matrix, smooth: float | None) -> Noise:
    """Return the noise of samples, for a spline with the knots that were asked for."""
    noise = noise_of(t, x)
    if smooth is None:
        return noise
    if smooth == 0.0:
        return noise._replace(spacing=np.zeros(x.shape[1]))
    return noise_of(t, x, smooth)._replace(level=noise.level)


def _through(t: Vector, q: Matrix, v: Matrix) -> Any:
    """Return a spline that has the recorded positions and velocities."""
    from scipy.interpolate import CubicHermiteSpline

    return CubicHermiteSpline(t, q, v)


def smoothing_in_words(robot: Robot, smoothing: Smoothing, spacing: float | None) -> str:
    """Say how a recording was smoothed, by whose choice, and what else can be chosen.

    Parameters
    ----------
    robot :
        The arm.
    smoothing :
        How it was smoothed.
    spacing :
        Time between knots that was asked for, s; ``None`` if it follows from the noise.
    """
    noise = _largest_in_words(robot, smoothing.noise)
    if not smoothing.spacing.any():
        found = f"noise of {noise}" if smoothing.noise.any() else "no noise"
        return f"samples interpolated; {found} found in the recording (--smooth, --static)"
    used = smoothing.spacing[smoothing.spacing > 0.0]
    low, high = f"{used.min():.2g}", f"{used.max():.2g}"
    apart = f"{low} s apart" if low == high else f"{low} to {high} s apart"
    why = "by maximum likelihood" if spacing is None else "as asked for"
    some = "" if smoothing.spacing.all() else " (joints without noise are interpolated)"
    return (
        f"recording smoothed by splines with knots {apart}, {why}{some}: noise of {noise}, "
        f"residual (rms) of {_largest_in_words(robot, smoothing.residual)} "
        "(--smooth SECONDS or none, --static)"
    )


def _largest_in_words(robot: Robot, sizes: Vector) -> str:
    """Format the largest of some position errors, of turning and of sliding joints."""
    by_unit: dict[str, float] = {}
    for joint, size in zip(robot.joints, sizes.tolist(), strict=True):
        by_unit[joint.unit] = max(by_unit.get(joint.unit, 0.0), size)
    return " and ".join(f"up to {size:.2g} {unit}" for unit, size in by_unit.items())
