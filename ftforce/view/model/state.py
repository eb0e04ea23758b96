"""The question asked on the page, and the equivalent command line."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.conditions import INVERSES, Conditions, Inverse
from ftforce.analysis.drives import choose_drives
from ftforce.analysis.limits_files import NONE, URDF, choose_limits
from ftforce.analysis.question import Question, limits_for
from ftforce.core.arrays import Vector, as_vector, read_only
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.core.joint_scale import DEFAULT_JOINT_LENGTH, JointScale
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.task import COMPONENTS, DEFAULT_LENGTH, Task
from ftforce.errors import InputError, UnknownNameError
from ftforce.robot.formats.xacro import PLAIN, XacroOptions
from ftforce.robot.posture import Posture, choose_posture

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import ArrayLike

    from ftforce.analysis.friction import Friction
    from ftforce.core.limits import Limits
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot

HEALTHY = "healthy"
MODES = (HEALTHY, *(mode.value for mode in FaultMode))
LOADS = ("force", "torques", "every direction")
SOLIDS = ("nothing", "ellipsoid", "polytope")
FIRST_FORCE = 20.0  # N (N·m for tasks of moments only): the default force along each axis
_FIRST_FACTOR = 0.5  # default torque factor of a weak joint


class Origin(NamedTuple):
    """How the user specified the arm, for reproducing the command line.

    Attributes
    ----------
    robot :
        A path or a known name.
    base, tip :
        Base and tip links; ``None`` if not given.
    posture :
        Named posture with which the robot was loaded; ``None`` for its default.
    note :
        Why the command line may give a different answer; empty if it does not.
    xacro :
        What a xacro file was given.
    srdf :
        The SRDF that was given; ``None`` for its default.
    """

    robot: str
    base: str | None = None
    tip: str | None = None
    posture: str | None = None
    note: str = ""
    xacro: XacroOptions = PLAIN
    srdf: PathLike[str] | None = None


class Shown(NamedTuple):
    """What the page shows besides the answer.

    Attributes
    ----------
    census :
        Size of the largest fault sets of the census; 0 for no census.
    census_mode :
        Fault mode of the census, ``locked`` or ``free``.
    solid :
        Set of forces drawn before and after the fault: ``nothing``, ``ellipsoid`` or ``polytope``.
    weakest :
        Whether the weakest direction is shown.
    see_through :
        Whether the arm is transparent.
    """

    census: int = 1
    census_mode: FaultMode = FaultMode.LOCKED
    solid: str = SOLIDS[0]
    weakest: bool = False
    see_through: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """One question: posture, faults, load and conditions.

    Attributes
    ----------
    posture :
        Joint positions, rad or m, and their source.
    is_start :
        Whether the posture is the one with which the robot was loaded.
    modes :
        Mode of each joint: ``healthy``, ``locked``, ``free`` or ``weak``.
    factors :
        Torque factor of each joint when weak, 0 to 1; retained while the joint is not weak.
    load :
        How the load is specified: ``force``; ``torques``; or ``every direction``.
    wrench :
        Force exerted by the tip, N and N·m, in task axes, one value for each of `COMPONENTS`,
        shape (6,); components outside the task are retained for later tasks.
    torque :
        Motor torques that produce the tip force, N·m (N), shape (n,); ``None`` if not given.
    velocity, acceleration :
        Joint velocities and accelerations before the fault, rad or m, per s and s², shape (n,);
        or ``None``.
    task :
        Task components, axes and length.
    limits :
        Torque limits to use if limits apply.
    is_limited :
        Whether limits apply; ``None``: only if a joint is weak, as in `ftforce.analyze`.
    own_gravity :
        Gravity in root axes, m/s², shape (3,), in place of the model's; ``None`` for the model's.
    weighs :
        Whether gravity acts.
    payload :
        Payload at the tip; ``None`` for none.
    inverse, rtol, wary :
        As in `ftforce.analyze`.
    scale :
        Weights of hinges against slides.
    friction :
        Friction of free-swinging joints; ``None`` if it was not given.
    origin :
        How the user specified the arm.
    shown :
        What the page shows.
    joint_friction, armature :
        Whether friction and rotor inertia of the drives count.
    """

    posture: Posture
    is_start: bool
    modes: tuple[str, ...]
    factors: tuple[float, ...]
    load: str
    wrench: Vector
    torque: Vector | None
    velocity: Vector | None
    acceleration: Vector | None
    task: Task
    limits: Limits
    is_limited: bool | None
    own_gravity: Vector | None
    weighs: bool
    payload: Payload | None
    inverse: Inverse
    rtol: float
    wary: float
    scale: JointScale
    friction: Friction | None
    origin: Origin
    shown: Shown = field(default_factory=Shown)
    joint_friction: bool = False
    armature: bool = False

    @property
    def q(self) -> Vector:
        """Joint positions, rad or m, shape (n,)."""
        return self.posture.q

    @property
    def faults(self) -> FaultSet:
        """The fault set, in the order of the joints."""
        return FaultSet(
            tuple(
                Fault(i, FaultMode(mode), factor if mode == FaultMode.WEAK else 1.0)
                for i, (mode, factor) in enumerate(zip(self.modes, self.factors, strict=True))
                if mode != HEALTHY
            )
        )

    @property
    def force(self) -> Vector | None:
        """Requested tip force, N and N·m, in task axes, shape (m,); ``None`` if not applicable."""
        if self.load != "force":
            return None
        return read_only(self.wrench[[COMPONENTS.index(name) for name in self.task.components]])

    @property
    def asked_torque(self) -> Vector | None:
        """Torques for the tip force, N·m (N), shape (n,); ``None`` if not applicable."""
        return self.torque if self.load == "torques" else None

    @property
    def gravity(self) -> Vector | None:
        """Gravity in root axes, m/s², shape (3,); ``None`` for the model's."""
        return self.own_gravity if self.weighs else read_only(np.zeros(3))

    @property
    def counts_limits(self) -> bool:
        """Whether limits apply."""
        if self.is_limited is None:
            return limits_for(self.faults, None) is not None
        return self.is_limited

    # ---- modified questions ----------------------------------------------------------------------

    def at(self, q: ArrayLike) -> State:
        """Return the question at joint positions q, rad or m, shape (n,).

        Raises
        ------
        InputError
            q does not consist of n finite numbers.
        """
        place = as_vector(q, len(self.q), "q")
        return replace(self, posture=Posture(place, "given"), is_start=False)

    def in_posture(self, posture: Posture) -> State:
        """Return the question in a named posture."""
        return replace(self, posture=posture, is_start=False)

    def with_joint(self, joint: int, position: float) -> State:
        """Return the question with one joint (index from 0) at a position, rad or m."""
        q = self.q.copy()
        q[joint] = position
        return self.at(q)

    def failing(self, joint: int, mode: str, factor: float | None = None) -> State:
        """Return the question with one joint in a given mode.

        Parameters
        ----------
        joint :
            Index from 0.
        mode :
            ``healthy``, ``locked``, ``free`` or ``weak``.
        factor :
            Torque factor of a weak joint, 0 to 1; unchanged if not given.

        Raises
        ------
        InputError
            The mode is unknown, or the factor does not lie between 0 and 1.
        """
        if mode not in MODES:
            raise UnknownNameError("state of a joint", mode, MODES)
        share = self.factors[joint] if factor is None else float(factor)
        if not 0.0 <= share <= 1.0:  # also rejects NaN
            raise InputError(f"the factor of joint {joint + 1} must lie between 0 and 1")
        modes, factors = list(self.modes), list(self.factors)
        modes[joint], factors[joint] = mode, share
        return replace(self, modes=tuple(modes), factors=tuple(factors))

    def with_faults(self, faults: FaultSet) -> State:
        """Return the question for a fault set."""
        modes, factors = [HEALTHY] * len(self.modes), list(self.factors)
        for fault in faults.faults:
            modes[fault.joint] = fault.mode.value
            if fault.mode is FaultMode.WEAK:
                factors[fault.joint] = fault.factor
        return replace(self, modes=tuple(modes), factors=tuple(factors))

    def pushing(self, wrench: ArrayLike) -> State:
        """Return the question for a force, N and N·m for each of `COMPONENTS`, shape (6,).

        Raises
        ------
        InputError
            ``wrench`` does not consist of six finite numbers.
        """
        six = as_vector(wrench, 6, "force", ", ".join(COMPONENTS))
        return replace(self, wrench=six, load="force")

    def loaded(self, load: str) -> State:
        """Return the question for another kind of load, one of `LOADS`.

        Raises
        ------
        InputError
            The kind is unknown, or requires torques and none were given.
        """
        if load not in LOADS:
            raise UnknownNameError("load", load, LOADS)
        if load == "torques" and self.torque is None:
            raise InputError("no torques were given; start the page with --torque")
        return replace(self, load=load)

    def asking(self, task: str, axes: str, length: float | None = None) -> State:
        """Return the question for another task, in the given axes.

        Raises
        ------
        InputError
            As for `ftforce.core.task.Task.parse`.
        """
        L = self.task.length if length is None else length
        return replace(self, task=Task.parse(task, axes, L))  # type: ignore[arg-type] # checked

    def limited(self, counts: bool) -> State:
        """Return the question with or without torque limits."""
        return self if counts == self.counts_limits else replace(self, is_limited=counts)

    def weighing(self, weighs: bool) -> State:
        """Return the question with or without gravity."""
        return replace(self, weighs=weighs)

    def rubbing(self, rubs: bool) -> State:
        """Return the question with or without Coulomb and viscous friction of the drives."""
        return replace(self, joint_friction=rubs)

    def with_rotors(self, counts: bool) -> State:
        """Return the question with or without rotor inertia of the drives."""
        return replace(self, armature=counts)

    def carrying(self, payload: Payload | None) -> State:
        """Return the question with a payload at the tip."""
        return replace(self, payload=payload)

    def showing(self, **changes: Any) -> State:
        """Return the question with changes to what the page shows: fields of `Shown`."""
        return replace(self, shown=self.shown._replace(**changes))

    # ---- the question ----------------------------------------------------------------------------

    def question(self, robot: Robot) -> Question:
        """Return the question that `ftforce.analyze` answers.

        Parameters
        ----------
        robot :
            The arm.
        """
        # Positions set on the page are checked against the joint limits here.
        is_given = self.posture.source == "given"
        gravity = self.gravity
        limits = self.limits if self.counts_limits else None
        return Question(
            robot,
            self.task,
            Conditions(
                robot.gravity if gravity is None else gravity,
                gravity is None,
                self.payload,
                self.velocity,
                self.acceleration,
                choose_drives(
                    robot, limits, joint_friction=self.joint_friction, armature=self.armature
                ),
            ),
            force=self.force,
            torque=self.asked_torque,
            direction=None,
            limits=limits,
            inverse=self.inverse,
            rtol=self.rtol,
            wary=self.wary,
            given_friction=self.friction,
            posture=choose_posture(robot, self.q) if is_given else self.posture,
            faults=self.faults,
            scale=self.scale,
        )

    def essence(self) -> tuple[object, ...]:
        """Return what a verdict depends on besides posture, faults, payload and given limits."""
        vectors = (self.force, self.asked_torque, self.velocity, self.acceleration, self.gravity)
        plain = (self.load, self.counts_limits, self.inverse, self.task, self.rtol, self.wary)
        weighed = self.scale.effective_length
        drives = self.joint_friction, self.armature
        return (*(None if x is None else x.tobytes() for x in vectors), *plain, weighed, *drives)

    def census_essence(self) -> tuple[object, ...]:
        """Return what the census depends on: states that agree in it share their census."""
        own = (self.q.tobytes(), id(self.limits), self.payload)
        return (*self.essence(), *own, self.shown.census, self.shown.census_mode)


