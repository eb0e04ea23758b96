"""Summaries of blocks of postures, against plain NumPy; no order of adding changes a bit."""

import itertools
import json
import math
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftforce.batch.kernels import counting as kernels
from ftforce.batch.kernels.layout import Block
from ftforce.batch.summary import counting as plain
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.batch.summary.summary import Summary
from ftforce.errors import InputError

INF, NAN = math.inf, math.nan
BINS = Bins(force=50.0, direction=True)
GRID = Workspace.around([0.1, 0.0, 0.5], 0.9, 0.5)

pytestmark = [pytest.mark.plain, pytest.mark.thorough]


def block_of(seed, k, sets=3):
    """Return a block with NaN, infinities, ties, ends of the scales, and numbers beyond them."""
    rng = np.random.default_rng(seed)

    def mixed(values, special):
        return np.where(rng.random(values.shape) < 0.3, rng.choice(special, values.shape), values)

    shape = (sets, k)
    special = [0.0, -0.0, 1.0, 1.0 + 1e-12, -1e-18, 0.5, 0.25, 0.001]
    return Block(
        tip=rng.uniform([-0.8, -0.9, -0.4], [1.0, 0.9, 1.4], (k, 3)),
        rank=rng.integers(0, 4, k).astype(np.int8),
        healthy_margin=mixed(rng.random(k), [*special, NAN]),
        verdict=rng.integers(0, 3, shape).astype(np.int8),
        rank_lost=rng.integers(0, 7, shape).astype(np.int8),
        sigma_min=rng.random(shape),
        margin=mixed(rng.random(shape), special),
        rho=mixed(rng.random(shape), [*special, NAN]),
        jump=mixed(rng.random(shape) * 60.0, [0.0, 50.0, 50.0 * (1 + 1e-12), 70.0, NAN]),
        moment_jump=None,
        relative_jump=None,
        capability=mixed(
            10.0 ** rng.uniform(-4, 7, shape), [0.0, 1e-3, 1.0, 100.0, 1e6, 2e6, INF, NAN]
        ),
    )


def part(block, start, stop):
    """Return some postures of a block."""
    cut = [None if x is None else x[..., start:stop] for x in block[1:]]
    return Block(block.tip[start:stop], *cut)


def summed(block, cuts=(), order=None, bins=BINS, workspace=GRID):
    """Return the summary of a block that was added in parts, in some order."""
    ends = [0, *cuts, len(block.tip)]
    parts = list(itertools.pairwise(ends))
    summary = Summary.empty(len(block.verdict), bins, workspace)
    for i in order if order is not None else range(len(parts)):
        summary.add(part(block, *parts[i]), parts[i][0])
    return summary


def bytes_of(summary):
    return {name: array.tobytes() for name, array in summary.arrays().items()}


# ---- against NumPy -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def block():
    return block_of(0, 3000)


@pytest.fixture(scope="module")
def summary(block):
    return summed(block, [700, 1000, 1000])


def test_postures_ranks_and_verdicts(block, summary):
    assert summary.postures == 3000
    np.testing.assert_array_equal(summary.healthy_rank, np.bincount(block.rank, minlength=7))
    for s in range(3):
        np.testing.assert_array_equal(summary.verdicts[s], np.bincount(block.verdict[s]))
        np.testing.assert_array_equal(summary.rank_lost[s], np.bincount(block.rank_lost[s]))
    good = (block.verdict == 0).sum(axis=0)
    np.testing.assert_array_equal(summary.tolerated_sets, np.bincount(good))


def shares(values, bins=1000):
    values = values[~np.isnan(values)]
    return np.bincount(np.clip((values * bins).astype(int), 0, bins - 1), minlength=bins)


@pytest.mark.parametrize("name", ["margin", "rho"])
def test_histograms_of_shares(block, summary, name):
    values = getattr(block, name)
    for s in range(3):
        np.testing.assert_array_equal(getattr(summary, name)[s], shares(values[s]))
    unknown = np.isnan(values).sum(axis=1)
    np.testing.assert_array_equal(getattr(summary, f"{name}_unknown"), unknown)
    assert (unknown > 0).all() == (name == "rho")


