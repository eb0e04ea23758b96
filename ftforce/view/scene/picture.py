"""What the scene shows of an answer: poses, colours, arrows, lines, surfaces. Arrays only."""

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

_LINE = 0.3  # of half a line, as a share of the size of the arm's scene
HAND = 0.005  # m: finer steps of a dragged force are not meant


class Pose(NamedTuple):
    """A place in the root's axes, m, shape (3,), and a unit quaternion w, x, y, z, shape (4,)."""

    position: Vector
    wxyz: Vector


class Line(NamedTuple):
    """A direction through the tip: its ends in the root's axes, m, shape (2, 3)."""

    ends: Matrix
    colour: Colour
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What the scene shows.

    Attributes
    ----------
    joints :
        Pose of each joint of the Pinocchio model in the root's axes; the first is the root.
    colours :
        One per joint of the model.
    tip :
        Of the task's axes, at the tip: what the handle of the force turns with.
    arrows :
        Requested, kept and lost: of the force, and then of the moment.
    lines :
        Lost directions, and the weakest one.
    solids :
        Forces before and after the fault.
    scales :
        Of the arrows.
    notes :
        What the legend adds: scales, and why something is not drawn.
    see_through :
        Whether the arm is.
    can_pull :
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
    can_pull: bool


def picture(answer: Answer, like: Picture | None = None) -> Picture:
    """Return what the scene shows of an answer.

    Parameters
    ----------
    answer :
        The answer.
    like :
        Whose scales its arrows have: while the force is dragged they have to stay. If not given,
        everything fits.
    """
    analysis, task = answer.analysis, answer.analysis.task
    robot, shown = analysis.robot, answer.state.shown
    poses, (turn, place) = joint_poses(robot, analysis.posture.q)
    axes = TipAxes(place, turn if task.axes == "tool" else np.eye(3))
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
        can_pull=analysis.force is not None,
    )


def joint_poses(robot: Robot, q: Vector) -> tuple[tuple[Pose, ...], tuple[Matrix, Vector]]:
    """Return the pose of every joint of the model, and orientation and place of the tip.

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
    """Return for every joint of the model the index of the chain's joint that moves it.

    Followers move with their leader; nothing moves the root.
    """
    G = np.abs(robot.coordinates.G)
    rows = (robot.model.joints[j].idx_v for j in range(1, robot.model.njoints))
    return (None, *(int(np.argmax(G[row])) for row in rows))


def joint_colours(robot: Robot, loads: tuple[JointLoad, ...]) -> tuple[Colour, ...]:
    """Return the colour of each joint of the model: its fault, or the load of its motor."""
    return tuple(FIXED if i is None else _colour(loads[i]) for i in chain_joints(robot))


def _colour(load: JointLoad) -> Colour:
    return colour_of(None if load.fault is None else load.fault.mode, load.used)


def scene_size(robot: Robot) -> float:
    """Return the size of the arm, m: the length of its links in a row, or a few of a slide."""
    _, length = reach_bound(robot)
    return min(length, 4.0) if length > 0.0 else 1.0


def pulled(picture: Picture, answer: Answer, end: Vector) -> Vector:
    """Return the wrench that is meant when the end of the requested force is put somewhere.

    Parameters
    ----------
    picture, answer :
        What is shown.
    end :
        Where the force should end, in the root's axes, m, shape (3,).

    Returns
    -------
    :
        N and N·m for each of `ftforce.core.task.COMPONENTS`, shape (6,), rounded to what a hand can
        aim at.
    """
    task = answer.analysis.task
    scale = picture.scales.of(task)
    F = rotation(picture.tip.wxyz).T @ (end - picture.tip.position) / scale
    step = 10.0 ** math.floor(math.log10(HAND / scale))
    wrench = answer.state.wrench.copy()
    if (requested := requested_of(answer)) is not None:  # of torques, other than the wrench
        for name, value in zip(task.components, requested.tolist(), strict=True):
            wrench[COMPONENTS.index(name)] = value
    first = 0 if task.force_rows else 3
    # What the task lacks is no part of the request, wherever the hand goes.
    for row in (COMPONENTS.index(name) for name in task.components):
        if first <= row < first + 3:
            wrench[row] = round(round(float(F[row - first]) / step) * step, 6)
    return read_only(wrench)


def _vectors(answer: Answer) -> dict[str, Vector | None]:
    """Return requested, kept and lost force in the task's components, N and N·m, (m,) each.

    Of an arm that cannot stand still the last two are ``None``; if no force is asked for, there
    is none of them.
    """
    change = answer.analysis.force
    if change is None:
        return {}
    vectors = zip(ARROW_KINDS, (requested_of(answer), change.after, change.jump), strict=True)
    return dict(vectors)


def requested_of(answer: Answer) -> Vector | None:
    """Return the force that is asked for, in the task's components, N and N·m, shape (m,).

    It is what the torques mean if those are given, and ``None`` if every direction is asked about.
    """
    change = answer.analysis.force
    if change is None:
        return None
    return change.before if change.requested is None else change.requested


def pose_of(rotation: Matrix, place: Vector) -> Pose:
    """Return a turn (3, 3) and a place, m, shape (3,), as a pose."""
    return Pose(place, wxyz_of(rotation))


def _lines(answer: Answer, axes: TipAxes, extent: float) -> tuple[Line, ...]:
    """Return lost directions both ways, and the weakest one."""
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
    """Return a line along a direction's forces, or if it has none its moments, and which it is."""
    whole = task.direction_of(direction)
    force, moment = forces_of(task, whole), moments_of(task, whole)
    whose = ""
    if has_both(task):  # which no one line can show
        is_mixed = norm(force) > NEGLIGIBLE and norm(moment) > NEGLIGIBLE
        whose = ", its force" if is_mixed else " of forces" if force.any() else " of moments"
    part = force if force.any() else moment
    unit = axes.rotation @ (part / norm(part))
    return read_only(np.array([axes.place + behind * unit, axes.place + ahead * unit])), whose


def rotation(wxyz: Vector) -> Matrix:
    """Return the rotation (3, 3) of a unit quaternion w, x, y, z."""
    w, x, y, z = wxyz.tolist()
    R: Matrix = pin.Quaternion(w, x, y, z).toRotationMatrix()
    return R


def wxyz_of(R: Matrix) -> Vector:
    """Return a rotation (3, 3) as a unit quaternion w, x, y, z."""
    x, y, z, w = quaternion(R).tolist()
    return np.array([w, x, y, z])
