"""Choice of the posture to analyse."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_vector, read_only
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.errors import DimensionError, InputError, UnknownNameError
from ftforce.robot.kinematics import frame_jacobian
from ftforce.robot.robot import BUILT_IN_POSTURES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.robot.robot import Robot

SAMPLES = 64
DEGREES = "; these look like degrees, but radians are expected"
_SEED = 20_100  # fixed, so that samples are reproducible
_defaults: WeakKeyDictionary[Robot, Posture] = WeakKeyDictionary()  # cached per robot


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Joint positions along the chain, and their origin.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (n,).
    source :
        Origin, e.g. ``given``, ``posture 'home'`` or ``mid-range``.
    warnings :
        Warnings, e.g. about positions outside the joint limits.
    """

    q: Vector
    source: str
    warnings: tuple[str, ...] = ()


def choose_posture(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    name: str | None = None,
    *,
    degrees: bool = False,
) -> Posture:
    """Return the given, the named or the default posture.

    The default is the first preferred posture of the robot that lies within the limits and is not
    singular; else the middle of the joint ranges; if that is singular, the best conditioned of 64
    random postures with a fixed seed.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions along the chain, rad or m, shape (n,). A `Posture` is returned unchanged.
    name :
        Named posture of the robot, or ``mid-range``, ``zero`` or ``sample``.
    degrees :
        Whether the angles in ``q`` are in degrees.

    Raises
    ------
    InputError
        Both ``q`` and ``name`` are given, ``q`` has the wrong length or is not finite, or the name
        is unknown.
    """
    if q is not None and name is not None:
        raise InputError(f"give either q or a posture, not both (q and {name!r})")
    if isinstance(q, Posture):
        if len(q.q) != robot.n:
            raise DimensionError("posture", (robot.n,), q.q.shape, "it belongs to another arm")
        return q
    if q is not None:
        values = as_vector(q, robot.n, "q", f"one per joint, {robot.numbered()}")
        return _checked(robot, _in_radians(robot, values) if degrees else values, "given")
    if name is not None:
        return _named(robot, name)
    if (posture := _defaults.get(robot)) is None:
        posture = _defaults[robot] = _default(robot)
    return posture


def _in_radians(robot: Robot, q: Vector) -> Vector:
    turning = np.array([joint.type != "prismatic" for joint in robot.joints])
    return read_only(np.where(turning, np.deg2rad(q), q))


def _named(robot: Robot, name: str) -> Posture:
    if name in robot.postures:
        return _checked(robot, robot.postures[name], f"posture '{name}'")
    if name == "mid-range":
        return _checked(robot, mid_range(robot), "mid-range")
    if name == "zero":
        return _checked(robot, read_only(np.zeros(robot.n)), "zero")
    if name == "sample":
        return _checked(robot, best_sample(robot), f"best of {SAMPLES} samples")
    raise UnknownNameError("posture", name, [*robot.postures, *BUILT_IN_POSTURES])


def usable_posture(robot: Robot) -> tuple[str | None, list[str]]:
    """Return the first preferred posture that is within limits and not singular.

    Returns
    -------
    :
        Its name, or ``None`` if there is none; and a remark on each posture that was skipped.
    """
    skipped: list[str] = []
    for name in robot.preferred:
        q = robot.postures[name]
        problem = "outside the limits" if _outside(robot, q) else ""
        problem = problem or ("singular" if is_singular(robot, q) else "")
        if not problem:
            return name, skipped
        skipped.append(f"'{name}' is {problem}")
    return None, skipped


def _default(robot: Robot) -> Posture:
    name, skipped = usable_posture(robot)
    if name is not None:
        return Posture(robot.postures[name], f"posture '{name}'" + _in_brackets(skipped))
    q = mid_range(robot)
    if not is_singular(robot, q):
        return Posture(q, "mid-range" + _in_brackets(skipped))
    skipped.append("mid-range is singular")
    return Posture(best_sample(robot), f"best of {SAMPLES} samples" + _in_brackets(skipped))


def _in_brackets(words: Iterable[str]) -> str:
    text = ", ".join(words)
    return f" ({text})" if text else ""


def mid_range(robot: Robot) -> Vector:
    """Return the middle of the joint ranges, 0 for joints without limits, shape (n,)."""
    lower, upper = robot.lower, robot.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    q = np.zeros(robot.n)
    q[bounded] = 0.5 * (lower[bounded] + upper[bounded])
    return read_only(q)


def is_singular(robot: Robot, q: Vector) -> bool:
    """Return whether the force or wrench Jacobian is rank-deficient relative to other postures.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    """
    J = frame_jacobian(robot, q)
    for rows in (3, 6):
        rank = _rank(J[:rows], BORDERLINE_RTOL)
        if rank < min(rows, robot.n) and rank < _usual_rank(robot, rows):
            return True
    return False


def _usual_rank(robot: Robot, rows: int) -> int:
    """Return the generic rank of the first rows of the Jacobian."""
    return max(_rank(frame_jacobian(robot, q)[:rows], RTOL) for q in samples(robot))


def _rank(J: Vector, rtol: float) -> int:
    s = np.linalg.svd(J, compute_uv=False)
    return int(np.count_nonzero(s > rtol * s[0]))


def samples(robot: Robot) -> Vector:
    """Return random postures within the limits (±π if none), fixed seed, shape (64, n)."""
    lower = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
    drawn = np.random.default_rng(_SEED).random((SAMPLES, robot.n))
    return read_only(lower + drawn * (upper - lower))


def best_sample(robot: Robot) -> Vector:
    """Return the sample with the best-conditioned force Jacobian, shape (n,)."""
    drawn = samples(robot)

    def conditioning(q: Vector) -> tuple[float, ...]:
        s = np.linalg.svd(frame_jacobian(robot, q)[:3], compute_uv=False)
        # Rank first, then the smallest nonzero singular value, so that an arm without full rank
        # (e.g. a planar one) is rated in the directions in which it can move.
        ratios = [float(x / s[0]) if x > RTOL * s[0] else 0.0 for x in s]
        return (sum(x > 0.0 for x in ratios), min((x for x in ratios if x > 0.0), default=0.0))

    return read_only(max(drawn, key=conditioning).copy())


def _checked(robot: Robot, q: Vector, source: str) -> Posture:
    outside = _outside(robot, q)
    if not outside:
        return Posture(q, source)
    mixed_up = looks_like_degrees(robot, q)
    hint = DEGREES if mixed_up else ""
    names = ", ".join(
        f"{robot.names[i]} = {q[i]:g} (limits {robot.lower[i]:g} to {robot.upper[i]:g} "
        f"{robot.joints[i].unit})"
        for i in outside
    )
    return Posture(q, source, (f"outside the joint limits: {names}{hint}",))


def _outside(robot: Robot, q: Vector) -> list[int]:
    slack = 1e-6  # rad or m: limits are often rounded
    low, high = q < robot.lower - slack, q > robot.upper + slack
    return np.flatnonzero(low | high).tolist()


def looks_like_degrees(robot: Robot, q: Matrix) -> bool:
    """Return whether an angle exceeds 2π and the positions, read as degrees, are within limits.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,) or (N, n).
    """
    turning = np.array([joint.type != "prismatic" for joint in robot.joints])
    whole = np.atleast_2d(q)
    ends = np.array([whole.min(axis=0), whole.max(axis=0)])
    if not np.any(np.abs(ends[:, turning]) > 2.0 * math.pi):
        return False
    return not any(_outside(robot, np.where(turning, np.deg2rad(end), end)) for end in ends)
