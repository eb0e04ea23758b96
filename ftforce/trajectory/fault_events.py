"""Fault events: which joints fail when, and when the controller learns of it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from ftforce.analysis.fault_names import named_faults
from ftforce.core.arrays import is_number
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.errors import InputError
from ftforce.io.text import read_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.robot.robot import Robot

_EXAMPLES = "3,4@50, free:2@10 or weak:3:0.5@5"


class FaultEvent(NamedTuple):
    """Joints that fail at the same time.

    Attributes
    ----------
    time :
        Time from the start of the trajectory, s.
    faults :
        The joints that fail at this time, and their fault modes.
    """

    time: float
    faults: FaultSet


Events: TypeAlias = "str | FaultEvent | Iterable[str | FaultEvent]"


class Phase(NamedTuple):
    """A time interval in which neither the actual nor the known faults change.

    Attributes
    ----------
    start :
        Start of the interval, s.
    actual :
        Faults present.
    known :
        Faults to which the controller has reacted.
    """

    start: float
    actual: FaultSet
    known: FaultSet


def read_events(robot: Robot, events: Events) -> tuple[FaultEvent, ...]:
    """Parse fault events, sort them by time, and merge those at the same time.

    Parameters
    ----------
    robot :
        The arm.
    events :
        Strings ``JOINTS@SECONDS`` with joints by number (from 1) or name, prefixed by ``free:`` or
        ``weak:`` if not locked: ``3,4@50``, ``free:2@10``, ``weak:3:0.5@5``; or `FaultEvent`.

    Raises
    ------
    InputError
        An event is malformed, a joint does not exist, fails twice in the same way, or fails after
        it has locked.
    """
    given = [events] if isinstance(events, (str, FaultEvent)) else events
    if not isinstance(given, Iterable):
        raise InputError(f"fault events are strings such as {_EXAMPLES}; got {events!r}")
    found = [one if isinstance(one, FaultEvent) else _read(robot, one) for one in given]
    for event in found:
        _check(robot, event)
    found.sort(key=_time)
    modes: dict[int, Fault] = {}
    for event in found:
        for fault in event.faults.faults:
            before = modes.get(fault.joint)
            if before is not None and (before == fault or before.mode is FaultMode.LOCKED):
                name = f"{fault.joint + 1} ({robot.names[fault.joint]})"
                raise InputError(
                    f"joint {name} has already failed ({before}) by {event.time:g} s; only a free "
                    "or weak joint can fail again, in another mode"
                )
            modes[fault.joint] = fault
    together: dict[float, list[FaultEvent]] = {}
    for event in found:
        together.setdefault(event.time, []).append(event)
    return tuple(FaultEvent(time, joined(events)) for time, events in together.items())


def phases(events: Sequence[FaultEvent], delay: float) -> tuple[Phase, ...]:
    """Return the phases of a trajectory from time 0; a joint's latest fault replaces earlier ones.

    Parameters
    ----------
    events :
        Events sorted by time.
    delay :
        Time from a fault until the controller reacts, s; infinite if it never does.
    """
    times = {0.0, *(e.time for e in events), *(e.time + delay for e in events)}
    return tuple(
        Phase(
            start,
            joined(e for e in events if e.time <= start),
            joined(e for e in events if e.time + delay <= start),
        )
        for start in sorted(times)
        if math.isfinite(start)
    )


def joined(events: Iterable[FaultEvent]) -> FaultSet:
    """Return the union of the faults of events sorted by time, with the latest fault per joint."""
    latest: dict[int, Fault] = {}
    for event in events:
        latest |= {fault.joint: fault for fault in event.faults.faults}
    return FaultSet(tuple(latest.values()))


def _read(robot: Robot, text: object) -> FaultEvent:
    if not isinstance(text, str):
        raise InputError(f"a fault event is a string such as {_EXAMPLES}; got {text!r}")
    joints, at, time = text.rpartition("@")
    if not at or not joints.strip() or not time.strip():
        raise InputError(f"a fault event needs joints and a time, e.g. {_EXAMPLES}; got {text!r}")
    try:
        seconds = read_numbers(time, 1)[0]
    except ValueError as problem:
        raise InputError(f"the time of the fault {text!r}: {problem}; give it in s") from None
    mode, colon, rest = joints.partition(":")
    word = mode.strip().lower()
    if not colon or joints.strip() in robot.names:  # a joint name may contain a colon
        return FaultEvent(seconds, named_faults(robot, locked=joints))
    if word not in set(FaultMode):
        raise InputError(
            f"unknown fault mode {mode.strip()!r} in {text!r}; available: locked, free, weak, "
            f"e.g. {_EXAMPLES}"
        )
    if not rest.strip():
        raise InputError(f"the fault at {seconds:g} s has no joints; give one, e.g. {_EXAMPLES}")
    return FaultEvent(seconds, named_faults(robot, **{word: rest}))


def _check(robot: Robot, event: FaultEvent) -> None:
    time, faults = event
    if not is_number(time) or time < 0.0:
        shown = f"{time:g} s" if isinstance(time, float) else repr(time)
        raise InputError(f"the time of a fault must be 0 s or later, got {shown}")
    if not isinstance(faults, FaultSet):
        raise InputError(f"a fault event needs a FaultSet, got {faults!r}")
    if not faults:
        raise InputError(f"the fault at {time:g} s has no joints; give one, e.g. {_EXAMPLES}")
    if any(fault.joint >= robot.n for fault in faults.faults):
        raise InputError(
            f"a joint of the fault at {time:g} s is out of range; the chain has: {robot.numbered()}"
        )


def _time(event: FaultEvent) -> float:
    return event.time
