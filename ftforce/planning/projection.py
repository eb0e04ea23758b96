"""Newton's method for many postures at once: onto the self-motion manifold, within the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.planning.target import checked_limits, residuals_and_jacobians

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.target import TipTarget
    from ftforce.robot.robot import Robot

TOLERANCE = 1e-10  # of the residual, m and rad
_LONGEST = 0.6  # norm of one step, rad or m: far from the target, steps are directions only
_DAMPING = 1e-13  # of the trace of J Jᵀ
_HELD = 2  # joints that reach a limit within a step are held there, and the others step again


def project(
    robot: Robot,
    q: Matrix,
    target: TipTarget,
    *,
    iterations: int = 50,
    tolerance: float = TOLERANCE,
    limits: ArrayLike | None = None,
) -> Matrix:
    """Return postures moved onto the self-motion manifold by the least joint motion, shape (N, n).

    Newton's method with the pseudoinverse; joints that run into a limit are held there while the
    others go on. Postures that do not converge are returned where they ended: check with
    `ftforce.planning.target.residual`.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (N, n).
    target :
        What of the tip is kept.
    iterations :
        Steps, at most.
    tolerance :
        Largest residual, m and rad, at which a posture has converged.
    limits :
        Lower and upper limits in place of the arm's own, shape (2, n).

    Raises
    ------
    InputError
        The limits are malformed.
    """
    lower, upper = checked_limits(robot, limits)
    found = np.clip(np.array(q, dtype=np.float64), lower, upper)
    open_ = np.arange(len(found))
    for _ in range(iterations):
        r, J = residuals_and_jacobians(robot, found[open_], target)
        left = np.abs(r).max(axis=1) > tolerance
        open_ = open_[left]
        if not len(open_):
            break
        found[open_] = _step(found[open_], r[left], J[left], lower, upper)
    return found


def _step(q: Matrix, r: Matrix, J: NDArray[np.float64], lower: Vector, upper: Vector) -> Matrix:
    """Return the next iterates."""
    moving = np.broadcast_to(upper > lower, q.shape).copy()
    wanted = q
    for _ in range(_HELD + 1):
        wanted = q - _pseudo_step(np.where(moving[:, None], J, 0.0), r)
        beyond = moving & ((wanted < lower) | (wanted > upper))
        at_bound = beyond & _is_at_bound(q, lower, upper)
        if not at_bound.any():
            break
        moving &= ~at_bound
    return np.clip(wanted, lower, upper)


def _is_at_bound(q: Matrix, lower: Vector, upper: Vector) -> Mask:
    at_bound: Mask = (q <= lower) | (q >= upper)
    return at_bound


def _pseudo_step(J: NDArray[np.float64], r: Matrix) -> Matrix:
    """Return J† r, no longer than the longest step, shape (N, n)."""
    G = J @ J.transpose(0, 2, 1)
    size = np.trace(G, axis1=1, axis2=2)
    G += (_DAMPING * size + 1e-300)[:, None, None] * np.eye(G.shape[1])
    step: Matrix = np.einsum("kij,ki->kj", J, np.linalg.solve(G, r[..., None])[..., 0])
    length = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))
    return step
