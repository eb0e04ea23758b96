"""The scene: nodes are created once, and updates send only what changed."""

from __future__ import annotations

import math
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.view.scene.arrow_nodes import IN_FRONT, ArrowNodes, assign, is_same
from ftforce.view.scene.colours import FIXED, NEUTRAL
from ftforce.view.scene.picture import chain_joints, rotation, scene_size

if TYPE_CHECKING:
    from collections.abc import Iterator

    import viser
    from numpy.typing import NDArray

    from ftforce.robot.robot import Robot
    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.model.controller import Controller
    from ftforce.view.scene.arrows import Arrow
    from ftforce.view.scene.colours import Colour
    from ftforce.view.scene.force_sets import Solid
    from ftforce.view.scene.picture import Line, Picture

_BOTH_SIDES: dict[str, Any] = {"side": "double", "cast_shadow": False, "receive_shadow": False}
_SEE_THROUGH = 0.45
_SOLID_OPACITY = 0.28
_FOV = math.radians(40.0)
_VIEW = np.array([0.80, -0.95, 0.45])  # direction from which the arm is viewed
_RIGHT = np.array([-_VIEW[1], _VIEW[0], 0.0]) / math.hypot(*_VIEW[:2])
_LABEL = 0.2  # length of a line's label, as a share of the size of the arm
_ASPECT = 0.66  # aspect ratio of the scene between the panels in a window of 1280 × 800 px
_SAMPLE = 500  # points per link, enough to aim the camera


class _Part(NamedTuple):
    """A mesh that moves with one joint of the model, and sample points of it, m, shape (k, 3)."""

    joint: int
    node: Any
    sample: Matrix


