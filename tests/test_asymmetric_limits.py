"""Torque limits that differ by direction, and torque-speed lines, in every path of computation."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import quadprog
from scipy.optimize import linprog

import ftforce
from ftforce.analysis.limits_files import choose_limits
from ftforce.batch import numpy_path
from ftforce.batch.plan import Plan, faults_of, mechanism_of, question_of
from ftforce.batch.remapper import Remapper
from ftforce.core.bounded_remap import bounded_remap
from ftforce.core.faults import Fault, FaultMode, FaultSet, fault_sets
from ftforce.core.feasible_forces import LockModel, feasible_forces, reach
from ftforce.core.limits import Limits, TorqueSpeedLine, both_sides
from ftforce.core.reduced_jacobian import reduce
from ftforce.core.task import Task
from ftforce.errors import DimensionError, InputError
from ftforce.robot.kinematics import frame_jacobian
from ftforce.show.render import render, to_text
from ftforce.trajectory import Recording
from ftforce.trajectory import timeline as module
from helpers import assert_close, campaign

WEAK = FaultMode.WEAK


def drawn(rng, n):
    """Return limits whose sides differ, some of them unknown."""
    lower, upper = -(10.0 ** rng.uniform(0.0, 1.5, n)), 10.0 ** rng.uniform(0.0, 1.5, n)
    lower[unknown := rng.random(n) < 0.15] = np.nan
    upper[unknown] = np.nan
    return Limits.of(upper, 10.0 ** rng.uniform(0.0, 1.5, n), lower=lower)


def inequalities(J, rnea, largest):
    """Return A and b of ``A F ≤ b`` for the known limits."""
    lower, upper = both_sides(largest)
    known = ~np.isnan(upper)
    rows = J.T[known]
    return np.vstack([rows, -rows]), np.concatenate([(upper - rnea)[known], (rnea - lower)[known]])


def test_capability_beside_a_linear_program():
    rng, seen = np.random.default_rng(1), set()
    for _ in range(campaign(600)):
        m, n = int(rng.integers(1, 5)), 6
        J, rnea, limits = rng.normal(size=(m, n)), 2.0 * rng.normal(size=n), drawn(rng, n)
        faults = FaultSet((Fault(0, FaultMode.LOCKED), Fault(1, WEAK, 0.4)))
        largest = limits.largest_torques(faults)
        found = feasible_forces(reduce(J, faults.mask(n), 1e-6), rnea, largest, LockModel.HELD)
        d = rng.normal(size=m)
        ray = reach(found, d)
        A, b = inequalities(J, rnea, largest)
        best = linprog([-1.0], A_ub=(A @ d)[:, None], b_ub=b, bounds=(0.0, None), method="highs")
        seen.add(best.status)
        if best.status == 2:
            assert ray.is_empty
        elif best.status == 0:
            assert_close(ray.maximum, best.x[0])
        else:
            assert np.isinf(ray.maximum)
    assert {0, 2} <= seen


def test_remap_beside_another_solver_and_the_kernel():
    rng, bound = np.random.default_rng(2), 0
    for _ in range(campaign(300)):
        m, n = 3, 6
        J, rnea, limits = rng.normal(size=(m, n)), rng.normal(size=n), drawn(rng, n)
        faults = FaultSet((Fault(2, FaultMode.LOCKED), Fault(4, WEAK, 0.5)))
        if not limits.is_known[4]:
            continue
        tau, largest = J.T @ (20.0 * rng.normal(size=m)), limits.largest_torques(faults)
        found = bounded_remap(J, tau, faults.mask(n), limits=largest, rnea=rnea)
        A, b = inequalities(J, rnea, largest)
        F = found.nearest.F
        remapped = Remapper(m=m, n=n, faults=[faults], limits=limits)(J, tau, rnea=rnea)
        try:
            expected = quadprog.solve_qp(np.eye(m), F, -A.T, -b)[0]
        except ValueError:
            assert found.F_after is None
            assert np.isnan(remapped.force_after[0]).all()
            continue
        bound += bool(found.binding)
        assert_close(found.F_after, expected, scale=np.linalg.norm(F))
        assert_close(remapped.force_after[0], expected, scale=np.linalg.norm(F))
    assert bound > campaign(300) // 4


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.usefixtures("kernels")
def test_sweeps_beside_single_postures(mode):
    robot, task = ftforce.load_robot("dh5"), Task.parse("force", "tool", None)
    rng = np.random.default_rng(3)
    limits = Limits.of(
        rng.uniform(40, 90, 5), rng.uniform(20, 60, 5), lower=rng.uniform(-90, -40, 5)
    )
    d, q = np.array([0.36, -0.48, 0.8]), rng.uniform(-1.5, 1.5, (25, 5))
    sets = tuple(fault_sets(robot.n, 1, FaultMode.parse(mode)))
    question = question_of(
        task, robot.n, force=None, direction=d, limits=limits, friction=np.zeros(5), rtol=1e-6,
        wary=1e-2, needs_gravity=True,
    )  # fmt: skip
    plan = Plan(mechanism_of(robot), faults_of(sets, robot.n), question, robot.n, False)
    blocks = plan.evaluator()(q), numpy_path.NumpyEvaluator(plan)(q)
    for i, one in enumerate(q):
        for s, faults in enumerate(sets):
            asked = {mode: [k + 1 for k in faults.joints]}
            single = ftforce.capability(robot, one, **asked, direction=d, limits=limits, friction=0)
            single = single.directions[-1].after[LockModel.COMMANDED].maximum
            for block in blocks:
                np.testing.assert_allclose(block.capability[s, i], single, rtol=1e-7, atol=1e-6)


LINE = TorqueSpeedLine.of([70.0, 70.0, 60.0, np.nan, 9.0], [0.2, 0.3, 0.15, np.nan, 0.1])


def test_all_instants_at_once_beside_one_by_one(monkeypatch):
    robot = ftforce.load_robot("dh5")
    q = np.linspace([0.2, 1.0, 0.4, 1.0, 0.1], [0.6, 0.7, 0.6, 0.8, 0.3], 9)
    recording = Recording.of(robot, np.linspace(0.0, 4.0, 9), q)
    for limits in (
        Limits.of([90.0, 60.0, 30.0, 15.0, 8.0], lower=[-30.0, -20.0, -80.0, -12.0, -5.0]),
        Limits.of([30.0, 20.0, 80.0, 12.0, 5.0], lower=[-90.0, -60.0, -20.0, -15.0, -8.0]),
        Limits.of([90.0, 60.0, 50.0, 15.0, 8.0], lower=[-80.0] * 5, line=LINE),
    ):
        asked = {"force": [60.0, 20.0, 10.0], "limits": limits, "rate": 10}
        found = ftforce.timeline(robot, recording, faults=1, **asked)
        with monkeypatch.context() as patch:
            patch.setattr(module, "certain_cells", lambda *_: None)
            single = ftforce.timeline(robot, recording, faults=1, **asked)
        np.testing.assert_array_equal(found.verdict, single.verdict)
        for name in ("jump", "capability", "held"):
            one, other = getattr(found, name), getattr(single, name)
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8, equal_nan=True)
        assert np.isfinite(found.capability).any()


# ---- torque-speed lines --------------------------------------------------------------------------


def test_torque_speed_line():
    line = TorqueSpeedLine.of([100.0, 100.0, np.nan], [4.0, 4.0, np.nan])
    limits = Limits.of([60.0, np.nan, 7.0], lower=[-90.0, np.nan, -7.0], line=line)
    for speed, upper, lower in (
        (0.0, 60.0, -90.0),  # at rest the stall torque exceeds both limits
        (2.0, 50.0, -90.0),  # half the speed, half the torque; the motor still brakes fully
        (-2.0, 60.0, -50.0),
        (5.0, 0.0, -90.0),  # beyond the no-load speed
    ):
        below, above = limits.motor_bounds(np.full(3, speed))
        assert_close(above, [upper, 100.0 * min(1.0, max(0.0, 1.0 - speed / 4.0)), 7.0], scale=1.0)
        assert_close(below[[0, 2]], [lower, -7.0], scale=1.0)
    assert limits.is_known.all()


@pytest.mark.parametrize("mode", ["locked", "free"])  # all at once, and one by one
def test_lines_count_at_every_instant_of_a_timeline(mode):
    robot, d = ftforce.load_robot("dh5"), np.array([0.36, -0.48, 0.8])
    v = np.array([0.1, -0.07, 0.05, -0.02, 0.05])  # constant: accelerations are zero
    t = np.linspace(0.0, 2.0, 5)
    q = np.array([0.2, 1.0, 0.4, 1.0, 0.1]) + t[:, None] * v
    limits = Limits.of(np.full(5, 90.0), line=LINE)
    found = ftforce.timeline(
        robot, Recording.of(robot, t, q), faults=1, mode=mode, direction=d, limits=limits,
        smooth="none",
    )  # fmt: skip
    share = 1.0 - np.abs(v) / LINE.no_load_speed
    stall = LINE.stall_torque
    upper = np.fmin(90.0, np.where(v > 0.0, share, 1.0) * stall)
    lower = -np.fmin(90.0, np.where(v < 0.0, share, 1.0) * stall)
    for i, one in enumerate(q):
        J = frame_jacobian(robot, one, "tool")[:3]
        rnea = pin.rnea(robot.model, robot.model.createData(), one, v, np.zeros(5))
        lever = J.T @ d
        ends = np.where(lever > 0.0, upper - rnea, lower - rnea) / lever
        assert found.healthy.capability[i] == pytest.approx(ends.min(), rel=1e-6)
        if mode == "locked":
            k = found.sets.index(FaultSet((Fault(4, FaultMode.LOCKED),)))
            rnea = pin.rnea(robot.model, robot.model.createData(), one, v * STOP, np.zeros(5))
            ends = (np.where(lever > 0.0, upper - rnea, lower - rnea) / lever)[:4]
            assert found.held[i, k] == pytest.approx(ends.min(), rel=1e-6)


STOP = np.array([1.0, 1.0, 1.0, 1.0, 0.0])


def test_lines_count_with_the_velocity():
    robot = ftforce.load_robot("dh5")
    line = TorqueSpeedLine.of(np.full(5, 40.0), np.full(5, 2.0))
    asked = {"force": [80, 50, 10], "limits": Limits.of(np.full(5, 100.0), line=line)}
    at_rest = ftforce.analyze(robot, **asked)
    assert at_rest.bounded.binding == ()
    # Joint 3 needs 31.6 N·m: too much at half the no-load speed if the motor drives, not if it
    # brakes.
    braking = ftforce.analyze(robot, velocity=[0, 0, -1, 0, 0], **asked)
    assert braking.bounded.binding == ()
    driving = ftforce.analyze(robot, velocity=[0, 0, 1, 0, 0], **asked)
    assert driving.bounded.binding == (2,)
    assert_close(driving.torque.total_after[2], 20.0)


@pytest.mark.parametrize(
    ("effort", "given", "error"),
    [
        ([1.0, 2.0], {"lower": [-1.0, 2.0]}, InputError),
        ([1.0, np.nan], {"lower": [-1.0, -2.0]}, InputError),
        ([1.0, 2.0], {"lower": [-1.0]}, DimensionError),
        ([1.0], {"line": TorqueSpeedLine.of([1.0, 1.0], [1.0, 1.0])}, DimensionError),
    ],
)
def test_what_is_rejected(effort, given, error):
    with pytest.raises(error):
        Limits.of(effort, **given)
    with pytest.raises(InputError, match="both"):
        TorqueSpeedLine.of([1.0], [np.nan])
    with pytest.raises(DimensionError):
        bounded_remap(np.eye(2), [1, 1], [False, False], limits=np.ones((3, 2)))


def test_equal_sides_are_the_symmetric_limits():
    assert Limits.of([1.0, np.nan], lower=[-1.0, np.nan]).lower is None
    robot = ftforce.load_robot("dh5")
    assert choose_limits(robot, "urdf").lower is None


def test_a_remapper_has_no_velocities():
    robot, line = ftforce.load_robot("dh5"), TorqueSpeedLine.of(np.ones(5), np.ones(5))
    limits = Limits.of(np.ones(5), line=line)
    for ask in (lambda: Remapper(robot, [[1]], limits=limits), lambda: Remapper(
        m=3, n=5, faults=[[1]], limits=limits
    )):  # fmt: skip
        with pytest.raises(InputError, match="has no velocities for torque-speed lines"):
            ask()


def test_a_history_keeps_both_limits(tmp_path):
    robot = ftforce.load_robot("dh5")
    q = np.linspace([0.2, 1.0, 0.4, 1.0, 0.1], [0.3, 0.9, 0.5, 0.9, 0.2], 9)
    recording = Recording.of(robot, np.linspace(0.0, 2.0, 9), q)
    lower = [-30.0, np.nan, -80.0, -12.0, -5.0]
    upper = np.array([90.0, np.nan, 30.0, 15.0, 8.0])
    line = TorqueSpeedLine.of(np.full(5, 40.0), np.full(5, 0.2))
    limits = Limits.of(upper, lower=lower, line=line)
    asked = {"force": [20.0, 20.0, 10.0], "faults": "2@1"}
    run = ftforce.simulate(robot, recording, limits=limits, **asked)
    ftforce.save(run, tmp_path / "run.npz")
    kept = ftforce.load_history(tmp_path / "run.npz")
    assert kept.setting.effort_lower == (-30.0, -40.0, -40.0, -12.0, -5.0)
    assert kept.setting.effort == (40.0, 40.0, 30.0, 15.0, 8.0)
    assert "-30 … 40" in to_text(render(kept))
    for i in (1, 3, 5, 8):  # each instant has the limits of its velocity
        below, above = limits.motor_bounds(run.answer.v[i])
        motor, used = run.answer.motor[i], run.answer.used[i]
        moving = [0, 2, 3, 4] if run.t[i] >= 1.0 else [0, 1, 2, 3, 4]
        expected = np.where(motor < 0.0, motor / below, motor / above)
        assert_close(used[moving], expected[moving], scale=1.0)
