"""Smallest and largest eigenvalues of symmetric matrices, LANES of them side by side.

Those of three rows have a closed form. Otherwise Laguerre's iteration on the characteristic
polynomial, begun beside all its roots, runs to the nearest one without ever passing it, and near
it every step triples the digits (Parlett 1964; all roots are real). From 0 it finds the smallest
eigenvalue of K Kᵀ, from the trace the largest of J Jᵀ. The last step says how good the result is.
Where two roots are close it takes more steps, and where even these do not do, the lane is left to
`ftforce.batch.settle`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev

from ftforce.batch.jit import inner
from ftforce.batch.lanes import LANES

if TYPE_CHECKING:
    from ftforce.arrays import Vector

DEGREE = 20
_LEAST = 1e-300  # of three equal eigenvalues nothing is left to divide by


def _of_half(u: Vector) -> Vector:
    """Return cos(acos(r)/3) of u = 2 √((1 + r)/2) - 1."""
    value: Vector = np.cos(np.arccos(0.5 + 0.5 * u) / 1.5)
    return value


def _trisected() -> tuple[float, ...]:
    """Return cos(acos(r)/3) for r in [-1, 1] as a polynomial in ``2 √((1 + r)/2) - 1``.

    In √((1 + r)/2) = cos(acos(r)/2) it has no singularity near, so the series ends quickly.
    """
    interpolate: Any = chebyshev.chebinterpolate  # annotated for functions of one number
    half = interpolate(_of_half, DEGREE)
    return tuple(chebyshev.cheb2poly(half).tolist())


_TRISECTED = _trisected()

STEPS = 4
ROUNDS = 3
CLOSE = 1e-5
"""Largest last step, relative: its cube is far below rounding."""


@inner
def all_close(x, step):
    """Return whether the last step was small in all lanes."""
    far = 0
    for b in range(LANES):
        far += 0 if abs(step[b]) <= CLOSE * x[b] else 1
    return far == 0


@inner
def outermost_of_three(A, side, x, determinant):
    """Smallest (side -1) or largest (side 1) eigenvalue of 3 x 3 matrices, and the determinant.

    With the mean ``t`` of the eigenvalues, ``6 p² = ‖A - t I‖²`` and ``r = det((A - t I)/p)/2``
    it is ``t ± 2 p cos(acos(±r)/3)`` (Smith 1961), the cosine by `_TRISECTED`.
    """
    for b in range(LANES):
        a00, a10, a11 = A[0, 0, b], A[1, 0, b], A[1, 1, b]
        a20, a21, a22 = A[2, 0, b], A[2, 1, b], A[2, 2, b]
        aside = a10 * a10 + a20 * a20 + a21 * a21
        bent = a10 * a21 - a11 * a20
        determinant[b] = a00 * (a11 * a22 - a21 * a21) - a10 * (a10 * a22 - a21 * a20) + a20 * bent
        t = (a00 + a11 + a22) * (1.0 / 3.0)
        d0, d1, d2 = a00 - t, a11 - t, a22 - t
        p2 = (d0 * d0 + d1 * d1 + d2 * d2 + 2.0 * aside) * (1.0 / 6.0)
        p = math.sqrt(p2)
        half = 0.5 * (
            d0 * (d1 * d2 - a21 * a21) - a10 * (a10 * d2 - a21 * a20)
            + a20 * (a10 * a21 - d1 * a20)
        )  # fmt: skip
        r = min(max(side * half / (p * p2 + _LEAST), -1.0), 1.0)
        u = 2.0 * math.sqrt(0.5 + 0.5 * r) - 1.0
        cosine = _TRISECTED[DEGREE]
        for k in range(DEGREE - 1, -1, -1):
            cosine = cosine * u + _TRISECTED[k]
        x[b] = t + side * 2.0 * p * cosine
    if side > 0.0:
        return
    # The sum has lost the digits of a small eigenvalue, the determinant has not: λ₁ = det / λ₂λ₃.
    for b in range(LANES):
        a00, a10, a11 = A[0, 0, b], A[1, 0, b], A[1, 1, b]
        a20, a21, a22 = A[2, 0, b], A[2, 1, b], A[2, 2, b]
        minors = a00 * a11 - a10 * a10 + a00 * a22 - a20 * a20 + a11 * a22 - a21 * a21
        others = minors - x[b] * (a00 + a11 + a22 - x[b])
        x[b] = determinant[b] / others if others > 0.0 else 0.0


@inner
def tridiagonalize(A, diagonal, square, v, w):
    """Bring symmetric matrices to tridiagonal form by reflections, A in place (lower triangle).

    Leaves the diagonals and the squares of the elements beside them.
    """
    m = A.shape[0]
    for k in range(m - 2):
        for b in range(LANES):
            w[0, b] = 0.0
        for i in range(k + 1, m):
            for b in range(LANES):
                v[i, b] = A[i, k, b]
                w[0, b] += v[i, b] * v[i, b]
        for b in range(LANES):
            square[k, b] = w[0, b]
            length = math.sqrt(w[0, b])
            head = v[k + 1, b]
            v[k + 1, b] = head + math.copysign(length, head)
            # H = I - β v vᵀ with β = 2 / vᵀv = 1 / (length² + |head| length)
            size = w[0, b] + abs(head) * length
            w[0, b] = 1.0 / size if size > 0.0 else 0.0
        reflect(A, k + 1, v, w)
    for i in range(m):
        for b in range(LANES):
            diagonal[i, b] = A[i, i, b]
    if m > 1:
        for b in range(LANES):
            square[m - 2, b] = A[m - 1, m - 2, b] * A[m - 1, m - 2, b]


@inner
def reflect(A, first, v, w):
    """Set A ← H A H on the rows from ``first`` on, H = I - β v vᵀ with β in w[0]."""
    m = A.shape[0]
    for b in range(LANES):
        w[m + 1, b] = 0.0
    for i in range(first, m):
        for b in range(LANES):
            w[1 + i, b] = 0.0
        for j in range(first, m):
            row, column = (i, j) if j <= i else (j, i)
            for b in range(LANES):
                w[1 + i, b] += A[row, column, b] * v[j, b]
        for b in range(LANES):
            w[1 + i, b] *= w[0, b]
            w[m + 1, b] += w[1 + i, b] * v[i, b]
    for i in range(first, m):
        for b in range(LANES):
            w[1 + i, b] -= 0.5 * w[0, b] * w[m + 1, b] * v[i, b]
    for i in range(first, m):
        for j in range(first, i + 1):
            for b in range(LANES):
                A[i, j, b] -= v[i, b] * w[1 + j, b] + w[1 + i, b] * v[j, b]


@inner
def tridiagonal_values(diagonal, square, x, p, slope, bend):
    """Characteristic polynomial det(T - x I) with its first two derivatives, by recurrence.

    Row 0 holds the values; rows 1 are the recurrence's previous ones.
    """
    m = diagonal.shape[0]
    for b in range(LANES):
        p[0, b], p[1, b] = diagonal[0, b] - x[b], 1.0
        slope[0, b], slope[1, b] = -1.0, 0.0
        bend[0, b], bend[1, b] = 0.0, 0.0
    for k in range(1, m):
        for b in range(LANES):
            a, e = diagonal[k, b] - x[b], square[k - 1, b]
            p0, s0, d0 = p[0, b], slope[0, b], bend[0, b]
            bend[0, b] = a * d0 - 2.0 * s0 - e * bend[1, b]
            slope[0, b] = a * s0 - p0 - e * slope[1, b]
            p[0, b] = a * p0 - e * p[1, b]
            p[1, b], slope[1, b], bend[1, b] = p0, s0, d0


@inner
def tridiagonal_root(diagonal, square, x, step, p, slope, bend):
    """Run from x to the nearest eigenvalue; the last step, too."""
    for b in range(LANES):
        step[b] = math.inf
    for _ in range(ROUNDS):
        for _ in range(STEPS):
            tridiagonal_values(diagonal, square, x, p, slope, bend)
            tridiagonal_step(diagonal.shape[0], p[0], slope[0], bend[0], x, step)
        if all_close(x, step):
            return


@inner
def tridiagonal_step(m, p, slope, bend, x, step):
    """Take one of Laguerre's steps; lanes that arrived stay, so that no lane depends on others."""
    for b in range(LANES):
        s = -slope[b]
        bent = (m - 1) * ((m - 1) * s * s - m * p[b] * bend[b])
        new = m * p[b] / (s + math.copysign(math.sqrt(max(bent, 0.0)), s))
        moves = not abs(step[b]) <= CLOSE * x[b]
        step[b] = new if moves else step[b]
        x[b] += new if moves else 0.0


