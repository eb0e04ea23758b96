"""Building blocks of JSON documents and tables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

from ftforce.core.faults import FaultMode
from ftforce.core.feasible_forces import LockModel
from ftforce.report import text

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ftforce.analysis.capability import Capability, CapabilityRange
    from ftforce.analysis.conditions import Conditions
    from ftforce.analysis.paper import Check
    from ftforce.batch.result import SweepSetting
    from ftforce.batch.summary.criticality import Estimate
    from ftforce.core.arrays import Vector
    from ftforce.core.changes import ForceChange, Impact, RneaChange, TorqueChange, VelocityChange
    from ftforce.core.faults import FaultSet
    from ftforce.core.limits import Limits
    from ftforce.core.task import Task
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot

Document: TypeAlias = dict[str, Any]
Row: TypeAlias = tuple[Any, ...]

POSITION_UNIT = "rad (m for prismatic joints)"
TORQUE_UNIT = "N·m (N for prismatic joints)"
GRAVITY_UNIT = "m/s², in the root's axes"

MOST_DRAWN = 3  # dimensions: polytopes in higher ones have thousands of vertices


def arm_part(robot: Robot) -> Document:
    """Return the kinematic chain."""
    return {
        "name": robot.name,
        "base": robot.base,
        "tip": robot.tip,
        "joints": list(robot.names),
        "types": [joint.type for joint in robot.joints],
    }


def conventions_part(task: Task, rtol: float, wary: float, conditions: Conditions) -> Document:
    """Return the conventions: axes, units, gravity, payload and tolerances."""
    payload = conditions.payload
    units = {
        "position": POSITION_UNIT,
        "velocity": "rad/s (m/s for prismatic joints)",
        "torque": TORQUE_UNIT,
        "force": "N",
        "moment": "N·m",
        "length": "m",
        "gravity": GRAVITY_UNIT,
        "mass": "kg",
        "tip_velocity": "m/s, rad/s",
        "matrix": "m/rad, rad/rad (m/m for prismatic joints), unweighted",
        "sigma": "of the weighted Jacobian [J_lin; length * J_ang]",
        "lost_directions": "unit vectors of the weighted force [f; moment / length]",
    }
    return {
        **task_part(task, units),
        "gravity": conditions.gravity.tolist(),
        "payload": None
        if payload is None
        else {"mass": payload.mass, "offset": payload.offset.tolist()},
        "rtol": rtol,
        "wary": wary,
    }


def task_part(task: Task, units: Document) -> Document:
    """Return axes, components and sign of the force, and the units of a document."""
    return {
        "axes": task.axes,
        "task": str(task),
        "components": list(task.components),
        "length": task.length if task.moment_rows else None,
        "sign": text.SIGN,
        "units": units,
    }


def posture_part(posture: Posture) -> Document:
    """Return the joint positions."""
    return {"q": posture.q.tolist(), "source": posture.source}


def force_part(force: ForceChange | None) -> Document:
    """Return the tip force before and after the fault."""
    keys = ("requested", "unsupported", "before", "after", "jump")
    if force is None:
        return dict.fromkeys((*keys, "jump_norm", "moment_jump_norm"))
    vectors = {key: listed(getattr(force, key)) for key in keys}
    return {
        **vectors,
        "jump_norm": force.jump_norm,
        "moment_jump_norm": force.moment_jump_norm,
    }


def torque_part(
    names: Sequence[str], locked: Iterable[int], torque: TorqueChange | None
) -> Document:
    """Return the torques for the force, and the brake loads."""
    if torque is None:
        return {"before": None, "after": None, "brake_load": None, "self_motion": None}
    load = torque.brake_load
    return {
        "before": by_name(names, torque.before),
        "after": by_name(names, torque.after),
        "brake_load": None if load is None else {names[i]: float(load[i]) for i in locked},
        "self_motion": by_name(names, torque.self_motion),
    }


def rnea_part(names: Sequence[str], rnea: RneaChange) -> Document:
    """Return the torques for weight and motion."""
    gravity = by_name(names, rnea.gravity)
    return {
        "gravity": {"before": gravity, "after": gravity},
        "motion": {
            "before": by_name(names, rnea.motion_before),
            "after": by_name(names, rnea.motion_after),
        },
    }


def total_part(
    names: Sequence[str], locked: Iterable[int], torque: TorqueChange | None
) -> Document:
    """Return the total motor torques; ``None`` at locked joints, which the brake holds."""
    if torque is None:
        return {"before": None, "after": None}
    after = by_name(names, torque.total_after)
    if after is not None:
        after |= dict.fromkeys((names[i] for i in locked), None)
    return {"before": by_name(names, torque.total_before), "after": after}


def velocity_part(
    names: Sequence[str], velocity: VelocityChange | None, impact: Impact | None
) -> Document | None:
    """Return velocities before the fault, after the remap, and right after the lock."""
    if velocity is None:
        return None
    return {
        "before": by_name(names, velocity.before),
        "after": by_name(names, velocity.after),
        "tip_before": velocity.tip_before.tolist(),
        "tip_after": velocity.tip_after.tolist(),
        "jump": velocity.jump.tolist(),
        "jump_norm": velocity.jump_norm,
        "angular_jump_norm": velocity.angular_jump_norm,
        "impact": None
        if impact is None
        else {
            "after": by_name(names, impact.after),
            "tip_after": impact.tip_after.tolist(),
            "jump": impact.jump.tolist(),
            "jump_norm": impact.jump_norm,
            "angular_jump_norm": impact.angular_jump_norm,
        },
    }


def finite(x: float) -> float | None:
    """Return a number, or ``None`` if it is infinite or NaN."""
    return x if math.isfinite(x) else None


def listed(vector: Vector | tuple[float, ...] | None) -> list[float] | None:
    """Return a vector as a list, or ``None``."""
    if vector is None:
        return None
    return list(vector) if isinstance(vector, tuple) else vector.tolist()


def estimate_part(one: Estimate) -> Document:
    """Return a value and its interval; ``None`` where infinite or NaN."""
    return {"value": finite(one.value), "low": finite(one.low), "high": finite(one.high)}


def interval_columns(name: str, one: Estimate) -> Document:
    """Return the table columns of a value and its interval."""
    return {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}


def setting_part(setting: SweepSetting) -> Document:
    """Return the kinematic chain of a sweep."""
    return {
        "name": setting.robot,
        "base": setting.base,
        "tip": setting.tip,
        "joints": list(setting.joints),
    }


def check_part(check: Check) -> Document:
    """Return the comparison of one printed number of the paper."""
    return {
        "table": check.table,
        "row": check.row,
        "column": check.column,
        "printed": check.printed,
        "computed": check.computed,
        "outcome": check.outcome.value,
        "erratum": check.erratum,
    }


def rows_of(records: Iterable[Document]) -> list[Row]:
    """Return records as table rows, preceded by their keys as header; empty without records."""
    rows: list[Row] = []
    for record in records:
        if not rows:
            rows.append(tuple(record))
        rows.append(tuple(record.values()))
    return rows


def task_columns(task: Task) -> Document:
    """Return the table columns that define the task: axes, components and length."""
    return {
        "axes": task.axes,
        "task": str(task),
        "length [m]": task.length if task.moment_rows else "",
    }


def limits_source(limits: Limits | None) -> str:
    """Return the source of the torque limits; ``none`` if none are in force."""
    return "none" if limits is None else limits.source


def by_name(names: Sequence[str], vector: Vector | None) -> dict[str, float | None] | None:
    """Return a vector as a dict by joint name, ``None`` for NaN; ``None`` if there is no vector."""
    if vector is None:
        return None
    return {name: finite(x) for name, x in zip(names, vector.tolist(), strict=True)}


def modes_part(names: Sequence[str], faults: FaultSet) -> Document:
    """Return the fault modes and weak factors."""
    weak = {names[f.joint]: f.factor for f in faults.faults if f.mode is FaultMode.WEAK}
    return {"modes": {names[f.joint]: f.mode.value for f in faults.faults}, "weak_factors": weak}


def limits_part(names: Sequence[str], limits: Limits) -> Document:
    """Return the torque limits."""
    return {
        "source": limits.source,
        "effort": by_name(names, limits.effort),
        "brake": by_name(names, limits.brake),
    }


def amount_part(names: Sequence[str], amount: CapabilityRange) -> Document:
    """Return a capability range and what limits it."""
    return {
        "most": finite(amount.maximum),
        "least": finite(amount.minimum),
        "end": amount.end.value,
        "stops": [names[j] for j in amount.limiting_joints],
    }


def _weakest(amount: CapabilityRange) -> list[float] | None:
    """Return the weakest direction; ``None`` if there is no finite maximum."""
    return amount.direction.tolist() if math.isfinite(amount.maximum) else None


def polytope_part(capability: Capability) -> Document | None:
    """Return the force polytopes; ``None`` for tasks of more than 3 dimensions."""
    if capability.analysis.task.m > MOST_DRAWN:
        return None
    return {
        when: {
            reading.value: {
                "vertices": polytope.vertices.tolist(),
                "faces": [list(face) for face in polytope.faces],
                "dimension": polytope.dimension,
                "is_bounded": polytope.is_bounded,
            }
            for reading in LockModel
            for polytope in [capability.polytope(after=late, reading=reading)]
        }
        for when, late in (("before", False), ("after", True))
    }


def capability_part(capability: Capability) -> Document:
    """Return force and payload capabilities."""
    names = capability.analysis.robot.names
    before, after = capability.payload
    return {
        "directions": [
            {
                "name": report.name,
                "direction": report.before[LockModel.COMMANDED].direction.tolist(),
                "unit": report.unit,
                "before": {r.value: amount_part(names, x) for r, x in report.before.items()},
                "after": {r.value: amount_part(names, x) for r, x in report.after.items()},
            }
            for report in capability.directions
        ],
        "weakest": {
            "unit": text.unit_of_size(capability.analysis.task),
            **{
                when: {
                    r.value: {"direction": _weakest(x), **amount_part(names, x)}
                    for r, x in amounts.items()
                }
                for when, amounts in (
                    ("before", capability.weakest.before),
                    ("after", capability.weakest.after),
                )
            },
        },
        "payload": {
            "unit": "kg",
            "before": amount_part(names, before),
            "after": amount_part(names, after),
        },
    }
