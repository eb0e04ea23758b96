"""The tip point of an arm, for questions about where it gets to: its motion as screws and bounds.

Positions of a planar arm are points of its plane, of two coordinates; otherwise there are three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.numpy_path import place
from ftforce.batch.plan import mechanism_of, question_of
from ftforce.core.arrays import read_only
from ftforce.core.task import COMPONENTS, Task
from ftforce.errors import InputError
from ftforce.robot.kinematics import joint_frames, noise_floor, tip_pose

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ftforce.batch.kernels.layout import Mechanism
    from ftforce.batch.kernels.layout import Question as KernelQuestion
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

    Stack = NDArray[np.float64]

_ROUNDING = 1e-9
_BLOCK = 8192  # postures at once, so that their frames stay in the cache


@dataclass(frozen=True, eq=False)
class TipPoint:
    """Where the tip of an arm gets to, in m coordinates of the root's axes.

    Attributes
    ----------
    robot :
        The arm.
    rows :
        The coordinates: (0, 1, 2), or two of them for a planar arm.
    moving :
        Number of joints, from the base, that move the tip point; it lies on the axes of the others.
    axes, points :
        Direction of each joint axis with all joints at zero, and a point on it, m, shape (n, 3).
    is_prismatic :
        Whether each joint slides, shape (n,).
    home :
        Tip position with all joints at zero, m, shape (3,).
    reaches :
        Upper bound on the distance of the tip from the point on each axis, m, shape (n,).
    largest :
        Upper bounds on derivatives of the tip position, of any order, of which the last joint is
        this one, shape (n,).
    """

    robot: Robot
    rows: tuple[int, ...]
    moving: int
    axes: Matrix
    points: Matrix
    is_prismatic: NDArray[np.bool_]
    home: Vector
    reaches: Vector
    largest: Vector
    _mechanism: Mechanism
    _question: KernelQuestion

    @classmethod
    def of(cls, robot: Robot, task: str | Iterable[str] | Task | None = None) -> TipPoint:
        """Return the tip point of an arm.

        Parameters
        ----------
        robot :
            The arm.
        task :
            ``force`` for a point in space, two components such as ``fx,fy`` for a point of the
            plane of a planar arm. By default the plane of a planar arm, else space.

        Raises
        ------
        InputError
            The task does not suit the arm, a joint has followers or unlimited travel.
        """
        rows = _rows(robot, task)
        wanted = Task(COMPONENTS, "world")
        mechanism = mechanism_of(robot, needs_gravity=False)
        question = question_of(
            wanted,
            robot.n,
            force=None,
            direction=None,
            limits=None,
            rtol=0.0,
            wary=0.0,
            floors=noise_floor(robot),
            needs_gravity=False,
        )
        zero = np.zeros(robot.n)
        axes, places = _screws(robot)
        home = tip_pose(robot, zero)[1]
        is_prismatic = np.array([joint.type == "prismatic" for joint in robot.joints])
        points, lengths = _shortest(axes, places, home, is_prismatic)
        reaches = np.cumsum((lengths + _travel(robot))[::-1])[::-1]
        reaches = reaches - np.where(is_prismatic, _travel(robot), 0.0)
        return cls(
            robot=robot,
            rows=rows,
            moving=_moving(axes, points, is_prismatic, home),
            axes=read_only(axes),
            points=read_only(points),
            is_prismatic=read_only(is_prismatic),
            home=read_only(home),
            reaches=read_only(reaches),
            largest=read_only(np.where(is_prismatic, 1.0, reaches)),
            _mechanism=mechanism,
            _question=question,
        )

    @property
    def m(self) -> int:
        """Number of coordinates: 3, or 2 for a planar arm."""
        return len(self.rows)

    @property
    def unit(self) -> str:
        """Unit of what is measured in these coordinates: m³ or m²."""
        return "m³" if self.m == 3 else "m²"

    def placed(self, q: Matrix) -> tuple[Matrix, Stack, Stack]:
        """Return tip positions, m, shape (k, m), and Jacobians of position and rotation.

        These have the shapes (k, m, n) and (k, 3, n).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        """
        tips, jacobians = [np.zeros((0, 3))], [np.zeros((0, 6, self.robot.n))]
        for first in range(0, len(q), _BLOCK):
            found = place(self._mechanism, self._question, q[first : first + _BLOCK])
            tips.append(found.tip)
            jacobians.append(found.J)
        J = np.concatenate(jacobians)
        return np.concatenate(tips)[:, self.rows], J[:, self.rows], J[:, 3:]

    def undone(self, joint: int, position: float, points: Matrix) -> Matrix:
        """Return points before the motion of a joint from zero to a position, shape (k, m).

        Parameters
        ----------
        joint :
            Index of the joint.
        position :
            Position of the joint, rad or m.
        points :
            Points after the motion, m, shape (k, m).
        """
        rows = list(self.rows)
        axis = self.axes[joint]
        if self.is_prismatic[joint]:
            moved: Matrix = points - position * axis[rows]
            return moved
        c, s = math.cos(position), math.sin(position)
        cross = np.cross(np.eye(3), axis)  # [axis]×
        R = c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)
        R = R.T[np.ix_(rows, rows)]
        centre = self.points[joint][rows]
        turned: Matrix = (points - centre) @ R.T + centre
        return turned

    def lever(self, joint: int, points: Matrix) -> Vector:
        """Return the distances of points from a joint axis, m; 1 if it slides, shape (k,).

        Parameters
        ----------
        joint :
            Index of the joint.
        points :
            Points, m, shape (k, m).
        """
        if self.is_prismatic[joint]:
            return np.ones(len(points))
        rows = list(self.rows)
        arm = points - self.points[joint][rows]
        along = arm @ self.axes[joint][rows] if self.m == 3 else np.zeros(len(arm))
        square = np.einsum("ij,ij->i", arm, arm) - along**2
        distance: Vector = np.sqrt(np.maximum(square, 0.0))
        return distance


def _rows(robot: Robot, task: str | Iterable[str] | Task | None) -> tuple[int, ...]:
    """Return the coordinates that a task stands for."""
    normal = _normal(robot)
    plane = tuple(i for i in range(3) if i != normal)
    if task is None:
        return plane
    wanted = Task.parse(task, "world")
    rows = tuple(COMPONENTS.index(name) for name in wanted.components)
    in_words = ",".join(COMPONENTS[i] for i in plane)
    if sorted(rows) == [0, 1, 2] and normal is None:
        return (0, 1, 2)
    if len(rows) == 2 and sorted(rows) == list(plane):
        return plane
    if normal is None:
        raise InputError(
            f"the tip of this arm moves in space, so that the task is force, not '{wanted}'; two "
            "components such as fx,fy are for an arm whose joint axes are all parallel"
        )
    raise InputError(
        f"the tip of this arm moves in a plane, so that the task is {in_words}, not '{wanted}'"
    )


def _screws(robot: Robot) -> tuple[Matrix, Matrix]:
    """Return the joint axes with all joints at zero, and the places of the joints."""
    from ftforce.robot.kinematics import frame_jacobian

    if any(joint.followers for joint in robot.joints):
        names = ", ".join(joint.name for joint in robot.joints if joint.followers)
        raise InputError(f"reach is for arms without mimic joints; one follows: {names}")
    J = frame_jacobian(robot, np.zeros(robot.n), "world")
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    axes = np.where(slides[:, None], J[:3].T, J[3:].T)
    places = np.array([place for _, place in joint_frames(robot, np.zeros(robot.n))[1:]])
    return axes / np.linalg.norm(axes, axis=1)[:, None], places


def _normal(robot: Robot) -> int | None:
    """Return the root axis normal to the plane of a planar arm; ``None`` if it is not planar."""
    axes, _ = _screws(robot)
    for k in range(3):
        along = np.abs(axes[:, k])
        slides = np.array([joint.type == "prismatic" for joint in robot.joints])
        if (np.where(slides, along, 1.0 - along) <= _ROUNDING).all():
            return k
    return None


def _travel(robot: Robot) -> Vector:
    """Return how far each joint slides from zero at most, m; 0 for a hinge, shape (n,)."""
    farthest = np.maximum(np.abs(robot.lower), np.abs(robot.upper))
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    if (slides & ~np.isfinite(farthest)).any():
        raise InputError("reach needs limits of every prismatic joint")
    return np.where(slides, farthest, 0.0)


def _shortest(
    axes: Matrix, places: Matrix, home: Vector, slides: NDArray[np.bool_]
) -> tuple[Matrix, Vector]:
    """Return points on the joint axes that make the links short, and the lengths of the links."""
    from scipy.optimize import minimize

    def lengths(along: Vector) -> Vector:
        points = places + np.where(slides, 0.0, along)[:, None] * axes
        found: Vector = np.linalg.norm(np.diff([*points, home], axis=0), axis=1)
        return found

    start = np.zeros(len(axes))
    found = minimize(lambda x: lengths(x).sum(), start, method="Powell").x
    best = min((start, found), key=lambda x: float(lengths(x).sum()))
    return places + np.where(slides, 0.0, best)[:, None] * axes, lengths(best)


def _moving(axes: Matrix, points: Matrix, slides: NDArray[np.bool_], home: Vector) -> int:
    """Return the number of joints that move the tip point; it lies on the axes of the others."""
    moving = len(axes)
    while moving:
        arm = home - points[moving - 1]
        off = np.linalg.norm(arm - (arm @ axes[moving - 1]) * axes[moving - 1])
        if slides[moving - 1] or off > _ROUNDING:
            break
        moving -= 1
    return moving
