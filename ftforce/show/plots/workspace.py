"""Maps of a sweep's workspace, planar and 3D."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.summary.cells import AXES, window_of
from ftforce.batch.workspace_map import workspace_map
from ftforce.report.map import cells_in_words, faults_in_words
from ftforce.show.plots.canvas import BLACK, Options, canvas, cube, head, mark, wrapped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from ftforce.batch.result import Sweep
    from ftforce.batch.summary.cells import Cells, Flat, Located
    from ftforce.batch.workspace_map import WorkspaceMap
    from ftforce.core.arrays import Vector

UNSURE = 0.2
"""Width of a share's 95 % interval above which a cell is marked as uncertain."""
UNSURE_WORDS = f"95 % interval wider than {100.0 * UNSURE:.0f} points"
_FLOORS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999)
_COLOURS = "cividis"  # readable with any kind of colour vision and in grey; dark is bad
_OF_HEIGHT = 0.48  # side of the cube in 3D axes, as a share of their height, approximately
_FAINTEST = 0.03


class Scale(NamedTuple):
    """The colour scale: from the share ``floor``, dark, to 1, bright."""

    floor: float
    reaches_below: bool


def survival(
    sweep: Sweep,
    joints: Sequence[int] | None = None,
    *,
    plane: str = "xz",
    at: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the share of postures that tolerate a fault, over the workspace; darker is worse.

    By default, all postures in a column of cells along the third axis are pooled with equal weight;
    with ``at``, a single layer of cells is drawn. The map is white where no posture has its tip. A
    dot marks cells with so few postures that the 95 % interval of the share is wider than 20
    percentage points.

    Parameters
    ----------
    sweep :
        The sweep.
    joints :
        Numbers, from 1, of the joints that fail together; ``None`` for every set of the sweep.
    plane :
        ``xy``, ``xz`` or ``yz``, in root axes.
    at :
        Position of a slice along the third axis, m; by default, the whole depth is pooled.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The sweep has no such fault set, the plane is unknown, the slice contains no postures, or
        ``ax`` is not two-dimensional.
    """
    found = workspace_map(sweep, joints, plane=plane, at=at)
    with canvas(ax, 4.6) as axes:
        one = scale_of(found.flat.cells)
        paint_flat(axes, found, found.flat, one)
        colour_bar(axes, [axes], one)
        title = f"Postures that tolerate {faults_in_words(sweep, found.joints)}"
        lines = wrapped(axes, [title, cells_in_words(found, found.flat)])
        head(axes, lines, map_key([found.flat.cells]))
    return axes


def survival_3d(
    sweep: Sweep, joints: Sequence[int] | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw the workspace cells in 3D: bad cells dark, the others nearly transparent.

    Cells are pooled into larger ones until most contain enough postures for a share.

    Parameters
    ----------
    sweep :
        The sweep.
    joints :
        Numbers, from 1, of the joints that fail together; ``None`` for every set of the sweep.
    ax :
        Axes with ``projection="3d"``; a new figure by default.

    Raises
    ------
    InputError
        The sweep has no such fault set, or ``ax`` is not three-dimensional.
    """
    found = workspace_map(sweep, joints)
    with canvas(ax, 5.0, solid=True) as axes:
        blocks = found.blocks
        one = scale_of(blocks.cells)
        paint_solid(axes, blocks, one)
        colour_bar(axes, [axes], one, pad=0.08, shrink=0.7)
        title = f"Postures that tolerate {faults_in_words(sweep, found.joints)}"
        axes.set_title(wrapped(axes, [title, *solid_in_words(blocks)]))
    return axes


def scale_of(*maps: Cells) -> Scale:
    """Return a colour scale shared by several maps, narrow enough to resolve their differences.

    Cells with few postures are ignored: one failure in such a cell would spoil the contrast.
    """
    shares = [cells.share[cells.postures > 0] for cells in maps]
    sure = [cells.share[_is_sure(cells)] for cells in maps]
    lowest = min((float(one.min()) for one in sure if one.size), default=0.0)
    if lowest >= 1.0:  # all equal
        lowest = 0.0
    floor = max(step for step in _FLOORS if step <= lowest)
    below = any(bool((one < floor).any()) for one in shares)
    return Scale(floor, below)


def _is_sure(cells: Cells) -> Any:
    return (cells.postures > 0) & (cells.high - cells.low <= UNSURE)


def paint_flat(ax: Axes, found: WorkspaceMap, flat: Flat, one: Scale) -> None:
    """Draw a map's cells, workspace border, origin, and dots for uncertain cells."""
    from matplotlib.ticker import MaxNLocator

    cells = flat.cells
    empty = cells.postures == 0
    u, v = flat.edges
    shown = np.ma.masked_where(empty, cells.share).T
    ax.pcolormesh(u, v, shown, vmin=one.floor, vmax=1.0, cmap=_COLOURS, rasterized=True)
    _draw_border(ax, flat, ~empty)
    _mark_unsure(ax, flat, one)
    origin: Options = {"marker": "P", "markersize": 5.5, "markerfacecolor": "white"}
    edge: Options = {"markeredgecolor": BLACK, "markeredgewidth": 0.8}
    ax.plot(0.0, 0.0, linestyle="none", **origin, **edge, zorder=4)
    spans = window_of(found.grid.postures)
    borders = [_border(found, axis) for axis in range(3)]
    fits: tuple[Any, ...] = (ax.set_xlim, ax.set_ylim)
    for name, fit in zip(flat.plane, fits, strict=True):
        axis = AXES.index(name)
        low, high = borders[axis][spans[axis]].tolist()
        room = 0.04 * (high - low)
        fit(low - room, high + room)
    ax.set_aspect("equal")
    ax.set_xlabel(f"{flat.plane[0]} [m]")
    ax.set_ylabel(f"{flat.plane[1]} [m]")
    for scale in (ax.xaxis, ax.yaxis):
        scale.set_major_locator(MaxNLocator(5))


def _border(found: WorkspaceMap, axis: int) -> Vector:
    workspace = found.sweep.summary.workspace
    steps = np.arange(workspace.shape[axis] + 1)
    return np.asarray(workspace.origin[axis] + steps * workspace.edge, dtype=np.float64)


def spans_of(found: WorkspaceMap) -> tuple[float, float, float]:
    """Return the extent along x, y and z of the workspace part that contains postures, m."""
    window, edge = window_of(found.grid.postures), found.sweep.summary.workspace.edge
    x, y, z = (edge * (window[:, 1] - window[:, 0])).tolist()
    return x, y, z


def _draw_border(ax: Axes, flat: Flat, filled: Any) -> None:
    """Outline the cells with postures, as bright cells look similar to the white background."""
    from matplotlib.collections import LineCollection

    u, v = flat.edges
    around = np.pad(filled, 1)
    lines = []
    for i, j in np.argwhere(around[1:, 1:-1] != around[:-1, 1:-1]).tolist():
        lines.append([(u[i], v[j]), (u[i], v[j + 1])])
    for i, j in np.argwhere(around[1:-1, 1:] != around[1:-1, :-1]).tolist():
        lines.append([(u[i], v[j]), (u[i + 1], v[j])])
    ax.add_collection(
        LineCollection(lines, colors="0.3", linewidths=0.7, capstyle="projecting"),
        autolim=False,
    )


def _mark_unsure(ax: Axes, flat: Flat, one: Scale) -> None:
    cells = flat.cells
    chosen = (cells.postures > 0) & ~_is_sure(cells)
    i, j = np.nonzero(chosen)
    u, v = (0.5 * (edges[1:] + edges[:-1]) for edges in flat.edges)
    is_dark = cells.share[chosen] < 0.5 * (1.0 + one.floor)
    ax.scatter(u[i], v[j], s=2.0, c=np.where(is_dark, "white", "black"), linewidth=0.0, zorder=3)


def map_key(maps: Sequence[Cells]) -> list[Any]:
    """Return the legend handles of maps."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found: list[Any] = [
        Patch(facecolor="white", edgecolor="0.3", linewidth=0.7, label="no posture"),
        mark("P", "white", 5.5, "origin of the root's axes"),
    ]
    if any(((cells.postures > 0) & ~_is_sure(cells)).any() for cells in maps):
        dot: Options = {"linestyle": "none", "marker": "o", "markersize": 1.8, "color": BLACK}
        found.append(Line2D([], [], **dot, label=UNSURE_WORDS))
    return found


def colour_bar(ax: Axes, beside: Sequence[Axes], one: Scale, **place: Any) -> None:
    """Add a colour bar beside the axes that share it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    figure: Any = ax.get_figure(root=False)
    shades = ScalarMappable(Normalize(one.floor, 1.0), _COLOURS)
    options = {"pad": 0.02, "fraction": 0.05, "aspect": 24.0} | place
    bar = figure.colorbar(
        shades, ax=list(beside), extend="min" if one.reaches_below else "neither", **options
    )
    bar.set_label("tolerated [% of the postures]")
    steps = np.linspace(one.floor, 1.0, 6 if one.floor in {0.0, 0.5, 0.9, 0.95, 0.99, 0.995} else 5)
    bar.set_ticks(steps.tolist(), labels=[f"{100.0 * step:.4g}" for step in steps])


def solid_in_words(blocks: Located) -> list[str]:
    """Return a description of a 3D map."""
    words = [f"blocks of {blocks.edge:g} m; the brighter, the more transparent"]
    return words if _is_sure(blocks.cells).all() else [*words, f"small: {UNSURE_WORDS}"]


def paint_solid(ax: Any, blocks: Located, one: Scale, points: float | None = None) -> None:
    """Draw blocks of cells as squares facing the viewer.

    Parameters
    ----------
    ax :
        Three-dimensional axes.
    blocks, one :
        The blocks, and their colour scale.
    points :
        Height of the axes, pt, if they have no final layout yet.
    """
    from matplotlib import colormaps

    place, edge = blocks.place, blocks.edge
    badness = np.clip((1.0 - blocks.cells.share) / (1.0 - one.floor), 0.0, 1.0)
    colours = colormaps[_COLOURS](1.0 - badness)
    colours[:, 3] = _FAINTEST + (1.0 - _FAINTEST) * badness**1.5
    low, high = place.min(axis=0) - 0.5 * edge, place.max(axis=0) + 0.5 * edge
    side = 0.5 * float((high - low).max())
    size = _OF_HEIGHT * (_points(ax) if points is None else points) * edge / (2.0 * side)
    sizes = np.where(_is_sure(blocks.cells), size, 0.4 * size)
    square: Options = {"marker": "s", "linewidth": 0.0, "depthshade": False}
    ax.scatter(*place.T, s=sizes**2, c=colours, **square, rasterized=True)
    origin: Options = {"marker": "P", "markersize": 6.0, "markerfacecolor": "white"}
    ax.plot([0.0], [0.0], [0.0], linestyle="none", **origin, markeredgecolor=BLACK)
    cube(ax, low, high, side, nbins=5, prune="both")
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=1.1)
    ax.view_init(elev=22.0, azim=-55.0)


def _points(ax: Axes) -> float:
    """Return the height of square axes, pt."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    return float(72.0 / figure.dpi * min(ax.bbox.width, ax.bbox.height))
