"""The remap inside limits: beside quadprog and HiGHS, by hand, and with absurd numbers."""

import math
import pickle
from collections import Counter

import daqp
import numpy as np
import pytest
from hypothesis import given, settings

from ftforce import remap
from ftforce.core import bounded_remap as bounded
from ftforce.core.bounded_remap import bounded_remap, share_of
from ftforce.core.reduced_jacobian import RTOL
from ftforce.errors import InputError, SolverError
from helpers import assert_close, campaign, only, seeds
from problems import (
    Problem,
    beyond,
    draw_extreme_problem,
    draw_problem,
    margin_by_highs,
    nearest_by_quadprog,
    ray_by_highs,
    space_of,
)

law = settings(deadline=None, max_examples=campaign(100, 50))

# Two planar directions; joint 2 serves both, so it alone can be replaced.
J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
F = np.array([10.0, 5.0])
TAU = J.T @ F
UNKNOWN = np.full(3, np.nan)


def norm(x):
    return float(np.linalg.norm(x))


# ---- beside another solver -------------------------------------------------------------------


def check(problem, result):
    """Compare a result with quadprog's, and with what the theory wants; return its kind."""
    space = space_of(problem)
    wanted = nearest_by_quadprog(problem, result.nearest.F, space)
    if result.F_after is None or wanted is None:
        if (result.F_after is None) != (wanted is None):  # only where rounding decides
            assert abs(margin_by_highs(problem)) < 1e-9
            return "border"
        assert result.U is None
        assert result.jump is None
        assert result.binding == ()
        assert result.residuals() == {}
        return "no balance" if space is None else "infeasible"
    size = max(norm(result.nearest.F), norm(wanted)) or 1.0
    assert_close(result.F_after, wanted, scale=size)
    assert_close(result.F_after + result.jump, result.nearest.F, scale=size)
    assert max(result.residuals().values()) < 1e-9
    torque = problem.rnea + problem.J.T @ result.F_after
    assert beyond(problem, result.F_after, space, size=size) < 1e-9
    no_torque = problem.locked | problem.free
    np.testing.assert_array_equal(result.U[no_torque], 0.0)
    assert_close(result.U[~no_torque], torque[~no_torque], scale=problem.scale * size + 1.0)
    # A column up to rtol counts as zero, and leaves at most rtol's share of the force unbalanced.
    left = np.abs(torque[problem.free])
    assert np.all(left <= RTOL * (problem.scale * size + norm(problem.rnea)))
    known = ~np.isnan(problem.limits) & ~problem.free
    assert set(result.binding) <= set(np.flatnonzero(known).tolist())
    return "binding" if result.binding else "closed form"


@pytest.mark.no_cover
@pytest.mark.thorough
def test_random_problems_beside_quadprog():
    rng = np.random.default_rng(2009)
    kinds = Counter()
    count = campaign(10_000)
    for _ in range(count):
        problem = draw_problem(rng)
        kinds[check(problem, problem.remap())] += 1
    assert kinds["border"] <= 3
    least = {"binding": 0.3, "closed form": 0.2, "infeasible": 0.1, "no balance": 0.03}
    for kind, share in least.items():
        assert kinds[kind] > share * count, kinds


@pytest.mark.no_cover
@pytest.mark.thorough
def test_shares_of_a_force_beside_highs():
    rng = np.random.default_rng(1)
    kinds = Counter()
    count = campaign(400, 120)
    while sum(kinds.values()) < count:
        problem = draw_problem(rng)
        result = problem.remap()
        if not result.nearest.F.any():
            continue
        ray = ray_by_highs(problem, result.nearest.F)
        if result.share is None:
            kinds["none"] += 1
            assert ray is None or ray[0] > 1.0 - 1e-6 or ray[1] < 1e-6
            continue
        most = min(ray[1], 1.0)
        kinds["whole" if most == 1.0 else "part" if most > 1e-6 else "nothing"] += 1
        assert result.share == pytest.approx(most, rel=1e-6, abs=1e-6)  # HiGHS's tolerance is 1e-7
    for kind, share in (("whole", 0.1), ("part", 0.1), ("nothing", 0.05), ("none", 0.05)):
        assert kinds[kind] >= share * count, kinds


