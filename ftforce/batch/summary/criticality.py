"""Criticality of joints and fault sets, and the workspace where a fault set is survived."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.batch.kernels.layout import BORDERLINE, NOT_TOLERATED, TOLERATED
from ftforce.batch.summary.intervals import quantile, quantile_interval, wilson
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ftforce.batch.summary.summary import Summary
    from ftforce.core.arrays import Vector
    from ftforce.core.faults import FaultSet

    Values = NDArray[np.float64]
    Counts = NDArray[np.int64]


class Estimate(NamedTuple):
    """A number and its confidence interval; NaN without data.

    Attributes
    ----------
    value :
        Share or quantile, in the unit of the counted quantity; infinite beyond the last bin.
    low, high :
        Ends of the interval; infinite beyond the last bin of a histogram.
    """

    value: float
    low: float
    high: float


_UNKNOWN = Estimate(math.nan, math.nan, math.nan)


class Survival(NamedTuple):
    """Share of the postures of each cell that tolerate a fault set; NaN in empty cells.

    Attributes
    ----------
    share :
        Shape (nx, ny, nz).
    low, high :
        Ends of the Wilson interval, shape (nx, ny, nz).
    """

    share: Values
    low: Values
    high: Values


@dataclass(frozen=True, slots=True)
class JointCriticality:
    """Effect of the failure of a joint, over all postures.

    Attributes
    ----------
    joint :
        Index along the chain, from 0.
    sets :
        Number of fault sets that contain it.
    not_tolerated :
        Share of postures x these sets that are not tolerated. The interval counts each posture
        once, since its verdicts for different sets are correlated.
    borderline :
        Share of postures x these sets that are borderline.
    alone :
        Share of postures not tolerated when it fails alone (in any of the analysed modes).
    margin, rho :
        5 % and 50 % quantiles when it fails alone.
    capability :
        Median when it fails alone, N (N·m): 0 where the arm cannot be held in static
        equilibrium, infinite where no limit is known; ``None`` without a direction.
    """

    joint: int
    sets: int
    not_tolerated: Estimate
    borderline: float
    alone: Estimate
    margin: tuple[Estimate, Estimate]
    rho: tuple[Estimate, Estimate]
    capability: Estimate | None


def criticality(
    summary: Summary, sets: Sequence[FaultSet], n: int, confidence: float = 0.95
) -> tuple[JointCriticality, ...]:
    """Return the joints, most critical first.

    Sorted by the share not tolerated, the share borderline, the 5 % quantiles of ρ and of the
    margin when the joint fails alone, and its number; undefined values come last.

    Parameters
    ----------
    summary :
        Counts over the sets.
    sets :
        The fault sets, in the order of the summary.
    n :
        Number of joints along the chain.
    confidence :
        Confidence level of the intervals.

    Raises
    ------
    InputError
        The number of sets does not match the summary, or the confidence is not between 0 and 1.
    """
    if len(sets) != summary.n_sets:
        raise InputError(
            f"expected {summary.n_sets} fault sets, as in the summary, got {len(sets)}"
        )
    joints = [_of_joint(summary, sets, joint, confidence) for joint in range(n)]
    return tuple(sorted(joints, key=_joint_key))


def survival(summary: Summary, set_index: int | None = None, confidence: float = 0.95) -> Survival:
    """Return the share of postures per cell that tolerate a fault set.

    Parameters
    ----------
    summary :
        Counts per cell.
    set_index :
        Index of the set, from 0; ``None`` for postures that tolerate every set.
    confidence :
        Confidence level of the intervals.

    Raises
    ------
    InputError
        There is no such set, or the confidence is not between 0 and 1.
    """
    if set_index is not None and not 0 <= set_index < summary.n_sets:
        raise InputError(
            f"no fault set with index {set_index}; the summary has {summary.n_sets}, from 0"
        )
    tolerated = summary.cell_tolerates_all
    if set_index is not None:
        tolerated = summary.cell_tolerated[:, set_index]
    low, high = wilson(tolerated, summary.cell_postures, confidence)
    with np.errstate(invalid="ignore"):
        share = tolerated / summary.cell_postures
    shape = summary.workspace.shape
    return Survival(share.reshape(shape), low.reshape(shape), high.reshape(shape))


def _of_joint(
    summary: Summary, sets: Sequence[FaultSet], joint: int, confidence: float
) -> JointCriticality:
    among = [s for s, faults in enumerate(sets) if joint in faults.joints]
    alone = [s for s in among if len(sets[s]) == 1]
    edges = summary.bins.share
    quantiles = [
        tuple(_quantile(counts[alone], edges, p, confidence) for p in (0.05, 0.5))
        for counts in (summary.margin, summary.rho)
    ]
    capability = None
    if (capability_edges := summary.bins.capability) is not None:
        capability = _capability(summary, alone, capability_edges, confidence)
    not_tolerated = _share(summary, among, NOT_TOLERATED, confidence)
    return JointCriticality(
        joint,
        len(among),
        not_tolerated,
        _share(summary, among, BORDERLINE, confidence).value,
        _share(summary, alone, NOT_TOLERATED, confidence),
        (quantiles[0][0], quantiles[0][1]),
        (quantiles[1][0], quantiles[1][1]),
        capability,
    )


def _share_of(count: float, postures: int, confidence: float) -> Estimate:
    """Return a share of the postures with its Wilson interval.

    Parameters
    ----------
    count, postures :
        Numbers of postures: those of the share, and all.
    confidence :
        Confidence level of the interval.
    """
    if not postures:
        return _UNKNOWN
    low, high = wilson(count, postures, confidence)
    return Estimate(count / postures, float(low), float(high))


def _share(summary: Summary, sets: list[int], verdict: int, confidence: float) -> Estimate:
    """Return the share of postures x sets; each posture is one trial, as sets are correlated."""
    if not sets:
        return _UNKNOWN
    mean = int(summary.verdicts[sets, verdict].sum()) / len(sets)
    return _share_of(mean, int(summary.postures), confidence)


def _quantile(counts: Counts, edges: Vector, p: float, confidence: float) -> Estimate:
    histogram = counts.sum(axis=0)
    low, high = quantile_interval(histogram, edges, p, confidence, max(len(counts), 1))
    return Estimate(float(quantile(histogram, edges, p)), low, high)


def _capability(
    summary: Summary, sets: list[int], edges: Vector, confidence: float
) -> Estimate | None:
    counts = capability_counts(summary)
    return None if counts is None else _quantile(counts[sets], edges, 0.5, confidence)


def capability_counts(summary: Summary) -> Counts | None:
    """Return capabilities with unlimited ones in the last bin and unknown ones in the first."""
    counts, unlimited = summary.capability, summary.capability_unlimited
    if counts is None or unlimited is None or summary.capability_unknown is None:
        return None
    counts = counts.copy()
    counts[:, 0] += summary.capability_unknown
    counts[:, -1] += unlimited
    return counts


def _joint_key(joint: JointCriticality) -> tuple[float, ...]:
    """Return the sort key of a joint, without NaN, which has no order."""
    rho, margin = joint.rho[0].value, joint.margin[0].value
    keys = (-joint.not_tolerated.value, -joint.borderline, rho, margin, float(joint.joint))
    return tuple(math.inf if math.isnan(key) else key for key in keys)


_LOW, _HIGH = 0.05, 0.95
"""Quantiles reported for measures that are bad when small, and when large."""


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
        Share of the postures in which force along some direction is lost, whatever the requested
        force.
    margin, rho :
        5 % and 50 % quantiles of σ_min(K)/σ_max(J) and of w(K)/w(J); NaN where undefined.
    jump :
        50 % and 95 % quantiles and maximum of ‖ΔF‖, N (N·m). A quantile above the force itself,
        possible with free-swinging joints, is infinite. ``None`` without a force.
    falls :
        Share of the postures in which the arm cannot be held in static equilibrium; NaN without a
        force.
    capability :
        5 % and 50 % quantiles of the force that can be commanded in the direction, N (N·m): 0 where
        the arm cannot be held in static equilibrium, infinite where no limit is known; ``None``
        without a direction.
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

    Sorted by the share not tolerated, the share borderline, and the 5 % quantiles of ρ and of the
    margin; undefined values come last.

    Parameters
    ----------
    summary :
        Counts over the sets.
    sets :
        The fault sets, in the order of the summary.
    confidence :
        Confidence level of the intervals.
    """
    found = [_of_set(summary, s, faults, confidence) for s, faults in enumerate(sets)]
    return tuple(sorted(found, key=_set_key))


