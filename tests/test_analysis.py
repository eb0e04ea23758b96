"""analyze(): from a robot and a few numbers to a verdict, and what is wrong with other numbers."""

import copy
import math
import pickle
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest

import ftforce
from ftforce import Task, Verdict, analyze
from ftforce.core.limits import Limits
from ftforce.errors import DimensionError, InputError, UnknownNameError
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from helpers import KNOWN, arrays_in, assert_close, eager_threads, load_text, serial_urdf, stretched

FORCE = [80.0, 50.0, 10.0]


# ---- what is given ---------------------------------------------------------------------------


@pytest.mark.parametrize("locked", [[2, 4], "joint2,4", [False, True, False, True, False]], ids=str)
def test_joints_in_any_form_that_the_robot_reads(dh5, locked):
    result = analyze(dh5, locked=locked)
    assert str(result.faults) == "{2, 4}"
    assert result.locked == ("joint2", "joint4")
    np.testing.assert_array_equal(result.reduced.locked, [False, True, False, True, False])


ALL_JOINTS = "1 joint1, 2 joint2, 3 joint3, 4 joint4, 5 joint5"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("force", [1, 2], "force needs 3 numbers, got 2 numbers: fx, fy, fz of the task 'force'"),
        ("torque", [1, 2], f"torque needs 5 numbers, got 2 numbers: one per joint, {ALL_JOINTS}"),
        ("velocity", [1] * 6, "velocity needs 5 numbers, got 6 numbers: one per joint, 1 joint1"),
        ("q", [0] * 4, "q needs 5 numbers, got 4 numbers: one per joint, 1 joint1"),
    ],
)
def test_vectors_of_the_wrong_size(dh5, name, value, message):
    with pytest.raises(DimensionError, match=message) as caught:
        analyze(dh5, **{name: value})
    assert caught.value.name == name


@pytest.mark.parametrize(
    "options",
    [
        {"force": FORCE, "torque": [0] * 5},
        {"q": [0] * 5, "posture": "zero"},
        {"posture": "home"},
        {"posture": 3},
        {"task": "push"},
        {"task": ["fx", 3]},
        {"axes": "base"},
        {"task": "wrench", "length": 0},
        {"rtol": 0},
        {"wary": 1e-9},
        {"locked": 9},
        {"locked": None},
        *({name: [0, np.nan, 0, 0, 0]} for name in ("q", "torque", "velocity")),
        {"force": [0, np.inf, 0]},
        {"force": ["fast", 0, 0]},
    ],
    ids=repr,
)
def test_malformed_values(dh5, options):
    with pytest.raises(InputError):
        analyze(dh5, **options)


def test_a_force_and_torques_are_one_too_many(dh5):
    with pytest.raises(InputError, match="give either a force or torques, not both"):
        analyze(dh5, force=FORCE, torque=[0] * 5)


def test_complex_numbers_lose_nothing_in_silence(dh5):
    with pytest.raises(InputError, match="force"):
        analyze(dh5, force=np.array([1 + 2j, 0, 0]))


def test_errors_are_value_errors_and_of_one_family(dh5):
    for error in (ValueError, ftforce.FtforceError):
        with pytest.raises(error):
            analyze(dh5, locked=9)
    with pytest.raises(UnknownNameError) as caught:
        analyze(dh5, locked="joint22")
    assert caught.value.available == dh5.names
    assert caught.value.suggestion == "joint2"


def test_arguments_are_left_alone(dh5):
    given = {"q": np.zeros(5) + 0.3, "force": np.array(FORCE), "velocity": np.ones(5)}
    before = copy.deepcopy(given)
    result = analyze(dh5, locked=2, **given)
    for name, value in given.items():
        np.testing.assert_array_equal(value, before[name])
        assert value.flags.writeable
        value[:] = 99.0
    assert_close(result.force.requested, FORCE)
    assert_close(result.velocity.before, np.ones(5))
    assert_close(result.posture.q, np.zeros(5) + 0.3)


