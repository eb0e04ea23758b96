"""Tip pose and Jacobians, computed by Pinocchio.

All functions on a robot share one `pin.Data` per thread, which the next call overwrites: what they
return is copied, and nothing outside ``ftforce.robot`` reads that data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.task import Axes, Task
    from ftforce.robot.robot import Robot

# Rows of Pinocchio's WORLD Jacobian do not map forces at the tip (docs/conventions).
_FRAMES = {"tool": pin.LOCAL, "world": pin.LOCAL_WORLD_ALIGNED}

_PRISMATIC = ("PX", "PY", "PZ", "Prismatic")  # Pinocchio's short names of prismatic joints
_NOISE = 1e-9  # theory §2.6: relative to the six-row Jacobian, lengths in units of the arm's reach
_floors: WeakKeyDictionary[Robot, tuple[float, float]] = WeakKeyDictionary()  # cached per robot


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

    The tip is never farther from the first joint than this bound, the total length of the links and
    of the travel of all prismatic joints, followers included. The bound is infinite if one of them
    has no limits.

    Parameters
    ----------
    robot :
        The arm.
    """
    model, coordinates = robot.model, robot.coordinates
    start = model.jointPlacements[1].translation
    travel = 0.0
    for joint in model.joints.tolist()[1:]:
        if joint.shortname().removeprefix("JointModel").startswith(_PRISMATIC):
            ratios, offset = coordinates.G[joint.idx_v], coordinates.offset[joint.idx_v]
            own = np.flatnonzero(ratios)
            ends = ratios[own] * np.stack([robot.lower[own], robot.upper[own]])
            lowest, highest = (float(end.sum() + offset) for end in (ends.min(0), ends.max(0)))
            travel += max(abs(lowest), abs(highest))
    return start.copy(), _link_length(robot) + travel


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


def frame_jacobians(robot: Robot, q: Matrix, axes: Axes = "tool") -> NDArray[np.float64]:
    """Return the Jacobians of `frame_jacobian` in N postures, shape (N, 6, n).

    Parameters
    ----------
    robot, axes :
        As in `frame_jacobian`.
    q :
        Joint positions, rad or m, shape (N, n).
    """
    model, data, tip, frame = robot.model, robot.data, robot.tip_frame, _FRAMES[axes]
    found = np.empty((len(q), 6, model.nv))
    for J, configuration in zip(found, robot.coordinates.to_models(q), strict=True):
        J[:] = pin.computeFrameJacobian(model, data, configuration, tip, frame).reshape(J.shape)
    return found if robot.coordinates.is_identity else found @ robot.coordinates.G


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
    pose = data.oMf[robot.tip_frame].homogeneous  # a copy, and faster than two of its parts
    return pose[:3, :3], pose[:3, 3], robot.coordinates.fold(J)


def task_jacobian(robot: Robot, q: Vector, task: Task) -> Matrix:
    """Return the unweighted task Jacobian (m/rad and rad/rad; m/m if prismatic), shape (m, n).

    It is zero where it holds nothing but rounding errors, see `without_noise`.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    task :
        The task.
    """
    J = np.ascontiguousarray(frame_jacobian(robot, q, task.axes)[task.rows])
    return without_noise(robot, J, task)


def without_noise(robot: Robot, J: Matrix, task: Task) -> Matrix:
    """Return a task Jacobian, or zeros if it holds nothing but rounding errors (theory §2.6).

    All ranks are relative to σ_max(J). Without this floor, an arm that does not move its tip along
    the task at all would have full rank, thanks to entries of 1e-17.

    Parameters
    ----------
    robot :
        The arm.
    J :
        Task Jacobian, unweighted, shape (m, n).
    task :
        The task.
    """
    linear, angular = noise_floor(robot)
    floor = max(linear, angular)
    if np.vdot(J, J) > J.size * floor * floor:  # the usual case: some entry is above the floor
        return J
    floors = [linear if name[0] == "f" else angular for name in task.components]
    return J if (np.abs(J).max(axis=1) > floors).any() else np.zeros_like(J)


def noise_floor(robot: Robot) -> tuple[float, float]:
    """Return the entries up to which a task Jacobian is rounding: of linear and angular rows.

    A revolute joint moves the tip by 1 rad/rad, and by at most the arm's reach per rad; a prismatic
    joint by 1 m/m.

    Parameters
    ----------
    robot :
        The arm.
    """
    if (found := _floors.get(robot)) is None:
        turns = any(joint.type != "prismatic" for joint in robot.joints)
        reach = _link_length(robot) if turns else 1.0
        found = _floors[robot] = (_NOISE * (reach or 1.0), _NOISE)
    return found


def _link_length(robot: Robot) -> float:
    model = robot.model
    places = [placement.translation for placement in model.jointPlacements.tolist()[2:]]
    links = [*places, model.frames[robot.tip_frame].placement.translation]
    return float(sum(map(np.linalg.norm, links)))
