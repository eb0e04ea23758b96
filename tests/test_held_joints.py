"""Joints with equal position limits: held, unless nobody filled in the limits."""

import numpy as np
import pytest

from ftforce.errors import InputError
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.posture import choose_posture
from urdfs import AXES, LINKS, arm, hand, joint, link, load, mimic, robot

Q = np.array([0.3, -0.4, 0.5, 0.2])


def limit(lower, upper, effort=0):
    return f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="0"/>'


def at(number, kind, lower, upper, **options):
    """Return a joint of the arm with these limits."""
    ends = LINKS[number - 1 : number + 1]
    text = limit(lower, upper)
    name = f"j{number}"
    return {name: joint(name, *ends, kind, axis=AXES[number - 1], limit=text, **options)}


def closed(*numbers):
    """Return the arm with limits of 0 and 0 at some joints."""
    joints = {}
    for number in numbers:
        joints |= at(number, "revolute", 0, 0)
    return joints


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("value", [0.0, 0.7, -2.1, np.pi / 2])
def test_a_joint_with_equal_limits_is_a_fixed_one(tmp_path, kind, value):
    """Its pose is that of the same arm with the joint at that position."""
    whole = load(tmp_path, arm(**at(2, kind, -3, 3)))
    held = load(tmp_path, arm(**at(2, kind, value, value)))
    assert held.names == ("j1", "j3", "j4")
    assert held.notes == (f"held fixed, as the lower limit equals the upper one: j2 at {value:g}",)
    for got, wanted in zip(
        tip_pose(held, Q[[0, 2, 3]]),
        tip_pose(whole, np.array([Q[0], value, *Q[2:]])),
        strict=True,
    ):
        np.testing.assert_allclose(got, wanted, atol=1e-14)
    with pytest.raises(InputError, match="joint 'j2' is held fixed and has no motor"):
        held.index("j2")


def test_limits_that_differ_by_rounding_are_equal(tmp_path):
    assert load(tmp_path, arm(**at(1, "revolute", -1e-7, 1e-7))).n == 3
    assert load(tmp_path, arm(**at(1, "revolute", 0, 1e-5))).n == 4


def test_an_anchor_is_not_numbered(tmp_path):
    """`disguised_anchor.urdf`: it may have an effort, e.g. for a simulated force sensor."""
    anchor = joint("anchor", "world", "base", limit=limit(0, 0, effort=300))
    found = load(tmp_path, arm(link("world", ""), anchor))
    assert found.base == "world"
    assert found.names == ("j1", "j2", "j3", "j4")
    assert "anchor at 0" in found.notes[0]


def test_followers_of_a_held_joint_are_held(tmp_path):
    led = joint("j3", "l2", "l3", axis=AXES[2], more=mimic("j2", -2, 0.1))
    led_by_that = joint("j4", "l3", "tool", axis=AXES[3], more=mimic("j3", 0.5))
    found = load(tmp_path, arm(j3=led, j4=led_by_that, **at(2, "revolute", 0.4, 0.4)))
    assert found.names == ("j1",)
    whole = load(tmp_path, arm())
    third = -2 * 0.4 + 0.1
    for got, wanted in zip(
        tip_pose(found, Q[:1]),
        tip_pose(whole, np.array([Q[0], 0.4, third, 0.5 * third])),
        strict=True,
    ):
        np.testing.assert_allclose(got, wanted, atol=1e-14)


UNFILLED = "position limits are 0 and 0, which counts as unknown: "


@pytest.mark.parametrize(
    ("joints", "names", "note"),
    [
        ((1, 2, 3, 4), "j1 j2 j3 j4", UNFILLED + "j1, j2, j3, j4"),
        ((1, 2, 4), "j1 j2 j3 j4", UNFILLED + "j1, j2, j4"),
        ((1, 4), "j2 j3", "held fixed, as the lower limit equals the upper one: j1 at 0, j4 at 0"),
        ((3,), "j1 j2 j4", "held fixed, as the lower limit equals the upper one: j3 at 0"),
    ],
)
def test_limits_that_nobody_filled_in_are_unknown(tmp_path, joints, names, note):
    """It is the majority on the way from the root to the end of a branch that tells."""
    found = load(tmp_path, arm(**closed(*joints)))
    assert found.names == tuple(names.split())
    assert found.notes == (note,)
    of_open = [i for i, name in enumerate(found.names) if int(name[1]) in joints]
    assert np.isinf(found.lower[of_open]).all()
    assert np.isinf(found.upper[of_open]).all()
    assert np.abs(choose_posture(found).q).max() <= np.pi


def test_a_gripper_with_limits_does_not_hold_the_arm(tmp_path):
    found = load(tmp_path, arm(*hand("f1", "f2"), **closed(1, 2, 3, 4)), tip="tool")
    assert found.names == ("j1", "j2", "j3", "j4")
    torso = [link("x"), link("y"), joint("t1", "x", "y", limit=limit(0, 0)),
             joint("t2", "y", "base", limit=limit(0, 0))]  # fmt: skip
    assert load(tmp_path, arm(*torso)).names == ("j1", "j2", "j3", "j4")


def test_limits_that_are_absent_are_unknown(tmp_path):
    for kind in ("revolute", "prismatic"):
        text = arm(j2=joint("j2", "l1", "l2", kind, limit='<limit effort="5" velocity="1"/>'))
        found = load(tmp_path, text)
        assert (found.lower[1], found.upper[1]) == (-np.inf, np.inf)
        assert found.effort[1] == 5
        assert found.notes == ("position limits are missing, which counts as unknown: j2",)


def test_one_joint_alone_is_not_held(tmp_path):
    found = load(tmp_path, robot(link("a"), link("b"), joint("j", "a", "b", limit=limit(0, 0))))
    assert found.names == ("j",)
    assert found.notes == (UNFILLED + "j",)
