"""Results as dictionaries of plain values: what a JSON file holds."""

from __future__ import annotations

import math
from functools import singledispatch
from typing import TYPE_CHECKING, Any, TypeAlias

from ftforce import metrics, words
from ftforce.analysis import Analysis
from ftforce.errors import InputError
from ftforce.fault_census import Census
from ftforce.replicate import ERRATA, Replication
from ftforce.robot import Robot

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ftforce.arrays import Vector
    from ftforce.changes import ForceChange, TorqueChange, VelocityChange
    from ftforce.fault_census import SetReport
    from ftforce.posture import Posture
    from ftforce.task import Task

Document: TypeAlias = dict[str, Any]


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
    given = (analysis.force, analysis.torque)
    document: Document = {
        "robot": _arm(analysis.robot),
        "conventions": _conventions(analysis.task, reduced.rtol, analysis.wary),
        "posture": _posture(analysis.posture),
        "locked": list(analysis.locked),
        "jacobian": {
            "matrix": analysis.J.tolist(),
            "rank": reduced.rank,
            "rank_after": reduced.rank_after,
            "sigma_max": reduced.sigma_max,
            "sigma_min": reduced.healthy.s[-1],
            "sigma_min_after": reduced.damaged.s[-1],
            "margin": analysis.margin,
            "condition_number_after": finite(metrics.condition_number(reduced)),
            "relative_manipulability": finite(analysis.relative_manipulability),
            "lost_directions": analysis.lost_directions.tolist(),
            "force_error_per_torque": finite(analysis.force_error),
        },
        "force": _force(given[0]),
        "torque": _torque(names, analysis.faults.joints, given[1]),
        "velocity": _velocity(names, analysis.velocity),
        "verdict": analysis.verdict.value,
        "summary": words.verdict_sentence(analysis),
        "warnings": list(analysis.warnings),
    }
    if analysis.unit_forces:
        document["unit_forces"] = [
            {
                "component": component,
                "force": _force(force),
                "torque": _torque(names, analysis.faults.joints, torque),
            }
            for component, (force, torque) in zip(
                analysis.task.components, analysis.unit_forces, strict=True
            )
        ]
    return document


@to_dict.register(Census)
def _census(census: Census) -> Document:
    names = census.robot.names
    return {
        "robot": _arm(census.robot),
        "conventions": _conventions(census.task, census.rtol, census.wary),
        "posture": _posture(census.posture),
        "faults": census.largest,
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
            }
            for report in census.joints
        ],
        "summary": words.critical_joint(census),
        "warnings": list(census.posture.warnings),
    }


def _arm(robot: Robot) -> Document:
    return {
        "name": robot.name,
        "base": robot.base,
        "tip": robot.tip,
        "joints": list(robot.names),
        "types": [joint.type for joint in robot.joints],
    }


def _conventions(task: Task, rtol: float, wary: float) -> Document:
    return {
        "axes": task.axes,
        "task": str(task),
        "components": list(task.components),
        "length": task.length if task.moment_rows else None,
        "sign": words.SIGN,
        "units": {
            "position": "rad (m for prismatic joints)",
            "velocity": "rad/s (m/s for prismatic joints)",
            "torque": "N·m (N for prismatic joints)",
            "force": "N",
            "moment": "N·m",
            "length": "m",
            "tip_velocity": "m/s, rad/s",
            "matrix": "m/rad, rad/rad (m/m for prismatic joints), unweighted",
            "sigma": "of the weighted Jacobian [J_lin; length * J_ang]",
            "lost_directions": "unit vectors of the weighted force [f; moment / length]",
        },
        "rtol": rtol,
        "wary": wary,
    }


def _posture(posture: Posture) -> Document:
    return {"q": posture.q.tolist(), "source": posture.source}


def _force(force: ForceChange | None) -> Document:
    keys = ("requested", "unsupported", "before", "after", "jump")
    if force is None:
        return dict.fromkeys((*keys, "jump_norm", "moment_jump_norm"))
    vectors = {key: listed(getattr(force, key)) for key in keys}
    return {
        **vectors,
        "jump_norm": force.jump_norm,
        "moment_jump_norm": force.moment_jump_norm,
    }


def _torque(names: Sequence[str], locked: Iterable[int], torque: TorqueChange | None) -> Document:
    if torque is None:
        return {"before": None, "after": None, "brake_load": None, "self_motion": None}
    return {
        "before": _by_name(names, torque.before),
        "after": _by_name(names, torque.after),
        "brake_load": {names[i]: float(torque.brake_load[i]) for i in locked},
        "self_motion": _by_name(names, torque.self_motion),
    }


def _velocity(names: Sequence[str], velocity: VelocityChange | None) -> Document | None:
    if velocity is None:
        return None
    return {
        "before": _by_name(names, velocity.before),
        "after": _by_name(names, velocity.after),
        "tip_before": velocity.tip_before.tolist(),
        "tip_after": velocity.tip_after.tolist(),
        "jump": velocity.jump.tolist(),
        "jump_norm": velocity.jump_norm,
        "angular_jump_norm": velocity.angular_jump_norm,
    }


def _set(names: Sequence[str], report: SetReport) -> Document:
    return {
        "locked": [names[i] for i in report.faults.joints],
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
        "verdict": report.verdict.value,
    }


def finite(x: float) -> float | None:
    """Return a number, or ``None`` where it is infinite or undefined."""
    return x if math.isfinite(x) else None


def listed(vector: Vector | None) -> list[float] | None:
    """Return a vector as a list, or ``None``."""
    return None if vector is None else vector.tolist()


def _by_name(names: Sequence[str], vector: Vector) -> dict[str, float]:
    return dict(zip(names, vector.tolist(), strict=True))


@to_dict.register(Robot)
def _robot(robot: Robot) -> Document:
    return {
        **_arm(robot),
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
            {
                "table": check.table,
                "row": check.row,
                "column": check.column,
                "printed": check.printed,
                "computed": check.computed,
                "outcome": check.outcome.value,
                "erratum": check.erratum or None,
            }
            for check in result.checks
        ],
        "errata": [
            {"where": where, "printed": printed, "correct": correct}
            for where, printed, correct in ERRATA
        ],
    }
