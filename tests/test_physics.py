"""What is predicted meets rigid-body dynamics: the arm in MuJoCo, its tip pinned to the world.

What `ftforce.analyze` says is applied to the simulation (`physics`), and what happens is read off.
Predictions are also written out in NumPy here, from Pinocchio's Jacobian, weight and mass matrix.
Joints are given by index, from 0.
"""

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

import ftforce
import physics
from ftforce.core.limits import Limits
from ftforce.robot.dynamics import Payload, mass_matrix, motion_torque, weight_torque
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from helpers import CAMPAIGN, KNOWN, assert_close, campaign, serial_urdf
from urdfs import joint, link, load

pytestmark = [pytest.mark.thorough, pytest.mark.no_cover]

EXACT = 1e-7  # nothing but rounding: MuJoCo 4 gives 2e-15, some before it 1e-8
STRENGTH = 40.0  # N, typical of the forces
TOLD = 1e-9  # of the force: what is told and what is predicted are the same mathematics
AGREES = 5e-5  # of the force; 1e-8 is seen, or 4e-6 where a direction is almost lost
AT_REST = 5e-5  # rad/s² and rad
IMPACT = 1e-4  # of the velocities: those of a brake that needs 2 µs
RTOL = 1e-6  # of σ_max(J): directions that are weaker are lost

# Joints that slide and turn without end are locked too, and others are held, far from 0.
HELD = '<limit lower="0.4" upper="1" effort="1" velocity="1"/>'
SLIDING = serial_urdf(
    ("revolute", {"xyz": (0, 0, 0.3)}),
    ("continuous", {"xyz": (0.1, 0, 0.1), "rpy": (0.3, 0.2, 0.1), "axis": (0, 1, 0)}),
    ("prismatic", {"xyz": (0.3, 0, 0.1), "rpy": (0.1, -0.4, 0.2), "axis": (0.6, 0, 0.8)}),
    ("revolute", {"xyz": (0.2, 0.1, 0), "axis": (0, 1, 0)}),
    ("revolute", {"xyz": (0.2, 0, 0.1), "axis": (1, 0, 0)}),
).replace(
    "</robot>",
    link("upper limb")
    + link("lower limb")
    + joint("slides out", "l2", "upper limb", "prismatic", axis="0 3 4", limit=HELD)
    + joint("turns", "upper limb", "lower limb", "revolute", axis="0 2 0", limit=HELD)
    + "</robot>",
)


class Case(NamedTuple):
    """An arm in a posture, a force at its tip, and what Pinocchio knows of it."""

    arm: Any
    q: Any
    F: Any
    J: Any  # of the force, in tool axes
    g: Any  # what carries the weight
    M: Any


class Prediction(NamedTuple):
    """A force, and the torques, weight included, of the motors that hold it."""

    force: Any
    torque: Any


@pytest.fixture(scope="module", params=["dh5", "panda", "ur5", "sliding"])
def arm(request, tmp_path_factory):
    if request.param == "sliding":
        return load(tmp_path_factory.mktemp("sliding"), SLIDING, tip="tool")
    return ftforce.load_robot(request.param)


@pytest.fixture(params=[1, 2, 3] if CAMPAIGN else [2])
def case(arm, request):
    """A posture far from singular ones, within the limits, and a force."""
    rng = np.random.default_rng(request.param)
    while True:
        q = rng.uniform(np.maximum(arm.lower, -3.0), np.minimum(arm.upper, 3.0))
        J = frame_jacobian(arm, q, "tool")[:3]
        if np.linalg.cond(J) < 10.0:
            return Case(arm, q, rng.normal(scale=STRENGTH, size=3), J, weight(arm, q), mass(arm, q))


def weight(arm, q):
    """Return the torques that carry the weight, from Pinocchio."""
    return pin.computeGeneralizedGravity(arm.model, arm.data, arm.to_model(q)).copy()


def mass(arm, q):
    """Return the mass matrix, from Pinocchio."""
    M = pin.crba(arm.model, arm.data, arm.to_model(q))
    return np.triu(M) + np.triu(M, 1).T


