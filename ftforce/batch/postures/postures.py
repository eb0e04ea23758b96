"""The protocol of posture sources, and postures on a grid or listed explicitly.

Blocks can be requested in any order and on any machine with identical results, since a sweep is
split into chunks, interrupted and resumed. Random postures are in `drawn`, files in `files`.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ftforce.core.arrays import as_floats, check_finite, is_number, read_only
from ftforce.errors import InputError
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

_MAX_COUNT = 2**63 - 1  # postures; their indices are 64-bit integers


class Postures(Protocol):
    """A sequence of postures, never completely in memory; picklable."""

    @property
    def count(self) -> int:
        """Number of postures."""

    @property
    def n(self) -> int:
        """Number of joints."""

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, in a new array.

        Parameters
        ----------
        start, stop :
            Half-open range of indices, from 0.

        Returns
        -------
        :
            Joint positions, rad or m, shape (stop - start, n), C-contiguous.

        Raises
        ------
        InputError
            The range is invalid.
        """

    def identity(self) -> dict[str, Any]:
        """Return a JSON-compatible dictionary that identifies the postures uniquely."""


def checked_block(start: int, stop: int, count: int) -> tuple[int, int]:
    """Check a range of postures, and return it as Python integers, which cannot overflow.

    Parameters
    ----------
    start, stop :
        Half-open range of indices, from 0.
    count :
        Number of postures.

    Raises
    ------
    InputError
        The range is not within the postures.
    """
    if not 0 <= start <= stop <= count:
        raise InputError(
            f"block {start} to {stop} is outside the range 0 to {count} of the postures"
        )
    return int(start), int(stop)


def ranges_of(robot: Robot) -> tuple[Vector, Vector]:
    """Return the bounds within which positions are drawn, rad or m, two arrays of shape (n,).

    Raises
    ------
    InputError
        A prismatic joint has no limits.
    """
    below, above = np.isfinite(robot.lower), np.isfinite(robot.upper)
    for joint, has_lower, has_upper in zip(robot.joints, below, above, strict=True):
        if joint.type == "prismatic" and not (has_lower and has_upper):
            missing = "position limits"
            if has_lower or has_upper:
                missing = "upper position limit" if has_lower else "lower position limit"
            raise InputError(
                f"prismatic joint {joint.number} ({joint.name}) has no {missing}; add "
                f"{'them' if missing[-1] == 's' else 'it'} to the URDF, or provide the postures"
            )
    return robot.ranges


def whole_number(value: float, name: str, minimum: int) -> int:
    """Return an integer, which may be given as a float such as 1e6.

    Parameters
    ----------
    value :
        The number.
    name :
        What it is, for the message.
    minimum :
        Smallest valid value.

    Raises
    ------
    InputError
        It is not an integer, too small, or above 2**63 - 1.
    """
    if not is_number(value) or value != int(value) or not minimum <= value <= _MAX_COUNT:
        raise InputError(f"{name} must be an integer from {minimum} to 2**63 - 1, got {value!r}")
    return int(value)


