"""The kernels say what `analyze` says; few postures, so that they also run as plain Python.

With ``NUMBA_DISABLE_JIT=1`` coverage sees their lines.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import ftforce
from ftforce.batch.drawn import Drawn
from ftforce.batch.mechanism import mechanism_of
from ftforce.batch.plan import Plan, faults_of, question_of
from ftforce.faults import FaultSet, fault_sets
from ftforce.limits_reader import choose_limits
from ftforce.task import Task

if TYPE_CHECKING:
    from ftforce.arrays import Matrix
    from ftforce.batch.results import Block
    from ftforce.robot import Robot

VERDICTS = ("tolerated", "borderline", "not tolerated")


def answers(
    robot: Robot, q: Matrix, sets: tuple[FaultSet, ...], task: Task, force: Any, **asked: Any
) -> Block:
    """Return what the kernels say."""
    plan = Plan(
        mechanism_of(robot),
        faults_of(sets, robot.n),
        question_of(
            task, robot.n, force=force, rtol=1e-6, wary=1e-2, weighs=True,
            **{"direction": None, "limits": None, **asked},
        ),
        robot.n,
        bool(task.force_rows and task.moment_rows),
    )  # fmt: skip
    with np.errstate(all="ignore"):  # plain Python warns where compiled code does not
        return plan.evaluator()(q)


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize(
    ("name", "components", "axes"),
    [
        ("panda", "force", "tool"),
        ("panda", "wrench", "tool"),
        ("dh5", "force", "world"),
        ("ur5", "fz,fx", "tool"),
        ("kinova", "wrench", "world"),
        ("ur5", "fz", "tool"),
    ],
)
def test_kernels_say_what_analyze_says(name: str, components: str, axes: Any, mode: Any) -> None:
    robot = ftforce.load_robot(name)
    task = Task.parse(components, axes, 0.3)
    sets = (FaultSet(), *fault_sets(robot.n, 1, mode))
    q = np.vstack([np.zeros(robot.n), Drawn.of(robot, 3, seed=3).block(0, 3)])
    force = np.linspace(40.0, -15.0, task.m)
    block = answers(robot, q, sets, task, force)
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


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_capability_is_that_of_the_census(mode: Any) -> None:
    robot = ftforce.load_robot("panda")
    task, direction = Task.parse("force", "world"), np.array([0.0, 0.6, 0.8])
    limits = choose_limits(robot, "urdf")
    sets = tuple(fault_sets(robot.n, 1, mode))
    q = Drawn.of(robot, 3, seed=5).block(0, 3)
    block = answers(robot, q, sets, task, None, direction=direction, limits=limits)
    assert block.capability is not None
    for i, posture in enumerate(q):
        result = ftforce.census(
            robot, posture, mode=mode, axes="world", rank_by="capability", direction=direction
        )
        for report in result.sets:
            s = sets.index(report.faults)
            assert report.capability is not None
            assert block.capability[s, i] == pytest.approx(
                report.capability.commanded, rel=1e-8, abs=1e-9, nan_ok=True
            )
