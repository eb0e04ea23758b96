"""Friction of free-swinging joints: what holds them where no tip force has a lever (theory §4)."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from ftforce.analysis.limits_files import read_friction
from ftforce.core.arrays import Vector, as_floats, read_only
from ftforce.errors import DimensionError, InputError
from ftforce.io.text import read_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from ftforce.core.limits import Limits
    from ftforce.robot.robot import Joint, Robot

_SHARE_OF_EFFORT = 1e-3
GIVEN, FROM_URDF = "given", "the URDF"
FROM_EFFORT = "0.1 % of the effort limit"
FROM_WEIGHT = "0.1 % of the largest weight torque"
UNKNOWN = "unknown: neither friction nor effort limit nor masses in the URDF"

_of_robots: WeakKeyDictionary[Robot, Friction] = WeakKeyDictionary()  # without limits

FrictionLike: TypeAlias = "ArrayLike | str | os.PathLike[str] | None"


@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    """Largest torque that the friction of each joint bears, should the joint swing freely.

    Attributes
    ----------
    torque :
        N·m (N for prismatic joints), shape (n,); NaN where it is 0.1 % of the largest weight
        torque of the arm, in the posture analysed.
    sources :
        Where each value comes from, n texts.
    """

    torque: Vector
    sources: tuple[str, ...]

    def in_words(self, robot: Robot, joints: Sequence[int] | None = None) -> str:
        """Describe the friction of joints, grouped by its source.

        Parameters
        ----------
        robot :
            The arm.
        joints :
            Indices of the joints, which are then named; by default all.
        """
        groups: dict[str, list[int]] = {}
        for j in range(robot.n) if joints is None else joints:
            groups.setdefault(self.sources[j], []).append(j)
        is_whole = joints is None and len(groups) == 1
        parts = []
        for source, own in groups.items():
            each = [self._named(robot.joints[j], float(self.torque[j])) for j in own]
            values = {f"{self.torque[j]:.3g} {robot.joints[j].torque_unit}" for j in own}
            if is_whole and len(values) == 1 and source == GIVEN:
                parts.append(values.pop())
            else:
                parts.append(source if is_whole else f"{', '.join(each)} ({source})")
        return "; ".join(parts)

    @property
    def option(self) -> str:
        """What ``--friction`` has to say to give this friction; empty if it says nothing."""
        known = {GIVEN, FROM_URDF, FROM_EFFORT, FROM_WEIGHT, UNKNOWN}
        if files := [source for source in self.sources if source not in known]:
            return files[0]
        values = {x for x, source in zip(self.torque, self.sources, strict=True) if source == GIVEN}
        return str(float(values.pop())) if len(values) == 1 else ""

    @staticmethod
    def _named(joint: Joint, torque: float) -> str:
        return (
            joint.name if math.isnan(torque) else f"{joint.name} {torque:.3g} {joint.torque_unit}"
        )


def choose_friction(robot: Robot, friction: FrictionLike, limits: Limits | None) -> Friction:
    """Return the friction of each joint: as given, from the URDF, or from the effort limits.

    Parameters
    ----------
    robot :
        The arm.
    friction :
        One number for all joints, one per joint (NaN where unknown, shape (n,)), N·m or N, or a
        TOML, YAML or CSV file (joint, friction); 0 is an ideal joint. ``None`` where unknown.
    limits :
        Torque limits in force, which precede the efforts of the URDF.

    Raises
    ------
    InputError
        A value is negative or not a number, or their number does not match the arm.
    LimitsError
        The file cannot be read or does not fit the robot.
    """
    if friction is None and limits is None:
        if robot not in _of_robots:
            _of_robots[robot] = _friction(robot, *_given(robot, None), robot.effort)
        return _of_robots[robot]
    given, source = _given(robot, friction)
    effort = robot.effort
    if limits is not None:
        lower, upper = limits.motor_bounds()
        effort = np.where(limits.is_known, np.maximum(upper, -lower), effort)
    return _friction(robot, given, source, effort)


def _friction(robot: Robot, given: Vector, source: str, effort: Vector) -> Friction:
    """Return the friction of each joint from the first of its sources that says anything."""
    torque, sources = [], []
    for one, own, most in zip(given, robot.friction, effort, strict=True):
        known = [(one, source), (own, FROM_URDF), (_SHARE_OF_EFFORT * most, FROM_EFFORT)]
        last = (math.nan, FROM_WEIGHT) if robot.mass > 0.0 else (0.0, UNKNOWN)
        value, origin = next((x for x in known if not math.isnan(x[0])), last)
        torque.append(value)
        sources.append(origin)
    return Friction(read_only(np.array(torque)), tuple(sources))


def _given(robot: Robot, friction: FrictionLike) -> tuple[Vector, str]:
    """Return the friction given, NaN where none is, and its source."""
    if friction is None:
        return np.full(robot.n, np.nan), GIVEN
    value: ArrayLike
    if isinstance(friction, (str, os.PathLike)):
        try:
            value = read_numbers(str(friction), 1)[0]
        except ValueError:
            return read_friction(robot, friction), str(friction)
    else:
        value = friction
    values = as_floats(value, "friction")
    if values.ndim == 0:
        values = np.full(robot.n, float(values))
    if values.shape != (robot.n,):
        raise DimensionError("friction", (robot.n,), values.shape, robot.numbered())
    if (values < 0.0).any() or np.isinf(values).any():
        raise InputError(
            "friction needs a number of at least 0 (N·m or N), one per joint, or a TOML, YAML "
            f"or CSV file (joint, friction), got {friction!r}"
        )
    return values, GIVEN