def others(case, *indices):
    return [i for i in range(case.arm.n) if i not in indices]


def some(items, seed, count):
    """Return some of the items."""
    return [items[i] for i in np.random.default_rng(seed).permutation(len(items))[:count]]


def some_sets(n, rng):
    """Return every single joint, and some sets of two and three."""
    larger = [list(combinations(range(n), size)) for size in (2, 3)]
    drawn = [sets[i] for sets in larger for i in rng.permutation(len(sets))[: campaign(5, 2)]]
    return [*((i,) for i in range(n)), *drawn]


# ---- predictions -----------------------------------------------------------------------------


def supported(A, J):
    """Return an orthonormal basis of range(A)."""
    left, s, _ = np.linalg.svd(A, full_matrices=False)
    return left[:, s > RTOL * np.linalg.norm(J, 2)]


def predicted_locked(case, locked):
    """Brakes hold: F' = K K† F, and the motors as before."""
    basis = supported(case.J[:, others(case, *locked)], case.J)
    force = basis @ (basis.T @ case.F)
    torque = case.g + case.J.T @ force
    torque[list(locked)] = 0.0
    return Prediction(force, torque)


def predicted_free(case, free):
    """Joints swing: the nearest force at which they carry the weight without a motor."""
    S = list(free)
    lacking = case.J[:, S].T @ case.F + case.g[S]
    force = case.F - np.linalg.pinv(case.J[:, S].T) @ lacking
    torque = case.g + case.J.T @ force
    torque[S] = 0.0
    return Prediction(force, torque)


def predicted_mixed(case, locked, free):
    """Both: the nearest force in range(K) at which free joints carry the weight without a motor.

    A free joint can move, so its column of J lies in range(K), and the second step stays there.
    """
    inside = case._replace(F=predicted_locked(case, locked).force)
    force, torque = predicted_free(inside, free)
    torque[list(locked)] = 0.0
    return Prediction(force, torque)


def predicted_moving(case, torque):
    """Torques that do not balance: the force of an arm that starts to move, tip pinned."""
    through = np.linalg.solve(case.M, case.J.T).T  # J M⁻¹
    return np.linalg.solve(through @ case.J.T, through @ (torque - case.g))


def predicted_impact(case, v, locked):
    """Joints stop at once: v_H⁺ = v_H + M_HH⁻¹ M_HS v_S."""
    S, H = list(locked), others(case, *locked)
    after = np.zeros(case.arm.n)
    after[H] = v[H] + np.linalg.solve(case.M[np.ix_(H, H)], case.M[np.ix_(H, S)] @ v[S])
    return after


def can_stand_still(case, locked, free):
    """Return whether free joints can be balanced clearly, by a force that is not huge."""
    A = supported(case.J[:, others(case, *locked)], case.J).T @ case.J[:, list(free)]
    if len(A) < len(free) or np.linalg.svd(A, compute_uv=False)[-1] < 0.05:
        return False
    return np.linalg.norm(predicted_mixed(case, locked, free).force) < 5 * STRENGTH


def missing(case, free):
    """Return the torques that free joints do not give any more."""
    return np.abs(case.g + case.J.T @ case.F)[list(free)]


def told(case, *, locked=(), free=(), **options):
    """Return what ftforce says of the force, with joints by index."""
    locked, free = ([i + 1 for i in joints] for joints in (locked, free))
    given = {} if {"torque", "velocity"} & set(options) else {"force": case.F}
    return ftforce.analyze(case.arm, case.q, locked=locked, free=free, **given, **options)


def assert_told(case, result, prediction):
    """Compare what ftforce says with what NumPy predicts."""
    scale = np.linalg.norm(case.F)
    assert_close(result.force.after, prediction.force, scale=scale, tol=TOLD)
    assert_close(result.torque.total_after, prediction.torque, scale=scale, tol=TOLD)


