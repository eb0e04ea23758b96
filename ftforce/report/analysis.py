"""Analyses as text, JSON and table rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.capability import capability_of
from ftforce.core import measures
from ftforce.core.arrays import safe_divide
from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict
from ftforce.report.parts import (
    Document,
    Row,
    arm_part,
    capability_part,
    conventions_part,
    finite,
    force_part,
    limits_part,
    limits_source,
    modes_part,
    posture_part,
    rnea_part,
    torque_part,
    total_part,
    velocity_part,
)
from ftforce.report.text import (
    amounts,
    is_noticeable,
    joined,
    lost_directions,
    percent,
    ratio,
    torque_of,
    with_units,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.analysis.analyze import Analysis
    from ftforce.core.arrays import Vector
    from ftforce.core.changes import ForceChange


def verdict_sentence(analysis: Analysis) -> str:
    """Return the verdict in one or more plain sentences."""
    about = _about(analysis)
    sentence = f"{analysis.verdict.value.capitalize()}: {faults_in_words(analysis)}, {about}."
    if analysis.force is not None and is_noticeable(analysis.force.unsupported):
        missing = amounts(analysis.task, analysis.force.unsupported)
        sentence += f" Even the healthy arm cannot exert {missing} of the request here."
    return sentence


def faults_in_words(analysis: Analysis) -> str:
    """Describe the faults: ``with elbow and wrist locked, hand free``."""
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
    """Explain why the arm cannot stand still."""
    bounded, robot = analysis.bounded, analysis.robot
    assert bounded is not None
    components = ", ".join(analysis.task.components)
    if not bounded.feasible.is_balanced:
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
    """Describe the joints that weight and motion overload; empty if there are none."""
    robot, free = analysis.robot, analysis.reduced.free
    loads = [
        f"{torque_of(robot, j, x)} of {robot.names[j]}, whose limit is {torque_of(robot, j, most)}"
        for j, (x, most) in overloads(analysis).items()
    ]
    load = "weight and motion"
    if free is not None:  # the tip force that balances these loads the other joints
        names = joined(robot.names[j] for j in free.joints)
        load = f"weight, motion and the force that balances {names}"
    return f"{load} take {joined(loads)}" if loads else ""


def unbalanced(analysis: Analysis) -> dict[int, float]:
    """Return the torques at free-swinging joints that no tip force balances, by joint index."""
    free = analysis.reduced.free
    if free is None or analysis.bounded is None or analysis.bounded.feasible.is_balanced:
        return {}
    torque = free.unbalanced(analysis.rnea.after)
    return dict(zip(free.joints, torque.tolist(), strict=True))


def overloads(analysis: Analysis) -> dict[int, tuple[float, float]]:
    """Return torque and limit of the joints that weight and motion overload, by joint index.

    With free-swinging joints, the torques include those for the smallest tip force that balances
    them.
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
    # Magnitude and direction may change: not "jump of before", which implies a kept rest.
    after = amounts(analysis.task, force.after)
    return (
        f"the force that the motors command jumps by {jump} ({before} before, {after} after): "
        f"{'; '.join(_reasons(analysis))}"
    )


def _reasons(analysis: Analysis) -> list[str]:
    """Return the reasons why a force cannot be kept under limits or with free-swinging joints."""
    bounded, names = analysis.bounded, analysis.robot.names
    assert bounded is not None
    reasons = []
    if analysis.reduced.free is not None:
        joints = [names[j] for j in analysis.reduced.free.joints]
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
    """Describe the fraction of a force that can be commanded in its direction."""
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
    """Describe the tip force that the arm needs to stand still, if any."""
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


def analysis_document(analysis: Analysis) -> Document:
    """Return an analysis as a JSON document."""
    names, reduced = analysis.robot.names, analysis.reduced
    locked = analysis.faults.in_mode(FaultMode.LOCKED)
    limited = analysis.limits is not None
    document: Document = {
        **_situation(analysis),
        "jacobian": {
            "matrix": analysis.J.tolist(),
            "rank": reduced.rank,
            "rank_after": reduced.rank_after,
            "sigma_max": reduced.sigma_max,
            "sigma_min": reduced.healthy.s[-1],
            "sigma_min_after": reduced.damaged.s[-1],
            "margin": analysis.margin,
            "condition_number_after": finite(measures.condition_number(reduced)),
            "relative_manipulability": finite(analysis.relative_manipulability),
            "lost_directions": analysis.lost_directions.tolist(),
            "force_error_per_torque": finite(analysis.force_error),
        },
        "force": force_part(analysis.force),
        "torque": {
            **torque_part(names, locked, analysis.torque),
            **rnea_part(names, analysis.rnea),
            "total": total_part(names, locked, analysis.torque),
        },
        "velocity": velocity_part(names, analysis.velocity, analysis.impact),
        "verdict": analysis.verdict.value,
        "summary": verdict_sentence(analysis),
        **modes_part(names, analysis.faults),
        "limits": _limits(analysis),
        "standing": _standing(analysis),
        "capability": capability_part(capability_of(analysis)) if limited else None,
        "residuals": dict(analysis.residuals()),
        "warnings": list(analysis.warnings),
    }
    if analysis.unit_forces:
        document["unit_forces"] = [
            {
                "component": component,
                "force": force_part(force),
                "torque": torque_part(names, locked, torque),
            }
            for component, (force, torque) in zip(
                analysis.task.components, analysis.unit_forces, strict=True
            )
        ]
    return document


def _situation(analysis: Analysis) -> Document:
    return {
        "robot": arm_part(analysis.robot),
        "conventions": {
            **conventions_part(
                analysis.task, analysis.reduced.rtol, analysis.wary, analysis.conditions
            ),
            "inverse": analysis.inverse,
        },
        "posture": posture_part(analysis.posture),
        "locked": list(analysis.locked),
    }


