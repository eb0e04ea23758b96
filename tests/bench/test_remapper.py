"""`ftforce.Remapper` beside what a user would write by hand for a control loop."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce.batch.remapper import Remapper

pytest.importorskip("numba")

SETS = {"1 set": [[4]], "7 sets": 1, "28 sets": 2}
GROUP = "remapper: one posture, Panda, force task, "


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("panda")


@pytest.fixture(scope="module")
def state(arm):
    return arm.postures["default"].copy(), np.linspace(9.0, -5.0, 7)


def by_hand(arm, healthy, q, tau, rtol=1e-6):
    """The dozen lines that people write: a pseudoinverse per set; the tolerance is right."""
    J = pin.computeFrameJacobian(arm.model, arm.data, q, arm.tip_frame, pin.LOCAL)[:3]
    F = np.linalg.pinv(J.T, rcond=rtol) @ tau
    answers = []
    for mask in healthy:
        K = J[:, mask]
        F_after = K @ (np.linalg.pinv(K, rcond=rtol) @ F)
        U = np.zeros(len(tau))
        U[mask] = K.T @ F
        answers.append((U, F_after, F - F_after))
    return answers


def masks(remapper):
    return [~one.mask(remapper.robot.n) for one in remapper.sets]


@pytest.mark.parametrize("count", SETS)
def test_remapper(benchmark, arm, state, count):
    benchmark.group = f"{GROUP}{count}, goal 5 us for 7 sets"
    remapper = Remapper(arm, SETS[count])
    result = benchmark(remapper, *state)
    expected = ftforce.analyze(arm, state[0], locked=[4], torque=state[1])
    at = remapper.sets.index(expected.faults)
    np.testing.assert_allclose(result.U[at], expected.torque.after, atol=1e-9)


@pytest.mark.parametrize("count", SETS)
def test_by_hand(benchmark, arm, state, count):
    benchmark.group = f"{GROUP}{count}, goal 5 us for 7 sets"
    remapper = Remapper(arm, SETS[count])
    answers = benchmark(by_hand, arm, masks(remapper), *state)
    result = remapper(*state)
    for s, (U, F_after, jump) in enumerate(answers):
        np.testing.assert_allclose(U, result.U[s], atol=1e-9)
        np.testing.assert_allclose(F_after, result.force_after[s], atol=1e-9)
        np.testing.assert_allclose(jump, result.jump[s], atol=1e-9)


@pytest.mark.benchmark(group="remapper: where directions are lost, Panda, wrench, 7 sets")
def test_wrench(benchmark, arm, state):
    remapper = Remapper(arm, 1, task="wrench")
    result = benchmark(remapper, *state)
    assert result.rank_lost.any()


@pytest.mark.benchmark(group="remapper: free joints, Panda, force task, 7 sets")
def test_free(benchmark, arm, state):
    remapper = Remapper(arm, 1, mode="free")
    result = benchmark(remapper, *state)
    assert result.verdict.any()