def assert_holds(case, result, **options):
    """Apply the torques that ftforce tells: the pin feels the force, and nothing moves."""
    locked, after = result.faults.in_mode(ftforce.FaultMode.LOCKED), result.force.after
    torque = result.torque
    seen = physics.pinned(case.arm, case.q, torque.total_after, locked=locked, **options)
    scale = np.linalg.norm(case.F)
    assert_close(seen.force, after, scale=scale, tol=AGREES)
    assert_close(seen.acceleration, 0.0, scale=1.0, tol=AT_REST)
    assert seen.drift < AT_REST
    # Brakes carry what motors do not: the weight, and their part of the force.
    assert_close(seen.load, torque.total_after + torque.brake_load, scale=scale, tol=AGREES)
    assert_close(seen.load, case.g + case.J.T @ after, scale=scale, tol=AGREES)


# ---- the oracle itself -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("torque", "payload", "wanted"),
    [
        (0.0, None, 9.81),  # a tip of 1 kg rests on the pin
        (5.0, None, 9.81 + 5.0 / 2.0),
        (-30.0, None, 9.81 - 30.0 / 2.0),
        (0.0, physics.Payload(3.0), 9.81 + 3.0 * 9.81),
        (0.0, physics.Payload(3.0, (1.0, 0.0, 0.0)), 9.81 + 3.0 * 9.81 * 3.0 / 2.0),
    ],
)
def test_the_pin_by_hand(tmp_path, torque, payload, wanted):
    """A lever of 2 m along x turns about y and pushes downwards, that is, along the tool's -y."""
    urdf = serial_urdf(("revolute", {"axis": (0, 1, 0)}))
    end = '<origin xyz="0.11 0.05 0.03" rpy="0.0 0.0 0.0"/>'
    assert end in urdf
    turned = urdf.replace(end, '<origin xyz="2 0 0" rpy="1.5707963267948966 0 0"/>')
    lever = load(tmp_path, turned, tip="tool")
    seen = physics.pinned(lever, [0.0], [torque], payload=payload)
    assert_close(seen.force, [0.0, -wanted, 0.0], tol=1e-8)


@pytest.mark.parametrize("name", KNOWN)
def test_weight_and_inverse_dynamics_against_pinocchio(name):
    arm = ftforce.load_robot(name)
    if any(moves.followers for moves in arm.joints):
        pytest.skip("followers are not simulated")
    rng = np.random.default_rng(3)
    q = rng.uniform(np.maximum(arm.lower, -3.0), np.minimum(arm.upper, 3.0))
    v, a = rng.normal(size=(2, arm.n))
    assert_close(physics.inverse_dynamics(arm, q, 0.0, 0.0), weight(arm, q), tol=EXACT)
    wanted = pin.rnea(arm.model, arm.data, arm.to_model(q), v, a)
    assert_close(physics.inverse_dynamics(arm, q, v, a), wanted, tol=EXACT)


def test_mass_and_the_load_of_a_force_against_pinocchio(case):
    arm, q, g = case.arm, case.q, case.g
    assert_close(physics.mass_matrix(arm, q), case.M, tol=EXACT)
    W = np.array([*case.F, *(0.1 * case.F[::-1])])
    J = frame_jacobian(arm, q, "tool")
    assert_close(physics.inverse_dynamics(arm, q, 0.0, 0.0, force=W), g + J.T @ W, tol=EXACT)


def test_a_locked_arm_stays_in_its_place(case):
    arm, q = case.arm, case.q
    R, p = tip_pose(arm, q)
    for locked in [(), *some_sets(arm.n, np.random.default_rng(5)), range(arm.n)]:
        tip = physics.simulate(arm, q, locked=locked).data.site(physics.TIP)
        assert_close(tip.xpos, p, scale=1.0, tol=EXACT)
        assert_close(tip.xmat.reshape(3, 3), R, scale=1.0, tol=EXACT)


# ---- weight and motion -----------------------------------------------------------------------

HANGING = physics.Payload(1.5, (0.05, -0.02, 0.1))
TILTED = (1.0, -2.0, -3.0)  # m/s²


