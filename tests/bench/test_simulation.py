"""The paper's run, and how its cost grows, beside a loop that a user would write."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from effort import rounds
from ftforce.trajectory.path import Path
from ftforce.trajectory.section_v import END, FORCE, SPEED, START, section_v
from ftforce.trajectory.timeline import timeline

RATE = 100.0
LINE = Path.through([START, END], speed=SPEED)


def by_hand(robot, q):
    """Healthy and faulty torques along the line, as people write it: one Euler step per sample.

    One history with the remap; no limits, verdicts, margins or path error.
    """
    model, data, frame = robot.model, robot.model.createData(), robot.tip_frame
    F, dt, locked = np.array(FORCE), 1.0 / RATE, 2
    t = np.arange(0.0, LINE.duration, dt)
    tau, v_old = np.zeros((len(t), model.nv)), np.zeros(model.nv)
    q = q.copy()
    for i, time in enumerate(t):
        x, x_dot = LINE.at(time)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        error = x - data.oMf[frame].translation
        K = J.copy()
        if time >= 50.0:
            K[:, locked] = 0.0
        v = np.linalg.pinv(K) @ (x_dot + 10.0 * error)
        R = data.oMf[frame].rotation
        tau[i] = pin.rnea(model, data, q, v, (v - v_old) / dt) + K.T @ (R @ F)
        q, v_old = q + dt * v, v
    return tau


@pytest.fixture(scope="module")
def start():
    return section_v(rate=1).healthy.q[0]


@pytest.mark.benchmark(group="Section V, 97.6 s at 100 Hz, goal 2 s")
def test_three_histories(benchmark):
    history = benchmark.pedantic(section_v, rounds=rounds(5), warmup_rounds=1)
    assert len(history.t) > 9700
    assert len(history.runs) == 3


@pytest.mark.benchmark(group="Section V, 97.6 s at 100 Hz, goal 2 s")
def test_one_history_by_hand(benchmark, start):
    robot = ftforce.load_robot("dh5")
    tau = benchmark.pedantic(by_hand, args=(robot, start), rounds=rounds(5), warmup_rounds=1)
    assert len(tau) > 9700


@pytest.mark.benchmark(group="Section V at other rates: linear in the number of samples")
@pytest.mark.parametrize("rate", [100.0, 200.0, 400.0])
def test_rates(benchmark, rate):
    history = benchmark.pedantic(
        section_v, kwargs={"rate": rate}, rounds=rounds(2), warmup_rounds=0
    )
    assert len(history.t) > 97.0 * rate


@pytest.mark.benchmark(group="timeline of panda, 7 sets, 100 instants")
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_timeline(benchmark, mode):
    panda = ftforce.load_robot("panda")
    line = Path.through([(0.3, 0.0, 0.5), (0.4, 0.3, 0.4)], speed=0.2)
    rate = 99.0 / line.duration

    def run():
        return timeline(panda, line, mode=mode, force=[0, 0, 30], rate=rate)

    result = benchmark.pedantic(run, rounds=rounds(5), warmup_rounds=1)
    assert result.jump.shape == (100, 7)
