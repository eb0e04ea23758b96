"""The question of a sweep, checked once and converted to arrays, and its evaluation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ftforce.batch.kernels.layout import Answers, Block, Faults, Mechanism, aligned
from ftforce.batch.kernels.layout import Question as KernelQuestion
from ftforce.core.arrays import read_only
from ftforce.core.faults import FaultSet
from ftforce.core.joint_scale import UNWEIGHTED
from ftforce.core.limits import middle_and_half
from ftforce.errors import InputError
from ftforce.robot.kinematics import noise_floor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ftforce.analysis.question import Question
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.joint_scale import JointScale
    from ftforce.core.limits import Limits
    from ftforce.core.task import Task
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot


def mechanism_of(
    robot: Robot,
    *,
    gravity: Vector | None = None,
    payload: Payload | None = None,
    needs_gravity: bool = True,
    scale: JointScale = UNWEIGHTED,
) -> Mechanism:
    """Return a robot as arrays.

    Every joint frame is rotated so that its axis is z: one kernel serves all joint types.

    Parameters
    ----------
    robot :
        The arm.
    gravity :
        In root axes, m/s², shape (3,); ``None`` uses the model's.
    payload :
        Payload at the tip.
    needs_gravity :
        Whether gravity torques are needed; if not, joints that only carry weight are left out.
    scale :
        Weights of hinges against slides.

    Raises
    ------
    InputError
        A joint of the model is neither revolute nor prismatic.
    """
    model, coordinates = robot.model, robot.coordinates
    tip = model.frames[robot.tip_frame]
    path = set(model.supports[tip.parentJoint].tolist())
    kept = [i for i in range(1, model.njoints) if needs_gravity or i in path]
    place = {joint: e for e, joint in enumerate(kept)} | {0: -1}
    rotations = {0: np.eye(3)}
    prismatic, placements = [], []
    for i in kept:
        axis, is_prismatic = _axis(model, i)
        rotations[i] = _rotation_to(axis)
        prismatic.append(is_prismatic)
        at = model.jointPlacements[i]
        to_parent = rotations[model.parents[i]].T
        placements.append(_flat(to_parent @ at.rotation @ rotations[i], to_parent @ at.translation))
    to_parent = rotations[tip.parentJoint].T
    rows = [model.joints[i].idx_v for i in kept]
    G = coordinates.G[rows]
    drivers = np.abs(G).argmax(axis=1)
    ratio = G[np.arange(len(rows)), drivers]
    mass, centre = _bodies(robot, kept, rotations, payload)
    return Mechanism(
        parent=read_only(np.array([place[model.parents[i]] for i in kept], dtype=np.int64)),
        is_prismatic=read_only(np.array(prismatic)),
        placement=read_only(np.array(placements)),
        driver=read_only(drivers.astype(np.int64)),
        ratio=read_only(ratio.copy()),
        offset=read_only(coordinates.offset[rows].copy()),
        gain=read_only(scale.weigh_torque(np.ones(robot.n))[drivers] * ratio),
        moves_tip=read_only(np.array([i in path for i in kept])),
        tip=read_only(
            _flat(to_parent @ tip.placement.rotation, to_parent @ tip.placement.translation)
        ),
        tip_parent=place[tip.parentJoint],
        mass=mass,
        centre=centre,
        gravity=robot.gravity if gravity is None else gravity,
    )


def _axis(model: pin.Model, joint: int) -> tuple[Vector, bool]:
    """Return a joint's axis in its own frame, and whether it is prismatic (motion subspace)."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    columns = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, model.nv)
    first = model.joints[joint].idx_v
    S = columns[:, first : first + model.joints[joint].nv]
    linear, angular = np.linalg.norm(S[:3]), np.linalg.norm(S[3:])
    if S.shape[1] != 1 or min(linear, angular) > 1e-12:
        raise InputError(f"joint {model.names[joint]!r} is neither revolute nor prismatic")
    is_prismatic = bool(linear > angular)
    axis: Vector = S[:3, 0] if is_prismatic else S[3:, 0]
    return axis, is_prismatic


def _rotation_to(axis: Vector) -> Matrix:
    """Return a rotation that maps z to the axis."""
    aligned: Matrix = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).matrix()
    return aligned


def _flat(R: Matrix, p: Vector) -> Vector:
    return np.concatenate([R.ravel(), p])


