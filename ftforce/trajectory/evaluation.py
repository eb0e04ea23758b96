"""Forces and torques of a moving arm at each instant, with and without the remap.

With the remap, every instant is analysed as by `ftforce.analyze`. Without it, the controller
measures positions and velocities and commands all motors, for gravity, motion and force, as if they
were healthy; the resulting tip force follows from the mechanics.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.conditions import known_mass_matrix, without_rounding
from ftforce.core import measures
from ftforce.core.arrays import Vector, read_only, safe_divide
from ftforce.core.bounded_remap import remap_inside
from ftforce.core.feasible_forces import friction_under
from ftforce.core.limits import both_sides
from ftforce.core.reduced_jacobian import ReducedJacobian, reduce
from ftforce.core.remap import dynamically_exerted_force, exerted_force, force_jump, supported_force
from ftforce.core.verdict import CODES, Verdict, judge, verdict
from ftforce.robot.dynamics import rnea_torque
from ftforce.robot.kinematics import (
    quaternion,
    rotation_vector,
    tip_pose_and_jacobian,
    without_noise,
)
from ftforce.trajectory.history import MOTIONS, QUANTITIES, SCALARS, Run, width

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from ftforce.analysis.question import Question
    from ftforce.core.arrays import Mask, Matrix
    from ftforce.core.faults import FaultSet
    from ftforce.core.reduced_jacobian import FreeJoints
    from ftforce.trajectory.fault_events import Phase
    from ftforce.trajectory.reference import Motion

_CHUNK = 500  # instants per progress tick


class _FaultConstraints(NamedTuple):
    """Masks and torque limits of a fault set.

    Attributes
    ----------
    locked :
        True at locked joints, shape (n,).
    free :
        Free-swinging joints; ``None`` if there are none.
    limits :
        Weighted torque limits in force, as of `Question.largest_torques`; ``None`` if none.
    known_limits :
        The same, unweighted; if no limits are in force, those of the URDF.
    faults :
        The fault set.
    """

    locked: Mask
    free: FreeJoints | None
    limits: Vector | None
    known_limits: Vector
    faults: FaultSet

    @classmethod
    def of(cls, case: Question, faults: FaultSet) -> _FaultConstraints:
        """Return the masks and limits of a fault set."""
        n = case.robot.n
        limits = None if case.limits is None else case.limits.largest_torques(faults)
        motors = case.robot.effort * faults.factors(n)
        known = np.where(faults.mask(n), np.nan, motors)
        if limits is not None:
            known, limits = limits, case.scale.weigh_torque(limits)
        return cls(faults.mask(n), case.free_joints(faults), limits, known, faults)

    def moving(self, case: Question, v: Vector) -> _FaultConstraints:
        """Return the same with the limits at a velocity, rad/s or m/s, shape (n,)."""
        if case.limits is None or case.limits.line is None:
            return self
        limits = case.limits.largest_torques(self.faults, v)
        return self._replace(limits=case.scale.weigh_torque(limits), known_limits=limits)

    def sides(self, case: Question, v: Matrix | None) -> tuple[Matrix, Matrix]:
        """Return the known lower and upper limits, shape (n,), or (N, n) if they depend on v.

        Parameters
        ----------
        case :
            What is asked.
        v :
            Joint velocities, rad/s or m/s, shape (N, n); ``None`` at rest.
        """
        if v is None or case.limits is None or case.limits.line is None:
            return both_sides(self.known_limits)
        sides = [both_sides(self.moving(case, one).known_limits) for one in v]
        return np.array([lower for lower, _ in sides]), np.array([upper for _, upper in sides])


class TipPath(NamedTuple):
    """Reference of the tip: position (m) and velocity (m/s), shape (N, 3), and orientation."""

    x: Matrix
    x_dot: Matrix
    orientation: Matrix | None


class _FaultKnowledge(NamedTuple):
    """Actual faults, and those the controller assumes; ``None`` if it knows the actual ones."""

    actual: _FaultConstraints
    assumed: _FaultConstraints | None

    def moving(self, case: Question, v: Vector) -> _FaultKnowledge:
        """Return the same with the limits at a velocity, rad/s or m/s, shape (n,)."""
        assumed = None if self.assumed is None else self.assumed.moving(case, v)
        return _FaultKnowledge(self.actual.moving(case, v), assumed)


class _Balance(NamedTuple):
    """Weighted tip force and the matching weighted torques; NaN if the arm cannot be held.

    Attributes
    ----------
    F, F_after :
        Force that the healthy arm exerts here, and force that is exerted, shape (m,).
    U, motor :
        Motor torques for the force, and total motor torques, shape (n,).
    unbalanced :
        Torques that are not balanced, shape (n,).
    reduced :
        The decomposed Jacobians.
    verdict :
        Whether the force is kept.
    """

    F: Vector
    F_after: Vector
    U: Vector
    motor: Vector
    unbalanced: Vector
    reduced: ReducedJacobian
    verdict: Verdict

    @property
    def torques(self) -> tuple[Vector, ...]:
        """``U``, ``motor``, ``unbalanced``, and the torques for the two forces."""
        J = self.reduced.J
        return self.U, self.motor, self.unbalanced, self.F.dot(J), self.F_after.dot(J)


def run_of(
    case: Question,
    motion: Motion,
    reference: TipPath,
    times: Vector,
    phases: Sequence[Phase],
    *,
    tick: Callable[[int], None],
    same: Run | None = None,
    is_static: bool = False,
) -> Run:
    """Return the forces, torques and verdicts of a motion at each instant.

    Parameters
    ----------
    case :
        What is asked at every instant, with a force.
    motion :
        The joint motion.
    reference :
        Reference of the tip.
    times, phases :
        Sample times, s, and the actual and known faults over time.
    tick :
        Called with the number of instants just completed.
    same :
        A run with the same fault-free phases, which are copied instead of computed again.
    is_static :
        Whether velocities and accelerations are left out of the torques.
    """
    if same is not None and not any(phase.actual for phase in phases):
        tick(len(times))
        return same
    run = _empty_run(case, motion)
    rows = [int(np.searchsorted(times, phase.start)) for phase in phases] + [len(times)]
    for phase, first, last in zip(phases, rows, rows[1:], strict=False):
        if same is not None and not phase.actual:
            for name in QUANTITIES:
                getattr(run, name)[first:last] = getattr(same, name)[first:last]
            tick(last - first)
            continue
        actual, assumed = (
            _FaultConstraints.of(case, faults) for faults in (phase.actual, phase.known)
        )
        knowledge = _FaultKnowledge(actual, None if phase.actual == phase.known else assumed)
        for i in range(first, last):
            _fill(run, i, case, reference, knowledge, is_static=is_static)
            done = i + 1 - first
            if not done % _CHUNK or i + 1 == last:
                tick((done - 1) % _CHUNK + 1)
        _finish(run, slice(first, last), case, reference, actual, is_static=is_static)
    _without_sign_changes(run.orientation)
    return Run(*(_compact(getattr(run, name)) for name in QUANTITIES))


def _compact(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array, read-only; if all its rows are the same, they share memory."""
    bits = array.view(f"i{array.itemsize}")  # NaN, and the sign of 0, count too
    if len(array) and (bits == bits[0]).all():
        return np.broadcast_to(array[:1].copy(), array.shape)
    return read_only(array)


