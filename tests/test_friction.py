"""Friction of free-swinging joints: where no force has a lever, it decides (theory §4)."""

import json
import math

import mujoco
import numpy as np
import pytest
import quadprog
from hypothesis import given, settings
from numba import njit

import ftforce
import physics
import urdfs
from ftforce import analyze, capability, census, load_robot
from ftforce.analysis.friction import choose_friction
from ftforce.batch.kernels import slabs
from ftforce.batch.kernels.layout import aligned_arrays
from ftforce.batch.remapper import Remapper
from ftforce.core.bounded_remap import bounded_remap
from ftforce.core.feasible_forces import LockModel, feasible_forces, reach
from ftforce.core.limits import Limits
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, FreeJoints, reduce
from ftforce.core.verdict import VERDICTS
from ftforce.errors import InputError, LimitsError
from ftforce.report.analysis import verdict_sentence
from helpers import assert_close, campaign, seeds
from test_cli import run

law = settings(deadline=None, max_examples=campaign(150, 60))
DOWN = [0.0, 0.0, -50.0]


@pytest.fixture(scope="module")
def panda():
    return load_robot("panda")


@pytest.fixture(scope="module")
def so101():
    return load_robot("so101")


# ---- how much of it there is -------------------------------------------------------------------


def with_friction(text):
    return urdfs.j2(more=f"<dynamics {text}/>")


def test_where_friction_comes_from(tmp_path):
    plain = load_robot(urdfs.write(tmp_path, with_friction('damping="1" friction="0.3"')))
    found = choose_friction(plain, None, None)
    assert_close(found.torque, [0.01, 0.3, 0.01, 0.01])  # 0.1 % of 10 N·m, and the URDF's own
    words = "j1 0.01 N·m (0.1 % of the effort limit); j2 0.3 N·m (the URDF)"
    assert found.in_words(plain, [0, 1]) == words
    limits = Limits.of([20.0, math.nan, math.nan, 50.0])
    assert_close(choose_friction(plain, None, limits).torque, [0.02, 0.3, 0.01, 0.05])
    assert_close(choose_friction(plain, 0.5, limits).torque, [0.5] * 4)
    assert_close(choose_friction(plain, "0", None).torque, [0.0] * 4, scale=1.0)
    each = choose_friction(plain, [1.0, math.nan, 0.0, math.nan], None)
    assert_close(each.torque, [1.0, 0.3, 0.0, 0.01])


@pytest.mark.parametrize("text", ['friction="0"', 'friction="-1"', 'damping="2"'])
def test_friction_of_zero_or_less_is_unknown(tmp_path, text):
    assert np.isnan(load_robot(urdfs.write(tmp_path, with_friction(text))).friction).all()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("f.csv", "joint,friction\nj2,0.2\nj4,0\n"),
        ("f.csv", "joint,effort,friction\nj2,5,0.2\nj4,,0\n"),
        ("f.toml", "[j2]\nfriction = 0.2\n[j4]\nfriction = 0\n"),
    ],
)
def test_friction_from_a_file(tmp_path, name, text):
    plain = load_robot(urdfs.write(tmp_path, urdfs.arm()))
    (tmp_path / name).write_text(text)
    found = choose_friction(plain, tmp_path / name, None)
    assert_close(found.torque, [0.01, 0.2, 0.01, 0.0])
    assert found.sources[1] == str(tmp_path / name)


@pytest.mark.parametrize(
    ("given_friction", "said"),
    [
        (-1.0, "at least 0"),
        ("-0.5", "at least 0"),
        (math.inf, "at least 0"),
        ([1.0, 2.0], "friction"),
        ("much", "expected a number"),
    ],
)
def test_friction_that_is_none(panda, given_friction, said):
    with pytest.raises((InputError, LimitsError), match=said):
        analyze(panda, free=7, friction=given_friction)


def test_a_file_with_negative_friction(tmp_path, panda):
    (tmp_path / "f.csv").write_text("joint,friction\n7,-0.1\n")
    with pytest.raises(LimitsError, match="panda_joint7 must be a number of at least 0"):
        analyze(panda, free=7, friction=tmp_path / "f.csv")


# ---- the closest force -------------------------------------------------------------------------