# ---- what comes out --------------------------------------------------------------------------


@pytest.mark.parametrize("name", KNOWN)
def test_shapes_and_laws_for_known_robots(name):
    arm = ftforce.load_robot(name)
    wrench = [10, -20, 30, 1, -2, 3]
    result = analyze(
        arm, locked=2, force=wrench, velocity=np.ones(arm.n), task="wrench", length=0.5
    )
    assert result.J.shape == (6, arm.n)
    assert {a.shape for _, a in arrays_in(result.force)} == {(6,)}
    assert {a.shape for _, a in arrays_in(result.torque)} == {(arm.n,)}
    assert result.velocity.after.shape == (arm.n,)
    assert result.velocity.tip_after.shape == (6,)
    assert result.is_proved()
    assert_close(result.force.before + result.force.unsupported, wrench)
    assert_close(result.velocity.tip_before, result.J @ np.ones(arm.n))
    assert_close(result.velocity.tip_after, result.J @ result.velocity.after, tol=1e-7)


@pytest.mark.parametrize("locked", [[], [1], [1, 2]], ids=str)
@pytest.mark.parametrize("rpy", [(0, 0, 0), (0.3, 0.7, 0.2)], ids=["flat", "tilted"])
def test_a_request_that_no_joint_can_serve(rpy, locked):
    level = ("revolute", {"xyz": (0.3, 0, 0)})
    arm = load_text(serial_urdf(("revolute", {"rpy": rpy}), level, level))
    R, _ = tip_pose(arm, np.array([0.1, 0.7, 0.9]))
    normal = 30.0 * R[:, 2]
    with pytest.raises(InputError) as caught:
        analyze(arm, [0.1, 0.7, 0.9], locked=locked, force=normal, axes="world")
    assert str(caught.value) == (
        "even the healthy arm cannot exert this force in this posture: no joint of the chain from "
        "'base' to the tip 'tool' moves the tip along it (task 'force', world axes); choose "
        "another task, axes, tip or posture"
    )


def test_without_a_force_every_unit_force_is_analysed(dh5):
    result = analyze(dh5, locked=3, task="wrench", length=0.2)
    assert result.force is None
    assert result.torque is None
    assert len(result.unit_forces) == 6
    for unit, (force, torque) in zip(np.eye(6), result.unit_forces, strict=True):
        if not force.before.any():  # an error if it is asked about alone
            continue
        alone = analyze(dh5, locked=3, task="wrench", length=0.2, force=unit)
        assert_close(force.requested, unit)
        assert_close(force.after, alone.force.after, scale=1.0)
        assert_close(torque.after, alone.torque.after, scale=1.0)
    assert analyze(dh5, locked=3, force=FORCE).unit_forces == ()


def test_a_velocity_alone(dh5):
    v = np.array([0.05, 0.40, 0.20, 0.10, 0.30])
    result = analyze(dh5, locked=3, velocity=v)
    change = result.velocity
    assert_close(change.tip_before, result.J @ v)
    assert_close(change.tip_after, result.J @ change.after)
    assert change.after[2] == 0.0
    # Joint 3 alone moves the tip along x of the tool.
    assert_close(change.jump, [-0.2 * result.J[0, 2], 0, 0], tol=1e-6)
    assert change.jump_norm == pytest.approx(abs(0.2 * result.J[0, 2]))
    assert change.angular_jump_norm is None
    assert analyze(dh5, locked=3).velocity is analyze(dh5, locked=3).impact is None
    assert analyze(dh5, velocity=v, free=3).impact is None


