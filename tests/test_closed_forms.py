"""Torque remap, force jump and velocity remap on small arms that can be worked out by hand."""

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from ftforce import remap
from ftforce.core.reduced_jacobian import reduce
from ftforce.core.remap import (
    dynamically_exerted_force,
    exerted_force,
    force_jump,
    supported_force,
    velocity_after_impact,
    velocity_remap,
)
from ftforce.errors import InputError
from helpers import assert_close, diagonal, only

# Two planar directions; joint 2 serves both, so it alone can be replaced.
J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
F = np.array([10.0, 5.0])


# ---- torques and force -----------------------------------------------------------------------

BY_HAND = {  # locked joints: force after, jump, torques, brake loads
    (): ([10, 5], [0, 0], [10, 15, 5], [0, 0, 0]),
    (2,): ([10, 5], [0, 0], [10, 0, 5], [0, 15, 0]),
    (1, 2): ([0, 5], [10, 0], [0, 0, 5], [0, 5, 0]),  # only (0, 1) is left
    (1, 3): ([7.5, 7.5], [2.5, -2.5], [0, 15, 0], [7.5, 0, 7.5]),  # only (1, 1) is left
    (1, 2, 3): ([0, 0], [10, 5], [0, 0, 0], [0, 0, 0]),
}


@pytest.mark.parametrize(("locked", "wanted"), BY_HAND.items(), ids=str)
def test_force_and_torques_by_hand(locked, wanted):
    result = remap(J, J.T @ F, only(*locked))
    assert_close(result.tau, [10, 15, 5])
    assert_close(result.F, F)
    found = (result.F_after, result.jump, result.U, result.brake_load)
    for got, expected in zip(found, wanted, strict=True):
        assert_close(got, expected, scale=15.0)
    assert result.jump_norm == pytest.approx(np.linalg.norm(wanted[1]))
    if locked in {(), (2,)}:
        assert result.jump.tolist() == [0.0, 0.0]  # exactly


def test_a_self_motion_torque_exerts_nothing_and_is_told_apart():
    moving = np.array([1.0, -1.0, 1.0])  # J moving = 0
    result = remap(J, J.T @ F + 3.0 * moving, only(2))
    assert_close(result.self_motion, 3.0 * moving)
    assert_close(result.F, F)
    assert_close(result.U, [10, 0, 5])  # U is J_Hᵀ F̂: the useless part is not commanded on


def test_a_direction_that_even_the_healthy_arm_lacks_is_no_jump():
    flat = np.array([[1.0, 1.0], [0.0, 0.0]])
    result = remap(flat, [4.0, 4.0], only(1, n=2))
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
    reduced = reduce(np.array([[1.0, 1e-7, 0.0], [0.0, 0.0, 1.0]]), only(1))
    assert_close(force_jump(reduced, F).jump, [10, 0])
    close = reduce(np.array([[1.0, 1e-5, 0.0], [0.0, 0.0, 1.0]]), only(1))
    assert force_jump(close, F).jump_norm == 0.0


def test_a_jacobian_of_zeros():
    result = remap(np.zeros((2, 3)), [1, 2, 3], only(2))
    assert_close(result.F, 0.0)
    assert_close(result.U, 0.0)
    assert_close(result.self_motion, [1, 2, 3])
    assert result.is_proved()


# ---- what comes from outside -----------------------------------------------------------------


def test_a_result_does_not_change_with_its_arguments():
    given, tau, mask = J.copy(), J.T @ F, only(1, 2)
    result = remap(given, tau, mask)
    load, motion = result.brake_load, result.self_motion
    given[:], tau[:], mask[:] = 7.0, 7.0, False
    assert_close(result.tau, [10, 15, 5])
    assert_close(result.brake_load, load)
    assert_close(result.self_motion, motion, scale=15)


# ---- results ---------------------------------------------------------------------------------


@pytest.fixture
def result():
    return remap(J, J.T @ F + [3, -3, 3], only(1, 3))


def test_results_are_frozen_and_read_only(result):
    for field in fields(result):
        with pytest.raises(AttributeError):
            setattr(result, field.name, None)
        if field.name != "reduced":
            assert not getattr(result, field.name).flags.writeable, field.name
    again = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(again.U, result.U)
    assert again.is_proved()


@pytest.mark.parametrize(
    ("tau", "locked"), [([1, 2], only(1)), (None, only(1)), ([1, 2, 3], [0, 1, 0])], ids=str
)
def test_malformed_arguments(tau, locked):
    with pytest.raises(InputError):
        remap(J, tau, locked)


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


