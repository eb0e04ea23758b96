"""Plot of the best posture: what the worst fault leaves along the self-motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.show.plots.canvas import BLACK, BLUE, VERMILION, Options, canvas, fit, key, line_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.planning.posture import BestPosture

_MOST_PIECES = 7  # curves that can be told apart


def along_self_motion(found: BestPosture, *, ax: Axes | None = None) -> Axes:
    """Draw what the worst fault leaves along the self-motion, and the two postures.

    A one-dimensional self-motion is drawn over the length of its curves in joint space; one of more
    dimensions over the distance in joint space from the posture before.

    Parameters
    ----------
    found :
        The best posture.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    objective, motion = found.objective, found.self_motion
    with canvas(ax, 2.6) as axes:
        places = _curves(axes, found) if motion.dimension == 1 else _scatter(axes, found)
        ends = ((found.measured_before, VERMILION, "o"), (found.measured_after, BLUE, "D"))
        for name, place, (measured, colour, marker) in zip(
            ("before", "after"), places, ends, strict=True
        ):
            value = measured[found.worst_set(measured)]
            look: Options = {
                "color": colour,
                "markeredgecolor": BLACK,
                "markersize": 5.0,
                "zorder": 4,
            }
            axes.plot(place, value, marker, linestyle="none", label=name, **look)
        unit = f" [{objective.unit}]" if objective.unit else ""
        axes.set_ylabel(f"{objective.name}{unit}")
        fit(axes, found.values)
        words = objective.measure.words
        axes.set_title(
            f"{words[0].upper()}{words[1:]} after the worst fault, along the self-motion"
        )
        key(axes)
    return axes


def _curves(axes: Axes, found: BestPosture) -> tuple[float, float]:
    """Draw the curves one after the other, and return where the two postures are."""
    motion = found.self_motion
    begin, first, q, place = 0.0, 0, [], []
    for i, piece in enumerate(motion.components):
        length = begin + _length(piece.q)
        values = found.values[first : first + len(piece.q)]
        style = line_of(min(i, _MOST_PIECES), len(motion.components), len(length))
        label = f"piece {i + 1}{', a loop' if piece.closed else ''}" if i < _MOST_PIECES else None
        axes.plot(length, values, label=label, **style)
        q.append(piece.q)
        place.append(length)
        first += len(piece.q)
        begin = float(length[-1]) + 0.2
    axes.set_xlabel("length of the curves in joint space [rad, m]")
    whole, at = np.concatenate(q), np.concatenate(place)
    both = []
    for posture in (found.before, found.after):
        apart = motion.manifold.between(whole, posture.q, motion.manifold.wide)
        both.append(float(at[int(np.linalg.norm(apart, axis=1).argmin())]))
    return both[0], both[1]


def _length(q: Matrix) -> Vector:
    """Return the length of a curve up to each of its samples."""
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    lengths: Vector = np.concatenate([[0.0], np.cumsum(steps)])
    return lengths


def _scatter(axes: Axes, found: BestPosture) -> tuple[float, float]:
    """Draw the samples over their distance from the posture before."""
    motion = found.self_motion
    both = np.concatenate([motion.q, found.after.q[None]])
    apart = motion.manifold.between(both, found.before.q, motion.manifold.wide)
    distance = np.linalg.norm(apart, axis=1)
    look: Options = {"color": "0.45", "markersize": 1.5, "linestyle": "none"}
    axes.plot(distance[:-1], found.values, ".", label="postures", **look)
    axes.set_xlabel("distance from the posture before, in joint space [rad, m]")
    return 0.0, float(distance[-1])