def test_norms_of_forces_and_moments_are_never_added(panda):
    wrench = [10, -20, 30, 1, -2, 3]
    locked = [1, 2, 3, 4]
    result = analyze(panda, locked=locked, force=wrench, task="wrench", velocity=np.ones(7))
    force, velocity = result.force, result.velocity
    assert force.jump_norm == pytest.approx(np.linalg.norm(force.jump[:3]))
    assert force.moment_jump_norm == pytest.approx(np.linalg.norm(force.jump[3:]))
    assert min(force.jump_norm, force.moment_jump_norm) > 0.1
    assert velocity.jump_norm == pytest.approx(np.linalg.norm(velocity.jump[:3]))
    assert velocity.angular_jump_norm == pytest.approx(np.linalg.norm(velocity.jump[3:]))
    only = analyze(panda, locked=locked, force=wrench[3:], task="moment").force
    assert only.jump_norm is None
    assert only.moment_jump_norm == pytest.approx(np.linalg.norm(only.jump))
    assert analyze(panda, locked=locked, force=FORCE).force.moment_jump_norm is None
    mixed = analyze(panda, locked=locked, force=[1, 2, 3], task="mz,fx,my").force
    assert mixed.jump_norm == pytest.approx(abs(mixed.jump[1]))
    assert mixed.moment_jump_norm == pytest.approx(math.hypot(mixed.jump[0], mixed.jump[2]))


def test_jacobian_is_unweighted_and_in_the_tasks_axes(panda):
    task = Task.parse("fz,mx", "world", 0.3)
    result = analyze(panda, task=task, locked=1)
    assert result.task is task
    assert result.force_contributions is result.velocity_contributions is None
    rows = frame_jacobian(panda, result.posture.q, "world")[[2, 3]]
    assert_close(result.J, rows)
    assert_close(result.reduced.J, rows * [[1.0], [0.3]])


def test_measures_of_the_result(dh5):
    result = analyze(dh5, locked=3)
    s = np.linalg.svd(np.delete(result.J, 2, axis=1), compute_uv=False)
    assert_close(result.margin, 0.0, scale=1.0)
    assert_close(result.relative_manipulability, 0.0, scale=1.0)
    assert_close(result.lost_directions, [[1, 0, 0]])
    assert_close(result.force_error, 1 / s[1])
    kept = analyze(dh5, locked=2)
    s = np.linalg.svd(np.delete(kept.J, 1, axis=1), compute_uv=False)
    assert_close(kept.margin, s[-1] / np.linalg.norm(kept.J, 2))
    assert_close(kept.force_error, 1 / s[-1])
    assert kept.lost_directions.shape == (0, 3)


def test_shares_of_a_wrench_are_weighted(panda):
    result = analyze(
        panda, force=[1, 2, 3, 4, 5, 6], task="wrench", length=0.3, velocity=np.ones(7)
    )
    W = np.array([1, 1, 1, 0.3, 0.3, 0.3])
    J = W[:, None] * result.J
    columns = np.linalg.norm(np.linalg.pinv(J.T), axis=0)
    size = np.linalg.norm(np.array([1, 2, 3, 4, 5, 6]) / W)
    assert_close(result.force_contributions, columns * np.abs(result.torque.before) / size)
    moved = np.linalg.norm(J, axis=0) / np.linalg.norm(J @ np.ones(7))
    assert_close(result.velocity_contributions, moved)


# ---- fault modes, weight, motion and limits --------------------------------------------------

POSTURE = [0.2, -0.4, 0.3, -1.9, 0.1, 1.6, 0.5]  # of panda: nothing is special there
MOTION = {"velocity": np.linspace(-1.0, 1.0, 7), "acceleration": np.linspace(2.0, -1.0, 7)}
SURROUNDINGS = [{}, MOTION, {"payload": "1.5@0,0.1,0.2", "gravity": [0.5, -1.0, -3.0], **MOTION}]
MODES = [
    {"locked": [2, 4]},
    {"free": [6]},
    {"free": [2, 6]},
    {"locked": [1], "free": [4]},
    {"weak": {2: 0.12, 4: 0.9}},
    {"locked": [3], "free": [6], "weak": {4: 0.2}},
    {"weak": {6: 0.0}},
    {"locked": [2, 4], "limits": "urdf"},
]