def test_weight_motion_and_mass_matrix(case):
    arm, q, rng = case.arm, case.q, np.random.default_rng(31)
    payload = Payload.of(*HANGING)
    v, a = rng.normal(size=(2, arm.n))
    for mine, gravity in ((None, physics.GRAVITY), (payload, TILTED)):
        around = {"gravity": gravity, "payload": None if mine is None else HANGING}
        weight = weight_torque(arm, q, np.array(gravity), mine)
        assert_close(weight, physics.inverse_dynamics(arm, q, 0.0, 0.0, **around), tol=EXACT)
        total = weight + motion_torque(arm, q, v, a, mine)
        assert_close(total, physics.inverse_dynamics(arm, q, v, a, **around), tol=EXACT)
        M = physics.mass_matrix(arm, q, around["payload"])
        assert_close(mass_matrix(arm, q, mine), M, tol=EXACT)


def test_torques_and_brake_loads_of_a_moving_arm(case):
    """Joints lock, the others go on: inverse dynamics with the force that is told."""
    arm, q, rng = case.arm, case.q, np.random.default_rng(37)
    for locked in some_sets(arm.n, rng):
        v, a = rng.normal(size=(2, arm.n))
        result = ftforce.analyze(
            arm,
            q,
            locked=[i + 1 for i in locked],
            force=case.F,
            velocity=v,
            acceleration=a,
            gravity=TILTED,
            payload=tuple(HANGING),
        )
        v[list(locked)], a[list(locked)] = 0.0, 0.0
        around = {"gravity": TILTED, "payload": HANGING}
        wanted = physics.inverse_dynamics(arm, q, v, a, force=result.force.after, **around)
        torque, scale = result.torque, np.linalg.norm(case.F)
        assert_close(torque.total_after + torque.brake_load, wanted, scale=scale, tol=1e-6)
        assert not torque.total_after[list(locked)].any()
        assert not torque.brake_load[others(case, *locked)].any()


# ---- forces ----------------------------------------------------------------------------------


def test_a_healthy_arm(case):
    result = told(case)
    assert_told(case, result, Prediction(case.F, case.g + case.J.T @ case.F))
    assert_close(result.torque.total_before, result.torque.total_after)
    assert_holds(case, result, duration=0.1)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), TILTED], ids=str)
def test_another_gravity(case, gravity):
    J = pin.jacobianCenterOfMass(case.arm.model, case.arm.data, case.arm.to_model(case.q))
    g = -case.arm.data.mass[0] * np.array(gravity) @ J
    case, locked = case._replace(g=g), (1,)
    result = told(case, locked=locked, gravity=gravity)
    assert_told(case, result, predicted_locked(case, locked))
    assert_holds(case, result, gravity=gravity)
    assert_holds(case, told(case, gravity=gravity), gravity=gravity)


def test_a_payload(case):
    R, _ = tip_pose(case.arm, case.q)
    down = R.T @ [0.0, 0.0, -HANGING.mass * 9.81]
    W = np.array([*down, *np.cross(HANGING.com, down)])
    g = case.g - frame_jacobian(case.arm, case.q, "tool").T @ W
    case = case._replace(g=g)
    for locked in ((), (1,), (0, 2)):
        result = told(case, locked=locked, payload=tuple(HANGING))
        assert_told(case, result, predicted_locked(case, locked))
        assert_holds(case, result, payload=HANGING)
    for free in ((i,) for i in range(case.arm.n) if can_stand_still(case, (), (i,))):
        result = told(case, free=free, payload=tuple(HANGING))
        assert_told(case, result, predicted_free(case, free))
        assert_holds(case, result, payload=HANGING)


def test_a_force_and_a_moment(case):
    J = frame_jacobian(case.arm, case.q, "tool")
    W, scale = np.array([*case.F, *(0.1 * case.F[::-1])]), np.linalg.norm(case.F)
    result = told(case._replace(F=W), task="wrench", length=0.3)
    assert_close(result.force.before + result.force.unsupported, W)
    seen = physics.pinned(case.arm, case.q, result.torque.total_before, weld=True)
    assert_close(J.T @ seen.force, J.T @ result.force.before, scale=scale, tol=AGREES)
    if case.arm.n >= 6:  # else some of it does not depend on the motors
        assert_close(seen.force, W, scale=scale, tol=AGREES)
        assert_close(seen.acceleration, 0.0, scale=1.0, tol=AT_REST)
    for i in range(case.arm.n):
        result, H = told(case._replace(F=W), locked=(i,), task="wrench"), others(case, i)
        seen = physics.pinned(case.arm, case.q, result.torque.total_after, locked=(i,), weld=True)
        felt = J[:, H].T @ result.force.after  # what moves the tip, or would
        assert_close(J[:, H].T @ seen.force, felt, scale=scale, tol=AGREES)


