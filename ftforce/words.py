"""Results in plain words: lost directions and verdicts, for tables and files alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.metrics import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ftforce.analysis import Analysis
    from ftforce.arrays import Vector
    from ftforce.changes import ForceChange
    from ftforce.fault_census import Census
    from ftforce.task import Task

SIGN = (
    "force is what the robot exerts on its environment; tau = rnea(q, v, a) + J^T F; torques here "
    "are the force part J^T F, without weight and motion"
)

NEGLIGIBLE = 1e-9  # N or N·m: rounding
_ON_AXIS = 1e-3  # a direction this close to an axis is called by its name


def number(x: float, digits: int = 2) -> str:
    """Write a number with fixed decimals and never a negative zero."""
    text = f"{x:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def size(x: float, digits: int = 2) -> str:
    """Write what may be small but must not look like nothing: a jump of 4e-04 N is no 0.00 N."""
    text = number(x, digits)
    return f"{x:.0e}" if float(text) == 0.0 and abs(x) > NEGLIGIBLE else text


def ratio(x: float) -> str:
    """Write a margin or ratio with three significant digits."""
    return "0" if abs(x) < 1e-12 else f"{x:.3g}"


def joined(words: Iterable[str]) -> str:
    """Join words as a sentence does."""
    words = list(words)
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def axes_in_words(task: Task) -> str:
    """Say which axes vectors are given in."""
    return "the tool frame" if task.axes == "tool" else "the world (the robot's root), at the tip"


def direction(task: Task, row: Vector) -> str:
    """Say a direction: the name of a task axis where it falls on one, else its components.

    Parameters
    ----------
    task :
        The task.
    row :
        Unit vector in weighted task coordinates, shape (m,).
    """
    largest = int(np.argmax(np.abs(row)))
    if np.linalg.norm(np.delete(row, largest)) < _ON_AXIS:
        kind = "force" if task.components[largest][0] == "f" else "moment"
        return f"{kind} along {task.components[largest][1]}"
    parts = zip(row.tolist(), task.components, strict=True)
    return " ".join(f"{x:+.2f} {name}" for x, name in parts if abs(x) >= 0.005)


def lost_directions(task: Task, rows: Sequence[Vector]) -> str:
    """Say which directions are lost, in the task's axes."""
    return "; ".join(direction(task, row) for row in rows) or "none"


def amounts(task: Task, vector: Vector) -> str:
    """Say the size of a force vector: N and N·m apart."""
    linear, angular = list(task.force_rows), list(task.moment_rows)
    parts = []
    if linear:
        parts.append(f"{size(float(np.linalg.norm(vector[linear])))} N")
    if angular:
        parts.append(f"{size(float(np.linalg.norm(vector[angular])))} N·m")
    return " and ".join(parts)


def is_noticeable(vector: Vector) -> bool:
    """Return whether a force is more than rounding."""
    return bool(np.any(np.abs(vector) > NEGLIGIBLE))


def verdict_sentence(analysis: Analysis) -> str:
    """Say the verdict in one plain sentence, or a few."""
    subject = _subject(analysis.locked)
    if analysis.force is None:
        return f"{_headline(analysis.verdict)}: {subject}, {_about_all_forces(analysis)}."
    about = _about_one_force(analysis, analysis.force)
    sentence = f"{_headline(analysis.verdict)}: {subject}, {about}."
    unsupported = analysis.force.unsupported
    if is_noticeable(unsupported):
        missing = amounts(analysis.task, unsupported)
        sentence += f" Even the healthy arm cannot exert {missing} of the request here."
    return sentence


def _headline(verdict: Verdict) -> str:
    return verdict.value.capitalize()


def _subject(names: Sequence[str]) -> str:
    return f"with {joined(names)} locked" if names else "with no joint locked"


def _about_one_force(analysis: Analysis, force: ForceChange) -> str:
    before, jump = (amounts(analysis.task, vector) for vector in (force.before, force.jump))
    if analysis.verdict is Verdict.TOLERATED:
        return f"the healthy joints keep the whole {before} at the tip"
    if analysis.verdict is Verdict.BORDERLINE:
        lost = f"a jump of {jump} from" if is_noticeable(force.jump) else "no jump of"
        return (
            f"{lost} {before} at the tolerance {analysis.reduced.rtol:g}, but a tolerance up to "
            f"{analysis.wary:g} gives another answer (margin {ratio(analysis.margin)})"
        )
    return (
        f"{jump} of {before} can no longer be commanded by any motor; along the lost directions "
        f"the arm cannot move, and its brakes and links carry what load there is"
    )


def _about_all_forces(analysis: Analysis) -> str:
    lost = lost_directions(analysis.task, list(analysis.lost_directions))
    if analysis.verdict is Verdict.TOLERATED:
        return "every force that the healthy arm can exert here is kept"
    if analysis.verdict is Verdict.BORDERLINE:
        return (
            f"the arm is close to losing a direction (margin {ratio(analysis.margin)}); whether "
            f"it counts depends on the tolerance, {analysis.reduced.rtol:g} to {analysis.wary:g}"
        )
    return f"no motor can command {lost} any more; forces square to that are kept"


def critical_joint(census: Census) -> str:
    """Say which joint is the critical one."""
    worst, robot = census.joints[0], census.robot
    name = f"{robot.joints[worst.joint].number} {robot.names[worst.joint]}"
    for count, verdict in (
        (worst.not_tolerated, Verdict.NOT_TOLERATED),
        (worst.borderline, Verdict.BORDERLINE),
    ):
        if count:
            share = "all" if count == worst.sets else f"{count} of"
            return (
                f"Critical joint: {name}. Of the fault sets that hold it, {share} "
                f"{worst.sets} {'is' if count == 1 else 'are'} {verdict.value}."
            )
    return (
        f"Every fault set is tolerated here; joint {name} leaves the smallest margin, "
        f"{ratio(worst.alone.margin)}, when it fails alone."
    )
