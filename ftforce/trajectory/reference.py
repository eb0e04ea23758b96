"""Reference trajectories: a tip path, or a recorded joint motion and the tip path it implies."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from ftforce.robot.kinematics import tip_pose, tip_pose_and_jacobian
from ftforce.trajectory.path import Path, leg_at

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.recording import Recording


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

    def at(self, t: float) -> Target:
        """Return the target at time ``t``, s."""

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

    def __init__(self, robot: Robot, path: Path, q: Vector) -> None:
        self._legs, self._nominal_velocity = path.legs(), robot.at_rest
        self.duration, self.top_speed = path.duration, path.speed
        self.orientation = tip_pose(robot, q)[0] if path.keeps_orientation else None

    def at(self, t: float) -> Target:
        """Return the target at time ``t``, s; the nominal joint velocity is zero."""
        return Target(*leg_at(self._legs, t).at(t), self._nominal_velocity)

    def motion(self, t: Vector) -> None:
        """Return ``None``: inverse kinematics determines the motion."""


class RecordedReference:
    """Reference trajectory that interpolates a recorded motion; time starts at 0.

    Positions of continuous joints are unwrapped, because drivers may report them modulo 2π.

    Parameters
    ----------
    robot :
        The arm.
    recording :
        The recorded motion.
    """

    orientation = None

    def __init__(self, robot: Robot, recording: Recording) -> None:
        from scipy.interpolate import CubicHermiteSpline, CubicSpline

        t, q = recording.t - recording.t[0], recording.q
        endless = np.array([joint.type == "continuous" for joint in robot.joints])
        q = np.where(endless, np.unwrap(q, axis=0), q)
        self._robot, self.duration = robot, recording.duration
        if recording.v is None:
            self._q = CubicSpline(t, q)
            self._v = self._q.derivative()
            self._a = self._v.derivative()
        else:  # a spline through q would only approximate the recorded velocities
            self._q = CubicHermiteSpline(t, q, recording.v)
            self._v = CubicSpline(t, recording.v)
            self._a = self._v.derivative()
        speeds = (np.linalg.norm(self.at(time).x_dot) for time in t.tolist())
        self.top_speed = float(max(speeds))

    def at(self, t: float) -> Target:
        """Return the target at time ``t``, s, from forward kinematics of the recorded motion."""
        q, v = self._q(t), self._v(t)
        _, x, J = tip_pose_and_jacobian(self._robot, q)
        return Target(x, J[:3].dot(v), v)

    def motion(self, t: Vector) -> Motion:
        """Return the recorded joint motion at times ``t``.

        Parameters
        ----------
        t :
            Times, s, shape (N,).
        """
        return Motion(self._q(t), self._v(t), self._a(t))