# ---- without limits that bind: the closed forms ----------------------------------------------


def far(problem):
    """Return limits, known at every other joint, that no torque reaches."""
    result = problem.remap(limits=np.full(len(problem.tau), np.nan))
    if result.F_after is None:
        return None
    torque = np.abs(problem.rnea + problem.J.T @ result.F_after)
    limits = 1.001 * torque + 1e-3
    limits[::2] = np.nan
    return limits


@given(seeds)
@law
def test_locked_joints_alone_are_the_paper_s_bit_for_bit(seed):
    problem = draw_problem(np.random.default_rng(seed))
    problem = problem._replace(free=np.zeros(len(problem.tau), bool))
    paper = remap(problem.J, problem.tau, problem.locked)
    for limits in (np.full(len(problem.tau), np.nan), far(problem)):
        result = problem.remap(limits=limits)
        np.testing.assert_array_equal(result.nearest.F, paper.F)
        assert_close(result.F_after, paper.F_after, scale=norm(paper.F) or 1.0, tol=1e-12)
        assert_close(result.jump, paper.jump, scale=norm(paper.F) or 1.0, tol=1e-12)
        U = np.where(problem.locked, 0.0, problem.rnea + problem.J.T @ paper.F_after)
        assert_close(result.U, U, scale=problem.scale * norm(paper.F) + norm(problem.rnea) or 1.0)
        if paper.reduced.rank_after == len(problem.J):  # nothing is lost
            np.testing.assert_array_equal(result.F_after, paper.F_after)
            assert result.share == 1.0


@given(seeds)
@law
def test_free_and_locked_joints_by_pseudo_inverses(seed):
    rng = np.random.default_rng(seed)
    m, n = rng.integers(1, 7), rng.integers(2, 11)
    J, rnea, tau = rng.normal(size=(m, n)), rng.normal(size=n), 30.0 * rng.normal(size=n)
    state = rng.choice(3, size=n, p=[0.6, 0.2, 0.2])
    locked, free = state == 1, state == 2
    problem = Problem(J, tau, locked, free, np.full(n, np.nan), rnea)
    result = problem.remap()
    F, J_S, K = np.linalg.pinv(J.T) @ tau, J[:, free], np.where(locked, 0.0, J)
    balanced = -np.linalg.pinv(J_S.T) @ rnea[free]
    if norm(J_S.T @ balanced + rnea[free]) > 1e-6 * norm(rnea):
        assert result.F_after is None
        assert not result.feasible.is_balanced
        assert result.share is None
        return
    left = F - np.linalg.pinv(J_S.T) @ (J_S.T @ F)  # a free joint alone
    if locked.any():
        U, s, _ = np.linalg.svd(K - J_S @ np.linalg.pinv(J_S) @ K)
        U = U[:, : np.count_nonzero(s > 1e-9 * problem.scale)]
        left = U @ (U.T @ F)
    scale = norm(F) + norm(balanced)
    assert_close(result.F_after, balanced + left, scale=scale, tol=1e-10)
    assert_close(J_S.T @ result.F_after + rnea[free], 0.0, scale=scale, tol=1e-10)
    U = np.where(locked | free, 0.0, rnea + J.T @ result.F_after)
    assert_close(result.U, U, scale=problem.scale * scale, tol=1e-10)
    same = problem.remap(limits=far(problem))
    np.testing.assert_array_equal(same.F_after, result.F_after)


# ---- by hand ---------------------------------------------------------------------------------

