"""The best path through a lattice of postures, by dynamic programming.

A lattice has a layer of postures for every waypoint, each with a value to maximise. An edge joins
two postures of neighbouring layers if every joint can move from one to the other in time. The best
path has the largest smallest value, and among those that share it the largest mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector

    Indices = NDArray[np.intp]

_ROUNDING = 1e-12  # relative: a joint at its velocity limit is within it


class Layer(NamedTuple):
    """The postures of one waypoint.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (s, n).
    value :
        What is maximised, shape (s,); NaN or -∞ where a posture must not be used.
    """

    q: Matrix
    value: Vector


class LatticePath(NamedTuple):
    """A path through a lattice.

    Attributes
    ----------
    chosen :
        Index of the posture in each layer, shape (k,).
    worst, mean :
        Smallest and mean value on the path.
    """

    chosen: Indices
    worst: float
    mean: float


def best_path(layers: Sequence[Layer], steps: Matrix, wraps: Mask) -> LatticePath | None:
    """Return the path with the largest smallest value, then the largest mean.

    Parameters
    ----------
    layers :
        The k layers, in order.
    steps :
        Largest motion of each joint from one layer to the next, rad or m, shape (k - 1, n);
        infinite where it is not limited.
    wraps :
        True at joints that turn without limits, whose positions count modulo 2π, shape (n,).

    Returns
    -------
    :
        The path; ``None`` if no path is within ``steps``.
    """
    edges = [ratio <= 1.0 + _ROUNDING for ratio in _ratios(layers, steps, wraps)]
    values = [np.where(np.isnan(layer.value), -np.inf, layer.value) for layer in layers]
    worst = _largest_minimum(values, edges)
    if worst == -np.inf:
        return None
    # Two passes, since a sum of values must not make up for a smaller minimum.
    chosen = _largest_sum([np.where(x >= worst, x, -np.inf) for x in values], edges)
    taken = np.array([x[i] for x, i in zip(values, chosen, strict=True)])
    return LatticePath(chosen, float(taken.min()), float(taken.mean()))


class Breaks(NamedTuple):
    """Where a lattice has no path that is fast enough.

    Attributes
    ----------
    waypoints :
        Indices of the layers that no path reaches in time from the one before.
    slow_down :
        Least factor on all times for which there is a path; infinite if there is none at any speed.
    """

    waypoints: tuple[int, ...]
    slow_down: float


def breaks_of(layers: Sequence[Layer], steps: Matrix, wraps: Mask) -> Breaks:
    """Return where the velocity limits break every path, and how much slower one is possible.

    Parameters
    ----------
    layers, steps, wraps :
        As in `best_path`.
    """
    allowed = [np.isfinite(np.nan_to_num(layer.value, nan=-np.inf)) for layer in layers]
    found: list[int] = []
    reached: Mask = allowed[0]
    slow_down = np.where(allowed[0], 0.0, np.inf)
    for k, ratio in enumerate(_ratios(layers, steps, wraps), start=1):
        is_edge = (ratio <= 1.0 + _ROUNDING) & reached[:, None] & allowed[k]
        reached = np.asarray(is_edge.any(axis=0))
        if not reached.any():
            found.append(k)
            reached = allowed[k]
        # Minimax path: the largest ratio on the way, as small as possible.
        slow_down = np.maximum(slow_down[:, None], ratio).min(axis=0, initial=np.inf)
        slow_down = np.where(allowed[k], slow_down, np.inf)
    return Breaks(tuple(found), float(slow_down.min(initial=np.inf)))


def _ratios(layers: Sequence[Layer], steps: Matrix, wraps: Mask) -> Iterator[Matrix]:
    """Yield, for neighbouring layers, the largest motion over what is allowed, shape (s, s')."""
    for before, after, step in zip(layers, layers[1:], steps, strict=False):
        ratio = np.zeros((len(before.q), len(after.q)))
        for j, most in enumerate(step.tolist()):
            turn = np.abs(after.q[:, j] - before.q[:, j, None])
            if wraps[j]:
                turn %= 2.0 * np.pi
                turn = np.minimum(turn, 2.0 * np.pi - turn)
            np.maximum(ratio, turn / most, out=ratio)
        yield ratio


def _largest_minimum(values: Sequence[Vector], edges: Sequence[Mask]) -> float:
    """Return the largest value below which some path does not fall; -∞ if there is no path."""
    best = values[0]
    for value, edge in zip(values[1:], edges, strict=True):
        before = np.where(edge, best[:, None], -np.inf).max(axis=0, initial=-np.inf)
        best = np.minimum(before, value)
    return float(best.max(initial=-np.inf))


def _largest_sum(values: Sequence[Vector], edges: Sequence[Mask]) -> Indices:
    """Return the path with the largest sum of values; there must be one."""
    before: list[Indices] = []
    total = values[0]
    for value, edge in zip(values[1:], edges, strict=True):
        sums = np.where(edge, total[:, None], -np.inf)
        before.append(sums.argmax(axis=0))
        total = sums.max(axis=0) + value
    chosen = [int(total.argmax())]
    for back in reversed(before):
        chosen.append(int(back[chosen[-1]]))
    return np.array(chosen[::-1])
