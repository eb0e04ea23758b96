"""The array core and analyze() beside what a user would write by hand."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from effort import rounds
from ftforce.robot.known_robots import known_robots

LOCKED = np.array([False, True, False, True, False, False, False])
FORCE = np.array([80.0, 50.0, 10.0])


def by_hand(J, tau, locked, rtol=1e-6):
    """The twenty lines that people write; the tolerance is already the right one."""
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    r = int((s > rtol * s[0]).sum())
    F = U[:, :r] @ ((Vt[:r] @ tau) / s[:r])
    K = J[:, ~locked]
    U_K, s_K, _ = np.linalg.svd(K, full_matrices=False)
    r_K = int((s_K > rtol * s[0]).sum())
    F_after = U_K[:, :r_K] @ (U_K[:, :r_K].T @ F)
    jump = F - F_after
    torque = np.zeros(len(tau))
    torque[~locked] = K.T @ F
    margin = s_K[-1] / s[0] if len(s_K) == len(s) else 0.0
    return torque, F_after, jump, margin


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("panda")


@pytest.fixture(scope="module")
def problem(arm):
    q = arm.postures["default"]
    J = pin.computeFrameJacobian(arm.model, arm.data, q, arm.tip_frame, pin.LOCAL)[:3].copy()
    return J, J.T @ FORCE


@pytest.mark.benchmark(group="core: remap and jump, m = 3, n = 7, goal 15 us")
def test_remap(benchmark, problem):
    result = benchmark(ftforce.remap, *problem, LOCKED)
    assert result.is_proved()


@pytest.mark.benchmark(group="core: remap and jump, m = 3, n = 7, goal 15 us")
def test_remap_by_hand(benchmark, problem):
    torque, _, jump, _ = benchmark(by_hand, *problem, LOCKED)
    expected = ftforce.remap(*problem, LOCKED)
    np.testing.assert_allclose(torque, expected.U, atol=1e-9)
    np.testing.assert_allclose(jump, expected.jump, atol=1e-9)


@pytest.mark.benchmark(group="analyze, robot loaded, goal 80 us")
def test_analyze(benchmark, arm):
    q = arm.postures["default"]
    result = benchmark(ftforce.analyze, arm, q, locked=[2, 4], force=FORCE)
    assert result.is_proved()


@pytest.mark.benchmark(group="analyze, robot loaded, goal 80 us")
def test_analyze_by_hand(benchmark, arm):
    q = arm.postures["default"]

    def analyze_by_hand():
        J = pin.computeFrameJacobian(arm.model, arm.data, q, arm.tip_frame, pin.LOCAL)[:3]
        return by_hand(J, J.T @ FORCE, LOCKED)

    torque, *_ = benchmark(analyze_by_hand)
    expected = ftforce.analyze(arm, q, locked=[2, 4], force=FORCE)
    np.testing.assert_allclose(torque, expected.torque.after, atol=1e-9)


@pytest.mark.benchmark(group="load a known robot, goal 50 ms each")
@pytest.mark.parametrize("name", known_robots())
def test_load(benchmark, name):
    robot = benchmark.pedantic(ftforce.load_robot, args=(name,), rounds=rounds(5), warmup_rounds=1)
    assert robot.n > 0
