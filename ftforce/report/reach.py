"""Bounds on the failure-tolerant workspace as text, JSON and table rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.planning.reach import KEPT, LOST
from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, constants, document, whole

if TYPE_CHECKING:
    from collections.abc import Callable

    from ftforce.planning.reach import FailureTolerantWorkspace

_AXES = "xyz"


def limits_in_words(found: FailureTolerantWorkspace) -> str:
    """Say which limits hold before and after the fault."""
    before = "softened, chosen here" if found.softened else found.ranges.source
    if found.release:
        return f"before the fault: {before}; after it: the arm's own"
    return f"{before}, before the fault and after it"


def reach_sentence(found: FailureTolerantWorkspace) -> str:
    """Say how much of the reach tolerates a lock of any joint."""
    unit, shown = found.unit, amount_of(found)
    healthy = f"of the {shown(found.healthy_estimate)} {unit} that the healthy arm reaches"
    if found.outer == 0.0:
        return f"Nothing {healthy} is left whichever joint locks, anywhere within its limits."
    if found.estimate == 0.0:
        critical = found.robot.names[critical_joints(found)[0]]
        return (
            "No point was found that is reached whichever joint locks, anywhere within its limits, "
            f"{healthy}; at most {shown(found.outer)} {unit} are not excluded. A lock of "
            f"{critical} costs most."
        )
    return (
        f"About {shown(found.estimate)} {unit}, {100.0 * found.share:.3g} % {healthy}, are reached "
        "whichever joint locks, anywhere within its limits: at least "
        f"{shown(found.inner)} {unit}, and at most {shown(found.outer)} {unit}."
    )


def amount_of(found: FailureTolerantWorkspace) -> Callable[[float], str]:
    """Return what formats volumes, with as many decimals for all."""
    decimals = 2 if found.healthy_outer >= 1.0 else 4
    return lambda x: f"{x:.{decimals}f}"


def _estimate_states(found: FailureTolerantWorkspace) -> list[str]:
    chosen = found.healthy != LOST
    kept, middles = found.tolerated[chosen] == KEPT, found.tolerated_middles[chosen]
    lost = found.tolerated[chosen] == LOST
    state = np.where(kept, "yes", np.where(middles, "middle", np.where(lost, "no", "open")))
    return [str(one) for one in state.tolist()]


def _cells(found: FailureTolerantWorkspace) -> Any:
    chosen = found.healthy != LOST
    return {
        "place": found.places(chosen),
        "healthy": found.healthy_middles[chosen].tolist(),
        "tolerated": _estimate_states(found),
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
        Field("healthy", "cells whose middle the healthy arm reaches", "m³, m²",
            get="healthy_estimate"),
        Field("estimate", "cells whose middle is reached whichever joint locks", "m³, m²"),
        Field("inner", "cells of which every point is shown to be", "m³, m²"),
        Field("outer", "cells that are not shown to hold no such point", "m³, m²"),
        Field("share", "`estimate` over `healthy`", "1"),
        Field("healthy_inner", "cells of which the healthy arm is shown to reach every point",
            "m³, m²"),
        Field("healthy_outer", "cells not shown to be beyond its reach", "m³, m²"),
        Field("is_whole", "whether the search was finished; the bounds hold if not"),
    )),
    Field("lost_by", "volume of the healthy arm's cells that a lock of the joint is shown to cost",
        "m³, m²", "by joint"),
    Field("edge", "edge of a cell", "m"),
    Field("cells", "the cells that the healthy arm may reach", get=_cells, parts=(
        Field("place", "middles", "m", "c × m", _of("place")),
        Field("healthy", "whether the healthy arm reaches the middle", shape="c",
            get=_of("healthy")),
        Field("tolerated", "`yes`: every point is reached whichever joint locks; `middle`: the "
            "middle is; `no`: no point is; `open`: neither is shown", shape="c",
            get=_of("tolerated")),
    )),
    Field("summary", "a sentence", get=reach_sentence),
    parts.WARNINGS,
)
# fmt: on


def reach_document(found: FailureTolerantWorkspace) -> Document:
    """Return the bounds as a JSON document."""
    return document(REACH, found, found.robot.names)


def reach_columns() -> tuple[Field, ...]:
    """Return the CSV columns; a planar arm has two coordinates."""
    return (
        *(Field(axis, "middle of the cell, in the root's axes", "m") for axis in _AXES),
        Field("edge", "edge of a cell", "m"),
        Field("healthy", "whether the healthy arm reaches the middle"),
        Field("tolerated", "`yes`, `middle`, `open` or `no`, as in JSON"),
    )


def reach_rows(found: FailureTolerantWorkspace) -> list[Row]:
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


def critical_joints(found: FailureTolerantWorkspace) -> list[int]:
    """Return the joints that move the tip, those whose lock costs most first."""
    order = np.argsort(-found.lost_by[: found.moving], kind="stable")
    return [int(i) for i in order]
