"""Postures in files: what pandas, pyarrow and NumPy write is read back to the last bit."""

import builtins
import hashlib
import json
import math
import os
import pickle
import tracemalloc

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftforce.batch.postures import csv
from ftforce.batch.postures.files import postures_from_file
from ftforce.errors import FtforceError, InputError, TrajectoryError
from ftforce.io import csv_table
from helpers import campaign, load_text, serial_urdf

NAN, INF = math.nan, math.inf
Q = np.array([[0.1, 0.2], [1 / 3, -0.25], [-2.5, 0.125], [1e-300, 7.0]])
DEGREES = [math.radians(1.0), 1.0]


@pytest.fixture(scope="module")
def arm():
    """Return an arm that turns at ``j1`` and slides at ``j2``."""
    return load_text(serial_urdf(("revolute", {}), ("prismatic", {})))


@pytest.fixture
def file(tmp_path):
    def write(content, name="fleet.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def small_pieces(monkeypatch):
    monkeypatch.setattr(csv, "PIECE", 64)


def refused(arm, path, **options):
    """Return what is said of a file, without its path."""
    with pytest.raises(TrajectoryError) as caught:
        postures_from_file(arm, path, **options)
    message = str(caught.value)
    assert message.isprintable()  # one line, and nothing that a terminal would obey
    return message.removeprefix(f"{path}: ")


def text_of(q, header="j1,j2", end="\n"):
    rows = [",".join(map(repr, row)) for row in q.tolist()]
    return end.join([header, *rows, ""])


def written(folder, form, q):
    """Write postures as others do."""
    path = folder / f"fleet.{form}"
    table = pd.DataFrame(
        {"time": np.arange(len(q)), "j2": q[:, 1], "mode": "idle,\n"[:4], "j1": q[:, 0]}
    )
    if form == "npy":
        np.save(path, q)
    elif form == "csv":
        table.to_csv(path)  # with pandas' index
    else:
        table.to_parquet(path, row_group_size=max(37, len(q) // 20))
    return path


def written_for(robot, folder, form, count):
    """Write random postures of a robot, and return the file."""
    path = folder / f"postures.{form}"
    q = np.random.default_rng(count).uniform(-1.0, 1.0, (count, robot.n))
    table = pd.DataFrame(dict(zip(robot.names, q.T, strict=True)))
    if form == "npy":
        np.save(path, q)
    elif form == "csv":
        table.to_csv(path, index=False)
    else:
        table.to_parquet(path, row_group_size=16)
    return path


FORMS = ["npy", "csv", "parquet"]


# ---- what all formats have in common ---------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=campaign(50, 10))
@given(data=st.data())
def test_blocks_are_parts_of_the_whole(arm, tmp_path_factory, form, data):
    rows = data.draw(st.integers(1, 300))
    q = np.random.default_rng(rows).normal(size=(rows, 2))
    folder = tmp_path_factory.mktemp("any")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv, "PIECE", data.draw(st.integers(60, 5000)))
        postures = postures_from_file(arm, written(folder, form, q))
        assert (postures.count, postures.n) == (rows, 2)
        for _ in range(3):
            stop = data.draw(st.integers(0, rows))
            start = data.draw(st.integers(0, stop))
            block = postures.block(start, stop)
            np.testing.assert_array_equal(block, q[start:stop])
            assert block.shape == (stop - start, 2)
            assert block.dtype == np.float64
            assert block.flags.c_contiguous
            assert block.flags.writeable


@pytest.mark.parametrize("form", FORMS)
def test_workers_read_from_elsewhere(arm, tmp_path, form, monkeypatch):
    written(tmp_path, form, Q)
    monkeypatch.chdir(tmp_path)
    postures = postures_from_file(arm, f"fleet.{form}")
    other = pickle.loads(pickle.dumps(postures))
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(other.block(1, 3), Q[1:3])
    assert other.identity() == postures.identity()
    assert str(other) == f"4 postures from fleet.{form}"


@pytest.mark.parametrize("form", FORMS)
def test_identity_is_the_contents(arm, tmp_path, form):
    places = [tmp_path / name for name in "abc"]
    for place in places:
        place.mkdir()
    one, two = (written(place, form, Q) for place in places[:2])
    other = written(places[2], form, Q[::-1])
    identity = postures_from_file(arm, one).identity()
    assert identity["sha256"] == hashlib.sha256(one.read_bytes()).hexdigest()
    assert identity["bytes"] == one.stat().st_size
    assert identity["name"] == f"fleet.{form}"
    assert str(tmp_path) not in json.dumps(identity)
    assert json.loads(json.dumps(identity)) == postures_from_file(arm, two).identity()
    assert postures_from_file(arm, other).identity() != identity
    assert postures_from_file(arm, one, degrees=True).identity() != identity


@pytest.mark.parametrize("form", FORMS)
def test_degrees(arm, tmp_path, form):
    postures = postures_from_file(arm, written(tmp_path, form, Q), degrees=True)
    np.testing.assert_array_equal(postures.block(0, 4), Q * DEGREES)


@pytest.mark.parametrize("form", FORMS)
def test_postures_beyond_the_limits_are_kept(arm, tmp_path, form):
    q = Q + 100.0
    postures = postures_from_file(arm, written(tmp_path, form, q))
    np.testing.assert_array_equal(postures.block(0, 4), q)


@pytest.mark.thorough
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("value", [NAN, INF, -INF, 1.1e9])
def test_numbers_that_are_none(arm, tmp_path, form, value):
    q = np.random.default_rng(0).normal(size=(20_000, 2))
    q[15_001, 1] = value
    message = refused(arm, written(tmp_path, form, q))
    where = "line 15003, 'j2': " if form == "csv" else "row 15002, joint j2: "
    assert message.startswith(where)


@pytest.mark.parametrize("form", FORMS)
def test_files_that_change(arm, tmp_path, form):
    path = written(tmp_path, form, Q)
    postures = postures_from_file(arm, path)
    before = path.stat()
    path.write_bytes(path.read_bytes() + b"\n")
    with pytest.raises(
        TrajectoryError, match=r"has changed since it was opened \([\d,]+ bytes instead of"
    ):
        postures.block(0, 2)
    written(tmp_path, form, Q)
    os.utime(path, ns=(0, before.st_mtime_ns + 1))
    with pytest.raises(TrajectoryError, match=r"it was rewritten\); open it again"):
        postures.block(0, 2)
    os.utime(path, ns=(0, before.st_mtime_ns))
    np.testing.assert_array_equal(postures.block(0, 2), Q[:2])
    path.unlink()
    with pytest.raises(TrajectoryError, match=r"cannot be read \(No such file"):
        postures.block(0, 2)


@pytest.mark.parametrize("form", FORMS)
def test_files_that_are_cut_short_in_secret(arm, tmp_path, form):
    """Size and time are those of before: some file systems lie, for a while."""
    path = written(tmp_path, form, np.random.default_rng(0).normal(size=(1000, 2)))
    postures = postures_from_file(arm, path)
    path.write_bytes(path.read_bytes()[:300])
    object.__setattr__(postures, "stamp", type(postures.stamp).of(str(path)))
    with pytest.raises(TrajectoryError):
        postures.block(900, 1000)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("block", [(-1, 3), (3, 2), (0, 5)])
def test_blocks_beyond(arm, tmp_path, form, block):
    with pytest.raises(InputError, match="is outside the range 0 to 4"):
        postures_from_file(arm, written(tmp_path, form, Q)).block(*block)


@pytest.mark.thorough
@pytest.mark.parametrize("form", FORMS)
def test_memory_is_bounded(arm, tmp_path, form, monkeypatch):
    """Opening and reading take far less than the 16 MB of the numbers."""
    monkeypatch.setattr(csv, "PIECE", 1 << 14)
    rows = 1_000_000 if form != "csv" else 60_000
    q = np.zeros((rows, 2))
    path = written(tmp_path, form, q)
    small = postures_from_file(arm, written(tmp_path, form, q))
    tracemalloc.start()
    try:
        postures_from_file(arm, path)
        small.block(rows // 2, rows // 2 + 100)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < (8e6 if form != "csv" else 0.7 * q.nbytes)


# ---- files that are no use -------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_files_that_are_missing_or_empty(arm, tmp_path, form):
    path = tmp_path / f"fleet.{form}"
    assert refused(arm, path).startswith("no such file; expected a posture file (.npy, .csv")
    path.touch()
    assert refused(arm, path).startswith("is empty; expected a posture file")
    path.unlink()
    path.mkdir()
    assert refused(arm, path).startswith("is a folder; expected a posture file")
    path.rmdir()
    os.mkfifo(path)
    assert refused(arm, path).startswith("is not a regular file")


@pytest.mark.parametrize("form", FORMS)
def test_files_that_are_something_else(arm, file, form):
    noise = np.random.default_rng(0).bytes(5000)
    assert refused(arm, file(noise, f"fleet.{form}"))
    assert refused(arm, file(b"PK\x03\x04" + bytes(50), f"zip.{form}"))
    assert refused(arm, file(b"\x93NUMPY", f"cut.{form}"))
    assert refused(arm, file(b"PAR1", f"short.{form}"))
    assert refused(arm, file("<html>\n<body>\n", f"page.{form}"))


@pytest.mark.parametrize("form", FORMS)
def test_files_that_may_not_be_read(arm, tmp_path, form, monkeypatch):
    path = written(tmp_path, form, Q)

    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    for place in ("pathlib.Path.open", "builtins.open", "pyarrow.parquet.ParquetFile"):
        monkeypatch.setattr(place, denied)
    assert refused(arm, path) == "cannot be read (Permission denied)"


@pytest.mark.parametrize("name", ["fleet.txt", "fleet", "", "fleet.npz", "fleet.csv.gz"])
def test_names_that_end_otherwise(arm, name):
    with pytest.raises(
        InputError,
        match=r"unknown file extension; expected a posture file \(\.npy, \.csv or \.parquet, or",
    ):
        postures_from_file(arm, name)


# ---- NPY -------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<f2", "<i4", ">i8", "u1", np.longdouble])
@pytest.mark.parametrize("layout", ["C", "F"])
def test_arrays_of_any_kind(arm, tmp_path, dtype, layout):
    q = np.arange(60).reshape(30, 2).astype(dtype, order=layout)
    np.save(tmp_path / "fleet.npy", q)
    postures = postures_from_file(arm, tmp_path / "fleet.npy")
    np.testing.assert_array_equal(postures.block(3, 29), q[3:29].astype(float))
    assert postures.block(3, 29).flags.c_contiguous


def test_numbers_that_only_a_long_double_holds(arm, tmp_path):
    q = np.full((3, 2), np.longdouble(2.0) ** 2000)
    np.save(tmp_path / "fleet.npy", q)
    assert refused(arm, tmp_path / "fleet.npy").startswith("row 1, joint j1: invalid position inf")


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_versions_of_the_format(arm, tmp_path, version):
    with (tmp_path / "fleet.npy").open("wb") as stream:
        np.lib.format.write_array(stream, Q, version)
    np.testing.assert_array_equal(postures_from_file(arm, tmp_path / "fleet.npy").block(0, 4), Q)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros(2), "got shape (2,)"),
        (np.zeros((5, 3)), "expected an array of shape (k, 2), one row per posture and one column"),
        (np.zeros((0, 2)), ""),
        (np.zeros((5, 2, 1)), "got shape (5, 2, 1)"),
        (np.zeros((5, 2), complex), "expected an array of real numbers, got dtype complex128"),
        (np.zeros((5, 2), bool), "expected an array of real numbers, got dtype bool"),
        (np.array([["a", "b"]]), "expected an array of real numbers, got dtype <U1"),
        (np.array([[None, 1]]), ""),
    ],
)
def test_arrays_that_are_no_postures(arm, tmp_path, array, message):
    np.save(tmp_path / "fleet.npy", array)
    assert message in refused(arm, tmp_path / "fleet.npy")


