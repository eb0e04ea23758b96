"""The commands as a user types them: what they print, write and return."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import ftforce
from ftforce import cli
from ftforce.cli import common, printing
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


def test_new_options_stand_where_they_belong():
    commands = typer.main.get_command(cli.app).commands
    options = {
        name: {option for one in commands[name].params for option in one.opts}
        for name in ("analyze", "census", "capability")
    }
    shared = {"--velocity", "--acceleration", "--gravity", "--payload", "--limits"}
    for found in options.values():
        assert shared <= found
    assert {"--free", "--weak", "--inverse"} <= options["analyze"]
    assert {"--mode", "--rank-by", "--direction", "--inverse"} <= options["census"]
    assert {"--free", "--weak", "--direction", "--locked"} <= options["capability"]


def test_no_arguments_show_the_help():
    assert "analyze" in run(status=2).output


def test_analyze_prints_the_papers_case():
    output = run("analyze", DH5, "--locked", "2,4,5", *PAPER).stdout
    for expected in ("{2, 4, 5} joint2, joint4, joint5", "43.66", "-35.01", "Not tolerated"):
        assert expected in output
    assert all(len(line) <= 80 for line in output.splitlines())


@pytest.mark.parametrize("given", [["--locked", "2,4"], ["--locked", "joint4,joint2"],
                                   ["--locked", "2", "--locked", "joint4"]])  # fmt: skip
def test_joints_are_numbers_or_names(given):
    assert document("analyze", DH5, *given)["locked"] == ["joint2", "joint4"]


def test_json_means_something_alone():
    result = document("analyze", DH5, "--locked", "2,4,5", *PAPER)
    assert list(result)[:9] == [
        "robot", "conventions", "posture", "locked", "jacobian", "force", "torque", "velocity",
        "verdict",
    ]  # fmt: skip
    assert result["robot"]["tip"] == "tool"
    assert result["robot"]["joints"] == [f"joint{i}" for i in range(1, 6)]
    conventions = result["conventions"]
    assert {k: conventions[k] for k in ("axes", "task", "length", "rtol", "wary")} == {
        "axes": "tool", "task": "force", "length": None, "rtol": 1e-6, "wary": 1e-2,
    }  # fmt: skip
    assert "exerts on its environment" in conventions["sign"]
    assert conventions["units"]["torque"].startswith("N·m")
    np.testing.assert_allclose(np.rad2deg(result["posture"]["q"]), [10, 70, 25, 65, 0], atol=1e-9)
    assert result["posture"]["source"] == "posture 'paper'"
    assert round(result["force"]["jump_norm"], 2) == 43.66
    assert result["force"]["moment_jump_norm"] is None
    assert result["force"]["requested"] == [80, 50, 10]
    assert result["torque"]["after"]["joint2"] == 0.0
    assert set(result["torque"]["brake_load"]) == {"joint2", "joint4", "joint5"}
    assert result["velocity"] is None
    assert result["verdict"] == "not tolerated"


def test_json_agrees_with_numpy():
    result = document("analyze", DH5, "--locked", "2,4,5", *PAPER)
    J = np.array(result["jacobian"]["matrix"])
    before, after = (np.array(result["force"][key]) for key in ("before", "after"))
    K = np.delete(J, [1, 3, 4], axis=1)
    sigma = np.linalg.svd(J, compute_uv=False)
    np.testing.assert_allclose(list(result["torque"]["before"].values()), J.T @ before)
    np.testing.assert_allclose(after, K @ np.linalg.pinv(K) @ before, atol=1e-9)
    np.testing.assert_allclose(result["jacobian"]["sigma_min"], sigma[-1])
    lost = np.array(result["jacobian"]["lost_directions"])
    np.testing.assert_allclose(lost @ K, 0, atol=1e-9)
    assert result["jacobian"]["rank"] == 3
    assert result["jacobian"]["rank_after"] == 2
    loads = result["torque"]["brake_load"]
    np.testing.assert_allclose(list(loads.values()), (J.T @ after)[[1, 3, 4]], atol=1e-9)


def test_without_a_force_every_unit_force_is_analysed():
    result = document("analyze", DH5, "--locked", "3")
    assert result["force"]["jump"] is None
    assert [unit["component"] for unit in result["unit_forces"]] == ["fx", "fy", "fz"]
    assert [round(unit["force"]["jump_norm"], 9) for unit in result["unit_forces"]] == [1, 0, 0]
    assert "force along x" in run("analyze", DH5, "--locked", "3").stdout


def test_velocities_are_remapped():
    given = ["--velocity", "0.05,0.4,0.2,0.1,0.3", "--locked", "2,4,5"]
    result = document("analyze", DH5, *given, *PAPER)["velocity"]
    np.testing.assert_allclose(result["tip_before"], [0.033, 0.01, -0.23], atol=6e-3)
    assert result["after"]["joint2"] == 0.0
    change = np.array(result["tip_after"]) - result["tip_before"]
    np.testing.assert_allclose(result["jump"], change)
    np.testing.assert_allclose(result["jump_norm"], np.linalg.norm(change))
    assert "Appendix A" in run("analyze", DH5, *given, *PAPER).stdout


def test_wrench_keeps_newtons_and_newton_metres_apart():
    given = ["--task", "wrench", "--length", "0.5", "--force", "80,50,10,1,2,3", "--locked", "2"]
    result = document("analyze", "ur5", *given)
    jump = np.array(result["force"]["jump"])
    np.testing.assert_allclose(result["force"]["jump_norm"], np.linalg.norm(jump[:3]))
    np.testing.assert_allclose(result["force"]["moment_jump_norm"], np.linalg.norm(jump[3:]))
    assert result["conventions"]["length"] == 0.5
    assert "characteristic length 0.5 m" in run("analyze", "ur5", *given).stdout


def test_torques_instead_of_a_force():
    result = document("analyze", "panda", "--locked", "1", "--torque", "1,2,3,4,5,6,7")
    assert result["force"]["requested"] is None
    assert list(result["torque"]["before"].values()) == [1, 2, 3, 4, 5, 6, 7]
    J = np.array(result["jacobian"]["matrix"])
    tau = np.arange(1.0, 8.0)
    np.testing.assert_allclose(result["force"]["before"], np.linalg.lstsq(J.T, tau)[0])
    self_motion = tau - J.T @ result["force"]["before"]
    np.testing.assert_allclose(list(result["torque"]["self_motion"].values()), self_motion)
    shown = run("analyze", "panda", "--locked", "1", "--torque", "1,2,3,4,5,6,7").stdout
    assert "Torque into self-motion" in shown


def test_degrees():
    in_degrees = document("analyze", DH5, "--q", "10,70,25,65,0", "--deg")
    assert in_degrees["posture"]["source"] == "given"
    np.testing.assert_allclose(in_degrees["posture"]["q"], np.deg2rad([10, 70, 25, 65, 0]))
    assert (
        "70.00" in run("analyze", DH5, "--q", "10,70,25,65,0", "--deg", "--force", "1,1,1").stdout
    )


def test_degrees_for_radians_are_noticed():
    result = run("analyze", DH5, "--q", "10,70,25,65,0", "--format", "json")
    assert "look like degrees" in result.stderr
    assert "look like degrees" in " ".join(json.loads(result.stdout)["warnings"])


def test_world_axes_change_the_papers_number():
    result = document("analyze", DH5, "--locked", "2,4,5", "--axes", "world", *PAPER)
    assert round(result["force"]["jump_norm"], 1) == 66.2
    assert result["conventions"]["axes"] == "world"


def test_borderline_is_said():
    given = ["analyze", "tiago", "--locked", "2", "--task", "wrench"]
    assert document(*given)["verdict"] == "borderline"
    assert document(*given, "--wary", "0.001")["verdict"] == "tolerated"
    assert document(*given, "--rtol", "0.009")["verdict"] == "not tolerated"


def test_torque_beyond_the_limit_is_said():
    result = document("analyze", "so101", "--force", "0,0,10")
    assert result["warnings"] == []  # its limits are unknown
    result = document("analyze", "ur3", "--force", "900,0,0")
    assert any("of its effort limit of" in warning for warning in result["warnings"])


def test_analyze_csv_has_units():
    text = run("analyze", DH5, "--locked", "2,4,5", "--format", "csv", *PAPER).stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    torque = {row["name"]: row for row in rows if row["quantity"] == "torque"}
    assert torque["joint1"]["unit"] == "N·m"
    assert float(torque["joint2"]["after"]) == 0.0
    assert {row["name"] for row in rows if row["quantity"] == "brake_load"} == {
        "joint2", "joint4", "joint5"
    }  # fmt: skip
    assert [row["after"] for row in rows if row["quantity"] == "verdict"] == ["not tolerated"]
    axes = [row["before"] for row in rows if row["name"] == "axes"]
    assert axes == ["tool"]


def test_analyze_csv_of_unit_forces_and_velocities():
    given = ["analyze", "tiago", "--locked", "2", "--velocity", "1,1,1,1,1,1,1,1"]
    text = run(*given, "--format", "csv", "--task", "wrench").stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    units = {(row["quantity"], row["name"]): row["unit"] for row in rows}
    assert units["velocity", "torso_lift_joint"] == "m/s"
    assert units["velocity", "arm_1_joint"] == "rad/s"
    assert units["tip velocity", "wx"] == "rad/s"
    assert units["force for unit mx", "fx"] == "N"


def test_census_is_worst_first():
    result = document("census", DH5, "--faults", "2", *PAPER)
    assert len(result["sets"]) == 15
    assert result["sets"][0]["locked"] == ["joint3"]
    assert result["sets"][0]["verdict"] == "not tolerated"
    jumps = [entry["force"]["jump_norm"] for entry in result["sets"]]
    assert jumps == sorted(jumps, key=lambda jump: -round(jump, 6))
    assert result["joints"][0]["joint"] == "joint3"
    assert result["joints"][0]["not_tolerated"] == 5


def test_census_sets_are_analyses_in_short():
    entry = document("census", "panda", "--faults", "2", "--force", "1,2,3")["sets"][5]
    whole = document("analyze", "panda", "--locked", ",".join(entry["locked"]), "--force", "1,2,3")
    assert entry["verdict"] == whole["verdict"]
    np.testing.assert_allclose(entry["force"]["jump"], whole["force"]["jump"], atol=1e-12)
    for key in ("margin", "relative_manipulability", "rank_after", "sigma_min_after"):
        np.testing.assert_allclose(entry["jacobian"][key], whole["jacobian"][key], atol=1e-12)


WHOLE = ["--velocity", ".1,.2,.3,.4,.5", "--acceleration", "1,2,3,4,5", "--gravity", "1,0,-9",
         "--payload", "1.5@0,0,0.1", "--limits", "urdf"]  # fmt: skip
SAME = {
    "velocity": [0.1, 0.2, 0.3, 0.4, 0.5], "acceleration": [1, 2, 3, 4, 5], "gravity": [1, 0, -9],
    "payload": (1.5, (0, 0, 0.1)), "limits": "urdf",
}  # fmt: skip


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


@pytest.mark.parametrize("given", [["--free", "2,4"], ["--free", "joint4,joint2"],
                                   ["--free", "2", "--free", "joint4"]])  # fmt: skip
def test_free_joints_are_numbers_or_names(given):
    assert document("analyze", DH5, *given)["modes"] == {"joint2": "free", "joint4": "free"}


@pytest.mark.parametrize(
    "given",
    [["--weak", "2:0.5,4:0"], ["--weak", "joint4:0 , joint2: 0.5"],
     ["--weak", "2:.5", "--weak", "joint4:0"]],
)  # fmt: skip
def test_weak_joints_have_a_factor(given):
    assert document("analyze", DH5, *given)["weak_factors"] == {"joint2": 0.5, "joint4": 0.0}


def test_a_weak_joint_asks_for_the_limits_of_the_urdf():
    assert document("analyze", DH5, "--weak", "3:0.5")["limits"]["source"] == "urdf"
    result = document("analyze", DH5, "--weak", "3:0.5", "--limits", "none")
    assert result["limits"] is None
    assert result["warnings"] == [
        "joint 3 joint3 is weak, but no limits are counted: it counts as healthy"
    ]


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
    for expected in ("+fz", "162.3", "asked for", "fault of panda_joint2", "11.26 panda_joint6"):
        assert expected in output
    assert all(len(line) <= 80 for line in output.splitlines())
    assert "With panda_joint2 and panda_joint4 locked, the motors can command no" in output


def test_degrees_in_every_command():
    for command in ("analyze", "census", "capability"):
        turned = document(command, DH5, "--q", "10,70,25,65,0", "--deg", "--limits", "urdf")
        q = ",".join(map(str, np.deg2rad([10, 70, 25, 65, 0])))
        assert turned == document(command, DH5, "--q", q, "--limits", "urdf")
    moving = ["--velocity", "1,1,1,1,1", "--free", "3", "--force", "1,2,3"]
    shown = run("analyze", DH5, "--q", "10,70,25,65,0", "--deg", *moving).stdout
    torques, _, velocities = (
        line.split() for line in shown.splitlines() if line.startswith("2 joint2 ")
    )
    assert torques[3] == "70.00"
    assert velocities[2:4] == ["rad/s", "1.0000"]  # only q is in degrees
    unit = run("analyze", "tiago", "--deg", "--free", "8").stdout
    row = next(line for line in unit.splitlines() if line.startswith("1 torso_lift_joint "))
    assert row.split()[3:5] == ["0.150", "m"]
    assert row.endswith("187.74 N")


def test_census_table_and_top():
    output = run("census", "panda", "--faults", "2", "--top", "3", "--force", "1,2,3").stdout
    assert "… and 25 more" in output
    assert "Joints, most critical first" in output
    assert "Worst ρ of 2 joints" in output
    assert all(len(line) <= 80 for line in output.splitlines())


def test_census_without_a_force():
    result = document("census", DH5)
    assert result["force"] == {"requested": None, "before": None}
    assert result["sets"][0]["force"]["jump"] is None
    assert "every direction" in run("census", DH5).stdout


def test_census_of_a_wrench_in_csv():
    text = run(
        "census", "ur5", "--task", "wrench", "--force", "1,2,3,4,5,6", "--format", "csv"
    ).stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 6
    assert {"jump_norm [N]", "moment_jump_norm [N·m]", "jump_mx [N·m]"} <= set(rows[0])


def test_long_census_shows_progress(monkeypatch):
    monkeypatch.setattr(sys.modules["ftforce.cli.progress"], "PATIENCE", -1.0)
    result = run("census", DH5, "--faults", "2", env={"FORCE_COLOR": "1", "NO_COLOR": ""})
    assert "fault sets" in result.stderr
    assert "15/15" in result.stderr
    assert run("census", DH5, "--faults", "2").stderr == ""  # not into a file or pipe


def test_short_census_shows_none():
    assert run("census", DH5, "--faults", "2").stderr == ""


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
    assert "79 pass, 8 explained by errata, 0 fail" in output
    assert "43.66 43.66 ✓" in output
    assert document("replicate")["successful"] is True
    rows = list(csv.DictReader(io.StringIO(run("replicate", "--format", "csv").stdout)))
    assert len(rows) == 87


def test_replicate_fails_if_a_number_differs(monkeypatch):
    printed = ("-35.02", "-12.33", "26.85", "10.00", "4.00")
    monkeypatch.setattr("ftforce.replicate.PRINTED_TORQUE", printed)
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
    assert result.stdout == f"wrote {file}\n"
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
    assert result.stdout == f"wrote {tmp_path}/a\\nb.json\n"
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


def test_force_and_torque_exclude_each_other():
    for command in ("analyze", "census"):
        result = run(command, DH5, "--force", "1,2,3", "--torque", "1,2,3,4,5", status=2)
        assert "either --force or --torque" in result.stderr


def test_errors_are_one_line_and_debug_shows_more():
    result = run("analyze", DH5, "--locked", "9", status=1)
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("error: joint number 9 is out of range")
    assert result.stdout == ""
    with pytest.raises(ftforce.FtforceError):
        CliRunner().invoke(cli.app, ["analyze", DH5, "--locked", "9", "--debug"],
                           catch_exceptions=False)  # fmt: skip


def test_a_mistake_of_ours_is_no_traceback(monkeypatch):
    def fail(*_, **__):
        raise KeyError("elbow")

    monkeypatch.setattr("ftforce.analysis.analyze", fail)
    result = run("analyze", DH5, status=1)
    assert result.stderr == (
        "error: a mistake in ftforce, please report it (KeyError('elbow')); "
        "--debug shows where it happened\n"
    )
    with pytest.raises(KeyError):
        CliRunner().invoke(cli.app, ["analyze", DH5, "--debug"], catch_exceptions=False)


def test_interruption_is_no_traceback():
    @common.guarded
    def command() -> None:
        raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as stop:
        command()
    assert stop.value.exit_code == 130


@pytest.mark.parametrize("text", ["1,x,3", "1,,x", "one"])
def test_vectors_are_numbers(text):
    result = run("analyze", DH5, "--force", text, status=1)
    assert "--force needs numbers separated by commas, e.g. 1,2.5,-3; '" in result.stderr
    assert "is not a number" in result.stderr


def test_blanks_separate_numbers_too():
    given = document("analyze", DH5, "--force", "80 50 10")
    assert given["force"]["requested"] == [80, 50, 10]


def subprocess_run(*arguments: str, **options):
    command = [sys.executable, "-m", "ftforce", *arguments]
    return subprocess.run(command, capture_output=True, check=False, timeout=60, **options)


def test_the_program_runs_as_a_module():
    done = subprocess_run("analyze", DH5, "--locked", "9")
    assert done.returncode == 1
    assert done.stderr.startswith(b"error: ")
    assert b"Traceback" not in done.stderr


def test_a_reader_that_leaves_early_is_no_error():
    program = f"{sys.executable} -m ftforce census panda --faults 4 --format csv"
    done = subprocess.run(
        ["sh", "-c", f"{program} | head -n 1"], capture_output=True, check=True, timeout=60
    )
    assert done.stdout.startswith(b"fault_set,locked")
    assert done.stderr == b""


PRINTING = [
    ("--help",),
    ("--version",),
    ("analyze", "--help"),
    (),
    ("analyze", DH5),
    ("analyze", DH5, "--format", "json"),
    ("census", DH5, "--format", "csv"),
    ("capability", DH5),
    ("inspect", DH5),
    ("replicate",),
]


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", PRINTING, ids=" ".join)
@pytest.mark.parametrize("buffered", ["", "1"], ids=["buffered", "unbuffered"])
def test_a_full_standard_output_is_one_line(tmp_path, arguments, buffered):
    device = full_device(tmp_path)
    command = [sys.executable, "-m", "ftforce", *arguments]
    environment = {**os.environ, "PYTHONUNBUFFERED": buffered}
    with device.open("wb") as output:
        done = subprocess.run(
            command, stdout=output, stderr=subprocess.PIPE, env=environment, check=False, timeout=60
        )
    reason = "standard output cannot be written (No space left on device)"
    assert done.stderr.decode() == f"error: {reason}\n"
    assert done.returncode == 1


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", PRINTING, ids=" ".join)
def test_a_closed_standard_output_is_one_line(arguments):
    program = ["sh", "-c", '"$0" -m ftforce "$@" >&-', sys.executable, *arguments]
    done = subprocess.run(program, capture_output=True, check=False, timeout=60)
    assert done.stderr == b"error: standard output cannot be written (it is closed)\n"
    assert done.returncode == 1


def test_a_note_that_cannot_be_printed_leaves_the_result(tmp_path):
    file = tmp_path / "result.json"
    program = ["sh", "-c", '"$0" -m ftforce "$@" >&-', sys.executable]
    done = subprocess.run(
        [*program, "analyze", DH5, "-o", str(file)], capture_output=True, check=False, timeout=60
    )
    assert done.stderr == b"error: standard output cannot be written (it is closed)\n"
    assert json.loads(file.read_text(encoding="utf-8"))["robot"]["name"] == "dh5"


def test_a_full_standard_error_is_no_traceback(tmp_path):
    with full_device(tmp_path).open("wb") as errors:
        for arguments in (("analyze",), ("analyze", DH5, "--locked", "9")):
            done = subprocess.run(
                [sys.executable, "-m", "ftforce", *arguments],
                stdout=subprocess.PIPE, stderr=errors, check=False, timeout=60,
            )  # fmt: skip
            assert (done.returncode, done.stdout) == (1, b"")


def test_debug_shows_where_printing_failed(tmp_path):
    with full_device(tmp_path).open("wb") as output:
        for arguments in (("analyze", "--help"), ("analyze", DH5)):
            done = subprocess.run(
                [sys.executable, "-m", "ftforce", *arguments, "--debug"],
                stdout=output, stderr=subprocess.PIPE, check=False, timeout=60,
            )  # fmt: skip
            assert b"Traceback" in done.stderr
            assert b"No space left on device" in done.stderr
            assert done.returncode == 1


def test_a_terminal_without_unicode_still_shows_the_answer():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess_run("analyze", DH5, "--locked", "3", env=environment)
    assert done.returncode == 0
    assert b"Not tolerated" in done.stdout


# ---- the program, in this process ------------------------------------------------------------


@pytest.mark.parametrize("command", ["capability", "inspect"])
def test_only_the_command_that_is_named_is_built(monkeypatch, capsys, command):
    built = []
    whole = cli.build
    monkeypatch.setattr(cli, "build", lambda *names: built.append(names) or whole(*names))
    monkeypatch.setattr(sys, "argv", ["ftforce", command, DH5, "--format", "json"])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 0
    assert built == [(command,)]
    robot = json.loads(capsys.readouterr().out)
    assert (robot if command == "inspect" else robot["robot"])["tip"] == "tool"


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["capabilty"], []], ids=str)
def test_without_a_command_all_are_built(monkeypatch, capsys, words):
    built = []
    whole = cli.build
    monkeypatch.setattr(cli, "build", lambda *names: built.append(names) or whole(*names))
    monkeypatch.setattr(sys, "argv", ["ftforce", *words])
    with pytest.raises(SystemExit):
        cli.main()
    assert built == [cli.COMMANDS]
    capsys.readouterr()


def test_the_package_has_the_program_and_nothing_else():
    assert cli.app is cli.app
    with pytest.raises(AttributeError, match="has no attribute 'appp'"):
        _ = cli.appp


def test_what_main_says_of_an_output_that_fails(monkeypatch, capsys):
    def fail():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cli, "build", lambda *_: fail)
    monkeypatch.setattr(sys, "argv", ["ftforce", "--help"])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 1
    reason = "standard output cannot be written (No space left on device)"
    assert capsys.readouterr().err == f"error: {reason}\n"
    monkeypatch.setattr(sys, "argv", ["ftforce", "--help", "--debug"])
    with pytest.raises(OSError, match="No space left"):
        cli.main()


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