def test_the_healthy_margin(block, summary):
    np.testing.assert_array_equal(summary.healthy_margin, shares(block.healthy_margin))
    assert summary.healthy_unknown == np.isnan(block.healthy_margin).sum() > 0


def test_jumps_up_to_the_force_and_beyond(block, summary):
    for s in range(3):
        values = block.jump[s]
        beyond = values > 50.001
        np.testing.assert_array_equal(summary.jump[s, :-1], shares(values[~beyond] / 50.0))
        assert summary.jump[s, -1] == beyond.sum() > 0
        assert summary.jump_unknown[s] == np.isnan(values).sum() > 0


def test_capabilities_lie_between_the_edges(block, summary):
    edges = summary.bins.capability
    assert len(edges) == 901
    np.testing.assert_allclose(edges, np.logspace(-3, 6, 901), rtol=1e-13)
    for s in range(3):
        values = block.capability[s]
        finite = values[np.isfinite(values)]
        counted, _ = np.histogram(finite, edges)
        np.testing.assert_array_equal(summary.capability[s, 1:-1], counted)
        assert summary.capability[s, 0] == (finite < 1e-3).sum() > 0
        assert summary.capability[s, -1] == (finite > 1e6).sum() > 0
        assert summary.capability_unlimited[s] == np.isinf(values).sum() > 0
        assert summary.capability_unknown[s] == np.isnan(values).sum() > 0


def test_capabilities_at_the_edges_and_beside_them():
    edges = BINS.capability
    values = np.concatenate([edges, np.nextafter(edges, 0.0), np.nextafter(edges, INF)])
    block = block_of(1, len(values), 1)._replace(capability=values[None])
    counted, _ = np.histogram(values, edges)
    np.testing.assert_array_equal(summed(block).capability[0, 1:-1], counted)


@pytest.mark.parametrize(
    ("name", "of", "nan_extreme"),
    [
        ("min_margin", "margin", np.nanargmin),
        ("min_rho", "rho", np.nanargmin),
        ("max_jump", "jump", np.nanargmax),
        ("min_capability", "capability", np.nanargmin),
    ],
)
def test_extremes_and_where_they_occur_first(block, summary, name, of, nan_extreme):
    values = getattr(block, of)
    at = nan_extreme(values, axis=1)
    np.testing.assert_array_equal(getattr(summary, f"{name}_at"), at)
    np.testing.assert_array_equal(getattr(summary, name), values[range(3), at])


def test_cells(block, summary):
    cell = np.floor((block.tip - np.array(GRID.origin)) / GRID.edge).astype(int)
    cell = np.ravel_multi_index(tuple(cell.T), GRID.shape)
    good = block.verdict == 0
    with np.errstate(invalid="ignore"):
        worst = np.fmin.reduce(block.margin), np.fmin.reduce(block.rho)
    assert GRID.shape == (4, 4, 4)
    for c in range(GRID.cells):
        here = cell == c
        assert summary.cell_postures[c] == here.sum() > 0
        assert summary.cell_tolerates_all[c] == good[:, here].all(axis=0).sum()
        np.testing.assert_array_equal(summary.cell_tolerated[c], good[:, here].sum(axis=1))
        lowest = block.margin[:, here].min(axis=1)
        np.testing.assert_array_equal(summary.cell_min_margin[c], lowest)
        np.testing.assert_array_equal(summary.cell_worst_margin[c], shares(worst[0][here], 32))
        np.testing.assert_array_equal(summary.cell_worst_rho[c], shares(worst[1][here], 32))
    assert summary.outside == 0


@pytest.mark.parametrize("count", [kernels, plain])
def test_positions_beyond_the_border_count_in_the_outermost_cells(count):
    grid = Workspace((0.0, 0.0, 0.0), 0.5, (2, 3, 4))
    tip = np.array([[0, 0, 0], [1, 1.5, 2], [9, -9, 0.6], [NAN, 0.5, 0.5], [-INF, INF, 0]])
    cell, outside = grid.index(tip, count.locate)
    np.testing.assert_array_equal(cell, [0, 23, 12 + 1, 4 + 1, 8])
    assert outside == 3


