"""Faults: which joints fail, and how; sets of them, and all sets up to a size (eq. 12-13)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from ftforce.arrays import Mask, read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class FaultMode(StrEnum):
    """How a joint fails."""

    LOCKED = "locked"
    """The brake holds the joint and its motor commands nothing (the paper's fault)."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One failed joint.

    Attributes
    ----------
    joint :
        Index along the chain, from 0.
    mode :
        How it fails.
    """

    joint: int
    mode: FaultMode = FaultMode.LOCKED


@dataclass(frozen=True, slots=True)
class FaultSet:
    """Faults that occur together, in the order of the joints. Prints as ``{2, 4}``."""

    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        """Sort the faults.

        Raises
        ------
        InputError
            A joint fails twice, or an index is negative.
        """
        object.__setattr__(
            self, "faults", tuple(sorted(self.faults, key=lambda fault: fault.joint))
        )
        if any(fault.joint < 0 for fault in self.faults):
            raise InputError("joint indices count from 0")
        for one, other in zip(self.faults, self.faults[1:], strict=False):
            if one.joint == other.joint:
                raise InputError(f"joint {one.joint + 1} is named twice in one fault set")

    @classmethod
    def locked(cls, joints: Iterable[int]) -> FaultSet:
        """Return the set in which these joints (indices from 0) are locked."""
        return cls(tuple(Fault(int(joint)) for joint in joints))

    @property
    def joints(self) -> tuple[int, ...]:
        """Indices of the failed joints, from 0."""
        return tuple(fault.joint for fault in self.faults)

    def mask(self, n: int) -> Mask:
        """Return True at the locked joints, shape (n,).

        Raises
        ------
        InputError
            A joint lies beyond the chain's n.
        """
        mask = np.zeros(n, dtype=np.bool_)
        for joint in self.joints:
            if joint >= n:
                raise InputError(f"joint {joint + 1} is out of range; the chain has {n} joints")
            mask[joint] = True
        return read_only(mask)

    def __len__(self) -> int:
        return len(self.faults)

    def __str__(self) -> str:
        """Numbers along the chain, counted from 1."""
        return "{" + ", ".join(str(joint + 1) for joint in self.joints) + "}"


def fault_sets(n: int, largest: int) -> Iterator[FaultSet]:
    """Yield every set of 1 to ``largest`` locked joints of n, small sets first (eq. 12-13)."""
    for size in range(1, largest + 1):
        for joints in combinations(range(n), size):
            yield FaultSet.locked(joints)


def count_fault_sets(n: int, largest: int) -> int:
    """Return how many sets `fault_sets` yields."""
    return sum(comb(n, size) for size in range(1, largest + 1))
