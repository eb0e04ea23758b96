"""Format numbers, directions and force magnitudes as text, for tables and files."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.joint_scale import DEFAULT_JOINT_LENGTH
from ftforce.errors import listed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ftforce.batch.result import SweepSetting
    from ftforce.core.arrays import Vector
    from ftforce.core.joint_scale import JointScale
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import Setting

SIGN = (
    "force is what the robot exerts on its environment; tau = rnea(q, v, a) + J^T F; torques are "
    "the force part J^T F, apart from gravity, motion, total and brake_load"
)

NEGLIGIBLE = 1e-9  # N or N·m: rounding error
_ALONG = {"f": "force along", "m": "moment about", "fm": "wrench along"}
_ON_AXIS = 1e-3  # a direction this close to an axis is named after it


def number(x: float, digits: int = 2) -> str:
    """Format a number with fixed decimals, without negative zero."""
    text = f"{x:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def size(x: float, digits: int = 2) -> str:
    """Format a magnitude so that a small nonzero value is not shown as zero: 4e-04, not 0.00."""
    text = number(x, digits)
    return f"{x:.0e}" if float(text) == 0.0 and abs(x) > NEGLIGIBLE else text


def ratio(x: float) -> str:
    """Format a margin or ratio with three significant digits."""
    return "0" if abs(x) < 1e-12 else f"{x:.3g}"


def joined(words: Iterable[str]) -> str:
    """Join words into an enumeration."""
    words = list(words)
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def axes_in_words(task: Task | SweepSetting) -> str:
    """Describe the axes in which vectors are expressed."""
    return "the tool frame" if task.axes == "tool" else "the world (the robot's root), at the tip"


def joint_kinds(scale: JointScale) -> list[tuple[str, str]]:
    """Return how hinges weigh against slides; nothing where only one kind is there to be weighed.

    Parameters
    ----------
    scale :
        Weights of the joints.
    """
    words = ""
    if scale.is_mixed:
        words = f"hinges and slides: 1 rad weighed as {scale.length:g} m (--joint-length)"
    elif scale.length != DEFAULT_JOINT_LENGTH:
        words = "all joints turn, or all slide: --joint-length has no effect"
    return [("Joint kinds", words)] if words else []


def direction(task: Task, row: Vector) -> str:
    """Describe a direction by the axis it is parallel to, or else by its components.

    Parameters
    ----------
    task :
        The task.
    row :
        Unit vector in weighted task coordinates, shape (m,).
    """
    largest = int(np.argmax(np.abs(row)))
    if np.linalg.norm(np.delete(row, largest)) < _ON_AXIS:
        name = task.components[largest]
        return f"{_ALONG[name[0]]} {name[1]}"
    parts = list(zip(row.tolist(), task.components, strict=True))
    noticeable = [(x, name) for x, name in parts if abs(x) >= 0.005]
    kinds = {name[0] for _, name in noticeable}
    along = _ALONG["".join(sorted(kinds))]
    same_kind = [x for x, name in parts if name[0] in kinds]
    if len(kinds) == 1 and len(same_kind) == 3:
        return f"{along} ({', '.join(f'{round(x, 2) + 0.0:g}' for x in same_kind)})"
    return f"{along} {' '.join(f'{x:+.2f} {name}' for x, name in noticeable)}"


def lost_directions(task: Task, rows: Sequence[Vector]) -> str:
    """Describe the lost directions, in task axes."""
    return "; ".join(direction(task, row) for row in rows) or "none"


def amounts(task: Task, vector: Vector) -> str:
    """Format the magnitude of a force vector, N and N·m separately."""
    linear, angular = list(task.force_rows), list(task.moment_rows)
    parts = []
    if linear:
        parts.append(f"{size(float(np.linalg.norm(vector[linear])))} N")
    if angular:
        parts.append(f"{size(float(np.linalg.norm(vector[angular])))} N·m")
    return " and ".join(parts)


def vector_in_words(vector: Iterable[float]) -> str:
    """Format the components of a vector with two decimals."""
    return f"({', '.join(map(number, vector))})"


def unit_of_size(task: Task, direction: Vector | None = None) -> str:
    """Return the unit of a force magnitude along a direction, or of the norm if none is given."""
    if direction is None:
        return "weighted N" if task.force_rows and task.moment_rows else task.units[0]
    return "N" if direction[list(task.force_rows)].any() else "N·m"


def is_noticeable(vector: Vector) -> bool:
    """Return whether a force exceeds rounding errors."""
    return bool(np.any(np.abs(vector) > NEGLIGIBLE))


def percent(share: float) -> str:
    """Format a fraction in percent; never show 0% or 100% for a value that only rounds to it."""
    if 0.0 < share < 1e-9:
        return "<1e-7%"
    text = f"{100.0 * share:.3g}%" if share < 1.0 else f"{share:.0%}"
    return ">99.9%" if text == "100%" and share < 1.0 else text


def share(x: float, *, short: bool = False) -> str:
    """Format a fraction as the number of percent: for a column [%], or short for plot labels."""
    if math.isnan(x):
        return "–"
    x *= 100.0
    low, high = (0.001, 99.9) if short else (0.01, 99.99)
    if x <= 0.0 or x >= 100.0:
        return f"{x:.0f}"
    if x < low or x > high:
        return f"<{low:g}" if x < low else f">{high:g}"
    if short:
        return f"{x:.2g}" if x < 1.0 else f"{x:.3g}"
    return f"{x:.2f}" if x < 10.0 or x > 99.0 else f"{x:.1f}"


def with_units(names: Iterable[str], values: Iterable[float], units: Iterable[str]) -> str:
    """Format numbers with names and units: ``fx 80.00 N, fy 50.00 N``."""
    parts = zip(names, values, units, strict=True)
    return ", ".join(f"{name} {number(x)} {unit}" for name, x, unit in parts)


def set_of(joints: Iterable[int]) -> str:
    """Format joint indices (from 0) as a set of joint numbers (from 1): ``{2, 4}``."""
    return "{" + ", ".join(str(joint + 1) for joint in joints) + "}"


def torque_of(robot: Robot, joint: int, torque: float) -> str:
    """Format the absolute torque of a joint (index from 0) with its unit."""
    return f"{size(abs(torque))} {robot.joints[joint].torque_unit}"


def tip_in_words(arm: Robot | SweepSetting | Setting) -> str:
    """Return the tip, how it was chosen, and the tool frames that it is not."""
    others = [
        f"{link} ({1e3 * distance:.1f} mm, {math.degrees(angle):.1f}° away)"
        for link, (distance, angle) in arm.other_tips.items()
    ]
    how = f" ({arm.tip_source})" if arm.tip_source else ""  # older versions did not store it
    return f"{arm.tip}{how}" + (f", not {listed(others)}" if others else "")
