"""URDFs: what is taken, what is refused and in which words, and what Pinocchio is given."""

import math
import os
import re
import subprocess
import sys
import threading

import numpy as np
import pinocchio as pin
import pytest

from ftforce import analyze, census, to_dict
from ftforce.errors import InputError, URDFError
from ftforce.robot import stderr
from ftforce.robot.formats.tree import MAX_DEPTH, MOMENTS, UrdfTree
from ftforce.robot.formats.urdf import MAX_LINKS, read_urdf
from ftforce.robot.load import load_robot
from ftforce.robot.model import full_model, restore_names
from helpers import campaign, load_text, serial_urdf
from urdfs import (
    BODY,
    LIMIT,
    LINKS,
    arm,
    followed,
    hand,
    j2,
    joint,
    link,
    load,
    mimic,
    parts_of_arm,
    robot,
    write,
)


@pytest.fixture
def read(tmp_path):
    return lambda urdf, name="arm.urdf": read_urdf(write(tmp_path, urdf, name=name))


def limit(**bounds):
    return "<limit " + " ".join(f'{key}="{value}"' for key, value in bounds.items()) + "/>"


def without(part, text):
    changed = text.replace(part, "")
    assert changed != text
    return changed


# ---- what is taken ---------------------------------------------------------------------------


