"""Tables of the failure-tolerant workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.report import text
from ftforce.report.reach import amount_of, critical_joints, limits_in_words, reach_sentence
from ftforce.show.tables.parts import arm_facts, facts, listing, spaced, warning_lines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.planning.reach import FailureTolerantWorkspace
    from ftforce.show.tables.parts import TitledTable


def reach_view(found: FailureTolerantWorkspace) -> RenderableType:
    """Return the tables of a failure-tolerant workspace.

    Parameters
    ----------
    found :
        The workspace.
    """
    return spaced(
        facts(_situation(found)),
        _volumes(found),
        _joints(found),
        warning_lines(found.warnings),
        Text(reach_sentence(found), style="bold"),
    )


def _situation(found: FailureTolerantWorkspace) -> list[tuple[str, str]]:
    robot = found.robot
    plane = "".join("xyz"[i] for i in found.rows)
    where = "in space" if found.m == 3 else f"in the plane {plane}"
    cells = " × ".join(f"{count}" for count in found.tolerated.shape)
    lines = [
        *arm_facts(robot.name, robot),
        ("Joints", robot.numbered()),
        ("Tip point", f"{where}, in root axes; the tip may turn"),
        ("Faults", "one joint locks, anywhere within its limits before the fault"),
        ("Limits", limits_in_words(found)),
        ("Cells", f"{cells} of {found.edge:g} m"),
    ]
    if found.around is not None:
        low, high = (text.vector_in_words(end) for end in found.around)
        lines.insert(-1, ("Around", f"the box from {low} to {high} m"))
    return lines


def _volumes(found: FailureTolerantWorkspace) -> TitledTable:
    shown = amount_of(found)
    rows = (
        ("by the healthy arm", found.healthy_inner, found.healthy_estimate, found.healthy_outer),
        ("whichever joint locks", found.inner, found.estimate, found.outer),
    )

    what = "Volume" if found.m == 3 else "Area"

    def cells(row: tuple[str, float, float, float]) -> Iterator[tuple[str, str]]:
        yield "", row[0]
        for name, value in zip(("proved", "estimate", "at most"), row[1:], strict=True):
            yield f"{name} [{found.unit}]", shown(value)

    result = listing(f"{what} reached", [cells(row) for row in rows], left=1)
    result.caption = "proved: every point of the cells; estimate: their middles"
    return result


def _joints(found: FailureTolerantWorkspace) -> TitledTable:
    order, shown = critical_joints(found), amount_of(found)
    rows = [_joint(found, i, shown(float(found.lost_by[i]))) for i in order]
    result = listing("Joints, those first whose lock costs most", rows, left=2, folded=(1,))
    if found.moving < found.robot.n:
        names = text.joined(found.robot.names[found.moving :])
        result.caption = f"the tip point lies on the axis of {names}: a lock costs nothing"
    return result


def _joint(found: FailureTolerantWorkspace, i: int, lost: str) -> Iterator[tuple[str, str]]:
    robot = found.robot
    low, high = found.ranges.swept[i].tolist()
    yield "", str(i + 1)
    yield "joint", robot.names[i]
    yield "unit", robot.units[i]
    yield "lower", f"{low:.3f}"
    yield "upper", f"{high:.3f}"
    yield f"excluded by its lock [{found.unit}]", lost
