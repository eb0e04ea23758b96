"""Denavit–Hartenberg tables: reading, validation and forward kinematics.

Internally lengths are in metres and angles in radians; `read_dh_table` converts. Malformed values
raise ``InputError`` when a row, mass model or table is constructed. Conversion to URDF is in
:mod:`ftforce.robot.formats.dh_to_urdf`.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields
from itertools import chain, repeat
from pathlib import Path
from reprlib import repr as brief
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_vector, read_only
from ftforce.errors import DHTableError, InputError, UnknownNameError, listed
from ftforce.io.text import LARGEST_TOML, read_text, read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from os import PathLike

    from numpy.typing import ArrayLike

Convention: TypeAlias = Literal["standard", "modified"]
JointType: TypeAlias = Literal["revolute", "prismatic"]
Solid: TypeAlias = Literal["thin rod", "solid cylinder"]

BASE, TIP, TIP_JOINT = "base", "tool", "tool_joint"
FLANGE, FLANGE_JOINT = "flange", "flange_joint"
_MAX_ROWS = 148  # with base and tool, the depth of a URDF that can be loaded


@dataclass(frozen=True)
class DHRow:
    """One row of a DH table: joint i and the link that it moves.

    Attributes
    ----------
    a, alpha :
        Link length (m) and link twist (rad): of link i in the standard convention, of link i-1 in
        the modified one.
    d, theta :
        Offset (m) along and angle (rad) about the joint axis. The joint variable q is added to
        ``theta`` of a revolute joint and to ``d`` of a prismatic one.
    type :
        ``"revolute"`` or ``"prismatic"``.
    lower, upper :
        Limits of q (rad or m).
    effort, velocity :
        Maximum motor torque or force (N·m, N) and speed (rad/s, m/s); ``None`` if unknown.
    mass :
        Mass of the link (kg); ``None`` to compute it from the density of the mass model.
    joint, link :
        Names of joint and link; ``None`` for ``joint{i}``, ``link{i}``.
    centre :
        Centre of mass of the link in DH frame i (m), shape (3,); ``None`` for that of the solid.
    """

    a: float
    alpha: float
    d: float
    theta: float
    type: JointType
    lower: float
    upper: float
    effort: float | None = None
    velocity: float | None = None
    mass: float | None = None
    joint: str | None = None
    link: str | None = None
    centre: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        _check_choice(self.type, "type", JointType)
        for key in ("a", "alpha", "d", "theta", "lower", "upper"):
            _check_number(getattr(self, key), key)
        for key in ("effort", "velocity", "mass"):
            _check_positive(getattr(self, key), key)
        if self.lower > self.upper:
            lower, upper = self.with_unit(self.lower), self.with_unit(self.upper)
            raise InputError(f"lower = {lower} exceeds upper = {upper}")
        for key in ("joint", "link"):
            if getattr(self, key) is not None:
                _check_name(getattr(self, key), key)
        if self.centre is not None:
            object.__setattr__(self, "centre", _centre(self.centre))

    def with_unit(self, q: float) -> str:
        """Return a value of the joint variable as text, with its unit.

        Parameters
        ----------
        q :
            Joint variable, rad or m.
        """
        if self.type == "prismatic":
            return f"{q:.6g} m"
        return f"{q:.6g} rad ({math.degrees(q):.6g} deg)"


@dataclass(frozen=True)
class DHFlange:
    """The last row of a DH table if it has no joint: the constant transform to the tool.

    Attributes
    ----------
    a, alpha, d, theta :
        As in `DHRow`: m, rad.
    """

    a: float
    alpha: float
    d: float
    theta: float

    def __post_init__(self) -> None:
        for key in ("a", "alpha", "d", "theta"):
            _check_number(getattr(self, key), key)


@dataclass(frozen=True)
class MassModel:
    """The solid by which all links are modelled; `dh_to_urdf` computes its inertia.

    Attributes
    ----------
    model :
        ``"thin rod"`` or ``"solid cylinder"``.
    radius :
        Radius of all links (m), also used for the visual geometry in the URDF.
    density :
        Density (kg/m³) of the links whose row has no mass; ``None`` if all rows have one.
    """

    model: Solid
    radius: float
    density: float | None = None

    def __post_init__(self) -> None:
        _check_choice(self.model, "model", Solid)
        _check_number(self.radius, "radius")
        _check_positive(self.radius, "radius")
        _check_positive(self.density, "density")


@dataclass(frozen=True, eq=False)
class DHTable:
    """A validated DH table of a serial arm from link ``base`` to link ``tool``.

    Attributes
    ----------
    name :
        Name of the robot.
    convention :
        ``"standard"`` (Denavit & Hartenberg: frame i at the distal end of link i) or ``"modified"``
        (Craig: frame i on the axis of joint i).
    rows :
        One row per joint, from base to tip.
    mass :
        Mass model of the links; ``None`` if their masses are unknown.
    postures :
        Named joint positions, rad or m, shape (n,) each.
    source :
        File that the table was read from, or ``None``.
    flange :
        Constant transform from the last joint's frame to the tool; ``None`` if they coincide.
    """

    name: str
    convention: Convention
    rows: tuple[DHRow, ...]
    mass: MassModel | None = None
    postures: Mapping[str, Vector] = field(default_factory=dict)
    source: Path | None = None
    flange: DHFlange | None = None

    def __post_init__(self) -> None:
        _check_name(self.name, "name")
        _check_choice(self.convention, "convention", Convention)
        if not self.rows:
            raise InputError("rows is empty; a table needs one row per joint")
        if len(self.rows) > _MAX_ROWS:
            raise InputError(f"has {len(self.rows)} rows; at most {_MAX_ROWS} are supported")
        with_mass = [row.mass is not None for row in self.rows]
        if self.mass is None and any(with_mass):
            raise InputError(
                f"row {with_mass.index(True) + 1} has a mass, but the table mass is missing, which "
                "says how it is distributed (model, radius)"
            )
        with_centre = [row.centre is not None for row in self.rows]
        if self.mass is None and any(with_centre):
            raise InputError(
                f"row {with_centre.index(True) + 1} has a centre of mass, but the table mass is "
                "missing, which says how the mass is distributed (model, radius)"
            )
        if self.mass is not None and self.mass.density is None and not all(with_mass):
            where = _numbered([i for i, has_mass in enumerate(with_mass, start=1) if not has_mass])
            raise InputError(f"{where}: missing key 'mass' (or 'density' in the table mass)")
        joints = (TIP_JOINT,) if self.flange is None else (FLANGE_JOINT, TIP_JOINT)
        _check_distinct(*self.joint_names, *joints, *self.link_names)
        postures = {name: self._checked_posture(name, q) for name, q in self.postures.items()}
        object.__setattr__(self, "postures", MappingProxyType(postures))

    @staticmethod
    def from_toml(path: str | PathLike[str]) -> DHTable:
        """Read a DH table from a TOML file; ``robots/dh5.toml`` documents every key.

        Parameters
        ----------
        path :
            The TOML file.

        Raises
        ------
        DHTableError
            The file cannot be read or the table is malformed; the message names the row and key.
        """
        return read_dh_table(path)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, from base to tip."""
        return tuple(row.joint or f"joint{i}" for i, row in enumerate(self.rows, start=1))

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links: ``base``, one per joint, ``flange`` if there is one, ``tool``."""
        links = (row.link or f"link{i}" for i, row in enumerate(self.rows, start=1))
        return (BASE, *links, TIP) if self.flange is None else (BASE, *links, FLANGE, TIP)

    def transforms(self, q: ArrayLike) -> Matrix:
        """Return the poses of DH frames 0 to n, and of the flange, in the base frame.

        With Z = Rot_z(θ) Trans_z(d) and X = Rot_x(α) Trans_x(a), the transform of a row is Z X in
        the standard convention (Spong, Hutchinson & Vidyasagar, eq. 3.10) and X Z in the modified
        one (Craig, eq. 3.6).

        Parameters
        ----------
        q :
            Joint positions, shape (n,), rad or m.

        Returns
        -------
        :
            Homogeneous transforms, shape (n+1, 4, 4), or (n+2, 4, 4) with a flange; the last one is
            the tip.

        Raises
        ------
        InputError
            The number of joint positions is wrong, or one is not finite.
        """
        q = as_vector(q, len(self.rows), "q", "one per row")
        poses = [np.eye(4)]
        for row, variable in zip(self.rows, q.tolist(), strict=True):
            turn, shift = (variable, 0.0) if row.type == "revolute" else (0.0, variable)
            poses.append(poses[-1] @ self._step(row, turn, shift))
        if self.flange is not None:
            poses.append(poses[-1] @ self._step(self.flange, 0.0, 0.0))
        return read_only(np.array(poses))

    def _step(self, row: DHRow | DHFlange, turn: float, shift: float) -> Matrix:
        X, Z = _along_x(row.alpha, row.a), _along_z(row.theta + turn, row.d + shift)
        return Z @ X if self.convention == "standard" else X @ Z

    def _checked_posture(self, name: str, values: ArrayLike) -> Vector:
        _check_name(name, "posture name")
        q = as_vector(values, len(self.rows), f"posture {name!r}", "one per row")
        for joint, row, position in zip(self.joint_names, self.rows, q.tolist(), strict=True):
            if not row.lower <= position <= row.upper:
                shown, lower, upper = map(row.with_unit, (position, row.lower, row.upper))
                where = f"posture {name!r}: {joint} = {shown}"
                raise InputError(f"{where} is outside its limits {lower} to {upper}")
        return q


def cos_sin(angle: float) -> tuple[float, float]:
    """Return cosine and sine, exact at multiples of π/2 despite rounding of the angle."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return (0.0 if abs(cosine) < 1e-15 else cosine, 0.0 if abs(sine) < 1e-15 else sine)


