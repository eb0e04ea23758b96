"""What an arm looks like: one mesh for each joint of its model, which moves with that joint.

ftforce's model keeps every link of the URDF as a frame, those outside the chain where they are
held. So the shapes of a URDF are put into the axes of the joint that carries their link, and the
arm at a posture is these meshes at the poses of the model's joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import read_only
from ftforce.errors import FileError, FtforceError, printable
from ftforce.robot.kinematics import reach_bound
from ftforce.view.geometry import shapes
from ftforce.view.geometry.mesh_files import read_mesh
from ftforce.view.geometry.visuals import LARGEST_LENGTH, Visuals, read_visuals

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from trimesh import Trimesh

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.view.geometry.visuals import Visual

MOST_SHOWN = 70_000  # triangles; more of them take a browser without a GPU too long
LARGEST_TOTAL = 200_000_000  # bytes of all mesh files of a robot; the known ones have up to 21 MB
_BONE = 0.03  # radius of a link without a mesh, as a share of the arm's reach
_UNSCALED = (1.0, 1.0, 1.0)
_COARSER = 1.4
_FINEST = 1.0 / 4000.0  # a grid's cell, as a share of the largest mesh


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """What moves with one joint.

    Attributes
    ----------
    joint :
        Index of the joint in the Pinocchio model; 0 is the root, which does not move.
    vertices :
        In the joint's axes, m, shape (k, 3).
    faces :
        Indices into ``vertices``, shape (f, 3).
    flat :
        Whether each triangle is shaded by itself. Meshes of files share vertices across sharp
        edges: smoothly shaded they look dented, and black in places where they are coarse.
    """

    joint: int
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    flat: bool


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """What an arm looks like, and in words what could not be shown.

    Attributes
    ----------
    parts :
        At most one per joint of the model, in its order.
    notes :
        Meshes that are missing, visuals that cannot be read.
    """

    parts: tuple[Part, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """One shape, not yet scaled, and how it gets to its joint's axes."""

    joint: int
    mesh: Trimesh
    scale: tuple[float, ...]
    placement: Matrix
    is_of_file: bool


def load_geometry(robot: Robot) -> Geometry:
    """Load what an arm looks like; it never fails, what is missing is replaced.

    Parameters
    ----------
    robot :
        The arm. Its URDF is read again; a link whose mesh cannot be had becomes a rod from its
        joint to the next, and so does every link of an arm without any look.
    """
    try:
        visuals = read_visuals(robot.path)
    except FtforceError as problem:
        visuals = Visuals((), (f"the arm's look cannot be read: {problem}",))
    pieces, bare, notes = _pieces(robot, visuals.shapes)
    notes = [*visuals.notes, *notes]
    if not pieces and not bare:
        bare = set(range(robot.model.njoints))
        notes.append("the URDF does not say what the arm looks like: links are shown as rods")
    from_files = {piece.joint for piece in pieces if piece.is_of_file}
    meshes = [(piece.joint, _placed(piece)) for piece in _few(pieces)]
    meshes += [(joint, mesh) for joint in sorted(bare) for mesh in _bones(robot, joint)]
    parts = (
        _part(joint, [mesh for owner, mesh in meshes if owner == joint], joint in from_files)
        for joint in range(robot.model.njoints)
    )
    return Geometry(tuple(part for part in parts if len(part.faces)), tuple(notes))


def _part(joint: int, meshes: Sequence[Trimesh], is_flat: bool) -> Part:
    from trimesh.util import concatenate

    mesh = concatenate(meshes)
    vertices, faces = np.array(mesh.vertices, np.float32), np.array(mesh.faces, np.uint32)
    return Part(joint, read_only(vertices), read_only(faces), is_flat)


def _pieces(robot: Robot, visuals: Sequence[Visual]) -> tuple[list[_Piece], set[int], list[str]]:
    """Return the shapes, the joints of which some mesh is missing, and notes that say which."""
    frames = {frame.name: frame for frame in robot.model.frames if frame.type == pin.FrameType.BODY}
    files = _Files()
    pieces: list[_Piece] = []
    bare: set[int] = set()
    for visual in visuals:
        frame = frames.get(visual.link)
        if frame is None:
            continue
        mesh = files.mesh(visual) if visual.shape == "mesh" else _simple(visual)
        if mesh is None:
            bare.add(frame.parentJoint)
            continue
        placement = frame.placement.homogeneous @ visual.placement
        is_of_file = visual.shape == "mesh"
        scale = visual.size if is_of_file else _UNSCALED
        pieces.append(_Piece(frame.parentJoint, mesh, scale, placement, is_of_file))
    return pieces, bare, files.notes()


