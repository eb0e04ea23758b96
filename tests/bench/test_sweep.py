"""The kernels of a sweep, and whole sweeps, beside what people write instead.

Kernels are asked about 1000 postures at a time: milliseconds read as microseconds per posture.
"""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from effort import QUICK, rounds
from ftforce.batch.numpy_path import NumpyEvaluator
from ftforce.batch.plan import Plan, faults_of, mechanism_of, question_of
from ftforce.batch.postures.drawn import Drawn
from ftforce.batch.warmup import warmup
from ftforce.core.faults import FaultMode, fault_sets
from ftforce.core.task import Task

K = 1000  # postures
FORCE = np.array([80.0, 50.0, 10.0])
WRENCH = np.array([80.0, 50.0, 10.0, 5.0, 2.0, 1.0])
LENGTH = 0.3
SINGLE = "7 single faults of the Panda, force task: s_min, rho, jump; 1000 postures, so ms are us"
PAIRS = "28 single and double faults, force task; 1000 postures, so ms are us"
SIX = "7 single faults, wrench task (m = 6); 1000 postures, so ms are us"
OTHER = "other questions; 1000 postures, so ms are us"
WHOLE_POSTURES = 1_000_000 if QUICK else 10_000_000
WHOLE = (
    f"whole sweeps of the Panda, {WHOLE_POSTURES:.0e} postures, 7 sets, force; threads or Dask, s"
)


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("panda")


@pytest.fixture(scope="module")
def q(arm):
    return Drawn.of(arm, K, "uniform").block(0, K)


def evaluator(arm, components, force, *, faults=1, mode="locked", direction=None, limits=None):
    task = Task.parse(components, "tool", LENGTH if components == "wrench" else None)
    weighs = direction is not None or mode == "free"
    plan = Plan(
        mechanism_of(arm, needs_gravity=weighs),
        faults_of(tuple(fault_sets(arm.n, faults, FaultMode(mode))), arm.n),
        question_of(
            task, arm.n, force=force, direction=direction, limits=limits, rtol=1e-6, wary=1e-2,
            needs_gravity=weighs,
        ),
        arm.n,
        components == "wrench",
    )  # fmt: skip
    return plan.evaluator()


def jacobian(arm, q, rows):
    return pin.computeFrameJacobian(arm.model, arm.data, q, arm.tip_frame, pin.LOCAL)[:rows]


def sets_of(n, largest):
    return [s for size in range(1, largest + 1) for s in combinations(range(n), size)]


def by_loop(arm, postures, F, largest=1):
    """As people write it: a loop over postures and sets, the pseudoinverse, the norm."""
    m, sets = len(F), sets_of(arm.n, largest)
    found = np.empty((3, len(sets), len(postures)))
    for i, q in enumerate(postures):
        J = jacobian(arm, q, m)
        w = np.sqrt(np.linalg.det(J @ J.T))
        for s, locked in enumerate(sets):
            K = J.copy()
            K[:, locked] = 0.0
            jump = F - K @ np.linalg.pinv(K, rcond=1e-6) @ F
            found[0, s, i] = np.linalg.svd(K, compute_uv=False)[-1]
            found[1, s, i] = np.sqrt(max(np.linalg.det(K @ K.T), 0.0)) / w
            found[2, s, i] = np.linalg.norm(jump)
    return found


def by_expert(arm, postures, F, largest=1):
    """As an expert writes it: a loop for the Jacobians, then all sets at once from K Kᵀ."""
    m, sets = len(F), sets_of(arm.n, largest)
    J = np.empty((len(postures), m, arm.n))
    for i, q in enumerate(postures):
        J[i] = jacobian(arm, q, m)
    A = J @ J.transpose(0, 2, 1)
    columns = np.einsum("kin,kjn->nkij", J, J)  # J_n J_nᵀ
    B = np.stack([A - sum(columns[k] for k in locked) for locked in sets])
    values, vectors = np.linalg.eigh(B)
    lost = values <= (1e-6**2) * np.linalg.eigvalsh(A)[:, -1][None, :, None]
    along = np.einsum("skij,i->skj", vectors, F)
    rho = np.sqrt(np.maximum(values, 0.0).prod(axis=-1) / np.linalg.det(A))
    jump = np.sqrt((np.where(lost, along, 0.0) ** 2).sum(axis=-1))
    return np.stack([np.sqrt(np.maximum(values[..., 0], 0.0)), rho, jump])


def check(block, expected):
    np.testing.assert_allclose(block.sigma_min, expected[0], atol=1e-6)
    np.testing.assert_allclose(block.rho, expected[1], atol=1e-6)
    np.testing.assert_allclose(block.jump, expected[2], atol=1e-5)


CASES = {
    SINGLE: ("force", FORCE, 1),
    PAIRS: ("force", FORCE, 2),
    SIX: ("wrench", WRENCH, 1),
}


@pytest.fixture(params=CASES, ids=["single", "pairs", "wrench"])
def case(request, benchmark):
    benchmark.group = request.param
    return CASES[request.param]


def test_ftforce(benchmark, arm, q, case):
    components, force, largest = case
    block = benchmark(evaluator(arm, components, force, faults=largest), q)
    if components == "force":
        check(block, by_expert(arm, q, force, largest))
    assert block.tip.shape == (K, 3)


def test_expert(benchmark, arm, q, case):
    components, force, largest = case
    found = benchmark.pedantic(
        by_expert, (arm, q, force, largest), rounds=rounds(7), warmup_rounds=1
    )
    if components == "force":
        check(evaluator(arm, components, force, faults=largest)(q), found)
    assert found.shape[2] == K


