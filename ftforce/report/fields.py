"""Declaration of a result's values, from which JSON keys, CSV columns, labels and docs are made."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

Document: TypeAlias = dict[str, Any]
Row: TypeAlias = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Field:
    """One value of a result: what it is called, what it means, and how to get it.

    Attributes
    ----------
    key :
        JSON key and CSV column; the column adds the unit in brackets if there is exactly one.
    meaning, unit, shape :
        Columns of the tables in docs/reference. The shape also determines how values are written:
        ``name`` and ``names`` are joint indices, written as names of joints; ``by …`` is a vector
        of one entry per joint or a mapping, written as an object; ``m`` is a vector in task axes,
        in CSV one column per component; ``list`` is a sequence whose elements have the ``parts``.
        The parts of a field of another shape are described by that shape.
    get :
        Function of the result, or dotted path of attributes; by default the attribute ``key``.
        Where an attribute on the path is ``None``, so is the value.
    parts :
        Fields of the object that the value is, or of the elements of a list.
    symbol, label :
        Heading of a table's column, and name in a list of values; empty if tables do not show it.
    healthy :
        The same quantity of the healthy arm.
    optional :
        Whether JSON documents omit the key if there is no value.
    """

    key: str
    meaning: str = ""
    unit: str = ""
    shape: str = ""
    get: Callable[[Any], Any] | str = ""
    parts: tuple[Field, ...] = ()
    symbol: str = ""
    label: str = ""
    healthy: Callable[[Any], Any] | None = None
    optional: bool = False

    def value(self, result: Any) -> Any:
        """Return the value of this field in a result; ``None`` if there is no result."""
        if result is None:
            return None
        if callable(self.get):
            return self.get(result)
        for name in (self.get or self.key).split("."):
            result = None if result is None else getattr(result, name)
        return result

    @property
    def heading(self) -> str:
        """Name of the CSV column, with its unit."""
        return _heading(self.key, self.unit)


def whole(result: Any) -> Any:
    """Return the result itself: the parts of the field are its own."""
    return result


class _Missing:
    """An object whose every attribute is ``None``."""

    def __getattr__(self, name: str) -> None:
        return None


MISSING = _Missing()
"""In place of an object whose keys are written with the value ``null``."""


def constants(values: Mapping[str, str]) -> tuple[Field, ...]:
    """Return fields whose values are always the same, and are their own description."""
    return tuple(Field(key, text, get=partial(_first, text)) for key, text in values.items())


def _first(value: Any, _: Any) -> Any:
    return value


def under(path: str, fields: Iterable[Field]) -> tuple[Field, ...]:
    """Return fields of what is found at a path of attributes as fields of the object above it."""
    place = Field(path)
    return tuple(replace(one, get=partial(_through, place, one)) for one in fields)


def _through(place: Field, field: Field, result: Any) -> Any:
    return field.value(place.value(result))


def plain(value: Any) -> Any:
    """Return a value in JSON types; numbers that are infinite or NaN become ``None``."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, (list, tuple)) else value


def document(fields: Iterable[Field], result: Any, joints: Sequence[str] = ()) -> Document:
    """Return a result as a JSON document.

    Parameters
    ----------
    fields :
        The declaration of the result.
    result :
        The result.
    joints :
        Names of the joints, in the order of their indices.
    """
    values = ((field, field.value(result)) for field in fields)
    return {
        field.key: _member(field, value, joints)
        for field, value in values
        if not field.optional or value
    }


def _member(field: Field, value: Any, joints: Sequence[str]) -> Any:
    if value is None:
        return None
    if field.shape == "name":
        return joints[value]
    if field.shape == "names":
        return [joints[i] for i in value]
    if field.shape.startswith("by "):
        pairs = value.items() if isinstance(value, Mapping) else enumerate(value)
        return {joints[i] if isinstance(i, int) else i: plain(x) for i, x in pairs}
    if field.parts and field.shape.startswith("list"):
        return [document(field.parts, one, joints) for one in value]
    return document(field.parts, value, joints) if field.parts else plain(value)


def columns(
    fields: Iterable[Field],
    result: Any,
    joints: Sequence[str] = (),
    components: Mapping[str, str] = MappingProxyType({}),
    units: Sequence[str] = (),
) -> Document:
    """Return a result as one row of a CSV table, by column; parts become columns of their own.

    Parameters
    ----------
    fields, result, joints :
        As for `document`.
    components :
        Units of the task's components, for vectors in task axes.
    units :
        Units of the joints' torques, for torques by joint, each of which is a column.
    """
    record: Document = {}
    for field in fields:
        value = field.value(result)
        if field.parts:
            own = columns(field.parts, value, joints, components)
            names = (f"{field.key}_{name}".removesuffix("_value") for name in own)
            record |= zip((_heading(name, field.unit) for name in names), own.values(), strict=True)
        elif field.shape == "m":
            for i, (name, unit) in enumerate(components.items()):
                heading = _heading(f"{field.key}_{name}", "" if field.unit == "1" else unit)
                record[heading] = None if value is None else plain(value[i])
        elif field.shape == "by joint" and units:
            for i, (name, unit) in enumerate(zip(joints, units, strict=True)):
                heading = _heading(f"{field.key}_{name}", "" if field.unit == "1" else unit)
                record[heading] = None if value is None else plain(value[i])
        elif field.shape == "name" and value is not None:
            record[field.heading] = joints[value]
        elif field.shape == "names" and value is not None:
            record[field.heading] = " ".join(joints[i] for i in value)
        else:
            record[field.heading] = plain(value)
    return record


def _heading(name: str, unit: str) -> str:
    has_one = unit not in {"", "1"} and not {",", "`"} & set(unit)
    return f"{name} [{unit}]" if has_one else name


def rows_of(records: Iterable[Document]) -> list[Row]:
    """Return records as table rows, preceded by their keys as header; empty without records."""
    rows: list[Row] = []
    for record in records:
        if not rows:
            rows.append(tuple(record))
        rows.append(tuple(record.values()))
    return rows
