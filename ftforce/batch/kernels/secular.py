"""σ_min and ρ of every fault set that locks one joint, from one decomposition of J.

With ``J = U diag(σ) Vᵀ`` and ``N = I - J†J`` the eigenvalues of ``K Kᵀ = J Jᵀ - J_k J_kᵀ`` are the
roots x of the secular equation (Golub 1973; rearranged here to avoid its cancellation)

    x φ(x) = N_kk,    φ(x) = Σ_i v_ki² / (σ_i² - x),

and ρ² = N_kk (Roberts & Maciejewski 1996). The eigenvector of a root has components proportional
to σ_i v_ki / (σ_i² - x) along the left singular vectors.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.kernels.jit import inner
from ftforce.batch.kernels.layout import GUARD_BAND, LANES, aligned_arrays

if TYPE_CHECKING:
    import numpy as np

MIN_MARGIN = 1e-5
"""Cases with a smaller margin, of J or K, are left to `settle`."""

_ITERATIONS, _EXTRA_ITERATIONS = 3, 20  # of all lanes, and of a lane that needs more
_CONVERGED = 1e-6  # relative step; the error is smaller, since convergence is quadratic
_ZERO_COLUMN = 1e-28  # φ(0) σ_m² of a joint whose column is rounding error


class Secular(NamedTuple):
    """Intermediate results shared by the fault sets of LANES postures."""

    V: np.ndarray  # (n, m, LANES): right singular vectors, one row per joint
    N: np.ndarray  # (n, n, LANES): lower triangle of N
    N_kk: np.ndarray  # (n, LANES): diagonal of N, to a higher relative accuracy
    x: np.ndarray  # (n, LANES): smallest eigenvalue of K Kᵀ; NaN if not accurate enough
    F: np.ndarray  # (m, LANES): force along the left singular vectors
    inverse_gap: np.ndarray  # (m, LANES): 1/(σ² - bound)
    F_squared: np.ndarray  # (LANES,): ‖F‖²
    below: np.ndarray  # (LANES,): number of σ² below the bound
    bound: np.ndarray  # (LANES,)
    step: np.ndarray  # (LANES,): workspace, like the rest
    upper: np.ndarray  # (LANES,)
    a: np.ndarray  # (LANES,)
    b: np.ndarray  # (LANES,)
    c: np.ndarray  # (LANES,)


def workspace(m, n):
    """Return a workspace.

    Parameters
    ----------
    m, n :
        Numbers of task rows and of joints.
    """
    joints = [(n, m, LANES), (n, n, LANES), (n, LANES), (n, LANES)]
    return Secular(*aligned_arrays([*joints, (m, LANES), (m, LANES), *[LANES] * 8]))


@inner
def prepare(J, svd, force, has_force, work):
    """Express J's columns and the force in the left singular vectors, and compute N.

    Parameters
    ----------
    J :
        Task Jacobian, shape (m, n, LANES).
    svd :
        Its decomposition.
    force :
        Requested force, weighted, shape (m, LANES).
    has_force :
        Whether there is one.
    work :
        Workspace; V, N, N_kk, F and F_squared are filled in.
    """
    n, m = work.V.shape[0], work.V.shape[1]
    W, sigma, inverse_sigma, F_squared = svd.W, svd.sigma, work.step, work.F_squared
    for i in range(m):
        for b in range(LANES):
            inverse_sigma[b] = 1.0 / sigma[i, b]
        for k in range(n):
            v = work.V[k, i]
            for b in range(LANES):
                v[b] = W[i, 0, b] * J[0, k, b]
            for r in range(1, m):
                for b in range(LANES):
                    v[b] += W[i, r, b] * J[r, k, b]
            for b in range(LANES):
                v[b] *= inverse_sigma[b]
    _null_space_projector(svd.Q, work)
    if not has_force:
        return
    for b in range(LANES):
        F_squared[b] = 0.0
    for i in range(m):
        for b in range(LANES):
            work.F[i, b] = W[i, 0, b] * force[0, b]
        for r in range(1, m):
            for b in range(LANES):
                work.F[i, b] += W[i, r, b] * force[r, b]
        for b in range(LANES):
            F_squared[b] += work.F[i, b] * work.F[i, b]


@inner
def _null_space_projector(Q, work):
    """Compute N = I - QᵀQ; its diagonal as squared column norms, accurate even when small."""
    m, n = Q.shape[0], Q.shape[1]
    for k in range(n):
        for b in range(LANES):
            work.N_kk[k, b] = 0.0
    for k in range(n):
        for j in range(k + 1):
            N = work.N[k, j]
            for b in range(LANES):
                N[b] = 1.0 if j == k else 0.0
            for i in range(m):
                for b in range(LANES):
                    N[b] -= Q[i, k, b] * Q[i, j, b]
            for b in range(LANES):
                work.N_kk[k, b] += N[b] * N[b]
            if j < k:
                for b in range(LANES):
                    work.N_kk[j, b] += N[b] * N[b]


@inner
def find_root(k, square, largest, rtol, work):
    """Compute the smallest eigenvalue of K Kᵀ with joint k locked.

    ``F(x) = x - N_kk/φ(x)`` is increasing and convex up to σ_m², since 1/φ is concave. Newton's
    iteration converges to the root from the right; Halley's step, which may overshoot it, is used
    where it goes further.

    Parameters
    ----------
    k :
        Index of the joint.
    square :
        Eigenvalues σ² of J Jᵀ, shape (m, LANES).
    largest :
        The largest ones, NaN where undecided, shape (LANES,).
    rtol :
        Relative tolerance of the rank.
    work :
        Workspace, after `prepare`; x[k] is filled in.
    """
    threshold = max(rtol * GUARD_BAND, MIN_MARGIN) ** 2
    V, N, x, step, upper = work.V[k], work.N_kk[k], work.x[k], work.step, work.upper
    m = V.shape[0]
    _initial_guess(V, N, square, x, work)
    zeroth, first, second = work.a, work.b, work.c
    for _ in range(_ITERATIONS):
        for b in range(LANES):
            zeroth[b], first[b], second[b] = 0.0, 0.0, 0.0
        for i in range(m):
            for b in range(LANES):
                d = 1.0 / (square[i, b] - x[b])
                term = V[i, b] * V[i, b] * d
                zeroth[b] += term
                first[b] += term * d
                second[b] += term * d * d
        for b in range(LANES):
            new = _next_iterate(x[b], N[b], zeroth[b], first[b], second[b], upper[b])
            is_moving = not abs(step[b]) <= _CONVERGED * x[b]
            step[b] = new - x[b] if is_moving else step[b]
            x[b] = new if is_moving else x[b]
    for b in range(LANES):
        if not abs(step[b]) <= _CONVERGED * x[b]:
            _iterate_lane(V, N, square, b, x, step, upper[b])
        is_known = (abs(step[b]) <= _CONVERGED * x[b]) & (x[b] > threshold * largest[b])
        x[b] = x[b] if is_known else math.nan


@inner
def _initial_guess(V, N, square, x, work):
    """Set the initial x: a Newton step from 0, or the root for a single term of φ.

    The latter, N_kk σ_i²/(N_kk + v_ki²) for term i, is never too small, and below σ_m². A joint
    whose column is zero leaves σ_m² unchanged.
    """
    zeroth, first, largest_ratio = work.a, work.b, work.c
    step, upper = work.step, work.upper
    smallest = square[V.shape[0] - 1]
    for b in range(LANES):
        zeroth[b], first[b], largest_ratio[b] = 0.0, 0.0, 0.0
    for i in range(V.shape[0]):
        for b in range(LANES):
            d, v = 1.0 / square[i, b], V[i, b] * V[i, b]
            zeroth[b] += v * d
            first[b] += v * d * d
            largest_ratio[b] = max(largest_ratio[b], d * (N[b] + v))
    for b in range(LANES):
        upper[b] = N[b] / largest_ratio[b]
        newton = N[b] * zeroth[b] / (zeroth[b] * zeroth[b] + N[b] * first[b])
        is_zero_column = zeroth[b] * smallest[b] <= _ZERO_COLUMN
        x[b] = smallest[b] if is_zero_column else min(newton, upper[b])
        step[b] = 0.0 if is_zero_column else math.inf


@inner
def _next_iterate(x, N, zeroth, first, second, upper):
    """Return the next iterate; the sums are φ, φ' and φ''/2."""
    denominator = zeroth * zeroth + N * first
    newton = N * (zeroth + x * first) / denominator  # all terms are positive
    F = (x * zeroth - N) * zeroth
    curvature = 2.0 * N * (second - first * first / zeroth)
    halley = x - 2.0 * F * denominator / (2.0 * denominator * denominator - F * curvature)
    return min(newton, halley) if newton < x else min(newton, upper)


