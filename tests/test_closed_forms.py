"""Torque remap, force jump and velocity remap on small arms that can be worked out by hand."""

import copy
import math
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from ftforce import remap
from ftforce.closed_forms import (
    dynamically_exerted_force,
    exerted_force,
    force_jump,
    supported_force,
    velocity_after_impact,
    velocity_remap,
)
from ftforce.errors import DimensionError, InputError
from ftforce.reduced import reduce
from helpers import assert_close, diagonal

# Two planar directions; joint 2 serves both, so it alone can be replaced.
J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
F = np.array([10.0, 5.0])


def locking(*joints, n=3):
    return np.isin(np.arange(1, n + 1), joints)


# ---- torques and force -----------------------------------------------------------------------


def test_torques_stay_and_the_locked_one_goes_to_zero():
    result = remap(J, J.T @ F, locking(2))
    assert_close(result.tau, [10, 15, 5])
    assert_close(result.U, [10, 0, 5])
    assert_close(result.F, F)
    assert_close(result.F_after, F)
    assert result.jump.tolist() == [0.0, 0.0]
    assert result.jump_norm == 0.0


def test_two_locked_joints_lose_the_direction_they_alone_serve():
    result = remap(J, J.T @ F, locking(1, 2))  # only (0, 1) is left
    assert_close(result.F_after, [0, 5])
    assert_close(result.jump, [10, 0])
    assert result.jump_norm == pytest.approx(10.0)
    assert_close(result.U, [0, 0, 5])


def test_the_least_jump_is_the_shortest_way_to_what_is_left():
    result = remap(J, J.T @ F, locking(1, 3))  # only (1, 1) is left
    assert_close(result.F_after, [7.5, 7.5])
    assert_close(result.jump, [2.5, -2.5])
    assert_close(result.U, [0, 15, 0])


def test_a_self_motion_torque_exerts_nothing_and_is_told_apart():
    moving = np.array([1.0, -1.0, 1.0])  # J moving = 0
    result = remap(J, J.T @ F + 3.0 * moving, locking(2))
    assert_close(result.self_motion, 3.0 * moving)
    assert_close(result.F, F)
    assert_close(result.U, [10, 0, 5])  # U is J_Hᵀ F̂: the useless part is not commanded on


def test_brakes_carry_what_the_locked_joints_did_for_the_force_that_is_left():
    assert_close(remap(J, J.T @ F, locking(2)).brake_load, [0, 15, 0])
    assert_close(remap(J, J.T @ F, locking(1, 2)).brake_load, [0, 5, 0])
    assert_close(remap(J, J.T @ F, locking(1, 3)).brake_load, [7.5, 0, 7.5])


def test_nothing_locked_and_everything_locked():
    healthy, dead = remap(J, J.T @ F, locking()), remap(J, J.T @ F, locking(1, 2, 3))
    assert_close(healthy.U, healthy.tau)
    assert healthy.jump_norm == 0.0
    assert_close(dead.U, 0.0)
    assert_close(dead.F_after, 0.0, scale=10)
    assert_close(dead.jump, F)


def test_a_direction_that_even_the_healthy_arm_lacks_is_no_jump():
    flat = np.array([[1.0, 1.0], [0.0, 0.0]])
    result = remap(flat, [4.0, 4.0], locking(1, n=2))
    assert_close(result.F, [4, 0])
    assert result.jump_norm == pytest.approx(0.0)
    assert_close(result.U, [0, 4])


@pytest.mark.parametrize(
    ("strength", "kept"), [(1.01e-6, True), (1e-6, False), (0.99e-6, False), (0.0, False)]
)
def test_torques_exert_no_force_along_a_direction_at_the_tolerance(strength, kept):
    reduced = diagonal(1.0, strength)
    force = exerted_force(reduced, np.array([2.0, strength]))
    assert_close(force, [2.0, 1.0 if kept else 0.0])
    assert_close(supported_force(reduced, np.array([2.0, 1.0])), force)


def test_tolerance_of_a_jump_is_that_of_the_healthy_arm():
    # Joint 1 locks; what is left is 1e-7 of the healthy arm, though well conditioned in itself.
    reduced = reduce(np.array([[1.0, 1e-7, 0.0], [0.0, 0.0, 1.0]]), locking(1))
    assert_close(force_jump(reduced, F).jump, [10, 0])
    close = reduce(np.array([[1.0, 1e-5, 0.0], [0.0, 0.0, 1.0]]), locking(1))
    assert force_jump(close, F).jump_norm == 0.0


