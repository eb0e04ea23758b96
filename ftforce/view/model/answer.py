"""The answer to the page's question; the only module that calls `analyze` and `census`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.analyze import (
    Analysis,
    analyze_question,
    limit_of,
    load_without_force,
    shown_limits,
)
from ftforce.analysis.capability import Capability, CapabilityRange, capability_of
from ftforce.analysis.census import Census, census_of
from ftforce.analysis.question import HEALTHY, AllFaultSets
from ftforce.core.feasible_forces import LockModel
from ftforce.errors import FtforceError
from ftforce.report.text import NEGLIGIBLE

if TYPE_CHECKING:
    from ftforce.analysis.question import Question
    from ftforce.core.faults import Fault
    from ftforce.robot.robot import Robot
    from ftforce.view.model.state import State


@dataclass(frozen=True, slots=True)
class JointLoad:
    """The load of one joint before and after the fault; NaN where a value is unknown.

    Attributes
    ----------
    number, name, unit :
        Number along the chain, from 1; name; unit of the torque (N·m, or N if prismatic).
    fault :
        The joint's fault; ``None`` if it is healthy.
    before, after :
        Motor torque, including gravity and inertial terms if the URDF has masses; ``after`` is 0
        for a locked or free joint.
    part_before, part_after :
        Force part JᵀF of the motor torque; 0 if no force is requested.
    brake :
        Brake load; NaN if the joint is not locked.
    limit :
        Torque limit of the motor, or of the brake if the joint is locked.
    used :
        Motor or brake load after the fault, as a share of the limit.
    """

    number: int
    name: str
    unit: str
    fault: Fault | None
    before: float
    after: float
    part_before: float
    part_after: float
    brake: float
    limit: float
    used: float


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The results of `ftforce.analyze` and `ftforce.census` for one question.

    Attributes
    ----------
    state :
        The question.
    analysis :
        The analysis of the fault set.
    census :
        All fault sets of the posture, worst first; ``None`` if not requested.
    census_problem :
        Why a requested census is not available; empty otherwise.
    capability :
        Force capability; ``None`` if nothing shown depends on it.
    loads :
        One load per joint.
    """

    state: State
    analysis: Analysis
    census: Census | None
    census_problem: str
    capability: Capability | None
    loads: tuple[JointLoad, ...]

    @property
    def weakest(self) -> tuple[CapabilityRange, CapabilityRange] | None:
        """Commanded force range in the weakest direction, before and after, if shown."""
        if self.capability is None or not self.state.shown.weakest:
            return None
        found = self.capability.weakest
        return found.before[LockModel.COMMANDED], found.after[LockModel.COMMANDED]


def answer(robot: Robot, state: State, earlier: Answer | None = None) -> Answer:
    """Answer a question.

    Parameters
    ----------
    robot :
        The arm.
    state :
        The question.
    earlier :
        A previous answer for the same arm; its census is reused if it would not change.

    Raises
    ------
    InputError
        The question is malformed.
    """
    analysis = analyze_question(state.question(robot))
    census, problem = _census(state, analysis.question, earlier)
    needs_capability = state.shown.weakest or state.shown.solid == "polytope"
    return Answer(
        state=state,
        analysis=analysis,
        census=census,
        census_problem=problem,
        capability=capability_of(analysis) if needs_capability else None,
        loads=_loads(analysis),
    )


def _census(state: State, question: Question, earlier: Answer | None) -> tuple[Census | None, str]:
    """Return the census, and why it is not available (empty if it is)."""
    if not state.shown.census:
        return None, ""
    if earlier is not None and earlier.state.census_essence() == state.census_essence():
        return earlier.census, earlier.census_problem
    robot, shown = question.robot, state.shown
    try:
        all_sets = AllFaultSets.parse(robot, min(shown.census, robot.n), shown.census_mode)
        # Limits that apply because a joint is weak apply here too.
        found = census_of(replace(question, faults=HEALTHY), all_sets)
    except FtforceError as error:  # the answer for the current fault set is still valid
        return None, str(error)
    return found, ""


def _loads(analysis: Analysis) -> tuple[JointLoad, ...]:
    robot, torque, rnea = analysis.robot, analysis.torque, analysis.rnea
    unknown, nothing = np.full(robot.n, np.nan), np.zeros(robot.n)
    if torque is not None:
        part = torque.before, unknown if torque.after is None else torque.after
        before = torque.before if torque.total_before is None else torque.total_before
        after = part[1] if torque.total_after is None else torque.total_after
        brake = unknown if torque.brake_load is None else torque.brake_load
    else:
        part, before, after, brake = (nothing, nothing), rnea.before, unknown, unknown
        if not rnea.is_known:
            before = unknown
        elif analysis.can_stand_still:
            brake = load_without_force(analysis)
            after = np.where(analysis.reduced.commanding, brake, 0.0)
    limits, faults = shown_limits(analysis), {f.joint: f for f in analysis.faults.faults}
    rows = []
    for i, joint in enumerate(robot.joints):
        is_locked = bool(analysis.reduced.locked[i])
        load = float((brake if is_locked else after)[i])
        limit = limit_of(load, *(float(side[i]) for side in limits))
        rows.append(
            JointLoad(
                number=joint.number,
                name=joint.name,
                unit=joint.torque_unit,
                fault=faults.get(i),
                before=float(before[i]),
                after=float(after[i]),
                part_before=float(part[0][i]),
                part_after=float(part[1][i]),
                brake=load if is_locked else math.nan,
                limit=limit,
                used=_share(load, limit),
            )
        )
    return tuple(rows)


def _share(load: float, limit: float) -> float:
    """Return ``load`` / ``limit``: NaN if the limit is unknown, infinite for a load against 0."""
    if limit == 0.0:
        return math.inf if abs(load) > NEGLIGIBLE else 0.0
    return abs(load) / limit