def draw_short_levers(rng):
    """Draw a Jacobian some of whose columns are short, free joints among them, and a force."""
    m = int(rng.integers(1, 5))
    n = int(rng.integers(m + 1, 9))
    J, free = rng.normal(size=(m, n)), np.zeros(n, bool)
    free[rng.choice(n, int(rng.integers(1, min(n - 1, 4) + 1)), replace=False)] = True
    short = free & (rng.random(n) < 0.7)
    J[:, short] *= 10.0 ** rng.uniform(-5.0, -2.3, size=short.sum())
    friction = 10.0 ** rng.uniform(-3.0, -1.0, size=n)
    rnea = rng.normal(size=n) * np.where(short, friction, 3.0) * rng.choice([0.3, 1.0])
    return J, free, friction, rnea, rng.normal(size=m) * 10.0 ** rng.uniform(0.0, 2.0)


def nearest_by_quadprog(J, free, friction, rnea, F):
    """Return the closest force, written as the theory has it; ``None`` if there is none."""
    scale = np.linalg.norm(J, 2)
    U, s, Vt = np.linalg.svd(J[:, free].T)
    lever = s > BORDERLINE_RTOL * scale
    E, e = Vt[: len(s)][lever], -(U.T @ rnea[free])[: len(s)][lever] / s[lever]
    if lever.sum() == free.sum():
        A, low, high = np.zeros((0, len(F))), np.zeros(0), np.zeros(0)
    else:
        A, w, most = J[:, free].T, rnea[free], friction[free]
        size = np.linalg.norm(A, axis=1)
        A, low, high = A / size[:, None], (-most - w) / size, (most - w) / size
    motors = np.vstack([J[:, ~free].T / scale, E])  # what neither commands nor balances is lost
    _, t, right = np.linalg.svd(motors)
    beyond = right[np.count_nonzero(t > 1e-6) :]
    C = np.vstack([E, beyond, A, -A])
    b = np.concatenate([e, np.zeros(len(beyond)), low, -high])
    size = max(np.abs(F).max(), np.abs(e).max(initial=0.0))
    try:
        first = len(E) + len(beyond)
        return size * quadprog.solve_qp(np.eye(len(F)), F / size, C.T, b / size, first)[0]
    except ValueError:
        return None


@given(seeds)
@law
def test_the_closest_force_beside_quadprog(seed):
    J, free, friction, rnea, F = draw_short_levers(np.random.default_rng(seed))
    whole = np.linalg.norm(rnea)
    friction = np.maximum(friction, 1e-6 * whole)
    result = bounded_remap(
        J, J.T @ F, np.zeros(len(free), bool),
        limits=np.full(len(free), np.nan), free=free, friction=friction, rnea=rnea,
    )  # fmt: skip
    F = result.nearest.F
    lever, scale = J[:, free].T @ F, np.linalg.norm(J, 2)
    if np.linalg.svd(J[:, free], compute_uv=False)[-1] < 3e-6 * scale:
        return  # next to no lever counts as none
    is_short = np.abs(lever) <= BORDERLINE_RTOL * scale * np.linalg.norm(F)
    wanted = nearest_by_quadprog(J, free, friction, rnea, F)
    J_H = J[:, ~free]
    is_commanded = np.linalg.norm(F - J_H @ np.linalg.pinv(J_H) @ F) <= 1e-7 * np.linalg.norm(F)
    if is_commanded and (is_short & (np.abs(lever + rnea[free]) <= friction[free])).all():
        wanted = F
    assert (result.F_after is None) == (wanted is None)
    if wanted is not None:
        size = np.linalg.norm(F) + np.linalg.norm(wanted)
        assert_close(result.F_after, wanted, scale=size, tol=1e-6)


@njit
def nearest_in_slabs(work, z):  # kernels have no wrapper of their own
    return slabs.nearest(work, z, 1e-9)


@given(seeds)
@law
def test_slabs_beside_quadprog(seed):
    rng = np.random.default_rng(seed)
    m, k = int(rng.integers(1, 7)), int(rng.integers(1, 8))
    rows, middle = rng.normal(size=(k, m)), rng.normal(size=k)
    if rng.random() < 0.3:
        rows[-1] = rng.choice([1.0, -2.0]) * rows[0]  # parallel ones
    width = 10.0 ** rng.uniform(-3.0, 0.5, size=k)
    w = 3.0 * rng.normal(size=m)
    work = slabs.Slabs(*aligned_arrays(slabs.shapes(m, k)))
    work.rows[:], work.middle[:], work.width[:] = rows.T, middle, width
    z = w.copy()
    found = nearest_in_slabs(work, z)
    try:
        sides = np.concatenate([middle - width, -middle - width])
        wanted = quadprog.solve_qp(np.eye(m), w, np.vstack([rows, -rows]).T, sides)[0]
    except ValueError:
        wanted = None
    assert found == (wanted is not None)
    if found:
        assert_close(z, wanted, scale=1.0 + np.abs(wanted).max(), tol=1e-8)


