"""Everything that is computed meets an oracle that is not our code.

NumPy, SciPy, 50-digit mpmath, roboticstoolbox, Pinocchio's own reduced and mimic models, finite
differences, and rigid-body statics.
"""

import math

import mpmath
import numpy as np
import pinocchio as pin
import pytest
import scipy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ftforce
from ftforce.core.measures import margin
from ftforce.core.reduced_jacobian import RTOL, reduce
from ftforce.core.remap import supported_force, velocity_remap
from ftforce.robot.dynamics import Payload, mass_matrix, rnea_torque, weight_torque
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from helpers import (
    CAMPAIGN,
    KNOWN,
    arms,
    assert_close,
    campaign,
    cases,
    changed_model,
    dh_tables,
    differences,
    is_clear,
    joint,
    load_table,
    load_text,
    toolbox_arm,
    urdf_of,
    with_singular_values,
)

FORCE = np.array([30.0, -20.0, 50.0])


@pytest.fixture(scope="module", params=KNOWN)
def known(request):
    """A known robot and postures: its default one, and two others."""
    arm = ftforce.load_robot(request.param)
    others = np.random.default_rng(7).uniform(-1.0, 1.0, size=(2, arm.n))
    return arm, [ftforce.analyze(arm).posture.q, *others]


# ---- linear algebra --------------------------------------------------------------------------


@given(cases())
@settings(deadline=None, max_examples=campaign(100, 50))
def test_torque_remap_against_numpy_pinv(case):
    assume(is_clear(case.J, case.locked))
    J, K, largest = case.J, np.where(case.locked, 0.0, case.J), np.linalg.norm(case.J, 2)
    own = RTOL * largest / (np.linalg.norm(K, 2) or 1.0)
    F = np.linalg.pinv(J.T, rcond=RTOL) @ case.tau
    after = K @ np.linalg.pinv(K, rcond=own) @ F
    result = ftforce.remap(J, case.tau, case.locked)
    scale = np.linalg.norm(F) or 1.0
    assert_close(result.F, F, scale=scale, tol=1e-7)
    assert_close(result.F_after, after, scale=scale, tol=1e-7)
    assert_close(result.jump, F - after, scale=scale, tol=1e-7)
    assert_close(result.U, K.T @ F, scale=scale * (largest or 1.0), tol=1e-7)
    supported = supported_force(result.reduced, case.F)
    assert_close(supported, J @ np.linalg.pinv(J, rcond=RTOL) @ case.F, scale=100.0, tol=1e-7)


@given(cases())
@settings(deadline=None, max_examples=campaign(100, 50))
def test_velocity_remap_against_scipy_lstsq(case):
    assume(is_clear(case.J, case.locked))
    largest = np.linalg.norm(case.J, 2)
    reduced = reduce(case.J, case.locked)
    assume(reduced.rank_after > 0)
    x_S = case.J[:, case.locked] @ case.v[case.locked]
    own = RTOL * largest / np.linalg.norm(reduced.K, 2)
    step = scipy.linalg.lstsq(reduced.K, x_S, cond=own)[0]
    change = velocity_remap(reduced, case.v)
    stays = np.where(case.locked, 0.0, case.v)
    assert_close(change.after, stays + step, scale=np.linalg.norm([*step, *case.v]), tol=1e-7)
    assert_close(change.jump, reduced.K @ step - x_S, scale=largest * np.linalg.norm(case.v))


# ---- fifty digits ----------------------------------------------------------------------------


def precise_svd(A):
    """Return U and singular values of a matrix of doubles, to 50 digits."""
    with mpmath.workdps(50):
        U, s, _ = mpmath.svd_r(mpmath.matrix(A.tolist()), full_matrices=False)
        return np.array(U.tolist()), np.array(list(s))


def precise_margin(J, K):
    """Return σ_min(K)/σ_max(J) in 50 digits, rounded once."""
    return float(precise_svd(K)[1][-1] / precise_svd(J)[1][0])


