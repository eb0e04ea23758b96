"""The measures of a fault set, declared once for every result that shows them."""

from __future__ import annotations

from math import inf, nan
from typing import Any

from ftforce.core.arrays import safe_divide
from ftforce.report.fields import Field


def _healthy_rho(result: Any) -> float:
    """Return w(J)/w(J): 1, or NaN where w(J) = 0."""
    return 1.0 if result.reduced.rank == result.reduced.m else nan


# fmt: off
RANK_AFTER = Field("rank_after", "rank of K", healthy=lambda x: x.reduced.rank)
SIGMA_MIN_AFTER = Field("sigma_min_after", "smallest singular value of K̃")

MARGIN = Field("margin", "σ_min(K̃)/σ_max(J̃)", "1", symbol="margin",
    label="Margin σ_min(K)/σ_max(J)",
    healthy=lambda x: safe_divide(x.reduced.healthy.s[-1], x.reduced.sigma_max, 0.0))
CONDITION = Field("condition_number_after", "cond(K̃) = σ_max(K̃)/σ_min(K̃); `null`, for infinite, if "
    "K does not have full rank", "1", get="condition_number", symbol="cond",
    label="Condition number cond(K)", healthy=lambda x: (
        x.reduced.sigma_max / x.reduced.healthy.s[-1] if x.reduced.rank == x.reduced.m else inf))
RHO = Field("relative_manipulability", "ρ = w(K)/w(J); `null` where the healthy arm is singular "
    "for the task", "1", symbol="ρ", label="Relative manipulability ρ", healthy=_healthy_rho)
# fmt: on
MEASURES = (MARGIN, CONDITION, RHO)
"""Measures of an analysis and of each fault set of a census, in display order."""