def test_the_tolerance_of_a_proof_counts(result):
    almost = replace(result, U=result.U * (1.0 + 1e-4))
    assert almost.is_proved(1e-3)
    assert not almost.is_proved(1e-7)


def test_what_rtol_gave_away_is_forgiven():
    lean = np.array([[1.0, 5e-4, 0.0], [0.0, 0.0, 1.0]])
    result = remap(lean, lean.T @ F, only(1), rtol=1e-3)
    assert max(result.residuals().values()) > 1e-4
    assert result.is_proved()


# ---- velocities ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("locked", "after", "jump"),
    [
        ((), [1, 2, 3], [0, 0]),
        ((2,), [3, 0, 5], [0, 0]),  # healthy joints take over
        ((1, 2), [0, 0, 5], [-3, 0]),  # none can
        ((1, 2, 3), [0, 0, 0], [-3, -5]),
    ],
)
def test_velocities_by_hand(locked, after, jump):
    change = velocity_remap(reduce(J, only(*locked)), np.array([1.0, 2.0, 3.0]))
    assert_close(change.tip_before, [3, 5])
    assert_close(change.after, after)
    assert_close(change.jump, jump, scale=5.0)
    assert_close(change.tip_after, change.tip_before + jump, scale=5.0)
    for name in ("after", "tip_before", "tip_after", "jump"):
        assert not getattr(change, name).flags.writeable, name


def test_the_change_of_velocities_is_the_shortest():
    twins = np.array([[1.0, 1.0, 1.0]])
    change = velocity_remap(reduce(twins, only(1)), np.array([2.0, 0.5, -0.5]))
    assert_close(change.after, [0, 1.5, 0.5])


def test_velocities_are_not_sent_into_directions_at_the_tolerance():
    lean = np.array([[1.0, 1e-7, 0.0], [0.0, 0.0, 1.0]])
    change = velocity_remap(reduce(lean, only(1)), np.array([1.0, 0.0, 0.0]))
    assert_close(change.after, 0.0)  # not 1e7 rad/s
    assert_close(change.jump, [-1, 0])


# ---- velocities with joints that swing freely ------------------------------------------------


def freeing(J, *joints, locked=()):
    """Return the reduced Jacobian with free joints, numbered from 1."""
    n = J.shape[1]
    return reduce(J, only(*locked, n=n), free=only(*joints, n=n))


def test_a_joint_that_swings_makes_up_for_nothing():
    v = np.array([1.0, 2.0, 3.0])
    change = velocity_remap(freeing(J, 2, locked=(1,)), v)  # joint 3 alone has a motor
    assert_close(change.after, [0, 2, 3])
    assert_close(change.jump, [-1, 0])
    assert_close(change.tip_after, [2, 5])
    with_motor = velocity_remap(reduce(J, only(1)), v)
    assert_close(with_motor.after, [0, 3, 2])
    assert_close(with_motor.jump, [0, 0], scale=1.0)


def test_velocities_with_swinging_and_locked_joints_by_pseudo_inverses():
    rng = np.random.default_rng(2)
    for _ in range(50):
        m, n = rng.integers(1, 5), rng.integers(2, 9)
        A, v = rng.normal(size=(m, n)), rng.normal(size=n)
        state = rng.choice(3, size=n)
        locked, free = state == 1, state == 2
        change = velocity_remap(reduce(A, locked, free=free), v)
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
    after = velocity_after_impact(M, only(1, n=2), np.array([4.0, 1.0]))
    assert_close(after, [0, 3])  # 1 + 1/2 · 4
    assert_close(velocity_after_impact(M, only(2, n=2), np.array([4.0, 3.0])), [5, 0])


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


# ---- the dynamically consistent inverse ------------------------------------------------------


def weighted_inverse(A, M):
    """Return the inverse of Aᵀ that is shortest in the metric of M⁻¹, by its definition."""
    L = np.linalg.cholesky(np.linalg.inv(M))
    return np.linalg.pinv(L.T @ A.T, rcond=1e-10) @ L.T


def test_a_dynamically_exerted_force_by_hand():
    # One direction, two joints: the lighter one decides more.
    pair = reduce(np.array([[1.0, 1.0]]), only(n=2))
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


def test_no_direction_no_dynamic_force():
    nothing = reduce(np.zeros((2, 3)), only())
    assert_close(dynamically_exerted_force(nothing, np.ones(3), np.eye(3)), [0, 0])
    lean = reduce(np.array([[1.0, 0.0], [0.0, 1e-7]]), only(n=2))  # rtol gives the second away
    assert_close(dynamically_exerted_force(lean, np.array([2.0, 1.0]), np.eye(2)), [2, 0])
