"""`ftforce simulate` and `ftforce timeline` as a user types them."""

from __future__ import annotations

import csv
import io
import json
import signal
import subprocess
import sys

import numpy as np
import pytest

import ftforce
from ftforce.trajectory import Path
from test_cli import document, run

LINE = ["--from", "0.9,0.3,0.2", "--to", "0.85,0.35,0.25", "--speed", "0.05", "--rate", "10"]
PUSH = ["--force", "80,50,10"]
PANDA = ["panda", "--to", "0.4,0.3,0.4", "--speed", "0.2"]


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def history(**options):
    line = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)
    return ftforce.simulate(ftforce.load_robot("dh5"), line, force=[80, 50, 10], rate=10, **options)


def assert_same_forces(file, wanted):
    found = ftforce.load_history(file)
    for name, one in wanted.runs.items():
        np.testing.assert_array_equal(found.runs[name].force, one.force)
        np.testing.assert_array_equal(found.runs[name].q, one.q)
    return found


def test_a_lock_as_in_python():
    shown = run("simulate", "dh5", *LINE, *PUSH, "--fault", "3@1", "-o", "run.npz").stdout
    assert "wrote run.npz" in shown
    found = assert_same_forces("run.npz", history(faults="3@1"))
    assert found.setting == history(faults="3@1").setting


def test_without_remap():
    shown = run("simulate", "dh5", *LINE, *PUSH, "--fault", "3@1", "--no-remap").stdout
    assert "without remap" in shown
    assert "with remap " not in shown
    assert "but off the path" in shown


def test_tables_fit_80_columns():
    shown = run("simulate", *PANDA, "--rate", "20",
                "--force", "0,0,30", "--fault", "4@1", "--fault", "free:2@2").stdout  # fmt: skip
    assert max(map(len, shown.splitlines())) <= 80
    for expected in (
        "4 panda_joint4 locked at 1 s",
        "At the faults",
        "as if healthy",
        "Motor torques",
        "N·m",
        "tool frame",
        "Not tolerated",
    ):
        assert expected in shown


def test_json_is_a_summary_that_agrees():
    found = document("simulate", "dh5", *LINE, *PUSH, "--fault", "free:4@1")
    wanted = history(faults="free:4@1")
    jump = wanted.jump_norm(wanted.remapped)
    worst = found["runs"]["remapped"]["force_jump"]
    assert worst["most"] == jump.max()
    assert worst["time"] == wanted.t[jump.argmax()]
    assert found["verdict"] == "not tolerated"
    assert found["summary"].startswith("Not tolerated")


def test_csv_on_standard_output():
    shown = run("simulate", "dh5", *LINE, *PUSH, "--fault", "3@1", "--format", "csv").stdout
    rows = list(csv.DictReader(io.StringIO(shown)))
    assert {row["run"] for row in rows} == {"healthy", "unremapped", "remapped"}


def test_paper():
    shown = run("simulate", "--paper", "--rate", "2", "--debug").stdout
    for expected in (
        "1.15, -0.134, 0.034",
        "3 joint3 locked at 50 s",
        "Assumed",
        "Tolerated",
        "80.00 N",
        "0.015 m/s",
    ):
        assert expected in shown


def test_a_recorded_motion_and_waypoints():
    from pathlib import Path as File

    t = np.linspace(0.0, 2.0, 21)
    q0 = ftforce.load_robot("dh5").postures["paper"]
    rows = [[t_, *(q0 + 0.1 * np.sin(t_))] for t_ in t]
    text = "t [s],joint1,joint2 [deg],joint3,joint4,joint5\n"
    for row in rows:
        row[2] = np.rad2deg(row[2])
        text += ",".join(map(repr, map(float, row))) + "\n"
    File("motion.csv").write_text(text)
    run("simulate", "dh5", "motion.csv", *PUSH, "--fault", "3@1", "-o", "run.npz")
    found = ftforce.load_history("run.npz")
    np.testing.assert_allclose(found.healthy.q, [q0 + 0.1 * np.sin(t_) for t_ in t], atol=1e-12)
    File("points.csv").write_text("x,y,z\n0.9,0.3,0.2\n0.85,0.35,0.25\n")
    options = ["--speed", "0.05", "--rate", "10"]
    run("simulate", "dh5", "points.csv", *options, *PUSH, "--fault", "3@1", "-o", "run.npz")
    assert_same_forces("run.npz", history(faults="3@1"))


def test_without_from_the_tip_starts_where_the_posture_has_it():
    arm = ftforce.load_robot("panda")
    run("simulate", *PANDA, "--rate", "20", "--force", "0,0,30", "-o", "run.npz")
    found = ftforce.load_history("run.npz")
    np.testing.assert_allclose(found.healthy.q[0], arm.postures["default"], atol=1e-9)


