"""Tables of a simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from ftforce import words
from ftforce.history import VERDICTS
from ftforce.history_doubts import length_in_words
from ftforce.history_words import (
    history_sentence,
    peak,
    worst_verdict,
)
from ftforce.show.tables import (
    VERDICT_STYLE,
    TitledTable,
    facts,
    spaced,
    table,
    verdict_text,
    warning_lines,
)
from ftforce.words import number, ratio, size

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from ftforce.arrays import Vector
    from ftforce.history import EventReport, History, Run, Setting
    from ftforce.task import Task

_WIDEST = 3  # components that find room in a row
RUN_NAMES = {"healthy": "as if healthy", "unremapped": "without remap", "remapped": "with remap"}


def history_view(history: History) -> RenderableType:
    """Return the tables of a simulation."""
    verdict = worst_verdict(history.answer)
    return spaced(
        facts(_situation(history)),
        _events(history) if history.setting.events else None,
        _runs(history),
        _joints(history),
        _instants(history),
        _notes(history.setting),
        warning_lines(history.warnings),
        Text(history_sentence(history), style=VERDICT_STYLE[verdict]),
    )


def _situation(history: History) -> list[tuple[str, str]]:
    setting, task = history.setting, history.setting.task
    length = f", characteristic length {task.length:g} m" if task.moment_rows else ""
    parts = zip(setting.force, task.components, task.units, strict=True)
    steps = len(history.t)
    return [
        ("Robot", f"{setting.robot}: {len(setting.joints)} joints, {setting.base} → {setting.tip}"),
        ("Axes", f"{task.axes}: forces are in the axes of {words.axes_in_words(task)}"),
        ("Task", f"{task} ({', '.join(task.components)}){length}"),
        ("Force", ", ".join(f"{name} {number(x)} {unit}" for x, name, unit in parts)),
        ("Path", f"{setting.course} (points in the root's axes)"),
        ("Start", f"{setting.start}: q {_positions(history)}"),
        ("Faults", "; ".join(f"{e.faults} at {e.time:g} s" for e in setting.events) or "none"),
        ("Remap", _remap(history)),
        ("Loads", _loads(setting)),
        ("Limits", "none are counted" if setting.limits == "none" else setting.limits),
        ("Samples", f"{steps:,} from 0 to {history.t[-1]:g} s"),
    ]


def _notes(setting: Setting) -> RenderableType | None:
    return facts([("Assumed", note) for note in setting.notes]) if setting.notes else None


def _positions(history: History) -> str:
    """Write where the joints start, turning ones in degrees."""
    parts = []
    for joint, x in zip(history.setting.joints, history.healthy.q[0].tolist(), strict=True):
        sliding = joint.type == "prismatic"
        parts.append(f"{number(x, 3)} m" if sliding else f"{number(math.degrees(x), 1)}°")
    return ", ".join(parts)


def _remap(history: History) -> str:
    if history.remapped is None:
        return "never: the controller does not learn of the faults"
    delay = history.setting.delay
    return f"{delay:g} s after a fault" if delay else "in the instant of a fault"


def _loads(setting: Setting) -> str:
    gravity = ", ".join(f"{x:g}" for x in setting.gravity)
    payload = f"; payload {setting.payload}" if setting.payload else ""
    return f"gravity ({gravity}) m/s² in the root's axes{payload}"


def _events(history: History) -> TitledTable:
    task = history.setting.task
    unit = task.size_unit
    leaves = "after the remap" if history.remapped is not None else "that a remap would leave"
    result = table(
        "At the faults: jumps of the tip's velocity, and of the force " + leaves,
        "time", "joints", "at impact", "remapped", "force", "verdict", left=2, folded=(1, 5),
    )  # fmt: skip
    for event in history.setting.events:
        force = "–" if event.force_jump is None else f"{size(event.force_jump)} {unit}"
        result.add_row(
            f"{event.time:g} s", event.faults, _speed(event.impact_jump),
            _speed(event.velocity_jump), force, verdict_text(event.verdict),
        )  # fmt: skip
    return result


def _speed(jump: tuple[float, ...]) -> str:
    return f"{size(1e3 * math.hypot(*jump), 3)} mm/s" if jump else "–"


def _runs(history: History) -> TitledTable:
    task = history.setting.task
    unit = task.size_unit
    result = table(
        "The histories, at their worst",
        "", "off path", f"force jump [{unit}]", "margin", "unbalanced", "limit used", "verdict",
        folded=(0, 6),
    )  # fmt: skip
    for name, run in history.runs.items():
        result.add_row(
            RUN_NAMES[name],
            _off_path(run),
            _largest(history.jump_norm(run)[run.until_fall], "nothing holds"),
            ratio(float(run.margin.min())),
            _largest(np.abs(run.unbalanced[run.until_fall]).max(axis=1), "–"),
            _used(run),
            verdict_text(worst_verdict(run)),
        )
    result.caption = "unbalanced: torque that nothing balances and that moves the arm, N·m (N)"
    return result


def _off_path(run: Run) -> str:
    """Write the largest path error; of an arm that falls it is not known."""
    if run.falls_from is not None:
        return "falls"
    return length_in_words(float(run.path_error_norm.max()))


def _largest(values: Vector, otherwise: str) -> str:
    return otherwise if np.isnan(values).any() else size(float(values.max()))


def _used(run: Run) -> str:
    used = run.used[run.until_fall]
    known = used[~np.isnan(used)]
    return words.percent(float(known.max())) if len(known) else "–"


def _joints(history: History) -> TitledTable:
    runs = history.runs
    result = table(
        "Motor torques, largest absolute values over time",
        "#", "joint", "unit", *(RUN_NAMES[name] for name in runs), "brake", "limit",
        left=3, folded=(1,),
    )  # fmt: skip
    answer, setting = history.answer, history.setting
    for i, joint in enumerate(setting.joints):
        limit = setting.effort[i]
        load = answer.brake[answer.until_fall, i]
        brake = peak(load) if load.any() else ""
        result.add_row(
            str(i + 1), joint.name, joint.torque_unit,
            *(peak(run.motor[run.until_fall, i]) for run in runs.values()),
            brake, "unknown" if math.isnan(limit) else f"{limit:g}",
        )  # fmt: skip
    return result


def _instants(history: History) -> TitledTable:
    """Return the answer's force and path at the start, around each fault and at the end."""
    task, run = history.setting.task, history.answer
    columns = _force_columns(task)
    result = table(
        f"Instants, {RUN_NAMES['unremapped' if history.remapped is None else 'remapped']}",
        "time", *columns, "jump", "off path", "margin", "verdict",
        folded=(0, len(columns) + 4),
    )  # fmt: skip
    jump = history.jump_norm(run)
    for label, i in _shown(history, history.setting.events):
        result.add_row(
            label,
            *(_force_cell(rows, run.force[i]) for rows in columns.values()),
            "–" if math.isnan(jump[i]) else size(float(jump[i])),
            "–" if math.isnan(jump[i]) else length_in_words(float(run.path_error_norm[i])),
            ratio(float(run.margin[i])),
            verdict_text(VERDICTS[run.verdict[i]]),
        )
    return result


def _force_columns(task: Task) -> dict[str, list[int]]:
    """Return the components by their headings; of many only the sizes find room."""
    if task.m <= _WIDEST:
        headings = zip(task.components, task.units, strict=True)
        return {f"{name} [{unit}]": [i] for i, (name, unit) in enumerate(headings)}
    sizes = {"|f| [N]": task.force_rows, "|m| [N·m]": task.moment_rows}
    return {heading: list(rows) for heading, rows in sizes.items() if rows}


def _force_cell(rows: list[int], force: Vector) -> str:
    x = float(force[rows[0]]) if len(rows) == 1 else float(np.linalg.norm(force[rows]))
    return "–" if math.isnan(x) else number(x)


def _shown(history: History, events: Sequence[EventReport]) -> list[tuple[str, int]]:
    """Return the instants that are shown, each once, with their times in words."""
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
    return [(f"{history.t[i]:g} s", i) for i in sorted(indices)]
