"""Choice of the posture to analyse."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, product
from operator import itemgetter
from typing import TYPE_CHECKING, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_vector, read_only
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.errors import DimensionError, InputError, check_word
from ftforce.robot.kinematics import frame_jacobian, task_jacobian
from ftforce.robot.mounting import Mounting
from ftforce.robot.robot import BUILT_IN_POSTURES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot

SAMPLES = 64
_BEND = math.pi / 3.0
_MOST_BENT = 3
_CONSIDERED = 8  # revolute joints, counted from the base, that may be bent: 448 postures of three
SINGULAR = "is singular"
DEGREES = "; these look like degrees, but radians are expected"
_SEED = 20_100  # fixed, so that samples are reproducible

# Cached per robot: its default posture, those that ftforce chooses, and ranks of tasks.
_defaults: WeakKeyDictionary[Robot, Posture] = WeakKeyDictionary()
_chosen: WeakKeyDictionary[Robot, dict[str, Posture | None]] = WeakKeyDictionary()
_task_ranks: WeakKeyDictionary[Robot, dict[Task, int]] = WeakKeyDictionary()

Problem: TypeAlias = Callable[[Vector], str]
"""Says why a question cannot be answered in a posture, e.g. ``is singular``; empty if it can."""


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
    problem: Problem | None = None,
) -> Posture:
    """Return the given, the named or the default posture.

    The default is the first of these in which the question can be answered: the preferred postures
    of the robot that lie within the limits; the middle of the joint ranges, unless it is singular
    for forces or wrenches; `bent_posture`; `best_sample`. If there is none, or without a question,
    it is the first of them that is not singular for forces or wrenches.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions along the chain, rad or m, shape (n,). A `Posture` is returned unchanged.
    name :
        Named posture of the robot, or ``mid-range``, ``zero``, ``bent`` or ``sample``.
    degrees :
        Whether the angles in ``q`` are in degrees.
    problem :
        Says why the question cannot be answered in a posture.

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
    return _default(robot, problem)


def _in_radians(robot: Robot, q: Vector) -> Vector:
    turning = np.array([joint.type != "prismatic" for joint in robot.joints])
    return read_only(np.where(turning, np.deg2rad(q), q))


def _named(robot: Robot, name: str) -> Posture:
    check_word("posture", name, [*robot.postures, *BUILT_IN_POSTURES])
    if name in robot.postures:
        return _checked(robot, robot.postures[name], f"posture '{name}'")
    if name == "mid-range":
        return _checked(robot, mid_range(robot), "mid-range")
    if name == "zero":
        return _checked(robot, read_only(np.zeros(robot.n)), "zero")
    if name == "bent":
        return _bent(robot) or _checked(
            robot, mid_range(robot), "mid-range (no bent posture helps)"
        )
    return _sample(robot)


def usable_posture(robot: Robot, problem: Problem) -> tuple[str | None, list[str]]:
    """Return the first preferred posture within limits in which a question can be answered.

    Parameters
    ----------
    robot :
        The arm.
    problem :
        Says why the question cannot be answered in a posture.

    Returns
    -------
    :
        Its name, or ``None`` if there is none; and a remark on each posture that was skipped.
    """
    skipped: list[str] = []
    for name in robot.preferred:
        q = robot.postures[name]
        why = "is outside the limits" if _outside(robot, q) else problem(q)
        if not why:
            return name, skipped
        skipped.append(f"'{name}' {why}")
    return None, skipped


def _default(robot: Robot, problem: Problem | None) -> Posture:
    if problem is not None and (posture := _first(robot, problem)) is not None:
        return posture
    if (posture := _defaults.get(robot)) is None:
        posture = _first(robot, None)
        assert posture is not None
        _defaults[robot] = posture
    return posture


def _first(robot: Robot, problem: Problem | None) -> Posture | None:
    """Return the first candidate in which a question can be answered, with what was skipped."""
    name, skipped = usable_posture(robot, problem or partial(_generic_problem, robot))
    if name is not None:
        return Posture(robot.postures[name], f"posture '{name}'" + _in_brackets(skipped))
    for name, find in (("mid-range", _middle), ("bent", _bent), ("sample", _sample)):
        known = _chosen.setdefault(robot, {})
        if name not in known:
            known[name] = find(robot)
        if (posture := known[name]) is None:
            skipped += [f"{name} {SINGULAR}"] * (find is _middle)
            continue
        why = "" if problem is None else problem(posture.q)
        if not why:
            return Posture(posture.q, posture.source + _in_brackets(skipped))
        skipped.append(f"{name} {why}")
    return None


def _generic_problem(robot: Robot, q: Vector) -> str:
    return SINGULAR if is_singular(robot, q) else ""


def _middle(robot: Robot) -> Posture | None:
    q = mid_range(robot)
    return None if is_singular(robot, q) else Posture(q, "mid-range")


def _bent(robot: Robot) -> Posture | None:
    q = bent_posture(robot)
    if q is None:
        return None
    numbers = [str(i + 1) for i in np.flatnonzero(q != mid_range(robot)).tolist()]
    joints = f"joint{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"
    return Posture(q, f"bent: {joints} turned from mid-range")


def _sample(robot: Robot) -> Posture:
    q = best_sample(robot)
    clear = " clear of the base" if Mounting.of(robot).is_clear(q) else ""
    return Posture(q, f"best of {SAMPLES} samples{clear}")


def _in_brackets(words: Iterable[str]) -> str:
    text = ", ".join(words)
    return f" ({text})" if text else ""


def mid_range(robot: Robot) -> Vector:
    """Return the middle of the joint ranges, shape (n,).

    Joints without limits are at 0, those with a single one as close to 0 as it permits.

    Parameters
    ----------
    robot :
        The arm.
    """
    lower, upper = robot.lower, robot.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    q = np.clip(np.zeros(robot.n), lower, upper)
    q[bounded] = 0.5 * (lower[bounded] + upper[bounded])
    return read_only(q)


