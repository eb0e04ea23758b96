"""Straight lines with a smooth timing law: SciPy's polynomial, differences, and bad input."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.interpolate import BPoly

from ftforce.errors import InputError
from ftforce.trajectory.path import PEAK, Path
from helpers import assert_close, campaign, seeds

law = settings(deadline=None, max_examples=campaign(60, 30))
START, END = (1.150, -0.134, 0.034), (0.781, 0.509, 0.280)  # the paper's section V
LENGTH = math.dist(START, END)
NAN, INF = math.nan, math.inf
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 2, 0), (1, 2, -3)]


def path_of(seed):
    """Return a random path."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(2, 6), 3))
    return Path.through(points, speed=float(rng.uniform(0.01, 2.0)))


def along(path, count=501):
    """Return times, positions and velocities."""
    t = np.linspace(0.0, path.duration, count)
    x, v = (np.array(part) for part in zip(*map(path.at, t.tolist()), strict=True))
    return t, x, v


# ---- one line --------------------------------------------------------------------------------


def test_the_line_of_section_v():
    path = Path.through([START, END], speed=0.015)
    assert path.length == pytest.approx(LENGTH)
    assert path.duration == pytest.approx(1.875 * LENGTH / 0.015)
    assert pytest.approx(1.875) == PEAK
    assert path.speed == 0.015
    assert not path.keeps_orientation
    kept = Path.through([START, END], speed=1.0, keep_orientation=True)
    assert kept.keeps_orientation is True
    x, v = path.at(path.duration / 2.0)
    assert_close(x, (np.array(START) + END) / 2.0)
    assert_close(v, 0.015 * (np.array(END) - START) / LENGTH)


def test_the_law_is_the_polynomial_that_begins_and_ends_at_rest():
    """SciPy's polynomial of least degree with these ends: place, velocity and acceleration."""
    path = Path.through([(0, 0, 0), (3, 0, -4)], speed=2.0)
    T = path.duration
    wanted = BPoly.from_derivatives([0.0, T], [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    t, x, v = along(path)
    assert_close(x, np.outer(wanted(t), [0.6, 0.0, -0.8]))
    assert_close(v, np.outer(wanted.derivative()(t), [0.6, 0.0, -0.8]))
    assert np.linalg.norm(v, axis=1).max() == pytest.approx(2.0)


@pytest.mark.parametrize("t", [-1.0, 0.0, -1e-9, 1e9])
def test_at_rest_before_and_after(t):
    path = Path.through([START, END], speed=1.0)
    x, v = path.at(t)
    assert_close(x, START if t <= 0.0 else END)
    assert not v.any()


# ---- laws ------------------------------------------------------------------------------------


@given(seeds)
@law
def test_velocity_is_the_derivative_of_position(seed):
    path, h = path_of(seed), 1e-6
    for t in np.random.default_rng(seed).uniform(0.0, path.duration, size=20).tolist():
        quotient = (path.at(t + h)[0] - path.at(t - h)[0]) / (2.0 * h)
        assert_close(path.at(t)[1], quotient, scale=path.speed, tol=1e-6 / min(path.duration, 1.0))


@given(seeds)
@law
def test_speed_and_acceleration_pass_through_zero_at_each_point(seed):
    path = path_of(seed)
    h = 1e-4 * np.diff(path.times).min()
    for t, point in zip(path.times.tolist(), path.points, strict=True):
        x, v = path.at(t)
        assert_close(x, point, scale=1.0)
        assert_close(v, np.zeros(3), scale=path.speed, tol=1e-12)
        for side in (-h, h):
            assert np.linalg.norm(path.at(t + side)[1]) < 1e-6 * path.speed  # as h²


@given(seeds)
@law
def test_each_line_is_straight_monotonic_and_as_fast_as_asked(seed):
    path = path_of(seed)
    lines = zip(path.times, path.times[1:], path.points, path.points[1:], strict=False)
    for begin, end, a, b in lines:
        t = np.linspace(begin, end, 101)
        x, v = (np.array(part) for part in zip(*map(path.at, t.tolist()), strict=True))
        way = (x - a) @ (b - a) / ((b - a) @ (b - a))
        assert_close(x, a + np.outer(way, b - a), scale=1.0)
        assert (np.diff(way) > -1e-12).all()
        assert (way[0], way[-1]) == pytest.approx((0.0, 1.0), abs=1e-9)
        speeds = np.linalg.norm(v, axis=1)
        assert speeds.max() == pytest.approx(path.speed)
        assert speeds.argmax() == 50


def test_waypoints_with_corners():
    path = Path.through(CORNERS, speed=0.5)
    assert_close(path.times, 1.875 / 0.5 * np.array([0, 1, 3, 6]))
    assert path.length == pytest.approx(6.0)
    assert path.duration == pytest.approx(1.875 * 6.0 / 0.5)
    assert_close(path.at(path.times[1])[0], CORNERS[1])
    assert not path.at(path.times[1])[1].any()


def test_the_caller_s_points_are_left_alone():
    points = np.array([START, END])
    path = Path.through(points, speed=1.0)
    points[0] = 9.0
    assert_close(path.points[0], START)
    assert not path.points.flags.writeable
    assert not path.times.flags.writeable


# ---- bad input -------------------------------------------------------------------------------

BAD_POINTS = {
    "one point": ([START], "a path needs two or more points x, y, z in m, got an array of shape"),
    "two numbers each": ([(1, 2), (3, 4)], "a path needs two or more points x, y, z in m"),
    "ragged": ([(1, 2, 3), (4, 5)], "the path needs numbers, got"),
    "truth": ([[True] * 3, [False] * 3], "the path needs numbers"),
    "NaN": ([START, (0, NAN, 0)], "the path contains nan at position 2, 2; numbers must"),
    "too large": ([START, (1e200, 0, 0)], "the path contains numbers too large"),
    "far": ([START, (-1e12, 0, 0)], "the path's points must lie within 1e+09 m, got 1e+12 m"),
    "equal": ([START, START], "points 1 and 2 of the path coincide; omit one"),
    "closer than numbers are": (
        [(0, 0, 0), (10, 0, 0), (10, 1e-17, 0)],
        "points 2 and 3 of the path are too close together; omit one",
    ),
}


@pytest.mark.parametrize(("points", "message"), BAD_POINTS.values(), ids=BAD_POINTS)
def test_points_that_make_no_path(points, message):
    with pytest.raises(InputError) as caught:
        Path.through(points, speed=0.1)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("speed", [0, 0.0, -1.0, NAN, INF, -INF, "1", None, True, [1.0], 10**400])
def test_speeds_that_are_none(speed):
    with pytest.raises(InputError, match="the speed in m/s must be positive, got"):
        Path.through([START, END], speed=speed)


@pytest.mark.parametrize("speed", [1e-310, 5e-324])
def test_a_path_without_end(speed):
    with pytest.raises(InputError, match="the path takes infinitely long at a speed of"):
        Path.through([START, END], speed=speed)
