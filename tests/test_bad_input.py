"""Everything a user can get wrong, typed at the command line: one clear line, nothing half-written.

Exit status 1 is wrong input, 2 a wrong command line. No traceback, no crash, no file left behind.
"""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ftforce.cli import app
from urdfs import (
    LINKS,
    arm,
    end_effector,
    followed,
    full_device,
    hand,
    j2,
    joint,
    link,
    mimic,
    robot,
    state,
    write,
)

COMMANDS = ("analyze", "census", "capability", "inspect")


def run(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "80"})


def refused(*arguments):
    """Return the one line that a command says instead of an answer."""
    result = run(*arguments)
    assert isinstance(result.exception, SystemExit), repr(result.exception)
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    # A progress bar that never started may leave an empty line.
    line = result.stderr.removeprefix("\n")
    assert line.startswith("error: ")
    assert line.endswith("\n")
    assert line.count("\n") == 1, line
    return line.removeprefix("error: ").removesuffix("\n")


def misused(*arguments):
    """Return what a command says to a wrong command line."""
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    return " ".join(result.stderr.replace("│", " ").split())


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def in_a_process(*arguments, **options):
    """Run the program as a user does."""
    return subprocess.run(
        [sys.executable, "-m", "ftforce", *map(str, arguments)],
        capture_output=True, text=True, check=False, timeout=60, **options,
    )  # fmt: skip


@pytest.fixture
def good(tmp_path):
    """Return the path of an arm of four joints with fingers, a follower and a posture."""
    gear = joint("gear_joint", "l1", "gear", more=mimic("j1"))
    camera = joint("mount", "l1", "camera", "fixed")
    parts = [*hand("left", "right"), link("camera"), camera, link("gear"), gear]
    q = {"j1": 0.3, "j2": -0.4, "j3": 0.5, "j4": 0.2}
    srdf = robot(end_effector("tool"), state("home", **q), state("far", **{**q, "j1": 9}))
    return write(tmp_path, arm(*parts), srdf)


# ---- files -----------------------------------------------------------------------------------

