"""Playback of a history on the page, with the healthy arm beside the faulty one.

All numbers shown are read from the history's arrays; nothing is computed during playback.
"""

from __future__ import annotations

import threading
import time as clock
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.errors import InputError, TrajectoryError
from ftforce.show.plots.canvas import STROKES
from ftforce.trajectory.history_files import load_history
from ftforce.view.animation import FRAME, PLACES, HealthyArm, aim, animated_page, draw_path, legend
from ftforce.view.model.fitting import difference, displacement
from ftforce.view.model.state import in_components
from ftforce.view.modes import Mode, View
from ftforce.view.page import answer, curves
from ftforce.view.page.controls import Control
from ftforce.view.page.history import charts, marks, tables
from ftforce.view.scene.picture import scene_size
from ftforce.view.scene.snapshots import (
    ROUNDING,
    faults_at,
    first_with,
    history_scales,
    scene,
    sentence,
    snapshot,
)

if TYPE_CHECKING:
    import os

    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import History
    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.model.state import State
    from ftforce.view.modes import Host

_SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 20.0)
_PRINT_RTOL = 1e-5  # times are printed with six digits
_MAX_STEP = 0.25  # s: if the machine stalls, playback pauses instead of skipping ahead


def playback(robot: Robot, state: State, path: str | os.PathLike[str], at: float = 0.0) -> Playback:
    """Return the playback of a history written by ``ftforce simulate``.

    Parameters
    ----------
    robot :
        The arm.
    state :
        Initial question of the page. It must not contain faults: the history has its own.
    path :
        File of the history.
    at :
        Initial time, s.

    Raises
    ------
    TrajectoryError
        The file cannot be read, or belongs to another arm.
    InputError
        The question contains faults, or ``at`` lies outside the history.
    """
    if state.faults.faults:
        raise InputError("the faults are those of the history; omit --locked, --free and --weak")
    history = load_history(path)
    check_fits(robot, history, path)
    end = float(history.t[-1])
    if not 0.0 <= at <= end * (1.0 + _PRINT_RTOL):  # also rejects NaN
        raise InputError(f"time {at:g} s is outside the history, which lasts from 0 to {end:g} s")
    return Playback(robot, history, min(at, end))


def check_fits(robot: Robot, history: History, path: str | os.PathLike[str]) -> None:
    """Check that a history belongs to this arm.

    Parameters
    ----------
    robot :
        The arm.
    history, path :
        The history, and its file for the message.

    Raises
    ------
    TrajectoryError
        It belongs to another arm; the message states the difference.
    """
    setting, run = history.setting, history.healthy
    names = tuple(joint.name for joint in setting.joints)
    units = tuple(joint.unit for joint in setting.joints)
    problem = difference(robot, setting, names, units)
    if problem := problem or displacement(robot, run.q[0], run.position[0]):
        raise TrajectoryError(path, problem)


def _mark(history: History, time: float) -> str:
    """Return the numbers of the joints that fail at ``time``, short enough for a slider mark."""
    before = faults_at(history, time - 2.0 * ROUNDING).faults
    return ",".join(str(x.joint + 1) for x in faults_at(history, time).faults if x not in before)


# ---- the mode --------------------------------------------------------------------------------


