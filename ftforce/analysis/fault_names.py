"""Fault sets from joint names and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from numbers import Real
from typing import TYPE_CHECKING, TypeAlias

from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.errors import InputError
from ftforce.io.text import read_numbers, split_items
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from ftforce.robot.robot import Robot

Joints: TypeAlias = "Iterable[int | str] | str | int"
WeakJoints: TypeAlias = "Mapping[int | str, float] | Iterable[tuple[int | str, float]] | str"


def named_faults(
    robot: Robot, locked: Joints = (), free: Joints = (), weak: WeakJoints = ()
) -> FaultSet:
    """Return a fault set from joint names or numbers.

    Parameters
    ----------
    robot :
        The arm.
    locked, free :
        Joints by number (from 1) or name, or a boolean mask of shape (n,).
    weak :
        Joints with the remaining fraction of their torque limit, ``{3: 0.5}`` or ``"3:0.5"``.

    Raises
    ------
    InputError
        A joint does not exist or fails in two modes, or a factor lies outside 0 to 1.
    """
    require_robot(robot)
    if isinstance(free, tuple) and isinstance(weak, tuple) and not free and not weak:
        return _locked(robot.indices(locked))
    faults = [Fault(i) for i in robot.indices(locked)]
    faults += [Fault(i, FaultMode.FREE) for i in robot.indices(free)]
    pairs = _pairs(weak)
    robot.indices([joint for joint, _ in pairs])  # rejects joints that are named twice
    faults += [Fault(robot.index(j), FaultMode.WEAK, _factor(j, x)) for j, x in pairs]
    modes: dict[int, FaultMode] = {}
    for fault in faults:
        if fault.joint in modes:
            raise InputError(
                f"joint {fault.joint + 1} ({robot.names[fault.joint]}) cannot be both "
                f"{modes[fault.joint]} and {fault.mode}; a joint fails in only one mode"
            )
        modes[fault.joint] = fault.mode
    return FaultSet(tuple(faults))


@lru_cache(maxsize=256)  # a loop asks about the same few sets again and again
def _locked(joints: tuple[int, ...]) -> FaultSet:
    return FaultSet.locked(joints)


def _pairs(weak: WeakJoints) -> list[tuple[int | str, object]]:
    if isinstance(weak, Mapping):
        return list(weak.items())
    if not isinstance(weak, str):
        pairs = list(weak) if isinstance(weak, Iterable) else [weak]
        if not all(isinstance(pair, (tuple, list)) and len(pair) == 2 for pair in pairs):
            raise InputError(f"weak joints are given as {{joint: factor}}, got {weak!r}")
        return [(joint, factor) for joint, factor in pairs]
    found: list[tuple[int | str, object]] = []
    for word in split_items(weak):
        joint, colon, factor = word.rpartition(":")
        if not colon:
            raise InputError(
                "a weak joint needs a factor after a colon, e.g. 3:0.5 for half of its torque, "
                f"got {word.strip()!r}"
            )
        if not joint.strip():
            raise InputError(
                f"no joint before {word.strip()!r}; give the weak joint, e.g. 3{word.strip()}"
            )
        try:
            found.append((joint, read_numbers(factor, 1)[0]))
        except ValueError as problem:
            raise InputError(f"the factor of weak joint {joint.strip()!r}: {problem}") from None
    return found


def _factor(joint: int | str, factor: object) -> float:
    if isinstance(factor, bool) or not isinstance(factor, Real):
        raise InputError(f"the factor of weak joint {joint!r} needs a number, got {factor!r}")
    return float(factor)
