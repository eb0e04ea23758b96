"""Torque limits from the URDF, or from a TOML, YAML or CSV file.

YAML files are those of MoveIt and ros2_control (``joint_limits.yaml``), with ``max_effort`` and
``has_effort_limits`` per joint, or have the keys of the other two.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.core.limits import DriveTerms, Limits, TorqueSpeedLine
from ftforce.errors import DimensionError, InputError, LimitsError, listed, printable
from ftforce.io.text import LARGEST_TOML, read_numbers, read_text, read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot

URDF, NONE = "urdf", "none"
_COLUMNS = ("joint", "effort", "brake")
_FRICTION_COLUMNS = ("joint", "friction")
_LARGEST_YAML = 100_000  # bytes; the parser takes a second for them
_SIDES = ("effort_min", "effort_max")
_LINE = ("stall_torque", "no_load_speed")
_TERMS = ("friction", "damping", "armature")
_TORQUE = "N·m or N"
_UNITS = {
    "no_load_speed": "rad/s or m/s",
    "damping": "N·m·s/rad or N·s/m",
    "armature": "kg·m² or kg",
}
_ALL_COLUMNS = (*_COLUMNS, *_SIDES, *_LINE, *_TERMS)
_SMALLEST = 1e-9  # N·m or N: smaller values are input errors and vanish in rounding
_KIND = "a TOML, YAML or CSV file of limits (joint, effort, brake)"
_FRICTION_KIND = "a TOML, YAML or CSV file of friction (joint, friction)"
_ENDINGS = (".toml", ".yaml", ".yml", ".csv")
_POSITION = ("position", "velocity", "acceleration", "deceleration", "jerk")
_IGNORED = frozenset(
    [f"{kind}_{x}" for kind in ("min", "max") for x in _POSITION]
    + [f"has_{x}_limits" for x in (*_POSITION, "soft")]
    + ["soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity", "angle_wraparound"]
)  # keys of MoveIt and ros2_control that say nothing of torques
_WORDS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}

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
        ``urdf``, the path of a TOML, YAML or CSV file, `Limits`, or ``none`` (``None``) for no
        limits.

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
            "limits are 'urdf', 'none', a TOML, YAML or CSV file or ftforce.core.limits.Limits (of "
            f"an array: Limits.of(effort)), got {limits!r}"
        )
    if limits == NONE:
        return None
    if limits == URDF:
        return Limits(robot.effort, read_only(np.full(robot.n, np.nan)), URDF)
    return read_limits(robot, limits)


def read_limits(robot: Robot, path: str | os.PathLike[str]) -> Limits:
    """Read torque limits from a TOML, YAML or CSV file.

    Limits of joints or columns that the file omits are unknown, even if the URDF has them.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file; its extension is ``.toml``, ``.yaml``, ``.yml`` or ``.csv``.

    Raises
    ------
    LimitsError
        As in `choose_limits`.
    """

    def fill(entries: Sequence[_Entry]) -> Limits:
        notes: list[str] = []
        own = list(_joint_entries(robot, entries, notes))
        return _limits_of(robot, own, str(path), tuple(notes))

    return _read(path, "'urdf', 'none' or ", _KIND, _COLUMNS, fill)


def read_friction(robot: Robot, path: str | os.PathLike[str]) -> Vector:
    """Read the friction of joints from a file, N·m or N, NaN where unknown, shape (n,).

    The file may hold limits too.

    Parameters
    ----------
    robot :
        The arm.
    path :
        The file; its extension is ``.toml``, ``.yaml``, ``.yml`` or ``.csv``.

    Raises
    ------
    LimitsError
        The file cannot be read, names a joint that the arm does not have, or contains a negative
        value.
    """

    def fill(entries: Sequence[_Entry]) -> Vector:
        friction = np.full(robot.n, np.nan)
        for i, where, entry in _joint_entries(robot, entries, []):
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
    fill: Callable[[Sequence[_Entry]], _Read],
) -> _Read:
    """Return what ``fill`` makes of the entries of a file; ``words``: what else could be given."""
    ending = Path(path).suffix.lower()
    if ending not in _ENDINGS:
        raise LimitsError(path, f"expected {words}{kind} ending in .toml, .yaml, .yml or .csv")
    most = {".toml": LARGEST_TOML, ".csv": None}.get(ending, _LARGEST_YAML)
    text = read_text(path, LimitsError, kind, most)
    try:
        if ending == ".csv":
            return fill(_csv_entries(text, columns))
        return fill(_toml_entries(text) if ending == ".toml" else _yaml_entries(text))
    except InputError as problem:
        raise LimitsError(path, printable(problem)) from None


def _limits_of(
    robot: Robot, own: list[tuple[int, str, Mapping[str, Any]]], source: str, notes: tuple[str, ...]
) -> Limits:
    """Return the limits of the joints that a file names."""
    found = {key: np.full(robot.n, np.nan) for key in ("lower", "upper", "brake", *_LINE, *_TERMS)}
    for i, where, entry in own:
        of = f"of {robot.names[i]}"
        found["lower"][i], found["upper"][i] = _effort(entry, where, of)
        for key in ("brake", *_LINE):
            unit = _UNITS.get(key, _TORQUE)
            found[key][i] = _limit(entry.get(key), f"{where}: {key} {of}", unit)
        if math.isnan(found["stall_torque"][i]) != math.isnan(found["no_load_speed"][i]):
            raise InputError(f"{where}: a torque-speed line needs both {' and '.join(_LINE)}")
        for key in _TERMS:
            unit = _UNITS.get(key, _TORQUE)
            found[key][i] = _number(entry.get(key), f"{where}: {key} {of}", unit=unit)
    known = {key for key, values in found.items() if not np.isnan(values).all()}
    if not known & {"upper", "brake", "stall_torque"}:
        raise InputError(
            "contains no torque limits, the only ones that are read; expected "
            f"{', '.join(_COLUMNS)} for each joint"
        )
    lower, upper, brake = (read_only(found[key]) for key in ("lower", "upper", "brake"))
    line = TorqueSpeedLine.of(*(found[key] for key in _LINE)) if known & set(_LINE) else None
    terms = DriveTerms(*(read_only(found[key]) for key in _TERMS)) if known & set(_TERMS) else None
    is_symmetric = np.array_equal(lower, -upper, equal_nan=True)
    below = None if is_symmetric else lower
    return Limits(upper, brake, source, below, line, terms, notes)


def _effort(entry: Mapping[str, Any], where: str, of: str) -> tuple[float, float]:
    """Return the lower and the upper effort limit of a joint, NaN where unknown."""
    one, (least, most) = entry.get("effort"), (entry.get(key) for key in _SIDES)
    if _is_empty(least) and _is_empty(most):
        if not isinstance(one, list):
            limit = _limit(one, f"{where}: effort {of}")
            return -limit, limit
        if len(one) != 2:
            raise InputError(
                f"{where}: effort {of} is one number or two, [lower, upper], got {one}"
            )
        least, most = one
    elif not _is_empty(one):
        raise InputError(f"{where}: give either effort {of} or {' and '.join(_SIDES)}")
    below = _number(least, f"{where}: lower effort {of}", "a negative number")
    above = _number(most, f"{where}: upper effort {of}", "a positive number")
    if not (below <= -_SMALLEST and above >= _SMALLEST):
        raise InputError(
            f"{where}: effort {of} needs a negative lower and a positive upper limit, N·m or N, "
            f"got {least!r} and {most!r}"
        )
    return below, above


def _is_empty(value: object) -> bool:
    return value is None or (isinstance(value, str) and not value.strip())


def _joint_entries(
    robot: Robot, entries: Sequence[_Entry], notes: list[str]
) -> Iterator[tuple[int, str, Mapping[str, Any]]]:
    """Yield the joint, the place in the file and the content of every entry, and note the rest."""
    seen, outside = dict[int, str](), list[str]()
    for where, entry in entries:
        _check_keys(where, entry)
        name = entry["joint"]
        if isinstance(entry, _WholeRobot):
            if _is_outside(robot, name):
                outside.append(name)
                continue
            name = _full_name(robot, name)
        try:
            i = robot.index(name)
        except InputError as problem:
            raise InputError(f"{where}: {problem}") from None
        if i in seen:
            raise InputError(
                f"{where}: joint {i + 1} ({robot.names[i]}) already appears in {seen[i]}"
            )
        seen[i] = where
        yield i, where, entry
    if outside:
        notes.append(f"limits of joints outside the chain are ignored: {listed(outside)}")


def _is_outside(robot: Robot, name: str) -> bool:
    """Return whether a joint of the robot is none of the chain's."""
    followers = {follower for joint in robot.joints for follower in joint.followers}
    return name not in robot.names and name in {*robot.held, *robot.fixed, *followers}


