"""Friction of free-swinging joints that an answer relies on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.report.text import joined, ratio

if TYPE_CHECKING:
    from ftforce.analysis.analyze import Analysis
    from ftforce.core.arrays import Vector

_NOTHING = 1e-6  # of what friction can bear: rounding errors of the URDF, not worth a word
_LEAST = 1e-9  # N·m (N): smaller torques would be printed as 0


def torque_at(analysis: Analysis, weighted: Vector) -> list[float]:
    """Return torques at the free-swinging joints, N·m (N), from weighted ones, shape (f,)."""
    torque = np.zeros(analysis.robot.n)
    joints = analysis.faults.free
    torque[list(joints)] = weighted
    return [float(x) for x in analysis.scale.unweigh_torque(torque)[list(joints)]]


def friction_borne(analysis: Analysis) -> dict[int, dict[str, Any]]:
    """Return what friction bears at free-swinging joints: torque, limit and source, by joint."""
    bounded = analysis.bounded
    if bounded is None or bounded.F_after is None or bounded.feasible.bearings is None:
        return {}
    bearings, sources = bounded.feasible.bearings, analysis.question.friction.sources
    torques = torque_at(analysis, bearings.torque(bounded.F_after))
    limits = torque_at(analysis, bearings.friction)
    return {
        j: {"torque": x, "limit": most, "source": sources[j]}
        for j, x, most in zip(bearings.joints, torques, limits, strict=True)
        if not bearings.is_ideal and abs(x) > max(_NOTHING * most, _LEAST)
    }


def reliance_in_words(analysis: Analysis) -> str:
    """Return which friction an answer relies on; empty if on none."""
    joints, parts = analysis.robot.joints, []
    for j, one in friction_borne(analysis).items():
        torque = f"{ratio(abs(one['torque']))} {joints[j].torque_unit}"
        parts.append(f"{torque} of friction in {joints[j].name}")
    return f"{joined(parts)} hold{'s' if len(parts) == 1 else ''} it" if parts else ""
