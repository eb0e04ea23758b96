"""Tip pose and Jacobians: closed forms, axes, rows, and that results stay what they are."""

import math

import numpy as np
import pytest

import ftforce
from ftforce.core.task import Task
from ftforce.robot.kinematics import frame_jacobian, reach_bound, task_jacobian, tip_pose
from helpers import KNOWN, assert_close, joint, load_text, serial_urdf, srdf_of, urdf_of

PLANAR = serial_urdf(
    ("revolute", {}),
    ("revolute", {"xyz": (0.4, 0, 0)}),
    ("prismatic", {"xyz": (0.3, 0, 0), "axis": (1, 0, 0)}),
).replace("0.11 0.05 0.03", "0.0 0.0 0.0")
Q = np.array([0.3, 0.5, 0.2])


@pytest.fixture(scope="module")
def planar():
    return load_text(PLANAR)


def test_pose_of_a_planar_arm(planar):
    R, p = tip_pose(planar, Q)
    c, s = math.cos(0.8), math.sin(0.8)
    assert_close(R, [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert_close(p, [0.4 * math.cos(0.3) + 0.5 * c, 0.4 * math.sin(0.3) + 0.5 * s, 0])


def test_jacobian_of_a_planar_arm_in_world_axes(planar):
    c1, s1, c, s = math.cos(0.3), math.sin(0.3), math.cos(0.8), math.sin(0.8)
    wanted = np.zeros((6, 3))
    wanted[0] = [-0.4 * s1 - 0.5 * s, -0.5 * s, c]
    wanted[1] = [0.4 * c1 + 0.5 * c, 0.5 * c, s]
    wanted[5] = [1, 1, 0]
    assert_close(frame_jacobian(planar, Q, "world"), wanted)


def test_jacobian_of_a_planar_arm_in_tool_axes(planar):
    wanted = np.zeros((6, 3))
    wanted[0] = [0.4 * math.sin(0.5), 0, 1]
    wanted[1] = [0.4 * math.cos(0.5) + 0.5, 0.5, 0]
    wanted[5] = [1, 1, 0]
    assert_close(frame_jacobian(planar, Q), wanted)
    assert_close(frame_jacobian(planar, Q, "tool"), wanted)


@pytest.mark.parametrize("name", KNOWN)
def test_axes_differ_by_the_orientation_of_the_tip(name):
    arm = ftforce.load_robot(name)
    q = np.linspace(0.2, 0.9, arm.n)
    R, _ = tip_pose(arm, q)
    assert_close(R @ R.T, np.eye(3))
    turned = np.kron(np.eye(2), R) @ frame_jacobian(arm, q, "tool")
    assert_close(frame_jacobian(arm, q, "world"), turned)


@pytest.mark.parametrize("axes", ["tool", "world"])
@pytest.mark.parametrize("words", ["force", "moment", "wrench", "fx", "fz,mx", "mz,fy"])
def test_a_task_selects_rows(planar, words, axes):
    task = Task.parse(words, axes, 0.3)
    J = task_jacobian(planar, Q, task)
    assert J.shape == (task.m, 3)
    rows = [("fx", "fy", "fz", "mx", "my", "mz").index(name) for name in task.components]
    np.testing.assert_array_equal(J, frame_jacobian(planar, Q, axes)[rows])  # and no length


@pytest.mark.parametrize(
    ("kind", "linear", "angular"),
    [
        ("revolute", [-0.05, 0.11, 0], [0, 0, 1]),
        ("continuous", [-0.05, 0.11, 0], [0, 0, 1]),
        ("prismatic", [0, 0, 1], [0, 0, 0]),
    ],
)
def test_an_arm_of_one_joint(kind, linear, angular):
    arm = load_text(serial_urdf((kind, {})))
    q = np.array([0.0])
    assert_close(frame_jacobian(arm, q), np.array([[*linear, *angular]]).T)
    assert_close(task_jacobian(arm, q, Task()), np.array([linear]).T)


def test_results_do_not_change_with_the_next_call(planar):
    J, (R, p) = frame_jacobian(planar, Q), tip_pose(planar, Q)
    before = J.copy(), R.copy(), p.copy()
    frame_jacobian(planar, Q + 1.0)
    tip_pose(planar, Q + 1.0)
    for now, then in zip((J, R, p), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_poses_are_in_the_roots_axes_also_with_another_base():
    urdf = urdf_of(
        *("root", "base", "a", "tool"),
        joints=[
            joint("pan", "revolute", "root", "base", xyz=(0, 0, 1)),
            joint("j1", "revolute", "base", "a", xyz=(0.5, 0, 0)),
            joint("j2", "revolute", "a", "tool", xyz=(0.5, 0, 0)),
        ],
    )
    turned = srdf_of(turned={"pan": math.pi / 2, "j1": 0.0, "j2": 0.0})
    arm = load_text(urdf, turned, tip="tool", base="base", posture="turned")
    R, p = tip_pose(arm, np.zeros(2))
    assert_close(p, [0, 1, 1])
    assert_close(R, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], tol=1e-12)
    assert_close(frame_jacobian(arm, np.zeros(2), "world")[:3, 0], [-0.5, 0, 0])
    assert_close(frame_jacobian(arm, np.zeros(2), "tool")[:3, 0], [0, 0.5, 0])


def test_the_reach_of_a_slide_that_follows_a_turning_joint():
    # A lead screw: 0.01 m per rad, up to 90 rad.
    arm = load_text(LEAD_SCREW, tip="tip")
    _, bound = reach_bound(arm)
    assert bound == pytest.approx(0.1 + 0.9)
    _, tip = tip_pose(arm, np.array([90.0]))
    assert np.linalg.norm(tip) == pytest.approx(1.0)


LEAD_SCREW = """<robot name="screw"><link name="base"/><link name="nut"/><link name="tip"/>
<link name="dial"/>
<joint name="screw" type="revolute"><parent link="base"/><child link="dial"/><axis xyz="0 0 1"/>
<limit lower="0" upper="90" effort="1" velocity="1"/></joint>
<joint name="slide" type="prismatic"><parent link="base"/><child link="nut"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="screw" multiplier="0.01"/></joint>
<joint name="f" type="fixed"><parent link="nut"/><child link="tip"/><origin xyz="0.1 0 0"/></joint>
</robot>"""