class Stage:
    """The scene of one arm on a viser server.

    Parameters
    ----------
    server :
        Server whose scene it is drawn in.
    robot :
        The arm.
    controller :
        Controller notified when a user drags the force or clicks on a joint; without it, the
        scene is not interactive.
    prefix :
        Prefix of the node names; must be unique per arm on the server.
    floor :
        Whether to draw the floor; two arms share one.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        robot: Robot,
        controller: Controller | None = None,
        prefix: str = "",
        *,
        floor: bool = True,
    ) -> None:
        self.server, self.robot, self.prefix = server, robot, prefix
        self._controller = controller
        self._moves = chain_joints(robot)
        self._extent = scene_size(robot)
        self._parts: list[_Part] = []
        self._last: Picture | None = None
        self._opacity: float | None = None
        self._drags: set[Any] = set()  # tabs that are dragging the force
        self._lines: Any = None
        self._marks: list[Any] = []
        self._solids: list[Any] = []
        self._shown_solids: tuple[Solid, ...] = ()
        self._floor = _floor(server, prefix, self._extent)
        self._floor.visible = floor
        self._arrows: dict[tuple[str, bool], ArrowNodes] = {}
        self._handle: Any = server.scene.add_transform_controls(
            f"{prefix}/force/handle",
            scale=0.1 * self._extent,
            line_width=2.5,
            opacity=0.8,
            **IN_FRONT,
        )
        if controller is not None:
            self._handle.on_update(lambda event: self._dragged(event, controller))

    # ---- the arm -----------------------------------------------------------------------------

    def set_geometry(self, geometry: Geometry) -> None:
        """Set the meshes of the arm's links and pose them as in the current picture."""
        scene = self.server.scene
        for earlier in self._parts:
            earlier.node.remove()
        self._parts = []
        for i, part in enumerate(geometry.parts):
            moves = self._moves[part.joint]
            node = scene.add_mesh_simple(
                f"{self.prefix}/arm/{i}",  # no URDF name: a slash would create a nested node
                part.vertices,
                part.faces,
                color=FIXED,
                opacity=self._opacity,
                flat_shading=part.flat,
                visible=self._last is not None,
                **_BOTH_SIDES,
            )
            if self._controller is not None and moves is not None:
                node.on_click(partial(_toggle, self._controller, moves))
            few = part.vertices[:: 1 + len(part.vertices) // _SAMPLE]
            self._parts.append(_Part(part.joint, node, few.astype(float)))
        if self._last is not None:
            self._pose(self._last, None)
            self._paint(self._last, None)

    def aim(self, picture: Picture) -> None:
        """Aim the camera of new tabs and images at the moving links and the force."""
        points = [pose.position for pose in picture.joints[1:]]
        points += [end for arrow in picture.arrows for end in (arrow.start, arrow.end)]
        points += [end for line in picture.lines for end in line.ends]
        for line in picture.lines:
            if line.label:  # the label extends to the right of the line's end
                points += [end + _LABEL * self._extent * _RIGHT for end in line.ends]
        points += [corner for solid in picture.solids for corner in solid.vertices]
        points.append(picture.joints[1].position * np.array([1.0, 1.0, 0.0]))  # the arm's base
        for part in self._parts:
            if self._moves[part.joint] is not None:
                pose = picture.joints[part.joint]
                points.extend(part.sample @ rotation(pose.wxyz).T + pose.position)
        # If the arm hangs below its root, put the floor below the arm.
        assign(self._floor, "position", np.array([0.0, 0.0, min(0.0, *(p[2] for p in points))]))
        eye, target = viewpoint(np.array(points), 0.08 * self._extent)
        camera = self.server.initial_camera
        camera.fov, camera.look_at, camera.position = _FOV, target, eye

    def update(self, picture: Picture) -> None:
        """Show a picture, sending only differences from the last one."""
        last, self._last = self._last, picture
        self._pose(picture, last)
        self._paint(picture, last)
        for arrow in picture.arrows:
            self._place_arrow(arrow)
        self._hide_arrows(picture)
        self._place_handle(picture)
        self._draw_lines(picture, last)
        self._draw_solids(picture)

    @contextmanager
    def without_handle(self) -> Iterator[None]:
        """Temporarily hide the force's drag handle, which has no function in an exported file."""
        is_shown = self._handle.visible
        self._handle.visible = False
        try:
            yield
        finally:
            self._handle.visible = is_shown

    def hide(self) -> None:
        """Hide the arm until the next update; forces remain."""
        for part in self._parts:
            assign(part.node, "visible", False)

    def _pose(self, picture: Picture, last: Picture | None) -> None:
        for part in self._parts:
            pose = picture.joints[part.joint]
            before = None if last is None else last.joints[part.joint]
            if before is None or not is_same(pose.position, before.position):
                part.node.position = pose.position
            if before is None or not is_same(pose.wxyz, before.wxyz):
                part.node.wxyz = pose.wxyz
            assign(part.node, "visible", True)

    def _paint(self, picture: Picture, last: Picture | None) -> None:
        self._opacity = _SEE_THROUGH if picture.see_through else None
        for part in self._parts:
            colour = picture.colours[part.joint]
            if last is None or last.colours[part.joint] != colour:
                part.node.color = colour
            if last is None or last.see_through != picture.see_through:
                part.node.opacity = self._opacity

    # ---- forces ------------------------------------------------------------------------------

    def _place_arrow(self, arrow: Arrow) -> None:
        key = arrow.kind, arrow.is_moment
        if key not in self._arrows:  # created on demand: most tasks have no moments
            if not arrow.length:
                return
            prefix = f"{self.prefix}/{'moment' if arrow.is_moment else 'force'}"
            self._arrows[key] = ArrowNodes(self.server, prefix, *key)
        self._arrows[key].show(arrow)

    def _hide_arrows(self, picture: Picture) -> None:
        """Hide arrows whose components the task no longer has."""
        shown = {(arrow.kind, arrow.is_moment) for arrow in picture.arrows}
        for key in self._arrows.keys() - shown:
            self._arrows[key].hide()

    def _place_handle(self, picture: Picture) -> None:
        assign(self._handle, "visible", picture.can_drag)
        if picture.can_drag and not self._drags:  # not while it is being dragged
            assign(self._handle, "position", picture.arrows[0].end)
            assign(self._handle, "wxyz", picture.tip.wxyz)

    def _dragged(self, event: Any, controller: Controller) -> None:
        if event.phase == "start":  # no displacement yet
            self._drags.add(event.client_id)
            return
        if event.phase == "end":
            self._drags.discard(event.client_id)
        controller.drag(self._end, not self._drags)

    def _end(self) -> Vector:
        return read_only(np.array(self._handle.position, dtype=float))

    def _draw_lines(self, picture: Picture, last: Picture | None) -> None:
        if last is not None and _are_same(picture.lines, last.lines):
            return
        scene, lines = self.server.scene, picture.lines
        if self._lines is None and lines:
            self._lines = add_lines(
                scene, f"{self.prefix}/force/lines", np.zeros((1, 2, 3)), NEUTRAL, 3.0
            )
        if self._lines is not None:
            assign(self._lines, "visible", bool(lines))
        if lines:
            self._lines.points = np.array([line.ends for line in lines], dtype=np.float32)
            colours = np.array([line.colour for line in lines])
            self._lines.colors = np.repeat(linear(colours)[:, None, :], 2, axis=1)
        while len(self._marks) < len(lines):
            name = f"{self.prefix}/force/line_{len(self._marks)}"
            self._marks.append(scene.add_label(name, "", anchor="top-left", font_screen_scale=0.8))
        for i, mark in enumerate(self._marks):
            assign(mark, "visible", i < len(lines))
            if i < len(lines):
                assign(mark, "text", lines[i].label)
                assign(mark, "position", lines[i].ends[1])

    def _draw_solids(self, picture: Picture) -> None:
        if _are_same(picture.solids, self._shown_solids):
            return
        for node in self._solids:
            node.remove()
        self._shown_solids = picture.solids
        self._solids = [
            self.server.scene.add_mesh_simple(
                f"{self.prefix}/force/solid_{i}",
                solid.vertices,
                solid.faces,
                color=solid.colour,
                opacity=_SOLID_OPACITY,
                flat_shading=True,
                **_BOTH_SIDES,
            )
            for i, solid in enumerate(picture.solids)
        ]


def viewpoint(points: Matrix, margin: float) -> tuple[Vector, Vector]:
    """Return the closest camera position from which all points are visible, and its target.

    Parameters
    ----------
    points :
        In root axes, m, shape (k, 3).
    margin :
        Margin around the points, m.
    """
    towards = _VIEW / np.linalg.norm(_VIEW)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    slopes = math.tan(0.5 * _FOV) * np.array([_ASPECT, 1.0])
    seen = (points - target) @ np.array([right, up]).T
    # Centred in the image, neglecting perspective.
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    target = target + middle[0] * right + middle[1] * up
    needed = (np.abs(seen - middle) + margin) / slopes
    distance = float((needed.max(axis=1) + (points - target) @ towards).max())
    return read_only(target + distance * towards), read_only(target)


def linear(colours: NDArray[Any]) -> Any:
    """Convert colours to linear RGB, as viser expects for lines and batched meshes."""
    return np.rint(255.0 * (colours / 255.0) ** 2.2).astype(np.uint8)


def add_lines(scene: Any, name: str, ends: Matrix, colour: Colour, thickness: float) -> Any:
    """Add line segments of one colour to a scene, and return their node.

    Parameters
    ----------
    scene :
        viser's scene.
    name :
        Name of the node.
    ends :
        In root axes, m, shape (k, 2, 3).
    colour :
        The colour.
    thickness :
        px.
    """
    colours = np.broadcast_to(linear(np.array(colour)), ends.shape)
    places = ends.astype(np.float32)
    return scene.add_line_segments(
        name, places, colours, thickness=thickness, thickness_units="screen"
    )


def _toggle(controller: Controller, joint: int, _event: Any) -> None:
    controller.toggle(joint)


def _floor(server: viser.ViserServer, prefix: str, extent: float) -> Any:
    width = 0.2 * math.ceil(10.0 * extent)
    return server.scene.add_grid(
        f"{prefix}/grid",
        width=width,
        height=width,
        plane="xy",
        cell_size=0.1,
        section_size=0.5,
        cell_color=(232, 232, 232),
        section_color=(208, 208, 208),
        shadow_opacity=0.0,
    )


def _are_same(old: tuple[Line | Solid, ...], new: tuple[Line | Solid, ...]) -> bool:
    return len(old) == len(new) and all(
        is_same(a, b)
        for before, after in zip(old, new, strict=True)
        for a, b in zip(before, after, strict=True)
    )