LAUGHS = '<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;">]><robot name="&b;"/>'
OUTSIDE = '<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>'
XACRO = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="a"/></robot>'
FILES = {
    "empty": (b"", "is empty; a URDF was expected"),
    "blank": (b" \n ", "is empty; a URDF was expected"),
    "binary": (b"\0\1\2", "is a binary file; a URDF was expected"),
    "Latin-1": ("<robot name='ä'/>".encode("latin-1"), "is not UTF-8 text (byte 13)"),
    "UTF-16": (arm().encode("utf-16"), "is not UTF-8 text (byte 0)"),
    "prose": ("This is no robot.", "is not well-formed XML (syntax error: line 1, column 0)"),
    "cut off": (arm()[:-30], "is not well-formed XML (unclosed token: line 1"),
    "two roots of XML": (arm() + arm(), "is not well-formed XML (junk after document element"),
    "entity": ("<robot name='&lost;'/>", "is not well-formed XML (undefined entity"),
    "DTD": ("<!DOCTYPE robot>" + arm(), "contains a DTD (<!DOCTYPE …>), which is refused"),
    "laughs": (LAUGHS, "contains a DTD"),
    "outside": (OUTSIDE, "contains a DTD"),
    "xacro": (XACRO, "is xacro, a macro language; turn it into a URDF first: `xacro FILE.xacro"),
    "SDF": ("<sdf/>", "is no URDF: its root element is <sdf>, not <robot>"),
    "no links": ("<robot/>", "holds no <link>"),
    "no joints": (robot(link("a")), "no joint moves below the link 'a'"),
    "nothing moves": (
        robot(link("a"), link("b"), joint("j", "a", "b", "fixed")),
        "no joint moves below the link 'a'",
    ),
    "ring": (
        robot(link("a"), link("b"), joint("i", "a", "b"), joint("j", "b", "a")),
        "has no root link: its joints form a loop",
    ),
    "loop": (arm(joint("x", "l1", "tool")), "link 'tool' hangs on two joints, 'j4' and 'x'"),
    "two roots": (arm(link("x")), "has 2 root links (base, x); a URDF has one"),
    "lost link": (
        j2(more="").replace('<child link="l2"/>', '<child link="l22"/>'),
        "joint 'j2': its child link 'l22' does not exist; did you mean 'l2'?",
    ),
    "links twice": (arm(link("l1")), "two links are named 'l1'; names must be unique"),
    "zero axis": (j2(axis="0 0 0"), "joint 'j2': its axis is zero; give a direction, e.g. 0 0 1"),
    "NaN": (j2(xyz="0 nan 0"), "joint 'j2': origin xyz '0 nan 0' is not finite"),
    "infinity": (j2(axis="0 0 inf"), "joint 'j2': axis '0 0 inf' is not finite"),
    "limits": (
        j2(limit='<limit lower="1" upper="0"/>'),
        "joint 'j2': lower limit 1 is above upper limit 0",
    ),
    "mass": (arm().replace('value="2"', 'value="-2"', 1), "link 'base': mass -2 kg is negative; "),
    "circle": (arm(j2=followed(2, "j2")), "the joints j2 mimic each other in a circle"),
    "type": (j2("screw"), "joint 'j2': unknown type 'screw'; there is: revolute, continuous"),
    "branches": (
        arm(link("x"), joint("y", "base", "x")),
        "the tree branches into several moving parts at the link 'base'; choose a tip (--tip): t",
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("content", "message"), FILES.values(), ids=FILES)
def test_files_that_are_no_robots(tmp_path, content, message):
    path = write(tmp_path, content)
    for command in COMMANDS:
        assert refused(command, path, "-o", tmp_path / "out.json").startswith(f"{path}: {message}")
    assert names_in(tmp_path) == ["arm.urdf"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.urdf", "none.urdf: no such file; a URDF was expected"),
        ("./panda", "./panda: no such file; a URDF was expected"),
        (".", ".: is a folder; a URDF was expected"),
        ("/dev/null", "/dev/null: is not a regular file; a URDF was expected"),
        ("pand", "no known robot or file 'pand'; there is: dh5, panda, ur3, "),
        ("", "no known robot or file ''; there is: dh5"),
        ("[bold]x[/].urdf", "[bold]x[/].urdf: no such file"),
    ],
)
def test_robots_that_are_not_there(tmp_path, monkeypatch, name, message):
    monkeypatch.chdir(tmp_path)
    for command in COMMANDS:
        assert refused(command, name).startswith(message)
    assert refused("inspect", "pand").endswith("; did you mean 'panda'?")


def test_a_broken_srdf_beside_a_fine_urdf(tmp_path):
    path = write(tmp_path, arm(), "<robot>")
    for command in COMMANDS:
        assert refused(command, path).startswith(f"{tmp_path / 'arm.srdf'}: is not well-formed XML")


def test_a_dh_table_is_no_urdf_and_a_urdf_no_table(tmp_path):
    table = Path(__file__).parents[1] / "robots" / "dh5.toml"
    assert "is not well-formed XML" in refused("inspect", table)
    assert "is not TOML" in refused("dh", write(tmp_path, arm()), "-o", tmp_path / "x.urdf")
    assert names_in(tmp_path) == ["arm.urdf"]


# ---- values ----------------------------------------------------------------------------------

CHAIN = "1 j1, 2 j2, 3 j3, 4 j4"
LOCKED = {
    "j9": "no joint 'j9' in the chain of 'arm'; there is: j1, j2, j3, j4",
    "J1": "no joint 'J1' in the chain of 'arm'; there is: j1, j2, j3, j4; did you mean 'j1'?",
    "0": f"joint number 0 is out of range; the chain has: {CHAIN}",
    "1,5": f"joint number 5 is out of range; the chain has: {CHAIN}",
    "-1": "joint number -1 is out of range",
    "--5": "no joint '--5'",
    "1.0": "no joint '1.0'",
    "9" * 5000: "no joint '9999",
    "²": "no joint '²'",
    "1,1": "joint 1 (j1) is named twice",
    "2,j2": "joint 2 (j2) is named twice",
    "1;2": "no joint '1;2'",
    "mount": "joint 'mount' is held fixed: it has no motor that could fail; the chain has: 1 j1",
    "gear_joint": "joint 'gear_joint' mimics 'j1'; name that one instead",
    "left_joint": "joint 'left_joint' lies outside the chain from 'base' to 'tool' and is held",
    "tool": "no joint 'tool'",
}


