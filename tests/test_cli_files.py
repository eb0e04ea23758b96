"""What a command reads is not overwritten by what it writes."""

from __future__ import annotations

import inspect
import shutil
from importlib import import_module
from pathlib import Path

import pytest

from ftforce.cli import COMMANDS
from ftforce.cli.files import INPUTS, OUTPUTS
from ftforce.cli.options import _expanded
from ftforce.robot.known_robots import known_robots
from test_cli import run

DH5 = known_robots()["dh5"].urdf
TABLE = DH5.with_suffix(".toml")
RECORDING = "t,joint1,joint2,joint3,joint4,joint5\n0,0,1,0.4,1,0\n1,0,1,0.4,1,0.1\n"
POSTURES = "joint1,joint2,joint3,joint4,joint5\n0,1,0.4,1,0\n"
LIMITS = "joint,effort\njoint1,50\njoint2,50\njoint3,50\njoint4,50\njoint5,50\n"
FRICTION = "joint,friction\njoint1,0.1\njoint2,0.1\njoint3,0.1\njoint4,0.1\njoint5,0.1\n"
FORCE = ("--force", "1,0,0")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the working folder, with one file of each kind that is read."""
    monkeypatch.chdir(tmp_path)
    for path in (DH5, DH5.with_suffix(".srdf"), TABLE):
        shutil.copyfile(path, f"arm{path.suffix}")
    shutil.copyfile(TABLE, "table.toml")
    for name, text in {"rec": RECORDING, "q": POSTURES, "l": LIMITS, "f": FRICTION}.items():
        Path(f"{name}.csv").write_text(text)
    Path("l.toml").write_text("joint1 = 50\n")
    Path("stored.zarr").mkdir()
    Path("stored.zarr/zarr.json").write_text("{}")
    Path("run.npz").write_bytes(b"PK")
    return tmp_path


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


CLASHES = {
    "simulate arm.urdf rec.csv --force 1,0,0 -o rec.csv": "the trajectory (rec.csv)",
    "timeline arm.urdf rec.csv -o rec.csv": "the trajectory (rec.csv)",
    "sweep arm.urdf --postures q.csv -o q.csv": "the postures (q.csv)",
    "sweep arm.urdf --samples 10 --limits l.csv -o ./l.csv": "the torque limits (l.csv)",
    "capability arm.urdf --limits l.toml -o l.toml --format json": "the torque limits (l.toml)",
    "analyze arm.urdf --friction f.csv -o f.csv": "the friction (f.csv)",
    "analyze arm.urdf -o arm.urdf --format json": "the robot (arm.urdf)",
    "analyze arm.urdf -o arm.srdf --format json": "the robot (arm.srdf)",
    "inspect arm.toml -o arm.toml --format json": "the robot (arm.toml)",
    "inspect arm.urdf -o soft.json": "the robot (arm.urdf)",
    "census arm.urdf -o hard.json": "the robot (arm.urdf)",
    "compare table.toml arm.urdf -o hard.json": "a robot (arm.urdf)",
    "compare arm.urdf stored.zarr -o stored.zarr/zarr.json": "a robot (stored.zarr)",
    "map stored.zarr --plot stored.zarr/map.svg": "the stored sweep (stored.zarr)",
    "sweep arm.urdf --postures stored.zarr/zarr.json -o stored.zarr": "the postures",
    "view table.toml --history soft.html --export soft.html": "the history (soft.html)",
    "view arm.urdf --sweep stored.zarr --screenshot stored.zarr/a.png": "the stored sweep",
    "dh arm.toml -o hidden.urdf": "the DH table (arm.toml)",
}


@pytest.mark.parametrize("line", CLASHES)
def test_an_input_is_never_overwritten(folder, line):
    for link in ("soft.json", "soft.html"):
        Path(link).symlink_to("arm.urdf")
    Path("hidden.urdf").symlink_to("arm.toml")
    Path("hard.json").hardlink_to("arm.urdf")
    before = contents(folder)
    result = run(*line.split(), status=1)
    assert f"cannot be written: it would overwrite {CLASHES[line]}" in result.stderr
    assert result.stderr.count("\n") == 1
    assert contents(folder) == before


def test_a_known_robot_is_not_overwritten(folder):
    Path("out.json").symlink_to(DH5)
    before = DH5.read_bytes()
    result = run("analyze", "dh5", "-o", "out.json", status=1)
    assert f"it would overwrite the robot ({DH5})" in result.stderr
    assert DH5.read_bytes() == before


@pytest.mark.parametrize(
    "line",
    [
        "census arm.urdf -o a.svg --plot a.svg",
        "census arm.urdf -o a.svg --plot ./a.svg",
        "census arm.urdf -o old.svg --plot link.svg",
        "census arm.urdf -o old.svg --plot hard.svg",
    ],
)
def test_two_outputs_are_two_files(folder, line):
    Path("old.svg").write_text("old")
    Path("link.svg").symlink_to("old.svg")
    Path("hard.svg").hardlink_to("old.svg")
    before = contents(folder)
    result = run(*line.split(), status=2)
    assert "--output and --plot need different files" in result.stderr
    assert contents(folder) == before


def test_words_and_devices_are_no_files(folder):
    Path("urdf").mkdir()
    run("capability", "arm.urdf", "--locked", "1", "--limits", "urdf", "-o", "urdf/a.json")
    assert Path("urdf/a.json").is_file()
    run("analyze", "arm.urdf", "-o", "/dev/null", "--format", "json")
    run("capability", "arm.urdf", "--limits", "l.csv", "-o", "new.csv")
    assert Path("l.csv").read_text() == LIMITS


def test_dh_replaces_no_file_that_was_not_named(folder):
    before = contents(folder)
    result = run("dh", "arm.toml", status=1)
    assert result.stderr == "error: arm.urdf: exists; to replace it, give --output arm.urdf\n"
    Path("arm.urdf").unlink()
    result = run("dh", "arm.toml", status=1)
    assert result.stderr == "error: arm.srdf: exists; to replace it, give --output arm.urdf\n"
    shutil.copyfile(DH5, "arm.urdf")
    Path("arm.srdf").write_text("<robot name='by hand'/>")
    result = run("dh", "arm.toml", "-o", "arm.urdf", status=1)
    assert "arm.srdf: cannot be written: it exists and was not generated" in result.stderr
    Path("arm.srdf").write_bytes(before[folder / "arm.srdf"])
    assert contents(folder) == before
    run("dh", "arm.toml", "-o", "arm.urdf")  # both were generated
    run("dh", "table.toml")  # neither exists


@pytest.mark.parametrize("command", COMMANDS)
def test_every_file_of_a_command_is_known(command):
    function = getattr(import_module(f"ftforce.cli.{command}"), command)
    for parameter in _expanded(function):
        annotation = str(parameter.annotation)
        option = parameter.annotation.__metadata__[0] if "Annotated" in annotation else None
        words = f"{getattr(option, 'metavar', '')} {getattr(option, 'help', '')}"
        is_file = "Path" in annotation or any(word in words for word in ("FILE", "URDF", "CSV"))
        if is_file and parameter.annotation is not inspect.Parameter.empty:
            assert parameter.name in {*INPUTS, *OUTPUTS}, parameter.name


NO_FILES = (
    *("view arm.urdf --history {} --export a.html", "view arm.urdf --sweep {} --export a.html"),
    *("view arm.urdf --export {}/a.html", "sweep arm.urdf --samples 9 -o {}/a.zarr"),
    *("compare arm.urdf {}", "map {}", "dh {}", "sweep arm.urdf --postures {}.npy"),
    *("analyze . -o a.json", "analyze / -o a.json", "compare . {} -o a.csv"),
    *("analyze arm.urdf -o {}.json", "simulate arm.urdf {} --force 1,0,0"),
)


@pytest.mark.parametrize("line", NO_FILES)
def test_folders_and_names_that_are_too_long_get_one_line(folder, line):
    before = contents(folder)
    result = run(*line.format("x" * 300).split(), status=1)
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert "internal error" not in result.stderr
    assert contents(folder) == before
