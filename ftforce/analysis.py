"""One posture, one fault set: where the robot meets the mathematics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce import metrics
from ftforce.arrays import Matrix, Vector, as_vector, read_only
from ftforce.closed_forms import (
    PROOF_TOLERANCE,
    Jump,
    VelocityRemap,
    exerted_force,
    force_jump,
    force_residuals,
    remapped_torque,
    supported_force,
    velocity_remap,
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


@dataclass(frozen=True, slots=True, eq=False)
class ForceChange:
    """Force at the tip before and after the fault; N for forces, N·m for moments, shape (m,).

    Attributes
    ----------
    requested :
        Force asked for; ``None`` if torques were given.
    unsupported :
        Part of the request that even the healthy arm cannot exert.
    before :
        Force the healthy arm exerts, F̂.
    after :
        Force the healthy joints can still command.
    jump :
        ΔF = before - after.
    jump_norm :
        Norm of the jump's force components, N; ``None`` if the task has none.
    moment_jump_norm :
        Norm of its moment components, N·m; ``None`` if the task has none.
    """

    requested: Vector | None
    unsupported: Vector
    before: Vector
    after: Vector
    jump: Vector
    jump_norm: float | None
    moment_jump_norm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class TorqueChange:
    """Force part of the motor torques, N·m (N for prismatic joints), shape (n,).

    Attributes
    ----------
    before :
        Motor torques before the fault.
    after :
        Motor torques to command now, U; 0 at locked joints.
    brake_load :
        What each lock has to carry, J_Sᵀ F_after; 0 at healthy joints.
    self_motion :
        Part of ``before`` that exerts no static force but moves the arm; 0 if a force was given.
    """

    before: Vector
    after: Vector
    brake_load: Vector
    self_motion: Vector


@dataclass(frozen=True, slots=True, eq=False)
class VelocityChange:
    """Velocities before the fault and after the remap of Appendix A.

    Attributes
    ----------
    before, after :
        Joint velocities, rad/s or m/s, shape (n,); 0 at locked joints after.
    tip_before, tip_after :
        Velocity of the tip, m/s and rad/s, shape (m,).
    jump :
        ΔẊ = tip_after - tip_before.
    jump_norm :
        Norm of the jump's linear components, m/s; ``None`` if the task has none.
    angular_jump_norm :
        Norm of its angular components, rad/s; ``None`` if the task has none.
    """

    before: Vector
    after: Vector
    tip_before: Vector
    tip_after: Vector
    jump: Vector
    jump_norm: float | None
    angular_jump_norm: float | None


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
        """Largest error of the tip's (weighted) force per N·m of torque error, 1/σ_min(K)."""
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
        columns = np.linalg.norm(_pinv_transposed(self.reduced), axis=0)
        return read_only(_over(columns * np.abs(self.torque.before), float(np.linalg.norm(F))))

    @cached_property
    def velocity_contributions(self) -> Vector | None:
        """Share of each joint in the tip's velocity, ‖J_k v_k‖/‖J v‖ (Table 2), shape (n,)."""
        if self.velocity is None:
            return None
        J, v = self.reduced.J, self.velocity.before
        return read_only(_over(np.linalg.norm(J * v, axis=0), float(np.linalg.norm(J @ v))))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes the answer doubtful: limits exceeded, and so on."""
        return (*self.posture.warnings, *_doubts(self))

    def residuals(self) -> Mapping[str, float]:
        """Return how far the result is from the laws of theory §8, relative; 0 is ideal.

        Returns
        -------
        :
            ``orthogonality``: ΔF·F_after; ``uncommandable``: KᵀΔF; ``statics``: U - KᵀF_after;
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
    reduced = reduce(wanted.weigh_jacobian(J), faults.mask(robot.n), rtol)
    load = tip_load(robot, reduced, wanted, force, torque)
    change = None if load is None else _change(reduced, wanted, load)
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
        unit_forces=() if change else _unit_forces(reduced, wanted),
        velocity=None if velocity is None else _velocity(robot, reduced, wanted, velocity),
        verdict=metrics.verdict(reduced, None if load is None else load.F, wary),
    )


