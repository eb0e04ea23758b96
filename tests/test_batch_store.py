"""Sweeps on disk: what other programs see, and what a kill, a full disk or another sweep does."""

import errno
import fcntl
import json
import os
import random
import re
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import ftforce
from ftforce.analysis.question import AllFaultSets
from ftforce.batch import runner
from ftforce.batch.job import PER_POSTURE, PER_SET
from ftforce.batch.postures.drawn import Drawn
from ftforce.batch.size import samples_size
from ftforce.batch.store import folder, manifest, store, variables
from ftforce.batch.summary.summary import Summary
from ftforce.batch.sweep import request_of, sweep, sweep_question
from ftforce.errors import FtforceError, OutputError, SweepError, TrajectoryError
from helpers import campaign
from sweeps import LONG, child, content, differences, killed

pytestmark = [
    pytest.mark.thorough,  # processes take seconds to start
    pytest.mark.usefixtures("kernels"),
]

ASKED = {"n": 13_000, "chunk": 4096, "force": [80.0, 50.0, 10.0]}
WHOLE = {**ASKED, "keep": "all"}
NEVER = 10**9  # a step that no process reaches
SLOW = (  # a chunk takes a moment after it is written, which is when the test acts
    "import ftforce.batch.store.store as s, time; w = s.write_samples; "
    "s.write_samples = lambda *given: (w(*given), time.sleep(0.5))[0]"
)


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def undisturbed(arm, tmp_path_factory):
    """Sweeps that nothing happens to, by what is kept."""
    path = tmp_path_factory.mktemp("undisturbed")
    return {
        keep: sweep(arm, **ASKED, keep=keep, output=path / keep, threads=2)
        for keep in ("summary", "worst", "all")
    }


@pytest.fixture(scope="module")
def stored(undisturbed):
    return undisturbed["all"]


def assert_same_files(path, other):
    assert not differences(content(path), content(other))


