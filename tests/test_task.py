"""Tasks: components, their units, and how moments are weighed against forces."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

import ftforce
from ftforce.core.task import Task
from ftforce.errors import InputError, UnknownNameError
from helpers import assert_close

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@pytest.mark.parametrize(
    ("given", "components"),
    [
        ("force", WRENCH[:3]),
        ("moment", WRENCH[3:]),
        ("wrench", WRENCH),
        ("fx", ("fx",)),
        (" FZ, my ", ("fz", "my")),
        (["fy", "fx"], ("fy", "fx")),
        (("force", "mz"), ("fx", "fy", "fz", "mz")),
        ("my,force", ("my", "fx", "fy", "fz")),
    ],
)
def test_words_become_components(given, components):
    task = Task.parse(given)
    assert task.components == components
    assert task.m == len(components)
    assert (task.axes, task.length) == ("tool", 1.0)


@pytest.mark.parametrize(
    ("components", "word"),
    [("force", "force"), (WRENCH, "wrench"), ("mx,my,mz", "moment"), ("fz,fx", "fz,fx")],
)
def test_prints_its_shorthand_or_its_components(components, word):
    assert str(Task.parse(components)) == word


@pytest.mark.parametrize("components", ["force", "moment", "wrench", "fy,fz", "fx,fz,my", "mz,fx"])
def test_rows_select_the_components_in_their_order(components):
    J = np.arange(18.0).reshape(6, 3)
    task = Task.parse(components)
    expected = np.array([J[WRENCH.index(name)] for name in task.components])
    np.testing.assert_array_equal(J[task.rows], expected)


def test_units_and_velocities_of_each_component():
    task = Task.parse("fx,mz,fy")
    assert task.units == ("N", "N·m", "N")
    assert task.velocity_units == ("m/s", "rad/s", "m/s")
    assert task.velocity_components == ("vx", "wz", "vy")
    assert (task.force_rows, task.moment_rows) == ((0, 2), (1,))


def test_moments_are_weighed_by_the_characteristic_length():
    task = Task.parse("fx,my", length=0.25)
    assert_close(task.weigh_jacobian(np.array([[1.0, 2.0], [4.0, 8.0]])), [[1, 2], [1, 2]])
    assert_close(task.weigh_force(np.array([3.0, 1.0])), [3, 4])
    assert_close(task.unweigh_force(np.array([3.0, 4.0])), [3, 1])
    assert_close(task.unweigh_velocity(np.array([3.0, 1.0])), [3, 4])


def test_weighing_keeps_power_and_torques():
    rng = np.random.default_rng(1)
    task = Task.parse("wrench", length=0.3)
    J, F, v = rng.normal(size=(6, 7)), rng.normal(size=6), rng.normal(size=7)
    assert_close(task.weigh_force(F) @ task.weigh_jacobian(J), F @ J)
    assert_close(task.unweigh_velocity(task.weigh_jacobian(J) @ v), J @ v)
    assert_close(task.unweigh_force(task.weigh_force(F)), F)


@pytest.mark.parametrize("task", [Task.parse("force", length=0.3), Task.parse("wrench", length=1)])
def test_nothing_is_weighed_without_moments_or_with_one_metre(task):
    assert task.weights is None
    J = np.ones((task.m, 2))
    assert task.weigh_jacobian(J) is J


@pytest.mark.parametrize("length", [1e-6, 1e6])
def test_lengths_at_the_ends_are_computed_with(length):
    arm = ftforce.load_robot("panda")
    result = ftforce.analyze(
        arm, locked=[2], force=[1, 2, 3, 4, 5, 6], task="wrench", length=length
    )
    assert np.isfinite(result.force.after).all()
    assert np.isfinite(result.torque.after).all()
    assert result.is_proved()


def test_tasks_compare_and_hash_by_what_they_ask():
    task = Task.parse("wrench", "world", 0.3)
    assert Task.parse(task) is task
    assert Task.parse("force") == Task()
    assert hash(Task.parse("fx,fy,fz")) == hash(Task())
    assert Task.parse("force", "world") != Task()
    assert Task.parse("wrench", length=0.5) != Task.parse("wrench")


def test_tasks_are_frozen_and_can_be_pickled():
    task = Task.parse("fx,my", "world", 0.2)
    with pytest.raises(FrozenInstanceError):
        task.length = 1.0
    assert task.weights is not None  # computed before pickling
    assert pickle.loads(pickle.dumps(task)) == task


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"task": "thrust"},
            "unknown task component 'thrust'; available: force, moment, wrench, fx",
        ),
        ({"task": "forces"}, "did you mean 'force'"),
        ({"task": ""}, "unknown task component ''; available: force"),
        ({"axes": "base"}, "unknown axes 'base'; available: tool, world"),
        ({"axes": None}, "unknown axes None; available: tool, world"),
    ],
)
def test_unknown_words_are_answered_with_the_known_ones(given, message):
    with pytest.raises(UnknownNameError, match=message):
        Task.parse(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"task": "fx,fx"}, "the task 'fx,fx' must have one or more components"),
        ({"task": "force,fy"}, "must have one or more components, each only once"),
        ({"task": []}, "must have one or more components, each only once"),
        ({"length": 0}, r"must lie between 1e-06 and 1e\+06 m, got 0"),
        ({"length": 0.99e-6}, "must lie between"),
        ({"length": 1.01e6}, "must lie between"),
        ({"length": np.nan}, "must lie between"),
    ],
)
def test_malformed_tasks(given, message):
    with pytest.raises(InputError, match=message):
        Task.parse(**given)