def test_loop(benchmark, arm, q, case):
    components, force, largest = case
    found = benchmark.pedantic(by_loop, (arm, q, force, largest), rounds=1, warmup_rounds=0)
    if components == "force":
        check(evaluator(arm, components, force, faults=largest)(q), found)
    assert found.shape[2] == K


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("7 sets, free", {"components": "force", "force": FORCE, "mode": "free"}),
        ("28 sets, wrench", {"components": "wrench", "force": WRENCH, "faults": 2}),
        ("7 sets with capability", {"components": "force", "force": FORCE, "direction": FORCE}),
    ],
    ids=["free", "wrench pairs", "capability"],
)
@pytest.mark.benchmark(group=OTHER)
def test_other_questions(benchmark, arm, q, words, options):
    from ftforce.analysis.limits_files import choose_limits

    if "direction" in options:
        options = options | {"limits": choose_limits(arm, "urdf")}
    block = benchmark(evaluator(arm, **options), q)
    assert block.verdict.shape[1] == K, words


GIVEN = "whole sweeps of given postures of the Panda, 7 sets, force, with summary; one thread, ms"


@pytest.mark.benchmark(group=GIVEN)
@pytest.mark.parametrize("count", [10_000, 400_000])
def test_given_postures(benchmark, arm, count):
    given = Drawn.of(arm, count, "uniform").block(0, count)
    warmup(["force"])
    options = {"force": FORCE, "limits": "none", "threads": 1}
    result = benchmark.pedantic(
        ftforce.sweep, (arm, given), options, rounds=rounds(20), warmup_rounds=1
    )
    assert result.done == count


@pytest.mark.benchmark(group=OTHER)
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_by_numpy(benchmark, arm, q, mode):
    plan = evaluator(arm, "force", FORCE, mode=mode).plan
    block = benchmark(NumpyEvaluator(plan), q)
    assert block.verdict.shape[1] == K


@pytest.mark.benchmark(group=WHOLE)
@pytest.mark.parametrize("threads", [1, 2])
def test_whole_sweep(benchmark, arm, threads):
    options = {"n": WHOLE_POSTURES, "force": FORCE, "limits": "none", "threads": threads}
    result = benchmark.pedantic(ftforce.sweep, (arm,), options, rounds=rounds(3), warmup_rounds=1)
    assert result.done == WHOLE_POSTURES


@pytest.mark.benchmark(group=WHOLE)
@pytest.mark.parametrize("workers", [1, 2])
def test_whole_sweep_on_dask(benchmark, arm, workers):
    """With the cluster's start; the long sweep of docs/performance has little of it."""
    options = {"n": WHOLE_POSTURES, "force": FORCE, "limits": "none", "workers": workers}
    result = benchmark.pedantic(ftforce.sweep, (arm,), options, rounds=1, warmup_rounds=0)
    assert result.done == WHOLE_POSTURES


# Not getrusage: what it calls the largest memory counts that of the process it was started by.
MEMORY = """
import ftforce
arm = ftforce.load_robot("panda")
ftforce.sweep(arm, n={n}, force=[80, 50, 10], limits="none")
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(status["VmHWM"].split()[0])
"""


@pytest.mark.benchmark(group="1e8 (quick: 2e7) postures in summary mode: s, and at most 500 MB")
def test_a_hundred_million_postures(benchmark):
    """The largest memory is asserted: it does not depend on the machine's other work."""

    def run():
        program = MEMORY.format(n=2e7 if QUICK else 1e8)
        return subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)

    done = benchmark.pedantic(run, rounds=1, warmup_rounds=0)
    kilobytes = int(done.stdout)
    benchmark.extra_info["MB"] = kilobytes / 1e3
    print(f"\nsummary mode: largest memory {kilobytes / 1e3:.0f} MB")
    assert kilobytes < 500_000


IMPORTS = """
import ftforce, numba, xarray, zarr, scipy.stats
import ftforce.batch.sweep, ftforce.batch.store, ftforce.batch.runner
arm = ftforce.load_robot("panda")
"""
FIRST_CALLS = ("imports", "fresh", "warm") if QUICK else ("imports", "fresh", "warm", "cold")
FIRST = "ftforce.sweep(arm, n=20_000, force=[80, 50, 10], limits='none')"
COMPILE = "from ftforce.batch.warmup import warmup; warmup(['force'])"
PROGRAMS = {"imports": "", "fresh": FIRST, "warm": FIRST, "cold": COMPILE}


@pytest.mark.benchmark(
    group="a process: imports; a first sweep on a fresh installation (NumPy) and with compiled "
    "kernels; and the compilation of the kernels for one kind of question"
)
@pytest.mark.parametrize("what", FIRST_CALLS)
def test_first_call(benchmark, tmp_path, what):
    folders = iter(tmp_path / str(i) for i in range(100))
    kept = tmp_path / "kept"

    def run():
        cache = kept if what == "warm" else next(folders)
        in_process(IMPORTS + PROGRAMS[what], cache)
        return cache

    def in_process(program, cache):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
        subprocess.run([sys.executable, "-c", program], check=True, env=environment)

    if what == "warm":
        in_process(IMPORTS + COMPILE, kept)
    count = 1 if what == "cold" else rounds(5)
    cache = benchmark.pedantic(run, rounds=count, warmup_rounds=1 if what == "warm" else 0)
    assert any(cache.rglob("*.nbc")) == (what in {"warm", "cold"})