def _bodies(
    robot: Robot, kept: list[int], rotations: dict[int, Matrix], payload: Payload | None
) -> tuple[Vector, Matrix]:
    """Return the mass and centre of mass carried by each joint, in the rotated frames."""
    model = robot.model
    tip = model.frames[robot.tip_frame]
    masses, centres = [], []
    for i in kept:
        mass, lever = model.inertias[i].mass, model.inertias[i].lever
        if payload is not None and i == tip.parentJoint:
            place = tip.placement.act(payload.offset)
            total = mass + payload.mass
            lever = (mass * lever + payload.mass * place) / total if total > 0.0 else lever
            mass = total
        masses.append(mass)
        centres.append(rotations[i].T @ lever)
    return read_only(np.array(masses)), read_only(np.array(centres))


_PAGE, _APART = 4096, 5 * 64  # bytes


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """All that a worker needs to evaluate postures: arrays and numbers only, so it can be pickled.

    Attributes
    ----------
    mechanism, faults, question :
        Arguments of the kernels.
    n :
        Number of joints.
    has_moment_jump :
        Whether the task has both forces and moments, whose jumps have different units.
    """

    mechanism: Mechanism
    faults: Faults
    question: KernelQuestion
    n: int
    has_moment_jump: bool

    @classmethod
    def of(cls, question: Question, sets: Sequence[FaultSet], *, needs_gravity: bool) -> Plan:
        """Return what the kernels compute for a question.

        Parameters
        ----------
        question, sets :
            What is asked, and of which sets.
        needs_gravity :
            Whether gravity torques are needed.

        Raises
        ------
        InputError
            As for `mechanism_of`.
        """
        robot, task, conditions = question.robot, question.task, question.conditions
        own = None if conditions.is_model_gravity else conditions.gravity
        return cls(
            mechanism_of(
                robot,
                gravity=own,
                payload=conditions.payload,
                needs_gravity=needs_gravity,
                scale=question.scale,
            ),
            faults_of(sets, robot.n),
            question_of(
                task,
                robot.n,
                force=question.force,
                direction=question.direction,
                limits=question.limits,
                friction=question.friction.torque,
                rtol=question.rtol,
                wary=question.wary,
                floors=noise_floor(robot),
                needs_gravity=needs_gravity,
                scale=question.scale,
            ),
            robot.n,
            bool(task.force_rows and task.moment_rows),
        )

    def evaluator(self) -> Evaluator:
        """Return an evaluator; use one per thread, since it owns a workspace."""
        return Evaluator(self)


class Evaluator:
    """Evaluates blocks of postures.

    Parameters
    ----------
    plan :
        What to compute.
    """

    def __init__(self, plan: Plan) -> None:
        from ftforce.batch.kernels import fast, settle

        self.plan = plan
        m = plan.question.rows.size
        self._work = fast.workspace(plan.mechanism.parent.size, plan.n, m)
        self._pairs = settle.workspace(m, plan.n)

    def __call__(self, q: Matrix) -> Block:
        """Return the results for postures.

        Parameters
        ----------
        q :
            Joint positions, rad or m, C-contiguous, shape (k, n).
        """
        answers = empty_answers(self.plan, len(q))
        self._fill(answers, q)
        return as_block(answers)

    def _fill(self, answers: Answers, q: Matrix) -> None:
        from ftforce.batch.kernels import fast

        plan = self.plan
        fast.evaluate(plan.mechanism, plan.faults, plan.question, q, answers, self._work)
        self._settle(answers, q)

    def _settle(self, answers: Answers, q: Matrix) -> None:
        """Evaluate what the fast kernels left undecided."""
        from ftforce.batch.kernels import settle

        plan, work = self.plan, self._work
        settle.settle(plan.mechanism, plan.faults, plan.question, q, answers, work, self._pairs)