def _along_x(alpha: float, a: float) -> Matrix:
    c, s = cos_sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def _along_z(theta: float, d: float) -> Matrix:
    c, s = cos_sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])


def _check_number(value: object, key: str) -> float:
    """Return a number as a float.

    Raises
    ------
    InputError
        The value is not a finite number; booleans are rejected.
    """
    # bool is a subclass of int in Python.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{key} needs a number, got {brief(value)}")
    if not abs(value) <= sys.float_info.max:
        raise InputError(f"{key} needs a finite number, got {brief(value)}")
    return float(value)


def _check_positive(value: float | None, key: str) -> None:
    if value is not None and _check_number(value, key) <= 0:
        raise InputError(f"{key} must be positive, got {value:g}")


def _centre(value: object) -> tuple[float, ...]:
    """Return a centre of mass as three finite numbers.

    Raises
    ------
    InputError
        It is no list of three finite numbers.
    """
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise InputError(f"centre needs three numbers [x, y, z], got {brief(value)}")
    return tuple(_check_number(number, "centre") for number in value)


def _check_choice(value: object, kind: str, choices: Any) -> None:
    """Check that a value is one of the choices of a ``Literal``.

    Raises
    ------
    UnknownNameError
        It is not; the message lists the allowed values.
    """
    if value not in get_args(choices):
        name = value if isinstance(value, str) else brief(value)
        raise UnknownNameError(kind, name, get_args(choices))


