"""A robot arm: the chain base → tip of a URDF as a Pinocchio model, joints numbered 1..n."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.core.arrays import Vector, read_only
from ftforce.core.display import Displayed
from ftforce.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import pinocchio as pin

    from ftforce.robot.coordinates import Coordinates

BUILT_IN_POSTURES = ("mid-range", "zero", "sample")


class JointUnits:
    """Units of a joint of some type."""

    __slots__ = ()
    type: str

    @property
    def unit(self) -> str:
        """Unit of its position."""
        return "m" if self.type == "prismatic" else "rad"

    @property
    def torque_unit(self) -> str:
        """Unit of its motor torque, or motor force if prismatic."""
        return "N" if self.type == "prismatic" else "N·m"


@dataclass(frozen=True, slots=True)
class Joint(JointUnits):
    """One joint of the chain.

    Attributes
    ----------
    number :
        Position along the chain, from 1.
    name :
        The URDF's.
    type :
        ``revolute``, ``continuous`` or ``prismatic``.
    lower, upper :
        Position limits in rad or m; infinite for a continuous joint.
    effort :
        Largest motor torque in N·m (force in N if prismatic); ``None`` if unknown.
    velocity :
        Largest speed in rad/s or m/s; ``None`` if unknown.
    followers :
        Names of the mimic joints that move with it.
    """

    number: int
    name: str
    type: str
    lower: float
    upper: float
    effort: float | None
    velocity: float | None
    followers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Displayed):
    """The chain base → tip of a URDF.

    Joints outside the chain are fixed at their posture, so they never count; each joint takes one
    number, continuous ones too; a mimic joint moves with its leader. Made by
    `ftforce.load_robot`.

    Attributes
    ----------
    name, path :
        The robot's name and its URDF.
    tip, tip_source :
        Tip link, and what singled it out.
    base, base_source :
        Base link, and what singled it out.
    joints :
        The n joints along the chain.
    model :
        Pinocchio model of the chain (its continuous joints take cos and sin, and its mimic joints
        are free: `to_model` converts).
    tip_frame :
        Frame index of the tip in ``model``.
    coordinates :
        Between the chain's n numbers and the model's.
    postures :
        Named postures: SRDF states and the registry's, shape (n,), rad or m.
    preferred :
        Names of the postures that are tried, in this order, when none is asked for.
    held :
        Joints outside the chain that can move, with the value they are fixed at (rad, m).
    fixed :
        Names of the joints without a motor: fixed, and floating and planar ones, which are held.
    tips :
        Links that could be a tip, with the number of moving joints above them.
    mass :
        Mass of all links of the chain and what is fixed to it, kg; 0 if the URDF has none.
    notes :
        What a user should know: corrections, states that could not be used, …
    """

    name: str
    path: str
    tip: str
    tip_source: str
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
    tips: Mapping[str, int]
    mass: float
    notes: tuple[str, ...]
    _per_thread: threading.local = field(default_factory=threading.local, init=False)

    @property
    def n(self) -> int:
        """Number of joints along the chain."""
        return len(self.joints)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Joint names along the chain."""
        return tuple(joint.name for joint in self.joints)

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
        """The model's gravity in the root's axes, m/s², shape (3,)."""
        return read_only(self.model.gravity.linear.copy())

    @cached_property
    def at_rest(self) -> Vector:
        """No velocity, and no acceleration, of any joint, shape (n,)."""
        return read_only(np.zeros(self.n))

    @cached_property
    def effort(self) -> Vector:
        """Effort limits (N·m, N), NaN where unknown, shape (n,)."""
        known = (math.nan if joint.effort is None else joint.effort for joint in self.joints)
        return read_only(np.array(list(known)))

    @property
    def data(self) -> pin.Data:
        """Pinocchio's workspace for ``model``, one per thread (making one costs 14 µs)."""
        try:
            return self._per_thread.data
        except AttributeError:
            self._per_thread.data = self.model.createData()
            return self._per_thread.data

    def to_model(self, q: Vector) -> Vector:
        """Return Pinocchio's configuration of the chain's n numbers, shape (model.nq,)."""
        return self.coordinates.to_model(q)

    def index(self, joint: int | str) -> int:
        """Return the index (from 0) of a joint given by number (from 1) or name.

        Raises
        ------
        InputError
            No such joint; the message says which there are, or what kind of joint it is.
        """
        if isinstance(joint, (int, np.integer)) and not isinstance(joint, (bool, np.bool_)):
            if not 1 <= joint <= self.n:
                raise InputError(
                    f"joint number {joint} is out of range; the chain has: {self.numbered()}"
                )
            return int(joint) - 1
        if not isinstance(joint, str):
            raise InputError(f"a joint is a number from 1 to {self.n} or a name, got {joint!r}")
        return self._index_of_word(joint if joint in self.names else joint.strip())

    def _index_of_word(self, word: str) -> int:
        named = self.names.index(word) if word in self.names else None
        if (number := _as_number(word)) is not None:
            if named is not None and named + 1 != number:
                raise InputError(
                    f"{word!r} could be joint number {number} or the joint of that name, which is "
                    f"number {named + 1}; the chain has: {self.numbered()}"
                )
            return self.index(number)
        if named is not None:
            return named
        for joint in self.joints:
            if word in joint.followers:
                raise InputError(f"joint {word!r} mimics {joint.name!r}; name that one instead")
        if word in self.held:
            raise InputError(
                f"joint {word!r} lies outside the chain from {self.base!r} to {self.tip!r} and is "
                f"held fixed; the chain has: {self.numbered()}"
            )
        if word in self.fixed:
            raise InputError(
                f"joint {word!r} is held fixed: it has no motor that could fail; "
                f"the chain has: {self.numbered()}"
            )
        raise UnknownNameError("joint", word, self.names, f"in the chain of {self.name!r}")

    def indices(self, joints: Iterable[int | str] | str | int) -> tuple[int, ...]:
        """Return the indices (from 0) of joints given by numbers, names or a boolean mask.

        Parameters
        ----------
        joints :
            Numbers from 1 and names in any mixture, a text such as ``"2,elbow"``, or a mask of
            shape (n,).

        Raises
        ------
        InputError
            A joint does not exist, is named twice, or the mask has another length.
        """
        if isinstance(joints, (str, tuple)) and not joints:
            return ()
        if isinstance(joints, str):
            words = [joints] if joints in self.names else joints.split(",")
            given: list[int | str] = [word for word in words if word.strip()]
        elif np.iterable(joints):
            given = list(joints)
        else:
            given = [joints]
        if given and all(isinstance(joint, (bool, np.bool_)) for joint in given):
            if len(given) != self.n:
                raise InputError(f"a mask needs {self.n} values, one per joint, got {len(given)}")
            return tuple(i for i, failed in enumerate(given) if failed)
        indices = [self.index(joint) for joint in given]
        for i in indices:
            if indices.count(i) > 1:
                raise InputError(f"joint {i + 1} ({self.names[i]}) is named twice")
        return tuple(sorted(indices))

    def numbered(self) -> str:
        """Return the joints as text, e.g. ``1 shoulder, 2 elbow``."""
        return self._numbered

    @cached_property
    def _numbered(self) -> str:
        return ", ".join(f"{joint.number} {joint.name}" for joint in self.joints)

    def __repr__(self) -> str:
        """Return name, chain and number of joints."""
        return f"<Robot {self.name!r}: {self.n} joints, {self.base!r} → {self.tip!r}>"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the per-thread workspace behind when pickled; mapping views cannot be pickled."""
        state = {k: v for k, v in self.__dict__.items() if k != "_per_thread"}
        return {k: dict(v) if isinstance(v, MappingProxyType) else v for k, v in state.items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore and start with an empty workspace."""
        views = {k: MappingProxyType(v) if isinstance(v, dict) else v for k, v in state.items()}
        self.__dict__.update(views, _per_thread=threading.local())


def _as_number(word: str) -> int | None:
    """Return a joint number that was given as text, ``None`` if it is a name."""
    digits = word[1:] if word.startswith(("-", "+")) else word
    is_number = digits.isascii() and digits.isdigit() and len(digits) < 10
    return int(word) if is_number else None