def test_arrays_that_end_early(arm, tmp_path):
    path = written(tmp_path, "npy", Q)
    path.write_bytes(path.read_bytes()[:-1])
    assert "damaged" in refused(arm, path)


# ---- CSV -------------------------------------------------------------------------------------

PLAIN = text_of(Q)
SAME = {
    "plain": PLAIN,
    "mixed up": text_of(Q[:, ::-1], "j2,j1"),
    "others": text_of(np.c_[Q, Q, Q], "t,v_j1,j1,j2,x [mm],note"),
    "texts": "j1,name,j2\n" + "".join(f"{a!r},é_x,{b!r}\n" for a, b in Q.tolist()),
    "units": text_of(Q, "j1 [rad],j2[m]"),
    "byte order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "CRLF": PLAIN.replace("\n", "\r\n"),
    "CR": PLAIN.replace("\n", "\r"),
    "quoted commas": 'a,j1,j2\n"x, ""y""",' + PLAIN[6:].rstrip().replace("\n", '\n"2,3",'),
    "blank lines": "\n\n" + PLAIN.replace("\n", "\n\n , \n  \n"),
    "no line break at the end": PLAIN.rstrip("\n"),
}


@pytest.mark.parametrize("piece", [64, 71, 1 << 18])
@pytest.mark.parametrize("content", SAME.values(), ids=SAME)
def test_forms_of_the_same_postures(arm, file, content, piece, monkeypatch):
    monkeypatch.setattr(csv, "PIECE", piece)
    postures = postures_from_file(arm, file(content))
    assert postures.count == 4
    for start in range(4):
        np.testing.assert_array_equal(postures.block(start, 4), Q[start:])


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_are_counted_across_pieces(arm, file, small_pieces, end):
    for row in range(0, 200, 7):
        content = text_of(np.zeros((200, 2)), end=end).split(end)
        content[row + 1] = "0.0,oops"
        message = refused(arm, file(end.join(content)))
        assert message == f"line {row + 2}, 'j2': 'oops' is not a number"