def test_rtol_moves_the_decision():
    lean = np.array([[1.0, 1e-4, 0.0], [0.0, 0.0, 1.0]])
    tau = lean.T @ F
    assert remap(lean, tau, locking(1)).jump_norm == 0.0
    assert remap(lean, tau, locking(1), rtol=1e-3).jump_norm == pytest.approx(10.0)
    assert remap(lean, tau, locking(1), rtol=0.5).reduced.rtol == 0.5


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (2, 1), (6, 7), (7, 9)])
def test_every_shape(shape):
    rng = np.random.default_rng(1)
    A, force = rng.normal(size=shape), rng.normal(size=shape[0])
    mask = np.arange(shape[1]) == 0
    result = remap(A, A.T @ force, mask)
    K = A * ~mask
    assert_close(result.F, A @ np.linalg.pinv(A) @ force)
    assert_close(result.F_after, K @ np.linalg.pinv(K) @ result.F, scale=np.linalg.norm(force))
    assert result.jump.shape == result.F.shape == (shape[0],)
    assert result.U.shape == (shape[1],)


def test_a_decomposition_answers_also_after_the_next_one():
    rng = np.random.default_rng(3)
    first, second = rng.normal(size=(2, 3, 6))
    tau, mask = rng.normal(size=6), np.zeros(6, dtype=bool)
    one, other = reduce(first, mask), reduce(second, mask)
    for reduced in (one, other, one, other):
        assert_close(exerted_force(reduced, tau), np.linalg.pinv(reduced.J.T) @ tau)


def test_a_jacobian_of_zeros():
    result = remap(np.zeros((2, 3)), [1, 2, 3], locking(2))
    assert_close(result.F, 0.0)
    assert_close(result.U, 0.0)
    assert_close(result.self_motion, [1, 2, 3])
    assert result.is_proved()


def test_no_torque_no_jump():
    result = remap(J, [0, 0, 0], locking(1, 2))
    assert result.jump_norm == 0.0
    assert result.is_proved()


# ---- what comes from outside -----------------------------------------------------------------


def test_lists_are_taken():
    result = remap([[1, 1, 0], [0, 1, 1]], (10, 15, 5), [False, True, False])
    assert_close(result.U, [10, 0, 5])


@pytest.mark.parametrize(
    ("tau", "error", "message"),
    [
        ([1, 2], DimensionError, "tau needs 3 numbers, got 2 numbers: one torque per column of J"),
        ([1, np.nan, 0], InputError, "tau holds nan at position 2"),
        ("abc", InputError, "tau needs numbers"),
        (None, InputError, "tau"),
    ],
)
def test_malformed_torques(tau, error, message):
    with pytest.raises(error, match=message):
        remap(J, tau, locking(1))


@pytest.mark.parametrize("locked", [[0, 1, 0], [2], "2", [1.0, 0.0, 0.0]])
def test_joint_numbers_are_no_mask(locked):
    with pytest.raises(InputError, match=r"boolean mask of shape \(3,\).*got .*for analyze\(\)"):
        remap(J, [1, 2, 3], locked)


@pytest.mark.parametrize("rtol", [0.0, 1.0, -1e-3, np.nan, 1e-15])
def test_rtol_out_of_range(rtol):
    with pytest.raises(InputError, match="rtol must lie between 1e-14 and 1"):
        remap(J, [1, 2, 3], locking(1), rtol=rtol)


def test_arguments_are_left_alone():
    given, tau, mask = J.copy(), J.T @ F, locking(1)
    remap(given, tau, mask)
    np.testing.assert_array_equal(given, J)
    np.testing.assert_array_equal(tau, J.T @ F)
    assert given.flags.writeable
    assert tau.flags.writeable


def test_a_result_does_not_change_with_its_arguments():
    given, tau, mask = J.copy(), J.T @ F, locking(1, 2)
    result = remap(given, tau, mask)
    load, motion = result.brake_load, result.self_motion
    given[:], tau[:], mask[:] = 7.0, 7.0, False
    assert_close(result.tau, [10, 15, 5])
    assert_close(result.brake_load, load)
    assert_close(result.self_motion, motion, scale=15)


# ---- results ---------------------------------------------------------------------------------


@pytest.fixture
def result():
    return remap(J, J.T @ F + [3, -3, 3], locking(1, 3))


