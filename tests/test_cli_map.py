"""`ftforce map` as a user types it."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from typer.testing import CliRunner

import ftforce
from ftforce.batch.sweep import sweep
from ftforce.cli import build

pytestmark = pytest.mark.thorough

N = 2048


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweeps") / "dh5.zarr"
    sweep(ftforce.load_robot("dh5"), n=N, force=[80, 50, 10], output=folder, keep="summary")
    return folder


def run(*arguments, status=0):
    environment = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}
    result = CliRunner().invoke(build("map"), ["map", *map(str, arguments)], env=environment)
    assert result.exit_code == status, result.output
    return result


def test_the_tables_fit_and_say_where_and_which_joint(stored):
    shown = run(stored).stdout
    assert max(map(len, (line.rstrip() for line in shown.splitlines()))) <= 80
    for words in (
        "whichever joint locks; xz plane, all y pooled",
        "Tolerated [% of the postures], z upwards, x to the right [m]",
        "m, worst first",
        "Joints, most critical first",
        "ρ = w(K)/w(J) when the joint fails alone, quantiles over the postures",
        "Margin σ_min(K)/σ_max(J) when the joint fails alone",
        f"of {N:,} postures tolerate the fault (whichever joint locks)",
    ):
        assert words in shown, words
    assert "Capability [N]" not in shown
    assert "Capability [N]" in run(stored, "--quantity", "capability").stdout


def test_joints_are_numbers_or_names_and_slices_have_a_plane(stored):
    by_name = run(stored, "--joints", "joint2", "--plane", "xy", "--at", "0").stdout
    assert by_name == run(stored, "--joints", "2", "--plane", "xy", "--at", "0").stdout
    assert "joint 2 (joint2) locked; slice z = " in by_name
    assert "slice y = 0" in run(stored, "--at", "0").stdout


@pytest.mark.parametrize(
    ("ending", "start", "options"),
    [
        ("png", b"\x89PNG", ""),
        ("pdf", b"%PDF", "--plane xy --at 0.1"),
        ("svg", b"<?xml", "--solid"),
    ],
)
def test_plots(stored, tmp_path, ending, start, options):
    file = tmp_path / f"map.{ending}"
    result = run(stored, "--plot", file, *options.split())
    assert f"wrote {file}" in result.stderr
    assert file.read_bytes().startswith(start)


def test_files_hold_the_cells(stored, tmp_path):
    run(stored, "--joints", "2", "-o", tmp_path / "map.csv")
    header, *found = csv.reader(io.StringIO((tmp_path / "map.csv").read_text("utf-8")))
    assert sum(int(row[header.index("postures")]) for row in found) == N
    document = json.loads(run(stored, "--format", "json").stdout)
    opened = ftforce.batch.store.store.open_sweep(stored)
    assert sum(document["cells"]["postures"]) == N
    assert document["sets"][0]["joints"] is None
    for one, wanted in zip(document["sets"][1:], opened.summary.cell_tolerated.T, strict=True):
        assert sum(one["tolerated"]) == wanted.sum()
    low, high = (np.array(document["sets"][0][key]) for key in ("low", "high"))
    assert (low <= document["sets"][0]["share"]).all()
    assert (high >= document["sets"][0]["share"]).all()


@pytest.mark.parametrize(
    ("options", "status", "words"),
    [
        ("--joints 2,3", 1, "no fault set {2, 3}"),
        ("--joints 6", 1, "unknown joint '6'; available: 1 joint1"),
        ("--joints ,", 2, "--joints: joints are given as numbers or names, e.g. 2,4; got an empty"),
        ("--plane zx", 2, "unknown plane 'zx'"),
        ("--at 9", 1, "no posture has its tip at y = 9 m"),
        ("--quantity rho,speed", 2, "unknown quantity 'speed'"),
    ],
)
def test_what_is_not_there_is_said_in_a_line(stored, options, status, words):
    result = run(stored, *options.split(), status=status)
    assert words in result.stderr
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.splitlines()) == 1
    assert not result.stdout


def test_slices_without_postures_are_said_in_a_line(tmp_path):
    arm = ftforce.load_robot("dh5")
    where = tmp_path / "gap.zarr"
    q = np.zeros((200, 5))
    q[:, 0] = np.repeat([-1.2, 1.2], 100)  # two places, and nothing between them
    result = sweep(arm, q, force=[80, 50, 10], cell=0.1, output=where, keep="summary")
    y = np.unique(result.dataset.cell_y.values)
    filled = result.summary.cell_postures.reshape(result.summary.workspace.shape).sum((0, 2)) > 0
    low, high = y[filled][[0, -1]]
    said = run(where, "--plane", "xz", "--at", 0.5 * (low + high), status=1).stderr
    assert "no posture has its tip at y = " in said
    top = high + 0.05  # the border that the message names
    assert "Tolerated" in run(where, "--plane", "xz", "--at", top).stdout


def test_what_is_no_sweep_is_said_in_a_line(tmp_path):
    (tmp_path / "file").write_text("x")
    for path in (tmp_path, tmp_path / "file", tmp_path / "none"):
        assert "expected a sweep stored by ftforce" in run(path, status=1).stderr