@pytest.mark.parametrize("ratio", [1e-2, 1e-4, 1.0001e-6, 0.9999e-6, 1e-9, 1e-12])
def test_forces_of_an_ill_conditioned_arm_against_fifty_digits(ratio):
    rng = np.random.default_rng(12)
    K = with_singular_values(rng, 3, 6, np.array([0.8, 0.5, ratio]))
    J = np.hstack([rng.normal(size=(3, 1)), K])
    J /= np.linalg.norm(J, 2)
    tau = J.T @ FORCE + rng.normal(size=7)
    result = ftforce.remap(J, tau, np.arange(7) == 0)
    with mpmath.workdps(50):
        A, t = mpmath.matrix(J.tolist()), mpmath.matrix(tau.tolist())
        F = mpmath.lu_solve(A * A.T, A * t)  # J has full rank
        U, s = precise_svd(J[:, 1:])
        kept = [U[:, i] for i in range(3) if s[i] > RTOL * precise_svd(J)[1][0]]
        F = np.array(list(F))
        after = sum(u * (u @ F) for u in kept)
    F, after, jump = (x.astype(float) for x in (F, after, F - after))
    assert len(kept) == result.reduced.rank_after
    assert_close(margin(result.reduced), precise_margin(J, J[:, 1:]), scale=1.0, tol=2e-15)
    # The direction that is just kept or lost is known to about 1e-16 over its singular value.
    tol = 1e-9 if ratio < 1e-5 else 1e-12
    scale = np.linalg.norm(F)
    assert_close(result.F, F, scale=scale, tol=1e-13)
    assert_close(result.F_after, after, scale=scale, tol=tol)
    assert_close(result.jump, jump, scale=scale, tol=tol)


@pytest.mark.parametrize("ratio", [1e-2, 1e-4, 2e-6])
def test_high_joint_velocities_still_keep_the_velocity_of_the_tip(ratio):
    # K† by way of V = KᵀU/σ would be wrong here by 1e-16/ratio² instead of 1e-16/ratio.
    rng = np.random.default_rng(16)
    worst = 0.0
    for _ in range(20):
        K = with_singular_values(rng, 3, 5, np.array([1.0, 0.7, ratio]))
        J, v = np.hstack([0.1 * rng.normal(size=(3, 1)), K]), rng.normal(size=6)
        change = velocity_remap(reduce(J, np.arange(6) == 0), v)
        worst = max(worst, np.linalg.norm(J @ change.after - J @ v))
    assert worst < 1e-14 / ratio


# ---- kinematics ------------------------------------------------------------------------------


def assert_jacobians(arm, q, wanted, tol):
    """Compare both axes with a Jacobian in world axes."""
    R, _ = tip_pose(arm, q)
    assert_close(frame_jacobian(arm, q, "world"), wanted, scale=1.0, tol=tol)
    assert_close(
        frame_jacobian(arm, q, "tool"), np.kron(np.eye(2), R.T) @ wanted, scale=1.0, tol=tol
    )


@given(arms(least=2))
@settings(deadline=None, max_examples=campaign(40, 12))
def test_jacobians_of_random_arms_against_finite_differences(case):
    arm, q = case
    assert_jacobians(arm, q, differences(arm, q), 1e-8)


@given(dh_tables.filter(lambda table: len(table.rows) > 1), st.data())
@settings(deadline=None, max_examples=campaign(30, 10))
def test_random_dh_tables_against_roboticstoolbox(table, data):
    n = len(table.rows)
    q = np.array(data.draw(st.lists(st.floats(-3.0, 3.0), min_size=n, max_size=n)))
    arm, other = load_table(table), toolbox_arm(table)
    pose, (R, p) = other.fkine(q).A, tip_pose(arm, q)
    assert_close(np.column_stack([R, p]), pose[:3], scale=1.0, tol=1e-12)
    assert_close(frame_jacobian(arm, q, "tool"), other.jacobe(q), scale=1.0, tol=1e-11)
    assert_close(frame_jacobian(arm, q, "world"), other.jacob0(q), scale=1.0, tol=1e-11)