def bent_posture(robot: Robot) -> Vector | None:
    """Return the middle of the joint ranges with as few joints bent as possible, shape (n,).

    One, two or three revolute joints, not the first, are turned by 60° (by 80 % of the way to a
    limit that is nearer). Of the postures with the fewest bent joints that are not singular and
    clear of the base (`Mounting`), the best conditioned is returned, of equals the highest;
    ``None`` if there is none.

    Parameters
    ----------
    robot :
        The arm.
    """
    middle = mid_range(robot)
    room = np.minimum(_BEND, 0.8 * np.minimum(robot.upper - middle, middle - robot.lower))
    usual, mounting = _usual_ranks(robot), Mounting.of(robot)
    joints = [i for i in range(1, robot.n) if robot.joints[i].type != "prismatic"][:_CONSIDERED]
    for count in range(1, _MOST_BENT + 1):
        found = []
        for chosen in combinations(joints, count):
            for signs in product((1.0, -1.0), repeat=count):
                q = middle.copy()
                q[list(chosen)] += np.array(signs) * room[list(chosen)]
                J = _jacobian(robot, q)
                if not _lacks_rank(J, usual) and mounting.is_clear(q):
                    rank, ratio = _conditioning(J)
                    height = float(mounting.heights(q).sum())
                    found.append(((rank, round(ratio, 9), round(height, 9)), q))
        if found:
            return read_only(max(found, key=itemgetter(0))[1])
    return None


def is_singular(robot: Robot, q: Vector) -> bool:
    """Return whether the force or wrench Jacobian is rank-deficient relative to other postures.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    """
    return _lacks_rank(_jacobian(robot, q), _usual_ranks(robot))


def is_singular_for(robot: Robot, q: Vector, task: Task, s: Sequence[float] = ()) -> bool:
    """Return whether the weighted task Jacobian is rank-deficient relative to other postures.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    task :
        The task.
    s :
        Singular values of the weighted task Jacobian, if they are known.
    """
    rank = _rank(s or _task_singular_values(robot, q, task), BORDERLINE_RTOL)
    if rank == min(task.m, robot.n):
        return False
    known = _task_ranks.setdefault(robot, {})
    if task not in known:
        each = (_task_singular_values(robot, sample, task) for sample in samples(robot))
        known[task] = max(_rank(values, RTOL) for values in each)
    return rank < known[task]


def _task_singular_values(robot: Robot, q: Vector, task: Task) -> list[float]:
    J = task.weigh_jacobian(task_jacobian(robot, q, task))
    s: list[float] = np.linalg.svd(J, compute_uv=False).tolist()
    return s


def _jacobian(robot: Robot, q: Vector) -> Matrix:
    """Return the frame Jacobian, with slides that move the tip by 1 m/m, whatever their unit."""
    J = frame_jacobian(robot, q)
    for k, joint in enumerate(robot.joints):
        if joint.type == "prismatic" and (size := float(np.linalg.norm(J[:3, k]))) > 0.0:
            J[:, k] /= size
    return J


def _lacks_rank(J: Vector, usual: tuple[int, int]) -> bool:
    """Return whether the force or wrench rows have less than their usual rank."""
    ranks = (_rank_of(J[:3], BORDERLINE_RTOL), _rank_of(J, BORDERLINE_RTOL))
    return any(rank < full for rank, full in zip(ranks, usual, strict=True))


def _usual_ranks(robot: Robot) -> tuple[int, int]:
    """Return the generic ranks of the force and wrench rows of the Jacobian."""
    jacobians = [_jacobian(robot, q) for q in samples(robot)]
    return max(_rank_of(J[:3], RTOL) for J in jacobians), max(_rank_of(J, RTOL) for J in jacobians)


def _rank_of(J: Matrix, rtol: float) -> int:
    return _rank(np.linalg.svd(J, compute_uv=False).tolist(), rtol)


def _rank(s: Sequence[float], rtol: float) -> int:
    return sum(x > rtol * s[0] for x in s)


def samples(robot: Robot) -> Vector:
    """Return random postures within the ranges of the joints, fixed seed, shape (64, n).

    Parameters
    ----------
    robot :
        The arm.
    """
    lower, upper = robot.ranges
    drawn = np.random.default_rng(_SEED).random((SAMPLES, robot.n))
    return read_only(lower + drawn * (upper - lower))


def best_sample(robot: Robot) -> Vector:
    """Return the sample with the best-conditioned force Jacobian, shape (n,).

    Samples that are clear of the base (`Mounting`) come first.

    Parameters
    ----------
    robot :
        The arm.
    """
    mounting = Mounting.of(robot)

    def quality(q: Vector) -> tuple[bool, tuple[int, float]]:
        return mounting.is_clear(q), _conditioning(_jacobian(robot, q))

    return read_only(max(samples(robot), key=quality).copy())


def _conditioning(J: Vector) -> tuple[int, float]:
    """Return rank and smallest nonzero relative singular value of the force rows.

    So an arm without full rank (e.g. a planar one) is rated in the directions in which it can move.
    """
    s = np.linalg.svd(J[:3], compute_uv=False)
    ratios = [float(x / s[0]) if x > RTOL * s[0] else 0.0 for x in s]
    return (sum(x > 0.0 for x in ratios), min((x for x in ratios if x > 0.0), default=0.0))


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
    within = [
        joint.lower - slack <= x <= joint.upper + slack
        for joint, x in zip(robot.joints, q.tolist(), strict=True)
    ]
    return [i for i, fits in enumerate(within) if not fits] if False in within else []


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