def _empty_run(case: Question, motion: Motion) -> Run:
    count, n, m = len(motion.q), case.robot.n, case.task.m
    rest = [name for name in QUANTITIES if name not in {*MOTIONS, *SCALARS}]
    arrays = {name: np.zeros((count, width(name, n, m) or 1)) for name in rest}
    arrays["used"].fill(np.nan)  # stays NaN where there is no known limit
    return Run(*motion, **arrays, margin=np.zeros(count), verdict=np.zeros(count, dtype=np.int8))


def _fill(
    run: Run,
    i: int,
    case: Question,
    reference: TipPath,
    knowledge: _FaultKnowledge,
    *,
    is_static: bool,
) -> None:
    """Compute the quantities of one instant; `_finish` completes them for a whole phase."""
    robot, task, scale = case.robot, case.task, case.scale
    q, v, a = run.q[i], run.v[i], run.a[i]
    R, run.position[i], J = tip_pose_and_jacobian(robot, q)
    run.orientation[i] = quaternion(R)
    if reference.orientation is not None:
        run.orientation_error[i] = rotation_vector(reference.orientation @ R.T)
    run.velocity_jump[i] = J[:3].dot(v)
    if task.axes == "tool":
        J = np.matmul(R.T, J.reshape(2, 3, -1)).reshape(6, -1)
    J = case.weigh_jacobian(without_noise(robot, np.ascontiguousarray(J[task.rows]), task))
    own = None if case.conditions.is_model_gravity else case.conditions.gravity
    if is_static:
        v = a = robot.at_rest
    free = knowledge.actual.free
    terms = case.conditions.terms_after(None if free is None else free.mask)
    rnea = rnea_torque(robot, q, v, a, gravity=own, payload=case.conditions.payload, drives=terms)
    knowledge = knowledge.moving(case, v)
    found = _balance(case, q, J, scale.weigh_torque(rnea), knowledge)
    run.rnea[i] = rnea
    torques = (run.U, run.motor, run.unbalanced, run.force_part, run.brake)
    for all_torques, torque in zip(torques, found.torques, strict=True):
        all_torques[i] = scale.unweigh_torque(torque)
    run.force[i], run.jump[i] = found.F_after, found.F - found.F_after
    run.margin[i] = measures.margin(found.reduced)
    run.verdict[i] = CODES[found.verdict]


