"""Colours shared by the scene and the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ftforce.core.faults import FaultMode
from ftforce.core.verdict import Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Vector

Colour: TypeAlias = tuple[int, int, int]

# Okabe and Ito's palette, distinguishable with any kind of colour vision.
NEUTRAL: Colour = (190, 190, 184)
FIXED: Colour = (212, 212, 208)
FAULT_COLOURS: dict[FaultMode, Colour] = {
    FaultMode.LOCKED: (213, 94, 0),
    FaultMode.FREE: (204, 121, 167),
    FaultMode.WEAK: (230, 159, 0),
}
# From no load to the limit: one hue of decreasing lightness, so it also reads in greyscale.
RAMP: tuple[Colour, ...] = ((236, 240, 245), (158, 202, 225), (49, 130, 189), (8, 48, 107))
LOST_LINE: Colour = (120, 0, 60)
WEAKEST_LINE: Colour = (120, 90, 0)
BEFORE_SOLID: Colour = (86, 180, 233)
AFTER_SOLID: Colour = (0, 158, 115)
VERDICT_COLOURS: dict[Verdict, Colour] = {
    Verdict.TOLERATED: (0, 110, 80),
    Verdict.BORDERLINE: (150, 95, 0),
    Verdict.NOT_TOLERATED: (170, 40, 20),
}
ARROW_COLOURS: dict[str, Colour] = {  # of viser's z, y and x axis handles
    "requested": (32, 128, 255),
    "kept": (32, 190, 110),
    "lost": (255, 32, 96),
}


def colour_of(mode: FaultMode | None, used: float) -> Colour:
    """Return the colour of a joint.

    Parameters
    ----------
    mode :
        Fault mode; ``None`` if the joint is healthy.
    used :
        Motor torque as a share of its limit; NaN if unknown.
    """
    if mode is not None:
        return FAULT_COLOURS[mode]
    if math.isnan(used):
        return NEUTRAL
    red, green, blue = interpolate(RAMP, np.array([used]))[0].tolist()
    return red, green, blue


def interpolate(ramp: tuple[Colour, ...], shares: Vector) -> NDArray[np.uint8]:
    """Return the interpolated colours of a ramp, shape (k, 3).

    Parameters
    ----------
    ramp :
        Colours at equal distances.
    shares :
        Positions along the ramp, 0 to 1, shape (k,).
    """
    steps = np.linspace(0.0, 1.0, len(ramp))
    channels = [np.interp(shares, steps, channel) for channel in np.array(ramp, dtype=float).T]
    found: NDArray[np.uint8] = np.rint(np.column_stack(channels)).astype(np.uint8)
    return found
