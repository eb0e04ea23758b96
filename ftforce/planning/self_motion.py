"""The self-motion manifold: all postures within the limits that keep the tip where it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.question import check_progress
from ftforce.core.arrays import as_vector, is_number, read_only
from ftforce.errors import InputError
from ftforce.planning.cover import MOST, cover
from ftforce.planning.projection import closest, project
from ftforce.planning.target import (
    TipTarget,
    checked_limits,
    residual,
    residuals_and_jacobians,
    wide_joints,
)
from ftforce.planning.trace import RANK_RTOL, Manifold, trace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.analysis.question import Progress
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

REACHED = 1e-9  # m and rad
_RESOLUTIONS = {2: 0.15, 3: 0.8}  # rad or m, by dimension
_COARSE = 1.4  # of four and more
_COARSER = 1.4  # by how much a resolution is enlarged that takes too many samples
_MORE = 256  # random postures tried before a target is called unreachable
_SAME = 1e-6  # rad or m: postures of an arm without redundancy
_NEAR = 0.1  # of the step: as far as a posture on a traced curve may be from its chords


@dataclass(frozen=True, eq=False)
class Component:
    """One connected piece of a self-motion manifold within the limits.

    Attributes
    ----------
    q :
        Postures, rad or m, shape (N, n), read-only: in order along the curve (dimension 1), or
        samples (2 and more); a single one without redundancy. The last of a loop is the one before
        the first.
    closed :
        Whether it is a loop: a curve that returns to its start, whole turns of joints without
        limits apart.
    dimension :
        Dimension of the manifold.
    complete :
        Whether it is traced or covered whole; if not, the largest number of samples was reached.
    """

    q: Matrix
    closed: bool
    dimension: int
    complete: bool = True

    @cached_property
    def ranges(self) -> Matrix:
        """Least and greatest position of each joint on it, rad or m, shape (n, 2)."""
        return read_only(np.stack([self.q.min(axis=0), self.q.max(axis=0)], axis=1))


@dataclass(frozen=True, eq=False)
class SelfMotion:
    """All postures that were found to reach a target.

    Attributes
    ----------
    target :
        What of the tip is kept.
    components :
        Connected pieces, the one of the starting posture first, then as found.
    found_from, restarts :
        How many of the random restarts, and of the starting posture if one was given, converged,
        and how many there were.
    seed :
        Seed of the restarts.
    tip_error :
        Greatest residual over all samples, m and rad.
    step :
        Longest distance between neighbours in joint space, rad or m.
    manifold :
        Its equations and limits.
    """

    target: TipTarget
    components: tuple[Component, ...]
    found_from: int
    restarts: int
    seed: int
    tip_error: float
    step: float
    manifold: Manifold

    @property
    def dimension(self) -> int:
        """Dimension of the self-motion; 0 for an arm without redundancy."""
        return self.components[0].dimension

    @cached_property
    def ranges(self) -> Matrix:
        """Least and greatest position of each joint, rad or m, shape (n, 2)."""
        each = np.array([component.ranges for component in self.components])
        return read_only(np.stack([each[:, :, 0].min(axis=0), each[:, :, 1].max(axis=0)], axis=1))

    @cached_property
    def q(self) -> Matrix:
        """All samples, component by component, rad or m, shape (N, n)."""
        return read_only(np.concatenate([component.q for component in self.components]))


def self_motion(
    robot: Robot,
    target: TipTarget,
    *,
    start: ArrayLike | None = None,
    restarts: int = 128,
    step: float = 0.05,
    resolution: float | None = None,
    seed: int = 0,
    limits: ArrayLike | None = None,
    most: int = MOST,
    progress: Progress | None = None,
) -> SelfMotion:
    """Return the self-motion manifold of a target: every component that random restarts find.

    One-dimensional manifolds are traced whole, with error control; those of more dimensions are
    covered by samples. Joints that may make more than a whole turn start as close to the middle of
    their range as possible, and are covered for the one turn around it.

    Parameters
    ----------
    robot :
        The arm.
    target :
        What of the tip is kept.
    start :
        Posture from which the search starts first, rad or m, shape (n,).
    restarts :
        Number of random postures from which the search starts.
    step :
        Longest distance between neighbours on a curve, rad or m in joint space.
    resolution :
        The same for manifolds of more dimensions; by default 0.15 for two, 0.8 for three and 1.4
        for more, and coarser if that takes too many samples (``SelfMotion.step``).
    seed :
        Seed of the random postures.
    limits :
        Lower and upper limits in place of the arm's own, shape (2, n); a joint whose limits are
        equal is locked there.
    most :
        Number of samples of a manifold of two or more dimensions, at most. With a resolution that
        was given, those beyond are left out.
    progress :
        Called with the number of converged restarts that are settled, and their total.

    Raises
    ------
    InputError
        A value is malformed, the limits exclude everything, or the tip cannot reach the target;
        then the message says how far away the closest place found is.
    """
    check_progress(progress)
    _check_numbers(restarts, step, resolution, seed)
    lower, upper = checked_limits(robot, limits)
    first = None if start is None else as_vector(start, robot.n, "start", "one per joint")
    tried = _restarts(robot, lower, upper, restarts, seed)
    if first is not None:
        tried = np.concatenate([first[None], tried])
    q, reached = _found(robot, target, tried, (lower, upper))
    if not len(reached):  # before that is said, more is tried
        more = _restarts(robot, lower, upper, max(_MORE, restarts), seed + 1)
        tried = np.concatenate([tried, more])
        q, reached = _found(robot, target, tried, (lower, upper))
    if not len(reached):
        raise _unreachable(robot, target, q, (lower, upper))
    manifold = _manifold(robot, target, reached, lower, upper)
    d = manifold.dimension
    size = step if d < 2 else (resolution or _RESOLUTIONS.get(d, _COARSE))
    starts = _near_middle(manifold, reached, keep=first is not None)
    found = _components(manifold, starts, size, most, progress)
    while d > 1 and resolution is None and not all(one.complete for one in found):
        size *= _COARSER
        found = _components(manifold, starts, size, most, progress)
    worst = max(float(np.abs(residual(robot, one.q, target)).max()) for one in found)
    return SelfMotion(target, found, len(reached), len(tried), seed, worst, size, manifold)


def _components(
    manifold: Manifold, starts: Matrix, step: float, most: int, progress: Progress | None
) -> tuple[Component, ...]:
    """Return the components that hold some postures, with so many samples in all."""
    found: list[Component] = []
    for done, one in enumerate(starts, start=1):
        left = most - sum(len(component.q) for component in found)
        if left > 0 and not any(_holds(manifold, component, one, step) for component in found):
            found.append(_component(manifold, one, step, left))
        if progress is not None:
            progress(done, len(starts))
    return tuple(found)


def _check_numbers(restarts: int, step: float, resolution: float | None, seed: int) -> None:
    for name, value, least in (("restarts", restarts, 1), ("seed", seed, 0)):
        is_integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
        if not is_integer or value < least:
            raise InputError(f"{name} must be an integer of at least {least}, got {value!r}")
    for name, size in (("step", step), ("resolution", resolution)):
        if size is not None and not (is_number(size) and 1e-4 <= size <= 1.0):
            raise InputError(f"{name} must be a length from 0.0001 to 1 (rad or m), got {size!r}")


def _found(
    robot: Robot, target: TipTarget, tried: Matrix, limits: tuple[Vector, Vector]
) -> tuple[Matrix, Matrix]:
    """Return where searches from some postures end, and those that reach the target."""
    q, reached = project(robot, tried, target, limits=np.array(limits))
    return q, q[reached]


def _restarts(robot: Robot, lower: Vector, upper: Vector, count: int, seed: int) -> Matrix:
    """Return the random postures from which the search starts."""
    low, high = robot.ranges
    low = np.where(np.isfinite(lower), lower, np.minimum(low, upper - 2.0 * np.pi))
    high = np.where(np.isfinite(upper), upper, np.maximum(high, lower + 2.0 * np.pi))
    low = np.where(np.isfinite(low), low, -np.pi)
    high = np.where(np.isfinite(high), high, np.pi)
    drawn: Matrix = np.random.default_rng(seed).random((count, robot.n))
    return low + drawn * (high - low)


def _manifold(robot: Robot, target: TipTarget, q: Matrix, lower: Vector, upper: Vector) -> Manifold:
    J = residuals_and_jacobians(robot, q, target)[1][:, :, upper > lower]
    s = np.linalg.svd(J, compute_uv=False)
    rank = int((s > RANK_RTOL * s[:, :1]).sum(axis=1).max()) if J.size else 0
    wide = wide_joints(robot, lower, upper)
    found = Manifold(robot, target, lower, upper, wide, rank)
    if found.dimension < 2 or not wide.any():
        return found
    middle = _middle(found)
    lower = np.where(wide, np.maximum(lower, middle - np.pi), lower)
    upper = np.where(wide, np.minimum(upper, middle + np.pi), upper)
    return replace(found, lower=read_only(lower), upper=read_only(upper))


def _middle(manifold: Manifold) -> Vector:
    """Return the middle of the limits, 0 for joints that lack one, shape (n,)."""
    middle = np.zeros(manifold.robot.n)
    both = np.isfinite(manifold.lower) & np.isfinite(manifold.upper)
    middle[both] = 0.5 * (manifold.lower[both] + manifold.upper[both])
    return middle


def _near_middle(manifold: Manifold, q: Matrix, *, keep: bool) -> Matrix:
    """Return postures with wide joints turned by 2π until they are closest to mid-range.

    Parameters
    ----------
    manifold, q :
        The self-motion, and postures on it.
    keep :
        Whether the first stays as it is.
    """
    middle = _middle(manifold)
    turned = middle + manifold.between(q, middle, manifold.wide)
    # A joint with one limit only may not be turned beyond it.
    fits = (turned >= manifold.lower) & (turned <= manifold.upper)
    turned = np.where(fits, turned, q)
    if keep and manifold.dimension < 2:
        turned[0] = q[0]
    return turned


def _holds(manifold: Manifold, component: Component, q: Vector, step: float) -> bool:
    """Return whether a posture belongs to a component, whole turns of wide joints apart."""
    apart = manifold.between(q, component.q, manifold.wide)
    distance = np.linalg.norm(apart, axis=1)
    if component.dimension == 0:
        return bool(distance.min() <= _SAME)
    if component.dimension > 1:
        return bool(distance.min() <= step)
    if distance.min() > 2.0 * step:
        return False
    chords = np.roll(component.q, -1, axis=0) - component.q
    chords = manifold.between(chords, np.zeros(len(q)), manifold.endless)
    if not component.closed:
        chords[-1] = 0.0
    length = np.einsum("ij,ij->i", chords, chords)
    along = np.einsum("ij,ij->i", apart, chords) / np.where(length > 0.0, length, 1.0)
    off = apart - np.clip(along, 0.0, 1.0)[:, None] * chords
    return bool(np.linalg.norm(off, axis=1).min() <= _NEAR * step)


def _component(manifold: Manifold, q: Vector, step: float, most: int) -> Component:
    d = manifold.dimension
    if d == 0:
        return Component(read_only(q[None].copy()), closed=False, dimension=0)
    if d == 1:
        curve = trace(manifold, q, step)
        return Component(read_only(curve.q), curve.closed, 1, curve.complete)
    found = cover(manifold, q, step, most)
    return Component(read_only(found), False, d, len(found) < most)


def _unreachable(
    robot: Robot, target: TipTarget, q: Matrix, limits: tuple[Vector, Vector]
) -> InputError:
    """Return the error for a target that no posture reaches, with the closest one found."""
    order = np.argsort(np.linalg.norm(residual(robot, q, target), axis=1))[:4]
    missed = np.zeros(6)
    missed[list(target.rows)] = residual(robot, closest(robot, q[order], target, *limits), target)
    away = f"{np.linalg.norm(missed[:3]):.3g} m"
    if target.rotation is not None:
        away += f" and {np.rad2deg(np.linalg.norm(missed[3:])):.3g}°"
    where = ", ".join(f"{x:.4g}" for x in target.position.tolist())
    what = "point" if target.rotation is None else "pose"
    return InputError(
        f"the tip cannot reach the {what} at ({where}) m in root axes within the joint limits: the "
        f"closest posture found is {away} away ({len(q)} starts)"
    )
