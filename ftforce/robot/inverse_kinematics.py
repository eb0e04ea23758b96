"""Inverse kinematics of the tip position, within the joint limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import Vector, read_only
from ftforce.core.resolved_rates import damped_inverse
from ftforce.core.svd import Svd
from ftforce.errors import InputError
from ftforce.robot.kinematics import frame_jacobian, reach_bound, tip_pose
from ftforce.robot.posture import samples

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix
    from ftforce.robot.robot import Robot

REACHED = 1e-9  # m
_FAR = 2.0  # times the reach bound
_INSIDE = 1e-6  # rad or m: the solver starts this far inside the limits
_MAX_EVALUATIONS = 60  # of the residual per search; successful ones need about ten
_DAMPED_BELOW = 1e-6  # of σ_max


def posture_at(robot: Robot, point: Vector, near: Vector) -> Vector:
    """Return joint positions that place the tip at a point, near given ones if possible.

    Parameters
    ----------
    robot :
        The arm.
    point :
        Tip position in root axes, m, shape (3,).
    near :
        Initial guess, rad or m, shape (n,). If the search from there fails, 64 random postures with
        a fixed seed are tried.

    Raises
    ------
    InputError
        No posture within the limits was found; the message gives the closest tip position.
    """
    closest, place = np.inf, point
    if np.linalg.norm(tip_pose(robot, near)[1] - point) <= REACHED:
        return read_only(near)  # unchanged, even if outside the limits
    for seed in (near, *samples(robot)):
        q = _refined(robot, point, _solve(robot, point, seed))
        there = tip_pose(robot, q)[1]
        error = float(np.linalg.norm(there - point))
        if error <= REACHED and _is_within(robot, q):
            return read_only(q)
        if error < closest:
            closest, place = error, there
    here = tip_pose(robot, near)[1]
    raise InputError(
        f"the tip cannot reach {_in_words(point)} m in root axes within the joint limits: the "
        f"closest position found is {_in_words(place)} m, {closest:.3g} m away; the search started "
        f"from {_in_words(here)} m"
    )


def check_reach(robot: Robot, points: Matrix) -> None:
    """Check that points are not far out of reach, usually millimetres given as metres.

    A path may exceed the reach slightly: the arm then follows it as closely as possible, and the
    tracking error is reported.

    Parameters
    ----------
    robot :
        The arm.
    points :
        Tip positions in root axes, m, shape (k, 3).

    Raises
    ------
    InputError
        A point is farther from the first joint than twice the reach bound (`reach_bound`).
    """
    first, length = reach_bound(robot)
    distances = np.linalg.norm(points - first, axis=1)
    far = int(distances.argmax())
    if distances[far] > _FAR * length:
        raise InputError(
            f"the tip cannot reach {_in_words(points[far])} m in root axes: the point is "
            f"{distances[far]:.4g} m from the first joint, and the stretched arm is {length:.4g} m "
            "long"
        )


def _solve(robot: Robot, point: Vector, seed: Vector) -> Vector:
    from scipy.optimize import least_squares

    margin = np.minimum(_INSIDE, 0.25 * (robot.upper - robot.lower))
    start = np.clip(seed, robot.lower + margin, robot.upper - margin)
    fixed = np.where(robot.lower == robot.upper, _INSIDE, 0.0)  # the solver rejects equal bounds
    found = least_squares(
        lambda q: tip_pose(robot, q)[1] - point,
        start,
        jac=lambda q: frame_jacobian(robot, q, "world")[:3],
        bounds=(robot.lower - fixed, robot.upper + fixed),
        max_nfev=_MAX_EVALUATIONS,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    q: Vector = found.x
    return q


def _refined(robot: Robot, point: Vector, q: Vector) -> Vector:
    """Return q refined by a few minimum-norm Newton steps, which cause no self-motion."""
    for _ in range(5):
        K = Svd(frame_jacobian(robot, q, "world")[:3], left_only=True)
        error = point - tip_pose(robot, q)[1]
        if np.linalg.norm(error) > 1e-3:  # m; not converged
            break
        q = q + damped_inverse(K, error, _DAMPED_BELOW * K.s[0])
    return q


def _is_within(robot: Robot, q: Vector) -> bool:
    return bool(((q >= robot.lower - _INSIDE) & (q <= robot.upper + _INSIDE)).all())


def _in_words(point: Vector) -> str:
    return f"({', '.join(f'{x:.4g}' for x in point.tolist())})"
