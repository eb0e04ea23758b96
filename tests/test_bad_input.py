"""What a user can get wrong at the command line: one clear line, and nothing half-written.

Exit status 1 is wrong input, 2 a command line that is wrong whatever the robot and the files are.
What each line says is tested where it is made; here it is that every kind of mistake comes out as
one.
"""

import json
import os
from pathlib import Path

import pytest

from test_cli import run
from urdfs import arm, end_effector, full_device, hand, joint, link, mimic, robot, state, write

COMMANDS = ("analyze", "census", "capability", "inspect")


def refused(*arguments, status=1):
    """Return the one line that a command says instead of an answer."""
    result = run(*map(str, arguments), status=status)
    assert isinstance(result.exception, SystemExit), repr(result.exception)
    assert result.stdout == ""
    # A progress bar that never started may leave an empty line.
    line = result.stderr.removeprefix("\n")
    assert line.startswith("error: ")
    assert line.endswith("\n")
    assert line.count("\n") == 1, line
    return line.removeprefix("error: ").removesuffix("\n")


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


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
ROW = robot(
    *(link(f"l{i}") for i in range(4500)),
    *(joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(4499)),
)
FILES = {
    "empty": (b"", "is empty; expected a URDF"),
    "cut off": (arm()[:-30], "is not well-formed XML (unclosed token: line 1"),
    "laughs": (LAUGHS, "contains a DTD"),
    "nested": ("<a>" * 200_000 + "</a>" * 200_000, "is not a URDF: its root element is <a>, not"),
    "row": (ROW, "is 4500 links deep; at most 150 are supported"),
    "branches": (
        robot(*map(link, "abc"), joint("x", "a", "b"), joint("y", "a", "c")),
        "which tip? the tree branches into several moving parts at the link 'a'; choose a tip (--",
    ),
}


@pytest.mark.parametrize(("content", "message"), FILES.values(), ids=FILES)
def test_files_that_are_no_robots(tmp_path, content, message):
    path = write(tmp_path, content)
    for command in COMMANDS if content == b"" else COMMANDS[:1]:
        line = refused(command, path, "-o", tmp_path / "out.json")
        assert line.startswith(f"{path}: {message}")
    assert names_in(tmp_path) == ["arm.urdf"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("./panda", "./panda: no such file; expected a URDF"),
        (".", ".: is a folder; expected a URDF"),
        ("/dev/null", "/dev/null: is not a regular file; expected a URDF"),
        ("pand", "unknown robot or file 'pand'; available: dh5, panda, ur3, "),
        ("[bold]x[/].urdf", "[bold]x[/].urdf: no such file"),
    ],
)
def test_robots_that_are_not_there(tmp_path, monkeypatch, name, message):
    monkeypatch.chdir(tmp_path)
    assert refused("inspect", name).startswith(message)


def test_other_files_in_the_place_of_a_urdf(tmp_path):
    path = write(tmp_path, arm(), "<robot>")
    assert refused("analyze", path).startswith(f"{tmp_path / 'arm.srdf'}: is not well-formed XML")
    limits = write(tmp_path, "[joints.j1]\neffort = 1\n", name="limits.toml")
    assert "limits.toml: unknown key 'joints'; available: name, " in refused("inspect", limits)
    limits.unlink()
    assert "is not valid TOML" in refused("dh", path, "-o", tmp_path / "x.urdf")
    assert names_in(tmp_path) == ["arm.srdf", "arm.urdf"]


# ---- values ----------------------------------------------------------------------------------

