"""Force and payload capability before and after a fault (docs/theory/limits)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.analyze import Analysis, analyze_question
from ftforce.analysis.fault_names import named_faults
from ftforce.analysis.limits_files import URDF
from ftforce.analysis.question import Question, unit_direction
from ftforce.core.arrays import Vector, read_only
from ftforce.core.bounded_remap import overloaded
from ftforce.core.display import Displayed
from ftforce.core.faults import FaultSet
from ftforce.core.feasible_forces import (
    FeasibleForces,
    LimitingFactor,
    LockModel,
    Reach,
    feasible_forces,
    is_beyond_arm,
    limiting_factor,
    reach,
    weakest_direction,
)
from ftforce.core.polytope import Polytope, force_polytope
from ftforce.core.reduced_jacobian import RTOL, reduce, reduce_decomposed
from ftforce.robot.dynamics import Payload, payload_acceleration, payload_jacobian

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.fault_names import Joints, WeakJoints
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.core.reduced_jacobian import ReducedJacobian
    from ftforce.core.task import Axes, Task
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class CapabilityRange:
    """Range of the force or payload that can be held.

    Attributes
    ----------
    direction :
        Direction of the force in task axes, unweighted, shape (m,). Its force components have norm
        1; if there are none, its moments. In the weakest direction the weighted vector has norm 1.
        Empty for a payload.
    maximum :
        Largest value, N (N·m for a pure moment) or kg; infinite if no known limit bounds it, NaN if
        no value can be held.
    minimum :
        Smallest value; nonzero only with free-swinging joints or if weight alone exceeds a limit,
        NaN if no value can be held.
    end :
        What limits the maximum.
    limiting_joints :
        Indices of the joints that limit the maximum.
    """

    direction: Vector
    maximum: float
    minimum: float
    end: LimitingFactor
    limiting_joints: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DirectionReport:
    """Capability in one direction.

    Attributes
    ----------
    name :
        ``+fx``, ``-fx`` …, ``direction`` for the one requested, or ``weakest``.
    unit :
        N, or N·m for a pure moment.
    before, after :
        Ranges before and after the fault, by lock model.
    """

    name: str
    unit: str
    before: dict[LockModel, CapabilityRange]
    after: dict[LockModel, CapabilityRange]


@dataclass(frozen=True, eq=False, repr=False)
class Capability(Displayed):
    """Force and payload that an arm can hold in one posture, before and after a fault.

    Attributes
    ----------
    analysis :
        The underlying analysis, with fault set, posture and limits.
    direction :
        Requested direction in task axes, shape (m,); ``None`` if none was given.
    """

    analysis: Analysis
    direction: Vector | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result."""
        return self.analysis.warnings

    @cached_property
    def directions(self) -> tuple[DirectionReport, ...]:
        """Capability along each task axis in both senses, and in the requested direction."""
        task = self.analysis.task
        asked = [
            (f"{sign}{name}", unit if sign == "+" else -unit)
            for name, unit in zip(task.components, np.eye(task.m), strict=True)
            for sign in "+-"
        ]
        if self.direction is not None:
            asked.append(("direction", self.direction))
        return tuple(self._report(name, vector) for name, vector in asked)

    @cached_property
    def weakest(self) -> DirectionReport:
        """The direction with the smallest weighted force, among those the healthy arm has.

        It depends on the lock model, and differs before and after the fault: see
        `CapabilityRange.direction`.
        """
        reduced, task = self.analysis.reduced, self.analysis.task
        space, unit = reduced.healthy.U[:, : reduced.rank], task.weighted_unit
        found = {}
        for after in (False, True):
            for reading in LockModel:
                feasible = self.feasible(after=after, reading=reading)
                worst = weakest_direction(feasible, space)
                direction = task.unweigh_force(worst.direction) / unit
                failed = self._failed(after, reading)
                beyond = is_beyond_arm(reduced, worst.direction)
                found[after, reading] = _amount(
                    feasible, direction, worst.reach, unit, failed, beyond_arm=beyond
                )
        before, after_ = ({r: found[late, r] for r in LockModel} for late in (False, True))
        return DirectionReport("weakest", "N" if task.force_rows else "N·m", before, after_)

    @cached_property
    def payload(self) -> tuple[CapabilityRange, CapabilityRange]:
        """Additional payload that can be carried before and after the fault, kg.

        A payload is a held load, so locked joints may carry part of its weight.
        """
        return self._payload(after=False), self._payload(after=True)

    def feasible(self, *, after: bool, reading: LockModel = LockModel.COMMANDED) -> FeasibleForces:
        """Return the set of weighted forces that can be held.

        Parameters
        ----------
        after :
            Whether after the fault or before it.
        reading :
            The lock model.
        """
        analysis = self.analysis
        faults = analysis.faults if after else FaultSet()
        reduced = analysis.reduced if after else self._healthy
        rnea = self._rnea(after=after)
        return feasible_forces(reduced, rnea, self._largest(faults), reading)

    def polytope(self, *, after: bool, reading: LockModel | str = LockModel.COMMANDED) -> Polytope:
        """Return the polytope of forces that can be held, in task axes, N (N·m).

        Parameters
        ----------
        after :
            Whether after the fault or before it.
        reading :
            The lock model, ``commanded`` or ``held``.

        Raises
        ------
        InputError
            The arm has too many joints: there are too many half-spaces to intersect.
        """
        feasible = self.feasible(after=after, reading=LockModel.parse(reading))
        return force_polytope(feasible, self.analysis.task.weights)

    @cached_property
    def _healthy(self) -> ReducedJacobian:
        reduced = self.analysis.reduced
        none = FaultSet().mask(self.analysis.robot.n)
        return reduce_decomposed(reduced.healthy, none, reduced.rtol)

    def _report(self, name: str, direction: Vector) -> DirectionReport:
        task = self.analysis.task
        weighted = task.weigh_force(direction)
        beyond = is_beyond_arm(self.analysis.reduced, weighted)
        amounts: list[dict[LockModel, CapabilityRange]] = []
        for after in (False, True):
            by_reading = {}
            for reading in LockModel:
                feasible = self.feasible(after=after, reading=reading)
                ray = reach(feasible, weighted)
                failed = self._failed(after, reading)
                by_reading[reading] = _amount(
                    feasible, direction, ray, 1.0, failed, beyond_arm=beyond
                )
            amounts.append(by_reading)
        forced = bool(direction[list(task.force_rows)].any())
        return DirectionReport(name, "N" if forced else "N·m", *amounts)

    def _payload(self, *, after: bool) -> CapabilityRange:
        # A mass loads the joints linearly, as a force with these lever arms: the same ratio test.
        analysis = self.analysis
        faults = analysis.faults if after else FaultSet()
        n, rnea = analysis.robot.n, self._rnea(after=after)
        levers = read_only(self._torque_per_kg(after=after).reshape(1, n))
        free = analysis.question.free_joints(faults)
        line = reduce(levers, faults.mask(n), analysis.reduced.rtol, free)
        feasible = feasible_forces(line, rnea, self._largest(faults), LockModel.HELD)
        ray, failed = reach(feasible, np.ones(1)), self._failed(after, LockModel.HELD)
        return _amount(feasible, np.zeros(0), ray, 1.0, failed)

    def _failed(self, after: bool, reading: LockModel) -> tuple[int, ...]:
        """Return the joints whose fault, rather than a limit, can bound the force."""
        if not after:
            return ()
        faults = self.analysis.faults
        return faults.joints if reading is LockModel.COMMANDED else faults.free

    def _rnea(self, *, after: bool) -> Vector:
        """Return the weighted torques for weight and motion, shape (n,)."""
        rnea = self.analysis.rnea.after if after else self.analysis.rnea.before
        return self.analysis.scale.weigh_torque(rnea)

    def _largest(self, faults: FaultSet) -> Vector:
        """Return the weighted torque limits, NaN where unknown, shape (n,)."""
        question = self.analysis.question
        largest = question.largest_torques(faults)
        return np.full(question.robot.n, np.nan) if largest is None else largest

    def _torque_per_kg(self, *, after: bool) -> Vector:
        """Return the weighted joint torques per kg at the tip, shape (n,)."""
        analysis, conditions = self.analysis, self.analysis.conditions
        robot, q = analysis.robot, analysis.posture.q
        offset = np.zeros(3) if conditions.payload is None else conditions.payload.offset
        kilogram, pull = Payload(1.0, offset), -conditions.gravity
        if conditions.moves:
            locked = analysis.reduced.locked & after
            v, a = (
                robot.at_rest if x is None else np.where(locked, 0.0, x)
                for x in (conditions.velocity, conditions.acceleration)
            )
            pull = pull + payload_acceleration(robot, q, v, a, kilogram)
        J = analysis.scale.weigh_jacobian(payload_jacobian(robot, q, kilogram))
        torque = pull.dot(J)
        largest = float(np.linalg.norm(pull) * np.linalg.norm(J, axis=0).max())
        return np.where(np.abs(torque) > analysis.reduced.rtol * largest, torque, 0.0)


