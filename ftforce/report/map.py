"""Workspace maps as text, JSON and table rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ftforce.batch.summary.cells import AXES, depth_axis
from ftforce.report import text
from ftforce.report.parts import Document, Row, finite, listed, setting_part
from ftforce.report.text import percent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.batch.result import Sweep
    from ftforce.batch.summary.cells import Flat, Located
    from ftforce.batch.workspace_map import WorkspaceMap

_FAIL = {"locked": "locked", "free": "swinging free"}
_FAILS = {"locked": ("locks", "lock"), "free": ("swings free", "swing free")}


def faults_in_words(sweep: Sweep, joints: tuple[int, ...] | None) -> str:
    """Describe the faults that a map covers."""
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
    """Describe how a map treats the axis normal to its plane."""
    name = AXES[depth_axis(flat.plane)]
    if found.at is None:
        return f"{flat.plane} plane, all {name} pooled"
    low, high = (metres(x) for x in flat.depth)
    return f"slice {name} = {low} to {high} m"


def cells_in_words(found: WorkspaceMap, flat: Flat) -> str:
    """Describe how a map treats the axis normal to its plane, and its cell size."""
    return f"{depth_in_words(found, flat)}, cells of {found.sweep.summary.workspace.edge:g} m"


def metres(x: float) -> str:
    """Format a coordinate in m."""
    return f"{x:.4g}".replace("-", "−") if abs(x) > 1e-9 else "0"


def map_sentence(found: WorkspaceMap) -> str:
    """Describe how many postures tolerate the faults, and where the fewest do."""
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


EVERY = "every"
"""Table label of the postures that tolerate every fault set of the sweep."""


def map_document(found: WorkspaceMap) -> Document:
    """Return the occupied cells of a map as a JSON document, with the results of all fault sets."""
    sweep = found.sweep
    setting, located = sweep.setting, found.located
    return {
        "robot": setting_part(setting),
        "conventions": {
            "axes": setting.axes,
            "task": setting.task,
            "components": list(setting.components),
            "sign": text.SIGN,
            "units": {"place": "m", "force": "N (N·m)"},
            "place": "middle of a cell, in the root's axes",
            "intervals": "95 %",
        },
        "postures": {"count": setting.count, "done": sweep.done, "random": setting.is_random},
        "mode": setting.mode,
        "force": listed(setting.force),
        "plane": found.plane,
        "at": found.at,
        "edge": located.edge,
        "cells": {
            "place": located.place.tolist(),
            "postures": located.cells.postures.tolist(),
        },
        "sets": [
            {
                "joints": None if joints is None else [setting.joints[i - 1] for i in joints],
                "tolerated": one.cells.tolerated.tolist(),
                "share": one.cells.share.tolist(),
                "low": one.cells.low.tolist(),
                "high": one.cells.high.tolist(),
            }
            for joints, one in _each(found)
        ],
        "stored": sweep.path,
        "summary": map_sentence(found),
        "warnings": list(found.warnings),
    }


def map_rows(found: WorkspaceMap) -> list[Row]:
    """Return a map as table rows, header first: one per fault set and occupied cell."""
    mode = "locked" if found.sweep.setting.mode == "locked" else "free"
    lengths = (f"{name} [m]" for name in (*AXES, "edge"))
    header: Row = ("fault_set", mode, *lengths, *found.located.cells._fields)
    names, rows = found.sweep.setting.joints, [header]
    for joints, one in _each(found):
        faults, which = EVERY, ""
        if joints is not None:
            faults = text.set_of(i - 1 for i in joints)
            which = " ".join(names[i - 1] for i in joints)
        for place, *counts in zip(one.place.tolist(), *one.cells, strict=True):
            rows.append((faults, which, *place, one.edge, *map(_plain, counts)))
    return rows


def _plain(x: Any) -> int | float | None:
    value: int | float = x.item()
    return value if isinstance(value, int) else finite(value)


def _each(found: WorkspaceMap) -> Iterator[tuple[tuple[int, ...] | None, Located]]:
    """Yield the selected fault set; if none is selected, all sets together, then each one."""
    yield found.joints, found.located
    if found.joints is None:
        for one in found.sweep.sets:
            joints = tuple(i + 1 for i in one.joints)
            yield joints, found.located_of(joints)
