"""Which side of its base an arm is free to move on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import read_only
from ftforce.robot.kinematics import joint_frames, tip_pose

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

_SLACK = 1e-3  # m
_NEAR = 0.25  # of the distance of the tip from the first joint


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """The base plane of an arm, and the side of it that is free.

    The plane is horizontal (perpendicular to the model's gravity, in root axes) and goes through
    the origin of the base link. The free side is above it; below it for an arm that hangs: one
    whose first joint lies below it, or whose second does wherever the first is turned.

    Attributes
    ----------
    robot :
        The arm.
    base :
        Origin of the base link in root axes, m, shape (3,).
    up :
        Unit vector towards the free side, in root axes, shape (3,).
    """

    robot: Robot
    base: Vector
    up: Vector

    @classmethod
    def of(cls, robot: Robot) -> Mounting:
        """Return the mounting of an arm.

        Parameters
        ----------
        robot :
            The arm.
        """
        g = robot.gravity
        up = -g / np.linalg.norm(g) if g.any() else np.array([0.0, 0.0, 1.0])
        frame = robot.model.getFrameId(robot.base, pin.FrameType.BODY)
        joint_frames(robot, robot.at_rest)
        base = pin.updateFramePlacement(robot.model, robot.data, frame).translation.copy()
        turned = robot.at_rest.copy()
        turned[0] = 1.0
        here, there = ((_origins(robot, q)[:2] - base) @ up for q in (robot.at_rest, turned))
        fixed = here[np.abs(here - there) <= 1e-6]
        hangs = bool(fixed.size) and fixed[np.abs(fixed).argmax()] < -_SLACK
        return cls(robot, read_only(base), read_only(-up if hangs else up))

    def heights(self, q: Vector) -> Vector:
        """Return the heights of the joints and the tip above the base plane, m.

        Of those that move the tip, from the base on; negative on the side that is not free.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        heights: Vector = (_origins(self.robot, q) - self.base) @ self.up
        return heights

    def is_clear(self, q: Vector) -> bool:
        """Return whether the arm stays on the free side and the tip keeps away from the base.

        The tip keeps away if it is at least a quarter as far from the line from the base over the
        first to the second joint as it can be from the first joint (the length of the links beyond
        it). For arms of one or two joints only the side counts.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        points = _origins(self.robot, q)
        heights = (points - self.base) @ self.up
        if heights[1:].min() < min(0.0, heights[0]) - _SLACK:
            return False
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        column = (self.base, points[0], points[1])
        return self.robot.n < 3 or _distance(points[-1], column) >= _NEAR * length


def _origins(robot: Robot, q: Vector) -> Matrix:
    """Return the positions of the joints that move the tip, and of the tip, in root axes."""
    model = robot.model
    moving = model.supports[model.frames[robot.tip_frame].parentJoint].tolist()[1:]
    tip, frames = tip_pose(robot, q)[1], joint_frames(robot, q)
    return np.array([*(frames[joint][1] for joint in moving), tip])


def _distance(point: Vector, line: tuple[Vector, ...]) -> float:
    """Return the distance of a point from a line through several points."""
    distances = []
    for a, b in pairwise(line):
        along = b - a
        share = (point - a).dot(along) / max(float(along.dot(along)), 1e-12)
        nearest = a + min(max(share, 0.0), 1.0) * along
        distances.append(float(np.linalg.norm(point - nearest)))
    return min(distances)
