"""Plots of planned paths: what is left after the worst fault over time, and the joint positions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ftforce.show.plots.canvas import (
    BLUE,
    DASHED,
    LONGEST_NAME,
    VERMILION,
    canvas,
    fit,
    key,
    line_of,
    shortened,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ftforce.planning.path import PathPlan


def objective_over_time(plan: PathPlan, *, ax: Axes | None = None) -> Axes:
    """Draw what the worst fault leaves over time, on the usual and on the planned path.

    Parameters
    ----------
    plan :
        The plan.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    objective = plan.objective
    with canvas(ax, 2.2) as axes:
        for name, path, colour, dashes in (
            ("usual path", plan.before, VERMILION, DASHED),
            ("planned path", plan.after, BLUE, "-"),
        ):
            (line,) = axes.plot(plan.t, path.value, color=colour, linestyle=dashes, label=name)
            i = plan.worst_of(path)
            axes.plot(
                plan.t[i], path.value[i], "D", color=line.get_color(), markerfacecolor="white"
            )
        unit = f" [{objective.unit}]" if objective.unit else ""
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"{objective.name}{unit}")
        fit(axes, plan.after.value)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        words = objective.measure.words
        title = f"{words[0].upper()}{words[1:]} after the worst fault; diamonds: worst instants"
        axes.set_title(title)
        key(axes)
    return axes


def planned_positions(plan: PathPlan, *, ax: Axes | None = None) -> Axes:
    """Draw the joint positions of the planned path, and of the usual one dashed.

    Parameters
    ----------
    plan :
        The plan.
    ax :
        Axes to draw on; a new figure by default.

    Raises
    ------
    InputError
        ``ax`` is not two-dimensional.
    """
    robot = plan.robot
    with canvas(ax, 2.8) as axes:
        for i, joint in enumerate(robot.joints):
            style = line_of(i, robot.n, len(plan.t))
            label = f"{i + 1} {shortened(joint.name, LONGEST_NAME)}"
            axes.plot(plan.t, plan.after.q[:, i], label=label, **style)
            thin = {**style, "linestyle": DASHED, "linewidth": 0.6, "marker": ""}
            axes.plot(plan.t, plan.before.q[:, i], **thin)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"position [{', '.join(sorted(set(robot.units)))}]")
        axes.set_title("Joint positions, planned; thin dashes: the usual path")
        key(axes)
    return axes