class _Files:
    """Mesh files, each of which is read once."""

    def __init__(self) -> None:
        self._meshes: dict[Path, Trimesh | None] = {}
        self._problems: dict[str, str] = {}
        self._bytes = 0

    def mesh(self, visual: Visual) -> Trimesh | None:
        """Return the mesh of a visual; ``None`` if it cannot be had."""
        path = visual.path
        if path is None:
            self._problems[visual.named] = f"mesh {printable(visual.named)!r} is missing"
            return None
        if path not in self._meshes:
            self._meshes[path] = self._read(path)
        mesh = self._meshes[path]
        if mesh is not None and not _is_of_an_arm(mesh, visual):
            self._problems[str(path)] = f"mesh {printable(path)}: too large for an arm"
            return None
        return mesh

    def _read(self, path: Path) -> Trimesh | None:
        try:
            self._bytes += path.stat().st_size
            if self._bytes > LARGEST_TOTAL:
                raise FileError(
                    path, f"is left out: all meshes have over {LARGEST_TOTAL // 1_000_000} MB"
                )
            return read_mesh(path)
        except (FtforceError, OSError) as problem:
            self._problems[str(path)] = f"mesh {problem}"
            return None

    def notes(self) -> list[str]:
        """Return what was wrong, in words."""
        return list(self._problems.values())


def _is_of_an_arm(mesh: Trimesh, visual: Visual) -> bool:
    reach = np.abs(mesh.vertices).max(axis=0) * np.abs(visual.size)
    return bool(reach.max() <= LARGEST_LENGTH)


def _simple(visual: Visual) -> Trimesh:
    if visual.shape == "box":
        return shapes.box(*visual.size)
    if visual.shape == "cylinder":
        return shapes.cylinder(*visual.size)
    return shapes.sphere(*visual.size)


def _placed(piece: _Piece) -> Trimesh:
    return piece.mesh.copy().apply_transform(piece.placement @ np.diag([*piece.scale, 1.0]))


# ---- fewer triangles -------------------------------------------------------------------------


def _few(pieces: Sequence[_Piece]) -> Sequence[_Piece]:
    """Return the shapes with no more triangles than can be shown."""
    if sum(len(piece.mesh.faces) for piece in pieces) <= MOST_SHOWN:
        return pieces
    largest = max(_size(piece) for piece in pieces)
    cell = _FINEST * largest
    while True:
        coarse = _coarser(pieces, cell)
        count = sum(len(piece.mesh.faces) for piece in coarse)
        if count <= MOST_SHOWN or cell > largest:
            return coarse
        # Triangles become fewer by the square of the cell at most: no step goes too far.
        cell *= max(_COARSER, (count / MOST_SHOWN) ** 0.5)


def _size(piece: _Piece) -> float:
    spans = np.ptp(piece.mesh.vertices, axis=0) * np.abs(piece.scale)
    return float(spans.max(initial=0.0))


def _coarser(pieces: Sequence[_Piece], cell: float) -> list[_Piece]:
    """Return the shapes on a grid, m; a mesh that several of them share is worked on once."""
    done: dict[tuple[int, tuple[float, ...]], Trimesh] = {}
    for piece in pieces:
        key = (id(piece.mesh), piece.scale)
        if key not in done:
            with np.errstate(divide="ignore"):  # a scale of 0 makes all of an axis one cell
                done[key] = shapes.coarser(piece.mesh, cell / np.abs(piece.scale))
    return [replace(piece, mesh=done[id(piece.mesh), piece.scale]) for piece in pieces]


# ---- links without a mesh --------------------------------------------------------------------


def _bones(robot: Robot, joint: int) -> Iterator[Trimesh]:
    """Yield a joint and rods to the next joints, or to the tip, in the joint's axes."""
    radius = _BONE * min(reach_bound(robot)[1], 4.0) or _BONE
    start = np.zeros(3)
    ends = _ends(robot, joint)
    for end in ends:
        if np.linalg.norm(end) > 1e-6:
            yield shapes.between(start, end, 0.6 * radius)
    if joint == 0:
        yield shapes.cylinder(1.5 * radius, radius)
        return
    drum = shapes.cylinder(radius, 2.2 * radius)
    yield shapes.along(drum, _axis(robot, joint))


def _ends(robot: Robot, joint: int) -> list[Vector]:
    model = robot.model
    above = model.parents.tolist()
    ends = [
        model.jointPlacements[other].translation.copy()
        for other in range(1, model.njoints)
        if above[other] == joint
    ]
    tip = model.frames[robot.tip_frame]
    if tip.parentJoint == joint:
        ends.append(tip.placement.translation.copy())
    return ends


def _axis(robot: Robot, joint: int) -> Vector:
    """Return the direction a joint turns about or slides along, in its own axes, shape (3,)."""
    model = robot.model.joints[joint]
    data = model.createData()
    q = pin.neutral(robot.model)
    model.calc(data, q)
    S: Vector = np.asarray(data.S).reshape(-1)
    return S[3:] if np.any(S[3:]) else S[:3]
