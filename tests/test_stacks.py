"""Cells answered thousands at a time, beside the modules that answer them one by one."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftforce.core.arrays import read_only
from ftforce.core.bounded_remap import remap_inside
from ftforce.core.feasible_forces import LockModel, feasible_forces, reach, weakest_direction
from ftforce.core.measures import margin, relative_manipulability
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, FreeJoints, reduce
from ftforce.core.remap import force_jump, supported_force
from ftforce.core.stacked_free import fill_free
from ftforce.core.stacked_limits import within_limits
from ftforce.core.stacked_ranks import settle_cells
from ftforce.core.stacks import cells_of, reach_of
from ftforce.core.verdict import CODES, Verdict, judge, verdict
from ftforce.robot.dynamics import rnea_torques
from ftforce.robot.kinematics import frame_jacobians
from ftforce.trajectory import Recording
from ftforce.trajectory import timeline as module
from ftforce.trajectory.timeline import timeline
from helpers import assert_close, campaign, seeds, with_singular_values

RATIOS = (1.0, 0.5, 0.1, 1.01e-2, 0.99e-2, 1e-3, 2e-6, 0.9e-6, 1e-7, 1e-12, 0.0)


@given(seeds, st.integers(1, 6), st.integers(1, 8), st.booleans(), st.booleans())
@settings(deadline=None, max_examples=campaign(300, 60))
def test_cells_are_those_of_one_posture(seed, m, n, forced, directed):
    rng = np.random.default_rng(seed)
    J = []
    for _ in range(12):
        s = np.sort(rng.choice(RATIOS[:4], 6))[::-1] * (1.0 if rng.random() < 0.8 else 1e-3)
        one = with_singular_values(rng, m, n, s)
        u = np.linalg.qr(rng.normal(size=(m, m)))[0][0]  # a direction that hangs on joint 1
        one += np.outer(u, (rng.choice(RATIOS) - 1.0) * (u @ one))
        one[:, 0] += u
        J.append(one)
    J, locked = np.array(J), rng.random((5, n)) < 0.3
    locked[0] = np.arange(n) == 0
    F = rng.normal(size=m) * 50.0 if forced else None
    d = rng.normal(size=m) if directed else None
    rnea = rng.normal(size=(12, 5, n)) * 10.0
    largest = np.where(rng.random((5, n)) < 0.3, np.nan, rng.uniform(2.0, 90.0, (5, n)))
    cells = cells_of(J, locked, F, d, rtol=RTOL, wary=BORDERLINE_RTOL)
    found = reach_of(J, rnea, largest, direction=d, cells=cells, rtol=RTOL)
    for i, j in np.argwhere(cells.certain):
        reduced = reduce(read_only(J[i].copy()), locked[j], RTOL)
        assert cells.verdict[i, j] == CODES[verdict(reduced, F, BORDERLINE_RTOL)]
        assert_close(cells.margin[i, j], margin(reduced), scale=1.0, tol=1e-12)
        if F is not None:
            jump = force_jump(reduced, F).jump
            assert_close(cells.jump[i, j], jump, scale=np.linalg.norm(F), tol=1e-8)
        space = reduced.healthy.U[:, : reduced.rank]
        for model, values in zip(LockModel, found, strict=True):
            feasible = feasible_forces(reduced, rnea[i, j], largest[j], model)
            ray = reach(feasible, d) if directed else weakest_direction(feasible, space).reach
            wanted = math.nan if ray.is_empty else ray.maximum
            np.testing.assert_allclose(values[i, j], wanted, rtol=1e-8, atol=1e-9)


@given(seeds, st.integers(1, 6), st.integers(1, 8), st.booleans())
@settings(deadline=None, max_examples=campaign(300, 60))
def test_cells_that_a_tolerance_decides_are_those_of_one_posture(seed, m, n, forced):
    rng = np.random.default_rng(seed)
    J = []
    for _ in range(8):  # of any rank, with singular values on both sides of every tolerance
        one = with_singular_values(rng, m, n, np.sort(rng.choice(RATIOS, 6))[::-1])
        u = np.linalg.qr(rng.normal(size=(m, m)))[0][0]  # a direction that hangs on joint 1
        one += np.outer(u, (rng.choice(RATIOS) - 1.0) * (u @ one))
        one[:, 0] += u * rng.choice(RATIOS)
        J.append(one)
    J, locked = np.array(J), rng.random((5, n)) < 0.3
    locked[0] = np.arange(n) == 0
    F = None
    if forced:  # along some directions of one posture, and hardly along others
        F = np.linalg.svd(J[0] * ~locked[0])[0] @ rng.choice([1.0, 0.1, 3e-3, 1e-5, 1e-8], m)
    d = rng.normal(size=m)
    asked = (J, locked, F, d)
    tolerances = {"rtol": RTOL, "wary": BORDERLINE_RTOL}
    cells = cells_of(*asked, **tolerances, asks_weakest=False)
    arm = settle_cells(cells, *asked, **tolerances)
    assert (cells.certain & arm.certain[:, None]).mean() > 0.5
    for i, j in np.argwhere(cells.certain & arm.certain[:, None]):
        reduced = reduce(read_only(J[i].copy()), locked[j], RTOL)
        before = np.zeros(m) if F is None else supported_force(reduced, F)
        assert (arm.rank[i], cells.rank_lost[i, j]) == (
            reduced.rank,
            reduced.rank - reduced.rank_after,
        )
        size = 0.0 if F is None else np.linalg.norm(F)
        assert_close(arm.F[i], before, scale=size, tol=1e-8)
        assert_close(cells.jump[i, j], force_jump(reduced, before).jump, scale=size, tol=1e-8)
        assert_close(cells.margin[i, j], margin(reduced), scale=1.0, tol=1e-12)
        rho = relative_manipulability(reduced)
        np.testing.assert_allclose(cells.rho[i, j], rho, rtol=1e-6, atol=1e-9, equal_nan=True)
        wanted = verdict(reduced, None if F is None else arm.F[i], BORDERLINE_RTOL)
        if forced and not arm.F[i].any():
            wanted = Verdict.NOT_TOLERATED  # nothing to keep
        assert cells.verdict[i, j] == CODES[wanted]
        U = reduced.damaged.U[:, reduced.rank_after :]
        assert_close(
            cells.lost[i, j], np.linalg.norm(d @ U) / np.linalg.norm(d), scale=1.0, tol=1e-8
        )


@given(seeds, st.integers(1, 6), st.sampled_from([0.0, math.nan, 0.5]), st.booleans())
@settings(deadline=None, max_examples=campaign(300, 60))
def test_cells_of_a_free_joint_are_those_of_one_posture(seed, m, friction, forced):
    rng = np.random.default_rng(seed)
    n = m + 2
    J, rnea = (
        rng.normal(size=(12, m, n)),
        rng.normal(size=(12, n)) * rng.choice([0.0, 10.0], 12)[:, None],
    )
    J[:, :, 0] *= rng.choice([1.0, 1.0, 1e-3, 1e-7, 0.0], 12)[:, None]
    rnea[:, 0] *= rng.choice([1.0, 1e-2, 1e-5, 0.0], 12)  # more than friction bears, or less
    free = np.eye(n, dtype=bool)[:3]
    d = rng.normal(size=m)
    F = None
    if forced and m == 1:
        F = 50.0 * d
    elif forced:  # towards a posture's joint, almost, or at a right angle to it
        u = J[0, :, 1] / np.linalg.norm(J[0, :, 1])
        F = 50.0 * (d - u * (u @ d) * (1.0 - rng.choice([1.0, 3e-3, 1e-5, 1e-8, 0.0])))
    given_friction = np.full(n, friction)
    largest = np.where(
        free, 0.0, np.where(rng.random((3, n)) < 0.3, np.nan, rng.uniform(2.0, 90.0))
    )
    asked, tolerances = (J, free, F, d), {"rtol": RTOL, "wary": BORDERLINE_RTOL}
    cells = cells_of(*asked, **tolerances, asks_weakest=False)
    arm = settle_cells(cells, *asked, **tolerances)
    borne = fill_free(
        cells,
        arm,
        J,
        rnea,
        free,
        friction=given_friction,
        has_force=forced,
        direction=d,
        **tolerances,
    )
    commanded, _ = reach_of(
        J, rnea[:, None], largest, direction=d, cells=cells, rtol=RTOL, within=borne
    )
    certain = cells.certain & arm.certain[:, None]
    for i, j in np.argwhere(certain):
        joints = FreeJoints.of(free[j], given_friction, BORDERLINE_RTOL)
        reduced = reduce(read_only(J[i].copy()), np.zeros(n, dtype=bool), RTOL, joints)
        bounded = remap_inside(reduced, np.zeros(m) if F is None else F, rnea[i], None)
        assert cells.verdict[i, j] == CODES[judge(reduced, F, BORDERLINE_RTOL, bounded)]
        assert cells.rank_lost[i, j] == reduced.rank - reduced.rank_after
        assert_close(cells.margin[i, j], margin(reduced), scale=1.0, tol=1e-9)
        assert_close(cells.rho[i, j], relative_manipulability(reduced), scale=1.0, tol=1e-9)
        if forced and bounded.jump is not None:
            assert_close(cells.jump[i, j], bounded.jump, scale=np.linalg.norm(F) + 1.0, tol=1e-9)
        elif forced:
            assert np.isnan(cells.jump[i, j]).all()
        ray = reach(feasible_forces(reduced, rnea[i], largest[j]), d)
        most = math.nan if ray.is_empty else ray.maximum
        np.testing.assert_allclose(commanded[i, j], most, rtol=1e-8, atol=1e-9)
    assert certain[:, 1:].mean() > 0.5


@given(seeds, st.integers(1, 6), st.integers(1, 8), st.sampled_from(["force", "zero", "all"]))
@settings(deadline=None, max_examples=campaign(300, 60))
def test_cells_within_limits_are_those_of_one_posture(seed, m, n, asked):
    rng = np.random.default_rng(seed)
    J = [
        with_singular_values(rng, m, n, np.sort(rng.choice(RATIOS[:4], 6))[::-1]) for _ in range(9)
    ]
    J, locked = np.array(J), rng.random((6, n)) < 0.2
    J[:, :, 0] *= rng.choice([1.0, 1e-8], 9)[:, None]  # sometimes without a lever
    u = np.linalg.qr(rng.normal(size=(m, m)))[0][0]  # a direction that only joint 1 moves in
    J[::2] -= u[:, None] * (u @ J[::2])[:, None]
    J[::2, :, 0] += u
    locked[0] = np.arange(n) == 0
    F = None if asked == "all" else rng.normal(size=m) * (50.0 if asked == "force" else 0.0)
    rnea = rng.normal(size=(9, 6, n)) * 10.0
    largest = np.where(rng.random((6, n)) < 0.3, np.nan, rng.uniform(1.0, 60.0, (6, n)))
    d = rng.normal(size=m)
    rnea[:, :3] *= 4.0  # often more than the limits, so that nothing can be held
    cells = cells_of(J, locked, F, d, rtol=RTOL, wary=BORDERLINE_RTOL)
    found = within_limits(
        cells, J, rnea, largest, locked=locked, F=F, rtol=RTOL, wary=BORDERLINE_RTOL
    )
    assert not (found.certain & ~cells.certain).any()
    for i, j in np.argwhere(found.certain):
        reduced = reduce(read_only(J[i].copy()), locked[j], RTOL)
        bounded = remap_inside(reduced, np.zeros(m) if F is None else F, rnea[i, j], largest[j])
        wanted = judge(reduced, F, BORDERLINE_RTOL, bounded, largest[j])
        assert found.verdict[i, j] == CODES[wanted]
        if bounded.jump is None:
            assert np.isnan(found.jump[i, j]).all()
        else:
            size = max(np.linalg.norm(bounded.nearest.F), np.linalg.norm(bounded.F_after), 1.0)
            assert_close(found.jump[i, j], bounded.jump, scale=size, tol=1e-9)


@pytest.mark.parametrize("factor", [0.2, 0.5, 1.0])
def test_few_cells_with_limits_need_a_solver(panda, factor):
    rng = np.random.default_rng(0)
    q = panda.postures["default"] + rng.uniform(-0.3, 0.3, (50, 7))
    J = frame_jacobians(panda, q)[:, :3]
    still = np.zeros((50, 7))
    rnea = rnea_torques(panda, q, still, still)[:, None]
    tolerances = {"rtol": RTOL, "wary": BORDERLINE_RTOL}
    locked, F = np.eye(7, dtype=bool), np.array([60.0, -40.0, 90.0])
    cells = cells_of(J, locked, F, None, **tolerances)
    largest = np.where(locked, np.nan, factor * panda.effort)
    found = within_limits(cells, J, rnea, largest, locked=locked, F=F, **tolerances)
    assert (found.verdict == CODES[Verdict.NOT_TOLERATED]).any()
    assert found.certain.sum() > 0.99 * cells.certain.sum()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_limits_that_exclude_each_other_need_no_solver(sign):
    # 10 F' + 5 ≤ 1 and -10 F' + 5 ≤ 1; a third limit, in the way of the force, does not matter.
    J = np.broadcast_to([[10.0, -10.0, 1.0]], (4, 1, 3))
    rnea, locked = sign * np.array([[[5.0, 5.0, 0.0]]]), np.zeros((1, 3), dtype=bool)
    tolerances = {"rtol": RTOL, "wary": BORDERLINE_RTOL}
    for F in (np.array([20.0]), np.array([-20.0]), np.zeros(1)):
        cells = cells_of(J, locked, F, np.ones(1), **tolerances)
        largest = np.array([[1.0, 1.0, 7.0]])
        found = within_limits(cells, J, rnea, largest, locked=locked, F=F, **tolerances)
        assert found.certain.all()
        assert np.isnan(found.jump).all()
        assert (found.verdict == CODES[Verdict.NOT_TOLERATED]).all()


def test_certain_are_most_cells_of_a_usual_motion(panda):
    rng = np.random.default_rng(0)
    q = panda.postures["default"] + rng.uniform(-0.3, 0.3, (50, 7))
    J = frame_jacobians(panda, q)[:, :3]
    cells = cells_of(J, np.eye(7, dtype=bool), None, None, rtol=RTOL, wary=BORDERLINE_RTOL)
    assert cells.certain.mean() > 0.95


def test_a_finer_tolerance_than_lapack_decides_is_left_to_others(panda):
    J = np.random.default_rng(0).normal(size=(4, 3, 7))
    for rtol, sure in ((1e-8, True), (1e-12, False)):
        cells = cells_of(J, np.eye(7, dtype=bool), None, None, rtol=rtol, wary=1e-2)
        assert cells.certain.any() == sure


OPTIONS = {
    "force": {"force": (10.0, 0.0, 20.0)},
    "pairs": {"force": (10.0, 0.0, 20.0), "faults": 2},
    "direction": {"direction": (0, 0, 1)},
    "weakest": {},
    "payload": {"payload": (2.0, (0.0, 0.1, 0.0)), "gravity": (1.0, 2.0, -9.0)},
    "wrench": {"task": "wrench", "length": 0.3, "force": (8, 5, 1, 1, 2, 3), "faults": 2},
    "moment": {"task": "moment", "length": 0.2},
    "static": {"static": True, "axes": "world", "force": (1, 0, 0)},
    "no limits": {"limits": "none", "force": (1, 0, 0)},
    "zero": {"force": (0, 0, 0)},
    "limits": {"limits": "urdf", "force": (60.0, -40.0, 90.0), "faults": 2},
    "limits without a force": {"limits": "urdf", "payload": (9.0, (0.0, 0.1, 0.0))},
    "limits, wrench": {
        "limits": "urdf",
        "task": "wrench",
        "force": (60, 30, 90, 4, 2, 1),
        "faults": 2,
    },
}


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_a_timeline_is_the_same_either_way(monkeypatch, panda, options):
    t = np.linspace(0.0, 6.0, 61)
    q = panda.postures["default"] + 0.3 * np.sin(np.outer(t, np.linspace(0.5, 2.0, 7)))
    q[:, 3] += np.linspace(0.0, 2.3, 61)  # up to full stretch
    recording = Recording.of(panda, t, q)
    found = timeline(panda, recording, rate=5, **options)
    monkeypatch.setattr(module, "certain_cells", lambda *_: None)
    wanted = timeline(panda, recording, rate=5, **options)
    np.testing.assert_array_equal(found.verdict, wanted.verdict)
    assert_close(found.margin, wanted.margin, tol=1e-10)
    for name in ("jump", "capability", "held"):
        one, other = getattr(found, name), getattr(wanted, name)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-7)
    assert found.warnings == wanted.warnings
