"""Plans, best postures and the failure-tolerant workspace, beside what a user would write."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

import ftforce
from effort import QUICK, rounds
from ftforce.trajectory import Path

WAYPOINTS = 12 if QUICK else 100
ENDS = [(0.5, -0.2, 0.4), (0.5, 0.2, 0.4)]


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


@pytest.mark.parametrize("keeps", [False, True], ids=["point", "pose"])
def test_plan_of_100_waypoints_and_7_sets(benchmark, panda, keeps):
    line = Path.through(ENDS, speed=0.1, keep_orientation=keeps)
    asked = {"waypoints": WAYPOINTS}
    found = benchmark.pedantic(ftforce.plan, (panda, line), asked, rounds=rounds(5))
    assert QUICK or found.after.value.min() > 0.32


def by_slsqp(arm, line, waypoints):
    """Return the worst margin on a path whose postures SLSQP improves one after the other."""
    data, frame = arm.model.createData(), arm.tip_frame

    def missing(q, place):
        pin.framesForwardKinematics(arm.model, data, q)
        return data.oMf[frame].translation - place

    def margin(q):
        J = pin.computeFrameJacobian(arm.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        largest = np.linalg.norm(J, 2)
        return min(
            np.linalg.svd(np.delete(J, i, axis=1), compute_uv=False)[-1] / largest for i in range(7)
        )

    q, found = ftforce.plan(arm, line, waypoints=2).before.q[0], []
    bounds = list(zip(arm.lower, arm.upper, strict=True))
    for t in np.linspace(0.0, line.duration, waypoints):
        there = {"type": "eq", "fun": missing, "args": (line.at(t)[0],)}
        q = minimize(
            lambda x: -margin(x), q, method="SLSQP", bounds=bounds, constraints=there,
            options={"maxiter": 60},
        ).x  # fmt: skip
        found.append(margin(q))
    return min(found)


def test_plan_by_slsqp(benchmark, panda):
    line = Path.through(ENDS, speed=0.1)
    worst = benchmark.pedantic(by_slsqp, (panda, line, WAYPOINTS), rounds=rounds(2))
    benchmark.extra_info["worst margin"] = worst


def test_best_posture(benchmark, panda):
    asked = {"like": "default"}
    found = benchmark.pedantic(ftforce.best_posture, (panda,), asked, rounds=rounds(5))
    assert found.measured_after.min() > 0.41


def test_reach(benchmark, panda):
    within = {4: (-1.8, -1.2), 6: (1.1, 2.5)}
    asked = {"within": within, "release": True, "cell": 0.4 if QUICK else None}
    found = benchmark.pedantic(ftforce.reach, (panda,), asked, rounds=rounds(3))
    assert found.estimate > 0.0
