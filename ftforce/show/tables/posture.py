"""Tables of the best posture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from ftforce.core.faults import FaultMode
from ftforce.report import text
from ftforce.report.plan import NOT_CHECKED
from ftforce.report.posture import (
    in_words_of,
    pieces_in_words,
    posture_sentence,
    set_rows,
    worst_before_after,
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
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.planning.posture import BestPosture
    from ftforce.report.posture import SetGain
    from ftforce.show.tables.parts import TitledTable

MOST_SETS = 40
"""Maximum number of fault sets shown, those first of which least is left after."""


def posture_view(
    found: BestPosture, *, most: int = MOST_SETS, degrees: bool = False
) -> RenderableType:
    """Return the tables of the best posture and of the usual one.

    Parameters
    ----------
    found :
        The best posture.
    most :
        Maximum number of fault sets shown.
    degrees :
        Whether angles are shown in degrees.
    """
    return spaced(
        facts(_situation(found)),
        _joints(found, degrees),
        _sets(found, most),
        facts(_outcome(found)),
        facts([("Assumed", note) for note in (*found.notes, NOT_CHECKED)]),
        warning_lines(found.warnings),
        Text(posture_sentence(found), style="bold"),
    )


def _situation(found: BestPosture) -> list[tuple[str, str]]:
    robot, question, objective = found.robot, found.question, found.objective
    best = "smallest" if objective.measure.is_cost else "largest"
    where = ""
    if question.direction is not None and objective.name == "capability":
        where = f" {text.vector_in_words(question.direction)}"
    return [
        *arm_facts(robot.name, robot),
        ("Joints", robot.numbered()),
        *task_facts(found.task),
        *text.joint_kinds(found.scale),
        ("Target", _target(found)),
        ("Before", found.before.source),
        *([force_fact(found.task, question.force)] if question.force is not None else []),
        ("Objective", f"{best} {objective.measure.words}{where}, after the worst fault set"),
        *conditions_facts(found.conditions),
        *(friction_facts(question) if found.mode is FaultMode.FREE else []),
        ("Limits", limits_in_words(found.limits, (), robot, ())),
        ("Self-motion", pieces_in_words(found)),
    ]


def _target(found: BestPosture) -> str:
    target = found.self_motion.target
    place = text.vector_in_words(target.position)
    turned = "the tip may turn" if target.rotation is None else "orientation kept"
    return f"{place} m in root axes; {turned}"


def _joints(found: BestPosture, degrees: bool) -> TitledTable:
    unit = "rad" if not degrees else "deg"
    ranges = found.self_motion.ranges
    result = listing(
        "Joint positions",
        [_joint(found, i, ranges[i].tolist(), unit) for i in range(found.robot.n)],
        left=2,
        folded=(1,),
    )
    result.caption = "least, most: on the self-motion; lower, upper: the limits"
    return result


def _joint(found: BestPosture, i: int, ends: list[float], unit: str) -> Iterator[tuple[str, str]]:
    joint = found.robot.joints[i]
    is_turned = joint.type != "prismatic" and unit == "deg"

    def shown(x: float) -> str:
        if not np.isfinite(x):
            return "none"
        return f"{np.rad2deg(x):.1f}" if is_turned else f"{x:.3f}"

    yield "", str(i + 1)
    yield "joint", joint.name
    yield "unit", unit if joint.type != "prismatic" else "m"
    yield "before", shown(float(found.before.q[i]))
    yield "after", shown(float(found.after.q[i]))
    yield "least", shown(ends[0])
    yield "most", shown(ends[1])
    yield "lower", shown(joint.lower)
    yield "upper", shown(joint.upper)


def _sets(found: BestPosture, most: int) -> TitledTable:
    is_cost = found.objective.measure.is_cost
    rows = sorted(set_rows(found), key=lambda one: -one.after if is_cost else one.after)
    size = "1 joint" if found.largest == 1 else f"1 to {found.largest} joints"
    return listing(
        f"{found.objective.name.capitalize()} after every fault set, worst first "
        f"({len(rows)} of {size}, {found.mode})",
        [_set(found, one) for one in rows[:most]],
        left=2,
        folded=(1,),
    )


def _set(found: BestPosture, one: SetGain) -> Iterator[tuple[str, str]]:
    names = found.robot.names
    yield "set", text.set_of(one.faults.joints)
    yield "joints", ", ".join(names[i] for i in one.faults.joints)
    yield "before", in_words_of(found, one.before)
    yield "after", in_words_of(found, one.after)
    sign = "+" if one.gain > 0.0 else ""
    yield "gain", f"{sign}{in_words_of(found, one.gain)}"


def _outcome(found: BestPosture) -> list[tuple[str, str]]:
    lines = []
    for when, (value, faults) in zip(("before", "after"), worst_before_after(found), strict=True):
        said = f"{in_words_of(found, value)}, with {text.set_of(faults.joints)}"
        if found.bound:
            said += f" ({value / found.bound:.0%} of {text.ratio(found.bound)}, the bound)"
        lines.append((f"Worst {when}", said))
    if found.is_tied:
        lines.append(("Tie", "other postures are as good; this one is farthest from the limits"))
    return lines
