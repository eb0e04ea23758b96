"""``ftforce sweep`` at the command line."""

from __future__ import annotations

import json
from contextlib import contextmanager

import numpy as np
import pytest
import xarray as xr

import ftforce
from ftforce.cli import progress as bars
from test_cli import run

SMALL = ("sweep", "dh5", "--samples", "1000")


def test_the_tables_name_the_critical_joint():
    result = run(*SMALL, "--faults", "2", "--top", "3")
    assert result.exit_code == 0, result.stderr
    assert "15 sets of 1 to 2 joints, locked" in result.stdout
    assert "… and 12 more (--top)" in result.stdout
    assert "The critical joints are joint1 and joint2" in " ".join(result.stdout.split())
    assert max(map(len, result.stdout.splitlines())) <= 80


@pytest.mark.thorough
def test_the_command_says_what_python_says(monkeypatch):
    monkeypatch.setattr(
        "ftforce.batch.compiled.is_ready", lambda *_: True
    )  # the kernels both times
    options = {"force": [80, 50, 10], "direction": [0, 1, 0], "mode": "free", "payload": 1.0}
    options |= {"axes": "world", "seed": 3, "method": "uniform", "faults": 2, "cell": 0.3}
    options |= {"rtol": 1e-5, "wary": 0.05, "gravity": [0, 0, -3], "limits": "urdf", "threads": 1}
    typed = []
    for name, value in options.items():
        text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
        typed += [f"--{name}", text]
    document = json.loads(run(*SMALL, *typed, "--format", "json").stdout)
    sweep = ftforce.sweep(ftforce.load_robot("dh5"), n=1000, **options)
    assert document == json.loads(json.dumps(ftforce.to_dict(sweep)))


@pytest.mark.thorough
def test_a_zarr_folder_is_kept_and_opens_in_xarray(tmp_path):
    out = tmp_path / "s.zarr"
    first = run(*SMALL, "--output", str(out), "--keep", "worst")
    assert first.exit_code == 0, first.stderr
    with xr.open_dataset(out, engine="zarr") as dataset:
        assert dataset.sizes["posture"] == 1000
        assert "worst_margin" in dataset
    again = run(*SMALL, "--output", str(out), "--keep", "worst")
    assert again.stdout == first.stdout
    assert ftforce.open_sweep(out).setting.keep == "worst"


@pytest.mark.thorough
def test_another_question_is_refused_by_an_existing_folder(tmp_path):
    out = tmp_path / "s.zarr"
    run(*SMALL, "-o", str(out))
    result = run(*SMALL, "-o", str(out), "--seed", "1", status=1)
    assert "contains a different sweep" in result.stderr
    assert "seed" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["json", "csv", "svg"])
def test_tables_become_files(form, tmp_path):
    file = tmp_path / f"s.{form}"
    assert run(*SMALL, "-o", str(file)).exit_code == 0
    assert "joint2" in file.read_text("utf-8")


@pytest.mark.thorough
def test_postures_from_a_file_in_degrees(tmp_path):
    q = np.array([[10.0, 70.0, 25.0, 65.0, 0.0], [-10.0, 18.0, -6.0, -5.0, -6.0]])
    np.savetxt(
        tmp_path / "q.csv", q, delimiter=",", comments="",
        header="joint1,joint2,joint3,joint4,joint5",
    )  # fmt: skip
    arguments = ("sweep", "dh5", "--postures", str(tmp_path / "q.csv"), "--deg")
    out = tmp_path / "s.zarr"
    result = run(*arguments, "--force", "80,50,10", "--keep", "all", "-o", str(out))
    assert result.exit_code == 0, result.stderr
    assert "2 postures from q.csv" in result.stdout
    assert "not drawn at random" in " ".join(result.stdout.split())
    dataset = ftforce.open_sweep(out).dataset
    np.testing.assert_allclose(dataset["q"], np.radians(q), rtol=1e-12)
    # Table 3 of the paper: the third joint's lock costs 80 N, the others' nothing.
    np.testing.assert_allclose(dataset["jump"][0], [0.0, 0.0, 80.0, 0.0, 0.0], atol=0.005)


