"""Recorded motions: what a file may look like, and what is said of those that are no use."""

import math

import numpy as np
import pytest

import ftforce
from ftforce.errors import DimensionError, FtforceError, InputError, TrajectoryError
from ftforce.trajectory.recording import Recording, Sheet
from helpers import assert_close, peak_memory, serial_urdf
from urdfs import arm, joint, load

NAN, INF = math.nan, math.inf
T = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
Q = np.array([[0.0, 0.1], [0.1, 0.12], [0.2, 0.14], [0.3, 0.16], [0.4, 0.18]])
LATER = np.array([0.0, 0.1, 0.2, 5.3, 5.4])
V = np.array([[1.0, 0.2]] * 5)


@pytest.fixture(scope="module")
def slider(tmp_path_factory):
    """Return an arm that turns at ``j1`` and slides at ``j2``."""
    urdf = serial_urdf(("revolute", {}), ("prismatic", {}))
    return load(tmp_path_factory.mktemp("slider"), urdf, tip="tool")


@pytest.fixture
def file(tmp_path):
    def write(content, name="motion.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def csv_of(header, *columns, number="{!r}", end="\n"):
    """Return a CSV file of columns."""
    rows = [",".join(number.format(float(x)) for x in row) for row in np.column_stack(columns)]
    return end.join([header, *rows, ""])


PLAIN = csv_of("t,j1,j2", T, Q)


def refused(robot, path, **options):
    """Return what is said of a file, without its path."""
    with pytest.raises(TrajectoryError) as caught:
        Recording.read(robot, path, **options)
    assert caught.value.path == str(path)
    message = str(caught.value)
    assert message.isprintable()  # one line, and nothing that a terminal would obey
    return message.removeprefix(f"{path}: ")


def test_memory_is_in_proportion_to_the_file(slider, file):
    """The text and its bytes, and a piece of it that is parsed."""
    rows = "".join(f"{0.01 * i:.2f},0.1,0.2,{'x' * 1000}\n" for i in range(15_000))
    path = file(f"t,j1,j2,remark\n{rows}")
    Recording.read(slider, path)  # what is imported counts too
    peak = peak_memory(lambda: Recording.read(slider, path))
    assert peak < 2 * path.stat().st_size + 6_000_000


# ---- what can be read ------------------------------------------------------------------------

SAME = {
    "plain": PLAIN,
    "other order": csv_of("j2,t,j1", Q[:, 1], T, Q[:, 0]),
    "degrees": csv_of("t,j1 [deg],j2", T, np.rad2deg(Q[:, 0]), Q[:, 1]),
    "units": csv_of("t [s],j1 [rad],j2[m]", T, Q),
    "blanks in the units": csv_of(" t [ s ] , j1  [ deg ],j2 ", T, np.rad2deg(Q[:, 0]), Q[:, 1]),
    "empty unit": csv_of("t,j1 [],j2", T, Q),
    "capital time": csv_of("T,j1,j2", T, Q),
    "other columns": csv_of("seq,Time [s],j2,j3,j1,v_j3", 1e3 * T, T, Q[:, 1], T, Q[:, 0], T),
    "words in other columns": PLAIN.replace("\n", ",torque\n").replace("j2,torque", "j2,mode"),
    "two clocks": csv_of("timestamp,t,j1,j2", 9.0 - T, T, Q),
    "byte order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "CRLF": PLAIN.replace("\n", "\r\n"),
    "blank lines": "\n\n" + PLAIN.replace("\n", "\n\n ,, \n  \n"),
}


@pytest.mark.parametrize("content", SAME.values(), ids=SAME)
def test_forms_of_the_same_motion(slider, file, content):
    path = file(content)
    recording = Recording.read(slider, path)
    np.testing.assert_array_equal(recording.t, T)
    assert_close(recording.q, Q, tol=1e-15)
    assert recording.v is None
    assert recording.source == str(path)
    assert recording.duration == pytest.approx(0.4)
    assert not recording.t.flags.writeable
    assert not recording.q.flags.writeable


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ("t,j1,j2,v_j1,v_j2", 1.0),
        ("t,j1,j2,v_j1 [rad/s],v_j2 [m/s]", 1.0),
        ("t,j1,j2,v_j1 [deg/s],v_j2", math.degrees(1.0)),
    ],
)
def test_velocities(slider, file, header, scale):
    path = file(csv_of(header, T, Q, V * [scale, 1.0]))
    recording = Recording.read(slider, path)
    assert_close(recording.q, Q, tol=1e-15)
    assert_close(recording.v, V, tol=1e-15)
    assert not recording.v.flags.writeable


