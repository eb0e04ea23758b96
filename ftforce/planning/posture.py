"""The posture that keeps the most after the worst fault, with the tip where it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.question import AllFaultSets, AnsweredForAll
from ftforce.analysis.warnings import implausible
from ftforce.core import measures
from ftforce.core.arrays import as_vector, read_only
from ftforce.core.faults import FaultMode
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.errors import InputError, listed
from ftforce.planning.objective import Objective
from ftforce.planning.projection import project
from ftforce.planning.self_motion import REACHED, self_motion
from ftforce.planning.target import TipTarget, residual
from ftforce.robot.posture import Posture, choose_posture
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress, Question
    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.faults import FaultSet
    from ftforce.core.task import Axes, Task
    from ftforce.planning.self_motion import SelfMotion
    from ftforce.robot.robot import Robot

TIED = 1e-6
"""Relative: postures whose objectives differ by less are tied, and distance to limits decides."""
_CLIMBERS = 8  # samples from which the search goes on between the samples
_APART = 4.0  # of the step: as far as they are from each other, at least
_ROUNDS = 60  # of that search
_FINEST = 1e-8  # rad or m: its last step
_DRAWN = 12  # directions tried per round, where the self-motion has two or more dimensions


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BestPosture(AnsweredForAll):
    """The posture that keeps the most after the worst fault set, and the usual one.

    Attributes
    ----------
    objective :
        What is maximised over the worst fault set.
    all_sets :
        The fault sets.
    self_motion :
        All postures that reach the target, as far as they were found.
    values :
        The measure after the worst set at every sample, ``self_motion.q``, shape (N,).
    before, after :
        The given or usual posture at the target, and the best one.
    measured_before, measured_after :
        The measure after every set in these postures, in its unit, shape (S,).
    is_tied :
        Whether postures are as good as the best, so that the distance to the joint limits chose.
    warnings, notes :
        Warnings about the result, and what was chosen.
    """

    objective: Objective
    all_sets: AllFaultSets
    self_motion: SelfMotion
    values: Vector
    before: Posture
    after: Posture
    measured_before: Vector
    measured_after: Vector
    is_tied: bool
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def question(self) -> Question:  # type: ignore[override] # that of the objective
        """What is asked about the arm."""
        return self.objective.question

    @property
    def course(self) -> str:
        """The best posture in words, for the provenance of files."""
        return " ".join(map(repr, self.after.q.tolist()))

    @property
    def sets(self) -> tuple[FaultSet, ...]:
        """The fault sets."""
        return self.objective.sets

    def worst_set(self, measured: Vector) -> int:
        """Return the index of the worst set in one of the two postures.

        Parameters
        ----------
        measured :
            ``measured_before`` or ``measured_after``.
        """
        return int(measured.argmax() if self.objective.measure.is_cost else measured.argmin())

    @property
    def gains(self) -> Vector:
        """How much better each set is after than before, in the unit of the measure, shape (S,)."""
        with np.errstate(invalid="ignore"):  # both unlimited
            change = self.measured_after - self.measured_before
        change = np.where(self.measured_after == self.measured_before, 0.0, change)
        return -change if self.objective.measure.is_cost else change

    @property
    def bound(self) -> float | None:
        """The worst ρ that no posture exceeds (theory §6); ``None`` for other objectives."""
        if self.objective.name != "rho" or self.mode is not FaultMode.LOCKED:
            return None
        return measures.worst_manipulability_bound(self.robot.n, self.task.m, self.largest)


def best_posture(
    robot: Robot,
    at: ArrayLike | None = None,
    *,
    rpy: ArrayLike | None = None,
    like: str | ArrayLike | Posture | None = None,
    q: ArrayLike | Posture | None = None,
    posture: str | None = None,
    faults: int = 1,
    mode: FaultMode | str = FaultMode.LOCKED,
    maximize: str = "margin",
    force: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    payload: PayloadLike = None,
    limits: LimitsLike = None,
    friction: FrictionLike = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes = "tool",
    restarts: int = 128,
    step: float = 0.05,
    resolution: float | None = None,
    seed: int = 0,
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    progress: Progress | None = None,
) -> BestPosture:
    """Return the posture that keeps the most after the worst fault, with the tip at one place.

    Among all postures within the joint limits that reach the place, the one is chosen whose worst
    fault set leaves most (docs/theory/self-motion). Ties are broken by the distance to the joint
    limits. Collisions are not checked.

    Parameters
    ----------
    robot :
        The arm.
    at :
        Position of the tip in root axes, m, shape (3,); by default where ``like`` has it.
    rpy :
        Roll, pitch and yaw of the tip that are kept, as in URDF, rad, shape (3,); by default the
        tip may turn.
    like :
        Posture whose orientation of the tip is kept instead, by name or as joint positions.
    q, posture :
        Posture that the best one is compared with, as in `ftforce.analyze`: itself if its tip is at
        the place, else what the least joint motion from it reaches. By default ``like``, or the
        usual posture of the arm.
    faults, mode :
        Size of the largest fault sets, ``locked`` or ``free``.
    maximize :
        ``margin``, ``rho``, ``capability``, ``payload``, or ``jump``, which is minimised.
    force :
        Force the tool exerts on its environment, N and N·m, in task axes, shape (m,): that of the
        jump, or along which the capability is.
    direction :
        Direction of the capability, in task axes, shape (m,); by default that of the force.
    limits :
        As in `ftforce.analyze`; for capability and payload by default those of the URDF.
    gravity, payload, friction, task, length, joint_length, axes, rtol, wary :
        As in `ftforce.analyze`.
    restarts, step, resolution, seed :
        As in `ftforce.planning.self_motion.self_motion`.
    progress :
        Called with the number of steps completed and their total.

    Raises
    ------
    InputError
        An argument is invalid, or the tip cannot reach the place; then the message says how far
        away the closest posture found is.
    LimitsError
        The file of limits or friction cannot be read or does not fit the robot.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("panda")
    >>> found = ftforce.best_posture(arm, like="default", maximize="margin")
    >>> bool(found.measured_after.min() > found.measured_before.min())
    True
    """
    require_robot(robot)
    all_sets = AllFaultSets.parse(robot, faults, mode)
    objective = Objective.parse(
        robot, maximize, all_sets, force=force, direction=direction, gravity=gravity,
        payload=payload, limits=limits, friction=friction, task=task, length=length,
        joint_length=joint_length, axes=axes, rtol=rtol, wary=wary,
    )  # fmt: skip
    target, model = _target(robot, at, rpy, like)
    if model is not None and q is None and posture is None:
        given = model
    else:
        given = choose_posture(robot, q, posture, problem=objective.question.problem_in)
    search = partial(self_motion, robot, target, restarts=restarts, step=step, seed=seed)
    motion = search(start=given.q, resolution=resolution, progress=progress)
    values = objective.values(motion.q)
    best, is_tied = _best(objective, motion, values)
    before, notes = _before(motion, given)
    both = objective.measured(np.array([before.q, best]))
    if _worst(objective, both[1]) < _worst(objective, both[0]):  # outside the limits, or a spike
        within = bool(((before.q >= robot.lower) & (before.q <= robot.upper)).all())
        best, both = (before.q, both[[0, 0]]) if within else (best, both)
    return BestPosture(
        objective=objective,
        all_sets=all_sets,
        self_motion=motion,
        values=read_only(-values if objective.measure.is_cost else values),
        before=before,
        after=Posture(read_only(best), f"best {objective.name} after the worst set"),
        measured_before=read_only(both[0].copy()),
        measured_after=read_only(both[1].copy()),
        is_tied=is_tied,
        warnings=_warnings(objective, before, both[1]),
        notes=(*notes, *_about(motion)),
    )


def _target(
    robot: Robot,
    at: ArrayLike | None,
    rpy: ArrayLike | None,
    like: str | ArrayLike | Posture | None,
) -> tuple[TipTarget, Posture | None]:
    """Return what of the tip is kept, and the posture that it is like."""
    if at is None and like is None:
        raise InputError(
            "give a position of the tip (at, --at), or a posture whose tip pose is kept (like, "
            "--like)"
        )
    if rpy is not None and like is not None:
        raise InputError("give either rpy or the posture that the tip is turned like, not both")
    if like is None:
        assert at is not None
        return TipTarget.of(as_vector(at, 3, "at", "x, y, z in m"), _angles(rpy)), None
    model = choose_posture(robot, *((None, like) if isinstance(like, str) else (like, None)))
    pose = TipTarget.at_posture(robot, model.q)
    if at is not None:
        pose = TipTarget.of(as_vector(at, 3, "at", "x, y, z in m"), pose.rotation)
    return pose, model


def _angles(rpy: ArrayLike | None) -> Vector | None:
    return None if rpy is None else as_vector(rpy, 3, "rpy", "roll, pitch, yaw in rad")


# ---- the search ---------------------------------------------------------------------------------


def _worst(objective: Objective, measured: Vector) -> float:
    """Return what is maximised of the measure after every set."""
    return float(-measured.max() if objective.measure.is_cost else measured.min())


def _best(objective: Objective, motion: SelfMotion, values: Vector) -> tuple[Vector, bool]:
    """Return the best posture, and whether others are as good."""
    climbed = _climbed(objective, motion, _climbers(motion, values))
    q = np.concatenate([motion.q, climbed])
    value = np.concatenate([values, objective.values(climbed)])
    most = value.max()
    slack = TIED * abs(most) if np.isfinite(most) else 0.0
    tied = q[value >= most - slack]
    room = _room(motion.manifold.robot, tied)
    chosen: Vector = tied[int(room.argmax())].copy()
    apart = np.linalg.norm(tied - chosen, axis=1) > motion.step
    return chosen, bool(apart.any())


def _room(robot: Robot, q: Matrix) -> Vector:
    """Return the distance to the nearest limit, of half the joint's range, shape (k,)."""
    half = 0.5 * (robot.upper - robot.lower)
    counts = np.isfinite(half) & (half > 0.0)
    room = np.minimum(q - robot.lower, robot.upper - q)[:, counts] / half[counts]
    nearest: Vector = room.min(axis=1, initial=1.0)
    return nearest