def empty_answers(plan: Plan, k: int) -> Answers:
    """Return uninitialized result arrays for k postures.

    Parameters
    ----------
    plan :
        What to compute, for S fault sets.
    k :
        Number of postures.
    """
    S, has_force = len(plan.faults.locked), plan.question.force.size > 0
    has_direction = plan.question.direction.size > 0
    sizes: dict[str, tuple[tuple[int, ...], type]] = {
        "tip": ((k, 3), np.float64),
        "rank": ((k,), np.int8),
        "healthy_margin": ((k,), np.float64),
        "verdict": ((S, k), np.int8),
        "rank_lost": ((S, k), np.int8),
        "sigma_min": ((S, k), np.float64),
        "margin": ((S, k), np.float64),
        "rho": ((S, k), np.float64),
        "jump": ((S, k) if has_force else (0, 0), np.float64),
        "moment_jump": ((S, k) if has_force and plan.has_moment_jump else (0, 0), np.float64),
        "relative_jump": ((S, k) if has_force else (0, 0), np.float64),
        "capability": ((S, k) if has_direction else (0, 0), np.float64),
    }
    # Vector stores that straddle two cache lines take twice as long. Arrays at the same page
    # offset suffer from 4K aliasing: the processor mistakes a load for one of a recent store.
    arrays = {
        name: aligned(shape, kind, _PAGE, at * _APART)
        for at, (name, (shape, kind)) in enumerate(sizes.items())
    }
    return Answers(**arrays)


def as_block(answers: Answers) -> Block:
    """Return the results as a `Block`, ``None`` for what was not requested."""
    given: dict[str, Any] = answers._asdict()
    for name in ("jump", "moment_jump", "relative_jump", "capability"):
        if not given[name].shape[0]:
            given[name] = None
    return Block(**given)


def faults_of(sets: Sequence[FaultSet], n: int) -> Faults:
    """Return fault sets as arrays.

    Parameters
    ----------
    sets :
        Sets of locked and free joints.
    n :
        Number of joints.
    """
    locked = np.array([one.mask(n) for one in sets]).reshape(-1, n)
    free = np.zeros_like(locked)
    for row, one in zip(free, sets, strict=True):
        row[list(one.free)] = True
    start = np.concatenate([[0], np.cumsum(locked.sum(axis=1))]).astype(np.int64)
    joints = np.nonzero(locked)[1].astype(np.int64)
    has_free = np.asarray(free.any(axis=1))
    arrays: list[NDArray[Any]] = [locked, free, has_free, start, joints]
    return Faults(*map(read_only, arrays))


def question_of(
    task: Task,
    n: int,
    *,
    force: Vector | None,
    direction: Vector | None,
    limits: Limits | None,
    friction: Vector | None = None,
    rtol: float,
    wary: float,
    floors: tuple[float, float] = (0.0, 0.0),
    needs_gravity: bool,
    scale: JointScale = UNWEIGHTED,
) -> KernelQuestion:
    """Return the question as arrays.

    Parameters
    ----------
    task :
        The task.
    n :
        Number of joints.
    force, direction :
        Unweighted, in the task's axes, shape (m,); ``None`` if not requested.
    limits :
        Torque limits for the capability; ``None`` for unlimited.
    friction :
        Torques that the friction of free-swinging joints bears, NaN where unknown, shape (n,);
        ``None`` for ideal joints.
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    needs_gravity :
        Whether gravity torques are needed.
    floors :
        Entries up to which J is rounding, `ftforce.robot.kinematics.noise_floor`.
    scale :
        Weights of hinges against slides.
    """
    rows = np.arange(6)[task.rows].astype(np.int64)
    unknown = np.full(n, np.nan)
    nothing = np.zeros(0)
    motors = unknown if limits is None else limits.largest_torques(FaultSet())
    middle, half = middle_and_half(motors)
    weights = np.ones(task.m) if task.weights is None else task.weights
    return KernelQuestion(
        rows=read_only(rows),
        weights=read_only(weights.copy()),
        floor=read_only(
            scale.weigh_jacobian(
                np.repeat((weights * np.where(rows < 3, *floors))[:, None], n, axis=1)
            )
        ),
        in_tool=task.axes == "tool",
        is_whole=rows.tolist() in ([0, 1, 2], [3, 4, 5], [0, 1, 2, 3, 4, 5]),
        force=read_only(nothing if force is None else task.weigh_force(force).copy()),
        direction=read_only(nothing if direction is None else task.weigh_force(direction).copy()),
        effort=read_only(scale.weigh_torque(half).copy()),
        middle=read_only(scale.weigh_torque(middle).copy()),
        brake=read_only(scale.weigh_torque(unknown if limits is None else limits.brake).copy()),
        friction=read_only(
            np.zeros(n) if friction is None else scale.weigh_torque(friction).copy()
        ),
        rtol=rtol,
        wary=wary,
        needs_gravity=needs_gravity,
    )