@inner
def _iterate_lane(V, N, square, b, x, step, upper):
    """Iterate further in one lane."""
    for _ in range(_EXTRA_ITERATIONS):
        zeroth, first, second = 0.0, 0.0, 0.0
        for i in range(V.shape[0]):
            d = 1.0 / (square[i, b] - x[b])
            term = V[i, b] * V[i, b] * d
            zeroth += term
            first += term * d
            second += term * d * d
        new = _next_iterate(x[b], N[b], zeroth, first, second, upper)
        step[b] = new - x[b]
        x[b] = new
        if abs(step[b]) <= _CONVERGED * new:
            return


@inner
def prepare_bound(square, largest, wary, work):
    """Prepare to count the eigenvalues that a tolerance just above ``wary`` treats as zero.

    Parameters
    ----------
    square :
        Eigenvalues σ² of J Jᵀ, shape (m, LANES).
    largest :
        The largest ones, shape (LANES,).
    wary :
        Relative tolerance of the borderline verdict.
    work :
        Workspace; bound, below and inverse_gap are filled in.
    """
    bound, below = work.bound, work.below
    for b in range(LANES):
        bound[b] = (wary * GUARD_BAND * GUARD_BAND) ** 2 * largest[b]
        below[b] = 0.0
    for i in range(square.shape[0]):
        for b in range(LANES):
            gap = square[i, b] - bound[b]
            work.inverse_gap[i, b] = 1.0 / gap
            below[b] += 1.0 if gap < 0.0 else 0.0