@pytest.mark.parametrize("surroundings", SURROUNDINGS, ids=["at rest", "moving", "all"])
@pytest.mark.parametrize("mode", MODES, ids=str)
def test_total_torques_are_weight_motion_and_force_part(panda, mode, surroundings):
    result = analyze(panda, POSTURE, force=FORCE, **mode, **surroundings)
    force, torque, rnea, J = result.force, result.torque, result.rnea, result.J
    locked = result.faults.mask(7)
    free = np.isin(np.arange(7), result.faults.free)
    part = J.T @ force.after
    assert_close(torque.after, np.where(locked, 0.0, part), scale=100)
    total = rnea.gravity + rnea.motion_after + part
    assert_close(rnea.gravity + rnea.motion_before, rnea.before)
    assert_close(rnea.gravity + rnea.motion_after, rnea.after)
    assert_close(total[free], 0.0, scale=100)
    np.testing.assert_array_equal(torque.total_after[locked | free], 0.0)
    assert_close(torque.total_after, np.where(locked | free, 0.0, total), scale=100)
    assert_close(torque.brake_load, np.where(locked, total, 0.0), scale=100)
    assert_close(torque.total_before, rnea.before + J.T @ force.before, scale=100)
    assert_close(force.after + force.jump, force.before, scale=100)
    if result.limits is not None:
        largest = result.limits.largest_torques(result.faults)
        over = np.abs(torque.total_after) - np.where(np.isnan(largest), np.inf, largest)
        assert over.max() < 1e-7
    assert result.is_proved(), dict(result.residuals())


@pytest.mark.parametrize("free", [[1], [6], [2, 6], [2, 4, 6], [1, 2, 3, 4]], ids=str)
@pytest.mark.parametrize("surroundings", SURROUNDINGS, ids=["at rest", "moving", "all"])
def test_free_joints_in_closed_form(panda, free, surroundings):
    result = analyze(panda, POSTURE, free=free, force=FORCE, friction=0, **surroundings)
    S = [k - 1 for k in free]
    J_S, rnea = result.J[:, S], result.rnea.after
    after = FORCE - np.linalg.pinv(J_S.T) @ (J_S.T @ FORCE + rnea[S])
    balanced = np.linalg.norm(J_S.T @ after + rnea[S]) < 1e-9 * np.linalg.norm(rnea)
    assert balanced == (len(S) <= 3) == result.can_stand_still
    if balanced:
        assert_close(result.force.after, after, scale=100)
        assert_close(result.torque.after, result.J.T @ after, scale=100)
        assert result.modes == {panda.names[i]: ftforce.FaultMode.FREE for i in S}
        return
    assert result.force.after is result.force.jump is result.force.jump_norm is None
    torque = result.torque
    assert torque.after is torque.total_after is torque.brake_load is None
    assert_close(torque.total_before, rnea + result.J.T @ FORCE)
    assert result.verdict is Verdict.NOT_TOLERATED
    assert dict(result.residuals()) == {}


def test_a_weak_joint_without_limits_counts_as_healthy_and_is_named(panda):
    result = analyze(panda, POSTURE, force=[5, 3, 1], weak={2: 0.01}, limits="none")
    assert result.limits is None
    assert_close(result.force.jump, 0.0, scale=100)
    assert result.warnings == (
        "joint 2 panda_joint2 is weak, but no limits are enforced: it is treated as healthy",
    )
    unknown = Limits.of(np.where(np.arange(7) == 1, np.nan, panda.effort))
    other = analyze(panda, POSTURE, force=[5, 3, 1], weak={2: 0.01}, limits=unknown)
    assert other.unknown_limits == (1,)
    assert other.warnings == (
        "joint 2 panda_joint2 is weak, but its torque limit is unknown and is not enforced",
    )
    nothing = analyze(panda, POSTURE, force=[5, 3, 1], weak={2: 0.0}, limits="none")
    free = analyze(panda, POSTURE, force=[5, 3, 1], free=2)
    assert_close(nothing.force.after, free.force.after)
    assert nothing.verdict is free.verdict


