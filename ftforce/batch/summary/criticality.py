"""Which joint is the critical one, and where in the workspace a fault set is survived."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.batch.results import BORDERLINE, NOT_TOLERATED
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
    """A number and its confidence interval; NaN where nothing was counted.

    Attributes
    ----------
    value :
        Share or quantile, in the unit of what was counted.
    low, high :
        Ends of the interval.
    """

    value: float
    low: float
    high: float


UNKNOWN = Estimate(math.nan, math.nan, math.nan)


class Survival(NamedTuple):
    """Share of the postures of each cell that tolerate a fault set; NaN in empty cells.

    Attributes
    ----------
    share :
        Shape (nx, ny, nz).
    low, high :
        Ends of Wilson's interval, shape (nx, ny, nz).
    """

    share: Values
    low: Values
    high: Values


@dataclass(frozen=True, slots=True)
class JointCriticality:
    """What the failure of a joint costs, over all postures.

    Attributes
    ----------
    joint :
        Index along the chain, from 0.
    sets :
        Number of fault sets that contain it.
    not_tolerated :
        Share of postures x these sets that are not tolerated; the interval counts a posture once,
        since what it says of one set tells of the others.
    borderline :
        Share of postures x these sets that are borderline.
    alone :
        Share of postures not tolerated when it fails alone (in any of the modes asked).
    margin, rho :
        Quantiles 5 % and 50 % when it fails alone.
    capability :
        Median when it fails alone, N (N·m): 0 where the arm cannot stand still, infinite where no
        limit is known; ``None`` without a direction.
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
    """Return the joints, the most critical first.

    In the order of the share not tolerated, the share borderline, the 5 % quantile of ρ alone,
    that of the margin, and the joint's number; what is unknown comes last.

    Parameters
    ----------
    summary :
        Counts over the sets.
    sets :
        The fault sets, as they were counted.
    n :
        Number of joints along the chain.
    confidence :
        Of the intervals.

    Raises
    ------
    InputError
        The number of sets is not the summary's, or the confidence is not between 0 and 1.
    """
    if len(sets) != summary.n_sets:
        raise InputError(f"the summary counts {summary.n_sets} fault sets, got {len(sets)}")
    joints = [_of_joint(summary, sets, joint, confidence) for joint in range(n)]
    return tuple(sorted(joints, key=_rank))


def survival(summary: Summary, set_index: int | None = None, confidence: float = 0.95) -> Survival:
    """Return the share of postures per cell that tolerate a fault set.

    Parameters
    ----------
    summary :
        Counts per cell.
    set_index :
        Of the set, from 0; ``None`` asks for postures that tolerate every set.
    confidence :
        Of the intervals.

    Raises
    ------
    InputError
        There is no such set, or the confidence is not between 0 and 1.
    """
    if set_index is not None and not 0 <= set_index < summary.n_sets:
        raise InputError(
            f"no fault set {set_index}; the summary has {summary.n_sets}, counted from 0"
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


def share_of(count: float, postures: int, confidence: float) -> Estimate:
    """Return a share of the postures with Wilson's interval."""
    if not postures:
        return UNKNOWN
    low, high = wilson(count, postures, confidence)
    return Estimate(count / postures, float(low), float(high))


def _share(summary: Summary, sets: list[int], verdict: int, confidence: float) -> Estimate:
    """Return the share of postures x sets; as many trials as postures: correlated sets add none."""
    if not sets:
        return UNKNOWN
    mean = int(summary.verdicts[sets, verdict].sum()) / len(sets)
    return share_of(mean, int(summary.postures), confidence)


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
    """Return the histogram of capabilities: no limit counts above all edges, no rest below them."""
    counts, unlimited = summary.capability, summary.capability_unlimited
    if counts is None or unlimited is None or summary.capability_unknown is None:
        return None
    counts = counts.copy()
    counts[:, 0] += summary.capability_unknown
    counts[:, -1] += unlimited
    return counts


def _rank(joint: JointCriticality) -> tuple[float, ...]:
    """Return what joints are sorted by; NaN would sort anyhow."""
    rho, margin = joint.rho[0].value, joint.margin[0].value
    keys = (-joint.not_tolerated.value, -joint.borderline, rho, margin, float(joint.joint))
    return tuple(math.inf if math.isnan(key) else key for key in keys)
