"""Tip pose and Jacobians, computed by Pinocchio.

All functions on a robot share one `pin.Data` per thread, which the next call overwrites: what they
return is copied, and nothing outside `ftforce.robot` reads that data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.task import Axes, Task
    from ftforce.robot.robot import Robot

# Rows of Pinocchio's WORLD Jacobian do not map forces at the tip (docs/conventions).
_FRAMES = {"tool": pin.LOCAL, "world": pin.LOCAL_WORLD_ALIGNED}


def tip_pose(robot: Robot, q: Vector) -> tuple[Matrix, Vector]:
    """Return the rotation matrix (3, 3) and position (3,), in m, of the tip in root axes.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    """
    model, data = robot.model, robot.data
    pin.framesForwardKinematics(model, data, robot.to_model(q))
    pose = data.oMf[robot.tip_frame]
    return pose.rotation.copy(), pose.translation.copy()


def joint_frames(robot: Robot, q: Vector) -> tuple[tuple[Matrix, Vector], ...]:
    """Return rotation matrix (3, 3) and position (3,), in m, of every joint of the model.

    In root axes, root first; all joints of the model are included, followers too.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions along the chain, rad or m, shape (n,).
    """
    model, data = robot.model, robot.data
    pin.forwardKinematics(model, data, robot.to_model(q))
    return tuple((pose.rotation.copy(), pose.translation.copy()) for pose in data.oMi)


def reach_bound(robot: Robot) -> tuple[Vector, float]:
    """Return the position of the first joint, shape (3,), and an upper bound on the reach, in m.

    The tip is never farther from the first joint than this bound, the total length of the links.
    The bound is infinite if a prismatic joint has no limits.
    """
    model = robot.model
    places = [placement.translation for placement in model.jointPlacements.tolist()[1:]]
    links = [*places[1:], model.frames[robot.tip_frame].placement.translation]
    slides = 0.0
    for joint in robot.joints:
        if joint.type == "prismatic":  # each follower adds the same travel, scaled below
            slides += max(abs(joint.lower), abs(joint.upper)) * (1 + len(joint.followers))
    scale = np.abs(robot.coordinates.G).max(initial=1.0)
    length = float(sum(map(np.linalg.norm, links))) + slides * scale
    return places[0].copy(), length + float(np.abs(robot.coordinates.offset).sum())


def quaternion(R: Matrix) -> Vector:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix; its sign is arbitrary.

    Parameters
    ----------
    R :
        Rotation matrix, shape (3, 3).
    """
    turn = pin.Quaternion(R)
    coefficients: Vector = turn.coeffs().copy()  # coeffs is a view into the quaternion
    return coefficients


def rotation_vector(R: Matrix) -> Vector:
    """Return the rotation vector (axis times angle, rad) of a rotation matrix, shape (3,).

    Parameters
    ----------
    R :
        Rotation matrix, shape (3, 3).
    """
    vector: Vector = pin.log3(R)
    return vector


def frame_jacobian(robot: Robot, q: Vector, axes: Axes = "tool") -> Matrix:
    """Return the frame Jacobian at the tip, linear rows first, shape (6, n).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    axes :
        ``tool``: axes of the tip frame; ``world``: axes of the root, at the tip point.
    """
    J = pin.computeFrameJacobian(
        robot.model, robot.data, robot.to_model(q), robot.tip_frame, _FRAMES[axes]
    )
    return robot.coordinates.fold(J)


def tip_pose_and_jacobian(robot: Robot, q: Vector) -> tuple[Matrix, Vector, Matrix]:
    """Return the tip pose, as `tip_pose`, and the frame Jacobian in root axes, shape (6, n).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    """
    model, data = robot.model, robot.data
    J = pin.computeFrameJacobian(
        model, data, robot.to_model(q), robot.tip_frame, pin.LOCAL_WORLD_ALIGNED
    )  # also updates the tip placement
    pose = data.oMf[robot.tip_frame]
    return pose.rotation.copy(), pose.translation.copy(), robot.coordinates.fold(J)


def task_jacobian(robot: Robot, q: Vector, task: Task) -> Matrix:
    """Return the unweighted task Jacobian (m/rad and rad/rad; m/m if prismatic), shape (m, n).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    task :
        The task.
    """
    return np.ascontiguousarray(frame_jacobian(robot, q, task.axes)[task.rows])
