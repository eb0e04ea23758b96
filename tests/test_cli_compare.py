"""``ftforce compare`` as a user types it."""

from __future__ import annotations

import csv
import io
import json
import re
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

import ftforce
from ftforce import cli
from ftforce.batch.comparison import compare
from ftforce.batch.sweep import sweep
from ftforce.report.comparison import comparison_sentence

pytestmark = pytest.mark.thorough


def run(*arguments, status=0):
    program = cli.build("compare", "robots")  # one command alone would take no name
    environment = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}
    result = CliRunner().invoke(program, ["compare", *map(str, arguments)], env=environment)
    assert result.exit_code == status, result.output
    return result


def in_one_line(result):
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    return line


FORCED = ("dh5", "kinova", "--samples", "2e3", "--force", "0,0,50")


def test_the_tables_fit_and_say_what_python_says():
    output = run(*FORCED, "--faults", "2").stdout
    lines = output.splitlines()
    assert all(len(line.rstrip()) <= 80 for line in lines)
    found = compare(["dh5", "kinova"], n=2000, force=[0, 0, 50], faults=2)
    said = " ".join(comparison_sentence(found).split())
    assert " ".join(output.split()).endswith(said)
    assert said.startswith("kinova degrades most gracefully: with up to 2 joints locked")
    first = next(line for line in lines if re.match(r"1 +kinova", line))
    arm = found["kinova"]
    assert f"{100 * arm.tolerated.value:.1f}" in first
    assert "2 j2s6s200_joint_2" in first
    for title in ("Arms, best first (2)", "sets of a single joint", "sets of 2 joints",
                  "Force after a single fault", "Workspace"):  # fmt: skip
        assert title in output
    healthy = arm.healthy_capability[1].value
    assert f"{healthy:.1f}" in output
    assert f"{100 * arm.capability_kept:.0f}" in output


def test_it_just_works():
    output = run("panda", "kinova").stdout
    assert "100,000 of each arm" in output
    assert "every direction (none given)" in output
    assert "Force after" not in output


def test_json_and_csv(tmp_path):
    document = json.loads(run(*FORCED, "--format", "json").stdout)
    found = compare(["dh5", "kinova"], n=2000, force=[0, 0, 50])
    assert [arm["name"] for arm in document["arms"]] == [arm.name for arm in found.arms]
    assert document["arms"][0]["tolerated"]["value"] == found.arms[0].tolerated.value
    assert document["arms"][0]["postures"]["source"].endswith("seed 0")
    table = tmp_path / "arms.csv"
    assert "wrote" in run(*FORCED, "-o", table).output
    rows = list(csv.DictReader(io.StringIO(table.read_text("utf-8"))))
    assert [row["arm"] for row in rows] == [arm.name for arm in found.arms]
    assert float(rows[1]["every_high"]) == found.arms[1].every.high


def test_pictures(tmp_path):
    tables, plot = tmp_path / "arms.svg", tmp_path / "plot.svg"
    run("dh5", "kinova", "--samples", 64, "-o", tables, "--plot", plot)
    assert "kinova" in tables.read_text("utf-8")
    assert len(plot.read_bytes()) > 5000


def test_the_seed_and_the_options_arrive():
    options = ("--samples", 300, "--seed", 4, "--mode", "free", "--axes", "world", "--task",
               "fx,fz", "--direction", "0,1", "--limits", "urdf", "--payload", "0.5", "--rtol",
               "1e-5", "--wary", "0.05", "--enough", "0.7", "--method", "uniform", "--gravity",
               "0,0,-3", "--cell", "0.3", "--threads", 1)  # fmt: skip
    document = json.loads(run("dh5", "kinova", *options, "--format", "json").stdout)
    found = compare(
        ["dh5", "kinova"], n=300, seed=4, mode="free", axes="world", task="fx,fz",
        direction=[0, 1], payload=0.5, rtol=1e-5, wary=0.05, enough=0.7, method="uniform",
        gravity=[0, 0, -3], cell=0.3,
    )  # fmt: skip
    asked = document["question"]
    assert asked["mode"] == "free"
    assert asked["components"] == ["fx", "fz"]
    assert asked["gravity"] == [0.0, 0.0, -3.0]
    assert document["enough"] == 0.7
    for one, arm in zip(document["arms"], found.arms, strict=True):
        assert one["workspace"]["cell"] == 0.3
        assert "uniform random postures" in one["postures"]["source"]
        assert one["tolerated"]["value"] == arm.tolerated.value
        assert one["healthy_capability"]["q50"]["value"] == arm.healthy_capability[1].value


def test_the_bar_is_over_all_arms(monkeypatch):
    seen = []

    @contextmanager
    def bar(what):
        assert what == "postures"
        yield lambda done, total: seen.append((done, total))

    monkeypatch.setattr(import_module("ftforce.cli.compare"), "rate_bar", bar)
    run("dh5", "kinova", "--samples", 64)
    assert seen[-1] == (128, 128)


def test_stored_sweeps(tmp_path):
    for name in ("dh5", "kinova"):
        sweep(ftforce.load_robot(name), n=500, faults=2, output=tmp_path / f"{name}.zarr")
    stored = [tmp_path / "dh5.zarr", tmp_path / "kinova.zarr"]
    assert "up to 2 joints locked" in run(*stored).stdout
    assert "500 of each arm" in run(stored[0], "kinova", "--samples", 500, "--faults", 2).stdout


@pytest.mark.parametrize(
    ("arms", "said"),
    [
        (["dh5", "kinowa"], "error: unknown robot or file 'kinowa'"),
        (["dh5"], "error: a comparison needs two arms or more, got 1"),
        (["dh5", "none.zarr"], "error: none.zarr: no such folder"),
        (["panda", "dh5", "--faults", "6"], "error: dh5: faults must be an integer from 1 to 5"),
    ],
)
def test_what_is_wrong_takes_a_line_and_leaves_nothing(tmp_path, monkeypatch, arms, said):
    monkeypatch.chdir(tmp_path)
    result = run(*arms, "-o", "arms.json", status=1)
    assert re.match(said, in_one_line(result))
    assert list(Path().iterdir()) == []
