"""Joints that have locked before or during a task, of which the rest is planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ftforce.core.arrays import is_number, read_only
from ftforce.core.faults import FaultSet
from ftforce.errors import InputError
from ftforce.io.text import read_numbers, split_items

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ftforce.core.arrays import Mask, Vector
    from ftforce.robot.robot import Robot

LocksLike: TypeAlias = "str | Mapping[int | str, float] | None"

_FORMS = "e.g. 3@0.7, at 0.7 rad (m), or 3@2s, where it is after 2 s"
_ROUNDING = 1e-9  # rad or m


@dataclass(frozen=True, eq=False)
class Locks:
    """Joints that have locked, and where.

    Attributes
    ----------
    joints :
        Their indices.
    q :
        Positions at which they locked, rad or m; NaN at joints that move, and while it is not known
        where the joints are at ``time``; shape (n,).
    time :
        When they lock, s; 0 if they have locked before the task.
    """

    joints: tuple[int, ...]
    q: Vector
    time: float = 0.0

    @classmethod
    def parse(cls, robot: Robot, given: LocksLike) -> Locks | None:
        """Return the locks that are given as text or by joint; ``None`` for none.

        Parameters
        ----------
        robot :
            The arm.
        given :
            Joints by number (from 1) or name with positions, rad or m: ``"3@0.7,5@-0.2"`` or
            ``{3: 0.7, 5: -0.2}``; or with the time at which they lock where they are: ``"3@2s"``.

        Raises
        ------
        InputError
            It is malformed, a joint does not exist or is named twice, a position is outside the
            limits, joints lock at different times, or no joint is left.
        """
        if given is None:
            return None
        pairs: list[tuple[int | str, float, float | None]]
        if isinstance(given, str):
            pairs = list(_read(given))
        elif isinstance(given, Mapping):
            pairs = [(joint, _position(joint, value), None) for joint, value in given.items()]
        else:
            raise InputError(
                f"locked joints are given as text or by joint, {_FORMS}; got {given!r}"
            )
        joints = robot.indices([joint for joint, _, _ in pairs])
        if not joints:
            raise InputError(f"give the joint that has locked, {_FORMS}")
        if len(joints) == robot.n:
            raise InputError("all joints have locked: none is left that could move the tip")
        times = {time for _, _, time in pairs}
        if len(times) > 1:
            raise InputError(
                "all joints lock before the task (3@0.7,5@-0.2) or at one time (3@2s,5@2s), got "
                f"{given!r}"
            )
        (time,) = times
        q = np.full(robot.n, np.nan)
        for joint, position, _ in pairs:
            q[robot.index(joint)] = position
        return cls(joints, _within(robot, q, joints), time or 0.0)

    def where(self, q: Vector) -> Locks:
        """Return the locks of joints that lock in a posture, where they are not known yet.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        own = np.isin(np.arange(len(q)), self.joints)
        return Locks(self.joints, read_only(np.where(own & np.isnan(self.q), q, self.q)), self.time)

    def applied(self, q: Vector) -> Vector:
        """Return a posture with the joints where they locked, shape (n,).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        return np.where(np.isnan(self.q), q, self.q)

    @property
    def mask(self) -> Mask:
        """True at the joints that have locked, shape (n,)."""
        return np.isin(np.arange(len(self.q)), self.joints)

    def with_others(self, sets: Iterable[FaultSet], most: int) -> tuple[FaultSet, ...]:
        """Return the fault sets in which these joints have locked, and up to ``most`` fail in all.

        Parameters
        ----------
        sets :
            Sets of joints that may fail.
        most :
            Number of failed joints, at most; these count.
        """
        own = FaultSet.locked(self.joints)
        others = [
            FaultSet((*own.faults, *one.faults))
            for one in sets
            if not set(one.joints) & set(self.joints) and len(one.joints) + len(self.joints) <= most
        ]
        return (own, *others)


def _read(text: str) -> Iterator[tuple[int | str, float, float | None]]:
    """Yield joint, position or NaN, and time or ``None``."""
    for item in split_items(text):
        joint, at, place = item.rpartition("@")
        word = place.strip()
        is_time = word.endswith("s")
        if not at or not joint.strip() or not word:
            raise InputError(f"a locked joint needs a place or a time, {_FORMS}; got {item!r}")
        try:
            (value,) = read_numbers(word.removesuffix("s"), 1)
        except ValueError as problem:
            raise InputError(f"where joint {joint.strip()} locks: {problem}, {_FORMS}") from None
        if is_time and value < 0.0:
            raise InputError(f"a joint locks at 0 s or later, got {item!r}")
        yield (joint.strip(), np.nan, value) if is_time else (joint.strip(), value, None)


def _position(joint: object, value: object) -> float:
    if not is_number(value):
        raise InputError(f"where joint {joint!r} locks must be a number, rad or m, got {value!r}")
    return float(value)  # type: ignore[arg-type] # a number


def _within(robot: Robot, q: Vector, joints: Iterable[int]) -> Vector:
    """Return positions at the limits where they exceed them by no more than rounding.

    Raises
    ------
    InputError
        One is outside the limits.
    """
    for i in joints:
        low, high = robot.lower[i], robot.upper[i]
        if q[i] < low - _ROUNDING or q[i] > high + _ROUNDING:
            unit = robot.units[i]
            raise InputError(
                f"joint {i + 1} ({robot.names[i]}) cannot have locked at {q[i]:g} {unit}, outside "
                f"its limits from {low:.4g} to {high:.4g} {unit}"
            )
    return read_only(np.clip(q, robot.lower, robot.upper))
