"""The reduced Jacobian: columns of locked joints vanish, ranks are judged by the healthy arm."""

import numpy as np
import pytest

from ftforce.core.reduced_jacobian import (
    BORDERLINE_RTOL,
    RTOL,
    check_core_input,
    check_mask,
    check_tolerances,
    reduce,
    reduce_decomposed,
)
from ftforce.core.svd import Svd
from ftforce.errors import DimensionError, InputError
from helpers import assert_close, diagonal

J = np.random.default_rng(5).normal(size=(3, 6))
MASK = np.array([False, True, False, False, True, False])


@pytest.mark.parametrize(
    ("mask", "rank_after"), [(MASK, 3), (np.zeros(6, bool), 3), (np.ones(6, bool), 0)]
)
def test_columns_of_locked_joints_are_zero(mask, rank_after):
    before = J.copy()
    reduced = reduce(J, mask)
    np.testing.assert_array_equal(reduced.K, np.where(mask, 0.0, J))
    np.testing.assert_array_equal(J, before)
    assert (reduced.m, reduced.n, reduced.rtol) == (3, 6, RTOL)
    assert (reduced.rank, reduced.rank_after) == (3, rank_after)
    assert reduced.sigma_max == pytest.approx(np.linalg.norm(J, 2))
    assert reduced.locked is mask


def test_a_decomposition_serves_many_fault_sets():
    healthy = Svd(J)
    for mask in np.eye(6, dtype=bool):
        for free in (None, mask):
            locked = mask if free is None else MASK & ~mask
            one = reduce_decomposed(healthy, locked, RTOL, free)
            other = reduce(J, locked, free=free)
            assert one.healthy is healthy
            assert one.damaged.s == other.damaged.s
            assert (one.rank, one.rank_after) == (other.rank, other.rank_after)
    np.testing.assert_array_equal(healthy.A, J)


def test_dropping_the_columns_gives_the_same_range_and_singular_values():
    reduced, dropped = reduce(J, MASK), J[:, ~MASK]
    assert_close(reduced.damaged.s, np.linalg.svd(dropped, compute_uv=False))
    projector = dropped @ np.linalg.pinv(dropped)
    for unit in np.eye(3):
        assert_close(reduced.damaged.project(unit, reduced.rank_after), projector @ unit)


@pytest.mark.parametrize(
    ("smallest", "rank"), [(1.001e-6, 2), (1e-6, 1), (0.999e-6, 1), (0.0, 1), (1e-3, 2)]
)
def test_a_singular_value_at_the_tolerance_is_lost(smallest, rank):
    assert diagonal(1.0, smallest).rank == rank
    assert diagonal(8.0, 8.0 * smallest).rank == rank


def test_the_healthy_arm_is_the_scale_of_both_ranks():
    # What is left is small beside the lost joint, though well conditioned in itself.
    reduced = diagonal(1.0, 1e-7, 1e-7, locked=[0])
    assert (reduced.rank, reduced.rank_after) == (1, 0)
    assert diagonal(1.0, 1e-5, 1e-5, locked=[0]).rank_after == 2


# ---- joints without torque -------------------------------------------------------------------

FREE_JOINT = np.array([False, False, True, False, False, False])


def test_columns_of_swinging_joints_are_projected_out():
    reduced = reduce(J, MASK, free=FREE_JOINT)
    column = J[:, [2]]
    beside = np.eye(3) - column @ np.linalg.pinv(column)
    wanted = np.where(MASK | FREE_JOINT, 0.0, beside @ J)
    assert_close(reduced.K, wanted)
    assert_close(column.T @ reduced.K, np.zeros((1, 6)), scale=1.0, tol=1e-14)
    np.testing.assert_array_equal(reduced.K[:, MASK | FREE_JOINT], 0.0)
    np.testing.assert_array_equal(reduced.J, J)
    assert (reduced.rank, reduced.rank_after) == (3, 2)
    assert reduced.free.joints == [2]
    np.testing.assert_array_equal(reduced.commanding, ~(MASK | FREE_JOINT))
    assert_close(reduced.damaged.s, np.linalg.svd(wanted, compute_uv=False), tol=1e-12)
    assert reduced.locked is MASK


def test_the_smallest_force_that_balances_swinging_joints():
    rng = np.random.default_rng(7)
    for joints in ([1], [0, 3], [0, 3, 5], [0, 1, 2, 3, 4]):
        mask = np.isin(np.arange(6), joints)
        free = reduce(J, np.zeros(6, dtype=bool), free=mask).free
        rnea = rng.normal(size=6)
        force, left = free.support(rnea[mask]), free.without_lever(rnea[mask], 1e-6)
        assert_close(force, -np.linalg.pinv(J[:, mask].T) @ rnea[mask], scale=1.0, tol=1e-12)
        assert_close(J[:, mask].T @ force + rnea[mask], left, scale=1.0, tol=1e-12)
        if len(joints) <= 3:
            assert_close(left, np.zeros(len(joints)), scale=1.0, tol=1e-12)
        else:  # more joints than directions of force
            assert np.linalg.norm(left) > 0.1
            assert_close(J[:, mask] @ left, np.zeros(3), scale=1.0, tol=1e-12)


