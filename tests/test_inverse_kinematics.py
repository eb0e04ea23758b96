"""A posture at a point: beside roboticstoolbox, within limits, near and out of reach."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

import ftforce
from ftforce.errors import InputError
from ftforce.robot.formats.dh import DHTable
from ftforce.robot.inverse_kinematics import REACHED, posture_at
from ftforce.robot.kinematics import tip_pose
from helpers import arms, assert_close, campaign, load_text, serial_urdf, toolbox_arm
from urdfs import arm, followed, j2, load

law = settings(deadline=None, max_examples=campaign(40, 12))

REACHABLE = ("dh5", "panda", "ur5", "kinova", "tiago", "so101")
FIXED = '<limit lower="0.5" upper="0.5" effort="10" velocity="3"/>'


def place(robot, q):
    return tip_pose(robot, np.asarray(q, dtype=float))[1].copy()


def draw(robot, rng):
    """Return a posture inside the limits."""
    return rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0))


def assert_reached(robot, q, point):
    assert np.linalg.norm(place(robot, q) - point) <= REACHED
    assert (q >= robot.lower - 1e-6).all()
    assert (q <= robot.upper + 1e-6).all()
    assert not q.flags.writeable


@pytest.mark.parametrize("name", REACHABLE)
def test_points_that_the_arm_reaches_in_some_posture_are_reached_from_any(name):
    robot, rng = ftforce.load_robot(name), np.random.default_rng(5)
    for _ in range(campaign(8, 3)):
        point = place(robot, draw(robot, rng))
        assert_reached(robot, posture_at(robot, point, draw(robot, rng)), point)


def test_roboticstoolbox_has_the_tip_there():
    table = DHTable.from_toml(Path(__file__).parents[1] / "robots" / "dh5.toml")
    robot, other = ftforce.load_robot("dh5"), toolbox_arm(table)
    near = np.deg2rad([10, 70, 25, 65, 0])
    for point in [(1.150, -0.134, 0.034), (0.781, 0.509, 0.280), (0.9, 0.3, 0.2)]:
        q = posture_at(robot, np.array(point), near)
        assert_close(other.fkine(q).t, point, tol=1e-9)


@pytest.mark.parametrize("name", REACHABLE)
def test_a_posture_that_is_there_already_stays(name):
    robot, rng = ftforce.load_robot(name), np.random.default_rng(6)
    for _ in range(campaign(5, 2)):
        q = draw(robot, rng)
        assert_close(posture_at(robot, place(robot, q), q), q, scale=1.0, tol=1e-9)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_a_point_close_by_is_reached_close_by(name):
    """A millimetre away the joints turn by little: not to another branch."""
    robot = ftforce.load_robot(name)
    q = ftforce.analyze(robot, force=[1, 0, 0]).posture.q
    for step in 1e-3 * np.vstack([np.eye(3), -np.eye(3)]):
        found = posture_at(robot, place(robot, q) + step, q)
        assert np.abs(found - q).max() < 0.1


def test_the_same_point_gives_the_same_posture():
    robot = ftforce.load_robot("panda")
    q = np.zeros(7)
    one, other = (posture_at(robot, np.array([0.4, 0.3, 0.5]), q) for _ in range(2))
    assert one.tobytes() == other.tobytes()


@given(arms(least=3))
@law
def test_places_of_any_arm(drawn):
    """Also near singular postures, with joints that slide and turn without end."""
    robot, q = drawn
    q = np.clip(q, robot.lower, robot.upper)
    point = place(robot, q)
    assert_reached(robot, posture_at(robot, point, q), point)


def test_at_full_stretch():
    steps = [("revolute", {"axis": (0, 1, 0), "xyz": (0.3 * (i > 0), 0, 0)}) for i in range(3)]
    robot = load_text(serial_urdf(*steps).replace("0.11 0.05 0.03", "0.3 0 0"), tip="tool")
    assert_reached(robot, posture_at(robot, np.array([0.9, 0.0, 0.0]), np.zeros(3)), [0.9, 0, 0])
    almost = np.array([0.9 - 1e-6, 0.0, 0.0])
    assert_reached(robot, posture_at(robot, almost, np.array([0.1, -0.2, 0.1])), almost)


def test_a_start_outside_the_limits_is_brought_inside():
    robot = ftforce.load_robot("panda")
    point = place(robot, 0.5 * (robot.lower + robot.upper))
    assert_reached(robot, posture_at(robot, point, np.full(7, 9.0)), point)


def test_mimic_joints_and_joints_without_room(tmp_path):
    q = np.array([0.2, 0.5, 0.4])
    robot = load(tmp_path, arm(j4=followed(4, "j2", -0.5, 0.2)), tip="tool")
    assert_reached(robot, posture_at(robot, place(robot, q), np.zeros(3)), place(robot, q))
    robot = load(tmp_path, j2(limit=FIXED), tip="tool")
    assert robot.names == ("j1", "j3", "j4")  # a joint without room is no joint of the chain
    assert_reached(robot, posture_at(robot, place(robot, q), np.zeros(3)), place(robot, q))


def test_a_point_out_of_reach_is_told_with_the_nearest():
    """A stretched arm of 0.9 m ends on the straight line from its base to the point."""
    steps = [("revolute", {"axis": (0, 1, 0), "xyz": (0.3 * (i > 0), 0, 0)}) for i in range(3)]
    robot = load_text(serial_urdf(*steps).replace("0.11 0.05 0.03", "0.3 0 0"), tip="tool")
    with pytest.raises(InputError) as caught:
        posture_at(robot, np.array([1.2, 0.0, 1.6]), np.array([0.3, 0.2, 0.1]))
    here = ", ".join(f"{x:.4g}" for x in place(robot, [0.3, 0.2, 0.1]))
    assert str(caught.value) == (
        "the tip cannot reach (1.2, 0, 1.6) m in root axes within the joint limits: the closest "
        "position found is (0.54, 0, 0.72) m, 1.1 m away; the search started from "
        f"({here}) m"
    )


def test_a_point_beyond_the_limits_is_out_of_reach():
    """The arm is long enough, but joint 1 of a single link turns up to 1 rad only."""
    urdf = serial_urdf(("revolute", {"lower": -1.0, "upper": 1.0}))
    robot = load_text(urdf.replace("0.11 0.05 0.03", "1 0 0"), tip="tool")
    reached = np.array([np.cos(0.9), np.sin(0.9), 0.0])
    assert_close(posture_at(robot, reached, np.zeros(1)), [0.9], tol=1e-8)
    with pytest.raises(
        InputError, match=r"within the joint limits: .* closest position found .*, 0\.1"
    ):
        posture_at(robot, np.array([np.cos(1.1), np.sin(1.1), 0.0]), np.zeros(1))
    a_little = np.array([np.cos(1.0005), np.sin(1.0005), 0.0])  # Newton's steps would go there
    with pytest.raises(InputError, match=r"the tip cannot reach \(0\.5399, 0\.8417, 0\) m"):
        posture_at(robot, a_little, np.zeros(1))
    with pytest.raises(InputError, match="the tip cannot reach"):
        posture_at(robot, np.array([1e9, 0.0, -1e9]), np.zeros(1))
    with pytest.raises(InputError, match=r"cannot reach \(1, 0, 0\.001\) m"):
        posture_at(robot, np.array([1.0, 0.0, 1e-3]), np.zeros(1))
