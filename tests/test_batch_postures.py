"""Postures of a sweep: any block equals the same part of what NumPy and SciPy draw at once."""

import inspect
import json
import math
import pickle
from dataclasses import FrozenInstanceError, replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from ftforce.batch.postures import drawn
from ftforce.batch.postures.drawn import Drawn, sobol_columns, sobol_integers
from ftforce.batch.postures.postures import Grid, Listed, ranges_of
from ftforce.errors import InputError, UnknownNameError
from helpers import campaign, load_text, serial_urdf
from urdfs import arm as small_arm
from urdfs import joint as joint_of
from urdfs import load

LOWER, UPPER = np.array([-1.0, -math.pi, 0.25]), np.array([2.0, math.pi, 0.75])


@pytest.fixture(scope="module")
def arm():
    """Return an arm that turns with limits, turns endlessly, and slides."""
    return load_text(
        serial_urdf(
            ("revolute", {"lower": -1, "upper": 2}),
            ("continuous", {}),
            ("prismatic", {"lower": 0.25, "upper": 0.75}),
        )
    )


@pytest.fixture(scope="module")
def endless(arm):
    """Return the arm with a slide that has no limits."""
    slide = replace(arm.joints[2], lower=-math.inf, upper=math.inf)
    return replace(arm, joints=(*arm.joints[:2], slide))


def sources(arm):
    q = np.random.default_rng(1).normal(size=(50, 3))
    return [
        Drawn.of(arm, 700, "sobol", 5),
        Drawn.of(arm, 700, "uniform", 5),
        Grid.of(arm, [4, 5, 6]),
        Listed.of(arm, q),
    ]


NAMES = ["sobol", "uniform", "grid", "listed"]


# ---- what all have in common -----------------------------------------------------------------


@pytest.mark.parametrize("which", range(4), ids=NAMES)
@given(data=st.data())
def test_blocks_are_parts_of_one(arm, which, data):
    postures = sources(arm)[which]
    stop = data.draw(st.integers(0, postures.count))
    start = data.draw(st.integers(0, stop))
    block = postures.block(start, stop)
    np.testing.assert_array_equal(block, postures.block(0, postures.count)[start:stop])
    assert block.shape == (stop - start, 3)
    assert block.dtype == np.float64
    assert block.flags.c_contiguous
    assert block.flags.writeable


@pytest.mark.parametrize("which", range(4), ids=NAMES)
def test_workers_get_the_same(arm, which):
    postures = sources(arm)[which]
    other = pickle.loads(pickle.dumps(postures))
    np.testing.assert_array_equal(other.block(3, 49), postures.block(3, 49))
    assert other.identity() == postures.identity()
    assert (other.count, other.n) == (postures.count, 3)
    assert str(other) == str(postures)


@pytest.mark.parametrize("which", range(4), ids=NAMES)
def test_sources_are_frozen_and_blocks_the_callers(arm, which):
    postures = sources(arm)[which]
    before = postures.block(0, 20)
    postures.block(0, 20)[:] = 99.0
    np.testing.assert_array_equal(postures.block(0, 20), before)
    with pytest.raises(FrozenInstanceError):
        postures.count = 3
    with pytest.raises(FrozenInstanceError):
        postures.lower = before


@pytest.mark.parametrize("which", range(4), ids=NAMES)
@pytest.mark.parametrize("block", [(-1, 3), (3, 2), (0, 1001)])
def test_blocks_beyond(arm, which, block):
    with pytest.raises(InputError, match="is outside the range 0 to"):
        sources(arm)[which].block(*block)


@pytest.mark.parametrize("which", range(4), ids=NAMES)
def test_integers_of_numpy_do_not_overflow(arm, which):
    postures = sources(arm)[which]
    start, stop = np.array([5, 40], dtype=np.int8)
    np.testing.assert_array_equal(postures.block(start, stop), postures.block(5, 40))


def test_identities_differ_where_the_postures_do(arm):
    q = np.arange(6.0).reshape(2, 3)
    other = replace(arm, joints=(replace(arm.joints[0], upper=1.9), *arm.joints[1:]))
    different = [
        Drawn.of(arm, 10),
        Drawn.of(arm, 11),
        Drawn.of(arm, 10, seed=1),
        Drawn.of(arm, 10, "uniform"),
        Drawn.of(arm, 10, "uniform", seed=1),
        Drawn.of(other, 10),
        Drawn.of(other, 10, "uniform"),
        Grid.of(arm, [2, 1, 5]),
        Grid.of(arm, [1, 2, 5]),
        Grid.of(other, [2, 1, 5]),
        Listed.of(arm, q),
        Listed.of(arm, q[:1]),
        Listed.of(arm, q[::-1]),
    ]
    identities = [json.dumps(postures.identity(), sort_keys=True) for postures in different]
    assert len(set(identities)) == len(different)
    same = Drawn.of(arm, 10.0, "sobol", np.int64(0)).identity()
    assert json.loads(identities[0]) == same  # as it comes back from a file


