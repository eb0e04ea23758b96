"""The kernels say what `analyze` says; few postures, so that they also run as plain Python.

With ``NUMBA_DISABLE_JIT=1`` coverage sees their lines.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import ftforce
from ftforce.analysis.limits_files import choose_limits
from ftforce.batch.postures.drawn import Drawn
from ftforce.core.faults import Fault, FaultMode, FaultSet, fault_sets
from ftforce.core.task import Task
from results import answers_of

pytestmark = pytest.mark.plain

VERDICTS = ("tolerated", "borderline", "not tolerated")


@pytest.mark.thorough
@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize(
    ("name", "components", "axes"),
    [
        ("panda", "force", "tool"),
        ("kinova", "wrench", "world"),
        ("panda", "wrench", "tool"),
        ("dh5", "force", "world"),
        ("ur5", "fz,fx", "tool"),
        ("ur5", "fz", "tool"),
    ],
)
def test_kernels_say_what_analyze_says(name: str, components: str, axes: Any, mode: Any) -> None:
    robot = ftforce.load_robot(name)
    task = Task.parse(components, axes, 0.3)
    pair = tuple(Fault(joint, FaultMode.parse(mode)) for joint in (1, 3))
    sets = (FaultSet(), *fault_sets(robot.n, 1, mode), FaultSet(pair))
    q = np.vstack([np.zeros(robot.n), Drawn.of(robot, 3, seed=3).block(0, 3)])
    force = np.linspace(40.0, -15.0, task.m)
    block = answers_of(robot, q, sets, task, force=force)
    for i, posture in enumerate(q):
        for s, one in enumerate(sets):
            failed = [joint + 1 for joint in one.joints]
            expected = ftforce.analyze(robot, posture, force=force, task=task, **{mode: failed})
            assert VERDICTS[block.verdict[s, i]] == expected.verdict.value
            assert block.rank_lost[s, i] == expected.reduced.rank - expected.reduced.rank_after
            assert block.margin[s, i] == pytest.approx(expected.margin, rel=1e-8, abs=1e-13)
            rho = expected.relative_manipulability
            assert block.rho[s, i] == pytest.approx(rho, rel=1e-8, abs=1e-12, nan_ok=True)
            assert expected.force is not None
            jump = expected.force.jump_norm
            jump = np.nan if jump is None else jump
            assert block.jump is not None
            assert block.jump[s, i] == pytest.approx(jump, rel=1e-8, abs=1e-9, nan_ok=True)


def mixed(words: str) -> FaultSet:
    """Return a fault set of words like ``1 locked, 3 free``, joints from 1."""
    parts = (part.split() for part in words.split(","))
    return FaultSet(tuple(Fault(int(joint) - 1, FaultMode.parse(mode)) for joint, mode in parts))


@pytest.mark.thorough
@pytest.mark.parametrize("asks", [True, False])
@pytest.mark.parametrize(
    ("name", "components", "words"),
    [
        ("panda", "force", ["1 locked, 3 locked, 5 locked, 7 locked", "7 free"]),
        ("panda", "force", ["1 free, 2 free, 4 free, 6 free", "2 free, 4 locked"]),
        ("panda", "force", ["1 locked, 2 locked, 3 locked"]),
        ("panda", "wrench", ["1 locked, 2 locked, 3 locked", "2 free, 7 locked"]),
        ("tiago", "force", ["1 locked", "1 free"]),
        ("dh5", "wrench", ["1 locked", "2 free"]),
    ],
)
def test_many_joints_fail(name: str, components: str, words: list[str], asks: bool) -> None:
    robot, task = ftforce.load_robot(name), Task.parse(components, "tool", 0.3)
    sets = tuple(map(mixed, words))
    q = np.vstack([np.zeros(robot.n), Drawn.of(robot, 9, seed=7).block(0, 9)])
    force = np.linspace(40.0, -15.0, task.m) if asks else None
    block = answers_of(robot, q, sets, task, force=force)
    for i, posture in enumerate(q):
        for s, one in enumerate(sets):
            failed = {mode: [j + 1 for j in one.in_mode(mode)] for mode in FaultMode}
            options = {"locked": failed[FaultMode.LOCKED], "free": failed[FaultMode.FREE]}
            expected = ftforce.analyze(robot, posture, force=force, task=task, **options)
            assert VERDICTS[block.verdict[s, i]] == expected.verdict.value
            assert block.rank_lost[s, i] == expected.reduced.rank - expected.reduced.rank_after
            assert block.margin[s, i] == pytest.approx(expected.margin, rel=1e-7, abs=1e-13)


def test_angles_of_many_turns() -> None:
    robot, task = ftforce.load_robot("kinova"), Task.parse("force", "world")
    sets, q = (FaultSet.locked([1]),), Drawn.of(robot, 2, seed=3).block(0, 2)
    turns = np.where(np.isinf(robot.lower), 2.0 * np.pi * 1e5, 0.0)
    near, far = (answers_of(robot, at, sets, task) for at in (q, q + turns))
    assert far.tip == pytest.approx(near.tip, abs=1e-9)
    assert far.margin == pytest.approx(near.margin, rel=1e-8)


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize(
    ("name", "components", "faults"),
    [("panda", "force", 1), ("panda", "force", 2), ("ur5", "wrench", 1), ("ur5", "fx,fz", 1)],
)
def test_capability_is_that_of_the_census(
    name: str, components: str, faults: int, mode: Any
) -> None:
    robot, task = ftforce.load_robot(name), Task.parse(components, "world", 0.3)
    direction = np.linspace(0.2, 0.8, task.m) * (np.arange(task.m) < 3)
    direction /= np.linalg.norm(direction)
    limits = choose_limits(robot, "urdf")
    sets = tuple(fault_sets(robot.n, faults, mode))
    q = Drawn.of(robot, 2, seed=5).block(0, 2)
    block = answers_of(robot, q, sets, task, direction=direction, limits=limits)
    assert block.capability is not None
    for i, posture in enumerate(q):
        options = {"mode": mode, "faults": faults, "rank_by": "capability"}
        result = ftforce.census(robot, posture, **options, task=task, direction=direction)
        for report in result.sets:
            s = sets.index(report.faults)
            assert report.capability is not None
            assert block.capability[s, i] == pytest.approx(
                report.capability.commanded, rel=1e-8, abs=1e-9, nan_ok=True
            )
