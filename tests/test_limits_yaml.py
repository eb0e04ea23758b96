"""Limits of MoveIt and ros2_control, and YAML files that are not what they seem."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ftforce
from ftforce import load_robot
from ftforce.analysis.limits_files import read_friction, read_limits
from ftforce.errors import LimitsError
from urdfs import arm, followed, joint, write

NAN = math.nan


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture
def file(tmp_path):
    def write_file(content, name="limits.yaml"):
        path = tmp_path / name
        path.write_text(content, encoding="utf-8")
        return path

    return write_file


def refused(robot, path):
    with pytest.raises(LimitsError) as caught:
        read_limits(robot, path)
    assert str(caught.value).isprintable()
    return str(caught.value).removeprefix(f"{path}: ")


SAME = {  # effort 60 of joint 3, [-8, 5.5] of joint 5
    "moveit": "default_velocity_scaling_factor: 0.1\njoint_limits:\n  joint3:\n"
    "    has_velocity_limits: true\n    max_velocity: 2.1\n    has_effort_limits: true\n"
    "    max_effort: 60\n  joint5: {max_effort: 5.5, min_effort: -8}\n",
    "ros2_control": "/**:\n  ros__parameters:\n    update_rate: 100\n    joint_limits:\n"
    "      joint3: {has_effort_limits: true, max_effort: 60.0}\n"
    "      joint4: {has_effort_limits: False, max_effort: 1}\n"
    "      joint5: {effort: [-8, 5.5]}\n",
    "planning": "robot_description_planning:\n  joint_limits:\n    joint3: {max_effort: 6e1}\n"
    "    joint5: {effort_min: -8, effort_max: 5.5}\n",
    "degrees": "joint_limits:\n  joint3: {max_position: !degrees 360.0, max_effort: 60}\n"
    "  joint5: {max_effort: 5.5, min_effort: -8, min_position: !degrees -360}\n",
    "bare": "joint3: {effort: 60}\n'joint5': {effort: [-8, 5.5]}\n",
    "by number": "3: {effort: !!float 60}\n5:\n  effort:\n  - -8\n  - 5.5\n",
}


@pytest.mark.parametrize("text", SAME.values(), ids=SAME)
@pytest.mark.parametrize("name", ["limits.yaml", "LIMITS.YML"])
def test_forms(dh5, file, text, name):
    limits = read_limits(dh5, file(text, name))
    lower, upper = limits.motor_bounds()
    np.testing.assert_array_equal(upper, [NAN, NAN, 60.0, NAN, 5.5])
    np.testing.assert_array_equal(lower, [NAN, NAN, -60.0, NAN, -8.0])
    assert limits.notes == ()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("limits.toml", "joint3 = {effort = 60}\njoint5 = {effort = [-8, 5.5]}\n"),
        ("limits.toml", "[joint3]\neffort = 60\n[5]\neffort_min = -8\neffort_max = 5.5\n"),
        ("limits.csv", "joint,effort,effort_min,effort_max\njoint3,60,,\njoint5,,-8,5.5\n"),
        ("limits.csv", "joint,effort_min,effort_max\njoint3,-60,60\njoint5,-8,5.5\n"),
    ],
)
def test_asymmetric_limits_of_the_other_formats(dh5, file, name, text):
    lower, upper = read_limits(dh5, file(text, name)).motor_bounds()
    np.testing.assert_array_equal(upper, [NAN, NAN, 60.0, NAN, 5.5])
    np.testing.assert_array_equal(lower, [NAN, NAN, -60.0, NAN, -8.0])


def test_lines_and_terms(dh5, file):
    text = (
        "joint2: {stall_torque: 80, no_load_speed: !degrees 180}\n"
        "joint3: {effort: 9, friction: 0.5, damping: 2, armature: 0.1}\n"
    )
    limits = read_limits(dh5, file(text))
    np.testing.assert_array_equal(limits.line.stall_torque, [NAN, 80, NAN, NAN, NAN])
    np.testing.assert_allclose(limits.line.no_load_speed[1], math.pi)
    assert [term[2] for term in limits.terms] == [0.5, 2.0, 0.1]
    assert read_friction(dh5, file(text))[2] == 0.5
    assert limits.is_known.tolist() == [False, True, True, False, False]


def test_joints_of_the_rest_of_the_robot_are_noted(tmp_path, file):
    text = arm(j2=joint("j2", "l1", "l2", "fixed"), j3=followed(3, "j1"))
    robot = load_robot(write(tmp_path, text))
    limits = read_limits(robot, file("joint_limits:\n  j1: {max_effort: 5}\n  j2: {}\n  j3: {}\n"))
    assert limits.effort[0] == 5.0
    assert limits.notes == ("limits of joints outside the chain are ignored: j2, j3",)
    analysis = ftforce.analyze(robot, limits=limits)
    assert limits.notes[0] in analysis.warnings


def test_names_without_their_end(tmp_path, file):
    robot = load_robot(write(tmp_path, arm(j1=joint("j1_joint", "base", "l1"))))
    assert read_limits(robot, file("j1: {max_effort: 5}")).effort[0] == 5.0


BAD = {
    "empty": ("# nothing\n", "contains no torque limits"),
    "velocity only": ("joint_limits:\n  joint1: {max_velocity: 1}\n", "contains no torque limits"),
    "list": ("- joint1\n", "contains no mapping"),
    "no mapping": ("joint_limits: 3\n", "joint_limits is not a mapping"),
    "number": ("joint1: 3\n", "joint1: is not a mapping; use one per joint"),
    "unknown joint": ("joint9: {max_effort: 3}\n", "joint9: unknown joint 'joint9'"),
    "misspelt": ("joint1: {max_efort: 3}\n", "joint1: unknown key 'max_efort'; available"),
    "missing": ("joint1: {has_effort_limits: true}\n", "joint1: has_effort_limits is true, but"),
    "flag": ("joint1: {has_effort_limits: maybe}\n", "joint1: has_effort_limits is true or"),
    "half": ("joint1: {min_effort: -3}\n", "joint1: min_effort needs max_effort"),
    "both": ("joint1: {effort: 3, max_effort: 3}\n", "joint1: give either effort or"),
    "both sides": ("joint1: {effort: 3, effort_max: 3}\n", "joint1: give either effort of"),
    "three": ("joint1: {effort: [1, 2, 3]}\n", "joint1: effort of joint1 is one number or two"),
    "order": ("joint1: {effort: [5, -5]}\n", "joint1: effort of joint1 needs a negative lower"),
    "one side": ("joint1: {effort: [0, 5]}\n", "joint1: effort of joint1 needs a negative lower"),
    "half line": ("joint1: {stall_torque: 5}\n", "joint1: a torque-speed line needs both"),
    "damping": (
        "joint1: {damping: -1}\n",
        "joint1: damping of joint1 must be a number",
    ),
    "unit": (
        "joint1: {armature: [1]}\n",
        "joint1: armature of joint1 must be",
    ),
    "speed": ("joint1: {stall_torque: 1, no_load_speed: 0}\n", "joint1: no_load_speed of joint1"),
    "nan": ("joint1: {max_effort: .nan}\n", "joint1: effort of joint1"),
    "zero": ("joint1: {max_effort: 0}\n", "joint1: effort of joint1 must be a positive number"),
    "nested": ("joint1: {max_effort: {x: 1}}\n", "joint1: effort of joint1 must be"),
    "twice": ("joint1: {max_effort: 1}\njoint1: {}\n", "line 2: the key 'joint1' appears twice"),
    "by two names": ("joint1: {}\n1: {}\n", "1: joint 1 (joint1) already appears in joint1"),
    "alias": ("a: &a {max_effort: 1}\nb: *a\n", "line 2: aliases (*a) are not supported"),
    "merge": ("a: &a {max_effort: 1}\nb: {<<: *a}\n", "line 2: aliases"),
    "tag": (
        "a: !!python/object/apply:os.system ['echo']\n",
        "line 1: the tag tag:yaml.org,2002:py",
    ),
    "local tag": ("a: !include x.yaml\n", "line 1: the tag !include is not supported"),
    "degrees": ("a: {no_load_speed: !degrees x}\n", "line 1: !degrees 'x'"),
    "degrees of a list": ("a: !degrees [1]\n", "line 1: the tag !degrees"),
    "two documents": ("a: {}\n---\nb: {}\n", "is not well-formed YAML"),
    "brackets": ("a: [1, 2\n", "is not well-formed YAML"),
    "tab": ("a:\n\tb: 1\n", "is not well-formed YAML (line 2"),
    "key": ("[1]: 2\n", "line 1: a key must be a plain word"),
    "deep": ("a: " + 5000 * "[" + 5000 * "]", "line 1: is nested more than 20 levels deep"),
    "control": ("a: \x01\n", "is not well-formed YAML"),
    "large": ("#" * (100_001), "is larger than 0.1 MB"),
    "xacro": ("joint1: {max_effort: ${x}}\n", "is not well-formed YAML"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_files_that_cannot_be_used(dh5, file, text, message):
    assert refused(dh5, file(text)).startswith(message)
