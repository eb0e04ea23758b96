"""An oracle that shares no mathematics with ftforce: the arm as rigid bodies in MuJoCo.

MuJoCo reads the robot's own URDF file and works out poses, masses and gravity by itself. What it
takes from ftforce: the joint names along the chain, the tip link, and where other joints are held.

Joints are given by index, from 0. All numbers are in rad, m, kg, s, N and N·m.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import ArrayLike

    from ftforce import Robot
    from ftforce.core.arrays import Matrix, Vector

GRAVITY = (0.0, 0.0, -9.81)  # m/s², in the root's axes
STEP = 5e-4  # s
PIN_TIME = 4 * STEP  # time constants with which a pin and a brake take errors away, s
BRAKE_TIME = 1e-7  # below 3e-8 MuJoCo would soften a brake silently

# MuJoCo's constraints give way a little, for which it estimates how easily each body moves. The
# least that can be set is 1e-4 of that; as constraints alone read the estimates, these are scaled.
SOFTNESS = 1e-6

TIP, PLACE = "ftforce tip", "ftforce place of the tip"
KEPT = {
    "robot": {"link", "joint"},
    "link": {"inertial"},
    "joint": {"parent", "child", "origin", "axis"},
}


class Payload(NamedTuple):
    """A point mass fixed to the tip link, at ``com`` in tool axes."""

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Pinned(NamedTuple):
    """What a pinned arm does.

    Attributes
    ----------
    force :
        What the robot with its payload exerts on its environment, at the first instant, in tool
        axes, shape (3,); of a weld, the moment about the tip too, shape (6,).
    acceleration :
        At the first instant, shape (n,); 0 at locked joints.
    load :
        What motor or brake carries at the first instant, shape (n,).
    drift :
        Largest distance of any joint from its start, at any time.
    """

    force: Vector
    acceleration: Vector
    load: Vector
    drift: float


class Simulation(NamedTuple):
    """MuJoCo's model and data; its coordinates are the joints ``moving``."""

    model: Any
    data: Any
    moving: list[int]


# ---- questions -------------------------------------------------------------------------------


def pinned(
    robot: Robot,
    q: ArrayLike,
    tau: ArrayLike,
    *,
    locked: Collection[int] = (),
    gravity: ArrayLike = GRAVITY,
    payload: Payload | None = None,
    weld: bool = False,
    duration: float = 0.0,
) -> Pinned:
    """Pin the tip of a resting arm to the world, apply constant torques, and see what happens.

    Along a direction in which the tip cannot move anyway, physics leaves the force open: it
    depends on how the pin was fastened. Here it is a spring, equal in all directions, fastened
    without preload, so along such a direction it carries nothing.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, shape (n,).
    tau :
        Motor torques, which carry the weight too, shape (n,). Those of locked joints do not act.
    locked :
        Joints that are removed from the model: their brakes hold.
    gravity :
        In the root's axes.
    payload :
        What hangs on the tip link.
    weld :
        Whether the pin keeps the tip from turning, too.
    duration :
        How long the drift is watched.
    """
    q, tau, surroundings = np.asarray(q), np.asarray(tau), {"gravity": gravity, "payload": payload}
    simulation = simulate(robot, q, locked=locked, pin=True, weld=weld, **surroundings)
    model, data, moving = simulation
    data.qfrc_applied[:] = tau[moving]
    mujoco.mj_forward(model, data)
    force, acceleration = _force_on_the_pin(simulation, weld), np.zeros(robot.n)
    acceleration[moving] = data.qacc
    load = inverse_dynamics(robot, q, 0.0, acceleration, force=force, **surroundings)
    drift = 0.0
    for _ in range(round(duration / STEP)):
        mujoco.mj_step(model, data)
        drift = max(drift, np.abs(data.qpos - q[moving]).max(initial=0.0))
    return Pinned(force, acceleration, load, drift)