@pytest.mark.thorough
def test_a_grid(tmp_path):
    result = run("sweep", "dh5", "--grid", "1,3,3,2,1", "--format", "json")
    assert json.loads(result.stdout)["postures"]["count"] == 18
    assert "warning: the postures were not drawn" in result.stderr


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        ((), 2, "give one of --samples, --postures and --grid"),
        (("--samples", "10", "--grid", "2"), 2, "give one of"),
        (("--samples", "10", "--deg"), 2, "--deg requires --postures"),
        (("--grid", "2.5"), 2, "--grid needs whole numbers"),
        (("--samples", "10", "--keep", "all", "-o", "x.csv"), 2, "needs an --output that ends"),
        (("--samples", "10", "--keep", "some", "-o", "x.zarr"), 2, "unknown value of keep 'some'"),
        (("--samples", "10", "--workers", "0"), 1, "workers must be a positive integer"),
        (("--samples", "10", "--workers", "100000"), 1, "workers must not exceed "),
        (("--samples", "10", "--threads", "100000"), 1, "threads must not exceed "),
        (("--samples", "10", "--chunk", "10"), 1, "chunk must be an integer from 4096"),
        (("--samples", "10", "-o", "x.nc"), 2, "the name must end in"),
        (("--samples", "10", "-o", "nowhere/x.zarr"), 1, "cannot be written"),
        (("--postures", "nowhere.csv"), 1, "no such file"),
    ],
)
def test_wrong_words_get_one_line(words, status, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("sweep", "dh5", *words, status=status)
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_zarr_is_for_sweeps(tmp_path):
    result = run("census", "dh5", "-o", str(tmp_path / "x.zarr"), status=2)
    assert result.stderr == "error: .zarr is for `ftforce sweep`; use .json or .csv\n"


def test_an_interrupt_says_what_is_kept(tmp_path, monkeypatch):
    def interrupted(*_arguments, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("ftforce.batch.sweep.sweep", interrupted)
    result = run(*SMALL, "-o", str(tmp_path / "x.zarr"), status=130)
    kept = "interrupted; finished chunks are kept; the same command resumes the sweep\n"
    assert result.stderr == kept
    assert "nothing was kept" in run(*SMALL, status=130).stderr


def test_an_interrupt_says_how_many_postures_are_kept(tmp_path, monkeypatch):
    @contextmanager
    def pressed_after_a_chunk(_what):
        def progress(done, total):
            raise KeyboardInterrupt

        yield progress

    path = str(tmp_path / "x.zarr")
    asked = ("sweep", "dh5", "--samples", "13000", "--chunk", "4096", "--threads", "1", "-o", path)
    with monkeypatch.context() as patch:
        patch.setattr("ftforce.cli.sweep.rate_bar", pressed_after_a_chunk)
        said = run(*asked, status=130).stderr
    kept = int(ftforce.open_sweep(path).summary.postures)
    assert kept % 4096 == 0 < kept < 13000
    words = f"{kept:,} of 13,000 postures are kept, and the same command resumes the sweep"
    assert said == f"interrupted; {words}\n"


def test_the_bar_shows_rate_and_time_left(monkeypatch, capsys):
    clock = iter([0.0, 2.0, 2.0, 4.0, 4.0, 4.0])
    monkeypatch.setattr(bars.time, "monotonic", lambda: next(clock, 4.0))
    shown = []

    class Bar:
        def __init__(self, *_columns, **_options):
            pass

        def add_task(self, *_words, **_fields):
            return 0

        def start(self):
            shown.append("start")

        def stop(self):
            shown.append("stop")

        def update(self, _task, **fields):
            shown.append(fields)

    monkeypatch.setattr("rich.progress.Progress", Bar)
    monkeypatch.setattr("rich.console.Console.is_terminal", True)
    with bars.rate_bar("postures") as update:
        update(1000, 5000)  # an earlier run did these
        update(3000, 5000)
    assert shown[0] == "start"
    assert shown[-1] == "stop"
    assert shown[-2]["completed"] == 3000
    assert shown[-2]["rate"] == "1,000 postures/s"


def test_a_name_that_is_too_long_is_refused_in_one_line(tmp_path):
    said = run(*SMALL, "--output", str(tmp_path / f"{'x' * 300}.zarr"), status=1).stderr
    assert said.startswith("error: ")
    assert "cannot be written" in said
    assert said.count("\n") == 1