@pytest.mark.parametrize("start", [-3.0, 1.7e9])
def test_times_count_from_anywhere(slider, file, start):
    """Recorders write seconds since 1970."""
    recording = Recording.read(slider, file(csv_of("t,j1,j2", start + T, Q)))
    assert_close(recording.t - start, T, tol=1e-5)
    assert recording.duration == pytest.approx(0.4, abs=1e-6)


def test_every_digit_counts(slider, file):
    q = np.random.default_rng(0).normal(size=(5, 2))
    np.testing.assert_array_equal(Recording.read(slider, file(csv_of("t,j1,j2", T, q))).q, q)


@pytest.mark.parametrize(
    "name", ["left.elbow", "left elbow", "a,b", "関節", "T", "v_", "elbow [deg]", "a]", "x [m] y"]
)
def test_names_of_any_kind(tmp_path, file, name):
    robot = load(tmp_path, arm(j2=joint(name, "l1", "l2")), tip="tool")
    quoted = [f'"{x}"' for x in robot.names]
    q = 0.1 * np.arange(20.0).reshape(5, 4)
    recording = Recording.read(robot, file(csv_of(",".join(["t", *quoted]), T, q)))
    assert_close(recording.q, q, tol=1e-15)
    velocities = [f'"v_{x}"' for x in robot.names]
    header = ",".join(["t", *quoted, *velocities])
    recording = Recording.read(robot, file(csv_of(header, T, q, 2.0 * q)))
    assert_close(recording.q, q, tol=1e-15)
    assert_close(recording.v, 2.0 * q, tol=1e-15)


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_recordings_of_known_robots(file, name):
    robot = ftforce.load_robot(name)
    q = np.random.default_rng(2).uniform(-0.5, 0.5, size=(5, robot.n))
    header = ",".join(["t", *(f"{joint} [deg]" for joint in robot.names)])
    recording = Recording.read(robot, file(csv_of(header, T, np.rad2deg(q))))
    assert_close(recording.q, q)


def test_gaps_up_to_ten_steps_are_bridged(slider, file):
    t = np.array([0.0, 0.1, 0.2, 1.2, 1.3])
    assert Recording.read(slider, file(csv_of("t,j1,j2", t, Q))).duration == pytest.approx(1.3)
    wide = file(csv_of("t,j1,j2", t * [1, 1, 1, 2, 2], Q))
    assert Recording.read(slider, wide, max_gap=3.0).duration == pytest.approx(2.6)


def test_samples_need_not_be_evenly_spaced(slider):
    t = np.cumsum([0.1, 0.02, 0.3, 0.05, 0.11])
    assert Recording.of(slider, t, Q).duration == pytest.approx(0.48)


# ---- arrays ----------------------------------------------------------------------------------


def test_arrays_are_copied(slider):
    t, q, v = T.copy(), Q.copy(), V.copy()
    recording = Recording.of(slider, t, q, v)
    t[:], q[:], v[:] = 9.0, 9.0, 9.0
    assert_close(recording.t, T)
    assert_close(recording.q, Q)
    assert_close(recording.v, V)
    assert recording.source == "given"
    for array in (recording.t, recording.q, recording.v):
        assert not array.flags.writeable


def test_lists_and_integers_will_do(slider):
    recording = Recording.of(slider, [0, 1, 2, 3], [[0, 0], [1, 0], [2, 0], [2, 1]])
    assert recording.q.dtype == np.float64