def test_a_slab_by_hand():
    # Joint 2 has a lever of 0.005 m for fx, which moves it by at most 0.1 N·m: 20 N are left.
    J = np.array([[1.0, 0.005, 0.0], [0.0, 0.0, 1.0]])
    asked = {"limits": [math.nan] * 3, "free": [False, True, False], "locked": [False] * 3}
    result = bounded_remap(J, J.T @ [50.0, 7.0], friction=[0.1] * 3, **asked)
    assert_close(result.F_after, [20.0, 7.0])
    assert_close(result.feasible.bearings.torque(result.F_after), [0.1])
    ideal = bounded_remap(J, J.T @ [50.0, 7.0], **asked)
    assert_close(ideal.F_after, [0.0, 7.0], scale=1.0)
    kept = bounded_remap(J, J.T @ [15.0, 7.0], friction=[0.1] * 3, **asked)
    assert_close(kept.F_after, [15.0, 7.0])


def test_more_weight_than_friction_bears():
    J = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # no force has a lever at joint 2
    asked = {"limits": [math.nan] * 3, "free": [False, True, False], "locked": [False] * 3}
    for weight, stands in ((0.099, True), (0.101, False)):
        rnea = [1.0, weight, 0.0]
        result = bounded_remap(J, [1.0, 0.0, 1.0], friction=[0.1] * 3, rnea=rnea, **asked)
        assert (result.F_after is not None) is stands
        assert result.feasible.is_balanced is stands


# ---- rays --------------------------------------------------------------------------------------


@given(seeds)
@law
def test_rays_by_hand(seed):
    """The largest s is that of the joint which yields first; a joint with a lever fixes s."""
    rng = np.random.default_rng(seed)
    J, free, friction, rnea, d = draw_short_levers(rng)
    friction = np.maximum(friction, 1e-6 * np.linalg.norm(rnea))
    joints = FreeJoints.of(free, friction, BORDERLINE_RTOL)
    reduced = reduce(J, np.zeros(len(free), bool), 1e-6, joints)
    ray = reach(feasible_forces(reduced, rnea, None, LockModel.HELD), d)
    scale, size = np.linalg.norm(J, 2), np.linalg.norm(d)
    low, high, rests = 0.0, math.inf, (np.abs(rnea) <= friction)[free].all()
    lever = J.T @ d
    long = free & (np.abs(lever) > BORDERLINE_RTOL * scale * size)
    for k in np.flatnonzero(free & ~long):
        x, w, most = lever[k], rnea[k], friction[k]
        if abs(x) <= 1e-6 * scale * size:
            low, high = (low, high) if abs(w) <= most else (1.0, 0.0)
        else:
            ends = sorted([(-most - w) / x, (most - w) / x])
            low, high = max(low, ends[0]), min(high, ends[1])
    if long.any():
        weight = np.where(np.abs(rnea) <= 1e-3 * friction, 0.0, rnea)  # next to nothing
        s = -(lever[long] @ weight[long]) / (lever[long] @ lever[long])
        if s < 0.0 or (np.abs(s * lever + weight) > friction)[long].any():
            s = 0.0 if rests else -1.0
        low, high = max(low, s), min(high, s)
    _, sigma, _ = np.linalg.svd(J[:, free])
    if free.sum() > np.count_nonzero(sigma > 1e-6 * scale):
        return  # a combination that no force moves is judged apart
    assert ray.is_empty == (high < low)
    if not ray.is_empty:
        assert_close([ray.minimum, min(ray.maximum, 1e9)], [low, min(high, 1e9)], tol=1e-9)


# ---- one description for every answer ----------------------------------------------------------


def test_the_commands_of_the_issue(panda, so101):
    for arm, free, force in ((panda, [1, 7], DOWN), (so101, [1], [0, 0, -5]), (panda, [7], DOWN)):
        result = analyze(arm, free=free, force=force, axes="world")
        assert result.verdict.value == "tolerated"
        assert result.bounded.share == 1.0
        held = capability(arm, free=free, direction=force, axes="world", limits="urdf")
        asked = held.directions[-1]
        assert asked.after["commanded"].maximum >= np.linalg.norm(force)
        assert asked.after["commanded"].minimum == 0.0


