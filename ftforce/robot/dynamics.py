"""Gravity torques, motion torques and mass matrix of an arm with a payload (eq. 20, 21).

``rnea(q, v, a) = M(q) a + V(q, v) v + G(q)`` is split into the gravity torques G and the motion
torques, so that gravity can be set without modifying the model, which threads share.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import Matrix, Vector, as_floats, as_vector, read_only
from ftforce.errors import InputError
from ftforce.io.text import LARGEST_NUMBER
from ftforce.robot.kinematics import tip_pose_and_jacobian

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.core.limits import DriveTerms
    from ftforce.robot.robot import Robot

_NUMBER = r"-?\d[\d.e+-]*"
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_TRIANGLE = 1e-6  # relative: rounded moments of a flat body may exceed the triangle inequality
_ROUNDING = 1e-14  # smaller inertias, relative to the arm's largest, count as zero


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """A rigid body, or a point mass, fixed to the tip.

    Attributes
    ----------
    mass :
        Mass in kg.
    offset :
        Centre of mass in the tip frame, m, shape (3,).
    inertia :
        Inertia about the centre of mass in the axes of the tip frame, kg·m², shape (3, 3); ``None``
        for a point mass.
    """

    mass: float
    offset: Vector
    inertia: Matrix | None = None

    @classmethod
    def of(
        cls,
        mass: float,
        offset: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
    ) -> Payload:
        """Return a validated payload.

        Parameters
        ----------
        mass :
            Mass in kg, 0 or more.
        offset :
            Centre of mass in the tip frame, m, shape (3,).
        inertia :
            Inertia about the centre of mass in the axes of the tip frame, kg·m²: the moments
            ixx, iyy, izz, ixy, ixz, iyz, shape (6,), or a symmetric matrix, shape (3, 3).

        Raises
        ------
        InputError
            The mass is negative, or the offset is not three numbers, or a number is not finite or
            too large, or no rigid body has such an inertia.
        """
        if isinstance(mass, bool) or not isinstance(mass, (int, float, np.floating, np.integer)):
            raise InputError(f"the payload needs a mass in kg, got {mass!r}")
        try:
            mass = float(mass)
        except OverflowError:  # an integer that no float holds
            mass = math.inf
        if not (math.isfinite(mass) and mass >= 0.0):
            raise InputError(f"the payload's mass must be 0 kg or more, got {mass:g}")
        place = as_vector(offset, 3, "the payload's position", "x, y, z in m")
        if mass > LARGEST_NUMBER or np.abs(place).max() > LARGEST_NUMBER:
            raise InputError(
                f"the payload must not exceed {LARGEST_NUMBER:g} kg or lie farther than "
                f"{LARGEST_NUMBER:g} m from the tip, got {mass:g} kg at {place} m"
            )
        return cls(mass, place, None if inertia is None else _checked_inertia(inertia, mass))

    @property
    def moments(self) -> tuple[float, ...]:
        """The moments ixx, iyy, izz, ixy, ixz, iyz, kg·m²; empty for a point mass."""
        if self.inertia is None:
            return ()
        return tuple(float(self.inertia[i, j]) for i, j in _PLACES)

    def __str__(self) -> str:
        """Return the mass, the position if it is not the tip, and the inertia if it has one."""
        place = ", ".join(f"{x:g}" for x in self.offset.tolist())
        moments = ", ".join(f"{x:g}" for x in self.moments)
        return (
            f"{self.mass:g} kg"
            + (f" at ({place}) m" if self.offset.any() else "")
            + (f", inertia ({moments}) kg·m²" if moments else "")
        )


def _checked_inertia(inertia: ArrayLike, mass: float) -> Matrix:
    """Return the inertia of a rigid body as a matrix."""
    values = as_floats(inertia, "the payload's inertia")
    if values.shape == (6,):
        values = values[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    if values.shape != (3, 3):
        raise InputError(
            f"the payload's inertia needs the moments {', '.join(MOMENTS)} (kg·m²) or a 3 x 3 "
            f"matrix, got an array of shape {values.shape}"
        )
    if not np.isfinite(values).all() or np.abs(values).max() > LARGEST_NUMBER:
        raise InputError(f"the payload's inertia must not exceed {LARGEST_NUMBER:g} kg·m²")
    if not np.array_equal(values, values.T):
        raise InputError("the payload's inertia is not symmetric")
    least, middle, most = np.linalg.eigvalsh(values).tolist()  # principal moments
    if not (mass > 0.0 and least > 0.0 and least + middle >= (1.0 - _TRIANGLE) * most):
        raise InputError(
            "no rigid body has the payload's inertia: its principal moments are "
            f"{least:.4g}, {middle:.4g} and {most:.4g} kg·m²; all must be positive, and none may "
            "exceed the sum of the other two; products of inertia have the sign of the matrix's "
            "elements"
            if mass > 0.0
            else "a payload of no mass has no inertia"
        )
    return read_only(values)


class CarriedPayload:
    """Base of settings that store a payload as text and as numbers."""

    __slots__ = ()
    payload: str | None
    payload_mass: float | None
    payload_offset: tuple[float, ...]
    payload_inertia: tuple[float, ...]

    @property
    def carried(self) -> Payload | None:
        """The payload; ``None`` if the tip carries nothing.

        Of a result that an older version stored, with six digits.
        """
        if self.payload_mass is not None:
            inertia = self.payload_inertia or None
            return Payload.of(self.payload_mass, self.payload_offset, inertia)
        mass, *offset = map(float, re.findall(_NUMBER, self.payload or "0"))
        return Payload.of(mass, offset or np.zeros(3)) if self.payload else None


def numbers_of(payload: Payload | None) -> dict[str, Any]:
    """Return the numbers of a payload as arguments of a setting.

    Parameters
    ----------
    payload :
        The payload; ``None`` for none.
    """
    if payload is None:
        return {}
    return {
        "payload_mass": payload.mass,
        "payload_offset": tuple(payload.offset.tolist()),
        "payload_inertia": payload.moments,
    }


def weight_torque(
    robot: Robot, q: Vector, gravity: Vector | None = None, payload: Payload | None = None
) -> Vector:
    """Return the gravity torques G(q), N·m (N), shape (n,).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    gravity :
        Gravity in root axes, m/s², shape (3,); ``None`` for that of the model.
    payload :
        Payload at the tip.
    """
    model, data = robot.model, robot.data
    configuration = robot.to_model(q)
    if gravity is None:
        torque = robot.coordinates.fold_torque(
            pin.computeGeneralizedGravity(model, data, configuration)
        )
    elif robot.mass == 0.0:  # the centre of mass is undefined
        torque = np.zeros(robot.n)
    else:
        J_com = pin.jacobianCenterOfMass(model, data, configuration)
        torque = -data.mass[0] * gravity.dot(robot.coordinates.fold(J_com))
    if payload is not None:
        down = robot.gravity if gravity is None else gravity
        torque = torque - payload.mass * down.dot(payload_jacobian(robot, q, payload))
    return read_only(torque)


def motion_torque(
    robot: Robot,
    q: Vector,
    v: Vector,
    a: Vector,
    payload: Payload | None = None,
    *,
    drives: DriveTerms | None = None,
) -> Vector:
    """Return the motion torques M(q) a + V(q, v) v, N·m (N), shape (n,).

    Parameters
    ----------
    robot :
        The arm.
    q, v, a :
        Joint positions (rad, m), velocities (per s) and accelerations (per s²), shape (n,).
    payload :
        Payload at the tip.
    drives :
        Friction and rotor inertia of the joints; ``None`` if they do not count.
    """
    model, data, fold = robot.model, robot.data, robot.coordinates
    configuration = robot.to_model(q)
    v_model, a_model = fold.rate(v), fold.rate(a)
    weight = pin.computeGeneralizedGravity(model, data, configuration).copy()
    torque = fold.fold_torque(pin.rnea(model, data, configuration, v_model, a_model) - weight)
    if payload is not None:
        acceleration = payload_acceleration(robot, q, v, a, payload)
        torque = torque + payload.mass * acceleration.dot(payload_jacobian(robot, q, payload))
        if payload.inertia is not None:
            torque = torque + _turning_torque(robot, q, v, a, payload.inertia)
    return read_only(torque if drives is None else torque + drives.torque(v, a))


def _turning_torque(robot: Robot, q: Vector, v: Vector, a: Vector, inertia: Matrix) -> Vector:
    """Return the torques J_ωᵀ (I α + ω × I ω) that turn a body at the tip, shape (n,)."""
    model, data, frame, fold = robot.model, robot.data, robot.tip_frame, robot.coordinates
    pin.forwardKinematics(model, data, robot.to_model(q), fold.rate(v), fold.rate(a))
    pin.updateFramePlacement(model, data, frame)
    R = data.oMf[frame].rotation.copy()
    axes = pin.LOCAL
    omega = pin.getFrameVelocity(model, data, frame, axes).angular.copy()
    alpha = pin.getFrameAcceleration(model, data, frame, axes).angular.copy()
    moment = inertia.dot(alpha) + np.cross(omega, inertia.dot(omega))  # tip axes
    J = tip_pose_and_jacobian(robot, q)[2]
    torque: Vector = R.dot(moment).dot(J[3:])
    return torque


def rnea_torque(
    robot: Robot,
    q: Vector,
    v: Vector,
    a: Vector,
    *,
    gravity: Vector | None = None,
    payload: Payload | None = None,
    drives: DriveTerms | None = None,
) -> Vector:
    """Return the gravity and motion torques together (eq. 20), N·m (N), shape (n,).

    Parameters
    ----------
    robot, q, v, a, payload, drives :
        As in `motion_torque`.
    gravity :
        As in `weight_torque`.
    """
    if gravity is not None or payload is not None:
        return read_only(
            weight_torque(robot, q, gravity, payload)
            + motion_torque(robot, q, v, a, payload, drives=drives)
        )
    fold = robot.coordinates
    torque = pin.rnea(robot.model, robot.data, robot.to_model(q), fold.rate(v), fold.rate(a))
    torque = fold.fold_torque(torque)
    return read_only(torque if drives is None else torque + drives.torque(v, a))


def rnea_torques(
    robot: Robot,
    q: Matrix,
    v: Matrix,
    a: Matrix,
    *,
    gravity: Vector | None = None,
    payload: Payload | None = None,
    drives: DriveTerms | None = None,
) -> Matrix:
    """Return the torques of `rnea_torque` for N motions, N·m (N), shape (N, n).

    Parameters
    ----------
    robot, gravity, payload, drives :
        As in `rnea_torque`.
    q, v, a :
        Joint positions, velocities and accelerations, shape (N, n).
    """
    fold, model, data = robot.coordinates, robot.model, robot.data
    if gravity is not None or payload is not None:
        model = _loaded_model(robot, gravity, payload)
        data = model.createData()
    added = 0.0 if drives is None else drives.torque(v, a)
    q = fold.to_models(q)
    if not fold.is_identity:
        v, a = v @ fold.G.T, a @ fold.G.T
    torques = np.empty(v.shape)
    for torque, *motion in zip(torques, q, v, a, strict=True):
        torque[:] = pin.rnea(model, data, *motion)
    return (torques if fold.is_identity else torques @ fold.G) + added


def _loaded_model(robot: Robot, gravity: Vector | None, payload: Payload | None) -> pin.Model:
    """Return a copy of the model with another gravity and a payload."""
    model = robot.model.copy()
    if gravity is not None:
        model.gravity.linear = gravity
    if payload is not None:
        tip = model.frames[robot.tip_frame]
        inertia = np.zeros((3, 3)) if payload.inertia is None else payload.inertia
        body = pin.Inertia(payload.mass, payload.offset, inertia)
        model.appendBodyToJoint(tip.parentJoint, body, tip.placement)
    return model


def mass_matrix(
    robot: Robot, q: Vector, payload: Payload | None = None, drives: DriveTerms | None = None
) -> Matrix:
    """Return the mass matrix M(q), kg·m² (kg·m and kg for prismatic joints), shape (n, n).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    payload :
        Payload at the tip.
    drives :
        Drives whose rotor inertia counts; ``None`` if it does not.

    Raises
    ------
    InputError
        The matrix is not positive definite: masses or inertias in the URDF are missing or
        unphysical.
    """
    fold = robot.coordinates
    M = np.array(pin.crba(robot.model, robot.data, robot.to_model(q)))
    if not fold.is_identity:
        M = fold.G.T @ M.reshape(len(fold.G), -1) @ fold.G
    M = M.reshape(robot.n, robot.n)
    if payload is not None:
        J = payload_jacobian(robot, q, payload)
        M = M + payload.mass * J.T @ J
        if payload.inertia is not None:
            R, _, J = tip_pose_and_jacobian(robot, q)
            M = M + J[3:].T @ (R @ payload.inertia @ R.T) @ J[3:]
    if drives is not None:
        M = M + np.diag(drives.armature)
    if not _is_positive_definite(M):
        raise InputError(
            f"the mass matrix of {robot.name!r} is not positive definite: masses or inertias in "
            "its URDF are missing or unphysical"
        )
    return read_only(M)


def payload_jacobian(robot: Robot, q: Vector, payload: Payload) -> Matrix:
    """Return the linear Jacobian of the payload in root axes, shape (3, n).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    payload :
        Payload at the tip.
    """
    R, _, J = tip_pose_and_jacobian(robot, q)
    linear: Matrix = J[:3]
    if payload.offset.any():
        arm = R.dot(payload.offset)
        linear = linear - pin.skew(arm).dot(J[3:])  # v + ω × r
    return linear


def payload_acceleration(robot: Robot, q: Vector, v: Vector, a: Vector, payload: Payload) -> Vector:
    """Return the acceleration of the payload in root axes, m/s², shape (3,).

    Parameters
    ----------
    robot, q, v, a, payload :
        As in `motion_torque`.
    """
    model, data, frame, fold = robot.model, robot.data, robot.tip_frame, robot.coordinates
    axes = pin.LOCAL_WORLD_ALIGNED
    pin.forwardKinematics(model, data, robot.to_model(q), fold.rate(v), fold.rate(a))
    pin.updateFramePlacement(model, data, frame)
    arm = data.oMf[frame].rotation.dot(payload.offset)
    tip = pin.getFrameClassicalAcceleration(model, data, frame, axes)
    omega = pin.getFrameVelocity(model, data, frame, axes).angular
    acceleration: Vector = (
        tip.linear + np.cross(tip.angular, arm) + np.cross(omega, np.cross(omega, arm))
    )
    return acceleration


def _is_positive_definite(M: Matrix) -> bool:
    """Return whether a mass matrix is positive definite beyond rounding error."""
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        return False
    return bool((L.diagonal() ** 2 > _ROUNDING * M.diagonal().max()).all())
