"""Histories in files: they come back bit for bit, and damaged ones are refused in one line."""

from __future__ import annotations

import csv
import io
import json
import os
import random
import zipfile
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest

import ftforce
from ftforce.errors import FtforceError, InputError, OutputError, TrajectoryError
from ftforce.robot.dynamics import Payload
from ftforce.trajectory import Path, history_files
from ftforce.trajectory.history import QUANTITIES, History
from ftforce.trajectory.history_files import (
    FORMATS,
    _about,
    _read_about,
    columns_of,
    history_bytes,
)
from helpers import peak_memory
from urdfs import joint, link, load, robot

LINE = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)


@pytest.fixture(scope="module")
def history():
    dh5 = ftforce.load_robot("dh5")
    return ftforce.simulate(
        dh5, LINE, force=[80, 50, 10], faults=["3@1", "free:4@2"], limits="urdf", rate=10
    )


@pytest.fixture(scope="module")
def falling():
    """A history in which nothing holds the arm in the end: full of NaN."""
    dh5 = ftforce.load_robot("dh5")
    found = ftforce.simulate(
        dh5, LINE, force=[0, 0, 0], faults=["free:2,3,4,5@1"], delay=0.5, payload=3.0, rate=10
    )
    assert np.isnan(found.remapped.force).any()
    return found


def same(one: History, other: History) -> bool:
    """Compare every bit, NaN and signs of zero included."""
    if one.setting != other.setting or list(one.runs) != list(other.runs):
        return False
    pairs = [(one.t, other.t), (one.path, other.path)]
    for name, run in one.runs.items():
        pairs += [(getattr(run, q), getattr(other.runs[name], q)) for q in QUANTITIES]
    return all(
        a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs
    )


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("which", ["history", "falling"])
def test_it_comes_back_bit_for_bit(request, tmp_path, form, which):
    written = request.getfixturevalue(which)
    path = tmp_path / f"run.{form}"
    assert ftforce.save(written, path) == path
    assert same(ftforce.load_history(path), written)


@pytest.mark.parametrize("offset", [[0.0, 0.0, 0.0], [0.1, -1e-7, 1.0 / 3.0]])
def test_the_payload_comes_back_as_it_was_given(tmp_path, offset):
    dh5 = ftforce.load_robot("dh5")
    carried = Payload.of(10.0 / 7.0, offset)
    run = ftforce.simulate(dh5, LINE, force=[1, 2, 3], remap=False, rate=5, payload=carried)
    ftforce.save(run, tmp_path / "run.npz")
    found = ftforce.load_history(tmp_path / "run.npz").setting.carried
    assert (found.mass, found.offset.tolist()) == (carried.mass, carried.offset.tolist())


def test_older_versions_stored_the_payload_as_text_only(falling):
    added = {"tip_source", "other_tips", "payload_mass", "payload_offset"}
    about = json.loads(_about(falling))
    about["setting"] = {k: x for k, x in about["setting"].items() if k not in added}
    for text, mass, offset in (
        ("3 kg", 3.0, [0.0, 0.0, 0.0]),
        ("1.42857 kg at (0.1, -1e-07, 0.333333) m", 1.42857, [0.1, -1e-7, 0.333333]),
    ):
        about["setting"]["payload"] = text
        setting, _ = _read_about(json.dumps(about))
        assert (setting.carried.mass, setting.carried.offset.tolist()) == (mass, offset)
        assert (str(setting.carried), setting.tip_source, setting.other_tips) == (text, "", {})
    about["setting"]["payload"] = ""
    assert _read_about(json.dumps(about))[0].carried is None


@pytest.mark.parametrize("form", FORMATS)
def test_one_changed_bit_is_noticed_by_this_test(tmp_path, history, form):
    q = history.healthy.q.copy()
    q[3, 2] = np.nextafter(q[3, 2], 9.0)
    other = replace(history, healthy=replace(history.healthy, q=q))
    ftforce.save(other, tmp_path / f"run.{form}")
    assert not same(ftforce.load_history(tmp_path / f"run.{form}"), history)


@pytest.mark.parametrize("form", FORMATS)
def test_same_history_same_bytes(history, form):
    assert history_bytes(history, form) == history_bytes(history, form)


def test_same_input_same_bytes(history):
    again = ftforce.simulate(
        ftforce.load_robot("dh5"), LINE, force=[80, 50, 10], faults=["3@1", "free:4@2"],
        limits="urdf", rate=10,
    )  # fmt: skip
    assert history_bytes(again, "npz") == history_bytes(history, "npz")