def _check_name(name: object, key: str) -> None:
    # XML forbids unprintable characters; leading or trailing blanks would be invisible.
    if not isinstance(name, str) or not name or not name.isprintable() or name != name.strip():
        raise InputError(
            f"{key} must be nonempty printable text without leading or trailing blanks, "
            f"got {brief(name)}"
        )


def _check_distinct(*names: str) -> None:
    # Links and joints share a namespace because Pinocchio looks up both as frames.
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"joint and link names must be unique; {twice[0]!r} appears twice")


def read_dh_table(path: str | PathLike[str]) -> DHTable:
    """Read a DH table from a TOML file; ``robots/dh5.toml`` documents every key.

    Raises
    ------
    DHTableError
        The file cannot be read or the table is malformed; the message names the row and key.
    """
    text = read_text(path, DHTableError, "a DH table", LARGEST_TOML)
    try:
        return DHTable(**_arguments_of_table(text), source=Path(path))
    except InputError as error:
        raise DHTableError(path, str(error)) from None


def _arguments_of_table(text: str) -> dict[str, Any]:
    content = read_toml(text)
    _check_missing(content)
    entries = _checked_keys(content, _TABLE, _OPTIONAL)
    with _within("units"):
        units = _units(entries.pop("units"))
    if "mass" in entries:
        with _within("mass"):
            solid = _arguments(MassModel, entries["mass"], text=("model",))
            if "radius" in solid:
                solid["radius"] = units.length(solid["radius"])
            entries["mass"] = MassModel(**solid)
    if "flange" in entries:
        with _within("flange"):
            entries["flange"] = _flange(entries["flange"], units)
    rows = _rows(entries["rows"], units)
    postures = _postures(entries.get("postures", {}), rows, units)
    return entries | {"rows": rows, "postures": postures}


class _Units(NamedTuple):
    """Conversions of a table's lengths and angles to m and rad."""

    length: Callable[[float], float]
    angle: Callable[[float], float]

    def of_joint(self, kind: object) -> Callable[[float], float]:
        """Return the conversion of a joint variable."""
        return self.length if kind == "prismatic" else self.angle


_TABLE, _OPTIONAL = ("name", "convention", "units", "rows"), ("mass", "postures", "flange")
_UNITS = ("length", "angle")