def test_a_workspace_covers_the_ball_and_is_centred():
    grid = Workspace.around([1.0, 2.0, 3.0], 0.15, 0.1)
    assert grid.shape == (3, 3, 3)
    np.testing.assert_allclose(grid.origin, [0.85, 1.85, 2.85])
    wider = Workspace.around([0, 0, 0], 0.151, 0.1)
    assert wider.shape == (4, 4, 4)
    np.testing.assert_allclose(wider.origin, [-0.2] * 3)
    assert Workspace.around([0, 0, 0], 0.27, 0.03).shape == (18,) * 3  # 0.54 / 0.03 is above 18
    assert Workspace.around([0, 0, 0], 0.0, 0.1).cells == 1


# ---- any order, the same bytes -----------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_no_split_and_no_order_changes_a_byte(data):
    block = block_of(data.draw(st.integers(0, 99)), 60, data.draw(st.integers(0, 3)))
    cuts = sorted(data.draw(st.lists(st.integers(0, 60), max_size=5)))
    order = data.draw(st.permutations(range(len(cuts) + 1)))
    whole = bytes_of(summed(block))
    assert bytes_of(summed(block, cuts, order)) == whole
    parts = [summed(block, cuts, [i]) for i in order]
    while len(parts) > 1:  # merged as a tree of any form
        i = data.draw(st.integers(0, len(parts) - 2))
        parts[i].merge(parts.pop(i + 1))
    assert bytes_of(parts[0]) == whole


def test_ties_go_to_the_first_posture_whatever_comes_first():
    block = block_of(3, 4, 1)._replace(margin=np.array([[0.5, 0.25, 0.25, -0.0]]))
    summary = summed(part(block, 0, 3), [1, 2], [2, 1, 0])
    assert (summary.min_margin[0], summary.min_margin_at[0]) == (0.25, 1)
    assert math.copysign(1.0, summed(block).min_margin[0]) == 1.0
    assert not np.signbit(summed(block).cell_min_margin).any()


def test_a_summary_travels_as_arrays(summary):
    copy = Summary.from_arrays(summary.arrays(), summary.bins, summary.workspace)
    assert bytes_of(copy) == bytes_of(summary) == bytes_of(pickle.loads(pickle.dumps(summary)))
    copy.merge(summary)
    assert copy.postures == 2 * summary.postures == 6000


def test_without_force_direction_or_postures():
    block = block_of(4, 50)._replace(jump=None, capability=None)
    summary = summed(block, bins=Bins())
    assert summary.jump is summary.max_jump is summary.capability is None
    assert "jump" not in summary.arrays()
    nothing = Summary.empty(3, Bins(), GRID)
    nothing.add(part(block, 0, 0), 0)
    assert (nothing.min_margin_at == -1).all()
    assert np.isinf(nothing.min_margin).all()
    before = bytes_of(summary)
    summary.merge(nothing)
    assert bytes_of(summary) == before


def test_what_is_unknown_everywhere_has_no_extreme():
    block = block_of(5, 9)
    block = block._replace(
        rho=np.full((3, 9), NAN), jump=np.full((3, 9), NAN), capability=np.full((3, 9), INF)
    )
    summary = summed(block)
    for name in ("min_rho_at", "max_jump_at", "min_capability_at"):
        np.testing.assert_array_equal(getattr(summary, name), -1)
    assert not summary.cell_worst_rho.any()


def test_arrays_that_are_cut_turned_or_read_only_count_the_same(block):
    turned = Block(*[x if x is None else np.asfortranarray(x) for x in block])
    assert bytes_of(summed(turned)) == bytes_of(summed(block))


# ---- refusals ----------------------------------------------------------------------------------


def test_a_summary_that_would_not_fit_says_what_to_reduce():
    big = Workspace.around([0, 0, 0], 1.0, 0.01)
    with pytest.raises(InputError, match=r"5\.\d+ GB, .* number of cells \(8000000\)"):
        Summary.empty(7, Bins(), big)
    with pytest.raises(InputError, match=r"number of fault sets \(100000\)"):
        Summary.empty(100_000, Bins(), Workspace.around([0, 0, 0], 1.0, 1.0))


