"""What a posture or a path is chosen for: a measure of what every fault set leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.limits_files import URDF
from ftforce.analysis.question import AllFaultSets, Question
from ftforce.core.arrays import norm
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.feasible_forces import LockModel
from ftforce.core.task import Task
from ftforce.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.batch.numpy_path import NumpyEvaluator
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot


class Measure(NamedTuple):
    """A measure that can be made as large, or as small, as possible.

    Attributes
    ----------
    words :
        What it is.
    unit :
        Its unit; empty for none.
    is_cost :
        Whether less of it is better.
    """

    words: str
    unit: str
    is_cost: bool = False


MEASURES = {
    "margin": Measure("margin σ_min(K)/σ_max(J)", ""),
    "rho": Measure("relative manipulability ρ", ""),
    "capability": Measure("largest force along the direction", "N"),
    "payload": Measure("largest payload, its centre at the tip", "kg"),
    "jump": Measure("force jump ‖ΔF‖", "N", is_cost=True),
}


@dataclass(frozen=True, eq=False)
class Objective:
    """The measure that is maximised over the worst fault set.

    Attributes
    ----------
    name :
        One of ``MEASURES``.
    question :
        What is asked about the arm; of a payload, the force that carries it.
    sets :
        The fault sets.
    """

    name: str
    question: Question
    sets: tuple[FaultSet, ...]

    @classmethod
    def parse(
        cls, robot: Robot, name: str, all_sets: AllFaultSets, *, limits: Any = None, **asked: Any
    ) -> Objective:
        """Return the objective that the arguments of `ftforce.best_posture` name.

        Parameters
        ----------
        robot, name, all_sets :
            The arm, the measure, and the fault sets.
        limits :
            Torque limits of capability and payload; by default those of the URDF.
        asked :
            Further arguments of `Question.parse`.

        Raises
        ------
        InputError
            The measure is unknown, or needs a force, a direction, limits or gravity that is not
            there.
        """
        if not isinstance(name, str) or name not in MEASURES:
            raise UnknownNameError("measure to maximize", name, tuple(MEASURES))
        needs_limits = name in {"capability", "payload"}
        known = URDF if limits is None and needs_limits else limits
        question = Question.parse(robot, limits=known, **asked)
        if name == "jump":
            if question.force is None or not question.force.any():
                raise InputError("the jump is that of a force: give one (force, --force)")
            question = replace(question, direction=None)
        elif name == "capability":
            direction = question.direction_or_that_of(question.F)
            if direction is None:
                raise InputError("the capability needs a direction or a force along which it acts")
            question = replace(question, direction=direction)
        elif name == "payload":
            question = _carrying(question)
        else:
            question = replace(question, direction=None)
        if needs_limits and question.limits is None:
            raise InputError(f"the {name} is bounded by torque limits: there must be some (limits)")
        return cls(name, question, tuple(all_sets))

    @property
    def measure(self) -> Measure:
        """What is maximised."""
        return MEASURES[self.name]

    @property
    def unit(self) -> str:
        """Unit of the values, empty for none."""
        is_size = self.name in {"capability", "jump"}
        return self.question.task.size_unit if is_size else self.measure.unit

    @cached_property
    def _evaluator(self) -> NumpyEvaluator:
        from ftforce.batch.numpy_path import NumpyEvaluator
        from ftforce.batch.plan import Plan

        has_free = any(one.in_mode(FaultMode.FREE) for one in self.sets)
        has_limits = self.question.direction is not None
        plan = Plan.of(self.question, self.sets, needs_gravity=has_free or has_limits)
        # A payload is held: brakes carry their share of it (theory §5).
        lock = LockModel.HELD if self.name == "payload" else LockModel.COMMANDED
        return NumpyEvaluator(plan, lock)

    def measured(self, q: Matrix) -> Matrix:
        """Return the measure after every fault set, in its unit, shape (k, S).

        A capability of 0 stands for an arm that cannot be held, and a jump of that of the whole
        force.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        """
        block = self._evaluator(np.ascontiguousarray(q))
        if self.name in {"margin", "rho"}:
            found = block.margin if self.name == "margin" else block.rho
            return np.nan_to_num(found.T, nan=0.0)
        if self.name == "jump":
            assert block.jump is not None
            assert self.question.F is not None
            return np.nan_to_num(block.jump.T, nan=norm(self.question.F))
        assert block.capability is not None
        found = np.nan_to_num(block.capability.T, nan=0.0, posinf=np.inf)
        if self.name == "payload":
            found = found / norm(self.question.conditions.gravity)
        return found

    def values(self, q: Matrix) -> Vector:
        """Return what is maximised: the measure after the worst set, negated if less is better.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        """
        found = self.measured(q)
        worst: Vector = -found.max(axis=1) if self.measure.is_cost else found.min(axis=1)
        return worst

    def worst_sets(self, q: Matrix) -> NDArray[np.intp]:
        """Return the index of the worst set in each posture, shape (k,).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        """
        found = self.measured(q)
        worst: NDArray[np.intp] = (found if self.measure.is_cost else -found).argmax(axis=1)
        return worst


def _carrying(question: Question) -> Question:
    """Return the question of the force that carries a payload, against gravity in root axes."""
    gravity = question.conditions.gravity
    if not gravity.any():
        raise InputError("a payload weighs nothing without gravity; maximize the capability")
    task = Task(("fx", "fy", "fz"), "world")
    return replace(question, task=task, force=None, direction=-gravity / norm(gravity))
