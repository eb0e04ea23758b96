"""The path of a tool, and postures that reach points of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.robot.kinematics import tip_pose_and_jacobian

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.reference import ReferenceTrajectory

REACHED = 1e-10  # m and rad
POINT, POSE = (0, 1, 2), (0, 1, 2, 3, 4, 5)
_ITERATIONS = 20  # of Newton's method; successful searches need about five
_LARGEST_STEP = 0.3  # rad or m, of any joint
_DAMPING = 1e-9  # relative to σ_max², for postures close to a singularity


@dataclass(frozen=True, eq=False)
class TipTargets:
    """Positions and rotations of the tip in root axes, or one of each.

    Attributes
    ----------
    position :
        m, shape (3,) or (k, 3).
    rotation :
        Rotation matrices, shape (3, 3) or (k, 3, 3); ``None`` if the orientation is free.
    rows :
        Which components are kept: of the position (0, 1, 2) and of the rotation (3, 4, 5), along
        and about the root axes.
    """

    position: Matrix
    rotation: NDArray[np.float64] | None = None
    rows: tuple[int, ...] = POINT

    @classmethod
    def of(cls, position: Matrix, rotation: NDArray[np.float64] | None = None) -> TipTargets:
        """Return a target that keeps all that is given: points, or whole poses.

        Parameters
        ----------
        position, rotation :
            As of the class.
        """
        return cls(position, rotation, POINT if rotation is None else POSE)

    def at(self, chosen: NDArray[np.intp] | slice) -> TipTargets:
        """Return some of several targets.

        Parameters
        ----------
        chosen :
            Indices of them.
        """
        R = self.rotation
        position = self.position if self.position.ndim == 1 else self.position[chosen]
        return TipTargets(position, R if R is None or R.ndim == 2 else R[chosen], self.rows)

    def one(self, k: int) -> TipTargets:
        """Return one of several targets, for any number of postures.

        Parameters
        ----------
        k :
            Its index.
        """
        R = self.rotation
        return TipTargets(self.position[k], R if R is None or R.ndim == 2 else R[k], self.rows)


class ToolPath(NamedTuple):
    """The path of the tip, with or without its orientation.

    Attributes
    ----------
    robot :
        The arm.
    reference :
        The trajectory whose tip path it is.
    keeps_orientation :
        Whether the orientation is part of it.
    """

    robot: Robot
    reference: ReferenceTrajectory
    keeps_orientation: bool

    def at(self, t: Vector) -> TipTargets:
        """Return the targets of the tip.

        Parameters
        ----------
        t :
            Times, s, shape (k,).
        """
        place = self.reference.tip(t)[0]
        if not self.keeps_orientation:
            return TipTargets.of(place)
        motion = self.reference.motion(t)
        if motion is None:
            return TipTargets.of(place, self.reference.orientation)
        return TipTargets.of(place, placed(self.robot, motion.q).R)


class Placed(NamedTuple):
    """Tip poses and frame Jacobians in root axes, shapes (k, 3, 3), (k, 3) and (k, 6, n)."""

    R: NDArray[np.float64]
    p: Matrix
    J: NDArray[np.float64]


def placed(robot: Robot, q: Matrix) -> Placed:
    """Return tip poses and Jacobians of several postures.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (k, n).
    """
    found = Placed(np.empty((len(q), 3, 3)), np.empty((len(q), 3)), np.empty((len(q), 6, robot.n)))
    for i, one in enumerate(q):
        found.R[i], found.p[i], found.J[i] = tip_pose_and_jacobian(robot, one)
    return found


def residual(target: TipTargets, at: Placed) -> Matrix:
    """Return what is missing to the target: displacement, m, and rotation vector, shape (k, r).

    Parameters
    ----------
    target :
        The target, or one for each posture.
    at :
        The postures.
    """
    missing = np.zeros((len(at.p), 6))
    missing[:, :3] = target.position - at.p
    if target.rotation is not None and len(at.p):
        from scipy.spatial.transform import Rotation

        turns = target.rotation @ at.R.transpose(0, 2, 1)
        missing[:, 3:] = Rotation.from_matrix(turns).as_rotvec()
    return missing[:, target.rows]


def project(
    robot: Robot, q: Matrix, target: TipTargets, *, tolerance: float = REACHED
) -> tuple[Matrix, Mask]:
    """Move postures to where the tip is at its target, with little self-motion.

    Newton's method with steps of least norm; joints at a limit that would leave it are held.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (k, n).
    target :
        The target, or one for each posture.
    tolerance :
        Largest residual, m and rad.

    Returns
    -------
    q :
        Joint positions within the limits, shape (k, n).
    reached :
        Whether the tip is at its target, shape (k,).
    """
    q = np.clip(q, robot.lower, robot.upper)
    reached = np.zeros(len(q), dtype=np.bool_)
    left = np.arange(len(q))
    for _ in range(_ITERATIONS):
        at = placed(robot, q[left])
        missing = residual(target.at(left), at)
        is_there = np.abs(missing).max(axis=1, initial=0.0) <= tolerance
        reached[left[is_there]] = True
        left, missing, J = left[~is_there], missing[~is_there], at.J[~is_there]
        if not len(left):
            break
        q[left] = _stepped(robot, q[left], J[:, target.rows], missing)
    return q, reached


def _stepped(robot: Robot, q: Matrix, J: NDArray[np.float64], missing: Matrix) -> Matrix:
    """Return postures after a step, with joints held that would leave their limits."""
    free = np.ones_like(q)
    for _ in range(2):
        step = _least_norm(J * free[:, None], missing)
        largest = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))
        leaves = ((q + step > robot.upper) | (q + step < robot.lower)) & (free > 0.0)
        if not leaves.any():
            break
        free = np.where(leaves, 0.0, free)
    return np.clip(q + step, robot.lower, robot.upper)


def _least_norm(J: NDArray[np.float64], x: Matrix) -> Matrix:
    """Return Jᵀ(J Jᵀ + λ²)⁻¹ x for several matrices, shape (k, n)."""
    A = J @ J.transpose(0, 2, 1)
    size = np.trace(A, axis1=1, axis2=2)
    A += (_DAMPING * size + 1e-300)[:, None, None] * np.eye(A.shape[1])
    return (J.transpose(0, 2, 1) @ np.linalg.solve(A, x[..., None]))[..., 0]