def stopped(arm, path, **more):
    """Begin a sweep and interrupt it after the first chunk."""

    def progress(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(arm, **WHOLE, **more, output=path, progress=progress, threads=1)


# ---- what other programs see -----------------------------------------------------------------


@pytest.mark.parametrize("open_it", [xr.open_zarr, lambda p: xr.open_dataset(p, engine="zarr")])
def test_plain_xarray_opens_it_without_a_word(stored, open_it):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataset = open_it(stored.path)
    assert dict(dataset.verdict.sizes) == {"posture": 13_000, "fault_set": 5}
    counts = [(dataset.verdict == code).sum("posture") for code in (1, 2, 3)]
    np.testing.assert_array_equal(np.stack(counts, axis=1), dataset.summary_verdicts)
    np.testing.assert_array_equal(stored.summary.verdicts, dataset.summary_verdicts)
    assert dataset.verdict.attrs["flag_meanings"].split()[0] == "tolerated"
    assert list(dataset.verdict.attrs["flag_values"]) == [1, 2, 3]  # 0 is what lost data reads as


def test_the_datasets_verdicts_are_indices_as_everywhere_else(arm, undisturbed):
    for keep, name in (("all", "verdict"), ("worst", "worst_verdict")):
        result = undisturbed[keep]
        in_memory = sweep(arm, **ASKED, keep=keep)
        for dataset in (result.dataset, in_memory.dataset):
            assert dataset[name].dtype == np.int8
            assert list(dataset[name].attrs["flag_values"]) == list(dataset.verdict_code.values)
            assert set(np.unique(dataset[name])) <= {0, 1, 2}
            chosen = dataset[name].isel(posture=[3, 0, -1])
            np.testing.assert_array_equal(chosen, dataset[name].values[[3, 0, -1]])
    counts = [(undisturbed["all"].dataset.verdict == code).sum("posture") for code in range(3)]
    np.testing.assert_array_equal(np.stack(counts, 1), undisturbed["all"].summary.verdicts)


def test_coordinates_say_what_is_where(stored, arm):
    dataset = xr.open_zarr(stored.path)
    assert list(dataset.joint.values) == list(arm.names)
    assert list(dataset.fault_set.values) == [str(one) for one in stored.sets]
    assert list(dataset.joint_unit.values) == ["rad"] * 5
    np.testing.assert_array_equal(dataset.joint_fails, np.eye(5))
    grid = stored.summary.workspace
    inside = dataset.tip.values
    nearest = np.abs(dataset.cell_x.values[:, None] - inside[:, 0]).argmin(axis=0)
    per_slice = np.bincount(nearest, minlength=grid.shape[0])
    np.testing.assert_array_equal(
        per_slice, dataset.summary_cell_postures.sum(["cell_y", "cell_z"])
    )


def test_bins_have_their_edges(stored):
    dataset = xr.open_zarr(stored.path)
    for name, values in (("share_bin", dataset.margin), ("jump_bin", dataset.jump)):
        edges = dataset[dataset[name].attrs["bounds"]].values
        np.testing.assert_array_equal(edges[:, 0], dataset[name])
        np.testing.assert_array_equal(edges[1:, 0], edges[:-1, 1])
        counted = dataset[f"summary_{values.name}"].isel(fault_set=1).values
        i = int(counted.argmax())
        one = values.isel(fault_set=1)
        assert counted[i] == ((one >= edges[i, 0]) & (one < edges[i, 1])).sum()


def test_every_array_has_words_and_nothing_hangs_on_the_command(stored):
    dataset = xr.open_zarr(stored.path)
    for name, array in dataset.variables.items():
        if not name.endswith("_bounds"):
            assert array.attrs["long_name"]
    assert (dataset.jump.attrs["units"], dataset.tip.attrs["units"]) == ("N", "m")
    assert dataset.attrs["rtol"] == stored.setting.rtol
    assert dataset.attrs["axes"] == "tool"
    text = json.dumps({k: str(v) for k, v in dataset.attrs.items()})
    assert os.fspath(stored.path) not in text


@pytest.mark.parametrize(
    ("joints", "q", "sigma"),
    [(("rad", "rad"), "rad", "m/rad"), (("m", "m"), "m", "1"), (("rad", "m"), None, None)],
)
def test_units_follow_the_joints(stored, joints, q, sigma):
    setting = replace(stored.setting, joint_units=joints)
    assert variables.sample("q", setting).attributes.get("units") == q
    about = variables.sample("sigma_min", setting).attributes
    assert about.get("units") == sigma
    assert ("comment" in about) == (sigma is None)


def test_a_task_of_moments_has_jumps_in_newton_metres(arm):
    result = sweep(arm, n=5000, task="moment", force=[1, 2, 3])
    assert result.dataset.summary_max_jump.attrs["units"] == "N m"


def test_worst_sets_are_those_of_all_samples(undisturbed):
    worst, whole = (undisturbed[keep].dataset for keep in ("worst", "all"))
    at = xr.DataArray(worst.worst_set.values, dims="posture")
    for name in ("verdict", "margin", "jump"):
        np.testing.assert_array_equal(worst[f"worst_{name}"], whole[name].isel(fault_set=at))
    np.testing.assert_array_equal(worst.worst_verdict, whole.verdict.max("fault_set"))


def test_a_netcdf_file_could_hold_its_attributes(stored):
    for value in stored.dataset.attrs.values():
        assert isinstance(value, (str, float, int))


def test_open_sweep_gives_back_what_sweep_gave(stored):
    again = store.open_sweep(stored.path)
    assert again.setting == stored.setting
    assert again.sets == stored.sets
    for name, array in stored.summary.arrays().items():
        np.testing.assert_array_equal(array, again.summary.arrays()[name])
    xr.testing.assert_identical(again.dataset, stored.dataset)


# ---- killed ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def disturbed(tmp_path_factory):
    """Sweeps that were killed many times: their folders, and how often; all by one process."""
    folders = {
        name: tmp_path_factory.mktemp("disturbed") / name
        for name in ("summary", "worst", "all", "completed", "half made")
    }
    asked = []
    for keep in ("summary", "worst", "all"):
        chance = random.Random(keep)
        # Early ones die while the folder is made, late ones while it is completed.
        early = chance.choices(range(6, 200), k=campaign(10, 1))
        late = chance.choices(range(200, 500), k=campaign(6, 1))
        asked.append([{**ASKED, "keep": keep, "threads": 2}, [2, *early, *late, NEVER]])
    # The chunks are done at once, so that most of the steps make or complete the folder.
    points = [400, *range(20, 380, campaign(20, 100)), NEVER]
    asked.append([{**ASKED, "keep": "summary", "chunk": 13_000}, points])
    asked.append([{"n": 5000, "keep": "all"}, [40]])
    for one, path in zip(asked, folders.values(), strict=True):
        one[0]["output"] = str(path)
    return folders, dict(zip(folders, killed(asked), strict=True))


@pytest.mark.parametrize("keep", ["summary", "worst", "all"])
def test_killed_at_any_step_it_ends_with_the_same_bytes(undisturbed, disturbed, keep, tally):
    folders, times = disturbed
    assert times[keep] >= 2
    tally.count("killed sweeps", times[keep])
    assert_same_files(undisturbed[keep].path, folders[keep])


def test_killed_while_it_is_completed(arm, tmp_path, disturbed, tally):
    folders, times = disturbed
    assert times["completed"] >= 3
    tally.count("killed sweeps", times["completed"])
    sweep(arm, **{**ASKED, "chunk": 13_000}, keep="summary", output=tmp_path / "s")
    assert_same_files(tmp_path / "s", folders["completed"])


def test_what_another_command_left_half_made_is_cleared(arm, tmp_path, disturbed):
    path = disturbed[0]["half made"]
    assert "q/.zarray" in content(path)
    for one in (path, tmp_path / "s"):
        sweep(arm, n=5000, keep="summary", output=one)
    assert_same_files(tmp_path / "s", path)


def test_interrupted_from_outside(tmp_path, arm, stored):
    path, counted = tmp_path / "s", tmp_path / "counted"
    count = (
        f"; import ftforce.batch.runner as r, pathlib; r.SAVE_INTERVAL = 0.0; p = s.save_progress; "
        f"s.save_progress = lambda o: (p(o), pathlib.Path({str(counted)!r}).touch())"
    )
    process = child({**WHOLE, "output": str(path), "threads": 1}, before=SLOW + count)
    while not counted.exists():
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=LONG)
    assert "KeyboardInterrupt" in said
    assert store.open_sweep(path).summary.postures >= 4096
    sweep(arm, **WHOLE, output=path)
    assert_same_files(stored.path, path)