NAN = math.nan
NO_FORCE = {"tau": 0 * TAU, "locked": only()}
BY_HAND = {  # what is asked: force after, torques, joints at their limits, share
    "the rest is kept": ({"limits": [6, NAN, 9]}, [6, 5], [6, 0, 5], (0,), 0.6),
    "a corner": ({"limits": [6, NAN, 2]}, [6, 2], [6, 0, 2], (0, 2), 0.4),
    "a brake": ({"limits": [NAN, 12, NAN]}, [8.5, 3.5], [8.5, 0, 3.5], (1,), 0.8),
    "weight": ({"limits": [6, NAN, 9], "rnea": [2, 7, -1]}, [4, 5], [6, 0, 4], (0,), 0.4),
    "lower limit": ({"limits": [6, NAN, 9], "tau": -TAU}, [-6, -5], [-6, 0, -5], (0,), 0.6),
    "free": ({"locked": only(), "free": only(2)}, [2.5, -2.5], [2.5, 0, -2.5], (), 0.0),
    "weight of a free joint": (
        {**NO_FORCE, "free": only(2), "rnea": [1, -4, 2]}, [2, 2], [3, 0, 4], (), None,
    ),
    "everything locked": ({"locked": only(1, 2, 3)}, [0, 0], [0, 0, 0], (), 0.0),
    "locked, with brakes": (
        {"locked": only(1, 2, 3), "limits": [1, 2, 3]}, [0, 0], [0, 0, 0], (), 0.0,
    ),
    "no force": (
        {"tau": 0 * TAU, "locked": only(1, 2), "limits": [1, 1, 1], "rnea": [0.5, 0.5, -0.5]},
        [0, 0], [0, 0, -0.5], (), 1.0,
    ),
    "a limit that counts only for motors": (
        {"locked": only(), "free": only(2), "limits": [9, 1e-3, 9], "rnea": [0, 1, 0]},
        [2, -3], [2, 0, -3], (), None,
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("asked", "F_after", "U", "binding", "share"), BY_HAND.values(), ids=BY_HAND
)
def test_by_hand(asked, F_after, U, binding, share):
    result = bounded_remap(J, **{"tau": TAU, "locked": only(2), "limits": UNKNOWN, **asked})
    assert_close(result.F_after, F_after, scale=10.0)
    assert_close(result.F_after + result.jump, result.nearest.F, scale=10.0)
    assert_close(result.U, U, scale=10.0)
    assert (result.binding, result.overloaded) == (binding, ())
    assert result.feasible.is_balanced
    assert result.share == (None if share is None else pytest.approx(share))


@pytest.mark.parametrize(
    ("sign", "limits", "multipliers"), [(1, [6, NAN, 2], [4, 3]), (-1, [6, NAN, 9], [-4, 0])]
)
def test_multipliers_by_hand(sign, limits, multipliers):
    result = bounded_remap(J, sign * TAU, only(2), limits=limits)
    assert_close(result.nearest.multipliers, multipliers)


def test_weight_beyond_a_limit_is_an_answer():
    flat = np.array([[1.0, 0.0, 1.0]])
    overload = {"limits": [9.0, 9.0, 9.0], "rnea": [0.0, -10.0, 0.0]}
    result = bounded_remap(flat, [1, 0, 1], only(), **overload)
    assert result.F_after is None  # no force changes the torque of joint 2
    assert result.overloaded == (1,)
    assert result.share is None
    helped = bounded_remap(J, 0 * TAU, only(), limits=[9.0, 9.0, 9.0], rnea=[0.0, -10.0, 0.0])
    assert_close(helped.F_after, [0.5, 0.5])  # here the tip may lean on something
    assert share_of(helped.feasible, np.array([1.0, 0.0])) == 1.0  # all of it is just enough
    assert helped.overloaded == (1,)
    assert helped.share is None


def test_a_jacobian_of_zeros():
    zeros = np.zeros((2, 3))
    result = bounded_remap(zeros, [1, 2, 3], only(), limits=[1, 1, 1], rnea=[0.5, 0, 0])
    assert_close(result.F_after, [0, 0])
    assert result.share == 1.0
    too_heavy = bounded_remap(zeros, [1, 2, 3], only(), limits=[1, 1, 1], rnea=[2, 0, 0])
    assert too_heavy.F_after is None
    assert too_heavy.overloaded == (0,)


def test_the_limit_of_a_free_joint_does_not_count():
    for limit in (1e-3, np.nan):
        result = bounded_remap(J, TAU, only(), limits=[9, limit, 9], free=only(2), rnea=[0, 1, 0])
        assert result.feasible.joints == [0, 2]


def test_rtol_decides_which_torque_a_force_loads():
    lean = np.array([[1.0, 1e-4], [0.0, 0.0]])
    case = {"limits": [9.0, 1.0], "rnea": [0.0, 1.0005]}
    assert bounded_remap(lean, [2.0, 2e-4], only(n=2), **case).overloaded == (1,)
    assert_close(bounded_remap(lean, [2.0, 2e-4], only(n=2), **case).F_after, [-5, 0])
    assert bounded_remap(lean, [2.0, 2e-4], only(n=2), rtol=1e-3, **case).F_after is None


# ---- results ---------------------------------------------------------------------------------


@pytest.fixture
def result():
    three = np.array([[1.0, 1.0, 0.0, 0.3], [0.0, 1.0, 1.0, -0.2], [0.5, 0.0, 2.0, 1.0]])
    tau = three.T @ [10.0, 5.0, 7.0]
    return bounded_remap(
        three, tau, only(4, n=4), limits=[6.0, np.nan, 50.0, np.nan], rnea=[0.5, 1.0, -2.0, 0.0]
    )  # the locked joint costs nothing, joint 1 is at its limit, joint 3 is not


def residuals(result, **changes):
    return result.nearest._replace(**changes).residuals(result.feasible)


def test_the_residuals_of_a_good_result_are_rounding(result):
    assert set(result.residuals()) == {"equality", "limit", "optimality"}
    assert max(result.residuals().values()) < 1e-14
    assert result.binding == (0,)


@pytest.mark.parametrize(
    ("step", "beyond_limit"),
    [(1.0, True), (-1.0, False), (None, False)],
    ids=["beyond", "short", "aside"],
)
def test_a_force_that_is_not_the_nearest_is_found(result, step, beyond_limit):
    row = result.feasible.rows[0]
    change = np.cross(row, [0.3, -0.8, 0.1]) if step is None else step * row
    found = residuals(result, F_after=result.F_after + 0.01 * change)
    assert found["limit"] > 1e-3 if beyond_limit else found["limit"] < 1e-12
    assert found["optimality"] > 1e-4


def test_a_force_that_no_motor_commands_is_found():
    result = bounded_remap(J, TAU, only(1, 2), limits=[np.nan, np.nan, 2.0])
    assert_close(result.F_after, [0, 2])
    assert max(result.residuals().values()) < 1e-14
    beside = residuals(result, F_after=result.F_after + np.array([0.1, 0.0]))
    assert beside["equality"] > 1e-3
    assert beside["limit"] == 0.0


@pytest.mark.parametrize(
    "multipliers",
    [
        lambda y: 0 * y,
        lambda y: 1.01 * y,
        lambda y: -y,
        lambda y: y + np.array([0, 0.01]),
        lambda y: y[::-1],
    ],
    ids=["none", "large", "sign", "idle", "swapped"],
)
def test_wrong_multipliers_are_found(result, multipliers):
    y = multipliers(result.nearest.multipliers)
    assert residuals(result, multipliers=y)["optimality"] > 1e-5


def test_results_are_read_only_and_can_be_pickled(result):
    with pytest.raises(AttributeError):
        result.rnea = None
    assert not result.U.flags.writeable
    again = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(again.U, result.U)
    assert (again.binding, again.residuals()) == (result.binding, result.residuals())


@pytest.mark.parametrize(
    "claim",
    [
        lambda z, f, flag, info: (z, f, -4, info),
        lambda z, f, flag, info: (z + 1e-5, f, flag, info),
        lambda z, f, flag, info: (z * np.nan, f, flag, info),
        lambda z, f, flag, info: (z, f, -1, info),
    ],
    ids=["gives up", "beyond a limit", "NaN", "infeasible"],
)
def test_the_solver_is_not_believed(monkeypatch, claim):
    solve = daqp.solve
    monkeypatch.setattr(daqp, "solve", lambda *args, **options: claim(*solve(*args, **options)))
    with pytest.raises(SolverError, match="quadratic program"):
        bounded_remap(J, TAU, only(2), limits=[6.0, np.nan, 4.0])  # both active
    assert issubclass(SolverError, Exception)
    assert not issubclass(SolverError, InputError)


def test_one_active_limit_is_solved_as_by_the_solver(monkeypatch):
    rng = np.random.default_rng(17)
    closed = Counter()

    def spy(*args, **options):
        z = original(*args, **options)
        closed[z is not None] += 1
        return z

    original = bounded._on_one_limit
    for _ in range(300):
        problem = draw_problem(rng)
        monkeypatch.setattr(bounded, "_on_one_limit", spy)
        one = problem.remap()
        monkeypatch.setattr(bounded, "_on_one_limit", lambda *_, **__: None)
        other = problem.remap()
        assert (one.F_after is None) == (other.F_after is None)
        if one.F_after is not None:
            scale = max(norm(one.nearest.F), norm(one.F_after)) or 1.0
            assert_close(one.F_after, other.F_after, scale=scale)
            assert one.binding == other.binding
    assert min(closed.values()) > 30


# ---- absurd numbers --------------------------------------------------------------------------


@pytest.mark.no_cover
@pytest.mark.thorough
def test_absurd_problems_end_in_numbers_and_are_never_feasible_by_mistake():
    rng = np.random.default_rng(10)
    kinds = Counter()
    count = campaign(2000, 400)
    for _ in range(count):
        problem = draw_extreme_problem(rng)
        try:
            result = problem.remap()
        except SolverError:  # at least it says so
            kinds["given up"] += 1
            continue
        share, laws, space = result.share, result.residuals(), space_of(problem)
        assert share is None or 0.0 <= share <= 1.0
        if result.F_after is None:
            kinds["infeasible"] += 1
            # quadprog sees a small limit badly beside a large force, but not beside none.
            none = nearest_by_quadprog(problem, 0.0 * result.nearest.F, space)
            assert none is None or beyond(problem, none, space, size=norm(none)) > 1e-3
            continue
        kinds["feasible"] += 1
        assert np.isfinite(result.F_after).all()
        assert np.isfinite(result.U).all()
        assert np.isfinite([laws["equality"], laws["optimality"]]).all()
        assert laws["equality"] < 1e-9
        assert laws["optimality"] < 1e-9
        assert space is not None
        size = max(norm(result.nearest.F), norm(result.F_after))
        assert beyond(problem, result.F_after, space, size=size) < 1e-9
    assert min(kinds["feasible"], kinds["infeasible"]) > 0.2 * count
    assert kinds["given up"] < 3


@pytest.mark.no_cover
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("length", "force"), [(1e-9, 1.0), (1e-3, 300.0), (1e3, 1.0), (1e9, 1e-3), (1.0, 0.3)]
)
def test_units_of_length_and_force_do_not_matter(length, force):
    rng, size = np.random.default_rng(3), length * force
    for _ in range(campaign(200, 40)):
        problem = draw_problem(rng)
        if abs(margin_by_highs(problem)) < 1e-9:
            continue
        one = problem.remap()
        other = problem._replace(
            J=length * problem.J, tau=size * problem.tau,
            rnea=size * problem.rnea, limits=size * problem.limits,
        ).remap()  # fmt: skip
        assert (one.F_after is None) == (other.F_after is None)
        if one.F_after is not None:
            scale = max(norm(one.nearest.F), norm(one.F_after)) or 1.0
            assert_close(other.F_after, force * one.F_after, scale=force * scale)
            assert other.binding == one.binding
            assert (one.share is None) == (other.share is None)
            if one.share is not None:
                assert other.share == pytest.approx(one.share, rel=1e-6, abs=1e-9)


