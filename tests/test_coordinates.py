"""From the chain's numbers to Pinocchio's: continuous joints, followers, and back."""

import math

import numpy as np
import pytest

from ftforce.robot.kinematics import frame_jacobian
from helpers import assert_close, load_text, serial_urdf

CHAIN = (
    ("revolute", {}),
    ("continuous", {"xyz": (0.2, 0, 0), "axis": (0, 1, 0)}),
    ("revolute", {"xyz": (0.2, 0, 0), "axis": (0, 1, 0), "mimic": ("j1", -0.5, 0.3)}),
    ("prismatic", {"xyz": (0.1, 0, 0), "mimic": ("j3", 0.1, 0.02)}),
    ("continuous", {"xyz": (0, 0, 0.1), "mimic": ("j2", 2.0, -1.0)}),
)


@pytest.fixture(scope="module")
def arm():
    return load_text(serial_urdf(*CHAIN))


def of_model(arm, configuration, name):
    joint = arm.model.joints[arm.model.getJointId(name)]
    return configuration[joint.idx_q : joint.idx_q + joint.nq]


def test_a_plain_chain_is_passed_through():
    coordinates = load_text(serial_urdf(CHAIN[0], CHAIN[0])).coordinates
    q, J = np.array([0.1, 0.2]), np.ones((6, 2))
    assert coordinates.is_identity
    assert coordinates.to_model(q) is q
    assert coordinates.fold(J) is J


def test_leaders_and_followers(arm):
    assert arm.names == ("j1", "j2")
    assert [joint.followers for joint in arm.joints] == [("j3", "j4"), ("j5",)]
    assert not arm.coordinates.is_identity
    assert arm.coordinates.G.shape == (arm.model.nv, 2)


def test_every_joint_of_the_model_gets_its_position(arm):
    configuration = arm.to_model(np.array([0.4, 2.0]))
    assert configuration.shape == (arm.model.nq,)
    assert_close(of_model(arm, configuration, "j1"), [0.4])
    assert_close(of_model(arm, configuration, "j2"), [math.cos(2.0), math.sin(2.0)])
    assert_close(of_model(arm, configuration, "j3"), [-0.5 * 0.4 + 0.3])
    assert_close(of_model(arm, configuration, "j4"), [0.1 * (-0.5 * 0.4 + 0.3) + 0.02])
    turned = 2.0 * 2.0 - 1.0
    assert_close(of_model(arm, configuration, "j5"), [math.cos(turned), math.sin(turned)])


def test_columns_of_followers_go_to_their_leader(arm):
    columns = dict(zip(("j1", "j2", "j3", "j4", "j5"), np.eye(5), strict=True))
    J = np.zeros((5, arm.model.nv))
    for name, column in columns.items():
        J[:, arm.model.joints[arm.model.getJointId(name)].idx_v] = column
    folded = arm.coordinates.fold(J)
    assert_close(folded[:, 0], columns["j1"] - 0.5 * columns["j3"] - 0.05 * columns["j4"])
    assert_close(folded[:, 1], columns["j2"] + 2.0 * columns["j5"])


def test_the_map_and_its_derivative_agree(arm):
    q, step = np.array([0.4, 2.0]), 1e-6
    for k, unit in enumerate(np.eye(2)):
        slope = (arm.to_model(q + step * unit) - arm.to_model(q - step * unit)) / (2 * step)
        G = arm.coordinates.G[:, k]
        for name in ("j1", "j3", "j4"):
            row = arm.model.joints[arm.model.getJointId(name)].idx_v
            assert_close(of_model(arm, slope, name), [G[row]], scale=1.0, tol=1e-8)
        for name in ("j2", "j5"):
            row = arm.model.joints[arm.model.getJointId(name)].idx_v
            cosine, sine = of_model(arm, arm.to_model(q), name)
            wanted = [-sine * G[row], cosine * G[row]]
            assert_close(of_model(arm, slope, name), wanted, scale=1.0, tol=1e-8)


def test_a_turn_of_a_continuous_joint_changes_nothing(arm):
    one, other = (frame_jacobian(arm, np.array([0.4, x])) for x in (0.7, 0.7 + 2.0 * math.pi))
    assert_close(one, other)
