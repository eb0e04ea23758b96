"""Cells of a workspace: postures in them, how many tolerate a fault; pooled into larger ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.summary.intervals import wilson

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector

    Values = NDArray[np.float64]
    Counts = NDArray[np.int64]

AXES = "xyz"
PLANES = ("xy", "xz", "yz")
ROBUST = 60  # postures of a block, so that a share means something
_FEWEST_BLOCKS = 8  # along the longest side of the workspace


class Cells(NamedTuple):
    """Cells of any arrangement.

    Attributes
    ----------
    postures, tolerated :
        Postures whose tip lies in the cell, and how many of them tolerate the faults.
    share, low, high :
        Tolerated over postures and the ends of its 95 % interval (Wilson); NaN without postures.
    """

    postures: Counts
    tolerated: Counts
    share: Values
    low: Values
    high: Values

    @classmethod
    def of(cls, postures: Counts, tolerated: Counts) -> Cells:
        """Return cells of these counts."""
        low, high = wilson(tolerated, postures)
        with np.errstate(invalid="ignore"):
            share = tolerated / postures
        return cls(postures, tolerated, share, low, high)

    def only(self, chosen: Mask) -> Cells:
        """Return the chosen cells, in a row."""
        rest: list[Any] = [values[chosen] for values in self]
        return Cells(*rest)


class Flat(NamedTuple):
    """Cells of a plane of the root's axes.

    Attributes
    ----------
    plane :
        Names of its axes, to the right and up.
    edges :
        Borders of the cells along the two, m, shapes (u + 1,) and (v + 1,).
    depth :
        What the cells hold along the third axis, m: from, to.
    cells :
        Shape (u, v).
    """

    plane: str
    edges: tuple[Vector, Vector]
    depth: tuple[float, float]
    cells: Cells


class Located(NamedTuple):
    """Cells that hold postures.

    Attributes
    ----------
    place :
        Their middles in the root's axes, m, shape (k, 3).
    edge :
        m.
    cells :
        Shape (k,).
    """

    place: Matrix
    edge: float
    cells: Cells


def pooled(counts: Counts, factor: int, starts: Sequence[int] | None = None) -> Counts:
    """Return the sums of blocks of so many cells along every axis.

    Parameters
    ----------
    counts :
        Of any number of axes.
    factor :
        Cells of a block along each.
    starts :
        First cell along each; what lies before is left out.
    """
    for axis in range(counts.ndim):
        first = 0 if starts is None else starts[axis]
        counts = np.add.reduceat(
            counts, np.arange(first, counts.shape[axis], factor), axis=axis, dtype=np.int64
        )
    return counts


def window_of(postures: Counts) -> Counts:
    """Return the first and behind the last layer that holds postures along each axis, (3, 2)."""
    found = []
    for axis in range(3):
        layers = np.flatnonzero(postures.sum(tuple({0, 1, 2} - {axis})))
        found.append((int(layers.min()), int(layers.max()) + 1))
    return np.array(found)


def factor_of(postures: Counts, window: Counts) -> int:
    """Return how many cells along each side a block has."""
    longest, factor = int((window[:, 1] - window[:, 0]).max()), 1
    while longest // (factor + 1) >= _FEWEST_BLOCKS:
        counts = pooled(postures, factor, window[:, 0].tolist())
        if np.median(counts[counts > 0]) >= ROBUST:
            break
        factor += 1
    return factor


def depth_axis(plane: str) -> int:
    """Return the axis that a plane lacks."""
    return next(i for i, name in enumerate(AXES) if name not in plane)