def inverse_dynamics(
    robot: Robot,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    *,
    force: ArrayLike = (0.0, 0.0, 0.0),
    gravity: ArrayLike = GRAVITY,
    payload: Payload | None = None,
) -> Vector:
    """Return the torques with which the arm moves so while its tip exerts a force, shape (n,)."""
    model, data, _ = simulate(robot, q, v, gravity=gravity, payload=payload)
    data.qacc[:] = a
    mujoco.mj_inverse(model, data)
    wrench, carried, tip = np.zeros((2, 3)), np.zeros(robot.n), data.site(TIP)
    wrench.flat[: np.size(force)] = force
    linear, angular = wrench @ tip.xmat.reshape(3, 3).T
    body = model.site(TIP).bodyid.item()
    mujoco.mj_applyFT(model, data, linear, angular, tip.xpos, body, carried)
    return data.qfrc_inverse + carried


def mass_matrix(robot: Robot, q: ArrayLike, payload: Payload | None = None) -> Matrix:
    """Return the mass matrix, shape (n, n)."""
    rest, nothing = np.zeros(robot.n), {"gravity": np.zeros(3), "payload": payload}
    columns = (inverse_dynamics(robot, q, rest, a, **nothing) for a in np.eye(robot.n))
    return np.column_stack(list(columns))


def brake(
    robot: Robot,
    q: ArrayLike,
    v: ArrayLike,
    locked: Collection[int],
    payload: Payload | None = None,
) -> tuple[Vector, Vector]:
    """Stop joints of a moving arm whose tip is free, almost at once.

    Nothing else acts: weight and motors have no time to.

    Returns
    -------
    :
        Velocities when they have stopped: of the joints, shape (n,); of the tip, in tool axes,
        shape (3,).
    """
    nothing = {"gravity": np.zeros(3), "payload": payload}
    model, data, _ = simulate(robot, q, v, brakes=locked, **nothing)
    for _ in range(100):  # of a fifth of the time constant
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    twist, site = np.zeros(6), model.site(TIP).id
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 1)
    return data.qvel.copy(), twist[3:]  # MuJoCo has angular rows first


# ---- the model -------------------------------------------------------------------------------


def simulate(
    robot: Robot,
    q: ArrayLike,
    v: ArrayLike = 0.0,
    *,
    locked: Collection[int] = (),
    brakes: Collection[int] = (),
    pin: bool = False,
    weld: bool = False,
    gravity: ArrayLike = GRAVITY,
    payload: Payload | None = None,
) -> Simulation:
    """Return the arm in MuJoCo, at ``q`` and with velocities ``v``.

    ``locked`` joints are removed, ``brakes`` stop joints where they are now, and ``pin`` holds the
    tip where it is now (either brakes or a pin).
    """
    assert not (pin and brakes)
    q, v = np.broadcast_to(q, robot.n), np.broadcast_to(v, robot.n)
    moving = [i for i in range(robot.n) if i not in locked]
    held = {**robot.held, **{robot.names[i]: q[i] for i in locked}}
    spec = _arm(robot, [robot.names[i] for i in moving], held)
    spec.option.gravity = gravity
    spec.option.timestep = BRAKE_TIME / 5 if brakes else STEP
    spec.option.tolerance, spec.option.iterations = 0.0, 10  # equalities only: one would do
    spec.body(robot.tip).add_site(name=TIP)
    if payload is not None:
        point = np.full(3, 1e-9 * payload.mass)  # a body that moves has to have some inertia
        spec.body(robot.tip).add_body(
            ipos=payload.com, mass=payload.mass, inertia=point, explicitinertial=True
        )
    if pin:
        _, data = _compile(spec, q[moving], v[moving])
        _pin(spec, data.body(robot.tip), weld)
    for i in brakes:
        stop = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=robot.names[i])
        stop.data[:5] = 0.0  # the place; compiling takes a step with all joints at 0
        _stiffen(stop, BRAKE_TIME)
    model, data = _compile(spec, q[moving], v[moving])
    if brakes:
        model.eq_data[:, 0] = q[list(brakes)]
        mujoco.mj_forward(model, data)
    return Simulation(model, data, moving)