class Playback(Mode):
    """Playback of a history on the page; a `ftforce.view.modes.Mode`.

    Parameters
    ----------
    robot :
        The arm.
    history :
        A history of this arm.
    at :
        Initial time, s.
    """

    tab = "Time"
    takes_over = True

    def __init__(self, robot: Robot, history: History, at: float = 0.0) -> None:
        self.robot, self.history = robot, history
        self.end = float(history.t[-1])
        self._names = {STROKES[name].words: name for name in reversed(history.runs)}
        if len(self._names) > 1 and history.setting.events:
            del self._names[STROKES["healthy"].words]  # shown with each of the other runs
        self._name = next(iter(self._names.values()))
        self._time, self._speed, self._place = at, 1.0, PLACES[0]
        self._scales = history_scales(history, scene_size(robot))
        self._geometry: Geometry | None = None
        self._lock = threading.RLock()
        self._playing, self._ends = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    # ---- controls --------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Current time, s."""
        with self._lock:
            return self._time

    @property
    def run(self) -> str:
        """Name of the current run, one of `ftforce.trajectory.history.RUNS`."""
        with self._lock:
            return self._name

    @property
    def is_playing(self) -> bool:
        """Whether playback is running."""
        return self._playing.is_set()

    def seek(self, time: float) -> None:
        """Jump to a time, s."""
        with self._lock:
            self._time = min(max(time, 0.0), self.end)
        self._update_page()

    def _update_page(self) -> None:
        """Update the page to the current time."""
        with self._session.panel.writing():
            self._clock.show(min(round(self.time, 3), self._slider.max))
        self._request_view()

    def play(self) -> None:
        """Start playback; at the end, restart from the beginning."""
        if self.time >= self.end:
            self.seek(0.0)
        self._playing.set()
        self._button.label = "Pause"

    def pause(self) -> None:
        """Pause playback."""
        with self._lock:
            self._playing.clear()
        self._button.label = "Play"

    def choose(self, label: str) -> None:
        """Select a run by its label on the page."""
        with self._lock:
            self._name = self._names[label]
        self._draw_charts()
        self._request_view()

    def _set_place(self, place: str) -> None:
        with self._lock:
            self._place = place
        self._request_view()

    def _request_view(self) -> None:
        """Request the current time's view, passing the history's question to the controls."""
        self._session.change(self._as_played)

    def _as_played(self, state: State) -> State:
        # Evaluated under the session's lock, so a delayed call still uses the current time.
        now = snapshot(self.history, self.run, self.time)
        return state.at(now.q).with_faults(now.faults)

    # ---- Mode --------------------------------------------------------------------------------

    def start(self, session: Host) -> None:
        """Start paused."""
        self._session = session
        self._healthy = HealthyArm(session.server, self.robot)
        with session.panel.first_tab:
            self._build(session.server.gui)
        draw_path(session.server, self.history)
        self._draw_charts()
        task, force = self.history.setting.task, np.array(self.history.setting.force)
        wrench = in_components(task.components, force)
        scale = self.history.setting.scale
        session.change(
            lambda s: replace(
                s.asking(str(task), task.axes, task.length).pushing(wrench), scale=scale
            )
        )
        self._request_view()
        self._thread = threading.Thread(target=self._play, name="ftforce playback", daemon=True)
        self._thread.start()

    def view(self, state: State) -> View:
        """Return the view at the current time."""
        with self._lock:
            name, time, place = self._name, self._time, self._place
        history = self.history
        now = snapshot(history, name, time)
        picture = scene(self.robot, history, now, self._scales, state.shown.see_through)

        def more() -> None:
            with self._lock:
                self._healthy.show(picture, now, place)
            self._cursor.content = str(curves.cursor(now.time / self.end if self.end else 0.0))

        top = answer.verdict_banner(now.verdict, sentence(history, name, now), history.warnings)
        below = legend(picture, name, place, self._session.panel.notes)
        return View(picture, top, tables(history, now), below, more)

    def set_geometry(self, geometry: Geometry) -> None:
        """Set the link meshes of the healthy arm, and aim the camera at the whole path."""
        with self._lock:
            self._geometry = geometry
            self._healthy.set_geometry(geometry)
        picture = self._session.picture
        if picture is not None:
            self._session.stage.aim(aim(picture, self.history, self.run))

    def page(self) -> str:
        """Return the history as an animated page."""
        with self._lock:
            name, place, geometry = self._name, self._place, self._geometry
        see_through = self._session.state.shown.see_through
        return animated_page(
            self.robot, self.history, name, geometry, place=place, see_through=see_through
        )

    def stop(self) -> None:
        """Stop the playback thread."""
        self._ends.set()
        self._playing.set()  # wakes the thread if it is paused
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(10.0)

    # ---- the thread --------------------------------------------------------------------------

    def _play(self) -> None:
        while not self._ends.is_set():
            self._playing.wait()
            last = clock.perf_counter()
            while self._playing.is_set() and not self._ends.wait(FRAME):
                now = clock.perf_counter()
                self._advance(min(now - last, _MAX_STEP))
                last = now

    def _advance(self, seconds: float) -> None:
        with self._lock:
            if not self._playing.is_set():  # the user paused in the meantime
                return
            self._time = min(self._time + self._speed * seconds, self.end)
            is_over = self._time >= self.end
        self._update_page()
        if is_over:
            self.pause()

    # ---- the page ----------------------------------------------------------------------------

    def _build(self, gui: Any) -> None:
        history, step = self.history, max(round(self.end / 1000.0, 3), 0.001)
        end, now = max(self.end, step), min(round(self._time, 3), self.end)
        self._button = gui.add_button("Play")
        self._button.on_click(lambda _event: self.pause() if self.is_playing else self.play())
        faults = tuple((time, _mark(history, time)) for time in sorted({*marks(history)}))
        self._slider = gui.add_slider(
            "Time (s)", 0.0, end, step, now, marks=faults or None, hint="Faults are marked"
        )
        self._clock = Control(self._slider)
        self._slider.on_update(lambda _event: self._on_slider())
        names = tuple(self._names)
        run = gui.add_dropdown("Run", names, initial_value=names[0])
        run.on_update(lambda _event: self.choose(run.value))
        speeds = tuple(f"{speed:g}×" for speed in _SPEEDS)
        speed = gui.add_dropdown("Speed", speeds, initial_value="1×")
        speed.on_update(lambda _event: self._set_speed(_SPEEDS[speeds.index(speed.value)]))
        place = gui.add_dropdown("Healthy arm", PLACES, initial_value=self._place)
        place.on_update(lambda _event: self._set_place(place.value))
        self._charts = gui.add_html("")
        self._cursor = gui.add_html("")
        self.controls = {"time": self._slider, "run": run, "speed": speed, "place": place}

    def _on_slider(self) -> None:
        if self._session.panel.is_writing:
            return
        self.pause()
        time = self._clock.value = float(self._slider.value)
        for event in self.history.setting.events:
            if round(event.time, 3) == round(time, 3):  # show the state after the fault
                time = first_with(self.history, event.time)
        self.seek(time)

    def _set_speed(self, speed: float) -> None:
        self._speed = speed

    def _draw_charts(self) -> None:
        self._charts.content = str(charts(self.history, self.history.runs[self.run]))
