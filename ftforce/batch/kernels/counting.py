"""Integer counts over a block of postures, independent of the order of the blocks.

The bin of a value is found by a single product or by comparison with the edges, never by a
logarithm or a sum of products, so it is the same on every machine.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.kernels.jit import kernel
from ftforce.batch.kernels.layout import CELL_BINS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.batch.kernels.layout import Codes, Matrix, Vector

    Counts = NDArray[np.int64]

_EDGE = 1.0 + 1e-9  # values up to this multiple of the last edge lie on it, up to rounding
_TILE = 256  # postures transposed at a time


@kernel
def count_codes(codes: Codes, counts: Counts) -> None:
    """Count small integers.

    Parameters
    ----------
    codes :
        Integers from 0 to C - 1, shape (S, k).
    counts :
        Incremented in place, shape (S, C).
    """
    sets, k = codes.shape
    for s in range(sets):
        row = codes[s]
        for code in range(counts.shape[1]):  # C branch-free passes, which vectorize
            found = 0
            for i in range(k):
                found += row[i] == code
            counts[s, code] += found


@kernel
def count_linear(
    values: Matrix, largest: float, bins: int, counts: Counts, unknown: Counts
) -> None:
    """Count values in bins of equal width from 0: x belongs to bin ⌊x · (bins / largest)⌋.

    Parameters
    ----------
    values :
        Shape (S, k); values below 0, due to rounding, fall in the first bin.
    largest, bins :
        Upper edge of the last bin, inclusive, and number of bins.
    counts :
        Incremented in place. With shape (S, bins), larger values fall in the last bin; with
        shape (S, bins + 1), in a separate overflow bin.
    unknown :
        Incremented by the number of NaN, shape (S,).
    """
    sets, k = values.shape
    scale = bins / largest
    for s in range(sets):
        row, histogram = values[s], counts[s]
        for i in range(k):
            x = row[i]
            y = x * scale
            if 0.0 <= y < bins:
                histogram[int(y)] += 1
            elif x < 0.0:
                histogram[0] += 1
            elif x <= largest * _EDGE:
                histogram[bins - 1] += 1
            elif x > largest:
                histogram[-1] += 1
            else:
                unknown[s] += 1


@kernel
def count_logarithmic(
    values: Matrix,
    first: NDArray[np.int64],
    edges: Vector,
    lookup: Counts,
    counts: Counts,
    unlimited: Counts,
    unknown: Counts,
) -> None:
    """Count values in bins with logarithmically spaced edges.

    Parameters
    ----------
    values :
        Shape (S, k).
    first :
        Their `leading_bits`, shape (S, k).
    edges :
        Positive, increasing, shape (b + 1,); the last bin includes its upper edge.
    lookup :
        Lookup table of the edges, made by `lookup_of`.
    counts :
        Incremented in place, shape (S, b + 2): below the first edge, the bins, above the last edge.
    unlimited, unknown :
        Incremented by the number of infinite values and of NaN, shape (S,).
    """
    sets, k = values.shape
    last = len(edges) - 2
    lowest, highest = edges[0], edges[last + 1]
    for s in range(sets):
        row, bits, histogram = values[s], first[s], counts[s]
        for i in range(k):
            x = row[i]
            if lowest <= x < highest:
                b = lookup[bits[i] - lookup[0] + 1]
                histogram[b + 1 + (x >= edges[b + 1])] += 1
            elif x < lowest:
                histogram[0] += 1
            elif x == highest:
                histogram[last + 1] += 1
            elif x == math.inf:
                unlimited[s] += 1
            elif x > highest:
                histogram[last + 2] += 1
            else:
                unknown[s] += 1


_SHIFT = 45  # keeps sign, exponent and 7 bits of the fraction: 128 steps per factor of two


def leading_bits(values: Matrix) -> NDArray[np.int64]:
    """Return an integer that increases with a positive value, by 128 steps per factor of two."""
    bits: NDArray[np.int64] = np.ascontiguousarray(values).view(np.int64) >> _SHIFT
    return bits


def lookup_of(edges: Vector) -> Counts:
    """Return the leading bits of the first edge, then the bin in which each step begins.

    Parameters
    ----------
    edges :
        Positive, increasing by a factor above 2^(1/64), so that a step contains at most one edge.
    """
    start, stop = leading_bits(edges[[0, -1]])
    steps = np.arange(start, stop + 1) << _SHIFT
    begins = np.searchsorted(edges, steps.view(np.float64), side="right") - 1
    return np.concatenate(([start], np.clip(begins, 0, len(edges) - 2)))


@kernel
def locate(tip: Matrix, origin: Vector, edge: float, shape: Counts, cell: Counts) -> int:
    """Find the cells of positions, and return how many lie outside the grid (or are NaN).

    Parameters
    ----------
    tip :
        Positions, m, shape (k, 3).
    origin, edge, shape :
        Corner of the grid, m, shape (3,); edge length of a cell, m; number of cells, shape (3,).
    cell :
        Filled with the cell indices, the last axis varying fastest, shape (k,).
    """
    outside = 0
    for i in range(len(tip)):
        index = 0
        inside = True
        for axis in range(3):
            count = shape[axis]
            x = (tip[i, axis] - origin[axis]) / edge
            along = 0
            if x >= count:
                along = count - 1
            elif x > 0.0:
                along = int(x)
            inside = inside and 0.0 <= x <= count
            index = index * count + along
        cell[i] = index
        outside += not inside
    return outside


@kernel
def _count_share(share: float, counts: Counts) -> None:
    if share < math.inf:  # infinite where no set has a value
        counts[min(int(max(share, 0.0) * CELL_BINS), CELL_BINS - 1)] += 1


@kernel
def count_cells(
    cell: Counts,
    verdict: Codes,
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
    cell :
        Cell of each posture, shape (k,).
    verdict, margin, rho :
        Shape (S, k).
    tolerated_sets, cell_postures, cell_tolerated, cell_tolerates_all, cell_worst_margin, \
    cell_worst_rho, cell_min_margin :
        Updated in place, see `ftforce.batch.summary.summary.Summary`.
    """
    sets, k = verdict.shape
    accepted = np.empty((_TILE, sets), np.int64)
    margins = np.empty((_TILE, sets))
    worst_margin, worst_rho = np.empty(_TILE), np.empty(_TILE)
    tolerated = np.empty(_TILE, np.int64)
    for start in range(0, k, _TILE):
        size = min(_TILE, k - start)
        worst_margin[:] = math.inf
        worst_rho[:] = math.inf
        tolerated[:] = 0
        for s in range(sets):  # row by row: the stride of columns defeats the cache
            for i in range(size):
                x = margin[s, start + i] + 0.0  # turns -0.0 into 0.0
                margins[i, s] = x
                worst_margin[i] = x if x < worst_margin[i] else worst_margin[i]
                x = rho[s, start + i]
                worst_rho[i] = x if x < worst_rho[i] else worst_rho[i]
                ok = np.int64(verdict[s, start + i] == 0)
                accepted[i, s] = ok
                tolerated[i] += ok
        for i in range(size):
            c = cell[start + i]
            tolerated_sets[tolerated[i]] += 1
            cell_postures[c] += 1
            cell_tolerates_all[c] += tolerated[i] == sets
            _count_share(worst_margin[i], cell_worst_margin[c])
            _count_share(worst_rho[i], cell_worst_rho[c])
            for s in range(sets):
                cell_tolerated[c, s] += accepted[i, s]
                x = margins[i, s]
                cell_min_margin[c, s] = x if x < cell_min_margin[c, s] else cell_min_margin[c, s]
