"""The kernels of the sweep against `ftforce.analyze` and `ftforce.census`, posture by posture."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

import urdfs
from ftforce import analyze, census, load_robot
from ftforce.analysis.friction import choose_friction
from ftforce.batch.kernels import fast, lanes, secular, spectrum
from ftforce.batch.kernels import three as eigenvalues
from ftforce.batch.kernels.layout import LANES, NOT_TOLERATED, UNDECIDED
from ftforce.batch.kernels.three import MIN_MARGIN
from ftforce.batch.plan import Plan, empty_answers, faults_of, mechanism_of, question_of
from ftforce.core.faults import Fault, FaultMode, FaultSet, fault_sets
from ftforce.core.limits import Limits
from ftforce.core.task import Task
from ftforce.errors import InputError
from ftforce.robot.dynamics import Payload, weight_torque
from ftforce.robot.kinematics import task_jacobian, tip_pose
from helpers import KNOWN, campaign
from results import OTHER_ARMS, answers_of

pytestmark = [pytest.mark.thorough, pytest.mark.no_cover]

WORDS = ("tolerated", "borderline", "not tolerated")
TASKS = (("force", None), ("wrench", 0.3), ("fx,fz", None), ("my", None), ("fz,mx,fx", 0.5))
RTOL, BORDERLINE_RTOL = 1e-6, 1e-2
LOCKED, FREE = FaultMode.LOCKED, FaultMode.FREE


def postures_of(robot, k, seed=0):
    """Return random postures; the first is all zero, the second repeats one number: singular."""
    rng = np.random.default_rng(seed)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
    q = lower + rng.random((k, robot.n)) * (upper - lower)
    q[0] = 0.0
    if k > 1:
        q[1] = math.pi / 2
    return q


def check_set(block, s, at, report):
    """Compare one posture and one fault set with an analysis.

    The fast part may be wrong by 3e-8, which is what K Kᵀ leaves of σ_min at MIN_MARGIN.
    """
    assert WORDS[block.verdict[s, at]] == report.verdict.value
    assert block.rank_lost[s, at] == report.rank_lost
    scale = max(report.margin, 1e-6)
    assert abs(block.margin[s, at] - report.margin) <= 3e-8 * scale
    if report.margin > 0.0:
        size = report.sigma_min_after / report.margin
        assert abs(block.sigma_min[s, at] - report.sigma_min_after) <= 3e-8 * scale * size
    rho = report.relative_manipulability
    np.testing.assert_allclose(block.rho[s, at], rho, rtol=5e-8, atol=1e-9, equal_nan=True)


def check_census(robot, q, task, *, faults=1, mode="locked", force=None, **options):
    """Compare all fault sets of postures with the census of each."""
    sets = list(fault_sets(robot.n, faults, FaultMode.parse(mode)))
    direction, limits = options.get("direction"), options.get("limits")
    kernel = {k: v for k, v in options.items() if k in ("gravity", "payload")}
    if direction is not None:
        friction = choose_friction(robot, None, None).torque  # the census applies no limits
        kernel |= {"direction": direction, "limits": limits, "friction": friction}
    block = answers_of(robot, q, sets, task, force=force, **kernel)
    more = {k: options[k] for k in ("gravity", "payload") if k in options}
    for at, one in enumerate(q):
        try:
            found = census(robot, one, faults=faults, mode=mode, force=force, task=task, **more)
        except InputError as problem:
            found, said = None, str(problem)
        if found is None:
            assert "even the healthy arm cannot exert" in said
            assert (block.verdict[:, at] == NOT_TOLERATED).all()
            continue
        reports = {str(r.faults): r for r in found.sets}
        for s, faulty in enumerate(sets):
            report = reports[str(faulty)]
            check_set(block, s, at, report)
            if force is not None:
                size = float(np.linalg.norm(force))
                check_jump(block, s, at, report, task=task, size=size)
    return block, sets


def check_jump(block, s, at, report, *, task, size):
    """Compare the jumps, which are NaN where the arm cannot stand still."""
    absent = math.nan
    wanted = report.jump_norm if task.force_rows else report.moment_jump_norm
    close = {"rtol": 1e-7, "atol": 1e-9 * size, "equal_nan": True}
    np.testing.assert_allclose(block.jump[s, at], absent if wanted is None else wanted, **close)
    if block.moment_jump is not None:
        wanted = report.moment_jump_norm
        got = block.moment_jump[s, at]
        np.testing.assert_allclose(got, absent if wanted is None else wanted, **close)
    np.testing.assert_allclose(
        block.relative_jump[s, at], report.relative_jump, rtol=1e-7, atol=1e-9
    )


@pytest.fixture(scope="module")
def robots():
    return {name: load_robot(name) for name in KNOWN}


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize(("words", "length"), TASKS)
def test_locked_faults_equal_the_census(robots, name, words, length):
    axes = "world" if KNOWN.index(name) % 2 else "tool"
    task = Task.parse(words, axes, length)
    force = np.arange(1.0, task.m + 1.0) * 10.0
    check_census(robots[name], postures_of(robots[name], campaign(6, 3)), task, force=force)


@pytest.mark.parametrize("axes", ["tool", "world"])
@pytest.mark.parametrize("words", ["force", "wrench", "moment", "fz,fx"])
def test_pairs_of_locked_joints_without_a_force(robots, words, axes):
    task = Task.parse(words, axes)
    check_census(robots["panda"], postures_of(robots["panda"], 6, 1), task, faults=2)


# Enough postures that some lie near every tolerance.
@pytest.mark.parametrize("asks", [True, False])
@pytest.mark.parametrize(
    ("name", "faults", "mode"),
    [
        *itertools.product(("ur5", "panda"), (1, 2), ("locked",)),
        *itertools.product(("ur5", "panda"), (1,), ("free",)),
    ],
)
def test_wrenches_equal_the_census(robots, name, faults, mode, asks):
    task, robot = Task.parse("wrench", "tool", 0.3), robots[name]
    force = np.array([10.0, -20.0, 30.0, 3.0, 2.0, -1.0]) if asks else None
    q = postures_of(robot, campaign(40, 12), 11)
    check_census(robot, q, task, faults=faults, mode=mode, force=force)


@pytest.mark.parametrize("components", ["fx,fz", "fx,fy,fz,my,mz"])
def test_pairs_of_locked_joints_of_other_tasks(robots, components):
    task = Task.parse(components, "world", 0.4)
    force = np.linspace(5.0, -9.0, task.m)
    check_census(robots["panda"], postures_of(robots["panda"], 8, 12), task, faults=2, force=force)


@pytest.mark.parametrize("words", ["force", "wrench"])
def test_pairs_of_free_joints(robots, words):
    task, robot = Task.parse(words, "tool", 0.3), robots["panda"]
    force = np.linspace(5.0, -9.0, task.m)
    check_census(robot, postures_of(robot, 5, 13), task, faults=2, mode="free", force=force)


@pytest.mark.parametrize(
    "case",
    [
        ("panda", "force", 1, "locked", 0.001),
        ("panda", "force", 2, "locked", 0.002),
        ("panda", "wrench", 1, "locked", 0.01),
        ("panda", "wrench", 2, "locked", 0.02),
        ("ur5", "wrench", 1, "locked", 0.02),
        ("ur5", "wrench", 2, "locked", 0.02),
        ("panda", "force", 1, "free", 0.01),
        ("ur5", "wrench", 1, "free", 0.02),
    ],
)
def test_the_fast_part_answers_nearly_all(robots, case):
    name, words, faults, mode, share = case
    robot, task = robots[name], Task.parse(words, "tool", 0.3)
    sets = tuple(fault_sets(robot.n, faults, FaultMode.parse(mode)))
    asked = {"force": np.ones(task.m), "direction": None, "limits": None}
    question = question_of(
        task, robot.n, **asked, rtol=RTOL, wary=BORDERLINE_RTOL, needs_gravity=True
    )
    plan = Plan(mechanism_of(robot), faults_of(sets, robot.n), question, robot.n, False)
    q = postures_of(robot, 2000, 14)
    answers = empty_answers(plan, len(q))
    work = fast.workspace(plan.mechanism.parent.size, robot.n, task.m)
    fast.evaluate(plan.mechanism, plan.faults, question, q, answers, work)
    assert np.mean(answers.verdict == UNDECIDED) < share


@pytest.mark.parametrize("bound", [RTOL, BORDERLINE_RTOL])
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_a_force_whose_jump_is_near_a_tolerance(robots, mode, bound):
    robot, task, k = robots["ur5"], Task.parse("wrench", "world"), 2
    q = postures_of(robot, 9, 15)[3:]
    for one in q:
        J = task_jacobian(robot, one, task)
        K = np.delete(J, k, 1)
        lost = J[:, k] if mode == "free" else np.linalg.svd(K)[0][:, -1]
        lost, along = lost / np.linalg.norm(lost), np.linalg.svd(J)[0][:, 0]
        along -= lost * (lost @ along)
        along /= np.linalg.norm(along)
        for shift in (-1e-3, -1e-7, 1e-7, 1e-3):
            jump = bound * (1.0 + shift)
            force = 50.0 * (math.sqrt(1.0 - jump**2) * along + jump * lost)
            faulty = FaultSet((Fault(k, FaultMode.parse(mode)),))
            # without weight, which a free joint would ask the force to carry
            ideal = {"gravity": np.zeros(3), "friction": 0.0}
            block = answers_of(robot, one[None], [faulty], task, force=force, **ideal)
            report = analyze(robot, one, force=force, task=task, **ideal, **{mode: [k + 1]})
            assert WORDS[block.verdict[0, 0]] == report.verdict.value
            assert abs(block.relative_jump[0, 0] / jump - 1.0) < 1e-7


@pytest.mark.parametrize("axes", ["tool", "world"])
@pytest.mark.parametrize("name", ["panda", "dh5", "tiago", "so101"])
def test_free_faults_with_weight_equal_the_census(robots, name, axes):
    robot, task = robots[name], Task.parse("force", axes)
    force = np.array([3.0, -20.0, 10.0])
    payload = Payload.of(1.5, (0.1, 0.02, -0.05))
    gravity = np.array([1.0, 2.0, -9.0])
    for given_force in (force, None):
        options = {"force": given_force, "gravity": gravity, "payload": payload}
        check_census(robot, postures_of(robot, 5, 2), task, mode="free", **options)


@pytest.mark.parametrize("axes", ["tool", "world"])
@pytest.mark.parametrize("name", ["panda", "dh5", "ur5", "pr2_left"])
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_capability_equals_the_census(robots, name, axes, mode):
    robot, task = robots[name], Task.parse("force", axes)
    effort, brake = np.linspace(60.0, 20.0, robot.n), np.linspace(80.0, 10.0, robot.n)
    effort[1], brake[2] = math.nan, math.nan
    limits, d = Limits.of(effort, brake), np.array([0.6, 0.0, -0.8])
    q, sets = postures_of(robot, 6, 3), list(fault_sets(robot.n, 1, FaultMode.parse(mode)))
    block = answers_of(robot, q, sets, task, direction=d, limits=limits)
    seen = set()
    for at, one in enumerate(q):
        found = census(
            robot, one, mode=mode, task=task, direction=d, limits=limits, rank_by="capability"
        )
        reports = {str(r.faults): r.capability for r in found.sets}
        for s, faulty in enumerate(sets):
            wanted = reports[str(faulty)].commanded
            seen.add("nan" if math.isnan(wanted) else "zero" if wanted == 0.0 else "some")
            np.testing.assert_allclose(block.capability[s, at], wanted, rtol=1e-8, equal_nan=True)
    assert "some" in seen


@pytest.mark.parametrize("k", [1, LANES - 1, LANES, LANES + 1])
def test_the_number_of_postures_changes_no_answer(robots, k):
    robot, task = robots["panda"], Task.parse("wrench", length=0.3)
    sets, force = list(fault_sets(7, 1)), np.arange(1.0, 7.0)
    q = postures_of(robot, k, 4)
    whole = answers_of(robot, q, sets, task, force=force)
    for at in {0, k // 2, k - 1}:
        one = answers_of(robot, q[at : at + 1], sets, task, force=force)
        for name in ("verdict", "rank_lost", "margin", "rho", "jump", "moment_jump"):
            got, wanted = getattr(whole, name)[:, at], getattr(one, name)[:, 0]
            np.testing.assert_array_equal(got, wanted, err_msg=name)
        np.testing.assert_array_equal(whole.tip[at], one.tip[0])


def postures_near(robot, task, faulty, margins):
    """Return postures of given margins near one in which the square K loses a direction.

    The determinant of K changes its sign between two random postures; so it is 0 in between, and
    the margin grows from there.
    """
    locked = faulty.mask(robot.n)
    rng = np.random.default_rng(5)
    span = robot.upper - robot.lower
    pairs = (robot.lower + rng.random((2, robot.n)) * span for _ in range(1000))

    def K(q):
        return task_jacobian(robot, q, task)[:, ~locked]

    start, end = next(x for x in pairs if np.linalg.det(K(x[0])) * np.linalg.det(K(x[1])) < 0.0)
    sign = np.linalg.det(K(start))

    def margin(q):
        J = task_jacobian(robot, q, task)
        return np.linalg.svd(K(q), compute_uv=False)[-1] / np.linalg.norm(J, 2)

    def between(is_before, low, high):
        for _ in range(100):
            middle = 0.5 * (low + high)
            is_low = is_before((1.0 - middle) * start + middle * end)
            low, high = (middle, high) if is_low else (low, middle)
        return high

    lost = between(lambda q: np.linalg.det(K(q)) * sign > 0.0, 0.0, 1.0)
    ways = [between(lambda q, x=x: margin(q) > x, 0.0, lost) for x in margins]
    return np.array([(1.0 - t) * start + t * end for t in ways])


@pytest.mark.parametrize("words", ["force", "wrench"])
@pytest.mark.parametrize("bound", [RTOL, MIN_MARGIN, BORDERLINE_RTOL])
def test_postures_near_a_tolerance(robots, words, bound):
    robot, task = robots["panda"], Task.parse(words)
    faulty = FaultSet.locked([3] if words == "wrench" else [0, 2, 4, 6])
    exponents = (2, 3, 4, 5) if bound == RTOL else (3, 5, 7, 9)
    shifts = [s * 10.0**-e for e in exponents for s in (-1.0, 1.0)]
    margins = [bound * (1.0 + x) for x in shifts]
    q = postures_near(robot, task, faulty, margins)
    block = answers_of(robot, q, [faulty], task)
    for at, one in enumerate(q):
        report = analyze(robot, one, locked=faulty.mask(robot.n), task=task)
        assert abs(report.margin / margins[at] - 1.0) <= 0.5 * abs(shifts[at])
        assert WORDS[block.verdict[0, at]] == report.verdict.value
        assert abs(block.margin[0, at] / report.margin - 1.0) < 3e-8
        assert block.rank_lost[0, at] == len(report.lost_directions)


@pytest.mark.parametrize("turn", [0.0, 1.0 - 1e-4, 1.0, 1.0 + 1e-4])
def test_a_force_whose_share_along_the_lost_direction_is_near_the_margin(robots, turn):
    robot, task = robots["panda"], Task.parse("force")
    faulty = FaultSet.locked([0, 2, 4, 6])
    for margin in (3e-3, 1e-4):
        q = postures_near(robot, task, faulty, [margin])
        K = task_jacobian(robot, q[0], task)
        K[:, faulty.mask(7)] = 0.0
        U = np.linalg.svd(K)[0]
        force = U[:, 0] + turn * margin * U[:, 2]
        got = answers_of(robot, q, [faulty], task, force=force).verdict[0, 0]
        wanted = analyze(robot, q[0], locked=faulty.mask(7), force=force, task=task).verdict
        assert WORDS[got] == wanted.value


@given(
    faulty=st.lists(st.sampled_from(["sound", "locked", "free"]), min_size=7, max_size=7),
    seed=st.integers(0, 1000),
    asks=st.booleans(),
)
@settings(max_examples=campaign(60, 20), deadline=None)
def test_random_faults_of_both_modes(faulty, seed, asks):
    robot, task = load_robot("panda"), Task.parse("force")
    faults = [Fault(j, FaultMode.parse(mode)) for j, mode in enumerate(faulty) if mode != "sound"]
    one = FaultSet(tuple(faults))
    force = np.array([5.0, -7.0, 3.0]) if asks else None
    q = postures_of(robot, 3, seed)[2:]
    block = answers_of(robot, q, [one], task, force=force)
    failed = {str(mode): [j + 1 for j in one.in_mode(mode)] for mode in (LOCKED, FREE)}
    report = analyze(robot, q[0], **failed, force=force, task=task)
    assert WORDS[block.verdict[0, 0]] == report.verdict.value
    assert block.rank_lost[0, 0] == report.reduced.rank - report.reduced.rank_after
    assert abs(block.margin[0, 0] - report.margin) <= 3e-8 * max(report.margin, 1e-6)
    assert abs(block.rho[0, 0] - report.relative_manipulability) <= 5e-8


@njit
def place(mechanism, question, q, work):
    lanes.place_frames(mechanism, q, work.chosen, work)
    lanes.task_jacobian(mechanism, question, work)
    lanes.weight_torque(mechanism, work)


def placed(robot, q, task, payload=None, gravity=None):
    """Return the workspace after kinematics and weight of up to LANES postures."""
    mechanism = mechanism_of(robot, payload=payload, gravity=gravity)
    asked = dict.fromkeys(("force", "direction", "limits"))
    question = question_of(
        task, robot.n, **asked, rtol=RTOL, wary=BORDERLINE_RTOL, needs_gravity=True
    )
    work = lanes.workspace(mechanism.parent.size, robot.n, task.m)
    work.chosen[:] = np.minimum(np.arange(LANES), len(q) - 1)
    place(mechanism, question, q, work)
    return work


def check_kinematics(robot, q, axes="tool"):
    """Compare tip, Jacobian and weight with Pinocchio's."""
    task = Task.parse("fx,fz,my,mz", axes, 0.4)
    payload, gravity = Payload.of(2.0, (0.1, -0.2, 0.3)), np.array([0.5, 1.0, -9.0])
    work = placed(robot, q, task, payload, gravity)
    for b, one in enumerate(q):
        R, p = tip_pose(robot, one)
        np.testing.assert_allclose(work.tip[:9, b], R.ravel(), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(work.tip[9:, b], p, rtol=0.0, atol=1e-12)
        J = task.weigh_jacobian(task_jacobian(robot, one, task))
        np.testing.assert_allclose(work.J[:, :, b], J, rtol=0.0, atol=1e-12)
        weight = weight_torque(robot, one, gravity, payload)
        np.testing.assert_allclose(work.weight[:, b], weight, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("axes", ["tool", "world"])
@pytest.mark.parametrize("name", KNOWN)
def test_kinematics_and_weight_of_known_robots(robots, name, axes):
    check_kinematics(robots[name], postures_of(robots[name], 5, 6), axes)


@pytest.mark.parametrize("kind", OTHER_ARMS)
def test_kinematics_and_weight_of_other_joints(tmp_path, kind):
    robot = urdfs.load(tmp_path, OTHER_ARMS[kind])
    check_kinematics(robot, postures_of(robot, 5, 7))


@pytest.mark.parametrize("kind", OTHER_ARMS)
def test_other_joints_equal_the_census(tmp_path, kind):
    robot = urdfs.load(tmp_path, OTHER_ARMS[kind])
    task = Task.parse("fx,fz")
    check_census(robot, postures_of(robot, 5, 8), task, force=np.array([4.0, 3.0]))


@njit
def sincos(angle, cosine, sine):
    lanes.sincos(angle, cosine, sine)


@pytest.mark.parametrize("size", [1e-9, 0.7, 3.2, 40.0, 9e4, 1e7, 1e15])
def test_cosine_and_sine_of_large_angles(size):
    angle = np.linspace(-size, size, LANES)
    cosine, sine = np.empty(LANES), np.empty(LANES)
    sincos(angle, cosine, sine)
    np.testing.assert_allclose(cosine, np.cos(angle), rtol=0.0, atol=3e-16)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=0.0, atol=3e-16)


@njit
def decompose(J, force, roots, svd):
    spectrum.decompose(J, svd)
    secular.prepare(J, svd, force, True, roots)
    for k in range(J.shape[1]):
        secular.find_root(k, svd.square, svd.square[0], secular.MIN_MARGIN**2, roots)


def graded(m, n):
    """Return matrices whose singular values lie from 1 to 1e-4, with zeros in some."""
    rng = np.random.default_rng(16)
    U, _, Vt = np.linalg.svd(rng.normal(size=(LANES, m, n)))
    s = 10.0 ** rng.uniform(-4.0, 0.0, (LANES, m, 1))
    J = U @ (s * Vt[:, :m])
    J[0] = 0.0
    J[1, -1] = J[1, 0]
    J[2, :, 0] = 0.0
    J[3, 0] = 0.0
    return J, np.ascontiguousarray(J.transpose(1, 2, 0))


@pytest.mark.parametrize(("m", "n"), [(1, 4), (2, 5), (3, 7), (5, 5), (6, 7), (6, 4)])
def test_singular_values_side_by_side(m, n):
    J, stacked = graded(m, max(m, n))
    J[:, :, n:] = 0.0
    stacked = np.ascontiguousarray(stacked[:, :n])
    J = J[:, :, :n]
    svd = spectrum.workspace(m, n)
    decompose(stacked, np.ones((m, LANES)), secular.workspace(m, n), svd)
    s = np.linalg.svd(J, compute_uv=False)
    found = svd.sigma.T
    np.testing.assert_allclose(found[:, : s.shape[1]], s, rtol=1e-10, atol=1e-15)
    assert not svd.fails.any()
    for b in range(LANES):  # J Jᵀ = U diag(σ²) Uᵀ
        W = svd.W[:, :, b]
        np.testing.assert_allclose((W.T * found[b] ** 2) @ W, J[b] @ J[b].T, atol=1e-14)


@pytest.mark.parametrize(("m", "n"), [(2, 5), (3, 7), (6, 7), (6, 8)])
def test_singular_values_of_rows_that_are_nearly_all_orthogonal(m, n):
    """Sorting moves rows within a sweep, so that a pair may not meet in it (Tiago at zero)."""
    rng = np.random.default_rng(m)
    few = rng.random((8 * LANES, m, n)) < 0.25
    J = np.where(few, rng.normal(size=few.shape), 1e-13 * rng.normal(size=few.shape))
    J *= 10.0 ** rng.uniform(-3.0, 0.0, (8 * LANES, m, 1))
    for lanes_of_J in J.reshape(8, LANES, m, n):
        svd, roots = spectrum.workspace(m, n), secular.workspace(m, n)
        stacked = np.ascontiguousarray(lanes_of_J.transpose(1, 2, 0))
        decompose(stacked, np.ones((m, LANES)), roots, svd)
        s = np.linalg.svd(lanes_of_J, compute_uv=False)
        np.testing.assert_allclose(svd.sigma.T, s, rtol=1e-10, atol=1e-14)
        assert not svd.fails.any()


@pytest.mark.parametrize(("m", "n"), [(2, 5), (4, 7), (6, 7), (6, 8)])
def test_roots_of_the_secular_equation(m, n):
    J, stacked = graded(m, n)
    svd, roots = spectrum.workspace(m, n), secular.workspace(m, n)
    decompose(stacked, np.ones((m, LANES)), roots, svd)
    known = 0
    for b in range(LANES):
        for k in range(n):
            s = np.linalg.svd(np.delete(J[b], k, 1), compute_uv=False)
            if s[-1] > 1e-4 * svd.sigma[0, b] and svd.sigma[-1, b] > 0.0:
                assert abs(roots.x[k, b] / s[-1] ** 2 - 1.0) < 1e-8
                rho = np.prod(s) / np.prod(svd.sigma[:, b])
                assert abs(roots.N_kk[k, b] / rho**2 - 1.0) < 1e-8
                known += 1
    assert known > LANES


@njit
def three(A, side, x, determinant):
    eigenvalues.extreme_eigenvalues(A, side, x, determinant)


def test_eigenvalues_of_three_rows():
    rng = np.random.default_rng(9)
    K = rng.normal(size=(LANES, 3, 5)) * np.array([1.0, 0.3, 3e-3])[:, None]
    A = K @ K.transpose(0, 2, 1)
    wanted = np.linalg.svd(K, compute_uv=False) ** 2
    x, determinant = np.empty(LANES), np.empty(LANES)
    stacked = np.ascontiguousarray(A.transpose(1, 2, 0))
    three(stacked, -1.0, x, determinant)
    np.testing.assert_allclose(x, wanted[:, 2], rtol=1e-9)
    np.testing.assert_allclose(determinant, wanted.prod(axis=1), rtol=1e-9)
    three(stacked, 1.0, x, determinant)
    np.testing.assert_allclose(x, wanted[:, 0], rtol=1e-13)


def test_jumps_near_a_singular_posture_of_the_healthy_arm(robots):
    """The error of six-row jumps is of the order that the documentation of sweeps gives."""
    robot, task, force = robots["ur5"], Task.parse("wrench", "tool", 0.3), [20, -10, 30, 2, 1, -3]
    sets = list(fault_sets(robot.n, 1, FaultMode.LOCKED))
    q = np.tile([0.3, -1.0, 0.9, 0.4, 0.0, 0.2], (7, 1))
    q[:, 4] = 10.0 ** -np.arange(7.0)  # the wrist is singular at 0
    block = answers_of(robot, q, sets, task, force=np.array(force, dtype=float))
    assert block.healthy_margin.min() < 1e-6
    assert block.healthy_margin.max() > 1e-2
    for at, one in enumerate(q):
        reports = {str(r.faults): r for r in census(robot, one, task=task, force=force).sets}
        bound = 1e-15 / block.healthy_margin[at] ** 2
        for s, faults in enumerate(sets):
            error = abs(block.jump[s, at] - reports[str(faults)].jump_norm)
            assert error <= max(bound, 1e-9) * np.linalg.norm(force)
