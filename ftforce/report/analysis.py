"""Analyses as text, JSON and table rows."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.analysis.analyze import limit_of, shown_limits
from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict
from ftforce.report import parts
from ftforce.report.fields import MISSING, Document, Field, Row, document, plain, under, whole
from ftforce.report.friction import friction_borne, reliance_in_words, torque_at
from ftforce.report.measures import MEASURES, RANK_AFTER, SIGMA_MIN_AFTER
from ftforce.report.text import (
    amounts,
    is_noticeable,
    joined,
    lost_directions,
    number,
    percent,
    ratio,
    torque_of,
    with_units,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.analysis.analyze import Analysis
    from ftforce.analysis.capability import Capability
    from ftforce.core.arrays import Vector
    from ftforce.core.changes import ForceChange, TorqueChange
    from ftforce.core.faults import FaultSet


def verdict_sentence(analysis: Analysis) -> str:
    """Return the verdict in one or more plain sentences."""
    about = _about(analysis)
    if reliance := reliance_in_words(analysis):
        about += f"; {reliance}"
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
        f" at the tolerance {analysis.reduced.rtol:g}; a tolerance up to {analysis.wary:g} changes "
        "the answer"
    )


def _about_falling(analysis: Analysis) -> str:
    """Explain why the arm cannot be held in static equilibrium."""
    bounded, robot = analysis.bounded, analysis.robot
    assert bounded is not None
    components = ", ".join(analysis.task.components)
    bearings = bounded.feasible.bearings
    if not bounded.feasible.is_balanced:
        torques = [
            f"{robot.names[j]} with {torque_of(robot, j, x)}"
            for j, x in unbalanced(analysis).items()
        ]
        return (
            "the arm cannot be held in static equilibrium: weight and motion load "
            f"{joined(torques)}, and {_nothing_balances(analysis)}"
        )
    if bearings is not None and not bounded.overloaded:
        names = joined(robot.names[j] for j in bearings.joints)
        return (
            "the arm cannot be held in static equilibrium: no force at the tip "
            f"({components}) keeps the torque at {names} within friction and limits"
        )
    return (
        f"the arm cannot support itself: {_overload_in_words(analysis)}, and no force "
        f"at the tip ({components}) relieves it enough"
    )


def _nothing_balances(analysis: Analysis) -> str:
    """Say that neither a force at the tip nor friction balances torques at free joints."""
    robot, bounded, components = analysis.robot, analysis.bounded, analysis.task.components
    assert bounded is not None
    bearings = bounded.feasible.bearings
    assert bearings is not None
    force = f"force at the tip ({', '.join(components)})"
    if bearings.is_ideal:
        return f"no {force} balances that"
    most = [
        torque_of(robot, j, x)
        for j, x in zip(bearings.joints, torque_at(analysis, bearings.friction), strict=True)
        if j in unbalanced(analysis)
    ]
    return f"neither a {force} nor friction (at most {joined(most)}) balances that"


def _overload_in_words(analysis: Analysis) -> str:
    """Describe the joints that weight and motion overload; empty if there are none."""
    robot, free = analysis.robot, analysis.reduced.free
    loads = [
        f"{torque_of(robot, j, x)} at {robot.names[j]}, whose limit is {torque_of(robot, j, most)}"
        for j, (x, most) in overloads(analysis).items()
    ]
    load = "weight and motion"
    if free is not None:  # the tip force that balances these loads the other joints
        names = joined(robot.names[j] for j in free.joints)
        load = f"weight, motion and the force that balances {names}"
    return f"{load} require {', and '.join(loads)}" if loads else ""


def unbalanced(analysis: Analysis) -> dict[int, float]:
    """Return the torques at free-swinging joints that no tip force balances, by joint index."""
    bearings = None if analysis.bounded is None else analysis.bounded.feasible.bearings
    if bearings is None or bearings.is_balanced:
        return {}
    most = 0.0 if bearings.is_ideal else bearings.friction
    beyond = np.abs(bearings.unbalanced) > most
    pairs = zip(bearings.joints, torque_at(analysis, bearings.unbalanced), strict=True)
    return {j: x for (j, x), over in zip(pairs, beyond.tolist(), strict=True) if over}


def overloads(analysis: Analysis) -> dict[int, tuple[float, float]]:
    """Return torque and limit of the joints that weight and motion overload, by joint index.

    With free-swinging joints, the torques include those for the smallest tip force that balances
    them.
    """
    if analysis.bounded is None or analysis.limits is None:
        return {}
    F0 = analysis.bounded.feasible.F0
    torque = analysis.rnea.after + analysis.scale.unweigh_torque(F0.dot(analysis.reduced.J))
    lower, upper = shown_limits(analysis)
    return {
        j: (float(torque[j]), limit_of(float(torque[j]), float(lower[j]), float(upper[j])))
        for j in analysis.bounded.overloaded
    }


def _about_one_force(analysis: Analysis, force: ForceChange) -> str:
    assert force.jump is not None
    before, jump = (amounts(analysis.task, vector) for vector in (force.before, force.jump))
    if analysis.verdict is Verdict.TOLERATED:
        within = " within the limits" if analysis.limits is not None else ""
        keepers = "motors" if analysis.faults.in_mode(FaultMode.WEAK) else "healthy joints"
        return f"the {keepers} maintain the full {before} at the tip{within}"
    if analysis.verdict is Verdict.BORDERLINE:
        lost = f"a jump of {jump} from" if is_noticeable(force.jump) else "no jump from"
        return (
            f"{lost} {before} at the tolerance {analysis.reduced.rtol:g}, but a tolerance up to "
            f"{analysis.wary:g} changes the answer (margin {ratio(analysis.margin)})"
        )
    if analysis.bounded is None:
        return (
            f"{jump} of {before} can no longer be commanded; along the lost "
            f"directions the arm cannot move, and its brakes and links carry the load"
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
        verb = "is" if len(joints) == 1 else "are"
        reasons.append(f"{joined(joints)} {verb} free-swinging")
    if len(analysis.lost_directions):
        lost = lost_directions(analysis.task, list(analysis.lost_directions))
        reasons.append(f"no motor torque can produce {lost}")
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
        return "no fraction of the force is feasible"
    part = percent(share) if share > 0.0 else "none"
    return f"{part} of the force can be commanded in its own direction"


def _about_all_forces(analysis: Analysis) -> str:
    lost = lost_directions(analysis.task, list(analysis.lost_directions))
    support = _support_in_words(analysis)
    if analysis.verdict is Verdict.TOLERATED:
        apart = ", within the limits" if analysis.limits is not None else ""
        return f"every force that the healthy arm can exert here is kept{apart}"
    if analysis.verdict is Verdict.BORDERLINE:
        return (
            f"the arm is close to losing a direction (margin {ratio(analysis.margin)}); whether it "
            f"counts as lost depends on the tolerance, {analysis.reduced.rtol:g} to "
            f"{analysis.wary:g}"
        )
    if not len(analysis.lost_directions):
        return support.removeprefix("; ") or _slight_support_in_words(analysis)
    return f"no motor torque can produce {lost}; forces orthogonal to that are kept{support}"


def _support_in_words(analysis: Analysis) -> str:
    """Describe the tip force without which the arm cannot be held, if any."""
    task, support = analysis.task, _support(analysis)
    if support is None or not _is_shown(support):
        return ""
    listed = with_units(task.components, support.tolist(), task.units)
    overload = _overload_in_words(analysis)
    return (
        f"; {f'{overload}; ' if overload else ''}the arm can be held only while the tip presses "
        f"on its environment with {listed}"
    )


def _slight_support_in_words(analysis: Analysis) -> str:
    """Describe a tip force without which the arm cannot be held, and which rounds to zero."""
    support = _support(analysis)
    if support is None:
        return "the arm cannot be held"
    listed = amounts(analysis.task, support)
    return f"the arm can be held only with a slight force at the tip, {listed}"


def _is_shown(support: Vector) -> bool:
    """Return whether a supporting force differs from 0 at the precision at which it is printed."""
    return any(float(number(x)) != 0.0 for x in support.tolist())


def _brake_load(analysis: Analysis | _UnitForce) -> dict[int, float] | None:
    load = None if analysis.torque is None else analysis.torque.brake_load
    locked = analysis.faults.in_mode(FaultMode.LOCKED)
    return None if load is None else {i: float(load[i]) for i in locked}


def _total_after(analysis: Analysis) -> Vector | None:
    """Return the total motor torques; NaN at locked joints, whose brakes carry the load."""
    after = None if analysis.torque is None else analysis.torque.total_after
    return None if after is None else np.where(analysis.reduced.locked, np.nan, after)


def _support(analysis: Analysis) -> Vector | None:
    bounded = analysis.bounded
    if bounded is None or bounded.F_after is None or analysis.force is not None:
        return None
    return analysis.task.unweigh_force(bounded.F_after)


class _UnitForce(NamedTuple):
    component: str
    force: ForceChange
    torque: TorqueChange
    faults: FaultSet


def _capability(analysis: Analysis) -> Capability | None:
    from ftforce.analysis.capability import capability_of  # only documents need it

    return None if analysis.limits is None else capability_of(analysis)


def _unit_forces(analysis: Analysis) -> list[_UnitForce]:
    pairs = zip(analysis.task.components, analysis.unit_forces, strict=False)
    return [_UnitForce(name, *changes, analysis.faults) for name, changes in pairs]


# fmt: off
_JACOBIAN = (
    Field("matrix", "J, unweighted, rows in the order of the components", "m/rad, rad/rad, m/m",
        "m × n", "J"),
    Field("rank", "rank of J", get="reduced.rank"),
    replace(RANK_AFTER, get="reduced.rank_after"),
    Field("sigma_max", "largest singular value of J̃", get="reduced.sigma_max"),
    Field("sigma_min", "smallest one", get=lambda analysis: analysis.reduced.healthy.s[-1]),
    replace(SIGMA_MIN_AFTER, get=lambda analysis: analysis.reduced.damaged.s[-1]),
    *MEASURES,
    Field("lost_directions", "orthonormal rows, directions of the weighted force", "1", "k × m"),
    Field("force_error_per_torque", "1/σ of the smallest singular value that is not lost; `null` "
        "if none is left. Beside slides, torques of hinges are divided by `joint_length`",
        "N per N·m", get="force_error"),
)
_FORCE = (
    parts.REQUESTED,
    Field("unsupported", "part that even the healthy arm cannot exert", parts.FORCE, "m"),
    parts.BEFORE,
    *parts.JUMP,
)
_FORCE_TORQUE = (
    Field("before", "force part before the fault", parts.TORQUE, "by joint", "torque.before"),
    Field("after", "force part after it; 0 at locked joints", parts.TORQUE, "by joint",
        "torque.after"),
    Field("brake_load", "load of the brake, including weight and motion", parts.TORQUE,
        "by locked joint", _brake_load),
    Field("self_motion", "part of `before` that exerts no static force", parts.TORQUE, "by joint",
        "torque.self_motion"),
)
_GRAVITY = "rnea.gravity"
_TORQUE = (
    *_FORCE_TORQUE,
    Field("gravity", "weight of the arm and its payload", get=whole, parts=(
        Field("before", "`null` if the URDF has no masses", parts.TORQUE, "by joint", _GRAVITY),
        Field("after", "the same", parts.TORQUE, "by joint", _GRAVITY),
    )),
    Field("motion", "M(q) a + V(q, v) v; 0 for an arm at rest", get=whole, parts=(
        Field("before", "`null` if the arm moves and the URDF has no masses", parts.TORQUE,
            "by joint", "rnea.motion_before"),
        Field("after", "with the locked joints at rest", parts.TORQUE, "by joint",
            "rnea.motion_after"),
    )),
    Field("total", "force part, weight and motion", get=whole, parts=(
        Field("before", "total motor torques; `null` if the URDF has no masses", parts.TORQUE,
            "by joint", "torque.total_before"),
        Field("after", "**to command now**; 0 at joints without torque, `null` at locked ones",
            parts.TORQUE, "by joint", _total_after),
    )),
)
_TIP_JUMP = (
    Field("tip_after", "tip velocity", parts.TIP_SPEED, "m"),
    Field("jump", "after − before", parts.TIP_SPEED, "m"),
    Field("jump_norm", "norm of its linear part", "m/s"),
    Field("angular_jump_norm", "norm of its angular part", "rad/s"),
)
_VELOCITY = (
    Field("before", "before the fault", parts.SPEED, "by joint", "velocity.before"),
    Field("after", "after the remap; 0 at locked joints", parts.SPEED, "by joint",
        "velocity.after"),
    Field("tip_before", "tip velocity", parts.TIP_SPEED, "m", "velocity.tip_before"),
    *under("velocity", _TIP_JUMP),
    Field("impact", "immediately after the lock; `null` without a lock or masses",
        parts=(Field("after", "0 at locked joints", parts.SPEED, "by joint"), *_TIP_JUMP)),
)
_STANDING = (
    Field("can_stand_still", "whether motors, brakes and some tip force can hold the arm in static "
        "equilibrium"),
    Field("support", "without a force: the smallest tip force that holds the arm, 0 if none is "
        "needed; `null` otherwise", parts.FORCE, "m", _support),
    Field("unbalanced", "torque that no tip force balances; empty if the arm can be held",
        parts.TORQUE, "by free joint", unbalanced),
    Field("friction", "torque that friction bears at free-swinging joints, where the answer relies "
        "on it: `torque`, `limit` and `source` of the limit", parts.TORQUE, "by free joint",
        friction_borne),
    Field("overloaded", "joints that weight and motion alone overload: `torque` and `limit`",
        parts.TORQUE, "by joint", lambda analysis: {
        j: {"torque": x, "limit": most} for j, (x, most) in overloads(analysis).items()
    }),
)
UNKNOWN_LIMITS = Field("unknown", "joints whose limit, of the motor or if locked of the brake, is "
    "unknown", shape="names", get="unknown_limits")
SITUATION = (
    parts.ROBOT,
    Field("conventions", "conventions of the document",
        get=lambda x: parts.Asked(x.task, x.scale, x.rtol, x.wary, x.conditions, x.inverse), parts=(
        *parts.CONVENTIONS,
        Field("inverse", "`euclidean` or `dynamic`: splits torques into force and self-motion"),
    )),
    parts.POSTURE,
    parts.LOCKED,
)
ANALYSIS = (
    *SITUATION,
    Field("jacobian", "before and after the fault", get=whole, parts=_JACOBIAN),
    Field("force", "tip force; its values are `null` if neither a force nor torques were given",
        get=lambda analysis: analysis.force or MISSING, parts=_FORCE),
    Field("torque", "motor torques", get=whole, parts=_TORQUE),
    Field("velocity", "`null` if none was given",
        get=lambda analysis: None if analysis.velocity is None else analysis, parts=_VELOCITY),
    parts.VERDICT,
    replace(parts.SUMMARY, get=verdict_sentence),
    *parts.MODES,
    Field("limits", parts.LIMITS_MEANING, get=parts.limited, parts=(
        *parts.LIMITS_IN_FORCE,
        UNKNOWN_LIMITS,
        Field("binding", "joints at their limits", shape="names", get="bounded.binding"),
        Field("share", "largest fraction of the force that can be commanded in its direction; "
            "`null` without a force, or if no fraction is feasible", "1",
            get=lambda x: None if x.force is None else x.bounded.share),
    )),
    Field("standing", "static equilibrium", get=whole, parts=_STANDING),
    Field("capability", "with limits: keys as `capability` of a [capability](#capability); "
        "otherwise `null`", shape="as of a capability",
        get=_capability,
        parts=parts.CAPABILITY),
    Field("residuals", "relative residuals of the equations that the result must satisfy: "
        "`balance`, `orthogonality`, `uncommandable`, `statics`, `unchanged` "
        "([force](../theory/force.md#force-jump)); with limits or joints without torque "
        "`equality`, `limit`, `optimality` ([limits](../theory/limits.md#residuals))", "1",
        "by law", lambda analysis: analysis.residuals()),
    parts.WARNINGS,
    Field("unit_forces", "only if neither a force nor torques were given: the same for 1 N (1 N·m) "
        "along each axis", shape="list", get=_unit_forces, optional=True, parts=(
        Field("component", "`fx`, …"),
        Field("force", "keys as `force`", shape="as `force`", parts=_FORCE),
        Field("torque", "keys as `torque`", shape="as `torque`", get=whole, parts=_FORCE_TORQUE),
    )),
)
# fmt: on


def analysis_document(analysis: Analysis) -> Document:
    """Return an analysis as a JSON document."""
    return document(ANALYSIS, analysis, analysis.robot.names)


def _row_name(field: Field) -> str:
    return field.key.removesuffix("_after")


# fmt: off
_CONVENTIONS = (
    Field("robot", get="robot.name"),
    Field("tip", get="robot.tip"),
    *parts.TASK_COLUMNS,
    parts.LIMITS_SOURCE,
    *under("conditions.gravity", (Field(f"gravity_{axis}", unit="m/s²", get=itemgetter(i))
        for i, axis in enumerate("xyz"))),
    Field("payload", unit="kg", get=lambda x: x.conditions.payload.mass if x.conditions.payload
        else 0.0),
    replace(parts.RTOL, unit="", get="reduced.rtol"),
    replace(parts.WARY, unit=""),
)
_NUMBERS = (replace(RANK_AFTER, get="reduced.rank_after"), *MEASURES)
QUANTITIES = (
    Field("convention", f"{', '.join(one.key for one in _CONVENTIONS)}; in `before`"),
    Field("verdict", "in `after`"),
    Field("jacobian", ", ".join(map(_row_name, _NUMBERS))),
    Field("position", "per joint"),
    Field("state", "per joint: `healthy`, `locked`, `free`, or `weak` with the factor"),
    Field("gravity", "per joint: torques for weight"),
    Field("motion", "per joint: torques for motion"),
    Field("torque", "per joint: force part, if a force or torques were given"),
    Field("total", "per joint: force part, weight and motion; empty after the fault at locked "
        "joints"),
    Field("brake_load", "per locked joint: load of the brake, including weight and motion, in "
        "`after`"),
    Field("velocity", "per joint, if velocities were given"),
    Field("velocity at impact", "the same immediately after the lock"),
    Field("force", "per component, if a force or torques were given"),
    Field("force for unit …", "per component, for each unit force, if none were given"),
    Field("tip velocity", "per component, if velocities were given"),
    Field("tip velocity at impact", "the same immediately after the lock"),
)
"""The rows of an analysis as a table."""
# fmt: on


def analysis_rows(analysis: Analysis) -> list[Row]:
    """Return an analysis as table rows, one per quantity and joint or component."""
    header = ("quantity", "name", "unit", "before", "after", "change")
    return [header, *_convention_rows(analysis), *_joint_rows(analysis), *_tip_rows(analysis)]


def _convention_rows(analysis: Analysis) -> list[Row]:
    said = [(one.key, one.unit, plain(one.value(analysis))) for one in _CONVENTIONS]
    return [
        *(("convention", *one, "", "") for one in said),
        ("verdict", "verdict", "", "", analysis.verdict.value, ""),
        *(("jacobian", *_before_and_after(one, analysis), "") for one in _NUMBERS),
    ]


def _before_and_after(field: Field, analysis: Analysis) -> Row:
    before = None if field.healthy is None else plain(field.healthy(analysis))
    return _row_name(field), "", before, plain(field.value(analysis))


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
        rows += _changes("total", robot.names, units, torque.total_before, _total_after(analysis))
        for i, load in (_brake_load(analysis) or {}).items():
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
        b, a = (None if x is None else plain(x[i]) for x in (before, after))
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
