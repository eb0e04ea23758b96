"""Histories and timelines as documents: what JSON says of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.report.history import history_sentence, timeline_sentence, worst_verdict
from ftforce.report.parts import (
    GRAVITY_UNIT,
    POSITION_UNIT,
    TORQUE_UNIT,
    Document,
    arm_part,
    conventions_part,
    finite,
    limits_part,
    listed,
    modes_part,
    task_part,
)

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.trajectory.history import EventReport, History, Run
    from ftforce.trajectory.timeline import Timeline, WorstInstant


def history_document(history: History) -> Document:
    """Return a summary of a simulation: what was simulated, and each run at its worst."""
    setting, task = history.setting, history.setting.task
    return {
        "robot": {
            "name": setting.robot,
            "base": setting.base,
            "tip": setting.tip,
            "joints": [joint.name for joint in setting.joints],
            "types": [joint.type for joint in setting.joints],
        },
        "conventions": {
            **task_part(
                task,
                {
                    "time": "s",
                    "position": POSITION_UNIT,
                    "torque": TORQUE_UNIT,
                    "force": "N",
                    "moment": "N·m",
                    "path_error": "m",
                    "velocity_jump": "m/s, in the root's axes",
                    "gravity": GRAVITY_UNIT,
                },
            ),
            "gravity": list(setting.gravity),
            "payload": setting.payload or None,
            "rtol": setting.rtol,
            "wary": setting.wary,
        },
        "course": setting.course,
        "start": {"q": history.healthy.q[0].tolist(), "source": setting.start},
        "duration": float(history.t[-1]),
        "samples": len(history.t),
        "force": list(setting.force),
        "limits": setting.limits,
        "effort": {
            joint.name: finite(limit)
            for joint, limit in zip(setting.joints, setting.effort, strict=True)
        },
        "delay": finite(setting.delay),
        "events": [_event(event) for event in setting.events],
        "runs": {name: _run(history, run) for name, run in history.runs.items()},
        "verdict": worst_verdict(history.answer).value,
        "summary": history_sentence(history),
        "notes": list(setting.notes),
        "warnings": list(setting.warnings),
    }


def _event(event: EventReport) -> Document:
    return {
        "time": event.time,
        "faults": event.faults,
        "all_faults": event.all_faults,
        "impact_jump": list(event.impact_jump) or None,
        "velocity_jump": list(event.velocity_jump) or None,
        "force_jump": event.force_jump,
        "verdict": event.verdict.value,
    }


def _run(history: History, run: Run) -> Document:
    """Return the worst of a run; what nothing holds is ``None``."""
    here = run.until_fall
    jump, error = history.jump_norm(run)[here], run.path_error_norm[here]
    names = [joint.name for joint in history.setting.joints]
    return {
        "verdict": worst_verdict(run).value,
        "falls_at": None if run.falls_from is None else float(history.t[run.falls_from]),
        "force_jump": _peak(history.t, jump),
        "path_error": _peak(history.t, error),
        "orientation_error": _peak(history.t, run.orientation_error_norm[here]),
        "margin": {"least": float(run.margin.min()), "time": float(history.t[run.margin.argmin()])},
        "torque": dict(zip(names, map(_largest, run.motor[here].T), strict=True)),
        "brake": dict(zip(names, map(_largest, run.brake[here].T), strict=True)),
        "unbalanced": dict(zip(names, map(_largest, run.unbalanced[here].T), strict=True)),
        "used": dict(zip(names, map(_largest, run.used[here].T), strict=True)),
    }


def _peak(t: Vector, values: Vector) -> Document:
    if np.isnan(values).all():
        return {"most": None, "time": None}
    worst = int(np.nanargmax(values))
    return {"most": float(values[worst]), "time": float(t[worst])}


def _largest(values: Vector) -> float | None:
    known = np.abs(values[~np.isnan(values)])
    return float(known.max()) if len(known) else None


def timeline_document(timeline: Timeline) -> Document:
    """Return a timeline: each fault set at its worst, and all numbers over time."""
    names, task = timeline.robot.names, timeline.task
    limits = timeline.limits
    bearing = timeline.capability_limits
    return {
        "robot": arm_part(timeline.robot),
        "conventions": conventions_part(task, timeline.rtol, timeline.wary, timeline.conditions),
        "course": timeline.course,
        "start": {"q": timeline.q[0].tolist(), "source": timeline.start},
        "mode": timeline.mode.value,
        "faults": timeline.largest,
        "force": listed(timeline.force),
        "direction": listed(timeline.direction),
        "limits": None if limits is None else limits_part(names, limits),
        "capability_limits": None if bearing is None else limits_part(names, bearing),
        "sets": [
            {**modes_part(names, worst.faults), **_worst(worst)} for worst in timeline.worst()
        ],
        "times": timeline.t.tolist(),
        "columns": [modes_part(names, faults) for faults in timeline.sets],
        "jump": _rows(timeline.jump),
        "margin": _rows(timeline.margin),
        "capability": _rows(timeline.capability),
        "summary": timeline_sentence(timeline),
        "warnings": list(timeline.warnings),
    }


def _worst(worst: WorstInstant) -> Document:
    return {
        "time": worst.time,
        "jump": finite(worst.jump),
        "margin": worst.margin,
        "verdict": worst.verdict.value,
        "not_tolerated": worst.not_tolerated,
        "capability": finite(worst.capability),
        "capability_time": worst.capability_time,
    }


def _rows(values: Matrix) -> list[list[float | None]]:
    return [[finite(x) for x in row] for row in values.tolist()]