def test_what_an_answer_relies_on_is_said(panda):
    payload = (1.0, (0.02, 0.0, 0.0))  # its lever about joint 7 is 2 cm where the axis is level
    q = [0.0, -0.785, 0.0, -2.356, 0.0, 3.1, 0.785]
    result = analyze(panda, q, free=7, payload=payload, force=[0, 0, 20], friction=0.5)
    torque = result.rnea.after[6]
    assert 0.02 < abs(torque) < 0.5
    words = run("analyze", "panda", "--q", ",".join(map(str, q)), "--free", "7", "--payload",
        "1@0.02,0,0", "--force", "0,0,20", "--friction", "0.5").output  # fmt: skip
    assert "Friction  panda_joint7 0.5 N·m (given)" in words
    assert f"{abs(torque):.3g} N·m of friction in panda_joint7 holds it" in " ".join(words.split())
    falls = analyze(panda, q, free=7, payload=payload, force=[0, 0, 20], friction=0.01)
    assert not falls.can_stand_still
    assert "nor friction (at most 0.01 N·m) balances that" in verdict_sentence(falls)


@pytest.mark.thorough  # compiles
@pytest.mark.parametrize("name", ["panda", "so101", "dh5", "ur5"])
def test_analyze_capability_census_sweep_and_remapper_agree(name):
    arm, rng = load_robot(name), np.random.default_rng(3)
    lower, upper = arm.ranges
    force = np.array([0.0, 0.0, -7.0])
    q = lower + rng.random((4, arm.n)) * (upper - lower)
    swept = ftforce.sweep(arm, q, mode="free", force=force, axes="world", keep="all").dataset
    remapper = Remapper(arm, 1, mode="free", axes="world")
    for at, one in enumerate(q):
        counted = census(arm, one, mode="free", force=force, axes="world", rank_by="capability")
        fast = remapper(one, force=force)
        for s in range(arm.n):
            result = analyze(arm, one, free=s + 1, force=force, axes="world")
            held = capability(arm, one, free=s + 1, direction=force, axes="world")
            report = next(x for x in counted.sets if x.faults.joints == (s,))
            most = held.directions[-1].after["commanded"].maximum
            assert VERDICTS[fast.verdict[s]] is result.verdict
            assert VERDICTS[int(swept.verdict[at, s])] is result.verdict
            assert_close(report.capability.commanded, most, scale=1.0)
            assert_close(float(swept.capability[at, s]), most, scale=1.0, tol=1e-6)
            if result.bounded.F_after is not None and result.verdict.value == "tolerated":
                # what is tolerated without limits ends at a motor's limit at most
                free_of_limits = reach(result.bounded.feasible, force)
                assert free_of_limits.minimum <= 1.0 + 1e-6 <= free_of_limits.maximum + 2e-6


@pytest.mark.parametrize("friction", [None, 3.0])
def test_the_whole_force_is_held_if_and_only_if_nothing_jumps(panda, friction):
    rng, seen = np.random.default_rng(5), set()
    lower, upper = panda.ranges
    asked = {"force": [0, 0, -5], "axes": "world", "friction": friction}
    for q in lower + rng.random((12, 7)) * (upper - lower):
        for joint in range(1, 8):
            result = analyze(panda, q, free=joint, **asked)
            if result.force.after is None:
                continue
            is_kept = result.force.jump_norm <= 1e-6 * 5.0
            assert is_kept == (result.bounded.share == 1.0) == (result.verdict.value == "tolerated")
            seen.add((is_kept, result.bounded.share))
    assert {True, False} == {kept for kept, _ in seen}


def test_an_answer_that_friction_holds_proves_itself():
    """Joint 5 of dh5 has a lever, but asks for no force: its friction bears what weighs on it."""
    arm = load_robot("dh5")
    asked = {"free": [5], "task": "fx,fz", "axes": "world", "limits": "urdf"}
    found = analyze(arm, gravity=[4.9, -1.1, -3.1], **asked)
    weight = abs(found.rnea.after[4])
    assert 1e-3 < weight < choose_friction(arm, None, None).torque[4]
    assert found.can_stand_still
    assert found.residuals()["equality"] < 1e-12
    assert found.is_proved()


def test_an_arm_of_unknown_weight_has_ideal_joints(tmp_path):
    bare = urdfs.robot(
        *(urdfs.link(name, "") for name in urdfs.LINKS),
        *(
            urdfs.joint(f"j{i + 1}", *urdfs.LINKS[i : i + 2], axis=axis,
                        limit='<limit lower="-1" upper="2" effort="0" velocity="1"/>')
            for i, axis in enumerate(urdfs.AXES)
        ),
    )  # fmt: skip
    arm = load_robot(urdfs.write(tmp_path, bare))
    result = analyze(arm, free=2, force=[1, 2, 3])
    assert "unknown: neither friction nor" in result.question.friction.in_words(arm, [1])
    assert "friction" not in verdict_sentence(result)


