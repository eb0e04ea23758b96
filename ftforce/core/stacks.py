"""Many postures at once: locked joints whose effect is certain, by stacked linear algebra.

For most postures and sets of locked joints no tolerance matters: K keeps the rank of J by a clear
margin, or has lost a direction entirely. Those cells are answered here, thousands at a time, with
the formulas of `ftforce.core.remap`, `ftforce.core.verdict` and `ftforce.core.feasible_forces`. The
others, where a singular value lies near a tolerance, are left to those modules.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.verdict import CODES, Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector

_CLEAR = 1.0 + 1e-6  # by which a singular value exceeds all tolerances
_LOST = 0.5  # of the rank tolerance: below it a direction is lost
LEAST_MARGIN = 1e-3  # K Kᵀ does not determine a smaller σ_min/σ_max accurately enough
LEAST_RTOL = 1e-9  # nor do they, and LAPACK, decide a finer rank tolerance


class Cells(NamedTuple):
    """Answers for N postures and S sets of locked joints; NaN and 0 where nothing is certain.

    Attributes
    ----------
    certain :
        Where the other arrays hold, shape (N, S).
    margin :
        σ_min(K)/σ_max(J), shape (N, S).
    verdict :
        Codes of verdicts, shape (N, S).
    jump :
        ΔF, weighted, shape (N, S, m); 0 without a force.
    lost :
        The lost share of the direction, ‖(I - K K†) d‖ / ‖d‖, shape (N, S); 0 without a direction.
    scale :
        σ_max(J), shape (N,).
    healthy_margin :
        σ_min(J)/σ_max(J), shape (N,); NaN where J itself may lack rank.
    rho :
        ρ = w(K)/w(J), shape (N, S).
    rank_lost :
        rank(J) - rank(K), shape (N, S).
    """

    certain: Mask
    margin: Matrix
    verdict: NDArray[np.int8]
    jump: NDArray[np.float64]
    lost: Matrix
    scale: Vector
    healthy_margin: Vector
    rho: Matrix
    rank_lost: NDArray[np.int8]


def cells_of(
    J: NDArray[np.float64],
    locked: Mask,
    F: Vector | None,
    direction: Vector | None,
    *,
    rtol: float,
    wary: float,
    asks_weakest: bool = True,
) -> Cells:
    """Return margins, verdicts and force jumps wherever they are certain.

    Parameters
    ----------
    J :
        Weighted task Jacobians, shape (N, m, n).
    locked :
        True at the locked joints of each set, shape (S, n).
    F :
        Weighted force, shape (m,); ``None`` for all forces.
    direction :
        Weighted direction of the capability, shape (m,); ``None`` for the weakest.
    rtol, wary :
        Rank tolerance, and largest tolerance considered for a borderline verdict.
    asks_weakest :
        Whether cells without a direction have to be certain about the weakest one.
    """
    K = J[:, None] * ~locked[:, None]  # eq. (25), (26); (N, S, m, n)
    whole = np.linalg.eigvalsh(J @ J.swapaxes(1, 2))
    scale = np.sqrt(np.maximum(whole[:, -1], 0.0))
    clear = max(wary, LEAST_MARGIN) * _CLEAR
    sound = (whole[:, 0] > (clear * scale) ** 2) & (rtol >= LEAST_RTOL)
    damaged = np.linalg.eigvalsh(K @ K.swapaxes(2, 3))
    sizes = np.where(sound, scale, np.inf)[:, None]
    margin = np.sqrt(np.maximum(damaged[..., 0], 0.0)) / sizes
    certain = margin > clear  # no direction is lost at any tolerance
    shape = certain.shape
    w = np.sqrt(np.where(sound[:, None], whole, 1.0).prod(axis=1))  # w(J) = √det J Jᵀ
    found = Cells(
        certain,
        np.where(certain, margin, np.nan),
        np.full(shape, CODES[Verdict.TOLERATED], dtype=np.int8),
        np.zeros((*shape, J.shape[1])),
        np.zeros(shape),
        scale,
        np.where(sound, np.sqrt(np.maximum(whole[:, 0], 0.0)), np.nan) / sizes[:, 0],
        np.sqrt(np.where(certain, damaged.prod(axis=2), np.nan)) / w[:, None],
        np.zeros(shape, dtype=np.int8),
    )
    rows = np.nonzero(sound[:, None] & (margin < LEAST_MARGIN))
    if len(rows[0]):
        _fill_lost(found, rows, K[rows], F=F, direction=direction, rtol=rtol, clear=clear)
        found.rho[rows] /= w[rows[0]]
        if asks_weakest and direction is None:
            found.certain[rows] = False  # it is a lost one; its sign is a convention
    return found


def _fill_lost(
    cells: Cells,
    rows: tuple[NDArray[np.intp], ...],
    K: NDArray[np.float64],
    *,
    F: Vector | None,
    direction: Vector | None,
    rtol: float,
    clear: float,
) -> None:
    """Complete cells in which directions are lost at every tolerance, in place; their ρ is w(K)."""
    U, s, _ = np.linalg.svd(K)
    scale = cells.scale[rows[0]][:, None]
    s = np.pad(s, ((0, 0), (0, U.shape[1] - s.shape[1]))) / scale
    lost = s < _LOST * rtol
    certain = np.asarray((lost | (s > clear)).all(axis=1))
    code = np.full(len(s), CODES[Verdict.NOT_TOLERATED], dtype=np.int8)
    if F is not None:
        inside = np.where(lost, F @ U, 0.0)
        size = np.linalg.norm(F)
        relative = np.linalg.norm(inside, axis=1) / (size or 1.0)
        code[relative < _LOST * rtol] = CODES[Verdict.TOLERATED]
        certain &= (relative < _LOST * rtol) | (relative > clear)
        cells.jump[rows] = np.einsum("cmr,cr->cm", U, inside)  # eq. (33), (40)
    if direction is not None:
        beyond = np.linalg.norm(np.where(lost, direction @ U, 0.0), axis=1)
        beyond /= np.linalg.norm(direction)
        certain &= (beyond < _LOST * rtol) | (beyond > clear)
        cells.lost[rows] = beyond
    cells.certain[rows] = certain
    cells.margin[rows] = np.where(certain, s[:, -1], np.nan)
    cells.verdict[rows] = code
    cells.rho[rows] = (s * scale).prod(axis=1)
    cells.rank_lost[rows] = lost.sum(axis=1)


def reach_of(
    J: NDArray[np.float64],
    rnea: NDArray[np.float64],
    largest: Matrix,
    *,
    direction: Vector | None,
    cells: Cells,
    rtol: float,
    within: tuple[Matrix, Matrix] | None = None,
    middle: Matrix | None = None,
) -> tuple[Matrix, Matrix]:
    """Return the largest s for which s·d can be commanded, and held, by the ratio test of `reach`.

    Parameters
    ----------
    J :
        Weighted task Jacobians, shape (N, m, n).
    rnea :
        Torques for weight and motion after the fault, shape (N, S, n), or (N, 1, n) if they are
        the same for all sets.
    largest :
        Largest torques of motors and brakes of each set, NaN where unknown, shape (S, n); (N, S, n)
        if they differ by posture.
    middle :
        Middle between the lower and the upper limits, where these differ: ``largest`` is then half
        their distance, of the same shape.
    direction :
        Weighted direction, shape (m,); ``None`` for the weakest.
    cells :
        The answers for the same postures and sets.
    rtol :
        Rank tolerance.
    within :
        Range of s that free-swinging joints bear, each of shape (N, S); ``None`` for any s ≥ 0.

    Returns
    -------
    :
        Two arrays of shape (N, S); infinite if no limit bounds s, NaN where no s is feasible.
        Meaningless where the cells are not certain.
    """
    known = largest > 0.0
    rnea = rnea if middle is None else rnea - middle
    with np.errstate(over="ignore"):
        lower, upper = -largest - rnea, largest - rnea  # (N, S, n)
    if direction is None:
        d = _weakest(J, lower, upper, known, rtol * cells.scale)  # (N, S, m)
        lever = np.einsum("nsm,nmj->nsj", d, J)
        size = np.linalg.norm(d, axis=2)[..., None]
    else:
        lever = (direction @ J)[:, None]
        size = np.linalg.norm(direction)
    loaded = np.abs(lever) > rtol * cells.scale[:, None, None] * size
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        one, other = lower / lever, upper / lever
    counts = known & loaded
    minimum = np.where(counts, np.minimum(one, other), -np.inf).max(axis=2, initial=0.0)
    maximum = np.where(counts, np.maximum(one, other), np.inf).min(axis=2, initial=np.inf)
    if within is not None:
        minimum, maximum = np.maximum(minimum, within[0]), np.minimum(maximum, within[1])
    commanded = np.where(cells.lost > rtol, np.minimum(maximum, 0.0), maximum)  # F' in range(K)
    overloaded = (known & ~loaded & ((lower > 0.0) | (upper < 0.0))).any(axis=2)
    return (
        np.where(overloaded | (commanded < minimum), np.nan, commanded),
        np.where(overloaded | (maximum < minimum), np.nan, maximum),
    )


def _weakest(
    J: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    known: Mask,
    size: Vector,
) -> NDArray[np.float64]:
    """Return the directions towards the nearest limit, see `weakest_direction`, (N, S, m)."""
    length = np.linalg.norm(J, axis=1)  # (N, n)
    loaded = known & (length > size[:, None])[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distance = np.minimum(upper, -lower) / length[:, None]
    distance = np.where(loaded, distance, np.inf)
    nearest = distance.argmin(axis=2)[..., None]  # (N, S, 1)
    at = np.take_along_axis(np.where(upper <= -lower, 1.0, -1.0), nearest, axis=2)
    along = np.take_along_axis(J.swapaxes(1, 2)[:, None], nearest[..., None], axis=2)[:, :, 0]
    directions: NDArray[np.float64] = at * along / np.linalg.norm(along, axis=2, keepdims=True)
    return directions
