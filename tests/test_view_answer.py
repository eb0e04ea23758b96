"""The page's answer has the numbers of `analyze` and `census`."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import ftforce
from ftforce import cli
from ftforce.core.faults import FaultMode
from ftforce.errors import InputError
from ftforce.report.files import to_dict
from ftforce.view.model.answer import answer
from ftforce.view.model.state import Origin
from helpers import assert_close, initial_state
from urdfs import arm


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def document(*arguments):
    result = CliRunner().invoke(cli.app, [*arguments, "--format", "json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def plain(result):
    return json.loads(json.dumps(to_dict(result)))


CASES = {
    "healthy": ([], {}),
    "locked": (["--locked=2,4"], {"locked": [2, 4]}),
    "limits": (["--locked=3", "--limits=urdf"], {"locked": [3], "limits": "urdf"}),
    "free": (["--free=2"], {"free": [2]}),
    "weak": (["--weak=2:0.4", "--locked=6"], {"weak": {2: 0.4}, "locked": [6]}),
    "world": (["--locked=1", "--axes=world"], {"locked": [1], "axes": "world"}),
    "weightless": (["--locked=5", "--gravity=0,0,0"], {"locked": [5], "gravity": [0, 0, 0]}),
}


@pytest.mark.parametrize("case", CASES)
def test_the_page_has_the_numbers_of_analyze(panda, case):
    words, options = CASES[case]
    force = [10, 20, -60]
    state = initial_state(panda, origin=Origin("panda"), force=force, **options)
    found = answer(panda, state)
    printed = document("analyze", "panda", *words, "--force=10,20,-60")
    assert plain(found.analysis) == printed
    total = printed["torque"]["total"]
    part = printed["torque"]
    for load in found.loads:  # what the table shows, joint by joint
        name = load.name
        assert load.before == total["before"][name]
        assert load.part_before == part["before"][name]
        if printed["standing"]["can_stand_still"]:
            assert load.part_after == part["after"][name]
            by_motor = total["after"][name]  # nothing at a locked joint
            assert load.after == (0.0 if by_motor is None else by_motor)
        else:
            assert math.isnan(load.after)
        if name in printed["locked"] and printed["standing"]["can_stand_still"]:
            assert load.brake == part["brake_load"][name]


@pytest.mark.parametrize("size", [1, 2])
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_the_page_has_the_numbers_of_census(panda, size, mode):
    state = initial_state(panda, force=[10, 20, -60], limits="urdf", locked=[2])
    state = state.showing(census=size, census_mode=FaultMode(mode))
    load = ("--force=10,20,-60", "--limits=urdf")
    printed = document("census", "panda", f"--faults={size}", f"--mode={mode}", *load)
    assert plain(answer(panda, state).census) == printed
    assert printed["sets"][0]["verdict"] == "not tolerated" or size == 1


def test_a_census_is_found_once_for_all_faults(panda):
    state = initial_state(panda, limits="urdf")
    first = answer(panda, state)
    same = answer(panda, state.failing(3, "locked"), first)
    assert same.census is first.census
    for other in (state.with_joint(1, 0.2), state.weighing(False), state.pushing(np.ones(6))):
        again = answer(panda, other, first)
        assert again.census is not first.census
        assert plain(again.census) == plain(answer(panda, other).census)
    assert answer(panda, state.showing(census=0), first).census is None


def test_a_census_has_the_limits_that_a_weak_joint_brings(panda):
    found = answer(panda, initial_state(panda, weak={2: 0.5}))
    assert found.census.limits is not None
    assert found.census.limits is found.analysis.limits


def test_an_arm_that_cannot_stand_still_is_an_answer(panda):
    found = answer(panda, initial_state(panda, free=[2, 3, 4, 5, 6], force=[1, 0, 0]))
    assert not found.analysis.can_stand_still
    assert all(math.isnan(load.after) and math.isnan(load.used) for load in found.loads)
    assert all(math.isfinite(load.before) for load in found.loads)


def test_loads_without_a_force_are_what_holds_the_arm(panda):
    state = initial_state(panda, locked=[2], limits="urdf").loaded("every direction")
    found = answer(panda, state)
    weight = found.analysis.rnea.after
    assert_close([load.before for load in found.loads], weight)
    lock = found.loads[1]
    assert (lock.after, lock.brake, lock.part_before) == (0.0, weight[1], 0.0)
    others = [i for i in range(7) if i != 1]
    assert_close([found.loads[i].after for i in others], weight[others])
    # A joint that swings is held by the tip, which loads the others.
    swung = answer(panda, initial_state(panda, free=[2]).loaded("every direction"))
    J, F = swung.analysis.reduced.J, swung.analysis.bounded.F_after
    assert swung.loads[1].after == 0.0
    assert_close(swung.loads[3].after, (weight + F @ J)[3])


def test_shares_are_of_the_limits_that_count(panda, tmp_path):
    path = tmp_path / "limits.csv"
    path.write_text("joint,effort,brake\n2,40,60\n4,20,\n")
    found = answer(panda, initial_state(panda, force=[0, 0, 1], limits=path, locked=[2]))
    lock, unknown, limited = found.loads[1], found.loads[0], found.loads[3]
    assert (lock.limit, lock.used) == (60.0, abs(lock.brake) / 60.0)
    assert math.isnan(unknown.limit)
    assert math.isnan(unknown.used)
    assert limited.used == abs(limited.after) / 20.0
    weak = answer(panda, initial_state(panda, weak={4: 0.25}, force=[0, 0, 1])).loads[3]
    assert weak.limit == 0.25 * panda.effort[3]
    gone = answer(panda, initial_state(panda, weak={4: 0.0}, force=[0, 0, 1])).loads[3]
    assert (gone.limit, gone.after, gone.used) == (0.0, 0.0, 0.0)


def test_an_arm_without_masses_has_loads_of_the_force_alone(tmp_path):
    path = tmp_path / "arm.urdf"
    bare = {name: f'<link name="{name}"/>' for name in ("base", "l1", "l2", "l3", "tool")}
    path.write_text(arm(**bare))
    robot = ftforce.load_robot(path)
    found = answer(robot, initial_state(robot, force=[1, 2, 3]))
    assert [load.before for load in found.loads] == found.analysis.torque.before.tolist()
    nothing = answer(robot, initial_state(robot).loaded("every direction"))
    assert all(math.isnan(load.before) for load in nothing.loads)


def test_positions_beyond_limits_are_warned_of_as_by_analyze(panda):
    state = initial_state(panda).with_joint(3, 1.0)
    found = answer(panda, state).analysis
    assert found.warnings == ftforce.analyze(panda, state.q, force=state.force).warnings
    assert "outside the joint limits" in found.warnings[0]


def test_what_the_census_cannot_take_leaves_the_answer(panda, monkeypatch):
    def refuse(*_arguments, **_options):
        raise InputError("too many sets")

    monkeypatch.setattr("ftforce.view.model.answer.census_of", refuse)
    found = answer(panda, initial_state(panda))
    assert (found.census, found.census_problem) == (None, "too many sets")
    assert found.analysis.verdict.value == "tolerated"


def test_capability_is_found_only_where_it_is_shown(panda):
    state = initial_state(panda, limits="urdf", locked=[2])
    assert answer(panda, state).capability is None
    assert answer(panda, state).weakest is None
    found = answer(panda, state.showing(weakest=True))
    by_itself = ftforce.capability(panda, locked=[2], limits="urdf").weakest
    assert [amount.maximum for amount in found.weakest] == [
        by_itself.before["commanded"].maximum,
        by_itself.after["commanded"].maximum,
    ]
