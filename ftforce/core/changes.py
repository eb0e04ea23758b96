"""Force, torque and velocity before and after a fault, in the units of the task."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import Vector, read_only
from ftforce.core.remap import (
    force_jump,
    remapped_torque,
    supported_force,
    velocity_after_impact,
    velocity_remap,
)

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix
    from ftforce.core.bounded_remap import BoundedRemap
    from ftforce.core.joint_scale import JointScale
    from ftforce.core.reduced_jacobian import ReducedJacobian
    from ftforce.core.task import Task


class TipLoad(NamedTuple):
    """The force that the tip exerts before the fault.

    Attributes
    ----------
    F :
        Weighted force that the healthy arm exerts, F̂, shape (m,).
    requested :
        Requested force, unweighted, shape (m,); ``None`` if torques were given.
    tau :
        Given torques, shape (n,); ``None`` if a force was given.
    """

    F: Vector
    requested: Vector | None
    tau: Vector | None


class RneaChange(NamedTuple):
    """Gravity and motion torques before and after, N·m (N for prismatic joints), shape (n,).

    Attributes
    ----------
    gravity :
        Gravity torques, unchanged by the fault; ``None`` if the URDF has no masses.
    motion_before, motion_after :
        Inertial, Coriolis and centrifugal torques; ``None`` if the arm moves and the URDF has no
        masses.
    before, after :
        Sum of the known parts; unknown parts count as zero.
    """

    gravity: Vector | None
    motion_before: Vector | None
    motion_after: Vector | None
    before: Vector
    after: Vector

    @property
    def is_known(self) -> bool:
        """Whether gravity and motion torques are known."""
        return self.gravity is not None and self.motion_before is not None

    def weighed(self, scale: JointScale) -> RneaChange:
        """Return the weighted torques (theory §2.7).

        Parameters
        ----------
        scale :
            Weights of hinges against slides.
        """
        if scale.weights is None:
            return self
        return RneaChange(*(None if x is None else scale.weigh_torque(x) for x in self))  # type: ignore[arg-type] # only what is ``None`` stays so


@dataclass(frozen=True, slots=True, eq=False)
class ForceChange:
    """Tip force before and after the fault; N for forces, N·m for moments, shape (m,).

    Attributes
    ----------
    requested :
        Requested force; ``None`` if torques were given.
    unsupported :
        Part of the requested force that even the healthy arm cannot exert.
    before :
        Force that the healthy arm exerts, F̂.
    after :
        Force that can still be held; ``None`` if no tip force keeps the arm in equilibrium.
    jump :
        ΔF = before - after; ``None`` if ``after`` is.
    jump_norm :
        Norm of the force components of the jump, N; ``None`` if the task has none.
    moment_jump_norm :
        Norm of the moment components of the jump, N·m; ``None`` if the task has none.
    """

    requested: Vector | None
    unsupported: Vector
    before: Vector
    after: Vector | None
    jump: Vector | None
    jump_norm: float | None
    moment_jump_norm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class TorqueChange:
    """Motor torques, N·m (N for prismatic joints), shape (n,).

    Torques after the fault are ``None`` if the arm cannot be held in static equilibrium; totals are
    also ``None`` if the URDF has no masses.

    Attributes
    ----------
    before, after :
        Torques due to the tip force, Jᵀ F; after the fault 0 at locked joints. At a free-swinging
        joint they balance the joint's gravity and motion torques.
    total_before, total_after :
        Total motor torques, including gravity and motion torques. After the fault 0 at locked and
        free-swinging joints.
    brake_load :
        Torque that the brake of each locked joint carries, including gravity and motion torques; 0
        at other joints.
    self_motion :
        Part of ``before`` that drives self-motion and exerts no static force; 0 if a force was
        given.
    """

    before: Vector
    after: Vector | None
    total_before: Vector | None
    total_after: Vector | None
    brake_load: Vector | None
    self_motion: Vector

    def unweighed(self, scale: JointScale) -> TorqueChange:
        """Return the torques, N·m (N), if these are weighted (theory §2.7).

        Parameters
        ----------
        scale :
            Weights of hinges against slides.
        """
        if scale.weights is None:
            return self
        torques: dict[str, Any] = {}
        for field in fields(self):
            torque = getattr(self, field.name)
            torques[field.name] = (
                None if torque is None else read_only(scale.unweigh_torque(torque))
            )
        return TorqueChange(**torques)


@dataclass(frozen=True, slots=True, eq=False)
class Impact:
    """Velocities immediately after joints lock, before any controller acts.

    Attributes
    ----------
    after :
        Joint velocities, rad/s or m/s, shape (n,); 0 at locked joints.
    tip_after :
        Tip velocity, m/s and rad/s, shape (m,).
    jump :
        ``tip_after`` minus the tip velocity before the fault, shape (m,).
    jump_norm :
        Norm of the linear components of the jump, m/s; ``None`` if the task has none.
    angular_jump_norm :
        Norm of the angular components of the jump, rad/s; ``None`` if the task has none.
    """

    after: Vector
    tip_after: Vector
    jump: Vector
    jump_norm: float | None
    angular_jump_norm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class VelocityChange:
    """Velocities before the fault and after the velocity remap of Appendix A.

    Attributes
    ----------
    before, after :
        Joint velocities, rad/s or m/s, shape (n,); after the fault 0 at locked joints.
    tip_before, tip_after :
        Tip velocity, m/s and rad/s, shape (m,).
    jump :
        ΔẊ = tip_after - tip_before, shape (m,).
    jump_norm :
        Norm of the linear components of the jump, m/s; ``None`` if the task has none.
    angular_jump_norm :
        Norm of the angular components of the jump, rad/s; ``None`` if the task has none.
    """

    before: Vector
    after: Vector
    tip_before: Vector
    tip_after: Vector
    jump: Vector
    jump_norm: float | None
    angular_jump_norm: float | None

    def unweighed(self, scale: JointScale) -> VelocityChange:
        """Return the joint velocities, rad/s or m/s, if these are weighted (theory §2.7).

        Parameters
        ----------
        scale :
            Weights of hinges against slides.
        """
        if scale.weights is None:
            return self
        before, after = map(scale.unweigh_velocity, (self.before, self.after))
        return replace(self, before=read_only(before), after=read_only(after))


def change_of_load(
    reduced: ReducedJacobian,
    task: Task,
    load: TipLoad,
    rnea: RneaChange,
    bounded: BoundedRemap | None,
) -> tuple[ForceChange, TorqueChange]:
    """Return the change of the tip force and of the motor torques due to a fault.

    Parameters
    ----------
    reduced, task :
        The decomposed Jacobians and the task.
    load :
        Tip force before the fault.
    rnea :
        Gravity and motion torques.
    bounded :
        The remap within limits or with free-swinging joints; ``None`` uses the closed form.
    """
    carried: Vector = load.F.dot(reduced.J)
    before = carried if load.tau is None else load.tau
    if bounded is None:
        _, F_after, jump = force_jump(reduced, load.F)
        after = remapped_torque(reduced, load.F)
    elif bounded.F_after is None:
        return _no_change(task, load, before, carried, rnea)
    else:
        F_after, jump = bounded.F_after, load.F - bounded.F_after
        after = np.where(reduced.locked, 0.0, F_after.dot(reduced.J))
    known = rnea.is_known
    total = rnea.after + (carried if F_after is load.F else F_after.dot(reduced.J))
    by_brakes = np.where(reduced.locked, total, 0.0)
    by_motors = total - by_brakes  # exact: one of them is 0
    if reduced.free is not None:
        by_motors[reduced.free.joints] = 0.0
    return _force_change(task, load, F_after, jump), TorqueChange(
        before=read_only(before),
        after=read_only(after),
        total_before=read_only(before + rnea.before) if known else None,
        total_after=read_only(by_motors) if known else None,
        brake_load=read_only(by_brakes),
        self_motion=read_only(before - carried),
    )


def changes_of_unit_forces(
    reduced: ReducedJacobian, task: Task
) -> tuple[tuple[ForceChange, TorqueChange], ...]:
    """Return the changes for 1 N (1 N·m) along each task axis, without gravity and limits.

    Parameters
    ----------
    reduced, task :
        The decomposed Jacobians and the task.
    """
    changes = []
    nothing = read_only(np.zeros(reduced.n))
    rnea = RneaChange(None, None, None, nothing, nothing)
    for unit in np.eye(task.m):
        F = supported_force(reduced, task.weigh_force(unit))
        load = TipLoad(F, read_only(unit.copy()), None)
        changes.append(change_of_load(reduced, task, load, rnea, None))
    return tuple(changes)


def change_of_velocity(reduced: ReducedJacobian, task: Task, v: Vector) -> VelocityChange:
    """Return the velocities before the fault and after the velocity remap of Appendix A.

    Parameters
    ----------
    reduced, task :
        The decomposed Jacobians and the task.
    v :
        Joint velocities before the fault, rad/s or m/s, shape (n,).
    """
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


def impact_of_lock(reduced: ReducedJacobian, task: Task, J: Matrix, M: Matrix, v: Vector) -> Impact:
    """Return the velocities immediately after joints lock; J is the unweighted task Jacobian.

    Parameters
    ----------
    reduced, task :
        The decomposed Jacobians and the task.
    J :
        Unweighted task Jacobian, shape (m, n).
    M :
        Mass matrix, shape (n, n).
    v :
        Joint velocities before the fault, rad/s or m/s, shape (n,).
    """
    after = velocity_after_impact(M, reduced.locked, v)
    jump = read_only(J.dot(after - v))
    linear, angular = split_norms(task, jump)
    return Impact(read_only(after), read_only(J.dot(after)), jump, linear, angular)


def _force_change(task: Task, load: TipLoad, F_after: Vector, jump: Vector) -> ForceChange:
    before = read_only(task.unweigh_force(load.F))
    jump = read_only(task.unweigh_force(jump))
    linear, angular = split_norms(task, jump)
    return ForceChange(
        requested=load.requested,
        unsupported=_unsupported(task, load.requested, before),
        before=before,
        after=read_only(task.unweigh_force(F_after)),
        jump=jump,
        jump_norm=linear,
        moment_jump_norm=angular,
    )


def _no_change(
    task: Task, load: TipLoad, before: Vector, carried: Vector, rnea: RneaChange
) -> tuple[ForceChange, TorqueChange]:
    """Return the changes for a fault after which no force is feasible."""
    F = read_only(task.unweigh_force(load.F))
    unsupported = _unsupported(task, load.requested, F)
    total = read_only(before + rnea.before) if rnea.is_known else None
    force = ForceChange(load.requested, unsupported, F, None, None, None, None)
    return force, TorqueChange(
        read_only(before), None, total, None, None, read_only(before - carried)
    )


def _unsupported(task: Task, requested: Vector | None, before: Vector) -> Vector:
    return read_only(np.zeros(task.m) if requested is None else requested - before)


def split_norms(task: Task, x: Vector) -> tuple[float | None, float | None]:
    """Return the norms of the linear and the angular components; ``None`` if there are none.

    Parameters
    ----------
    task :
        The task.
    x :
        Unweighted force or tip velocity, shape (m,).
    """
    if not task.moment_rows:
        return math.sqrt(x.dot(x)), None
    linear = float(np.linalg.norm(x[list(task.force_rows)])) if task.force_rows else None
    return linear, float(np.linalg.norm(x[list(task.moment_rows)]))