def _climbers(motion: SelfMotion, values: Vector) -> Matrix:
    """Return the best samples that are apart from each other."""
    q, found = motion.q, []
    left = np.ones(len(q), dtype=np.bool_)
    for i in np.argsort(-values, kind="stable").tolist():
        if left[i]:
            found.append(i)
            left &= np.linalg.norm(q - q[i], axis=1) > _APART * motion.step
        if len(found) == _CLIMBERS:
            break
    chosen: Matrix = q[found]
    return chosen


def _climbed(objective: Objective, motion: SelfMotion, q: Matrix) -> Matrix:
    """Return postures moved uphill along the self-motion, by a pattern search.

    The worst of several sets has edges at which gradients mislead, so steps are tried: along both
    senses of a curve, or along drawn directions.
    """
    manifold, d = motion.manifold, motion.dimension
    if d == 0:
        return q
    rng = np.random.default_rng(motion.seed)
    q, value = q.copy(), objective.values(q)
    radius = np.full(len(q), motion.step)
    rows = np.arange(len(q))
    for _ in range(_ROUNDS):
        tried, reached = _around(motion, q, radius, rng)
        found = objective.values(tried.reshape(-1, q.shape[1])).reshape(tried.shape[:2])
        found = np.where(reached, found, -np.inf)
        top = found.argmax(axis=1)
        better = found[rows, top] > value
        q[better] = tried[rows, top][better]
        value = np.where(better, found[rows, top], value)
        radius = np.where(better, radius, 0.5 * radius)
        if radius.max() < _FINEST:
            break
    within = ((q >= manifold.lower) & (q <= manifold.upper)).all(axis=1)
    climbed: Matrix = q[within]
    return climbed