# ---- Sobol -----------------------------------------------------------------------------------


def engine_of(n, seed, **options):
    """Return SciPy's sequence; before SciPy 1.15 the generator had another name."""
    word = "rng" if "rng" in inspect.signature(qmc.Sobol).parameters else "seed"
    return qmc.Sobol(n, **options, **{word: np.random.default_rng(seed)})


def stream_of(n, seed, count):
    """Return the first points of SciPy's sequence."""
    return engine_of(n, seed).random_base2(math.ceil(math.log2(count)))[:count]


@pytest.mark.parametrize("n", [1, 7, 100])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 4097, 20000])
def test_sobol_is_scipys(n, count):
    wanted = stream_of(n, n + count, count)
    columns = sobol_columns(n, count, n + count)
    for start in {0, 1, count // 2, count - 1}:
        got = sobol_integers(columns, start, count) / 2**30
        np.testing.assert_array_equal(got, wanted[start:])


@settings(max_examples=campaign(100, 20))
@given(st.integers(0, 2**100), st.integers(1, 9), st.data())
def test_sobol_of_any_seed(seed, n, data):
    count = data.draw(st.integers(1, 3000))
    start = data.draw(st.integers(0, count))
    stop = data.draw(st.integers(start, count))
    got = sobol_integers(sobol_columns(n, count, seed), start, stop)
    np.testing.assert_array_equal(got / 2**30, stream_of(n, seed, count)[start:stop])


def test_sobol_far_away():
    """Where SciPy has to step through all points before."""
    start = 5_000_003
    engine = engine_of(3, 8)
    engine.fast_forward(start)
    wanted = engine.random(70_000)
    got = Drawn(np.zeros(3), np.ones(3), 10**7, "sobol", 8).block(start, start + 70_000)
    np.testing.assert_array_equal(got, wanted)


def test_sobol_within_the_limits(arm):
    unit = stream_of(3, 4, 1000)
    got = Drawn.of(arm, 1000, seed=4).block(0, 1000)
    np.testing.assert_allclose(got, qmc.scale(unit, LOWER, UPPER), rtol=0, atol=1e-15)
    low, high = got.min(axis=0), got.max(axis=0)
    assert (low >= LOWER).all()
    assert (high <= UPPER).all()
    assert (high - low > 0.99 * (UPPER - LOWER)).all()


def test_the_block_looks_up_no_more_than_it_needs(arm, monkeypatch):
    sizes = []
    real = drawn._first_points
    monkeypatch.setattr(
        drawn, "_first_points", lambda c, bits: (sizes.append(bits), real(c, bits))[1]
    )
    postures = Drawn.of(arm, 10**6)
    postures.block(777_777, 777_778)
    postures.block(777_777, 777_782)
    postures.block(3, 60_000)
    assert sizes == [0, 3, 12]


def test_an_older_scipy_says_seed(monkeypatch):
    today = engine_of(4, 3, bits=30)

    def old(d, *, scramble, bits, seed):
        assert (d, scramble, bits) == (4, True, 30)
        assert isinstance(seed, np.random.Generator)
        return today

    wanted = sobol_columns(4, 100, 3).points
    monkeypatch.setattr(qmc, "Sobol", old)
    np.testing.assert_array_equal(sobol_columns(4, 100, 3).points, wanted)


def test_another_scrambling_is_another_identity(arm, monkeypatch):
    before = Drawn.of(arm, 100).identity()
    new = qmc.Sobol
    monkeypatch.setattr(qmc, "Sobol", lambda d, **o: new(d, **{**o, "scramble": False}))
    assert Drawn.of(arm, 100).identity() != before


# ---- uniform ---------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_uniform_is_numpys_stream(n):
    wanted = np.random.Generator(np.random.PCG64DXSM(9)).random((500, n))
    postures = Drawn(np.zeros(n), np.ones(n), 500, "uniform", 9)
    for start, stop in [(0, 500), (1, 2), (123, 456), (499, 500), (64, 192)]:
        np.testing.assert_array_equal(postures.block(start, stop), wanted[start:stop])


def test_a_double_is_one_number_of_the_stream():
    raw = np.random.PCG64DXSM(4).random_raw(1000)
    got = Drawn(np.zeros(1), np.ones(1), 1000, "uniform", 4).block(0, 1000)
    np.testing.assert_array_equal(got[:, 0], (raw >> np.uint64(11)) / 2.0**53)


def test_uniform_within_the_limits(arm):
    unit = np.random.Generator(np.random.PCG64DXSM(2)).random((2000, 3))
    got = Drawn.of(arm, 2000, "uniform", 2).block(0, 2000)
    np.testing.assert_allclose(got, qmc.scale(unit, LOWER, UPPER), rtol=0, atol=1e-15)


def test_far_blocks_cost_what_near_ones_do(arm):
    """2**62 postures: whoever steps through them never comes back."""
    postures = Drawn.of(arm, 2**62, "uniform")
    stream = np.random.PCG64DXSM(0)
    stream.advance((2**62 - 5) * 3)
    unit = np.random.Generator(stream).random((5, 3))
    got = postures.block(2**62 - 5, 2**62)
    np.testing.assert_allclose(got, qmc.scale(unit, LOWER, UPPER), rtol=0, atol=1e-15)


@given(st.floats(-10.0, 10.0), st.floats(0.0, 10.0), st.sampled_from([2.0**-30, 2.0**-53]))
def test_rounding_does_not_leave_the_limits(lower, width, below):
    """Not even with the largest number that either method can draw."""
    low, high = np.array([lower]), np.array([lower + width])
    largest = Drawn(low, high, 1, "uniform")._within(np.array([[1.0 - below]]), 1.0)
    assert low <= largest <= high


def test_limits_that_are_one_value():
    ones = np.ones(2)
    assert (Drawn(ones, ones, 10, "uniform").block(0, 10) == 1.0).all()


# ---- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, -1, 1.5, math.nan, math.inf, "7", None, True, 2**63, [3]])
def test_counts_that_are_none(arm, count):
    with pytest.raises(InputError, match="the number of postures must be an integer from 1"):
        Drawn.of(arm, count, "uniform")


@pytest.mark.parametrize("seed", [-1, 1.0, "1", None, True])
def test_seeds_that_are_none(arm, seed):
    with pytest.raises(InputError, match="the seed must be a non-negative integer, got"):
        Drawn.of(arm, 10, seed=seed)


def test_unknown_methods_are_named(arm):
    with pytest.raises(UnknownNameError, match="did you mean 'sobol'"):
        Drawn.of(arm, 10, "sobel")
    with pytest.raises(UnknownNameError, match="available: sobol, uniform"):
        Drawn.of(arm, 10, None)


def test_sobol_ends(arm):
    with pytest.raises(
        InputError, match=r"at most 1,073,741,824 \(2\*\*30\).*use the method 'uniform' for more"
    ):
        Drawn.of(arm, 2**30 + 1)


@pytest.mark.parametrize("make", [lambda r: Drawn.of(r, 5), lambda r: Grid.of(r, 2)])
def test_slides_need_limits(endless, make):
    with pytest.raises(InputError, match=r"prismatic joint 3 \(j3\) has no position limits"):
        make(endless)


@pytest.mark.parametrize(
    ("lower", "upper", "drawn"),
    [("-1e9", "1e9", (-math.pi, math.pi)), ("5", "1e9", (5, 5 + 2 * math.pi)),
     ("-1e9", "-4", (-4 - 2 * math.pi, -4)), ("-1", "2", (-1, 2))],
)  # fmt: skip
def test_a_hinge_with_one_limit_is_drawn_within_a_turn_from_it(tmp_path, lower, upper, drawn):
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    found = load(tmp_path, small_arm(j2=joint_of("j2", "l1", "l2", limit=limit)))
    low, high = ranges_of(found)
    assert (low[1], high[1]) == drawn
    q = Drawn.of(found, 64).block(0, 64)
    assert ((q >= low) & (q <= high)).all()


@pytest.mark.parametrize(
    ("lower", "upper", "missing"), [("0", "1e6", "upper"), ("-1e3", "1", "lower")]
)
def test_a_slide_open_at_one_end_has_no_range(tmp_path, lower, upper, missing):
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    found = load(tmp_path, small_arm(j2=joint_of("j2", "l1", "l2", "prismatic", limit=limit)))
    with pytest.raises(InputError, match=f"has no {missing} position limit; add it"):
        ranges_of(found)


def test_words(arm):
    assert str(Drawn.of(arm, 1e6)) == "1,000,000 scrambled Sobol postures within the limits, seed 0"
    uniform = Drawn.of(arm, 2000, "uniform", 3)
    assert str(uniform) == "2,000 uniform random postures within the limits, seed 3"
    assert str(Grid.of(arm, 11)) == "1,331 postures on a grid of 11 x 11 x 11"
    assert str(Listed.of(arm, np.zeros((1, 3)))) == "1 given posture"
    assert str(Listed.of(arm, np.zeros((2000, 3)))) == "2,000 given postures"


# ---- grids -----------------------------------------------------------------------------------


@settings(max_examples=campaign(100, 20))
@given(st.lists(st.integers(1, 7), min_size=3, max_size=3))
def test_grids_are_products(arm, counts):
    a, b, c = counts
    axes = [
        np.linspace(-1.0, 2.0, a) if a > 1 else [0.5],
        np.linspace(-math.pi, math.pi, b, endpoint=False) if b > 1 else [0.0],
        np.linspace(0.25, 0.75, c) if c > 1 else [0.5],
    ]
    grid = Grid.of(arm, counts)
    assert grid.count == a * b * c
    got = grid.block(0, grid.count)
    np.testing.assert_allclose(got, list(product(*axes)), rtol=0, atol=1e-15)
    for joint, (count, low, high) in enumerate(zip(counts, LOWER, UPPER, strict=True)):
        if count > 1:
            assert got[:, joint].min() == low  # to the last digit
            assert joint == 1 or got[:, joint].max() == high


def test_one_count_serves_all(arm):
    assert Grid.of(arm, 4).counts == Grid.of(arm, np.array([4, 4, 4])).counts == (4, 4, 4)


def test_huge_grids(arm):
    """The very last postures of 2**63 - 1, or nearly so many."""
    count = 2_097_151
    grid = Grid.of(arm, count)
    assert grid.count == count**3
    got = grid.block(grid.count - 3, grid.count)
    np.testing.assert_allclose(got[:, 0], 2.0, rtol=0, atol=1e-15)
    step = 0.5 / (count - 1)
    np.testing.assert_allclose(got[:, 2], [0.75 - 2 * step, 0.75 - step, 0.75], rtol=0, atol=1e-15)
    middle = count * count * 5 + count * 7 + 2
    indices = np.array([(5, 7, 2), (5, 7, 3)])
    wanted = LOWER + indices * [3.0 / (count - 1), 2 * math.pi / count, step]
    np.testing.assert_allclose(grid.block(middle, middle + 2), wanted, rtol=0, atol=1e-14)
    line = Grid.of(arm, [2**63 - 1, 1, 1])
    assert line.block(2**63 - 2, 2**63 - 1).tolist() == [[2.0, 0.0, 0.5]]
    line = Grid.of(arm, [1, 1, 2**63 - 1])
    assert line.block(2**63 - 2, 2**63 - 1).tolist() == [[0.5, 0.0, 0.75]]


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        (0, "the number of positions of a joint must be an integer from 1"),
        ([2, 2.5, 2], "must be an integer"),
        ("222", "must be an integer"),
        ([2, 2], r"one for each of the 3 joints \(1 j1, 2 j2, 3 j3\), got 2"),
        (2**21, "a grid of 9.22e.18 postures exceeds"),
        (None, "must be an integer"),
    ],
)
def test_grids_that_are_none(arm, counts, message):
    with pytest.raises(InputError, match=message):
        Grid.of(arm, counts)