@dataclass(frozen=True, slots=True, eq=False)
class TipLoad:
    """What the tip exerts before the fault.

    Attributes
    ----------
    F :
        Weighted force that the healthy arm exerts, F̂, shape (m,).
    requested :
        Force that was asked for, unweighted; ``None`` if torques were given.
    tau :
        Torques that were given; ``None`` if a force was.
    """

    F: Vector
    requested: Vector | None
    tau: Vector | None


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
        return TipLoad(supported_force(reduced, task.weigh_force(requested)), requested, None)
    if torque is not None:
        tau = as_vector(torque, robot.n, "torque", f"one per joint, {robot.numbered()}")
        return TipLoad(exerted_force(reduced, tau), None, tau)
    return None


def _unit_forces(
    reduced: ReducedJacobian, task: Task
) -> tuple[tuple[ForceChange, TorqueChange], ...]:
    changes = []
    for unit in np.eye(task.m):
        F = supported_force(reduced, task.weigh_force(unit))
        changes.append(_change(reduced, task, TipLoad(F, read_only(unit.copy()), None)))
    return tuple(changes)


def _change(
    reduced: ReducedJacobian, task: Task, load: TipLoad
) -> tuple[ForceChange, TorqueChange]:
    jump = force_jump(reduced, load.F)
    carried: Vector = load.F.dot(reduced.J)
    before = carried if load.tau is None else load.tau
    return _force_change(task, jump, load.requested), TorqueChange(
        before=read_only(before),
        after=read_only(remapped_torque(reduced, load.F)),
        brake_load=read_only(np.where(reduced.locked, jump.F_after.dot(reduced.J), 0.0)),
        self_motion=read_only(before - carried),
    )


def _force_change(task: Task, weighted: Jump, requested: Vector | None) -> ForceChange:
    before = read_only(task.unweigh_force(weighted.F))
    jump = read_only(task.unweigh_force(weighted.jump))
    linear, angular = split_norms(task, jump)
    return ForceChange(
        requested=requested,
        unsupported=read_only(np.zeros(task.m) if requested is None else requested - before),
        before=before,
        after=read_only(task.unweigh_force(weighted.F_after)),
        jump=jump,
        jump_norm=linear,
        moment_jump_norm=angular,
    )


def _velocity(
    robot: Robot, reduced: ReducedJacobian, task: Task, velocity: ArrayLike
) -> VelocityChange:
    v = as_vector(velocity, robot.n, "velocity", f"one per joint, {robot.numbered()}")
    weighted: VelocityRemap = velocity_remap(reduced, v)
    jump = read_only(task.unweigh_velocity(weighted.jump))
    linear, angular = split_norms(task, jump)
    return VelocityChange(
        before=v,
        after=weighted.after,
        tip_before=read_only(task.unweigh_velocity(weighted.tip_before)),
        tip_after=read_only(task.unweigh_velocity(weighted.tip_after)),
        jump=jump,
        jump_norm=linear,
        angular_jump_norm=angular,
    )


def split_norms(task: Task, x: Vector) -> tuple[float | None, float | None]:
    """Return the norms of the linear and of the angular components, which share no unit."""
    if not task.moment_rows:
        return math.sqrt(x.dot(x)), None
    linear = float(np.linalg.norm(x[list(task.force_rows)])) if task.force_rows else None
    return linear, float(np.linalg.norm(x[list(task.moment_rows)]))


def _pinv_transposed(reduced: ReducedJacobian) -> Matrix:
    """Return (Jᵀ)†, shape (m, n)."""
    columns = (reduced.healthy.solve_transposed(unit, reduced.rtol) for unit in np.eye(reduced.n))
    return np.column_stack(list(columns))


def _over(values: Vector, scale: float) -> Vector:
    return values / scale if scale > 0.0 else np.zeros_like(values)


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