def _around(
    motion: SelfMotion, q: Matrix, radius: Vector, rng: np.random.Generator
) -> tuple[Matrix, Mask]:
    """Return postures around some, shape (k, tries, n), and whether they are on the self-motion."""
    basis = motion.manifold.null_spaces(q)
    d = basis.shape[1]
    directions = np.array([[1.0], [-1.0], [0.5], [-0.5]])
    if d > 1:
        drawn = rng.normal(size=(_DRAWN, d))
        drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
        directions = np.concatenate([np.eye(d), -np.eye(d), drawn])
    tried = q[:, None] + radius[:, None, None] * (directions @ basis)
    flat, manifold = tried.reshape(-1, q.shape[1]), motion.manifold
    limits = np.array([manifold.lower, manifold.upper])
    onto, reached = project(manifold.robot, flat, motion.target, iterations=12, limits=limits)
    return onto.reshape(tried.shape), reached.reshape(tried.shape[:2])


# ---- what it is compared with, and what is said ------------------------------------------------


def _before(motion: SelfMotion, given: Posture) -> tuple[Posture, list[str]]:
    """Return the posture that the best is compared with, and what was chosen."""
    manifold, target = motion.manifold, motion.target
    robot = manifold.robot
    if np.abs(residual(robot, given.q[None], target)).max() <= REACHED:
        return given, []
    (q,), (is_reached,) = project(robot, given.q[None], target)
    how = "reached from it by the least joint motion"
    if not is_reached:
        apart = manifold.between(motion.q, given.q, manifold.endless)
        q, how = motion.q[int(np.linalg.norm(apart, axis=1).argmin())].copy(), "closest to it"
    note = (
        f"the tip of the posture to compare with ({given.source}) is elsewhere; compared is {how}"
    )
    return Posture(read_only(q), f"closest to {given.source}", ()), [note]


def _about(motion: SelfMotion) -> list[str]:
    """Return what was chosen in the search for the self-motion."""
    notes = []
    if motion.target.rotation is None:
        notes.append(
            "only the position of the tip is kept; it may turn (rpy, like keep its orientation)"
        )
    if not all(one.complete for one in motion.components):
        notes.append("the self-motion is covered in part: it has more samples than allowed")
    return notes


def _warnings(objective: Objective, before: Posture, after: Vector) -> tuple[str, ...]:
    question = objective.question
    has_free = any(one.in_mode(FaultMode.FREE) for one in objective.sets)
    needs_gravity = question.direction is not None or has_free
    found = [*before.warnings]
    found += implausible(question, needs_gravity=needs_gravity, needs_inertia=False)
    if needs_gravity and not question.robot.mass and question.conditions.gravity.any():
        found.append("the URDF has no masses: the weight of the arm is missing")
    if question.limits is not None:
        unknown = [question.robot.names[i] for i in np.flatnonzero(~question.limits.is_known)]
        if unknown:
            found.append(f"unknown effort limits are not enforced: {listed(unknown)}")
    if not objective.measure.is_cost and after.min() <= 0.0:
        lost = [str(one) for one, x in zip(objective.sets, after, strict=True) if x <= 0.0]
        found.append(
            f"no posture keeps anything of the {objective.name} with {listed(lost)} failed, in the "
            f"task '{question.task}': another task or another objective tells postures apart"
        )
    return tuple(found)
