"""Boxes of tip positions that an arm reaches whatever position a joint is locked at, with proof.

A posture proves its surroundings: if the joints that still move can make up for every small change
of the point and of the locked position without leaving their limits, so Brouwer's theorem, every
point of a box is reached with the joint locked anywhere in an interval (docs/theory/self-motion).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.tip_point import TipPoint

    Stack = NDArray[np.float64]

_SAMPLES = 2**15  # postures among which starts of searches are chosen
_SEEDS = 6  # starts of searches where the neighbour's posture does not serve
_ITERATIONS = 12
_CENTRING = 6  # iterations in which joints are drawn away from their limits
_ROOM = 0.3  # rad or m; so far
_CHOSEN_FROM = 8  # times the starts of searches: near postures of which the best are taken
_CONVERGED = 1e-10  # m
_DAMPING = 1e-12  # m²
_WIDEST, _NARROWEST = 0.15, 0.002  # half widths of the intervals of a locked position, of its range
_ROUNDING = 1e-12
_LONGEST = 1.0  # rad or m; of a step of the search
_SINGULAR = 1e-4  # m/rad
_LARGEST = 1.0  # rad or m; larger surroundings are not tried
_BOUNDINGS = 8  # steps to the size of the surroundings
_BLOCK = 8192


class Searched(NamedTuple):
    """Postures that a search ended in.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (k, n).
    J, angular :
        Jacobians of the tip position, shape (k, m, n), and of its rotation, shape (k, 3, n).
    error :
        Distances of the tip from its points, m, shape (k,).
    """

    q: Matrix
    J: Stack
    angular: Stack
    error: Vector


@dataclass(frozen=True, eq=False)
class Reachable:
    """What an arm is shown to reach within limits, with or without a locked joint.

    Attributes
    ----------
    tip :
        The tip point.
    limits :
        Limits of the joints that move, rad or m, shape (n, 2); infinite without.
    drawn :
        Finite ranges from which postures are drawn, rad or m, shape (n, 2).
    seed :
        Seed of the draw.
    """

    tip: TipPoint
    limits: Matrix
    drawn: Matrix
    seed: int

    @cached_property
    def samples(self) -> tuple[Matrix, Matrix]:
        """Postures within the ranges, shape (s, n), and their tips, m, shape (s, m)."""
        from scipy.stats import qmc

        draw = qmc.Sobol(self.tip.robot.n, seed=self.seed).random(_SAMPLES)
        q = self.drawn[:, 0] + draw * (self.drawn[:, 1] - self.drawn[:, 0])
        return q, self.tip.placed(q)[0]

    def seeds(self, points: Matrix, joint: int | None, position: Vector, count: int) -> Stack:
        """Return postures whose tips are near points, shape (k, count, n).

        Parameters
        ----------
        points :
            Points, m, shape (k, m).
        joint :
            Index of a joint that is near a position as well; ``None`` without.
        position :
            Its positions, rad or m, shape (k,).
        count :
            Postures per point.
        """
        tree, dexterity = self._trees(joint)
        asked = points
        if joint is not None:
            asked = np.column_stack([points, self._weight(joint) * position])
        _, found = tree.query(asked, _CHOSEN_FROM * count)
        best = np.argsort(-dexterity[found], axis=1)[:, :count]
        q: Stack = self.samples[0][np.take_along_axis(found, best, axis=1)]
        return q

    def _weight(self, joint: int) -> float:
        return float(0.5 * self.tip.reaches[joint]) if not self.tip.is_prismatic[joint] else 1.0

    def _trees(self, joint: int | None) -> Any:
        from scipy.spatial import cKDTree

        if joint not in self._kept:
            q, tips = self.samples
            K = self.tip.placed(q)[1]
            if joint is not None:
                tips = np.column_stack([tips, self._weight(joint) * q[:, joint]])
                K[:, :, joint] = 0.0
            slack = np.minimum(q - self.limits[:, 0], self.limits[:, 1] - q)
            if joint is not None:
                slack[:, joint] = np.inf
            least = np.linalg.eigvalsh(K @ K.transpose(0, 2, 1))[:, 0]
            near = np.minimum(slack.min(axis=1) / _ROOM, 1.0)
            self._kept[joint] = cKDTree(tips), np.sqrt(np.maximum(least, 0.0)) * near
        return self._kept[joint]

    @cached_property
    def _kept(self) -> dict[int | None, Any]:
        return {}

    def search(self, q: Matrix, points: Matrix, joint: int | None, position: Vector) -> Searched:
        """Return postures within the limits whose tips are at points, found by Newton's method.

        Parameters
        ----------
        q :
            Where to start, rad or m, shape (k, n).
        points :
            Points, m, shape (k, m).
        joint, position :
            Index of the locked joint, ``None`` without, and where it is locked, shape (k,).
        """
        low, high = self.limits.T
        q = np.clip(q, low, high)
        if joint is not None:
            q[:, joint] = position
        room = np.minimum(_ROOM, 0.25 * (high - low))
        active = np.arange(len(q))
        for step in range(_ITERATIONS):
            tip, K, _ = self.tip.placed(q[active])
            error = points[active] - tip
            pull = 0.5 * (np.clip(q[active], low + room, high - room) - q[active])
            pull *= step < _CENTRING  # away from the limits
            if joint is not None:
                K[:, :, joint] = pull[:, joint] = 0.0
            rest = (np.abs(error).max(axis=1) > _CONVERGED / 4.0) | (np.abs(pull) > 0.01).any(
                axis=1
            )
            active, q_now = active[rest], q[active[rest]]
            if not len(active):
                break
            change = _within(q_now, K[rest], error[rest], pull[rest], (low, high))
            size = np.abs(change).max(axis=1)
            change *= np.minimum(1.0, _LONGEST / np.maximum(size, _ROUNDING))[:, None]
            q[active] = np.clip(q_now + change, low, high)
        tip, J, angular = self.tip.placed(q)
        return Searched(q, J, angular, np.linalg.norm(points - tip, axis=1))

    def is_proved(
        self, found: Searched, half: float, joint: int | None = None, width: Vector | None = None
    ) -> Mask:
        """Return whether postures prove their surroundings, shape (k,).

        Parameters
        ----------
        found :
            The postures.
        half :
            Half edge of the boxes around the points, m.
        joint, width :
            Index of the locked joint, and half widths of the intervals around its positions, rad or
            m, shape (k,).
        """
        half_width = np.zeros(len(found.q)) if width is None else width
        proved = np.zeros(len(found.q), dtype=bool)
        for first in range(0, len(proved), _BLOCK):
            rows = slice(first, first + _BLOCK)
            part = Searched(*(one[rows] for one in found))
            proved[rows] = self._is_proved(part, half, joint, half_width[rows])
        return proved

    def _is_proved(self, found: Searched, half: float, joint: int | None, width: Vector) -> Mask:
        """Return `is_proved` for a block of postures (docs/theory/self-motion, 3 to 6)."""
        q, J, angular, error = found
        K = J.copy()
        if joint is not None:
            K[:, :, joint] = 0.0
        U, sigma, Vt = np.linalg.svd(K, full_matrices=False)
        good = (sigma[:, -1] > _SINGULAR) & (error <= _CONVERGED)
        inverse = Vt.transpose(0, 2, 1) / np.maximum(sigma, _SINGULAR)[:, None, :]  # K⁺ U
        basis = [inverse]
        if joint is not None:  # the self-motion that a change of the locked position asks for
            along = -np.einsum("knm,kam,ka->kn", inverse, U, J[:, :, joint])
            along[:, joint] = 1.0
            basis.append(along[..., None])
        B = np.concatenate(basis, axis=2)
        H = second_derivatives(J, angular, self.tip.rows)
        Q = np.einsum("kar,kanj,knb,kjc->krbc", U, H, B, B, optimize=True)
        own = np.abs(U).sum(axis=1) * half + error[:, None]  # |Uᵀ e|
        ends = own[:, : B.shape[2]]
        if joint is not None:
            ends = np.column_stack([own, width])
        bound, rest = ends.copy(), np.zeros_like(own)
        for step in range(_BOUNDINGS + 1):
            rest = self._rest(np.abs(Q), np.abs(B), bound)
            if step == _BOUNDINGS:
                break
            bound[:, : self.tip.m] = own + 1.05 * rest
            good &= (bound < _LARGEST).all(axis=1)
            bound = np.minimum(bound, _LARGEST)
        good &= (own + rest <= bound[:, : self.tip.m]).all(axis=1)
        moved = np.einsum("knb,kb->kn", np.abs(B), bound) + _ROUNDING
        slack = np.minimum(q - self.limits[:, 0], self.limits[:, 1] - q)
        if joint is not None:
            slack[:, joint] = np.inf
        proved: Mask = good & (moved <= slack).all(axis=1)
        return proved

    def _rest(self, Q: Stack, B: Stack, bound: Matrix) -> Matrix:
        """Return bounds on what the linear part leaves out of the tip's motion, m, shape (k, m)."""
        second = 0.5 * np.einsum("krbc,kb,kc->kr", Q, bound, bound, optimize=True)
        moved = np.cumsum(np.einsum("knb,kb->kn", B, bound), axis=1)
        cubes = np.diff(moved**3, axis=1, prepend=0.0)
        third: Vector = cubes @ self.tip.largest / 6.0
        found: Matrix = second + third[:, None]
        return found

    def reaches(self, points: Matrix, half: float) -> Mask:
        """Return which boxes the healthy arm is shown to reach, shape (k,).

        Parameters
        ----------
        points :
            Middles of the boxes, m, shape (k, m).
        half :
            Half edge of the boxes, m; 0 for the middles alone.
        """
        still = np.zeros(len(points))
        proved = np.zeros(len(points), dtype=bool)
        seeds = self.seeds(points, None, still, 4 * _SEEDS) if len(points) else None
        for k in range(4 * _SEEDS):
            left = np.flatnonzero(~proved)
            if not left.size or seeds is None:
                break
            found = self.search(seeds[left, k], points[left], None, still[left])
            is_there = found.error <= _CONVERGED
            proved[left] = self.is_proved(found, half) if half else is_there
        return proved

    def tolerates(
        self,
        points: Matrix,
        half: float,
        joint: int,
        positions: tuple[float, float],
        tick: Callable[[], None] = lambda: None,
    ) -> Mask:
        """Return which boxes the arm is shown to reach wherever in a range a joint locks, (k,).

        Parameters
        ----------
        points, half :
            Middles of the boxes, m, shape (k, m), and their half edge, m.
        joint :
            Index of the joint that locks.
        positions :
            The range of its positions, rad or m.
        tick :
            Called between steps.
        """
        first, last = positions
        span = max(last - first, 0.0)
        until = np.full(len(points), first)  # shown up to here
        width = np.full(len(points), _WIDEST if span > 2 * _WIDEST else span / 2)
        narrowest = min(_NARROWEST * span, _NARROWEST)
        failed = np.zeros(len(points), dtype=bool)
        near = self.seeds(points, joint, until, 1)[:, 0] if len(points) else np.zeros((0, 0))
        is_done = np.zeros(len(points), dtype=bool)
        while (left := np.flatnonzero(~failed & ~is_done)).size:
            tick()
            half_width = np.minimum(width[left], 0.5 * (last - until[left]))
            middle = until[left] + half_width
            found = self.search(near[left], points[left], joint, middle)
            good = self.is_proved(found, half, joint, half_width)
            near[left[good]] = found.q[good]
            hard = np.flatnonzero(~good)
            if hard.size:
                at = left[hard]
                good[hard], q = self._any_seed(
                    points[at], half, joint, middle[hard], half_width[hard]
                )
                near[at[good[hard]]] = q[good[hard]]
            done, rest = left[good], left[~good]
            until[done] = middle[good] + half_width[good]
            is_done[done] = until[done] >= last - _ROUNDING
            width[done] = np.minimum(1.6 * width[done], _WIDEST)
            width[rest] = 0.5 * half_width[~good]
            failed[rest] = width[rest] < narrowest
            if span == 0.0:
                failed[rest] = True
        return ~failed

    def _any_seed(
        self, points: Matrix, half: float, joint: int, position: Vector, width: Vector
    ) -> tuple[Mask, Matrix]:
        """Return whether one of several starts leads to a proof, and the postures."""
        count = len(points)
        seeds = self.seeds(points, joint, position, _SEEDS)
        every = np.repeat(np.arange(count), _SEEDS)
        found = self.search(
            seeds.reshape(-1, self.tip.robot.n), points[every], joint, position[every]
        )
        good = self.is_proved(found, half, joint, width[every]).reshape(count, _SEEDS)
        best = good.argmax(axis=1)
        any_good: Mask = np.asarray(good.any(axis=1))
        return any_good, found.q.reshape(count, _SEEDS, -1)[np.arange(count), best]