def test_locked_joints(case):
    pairs = some(list(combinations(range(case.arm.n), 2)), 13, campaign(5, 2))
    lost = [tuple(others(case, *pair)) for pair in pairs]  # so many that a direction is lost
    for locked in [*some_sets(case.arm.n, np.random.default_rng(11)), *lost]:
        result = told(case, locked=locked)
        assert locked not in lost or result.force.jump_norm > 0.01 * STRENGTH
        assert_told(case, result, predicted_locked(case, locked))
        assert_holds(case, result, duration=0.1 if len(locked) == 1 else 0.0)


def test_joints_that_swing_freely(case):
    sets = some_sets(case.arm.n, np.random.default_rng(17))
    sets = [free for free in sets if can_stand_still(case, (), free)]
    assert {len(free) for free in sets} >= ({1, 2} if CAMPAIGN else {1})
    for free in sets:
        result = told(case, free=free)
        assert_told(case, result, predicted_free(case, free))
        assert_holds(case, result, duration=0.5 if len(free) == 1 else 0.0)


def test_with_the_old_torques_an_arm_with_a_free_joint_drifts(case):
    singles = ((i,) for i in range(case.arm.n) if can_stand_still(case, (), (i,)))
    singles = [free for free in singles if missing(case, free)[0] > 1.0]
    assert singles
    for free in singles:
        result = told(case, free=free)
        old = result.torque.total_before.copy()
        old[list(free)] = 0.0
        seen = physics.pinned(case.arm, case.q, old, duration=0.5)
        assert seen.drift > 0.1
        assert np.linalg.norm(seen.acceleration) > 0.1
        scale = np.linalg.norm(case.F)
        assert np.linalg.norm(seen.force - result.force.after) > 0.01 * scale
        assert_close(seen.force, predicted_moving(case, old), scale=scale, tol=AGREES)


def test_a_weak_joint(case):
    """The motor gives no more than half of what the force takes of it besides the weight."""
    J, g, n, tried = case.J, case.g, case.arm.n, 0
    for k in range(n):
        lever = J[:, k]
        F = case.F * (-1.0 if g[k] * (lever @ case.F) < 0.0 else 1.0)
        share = 0.5 * abs(lever @ F)
        if share < 0.01 * STRENGTH:
            continue
        limits = Limits.of(np.where(np.arange(n) == k, 4.0 * (abs(g[k]) + share), 1e4))
        result = told(case._replace(F=F), weak={k + 1: 0.25}, limits=limits)
        assert result.bounded.binding == (k,)
        force = F - 0.5 * lever * (lever @ F) / (lever @ lever)
        prediction = Prediction(force, g + J.T @ force)
        assert_told(case, result, prediction)
        assert_close(abs(result.torque.total_after[k]), abs(g[k]) + share)
        assert_holds(case, result)
        tried += 1
    assert tried > 1


def test_weak_joints_beside_locked_and_free_ones(case):
    """Whatever limits bind, the pin feels what is told."""
    rng, n, bound = np.random.default_rng(43), case.arm.n, 0
    for _ in range(campaign(12, 5)):
        i, k, *rest = rng.permutation(n).tolist()
        locked, free = ((i,), (k,)) if can_stand_still(case, (i,), (k,)) else ((i,), ())
        weak = {j + 1: 0.5 for j in rest}
        plain = told(case, locked=locked, free=free)
        needed = np.abs(plain.torque.total_after)
        # Little less than what would be needed, but enough for the weight.
        weighs = np.abs(told(case._replace(F=0.7 * case.F), locked=locked, free=free)
                        .torque.total_after)  # fmt: skip
        limits = Limits.of(2.0 * np.maximum(weighs, 0.9 * needed) + 0.1)
        result = told(case, locked=locked, free=free, weak=weak, limits=limits)
        assert result.can_stand_still
        over = np.abs(result.torque.total_after) - 0.5 * limits.effort
        assert over.max() < 1e-6
        bound += len(result.bounded.binding) > 0
        assert_holds(case, result)
    assert bound > campaign(3, 1)