@pytest.mark.parametrize(("joints", "message"), LOCKED.items(), ids=lambda text: text[:12])
def test_joints_that_cannot_be_locked(good, joints, message):
    assert refused("analyze", good, "--locked", joints).startswith(message)


NUMBERS = "needs numbers separated by commas, e.g. 1,2.5,-3"
LENGTH = "the characteristic length must lie between 1e-06 and 1e+06 m"
VALUES = {
    "q short": (["--q", "1,2"], f"q needs 4 numbers, got 2 numbers: one per joint, {CHAIN}"),
    "q empty": (["--q", ""], f"--q {NUMBERS}; got none"),
    "q NaN": (["--q", "0,nan,0,0"], f"--q {NUMBERS}; 'nan' is not finite"),
    "q endless": (["--q", "0,0,0,1e400"], f"--q {NUMBERS}; '1e400' is not finite"),
    "q huge": (["--q", "0,0,0,1e308"], "q holds numbers too large to compute with"),
    "q words": (["--q", "a,b,c,d"], f"--q {NUMBERS}; 'a' is not a number"),
    "q of Python": (["--q", "1_0,0,0,0"], f"--q {NUMBERS}; '1_0' is not a number"),
    "q in other digits": (["--q", "٣,0,0,0"], f"--q {NUMBERS}; '٣' is not a number"),
    "q twice": (["--q", "0,0,0,0", "--posture", "home"], "give either q or a posture, not both"),
    "posture": (
        ["--posture", "hme"],
        "no posture 'hme'; there is: home, far, mid-range, zero, sample; did you mean 'home'?",
    ),
    "no posture": (["--posture", ""], "no posture ''; there is: home, far"),
    "tip": (["--tip", "toool"], "no tip link 'toool' in "),
    "tip is root": (["--tip", "base"], "no joint moves the tip 'base' against the base 'base'"),
    "base": (["--base", "l9"], "no base link 'l9' in "),
    "base below": (
        ["--base", "tool", "--tip", "l2"],
        "base link 'tool' does not lie between the ro",
    ),
    "axes": (["--axes", "tol"], "no axes 'tol'; there is: tool, world; did you mean 'tool'?"),
    "task": (["--task", "fq"], "no task component 'fq'; there is: force, moment, wrench, fx, fy"),
    "task twice": (["--task", "fx,fx"], "the task 'fx,fx' needs each component once"),
    "length": (["--length", "0"], f"{LENGTH}, got 0.0"),
    "length NaN": (["--length", "nan"], f"{LENGTH}, got nan"),
    "length tiny": (["--length", "1e-320", "--task", "wrench"], f"{LENGTH}, got 1e-320"),
    "length huge": (["--length", "1e300", "--task", "wrench"], f"{LENGTH}, got 1e+300"),
    "rtol": (["--rtol", "2"], "rtol must lie between 1e-14 and 1, got 2.0"),
    "wary": (["--wary", "1e-9"], "wary must lie between rtol = 1e-06 and 1, got 1e-09"),
    "force": (["--force", "1,2"], "force needs 3 numbers, got 2 numbers: fx, fy, fz of the task"),
    "force of wrench": (
        ["--force", "1,2,3", "--task", "wrench"],
        "force needs 6 numbers, got 3 numbers: fx, fy, fz, mx, my, mz of the task 'wrench'",
    ),
    "force NaN": (["--force", "nan,0,0"], f"--force {NUMBERS}; 'nan' is not finite"),
    "force empty": (["--force", ""], f"--force {NUMBERS}; got none"),
    "force of commas": (["--force", " ,, "], f"--force {NUMBERS}; got none"),
    "torque": (
        ["--torque", "1,2,3"],
        f"torque needs 4 numbers, got 3 numbers: one per joint, {CHAIN}",
    ),
    "torque inf": (["--torque", "0,0,0,-inf"], f"--torque {NUMBERS}; '-inf' is not finite"),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("options", "message"), VALUES.values(), ids=VALUES)
@pytest.mark.parametrize("command", ["analyze", "census"])
def test_values_out_of_place(good, command, options, message):
    line = refused(command, good, *options, "-o", good.parent / "out.csv")
    assert line.removeprefix(f"{good}: ").startswith(message)
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf"]


