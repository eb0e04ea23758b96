"""Postures whose tip is at its target: by Newton's method, many at once, or as close as can be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.planning.target import (
    checked_limits,
    residual,
    residual_and_jacobian,
    residuals_and_jacobians,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.target import TipTarget
    from ftforce.robot.robot import Robot

TOLERANCE = 1e-10
"""Largest residual of a target that is reached, m and rad."""
_LONGEST = 0.6  # norm of one step, rad or m: far from the target, steps are directions only
_DAMPING = 1e-13
_HELD = 2  # joints that reach a limit within a step are held there, and the others step again


def project(
    robot: Robot,
    q: Matrix,
    target: TipTarget,
    *,
    iterations: int = 50,
    limits: ArrayLike | None = None,
    locked: Mask | None = None,
    is_damped: bool = False,
) -> tuple[Matrix, Mask]:
    """Move postures to where the tip is at its target, by the least joint motion.

    Newton's method with the pseudoinverse; joints that run into a limit are held there while the
    others go on. Postures that do not converge are returned where they ended.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (N, n).
    target :
        What of the tip is kept, in all postures or in each.
    iterations :
        Steps, at most.
    limits :
        Lower and upper limits in place of the arm's own, shape (2, n).
    locked :
        True at joints that stay where they are, shape (n,) or (N, n).
    is_damped :
        Whether the steps are so short that searches which cannot reach the target end where they
        are closest to it; those that can then need more iterations.

    Returns
    -------
    q :
        Joint positions within the limits, rad or m, shape (N, n).
    reached :
        Whether the tip is at its target, shape (N,).

    Raises
    ------
    InputError
        The limits are malformed.
    """
    lower, upper = checked_limits(robot, limits)
    found = np.clip(np.array(q, dtype=np.float64), lower, upper)
    moving = np.broadcast_to(upper > lower, found.shape)
    if locked is not None:
        moving = moving & ~locked
    reached = np.zeros(len(found), dtype=np.bool_)
    open_ = np.arange(len(found))
    for step in range(iterations + 1):
        r, J = residuals_and_jacobians(robot, found[open_], target.at(open_))
        left = np.abs(r).max(axis=1) > TOLERANCE
        reached[open_[~left]] = True
        open_ = open_[left]
        if not len(open_) or step == iterations:
            break
        wanted = _wanted(
            found[open_], r[left], J[left], (lower, upper), moving[open_], is_damped=is_damped
        )
        found[open_] = np.clip(wanted, lower, upper)
    return found, reached


def closest(robot: Robot, q: Matrix, target: TipTarget, lower: Vector, upper: Vector) -> Vector:
    """Return the posture that comes closest to a target which none reaches, shape (n,).

    By trust-region least squares from each of some postures; metres and radians count alike.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Postures to start from, rad or m, shape (N, n).
    target :
        The target.
    lower, upper :
        Limits, rad or m, shape (n,); a joint whose limits are equal stays there.
    """
    from scipy.optimize import least_squares

    fixed = np.where(lower == upper, 1e-9, 0.0)  # the solver rejects equal bounds
    found = [
        least_squares(
            lambda x: residual_and_jacobian(robot, x, target)[0],
            np.clip(one, lower - 0.5 * fixed, upper + 0.5 * fixed),
            jac=lambda x: residual_and_jacobian(robot, x, target)[1],
            bounds=(lower - fixed, upper + fixed),
            xtol=1e-12,
            max_nfev=200,
        ).x
        for one in q
    ]
    best: Vector = min(found, key=lambda x: float(np.linalg.norm(residual(robot, x, target))))
    return np.clip(best, lower, upper)


def _wanted(
    q: Matrix,
    r: Matrix,
    J: NDArray[np.float64],
    limits: tuple[Vector, Vector],
    moving: Mask,
    *,
    is_damped: bool,
) -> Matrix:
    """Return the next iterates, where they may leave the limits that they have not reached yet."""
    wanted = q
    for _ in range(_HELD + 1):
        wanted = q - _pseudo_step(np.where(moving[:, None], J, 0.0), r, is_damped=is_damped)
        beyond = moving & ((wanted < limits[0]) | (wanted > limits[1]))
        at_bound = beyond & _is_at_bound(q, *limits)
        if not at_bound.any():
            break
        moving = moving & ~at_bound
    return wanted


def _is_at_bound(q: Matrix, lower: Vector, upper: Vector) -> Mask:
    at_bound: Mask = (q <= lower) | (q >= upper)
    return at_bound


def _pseudo_step(J: NDArray[np.float64], r: Matrix, *, is_damped: bool) -> Matrix:
    """Return J† r, no longer than the longest step, shape (N, n)."""
    G = J @ J.transpose(0, 2, 1)
    size = np.trace(G, axis1=1, axis2=2)
    damping = _DAMPING * size + 1e-300
    if is_damped:  # by the curvature that Gauss and Newton leave out, residual times length
        damping += np.linalg.norm(r, axis=1) * np.sqrt(size)
    G += damping[:, None, None] * np.eye(G.shape[1])
    step: Matrix = np.einsum("kij,ki->kj", J, np.linalg.solve(G, r[..., None])[..., 0])
    length = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))
    return step
