"""`ftforce.Remapper` within torque limits, and with Jacobians of any library.

Beside `ftforce.analyze`, the array core, and quadprog; with ``NUMBA_DISABLE_JIT=1`` fewer cases.
"""

from __future__ import annotations

import copy
import gc
import math
import pickle
import tracemalloc
from collections import Counter

import numpy as np
import pytest
from numba import config
from numba.core.runtime import _nrt_python, rtsys

from ftforce import analyze, load_robot, remap
from ftforce.batch.kernels import single
from ftforce.batch.remapper import Remapper
from ftforce.core.arrays import norm
from ftforce.core.bounded_remap import bounded_remap
from ftforce.core.faults import Fault, FaultMode, FaultSet, fault_sets
from ftforce.core.limits import Limits, both_sides
from ftforce.core.verdict import Verdict, judge
from ftforce.errors import DimensionError, InputError
from ftforce.robot.kinematics import task_jacobian
from helpers import KNOWN, assert_close, campaign
from problems import beyond, draw_problem, margin_by_highs, nearest_by_quadprog, space_of

IS_PLAIN = bool(config.DISABLE_JIT)
pytestmark = [pytest.mark.plain, pytest.mark.thorough]
if not IS_PLAIN:
    pytestmark.append(pytest.mark.no_cover)  # what is watched is the plain run

LOCKED, FREE, WEAK = FaultMode.LOCKED, FaultMode.FREE, FaultMode.WEAK
WARY = 1e-2


@pytest.fixture(autouse=True)
def _no_warnings_of_plain_python():
    with np.errstate(all="ignore"):  # compiled code does not warn
        yield


def set_of(problem):
    """Return the fault set of a problem."""
    faults = [Fault(int(k), LOCKED) for k in np.flatnonzero(problem.locked)]
    return FaultSet((*faults, *(Fault(int(k), FREE) for k in np.flatnonzero(problem.free))))


def asked_of(problem):
    """Ask a remapper about a problem."""
    m, n = problem.J.shape
    limits = Limits.of(problem.limits, problem.limits)
    remapper = Remapper(m=m, n=n, faults=set_of(problem), limits=limits)
    return remapper(problem.J, problem.tau, rnea=problem.rnea)


# ---- beside another solver ---------------------------------------------------------------------


def check_beside_quadprog(problem, result, F):
    """Compare with quadprog's force, and with what the theory wants; return the kind of problem."""
    space = space_of(problem)
    wanted, got = nearest_by_quadprog(problem, F, space), result.force_after[0]
    if wanted is None or np.isnan(got).any():
        if (wanted is None) != np.isnan(got).any():  # only where rounding decides
            assert abs(margin_by_highs(problem)) < 1e-9
            return "border"
        assert np.isnan(result.U[0]).all()
        assert result.verdicts == (Verdict.NOT_TOLERATED,)
        return "infeasible"
    size = max(norm(F), norm(wanted)) or 1.0
    assert_close(got, wanted, scale=size)
    assert beyond(problem, got, space, size=size) < 1e-9
    return "binding" if norm(F - wanted) > 1e-9 * size else "kept"


def test_random_problems_beside_quadprog():
    rng = np.random.default_rng(17)
    kinds = Counter()
    count = 60 if IS_PLAIN else campaign(10_000, 300)
    for _ in range(count):
        problem = draw_problem(rng)
        result = asked_of(problem)
        F = result.force_before.copy()
        assert_close(F, problem.remap().nearest.F, scale=norm(F) + 1e-9)
        kinds[check_beside_quadprog(problem, result, F)] += 1
    assert kinds["border"] <= 3
    for kind, share in {"binding": 0.3, "kept": 0.1, "infeasible": 0.1}.items():
        assert kinds[kind] > share * count, kinds


# ---- beside the array core ---------------------------------------------------------------------


def draw_sets(rng, n, count=8):
    """Draw sets of sound, locked, free and weak joints."""
    sets = []
    for _ in range(count):
        modes = rng.choice(["", LOCKED, FREE, WEAK], size=n, p=[0.65, 0.15, 0.07, 0.13])
        factors = rng.choice([0.0, 0.1, 0.5], size=n)
        faults = zip(range(n), modes, factors.tolist(), strict=True)
        sets.append(
            FaultSet(
                tuple(
                    Fault(k, FaultMode(mode), *([x] if mode == WEAK else []))
                    for k, mode, x in faults
                    if mode
                )
            )
        )
    return sets


