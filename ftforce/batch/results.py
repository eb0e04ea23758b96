"""What the kernels say about a block of postures."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector

Codes: TypeAlias = NDArray[np.int8]

TOLERATED, BORDERLINE, NOT_TOLERATED = 0, 1, 2
"""Codes of the verdicts, from harmless to bad."""


class Block(NamedTuple):
    """k postures and S fault sets.

    Attributes
    ----------
    tip :
        Position of the tip in the root's axes, m, shape (k, 3).
    rank :
        Rank of the healthy arm, shape (k,).
    healthy_margin :
        σ_min(J)/σ_max(J), shape (k,).
    verdict :
        `TOLERATED`, `BORDERLINE` or `NOT_TOLERATED`, shape (S, k).
    rank_lost :
        Rank of J less that of K, shape (S, k).
    sigma_min, margin, rho :
        σ_min(K), σ_min(K)/σ_max(J) and ρ = w(K)/w(J) (NaN where w(J) = 0), shape (S, k).
    jump, moment_jump, relative_jump :
        ‖ΔF‖ of the forces, N (of the moments, N·m, if the task has no forces); of the moments,
        N·m; and the weighted ‖ΔF‖/‖F̂‖; NaN where the arm cannot stand still (then
        ``relative_jump`` is 1), shape (S, k). ``None`` without a force, the moments' also if the
        task has not both.
    capability :
        The largest force that can be commanded in the direction, N (N·m), infinite if no limit
        that is known ends it, NaN if the arm cannot stand still with any, shape (S, k); ``None``
        without a direction.
    """

    tip: Matrix
    rank: Codes
    healthy_margin: Vector
    verdict: Codes
    rank_lost: Codes
    sigma_min: Matrix
    margin: Matrix
    rho: Matrix
    jump: Matrix | None
    moment_jump: Matrix | None
    relative_jump: Matrix | None
    capability: Matrix | None
