"""Postures drawn within the limits of the joints, any block of them at the cost of its length."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.postures.postures import checked_block, digest_of, ranges_of, whole_number
from ftforce.batch.sobol import LARGEST, Columns, rowwise, sobol_columns, sobol_integers
from ftforce.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

METHODS = ("sobol", "uniform")
_WORDS = {"sobol": "scrambled Sobol postures", "uniform": "uniform random postures"}


@dataclass(frozen=True, eq=False)
class Drawn:
    """Postures drawn within the limits of the joints. `of` checks what it is given.

    Attributes
    ----------
    lower, upper :
        Where the positions lie, rad or m, finite, shape (n,).
    count :
        Number of postures.
    method :
        ``sobol``, SciPy's scrambled sequence, or ``uniform``, independent of each other.
    seed :
        Seed of the random numbers.
    columns :
        What the points of the Sobol sequence are made of; ``None`` if uniform.
    """

    lower: Vector
    upper: Vector
    count: int
    method: str = "sobol"
    seed: int = 0
    columns: Columns | None = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        """Find the columns of the Sobol sequence."""
        if self.method == "sobol":
            columns = sobol_columns(len(self.lower), self.count, self.seed)
            object.__setattr__(self, "columns", columns)

    @classmethod
    def of(cls, robot: Robot, count: float, method: str = "sobol", seed: int = 0) -> Drawn:
        """Draw postures within a robot's limits; continuous joints take -pi to pi.

        Parameters
        ----------
        robot :
            The arm.
        count :
            Number of postures, a whole number from 1; 1e6 is one too.
        method :
            ``sobol`` (up to 2**30 postures) or ``uniform``.
        seed :
            A whole number from 0.

        Raises
        ------
        InputError
            No such count, method or seed, or a prismatic joint without limits.

        Examples
        --------
        >>> import ftforce
        >>> postures = Drawn.of(ftforce.load_robot("dh5"), 1e6)
        >>> print(postures)
        1,000,000 scrambled Sobol postures within the limits, seed 0
        >>> postures.block(700_000, 700_002).shape
        (2, 5)
        """
        if method not in METHODS:
            raise UnknownNameError("method", method, METHODS, "of drawing postures")
        number = whole_number(count, "the number of postures", 1)
        _check_seed(seed)
        if method == "sobol" and number > LARGEST:
            raise InputError(
                f"a Sobol sequence has up to {LARGEST:,} (2**30) postures, got {number:,}; "
                "the method uniform draws more"
            )
        return cls(*ranges_of(robot), number, method, int(seed))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.lower)

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`."""
        start, stop = checked_block(start, stop, self.count)
        if self.columns is not None:
            integers = sobol_integers(self.columns, start, stop)
            return self._within(integers, 1.0 / self.columns.size)
        stream = np.random.PCG64DXSM(self.seed)
        stream.advance(start * self.n)  # a double takes one number of the stream
        q = np.random.Generator(stream).random((stop - start, self.n))
        return self._within(q, 1.0)

    def _within(self, points: Any, unit: float) -> Matrix:
        """Return lower + (upper - lower) · points · unit; ``unit`` is a power of two."""
        q = points if points.dtype == np.float64 else np.empty(points.shape)
        rowwise(np.multiply, points, (self.upper - self.lower) * unit, q)
        # Never beyond: points < 1 makes the product at least a float's step less than the width.
        rowwise(np.add, q, self.lower, q)
        return q

    def identity(self) -> dict[str, Any]:
        """Return method, count, seed and limits, with a check of the random numbers' maker."""
        start = self.block(0, 1) if self.columns is None else self.columns.points
        return {
            "source": self.method,
            "count": self.count,
            "seed": self.seed,
            "lower": self.lower.tolist(),
            "upper": self.upper.tolist(),
            "check": digest_of(start)[:16],
        }

    def __str__(self) -> str:
        """Return number, method and seed."""
        return f"{self.count:,} {_WORDS[self.method]} within the limits, seed {self.seed}"


def _check_seed(seed: object) -> None:
    whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, (bool, np.bool_))
    if not (whole and seed >= 0):  # type: ignore[operator]
        raise InputError(f"the seed is a whole number from 0, got {seed!r}")
