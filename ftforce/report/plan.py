"""Planned paths as text, JSON and table rows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, document, plain
from ftforce.report.text import joined, ratio, set_of, size

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ftforce.planning.guarantee import Broken, Guarantee
    from ftforce.planning.locks import Locks
    from ftforce.planning.path import Along, PathPlan
    from ftforce.robot.robot import Robot

_SAME = 1e-6  # relative: no gain

NOT_CHECKED = "collisions are not checked"


class Worst(NamedTuple):
    """The worst instant of a path: its time, s, the measure, its mean, and the fault set."""

    time: float
    value: float
    mean: float
    joints: tuple[int, ...]


def sentences(plan: PathPlan) -> list[str]:
    """Return what is to be said of a plan."""
    found = [reach_sentence(plan), plan_sentence(plan), guarantee_sentence(plan)]
    return [one for one in found if one]


def worst_of(plan: PathPlan, path: Along) -> Worst:
    """Return the worst instant of the usual or the planned path."""
    i = plan.worst_of(path)
    joints = plan.sets[int(path.worst_set[i])].joints
    return Worst(float(plan.t[i]), float(path.value[i]), float(path.value.mean()), joints)


def plan_sentence(plan: PathPlan) -> str:
    """Say what the planned path keeps, where the usual one does not."""
    before, after = worst_of(plan, plan.before), worst_of(plan, plan.after)
    measure, shown = plan.objective.measure, in_words_of(plan)
    what = f"the {measure.words} {after_what(plan)}"
    slower = ""
    if plan.breaks.slow_down > 1.0:
        slower = f", {plan.breaks.slow_down:.3g} times slower than asked for"
    gain = (before.value - after.value) if measure.is_cost else (after.value - before.value)
    if gain <= _SAME * abs(before.value):
        return (
            f"No better path was found: {what} is {shown(after.value)} at its worst, with "
            f"{set_of(after.joints)} at {after.time:.3g} s; on the usual path it is "
            f"{shown(before.value)}{slower}."
        )
    verb = "falls" if measure.is_cost else "rises"
    return (
        f"At its worst instant, {what} {verb} from {shown(before.value)} "
        f"({set_of(before.joints)} at {before.time:.3g} s) to {shown(after.value)} "
        f"({set_of(after.joints)} at {after.time:.3g} s){slower}."
    )


def locks_in_words(robot: Robot, locks: Locks) -> str:
    """Say which joints have locked, where, and when."""
    found = joined(
        f"joint {i + 1} ({robot.names[i]}) at {locks.q[i]:.4g} {robot.units[i]}"
        for i in locks.joints
    )
    return f"{found}, {f'from {locks.time:g} s on' if locks.time else 'before the path'}"


def reach_sentence(plan: PathPlan) -> str:
    """Say where the tip leaves the tool path, and by how much; empty if it does not."""
    if plan.reached.all():
        return ""
    off = ~plan.reached
    far, angle = plan.deviation.max(axis=0).tolist()
    worst = float(plan.t[plan.deviation[:, 0].argmax()])
    turned = f" and {angle:.3g} rad" if plan.keeps_orientation else ""
    where = f"first at {float(plan.t[off.argmax()]):.4g} s"
    if off.all():
        where = "everywhere"
    return (
        f"The damaged arm leaves the tool path {where}: it is on it for "
        f"{percent(plan.reached.mean())} of the time, and goes on as close as it comes, at "
        f"most {size(far)} m{turned} away, farthest at {worst:.4g} s."
    )


def percent(share: float) -> str:
    """Return a share in percent, which is 0 and 100 % only where it is."""
    shown = f"{100.0 * share:.3g} %"
    return "99.9 %" if share < 1.0 and shown == "100 %" else shown


def guarantee_sentence(plan: PathPlan) -> str:
    """Say for how many locks on the way the arm finishes the path; empty if that was not asked."""
    found = plan.guarantee
    if found is None:
        return ""
    kept = "finishes the path"
    if plan.question.force is not None:
        kept += " and keeps the force"
    if found.holds.all():
        return f"Guaranteed: whichever joint locks at whichever waypoint, the arm {kept}."
    return (
        f"For {percent(found.share)} of waypoints and joints, the arm {kept} when that joint "
        "locks there."
    )


def broken_by_joint(found: Guarantee) -> Iterator[tuple[int, Sequence[Broken]]]:
    """Yield the joints after whose lock the arm was not seen to finish, with the locks."""
    for joint in range(found.holds.shape[1]):
        if own := [one for one in found.broken if one.joint == joint]:
            yield joint, own


def after_what(plan: PathPlan) -> str:
    """Say after which faults the objective is."""
    if plan.locks is None:
        return "after the worst fault"
    others = plan.largest - len(plan.locks.joints)
    return "after the lock" if others < 1 else f"after the lock and up to {others} more"


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


def _lock_positions(locks: Locks) -> list[float]:
    return [float(locks.q[i]) for i in locks.joints]


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
    Field("locked", "the joints that have locked; `null` if none has", get="locks", parts=(
        Field("joints", "the joints", shape="names"),
        Field("positions", "where they locked", "rad, m", "list", get=_lock_positions),
        Field("time", "when; 0 if before the path", "s"),
    )),
    Field("reached", "whether the tip is on the tool path, over time", shape="N"),
    Field("deviation", "how far it is from there, over time", "m, rad", "N × 2"),
    Field("guarantee", "what follows if one more joint locks at a waypoint; `null` if that was not "
        "asked", parts=(
        Field("share", "share of waypoints and joints for which the arm finishes the path"),
        Field("times", "times of the waypoints", "s", "k", "t"),
        Field("holds", "whether it finishes after a lock there", shape="k × n"),
        Field("broken", "the locks after which it was not seen to finish", shape="list", parts=(
            Field("waypoint", "where it locks, from 1", get=lambda x: x.waypoint + 1),
            Field("joint", "the joint", shape="name"),
            Field("until", "the first waypoint that is not followed, from 1",
                get=lambda x: x.until + 1),
            Field("reason", "`reach`, `position limit`, `velocity limit` or `force`"),
            Field("stopped", "the joint at its limit; `null` for none", shape="name",
                get=lambda x: None if x.other < 0 else x.other),
        )),
    )),
    Field("waypoints", "number of points at which postures are compared"),
    Field("broken", "numbers of the waypoints, from 1, that no path reaches in time at the speed "
        "asked for", shape="list", get=lambda x: [k + 1 for k in x.breaks.waypoints]),
    Field("slow_down", "factor by which the planned path is slower than asked for",
        get="breaks.slow_down"),
    Field("tip_error", "largest distance and angle of the tip from the tool path", "m, rad"),
    replace(parts.SUMMARY, get=lambda x: " ".join(sentences(x))),
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