def _finish(
    run: Run,
    here: slice,
    case: Question,
    reference: TipPath,
    actual: _FaultConstraints,
    *,
    is_static: bool,
) -> None:
    """Complete the quantities of a phase: errors, brake loads, limit usage and unweighting."""
    run.path_error[here] = reference.x[here] - run.position[here]
    run.velocity_jump[here] -= reference.x_dot[here]
    run.brake[here] = np.where(actual.locked, run.rnea[here] + run.brake[here], 0.0)
    load = np.where(actual.locked, run.brake[here], run.motor[here])
    lower, upper = actual.sides(case, None if is_static else run.v[here])
    limit = np.broadcast_to(np.where(load < 0.0, -lower, upper), load.shape)
    limited = upper > lower  # excludes unknown limits (NaN) and free joints (0)
    limited = np.broadcast_to(limited, load.shape)
    with np.errstate(divide="ignore"):  # no torque at all in this direction
        run.used[here][limited] = np.abs(load[limited]) / limit[limited]
    run.force[here] = case.task.unweigh_force(run.force[here])
    run.jump[here] = case.task.unweigh_force(run.jump[here])


def _with_remap(case: Question, J: Matrix, rnea: Vector, faults: _FaultConstraints) -> _Balance:
    """Return force and torques after the remap, as `ftforce.analyze` computes them."""
    locked, free, limits, *_ = faults
    reduced = reduce(read_only(J), locked, case.rtol, free)
    assert case.F is not None  # a simulation requires a force
    F = supported_force(reduced, case.F)
    if reduced.rank < reduced.m:
        F = without_rounding(F, F, case.F)
    bounded = None
    if limits is None and free is None:
        F_after: Vector | None = force_jump(reduced, F).F_after
    else:
        bounded = remap_inside(reduced, F, rnea, limits)
        F_after = bounded.F_after
    verdict = judge(reduced, F, case.wary, bounded, limits)
    if F_after is None:
        nothing = np.full(len(rnea), np.nan)
        lost = np.full(len(F), np.nan)
        return _Balance(F, lost, nothing, nothing, nothing, reduced, verdict)
    U = np.where(reduced.commanding, F_after.dot(J), 0.0)
    motor = np.where(reduced.commanding, rnea + U, 0.0)
    return _Balance(F, F_after, U, motor, np.zeros(len(rnea)), reduced, verdict)


