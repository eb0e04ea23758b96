"""Warnings about analyses of a single posture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.limits_files import URDF
from ftforce.core.faults import FaultMode
from ftforce.errors import listed
from ftforce.robot.dynamics import weight_torque
from ftforce.robot.kinematics import reach_bound
from ftforce.robot.posture import samples

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ftforce.analysis.conditions import Conditions
    from ftforce.analysis.question import Question
    from ftforce.core.arrays import Vector
    from ftforce.core.changes import RneaChange
    from ftforce.core.faults import FaultSet
    from ftforce.core.limits import Limits
    from ftforce.core.reduced_jacobian import ReducedJacobian
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot

_SLACK = 1e-9  # relative; allows for rounding error
# Longest industrial arms reach 4.7 m; the arms of shuttle and space station 10 to 17 m.
_SPACE_ARM = 5.0  # m
_OVERLOADED = 2.0  # weight over effort limit, in
_MOST_POSTURES = 0.75  # of the sample postures: some nearly balance any arm


def lacking_rank(reduced: ReducedJacobian, task: Task) -> Iterator[str]:
    """Warn if the task Jacobian of the healthy arm is rank deficient.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    task :
        The task.
    """
    if reduced.rank < reduced.m:
        yield (
            f"the Jacobian of the healthy arm has only rank {reduced.rank} of {reduced.m} for the "
            f"task '{task}' in this posture"
        )


def missing_masses(rnea: RneaChange) -> Iterator[str]:
    """Warn if gravity torques, or gravity and motion torques, are unknown."""
    if not rnea.is_known:
        what = "gravity torques"
        if rnea.motion_before is None:
            what = "gravity and motion torques"
        yield f"the URDF has no masses: {what} of the arm are not included"


def implausible(question: Question, *, needs_gravity: bool, needs_inertia: bool) -> Iterator[str]:
    """Warn about numbers of the URDF that no real arm has, where the answer depends on them.

    Parameters
    ----------
    question :
        The question.
    needs_gravity :
        Whether the answer depends on gravity torques.
    needs_inertia :
        Whether it depends on the arm's inertia.
    """
    found, limits = question.robot.implausible, question.limits
    if limits is not None:
        yield from found.efforts if limits.source == URDF else limits.notes
    if question.conditions.drives is not None:
        yield from question.conditions.drives.warnings()
    if needs_inertia or (needs_gravity and question.conditions.gravity.any()):
        yield from found.masses
        yield from space_arm(question.robot, question.conditions)
    if needs_inertia:
        yield from found.inertias


def space_arm(robot: Robot, conditions: Conditions) -> Iterator[str]:
    """Propose weightlessness for an arm as long as those in space that cannot hold itself.

    Parameters
    ----------
    robot :
        The arm.
    conditions :
        Its loads; gravity that the caller gave is meant.
    """
    g, (_, reach) = conditions.gravity, reach_bound(robot)
    known = ~np.isnan(robot.effort)
    if not (_SPACE_ARM < reach < np.inf and conditions.is_model_gravity and known.any()):
        return
    weights = np.array([np.abs(weight_torque(robot, q, g)) for q in samples(robot)])
    excess = (weights[:, known] / robot.effort[known]).max(axis=1)
    if np.mean(excess > _OVERLOADED) >= _MOST_POSTURES:
        yield (
            f"this arm is up to {reach:.3g} m long and cannot hold its own weight, which in the "
            f"median posture is {np.median(excess):.2g} times an effort limit; if it works in "
            "space, use gravity 0,0,0 (--gravity 0,0,0)"
        )


def unknown_impact(faults: FaultSet) -> Iterator[str]:
    """Warn that velocities immediately after locking are unknown without valid masses."""
    if faults.in_mode(FaultMode.LOCKED):
        yield (
            "masses or inertias in the URDF are missing or unphysical: the velocities immediately "
            "after locking are unknown"
        )


def beyond_limits(robot: Robot, faults: FaultSet, needed: Vector | None) -> Iterator[str]:
    """Warn about weak joints and overloaded motors when no limits are in force.

    Parameters
    ----------
    robot :
        The arm.
    faults :
        The fault set.
    needed :
        Motor torques after the fault, N·m (N), shape (n,); ``None`` if there is no equilibrium.
    """
    yield from unjudged(robot, faults, None)
    if needed is None:
        return
    for joint, value in zip(robot.joints, needed.tolist(), strict=True):
        if joint.effort is not None and abs(value) > joint.effort * (1.0 + _SLACK):
            yield (
                f"joint {joint.number} {joint.name} would need "
                f"{abs(value) / joint.effort:.0%} of its effort limit of "
                f"{joint.effort:g} {joint.torque_unit} (limits are not enforced)"
            )


def unjudged(robot: Robot, faults: FaultSet, limits: Limits | None) -> Iterator[str]:
    """Warn about weak joints whose limit is unknown or not in force.

    Parameters
    ----------
    robot :
        The arm.
    faults :
        The fault set.
    limits :
        Torque limits in force; ``None`` if none.
    """
    for fault in faults.faults:
        if fault.mode is not FaultMode.WEAK or fault.is_free:
            continue
        name = f"joint {fault.joint + 1} {robot.names[fault.joint]} is weak, but"
        if limits is None:
            yield f"{name} no limits are enforced: it is treated as healthy"
        elif not limits.is_known[fault.joint]:
            yield f"{name} its torque limit is unknown and is not enforced"


def overload(robot: Robot, joints: Iterable[int]) -> Iterator[str]:
    """Warn about joints that gravity and motion torques alone overload.

    Parameters
    ----------
    robot :
        The arm.
    joints :
        Indices of the overloaded joints, from 0.
    """
    if names := [robot.names[j] for j in joints]:
        yield (
            f"gravity and motion torques alone overload {listed(names)}: only the tip force keeps "
            "the arm in equilibrium"
        )