def digest_of(array: Any) -> str:
    """Return the SHA-256 of an array's bytes."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


# ---- on a grid -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Grid:
    """Postures on a grid, with the last joint varying fastest; made by `of`.

    Attributes
    ----------
    lower, upper :
        First and last position of each joint, rad or m, finite, shape (n,).
    counts :
        Number of positions of each joint; a single one lies at the middle of the range.
    """

    lower: Vector
    upper: Vector
    counts: tuple[int, ...]

    @classmethod
    def of(cls, robot: Robot, counts: int | Sequence[int]) -> Grid:
        """Return a grid between the joint limits; a full turn for continuous joints.

        Parameters
        ----------
        robot :
            The arm.
        counts :
            Number of positions, one for all joints or one per joint.

        Raises
        ------
        InputError
            Invalid counts, too many postures, or a prismatic joint without limits.

        Examples
        --------
        >>> import ftforce
        >>> print(Grid.of(ftforce.load_robot("dh5"), [1, 3, 3, 3, 1]))
        27 postures on a grid of 1 x 3 x 3 x 3 x 1
        """
        require_robot(robot)
        given = counts if np.iterable(counts) else [counts] * robot.n
        numbers = tuple(
            whole_number(count, "the number of positions of a joint", 1) for count in given
        )
        if len(numbers) != robot.n:
            raise InputError(
                f"expected one number of positions, or one for each of the {robot.n} joints "
                f"({robot.numbered()}), got {len(numbers)}"
            )
        if math.prod(numbers) > _MAX_COUNT:
            raise InputError(
                f"a grid of {math.prod(numbers):.3g} postures exceeds the maximum of 2**63 - 1"
            )
        lower, upper = ranges_of(robot)
        is_periodic = (lower != robot.lower) | (upper != robot.upper)
        open_ended = is_periodic & (np.array(numbers) > 1)  # both ends are the same position
        gap = np.where(open_ended, (upper - lower) / np.array(numbers), 0.0)
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
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`.

        Parameters
        ----------
        start, stop :
            Half-open range of indices, from 0.
        """
        start, stop = checked_block(start, stop, self.count)
        q = np.empty((stop - start, self.n))
        stride = 1  # number of consecutive postures with the same position of the joint
        for joint in reversed(range(self.n) if stop > start else ()):
            first, last = start // stride, (stop - 1) // stride
            points = self._positions(joint, np.arange(first, last + 1) % self.counts[joint])
            repeats = np.full(len(points), stride)
            repeats[0] -= start - first * stride
            repeats[-1] -= stride - 1 - (stop - 1 - last * stride)
            q[:, joint] = np.repeat(points, repeats)
            stride *= self.counts[joint]
        return q

    def _positions(self, joint: int, steps: Any) -> Vector:
        lower, upper, last = self.lower[joint], self.upper[joint], self.counts[joint] - 1
        if not last:
            return np.full(len(steps), 0.5 * (lower + upper))
        q: Vector = np.where(steps == last, upper, lower + steps * ((upper - lower) / last))
        return q

    def identity(self) -> dict[str, Any]:
        """Return the bounds and counts of the grid."""
        return {
            "source": "grid",
            "counts": list(self.counts),
            "lower": self.lower.tolist(),
            "upper": self.upper.tolist(),
        }

    def __str__(self) -> str:
        """Return the number of postures, and of positions per joint."""
        return f"{self.count:,} postures on a grid of {' x '.join(map(str, self.counts))}"


# ---- listed ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Listed:
    """Explicitly listed postures, made by `of`.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (k, n).
    """

    q: Matrix

    @classmethod
    def of(cls, robot: Robot, q: ArrayLike) -> Listed:
        """Check postures and store a copy.

        Parameters
        ----------
        robot :
            The arm.
        q :
            Joint positions along the chain, rad or m, shape (k, n), k >= 1.

        Raises
        ------
        InputError
            The shape is wrong, or a value is not finite.
        """
        values = as_floats(q, "q")
        if values.ndim != 2 or values.shape[1] != robot.n or not len(values):
            raise InputError(
                f"expected postures of shape (k, {robot.n}), one row per posture and one column "
                f"per joint ({robot.numbered()}), got shape {values.shape}"
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
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`.

        Parameters
        ----------
        start, stop :
            Half-open range of indices, from 0.
        """
        start, stop = checked_block(start, stop, self.count)
        return self.q[start:stop].copy()

    def identity(self) -> dict[str, Any]:
        """Return the shape of the array and its SHA-256."""
        return {"source": "given", "shape": list(self.q.shape), "sha256": digest_of(self.q)}

    def __str__(self) -> str:
        """Return the number of postures."""
        return f"{self.count:,} given posture{'s' if self.count > 1 else ''}"