@inner
def count_below(k, work, count):
    """Count the eigenvalues of K Kᵀ below the bound.

    There is one more than for J Jᵀ where the secular function N_kk - x φ(x) is negative, by
    Sylvester's law of inertia for J Jᵀ - x I bordered by J_k.

    Parameters
    ----------
    k :
        Index of the locked joint.
    work :
        Workspace, after `prepare_bound`.
    count :
        Filled with the result, shape (LANES,).
    """
    V, value, bound, below = work.V[k], work.a, work.bound, work.below
    for b in range(LANES):
        value[b] = 0.0
    for i in range(V.shape[0]):
        for b in range(LANES):
            value[b] += V[i, b] * V[i, b] * work.inverse_gap[i, b]
    for b in range(LANES):
        has_one_more = work.N_kk[k, b] - bound[b] * value[b] < 0.0
        count[b] = below[b] + (1.0 if has_one_more else 0.0)


@inner
def force_share(k, sigma, square, work, share):
    """Compute the share of ‖F‖² along the eigenvector of the smallest eigenvalue of K Kᵀ.

    Parameters
    ----------
    k :
        Index of the locked joint.
    sigma, square :
        Singular values σ of J, and σ², shape (m, LANES).
    work :
        Workspace, after `find_root`.
    share :
        Filled with the result, shape (LANES,).
    """
    V, x, along, size = work.V[k], work.x[k], work.a, work.b
    for b in range(LANES):
        along[b], size[b] = 0.0, 0.0
    for i in range(V.shape[0]):
        for b in range(LANES):
            part = sigma[i, b] * V[i, b] / (square[i, b] - x[b])
            along[b] += part * work.F[i, b]
            size[b] += part * part
    for b in range(LANES):
        share[b] = along[b] * along[b] / (size[b] * work.F_squared[b])
