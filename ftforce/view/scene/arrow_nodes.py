"""Arrows in the scene, drawn as the axis handles of viser's transform controls.

Only these can be drawn on top of everything else, so that the arm never hides an arrow. The handle
of each axis has a fixed colour, which determines the axis used for each kind of arrow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    import viser

    from ftforce.core.arrays import Vector
    from ftforce.view.scene.arrows import Arrow

_AXIS = {"lost": 0, "kept": 1, "requested": 2}  # axes of the transform controls: red, green, blue
IN_FRONT: dict[str, Any] = {  # draws transform controls as arrows on top of everything else
    "disable_rotations": True,
    "disable_sliders": True,
    "depth_test": False,
    "visible": False,
}
_ANCHOR: dict[str, Any] = {  # keeps the labels of neighbouring arrows from overlapping
    "requested": "bottom-center",
    "kept": "top-center",
    "lost": "bottom-right",
}
_MOMENT_ANCHOR: dict[str, Any] = {
    "requested": "center-right",
    "kept": "center-left",
    "lost": "top-center",
}
_MIN_LENGTH = 1e-4  # m: shorter arrows are not drawn
_RESOLUTION = 1e-9  # m: smaller displacements are ignored
_SECOND_HEAD = 0.78  # of a moment's arrow: position of the second head, as a share of its length
_WIDTH, _MOMENT_WIDTH = 6.0, 4.0  # px


class ArrowNodes:
    """The scene nodes of one arrow: one handle, or two for a moment, and a label.

    Parameters
    ----------
    server :
        Server whose scene it is drawn in.
    prefix :
        Prefix of the node names.
    kind, is_moment :
        As in `ftforce.view.scene.arrows.Arrow`.
    """

    def __init__(self, server: viser.ViserServer, prefix: str, kind: str, is_moment: bool) -> None:
        self._axis = _AXIS[kind]
        self._last: Arrow | None = None
        self._lengths = (1.0, _SECOND_HEAD) if is_moment else (1.0,)
        width = _MOMENT_WIDTH if is_moment else _WIDTH
        self._handles = [
            self._handle(server, f"{prefix}/{kind}_{i}", width) for i in range(len(self._lengths))
        ]
        anchor = (_MOMENT_ANCHOR if is_moment else _ANCHOR)[kind]
        self._label: Any = server.scene.add_label(
            f"{prefix}/{kind}_label", kind, anchor=anchor, visible=False, font_screen_scale=0.85
        )

    def _handle(self, server: viser.ViserServer, name: str, width: float) -> Any:
        node: Any = server.scene.add_transform_controls(
            name,
            scale=1.0,
            line_width=width,
            active_axes=(self._axis == 0, self._axis == 1, self._axis == 2),
            **IN_FRONT,
        )
        node.on_update(lambda event: self._undo_drag(node, event))
        return node

    def _undo_drag(self, node: Any, event: Any) -> None:
        """Undo a drag: only the separate handle at the arrow's tip may be dragged."""
        if event.phase == "end" and self._last is not None:
            node.position = self._last.start + np.array([0.0, 0.0, _RESOLUTION])  # forces an update
            node.position = self._last.start

    def show(self, arrow: Arrow) -> None:
        """Show the arrow in its current state."""
        self._last = arrow
        # A coinciding arrow below would only flicker.
        is_shown = arrow.length > _MIN_LENGTH and (bool(arrow.mark) or arrow.kind == "kept")
        assign(self._label, "visible", is_shown and bool(arrow.mark))
        for node, length in zip(self._handles, self._lengths, strict=True):
            assign(node, "visible", is_shown)
            if is_shown:
                assign(node, "scale", length * arrow.length)
                assign(node, "position", arrow.start)
                assign(node, "wxyz", along(arrow.end - arrow.start, self._axis))
        if is_shown:
            assign(self._label, "text", arrow.mark)
            assign(self._label, "position", arrow.end)

    def hide(self) -> None:
        """Hide the arrow until it is shown again."""
        for node in (*self._handles, self._label):
            assign(node, "visible", False)


def along(vector: Vector, axis: int) -> Vector:
    """Return a rotation that aligns an axis with a vector, as a quaternion w, x, y, z.

    Parameters
    ----------
    vector :
        Nonzero, shape (3,).
    axis :
        Index of the axis, 0 to 2.
    """
    rotation = pin.Quaternion.FromTwoVectors(np.eye(3)[axis], vector)
    return np.array([rotation.w, rotation.x, rotation.y, rotation.z])


def assign(node: Any, name: str, value: Any) -> None:
    """Set an attribute if its value differs: viser sends every assignment to all tabs.

    Parameters
    ----------
    node :
        viser's handle of a node or a control.
    name, value :
        Name of the attribute, and its new value.
    """
    if not is_same(getattr(node, name), value):
        setattr(node, name, value)


def is_same(one: Any, other: Any) -> bool:
    """Return whether two values are equal; arrays up to rounding.

    Parameters
    ----------
    one, other :
        Numbers, strings or arrays.
    """
    if isinstance(other, np.ndarray):
        return np.shape(one) == other.shape and not _differs(one, other)
    return bool(one == other)


def _differs(one: Vector, other: Vector) -> bool:
    """Return whether two positions or rotations differ by more than rounding."""
    return bool(np.abs(one - other).max(initial=0.0) > _RESOLUTION)
