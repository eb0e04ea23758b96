"""The question that a caller asks, parsed once; every analysis takes it from here.

A public function parses its arguments into a `Question` and hands it on. Whatever takes a
`Question` reads typed, checked values and never parses again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ftforce.analysis.conditions import INVERSES, Conditions, Inverse, mass_matrix_for, tip_load
from ftforce.analysis.friction import choose_friction
from ftforce.analysis.limits_files import URDF, choose_limits
from ftforce.core.arrays import read_only
from ftforce.core.display import Displayed
from ftforce.core.faults import FaultMode, FaultSet, count_fault_sets, fault_sets
from ftforce.core.joint_scale import UNWEIGHTED, JointScale
from ftforce.core.reduced_jacobian import (
    BORDERLINE_RTOL,
    RTOL,
    FreeJoints,
    check_tolerances,
    reduce,
)
from ftforce.core.task import Axes, Task
from ftforce.errors import InputError, check_word, listed
from ftforce.robot.kinematics import task_jacobian
from ftforce.robot.posture import SINGULAR, choose_posture, is_singular_for
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import Friction, FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.changes import TipLoad
    from ftforce.core.limits import Limits
    from ftforce.core.reduced_jacobian import ReducedJacobian
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot

_MAX_SETS = 1_000_000  # about a minute and a gigabyte; a sweep stores no individual sets
HEALTHY = FaultSet()


class Progress(Protocol):
    """Callback with the number of fault sets completed and their total."""

    def __call__(self, done: int, total: int, /) -> None:
        """Report progress."""


def check_progress(progress: object) -> None:
    """Check an argument ``progress`` before any work starts.

    Parameters
    ----------
    progress :
        The argument.

    Raises
    ------
    InputError
        It is no function.
    """
    if progress is not None and not callable(progress):
        raise InputError(
            "progress is a function of what is done and the total, e.g. print, got "
            f"{type(progress).__name__}"
        )


def counted(progress: Progress | None, total: int) -> Callable[[int], None]:
    """Return a function that adds to what is done and reports it.

    Parameters
    ----------
    progress :
        Called with what is done, up to the total, and the total.
    total :
        The total.
    """
    check_progress(progress)
    done = 0

    def tick(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(min(done, total), total)

    return tick


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked about an arm.

    Attributes
    ----------
    robot, task, conditions :
        The arm; components and axes of the force; gravity, payload and motion.
    force :
        Force the tool exerts on its environment, N and N·m, in task axes, shape (m,); ``None`` if
        none was given.
    torque :
        Motor torques for the tip force, N·m (N), shape (n,), given in place of a force.
    direction :
        Direction of the force capability, in task axes, scaled as by
        `ftforce.Task.direction_of`, shape (m,); ``None`` if none was given.
    limits :
        Torque limits in force; ``None`` if none are.
    inverse :
        Inverse that splits ``torque`` into force and self-motion.
    rtol, wary :
        Rank tolerance, and the largest tolerance considered for a borderline verdict.
    given_friction :
        Friction of free-swinging joints; ``None`` if it follows from the URDF and the limits.
    posture :
        The posture; ``None`` if many are asked about.
    faults :
        The fault set; empty if the arm is healthy, or many sets are asked about.
    scale :
        Weights of hinges against slides.
    """

    robot: Robot
    task: Task
    conditions: Conditions
    force: Vector | None
    torque: Vector | None
    direction: Vector | None
    limits: Limits | None
    inverse: Inverse
    rtol: float
    wary: float
    given_friction: Friction | None = None
    posture: Posture | None = None
    faults: FaultSet = HEALTHY
    scale: JointScale = UNWEIGHTED

    @classmethod
    def parse(
        cls,
        robot: Robot,
        *,
        posture: Posture | None = None,
        faults: FaultSet = HEALTHY,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        direction: ArrayLike | None = None,
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
        rtol: float = RTOL,
        wary: float = BORDERLINE_RTOL,
    ) -> Question:
        """Return the question that the arguments of `ftforce.analyze` ask.

        Parameters
        ----------
        robot, posture, faults :
            The arm; posture and fault set, chosen by `ftforce.robot.posture.choose_posture` and
            `ftforce.analysis.fault_names.named_faults`.
        direction :
            Direction of the force capability, in task axes, shape (m,).
        force, torque, velocity, acceleration, gravity, payload, limits, friction, inverse :
            As in `ftforce.analyze`.
        joint_friction, armature :
            As in `ftforce.analyze`.
        task, length, joint_length, axes, rtol, wary :
            As in `ftforce.analyze`.

        Raises
        ------
        InputError
            An argument is invalid; the message says what is expected.
        LimitsError
            The file of limits or friction cannot be read or does not fit the robot.
        """
        require_robot(robot)
        check_tolerances(rtol, wary)
        wanted = Task.parse(task, axes, length)
        check_word("inverse", inverse, INVERSES)
        if force is not None and torque is not None:
            raise InputError("give either a force or torques, not both")
        known, drives = choose_limits(robot, limits_for(faults, limits)), None
        if joint_friction is not False or armature is not False:
            from ftforce.analysis.drives import choose_drives  # not needed for most questions

            drives = choose_drives(robot, known, joint_friction=joint_friction, armature=armature)
        return cls(
            robot,
            wanted,
            Conditions.of(
                robot,
                velocity=velocity,
                acceleration=acceleration,
                gravity=gravity,
                payload=payload,
                drives=drives,
            ),
            force=None if force is None else wanted.vector(force, "force"),
            torque=None if torque is None else robot.vector(torque, "torque"),
            direction=None if direction is None else unit_direction(wanted, direction),
            limits=known,
            inverse=inverse,
            rtol=rtol,
            wary=wary,
            given_friction=None if friction is None else choose_friction(robot, friction, known),
            posture=posture,
            faults=faults,
            scale=JointScale.of(robot.units, joint_length),
        )

    def placed(self, q: ArrayLike | Posture | None = None, posture: str | None = None) -> Question:
        """Return the question in the given, the named or the default posture.

        Parameters
        ----------
        q, posture :
            As in `ftforce.analyze`.

        Raises
        ------
        InputError
            Both are given, ``q`` is malformed, or the name is unknown.
        """
        placed = object.__new__(Question)  # as `copy` does it, in a quarter of its time
        vars(placed).update(vars(self))  # every part is immutable, and none depends on the posture
        chosen = choose_posture(self.robot, q, posture, problem=self.problem_in)
        object.__setattr__(placed, "posture", chosen)
        return placed

    def problem_in(self, q: Vector) -> str:
        """Return why the question cannot be answered in a posture; empty if it can.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        robot, task = self.robot, self.task
        J = self.weigh_jacobian(task_jacobian(robot, q, task))
        healthy = reduce(read_only(J), HEALTHY.mask(robot.n), self.rtol)
        if is_singular_for(robot, q, task, healthy.healthy.s):
            return SINGULAR
        if healthy.rank == task.m:
            return ""
        load = tip_load(healthy, task, self.force, None)
        can_answer = self.has_force_to_keep(healthy, None if load is None else load.F)
        return "" if can_answer else "cannot exert the force"

    @property
    def place(self) -> Posture:
        """The posture of a question about a single one."""
        assert self.posture is not None
        return self.posture

    @property
    def q(self) -> Vector:
        """Joint positions of that posture, rad or m, shape (n,)."""
        return self.place.q

    @cached_property
    def F(self) -> Vector | None:
        """The force, weighted, shape (m,); ``None`` if none was given."""
        return None if self.force is None else self.task.weigh_force(self.force)

    def weigh_jacobian(self, J: Matrix) -> Matrix:
        """Return the Jacobian with its rows and columns weighted, shape (..., m, n).

        Parameters
        ----------
        J :
            Task Jacobian, unweighted, shape (..., m, n).
        """
        return self.scale.weigh_jacobian(self.task.weigh_jacobian(J))

    def largest_torques(self, faults: FaultSet, limits: Limits | None = None) -> Vector | None:
        """Return the weighted limits with a fault set; ``None`` if none are in force.

        Shape (n,), or (2, n) if lower and upper ones differ; with the velocity of the conditions.

        Parameters
        ----------
        faults :
            The fault set.
        limits :
            Other limits than those in force.
        """
        limits = self.limits if limits is None else limits
        if limits is None:
            return None
        return self.scale.weigh_torque(limits.largest_torques(faults, self.conditions.velocity))

    def load(self, reduced: ReducedJacobian) -> TipLoad | None:
        """Return the force of the healthy arm, weighted; ``None`` for neither force nor torques.

        Parameters
        ----------
        reduced :
            The decomposed Jacobians.

        Raises
        ------
        InputError
            The dynamic inverse needs masses, and the URDF has none.
        """
        torque = None if self.torque is None else self.scale.weigh_torque(self.torque)
        M = None
        if self.inverse != "euclidean":
            M = mass_matrix_for(self.robot, self.q, self.conditions, self.inverse)
            M = None if M is None else self.scale.weigh_mass_matrix(M)
        return tip_load(reduced, self.task, self.force, torque, M=M)

    @cached_property
    def friction(self) -> Friction:
        """Friction of each joint, should it swing freely."""
        return self.given_friction or choose_friction(self.robot, None, self.limits)

    def free_joints(self, faults: FaultSet) -> FreeJoints | None:
        """Return the free-swinging joints of a fault set, with their friction, weighted.

        Parameters
        ----------
        faults :
            The fault set.
        """
        mask = faults.free_mask(self.robot.n)
        if mask is None:
            return None
        return FreeJoints.of(mask, self.scale.weigh_torque(self.friction.torque), self.wary)

    def at(
        self,
        posture: Posture,
        velocity: Vector,
        acceleration: Vector,
        faults: FaultSet = HEALTHY,
    ) -> Question:
        """Return the same question at one instant of a motion.

        Parameters
        ----------
        posture, velocity, acceleration :
            Joint positions, velocities and accelerations, rad or m, per s and s², shape (n,).
        faults :
            The fault set.
        """
        conditions = self.conditions._replace(velocity=velocity, acceleration=acceleration)
        return replace(self, posture=posture, conditions=conditions, faults=faults)

    def has_force_to_keep(self, healthy: ReducedJacobian, F: Vector | None) -> bool:
        """Return whether the healthy arm can exert any of what is asked (theory §2.6).

        Parameters
        ----------
        healthy :
            Decomposed Jacobian of a posture.
        F :
            Force F̂ that the healthy arm exerts there, shape (m,); ``None`` without a force.
        """
        if healthy.rank in (0, healthy.m):  # nothing, or everything
            return healthy.rank > 0
        return F is None or self.force is None or bool(F.any()) or not self.force.any()

    def nothing_to_keep(self, where: str = "in this posture") -> InputError:
        """Return the error for a question about a force that not even the healthy arm can exert.

        Parameters
        ----------
        where :
            Where it cannot.
        """
        robot, task = self.robot, self.task
        names = listed(task.components)
        what = "a force" if task.force_rows else "a moment"
        along = f"along {names}"
        if self.force is not None and self.force.any():
            what, along = "this force" if task.force_rows else "this moment", "along it"
        return InputError(
            f"even the healthy arm cannot exert {what} {where}: no joint of the chain from "
            f"{robot.base!r} to the tip {robot.tip!r} moves the tip {along} (task '{task}', "
            f"{task.axes} axes); choose another task, axes, tip or posture"
        )

    def direction_or_that_of(self, F: Vector | None) -> Vector | None:
        """Return the direction of the capability, shape (m,); ``None`` for the weakest direction.

        Parameters
        ----------
        F :
            Weighted force that supplies the direction if none was given, shape (m,).
        """
        if self.direction is not None or F is None or not F.any():
            return self.direction
        return self.task.direction_of(self.task.unweigh_force(F))


@dataclass(frozen=True, slots=True)
class AllFaultSets:
    """All sets of up to ``largest`` of ``n`` joints that fail in one mode (eq. 12-13)."""

    n: int
    largest: int
    mode: FaultMode

    @classmethod
    def parse(cls, robot: Robot, faults: int, mode: FaultMode | str) -> AllFaultSets:
        """Return the sets of up to ``faults`` joints of an arm.

        Parameters
        ----------
        robot :
            The arm.
        faults :
            Size of the largest sets.
        mode :
            ``locked`` or ``free``.

        Raises
        ------
        InputError
            The size does not lie between 1 and n, there are too many sets, or the mode is unknown
            or ``weak``, which needs a factor per joint.
        """
        require_robot(robot)
        return cls.of(robot.n, faults, mode)

    @classmethod
    def of(cls, n: int, faults: int, mode: FaultMode | str) -> AllFaultSets:
        """Return the sets of up to ``faults`` of n joints.

        Parameters
        ----------
        n :
            Number of joints.
        faults, mode :
            As in `parse`.

        Raises
        ------
        InputError
            As in `parse`.
        """
        is_integer = isinstance(faults, (int, np.integer)) and not isinstance(faults, bool)
        if not is_integer or not 1 <= faults <= n:
            raise InputError(f"faults must be an integer from 1 to {n}, got {faults!r}")
        found = cls(n, int(faults), single_mode(mode))
        if len(found) > _MAX_SETS:
            raise InputError(
                f"{len(found):,} fault sets of up to {faults} of {n} joints exceed the "
                f"maximum of {_MAX_SETS:,}; ask for smaller sets"
            )
        return found

    def __iter__(self) -> Iterator[FaultSet]:
        """Yield the sets, small ones first."""
        return fault_sets(self.n, self.largest, self.mode)

    def __len__(self) -> int:
        """Return the number of sets."""
        return count_fault_sets(self.n, self.largest)


class Answered(Displayed):
    """Base of results that keep their question, with its parts as attributes."""

    __slots__ = ()
    question: Question

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.question.robot

    @property
    def task(self) -> Task:
        """Components and axes of the force."""
        return self.question.task

    @property
    def conditions(self) -> Conditions:
        """Gravity, payload and motion."""
        return self.question.conditions

    @property
    def limits(self) -> Limits | None:
        """Torque limits in force; ``None`` if none are."""
        return self.question.limits

    @property
    def scale(self) -> JointScale:
        """Weights of hinges against slides."""
        return self.question.scale

    @property
    def rtol(self) -> float:
        """Rank tolerance."""
        return self.question.rtol

    @property
    def wary(self) -> float:
        """Largest tolerance considered for a borderline verdict."""
        return self.question.wary


class AnsweredForAll(Answered):
    """Base of results for all fault sets up to a size."""

    __slots__ = ()
    all_sets: AllFaultSets

    @property
    def mode(self) -> FaultMode:
        """Fault mode of the joints."""
        return self.all_sets.mode

    @property
    def largest(self) -> int:
        """Size of the largest sets."""
        return self.all_sets.largest


def single_mode(mode: FaultMode | str) -> FaultMode:
    """Return the fault mode shared by all joints of many fault sets.

    Raises
    ------
    InputError
        The mode is unknown, or is ``weak``, which needs a factor per joint.
    """
    how = FaultMode.parse(mode)
    if how is FaultMode.WEAK:
        raise InputError(
            "fault sets of many joints are locked or free; weak joints need individual factors, "
            "use analyze"
        )
    return how


def limits_for(faults: FaultSet, limits: LimitsLike) -> LimitsLike:
    """Return the limits to apply; weak joints default to those of the URDF."""
    return URDF if limits is None and faults.in_mode(FaultMode.WEAK) else limits


def unit_direction(task: Task, direction: ArrayLike) -> Vector:
    """Return a direction scaled as by `ftforce.Task.direction_of`, shape (m,).

    Parameters
    ----------
    task :
        The task.
    direction :
        Direction in task axes, shape (m,).

    Raises
    ------
    InputError
        The direction is malformed or zero.
    """
    vector = task.vector(direction, "direction")
    if not vector.any():
        raise InputError("the direction must not be zero")
    return task.direction_of(vector)