PAYLOAD = "a payload needs MASS or MASS@x,y,z (kg, m), e.g. 2.5@0,0,0.1; "
GRAVITY = "gravity needs 3 numbers, got {}: x, y, z in m/s², in the root's axes"
LIMITS = "'urdf', 'none' or a TOML or CSV file of limits (joint, effort, brake)"
CONDITIONS = {
    "velocity short": (["--velocity", "1,2"], "velocity needs 4 numbers, got 2 numbers: one per "),
    "velocity NaN": (["--velocity", "1,2,3,nan"], f"--velocity {NUMBERS}; 'nan' is not finite"),
    "velocity empty": (["--velocity", ""], f"--velocity {NUMBERS}; got none"),
    "velocity huge": (["--velocity", "1e200,0,0,0"], "velocity holds numbers too large to comput"),
    "acceleration short": (["--acceleration", "1"], "acceleration needs 4 numbers, got 1 number: "),
    "acceleration inf": (["--acceleration", "0,0,0,inf"], f"--acceleration {NUMBERS}; 'inf' is n"),
    "acceleration empty": (["--acceleration", ","], f"--acceleration {NUMBERS}; got none"),
    "gravity short": (["--gravity", "0,9.81"], GRAVITY.format("2 numbers")),
    "gravity alone": (["--gravity", "9.81"], GRAVITY.format("1 number")),
    "gravity long": (["--gravity", "0,0,0,0"], GRAVITY.format("4 numbers")),
    "gravity empty": (["--gravity", ""], f"--gravity {NUMBERS}; got none"),
    "gravity NaN": (["--gravity", "0,0,nan"], f"--gravity {NUMBERS}; 'nan' is not finite"),
    "gravity words": (["--gravity", "0,0,-g"], f"--gravity {NUMBERS}; '-g' is not a number"),
    "gravity huge": (["--gravity", "0,0,1e300"], "gravity holds numbers too large to compute with"),
    "payload negative": (["--payload", "-1"], "the payload's mass must be 0 kg or more, got -1"),
    "payload NaN": (["--payload", "nan"], f"{PAYLOAD}'nan' is not finite"),
    "payload endless": (["--payload", "inf"], f"{PAYLOAD}'inf' is not finite"),
    "payload huge": (["--payload", "1e300"], f"{PAYLOAD}'1e300' is too large; numbers up to 1e+0"),
    "payload empty": (["--payload", ""], f"{PAYLOAD}'': 1 number needed, got 0"),
    "payload in grams": (["--payload", "500g"], f"{PAYLOAD}'500g' is not a number"),
    "payload with commas": (["--payload", "1,0,0,0"], f"{PAYLOAD}'1,0,0,0' is not a number"),
    "payload nowhere": (["--payload", "1@"], f"{PAYLOAD}'': 3 numbers needed, got 0"),
    "payload in a plane": (["--payload", "1@0,0"], f"{PAYLOAD}'0 0': 3 numbers needed, got 2"),
    "payload in 4D": (["--payload", "1@0,0,0,0"], f"{PAYLOAD}'0 0 0 0': 3 numbers needed, got 4"),
    "payload without mass": (["--payload", "@0,0,0"], f"{PAYLOAD}'': 1 number needed, got 0"),
    "payload at NaN": (["--payload", "1@0,0,nan"], f"{PAYLOAD}'0 0 nan' is not finite"),
    "payload twice": (["--payload", "1@0,0,0@1"], f"{PAYLOAD}'0 0 0@1' is not a number"),
    "limits empty": (["--limits", ""], "limits are 'urdf', 'none', a TOML or CSV file or ftforce."),
    "limits in capitals": (["--limits", "URDF"], f"URDF: needs {LIMITS}, with the ending .toml"),
    "limits without a file": (["--limits", "none.csv"], "none.csv: no such file; a TOML or CSV fi"),
    "limits in a folder": (["--limits", "/"], f"/: needs {LIMITS}"),
    "limits on a device": (["--limits", "/dev/zero"], f"/dev/zero: needs {LIMITS}"),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("options", "message"), CONDITIONS.values(), ids=CONDITIONS)
