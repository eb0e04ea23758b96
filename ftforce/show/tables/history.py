"""Tables of a simulation history."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from ftforce.core.verdict import VERDICTS
from ftforce.report import text
from ftforce.report.history import history_sentence, peak, worst_verdict
from ftforce.report.measures import MARGIN
from ftforce.report.text import number, ratio, size
from ftforce.show.tables.analysis import force_fact, task_facts
from ftforce.show.tables.parts import (
    VERDICT_STYLE,
    TitledTable,
    arm_facts,
    facts,
    listing,
    spaced,
    table,
    verdict_text,
    warning_lines,
)
from ftforce.trajectory.warnings import length_in_words

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from ftforce.core.arrays import Vector
    from ftforce.core.task import Task
    from ftforce.trajectory.history import EventReport, History, Run, Setting

_WIDEST = 3  # components that fit into a row
_RUN_NAMES = {"healthy": "as if healthy", "unremapped": "without remap", "remapped": "with remap"}


def history_view(history: History) -> RenderableType:
    """Return the tables of a simulation history."""
    verdict = worst_verdict(history.answer)
    return spaced(
        facts(_situation(history)),
        _events(history) if history.setting.events else None,
        _runs(history),
        _joints(history),
        _instants(history),
        facts([("Assumed", note) for note in notes]) if (notes := history.setting.notes) else None,
        warning_lines(history.warnings),
        Text(history_sentence(history), style=VERDICT_STYLE[verdict]),
    )


def _situation(history: History) -> list[tuple[str, str]]:
    setting, task = history.setting, history.setting.task
    return [
        *arm_facts(setting.robot, setting),
        *task_facts(task, "forces"),
        *text.joint_kinds(setting.scale),
        force_fact(task, setting.force),
        ("Path", f"{setting.course} (points in the root's axes)"),
        ("Start", f"{setting.start}: q {_positions(history)}"),
        ("Faults", "; ".join(f"{e.faults} at {e.time:g} s" for e in setting.events) or "none"),
        ("Remap", _remap(history)),
        ("Loads", _loads(setting)),
        ("Limits", "not enforced" if setting.limits == "none" else setting.limits),
        ("Samples", f"{len(history.t):,} from 0 to {history.t[-1]:g} s"),
    ]


def _positions(history: History) -> str:
    """Format the initial joint positions, those of revolute joints in degrees."""
    parts = []
    for joint, x in zip(history.setting.joints, history.healthy.q[0].tolist(), strict=True):
        sliding = joint.type == "prismatic"
        parts.append(f"{number(x, 3)} m" if sliding else f"{number(math.degrees(x), 1)}°")
    return ", ".join(parts)


def _remap(history: History) -> str:
    if history.remapped is None:
        return "never: the controller does not detect the faults"
    delay = history.setting.delay
    return f"{delay:g} s after a fault" if delay else "at the instant of a fault"


def _loads(setting: Setting) -> str:
    gravity = ", ".join(f"{x:g}" for x in setting.gravity)
    payload = f"; payload {setting.payload}" if setting.payload else ""
    return f"gravity ({gravity}) m/s² in the root's axes{payload}"


def _events(history: History) -> TitledTable:
    unit = history.setting.task.size_unit
    leaves = "after the remap" if history.remapped is not None else "that a remap would leave"
    title = "At the faults: jumps of the tip's velocity, and of the force " + leaves
    headings = ("time", "joints", "at impact", "remapped", "force", "verdict")
    result = table(title, *headings, left=2, folded=(1, 5))
    for event in history.setting.events:
        result.add_row(
            f"{event.time:g} s",
            event.faults,
            _speed(event.impact_jump),
            _speed(event.velocity_jump),
            "–" if event.force_jump is None else f"{size(event.force_jump)} {unit}",
            verdict_text(event.verdict),
        )
    return result


def _speed(jump: tuple[float, ...]) -> str:
    return f"{size(1e3 * math.hypot(*jump), 3)} mm/s" if jump else "–"


def _runs(history: History) -> TitledTable:
    rows = [_run(history, name, run) for name, run in history.runs.items()]
    result = listing("The histories, at their worst", rows, folded=(0, 6))
    result.caption = "unbalanced: torque out of equilibrium, which moves the arm, N·m (N)"
    return result


def _run(history: History, name: str, run: Run) -> Iterator[tuple[str, str | Text]]:
    here, unit = run.until_fall, history.setting.task.size_unit
    yield "", _RUN_NAMES[name]
    yield "off path", _off_path(run)
    yield f"force jump [{unit}]", _largest(history.jump_norm(run)[here], "not held")
    yield MARGIN.symbol, ratio(float(run.margin.min()))
    yield "unbalanced", _largest(np.abs(run.unbalanced[here]).max(axis=1), "–")
    yield "limit used", _used(run)
    yield "verdict", verdict_text(worst_verdict(run))


def _off_path(run: Run) -> str:
    """Format the largest path error, which is unknown for an arm that falls."""
    if run.falls_from is not None:
        return "falls"
    return length_in_words(float(run.path_error_norm.max()))


def _largest(values: Vector, otherwise: str) -> str:
    return otherwise if np.isnan(values).any() else size(float(values.max()))


def _used(run: Run) -> str:
    used = run.used[run.until_fall]
    known = used[~np.isnan(used)]
    return text.percent(float(known.max())) if len(known) else "–"


def _joints(history: History) -> TitledTable:
    rows = [_joint(history, i) for i in range(len(history.setting.joints))]
    return listing("Motor torques, largest absolute values over time", rows, left=3, folded=(1,))


def _joint(history: History, i: int) -> Iterator[tuple[str, str]]:
    joint, limit, answer = history.setting.joints[i], history.setting.effort[i], history.answer
    lower = history.setting.effort_lower[i] if history.setting.effort_lower else -limit
    yield "#", str(i + 1)
    yield "joint", joint.name
    yield "unit", joint.torque_unit
    for name, run in history.runs.items():
        yield _RUN_NAMES[name], peak(run.motor[run.until_fall, i])
    load = answer.brake[answer.until_fall, i]
    yield "brake", peak(load) if load.any() else ""
    shown = f"{limit:g}" if lower == -limit else f"{lower:g} … {limit:g}"
    yield "limit", "unknown" if math.isnan(limit) else shown


def _instants(history: History) -> TitledTable:
    """Return the table of force and path error at the start, around each fault and at the end."""
    columns = _force_columns(history.setting.task)
    rows = [_instant(history, columns, i) for i in _shown(history, history.setting.events)]
    name = _RUN_NAMES["unremapped" if history.remapped is None else "remapped"]
    return listing(f"Instants, {name}", rows, folded=(0, len(columns) + 4))


def _instant(
    history: History, columns: dict[str, list[int]], i: int
) -> Iterator[tuple[str, str | Text]]:
    run, jump = history.answer, float(history.jump_norm(history.answer)[i])
    falls = math.isnan(jump)
    yield "time", f"{history.t[i]:g} s"
    for heading, rows in columns.items():
        yield heading, _force_cell(rows, run.force[i])
    yield "jump", "–" if falls else size(jump)
    yield "off path", "–" if falls else length_in_words(float(run.path_error_norm[i]))
    yield MARGIN.symbol, ratio(float(run.margin[i]))
    yield "verdict", verdict_text(VERDICTS[run.verdict[i]])


def _force_columns(task: Task) -> dict[str, list[int]]:
    """Return components by heading; if there are too many, only the magnitudes."""
    if task.m <= _WIDEST:
        headings = zip(task.components, task.units, strict=True)
        return {f"{name} [{unit}]": [i] for i, (name, unit) in enumerate(headings)}
    sizes = {"|f| [N]": task.force_rows, "|m| [N·m]": task.moment_rows}
    return {heading: list(rows) for heading, rows in sizes.items() if rows}


def _force_cell(rows: list[int], force: Vector) -> str:
    x = float(force[rows[0]]) if len(rows) == 1 else float(np.linalg.norm(force[rows]))
    return "–" if math.isnan(x) else number(x)


def _shown(history: History, events: Sequence[EventReport]) -> list[int]:
    """Return the indices of the instants shown, without duplicates."""
    last = len(history.t) - 1
    indices = {0, last}
    for event in events:
        at = int(np.searchsorted(history.t, event.time))
        indices |= {max(at - 1, 0), min(at, last)}
        late = event.time + history.setting.delay
        if history.setting.delay and late <= history.t[-1]:
            indices.add(int(np.searchsorted(history.t, late)))
    worst = history.jump_norm(history.answer)
    if not np.isnan(worst).any() and worst.max() > 0.0:
        indices.add(int(worst.argmax()))
    return sorted(indices)
