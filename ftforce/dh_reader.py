"""DH tables from TOML files; `ftforce.robot.formats.dh` checks the values, and knows no file."""

from __future__ import annotations

import math
import tomllib
from contextlib import contextmanager
from dataclasses import MISSING, fields
from itertools import chain, repeat
from pathlib import Path
from reprlib import repr as brief
from typing import TYPE_CHECKING, Any, Literal

from ftforce.errors import DHTableError, InputError, UnknownNameError, listed
from ftforce.io.text import read_text
from ftforce.robot.formats.dh import DHRow, DHTable, MassModel, check_choice, check_number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from os import PathLike


def read_dh_table(path: str | PathLike[str]) -> DHTable:
    """Read a DH table; ``robots/dh5.toml`` shows and explains every key.

    Raises
    ------
    DHTableError
        The file cannot be read or the table is malformed; the message names the row and key.
    """
    text = read_text(path, DHTableError, "a DH table")
    try:
        return DHTable(**_arguments_of_table(text), source=Path(path))
    except InputError as error:
        raise DHTableError(path, str(error)) from None


def _arguments_of_table(text: str) -> dict[str, Any]:
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not TOML: {error}") from None
    required = ("name", "convention", "units", "rows", "mass")
    entries = _checked_keys(content, required, ("postures",))
    with _within("units"):
        angle = _angle_unit(entries.pop("units"))
    with _within("mass"):
        mass = MassModel(**_arguments(MassModel, entries["mass"], text=("model",)))
    rows = _rows(entries["rows"], angle)
    postures = _postures(entries.get("postures", {}), rows, angle)
    return entries | {"rows": rows, "mass": mass, "postures": postures}


def _angle_unit(entry: object) -> Callable[[float], float]:
    units = _checked_keys(entry, ("length", "angle"))
    check_choice(units["length"], "length unit", Literal["m"])
    check_choice(units["angle"], "angle unit", Literal["deg", "rad"])
    return math.radians if units["angle"] == "deg" else float


def _rows(entries: object, angle: Callable[[float], float]) -> tuple[DHRow, ...]:
    if not isinstance(entries, list):
        raise InputError(f"rows needs a list with one table per joint, got {brief(entries)}")
    rows = []
    for i, entry in enumerate(entries, start=1):
        with _within(f"row {i}"):
            values = _arguments(DHRow, entry, text=("type", "joint", "link"))
            own = ("lower", "upper", "velocity") if values["type"] == "revolute" else ()
            angles = {key: angle(values[key]) for key in ("alpha", "theta", *own) if key in values}
            rows.append(DHRow(**(values | angles)))
    return tuple(rows)


def _postures(
    entries: object, rows: tuple[DHRow, ...], angle: Callable[[float], float]
) -> dict[str, list[float]]:
    if not isinstance(entries, dict):
        raise InputError(f"postures needs a table of named lists, got {brief(entries)}")
    postures = {}
    units = [angle if row.type == "revolute" else float for row in rows]
    for name, values in entries.items():
        where = f"posture {name!r}"
        if not isinstance(values, list):
            raise InputError(f"{where} needs a list of numbers, got {brief(values)}")
        # A list that is too long or too short is for DHTable to refuse.
        with_units = zip(chain(units, repeat(float)), values, strict=False)
        postures[name] = [unit(check_number(value, where)) for unit, value in with_units]
    return postures


def _arguments(
    kind: type[DHRow | MassModel], entry: object, text: tuple[str, ...]
) -> dict[str, Any]:
    required = [f.name for f in fields(kind) if f.default is MISSING]
    optional = [f.name for f in fields(kind) if f.default is not MISSING]
    values = _checked_keys(entry, required, optional)
    return {
        key: value if key in text else check_number(value, key) for key, value in values.items()
    }


def _checked_keys(
    entry: object, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise InputError(f"needs a table with {listed(required)}; got {brief(entry)}")
    known = (*required, *optional)
    for key in entry:
        if key not in known:
            raise UnknownNameError("key", key, known)
    for key in required:
        if key not in entry:
            raise InputError(f"missing key {key!r}")
    return entry


@contextmanager
def _within(where: str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