@pytest.mark.parametrize("form", FORMATS)
def test_a_history_without_remap(tmp_path, form):
    dh5 = ftforce.load_robot("dh5")
    written = ftforce.simulate(dh5, LINE, force=[1, 2, 3], faults="3@1", remap=False, rate=5)
    ftforce.save(written, tmp_path / f"run.{form}")
    found = ftforce.load_history(tmp_path / f"run.{form}")
    assert found.remapped is None
    assert same(found, written)


@pytest.mark.parametrize("form", FORMATS)
def test_arrays_that_come_back_are_read_only(tmp_path, history, form):
    ftforce.save(history, tmp_path / f"run.{form}")
    found = ftforce.load_history(tmp_path / f"run.{form}")
    for name in QUANTITIES:
        with pytest.raises(ValueError, match="read-only"):
            getattr(found.healthy, name)[0] = 0


def test_columns_carry_names_and_units(history):
    rows = list(csv.DictReader(io.StringIO(history_bytes(history, "csv").decode())))
    assert len(rows) == 3 * len(history.t)
    assert [row["run"] for row in rows[:: len(history.t)]] == ["healthy", "unremapped", "remapped"]
    last = rows[-1]
    run = history.remapped
    assert float(last["t [s]"]) == history.t[-1]
    assert float(last["q_joint2 [rad]"]) == run.q[-1, 1]
    assert float(last["v_joint2 [rad/s]"]) == run.v[-1, 1]
    assert float(last["motor_joint5 [N·m]"]) == run.motor[-1, 4]
    assert float(last["force_fy [N]"]) == run.force[-1, 1]
    assert float(last["path_error_z [m]"]) == run.path_error[-1, 2]
    assert float(last["position_x [m]"]) == run.position[-1, 0]
    assert last["verdict"] == run.verdicts[-1].value


def test_units_of_sliding_joints_and_moments(tmp_path):
    rail = load(
        tmp_path,
        robot(
            link("a"), link("b"), link("c"), link("d"),
            joint("rail", "a", "b", kind="prismatic", axis="1 0 0"),
            joint("turn", "b", "c", xyz="0 0 0.3", axis="0 1 0"),
            joint("tip", "c", "d", xyz="0.4 0 0", axis="0 1 0"),
        ),
        tip="d",
    )  # fmt: skip
    t = np.linspace(0.0, 1.0, 6)
    q = np.outer(t, [0.1, 0.2, -0.3])
    from ftforce.trajectory import Recording

    found = ftforce.simulate(
        rail, Recording.of(rail, t, q), force=[1, 0, 0.5], task="fx,fz,my", faults="2@0.5"
    )
    headers = [column.header for column in columns_of(found.setting)]
    for expected in (
        "q_rail [m]", "q_turn [rad]", "v_rail [m/s]", "a_turn [rad/s²]", "motor_rail [N]",
        "motor_turn [N·m]", "force_my [N·m]", "jump_fz [N]", "velocity_jump_x [m/s]",
    ):  # fmt: skip
        assert expected in headers
    for form in FORMATS:
        ftforce.save(found, tmp_path / f"run.{form}")
        assert same(ftforce.load_history(tmp_path / f"run.{form}"), found)


def test_json_is_a_summary(tmp_path, history):
    ftforce.save(history, tmp_path / "run.json")
    document = json.loads((tmp_path / "run.json").read_text())
    assert document["runs"]["remapped"]["verdict"] == "not tolerated"
    assert document["events"][0]["time"] == 1.0