FOUR = "a recording needs 4 or more times, got an array of shape"
BAD_ARRAYS = {
    "no times": ({"t": []}, FOUR),
    "a number": ({"t": 1.0}, FOUR),
    "three samples": ({"t": T[:3], "q": Q[:3]}, FOUR),
    "times in a column": ({"t": T[:, None]}, FOUR),
    "times are None": ({"t": None}, "t needs numbers, got None"),
    "times are texts": ({"t": list("01234")}, "t needs numbers"),
    "times are truths": ({"t": [True] * 5}, "t needs numbers"),
    "NaN time": ({"t": [0, 1, NAN, 3, 4]}, "t contains nan at position 3"),
    "infinite time": ({"t": [0, 1, 2, 3, INF]}, "t contains inf at position 5"),
    "falling": ({"t": [0.0, 0.1, 0.05, 0.3, 0.4]}, "sample 3: the time 0.05 s comes after 0.1 s"),
    "repeated": ({"t": [0.0, 0.1, 0.1, 0.3, 0.4]}, "sample 3: the time 0.1 s appears twice; time"),
    "tiny steps": (
        {"t": 1e-300 * T},
        "sample 2: the time 1e-301 s comes after 0 s; times must incr",
    ),
    "gap": (
        {"t": LATER},
        "sample 4: a gap of 5.1 s after 0.2 s; the median step is 0.1 s, and gaps up to 1 s",
    ),
    "own gap": (
        {"t": 2.0 * np.arange(5), "max_gap": 0.5},
        "sample 2: a gap of 2 s after 0 s; the median step is 2 s, and gaps up to 0.5 s are",
    ),
    "gap 0": ({"max_gap": 0}, "the longest gap in s must be positive and finite, got 0"),
    "gap -1": ({"max_gap": -1.0}, "the longest gap in s must be positive and finite, got -1.0"),
    "gap NaN": ({"max_gap": NAN}, "the longest gap in s must be positive and finite, got nan"),
    "gap as text": ({"max_gap": "1"}, "the longest gap in s must be positive and finite, got '1'"),
    "gap as truth": ({"max_gap": True}, "the longest gap in s must be positive and finite, got Tr"),
    "no positions": ({"q": None}, "q needs numbers, got None"),
    "transposed": (
        {"q": Q.T},
        "q needs an array of shape 5 x 2, got an array of shape 2 x 5: one row per time, one colu",
    ),
    "flat": ({"q": Q.ravel()}, "q needs an array of shape 5 x 2, got 10 numbers"),
    "NaN position": ({"q": Q * NAN}, "q contains nan at position 1, 1; numbers must be finite"),
    "ragged": ({"q": [[1], [1, 2]]}, "q needs numbers"),
    "few velocities": ({"v": V[:4]}, "v needs an array of shape 5 x 2"),
    "infinite velocity": ({"v": V * INF}, "v contains inf at position 1, 1"),
}


@pytest.mark.parametrize(("change", "message"), BAD_ARRAYS.values(), ids=BAD_ARRAYS)
def test_arrays_that_cannot_be_used(slider, change, message):
    given = {"t": T, "q": Q, **change}
    with pytest.raises(InputError) as caught:
        Recording.of(slider, given.pop("t"), given.pop("q"), given.pop("v", None), **given)
    assert str(caught.value).startswith(message)


def test_a_wrong_shape_is_there_as_data(slider):
    with pytest.raises(DimensionError) as caught:
        Recording.of(slider, T, Q[:4])
    assert (caught.value.expected, caught.value.got) == ((5, 2), (4, 2))


# ---- files that cannot be used ---------------------------------------------------------------

