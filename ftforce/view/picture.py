"""What the scene shows of an answer: poses, colours, arrows, lines, surfaces. Arrays only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ftforce.arrays import Matrix, Vector, read_only
from ftforce.errors import InputError
from ftforce.faults import FaultMode
from ftforce.kinematics import joint_frames, quaternion, reach_bound, tip_pose
from ftforce.task import COMPONENTS
from ftforce.view.state import in_components
from ftforce.words import NEGLIGIBLE, size

if TYPE_CHECKING:
    from ftforce.polytope import Polytope
    from ftforce.robot import Robot
    from ftforce.task import Task
    from ftforce.view.answer import Answer, JointLoad

Colour: TypeAlias = tuple[int, int, int]
Faces: TypeAlias = NDArray[np.uint32]

# Okabe and Ito's colours: told apart with every kind of colour vision.
NEUTRAL: Colour = (190, 190, 184)
FIXED: Colour = (212, 212, 208)
FAULT_COLOURS: dict[FaultMode, Colour] = {
    FaultMode.LOCKED: (213, 94, 0),
    FaultMode.FREE: (204, 121, 167),
    FaultMode.WEAK: (230, 159, 0),
}
# From no load to the limit: one hue that darkens, so that grey eyes read it too.
RAMP: tuple[Colour, ...] = ((236, 240, 245), (158, 202, 225), (49, 130, 189), (8, 48, 107))
LOST_LINE: Colour = (120, 0, 60)
WEAKEST_LINE: Colour = (120, 90, 0)
BEFORE_SOLID: Colour = (86, 180, 233)
AFTER_SOLID: Colour = (0, 158, 115)

ARROW_KINDS = ("requested", "kept", "lost")
_LONGEST = 0.45  # an arrow's length, as a share of the size of the arm's scene
_NICE = (1.0, 2.0, 5.0, 10.0)
_LINE = 0.3  # of half a line, likewise
_CIRCLE = 24
_HAND = 0.005  # m: finer steps of a dragged force are not meant


class Pose(NamedTuple):
    """A place in the root's axes, m, shape (3,), and a unit quaternion w, x, y, z, shape (4,)."""

    position: Vector
    wxyz: Vector


class Arrow(NamedTuple):
    """A force (or moment) at the tip.

    Attributes
    ----------
    kind :
        One of `ARROW_KINDS`.
    start, end :
        In the root's axes, m, shape (3,); equal if there is none.
    label :
        What it is, with its size and unit.
    mark :
        What is written beside it; empty where another arrow lies on it and says it.
    """

    kind: str
    start: Vector
    end: Vector
    label: str
    mark: str

    @property
    def length(self) -> float:
        """Its length, m."""
        return float(np.linalg.norm(self.end - self.start))


class Line(NamedTuple):
    """A direction through the tip: its ends in the root's axes, m, shape (2, 3)."""

    ends: Matrix
    colour: Colour
    label: str


class Solid(NamedTuple):
    """A set of forces, drawn around the tip: vertices (k, 3) in the root's axes, m."""

    vertices: Matrix
    faces: Faces
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
        Requested, kept and lost.
    lines :
        Lost directions, and the weakest one.
    solids :
        Forces before and after the fault.
    scale :
        Length of an arrow per N (N·m of a task of moments), m.
    unit :
        Of the arrows, N or N·m.
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
    scale: float
    unit: str
    notes: tuple[str, ...]
    see_through: bool
    can_pull: bool


class _Frame(NamedTuple):
    """Where and how large forces are drawn."""

    place: Vector
    rotation: Matrix
    scale: float

    def point(self, F: Vector) -> Vector:
        """Return where forces, N (N·m), in the task's axes end, m, shape (..., 3)."""
        return read_only(self.place + self.scale * F @ self.rotation.T)


