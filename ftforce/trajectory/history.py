"""What a simulation finds, over time: plain arrays that a file can hold and give back."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.display import Displayed
from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.robot.robot import JointUnits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.task import Task

RUNS = ("healthy", "unremapped", "remapped")


@dataclass(frozen=True, slots=True)
class JointInfo(JointUnits):
    """A joint, without its robot.

    Attributes
    ----------
    name, type :
        As in the URDF.
    """

    name: str
    type: str


@dataclass(frozen=True, slots=True)
class EventReport:
    """What a fault does in the instant in which it happens.

    Attributes
    ----------
    time :
        In s.
    faults :
        The joints that fail then, in words: ``3 joint3 locked``.
    all_faults :
        All joints that have failed by then, likewise.
    impact_jump :
        Jump of the tip's velocity when joints lock, before any controller acts, in the root's
        axes, m/s, 3 numbers; empty without a lock or without masses.
    velocity_jump :
        Jump of it that Appendix A's remap leaves, likewise; empty without a lock.
    force_jump :
        Norm of the jump of the force that the remap leaves, N (N·m if the task has moments alone);
        ``None`` if nothing can hold the arm. With a remap at once that of the first sample with
        the fault; else of the state right before it.
    verdict :
        Likewise.
    """

    time: float
    faults: str
    all_faults: str
    impact_jump: tuple[float, ...]
    velocity_jump: tuple[float, ...]
    force_jump: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Setting:
    """What was simulated.

    Attributes
    ----------
    robot, base, tip :
        Names.
    joints :
        The chain.
    task :
        Components, axes and length of the force.
    force :
        What the tip is to exert, N and N·m, m numbers.
    course :
        What the arm follows, in words.
    start :
        Where the posture at its start comes from.
    events :
        The faults.
    delay :
        Time from a fault until the remap acts, s.
    limits :
        Where the torque limits that count come from; ``none`` if none do.
    effort :
        Largest torque of each motor, N·m (N), NaN where unknown, whether it counts or not.
    gravity :
        In the root's axes, m/s².
    payload :
        In words; empty if there is none.
    has_masses :
        Whether the URDF has masses: without, torques hold the force part alone.
    rtol, wary :
        Tolerances.
    warnings :
        What makes the answer doubtful.
    notes :
        What was assumed.
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


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One arm over time, N instants; NaN where nothing can hold the arm.

    Attributes
    ----------
    q, v, a :
        Joint positions, velocities and accelerations, rad or m, per s, per s², shape (N, n).
    position :
        Place of the tip in the root's axes, m, shape (N, 3).
    orientation :
        Its orientation, a unit quaternion x, y, z, w that never jumps to its negative, shape
        (N, 4).
    path_error :
        Where the tip should be minus where it is, m, shape (N, 3).
    orientation_error :
        Rotation, as axis times angle in the root's axes, that would bring the orientation back
        that the tip is to keep, rad, shape (N, 3); 0 if it may turn.
    velocity_jump :
        Velocity of the tip minus that of its path, in the root's axes, m/s, shape (N, 3).
    rnea :
        Torques for weight and motion, N·m (N), shape (N, n).
    force_part :
        Torques JᵀF̂ that the healthy arm would give to the force here, shape (N, n).
    U :
        What the motors give to it now; 0 at joints that are locked or without torque.
    motor :
        What the motors give in all, rnea + U; 0 at joints that are locked or without torque.
    brake :
        What the brakes of locked joints carry, shape (N, n); 0 at other joints.
    unbalanced :
        Torques that nothing balances: they move the arm, shape (N, n); 0 up to ``rtol`` of the
        torques for weight, motion and force.
    used :
        Share of each motor's limit that is used, shape (N, n); NaN where it is unknown.
    force :
        Force at the tip in the task's axes, N and N·m, shape (N, m).
    jump :
        ΔF: what the healthy arm would exert here minus ``force``, shape (N, m).
    margin :
        σ_min(K)/σ_max(J), shape (N,).
    verdict :
        Index in ``ftforce.core.verdict.VERDICTS``, shape (N,): 0 tolerated, 1 borderline, 2 not
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

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The verdict of each instant."""
        return tuple(VERDICTS[code] for code in self.verdict.tolist())

    @property
    def falls_from(self) -> int | None:
        """Index of the first instant at which nothing holds the arm, ``None`` if there is none.

        From there on the arm does not move as its positions say.
        """
        loose = np.isnan(self.force).any(axis=1) | self.unbalanced.any(axis=1)
        return int(loose.argmax()) if loose.any() else None

    @property
    def until_fall(self) -> slice:
        """The instants up to the first at which nothing holds the arm, which is the last."""
        return slice(None if self.falls_from is None else self.falls_from + 1)

    @property
    def orientation_error_norm(self) -> Vector:
        """Angle by which the tip is turned, rad, shape (N,)."""
        norms: Vector = np.linalg.norm(self.orientation_error, axis=1)
        return norms

    @property
    def path_error_norm(self) -> Vector:
        """Distance of the tip from where it should be, m, shape (N,)."""
        norms: Vector = np.linalg.norm(self.path_error, axis=1)
        return norms


QUANTITIES = tuple(field.name for field in fields(Run))
MOTIONS = ("q", "v", "a")
SCALARS = ("margin", "verdict")


def width(quantity: str, n: int, m: int) -> int | None:
    """Return how many numbers a quantity has at an instant; ``None`` for a single one.

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


@dataclass(frozen=True, slots=True, eq=False)
class History(Displayed):
    """An arm along its course while joints fail: as if healthy, without the remap and with it.

    Attributes
    ----------
    setting :
        What was simulated.
    t :
        Times, s, from 0, shape (N,).
    path :
        Where the tip should be, in the root's axes, m, shape (N, 3).
    healthy :
        What the arm would do without any fault.
    unremapped :
        What it does if the controller never learns of the faults.
    remapped :
        What it does if the controller reacts; ``None`` if that was not asked for.
    """

    setting: Setting
    t: Vector
    path: Matrix
    healthy: Run
    unremapped: Run
    remapped: Run | None

    @property
    def runs(self) -> dict[str, Run]:
        """The runs that there are, by name."""
        found = {name: getattr(self, name) for name in RUNS}
        return {name: run for name, run in found.items() if run is not None}

    @property
    def answer(self) -> Run:
        """The run with the remap, or if there is none the one without."""
        return self.unremapped if self.remapped is None else self.remapped

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the answer doubtful."""
        return self.setting.warnings

    def index(self, time: float) -> int:
        """Return the index of the last sample at or before a time, s."""
        return max(int(np.searchsorted(self.t, time, side="right")) - 1, 0)

    def jump_norm(self, run: Run) -> Vector:
        """Return the size of a run's force jump, N (N·m for a task of moments), shape (N,)."""
        task = self.setting.task
        rows = task.force_rows or task.moment_rows
        norms: Vector = np.linalg.norm(run.jump[:, list(rows)], axis=1)
        return norms