@inner
def share_of_three(A, x, F, share):
    """Share of ‖F‖² along the eigenvector u of 3 x 3 matrices for a simple eigenvalue x.

    ``adj(A - x I) = (λ₂ - x)(λ₃ - x) u uᵀ``, whose trace is the factor.
    """
    for b in range(LANES):
        d0, d1, d2 = A[0, 0, b] - x[b], A[1, 1, b] - x[b], A[2, 2, b] - x[b]
        p, q, r = A[1, 0, b], A[2, 0, b], A[2, 1, b]
        f0, f1, f2 = F[0, b], F[1, b], F[2, b]
        c0, c1, c2 = d1 * d2 - r * r, d0 * d2 - q * q, d0 * d1 - p * p
        across = (
            f0 * f1 * (q * r - p * d2) + f0 * f2 * (p * r - q * d1) + f1 * f2 * (p * q - r * d0)
        )
        along = f0 * f0 * c0 + f1 * f1 * c1 + f2 * f2 * c2 + 2.0 * across
        share[b] = along / ((c0 + c1 + c2) * (f0 * f0 + f1 * f1 + f2 * f2))


@inner
def count_below(diagonal, square, bound, count, p):
    """How many eigenvalues of tridiagonal matrices lie below a bound: Sturm's negative pivots."""
    for b in range(LANES):
        p[b] = diagonal[0, b] - bound[b]
        count[b] = 1.0 if p[b] < 0.0 else 0.0
    for k in range(1, diagonal.shape[0]):
        for b in range(LANES):
            p[b] = diagonal[k, b] - bound[b] - square[k - 1, b] / p[b]
            count[b] += 1.0 if p[b] < 0.0 else 0.0


