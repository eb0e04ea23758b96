"""What of the tip is kept while the arm changes its posture, and the equations that say so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from ftforce.batch.numpy_path import tip_kinematics
from ftforce.batch.plan import mechanism_of
from ftforce.core.arrays import as_floats, as_vector, read_only
from ftforce.errors import DimensionError, InputError
from ftforce.robot.kinematics import rotation_vector, tip_pose, tip_pose_and_jacobian

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

    from ftforce.batch.kernels.layout import Mechanism
    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.robot.robot import Robot

    Stack = NDArray[np.float64]

POINT, POSE = (0, 1, 2), (0, 1, 2, 3, 4, 5)
_NOT_TURNED = 1e-6  # by how much a rotation matrix may miss orthonormality

_mechanisms: WeakKeyDictionary[Robot, Mechanism] = WeakKeyDictionary()  # cached per robot


@dataclass(frozen=True, eq=False)
class TipTarget:
    """What of the tip is kept, in all postures or in each of N.

    Attributes
    ----------
    position :
        Position of the tip in root axes, m, shape (3,) or (N, 3).
    rotation :
        Rotation matrix of the tip in root axes, shape (3, 3) or (N, 3, 3); ``None`` if it may turn.
    rows :
        Rows of the tip twist in root axes that are kept, linear first, e.g. (0, 1, 2) for a point
        and all six for a pose. An angular row is a component of the rotation vector from the
        target to the tip.
    """

    position: Vector | Matrix
    rotation: Matrix | Stack | None
    rows: tuple[int, ...]

    @classmethod
    def of(
        cls,
        position: ArrayLike,
        rotation: ArrayLike | None = None,
        rows: Iterable[int] | None = None,
    ) -> TipTarget:
        """Return a checked target.

        Parameters
        ----------
        position :
            Position of the tip in root axes, m, shape (3,).
        rotation :
            Rotation matrix of the tip, shape (3, 3), or roll, pitch and yaw as in URDF, rad, shape
            (3,); ``None`` if it may turn.
        rows :
            Rows that are kept; by default the position, and the orientation if one is given.

        Raises
        ------
        InputError
            A value is malformed, or an angular row is kept without a rotation.
        """
        p = as_vector(position, 3, "the tip position", "x, y, z in m")
        R = None if rotation is None else _rotation(rotation)
        kept = tuple(rows) if rows is not None else (POINT if R is None else POSE)
        if not kept or sorted(set(kept)) != list(kept) or not set(kept) <= set(POSE):
            raise InputError(
                "rows are increasing numbers from 0 to 5, linear first, e.g. (0, 1, 2) for a "
                f"point, got {kept!r}"
            )
        if kept[-1] > 2 and R is None:
            raise InputError(f"row {kept[-1]} is angular and needs a rotation to keep")
        return cls(p, R if kept[-1] > 2 else None, kept)

    @classmethod
    def at_posture(cls, robot: Robot, q: Vector, rows: Iterable[int] = POSE) -> TipTarget:
        """Return the place of the tip in a posture as target.

        Parameters
        ----------
        robot :
            The arm.
        q :
            Joint positions, rad or m, shape (n,).
        rows :
            Rows that are kept.

        Raises
        ------
        InputError
            The rows are malformed.
        """
        R, p = tip_pose(robot, q)
        return cls.of(p, R, rows)

    @classmethod
    def of_each(cls, position: Matrix, rotation: Matrix | Stack | None) -> TipTarget:
        """Return the targets of N postures: points, or poses if rotations are given.

        Parameters
        ----------
        position :
            m, shape (N, 3).
        rotation :
            Rotation matrices, one for all, shape (3, 3), or one for each, (N, 3, 3).
        """
        return cls(position, rotation, POINT if rotation is None else POSE)

    def at(self, chosen: int | NDArray[np.intp]) -> TipTarget:
        """Return the target of one posture, or those of some.

        Parameters
        ----------
        chosen :
            Index of the posture, or indices, shape (k,).
        """
        p, R = self.position, self.rotation
        return TipTarget(
            p if p.ndim == 1 else p[chosen],
            R if R is None or R.ndim == 2 else R[chosen],
            self.rows,
        )

    @property
    def keeps_orientation(self) -> bool:
        """Whether all of the orientation is kept."""
        return self.rows[-3:] == POSE[3:]


def _rotation(given: ArrayLike) -> Matrix:
    """Return a rotation matrix from itself or from roll, pitch, yaw."""
    values = as_floats(given, "rotation")
    if values.shape == (3,):
        from scipy.spatial.transform import Rotation

        angles = as_vector(values, 3, "roll, pitch, yaw", "rad")
        return read_only(Rotation.from_euler("xyz", angles).as_matrix())
    if values.shape != (3, 3):
        raise DimensionError("rotation", (3, 3), values.shape, "or (3,): roll, pitch, yaw in rad")
    is_orthonormal = np.abs(values @ values.T - np.eye(3)).max() <= _NOT_TURNED
    if not (is_orthonormal and np.linalg.det(values) > 0.0):
        raise InputError("rotation is no rotation matrix: its columns must be orthonormal axes")
    return read_only(values)


def mechanism(robot: Robot) -> Mechanism:
    """Return the arm as arrays, for the kinematics of many postures at once.

    Parameters
    ----------
    robot :
        The arm.
    """
    if (found := _mechanisms.get(robot)) is None:
        found = _mechanisms[robot] = mechanism_of(robot, needs_gravity=False)
    return found


def residual(robot: Robot, q: Matrix, target: TipTarget) -> Matrix:
    """Return by how much the tip misses a target, shape (rows,), or (N, rows) for N postures.

    Position errors in m, tip minus target, and components of the rotation vector from the target
    to the tip in rad, both in root axes.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,) or (N, n).
    target :
        The target.
    """
    if q.ndim == 1:
        R, p = tip_pose(robot, q)
        error = np.zeros(6)
        error[:3] = p - target.position
        if target.rotation is not None:
            error[3:] = rotation_vector(R @ target.rotation.T)
        return error[list(target.rows)]
    return residuals_and_jacobians(robot, q, target)[0]


def residual_and_jacobian(robot: Robot, q: Vector, target: TipTarget) -> tuple[Vector, Matrix]:
    """Return the residual of one posture, shape (r,), and its derivative, shape (r, n).

    Parameters
    ----------
    robot, q, target :
        As in `residual`.
    """
    R, p, J = tip_pose_and_jacobian(robot, q)
    error = np.zeros(6)
    error[:3] = p - target.position
    if target.rotation is not None:
        error[3:] = turn = rotation_vector(R @ target.rotation.T)
        J = J.copy()
        J[3:] = _log_derivative(turn[None])[0] @ J[3:]
    rows = list(target.rows)
    return error[rows], J[rows]


def residuals_and_jacobians(robot: Robot, q: Matrix, target: TipTarget) -> tuple[Matrix, Stack]:
    """Return the residuals of N postures, shape (N, r), and their derivatives, shape (N, r, n).

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (N, n).
    target :
        The target.
    """
    R, p, J = tip_kinematics(mechanism(robot), q)
    error = np.zeros((len(q), 6))
    error[:, :3] = p - target.position
    if target.rotation is not None:
        from scipy.spatial.transform import Rotation

        if len(q):
            turn = R @ target.rotation.swapaxes(-1, -2)
            error[:, 3:] = Rotation.from_matrix(turn).as_rotvec()
        J = np.concatenate([J[:, :3], _log_derivative(error[:, 3:]) @ J[:, 3:]], axis=1)
    rows = list(target.rows)
    return error[:, rows], J[:, rows]


def _log_derivative(turn: Matrix) -> Stack:
    """Return d log R / dω in root axes for rotation vectors, shape (N, 3, 3).

    The inverse left Jacobian of SO(3), I - [φ]/2 + (1/θ² - cot(θ/2)/(2θ)) [φ]².
    """
    x, y, z = turn.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    angle = np.linalg.norm(turn, axis=1)
    safe = np.where(angle > 1e-4, angle, 1.0)
    by_angle = 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(0.5 * safe))
    factor = np.where(angle > 1e-4, by_angle, 1.0 / 12.0)
    found: Stack = np.eye(3) - 0.5 * cross + factor[:, None, None] * (cross @ cross)
    return found


def checked_limits(robot: Robot, limits: ArrayLike | None) -> tuple[Vector, Vector]:
    """Return lower and upper position limits, rad or m, each of shape (n,).

    Parameters
    ----------
    robot :
        The arm.
    limits :
        Lower and upper limits, shape (2, n), in place of the arm's own; a joint whose limits are
        equal is locked there. ``None`` for the arm's own.

    Raises
    ------
    InputError
        They are malformed, or a lower limit exceeds its upper limit.
    """
    if limits is None:
        return robot.lower, robot.upper
    values = as_floats(limits, "limits")
    if values.shape != (2, robot.n):
        raise DimensionError("limits", (2, robot.n), values.shape, "lower and upper limits")
    if np.isnan(values).any():
        raise InputError("limits contain NaN; use infinity for a joint without a limit")
    if (bad := np.flatnonzero(values[0] > values[1])).size:
        i = int(bad[0])
        raise InputError(
            f"no posture is within the limits: the lower limit of {robot.names[i]!r}, "
            f"{values[0, i]:g}, exceeds the upper one, {values[1, i]:g} {robot.units[i]}"
        )
    return read_only(values[0].copy()), read_only(values[1].copy())


def wide_joints(robot: Robot, lower: Vector, upper: Vector) -> Mask:
    """Return which joints may take the same place a turn of 2π apart, shape (n,).

    Parameters
    ----------
    robot :
        The arm.
    lower, upper :
        Position limits, rad or m, shape (n,).
    """
    turns = np.array([joint.type != "prismatic" for joint in robot.joints])
    wide: Mask = turns & (upper - lower >= 2.0 * np.pi - 1e-9)
    return wide