@pytest.mark.parametrize("lost", [False, True], ids=["one locked", "all others but one locked"])
def test_locked_joints_beside_a_free_one(case, lost):
    """Where so many lock that directions are lost, the free joint takes another one."""
    pairs = [(i, k) for i in range(case.arm.n) for k in others(case, i)]
    sets = [(others(case, i, k) if lost else (i,), (k,)) for i, k in pairs]
    sets = [(locked, free) for locked, free in sets if can_stand_still(case, locked, free)]
    assert len(sets) > 3
    for locked, free in some(sets, 19, campaign(8, 3)):
        result = told(case, locked=locked, free=free)
        assert_told(case, result, predicted_mixed(case, locked, free))
        assert_holds(case, result)
    assert_holds(case, result, duration=0.5)


@pytest.mark.parametrize("payload", [None, HANGING], ids=["no payload", "payload"])
def test_torques_of_self_motion_show_in_the_force_of_a_moving_arm(case, payload):
    N = np.eye(case.arm.n) - np.linalg.pinv(case.J) @ case.J
    given = case.J.T @ case.F + N @ np.linspace(-15.0, 20.0, case.arm.n)
    options = {"torque": given, "payload": None if payload is None else tuple(payload)}
    static, dynamic = (told(case, inverse=x, **options) for x in ("euclidean", "dynamic"))
    assert_close(static.force.before, case.F)  # what statics sees of them: nothing
    torque, scale = dynamic.torque.total_before, np.linalg.norm(case.F)
    if payload is None:
        moving = predicted_moving(case, case.g + given)
        assert_close(dynamic.force.before, moving, scale=scale, tol=TOLD)
        assert_close(torque, case.g + given)
        assert np.linalg.norm(moving - case.F) > 0.01 * scale
    seen = physics.pinned(case.arm, case.q, torque, payload=payload)
    assert_close(seen.force, dynamic.force.before, scale=scale, tol=AGREES)
    M = physics.mass_matrix(case.arm, case.q, payload)
    a = np.linalg.solve(M, dynamic.torque.self_motion)  # what is left of the torques
    assert_close(seen.acceleration, a, tol=AGREES)


# ---- the impact ------------------------------------------------------------------------------


@pytest.mark.parametrize("payload", [None, HANGING], ids=["no payload", "payload"])
def test_velocities_when_a_moving_joint_locks(case, payload):
    arm, rng = case.arm, np.random.default_rng(23)
    M = physics.mass_matrix(arm, case.q, payload)
    sets = some_sets(arm.n, rng)
    for locked in sets if payload is None else sets[::2]:
        v = rng.normal(size=arm.n)
        load = None if payload is None else tuple(payload)
        impact = told(case, locked=locked, velocity=v, payload=load).impact
        after, tip = physics.brake(arm, case.q, v, locked, payload)
        wanted, scale = predicted_impact(case._replace(M=M), v, locked), np.abs(v).max()
        assert_close(impact.after, wanted, scale=scale, tol=IMPACT / 10)
        assert_close(after, impact.after, scale=scale, tol=IMPACT)
        assert_close(tip, impact.tip_after, scale=scale, tol=IMPACT)
        assert_close(tip - case.J @ v, impact.jump, scale=scale, tol=IMPACT)
        # The brake's impulse acts on its own joints only, and takes energy away.
        H = others(case, *locked)
        assert_close((M @ (after - v))[H], 0.0, scale=np.abs(M @ v).max(), tol=IMPACT)
        assert after @ M @ after < v @ M @ v
