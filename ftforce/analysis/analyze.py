"""Analyse one fault set in one posture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.conditions import Inverse, known_mass_matrix, rnea_change
from ftforce.analysis.fault_names import named_faults
from ftforce.analysis.question import Answered, Question
from ftforce.analysis.warnings import (
    beyond_limits,
    implausible,
    lacking_rank,
    missing_masses,
    overload,
    unjudged,
    unknown_impact,
)
from ftforce.core import measures
from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.core.changes import (
    ForceChange,
    Impact,
    RneaChange,
    TorqueChange,
    VelocityChange,
    change_of_load,
    change_of_velocity,
    changes_of_unit_forces,
    impact_of_lock,
)
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.limits import both_sides
from ftforce.core.reduced_jacobian import (
    BORDERLINE_RTOL,
    RTOL,
    ReducedJacobian,
    reduce,
)
from ftforce.core.remap import PROOF_TOLERANCE, Jump, force_residuals
from ftforce.core.verdict import judge
from ftforce.robot.kinematics import task_jacobian

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.fault_names import Joints, WeakJoints
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.core.bounded_remap import BoundedRemap
    from ftforce.core.task import Axes, Task
    from ftforce.core.verdict import Verdict
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class Analysis(Answered):
    """Effect of one fault set on an arm in one posture.

    Attributes
    ----------
    question :
        What was asked. Its parts are attributes too: robot, task, posture, faults, conditions,
        limits, inverse, rtol and wary.
    J :
        Task Jacobian, unweighted, in task axes, shape (m, n).
    reduced :
        Weighted Jacobians before and after the fault, with their ranks.
    rnea :
        Torques for weight and motion.
    force, torque :
        Change of tip force and motor torques; ``None`` if neither a force nor torques were given.
    unit_forces :
        Change for a force of 1 N (1 N·m) along each task axis and the torques for it, without
        weight and limits; empty if a force or torques were given.
    bounded :
        The remap under torque limits or with free-swinging joints, for the given force or for zero
        force; ``None`` where the closed form applies.
    velocity :
        Change of the velocities; ``None`` if none were given.
    impact :
        Velocities right after the lock; ``None`` without a velocity, without locked joints, or
        without physically valid masses.
    verdict :
        Verdict for the given force, or for all forces if none was given.
    """

    question: Question
    J: Matrix
    reduced: ReducedJacobian
    rnea: RneaChange
    force: ForceChange | None
    torque: TorqueChange | None
    unit_forces: tuple[tuple[ForceChange, TorqueChange], ...]
    bounded: BoundedRemap | None
    velocity: VelocityChange | None
    impact: Impact | None
    verdict: Verdict

    @property
    def posture(self) -> Posture:
        """The posture, with its source."""
        return self.question.place

    @property
    def faults(self) -> FaultSet:
        """The fault set."""
        return self.question.faults

    @property
    def inverse(self) -> Inverse:
        """Inverse that splits given torques into force and self-motion."""
        return self.question.inverse

    @property
    def locked(self) -> tuple[str, ...]:
        """Names of the locked joints."""
        return tuple(self.robot.names[i] for i in self.faults.in_mode(FaultMode.LOCKED))

    @property
    def modes(self) -> dict[str, FaultMode]:
        """Fault mode of each failed joint, by name."""
        return {self.robot.names[fault.joint]: fault.mode for fault in self.faults.faults}

    @property
    def can_stand_still(self) -> bool:
        """Whether motors, brakes and some tip force can hold the arm after the fault."""
        return self.bounded is None or self.bounded.F_after is not None

    @cached_property
    def unknown_limits(self) -> tuple[int, ...]:
        """Indices of the joints whose motor or brake limit is unknown and not enforced."""
        if self.limits is None:
            return ()
        _, upper = both_sides(self.limits.largest_torques(self.faults))
        return tuple(np.flatnonzero(np.isnan(upper)).tolist())

    @property
    def margin(self) -> float:
        """σ_min(K)/σ_max(J)."""
        return measures.margin(self.reduced)

    @property
    def condition_number(self) -> float:
        """σ_max(K)/σ_min(K); infinite if K does not have full rank."""
        return measures.condition_number(self.reduced)

    @property
    def relative_manipulability(self) -> float:
        """ρ = w(K)/w(J); NaN where the healthy arm is singular for this task."""
        return measures.relative_manipulability(self.reduced)

    @property
    def force_error(self) -> float:
        """Largest error of the weighted tip force per N·m of torque error.

        It is 1/σ, with σ the smallest singular value of K that is not lost; infinite if K has rank
        0.
        """
        return measures.force_error(self.reduced)

    @cached_property
    def lost_directions(self) -> Matrix:
        """Lost directions of the weighted force, orthonormal rows, shape (lost, m)."""
        return measures.lost_directions(self.reduced)

    @cached_property
    def force_contributions(self) -> Vector | None:
        """Contribution of each joint to the tip force, ‖(Jᵀ)†_k τ_k‖/‖F̂‖ (Table 2), shape (n,)."""
        if self.force is None or self.torque is None:
            return None
        F = self.task.weigh_force(self.force.before)
        tau = self.scale.weigh_torque(self.torque.before)
        return measures.force_contributions(self.reduced, tau, F)

    @cached_property
    def velocity_contributions(self) -> Vector | None:
        """Contribution of each joint to the tip velocity, ‖J_k v_k‖/‖J v‖ (Table 2), shape (n,)."""
        if self.velocity is None:
            return None
        v = self.scale.weigh_velocity(self.velocity.before)
        return measures.velocity_contributions(self.reduced.J, v)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result, such as exceeded limits."""
        found = [*self.posture.warnings, *lacking_rank(self.reduced, self.task)]
        found += missing_masses(self.rnea)
        moves = self.conditions.moves or self.question.inverse == "dynamic"
        found += implausible(self.question, needs_gravity=True, needs_inertia=moves)
        if self.velocity is not None and self.impact is None and self.rnea.is_known:
            found += unknown_impact(self.faults)
        if self.limits is None:
            found += beyond_limits(self.robot, self.faults, self._needed())
        else:
            found += unjudged(self.robot, self.faults, self.limits)
        if self.force is not None and self.can_stand_still and self.bounded is not None:
            found += overload(self.robot, self.bounded.overloaded)
        return tuple(found)

    def _needed(self) -> Vector | None:
        """Return the motor torques after the fault; without a force, those for the weight."""
        if not self.can_stand_still:
            return None
        if self.torque is None:
            return np.where(self.reduced.commanding, load_without_force(self), 0.0)
        total, after = self.torque.total_after, self.torque.after
        return after if total is None else total

    def residuals(self) -> Mapping[str, float]:
        """Return the relative residuals of the equations that the result must satisfy; 0 is exact.

        Returns
        -------
        :
            ``balance``: F̂ - F_after - ΔF; ``orthogonality``: ΔF·F_after; ``uncommandable``: KᵀΔF;
            ``statics``: U - KᵀF_after; ``unchanged``: change of the healthy torques if they were
            JᵀF. Without a force, the largest values over the unit forces. With limits or
            free-swinging joints, the residuals of the quadratic program instead: ``equality``,
            ``limit``, ``optimality``; empty if it is infeasible.
        """
        if self.bounded is not None:
            return self.bounded.residuals()
        pairs = self.unit_forces
        if self.force is not None and self.torque is not None:
            pairs = ((self.force, self.torque),)
        each = [_residuals(self, force, torque) for force, torque in pairs]
        return {law: max(one[law] for one in each) for law in each[0]}

    def is_proved(self, tolerance: float = PROOF_TOLERANCE) -> bool:
        """Return whether all residuals are within tolerance.

        Parameters
        ----------
        tolerance :
            Relative tolerance, to which the rank tolerance rtol is added.
        """
        return all(value <= tolerance + self.reduced.rtol for value in self.residuals().values())


