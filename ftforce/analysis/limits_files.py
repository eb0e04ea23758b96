"""Torque limits from the URDF, or from a TOML or CSV file."""

from __future__ import annotations

import math
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.core.limits import Limits
from ftforce.errors import DimensionError, InputError, LimitsError, printable
from ftforce.io.text import LARGEST_TOML, read_numbers, read_text, read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot

URDF, NONE = "urdf", "none"
_COLUMNS = ("joint", "effort", "brake")
_FRICTION_COLUMNS = ("joint", "friction")
_ALL_COLUMNS = (*_COLUMNS, "friction")
_SMALLEST = 1e-9  # N·m or N: smaller values are input errors and vanish in rounding
_KIND = "a TOML or CSV file of limits (joint, effort, brake)"
_FRICTION_KIND = "a TOML or CSV file of friction (joint, friction)"

LimitsLike: TypeAlias = "Limits | str | os.PathLike[str] | None"
_Entry: TypeAlias = "tuple[str, Mapping[str, Any]]"  # location in the file, and content
_Read = TypeVar("_Read")


def choose_limits(robot: Robot, limits: LimitsLike) -> Limits | None:
    """Return the torque limits in force.

    Parameters
    ----------
    robot :
        The arm.
    limits :
        ``urdf``, the path of a TOML or CSV file, `Limits`, or ``none`` (``None``) for no limits.

    Raises
    ------
    LimitsError
        The file cannot be read, names a joint that the arm does not have, or contains a limit that
        is not positive.
    InputError
        The number of limits does not match the arm.
    """
    if limits is None:
        return None
    if isinstance(limits, Limits):
        if len(limits.effort) != robot.n:
            raise DimensionError("limits", (robot.n,), limits.effort.shape, robot.numbered())
        return limits
    if not isinstance(limits, (str, os.PathLike)) or not str(limits):
        raise InputError(
            "limits are 'urdf', 'none', a TOML or CSV file or ftforce.core.limits.Limits (of an "
            f"array: Limits.of(effort)), got {limits!r}"
        )
    if limits == NONE:
        return None
    if limits == URDF:
        return Limits(robot.effort, read_only(np.full(robot.n, np.nan)), URDF)
    return read_limits(robot, limits)


def read_limits(robot: Robot, path: str | os.PathLike[str]) -> Limits:
    """Read torque limits from a TOML or CSV file.

    Limits of joints or columns that the file omits are unknown, even if the URDF has them.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file; its extension is ``.toml`` or ``.csv``.

    Raises
    ------
    LimitsError
        As in `choose_limits`.
    """
    fill = partial(_fill, robot, source=str(path))
    return _read(path, "'urdf', 'none' or ", _KIND, _COLUMNS, fill)


def read_friction(robot: Robot, path: str | os.PathLike[str]) -> Vector:
    """Read the friction of joints from a TOML or CSV file, N·m or N, NaN where unknown, shape (n,).

    The file may hold limits too.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file; its extension is ``.toml`` or ``.csv``.

    Raises
    ------
    LimitsError
        The file cannot be read, names a joint that the arm does not have, or contains a negative
        value.
    """

    def fill(entries: Iterable[_Entry]) -> Vector:
        friction = np.full(robot.n, np.nan)
        for i, where, entry in _joint_entries(robot, entries):
            friction[i] = _number(entry.get("friction"), f"{where}: friction of {robot.names[i]}")
        if np.isnan(friction).all():
            raise InputError("contains no friction; expected joint, friction for each joint")
        return read_only(friction)

    return _read(path, "a number (N·m or N) or ", _FRICTION_KIND, _FRICTION_COLUMNS, fill)


def _read(
    path: str | os.PathLike[str],
    words: str,
    kind: str,
    columns: tuple[str, ...],
    fill: Callable[[Iterable[_Entry]], _Read],
) -> _Read:
    """Return what ``fill`` makes of the entries of a file; ``words``: what else could be given."""
    ending = Path(path).suffix.lower()
    if ending not in {".toml", ".csv"}:
        raise LimitsError(path, f"expected {words}{kind} ending in .toml or .csv")
    text = read_text(path, LimitsError, kind, LARGEST_TOML if ending == ".toml" else None)
    try:
        return fill(_toml_entries(text) if ending == ".toml" else _csv_entries(text, columns))
    except InputError as problem:
        raise LimitsError(path, printable(problem)) from None