def test_line_ends_that_a_piece_would_cut_in_two(arm, file, small_pieces):
    content = "j1,j2\r\n" + "0," + "0" * 61 + "\r\n" + "0,oops\r\n"
    assert refused(arm, file(content)) == "line 3, 'j2': 'oops' is not a number"


def test_units_count_more_than_the_option(arm, file):
    path = file(text_of(Q, "j1 [rad],j2"))
    np.testing.assert_array_equal(postures_from_file(arm, path, degrees=True).block(0, 4), Q)
    path = file(text_of(Q, "j1 [deg],j2"))
    np.testing.assert_array_equal(postures_from_file(arm, path).block(0, 4), Q * DEGREES)


@pytest.mark.parametrize("name", ["elbow [deg]", "a,b", "left.elbow", "関節", "x [m] y"])
def test_any_name_of_a_joint(file, tmp_path, name):
    urdf = serial_urdf(("revolute", {}), ("prismatic", {})).replace('"j1"', f'"{name}"')
    arm = load_text(urdf)
    table = pd.DataFrame({name: Q[:, 0], "j2": Q[:, 1], f"{name}.x": 1.0})
    table.to_csv(tmp_path / "fleet.csv", index=False)
    table.to_parquet(tmp_path / "fleet.parquet")
    for form in ("csv", "parquet"):
        postures = postures_from_file(arm, tmp_path / f"fleet.{form}", degrees=False)
        np.testing.assert_array_equal(postures.block(0, 4), Q)


