"""Workspace maps as text, JSON and table rows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ftforce.batch.summary.cells import AXES, depth_axis
from ftforce.report import parts, text
from ftforce.report.fields import Document, Field, Row, constants, document, plain, under, whole
from ftforce.report.text import percent, share

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.batch.result import Sweep
    from ftforce.batch.summary.cells import Flat, Located
    from ftforce.batch.workspace_map import WorkspaceMap

_FAIL = {"locked": "locked", "free": "free-swinging"}
_FAILS = {"locked": ("locks", "lock"), "free": ("becomes free-swinging", "become free-swinging")}


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
    faults = f"the fault ({faults_in_words(found.sweep, found.joints)})"
    whole = f"{percent(tolerated / postures)} of {postures:,} postures{where} tolerate {faults}"
    if tolerated in {0, postures}:
        return f"{'All' if tolerated else 'None'} of {whole.partition(' of ')[2]}."
    worst = found.worst(1)
    blocks, i = found.blocks, worst[0]
    at = ", ".join(metres(x) for x in blocks.place[i].tolist())
    few = f"{int(blocks.cells.tolerated[i]):,} of {int(blocks.cells.postures[i]):,} do"
    most = share(float(blocks.cells.high[i]))
    surely = f"worst, at most {most}% with 95% confidence, is the {blocks.edge:g} m block at"
    return f"{whole}; {surely} ({at}) m: {few}."


class _Selected(NamedTuple):
    """A fault set and its cells; joints from 0, ``None`` for all sets together."""

    joints: tuple[int, ...] | None
    located: Located


def _selected(found: WorkspaceMap) -> Iterator[_Selected]:
    """Yield the selected fault set; if none is selected, all sets together, then each one."""
    joints = None if found.joints is None else tuple(i - 1 for i in found.joints)
    yield _Selected(joints, found.located)
    for one in found.sweep.sets if joints is None else ():
        yield _Selected(one.joints, found.located_of(tuple(i + 1 for i in one.joints)))


_EVERY = "every"
"""Table label of the postures that tolerate every fault set of the sweep."""


# fmt: off
_CELL = (
    Field("tolerated", "postures that tolerate it"),
    Field("share", "their share", "1"),
    Field("low", "lower end of the 95 % interval of the share", "1"),
    Field("high", "upper end", "1"),
)
_POSTURES = Field("postures", "number of postures")
MAP = (
    Field("robot", "the kinematic chain", get="sweep.setting", parts=parts.SETTING_ARM),
    Field("conventions", "conventions of the document", get="sweep.setting", parts=(
        *parts.SETTING_TASK[:2],
        parts.SETTING_COMPONENTS,
        parts.SIGN,
        Field("units", "units", get=whole, parts=constants({"place": "m", "force": "N (N·m)"})),
        *constants({"place": "middle of a cell, in the root's axes", "intervals": "95 %"}),
    )),
    Field("postures", "the postures of the sweep", get="sweep", parts=parts.SWEEP_POSTURES),
    Field("mode", "`locked` or `free`", get="sweep.setting.mode"),
    Field("force", "requested force; `null` without", parts.FORCE, "m", "sweep.setting.force"),
    Field("plane", "`xy`, `xz` or `yz`; `null` for cells of the whole workspace"),
    Field("at", "position of the slice along the third axis; `null` if all are pooled", "m"),
    Field("edge", "edge length of a cell", "m", get="located.edge"),
    Field("cells", "the cells that contain postures", get="located", parts=(
        Field("place", "middles of the cells, in the axes of the root", "m", "c × 3"),
        replace(_POSTURES, shape="c", get="cells.postures"),
    )),
    Field("sets", "the selected fault set, or all sets together (`joints` is `null`) and then each "
        "one", shape="list", get=_selected, parts=(
        Field("joints", "joints that fail together", shape="names"),
        *under("located.cells", (replace(one, shape="c") for one in _CELL)),
    )),
    Field("stored", "path of the sweep", get="sweep.path"),
    replace(parts.SUMMARY, get=map_sentence),
    parts.WARNINGS,
)
# fmt: on


def map_document(found: WorkspaceMap) -> Document:
    """Return the occupied cells of a map as a JSON document, with the results of all fault sets."""
    return document(MAP, found, found.sweep.setting.joints)


def map_columns(mode: str = "locked") -> tuple[Field, ...]:
    """Return the CSV columns; the names of the failed joints stand in the column of their mode."""
    return (
        Field("fault_set", f"numbers of the failed joints, from 1, or `{_EVERY}`"),
        Field(mode, "names of the failed joints; the column is called `free` in a map of these"),
        *(Field(axis, "middle of the cell, in the axes of the root", "m") for axis in AXES),
        Field("edge", "edge length of a cell", "m"),
        _POSTURES,
        *_CELL,
    )


def map_rows(found: WorkspaceMap) -> list[Row]:
    """Return a map as table rows, header first: one per fault set and occupied cell."""
    names = found.sweep.setting.joints
    rows: list[Row] = [tuple(one.heading for one in map_columns(found.sweep.setting.mode))]
    for joints, one in _selected(found):
        faults = _EVERY if joints is None else text.set_of(joints)
        which = " ".join(names[i] for i in joints or ())
        for place, *counts in zip(one.place.tolist(), *one.cells, strict=True):
            rows.append((faults, which, *place, one.edge, *plain(counts)))
    return rows
