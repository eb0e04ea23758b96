"""Verdicts with limits, weight and joints without torque: by hand, and by trying tolerances."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings

from ftforce.core.bounded_remap import nearest_force, remap_inside
from ftforce.core.feasible_forces import feasible_forces
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, reduce
from ftforce.core.verdict import Verdict, judge, tolerance_that_loses, verdict
from helpers import RATIOS, campaign, orthogonal, seeds, with_singular_values
from problems import draw_problem

law = settings(deadline=None, max_examples=campaign(100, 40))

TOLERATED, BORDERLINE, NOT = Verdict.TOLERATED, Verdict.BORDERLINE, Verdict.NOT_TOLERATED
J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
X, Y = np.eye(2)
FAR = [1e6, 1e6, 1e6]


def verdict_of(
    J, F, limits=None, *, locked=(), free=(), rnea=None, wary=BORDERLINE_RTOL, rtol=RTOL
):  # joints are numbered from 1
    """Judge as `ftforce.analyze` does."""
    J, n = np.asarray(J, dtype=float), np.shape(J)[1]
    S, L = (np.isin(np.arange(1, n + 1), joints) for joints in (free, locked))
    largest = None if limits is None else np.where(S, 0.0, np.array(limits, dtype=float))
    rnea = np.zeros(n) if rnea is None else np.array(rnea, dtype=float)
    reduced = reduce(J, L, rtol, S if S.any() else None)
    asked = np.zeros(len(J)) if F is None else np.asarray(F, dtype=float)
    bounded = None
    if largest is not None or S.any():
        bounded = remap_inside(reduced, asked, rnea, largest)
    return judge(reduced, None if F is None else asked, wary, bounded, largest)


# ---- limits ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        (0.0, TOLERATED),
        (0.9e-6, TOLERATED),
        (1.1e-6, BORDERLINE),
        (5e-3, BORDERLINE),
        (0.99e-2, BORDERLINE),
        (1.01e-2, NOT),
        (0.5, NOT),
    ],
)
def test_a_jump_between_rtol_and_wary_is_borderline(missing, expected):
    limits = [10.0 * (1.0 - missing), np.nan, np.nan]
    assert verdict_of(J, 10.0 * X, limits) is expected
    assert verdict_of(J, -10.0 * X, limits) is expected
    assert verdict_of(J, 10.0 * X, limits, locked=(2,)) is expected


def test_both_ends_of_the_tolerances_can_be_chosen():
    limits = [9.5, np.nan, np.nan]
    assert verdict_of(J, 10.0 * X, limits) is NOT
    assert verdict_of(J, 10.0 * X, limits, wary=0.1) is BORDERLINE
    assert verdict_of(J, 10.0 * X, limits, wary=0.1, rtol=0.06) is TOLERATED
    assert verdict_of(J, 10.0 * X, limits, wary=0.01, rtol=0.01) is NOT


def test_a_limit_that_does_not_bind_changes_no_verdict():
    for locked, F in (((2,), X), ((1, 2), X), ((1, 2), Y), ((), X + Y)):
        assert verdict_of(J, F, FAR, locked=locked) is verdict_of(J, F, locked=locked)
    assert verdict_of(J, Y, [0.5, np.nan, 9.0], locked=(2,)) is TOLERATED
    assert verdict_of(J, Y, [0.5, np.nan, 9.0], locked=(2, 3)) is NOT  # it is lost


def test_weight_beyond_a_limit_is_not_tolerated():
    too_heavy = {"limits": [2.0, np.nan, np.nan], "rnea": [3.0, 0.0, 0.0]}
    assert verdict_of(J, Y, **too_heavy) is NOT
    assert verdict_of(J, 0 * X, **too_heavy) is NOT
    assert verdict_of(J, None, **too_heavy) is NOT
    assert verdict_of(J, -2.0 * X, **too_heavy) is TOLERATED  # leaning on its environment
    flat = J * [0.0, 1.0, 1.0]
    assert verdict_of(flat, Y, **too_heavy) is NOT  # no force helps
    assert verdict_of(flat, None, **too_heavy) is NOT


def test_a_little_too_heavy_is_borderline():
    limits, rnea = [2.0, np.nan, np.nan], [2.01, 0.0, 0.0]
    assert verdict_of(J, 10.0 * Y, limits, rnea=rnea) is BORDERLINE  # 0.01 N of 10 N
    assert verdict_of(J, 0.1 * Y, limits, rnea=rnea) is NOT
    for length in (1e-3, 1.0, 1e3):  # 0.01 N of the weight's 1.2 N, whatever a metre is
        assert verdict_of(length * J, 0 * Y, limits, rnea=rnea) is BORDERLINE
    assert verdict_of(J, 0 * Y, limits, rnea=[2.5, 0.0, 0.0]) is NOT


def test_without_a_force_limits_are_asked_for_the_weight_alone():
    assert verdict_of(J, None, [1e-3, 1e-3, 1e-3]) is TOLERATED
    assert verdict_of(J, None, [2.0, 9.0, 9.0], rnea=[1.9, 8.0, -8.0]) is TOLERATED
    assert verdict_of(J, None, FAR, locked=(2,)) is TOLERATED
    assert verdict_of(J, None, FAR, locked=(1, 2)) is NOT
    lean = np.array([[1.0, 1e-3, 0.0], [0.0, 0.0, 1.0]])
    assert verdict_of(lean, None, FAR, locked=(1,)) is BORDERLINE
    assert verdict_of(lean, None, FAR) is TOLERATED


def test_no_force_is_kept_where_the_arm_carries_itself():
    assert verdict_of(J, 0 * X, FAR, locked=(1, 2, 3)) is TOLERATED
    assert verdict_of(J, 0 * X, [2.0, np.nan, 9.0], rnea=[1.0, 7.0, 1.0]) is TOLERATED
    assert verdict_of(J, 0 * X, free=(2,)) is TOLERATED
    assert verdict_of(J, 0 * X, free=(2,), rnea=[0.0, 1.0, 0.0]) is NOT


# ---- joints without torque -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        (0.0, TOLERATED),
        (0.9e-6, TOLERATED),
        (1.1e-6, BORDERLINE),
        (1e-3, BORDERLINE),
        (0.99e-2, BORDERLINE),
        (1.01e-2, NOT),
        (1.0, NOT),
    ],
)
def test_a_free_joint_with_next_to_no_lever_is_borderline(column, expected):
    # It yields to any force along x that its lever feels.
    lean = np.diag([1.0, 1.0])[:, [0, 0, 1]] * [1.0, column, 1.0]
    lean /= np.linalg.norm(lean, 2)
    lean[0, 1] = column
    assert verdict_of(lean, X, free=(2,)) is expected
    assert verdict_of(lean, Y, free=(2,)) is TOLERATED
    assert verdict_of(lean, None, free=(2,)) is expected
    assert verdict_of(lean, X, FAR, free=(2,)) is expected


def test_the_weight_of_a_free_joint_with_next_to_no_lever():
    lean = np.array([[1.0, 1e-4, 0.0], [0.0, 0.0, 1.0]])
    # Up to t = 1e-4 it takes 10 N to balance 1e-3 N·m; with more, they count as balanced from
    # 1e-3 of the arm's weight on.
    assert verdict_of(lean, Y, free=(2,), rnea=[0.0, 1e-3, 1.0]) is BORDERLINE
    assert verdict_of(lean, Y, free=(2,), rnea=[0.0, 1.0, 0.0]) is NOT
    assert verdict_of(lean, Y, free=(2,), rnea=[1.0, 0.0, 0.0]) is TOLERATED


@pytest.mark.parametrize(
    ("left", "expected"),
    [(0.9e-6, TOLERATED), (1.1e-6, BORDERLINE), (1e-3, BORDERLINE), (0.1, NOT)],
)
def test_torque_that_no_force_balances(left, expected):
    flat = np.array([[1.0, 0.0, 1.0]])
    for F in ([5.0], None, [0.0]):
        assert verdict_of(flat, F, free=(2,), rnea=[1.0, left, 0.0]) is expected


def test_a_free_joint_beside_a_locked_one():
    assert verdict_of(J, X - Y, free=(2,)) is TOLERATED
    assert verdict_of(J, X - Y, free=(2,), locked=(1,)) is TOLERATED  # joint 3 is left
    assert verdict_of(J, X - Y, free=(2,), locked=(1, 3)) is NOT
    assert verdict_of(J, X, free=(2,)) is NOT


@pytest.mark.parametrize(
    ("weak", "angle", "column"), [((0.006, 0.004), 1.4, 0.0017), ((0.004, 0.006), 0.1, 0.001)]
)
def test_a_rank_that_changes_when_a_swinging_column_no_longer_counts(weak, angle, column):
    # The force is what the free joint does not feel, and large along the strong direction. From
    # t = column on joint 3 counts as zero, and K has other weak directions than before.
    c, s = math.cos(angle), math.sin(angle)
    arm = np.array(
        [[0.0, weak[0], column * c, 0.0], [0.0, 0.0, column * s, weak[1]], [1.0, 0.0, 0.0, 0.0]]
    )
    F = np.array([-s, c, 30.0])
    assert by_trying(arm, F, free=(3,)) is BORDERLINE
    assert verdict_of(arm, F, free=(3,)) is BORDERLINE


# ---- all tolerances --------------------------------------------------------------------------


def by_trying(J, F, limits=None, *, locked=(), free=(), rnea=None, wary=BORDERLINE_RTOL):
    """Judge by trying tolerances, among them those at which a rank changes."""
    n = J.shape[1]
    S, L = (np.isin(np.arange(1, n + 1), joints) for joints in (free, locked))
    largest = None if limits is None else np.where(S, 0.0, np.array(limits, dtype=float))
    rnea = np.zeros(n) if rnea is None else rnea
    scale = np.linalg.norm(J, 2)
    U, s, _ = np.linalg.svd(J[:, S])
    changes = list(s)
    for rank in range(len(s) + 1):
        left = U[:, rank:] @ U[:, rank:].T @ np.where(L | (S if rank else False), 0.0, J)
        changes += list(np.linalg.svd(left, compute_uv=False))
    tried = [RTOL, wary, *np.geomspace(RTOL, wary, 13)]
    tried += [factor * x / scale for x in changes for factor in (1.0 - 1e-9, 1.0 + 1e-9)]
    answers = set()
    healthy = reduce(J, np.zeros(n, bool))
    for t in tried:
        if not RTOL <= t <= wary:
            continue
        reduced = reduce(J, L, t, S if S.any() else None)
        feasible = feasible_forces(reduced, rnea, largest)
        asked = np.zeros(len(J)) if F is None else F
        after = nearest_force(feasible, asked).F_after
        kept = after is not None
        if kept and asked.any():
            kept = np.linalg.norm(asked - after) <= t * np.linalg.norm(asked)
        elif kept and after.any():
            kept = np.linalg.norm(after) * scale <= t * np.linalg.norm(rnea)
        if F is None and reduced.rank_after < healthy.rank:
            kept = False
        answers.add(bool(kept))
    return BORDERLINE if len(answers) == 2 else TOLERATED if answers == {True} else NOT


def draw_lean_arm(rng):
    """Draw a Jacobian with singular values and columns around the tolerances, and its faults."""
    m = int(rng.integers(1, 5))
    n = int(rng.integers(m, 8))
    J = rng.normal(size=(m, n))
    ratios = np.sort(rng.choice(RATIOS, size=m))[::-1]
    if rng.random() < 0.5:
        J = with_singular_values(rng, m, n, np.array([1.0, *ratios[1:]]))
    state = rng.choice(3, size=n, p=[0.6, 0.2, 0.2])
    free = np.flatnonzero(state == 2)
    J[:, free] *= 10.0 ** rng.uniform(-7.0, 0.0, size=len(free)) if rng.random() < 0.7 else 1.0
    return J, np.flatnonzero(state == 1) + 1, free + 1


@pytest.mark.no_cover
@pytest.mark.thorough
def test_verdicts_beside_trying_tolerances():
    rng = np.random.default_rng(3)
    found, count = Counter(), campaign(1500, 200)
    for _ in range(count):
        J, locked, free = draw_lean_arm(rng)
        n = J.shape[1]
        rnea = rng.choice([0.0, 0.0, 1.0]) * rng.normal(size=n)
        if len(free) and rng.random() < 0.7:
            rnea[free - 1] *= rng.choice([0.0, 1e-8, 1e-4])
        limits = rng.choice([None, 1e9, 3.0])
        if limits is not None:
            limits = np.full(n, limits)
            limits[np.linalg.norm(J, axis=0) < 0.1] = np.nan  # a lever near t is another question
        F = None
        if rng.random() < 0.8:
            F = J @ rng.normal(size=n) * 10.0 ** rng.uniform(-2.0, 1.0)
        faults = {"locked": locked, "free": free, "rnea": rnea}
        one, other = verdict_of(J, F, limits, **faults), by_trying(J, F, limits, **faults)
        found[other] += 1
        assert one is other
    assert min(found.values()) > count / 15, found


def test_a_direction_is_lost_at_its_own_tolerance_however_the_quotient_is_rounded():
    rng = np.random.default_rng(0)
    rounded_down = 0
    for _ in range(campaign(2000, 150)):
        small, large = 10.0 ** rng.uniform(-5.5, -2.5), rng.uniform(0.5, 2.0)
        Q = orthogonal(rng, 2)
        arm = Q @ np.diag([large, small]) @ orthogonal(rng, 2)
        reduced = reduce(arm, np.zeros(2, bool))
        scale, weak = reduced.damaged.s
        t = tolerance_that_loses(weak, scale)
        assert weak <= t * scale
        assert weak > math.nextafter(t, 0.0) * scale * (1.0 - 1e-15)
        rounded_down += weak / scale * scale < weak
        F = Q.sum(axis=1)
        assert verdict(reduced, F, BORDERLINE_RTOL) is BORDERLINE
        assert verdict(reduced, None, BORDERLINE_RTOL) is BORDERLINE
        assert verdict_of(arm, F, [1e9, 1e9]) is BORDERLINE
        assert verdict_of(arm, None, [1e9, 1e9]) is BORDERLINE
    assert rounded_down > campaign(20)  # the others would do without


@given(seeds)
@law
def test_without_limits_and_free_joints_both_verdicts_are_one(seed):
    rng = np.random.default_rng(seed)
    J, locked, _ = draw_lean_arm(rng)
    n = J.shape[1]
    F = J @ rng.normal(size=n)
    for force in (F, None):
        plain = verdict_of(J, force, locked=locked)
        assert verdict_of(J, force, np.full(n, np.nan), locked=locked) is plain
        assert verdict_of(J, force, np.full(n, 1e12), locked=locked) is plain


@given(seeds)
@law
def test_one_tolerance_is_never_borderline(seed):
    rng = np.random.default_rng(seed)
    problem = draw_problem(rng)
    faults = {
        "locked": np.flatnonzero(problem.locked) + 1,
        "free": np.flatnonzero(problem.free) + 1,
        "rnea": problem.rnea,
    }
    F = problem.J @ rng.normal(size=len(problem.tau))
    for t in (1e-6, 1e-3):
        case = {"rtol": t, "wary": t, **faults}
        assert verdict_of(problem.J, F, problem.limits, **case) is not BORDERLINE


@pytest.mark.parametrize("unit", [1e-200, 1e-160, 1e-100, 1e100, 1e150])
def test_the_unit_of_force_does_not_matter(unit):
    limits = np.array([0.5, np.nan, 9.0])
    for F, expected in ((X, NOT), (0.5 * X, TOLERATED), (0.501 * X, BORDERLINE), (Y, TOLERATED)):
        assert verdict_of(J, unit * F, unit * limits) is expected
    assert verdict_of(J, unit * X, free=(2,)) is NOT
    assert verdict_of(J, unit * (X - Y), free=(2,)) is TOLERATED
    assert verdict_of(J, unit * X, locked=(1, 2), limits=FAR) is NOT
    assert verdict_of(J, 0 * X, free=(2,), rnea=[0.0, unit, 0.0]) is NOT