@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=5))
def test_every_digit_counts(arm, tmp_path_factory, numbers):
    q = np.array([numbers, numbers[::-1]]).T
    path = tmp_path_factory.mktemp("digits") / "fleet.csv"
    path.write_text(text_of(q))
    got = postures_from_file(arm, path).block(0, len(q))
    np.testing.assert_array_equal(got, q)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("\n \n", "has no header with the joint names"),
        ("j1,j2\n", "has a header but no postures"),
        ("0.1,0.2\n3,4\n", "missing columns: j1, j2; expected one column per joint, with its name"),
        ("0.1,0.2\n3,4\n", "with its name; columns found: 0.1, 0.2"),
        ("t,j1,J2\n1,2,3\n", "missing column: j2; expected one column per joint, with its name"),
        ("j1,j2 [mm]\n1,2\n", "column 'j2 [mm]': unknown unit; use m"),
        ("j1,j2\n1,2\n\n3,4,5\n", "line 4: expected 2 cells, got 3"),
        ("j1,j2\n1,2\n2e9,2\n", "line 3, 'j1': '2e9' is too large"),
        ('j1,a,j2\n1,"two\nlines",2\n', "line 2: a cell continues on the next line"),
        ('"j1,j2\n1,2\n', "line 1: not valid CSV"),
        (b"j1,j2\n1,2\n\xff,3\n", "is not UTF-8 text"),
        ("j1,j2\n1,2\n\0,3\n", "contains binary data"),
        ("j1,j2\n" + "1" * 300_000 + ",2\n" * 2, "line 2: not valid CSV"),
        ("j1,j2\n" + "1," * 300_000, "has a line longer than 262,144 bytes"),
        ("x," * 200_000, "has no header"),
    ],
)
def test_csv_files_that_are_no_use(arm, file, content, message):
    assert message in refused(arm, file(content))


