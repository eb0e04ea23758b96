"""Shares and quantiles of counts, against SciPy, NumPy and simulated draws."""

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.batch.summary.criticality import criticality, survival
from ftforce.batch.summary.intervals import quantile, quantile_interval, wilson
from ftforce.batch.summary.summary import Summary
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.errors import InputError

EDGES = np.linspace(0.0, 1.0, 101)
INF, NAN = math.inf, math.nan
ONE_CELL = Workspace.around([0, 0, 0], 1.0, 2.0)


# ---- shares ------------------------------------------------------------------------------------


@given(st.integers(1, 10**9).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_is_scipys(counts):
    successes, trials = counts
    oracle = scipy.stats.binomtest(successes, trials).proportion_ci(0.9, method="wilson")
    low, high = wilson(successes, trials, 0.9)
    np.testing.assert_allclose([low, high], oracle, rtol=1e-7, atol=1e-12)


def test_wilson_ends_at_0_and_1_exactly_and_knows_nothing_without_trials():
    low, high = wilson([0, 7, 0], [7, 7, 0])
    trials = np.arange(1, 1000)
    assert (wilson(0, trials)[0] == 0.0).all()
    assert (wilson(trials, trials)[1] == 1.0).all()
    assert 0.0 < high[0] < 1.0
    assert high[0] == pytest.approx(1.0 - low[1])
    assert math.isnan(low[2])
    assert math.isnan(high[2])


def test_wilson_of_very_many_postures():
    low, high = wilson(5, 10**12)
    oracle = scipy.stats.binomtest(5, 10**12).proportion_ci(method="wilson")
    np.testing.assert_allclose([low, high], oracle, rtol=1e-6)


# ---- quantiles ---------------------------------------------------------------------------------


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40),
    st.floats(0.0, 1.0),
)
def test_quantiles_are_numpys_within_a_bin(samples, p):
    histogram, _ = np.histogram(samples, EDGES)
    assert abs(quantile(histogram, EDGES, p) - np.quantile(samples, p)) <= 0.01 + 1e-12


def test_quantiles_of_rows():
    rng = np.random.default_rng(1)
    samples = rng.beta(2, 5, (4, 3, 500))
    counted = np.apply_along_axis(lambda x: np.histogram(x, EDGES)[0], -1, samples)
    found = quantile(counted, EDGES, 0.3)
    assert found.shape == (4, 3)
    np.testing.assert_allclose(found, np.quantile(samples, 0.3, axis=-1), atol=0.01)


def test_a_quantile_may_lie_below_or_above_all_edges_or_nowhere():
    edges = np.array([1.0, 2.0, 3.0])
    assert quantile(np.array([1, 1, 3]), edges, 0.9) == INF
    assert quantile(np.array([1, 0, 9]), edges, 0.05) == INF  # between 1.5 and infinity
    assert quantile(np.array([1, 0, 1]), edges, 0.0) == pytest.approx(1.5)
    assert quantile(np.array([3, 1, 1, 0]), edges, 0.3) == 0.0
    assert quantile(np.array([0, 0, 4, 0]), edges, 0.5) == pytest.approx(2.5)
    assert math.isnan(quantile(np.zeros(2, int), edges, 0.5))
    with pytest.raises(InputError, match="3 edges make 2 bins"):
        quantile(np.zeros(5, int), edges, 0.5)
    with pytest.raises(InputError, match="probability of a quantile must be from 0 to 1"):
        quantile(np.zeros(2, int), edges, 5)


