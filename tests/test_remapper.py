"""`ftforce.Remapper` says what `ftforce.analyze` says, without allocating, and refuses the rest.

With ``NUMBA_DISABLE_JIT=1`` fewer postures are tried, and coverage sees the kernel's lines.
"""

from __future__ import annotations

import copy
import gc
import math
import pickle
import sys
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import config, njit
from numba.core.runtime import _nrt_python, rtsys

import urdfs
from ftforce import analyze, load_robot
from ftforce.batch.kernels import single
from ftforce.batch.remapper import Remapper
from ftforce.core.faults import Fault, FaultMode, FaultSet, fault_sets
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.task import Task
from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.errors import DimensionError, FtforceError, InputError, UnknownNameError
from ftforce.robot.dynamics import Payload
from ftforce.robot.kinematics import task_jacobian
from helpers import (
    KNOWN,
    arms,
    assert_close,
    campaign,
    load_text,
    serial_urdf,
    stretched,
    without_masses,
)
from results import OTHER_ARMS

IS_PLAIN = bool(config.DISABLE_JIT)
pytestmark = [pytest.mark.plain, pytest.mark.thorough]
if not IS_PLAIN:
    pytestmark.append(pytest.mark.no_cover)  # what is watched is the plain run

ARMS = ("panda", "dh5") if IS_PLAIN else KNOWN
TASKS = dict.fromkeys(("fz", "my", "fx,fz", "force"), 1.0)
TASKS |= {"fz,mx,fx,my": 0.4, "fx,fy,mz,my,mx": 0.3, "wrench": 0.2}
LOCKED, FREE = FaultMode.LOCKED, FaultMode.FREE


@pytest.fixture(autouse=True)
def _no_warnings_of_plain_python():
    with np.errstate(all="ignore"):  # compiled code does not warn
        yield


@pytest.fixture(scope="module")
def robots():
    return {name: load_robot(name) for name in ARMS}


def sets_of(robot):
    """Return the empty set, all single ones, some pairs and mixtures, and all joints."""
    n = robot.n
    mixed = FaultSet((Fault(0), Fault(n - 2, FREE)))
    pairs = [FaultSet.all_of(mode, [0, n - 2]) for mode in (LOCKED, FREE)]
    whole = [FaultSet.all_of(mode, range(n)) for mode in (LOCKED, FREE)]
    singles = [one for mode in (LOCKED, FREE) for one in fault_sets(n, 1, mode)]
    return [FaultSet(), *singles, *pairs, *whole, mixed]


