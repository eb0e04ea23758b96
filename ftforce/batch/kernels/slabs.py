"""The point of an intersection of slabs that is closest to a given one: a small convex program.

    minimise ‖z - w‖²  subject to  |rows_kᵀ z - middle_k| ≤ width_k

The dual active-set method of Goldfarb and Idnani (1983): constraints are added one at a time, the
most violated first, and dropped where their multiplier would change its sign.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.kernels.jit import inner

if TYPE_CHECKING:
    import numpy as np

_STEPS = 100  # most constraints added; a handful is usual
_INSIDE = 1e-12  # relative: a point is in a slab up to rounding
_ROUNDING = 1e-14  # of the given point, in all points found from it
_DEPENDENT = 1e-12  # relative squared distance of a row from the span of the active ones


class Slabs(NamedTuple):
    """Slabs in m dimensions, and workspace."""

    rows: np.ndarray  # (m, n): a row vector per column
    middle: np.ndarray  # (n,)
    width: np.ndarray  # (n,): half the width; negative where there is no slab
    gram: np.ndarray  # (m, m): of the active rows, and its Cholesky factor
    which: np.ndarray  # (m,): indices of the active slabs
    side: np.ndarray  # (m,): 1 at their upper, -1 at their lower plane
    multiplier: np.ndarray  # (m,)
    share: np.ndarray  # (m,): coordinates of the new row in the active ones
    step: np.ndarray  # (m,): part of the new row that is orthogonal to the active ones


def shapes(m, n):
    """Return the shapes of the arrays.

    Parameters
    ----------
    m, n :
        Numbers of dimensions and of slabs.
    """
    return [(m, n), n, n, (m, m), m, m, m, m, m]


@inner
def nearest(work, z, least):
    """Move z to the closest point of all slabs; return whether there is one.

    Parameters
    ----------
    work :
        The slabs.
    z :
        The given point, shape (m,); overwritten.
    least :
        Rows of at most this length count as zero.
    """
    count = int(0)  # noqa: UP018, RUF046 # for a literal 0, numba would compile what follows twice
    given = 0.0
    for i in range(z.size):
        given += z[i] * z[i]
    given = math.sqrt(given)
    for k in range(work.width.size):
        if work.width[k] >= 0.0 and _length(work, k) <= least:
            if abs(work.middle[k]) > work.width[k]:
                return False
            work.width[k] = -1.0
    for _ in range(_STEPS):
        k, side = _most_violated(work, z, given, count)
        if k < 0:
            return True
        count = _add(work, z, k, side, count)
        if count < 0:
            return False
    return False


@inner
def _length(work, k):
    """Return the length of a row."""
    square = 0.0
    for i in range(work.rows.shape[0]):
        square += work.rows[i, k] ** 2
    return math.sqrt(square)


@inner
def _along(work, k, z):
    """Return rows_kᵀ z."""
    along = 0.0
    for i in range(z.size):
        along += work.rows[i, k] * z[i]
    return along


@inner
def _most_violated(work, z, given, count):
    """Return the slab that z is farthest outside of, and the side; -1 if it is inside all.

    The given point, from which z was found, had the length ``given``. On the planes of the
    ``count`` active slabs z lies, up to rounding.
    """
    size = 0.0
    for i in range(z.size):
        size += z[i] * z[i]
    size = math.sqrt(size)
    worst, found, side = 0.0, -1, 1.0
    for k in range(work.width.size):
        if work.width[k] < 0.0:
            continue
        length, off = _length(work, k), _along(work, k, z) - work.middle[k]
        rounding = _INSIDE * (length * size + abs(work.middle[k]) + work.width[k])
        beyond = (abs(off) - work.width[k] - rounding) / length - _ROUNDING * given
        for a in range(count):
            beyond = 0.0 if work.which[a] == k else beyond
        if beyond > worst:
            worst, found, side = beyond, k, (1.0 if off > 0.0 else -1.0)
    return found, side


@inner
def _add(work, z, k, side, count):
    """Make a slab active and move z; return the number of active slabs, -1 if none is feasible."""
    m, own = z.size, 0.0
    while True:
        square = _split(work, k, side, count)
        length = _length(work, k)
        whole = math.inf  # step at which z reaches the plane
        if count < m and square > _DEPENDENT * length * length:
            violation = side * (_along(work, k, z) - work.middle[k]) - work.width[k]
            whole = max(violation, 0.0) / square
        part, drop = math.inf, -1  # step at which a multiplier vanishes
        for j in range(count):
            if work.share[j] > 0.0 and work.multiplier[j] / work.share[j] < part:
                part, drop = work.multiplier[j] / work.share[j], j
        step = min(whole, part)
        if step == math.inf:
            return -1
        for j in range(count):
            work.multiplier[j] = max(work.multiplier[j] - step * work.share[j], 0.0)
        own += step
        if whole < math.inf:
            for i in range(m):
                z[i] -= step * work.step[i]
        if whole <= part:
            work.which[count], work.side[count], work.multiplier[count] = k, side, own
            return count + 1
        for j in range(drop, count - 1):
            work.which[j] = work.which[j + 1]
            work.side[j] = work.side[j + 1]
            work.multiplier[j] = work.multiplier[j + 1]
        count -= 1


@inner
def _split(work, k, side, count):
    """Split a row into a combination of the active ones, and the orthogonal rest.

    Returns the squared length of the rest, in ``step``; the coordinates are in ``share``.
    """
    rows, gram, share, step = work.rows, work.gram, work.share, work.step
    m = rows.shape[0]
    for a in range(count):  # Cholesky factor of the Gram matrix of the active rows
        p = int(work.which[a])
        for b in range(a + 1):
            q, total = int(work.which[b]), 0.0
            for i in range(m):
                total += rows[i, p] * rows[i, q]
            total *= work.side[a] * work.side[b]
            for c in range(b):
                total -= gram[a, c] * gram[b, c]
            gram[a, b] = math.sqrt(max(total, 0.0)) if a == b else total / gram[b, b]
        total = 0.0
        for i in range(m):
            total += rows[i, p] * rows[i, k]
        total *= side * work.side[a]
        for c in range(a):
            total -= gram[a, c] * share[c]
        share[a] = total / gram[a, a]
    for a in range(count - 1, -1, -1):
        for c in range(a + 1, count):
            share[a] -= gram[c, a] * share[c]
        share[a] /= gram[a, a]
    square = 0.0
    for i in range(m):
        step[i] = side * rows[i, k]
        for a in range(count):
            step[i] -= share[a] * work.side[a] * rows[i, int(work.which[a])]
        square += step[i] * step[i]
    return square
