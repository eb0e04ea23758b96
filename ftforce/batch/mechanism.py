"""A robot's Pinocchio model as arrays, with its weight: the border between robots and kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ftforce.batch.kernels.layout import Mechanism
from ftforce.core.arrays import read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot


def mechanism_of(
    robot: Robot,
    *,
    gravity: Vector | None = None,
    payload: Payload | None = None,
    weighs: bool = True,
) -> Mechanism:
    """Return the arrays of a robot.

    Every joint's frame is turned so that its axis is z: one kernel serves all types of joints.

    Parameters
    ----------
    robot :
        The arm.
    gravity :
        In the root's axes, m/s², shape (3,); ``None`` takes the model's.
    payload :
        What the tip carries.
    weighs :
        Whether the weight is asked for: otherwise joints that only carry weight are left out.

    Raises
    ------
    InputError
        A joint of the model is no hinge and no slide.
    """
    model, coordinates = robot.model, robot.coordinates
    tip = model.frames[robot.tip_frame]
    path = set(model.supports[tip.parentJoint].tolist())
    kept = [i for i in range(1, model.njoints) if weighs or i in path]
    place = {joint: e for e, joint in enumerate(kept)} | {0: -1}
    turns = {0: np.eye(3)}
    slides, placements = [], []
    for i in kept:
        axis, is_slide = _axis(model, i)
        turns[i] = _turn_to(axis)
        slides.append(is_slide)
        at = model.jointPlacements[i]
        back = turns[model.parents[i]].T
        placements.append(_flat(back @ at.rotation @ turns[i], back @ at.translation))
    back = turns[tip.parentJoint].T
    rows = [model.joints[i].idx_v for i in kept]
    G = coordinates.G[rows]
    drivers = np.abs(G).argmax(axis=1)
    mass, centre = _bodies(robot, kept, turns, payload)
    return Mechanism(
        parent=read_only(np.array([place[model.parents[i]] for i in kept], dtype=np.int64)),
        slides=read_only(np.array(slides)),
        placement=read_only(np.array(placements)),
        driver=read_only(drivers.astype(np.int64)),
        ratio=read_only(G[np.arange(len(rows)), drivers].copy()),
        offset=read_only(coordinates.offset[rows].copy()),
        moves_tip=read_only(np.array([i in path for i in kept])),
        tip=read_only(_flat(back @ tip.placement.rotation, back @ tip.placement.translation)),
        tip_parent=place[tip.parentJoint],
        mass=mass,
        centre=centre,
        gravity=robot.gravity if gravity is None else gravity,
    )


def _axis(model: pin.Model, joint: int) -> tuple[Vector, bool]:
    """Return a joint's axis in its own frame, and whether it slides: its motion subspace says."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    columns = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, model.nv)
    first = model.joints[joint].idx_v
    S = columns[:, first : first + model.joints[joint].nv]
    linear, angular = np.linalg.norm(S[:3]), np.linalg.norm(S[3:])
    if S.shape[1] != 1 or min(linear, angular) > 1e-12:
        raise InputError(f"joint {model.names[joint]!r} is neither a hinge nor a slide")
    is_slide = bool(linear > angular)
    axis: Vector = S[:3, 0] if is_slide else S[3:, 0]
    return axis, is_slide


def _turn_to(axis: Vector) -> Matrix:
    """Return a rotation that takes z to the axis."""
    aligned: Matrix = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).matrix()
    return aligned


def _flat(R: Matrix, p: Vector) -> Vector:
    return np.concatenate([R.ravel(), p])


def _bodies(
    robot: Robot, kept: list[int], turns: dict[int, Matrix], payload: Payload | None
) -> tuple[Vector, Matrix]:
    """Return mass and centre of what each joint carries, in the turned frames."""
    model = robot.model
    tip = model.frames[robot.tip_frame]
    masses, centres = [], []
    for i in kept:
        mass, lever = model.inertias[i].mass, model.inertias[i].lever
        if payload is not None and i == tip.parentJoint:
            place = tip.placement.act(payload.offset)
            total = mass + payload.mass
            lever = (mass * lever + payload.mass * place) / total if total > 0.0 else lever
            mass = total
        masses.append(mass)
        centres.append(turns[i].T @ lever)
    return read_only(np.array(masses)), read_only(np.array(centres))
