"""A payload with its own inertia, beside models to which Pinocchio itself attached the body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce.analysis.conditions import read_payload
from ftforce.core.remap import velocity_after_impact
from ftforce.errors import InputError, PayloadError
from ftforce.robot.dynamics import (
    Payload,
    mass_matrix,
    motion_torque,
    rnea_torque,
    rnea_torques,
    weight_torque,
)
from helpers import assert_close
from results import json_of

FILE = Path(__file__).parent.parent / "docs/examples/gripper.toml"
MOMENTS = (0.004, 0.005, 0.002, 0.0, 0.0001, -0.0002)
MATRIX = np.array([[0.004, 0, 0.0001], [0, 0.005, -0.0002], [0.0001, -0.0002, 0.002]])
# Large enough that its inertia matters beside the arm's.
HEAVY = Payload.of(3.0, (0.1, -0.2, 0.15), (0.9, 1.1, 0.7, 0.1, -0.2, 0.05))


def loaded(robot, payload):
    """Return the model of an arm whose tip carries the payload."""
    model = robot.model.copy()
    tip = model.frames[robot.tip_frame]
    body = pin.Inertia(payload.mass, payload.offset, payload.inertia)
    model.appendBodyToJoint(tip.parentJoint, body, tip.placement)
    return model, model.createData()


@pytest.mark.parametrize("name", ["dh5", "panda", "tiago"])
def test_dynamics_beside_an_appended_body(name):
    robot, rng = ftforce.load_robot(name), np.random.default_rng(4)
    model, data = loaded(robot, HEAVY)
    fold = robot.coordinates
    for _ in range(5):
        q, v, a = rng.uniform(-1.0, 1.0, (3, robot.n))
        place = robot.to_model(q)
        weight = fold.fold_torque(pin.computeGeneralizedGravity(model, data, place))
        assert_close(weight_torque(robot, q, None, HEAVY), weight)
        torque = fold.fold_torque(pin.rnea(model, data, place, fold.rate(v), fold.rate(a)))
        assert_close(rnea_torque(robot, q, v, a, payload=HEAVY), torque)
        assert_close(motion_torque(robot, q, v, a, HEAVY), torque - weight, scale=norm(torque))
        many = rnea_torques(robot, q[None], v[None], a[None], payload=HEAVY)
        assert_close(many[0], torque)
        M = fold.G.T @ np.array(pin.crba(model, data, place)) @ fold.G
        assert_close(mass_matrix(robot, q, HEAVY), M)
    point = Payload.of(HEAVY.mass, HEAVY.offset)
    assert not np.allclose(rnea_torque(robot, q, v, a, payload=point), torque, rtol=1e-3)


def norm(x):
    return float(np.linalg.norm(x))


def test_impact_with_a_payload(panda):
    v = np.linspace(0.5, -0.5, 7)
    found = ftforce.analyze(panda, locked=2, velocity=v, payload=HEAVY)
    model, data = loaded(panda, HEAVY)
    M = np.array(pin.crba(model, data, panda.to_model(found.posture.q)))
    after = velocity_after_impact(M, found.reduced.locked, v)
    assert_close(found.impact.after, after)


def test_the_file_and_its_other_forms(tmp_path, panda):
    payload = read_payload(FILE)
    assert payload.mass == 1.2
    np.testing.assert_array_equal(payload.offset, [0.0, 0.01, 0.06])
    np.testing.assert_array_equal(payload.inertia, MATRIX)
    assert payload.moments == MOMENTS
    table = "mass = 1.2\ncentre = [0, 0.01, 0.06]\n[inertia]\n"
    table += "".join(f"{key} = {x}\n" for key, x in zip(
        ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), MOMENTS, strict=True
    ))  # fmt: skip
    other = tmp_path / "tool.TOML"
    other.write_text(table)
    text = "1.2@0,0.01,0.06@0.004,0.005,0.002,0,0.0001,-0.0002"
    for given in (str(other), text, Payload.of(1.2, (0, 0.01, 0.06), MATRIX)):
        one = read_payload(given)
        assert str(one) == str(payload)
        np.testing.assert_array_equal(one.inertia, MATRIX)
    assert "inertia (0.004, 0.005, 0.002, 0, 0.0001, -0.0002) kg·m²" in str(payload)
    found = json_of(ftforce.analyze(panda, payload=FILE))["conventions"]
    assert found["payload"]["inertia"] == MATRIX.tolist()
    point = tmp_path / "point.toml"
    point.write_text("mass = 2\n")
    assert read_payload(point).inertia is None
    point.write_text("mass = 2\ninertia = {ixx = 1, iyy = 2, izz = 1.5, ixz = 0.1}")
    np.testing.assert_array_equal(
        read_payload(point).inertia, [[1, 0, 0.1], [0, 2, 0], [0.1, 0, 1.5]]
    )


def test_a_history_keeps_the_inertia(tmp_path):
    robot = ftforce.load_robot("dh5")
    path = ftforce.trajectory.Path.through([(0.9, 0.3, 0.2), (0.88, 0.31, 0.21)], speed=0.2)
    run = ftforce.simulate(robot, path, force=[8, 5, 1], payload=FILE, rate=50)
    ftforce.save(run, tmp_path / "run.npz")
    kept = ftforce.load_history(tmp_path / "run.npz").setting.carried
    np.testing.assert_array_equal(kept.inertia, MATRIX)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("centre = [0, 0, 0]", "contains no mass"),
        ("mass = 'x'", "the payload needs a mass in kg"),
        ("mass = -1", "the payload's mass must be 0 kg or more"),
        ("mass = 1\ncenter = [0, 0, 0]", "unknown key 'center'; available: mass, centre, inertia"),
        ("mass = 1\ncentre = [0, 0]", "the payload's position needs 3 numbers"),
        ("mass = 1\ninertia = [1, 1, 1]", "the payload's inertia needs the moments ixx, iyy"),
        ("mass = 1\ninertia = 'x'", "the payload's inertia"),
        ("mass = 1\ninertia = [1, 1, nan, 0, 0, 0]", "the payload's inertia"),
        ("mass = 1\ninertia = [1, 1, 1e300, 0, 0, 0]", "the payload's inertia must not exceed"),
        ("mass = 1\ninertia = [1, 1, 2.1, 0, 0, 0]", "no rigid body has the payload's inertia"),
        ("mass = 1\ninertia = [1, 1, 1, 1.5, 0, 0]", "no rigid body has the payload's inertia"),
        ("mass = 1\ninertia = [1, 1, 0, 0, 0, 0]", "no rigid body has the payload's inertia"),
        ("mass = 0\ninertia = [1, 1, 1, 0, 0, 0]", "a payload of no mass has no inertia"),
        (
            "mass = 1\n[inertia]\nixx = 1",
            "inertia needs the keys ixx, iyy, izz; ixy, ixz, iyz are 0",
        ),
        ("mass = 1\n[inertia]\nixx = 1\niyy = 1\nizz = 1\nizy = 0", "inertia needs the keys"),
        ("mass = ", "is not valid TOML"),
    ],
)
def test_files_that_are_no_payload(tmp_path, text, message):
    path = tmp_path / "tool.toml"
    path.write_text(text)
    with pytest.raises(PayloadError) as caught:
        read_payload(path)
    assert str(caught.value).removeprefix(f"{path}: ").startswith(message)
    assert str(caught.value).isprintable()


def test_a_matrix_must_be_symmetric():
    with pytest.raises(InputError, match="not symmetric"):
        Payload.of(1.0, (0, 0, 0), [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(PayloadError, match="no such file"):
        read_payload("nowhere.toml")
    # A flat plate: the largest moment is the sum of the others.
    assert Payload.of(1.0, (0, 0, 0), [0.1, 0.2, 0.3, 0, 0, 0]).moments[2] == 0.3