def test_interrupted_it_keeps_what_is_done_and_the_rest_reads_as_unknown(arm, tmp_path):
    path = tmp_path / "s"
    stopped(arm, path)
    done = int(store.open_sweep(path).summary.postures)
    assert 4096 <= done < 13_000
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        verdict = xr.open_zarr(path).verdict.values
    assert np.isnan(verdict[-1]).all()  # and not 0, which is tolerated
    assert np.isfinite(verdict[0]).all()
    seen = []
    sweep(arm, **WHOLE, output=path, progress=lambda now, total: seen.append(now))
    assert seen[0] > done
    assert seen[-1] == 13_000


def test_interrupted_within_a_merge_nothing_counts_twice(arm, tmp_path, undisturbed, monkeypatch):
    asked = {**ASKED, "keep": "summary", "output": tmp_path / "s"}
    real, calls = Summary.merge, []

    def merge(self, other):
        real(self, other)
        calls.append(len(calls))
        if len(calls) == 2:  # all is added, but nobody knows yet which chunks it was
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Summary, "merge", merge)
        patch.setattr(runner, "_BATCH_SECONDS", 0.0)  # one chunk at a time
        with pytest.raises(KeyboardInterrupt):
            sweep(arm, **asked, threads=1)
    assert int(sweep(arm, **asked).summary.postures) == ASKED["n"]
    assert_same_files(undisturbed["summary"].path, tmp_path / "s")


# ---- something else is there -----------------------------------------------------------------


def test_another_command_is_refused_and_says_what_differs(arm, stored):
    before = content(stored.path)
    with pytest.raises(OutputError, match=r"different sweep \(rtol 1e-06 instead of 1e-07\)"):
        sweep(arm, **WHOLE, rtol=1e-7, output=stored.path)
    with pytest.raises(OutputError, match=r"\(keep .all. instead of .worst.\)"):
        sweep(arm, **ASKED, keep="worst", output=stored.path)
    assert not differences(before, content(stored.path))


def _zarr_of_somebody(path):
    import zarr

    zarr.open_group(path, mode="w", zarr_format=2).create_array("q", shape=(3,), dtype="f8")


def _half_made_with_a_letter(path):
    folder.lock(path).release()
    (path / "q").mkdir()
    (path / "letter.txt").write_text("dear")