MALFORMED = {
    "no robot": ([], "ROBOT is missing"),
    "no force": (["dh5", *LINE], "--force is missing"),
    "no goal": (["dh5", *PUSH], "give --to X,Y,Z"),
    "no speed": (["dh5", *PUSH, "--to", "0.9,0.3,0.2"], "--speed is missing"),
    "two trajectories": (["dh5", "x.csv", *LINE, *PUSH], "not both"),
    "no file": (["dh5", "x.csv", *PUSH], "no such file"),
    "point": (["dh5", *PUSH, "--to", "0.9,0.3", "--speed", "1"], "--to needs x,y,z in m"),
    "unreachable": (
        ["dh5", *PUSH, "--from", "9,9,9", "--to", "1,1,1", "--speed", "1"],
        "cannot reach",
    ),
    "fault": (["dh5", *LINE, *PUSH, "--fault", "3"], "needs joints and a time"),
    "fault after the end": (["dh5", *LINE, *PUSH, "--fault", "3@90"], "after the end"),
    "joint": (["dh5", *LINE, *PUSH, "--fault", "9@1"], "joint number 9 is out of range"),
    "delay": (["dh5", *LINE, *PUSH, "--delay", "-1"], "delay must be 0 s or more"),
    "rate": (["dh5", *LINE[:-1], "0", *PUSH], "rate in samples per second must be positive"),
    "paper and robot": (["dh5", "--paper"], "leave out ROBOT"),
    "paper and more": (
        ["--paper", "--limits", "urdf", "--deg", "--task", "force", "--to", "1,2,3"],
        "leave out --deg, --to, --limits, --task",
    ),
}


INCOMPLETE = {"no robot", "no force", "no goal", "no speed", "two trajectories", "point"}
INCOMPLETE |= {"paper and robot", "paper and more"}  # whatever the robot is


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed(case):
    words, message = MALFORMED[case]
    result = run("simulate", *words, status=2 if case in INCOMPLETE else 1)
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stdout == ""


def test_forms_of_histories_are_for_histories():
    message = run("analyze", "dh5", "-o", "x.npz", status=2).stderr
    assert ".npz is for histories" in message


def test_nothing_is_written_on_an_error(tmp_path):
    run(
        "simulate",
        "dh5",
        *LINE,
        *PUSH,
        "--fault",
        "9@1",
        "-o",
        "run.npz",
        "--plot",
        "run.png",
        status=1,
    )
    run("simulate", "dh5", *LINE, *PUSH, "-o", "run.npz", "--plot", "run.bmp", status=2)
    assert not list(tmp_path.iterdir())


@pytest.mark.no_cover
@pytest.mark.parametrize(
    ("ending", "magic", "words"),
    [
        ("png", b"\x89PNG", ["simulate", "dh5", *LINE, *PUSH, "--fault", "3@1"]),
        ("pdf", b"%PDF", ["timeline", "dh5", *LINE, *PUSH]),
        ("svg", b"<?xml", ["census", "dh5", *PUSH]),
        ("png", b"\x89PNG", ["capability", "dh5", "--locked", "3"]),
    ],
)
def test_plots(tmp_path, ending, magic, words):
    assert f"wrote a.{ending}" in run(*words, "--plot", f"a.{ending}").stderr
    assert (tmp_path / f"a.{ending}").read_bytes().startswith(magic)


def test_interrupted_nothing_is_written(tmp_path):
    """A process: only there does Python turn Ctrl-C into an exception."""
    # A shell's background job ignores interrupts, and hands that down.
    start = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from ftforce.cli import main
from ftforce.trajectory import simulate as simulation
def simulate(*_, **__):
    print("begun", file=sys.stderr, flush=True)
    time.sleep(60)