# ---- Pinocchio's own reduced and mimic models ------------------------------------------------


def in_model(arm, model, q):
    """Return Pinocchio's configuration, joint by joint, for the joints that the model still has."""
    configuration = pin.neutral(model)
    for name, value in zip(arm.names, q, strict=True):
        if model.existJointName(name):
            joint_model = model.joints[model.getJointId(name)]
            numbers = [value] if joint_model.nq == 1 else [math.cos(value), math.sin(value)]
            configuration[joint_model.idx_q : joint_model.idx_q + joint_model.nq] = numbers
    return configuration


def reduced_model(arm, q, locked):
    """Let Pinocchio fix joints (indices from 0), and return its Jacobian in tool axes."""
    ids = [arm.model.getJointId(arm.names[k]) for k in locked]
    model = pin.buildReducedModel(arm.model, ids, in_model(arm, arm.model, q))
    frame = model.getFrameId(arm.tip, pin.FrameType.BODY)
    configuration = in_model(arm, model, q)
    J = pin.computeFrameJacobian(model, model.createData(), configuration, frame, pin.LOCAL)
    return model, configuration, J.reshape(6, model.nv)


def test_reduced_jacobian_against_pinocchios_reduced_model(known):
    arm, postures = known
    sets = [*([k] for k in range(arm.n)), [0, 2], [1, 2, 4], list(range(1, arm.n))]
    for q in postures if CAMPAIGN else postures[:1]:
        for locked in sets:
            result = ftforce.analyze(arm, q, locked=[k + 1 for k in locked], task="wrench")
            healthy = np.delete(result.reduced.K, locked, axis=1)
            assert_close(healthy, reduced_model(arm, q, locked)[2], tol=1e-12)
            np.testing.assert_array_equal(result.reduced.K[:, locked], 0.0)


@pytest.mark.parametrize(
    "surroundings",
    [{}, {"payload": (2.0, (0.05, -0.02, 0.1)), "gravity": [0.5, -1.0, -3.0]}],
    ids=["plain", "payload and gravity"],
)
def test_weight_and_motion_after_a_lock_against_pinocchios_reduced_model(known, surroundings):
    """Locked joints stand still; the others need what the arm with fewer joints does."""
    arm, postures = known
    load, gravity = (surroundings.get(key) for key in ("payload", "gravity"))
    model = changed_model(arm, gravity, None if load is None else Payload.of(*load))
    rng = np.random.default_rng(6)
    for q in postures[1:] if CAMPAIGN else postures[1:2]:
        v, a = rng.normal(size=(2, arm.n))
        motion = {"velocity": v, "acceleration": a}
        for locked in ([0], [arm.n - 1], [1, 2], [0, 2, arm.n - 1], list(range(1, arm.n))):
            H = [i for i in range(arm.n) if i not in locked]
            result = ftforce.analyze(
                arm, q, locked=[k + 1 for k in locked], force=FORCE, **motion, **surroundings
            )
            ids = [arm.model.getJointId(arm.names[k]) for k in locked]
            smaller = pin.buildReducedModel(model, ids, in_model(arm, model, q))
            order = [smaller.joints[smaller.getJointId(arm.names[k])].idx_v for k in H]
            v_H, a_H = np.zeros((2, len(H)))
            v_H[order], a_H[order] = v[H], a[H]
            place = in_model(arm, smaller, q)
            wanted = pin.rnea(smaller, smaller.createData(), place, v_H, a_H)[order]
            scale = 10.0 + np.abs(result.rnea.after).max()
            assert_close(result.rnea.after[H], wanted, scale=scale, tol=1e-12)
            # Brakes carry what the whole arm needs where they stand still, and their part of F.
            still_v, still_a = (np.where(np.isin(np.arange(arm.n), locked), 0, x) for x in (v, a))
            full = pin.rnea(model, model.createData(), in_model(arm, model, q), still_v, still_a)
            torque, after = result.torque, result.J.T @ result.force.after
            scale += np.abs(after).max()
            assert_close(torque.brake_load[locked], (full + after)[locked], scale=scale, tol=1e-12)
            assert_close(torque.total_after[H], wanted + after[H], scale=scale, tol=1e-12)
            np.testing.assert_array_equal(torque.brake_load[H], 0.0)
            np.testing.assert_array_equal(torque.total_after[locked], 0.0)
            whole = pin.rnea(model, model.createData(), in_model(arm, model, q), v, a)
            before = whole + result.J.T @ result.force.before
            assert_close(torque.total_before, before, scale=scale + np.abs(whole).max(), tol=1e-12)


