"""Simulation histories as text and JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.report.parts import (
    GRAVITY_UNIT,
    POSITION_UNIT,
    TORQUE_UNIT,
    Document,
    finite,
    task_part,
)
from ftforce.report.text import amounts, joined, number, percent, ratio
from ftforce.trajectory.warnings import ON_PATH, ORIENTED, length_in_words, unsupported

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Vector
    from ftforce.trajectory.history import EventReport, History, Run


def worst_verdict(run: Run) -> Verdict:
    """Return the worst verdict of a run."""
    return VERDICTS[int(run.verdict.max())]


def history_sentence(history: History) -> str:
    """Describe what happens to the force and to the path, in a few plain sentences."""
    run, events = history.answer, history.setting.events
    verdict = worst_verdict(run)
    about = _about_force(history, run, verdict)
    when = f"after {_events_in_words(events)}" if events else "with every joint healthy"
    off = ""
    if run.path_error_norm.max() > ON_PATH and run.falls_from is None:
        off = ", but off the path" if verdict is Verdict.TOLERATED else ", and off the path"
    parts = [f"{verdict.value.capitalize()}{off}: {when}, {about}.", _about_path(history, run)]
    return " ".join([*parts, *_about_healthy(history)])


def _events_in_words(events: tuple[EventReport, ...]) -> str:
    return joined(f"{event.faults} at {event.time:g} s" for event in events)


def _about_force(history: History, run: Run, verdict: Verdict) -> str:
    whole = _asked_in_words(history)
    acts = [event.time + history.setting.delay for event in history.setting.events]
    how = "the remap" if min(acts, default=0.0) <= history.t[-1] else "the arm, without any remap,"
    if not history.setting.events:
        how = "the arm"
    if verdict is Verdict.TOLERATED and not any(history.setting.force):
        return f"the arm carries its own weight and moves freely to the end, at {history.t[-1]:g} s"
    if verdict is Verdict.TOLERATED:
        return f"{how} keeps {whole} at the tip to the end, at {history.t[-1]:g} s"
    since = _since(history, run)
    if np.isnan(run.force).any():
        fallen = int(np.argmax(np.isnan(run.force).any(axis=1)))
        words = f"nothing holds the arm {'at' if fallen else 'from'} {history.t[fallen]:g} s"
        if verdict is Verdict.BORDERLINE:
            words += (
                f" at the tolerance {history.setting.rtol:g}; what is missing is small, and a "
                f"tolerance up to {history.setting.wary:g} gives another answer"
            )
        return words
    if verdict is Verdict.BORDERLINE:
        return (
            f"{since} it depends on the tolerance whether {whole} is kept (smallest margin "
            f"{ratio(float(run.margin.min()))})"
        )
    jump = history.jump_norm(run)[run.until_fall]
    worst = int(jump.argmax())
    loss = amounts(history.setting.task, run.jump[worst])
    words = f"{since} {whole} is not kept: the force jumps by up to {loss}, at "
    words += f"{history.t[worst]:g} s"
    if run.falls_from is not None:
        words += ", and torques that nothing balances move the arm"
    return words


def _asked_in_words(history: History) -> str:
    """Describe the requested force, or the part of it that the healthy arm can exert."""
    asked = np.array(history.setting.force)
    whole = amounts(history.setting.task, asked)
    if unsupported(history).any():
        return f"what the healthy arm can exert of the {whole}"
    return f"the whole {whole}"


def _since(history: History, run: Run) -> str:
    """Describe when the worst verdict applies."""
    bad = run.verdict == run.verdict.max()
    first = int(np.argmax(bad))
    if bad[first:].all():
        return f"from {history.t[first]:g} s on" if first else "from the start"
    return f"at {percent(float(bad.mean()))} of all instants, first at {history.t[first]:g} s,"


def _about_healthy(history: History) -> Iterator[str]:
    """Yield sentences on deficiencies of the healthy arm."""
    lacking = unsupported(history)
    if lacking.any():
        worst = int(np.linalg.norm(lacking, axis=1).argmax())
        missing = amounts(history.setting.task, lacking[worst])
        when = f"at {history.t[worst]:g} s"
        yield f"Even the healthy arm cannot exert {missing} of the request {when}."
    verdict = worst_verdict(history.healthy)
    if history.setting.events and verdict is not Verdict.TOLERATED:
        since = _since(history, history.healthy).removesuffix(",")
        yield f"Even the healthy arm is {verdict.value} {since}."


def _about_path(history: History, run: Run) -> str:
    if run.falls_from is not None:
        return "Where that takes the arm is not simulated."
    error = run.path_error_norm
    worst = int(error.argmax())
    turn = float(run.orientation_error_norm.max())
    turned = f" It turns by up to {math.degrees(turn):.3g}°." if turn > ORIENTED else ""
    if error[worst] <= ON_PATH:
        off = length_in_words(float(error[worst])).removeprefix("< ")
        return f"The tip stays within {off} of its path.{turned}"
    last = length_in_words(float(error[-1]))
    return (
        f"The tip leaves its path by up to {length_in_words(float(error[worst]))}, at "
        f"{history.t[worst]:g} s; at the end it is {last} off.{turned}"
    )


def peak(values: Vector) -> str:
    """Format the largest absolute value; a dash if all are NaN."""
    known = np.abs(values[~np.isnan(values)])
    return number(float(known.max())) if len(known) else "–"


def history_document(history: History) -> Document:
    """Return a summary of a history as a JSON document, with the peaks of each run."""
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
    """Return the peaks of a run; ``None`` where the arm cannot be held."""
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
