"""Conditions at the fault: gravity, payload, motion, and the force exerted at the tip."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from ftforce.core.arrays import Vector, as_vector, read_only
from ftforce.core.changes import RneaChange, TipLoad
from ftforce.core.remap import dynamically_exerted_force, exerted_force, supported_force
from ftforce.errors import InputError
from ftforce.io.text import LARGEST_NUMBER, read_numbers
from ftforce.robot.dynamics import Payload, mass_matrix, motion_torque, weight_torque

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.analysis.drives import Drives
    from ftforce.core.arrays import Mask, Matrix
    from ftforce.core.limits import DriveTerms
    from ftforce.core.reduced_jacobian import ReducedJacobian
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot

_ROUNDING = 1e-12

PayloadLike: TypeAlias = "Payload | float | str | os.PathLike[str] | tuple[float, ArrayLike] | None"
Inverse = Literal["euclidean", "dynamic"]

INVERSES: tuple[str, ...] = get_args(Inverse)

# How a root can be mounted: roll and pitch, degrees.
MOUNTINGS = {"floor": (0.0, 0.0), "wall": (0.0, 90.0), "ceiling": (180.0, 0.0)}


class Conditions(NamedTuple):
    """Loads on the joints other than the tip force.

    Attributes
    ----------
    gravity :
        In root axes, m/s², shape (3,).
    is_model_gravity :
        Whether gravity is that of the model.
    payload :
        Payload at the tip; ``None`` if there is none.
    velocity, acceleration :
        Joint velocities and accelerations before the fault, rad or m, per s and per s², shape (n,);
        ``None`` if the arm is at rest.
    drives :
        Friction and rotor inertia of the drives; ``None`` if they do not count.
    """

    gravity: Vector
    is_model_gravity: bool
    payload: Payload | None
    velocity: Vector | None
    acceleration: Vector | None
    drives: Drives | None = None

    @classmethod
    def of(
        cls,
        robot: Robot,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        payload: PayloadLike = None,
        drives: Drives | None = None,
    ) -> Conditions:
        """Return validated conditions.

        Parameters
        ----------
        robot :
            The arm.
        velocity, acceleration :
            Shape (n,); zero by default.
        gravity :
            In root axes, m/s², shape (3,), or how the root is mounted, as in `mounted_gravity`; by
            default that of the model.
        payload :
            Mass at the tip, kg; with its position in tip axes (m) a pair ``(mass, (x, y, z))`` or a
            text ``mass@x,y,z``; with its inertia too, the path of a TOML file or
            `ftforce.robot.dynamics.Payload`.
        drives :
            Friction and rotor inertia of the drives, from
            `ftforce.analysis.drives.choose_drives`.

        Raises
        ------
        InputError
            An argument is invalid, or so large that torques computed from it would not be finite.
        """
        v = None if velocity is None else robot.vector(velocity, "velocity")
        a = None if acceleration is None else robot.vector(acceleration, "acceleration")
        _check_size(v, "velocity", "rad/s or m/s")
        _check_size(a, "acceleration", "rad/s² or m/s²")
        own = gravity is None
        if isinstance(gravity, str):
            gravity = mounted_gravity(robot, gravity)
        elif gravity is not None:
            gravity = as_vector(gravity, 3, "gravity", "x, y, z in m/s², in root axes")
            _check_size(gravity, "gravity", "m/s²")
        else:
            gravity = robot.gravity
        return cls(gravity, own, read_payload(payload), v, a, drives)

    @property
    def terms(self) -> DriveTerms | None:
        """What the drives of the healthy arm add; ``None`` if they do not count."""
        return None if self.drives is None else self.drives.terms

    def terms_after(self, free: Mask | None) -> DriveTerms | None:
        """Return what the drives add after a fault; ``None`` if they do not count.

        Parameters
        ----------
        free :
            True at free-swinging joints, shape (n,); ``None`` if there are none.
        """
        return None if self.drives is None else self.drives.after(free)

    @property
    def moves(self) -> bool:
        """Whether the arm moves before the fault."""
        v, a = self.velocity, self.acceleration
        return (v is not None and bool(v.any())) or (a is not None and bool(a.any()))


def mounted_gravity(robot: Robot, mounted: str) -> Vector:
    """Return gravity in root axes if the root link is mounted otherwise, m/s², shape (3,).

    The root is turned from upright by R = R_y(pitch) R_x(roll) about the axes of the world, whose z
    axis points up: gravity is Rᵀ (0, 0, -g), with the g of the model. On a ``wall`` (roll 0, pitch
    90°) the root's x axis points down, on a ``ceiling`` (roll 180°) its z axis does.

    Parameters
    ----------
    robot :
        The arm.
    mounted :
        ``floor``, ``wall``, ``ceiling``, or ``ROLL,PITCH`` in degrees.

    Raises
    ------
    InputError
        The text is neither.
    """
    word = mounted.strip().lower()
    if word in MOUNTINGS:
        roll, pitch = MOUNTINGS[word]
    else:
        try:
            roll, pitch = read_numbers(_without_commas(word), 2)
        except ValueError as problem:
            raise InputError(
                f"a mounting is floor, wall, ceiling, or ROLL,PITCH in degrees; {problem}"
            ) from None
    (sin_r, cos_r), (sin_p, cos_p) = _sine_cosine(roll), _sine_cosine(pitch)
    up = np.array([-sin_p, cos_p * sin_r, cos_p * cos_r])  # third row of R
    return read_only(-float(np.linalg.norm(robot.gravity)) * up + 0.0)  # 0.0 instead of -0.0


def _sine_cosine(degrees: float) -> tuple[float, float]:
    """Return sine and cosine, exact for whole right angles."""
    turn = math.radians(math.remainder(degrees, 360.0))
    return tuple(0.0 if abs(x) < _ROUNDING else x for x in (math.sin(turn), math.cos(turn)))  # type: ignore[return-value] # two of them


def _check_size(vector: Vector | None, name: str, unit: str) -> None:
    if vector is not None and np.abs(vector).max(initial=0.0) > LARGEST_NUMBER:
        raise InputError(f"{name} must not exceed {LARGEST_NUMBER:g} {unit}, got {vector}")


def read_payload(payload: PayloadLike) -> Payload | None:
    """Return a payload from a mass, a pair, a text or a file; ``None`` for no payload.

    Parameters
    ----------
    payload :
        Mass, kg; ``(mass, (x, y, z))`` with its position in tip axes, m; the path of a TOML file;
        or a text ``MASS[@x,y,z[@ixx,iyy,izz,ixy,ixz,iyz]]``.

    Raises
    ------
    InputError
        The value has another form, or its mass is negative.
    PayloadError
        The file cannot be read, or what it describes is no rigid body.
    """
    if isinstance(payload, os.PathLike) or (
        isinstance(payload, str) and payload.lower().endswith(".toml")
    ):
        from ftforce.analysis.payload_files import read_payload_file  # only needed for files

        return read_payload_file(payload)
    if payload is None or isinstance(payload, Payload):
        return payload
    if isinstance(payload, tuple):
        if len(payload) != 2:
            raise InputError(
                f"a payload is a mass and a position, (mass, (x, y, z)), got {payload!r}"
            )
        return Payload.of(*payload)
    if not isinstance(payload, str):
        return Payload.of(payload)
    mass, at, rest = payload.partition("@")
    place, has_inertia, moments = rest.partition("@")
    try:
        offset = read_numbers(_without_commas(place), 3) if at else (0.0, 0.0, 0.0)
        inertia = read_numbers(_without_commas(moments), 6) if has_inertia else None
        return Payload.of(read_numbers(mass, 1)[0], offset, inertia)
    except ValueError as problem:
        if isinstance(problem, InputError):
            raise
        raise InputError(
            f"a payload needs MASS or MASS@x,y,z (kg, m), e.g. 2.5@0,0,0.1, or a TOML file; "
            f"{problem}"
        ) from None


def _without_commas(place: str) -> str:
    parts = place.split(",")
    if not all(map(str.strip, parts)):
        raise ValueError(f"nothing stands beside a comma in {place!r}")
    return " ".join(parts)


def rnea_change(
    robot: Robot, q: Vector, conditions: Conditions, locked: Mask, free: Mask | None = None
) -> RneaChange:
    """Return the torques for weight and motion before and after joints lock.

    Velocity and acceleration of a locked joint are zero after the fault; those of the other joints
    do not change.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    conditions :
        Gravity, payload and motion.
    locked :
        True at locked joints, shape (n,).
    free :
        True at free-swinging joints, shape (n,); ``None`` if there are none.
    """
    own = None if conditions.is_model_gravity else conditions.gravity
    counted = weight_torque(robot, q, own, conditions.payload)
    known = robot.mass > 0.0
    gravity = counted if known or not conditions.gravity.any() else None
    still = robot.at_rest
    if not conditions.moves:
        return RneaChange(gravity, still, still, counted, counted)
    v = still if conditions.velocity is None else conditions.velocity
    a = still if conditions.acceleration is None else conditions.acceleration
    before = motion_torque(robot, q, v, a, conditions.payload, drives=conditions.terms)
    after = before
    if locked.any() or (free is not None and conditions.drives is not None):
        v, a = (np.where(locked, 0.0, x) for x in (v, a))
        terms = conditions.terms_after(free)
        after = motion_torque(robot, q, v, a, conditions.payload, drives=terms)
    return RneaChange(
        gravity,
        before if known else None,
        after if known else None,
        read_only(counted + before),
        read_only(counted + after),
    )


def tip_load(
    reduced: ReducedJacobian,
    task: Task,
    force: Vector | None,
    torque: Vector | None,
    *,
    M: Matrix | None = None,
) -> TipLoad | None:
    """Return the force of the healthy arm, F̂ = J J† F or (Jᵀ)† τ; ``None`` if neither is given.

    Parameters
    ----------
    reduced, task :
        The decomposed Jacobians of the arm, and the task.
    force :
        Force the tool exerts, N and N·m, in task axes, shape (m,).
    torque :
        In place of a force, motor torques for it, N·m (N), shape (n,).
    M :
        Mass matrix, shape (n, n); if given, the dynamically consistent inverse replaces the
        Euclidean one.
    """
    if force is not None:
        wanted = task.weigh_force(force)
        F = supported_force(reduced, wanted)
        return TipLoad(without_rounding(F, F, wanted), force, None)
    if torque is None:
        return None
    F = (
        exerted_force(reduced, torque)
        if M is None
        else dynamically_exerted_force(reduced, torque, M)
    )
    return TipLoad(without_rounding(F, F.dot(reduced.J), torque), None, torque)


def mass_matrix_for(
    robot: Robot, q: Vector, conditions: Conditions, inverse: Inverse
) -> Matrix | None:
    """Return the mass matrix that an inverse needs, shape (n, n); ``None`` for the Euclidean one.

    Parameters
    ----------
    robot, q, conditions :
        The arm, its joint positions, rad or m, shape (n,), and its payload.
    inverse :
        ``euclidean`` or ``dynamic``.

    Raises
    ------
    InputError
        The inverse needs masses, and the URDF has none.
    """
    if inverse == "euclidean":
        return None
    if robot.mass == 0.0:
        raise InputError(
            f"the dynamic inverse needs masses, but the URDF of {robot.name!r} has none; "
            "use the euclidean one"
        )
    return mass_matrix(robot, q, conditions.payload, conditions.terms)


def known_mass_matrix(robot: Robot, q: Vector, conditions: Conditions) -> Matrix | None:
    """Return the mass matrix, shape (n, n); ``None`` if masses are missing or unphysical.

    Parameters
    ----------
    robot, q, conditions :
        The arm, its joint positions, rad or m, shape (n,), and its payload.
    """
    if robot.mass == 0.0:
        return None
    try:
        return mass_matrix(robot, q, conditions.payload, conditions.terms)
    except InputError:
        return None


def without_rounding(F: Vector, part: Vector, whole: Vector) -> Vector:
    """Return F, or zero if its part of the request is within rounding error.

    Without this the verdict would depend on the direction of rounding errors.

    Parameters
    ----------
    F :
        Exerted force, weighted, shape (m,).
    part, whole :
        The part of the request that F accounts for, and the request: forces or torques.
    """
    return F if part.dot(part) > (_ROUNDING * _ROUNDING) * whole.dot(whole) else np.zeros_like(F)
