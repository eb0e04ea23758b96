"""Sentences of simulations and timelines, checked against the numbers they speak of."""

from __future__ import annotations

import numpy as np
import pytest

import ftforce
from ftforce.history_words import (
    history_sentence,
    peak,
    timeline_sentence,
    worst_verdict,
)
from ftforce.section_v import END, START
from ftforce.trajectory import Path

LINE = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


def simulated(dh5, **options):
    return ftforce.simulate(dh5, LINE, **{"force": [80, 50, 10], "rate": 10, **options})


def test_healthy(dh5):
    history = simulated(dh5)
    assert history_sentence(history) == (
        "Tolerated: with every joint healthy, the arm keeps the whole 94.87 N at the tip to the "
        f"end, at {history.t[-1]:g} s. The tip stays within 1 µm of its path."
    )


def test_a_lock_with_and_without_the_remap(dh5):
    kept = simulated(dh5, faults="4@1")
    assert history_sentence(kept).startswith(
        "Tolerated: after 4 joint4 locked at 1 s, the remap keeps the whole 94.87 N"
    )
    lost = simulated(dh5, faults="4@1", remap=False)
    error = lost.unremapped.path_error_norm
    sentence = history_sentence(lost)
    assert sentence.startswith("Tolerated, but off the path: ")
    assert "the arm, without any remap, keeps the whole" in sentence
    assert f"up to {1e3 * error.max():.3g} mm, at {lost.t[error.argmax()]:g} s" in sentence


def test_a_force_that_jumps(dh5):
    history = simulated(dh5, faults="free:4@1")
    jump = history.jump_norm(history.remapped)
    sentence = history_sentence(history)
    assert sentence.startswith("Not tolerated: after 4 joint4 free at 1 s, from 1 s on the force")
    assert f"by up to {jump.max():.2f} N of 94.87 N, at {history.t[jump.argmax()]:g} s" in sentence


def test_torques_that_nothing_balances(dh5):
    history = simulated(dh5, faults="free:4@1", remap=False)
    assert history.unremapped.falls_from == 10
    assert history.healthy.falls_from is None
    assert history_sentence(history).endswith(
        "torques that nothing balances move the arm. Where that takes the arm is not simulated."
    )


def test_nothing_holds_the_arm(dh5):
    history = simulated(dh5, faults="free:2,3,4,5@1")
    assert np.isnan(history.remapped.force).any()
    assert "nothing holds the arm at 1 s" in history_sentence(history)
    from_the_start = simulated(dh5, faults="free:2,3,4,5@0")
    assert "nothing holds the arm from 0 s" in history_sentence(from_the_start)


def test_borderline_says_why(dh5):
    # From this start the wrist stays nearly in line with the forearm.
    start = np.deg2rad([-4.51, 8.73, -13.78, 12.31, -13.05])
    history = ftforce.simulate(
        dh5, Path.through([START, END], speed=0.015), start,
        force=[80, 50, 10], faults="3@50", rate=1,
    )  # fmt: skip
    assert worst_verdict(history.answer).value == "borderline"
    sentence = history_sentence(history)
    first = history.t[np.argmax(history.answer.margin < 1e-2)]
    assert sentence.startswith("Borderline")
    assert f"after 3 joint3 locked at 50 s, from {first:g} s on it depends" in sentence
    assert f"(smallest margin {history.answer.margin.min():.3g})" in sentence


def test_worst_verdict_is_of_all_instants(dh5):
    history = simulated(dh5, faults="free:4@1")
    assert worst_verdict(history.healthy).value == "tolerated"
    assert worst_verdict(history.remapped).value == "not tolerated"


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
