"""The question is parsed once, whoever asks it, and shared options are declared once."""

from __future__ import annotations

import inspect
from collections import Counter, defaultdict
from functools import partial

import numpy as np
import pytest

import ftforce
from ftforce import cli
from ftforce.analysis import fault_set
from ftforce.analysis.question import AllFaultSets, Question
from ftforce.core.faults import FaultMode
from ftforce.core.task import Task
from ftforce.errors import InputError
from ftforce.trajectory import Path
from helpers import initial_state

LINE = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.05)
PUSH = {"force": [80, 50, 10], "task": "force"}

ASKED = {
    "analyze": lambda arm: ftforce.analyze(arm, locked=[2], **PUSH),
    "census": lambda arm: ftforce.census(arm, faults=2, **PUSH),
    "capability": lambda arm: ftforce.capability(arm, locked=[2], task="force"),
    "simulate": lambda arm: ftforce.simulate(arm, LINE, faults="3@1", rate=5, **PUSH),
    "timeline": lambda arm: ftforce.timeline(arm, LINE, rate=5, **PUSH),
    "sweep": lambda arm: ftforce.sweep(arm, n=16, **PUSH),
    "Remapper": lambda arm: ftforce.Remapper(arm, [[2]], task="force"),
    "page": lambda arm: initial_state(arm, locked=[2], **PUSH),
}


@pytest.mark.parametrize("ask", ASKED.values(), ids=ASKED)
def test_a_question_is_parsed_once(monkeypatch, ask):
    calls = Counter()

    def counted(kind, name):
        real = getattr(kind, name).__func__

        def count(cls, *args, **options):
            calls[kind.__name__] += 1
            return real(cls, *args, **options)

        monkeypatch.setattr(kind, name, classmethod(count))

    arm = ftforce.load_robot("dh5")
    counted(Question, "parse")
    counted(Task, "parse")
    ask(arm)
    assert calls == {"Question": 1, "Task": 1}


def test_every_arm_of_a_comparison_is_asked_once(monkeypatch):
    real, robots = Question.parse.__func__, []

    def counted(cls, robot, **options):
        robots.append(robot.name)
        return real(cls, robot, **options)

    monkeypatch.setattr(Question, "parse", classmethod(counted))
    ftforce.compare(["dh5", "kinova"], n=16, force=[1, 2, 3])
    assert sorted(robots) == ["dh5", "kinova"]


def test_a_cell_of_a_timeline_is_decomposed_once(monkeypatch):
    calls = Counter()
    real = fault_set.reduce_decomposed

    def counted(*args):
        calls["decompositions"] += 1
        return real(*args)

    monkeypatch.setattr(fault_set, "reduce_decomposed", counted)
    dh5, case = ftforce.load_robot("dh5"), {"faults": 2, "rate": 5, **PUSH}
    instants, sets = ftforce.timeline(dh5, LINE, **case).verdict.shape
    worst = 2 * (sets + 1)  # each set, and the healthy arm, once more at its worst instant
    assert calls["decompositions"] - worst < instants * sets / 10  # where a tolerance might matter
    calls.clear()
    ftforce.timeline(dh5, LINE, mode="free", **case)  # which no stack answers
    assert calls["decompositions"] - worst == instants * (sets + 2)  # J, and the healthy arm's K


def test_the_parts_of_a_question(panda):
    question = Question.parse(
        panda,
        force=[3, 4, 0, 1, 0, 0],
        direction=[0, 0, 2, 0, 0, 5],
        limits="urdf",
        task="wrench",
        length=0.5,
    )
    np.testing.assert_array_equal(question.F, [3, 4, 0, 2, 0, 0])
    np.testing.assert_array_equal(question.direction, [0, 0, 1, 0, 0, 2.5])
    assert question.direction_or_that_of(question.F) is question.direction
    assert question.limits.source == "urdf"
    assert question.posture is None
    assert not question.faults.faults
    with pytest.raises(AttributeError):
        question.force = None


