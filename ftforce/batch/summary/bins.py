"""Histogram bins and workspace cells of a sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import as_vector, is_number, read_only
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from ftforce.core.arrays import Matrix, Vector

    Counts = NDArray[np.int64]

LINEAR_BINS = 1000
_DECADES = (-3, 6)
_PER_DECADE = 100


@dataclass(frozen=True)
class Bins:
    """Edges of the histograms.

    Attributes
    ----------
    force :
        Norm of the requested force, N (N·m), the largest jump in the bins; ``None`` without one.
    direction :
        Whether capabilities are counted.
    """

    force: float | None = None
    direction: bool = False

    def __post_init__(self) -> None:
        """Check the force.

        Raises
        ------
        InputError
            It is not positive.
        """
        if self.force is not None and not (is_number(self.force) and self.force > 0.0):
            raise InputError(
                f"the norm of the force must be positive, in N (N·m), got {self.force!r}"
            )

    @cached_property
    def share(self) -> Vector:
        """Edges for margin and ρ, 0 to 1, shape (1001,); larger values fall in the last bin."""
        return read_only(np.arange(LINEAR_BINS + 1) / LINEAR_BINS)

    @cached_property
    def jump(self) -> Vector | None:
        """Edges for the jump, 0 to the force, N (N·m), shape (1001,), plus one overflow bin."""
        return None if self.force is None else read_only(self.share * self.force)

    @cached_property
    def capability(self) -> Vector | None:
        """Edges for the capability, 1e-3 to 1e6 N (N·m), a hundred per decade, shape (901,).

        There is one more bin below, which includes 0, and one above.
        """
        lowest, highest = _DECADES
        if not self.direction:
            return None
        steps = range(lowest * _PER_DECADE, highest * _PER_DECADE + 1)
        edges = (10.0 ** (step / _PER_DECADE) for step in steps)
        # Rounded, because the last bits of a power differ between machines.
        return read_only(np.array([float(f"{edge:.13e}") for edge in edges]))

    @cached_property
    def capability_lookup(self) -> Counts | None:
        """Lookup table of the capability edges, see `ftforce.batch.kernels.counting.lookup_of`."""
        from ftforce.batch.kernels.counting import lookup_of

        return None if self.capability is None else lookup_of(self.capability)


@dataclass(frozen=True)
class Workspace:
    """A grid of cubic cells.

    Attributes
    ----------
    origin :
        Lowest corner in root axes, m.
    edge :
        Edge length of a cell, m.
    shape :
        Number of cells along x, y and z.
    """

    origin: tuple[float, float, float]
    edge: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, centre: ArrayLike, radius: float, edge: float) -> Workspace:
        """Return a grid of cells that covers centre ± radius symmetrically.

        Parameters
        ----------
        centre :
            Centre in root axes, m, shape (3,).
        radius, edge :
            Half the extent to cover, and the edge length of a cell, m.

        Raises
        ------
        InputError
            The edge is not positive, the radius negative, or one is not finite.
        """
        if not (is_number(edge) and edge > 0.0):
            raise InputError(f"the cell size must be a positive number, in m, got {edge!r}")
        if not (is_number(radius) and radius >= 0.0):
            raise InputError(f"the radius must be a non-negative number, in m, got {radius!r}")
        # The factor absorbs rounding: 0.3 / 0.1 makes three cells.
        count = max(1, math.ceil(2.0 * radius / edge * (1.0 - 1e-12)))
        x, y, z = (as_vector(centre, 3, "centre") - 0.5 * count * edge).tolist()
        return cls((x, y, z), float(edge), (count, count, count))

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    def index(self, tip: Matrix, locate: Callable[..., int]) -> tuple[Counts, int]:
        """Return the cell index of each position, shape (k,), and how many lie outside the grid.

        Cells are numbered with z varying fastest. Positions on or beyond the border, or NaN, are
        assigned to an outermost cell.

        Parameters
        ----------
        tip :
            Positions in root axes, m, shape (k, 3).
        locate :
            The function that finds the cells: ``locate`` of the counting functions, or compiled.
        """
        cell = np.empty(len(tip), np.int64)
        origin, shape = np.array(self.origin), np.array(self.shape)
        return cell, int(locate(np.ascontiguousarray(tip), origin, self.edge, shape, cell))