simulation.simulate = simulate
main()
"""
    words = ["simulate", "dh5", *LINE, *PUSH, "-o", "run.npz"]
    program = [sys.executable, "-c", start, *words]
    with subprocess.Popen(program, stderr=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            assert process.stderr.readline() == b"begun\n"
            process.send_signal(signal.SIGINT)
            message = process.communicate(timeout=30)[1]
        finally:
            process.kill()
    assert process.returncode == 130
    assert message.decode().strip() == "interrupted; nothing was written"
    assert not list(tmp_path.iterdir())


def test_long_simulation_shows_progress(monkeypatch):
    monkeypatch.setattr(sys.modules["ftforce.cli.progress"], "PATIENCE", -1.0)
    result = run(
        "simulate", "dh5", *LINE, *PUSH, "--fault", "3@1", env={"FORCE_COLOR": "1", "NO_COLOR": ""}
    )
    assert "instants" in result.stderr


def test_timeline_as_in_python():
    found = document("timeline", "dh5", *LINE, *PUSH, "--faults", "2")
    line = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)
    wanted = ftforce.timeline(
        ftforce.load_robot("dh5"), line, faults=2, force=[80, 50, 10], rate=10
    )
    assert found["times"] == wanted.t.tolist()
    np.testing.assert_array_equal(found["jump"], wanted.jump)
    np.testing.assert_array_equal(found["margin"], wanted.margin)
    np.testing.assert_array_equal(found["capability"], wanted.capability)
    assert found["sets"][0]["time"] == wanted.worst()[0].time
    assert len(found["sets"]) == 15


def test_timeline_tables_and_csv():
    shown = run("timeline", *PANDA, "--rate", "5",
                "--mode", "free", "--force", "0,0,30", "--top", "3").stdout  # fmt: skip
    assert max(map(len, shown.splitlines())) <= 80
    for expected in ("(free)", "more sets are not shown", "jump", "[N]", "margin", "Not tolerated"):
        assert expected in shown
    text = run("timeline", "dh5", *LINE, *PUSH, "--format", "csv").stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    assert {"t [s]", "fault_set", "jump [N]", "margin", "capability [N]", "verdict"} <= set(rows[0])
    assert len({row["fault_set"] for row in rows}) == 6  # and the healthy arm


def test_json_holds_no_nan():
    text = run("timeline", "dh5", *LINE, "--mode", "free", "--format", "json").stdout
    json.loads(text, parse_constant=pytest.fail)
    text = run("simulate", "dh5", *LINE, "--force", "0,0,0", "--fault", "free:2,3,4,5@1",
               "--format", "json").stdout  # fmt: skip
    assert json.loads(text, parse_constant=pytest.fail)["runs"]["remapped"]["falls_at"] == 1.0


UNWRITABLE = {
    "unknown ending": (["-o", "run.xyz"], "must end in .json, .csv, .xlsx, .tex, .md, .txt"),
    "typing error": (["-o", "run.parquett"], "the name must end in"),
    "another form": (["-o", "run.npz", "--format", "csv"], "does not match --format csv"),
    "no folder": (["-o", "nowhere/run.npz"], "cannot be written (No such file or directory)"),
    "plot, no folder": (["--plot", "nowhere/a.png"], "cannot be written (No such file"),
    "plot, ending": (["--plot", "a.jpg"], "the name must end in .png, .pdf or .svg"),
}


@pytest.mark.parametrize(("options", "message"), UNWRITABLE.values(), ids=UNWRITABLE)
def test_files_that_could_not_be_written_are_refused_before_the_work(monkeypatch, options, message):
    def never(*_, **__):
        raise AssertionError("it was computed first")

    monkeypatch.setattr(sys.modules["ftforce.trajectory.simulate"], "simulate", never)
    status = 1 if "cannot be written" in message else 2
    result = run("simulate", "dh5", *LINE, *PUSH, *options, status=status)
    assert message in result.stderr
    assert result.stdout == ""


def test_a_delay_beyond_the_end():
    found = document("simulate", "dh5", *LINE, *PUSH, "--fault", "4@1", "--delay", "20")
    assert "the arm, without any remap, keeps" in found["summary"]
    assert any(
        "would take effect at 21 s, after the end of the trajectory" in words
        for words in found["warnings"]
    )
    message = run(
        "simulate", "dh5", *LINE, *PUSH, "--fault", "4@1", "--delay", "1", "--no-remap", status=1
    ).stderr
    assert "a delay is until the remap acts" in message


def test_tables_of_a_wrench_fit_80_columns():
    words = ["simulate", *PANDA, "--rate", "10"]
    wrench = ["--force", "0,0,30,1,0,0", "--task", "wrench", "--length", "0.2"]
    lines = run(*words, *wrench, "--fault", "weak:4:0.05@1").stdout.splitlines()
    (heading,) = (one for one in lines if one.startswith("time") and "margin" in one)
    assert " ".join(heading.split()) == "time |f| [N] |m| [N·m] jump off path margin verdict"


def test_faults_of_one_time_are_one_row():
    found = document("simulate", "dh5", *LINE, *PUSH, "--fault", "4@1", "--fault", "free:5@1")
    (event,) = found["events"]
    assert event["faults"] == "4 joint4 locked, 5 joint5 free"


def test_tables_of_faults_and_of_instants_say_the_same():
    events = ["3@1", "free:5@1.5"]
    flags = [word for event in events for word in ("--fault", event)]
    push = ["--force", "5,0,30", "--axes", "world", "--payload", "1.5"]
    found = document("simulate", "ur5", "--to", "0.4,0.3,0.4", "--speed", "0.2", *push, *flags)
    ur5 = ftforce.load_robot("ur5")
    start = ftforce.trajectory.start.tip_at(ur5, None, None)
    line = Path.through([start, [0.4, 0.3, 0.4]], speed=0.2)
    options = {"force": [5, 0, 30], "axes": "world", "payload": 1.5}
    wanted = ftforce.simulate(ur5, line, faults=events, **options)
    jump = wanted.jump_norm(wanted.remapped)
    assert found["events"][1]["force_jump"] == jump[wanted.index(1.5)]