def initial_state(
    question: Question, *, origin: Origin | None = None, are_limits_given: bool = False
) -> State:
    """Return the initial state of the page.

    Parameters
    ----------
    question :
        The first question; 20 N along each axis if it has neither a force nor torques.
    origin :
        How the user specified the arm; defaults to its URDF.
    are_limits_given :
        Whether the user chose the limits, or none; otherwise they apply if a joint is weak.
    """
    robot, conditions, faults = question.robot, question.conditions, question.faults
    drives = conditions.drives
    state = State(
        posture=question.place,
        is_start=question.place.source != "given",
        modes=(HEALTHY,) * robot.n,
        factors=(_FIRST_FACTOR,) * robot.n,
        load="force" if question.torque is None else "torques",
        wrench=_first_wrench(question.task, question.force),
        torque=question.torque,
        velocity=conditions.velocity,
        acceleration=conditions.acceleration,
        task=question.task,
        limits=question.limits or _urdf_limits(robot),
        is_limited=question.limits is not None if are_limits_given else None,
        own_gravity=None if conditions.is_model_gravity else conditions.gravity,
        weighs=True,
        payload=conditions.payload,
        inverse=question.inverse,
        rtol=question.rtol,
        wary=question.wary,
        scale=question.scale,
        friction=question.given_friction,
        joint_friction=drives is not None and drives.has_friction,
        armature=drives is not None and drives.has_armature,
        origin=_origin_of(robot) if origin is None else origin,
    )
    return state.with_faults(faults)


