"""Simulation histories in the scene: tip path, healthy arm, and export as an animated page."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.show.plots.canvas import STROKES
from ftforce.view.page import answer, curves, html
from ftforce.view.page.history import charts, chosen, tables
from ftforce.view.scene.picture import Line, scene_size
from ftforce.view.scene.snapshots import (
    first_with,
    ghost,
    history_scales,
    scene,
    sentence,
    snapshot,
)
from ftforce.view.scene.stage import Stage, add_lines
from ftforce.view.server.export import record, scene_html
from ftforce.view.server.server import open_server

if TYPE_CHECKING:
    import viser
    from markupsafe import Markup

    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import History
    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.scene.picture import Picture
    from ftforce.view.scene.snapshots import Snapshot

PLACES = ("in place", "beside", "hidden")  # of the healthy arm
_PATH_COLOUR = (90, 90, 90)
_BESIDE = 0.8  # along the root's y axis, as a share of the size of the arm
_LOWER_EDGE = 0.85  # height of the clock below the image centre, as a share of half the image
FRAME = 0.05  # s
_MAX_FRAMES = 1000  # per animated page: keeps it at a few MB, opening within a second


class HealthyArm:
    """A transparent copy of the arm, moving as if no joint had failed.

    Parameters
    ----------
    server :
        Server whose scene it is drawn in.
    robot :
        The arm.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot) -> None:
        self._robot = robot
        self._stage = Stage(server, robot, prefix="/healthy", floor=False)
        self._beside = np.array([0.0, _BESIDE * scene_size(robot), 0.0])

    def set_geometry(self, geometry: Geometry) -> None:
        """Set the meshes of its links."""
        self._stage.set_geometry(geometry)

    def show(self, picture: Picture, now: Snapshot, place: str) -> None:
        """Show the arm at one instant, placed relative to the faulty arm, or hide it.

        Parameters
        ----------
        picture :
            Picture of the faulty arm.
        now :
            State of the history at that instant.
        place :
            Placement of the healthy arm, one of `PLACES`.
        """
        if place == "hidden" or now.run is now.healthy:
            self._stage.hide()
            return
        offset = self._beside if place == "beside" else np.zeros(3)
        self._stage.update(ghost(self._robot, picture, now.healthy.q[now.sample], offset))


def draw_path(server: viser.ViserServer, history: History) -> None:
    """Draw the reference path of the tip.

    Parameters
    ----------
    server :
        Server whose scene it is drawn in.
    history :
        The history.
    """
    places = history.path[chosen(history, history.healthy)]
    if len(places) > 1:
        add_lines(
            server.scene, "/history/path", np.array(list(pairwise(places))), _PATH_COLOUR, 2.0
        )


def aim(picture: Picture, history: History, name: str) -> Picture:
    """Return a picture for `Stage.aim` that contains the whole tip path.

    Parameters
    ----------
    picture :
        Picture of the arm.
    history :
        The history.
    name :
        Name of the run, one of `ftforce.trajectory.history.RUNS`.
    """
    run = history.runs[name]
    places = run.position[chosen(history, run)]
    lines = (Line(np.array(ends), _PATH_COLOUR, "") for ends in pairwise(places))
    return replace(picture, lines=tuple(lines))


def legend(picture: Picture, name: str, place: str, notes: tuple[str, ...]) -> Markup:
    """Return the legend of the scene of a run.

    Parameters
    ----------
    picture :
        The scene.
    name :
        Name of the run, one of `ftforce.trajectory.history.RUNS`.
    place :
        Placement of the healthy arm, one of `PLACES`.
    notes :
        Notes on missing meshes.
    """
    entries = ["grey line: reference path of the tip"]
    if place != "hidden" and name != "healthy":
        where = "in the same place" if place == "in place" else "beside it"
        entries.insert(0, f"transparent arm: healthy, {where}; opaque arm: {STROKES[name].words}")
    return answer.legend(picture, (*entries, *notes))