def _within(
    q: Matrix, K: Stack, error: Matrix, pull: Matrix, limits: tuple[Vector, Vector]
) -> Matrix:
    """Return the least changes that move the tips by ``error``; joints stop at their limits."""
    change = _least_norm(K, error, pull)
    stopped = np.zeros(q.shape, dtype=np.bool_)
    for _ in range(2):
        beyond = np.clip(q + change, *limits) - q
        leaves = np.abs(beyond - change) > _ROUNDING
        if not leaves.any():
            break
        stopped |= leaves
        rest = error - np.einsum("kmn,kn->km", K, np.where(stopped, beyond, 0.0))
        free = np.where(stopped[:, None, :], 0.0, K)
        others = _least_norm(free, rest, np.where(stopped, 0.0, pull))
        change = np.where(stopped, beyond, others)
    return change


def _least_norm(K: Stack, error: Matrix, pull: Matrix) -> Matrix:
    """Return the change nearest to ``pull`` that moves the tip by ``error``, shape (k, n)."""
    gram = K @ K.transpose(0, 2, 1) + _DAMPING * np.eye(K.shape[1])
    rest = error - np.einsum("kmn,kn->km", K, pull)
    pushed = np.linalg.solve(gram, rest[..., None])
    change: Matrix = pull + np.einsum("kmn,km->kn", K, pushed[..., 0])
    return change


def second_derivatives(J: Stack, angular: Stack, rows: tuple[int, ...]) -> Stack:
    """Return the second derivatives of the tip position, shape (k, m, n, n).

    Parameters
    ----------
    J :
        Jacobians of the tip position, shape (k, m, n).
    angular :
        Jacobians of its rotation, shape (k, 3, n).
    rows :
        The m of the three coordinates.
    """
    n = J.shape[2]
    whole = np.zeros((len(J), 3, n))
    whole[:, rows] = J
    i, j = np.indices((n, n))
    first, last = np.minimum(i, j), np.maximum(i, j)
    z, lever = angular[:, :, first], whole[:, :, last]
    found: Stack = np.cross(z, lever, axis=1)[:, rows]
    return found
