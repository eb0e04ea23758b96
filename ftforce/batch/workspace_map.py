"""Map of the workspace where a fault is tolerated: cells of a sweep, projected or sliced.

Counts are pooled, not shares, so each cell is weighted by its number of postures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.summary.cells import (
    AXES,
    PLANES,
    Cells,
    Flat,
    Located,
    depth_axis,
    factor_of,
    pooled,
    window_of,
)
from ftforce.core.arrays import read_only
from ftforce.core.display import Displayed
from ftforce.errors import InputError, check_word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.batch.result import Sweep
    from ftforce.core.arrays import Vector

QUANTITIES = ("rho", "margin", "jump", "capability")
_DEFAULT_QUANTITIES = ("rho", "margin")
_ROUNDING = 1e-9  # of an edge: a slice on the border of two cells belongs to the upper one


@dataclass(frozen=True, eq=False, repr=False)
class WorkspaceMap(Displayed):
    """Map of a sweep over the workspace, made by `workspace_map`.

    Attributes
    ----------
    sweep :
        The sweep.
    joints :
        Joints that fail together, numbered from 1; ``None`` for every set of the sweep.
    plane :
        ``xy``, ``xz`` or ``yz``; ``None`` for all three.
    at :
        Position of the slice along the third axis, m; ``None`` pools the whole depth.
    solid :
        Whether plots are three-dimensional.
    quantities :
        Histograms and quantiles to show: ``rho``, ``margin``, ``jump``, ``capability``.
    """

    sweep: Sweep
    joints: tuple[int, ...] | None = None
    plane: str | None = None
    at: float | None = None
    solid: bool = False
    quantities: tuple[str, ...] = _DEFAULT_QUANTITIES

    @cached_property
    def grid(self) -> Cells:
        """All cells, shape (nx, ny, nz)."""
        return _grid_of(self.sweep, self.joints)

    @cached_property
    def flat(self) -> Flat:
        """Cells of the plane, or of xz if ``plane`` is ``None``."""
        return self.projected(self.plane or "xz")

    def projected(self, plane: str) -> Flat:
        """Return the cells of a plane, ``xy``, ``xz`` or ``yz``.

        Parameters
        ----------
        plane :
            ``xy``, ``xz`` or ``yz``.
        """
        return _flatten(self.sweep, self.grid, plane, self.at)

    @cached_property
    def located(self) -> Located:
        """Cells that contain postures, restricted to any slice; x varies slowest."""
        return self.located_of(self.joints)

    def located_of(self, joints: tuple[int, ...] | None) -> Located:
        """Return the cells that contain postures, for another fault set.

        Parameters
        ----------
        joints :
            Joints that fail together, numbered from 1; ``None`` for every set of the sweep.
        """
        grid = self.grid if joints == self.joints else _grid_of(self.sweep, joints)
        workspace = self.sweep.summary.workspace
        chosen = grid.postures > 0
        if self.plane is not None and self.at is not None:
            axis = depth_axis(self.plane)
            layer = np.arange(chosen.shape[axis]) == _layer_at(self.sweep, axis, self.at)
            chosen = chosen & np.expand_dims(layer, tuple({0, 1, 2} - {axis}))
        index = np.argwhere(chosen)
        place = np.array(workspace.origin) + (index + 0.5) * workspace.edge
        return Located(read_only(place), workspace.edge, grid.only(chosen))

    @cached_property
    def blocks(self) -> Located:
        """Located cells, pooled into cubes until most contain enough postures for a share.

        Cells of a slice are not pooled.
        """
        if self.at is not None:
            return self.located
        workspace, grid = self.sweep.summary.workspace, self.grid
        window = window_of(grid.postures)
        starts = window[:, 0].tolist()
        factor = factor_of(grid.postures, window)
        counts = (pooled(one, factor, starts) for one in (grid.postures, grid.tolerated))
        cells = Cells.of(*counts)
        filled = cells.postures > 0
        edge = factor * workspace.edge
        corner = np.array(workspace.origin) + np.array(starts) * workspace.edge
        place = corner + (np.argwhere(filled) + 0.5) * edge
        return Located(read_only(place), edge, cells.only(filled))

    def worst(self, count: int) -> list[int]:
        """Return the indices of the worst blocks, ranked by the upper end of their intervals.

        A block of three postures that happen to fail thus does not rank above one of three
        hundred. Blocks that tolerate everything are left out.

        Parameters
        ----------
        count :
            Maximum number of blocks to return.
        """
        cells = self.blocks.cells
        order = np.lexsort((cells.share, cells.high))
        return [i for i in order.tolist() if cells.tolerated[i] < cells.postures[i]][:count]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the map."""
        found = list(self.sweep.warnings)
        if outside := int(self.sweep.summary.outside):
            found.append(
                f"{outside:,} tip positions outside the grid were assigned to the outermost cells"
            )
        return tuple(found)


