"""Joint faults, fault sets, and the enumeration of fault sets up to a size (eq. 12-13)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import combinations
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.core.arrays import Mask, Vector, read_only
from ftforce.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from collections.abc import Iterator


class FaultMode(StrEnum):
    """How a joint fails."""

    LOCKED = "locked"
    """The brake holds the joint and the motor produces no torque (the paper's fault)."""
    FREE = "free"
    """The joint is free-swinging: neither motor nor brake applies any torque."""
    WEAK = "weak"
    """The motor produces at most a fraction of its maximum torque."""

    @classmethod
    def parse(cls, mode: str) -> FaultMode:
        """Return the fault mode with the given name.

        Parameters
        ----------
        mode :
            ``locked``, ``free`` or ``weak``.

        Raises
        ------
        UnknownNameError
            There is no such mode.
        """
        try:
            return cls(mode)
        except ValueError:
            raise UnknownNameError("fault mode", mode, list(cls)) from None


@dataclass(frozen=True, slots=True)
class Fault:
    """One failed joint.

    Attributes
    ----------
    joint :
        Index along the chain, from 0.
    mode :
        Fault mode.
    factor :
        Fraction of its maximum torque that a weak joint can still produce, 0 to 1; 1 in other
        modes.
    """

    joint: int
    mode: FaultMode = FaultMode.LOCKED
    factor: float = 1.0

    def __post_init__(self) -> None:
        """Check mode and factor; the mode may be given by name.

        Raises
        ------
        InputError
            The joint is not an integer, the mode is unknown, the factor does not lie between 0 and
            1, or a joint that is not weak has a factor other than 1.
        """
        if type(self.mode) is not FaultMode:
            object.__setattr__(self, "mode", FaultMode.parse(self.mode))
        if not _is_index(self.joint):
            raise InputError(f"a joint index must be an integer from 0, got {self.joint!r}")
        if not _is_share(self.factor):
            raise InputError(
                f"the factor of weak joint {self.joint + 1} must lie between 0 (no torque) and 1 "
                f"(full torque), got {self.factor}"
            )
        if self.mode is not FaultMode.WEAK and self.factor != 1.0:
            raise InputError(f"only a weak joint has a factor; joint {self.joint + 1} is {self}")

    @property
    def is_free(self) -> bool:
        """Whether the joint is free-swinging: free, or weak with factor 0."""
        return self.mode is FaultMode.FREE or self.factor == 0.0

    def __str__(self) -> str:
        """Return the mode, with the factor if the joint is weak."""
        return f"weak {self.factor:g}" if self.mode is FaultMode.WEAK else self.mode.value


@dataclass(frozen=True, slots=True)
class FaultSet:
    """A set of simultaneous faults, in joint order.

    Prints as ``{2, 4}``, or as ``{2 locked, 4 free}`` if not all joints are locked.

    Attributes
    ----------
    faults :
        The faults, sorted by joint.
    """

    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        """Sort the faults.

        Raises
        ------
        InputError
            Something is not a fault, a joint fails twice, or an index is negative.
        """
        given: object = self.faults
        try:
            if type(given) is not tuple:
                object.__setattr__(self, "faults", _as_tuple(given))
            joints = [fault.joint for fault in self.faults]
        except (AttributeError, TypeError):
            raise InputError(f"a fault set needs faults, got {given!r}") from None
        if not joints:
            return
        if joints != sorted(joints):
            object.__setattr__(self, "faults", tuple(sorted(self.faults, key=_joint_of)))
        if min(joints) < 0:
            raise InputError(f"joint indices start at 0, got {min(joints)}")
        if len(set(joints)) < len(joints):
            self._raise_repeated()

    def _raise_repeated(self) -> None:
        for one, other in zip(self.faults, self.faults[1:], strict=False):
            if one.joint == other.joint:
                number = one.joint + 1
                if one.mode is other.mode:
                    raise InputError(f"joint {number} appears twice in the fault set")
                raise InputError(
                    f"joint {number} cannot be both {one.mode} and {other.mode}; "
                    f"a joint fails in only one mode"
                )

    @classmethod
    def locked(cls, joints: Iterable[int]) -> FaultSet:
        """Return the fault set in which the given joints are locked.

        Parameters
        ----------
        joints :
            Joint indices, from 0.
        """
        return cls.all_of(FaultMode.LOCKED, joints)

    @classmethod
    def all_of(cls, mode: FaultMode, joints: Iterable[int]) -> FaultSet:
        """Return the fault set in which all given joints fail in the same mode.

        Parameters
        ----------
        mode :
            Fault mode; weak joints get factor 1.
        joints :
            Joint indices, from 0.
        """
        return cls(tuple(Fault(int(joint), mode) for joint in joints))

    @property
    def joints(self) -> tuple[int, ...]:
        """Indices of the failed joints, from 0."""
        return tuple([fault.joint for fault in self.faults])

    def in_mode(self, mode: FaultMode) -> tuple[int, ...]:
        """Return the indices of the joints that fail in the given mode, from 0.

        Parameters
        ----------
        mode :
            Fault mode.
        """
        return tuple([fault.joint for fault in self.faults if fault.mode is mode])

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free-swinging joints (free, or weak with factor 0), from 0."""
        return tuple([fault.joint for fault in self.faults if fault.is_free])

    def mask(self, n: int) -> Mask:
        """Return a mask that is True at locked joints, shape (n,).

        Parameters
        ----------
        n :
            Number of joints of the chain.

        Raises
        ------
        InputError
            A joint index is n or more.
        """
        self._check_range(n)
        return _mask(n, self.in_mode(FaultMode.LOCKED))

    def free_mask(self, n: int) -> Mask | None:
        """Return a mask that is True at free-swinging joints, shape (n,); ``None`` without any.

        Parameters
        ----------
        n :
            Number of joints of the chain.

        Raises
        ------
        InputError
            A joint index is n or more.
        """
        self._check_range(n)
        joints = self.free
        return _mask(n, joints) if joints else None

    def factors(self, n: int) -> Vector:
        """Return the fraction of its maximum torque that each joint can produce, shape (n,).

        Parameters
        ----------
        n :
            Number of joints of the chain.

        Raises
        ------
        InputError
            A joint index is n or more.
        """
        self._check_range(n)
        factors = np.ones(n)
        for fault in self.faults:
            factors[fault.joint] = 0.0 if fault.is_free else fault.factor
        return read_only(factors)

    def _check_range(self, n: int) -> None:
        if self.faults and (last := self.faults[-1].joint) >= n:
            raise InputError(f"joint {last + 1} is out of range; the chain has {n} joints")

    def __len__(self) -> int:
        return len(self.faults)

    def __str__(self) -> str:
        """Return the joint numbers, from 1, with the modes unless all are locked."""
        plain = all(fault.mode is FaultMode.LOCKED for fault in self.faults)
        words = (f"{f.joint + 1}" if plain else f"{f.joint + 1} {f}" for f in self.faults)
        return "{" + ", ".join(words) + "}"


def fault_sets(n: int, largest: int, mode: FaultMode = FaultMode.LOCKED) -> Iterator[FaultSet]:
    """Yield every set of 1 to ``largest`` failed joints of n, small sets first (eq. 12-13).

    Parameters
    ----------
    n :
        Number of joints of the chain.
    largest :
        Size of the largest sets.
    mode :
        Fault mode of all failed joints.
    """
    faults = [Fault(joint, mode) for joint in range(n)]
    for size in range(1, largest + 1):
        yield from map(FaultSet, combinations(faults, size))


def count_fault_sets(n: int, largest: int) -> int:
    """Return the number of sets that `fault_sets` yields.

    Parameters
    ----------
    n, largest :
        As in `fault_sets`.
    """
    return sum(comb(n, size) for size in range(1, largest + 1))


def _is_share(factor: float) -> bool:
    try:
        return 0.0 <= factor <= 1.0  # also rejects NaN
    except TypeError:
        return False


def _is_index(joint: object) -> bool:
    return joint.__class__ is int or isinstance(joint, np.integer)


def _as_tuple(faults: object) -> tuple[Any, ...]:
    """Return what a list or a generator holds; an empty text is not an empty list."""
    if isinstance(faults, str) or not isinstance(faults, Iterable):
        raise TypeError
    return tuple(faults)


def _joint_of(fault: Fault) -> int:
    return fault.joint


@lru_cache(maxsize=1024)
def _mask(n: int, joints: tuple[int, ...]) -> Mask:
    mask = [False] * n
    for joint in joints:
        mask[joint] = True
    return read_only(np.array(mask))
