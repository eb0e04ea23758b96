"""Many postures at once: locked joints where a tolerance decides which directions are lost.

The formulas of `ftforce.core.remap` and `ftforce.core.verdict` on stacks of singular value
decompositions, for the cells that `ftforce.core.stacks` leaves. Cells in which a singular value is
within rounding error of a tolerance remain uncertain.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.stacks import LEAST_RTOL, Cells
from ftforce.core.verdict import CODES, Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector

    Stack = NDArray[np.float64]

_NEAR = 1e-6  # of a tolerance: closer values are not decided here
_ROUNDING = 1e-12  # smaller forces, relative to those given, are rounding errors


class HealthyArm(NamedTuple):
    """The healthy arm in N postures.

    Attributes
    ----------
    rank :
        Rank of J, shape (N,).
    margin :
        σ_min(J)/σ_max(J), shape (N,).
    F :
        Weighted force F̂ that it exerts, shape (N, m); zero without a force.
    certain :
        Whether rounding error does not decide its rank, shape (N,).
    """

    rank: NDArray[np.int64]
    margin: Vector
    F: Matrix
    certain: Mask


def settle_cells(
    cells: Cells,
    J: Stack,
    locked: Mask,
    F: Vector | None,
    direction: Vector | None,
    *,
    rtol: float,
    wary: float,
) -> HealthyArm:
    """Complete uncertain cells in place, and return the healthy arm in all postures.

    Parameters
    ----------
    cells :
        The cells, from `cells_of`.
    J, locked, F, direction, rtol, wary :
        As in `cells_of`, with ``asks_weakest=False``.
    """
    count, m = J.shape[:2]
    wanted = np.zeros(m) if F is None else F
    arm = HealthyArm(
        np.full(count, m),
        cells.healthy_margin.copy(),
        np.tile(wanted, (count, 1)),
        np.full(count, rtol >= LEAST_RTOL),
    )
    weak = np.flatnonzero(np.isnan(cells.healthy_margin))
    if len(weak):
        _fill_healthy(arm, weak, J[weak], wanted, rtol)
    rows = np.nonzero(~cells.certain & arm.certain[:, None])
    if not len(rows[0]):
        return arm
    K = J[rows[0]] * ~locked[rows[1], None]  # eq. (25), (26)
    whole = _decomposed(J[rows[0]])[1]
    scale = whole[:, 0]
    U, s = _decomposed(K)
    lost = s <= rtol * scale[:, None]
    force = arm.F[rows[0]]
    rank, after = arm.rank[rows[0]], m - lost.sum(axis=1)
    along = np.einsum("cm,cmr->cr", force, U)
    cells.jump[rows] = np.einsum("cmr,cr->cm", U, np.where(lost, along, 0.0))  # eq. (33), (40)
    cells.rank_lost[rows] = rank - after
    cells.margin[rows] = _over(s[:, -1], scale)
    cells.rho[rows] = np.where(rank == m, _over(s, whole).prod(axis=1), math.nan)
    if direction is not None:
        beyond = np.where(lost, np.einsum("m,cmr->cr", direction, U), 0.0)
        cells.lost[rows] = np.linalg.norm(beyond, axis=1) / np.linalg.norm(direction)
    has_force = np.full(len(rank), True) if F is None else force.any(axis=1)
    size = np.linalg.norm(force, axis=1)
    share = None if F is None else _over(along, size[:, None]) ** 2
    code = _verdicts(s, scale, rank, share, (rtol, wary))
    # Theory §2.6: where the healthy arm has nothing to keep, nothing is tolerated.
    code[(rank == 0) | ~has_force] = CODES[Verdict.NOT_TOLERATED]
    cells.verdict[rows] = code
    ratio = _over(s, scale[:, None])
    near = (np.abs(ratio - rtol) <= _NEAR * rtol) | (np.abs(ratio - wary) <= _NEAR * wary)
    cells.certain[rows] = ~near.any(axis=1)
    return arm


def _decomposed(K: Stack) -> tuple[Stack, Matrix]:
    """Return all left singular vectors, (c, m, m), and m singular values, (c, m)."""
    U, s, _ = np.linalg.svd(K)
    return U, np.pad(s, ((0, 0), (0, U.shape[1] - s.shape[1])))


def _over(x: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x / size, 0 where the size is 0."""
    share: NDArray[np.float64] = np.divide(x, size, out=np.zeros_like(x), where=size > 0.0)
    return share


def _fill_healthy(arm: HealthyArm, at: NDArray[np.intp], J: Stack, F: Vector, rtol: float) -> None:
    """Fill in postures in which J may lack rank: F̂ = J J† F."""
    U, s = _decomposed(J)
    ratio = _over(s, s[:, :1])
    kept = ratio > rtol
    along = np.einsum("m,cmr->cr", F, U) * kept
    force = np.einsum("cmr,cr->cm", U, along)
    force[kept.all(axis=1)] = F
    # A force that is only rounding error is treated as zero, or its direction would matter.
    force[np.linalg.norm(force, axis=1) <= _ROUNDING * np.linalg.norm(F)] = 0.0
    arm.rank[at], arm.margin[at], arm.F[at] = kept.sum(axis=1), ratio[:, -1], force
    arm.certain[at] &= ~(np.abs(ratio - rtol) <= _NEAR * rtol).any(axis=1)


def _verdicts(
    s: Matrix,
    scale: Vector,
    rank: NDArray[np.int64],
    share: Matrix | None,
    tolerances: tuple[float, float],
) -> NDArray[np.int8]:
    """Return codes of verdicts, as `ftforce.core.verdict.verdict` decides.

    Parameters
    ----------
    s, scale, rank :
        Singular values of K, shape (c, m), σ_max(J) and rank(J), shape (c,).
    share :
        Share of ‖F̂‖² along each left singular vector, shape (c, m); ``None`` for all forces.
    tolerances :
        ``rtol`` and ``wary``.
    """
    rtol, wary = tolerances
    if share is None:
        kept = [(s > t * scale[:, None]).sum(axis=1) >= rank for t in tolerances]
        accepted, rejected = kept[0] | kept[1], ~(kept[0] & kept[1])
    else:
        accepted, rejected = np.zeros((2, len(s)), dtype=np.bool_)
        start = np.full(len(s), rtol)
        for _ in range(s.shape[1] + 1):  # from one change of rank to the next
            threshold = (start * scale)[:, None]
            jump = np.sqrt(np.where(s <= threshold, share, 0.0).sum(axis=1))
            following = np.where(s > threshold, s, math.inf).min(axis=1)
            end = np.minimum(_losing_tolerance(following, scale), wary)
            for t in (start, end):
                accepted |= jump <= t
                rejected |= jump > t
            start = end
    code = np.full(len(s), CODES[Verdict.BORDERLINE], dtype=np.int8)
    code[~rejected] = CODES[Verdict.TOLERATED]
    code[~accepted] = CODES[Verdict.NOT_TOLERATED]
    code[s[:, -1] > wary * scale] = CODES[Verdict.TOLERATED]
    return code


def _losing_tolerance(s: Vector, scale: Vector) -> Vector:
    """Return the smallest tolerances t with s ≤ t · scale; infinite without a scale."""
    t = np.divide(s, scale, out=np.full_like(s, math.inf), where=scale > 0.0)
    with np.errstate(invalid="ignore"):
        return np.where(s <= t * scale, t, np.nextafter(t, math.inf))