def _limits(analysis: Analysis) -> Document | None:
    bounded, names = analysis.bounded, analysis.robot.names
    if analysis.limits is None or bounded is None:
        return None
    return {
        **limits_part(names, analysis.limits),
        "unknown": [names[i] for i in analysis.unknown_limits],
        "binding": [names[j] for j in bounded.binding],
        "share": bounded.share if analysis.force is not None else None,
    }


def _standing(analysis: Analysis) -> Document:
    bounded, names = analysis.bounded, analysis.robot.names
    support = None
    if bounded is not None and bounded.F_after is not None and analysis.force is None:
        support = analysis.task.unweigh_force(bounded.F_after).tolist()
    return {
        "can_stand_still": analysis.can_stand_still,
        "support": support,
        "unbalanced": {names[j]: x for j, x in unbalanced(analysis).items()},
        "overloaded": {
            names[j]: {"torque": x, "limit": most} for j, (x, most) in overloads(analysis).items()
        },
    }


def analysis_rows(analysis: Analysis) -> list[Row]:
    """Return an analysis as table rows, one per quantity and joint or component."""
    header = ("quantity", "name", "unit", "before", "after", "change")
    return [header, *_convention_rows(analysis), *_joint_rows(analysis), *_tip_rows(analysis)]


def _convention_rows(analysis: Analysis) -> list[Row]:
    task, reduced, conditions = analysis.task, analysis.reduced, analysis.conditions
    healthy = safe_divide(reduced.healthy.s[-1], reduced.sigma_max, 0.0)
    gravity = zip("xyz", conditions.gravity.tolist(), strict=True)
    said = [
        ("robot", "", analysis.robot.name),
        ("tip", "", analysis.robot.tip),
        ("axes", "", task.axes),
        ("task", "", str(task)),
        ("length", "m", task.length if task.moment_rows else ""),
        ("limits", "", limits_source(analysis.limits)),
        *((f"gravity_{axis}", "m/s²", x) for axis, x in gravity),
        ("payload", "kg", 0.0 if conditions.payload is None else conditions.payload.mass),
        ("rtol", "", reduced.rtol),
        ("wary", "", analysis.wary),
    ]
    rho = finite(analysis.relative_manipulability)
    return [
        *(("convention", name, unit, value, "", "") for name, unit, value in said),
        ("verdict", "verdict", "", "", analysis.verdict.value, ""),
        ("jacobian", "rank", "", reduced.rank, reduced.rank_after, ""),
        ("jacobian", "margin", "", healthy, analysis.margin, ""),
        ("jacobian", "relative_manipulability", "", 1.0, rho, ""),
    ]


def _joint_rows(analysis: Analysis) -> list[Row]:
    robot = analysis.robot
    faults = {fault.joint: fault for fault in analysis.faults.faults}
    rows: list[Row] = []
    for joint, q in zip(robot.joints, analysis.posture.q.tolist(), strict=True):
        rows.append(("position", joint.name, joint.unit, q, q, 0.0))
    for joint in robot.joints:
        fault = faults.get(joint.number - 1, "healthy")
        rows.append(("state", joint.name, "", "healthy", str(fault), ""))
    units = [joint.torque_unit for joint in robot.joints]
    rnea, torque = analysis.rnea, analysis.torque
    rows += _changes("gravity", robot.names, units, rnea.gravity, rnea.gravity)
    rows += _changes("motion", robot.names, units, rnea.motion_before, rnea.motion_after)
    if torque is not None:
        rows += _changes("torque", robot.names, units, torque.before, torque.after)
        after = torque.total_after
        if after is not None:  # the load of a locked joint is reported as its brake load
            after = np.where(analysis.reduced.locked, np.nan, after)
        rows += _changes("total", robot.names, units, torque.total_before, after)
        if torque.brake_load is not None:
            for i in analysis.faults.in_mode(FaultMode.LOCKED):
                load = float(torque.brake_load[i])
                rows.append(("brake_load", robot.names[i], units[i], "", load, ""))
    if (velocity := analysis.velocity) is not None:
        units = [f"{joint.unit}/s" for joint in robot.joints]
        rows += _changes("velocity", robot.names, units, velocity.before, velocity.after)
        if (impact := analysis.impact) is not None:
            name = "velocity at impact"
            rows += _changes(name, robot.names, units, velocity.before, impact.after)
    return rows


def _changes(
    quantity: str,
    names: Sequence[str],
    units: Sequence[str],
    before: Vector | None,
    after: Vector | None,
) -> list[Row]:
    """Return one row per name; unknown values stay empty."""
    rows = []
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        b = None if before is None else finite(float(before[i]))
        a = None if after is None else finite(float(after[i]))
        rows.append((quantity, name, unit, b, a, None if b is None or a is None else a - b))
    return rows


def _tip_rows(analysis: Analysis) -> list[Row]:
    task = analysis.task
    forces = [("force", analysis.force)] if analysis.force else []
    forces += [
        (f"force for unit {name}", force)
        for name, (force, _) in zip(task.components, analysis.unit_forces, strict=False)
    ]
    rows: list[Row] = []
    for quantity, force in forces:
        rows += _changes(quantity, task.components, task.units, force.before, force.after)
    if (velocity := analysis.velocity) is not None:
        names, units = task.velocity_components, task.velocity_units
        rows += _changes("tip velocity", names, units, velocity.tip_before, velocity.tip_after)
        if (impact := analysis.impact) is not None:
            name = "tip velocity at impact"
            rows += _changes(name, names, units, velocity.tip_before, impact.tip_after)
    return rows
