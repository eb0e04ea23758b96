"""Which posture to analyse, and where it comes from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from ftforce.core.arrays import Vector, as_vector, read_only
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.errors import DimensionError, InputError, UnknownNameError
from ftforce.robot.kinematics import frame_jacobian
from ftforce.robot.robot import BUILT_IN_POSTURES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.robot.robot import Robot

SAMPLES = 64
SEED = 20_100  # fixed: the same arm gives the same sample on every machine
_defaults: WeakKeyDictionary[Robot, Posture] = WeakKeyDictionary()  # found once per robot


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Joint positions, rad or m along the chain, shape (n,), and where they come from.

    Attributes
    ----------
    q :
        Shape (n,).
    source :
        E.g. ``given``, ``posture 'home'`` or ``mid-range``.
    warnings :
        What is odd about it, e.g. positions outside the joint limits.
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
    """Return the given posture, the named one, or a default.

    The default is the robot's preferred named posture that lies within the limits and is not
    singular; else the middle of the joint limits; if that is singular, the best conditioned of
    64 postures drawn with a fixed seed.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions along the chain, rad or m, shape (n,). A `Posture` is returned as it is.
    name :
        A named posture of the robot, or ``mid-range``, ``zero`` or ``sample``.
    degrees :
        Whether revolute entries of ``q`` are degrees.

    Raises
    ------
    InputError
        Both ``q`` and ``name``, a ``q`` of the wrong length or not finite, or an unknown name.
    """
    if q is not None and name is not None:
        raise InputError(f"give either q or a posture, not both (q and {name!r})")
    if isinstance(q, Posture):
        if len(q.q) != robot.n:
            raise DimensionError("posture", (robot.n,), q.q.shape, "it is another arm's")
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
    """Return the first preferred posture that is no bad default, and why those before it are.

    Returns
    -------
    :
        Its name, ``None`` if there is none; and a remark on each posture that was skipped.
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
    """Return the middle of the joint limits, 0 for continuous joints, shape (n,)."""
    lower, upper = robot.lower, robot.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    q = np.zeros(robot.n)
    q[bounded] = 0.5 * (lower[bounded] + upper[bounded])
    return read_only(q)


def is_singular(robot: Robot, q: Vector) -> bool:
    """Return whether the arm has less rank here than elsewhere, for forces or for wrenches."""
    J = frame_jacobian(robot, q)
    for rows in (3, 6):
        rank = _rank(J[:rows], BORDERLINE_RTOL)
        if rank < min(rows, robot.n) and rank < _usual_rank(robot, rows):
            return True
    return False


def _usual_rank(robot: Robot, rows: int) -> int:
    """Return the rank that the first rows of the Jacobian have at most postures."""
    return max(_rank(frame_jacobian(robot, q)[:rows], RTOL) for q in samples(robot))


def _rank(J: Vector, rtol: float) -> int:
    s = np.linalg.svd(J, compute_uv=False)
    return int(np.count_nonzero(s > rtol * s[0]))


def samples(robot: Robot) -> Vector:
    """Return reproducible postures within the limits (±π where there are none), (64, n)."""
    lower = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
    drawn = np.random.default_rng(SEED).random((SAMPLES, robot.n))
    return read_only(lower + drawn * (upper - lower))


def best_sample(robot: Robot) -> Vector:
    """Return the sample whose force Jacobian is conditioned best, shape (n,)."""
    drawn = samples(robot)

    def conditioning(q: Vector) -> tuple[float, ...]:
        s = np.linalg.svd(frame_jacobian(robot, q)[:3], compute_uv=False)
        # Compared from the second to the last singular value from the back, so that an arm that
        # never reaches full rank (a planar one) is conditioned in the directions it has.
        ratios = [float(x / s[0]) if x > RTOL * s[0] else 0.0 for x in s]
        return (sum(x > 0.0 for x in ratios), min((x for x in ratios if x > 0.0), default=0.0))

    return read_only(max(drawn, key=conditioning).copy())


def _checked(robot: Robot, q: Vector, source: str) -> Posture:
    outside = _outside(robot, q)
    if not outside:
        return Posture(q, source)
    mixed_up = _looks_like_degrees(robot, q)
    hint = "; these look like degrees, but radians are expected" if mixed_up else ""
    names = ", ".join(
        f"{robot.names[i]} = {q[i]:g} (limits {robot.lower[i]:g} to {robot.upper[i]:g} "
        f"{robot.joints[i].unit})"
        for i in outside
    )
    return Posture(q, source, (f"outside the joint limits: {names}{hint}",))


def _outside(robot: Robot, q: Vector) -> list[int]:
    slack = 1e-6  # limits are printed rounded
    low, high = q < robot.lower - slack, q > robot.upper + slack
    return np.flatnonzero(low | high).tolist()


def _looks_like_degrees(robot: Robot, q: Vector) -> bool:
    """Say yes if a turning joint is beyond two turns and all would lie within limits as degrees."""
    turning = np.array([joint.type != "prismatic" for joint in robot.joints])
    far = bool(np.any(np.abs(q[turning]) > 2.0 * math.pi))
    return far and not _outside(robot, np.where(turning, np.deg2rad(q), q))