# ---- animated page ---------------------------------------------------------------------------


def animated_page(
    robot: Robot,
    history: History,
    name: str,
    geometry: Geometry | None,
    *,
    place: str = PLACES[0],
    see_through: bool = False,
) -> str:
    """Return a run as a self-contained, animated HTML page with a description beside it.

    It is recorded on a separate server, so open pages are not disturbed.

    Parameters
    ----------
    robot :
        The arm.
    history :
        A history of this arm.
    name :
        Name of the run, one of `ftforce.trajectory.history.RUNS`.
    geometry :
        Link meshes of the arm; ``None`` if they are not loaded.
    place :
        Placement of the healthy arm, one of `PLACES`.
    see_through :
        Whether the arm is transparent.
    """
    title = f"ftforce {robot.name}"
    with closing(open_server(port=0, title=title)) as opened:
        server = opened.server
        stage, healthy = Stage(server, robot), HealthyArm(server, robot)
        if geometry is not None:
            stage.set_geometry(geometry)
            healthy.set_geometry(geometry)
        draw_path(server, history)
        scales = history_scales(history, scene_size(robot))

        def at(time: float) -> tuple[Snapshot, Picture]:
            now = snapshot(history, name, time)
            return now, scene(robot, history, now, scales, see_through)

        def show(time: float) -> None:
            now, picture = at(time)
            stage.update(picture)
            healthy.show(picture, now, place)
            clock.text = _clock(now)

        _, picture = at(0.0)
        stage.aim(aim(picture, history, name))
        clock: Any = server.scene.add_label(
            "/history/clock", "", position=_below(server.initial_camera), font_screen_scale=1.1
        )
        show(0.0)
        times = frame_times(float(history.t[-1]))
        recording = record(server, times.tolist(), float(times[-1]) / (len(times) - 1), show)
        notes = () if geometry is None else geometry.notes
        text = _description(history, name, legend(picture, name, place, notes))
        return scene_html(server, title=title, answer=text, recording=recording)


def frame_times(end: float) -> Vector:
    """Return the frame times of a recording from 0 to ``end``, s; at least two."""
    count = min(math.ceil(end / FRAME), _MAX_FRAMES - 1)
    return np.linspace(0.0, end, max(count, 1) + 1)


def _below(camera: Any) -> Vector:
    """Return a point at the lower edge of the camera image."""
    eye, target = np.array(camera.position), np.array(camera.look_at)
    distance = float(np.linalg.norm(eye - target))
    towards = (eye - target) / distance
    up = np.array([0.0, 0.0, 1.0]) - towards[2] * towards
    up /= np.linalg.norm(up)
    return read_only(target - _LOWER_EDGE * distance * math.tan(0.5 * camera.fov) * up)


def _clock(now: Snapshot) -> str:
    """Return the caption below the arm: time, failed joints and verdict."""
    failed = ", ".join(f"{fault.joint + 1} {fault}" for fault in now.faults.faults)
    return f"{now.time:.1f} s: {failed or 'healthy'}, {now.verdict}"


def _description(history: History, name: str, below: Markup) -> Markup:
    """Return the description of a run in chronological order: start, each event, end."""
    delay = history.setting.delay if name == "remapped" else 0.0
    end = float(history.t[-1])
    events = [t for event in history.setting.events for t in (event.time, event.time + delay)]
    times = sorted({0.0, *(first_with(history, t) for t in events if t <= end), end})
    parts, warnings = [], history.warnings
    for time in times:
        now = snapshot(history, name, time)
        parts.append(answer.verdict_banner(now.verdict, sentence(history, name, now), warnings))
        warnings = ()  # shown once
    at = next((t for t in times if t > 0.0), end)
    now = snapshot(history, name, at)
    parts += [
        curves.no_cursor(),
        charts(history, history.runs[name]),
        html.block(html.element("h3", f"At {now.time:.2f} s")),
        tables(history, now),
        below,
    ]
    return html.element("div", *parts, data_testid="static")
