"""Pinocchio's data is shared by all functions of a thread: none may rely on what another left."""

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce.robot.inverse_kinematics import posture_at
from ftforce.robot.kinematics import joint_frames, tip_pose
from ftforce.robot.robot import Robot
from ftforce.trajectory import Path, Recording
from helpers import arrays_in, straight

PUSH = (10.0, 5.0, 20.0)  # N
LOAD = (1.0, (0.0, 0.1, 0.1))
MOTION = {"velocity": [0.3] * 7, "acceleration": [0.5] * 7}


def overwritten(robot):
    """Return the data of a robot, overwritten by the kinematics and dynamics of another posture."""
    data = USUAL(robot)
    q = robot.to_model(np.linspace(0.3, 1.7, robot.n))
    pin.computeAllTerms(robot.model, data, q, np.linspace(-1.0, 2.0, robot.model.nv))
    pin.updateFramePlacements(robot.model, data)
    data.tau[:], data.g[:] = 7.0, 9.0
    return data


USUAL = Robot.data.fget


def recorded(panda):
    t = np.linspace(0.0, 1.0, 51)
    return Recording.of(panda, t, panda.postures["default"] + 0.2 * np.sin(t)[:, None])


def along(panda, **options):
    _, x = tip_pose(panda, panda.postures["default"])
    path = Path.through([x, x + np.array([0.05, 0.1, -0.1])], speed=0.2, **options)
    return {"trajectory": path, "posture": "default", "rate": 10, "force": PUSH}


def held(capability):
    """Return the largest forces and payloads of a capability."""
    forces = [amount.maximum for d in capability.directions for amount in d.after.values()]
    return np.array([*forces, *(amount.maximum for amount in capability.payload)])


CALLS = {
    "analyze": lambda r: ftforce.analyze(r, locked=[2, 4], force=PUSH, payload=LOAD, **MOTION),
    "analyze torque": lambda r: ftforce.analyze(r, locked=[2], torque=[5] * 7, inverse="dynamic"),
    "analyze free": lambda r: ftforce.analyze(r, free=[2], force=PUSH, axes="world", gravity=PUSH),
    "census": lambda r: ftforce.census(r, faults=2, force=PUSH, payload=LOAD),
    "capability": lambda r: held(ftforce.capability(r, locked=[2], payload=LOAD, **MOTION)),
    "simulate": lambda r: ftforce.simulate(
        r, faults=["2@0.2", "free:4@0.3"], delay=0.1, payload=LOAD, **along(r)
    ),
    "simulate, turned": lambda r: ftforce.simulate(
        r, faults="2@0.2", gravity=PUSH, **along(r, keep_orientation=True)
    ),
    "simulate, recorded": lambda r: ftforce.simulate(r, recorded(r), force=PUSH, faults="2@0.4"),
    "timeline": lambda r: ftforce.timeline(r, payload=LOAD, **along(r)),
    "timeline, free": lambda r: ftforce.timeline(r, recorded(r), force=PUSH, mode="free"),
    "remapper": lambda r: np.copy(
        ftforce.Remapper(r, [[2], [4, 6]])(r.postures["default"], force=np.array(PUSH)).force_after
    ),
    "sweep": lambda r: ftforce.sweep(r, n=64, force=PUSH),
    "posture": lambda r: posture_at(r, np.array([0.4, 0.3, 0.4]), r.postures["default"]),
    "frames": lambda r: joint_frames(r, r.postures["default"]),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_results_do_not_depend_on_what_is_in_the_data(monkeypatch, panda, call):
    """Whoever keeps a reference into the data, or reads it after another call, reads rubbish."""
    wanted = dict(arrays_in(call(panda)))
    assert wanted
    monkeypatch.setattr(Robot, "data", property(overwritten))
    found = dict(arrays_in(call(panda)))
    assert found.keys() == wanted.keys()
    for name, array in wanted.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


def test_a_recorded_tip_returns_to_its_path_after_a_lock(panda):
    """The feedback on its position was zero: both positions were the same memory."""
    t = np.linspace(0.0, 4.0, 201)
    q = panda.postures["default"] + 0.2 * np.sin(np.outer(t, np.linspace(0.6, 1.4, 7)))
    recording = Recording.of(panda, t, q)
    history = ftforce.simulate(panda, recording, force=(0, 0, 0), faults="2@1", delay=0.1)
    error = history.remapped.path_error_norm
    assert error.max() > 3e-3  # m, during the delay
    assert error[-1] < 1e-4 * error.max()


def test_quaternions_outlive_what_they_come_from(panda):
    R = tip_pose(panda, panda.postures["default"])[0]
    found = [ftforce.robot.kinematics.quaternion(R) for _ in range(50)]
    assert all(x.flags.owndata for x in found)
    np.testing.assert_array_equal(found, [found[0]] * 50)


def test_straight_paths_too(panda):
    run = ftforce.simulate(panda, straight(panda), force=PUSH, faults="2@0.5", rate=20).remapped
    assert run.path_error_norm[-1] < 1e-5