def test_weight_alone_overloads_and_the_tip_keeps_the_arm_still(panda):
    low = Limits.of(np.where(np.arange(7) == 3, 1.0, panda.effort))
    result = analyze(panda, POSTURE, force=[0, 0, 0], limits=low)
    assert abs(result.rnea.gravity[3]) > 1.0
    assert result.can_stand_still
    assert np.linalg.norm(result.force.after) > 1.0
    assert_close(abs(result.torque.total_after[3]), 1.0)
    (warning,) = result.warnings
    assert warning.startswith(
        "gravity and motion torques alone overload panda_joint4: only the tip force"
    )
    nowhere = analyze(panda, POSTURE, limits=Limits.of(np.full(7, 0.1)), force=FORCE)
    assert not nowhere.can_stand_still
    assert nowhere.force.after is None


def test_unit_forces_of_free_joints_leave_the_weight_apart(panda):
    result = analyze(panda, POSTURE, free=6, **MOTION)
    lever = result.J[:, 5]
    for unit, (force, torque) in zip(np.eye(3), result.unit_forces, strict=True):
        assert_close(force.after, unit - lever * (lever @ unit) / (lever @ lever), scale=1.0)
        assert_close(torque.after, result.J.T @ force.after, scale=1.0)
        assert torque.total_after is None


# ---- verdicts and warnings -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("little", "verdict"),
    [
        (0.5, Verdict.TOLERATED),
        (1e-3, Verdict.BORDERLINE),
        (1e-5, Verdict.BORDERLINE),
        (1e-7, Verdict.NOT_TOLERATED),
        (0.0, Verdict.NOT_TOLERATED),
    ],
)
def test_verdict_near_a_stretched_posture(little, verdict):
    arm, q = stretched(little)
    assert analyze(arm, q).verdict is Verdict.TOLERATED
    assert analyze(arm, q, locked=4).verdict is verdict
    radial = np.linalg.svd(analyze(arm, [*q[:2], 0.0, 0.0], locked=4).reduced.K)[0][:, 2]
    assert analyze(arm, q, locked=4, force=9.0 * radial).verdict is verdict
    square = np.cross(radial, [1, 2, 3])
    assert analyze(arm, q, locked=4, force=square).verdict is not Verdict.NOT_TOLERATED


def test_tolerances_are_passed_on():
    arm, q = stretched(1e-4)
    margin = analyze(arm, q, locked=4).margin
    assert 1e-6 < margin < 1e-2
    assert analyze(arm, q, locked=4, wary=margin / 2).verdict is Verdict.TOLERATED
    assert analyze(arm, q, locked=4).verdict is Verdict.BORDERLINE
    coarse = analyze(arm, q, locked=4, rtol=2 * margin)
    assert coarse.reduced.rtol == 2 * margin
    assert coarse.reduced.rank_after == 2
    assert coarse.wary == 1e-2


def test_torques_beyond_the_effort_limits_are_warned_about(dh5):
    result = analyze(dh5, locked=3, force=np.array(FORCE) * 6.0)
    assert result.warnings == (
        "joint 1 joint1 would need 140% of its effort limit of 150 N·m (limits are not enforced)",
        "joint 4 joint4 would need 150% of its effort limit of 40 N·m (limits are not enforced)",
        "joint 5 joint5 would need 120% of its effort limit of 20 N·m (limits are not enforced)",
    )


def test_an_unknown_effort_limit_is_never_exceeded():
    arm = load_text(serial_urdf(("revolute", {"effort": 0}), ("prismatic", {"effort": 5})))
    result = analyze(arm, [0.1, 0.2], force=[900, 900, 900])
    (warning,) = [w for w in result.warnings if "effort" in w]
    assert warning.startswith("joint 2 j2 would need")
    assert warning.endswith("of 5 N (limits are not enforced)")


# ---- results that prove and keep themselves --------------------------------------------------


