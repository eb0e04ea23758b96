"""Planned paths as text, JSON and table rows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, document, plain
from ftforce.report.text import ratio, set_of, size

if TYPE_CHECKING:
    from collections.abc import Callable

    from ftforce.planning.path import Along, PathPlan

_SAME = 1e-6  # relative: no gain

NOT_CHECKED = "collisions are not checked"


class Worst(NamedTuple):
    """The worst instant of a path: its time, s, the measure, its mean, and the fault set."""

    time: float
    value: float
    mean: float
    joints: tuple[int, ...]


def worst_of(plan: PathPlan, path: Along) -> Worst:
    """Return the worst instant of the usual or the planned path."""
    i = plan.worst_of(path)
    joints = plan.sets[int(path.worst_set[i])].joints
    return Worst(float(plan.t[i]), float(path.value[i]), float(path.value.mean()), joints)


def plan_sentence(plan: PathPlan) -> str:
    """Say what the planned path keeps, where the usual one does not."""
    before, after = worst_of(plan, plan.before), worst_of(plan, plan.after)
    measure, shown = plan.objective.measure, in_words_of(plan)
    what = f"the {measure.words} after the worst fault"
    slower = ""
    if plan.breaks.slow_down > 1.0:
        slower = f", {plan.breaks.slow_down:.3g} times slower than asked for"
    gain = (before.value - after.value) if measure.is_cost else (after.value - before.value)
    if gain <= _SAME * abs(before.value):
        return (
            f"No better path was found: {what} is {shown(before.value)} at its worst, with "
            f"{set_of(before.joints)} at {before.time:g} s, as on the usual path{slower}."
        )
    verb = "falls" if measure.is_cost else "rises"
    return (
        f"At its worst instant, {what} {verb} from {shown(before.value)} "
        f"({set_of(before.joints)} at {before.time:.3g} s) to {shown(after.value)} "
        f"({set_of(after.joints)} at {after.time:.3g} s){slower}."
    )


def in_words_of(plan: PathPlan) -> Callable[[float], str]:
    """Return what formats a value of the objective with its unit."""
    unit = plan.objective.unit
    return (lambda x: f"{size(x)} {unit}") if unit else ratio


# fmt: off
_PATH = (
    Field("time", "time of the worst instant", "s"),
    Field("value", "the measure after the worst set, at that instant"),
    Field("mean", "its mean over the path"),
    Field("worst_set", "joints of that set", shape="names", get="joints"),
    Field("q", "joint positions over time", "rad, m", "N × n"),
    Field("values", "the measure after the worst set, over time", shape="N"),
)


def _path(plan: PathPlan, path: Along) -> SimpleNamespace:
    return SimpleNamespace(**worst_of(plan, path)._asdict(), q=path.q, values=path.value)


PLAN = (
    replace(parts.ROBOT, shape="as of an analysis"),
    Field("conventions", "as of an analysis", shape="as of an analysis",
        get=lambda x: parts.Asked(x.task, x.scale, x.rtol, x.wary, x.conditions),
        parts=parts.CONVENTIONS),
    Field("course", "description of the tool path"),
    Field("keeps_orientation", "whether the orientation of the tip is kept"),
    Field("start", "where the initial posture of the usual path comes from"),
    Field("mode", "`locked` or `free`"),
    Field("faults", "size of the largest sets", get="largest"),
    Field("limits", "torque limits in force", shape="as of an analysis", parts=parts.LIMITS),
    Field("objective", "what is best at its worst instant", get="objective", parts=(
        Field("name", "`margin`, `rho`, `capability`, `payload` or `jump`, which is minimised"),
        Field("unit", "its unit; empty for none"),
    )),
    Field("before", "the usual path, at its worst and over time",
        get=lambda x: _path(x, x.before), parts=_PATH),
    Field("after", "the planned path, likewise", get=lambda x: _path(x, x.after), parts=_PATH),
    Field("times", "times of the instants", "s", "N", "t"),
    Field("waypoints", "number of points at which postures are compared"),
    Field("broken", "numbers of the waypoints, from 1, that no path reaches in time at the speed "
        "asked for", shape="list", get=lambda x: [k + 1 for k in x.breaks.waypoints]),
    Field("slow_down", "factor by which the planned path is slower than asked for",
        get="breaks.slow_down"),
    Field("tip_error", "largest distance and angle of the tip from the tool path", "m, rad"),
    replace(parts.SUMMARY, get=plan_sentence),
    Field("notes", "what was chosen", shape="list"),
    parts.WARNINGS,
)
# fmt: on


def plan_document(plan: PathPlan) -> Document:
    """Return a plan as a JSON document: both paths at their worst, and over time."""
    return document(PLAN, plan, plan.robot.names)


def plan_rows(plan: PathPlan) -> list[Row]:
    """Return the planned motion as table rows, which `ftforce.simulate` reads."""
    robot, name, unit = plan.robot, plan.objective.name, plan.objective.unit
    inside = f" [{unit}]" if unit else ""
    header = (
        "t [s]",
        *(f"{joint.name} [{joint.unit}]" for joint in robot.joints),
        f"{name}_after{inside}",
        f"{name}_before{inside}",
        "worst_set",
    )
    rows: list[Row] = [header]
    columns = zip(
        plan.t.tolist(), plan.after.q.tolist(), plain(plan.after.value), plain(plan.before.value),
        plan.after.worst_set.tolist(), strict=True,
    )  # fmt: skip
    for t, q, after, before, worst in columns:
        rows.append((t, *q, after, before, set_of(plan.sets[worst].joints)))
    return rows