# ---- given -----------------------------------------------------------------------------------


def test_given_postures_are_copied(arm):
    q = np.arange(12.0).reshape(4, 3)
    postures = Listed.of(arm, q)
    q[:] = 0.0
    np.testing.assert_array_equal(postures.block(1, 3), [[3.0, 4.0, 5.0], [6.0, 7.0, 8.0]])


@pytest.mark.parametrize("q", [[[1, 2, 3], [4, 5, 6]], np.arange(1, 7).reshape(3, 2).T])
def test_given_postures_of_any_layout(arm, q):
    postures = Listed.of(arm, q)
    np.testing.assert_array_equal(postures.block(0, 2), np.asarray(q))
    assert postures.block(0, 2).flags.c_contiguous


def test_the_layout_does_not_change_the_identity(arm):
    q = np.random.default_rng(0).normal(size=(5, 3))
    assert Listed.of(arm, np.asfortranarray(q)).identity() == Listed.of(arm, q).identity()


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([1.0, 2.0, 3.0], r"\(k, 3\).*\(1 j1, 2 j2, 3 j3\), got shape \(3,\)"),
        (np.zeros((4, 2)), r"got shape \(4, 2\)"),
        (np.zeros((0, 3)), r"got shape \(0, 3\)"),
        ([[1.0, math.nan, 0.0]], "q"),
        ([[1.0, math.inf, 0.0]], "q"),
        ([["a", "b", "c"]], "q"),
    ],
)
def test_given_postures_that_are_none(arm, q, message):
    with pytest.raises(InputError, match=message):
        Listed.of(arm, q)
