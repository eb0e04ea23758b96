"""Tables of a planned path."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.core.faults import FaultMode
from ftforce.report import text
from ftforce.report.plan import (
    NOT_CHECKED,
    after_what,
    broken_by_joint,
    in_words_of,
    locks_in_words,
    sentences,
    worst_of,
)
from ftforce.show.tables.analysis import (
    conditions_facts,
    force_fact,
    friction_facts,
    limits_in_words,
    task_facts,
)
from ftforce.show.tables.parts import arm_facts, facts, listing, spaced, warning_lines

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from ftforce.planning.guarantee import Broken, Guarantee
    from ftforce.planning.path import Along, PathPlan
    from ftforce.show.tables.parts import TitledTable


def plan_view(plan: PathPlan) -> RenderableType:
    """Return the tables of a planned path and of the usual one."""
    return spaced(
        facts(_situation(plan)),
        _paths(plan),
        _ranges(plan),
        _broken(plan),
        facts([("Assumed", note) for note in (*plan.notes, NOT_CHECKED)]),
        warning_lines((*plan.warnings, *_too_fast(plan))),
        Text(" ".join(sentences(plan)), style="bold"),
    )


def _situation(plan: PathPlan) -> list[tuple[str, str]]:
    robot, question, objective = plan.robot, plan.question, plan.objective
    kept = "position and orientation" if plan.keeps_orientation else "position; the tip may turn"
    best = "smallest" if objective.measure.is_cost else "largest"
    where = ""
    if question.direction is not None and objective.name == "capability":
        where = f" {text.vector_in_words(question.direction)}"
    return [
        *arm_facts(robot.name, robot),
        ("Joints", robot.numbered()),
        *task_facts(plan.task),
        *text.joint_kinds(plan.scale),
        ("Path", f"{plan.course} (points in the root's axes)"),
        *([("Locked", locks_in_words(robot, plan.locks))] if plan.locks is not None else []),
        ("Kept", kept),
        ("Start", f"free; of the usual path: {plan.start}"),
        *([force_fact(plan.task, question.force)] if question.force is not None else []),
        ("Objective", f"{best} {objective.measure.words}{where}, {after_what(plan)}"),
        *conditions_facts(plan.conditions),
        *(friction_facts(question) if plan.mode is FaultMode.FREE else []),
        ("Limits", limits_in_words(plan.limits, (), robot, ())),
        ("Lattice", f"{plan.waypoints} waypoints; {len(plan.t):,} instants to {plan.t[-1]:.4g} s"),
        *_tip(plan),
    ]


def _tip(plan: PathPlan) -> Iterator[tuple[str, str]]:
    if plan.reached.any():
        where = "" if plan.reached.all() else ", where it reaches it"
        yield "Tip", f"within {plan.tip_error:.1g} m and rad of its path{where}"


def _paths(plan: PathPlan) -> TitledTable:
    count = f"up to {plan.largest} " if plan.largest > 1 else "one "
    return listing(
        f"The worst instant, {count}joint{'s' * (plan.largest > 1)} {plan.mode}"
        if plan.locks is None
        else f"The worst instant, {after_what(plan)}",
        [_path(plan, "usual", plan.before), _path(plan, "planned", plan.after)],
        left=1,
        folded=(0, 2),
    )


def _path(plan: PathPlan, name: str, path: Along) -> Iterator[tuple[str, str]]:
    worst, shown = worst_of(plan, path), in_words_of(plan)
    names = plan.robot.names
    yield "path", name
    yield "at", f"{worst.time:.3g} s"
    yield "worst set", f"{text.set_of(worst.joints)} {', '.join(names[i] for i in worst.joints)}"
    yield plan.objective.name, shown(worst.value)
    yield "mean", shown(worst.mean)


def _ranges(plan: PathPlan) -> TitledTable:
    return listing(
        "Joint positions: where the planned path starts, and what it covers",
        [_range(plan, i) for i in range(plan.robot.n)],
        left=2,
        folded=(1,),
    )


def _range(plan: PathPlan, i: int) -> Iterator[tuple[str, str]]:
    joint, q = plan.robot.joints[i], plan.after.q[:, i]
    yield "", str(i + 1)
    yield "joint", joint.name
    yield "unit", joint.unit
    yield "usual start", text.number(float(plan.before.q[0, i]), 3)
    yield "start", text.number(float(q[0]), 3)
    yield "least", text.number(float(q.min()), 3)
    yield "most", text.number(float(q.max()), 3)


def _broken(plan: PathPlan) -> TitledTable | None:
    """Return the table of the locks after which the arm was not seen to finish."""
    found = plan.guarantee
    if found is None or found.holds.all():
        return None
    rows = [_lock(plan, found, joint, own) for joint, own in broken_by_joint(found)]
    title = "Locks after which the arm was not seen to finish the path"
    return listing(title, rows, left=2, folded=(1, 4))


def _lock(
    plan: PathPlan, found: Guarantee, joint: int, own: Sequence[Broken]
) -> Iterator[tuple[str, str]]:
    slow_down, first = plan.breaks.slow_down, float(found.t[0])
    times = [first + (float(found.t[one.waypoint]) - first) * slow_down for one in own]
    reasons = Counter(_reason(one) for one in own)
    yield "", str(joint + 1)
    yield "joint", plan.robot.names[joint]
    yield "waypoints", f"{len(own)} of {len(found.t)}"
    yield "locked at", f"{times[0]:.3g} to {times[-1]:.3g} s"
    yield "why the rest is not followed", "; ".join(f"{one} ({n})" for one, n in reasons.items())


def _reason(one: Broken) -> str:
    if one.other >= 0:
        return f"{one.reason} of joint {one.other + 1}"
    return {"reach": "out of reach", "force": "the force is not kept"}[one.reason]


def _too_fast(plan: PathPlan) -> Iterator[str]:
    slow_down = plan.breaks.slow_down
    if plan.breaks.waypoints:
        where = text.joined(str(k + 1) for k in plan.breaks.waypoints[:5])
        more = len(plan.breaks.waypoints) - 5
        where += f" and {more} more" if more > 0 else ""
        which = "waypoint" if len(plan.breaks.waypoints) == 1 else "waypoints"
        yield (
            f"at the speed that was asked for, the joints' velocity limits break every path at "
            f"{which} {where} of {plan.waypoints}; the path above takes {slow_down:.3g} times as "
            "long, the least that was found"
        )
    elif slow_down > 1.0:
        yield f"the path takes {slow_down:.3g} times as long, to keep the limits of the joints"
