"""Plots of histories: torques, force, force jump, path error, and path."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ftforce.errors import UnknownNameError
from ftforce.report.text import NEGLIGIBLE
from ftforce.show.plots.canvas import (
    BLACK,
    LINE_COLOURS,
    LONGEST_NAME,
    MARKERS,
    STROKES,
    Options,
    canvas,
    cube,
    fit,
    frame,
    key,
    line_of,
    shortened,
    sparse,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.trajectory.history import History


Torque = Literal["motor", "U", "force_part", "rnea", "brake"]
Kind = Literal["force", "moment"]

_SMALLEST_ERROR = 1e-3  # mm; smaller errors are due to the integration

_TORQUES = {
    "motor": "motor torque",
    "U": "torque U for the force",
    "force_part": "torque JᵀF",
    "rnea": "torque of weight and motion",
    "brake": "brake torque",
}


def torques(
    history: History,
    run: str = "remapped",
    *,
    quantity: Torque = "motor",
    ax: Axes | None = None,
) -> Axes:
    """Draw the joint torques over time; gaps mark the time after the arm falls.

    Parameters
    ----------
    history :
        The simulation history.
    run :
        ``healthy``, ``unremapped`` or ``remapped``.
    quantity :
        ``motor``, ``U``, ``force_part``, ``rnea`` or ``brake``; see `Run`.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The run or quantity is unknown, or ``ax`` is not two-dimensional.
    """
    if run not in history.runs:
        raise UnknownNameError("run", run, history.runs)
    if quantity not in _TORQUES:
        raise UnknownNameError("torque", quantity, _TORQUES)
    values = getattr(history.runs[run], quantity)
    joints, name = history.setting.joints, _TORQUES[quantity]
    units = sorted({joint.torque_unit for joint in joints}, reverse=True)
    with canvas(ax, 2.6) as axes:
        axes.axhline(0.0, color="0.7", linewidth=0.6)
        for i, joint in enumerate(joints):
            label = f"{i + 1} {shortened(joint.name, LONGEST_NAME)}"
            label += f" [{joint.torque_unit}]" if len(units) > 1 else ""
            style = line_of(i, len(joints), len(history.t))
            axes.plot(history.t, values[:, i], label=label, **style)
        title = f"{name[0].upper()}{name[1:]}, {STROKES[run].words}"
        frame(axes, history, title, f"{name} [{', '.join(units)}]")
        fit(axes, values)
        key(axes, gap=bool(np.isnan(values).any()))
    return axes


def force(history: History, *, kind: Kind | None = None, ax: Axes | None = None) -> Axes:
    """Draw the components of the tip force over time, for all runs (Fig. 4 of the paper).

    Parameters
    ----------
    history :
        The simulation history.
    kind :
        ``force`` or ``moment``; by default forces, or moments if the task has no forces.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        The task has no such components, or ``ax`` is not two-dimensional.
    """
    task = history.setting.task
    kinds = {k: r for k, r in (("force", task.force_rows), ("moment", task.moment_rows)) if r}
    if kind is not None and kind not in kinds:
        raise UnknownNameError("kind of component", kind, kinds, f"in the task '{task}'")
    what: str = kind or ("force" if "force" in kinds else "moment")
    rows = list(kinds[what])
    label = f"{what} [{task.units[rows[0]]}]"
    if len(kinds) > 1:
        label += f"\n({'moments' if what == 'force' else 'forces'} not shown)"
    with canvas(ax, 2.4) as axes:
        axes.axhline(0.0, color="0.7", linewidth=0.6)
        for name, run in history.runs.items():
            for i, row in enumerate(rows):
                options = STROKES[name].options(LINE_COLOURS[i])
                axes.plot(history.t, run.force[:, row], **options, **_marker(history, name, i))
        frame(axes, history, f"{what.capitalize()} at the tip, in {task.axes} axes", label)
        drawn = np.stack([run.force[:, rows] for run in history.runs.values()])
        fit(axes, drawn)
        key(axes, _force_key(history, rows), gap=bool(np.isnan(drawn).any()))
    return axes


def _marker(history: History, run: str, i: int) -> dict[str, Any]:
    """Return markers that identify components without colour, staggered between runs."""
    place = 3 * list(history.runs).index(run) + i
    every = sparse(place, 9, len(history.t))
    return {
        "marker": MARKERS[i],
        "markevery": every,
        "markersize": 5.0 if run == "healthy" else 3.0,
    }


def _force_key(history: History, rows: Sequence[int]) -> list[Any]:
    from matplotlib.lines import Line2D

    components = []
    for i, row in enumerate(rows):
        look: Options = {
            "color": LINE_COLOURS[i],
            "marker": MARKERS[i],
            "linewidth": 4.0,
            "alpha": 0.6,
        }
        components.append(Line2D([], [], **look, label=history.setting.task.components[row]))
    runs = [
        Line2D([], [], label=STROKES[name].words, **STROKES[name].options("0.2"))
        for name in history.runs
    ]
    return [*components, *runs]


def jump(history: History, *, ax: Axes | None = None) -> Axes:
    """Draw the magnitude of the force jump over time, for all runs.

    Parameters
    ----------
    history :
        The simulation history.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    sizes = {name: history.jump_norm(run) for name, run in history.runs.items()}
    what, unit = ("Force", "N") if history.setting.task.force_rows else ("Moment", "N·m")
    return _of_runs(history, sizes, (f"{what} jump", f"‖ΔF‖ [{unit}]"), NEGLIGIBLE, ax)


