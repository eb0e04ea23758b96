"""Xacro files: expanded by xacrodoc, with arguments and packages; a URDF never is."""

import json
import pickle
import shutil
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from ftforce import cli, load_robot
from ftforce.errors import InputError, URDFError
from ftforce.robot.formats.xacro import XacroOptions, expand
from ftforce.robot.kinematics import frame_jacobian
from ftforce.view.geometry.visuals import read_visuals

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = f"""{HEAD}
  <xacro:arg name="length" default="0.5"/>
  <xacro:property name="L" value="$(arg length)"/>
  <xacro:include filename="$(find segments)/urdf/segment.xacro"/>
  <link name="base"/>
  <xacro:segment parent="base" child="l1" z="0"/>
  <xacro:segment parent="l1" child="l2" z="${{L}}"/>
  <xacro:segment parent="l2" child="tool0" z="${{L * 0.5}}"/>
</robot>"""
SEGMENT = f"""{HEAD}
  <xacro:include filename="limits.xacro"/>
  <xacro:macro name="segment" params="parent child z">
    <link name="${{child}}"><visual><geometry>
      <mesh filename="package://segments/rod.stl"/></geometry></visual></link>
    <joint name="${{parent}}_${{child}}" type="revolute">
      <parent link="${{parent}}"/><child link="${{child}}"/>
      <origin xyz="0 0 ${{z}}"/><axis xyz="0 1 0"/>
      <limit lower="-2" upper="2" effort="${{effort}}" velocity="1"/>
    </joint>
  </xacro:macro>
</robot>"""
LIMITS = f'{HEAD}<xacro:property name="effort" value="10"/></robot>'


@pytest.fixture
def workspace(tmp_path):
    """A folder with two packages, as a ROS workspace has them."""
    for package, files in {
        "arm_description": {"urdf/arm.urdf.xacro": ARM},
        "segments": {"urdf/segment.xacro": SEGMENT, "urdf/limits.xacro": LIMITS, "rod.stl": ""},
    }.items():
        for name, content in files.items():
            file = tmp_path / package / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(content)
        (tmp_path / package / "package.xml").write_text(
            f"<package><name>{package}</name></package>"
        )
    return tmp_path


@pytest.fixture
def xacro(workspace):
    return workspace / "arm_description" / "urdf" / "arm.urdf.xacro"


def tip_height(robot):
    """Return the height of the tip, m, from its Jacobian at zero: d(x)/d(q1) = z."""
    return frame_jacobian(robot, np.zeros(robot.n))[0, 0]


@pytest.mark.parametrize(("args", "height"), [(None, 0.75), ({"length": 0.7}, 1.05)])
def test_arguments_and_packages(workspace, xacro, args, height):
    robot = load_robot(xacro, args=args, package_path=workspace)
    assert robot.names == ("base_l1", "l1_l2", "l2_tool0")
    assert robot.effort.tolist() == [10.0] * 3
    assert tip_height(robot) == pytest.approx(height)
    assert robot.path == str(xacro)


def test_on_the_command_line(workspace, xacro):
    words = [str(xacro), "--package-path", str(workspace), "--arg", "length=0.7"]
    asked = ["analyze", *words, "--q=0,0.1,0", "--force=10,0,0", "--format=json"]
    result = CliRunner().invoke(cli.build("analyze"), asked)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["torque"]["before"]["l2_tool0"] == pytest.approx(0, abs=1e-12)
    result = CliRunner().invoke(cli.build("inspect"), ["inspect", *words[:-1], "length"])
    assert "--arg needs NAME=VALUE" in result.stderr


def test_packages_without_package_xml_are_known_by_their_folders(workspace, xacro):
    for file in workspace.glob("*/package.xml"):
        file.unlink()
    assert load_robot(xacro, package_path=[workspace]).n == 3
    assert load_robot(xacro, package_path=workspace / "segments").n == 3


def test_meshes_of_packages_are_found(workspace, xacro):
    robot = load_robot(xacro, package_path=workspace)
    shapes = read_visuals(robot.path, robot.description()).shapes
    assert {one.path for one in shapes} == {workspace / "segments" / "rod.stl"}
    again = pickle.loads(pickle.dumps(robot))
    assert again.description().find("link").get("name") == "base"


def test_what_xacro_warns_of_is_a_note_and_not_printed(workspace, xacro, capfd):
    macro = 'params="parent child z"'
    segment = workspace / "segments/urdf/segment.xacro"
    segment.write_text(SEGMENT.replace(macro, 'params="parent child z len=1"'))  # a function
    found = load_robot(xacro, package_path=workspace)
    assert capfd.readouterr() == ("", "")
    assert found.notes == ("xacro warns: redefining global symbol: len",)  # not once per use


