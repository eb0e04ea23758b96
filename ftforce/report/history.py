"""Simulation histories as text and JSON."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, columns, document, rows_of, whole
from ftforce.report.measures import MARGIN
from ftforce.report.text import amounts, joined, number, percent, ratio
from ftforce.trajectory.warnings import ON_PATH, ORIENTED, length_in_words, unsupported

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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
    when = f"with {_events_in_words(events)}" if events else "with every joint healthy"
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
        return (
            f"the arm carries its own weight and moves freely until the end, at {history.t[-1]:g} s"
        )
    if verdict is Verdict.TOLERATED:
        return f"{how} keeps {whole} at the tip until the end, at {history.t[-1]:g} s"
    since = _since(history, run)
    if np.isnan(run.force).any():
        fallen = int(np.argmax(np.isnan(run.force).any(axis=1)))
        since = f"{'at' if fallen else 'from'} {history.t[fallen]:g} s"
        words = f"the arm cannot be held in static equilibrium {since}"
        if verdict is Verdict.BORDERLINE:
            words += (
                f" at the tolerance {history.setting.rtol:g}; the missing part is small, "
                f"and a tolerance up to {history.setting.wary:g} changes the answer"
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
        words += ", and unbalanced torques move the arm"
    return words


def _asked_in_words(history: History) -> str:
    """Describe the requested force, or the part of it that the healthy arm can exert."""
    asked = np.array(history.setting.force)
    whole = amounts(history.setting.task, asked)
    if unsupported(history).any():
        return f"what the healthy arm can exert of the {whole}"
    return f"the full {whole}"


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
        return "The motion that follows is not simulated."
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


def _peak(about: str, unit: str, values: Callable[[_Case], Vector]) -> dict[str, Any]:
    """Return unit and parts of the largest value of a run and its time, for a `Field`."""

    def worst(case: _Case) -> tuple[Any, Any]:
        x = values(case)[case.run.until_fall]
        if np.isnan(x).all():
            return None, None
        i = int(np.nanargmax(x))
        return x[i], case.history.t[i]

    parts = (
        Field("most", about, unit, get=itemgetter(0)),
        Field("time", "when that is", "s", get=itemgetter(1)),
    )
    return {"get": worst, "parts": parts}


def _least_margin(case: _Case) -> tuple[float, float]:
    margin = case.run.margin
    return margin.min(), case.history.t[margin.argmin()]


def _largest(name: str) -> Callable[[_Case], list[float | None]]:
    """Return the function for the largest absolute value of each joint."""

    def values(case: _Case) -> list[float | None]:
        known = (np.abs(x[~np.isnan(x)]) for x in getattr(case.run, name)[case.run.until_fall].T)
        return [x.max() if len(x) else None for x in known]

    return values


class _Case(NamedTuple):
    """A run of a history."""

    history: History
    run: Run


def _case(name: str, history: History) -> _Case | None:
    run = history.runs.get(name)
    return None if run is None else _Case(history, run)


# fmt: off
_RUN = (
    replace(parts.VERDICT, meaning="the worst over time", get=lambda case: worst_verdict(case.run)),
    Field("falls_at", "time from which the arm cannot be held in static equilibrium, or moves "
        "under torques that nothing balances", "s", get=lambda case: (
        None if case.run.falls_from is None else case.history.t[case.run.falls_from]
    )),
    Field("force_jump", "peak",
        **_peak("largest ‖ΔF‖", parts.FORCE, lambda case: case.history.jump_norm(case.run))),
    Field("path_error", "peak",
        **_peak("largest distance from the path", "m", lambda case: case.run.path_error_norm)),
    Field("orientation_error", "peak; 0 if the orientation of the tip is free", **_peak(
        "largest angle between the orientations",
        "rad",
        lambda case: case.run.orientation_error_norm,
    )),
    Field("margin", MARGIN.meaning, get=_least_margin, parts=(
        Field("least", "smallest value over time", "1", get=itemgetter(0)),
        Field("time", "when that is", "s", get=itemgetter(1)),
    )),
    Field("torque", "largest torque of each motor", parts.TORQUE, "by joint", _largest("motor")),
    Field("brake", "largest load of each brake", parts.TORQUE, "by joint", _largest("brake")),
    Field("unbalanced", "largest torque that nothing balances", parts.TORQUE, "by joint",
        _largest("unbalanced")),
    Field("used", "largest share of each limit", "1", "by joint", _largest("used")),
)
_EVENT = (
    Field("time", "time of the fault", "s"),
    Field("faults", "the joints that fail then"),
    Field("all_faults", "all joints that have failed by then"),
    Field("impact_jump", "jump of the tip velocity at the impact, in the axes of the root; `null` "
        "without a lock or masses", "m/s", "3", lambda event: event.impact_jump or None),
    Field("velocity_jump", "the same with the velocity remap of Appendix A; `null` without a lock",
        "m/s", "3", lambda event: event.velocity_jump or None),
    Field("force_jump", "jump of the force that remains with the remap; `null` if the arm cannot "
        "be held", parts.FORCE),
    replace(parts.VERDICT, meaning="at that instant"),
)
HISTORY = (
    Field("robot", "keys as of an analysis", shape="as of an analysis", get="setting", parts=(
        Field("name", get="robot"),
        *parts.CHAIN,
        Field("joints", get=lambda x: [joint.name for joint in x.joints]),
        Field("types", get=lambda x: [joint.type for joint in x.joints]),
    )),
    Field("conventions", "keys as of an analysis, with the `units` of this document",
        shape="as of an analysis", get="setting", parts=(
        *parts.task_fields(
            {
                "time": "s",
                "position": parts.POSITION_UNIT,
                "torque": parts.TORQUE_UNIT,
                "force": "N",
                "moment": "N·m",
                "path_error": "m",
                "velocity_jump": "m/s, in the root's axes",
                "gravity": parts.GRAVITY_UNIT,
            }
        ),
        parts.GRAVITY,
        *parts.SETTING_PAYLOAD,
        parts.RTOL,
        parts.WARY,
    )),
    Field("course", "description of the trajectory", get="setting.course"),
    Field("start", "initial posture", get=whole, parts=(
        Field("q", "joint positions at the start", "rad, m", "n", lambda x: x.healthy.q[0]),
        Field("source", "where they come from", get="setting.start"),
    )),
    Field("duration", "time of the last instant", "s", get=lambda history: history.t[-1]),
    Field("samples", "number of instants", get=lambda history: len(history.t)),
    Field("force", "requested force", parts.FORCE, "m", "setting.force"),
    Field("limits", "source of the torque limits in force, or `none`", get="setting.limits"),
    Field("effort", "largest motor torques, in force or not", parts.TORQUE, "by joint",
        "setting.effort"),
    Field("effort_lower", "lower limits of the motors; absent if they are always those of `effort`",
        parts.TORQUE, "by joint", "setting.effort_lower", optional=True),
    Field("delay", "time from a fault until the remap acts; `null` if it never does", "s",
        get="setting.delay"),
    Field("events", "the faults", shape="list", get="setting.events", parts=_EVENT),
    Field("runs", "the simulated runs", get=whole, parts=(
        Field("healthy", "as if nothing failed; peaks are taken until the arm falls",
            get=partial(_case, "healthy"), parts=_RUN),
        Field("unremapped", "without the remap; keys as `runs.healthy`", shape="as `runs.healthy`",
            get=partial(_case, "unremapped"), optional=True, parts=_RUN),
        Field("remapped", "with the remap; missing if it never acts; keys as `runs.healthy`",
            shape="as `runs.healthy`", get=partial(_case, "remapped"), optional=True, parts=_RUN),
    )),
    replace(parts.VERDICT,
        meaning="the worst of the run with the remap, or if there is none without",
        get=lambda history: worst_verdict(history.answer)),
    replace(parts.SUMMARY, get=history_sentence),
    Field("notes", "assumptions", shape="list", get="setting.notes"),
    replace(parts.WARNINGS, get="setting.warnings"),
)
# fmt: on


def history_rows(history: History) -> list[Row]:
    """Return a summary of a history as table rows, one per run, with its peaks."""
    joints = [joint.name for joint in history.setting.joints]
    units = [joint.torque_unit for joint in history.setting.joints]
    cases = ((name, _Case(history, run)) for name, run in history.runs.items())
    return rows_of({"run": name} | columns(_RUN, case, joints, units=units) for name, case in cases)


def history_document(history: History) -> Document:
    """Return a summary of a history as a JSON document, with the peaks of each run."""
    return document(HISTORY, history, [joint.name for joint in history.setting.joints])
