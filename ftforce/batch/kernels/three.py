"""σ_min and ρ for tasks of three rows, from closed forms, LANES postures at a time.

They follow from the smallest eigenvalue and the determinant of ``K Kᵀ = J Jᵀ - Σ J_k J_kᵀ``.
Intermediate values of the loops over lanes stay in registers.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev

from ftforce.batch.kernels import lanes
from ftforce.batch.kernels.jit import inner
from ftforce.batch.kernels.layout import BORDERLINE, GUARD_BAND, LANES, TOLERATED, UNDECIDED

if TYPE_CHECKING:
    from ftforce.batch.kernels.layout import Vector

MIN_MARGIN = 2e-4
"""Below, the square root of an eigenvalue of K Kᵀ has lost too many digits. Against an SVD, the
worst relative errors of σ_min and ρ were 3e-9 (Panda) and 2e-8 (UR5) at 2e-4, 5e-9 from 4e-4 on."""


@inner
def evaluate_healthy(rtol, J, lane):
    """Compute the extreme eigenvalues of J Jᵀ, and the factors 1/σ_max(J) and 1/w(J).

    Parameters
    ----------
    rtol :
        Relative tolerance of the rank.
    J :
        Task Jacobian, shape (3, n, LANES).
    lane :
        Workspace; A, smallest, largest, inverse and x (the margin) are filled in.
    """
    threshold = max(rtol * GUARD_BAND, MIN_MARGIN) ** 2
    smallest, largest, inverse = lane.smallest, lane.largest, lane.inverse
    lanes.gram(J, lane.A)
    extreme_eigenvalues(lane.A, 1.0, largest, lane.x)
    extreme_eigenvalues(lane.A, -1.0, smallest, lane.x)
    for b in range(LANES):
        inverse[0, b] = 1.0 / math.sqrt(largest[b])
        inverse[1, b] = 1.0 / math.sqrt(max(lane.x[b], 0.0))
        lane.x[b] = math.sqrt(max(smallest[b], 0.0)) * inverse[0, b]
        largest[b] = largest[b] if smallest[b] > threshold * largest[b] else math.nan


@inner
def evaluate_set(rtol, wary, joints, J, force, first, count, lane, sigma_min, margin, rho, verdict):
    """Evaluate a set that leaves at least three healthy joints; ``force`` is empty without one.

    Parameters
    ----------
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    joints :
        Indices of the locked joints.
    J :
        Task Jacobian, shape (3, n, LANES).
    force :
        Requested force, shape (3, LANES), or (0, LANES).
    first, count :
        Index of the first posture, and how many lanes are filled.
    lane :
        Workspace, after `evaluate_healthy`.
    sigma_min, margin, rho, verdict :
        Filled in, shape (k,).
    """
    B, x = lane.B, lane.x
    lanes.downdate(lane.A, J, joints, B)
    safe = max(wary * GUARD_BAND, MIN_MARGIN) ** 2
    undecided = _measure(
        B, lane.largest, lane.inverse, safe, first, count, x, sigma_min, margin, rho
    )
    if undecided:
        for b in range(count):
            if not x[b] > safe * lane.largest[b]:
                verdict[first + b] = _decide_lane(rtol, wary, b, B, x[b], lane.largest[b], force)


@inner
def _measure(B, largest, inverse, safe, first, count, x, sigma_min, margin, rho):
    """Write the measures and the smallest eigenvalue, and count the lanes that are not safe.

    Measures that are not accurate enough are overwritten later.
    """
    undecided = 0
    for b in range(count):
        a00, a10, a11 = B[0, 0, b], B[1, 0, b], B[1, 1, b]
        a20, a21, a22 = B[2, 0, b], B[2, 1, b], B[2, 2, b]
        smallest, determinant = _smallest_eigenvalue(a00, a10, a11, a20, a21, a22)
        x[b] = smallest
        undecided += 0 if smallest > safe * largest[b] else 1
        sigma = math.sqrt(max(smallest, 0.0))
        sigma_min[first + b] = sigma
        margin[first + b] = sigma * inverse[0, b]
        rho[first + b] = math.sqrt(max(determinant, 0.0)) * inverse[1, b]
    return undecided


@inner
def _decide_lane(rtol, wary, b, B, x, largest, force):
    """Decide a lane where a larger tolerance would lose exactly one direction.

    That tolerance is the margin. Below it the force is kept; above it only if the component of the
    force along that direction, which then jumps, is within tolerance.
    """
    threshold = max(rtol * GUARD_BAND, MIN_MARGIN) ** 2
    if not x > threshold * largest:
        return UNDECIDED
    trace = B[0, 0, b] + B[1, 1, b] + B[2, 2, b] - x
    minors = B[0, 0, b] * B[1, 1, b] + B[0, 0, b] * B[2, 2, b] + B[1, 1, b] * B[2, 2, b]
    minors -= B[1, 0, b] ** 2 + B[2, 0, b] ** 2 + B[2, 1, b] ** 2
    product = minors - x * trace  # of the two larger eigenvalues; trace is their sum
    second = 2.0 * product / (trace + math.sqrt(max(trace * trace - 4.0 * product, 0.0)))
    if not second > (wary * GUARD_BAND * GUARD_BAND) ** 2 * largest:
        return UNDECIDED
    has_force = force.shape[0] > 0
    share = _force_share(B, b, x, force) if has_force else 0.0
    return judge(wary, x / largest, has_force, share)


@inner
def judge(wary, margin2, has_force, share):
    """Return the verdict where tolerances beyond the margin lose exactly one direction.

    Parameters
    ----------
    wary :
        Relative tolerance of the borderline verdict.
    margin2 :
        Squared margin.
    has_force :
        Whether a force is requested.
    share :
        Share of ‖F̂‖² along that direction.
    """
    if not margin2 * GUARD_BAND < (wary / GUARD_BAND) ** 2:
        return UNDECIDED
    if not has_force:
        return BORDERLINE
    if not (share >= 0.0 and abs(share - margin2) > (GUARD_BAND - 1.0) * margin2):
        return UNDECIDED
    return TOLERATED if share < margin2 else BORDERLINE


_DEGREE = 18  # accurate to 2e-15; 16 gives 1e-14, and the next even degrees are no better
_TINY = 1e-300  # avoids division by zero for three equal eigenvalues


def _of_half_angle(u: Vector) -> Vector:
    """Return cos(acos(r)/3) of u = 2 √((1 + r)/2) - 1."""
    value: Vector = np.cos(np.arccos(0.5 + 0.5 * u) / 1.5)
    return value


def _trisection_series() -> tuple[float, ...]:
    """Return cos(acos(r)/3) for r in [-1, 1] as a polynomial in ``2 √((1 + r)/2) - 1``.

    In √((1 + r)/2) = cos(acos(r)/2) it has no nearby singularity, so the series converges quickly.
    """
    interpolate: Any = chebyshev.chebinterpolate  # its type annotations allow scalars only
    half = interpolate(_of_half_angle, _DEGREE)
    return tuple(chebyshev.cheb2poly(half).tolist())


_C = _trisection_series()


@inner
def _trisect(r):
    """Return cos(acos(r)/3), r from -1 to 1.

    The polynomial is evaluated by Estrin's scheme (1960): the 18 dependent products of Horner's
    method took four times as long as everything else.
    """
    u = 2.0 * math.sqrt(0.5 + 0.5 * r) - 1.0
    u2 = u * u
    u4 = u2 * u2
    u8 = u4 * u4
    a = (_C[0] + _C[1] * u) + (_C[2] + _C[3] * u) * u2
    b = (_C[4] + _C[5] * u) + (_C[6] + _C[7] * u) * u2
    c = (_C[8] + _C[9] * u) + (_C[10] + _C[11] * u) * u2
    d = (_C[12] + _C[13] * u) + (_C[14] + _C[15] * u) * u2
    e = (_C[16] + _C[17] * u) + _C[18] * u2
    return (a + b * u4) + ((c + d * u4) + e * u8) * u8


@inner
def _extreme_eigenvalue(a00, a10, a11, a20, a21, a22, side):
    """Return the smallest (side -1) or largest (side 1) eigenvalue of a symmetric 3 x 3 matrix.

    With the mean ``t`` of the eigenvalues, ``6 p² = ‖A - t I‖²`` and ``r = det((A - t I)/p)/2``,
    it is ``t ± 2 p cos(acos(±r)/3)`` (Smith 1961).
    """
    t = (a00 + a11 + a22) * (1.0 / 3.0)
    d0, d1, d2 = a00 - t, a11 - t, a22 - t
    off_diagonal = a10 * a10 + a20 * a20 + a21 * a21
    p2 = (d0 * d0 + d1 * d1 + d2 * d2 + 2.0 * off_diagonal) * (1.0 / 6.0)
    p = math.sqrt(p2)
    half = 0.5 * (
        d0 * (d1 * d2 - a21 * a21) - a10 * (a10 * d2 - a21 * a20) + a20 * (a10 * a21 - d1 * a20)
    )
    r = min(max(side * half / (p * p2 + _TINY), -1.0), 1.0)
    return t + side * 2.0 * p * _trisect(r)


@inner
def _smallest_eigenvalue(a00, a10, a11, a20, a21, a22):
    """Return the smallest eigenvalue of a symmetric 3 x 3 matrix, and its determinant.

    The closed form loses the digits of a small eigenvalue by cancellation; the determinant does
    not: λ₁ = det / λ₂λ₃.
    """
    first = a11 * a22 - a21 * a21
    off_diagonal = a10 * (a10 * a22 - a21 * a20)
    determinant = a00 * first - off_diagonal + a20 * (a10 * a21 - a11 * a20)
    x = _extreme_eigenvalue(a00, a10, a11, a20, a21, a22, -1.0)
    minors = first + (a00 * a11 - a10 * a10) + (a00 * a22 - a20 * a20)
    others = minors - x * (a00 + a11 + a22 - x)
    return determinant / others if others > 0.0 else 0.0, determinant


@inner
def extreme_eigenvalues(A, side, x, determinant):
    """Compute the smallest (side -1, with determinant) or largest (side 1) eigenvalue.

    Parameters
    ----------
    A :
        Lower triangles, shape (3, 3, LANES).
    side :
        Which eigenvalue.
    x, determinant :
        Filled with the results, shape (LANES,).
    """
    if side > 0.0:
        for b in range(LANES):
            x[b] = _extreme_eigenvalue(
                A[0, 0, b], A[1, 0, b], A[1, 1, b], A[2, 0, b], A[2, 1, b], A[2, 2, b], side
            )
        return
    for b in range(LANES):
        x[b], determinant[b] = _smallest_eigenvalue(
            A[0, 0, b], A[1, 0, b], A[1, 1, b], A[2, 0, b], A[2, 1, b], A[2, 2, b]
        )


@inner
def _force_share(A, b, x, F):
    """Return the share of ‖F‖² along the eigenvector u of lane b for a simple eigenvalue x.

    ``adj(A - x I) = (λ₂ - x)(λ₃ - x) u uᵀ``, whose trace is the factor.
    """
    d0, d1, d2 = A[0, 0, b] - x, A[1, 1, b] - x, A[2, 2, b] - x
    p, q, r = A[1, 0, b], A[2, 0, b], A[2, 1, b]
    f0, f1, f2 = F[0, b], F[1, b], F[2, b]
    c0, c1, c2 = d1 * d2 - r * r, d0 * d2 - q * q, d0 * d1 - p * p
    across = f0 * f1 * (q * r - p * d2) + f0 * f2 * (p * r - q * d1) + f1 * f2 * (p * q - r * d0)
    along = f0 * f0 * c0 + f1 * f1 * c1 + f2 * f2 * c2 + 2.0 * across
    return along / ((c0 + c1 + c2) * (f0 * f0 + f1 * f1 + f2 * f2))
