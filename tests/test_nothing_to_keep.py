"""Theory §2.6: what not even the healthy arm can exert is an error, never tolerated."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ftforce
from ftforce.core.task import Task
from ftforce.errors import InputError
from ftforce.robot.kinematics import frame_jacobian, noise_floor, task_jacobian
from ftforce.trajectory import Path
from ftforce.trajectory.start import tip_at
from helpers import load_text, serial_urdf

LEVEL = ("revolute", {"xyz": (0.3, 0, 0), "rpy": (0, 0, 0)})
ASKED = "even the healthy arm cannot exert"


@pytest.fixture(scope="module", params=[(0, 0, 0), (0.3, 0.7, 0.2), (math.pi / 2, 0, 0)], ids=str)
def planar(request):
    """Return an arm that moves its tip in a plane; across it J holds rounding errors only."""
    return load_text(serial_urdf(("revolute", {"rpy": request.param}), LEVEL, LEVEL))


@pytest.mark.parametrize("function", [ftforce.analyze, ftforce.census, ftforce.capability])
def test_a_task_across_the_plane_is_an_error(planar, function):
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (5, 3)):
        with pytest.raises(InputError, match=f"{ASKED} a force in this posture: no joint"):
            function(planar, q, task="fz")  # tool axes: z is the normal of the plane


def test_a_sweep_across_the_plane_is_an_error(planar):
    with pytest.raises(InputError, match=f"{ASKED} this force in any of 64 postures"):
        ftforce.sweep(planar, n=100, task="fz", force=[10.0])


def test_a_remapper_never_calls_it_tolerated(planar):
    remapper = ftforce.Remapper(planar, [[1], [2, 3]], task="fz")
    for q in np.random.default_rng(4).uniform(-2.0, 2.0, (5, 3)):
        assert remapper(q, force=np.array([10.0])).verdict.tolist() == [2, 2]
        assert not remapper.result.force_before.any()


def test_a_force_of_zero_is_kept(dh5):
    # Free motion: nothing is asked for, and nothing is lost.
    assert ftforce.analyze(dh5, locked=3, force=[0, 0, 0]).verdict.value == "tolerated"
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    remapper = ftforce.Remapper(dh5, [[3]])
    assert remapper(q, force=np.zeros(3)).verdicts[0].value == "tolerated"


@pytest.mark.parametrize("name", ["dh5", "panda", "ur5"])
def test_the_floor_takes_nothing_but_rounding(name):
    arm = ftforce.load_robot(name)
    linear, angular = noise_floor(arm)
    assert 1e-10 < linear < 1e-8
    assert angular == 1e-9
    for q in np.random.default_rng(5).uniform(-1.0, 1.0, (20, arm.n)):
        for row, component in enumerate(("fx", "fy", "fz", "mx", "my", "mz")):
            J = frame_jacobian(arm, q)[row : row + 1]
            found = task_jacobian(arm, q, Task((component,)))
            is_noise = np.abs(J).max() <= (linear if row < 3 else angular)
            np.testing.assert_array_equal(found, 0.0 * J if is_noise else J)


def test_a_slide_alone_has_a_floor_too():
    arm = load_text(serial_urdf(("prismatic", {"rpy": (0.3, 0.7, 0.2)})))
    assert noise_floor(arm) == (1e-9, 1e-9)
    with pytest.raises(InputError, match=ASKED):
        ftforce.analyze(arm, [0.1], task="fx")  # it slides along z of the tool
    assert ftforce.analyze(arm, [0.1], task="fz").verdict.value == "tolerated"


def test_torques_over_a_vanishing_lever_exert_nothing(dh5):
    # Joints 2, 4 and 5 turn about one axis, along which the tip cannot move: K is rounding.
    line = Path.through([tip_at(dh5, None, "paper"), (0.5, 0.6, 0.35)], speed=0.1)
    history = ftforce.simulate(
        dh5,
        line,
        posture="paper",
        force=[10.0],
        task="fz",
        axes="world",
        faults=["3@0", "free:1@0"],
        remap=False,
        rate=20,
    )
    at_fault = history.unremapped.force[0]
    assert abs(float(at_fault[0])) < 1.0  # 36,294,252 N before there was a floor
