"""Joint paths that keep the most after the worst fault at the worst instant."""

import json

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import ftforce
import physics
from ftforce.analysis.question import AllFaultSets
from ftforce.core.limits import Limits
from ftforce.planning.objective import MEASURES, Objective
from ftforce.planning.path import plan
from ftforce.planning.projection import project
from ftforce.planning.search import TIP_TOLERANCE
from ftforce.planning.target import TipTarget
from ftforce.trajectory import Path, Recording
from test_cli import run
from test_self_motion import planar

LIMITS = Limits(np.full(3, 10.0), np.full(3, 10.0), "given")
LINE = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1)
POSE = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1, keep_orientation=True)


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


@pytest.fixture(scope="module")
def posed(panda):
    """A plan that keeps the whole pose of the tip."""
    return plan(panda, POSE, waypoints=15)


def pinocchio_poses(arm, q):
    """Return the poses of the tip by Pinocchio alone."""
    data = arm.model.createData()
    for one in q:
        pin.framesForwardKinematics(arm.model, data, one)
        yield data.oMf[arm.tip_frame].copy()


def test_tip_stays_on_its_path_between_the_instants_too(panda, posed):
    from scipy.interpolate import CubicSpline

    t = np.linspace(0.0, posed.t[-1], 400)
    start = next(pinocchio_poses(panda, posed.before.q[:1])).rotation
    for time, pose in zip(t, pinocchio_poses(panda, CubicSpline(posed.t, posed.after.q)(t)),
                          strict=True):  # fmt: skip
        assert np.linalg.norm(pose.translation - POSE.at(time)[0]) <= TIP_TOLERANCE
        assert np.linalg.norm(pin.log3(start.T @ pose.rotation)) <= TIP_TOLERANCE
    assert posed.tip_error <= TIP_TOLERANCE


def test_motion_stays_within_position_and_velocity_limits(panda, posed):
    velocity = np.array([joint.velocity for joint in panda.joints])
    assert (posed.after.q >= panda.lower).all()
    assert (posed.after.q <= panda.upper).all()
    assert (np.abs(posed.motion().v) <= velocity * (1.0 + 1e-9)).all()
    assert_allclose(posed.motion().v[1:-1], np.gradient(posed.after.q, posed.t, axis=0)[1:-1],
                    atol=5e-3)  # fmt: skip


def test_values_are_those_of_a_census(panda, posed):
    for i in (0, len(posed.t) // 2, posed.worst_of(posed.after)):
        census = ftforce.census(panda, posed.after.q[i])
        margins = {one.faults: one.margin for one in census.sets}
        assert posed.after.value[i] == pytest.approx(min(margins.values()), rel=1e-9)
        worst = posed.sets[posed.after.worst_set[i]]
        assert margins[worst] == pytest.approx(posed.after.value[i], rel=1e-9)


def test_no_posture_of_a_dense_search_does_much_better(panda, posed):
    """At the worst instant, thousands of random postures with the same pose are not better."""
    i = posed.worst_of(posed.after)
    pose = next(pinocchio_poses(panda, posed.after.q[i : i + 1]))
    target = TipTarget.of(pose.translation, pose.rotation)
    rng = np.random.default_rng(1)
    seeds = panda.lower + rng.random((1500, 7)) * (panda.upper - panda.lower)
    q, reached = project(panda, seeds, target)
    best = posed.objective.values(q[reached]).max()
    assert posed.after.value[i] >= 0.96 * best
    assert posed.before.value.min() < 0.6 * posed.after.value.min()


@pytest.mark.thorough
def test_freedom_to_turn_the_tip_costs_nothing(panda, posed):
    """A path that keeps the orientation is one of those that need not."""
    found = plan(panda, LINE, waypoints=15)
    assert found.after.value.min() >= 0.98 * posed.after.value.min()
    best = [
        ftforce.best_posture(panda, at, restarts=16).measured_after.min()
        for at in ((0.5, -0.1, 0.4), (0.5, 0.1, 0.4))
    ]
    assert found.after.value.min() >= 0.93 * min(best)


@pytest.mark.parametrize("name", MEASURES)
def test_every_measure_is_at_least_that_of_the_usual_path(panda, name):
    asked = {"force": [0, 0, 50], "task": "wrench"} if name == "rho" else {"direction": [0, 0, 1]}
    if name == "jump":
        asked = {"force": [0, 0, 50, 0, 0, 3], "task": "wrench"}
    if name == "rho":
        asked = {"task": "wrench"}
    found = plan(panda, POSE, maximize=name, waypoints=8, faults=1, **asked)
    sign = -1.0 if MEASURES[name].is_cost else 1.0
    assert (sign * found.after.value).min() >= (sign * found.before.value).min() - 1e-9
    assert found.breaks.slow_down == 1.0


def test_payload_is_that_of_the_capability(panda):
    objective = Objective.parse(panda, "payload", AllFaultSets.parse(panda, 1, "locked"))
    q = panda.postures["default"]
    one = ftforce.capability(panda, q, locked=[4]).payload[1]
    assert objective.measured(q[None])[0, 3] == pytest.approx(one.maximum, rel=1e-9)


def test_what_nothing_bounds_is_told():
    arm = planar()
    line = Path.through([(2.0, 0.0, 0.0), (1.0, 1.5, 0.0)], speed=0.5)
    with pytest.raises(ftforce.FtforceError, match="the payload is unbounded along the whole path"):
        plan(arm, line, task=["fx", "fy"], maximize="payload", limits=LIMITS, waypoints=6)


def test_a_path_that_is_too_fast_tells_where_and_how_much(panda):
    fast = Path.through([(0.5, -0.3, 0.4), (0.5, 0.3, 0.4)], speed=20.0, keep_orientation=True)
    found = plan(panda, fast, waypoints=6, rate=1000)
    assert found.breaks.waypoints
    assert any("the usual path leaves the tool path by up to" in note for note in found.notes)
    assert found.breaks.slow_down > 1.0
    assert found.t[-1] == pytest.approx(fast.duration * found.breaks.slow_down, rel=0.02)
    velocity = np.array([joint.velocity for joint in panda.joints])
    assert (np.abs(found.motion().v) <= velocity * (1.0 + 1e-9)).all()


@pytest.mark.thorough
def test_accelerations_are_kept(panda):
    usual = plan(panda, LINE, waypoints=8)
    most = 0.3 * np.abs(usual.motion().a).max()
    found = plan(panda, LINE, waypoints=8, max_acceleration=most)
    assert (np.abs(found.motion().a) <= most * (1.0 + 1e-6)).all()


def test_start_is_kept(panda):
    found = plan(panda, LINE, waypoints=8, keep_start=True)
    assert_allclose(found.after.q[0], found.before.q[0], atol=1e-8)


def test_a_recording_gives_the_path_of_its_tip(panda, posed):
    recording = Recording.of(panda, posed.t, posed.before.q)
    found = plan(panda, recording, waypoints=8, keep_orientation=True)
    assert found.keeps_orientation
    for a, b in zip(pinocchio_poses(panda, found.after.q[:: 4]),
                    pinocchio_poses(panda, found.before.q[:: 4]), strict=True):  # fmt: skip
        assert np.linalg.norm(pin.log6(a.inverse() * b).vector) < 1e-4


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"waypoints": 1}, r"waypoints must be an integer from 2 to 10,000, got 1"),
        ({"maximize": "speed"}, r"measure to maximize 'speed'"),
        ({"maximize": "jump"}, r"the jump is that of a force: give one"),
        ({"maximize": "capability"}, r"needs a direction or a force"),
        ({"maximize": "payload", "limits": "none"}, r"bounded by torque limits"),
        ({"maximize": "payload", "gravity": [0, 0, 0]}, r"a payload weighs nothing"),
        ({"max_acceleration": -1.0}, r"accelerations must be positive"),
    ],
)
def test_a_malformed_question_is_one_clear_line(panda, asked, message):
    with pytest.raises(ftforce.FtforceError, match=message):
        plan(panda, LINE, **asked)