@pytest.mark.parametrize(
    "make", [_zarr_of_somebody, lambda path: path.write_text("dear"), _half_made_with_a_letter]
)
def test_what_is_not_ours_is_never_touched(arm, tmp_path, make):
    path = tmp_path / "theirs"
    make(path)
    before = content(tmp_path)
    with pytest.raises(OutputError, match="is not a sweep"):
        sweep(arm, n=5000, output=path)
    assert not differences(before, content(tmp_path))
    with pytest.raises(SweepError, match="is not a sweep"):
        store.open_sweep(path)


def test_an_empty_folder_is_taken(arm, tmp_path):
    sweep(arm, n=5000, output=tmp_path)
    assert store.open_sweep(tmp_path).summary.postures == 5000


def test_only_one_process_writes(arm, tmp_path):
    path = tmp_path / "s"
    stopped(arm, path)
    held = folder.lock(path)
    who = folder.lock_of(path)
    with pytest.raises(OutputError, match=rf"another sweep \(process {os.getpid()} on "):
        sweep(arm, **WHOLE, output=path)
    assert folder.lock_of(path) == who != {}  # by its token workers know the folder
    held.release()
    sweep(arm, **WHOLE, output=path)


def test_a_lock_of_a_killed_process_blocks_nobody(arm, tmp_path):
    path = tmp_path / "s"
    script = (
        "import sys, pathlib; from ftforce.batch.store import folder; "
        "held = folder.lock(pathlib.Path(sys.argv[1])); print(flush=True); sys.stdin.read()"
    )
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdin=pipe, stdout=pipe, text=True
    )
    process.stdout.readline()
    with pytest.raises(OutputError, match=f"process {process.pid} on"):
        sweep(arm, n=5000, output=path)
    process.kill()
    process.communicate()
    assert (path / folder.LOCK).exists()
    sweep(arm, n=5000, output=path)
    assert not (path / folder.LOCK).exists()


@pytest.mark.parametrize("problem", [errno.ENOTSUP, errno.ENOSYS])
def test_locks_that_a_file_system_lacks_are_done_without(arm, tmp_path, monkeypatch, problem):
    monkeypatch.setattr(fcntl, "flock", _fails_after(0, None, problem))
    sweep(arm, n=5000, output=tmp_path / "s")
    assert store.open_sweep(tmp_path / "s").summary.postures == 5000


# ---- a disk or an input that fails -----------------------------------------------------------


def _fails_after(calls, function, problem=errno.ENOSPC):
    left = [calls]

    def failing(*args, **more):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(problem, os.strerror(problem))
        return function(*args, **more)

    return failing


@pytest.mark.parametrize("calls", [0, 10, 30, *range(1, campaign(90, 1), 2)])
def test_a_full_disk_is_one_clear_line_and_the_sweep_goes_on(
    tmp_path, stored, monkeypatch, calls, tally
):
    arm, path = ftforce.load_robot("dh5"), tmp_path / "s"
    tally.count("full disks", 1, refused=1)
    with monkeypatch.context() as patch:
        patch.setattr(folder, "sync", _fails_after(calls, folder.sync))
        with pytest.raises(OutputError, match="No space left on device") as raised:
            sweep(arm, **WHOLE, output=path, threads=1)
    assert "\n" not in str(raised.value)
    said = re.search("([0-9,]+) of 13,000 postures are kept, and the same comm", str(raised.value))
    if said is None:
        with pytest.raises(SweepError):
            store.open_sweep(path)
    else:
        assert store.open_sweep(path).summary.postures == int(said[1].replace(",", ""))
    sweep(arm, **WHOLE, output=path)
    assert_same_files(stored.path, path)


def test_chunks_that_are_finished_when_the_disk_is_full_stay(arm, tmp_path, monkeypatch):
    path = tmp_path / "s"
    with monkeypatch.context() as patch:
        real = store.write_samples
        patch.setattr(store, "write_samples", _fails_after(2, real))
        patch.setattr(runner.BatchSizer, "took", lambda *_: None)  # one chunk at a time
        with pytest.raises(OSError, match="No space"):
            sweep(arm, **WHOLE, output=path, threads=1)
    assert store.open_sweep(path).summary.postures == 2 * 4096