def test_the_size_is_the_one_that_the_docstring_says(summary):
    size = sum(array.nbytes for array in summary.arrays().values())
    assert size == pytest.approx(
        8 * (3 * (2017 + 1004 + 906) + GRID.cells * (66 + 2 * 3)), abs=8 * 1020
    )


def test_blocks_that_do_not_fit_are_refused(block):
    summary = Summary.empty(3, BINS, GRID)
    before = bytes_of(summary)
    for wrong, match in [
        (block_of(0, 9, 2), r"shape \(3, 9\), got \(2, 9\)"),
        (block._replace(jump=None), "jump of the block: expected shape .*, got None"),
        (block._replace(rho=block.rho[:, 1:]), "rho of the block: expected shape"),
        (
            block._replace(verdict=block.verdict + np.int8(1)),
            "verdict of the block: expected values from 0 to 2",
        ),
        (
            block._replace(rank=block.rank - np.int8(1)),
            "rank of the block: expected values from 0 to 6",
        ),
        (block._replace(tip=block.tip[:, :2]), "tip of the block: expected shape"),
        (
            block._replace(healthy_margin=block.rank[1:]),
            "healthy_margin of the block: expected shape",
        ),
    ]:
        with pytest.raises(InputError, match=match):
            summary.add(wrong, 0)
    assert bytes_of(summary) == before


def test_only_like_summaries_merge(summary):
    for other in [
        Summary.empty(2, BINS, GRID),
        Summary.empty(3, Bins(40.0, True), GRID),
        Summary.empty(3, BINS, Workspace.around([0, 0, 0], 1.0, 0.5)),
    ]:
        with pytest.raises(InputError, match="bins, workspace and fault sets are the same"):
            summary.merge(other)


def test_arrays_that_are_none_of_a_summary_are_refused(summary):
    arrays = summary.arrays()
    for wrong, match in [
        ({}, "missing array 'verdicts'"),
        ({**arrays, "more": [1]}, "missing or unknown arrays: more"),
        ({k: v for k, v in arrays.items() if k != "rho"}, "missing or unknown arrays: rho"),
        ({**arrays, "rho": arrays["rho"][:, 1:]}, r"rho: expected int64 of shape \(3, 1000\)"),
        ({**arrays, "rho": arrays["rho"] * 1.0}, "got float64"),
    ]:
        with pytest.raises(InputError, match=match):
            Summary.from_arrays(wrong, BINS, GRID)


@pytest.mark.parametrize("force", [0.0, -1.0, NAN, INF])
def test_a_scale_of_jumps_needs_a_force(force):
    with pytest.raises(InputError, match="norm of the force must be positive"):
        Bins(force)


@pytest.mark.parametrize(("radius", "edge"), [(1.0, 0.0), (1.0, NAN), (-1.0, 0.1), (INF, 0.1)])
def test_a_workspace_needs_a_radius_and_an_edge(radius, edge):
    with pytest.raises(InputError, match="in m, got"):
        Workspace.around([0, 0, 0], radius, edge)


# ---- without compiled kernels ------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_numpy_counts_what_the_kernels_count(seed):
    summaries = [Summary.empty(3, BINS, GRID) for _ in range(2)]
    for summary, compiled in zip(summaries, (True, False), strict=True):
        for start in (0, 400):
            summary.add(block_of(seed + start, 400), start, compiled=compiled)
    compiled, by_numpy = map(bytes_of, summaries)
    assert by_numpy == compiled


# ---- kernels as plain Python -------------------------------------------------------------------

PLAIN = """
import json
from test_batch_summary import block_of, bytes_of, summed
print(json.dumps({k: v.hex() for k, v in bytes_of(summed(block_of(7, 300, 2), [100])).items()}))
"""


def test_kernels_give_the_same_as_plain_python():
    here = os.path.dirname(__file__)  # noqa: PTH120
    env = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": here}
    run = subprocess.run(
        [sys.executable, "-c", PLAIN], env=env, capture_output=True, text=True, check=True
    )
    compiled = bytes_of(summed(block_of(7, 300, 2), [100]))
    assert json.loads(run.stdout) == {k: v.hex() for k, v in compiled.items()}
