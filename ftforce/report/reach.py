"""Bounds on the failure-tolerant workspace as text, JSON and table rows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.planning.reach import KEPT, LOST
from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, constants, document, whole
from ftforce.report.text import number, size

if TYPE_CHECKING:
    from ftforce.planning.reach import Reach

_AXES = "xyz"
STATES = ("no", "open", "yes")
"""What a cell is shown to be, by its state."""


def limits_in_words(found: Reach) -> str:
    """Say which limits hold before and after the fault."""
    before = "chosen here (softened)" if found.softened else found.ranges.source
    after = "the arm's own" if found.release else "the same"
    return f"before the fault: {before}; after it: {after}"


def reach_sentence(found: Reach) -> str:
    """Say how much of the reach tolerates a lock of any joint."""
    low, high = (size(x, 3) for x in (found.inner, found.outer))
    healthy = f"{size(found.healthy_inner, 3)} to {size(found.healthy_outer, 3)} {found.unit}"
    if found.outer == 0.0:
        return (
            f"No point is reached whichever joint locks anywhere within the limits, of {healthy} "
            "that the healthy arm reaches."
        )
    least, most = (100.0 * x for x in found.share)
    share = "" if math.isnan(most) else f", {number(least, 1)} to {number(most, 1)} % of its reach"
    return (
        f"Between {low} and {high} {found.unit}{share}, are reached whichever joint locks anywhere "
        f"within the limits; the healthy arm reaches {healthy}."
    )


def _cells(found: Reach) -> Any:
    chosen = found.healthy != LOST
    return {
        "place": found.places(chosen),
        "healthy": [STATES[i] for i in found.healthy[chosen].tolist()],
        "tolerated": [STATES[i] for i in found.tolerated[chosen].tolist()],
    }


def _of(key: str) -> Any:
    return lambda values: values[key]


# fmt: off
_SIDES = (
    Field("lower", "lower limit", "rad, m", get=_of("lower")),
    Field("upper", "upper limit", "rad, m", get=_of("upper")),
)
REACH = (
    parts.ROBOT,
    Field("conventions", "conventions of the document", get=whole, parts=(
        Field("task", "`force` for points in space, or the two components of a plane"),
        Field("unit", "unit of the volumes"),
        *constants({
            "place": "middle of a cell, in the root's axes",
            "inner": "every point of these cells is shown to be tolerated",
            "outer": "no point of any other cell is tolerated, which is shown too",
            "collisions": "not checked",
        }),
    )),
    Field("mode", "`locked`", get=lambda _: "locked"),
    Field("faults", "joints that lock at a time", get=lambda _: 1),
    Field("release", "whether the arm's own limits hold after the fault"),
    Field("softened", "whether the limits were chosen by ftforce"),
    Field("around", "box for which they were chosen, lower and upper corner; `null` without one",
        "m", "2 × m"),
    Field("limits", "limits before the fault", shape="by joint", get=lambda one: {
        name: {"lower": low, "upper": high} for name, (low, high) in one.ranges.by_joint.items()
    }),
    Field("limits_source", "where these limits come from", get="ranges.source"),
    Field("reach", "what the tip reaches", get=whole, parts=(
        Field("healthy", "shown to be reached by the healthy arm", "m³, m²",
            get="healthy_inner"),
        Field("healthy_outer", "not shown to be beyond its reach", "m³, m²"),
        Field("inner", "shown to be reached whichever joint locks", "m³, m²"),
        Field("outer", "not shown to be lost to a lock", "m³, m²"),
        Field("share", "least and largest share of the healthy reach", "1", "2"),
        Field("is_whole", "whether the search was finished; the bounds hold if not"),
    )),
    Field("lost_by", "volume of the healthy arm's cells that a lock of the joint is shown to cost",
        "m³, m²", "by joint"),
    Field("edge", "edge of a cell", "m"),
    Field("cells", "the cells that the healthy arm may reach", get=_cells, parts=(
        Field("place", "middles", "m", "c × m", _of("place")),
        Field("healthy", "`yes`: reached, as is shown; `open`: not shown", shape="c",
            get=_of("healthy")),
        Field("tolerated", "`yes`: reached whichever joint locks, as is shown; `no`: not, as is "
            "shown; `open`: neither is shown", shape="c", get=_of("tolerated")),
    )),
    Field("summary", "a sentence", get=reach_sentence),
    parts.WARNINGS,
)
# fmt: on


def reach_document(found: Reach) -> Document:
    """Return the bounds as a JSON document."""
    return document(REACH, found, found.robot.names)


def reach_columns() -> tuple[Field, ...]:
    """Return the CSV columns; a planar arm has two coordinates."""
    return (
        *(Field(axis, "middle of the cell, in the root's axes", "m") for axis in _AXES),
        Field("edge", "edge of a cell", "m"),
        Field("healthy", "`yes` or `open`, as in JSON"),
        Field("tolerated", "`yes`, `open` or `no`, as in JSON"),
    )


def reach_rows(found: Reach) -> list[Row]:
    """Return the cells that the healthy arm may reach as table rows, header first."""
    axes = {_AXES[i] for i in found.rows}
    columns = [one for one in reach_columns() if one.key not in set(_AXES) - axes]
    rows: list[Row] = [tuple(one.heading for one in columns)]
    cells = _cells(found)
    rows += [
        (*place, found.edge, healthy, tolerated)
        for place, healthy, tolerated in zip(
            cells["place"].tolist(), cells["healthy"], cells["tolerated"], strict=True
        )
    ]
    return rows


def layer_at(found: Reach, axis: int, at: float) -> int:
    """Return the layer of cells that holds a position along a coordinate."""
    count = found.tolerated.shape[axis]
    layer = math.floor((at - float(found.origin[axis])) / found.edge + 1e-9)
    return min(max(layer, 0), count - 1)


def critical_joints(found: Reach) -> list[int]:
    """Return the joints that move the tip, those whose lock costs most first."""
    order = np.argsort(-found.lost_by[: found.moving], kind="stable")
    return [int(i) for i in order]


def kept_at(found: Reach, point: Any) -> bool:
    """Return whether a point is in a cell that is shown to be tolerated."""
    return found.state_at(point) == KEPT
