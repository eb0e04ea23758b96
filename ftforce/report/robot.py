"""Robots and the replication of the paper as JSON and table rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ftforce.analysis.paper import ERRATA, Replication
from ftforce.report.parts import Document, Row, arm_part, check_part, finite, rows_of

if TYPE_CHECKING:
    from ftforce.robot.robot import Robot


def robot_document(robot: Robot) -> Document:
    """Return a robot as a JSON document."""
    return {
        **arm_part(robot),
        "base_source": robot.base_source,
        "tip_source": robot.tip_source,
        "limits": {
            joint.name: {
                "lower": finite(joint.lower),
                "upper": finite(joint.upper),
                "effort": joint.effort,
                "velocity": joint.velocity,
            }
            for joint in robot.joints
        },
        "followers": {joint.name: list(joint.followers) for joint in robot.joints},
        "moving_mass": robot.mass or None,
        "postures": {name: q.tolist() for name, q in robot.postures.items()},
        "tip_candidates": dict(robot.tips),
        "held": dict(robot.held),
        "notes": list(robot.notes),
        "units": {"angle": "rad", "length": "m", "effort": "N·m (N if prismatic)", "mass": "kg"},
    }


def replication_document(result: Replication) -> Document:
    """Return a replication as a JSON document."""
    return {
        "successful": result.is_successful,
        "checks": [
            {**check_part(check), "erratum": check.erratum or None} for check in result.checks
        ],
        "errata": [
            {"where": where, "printed": printed, "correct": correct}
            for where, printed, correct in ERRATA
        ],
    }


def robot_rows(robot: Robot) -> list[Row]:
    """Return a robot as table rows, one per joint."""
    return rows_of(
        {
            "number": joint.number,
            "joint": joint.name,
            "type": joint.type,
            "lower": finite(joint.lower),
            "upper": finite(joint.upper),
            "unit": joint.unit,
            "effort": joint.effort,
            "effort_unit": joint.torque_unit,
            "speed": joint.velocity,
        }
        for joint in robot.joints
    )


def replication_rows(result: Replication) -> list[Row]:
    """Return a replication as table rows, one per printed number."""
    return rows_of(map(check_part, result.checks))