@pytest.mark.parametrize("command", ["analyze", "census", "capability"])
def test_conditions_out_of_place(good, command, options, message):
    line = refused(command, good, *options, "-o", good.parent / "out.json")
    assert line.startswith(message)
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf"]


FACTOR = "the factor of weak joint"
MODES = {
    "free twice": (["--free", "1,j1"], "joint 1 (j1) is named twice"),
    "free twice, apart": (["--free", "1", "--free", "1"], "joint 1 (j1) is named twice"),
    "free misspelt": (["--free", "J1"], "no joint 'J1' in the chain of 'arm'; there is: j1, j2, j"),
    "free beyond": (["--free", "5"], f"joint number 5 is out of range; the chain has: {CHAIN}"),
    "free finger": (["--free", "left_joint"], "joint 'left_joint' lies outside the chain from "),
    "free follower": (["--free", "gear_joint"], "joint 'gear_joint' mimics 'j1'; name that one"),
    "locked and free": (
        ["--locked", "1", "--free", "j1"],
        "joint 1 (j1) cannot be both locked and free; a joint fails in one mode",
    ),
    "locked and weak": (
        ["--locked", "j2", "--weak", "2:0.5"],
        "joint 2 (j2) cannot be both locked and weak; a joint fails in one mode",
    ),
    "free and weak": (
        ["--free", "2", "--weak", "j2:0.5"],
        "joint 2 (j2) cannot be both free and weak; a joint fails in one mode",
    ),
    "weak without factor": (["--weak", "3"], "a weak joint needs its factor"),
    "weak with nothing": (["--weak", "3:"], f"{FACTOR} '3': '': 1 number needed, got 0"),
    "weak above 1": (["--weak", "3:1.01"], f"{FACTOR} 3 must lie between 0 (no torque) and 1 (f"),
    "weak below 0": (["--weak", "3:-0.1"], f"{FACTOR} 3 must lie between 0 (no torque) and 1 (f"),
    "weak NaN": (["--weak", "3:nan"], f"{FACTOR} '3': 'nan' is not finite"),
    "weak inf": (["--weak", "3:inf"], f"{FACTOR} '3': 'inf' is not finite"),
    "weak in percent": (["--weak", "3:50%"], f"{FACTOR} '3': '50%' is not a number"),
    "weak twice": (["--weak", "3:0.5,j3:0.6"], "joint 3 (j3) is named twice"),
    "weak twice, apart": (["--weak", "3:0.5", "--weak", "3:0.5"], "joint 3 (j3) is named twice"),
    "weak misspelt": (["--weak", "j9:0.5"], "no joint 'j9' in the chain of 'arm'; there is: j1, "),
    "weak beyond": (["--weak", "9:0.5"], "joint number 9 is out of range; the chain has: 1 j1"),
    "weak nobody": (["--weak", ":0.5"], "a factor needs its weak joint, e.g. 3:0.5"),
    "weak with a sign": (["--weak", "j3=0.5"], "a weak joint needs its factor"),
    "weak with two factors": (["--weak", "3:0.5:0.5"], "no joint '3:0.5' in the chain of 'arm'"),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("options", "message"), MODES.values(), ids=MODES)
@pytest.mark.parametrize("command", ["analyze", "capability"])
def test_fault_modes_out_of_place(good, command, options, message):
    line = refused(command, good, *options, "-o", good.parent / "out.csv")
    assert line.startswith(message)
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf"]


DIRECTIONS = {
    "0,0,0": "the direction needs a component that is not zero",
    "-0,0,0": "the direction needs a component that is not zero",
    "1,0": "direction needs 3 numbers, got 2 numbers: fx, fy, fz of the task 'force'",
    "1,0,0,0": "direction needs 3 numbers, got 4 numbers: fx, fy, fz of the task 'force'",
    "nan,0,0": f"--direction {NUMBERS}; 'nan' is not finite",
    "up": f"--direction {NUMBERS}; 'up' is not a number",
    "": f"--direction {NUMBERS}; got none",
    "1e200,0,0": "direction holds numbers too large to compute with",
}


