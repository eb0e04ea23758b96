"""Figures of merit of one arm, from its sweep, comparable between arms."""

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

CONFIDENCE = 0.95  # of all intervals: the default of wilson and quantile_interval
_FULL = 0.99  # share of postures at which a healthy arm should command the whole task


@dataclass(frozen=True, slots=True)
class SizeReport:
    """Effect of the fault sets of one size, over all postures.

    Attributes
    ----------
    size :
        Number of joints that fail together.
    sets :
        Number of such sets.
    tolerated :
        Share of postures x sets that are tolerated. The interval counts each posture once, since
        its verdicts for different sets are correlated.
    borderline :
        Share of postures x sets that are borderline.
    margin, rho :
        5 % and 50 % quantiles over postures x sets; NaN where undefined.
    rho_bound :
        Upper bound on the smallest ρ of a posture, √(C(n-m, f)/C(n, f)). It is also the root mean
        square of ρ at every posture where J has full rank. NaN for free-swinging joints, or with
        fewer joints than task rows.
    jump :
        50 % and 95 % quantiles of the force jump relative to the requested force, infinite above 1
        and where the arm cannot be held in static equilibrium; ``None`` without a force.
    capability :
        5 % and 50 % quantiles, N (N·m): 0 where the arm cannot be held in static equilibrium,
        infinite where no limit is known; ``None`` without a direction.
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
    """Volumes of the workspace that the tip visits, and where faults are tolerated.

    Attributes
    ----------
    cell :
        Edge length of a cell, m.
    visited :
        Volume of the cells that contain a posture, m³.
    survived :
        Volume of the cells in which enough postures tolerate every set, m³.
    some :
        Volume of the cells in which at least one posture tolerates every set, m³.
    reach :
        Distance from the first joint to the centre of the farthest visited cell, m.
    """

    cell: float
    visited: float
    survived: float
    some: float
    reach: float

    @property
    def share(self) -> float:
        """Ratio of survived to visited volume; NaN without postures."""
        return self.survived / self.visited if self.visited else math.nan


@dataclass(frozen=True, slots=True)
class ArmReport:
    """One arm of a comparison.

    Attributes
    ----------
    name :
        Name of the arm, unique within the comparison.
    setting :
        Setting of its sweep.
    path :
        Path of the stored sweep; ``None`` if the sweep was run for the comparison.
    postures :
        Number of postures analysed.
    tolerated :
        Share of postures x fault sets that are tolerated, with equal weight for every size of set;
        arms are ranked by it. The interval counts each posture once.
    every :
        Share of postures that tolerate every set.
    full_rank :
        Share of postures at which the healthy arm can command every component of the task.
    worst_rho :
        Median over the postures of the smallest ρ of any set, in steps of 1/32; NaN where
        w(J) = 0.
    sizes :
        One report per size of set, in ascending order.
    critical :
        The critical joint, see `ftforce.Sweep`.
    critical_tolerated :
        Share of postures x sets containing this joint that are tolerated.
    workspace :
        Volumes visited and survived.
    healthy_capability :
        5 % and 50 % quantiles of the healthy arm's capability, N (N·m); ``None`` without a
        direction, or for a stored sweep.
    first, last :
        Best and worst rank compatible with the intervals.
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
        """Report of the largest sets."""
        return self.sizes[-1]

    @property
    def is_whole(self) -> bool:
        """Whether the healthy arm can command the whole task at nearly every posture."""
        return self.full_rank >= _FULL

    @property
    def evenness(self) -> float:
        """Median of the smallest ρ, relative to its upper bound; NaN where the bound is 0."""
        bound = self.largest.rho_bound
        return self.worst_rho.value / bound if bound > 0.0 else math.nan

    @property
    def capability_kept(self) -> float:
        """Ratio of the median capability after single faults to the healthy arm's; NaN if unknown.

        It can exceed 1, because the motor limit of a locked joint no longer applies.
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
    """Return the report of one arm, from its sweep.

    Parameters
    ----------
    sweep :
        Sweep with at least one posture.
    name :
        Name of the arm.
    enough :
        Share of a cell's postures that must tolerate every set for the cell to survive.
    healthy_capability :
        5 % and 50 % quantiles of the healthy arm's capability, N (N·m), if known.
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
        rho_bound=_rho_bound(setting, size),
        jump=_jump(summary, among, tolerated),
        capability=_capability(summary, among),
    )


