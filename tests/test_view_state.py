"""What is asked on the page, and the command line that asks the same."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import ftforce
from ftforce import cli
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.errors import DimensionError, InputError, UnknownNameError
from ftforce.report.files import to_dict
from ftforce.robot.dynamics import Payload
from ftforce.robot.posture import choose_posture
from ftforce.view.model.answer import answer
from ftforce.view.model.state import (
    FIRST_FORCE,
    Origin,
    command_line,
    meant_position,
    shown_position,
)
from helpers import initial_state
from urdfs import arm, joint


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def asked(robot, name="panda", **options):
    return initial_state(robot, origin=Origin(name), **options)


def by_command(robot, state):
    """Run the command of a state; return its JSON and what the page has, sources apart."""
    words = shlex.split(command_line(robot, state))
    assert words[:2] == ["ftforce", "analyze"]
    result = CliRunner().invoke(cli.app, [*words[1:], "--format", "json"])
    assert result.exit_code == 0, result.output
    pair = json.loads(result.stdout), json.loads(json.dumps(to_dict(answer(robot, state).analysis)))
    for one in pair:
        one["posture"].pop("source")
    return pair


def assert_same_by_command(robot, state):
    printed, shown = by_command(robot, state)
    assert printed == shown  # every digit


def test_a_page_starts_with_a_force_that_can_be_seen(panda):
    state = asked(panda)
    assert state.force.tolist() == [FIRST_FORCE] * 3
    assert asked(panda, task="moment").force.tolist() == [FIRST_FORCE] * 3
    assert asked(panda, task="wrench").force.tolist() == [FIRST_FORCE] * 3 + [0.0] * 3
    assert asked(panda, force=[1, 2, 3]).force.tolist() == [1, 2, 3]
    assert set(state.modes) == {"healthy"}
    assert command_line(panda, state) == "ftforce analyze panda --force=20.0,20.0,20.0"


@pytest.mark.parametrize("seed", range(12))
def test_the_command_gives_the_pages_numbers(panda, seed):
    rng = np.random.default_rng(seed)
    state = asked(panda).at(choose_posture(panda).q + 0.2 * rng.normal(size=panda.n))
    for i in rng.choice(panda.n, size=int(rng.integers(0, 4)), replace=False):
        state = state.failing(int(i), str(rng.choice(["locked", "free", "weak"])), rng.random())
    task = str(rng.choice(["force", "wrench", "fx,fz", "moment", "mz,fy"]))
    state = state.asking(task, str(rng.choice(["tool", "world"])), float(0.1 + rng.random()))
    state = state.pushing(30.0 * rng.normal(size=6)).weighing(bool(rng.random() < 0.7))
    state = state.limited(bool(rng.random() < 0.5))
    if rng.random() < 0.5:
        state = state.carrying(Payload.of(rng.random(), 0.1 * rng.normal(size=3)))
    if rng.random() < 0.2:
        state = state.loaded("every direction")
    assert_same_by_command(panda, state)


@pytest.mark.parametrize(
    "options",
    [
        {"torque": [1e-7, 2.5, -3, 4, 5, 6, 0.1], "inverse": "dynamic"},
        {"gravity": [0, 1.5, -1e-3], "payload": "2.5@0,0,0.1", "rtol": 1e-5, "wary": 0.03},
        {"velocity": [0.1] * 7, "acceleration": [-1 / 3] * 7, "locked": "2,panda_joint4"},
        {"weak": {3: 1 / 3}, "free": [5], "limits": "urdf", "axes": "world"},
        {"weak": {3: 0.7}, "limits": "none"},
        {"weak": {3: 0.7}},
    ],
)
def test_the_command_repeats_every_option(panda, options):
    assert_same_by_command(panda, asked(panda, **options))


def test_limits_of_a_file_are_named_in_the_command(panda, tmp_path):
    path = tmp_path / "limits of it's own.csv"  # what a shell would tear apart
    path.write_text("joint,effort,brake\n2,40,60\npanda_joint4,20,\n")
    state = asked(panda, limits=path, locked=[2])
    assert shlex.quote(f"--limits={path}") in command_line(panda, state)
    assert_same_by_command(panda, state)
    assert "--limits=none" in command_line(panda, state.limited(False))
    assert state.limited(False).limited(True).question(panda).limits is state.limits


DRIVES = """joint,effort,stall_torque,no_load_speed,friction,damping,armature
2,40,60,2,1.5,0.5,0.3
panda_joint4,20,25,1,0.5,,0.1
"""


@pytest.mark.parametrize(("rubs", "rotors"), [(True, False), (False, True), (True, True)])
def test_drives_count_as_on_the_command_line(panda, tmp_path, rubs, rotors):
    path = tmp_path / "motors.csv"
    path.write_text(DRIVES)
    moving = {"velocity": [0.0, 1.0, 0, 0.5, 0, 0.2, 0], "acceleration": [0.1, 2.0] + [0.0] * 5}
    plain = asked(panda, limits=path, locked=[6], **moving)
    state = plain.rubbing(rubs).with_rotors(rotors)
    command = command_line(panda, state)
    assert ("--joint-friction" in command, "--armature" in command) == (rubs, rotors)
    assert_same_by_command(panda, state)
    found, bare = (answer(panda, one).loads for one in (state, plain))
    # Joint 2: Coulomb 1.5 N·m, viscous 0.5 N·m·s and rotor 0.3 kg·m² at 1 rad/s and 2 rad/s².
    assert found[1].before - bare[1].before == pytest.approx(2.0 * rubs + 0.6 * rotors)
    assert found[1].limit == (30.0 if found[1].after > 0.0 else 40.0)  # half of the stall torque
    started = asked(panda, limits=path, locked=[6], joint_friction=rubs, armature=rotors, **moving)
    assert command_line(panda, started) == command
    # Without the limits, the drives are those of the URDF, which knows only their friction.
    assert_same_by_command(panda, state.limited(False))


def test_joints_called_by_numbers_are_named_so_that_the_right_one_fails(tmp_path):
    text = arm(j2=joint("3", "l1", "l2"), j3=joint("two", "l2", "l3"))
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    robot = ftforce.load_robot(path)
    state = asked(robot, str(path)).failing(2, "locked")
    assert "--locked=two" in command_line(robot, state)
    assert_same_by_command(robot, state)


def test_the_command_of_a_pinocchio_model_names_a_file_and_not_a_known_robot():
    model = pin.buildSampleModelManipulator()
    model.name = "panda"
    robot = ftforce.Robot.from_model(model, tip="wrist2_body")
    state = initial_state(robot)
    assert command_line(robot, state).startswith("ftforce analyze panda.urdf --force=")
    assert command_line(robot, state).endswith(" --tip=wrist2_body")
    assert "needs a file of the same arm" in state.origin.note


def test_the_posture_of_the_start_is_named_until_it_changes(panda):
    origin = Origin("panda", posture="zero")
    state = initial_state(panda, origin=origin)
    assert "--posture=zero" in command_line(panda, state)
    assert "--q=" not in command_line(panda, state)
    moved = state.with_joint(3, -0.1)
    assert "--posture" not in command_line(panda, moved)
    assert "--q=0.0,0.0,0.0,-0.1,0.0,0.0,0.0" in command_line(panda, moved)
    chosen = asked(panda).in_posture(choose_posture(panda, None, "mid-range"))
    assert "--q=" in command_line(panda, chosen)
    assert_same_by_command(panda, chosen)


def test_a_change_leaves_the_old_question_as_it_was(panda):
    state = asked(panda)
    before = command_line(panda, state)
    q = state.q.copy()
    state.with_joint(0, 1.0).failing(1, "free").pushing(np.ones(6)).limited(True).weighing(False)
    state.showing(census=2)
    assert command_line(panda, state) == before
    assert np.array_equal(state.q, q)
    with pytest.raises(ValueError, match="read-only"):
        state.with_joint(0, 1.0).q[0] = 3.0


def test_what_a_task_lacks_comes_back_with_it(panda):
    whole = [1, 2, 3, 4, 5, 6]
    some = asked(panda).pushing(whole).asking("fz,mx", "tool")
    assert some.force.tolist() == [3, 4]
    assert some.asking("wrench", "tool").force.tolist() == whole


def test_a_factor_is_kept_while_the_joint_is_not_weak(panda):
    state = asked(panda).failing(2, "weak", 0.3).failing(2, "locked").failing(2, "weak")
    assert state.faults == FaultSet((Fault(2, FaultMode.WEAK, 0.3),))
    other = state.with_faults(FaultSet.locked([0, 5]))
    assert other.faults == FaultSet.locked([0, 5])
    assert other.failing(2, "weak").factors[2] == 0.3


def test_limits_count_as_analyze_has_it(panda):
    state = asked(panda)
    assert not state.counts_limits
    assert state.failing(1, "weak").counts_limits  # a weak joint is nothing without
    assert state.limited(False) is state
    assert state.limited(True).counts_limits
    assert not state.failing(1, "weak").limited(False).counts_limits


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda s: s.at([0.0, 1.0]), DimensionError),
        (lambda s: s.with_joint(0, float("nan")), InputError),
        (lambda s: s.failing(0, "broken"), UnknownNameError),
        (lambda s: s.failing(0, "weak", 1.5), InputError),
        (lambda s: s.failing(0, "weak", float("nan")), InputError),
        (lambda s: s.pushing([1, 2, 3]), DimensionError),
        (lambda s: s.loaded("torques"), InputError),
        (lambda s: s.loaded("wind"), UnknownNameError),
        (lambda s: s.asking("fq", "tool"), UnknownNameError),
        (lambda s: s.asking("force", "sky"), UnknownNameError),
        (lambda s: s.asking("wrench", "tool", 0.0), InputError),
    ],
)
def test_what_cannot_be_asked_is_refused(panda, change, error):
    with pytest.raises(error):
        change(asked(panda))


def test_a_start_that_cannot_be_is_refused_as_by_analyze(panda):
    for wrong in (
        {"force": [1, 2, 3], "torque": [0.0] * 7},
        {"inverse": "sideways"},
        {"locked": "9"},
        {"rtol": -1.0},
        {"limits": "nowhere.toml"},
    ):
        with pytest.raises(ftforce.FtforceError):
            asked(panda, **wrong)


def test_the_census_depends_on_what_it_says(panda):
    state = asked(panda)
    assert state.failing(1, "locked").census_essence() == state.census_essence()
    for other in (
        state.with_joint(0, 0.1),
        state.pushing(np.ones(6)),
        state.weighing(False),
        state.limited(True),
        state.failing(1, "weak"),  # limits count then
        state.asking("fx", "tool"),
        state.asking("force", "world"),
        state.carrying(Payload.of(1.0)),
        state.rubbing(True),
        state.with_rotors(True),
        state.showing(census=2),
        state.loaded("every direction"),
    ):
        assert other.census_essence() != state.census_essence()


def test_positions_are_shown_in_degrees_or_metres():
    assert shown_position("rad", np.pi) == pytest.approx(180.0)
    assert shown_position("m", 0.25) == 0.25
    for unit in ("rad", "m"):
        assert meant_position(unit, shown_position(unit, 0.3)) == pytest.approx(0.3)
