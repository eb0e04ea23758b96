"""One control of the page: what it shows, and how a joint is put on a slider."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ftforce.view.model.state import shown_position

if TYPE_CHECKING:
    from ftforce.robot.robot import Joint

_LONGEST_NAME = 16  # letters beside a slider
_SLIDE = 5.0  # m: how far a joint that slides without limits goes on the page


class Control:
    """A control of the page, and what the question last said it shows."""

    def __init__(self, handle: Any) -> None:
        self.handle, self.value = handle, handle.value

    def tell(self, value: Any) -> None:
        """Let it show what the question says, unless a hand has just moved it.

        Then the hand's own callback is on its way; what it says becomes the question's.
        """
        is_moved = self.handle.value != self.value
        if self.value != value and not is_moved:
            self.value = self.handle.value = value


def slider_range(joint: Joint) -> tuple[float, float]:
    """Return the ends of a joint's slider, degrees or m; a continuous joint turns once."""
    widest, digits = (_SLIDE, 4) if joint.unit == "m" else (180.0, 2)
    low, high = (
        shown_position(joint.unit, x) if math.isfinite(x) else math.copysign(widest, x)
        for x in (joint.lower, joint.upper)
    )
    steps = 10.0**digits
    return math.floor(low * steps) / steps, math.ceil(high * steps) / steps


def slider_step(joint: Joint) -> float:
    """Return the step of a joint's slider, degrees or m."""
    return 0.0001 if joint.unit == "m" else 0.01


def slider_value(joint: Joint, position: float) -> float:
    """Return what a joint's slider shows, degrees or m; a continuous joint's angle is wrapped."""
    low, high = slider_range(joint)
    if joint.type == "continuous":
        position = math.remainder(position, 2.0 * math.pi)
    shown = shown_position(joint.unit, position)
    return min(max(round(shown, 4 if joint.unit == "m" else 2) + 0.0, low), high)


def shortened(name: str) -> str:
    """Return a name that fits beside a slider: its end says more than its beginning."""
    return name if len(name) <= _LONGEST_NAME else f"…{name[1 - _LONGEST_NAME :]}"
