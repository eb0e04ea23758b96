"""Tip paths: straight line segments with a smooth timing law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_floats, check_finite, is_number, read_only
from ftforce.errors import InputError
from ftforce.io.text import LARGEST_NUMBER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

PEAK = 1.875  # ratio of largest to mean speed of the timing law


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Straight line segments between waypoints; the tip comes to rest at every waypoint.

    Along each segment the tip covers the fraction ``s = 10 u³ - 15 u⁴ + 6 u⁵`` of its length, with
    u = 0…1 in time, so that speed and acceleration start and end at zero and the speed peaks in the
    middle.

    Attributes
    ----------
    points :
        Waypoints in root axes, m, shape (k, 3).
    times :
        Times at the waypoints, s, starting at 0, shape (k,).
    speed :
        Largest speed, m/s.
    keeps_orientation :
        Whether the tip keeps its initial orientation; otherwise its orientation is unconstrained.
    """

    points: Matrix
    times: Vector
    speed: float
    keeps_orientation: bool = False

    @classmethod
    def through(cls, points: ArrayLike, *, speed: float, keep_orientation: bool = False) -> Path:
        """Return the path through waypoints, with the same peak speed on every segment.

        Parameters
        ----------
        points :
            Two or more waypoints, in root axes, m, shape (k, 3).
        speed :
            Largest speed, m/s.
        keep_orientation :
            Whether the tip keeps its initial orientation.

        Raises
        ------
        InputError
            The points are not (k, 3) numbers, consecutive points coincide, or the speed is not
            positive.
        """
        places = as_floats(points, "the path")
        if places.ndim != 2 or places.shape[1] != 3 or len(places) < 2:
            raise InputError(
                f"a path needs two or more points x, y, z in m, got an array of shape "
                f"{places.shape}"
            )
        check_finite(places, "the path")
        if (far := float(np.abs(places).max())) > LARGEST_NUMBER:
            raise InputError(
                f"the path's points must lie within {LARGEST_NUMBER:g} m, got {far:g} m"
            )
        if not is_number(speed) or speed <= 0:
            raise InputError(f"the speed in m/s must be positive, got {speed!r}")
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        if not lengths.all():
            i = int(lengths.argmin()) + 1
            raise InputError(f"points {i} and {i + 1} of the path coincide; omit one")
        with np.errstate(over="ignore"):
            times = np.concatenate([[0.0], np.cumsum(PEAK * lengths / float(speed))])
        if not math.isfinite(times[-1]):
            raise InputError(f"the path takes infinitely long at a speed of {speed:g} m/s")
        if not np.diff(times).all():  # too short to have a duration in floating point
            i = int(np.diff(times).argmin()) + 1
            raise InputError(f"points {i} and {i + 1} of the path are too close together; omit one")
        return cls(read_only(places), read_only(times), float(speed), bool(keep_orientation))

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.times[-1])

    @property
    def length(self) -> float:
        """Length, m."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def legs(self) -> tuple[Leg, ...]:
        """Return the line segments with their times."""
        lines, times = np.diff(self.points, axis=0), self.times.tolist()
        return tuple(map(Leg, times, times[1:], self.points, lines))

    def at(self, t: float) -> tuple[Vector, Vector]:
        """Return the reference position (m) and velocity (m/s), both of shape (3,).

        Before the start and after the end the tip is at rest.

        Parameters
        ----------
        t :
            Time, s.
        """
        return leg_at(self.legs(), t).at(t)


class Leg(NamedTuple):
    """A line segment of a path: start and end time (s), start point (m) and displacement (m)."""

    start: float
    end: float
    point: Vector
    line: Vector

    def at(self, t: float) -> tuple[Vector, Vector]:
        """Return position (m) and velocity (m/s) at time t (s), both (3,); at rest outside.

        Parameters
        ----------
        t :
            Time, s, from the start of the path.
        """
        duration = self.end - self.start
        u = min(max((t - self.start) / duration, 0.0), 1.0)
        s = u * u * u * (10.0 + u * (6.0 * u - 15.0))
        rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) / duration
        return self.point + s * self.line, rate * self.line


def leg_at(legs: Sequence[Leg], t: float) -> Leg:
    """Return the leg at time t, s; the first or last one outside the path.

    Parameters
    ----------
    legs :
        Line segments of the path, in order.
    t :
        Time, s.
    """
    return next((leg for leg in legs if t < leg.end), legs[-1])