def test_everything_that_is_stated_is_read(read):
    tree = read(arm(j3=followed(3, "j1", -2, 0.5, kind="prismatic")))
    assert (tree.name, tree.root) == ("arm", "base")
    assert tuple(tree.links) == LINKS
    assert tuple(tree.joints) == ("j1", "j2", "j3", "j4")
    body = tree.links["l2"]
    assert (body.mass, body.xyz, body.rpy) == (2.0, (0.1, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert body.inertia == (0.1, 0.0, 0.0, 0.1, 0.0, 0.1)
    second, third = tree.joints["j2"], tree.joints["j3"]
    assert (second.type, second.parent, second.child) == ("revolute", "l1", "l2")
    assert (second.xyz, second.rpy, second.axis) == ((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), (0, 1, 0))
    assert (second.lower, second.upper, second.effort, second.velocity) == (-1, 2, 10, 3)
    assert second.mimic is None
    assert third.type == "prismatic"
    assert (third.mimic.leader, third.mimic.multiplier, third.mimic.offset) == ("j1", -2, 0.5)


def test_what_is_not_stated_has_the_urdfs_defaults(read):
    bare = '<joint name="j1" type="continuous"><parent link="base"/><child link="l1"/></joint>'
    first = read(robot(link("base", ""), link("l1", "<inertial/>"), bare)).joints["j1"]
    assert (first.xyz, first.rpy, first.axis) == ((0, 0, 0), (0, 0, 0), (1, 0, 0))
    assert (first.lower, first.upper, first.effort, first.velocity) == (None, None, None, None)
    empty = read(j2(limit="<limit/>", more="<origin/><mimic joint='j1'/>")).joints["j2"]
    assert (empty.lower, empty.upper, empty.effort, empty.velocity) == (None, None, None, None)
    assert (empty.mimic.multiplier, empty.mimic.offset) == (1, 0)
    half = read(j2(limit=limit(upper=1.5, effort=0))).joints["j2"]
    assert (half.lower, half.upper, half.effort) == (0, 1.5, 0)
    assert read(j2("fixed", axis="0 0 0", limit="")).joints["j2"].type == "fixed"
    huge = read(j2(limit=limit(lower=-1e308, upper=3.4e38, effort=1e16))).joints["j2"]
    assert (huge.lower, huge.upper, huge.effort) == (-1e308, 3.4e38, 1e16)
    upside_down = read(robot(*reversed(parts_of_arm().values())))
    assert [joint.name for joint in upside_down.path_to("tool")] == ["j1", "j2", "j3", "j4"]
    assert upside_down.root == "base"


def test_bodies_may_be_stated_in_part(read):
    texts = ("", "<inertial/>", "<inertial><mass/></inertial>",
             '<inertial><mass value="0"/></inertial>')  # fmt: skip
    for text, mass in zip(texts, (None, None, None, 0.0), strict=True):
        assert read(arm(l2=link("l2", text))).links["l2"].mass == mass


def test_products_and_rounded_zeros_of_inertia_may_be_negative(read):
    for key, value in (("ixy", "-0.01"), ("izz", "-5e-20"), ("ixx", "-0.0")):
        text = re.sub(f'{key}="[^"]*"', f'{key}="{value}"', arm(), count=1)
        moments = read(text).links["base"].inertia
        assert moments[MOMENTS.index(key)] == float(value)


@pytest.mark.parametrize("trace", ["1e-51", "-1e-200", "5e-324"])
def test_traces_in_an_origin_are_zeros(read, trace):
    second = read(j2(xyz=f"{trace} 0.2 {trace}", rpy=f"0 {trace} 1e-50")).joints["j2"]
    assert (second.xyz, second.rpy) == ((0.0, 0.2, 0.0), (0.0, 0.0, 1e-50))


@pytest.mark.parametrize("trace", [1e-300, 1e-200, 1e-160, 1e-49])
def test_an_arm_of_traces_makes_no_forces_beyond_all_sizes(trace):
    """Their squares would overflow, with a warning, which is an error here.

    Traces that are set to zero leave an arm that moves its tip nowhere.
    """
    ends = {"xyz": (trace, trace, 0), "rpy": (trace, 0, 0)}
    steps = [("revolute", {**ends, "axis": axis}) for axis in np.eye(3)[[2, 1, 0]]]
    tiny = load_text(serial_urdf(*steps).replace("0.11 0.05 0.03", f"{trace} {trace} {trace}"))
    q = [0.1, 0.2, 0.3]
    if trace < 1e-50:
        with pytest.raises(InputError, match="even the healthy arm cannot exert this force"):
            analyze(tiny, q, locked=2, force=[1, 2, 3])
        return
    for options in ({"force": [1, 2, 3]}, {"torque": [1, 2, 3]}, {"velocity": [1, 2, 3]}):
        result = analyze(tiny, q, locked=2, **options)
        assert result.is_proved()
        assert to_dict(result)["locked"] == ["j2"]
    assert len(census(tiny, q, torque=[1, 2, 3]).sets) == 3


@pytest.mark.parametrize(
    ("axis", "unit"),
    [
        ("0 0 7", (0, 0, 1)),
        ("-0.001 0 0", (-1, 0, 0)),
        ("3 0 4", (0.6, 0, 0.8)),
        ("1 1e-12 0", (1, 1e-12, 0)),
        ("1e9 1e9 0", (math.sqrt(0.5), math.sqrt(0.5), 0)),
    ],
)
def test_axes_are_made_unit_vectors(read, axis, unit):
    assert read(j2(axis=axis)).joints["j2"].axis == pytest.approx(unit, abs=1e-15)


@pytest.mark.parametrize(
    "name",
    [
        "関節 ж",
        "[red]x[/red]",
        "[/]",
        "<b>&amp;",
        "a'b\"c",
        " x ",
        "2",
        "a,b",
        "universe",
        "x" * 5000,
    ],
)
def test_names_may_be_nearly_anything(read, name):
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    tree = read(
        arm(
            l2=link(escaped),
            j2=joint(escaped, "l1", escaped),
            j3=joint("j3", escaped, "l3", more=mimic(escaped)),
        )
    )
    assert [one.name for one in tree.path_to("tool")] == ["j1", name, "j3", "j4"]
    assert tree.joints[name].child == name
    assert tree.joints["j3"].mimic.leader == name


def test_the_robots_name_is_the_files_if_it_has_none(read):
    nameless = arm().replace(' name="arm"', "", 1)
    assert read(nameless, "my arm.urdf").name == "my arm"
    assert read(arm().replace('"arm"', '" x "', 1)).name == "x"
    assert read(arm().replace('"arm"', '"a&#10;b&#x9b;"', 1)).name == "a?b?"


def test_what_is_not_ours_is_left_unread(read):
    mesh = '<visual><geometry><mesh filename="package://none/x.dae"/></geometry></visual>'
    text = arm(
        '<transmission name="t"><joint name="j9"/><link name="l9"/></transmission>',
        '<gazebo reference="l1"><link name="l1"/></gazebo><material name="red"/><xacro_was_here/>',
        l1=link("l1", mesh + "<collision/>"),
        j1=joint("j1", "base", "l1", more='<calibration rising="x"/><dynamics backlash="y"/>'),
    )
    assert len(read(text).links) == 5


def test_namespaces_comments_and_instructions(read):
    declared = ' xmlns:xacro="http://www.ros.org/wiki/xacro" xmlns:g="urn:gazebo"'
    commented = "<!-- <xacro:macro/> -->" + arm().replace("><", "><!-- ${x} --><?x y?><")
    for text in (
        arm().replace(">", f"{declared}>", 1),
        arm().replace(">", ' xmlns="http://www.ros.org">', 1),
        arm("<g:link/>").replace(">", f"{declared}>", 1),
        commented,
    ):
        assert len(read(text).joints) == 4


def test_megabytes_are_read(read):
    assert len(read(arm("<gazebo><p a='1'/></gazebo>" * campaign(400_000, 20_000))).joints) == 4


# ---- what is refused -------------------------------------------------------------------------

XACRO = r"a \.urdf is never evaluated; a xacro file needs a name that ends in \.xacro"
ROBOT = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
LOOSE = (link("base"), link("l1"))


def l1(old, new):
    """Return the arm with something else in the body of its first moving link."""
    assert old in BODY
    return arm(l1=link("l1", BODY.replace(old, new)))


MALFORMED = {
    "xacro": (f'{ROBOT}<xacro:property name="a" value="1"/></robot>', XACRO),
    "xacro, old": (ROBOT.replace("www", "wiki") + "<link name='a'/><xacro:x/></robot>", XACRO),
    "xacro, undeclared": ("<robot><xacro:include filename='a'/></robot>", XACRO),
    "xacro, rest of": (
        j2(xyz="${x} 0 0"),
        r"joint 'j2': origin xyz '\$\{x\} 0 0' is not a number \(contains an unexpanded xacro",
    ),
    "SDF": ("<sdf><model/></sdf>", "is not a URDF: its root element is <sdf>, not <robot>"),
    "prefix": ('<u:Robot xmlns:u="u"/>', "root element is <Robot>"),
    "undeclared prefix": ("<robot><a:b/></robot>", "contains no <link>"),
    "xacro, used": (
        ROBOT + '<xacro:property name="a" value="1"/>' + j2(xyz="${a} 0 0").partition(">")[2],
        XACRO,
    ),
    "xacro, in a joint": (
        ROBOT + j2(more='<xacro:insert_block name="origin"/>').partition(">")[2],
        XACRO,
    ),
    "xacro, parts missing": (
        ROBOT + '<xacro:include filename="hand.xacro"/>' + arm().partition(">")[2],
        XACRO,
    ),
    "broken, once xacro": ("<robot><!-- <xacro:a/> -->", "is not well-formed XML .no element"),
    "robot in robot": (f"<robot>{arm()}</robot>", "contains no <link>"),
    "no links": ("<robot/>", "contains no <link>"),
    "capitals": (arm().replace("link", "Link"), "contains no <link>"),
    "link without name": (arm("<link/>"), "a <link> has no name"),
    "joint without name": (arm(j2=joint(" ", "l1", "l2")), "a <joint> has no name"),
    "line break": (arm(link("a&#10;b")), r"link name 'a\\nb' contains unprintable characters"),
    "escape": (
        arm(j2=joint("a&#x9b;31m", "l1", "l2")),
        r"joint name 'a\\x9b31m' contains unprintable characters",
    ),
    "turned": (
        arm(j2=joint("\u202ea", "l1", "l2")),
        r"joint name '\\u202ea' contains unprintable characters",
    ),
    "two links": (arm(link("l2")), "two links are named 'l2'; names must be unique"),
    "no parent": (
        arm(j2=without('<parent link="l1"/>', joint("j2", "l1", "l2"))),
        r"""joint 'j2': <parent link="…"/> is missing""",
    ),
    "empty child": (arm(j2=joint("j2", "l1", "")), r"joint 'j2': <child link=\"…\"/> is missing"),
    "lost parent": (
        arm(j2=joint("j2", "l11", "l2")),
        "joint 'j2': its parent link 'l11' does not exist; did you mean 'l1'?",
    ),
    "lost child": (
        arm(j4=joint("j4", "l3", "gripper")),
        "joint 'j4': its child link 'gripper' does not exist$",
    ),
    "two roots": (arm(link("x")), r"has 2 root links \(base, x\); a URDF has exactly one"),
    "ring": (
        robot(*LOOSE, joint("i", "base", "l1"), joint("j", "l1", "base")),
        "has no root link: its joints form a loop",
    ),
    "ring apart": (
        robot(*LOOSE, link("x"), joint("i", "l1", "x"), joint("j", "x", "l1")),
        "the links l1, x form a loop disconnected from the root 'base'",
    ),
    "closed loop": (
        arm(joint("again", "l1", "tool")),
        "link 'tool' has two parent joints, 'j4' and 'again'; a URDF is a tree and cannot contain",
    ),
    "type": (
        j2("Revolut"),
        r"joint 'j2': unknown type 'Revolut'; available: .*, planar; did you mean 'revolute'\?",
    ),
    "no type": (arm().replace(' type="revolute"', "", 1), "joint 'j1': unknown type ''"),
    "zero axis": (j2(axis="0 0 0"), "joint 'j2': its axis is zero; give a direction, e.g. 0 0 1"),
    "nearly zero axis": (j2(axis="0 1e-7 0"), "joint 'j2': its axis is zero"),
    "zero axis, sliding": (j2("prismatic", axis="0 0 0"), "its axis is zero"),
    "zero axis, free": (j2("continuous", axis="-0 0 0"), "its axis is zero"),
    "axis too long": (j2(axis="0 0 1 0"), "joint 'j2': axis '0 0 1 0': expected 3 numbers, got 4"),
    "commas": (j2(axis="0,0,1"), "joint 'j2': axis '0,0,1' is not a number"),
    "endless axis": (j2(axis="1e308 1e308 0"), "joint 'j2': axis '1e308 1e308 0' is too large"),
    "huge origin": (j2(xyz="0 0 1e20"), "joint 'j2': origin xyz '0 0 1e20' is too large"),
    "short origin": (j2(rpy="0 0"), "joint 'j2': origin rpy '0 0': expected 3 numbers, got 2"),
    "no limit": (
        j2(limit=""),
        r"""j2': a revolute joint needs <limit lower="…" upper="…"/> \(or type continuous\)""",
    ),
    "no limit, sliding": (
        j2("prismatic", limit=""),
        r"""joint 'j2': a prismatic joint needs <limit lower="…" upper="…"/>$""",
    ),
    "swapped limits": (
        j2(limit=limit(lower=1, upper=-1)),
        "joint 'j2': lower limit 1 exceeds upper limit -1$",
    ),
    "half a limit": (
        j2(limit=limit(lower=1)),
        r"joint 'j2': lower limit 1 exceeds upper limit 0 \(a missing limit defaults to 0\)",
    ),
    "limit no number": (
        j2(limit=limit(lower="pi", upper=1)),
        "joint 'j2': limit lower 'pi' is not a number",
    ),
    "NaN effort": (
        j2("fixed", limit=limit(effort="nan")),
        "joint 'j2': limit effort 'nan' is not finite",
    ),
    "negative mass": (
        l1('<mass value="2"/>', '<mass value="-2"/>'),
        "link 'l1': mass -2 kg is negative; it must be 0 or more$",
    ),
    "no mass": (l1('value="2"', 'value=""'), "mass '': expected 1 number, got 0"),
    "NaN inertia": (
        l1('iyz="0"', 'iyz="nan"'),
        "link 'l1': inertia iyz 'nan' is not finite",
    ),
    **{
        f"negative {key}": (
            l1(f'{key}="0.1"', f'{key}="-0.1"'),
            f"link 'l1': inertia {key} -0.1 kg·m² is negative; it must be 0 or more$",
        )
        for key in ("ixx", "iyy", "izz")
    },
    "mimics nobody": (
        j2(more="<mimic/>"),
        r"""joint 'j2': <mimic joint="…"/> is missing its joint""",
    ),
    "mimics a stranger": (
        j2(more=mimic("j11")),
        r"joint 'j2' mimics 'j11', which does not exist; did you mean 'j1'\?",
    ),
    "mimics a fixed joint": (
        arm(j1=joint("j1", "base", "l1", "fixed"), j2=followed(2, "j1")),
        "joint 'j2' mimics 'j1', which is fixed",
    ),
    "mimics itself": (arm(j2=followed(2, "j2")), "the joints j2 mimic each other in a cycle"),
    "mimics in a circle": (
        arm(j2=followed(2, "j3"), j3=followed(3, "j4"), j4=followed(4, "j3")),
        "the joints j2, j3, j4 mimic each other in a cycle",
    ),
    "mimics more and more": (
        arm(j2=followed(2, "j1", 1e5), j3=followed(3, "j2", 1e5)),
        "joint 'j3': its multiplier or offset, .* exceeds",
    ),
}


@pytest.mark.parametrize(("urdf", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files(tmp_path, urdf, message):
    with pytest.raises(URDFError, match=message) as caught:
        load(tmp_path, urdf)
    assert caught.value.path == str(tmp_path / "arm.urdf")
    assert "\n" not in str(caught.value)
    assert len(caught.value.reason) < 300


# ---- what is taken although it is malformed -------------------------------------------------

GB = '<?xml version="1.0" encoding="{}"?>'
TAKEN = {
    # content, joints, note
    "blank line": (
        '\n \r\n<?xml version="1.0"?>\n' + arm(),
        "the XML declaration is not at the start of the file",
    ),
    "comment first": (
        '<!-- made by x -->\n<!-- y -->\n<?xml version="1.0" encoding="utf-8"?>' + arm(),
        "the XML declaration is not at the start of the file",
    ),
    "prefix": (
        arm('<gazebo><sensor:camera><a pose:frame="x"/></sensor:camera></gazebo>'),
        "prefixes without an XML namespace: pose, sensor",
    ),
    "prefix among others": (
        arm("<g:x/><h:y/>").replace(">", ' xmlns="urn:robot" xmlns:g="urn:g">', 1),
        "prefixes without an XML namespace: h",
    ),
    "Latin-1": (
        (GB.format("ISO-8859-1") + arm("<!-- für -->")).encode("latin-1"),
        "the file is iso-8859-1 text, not UTF-8",
    ),
    "GB2312": (
        (GB.format("GB2312") + arm("<!-- 机器人镕 -->")).encode("gbk"),
        "the file is gb18030 text, not UTF-8",
    ),
    "UTF-16": (
        (GB.format("utf-16") + arm("<!-- 机 -->")).encode("utf-16"),
        "the file is utf-16 text, not UTF-8",
    ),
    "xacro": (
        ROBOT + '<xacro:property name="t" value="${1/100}"/><xacro:macro name="m"><x a="${b}"/>'
        "</xacro:macro>" + arm().partition(">")[2],
        "remains of xacro are ignored: <xacro:macro>, <xacro:property>",
    ),
    "xacro in Gazebo": (
        arm(
            '<xacro:property name="a" value="1"/><gazebo reference="${x}"><xacro:plugin/></gazebo>'
        ),
        "remains of xacro are ignored: <xacro:property>",
    ),
    "xacro, undeclared": (
        arm('<xacro:arg name="t" default="1"/>'),
        "remains of xacro are ignored: <xacro:arg>",
    ),
}


@pytest.mark.parametrize(("urdf", "note"), TAKEN.values(), ids=TAKEN)
def test_what_robots_files_have_beyond_the_standard(tmp_path, urdf, note):
    found = load(tmp_path, urdf)
    assert found.names == load(tmp_path, arm()).names
    assert note in found.notes


def test_names_are_decoded_as_declared(tmp_path):
    for encoding in ("iso-8859-1", "windows-1252", "utf-8"):
        text = GB.format(encoding) + arm(j2=joint("Schultergelenk ä", "l1", "l2"))
        assert load(tmp_path, text.encode(encoding)).names[1] == "Schultergelenk ä"


@pytest.mark.parametrize(
    ("encoding", "content"),
    [
        ("", "ä".encode("latin-1")),
        ("utf-8", "ä".encode("latin-1")),
        ("utf-7", "ä".encode("latin-1")),
        ("unicode_escape", "ä".encode("latin-1")),
        ("rot13", "ä".encode("latin-1")),
        ("euc-jp", b"\xff\xff"),
    ],
)
def test_other_bytes_are_no_text(tmp_path, encoding, content):
    head = GB.format(encoding).encode() if encoding else b""
    with pytest.raises(URDFError, match=r"is not UTF-8 text|is neither UTF-8 nor euc-jp"):
        load(tmp_path, head + arm("<!-- x -->").encode().replace(b" x ", content))


@pytest.mark.parametrize("before", ["", "\n", "<!-- x -->", "\ufeff"])
def test_entities_stay_refused(tmp_path, before):
    laughs = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a "ha">]><x:robot name="&a;"/>'
    for text in (before + laughs, (before + laughs).encode("utf-16")):
        with pytest.raises(URDFError, match="contains a DTD"):
            load(tmp_path, text)
    with pytest.raises(URDFError, match="undefined entity"):
        load(tmp_path, before + arm("<g:x>&nbsp;</g:x>"))


def test_lines_in_messages_are_those_of_the_file(tmp_path):
    with pytest.raises(URDFError, match="line 4, column"):
        load(tmp_path, '\n<!-- x -->\n<?xml version="1.0"?>\n<robot>< /robot>')


OUTSIDE = {
    "swapped limits": (
        {"limit": limit(lower=0.04, upper=0)},
        "joint 'f': lower limit 0.04 exceeds upper limit 0",
    ),
    "stranger": ({"more": mimic("gone")}, "joint 'f' mimics 'gone', which does not exist"),
    "itself": ({"more": mimic("f")}, "the joints f mimic each other in a cycle"),
    "fixed": ({"more": mimic("j0")}, "joint 'f' mimics 'j0', which is fixed"),
    "no axis": ({"axis": "0 0 0"}, "joint 'f': its axis is zero; give a direction, e.g. 0 0 1"),
    "xacro": (
        {"xyz": "${x} 0 0"},
        (
            "joint 'f': origin xyz '${x} 0 0' is not a number (contains an unexpanded xacro "
            "expression)"
        ),
    ),
    "type": ({"kind": "ball"}, "joint 'f': unknown type 'ball'; available: "),
    "no limits": ({"limit": ""}, "joint 'f': a revolute joint needs <limit lower="),
}


@pytest.mark.parametrize(("options", "flaw"), OUTSIDE.values(), ids=OUTSIDE)
def test_what_is_malformed_outside_the_chain_is_a_note(tmp_path, options, flaw):
    """The numbers of the arm are those of the same arm with a sound finger."""
    options = {"kind": "revolute", **options}
    floor = joint("j0", "floor", "base", "fixed")

    def with_finger(finger):
        return load(tmp_path, arm(link("floor"), floor, link("finger"), finger), tip="tool")

    sound = with_finger(joint("f", "tool", "finger"))
    found = with_finger(joint("f", "tool", "finger", options.pop("kind"), **options))
    assert any(f"ignored, as it lies outside the chain: {flaw}" in note for note in found.notes)
    assert sound.notes == ()
    q = np.array([0.3, -0.4, 0.5, 0.2])
    np.testing.assert_allclose(
        pin.getFrameJacobian(found.model, pin_data(found, q), found.tip_frame, pin.LOCAL),
        pin.getFrameJacobian(sound.model, pin_data(sound, q), sound.tip_frame, pin.LOCAL),
        atol=1e-15,
    )
    whole = arm(*hand("a"), j3=joint("j3", "l2", "l3", **{"kind": "revolute", **options}))
    if "more" not in options and options:  # the same in the chain is an error
        with pytest.raises(URDFError, match="joint 'j3'"):
            load(tmp_path, whole, tip="tool")


def pin_data(one, q):
    data = one.model.createData()
    pin.computeJointJacobians(one.model, data, one.to_model(q))
    pin.updateFramePlacements(one.model, data)
    return data


def test_bodies_outside_the_chain_that_are_malformed_count_as_massless(tmp_path):
    def mass(body):
        found = load(tmp_path, arm(link("finger", body), joint("f", "tool", "finger")), tip="tool")
        return found.mass, found.notes

    whole, none = mass(BODY)
    assert (whole, none) == (pytest.approx(10.0), ())
    left, (note,) = mass(BODY.replace('value="2"', 'value="-2"'))
    assert left == pytest.approx(8.0)
    assert note == (
        "ignored, as it lies outside the chain: link 'finger': mass -2 kg is negative; it must be "
        "0 or more"
    )


def test_a_joint_that_may_be_the_arm_is_not_passed_over(tmp_path):
    text = robot(link("a"), link("b"), joint("j", "a", "b", "Hinge"))
    with pytest.raises(URDFError, match="joint 'j': unknown type 'Hinge'"):
        load(tmp_path, text)


# ---- followers -------------------------------------------------------------------------------


def test_followers_of_followers_follow_the_first_leader(read):
    tree = read(arm(j2=followed(2, "j1", -3, 0.2), j4=followed(4, "j2", 2, 0.1)))
    fourth = tree.joints["j4"].mimic
    assert (fourth.leader, fourth.multiplier) == ("j1", -6)
    assert fourth.offset == pytest.approx(2 * 0.2 + 0.1)
    assert read(arm(j2=followed(2, "j1", 0))).joints["j2"].mimic.multiplier == 0
    backwards = read(arm(j1=followed(1, "j2", 2), j2=followed(2, "j4", 3, 1)))
    assert backwards.joints["j1"].mimic.leader == "j4"
    assert (backwards.joints["j1"].mimic.multiplier, backwards.joints["j1"].mimic.offset) == (6, 2)
    assert tuple(backwards.joints) == ("j1", "j2", "j3", "j4")


def test_a_long_chain_of_followers_takes_no_time(read):
    count = campaign(MAX_LINKS - 2, 1500)  # more than Python's recursion limit
    rays = [joint(f"r{i}", "l1", f"x{i}", more=mimic(f"r{i + 1}")) for i in range(count - 1)]
    tree = read(
        robot(
            *LOOSE,
            *(link(f"x{i}", "") for i in range(count)),
            *rays,
            joint("j1", "base", "l1"),
            joint(f"r{count - 1}", "l1", f"x{count - 1}"),
        )
    )
    assert {joint.mimic.leader for joint in tree.joints.values() if joint.mimic} == {
        f"r{count - 1}"
    }


# ---- the tree --------------------------------------------------------------------------------


def test_the_tree_knows_what_is_above_and_below(read):
    tree = read(arm(link("x"), link("y"), joint("jx", "l2", "x"), joint("jy", "x", "y", "fixed")))
    assert [one.name for one in tree.path_to("y")] == ["j1", "j2", "jx", "jy"]
    assert tree.path_to("base") == ()
    assert {one.name for one in tree.below("l2")} == {"j3", "j4", "jx", "jy"}
    below = [one.name for one in tree.below("base")]
    assert sorted(below) == sorted(tree.joints)
    assert all(
        below.index(one.name) < below.index(child.name)
        for one in tree.joints.values()
        for child in tree.child_joints[one.child]
    )


# ---- Pinocchio -------------------------------------------------------------------------------


def test_pinocchio_gets_every_number_to_the_last_digit(read, tmp_path):
    number = 0.1 + 0.2
    text = arm(
        l3=link("l3", f'<inertial><mass value="{number}"/></inertial>'),
        j2=joint("j2", "l1", "l2", xyz=f"{number} 1e-7 {1 / 3}", rpy=f"{2 / 3} 1e9 -1e-300"),
    )
    tree = read(text)
    theirs = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    ours = full_model(tree)
    restore_names(ours, tree)
    assert list(ours.names) == list(theirs.names)
    for mine, other in zip(ours.jointPlacements, theirs.jointPlacements, strict=True):
        np.testing.assert_array_equal(mine.homogeneous, other.homogeneous)
    for mine, other in zip(ours.inertias, theirs.inertias, strict=True):
        np.testing.assert_array_equal(mine.toDynamicParameters(), other.toDynamicParameters())
    np.testing.assert_array_equal(ours.lowerPositionLimit, theirs.lowerPositionLimit)


def test_names_are_codes_for_pinocchio_and_come_back(read):
    tree = read(arm(l1=link("universe"), j1=joint("tool", "base", "universe"),
                    j2=joint("universe", "universe", "l2")))  # fmt: skip
    assert "tool" not in tree.to_xml()
    assert "universe" not in tree.to_xml()
    model = full_model(tree)
    restore_names(model, tree)
    assert list(model.names) == ["universe", "tool", "universe", "j3", "j4"]
    bodies = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    assert bodies == ["base", "universe", "l2", "l3", "tool"]


def test_what_pinocchio_finds_is_told_with_what_it_prints(read, monkeypatch, capfd):
    tree = read(arm())
    no_limits = j2(limit="")
    monkeypatch.setattr(UrdfTree, "to_xml", lambda _: no_limits)
    monkeypatch.setattr(stderr, "_is_alone", lambda: True)  # other tests may leave threads behind
    with pytest.raises(URDFError, match=r"arm\.urdf: Pinocchio rejects the URDF: ") as caught:
        full_model(tree)
    assert "Joint [j2] is of type REVOLUTE but it does not specify limits" in str(caught.value)
    assert "does not contain a valid URDF" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def row(count, moving):
    """Return a URDF with so many links in a row, the first joints moving."""
    joints = [
        joint(f"j{i}", f"l{i}", f"l{i + 1}", "revolute" if i < moving else "fixed")
        for i in range(count - 1)
    ]
    return robot(*(link(f"l{i}") for i in range(count)), *joints)


def test_links_in_a_row_have_an_end(read):
    assert len(read(row(MAX_DEPTH, 4)).links) == MAX_DEPTH
    with pytest.raises(URDFError, match=f"is {MAX_DEPTH + 1} links deep; at most"):
        read(row(MAX_DEPTH + 1, 4))
    with pytest.raises(URDFError, match="contains 9000 links; at most 5000 are supported"):
        read(row(9000, 4))


def test_the_longest_row_fits_into_a_small_stack(tmp_path):
    path = write(tmp_path, row(MAX_DEPTH, 4))
    program = (
        "import threading, ftforce, pinocchio, rich\n"
        "def work():\n"
        f"    print(ftforce.load_robot({str(path)!r}).n)\n"
        "threading.stack_size(512 * 1024)\n"
        "thread = threading.Thread(target=work)\n"
        "thread.start(); thread.join()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "4\n", "")


def test_many_links_side_by_side(tmp_path):
    count = campaign(MAX_LINKS - 2)  # Pinocchio takes seconds for all of them
    rays = [joint(f"r{i}", "l1", f"x{i}") for i in range(count)]
    links = [link(f"x{i}") for i in range(count)]
    robot_ = load_robot(
        write(tmp_path, robot(*LOOSE, joint("j1", "base", "l1"), *links, *rays)), tip="x7"
    )
    assert robot_.names == ("j1", "r7")
    assert len(robot_.held) == count - 1


def test_robots_are_read_in_threads_at_once(tmp_path, capfd):
    good, bad = write(tmp_path, arm()), write(tmp_path, arm(j2=LIMIT), name="bad.urdf")
    found = []

    def work():
        for _ in range(5):
            found.append(load_robot(good).n)
            with pytest.raises(URDFError):
                load_robot(bad)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [4] * 20
    os.write(2, b"still here")
    assert capfd.readouterr().err == "still here"