def test_arguments_that_nothing_uses_are_refused(workspace, xacro):
    def loaded(**args):
        return load_robot(xacro, args=args, package_path=workspace)

    with pytest.raises(InputError, match=r"xacro has no argument 'lenght', only length$"):
        loaded(lenght=1)
    # Also what an included file declares, or only uses, is known.
    limits = workspace / "segments/urdf/limits.xacro"
    effort = f'{HEAD}<xacro:property name="effort" value="$(arg effort)"/></robot>'
    limits.write_text(effort)
    assert loaded(effort=3).effort.tolist() == [3.0] * 3
    limits.write_text(effort.replace("<xacro:p", '<xacro:arg default="2"\nname="effort"/><xacro:p'))
    with pytest.raises(InputError, match=r"has no argument 'efort', only length, effort$"):
        loaded(efort=3)
    # Values that are for an SRDF, too.
    srdf = xacro.with_name("other.srdf.xacro")
    srdf.write_text(f"{HEAD}<group_state name='$(arg state)'/></robot>")
    args = {"length": 0.7, "state": "home"}
    assert load_robot(xacro, args=args, package_path=workspace, srdf=srdf).n == 3


def test_an_srdf_beside_it_is_read(workspace, xacro):
    chain = '<group name="arm"><chain base_link="base" tip_link="l2"/></group>'
    xacro.with_name("arm.srdf").write_text(f'<robot name="arm">{chain}</robot>')
    assert load_robot(xacro, package_path=workspace).tip == "l2"


REFUSED = {
    "package": ({}, r"needs the package 'segments', which is not found; .* --package-path DIR"),
    "expression": (
        {"arm": ARM.replace("${L}", "${L * breadth}"), "packages": True},
        r"cannot be expanded by xacro: name 'breadth' is not defined",
    ),
    "include": (
        {"arm": ARM.replace("$(find segments)", "nowhere")},
        r"cannot be expanded by xacro: No such file or directory",
    ),
    "XML": ({"arm": ARM[:-9]}, "cannot be expanded by xacro: .*line"),
    "macros only": (
        {"arm": SEGMENT.replace('<xacro:include filename="limits.xacro"/>', "")},
        "expands to no <link>: it may only define macros; give the file that uses",
    ),
    "no robot": ({"arm": "<sdf/>"}, "is not a URDF: its root element is <sdf>"),
    "DTD": (
        {"arm": f'<!DOCTYPE a [<!ENTITY b "c">]>{ARM}', "packages": True},
        "contains a DTD",
    ),
}


@pytest.mark.parametrize(("given", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_expanded_is_one_clear_line(workspace, xacro, given, message):
    if "arm" in given:
        xacro.write_text(given["arm"])
    folders = workspace if "packages" in given else None
    with pytest.raises(URDFError, match=message) as caught:
        load_robot(xacro, package_path=folders)
    assert "\n" not in str(caught.value)


def test_a_lack_of_memory_is_not_a_flaw_of_the_file(monkeypatch, workspace, xacro):
    def exhausted(*_args, **_options):
        raise MemoryError

    monkeypatch.setattr("xacrodoc.XacroDoc.from_string", exhausted)
    with pytest.raises(MemoryError):
        load_robot(xacro, package_path=workspace)


def test_a_urdf_is_never_evaluated(workspace, xacro):
    urdf = shutil.copy(xacro, workspace / "arm.urdf")
    with pytest.raises(URDFError, match=r"a \.urdf is never evaluated"):
        load_robot(urdf)
    with pytest.raises(InputError, match=r"is not a xacro file \(\*\.xacro\)"):
        load_robot(urdf, package_path=workspace)
    with pytest.raises(InputError, match="panda is a known robot"):
        load_robot("panda", args={"hand": True})


def test_options():
    assert XacroOptions.of({"hand": True, "n": 2}, None).args == (("hand", "true"), ("n", "2"))
    with pytest.raises(InputError, match="package path nowhere is not a folder"):
        XacroOptions.of(None, "nowhere")


def test_without_xacrodoc_the_command_that_installs_it_is_named(monkeypatch, xacro):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(URDFError, match=r"pip install 'ftforce\[xacro\]'"):
        load_robot(xacro)


def test_where_others_look_for_packages_does_not_change(workspace, xacro):
    from xacrodoc import packages

    packages.reset()
    packages.look_in([str(workspace)])
    expand(xacro, XacroOptions.of(None, workspace / "segments"))
    assert packages.get_path("arm_description") == str(workspace / "arm_description")
    packages.reset()