def _origin_of(robot: Robot) -> Origin:
    if robot.path:
        return Origin(robot.path)
    note = "The arm is made of a Pinocchio model; the command needs a file of the same arm."
    return Origin(f"{robot.name}.urdf", tip=robot.tip, note=note)  # not a known robot's name


def command_line(robot: Robot, state: State) -> str:
    """Return the equivalent ``ftforce analyze`` command, quoted for a shell.

    Numbers are written with all their digits, so that the command reproduces the page's results.
    """
    task, faults, origin = state.task, state.faults, state.origin
    locked, free = (
        ",".join(_joint(robot, i) for i in faults.in_mode(mode))
        for mode in (FaultMode.LOCKED, FaultMode.FREE)
    )
    weak = (f for f in faults.faults if f.mode is FaultMode.WEAK)
    is_named = state.is_start and origin.posture is not None
    is_default = state.is_start and not is_named and _has_default_posture(robot, state)
    options = {
        "locked": locked,
        "free": free,
        "weak": ",".join(f"{_joint(robot, f.joint)}:{f.factor!r}" for f in weak),
        "posture": origin.posture if is_named else None,
        "q": None if is_named or is_default else _numbers(state.q),
        "force": _numbers(state.force),
        "torque": _numbers(state.asked_torque),
        "velocity": _numbers(state.velocity),
        "acceleration": _numbers(state.acceleration),
        "gravity": _numbers(state.gravity),
        "payload": _payload(state.payload),
        "limits": _limits(state),
        "friction": "" if state.friction is None else state.friction.option,
        "inverse": _unless(INVERSES[0], state.inverse),
        "task": _unless("force", str(task)),
        "length": _unless(DEFAULT_LENGTH, task.length),
        "joint-length": _unless(DEFAULT_JOINT_LENGTH, state.scale.length),
        "axes": _unless("tool", task.axes),
        "base": origin.base,
        "tip": origin.tip,
        "srdf": origin.srdf,
        "rtol": _unless(RTOL, state.rtol),
        "wary": _unless(BORDERLINE_RTOL, state.wary),
    }
    # As `--option=value`, since a value may begin with a minus sign.
    given = (f"--{option}={value}" for option, value in options.items() if value)
    words = [word for name, value in origin.xacro.args for word in ("--arg", f"{name}={value}")]
    words += [word for one in origin.xacro.packages for word in ("--package-path", str(one))]
    words += ["--joint-friction"] if state.joint_friction else []
    words += ["--armature"] if state.armature else []
    return shlex.join(["ftforce", "analyze", _argument(origin.robot), *words, *given])