def test_verdicts_and_torques_of_the_array_core():
    rng = np.random.default_rng(5)
    seen = Counter()
    for _ in range(4 if IS_PLAIN else campaign(400)):
        m, n = int(rng.integers(1, 7)), int(rng.integers(1, 10))
        sets, friction = draw_sets(rng, n), float(rng.choice([0.0, math.nan, 0.05]))
        limits, brakes = 10.0 ** rng.uniform(-1.0, 1.5, (2, n))
        is_weak = np.isin(np.arange(n), [joint for one in sets for joint in one.in_mode(WEAK)])
        limits[(rng.random(n) < 0.2) & ~is_weak] = np.nan
        brakes[rng.random(n) < 0.5] = np.nan
        lower = -limits * 10.0 ** rng.uniform(-0.5, 0.5, n) if rng.random() < 0.5 else None
        known = Limits.of(limits, brakes, lower=lower)
        remapper = Remapper(m=m, n=n, faults=sets, limits=known, friction=friction)
        for _ in range(4):
            J = np.round(rng.normal(size=(m, n)), int(rng.choice([0, 12])))
            J[:, rng.integers(n)] *= rng.choice([1.0, 1e-3])
            tau, rnea = 10.0 ** rng.uniform(-1.0, 2.0) * rng.normal(size=n), rng.normal(size=n)
            rnea *= rng.choice([0.0, 0.1, 3.0])
            result = remapper(J, tau, rnea=rnea)
            for s, one in enumerate(sets):
                seen[check_beside_core(result, s, one, known, (J, tau, friction, rnea))] += 1
    # Of the few cases without a compiler, rounding may decide none.
    assert set(seen) | ({None} if IS_PLAIN else set()) == {*Verdict, None}, seen


def check_beside_core(result, s, one, known, asked):
    """Compare one set with the array core; return the verdict, ``None`` if rounding decides."""
    J, tau, friction, rnea = asked
    n, largest = len(tau), known.largest_torques(one)
    lower, upper = both_sides(largest)
    limits = np.where(upper > lower, [lower, upper], np.nan)
    expected = bounded_remap(
        J, tau, one.mask(n), limits=limits, free=one.free_mask(n), rnea=rnea,
        friction=np.full(n, friction),
    )  # fmt: skip
    reduced, F = expected.reduced, expected.nearest.F
    ratios = np.array(reduced.damaged.s) / (reduced.sigma_max or 1.0)
    if not F.any() or np.any((ratios > 1e-14) & (ratios < 1e-4)):
        return None
    verdict = judge(reduced, F, WARY, expected, largest)
    assert result.verdict_of(s) is verdict
    assert result.rank_lost[s] == reduced.rank - reduced.rank_after
    assert_close(result.margin[s], ratios[-1], scale=1.0)
    if expected.F_after is None:
        assert np.isnan(result.U[s]).all()
        assert np.isnan(result.force_after[s]).all()
        return verdict
    size = max(norm(F), norm(expected.F_after))
    assert_close(result.force_after[s], expected.F_after, scale=size)
    assert_close(result.jump[s], expected.jump, scale=size)
    assert_close(result.jump_norm[s], norm(expected.jump), scale=size)
    scale = reduced.sigma_max * size + norm(rnea)
    motors = reduced.commanding
    assert_close((result.U[s] + rnea)[motors], expected.U[motors], scale=scale)
    assert not result.U[s][one.mask(n)].any()
    return verdict


def test_jacobians_without_limits_as_remap_has_them():
    rng = np.random.default_rng(3)
    remapper = Remapper(m=3, n=6, faults=2)
    assert remapper.sets == tuple(fault_sets(6, 2))
    for _ in range(5):
        J, tau = rng.normal(size=(3, 6)), rng.normal(size=6)
        J[2] *= rng.choice([0.0, 1.0])
        result = remapper(J, tau)
        for s, one in enumerate(remapper.sets):
            expected = remap(J, tau, one.mask(6))
            assert_close(result.U[s], expected.U, scale=1.0)
            assert_close(result.force_after[s], expected.F_after, scale=1.0)
        F = result.force_before.copy()
        assert_close(remapper(J, force=F).force_before, F, scale=norm(F))


def test_what_friction_bears_may_still_be_too_much_for_a_motor():
    """No force has a lever at the free joint, so its friction bears all; the first motor cannot."""
    J = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    free = FaultSet.all_of(FREE, [2])
    limits = [6.0, math.nan, math.nan]
    remapper = Remapper(m=2, n=3, faults=free, limits=limits, friction=0.05)
    np.testing.assert_array_equal(remapper(J, force=[5.0, 2.0]).force_after[0], [5.0, 2.0])
    assert_close(remapper(J, force=[10.0, 2.0]).force_after[0], [6.0, 2.0], scale=1.0)
    assert remapper.result.verdicts == (Verdict.NOT_TOLERATED,)