def test_friction_of_zero_is_the_ideal_joint(panda):
    q = [0.3, -0.6, 0.2, -2.0, 0.4, 1.8, 0.785]
    ideal = analyze(panda, q, free=4, force=DOWN, friction=0)
    usual = analyze(panda, q, free=4, force=DOWN)
    assert_close(ideal.force.after, usual.force.after)  # a joint with a lever does not care
    alone = analyze(panda, q, free=7, force=DOWN, friction=0, payload=(1.0, (0.05, 0.0, 0.0)))
    assert not alone.can_stand_still  # the smallest torque makes an ideal joint fall


# ---- beside a physics engine -------------------------------------------------------------------


@pytest.mark.parametrize(("share", "holds"), [(0.8, True), (1.25, False)])
def test_a_joint_without_a_lever_slips_beyond_its_friction(panda, share, holds):
    q = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 3.1, 0.785])
    load = physics.Payload(1.0, (0.02, 0.0, 0.0))
    asked = {"force": [0.0, 0.0, 20.0], "payload": (load.mass, load.com), "free": 7}
    friction = abs(analyze(panda, q, **asked).rnea.after[6]) / share
    result = analyze(panda, q, friction=friction, **asked)
    assert result.can_stand_still is holds
    tau = result.rnea.after + result.J.T @ asked["force"]
    tau[6] = 0.0
    model, data, _ = physics.simulate(panda, q, pin=True, payload=load)
    model.dof_frictionloss[6] = friction
    model.opt.iterations = 100  # friction is an inequality
    data.qfrc_applied[:] = tau
    for _ in range(1000):
        mujoco.mj_step(model, data)
    drift = float(np.abs(data.qpos - q).max())
    assert (drift < 1e-3) is holds, drift


def test_json_and_options_of_every_command(tmp_path):
    for command in (["analyze", "panda", "--free", "7", "--force", "0,0,50"],
                    ["capability", "panda", "--free", "7"],
                    ["census", "panda", "--mode", "free", "--force", "0,0,50"]):  # fmt: skip
        output = run(*command, "--friction", "0.2", "--format", "json").output
        json.loads(output)
    found = json.loads(run("analyze", "panda", "--free", "7", "--format", "json").output)
    borne = found["standing"]["friction"]["panda_joint7"]
    assert borne["limit"] == 0.012
    assert borne["source"] == "0.1 % of the effort limit"
    assert borne["torque"] == pytest.approx(2.94e-6, rel=0.01)


# ---- damping and armature -----------------------------------------------------------------------

_DRAKE = (
    '<transmission><type>transmission_interface/SimpleTransmission</type><joint name="j2"/>'
    '<actuator name="m"><{0}gear_ratio value="100"/><{0}rotor_inertia value="2e-5"/></actuator>'
    "</transmission>"
)


@pytest.mark.parametrize("prefix", ["", "drake:"])
def test_damping_and_armature_of_a_urdf(tmp_path, prefix):
    text = with_friction('damping="1.5" friction="0.3" armature="0.25"')
    robot = load_robot(urdfs.write(tmp_path, text))
    assert robot.damping[1] == 1.5
    assert robot.armature[1] == 0.25
    assert np.isnan(robot.damping[[0, 2, 3]]).all()
    assert np.isnan(robot.armature[[0, 2, 3]]).all()
    end = _DRAKE.format(prefix) + "</robot>"
    geared = load_robot(urdfs.write(tmp_path, with_friction("").replace("</robot>", end)))
    assert_close(geared.armature[1], 2e-5 * 100**2)
    both = load_robot(urdfs.write(tmp_path, text.replace("</robot>", end)))
    assert both.armature[1] == 0.25  # what the joint itself says precedes


def test_malformed_damping_counts_as_unknown(tmp_path):
    robot = load_robot(urdfs.write(tmp_path, with_friction('damping="much" armature="-1"')))
    assert np.isnan(robot.damping).all()
    assert np.isnan(robot.armature).all()
    assert any("damping" in note and "unknown" in note for note in robot.notes)


def test_followers_brake_their_leader(tmp_path):
    follower = urdfs.joint(
        "j3", "l2", "l3",
        more='<dynamics damping="0.5" friction="0.2" armature="3"/>'
        '<mimic joint="j2" multiplier="-2"/>',
    )  # fmt: skip
    dynamics = '<dynamics damping="1" friction="0.3" armature="0.25"/>'
    text = urdfs.arm(j2=urdfs.joint("j2", "l1", "l2", more=dynamics), j3=follower)
    robot = load_robot(urdfs.write(tmp_path, text))
    assert_close(robot.friction[1], 0.3 + 2 * 0.2)
    assert_close(robot.damping[1], 1 + 4 * 0.5)
    assert_close(robot.armature[1], 0.25 + 4 * 3)