def _rho_bound(setting: SweepSetting, size: int) -> float:
    """Return the upper bound on the smallest ρ of a posture, see `SizeReport`.

    Parameters
    ----------
    setting :
        Setting of the sweep.
    size :
        Number of joints that fail together.
    """
    n, m = setting.n, len(setting.components)
    if setting.mode != "locked" or m > n:
        return math.nan
    return worst_manipulability_bound(n, m, size)


def _share(summary: Summary, sets: list[int], verdict: int) -> float:
    found = int(summary.verdicts[sets, verdict].sum())
    return found / (len(sets) * int(summary.postures))


def _low_and_middle(counts: Counts, edges: Vector) -> tuple[Estimate, Estimate]:
    """Return the 5 % and 50 % quantiles over postures x sets; ``counts`` has one row per set."""
    pooled, repeats = counts.sum(axis=0), len(counts)
    return _quantile(pooled, edges, 0.05, repeats), _quantile(pooled, edges, 0.5, repeats)


def _quantile(histogram: Counts, edges: Vector, p: float, repeats: int) -> Estimate:
    low, high = quantile_interval(histogram, edges, p, repeats=repeats)
    return Estimate(float(quantile(histogram, edges, p)), low, high)


def _jump(summary: Summary, among: list[int], tolerated: int) -> tuple[Estimate, Estimate] | None:
    """Return quantiles of the jump relative to the force, 0 for tolerated sets."""
    if summary.jump is None or summary.jump_unknown is None:
        return None
    pooled = summary.jump[among].sum(axis=0)
    pooled[-1] += summary.jump_unknown[among].sum()
    found = []
    for p in (0.5, 0.95):
        value, low, high = _quantile(pooled, summary.bins.share, p, len(among))
        is_tolerated = math.floor((pooled.sum() - 1) * p) + 1 < tolerated
        found.append(Estimate(0.0 if is_tolerated else value, low, high))
    return found[0], found[1]


def _capability(summary: Summary, among: list[int]) -> tuple[Estimate, Estimate] | None:
    counts, edges = capability_counts(summary), summary.bins.capability
    return None if counts is None or edges is None else _low_and_middle(counts[among], edges)


def capability_of(summary: Summary) -> tuple[Estimate, Estimate] | None:
    """Return 5 % and 50 % quantiles over postures x sets, N (N·m); ``None`` if not requested."""
    return _capability(summary, list(range(summary.n_sets)))


def _edges_of_cells(summary: Summary) -> Vector:
    bins = summary.cell_worst_rho.shape[1]
    return read_only(np.arange(bins + 1) / bins)


def _workspace(summary: Summary, enough: float) -> WorkspaceReport:
    grid, postures = summary.workspace, summary.cell_postures
    good, visited = summary.cell_tolerates_all, postures > 0
    volume = grid.edge**3
    # Farthest from the centre of the grid, which a sweep centres on the first joint.
    at = np.stack(np.unravel_index(np.flatnonzero(visited), grid.shape), axis=1)
    away = (at + 0.5 - 0.5 * np.array(grid.shape)) * grid.edge
    return WorkspaceReport(
        cell=grid.edge,
        visited=int(visited.sum()) * volume,
        survived=int((visited & (good >= enough * postures)).sum()) * volume,
        some=int((good > 0).sum()) * volume,
        reach=float(np.linalg.norm(away, axis=1).max(initial=0.0)),
    )