def _fill(robot: Robot, entries: Iterable[_Entry], source: str) -> Limits:
    effort, brake = np.full(robot.n, np.nan), np.full(robot.n, np.nan)
    for i, where, entry in _joint_entries(robot, entries):
        effort[i] = _limit(entry.get("effort"), f"{where}: effort of {robot.names[i]}")
        brake[i] = _limit(entry.get("brake"), f"{where}: brake of {robot.names[i]}")
    if np.isnan(effort).all() and np.isnan(brake).all():
        raise InputError(f"contains no limits; expected {', '.join(_COLUMNS)} for each joint")
    return Limits(read_only(effort), read_only(brake), source)


def _joint_entries(
    robot: Robot, entries: Iterable[_Entry]
) -> Iterator[tuple[int, str, Mapping[str, Any]]]:
    """Yield the joint, the place in the file and the content of every entry."""
    seen: dict[int, str] = {}
    for where, entry in entries:
        _check_keys(where, entry)
        try:
            i = robot.index(entry["joint"])
        except InputError as problem:
            raise InputError(f"{where}: {problem}") from None
        if i in seen:
            raise InputError(
                f"{where}: joint {i + 1} ({robot.names[i]}) already appears in {seen[i]}"
            )
        seen[i] = where
        yield i, where, entry


def _check_keys(where: str, entry: Mapping[str, Any]) -> None:
    for key, value in entry.items():
        if key not in _ALL_COLUMNS:
            quotes = "; a name with a dot needs quotes" if isinstance(value, dict) else ""
            known = ", ".join(_ALL_COLUMNS)
            raise InputError(f"{where}: unknown key {key!r}; available: {known}{quotes}")
    if "joint" not in entry:
        raise InputError(f"{where}: no joint given")


def _number(value: object, what: str, wanted: str = "a number of at least 0") -> float:
    """Return a number; NaN if the value is empty."""
    if value is None or (isinstance(value, str) and not value.strip()):
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(f"{what} must be {wanted}, N·m or N, got {value!r}")
    try:
        number = read_numbers(str(value), 1)[0]
    except ValueError as problem:
        raise InputError(f"{what}: {problem}; omit it if unknown") from None
    if wanted.endswith("0") and number < 0.0:
        raise InputError(f"{what} must be {wanted}, N·m or N, got {number:g}")
    return number


def _limit(value: object, what: str) -> float:
    """Return a limit; NaN if the value is empty."""
    limit = _number(value, what, "a positive number")
    if limit < _SMALLEST:
        hint = f"limits below {_SMALLEST:g} are not accepted"
        if limit <= 0.0:
            hint = "limits apply in both directions" if limit < 0.0 else "omit it if unknown"
        raise InputError(f"{what} must be a positive number, N·m or N, got {limit + 0.0:g}; {hint}")
    return limit


def _toml_entries(text: str) -> list[_Entry]:
    """Return the entries of ``[[joint]]`` tables, or of one table named after each joint."""
    content = read_toml(text)
    entries: list[_Entry] = []
    for key, value in content.items():
        if isinstance(value, dict):
            if "joint" in value and key != "joint":
                raise InputError(
                    f"[{key}]: names two joints, {key!r} and {value['joint']!r}; use one table "
                    "named after each joint, or [[joint]] tables with the key joint"
                )
            entries.append((f"[{key}]", {"joint": key, **value}))
        elif isinstance(value, list) and all(isinstance(one, dict) for one in value):
            entries += [(f"[[{key}]] number {i}", one) for i, one in enumerate(value, start=1)]
        else:
            raise InputError(
                f"{key!r} is not a table; use one per joint, e.g. [elbow] followed by effort = 87 "
                "and brake = 120 (N·m)"
            )
    return entries


def _csv_entries(text: str, columns: tuple[str, ...]) -> list[_Entry]:
    from ftforce.io.csv_table import Table  # not needed for the URDF's limits

    table = Table.of(text)
    header = [cell.lower() for cell in table.header] if table else []
    if not table or "joint" not in header or len(set(header) & set(_ALL_COLUMNS)) < len(header):
        hint = "; cells are separated by commas" if len(header) == 1 else ""
        optional = " (brake is optional)" if "brake" in columns else ""
        raise InputError(
            f"expected the header {','.join(columns)}{optional}, got {','.join(header)}{hint}"
        )
    return [(f"line {line}", dict(zip(header, cells, strict=True))) for line, cells in table.rows()]