def load_without_force(analysis: Analysis) -> Vector:
    """Return the torques that hold the arm when no force is requested, N·m (N), shape (n,).

    They comprise weight, motion, and the tip force that supports free-swinging joints.
    """
    bounded, load = analysis.bounded, analysis.rnea.after
    if bounded is not None and bounded.F_after is not None:
        load = load + analysis.scale.unweigh_torque(bounded.F_after.dot(analysis.reduced.J))
    return read_only(load)


def shown_limits(analysis: Analysis) -> tuple[Vector, Vector]:
    """Return the limits to display: those in force, or the URDF's, N·m (N).

    Returns
    -------
    :
        Lower and upper limits, each of shape (n,).
    """
    limits, v = analysis.limits, analysis.conditions.velocity
    if limits is None:
        return both_sides(np.where(analysis.reduced.locked, np.nan, analysis.robot.effort))
    return both_sides(limits.largest_torques(analysis.faults, v))


def limit_of(load: float, lower: float, upper: float) -> float:
    """Return the size of the limit that a torque approaches: of the upper one, or of the lower.

    Parameters
    ----------
    load, lower, upper :
        Torque of a motor or brake, and its limits, N·m (N).
    """
    return -lower if load < 0.0 else upper


def analyze(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    *,
    locked: Joints = (),
    free: Joints = (),
    weak: WeakJoints = (),
    force: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    payload: PayloadLike = None,
    limits: LimitsLike = None,
    friction: FrictionLike = None,
    joint_friction: bool = False,
    armature: bool = False,
    inverse: Inverse = "euclidean",
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes = "tool",
    posture: str | None = None,
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
) -> Analysis:
    """Analyse the effect of joint faults on the tip force, and compute the remapped torques.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions along the chain, rad or m, shape (n,); by default those of ``posture``.
    locked, free :
        Joints held by their brakes, and free-swinging joints: numbers from 1, names, or a boolean
        mask of shape (n,).
    weak :
        Joints with a reduced torque limit and the remaining fraction, ``{3: 0.5}`` or ``"3:0.5"``.
    force :
        Force the tool exerts on its environment, N and N·m, in task axes, shape (m,).
    torque :
        Motor torques for the tip force, without those for weight and motion, N·m (N), shape (n,),
        as an alternative to ``force``. If neither is given, all unit forces are analysed.
    velocity, acceleration :
        Joint velocities and accelerations before the fault, rad or m, per s and per s², shape (n,).
    gravity :
        In root axes, m/s², shape (3,), or how the root is mounted: ``floor``, ``wall`` (its x axis
        points down), ``ceiling``, or ``"ROLL,PITCH"`` in degrees; by default that of the model.
    payload :
        Mass at the tip, kg, or ``(mass, (x, y, z))`` with its position in tip axes, m; with its
        inertia, a TOML file (mass, centre, inertia) or `ftforce.robot.dynamics.Payload`.
    limits :
        Torque limits: ``urdf``, a TOML, YAML or CSV file, `ftforce.core.limits.Limits`, or
        ``none``. By default ``urdf`` if a joint is weak, otherwise ``none``.
    friction :
        Largest torque that the friction of a free-swinging joint bears where no force at the tip
        can balance the joint, N·m (N): one number, one per joint (shape (n,), NaN where unknown),
        or a TOML, YAML or CSV file (joint, friction); 0 is an ideal joint. By default that of the
        URDF, else 0.1 % of the joint's effort limit, else 0.1 % of the arm's largest weight torque.
    joint_friction :
        Whether the friction of the powered joints loads their motors, Coulomb and viscous,
        ``friction · sign(v) + damping · v``: of the URDF's ``<dynamics>``, or of the file of
        limits. At rest there is none; locked joints have none.
    armature :
        Whether the rotor inertia, reflected to the joints, adds to the mass matrix.
    inverse :
        Inverse that splits given torques into force and self-motion: ``euclidean`` or ``dynamic``.
    task :
        ``force``, ``moment``, ``wrench``, or components such as ``fx,fz,my``.
    length :
        Characteristic length that weighs moments against forces, m; by default 1 m.
    joint_length :
        Weighs slides against hinges: the travel of a prismatic joint, m, that counts as much as
        1 rad; by default 1 m. It has no effect unless the chain has both.
    axes :
        ``tool`` or ``world``.
    posture :
        A named posture instead of ``q``; if neither is given, a default that the result names.
    rtol :
        Singular values up to ``rtol · σ_max(J)`` count as lost.
    wary :
        The verdict is *borderline* if some tolerance up to this value changes it.

    Raises
    ------
    InputError
        An argument is invalid; the message says what is expected.
    LimitsError
        The limits file cannot be read or does not fit the robot.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("dh5")
    >>> result = ftforce.analyze(arm, locked=[2, 3], force=[80, 50, 10])
    >>> result.verdict.value, round(result.force.jump_norm, 2)
    ('not tolerated', 80.0)
    """
    return analyze_question(
        Question.parse(
            robot,
            faults=named_faults(robot, locked, free, weak),
            force=force,
            torque=torque,
            velocity=velocity,
            acceleration=acceleration,
            gravity=gravity,
            payload=payload,
            limits=limits,
            friction=friction,
            joint_friction=joint_friction,
            armature=armature,
            inverse=inverse,
            task=task,
            length=length,
            joint_length=joint_length,
            axes=axes,
            rtol=rtol,
            wary=wary,
        ).placed(q, posture)
    )