def _full_name(robot: Robot, name: str) -> str:
    """Return the name of a joint: some files leave out its end, ``_joint``."""
    return f"{name}_joint" if name not in robot.names and f"{name}_joint" in robot.names else name


def _check_keys(where: str, entry: Mapping[str, Any]) -> None:
    for key, value in entry.items():
        if key not in _ALL_COLUMNS:
            quotes = "; a name with a dot needs quotes" if isinstance(value, dict) else ""
            known = ", ".join(_ALL_COLUMNS)
            raise InputError(f"{where}: unknown key {key!r}; available: {known}{quotes}")
    if "joint" not in entry:
        raise InputError(f"{where}: no joint given")


def _number(
    value: object, what: str, wanted: str = "a number of at least 0", unit: str = _TORQUE
) -> float:
    """Return a number; NaN if the value is empty."""
    if _is_empty(value):
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(f"{what} must be {wanted}, {unit}, got {value!r}")
    try:
        number = read_numbers(str(value), 1)[0]
    except ValueError as problem:
        raise InputError(f"{what}: {problem}; omit it if unknown") from None
    if wanted.endswith("0") and number < 0.0:
        raise InputError(f"{what} must be {wanted}, {unit}, got {number:g}")
    return number


def _limit(value: object, what: str, unit: str = _TORQUE) -> float:
    """Return a limit; NaN if the value is empty."""
    limit = _number(value, what, "a positive number", unit)
    if limit < _SMALLEST:
        hint = f"limits below {_SMALLEST:g} are not accepted"
        if limit <= 0.0:
            hint = "limits apply in both directions" if limit < 0.0 else "omit it if unknown"
        raise InputError(f"{what} must be a positive number, {unit}, got {limit + 0.0:g}; {hint}")
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


