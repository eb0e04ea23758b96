"""Tables of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from ftforce.report.text import number, tip_in_words
from ftforce.show.tables.parts import TitledTable, facts, spaced, table

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import RenderableType

    from ftforce.robot.known_robots import KnownRobot
    from ftforce.robot.robot import Robot


def robot_view(robot: Robot) -> RenderableType:
    """Return the tables of a robot: chain, tips and postures."""
    held = "1 moving joint" if len(robot.held) == 1 else f"{len(robot.held)} moving joints"
    outside = f"{held} held fixed" if robot.held else "nothing moves"
    candidates = ", ".join(f"{name} ({count})" for name, count in robot.tips.items())
    about = [
        ("Robot", robot.name),
        ("Base", f"{robot.base} ({robot.base_source})"),
        ("Tip", tip_in_words(robot)),
        ("Tip candidates", f"{candidates or robot.tip} (joints above)"),
        ("Outside the chain", outside),
        ("Moving mass", f"{robot.mass:.3f} kg" if robot.mass else "unknown (the URDF has none)"),
    ]
    notes = [("Note", note) for note in robot.notes]
    return spaced(facts(about), _chain(robot), _postures(robot), facts(notes) if notes else None)


def _chain(robot: Robot) -> TitledTable:
    result = table(
        "Chain", "#", "joint", "type", "lower", "upper", "", "effort", "speed", left=3, folded=(1,)
    )
    for joint in robot.joints:
        free = joint.type == "continuous"
        name = joint.name
        if joint.followers:
            name += f" (moves {', '.join(joint.followers)})"
        effort = f"{joint.effort:g} {joint.torque_unit}" if joint.effort else "unknown"
        speed = f"{joint.velocity:g} {joint.unit}/s" if joint.velocity else "unknown"
        limits = ("–", "–") if free else (number(joint.lower, 4), number(joint.upper, 4))
        result.add_row(str(joint.number), name, joint.type, *limits, joint.unit, effort, speed)
    return result


def _postures(robot: Robot) -> RenderableType:
    result = table("Postures [rad, m]", "name", "q", left=2, folded=(0, 1))
    for name, q in robot.postures.items():
        result.add_row(name, ", ".join(number(x, 3) for x in q.tolist()))
    built_in = Text(
        "Also: mid-range, zero, bent (from mid-range), sample (best conditioned of 64).",
        style="dim",
    )
    return Group(result, built_in) if robot.postures else built_in


def robots_view(robots: Iterable[tuple[KnownRobot, Robot]]) -> RenderableType:
    """Return the table of the known robots."""
    result = table("Known robots", "name", "n", "tip", "postures", "about", left=5, folded=(3, 4))
    for known, robot in robots:
        names = ", ".join(robot.postures)
        result.add_row(known.name, str(robot.n), robot.tip, names, known.about)
    return result
