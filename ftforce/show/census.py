"""Tables of a census."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce import words
from ftforce.show.tables import (
    TitledTable,
    defined,
    facts,
    spaced,
    table,
    verdict_text,
    warning_lines,
)
from ftforce.words import number, ratio, size

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.fault_census import Census

MOST_SETS = 40
"""How many fault sets a census table shows, worst first."""


def census_view(census: Census, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a census, with the ``most`` worst fault sets."""
    return spaced(
        facts(_census_situation(census)),
        _sets(census, most),
        _critical_joints(census),
        facts(_bounds(census)),
        warning_lines(census.posture.warnings),
        Text(words.critical_joint(census), style="bold"),
    )


def _census_situation(census: Census) -> list[tuple[str, str]]:
    robot, task = census.robot, census.task
    length = f", characteristic length {task.length:g} m" if task.moment_rows else ""
    force = "every direction (none given)"
    if census.before is not None:
        parts = zip(census.before.tolist(), task.components, task.units, strict=True)
        force = ", ".join(f"{name} {number(x)} {unit}" for x, name, unit in parts)
    return [
        ("Robot", f"{robot.name}: {robot.n} joints, {robot.base} → {robot.tip}"),
        ("Joints", robot.numbered()),
        ("Axes", f"{task.axes}: vectors are in the axes of {words.axes_in_words(task)}"),
        ("Task", f"{task} ({', '.join(task.components)}){length}"),
        ("Posture", census.posture.source),
        ("Force", force),
        ("Tolerance", f"rank {census.rtol:g}, wary below {census.wary:g}"),
    ]


def _sets(census: Census, most: int) -> TitledTable:
    task, forced = census.task, census.before is not None
    jumps = []
    if forced and task.force_rows:
        jumps.append("jump\n[N]")
    if forced and task.moment_rows:
        jumps.append("jump\n[N·m]")
    result = table(
        f"Fault sets, locked, worst first ({len(census.sets)} of 1 to {census.largest} joints)",
        "locked", "verdict", *jumps, "margin", "ρ", "rank\nlost", left=2,
    )  # fmt: skip
    for report in census.sets[:most]:
        sizes = (report.jump_norm, report.moment_jump_norm)
        rho = report.relative_manipulability
        result.add_row(
            str(report.faults),
            verdict_text(report.verdict),
            *(size(norm) for norm in sizes if norm is not None),
            ratio(report.margin),
            defined(rho),
            str(report.rank_lost),
        )
    if len(census.sets) > most:
        result.caption = f"… and {len(census.sets) - most} more; --format csv writes all"
    return result


def _critical_joints(census: Census) -> TitledTable:
    result = table(
        "Joints, most critical first", "#", "joint", "fails alone", "margin", "ρ",
        "sets not\ntolerated", "border-\nline", "mean loss\n[%]", left=3, folded=(1,),
    )  # fmt: skip
    for report in census.joints:
        alone, rho = report.alone, report.alone.relative_manipulability
        result.add_row(
            str(report.joint + 1),
            census.robot.names[report.joint],
            verdict_text(alone.verdict),
            ratio(alone.margin),
            defined(rho),
            f"{report.not_tolerated} of {report.sets}",
            str(report.borderline),
            f"{100.0 * report.mean_relative_jump:.1f}",
        )
    result.caption = "mean loss: jump over force, averaged over the sets that hold the joint"
    return result


def _bounds(census: Census) -> list[tuple[str, str]]:
    lines = []
    for f in range(1, census.largest + 1):
        worst, bound = census.worst_manipulability(f)
        if not math.isnan(worst) and bound > 0.0:
            best = f"{worst / bound:.0%} of {ratio(bound)}, the most that any posture can have"
            name = f"Worst ρ of {f} joint{'s' if f > 1 else ''}"
            lines.append((name, f"{ratio(worst)} ({best})"))
    return lines