@pytest.fixture
def result(dh5):
    return analyze(
        dh5, locked=[2, 4, 5], force=FORCE, velocity=[1, 2, 3, 4, 5], task="force", axes="tool"
    )


def test_a_good_result_proves_itself(result):
    laws = result.residuals()
    assert {"orthogonality", "uncommandable", "statics", "unchanged"} <= set(laws)
    assert_close(list(laws.values()), 0.0, tol=1e-13)
    assert result.is_proved(1e-13)


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ("force", "before"),
        ("force", "after"),
        ("force", "jump"),
        ("torque", "before"),
        ("torque", "after"),
        ("torque", "self_motion"),
    ],
)
@pytest.mark.parametrize("factor", [1.01, -1.0])
def test_a_tampered_result_cannot_prove_itself(dh5, part, name, factor):
    tau = analyze(dh5, force=FORCE).torque.before + np.array([1, -1, 1, -1, 2])
    result = analyze(dh5, locked=[2, 4, 5], torque=tau)
    assert result.is_proved()
    change = getattr(result, part)
    tampered = replace(change, **{name: factor * getattr(change, name)})
    assert not replace(result, **{part: tampered}).is_proved()


def test_tampered_unit_forces_are_found(dh5):
    result = analyze(dh5, locked=3)
    assert result.is_proved()
    force, torque = result.unit_forces[1]
    wrong = (force, replace(torque, after=torque.after * 1.1))
    units = (result.unit_forces[0], wrong, result.unit_forces[2])
    assert not replace(result, unit_forces=units).is_proved()


@pytest.mark.parametrize(
    "options",
    [
        {"force": FORCE},
        {"torque": [1, 2, 3, 4, 5]},
        {},
        {"task": "wrench", "length": 0.3, "axes": "world"},
    ],
    ids=str,
)
@pytest.mark.parametrize("locked", [[], [2, 4, 5]], ids=str)
def test_results_are_read_only(dh5, options, locked):
    result = analyze(dh5, locked=locked, velocity=[1, 2, 3, 4, 5], **options)
    named = [*arrays_in(result), ("J", result.reduced.J), ("K", result.reduced.K)]
    assert len(named) > 12
    assert [name for name, array in named if array.flags.writeable] == []
    assert not result.lost_directions.flags.writeable
    for part in (result, result.velocity, result.posture, result.task):
        with pytest.raises(FrozenInstanceError):
            setattr(part, fields(part)[0].name, None)


@pytest.mark.parametrize("duplicate", [copy.copy, lambda x: pickle.loads(pickle.dumps(x))])
def test_results_can_be_copied_and_pickled(result, duplicate):
    assert result.lost_directions is not None  # also with what was computed on demand
    again = duplicate(result)
    pairs = zip(arrays_in(result), arrays_in(again), strict=True)
    for (name, array), (other_name, other) in pairs:
        assert name == other_name
        np.testing.assert_array_equal(array, other)
    assert (again.verdict, again.locked) == (result.verdict, result.locked)
    assert again.margin == pytest.approx(result.margin)
    assert again.is_proved()


def test_threads_do_not_disturb_each_other(panda):
    postures = np.random.default_rng(2).uniform(-1, 1, size=(100, 7))

    def solve(q):
        result = analyze(panda, q, locked=[1, 2, 3, 4, 5], torque=np.arange(7.0))
        return np.concatenate([result.force.before, result.force.jump, result.torque.after])

    alone = [solve(q) for q in postures]
    with eager_threads() as pool:
        together = list(pool.map(solve, postures))
    np.testing.assert_array_equal(alone, together)


def test_residuals_of_an_enormous_force():
    """The product of jump and force after it, about 1e284, is not squared."""
    arm = ftforce.load_robot("panda")
    result = analyze(arm, locked=[1, 2, 4, 6, 7], force=[1e150, -14, 44])
    with np.errstate(over="raise"):
        assert result.residuals()["orthogonality"] < 1e-10