# ---- YAML --------------------------------------------------------------------------------------


class _WholeRobot(dict[str, Any]):
    """Entry of a file for a whole robot, which may name joints outside the arm."""


def _yaml_entries(text: str) -> list[_Entry]:
    """Return the entries of ``joint_limits``, or of one mapping per joint."""
    from ftforce.io.yaml_text import read_yaml  # not needed for the URDF's limits

    content = read_yaml(text)
    if not isinstance(content, dict):
        raise InputError("contains no mapping; expected joint_limits: followed by the joints")
    joints = _joint_limits(content)
    if joints is None:
        joints = {k: v for k, v in content.items() if not k.startswith("default_")}
    if not isinstance(joints, dict):
        raise InputError("joint_limits is not a mapping; expected the joints by name")
    return [(name, _yaml_entry(name, entry)) for name, entry in joints.items()]


def _joint_limits(content: Mapping[str, Any]) -> Any:
    """Return what ``joint_limits`` holds, at the top or within the parameters of ROS nodes."""
    if "joint_limits" in content:
        return content["joint_limits"]
    inner = (x for x in content.values() if isinstance(x, dict))
    return next((found for x in inner if (found := _joint_limits(x)) is not None), None)


def _yaml_entry(name: str, entry: object) -> _WholeRobot:
    """Return one joint with the keys of TOML and CSV files."""
    if not isinstance(entry, dict):
        raise InputError(
            f"{name}: is not a mapping; use one per joint, e.g. {name}: {{max_effort: 87}}"
        )
    known = {key: value for key, value in entry.items() if key not in _IGNORED}
    has_limits = _yaml_flag(name, known.pop("has_effort_limits", None))
    least, most = known.pop("min_effort", None), known.pop("max_effort", None)
    if has_limits and most is None and not {"effort", *_SIDES} & set(known):
        raise InputError(f"{name}: has_effort_limits is true, but there is no max_effort")
    if most is not None and has_limits is not False:
        if "effort" in known:
            raise InputError(f"{name}: give either effort or max_effort")
        known["effort"] = most if least is None else [least, most]
    elif least is not None and has_limits is not False:
        raise InputError(f"{name}: min_effort needs max_effort beside it")
    return _WholeRobot(joint=name, **known)


def _yaml_flag(name: str, value: object) -> bool | None:
    if value is None:
        return None
    if not isinstance(value, str) or value.lower() not in _WORDS:
        raise InputError(f"{name}: has_effort_limits is true or false, got {value!r}")
    return _WORDS[value.lower()]
