"""What a caller gives, and what the arm then follows: paths, recordings, files, rates."""

import math

import numpy as np
import pytest

import ftforce
from ftforce.errors import FtforceError, InputError, TrajectoryError
from ftforce.robot.posture import Posture
from ftforce.trajectory.reference import PathReference, RecordedReference
from ftforce.trajectory.start import MAX_SAMPLES, Path, Recording, start_of, tip_at
from helpers import assert_close

NAN, INF = math.nan, math.inf
POINTS = [(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)]
LENGTH = math.dist(*POINTS)
T = 1.875 * LENGTH / 0.05  # s


@pytest.fixture
def path():
    return Path.through(POINTS, speed=0.05)


@pytest.fixture
def recording(dh5):
    t = 3.0 + np.linspace(0.0, 2.0, 21)
    return Recording.of(dh5, t, 0.3 + 0.1 * np.outer(t, np.arange(5)))


@pytest.fixture
def file(tmp_path):
    def write(content, name="trajectory.csv"):
        place = tmp_path / name
        place.write_text(content)
        return place

    return write


WAYPOINTS = "x,y,z\n0.9,0.3,0.2\n0.8,0.4,0.25\n"


def csv_of(robot, recording):
    rows = [f"t,{','.join(robot.names)}"]
    rows += [",".join(map(repr, [t, *q])) for t, q in zip(
        recording.t.tolist(), recording.q.tolist(), strict=True)]  # fmt: skip
    return "\n".join(rows)


# ---- paths -----------------------------------------------------------------------------------


def test_a_path(dh5, path):
    start = start_of(dh5, path)
    assert isinstance(start.reference, PathReference)
    assert_close(tip_at(dh5, start.q, None), POINTS[0], tol=1e-9)
    assert start.words == "(0.9, 0.3, 0.2) → (0.8, 0.4, 0.25) m, at most 0.05 m/s, 5.625 s"
    assert "with the tip at the start of the path" in start.source
    assert start.reference.duration == pytest.approx(T)
    assert_close(start.reference.at(1.0).x, path.at(1.0)[0])
    assert_close(start.reference.at(1.0).x_dot, path.at(1.0)[1])
    assert start.reference.orientation is None
    assert start.reference.top_speed == 0.05
    assert not start.q.flags.writeable
    assert not start.times.flags.writeable


def test_the_posture_that_a_path_starts_near_is_named(dh5, path):
    near = start_of(dh5, path).q
    assert start_of(dh5, path, near).source == "given"
    again = start_of(dh5, path, Posture(near, "mine"))
    assert_close(again.q, near)
    assert again.source == "mine"
    assert start_of(dh5, path, posture="paper").source.startswith("from posture 'paper', with")


def test_an_orientation_that_is_kept(dh5):
    kept = Path.through(POINTS, speed=0.05, keep_orientation=True)
    start = start_of(dh5, kept)
    R = ftforce.robot.kinematics.tip_pose(dh5, start.q)[0]
    assert_close(start.reference.orientation, R)
    assert start.words.endswith("5.625 s, orientation kept")
    # Later postures leave it alone.
    before = start.reference.orientation.copy()
    ftforce.robot.kinematics.tip_pose(dh5, np.zeros(5))
    assert_close(start.reference.orientation, before)


@pytest.mark.parametrize("rate", [1, 3.7, 50, None, np.float32(10), np.int64(20)])
def test_samples_of_a_path_are_even_and_cover_it(dh5, path, rate):
    times = start_of(dh5, path, rate=rate).times
    step = 1.0 / (100.0 if rate is None else float(rate))
    assert times[0] == 0.0
    assert_close(np.diff(times), np.full(len(times) - 1, step), tol=1e-9)
    assert T - 1e-9 <= times[-1] < T + step


def test_a_rate_that_divides_the_duration(dh5):
    whole = Path.through([(0.9, 0.3, 0.2), (0.8, 0.3, 0.2)], speed=0.1875)  # 1 s
    assert len(start_of(dh5, whole, rate=10).times) == 11


# ---- recordings ------------------------------------------------------------------------------


def test_a_recording(dh5, recording):
    start = start_of(dh5, recording)
    assert isinstance(start.reference, RecordedReference)
    assert_close(start.times, recording.t - 3.0)
    assert_close(start.q, recording.q[0])
    assert start.words == "a recorded motion of 2 s"
    assert start.source == "recorded"
    for i in (0, 7, 20):
        assert_close(start.reference.at(start.times[i]).x, tip_at(dh5, recording.q[i], None))


@pytest.mark.parametrize(("rate", "count"), [(10, 21), (3.0, 7), (100, 201), (0.5, 2)])
def test_samples_of_a_recording_at_another_rate(dh5, recording, rate, count):
    times = start_of(dh5, recording, rate=rate).times
    assert len(times) == count
    assert_close(times, np.arange(count) / rate)
    assert times[-1] <= 2.0 + 1e-9