def analyze_question(question: Question) -> Analysis:
    """Return the analysis of one fault set in one posture.

    Raises
    ------
    InputError
        Even the healthy arm cannot exert the force, or the dynamic inverse needs masses, and the
        URDF has none.
    """
    robot, task, q, wary = question.robot, question.task, question.q, question.wary
    faults, conditions, scale = question.faults, question.conditions, question.scale
    J = task_jacobian(robot, q, task)
    locked, free = faults.mask(robot.n), question.free_joints(faults)
    reduced = reduce(read_only(question.weigh_jacobian(J)), locked, question.rtol, free)
    rnea = rnea_change(robot, q, conditions, locked, faults.free_mask(robot.n))
    weighted, largest = rnea.weighed(scale), question.largest_torques(faults)
    load = question.load(reduced)
    F = None if load is None else load.F
    if not question.has_force_to_keep(reduced, F):
        raise question.nothing_to_keep()
    bounded = None
    if largest is not None or free is not None:
        from ftforce.core.bounded_remap import remap_inside  # lazy: not for the closed form

        wanted = np.zeros(task.m) if F is None else F
        bounded = remap_inside(reduced, wanted, weighted.after, largest)
    change = None if load is None else change_of_load(reduced, task, load, weighted, bounded)
    return Analysis(
        question=question,
        J=read_only(J),
        reduced=reduced,
        rnea=rnea,
        force=change[0] if change else None,
        torque=change[1].unweighed(scale) if change else None,
        unit_forces=() if change else _unit_forces(question, reduced),
        bounded=bounded,
        velocity=_velocity_change(question, reduced),
        impact=_impact(question, reduced, J),
        verdict=judge(reduced, F, wary, bounded, largest),
    )


