"""Random postures within the joint limits; the cost of a block depends on its length only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ftforce.batch.postures.postures import checked_block, digest_of, ranges_of, whole_number
from ftforce.errors import InputError, check_word

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

_Integers: TypeAlias = NDArray[np.uint32]

_BITS = 30  # SciPy's default
_MAX_SOBOL: int = 1 << _BITS  # postures, the length of SciPy's sequence
_TABLE = 12  # bits of the index that are looked up, few enough for the table to stay in cache
_TILE = 64  # rows processed as one: NumPy's inner loop over only n numbers is slow


class Columns(NamedTuple):
    """Generating columns of a scrambled Sobol sequence.

    Attributes
    ----------
    points :
        Point 0, then the columns for bits 0, 1, … of the Gray code, shape (1 + bits, n).
    """

    points: _Integers

    @property
    def size(self) -> int:
        """Scale of the integers, 2**30."""
        return _MAX_SOBOL

    def point(self, i: int) -> _Integers:
        """Return the integers of point i, shape (n,)."""
        code = i ^ (i >> 1)
        bits = [b for b in range(code.bit_length()) if code >> b & 1]
        columns = self.points[[0, *(b + 1 for b in bits)]]
        point: _Integers = np.bitwise_xor.reduce(columns, axis=0)
        return point


def sobol_columns(n: int, count: int, seed: int) -> Columns:
    """Return the columns that generate the first points of SciPy's sequence.

    SciPy has to step through half of the points for that, at 1 to 10 ns each: seconds for 2**30.

    Parameters
    ----------
    n :
        Number of dimensions.
    count :
        Number of points, up to 2**30.
    seed :
        Seed of the scrambling.
    """
    engine = _engine(n, seed)
    points = [_integers(engine.random(1))]
    previous = np.zeros_like(points[0])  # points 2**b and 0 differ by the columns b and b - 1
    for b in range((count - 1).bit_length()):
        at = 1 << b
        if at > engine.num_generated:
            engine.fast_forward(at - engine.num_generated)
        previous = _integers(engine.random(1)) ^ points[0] ^ previous
        points.append(previous)
    table = np.concatenate(points)
    table.setflags(write=False)
    return Columns(table)


def _engine(n: int, seed: int) -> Any:
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    try:
        return qmc.Sobol(n, scramble=True, bits=_BITS, rng=generator)
    except TypeError:  # before SciPy 1.15
        return qmc.Sobol(n, scramble=True, bits=_BITS, seed=generator)


def _integers(points: NDArray[np.float64]) -> _Integers:
    integers: _Integers = (points * _MAX_SOBOL).astype(
        np.uint32
    )  # exact: multiples of 1 / _MAX_SOBOL
    return integers


def sobol_integers(columns: Columns, start: int, stop: int) -> _Integers:
    """Return points of the sequence as integers, scaled by 2**30.

    Parameters
    ----------
    columns :
        Columns of the sequence.
    start, stop :
        Half-open range of points.

    Returns
    -------
    :
        Shape (stop - start, n).
    """
    out = np.empty((stop - start, columns.points.shape[1]), dtype=np.uint32)
    if start == stop:
        return out
    bits = min((stop - start - 1).bit_length(), _TABLE)
    size = 1 << bits
    table = _first_points(columns, bits)
    for first in range(start - start % size, stop, size):
        # An aligned block is the first block XOR a constant, whatever the parity of its index.
        shift = columns.point(first) ^ columns.points[0]
        low, high = max(start, first), min(stop, first + size)
        _rowwise(np.bitwise_xor, table[low - first : high - first], shift, out[low - start :])
    return out


def _first_points(columns: Columns, bits: int) -> _Integers:
    """Return points 0 to 2**bits - 1; the Gray code runs backwards where its next bit is set."""
    table = columns.points[:1]
    for b in range(bits):
        table = np.concatenate([table, table[::-1] ^ columns.points[b + 1]])
    return table


def _rowwise(function: np.ufunc, rows: NDArray[Any], row: NDArray[Any], out: NDArray[Any]) -> None:
    """Apply a binary ufunc to each of ``rows`` and ``row``.

    Parameters
    ----------
    function :
        The ufunc.
    rows, row :
        Its arguments, shapes (k, n) and (n,).
    out :
        The result is written to its first k rows.
    """
    k, width = len(rows), _TILE * len(row)
    whole = k - k % _TILE
    tiles = out[:whole].reshape(-1, width)
    function(rows[:whole].reshape(-1, width), np.tile(row, _TILE), out=tiles)
    function(rows[whole:], row, out=out[whole:k])


_METHODS = ("sobol", "uniform")
_WORDS = {"sobol": "scrambled Sobol postures", "uniform": "uniform random postures"}


@dataclass(frozen=True, eq=False)
class Drawn:
    """Random postures within the joint limits, made by `of`, which checks its arguments.

    Attributes
    ----------
    lower, upper :
        Bounds of the joint positions, rad or m, finite, shape (n,).
    count :
        Number of postures.
    method :
        ``sobol``, SciPy's scrambled sequence, or ``uniform``, independent samples.
    seed :
        Seed of the random numbers.
    columns :
        Generating columns of the Sobol sequence; ``None`` if uniform.
    """

    lower: Vector
    upper: Vector
    count: int
    method: str = "sobol"
    seed: int = 0
    columns: Columns | None = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        """Compute the columns of the Sobol sequence."""
        if self.method == "sobol":
            columns = sobol_columns(len(self.lower), self.count, self.seed)
            object.__setattr__(self, "columns", columns)

    @classmethod
    def of(cls, robot: Robot, count: float, method: str = "sobol", seed: int = 0) -> Drawn:
        """Draw postures within a robot's joint limits; continuous joints range from -pi to pi.

        Parameters
        ----------
        robot :
            The arm.
        count :
            Number of postures, a positive integer, which may be written as 1e6.
        method :
            ``sobol`` (up to 2**30 postures) or ``uniform``.
        seed :
            A non-negative integer.

        Raises
        ------
        InputError
            An invalid count, method or seed, or a prismatic joint without limits.

        Examples
        --------
        >>> import ftforce
        >>> postures = Drawn.of(ftforce.load_robot("dh5"), 1e6)
        >>> print(postures)
        1,000,000 scrambled Sobol postures within the limits, seed 0
        >>> postures.block(700_000, 700_002).shape
        (2, 5)
        """
        check_word("sampling method", method, _METHODS)
        number = whole_number(count, "the number of postures", 1)
        check_seed(seed)
        if method == "sobol" and number > _MAX_SOBOL:
            raise InputError(
                f"a Sobol sequence has at most {_MAX_SOBOL:,} (2**30) postures, got {number:,}; "
                "use the method 'uniform' for more"
            )
        return cls(*ranges_of(robot), number, method, int(seed))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.lower)

    def block(self, start: int, stop: int) -> Matrix:
        """Return the postures ``start`` to ``stop`` - 1, see `Postures.block`.

        Parameters
        ----------
        start, stop :
            Half-open range of indices, from 0.
        """
        start, stop = checked_block(start, stop, self.count)
        if self.columns is not None:
            integers = sobol_integers(self.columns, start, stop)
            return self._within(integers, 1.0 / self.columns.size)
        stream = np.random.PCG64DXSM(self.seed)
        stream.advance(start * self.n)  # a double consumes one number of the stream
        q = np.random.Generator(stream).random((stop - start, self.n))
        return self._within(q, 1.0)

    def _within(self, points: Any, unit: float) -> Matrix:
        """Return lower + (upper - lower) · points · unit; ``unit`` is a power of two."""
        q = points if points.dtype == np.float64 else np.empty(points.shape)
        _rowwise(np.multiply, points, (self.upper - self.lower) * unit, q)
        # Never above ``upper``: points < 1, so the product is at least one ulp below the width.
        _rowwise(np.add, q, self.lower, q)
        return q

    def identity(self) -> dict[str, Any]:
        """Return the method, count, seed and limits, and a check of the random generator."""
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
        """Return the number of postures, the method and the seed."""
        return f"{self.count:,} {_WORDS[self.method]} within the limits, seed {self.seed}"


def check_seed(seed: object) -> None:
    """Check the seed of a random generator.

    Parameters
    ----------
    seed :
        The seed.

    Raises
    ------
    InputError
        It is not a non-negative integer.
    """
    whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, (bool, np.bool_))
    if not (whole and seed >= 0):  # type: ignore[operator]
        raise InputError(f"the seed must be a non-negative integer, got {seed!r}")