def path_error(history: History, *, ax: Axes | None = None) -> Axes:
    """Draw the distance of the tip from its path over time, for all runs, until the arm falls.

    Parameters
    ----------
    history :
        The simulation history.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    sizes = {}
    for name, run in history.runs.items():
        until = len(history.t) if run.falls_from is None else run.falls_from
        sizes[name] = np.where(np.arange(len(history.t)) < until, 1e3 * run.path_error_norm, np.nan)
    words = ("Distance of the tip from its path", "path error [mm]")
    return _of_runs(history, sizes, words, _SMALLEST_ERROR, ax)


def _of_runs(
    history: History,
    values: dict[str, Vector],
    words: tuple[str, str],
    least: float,
    ax: Axes | None,
) -> Axes:
    """Draw a magnitude over time for all runs; values up to ``least`` are rounding errors."""
    with canvas(ax, 1.8) as axes:
        for name, line in values.items():
            axes.plot(history.t, line, label=STROKES[name].words, **STROKES[name].options())
        frame(axes, history, *words)
        drawn = np.stack(list(values.values()))
        fit(axes, drawn, positive=True, least=least)
        key(axes, gap=bool(np.isnan(drawn).any()))
    return axes


def path(history: History, *, ax: Axes | None = None) -> Axes:
    """Draw the tip path in root axes, for all runs, until the arm falls.

    Parameters
    ----------
    history :
        The simulation history.
    ax :
        Axes with ``projection="3d"``; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not three-dimensional.
    """
    with canvas(ax, 4.2, solid=True) as axes:
        solid: Any = axes
        solid.plot(*history.path.T, color="0.85", linewidth=7.0, label="reference")
        for name, run in history.runs.items():
            stroke = STROKES[name]
            solid.plot(*run.position[run.until_fall].T, label=stroke.words, **stroke.options())
        tip = history.answer.position
        for place, marker, words in _places(history):
            options = {"color": BLACK, "markerfacecolor": "white", "markersize": 5.0}
            solid.plot(*tip[place].T, linestyle="none", marker=marker, label=words, **options)
        drawn = (run.position[run.until_fall] for run in history.runs.values())
        _look_at(solid, np.vstack([history.path, *drawn]))
        axes.set_title("Path of the tip")
        axes.legend(loc="upper right", bbox_to_anchor=(0.0, 1.0), frameon=False, borderaxespad=0.0)
    return axes


def _places(history: History) -> list[tuple[list[int], str, str]]:
    falls = history.answer.falls_from
    last = len(history.t) - 1 if falls is None else falls
    faults = [history.index(event.time) for event in history.setting.events]
    faults = [i for i in faults if i <= last]
    end = ([last], "s", "end") if falls is None else ([last], "v", "falls")
    found = [([0], "o", "start"), end]
    return [*found, (faults, "X", "fault")] if faults else found


def _look_at(ax: Any, points: Matrix) -> None:
    """Fit a cube to the points, viewed from their side."""
    low, high = points.min(axis=0), points.max(axis=0)
    cube(ax, low, high, 0.55 * max(float((high - low).max()), 1e-3), nbins=3)
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=0.9)  # leaves space for tick labels and axis labels
    ax.view_init(elev=25.0, azim=_azimuth(points))


def _azimuth(points: Matrix) -> float:
    """Return the azimuth, in degrees, that shows a path from its side rather than end on."""
    main = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    side = math.degrees(math.atan2(main[1], main[0])) + 70.0

    def from_usual(azimuth: float) -> float:
        return abs((azimuth + 60.0 + 180.0) % 360.0 - 180.0)

    return min((side, side + 180.0), key=from_usual)
