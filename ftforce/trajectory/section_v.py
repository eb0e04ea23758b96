"""The paper's simulation, Section V: a line, a constant force, joint 3 locks at t = 50 s."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ftforce.robot.load import load_robot
from ftforce.trajectory.path import Path
from ftforce.trajectory.simulate import simulate

if TYPE_CHECKING:
    from ftforce.analysis.question import Progress
    from ftforce.trajectory.history import History

START = (1.150, -0.134, 0.034)  # R_s, m
END = (0.781, 0.509, 0.280)  # R_d, m
SPEED = 0.015  # m/s
FORCE = (80.0, 50.0, 10.0)  # N
FAULT = "3@50"
_POSTURE = (-10.0, 18.0, -6.0, -5.0, -6.0)  # degrees; initial guess at the start of the path

_NOTES = (
    (
        "masses, not given in the paper: those of robots/dh5.toml, solid aluminium cylinders, "
        "10.7 kg in total"
    ),
    (
        "initial posture, not given in the paper: one near (-10°, 18°, -6°, -5°, -6°), from which "
        "joint 3 can lock at 50 s and leave a margin; the arm starts close to full extension"
    ),
    (
        "timing law, not given in the paper: 10u³ - 15u⁴ + 6u⁵, at rest at both ends, peak speed "
        "15 mm/s"
    ),
    "the force is constant in tool axes, as in the paper's tables",
    "Figs. 2 to 4 are therefore reproduced in shape, not in every digit",
)


def section_v(
    *,
    rate: float | None = None,
    delay: float = 0.0,
    remap: bool = True,
    progress: Progress | None = None,
) -> History:
    """Return the simulation of Section V on the paper's arm.

    Fig. 1 shows the path, Fig. 2 the motor torques of the healthy arm, Fig. 3 those with joint 3
    locked, and Fig. 4 the force of both. Data missing from the paper are assumed, see
    ``history.setting.notes``.

    Parameters
    ----------
    rate, delay, remap, progress :
        As in `ftforce.simulate`.

    Examples
    --------
    >>> history = section_v(rate=2)
    >>> history.answer.verdicts[-1].value, history.setting.events[0].time
    ('tolerated', 50.0)
    """
    history = simulate(
        load_robot("dh5"),
        Path.through([START, END], speed=SPEED),
        np.deg2rad(_POSTURE),
        force=FORCE,
        faults=FAULT,
        rate=rate,
        delay=delay,
        remap=remap,
        progress=progress,
    )
    return replace(history, setting=replace(history.setting, notes=_NOTES))
