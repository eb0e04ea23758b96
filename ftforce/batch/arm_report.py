"""What a sweep says of its arm in numbers that can stand beside another arm's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.kernels.layout import BORDERLINE, TOLERATED
from ftforce.batch.summary.criticality import Estimate, capability_counts
from ftforce.batch.summary.intervals import quantile, quantile_interval, wilson
from ftforce.core.arrays import read_only
from ftforce.core.measures import worst_manipulability_bound

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.batch.result import Sweep, SweepSetting
    from ftforce.batch.summary.criticality import JointCriticality
    from ftforce.batch.summary.summary import Summary
    from ftforce.core.arrays import Vector

    Counts = NDArray[np.int64]

CONFIDENCE = 0.95  # of all intervals: what wilson and quantile_interval take if not told
FULL = 0.99  # share of postures at which a healthy arm should command the whole task


@dataclass(frozen=True, slots=True)
class SizeReport:
    """What the fault sets of one size cost, over all postures.

    Attributes
    ----------
    size :
        Number of joints that fail together.
    sets :
        Number of such sets.
    tolerated :
        Share of postures x sets that are tolerated; the interval counts a posture once, since what
        it says of one set tells of the others.
    borderline :
        Share of postures x sets that are borderline.
    margin, rho :
        Quantiles 5 % and 50 % over postures x sets; NaN where nothing is known.
    rho_bound :
        The most that the smallest ρ of a posture can be, √(C(n-m, f)/C(n, f)). It is also the root
        of the mean ρ² of every posture at which J has full rank. NaN of joints that swing, or
        fewer joints than task rows.
    jump :
        Quantiles 50 % and 95 % of the force jump over the force that is asked for, infinite above
        1 and where the arm cannot stand still; ``None`` without a force.
    capability :
        Quantiles 5 % and 50 %, N (N·m): 0 where the arm cannot stand still, infinite where no
        limit is known; ``None`` without a direction.
    """

    size: int
    sets: int
    tolerated: Estimate
    borderline: float
    margin: tuple[Estimate, Estimate]
    rho: tuple[Estimate, Estimate]
    rho_bound: float
    jump: tuple[Estimate, Estimate] | None
    capability: tuple[Estimate, Estimate] | None


@dataclass(frozen=True, slots=True)
class WorkspaceReport:
    """Where the tip comes, and where it survives.

    Attributes
    ----------
    cell :
        Edge of a cell, m.
    visited :
        Volume of the cells that hold a posture, m³.
    survived :
        Volume of the cells in which enough postures tolerate every set, m³.
    some :
        Volume of the cells in which at least one posture tolerates every set, m³.
    reach :
        Distance of the farthest visited cell's centre from the first joint, m.
    """

    cell: float
    visited: float
    survived: float
    some: float
    reach: float

    @property
    def share(self) -> float:
        """Survived over visited volume; NaN without postures."""
        return self.survived / self.visited if self.visited else math.nan


@dataclass(frozen=True, slots=True)
class ArmReport:
    """One arm of a comparison.

    Attributes
    ----------
    name :
        Of the arm; two of one name are told apart.
    setting :
        What was asked of it.
    path :
        Of the stored sweep; ``None`` if it was made for the comparison.
    postures :
        How many were analysed.
    tolerated :
        What arms are ranked by: the share of postures x fault sets that are tolerated, where every
        size of sets weighs the same. The interval counts a posture once.
    every :
        Share of postures that tolerate every set.
    full_rank :
        Share of postures at which the healthy arm can command every component of the task.
    worst_rho :
        Median over the postures of the smallest ρ of any set, to a 32nd; NaN where w(J) = 0.
    sizes :
        One report per size of sets, small ones first.
    critical :
        The critical joint, see `ftforce.Sweep`.
    critical_tolerated :
        Share of postures x the sets with this joint that are tolerated.
    workspace :
        Where the tip comes, and where it survives.
    healthy_capability :
        Quantiles 5 % and 50 % of the healthy arm's capability, N (N·m); ``None`` without a
        direction, or of a stored sweep.
    first, last :
        Best and worst rank that the intervals leave open.
    """

    name: str
    setting: SweepSetting
    path: str | None
    postures: int
    tolerated: Estimate
    every: Estimate
    full_rank: float
    worst_rho: Estimate
    sizes: tuple[SizeReport, ...]
    critical: JointCriticality
    critical_tolerated: float
    workspace: WorkspaceReport
    healthy_capability: tuple[Estimate, Estimate] | None
    first: int = 1
    last: int = 1

    @property
    def largest(self) -> SizeReport:
        """The report of the largest sets."""
        return self.sizes[-1]

    @property
    def is_whole(self) -> bool:
        """Whether the healthy arm can command the whole task at nearly every posture."""
        return self.full_rank >= FULL

    @property
    def evenness(self) -> float:
        """Smallest ρ of a posture, the median, over the most it can be; NaN where that is 0."""
        bound = self.largest.rho_bound
        return self.worst_rho.value / bound if bound > 0.0 else math.nan

    @property
    def capability_kept(self) -> float:
        """Median capability after single faults over the healthy arm's; NaN if unknown.

        It can exceed 1: the limit of a locked joint's motor counts no more.
        """
        after, before = self.sizes[0].capability, self.healthy_capability
        if after is None or before is None or not 0.0 < before[1].value < math.inf:
            return math.nan
        return after[1].value / before[1].value


def arm_report(
    sweep: Sweep,
    name: str,
    *,
    enough: float,
    healthy_capability: tuple[Estimate, Estimate] | None = None,
) -> ArmReport:
    """Return what a sweep says of its arm.

    Parameters
    ----------
    sweep :
        At least one posture.
    name :
        Of the arm.
    enough :
        Share of a cell's postures that must tolerate every set for the cell to survive.
    healthy_capability :
        Quantiles 5 % and 50 % of the healthy arm's capability, N (N·m), if known.
    """
    summary, setting = sweep.summary, sweep.setting
    postures = int(summary.postures)
    sizes = tuple(_of_size(sweep, size) for size in range(1, setting.largest + 1))
    share = math.fsum(one.tolerated.value for one in sizes) / len(sizes)
    critical = sweep.joints[0]
    among = [s for s, one in enumerate(sweep.sets) if critical.joint in one.joints]
    return ArmReport(
        name=name,
        setting=setting,
        path=sweep.path,
        postures=postures,
        tolerated=_estimate(share * postures, postures),
        every=_estimate(int(summary.cell_tolerates_all.sum()), postures),
        full_rank=int(summary.healthy_rank[len(setting.components)]) / postures,
        worst_rho=_quantile(summary.cell_worst_rho.sum(axis=0), _edges_of_cells(summary), 0.5, 1),
        sizes=sizes,
        critical=critical,
        critical_tolerated=_share(summary, among, TOLERATED),
        workspace=_workspace(summary, enough),
        healthy_capability=healthy_capability,
    )


def _estimate(successes: float, trials: int) -> Estimate:
    low, high = wilson(successes, trials)
    return Estimate(successes / trials, float(low), float(high))


def _of_size(sweep: Sweep, size: int) -> SizeReport:
    summary, setting = sweep.summary, sweep.setting
    among = [s for s, one in enumerate(sweep.sets) if len(one) == size]
    postures, edges = int(summary.postures), summary.bins.share
    tolerated = int(summary.verdicts[among, TOLERATED].sum())
    return SizeReport(
        size=size,
        sets=len(among),
        tolerated=_estimate(tolerated / len(among), postures),
        borderline=_share(summary, among, BORDERLINE),
        margin=_low_and_middle(summary.margin[among], edges),
        rho=_low_and_middle(summary.rho[among], edges),
        rho_bound=rho_bound(setting, size),
        jump=_jump(summary, among, tolerated),
        capability=_capability(summary, among),
    )


def rho_bound(setting: SweepSetting, size: int) -> float:
    """Return the most that the smallest ρ of a posture can be, see `SizeReport`."""
    n, m = setting.n, len(setting.components)
    if setting.mode != "locked" or m > n:
        return math.nan
    return worst_manipulability_bound(n, m, size)


def _share(summary: Summary, sets: list[int], verdict: int) -> float:
    found = int(summary.verdicts[sets, verdict].sum())
    return found / (len(sets) * int(summary.postures))


def _low_and_middle(counts: Counts, edges: Vector) -> tuple[Estimate, Estimate]:
    """Return the quantiles 5 % and 50 % over postures x sets, whose counts are rows."""
    pooled, repeats = counts.sum(axis=0), len(counts)
    return _quantile(pooled, edges, 0.05, repeats), _quantile(pooled, edges, 0.5, repeats)


def _quantile(histogram: Counts, edges: Vector, p: float, repeats: int) -> Estimate:
    low, high = quantile_interval(histogram, edges, p, repeats=repeats)
    return Estimate(float(quantile(histogram, edges, p)), low, high)


def _jump(summary: Summary, among: list[int], tolerated: int) -> tuple[Estimate, Estimate] | None:
    """Return the quantiles over the force; what is tolerated has none, though it has a bin."""
    if summary.jump is None or summary.jump_unknown is None:
        return None
    pooled = summary.jump[among].sum(axis=0)
    pooled[-1] += summary.jump_unknown[among].sum()
    found = []
    for p in (0.5, 0.95):
        value, low, high = _quantile(pooled, summary.bins.share, p, len(among))
        is_none = math.floor((pooled.sum() - 1) * p) + 1 < tolerated
        found.append(Estimate(0.0 if is_none else value, low, high))
    return found[0], found[1]


def _capability(summary: Summary, among: list[int]) -> tuple[Estimate, Estimate] | None:
    counts, edges = capability_counts(summary), summary.bins.capability
    return None if counts is None or edges is None else _low_and_middle(counts[among], edges)


def capability_of(summary: Summary) -> tuple[Estimate, Estimate] | None:
    """Return the quantiles 5 % and 50 % over postures x sets, N (N·m); ``None`` if not asked."""
    return _capability(summary, list(range(summary.n_sets)))


def _edges_of_cells(summary: Summary) -> Vector:
    bins = summary.cell_worst_rho.shape[1]
    return read_only(np.arange(bins + 1) / bins)


def _workspace(summary: Summary, enough: float) -> WorkspaceReport:
    grid, postures = summary.workspace, summary.cell_postures
    good, visited = summary.cell_tolerates_all, postures > 0
    volume = grid.edge**3
    # Farthest from the middle of the grid: a sweep lays it around the first joint.
    at = np.stack(np.unravel_index(np.flatnonzero(visited), grid.shape), axis=1)
    away = (at + 0.5 - 0.5 * np.array(grid.shape)) * grid.edge
    return WorkspaceReport(
        cell=grid.edge,
        visited=int(visited.sum()) * volume,
        survived=int((visited & (good >= enough * postures)).sum()) * volume,
        some=int((good > 0).sum()) * volume,
        reach=float(np.linalg.norm(away, axis=1).max(initial=0.0)),
    )