def _without_sign_changes(quaternions: Matrix) -> None:
    """Choose the signs of quaternions so that neighbouring ones are close (q and -q agree)."""
    turned = np.where(np.vecdot(quaternions[1:], quaternions[:-1]) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(turned)[:, None]


def _balance(
    case: Question, q: Vector, J: Matrix, rnea: Vector, knowledge: _FaultKnowledge
) -> _Balance:
    actual, assumed = knowledge
    if assumed is None:
        return _with_remap(case, J, rnea, actual)
    if case.limits is None and actual.free is None and assumed.free is None:
        # Locks alone do not change the torques of the healthy joints.
        return _with_remap(case, J, rnea, actual)
    return _without_remap(case, q, J, rnea, knowledge)


def _without_remap(
    case: Question, q: Vector, J: Matrix, rnea: Vector, knowledge: _FaultKnowledge
) -> _Balance:
    """Return the force that results from torques commanded for the assumed faults."""
    actual, assumed = knowledge
    assert assumed is not None
    planned = _with_remap(case, J, rnea, assumed)
    reduced = reduce(read_only(J), actual.locked, case.rtol, actual.free)
    if np.isnan(planned.motor).any():  # the arm cannot be held even with the assumed faults
        return planned._replace(reduced=reduced, verdict=Verdict.NOT_TOLERATED)
    motor = np.where(reduced.commanding, planned.motor, 0.0)
    if case.limits is not None:  # motor torques saturate at their limits
        known = case.scale.weigh_torque(actual.known_limits)
        lower, upper = both_sides(known)
        motor = np.fmin(np.fmax(motor, lower), upper)  # NaN is unknown
    moving = ~actual.locked
    rest = np.where(moving, motor - rnea, 0.0)  # left for the tip force, at joints without a brake
    if actual.free is not None:
        rest = _without_friction(rest, actual.free, rnea)
    F_after = _exerted(case, q, reduced, rest)
    unbalanced = np.where(moving, rest - F_after.dot(J), 0.0)
    if actual.free is not None:
        unbalanced = _without_friction(unbalanced, actual.free, rnea)
    U = np.where(reduced.commanding, motor - rnea, 0.0)
    scale = math.hypot(*rnea, *planned.F.dot(J))
    moved = safe_divide(math.hypot(*unbalanced), scale, 0.0)
    if moved <= case.rtol:  # below the tolerance the arm does not move
        unbalanced = np.zeros_like(unbalanced)
    verdict = _verdict(case, reduced, planned.F, F_after, moved)
    return _Balance(planned.F, F_after, U, motor, unbalanced, reduced, verdict)


def _without_friction(torque: Vector, free: FreeJoints, rnea: Vector) -> Vector:
    """Return the torques without those that friction bears at free-swinging joints."""
    borne = np.abs(torque) <= friction_under(free.friction, rnea)
    return np.where(free.mask & borne, 0.0, torque)


def _exerted(case: Question, q: Vector, reduced: ReducedJacobian, rest: Vector) -> Vector:
    """Return the tip force that torques exert while the environment keeps the tip in place.

    If masses are known, the remaining torques accelerate the arm and the dynamically consistent
    inverse applies; otherwise the Euclidean one.
    """
    # As in all other modules, ranks are decided relative to the healthy arm.
    K = np.where(reduced.locked, 0.0, reduced.J)
    lost, size = reduced.rtol * reduced.sigma_max, float(np.linalg.norm(K, 2))
    if size <= lost:  # K counts as zero
        return np.zeros(reduced.m)
    open_joints = reduce(read_only(K), np.zeros_like(reduced.locked), lost / size)
    F = exerted_force(open_joints, rest)
    left = np.where(reduced.locked, 0.0, rest - F.dot(reduced.J))
    if math.hypot(*left) <= 1e-12 * math.hypot(*rest):
        return F  # both inverses agree
    M = known_mass_matrix(case.robot, q, case.conditions)
    if M is None:
        return F
    M = case.scale.weigh_mass_matrix(M)
    # A locked joint has infinite inertia: it is decoupled from the others.
    M = np.where(reduced.locked[:, None] | reduced.locked, np.diag(np.diag(M)), M)
    return dynamically_exerted_force(open_joints, rest, M)


def _verdict(
    case: Question, reduced: ReducedJacobian, F: Vector, F_after: Vector, moved: float
) -> Verdict:
    """Return the verdict without remap, from the force jump and the unbalanced torques."""
    jump = math.hypot(*(F - F_after))
    off = max(safe_divide(jump, math.hypot(*F), math.inf if jump > 0.0 else 0.0), moved)
    if off > case.wary:
        return Verdict.NOT_TOLERATED
    if off > reduced.rtol:
        return Verdict.BORDERLINE
    return verdict(reduced, F, case.wary)
