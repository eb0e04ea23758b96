"""Maps of a sweep's workspace in plain words, for tables, pictures and files alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ftforce.batch.summary.cells import AXES, depth_axis
from ftforce.report.text import percent

if TYPE_CHECKING:
    from ftforce.batch.result import Sweep
    from ftforce.batch.summary.cells import Flat
    from ftforce.batch.workspace_map import WorkspaceMap

_FAIL = {"locked": "locked", "free": "swinging free"}
_FAILS = {"locked": ("locks", "lock"), "free": ("swings free", "swing free")}


def faults_in_words(sweep: Sweep, joints: tuple[int, ...] | None) -> str:
    """Say which faults a map is about."""
    setting = sweep.setting
    if joints is not None:
        how = _FAIL[setting.mode]
        if len(joints) == 1:
            return f"joint {joints[0]} ({setting.joints[joints[0] - 1]}) {how}"
        return f"joints {', '.join(map(str, joints[:-1]))} and {joints[-1]} {how}"
    if setting.largest == 1:
        return f"whichever joint {_FAILS[setting.mode][0]}"
    between = "or" if setting.largest == 2 else "to"
    return f"whichever 1 {between} {setting.largest} joints {_FAILS[setting.mode][1]}"


def depth_in_words(found: WorkspaceMap, flat: Flat) -> str:
    """Say what a map shows of the axis that it lacks."""
    name = AXES[depth_axis(flat.plane)]
    if found.at is None:
        return f"{flat.plane} plane, all {name} pooled"
    low, high = (metres(x) for x in flat.depth)
    return f"slice {name} = {low} to {high} m"


def cells_in_words(found: WorkspaceMap, flat: Flat) -> str:
    """Say what a map shows of the axis that it lacks, and how large its cells are."""
    return f"{depth_in_words(found, flat)}, cells of {found.sweep.summary.workspace.edge:g} m"


def metres(x: float) -> str:
    """Write a position."""
    return f"{x:.4g}".replace("-", "−") if abs(x) > 1e-9 else "0"


def map_sentence(found: WorkspaceMap) -> str:
    """Say how much of what is looked at survives, and where it is worst."""
    grid = found.located.cells
    postures, tolerated = int(grid.postures.sum()), int(grid.tolerated.sum())
    where = "" if found.plane is None or found.at is None else " of the slice"
    faults = faults_in_words(found.sweep, found.joints)
    whole = f"{percent(tolerated / postures)} of {postures:,} postures{where} tolerate {faults}"
    if tolerated in {0, postures}:
        return f"{'All' if tolerated else 'None'} of {whole.partition(' of ')[2]}."
    worst = found.worst(1)
    blocks, i = found.blocks, worst[0]
    at = ", ".join(metres(x) for x in blocks.place[i].tolist())
    few = f"{int(blocks.cells.tolerated[i]):,} of {int(blocks.cells.postures[i]):,} do"
    return f"{whole}; fewest in the {blocks.edge:g} m around ({at}) m: {few}."
