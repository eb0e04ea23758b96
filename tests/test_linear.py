"""The work of the readers grows with the size of a file, not with its square.

Work is counted, not timed.
"""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

import ftforce
from ftforce.analysis.limits_files import read_limits
from ftforce.errors import DHTableError, FileError, InputError, LimitsError, URDFError, closest
from ftforce.io.text import read_toml
from ftforce.robot.formats import tree
from ftforce.robot.formats.dh import read_dh_table
from ftforce.robot.formats.tree import UrdfLink
from ftforce.robot.formats.urdf import MAX_LINKS, _Reader, read_urdf
from ftforce.view.geometry import meshes, shapes
from ftforce.view.geometry.mesh_files import read_mesh

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def joint(name, more="", parent="a", child="b"):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="revolute">{ends}{LIMIT}{more}</joint>'


def urdf_of(folder, joints, links="ab"):
    path = folder / "arm.urdf"
    named = "".join(f'<link name="{link}"/>' for link in links)
    path.write_text(f'<robot name="r">{named}{"".join(joints)}</robot>')
    return path


def counted(monkeypatch, module, name):
    """Return a list that gets one entry per call of a function."""
    calls, original = [], getattr(module, name)

    def counting(*given, **named):
        calls.append(name)
        return original(*given, **named)

    monkeypatch.setattr(module, name, counting)
    return calls


def test_too_many_joints_are_refused_before_they_are_read(tmp_path, monkeypatch):
    calls = counted(monkeypatch, _Reader, "joint")
    path = urdf_of(tmp_path, [joint("j")] * (MAX_LINKS + 1))
    with pytest.raises(URDFError, match=f"contains {MAX_LINKS + 1} joints; at most {MAX_LINKS}"):
        read_urdf(path)
    assert not calls


class Name(str):
    """A name that counts its comparisons."""

    compared = 0
    __hash__ = str.__hash__

    def __eq__(self, other):
        Name.compared += 1
        return str.__eq__(self, other)


def test_a_name_that_appears_twice_is_found_in_one_pass():
    names = [Name(f"n{i}") for i in range(300)] + [Name("n299")]
    things = [UrdfLink(name, None, (), (), ()) for name in names]
    Name.compared = 0
    with pytest.raises(URDFError, match="two links are named 'n299'"):
        _Reader("a.urdf").unique(things, "link")
    assert Name.compared < 10 * len(names)


def test_few_of_many_missing_leaders_are_guessed(tmp_path, monkeypatch):
    calls = counted(monkeypatch, tree, "did_you_mean")
    joints = [joint(f"j{i}", f'<mimic joint="x{i}"/>', "a", f"l{i}") for i in range(50)]
    found = read_urdf(urdf_of(tmp_path, joints, ["a", *(f"l{i}" for i in range(50))]))
    assert len(found.flaws) == 50
    assert 0 < len(calls) <= 3


def test_a_long_cycle_is_described_once(tmp_path, monkeypatch):
    calls = counted(monkeypatch, tree, "listed")
    joints = [joint(f"j{i}", f'<mimic joint="j{(i + 1) % 50}"/>', "a", f"l{i}") for i in range(50)]
    found = read_urdf(urdf_of(tmp_path, joints, ["a", *(f"l{i}" for i in range(50))]))
    assert len(found.flaws) == 50
    assert len(calls) == 1


def test_long_names_are_not_guessed():
    assert closest("a" * 150 + "b", ["a" * 150]) == "a" * 150
    assert closest("a" * 300 + "b", ["a" * 300]) is None
    assert closest("elbw", ["a" * 300, "elbow"]) == "elbow"


DEEP = (
    ".".join(["a"] * 5000) + " = 1",
    "[" + ".".join(["a"] * 5000) + "]\nb = 1",
    " . ".join(['"a"'] * 5000) + " = 1",
    "x = {" + ".".join(["a"] * 5000) + " = 1}",
    "[[" + ".".join(["1"] * 5000) + "]]",
)


@pytest.mark.parametrize("text", DEEP)
def test_keys_of_many_parts_are_refused_unparsed(tmp_path, monkeypatch, text):
    calls = counted(monkeypatch, tomllib, "loads")
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(DHTableError, match="a key has more than 100 parts"):
        read_dh_table(path)
    with pytest.raises(LimitsError, match="a key has more than 100 parts"):
        read_limits(ftforce.load_robot("dh5"), path)
    assert not calls


def test_other_dots_are_no_parts_of_keys():
    text = f'''
    # {"." * 500}
    # {"3.5 " * 30}
    q = [{", ".join(["0.25"] * 500)}]
    "{"." * 300}" = 1
    a.b.c = "..."
    '''
    assert read_toml(text) == tomllib.loads(text)
    with pytest.raises(InputError, match="is not valid TOML"):
        read_toml("a = [")


def test_toml_files_are_small(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("#" * 1_000_001)
    with pytest.raises(DHTableError, match="is larger than 1 MB"):
        read_dh_table(path)
    with pytest.raises(LimitsError, match="is larger than 1 MB"):
        read_limits(ftforce.load_robot("dh5"), path)


def test_a_dh_table_has_no_more_rows_than_a_robot_joints(tmp_path):
    row = '{a = 1, alpha = 0, d = 0, theta = 0, type = "revolute", lower = -1, upper = 1},\n'
    path = tmp_path / "a.toml"
    units = 'units = {length = "m", angle = "rad"}'
    path.write_text(f'name = "x"\nconvention = "standard"\n{units}\nrows = [{row * 149}]')
    with pytest.raises(DHTableError, match="has 149 rows; at most 148 are supported"):
        read_dh_table(path)


# ---- meshes ----------------------------------------------------------------------------------


def scaled(count):
    ball = shapes.sphere(1.0)
    scales = [(1.0 + i / count, 1.0, 0.5) for i in range(count)]
    return [meshes._Piece(0, ball, scale, np.eye(4), True) for scale in scales]


def test_a_mesh_of_many_scales_is_decimated_once_per_step(monkeypatch):
    calls = counted(monkeypatch, shapes, "decimated")
    assert sum(len(piece.mesh.faces) for piece in scaled(1000)) > meshes.MAX_SHOWN
    found = meshes._decimated(scaled(1000))
    assert sum(len(piece.mesh.faces) for piece in found) <= meshes.MAX_SHOWN
    assert len(calls) < 50
    assert [piece.scale for piece in found] == [piece.scale for piece in scaled(1000)]


def test_few_scales_are_decimated_each_by_itself(monkeypatch):
    calls = counted(monkeypatch, shapes, "decimated")
    meshes._clustered(scaled(3) * 2, 0.01)
    assert len(calls) == 3


@pytest.mark.parametrize("line", ["v 1 2", "v 1", "v"])
def test_a_vertex_has_three_coordinates(tmp_path, line):
    path = tmp_path / "m.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\n{line}\nf 1 2 3\n")
    found = f"vertex 3 has {len(line.split()) - 1} coordinates; x, y and z are needed"
    with pytest.raises(FileError, match=found):
        read_mesh(path)
