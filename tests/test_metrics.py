"""Margin, manipulability, lost directions, and the verdict with all that its docstring promises."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftforce.core import measures
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, reduce
from ftforce.core.verdict import Verdict, verdict
from helpers import assert_close, campaign, diagonal, jacobians, orthogonal, seeds

TOLERATED, BORDERLINE, NOT_TOLERATED = Verdict


# ---- measures --------------------------------------------------------------------------------


def test_margin_is_the_smallest_singular_value_left_over_the_largest_before():
    assert measures.margin(diagonal(4, 2, 1)) == pytest.approx(0.25)
    assert measures.margin(diagonal(4, 2, 1, locked=[0])) == 0.0
    assert measures.margin(diagonal(0, 0)) == 0.0
    J = np.array([[4.0, 0.0, 1.0], [0.0, 2.0, 0.0]])
    mask = np.array([True, False, False])
    assert measures.margin(reduce(J, mask)) == pytest.approx(1 / math.sqrt(17))


def test_relative_manipulability_is_the_ratio_of_volumes():
    J = np.random.default_rng(2).normal(size=(3, 6))
    mask = np.array([False, True, False, False, True, False])
    K = J[:, ~mask]
    volume = [math.sqrt(np.linalg.det(A @ A.T)) for A in (K, J)]
    assert measures.relative_manipulability(reduce(J, mask)) == pytest.approx(volume[0] / volume[1])


def test_relative_manipulability_at_its_ends():
    J = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    rho = [measures.relative_manipulability(reduce(J, np.arange(3) == k)) for k in range(3)]
    assert rho == pytest.approx([math.sqrt(0.5), math.sqrt(0.5), 0.0])
    assert measures.relative_manipulability(reduce(J, np.zeros(3, dtype=bool))) == 1.0


def test_relative_manipulability_is_undefined_for_a_singular_arm():
    assert math.isnan(measures.relative_manipulability(diagonal(1, 0, locked=[0])))
    assert math.isnan(measures.relative_manipulability(diagonal(1, 1e-7)))
    tall = reduce(np.ones((2, 1)), np.zeros(1, dtype=bool))
    assert math.isnan(measures.relative_manipulability(tall))


def test_condition_number():
    assert measures.condition_number(diagonal(4, 2, 1)) == pytest.approx(4.0)
    assert measures.condition_number(diagonal(4, 2, 1, locked=[2])) == math.inf
    assert measures.condition_number(diagonal(1, 1e-7)) == math.inf


@settings(max_examples=campaign(500))
@given(jacobians(), seeds)
def test_condition_number_is_that_of_numpy(J, seed):
    mask = np.random.default_rng(seed).random(J.shape[1]) < 0.3
    reduced, K = reduce(J, mask), J * ~mask
    ours = measures.condition_number(reduced)
    if reduced.rank_after == reduced.m:
        assert ours == pytest.approx(np.linalg.cond(K), rel=1e-6)
    else:
        assert ours == math.inf


def test_force_error_is_that_of_the_weakest_direction_kept():
    assert measures.force_error(diagonal(4, 0.5)) == pytest.approx(2.0)
    assert measures.force_error(diagonal(4, 0.5, locked=[1])) == pytest.approx(0.25)
    assert measures.force_error(diagonal(4, 1e-7)) == pytest.approx(0.25)
    assert measures.force_error(diagonal(4, 1, locked=[0, 1])) == math.inf


@pytest.mark.parametrize(
    ("n", "m", "f", "bound"),
    [(7, 6, 1, 0.378), (7, 3, 1, 0.756), (5, 3, 2, 0.316), (6, 6, 1, 0.0), (4, 6, 1, 0.0)],
)
def test_bound_of_the_worst_relative_manipulability(n, m, f, bound):
    assert measures.worst_manipulability_bound(n, m, f) == pytest.approx(bound, abs=5e-4)


@pytest.mark.parametrize(("m", "n", "f"), [(1, 3, 1), (1, 4, 2), (2, 3, 1), (3, 4, 1)])
def test_the_bound_can_be_reached(m, n, f):
    # Rows of a regular simplex's symmetry: every set of joints matters as much as any other.
    J = np.ones((1, n)) if m == 1 else np.linalg.svd(np.eye(n) - 1.0 / n)[2][:m]
    rho = [
        measures.relative_manipulability(reduce(J, np.isin(np.arange(n), S)))
        for S in combinations(range(n), f)
    ]
    assert_close(rho, measures.worst_manipulability_bound(n, m, f))


# ---- lost directions -------------------------------------------------------------------------


@pytest.mark.parametrize("locked", [[0], [2], [0, 2], [0, 1, 2]], ids=str)
def test_lost_task_axes_are_named_as_such(locked):
    rows = measures.lost_directions(diagonal(3, 2, 1, locked=locked))
    np.testing.assert_array_equal(rows, np.eye(3)[locked])
    assert not rows.flags.writeable


def test_a_slanting_direction_has_its_largest_component_positive():
    u = np.array([-0.8, 0.6, 0.0])
    others = np.linalg.svd(u[None])[2][1:]
    reduced = reduce(np.vstack([u, others]).T, np.array([True, False, False]))
    assert_close(measures.lost_directions(reduced), [-u])


def test_what_the_healthy_arm_lacks_is_not_lost():
    reduced = diagonal(1, 1, 0, locked=[0])
    assert_close(measures.lost_directions(reduced), [[1, 0, 0]])
    assert measures.lost_directions(diagonal(1, 0, 0, locked=[1])).shape == (0, 3)


@given(seeds, st.integers(2, 6), st.data())
@settings(deadline=None, max_examples=campaign(60, 30))
def test_lost_directions_span_what_the_projectors_say(seed, m, data):
    rank = data.draw(st.integers(1, m))
    kept = data.draw(st.integers(0, rank))
    rng = np.random.default_rng(seed)
    basis = orthogonal(rng, m)
    K = basis[:, :kept] @ rng.normal(size=(kept, kept + 1))
    J = np.hstack([basis[:, :rank] @ rng.normal(size=(rank, rank)), K])
    reduced = reduce(J, np.arange(J.shape[1]) < rank)
    rows = measures.lost_directions(reduced)
    assert rows.shape == (rank - kept, m)
    assert_close(rows @ rows.T, np.eye(rank - kept), tol=1e-7)
    gap = basis[:, :rank] @ basis[:, :rank].T - basis[:, :kept] @ basis[:, :kept].T
    assert_close(rows.T @ rows, gap, scale=1.0, tol=1e-7)
    for row in rows:
        assert row[np.argmax(np.round(np.abs(row), 9))] > 0.0


# ---- verdict ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratio", "expected"),
    [
        (0.5, TOLERATED),
        (1.01e-2, TOLERATED),
        (0.99e-2, BORDERLINE),
        (1e-2, BORDERLINE),
        (1e-4, BORDERLINE),
        (1.01e-6, BORDERLINE),
        (1e-6, NOT_TOLERATED),
        (0.99e-6, NOT_TOLERATED),
        (0.0, NOT_TOLERATED),
    ],
)
def test_all_forces_around_both_tolerances(ratio, expected):
    J = np.array([[1.0, ratio, 0.0], [0.0, 0.0, 1.0]])
    reduced = reduce(J / np.linalg.norm(J, 2), np.array([True, False, False]))
    assert verdict(reduced, None, BORDERLINE_RTOL) is expected
    # A force along that direction alone stands or falls with it, and one square to it does not.
    assert verdict(reduced, np.array([5.0, 0.0]), BORDERLINE_RTOL) is expected
    assert verdict(reduced, np.array([0.0, 5.0]), BORDERLINE_RTOL) is TOLERATED


@pytest.mark.parametrize(
    ("share", "expected"),
    [
        (0.5, NOT_TOLERATED),
        (1.01e-2, NOT_TOLERATED),
        (0.99e-2, BORDERLINE),
        (1e-4, BORDERLINE),
        (1.01e-6, BORDERLINE),
        (0.99e-6, TOLERATED),
        (0.0, TOLERATED),
    ],
)
def test_a_share_of_the_force_along_a_lost_direction(share, expected):
    F = 40.0 * np.array([share, math.sqrt(1.0 - share**2)])
    assert verdict(diagonal(1, 1, locked=[0]), F, BORDERLINE_RTOL) is expected


def test_a_healthy_arm_may_itself_be_borderline():
    assert verdict(diagonal(1, 1e-4), None, BORDERLINE_RTOL) is BORDERLINE
    assert verdict(diagonal(1, 1e-4), np.array([1.0, 1.0]), BORDERLINE_RTOL) is BORDERLINE
    assert verdict(diagonal(1, 1e-4), np.array([1.0, 0.0]), BORDERLINE_RTOL) is TOLERATED


def test_a_direction_that_the_healthy_arm_lacks_is_not_asked_for():
    assert verdict(diagonal(1, 1, 0), None, BORDERLINE_RTOL) is TOLERATED
    assert verdict(diagonal(1, 1, 0, locked=[2]), None, BORDERLINE_RTOL) is TOLERATED
    assert verdict(diagonal(1, 1, locked=[0, 1]), np.zeros(2), BORDERLINE_RTOL) is TOLERATED


@pytest.mark.parametrize("scale", [1e-320, 1e-200, 1e-160, 1e150, 1e200])
def test_the_size_of_a_force_does_not_matter_to_the_verdict(scale):
    for direction in ([1.0, 0.0], [0.0, 1.0], [0.005, 1.0], [1.0, 1.0]):
        F = np.array(direction)
        for reduced in (diagonal(1, 1, locked=[0]), diagonal(1, 1e-4), diagonal(3, 2)):
            expected = verdict(reduced, F, BORDERLINE_RTOL)
            assert verdict(reduced, scale * F, BORDERLINE_RTOL) is expected


@given(jacobians(), seeds)
@settings(deadline=None, max_examples=campaign(60, 30))
def test_shares_are_the_same_numbers_in_every_unit(J, seed):
    """A power of two rounds nothing, so even the last bit is the same; plain norms agree too."""
    rng = np.random.default_rng(seed)
    tau, v, F = (rng.normal(size=size) for size in (J.shape[1], J.shape[1], J.shape[0]))
    one = reduce(J, np.zeros(J.shape[1], dtype=bool))
    shares = measures.velocity_contributions(J, v)
    forces = measures.force_contributions(one, tau, F)
    if np.any(J @ v):
        plain = np.linalg.norm(J * v, axis=0) / np.linalg.norm(J @ v)
        np.testing.assert_array_equal(shares, plain)
    units = np.eye(len(tau))
    columns = [one.healthy.solve_transposed(unit, one.rtol) for unit in units]
    plain = np.linalg.norm(columns, axis=1) * np.abs(tau) / np.linalg.norm(F)
    np.testing.assert_array_equal(forces, plain)
    for power in (-700, 400):
        np.testing.assert_array_equal(
            measures.velocity_contributions(np.ldexp(J, power), v), shares
        )
        np.testing.assert_array_equal(
            measures.force_contributions(one, tau, np.ldexp(F, power)), np.ldexp(forces, -power)
        )


def test_an_answer_may_change_twice():
    # Lost from 1e-4 on is 1e-3 of the force: kept below 1e-4, a jump up to 1e-3, harmless beyond.
    F = np.array([1.0, 1e-3])
    assert verdict(diagonal(1, 1e-4), F, 5e-5) is TOLERATED
    assert verdict(diagonal(1, 1e-4), F, BORDERLINE_RTOL) is BORDERLINE
