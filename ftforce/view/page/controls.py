"""Individual controls of the page, and the mapping of joints to sliders."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ftforce.view.model.state import shown_position

if TYPE_CHECKING:
    from ftforce.robot.robot import Joint

_MAX_NAME = 16  # characters beside a slider
_PRISMATIC = 5.0  # m: slider range of a prismatic joint without limits


class Control:
    """A control of the page, and the value that it last showed of the question."""

    def __init__(self, handle: Any) -> None:
        self.handle, self.value = handle, handle.value

    def show(self, value: Any) -> None:
        """Show the question's value, unless the user has just moved the control.

        In that case its callback is pending, and will change the question instead.
        """
        is_moved = self.handle.value != self.value
        if self.value != value and not is_moved:
            self.value = self.handle.value = value


def slider_range(joint: Joint) -> tuple[float, float]:
    """Return a joint's slider range, degrees or m; a continuous joint spans one revolution."""
    widest, digits = (_PRISMATIC, 4) if joint.unit == "m" else (180.0, 2)
    low, high = (
        shown_position(joint.unit, x) if math.isfinite(x) else math.copysign(widest, x)
        for x in (joint.lower, joint.upper)
    )
    steps = 10.0**digits
    return math.floor(low * steps) / steps, math.ceil(high * steps) / steps


def slider_step(joint: Joint) -> float:
    """Return a joint's slider step, degrees or m."""
    return 0.0001 if joint.unit == "m" else 0.01


def slider_value(joint: Joint, position: float) -> float:
    """Return a joint's slider value, degrees or m; the angle of a continuous joint is wrapped.

    Parameters
    ----------
    joint :
        The joint.
    position :
        Its position, rad or m.
    """
    low, high = slider_range(joint)
    if joint.type == "continuous":
        position = math.remainder(position, 2.0 * math.pi)
    shown = shown_position(joint.unit, position)
    return min(max(round(shown, 4 if joint.unit == "m" else 2) + 0.0, low), high)


def shortened(name: str) -> str:
    """Return a name that fits beside a slider, keeping its end, which is more distinctive."""
    return name if len(name) <= _MAX_NAME else f"…{name[1 - _MAX_NAME :]}"
