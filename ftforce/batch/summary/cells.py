"""Workspace cells with their numbers of postures, total and tolerating a fault, and pooling."""

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
_MIN_POSTURES = 60  # postures per block for a meaningful share
_MIN_BLOCKS = 8  # along the longest side of the workspace


class Cells(NamedTuple):
    """Cells of any arrangement.

    Attributes
    ----------
    postures, tolerated :
        Postures whose tip lies in the cell, and how many of them tolerate the faults.
    share, low, high :
        Ratio of tolerated to postures, and the ends of its 95 % Wilson interval; NaN without
        postures.
    """

    postures: Counts
    tolerated: Counts
    share: Values
    low: Values
    high: Values

    @classmethod
    def of(cls, postures: Counts, tolerated: Counts) -> Cells:
        """Return cells with these counts, and their shares.

        Parameters
        ----------
        postures, tolerated :
            Postures per cell, and how many of them tolerate the faults, of the same shape.
        """
        low, high = wilson(tolerated, postures)
        with np.errstate(invalid="ignore"):
            share = tolerated / postures
        return cls(postures, tolerated, share, low, high)

    def only(self, chosen: Mask) -> Cells:
        """Return the cells selected by a mask, as a one-dimensional array.

        Parameters
        ----------
        chosen :
            True at the cells to select, of the shape of the cells.
        """
        rest: list[Any] = [values[chosen] for values in self]
        return Cells(*rest)


class Flat(NamedTuple):
    """Cells of a plane spanned by two root axes.

    Attributes
    ----------
    plane :
        Names of the horizontal and the vertical axis.
    edges :
        Cell boundaries along the two axes, m, shapes (u + 1,) and (v + 1,).
    depth :
        Range of the cells along the third axis, m.
    cells :
        Shape (u, v).
    """

    plane: str
    edges: tuple[Vector, Vector]
    depth: tuple[float, float]
    cells: Cells


class Located(NamedTuple):
    """Cells that contain postures.

    Attributes
    ----------
    place :
        Their centres in root axes, m, shape (k, 3).
    edge :
        Edge length, m.
    cells :
        Their counts, shape (k,).
    """

    place: Matrix
    edge: float
    cells: Cells


def pooled(counts: Counts, factor: int, starts: Sequence[int] | None = None) -> Counts:
    """Return the sums of counts over cubic blocks of cells.

    Parameters
    ----------
    counts :
        Counts per cell, with any number of axes.
    factor :
        Cells per block along each axis.
    starts :
        First cell along each axis; those before it are left out.
    """
    for axis in range(counts.ndim):
        first = 0 if starts is None else starts[axis]
        counts = np.add.reduceat(
            counts, np.arange(first, counts.shape[axis], factor), axis=axis, dtype=np.int64
        )
    return counts


def window_of(postures: Counts) -> Counts:
    """Return the half-open range of layers that contain postures along each axis, (3, 2)."""
    found = []
    for axis in range(3):
        layers = np.flatnonzero(postures.sum(tuple({0, 1, 2} - {axis})))
        found.append((int(layers.min()), int(layers.max()) + 1))
    return np.array(found)


def factor_of(postures: Counts, window: Counts) -> int:
    """Return the number of cells along each side of a block.

    Parameters
    ----------
    postures :
        Postures per cell, shape (nx, ny, nz).
    window :
        Half-open range of layers to cover along each axis, shape (3, 2).
    """
    longest, factor = int((window[:, 1] - window[:, 0]).max()), 1
    while longest // (factor + 1) >= _MIN_BLOCKS:
        counts = pooled(postures, factor, window[:, 0].tolist())
        if np.median(counts[counts > 0]) >= _MIN_POSTURES:
            break
        factor += 1
    return factor


def depth_axis(plane: str) -> int:
    """Return the index of the axis normal to a plane."""
    return next(i for i, name in enumerate(AXES) if name not in plane)
