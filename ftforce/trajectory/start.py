"""Build the reference trajectory of a simulation from a path, a recording or a file."""

from __future__ import annotations

import math
from os import PathLike
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from ftforce.core.arrays import Vector, is_number, read_only
from ftforce.core.smoothing import suffices
from ftforce.errors import InputError
from ftforce.io.bag import is_bag
from ftforce.robot.inverse_kinematics import check_reach, posture_at
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.posture import Posture, choose_posture
from ftforce.trajectory.path import Path
from ftforce.trajectory.recording import Recording, Sheet, recording_of
from ftforce.trajectory.reference import PathReference, RecordedReference, smoothing_in_words

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.robot.posture import Problem
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.reference import ReferenceTrajectory

__all__ = ["Path", "Recording", "Smooth", "Start", "Trajectory", "start_of", "tip_at"]

_RATE = 100.0  # Hz
MAX_SAMPLES = 5_000_000
_STATIC = "weight only: torques of velocities and accelerations are left out (--static)"
_SAME = 1e-6  # rad or m: postures closer than this count as the same

Trajectory: TypeAlias = "Path | Recording | str | PathLike[str]"
Smooth: TypeAlias = Literal["auto", "none"] | float


class Start(NamedTuple):
    """Reference trajectory with its initial posture and sample times.

    Attributes
    ----------
    reference :
        The reference trajectory.
    q :
        Joint positions at the start, shape (n,).
    times :
        Sample times, s, starting at 0, shape (N,).
    words :
        One-line description of the trajectory.
    source :
        Where the initial posture comes from.
    warnings :
        Warnings about the trajectory.
    notes :
        What was decided about a recording.
    is_static :
        Whether velocities and accelerations are left out of the torques.
    """

    reference: ReferenceTrajectory
    q: Vector
    times: Vector
    words: str
    source: str
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    is_static: bool = False


def start_of(
    robot: Robot,
    trajectory: Trajectory,
    q: ArrayLike | Posture | None = None,
    posture: str | None = None,
    *,
    rate: float | None = None,
    speed: float | None = None,
    keep_orientation: bool = False,
    max_gap: float | None = None,
    smooth: Smooth = "auto",
    static: bool = False,
    topic: str | None = None,
    problem: Problem | None = None,
) -> Start:
    """Return the reference trajectory, initial posture and sample times of a trajectory.

    Parameters
    ----------
    robot :
        The arm.
    trajectory :
        A `Path`, a `Recording`, a CSV file of either (``x,y,z``, or ``t`` and joint columns), or a
        bag.
    q, posture :
        Initial guess for the posture at the start of a path, as in `ftforce.analyze`; not allowed
        with a recording.
    rate :
        Samples per second; by default the recording's own times, or 100 along a path.
    speed, keep_orientation :
        For waypoints read from a file, as in `Path.through`.
    max_gap :
        For a recording read from a file, as in `Recording.read`.
    smooth, static :
        As in `ftforce.simulate`.
    topic :
        For a bag, as in `Recording.read`.
    problem :
        Says why the question cannot be answered in a posture, for the default posture.

    Raises
    ------
    InputError
        A value is invalid, or the tip cannot reach a point.
    TrajectoryError
        The file cannot be read or does not fit the robot.
    """
    if rate is not None and not (is_number(rate) and rate > 0.0):
        raise InputError(f"the rate in samples per second must be positive, got {rate!r}")
    given = trajectory
    if isinstance(given, (str, PathLike)):
        if is_bag(given) or topic is not None:
            given = Recording.read(robot, given, max_gap=max_gap, topic=topic)
        else:
            given = _from_file(robot, given, speed, max_gap, keep_orientation=keep_orientation)
        if isinstance(given, Path):
            speed, keep_orientation = None, False
        else:
            max_gap = topic = None
    if speed is not None or keep_orientation or max_gap is not None or topic is not None:
        raise InputError(
            "speed and keep_orientation apply to a file of waypoints, max_gap and topic to a file "
            "of a recorded motion; a Path or a Recording defines its own"
        )
    if isinstance(given, Recording):
        if q is not None or posture is not None:
            raise InputError(
                "a recorded motion defines its own initial posture; omit q and posture"
            )
        return _recorded(robot, given, rate, _spacing(smooth, given), is_static=static)
    if smooth != "auto":
        raise InputError("smooth applies to a recorded motion; a path is smooth")
    if not isinstance(given, Path):
        raise InputError(
            f"a trajectory must be a Path, a Recording, a CSV file or a bag, got {given!r}"
        )
    start = _along(robot, given, choose_posture(robot, q, posture, problem=problem), rate or _RATE)
    return start._replace(is_static=static, notes=(_STATIC,) * static)


