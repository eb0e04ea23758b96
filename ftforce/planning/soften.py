"""Artificial joint limits that leave the largest region in which a lock of any joint is tolerated.

Points of the reach are sampled with postures on their self-motion manifolds, each joint locked at
positions throughout its range. Whether a point tolerates a lock within given limits can then be
looked up, so that thousands of limits can be tried. This only chooses the limits: what they are
worth is for the bounds to show (`ftforce.planning.reach`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.errors import InputError
from ftforce.planning.joint_ranges import JointRanges
from ftforce.planning.reachable import Reachable

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.tip_point import TipPoint

_POINTS = {2: 4000, 3: 600}  # about so many, by the number of coordinates
_IN_BOX = 5  # points along each edge of the box
_BINS = {2: 72, 3: 24}
_TRIES = 1  # starts per point and locked position
_ERROR = 1e-9  # m
_GENERATIONS, _PER_VARIABLE = 80, 6
_FIRST_STEP, _LAST_STEP = 0.1, 0.004  # of the joint ranges
_SOFTENED = "chosen by ftforce"


@dataclass(frozen=True, eq=False)
class _Manifolds:
    """Postures on the self-motion manifolds of points.

    Attributes
    ----------
    of :
        For each joint that moves the tip, the number of the point of every posture.
    bins, q :
        The same of the bin of the locked position, and of the joint positions, shape (n, k).
    edges :
        For each joint, the ends of the bins.
    count, boxed :
        Number of points, and how many of them, the last ones, lie in the box.
    release :
        Whether the others keep the arm's own limits after the fault.
    """

    of: list[NDArray[np.intp]]
    bins: list[NDArray[np.intp]]
    q: list[Matrix]
    edges: list[Vector]
    count: int
    boxed: int
    release: bool

    @cached_property
    def _found(self) -> list[NDArray[np.int16]]:
        """For each joint, the numbers of bins up to each one that hold a posture of a point."""
        every = zip(self.of, self.bins, strict=True)
        return [self._counted(joint, *pair) for joint, pair in enumerate(every)]

    def _counted(
        self, joint: int, of: NDArray[np.intp], bins: NDArray[np.intp]
    ) -> NDArray[np.int16]:
        found = np.zeros((self.count, len(self.edges[joint])), dtype=np.int16)
        found[of, bins + 1] = 1
        return found.cumsum(axis=1, dtype=np.int16)

    def value(self, low: Vector, high: Vector) -> float:
        """Return how good limits are: points that tolerate any lock, the box before the rest.

        Parameters
        ----------
        low, high :
            Limits of the joints, rad or m, shape (n,).
        """
        reached = np.zeros(self.count, dtype=bool)
        covered = np.ones(self.count)
        for joint, (of, bins, q) in enumerate(zip(self.of, self.bins, self.q, strict=True)):
            outside = np.zeros(len(of), dtype=np.int8)
            for i in range(len(q)):
                outside += (q[i] < low[i]) | (q[i] > high[i])
            reached[of[outside == 0]] = True
            found = self._found[joint]
            if not self.release:
                outside -= (q[joint] < low[joint]) | (q[joint] > high[joint])
                usable = outside == 0
                found = self._counted(joint, of[usable], bins[usable])
            edges = self.edges[joint]
            first = int(np.searchsorted(edges, low[joint], side="right")) - 1
            last = max(first + 1, int(np.searchsorted(edges, high[joint], side="left")))
            here = (found[:, last] - found[:, first]) / (last - first)
            covered = np.minimum(covered, here)
        share = np.where(reached, covered, 0.0)
        good = share >= 1.0
        boxed = slice(self.count - self.boxed, self.count)
        inside = int(good[boxed].sum())
        nearly = 0.01 * float(share.mean())  # something to climb where no point tolerates anything
        nearly += float(share[boxed].sum())
        return float(good.sum() - inside + self.count * inside) + nearly


def softened(
    tip: TipPoint,
    own: JointRanges,
    *,
    release: bool,
    around: Matrix | None,
    seed: int,
    tick: Callable[[int, int], None],
) -> JointRanges:
    """Return artificial limits that make the tolerated region large.

    Parameters
    ----------
    tip :
        The tip point.
    own :
        The widest limits.
    release :
        Whether the arm's own limits hold after the fault.
    around :
        Box to tolerate first, lower and upper ends, m, shape (2, m); ``None`` without.
    seed :
        Seed of the search.
    tick :
        Called with the steps done and their total.

    Raises
    ------
    InputError
        The arm does not reach the box.
    """
    total = tip.moving * _TRIES + _GENERATIONS + 1
    manifolds = _manifolds(
        tip, own, release=release, around=around, seed=seed, tick=lambda k: tick(k, total)
    )
    least, most = own.swept.T

    def ends(x: Vector) -> tuple[Vector, Vector]:
        middle, half = _split(x, tip.moving, own)
        return np.clip(middle - half, least, most), np.clip(middle + half, least, most)

    def loss(x: Vector) -> float:
        return -manifolds.value(*ends(x))

    done = tip.moving * _TRIES
    from scipy.optimize import differential_evolution

    def generation(*_: object) -> None:
        nonlocal done
        done += 1
        tick(min(done, total), total)

    found = differential_evolution(
        loss,
        [(0.0, 1.0)] * (2 * tip.moving),
        x0=np.repeat([0.5, 0.5], tip.moving),
        maxiter=_GENERATIONS,
        popsize=_PER_VARIABLE,
        seed=seed,
        polish=False,
        tol=0.0,
        callback=generation,
    ).x
    low, high = ends(_climbed(loss, found))
    return JointRanges(own.robot, read_only(np.column_stack([low, high])), _SOFTENED)


def _split(x: Vector, moving: int, own: JointRanges) -> tuple[Vector, Vector]:
    """Return middles and half widths of limits; joints that do not move the tip keep theirs."""
    least, most = own.swept.T
    middle, half = 0.5 * (least + most), 0.5 * (most - least)
    width = half.copy()
    middle[:moving] = least[:moving] + x[:moving] * 2.0 * half[:moving]
    width[:moving] = x[moving:] * half[:moving]
    return middle, width


def _climbed(loss: Callable[[Vector], float], x: Vector) -> Vector:
    """Return x improved one variable at a time, in ever smaller steps."""
    best, least = x.copy(), loss(x)
    step = _FIRST_STEP
    while step > _LAST_STEP:
        before = least
        for i in range(len(best)):
            for sign in (step, -step):
                tried = best.copy()
                tried[i] = min(max(tried[i] + sign, 0.0), 1.0)
                if (value := loss(tried)) < least:
                    best, least = tried, value
        if least >= before:
            step *= 0.5
    return best


def _manifolds(
    tip: TipPoint,
    own: JointRanges,
    *,
    release: bool,
    around: Matrix | None,
    seed: int,
    tick: Callable[[int], None],
) -> _Manifolds:
    """Return postures on the self-motion manifolds of points that the arm reaches."""
    reachable = Reachable(tip, own.limits, own.swept, seed)
    points, boxed = _points(tip, reachable, around)
    count = _BINS[tip.m]
    of, bins, q, edges = [], [], [], []
    for joint in range(tip.moving):
        low, high = own.swept[joint].tolist()
        ends = np.linspace(low, high, count + 1)
        point, bin_ = (one.ravel() for one in np.indices((len(points), count)))
        position = 0.5 * (ends[bin_] + ends[bin_ + 1])
        seeds = reachable.seeds(points[point], joint, position, _TRIES)
        found = []
        for k in range(_TRIES):
            found.append(reachable.search(seeds[:, k], points[point], joint, position))
            tick(joint * _TRIES + k + 1)
        good = [one.error <= _ERROR for one in found]
        of.append(np.concatenate([point[one] for one in good]))
        bins.append(np.concatenate([bin_[one] for one in good]))
        ended = np.concatenate([f.q[g] for f, g in zip(found, good, strict=True)])
        q.append(np.ascontiguousarray(_turned(own, ended).T))
        edges.append(ends)
    return _Manifolds(of, bins, q, edges, len(points), boxed, release)


def _turned(own: JointRanges, q: Matrix) -> Matrix:
    """Return positions of joints that turn freely within their one turn."""
    low, high = own.swept.T
    free = np.isinf(own.limits[:, 1])
    return np.where(free, low + np.mod(q - low, 2.0 * math.pi), np.clip(q, low, high))


def _points(tip: TipPoint, reachable: Reachable, around: Matrix | None) -> tuple[Matrix, int]:
    """Return points of the healthy reach, those of the box last, and the number of these."""
    tips = reachable.samples[1]
    low, high = tips.min(axis=0), tips.max(axis=0)
    spacing = float((np.prod(high - low) / _POINTS[tip.m]) ** (1.0 / tip.m)) or 1.0
    lines = [np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True)]
    points = _product(lines)
    points = points[_is_reached(reachable, points)]
    if around is None:
        return points, 0
    box = _product([np.linspace(a, b, _IN_BOX) for a, b in around.T])
    reached = _is_reached(reachable, box)
    if not reached.any():
        raise InputError("the tip reaches no point of the box for which limits are to be chosen")
    return np.concatenate([points, box]), len(box)


def _product(lines: list[Vector]) -> Matrix:
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(lines))


def _is_reached(reachable: Reachable, points: Matrix) -> Mask:
    """Return which points a posture within the limits is found for."""
    still = np.zeros(len(points))
    seeds = reachable.seeds(points, None, still, _TRIES)
    found = [reachable.search(seeds[:, k], points, None, still) for k in range(_TRIES)]
    reached: Mask = np.any([one.error <= _ERROR for one in found], axis=0)
    return reached
