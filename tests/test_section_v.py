"""The paper's simulation: its path, and Figs. 2 to 4 in shape."""

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce.robot.kinematics import tip_pose
from ftforce.trajectory.section_v import END, FORCE, SPEED, START, section_v
from helpers import assert_close


@pytest.fixture(scope="module")
def history():
    return section_v(rate=10)


def test_path_is_the_paper_s(history):
    dh5 = ftforce.load_robot("dh5")
    for run in (history.healthy, history.remapped):
        for i, end in ((0, START), (-1, END)):
            assert_close(tip_pose(dh5, run.q[i])[1], end, tol=1e-7)
            assert_close(run.position[i], end, tol=1e-7)
    speed = np.linalg.norm(np.gradient(history.path, history.t, axis=0), axis=1)
    assert speed.max() == pytest.approx(SPEED, rel=1e-3)
    along = (history.path - START) @ (np.array(END) - START)
    off = (
        history.path
        - START
        - np.outer(along, np.array(END) - START) / np.sum((np.array(END) - START) ** 2)
    )
    assert np.abs(off).max() < 1e-12  # a straight line
    assert (np.diff(along) >= -1e-15).all()


def test_tracking_error_is_far_below_the_promise(history):
    for run in (history.healthy, history.remapped):
        assert run.path_error_norm.max() < 1e-5


def test_joint_3_locks_after_50_s(history):
    (event,) = history.setting.events
    assert (event.time, event.faults) == (50.0, "3 joint3 locked")
    after = history.t >= 50.0
    for run in (history.unremapped, history.remapped):
        assert np.ptp(run.q[after, 2]) == 0.0
        assert not run.v[after, 2].any()
        assert not run.motor[after, 2].any()  # Fig. 3: "mapped to zero after fault"
        assert run.brake[after, 2].all()
    assert history.healthy.motor[after, 2].all()
    for name in ("q", "motor", "force"):
        np.testing.assert_array_equal(
            getattr(history.remapped, name)[~after], getattr(history.healthy, name)[~after]
        )


def test_force_is_kept_fig_4(history):
    for run in (history.healthy, history.remapped):
        assert_close(run.force, np.tile(FORCE, (len(history.t), 1)), tol=1e-9)
        assert set(run.verdicts) == {ftforce.Verdict.TOLERATED}


def test_torques_are_those_of_inverse_dynamics_with_the_force_at_the_tip(history):
    """Figs. 2 and 3: Pinocchio's own RNEA with the reaction as an external force."""
    dh5 = ftforce.load_robot("dh5")
    model, data = dh5.model, dh5.model.createData()
    frame = model.frames[dh5.tip_frame]
    for run in (history.healthy, history.remapped):
        for i in (0, 100, 499, 505, 800, -1):
            reaction = pin.Force(-np.array(FORCE), np.zeros(3))  # on the robot, in tool axes
            external = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
            external[frame.parentJoint] = frame.placement.act(reaction)
            tau = pin.rnea(model, data, run.q[i], run.v[i], run.a[i], external)
            assert_close(run.motor[i] + run.brake[i], tau, tol=1e-9)


def test_what_the_paper_leaves_open_is_stated(history):
    notes = " ".join(history.setting.notes)
    for word in ("masses", "initial posture", "timing law", "shape, not in every digit"):
        assert word in notes


def test_without_the_remap_the_path_is_lost_but_no_torque_was_wrong(history):
    """Theory §2: where τ = JᵀF, the healthy torques need no change; the motion does."""
    run = history.unremapped
    assert run.path_error_norm[-1] > 0.05
    assert_close(run.force, np.tile(FORCE, (len(history.t), 1)), tol=1e-9)