def _check_missing(content: Mapping[str, Any]) -> None:
    """Check that no table lacks a key.

    Raises
    ------
    InputError
        Keys are missing; the message names all of them, by table.
    """
    rows = content.get("rows")
    tables = [
        ("", content, _TABLE, _OPTIONAL),
        ("units", content.get("units"), _UNITS, ()),
        ("mass", content.get("mass"), *_keys(MassModel)),
        ("flange", content.get("flange"), *_keys(DHFlange)),
    ]
    for i, row in enumerate(rows if isinstance(rows, list) else (), start=1):
        tables.append((str(i), row, *_keys(DHRow)))
    lacking: dict[tuple[str, ...], list[str]] = {}
    for where, table, required, optional in tables:
        # A misspelt key is reported as such, not as a missing one.
        if isinstance(table, dict) and not set(table).difference(required, optional):
            missing = tuple(key for key in required if key not in table)
            lacking.setdefault(missing, []).append(where)
    lacking.pop((), None)
    if lacking:
        raise InputError("; ".join(_missing(*entry) for entry in lacking.items()))


def _missing(keys: tuple[str, ...], tables: list[str]) -> str:
    """Return a message about keys that tables lack; tables that are numbers are rows."""
    words = f"missing key{'s' if len(keys) > 1 else ''} {listed(map(repr, keys))}"
    rows = [int(table) for table in tables if table.isdecimal()]
    places = [table for table in tables if table and not table.isdecimal()]
    where = ", ".join((*places, *([_numbered(rows)] if rows else ())))
    return f"{where}: {words}" if where else words


def _numbered(rows: list[int]) -> str:
    return f"row{'s' if len(rows) > 1 else ''} {listed(map(str, rows))}"


def _units(entry: object) -> _Units:
    units = _checked_keys(entry, _UNITS)
    _check_choice(units["length"], "length unit", Literal["m", "mm"])
    _check_choice(units["angle"], "angle unit", Literal["deg", "rad"])
    return _Units(
        _from_millimetres if units["length"] == "mm" else float,
        math.radians if units["angle"] == "deg" else float,
    )


def _from_millimetres(length: float) -> float:
    return length / 1000.0  # exact to the last digit, unlike a product with 0.001


def _rows(entries: object, units: _Units) -> tuple[DHRow, ...]:
    if not isinstance(entries, list):
        raise InputError(f"rows must be a list with one table per joint, got {brief(entries)}")
    rows = []
    for i, entry in enumerate(entries, start=1):
        with _within(f"row {i}"):
            values = _arguments(DHRow, entry, text=("type", "joint", "link", "centre"))
            if "centre" in values:
                values["centre"] = tuple(map(units.length, _centre(values["centre"])))
            unit = units.of_joint(values["type"])
            converted = dict.fromkeys(("lower", "upper", "velocity"), unit)
            converted |= dict.fromkeys(("alpha", "theta"), units.angle)
            converted |= dict.fromkeys(("a", "d"), units.length)
            values |= {key: to(values[key]) for key, to in converted.items() if key in values}
            rows.append(DHRow(**values))
    return tuple(rows)


def _flange(entry: object, units: _Units) -> DHFlange:
    values = _arguments(DHFlange, entry, text=())
    lengths = {key: units.length(values[key]) for key in ("a", "d")}
    return DHFlange(**lengths, **{key: units.angle(values[key]) for key in ("alpha", "theta")})


def _postures(entries: object, rows: tuple[DHRow, ...], units: _Units) -> dict[str, list[float]]:
    if not isinstance(entries, dict):
        raise InputError(f"postures must be a table of named lists, got {brief(entries)}")
    postures = {}
    conversions = [units.of_joint(row.type) for row in rows]
    for name, values in entries.items():
        where = f"posture {name!r}"
        if not isinstance(values, list):
            raise InputError(f"{where} must be a list of numbers, got {brief(values)}")
        # DHTable rejects lists of the wrong length.
        with_units = zip(chain(conversions, repeat(float)), values, strict=False)
        postures[name] = [unit(_check_number(value, where)) for unit, value in with_units]
    return postures


def _arguments(
    kind: type[DHRow | DHFlange | MassModel], entry: object, text: tuple[str, ...]
) -> dict[str, Any]:
    """Return the values of a table, checked to be numbers except for the keys in ``text``."""
    values = _checked_keys(entry, *_keys(kind))
    return {
        key: value if key in text else _check_number(value, key) for key, value in values.items()
    }


def _keys(kind: type[DHRow | DHFlange | MassModel]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the required and the optional keys of a table."""
    required = tuple(f.name for f in fields(kind) if f.default is MISSING)
    return required, tuple(f.name for f in fields(kind) if f.default is not MISSING)


def _checked_keys(
    entry: object, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise InputError(f"expected a table with {listed(required)}; got {brief(entry)}")
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