def _arm(robot: Robot, moving: list[str], held: Mapping[str, float]) -> Any:
    """Return the URDF in MuJoCo; its joints are those that move, all others are fixed."""
    assert not any(joint.followers for joint in robot.joints), "followers are not simulated"
    spec = mujoco.MjSpec.from_string(_bare_urdf(robot))
    spec.compiler.fusestatic = False  # the tip link is to stay, often it has no mass
    for body in spec.bodies:
        for joint in body.joints:
            if joint.name not in moving:
                _freeze(body, joint, held[joint.name])
                spec.delete(joint)
    assert [joint.name for joint in spec.joints] == moving
    return spec


def _bare_urdf(robot: Robot) -> str:
    """Return the URDF without what statics and dynamics do not need.

    Geometry would ask for meshes, and lend mass to links without any. Limits, friction and damping
    would act. Masses that cannot move would only have to be plausible.
    """
    root = ET.parse(robot.path).getroot()
    for element in (root, *root):
        for part in list(element):
            if part.tag not in KEPT.get(element.tag, ()):
                element.remove(part)
    above = {joint.find("child").get("link"): joint for joint in root.iter("joint")}
    for joint in above.values():
        if joint.get("type") in {"floating", "planar"}:
            joint.set("type", "fixed")
    for link in root.iter("link"):
        joint = above.get(link.get("name"))
        while joint is not None and joint.get("name") not in robot.names:
            joint = above.get(joint.find("parent").get("link"))
        if joint is None:
            link[:] = []
    return ET.tostring(root, encoding="unicode")


def _freeze(body: Any, joint: Any, value: float) -> None:
    """Put a body where its joint, which is to be removed, has this value."""
    axis, turn = np.zeros(3), np.zeros(4)
    if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
        mujoco.mju_axisAngle2Quat(turn, joint.axis / np.linalg.norm(joint.axis), value)
        mujoco.mju_mulQuat(turn, body.quat.copy(), turn.copy())
        body.quat = turn
    else:
        assert joint.type == mujoco.mjtJoint.mjJNT_SLIDE
        mujoco.mju_rotVecQuat(axis, joint.axis / np.linalg.norm(joint.axis), body.quat)
        body.pos = body.pos + value * axis


def _pin(spec: Any, tip: Any, weld: bool) -> None:
    """Hold the tip where it is."""
    spec.worldbody.add_site(name=PLACE, pos=tip.xpos, quat=tip.xquat)
    kind = mujoco.mjtEq.mjEQ_WELD if weld else mujoco.mjtEq.mjEQ_CONNECT
    hold = spec.add_equality(type=kind, name1=TIP, name2=PLACE)
    hold.objtype = mujoco.mjtObj.mjOBJ_SITE
    hold.data[10] = 1.0  # a weld's "torquescale"
    _stiffen(hold, PIN_TIME)


def _stiffen(equality: Any, time: float) -> None:
    """Let a constraint take away errors with critical damping and yield as little as possible."""
    equality.solref = time, 1.0
    equality.solimp = 0.9999, 0.9999, 1.0, 0.5, 2.0


def _compile(spec: Any, q: Vector, v: Vector) -> tuple[Any, Any]:
    model = spec.compile()
    model.body_invweight0[:] *= SOFTNESS
    model.dof_invweight0[:] *= SOFTNESS
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    return model, data


def _force_on_the_pin(simulation: Simulation, weld: bool) -> Vector:
    """Return force, of a weld moment too, that the tip exerts on the pin, in tool axes.

    A row of a constraint moves with the tip relative to the pin, so its force acts on the tip.
    The rows of a connect are the tip's velocity in world axes. A weld has three more: they are
    imaginary parts of a quaternion, that is, half the angular velocity, in the pin's axes.
    """
    model, data, _ = simulation
    size = 6 if weld else 3
    if not data.nefc:  # nothing can move the tip
        return np.zeros(size)
    tip = data.site(TIP)
    R, J = tip.xmat.reshape(3, 3), np.zeros((2, 3, model.nv))
    mujoco.mj_jacSite(model, data, J[0], J[1], model.site(TIP).id)
    rows = np.vstack([J[0], 0.5 * R.T @ J[1]])[:size]
    np.testing.assert_allclose(data.efc_J.reshape(size, -1), rows, atol=1e-12)
    on_tip = data.efc_force
    return -np.concatenate([R.T @ on_tip[:3], 0.5 * on_tip[3:]])