def _from_file(
    robot: Robot,
    path: str | PathLike[str],
    speed: float | None,
    max_gap: float | None,
    *,
    keep_orientation: bool,
) -> Path | Recording:
    sheet = Sheet.read(path)
    if not sheet.holds_points:
        return recording_of(robot, sheet, max_gap)
    if speed is None:
        raise InputError(f"{sheet.path} contains waypoints; give a speed in m/s (--speed)")
    return Path.through(sheet.points(), speed=speed, keep_orientation=keep_orientation)


def _spacing(smooth: Smooth, recording: Recording) -> float | None:
    """Return the time between knots, s: 0 to interpolate, ``None`` for what the noise suggests.

    Raises
    ------
    InputError
        The value is neither a word nor a positive time, or there are too few samples for it.
    """
    if smooth == "auto":
        return None
    if smooth == "none":
        return 0.0
    if not is_number(smooth) or float(smooth) <= 0.0:
        raise InputError(f"smooth must be 'auto', 'none' or a time in s, got {smooth!r}")
    if not suffices(recording.t, float(smooth)):
        raise InputError(
            f"smooth = {float(smooth):g} s is too short for a recording of {len(recording.t):,} "
            f"samples over {recording.duration:.4g} s; 'none' interpolates them"
        )
    return float(smooth)


def _recorded(
    robot: Robot,
    recording: Recording,
    rate: float | None,
    spacing: float | None,
    *,
    is_static: bool,
) -> Start:
    if recording.q.shape[1] != robot.n:
        raise InputError(
            f"the recording has {recording.q.shape[1]} joints; the chain has: {robot.numbered()}"
        )
    times = recording.t - recording.t[0]
    if rate is not None:
        times = np.arange(math.floor(_count(recording.duration * rate) + 1e-9) + 1) / rate
    words = f"the recorded motion of {recording.source}, {recording.duration:.4g} s"
    if recording.source == "given":
        words = f"a recorded motion of {recording.duration:.4g} s"
    reference = RecordedReference(robot, recording, spacing)
    q, warnings = read_only(recording.q[0].copy()), tuple(recording.warnings(robot.names))
    how = _STATIC if is_static else smoothing_in_words(robot, reference.smoothing, spacing)
    notes = (*recording.notes, how)
    return Start(reference, q, read_only(times), words, "recorded", warnings, notes, is_static)


def _along(robot: Robot, path: Path, posture: Posture, rate: float) -> Start:
    check_reach(robot, path.points)
    q = posture_at(robot, path.points[0], posture.q)
    source = posture.source
    if np.abs(q - posture.q).max() > _SAME:
        source = f"from {source}, with the tip at the start of the path"
    times = np.arange(math.ceil(_count(path.duration * rate) - 1e-9) + 1) / rate
    points = " → ".join(map(_in_words, path.points))
    words = f"{points} m, at most {path.speed:g} m/s, {path.duration:.4g} s"
    if path.keeps_orientation:
        words += ", orientation kept"
    reference = PathReference(robot, path, q)
    return Start(reference, q, read_only(times), words, source, posture.warnings)


def _in_words(point: Vector) -> str:
    return f"({', '.join(f'{x:.4g}' for x in (point.round(6) + 0.0).tolist())})"


def _count(samples: float) -> float:
    """Return the number of samples (duration times rate) after checking its range.

    Raises
    ------
    InputError
        There are too many samples, or the trajectory is shorter than one step.
    """
    if samples < 1.0:
        raise InputError(
            "the trajectory is shorter than one sampling interval; choose a higher rate"
        )
    if samples > MAX_SAMPLES:
        raise InputError(
            f"{samples:.3g} samples exceed the maximum of {MAX_SAMPLES:,}; choose a lower rate"
        )
    return samples


def tip_at(robot: Robot, q: ArrayLike | Posture | None, posture: str | None) -> Vector:
    """Return the tip position in a posture, in root axes, m, shape (3,).

    Parameters
    ----------
    robot, q, posture :
        As in `ftforce.analyze`.
    """
    return tip_pose(robot, choose_posture(robot, q, posture).q)[1]