@pytest.mark.thorough
def test_a_waypoint_out_of_reach_tells_how_far(panda):
    far = Path.through([(0.5, 0.0, 0.4), (1.2, 0.0, 0.4)], speed=0.1)
    with pytest.raises(ftforce.FtforceError, match=r"waypoint \d of 6, .* misses it by .* m"):
        plan(panda, far, waypoints=6)


def test_command_writes_what_simulate_reads(tmp_path):
    line = ["--to", ".45,.1,.45", "--speed", "0.1", "--waypoints", "6"]
    files = [tmp_path / "p.csv", tmp_path / "p.json", tmp_path / "p.mcap"]
    names = [word for file in files for word in ("-o", str(file))]
    shown = run("plan", "panda", *line, *names).stdout
    assert "collisions are not checked" in shown
    written = json.loads(files[1].read_text())
    assert written["after"]["value"] > written["before"]["value"]
    for file in (files[0], files[2]):
        arm = ftforce.load_robot("panda")
        result = ftforce.timeline(arm, str(file), smooth="none")
        assert result.margin.min() == pytest.approx(written["after"]["value"], rel=1e-6)


@pytest.mark.thorough
def test_in_mujoco_only_the_planned_arm_keeps_the_force():
    """Joints 1 and 2 of the paper's arm lock at the instant at which the usual path is worst."""
    arm = ftforce.load_robot("dh5")
    asked = {"force": [80.0, 50.0, 10.0], "axes": "world"}
    points = [(0.9471, 0.2197, 0.1693), (0.8548, 0.3804, 0.2308)]
    found = plan(arm, Path.through(points, speed=0.15), maximize="jump", faults=2, waypoints=20,
                 **asked)  # fmt: skip
    i = found.worst_of(found.before)
    locked = found.sets[found.before.worst_set[i]].joints
    assert locked == (0, 1)
    felt = {}
    for name, path in (("usual", found.before), ("planned", found.after)):
        result = ftforce.analyze(arm, path.q[i], locked=[1, 2], **asked)
        seen = physics.pinned(arm, path.q[i], result.torque.total_after, locked=locked)
        pose = next(pinocchio_poses(arm, path.q[i : i + 1]))
        felt[name] = pose.rotation @ seen.force
        assert_allclose(felt[name], result.force.after, atol=1e-3)
        lost = np.linalg.norm(felt[name] - asked["force"])
        assert lost == pytest.approx(path.value[i], abs=1e-3)
    assert np.linalg.norm(felt["usual"] - asked["force"]) > 40.0
    assert np.linalg.norm(felt["planned"] - asked["force"]) < 1.0