B = {"xyz": (0.3, 0.0, 0.1), "axis": (0, 1, 0)}
C = {"xyz": (0.2, 0.1, 0.0), "axis": (1, 0, 0)}
D = {"xyz": (0.1, 0.0, 0.2), "rpy": (0.3, 0.2, 0.1)}
LINKS = ("base", "a", "b", "c", "d", "tool", "limb")
ENDS = (
    joint("end", "fixed", "d", "tool", xyz=(0.1, 0.05, 0.02)),
    joint("side", "fixed", "a", "limb"),
)
LIMB = joint("a_lead", "revolute", "a", "limb", xyz=(0, 0.2, 0))


def mimicking(first, second, third, fourth, ends=ENDS):
    """Return an arm of four joints from (kind, options)."""
    steps = enumerate((first, second, third, fourth))
    chain = [joint(f"j{i + 1}", k, LINKS[i], LINKS[i + 1], **o) for i, (k, o) in steps]
    return urdf_of(*LINKS, joints=[*chain, *ends])


def follow(options, *mimic):
    return {**options, "mimic": mimic}


R, P, T = "revolute", "prismatic", "continuous"
MIMICS = {
    "revolute follows revolute": ((R, {}), (R, B), (R, follow(C, "j2", 1.0, 0.0)), (R, D)),
    "negative multiplier": ((R, {}), (R, B), (R, follow(C, "j2", -0.7, 0.0)), (R, D)),
    "offset": ((R, {}), (R, B), (R, follow(C, "j2", 0.5, 0.4)), (R, D)),
    "prismatic follows revolute": ((R, {}), (R, B), (P, follow(C, "j1", 0.05, 0.03)), (R, D)),
    "revolute follows prismatic": ((R, {}), (P, B), (R, follow(C, "j2", 3.0, -0.2)), (R, D)),
    "two followers": ((R, {}), (R, follow(B, "j1", 2.0, 0.1)), (P, C), (R, follow(D, "j1", -1, 0))),
    "continuous": ((R, {}), (T, B), (T, follow(C, "j2", -1.5, 0.3)), (T, D)),
    "last joint follows": ((R, {}), (R, B), (R, C), (R, follow(D, "j3", 0.3, 0.2))),
}


def assert_like_pinocchios_mimics(arm, urdf):
    """Compare pose, Jacobian, weight, motion and mass with Pinocchio's own mimic joints."""
    model = pin.buildModelFromXML(urdf, mimic=True)
    assert model.nv == arm.n
    data, frame = model.createData(), model.getFrameId("tool")
    order = [model.joints[model.getJointId(name)].idx_v for name in arm.names]
    for q, v, a in np.random.default_rng(5).uniform(-1.0, 1.0, size=(3, 3, arm.n)):
        configuration, rates = in_model(arm, model, q), np.zeros((2, arm.n))
        rates[:, order] = v, a
        J = pin.computeFrameJacobian(model, data, configuration, frame, pin.LOCAL)
        pin.framesForwardKinematics(model, data, configuration)
        assert_close(tip_pose(arm, q)[0], data.oMf[frame].rotation, tol=1e-13)
        assert_close(tip_pose(arm, q)[1], data.oMf[frame].translation, tol=1e-13)
        assert_close(frame_jacobian(arm, q), J[:, order], tol=1e-13)
        assert_jacobians(arm, q, differences(arm, q), 1e-8)
        rest = np.zeros(arm.n)
        weight = pin.rnea(model, data, configuration, rest, rest)
        columns = [
            pin.rnea(model, data, configuration, rest, unit) - weight for unit in np.eye(arm.n)
        ]
        assert_close(weight_torque(arm, q), weight[order], scale=10.0, tol=1e-12)
        M = np.column_stack(columns)[np.ix_(order, order)]
        assert_close(mass_matrix(arm, q), M, tol=1e-12)
        total = pin.rnea(model, data, configuration, *rates)[order]
        assert_close(rnea_torque(arm, q, v, a), total, scale=10.0, tol=1e-12)


