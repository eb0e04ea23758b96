"""Sweeps without compiled kernels: the same answers and counts, and when they are chosen."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections import defaultdict
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numba.core.caching import _CacheLocator

import ftforce
from ftforce.analysis.friction import choose_friction
from ftforce.analysis.limits_files import choose_limits
from ftforce.analysis.question import AllFaultSets
from ftforce.batch import compiled, numpy_path
from ftforce.batch import sweep as module
from ftforce.batch.plan import Plan, faults_of, mechanism_of, question_of
from ftforce.batch.postures.postures import Listed
from ftforce.batch.sparing import SparingEvaluator, sparing
from ftforce.batch.store import store
from ftforce.batch.sweep import sweep
from ftforce.core.faults import FaultMode, fault_sets
from ftforce.core.task import Task
from ftforce.robot.dynamics import Payload
from ftforce.robot.kinematics import noise_floor
from helpers import KNOWN, campaign

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("kernels")]

TASKS = (("force", None, "tool"), ("wrench", 0.3, "world"), ("fx,fz", None, "tool"))


def plan_of(robot, task, *, mode="locked", faults=1, asks=True):
    """Return the plan of a question with a force, a capability and a payload."""
    question = question_of(
        task,
        robot.n,
        force=10.0 * np.arange(1.0, task.m + 1.0) if asks else None,
        direction=np.linspace(0.2, 0.8, task.m),
        limits=choose_limits(robot, "urdf"),
        friction=choose_friction(robot, None, None).torque,
        rtol=1e-6,
        wary=1e-2,
        floors=noise_floor(robot),
        needs_gravity=True,
    )
    sets = tuple(fault_sets(robot.n, faults, FaultMode.parse(mode)))
    mechanism = mechanism_of(robot, payload=Payload.of(1.5, (0.1, 0.02, -0.05)))
    has_both = asks and bool(task.force_rows and task.moment_rows)
    return Plan(mechanism, faults_of(sets, robot.n), question, robot.n, has_both)


def postures_of(robot, k, seed):
    """Return random postures; the first is all zero, the second repeats one number: singular."""
    rng = np.random.default_rng(seed)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
    q = rng.uniform(lower, upper, (k, robot.n))
    q[:2] = [[0.0], [math.pi / 2]]
    return q


def assert_same_answers(found, expected, force=100.0):
    """Compare blocks; the fast kernels may be wrong by 3e-8 near their smallest margin."""
    for name, values in expected._asdict().items():
        other = getattr(found, name)
        if values is None or values.dtype.kind == "i":
            np.testing.assert_array_equal(other, values, name)
            continue
        size = force if "jump" in name else 1.0
        close = {"rtol": 1e-7, "atol": 1e-8 * size, "equal_nan": True}
        np.testing.assert_allclose(other, values, **close, err_msg=name)


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize("name", KNOWN)
def test_both_paths_answer_alike_on_every_robot(name, mode):
    robot = ftforce.load_robot(name)
    for seed, (words, length, axes) in enumerate(TASKS):
        plan = plan_of(robot, Task.parse(words, axes, length), mode=mode, asks=seed != 1)
        q = postures_of(robot, campaign(20, 5), seed)
        assert_same_answers(numpy_path.NumpyEvaluator(plan)(q), plan.evaluator()(q))


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_both_paths_answer_alike_for_wrenches_of_pairs(panda, mode):
    plan = plan_of(panda, Task.parse("wrench", "tool", 0.3), mode=mode, faults=2)
    q = postures_of(panda, campaign(20, 5), 3)
    assert_same_answers(numpy_path.NumpyEvaluator(plan)(q), plan.evaluator()(q))


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize("name", ["panda", "ur5", "dh5", "tiago"])
def test_numpy_settles_what_the_fast_kernels_leave(name, mode):
    """With the same verdicts and ranks as the accurate kernels, also of whole stacks."""
    robot, settled = ftforce.load_robot(name), 0
    for seed, (words, length, axes) in enumerate(TASKS):
        plan = plan_of(robot, Task.parse(words, axes, length), mode=mode, asks=seed != 1)
        q = postures_of(robot, campaign(20, 64), seed)
        by_numpy = SparingEvaluator(plan)
        by_numpy.spare = 10_000
        assert_same_answers(by_numpy(q), plan.evaluator()(q))
        settled += 10_000 - by_numpy.spare
    assert settled > 0


def test_many_undecided_postures_are_left_to_the_accurate_kernels(dh5, monkeypatch):
    plan = plan_of(dh5, Task.parse("wrench", "tool", 0.3), mode="locked", asks=True)
    q, told = postures_of(dh5, 64, 1), []
    monkeypatch.setattr(compiled, "_announce", lambda *_: told.append(1))
    monkeypatch.setattr(compiled, "_is_ready", lambda _: False)
    monkeypatch.setattr(compiled, "_record", lambda *_: None)
    few = SparingEvaluator(plan)
    few.spare = 40
    assert_same_answers(few(q), plan.evaluator()(q))  # five joints lose a direction everywhere
    assert (few.spare, told) == (0, [1])
    few(q)
    assert told == [1]


def test_what_is_stored_does_not_depend_on_what_is_compiled(dh5, monkeypatch):
    monkeypatch.setattr(compiled, "_is_ready", lambda _: False)
    question, sets = module.sweep_question(dh5), AllFaultSets.parse(dh5, 1, "locked")
    given = (question, sets, Listed.of(dh5, np.zeros((4, 5))))
    jobs = [module.request_of(*given, keep=keep, cell=None).job for keep in ("summary", "worst")]
    assert [sparing(job).evaluator_type for job in jobs] == [SparingEvaluator, None]
    assert [compiled._needed(job) for job in jobs] == [
        "three",
        "three-accurate",
    ]
    monkeypatch.setattr(compiled, "_is_ready", lambda kind: kind.endswith("-accurate"))
    assert sparing(jobs[0]) is jobs[0]


# ---- whole sweeps ------------------------------------------------------------------------------


@pytest.fixture
def cold(monkeypatch):
    """Make this process believe that no kernel is compiled."""
    monkeypatch.setattr(compiled, "is_ready", lambda *_: False)
    monkeypatch.setattr(compiled, "_ready", set())
    monkeypatch.setattr(compiled, "_spent", defaultdict(float))


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("panda", {"n": 2000, "force": [80, 50, 10], "faults": 2}),
        ("ur5", {"n": 500, "task": "wrench", "length": 0.3, "direction": [0, 0, 1, 0, 0, 0]}),
        ("dh5", {"n": 300, "mode": "free", "payload": 0.5}),
    ],
)
def test_both_paths_count_alike(name, asked, cold):
    robot = ftforce.load_robot(name)
    found = sweep(robot, **asked)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "is_ready", lambda *_: True)
        expected = sweep(robot, **asked)
    assert (found.setting.computed_with, expected.setting.computed_with) == ("numpy", "kernels")
    for key, values in expected.summary.arrays().items():
        if key.endswith("_at"):  # the first of those that are equal but for rounding
            continue
        if values.dtype.kind == "i":
            np.testing.assert_array_equal(found.summary.arrays()[key], values, key)
        else:
            np.testing.assert_allclose(found.summary.arrays()[key], values, rtol=1e-7, atol=1e-9)


FRESH = """
import json, sys
import ftforce
found = ftforce.sweep(ftforce.load_robot("dh5"), n=2000)
loaded = [name for name in ("numba", "zarr", "xarray", "dask") if name in sys.modules]
print(json.dumps([found.setting.computed_with, loaded]))
"""


def test_a_fresh_installation_does_not_even_import_the_compiler(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    environment.pop("NUMBA_DISABLE_JIT", None)
    command = [sys.executable, "-c", FRESH]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == ["numpy", []]


def test_a_large_sweep_says_what_it_waits_for(dh5, cold, monkeypatch, capsys):
    monkeypatch.setattr(compiled, "MOST_NUMPY_SECONDS", 0.0)
    monkeypatch.setattr(compiled, "load_kernels", lambda _: None)
    monkeypatch.setattr(compiled, "_recorded", lambda: {("other key", "three"): 31.4})
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    found = sweep(dh5, n=2000)
    assert found.setting.computed_with == "kernels"
    said = "compiling the kernels for this kind of question, once per installation: about 31 s\n"
    assert capsys.readouterr().err == said


def test_the_first_remapper_says_what_it_waits_for(dh5, cold, monkeypatch, capsys):
    monkeypatch.setattr(compiled, "_recorded", cache(dict))
    monkeypatch.setattr(compiled, "_folders", lambda: iter(()))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    ftforce.Remapper(dh5)
    said = "compiling the kernel of remappers of this kind, once per installation: about 7 s\n"
    assert capsys.readouterr().err == said
    ftforce.Remapper(dh5)
    assert not capsys.readouterr().err


def test_many_small_sweeps_are_worth_compiling_in_the_end(dh5, cold, monkeypatch):
    monkeypatch.setattr(compiled, "load_kernels", lambda _: None)
    monkeypatch.setattr(compiled, "_numpy_seconds", lambda _: 3.0)
    found = [sweep(dh5, n=10).setting.computed_with for _ in range(6)]
    assert found == ["numpy"] * 5 + ["kernels"]


def test_a_sweep_is_resumed_with_what_it_was_begun_with(dh5, cold, tmp_path, monkeypatch):
    asked = {"n": 4200, "chunk": 4096, "force": [80, 50, 10], "keep": "worst", "threads": 1}
    whole = sweep(dh5, **asked, output=tmp_path / "whole")
    write, written = store.write_samples, []

    def write_one(*given):
        if written:
            raise KeyboardInterrupt
        written.append(1)
        return write(*given)

    with monkeypatch.context() as patch:
        patch.setattr(store, "write_samples", write_one)
        with pytest.raises(KeyboardInterrupt):
            sweep(dh5, **asked, output=tmp_path / "resumed")
    monkeypatch.setattr(compiled, "is_ready", lambda *_: True)
    resumed = sweep(dh5, **asked, output=tmp_path / "resumed")
    assert whole.setting.computed_with == resumed.setting.computed_with == "numpy"
    for name, values in whole.dataset.variables.items():
        np.testing.assert_array_equal(resumed.dataset[name], values, name)
    again = ftforce.open_sweep(tmp_path / "resumed")
    assert again.setting.computed_with == "numpy"
    repeated = sweep(dh5, **asked, output=tmp_path / "resumed")  # it is complete
    assert repeated.setting.computed_with == "numpy"


def test_kernels_are_known_only_for_the_same_code_and_processor(tmp_path, monkeypatch, dh5):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled, "_ready", set())
    compiled._recorded.cache_clear()
    question = module.sweep_question(dh5)
    plan = Plan.of(question, tuple(fault_sets(5, 1, FaultMode.LOCKED)), needs_gravity=True)
    wrench = replace(plan, question=plan.question._replace(rows=np.arange(6)))
    assert not compiled.is_ready(plan)
    compiled._record("three-capability", 12.34)
    assert compiled.is_ready(plan)
    assert not compiled.is_ready(plan, "three" + compiled.ACCURATE)
    assert not compiled.is_ready(wrench)
    monkeypatch.setattr(compiled, "_ready", set())
    assert not compiled.is_ready(plan)  # no compiled kernel is in the folder
    other = tmp_path / "kernels_of_another_installation"
    other.mkdir()
    (other / "kernel.nbi").touch()
    compiled._recorded.cache_clear()
    assert not compiled.is_ready(plan)
    own = _CacheLocator.get_suitable_cache_subpath(str(compiled._KERNELS / "fast.py"))
    (tmp_path / own).mkdir()
    (tmp_path / own / "kernel.nbi").touch()
    compiled._recorded.cache_clear()
    assert compiled.is_ready(plan)
    with monkeypatch.context() as patch:  # numba does not read where it cannot write
        patch.setattr(os, "access", lambda *_: False)
        compiled._recorded.cache_clear()
        assert not compiled.is_ready(plan)
    compiled._recorded.cache_clear()
    assert compiled.is_ready(plan)
    monkeypatch.setattr(compiled, "_key", lambda: "another processor")
    assert not compiled.is_ready(plan)
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # nothing will be compiled
    assert compiled.is_ready(plan)
    compiled._recorded.cache_clear()
