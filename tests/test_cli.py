"""The commands as a user types them: what they print, write and return."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shlex
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import ftforce
from ftforce import cli
from ftforce.cli import options as common
from ftforce.cli import printing
from ftforce.cli.command import PANELS
from ftforce.cli.examples import ELSEWHERE, EXAMPLES
from urdfs import full_device

DH5 = str(Path(__file__).parents[1] / "robots" / "dh5.urdf")
PAPER = ["--force", "80,50,10", "--posture", "paper"]


def run(*arguments: str, status: int = 0, env=None):
    environment = {"COLUMNS": "80", **(env or {})}
    result = CliRunner().invoke(cli.app, list(arguments), env=environment)
    assert result.exit_code == status, result.output
    return result


def document(*arguments: str):
    return json.loads(run(*arguments, "--format", "json").stdout)


def test_version():
    assert run("--version").stdout == f"ftforce {ftforce.__version__}\n"


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_explains_its_options(command):
    shown = run(command, "--help", env={"COLUMNS": "120"}).stdout
    described = typer.main.get_command(cli.app).commands[command].params
    options = [option for one in described for option in one.opts if option.startswith("--")]
    assert "--debug" in options
    for option in options:
        assert re.search(rf"{option}\s", shown), option
    assert all(one.help for one in described if one.name != "help")


def commands():
    return typer.main.get_command(cli.app).commands


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_help_in_80_columns_breaks_no_word(command):
    shown = run(command, "--help").stdout
    assert max(map(len, shown.splitlines())) <= 80
    words = set(re.sub("[│╭╮╰╯─]", " ", shown).split())
    for parameter in commands()[command].params:
        if parameter.param_type_name == "option":
            assert set(parameter.help.split()) <= words, parameter.name
            assert parameter.is_flag or parameter.metavar in words, parameter.name
            assert "by default" not in parameter.help, "defaults are said in one way"
    assert "[default" not in shown


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_options_stand_below_headings(command):
    shown = run(command, "--help").stdout
    found = re.findall("^╭─ (.*?) ─+╮$", shown, re.MULTILINE)
    known = ["Arguments", *PANELS]
    assert found == sorted(found, key=known.index)
    assert "Options" not in found
    for panel, names in PANELS.items():
        described = [one for one in commands()[command].params if one.name in names.split()]
        options = [one for one in described if one.param_type_name == "option"]
        body = re.findall(f"^╭─ {panel} ─+╮$(.*?)^╰", shown, re.MULTILINE | re.DOTALL)
        for option in options:
            assert re.search(rf"^│ {option.opts[0]} ", body[0], re.MULTILINE), option.name


def test_defaults_are_said():
    shown = " ".join(re.sub("[│\n]", " ", run("sweep", "-h").stdout).split())
    for words in (
        "How the joints fail. Default: locked.",
        "the same postures. Default: 0.",
        "Threads on this machine. Default: all processors.",
        "Tip link. Default: the robot's own.",
        "0,0,0 in free fall. Default: the model's.",
    ):
        assert words in shown


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_help_has_two_examples_that_can_be_typed(command):
    """`nox -s examples` runs them."""
    examples = EXAMPLES[command]
    assert len(examples) == 2
    shown = run(command, "--help").stdout
    for example in examples:
        assert f"   ftforce {example}\n" in shown
        name, *words = shlex.split(example)
        assert name == command
        commands()[name].make_context(name, words)  # every option exists and has its value


@pytest.mark.thorough  # dozens of commands
def test_what_another_option_or_command_answers_is_named():
    for (command, option), where in ELSEWHERE.items():
        result = run(command, "dh5", option, "3", status=2)
        assert result.stderr == f"error: ftforce {command} has no {option}: {where}\n"
        for name in re.findall("`ftforce ([a-z]+)", where):
            assert option in {"--direction", "--plot"} or option in flat_options(name), where
        for other in re.findall("--[a-z-]+", where.partition("; for one set")[0]):
            assert other in {one for name in cli.COMMANDS for one in flat_options(name)}
    assert "No such option: --bla" in run("analyze", "dh5", "--bla", status=2).stderr


def flat_options(command):
    return [option for one in commands()[command].params for option in one.opts]


def test_no_arguments_show_the_help():
    assert "analyze" in run(status=2).output


def test_analyze_prints_the_papers_case():
    output = run("analyze", DH5, "--locked", "2,4,5", *PAPER).stdout
    for expected in ("{2, 4, 5} joint2, joint4, joint5", "43.66", "-35.01", "Not tolerated"):
        assert expected in output
    assert all(len(line) <= 80 for line in output.splitlines())


@pytest.mark.parametrize(
    "given",
    [["--locked", "2,4"], ["--locked", "joint4,joint2"], ["--locked", "2", "--locked", "joint4"]],
)
def test_joints_are_numbers_or_names(given):
    assert document("analyze", DH5, *given)["locked"] == ["joint2", "joint4"]


WHOLE = [
    "--velocity",
    ".1,.2,.3,.4,.5",
    "--acceleration",
    "1,2,3,4,5",
    "--gravity",
    "1,0,-9",
    "--payload",
    "1.5@0,0,0.1",
    "--limits",
    "urdf",
]
SAME = {
    "velocity": [0.1, 0.2, 0.3, 0.4, 0.5],
    "acceleration": [1, 2, 3, 4, 5],
    "gravity": [1, 0, -9],
    "payload": (1.5, (0, 0, 0.1)),
    "limits": "urdf",
}


def test_options_of_analyze_are_those_of_the_function():
    faults = ["--locked", "2", "--free", "joint4", "--weak", "3:0.5,1:0.9"]
    result = document("analyze", DH5, *faults, *WHOLE, *PAPER)
    arm = ftforce.load_robot(DH5)
    case = {"locked": [2], "free": [4], "weak": {3: 0.5, 1: 0.9}, "posture": "paper"}
    whole = ftforce.to_dict(ftforce.analyze(arm, **case, **SAME, force=[80, 50, 10]))
    assert result == json.loads(json.dumps(whole))
    assert list(result["modes"]) == ["joint1", "joint2", "joint3", "joint4"]
    torque = ["--torque", "1,2,3,4,5", "--inverse", "dynamic", "--gravity", "0,0,0"]
    result = document("analyze", DH5, *torque)
    whole = ftforce.analyze(arm, torque=[1, 2, 3, 4, 5], inverse="dynamic", gravity=[0, 0, 0])
    assert result == json.loads(json.dumps(ftforce.to_dict(whole)))


def test_options_of_census_are_those_of_the_function():
    ranking = ["--mode", "free", "--rank-by", "capability", "--direction", "1,0,1"]
    result = document("census", DH5, *ranking, *WHOLE, *PAPER)
    arm = ftforce.load_robot(DH5)
    case = {"mode": "free", "rank_by": "capability", "direction": [1, 0, 1], "posture": "paper"}
    whole = ftforce.to_dict(ftforce.census(arm, **case, **SAME, force=[80, 50, 10]))
    assert result == json.loads(json.dumps(whole))


def test_options_of_capability_are_those_of_the_function():
    options = ["--locked", "2", "--weak", "3:0.5", "--direction", "1,0,1", "--axes", "world"]
    result = document("capability", DH5, *options, *WHOLE, "--q", ".1,.2,.3,.4,.5")
    arm = ftforce.load_robot(DH5)
    case = {"locked": [2], "weak": {3: 0.5}, "direction": [1, 0, 1], "axes": "world"}
    whole = ftforce.to_dict(ftforce.capability(arm, [0.1, 0.2, 0.3, 0.4, 0.5], **case, **SAME))
    assert result == json.loads(json.dumps(whole))


def test_limits_come_from_a_file(tmp_path):
    path = tmp_path / "my limits.csv"
    path.write_text("joint,effort,brake\njoint3,20,\n2,,7\n")
    for command in ("analyze", "census", "capability"):
        limits = document(command, DH5, "--limits", str(path))["limits"]
        assert limits["source"] == str(path)
        assert limits["effort"]["joint3"] == 20.0
        assert limits["brake"]["joint2"] == 7.0
        assert limits["effort"]["joint2"] is None
        assert "limits.csv" in run(command, DH5, "--limits", str(path)).stdout


def test_capability_says_what_is_left():
    output = run("capability", "panda", "--locked", "2,4", "--direction", "1,1,0").stdout
    for expected in ("+fz", "162.3", "requested", "fault of panda_joint2", "11.26 panda_joint6"):
        assert expected in output
    assert all(len(line) <= 80 for line in output.splitlines())
    assert "With panda_joint2 and panda_joint4 locked, no motor torque can" in output


def test_census_table_and_top():
    output = run("census", "panda", "--faults", "2", "--top", "3", "--force", "1,2,3").stdout
    assert "… and 25 more" in output
    assert "Joints, most critical first" in output
    assert "Worst ρ of 2 joints" in output
    assert all(len(line) <= 80 for line in output.splitlines())


def test_long_census_shows_progress(monkeypatch):
    monkeypatch.setattr(sys.modules["ftforce.cli.progress"], "PATIENCE", -1.0)
    result = run("census", DH5, "--faults", "2", env={"FORCE_COLOR": "1", "NO_COLOR": ""})
    assert "fault sets" in result.stderr
    assert "15/15" in result.stderr
    assert run("census", DH5, "--faults", "2").stderr == ""  # not into a file or pipe


def test_inspect():
    output = run("inspect", "tiago").stdout
    for expected in ("torso_lift_joint", "prismatic", "2000 N", "held fixed", "kg", "Tip"):
        assert expected in output
    result = document("inspect", "kinova")
    assert result["limits"]["j2s6s200_joint_1"]["lower"] is None  # continuous
    assert "work" in result["postures"]


def test_inspect_says_unknown_effort():
    assert "unknown" in run("inspect", "so101").stdout
    rows = list(csv.DictReader(io.StringIO(run("inspect", "so101", "--format", "csv").stdout)))
    assert rows[0]["effort"] == ""
    assert rows[0]["effort_unit"] == "N·m"


def test_robots():
    output = run("robots").stdout
    for name in ("panda", "ur5", "talos_left_arm", "pr2_right", "dh5", "so101"):
        assert name in output
    assert len(document("robots")) >= 15


def test_replicate():
    output = run("replicate").stdout
    assert "91 pass, 8 explained by errata, 0 fail" in output
    assert "43.66 43.66 ✓" in output
    assert document("replicate")["successful"] is True
    rows = list(csv.DictReader(io.StringIO(run("replicate", "--format", "csv").stdout)))
    assert len(rows) == 99


def test_replicate_takes_another_arm_with_its_chain():
    told = run("replicate", "--robot", "tiago", "--tip", "arm_tool_link", "--force", "0,0,9")
    assert "→ arm_tool_link" in told.stdout
    assert "of the slides (1): J in m/m, torques in N" in " ".join(told.stdout.split())
    assert "give --robot" in run("replicate", "--tip", "tool", status=2).output


def test_replicate_fails_if_a_number_differs(monkeypatch):
    printed = ("-35.02", "-12.33", "26.85", "10.00", "4.00")
    monkeypatch.setattr("ftforce.analysis.paper.PRINTED_TORQUE", printed)
    result = run("replicate", status=1)
    assert "1 fail" in result.stdout
    assert "-35.02 -35.01 ✗" in result.stdout


def test_dh_makes_the_committed_robot(tmp_path):
    table = Path(DH5).with_suffix(".toml")
    made = tmp_path / "dh5.urdf"
    run("dh", str(table), "-o", str(made))
    assert made.read_bytes() == Path(DH5).read_bytes()
    assert made.with_suffix(".srdf").read_bytes() == Path(DH5).with_suffix(".srdf").read_bytes()


@pytest.mark.parametrize("command", ["analyze", "capability"])
@pytest.mark.parametrize("ending", ["json", "csv", "txt", "svg", "html"])
def test_output_follows_the_ending(tmp_path, command, ending):
    file = tmp_path / f"result.{ending}"
    result = run(command, DH5, "--locked", "3", "-o", str(file))
    shown = run(command, DH5, "--locked", "3").stdout  # the answer is not lost to whoever asks
    assert result.stdout == f"{shown}wrote {file}\n"
    start = {"json": "{", "csv": "quantity,", "txt": "Robot", "svg": "<svg", "html": "<!doctype"}[
        ending
    ]
    assert file.read_text(encoding="utf-8").startswith(start)
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_file_names_are_shown_on_one_line(tmp_path):
    made = tmp_path / "a\nb"
    result = run("dh", str(Path(DH5).with_suffix(".toml")), "-o", f"{made}.urdf")
    assert result.stdout.startswith(f"wrote {tmp_path}/a\\nb.urdf and {tmp_path}/a\\nb.srdf: ")
    assert result.stdout.count("\n") == 1
    result = run("analyze", f"{made}.urdf", "-o", f"{made}.json")
    assert result.stdout.endswith(f"\nwrote {tmp_path}/a\\nb.json\n")
    result = run("analyze", f"{made}.json", status=1)
    assert result.stderr.startswith(f"error: {tmp_path}/a\\nb.json: is not well-formed XML")
    assert result.stderr.count("\n") == 1


def test_format_wins_over_the_ending(tmp_path):
    file = tmp_path / "result.txt"
    run("analyze", DH5, "--locked", "3", "-o", str(file), "--format", "json")
    assert json.loads(file.read_text(encoding="utf-8"))["locked"] == ["joint3"]


def test_an_output_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "result.json"
    file.write_text("old", encoding="utf-8")

    def refuse(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    result = run("analyze", DH5, "-o", str(file), status=1)
    assert "No space left on device" in result.stderr
    assert file.read_text(encoding="utf-8") == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_errors_are_one_line_and_debug_shows_more():
    result = run("analyze", DH5, "--locked", "9", status=1)
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("error: joint number 9 is out of range")
    assert result.stdout == ""
    with pytest.raises(ftforce.FtforceError):
        CliRunner().invoke(
            cli.app, ["analyze", DH5, "--locked", "9", "--debug"], catch_exceptions=False
        )


def test_a_mistake_of_ours_is_no_traceback(monkeypatch):
    def fail(*_, **__):
        raise KeyError("elbow")

    monkeypatch.setattr("ftforce.analysis.analyze.analyze", fail)
    result = run("analyze", DH5, status=1)
    assert result.stderr == (
        "error: internal error in ftforce, please report it (KeyError('elbow')); "
        "--debug shows the traceback\n"
    )
    with pytest.raises(KeyError):
        CliRunner().invoke(cli.app, ["analyze", DH5, "--debug"], catch_exceptions=False)


def test_a_lack_of_memory_is_the_machines(monkeypatch):
    def fail(*_, **__):
        raise MemoryError("Unable to allocate 9.3 TiB")

    monkeypatch.setattr("ftforce.analysis.analyze.analyze", fail)
    assert run("analyze", DH5, status=1).stderr == (
        "error: this machine has too little free memory for what is asked "
        "(unable to allocate 9.3 TiB)\n"
    )


def test_interruption_is_no_traceback():
    @common.guarded
    def command() -> None:
        raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as stop:
        command()
    assert stop.value.exit_code == 130


@pytest.mark.parametrize("text", ["1,x,3", "1,x", "one"])
def test_vectors_are_numbers(text):
    with pytest.raises(
        typer.BadParameter, match=r"--q needs numbers separated by commas, .*is not"
    ):
        common.numbers(text, "--q")


def test_commas_and_blanks_separate_numbers():
    assert common.numbers("80 50,10", "--force") == [80.0, 50.0, 10.0]
    assert common.numbers(None, "--force") is None
    with pytest.raises(typer.BadParameter, match=r"--force needs .*; got none"):
        common.numbers(" ,, ", "--force")


@pytest.mark.parametrize("text", ["1,,2,3", "1,2,3,", ",1,2,3", "1, ,2,3"])
def test_no_number_beside_a_comma_is_no_number_less(text):
    """As of `80,$FY,50,10` with FY not set: three numbers are left, and they fit."""
    with pytest.raises(typer.BadParameter, match=r"nothing stands beside a comma in"):
        common.numbers(text, "--force")


EMPTY = {
    "--locked": "JOINTS",
    "--free": "JOINTS",
    "--weak": "JOINT:FACTOR",
    "--force": "FX,FY,FZ",
    "--limits": "urdf|FILE|none",
    "--output": "FILE",
    "--joint-length": "M",
}


@pytest.mark.parametrize("option", EMPTY)
@pytest.mark.parametrize("value", ["", " "])
def test_an_empty_value_never_means_that_nothing_failed(option, value):
    """As of `--locked "$JOINTS"` with JOINTS not set."""
    leave = f"give {EMPTY[option]}, or leave it out"
    line = f"error: {option} is empty (is a shell variable not set?); {leave}\n"
    for words in ([option, value], [f"{option}={value}"], ["--locked", "2", option, value]):
        result = run("analyze", DH5, *words, status=2)
        assert (result.stdout, result.stderr) == ("", line)


@pytest.mark.thorough  # every option of every command
def test_every_command_rejects_empty_values():
    group = typer.main.get_command(cli.app)
    for name, command in group.commands.items():
        for parameter in command.params:
            if parameter.param_type_name == "option" and not parameter.is_flag:
                result = run(name, parameter.opts[0], "", status=2)
                assert result.stderr.startswith(f"error: {parameter.opts[0]} is empty ("), name
    assert run("analyze", "", status=2).stderr.startswith("error: ROBOT is empty")
    assert "Usage: ftforce analyze" in run("analyze", "--locked", "", "--help").stdout


@pytest.mark.parametrize("option", ["--locked", "--free", "--weak"])
@pytest.mark.parametrize("value", ["1:0.5,", ",1:0.5", "1:0.5,,2:0.5", "1:0.5, ,2:0.5", ","])
def test_an_empty_item_never_means_one_joint_less(option, value):
    value = value if option == "--weak" else value.replace(":0.5", "")
    result = run("analyze", DH5, option, value, status=2)
    assert result.stderr == (
        f"error: {option}: joints are given as numbers or names, e.g. 2,4; got an empty item in "
        f"{value!r}\n"
    )


def test_an_option_of_one_value_is_given_once():
    result = run("analyze", DH5, "--force", "1,2,3", "--force", "1,2,4", status=2)
    assert result.stderr == "error: --force is given 2 times; give it once\n"
    assert document("analyze", DH5, "--deg", "--deg") == document("analyze", DH5)


@pytest.mark.parametrize("command", [[], ["analyze"], ["sweep"]])
def test_h_is_help(command):
    assert run(*command, "-h").stdout == run(*command, "--help").stdout


def test_several_outputs_are_all_written(tmp_path):
    names = [str(tmp_path / name) for name in ("a.json", "b.csv", "c.txt", "d.svg", "e.pdf")]
    outputs = ["-o", names[0], "-o", names[1], "-o", names[2], "--plot", names[3]]
    case = ["capability", DH5, "--locked", "3"]
    result = run(*case, *outputs, "--plot", names[4])
    wrote = "".join(f"wrote {name}\n" for name in names[:3])
    shown = run(*case).stdout
    assert result.stdout == shown + wrote
    assert result.stderr == "".join(f"wrote {name}\n" for name in names[3:])
    one, two, three = (Path(name).read_text("utf-8") for name in names[:3])
    assert one == run(*case, "--format", "json").stdout
    assert two == run(*case, "--format", "csv").stdout
    assert three == "".join(f"{line.rstrip()}\n" for line in shown.splitlines())
    assert Path(names[3]).read_text("utf-8").startswith("<?xml")
    assert Path(names[4]).read_bytes().startswith(b"%PDF")


def test_what_can_be_kept_is_kept_if_one_output_fails(tmp_path):
    full, file = full_device(tmp_path), tmp_path / "a.json"
    result = run("analyze", DH5, "-o", str(full), "-o", str(file), status=1)
    assert result.stderr == f"error: {full}: cannot be written (No space left on device)\n"
    assert result.stdout == f"{run('analyze', DH5).stdout}wrote {file}\n"
    assert json.loads(file.read_text("utf-8"))["robot"]["tip"] == "tool"


def test_degrees():
    turned = document("analyze", DH5, "--q", "10,70,25,65,0", "--deg")
    q = ",".join(map(str, np.deg2rad([10, 70, 25, 65, 0])))
    assert turned == document("analyze", DH5, "--q", q)
    assert "70.00" in run("analyze", DH5, "--q", "10,70,25,65,0", "--deg", "--free", "3").stdout


# ---- as a process ----------------------------------------------------------------------------


def test_a_reader_that_leaves_early_is_no_error():
    program = f"{sys.executable} -m ftforce census panda --faults 4 --format csv"
    done = subprocess.run(
        ["sh", "-c", f"{program} | head -n 1"], capture_output=True, check=True, timeout=60
    )
    assert done.stdout.startswith(b"fault_set,locked")
    assert done.stderr == b""


def test_a_full_standard_output_is_one_line_when_the_interpreter_ends(tmp_path):
    command = [sys.executable, "-m", "ftforce", "analyze", DH5, "--format", "json"]
    with full_device(tmp_path).open("wb") as output:
        done = subprocess.run(
            command, stdout=output, stderr=subprocess.PIPE, check=False, timeout=60
        )
    reason = "standard output cannot be written (No space left on device)"
    assert (done.returncode, done.stderr.decode()) == (1, f"error: {reason}\n")


def test_a_terminal_without_unicode_still_shows_the_answer():
    command = [sys.executable, "-m", "ftforce", "analyze", DH5, "--locked", "3"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, check=True, timeout=60, env=environment)
    assert b"Not tolerated" in done.stdout


def test_data_are_utf8_whatever_the_terminal(tmp_path):
    """A name is the same in standard output as in a file, or another program reads other names."""
    names = {"joint1": "Gelenk-ä", "joint2": "関節"}
    text = Path(DH5).read_text("utf-8")
    for old, new in names.items():
        text = text.replace(f'"{old}"', f'"{new}"')
    arm = tmp_path / "arm.urdf"
    arm.write_text(text, "utf-8")
    command = [sys.executable, "-m", "ftforce", "inspect", str(arm), "--tip", "tool", "--format"]
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    for form in ("json", "csv"):
        done = subprocess.run(
            [*command, form], capture_output=True, check=True, timeout=60, env=environment
        )
        assert all(name in done.stdout.decode("utf-8") for name in names.values())


@pytest.mark.parametrize("columns", ["0", "1", "-3", "many", "９"])
def test_a_width_of_nothing_is_no_width(monkeypatch, capsys, columns):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert main(monkeypatch, "analyze", DH5) == 0
    wanted = capsys.readouterr().out
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, columns)
        assert main(monkeypatch, "analyze", DH5) == 0
        assert capsys.readouterr().out == wanted
        assert main(monkeypatch, "analyze", "--help") == 0
        assert "--locked" in capsys.readouterr().out


def test_standard_output_as_a_file_holds_the_data_only():
    command = f"{sys.executable} -m ftforce analyze {DH5} --format json -o /dev/stdout"
    done = subprocess.run(["sh", "-c", f"{command} | cat"], capture_output=True, check=True)
    assert json.loads(done.stdout)["robot"]["tip"] == "tool"


BESIDE = {
    "atexit": "atexit.register(print, 'last')",
    "a thread": "threading.Timer(0.2, print, ['last']).start()",
    "a profiler": "sys.setprofile(lambda *_: None); atexit.register(print, 'last')",
}


@pytest.mark.parametrize("beside", BESIDE.values(), ids=BESIDE)
@pytest.mark.parametrize(("word", "status"), [("--version", 0), ("capabilty", 2)])
def test_a_process_that_ends_at_once_loses_nothing(beside, word, status):
    """Objects are not freed, but output is written, and what others registered is done."""
    program = f"import atexit, sys, threading\nfrom ftforce.cli import run\n{beside}\nrun()"
    command = [sys.executable, "-c", program, word]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == status
    assert "last" in done.stdout.splitlines()
    assert bool(done.stderr) == bool(status)


# ---- the program, in this process ------------------------------------------------------------


def main(monkeypatch, *words):
    """Run the program as `python -m ftforce` does, and return its exit status."""
    monkeypatch.setattr(sys, "argv", ["ftforce", *words])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["capability", DH5, "--format", "json"], ("capability",)),
        (["inspect", DH5], ("inspect",)),
        (["--version"], cli.COMMANDS),
        (["capabilty"], cli.COMMANDS),
        ([], cli.COMMANDS),
    ],
    ids=str,
)
def test_only_the_command_that_is_named_is_built(monkeypatch, words, wanted):
    built = []
    whole = cli.build
    monkeypatch.setattr(cli, "build", lambda *names: built.append(names) or whole(*names))
    assert main(monkeypatch, *words) == (0 if len(words) > 1 or "--version" in words else 2)
    assert built == [wanted]


@contextmanager
def stream_to(device, *, buffered=False):
    """Yield a text stream like standard output's; what is left in it at the end is lost."""
    raw = device.open("wb", buffering=-1 if buffered else 0)
    stream = io.TextIOWrapper(raw, write_through=not buffered)
    yield stream
    with suppress(OSError):
        stream.close()


