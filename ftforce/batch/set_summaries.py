"""What a sweep says of each fault set, over all postures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ftforce.batch.results import BORDERLINE, NOT_TOLERATED, TOLERATED
from ftforce.batch.summary.criticality import Estimate, capability_counts, share_of
from ftforce.batch.summary.intervals import quantile

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from ftforce.batch.summary.summary import Summary
    from ftforce.core.arrays import Vector
    from ftforce.core.faults import FaultSet

    Counts = NDArray[np.int64]

LOW, HIGH = 0.05, 0.95
"""Quantiles of what is bad if small, and of what is bad if large."""


@dataclass(frozen=True, slots=True)
class SetSummary:
    """One fault set over all postures.

    Attributes
    ----------
    faults :
        The set.
    tolerated, borderline, not_tolerated :
        Shares of the postures.
    loses_rank :
        Share of the postures in which the force of a direction is lost, whatever force is asked.
    margin, rho :
        Quantiles 5 % and 50 % of σ_min(K)/σ_max(J) and of w(K)/w(J); NaN where they are unknown.
    jump :
        Quantiles 50 % and 95 % and the largest ‖ΔF‖, N (N·m); a quantile above the force itself,
        which a joint that swings free can cause, is infinite; ``None`` without a force.
    falls :
        Share of the postures in which nothing holds the arm; NaN without force and direction.
    capability :
        Quantiles 5 % and 50 % of the force that can be commanded in the direction, N (N·m): 0 where
        nothing holds the arm, infinite where no limit is known; ``None`` without a direction.
    """

    faults: FaultSet
    tolerated: Estimate
    borderline: Estimate
    not_tolerated: Estimate
    loses_rank: float
    margin: tuple[float, float]
    rho: tuple[float, float]
    jump: tuple[float, float, float] | None
    falls: float
    capability: tuple[float, float] | None


def set_summaries(
    summary: Summary, sets: Sequence[FaultSet], confidence: float = 0.95
) -> tuple[SetSummary, ...]:
    """Return the fault sets, worst first.

    In the order of the share not tolerated, the share borderline, the 5 % quantiles of ρ and of the
    margin; what is unknown comes last.

    Parameters
    ----------
    summary :
        Counts over the sets.
    sets :
        The fault sets, as they were counted.
    confidence :
        Of the intervals.
    """
    found = [_of_set(summary, s, faults, confidence) for s, faults in enumerate(sets)]
    return tuple(sorted(found, key=_rank))


def tolerating_every_set(summary: Summary, confidence: float = 0.95) -> Estimate:
    """Return the share of the postures that tolerate every fault set of the sweep."""
    return share_of(int(summary.tolerated_sets[-1]), int(summary.postures), confidence)


def _of_set(summary: Summary, s: int, faults: FaultSet, confidence: float) -> SetSummary:
    postures = int(summary.postures)

    def share(code: int) -> Estimate:
        return share_of(int(summary.verdicts[s, code]), postures, confidence)

    return SetSummary(
        faults=faults,
        tolerated=share(TOLERATED),
        borderline=share(BORDERLINE),
        not_tolerated=share(NOT_TOLERATED),
        loses_rank=int(summary.rank_lost[s, 1:].sum()) / postures if postures else math.nan,
        margin=_quantiles(summary.margin[s], summary.bins.share),
        rho=_quantiles(summary.rho[s], summary.bins.share),
        jump=_jump(summary, s),
        falls=_falls(summary, s, postures),
        capability=_capability(summary, s),
    )


def _quantiles(counts: Counts, edges: Vector) -> tuple[float, float]:
    return float(quantile(counts, edges, LOW)), float(quantile(counts, edges, 0.5))


def _jump(summary: Summary, s: int) -> tuple[float, float, float] | None:
    edges, counts, largest = summary.bins.jump, summary.jump, summary.max_jump
    if edges is None or counts is None or largest is None:
        return None
    most = float(largest[s])
    most = most if math.isfinite(most) else math.nan
    # A quantile is known to one bin, a thousandth of the force: the largest jump is known better.
    middle, high = (float(quantile(counts[s], edges, p)) for p in (0.5, HIGH))
    return _at_most(middle, most), _at_most(high, most), most


def _at_most(x: float, most: float) -> float:
    return min(x, most) if math.isfinite(x) else x


def _falls(summary: Summary, s: int, postures: int) -> float:
    unknown = summary.jump_unknown
    return math.nan if unknown is None or not postures else int(unknown[s]) / postures


def _capability(summary: Summary, s: int) -> tuple[float, float] | None:
    edges, counts = summary.bins.capability, capability_counts(summary)
    return None if edges is None or counts is None else _quantiles(counts[s], edges)


def _rank(one: SetSummary) -> tuple[float, ...]:
    """Return what sets are sorted by; NaN would sort anyhow."""
    keys = (-one.not_tolerated.value, -one.borderline.value, one.rho[0], one.margin[0])
    return tuple(math.inf if math.isnan(key) else key for key in keys)
