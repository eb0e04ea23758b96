"""Results as dictionaries of plain values: what a JSON file holds."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING

from ftforce.analysis.analyze import Analysis
from ftforce.analysis.capability import Capability, capability_of
from ftforce.analysis.census import Census
from ftforce.analysis.paper import ERRATA, Replication
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.comparison_documents import comparison_document
from ftforce.core import measures
from ftforce.core.faults import FaultMode
from ftforce.errors import InputError
from ftforce.history_documents import history_document, timeline_document
from ftforce.map_documents import map_document
from ftforce.report import analysis as sentences
from ftforce.report import capability as capability_words
from ftforce.report.parts import (
    Document,
    arm_part,
    capability_part,
    check_part,
    conventions_part,
    finite,
    force_part,
    limits_part,
    listed,
    modes_part,
    polytope_part,
    posture_part,
    rnea_part,
    torque_part,
    total_part,
    velocity_part,
)
from ftforce.robot.robot import Robot
from ftforce.sweep_documents import sweep_document
from ftforce.trajectory.history import History
from ftforce.trajectory.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.analysis.fault_set import SetReport


@singledispatch
def to_dict(result: object) -> Document:
    """Return a result or a robot as a dictionary of plain numbers, lists and names.

    Unknown and undefined numbers are ``None``. docs/reference/json names every key.

    Raises
    ------
    InputError
        It is something else.
    """
    raise InputError(f"a result or a robot can be written, not a {type(result).__name__}")


@to_dict.register(Analysis)
def _analysis(analysis: Analysis) -> Document:
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
        "summary": sentences.verdict_sentence(analysis),
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
        "unbalanced": {names[j]: x for j, x in sentences.unbalanced(analysis).items()},
        "overloaded": {
            names[j]: {"torque": x, "limit": most}
            for j, (x, most) in sentences.overloads(analysis).items()
        },
    }


@to_dict.register(Capability)
def _capability(capability: Capability) -> Document:
    analysis = capability.analysis
    names = analysis.robot.names
    limits = None
    if analysis.limits is not None:
        unknown = [names[i] for i in analysis.unknown_limits]
        limits = {**limits_part(names, analysis.limits), "unknown": unknown}
    return {
        **_situation(analysis),
        **modes_part(names, analysis.faults),
        "limits": limits,
        "capability": capability_part(capability),
        "polytope": polytope_part(capability),
        "summary": capability_words.capability_sentence(capability),
        "warnings": list(analysis.warnings),
    }


@to_dict.register(Census)
def _census(census: Census) -> Document:
    names = census.robot.names
    return {
        "robot": arm_part(census.robot),
        "conventions": conventions_part(census.task, census.rtol, census.wary, census.conditions),
        "posture": posture_part(census.posture),
        "faults": census.largest,
        "mode": census.mode.value,
        "rank_by": census.rank_by,
        "direction": listed(census.direction),
        "limits": None if census.limits is None else limits_part(names, census.limits),
        "force": {"requested": listed(census.requested), "before": listed(census.before)},
        "sets": [_set(names, report) for report in census.sets],
        "joints": [
            {
                "joint": names[report.joint],
                "alone": _set(names, report.alone),
                "sets": report.sets,
                "not_tolerated": report.not_tolerated,
                "borderline": report.borderline,
                "mean_relative_jump": report.mean_relative_jump,
                "least_capability": None
                if report.least_capability is None
                else finite(report.least_capability),
            }
            for report in census.joints
        ],
        "summary": sentences.critical_joint(census),
        "warnings": list(census.warnings),
    }


def _set(names: Sequence[str], report: SetReport) -> Document:
    return {
        "locked": [names[i] for i in report.faults.in_mode(FaultMode.LOCKED)],
        **modes_part(names, report.faults),
        "jacobian": {
            "rank_after": report.rank_after,
            "rank_lost": report.rank_lost,
            "sigma_min_after": report.sigma_min_after,
            "margin": report.margin,
            "relative_manipulability": finite(report.relative_manipulability),
        },
        "force": {
            "after": listed(report.after),
            "jump": listed(report.jump),
            "jump_norm": report.jump_norm,
            "moment_jump_norm": report.moment_jump_norm,
        },
        "can_stand_still": report.can_stand_still,
        "share": report.share,
        "binding": [names[j] for j in report.binding],
        "capability": None
        if report.capability is None
        else {
            "commanded": finite(report.capability.commanded),
            "held": finite(report.capability.held),
            "least": finite(report.capability.least),
            "end": report.capability.end.value,
            "held_end": report.capability.held_end.value,
            "stops": [names[j] for j in report.capability.stops],
        },
        "verdict": report.verdict.value,
    }


to_dict.register(History, history_document)
to_dict.register(Comparison, comparison_document)
to_dict.register(Sweep, sweep_document)
to_dict.register(WorkspaceMap, map_document)
to_dict.register(Timeline, timeline_document)


@to_dict.register(Robot)
def _robot(robot: Robot) -> Document:
    return {
        **arm_part(robot),
        "base_source": robot.base_source,
        "tip_source": robot.tip_source,
        "limits": {
            joint.name: {
                "lower": finite(joint.lower),
                "upper": finite(joint.upper),
                "effort": joint.effort,
                "velocity": joint.velocity,
            }
            for joint in robot.joints
        },
        "followers": {joint.name: list(joint.followers) for joint in robot.joints},
        "moving_mass": robot.mass or None,
        "postures": {name: q.tolist() for name, q in robot.postures.items()},
        "tip_candidates": dict(robot.tips),
        "held": dict(robot.held),
        "notes": list(robot.notes),
        "units": {"angle": "rad", "length": "m", "effort": "N·m (N if prismatic)", "mass": "kg"},
    }


@to_dict.register(Replication)
def _replication(result: Replication) -> Document:
    return {
        "successful": result.is_successful,
        "checks": [
            {**check_part(check), "erratum": check.erratum or None} for check in result.checks
        ],
        "errata": [
            {"where": where, "printed": printed, "correct": correct}
            for where, printed, correct in ERRATA
        ],
    }