NUMBERS = "needs numbers separated by commas, e.g. 1,2.5,-3"
VALUES = {
    "lock": ("analyze", ["--locked", "0"], "joint number 0 is out of range; the chain has: 1 j1, "),
    "lock with sign": ("analyze", ["--locked", "--5"], "unknown joint '--5'"),
    "lock of 5000 digits": ("analyze", ["--locked", "9" * 5000], "unknown joint '9999"),
    "lock of a finger": ("analyze", ["--locked", "left_joint"], "joint 'left_joint' lies outside"),
    "lock of a camera": ("analyze", ["--locked", "mount"], "joint 'mount' is held fixed and has "),
    "lock of a gear": ("capability", ["--locked", "gear_joint"], "joint 'gear_joint' mimics 'j1'"),
    "free": ("capability", ["--free", "1", "--free", "1"], "joint 1 (j1) appears twice"),
    "weak": ("analyze", ["--weak", "3"], "a weak joint needs a factor"),
    "weak nothing": (
        "analyze",
        ["--weak", "3:"],
        "the factor of weak joint '3': '': expected 1 number, got 0",
    ),
    "weak in percent": (
        "capability",
        ["--weak", "3:50%"],
        "the factor of weak joint '3': '50%' is",
    ),
    "two modes": (
        "analyze",
        ["--locked", "j2", "--weak", "2:0.5"],
        "joint 2 (j2) cannot be both locked and weak; a joint fails in only one mode",
    ),
    "q": ("analyze", ["--q", "1,2"], "q needs 4 numbers, got 2 numbers: one per joint, 1 j1, 2 j2"),
    "q empty": ("census", ["--q", ""], "--q is empty (is a shell variable not set?)"),
    "q twice": ("census", ["--q", "0,0,0,0", "--posture", "home"], "give either q or a posture, n"),
    "posture": (
        "analyze",
        ["--posture", "hme"],
        "unknown posture 'hme'; available: home, far, mid-range, zero, bent, sample; did you mean ",
    ),
    "tip": ("inspect", ["--tip", "toool"], "unknown tip link 'toool' in "),
    "base": ("capability", ["--base", "l9"], "unknown base link 'l9' in "),
    "base below": (
        "census",
        ["--base", "tool", "--tip", "l2"],
        "base link 'tool' does not lie between the ro",
    ),
    "axes": (
        "capability",
        ["--axes", "tol"],
        "unknown axes 'tol'; available: tool, world; did you mean",
    ),
    "task": (
        "census",
        ["--task", "fq"],
        "unknown task component 'fq'; available: force, moment, wrench",
    ),
    "length": ("analyze", ["--length", "nan"], "the characteristic length must lie between 1e-06 "),
    "rtol": ("census", ["--rtol", "2"], "rtol must lie between 1e-14 and 1, got 2.0"),
    "wary": ("analyze", ["--wary", "1e-9"], "wary must lie between rtol = 1e-06 and 1, got 1e-09"),
    "force": ("census", ["--force", "1,2"], "force needs 3 numbers, got 2 numbers: fx, fy, fz of "),
    "force NaN": ("analyze", ["--force", "nan,0,0"], f"--force {NUMBERS}; 'nan' is not finite"),
    "torque": ("census", ["--torque", "0,-inf"], f"--torque {NUMBERS}; '-inf' is not finite"),
    "velocity": (
        "capability",
        ["--velocity", "1e200,0,0,0"],
        "velocity contains numbers too large",
    ),
    "acceleration": ("census", ["--acceleration", "1"], "acceleration needs 4 numbers, got 1 num"),
    "gravity": ("capability", ["--gravity", "9.81"], "gravity needs 3 numbers, got 1 number: x, y"),
    "payload": ("census", ["--payload", "500g"], "a payload needs MASS or MASS@x,y,z (kg, m), "),
    "limits": (
        "census",
        ["--limits", "URDF"],
        "URDF: expected 'urdf', 'none' or a TOML, YAML or CSV file",
    ),
    "limits empty": (
        "analyze",
        ["--limits", ""],
        "--limits is empty (is a shell variable not set?); give urdf|FILE|none, or leave it out",
    ),
    "inverse": (
        "analyze",
        ["--inverse", "Dynamic"],
        "unknown inverse 'Dynamic'; available: euclidean, ",
    ),
    "direction": ("capability", ["--direction", "0,0,0"], "the direction must not be zero"),
    "no direction": ("capability", ["--direction", "up"], f"--direction {NUMBERS}; 'up' is not a"),
    "mode": ("census", ["--mode", "weak"], "fault sets of many joints are locked or free"),
    "ranking": ("census", ["--rank-by", "x"], "unknown ranking 'x'; available: jump, capability"),
    "faults": ("census", ["--faults", "5"], "faults must be an integer from 1 to 4, got 5"),
}


# No number where there must be one, or none of a few words: no robot would make it right.
NOT_UNDERSTOOD = {"q empty", "limits empty", "force NaN", "torque", "no direction"}
NOT_UNDERSTOOD |= {"axes", "task", "inverse", "ranking"}


@pytest.mark.parametrize("case", VALUES)
def test_values_out_of_place(good, case):
    command, options, message = VALUES[case]
    status = 2 if case in NOT_UNDERSTOOD else 1
    line = refused(command, good, *options, "-o", good.parent / "out.csv", status=status)
    assert line.removeprefix(f"{good}: ").startswith(message)
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf"]


def test_a_joint_called_like_the_wrong_word_is_a_value(good):
    """The status follows from which word is wrong, not from which words there are."""
    line = refused("analyze", good, "--locked", "force", "--task", "force", status=1)
    assert line.startswith("unknown joint 'force'")