@pytest.mark.parametrize("chain", MIMICS.values(), ids=MIMICS)
def test_followers_against_pinocchios_mimic_model(chain):
    urdf = mimicking(*chain)
    arm = load_text(urdf, tip="tool")
    assert arm.n == sum("mimic" not in options for _, options in chain)
    assert_like_pinocchios_mimics(arm, urdf)


def test_a_leader_outside_the_path_to_the_tip():
    chain = ((R, {}), (R, B), (R, follow(C, "a_lead", -0.7, 0.2)), (R, D))
    urdf = mimicking(*chain, ends=(ENDS[0], LIMB))
    arm = load_text(urdf, tip="tool")
    assert arm.names == ("j1", "j2", "a_lead", "j4")
    assert_like_pinocchios_mimics(arm, urdf)


# Pinocchio cannot model these with mimic joints; with the chains of mimics worked out by hand, or
# by finite differences, it can.


@pytest.mark.parametrize("kind", [R, P])
def test_a_follower_of_a_follower(kind):
    first = ((R, {}), (R, B), (R, follow(C, "j2", -0.7, 0.2)), (kind, follow(D, "j3", 0.5, 0.03)))
    by_hand = (*first[:3], (kind, follow(D, "j2", 0.5 * -0.7, 0.5 * 0.2 + 0.03)))
    arm = load_text(mimicking(*first), tip="tool")
    assert arm.names == ("j1", "j2")
    assert arm.joints[1].followers == ("j3", "j4")
    assert_like_pinocchios_mimics(arm, mimicking(*by_hand))


@pytest.mark.parametrize(
    "chain",
    [
        ((R, {}), (R, follow(B, "j4", 0.5, -0.1)), (R, C), (R, D)),
        ((R, {}), (T, B), (R, follow(C, "j2", 0.5, -0.1)), (P, D)),
        ((R, {}), (R, B), (T, follow(C, "j2", -2.0, 0.4)), (R, D)),
    ],
    ids=["leader behind its follower", "leader continuous", "follower continuous"],
)
def test_followers_against_finite_differences(chain):
    arm = load_text(mimicking(*chain), tip="tool")
    free = load_text(mimicking(*((kind, {**o, "mimic": None}) for kind, o in chain)), tip="tool")
    assert (arm.n, free.n) == (3, 4)
    for q in np.random.default_rng(5).uniform(-1.0, 1.0, size=(3, arm.n)):
        assert_jacobians(arm, q, differences(arm, q), 1e-8)
        value = dict(zip(arm.names, q, strict=True))
        full = []
        for name, (_, options) in zip(free.names, chain, strict=True):
            leader, factor, offset = options.get("mimic", (name, 1.0, 0.0))
            full.append(factor * value[leader] + offset)
        assert_close(tip_pose(arm, q)[1], tip_pose(free, np.array(full))[1], tol=1e-13)


def test_a_locked_leader_locks_its_followers():
    arm = load_text(mimicking(*MIMICS["two followers"]), tip="tool")
    result = ftforce.analyze(arm, [0.3, 0.1], locked="j1", force=FORCE)
    assert_close(result.reduced.K[:, 0], 0.0)
    J = result.J[:, 1]
    assert_close(result.force.after, J * (J @ FORCE) / (J @ J), scale=60)
    assert result.torque.after[0] == 0.0


# ---- continuous joints -----------------------------------------------------------------------