def test_results_are_frozen_and_read_only(result):
    for field in fields(result):
        with pytest.raises(AttributeError):
            setattr(result, field.name, None)
        if field.name != "reduced":
            assert not getattr(result, field.name).flags.writeable, field.name


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
)
def test_results_can_be_copied_and_pickled(result, duplicate):
    again = duplicate(result)
    for name in ("tau", "U", "F", "F_after", "jump", "self_motion", "brake_load"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    assert again.residuals().keys() == result.residuals().keys()
    assert again.is_proved()


def test_residuals_of_a_good_result_are_rounding(result):
    laws = result.residuals()
    assert {"orthogonality", "uncommandable", "statics", "self_motion"} <= set(laws)
    assert_close(list(laws.values()), 0.0, tol=1e-14)
    assert result.is_proved(1e-14)


@pytest.mark.parametrize("name", ["tau", "U", "F", "F_after", "jump"])
@pytest.mark.parametrize(
    "tamper",
    [lambda x: 1.01 * x, lambda x: x + 0.01, lambda x: -x],
    ids=["scaled", "moved", "sign"],
)
def test_a_tampered_result_cannot_prove_itself(result, name, tamper):
    assert not replace(result, **{name: tamper(getattr(result, name))}).is_proved()


def test_another_force_is_no_force_of_these_torques(result):
    assert not replace(result, tau=result.tau + J.T @ [0.1, 0.0]).is_proved()


def test_a_jump_that_is_not_the_least_is_found(result):
    # Every other law holds: no healthy joint feels a force along what is lost.
    more = np.array([1.0, -1.0])
    larger = replace(result, F_after=result.F_after + more, jump=result.jump - more)
    assert not larger.is_proved()


def test_residuals_are_relative():
    for scale in (1e-6, 1.0, 1e6):
        good = remap(J, scale * (J.T @ F), locking(1, 3))
        assert good.is_proved()
        assert not replace(good, U=1.001 * good.U).is_proved()


def test_the_tolerance_of_a_proof_counts(result):
    almost = replace(result, U=result.U * (1.0 + 1e-4))
    assert almost.is_proved(1e-3)
    assert not almost.is_proved(1e-7)


def test_what_rtol_gave_away_is_forgiven():
    lean = np.array([[1.0, 5e-4, 0.0], [0.0, 0.0, 1.0]])
    result = remap(lean, lean.T @ F, locking(1), rtol=1e-3)
    assert max(result.residuals().values()) > 1e-4
    assert result.is_proved()


# ---- velocities ------------------------------------------------------------------------------


def test_healthy_joints_take_over_the_velocity():
    change = velocity_remap(reduce(J, locking(2)), np.array([1.0, 2.0, 3.0]))
    assert_close(change.tip_before, [3, 5])
    assert_close(change.after, [3, 0, 5])
    assert_close(change.tip_after, [3, 5])
    assert_close(change.jump, 0.0)


def test_what_no_joint_can_take_over_is_the_jump():
    change = velocity_remap(reduce(J, locking(1, 2)), np.array([1.0, 2.0, 3.0]))
    assert_close(change.after, [0, 0, 5])
    assert_close(change.tip_after, [0, 5])
    assert_close(change.jump, [-3, 0])


def test_the_change_of_velocities_is_the_shortest():
    twins = np.array([[1.0, 1.0, 1.0]])
    change = velocity_remap(reduce(twins, locking(1)), np.array([2.0, 0.5, -0.5]))
    assert_close(change.after, [0, 1.5, 0.5])


def test_velocities_with_nothing_and_with_everything_locked():
    v = np.array([1.0, 2.0, 3.0])
    healthy, dead = (velocity_remap(reduce(J, locking(*s)), v) for s in ((), (1, 2, 3)))
    assert_close(healthy.after, v)
    assert_close(healthy.jump, 0.0)
    assert_close(dead.after, 0.0)
    assert_close(dead.jump, [-3, -5])
    assert_close(dead.tip_after, 0.0, scale=5)


def test_a_locked_joint_at_rest_changes_nothing():
    change = velocity_remap(reduce(J, locking(1)), np.array([0.0, 2.0, -1.0]))
    assert_close(change.after, [0, 2, -1])
    assert_close(change.jump, 0.0)


def test_velocities_are_not_sent_into_directions_at_the_tolerance():
    lean = np.array([[1.0, 1e-7, 0.0], [0.0, 0.0, 1.0]])
    change = velocity_remap(reduce(lean, locking(1)), np.array([1.0, 0.0, 0.0]))
    assert_close(change.after, 0.0)  # not 1e7 rad/s
    assert_close(change.jump, [-1, 0])


def test_velocity_changes_are_read_only():
    change = velocity_remap(reduce(J, locking(1)), np.array([1.0, 2.0, 3.0]))
    for name in ("after", "tip_before", "tip_after", "jump"):
        assert not getattr(change, name).flags.writeable, name


def test_norm_of_a_jump_in_the_unit_of_the_force():
    three_four = force_jump(diagonal(1, 1, 1, locked=[0, 1]), np.array([3.0, 4.0, 7.0]))
    assert three_four.jump_norm == 5.0
    assert math.isclose(remap(J, J.T @ F, locking(1, 3)).jump_norm, 2.5 * math.sqrt(2))


# ---- velocities with joints that swing freely ------------------------------------------------


def freeing(J, *joints, locked=()):
    """Return the reduced Jacobian with free joints, numbered from 1."""
    n = J.shape[1]
    return reduce(J, locking(*locked, n=n), swinging=locking(*joints, n=n))


def test_a_joint_that_swings_goes_on_as_it_moves():
    v = np.array([1.0, 2.0, 3.0])
    change = velocity_remap(freeing(J, 2), v)
    assert_close(change.after, v)  # nothing is locked: nothing has to be made up for
    assert_close(change.jump, [0, 0], scale=1.0)
    assert_close(change.tip_after, [3, 5])


def test_a_joint_that_swings_makes_up_for_nothing():
    v = np.array([1.0, 2.0, 3.0])
    change = velocity_remap(freeing(J, 2, locked=(1,)), v)  # joint 3 alone has a motor
    assert_close(change.after, [0, 2, 3])
    assert_close(change.jump, [-1, 0])
    assert_close(change.tip_after, [2, 5])
    with_motor = velocity_remap(reduce(J, locking(1)), v)
    assert_close(with_motor.after, [0, 3, 2])
    assert_close(with_motor.jump, [0, 0], scale=1.0)


def test_velocities_with_swinging_and_locked_joints_by_pseudo_inverses():
    rng = np.random.default_rng(2)
    for _ in range(50):
        m, n = rng.integers(1, 5), rng.integers(2, 9)
        A, v = rng.normal(size=(m, n)), rng.normal(size=n)
        state = rng.choice(3, size=n)
        locked, free = state == 1, state == 2
        change = velocity_remap(reduce(A, locked, swinging=free), v)
        K = np.where(
            locked | free, 0.0, A
        )  # the columns themselves: a motor moves, it need not hold
        x_S = A[:, locked] @ v[locked]
        moved = np.linalg.pinv(K) @ x_S
        assert_close(change.after, np.where(locked, 0.0, v) + moved, scale=1.0, tol=1e-8)
        assert_close(change.after[free], v[free], scale=1.0, tol=1e-15)
        assert_close(change.jump, K @ moved - x_S, scale=1.0)
        assert_close(change.tip_after, A @ change.after, scale=10.0)
        np.testing.assert_array_equal(change.after[locked], 0.0)


# ---- at impact -------------------------------------------------------------------------------


def inertia(rng, n, spread=1.0):
    """Draw a mass matrix with eigenvalues over some decades."""
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    return Q * 10.0 ** rng.uniform(-spread, spread, size=n) @ Q.T


def test_two_joints_at_impact_by_hand():
    # The first joint stops; its momentum drives the second on.
    M = np.array([[3.0, 1.0], [1.0, 2.0]])
    after = velocity_after_impact(M, locking(1, n=2), np.array([4.0, 1.0]))
    assert_close(after, [0, 3])  # 1 + 1/2 · 4
    assert_close(velocity_after_impact(M, locking(2, n=2), np.array([4.0, 3.0])), [5, 0])


def test_nothing_locked_changes_no_velocity_and_everything_locked_stops():
    rng = np.random.default_rng(0)
    M, v = inertia(rng, 3), rng.normal(size=3)
    unchanged = velocity_after_impact(M, locking(), v)
    np.testing.assert_array_equal(unchanged, v)
    assert unchanged is not v  # nor is the argument handed out
    np.testing.assert_array_equal(velocity_after_impact(M, locking(1, 2, 3), v), np.zeros(3))


def test_an_impact_keeps_the_momentum_of_sound_joints_and_takes_energy():
    rng = np.random.default_rng(1)
    for _ in range(200):
        n = int(rng.integers(1, 9))
        M, v, locked = inertia(rng, n), rng.normal(size=n), rng.random(n) < 0.4
        before, mask = v.copy(), locked.copy()
        after = velocity_after_impact(M, locked, v)
        np.testing.assert_array_equal(v, before)
        np.testing.assert_array_equal(locked, mask)
        np.testing.assert_array_equal(after[locked], 0.0)
        assert_close((M @ (after - v))[~locked], np.zeros(n)[~locked], scale=10.0 * n)
        lost = 0.5 * (v @ M @ v - after @ M @ after)
        assert lost >= -1e-10 * (v @ M @ v)
        # Carnot: what is lost is the energy of the velocities that are lost.
        assert_close(lost, 0.5 * (v - after) @ M @ (v - after), scale=v @ M @ v + 1e-300)
        if not v[locked].any():
            np.testing.assert_array_equal(after, v)


def test_a_locked_joint_at_rest_is_no_impact():
    M = inertia(np.random.default_rng(2), 3)
    v = np.array([1.0, 0.0, -2.0])
    np.testing.assert_array_equal(velocity_after_impact(M, locking(2), v), v)


def test_velocities_after_an_impact_are_proportional_to_those_before():
    rng = np.random.default_rng(3)
    M, v, w = inertia(rng, 5), *rng.normal(size=(2, 5))
    one, other, both = (velocity_after_impact(M, locking(2, 4, n=5), x) for x in (v, w, v + 2 * w))
    assert_close(both, one + 2 * other)
    assert_close(velocity_after_impact(1e-6 * M, locking(2, 4, n=5), v), one)


# ---- the dynamically consistent inverse ------------------------------------------------------


def weighted_inverse(A, M):
    """Return the inverse of Aᵀ that is shortest in the metric of M⁻¹, by its definition."""
    L = np.linalg.cholesky(np.linalg.inv(M))
    return np.linalg.pinv(L.T @ A.T, rcond=1e-10) @ L.T


def test_a_dynamically_exerted_force_by_hand():
    # One direction, two joints: the lighter one decides more.
    pair = reduce(np.array([[1.0, 1.0]]), locking(n=2))
    M = np.diag([1.0, 3.0])
    assert_close(dynamically_exerted_force(pair, np.array([4.0, 0.0]), M), [3])
    assert_close(dynamically_exerted_force(pair, np.array([0.0, 4.0]), M), [1])
    assert_close(exerted_force(pair, np.array([4.0, 0.0])), [2])


def test_dynamically_exerted_forces_in_the_metric_of_the_mass():
    rng = np.random.default_rng(4)
    for _ in range(200):
        m, n = int(rng.integers(1, 7)), int(rng.integers(1, 9))
        A, M, tau = rng.normal(size=(m, n)), inertia(rng, n), rng.normal(size=n)
        if rng.random() < 0.5:
            rank = int(rng.integers(0, min(m, n) + 1))
            A = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        reduced = reduce(A, np.zeros(n, dtype=bool))
        F = dynamically_exerted_force(reduced, tau, M)
        wanted = weighted_inverse(A, M) @ tau
        assert_close(F, wanted, scale=np.abs(wanted).max() or 1.0, tol=1e-7)
        assert F.shape == (m,)
        # What is left of the torques does not accelerate the tip.
        over_M = np.linalg.solve(M, tau - A.T @ F)
        size = np.abs(A).max() * np.abs(np.linalg.solve(M, tau)).max() or 1.0
        assert_close(A @ over_M, np.zeros(m), scale=size, tol=1e-7)


def test_both_inverses_agree_on_torques_of_a_force():
    rng = np.random.default_rng(5)
    for _ in range(100):
        m, n = int(rng.integers(1, 7)), int(rng.integers(1, 9))
        rank = int(rng.integers(0, min(m, n) + 1))
        A = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        reduced, F = reduce(A, np.zeros(n, dtype=bool)), rng.normal(size=m)
        dynamic = dynamically_exerted_force(reduced, A.T @ F, inertia(rng, n))
        assert_close(dynamic, exerted_force(reduced, A.T @ F), scale=1.0, tol=1e-7)
        assert_close(dynamic, supported_force(reduced, F), scale=1.0, tol=1e-7)


def test_both_inverses_agree_on_equal_masses_and_without_redundancy():
    rng = np.random.default_rng(6)
    A, tau = rng.normal(size=(3, 6)), rng.normal(size=6)
    wide, square = reduce(A, locking(n=6)), reduce(A[:, :3], locking())
    assert_close(dynamically_exerted_force(wide, tau, 2.5 * np.eye(6)), exerted_force(wide, tau))
    dynamic = dynamically_exerted_force(square, tau[:3], inertia(rng, 3))
    assert_close(dynamic, exerted_force(square, tau[:3]))


def test_no_direction_no_dynamic_force():
    nothing = reduce(np.zeros((2, 3)), locking())
    assert_close(dynamically_exerted_force(nothing, np.ones(3), np.eye(3)), [0, 0])
    lean = reduce(np.array([[1.0, 0.0], [0.0, 1e-7]]), locking(n=2))  # rtol gives the second away
    assert_close(dynamically_exerted_force(lean, np.array([2.0, 1.0]), np.eye(2)), [2, 0])