def test_a_weak_lever_is_a_lever():
    # 1e-5 of the arm's: more than rtol, but so little that daqp would ignore the row.
    weak = np.array([[1.0, 0.0], [0.0, 1e-5]])
    result = bounded_remap(weak, weak.T @ [3.0, 8e5], only(n=2), limits=[9.0, 5.0])
    assert_close(result.F_after, [3.0, 5e5])
    assert result.binding == (1,)
    heavy = bounded_remap(weak, [3.0, 0.0], only(n=2), limits=[9.0, 5.0], rnea=[0.0, 6.0])
    assert_close(heavy.F_after, [3.0, -1e5], scale=1e5)


def test_a_lever_up_to_rtol_restrains_no_force():
    lean = np.array([[1.0, 1e-7]])
    case = {"limits": [np.nan, 1.0], "rnea": [0.0, 1.0 - 1e-9]}
    result = bounded_remap(lean, [10.0, 0.0], only(n=2), **case)  # 1e-9 N·m beyond the limit
    assert_close(result.F_after, [10.0])
    assert result.residuals()["limit"] < RTOL
    both = bounded_remap(lean, [10.0, 0.0], only(n=2), **{**case, "limits": [4.0, 1.0]})
    assert_close(both.F_after, [4.0])
    assert_close(both.nearest.multipliers, [6, 0])