PRINTING = [
    ("--help",),
    ("--version",),
    ("analyze", "--help"),
    (),
    ("analyze", DH5),
    ("analyze", DH5, "--format", "json"),
    ("census", DH5, "--format", "csv"),
    ("inspect", DH5, "-o", "result.json"),
]


@pytest.mark.parametrize("arguments", PRINTING, ids=" ".join)
def test_a_standard_output_that_cannot_be_written_is_one_line(
    tmp_path, monkeypatch, capsys, arguments
):
    monkeypatch.chdir(tmp_path)
    device = full_device(tmp_path)
    for buffered in (True, False):
        with stream_to(device, buffered=buffered) as output:
            monkeypatch.setattr(sys, "stdout", output)
            assert main(monkeypatch, *arguments) == 1
        reason = "standard output cannot be written (No space left on device)"
        assert capsys.readouterr().err == f"error: {reason}\n"
    monkeypatch.setattr(sys, "stdout", None)  # closed
    assert main(monkeypatch, *arguments) == 1
    assert capsys.readouterr().err == "error: standard output cannot be written (it is closed)\n"
    if "-o" in arguments:  # the note is lost, the result is not
        assert json.loads(Path("result.json").read_text(encoding="utf-8"))["tip"] == "tool"


def test_debug_shows_where_printing_failed(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["ftforce", "analyze", "--help", "--debug"])
    with stream_to(full_device(tmp_path)) as output:
        monkeypatch.setattr(sys, "stdout", output)
        with pytest.raises(OSError, match="No space left"):
            cli.main()


@pytest.mark.parametrize("words", [("analyze",), ("analyze", DH5, "--locked", "9")])
def test_a_full_standard_error_is_no_traceback(tmp_path, monkeypatch, capsys, words):
    with stream_to(full_device(tmp_path)) as errors:
        monkeypatch.setattr(sys, "stderr", errors)
        assert main(monkeypatch, *words) == 1
    assert capsys.readouterr().out == ""


def test_the_package_has_the_program_and_nothing_else():
    assert cli.app is cli.app
    with pytest.raises(AttributeError, match="has no attribute 'appp'"):
        _ = cli.appp


def test_a_standard_output_that_is_closed_complains(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    printing.prepare_streams()
    with pytest.raises(ftforce.FtforceError, match=r"cannot be written \(it is closed\)"):
        printing.say("hello")
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    printing.say("hello")
    assert sys.stdout.getvalue() == "hello\n"


def test_a_reader_who_leaves_is_told_apart_from_a_full_disk(monkeypatch):
    class Pipe(io.StringIO):
        def flush(self):
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stdout", Pipe())
    with pytest.raises(BrokenPipeError), printing.printing():
        pass
    # A command takes it for an answer.
    assert common.guarded(lambda: printing.say("hello"))() is None
