"""A controller that does what a `History` says, in closed loop with an arm in MuJoCo.

The arm is rigid bodies from its own URDF (`physics`), with weight and without friction. Its tip
slides on a stiff wall, a contact without friction, which bears a force along its normal alone; or
a carriage holds it, which moves along the path whatever pushes on it and bears a force in any
direction, but no moment.

The controller does what a user would do: every motor gives the torque that the history says,
interpolated in time, and acts like a spring and a damper between where its joint is and where the
history has it. The brake of a joint that locks is a constraint. A joint that goes free gets no
torque at all.

What this takes from ftforce: a run of the history (q, v, motor), its path, times and gravity;
joints and times of the faults; and what `physics` takes. Every force is MuJoCo's.

Joints are given by index, from 0. All numbers are in rad, m, kg, s, N and N·m.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

import ftforce
import physics
from ftforce.core.faults import FaultMode
from ftforce.trajectory.fault_events import read_events
from physics import PIN_TIME, STEP, TIP

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from numpy.typing import ArrayLike

    from ftforce import Robot
    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.trajectory.fault_events import Events
    from ftforce.trajectory.history import History, Run

SETTLED = 0.2  # s after the start, a fault or its remap, in which forces may be off
STIFFNESS = 400.0  # N·m/rad, of the controller's springs
SELDOM = 20  # steps between two in which the share of the springs in the force is worked out
BALL = 0.01  # radius of the ball at the tip that touches the wall, m
BITE = 1e-6  # how deep it is in the wall at the start, as the wall gives way a little, m
WALL, CARRIAGE = "ftforce wall", "ftforce carriage"
HARD = 0.9999, 0.9999, 1.0, 0.5, 2.0  # of brakes and carriage
STIFF = 0.998, 0.998, 1.0, 0.5, 2.0  # of the wall: were it harder, rounding would lift the tip off


@dataclass(frozen=True)
class Loop:
    """What happens in MuJoCo, at each of N steps.

    Attributes
    ----------
    t :
        Times, shape (N,).
    fault, remap :
        When the first fault happens, and when the controller reacts to the last one.
    asked :
        Size of the force that is asked for.
    force, told :
        What the tip exerts on wall or carriage, and what the history says of it, in the components
        and axes of its task, shape (N, m).
    share :
        What springs and dampers add to the force, likewise; NaN at most steps.
    brake, brake_told :
        What the brakes of locked joints carry, and what the history says of it, shape (N, n).
    off :
        Positions of the joints minus those in the history, shape (N, n).
    place, path :
        Where the tip is, and where it should be, in the root's axes, shape (N, 3).
    """

    t: Vector
    fault: float
    remap: float
    asked: float
    force: Matrix
    told: Matrix
    share: Matrix
    brake: Matrix
    brake_told: Matrix
    off: Matrix
    place: Matrix
    path: Matrix

    @property
    def before(self) -> Mask:
        """The steps before any fault, without those in which the simulation settles."""
        return (self.t >= SETTLED) & (self.t < self.fault - 0.5 * STEP)

    @property
    def after(self) -> Mask:
        """The steps after all faults and remaps, without those in which they settle."""
        return self.t >= self.remap + SETTLED

    @property
    def first(self) -> int:
        """The step of the first fault: its force belongs to positions from before it."""
        return math.ceil(self.fault / STEP - 0.5)

    def error(self, steps: Mask, told: ArrayLike | None = None) -> float:
        """Return how far the force is off at any of some steps, as a share of what is asked.

        ``told`` is a force to compare with instead of the run's own, shape (m,) or (N, m).
        """
        wanted = self.told if told is None else np.broadcast_to(told, self.told.shape)
        return _largest(self.force[steps] - wanted[steps]) / self.asked

    def controller_share(self, steps: Mask) -> float:
        """Return what springs and dampers add to the force at any of some steps, likewise."""
        return _largest(self.share[steps]) / self.asked

    def brake_error(self, steps: Mask) -> float:
        """Return how far the load of any brake is off at any of some steps."""
        return float(np.abs(self.brake - self.brake_told)[steps].max())

    def drift(self, steps: Mask) -> float:
        """Return how far any joint is from where the history has it."""
        return float(np.abs(self.off[steps]).max())

    def off_path(self, steps: Mask) -> float:
        """Return how far the tip is from where it should be."""
        return _largest((self.place - self.path)[steps])


def _largest(rows: Matrix) -> float:
    return float(np.nanmax(np.linalg.norm(rows, axis=1)))


# ---- questions -------------------------------------------------------------------------------


def press(
    robot: Robot,
    history: History,
    run: Run,
    faults: Events,
    *,
    wall: ArrayLike | None = None,
) -> Loop:
    """Let the controller do what a run says, and see which force comes of it.

    Parameters
    ----------
    robot, history :
        The arm, without a payload, and what `ftforce.simulate` says of it; forces alone.
    run :
        The run of the history that the controller follows.
    faults :
        What `ftforce.simulate` was given: joints that lock or go free, when there are samples.
    wall :
        In which direction the tip presses on a wall that contains the path, in the root's axes,
        shape (3,). Without it a carriage holds the tip.
    """
    events = read_events(robot, faults)
    times = [event.time for event in events]
    delay = history.setting.delay if run is history.remapped else 0.0
    law = Law.of(history, run, {*times, *(time + delay for time in times)})
    t = STEP * np.arange(round(history.t[-1] / STEP))
    course = CubicSpline(history.t, history.path)
    path, velocity = course(t), course(t, 1)
    arm = Arm.build(robot, run.q[0], path[0], history.setting.gravity, wall)
    dampers = damping(robot, run.q[0])
    waiting, working, found = list(events), np.ones(robot.n), []
    for k, now in enumerate(t.tolist()):
        while waiting and now > waiting[0].time - 0.5 * STEP:
            for fault in waiting.pop(0).faults.faults:
                assert fault.mode is not FaultMode.WEAK
                working[fault.joint] = 0.0
                if fault.mode is FaultMode.LOCKED:
                    arm.stop(fault.joint)
        wanted = law.at(now)
        off = arm.q - wanted.q
        own = working * (dampers * (wanted.v - arm.v) - STIFFNESS * off)
        arm.step(working * wanted.motor + own, path[k], velocity[k])
        axes = arm.axes if history.setting.task.axes == "tool" else np.eye(3)
        share = arm.force_of(own) if k % SELDOM == 0 else np.full(3, np.nan)
        both = np.vstack([arm.force, share]) @ axes
        found.append((*both[:, history.setting.task.rows], wanted.force, arm.brake, wanted.brake,
                      off, arm.place))  # fmt: skip
    force, share, told, brake, brake_told, off, place = map(np.array, zip(*found, strict=True))
    asked = float(np.linalg.norm(history.setting.force))
    return Loop(
        t, times[0], times[-1] + delay, asked,
        force, told, share, brake, brake_told, off, place, path,
    )  # fmt: skip


def damping(robot: Robot, q: Vector) -> Vector:
    """Return the dampers at the joints: critical if all other joints were let go, shape (n,)."""
    inertia = 1.0 / np.diag(np.linalg.inv(physics.mass_matrix(robot, q)))
    return 2.0 * np.sqrt(STIFFNESS * inertia)


def seen_from(robot: Robot, axes: ArrayLike, file: Path) -> Robot:
    """Return the same arm with a root that is turned, so that a wall can be square to its axes.

    Parameters
    ----------
    robot :
        The arm; its base is the root of its URDF.
    axes :
        Axes of the new root in those of the old one, as columns, shape (3, 3).
    file :
        Where the URDF is written.
    """
    R = np.transpose(axes)
    roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    root = ET.parse(robot.path).getroot()
    ET.SubElement(root, "link", name=WALL)
    joint = ET.SubElement(root, "joint", name=f"{WALL} to base", type="fixed")
    ET.SubElement(joint, "parent", link=WALL)
    ET.SubElement(joint, "child", link=robot.base)
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy=f"{roll!r} {pitch!r} {yaw!r}")
    file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    turned = ftforce.load_robot(file, tip=robot.tip)
    assert turned.base == WALL
    return turned


# ---- the controller's orders -----------------------------------------------------------------


class Wanted(NamedTuple):
    """What a run says of an instant."""

    q: Vector
    v: Vector
    motor: Vector
    force: Vector
    brake: Vector


class Law(NamedTuple):
    """A run as a function of time: straight from sample to sample, but for steps at faults.

    Attributes
    ----------
    rows, slopes :
        What `Wanted` holds, at each sample, and how much it changes until the next one.
    ends :
        Where the parts of a row end.
    rate :
        Samples per second.
    """

    rows: Matrix
    slopes: Matrix
    ends: list[int]
    rate: float

    @classmethod
    def of(cls, history: History, run: Run, steps: Iterable[float]) -> Law:
        """Return the law of a run with steps at some times, which are those of samples."""
        parts = (run.q, run.v, run.motor, run.force, run.brake)
        rows, ends = np.hstack(parts), np.cumsum([part.shape[1] for part in parts]).tolist()
        assert np.isfinite(rows).all(), "nothing holds the arm"
        slopes = np.diff(rows, axis=0)
        for step in steps:
            i = round(step / history.t[1])
            assert abs(history.t[i] - step) < 1e-9
            slopes[i - 1] = slopes[i - 2]  # nobody foresees a fault
        return cls(rows, slopes, ends, 1.0 / float(history.t[1]))

    def at(self, t: float) -> Wanted:
        """Return what is wanted at a time."""
        i = min(int(t * self.rate + 1e-6), len(self.slopes) - 1)
        row = self.rows[i] + (t * self.rate - i) * self.slopes[i]
        return Wanted(*(row[a:b] for a, b in zip([0, *self.ends], self.ends, strict=False)))


# ---- the arm ---------------------------------------------------------------------------------


class Arm:
    """The arm in MuJoCo, with what its tip presses on.

    Attributes
    ----------
    q, v :
        Positions and velocities of the joints, shape (n,); these change with every step.
    """

    def __init__(self, model: Any, normal: Vector | None, q: Vector) -> None:
        self._model, self._normal = model, normal
        self._data = mujoco.MjData(model)
        self._tip = self._data.site(TIP)
        self.q, self.v = self._data.qpos, self._data.qvel
        self.q[:] = q

    @classmethod
    def build(
        cls,
        robot: Robot,
        q: Vector,
        place: Vector,
        gravity: ArrayLike,
        wall: ArrayLike | None,
    ) -> Arm:
        """Return the arm at rest, with its tip at a place on the wall or in the carriage."""
        spec = physics._arm(robot, list(robot.names), robot.held)
        spec.option.gravity, spec.option.timestep = gravity, STEP
        spec.option.tolerance, spec.option.iterations = 1e-14, 50
        tip, normal = spec.body(robot.tip), None
        tip.add_site(name=TIP)
        for name in robot.names:
            brake = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=name, active=False)
            brake.data[:5] = 0.0
            _stiffen(brake, HARD)
        if wall is None:
            spec.worldbody.add_body(name=CARRIAGE, mocap=True, pos=place).add_site(name=CARRIAGE)
            hold = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, name1=TIP, name2=CARRIAGE)
            hold.objtype = mujoco.mjtObj.mjOBJ_SITE
            _stiffen(hold, HARD)
        else:
            normal, outwards = np.asarray(wall) / np.linalg.norm(wall), np.zeros(4)
            mujoco.mju_quatZ2Vec(outwards, -normal)
            plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [1.0, 1.0, 1.0]}
            plane |= {"pos": place + (BALL - BITE) * normal, "quat": outwards}
            ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [BALL, 0.0, 0.0], "mass": 0.0}
            for body, geometry in ((tip, ball), (spec.worldbody, plane)):
                _stiffen(body.add_geom(condim=1, **geometry), STIFF)
        return cls(spec.compile(), normal, q)

    def stop(self, joint: int) -> None:
        """Apply the brake of a joint, where the joint is now."""
        self._model.eq_data[joint, 0] = self.q[joint]
        self._data.eq_active[joint] = True

    def step(self, torque: Vector, place: Vector, velocity: Vector) -> None:
        """Apply torques for one step, with the carriage at a place and moving.

        What is read afterwards, but q and v, belongs to the step's beginning.
        """
        if self._normal is None:
            # Such a constraint follows a steady motion at a distance: damping over stiffness.
            self._data.mocap_pos[0] = place + 2.0 * PIN_TIME * velocity
        self._data.qfrc_applied[:] = torque
        mujoco.mj_step(self._model, self._data)

    @property
    def axes(self) -> Matrix:
        """Axes of the tool, as columns."""
        return self._tip.xmat.reshape(3, 3)

    @property
    def place(self) -> Vector:
        """Where the tip is."""
        return self._tip.xpos.copy()

    @property
    def force(self) -> Vector:
        """What the tip exerts, in the root's axes, shape (3,)."""
        return self._exerted(self._data.efc_force)

    @property
    def brake(self) -> Vector:
        """What the brakes carry, shape (n,)."""
        load = np.zeros(self._model.nv)
        active = np.flatnonzero(self._data.eq_active[: len(load)])
        load[active] = self._data.efc_force[: len(active)]
        return load

    def force_of(self, torque: Vector) -> Vector:
        """Return the part of the force that is due to some torques, likewise.

        What constraints exert is linear in the torques: ``-(J M⁻¹ Jᵀ)⁻¹ J M⁻¹ τ``.
        """
        model, data = self._model, self._data
        J = data.efc_J.reshape(data.nefc, model.nv)
        lever = np.zeros_like(J)  # J M⁻¹
        mujoco.mj_solveM(model, data, lever, J)
        return self._exerted(-np.linalg.lstsq(lever @ J.T, lever @ torque)[0])

    def _exerted(self, rows: Vector) -> Vector:
        """Return what the tip exerts, of what constraints exert on the arm: brakes come first.

        A carriage has three rows, in the root's axes; a contact one, a force that pushes it off.
        """
        if self._normal is None:
            return -rows[-3:]
        return rows[-1] * self._normal if self._data.ncon else np.zeros(3)


def _stiffen(element: Any, impedance: tuple[float, ...]) -> None:
    element.solref, element.solimp = (PIN_TIME, 1.0), impedance