def test_many_columns_are_cut_short(arm, file):
    header = ",".join(f"sensor_{i}" for i in range(500))
    assert "sensor_23, … and 476 more" in refused(arm, file(f"{header}\n"))


def test_one_joint(tmp_path):
    arm = load_text(serial_urdf(("revolute", {})))
    pd.DataFrame({"j1": Q[:, 0]}).to_csv(tmp_path / "fleet.csv", index=False)
    postures = postures_from_file(arm, tmp_path / "fleet.csv")
    np.testing.assert_array_equal(postures.block(1, 4), Q[1:, :1])


def test_a_block_reads_its_own_part(arm, tmp_path, monkeypatch, small_pieces):
    q = np.random.default_rng(0).normal(size=(3000, 2))
    postures = postures_from_file(arm, written(tmp_path, "csv", q))
    parsed = []
    real = csv_table.Table.numbers

    def numbers(table, *options):
        parsed.append(len(table.text))
        return real(table, *options)

    monkeypatch.setattr(csv_table.Table, "numbers", numbers)
    np.testing.assert_array_equal(postures.block(2000, 2003), q[2000:2003])
    assert sum(parsed) < 500


# ---- Parquet ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [pa.float32(), pa.float16(), pa.int8(), pa.uint64()])
def test_numbers_of_any_type(arm, tmp_path, kind):
    column = pa.array(range(10)).cast(kind)
    pq.write_table(pa.table({"j2": column, "j1 [deg]": column}), tmp_path / "fleet.parquet")
    got = postures_from_file(arm, tmp_path / "fleet.parquet").block(2, 9)
    np.testing.assert_array_equal(got, np.arange(2.0, 9.0)[:, None] * DEGREES)


def test_empty_cells(arm, tmp_path):
    table = pa.table({"j1": [1.0, 2.0, None], "j2": [1, 2, 3]})
    pq.write_table(table, tmp_path / "fleet.parquet")
    assert refused(arm, tmp_path / "fleet.parquet").startswith(
        "row 3, joint j1: invalid position nan; expected a finite number"
    )


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"j1": [1.0], "x": [2.0]},
            "missing column: j2; expected one column per joint, with its name",
        ),
        ({"j1": [1.0], "j2": ["2"]}, "column 'j2' must be numeric, got type string"),
        ({"j1": [1.0], "j2": [[2.0]]}, "column 'j2' must be numeric, got type list"),
        ({"j1": [True], "j2": [2.0]}, "column 'j1' must be numeric, got type bool"),
        (
            {"j1": pa.array([], pa.float64()), "j2": pa.array([], pa.float64())},
            "contains no postures",
        ),
    ],
)
def test_tables_that_are_no_postures(arm, tmp_path, table, message):
    pq.write_table(pa.table(table), tmp_path / "fleet.parquet")
    assert message in refused(arm, tmp_path / "fleet.parquet")


def test_damaged_parquet(arm, tmp_path):
    path = written(tmp_path, "parquet", Q)
    path.write_bytes(path.read_bytes()[:-20])
    assert "is damaged or not a posture file" in refused(arm, path)


def test_parquet_without_pyarrow(arm, tmp_path, monkeypatch):
    path = written(tmp_path, "parquet", Q)
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(FtforceError, match=r"pip install 'ftforce\[parquet\]'") as caught:
        postures_from_file(arm, path)
    assert not isinstance(caught.value, TrajectoryError)