@inner
def share_of_tridiagonal(A, diagonal, square, x, F, share, ahead, back, z):
    """Share of ‖F‖² along the eigenvector of a simple eigenvalue x, of `tridiagonalize`'s matrices.

    By the twisted factorisation (Parlett and Dhillon 1997).
    """
    m = diagonal.shape[0]
    reflect_vector(A, square, F, share)
    for b in range(LANES):
        ahead[0, b] = diagonal[0, b] - x[b]
        back[m - 1, b] = diagonal[m - 1, b] - x[b]
    for k in range(1, m):
        for b in range(LANES):
            ahead[k, b] = diagonal[k, b] - x[b] - square[k - 1, b] / ahead[k - 1, b]
        for b in range(LANES):
            j = m - 1 - k
            back[j, b] = diagonal[j, b] - x[b] - square[j, b] / back[j + 1, b]
    # The twist is where the two factorisations miss each other least; there the vector is 1.
    least, twist = z[m], z[m + 1]
    for b in range(LANES):
        least[b], twist[b] = math.inf, 0.0
    for k in range(m):
        for b in range(LANES):
            gap = abs(ahead[k, b] + back[k, b] - (diagonal[k, b] - x[b]))
            twist[b] = k if gap < least[b] else twist[b]
            least[b] = min(gap, least[b])
    for k in range(m):
        for b in range(LANES):
            z[k, b] = 1.0 if twist[b] == k else 0.0
    for k in range(m - 2, -1, -1):
        for b in range(LANES):
            aside = beside(A, square, k, b, m)
            z[k, b] = -aside / ahead[k, b] * z[k + 1, b] if k < twist[b] else z[k, b]
    for k in range(m - 1):
        for b in range(LANES):
            aside = beside(A, square, k, b, m)
            z[k + 1, b] = -aside / back[k + 1, b] * z[k, b] if k + 1 > twist[b] else z[k + 1, b]
    along, length, size = ahead[0], back[0], least
    for b in range(LANES):
        along[b], length[b], size[b] = 0.0, 0.0, 0.0
    for k in range(m):
        for b in range(LANES):
            along[b] += z[k, b] * F[k, b]
        for b in range(LANES):
            length[b] += z[k, b] * z[k, b]
        for b in range(LANES):
            size[b] += F[k, b] * F[k, b]
    for b in range(LANES):
        share[b] = along[b] * along[b] / (length[b] * size[b])


@inner
def beside(A, square, k, b, m):
    """Return the element beside the diagonal of the tridiagonal matrix, with its sign."""
    if k == m - 2:
        return A[m - 1, m - 2, b]
    return -math.copysign(math.sqrt(square[k, b]), A[k + 1, k, b])


@inner
def reflect_vector(A, square, F, along):
    """F ← Hₘ₋₃ … H₀ F, with the reflections whose vectors `tridiagonalize` left in A."""
    m = A.shape[0]
    for k in range(m - 2):
        for b in range(LANES):
            head = A[k + 1, k, b] + math.copysign(math.sqrt(square[k, b]), A[k + 1, k, b])
            along[b] = head * F[k + 1, b]
        for i in range(k + 2, m):
            for b in range(LANES):
                along[b] += A[i, k, b] * F[i, b]
        for b in range(LANES):
            length = math.sqrt(square[k, b])
            size = square[k, b] + abs(A[k + 1, k, b]) * length
            along[b] = along[b] / size if size > 0.0 else 0.0
        for b in range(LANES):
            head = A[k + 1, k, b] + math.copysign(math.sqrt(square[k, b]), A[k + 1, k, b])
            F[k + 1, b] -= along[b] * head
        for i in range(k + 2, m):
            for b in range(LANES):
                F[i, b] -= along[b] * A[i, k, b]