KIND = "expected a CSV file of a trajectory (columns t and joint names, or x,y,z)"
HEADER = "expected the header t,JOINT,… or x,y,z, got"
LACKS = "a recording needs t and every joint: 1 j1, 2 j2"
BAD_FILES = {
    "unknown column": (
        csv_of("t,j1,j22", T, Q),
        f"missing columns: j2; {LACKS}; the columns are: 't', 'j1', 'j22'",
    ),
    "number as a name": (csv_of("t,1,2", T, Q), f"missing columns: j1, j2; {LACKS}"),
    "no header": (
        "\n".join(PLAIN.splitlines()[1:]),
        f"missing columns: t, j1, j2; {LACKS}; the columns are: '0.0', '0.0', '0.1'",
    ),
    "no time": (csv_of("j1,j2", Q), f"missing columns: t; {LACKS}"),
    "joint missing": (csv_of("t,j2", T, T), f"missing columns: j1; {LACKS}"),
    "joints missing": (csv_of("t", T), f"{HEADER} 't'; cells"),
    "column twice": (csv_of("t,j1,j2,j1", T, Q, T), "column 'j1' appears twice"),
    "time twice": (csv_of("t,t,j1,j2", T, T, Q), "column 't' appears twice"),
    "velocity of one": (
        csv_of("t,j1,j2,v_j1", T, Q, T),
        "contains velocities of some joints only; give those of all joints or of none",
    ),
    "minutes": (
        csv_of("t [min],j1,j2", T, Q),
        "column 't [min]': unknown unit; use s or ms or us or µs or ns",
    ),
    "unknown unit": (
        csv_of("t,j1 [gon],j2", T, Q),
        "column 'j1 [gon]': unknown unit; use rad or deg",
    ),
    "turned slider": (csv_of("t,j1,j2 [rad]", T, Q), "column 'j2 [rad]': unknown unit; use m"),
    "velocity as angle": (
        csv_of("t,j1,j2,v_j1 [deg],v_j2", T, Q, V),
        "column 'v_j1 [deg]': unknown unit; use rad/s or deg/s",
    ),
    "empty cell": (
        PLAIN.replace("0.1,0.1,0.12", "0.1,,0.12"),
        "line 3, 'j1': empty cell; every row needs a value for every joint",
    ),
    "too large": (
        PLAIN.replace("0.12", "1e300"),
        "line 3, 'j2': '1e300' is too large; the maximum",
    ),
    "text": (PLAIN.replace("0.12", "far"), "line 3, 'j2': 'far' is not a number"),
    "short line": (PLAIN.replace("0.1,0.1,0.12", "0.1,0.1"), "line 3: expected 3 cells, got 2"),
    "lines cut off": (PLAIN[:-6], "line 6: expected 3 cells, got 2"),
    "falling": (
        csv_of("t,j1,j2", T[[0, 2, 1, 3, 4]], Q),
        "line 4: the time 0.1 s comes after 0.2 s; times must increase",
    ),
    "repeated": (
        csv_of("t,j1,j2", T[[0, 1, 2, 2, 3]], Q),
        "line 5: the time 0.2 s appears twice; times must increase",
    ),
    "repeated, since 1970": (
        csv_of("t,j1,j2", 1.7e9 + T[[0, 1, 2, 2, 3]], Q),
        "line 5: the time 1700000000.2 s appears twice",
    ),
    "gap": (
        csv_of("t,j1,j2", LATER, Q),
        "line 5: a gap of 5.1 s after 0.2 s; the median step is 0.1 s",
    ),
    "gap behind blank lines": (
        "\n" + csv_of("t,j1,j2", LATER, Q, end="\n\n"),
        "line 10: a gap of 5.1 s",
    ),
    "three samples": (csv_of("t,j1,j2", T[:3], Q[:3]), "a recording needs 4 or more samples, got"),
    "two lacking": (csv_of("t,v_j1", T, T), f"missing columns: j1, j2; {LACKS}"),
    "header only": ("t,j1,j2\n", "expected a header followed by rows of numbers"),
    "empty": ("", f"is empty; {KIND}"),
    "commas": (",,\n,,\n", "expected a header followed by rows of numbers"),
    "line break in the header": (
        csv_of('t,"j\n1",j2', T, Q),
        f"missing columns: j1; {LACKS}; the columns are: 't', 'j\\n1', 'j2'",
    ),
    "line break in a cell": (
        PLAIN.replace("0.12", '"0\n1"'),
        "line 4, 'j2': '0\\n1': expected 1 number, got 2",
    ),
    "escapes in the header": (
        csv_of("t,j1,j2,\x1b[31m", T, Q, T).replace("0.12", "red"),
        "line 3, 'j2': 'red' is not a number",
    ),
    "escapes": (
        csv_of("t,j1,\x1b[31m", T, Q),
        f"missing columns: j2; {LACKS}; the columns are: 't', 'j1', '\\x1b[31m'",
    ),
    "comment below": (PLAIN + "# mine\n", "line 7: expected 3 cells, got 1"),
}


