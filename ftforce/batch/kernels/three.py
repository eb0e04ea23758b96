"""σ_min and ρ of fault sets of a task of three rows, from closed forms, LANES postures at a time.

Of ``K Kᵀ = J Jᵀ - Σ J_k J_kᵀ`` the smallest eigenvalue and the determinant are taken. What a loop
over lanes computes stays in registers.
"""

from __future__ import annotations

import math

from ftforce.batch import eigenvalues
from ftforce.batch.kernels import lanes
from ftforce.batch.kernels.jit import inner
from ftforce.batch.kernels.layout import CLEAR, LANES, UNDECIDED
from ftforce.batch.results import BORDERLINE, TOLERATED

LEAST_MARGIN = 2e-4
"""Below, the root of an eigenvalue of K Kᵀ has lost too many digits: against an SVD the worst
relative errors of σ_min and ρ were 3e-9 (Panda) and 2e-8 (UR5) at 2e-4, and 5e-9 from 4e-4 on."""


@inner
def evaluate_healthy(rtol, J, lane):
    """Take σ_max(J), σ_min(J) and w(J) of J Jᵀ, and what divides by them."""
    least = max(rtol * CLEAR, LEAST_MARGIN) ** 2
    smallest, largest, over = lane.smallest, lane.largest, lane.over
    lanes.gram(J, lane.A)
    eigenvalues.outermost_of_three(lane.A, 1.0, largest, lane.x)
    eigenvalues.outermost_of_three(lane.A, -1.0, smallest, lane.x)
    for b in range(LANES):
        over[0, b] = 1.0 / math.sqrt(largest[b])
        over[1, b] = 1.0 / math.sqrt(max(lane.x[b], 0.0))
        lane.x[b] = math.sqrt(max(smallest[b], 0.0)) * over[0, b]
        largest[b] = largest[b] if smallest[b] > least * largest[b] else math.nan


@inner
def answer(rtol, wary, joints, J, force, first, count, lane, sigma_min, margin, rho, verdict):
    """Answer for a set that locks joints; at least three are left. Without a force it is empty."""
    B, x = lane.B, lane.x
    lanes.downdate(lane.A, J, joints, B)
    safe = max(wary * CLEAR, LEAST_MARGIN) ** 2
    unclear = measure(B, lane.largest, lane.over, safe, first, count, x, sigma_min, margin, rho)
    if unclear:
        for b in range(count):
            if not x[b] > safe * lane.largest[b]:
                verdict[first + b] = decide(rtol, wary, b, B, x[b], lane.largest[b], force)


@inner
def measure(B, largest, over, safe, first, count, x, sigma_min, margin, rho):
    """Write the measures, leave the smallest eigenvalue, and count those that are not safe.

    Where the measures are not good enough they will be written over.
    """
    unclear = 0
    for b in range(count):
        a00, a10, a11 = B[0, 0, b], B[1, 0, b], B[1, 1, b]
        a20, a21, a22 = B[2, 0, b], B[2, 1, b], B[2, 2, b]
        smallest, determinant = eigenvalues.smallest_of_three(a00, a10, a11, a20, a21, a22)
        x[b] = smallest
        unclear += 0 if smallest > safe * largest[b] else 1
        sigma = math.sqrt(max(smallest, 0.0))
        sigma_min[first + b] = sigma
        margin[first + b] = sigma * over[0, b]
        rho[first + b] = math.sqrt(max(determinant, 0.0)) * over[1, b]
    return unclear


@inner
def decide(rtol, wary, b, B, x, largest, force):
    """Judge a lane where one direction, and no more, would be lost by a larger tolerance.

    That tolerance is the margin. The force is kept with smaller ones, and with larger ones if its
    share along the direction, which then jumps, is below.
    """
    least = max(rtol * CLEAR, LEAST_MARGIN) ** 2
    if not x > least * largest:
        return UNDECIDED
    trace = B[0, 0, b] + B[1, 1, b] + B[2, 2, b] - x
    minors = B[0, 0, b] * B[1, 1, b] + B[0, 0, b] * B[2, 2, b] + B[1, 1, b] * B[2, 2, b]
    minors -= B[1, 0, b] ** 2 + B[2, 0, b] ** 2 + B[2, 1, b] ** 2
    product = minors - x * trace  # of the two larger eigenvalues, as trace is their sum
    second = 2.0 * product / (trace + math.sqrt(max(trace * trace - 4.0 * product, 0.0)))
    if not second > (wary * CLEAR * CLEAR) ** 2 * largest:
        return UNDECIDED
    asks = force.shape[0] > 0
    share = eigenvalues.share_of_three(B, b, x, force) if asks else 0.0
    return judge(wary, x / largest, asks, share)


@inner
def judge(wary, margin2, asks, share):
    """Return the verdict where one direction alone is lost by tolerances beyond the margin."""
    if not margin2 * CLEAR < (wary / CLEAR) ** 2:
        return UNDECIDED
    if not asks:
        return BORDERLINE
    if not (share >= 0.0 and abs(share - margin2) > (CLEAR - 1.0) * margin2):
        return UNDECIDED
    return TOLERATED if share < margin2 else BORDERLINE
