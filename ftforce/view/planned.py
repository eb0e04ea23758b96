"""Best postures and failure-tolerant workspaces on the page."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.question import Question
from ftforce.robot.kinematics import joint_frames, tip_pose
from ftforce.view.model.state import initial_state
from ftforce.view.scene.colours import interpolate
from ftforce.view.scene.picture import Line
from ftforce.view.scene.stage import linear
from ftforce.view.session import Session
from ftforce.view.survey import RAMP

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.planning.posture import BestPosture
    from ftforce.planning.reach import FailureTolerantWorkspace
    from ftforce.robot.robot import Robot

_GHOSTS = 60  # so many can be told apart
_PROVED, _SHOWN = (8, 81, 156), (107, 174, 214)  # cells, as in the plot of `ftforce reach`
_AIM_POINTS = 400  # enough to aim the camera
_OF_EDGE = 0.15  # of a cell's edge, so that the arm is seen between them


def open_posture(found: BestPosture, *, port: int | None = None) -> Session:
    """Open the page with the best posture in its worst fault set, and its self-motion as a fan.

    Postures on the self-motion are lines along the arm, bright where the worst fault leaves most.

    Parameters
    ----------
    found :
        The best posture.
    port :
        Port to listen on; by default the first free one.

    Raises
    ------
    FtforceError
        The extra ``view`` is not installed, or the port is taken.
    """
    worst = found.sets[found.worst_set(found.measured_after)]
    question = replace(found.question, faults=worst, direction=None, posture=found.after)
    session = _opened(question, port)
    q, values = found.self_motion.q, found.values
    chosen = np.unique(np.linspace(0, len(q) - 1, min(_GHOSTS, len(q))).astype(int))
    lines = [_along(found.robot, one) for one in q[chosen]]
    colours = _colours(found, values)[chosen]
    ends = np.concatenate(lines)
    shades = np.concatenate([
        np.broadcast_to(colour, line.shape) for colour, line in zip(colours, lines, strict=True)
    ])  # fmt: skip
    session.server.scene.add_line_segments(
        "/self-motion", ends.astype(np.float32), linear(shades), thickness=1.5,
        thickness_units="screen",
    )  # fmt: skip
    return session


def open_reach(found: FailureTolerantWorkspace, *, port: int | None = None) -> Session:
    """Open the page with the cells that are reached whichever joint locks.

    Dark ones are proved; of the others, the middle is reached.

    Parameters
    ----------
    found :
        The failure-tolerant workspace.
    port :
        Port to listen on; by default the first free one.

    Raises
    ------
    FtforceError
        The extra ``view`` is not installed, or the port is taken.
    """
    session = _opened(Question.parse(found.robot).placed(), port)
    for name, colour, cells in (
        ("proved", _PROVED, found.proved),
        ("shown", _SHOWN, found.tolerated_middles & ~found.proved),
    ):
        if cells.any():
            places = np.zeros((int(cells.sum()), 3))
            places[:, found.rows] = found.places(cells)
            colours = np.broadcast_to(np.array(colour, dtype=np.uint8), places.shape)
            size = _OF_EDGE * found.edge
            session.server.scene.add_point_cloud(
                f"/reach/{name}", places.astype(np.float32), colours, point_size=size,
                point_shape="circle",
            )  # fmt: skip
            _aim_at(session, places[:: 1 + len(places) // _AIM_POINTS])
    return session


def _aim_at(session: Session, places: Matrix) -> None:
    """Aim the camera at the arm and at some places."""
    if session.picture is not None:
        lines = tuple(Line(np.array([place, place]), _SHOWN, "") for place in places)
        session.stage.aim(replace(session.picture, lines=lines))


def _opened(question: Question, port: int | None) -> Session:
    has_limits = question.limits is not None
    session = Session(
        question.robot, initial_state(question, are_limits_given=has_limits), port=port
    )
    try:
        session.load_geometry()
        session.settle()
    except BaseException:
        session.close()
        raise
    return session


def _along(robot: Robot, q: Vector) -> Matrix:
    """Return line segments along the arm from joint to joint to the tip, m, shape (k, 2, 3)."""
    places = np.array([*(place for _, place in joint_frames(robot, q)), tip_pose(robot, q)[1]])
    ends: Matrix = np.stack([places[:-1], places[1:]], axis=1)
    return ends


def _colours(found: BestPosture, values: Vector) -> NDArray[np.uint8]:
    """Return colours of values, the best ones bright, shape (k, 3)."""
    shares = (values - values.min()) / max(float(np.ptp(values)), 1e-300)
    return interpolate(RAMP, 1.0 - shares if found.objective.measure.is_cost else shares)