def test_the_speed_of_a_recorded_tip_by_differences(dh5, recording):
    reference, h = start_of(dh5, recording).reference, 1e-6
    fastest = 0.0
    for t in np.linspace(0.1, 1.9, 19):
        quotient = (reference.at(t + h).x - reference.at(t - h).x) / (2.0 * h)
        assert_close(reference.at(t).x_dot, quotient, scale=1.0, tol=1e-7)
        fastest = max(fastest, np.linalg.norm(quotient))
    assert fastest <= reference.top_speed * (1.0 + 1e-6)


# ---- files -----------------------------------------------------------------------------------


def test_a_file_of_waypoints(dh5, file, path):
    start, wanted = start_of(dh5, file(WAYPOINTS), speed=0.05), start_of(dh5, path)
    assert start.words == wanted.words
    assert_close(start.q, wanted.q)
    assert start_of(dh5, str(file(WAYPOINTS)), speed=0.05).words == wanted.words
    kept = start_of(dh5, file(WAYPOINTS), speed=0.05, keep_orientation=True)
    assert kept.reference.orientation is not None


def test_a_file_of_a_recording(dh5, file, recording):
    place = file(csv_of(dh5, recording))
    start = start_of(dh5, place)
    assert_close(start.times, recording.t - 3.0, tol=1e-12)
    assert start.words == f"the recorded motion of {place}, 2 s"
    assert_close(start.reference.motion(start.times).q, recording.q)


def test_a_gap_that_is_allowed(dh5, file, recording):
    text = csv_of(dh5, recording)
    gap = file("\n".join(line for i, line in enumerate(text.splitlines()) if not 3 < i < 16))
    with pytest.raises(TrajectoryError, match=r"line 5: a gap of 1\.3 s after 3\.2 s"):
        start_of(dh5, gap)
    assert len(start_of(dh5, gap, max_gap=1.5).times) == 9


# ---- bad input -------------------------------------------------------------------------------


def test_waypoints_need_a_speed(dh5, file):
    place = file(WAYPOINTS)
    for speed in (0, "fast"):
        with pytest.raises(InputError, match="the speed in m/s must be positive, got"):
            start_of(dh5, place, speed=speed)
    with pytest.raises(InputError) as caught:
        start_of(dh5, place)
    assert str(caught.value) == f"{place} contains waypoints; give a speed in m/s (--speed)"


@pytest.mark.parametrize("rate", [0, NAN, "5", True, 10**400])
def test_rates_that_are_none(dh5, path, recording, rate):
    for trajectory in (path, recording):
        with pytest.raises(
            InputError, match="the rate in samples per second must be positive, got"
        ):
            start_of(dh5, trajectory, rate=rate)


def test_rates_that_are_too_high_or_too_low(dh5, path, recording):
    for trajectory in (path, recording):
        with pytest.raises(
            InputError, match=f"samples exceed the maximum of {MAX_SAMPLES:,}; choose a"
        ):
            start_of(dh5, trajectory, rate=1e9)
        with pytest.raises(InputError, match="samples exceed the maximum of"):
            start_of(dh5, trajectory, rate=1e308)
        with pytest.raises(InputError, match="shorter than one sampling interval; choose"):
            start_of(dh5, trajectory, rate=1e-9)


@pytest.mark.parametrize("trajectory", [None, [(0, 0, 0), (1, 1, 1)], b"file.csv"], ids=repr)
def test_what_no_trajectories_are(dh5, trajectory):
    with pytest.raises(InputError) as caught:
        start_of(dh5, trajectory)
    assert str(caught.value) == (
        f"a trajectory must be a Path, a Recording, a CSV file or a bag, got {trajectory!r}"
    )


@pytest.mark.parametrize(
    ("trajectory", "options"),
    [
        ("", {}),
        ("none.csv", {}),
        (Path.through([(5, 5, 5), POINTS[0]], speed=1.0), {}),  # out of reach
        (Path.through(POINTS, speed=0.05), {"posture": "nowhere"}),
        (Path.through(POINTS, speed=0.05), {"q": [NAN] * 5}),
    ],
)
def test_what_cannot_be_followed(dh5, trajectory, options):
    with pytest.raises(FtforceError):
        start_of(dh5, trajectory, **options)


def test_a_recording_begins_where_it_begins(dh5, recording):
    wanted = "a recorded motion defines its own initial posture; omit q and posture"
    for given in ({"q": np.zeros(5)}, {"posture": "paper"}):
        with pytest.raises(InputError, match=wanted):
            start_of(dh5, recording, **given)


def test_a_recording_of_another_robot(dh5, recording):
    with pytest.raises(InputError, match="the recording has 5 joints; the chain has: 1 panda_join"):
        start_of(ftforce.load_robot("panda"), recording)


@pytest.mark.parametrize(
    "options", [{"speed": 0.1}, {"keep_orientation": True}, {"max_gap": 1.0}], ids=str
)
def test_options_of_files_are_refused_elsewhere(dh5, file, path, recording, options):
    for trajectory in (path, recording):
        with pytest.raises(InputError, match="a Path or a Recording defines its own"):
            start_of(dh5, trajectory, **options)
    if "max_gap" in options:
        with pytest.raises(InputError, match="max_gap and topic to a file of a recorded motion"):
            start_of(dh5, file(WAYPOINTS), speed=0.05, **options)
