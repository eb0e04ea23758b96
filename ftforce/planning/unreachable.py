"""Points that the tip cannot reach, shown by lower bounds on their distance from its reach.

The reach S_k of the joints k to n, those before them at zero, follows from that of the joints
behind them: S_k is S_(k+1), moved by every position of joint k. So the distance of a point p from
S_k is the least distance from S_(k+1) of the points from which joint k moves to p, and n fields in
space say what n joints reach (docs/theory/self-motion, 1 and 2). Each field holds lower bounds: for
any set S, d(p)² − ‖p‖² is concave in p, and a concave function lies above its multilinear
interpolation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.planning.tip_point import TipPoint

_MOST_STEPS = 512  # of a joint in one sweep
_ROUNDING = 1e-12  # m²


class Field(Protocol):
    """Lower bounds on the square of the distance from a set, m²."""

    def __call__(self, points: Matrix) -> Vector:
        """Return the bounds at points (k, m), in m, shape (k,)."""


@dataclass(frozen=True, eq=False)
class PointField:
    """Squares of distances from one point.

    Attributes
    ----------
    place :
        The point, m, shape (m,).
    """

    place: Vector

    def __call__(self, points: Matrix) -> Vector:
        """Return the squares of the distances of points, m², shape (k,).

        Parameters
        ----------
        points :
            The points, m, shape (k, m).
        """
        return _square(points - self.place)


@dataclass(frozen=True, eq=False)
class GridField:
    """Lower bounds on the nodes of a grid in a box that contains the set.

    Attributes
    ----------
    low, edge :
        First node and distance of neighbours, m, shape (m,).
    shape :
        Nodes along each axis.
    values :
        d² − ‖p‖² on the nodes, m².
    """

    low: Vector
    edge: float
    shape: tuple[int, ...]
    values: Matrix

    def __call__(self, points: Matrix) -> Vector:
        """Return lower bounds on the squares of the distances of points, m², shape (k,).

        Parameters
        ----------
        points :
            The points, m, shape (k, m).
        """
        from scipy.ndimage import map_coordinates

        high = self.low + self.edge * (np.array(self.shape) - 1)
        inside = np.clip(points, self.low, high)  # nearest point of the box, which is convex
        at = ((inside - self.low) / self.edge).T
        concave = map_coordinates(self.values, at, order=1, mode="nearest")
        within = np.maximum(concave + _square(inside), 0.0)
        bounds: Vector = within + _square(points - inside)
        return bounds


@dataclass(frozen=True, eq=False)
class Unreachable:
    """Lower bounds on distances from what an arm reaches, with or without a locked joint.

    Attributes
    ----------
    tip :
        The tip point.
    ranges :
        Positions that the joints take, rad or m, shape (n, 2).
    edge :
        Distance of the nodes of the fields, m.
    """

    tip: TipPoint
    ranges: Matrix
    edge: float

    def fields(self) -> list[Field]:
        """Return the fields of S_2 to S_(n+1), as items 1 to n; item 0 is not used."""
        found: list[Field] = [PointField(self.tip.home[list(self.tip.rows)])]
        for joint in range(self.tip.moving - 1, 0, -1):
            found.append(self._grid(joint, self._swept(found[-1], joint)))
        found.append(found[-1])
        return found[::-1]

    def healthy(self, behind: list[Field], points: Matrix) -> Vector:
        """Return squares of lower bounds on the distances from the healthy reach, m², shape (k,).

        Parameters
        ----------
        behind :
            Fields of the joints behind each joint, of `fields`.
        points :
            Points, m, shape (k, m).
        """
        return self._swept(behind[1], 0)(points)

    def locked(self, behind: list[Field], joint: int, position: float, points: Matrix) -> Vector:
        """Return the same for the reach with a joint locked at a position, shape (k,).

        Parameters
        ----------
        behind, points :
            As in `healthy`.
        joint :
            Index of the locked joint.
        position :
            Where it is locked, rad or m.
        """

        def still(points: Matrix) -> Vector:
            return behind[joint + 1](self.tip.undone(joint, position, points))

        field: Callable[[Matrix], Vector] = still
        for k in range(joint - 1, 0, -1):
            field = self._grid(k, self._swept(field, k))
        return self._swept(field, 0)(points) if joint else field(points)

    def _swept(self, field: Callable[[Matrix], Vector], joint: int) -> Callable[[Matrix], Vector]:
        """Return lower bounds for a set that a joint moves through its whole range."""
        low, high = self.ranges[joint].tolist()

        def bounds(points: Matrix) -> Vector:
            lever = self.tip.lever(joint, points)
            farthest = float(lever.max(initial=0.0))
            count = min(_MOST_STEPS, max(1, math.ceil((high - low) * farthest / self.edge)))
            step = (high - low) / count
            least = np.full(len(points), np.inf)
            for position in np.linspace(low, high, count + 1).tolist():
                np.minimum(least, field(self.tip.undone(joint, position, points)), out=least)
            # On the chord between two positions, d² is at most a quarter of its square smaller;
            # the arc is not farther from it than its sagitta.
            chord = lever * step
            sagitta = np.zeros_like(lever) if self.tip.is_prismatic[joint] else chord * step / 8.0
            near = np.sqrt(np.maximum(least - chord**2 / 4.0 - _ROUNDING, 0.0)) - sagitta
            square: Vector = np.maximum(near, 0.0) ** 2
            return square

        return bounds

    def _grid(self, joint: int, bounds: Callable[[Matrix], Vector]) -> GridField:
        """Return lower bounds on the nodes of a box that contains the reach of a joint."""
        rows = list(self.tip.rows)
        radius = self.tip.reaches[joint]
        if self.tip.is_prismatic[joint]:
            radius = radius + np.abs(self.ranges[joint]).max()
        centre = self.tip.points[joint][rows]
        low = centre - radius
        count = max(2, math.ceil(2.0 * radius / self.edge) + 1)
        line = np.arange(count) * self.edge
        nodes = low + np.stack(np.meshgrid(*[line] * self.tip.m, indexing="ij"), -1).reshape(
            -1, self.tip.m
        )
        beyond = np.sqrt(_square(nodes - centre)) - radius  # of the ball that holds the reach
        square = np.maximum(beyond, 0.0) ** 2
        near = beyond <= 2.0 * self.edge
        square[near] = bounds(nodes[near])
        values = square - _square(nodes)
        return GridField(
            low, self.edge, (count,) * self.tip.m, values.reshape((count,) * self.tip.m)
        )


def _square(vectors: Matrix) -> Vector:
    found: Vector = np.einsum("ij,ij->i", vectors, vectors)
    return found