def postures_of(robot, k, seed=0):
    """Return random postures; the first two are mostly singular."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.0, 2.0, (k, robot.n))
    q[0] = 0.0
    if k > 1:
        q[1] = math.pi / 2
    return q


def faults_in(one):
    return {str(mode): [j + 1 for j in one.in_mode(mode)] for mode in (LOCKED, FREE)}


def check(result, s, report, *, scale):
    """Compare one set with an analysis; ``scale``: of the forces, N, and of the torques, N·m."""
    F, tau = scale
    assert VERDICTS[result.verdict[s]] is report.verdict
    assert result.rank_lost[s] == report.reduced.rank - report.reduced.rank_after
    assert_close(result.margin[s], report.margin, scale=max(report.margin, 1e-4))
    sigma_min = report.reduced.damaged.s[-1]
    assert_close(result.sigma_min[s], sigma_min, scale=max(sigma_min, 1e-4))
    force, torque = report.force, report.torque
    assert_close(result.force_before, force.before, scale=F)
    assert_close(result.self_motion, torque.self_motion, scale=tau)
    if force.after is None:
        for array in (result.U, result.force_after, result.jump, result.jump_norm):
            assert array is None or np.isnan(array[s]).all()
        return
    assert_close(result.U[s], torque.after, scale=tau)
    assert_close(result.force_after[s], force.after, scale=F)
    assert_close(result.jump[s], force.jump, scale=F)
    for name in ("jump_norm", "moment_jump_norm"):
        got, wanted = getattr(result, name), getattr(force, name)
        assert (got is None) == (wanted is None)
        if got is not None:
            assert_close(got[s], wanted, scale=F)


def check_all(robot, sets, q, tau=None, force=None, **options):
    """Compare all sets of a posture with their analyses."""
    result = Remapper(robot, sets, **options)(q, tau, force=force)
    for s, one in enumerate(sets):
        try:
            report = analyze(robot, q, **faults_in(one), torque=tau, force=force, **options)
        except InputError as problem:
            report, said = None, str(problem)
        if report is None:
            assert "even the healthy arm cannot exert" in said
            assert result.verdicts[s] is Verdict.NOT_TOLERATED
            assert not result.force_before.any()
            continue
        check(result, s, report, scale=scale_of(report))
    return result


def scale_of(report):
    """Return of what size forces and torques are, with what swinging joints ask for.

    Close to a singular posture large forces cancel in small torques.
    """
    before = np.abs(report.force.before).max()
    after = 0.0 if report.force.after is None else np.abs(report.force.after).max()
    F, torque = max(before, after, 1e-9), report.torque
    torques = [torque.before, report.rnea.after, 0.0 if torque.after is None else torque.after]
    tau = max(*(np.abs(one).max() for one in torques), 1e-9)
    return F, max(tau, 1e-3 * report.reduced.sigma_max * F)


# ---- the same as analyze -----------------------------------------------------------------------


@pytest.mark.parametrize("words", TASKS)
@pytest.mark.parametrize("name", ARMS)
def test_torques_as_analyze_has_them(robots, name, words):
    robot, axes = robots[name], ("tool", "world")[len(words) % 2]
    options = {"task": words, "length": TASKS[words], "axes": axes}
    for i, q in enumerate(postures_of(robot, campaign(4, 3), seed=len(words))):
        tau = 20.0 * np.random.default_rng(i).normal(size=robot.n)
        check_all(robot, sets_of(robot), q, tau, **options)


@pytest.mark.parametrize("words", ["force", "wrench", "fz,mx,fx,my"])
@pytest.mark.parametrize("name", ARMS)
def test_forces_as_analyze_has_them(robots, name, words):
    robot, axes = robots[name], ("tool", "world")[len(name) % 2]
    options = {"task": words, "length": TASKS[words], "axes": axes}
    for i, q in enumerate(postures_of(robot, 3, seed=1)):
        F = 50.0 * np.random.default_rng(i).normal(size=Task.parse(words).m)
        check_all(robot, sets_of(robot), q, force=F, **options)


@pytest.mark.parametrize("name", ["panda", "dh5"])
def test_the_weight_of_free_joints(robots, name):
    robot = robots[name]
    options = {"payload": Payload.of(1.5, (0.1, 0.02, -0.05)), "gravity": [1.0, 2.0, -9.0]}
    for q in postures_of(robot, 4, seed=2):
        tau = 10.0 * np.random.default_rng(3).normal(size=robot.n)
        result = check_all(robot, sets_of(robot), q, tau, **options)
        still = check_all(robot, [FaultSet.all_of(FREE, [1])], q, tau, gravity=[0, 0, 0])
        assert not np.allclose(still.U[0], result.U[1 + robot.n + 1], atol=1e-3)


@pytest.mark.parametrize("kind", OTHER_ARMS)
def test_other_joints(tmp_path, kind):
    robot = urdfs.load(tmp_path, OTHER_ARMS[kind])
    for q in postures_of(robot, 3, seed=4):
        tau = np.linspace(9.0, -5.0, robot.n)
        check_all(robot, sets_of(robot), q, tau, task="fx,fz", axes="world", payload=0.7)


@given(case=arms(), seed=st.integers(0, 999), words=st.sampled_from(["force", "fx,fz", "wrench"]))
@settings(max_examples=5 if IS_PLAIN else campaign(60, 20), deadline=None)
def test_random_arms_near_singular_postures(case, seed, words):
    robot, q = case
    rng = np.random.default_rng(seed)
    tau = 10.0 * rng.normal(size=robot.n)
    options = {"task": words, "length": 0.5}
    sets = list(fault_sets(robot.n, 1))
    J = Task.parse(words, "tool", 0.5).weigh_jacobian(task_jacobian(robot, q, Task.parse(words)))
    ratios = [
        np.linalg.svd(np.delete(J, list(one.joints), axis=1), compute_uv=False)
        / max(np.linalg.norm(J, 2), 1e-300)
        for one in (FaultSet(), *sets)
    ]
    if np.linalg.norm(J, 2) < 1e-12:  # only rounding moves the tip along the task
        return
    # On a tolerance rounding decides, and below it nothing is computed with many digits.
    if any(
        np.any((x < 1e-4) & (x > 1e-13)) or np.any(abs(x / BORDERLINE_RTOL - 1) < 1e-6)
        for x in ratios
    ):
        return
    check_all(robot, sets, q, tau, **options)


def margin_at(arm, little, locked):
    _, q = stretched(little)
    return analyze(arm, q, locked=locked).margin


@pytest.mark.parametrize("bound", [RTOL, BORDERLINE_RTOL])
@pytest.mark.parametrize("shift", [-1e-3, -1e-5, 1e-5, 1e-3])
def test_near_a_tolerance(bound, shift):
    arm, _ = stretched(0.0)
    low, high = 1e-9, 0.3
    for _ in range(80):  # the margin grows with the angle
        middle = math.sqrt(low * high)
        is_above = margin_at(arm, middle, [4]) > bound * (1.0 + shift)
        low, high = (low, middle) if is_above else (middle, high)
    q = np.array(stretched(high)[1])
    for force in ([30.0, 0.0, 0.0], [0.0, 0.0, 30.0], [1.0, 2.0, 3.0]):
        result = Remapper(arm, [[4]])(q, force=np.array(force))
        report = analyze(arm, q, locked=[4], force=force)
        assert abs(report.margin / bound - 1.0 - shift) < 0.1 * abs(shift)
        assert VERDICTS[result.verdict[0]] is report.verdict
        assert result.rank_lost[0] == len(report.lost_directions)
        assert abs(result.margin[0] / report.margin - 1.0) < 1e-9


def test_tolerances_of_ones_own(robots):
    robot = robots["panda"]
    q, tau = robot.postures["default"], np.linspace(9.0, -5.0, 7)
    for rtol, wary in ((1e-14, 1e-14), (1e-3, 0.5), (0.2, 0.3)):
        check_all(robot, sets_of(robot), q, tau, rtol=rtol, wary=wary, task="wrench")


def test_torques_that_only_move_the_arm(robots):
    robot = robots["panda"]
    q = np.array(robot.postures["default"])
    J = task_jacobian(robot, q, Task.parse("force"))
    tau = np.linspace(9.0, -5.0, 7)
    tau -= J.T @ np.linalg.pinv(J.T) @ tau
    result = Remapper(robot, [[2], [2, 4], [1, 3, 5, 7]])(q, tau)
    assert not result.force_before.any()
    assert not result.verdict.any()
    np.testing.assert_array_equal(result.self_motion, tau)


def test_what_the_healthy_arm_cannot_exert_is_no_jump(tmp_path):
    robot = urdfs.load(tmp_path, urdfs.arm(), tip="l2")
    q, F = np.array([0.3, -0.4]), np.array([10.0, -20.0, 30.0])
    result = check_all(robot, [FaultSet(), FaultSet.locked([0])], q, force=F)
    assert np.linalg.norm(result.force_before) < 0.99 * np.linalg.norm(F)
    assert result.jump_norm[0] == 0.0


# ---- margins side by side ----------------------------------------------------------------------


@njit
def margins(A, line, margin):
    single.tridiagonalize(A, line)
    single.smallest(A, line, margin)


@pytest.mark.parametrize("m", range(1, 7))
def test_smallest_eigenvalues(m):
    rng = np.random.default_rng(m)
    worst = 0.0
    for case in range(3 if IS_PLAIN else campaign(200, 30)):
        wanted = np.sort(10.0 ** rng.uniform(-5, 0, (single.SET_LANES, m)))
        if case % 3 == 1:  # twice the same, or nearly
            gaps = np.resize([0.0, 1e-14, 1e-9, 1e-4], single.SET_LANES)
            wanted[:, 1:2] = wanted[:, :1] * (1.0 + gaps[:, None])
        Q = np.linalg.qr(rng.normal(size=(single.SET_LANES, m, m)))[0]
        if case % 3 == 2:
            Q[:] = np.eye(m)  # diagonal already
        A = np.einsum("bik,bk,bjk->ijb", Q, wanted, Q)
        x = np.empty(single.SET_LANES)
        margins(np.ascontiguousarray(A), np.zeros((single.LINES, single.SET_LANES)), x)
        assert case % 3 == 1 or not np.isnan(x).any()  # only equal roots may be given up
        error = np.abs(x - wanted.min(axis=1)) / wanted.max(axis=1)
        worst = max(worst, np.nanmax(error, initial=0.0))
    assert worst < 1e-13


@pytest.mark.parametrize("m", range(2, 7))
@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_no_eigenvalue_is_passed(m, scale):
    rng = np.random.default_rng(m)
    for case in range(3 if IS_PLAIN else campaign(300, 30)):  # K Kᵀ that lacks ranks
        K = rng.normal(size=(single.SET_LANES, m, m - 1 - case % (m - 1)))
        K *= scale ** rng.random((single.SET_LANES, m, 1))
        K *= rng.random((single.SET_LANES, m, 1)) > 0.2 * (case % 2)  # and has zeros
        A = np.einsum("bik,bjk->ijb", K, K)
        x = np.empty(single.SET_LANES)
        margins(np.ascontiguousarray(A), np.zeros((single.LINES, single.SET_LANES)), x)
        assert not (x > 1e-12 * np.abs(A).max(axis=(0, 1))).any()


# ---- no memory, no surprises -------------------------------------------------------------------


@pytest.mark.skipif(IS_PLAIN, reason="plain Python allocates numbers")
@pytest.mark.parametrize("faults", [1, [[2, 4], [1, 3, 5, 7]]])
def test_thousands_of_calls_allocate_nothing(robots, faults):
    robot = robots["panda"]
    q, tau = np.array(robot.postures["default"]), np.linspace(9.0, -5.0, 7)
    F = np.array([10.0, 5.0, -3.0])
    _nrt_python.memsys_enable_stats()
    for mode in ("locked", "free"):
        remapper = Remapper(robot, faults, mode=mode)

        def calls(k, remapper=remapper):
            for _ in range(k):
                remapper(q, tau)
                remapper(q, force=F)

        calls(10)
        gc.collect()
        before = rtsys.get_allocation_stats()
        tracemalloc.start()
        calls(10)
        tracemalloc.reset_peak()
        start, _ = tracemalloc.get_traced_memory()
        calls(campaign(10_000))
        end, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert rtsys.get_allocation_stats() == before
        assert end - start <= 64  # the counter of the loop
        assert peak - start < 1500  # and the arguments of one call


@pytest.mark.skipif(IS_PLAIN, reason="nothing is compiled")
def test_nothing_is_compiled_in_the_loop(robots):
    remapper = Remapper(robots["dh5"])
    remapper([0, 1, 0, 1, 0], np.arange(5))
    with pytest.raises(InputError):
        remapper(np.zeros((5, 1)), np.zeros(5))
    assert len(single.compiled(False, False).overloads) == 1


def test_the_result_is_overwritten_and_its_copy_is_not(robots):
    robot = robots["panda"]
    remapper = Remapper(robot, 1)
    assert np.isnan(remapper.result.U).all()
    first = remapper(np.zeros(7), np.arange(7.0))
    kept = first.copy()
    second = remapper(np.array(robot.postures["default"]), np.ones(7))
    assert first is second is remapper.result
    assert np.abs(kept.U - second.U).max() > 1.0
    assert kept.jump_norm is not None
    assert kept.moment_jump_norm is None
    for result in (kept, second):
        for array in result:
            if array is not None:
                with pytest.raises(ValueError, match="read-only"):
                    array[...] = 0
    assert second.verdicts == tuple(VERDICTS[code] for code in second.verdict)


def test_any_numbers_will_do(robots):
    robot = robots["panda"]
    remapper = Remapper(robot, [[2, 4]])
    q = np.array([0, 1, 0, -2, 0, 1, 1])
    wanted = remapper(q.astype(float), np.arange(7.0)).copy()
    columns = np.array([q, np.arange(7)], dtype=float).T
    frozen = columns.T.copy()
    frozen.setflags(write=False)
    swapped = columns.T.astype(">f8")
    for one, tau in (
        (q.tolist(), list(range(7))),
        (tuple(q), np.arange(7)),
        (columns[:, 0], columns[:, 1]),
        frozen,
        swapped,
        (q.astype(np.float32), np.arange(7.0)),
    ):
        remapper(np.zeros(7), np.zeros(7))
        for got, expected in zip(remapper(one, tau), wanted, strict=True):
            np.testing.assert_array_equal(got, expected) if got is not None else None


def test_copies_have_their_own_workspace(robots):
    robot = robots["panda"]
    q, tau = np.array(robot.postures["default"]), np.linspace(9.0, -5.0, 7)
    options = {"task": "wrench", "length": 0.3, "axes": "world", "payload": 2.0, "wary": 0.05}
    sets = [FaultSet((Fault(0), Fault(2, FREE))), FaultSet.locked([3])]
    remapper = Remapper(robot, sets, **options)
    wanted = remapper(q, tau).copy()
    for twin in (
        copy.copy(remapper),
        copy.deepcopy(remapper),
        pickle.loads(pickle.dumps(remapper)),
    ):
        assert twin.sets == remapper.sets
        assert np.isnan(twin.result.U).all()
        for got, expected in zip(twin(q, tau), wanted, strict=True):
            np.testing.assert_array_equal(got, expected)


@pytest.mark.skipif(IS_PLAIN, reason="slow")
def test_one_remapper_per_thread(robots):
    remapper = Remapper(robots["panda"], 2)
    rng = np.random.default_rng(0)
    q, tau = rng.normal(size=(2, 400, 7))

    def answers(own):
        return [own(one, other).U.copy() for one, other in zip(q, tau, strict=True)]

    wanted = answers(remapper)
    with ThreadPoolExecutor(4) as pool:
        for got in pool.map(answers, [copy.copy(remapper) for _ in range(4)]):
            np.testing.assert_array_equal(got, wanted)


# ---- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e200])
@pytest.mark.parametrize("place", [0, 6])
def test_numbers_that_are_none(robots, bad, place):
    remapper = Remapper(robots["panda"], 1)
    q, tau, F = np.zeros(7), np.ones(7), np.ones(3)
    kept = remapper(q, tau).copy()
    spoiled = np.zeros(7)
    spoiled[place] = bad
    words = "numbers too large" if bad == 1e200 else f"contains {bad} at position {place + 1}"
    with pytest.raises(InputError, match=f"^q {words}|{words}"):
        remapper(spoiled, tau)
    with pytest.raises(InputError, match=words):
        remapper(q, spoiled)
    with pytest.raises(InputError, match=words):
        remapper(spoiled, force=F)
    with pytest.raises(InputError, match="force"):
        remapper(q, force=np.array([0.0, bad, 0.0]))
    for got, expected in zip(remapper.result, kept, strict=True):
        np.testing.assert_array_equal(got, expected) if got is not None else None


def test_wrong_shapes_and_types(robots):
    remapper = Remapper(robots["panda"], 1)
    q, tau = np.zeros(7), np.ones(7)
    for bad in (np.zeros(6), np.zeros(8), np.zeros((7, 1)), np.zeros((1, 7)), 0.0, []):
        with pytest.raises(DimensionError, match=r"^q needs 7 numbers, got"):
            remapper(bad, tau)
        with pytest.raises(DimensionError, match=r"^tau needs 7 numbers, got"):
            remapper(q, bad)
    with pytest.raises(DimensionError, match=r"^force needs 3 numbers, got 7 numbers: fx, fy, fz"):
        remapper(q, force=tau)
    for bad in (None, "1,2", q.astype(complex), q.astype(bool), [None] * 7):
        with pytest.raises(InputError, match=r"^q needs numbers"):
            remapper(bad, tau)
    with pytest.raises(InputError, match="give torques or a force"):
        remapper(q)
    with pytest.raises(InputError, match="not both"):
        remapper(q, tau, force=np.ones(3))


def test_fault_sets_of_every_form(robots):
    robot = robots["panda"]
    third = FaultSet.locked([2])
    assert Remapper(robot).sets == tuple(fault_sets(7, 1))
    assert Remapper(robot, 2, mode="free").sets == tuple(fault_sets(7, 2, FREE))
    mask = np.array([False, False, True, False, False, False, False])
    for faults in ([3], ["panda_joint3"], [[3]], third, {third}, [mask], iter([(3,)])):
        assert Remapper(robot, faults).sets == (third,)
    assert Remapper(robot, ["2,4", []]).sets == (FaultSet.locked([1, 3]), FaultSet())
    free = FaultSet.all_of(FREE, [1])
    assert Remapper(robot, [[2], third], mode="free").sets == (free, third)


@pytest.mark.parametrize(
    ("faults", "error", "words"),
    [
        *((faults, InputError, "list of sets") for faults in ("2,4", None, 1.5)),
        *((faults, InputError, "from 1 to 7") for faults in (True, 0, 8)),
        ([], InputError, "at least one set"),
        ([[9]], InputError, "joint"),
        ([["elbow"]], UnknownNameError, "unknown joint 'elbow'"),
        ([FaultSet.locked([7])], InputError, "joint 8 is out of range"),
    ],
)
def test_fault_sets_that_are_none(robots, faults, error, words):
    with pytest.raises(error, match=words):
        Remapper(robots["panda"], faults)


def test_options_are_checked(robots):
    robot = robots["panda"]
    for options, words in (
        ({"mode": "weak"}, "locked or free"),
        ({"task": "fq"}, "task component"),
        ({"rtol": 0.5, "wary": 0.1}, "wary"),
        ({"axes": "tip"}, "axes"),
        ({"gravity": [0, 0]}, "gravity"),
        ({"payload": -1.0}, "payload"),
    ):
        with pytest.raises(InputError, match=words):
            Remapper(robot, 1, **options)


def test_without_numba(robots, monkeypatch):
    monkeypatch.delitem(sys.modules, "ftforce.batch.kernels.single")
    monkeypatch.delattr("ftforce.batch.kernels.single")
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(FtforceError, match=r"numba: install the extra .*ftforce\[sweep\]"):
        Remapper(robots["panda"])


def test_a_weight_that_is_missing():
    bare = load_text(without_masses(serial_urdf(*[("revolute", {"axis": (0, 1, 0)})] * 3)))
    q, tau = np.array([0.3, 0.4, 0.5]), np.ones(3)
    check_all(bare, sets_of(bare), q, tau, task="fx,fz")
    assert Remapper(bare, 1).warnings == ()
    assert "no masses" in Remapper(bare, 1, mode="free").warnings[0]
    assert Remapper(load_robot("dh5"), 1, mode="free").warnings == ()


def test_it_says_what_it_is(robots):
    assert repr(Remapper(robots["panda"], 2)) == "<Remapper 'panda': force, 28 fault sets>"