@pytest.mark.parametrize("saved", [True, False])
def test_what_is_said_to_be_kept_is_kept(arm, tmp_path, monkeypatch, saved):
    """A full disk often has no room for the progress file either: then nothing is kept."""
    path = tmp_path / "s"
    with monkeypatch.context() as patch:
        full = OutputError(path, "cannot be written (No space left on device)")
        writes = chain([None, None], repeat(full))

        def write(*_):
            if (problem := next(writes)) is not None:
                raise problem
            return {}  # no file, hence no digest

        patch.setattr(store, "write_samples", write)
        patch.setattr(runner.BatchSizer, "took", lambda *_: None)  # one chunk at a time
        if not saved:
            patch.setattr(store, "save_progress", lambda _: write())
        with pytest.raises(OutputError) as raised:
            sweep(arm, **WHOLE, output=path, threads=1)
    kept = "no posture was kept"
    if saved:
        kept = "8,192 of 13,000 postures are kept, and the same command resumes the sweep"
    assert str(raised.value) == f"{path}: cannot be written (No space left on device); {kept}"


def test_a_progress_file_that_cannot_be_written_is_told(arm, tmp_path, monkeypatch):
    path = tmp_path / "s"
    real = folder.write_durably

    def no_progress(file: Path, data: bytes) -> None:
        if file.name == ".progress.npz":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(file, data)

    with monkeypatch.context() as patch:
        patch.setattr(folder, "write_durably", no_progress)
        patch.setattr(runner, "SAVE_INTERVAL", 0.0)
        with pytest.raises(OutputError, match="No space left on device"):
            sweep(arm, **WHOLE, output=path)
    sweep(arm, **WHOLE, output=path)
    assert store.open_sweep(path).summary.postures == 13_000


def test_a_disk_that_is_really_full(arm, tmp_path, stored, monkeypatch):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    try:
        if subprocess.run(mount, capture_output=True, check=False).returncode:
            pytest.skip("only root can make a small disk")
    except FileNotFoundError:
        pytest.skip("no mount here")
    try:
        with pytest.raises(OutputError, match="the disk has 1 MB free"):
            sweep(arm, **WHOLE, output=disk / "s")
        assert not any(disk.iterdir())
        monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1e12))  # by then
        with pytest.raises(OutputError, match="No space left on device"):
            sweep(arm, **WHOLE, output=disk / "s")
        subprocess.run(["mount", "-o", "remount,size=200m", str(disk)], check=True)
        sweep(arm, **WHOLE, output=disk / "s")
        assert_same_files(stored.path, disk / "s")
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_folder_that_may_not_be_written(arm, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "open", _fails_after(0, os.open, errno.EACCES))
    with pytest.raises(OutputError, match=r"cannot be written \(Permission denied\)$"):
        sweep(arm, n=5000, output=tmp_path / "s")


@pytest.mark.parametrize("harm", ["unlink", "touch"])
def test_a_file_of_postures_that_changes_in_the_middle(arm, tmp_path, harm):
    file, path = tmp_path / "postures.npy", tmp_path / "s"
    q = np.random.default_rng(1).uniform(-1, 1, (13_000, 5))
    np.save(file, q)

    def progress(done, total):
        if file.exists():
            file.unlink()
            if harm == "touch":
                np.save(file, q[:-1])

    with pytest.raises(TrajectoryError, match=r"postures\.npy"):
        sweep(arm, file, chunk=4096, output=path, threads=1, progress=progress)
    assert store.open_sweep(path).summary.postures >= 4096
    np.save(file, q)
    result = sweep(arm, file, chunk=4096, output=path)
    np.testing.assert_array_equal(result.dataset.q, q)


def test_a_chunk_that_was_cut_short_is_written_anew(arm, tmp_path, stored):
    path = tmp_path / "s"
    stopped(arm, path)
    (path / "margin" / "3.0").write_bytes(b"cut")  # the last chunk, which is not full
    sweep(arm, **WHOLE, output=path)
    assert_same_files(stored.path, path)


def changed_manifest(path, change):
    """Change the description of a sweep, and seal it again."""
    found = manifest.read_manifest(path, SweepError)
    about = json.loads(json.dumps(found.about))
    change(about)
    (path / ".manifest").write_bytes(found._replace(about=about).to_bytes())


