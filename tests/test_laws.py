"""The laws of theory §8, on random Jacobians and on random arms close to singular postures."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ftforce
from ftforce.core.feasible_forces import LockModel, feasible_forces, reach
from ftforce.core.measures import relative_manipulability, worst_manipulability_bound
from ftforce.core.reduced_jacobian import RTOL, reduce
from ftforce.core.remap import force_jump, supported_force, velocity_remap
from ftforce.core.verdict import Verdict
from ftforce.robot.kinematics import task_jacobian, tip_pose
from helpers import (
    KNOWN,
    arms,
    assert_close,
    campaign,
    cases,
    is_beyond_doubt,
    is_clear,
    joint,
    load_text,
    orthogonal,
    seeds,
    srdf_of,
    urdf_of,
    with_singular_values,
)
from problems import Problem, draw_problem, margin_by_highs

pytestmark = [pytest.mark.thorough, pytest.mark.no_cover]

law = settings(deadline=None, max_examples=campaign(100, 50))
law_of_arms = settings(deadline=None, max_examples=campaign(40, 12))


def norm(x):
    return float(np.linalg.norm(x))


def jump_of(J, locked, F):
    """Return F̂ and ΔF for a force."""
    reduced = reduce(J, locked)
    change = force_jump(reduced, supported_force(reduced, F))
    return change.F, change.jump


# ---- force -----------------------------------------------------------------------------------


@given(cases())
@law
def test_the_jump_is_square_to_what_is_left(case):
    result = ftforce.remap(case.J, case.tau, case.locked)
    size = norm(result.F)
    assert_close(result.jump @ result.F_after, 0.0, scale=size**2 or 1.0)
    assert_close(result.F_after + result.jump, result.F, scale=size or 1.0)
    assert_close(result.jump_norm, norm(result.jump), scale=size or 1.0)
    reduced = result.reduced
    felt = norm(reduced.K.T @ result.jump)  # by healthy joints
    assert felt <= (RTOL + 1e-12) * reduced.sigma_max * norm(result.jump) + 1e-300
    assert result.is_proved(), dict(result.residuals())


@given(cases(), st.data())
@law
def test_more_faults_never_make_the_jump_smaller(case, data):
    more = case.locked | data.draw(st.sampled_from([np.zeros(len(case.v), bool), case.v > 0]))
    assume(is_beyond_doubt(case.J, case.locked, more))
    (F, few), (_, many) = (jump_of(case.J, S, case.F) for S in (case.locked, more))
    assert norm(few) <= norm(many) + 1e-7 * norm(F)


@given(cases(), seeds)
@law
def test_turning_the_axes_turns_the_jump(case, seed):
    assume(is_clear(case.J, case.locked))
    R = orthogonal(np.random.default_rng(seed), len(case.F))
    F, jump = jump_of(case.J, case.locked, case.F)
    turned_F, turned = jump_of(R @ case.J, case.locked, R @ case.F)
    assert_close(turned_F, R @ F, scale=norm(case.F), tol=1e-7)
    assert_close(turned, R @ jump, scale=norm(case.F), tol=1e-7)
    assert_close(norm(turned), norm(jump), scale=norm(case.F), tol=1e-7)


@given(cases())
@law
def test_no_fault_no_jump_and_all_faults_all_lost(case):
    none, every = np.zeros(len(case.v), bool), np.ones(len(case.v), bool)
    F, jump = jump_of(case.J, none, case.F)
    assert_close(jump, 0.0, scale=norm(case.F))
    F, jump = jump_of(case.J, every, case.F)
    assert_close(jump, F, scale=norm(case.F))
    result = ftforce.remap(case.J, case.tau, every)
    assert_close(result.jump, result.F, scale=norm(result.F) or 1.0)
    assert_close(result.U, 0.0)


@given(cases())
@law
def test_healthy_torques_stay_when_they_made_the_force(case):
    tau = case.J.T @ case.F
    result = ftforce.remap(case.J, tau, case.locked)
    scale = np.linalg.norm(case.J, 2) * norm(case.F) or 1.0
    np.testing.assert_array_equal(result.U[case.locked], 0.0)
    assert_close(result.U[~case.locked], tau[~case.locked], scale=scale, tol=2 * RTOL)
    assert_close(result.self_motion, 0.0, scale=scale, tol=2 * RTOL)
    split = ftforce.remap(case.J, case.tau, case.locked)
    scale = norm(case.tau)
    assert_close(case.J.T @ split.F + split.self_motion, case.tau, scale=scale)
    size = np.linalg.norm(case.J, 2) * scale or 1.0
    assert_close(case.J @ split.self_motion, 0.0, scale=size, tol=2 * RTOL)


# ---- sums over fault sets --------------------------------------------------------------------


@st.composite
def full_rank_jacobians(draw):
    m = draw(st.integers(1, 6))
    n = draw(st.integers(m, 8))
    ratios = draw(st.lists(st.floats(-3.0, 0.0).map(lambda x: 10.0**x), min_size=m, max_size=m))
    rng = np.random.default_rng(draw(seeds))
    return with_singular_values(rng, m, n, np.array(sorted(ratios, reverse=True)))


def rhos(J, f):
    n = J.shape[1]
    sets = list(combinations(range(n), f))
    masks = [np.isin(np.arange(n), S) for S in sets]
    return sets, np.array([relative_manipulability(reduce(J, mask)) for mask in masks])


@given(full_rank_jacobians(), st.data())
@settings(deadline=None, max_examples=campaign(40, 12))
def test_relative_manipulabilities_of_all_sets_of_a_size(J, data):
    m, n = J.shape
    f = data.draw(st.integers(1, min(n, 3)))
    sets, rho = rhos(J, f)
    possible = math.comb(n - m, f)
    assert_close(np.sum(rho**2), possible, scale=1.0, tol=1e-8)
    bound = worst_manipulability_bound(n, m, f)
    assert rho.min() <= bound + 1e-7
    N = np.eye(n) - np.linalg.pinv(J) @ J
    minors = [np.linalg.det(N[np.ix_(S, S)]) for S in sets]
    assert_close(rho**2, minors, scale=1.0, tol=1e-8)


# ---- velocity --------------------------------------------------------------------------------


@given(cases())
@law
def test_velocity_jump_has_the_projector_of_the_force_jump(case):
    assume(is_clear(case.J, case.locked))
    reduced = reduce(case.J, case.locked)
    change = velocity_remap(reduced, case.v)
    x_S = case.J[:, case.locked] @ case.v[case.locked]
    scale = np.linalg.norm(case.J, 2) * (norm(case.v) + norm(change.after)) or 1.0
    kept = reduced.damaged.project(x_S, reduced.rank_after)
    assert_close(change.jump, kept - x_S, scale=scale)
    assert_close(change.tip_before, case.J @ case.v, scale=scale)
    assert_close(change.tip_after, case.J @ change.after, scale=scale)
    assert_close(change.tip_after - change.tip_before, change.jump, scale=scale)
    np.testing.assert_array_equal(change.after[case.locked], 0.0)


# ---- limits, weight and joints without torque ------------------------------------------------


def asked(problem, F, **changes):
    """Ask for a force; F̂ is what the healthy arm exerts of it."""
    return problem.remap(tau=problem.J.T @ F, **changes)


def size_of(result):
    return max(norm(result.nearest.F), norm(result.F_after)) or 1.0


@st.composite
def limited(draw):
    """Draw a problem with limits and a force."""
    rng = np.random.default_rng(draw(seeds))
    problem = draw_problem(rng)
    F = rng.normal(size=len(problem.J)) * 10.0 ** rng.uniform(-1.0, 2.0)
    assume(abs(margin_by_highs(problem)) > 1e-9)  # rounding decides
    return problem, F


@given(limited(), st.floats(0.0, 1.0))
@law
def test_weaker_limits_never_make_the_jump_smaller(case, factor):
    problem, F = case
    weak = np.where(np.arange(len(problem.tau)) % 2, factor, 1.0) * problem.limits + 1e-6
    weak = np.fmin(weak, problem.limits)
    assume(abs(margin_by_highs(problem._replace(limits=weak))) > 1e-9)
    strong, other = asked(problem, F), asked(problem, F, limits=weak)
    if other.F_after is not None:
        assert strong.F_after is not None
        assert norm(strong.jump) <= norm(other.jump) + 1e-9 * size_of(other)
        assert other.share is None or strong.share >= other.share - 1e-9


@given(limited(), seeds)
@law
def test_more_locks_never_make_a_limited_jump_smaller(case, seed):
    # A lock takes its motor's limit along: the brake's must be the same, or the set can grow.
    problem, F = case
    more = problem.locked | (np.random.default_rng(seed).random(len(problem.tau)) < 0.3)
    more &= ~problem.free
    assume(is_beyond_doubt(problem.J, problem.locked, more, problem.free, more | problem.free))
    assume(abs(margin_by_highs(problem._replace(locked=more))) > 1e-9)
    few, many = asked(problem, F), asked(problem, F, locked=more)
    if many.F_after is not None:
        assert few.F_after is not None
        assert norm(few.jump) <= norm(many.jump) + 1e-7 * size_of(many)


@given(limited(), seeds)
@law
def test_turning_the_axes_turns_a_limited_jump(case, seed):
    problem, F = case
    R = orthogonal(np.random.default_rng(seed), len(F))
    assume(is_clear(problem.J, problem.locked, ~problem.free, problem.locked | problem.free))
    plain, turned = asked(problem, F), asked(problem._replace(J=R @ problem.J), R @ F)
    assert (plain.F_after is None) == (turned.F_after is None)
    if plain.F_after is not None:
        scale = size_of(plain)
        assert_close(turned.jump, R @ plain.jump, scale=scale, tol=1e-6)
        assert_close(turned.F_after, R @ plain.F_after, scale=scale, tol=1e-6)
        assert_close(norm(turned.jump), norm(plain.jump), scale=scale, tol=1e-6)
        assert (plain.share is None) == (turned.share is None)
        if plain.share is not None:
            assert_close(turned.share, plain.share, scale=1.0, tol=1e-6)


@given(limited())
@law
def test_what_is_held_is_never_less_than_what_is_commanded(case):
    problem, F = case
    S = problem.free if problem.free.any() else None
    reduced = reduce(problem.J, problem.locked, free=S)
    largest = np.where(problem.free, 0.0, problem.limits)
    commanded, held = (
        reach(feasible_forces(reduced, problem.rnea, largest, reading), F) for reading in LockModel
    )
    if not commanded.is_empty:
        assert held.maximum >= commanded.maximum * (1.0 - 1e-9)
        assert held.minimum <= commanded.minimum * (1.0 + 1e-9)


# ---- arms ------------------------------------------------------------------------------------


@given(arms(least=3, most=6), seeds, st.data())
@law_of_arms
def test_tool_and_world_axes_tell_the_same_with_limits_and_modes(case, seed, data):
    arm, q = case
    modes = data.draw(st.lists(st.sampled_from("slfw"), min_size=arm.n, max_size=arm.n))
    faults = {
        "locked": [i for i, mode in enumerate(modes, start=1) if mode == "l"],
        "free": [i for i, mode in enumerate(modes, start=1) if mode == "f"],
        "weak": {i: 0.3 for i, mode in enumerate(modes, start=1) if mode == "w"},
        "limits": "urdf",
    }
    F = np.random.default_rng(seed).normal(size=3) * 30.0
    R, _ = tip_pose(arm, q)
    tool = ftforce.analyze(arm, q, force=F, **faults)
    world = ftforce.analyze(arm, q, force=R @ F, axes="world", **faults)
    free = np.isin(np.arange(1, arm.n + 1), faults["free"])
    locked = tool.reduced.locked
    assume(is_beyond_doubt(tool.J, locked, ~free, locked | free))
    none = np.where(free, np.nan, tool.limits.largest_torques(tool.faults))
    problem = Problem(tool.J, np.zeros(arm.n), locked, free, none, tool.rnea.after)
    assume(abs(margin_by_highs(problem)) > 1e-7)
    assert tool.can_stand_still == world.can_stand_still
    assert tool.verdict is world.verdict
    if tool.can_stand_still:
        scale = norm(tool.force.before) + norm(tool.force.after) or 1.0
        assert_close(world.force.jump, R @ tool.force.jump, scale=scale, tol=1e-6)
        assert_close(world.force.jump_norm, tool.force.jump_norm, scale=scale, tol=1e-6)
        assert world.bounded.binding == tool.bounded.binding
        assert tool.is_proved(), dict(tool.residuals())
        known = ~np.isnan(none)
        given_away = 2 * RTOL * tool.reduced.sigma_max * scale
        total = np.abs(tool.torque.total_after)
        assert np.all(total[known] <= none[known] * (1 + 1e-9) + given_away)
        held = np.abs(tool.rnea.after + tool.J.T @ tool.force.after)[free]
        assert np.all(held <= given_away + RTOL * norm(tool.rnea.after))


def some_faults(data, arm):
    return data.draw(st.sets(st.integers(1, arm.n), max_size=arm.n))


@pytest.mark.parametrize("name", KNOWN)
def test_tool_and_world_axes_tell_the_same_of_known_arms(name):
    arm = ftforce.load_robot(name)
    q = ftforce.analyze(arm).posture.q
    R, _ = tip_pose(arm, q)
    F = np.array([30.0, -20.0, 50.0])
    wrench = np.array([30.0, -20.0, 50.0, 4.0, -2.0, 1.0])
    turn = np.kron(np.eye(2), R)
    for k in range(1, arm.n + 1):
        tool = ftforce.analyze(arm, q, locked=k, force=F)
        world = ftforce.analyze(arm, q, locked=k, force=R @ F, axes="world")
        assert_close(world.force.jump, R @ tool.force.jump, scale=norm(F))
        tool = ftforce.analyze(arm, q, locked=k, force=wrench, task="wrench", length=0.4)
        world = ftforce.analyze(
            arm, q, locked=k, force=turn @ wrench, task="wrench", length=0.4, axes="world"
        )
        assert_close(world.force.jump, turn @ tool.force.jump, scale=norm(wrench), tol=1e-7)


@given(arms(), seeds, st.data())
@law_of_arms
def test_laws_of_a_force_at_the_tip(case, seed, data):
    arm, q = case
    locked = some_faults(data, arm)
    task = data.draw(st.sampled_from(["force", "moment", "wrench", "fz", "fx,fy,mz"]))
    m = ftforce.Task.parse(task).m
    F = np.random.default_rng(seed).normal(size=m) * 50.0
    J = task_jacobian(arm, q, ftforce.Task.parse(task, length=0.7))
    assume(np.linalg.norm(J) > 0.0)  # else there is nothing to keep: an error
    result = ftforce.analyze(arm, q, locked=locked, force=F, task=task, length=0.7)
    force, torque = result.force, result.torque
    assert_close(force.before + force.unsupported, F)
    assert_close(force.after + force.jump, force.before, scale=norm(F))
    weighted = result.task.weigh_force(force.jump), result.task.weigh_force(force.after)
    assert_close(weighted[0] @ weighted[1], 0.0, scale=norm(F) ** 2)
    assert_close(torque.before, result.J.T @ force.before, scale=norm(F))
    mask = result.faults.mask(arm.n)
    assert_close(torque.after, np.where(mask, 0.0, torque.before), scale=norm(F))
    assert_close(torque.self_motion, 0.0)
    assert result.is_proved(), dict(result.residuals())
    if not locked:
        assert result.verdict is not Verdict.NOT_TOLERATED
        assert_close(force.jump, 0.0, scale=norm(F), tol=1e-7)
    if len(locked) == arm.n:
        assert_close(force.jump, force.before)


@given(arms(), seeds, st.data())
@law_of_arms
def test_a_wrench_is_that_of_the_directly_weighted_jacobian(case, seed, data):
    arm, q = case
    locked = some_faults(data, arm)
    length = data.draw(st.sampled_from([0.1, 0.5, 2.0]))
    wrench = np.random.default_rng(seed).normal(size=6) * 20.0
    result = ftforce.analyze(arm, q, locked=locked, force=wrench, task="wrench", length=length)
    weights = np.array([1.0] * 3 + [length] * 3)
    J = weights[:, None] * result.J
    mask = result.faults.mask(arm.n)
    assume(is_clear(J, mask))
    direct = ftforce.remap(J, J.T @ (wrench / weights), mask)
    scale = norm(wrench / weights)
    assert_close(result.force.before, weights * direct.F, scale=scale, tol=1e-7)
    assert_close(result.force.after, weights * direct.F_after, scale=scale, tol=1e-7)
    assert_close(result.torque.after, direct.U, scale=scale, tol=1e-7)
    linear, angular = norm(result.force.jump[:3]), norm(result.force.jump[3:])
    assert (result.force.jump_norm, result.force.moment_jump_norm) == pytest.approx(
        (linear, angular)
    )


# ---- what lies outside the chain -------------------------------------------------------------

LIMB = urdf_of(
    *("root", "base", "a", "b", "c", "finger", "arm2", "hand2"),
    joints=[
        joint("lift", "prismatic", "root", "base", axis=(0, 0, 1)),
        joint("j1", "revolute", "base", "a", xyz=(0, 0, 0.3)),
        joint("j2", "revolute", "a", "b", xyz=(0.3, 0, 0), axis=(0, 1, 0)),
        joint("j3", "continuous", "b", "c", xyz=(0.3, 0, 0.1), axis=(0, 1, 0)),
        joint("grip", "prismatic", "c", "finger", axis=(0, 1, 0)),
        joint("other1", "revolute", "base", "arm2", xyz=(0, 0.3, 0)),
        joint("other2", "continuous", "arm2", "hand2", xyz=(0, 0.3, 0)),
    ],
)
CHAIN = {"j1": 0.3, "j2": -0.8, "j3": 1.1}


@pytest.mark.parametrize("axes", ["tool", "world"])
def test_joints_outside_the_chain_change_nothing(axes):
    here = {**CHAIN, "grip": 0.0, "lift": 0.0, "other1": 0.0, "other2": 0.0}
    there = {**CHAIN, "grip": 0.7, "lift": 1.0, "other1": -2.0, "other2": 9.0}
    results = []
    for posture in ("here", "there"):
        arm = load_text(
            LIMB, srdf_of(here=here, there=there), tip="c", base="base", posture=posture
        )
        assert arm.names == ("j1", "j2", "j3")
        results.append(
            ftforce.analyze(
                arm, posture="here", locked="j2", force=[3, -4, 5], velocity=[1, 2, 3], axes=axes
            )
        )
    here, there = results
    assert here.robot.held != there.robot.held
    assert_close(here.J, there.J, tol=1e-14)
    assert_close(here.force.jump, there.force.jump, tol=1e-14)
    assert_close(here.torque.after, there.torque.after, tol=1e-14)
    assert_close(here.velocity.after, there.velocity.after, tol=1e-14)
    assert here.margin == pytest.approx(there.margin, rel=1e-13)
    assert here.force.jump_norm > 0.1