@pytest.mark.parametrize(("content", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_files_that_cannot_be_used(slider, file, content, message):
    assert refused(slider, file(content)).startswith(message)


def test_a_gap_of_ones_own_in_a_file(slider, file):
    assert "gaps up to 0.05 s are interpolated" in refused(slider, file(PLAIN), max_gap=0.05)


@pytest.mark.parametrize("max_gap", [0, NAN, "1", True])
def test_a_longest_gap_that_is_none(slider, file, max_gap):
    with pytest.raises(FtforceError, match="the longest gap in s must be positive and finite, got"):
        Recording.read(slider, file(PLAIN), max_gap=max_gap)


def test_paths_that_are_no_files(slider, tmp_path):
    (tmp_path / "folder.csv").mkdir()
    assert refused(slider, tmp_path / "none.csv").startswith(f"no such file; {KIND}")
    assert refused(slider, tmp_path / "folder.csv").startswith(f"is a folder; {KIND}")


def test_a_long_header_is_read_quickly(slider, file):
    """Blanks inside a name cost no more than others."""
    assert "missing columns: j2" in refused(slider, file(f"t,j1,a{' ' * 50_000}[b\n0,0,0\n"))


# ---- waypoints -------------------------------------------------------------------------------

POINTS = np.array([[0.1, 0.2, 0.3], [1.0, 2.0, 3.0], [-1.0, 0.0, 0.5]])


@pytest.mark.parametrize("header", ["x,y,z", "X, Y ,Z", "x [m],y [m],z[m]"])
def test_waypoints(file, header):
    sheet = Sheet.read(file(csv_of(header, POINTS)))
    assert sheet.holds_points
    assert_close(sheet.points(), POINTS)


def test_waypoints_in_another_order(file):
    sheet = Sheet.read(file(csv_of("z,x,y", POINTS[:, [2, 0, 1]])))
    assert sheet.holds_points
    assert_close(sheet.points(), POINTS)


@pytest.mark.parametrize("header", ["t,x,y,z", "x,y", "x,y,z,w", "x,y,y", "t,j1,j2"])
def test_what_holds_no_waypoints(file, header):
    values = np.zeros((3, header.count(",") + 1))
    assert not Sheet.read(file(csv_of(header, values))).holds_points


@pytest.mark.parametrize("unit", ["mm", "deg", "s"])
def test_waypoints_are_in_metres(file, unit):
    path = file(csv_of(f"x,y [{unit}],z", POINTS))
    with pytest.raises(TrajectoryError) as caught:
        Sheet.read(path).points()
    assert str(caught.value) == f"{path}: column 'y [{unit}]': waypoints must be in m"


def test_a_file_of_waypoints_is_no_recording(slider, file):
    assert refused(slider, file(csv_of("x,y,z", POINTS))).startswith("missing columns: t, j1, j2;")


def test_velocities_that_do_not_fit_are_doubtful():
    dh5 = ftforce.load_robot("dh5")
    t = np.linspace(0.0, 2.0, 41)
    q = np.outer(np.sin(t), [0.3, 0.2, 0.0, -0.4, 0.1])
    v = np.outer(np.cos(t), [0.3, 0.2, 0.0, -0.4, 0.1])
    assert not list(Recording.of(dh5, t, q, v).warnings(dh5.names))
    assert not list(Recording.of(dh5, t, q).warnings(dh5.names))
    noisy = v * (1.0 + np.random.default_rng(1).normal(0.0, 0.05, v.shape))
    assert not list(Recording.of(dh5, t, q, noisy).warnings(dh5.names))
    wrong = v.copy()
    wrong[:, 3] = np.rad2deg(v[:, 3])  # deg/s for rad/s
    (found,) = Recording.of(dh5, t, q, wrong).warnings(dh5.names)
    assert found.startswith("the recorded velocities of joint4 do not match its positions")
    off = np.abs(np.rad2deg(q[:, 3]) - q[:, 3]).max()
    assert float(found.split("is off by ")[1].split(";")[0]) == pytest.approx(off, rel=2e-2)


# ---- numbered columns ------------------------------------------------------------------------

RTDE = "timestamp,target_q_0,target_q_1,actual_q_1,actual_q_0,actual_qd_0,joint_mode_0,joint_mode_1"


@pytest.fixture(scope="module")
def arm_of_two(tmp_path_factory):
    """Return an arm that turns at ``j1`` and at ``j2``."""
    urdf = serial_urdf(("revolute", {}), ("revolute", {}))
    return load(tmp_path_factory.mktemp("two"), urdf, tip="tool")


NUMBERED = {
    "RTDE": (RTDE, 4, 3),
    "q1 q2": ("t,q1,q2,qd1,qd2,a,b,c", 1, 2),
    "units": ("t,J1 [deg],J2 [deg],x,y,z,a,b", 1, 2),
    "position0": ("t,name0,name1,position0,position1,velocity0,velocity1,x", 3, 4),
}


@pytest.mark.parametrize(("header", "first", "second"), NUMBERED.values(), ids=NUMBERED)
def test_numbered_columns_are_the_joints_in_their_order(
    arm_of_two, tmp_path, header, first, second
):
    rows = np.random.default_rng(0).uniform(0.0, 0.5, (5, 8))
    rows[:, 0] = np.arange(5) / 10.0
    path = tmp_path / "motion.csv"
    path.write_text("\n".join([header, *(",".join(map(repr, row.tolist())) for row in rows)]))
    recording = Recording.read(arm_of_two, path)
    scale = np.pi / 180.0 if "[deg]" in header else 1.0
    assert_close(recording.q, scale * rows[:, [first, second]])
    cells = header.split(",")
    (note,) = recording.notes
    names = [cells[i].partition(" [")[0] for i in (first, second)]
    assert f"columns '{cells[first]}' to '{cells[second]}' are taken for the joints 1 to 2" in note
    assert not any(f"{name}'" in note.partition("ignored")[2] for name in names)


@pytest.mark.parametrize(
    "header",
    ["t,q1,q2,q3", "t,q1,q3,x", "t,target_q_0,target_q_1,x", "t,q1,q2,p,J1,J2",
     "t,1,2,x", "t,j1,q1,q2", "t,qd1,qd2,x"],
)  # fmt: skip
def test_numbers_that_do_not_say_which_joint_are_not_taken(arm_of_two, tmp_path, header):
    """Too many, a gap, wishes, two groups, other quantities, or a name of a joint beside them."""
    text = f"{header}\n" + "0.1,0.2\n" * 4
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match="missing columns"):
        Recording.read(arm_of_two, path)


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_units_of_time(slider, file, unit, scale):
    found = Recording.read(slider, file(csv_of(f"time [{unit}],j1,j2", T / scale, Q)))
    assert_close(found.t, T)
    assert_close(found.q, Q)


def test_times_that_count_are_asked_about(slider, file):
    """A recorder's milliseconds 0, 1, 2, … were seconds, and all torques those of the weight."""
    count = np.arange(5.0)
    (note,) = Recording.read(slider, file(csv_of("t,j1,j2", count, 0.1 * Q))).notes
    assert "write t [ms]" in note
    for plain in (csv_of("t [ms],j1,j2", count, Q), PLAIN, csv_of("t,j1,j2", 2.0 * count, 0.1 * Q)):
        assert not Recording.read(slider, file(plain)).notes
