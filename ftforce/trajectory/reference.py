"""What an arm is to follow: a path of its tip, or a recorded motion and the path its tip takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from ftforce.robot.kinematics import frame_jacobian, tip_pose
from ftforce.trajectory.path import Path, leg_at

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.recording import Recording


class Target(NamedTuple):
    """Where the tip should be at a time, and how fast; in the root's axes.

    Attributes
    ----------
    x, x_dot :
        Position, m, and velocity, m/s, shape (3,).
    nominal_velocity :
        Joint velocities to stay close to, shape (n,).
    """

    x: Vector
    x_dot: Vector
    nominal_velocity: Vector


class Motion(NamedTuple):
    """Joint positions, velocities and accelerations over time, rad or m, shape (N, n) each."""

    q: Matrix
    v: Matrix
    a: Matrix


class ReferenceTrajectory(Protocol):
    """What an arm is to follow."""

    @property
    def duration(self) -> float:
        """How long it takes, s."""

    @property
    def top_speed(self) -> float:
        """Largest speed of the tip, m/s."""

    @property
    def orientation(self) -> Matrix | None:
        """Orientation that the tip keeps, (3, 3); ``None`` if it may turn."""

    def at(self, t: float) -> Target:
        """Return the target at a time, s."""

    def motion(self, t: Vector) -> Motion | None:
        """Return the motion of all joints, ``None`` where only the tip's is given."""


class PathReference:
    """A path of the tip.

    Parameters
    ----------
    path :
        The path.
    q :
        Joint positions at its start, shape (n,).
    """

    def __init__(self, robot: Robot, path: Path, q: Vector) -> None:
        self._legs, self._preferred = path.legs(), robot.at_rest
        self.duration, self.top_speed = path.duration, path.speed
        self.orientation = tip_pose(robot, q)[0] if path.keeps_orientation else None

    def at(self, t: float) -> Target:
        """Return the target; no joint velocity is preferred to rest."""
        return Target(*leg_at(self._legs, t).at(t), self._preferred)

    def motion(self, t: Vector) -> None:
        """Return nothing: inverse kinematics finds the motion."""


class RecordedReference:
    """A recorded motion, splined; its time begins at 0.

    Angles of continuous joints may jump by whole turns, as drivers report them.
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
        else:  # as recorded: the derivative of a spline through q is only close to it
            self._q = CubicHermiteSpline(t, q, recording.v)
            self._v = CubicSpline(t, recording.v)
            self._a = self._v.derivative()
        speeds = (np.linalg.norm(self.at(time).x_dot) for time in t.tolist())
        self.top_speed = float(max(speeds))

    def at(self, t: float) -> Target:
        """Return where the recorded motion has the tip."""
        q, v = self._q(t), self._v(t)
        J = frame_jacobian(self._robot, q, "world")  # places the tip, too
        x = self._robot.data.oMf[self._robot.tip_frame].translation.copy()
        return Target(x, J[:3].dot(v), v)

    def motion(self, t: Vector) -> Motion:
        """Return the recorded motion."""
        return Motion(self._q(t), self._v(t), self._a(t))
