"""Torques and forces as HTML tables, with bars for the use of limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.faults import FaultMode
from ftforce.report import text
from ftforce.report.text import number, size
from ftforce.view.page.html import cell, css, element, row, table, text_on
from ftforce.view.scene.arrows import norm
from ftforce.view.scene.colours import colour_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from markupsafe import Markup

    from ftforce.analysis.analyze import Analysis
    from ftforce.core.arrays import Vector
    from ftforce.core.task import Task
    from ftforce.view.model.answer import JointLoad
    from ftforce.view.scene.colours import Colour


def load_table(
    loads: Sequence[JointLoad],
    has_masses: bool,
    names: tuple[str, str] = ("before", "after"),
    *,
    moves: bool = False,
) -> Markup:
    """Return the motor torques, with a bar for each one's share of its limit.

    Parameters
    ----------
    loads :
        Loads of the joints.
    has_masses :
        Whether the URDF has masses, so that gravity torques are known.
    names :
        Headings of the two columns.
    moves :
        Whether motion torques are among them.
    """
    units = {load.unit for load in loads}
    unit = units.pop() if len(units) == 1 else "N·m, N"
    parts = "gravity and motion" if moves else "gravity"
    title = f"Motor torque [{unit}], {parts} {'included' if has_masses else 'unknown'}"
    columns = [
        ("#", "l", "31px"),
        ("joint", "l", ""),
        (names[0], "", "56px"),
        (names[1], "", "51px"),
        ("of limit", "l", "50px"),
        ("", "", "40px"),
    ]
    rows = (_load_row(load) for load in loads)
    return element("div", element("h3", title), table(columns, rows, "torques"))


def _load_row(load: JointLoad) -> Markup:
    after = _torque_text(load.after)
    hint = f"for the tip force: {_torque_text(load.part_before)} → {_torque_text(load.part_after)}"
    mode = None if load.fault is None else load.fault.mode
    if mode is FaultMode.LOCKED:
        after, hint = "brake", f"brake load {_torque_text(load.brake)} {load.unit}; {hint}"
    colour = colour_of(mode, load.used)
    background = "" if mode is None else f"background:{css(colour)};color:{text_on(colour)}"
    # The mode must not depend on colour alone; the full word would not fit beside the name.
    place = str(load.number) if mode is None else f"{load.number} {mode[0].upper()}"
    name = load.name if load.fault is None else f"{load.name}: {load.fault}"
    limit = "unknown" if math.isnan(load.limit) else f"{load.limit:g} {load.unit}"
    return row(
        [
            element("td", place, class_="l", style=background, title=name),
            cell(load.name, "l", name),
            cell(_torque_text(load.before), "", hint),
            cell(after, "", hint),
            element("td", bar(load.used, colour), title=f"limit {limit}"),
            cell(share_text(load.used), "over" if load.used > 1.0 else "", f"limit {limit}"),
        ]
    )


def brake_loads(loads: Sequence[JointLoad]) -> list[tuple[str, str]]:
    """Return the brake loads with their labels, as accepted by `facts`; empty if none is locked."""
    texts = [f"{x.name} {number(x.brake)} {x.unit}" for x in loads if not math.isnan(x.brake)]
    return [("Brake load", ", ".join(texts))] if texts else []


def _torque_text(torque: float) -> str:
    """Return a torque as text, or a placeholder if unknown."""
    return "–" if math.isnan(torque) else number(torque)


def share_text(share: float) -> str:
    """Return a share of a limit in percent."""
    if math.isinf(share):
        return "∞"
    return "?" if math.isnan(share) else f"{share:.0%}"


def bar(share: float, colour: Colour) -> Markup:
    """Return a bar filled in proportion to a share of a limit.

    Parameters
    ----------
    share :
        Motor torque as a share of its limit; NaN if unknown.
    colour :
        Colour of the filled part.
    """
    width = 0.0 if math.isnan(share) else 100.0 * min(share, 1.0)
    # Only the darker half of the ramp: its light end would be invisible on a white page.
    filled = element("i", style=f"width:{width:.0f}%;background:{css(colour)}")
    return element("div", filled, class_="bar")


def force_table(analysis: Analysis) -> Markup:
    """Return the tip force before and after and the force jump, by axis and norm."""
    task, change = analysis.task, analysis.force
    if change is None:
        return element("div", element("h3", _force_title(task)), _unit_forces(analysis))
    vectors: dict[str, Vector | None] = {}
    if change.requested is not None and text.is_noticeable(change.unsupported):
        vectors["request"] = change.requested  # the longer word would not fit
    vectors |= {"before": change.before, "after": change.after, "jump": change.jump}
    return vector_table(task, vectors)


def _force_title(task: Task) -> str:
    return f"Force at the tip, in the axes of {text.axes_in_words(task)}"


def vector_table(task: Task, vectors: Mapping[str, Vector | None]) -> Markup:
    """Return tip forces by axis, with their norms.

    Parameters
    ----------
    task :
        The task.
    vectors :
        Forces and moments by name, N and N·m, shape (m,); ``None`` if undefined.
    """
    columns = [("", "l", "72px"), ("", "l", "34px"), *((name, "", "") for name in vectors)]
    values = [np.full(task.m, np.nan) if F is None else F for F in vectors.values()]
    rows = [
        _force_row([name, unit], [F[i] for F in values])
        for i, (name, unit) in enumerate(zip(task.components, task.units, strict=True))
    ]
    for name, unit, own in (
        ("|force|", "N", list(task.force_rows)),
        ("|moment|", "N·m", list(task.moment_rows)),
    ):
        if own:
            rows.append(_force_row([name, unit], [norm(F[own]) for F in values], "b"))
    return element("div", element("h3", _force_title(task)), table(columns, rows, "forces"))


def _force_row(names: Iterable[str], values: Iterable[float], kind: str = "") -> Markup:
    texts = ("–" if math.isnan(x) else size(float(x)) for x in values)
    return row([*(cell(name, "l") for name in names), *map(cell, texts)], kind)


def _unit_forces(analysis: Analysis) -> Markup:
    """Return the kept and lost parts of 1 N (1 N·m) along each axis."""
    task = analysis.task
    columns = [("requested", "l", "70px"), *((name, "", "") for name in task.components)]
    requested = (f"{name} 1 {unit}" for name, unit in zip(task.components, task.units, strict=True))
    kept = (force.after for force, _ in analysis.unit_forces)
    rows = [
        _force_row([name], np.full(task.m, np.nan) if after is None else after)
        for name, after in zip(requested, kept, strict=True)
    ]
    return table(columns, rows, "forces")
