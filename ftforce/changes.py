"""Force, torque and velocity before and after a fault, in the task's own units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.arrays import Vector, read_only
from ftforce.closed_forms import force_jump, remapped_torque, supported_force, velocity_remap

if TYPE_CHECKING:
    from ftforce.closed_forms import Jump
    from ftforce.reduced import ReducedJacobian
    from ftforce.task import Task


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


def change_of_load(
    reduced: ReducedJacobian, task: Task, load: TipLoad
) -> tuple[ForceChange, TorqueChange]:
    """Return what becomes of a load at the tip, and of the torques that hold it."""
    jump = force_jump(reduced, load.F)
    carried: Vector = load.F.dot(reduced.J)
    before = carried if load.tau is None else load.tau
    return _force_change(task, jump, load.requested), TorqueChange(
        before=read_only(before),
        after=read_only(remapped_torque(reduced, load.F)),
        brake_load=read_only(np.where(reduced.locked, jump.F_after.dot(reduced.J), 0.0)),
        self_motion=read_only(before - carried),
    )


def changes_of_unit_forces(
    reduced: ReducedJacobian, task: Task
) -> tuple[tuple[ForceChange, TorqueChange], ...]:
    """Return the same for a force of 1 N (1 N·m) along each task axis."""
    changes = []
    for unit in np.eye(task.m):
        F = supported_force(reduced, task.weigh_force(unit))
        changes.append(change_of_load(reduced, task, TipLoad(F, read_only(unit.copy()), None)))
    return tuple(changes)


def change_of_velocity(reduced: ReducedJacobian, task: Task, v: Vector) -> VelocityChange:
    """Return the velocities before the fault and after the remap of Appendix A."""
    weighted = velocity_remap(reduced, v)
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


def split_norms(task: Task, x: Vector) -> tuple[float | None, float | None]:
    """Return the norms of the linear and of the angular components, which share no unit."""
    if not task.moment_rows:
        return math.sqrt(x.dot(x)), None
    linear = float(np.linalg.norm(x[list(task.force_rows)])) if task.force_rows else None
    return linear, float(np.linalg.norm(x[list(task.moment_rows)]))
