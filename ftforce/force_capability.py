"""What force, and what payload, an arm can hold before and after a fault (docs/theory/limits)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.analysis import Analysis, analyze
from ftforce.arrays import Vector, as_vector, read_only
from ftforce.bounded import overloaded
from ftforce.display import Displayed
from ftforce.dynamics import Payload, motion_torque, weight_torque
from ftforce.errors import InputError
from ftforce.faults import FaultSet
from ftforce.feasible import (
    End,
    FeasibleForces,
    Reach,
    Reading,
    feasible_forces,
    reach,
    weakest_direction,
)
from ftforce.polytope import Polytope, force_polytope
from ftforce.reduced import reduce_decomposed

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.posture import Posture
    from ftforce.reduced import ReducedJacobian
    from ftforce.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class Amount:
    """How much of a force, or of a payload, can be held.

    Attributes
    ----------
    direction :
        Of the force, in the task's axes, not weighted, shape (m,): its force components have the
        norm 1, or if it has none its moments. Empty for a payload.
    most :
        Largest amount, N (N·m for a moment alone), or kg: infinite if no known limit ends it,
        NaN if none can be held.
    least :
        Smallest amount, 0 but for a joint without torque or a limit that weight alone exceeds.
    end :
        What ends it.
    stops :
        Indices of the joints that end it.
    """

    direction: Vector
    most: float
    least: float
    end: End
    stops: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DirectionReport:
    """What can be held in one direction.

    Attributes
    ----------
    name :
        ``+fx``, ``-fx`` …, ``direction`` for the one asked for, ``weakest``.
    unit :
        N, or N·m for a moment alone.
    before, after :
        Amounts by reading of a lock, before and after the fault.
    """

    name: str
    unit: str
    before: dict[Reading, Amount]
    after: dict[Reading, Amount]


@dataclass(frozen=True, eq=False)
class Capability(Displayed):
    """What force and payload an arm can hold before and after a fault, in one posture.

    Attributes
    ----------
    analysis :
        The fault set, posture and limits.
    direction :
        The direction asked for, in the task's axes, shape (m,); ``None`` if none was.
    """

    analysis: Analysis
    direction: Vector | None = None

    @cached_property
    def directions(self) -> tuple[DirectionReport, ...]:
        """Each task axis both ways, and the direction asked for."""
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
        """The direction in which the least (weighted) force can be held, of those the arm has.

        It is another direction before and after, and for each reading: see `Amount.direction`.
        """
        reduced, task = self.analysis.reduced, self.analysis.task
        space = reduced.healthy.U[:, : reduced.rank]
        found = {}
        for after in (False, True):
            for reading in Reading:
                feasible = self.feasible(after=after, reading=reading)
                worst = weakest_direction(feasible, space)
                plain = task.unweigh_force(worst.direction)
                size = task.size(plain)
                found[after, reading] = self._amount(
                    feasible, read_only(plain / size), worst.reach, size, after=after
                )
        before, after_ = ({r: found[late, r] for r in Reading} for late in (False, True))
        return DirectionReport(
            "weakest", task.units[0] if task.force_rows else "N·m", before, after_
        )

    @cached_property
    def payload(self) -> tuple[Amount, Amount]:
        """Mass in kg that the tip can carry, before and after, on top of the payload that is there.

        A payload is a load that is held: its weight may hang on locks.
        """
        return self._payload(after=False), self._payload(after=True)

    def feasible(self, *, after: bool, reading: Reading = Reading.COMMANDED) -> FeasibleForces:
        """Return the forces that can be held before or after the fault, weighted."""
        analysis = self.analysis
        limits, n = analysis.limits, analysis.robot.n
        faults = analysis.faults if after else FaultSet()
        reduced = analysis.reduced if after else self._healthy
        rnea = analysis.rnea.after if after else analysis.rnea.before
        largest = np.full(n, np.nan) if limits is None else limits.largest_torques(faults)
        return feasible_forces(reduced, rnea, largest, reading)

    def polytope(self, *, after: bool, reading: Reading | str = Reading.COMMANDED) -> Polytope:
        """Return vertices and faces of the forces that can be held, N (N·m), in the task's axes.

        Parameters
        ----------
        after :
            Whether after the fault or before it.
        reading :
            ``commanded`` or ``held``.

        Raises
        ------
        InputError
            So many joints that there are too many planes to intersect.
        """
        feasible = self.feasible(after=after, reading=Reading.parse(reading))
        return force_polytope(feasible, self.analysis.task.weights)

    @cached_property
    def _healthy(self) -> ReducedJacobian:
        reduced = self.analysis.reduced
        none = FaultSet().mask(self.analysis.robot.n)
        return reduce_decomposed(reduced.healthy, none, reduced.rtol)

    def _report(self, name: str, direction: Vector) -> DirectionReport:
        task = self.analysis.task
        weighted = task.weigh_force(direction)
        amounts: list[dict[Reading, Amount]] = []
        for after in (False, True):
            by_reading = {}
            for reading in Reading:
                feasible = self.feasible(after=after, reading=reading)
                ray = reach(feasible, weighted)
                by_reading[reading] = self._amount(feasible, direction, ray, 1.0, after=after)
            amounts.append(by_reading)
        forced = bool(direction[list(task.force_rows)].any())
        return DirectionReport(name, "N" if forced else "N·m", *amounts)

    def _amount(
        self, feasible: FeasibleForces, direction: Vector, ray: Reach, size: float, *, after: bool
    ) -> Amount:
        failed = self.analysis.faults.joints if after else ()
        direction = read_only(direction.copy())
        if ray.is_empty:
            stops = overloaded(feasible)
            end = End.WEIGHT
            if not feasible.stands_still or feasible.F0.any():
                stops, end = failed, End.FAULT
            return Amount(direction, math.nan, math.nan, end, stops)
        if ray.stops:
            return Amount(direction, ray.most * size, ray.least * size, End.LIMIT, ray.stops)
        if math.isinf(ray.most):
            return Amount(direction, math.inf, ray.least * size, End.NOTHING, ())
        return Amount(direction, ray.most * size, ray.least * size, End.FAULT, failed)

    def _payload(self, *, after: bool) -> Amount:
        analysis = self.analysis
        feasible = self.feasible(after=after, reading=Reading.HELD)
        torque = self._torque_per_kg(after=after)
        nothing = read_only(np.zeros(0))
        if not torque.any():
            return Amount(nothing, math.inf, 0.0, End.NOTHING, ())
        # A mass loads the joints as a force does that has these levers: one more ratio test.
        swinging = analysis.reduced.swinging if after else None
        yields = () if swinging is None else tuple(
            j for j in swinging.joints if abs(torque[j]) > feasible.rtol * np.abs(torque).max()
        )  # fmt: skip
        one = np.ones((1, 1))
        rows = torque[feasible.joints].reshape(-1, 1)
        scale = float(np.abs(torque).max())
        line = feasible._replace(F0=np.zeros(1), Z=one, rows=rows, scale=scale)
        ray = reach(line, np.ones(1))
        bare = feasible.stands_still and not feasible.F0.any()
        if not bare:
            return Amount(nothing, math.nan, math.nan, End.FAULT, analysis.faults.joints)
        if yields and not ray.is_empty:
            return Amount(nothing, 0.0, 0.0, End.FAULT, yields)
        return self._amount(feasible, nothing, ray, 1.0, after=after)

    def _torque_per_kg(self, *, after: bool) -> Vector:
        """Return the torques that one kg at the tip adds, N·m (N) per kg, shape (n,)."""
        analysis, conditions = self.analysis, self.analysis.conditions
        robot, q, n = analysis.robot, analysis.posture.q, analysis.robot.n
        offset = np.zeros(3) if conditions.payload is None else conditions.payload.offset
        kilogram = Payload(1.0, offset)
        torque = weight_torque(robot, q, conditions.gravity, kilogram)
        torque = torque - weight_torque(robot, q, conditions.gravity)
        if conditions.moves:
            locked = analysis.reduced.locked if after else np.zeros(n, dtype=np.bool_)
            v, a = (
                np.zeros(n) if x is None else np.where(locked, 0.0, x)
                for x in (conditions.velocity, conditions.acceleration)
            )
            torque = torque + motion_torque(robot, q, v, a, kilogram)
            torque = torque - motion_torque(robot, q, v, a)
        return torque


def capability(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    *,
    direction: ArrayLike | None = None,
    limits: Any = "urdf",
    **case: Any,
) -> Capability:
    """Say which force and which payload an arm can hold before and after a fault.

    Parameters
    ----------
    robot, q :
        As in `ftforce.analyze`.
    direction :
        A direction of force besides the task's axes, in the task's axes, shape (m,).
    limits :
        As in `ftforce.analyze`; here the URDF's if not given.
    case :
        ``locked``, ``free``, ``weak``, ``velocity``, ``acceleration``, ``gravity``, ``payload``,
        ``task``, ``length``, ``axes``, ``posture`` and ``rtol`` as in `ftforce.analyze`.

    Raises
    ------
    InputError
        A malformed value; the message says what would have been valid.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("panda")
    >>> result = ftforce.capability(arm, locked=[2, 4])
    >>> push = result.directions[4]
    >>> push.name, round(push.before["commanded"].most), round(push.after["held"].most)
    ('+fz', 162, 162)
    >>> push.after["commanded"].most, push.after["commanded"].end.value
    (0.0, 'fault')
    >>> round(result.payload[1].most, 1), [arm.names[j] for j in result.payload[1].stops]
    (11.3, ['panda_joint6'])
    """
    return capability_of(analyze(robot, q, limits=limits, **case), direction)


def capability_of(analysis: Analysis, direction: ArrayLike | None = None) -> Capability:
    """Return the capability of an analysis.

    Raises
    ------
    InputError
        The direction is zero or has the wrong length.
    """
    task = analysis.task
    if direction is None:
        return Capability(analysis)
    names = ", ".join(task.components)
    vector = as_vector(direction, task.m, "direction", f"{names} of the task '{task}'")
    size = task.size(vector)
    if size == 0.0:
        raise InputError("the direction needs a component that is not zero")
    return Capability(analysis, read_only(vector / size))