def _velocity_change(question: Question, reduced: ReducedJacobian) -> VelocityChange | None:
    v, scale = question.conditions.velocity, question.scale
    if v is None:
        return None
    change = change_of_velocity(reduced, question.task, scale.weigh_velocity(v))
    return change.unweighed(scale)


def _unit_forces(
    question: Question, reduced: ReducedJacobian
) -> tuple[tuple[ForceChange, TorqueChange], ...]:
    changes = changes_of_unit_forces(reduced, question.task)
    return tuple((force, torque.unweighed(question.scale)) for force, torque in changes)


def _impact(question: Question, reduced: ReducedJacobian, J: Matrix) -> Impact | None:
    v = question.conditions.velocity
    if v is None or not reduced.locked.any():
        return None
    M = known_mass_matrix(question.robot, question.q, question.conditions)
    # Only the impact needs M; a warning reports its lack.
    return None if M is None else impact_of_lock(reduced, question.task, J, M, v)


def _residuals(analysis: Analysis, force: ForceChange, torque: TorqueChange) -> dict[str, float]:
    reduced, task = analysis.reduced, analysis.task
    assert force.after is not None
    assert force.jump is not None
    assert torque.after is not None
    weighted = Jump(*map(task.weigh_force, (force.before, force.after, force.jump)))
    weigh = analysis.scale.weigh_torque
    laws = force_residuals(reduced, weigh(torque.after), weighted)
    change = weigh(torque.after + torque.self_motion - torque.before)[~reduced.locked]
    scale = float(np.linalg.norm(weigh(torque.before)))
    laws["unchanged"] = float(np.linalg.norm(change)) / scale if scale > 0.0 else 0.0
    return laws
