"""Results of a simulation over time, as plain arrays that can be stored in files."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.display import Displayed
from ftforce.core.joint_scale import DEFAULT_JOINT_LENGTH, JointScale
from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.robot.dynamics import CarriedPayload
from ftforce.robot.robot import JointUnits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.task import Task

RUNS = ("healthy", "unremapped", "remapped")


@dataclass(frozen=True, slots=True)
class JointInfo(JointUnits):
    """Name and type of a joint.

    Attributes
    ----------
    name, type :
        As in the URDF.
    """

    name: str
    type: str


@dataclass(frozen=True, slots=True)
class EventReport:
    """Effect of a fault at the instant at which it occurs.

    Attributes
    ----------
    time :
        Fault time, s.
    faults :
        Joints that fail at this time: ``3 joint3 locked``.
    all_faults :
        All joints that have failed by then, in the same format.
    impact_jump :
        Jump of the tip velocity when joints lock, before any controller reacts, in root axes, m/s,
        3 numbers; empty without locked joints or without masses.
    velocity_jump :
        Jump of the tip velocity that remains after the remap of Appendix A, in root axes, m/s, 3
        numbers; empty without locked joints.
    force_jump :
        Norm of the force jump that remains after the remap, N (N·m for a task of moments); ``None``
        if the arm cannot be held. With an immediate remap, the value at the first sample with the
        fault; otherwise at the state just before it.
    verdict :
        Verdict at the same instant as ``force_jump``.
    """

    time: float
    faults: str
    all_faults: str
    impact_jump: tuple[float, ...]
    velocity_jump: tuple[float, ...]
    force_jump: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Setting(CarriedPayload):
    """Inputs and assumptions of a simulation.

    Attributes
    ----------
    robot, base, tip :
        Names.
    tip_source, other_tips :
        How the tip was chosen, and what else could have been meant, as of a `ftforce.Robot`; empty
        if an older version stored the history.
    joints :
        Joints of the chain.
    task :
        Components, axes and characteristic length of the force.
    force :
        Requested force at the tip, N and N·m, m numbers.
    course :
        One-line description of the trajectory.
    start :
        Where the initial posture comes from.
    events :
        The faults.
    delay :
        Time from a fault until the remap takes effect, s; infinite without a remap.
    limits :
        Source of the torque limits in force; ``none`` if none.
    effort, effort_lower :
        Motor torque limits, N·m (N), NaN where unknown, whether or not they are in force. The
        lower ones are empty if they are always the upper ones, negated; both are those at rest.
    gravity :
        In root axes, m/s².
    payload, payload_mass, payload_offset, payload_inertia :
        Payload as text, its mass, kg, its position in tip axes, m, and its moments of inertia,
        kg·m²; empty and ``None`` if there is none. `carried` is the payload itself.
    has_masses :
        Whether the URDF has masses; without them torques contain the force part only.
    rtol, wary :
        Tolerances.
    warnings :
        Warnings about the result.
    notes :
        Assumptions.
    joint_length :
        Travel of a slide that weighs as much as 1 rad of a hinge, m; older histories have 1 m.
    robot_sha256 :
        SHA-256 of the robot's file; ``None`` without one, and in older histories.
    """

    robot: str
    base: str
    tip: str
    joints: tuple[JointInfo, ...]
    task: Task
    force: tuple[float, ...]
    course: str
    start: str
    events: tuple[EventReport, ...]
    delay: float
    limits: str
    effort: tuple[float, ...]
    gravity: tuple[float, ...]
    payload: str
    has_masses: bool
    rtol: float
    wary: float
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    tip_source: str = ""
    other_tips: Mapping[str, tuple[float, float]] = field(default_factory=dict, hash=False)
    payload_mass: float | None = None
    payload_offset: tuple[float, ...] = ()
    payload_inertia: tuple[float, ...] = ()
    effort_lower: tuple[float, ...] = ()
    joint_length: float = DEFAULT_JOINT_LENGTH
    robot_sha256: str | None = None

    @property
    def scale(self) -> JointScale:
        """Weights of hinges against slides."""
        return JointScale.of((joint.unit for joint in self.joints), self.joint_length)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Run:
    """One simulated run, N instants; NaN where the arm cannot be held.

    Attributes
    ----------
    q, v, a :
        Joint positions, velocities and accelerations, rad or m, per s, per s², shape (N, n).
    position :
        Tip position in root axes, m, shape (N, 3).
    orientation :
        Tip orientation, a unit quaternion x, y, z, w without sign changes over time, shape (N, 4).
    path_error :
        Reference minus actual tip position, m, shape (N, 3).
    orientation_error :
        Rotation vector from the actual to the prescribed tip orientation, in root axes, rad, shape
        (N, 3); 0 if the orientation is unconstrained.
    velocity_jump :
        Actual minus reference tip velocity, in root axes, m/s, shape (N, 3).
    rnea :
        Gravity and motion torques, N·m (N), shape (N, n).
    force_part :
        Torques JᵀF̂ with which the healthy arm would exert the force here, shape (N, n).
    U :
        Motor torques for the force after the fault; 0 at locked and free-swinging joints.
    motor :
        Total motor torques, rnea + U; 0 at locked and free-swinging joints.
    brake :
        Brake loads of locked joints, shape (N, n); 0 at other joints.
    unbalanced :
        Torques that are not balanced and accelerate the arm, shape (N, n); 0 where they are within
        ``rtol`` of the torques for gravity, motion and force.
    used :
        Load over torque limit, shape (N, n); NaN where the limit is unknown.
    force :
        Tip force in task axes, N and N·m, shape (N, m).
    jump :
        ΔF: the force the healthy arm would exert here minus ``force``, shape (N, m).
    margin :
        σ_min(K)/σ_max(J), shape (N,).
    verdict :
        Index into ``ftforce.core.verdict.VERDICTS``, shape (N,): 0 tolerated, 1 borderline, 2 not
        tolerated.
    """

    q: Matrix
    v: Matrix
    a: Matrix
    position: Matrix
    orientation: Matrix
    path_error: Matrix
    orientation_error: Matrix
    velocity_jump: Matrix
    rnea: Matrix
    force_part: Matrix
    U: Matrix
    motor: Matrix
    brake: Matrix
    unbalanced: Matrix
    used: Matrix
    force: Matrix
    jump: Matrix
    margin: Vector
    verdict: NDArray[np.int8]

    def __repr__(self) -> str:
        """Return the number of instants and the worst verdict in one line."""
        verdict = VERDICTS[int(self.verdict.max(initial=0))]
        return f"<Run of {len(self.q):,} instants, {self.q.shape[1]} joints: {verdict}>"

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdict at each instant."""
        return tuple(VERDICTS[code] for code in self.verdict.tolist())

    @property
    def falls_from(self) -> int | None:
        """Index of the first instant at which the arm cannot be held; ``None`` if there is none.

        From then on the actual motion differs from the stored positions.
        """
        loose = np.isnan(self.force).any(axis=1) | self.unbalanced.any(axis=1)
        return int(loose.argmax()) if loose.any() else None

    @property
    def until_fall(self) -> slice:
        """Slice of the instants up to and including the first at which the arm cannot be held."""
        return slice(None if self.falls_from is None else self.falls_from + 1)

    @property
    def orientation_error_norm(self) -> Vector:
        """Angle of the orientation error, rad, shape (N,)."""
        norms: Vector = np.linalg.norm(self.orientation_error, axis=1)
        return norms

    @property
    def path_error_norm(self) -> Vector:
        """Position error of the tip, m, shape (N,)."""
        norms: Vector = np.linalg.norm(self.path_error, axis=1)
        return norms


