"""Many postures at once: one free-swinging joint, where its lever is certain.

A joint with a lever ‖J_k‖ takes the direction û of its column from the others, and sets the force
along it: F' = F̂ - û (ûᵀF̂ + [rnea]_k/‖J_k‖). A joint without one takes nothing, and friction has to
bear its weight. What lies between, or loses more, is left to `ftforce.core.feasible_forces`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.feasible_forces import SHARE_OF_WEIGHT, SLIGHT
from ftforce.core.stacks import LEAST_MARGIN
from ftforce.core.verdict import CODES, Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.stacked_ranks import HealthyArm
    from ftforce.core.stacks import Cells

    Stack = NDArray[np.float64]

_CLEAR = 1.0 + 1e-6  # by which a lever exceeds all tolerances
_LOST = 0.5  # of the rank tolerance: a shorter lever is none
_ROUNDING = 1e-12  # smaller torques, relative to the arm's, count as zero


class _FreeJoint(NamedTuple):
    """A free-swinging joint in N postures.

    Attributes
    ----------
    k :
        Index of the joint.
    column, length :
        Its column of the weighted task Jacobian, shape (N, m), and its norm, shape (N,).
    weight, friction :
        Its torque for weight, and what its friction bears, shape (N,).
    is_ideal :
        Whether it has no friction.
    least, shortest :
        Lever up to which no force moves it, and up to which no force has to, shape (N,).
    """

    k: int
    column: Matrix
    length: Vector
    weight: Vector
    friction: Vector
    is_ideal: bool
    least: Vector
    shortest: Vector

    @classmethod
    def of(
        cls,
        k: int,
        J: Stack,
        rnea: Matrix,
        friction: float,
        *,
        rtol: float,
        shortest: float,
        scale: Vector,
    ) -> _FreeJoint:
        """Return joint k; ``shortest`` counts where there is friction, relative to σ_max(J)."""
        whole, largest = np.linalg.norm(rnea, axis=1), np.abs(rnea).max(axis=1)
        borne = SHARE_OF_WEIGHT * largest if math.isnan(friction) else np.full(len(J), friction)
        return cls(
            k,
            J[:, :, k],
            np.linalg.norm(J[:, :, k], axis=1),
            np.where(np.abs(rnea[:, k]) > _ROUNDING * whole, rnea[:, k], 0.0),
            np.maximum(borne, rtol * whole),
            friction == 0.0,
            rtol * scale,
            (rtol if friction == 0.0 else shortest) * scale,
        )


class Range(NamedTuple):
    """Range of s in which the free-swinging joints of N postures and S sets bear s·d.

    Attributes
    ----------
    minimum, maximum :
        Shape (N, S); no s if the maximum is smaller.
    """

    minimum: Matrix
    maximum: Matrix


def fill_free(
    cells: Cells,
    arm: HealthyArm,
    J: Stack,
    rnea: Matrix,
    free: Mask,
    *,
    friction: Vector,
    has_force: bool,
    direction: Vector | None,
    rtol: float,
    wary: float,
) -> Range:
    """Complete cells of one free-swinging joint in place, and return what its friction bears.

    Parameters
    ----------
    cells :
        The cells, from `cells_of`, as if free-swinging joints were locked.
    arm :
        The healthy arm, from `settle_cells`.
    J :
        Weighted task Jacobians, shape (N, m, n).
    rnea :
        Weighted gravity torques, shape (N, n).
    free :
        True at the free-swinging joint of each set, shape (S, n); in sets with any, no joint is
        locked.
    friction :
        Weighted torque that friction bears, NaN where it follows from the weight, shape (n,).
    has_force, direction, rtol, wary :
        As in `cells_of`.
    """
    shape = cells.certain.shape
    found = Range(np.zeros(shape), np.full(shape, math.inf))
    for s in np.flatnonzero(free.sum(axis=1) == 1).tolist():
        k = int(free[s].argmax())
        joint = _FreeJoint.of(k, J, rnea, friction[k], rtol=rtol, shortest=wary, scale=cells.scale)
        short = _fill_short(cells, s, joint, wary)
        _fill_long(
            cells, s, joint, arm, J, has_force=has_force, rtol=rtol, wary=wary, skipped=short
        )
        if direction is not None:
            found.minimum[:, s], found.maximum[:, s] = _range(joint, direction)
    return found


def _fill_short(cells: Cells, s: int, joint: _FreeJoint, wary: float) -> Mask:
    """Complete cells in which the joint has no lever, and return where, shape (N,)."""
    clear = max(wary, LEAST_MARGIN) * _CLEAR
    with np.errstate(invalid="ignore"):
        here = cells.certain[:, s] & (cells.margin[:, s] > clear)
    here &= joint.length <= _LOST * joint.least
    if joint.is_ideal:  # whether its weight counts as zero depends on the tolerance
        here &= joint.weight == 0.0
    falls = here & (np.abs(joint.weight) > joint.friction)
    cells.jump[falls, s] = math.nan
    cells.verdict[falls, s] = CODES[Verdict.NOT_TOLERATED]
    cells.certain[:, s] = here
    return here


def _fill_long(
    cells: Cells,
    s: int,
    joint: _FreeJoint,
    arm: HealthyArm,
    J: Stack,
    *,
    has_force: bool,
    rtol: float,
    wary: float,
    skipped: Mask,
) -> None:
    """Complete cells in which the joint has a lever, and no other direction is lost."""
    clear = max(wary, LEAST_MARGIN) * _CLEAR
    long = (joint.length > clear * cells.scale) & ~np.isnan(cells.healthy_margin) & ~skipped
    at = np.flatnonzero(long)
    if not len(at):
        return
    u = joint.column[at] / joint.length[at, None]
    K = J[at] - u[:, :, None] * np.einsum("cm,cmn->cn", u, J[at])[:, None]  # (I - û ûᵀ) J
    K[:, :, joint.k] = 0.0
    if J.shape[1] > 1:
        second = np.linalg.eigvalsh(K @ K.swapaxes(1, 2))[:, 1]
        kept = np.sqrt(np.maximum(second, 0.0)) > clear * cells.scale[at]
        at, u = at[kept], u[kept]
    length, weight = joint.length[at], joint.weight[at]
    F = arm.F[at]
    size, along = np.linalg.norm(F, axis=1), np.vecdot(u, F)
    lost = along + weight / length
    if not joint.is_ideal:
        lost[_is_borne(joint, at, along * length, size)] = 0.0
    cells.certain[at, s] = True
    cells.margin[at, s] = cells.rho[at, s] = cells.lost[at, s] = 0.0
    cells.rank_lost[at, s] = 1
    cells.verdict[at, s] = CODES[Verdict.NOT_TOLERATED]
    if has_force:
        cells.jump[at, s] = u * lost[:, None]
        code = np.full(len(at), CODES[Verdict.BORDERLINE], dtype=np.int8)
        code[np.abs(lost) <= rtol * size] = CODES[Verdict.TOLERATED]
        code[np.abs(lost) > wary * size] = CODES[Verdict.NOT_TOLERATED]
        cells.verdict[at, s] = code


def _is_borne(joint: _FreeJoint, at: NDArray[np.intp], lever: Vector, size: Vector) -> Mask:
    """Return where friction bears a force as it is (`Bearings.bears`), shape (c,).

    Parameters
    ----------
    joint, at :
        The joint, and the postures.
    lever, size :
        J_kᵀ F̂ and ‖F̂‖ there, shape (c,).
    """
    weight, friction = joint.weight[at], joint.friction[at]
    borne = (np.abs(lever + weight) <= friction) & (np.abs(lever) <= joint.shortest[at] * size)
    has_lever = np.abs(lever) > joint.least[at] * size
    return np.asarray(borne & (has_lever | (np.abs(weight) <= friction)))


def _range(joint: _FreeJoint, d: Vector) -> tuple[Vector, Vector]:
    """Return the range of s in which the joint bears s·d (`Bearings.interval`), shapes (N,)."""
    lever, size = joint.column @ d, np.linalg.norm(d)
    weight, friction = joint.weight, joint.friction
    is_at_rest = np.abs(weight) <= friction
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (-friction - weight) / lever, (friction - weight) / lever
        s = -np.where(np.abs(weight) <= SLIGHT * friction, 0.0, weight) / lever + 0.0
    first, last = np.minimum(*ends), np.maximum(*ends)
    # Without a lever: friction bears the weight at any s, or at none.
    flat = np.abs(lever) <= joint.least * size
    first = np.where(flat, 0.0, first)
    last = np.where(flat, np.where(is_at_rest, math.inf, -1.0), last)
    # With a lever: [rnea]_k + s J_kᵀ d = 0, or no force at all.
    long = np.abs(lever) > joint.shortest * size
    s = np.where(s >= 0.0, s, np.where(is_at_rest, 0.0, math.nan))
    first = np.where(long, np.nan_to_num(s), np.maximum(first, 0.0))
    last = np.where(long, np.where(np.isnan(s), -1.0, s), last)
    return first, last