def test_the_direction_of_a_force(panda):
    question = Question.parse(panda, force=[3, 4, 0])
    np.testing.assert_allclose(question.direction_or_that_of(question.F), [0.6, 0.8, 0])
    assert question.direction_or_that_of(np.zeros(3)) is None
    assert question.direction_or_that_of(None) is None


def test_all_sets_up_to_a_size(panda):
    sets = AllFaultSets.parse(panda, 2, "free")
    assert len(sets) == len(list(sets)) == 7 + 21
    assert {one.faults[0].mode for one in sets} == {FaultMode.FREE}
    for faults in (0, 8, True, 1.0):
        with pytest.raises(InputError, match="faults must be an integer from 1 to 7"):
            AllFaultSets.parse(panda, faults, "locked")


# Options that mean something of their own in one command.
OWN = {
    ("sweep", "output"), ("simulate", "output"), ("dh", "output"),
    ("simulate", "robot"), ("simulate", "force"), ("sweep", "samples"), ("compare", "samples"),
    ("sweep", "cell"), ("compare", "cell"), ("sweep", "deg"), ("map", "top"),
    ("capability", "limits"), ("sweep", "limits"), ("compare", "limits"), ("view", "at"),
    ("map", "at"), ("view", "sweep"), ("map", "sweep"), ("replicate", "robot"),
    ("replicate", "force"), ("replicate", "velocity"), ("sweep", "topic"),
    ("posture", "output"), ("plan", "output"), ("reach", "output"), ("reach", "task"),
}  # fmt: skip


def test_options_of_several_commands_are_declared_once():
    declared = defaultdict(list)
    for command in cli.app.registered_commands:
        name = command.callback.__name__
        for option in inspect.signature(command.callback).parameters.values():
            if (name, option.name) not in OWN:
                declared[option.name].append(option.annotation)
    assert len(declared["task"]) == 10
    for name, found in declared.items():
        assert all(one is found[0] for one in found), name


@pytest.mark.parametrize(
    "ask",
    [
        ftforce.analyze,
        ftforce.capability,
        ftforce.census,
        ftforce.Remapper,
        partial(ftforce.simulate, trajectory="path.csv", force=[1, 2, 3]),
        partial(ftforce.sweep, n=10),
        partial(ftforce.timeline, trajectory="path.csv"),
    ],
    ids=["analyze", "capability", "census", "Remapper", "simulate", "sweep", "timeline"],
)
def test_what_is_no_robot_is_told_where_it_belongs(ask):
    """A Jacobian goes to the array core, a name to `load_robot`."""
    core = r"^a robot is needed, as of ftforce\.load_robot\('panda'\), got {}; "
    core += r"for a Jacobian from any library, use ftforce\.remap\(J, tau, locked\) "
    core += r"or ftforce\.Remapper\(m=3, n=7, faults=\.\.\.\)$"
    for wrong, message in (
        (np.zeros((3, 7)), core.format(r"an array of shape \(3, 7\)")),
        (None, core.format("NoneType")),
        ([[1.0, 2.0]], core.format("list")),
        ("panda", r"^a robot is needed, not the name 'panda': .* ftforce\.load_robot\('panda'\)$"),
    ):
        with pytest.raises(InputError, match=message):
            ask(wrong)


def test_progress_must_be_a_function():
    arm = ftforce.load_robot("dh5")
    line = ftforce.trajectory.Path.through([(0.9, 0.3, 0.2), (0.88, 0.31, 0.21)], speed=0.2)
    for ask in (
        lambda progress: ftforce.census(arm, progress=progress),
        lambda progress: ftforce.timeline(arm, line, progress=progress),
        lambda progress: ftforce.simulate(arm, line, force=[1, 2, 3], progress=progress),
        lambda progress: ftforce.sweep(arm, n=8, progress=progress),
        lambda progress: ftforce.compare([arm, "ur5"], n=8, progress=progress),
    ):
        with pytest.raises(InputError, match="progress is a function of what is done"):
            ask(np.ones(2))
