"""Paths of an arm whose joints have locked, and paths that survive a lock on the way."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

import ftforce
from ftforce.errors import InputError
from ftforce.planning.guarantee import REASONS, ForceKept
from ftforce.planning.locks import Locks
from ftforce.planning.path import plan
from ftforce.planning.target import TipTarget, residual
from ftforce.robot.kinematics import tip_pose
from ftforce.trajectory import Path
from test_cli import run
from test_self_motion import planar

OUT = Path.through([(1.5, 0.0, 0.0), (2.9, 0.0, 0.0)], speed=0.1)
POSE = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1, keep_orientation=True)
IN_PLANE = {"task": ["fx", "fy"], "axes": "world"}


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def test_the_path_ends_where_the_damaged_arm_is_stretched():
    """With joint 3 at 90°, links of 1 m and √2 m reach 1 + √2 m (theory: the law of cosines)."""
    found = plan(planar(), OUT, locked={3: np.pi / 2}, waypoints=40, **IN_PLANE)
    x = np.array([OUT.at(t)[0][0] for t in found.t])
    reach = 1.0 + np.sqrt(2.0)
    assert_allclose(found.after.q[:, 2], np.pi / 2, atol=1e-12)
    assert found.reached[x < reach - 0.2].all()  # closer, the joints have to be ever faster
    assert not found.reached[x > reach].any()
    assert found.deviation[-1, 0] == pytest.approx(2.9 - reach, abs=1e-4)
    assert found.deviation[found.reached, 0].max() <= 1e-9
    assert found.breaks.slow_down == 1.0


@pytest.mark.thorough
def test_no_posture_of_the_damaged_arm_comes_closer(panda):
    """Local searches of SciPy, from where the tip is off its path, end there too."""
    found = plan(panda, POSE, locked="4@-1.2", waypoints=8)
    assert not found.reached.any()
    moving = np.delete(np.arange(7), 3)
    _, start = tip_pose(panda, found.before.q[0])
    R, _ = tip_pose(panda, ftforce.plan(panda, POSE, waypoints=2).before.q[0])
    step = (len(found.t) - 1) // 7
    for i in (0, 3 * step, 7 * step):
        target = TipTarget.of(POSE.at(found.t[i])[0], R)

        def missing(x, q=found.after.q[i], target=target):
            moved = q.copy()
            moved[moving] = x
            return residual(panda, moved, target)

        at = found.after.q[i, moving]
        best = least_squares(missing, np.clip(at, panda.lower[moving] + 1e-9,
                             panda.upper[moving] - 1e-9),
                             bounds=(panda.lower[moving], panda.upper[moving]))  # fmt: skip
        assert np.linalg.norm(missing(at)) <= np.linalg.norm(best.fun) * (1.0 + 1e-3)
    assert np.linalg.norm(start - POSE.at(0.0)[0]) > 0.1


def test_the_rest_is_planned_from_where_the_arm_is_when_a_joint_locks(panda):
    line = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1)
    usual = plan(panda, line, waypoints=8).before
    found = plan(panda, line, locked="2@1s", waypoints=8)
    assert found.t[0] == pytest.approx(1.0)
    assert found.locks.time == 1.0
    assert_allclose(found.after.q[:, 1], found.locks.q[1], atol=1e-12)
    assert (found.before.q[0] >= usual.q.min(axis=0) - 1e-6).all()
    assert (found.before.q[0] <= usual.q.max(axis=0) + 1e-6).all()
    assert_allclose(found.after.q[0], found.before.q[0], atol=1e-8)
    assert found.reached.all()
    assert found.after.value.min() >= found.before.value.min() - 1e-9
    census = ftforce.analyze(panda, found.after.q[-1], locked=[2])
    assert found.after.value[-1] == pytest.approx(census.margin, rel=1e-9)


def test_locked_joints_count_among_the_faults(panda):
    line = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1)
    found = plan(panda, line, locked={"panda_joint3": 0.7}, faults=2, waypoints=5)
    assert {one.joints for one in found.sets} == {
        (2,), *(tuple(sorted((2, i))) for i in range(7) if i != 2)
    }  # fmt: skip
    with pytest.raises(InputError, match="2 joints have locked, which count among"):
        plan(panda, line, locked="3@0.7,5@0.1", waypoints=5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("3", r"needs a place or a time, e\.g\. 3@0\.7"),
        ("3@", "needs a place or a time"),
        ("3@x", "x' is not a number"),
        ("3@-1s", "at 0 s or later"),
        ("9@0.1", "joint number 9 is out of range"),
        ("3@9", r"cannot have locked at 9 rad, outside its limits from -2\.897 to 2\.897 rad"),
        ("3@0.1,3@0.2", "appears twice"),
        ("3@0.1,4@2s", "or at one time"),
        ("1@0,2@0,3@0,4@-1,5@0,6@1,7@0", "none is left"),
        ("3@99s", r"when the path of 3\.75 s is done"),
        ({3: "x"}, "must be a number"),
        ({}, "give the joint that has locked"),
        (3, "are given as text or by joint"),
    ],
)
def test_malformed_locks_are_one_clear_line(panda, given, message):
    with pytest.raises(InputError, match=message):
        plan(panda, POSE, locked=given, faults=7, waypoints=3)


def reaches(radius, first, second):
    """Return whether two links reach a radius, by the triangle inequality."""
    return (radius >= abs(first - second)) & (radius <= first + second)


@pytest.mark.parametrize("length", [2.9, 2.3])
def test_guarantee_is_that_of_the_triangle_inequality(length):
    """Whichever joint of three locks, two remain, and their lengths say what is reached."""
    line = Path.through([(0.8, 0.6, 0.0), (length, 0.0, 0.0)], speed=0.05)
    found = plan(planar("continuous"), line, guarantee=True, waypoints=25, **IN_PLANE)
    k = slice(None, None, (len(found.t) - 1) // 24)
    q, points = found.after.q[k], np.array([line.at(t)[0] for t in found.t[k]])
    radius = np.linalg.norm(points, axis=1)
    expected = np.empty((25, 3), dtype=bool)
    for w, (a, b, c) in enumerate(q):
        elbow = np.array([np.cos(a), np.sin(a), 0.0])
        rest = points[w:]
        expected[w] = (
            reaches(np.linalg.norm(rest - elbow, axis=1), 1.0, 1.0).all(),
            reaches(radius[w:], np.sqrt(2.0 + 2.0 * np.cos(b)), 1.0).all(),
            reaches(radius[w:], 1.0, np.sqrt(2.0 + 2.0 * np.cos(c))).all(),
        )
    np.testing.assert_array_equal(found.guarantee.holds, expected)
    assert found.guarantee.holds[-1].all()
    assert found.guarantee.holds.all() == (length < 2.9)
    for one in found.guarantee.broken:
        assert not found.guarantee.holds[one.waypoint, one.joint]
        assert one.until > one.waypoint
        assert one.reason in REASONS
    assert len(found.guarantee.broken) == (~found.guarantee.holds).sum()


@pytest.mark.thorough
def test_a_path_is_preferred_that_every_lock_leaves():
    """The path of the largest margin folds joint 3 so far that its lock ends the task."""
    line = Path.through([(0.8, 0.6, 0.0), (2.3, 0.0, 0.0)], speed=0.05)
    asked = {"waypoints": 12, **IN_PLANE}
    best = plan(planar("continuous"), line, **asked)
    assert np.sqrt(2.0 + 2.0 * np.cos(best.after.q[0, 2])) < 1.3  # with 1 m, not 2.3 m
    assert best.guarantee is None
    assert plan(planar("continuous"), line, guarantee=True, **asked).guarantee.share == 1.0


@pytest.mark.parametrize("limits", ["urdf", "none"])
def test_a_force_is_kept_if_it_can_be_commanded(panda, limits):
    q = np.random.default_rng(4).uniform(panda.lower, panda.upper, (6, 7))
    F = [0.0, 40.0, 150.0] if limits == "urdf" else [0.0, 0.0, 60.0]
    asked = dict.fromkeys(("payload", "friction", "length", "joint_length"))
    asked |= {"force": F, "limits": limits, "gravity": None, "task": "force", "axes": "tool",
              "rtol": 1e-9, "wary": 1e-6}  # fmt: skip
    kept = ForceKept.parse(panda, None, **asked)
    joint = np.array([0, 1, 2, 3, 5, 6])
    seen = kept(q, joint)
    for one, i, is_kept in zip(q, joint.tolist(), seen, strict=True):
        answer = ftforce.analyze(panda, one, locked=[i + 1], force=F, limits=limits)
        assert is_kept == np.allclose(answer.force.after, F, atol=1e-6)
    if limits == "urdf":
        assert 0 < seen.sum() < len(q)


@pytest.mark.thorough
def test_a_force_that_cannot_be_kept_is_a_reason(panda):
    line = Path.through([(0.5, -0.1, 0.4), (0.5, 0.1, 0.4)], speed=0.1)
    asked = {"guarantee": True, "waypoints": 5, "limits": "urdf", "axes": "world"}
    heavy = plan(panda, line, force=[0, 0, 400], **asked)
    assert heavy.guarantee.share == 0.0
    assert {one.reason for one in heavy.guarantee.broken} == {"force"}
    light = plan(panda, line, force=[0, 0, 5], **asked)
    assert light.guarantee.share == 1.0


def test_command_tells_what_is_guaranteed_and_where_the_path_is_left(tmp_path):
    line = ["--from", ".5,-.2,.4", "--to", ".5,.2,.4", "--speed", "0.1", "--waypoints", "10"]
    file = tmp_path / "p.json"
    shown = run("plan", "panda", *line, "--keep-orientation", "--guarantee", "-o", str(file))
    words = " ".join(shown.stdout.split())
    assert "Locks after which the arm was not seen to finish the path" in words
    assert "of waypoints and joints, the arm finishes the path when that joint locks there" in words
    written = json.loads(file.read_text())["guarantee"]
    assert np.mean(written["holds"]) == pytest.approx(written["share"])
    assert {one["reason"] for one in written["broken"]} <= set(REASONS)
    shown = run("plan", "panda", *line, "--keep-orientation", "--locked", "4@-1.2", "-o", str(file))
    words = " ".join(shown.stdout.split())
    assert "joint 4 (panda_joint4) at -1.2 rad, before the path" in words
    assert "The damaged arm leaves the tool path everywhere" in words
    written = json.loads(file.read_text())
    assert written["locked"] == {"joints": ["panda_joint4"], "positions": [-1.2], "time": 0.0}
    assert not any(written["reached"])


def test_locks_keep_what_they_were_given(panda):
    locks = Locks.parse(panda, {5: 0.1, "panda_joint3": -0.2})
    assert locks.joints == (2, 4)
    assert_allclose(locks.applied(np.ones(7)), [1, 1, -0.2, 1, 0.1, 1, 1])
    assert Locks.parse(panda, None) is None