@pytest.mark.parametrize("command", ["analyze", "census", "capability"])
def test_files_of_limits_that_cannot_be_used(good, command):
    path = good.parent / "a\nb.csv"
    path.write_text("joint,effort\nj22,1\n")
    line = refused(command, good, "--limits", path, "-o", good.parent / "out.csv")
    assert line.startswith(
        f"{good.parent}/a\\nb.csv: line 2: unknown joint 'j22' in the chain of 'arm'"
    )
    assert names_in(good.parent) == ["a\nb.csv", "arm.srdf", "arm.urdf"]


def test_factors_at_the_ends_are_answers(good):
    for weak in ("3:0", "3:1", "3:-0"):
        result = run("capability", str(good), "--weak", weak, "--format", "json")
        assert json.loads(result.stdout)["weak_factors"] == {"j3": abs(float(weak[2:]))}


@pytest.mark.parametrize("names", [("a:b", "a.b"), ("left elbow", "3rd"), ("a=b", "-j")])
def test_joints_with_names_of_any_kind_fail_in_any_mode(tmp_path, names):
    one, other = names
    parts = {"j2": joint(one, "l1", "l2"), "j3": joint(other, "l2", "l3")}
    path = str(write(tmp_path, arm(**parts)))
    options = ["--tip", "tool", "--weak", f"{one}:0.5", f"--free={other}", "--format", "json"]
    found = json.loads(run("analyze", path, *options).stdout)
    assert found["modes"] == {one: "weak", other: "free"}


def test_doubtful_positions_are_a_warning(good):
    options = ["--q", "0,0,5,0", "--gravity", "0,0,0", "--format", "json"]
    result = run("analyze", str(good), *options)
    warning = "outside the joint limits: j3 = 5 (limits -1 to 2 rad)"
    assert result.stderr == f"warning: {warning}\n"
    assert json.loads(result.stdout)["warnings"] == [warning]


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
        (["census", "dh5", "--faults", "2.5"], "Invalid value for '--faults'"),
        (["analyze", "dh5", "--force", "1,2,3", "--torque", "1"], "--force or --torque, not both"),
        (["census", "dh5", "--force", "1,2,3", "--torque", "1"], "--force or --torque, not both"),
        (["capability", "dh5", "--force", "1,2,3"], "ftforce capability has no --force"),
        (["census", "dh5", "--direction", "1,0,0"], "--direction requires --rank-by capability"),
    ],
)
def test_wrong_command_lines(arguments, message):
    assert message in refused(*arguments, status=2)


def test_the_one_line_names_the_help(good):
    line = refused("census", good, "--ranked", status=2)
    assert line.startswith("No such option: --ranked")
    assert line.endswith("(see `ftforce census --help`)")


# ---- writing ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        ("folder", "it is a folder"),
        ("none/out.json", "No such file or directory"),
        ("arm.urdf/out.json", "Not a directory"),
        ("x" * 300 + ".json", "File name too long"),
    ],
)
def test_outputs_that_cannot_be_written(good, monkeypatch, output, reason):
    monkeypatch.chdir(good.parent)
    Path("folder").mkdir()
    line = refused("inspect", good, "-o", output)
    assert line.startswith(f"{output}: cannot be written")
    assert reason in line
    assert names_in(good.parent) == ["arm.srdf", "arm.urdf", "folder"]


def test_a_full_device(good, tmp_path_factory):
    device = full_device(tmp_path_factory.mktemp("devices"))
    result = run("inspect", str(good), "-o", str(device), status=1)
    assert result.stderr == f"error: {device}: cannot be written (No space left on device)\n"
    assert result.stdout == run("inspect", str(good)).stdout  # the answer is shown
    assert device.is_char_device()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder(good):
    folder = good.parent / "closed"
    folder.mkdir(mode=0o500)
    line = refused("analyze", good, "-o", folder / "out.json")
    assert line == f"{folder / 'out.json'}: cannot be written (Permission denied)"
    assert names_in(folder) == []


@pytest.mark.parametrize("name", ["[red]x[/red]", "[/]", "&lt;b&gt;", "関節", "a b", ":smile:"])
def test_names_are_shown_as_they_are(tmp_path, name):
    """Nothing in a name is markup for the terminal."""
    shown = name.replace("&lt;", "<").replace("&gt;", ">")
    path = write(tmp_path, arm(j2=joint(name, "l1", "l2")).replace('"tool"', f'"{name}"'))
    assert shown in run("inspect", str(path)).stdout
    assert shown in run("analyze", str(path), "--locked", "2").stdout
    assert shown in refused("analyze", path, "--locked", "nobody")
