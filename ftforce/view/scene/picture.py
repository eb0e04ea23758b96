"""The scene of an answer: poses, colours, arrows, lines, surfaces. Arrays only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.core.task import COMPONENTS
from ftforce.report import text
from ftforce.report.text import NEGLIGIBLE, size
from ftforce.robot.kinematics import joint_frames, quaternion, reach_bound, tip_pose
from ftforce.view.scene.arrows import (
    ARROW_KINDS,
    Arrow,
    Scales,
    TipAxes,
    arrows_of,
    forces_of,
    has_both,
    moments_of,
    norm,
    scales_for,
)
from ftforce.view.scene.colours import FIXED, LOST_LINE, WEAKEST_LINE, colour_of
from ftforce.view.scene.force_sets import polytopes_of, solids_of

if TYPE_CHECKING:
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot
    from ftforce.view.model.answer import Answer, JointLoad
    from ftforce.view.scene.colours import Colour
    from ftforce.view.scene.force_sets import Solid

_LINE = 0.3  # half length of a line, as a share of the size of the arm
DRAG_RESOLUTION = 0.005  # m: resolution of a dragged force


class Pose(NamedTuple):
    """A position in root axes, m, shape (3,), and a unit quaternion w, x, y, z, shape (4,)."""

    position: Vector
    wxyz: Vector


class Line(NamedTuple):
    """A line through the tip: its ends in root axes, m, shape (2, 3)."""

    ends: Matrix
    colour: Colour
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The contents of the scene.

    Attributes
    ----------
    joints :
        Pose of each joint of the Pinocchio model in root axes; the first is the root.
    colours :
        One per joint of the model.
    tip :
        Pose of the task axes at the tip, which also orients the force's drag handle.
    arrows :
        Requested, kept and lost force, then requested, kept and lost moment.
    lines :
        Lost directions and the weakest direction.
    solids :
        Sets of forces before and after the fault.
    scales :
        Arrow scales.
    notes :
        Notes for the legend: scales, and why something is not drawn.
    see_through :
        Whether the arm is transparent.
    can_drag :
        Whether there is a force that can be dragged.
    """

    joints: tuple[Pose, ...]
    colours: tuple[Colour, ...]
    tip: Pose
    arrows: tuple[Arrow, ...]
    lines: tuple[Line, ...]
    solids: tuple[Solid, ...]
    scales: Scales
    notes: tuple[str, ...]
    see_through: bool
    can_drag: bool


def picture(answer: Answer, like: Picture | None = None) -> Picture:
    """Return the scene that shows an answer.

    Parameters
    ----------
    answer :
        The answer.
    like :
        Picture whose arrow scales are kept, as needed during a drag; by default, scales are
        chosen so that all arrows fit.
    """
    analysis, task = answer.analysis, answer.analysis.task
    robot, shown = analysis.robot, answer.state.shown
    poses, (tip_rotation, place) = joint_poses(robot, analysis.posture.q)
    axes = TipAxes(place, tip_rotation if task.axes == "tool" else np.eye(3))
    polytopes, problem = polytopes_of(answer)
    vectors = _vectors(answer)
    extent = scene_size(robot)
    if like is None:
        known = (F for F in vectors.values() if F is not None)
        sizes = [*known, *(polytope.vertices for polytope in polytopes)]
        scales = scales_for(task, sizes, extent)
    else:
        scales = like.scales
    solids, notes = solids_of(answer, axes, polytopes, scales.of(task), extent)
    return Picture(
        joints=poses,
        colours=joint_colours(robot, answer.loads),
        tip=pose_of(axes.rotation, place),
        arrows=arrows_of(task, vectors, axes, scales),
        lines=_lines(answer, axes, extent),
        solids=solids,
        scales=scales,
        notes=(*(scales.notes() if vectors or polytopes else ()), *problem, *notes),
        see_through=shown.see_through,
        can_drag=analysis.force is not None,
    )


def joint_poses(robot: Robot, q: Vector) -> tuple[tuple[Pose, ...], tuple[Matrix, Vector]]:
    """Return the pose of every joint of the model, and the tip's rotation and position.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (n,).
    """
    poses = tuple(pose_of(R, place) for R, place in joint_frames(robot, q))
    return poses, tip_pose(robot, q)


def chain_joints(robot: Robot) -> tuple[int | None, ...]:
    """Return, for every joint of the model, the index of the chain joint that moves it.

    Mimic joints map to their leader; the root maps to ``None``.
    """
    G = np.abs(robot.coordinates.G)
    rows = (robot.model.joints[j].idx_v for j in range(1, robot.model.njoints))
    return (None, *(int(np.argmax(G[row])) for row in rows))


def joint_colours(robot: Robot, loads: tuple[JointLoad, ...]) -> tuple[Colour, ...]:
    """Return the colour of each joint of the model, by its fault or motor load.

    Parameters
    ----------
    robot :
        The arm.
    loads :
        Loads of the n joints of the chain.
    """
    return tuple(FIXED if i is None else _colour(loads[i]) for i in chain_joints(robot))