@pytest.mark.parametrize(("direction", "message"), DIRECTIONS.items(), ids=repr)
@pytest.mark.parametrize("command", ["capability", "census"])
def test_directions_out_of_place(good, command, direction, message):
    ranking = ["--rank-by", "capability"] if command == "census" else []
    options = ("--direction", direction, "-o", good.parent / "out.csv")
    line = refused(command, good, *ranking, *options)
    assert line.startswith(message)
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["census", "--mode", "weak"],
            "many sets at once take locked or free joints; ask analyze about ",
        ),
        (["census", "--mode", "broken"], "no fault mode 'broken'; there is: locked, free, weak"),
        (["census", "--mode", ""], "no fault mode ''; there is: locked, free, weak"),
        (["census", "--rank-by", "nonsense"], "no ranking 'nonsense'; there is: jump, capability"),
        (
            ["census", "--rank-by", "capabilty"],
            "no ranking 'capabilty'; there is: jump, capability; did you mean 'capability'?",
        ),
        (["census", "--inverse", "x"], "no inverse 'x'; there is: euclidean, dynamic"),
        (
            ["analyze", "--inverse", "Dynamic"],
            "no inverse 'Dynamic'; there is: euclidean, dynamic; did you mean 'dynamic'?",
        ),
        (["capability", "--task", "fq"], "no task component 'fq'; there is: force, moment"),
        (["capability", "--axes", "tol"], "no axes 'tol'; there is: tool, world; did you mean"),
        (["capability", "--rtol", "2"], "rtol must lie between 1e-14 and 1, got 2.0"),
        (["capability", "--q", "1"], f"q needs 4 numbers, got 1 number: one per joint, {CHAIN}"),
        (["capability", "--length", "0"], f"{LENGTH}, got 0.0"),
    ],
)
def test_words_out_of_place(good, arguments, message):
    command, *options = arguments
    line = refused(command, good, *options, "-o", good.parent / "out.csv")
    assert line.removeprefix(f"{good}: ").startswith(message)
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf"]


def test_the_dynamic_inverse_needs_masses(tmp_path):
    path = write(tmp_path, arm(**{name: link(name, "") for name in LINKS}))
    options = ("--tip", "tool", "--torque", "1,2,3,4", "--inverse", "dynamic")
    for command in ("analyze", "census"):
        line = refused(command, path, *options)
        assert line.startswith("the dynamic inverse needs masses, and the URDF of 'arm' has none; ")


LIMITS_FILES = {
    "unknown joint": ("joint,effort\nj22,1\n", "line 2: no joint 'j22' in the chain of 'arm'; "),
    "joint twice": ("joint,effort\nj2,1\n2,1\n", "line 3: joint 2 (j2) was given in line 2"),
    "fixed joint": ("joint,effort\nmount,1\n", "line 2: joint 'mount' is held fixed: it has no m"),
    "follower": ("joint,effort\ngear_joint,1\n", "line 2: joint 'gear_joint' mimics 'j1'; name "),
    "negative": ("joint,effort\nj2,-1\n", "line 2: effort of j2 needs a positive number, N·m or"),
    "not a number": ("joint,effort\nj2,nan\n", "line 2: effort of j2: 'nan' is not finite; leave"),
    "tiny": ("joint,effort\nj2,1e-300\n", "line 2: effort of j2 needs a positive number, N·m or"),
    "semicolons": ("joint;effort\nj2;1\n", "needs the header joint,effort,brake (brake may be mi"),
    "header only": ("joint,effort\n", "holds no limit; it needs joint, effort, brake for each jo"),
    "empty": ("", "is empty; a TOML or CSV file of limits (joint, effort, brake) was expected"),
    "binary": ("joint\0", "is a binary file; a TOML or CSV file of limits (joint, effort, brake)"),
    "line break": ('joint,effort\n"a\nb",1\n', "line 3: no joint 'a\\nb' in the chain of 'arm'"),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("content", "message"), LIMITS_FILES.values(), ids=LIMITS_FILES)
@pytest.mark.parametrize("command", ["analyze", "census", "capability"])
def test_files_of_limits_that_cannot_be_used(good, command, content, message):
    path = good.parent / "limits.csv"
    path.write_text(content)
    line = refused(command, good, "--limits", path, "-o", good.parent / "out.csv")
    assert line.startswith(f"{path}: {message}")
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf", "limits.csv"]