QUANTITIES = tuple(one.name for one in fields(Run))
MOTIONS = ("q", "v", "a")
SCALARS = ("margin", "verdict")


def width(quantity: str, n: int, m: int) -> int | None:
    """Return how many components a quantity has per instant; ``None`` for a scalar.

    Parameters
    ----------
    quantity :
        A name of `QUANTITIES`.
    n, m :
        Numbers of joints and of task components.
    """
    if quantity in SCALARS:
        return None
    if quantity in ("force", "jump"):
        return m
    in_space = ("position", "path_error", "orientation_error", "velocity_jump")
    return 4 if quantity == "orientation" else 3 if quantity in in_space else n


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class History(Displayed):
    """Runs of an arm along a trajectory while joints fail: healthy, without and with the remap.

    Attributes
    ----------
    setting :
        Inputs and assumptions.
    t :
        Times, s, starting at 0, shape (N,).
    path :
        Reference position of the tip, in root axes, m, shape (N, 3).
    healthy :
        Run without any fault.
    unremapped :
        Run in which the controller never learns of the faults.
    remapped :
        Run in which the controller reacts to the faults; ``None`` if the remap is switched off.
    """

    setting: Setting
    t: Vector
    path: Matrix
    healthy: Run
    unremapped: Run
    remapped: Run | None

    @property
    def runs(self) -> dict[str, Run]:
        """The available runs by name."""
        found = {name: getattr(self, name) for name in RUNS}
        return {name: run for name, run in found.items() if run is not None}

    @property
    def answer(self) -> Run:
        """The run with the remap, or the one without if the remap is switched off."""
        return self.unremapped if self.remapped is None else self.remapped

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result."""
        return self.setting.warnings

    def index(self, time: float) -> int:
        """Return the index of the last sample at or before a time.

        Parameters
        ----------
        time :
            Time, s.
        """
        return max(int(np.searchsorted(self.t, time, side="right")) - 1, 0)

    def jump_norm(self, run: Run) -> Vector:
        """Return ‖ΔF‖ of a run, N (N·m for a task of moments), shape (N,).

        Parameters
        ----------
        run :
            One of the history's runs.
        """
        task = self.setting.task
        rows = task.force_rows or task.moment_rows
        norms: Vector = np.linalg.norm(run.jump[:, list(rows)], axis=1)
        return norms
