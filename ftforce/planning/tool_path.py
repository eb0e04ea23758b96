"""The path of a tool, and the joints that carry it along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.planning.projection import closest, project
from ftforce.planning.target import TipTarget, residual
from ftforce.robot.kinematics import tip_pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.reference import ReferenceTrajectory

    Stack = NDArray[np.float64]

_ITERATIONS = 12  # of Newton's method; successful searches need about five
_DAMPED_ITERATIONS = 60  # likewise, to where the target is closest
_DRAWN, _FOLLOWED = 300, 16  # postures to start from, and how many of the different ones are taken
_APART = 0.1  # rad or m
_LEAP = 0.2  # rad or m: farther from one waypoint to the next, another posture reaches it
_STARTS = 4  # of the search for the closest posture from anywhere


@dataclass(frozen=True, eq=False)
class ToolPath:
    """The path of the tip, with or without its orientation.

    Attributes
    ----------
    robot :
        The arm.
    reference :
        The trajectory whose tip path it is.
    keeps_orientation :
        Whether the orientation is part of it.
    locked :
        True at joints that do not move, shape (n,).
    """

    robot: Robot
    reference: ReferenceTrajectory
    keeps_orientation: bool
    locked: Mask

    def at(self, t: Vector) -> TipTarget:
        """Return the targets of the tip.

        Parameters
        ----------
        t :
            Times, s, shape (k,).
        """
        place = self.reference.tip(t)[0]
        if not self.keeps_orientation:
            return TipTarget.of_each(place, None)
        motion = self.reference.motion(t)
        if motion is None:
            return TipTarget.of_each(place, self.reference.orientation)
        turned = np.array([tip_pose(self.robot, q)[0] for q in motion.q])
        return TipTarget.of_each(place, turned)

    def project(self, q: Matrix, targets: TipTarget) -> tuple[Matrix, Mask]:
        """Move postures to where the tip is at its targets, as `ftforce.planning.projection` does.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        targets :
            The targets.
        """
        return project(self.robot, q, targets, iterations=_ITERATIONS, locked=self.locked)

    def closest(self, q: Matrix, target: TipTarget) -> Vector:
        """Return the posture that comes closest to a target that was not reached, shape (n,).

        Parameters
        ----------
        q :
            Postures that do not reach it, rad or m, shape (k, n).
        target :
            The target.
        """
        missing = np.linalg.norm(residual(self.robot, q, target), axis=1)
        tried = q[np.argsort(missing)[:_STARTS]]
        lower, upper = (
            np.where(self.locked, q[0], x) for x in (self.robot.lower, self.robot.upper)
        )
        return closest(self.robot, tried, target, lower, upper)

    def starts(self, q: Vector, t: float, seed: int) -> Matrix:
        """Return some postures that reach the start of the path, or come close to it, (S, n).

        Parameters
        ----------
        q :
            Posture with the locked joints where they are, rad or m, shape (n,).
        t :
            Time of the start, s.
        seed :
            Seed of the postures from which they are searched for.
        """
        lower, upper = self.robot.ranges
        drawn = lower + np.random.default_rng(seed).random((_DRAWN, self.robot.n)) * (upper - lower)
        target = self.at(np.array([t])).at(0)
        found, reached = self.project(np.where(self.locked, q, drawn), target)
        if not reached.any():
            found, _ = project(
                self.robot, found, target, iterations=_DAMPED_ITERATIONS, locked=self.locked,
                is_damped=True,
            )  # fmt: skip
            far = np.linalg.norm(residual(self.robot, found, target), axis=1)
            reached = far <= 1.01 * far.min()
        found = found[reached]
        _, first = np.unique(np.round(found / _APART), axis=0, return_index=True)
        return found[np.sort(first)[:_FOLLOWED]]

    def followed(self, q: Matrix, t: Vector, velocity: Vector) -> tuple[Stack, NDArray[np.bool_]]:
        """Return paths with the least joint motion from point to point, shape (k, S, n).

        Where an arm does not reach the path in time, it goes on as close as it comes from where it
        is.

        Parameters
        ----------
        q :
            Joint positions near the first point, rad or m, shape (S, n).
        t :
            Times of the points, s, shape (k,).
        velocity :
            Largest joint velocities, rad/s or m/s, shape (n,).

        Returns
        -------
        q :
            The paths, rad or m, shape (k, S, n).
        reached :
            Whether the tip is there, shape (k, S).
        """
        targets = self.at(t)
        paths, reached = np.empty((len(t), *q.shape)), np.empty((len(t), len(q)), dtype=np.bool_)
        for k in range(len(t)):
            moved, is_there = self.project(q, targets.at(k))
            step = np.full(self.robot.n, np.inf)
            if k:
                step = np.minimum(velocity * (t[k] - t[k - 1]), _LEAP)
            is_there &= (np.abs(moved - q) <= step).all(axis=1)
            near, _ = project(
                self.robot, q[~is_there], targets.at(k), iterations=_DAMPED_ITERATIONS,
                locked=self.locked, is_damped=True,
            )  # fmt: skip
            moved[~is_there] = np.clip(near, q[~is_there] - step, q[~is_there] + step)
            paths[k], reached[k] = moved, is_there
            q = moved
        return paths, reached

    def deviation(self, q: Matrix, t: Vector) -> Matrix:
        """Return how far the tip is from its path, m and rad, shape (k, 2).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        t :
            Times, s, shape (k,).
        """
        missing = residual(self.robot, q, self.at(t))
        turn = np.linalg.norm(missing[:, 3:], axis=1)
        return np.column_stack([np.linalg.norm(missing[:, :3], axis=1), turn])


def with_target(targets: TipTarget, k: int, robot: Robot, q: Vector) -> TipTarget:
    """Return targets of which one is where the tip is in a posture.

    Parameters
    ----------
    targets :
        The targets.
    k :
        Index of the one.
    robot, q :
        The arm and the posture, rad or m, shape (n,).
    """
    R, p = tip_pose(robot, q)
    place, turned = targets.position.copy(), targets.rotation
    place[k] = p
    if turned is not None:
        turned = np.broadcast_to(turned, (len(place), 3, 3)).copy()
        turned[k] = R
    return TipTarget.of_each(place, turned)
