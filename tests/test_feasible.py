"""The forces that can be held: by hand, ray by ray beside HiGHS, and the weakest direction."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings

from ftforce.core.bounded_remap import overloaded
from ftforce.core.feasible_forces import (
    NOTHING,
    LockModel,
    Reach,
    feasible_forces,
    reach,
    weakest_direction,
)
from ftforce.core.reduced_jacobian import RTOL, reduce
from ftforce.errors import UnknownNameError
from helpers import CAMPAIGN, assert_close, campaign, seeds
from problems import draw_problem, ray_by_highs, space_of

law = settings(deadline=None, max_examples=campaign(100, 40))

J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
X, Y = np.eye(2)
NONE = np.zeros(3)


def norm(x):
    return float(np.linalg.norm(x))


def forces(J, limits, *, rnea=None, locked=(), free=(), reading=LockModel.COMMANDED, rtol=RTOL):
    """Return the forces that can be held; joints are numbered from 1."""
    n = J.shape[1]
    S, L = (np.isin(np.arange(1, n + 1), joints) for joints in (free, locked))
    largest = None if limits is None else np.where(S, 0.0, np.array(limits, dtype=float))
    rnea = np.zeros(n) if rnea is None else np.array(rnea, dtype=float)
    return feasible_forces(reduce(J, L, rtol, S if S.any() else None), rnea, largest, reading)


def forces_of(problem, reading=LockModel.COMMANDED):
    """Return the forces of a random problem."""
    S = problem.free if problem.free.any() else None
    largest = np.where(problem.free, 0.0, problem.limits)
    reduced = reduce(problem.J, problem.locked, free=S)
    return feasible_forces(reduced, problem.rnea, largest, reading)


# ---- readings --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Held", "", None])
def test_readings_by_name(name):
    for reading in LockModel:
        assert LockModel.parse(reading.value) is LockModel.parse(reading) is reading
    with pytest.raises(UnknownNameError, match=r"unknown lock model .*: commanded, held"):
        LockModel.parse(name)


def test_a_lock_holds_what_no_motor_commands():
    limits = [2.0, np.nan, 9.0]
    commanded = forces(J, limits, locked=(2, 3))
    held = forces(J, limits, locked=(2, 3), reading=LockModel.HELD)
    assert reach(commanded, X) == (0.0, 2.0, (0,))
    assert reach(commanded, Y) == (0.0, 0.0, ())
    assert reach(held, X) == (0.0, 2.0, (0,))
    assert reach(held, Y) == (0.0, 9.0, (2,))  # up to the limit of joint 3's brake


# ---- the set ---------------------------------------------------------------------------------


@given(seeds)
@law
def test_forces_of_the_plane_keep_the_equations_of_the_theory(seed):
    rng = np.random.default_rng(seed)
    problem = draw_problem(rng)
    for reading in LockModel:
        feasible = forces_of(problem, reading)
        space = space_of(problem, held=reading is LockModel.HELD)
        assert feasible.is_balanced == (space is not None)
        F0, Z = feasible.F0, feasible.Z
        assert_close(Z.T @ Z, np.eye(Z.shape[1]))
        assert_close(Z.T @ F0, np.zeros(Z.shape[1]), scale=norm(F0) or 1.0, tol=1e-8)
        if space is None:
            assert reach(feasible, rng.normal(size=len(F0))) == NOTHING
            continue
        assert Z.shape[1] == len(F0) - len(space.E)
        F = F0 + Z @ rng.normal(size=Z.shape[1])
        assert_close(space.E @ F, space.e, scale=norm(F) + norm(space.e) or 1.0, tol=1e-7)
        assert feasible.joints == space.joints.tolist()
        assert_close(feasible.rows, space.A, tol=1e-15)
        size = norm(problem.rnea)
        assert_close(feasible.upper, space.high, tol=1e-12)
        assert_close(feasible.lower, space.low, tol=1e-12)
        assert_close(F0, np.linalg.pinv(space.E) @ space.e, scale=size + norm(F0) or 1.0, tol=1e-7)


def test_only_known_limits_make_rows():
    feasible = forces(J, [2.0, np.nan, 9.0], rnea=[0.5, 1.0, -1.0])
    assert feasible.joints == [0, 2]
    assert_close(feasible.lower, [-2.5, -8])
    assert_close(feasible.upper, [1.5, 10])
    assert_close(feasible.rows, J.T[[0, 2]])
    assert forces(J, None).joints == []
    assert forces(J, [np.nan] * 3).joints == []


def test_a_load_that_balances_itself_is_left_alone():
    # A weight of 1e-13 of the arm's is rounding: no support is needed.
    assert not forces(J, None, free=(2,), rnea=[1.0, 1e-13, 0.0]).F0.any()
    assert forces(J, None, free=(2,), rnea=[1.0, 1e-11, 0.0]).F0.any()


@pytest.mark.parametrize(("left", "stands"), [(0.9e-6, True), (1.1e-6, False)])
def test_what_is_left_unbalanced_is_judged_by_the_weight(left, stands):
    flat = np.array([[1.0, 0.0, 1.0]])
    feasible = forces(flat, None, free=(2,), rnea=[1.0, left, 0.0])
    assert feasible.bearings.unbalanced == pytest.approx(left)
    assert feasible.is_balanced is stands
    assert reach(feasible, np.ones(1)).is_empty is not stands


def test_joints_that_weight_alone_overloads():
    feasible = forces(J, [2.0, 3.0, np.nan], rnea=[-2.5, 3.0, 99.0])
    assert overloaded(feasible) == (0,)
    assert overloaded(forces(J, None, rnea=[9.0, 9.0, 9.0])) == ()
    # The support that a free joint needs can overload others, and can relieve them.
    assert overloaded(forces(J, [1.0, np.nan, 3.0], free=(2,), rnea=[0.0, -4.0, 0.0])) == (0,)
    assert overloaded(forces(J, [2.5, np.nan, 3.0], free=(2,), rnea=[-3.0, -4.0, 0.0])) == ()


# ---- rays ------------------------------------------------------------------------------------

RAYS = [  # limits, weight, direction: least, most, joints that stop it; None if it is empty
    ([2, 9, 3], [0, 0, 0], X, (0.0, 2.0, (0,))),
    ([2, 9, 3], [0, 0, 0], -X, (0.0, 2.0, (0,))),
    ([2, 9, 3], [0, 0, 0], Y, (0.0, 3.0, (2,))),
    ([2, 9, 3], [0, 0, 0], 2.0 * X, (0.0, 1.0, (0,))),
    ([2, 9, 3], [0.5, 0, 0], X, (0.0, 1.5, (0,))),  # weight makes one way longer than the other
    ([2, 9, 3], [0.5, 0, 0], -X, (0.0, 2.5, (0,))),
    ([2, 9, 2], [0, 0, 0], X + Y, (0.0, 2.0, (0, 2))),
    ([2, 9, 2 + 1e-6], [0, 0, 0], X + Y, (0.0, 2.0, (0,))),
    ([math.nan] * 3, [0, 0, 0], X, (0.0, math.inf, ())),
    ([2, math.nan, math.nan], [0, 0, 0], Y, (0.0, math.inf, ())),
    (None, [0, 0, 0], X, (0.0, math.inf, ())),
    ([2, math.nan, 9], [3, 0, 0], -X, (1.0, 5.0, (0,))),  # an overloaded joint needs a force
    ([2, math.nan, 9], [3, 0, 0], X, None),
    ([2, math.nan, 9], [3, 0, 0], Y, None),  # joint 1 has no lever along y
]


@pytest.mark.parametrize(("limits", "rnea", "direction", "wanted"), RAYS, ids=str)
def test_rays_by_hand(limits, rnea, direction, wanted):
    found = reach(forces(J, limits, rnea=rnea), direction)
    assert found.is_empty is (wanted is None)
    assert wanted is None or found == wanted


def test_what_is_empty():
    empty = [x.is_empty for x in (NOTHING, Reach(2.0, 1.0), Reach(0.0, 0.0), Reach(2.0, 2.0))]
    assert empty == [True, True, False, False]


def test_a_free_joint_s_weight_asks_for_one_force_of_a_ray():
    feasible = forces(J, [9.0, np.nan, 9.0], free=(2,), rnea=[0.0, -4.0, 0.0])
    assert_close(feasible.F0, [2, 2])
    assert reach(feasible, X + Y)[:2] == pytest.approx((2.0, 2.0))
    assert reach(feasible, X)[:2] == pytest.approx((4.0, 4.0))
    assert reach(feasible, -X).is_empty
    assert reach(feasible, X - Y).is_empty
    too_weak = forces(J, [1.0, np.nan, 9.0], free=(2,), rnea=[0.0, -4.0, 0.0])
    assert reach(too_weak, X + Y).is_empty


@pytest.mark.parametrize(("lever", "ends"), [(1.1e-6, True), (0.9e-6, False), (0.0, False)])
def test_a_lever_up_to_rtol_is_none(lever, ends):
    lean = np.array([[1.0, lever]])
    assert reach(forces(lean, [np.nan, 5.0]), np.ones(1)).limiting_joints == ((1,) if ends else ())
    overweight = reach(forces(lean, [np.nan, 5.0], rnea=[0.0, 6.0]), -np.ones(1))
    assert overweight.is_empty is not ends


@pytest.mark.parametrize(("angle", "inside"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_direction_up_to_rtol_beside_the_plane_lies_in_it(angle, inside):
    feasible = forces(J, [2.0, np.nan, np.nan], locked=(2, 3))
    d = np.array([1.0, angle])
    assert reach(feasible, d).maximum == pytest.approx(2.0 if inside else 0.0)


@pytest.mark.no_cover
@pytest.mark.thorough
def test_rays_beside_highs():
    rng = np.random.default_rng(8)
    kinds, count = Counter(), campaign(500, 150)
    for _ in range(count):
        problem = draw_problem(rng)
        reading = LockModel(rng.choice(list(LockModel)))
        feasible = forces_of(problem, reading)
        d = rng.normal(size=len(problem.J))
        if rng.random() < 0.7 and feasible.Z.any():
            d = feasible.Z @ rng.normal(size=feasible.Z.shape[1])
        if feasible.F0.any() and feasible.is_balanced:
            d = feasible.F0 + rng.choice([0.0, 0.3]) * d
        found = reach(feasible, d)
        wanted = ray_by_highs(problem, d, held=reading is LockModel.HELD)
        if wanted is None:
            assert found.is_empty
            kinds["empty"] += 1
            continue
        assert (found.minimum, found.maximum) == pytest.approx(wanted, rel=1e-6, abs=1e-7)
        ends = (
            "open" if math.isinf(found.maximum) else "limit" if found.limiting_joints else "plane"
        )
        kinds[ends] += 1
        if found.limiting_joints:  # these joints are at their limits there
            torque = problem.rnea + problem.J.T @ (found.maximum * d)
            for joint in found.limiting_joints:
                assert abs(torque[joint]) == pytest.approx(problem.limits[joint], rel=1e-6)
    for kind in ("empty", "open", "limit", "plane"):
        assert kinds[kind] > count / 50, kinds


@pytest.mark.parametrize("size", [1e-300, 1e-200, 1e-100, 1e150])
def test_rays_of_any_size(size):
    lost = forces(J, [2.0, np.nan, 9.0], locked=(2, 3))
    assert reach(lost, size * X).maximum == pytest.approx(2.0 / size)
    assert reach(lost, size * Y) == (0.0, 0.0, ())
    carried = forces(J, None, free=(2,), rnea=[0.0, -4.0, 0.0])
    assert reach(carried, size * X).maximum == pytest.approx(4.0 / size)


# ---- the weakest direction -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "rnea", "direction", "most", "stops"),
    [
        ([2, 2.5, 3], [0, 0, 0], (X + Y) / math.sqrt(2.0), 2.5 / math.sqrt(2.0), (1,)),
        ([2, math.nan, 3], [-0.5, 0, 0], -X, 1.5, (0,)),  # weight decides which way
    ],
)
def test_the_weakest_direction_meets_the_closest_limit(limits, rnea, direction, most, stops):
    weakest = weakest_direction(forces(J, limits, rnea=rnea), np.eye(2))
    assert_close(weakest.direction, direction)
    assert weakest.reach == (0.0, pytest.approx(most), stops)


def test_a_lost_direction_is_the_weakest():
    weakest = weakest_direction(forces(J, [2.0, np.nan, 3.0], locked=(2, 3)), np.eye(2))
    assert_close(weakest.direction, [0, 1])
    assert weakest.reach == (0.0, 0.0, ())
    held = forces(J, [2.0, np.nan, 3.0], locked=(2, 3), reading=LockModel.HELD)
    assert weakest_direction(held, np.eye(2)).reach == (0.0, 2.0, (0,))


def test_an_overloaded_arm_holds_nothing_in_any_direction():
    too_heavy = {"rnea": [3.0, 0.0, 0.0]}
    for feasible in (
        forces(J, [2.0, np.nan, 3.0], **too_heavy),
        forces(J, [2.0, np.nan, 3.0], locked=(2, 3), **too_heavy),  # also where one is lost
        forces(J * [0.0, 1.0, 1.0], [2.0, np.nan, np.nan], **too_heavy),  # no limit is loaded
    ):
        assert weakest_direction(feasible, np.eye(2)).reach.is_empty
    assert weakest_direction(forces(J, None, free=(2,), rnea=[0, 1, 0]), np.eye(2)).reach == NOTHING
    leaning = forces(J, None, free=(2,), rnea=[0, -1, 0])  # only while it leans on something
    assert weakest_direction(leaning, np.eye(2)).reach == NOTHING
    flat = np.array([[1.0, 0.0, 1.0]])
    assert weakest_direction(forces(flat, None, free=(2,), rnea=[0, 1, 0]), np.eye(1)).reach == (
        NOTHING
    )


def test_the_weakest_of_an_arm_without_known_limits():
    for limits in (None, [np.nan] * 3):
        weakest = weakest_direction(forces(J, limits), np.eye(2))
        assert weakest.reach == (0.0, math.inf, ())
        assert norm(weakest.direction) == pytest.approx(1.0)
    unloaded = forces(J * [0.0, 1.0, 1.0], [2.0, np.nan, np.nan], rnea=[1.0, 0.0, 0.0])
    assert weakest_direction(unloaded, np.eye(2)).reach == (0.0, math.inf, ())


def test_the_weakest_direction_of_an_arm_that_exerts_no_force():
    none = np.zeros((2, 0))
    for rnea, reach_ in (([0.0] * 3, (0.0, 0.0, ())), ([5.0, 0.0, 0.0], NOTHING)):
        weakest = weakest_direction(forces(np.zeros((2, 3)), [1.0] * 3, rnea=rnea), none)
        assert_close(weakest.direction, [1, 0])
        assert weakest.reach[:2] == reach_[:2] or weakest.reach.is_empty is reach_.is_empty


@pytest.mark.parametrize("limit", [1e-300, 1e300])
@pytest.mark.parametrize("lever", [1e-12, 1.0, 1e12])
def test_the_weakest_direction_of_an_arm_without_measure(limit, lever):
    weakest = weakest_direction(forces(lever * J, [limit] * 3), np.eye(2))
    assert weakest.reach.maximum == pytest.approx(limit / math.sqrt(2.0) / lever)
    assert not weakest.reach.is_empty


def circle(count):
    angle = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def test_no_direction_is_weaker_than_the_weakest():
    rng = np.random.default_rng(11)
    limited, count = 0, campaign(200, 60)
    for _ in range(count):
        problem = draw_problem(rng)
        healthy = reduce(problem.J, np.zeros(len(problem.tau), bool))
        space = healthy.healthy.U[:, : healthy.rank]
        if not healthy.rank:
            continue
        for reading in LockModel:
            feasible = forces_of(problem, reading)
            weakest = weakest_direction(feasible, space)
            assert norm(weakest.direction) == pytest.approx(1.0)
            assert_close(space @ (space.T @ weakest.direction), weakest.direction, scale=1.0)
            directions = rng.normal(size=(40, healthy.rank)) @ space.T
            rays = [reach(feasible, d / norm(d)) for d in directions]
            if weakest.reach.is_empty or feasible.F0.any():
                assert all(ray.is_empty or ray.minimum > 0.0 for ray in rays)
                continue
            assert weakest.reach.minimum == 0.0
            least = min(ray.maximum for ray in rays)
            assert least >= weakest.reach.maximum * (1.0 - 1e-9)
            limited += math.isfinite(least)
    assert limited > count / 2


@pytest.mark.no_cover
@pytest.mark.thorough
def test_the_weakest_direction_is_found_exactly():
    rng = np.random.default_rng(12)
    compared, count = 0, campaign(200, 40)
    for _ in range(count):
        problem = draw_problem(rng, m=2)
        n = len(problem.tau)
        problem = problem._replace(locked=np.zeros(n, bool), free=np.zeros(n, bool))
        feasible = forces_of(problem)
        if feasible.Z.shape[1] < 2 or overloaded(feasible):
            continue
        weakest = weakest_direction(feasible, np.eye(2)).reach.maximum
        if math.isinf(weakest):
            continue
        compared += 1
        brute = min(reach(feasible, d).maximum for d in circle(3600 if CAMPAIGN else 720))
        assert brute == pytest.approx(weakest, rel=1e-6 if CAMPAIGN else 2e-5)  # half a step
    assert compared > count / 10
