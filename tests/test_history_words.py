"""Sentences of simulations and timelines, checked against the numbers they speak of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ftforce
from ftforce.errors import InputError
from ftforce.report.history import history_sentence, peak, worst_verdict
from ftforce.report.timeline import timeline_sentence
from ftforce.trajectory import Path
from ftforce.trajectory.section_v import END, START
from urdfs import joint, link, load, robot

LINE = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


def simulated(dh5, **options):
    return ftforce.simulate(dh5, LINE, **{"force": [80, 50, 10], "rate": 10, **options})


def test_healthy(dh5):
    history = simulated(dh5)
    assert history_sentence(history) == (
        "Tolerated: with every joint healthy, the arm keeps the full 94.87 N at the tip until "
        f"the end, at {history.t[-1]:g} s. The tip stays within 1 µm of its path."
    )


def test_a_lock_with_and_without_the_remap(dh5):
    kept = simulated(dh5, faults="4@1")
    assert history_sentence(kept).startswith(
        "Tolerated: with 4 joint4 locked at 1 s, the remap keeps the full 94.87 N"
    )
    lost = simulated(dh5, faults="4@1", remap=False)
    error = lost.unremapped.path_error_norm
    sentence = history_sentence(lost)
    assert sentence.startswith("Tolerated, but off the path: ")
    assert "the arm, without any remap, keeps the full" in sentence
    assert f"up to {1e3 * error.max():.3g} mm, at {lost.t[error.argmax()]:g} s" in sentence


def test_a_force_that_jumps(dh5):
    history = simulated(dh5, faults="free:4@1")
    assert worst_verdict(history.healthy).value == "tolerated"
    assert worst_verdict(history.remapped).value == "not tolerated"
    jump = history.jump_norm(history.remapped)
    sentence = history_sentence(history)
    assert sentence.startswith("Not tolerated: with 4 joint4 free at 1 s, from 1 s on the full")
    assert f"jumps by up to {jump.max():.2f} N, at {history.t[jump.argmax()]:g} s" in sentence


def test_torques_that_nothing_balances(dh5):
    history = simulated(dh5, faults="free:4@1", remap=False)
    assert history.unremapped.falls_from == 10
    assert history.healthy.falls_from is None
    assert history_sentence(history).endswith(
        "unbalanced torques move the arm. The motion that follows is not simulated."
    )


def test_nothing_holds_the_arm(dh5):
    history = simulated(dh5, faults="free:2,3,4,5@1")
    assert np.isnan(history.remapped.force).any()
    assert "the arm cannot be held in static equilibrium at 1 s" in history_sentence(history)
    from_the_start = simulated(dh5, faults="free:2,3,4,5@0")
    assert "the arm cannot be held in static equilibrium from 0 s" in history_sentence(
        from_the_start
    )


def test_borderline_says_why(dh5):
    # From this start the wrist stays nearly in line with the forearm.
    start = np.deg2rad([-4.51, 8.73, -13.78, 12.31, -13.05])
    line, force = Path.through([START, END], speed=0.015), [80, 50, 10]
    history = ftforce.simulate(dh5, line, start, force=force, faults="3@50", rate=1)
    assert worst_verdict(history.answer).value == "borderline"
    sentence = history_sentence(history)
    first = history.t[np.argmax(history.answer.margin < 1e-2)]
    assert sentence.startswith("Borderline")
    assert f"with 3 joint3 locked at 50 s, from {first:g} s on it depends" in sentence
    assert f"(smallest margin {history.answer.margin.min():.3g})" in sentence


def test_timelines(dh5):
    kept = ftforce.timeline(dh5, LINE, force=[80, 50, 10], rate=5)
    worst = kept.worst()[0]
    assert f"{worst.margin:.3g}" in timeline_sentence(kept)
    lost = ftforce.timeline(dh5, LINE, force=[80, 50, 10], rate=5, mode="free")
    worst = lost.worst()[0]
    name = dh5.names[worst.faults.joints[0]]
    sentence = timeline_sentence(lost)
    assert sentence.startswith(f"Not tolerated. Worst: {worst.faults.joints[0] + 1} {name} free")
    assert f"jumps by {worst.jump:.2f} N" in sentence
    assert f"at {worst.time:g} s" in sentence


def test_peak():
    assert peak(np.array([1.0, -3.456, np.nan])) == "3.46"
    assert peak(np.array([np.nan])) == "–"


PLANE = robot(
    *map(link, "abcde"),
    joint("one", "a", "b", axis="0 1 0"),
    joint("two", "b", "c", axis="0 1 0", xyz="0.4 0 0", rpy="0 0 0"),
    joint("three", "c", "d", axis="0 1 0", xyz="0.4 0 0", rpy="0 0 0"),
    joint("end", "d", "e", "fixed", xyz="0.3 0 0", rpy="0 0 0"),
)


def test_a_force_that_no_arm_exerts_is_not_kept(tmp_path):
    """What an arm in a plane is asked to push out of it, it cannot."""
    arm = load(tmp_path, PLANE, tip="e")
    q = [0.3, 0.6, 0.4]
    x = ftforce.trajectory.start.tip_at(arm, q, None)
    J = ftforce.robot.kinematics.frame_jacobian(arm, np.array(q), "world")[:3]
    across = np.linalg.svd(J)[0][:, -1]
    along = J[:, 0] / np.linalg.norm(J[:, 0])
    line = Path.through([x, x + 0.05 * along], speed=0.1)
    case = {"faults": "2@0.3", "rate": 20, "gravity": [0, 0, 0], "axes": "world"}
    with pytest.raises(InputError, match="exert this force at any instant of the trajectory: no j"):
        ftforce.simulate(arm, line, q, force=30.0 * across, **case)
    with pytest.raises(InputError, match="exert this force at any instant of the trajectory: no j"):
        ftforce.timeline(arm, line, q, force=30.0 * across, rate=20, axes="world")
    both = 40.0 * along + 30.0 * across
    history = ftforce.simulate(arm, line, q, force=both, **case)
    assert history.healthy.force @ across == pytest.approx(0.0, abs=1e-9)
    assert "of the 50.00 N" in history_sentence(history)


def test_no_fault_is_blamed_for_what_the_healthy_arm_cannot_do():
    panda = ftforce.load_robot("panda")
    line = Path.through([(0.3, 0, 0.5), (0.4, 0.3, 0.4)], speed=0.2)
    history = ftforce.simulate(panda, line, force=[0, 0, 300], faults="4@1", limits="urdf", rate=20)
    assert worst_verdict(history.healthy).value == "not tolerated"
    sentence = history_sentence(history)
    assert "Even the healthy arm is not tolerated from the start." in sentence


def test_verdicts_that_come_and_go_are_said_with_their_share(dh5):
    verdict = simulated(dh5).healthy.verdict.copy()
    verdict[[3, 7]] = 2
    history = simulated(dh5)
    run = replace(history.healthy, verdict=verdict)
    history = replace(history, healthy=run, unremapped=run, remapped=run)
    share = 2 / len(verdict)
    assert f"at {100 * share:.3g}% of all instants, first at {history.t[3]:g} s" in (
        history_sentence(history)
    )


def test_a_tip_that_turns_is_said_to():
    ur5 = ftforce.load_robot("ur5")
    x = ftforce.trajectory.start.tip_at(ur5, None, None)
    line = Path.through([x, x + np.array([0.1, 0.1, -0.1])], speed=0.1, keep_orientation=True)
    history = ftforce.simulate(ur5, line, force=[0, 0, 0], faults="6@0.5", rate=20)
    turn = np.rad2deg(history.remapped.orientation_error_norm.max())
    assert turn > 1.0
    assert history_sentence(history).endswith(f"It turns by up to {turn:.3g}°.")