def test_a_file_of_limits_with_a_line_break_in_its_name(good):
    path = good.parent / "a\nb.csv"
    path.write_text("joint,effort\nj1,1\n")
    shown = run("capability", good, "--limits", path).stdout
    assert "a\\nb.csv" in "".join(line.strip() for line in shown.splitlines())
    path.write_text("joint,effort\nx,1\n")
    assert refused("analyze", good, "--limits", path).startswith(f"{good.parent}/a\\nb.csv: line 2")


@pytest.mark.parametrize("weak", ["3:0", "3:1", "3:1e-9", "3:-0"])
@pytest.mark.parametrize("command", ["analyze", "capability"])
def test_factors_at_the_ends_are_answers(good, command, weak):
    result = run(command, good, "--weak", weak, "--format", "json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["weak_factors"] == {"j3": abs(float(weak[2:]))}


@pytest.mark.parametrize("names", [("a:b", "a.b"), ("left elbow", "3rd"), ("a=b", "-j")])
def test_joints_with_names_of_any_kind_fail_in_any_mode(tmp_path, names):
    one, other = names
    parts = {"j2": joint(one, "l1", "l2"), "j3": joint(other, "l2", "l3")}
    path = write(tmp_path, arm(**parts))
    options = ["--tip", "tool", "--weak", f"{one}:0.5", f"--free={other}", "--format", "json"]
    for command in ("analyze", "capability"):
        result = run(command, path, *options)
        assert result.exit_code == 0, result.output
        assert json.loads(result.stdout)["modes"] == {one: "weak", other: "free"}


@pytest.mark.parametrize("faults", ["0", "-1", "5", "99999999999999999999"])
def test_sizes_of_fault_sets_that_do_not_exist(good, faults):
    message = f"faults must be a number from 1 to 4, got {faults}"
    assert refused("census", good, "--faults", faults) == message


def test_positions_outside_the_limits_are_a_warning(good):
    result = run("analyze", good, "--q", "0,0,5,0", "--format", "json")
    assert result.exit_code == 0
    warning = "outside the joint limits: j3 = 5 (limits -1 to 2 rad)"
    assert result.stderr == f"warning: {warning}\n"
    assert json.loads(result.stdout)["warnings"] == [warning]


def test_degrees_for_radians_are_a_warning(good):
    result = run("analyze", good, "--q", "90,-45,30,20", "--format", "json")
    assert result.exit_code == 0
    assert "these look like degrees, but radians are expected" in result.stderr


# ---- the command line ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["analyze"], "Missing argument 'ROBOT'"),
        (["analise", "dh5"], "No such command 'analise'. Did you mean 'analyze'?"),
        (["analyze", "dh5", "--lock", "1"], "No such option: --lock"),
        (["analyze", "dh5", "--locked"], "'--locked' requires an argument"),
        (["analyze", "dh5", "2"], "unexpected extra argument"),
        (["analyze", "dh5", "--format", "xml"], "'xml' is not one of 'table', 'json', 'csv'"),
        (["analyze", "dh5", "--rtol", "small"], "Invalid value for '--rtol'"),
        (["census", "dh5", "--faults", "2.5"], "Invalid value for '--faults'"),
        (["analyze", "dh5", "--force", "1,2,3", "--torque", "1"], "--force or --torque, not both"),
        (["census", "dh5", "--force", "1,2,3", "--torque", "1"], "--force or --torque, not both"),
        (["capability"], "Missing argument 'ROBOT'"),
        (["capability", "dh5", "--force", "1,2,3"], "No such option: --force"),
        (["capability", "dh5", "--inverse", "dynamic"], "No such option: --inverse"),
        (["capability", "dh5", "--rtol", "small"], "Invalid value for '--rtol'"),
        (["capability", "dh5", "--limits"], "'--limits' requires an argument"),
        (["analyze", "dh5", "--mode", "free"], "No such option: --mode"),
        (["analyze", "dh5", "--direction", "1,0,0"], "No such option: --direction"),
        (["census", "dh5", "--locked", "1"], "No such option: --locked"),
        (["census", "dh5", "--weak", "1:0.5"], "No such option: --weak"),
        (["census", "dh5", "--direction", "1,0,0"], "--direction counts only with --rank-by capa"),
        (["capabilities", "dh5"], "No such command 'capabilities'. Did you mean 'capability'?"),
    ],
)
def test_wrong_command_lines(arguments, message):
    assert message in misused(*arguments)


