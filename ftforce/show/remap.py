"""Tables of a remap that was computed from arrays alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ftforce.report.text import number
from ftforce.show.tables.parts import facts, spaced, state_text, table

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.core.remap import Remap


def remap_view(result: Remap) -> RenderableType:
    """Return the tables of a remap of the array core; joints and rows count from 0 as arrays do."""
    joints = table("Torque remap", "column", "state", "before", "after", "brake load", left=2)
    columns = (result.tau, result.U, result.brake_load)
    locked = result.reduced.locked.tolist()
    for i, failed in enumerate(locked):
        values = [number(float(x[i]), 4) for x in columns]
        joints.add_row(str(i), state_text(failed), *(values if failed else [*values[:2], ""]))
    force = table("Force", "row", "before", "after", "jump")
    for i in range(result.reduced.m):
        cells = (number(float(x[i]), 4) for x in (result.F, result.F_after, result.jump))
        force.add_row(str(i), *cells)
    norm = facts([("Jump norm", number(result.jump_norm, 4))])
    return spaced(joints, force, norm)