@pytest.mark.parametrize(
    ("strength", "rank"), [(1.01e-6, 1), (1e-6, 0), (0.99e-6, 0), (0.0, 0), (1e-3, 1)]
)
def test_a_swinging_column_at_the_tolerance_counts_as_zero(strength, rank):
    lean = np.array([[1.0, 0.0], [0.0, strength]])
    reduced = reduce(lean, np.array([False, False]), free=np.array([False, True]))
    assert reduced.free.rank == rank
    torque = np.array([3.0])
    if rank:
        assert_close(reduced.free.support(torque), [0, -3 / strength])
        assert_close(reduced.free.without_lever(torque, 1e-6), [0], scale=1.0)
    else:
        assert_close(reduced.free.support(torque), [0, 0])
        assert_close(reduced.free.without_lever(torque, 1e-6), [3])


def test_parallel_swinging_columns_share_what_they_carry():
    twins = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mask = np.array([True, True, False])
    free = reduce(twins, np.zeros(3, dtype=bool), free=mask).free
    assert free.rank == 1
    assert_close(free.support(np.array([2.0, 4.0])), [-3, 0])
    assert_close(free.without_lever(np.array([2.0, 4.0]), 1e-6), [-1, 1])


# ---- what comes from outside -----------------------------------------------------------------


def test_a_mask_is_named():
    mask = check_mask([True, False], 2, "free")
    assert mask.tolist() == [True, False]
    assert not mask.flags.writeable
    with pytest.raises(
        InputError, match=r"^free must be a boolean mask of shape \(2,\), .*got '1'"
    ):
        check_mask("1", 2, "free")
    with pytest.raises(
        DimensionError, match=r"^free needs 3 numbers, got 2 numbers: one entry per"
    ):
        check_mask([True, False], 3, "free")


@pytest.mark.parametrize(
    "given", [3.0, [1.0, 2.0], np.ones((2, 2, 2)), np.ones((3, 0)), np.ones((0, 3)), []]
)
def test_a_jacobian_is_a_matrix(given):
    with pytest.raises(InputError, match=r"J must have the shape \(m, n\), got \("):
        check_core_input(given, [True])


def test_a_jacobian_is_made_of_finite_numbers():
    checked, mask = check_core_input([[1, 2], [3, 4]], [True, False])
    assert (checked.dtype, mask.dtype) == (np.float64, np.bool_)
    given = J.copy()
    given[1, 3] = -np.inf
    with pytest.raises(InputError, match="J contains -inf at position 2, 4"):
        check_core_input(given, MASK)
    for words in ([["a", "b"]], [[1j, 2]]):
        with pytest.raises(InputError, match="J needs numbers"):
            check_core_input(words, [True, False])


@pytest.mark.parametrize("given", [[0, 1, 0, 0, 1, 0], [2, 5], "2,5", None, 2, [1.0] * 6, [None]])
def test_a_mask_is_boolean(given):
    with pytest.raises(InputError, match=r"boolean mask of shape \(6,\).*; analyze\(\)"):
        check_core_input(J, given)


@pytest.mark.parametrize("given", [[True], [True] * 7, np.ones((6, 1), dtype=bool)])
def test_a_mask_has_one_entry_per_joint(given):
    with pytest.raises(DimensionError, match=r"locked needs 6 numbers.*one entry per column"):
        check_core_input(J, given)


@pytest.mark.parametrize("rtol", [1e-14, 1e-6, BORDERLINE_RTOL, 0.5])
def test_tolerances_in_range(rtol):
    check_tolerances(rtol, max(rtol, BORDERLINE_RTOL))
    check_tolerances(rtol, 0.999)


@pytest.mark.parametrize("rtol", [0.0, -1e-6, 9e-15, 1.0, np.nan, np.inf])
def test_rank_tolerances_out_of_range(rtol):
    with pytest.raises(InputError, match="rtol must lie between 1e-14 and 1, got"):
        check_tolerances(rtol, 0.999)


@pytest.mark.parametrize("wary", [0.9e-3, 0.0, -1.0, 1.0, np.nan, np.inf])
def test_wary_tolerances_out_of_range(wary):
    with pytest.raises(InputError, match=r"wary must lie between rtol = 0\.001 and 1, got"):
        check_tolerances(1e-3, wary)
