"""Map of the failure-tolerant workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.errors import InputError
from ftforce.planning.reach import KEPT, LOST
from ftforce.show.plots.canvas import BLACK, Options, canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from ftforce.core.arrays import Vector
    from ftforce.planning.reach import FailureTolerantWorkspace

_AXES = "xyz"
_KINDS = (
    ("white", "out of reach"),
    ("0.85", "reached, but not after every lock"),
    ("#f0c060", "neither shown nor excluded"),
    ("#6baed6", "middle of the cell reached whichever joint locks"),
    ("#08519c", "whole cell, proved"),
)


def reach_map(
    found: FailureTolerantWorkspace,
    plane: str = "",
    *,
    at: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw which cells are reached whichever joint locks, in a plane.

    Parameters
    ----------
    found :
        The failure-tolerant workspace.
    plane :
        ``xy``, ``xz`` or ``yz``, in root axes; by default that of a planar arm, else ``xz``.
    at :
        Position of the slice along the third axis, m; by default through the middle of the reach.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The plane is unknown or not that of the arm, the slice holds no cells, or ``ax`` is not
        two-dimensional.
    """
    whole = "".join(_AXES[i] for i in found.rows)
    plane = plane or (whole if found.m == 2 else "xz")
    if set(plane) - set(whole) or len(set(plane)) != 2 or len(plane) != 2:
        raise InputError(f"the plane is two of {whole}, got {plane!r}")
    kinds, where = _slice(found, plane, at)
    u, v = (whole.index(one) for one in plane)
    edges = [
        found.origin[axis] + found.edge * np.arange(found.tolerated.shape[axis] + 1)
        for axis in (u, v)
    ]
    with canvas(ax, 4.6) as axes:
        from matplotlib.colors import ListedColormap
        from matplotlib.patches import Patch

        colours = ListedColormap([colour for colour, _ in _KINDS])
        look: Options = {"vmin": -0.5, "vmax": len(_KINDS) - 0.5, "rasterized": True}
        axes.pcolormesh(*edges, kinds.T, cmap=colours, **look)
        edge: Options = {"markeredgecolor": BLACK, "markerfacecolor": "white", "zorder": 4}
        axes.plot(0.0, 0.0, "P", linestyle="none", **edge)
        filled = np.argwhere(kinds > 0)
        if len(filled):
            (left, right), (bottom, top) = map(_window, edges, filled.T)
            axes.set_xlim(left, right)
            axes.set_ylim(bottom, top)
        axes.set_aspect("equal")
        axes.set_xlabel(f"{plane[0]} [m]")
        axes.set_ylabel(f"{plane[1]} [m]")
        axes.set_title(f"Reached whichever joint locks{where}")
        handles = [Patch(facecolor=c, edgecolor="0.3", linewidth=0.7, label=n) for c, n in _KINDS]
        seen = [one for i, one in enumerate(handles) if (kinds == i).any()]
        axes.legend(handles=seen, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    return axes


def _window(ends: Vector, steps: NDArray[np.intp]) -> tuple[float, float]:
    """Return the ends of the cells that are drawn, with one more on each side."""
    last = min(int(steps.max()) + 2, len(ends) - 1)
    return float(ends[max(int(steps.min()) - 1, 0)]), float(ends[last])


def _slice(
    found: FailureTolerantWorkspace, plane: str, at: float | None
) -> tuple[NDArray[np.intp], str]:
    """Return the kinds of the cells in a plane, and where the plane is."""
    kinds = np.zeros(found.tolerated.shape, dtype=np.intp)
    kinds[found.healthy_middles] = 1
    kinds[(found.tolerated != LOST) & found.healthy_middles] = 2
    kinds[found.tolerated_middles] = 3
    kinds[found.tolerated == KEPT] = 4
    whole = "".join(_AXES[i] for i in found.rows)
    order = [whole.index(one) for one in plane]
    if found.m == 2:
        if at is not None:
            raise InputError("a planar arm has no third axis along which a slice could lie")
        return kinds.transpose(order), ""
    (third,) = {0, 1, 2} - set(order)
    count = found.tolerated.shape[third]
    layer = count // 2 if at is None else int(np.floor((at - found.origin[third]) / found.edge))
    if not 0 <= layer < count:
        ends = (found.origin[third], found.origin[third] + count * found.edge)
        raise InputError(f"the cells lie between {ends[0]:.4g} and {ends[1]:.4g} m, got at = {at}")
    middle = found.origin[third] + (layer + 0.5) * found.edge
    sliced = kinds.transpose([*order, third])[:, :, layer]
    return sliced, f", at {_AXES[third]} = {middle:.3g} m"