def _has_default_posture(robot: Robot, state: State) -> bool:
    """Return whether the page's question, asked anew, has the posture of the page."""
    return np.array_equal(state.question(robot).placed().q, state.q)


def _unless(default: object, value: object) -> str:
    """Return a value as text with all its digits; empty if it is the default."""
    return "" if value == default else str(value)


def _argument(robot: str) -> str:
    return f"./{robot}" if robot.startswith("-") else robot


def _joint(robot: Robot, i: int) -> str:
    """Return a joint's number, or its name if another joint is named by that number."""
    number = str(i + 1)
    return robot.names[i] if number in robot.names and robot.names[i] != number else number


def _numbers(vector: Vector | None) -> str:
    return "" if vector is None else ",".join(repr(x + 0.0) for x in vector.tolist())


def _payload(payload: Payload | None) -> str:
    if payload is None:
        return ""
    is_point = payload.inertia is None
    place = f"@{_numbers(payload.offset)}" if payload.offset.any() or not is_point else ""
    moments = "" if is_point else f"@{_numbers(np.array(payload.moments))}"
    return f"{payload.mass!r}{place}{moments}"


def _limits(state: State) -> str:
    if state.is_limited is None:
        return ""
    return state.limits.source if state.is_limited else NONE


def _urdf_limits(robot: Robot) -> Limits:
    limits = choose_limits(robot, URDF)
    assert limits is not None
    return limits


def _first_wrench(task: Task, force: Vector | None) -> Vector:
    """Return the given force, or the default, for each of `COMPONENTS`, shape (6,)."""
    if force is None:
        unit = "f" if task.force_rows else "m"
        return read_only(np.array([FIRST_FORCE * (name[0] == unit) for name in COMPONENTS]))
    return read_only(in_components(task.components, force))


def in_components(components: Sequence[str], vectors: Vector) -> Vector:
    """Expand vectors over some of `COMPONENTS`, (..., m), to all of them, (..., 6), with zeros."""
    six = np.zeros((*vectors.shape[:-1], len(COMPONENTS)))
    six[..., [COMPONENTS.index(name) for name in components]] = vectors
    return six


def shown_position(unit: str, position: float) -> float:
    """Return a joint position (rad or m) in display units, degrees or m."""
    return math.degrees(position) if unit == "rad" else position


def meant_position(unit: str, shown: float) -> float:
    """Return a joint position in rad or m, given in display units, degrees or m."""
    return math.radians(shown) if unit == "rad" else shown