@pytest.mark.parametrize("seed", range(20))
def test_friction_of_nothing_at_rest(seed):
    """Without weight, a joint of unknown friction has none: its short lever leaves no force."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(2, 5))
    J[:, 3:] *= 1e-3
    remapper = Remapper(m=2, n=5, faults=FaultSet.all_of(FREE, [3, 4]), friction=math.nan)
    result = remapper(J, 30.0 * rng.normal(size=5))
    assert_close(result.force_after[0], [0.0, 0.0], scale=norm(result.force_before))


# ---- beside analyze ----------------------------------------------------------------------------


@pytest.mark.parametrize("words", ["force", "wrench"])
@pytest.mark.parametrize("name", ["panda"] if IS_PLAIN else KNOWN)
def test_limits_of_a_robot_as_analyze_has_them(name, words):
    robot = load_robot(name)
    rng, n = np.random.default_rng(len(name)), robot.n
    effort = np.where(np.isnan(robot.effort), 20.0, robot.effort) * rng.uniform(0.1, 1.0, n)
    limits = Limits.of(effort, np.where(rng.random(n) < 0.5, np.nan, 0.5 * effort))
    options = {"task": words, "length": 0.3, "payload": 0.5, "axes": "world"}
    sets = [FaultSet(), *fault_sets(n, 1), *draw_sets(rng, n, 6)]
    weak = [FaultSet((Fault(1, WEAK, 0.02), Fault(2, LOCKED)))]  # limits of the URDF, unless given
    for limits_of, own in ((limits, sets), (None, weak)):
        remapper = Remapper(robot, own, limits=limits_of, **options)
        for _ in range(3):
            q, tau = rng.uniform(-2.0, 2.0, n), effort * rng.uniform(-1.0, 1.0, n)
            result = remapper(q, tau)
            for s, one in enumerate(own):
                modes = {str(mode): [j + 1 for j in one.in_mode(mode)] for mode in (LOCKED, FREE)}
                factors = {f.joint + 1: f.factor for f in one.faults if f.mode is WEAK}
                report = analyze(
                    robot, q, **modes, weak=factors, torque=tau, limits=limits_of, **options
                )
                assert result.verdict_of(s) is report.verdict
                assert np.isnan(result.U[s]).any() == (report.force.after is None)
                if report.force.after is not None:
                    scale = max(norm(report.force.before), norm(report.force.after))
                    assert_close(result.force_after[s], report.force.after, scale=scale)
                    torque = norm(report.torque.before) + norm(report.rnea.after)
                    lever = report.reduced.sigma_max * scale
                    assert_close(result.U[s], report.torque.after, scale=max(torque, lever))


def test_a_jacobian_is_as_good_as_the_robot():
    robot = load_robot("panda")
    q, tau = np.array(robot.postures["default"]), np.linspace(9.0, -5.0, 7)
    sets = [FaultSet((Fault(1, WEAK, 0.1),)), FaultSet.locked([3]), FaultSet.all_of(FREE, [5])]
    from_q = Remapper(robot, sets, limits="urdf", friction=0.2)
    report = analyze(robot, q, torque=tau)
    from_J = Remapper(m=3, n=7, faults=sets, limits=robot.effort, friction=0.2)
    got, wanted = from_J(report.J, tau, rnea=report.rnea.after), from_q(q, tau)
    assert from_J.robot is from_J.task is None
    for one, other in zip(got, wanted, strict=True):
        assert (one is None) == (other is None)
        if one is not None:
            assert_close(one, other, scale=100.0)


# ---- the loop ----------------------------------------------------------------------------------


def looped(sets=1):
    """Return a call in which limits bind, and its remapper."""
    robot = load_robot("panda")
    J = np.array(task_jacobian(robot, robot.postures["default"], analyze(robot).task))
    remapper = Remapper(m=3, n=7, faults=sets, limits=np.full(7, 12.0))
    tau, rnea = J.T @ [80.0, 50.0, 10.0], np.linspace(1.0, -1.0, 7)
    return remapper, lambda: remapper(J, tau, rnea=rnea)


@pytest.mark.skipif(IS_PLAIN, reason="plain Python allocates numbers")
def test_thousands_of_calls_within_limits_allocate_nothing():
    _, call = looped([[2], [2, 4], FaultSet.all_of(FREE, [3])])
    _nrt_python.memsys_enable_stats()

    def calls(k):
        for _ in range(k):
            call()

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


def test_limits_bind_and_are_kept():
    remapper, call = looped()
    result = call()
    total = result.U + np.linspace(1.0, -1.0, 7)
    locked = np.array([one.mask(7) for one in remapper.sets])
    assert np.abs(np.where(locked, 0.0, total)).max() == pytest.approx(12.0)
    assert set(result.verdicts) == {Verdict.NOT_TOLERATED}
    assert (result.jump_norm > 1.0).all()
    assert (np.vecdot(result.jump, result.jump) > 0.0).all()


@pytest.mark.skipif(IS_PLAIN, reason="nothing is compiled")
def test_each_kind_is_compiled_once_and_only_when_needed():
    remapper, call = looped()
    call()
    with pytest.raises(InputError):
        remapper(np.zeros((7, 3)), np.zeros(7))
    assert len(single.compiled(True, True).overloads) == 1


def test_copies_of_a_remapper_of_jacobians():
    remapper, call = looped()
    wanted = call().copy()
    tau, J = np.arange(7.0), np.ones((3, 7))
    for twin in (copy.copy(remapper), pickle.loads(pickle.dumps(remapper))):
        assert twin.sets == remapper.sets
        twin(J, tau)
        np.testing.assert_array_equal(remapper.result.U, wanted.U)
        assert repr(twin) == "<Remapper Jacobians of shape (3, 7), 7 fault sets>"


# ---- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"m": 3}, "a robot, or the shape of the Jacobians .* got n=None"),
        ({"m": 0, "n": 7}, "got m=0"),
        ({"m": True, "n": 7}, "got m=True"),
        ({"m": 3, "n": 7, "axes": "world"}, "axes needs a robot"),
        ({"m": 3, "n": 7, "gravity": [0, 0, -9.81]}, "gravity needs a robot"),
        ({"m": 3, "n": 7, "task": "wrench"}, "task needs a robot"),
        ({"m": 3, "n": 7, "faults": ["elbow"]}, "numbered from 1 to 7 .* got joint 'elbow'"),
        ({"m": 3, "n": 7, "faults": [[0]]}, "numbered from 1 to 7"),
        ({"m": 3, "n": 7, "faults": [[True]]}, "mask needs 7 entries"),
        ({"m": 3, "n": 7, "faults": 8}, "from 1 to 7"),
        ({"m": 3, "n": 7, "faults": FaultSet.locked([7])}, "joint 8 is out of range"),
        ({"m": 3, "n": 7, "limits": np.ones(6)}, "limits"),
        ({"m": 3, "n": 7, "limits": np.zeros(7)}, "must be positive"),
        ({"m": 3, "n": 7, "friction": np.ones(6)}, "friction"),
        ({"m": 3, "n": 7, "friction": -1.0}, "negative"),
        ({"m": 3, "n": 7, "faults": FaultSet((Fault(1, WEAK, 0.5),))}, "need torque limits"),
        (
            {"m": 1, "n": 2, "faults": FaultSet((Fault(0, WEAK, 0.5),)), "limits": [math.nan, 5]},
            "need torque limits",
        ),
        ({"m": 3, "n": 7, "faults": [[True, 2]]}, "numbered from 1 to 7"),
        ({"m": 3, "n": 7, "limits": "urdf"}, "without a robot, limits are numbers"),
        ({"m": 3, "n": 7, "payload": "force"}, "payload needs a robot"),
    ],
)
def test_remappers_of_jacobians_that_are_none(options, words):
    with pytest.raises(InputError, match=words):
        Remapper(**options)


def test_calls_that_are_refused():
    robot = load_robot("panda")
    with pytest.raises(InputError, match="m and n describe Jacobians"):
        Remapper(robot, m=3, n=7)
    with pytest.raises(InputError, match="rnea goes with a Jacobian"):
        Remapper(robot)(np.zeros(7), np.ones(7), rnea=np.ones(7))
    remapper = Remapper(m=3, n=7)
    J, tau = np.ones((3, 7)), np.ones(7)
    kept = remapper(J, tau).copy()
    broken = J.copy()
    broken[1, 2] = math.nan
    for arguments, error, words in (
        ((J[:2], tau), DimensionError, r"^J needs"),
        ((tau, tau), DimensionError, r"^J needs"),
        ((J, tau[:6]), DimensionError, r"^tau needs 7 numbers"),
        ((broken, tau), InputError, r"J contains nan at position 2, 3"),
        ((1e200 * J, tau), InputError, "too large"),
        ((J, math.inf * tau), InputError, "tau contains inf"),
        ((J,), InputError, "give torques or a force"),
    ):
        with pytest.raises(error, match=words):
            remapper(*arguments)
    with pytest.raises(InputError, match="not both"):
        remapper(J, tau, force=np.ones(3))
    with pytest.raises(DimensionError, match=r"^rnea needs 7 numbers"):
        remapper(J, tau, rnea=np.ones(3))
    with pytest.raises(DimensionError, match=r"^force needs 3 numbers"):
        remapper(J, force=tau)
    np.testing.assert_array_equal(remapper.result.U, kept.U)
    np.testing.assert_array_equal(remapper(J.tolist(), tau.astype(int)).U, kept.U)
    np.testing.assert_array_equal(remapper(np.asfortranarray(J), tau, rnea=[0] * 7).U, kept.U)


def test_before_the_first_call_nothing_is_tolerated():
    result = Remapper(m=1, n=2).result
    assert result.verdicts == (Verdict.NOT_TOLERATED,) * 2
    assert np.isnan(result.U).all()