def picture(answer: Answer, scale: float | None = None) -> Picture:
    """Return what the scene shows of an answer.

    Parameters
    ----------
    answer :
        The answer.
    scale :
        Length of an arrow per N (N·m), m; one at which everything fits if not given. While the
        force is dragged it has to stay.
    """
    analysis, task = answer.analysis, answer.analysis.task
    robot, shown = analysis.robot, answer.state.shown
    poses, tip = joint_poses(robot, analysis.posture.q)
    rotation = tip[0] if task.axes == "tool" else np.eye(3)
    polytopes, problem = _polytopes(answer)
    forces = _forces(answer)
    extent = scene_size(robot)
    if scale is None:
        largest = max(_norm(F) for F in forces.values())
        reaches = (np.linalg.norm(p.vertices, axis=1).max(initial=0.0) for p in polytopes)
        scale = nice_scale(max(largest, *reaches) if polytopes else largest, extent)
    frame = _Frame(tip[1], rotation, scale)
    unit = task.size_unit
    solids, notes = _solids(answer, frame, polytopes, extent)
    return Picture(
        joints=poses,
        colours=joint_colours(robot, answer.loads),
        tip=Pose(tip[1], _wxyz(rotation)),
        arrows=_arrows(forces, frame, unit),
        lines=_lines(answer, frame, extent),
        solids=solids,
        scale=scale,
        unit=unit,
        notes=(f"arrows: 0.1 m is {size(0.1 / scale, 1)} {unit}", *problem, *notes),
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


def colour_of(mode: FaultMode | None, used: float) -> Colour:
    """Return a joint's colour.

    Parameters
    ----------
    mode :
        How it fails; ``None`` if it is healthy.
    used :
        Share of the limit that its motor gives, NaN if that is unknown.
    """
    if mode is not None:
        return FAULT_COLOURS[mode]
    if math.isnan(used):
        return NEUTRAL
    place = min(max(used, 0.0), 1.0) * (len(RAMP) - 1)
    i = min(int(place), len(RAMP) - 2)
    low, high = np.array(RAMP[i], dtype=float), np.array(RAMP[i + 1], dtype=float)
    red, green, blue = np.rint(low + (place - i) * (high - low)).astype(int).tolist()
    return red, green, blue


def scene_size(robot: Robot) -> float:
    """Return the size of the arm, m: the length of its links in a row, or a few of a slide."""
    _, length = reach_bound(robot)
    return min(length, 4.0) if length > 0.0 else 1.0


def nice_scale(largest: float, extent: float) -> float:
    """Return a length per N (N·m), m, at which the largest force fits, in steps of 1, 2, 5."""
    if largest <= NEGLIGIBLE:
        largest = 1.0
    exact = largest / (_LONGEST * extent)  # N per m: the next larger nice number fits
    power = 10.0 ** math.floor(math.log10(exact))
    return 1.0 / next(step * power for step in _NICE if step * power >= exact * (1.0 - 1e-9))


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
        N and N·m for each of `ftforce.task.COMPONENTS`, shape (6,), rounded to what a hand can
        aim at.
    """
    task, scale = answer.analysis.task, picture.scale
    w, x, y, z = picture.tip.wxyz.tolist()
    F = pin.Quaternion(w, x, y, z).toRotationMatrix().T @ (end - picture.tip.position) / scale
    step = 10.0 ** math.floor(math.log10(_HAND / scale))
    wrench = answer.state.wrench.copy()
    first = 0 if task.force_rows else 3
    # What the task lacks is no part of the request, wherever the hand goes.
    for row in (COMPONENTS.index(name) for name in task.components):
        if first <= row < first + 3:
            wrench[row] = round(round(float(F[row - first]) / step) * step, 6)
    return read_only(wrench)


def _forces(answer: Answer) -> dict[str, Vector]:
    """Return requested, kept and lost force (or moment) in the task's axes, (3,) each."""
    change, task = answer.analysis.force, answer.analysis.task
    none = np.zeros(3)
    if change is None:
        return dict.fromkeys(ARROW_KINDS, none)
    requested = change.before if change.requested is None else change.requested
    # An arm that cannot stand still keeps nothing, and what it loses is no arrow.
    vectors = zip(ARROW_KINDS, (requested, change.after, change.jump), strict=True)
    return {kind: none if F is None else spatial(task, F) for kind, F in vectors}


def spatial(task: Task, F: Vector) -> Vector:
    """Return the forces of a vector of task components, or its moments if it has none, (..., 3)."""
    rows = slice(0, 3) if task.force_rows else slice(3, 6)
    if F.ndim == 1:
        return in_components(task.components, F)[rows]
    whole = [in_components(task.components, row)[rows] for row in F]
    return np.array(whole).reshape(len(F), 3)


def _arrows(forces: dict[str, Vector], frame: _Frame, unit: str) -> tuple[Arrow, ...]:
    arrows = []
    everything_kept = _norm(forces["requested"] - forces["kept"]) <= NEGLIGIBLE
    for kind, F in forces.items():
        amount = _norm(F)
        is_there = amount > NEGLIGIBLE
        amount_text = f"{size(amount, 1)} {unit}"
        mark = f"{kind} {amount_text}" if is_there else ""
        if everything_kept:  # one arrow lies on the other
            mark = f"all kept {amount_text}" if kind == "kept" and is_there else ""
        end = frame.point(F) if is_there else frame.place
        arrows.append(Arrow(kind, frame.place, end, f"{kind} {amount_text}", mark))
    return tuple(arrows)


def force_arrows(
    forces: dict[str, Vector], tip: tuple[Matrix, Vector], scale: float, unit: str
) -> tuple[Arrow, ...]:
    """Return arrows of forces that are known.

    Parameters
    ----------
    forces :
        One for each of `ARROW_KINDS`, N (N·m), in the task's axes, shape (3,).
    tip :
        Turn of the task's axes, shape (3, 3), and place of the tip, m, shape (3,).
    scale :
        Length per N (N·m), m.
    unit :
        N or N·m.
    """
    return _arrows(forces, _Frame(tip[1], tip[0], scale), unit)


def pose_of(rotation: Matrix, place: Vector) -> Pose:
    """Return a turn (3, 3) and a place, m, shape (3,), as a pose."""
    return Pose(place, _wxyz(rotation))


def _lines(answer: Answer, frame: _Frame, extent: float) -> tuple[Line, ...]:
    """Return lost directions both ways, and the weakest one."""
    task, half = answer.analysis.task, _LINE * extent
    lines = []
    for row in answer.analysis.lost_directions:
        line = _line(spatial(task, task.unweigh_force(row)), frame, half, -half)
        if line is not None:
            lines.append(Line(line, LOST_LINE, "lost direction"))
    if (weakest := answer.weakest) is not None:
        line = _line(spatial(task, weakest[1].direction), frame, half, 0.0)
        if line is not None:
            amount = _most(weakest[1].most, task.size_unit)
            lines.append(Line(line, WEAKEST_LINE, f"weakest direction: {amount}"))
    return tuple(lines)


def _most(most: float, unit: str) -> str:
    if math.isnan(most):
        return "the arm does not stand still"
    return "no limit" if math.isinf(most) else f"{size(most, 1)} {unit}"


def _line(direction: Vector, frame: _Frame, ahead: float, behind: float) -> Matrix | None:
    length = _norm(direction)
    if length <= NEGLIGIBLE:  # a direction of moments alone, among forces
        return None
    unit = frame.rotation @ (direction / length)
    return read_only(np.array([frame.place + behind * unit, frame.place + ahead * unit]))


# ---- sets of forces --------------------------------------------------------------------------


def _is_drawable(task: Task) -> bool:
    """Whether the task has only forces, or only moments: a set of both is no solid."""
    return not (task.force_rows and task.moment_rows)


def _polytopes(answer: Answer) -> tuple[tuple[Polytope, ...], tuple[str, ...]]:
    """Return the polytopes before and after, if they are shown, or why they are not."""
    found, task = answer.capability, answer.analysis.task
    if found is None or answer.state.shown.solid != "polytope":
        return (), ()
    if not _is_drawable(task):
        return (), ("a polytope is drawn for forces alone or moments alone",)
    try:
        both = found.polytope(after=False), found.polytope(after=True)
    except InputError as problem:  # too many joints
        return (), (str(problem),)
    if not all(one.is_bounded for one in both):
        return (), ("no known limit ends the forces: no polytope",)
    return both, ()


def _solids(
    answer: Answer, frame: _Frame, polytopes: tuple[Polytope, ...], extent: float
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    looks = zip((BEFORE_SOLID, AFTER_SOLID), ("before", "after"), strict=True)
    if polytopes:
        solids = [_polytope(one, answer.analysis.task, frame, colour, f"forces {when} the fault")
                  for one, (colour, when) in zip(polytopes, looks, strict=True)]  # fmt: skip
        empty = [f"no force holds the arm {when}" for one, when
                 in zip(polytopes, ("before the fault", "after the fault"), strict=True)
                 if one.is_empty]  # fmt: skip
        return tuple(solid for solid in solids if len(solid.faces)), tuple(empty)
    if answer.state.shown.solid != "ellipsoid":
        return (), ()
    if not _is_drawable(answer.analysis.task):
        return (), ("an ellipsoid is drawn for forces alone or moments alone",)
    return _ellipsoids(answer, frame, extent)


def _polytope(polytope: Polytope, task: Task, frame: _Frame, colour: Colour, label: str) -> Solid:
    corners = frame.point(spatial(task, polytope.vertices))
    return Solid(corners, triangles(polytope.faces), colour, label)


def triangles(faces: tuple[tuple[int, ...], ...]) -> Faces:
    """Return convex polygons as triangles, shape (k, 3); a segment has none."""
    fans = [(face[0], *edge) for face in faces for edge in pairwise(face[1:])]
    return np.array(fans, dtype=np.uint32).reshape(-1, 3)


def _ellipsoids(
    answer: Answer, frame: _Frame, extent: float
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    """Return {F : ‖JᵀF‖ ≤ 1 N·m} before and after the fault, the latter in range(K)."""
    reduced, task = answer.analysis.reduced, answer.analysis.task
    weighted = task.weighted_unit
    before = _axes_of(reduced.healthy.U, reduced.healthy.s, reduced.rank) * weighted
    after = _axes_of(reduced.damaged.U, reduced.damaged.s, reduced.rank_after) * weighted
    longest = max((_norm(axis) for axis in (*before, *after)), default=0.0)
    if longest == 0.0:
        return (), ("no force can be commanded: no ellipsoid",)
    own = frame._replace(scale=_LONGEST * extent / longest)
    solids = []
    for axes, colour, when in ((before, BEFORE_SOLID, "before"), (after, AFTER_SOLID, "after")):
        if len(axes) > 1:  # one direction alone is no surface
            vertices, faces = ellipsoid(spatial(task, axes))
            solids.append(Solid(own.point(vertices), faces, colour, f"ellipsoid {when} the fault"))
    per = f"{size(longest, 1)} {task.size_unit} for joint torques of norm 1"
    return tuple(solids), (f"ellipsoids, in a scale of their own: longest axis {per}",)


def _axes_of(U: Matrix, s: list[float], rank: int) -> Matrix:
    """Return the semi-axes 1/σ_i u_i of the directions that are kept, rows, shape (rank, m)."""
    axes: Matrix = U[:, :rank].T / np.array(s[:rank])[:, None]
    return axes


def ellipsoid(axes: Matrix) -> tuple[Matrix, Faces]:
    """Return the surface of an ellipsoid around 0, or a disk if it has two axes.

    Parameters
    ----------
    axes :
        Its two or three semi-axes, rows, shape (2 or 3, 3).
    """
    turn = np.linspace(0.0, 2.0 * math.pi, _CIRCLE, endpoint=False)
    i = np.arange(_CIRCLE)
    j = (i + 1) % _CIRCLE
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    if len(axes) == 2:
        centre = np.full(_CIRCLE, _CIRCLE)
        disk = np.vstack([ring, np.zeros((1, 2))]) @ axes
        return disk, np.column_stack([i, j, centre]).astype(np.uint32)
    rise = np.linspace(0.0, math.pi, _CIRCLE // 2 + 1)
    sphere = np.vstack([np.column_stack([math.sin(a) * ring, np.full(_CIRCLE, math.cos(a))])
                        for a in rise])  # fmt: skip
    quads = [np.vstack([np.column_stack([a + i, a + _CIRCLE + i, a + j]),
                        np.column_stack([a + j, a + _CIRCLE + i, a + _CIRCLE + j])])
             for a in range(0, _CIRCLE * (len(rise) - 1), _CIRCLE)]  # fmt: skip
    return sphere @ axes[:3], np.vstack(quads).astype(np.uint32)


def _wxyz(R: Matrix) -> Vector:
    x, y, z, w = quaternion(R).tolist()
    return np.array([w, x, y, z])


def _norm(x: Vector) -> float:
    return math.hypot(*x.tolist())
