"""One posture, one fault set: where the robot meets the mathematics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce import metrics
from ftforce.arrays import Matrix, Vector, as_vector, read_only
from ftforce.changes import (
    ForceChange,
    TipLoad,
    TorqueChange,
    VelocityChange,
    change_of_load,
    change_of_velocity,
    changes_of_unit_forces,
)
from ftforce.closed_forms import (
    PROOF_TOLERANCE,
    Jump,
    exerted_force,
    force_residuals,
    supported_force,
)
from ftforce.display import Displayed
from ftforce.errors import InputError
from ftforce.faults import FaultSet
from ftforce.kinematics import task_jacobian
from ftforce.posture import Posture, choose_posture
from ftforce.reduced import RTOL, WARY, ReducedJacobian, check_tolerances, reduce
from ftforce.task import Axes, Task

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike

    from ftforce.metrics import Verdict
    from ftforce.robot import Robot

_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Analysis(Displayed):
    """What one fault set does to an arm in one posture.

    Attributes
    ----------
    robot, task, posture, faults :
        What was analysed.
    J :
        Task Jacobian, unweighted, in the task's axes, shape (m, n).
    reduced :
        Weighted Jacobians before and after, with ranks.
    wary :
        Largest tolerance that was tried for the verdict.
    force, torque :
        Their change; ``None`` if neither a force nor torques were given.
    unit_forces :
        The change for a force of 1 N (1 N·m) along each task axis, and the torques for it, if
        neither a force nor torques were given.
    velocity :
        Its change; ``None`` if none was given.
    verdict :
        For the given force; for all forces if none was given.
    """

    robot: Robot
    task: Task
    posture: Posture
    faults: FaultSet
    J: Matrix
    reduced: ReducedJacobian
    wary: float
    force: ForceChange | None
    torque: TorqueChange | None
    unit_forces: tuple[tuple[ForceChange, TorqueChange], ...]
    velocity: VelocityChange | None
    verdict: Verdict

    @property
    def locked(self) -> tuple[str, ...]:
        """Names of the locked joints."""
        return tuple(self.robot.names[i] for i in self.faults.joints)

    @property
    def margin(self) -> float:
        """σ_min(K)/σ_max(J)."""
        return metrics.margin(self.reduced)

    @property
    def relative_manipulability(self) -> float:
        """ρ = w(K)/w(J); NaN where the healthy arm is singular for this task."""
        return metrics.relative_manipulability(self.reduced)

    @property
    def force_error(self) -> float:
        """Largest error of the tip's (weighted) force per N·m of torque error, 1/σ of K."""
        return metrics.force_error(self.reduced)

    @cached_property
    def lost_directions(self) -> Matrix:
        """Directions of (weighted) force that are lost, orthonormal rows, shape (lost, m)."""
        return metrics.lost_directions(self.reduced)

    @cached_property
    def force_contributions(self) -> Vector | None:
        """Share of each joint's torque in the tip's force, ‖(Jᵀ)†_k τ_k‖/‖F̂‖ (Table 2), (n,)."""
        if self.force is None or self.torque is None:
            return None
        F = self.task.weigh_force(self.force.before)
        return metrics.force_contributions(self.reduced, self.torque.before, F)

    @cached_property
    def velocity_contributions(self) -> Vector | None:
        """Share of each joint in the tip's velocity, ‖J_k v_k‖/‖J v‖ (Table 2), shape (n,)."""
        if self.velocity is None:
            return None
        return metrics.velocity_contributions(self.reduced.J, self.velocity.before)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes the answer doubtful: limits exceeded, and so on."""
        return (*self.posture.warnings, *_doubts(self))

    def residuals(self) -> Mapping[str, float]:
        """Return how far the result is from the laws it must keep, relative; 0 is ideal.

        Returns
        -------
        :
            ``balance``: F̂ - F_after - ΔF; ``orthogonality``: ΔF·F_after; ``uncommandable``: KᵀΔF,
            no healthy joint feels the jump; ``statics``: U - KᵀF_after;
            ``unchanged``: healthy torques keep their value when the torques were JᵀF. Without a
            force, the largest over the unit forces.
        """
        pairs = self.unit_forces
        if self.force is not None and self.torque is not None:
            pairs = ((self.force, self.torque),)
        each = [_residuals(self, force, torque) for force, torque in pairs]
        return {law: max(one[law] for one in each) for law in each[0]}

    def is_proved(self, tolerance: float = PROOF_TOLERANCE) -> bool:
        """Return whether all residuals are within ``tolerance`` (plus what rtol gave away)."""
        return all(value <= tolerance + self.reduced.rtol for value in self.residuals().values())


def analyze(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    *,
    locked: Iterable[int | str] | str | int = (),
    force: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rtol: float = RTOL,
    wary: float = WARY,
) -> Analysis:
    """Say what locked joints do to the force at the tip, and which torques to command now.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions along the chain, rad or m, shape (n,). Without: ``posture``.
    locked :
        Locked joints: numbers from 1, names, or a boolean mask of shape (n,).
    force :
        Force the tool exerts on its environment, N and N·m, in the task's axes, shape (m,).
    torque :
        Motor torques meant for the tip's force (weight and motion taken off), N·m, shape (n,),
        instead of a force. Without either: every unit force.
    velocity :
        Joint velocities before the fault, rad/s or m/s, shape (n,).
    task :
        ``force``, ``moment``, ``wrench``, or components such as ``fx,fz,my``.
    length :
        Characteristic length in m that weighs moments against forces, 1 m if not given.
    axes :
        ``tool`` or ``world``.
    posture :
        A named posture instead of ``q``; without either a default, named in the result.
    rtol :
        Singular values up to ``rtol · σ_max(J)`` count as lost.
    wary :
        The verdict is *borderline* if a tolerance up to this would give another one.

    Raises
    ------
    InputError
        A malformed value; the message says what would have been valid.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("dh5")
    >>> result = ftforce.analyze(arm, locked=[2, 3], force=[80, 50, 10])
    >>> result.verdict.value, round(result.force.jump_norm, 2)
    ('not tolerated', 80.0)
    """
    check_tolerances(rtol, wary)
    wanted = Task.parse(task, axes, length)
    place = choose_posture(robot, q, posture)
    faults = FaultSet.locked(robot.indices(locked))
    J = task_jacobian(robot, place.q, wanted)
    reduced = reduce(read_only(wanted.weigh_jacobian(J)), faults.mask(robot.n), rtol)
    load = tip_load(robot, reduced, wanted, force, torque)
    change = None if load is None else change_of_load(reduced, wanted, load)
    hint = f"one per joint, {robot.numbered()}"
    v = None if velocity is None else as_vector(velocity, robot.n, "velocity", hint)
    return Analysis(
        robot=robot,
        task=wanted,
        posture=place,
        faults=faults,
        J=read_only(J),
        reduced=reduced,
        wary=wary,
        force=change[0] if change else None,
        torque=change[1] if change else None,
        unit_forces=() if change else changes_of_unit_forces(reduced, wanted),
        velocity=None if v is None else change_of_velocity(reduced, wanted, v),
        verdict=metrics.verdict(reduced, None if load is None else load.F, wary),
    )


def tip_load(
    robot: Robot,
    reduced: ReducedJacobian,
    task: Task,
    force: ArrayLike | None,
    torque: ArrayLike | None,
) -> TipLoad | None:
    """Return what the healthy arm exerts, F̂ = J J† F or (Jᵀ)† τ; ``None`` if nothing was given.

    Raises
    ------
    InputError
        Both were given, or a vector is malformed.
    """
    if force is not None and torque is not None:
        raise InputError("give either a force or torques, not both")
    if force is not None:
        names = ", ".join(task.components)
        requested = as_vector(force, task.m, "force", f"{names} of the task '{task}'")
        wanted = task.weigh_force(requested)
        F = supported_force(reduced, wanted)
        return TipLoad(_without_rounding(F, F, wanted), requested, None)
    if torque is not None:
        tau = as_vector(torque, robot.n, "torque", f"one per joint, {robot.numbered()}")
        F = exerted_force(reduced, tau)
        return TipLoad(_without_rounding(F, F.dot(reduced.J), tau), None, tau)
    return None


def _without_rounding(F: Vector, part: Vector, whole: Vector) -> Vector:
    """Return F, or zero if the part of the request that it stands for is only rounding.

    Otherwise the verdict would judge the direction of rounding errors.
    """
    return F if part.dot(part) > (_ROUNDING * _ROUNDING) * whole.dot(whole) else np.zeros_like(F)


def _residuals(analysis: Analysis, force: ForceChange, torque: TorqueChange) -> dict[str, float]:
    reduced, task = analysis.reduced, analysis.task
    weighted = Jump(*map(task.weigh_force, (force.before, force.after, force.jump)))
    laws = force_residuals(reduced, torque.after, weighted)
    healthy = ~reduced.locked
    change = (torque.after + torque.self_motion - torque.before)[healthy]
    scale = float(np.linalg.norm(torque.before))
    laws["unchanged"] = float(np.linalg.norm(change)) / scale if scale > 0.0 else 0.0
    return laws


def _doubts(analysis: Analysis) -> list[str]:
    reduced, robot = analysis.reduced, analysis.robot
    doubts = []
    if reduced.rank < reduced.m:
        doubts.append(
            f"even the healthy arm has only rank {reduced.rank} of {reduced.m} for the task "
            f"'{analysis.task}' in this posture"
        )
    if analysis.torque is not None:
        for joint, torque in zip(robot.joints, analysis.torque.after.tolist(), strict=True):
            if joint.effort is not None and abs(torque) > joint.effort * (1.0 + 1e-9):
                doubts.append(
                    f"joint {joint.number} {joint.name} would need "
                    f"{abs(torque) / joint.effort:.0%} of its effort limit of "
                    f"{joint.effort:g} {joint.torque_unit}"
                )
    return doubts