@pytest.mark.parametrize("n", [1, 2, 7, 59, 60, 1000])
@pytest.mark.parametrize("p", [0.0, 0.05, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("repeats", [1, 3])
def test_intervals_are_order_statistics(n, p, repeats):
    """One sample per bin: the ranks can be read off the interval."""
    edges = np.arange(n + 1.0)
    low, high = quantile_interval(np.full(n, repeats), edges, p, 0.9, repeats)
    below = n if p == 1.0 else int(scipy.stats.binom.ppf(0.05, n, p))
    above = int(scipy.stats.binom.ppf(0.95, n, p)) + 1
    if p in {0.0, 1.0}:
        below, above = (0, 1) if p == 0.0 else (n, n + 1)
    assert low == max(below - 1, 0)
    assert high == min(above, n)


@pytest.mark.parametrize("p", [0.05, 0.5])
def test_intervals_hold_the_quantile_as_often_as_they_say(p):
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(1000):
        histogram, _ = np.histogram(rng.beta(2, 5, 200), EDGES)
        low, high = quantile_interval(histogram, EDGES, p, 0.8)
        assert high - low < 0.15
        held += low <= scipy.stats.beta.ppf(p, 2, 5) <= high
    assert held >= 780


def test_intervals_beyond_the_edges():
    edges = np.array([1.0, 2.0, 3.0])
    assert quantile_interval(np.array([0, 500, 0, 500]), edges, 0.5) == (1.0, INF)
    assert quantile_interval(np.array([500, 0, 500, 0]), edges, 0.5) == (0.0, 3.0)
    assert all(map(math.isnan, quantile_interval(np.zeros(2, int), edges, 0.5)))
    with pytest.raises(InputError, match="between 0 and 1"):
        quantile_interval(np.zeros(2, int), edges, 0.5, 95)


# ---- joints and cells --------------------------------------------------------------------------


def summary_of(sets, verdicts, rho=0.5, margin=0.5, bins=None):
    """Return a summary of 100 postures with these verdicts, all of one ρ and margin per set."""
    summary = Summary.empty(len(sets), bins or Bins(), ONE_CELL)
    summary.postures[...] = 100
    summary.verdicts[:] = verdicts
    for counts, value in ((summary.rho, rho), (summary.margin, margin)):
        places = (np.broadcast_to(value, len(sets)) * 1000).astype(int)
        counts[np.arange(len(sets)), places] = 100
    return summary


def test_the_joint_that_costs_most_comes_first():
    sets = [FaultSet.locked(joints) for joints in ([0], [1], [2], [0, 1], [1, 2])]
    summary = summary_of(
        sets,
        [[100, 0, 0], [90, 5, 5], [80, 20, 0], [50, 10, 40], [100, 0, 0]],
        [0.2, 0.3, 0.4, 0, 0],
    )
    joints = criticality(summary, sets, 4, 0.9)
    assert [joint.joint for joint in joints] == [0, 1, 2, 3]
    first, second, _, none = joints
    assert (first.sets, second.sets, none.sets) == (2, 3, 0)
    assert first.not_tolerated.value == pytest.approx(0.2)
    assert second.not_tolerated.value == pytest.approx(0.15)
    assert second.borderline == pytest.approx(0.05)
    assert second.alone.value == pytest.approx(0.05)
    oracle = scipy.stats.binomtest(20, 100).proportion_ci(0.9, method="wilson")
    assert first.not_tolerated[1:] == pytest.approx(tuple(oracle))
    assert first.rho[0] == pytest.approx((0.2, 0.2, 0.201), abs=1e-3)
    assert second.rho[1].value == pytest.approx(0.3, abs=1e-3)
    assert first.capability is None
    assert math.isnan(none.not_tolerated.value)
    assert math.isnan(none.rho[0].value)


def test_ties_are_settled_by_borderline_rho_margin_and_number():
    sets = [FaultSet.locked([joint]) for joint in range(6)]
    verdicts = [[95, 0, 5]] * 5 + [[94, 1, 5]]
    rho = [0.5, 0.4, 0.4, 0.5, 0.5, 0.9]
    margin = [0.5, 0.5, 0.1, 0.5, 0.2, 0.9]
    joints = criticality(summary_of(sets, verdicts, rho, margin), sets, 6)
    assert [joint.joint for joint in joints] == [5, 2, 1, 4, 0, 3]


def test_modes_of_one_joint_are_taken_together_but_a_posture_counts_once():
    modes = [FaultSet((Fault(0, mode),)) for mode in (FaultMode.LOCKED, FaultMode.FREE)]
    summary = summary_of(modes, [[100, 0, 0], [40, 0, 60]])
    (joint,) = criticality(summary, modes, 1)
    oracle = scipy.stats.binomtest(30, 100).proportion_ci(method="wilson")
    assert joint.alone == pytest.approx((0.3, *oracle))
    summary.rho[0] = summary.rho[1] = 0
    summary.rho[:, 0:1000:10] = 1  # 100 postures, twice
    (joint,) = criticality(summary, modes, 1)
    once = quantile_interval(summary.rho[0], summary.bins.share, 0.5)
    assert joint.rho[1][1:] == once


def test_the_capability_of_an_arm_that_falls_is_zero_and_without_limit_infinite():
    sets = [FaultSet.locked([0])]
    summary = summary_of(sets, [[100, 0, 0]], bins=Bins(direction=True))
    summary.capability[0, 1 + 500] = 100  # 100 N
    (joint,) = criticality(summary, sets, 1)
    assert joint.capability.value == pytest.approx(100.0, rel=0.03)
    summary.capability_unknown[0] = 200
    assert criticality(summary, sets, 1)[0].capability == (0.0, 0.0, 0.0)
    summary.capability_unlimited[0] = 1000
    assert criticality(summary, sets, 1)[0].capability.value == INF


def test_the_sets_are_the_summarys():
    with pytest.raises(InputError, match="expected 1 fault sets, as in the summary, got 0"):
        criticality(summary_of([FaultSet()], [[1, 0, 0]]), [], 1)


def test_survival_of_cells():
    workspace = Workspace((0.0, 0.0, 0.0), 1.0, (1, 2, 2))
    summary = Summary.empty(2, Bins(), workspace)
    summary.cell_postures[:] = [0, 10, 10, 10]
    summary.cell_tolerated[:, 1] = [0, 0, 5, 10]
    summary.cell_tolerates_all[:] = [0, 0, 1, 10]
    share, low, high = survival(summary, 1)
    np.testing.assert_array_equal(share, [[[NAN, 0.0], [0.5, 1.0]]])
    oracle = scipy.stats.binomtest(5, 10).proportion_ci(method="wilson")
    np.testing.assert_allclose([low[0, 1, 0], high[0, 1, 0]], oracle)
    assert np.isnan(low[0, 0, 0])
    np.testing.assert_array_equal(survival(summary).share, [[[NAN, 0.0], [0.1, 1.0]]])
    with pytest.raises(InputError, match="no fault set with index 2; the summary has 2"):
        survival(summary, 2)
