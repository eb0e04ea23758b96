"""Maps of a sweep's workspace as dictionaries and rows: what JSON and CSV hold of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ftforce.batch.summary.cells import AXES
from ftforce.report import text
from ftforce.report.map import map_sentence
from ftforce.report.parts import Document, Row, finite, listed, setting_part

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.batch.summary.cells import Located
    from ftforce.batch.workspace_map import WorkspaceMap

EVERY = "every"
"""How a table names the postures that tolerate every set of the sweep."""


def map_document(found: WorkspaceMap) -> Document:
    """Return a map's cells that hold postures, with what every fault set does to them."""
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
    """Return a map as rows, the header first: one per fault set and cell that holds postures."""
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
    """Yield the set that is looked at; without one every set together, and then each."""
    yield found.joints, found.located
    if found.joints is None:
        for one in found.sweep.sets:
            joints = tuple(i + 1 for i in one.joints)
            yield joints, found.located_of(joints)
