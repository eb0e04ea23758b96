"""Cells of a timeline whose answer depends on no tolerance: thousands of instants at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.faults import FaultMode
from ftforce.core.limits import middle_and_half
from ftforce.core.stacked_limits import within_limits
from ftforce.core.stacks import cells_of, reach_of
from ftforce.robot.dynamics import rnea_torques
from ftforce.robot.kinematics import frame_jacobians

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ftforce.analysis.question import Question
    from ftforce.core.arrays import Mask, Matrix
    from ftforce.core.faults import FaultSet
    from ftforce.core.limits import Limits
    from ftforce.trajectory.reference import Motion

_FLOOR = 1e-6  # of the six-row Jacobian: a smaller task Jacobian may be rounding error


class Certain(NamedTuple):
    """Values of S fault sets at N instants, valid where ``known``; each of shape (N, S).

    Attributes
    ----------
    known :
        Where the values are valid.
    jump, margin, capability, held, verdict :
        As in `ftforce.trajectory.timeline.Timeline`.
    """

    known: Mask
    jump: Matrix
    margin: Matrix
    capability: Matrix
    held: Matrix
    verdict: NDArray[np.int8]


def certain_cells(
    question: Question, motion: Motion, sets: Sequence[FaultSet], capability_limits: Limits | None
) -> Certain | None:
    """Return the cells that no tolerance decides; ``None`` with free-swinging joints.

    Parameters
    ----------
    question :
        What is asked at every instant.
    motion :
        Joint positions, velocities and accelerations, each of shape (N, n).
    sets :
        The fault sets.
    capability_limits :
        Torque limits of the capability; ``None`` for none.
    """
    locks = all(fault.mode is FaultMode.LOCKED for faults in sets for fault in faults.faults)
    if not locks:
        return None
    robot, task, F, d = question.robot, question.task, question.F, question.direction
    locked = np.array([faults.mask(robot.n) for faults in sets])
    whole = question.scale.weigh_jacobian(frame_jacobians(robot, motion.q, task.axes))
    J = task.weigh_jacobian(whole[:, task.rows])
    along = None if d is None else task.weigh_force(d)
    cells = cells_of(J, locked, F, along, rtol=question.rtol, wary=question.wary)
    floor = _FLOOR * np.linalg.norm(whole, axis=(1, 2))
    rnea = np.zeros((len(J), 1, robot.n))
    if capability_limits is not None or question.limits is not None:
        rnea = _torques(question, motion, locked)
    tolerances = {"rtol": question.rtol, "wary": question.wary}
    if question.limits is not None:
        middle, largest = _limits(question, motion, sets, question.limits)
        cells = within_limits(
            cells, J, rnea, largest, locked=locked, F=F, middle=middle, **tolerances
        )
    jump = np.full(cells.certain.shape, np.nan)
    if F is not None:
        rows = list(task.force_rows or task.moment_rows)
        jump = np.linalg.norm(task.unweigh_force(cells.jump)[..., rows], axis=2)
    largest, middle = np.full(locked.shape, np.nan), np.zeros(locked.shape)
    if capability_limits is not None:
        middle, largest = _limits(question, motion, sets, capability_limits)
    unit = task.weighted_unit if d is None else 1.0
    commanded, held = reach_of(
        J, rnea, largest, direction=along, cells=cells, rtol=question.rtol, middle=middle
    )
    return Certain(
        cells.certain & (cells.scale > floor)[:, None],
        jump,
        cells.margin,
        commanded * unit,
        held * unit,
        cells.verdict,
    )


def _limits(
    question: Question, motion: Motion, sets: Sequence[FaultSet], limits: Limits
) -> tuple[Matrix, Matrix]:
    """Return the middles and half widths of the weighted limits with each set, shape (S, n).

    With torque-speed lines they follow the motion: shape (N, S, n).
    """
    bounds = (np.array(limits.bounds_after(faults, motion.v)) for faults in sets)
    pairs = [middle_and_half(question.scale.weigh_torque(both)) for both in bounds]
    middles, halves = zip(*pairs, strict=True)
    return np.stack(middles, axis=-2), np.stack(halves, axis=-2)


def _torques(question: Question, motion: Motion, locked: Mask) -> NDArray[np.float64]:
    """Return the weighted torques after the faults, shape (N, S, n); (N, 1, n) at rest."""
    robot, conditions = question.robot, question.conditions
    own = None if conditions.is_model_gravity else conditions.gravity
    keep = ~locked if motion.v.any() or motion.a.any() else np.zeros((1, robot.n))
    q = np.repeat(motion.q, len(keep), axis=0)
    v, a = ((x[:, None] * keep).reshape(q.shape) for x in motion[1:])  # 0 where locked
    found = rnea_torques(
        robot, q, v, a, gravity=own, payload=conditions.payload, drives=conditions.terms
    )
    return question.scale.weigh_torque(found.reshape(len(motion.q), len(keep), robot.n))
