"""A history on the page: charts over time, and tables for one instant."""

from __future__ import annotations

import math
from itertools import cycle, product
from typing import TYPE_CHECKING

import numpy as np

from ftforce.report import text
from ftforce.show.plots.canvas import LINE_COLOURS
from ftforce.view.page import html
from ftforce.view.page.curves import Curve, chart
from ftforce.view.page.tables import brake_loads, load_table, vector_table
from ftforce.view.scene.arrows import forces_of, moments_of
from ftforce.view.scene.colours import ARROW_COLOURS

if TYPE_CHECKING:
    from collections.abc import Callable

    from markupsafe import Markup

    from ftforce.core.arrays import Vector
    from ftforce.core.task import Task
    from ftforce.trajectory.history import History, Run
    from ftforce.view.scene.snapshots import Snapshot

_POINTS = 240  # per curve
_DASHES = ("", "5 2", "1.5 2")


def charts(history: History, run: Run) -> Markup:
    """Return all charts of a run.

    Parameters
    ----------
    history :
        The history.
    run :
        One of its runs.
    """
    task, found = history.setting.task, []
    if task.force_rows:
        found.append(_vector_chart(history, run, forces_of, "Force at the tip", "N"))
    if task.moment_rows:
        found.append(_vector_chart(history, run, moments_of, "Moment at the tip", "N·m"))
    return html.block(html.style(), *found, _torque_chart(history, run), testid="charts")


def chosen(history: History, run: Run) -> Vector:
    """Return the indices of the samples to plot, including both sides of each jump.

    Parameters
    ----------
    history :
        The history, of N samples.
    run :
        One of its runs.

    Returns
    -------
    :
        Increasing indices from 0 to N - 1.
    """
    count = len(history.t)
    some = np.rint(np.linspace(0, count - 1, min(count, _POINTS))).astype(int)
    jumps = np.flatnonzero(np.diff(run.verdict)).tolist()[:_POINTS]
    for event in history.setting.events:
        for time in (event.time, event.time + history.setting.delay):
            jumps.append(min(int(np.searchsorted(history.t, time)), count - 1) - 1)
    edges = np.array([i + k for i in jumps for k in (0, 1)], dtype=int)
    return np.unique(np.clip(np.concatenate([some, edges]), 0, count - 1))


def tables(history: History, now: Snapshot) -> Markup:
    """Return the tables of joints, force, path and margin at one instant.

    Parameters
    ----------
    history :
        The history.
    now :
        Its state at that instant.
    """
    i = now.sample
    vectors = {"requested": now.requested, "kept": now.kept, "lost": now.lost}
    is_held = now.kept is not None
    error = math.hypot(*now.run.path_error[i].tolist()) if is_held else math.nan
    pairs = [("Path error", "–" if math.isnan(error) else f"{1e3 * error:.2f} mm")]
    if is_held:
        margin = text.ratio(float(now.run.margin[i]))
        pairs.append(("Margin", f"{margin} = σ_min(K)/σ_max(J)"))
    pairs += brake_loads(now.loads)
    return html.block(
        load_table(now.loads, history.setting.has_masses, ("healthy", "now")),
        vector_table(history.setting.task, vectors),
        html.facts(pairs, "measures"),
        testid="answer",
    )


def _vector_chart(
    history: History, run: Run, part: Callable[[Task, Vector], Vector], title: str, unit: str
) -> Markup:
    """Return a chart of the requested, kept and lost forces, or moments."""
    task, at = history.setting.task, chosen(history, run)
    requested = np.tile(np.array(history.setting.force), (len(at), 1))
    kept, lost = (_until_fall(run, at, F[at]) for F in (run.force, run.jump))
    vectors = {"requested": requested, "kept": kept, "lost": lost}
    curves = [
        Curve(kind, np.linalg.norm(part(task, F), axis=1), html.css(ARROW_COLOURS[kind]))
        for kind, F in vectors.items()
    ]
    return chart(title, unit, history.t[at], curves, marks(history))


def _torque_chart(history: History, run: Run) -> Markup:
    """Return a chart of motor torques in percent of their limits, or in N·m (N) if none is known.

    Parameters
    ----------
    history :
        The history.
    run :
        One of its runs.
    """
    at = chosen(history, run)
    is_known = bool(np.isfinite(run.used).any())
    values = 100.0 * np.abs(run.used[at]) if is_known else run.motor[at]
    values = _until_fall(run, at, values)
    styles = cycle(product(_DASHES, LINE_COLOURS))  # vary the colour first, then the dashes
    curves = [
        Curve(f"{j + 1}", torques, colour, dashes)
        for j, (torques, (dashes, colour)) in enumerate(zip(values.T, styles, strict=False))
    ]
    unit = "% of the limit" if is_known else "N·m (N)"
    title = "Motor load by joint" if is_known else "Motor torque by joint"
    return chart(title, unit, history.t[at], curves, marks(history))


def _until_fall(run: Run, at: Vector, values: Vector) -> Vector:
    """Return the values up to the sample at which the arm falls."""
    if run.falls_from is None:
        return values
    return np.where((at < run.falls_from)[:, None], values, np.nan)


def marks(history: History) -> tuple[float, ...]:
    """Return the event times, s."""
    end = float(history.t[-1])
    return tuple(event.time for event in history.setting.events if event.time <= end)