def _colour(load: JointLoad) -> Colour:
    return colour_of(None if load.fault is None else load.fault.mode, load.used)


def scene_size(robot: Robot) -> float:
    """Return the size of the arm, m: the summed link lengths, capped for long prismatic joints."""
    _, length = reach_bound(robot)
    return min(length, 4.0) if length > 0.0 else 1.0


def dragged_wrench(picture: Picture, answer: Answer, end: Vector) -> Vector:
    """Return the wrench that puts the tip of the requested force's arrow at a given point.

    Parameters
    ----------
    picture, answer :
        The current picture and answer.
    end :
        Desired end of the arrow in root axes, m, shape (3,).

    Returns
    -------
    :
        N and N·m for each of `ftforce.core.task.COMPONENTS`, shape (6,), rounded to the
        resolution of a drag.
    """
    task = answer.analysis.task
    scale = picture.scales.of(task)
    F = rotation(picture.tip.wxyz).T @ (end - picture.tip.position) / scale
    step = 10.0 ** math.floor(math.log10(DRAG_RESOLUTION / scale))
    wrench = answer.state.wrench.copy()
    if (requested := requested_of(answer)) is not None:  # if given by torques
        for name, value in zip(task.components, requested.tolist(), strict=True):
            wrench[COMPONENTS.index(name)] = value
    first = 0 if task.force_rows else 3
    # Components outside the task are unaffected by the drag.
    for row in (COMPONENTS.index(name) for name in task.components):
        if first <= row < first + 3:
            wrench[row] = round(round(float(F[row - first]) / step) * step, 6)
    return read_only(wrench)


def _vectors(answer: Answer) -> dict[str, Vector | None]:
    """Return requested, kept and lost force in task components, N and N·m, shape (m,) each.

    The last two are ``None`` if the arm cannot be held in static equilibrium; empty if no force is
    requested.
    """
    change = answer.analysis.force
    if change is None:
        return {}
    vectors = zip(ARROW_KINDS, (requested_of(answer), change.after, change.jump), strict=True)
    return dict(vectors)


def requested_of(answer: Answer) -> Vector | None:
    """Return the requested force in task components, N and N·m, shape (m,).

    If torques are given, this is the force they produce; ``None`` if all directions are analysed.
    """
    change = answer.analysis.force
    if change is None:
        return None
    return change.before if change.requested is None else change.requested


def pose_of(rotation: Matrix, place: Vector) -> Pose:
    """Return a rotation (3, 3) and a position, m, shape (3,), as a pose.

    Parameters
    ----------
    rotation :
        Rotation matrix, shape (3, 3).
    place :
        Position in root axes, m, shape (3,).
    """
    return Pose(place, _wxyz_of(rotation))


def _lines(answer: Answer, axes: TipAxes, extent: float) -> tuple[Line, ...]:
    """Return the lost directions as full lines, and the weakest one as a half line."""
    task, half = answer.analysis.task, _LINE * extent
    lines = []
    for row in answer.analysis.lost_directions:
        ends, whose = _line(task, task.unweigh_force(row), axes, half, -half)
        lines.append(Line(ends, LOST_LINE, f"lost direction{whose}"))
    if (weakest := answer.weakest) is not None and math.isfinite(weakest[1].maximum):
        ends, whose = _line(task, weakest[1].direction, axes, half, 0.0)
        amount = f"{size(weakest[1].maximum, 1)} {text.unit_of_size(task)}"
        lines.append(Line(ends, WEAKEST_LINE, f"weakest direction{whose}: {amount}"))
    return tuple(lines)


def _line(
    task: Task, direction: Vector, axes: TipAxes, ahead: float, behind: float
) -> tuple[Matrix, str]:
    """Return a line along a direction's force part, or its moment part if zero, and a note."""
    whole = task.direction_of(direction)
    force, moment = forces_of(task, whole), moments_of(task, whole)
    whose = ""
    if has_both(task):  # one line cannot show both parts
        is_mixed = norm(force) > NEGLIGIBLE and norm(moment) > NEGLIGIBLE
        whose = ", force part" if is_mixed else " of forces" if force.any() else " of moments"
    part = force if force.any() else moment
    unit = axes.rotation @ (part / norm(part))
    return read_only(np.array([axes.place + behind * unit, axes.place + ahead * unit])), whose


def rotation(wxyz: Vector) -> Matrix:
    """Return the rotation matrix (3, 3) of a unit quaternion w, x, y, z."""
    w, x, y, z = wxyz.tolist()
    R: Matrix = pin.Quaternion(w, x, y, z).toRotationMatrix()
    return R


def _wxyz_of(R: Matrix) -> Vector:
    """Return the unit quaternion w, x, y, z of a rotation matrix (3, 3)."""
    x, y, z, w = quaternion(R).tolist()
    return np.array([w, x, y, z])
