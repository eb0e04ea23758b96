"""Position limits of joints: the arm's own, or artificial ones within them, from and to files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.errors import InputError, LimitsError, printable
from ftforce.io.text import LARGEST_TOML, read_text, read_toml

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.core.arrays import Matrix
    from ftforce.robot.robot import Robot

RangesLike: TypeAlias = (
    "JointRanges | Mapping[str, Any] | ArrayLike | str | os.PathLike[str] | None"
)

OWN = "the arm's own"
_TURN = 2.0 * math.pi
_ROUNDING = 1e-9
FORMATS = ("toml", "yaml", "yml")
_LARGEST_YAML = 2**20
_KEYS = {"lower": "lower", "upper": "upper", "min_position": "lower", "max_position": "upper"}
_IGNORED = frozenset({"has_position_limits"})


@dataclass(frozen=True, eq=False)
class JointRanges:
    """Limits within which joints move.

    Attributes
    ----------
    robot :
        The arm.
    swept :
        Lower and upper limits, rad or m, shape (n, 2); one turn for a hinge that turns freely.
    source :
        Where they come from.
    """

    robot: Robot
    swept: Matrix
    source: str

    @classmethod
    def of(cls, robot: Robot, given: RangesLike = None) -> JointRanges:
        """Return the limits of an arm, or artificial ones within them.

        Parameters
        ----------
        robot :
            The arm.
        given :
            A TOML or YAML file; lower and upper limits by joint, or of shape (n, 2), rad or m;
            ``None`` for the arm's own.

        Raises
        ------
        InputError
            The limits do not fit the arm, or lie outside its own.
        LimitsError
            The file cannot be read, or does not fit the arm.
        """
        own = np.column_stack(robot.ranges)
        if given is None:
            return cls(robot, read_only(own), OWN)
        if isinstance(given, cls):
            if given.robot.n != robot.n:
                raise InputError(f"the limits are of {given.robot.n} joints, the arm has {robot.n}")
            return given
        if isinstance(given, (str, os.PathLike)):
            return _read(robot, own, given)
        if isinstance(given, Mapping):
            return cls(robot, _of_joints(robot, own, given), "given")
        try:
            values = np.array(given, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.zeros(0)
        if values.shape != (robot.n, 2):
            raise InputError(
                f"limits are {robot.n} pairs of a lower and an upper one, one per joint, "
                f"{robot.numbered()}"
            )
        return cls(robot, _checked(robot, own, values), "given")

    def own(self) -> JointRanges:
        """Return the limits of the arm itself."""
        return JointRanges.of(self.robot)

    @property
    def limits(self) -> Matrix:
        """The limits, infinite for a hinge that turns freely, rad or m, shape (n, 2)."""
        turns = np.array([joint.type != "prismatic" for joint in self.robot.joints])
        free = turns & (self.swept[:, 1] - self.swept[:, 0] >= _TURN - _ROUNDING)
        return read_only(np.where(free[:, None], [-np.inf, np.inf], self.swept))

    @property
    def by_joint(self) -> dict[str, tuple[float, float]]:
        """Lower and upper limit by the name of the joint, rad or m."""
        return {
            name: (low, high)
            for name, (low, high) in zip(self.robot.names, self.swept.tolist(), strict=True)
        }

    def to_text(self, form: str) -> str:
        """Return the limits as TOML, or as YAML for MoveIt.

        Parameters
        ----------
        form :
            ``toml``, ``yaml`` or ``yml``.
        """
        return self._toml() if form == "toml" else self._yaml()

    def _toml(self) -> str:
        lines = [f"# Position limits of {printable(self.robot.name)}, rad (m if prismatic).", ""]
        for name, (low, high) in self.by_joint.items():
            lines += [f"[{_quoted(name)}]", f"lower = {low!r}", f"upper = {high!r}", ""]
        return "\n".join(lines)

    def _yaml(self) -> str:
        lines = ["joint_limits:"]
        for name, (low, high) in self.by_joint.items():
            lines += [
                f"  {_quoted(name)}:",
                "    has_position_limits: true",
                f"    min_position: {low!r}",
                f"    max_position: {high!r}",
            ]
        return "\n".join([*lines, ""])


def _quoted(name: str) -> str:
    """Return a name as a key of TOML and YAML."""
    import json

    return json.dumps(name, ensure_ascii=True)


def _read(robot: Robot, own: Matrix, path: str | os.PathLike[str]) -> JointRanges:
    ending = Path(path).suffix.lower()
    if ending.removeprefix(".") not in FORMATS:
        raise LimitsError(path, "expected position limits ending in .toml, .yaml or .yml")
    most = LARGEST_TOML if ending == ".toml" else _LARGEST_YAML
    text = read_text(path, LimitsError, "position limits", most)
    try:
        content = read_toml(text) if ending == ".toml" else _yaml_content(text)
        return JointRanges(robot, _of_joints(robot, own, _entries(content)), str(path))
    except InputError as problem:
        raise LimitsError(path, printable(problem)) from None


def _yaml_content(text: str) -> Mapping[str, Any]:
    from ftforce.io.yaml_text import read_yaml

    content = read_yaml(text)
    if not isinstance(content, dict):
        raise InputError("contains no mapping; expected joint_limits: followed by the joints")
    inner = content.get("joint_limits", content)
    if not isinstance(inner, dict):
        raise InputError("joint_limits is not a mapping; expected the joints by name")
    return inner


def _entries(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the lower and upper limit of each joint of a file."""
    found = {}
    for name, entry in content.items():
        if not isinstance(entry, dict):
            raise InputError(f"{name}: expected lower and upper, rad or m, got {entry!r}")
        ends = {_KEYS[key]: value for key, value in entry.items() if key in _KEYS}
        unknown = [key for key in entry if key not in _KEYS and key not in _IGNORED]
        if unknown:
            raise InputError(f"{name}: unknown key {unknown[0]!r}; available: lower, upper")
        if len(ends) < 2:
            raise InputError(f"{name}: lower and upper are both needed, rad or m")
        found[name] = (ends["lower"], ends["upper"])
    return found


def _of_joints(robot: Robot, own: Matrix, given: Mapping[str, Any]) -> Matrix:
    """Return limits given by joint; those of other joints are the arm's own."""
    values = own.copy()
    for name, ends in given.items():
        i = robot.index(name)
        try:
            low, high = (float(end) for end in ends)
        except (TypeError, ValueError):
            raise InputError(
                f"limits of {name}: expected a lower and an upper one, rad or m, got {ends!r}"
            ) from None
        values[i] = low, high
    return _checked(robot, own, values)


def _checked(robot: Robot, own: Matrix, values: Matrix) -> Matrix:
    """Return limits that are checked to lie within the arm's own."""
    for joint, (low, high), (least, most) in zip(
        robot.joints, values.tolist(), own.tolist(), strict=True
    ):
        of, unit = f"limits of {joint.name}", joint.unit
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"{of} must be finite, {unit}, got {low} to {high}")
        if low > high:
            raise InputError(f"{of}: the lower one, {low:g}, is above the upper one, {high:g}")
        if low < least - _ROUNDING or high > most + _ROUNDING:
            raise InputError(
                f"{of} must lie within the arm's own, {least:.6g} to {most:.6g} {unit}, got "
                f"{low:.6g} to {high:.6g}"
            )
    return read_only(np.clip(values, own[:, :1], own[:, 1:]))
