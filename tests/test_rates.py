"""Resolved rates: beside NumPy's pseudoinverse, SciPy's bounded least squares, and by hand."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from ftforce.core.resolved_rates import Bounds, damped_inverse, resolved_rates, without_columns
from ftforce.core.svd import Svd
from helpers import assert_close, campaign, jacobians, seeds, with_singular_values

law = settings(deadline=None, max_examples=campaign(150, 50))
J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])


def rates(K, missing, v0=None, bound=np.inf, damped_below=1e-9):
    """Return the velocities, with the same bound for all joints."""
    n = K.shape[1]
    v0 = np.zeros(n) if v0 is None else np.array(v0, dtype=float)
    largest = np.broadcast_to(np.array(bound, dtype=float), n)
    return resolved_rates(Svd(K), np.array(missing), v0, Bounds(-largest, largest), damped_below)


def weights(s, limit):
    """Return what takes the place of 1/σ, from the docstring."""
    squares = np.where(s < limit, (1.0 - (s / limit) ** 2) * (limit / 2.0) ** 2, 0.0)
    return np.divide(s, s * s + squares, out=np.zeros_like(s), where=s > 0.0)


def damped(K, limit):
    """Return the damped inverse as a matrix."""
    left, s, right = np.linalg.svd(K, full_matrices=False)
    return right.T @ np.diag(weights(s, limit)) @ left.T


# ---- the damped inverse ----------------------------------------------------------------------


@given(jacobians(), seeds)
@law
def test_far_from_singular_it_is_the_pseudoinverse(K, seed):
    x = np.random.default_rng(seed).normal(size=len(K))
    s = np.linalg.svd(K, compute_uv=False)
    assume(s[-1] > 1e-4 * s[0] > 0.0)
    assume(K.shape[0] <= K.shape[1])
    assert_close(damped_inverse(Svd(K), x, 0.9 * s[-1]), np.linalg.pinv(K) @ x, tol=1e-7)


@given(jacobians(), seeds, st.sampled_from([1e-6, 1e-2, 0.5, 2.0]))
@law
def test_small_singular_values_are_damped_as_written(K, seed, ratio):
    x = np.random.default_rng(seed).normal(size=len(K))
    limit = ratio * np.linalg.norm(K, 2)
    assume(limit > 0.0)
    wanted = damped(K, limit) @ x
    assert_close(damped_inverse(Svd(K), x, limit), wanted, scale=np.linalg.norm(x) / limit)


@pytest.mark.parametrize("limit", [1e-3, 1.0, 1e3])
def test_the_weight_has_no_step_and_a_largest_value(limit):
    s = limit * np.linspace(0.0, 2.0, 2001)
    one = np.ones(1)
    got = np.array([damped_inverse(Svd(np.array([[x]])), one, limit)[0] for x in s])
    assert_close(got, weights(s, limit))
    assert got[0] == 0.0
    assert got.max() == pytest.approx(2.0 / np.sqrt(3.0) / limit, rel=1e-5)  # at σ = ε/√3
    assert got.max() < 1.16 / limit
    assert np.abs(np.diff(got[900:1100])).max() < 2e-3 / limit
    assert_close(got[1000:], 1.0 / s[1000:])


def test_a_direction_that_is_lost_gives_no_velocity():
    K = np.array([[1.0, 2.0], [0.0, 0.0]])
    assert_close(damped_inverse(Svd(K), np.array([5.0, 7.0]), 1e-2), [1.0, 2.0])
    assert not damped_inverse(Svd(np.zeros((2, 2))), np.ones(2), 0.0).any()
    assert not damped_inverse(Svd(np.zeros((2, 2))), np.ones(2), 1e-2).any()


# ---- without a bound that binds --------------------------------------------------------------

NONE, ALONG = np.zeros(3), np.array([1.0, -1.0, 1.0])  # the self-motion
BY_HAND = [  # missing velocity of the tip, preferred velocities, bounds, velocities
    ([3, 0], NONE, np.inf, [2, 1, -1]),
    ([3, 3], NONE, np.inf, [1, 2, 1]),
    ([3, 0], ALONG, np.inf, np.array([2, 1, -1]) + ALONG),  # the tip does not feel it
    ([3, 0], NONE, [1.5, 9, 9], [1.5, 1.5, -1.5]),  # the others give the share of the first
    ([-3, 0], NONE, [1.5, 9, 9], [-1.5, -1.5, 1.5]),
    ([0, 0], 2 * ALONG, 1.0, ALONG),
    ([5, -7], NONE, 0.0, [0, 0, 0]),
]


@pytest.mark.parametrize(("missing", "v0", "bound", "wanted"), BY_HAND, ids=str)
def test_by_hand(missing, v0, bound, wanted):
    assert_close(rates(J, missing, v0, bound=bound), wanted, scale=3.0)


@given(seeds)
@law
def test_appendix_a_with_numpy(seed):
    """v₀ + K†(ẋ - K v₀): the tip is as fast as it should be, and the change is the smallest."""
    rng = np.random.default_rng(seed)
    m, n = (3, 7) if seed % 2 else (6, 7)
    A, x, v = rng.normal(size=(m, n)), rng.normal(size=m), rng.normal(size=n)
    locked = np.arange(n) == rng.integers(n)
    K, v_H = np.where(locked, 0.0, A), np.where(locked, 0.0, v)
    assume(np.linalg.svd(K, compute_uv=False)[-1] > 1e-3)
    got = rates(K, x - A @ v_H, v_H)
    assert_close(got, v_H + np.linalg.pinv(K) @ (x - K @ v_H), tol=1e-8)
    assert not got[locked].any()
    assert_close(A @ got, x, scale=np.linalg.norm(x) + np.linalg.norm(v), tol=1e-8)
    change = got - v_H
    assert_close(np.linalg.pinv(K) @ (K @ change), change, tol=1e-8)  # no part in the null space


# ---- bounds ----------------------------------------------------------------------------------


def test_what_no_joint_can_give_is_lost():
    got = rates(J, [3.0, 0.0], bound=1.0)
    assert np.abs(got).max() <= 1.0 + 1e-12
    assert_close(got[[0, 1]], [1.0, 1.0])


def test_joints_that_cannot_be_commanded_keep_their_velocity():
    K = without_columns(J, np.array([False, True, False])).A
    assert_close(K, [[1, 0, 0], [0, 0, 1]])
    assert J[0, 1] == 1.0  # the caller's own stays
    got = rates(K, [5.0, 0.5], [0.0, 9.0, 0.0], bound=1.0)
    assert_close(got, [1.0, 9.0, 0.5])


def test_one_sided_bounds():
    """A joint beyond its limit has to return, however the tip should move."""
    lower, upper = np.array([0.5, -9.0, -9.0]), np.array([2.0, 9.0, 9.0])
    got = resolved_rates(Svd(J), np.zeros(2), np.zeros(3), Bounds(lower, upper), 1e-9)
    assert_close(got, [0.5, -0.5, 0.5])


@given(seeds)
@law
def test_bounds_come_first_and_the_tip_second(seed):
    rng = np.random.default_rng(seed)
    m, n = int(rng.integers(1, 4)), int(rng.integers(4, 9))
    K = with_singular_values(rng, m, n, rng.uniform(0.3, 1.0, size=m))
    x, v0 = rng.normal(size=m), 0.2 * rng.normal(size=n)
    upper, lower = rng.uniform(0.2, 1.0, size=n), -rng.uniform(0.2, 1.0, size=n)
    v = resolved_rates(Svd(K), x - K @ v0, v0, Bounds(lower, upper), 0.1)
    assert (v <= upper + 1e-9).all()
    assert (v >= lower - 1e-9).all()
    free = v0 + np.linalg.pinv(K) @ (x - K @ v0)
    if (free <= upper).all() and (free >= lower).all():
        assert_close(v, free, tol=1e-8)
        return
    at_bound = (np.abs(v - upper) < 1e-9) | (np.abs(v - lower) < 1e-9)
    assert at_bound.any()
    # The others give what is left, as well as they can.
    kept = np.where(at_bound, v, v0)
    rest = damped(np.where(at_bound, 0.0, K), 0.1) @ (x - K @ kept)
    assert_close(v, kept + rest, scale=10.0, tol=1e-7)


def test_the_tip_mostly_gets_its_velocity_where_a_linear_program_says_that_it_can():
    rng, kept, possible = np.random.default_rng(1), 0, 0
    for _ in range(100):
        K, x, bound = rng.normal(size=(3, 7)), rng.normal(size=3), 0.4
        plan = linprog(np.zeros(7), A_eq=K, b_eq=x, bounds=[(-bound, bound)] * 7)
        got = K @ rates(K, x, bound=bound)
        exact = np.linalg.norm(got - x) < 1e-9
        assert not (exact and plan.status == 2)  # impossible
        possible += plan.status == 0
        kept += exact
    assert possible > 50
    assert kept > 0.9 * possible
