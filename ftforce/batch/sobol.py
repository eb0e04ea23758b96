"""SciPy's scrambled Sobol sequence with random access.

Its points are integers over 2**30. In the order of the Gray code g(i) = i XOR (i >> 1), point i is
point 0 XOR the columns of the bits that are set in g(i). A column is what separates two points, so
SciPy's public functions give them all; then any block costs no more than its own length.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Integers: TypeAlias = NDArray[np.uint32]

BITS = 30  # SciPy's default
LARGEST: int = 1 << BITS  # postures; beyond it SciPy's sequence ends
_TABLE = 12  # bits of the index that are looked up: the table stays in the cache
_TILE = 64  # rows that are taken as one: NumPy's loop over a row of n numbers alone is slow


class Columns(NamedTuple):
    """What the points of a scrambled Sobol sequence are made of.

    Attributes
    ----------
    points :
        Point 0 and then the columns of the bits 0, 1, … of the Gray code, shape (1 + bits, n).
    """

    points: Integers

    @property
    def size(self) -> int:
        """What the integers are divided by."""
        return LARGEST

    def point(self, i: int) -> Integers:
        """Return the integers of point i, shape (n,)."""
        code = i ^ (i >> 1)
        bits = [b for b in range(code.bit_length()) if code >> b & 1]
        columns = self.points[[0, *(b + 1 for b in bits)]]
        point: Integers = np.bitwise_xor.reduce(columns, axis=0)
        return point


def sobol_columns(n: int, count: int, seed: int) -> Columns:
    """Find the columns that the first points of SciPy's sequence need.

    SciPy steps through half the points for that, 1 to 10 ns each: seconds for 2**30.

    Parameters
    ----------
    n :
        Number of dimensions.
    count :
        Number of points, up to 2**30.
    seed :
        Seed of the scrambling.
    """
    engine = _engine(n, seed)
    points = [_integers(engine.random(1))]
    previous = np.zeros_like(points[0])  # points 2**b and 0 differ by the columns b and b - 1
    for b in range((count - 1).bit_length()):
        at = 1 << b
        if at > engine.num_generated:
            engine.fast_forward(at - engine.num_generated)
        previous = _integers(engine.random(1)) ^ points[0] ^ previous
        points.append(previous)
    table = np.concatenate(points)
    table.setflags(write=False)
    return Columns(table)


def _engine(n: int, seed: int) -> Any:
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    try:
        return qmc.Sobol(n, scramble=True, bits=BITS, rng=generator)
    except TypeError:  # before SciPy 1.15
        return qmc.Sobol(n, scramble=True, bits=BITS, seed=generator)


def _integers(points: NDArray[np.float64]) -> Integers:
    integers: Integers = (points * LARGEST).astype(np.uint32)  # exact: they were integers
    return integers


def sobol_integers(columns: Columns, start: int, stop: int) -> Integers:
    """Return points of the sequence, times 2**30.

    Parameters
    ----------
    columns :
        Of the sequence.
    start, stop :
        The first point, and the one after the last.

    Returns
    -------
    :
        Shape (stop - start, n).
    """
    out = np.empty((stop - start, columns.points.shape[1]), dtype=np.uint32)
    if start == stop:
        return out
    bits = min((stop - start - 1).bit_length(), _TABLE)
    size = 1 << bits
    table = _first_points(columns, bits)
    for first in range(start - start % size, stop, size):
        # An aligned block is the first one, XOR a constant, whatever the parity of its number.
        shift = columns.point(first) ^ columns.points[0]
        low, high = max(start, first), min(stop, first + size)
        rowwise(np.bitwise_xor, table[low - first : high - first], shift, out[low - start :])
    return out


def _first_points(columns: Columns, bits: int) -> Integers:
    """Return points 0 to 2**bits - 1: Gray's code runs backwards where its next bit is set."""
    table = columns.points[:1]
    for b in range(bits):
        table = np.concatenate([table, table[::-1] ^ columns.points[b + 1]])
    return table


def rowwise(function: np.ufunc, rows: NDArray[Any], row: NDArray[Any], out: NDArray[Any]) -> None:
    """Apply a function to every one of ``rows`` and to ``row``, into the first rows of ``out``."""
    k, width = len(rows), _TILE * len(row)
    whole = k - k % _TILE
    tiles = out[:whole].reshape(-1, width)
    function(rows[:whole].reshape(-1, width), np.tile(row, _TILE), out=tiles)
    function(rows[whole:], row, out=out[whole:k])
