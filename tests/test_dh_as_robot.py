"""A DH table in the place of a URDF: the same answers, and nothing written beside it."""

import json
import re

import numpy as np
import pytest
from test_dh_reader import DH5, TABLE

from ftforce import analyze, load_robot
from ftforce.robot.dynamics import weight_torque
from ftforce.robot.formats.dh import DHTable
from ftforce.robot.formats.dh_to_urdf import write_robot
from ftforce.robot.kinematics import tip_pose
from test_cli import run

NO_MASSES = re.sub(r"\[mass\].*?\n(?=\[)", "", TABLE.replace(", mass = 2.5", ""), flags=re.DOTALL)


@pytest.fixture
def table(tmp_path):
    def write(text):
        folder = tmp_path / "mine"
        folder.mkdir(exist_ok=True)
        path = folder / "arm.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_the_robot_of_a_table_is_that_of_its_closed_form(table, convention):
    path = table(TABLE.replace("standard", convention))
    arm, closed_form = load_robot(path), DHTable.from_toml(path)
    assert arm.names == ("shoulder", "joint2")
    assert (arm.base, arm.tip) == ("base", "tool")
    assert arm.path == str(path)
    for q in ([0.3, 0.1], closed_form.postures["home"]):
        pose = closed_form.transforms(q)[-1]
        R, p = tip_pose(arm, np.array(q))
        np.testing.assert_allclose(R, pose[:3, :3], atol=1e-14)
        np.testing.assert_allclose(p, pose[:3, 3], atol=1e-14)
    np.testing.assert_array_equal(arm.postures["home"], closed_form.postures["home"])
    assert [path.name for path in path.parent.iterdir()] == ["arm.toml"]


def test_commands_take_the_table_as_they_take_its_urdf(table, tmp_path):
    path = table(TABLE)
    urdf, _ = write_robot(DHTable.from_toml(path), tmp_path / "arm.urdf")
    for command, *options in (
        ("inspect",),
        ("analyze", "--locked", "1", "--force", "1,2,3"),
        ("census", "--faults", "2"),
        ("capability", "--locked", "2"),
    ):
        mine, theirs = (
            json.loads(run(command, str(given), *options, "--format", "json").stdout)
            for given in (path, urdf)
        )
        assert mine.pop("provenance") != theirs.pop("provenance")  # it names the file
        assert mine == theirs
    assert [path.name for path in path.parent.iterdir()] == ["arm.toml"]


def test_a_table_without_masses_has_an_unknown_weight(table):
    arm = load_robot(table(NO_MASSES))
    assert arm.mass == 0.0
    q = arm.postures["home"]
    np.testing.assert_array_equal(weight_torque(arm, q), [0.0, 0.0])
    result = analyze(arm, q, locked=1, force=[1.0, 2.0, 3.0])
    assert result.rnea.gravity is None
    heavy = analyze(load_robot(table(TABLE)), q, locked=1, force=[1.0, 2.0, 3.0])
    np.testing.assert_allclose(result.force.jump, heavy.force.jump, atol=1e-14)


def test_the_picture_of_a_table_is_that_of_its_urdf(tmp_path):
    pytest.importorskip("trimesh")
    from ftforce.view.geometry.visuals import read_visuals

    urdf, _ = write_robot(DHTable.from_toml(DH5), tmp_path / "dh5.urdf")
    mine, theirs = read_visuals(DH5), read_visuals(urdf)
    assert mine.notes == theirs.notes == ()
    assert len(mine.shapes) == len(theirs.shapes) > 5
    for one, other in zip(mine.shapes, theirs.shapes, strict=True):
        assert (one.link, one.shape, one.size) == (other.link, other.shape, other.size)
        np.testing.assert_array_equal(one.placement, other.placement)


def test_a_table_without_lengths_and_masses_can_be_drawn(table):
    lengths = re.sub(r"\b([ad]) = [0-9.]+", r"\1 = 0", NO_MASSES)
    assert load_robot(table(lengths)).n == 2