@pytest.mark.parametrize("name", ["run.txt", "run", "run.npy", "run.h5"])
def test_other_endings_are_refused(tmp_path, history, name):
    with pytest.raises(
        InputError, match=r"\.json, \.csv, \.xlsx, \.tex, \.md, \.mcap, \.npz or \.parquet"
    ):
        ftforce.save(history, tmp_path / name)
    with pytest.raises(InputError, match=r"\.csv, \.npz or \.parquet"):
        ftforce.load_history(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_an_analysis_is_no_history(tmp_path):
    result = ftforce.analyze(ftforce.load_robot("dh5"), locked=[3])
    with pytest.raises(InputError, match=r"must end in \.json, \.csv, \.xlsx, \.tex or \.md"):
        ftforce.save(result, tmp_path / "run.npz")


@pytest.mark.parametrize("form", FORMATS)
def test_nothing_is_left_of_what_cannot_be_written(tmp_path, history, form):
    with pytest.raises(OutputError):
        ftforce.save(history, tmp_path / "nowhere" / f"run.{form}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("damage", ["empty", "cut", "text", "missing", "folder"])
def test_damaged_files_are_refused_in_one_line(tmp_path, history, form, damage):
    path = tmp_path / f"run.{form}"
    data = history_bytes(history, form)
    if damage == "folder":
        path.mkdir()
    elif damage != "missing":
        path.write_bytes(
            {"empty": b"", "cut": data[: len(data) // 2], "text": b"a,b\n1,2\n"}[damage]
        )
    with pytest.raises(TrajectoryError) as caught:
        ftforce.load_history(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def rewritten(data: bytes, change) -> bytes:
    """Return an NPZ whose arrays were changed."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    change(arrays)
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def about(**changes):
    def change(arrays):
        content = json.loads(str(arrays["about"]))
        arrays["about"] = np.array(json.dumps({**content, **changes}))

    return change


CHANGES = {
    "another shape": lambda a: a.update({"healthy.q": a["healthy.q"][:, 1:]}),
    "another type": lambda a: a.update({"healthy.q": a["healthy.q"].astype(np.float32)}),
    "a verdict that is none": lambda a: a.update({"healthy.verdict": a["healthy.verdict"] + 7}),
    "an array missing": lambda a: a.pop("unremapped.motor"),
    "times missing": lambda a: a.update({"t": a["t"][1:]}),
    "a path in two dimensions": lambda a: a.update({"path": a["path"][:, :2]}),
    "another format": about(format="something else"),
    "a newer version": about(version=3),
    "other runs": about(runs=["healthy"]),
    "no setting": about(setting=None),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_file_that_does_not_fit_itself_is_refused(tmp_path, history, change):
    path = tmp_path / "run.npz"
    path.write_bytes(rewritten(history_bytes(history, "npz"), change))
    with pytest.raises(TrajectoryError):
        ftforce.load_history(path)


class Hostile:
    """What makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (self.path,)


def test_pickles_are_never_loaded(tmp_path, history):
    path, ran = tmp_path / "run.npz", tmp_path / "ran"
    hostile = np.array([Hostile(ran)], dtype=object)
    path.write_bytes(rewritten(history_bytes(history, "npz"), lambda a: a.update(t=hostile)))
    with pytest.raises(TrajectoryError):
        ftforce.load_history(path)
    assert not ran.exists()


@pytest.mark.parametrize("edit", ["column", "row", "cell", "order"])
def test_a_table_that_was_edited_is_refused(tmp_path, history, edit):
    header, *rows = list(csv.reader(io.StringIO(history_bytes(history, "csv").decode())))
    if edit == "column":
        header[3] = "path_y [mm]"
    elif edit == "row":
        rows.pop()
    elif edit == "cell":
        rows[2][5] = "fast"
    else:
        rows[1], rows[-1] = rows[-1], rows[1]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    path = tmp_path / "run.csv"
    path.write_text(text.getvalue())
    with pytest.raises(TrajectoryError):
        ftforce.load_history(path)


def test_without_pyarrow_the_message_says_what_to_install(monkeypatch, tmp_path, history):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(FtforceError, match=r"pip install 'ftforce\[parquet\]'"):
        ftforce.save(history, tmp_path / "run.parquet")
    assert not list(tmp_path.iterdir())


def test_npz_opens_in_plain_numpy(tmp_path, history):
    ftforce.save(history, tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as archive:
        np.testing.assert_array_equal(archive["remapped.force"], history.remapped.force)
    assert zipfile.is_zipfile(tmp_path / "run.npz")


def test_every_field_of_a_run_is_written(history):
    assert {field.name for field in fields(history.healthy)} == set(QUANTITIES)
    assert {column.quantity for column in columns_of(history.setting)} == set(QUANTITIES)


def test_what_was_simulated_is_plain_json(tmp_path, history):
    """Unknown limits and a remap that never acts are null, not NaN and Infinity."""
    dh5 = ftforce.load_robot("dh5")
    unknown = ftforce.core.limits.Limits.of([150, np.nan, 80, 40, 20])
    written = ftforce.simulate(
        dh5, LINE, force=[1, 2, 3], faults="3@1", remap=False, limits=unknown, rate=5
    )
    for form in FORMATS:
        ftforce.save(written, tmp_path / f"run.{form}")
        found = ftforce.load_history(tmp_path / f"run.{form}")
        assert found.setting.delay == np.inf
        assert np.isnan(found.setting.effort[1])
    with np.load(tmp_path / "run.npz") as archive:
        json.loads(str(archive["about"]), parse_constant=pytest.fail)


def test_reading_leaves_the_csv_module_as_it_was(tmp_path, history):
    usual = csv.field_size_limit()
    ftforce.save(history, tmp_path / "run.csv")
    ftforce.load_history(tmp_path / "run.csv")
    assert csv.field_size_limit() == usual


# ---- damaged and hostile ---------------------------------------------------------------------


def _cut(data, chance):
    return data[: chance.randrange(len(data))]


def _flipped(count):
    def flip(data, chance):
        altered = bytearray(data)
        for bit in chance.sample(range(8 * len(data)), count):
            altered[bit // 8] ^= 1 << bit % 8
        return bytes(altered)

    return flip


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("harm", [_cut, _flipped(1), _flipped(20)], ids=["cut", "1 bit", "20 bits"])
def test_a_damaged_history_gives_the_right_numbers_or_one_line(
    tmp_path, history, form, harm, tally
):
    data, path = history_bytes(history, form), tmp_path / f"run.{form}"
    for number in tally.numbers("files of a history", 200):
        path.write_bytes(harm(data, random.Random(f"{form} {number}")))
        try:
            found = ftforce.load_history(path)
        except TrajectoryError as problem:
            tally.tried(refused=1)
            if "\n" in str(problem):
                tally.fails("unclear messages", number, problem)
        else:
            tally.tried()
            if not same(found, history):
                tally.fails("silent differences", number, "other numbers")


@pytest.mark.parametrize("form", FORMATS)
def test_one_other_number_or_word_is_refused(tmp_path, history, form, monkeypatch):
    """The checksums of the format are right, as after an editor that knows the format."""
    q = history.healthy.q.copy()
    q[3, 2] = np.nextafter(q[3, 2], 9.0)
    setting = replace(history.setting, robot="dh6")
    path = tmp_path / f"run.{form}"
    right = json.loads(_about(history))["sha256"]
    for other in (
        replace(history, healthy=replace(history.healthy, q=q)),
        replace(history, setting=setting),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(history_files, "_digest", lambda *_: right)
            ftforce.save(other, path)
        with pytest.raises(TrajectoryError, match="not those that were saved"):
            ftforce.load_history(path)


def test_pages_of_parquet_files_have_checksums(tmp_path, history):
    from pyarrow import parquet

    data = history_bytes(history, "parquet")
    about = parquet.ParquetFile(io.BytesIO(data)).metadata.row_group(0).column(5)
    at = about.data_page_offset + about.total_compressed_size // 2
    harmed = data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]
    (tmp_path / "run.parquet").write_bytes(harmed)
    with pytest.raises(TrajectoryError, match="CRC checksum"):
        ftforce.load_history(tmp_path / "run.parquet")


def test_a_history_of_version_1_has_no_digest(tmp_path, history):
    old = about(version=1)
    path = tmp_path / "run.npz"
    path.write_bytes(rewritten(history_bytes(history, "npz"), old))
    assert same(ftforce.load_history(path), history)


def test_a_bomb_is_refused_before_it_unfolds(tmp_path, history):
    stream = io.BytesIO()
    with np.load(io.BytesIO(history_bytes(history, "npz"))) as archive:
        np.savez_compressed(stream, **{**archive, "t": np.zeros(20_000_000)})
    (tmp_path / "run.npz").write_bytes(stream.getvalue())
    from pyarrow import parquet, table

    many = {"a": np.zeros(40_000_000)}
    parquet.write_table(
        table(many).replace_schema_metadata({b"ftforce": b"{}"}), tmp_path / "run.parquet"
    )
    for form, match in (("npz", "is compressed"), ("parquet", "declares 40,000,000 rows")):
        path = tmp_path / f"run.{form}"
        with pytest.raises(TrajectoryError, match=match):
            ftforce.load_history(path)
        load = partial(ftforce.load_history, path)
        assert peak_memory(load, refuses=[TrajectoryError]) < 20_000_000


def test_an_array_that_declares_more_than_there_is_is_refused(tmp_path, history):
    def header(shape):
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            stream, {"descr": "<f8", "fortran_order": False, "shape": shape}
        )
        return stream.getvalue()

    data = io.BytesIO(history_bytes(history, "npz"))
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(data) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            new.writestr(name, header((10**12,)) if name == "t.npy" else old.read(name))
    with pytest.raises(TrajectoryError, match="damaged"):
        ftforce.load_history(path)
    load = partial(ftforce.load_history, path)
    assert peak_memory(load, refuses=[TrajectoryError]) < 20_000_000


@pytest.mark.parametrize("form", ["npz", "csv"])
def test_memory_is_in_proportion_to_the_file(tmp_path, history, form):
    path = tmp_path / f"run.{form}"
    ftforce.save(history, path)
    peak = peak_memory(lambda: ftforce.load_history(path))
    assert peak < 12 * path.stat().st_size + 3_000_000


def test_a_lack_of_memory_is_the_machines(tmp_path, history, monkeypatch):
    def fails(*_):
        raise MemoryError("Unable to allocate 9.3 TiB")

    ftforce.save(history, tmp_path / "run.npz")
    monkeypatch.setattr("ftforce.trajectory.history_files.read_npz", fails)
    with pytest.raises(MemoryError):
        ftforce.load_history(tmp_path / "run.npz")
