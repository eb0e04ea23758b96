"""Friction and rotor inertia of drives: beside MuJoCo and closed forms, and in every path."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ftforce
import physics
import urdfs
from ftforce.analysis.drives import choose_drives
from ftforce.analysis.limits_files import read_limits
from ftforce.core.limits import DriveTerms, Limits
from ftforce.core.remap import velocity_after_impact
from ftforce.errors import InputError
from ftforce.robot.dynamics import mass_matrix, rnea_torque, rnea_torques
from ftforce.trajectory import Recording
from ftforce.trajectory import timeline as module
from helpers import assert_close
from results import json_of

ON = {"joint_friction": True, "armature": True}
Q = np.array([0.2, 1.0, 0.4, 1.0, 0.1])
V = np.array([0.8, -0.5, 0.0, 0.3, -1.2])
A = np.array([1.0, 0.5, -0.7, 2.0, -3.0])
TERMS = DriveTerms(
    np.array([3.0, 2.0, 1.0, 0.0, 0.4]),
    np.array([1.5, 0.0, 0.8, 0.6, 0.3]),
    np.array([0.9, 1.2, 0.0, 0.3, 0.1]),
)


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def limits():
    nothing = np.full(5, np.nan)
    return Limits(np.full(5, 200.0), nothing, terms=TERMS)


def test_torques_beside_a_simulator(dh5):
    model, data, _ = physics.simulate(dh5, Q, V)
    data.qacc[:] = A
    mujoco.mj_inverse(model, data)
    bare = data.qfrc_inverse.copy()
    model.dof_frictionloss[:], model.dof_damping[:], model.dof_armature[:] = TERMS
    mujoco.mj_inverse(model, data)
    added = data.qfrc_inverse - bare
    moving = V != 0.0  # at rest the simulator's friction is what it takes to stay there
    assert_close(TERMS.torque(V, A)[moving], added[moving], tol=1e-6)
    found = rnea_torque(dh5, Q, V, A, drives=TERMS)
    assert_close(found[moving], data.qfrc_inverse[moving], tol=1e-6)
    assert_close(found - rnea_torque(dh5, Q, V, A), TERMS.torque(V, A), scale=10.0)
    many = rnea_torques(dh5, Q[None], V[None], A[None], drives=TERMS)
    assert_close(many[0], found)


def test_mass_matrix_beside_a_simulator(dh5):
    model, data, _ = physics.simulate(dh5, Q)
    model.dof_armature[:] = TERMS.armature
    mujoco.mj_forward(model, data)
    M = np.zeros((5, 5))
    for column, unit in zip(M, np.eye(5), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    assert_close(mass_matrix(dh5, Q, drives=TERMS), M, tol=1e-9)


def test_terms_of_an_analysis(dh5, limits):
    asked = {"velocity": V, "acceleration": A, "force": [5, 3, 1], "limits": limits}
    plain = ftforce.analyze(dh5, Q, locked=2, **asked)
    found = ftforce.analyze(dh5, Q, locked=2, **asked, **ON)
    before, after = (
        getattr(found.rnea, name) - getattr(plain.rnea, name) for name in ("before", "after")
    )
    assert_close(before, TERMS.torque(V, A), scale=10.0)
    still = np.array([1, 0, 1, 1, 1])  # a locked joint has none
    assert_close(after, TERMS.torque(still * V, still * A), scale=10.0)
    for one, armature in ((plain, 0.0), (found, TERMS.armature)):
        M = mass_matrix(dh5, Q) + np.diag(armature * np.ones(5))
        assert_close(one.impact.after, velocity_after_impact(M, one.reduced.locked, V))
    words = "joint friction (Coulomb and viscous) and rotor inertia"
    assert json_of(found)["conventions"]["drives"] == words
    assert "drives" not in json_of(plain)["conventions"]


def test_free_swinging_joints_have_no_friction_of_a_drive(dh5, limits):
    asked = {"velocity": V, "limits": limits, "joint_friction": True}
    found = ftforce.analyze(dh5, Q, free=1, **asked)
    plain = ftforce.analyze(dh5, Q, free=1, velocity=V, limits=limits)
    added = found.rnea.after - plain.rnea.after
    assert_close(added, TERMS.torque(V, 0.0 * V) * [0, 1, 1, 1, 1], scale=10.0)
    assert_close(found.rnea.before - plain.rnea.before, TERMS.torque(V, 0.0 * V), scale=10.0)
    census = ftforce.census(dh5, Q, mode="free", faults=1, **asked)
    single = next(one for one in census.sets if one.faults.joints == (0,))
    assert single.verdict == found.verdict


def test_at_rest_nothing_changes(dh5, limits):
    plain, found = (
        ftforce.analyze(dh5, Q, force=[1, 2, 3], limits=limits, **on) for on in ({}, ON)
    )
    np.testing.assert_array_equal(plain.torque.total_after, found.torque.total_after)


def test_every_instant_of_a_motion(dh5, limits, monkeypatch):
    q = Q + 0.2 * np.sin(np.linspace(0.0, 3.0, 31))[:, None] * [1, -1, 0.5, 1, 2]
    recording = Recording.of(dh5, np.linspace(0.0, 3.0, 31), q)
    asked = {"force": [30.0, 20.0, 10.0], "limits": limits}
    run = ftforce.simulate(dh5, recording, faults="2@1.5", **asked, **ON)
    assert any(note.startswith("counted: joint friction") for note in run.setting.notes)
    for i in (3, 10, 25):
        v, a = run.answer.v[i], run.answer.a[i]
        bare = rnea_torque(dh5, run.answer.q[i], v, a)
        assert_close(run.answer.rnea[i] - bare, TERMS.torque(v, a), scale=10.0)
    found = ftforce.timeline(dh5, recording, faults=1, **asked, **ON)
    with monkeypatch.context() as patch:
        patch.setattr(module, "certain_cells", lambda *_: None)
        single = ftforce.timeline(dh5, recording, faults=1, **asked, **ON)
    np.testing.assert_allclose(found.capability, single.capability, rtol=1e-8, equal_nan=True)
    plain = ftforce.timeline(dh5, recording, faults=1, **asked)
    assert not np.allclose(found.capability, plain.capability, rtol=1e-3)


def test_where_the_values_come_from(tmp_path):
    dynamics = '<dynamics friction="0.3" damping="1" armature="0.25"/>'
    robot = ftforce.load_robot(urdfs.write(tmp_path, urdfs.j2(more=dynamics)))
    found = choose_drives(robot, None, **ON)
    assert [term[1] for term in found.terms] == [0.3, 1.0, 0.25]
    assert not np.delete(np.array(found.terms), 1, axis=1).any()
    words = ["unknown joint friction counts as zero: j1, j3, j4"]
    words.append("unknown rotor inertia counts as zero: j1, j3, j4")
    assert list(found.warnings()) == words
    assert set(words) <= set(ftforce.analyze(robot, velocity=np.ones(4), **ON).warnings)
    file = tmp_path / "limits.toml"
    file.write_text("j1 = {effort = 5, friction = 0.7}\nj2 = {effort = 5, damping = 2}\n")
    own = choose_drives(robot, read_limits(robot, file), **ON)
    assert own.terms.friction.tolist() == [0.7, 0.3, 0.0, 0.0]
    assert own.terms.damping.tolist() == [0.0, 2.0, 0.0, 0.0]
    half = choose_drives(robot, None, joint_friction=False, armature=True)
    assert not half.terms.friction.any()
    assert half.terms.armature[1] == 0.25
    assert choose_drives(robot, None, joint_friction=False, armature=False) is None
    with pytest.raises(InputError, match="armature must be True or False"):
        ftforce.analyze(robot, armature="yes")
