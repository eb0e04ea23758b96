"""Singular values and left singular vectors of m x n matrices, LANES of them side by side.

First ``J = L Q`` with orthonormal rows of Q, by Gram-Schmidt with reorthogonalization (Giraud et
al. 2005). Then one-sided Jacobi rotations make the rows of Lᵀ orthogonal: they become σ_i u_iᵀ,
sorted. Like those of `exact`, the rotations keep small singular values accurate (Demmel and Veselić
1992), and Lᵀ needs fewer sweeps than J (Drmač and Veselić 2008).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.kernels.jit import inner, inner_loop
from ftforce.batch.kernels.layout import LANES, aligned_arrays

if TYPE_CHECKING:
    import numpy as np

_SWEEPS = 12  # most sweeps of Jacobi rotations
_CONVERGED = 1e-8**2
"""Squared cosine of the angle between rows, below which one sweep makes them orthogonal."""

_NEGLIGIBLE = 1e-14  # relative to a row; a smaller remainder is rounding error
_CHORD = math.sqrt(2.0) - 1.0  # slope of the chord of √(1 + x) from 0 to 1
_TINY = 1e-300  # avoids division by zero if two rows are zero


class SVD(NamedTuple):
    """LANES matrices J = U diag(σ) Vᵀ with m rows and n columns, σ decreasing."""

    Q: np.ndarray  # (m, n, LANES): J = L Q, the last row of J first
    W: np.ndarray  # (m, m, LANES): rows u_iᵀ; 0 where σ = 0
    square: np.ndarray  # (m, LANES): σ²
    sigma: np.ndarray  # (m, LANES): σ
    # Separate arrays: for rows of one array the compiler adds an overlap check before each loop.
    fails: np.ndarray  # (LANES,): 1 where the rotations did not converge
    a: np.ndarray  # (LANES,): workspace, like the rest
    b: np.ndarray  # (LANES,)
    c: np.ndarray  # (LANES,)


def workspace(m, n):
    """Return a workspace.

    Parameters
    ----------
    m, n :
        Numbers of rows and columns.
    """
    rows = [(m, n, LANES), (m, m, LANES), (m, LANES), (m, LANES)]
    return SVD(*aligned_arrays([*rows, *[LANES] * 4]))


@inner
def decompose(J, svd):
    """Decompose J, shape (m, n, LANES).

    Parameters
    ----------
    J :
        The matrices, shape (m, n, LANES).
    svd :
        Filled with the decomposition.
    """
    _orthonormalize(J, svd)
    _rotate(svd)
    for i in range(J.shape[0]):
        _square_norm(svd.W[i], svd.square[i])
        sigma, over = svd.sigma[i], svd.a
        for b in range(LANES):
            sigma[b] = math.sqrt(svd.square[i, b])
            over[b] = 1.0 / sigma[b] if sigma[b] > 0.0 else 0.0
        for r in range(J.shape[0]):
            for b in range(LANES):
                svd.W[i, r, b] *= over[b]


@inner_loop
def _square_norm(row, total):
    """Set total = ‖row‖², row of shape (k, LANES)."""
    for b in range(LANES):
        total[b] = row[0, b] * row[0, b]
    for k in range(1, row.shape[0]):
        for b in range(LANES):
            total[b] += row[k, b] * row[k, b]


@inner
def _orthonormalize(J, svd):
    """Factorize J = L Q, with L's columns in the rows of W, starting from the last row of J.

    For a wrench the last rows are the moments, usually the longest: the closer L is to graded, the
    fewer sweeps follow.
    """
    m, n = J.shape[0], J.shape[1]
    Q, W, size, along = svd.Q, svd.W, svd.a, svd.b
    for p in range(m):
        i, row = m - 1 - p, Q[p]
        for k in range(n):
            for b in range(LANES):
                row[k, b] = J[i, k, b]
        for j in range(m):
            for b in range(LANES):
                W[j, i, b] = 0.0
        _square_norm(row, size)
        for j in range(2 * p):  # orthogonalize twice, for accuracy
            _remove_component(Q[j % p], row, along)
            for b in range(LANES):
                W[j % p, i, b] += along[b]
        _square_norm(row, along)
        for b in range(LANES):
            length = math.sqrt(along[b])
            is_significant = along[b] > _NEGLIGIBLE * _NEGLIGIBLE * size[b]
            W[p, i, b] = length if is_significant else 0.0
            along[b] = 1.0 / length if is_significant else 0.0
        for k in range(n):
            for b in range(LANES):
                row[k, b] *= along[b]


@inner_loop
def _remove_component(unit, row, along):
    """Remove the component along a unit vector from a row, (n, LANES); its length is (LANES,)."""
    for b in range(LANES):
        along[b] = unit[0, b] * row[0, b]
    for k in range(1, row.shape[0]):
        for b in range(LANES):
            along[b] += unit[k, b] * row[k, b]
    for k in range(row.shape[0]):
        for b in range(LANES):
            row[k, b] -= along[b] * unit[k, b]


@inner
def _rotate(svd):
    """Make the rows of W orthogonal, the longest first.

    Lanes that have converged are left unchanged, so that no lane depends on the others.
    """
    W, square, fails, active = svd.W, svd.square, svd.fails, svd.a
    m = W.shape[0]
    for b in range(LANES):
        fails[b] = 1.0
    for _ in range(_SWEEPS):
        remaining = 0
        for b in range(LANES):
            active[b] = fails[b]
            remaining += 1 if fails[b] > 0.0 else 0
        if remaining == 0:
            return
        for b in range(LANES):
            fails[b] = 0.0
        for i in range(m):
            _square_norm(W[i], square[i])
        for i in range(m - 1):
            for j in range(i + 1, m):
                _find_rotation(W[i], W[j], square[i], square[j], svd)
                _rotate_rows(W[i], W[j], svd.b, svd.c)


@inner_loop
def _find_rotation(x, y, longer, shorter, svd):
    """Compute the rotation that makes two rows orthogonal, and the first one the longer."""
    fails, active, cosine, sine = svd.fails, svd.a, svd.b, svd.c
    for b in range(LANES):
        cosine[b] = x[0, b] * y[0, b]
    for k in range(1, x.shape[0]):
        for b in range(LANES):
            cosine[b] += x[k, b] * y[k, b]
    for b in range(LANES):
        c, first, second = cosine[b] * active[b], longer[b], shorter[b]
        gap = first - second
        h = math.sqrt(gap * gap + 4.0 * c * c)
        # tan θ = 2c/(|gap| + h), and tan θ/2 = tan θ/(1 + √(1 + tan² θ)), here as p/q with the root
        # exact at 0 and 45°; any p and q give a proper rotation.
        up, down = 2.0 * c, abs(gap) + h
        p, q = up * down, 2.0 * down * down + _CHORD * up * up
        length = q * q + p * p
        over = 1.0 / (length * down + _TINY)
        twice = 2.0 * p * down * over
        large, small = 1.0 - p * twice, q * twice  # 1 and 0 if no rotation is needed
        change = c * up * length * over  # of the squares, c tan θ
        swaps = gap * active[b] < 0.0
        # After a swap, some pair of rows has not met in this sweep.
        is_last = (c * c <= _CONVERGED * (first * second)) & (not swaps)
        fails[b] = fails[b] if is_last else 1.0
        cosine[b] = abs(small) if swaps else large
        sine[b] = math.copysign(large, c) if swaps else small
        longer[b] = max(first, second) + change
        shorter[b] = max(min(first, second) - change, 0.0)


@inner_loop
def _rotate_rows(x, y, cosine, sine):
    """Rotate two rows in their plane."""
    for k in range(x.shape[0]):
        for b in range(LANES):
            u, v = x[k, b], y[k, b]
            x[k, b] = cosine[b] * u + sine[b] * v
            y[k, b] = cosine[b] * v - sine[b] * u
