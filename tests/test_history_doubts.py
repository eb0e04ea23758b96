"""Warnings of a simulation: each says what, where and when."""

from __future__ import annotations

import re
from pathlib import Path as File

import numpy as np
import pytest

import ftforce
from ftforce.trajectory import Path, Recording
from ftforce.trajectory.warnings import length_in_words

LINE = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)
PUSH = {"force": [80, 50, 10], "rate": 10}


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


def warnings(robot, trajectory, **options):
    return ftforce.simulate(robot, trajectory, **{**PUSH, **options}).warnings


def test_nothing_is_doubtful(dh5):
    assert warnings(dh5, LINE, faults="3@1") == ()
    assert warnings(dh5, LINE, faults="weak:3:0.5@1") == ()


def test_a_path_out_of_reach(dh5):
    far = Path.through([(0.9, 0.3, 0.2), (1.4, 0.35, 0.25)], speed=0.2)
    history = ftforce.simulate(dh5, far, **PUSH)
    found, lacking, abrupt = history.warnings
    assert abrupt.startswith("joint velocities change abruptly at ")  # 10 Hz are few
    error = history.healthy.path_error_norm
    i = error.argmax()
    assert found.startswith("even the healthy arm deviates from its path, by ")
    assert f"{1e3 * error[i]:.3g} mm at {history.t[i]:g} s" in found
    missing = np.linalg.norm(PUSH["force"] - history.healthy.force, axis=1)
    worst = missing.argmax()
    assert lacking == (
        f"even the healthy arm cannot exert {missing[worst]:.3g} N of the force at "
        f"{history.t[worst]:g} s: its Jacobian is rank deficient there"
    )
    assert missing[worst] > 10.0


@pytest.mark.parametrize("sign", [1, -1])
def test_positions_beyond_the_limits_and_too_fast(dh5, sign):
    t = np.linspace(0.0, 1.0, 11)
    q = np.zeros((11, 5))
    q[:, 1] = sign * 4.0 * t  # limits are π and 1.57 rad/s
    q[:, 0] = 0.1
    found = warnings(dh5, Recording.of(dh5, t, q), rate=None)
    span = "0 to 4" if sign > 0 else "-4 to 0"
    assert any(
        re.match(rf"joint 2 joint2 moves from {span} rad, outside its limits -3\.14", w)
        for w in found
    )
    assert any(
        w.startswith("joint 2 joint2 reaches 4 rad/s; its velocity limit is 1.57") for w in found
    )
    assert not any("joint1" in w for w in found)


def test_torques_beyond_the_urdf_s(dh5):
    strong = {"force": [8000, 0, 0]}
    history = ftforce.simulate(dh5, LINE, **{**PUSH, **strong})
    motor = np.abs(history.healthy.motor)
    named = [w for w in history.warnings if "effort limit" in w]
    over = [j for j in dh5.joints if motor[:, j.number - 1].max() > j.effort]
    assert len(named) == len(over) > 0
    first = over[0]
    share = motor[:, first.number - 1].max() / first.effort
    assert f"joint {first.number} {first.name} would need {100 * share:.4g}% of" in named[0]
    assert "(limits are not enforced)" in named[0]
    assert not any("effort" in w for w in warnings(dh5, LINE, limits="urdf", **strong))


def test_weak_joints_without_a_limit(dh5):
    (found,) = warnings(dh5, LINE, faults="weak:3:0.5@1", limits="none")
    assert found == "joint 3 joint3 is weak, but no limits are enforced: it is treated as healthy"
    unknown = ftforce.core.limits.Limits.of([150, 150, np.nan, 40, 20])
    (found,) = warnings(dh5, LINE, faults="weak:3:0.5@1", limits=unknown)
    assert found == "joint 3 joint3 is weak, but its torque limit is unknown and is not enforced"


def test_masses_that_are_missing(dh5, tmp_path):
    urdf = re.sub(r"\s*<inertial>.*?</inertial>", "", File(dh5.path).read_text(), flags=re.DOTALL)
    (tmp_path / "bare.urdf").write_text(urdf)
    bare = ftforce.load_robot(tmp_path / "bare.urdf")
    start = dh5.postures["paper"]
    found = ftforce.simulate(bare, LINE, start, faults="3@1", **PUSH)
    assert found.warnings[0].startswith("the URDF has no masses")
    assert not found.setting.has_masses
    assert not found.healthy.rnea.any()
    (event,) = found.setting.events
    assert event.impact_jump == ()
    assert len(event.velocity_jump) == 3


def test_lengths_in_words():
    lengths = {0.0: "< 1 µm", 9e-7: "< 1 µm", 1e-6: "1 µm", 1.234e-4: "123 µm"}
    lengths |= {9.996e-4: "1 mm", 0.0123: "12.3 mm", 0.9999: "1 m", 2.5: "2.5 m"}
    assert {x: length_in_words(x) for x in lengths} == lengths
