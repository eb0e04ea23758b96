"""Limits, capability and polytope beside scipy and pycapacity."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

import ftforce
from ftforce.analysis.capability import capability
from ftforce.core.bounded_remap import bounded_remap, remap_inside
from ftforce.core.faults import FaultSet
from ftforce.core.feasible_forces import feasible_forces, reach
from ftforce.core.polytope import force_polytope
from ftforce.core.reduced_jacobian import reduce
from ftforce.robot.dynamics import weight_torque
from ftforce.robot.kinematics import frame_jacobian

with warnings.catch_warnings():  # it imports numpy.matlib, which is deprecated
    warnings.simplefilter("ignore")
    from pycapacity.robot import force_polytope as pycapacity_polytope

FAULTS = FaultSet.locked([1])
LOCKED = FAULTS.mask(7)
FORCE = np.array([80.0, 50.0, 10.0])  # beyond what the motors of the wrist can give
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("panda")


@pytest.fixture(scope="module")
def problem(arm):
    q = arm.postures["default"]
    J = np.array(frame_jacobian(arm, q)[:3])
    return J, weight_torque(arm, q), np.where(LOCKED, np.nan, arm.effort)


@pytest.mark.benchmark(group="bounded remap of one set, limits binding, goal 40 us")
def test_bounded_remap_of_checked_input(benchmark, problem):
    J, weight, limits = problem
    result = benchmark(lambda: remap_inside(reduce(J, LOCKED), FORCE, weight, limits))
    assert result.binding


@pytest.mark.benchmark(group="bounded remap of one set, limits binding, goal 40 us")
def test_bounded_remap(benchmark, problem):
    J, weight, limits = problem

    def remap():
        result = bounded_remap(J, J.T @ FORCE, LOCKED, limits=limits, rnea=weight)
        return result, result.U

    result, _ = benchmark(remap)
    assert result.binding
    assert max(result.residuals().values()) < 1e-9


@pytest.mark.benchmark(group="bounded remap of one set, limits binding, goal 40 us")
def test_bounded_remap_with_scipy(benchmark, problem):
    J, weight, limits = problem
    K, g, limit = J[:, ~LOCKED], weight[~LOCKED], limits[~LOCKED]
    within = {
        "type": "ineq",
        "fun": lambda F: np.concatenate([limit - g - K.T @ F, limit + g + K.T @ F]),
        "jac": lambda F: np.vstack([-K.T, K.T]),
    }

    def solve():
        return minimize(
            lambda F: 0.5 * (F - FORCE) @ (F - FORCE), np.zeros(3), jac=lambda F: F - FORCE,
            constraints=[within], method="SLSQP", options={"ftol": 1e-12},
        )  # fmt: skip

    found = benchmark(solve)
    expected = bounded_remap(J, J.T @ FORCE, LOCKED, limits=limits, rnea=weight)
    np.testing.assert_allclose(found.x, expected.F_after, atol=1e-5)


@pytest.mark.benchmark(group="capability in one direction, goal 15 us")
def test_capability(benchmark, problem):
    J, weight, limits = problem
    reduced = reduce(J, LOCKED)
    ray = benchmark(lambda: reach(feasible_forces(reduced, weight, limits), UP))
    assert 0.0 < ray.maximum < np.inf


@pytest.mark.benchmark(group="capability in one direction, goal 15 us")
def test_capability_with_scipy(benchmark, problem):
    J, weight, limits = problem
    lever, g, limit = J[:, ~LOCKED].T @ UP, weight[~LOCKED], limits[~LOCKED]
    A, b = np.concatenate([lever, -lever])[:, None], np.concatenate([limit - g, limit + g])
    found = benchmark(lambda: linprog([-1.0], A_ub=A, b_ub=b, bounds=[(0, None)]))
    expected = reach(feasible_forces(reduce(J, LOCKED), weight, limits), UP)
    np.testing.assert_allclose(found.x[0], expected.maximum, rtol=1e-9)


@pytest.mark.benchmark(group="force polytope, m = 3, n = 7")
def test_polytope(benchmark, problem, arm):
    J, weight, _ = problem
    feasible = feasible_forces(reduce(J, FaultSet().mask(7)), weight, arm.effort)
    polytope = benchmark(force_polytope, feasible)
    assert polytope.dimension == 3


@pytest.mark.benchmark(group="force polytope, m = 3, n = 7")
def test_polytope_with_pycapacity(benchmark, problem, arm):
    J, weight, _ = problem
    found = benchmark(pycapacity_polytope, J, arm.effort, -arm.effort, weight)
    feasible = feasible_forces(reduce(J, FaultSet().mask(7)), weight, arm.effort)
    assert found.vertices.shape[1] == len(force_polytope(feasible).vertices)


@pytest.mark.benchmark(group="census of 28 single and double faults, goal with limits 10 ms")
@pytest.mark.parametrize("limits", ["none", "urdf"])
def test_census(benchmark, arm, limits):
    result = benchmark(ftforce.census, arm, faults=2, force=FORCE, limits=limits)
    assert len(result.sets) == 28


@pytest.mark.benchmark(group="census of 28 single and double faults, goal with limits 10 ms")
def test_census_by_capability(benchmark, arm):
    result = benchmark(ftforce.census, arm, faults=2, force=FORCE, rank_by="capability")
    assert len(result.sets) == 28


@pytest.mark.benchmark(group="analyze with limits, and the whole capability")
def test_analyze_with_limits(benchmark, arm):
    result = benchmark(ftforce.analyze, arm, locked=[2], force=FORCE, limits="urdf")
    assert result.is_proved()


@pytest.mark.benchmark(group="analyze with limits, and the whole capability")
def test_whole_capability(benchmark, arm):
    def all_of_it():
        result = capability(arm, locked=[2])
        return result.directions, result.weakest, result.payload

    assert benchmark(all_of_it)