def workspace_map(
    sweep: Sweep,
    joints: Sequence[int] | None = None,
    *,
    plane: str | None = None,
    at: float | None = None,
    solid: bool = False,
    quantities: Sequence[str] = _DEFAULT_QUANTITIES,
) -> WorkspaceMap:
    """Return a map of the workspace that shows where a fault is tolerated.

    Parameters
    ----------
    sweep :
        The sweep.
    joints :
        Joints that fail together, numbered from 1; ``None`` for every set of the sweep.
    plane :
        ``xy``, ``xz`` or ``yz``; ``None`` for all three.
    at :
        Position of a slice along the third axis, m; by default the whole depth is pooled.
    solid :
        Whether plots are three-dimensional.
    quantities :
        Histograms and quantiles to show: ``rho``, ``margin``, ``jump``, ``capability``.

    Raises
    ------
    InputError
        The sweep has no postures yet, no such set or quantity, or the slice is empty.
    """
    if not hasattr(sweep, "summary"):
        raise InputError(f"a map needs a sweep, got {type(sweep).__name__}")
    if not int(sweep.summary.postures):
        raise InputError(
            "the sweep has no finished postures yet; run its command again to resume it"
        )
    if plane is not None:
        check_word("plane", plane, PLANES)
    if solid and (plane is not None or at is not None):
        raise InputError("a three-dimensional plot has no plane; omit plane and at")
    if at is not None and plane is None:
        raise InputError("a slice needs a plane: xy, xz or yz")
    chosen = None if joints is None else tuple(sorted(joints))
    if chosen is not None:
        sweep.index_of(chosen)
    if plane is not None and at is not None:
        _check_slice(sweep, plane, at)
    for quantity in quantities:
        check_quantity(sweep, quantity)
    return WorkspaceMap(sweep, chosen, plane, at, solid, tuple(quantities))


def _grid_of(sweep: Sweep, joints: tuple[int, ...] | None) -> Cells:
    """Return all cells of the workspace, shape (nx, ny, nz).

    Parameters
    ----------
    sweep :
        The sweep.
    joints :
        Joints that fail together, numbered from 1; ``None`` for every set of the sweep.

    Raises
    ------
    InputError
        The sweep has no such set.
    """
    summary = sweep.summary
    tolerated = summary.cell_tolerates_all
    if joints is not None:
        tolerated = summary.cell_tolerated[:, sweep.index_of(joints)]
    shape = summary.workspace.shape
    return Cells.of(summary.cell_postures.reshape(shape), tolerated.reshape(shape))


def _flatten(sweep: Sweep, grid: Cells, plane: str, at: float | None) -> Flat:
    """Return the cells of a plane, pooled over the depth or of one layer.

    Parameters
    ----------
    sweep :
        The sweep.
    grid :
        All cells, shape (nx, ny, nz).
    plane :
        ``xy``, ``xz`` or ``yz``.
    at :
        Position of the layer along the third axis, m; ``None`` pools the whole depth.

    Raises
    ------
    InputError
        There is no such plane, or the slice is empty.
    """
    check_word("plane", plane, PLANES)
    workspace, axis = sweep.summary.workspace, depth_axis(plane)
    low = workspace.origin[axis]
    depth = (low, low + workspace.shape[axis] * workspace.edge)
    if at is None:
        counts = (grid.postures.sum(axis), grid.tolerated.sum(axis))
    else:
        _check_slice(sweep, plane, at)
        layer = _layer_at(sweep, axis, at)
        depth = (low + layer * workspace.edge, low + (layer + 1) * workspace.edge)
        counts = (grid.postures.take(layer, axis), grid.tolerated.take(layer, axis))
    first, second = (_borders(sweep, AXES.index(name)) for name in plane)
    return Flat(plane, (first, second), depth, Cells.of(*counts))


def _layer_at(sweep: Sweep, axis: int, at: float) -> int:
    """Return the layer of cells at a position along an axis, clipped to those with postures.

    Parameters
    ----------
    sweep :
        The sweep.
    axis :
        Index of the root axis.
    at :
        Position along it, m.
    """
    workspace = sweep.summary.workspace
    first, end = window_of(sweep.summary.cell_postures.reshape(workspace.shape))[axis].tolist()
    place = (at - workspace.origin[axis]) / workspace.edge
    return int(min(max(math.floor(place + _ROUNDING), first), end - 1))


def _check_slice(sweep: Sweep, plane: str, at: float) -> None:
    """Check that there are postures at this depth.

    Parameters
    ----------
    sweep, plane, at :
        Arguments of `workspace_map`.

    Raises
    ------
    InputError
        There are none; the message gives the range they occupy.
    """
    axis, workspace = depth_axis(plane), sweep.summary.workspace
    postures = sweep.summary.cell_postures.reshape(workspace.shape)
    window = window_of(postures)[axis].tolist()
    low, high = (workspace.origin[axis] + layer * workspace.edge for layer in window)
    slack = _ROUNDING * workspace.edge
    is_within = low - slack <= at <= high + slack
    if not (is_within and postures.take(_layer_at(sweep, axis, at), axis).any()):
        raise InputError(
            f"no posture has its tip at {AXES[axis]} = {at:g} m; tip positions range from "
            f"{AXES[axis]} = {low:.4g} to {high:.4g} m"
        )


def check_quantity(sweep: Sweep, quantity: str) -> None:
    """Check that the sweep has a histogram of a quantity.

    Parameters
    ----------
    sweep :
        The sweep.
    quantity :
        Name of the quantity.

    Raises
    ------
    InputError
        It did not, or there is no such quantity.
    """
    check_word("quantity", quantity, QUANTITIES)
    if getattr(sweep.summary, quantity) is None:
        needs = "a force" if quantity == "jump" else "a force or a direction, and limits"
        raise InputError(f"the sweep has no {quantity}: it was run without {needs}")


def _borders(sweep: Sweep, axis: int) -> Vector:
    workspace = sweep.summary.workspace
    steps = np.arange(workspace.shape[axis] + 1)
    return read_only(workspace.origin[axis] + steps * workspace.edge)
