"""Best postures and failure-tolerant workspaces on the page."""

import numpy as np
import pytest

import ftforce
from ftforce.robot.kinematics import tip_pose
from ftforce.view.planned import open_posture, open_reach
from test_cli import run
from test_self_motion import planar

IN_PLANE = {"task": ["fx", "fy"], "axes": "world"}


def spied(session, name):
    """Return the node of a scene."""
    return session.server.scene._handle_from_node_name[name]


def test_the_page_of_a_best_posture_has_its_worst_set_and_its_self_motion():
    found = ftforce.best_posture(planar(), (1.5, 0.0, 0.0), **IN_PLANE)
    with open_posture(found) as session:
        shown = session.answer.analysis
        np.testing.assert_array_equal(shown.question.q, found.after.q)
        assert shown.question.faults == found.sets[found.worst_set(found.measured_after)]
        fan = spied(session, "/self-motion")
        ends = np.asarray(fan.points)
        tips = np.linalg.norm(ends[:, 1] - [1.5, 0.0, 0.0], axis=1)
        assert (tips < 1e-6).sum() >= 30  # every ghost has its tip in the place
        assert len(np.unique(np.asarray(fan.colors).reshape(-1, 3), axis=0)) > 5


@pytest.mark.thorough
def test_the_page_of_a_reach_has_the_cells_that_every_lock_leaves():
    limits = [(-0.356, 0.356), (-1.79, 1.79), (-1.93, 1.93)]
    found = ftforce.reach(planar("continuous"), within=limits, release=True, cell=0.2)
    with open_reach(found) as session:
        shown = np.asarray(spied(session, "/reach/shown").points)
    assert len(shown) == found.tolerated_middles.sum() > 0
    assert {found.state_at(place) for place in shown[:, :2].astype(float)} == {1}


@pytest.mark.parametrize("words", [("posture", "--like", "paper"), ("reach", "--cell", "0.5")])
def test_command_writes_the_page(tmp_path, words):
    file = tmp_path / "page.html"
    shown = run(words[0], "dh5", *words[1:], "--export", str(file)).stdout
    assert "page.html" in shown
    assert file.read_text().lower().startswith("<!doctype html>")
    run(words[0], "dh5", *words[1:], "--export", str(tmp_path / "page.txt"), status=2)


def test_lines_of_the_fan_end_at_the_tip():
    arm = planar()
    q = np.array([0.3, 0.4, -0.2])
    from ftforce.view.planned import _along

    np.testing.assert_allclose(_along(arm, q)[-1, 1], tip_pose(arm, q)[1])