@pytest.mark.parametrize("limit", [1e-300, 1e-30, 1e-12])
def test_a_motor_with_next_to_no_torque_is_like_a_free_joint(limit):
    free = bounded_remap(J, TAU, only(), limits=UNKNOWN, free=only(2), rnea=[1, -4, 2])
    weak = bounded_remap(J, TAU, only(), limits=[np.nan, limit, np.nan], rnea=[1, -4, 2])
    assert_close(weak.F_after, free.F_after)
    assert weak.residuals()["limit"] < 1e-9
    assert weak.binding == (1,)


# ---- what comes from outside -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"limits": [1.0, 0.0, 3.0]}, r"limits must be positive.*got \[1.0, 0.0"),
        ({"limits": [1.0, 2.0]}, "limits needs 3 numbers, got 2.*column of J"),
        ({"limits": None}, "limits needs numbers"),
        ({"tau": [1.0, 2.0]}, "tau needs 3 numbers, got 2.*one torque per column"),
        ({"tau": [1.0, np.nan, 2.0]}, "tau contains nan at position 2"),
        ({"rnea": [1.0, 2.0]}, "rnea needs 3 numbers, got 2.*one per column"),
        ({"rnea": [1.0, 2.0, np.inf]}, "rnea contains inf at position 3"),
        (
            {"locked": only(3), "free": only(1, 3)},
            "the joint of column 3 of J cannot be both locked and free",
        ),
        ({"free": "2"}, "free must be a boolean mask.*got '2'"),
        ({"locked": [0, 1, 0]}, "locked must be a boolean mask"),
        ({"rtol": np.nan}, "rtol must lie between"),
        ({"J": [[1.0, np.nan, 0.0]]}, "J contains nan"),
    ],
)
def test_malformed_input(given, message):
    with pytest.raises(InputError, match=message):
        bounded_remap(**{"J": J, "tau": TAU, "locked": only(2), "limits": [6.0, 9.0, 9.0], **given})
