"""The counts of `ftforce.batch.kernels.counting` by NumPy: the same to the bit, without a compiler.

Parameters are those of the kernels of the same names.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.kernels.layout import CELL_BINS, TOLERATED

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix, Vector

    Counts = NDArray[np.int64]

_EDGE = 1.0 + 1e-9  # as of the kernels


def count_codes(codes: NDArray[np.int8], counts: Counts) -> None:
    """Count small integers.

    Parameters
    ----------
    codes, counts :
        As of the kernel.
    """
    for s, row in enumerate(codes):
        counts[s] += np.bincount(row, minlength=counts.shape[1])


def count_linear(
    values: Matrix, largest: float, bins: int, counts: Counts, unknown: Counts
) -> None:
    """Count values in bins of equal width from 0.

    Parameters
    ----------
    values, largest, bins, counts, unknown :
        As of the kernel.
    """
    scale, last = bins / largest, counts.shape[1] - 1
    for s, x in enumerate(values):
        known = x[~np.isnan(x)]
        y = known * scale
        at = np.where(known > largest * _EDGE, last, bins - 1)
        inside = y < bins
        at[inside] = np.maximum(y[inside], 0.0).astype(np.int64)
        counts[s] += np.bincount(at, minlength=last + 1)
        unknown[s] += len(x) - len(known)


def count_logarithmic(
    values: Matrix,
    edges: Vector,
    counts: Counts,
    unlimited: Counts,
    unknown: Counts,
) -> None:
    """Count values in bins with logarithmically spaced edges.

    Parameters
    ----------
    values, edges, counts, unlimited, unknown :
        As of the kernel.
    """
    for s, x in enumerate(values):
        infinite, nan = x == math.inf, np.isnan(x)
        known = x[~(infinite | nan)]
        at = np.searchsorted(edges, known, side="right")
        at[known == edges[-1]] -= 1  # the last bin includes its upper edge
        counts[s] += np.bincount(at, minlength=counts.shape[1])
        unlimited[s] += np.count_nonzero(infinite)
        unknown[s] += np.count_nonzero(nan)


def locate(tip: Matrix, origin: Vector, edge: float, shape: Counts, cell: Counts) -> int:
    """Find the cells of positions, and return how many lie outside the grid (or are NaN).

    Parameters
    ----------
    tip, origin, edge, shape, cell :
        As of the kernel.
    """
    x = (tip - origin) / edge
    along = np.minimum(np.where(x > 0.0, x, 0.0), shape - 1).astype(np.int64)  # NaN: the first
    cell[:] = (along[:, 0] * shape[1] + along[:, 1]) * shape[2] + along[:, 2]
    return int(np.count_nonzero(~((x >= 0.0) & (x <= shape)).all(axis=1)))


def count_cells(  # noqa: PLR0917 # as the kernel
    cell: Counts,
    verdict: NDArray[np.int8],
    margin: Matrix,
    rho: Matrix,
    tolerated_sets: Counts,
    cell_postures: Counts,
    cell_tolerated: Counts,
    cell_tolerates_all: Counts,
    cell_worst_margin: Counts,
    cell_worst_rho: Counts,
    cell_min_margin: Matrix,
) -> None:
    """Count the outcome of each posture over all sets, in total and per cell.

    Parameters
    ----------
    cell, verdict, margin, rho, tolerated_sets, cell_postures, cell_tolerated, \
    cell_tolerates_all, cell_worst_margin, cell_worst_rho, cell_min_margin :
        As of the kernel.
    """
    accepted = verdict == TOLERATED
    tolerated = accepted.sum(axis=0)
    tolerated_sets += np.bincount(tolerated, minlength=len(tolerated_sets))
    np.add.at(cell_postures, cell, 1)
    np.add.at(cell_tolerates_all, cell[tolerated == len(verdict)], 1)
    for values, counts in ((margin, cell_worst_margin), (rho, cell_worst_rho)):
        _count_shares(np.fmin.reduce(values, axis=0, initial=math.inf), cell, counts)
    for s, row in enumerate(margin):
        np.add.at(cell_tolerated[:, s], cell[accepted[s]], 1)
        np.fmin.at(cell_min_margin[:, s], cell, row + 0.0)  # turns -0.0 into 0.0


def _count_shares(worst: Vector, cell: Counts, counts: Any) -> None:
    """Count the smallest share of each posture in its cell; infinite where no set has a value."""
    has_value = worst < math.inf
    at = np.minimum((np.maximum(worst[has_value], 0.0) * CELL_BINS).astype(np.int64), CELL_BINS - 1)
    np.add.at(counts, (cell[has_value], at), 1)
