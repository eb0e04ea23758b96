"""Where the postures of a sweep come from: what they share; postures on a grid, and given ones.

Any block can be asked for, in any order and on any machine, and the numbers are the same: a sweep
is cut into chunks, stopped and taken up again. Random postures are drawn in `drawn`, files read in
`files`, beside this module.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ftforce.core.arrays import as_floats, check_finite, is_number, read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

MOST = 2**63 - 1  # postures; their indices are 64-bit integers


class Postures(Protocol):
    """A sequence of postures that is never in memory as a whole; it can be pickled."""

    @property
    def count(self) -> int:
        """Number of postures."""

    @property
    def n(self) -> int:
        """Number of joints."""

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, the caller's own.

        Returns
        -------
        :
            Joint positions, rad or m, shape (stop - start, n), C-contiguous.

        Raises
        ------
        InputError
            There are no such postures.
        """

    def identity(self) -> dict[str, Any]:
        """Return what can be written as JSON and is the same for the same postures only."""


def checked_block(start: int, stop: int, count: int) -> tuple[int, int]:
    """Return a block that lies within the postures, as integers that cannot overflow.

    Raises
    ------
    InputError
        It does not.
    """
    if not 0 <= start <= stop <= count:
        raise InputError(f"the block {start} to {stop} does not lie within 0 to {count}")
    return int(start), int(stop)


def ranges_of(robot: Robot) -> tuple[Vector, Vector]:
    """Return where positions are drawn, rad or m, two arrays of shape (n,).

    Raises
    ------
    InputError
        A prismatic joint without limits.
    """
    limited = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    for joint, has_limits in zip(robot.joints, limited.tolist(), strict=True):
        if joint.type == "prismatic" and not has_limits:
            raise InputError(
                f"joint {joint.number} ({joint.name}) slides without limits: give it some in the "
                "URDF, or give the postures"
            )
    lower, upper = np.where(limited, robot.lower, -math.pi), np.where(limited, robot.upper, math.pi)
    return read_only(lower), read_only(upper)


def whole_number(value: float, name: str, least: int) -> int:
    """Return a whole number from ``least``, which may be written as 1e6.

    Raises
    ------
    InputError
        It is none, or beyond 2**63 - 1.
    """
    if not is_number(value) or value != int(value) or not least <= value <= MOST:
        raise InputError(f"{name} is a whole number from {least} to 2**63 - 1, got {value!r}")
    return int(value)


def digest_of(array: Any) -> str:
    """Return the SHA-256 of an array's bytes."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


# ---- on a grid -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Grid:
    """Postures on a grid, the last joint varying fastest. `of` checks what it is given.

    Attributes
    ----------
    lower, upper :
        First and last position of each joint, rad or m, finite, shape (n,).
    counts :
        How many positions each joint takes; the middle one if 1.
    """

    lower: Vector
    upper: Vector
    counts: tuple[int, ...]

    @classmethod
    def of(cls, robot: Robot, counts: int | Sequence[int]) -> Grid:
        """Lay a grid from limit to limit; over the circle, once, for continuous joints.

        Parameters
        ----------
        robot :
            The arm.
        counts :
            How many positions each joint takes, one number for all or one per joint.

        Raises
        ------
        InputError
            No such counts, too many postures, or a prismatic joint without limits.

        Examples
        --------
        >>> import ftforce
        >>> print(Grid.of(ftforce.load_robot("dh5"), [1, 3, 3, 3, 1]))
        27 postures on a grid of 1 x 3 x 3 x 3 x 1
        """
        given = counts if np.iterable(counts) else [counts] * robot.n
        numbers = tuple(whole_number(count, "the positions of a joint", 1) for count in given)
        if len(numbers) != robot.n:
            raise InputError(
                f"a grid needs {robot.n} numbers of positions, got {len(numbers)}; "
                f"the chain has: {robot.numbered()}"
            )
        if math.prod(numbers) > MOST:
            raise InputError(f"a grid of {math.prod(numbers):.3g} postures is beyond 2**63 - 1")
        lower, upper = ranges_of(robot)
        endless = (lower != robot.lower) | (upper != robot.upper)
        circle = endless & (np.array(numbers) > 1)  # both ends are the same
        gap = np.where(circle, (upper - lower) / np.array(numbers), 0.0)
        return cls(lower, read_only(upper - gap), numbers)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.counts)

    @property
    def count(self) -> int:
        """Number of postures."""
        return math.prod(self.counts)

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`."""
        start, stop = checked_block(start, stop, self.count)
        q = np.empty((stop - start, self.n))
        stride = 1  # for how many postures on end the joint rests
        for joint in reversed(range(self.n) if stop > start else ()):
            first, last = start // stride, (stop - 1) // stride
            points = self._positions(joint, np.arange(first, last + 1) % self.counts[joint])
            rests = np.full(len(points), stride)
            rests[0] -= start - first * stride
            rests[-1] -= stride - 1 - (stop - 1 - last * stride)
            q[:, joint] = np.repeat(points, rests)
            stride *= self.counts[joint]
        return q

    def _positions(self, joint: int, steps: Any) -> Vector:
        lower, upper, last = self.lower[joint], self.upper[joint], self.counts[joint] - 1
        if not last:
            return np.full(len(steps), 0.5 * (lower + upper))
        q: Vector = np.where(steps == last, upper, lower + steps * ((upper - lower) / last))
        return q

    def identity(self) -> dict[str, Any]:
        """Return the grid's numbers."""
        return {
            "source": "grid",
            "counts": list(self.counts),
            "lower": self.lower.tolist(),
            "upper": self.upper.tolist(),
        }

    def __str__(self) -> str:
        """Return number of postures and positions."""
        return f"{self.count:,} postures on a grid of {' x '.join(map(str, self.counts))}"


# ---- listed ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Listed:
    """Postures that were given. `of` checks them.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (k, n).
    """

    q: Matrix

    @classmethod
    def of(cls, robot: Robot, q: ArrayLike) -> Listed:
        """Check postures and wrap a copy.

        Parameters
        ----------
        robot :
            The arm.
        q :
            Joint positions along the chain, rad or m, shape (k, n), k >= 1.

        Raises
        ------
        InputError
            Another shape, or not finite.
        """
        values = as_floats(q, "q")
        if values.ndim != 2 or values.shape[1] != robot.n or not len(values):
            raise InputError(
                f"postures need an array of shape k x {robot.n}, one row per posture and one "
                f"column per joint, got the shape {values.shape}: {robot.numbered()}"
            )
        check_finite(values, "q")
        return cls(read_only(np.ascontiguousarray(values)))

    @property
    def count(self) -> int:
        """Number of postures."""
        return len(self.q)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`."""
        start, stop = checked_block(start, stop, self.count)
        return self.q[start:stop].copy()

    def identity(self) -> dict[str, Any]:
        """Return shape and SHA-256 of the numbers."""
        return {"source": "given", "shape": list(self.q.shape), "sha256": digest_of(self.q)}

    def __str__(self) -> str:
        """Return their number."""
        return f"{self.count:,} given posture{'s' if self.count > 1 else ''}"
