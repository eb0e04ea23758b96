"""A posture that puts the tip at a point, within the joint limits."""

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
FAR = 2.0  # times the stretched arm
_INSIDE = 1e-6  # rad or m: the solver starts that far inside the limits
_MOST_STEPS = 60  # of each search: those that arrive need some ten
_DAMPED_BELOW = 1e-6  # of σ_max


def posture_at(robot: Robot, point: Vector, near: Vector) -> Vector:
    """Return joint positions with the tip at a point, close to given ones if there are any there.

    Parameters
    ----------
    robot :
        The arm.
    point :
        In the root's axes, m, shape (3,).
    near :
        Where the search starts, rad or m, shape (n,); from there on among 64 postures drawn with a
        fixed seed.

    Raises
    ------
    InputError
        No posture within the limits was found; the message says how close the tip gets.
    """
    closest, place = np.inf, point
    if np.linalg.norm(tip_pose(robot, near)[1] - point) <= REACHED:
        return read_only(near)  # as it was given, be it outside the limits
    for seed in (near, *samples(robot)):
        q = _polished(robot, point, _solve(robot, point, seed))
        there = tip_pose(robot, q)[1]
        error = float(np.linalg.norm(there - point))
        if error <= REACHED and _is_within(robot, q):
            return read_only(q)
        if error < closest:
            closest, place = error, there
    here = tip_pose(robot, near)[1]
    raise InputError(
        f"the tip cannot reach {_in_words(point)} m in the root's axes within the joint limits: "
        f"{_in_words(place)} m is the nearest found, {closest:.3g} m away; in the posture that "
        f"was tried first it is at {_in_words(here)} m"
    )


def check_reach(robot: Robot, points: Matrix) -> None:
    """Refuse points far beyond the stretched arm: millimetres taken for metres, mostly.

    A path may leave the reach a little: the arm does what it can, and the error is reported.

    Parameters
    ----------
    robot :
        The arm.
    points :
        In the root's axes, m, shape (k, 3).

    Raises
    ------
    InputError
        A point is farther from the first joint than twice all links in a row.
    """
    first, length = reach_bound(robot)
    distances = np.linalg.norm(points - first, axis=1)
    far = int(distances.argmax())
    if distances[far] > FAR * length:
        raise InputError(
            f"the tip cannot reach {_in_words(points[far])} m in the root's axes: that is "
            f"{distances[far]:.4g} m from the first joint, and the stretched arm has {length:.4g} m"
        )


def _solve(robot: Robot, point: Vector, seed: Vector) -> Vector:
    from scipy.optimize import least_squares

    room = np.minimum(_INSIDE, 0.25 * (robot.upper - robot.lower))
    start = np.clip(seed, robot.lower + room, robot.upper - room)
    fixed = np.where(robot.lower == robot.upper, _INSIDE, 0.0)  # no bounds for the solver
    found = least_squares(
        lambda q: tip_pose(robot, q)[1] - point,
        start,
        jac=lambda q: frame_jacobian(robot, q, "world")[:3],
        bounds=(robot.lower - fixed, robot.upper + fixed),
        max_nfev=_MOST_STEPS,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    q: Vector = found.x
    return q


def _polished(robot: Robot, point: Vector, q: Vector) -> Vector:
    """Return the end of a few Newton steps, which keep what the tip does not need."""
    for _ in range(5):
        K = Svd(frame_jacobian(robot, q, "world")[:3], left_only=True)
        error = point - tip_pose(robot, q)[1]
        if np.linalg.norm(error) > 1e-3:  # m: not there, so nothing to polish
            break
        q = q + damped_inverse(K, error, _DAMPED_BELOW * K.s[0])
    return q


def _is_within(robot: Robot, q: Vector) -> bool:
    return bool(((q >= robot.lower - _INSIDE) & (q <= robot.upper + _INSIDE)).all())


def _in_words(point: Vector) -> str:
    return f"({', '.join(f'{x:.4g}' for x in point.tolist())})"
