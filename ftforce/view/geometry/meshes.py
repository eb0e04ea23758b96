"""Visual geometry of an arm: one mesh per joint of its model, moving with that joint.

The model keeps every URDF link as a frame, including links outside the chain, which are held
fixed. The visuals of each link are therefore expressed in the axes of the joint that carries it,
and the arm is drawn by placing these meshes at the poses of the model's joints.
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
from ftforce.view.geometry.visuals import MAX_LENGTH, Visuals, read_visuals

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from trimesh import Trimesh

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.view.geometry.visuals import Visual

MAX_SHOWN = 70_000  # triangles; more are too slow in a browser without a GPU
MAX_TOTAL = 200_000_000  # bytes of all mesh files of a robot; the known robots have up to 21 MB
_ROD = 0.03  # radius of a link without a mesh, as a share of the arm's reach
_NOT_DRAWN = "a mesh without a file of its own, or turned and stretched, is shown as a rod"
_UNSCALED = (1.0, 1.0, 1.0)
_GROWTH = 1.4  # least factor between grid cells
_MAX_SCALES = 8  # of a mesh, for each of which it is decimated by itself
_FIRST_CELL = 1.0 / 4000.0  # initial grid cell, as a share of the largest mesh


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The geometry that moves with one joint.

    Attributes
    ----------
    joint :
        Index of the joint in the Pinocchio model; 0 is the fixed root.
    vertices :
        In joint axes, m, shape (k, 3).
    faces :
        Indices into ``vertices``, shape (f, 3).
    flat :
        Whether to use flat shading. Meshes from files share vertices across sharp edges: with
        smooth shading they look dented, and black where they are coarse.
    """

    joint: int
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    flat: bool


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """The visual geometry of an arm.

    Attributes
    ----------
    parts :
        At most one per joint of the model, in the model's order.
    notes :
        Missing meshes and unreadable visuals, in words.
    """

    parts: tuple[Part, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """An unscaled shape with its scale and its placement in joint axes."""

    joint: int
    mesh: Trimesh
    scale: tuple[float, ...]
    placement: Matrix
    is_from_file: bool


def load_geometry(robot: Robot) -> Geometry:
    """Load the visual geometry of an arm; never fails, missing parts are replaced.

    Parameters
    ----------
    robot :
        The arm. Its URDF is read again. Links whose mesh is not available are drawn as rods from
        their joint to the next, as are all links of an arm without visuals.
    """
    try:
        visuals = read_visuals(robot.path, robot.description())
    except FtforceError as problem:
        visuals = Visuals((), (f"the visual geometry cannot be read: {problem}",))
    pieces, without_mesh, notes = _pieces(robot, visuals.shapes)
    notes = [*visuals.notes, *notes]
    if not pieces and not without_mesh:
        without_mesh = set(range(robot.model.njoints))
        notes.append("the robot has no visual geometry: links are shown as rods")
    from_files = {piece.joint for piece in pieces if piece.is_from_file}
    meshes = [(piece.joint, _placed(piece)) for piece in _decimated(pieces)]
    meshes += [(joint, mesh) for joint in sorted(without_mesh) for mesh in _rods(robot, joint)]
    by_joint: dict[int, list[Trimesh]] = {joint: [] for joint in range(robot.model.njoints)}
    for joint, mesh in meshes:
        by_joint[joint].append(mesh)
    parts = (_part(joint, own, joint in from_files) for joint, own in by_joint.items())
    return Geometry(tuple(part for part in parts if len(part.faces)), tuple(notes))


def _part(joint: int, meshes: Sequence[Trimesh], is_flat: bool) -> Part:
    from trimesh.util import concatenate

    mesh = concatenate(meshes)
    vertices, faces = np.array(mesh.vertices, np.float32), np.array(mesh.faces, np.uint32)
    return Part(joint, read_only(vertices), read_only(faces), is_flat)


def _pieces(robot: Robot, visuals: Sequence[Visual]) -> tuple[list[_Piece], set[int], list[str]]:
    """Return the shapes, the joints with missing meshes, and notes on these meshes."""
    frames = {frame.name: frame for frame in robot.model.frames if frame.type == pin.FrameType.BODY}
    files = _MeshFiles()
    pieces: list[_Piece] = []
    without_mesh: set[int] = set()
    for visual in visuals:
        frame = frames.get(visual.link)
        if frame is None:
            continue
        mesh = files.mesh(visual) if visual.shape == "mesh" else _simple(visual)
        if mesh is None:
            without_mesh.add(frame.parentJoint)
            continue
        placement = frame.placement.homogeneous @ visual.placement
        is_from_file = visual.shape == "mesh"
        scale = visual.size if is_from_file else _UNSCALED
        pieces.append(_Piece(frame.parentJoint, mesh, scale, placement, is_from_file))
    return pieces, without_mesh, files.notes()


class _MeshFiles:
    """Mesh files, each read only once."""

    def __init__(self) -> None:
        self._meshes: dict[Path, Trimesh | None] = {}
        self._reaches: dict[Path, Vector] = {}  # largest coordinates
        self._problems: dict[str, str] = {}
        self._bytes = 0

    def mesh(self, visual: Visual) -> Trimesh | None:
        """Return the mesh of a visual; ``None`` if it is not available."""
        path = visual.path
        if path is None:
            problem = f"mesh {printable(visual.named)!r} was not found"
            if not visual.named:
                problem = f"link {printable(visual.link)!r}: {_NOT_DRAWN}"
            self._problems[visual.named or visual.link] = problem
            return None
        if path not in self._meshes:
            self._meshes[path] = self._read(path)
        mesh = self._meshes[path]
        if mesh is not None and not self._is_plausible(path, mesh, visual):
            self._problems[str(path)] = f"mesh {printable(path)}: too large for an arm"
            return None
        return mesh

    def _is_plausible(self, path: Path, mesh: Trimesh, visual: Visual) -> bool:
        if path not in self._reaches:
            self._reaches[path] = np.abs(mesh.vertices).max(axis=0)
        return bool((self._reaches[path] * np.abs(visual.size)).max() <= MAX_LENGTH)

    def _read(self, path: Path) -> Trimesh | None:
        try:
            self._bytes += path.stat().st_size
            if self._bytes > MAX_TOTAL:
                raise FileError(
                    path, f"is skipped: the meshes exceed {MAX_TOTAL // 1_000_000} MB in total"
                )
            return read_mesh(path)
        except (FtforceError, OSError) as problem:
            self._problems[str(path)] = f"mesh {problem}"
            return None

    def notes(self) -> list[str]:
        """Return the problems found, in words."""
        return list(self._problems.values())


def _simple(visual: Visual) -> Trimesh:
    if visual.shape == "box":
        return shapes.box(*visual.size)
    if visual.shape == "cylinder":
        return shapes.cylinder(*visual.size)
    if visual.shape == "ellipsoid":
        return shapes.sphere(1.0).apply_scale(visual.size)
    return shapes.sphere(*visual.size)


def _placed(piece: _Piece) -> Trimesh:
    return piece.mesh.copy().apply_transform(piece.placement @ np.diag([*piece.scale, 1.0]))


# ---- decimation ------------------------------------------------------------------------------


def _decimated(pieces: Sequence[_Piece]) -> Sequence[_Piece]:
    """Return the shapes, decimated to the maximum number of triangles."""
    if sum(len(piece.mesh.faces) for piece in pieces) <= MAX_SHOWN:
        return pieces
    largest = _largest(pieces)
    cell = _FIRST_CELL * largest
    while True:
        coarse = _clustered(pieces, cell)
        count = sum(len(piece.mesh.faces) for piece in coarse)
        if count <= MAX_SHOWN or cell > largest:
            return coarse
        # The triangle count falls at most with the square of the cell size: no step overshoots.
        cell *= max(_GROWTH, (count / MAX_SHOWN) ** 0.5)


def _largest(pieces: Sequence[_Piece]) -> float:
    """Return the length of the largest shape, m."""
    meshes = {id(piece.mesh): piece.mesh for piece in pieces}
    sizes = {key: np.ptp(mesh.vertices, axis=0) for key, mesh in meshes.items()}
    return max(
        float((sizes[id(piece.mesh)] * np.abs(piece.scale)).max(initial=0.0)) for piece in pieces
    )


def _clustered(pieces: Sequence[_Piece], cell: float) -> list[_Piece]:
    """Cluster the shapes' vertices on a grid, cell in m; shared meshes are processed once.

    A mesh with many scales is processed at the largest one only, at which its cells are finest.
    """
    scales: dict[int, set[tuple[float, ...]]] = {}
    for piece in pieces:
        scales.setdefault(id(piece.mesh), set()).add(piece.scale)
    many = {
        key: tuple(np.abs(list(own)).max(axis=0).tolist())
        for key, own in scales.items()
        if len(own) > _MAX_SCALES
    }
    done: dict[tuple[int, tuple[float, ...]], Trimesh] = {}
    coarse = []
    for piece in pieces:
        scale = many.get(id(piece.mesh), piece.scale)
        key = (id(piece.mesh), scale)
        if key not in done:
            with np.errstate(divide="ignore"):  # zero scale: the axis collapses into one cell
                done[key] = shapes.decimated(piece.mesh, cell / np.abs(scale))
        coarse.append(replace(piece, mesh=done[key]))
    return coarse


# ---- links without a mesh --------------------------------------------------------------------


def _rods(robot: Robot, joint: int) -> Iterator[Trimesh]:
    """Yield a drum at the joint and rods to the next joints or the tip, in joint axes."""
    radius = _ROD * min(reach_bound(robot)[1], 4.0) or _ROD
    start = np.zeros(3)
    ends = _ends(robot, joint)
    for end in ends:
        if np.linalg.norm(end) > 1e-6:
            yield shapes.between(start, end, 0.6 * radius)
    if joint == 0:
        yield shapes.cylinder(1.5 * radius, radius)
        return
    drum = shapes.cylinder(radius, 2.2 * radius)
    yield shapes.aligned(drum, _axis(robot, joint))


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
    """Return the joint axis (of rotation or translation) in joint axes, shape (3,)."""
    model = robot.model.joints[joint]
    data = model.createData()
    q = pin.neutral(robot.model)
    model.calc(data, q)
    S: Vector = np.array(data.S).reshape(-1)  # a copy: S belongs to data
    return S[3:] if np.any(S[3:]) else S[:3]