def test_a_sweep_without_what_later_versions_add_is_read_and_recognised(arm, tmp_path):
    path = tmp_path / "s"
    asked = {"n": 5000, "keep": "summary", "payload": (1.5, [0.0, 0.1, 0.0])}
    written = sweep(arm, **asked, output=path)
    assert store.open_sweep(path).setting == written.setting

    def forget(about):
        for name in ("tip_source", "other_tips", "payload_mass", "payload_offset"):
            del about["setting"][name]
            assert name not in about["identity"]

    changed_manifest(path, forget)
    setting = store.open_sweep(path).setting
    assert (setting.carried.mass, setting.carried.offset.tolist()) == (1.5, [0.0, 0.1, 0.0])
    assert (setting.tip_source, setting.other_tips) == ("", {})
    assert sweep(arm, **asked, output=path).done == 5000  # no error: it is the same sweep


def test_a_sweep_of_format_1_is_refused(arm, tmp_path):
    path = tmp_path / "s"
    path.mkdir()
    (path / ".zattrs").write_text(json.dumps({"ftforce": '{"format": 1}'}))
    for use in (store.open_sweep, lambda path: sweep(arm, n=5000, output=path)):
        with pytest.raises(FtforceError, match="has format 1, without the digests"):
            use(path)


def test_damage_is_told(arm, tmp_path):
    path = tmp_path / "s"
    sweep(arm, n=5000, keep="summary", output=path)
    changed_manifest(path, lambda about: about.pop("bins"))
    with pytest.raises(SweepError, match="damaged"):
        store.open_sweep(path)
    changed_manifest(path, lambda about: about.update(format=99))
    with pytest.raises(SweepError, match="format 99"):
        store.open_sweep(path)


def test_without_the_extra_the_sweep_is_not_called_damaged(stored, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(FtforceError, match=r"stored sweeps require zarr.*ftforce\[sweep\]"):
        store.open_sweep(stored.path)


def test_a_damaged_progress_file_is_told(arm, tmp_path):
    path = tmp_path / "s"
    stopped(arm, path)
    (path / ".progress.npz").write_bytes(b"PK")
    with pytest.raises(SweepError, match="remove it to start again"):
        sweep(arm, **WHOLE, output=path)
    (path / ".progress.npz").unlink()
    sweep(arm, **WHOLE, output=path)


def test_no_sweep_is_no_sweep(tmp_path):
    with pytest.raises(SweepError, match="no such folder"):
        store.open_sweep(tmp_path / "none")


# ---- how much is stored ----------------------------------------------------------------------


@pytest.mark.parametrize("keep", ["worst", "all"])
def test_the_size_on_disk_is_known_before(undisturbed, arm, keep):
    """Beside what the disk holds afterwards."""
    result, names = undisturbed[keep], {*PER_POSTURE, *PER_SET}
    files = [file for folder in Path(result.path).iterdir() for file in folder.glob("[0-9]*")
             if folder.name in names or folder.name.startswith("worst_")]  # fmt: skip
    said = samples_size(request(arm, keep), keep)
    assert said == pytest.approx(sum(file.stat().st_size for file in files), rel=0.07)


def request(arm, keep):
    asked = sweep_question(arm, force=ASKED["force"])
    postures = Drawn.of(arm, ASKED["n"], "sobol", 0)
    return request_of(asked, AllFaultSets.parse(arm, 1, "locked"), postures, keep=keep, cell=None)


def test_an_output_keeps_the_worst_set_and_says_what_that_takes(arm, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    sweep(arm, **ASKED, output=tmp_path / "s", threads=1)
    assert ftforce.open_sweep(tmp_path / "s").setting.keep == "worst"
    sizes = (samples_size(request(arm, "all"), keep) / 1e6 for keep in ("worst", "all"))
    worst, whole = (f"{size:.1f} MB" for size in sizes)
    words = f"storing about {worst} in {tmp_path / 's'}; --keep all would be {whole}\n"
    assert capsys.readouterr().err == words
    sweep(arm, **ASKED, output=tmp_path / "s", threads=1)  # it is there
    sweep(arm, **ASKED, output=tmp_path / "t", keep="summary", threads=1)
    assert not capsys.readouterr().err


def test_what_the_disk_has_no_room_for_is_refused_before_the_work(arm, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    match = r"takes about 1\.. MB, and the disk has 1 MB free; --keep all would be 2\.. MB, --keep"
    with pytest.raises(OutputError, match=match):
        sweep(arm, **ASKED, output=tmp_path / "s")
    assert not any(tmp_path.iterdir())
    sweep(arm, **ASKED, keep="summary", output=tmp_path / "s")