def _amount(
    feasible: FeasibleForces,
    direction: Vector,
    ray: Reach,
    size: float,
    failed: tuple[int, ...],
    *,
    beyond_arm: bool = False,
) -> CapabilityRange:
    end = limiting_factor(feasible, ray, beyond_arm=beyond_arm)
    stops = ray.limiting_joints
    if end is LimitingFactor.WEIGHT:
        stops = overloaded(feasible)
    elif end is LimitingFactor.FAULT:
        stops = failed
    least, most = (math.nan, math.nan) if ray.is_empty else (ray.minimum * size, ray.maximum * size)
    return CapabilityRange(read_only(direction.copy()), most, least, end, stops)


def capability(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    *,
    locked: Joints = (),
    free: Joints = (),
    weak: WeakJoints = (),
    direction: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    payload: PayloadLike = None,
    limits: LimitsLike = URDF,
    friction: FrictionLike = None,
    joint_friction: bool = False,
    armature: bool = False,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rtol: float = RTOL,
) -> Capability:
    """Compute the force and payload an arm can hold before and after a fault.

    Parameters
    ----------
    joint_friction, armature :
        As in `ftforce.analyze`.
    robot, q, locked, free, weak, velocity, acceleration, gravity, payload, friction :
        As in `ftforce.analyze`.
    task, length, joint_length, axes, posture, rtol :
        As in `ftforce.analyze`.
    direction :
        Additional direction of force, in task axes, shape (m,).
    limits :
        As in `ftforce.analyze`; by default those of the URDF.

    Raises
    ------
    InputError
        An argument is invalid; the message says what is expected.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("panda")
    >>> result = ftforce.capability(arm, locked=[2, 4])
    >>> push = result.directions[4]
    >>> push.name, round(push.before["commanded"].maximum), round(push.after["held"].maximum)
    ('+fz', 162, 162)
    >>> push.after["commanded"].maximum, push.after["commanded"].end.value
    (0.0, 'fault')
    >>> after = result.payload[1]
    >>> round(after.maximum, 1), [arm.names[j] for j in after.limiting_joints]
    (11.3, ['panda_joint6'])
    """
    question = Question.parse(
        robot,
        faults=named_faults(robot, locked, free, weak),
        direction=direction,
        velocity=velocity,
        acceleration=acceleration,
        gravity=gravity,
        payload=payload,
        limits=limits,
        friction=friction,
        joint_friction=joint_friction,
        armature=armature,
        task=task,
        length=length,
        joint_length=joint_length,
        axes=axes,
        rtol=rtol,
    ).placed(q, posture)
    return capability_to(question)


def capability_to(question: Question) -> Capability:
    """Return the capability that a question asks for, along its direction too if it has one."""
    return Capability(analyze_question(question), question.direction)


def capability_of(analysis: Analysis, direction: ArrayLike | None = None) -> Capability:
    """Return the capability of an analysis.

    Parameters
    ----------
    analysis :
        The analysis.
    direction :
        Additional direction of force, in task axes, shape (m,).

    Raises
    ------
    InputError
        The direction is zero or has the wrong length.
    """
    if direction is None:
        return Capability(analysis)
    return Capability(analysis, unit_direction(analysis.task, direction))
