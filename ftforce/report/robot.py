"""Robots and the replication of the paper as JSON and table rows."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING

from ftforce.analysis.paper import ERRATA, Outcome, Replication
from ftforce.report.fields import Document, Field, Row, columns, constants, document, rows_of, whole
from ftforce.report.parts import ARM

if TYPE_CHECKING:
    from ftforce.robot.robot import Robot

# fmt: off
_JOINT_LIMITS = (
    Field("lower", "lower position limit; `null` or empty if unbounded", "rad, m"),
    Field("upper", "upper position limit; likewise", "rad, m"),
    Field("effort", "largest torque; `null` or empty if unknown", "N·m, N"),
    Field("velocity", "largest velocity; likewise", "rad/s, m/s"),
)
ROBOT_FIELDS = (
    *ARM,
    Field("base_source", "why this link is the base"),
    Field("limits", "`lower`, `upper`, `effort`, `velocity`; `null` is unbounded or unknown",
        "rad, m, N·m, N, rad/s, m/s", "by joint",
        lambda robot: {joint.name: document(_JOINT_LIMITS, joint) for joint in robot.joints}),
    Field("followers", "names of the mimic joints that move with it", shape="by joint",
        get=lambda robot: {joint.name: joint.followers for joint in robot.joints}),
    Field("moving_mass", "mass of the chain and of what is fixed to it; `null` if the URDF has "
        "none", "kg", get=lambda robot: robot.mass or None),
    Field("postures", "named postures", "rad, m", "by name, n each"),
    Field("tip_candidates", "number of moving joints above it", shape="by link", get="tips"),
    Field("held", "joints outside the chain and where they are held fixed", "rad, m", "by joint"),
    Field("notes", "sentences", shape="list"),
    Field("units", "units of the document", get=whole, parts=constants(
        {"angle": "rad", "length": "m", "effort": "N·m (N if prismatic)", "mass": "kg"}
    )),
)
ROBOT_COLUMNS = (
    Field("number", "from 1, base to tip"),
    Field("joint", "its name", get="name"),
    Field("type", "`revolute`, `continuous` or `prismatic`"),
    *_JOINT_LIMITS[:2],
    Field("unit", "unit of the limits: `rad` or `m`"),
    _JOINT_LIMITS[2],
    Field("effort_unit", "`N·m` or `N`", get="torque_unit"),
    replace(_JOINT_LIMITS[3], key="speed", get="velocity"),
)

_CHECK = (
    Field("table", "table of the paper"),
    Field("row", "row of the table"),
    Field("column", "column of the table"),
    Field("printed", "text, with all printed digits; empty for another arm"),
    Field("computed", "number in the printed unit, by the formula of the paper"),
    Field("outcome", "`pass`, `erratum` or `fail`; `computed` for another arm"),
)
_ERRATUM = Field("erratum", "the erratum that explains it; `null` or empty if there is none")
REPLICATION = (
    Field("successful", "whether no number fails", get="is_successful"),
    Field("checks", "every printed number", shape="list",
        parts=(*_CHECK, replace(_ERRATUM, get=lambda check: check.erratum or None))),
    Field("errata", "all known errata", shape="list", get=lambda _: ERRATA, parts=(
        Field("where", "place in the paper", get=itemgetter(0)),
        Field("printed", "what is printed there", get=itemgetter(1)),
        Field("correct", "what is correct", get=itemgetter(2)),
    )),
)
# fmt: on
CHECK_COLUMNS = (*_CHECK, _ERRATUM)


def robot_document(robot: Robot) -> Document:
    """Return a robot as a JSON document."""
    return document(ROBOT_FIELDS, robot)


def replication_document(result: Replication) -> Document:
    """Return a replication as a JSON document."""
    return document(REPLICATION, result)


def robot_rows(robot: Robot) -> list[Row]:
    """Return a robot as table rows, one per joint."""
    return rows_of(columns(ROBOT_COLUMNS, joint) for joint in robot.joints)


def robots_rows(robots: list[Robot]) -> list[Row]:
    """Return robots as table rows, one per joint, with the name of its robot."""
    pairs = ((robot, joint) for robot in robots for joint in robot.joints)
    return rows_of({"robot": robot.name} | columns(ROBOT_COLUMNS, joint) for robot, joint in pairs)


def replication_rows(result: Replication) -> list[Row]:
    """Return a replication as table rows, one per printed number."""
    return rows_of(columns(CHECK_COLUMNS, check) for check in result.checks)


def replication_sentence(result: Replication) -> str:
    """Return how many of the paper's numbers are reproduced."""
    counts = {outcome: result.count(outcome) for outcome in Outcome}
    return (
        f"{len(result.checks)} printed numbers: {counts[Outcome.PASS]} pass, "
        f"{counts[Outcome.ERRATUM]} explained by errata, {counts[Outcome.FAIL]} fail."
    )
