"""A payload with its own inertia, from a TOML file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ftforce.errors import InputError, PayloadError, printable
from ftforce.io.text import LARGEST_TOML, read_text, read_toml
from ftforce.robot.dynamics import MOMENTS, Payload

if TYPE_CHECKING:
    import os

_KIND = "a TOML file of a payload (mass, centre, inertia)"
_KEYS = ("mass", "centre", "inertia")
_EXAMPLE = "mass = 2.5, centre = [0, 0, 0.1] and inertia = [ixx, iyy, izz, ixy, ixz, iyz]"


def read_payload_file(path: str | os.PathLike[str]) -> Payload:
    """Read a payload from a TOML file.

    Parameters
    ----------
    path :
        The file: ``mass`` (kg), ``centre`` (centre of mass in tip axes, m; by default the tip), and
        ``inertia`` about the centre in tip axes (kg·m²; by default none), a list
        ``[ixx, iyy, izz, ixy, ixz, iyz]`` or a table with these keys, of which the last three are
        0 if they are left out.

    Raises
    ------
    PayloadError
        The file cannot be read, or what it describes is no rigid body.
    """
    text = read_text(path, PayloadError, _KIND, LARGEST_TOML)
    try:
        return _payload_of(read_toml(text))
    except InputError as problem:
        raise PayloadError(path, printable(problem)) from None


def _payload_of(content: dict[str, Any]) -> Payload:
    for key in content:
        if key not in _KEYS:
            raise InputError(f"unknown key {printable(repr(key))}; available: {', '.join(_KEYS)}")
    if "mass" not in content:
        raise InputError(f"contains no mass; expected e.g. {_EXAMPLE}")
    inertia = content.get("inertia")
    if isinstance(inertia, dict):
        if not set(MOMENTS[:3]) <= set(inertia) <= set(MOMENTS):
            needed, further = ", ".join(MOMENTS[:3]), ", ".join(MOMENTS[3:])
            raise InputError(f"inertia needs the keys {needed}; {further} are 0 if left out")
        inertia = [inertia.get(key, 0.0) for key in MOMENTS]
    return Payload.of(content["mass"], content.get("centre", (0.0, 0.0, 0.0)), inertia)