# ---- writing ---------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("output", "reason"),
    [
        ("folder", "it is a folder"),
        ("none/out.json", "No such file or directory"),
        ("arm.urdf/out.json", "Not a directory"),
        ("x" * 300 + ".json", "File name too long"),
    ],
)
def test_outputs_that_cannot_be_written(good, monkeypatch, command, output, reason):
    monkeypatch.chdir(good.parent)
    Path("folder").mkdir()
    line = refused(command, good, "-o", output)
    assert line.startswith(f"{output}: cannot be written")
    assert reason in line
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf", "folder"]


def test_a_full_device(good, tmp_path_factory):
    device = full_device(tmp_path_factory.mktemp("devices"))
    for command in COMMANDS:
        line = refused(command, good, "-o", device)
        assert line == f"{device}: cannot be written (No space left on device)"
    assert device.is_char_device()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder(good):
    folder = good.parent / "closed"
    folder.mkdir(mode=0o500)
    line = refused("analyze", good, "-o", folder / "out.json")
    assert line == f"{folder / 'out.json'}: cannot be written (Permission denied)"
    assert names_in(folder) == []


def test_a_disk_that_fills_up_leaves_the_old_result(good):
    """A limit on the size of files fails in the middle of writing, as a full disk does."""
    output = good.parent / "out.json"
    output.write_text("old")
    done = in_a_process(
        "census", good, "--faults", "3", "-o", output,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000)),
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.strip() == f"error: {output}: cannot be written (File too large)"
    assert output.read_text() == "old"
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf", "out.json"]


# ---- as a program ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (arm()[:-30], "is not well-formed XML"),
        (LAUGHS, "contains a DTD"),
        ("<a>" * 200_000 + "</a>" * 200_000, "root element is <a>"),
        (
            robot(
                *(link(f"l{i}") for i in range(4500)),
                *(joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(4499)),
            ),
            "has 4500 links in a row; at most 150 are read",
        ),
    ],
    ids=["broken", "laughs", "nested", "row"],
)
def test_the_program_neither_crashes_nor_shows_a_traceback(tmp_path, content, message):
    path = write(tmp_path, content)
    done = in_a_process("inspect", path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"error: {path}: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_debug_shows_the_traceback(tmp_path):
    done = in_a_process("inspect", write(tmp_path, "<robot/>"), "--debug")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "holds no <link>" in done.stderr.splitlines()[-1]


def test_a_pipe_is_a_file_too(good):
    options = ("--tip", "tool", "--format", "json")
    done = in_a_process("inspect", "/dev/stdin", *options, input=good.read_text())
    assert done.returncode == 0
    assert json.loads(done.stdout)["joints"] == ["j1", "j2", "j3", "j4"]


def test_a_pipe_that_nobody_writes_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    done = in_a_process("inspect", tmp_path / "pipe")
    assert done.stderr == f"error: {tmp_path / 'pipe'}: is empty; a URDF was expected\n"
    assert done.returncode == 1


def test_a_closed_stderr_does_not_matter(good):
    program = f'"{sys.executable}" -m ftforce inspect "{good}" --format json 2>&-'
    done = subprocess.run(["sh", "-c", program], capture_output=True, check=False, timeout=60)
    assert done.returncode == 0
    assert json.loads(done.stdout)["tip"] == "tool"


@pytest.mark.parametrize("name", ["[red]x[/red]", "[/]", "&lt;b&gt;", "関節", "a b", ":smile:"])
def test_names_are_shown_as_they_are(tmp_path, name):
    """Nothing in a name is markup for the terminal."""
    shown = name.replace("&lt;", "<").replace("&gt;", ">")
    path = write(tmp_path, arm(j2=joint(name, "l1", "l2")).replace('"tool"', f'"{name}"'))
    assert shown in run("inspect", path).stdout
    assert shown in run("analyze", path, "--locked", "2").stdout
    assert json.loads(run("inspect", path, "--format", "json").stdout)["tip"] == shown
    assert shown in refused("analyze", path, "--locked", "nobody")
