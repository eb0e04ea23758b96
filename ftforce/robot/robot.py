"""A robot arm: the chain from base to tip as a Pinocchio model, with joints numbered 1 to n."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import Vector, as_vector, read_only
from ftforce.core.display import Displayed
from ftforce.errors import InputError, UnknownNameError
from ftforce.io.text import split_items

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from xml.etree.ElementTree import Element

    import pinocchio as pin
    from numpy.typing import ArrayLike

    from ftforce.io.xml_text import XmlFile
    from ftforce.robot.coordinates import Coordinates

BUILT_IN_POSTURES = ("mid-range", "zero", "bent", "sample")
_BOOLS = (bool, np.bool_)


class JointUnits:
    """Units of a joint, by its type."""

    __slots__ = ()
    type: str

    @property
    def unit(self) -> str:
        """Unit of the joint position: rad, or m if prismatic."""
        return "m" if self.type == "prismatic" else "rad"

    @property
    def torque_unit(self) -> str:
        """Unit of the motor torque: N·m, or N if prismatic."""
        return "N" if self.type == "prismatic" else "N·m"


@dataclass(frozen=True, slots=True)
class Joint(JointUnits):
    """One joint of the chain.

    Attributes
    ----------
    number :
        Position along the chain, from 1.
    name :
        Name in the URDF.
    type :
        ``revolute``, ``continuous`` or ``prismatic``.
    lower, upper :
        Position limits in rad or m; infinite for a continuous joint.
    effort :
        Maximum motor torque in N·m (force in N if prismatic); ``None`` if unknown.
    velocity :
        Maximum speed in rad/s or m/s; ``None`` if unknown.
    friction :
        Static friction in N·m (N if prismatic); ``None`` if unknown.
    followers :
        Names of the mimic joints that follow it.
    damping :
        Viscous friction in N·m·s/rad (N·s/m if prismatic); ``None`` if unknown.
    armature :
        Rotor inertia reflected to the joint in kg·m² (kg if prismatic); ``None`` if unknown.
    """

    number: int
    name: str
    type: str
    lower: float
    upper: float
    effort: float | None
    velocity: float | None
    friction: float | None
    followers: tuple[str, ...] = ()
    damping: float | None = None
    armature: float | None = None


class Implausible(NamedTuple):
    """Warnings about numbers of an arm's URDF, by what depends on them.

    Attributes
    ----------
    efforts :
        About effort limits, on which capability and payload depend.
    masses :
        About masses, on which the weight depends.
    inertias :
        About moments of inertia, on which motion torques and velocities after a lock depend.
    """

    efforts: tuple[str, ...] = ()
    masses: tuple[str, ...] = ()
    inertias: tuple[str, ...] = ()

    def all(self) -> tuple[str, ...]:
        """Return all warnings."""
        return self.efforts + self.masses + self.inertias


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Displayed):
    """The kinematic chain of a URDF from base to tip.

    Joints outside the chain are fixed. Every joint has one position coordinate, including
    continuous joints; mimic joints move with their leader. Create robots with
    `ftforce.load_robot`.

    Attributes
    ----------
    name, path :
        Name of the robot and path of its URDF.
    tip, tip_source :
        Tip link, and how it was chosen.
    other_tips :
        Named tool frames fixed to the tip that could have been meant instead: distance in m and
        angle in rad from the tip, by link.
    base, base_source :
        Base link, and how it was chosen.
    joints :
        The n joints along the chain.
    model :
        Pinocchio model of the chain. Its continuous joints have two coordinates (cos, sin) and its
        mimic joints are independent; `to_model` converts.
    tip_frame :
        Frame index of the tip in ``model``.
    coordinates :
        Map between the n joint positions and the configuration of ``model``.
    postures :
        Named postures from the SRDF and the registry, rad or m, shape (n,).
    preferred :
        Names of the candidates for the default posture, in order.
    held :
        Movable joints outside the chain, with the position at which they are fixed (rad, m).
    fixed :
        Names of the joints that no single motor drives: fixed joints, and floating and planar
        joints, which are held fixed.
    mass :
        Mass of all links of the chain and of everything fixed to them, kg; 0 if the URDF has none.
    """

    name: str
    path: str
    tip: str
    tip_source: str
    other_tips: Mapping[str, tuple[float, float]]
    base: str
    base_source: str
    joints: tuple[Joint, ...]
    model: pin.Model
    tip_frame: int
    coordinates: Coordinates
    postures: Mapping[str, Vector]
    preferred: tuple[str, ...]
    held: Mapping[str, float]
    fixed: frozenset[str]
    mass: float
    _remarks: tuple[str, ...]
    _read_description: Callable[[], XmlFile]
    _find_tips: Callable[[], Mapping[str, int]]
    _find_implausible: Callable[[], Implausible]
    _per_thread: threading.local = field(default_factory=threading.local, init=False)

    @property
    def n(self) -> int:
        """Number of joints along the chain."""
        return len(self.joints)

    @cached_property
    def tips(self) -> Mapping[str, int]:
        """Candidate tip links, with the number of moving joints above each, best first."""
        return MappingProxyType(dict(self._find_tips()))

    @cached_property
    def implausible(self) -> Implausible:
        """Warnings about numbers of the URDF that no real arm has."""
        return self._find_implausible()

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user, on corrected limits, unusable postures and implausible numbers."""
        return (*self._remarks, *self.implausible.all())

    def description(self) -> Element:
        """Return the root element of the URDF, read or generated again, for its geometry.

        Raises
        ------
        FileError
            The file can no longer be read.
        """
        return self._read_description().root

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Joint names along the chain."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint position: rad or m."""
        return tuple(joint.unit for joint in self.joints)

    @cached_property
    def lower(self) -> Vector:
        """Lower position limits (rad, m), -inf for continuous joints, shape (n,)."""
        return read_only(np.array([joint.lower for joint in self.joints]))

    @cached_property
    def upper(self) -> Vector:
        """Upper position limits (rad, m), inf for continuous joints, shape (n,)."""
        return read_only(np.array([joint.upper for joint in self.joints]))

    @cached_property
    def gravity(self) -> Vector:
        """Gravity of the model in root axes, m/s², shape (3,)."""
        return read_only(self.model.gravity.linear.copy())

    @cached_property
    def at_rest(self) -> Vector:
        """Zero joint velocities or accelerations, shape (n,)."""
        return read_only(np.zeros(self.n))

    @cached_property
    def ranges(self) -> tuple[Vector, Vector]:
        """Finite bounds within which positions are drawn, rad or m, each of shape (n,).

        These are the limits; ±π for a joint without limits, and 2π from a single one.
        """
        lower, upper = self.lower, self.upper
        below, above = np.isfinite(lower), np.isfinite(upper)
        first = np.where(above, upper - 2.0 * math.pi, -math.pi)
        last = np.where(below, lower + 2.0 * math.pi, math.pi)
        return read_only(np.where(below, lower, first)), read_only(np.where(above, upper, last))

    @cached_property
    def effort(self) -> Vector:
        """Effort limits (N·m, N), NaN where unknown, shape (n,)."""
        return _known(joint.effort for joint in self.joints)

    @cached_property
    def friction(self) -> Vector:
        """Static (Coulomb) friction of the joints (N·m, N), NaN where unknown, shape (n,)."""
        return _known(joint.friction for joint in self.joints)

    @cached_property
    def damping(self) -> Vector:
        """Viscous friction of the joints (N·m·s/rad, N·s/m), NaN where unknown, shape (n,)."""
        return _known(joint.damping for joint in self.joints)

    @cached_property
    def armature(self) -> Vector:
        """Rotor inertias reflected to the joints (kg·m², kg), NaN where unknown, shape (n,)."""
        return _known(joint.armature for joint in self.joints)

    @property
    def data(self) -> pin.Data:
        """Pinocchio data of ``model``, one per thread (creating one takes 14 µs)."""
        try:
            return self._per_thread.data
        except AttributeError:
            self._per_thread.data = self.model.createData()
            return self._per_thread.data

    def to_model(self, q: Vector) -> Vector:
        """Return the Pinocchio configuration for given joint positions, shape (model.nq,).

        Parameters
        ----------
        q :
            Joint positions along the chain, rad or m, shape (n,).
        """
        return self.coordinates.to_model(q)

    def vector(self, x: ArrayLike, name: str) -> Vector:
        """Return one value per joint of the chain as a validated vector, shape (n,).

        Parameters
        ----------
        x :
            The values.
        name :
            Name of the values, for error messages.

        Raises
        ------
        InputError
            The values are not n finite numbers.
        """
        return as_vector(x, self.n, name, f"one per joint, {self.numbered()}")

    def index(self, joint: int | str) -> int:
        """Return the index (from 0) of a joint given by number or name.

        Parameters
        ----------
        joint :
            Joint number along the chain, from 1, or joint name.

        Raises
        ------
        InputError
            The chain has no such joint; the message lists its joints.
        """
        if type(joint) is int or (
            isinstance(joint, (int, np.integer)) and not isinstance(joint, bool)
        ):
            if not 1 <= joint <= self.n:
                raise InputError(
                    f"joint number {joint} is out of range; the chain has: {self.numbered()}"
                )
            return int(joint) - 1
        if not isinstance(joint, str):
            raise InputError(f"a joint is given by number (1 to {self.n}) or name, got {joint!r}")
        return self._index_of_word(joint if joint in self.names else joint.strip())

    def _index_of_word(self, word: str) -> int:
        named = self.names.index(word) if word in self.names else None
        if (number := _as_number(word)) is not None:
            if named is not None and named + 1 != number:
                raise InputError(
                    f"{word!r} is ambiguous: it is the name of joint {named + 1} and a joint "
                    f"number; the chain has: {self.numbered()}"
                )
            return self.index(number)
        if named is not None:
            return named
        for joint in self.joints:
            if word in joint.followers:
                raise InputError(
                    f"joint {word!r} mimics {joint.name!r}; give {joint.name!r} instead"
                )
        if word in self.held:
            raise InputError(
                f"joint {word!r} lies outside the chain from {self.base!r} to {self.tip!r} and is "
                f"held fixed; the chain has: {self.numbered()}"
            )
        if word in self.fixed:
            raise InputError(
                f"joint {word!r} is held fixed and has no motor that could fail; "
                f"the chain has: {self.numbered()}"
            )
        raise UnknownNameError("joint", word, self.names, f"in the chain of {self.name!r}")

    def indices(self, joints: Iterable[int | str] | str | int) -> tuple[int, ...]:
        """Return the sorted indices (from 0) of joints given by numbers, names or a mask.

        Parameters
        ----------
        joints :
            Joint numbers (from 1) and names in any combination, a string such as ``"2,elbow"``, or
            a boolean mask of shape (n,).

        Raises
        ------
        InputError
            A joint does not exist or is named twice, an item of a string is empty, or the mask
            has the wrong length.
        """
        if isinstance(joints, tuple) and not joints:
            return ()
        if isinstance(joints, str):
            given: list[int | str] = [joints] if joints in self.names else [*split_items(joints)]
        elif np.iterable(joints):
            given = list(joints)
        else:
            given = [joints]
        if given and isinstance(given[0], _BOOLS) and all(isinstance(j, _BOOLS) for j in given):
            if len(given) != self.n:
                raise InputError(
                    f"a joint mask needs {self.n} entries, one per joint, got {len(given)}"
                )
            return tuple(i for i, failed in enumerate(given) if failed)
        indices = [self.index(joint) for joint in given]
        if len(set(indices)) < len(indices):
            i = next(i for i in indices if indices.count(i) > 1)
            raise InputError(f"joint {i + 1} ({self.names[i]}) appears twice")
        return tuple(sorted(indices))

    def numbered(self) -> str:
        """Return the numbered joint names, e.g. ``1 shoulder, 2 elbow``."""
        return self._numbered

    @cached_property
    def _numbered(self) -> str:
        return ", ".join(f"{joint.number} {joint.name}" for joint in self.joints)

    def __repr__(self) -> str:
        """Return name, chain and number of joints."""
        return f"<Robot {self.name!r}: {self.n} joints, {self.base!r} → {self.tip!r}>"

    def __getstate__(self) -> dict[str, Any]:
        """Drop the per-thread data and convert mapping proxies, which cannot be pickled.

        What is found on demand is found before, so that the tree is left behind.
        """
        state = {**self.__dict__, "tips": self.tips, "implausible": self.implausible}
        left = {"_per_thread", "_find_tips", "_find_implausible"}
        state = {k: v for k, v in state.items() if k not in left}
        return {k: dict(v) if isinstance(v, MappingProxyType) else v for k, v in state.items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state, with no per-thread data."""
        views = {k: MappingProxyType(v) if isinstance(v, dict) else v for k, v in state.items()}
        self.__dict__.update(views, _per_thread=threading.local())


def _known(values: Iterable[float | None]) -> Vector:
    """Return one value per joint, NaN where it is unknown."""
    return read_only(np.array([math.nan if value is None else value for value in values]))


def _as_number(word: str) -> int | None:
    """Return the joint number given as text, or ``None`` if it is a name."""
    digits = word[1:] if word.startswith(("-", "+")) else word
    is_number = digits.isascii() and digits.isdigit() and len(digits) < 10
    return int(word) if is_number else None


def require_robot(robot: object) -> None:
    """Check that an argument is a robot, for all functions that take one.

    Parameters
    ----------
    robot :
        The argument.

    Raises
    ------
    InputError
        It is something else; the message says how a robot is loaded, and what takes a Jacobian.
    """
    if isinstance(robot, Robot):
        return
    if isinstance(robot, (str, PathLike)):
        advice = f"load it, e.g. ftforce.load_robot({str(robot)!r})"
        raise InputError(f"a robot is needed, not the name {str(robot)!r}: {advice}")
    shape = getattr(robot, "shape", None)
    given = f"an array of shape {shape}" if shape is not None else f"{type(robot).__name__}"
    raise InputError(
        f"a robot is needed, as of ftforce.load_robot('panda'), got {given}; for a Jacobian from "
        "any library, use ftforce.remap(J, tau, locked) or ftforce.Remapper(m=3, n=7, faults=...)"
    )