def tolerating_every_set(summary: Summary, confidence: float = 0.95) -> Estimate:
    """Return the share of the postures that tolerate every fault set of the sweep.

    Parameters
    ----------
    summary :
        Counts over the sets.
    confidence :
        Confidence level of the interval.
    """
    return _share_of(int(summary.tolerated_sets[-1]), int(summary.postures), confidence)


def _of_set(summary: Summary, s: int, faults: FaultSet, confidence: float) -> SetSummary:
    postures = int(summary.postures)

    def share(code: int) -> Estimate:
        return _share_of(int(summary.verdicts[s, code]), postures, confidence)

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
        capability=_capability_of_set(summary, s),
    )


def _quantiles(counts: Counts, edges: Vector) -> tuple[float, float]:
    return float(quantile(counts, edges, _LOW)), float(quantile(counts, edges, 0.5))


def _jump(summary: Summary, s: int) -> tuple[float, float, float] | None:
    edges, counts, largest = summary.bins.jump, summary.jump, summary.max_jump
    if edges is None or counts is None or largest is None:
        return None
    maximum = float(largest[s])
    maximum = maximum if math.isfinite(maximum) else math.nan
    # Quantiles are accurate to one bin, a thousandth of the force; the maximum is exact.
    middle, high = (float(quantile(counts[s], edges, p)) for p in (0.5, _HIGH))
    return _capped(middle, maximum), _capped(high, maximum), maximum


def _capped(x: float, maximum: float) -> float:
    return min(x, maximum) if math.isfinite(x) else x


def _falls(summary: Summary, s: int, postures: int) -> float:
    unknown = summary.jump_unknown
    return math.nan if unknown is None or not postures else int(unknown[s]) / postures


def _capability_of_set(summary: Summary, s: int) -> tuple[float, float] | None:
    edges, counts = summary.bins.capability, capability_counts(summary)
    return None if edges is None or counts is None else _quantiles(counts[s], edges)


def _set_key(one: SetSummary) -> tuple[float, ...]:
    """Return the sort key of a set, without NaN, which has no order."""
    keys = (-one.not_tolerated.value, -one.borderline.value, one.rho[0], one.margin[0])
    return tuple(math.inf if math.isnan(key) else key for key in keys)
