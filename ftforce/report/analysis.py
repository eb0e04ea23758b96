"""Verdicts in plain sentences, for tables and files alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict
from ftforce.report.text import (
    amounts,
    is_noticeable,
    joined,
    lost_directions,
    percent,
    ratio,
    size,
    torque_of,
    unit_of_size,
    vector_in_words,
    with_units,
)

if TYPE_CHECKING:
    from ftforce.analysis.analyze import Analysis
    from ftforce.analysis.census import Census
    from ftforce.analysis.fault_set import SetReport
    from ftforce.core.changes import ForceChange


def verdict_sentence(analysis: Analysis) -> str:
    """Say the verdict in one plain sentence, or a few."""
    about = _about(analysis)
    sentence = f"{analysis.verdict.value.capitalize()}: {faults_in_words(analysis)}, {about}."
    if analysis.force is not None and is_noticeable(analysis.force.unsupported):
        missing = amounts(analysis.task, analysis.force.unsupported)
        sentence += f" Even the healthy arm cannot exert {missing} of the request here."
    return sentence


def faults_in_words(analysis: Analysis) -> str:
    """Say which joints fail, and how: ``with elbow and wrist locked, hand free``."""
    names = analysis.robot.names
    parts = []
    for mode in FaultMode:
        joints = [fault for fault in analysis.faults.faults if fault.mode is mode]
        if joints and mode is FaultMode.WEAK:
            parts += [f"{names[f.joint]} at {f.factor:.0%} of its torque" for f in joints]
        elif joints:
            parts.append(f"{joined(names[f.joint] for f in joints)} {mode}")
    return f"with {joined(parts)}" if parts else "with every joint healthy"


def _about(analysis: Analysis) -> str:
    if not analysis.can_stand_still:
        return _about_falling(analysis) + _unless(analysis)
    if analysis.force is None:
        return _about_all_forces(analysis)
    return _about_one_force(analysis, analysis.force)


def _unless(analysis: Analysis) -> str:
    if analysis.verdict is not Verdict.BORDERLINE:
        return ""
    return (
        f" at the tolerance {analysis.reduced.rtol:g}; a tolerance up to {analysis.wary:g} gives "
        "another answer"
    )


def _about_falling(analysis: Analysis) -> str:
    """Say why nothing holds the arm."""
    bounded, robot = analysis.bounded, analysis.robot
    assert bounded is not None
    components = ", ".join(analysis.task.components)
    if not bounded.feasible.stands_still:
        torques = [
            f"{robot.names[j]} with {torque_of(robot, j, x)}"
            for j, x in unbalanced(analysis).items()
        ]
        return (
            f"the arm cannot stand still: weight and motion turn {joined(torques)}, and no force "
            f"at the tip ({components}) balances that"
        )
    return (
        f"the arm cannot even carry itself: {overload_in_words(analysis)}, and no force "
        f"at the tip ({components}) relieves the arm enough"
    )


def overload_in_words(analysis: Analysis) -> str:
    """Say which joints weight and motion overload, by how much; empty if none."""
    robot, swinging = analysis.robot, analysis.reduced.swinging
    loads = [
        f"{torque_of(robot, j, x)} of {robot.names[j]}, whose limit is {torque_of(robot, j, most)}"
        for j, (x, most) in overloads(analysis).items()
    ]
    load = "weight and motion"
    if swinging is not None:  # a force at the tip balances them, and loads the others
        names = joined(robot.names[j] for j in swinging.joints)
        load = f"weight, motion and the force that balances {names}"
    return f"{load} take {joined(loads)}" if loads else ""


def unbalanced(analysis: Analysis) -> dict[int, float]:
    """Return the torques at joints without torque that no force at the tip balances, by index."""
    swinging = analysis.reduced.swinging
    if swinging is None or analysis.bounded is None or analysis.bounded.feasible.stands_still:
        return {}
    torque = swinging.unbalanced(analysis.rnea.after)
    return dict(zip(swinging.joints, torque.tolist(), strict=True))


def overloads(analysis: Analysis) -> dict[int, tuple[float, float]]:
    """Return torque for weight and motion, and limit, of the joints that these overload.

    With joints without torque the least force that balances them is at the tip.
    """
    if analysis.bounded is None or analysis.limits is None:
        return {}
    F0 = analysis.bounded.feasible.F0
    torque = analysis.rnea.after + F0.dot(analysis.reduced.J)
    largest = analysis.limits.largest_torques(analysis.faults)
    return {j: (float(torque[j]), float(largest[j])) for j in analysis.bounded.overloaded}


def _about_one_force(analysis: Analysis, force: ForceChange) -> str:
    assert force.jump is not None
    before, jump = (amounts(analysis.task, vector) for vector in (force.before, force.jump))
    if analysis.verdict is Verdict.TOLERATED:
        within = " within the limits" if analysis.limits is not None else ""
        keepers = "motors" if analysis.faults.in_mode(FaultMode.WEAK) else "healthy joints"
        return f"the {keepers} keep the whole {before} at the tip{within}"
    if analysis.verdict is Verdict.BORDERLINE:
        lost = f"a jump of {jump} from" if is_noticeable(force.jump) else "no jump of"
        return (
            f"{lost} {before} at the tolerance {analysis.reduced.rtol:g}, but a tolerance up to "
            f"{analysis.wary:g} gives another answer (margin {ratio(analysis.margin)})"
        )
    if analysis.bounded is None:
        return (
            f"{jump} of {before} can no longer be commanded by any motor; along the lost "
            f"directions the arm cannot move, and its brakes and links carry what load there is"
        )
    assert force.after is not None
    # The force may grow and turn: never "jump of before", as if the rest were kept.
    after = amounts(analysis.task, force.after)
    return (
        f"the force that the motors command jumps by {jump} ({before} before, {after} after): "
        f"{'; '.join(_reasons(analysis))}"
    )


def _reasons(analysis: Analysis) -> list[str]:
    """Say why a force cannot be held with joints without torque, or inside limits."""
    bounded, names = analysis.bounded, analysis.robot.names
    assert bounded is not None
    reasons = []
    if analysis.reduced.swinging is not None:
        joints = [names[j] for j in analysis.reduced.swinging.joints]
        verb = "swings and gives" if len(joints) == 1 else "swing and give"
        reasons.append(f"{joined(joints)} {verb} no torque")
    if len(analysis.lost_directions):
        lost = lost_directions(analysis.task, list(analysis.lost_directions))
        reasons.append(f"no motor can command {lost}")
    if bounded.binding:
        joints = [names[j] for j in bounded.binding]
        reasons.append(
            f"{joined(joints)} {'is at its limit' if len(joints) == 1 else 'are at their limits'}"
        )
    if bounded.nearest.F.any():
        reasons.append(share_in_words(bounded.share))
    return reasons


def share_in_words(share: float | None) -> str:
    """Say which share of a force can be commanded if its direction must not change."""
    if share is None:
        return "with no share of the force alone does the arm stand still"
    part = percent(share) if share > 0.0 else "nothing"
    return f"in its own direction {part} of the force can be commanded"


def _about_all_forces(analysis: Analysis) -> str:
    lost = lost_directions(analysis.task, list(analysis.lost_directions))
    support = _support(analysis)
    if analysis.verdict is Verdict.TOLERATED:
        apart = ", as far as the limits allow" if analysis.limits is not None else ""
        return f"every force that the healthy arm can exert here is kept{apart}"
    if analysis.verdict is Verdict.BORDERLINE:
        return (
            f"the arm is close to losing a direction (margin {ratio(analysis.margin)}); whether "
            f"it counts depends on the tolerance, {analysis.reduced.rtol:g} to {analysis.wary:g}"
        )
    if not len(analysis.lost_directions):
        return support.removeprefix("; ")
    return f"no motor can command {lost} any more; forces square to that are kept{support}"


def _support(analysis: Analysis) -> str:
    """Say that the tip must be supported for the arm to stand still, if it must."""
    bounded, task = analysis.bounded, analysis.task
    if bounded is None or bounded.F_after is None or analysis.force is not None:
        return ""
    support = task.unweigh_force(bounded.F_after)
    if not is_noticeable(support):
        return ""
    listed = with_units(task.components, support.tolist(), task.units)
    overload = overload_in_words(analysis)
    return (
        f"; {f'{overload}; ' if overload else ''}the arm stands still only while the tip presses "
        f"on its environment with {listed}"
    )


def critical_joint(census: Census) -> str:
    """Say which joint is the critical one."""
    worst, robot = census.joints[0], census.robot
    name = f"{robot.joints[worst.joint].number} {robot.names[worst.joint]}"
    if worst.alone.capability is not None:
        return f"Critical joint: {name}. When it fails alone, {_left(census, worst.alone)}."
    for count, verdict in (
        (worst.not_tolerated, Verdict.NOT_TOLERATED),
        (worst.borderline, Verdict.BORDERLINE),
    ):
        if count and worst.sets == 1:
            return f"Critical joint: {name}. Its fault is {verdict.value}."
        if count:
            share = "all" if count == worst.sets else f"{count} of"
            return (
                f"Critical joint: {name}. Of the fault sets that hold it, {share} "
                f"{worst.sets} {'is' if count == 1 else 'are'} {verdict.value}."
            )
    return (
        f"Every fault set is tolerated here; joint {name} leaves the smallest margin, "
        f"{ratio(worst.alone.margin)}, when it fails alone."
    )


def _left(census: Census, report: SetReport) -> str:
    """Say which force a fault set leaves."""
    found = report.capability
    assert found is not None
    where = "in the weakest direction"
    if census.direction is not None:
        where = f"along {vector_in_words(census.direction)}"
    if not report.can_stand_still:
        return "the arm cannot stand still"
    if math.isnan(found.commanded) and census.direction is None:
        return "the arm stands still only with a force at the tip"
    if math.isnan(found.commanded):
        return f"the arm does not stand still with any force {where}"
    if math.isinf(found.commanded):
        return f"no known limit ends the force {where} that the motors can command"
    if found.commanded == 0.0:
        return f"the motors can command no force {where}"
    unit = unit_of_size(census.task, census.direction)
    return f"the motors can command {size(found.commanded)} {unit} {where}"
