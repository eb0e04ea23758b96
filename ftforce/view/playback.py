"""A history on the page: the arm over time, beside it the arm as if healthy.

Every number that is shown stands in the history's arrays; nothing is analysed while it plays.
"""

from __future__ import annotations

import math
import re
import threading
import time as clock
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce import words
from ftforce.errors import InputError, TrajectoryError, printable
from ftforce.faults import Fault, FaultMode, FaultSet
from ftforce.history_files import load_history
from ftforce.show.canvas import LINE_COLOURS, STROKES
from ftforce.view import markup
from ftforce.view.answer import JointLoad
from ftforce.view.picture import (
    NEUTRAL,
    Line,
    Picture,
    force_arrows,
    joint_colours,
    joint_poses,
    nice_scale,
    pose_of,
    scene_size,
    spatial,
)
from ftforce.view.session import View
from ftforce.view.stage import Stage
from ftforce.view.state import in_components

if TYPE_CHECKING:
    import os

    from ftforce.arrays import Vector
    from ftforce.history import History, Run
    from ftforce.metrics import Verdict
    from ftforce.robot import Robot
    from ftforce.view.meshes import Geometry
    from ftforce.view.session import Session
    from ftforce.view.state import State

PLACES = ("in place", "beside", "hidden")  # of the healthy arm
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 20.0)
FRAME = 0.05  # s
_SLOWEST = 0.25  # s: after a longer pause of the machine it goes on from where it was
_ROUNDING = 1e-9  # s: a time on the slider that is meant to be a sample's
_POINTS = 240  # of a curve
_PATH_COLOUR = (90, 90, 90)
_WEAK = re.compile(r"weak (\S+)")
_DASHES = ("", "5 2", "1.5 2")


class Moment(NamedTuple):
    """What a run has at a time.

    Attributes
    ----------
    sample :
        Its index.
    time :
        Of the sample, s.
    run, healthy :
        The run that is shown, and the one without a fault.
    faults :
        Joints that have failed by then.
    requested, kept, lost :
        Force that is asked for, at the tip, and missing there, N and N·m, in the task's axes,
        shape (m,); ``None`` where nothing holds the arm.
    loads :
        What each joint does: ``before`` is the healthy run's.
    verdict :
        Of this instant.
    """

    sample: int
    time: float
    run: Run
    healthy: Run
    faults: FaultSet
    requested: Vector
    kept: Vector | None
    lost: Vector | None
    loads: tuple[JointLoad, ...]
    verdict: Verdict


def playback(robot: Robot, state: State, path: str | os.PathLike[str]) -> Playback:
    """Return what plays a history that ``ftforce simulate`` wrote.

    Parameters
    ----------
    robot :
        The arm.
    state :
        The question with which the page starts; a history has faults of its own.
    path :
        The history.

    Raises
    ------
    TrajectoryError
        It cannot be read, or is of another arm.
    InputError
        The question has faults.
    """
    if state.faults.faults:
        raise InputError("a history has faults of its own; leave out --locked, --free and --weak")
    history = load_history(path)
    check_fits(robot, history, path)
    return Playback(robot, history)


def check_fits(robot: Robot, history: History, path: str | os.PathLike[str]) -> None:
    """Check that a history is of this arm.

    Raises
    ------
    TrajectoryError
        It is of another one; the message says what differs.
    """
    setting = history.setting
    theirs = [(joint.name, joint.unit) for joint in setting.joints]
    if theirs != [(joint.name, joint.unit) for joint in robot.joints]:
        names, own = (", ".join(map(printable, x)) for x in (dict(theirs), robot.names))
        raise TrajectoryError(path, f"is of another arm: its joints are {names}; here: {own}")
    if (setting.base, setting.tip) != (robot.base, robot.tip):
        there = f"--base {printable(setting.base)} --tip {printable(setting.tip)}"
        here = f"{printable(robot.base)} to {printable(robot.tip)}"
        raise TrajectoryError(path, f"is of another chain: {there}; here: {here}")


def faults_at(history: History, time: float) -> FaultSet:
    """Return the joints that have failed by a time, s."""
    told = [event.all_faults for event in history.setting.events if event.time <= time + _ROUNDING]
    if not told:
        return FaultSet()
    found, rest = [], told[-1]
    for i, joint in enumerate(history.setting.joints):  # a set is in the order of the joints
        start = f"{i + 1} {joint.name} "
        if rest.startswith(start):
            mode, _, rest = rest.removeprefix(start).partition(", ")
            found.append(_fault(i, mode))
    return FaultSet(tuple(found))


def _fault(joint: int, mode: str) -> Fault:
    weak = _WEAK.fullmatch(mode)
    return Fault(joint, FaultMode.WEAK, float(weak[1])) if weak else Fault(joint, FaultMode(mode))


def moment(history: History, name: str, time: float) -> Moment:
    """Return what a run has at a time.

    Parameters
    ----------
    history :
        The history.
    name :
        Of the run, one of `ftforce.history.RUNS`.
    time :
        In s; the last sample at or before it counts.
    """
    i, run = history.index(time + _ROUNDING), history.runs[name]
    at = float(history.t[i])
    faults = FaultSet() if name == "healthy" else faults_at(history, at)
    force, jump = run.force[i], run.jump[i]
    holds = not np.isnan(force).any()
    return Moment(
        i, at, run, history.healthy, faults, np.array(history.setting.force),
        force if holds else None, jump if holds else None, _loads(history, run, i, faults),
        run.verdicts[i],
    )  # fmt: skip


def _loads(history: History, run: Run, i: int, faults: FaultSet) -> tuple[JointLoad, ...]:
    by_joint = {fault.joint: fault for fault in faults.faults}
    rows = []
    for j, joint in enumerate(history.setting.joints):
        fault = by_joint.get(j)
        is_locked = fault is not None and fault.mode is FaultMode.LOCKED
        rows.append(
            JointLoad(
                number=j + 1,
                name=joint.name,
                unit=joint.torque_unit,
                fault=fault,
                before=float(history.healthy.motor[i, j]),
                after=float(run.motor[i, j]),
                part_before=float(run.force_part[i, j]),
                part_after=float(run.U[i, j]),
                brake=float(run.brake[i, j]) if is_locked else math.nan,
                limit=math.nan if is_locked else history.setting.effort[j],
                used=math.nan if is_locked else float(run.used[i, j]),
            )
        )
    return tuple(rows)


# ---- words -----------------------------------------------------------------------------------


def sentence(history: History, name: str, now: Moment) -> str:
    """Say what a run keeps at a time."""
    told = [event for event in history.setting.events if event.time <= now.time + _ROUNDING]
    faults = told[-1].all_faults if told else "every joint healthy"
    parts = [
        f"{now.time:.2f} s, {STROKES[name].words}, {faults}: {now.verdict}.",
        _kept(now, history),
    ]
    if name == "remapped" and told and now.time < told[-1].time + history.setting.delay - _ROUNDING:
        parts.append(f"The remap acts at {told[-1].time + history.setting.delay:g} s.")
    fall = now.run.falls_from
    if fall is not None and now.sample >= fall:
        parts.append(
            f"From {history.t[fall]:g} s on nothing holds the arm; where that takes it is not "
            "simulated."
        )
    return " ".join(parts)


def _kept(now: Moment, history: History) -> str:
    task = history.setting.task
    if now.kept is None or now.lost is None:
        return "Nothing holds the arm."
    if words.is_noticeable(now.lost):
        lost = words.amounts(task, now.lost)
        return f"{lost} of {words.amounts(task, now.requested)} are missing at the tip."
    if not now.requested.any():
        return "The arm carries its own weight."
    whole = words.amounts(task, now.requested)
    if words.is_noticeable(now.requested - now.kept):
        return f"It exerts what the healthy arm can of the {whole}."
    return f"The whole {whole} is exerted."


# ---- the scene -------------------------------------------------------------------------------


def history_scale(history: History, extent: float) -> float:
    """Return a length per N (N·m), m, at which the largest force of a history fits."""
    task, largest = history.setting.task, 0.0
    vectors = [np.array([history.setting.force])]
    vectors += [x for run in history.runs.values() for x in (run.force, run.jump)]
    for one in vectors:
        norms = np.linalg.norm(spatial(task, one), axis=1)
        largest = max(largest, float(norms[np.isfinite(norms)].max(initial=0.0)))
    return nice_scale(largest, extent)


def scene(robot: Robot, history: History, now: Moment, scale: float, see_through: bool) -> Picture:
    """Return what the scene shows at a time."""
    task = history.setting.task
    poses, (turn, place) = joint_poses(robot, now.run.q[now.sample])
    axes = turn if task.axes == "tool" else np.eye(3)
    nothing = np.zeros(task.m)
    forces = {
        "requested": spatial(task, now.requested),
        "kept": spatial(task, nothing if now.kept is None else now.kept),
        "lost": spatial(task, nothing if now.lost is None else now.lost),
    }
    return Picture(
        joints=poses,
        colours=joint_colours(robot, now.loads),
        tip=pose_of(axes, place),
        arrows=force_arrows(forces, (axes, place), scale, task.size_unit),
        lines=(),
        solids=(),
        scale=scale,
        unit=task.size_unit,
        notes=(f"arrows: 0.1 m is {words.size(0.1 / scale, 1)} {task.size_unit}",),
        see_through=see_through,
        can_pull=False,
    )


def ghost(robot: Robot, picture: Picture, q: Vector, offset: Vector) -> Picture:
    """Return the arm as if healthy, without any force.

    Parameters
    ----------
    robot :
        The arm.
    picture :
        Of the other arm.
    q :
        Joint positions, rad or m, shape (n,).
    offset :
        From the other arm's root to its own, m, shape (3,).
    """
    poses, _ = joint_poses(robot, q)
    none = tuple(arrow._replace(end=arrow.start, mark="") for arrow in picture.arrows)
    return replace(
        picture,
        joints=tuple(pose._replace(position=pose.position + offset) for pose in poses),
        colours=(NEUTRAL,) * len(poses),
        arrows=none,
        notes=(),
        see_through=True,
    )


# ---- curves ----------------------------------------------------------------------------------


def chosen(history: History) -> Vector:
    """Return the indices of samples that make a curve, the ends of each jump among them."""
    count = len(history.t)
    some = np.rint(np.linspace(0, count - 1, min(count, _POINTS))).astype(int)
    jumps = np.flatnonzero(np.diff(history.answer.verdict)).tolist()[:_POINTS]
    for event in history.setting.events:
        for time in (event.time, event.time + history.setting.delay):
            jumps.append(min(int(np.searchsorted(history.t, time)), count - 1) - 1)
    edges = np.array([i + k for i in jumps for k in (0, 1)], dtype=int)
    return np.unique(np.clip(np.concatenate([some, edges]), 0, count - 1))


def force_chart(history: History, run: Run) -> markup.Markup:
    """Return requested, kept and lost force over time."""
    task, at = history.setting.task, chosen(history)
    asked = np.tile(np.array(history.setting.force), (len(at), 1))
    vectors = {"requested": asked, "kept": run.force[at], "lost": run.jump[at]}
    curves = [
        markup.Curve(
            kind, np.linalg.norm(spatial(task, F), axis=1), markup.css(markup.ARROW_COLOURS[kind])
        )
        for kind, F in vectors.items()
    ]
    return markup.chart("Force at the tip", task.size_unit, history.t[at], curves, _marks(history))


def torque_chart(history: History, run: Run) -> markup.Markup:
    """Return each motor's share of its limit over time, or where no limit is known its torque."""
    at, setting = chosen(history), history.setting
    is_known = bool(np.isfinite(run.used).any())
    values = 100.0 * np.abs(run.used[at]) if is_known else run.motor[at]
    curves = [
        markup.Curve(
            f"{j + 1}", values[:, j], LINE_COLOURS[j % len(LINE_COLOURS)],
            _DASHES[j // len(LINE_COLOURS) % len(_DASHES)],
        )
        for j in range(len(setting.joints))
    ]  # fmt: skip
    unit = "% of its limit" if is_known else "N·m (N)"
    title = "Motor load by joint" if is_known else "Motor torque by joint"
    return markup.chart(title, unit, history.t[at], curves, _marks(history))


def _marks(history: History) -> tuple[float, ...]:
    end = float(history.t[-1])
    return tuple(event.time for event in history.setting.events if event.time <= end)


def _mark(history: History, time: float) -> str:
    """Return the numbers of the joints that fail at a time: a slider has room for no more."""
    before = faults_at(history, time - 2.0 * _ROUNDING).joints
    return ",".join(str(j + 1) for j in faults_at(history, time).joints if j not in before)


# ---- the mode --------------------------------------------------------------------------------


class _NoHands:
    """Of the healthy arm: touching it does nothing."""

    def pull(self, end: Vector, done: bool) -> None:
        """Do nothing."""

    def touch(self, joint: int) -> None:
        """Do nothing."""


class Playback:
    """Plays a history on the page: a `ftforce.view.session.Mode`.

    Parameters
    ----------
    robot :
        The arm.
    history :
        Of this arm.
    """

    takes_over = True

    def __init__(self, robot: Robot, history: History) -> None:
        self.robot, self.history = robot, history
        self.end = float(history.t[-1])
        self._names = {STROKES[name].words: name for name in reversed(history.runs)}
        if len(self._names) > 1 and history.setting.events:
            del self._names[STROKES["healthy"].words]  # it is beside the others anyway
        self._name = next(iter(self._names.values()))
        self._time, self._speed, self._place = 0.0, 1.0, PLACES[0]
        self._extent = scene_size(robot)
        self._scale = history_scale(history, self._extent)
        self._lock = threading.RLock()
        self._own = threading.local()
        self._playing, self._ends = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    # ---- what it is told ---------------------------------------------------------------------

    @property
    def time(self) -> float:
        """What is shown, s."""
        with self._lock:
            return self._time

    @property
    def run(self) -> str:
        """Name of the run that is shown, one of `ftforce.history.RUNS`."""
        with self._lock:
            return self._name

    @property
    def is_playing(self) -> bool:
        """Whether time goes on."""
        return self._playing.is_set()

    def seek(self, time: float) -> None:
        """Show another time, s."""
        with self._lock:
            self._time = min(max(time, 0.0), self.end)
        self._tell()

    def _tell(self) -> None:
        """Show the time that it is now, whoever set it."""
        self._own.writes = True  # viser calls callbacks of what it is told, too
        try:
            self._slider.value = min(round(self.time, 3), self._slider.max)
        finally:
            self._own.writes = False
        self._ask()

    def play(self) -> None:
        """Go on, or at the end from the start."""
        if self.time >= self.end:
            self.seek(0.0)
        self._playing.set()
        self._button.label = "Pause"

    def pause(self) -> None:
        """Stay at this time."""
        with self._lock:
            self._playing.clear()
        self._button.label = "Play"

    def choose(self, words_: str) -> None:
        """Show another run, named as on the page."""
        with self._lock:
            self._name = self._names[words_]
        self._draw_charts()
        self._ask()

    def _put(self, place: str) -> None:
        with self._lock:
            self._place = place
        self._ask()

    def _ask(self) -> None:
        """Have this time shown; the question is that of the history, for the controls."""
        self._session.change(self._as_played)

    def _as_played(self, state: State) -> State:
        # Under the session's lock: what time it is now, however late this runs.
        now = moment(self.history, self.run, self.time)
        return state.at(now.run.q[now.sample]).with_faults(now.faults)

    # ---- Mode --------------------------------------------------------------------------------

    def start(self, session: Session) -> None:
        """Begin, paused at the start."""
        self._session = session
        self._ghost = Stage(session.server, self.robot, _NoHands(), "/healthy", floor=False)
        with session.panel.first_tab("Time"):
            self._build(session.server.gui)
        session.panel.disable_all()
        self._draw_path()
        self._draw_charts()
        task, force = self.history.setting.task, np.array(self.history.setting.force)
        six = in_components(task.components, force)
        session.change(lambda s: s.asking(str(task), task.axes, task.length).pushing(six))
        self._ask()
        self._thread = threading.Thread(target=self._play, name="ftforce playback", daemon=True)
        self._thread.start()

    def view(self, state: State) -> View:
        """Return what is shown at this time."""
        with self._lock:
            name, time, place = self._name, self._time, self._place
        history = self.history
        now = moment(history, name, time)
        picture = scene(self.robot, history, now, self._scale, state.shown.see_through)
        self._show_ghost(picture, now, place)
        self._cursor.content = str(markup.cursor(now.time / self.end if self.end else 0.0))
        top = markup.verdict_banner(now.verdict, sentence(history, name, now), history.warnings)
        return View(picture, top, self._parts(now), self._legend(picture, name, place))

    def set_geometry(self, geometry: Geometry) -> None:
        """Show the healthy arm's links, and aim at the whole course."""
        with self._lock:
            self._ghost.set_geometry(geometry)
        picture = self._session.picture
        if picture is not None:
            places = self.history.runs[self.run].position[chosen(self.history)]
            way = (Line(np.array(ends), _PATH_COLOUR, "") for ends in pairwise(places))
            self._session.stage.look(replace(picture, lines=tuple(way)))

    def stop(self) -> None:
        """End the thread that plays."""
        self._ends.set()
        self._playing.set()  # it may wait
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(10.0)

    # ---- the thread --------------------------------------------------------------------------

    def _play(self) -> None:
        while not self._ends.is_set():
            self._playing.wait()
            last = clock.perf_counter()
            while self._playing.is_set() and not self._ends.wait(FRAME):
                now = clock.perf_counter()
                self._advance(min(now - last, _SLOWEST))
                last = now

    def _advance(self, seconds: float) -> None:
        with self._lock:
            if not self._playing.is_set():  # a hand was quicker
                return
            self._time = min(self._time + self._speed * seconds, self.end)
            is_over = self._time >= self.end
        self._tell()
        if is_over:
            self.pause()

    # ---- the page ----------------------------------------------------------------------------

    def _build(self, gui: Any) -> None:
        history, step = self.history, max(round(self.end / 1000.0, 3), 0.001)
        self._button = gui.add_button("Play")
        self._button.on_click(lambda _event: self.pause() if self.is_playing else self.play())
        marks = tuple((time, _mark(history, time)) for time in sorted({*_marks(history)}))
        self._slider = gui.add_slider(
            "Time (s)", 0.0, max(self.end, step), step, 0.0, marks=marks or None,
            hint="Faults are marked",
        )  # fmt: skip
        self._slider.on_update(lambda _event: self._slid())
        names = tuple(self._names)
        run = gui.add_dropdown("Run", names, initial_value=names[0])
        run.on_update(lambda _event: self.choose(run.value))
        speeds = tuple(f"{speed:g}×" for speed in SPEEDS)
        speed = gui.add_dropdown("Speed", speeds, initial_value="1×")
        speed.on_update(lambda _event: self._hasten(SPEEDS[speeds.index(speed.value)]))
        place = gui.add_dropdown("Healthy arm", PLACES, initial_value=self._place)
        place.on_update(lambda _event: self._put(place.value))
        self._charts = gui.add_html("")
        self._cursor = gui.add_html("")
        self.controls = {"play": self._button, "time": self._slider, "run": run, "speed": speed,
                         "place": place}  # fmt: skip

    def _slid(self) -> None:
        if not getattr(self._own, "writes", False):
            self.pause()
            self.seek(float(self._slider.value))

    def _hasten(self, speed: float) -> None:
        self._speed = speed

    def _draw_charts(self) -> None:
        run = self.history.runs[self.run]
        charts = force_chart(self.history, run), torque_chart(self.history, run)
        self._charts.content = str(markup.block(markup.style(), *charts, testid="charts"))

    def _draw_path(self) -> None:
        places = self.history.path[chosen(self.history)]
        if len(places) > 1:
            ends = np.array(list(pairwise(places)), dtype=np.float32)
            colours = np.full(ends.shape, _PATH_COLOUR[0], dtype=np.uint8)
            self._session.server.scene.add_line_segments(
                "/history/path", ends, colours, thickness=2.0, thickness_units="screen"
            )

    def _show_ghost(self, picture: Picture, now: Moment, place: str) -> None:
        is_shown = place != "hidden" and now.run is not now.healthy
        beside = np.array([0.0, 0.8 * self._extent, 0.0])
        offset = beside if place == "beside" else np.zeros(3)
        with self._session.server.atomic(), self._lock:  # in the order of the session
            if is_shown:
                self._ghost.update(ghost(self.robot, picture, now.healthy.q[now.sample], offset))
            else:
                self._ghost.hide()

    def _parts(self, now: Moment) -> markup.Markup:
        history, i = self.history, now.sample
        vectors = [("asked", now.requested), ("kept", now.kept), ("lost", now.lost)]
        off = now.run.path_error_norm[i]
        pairs = [
            ("Off path", "–" if math.isnan(off) else f"{1e3 * off:.2f} mm"),
            ("Margin", f"{words.ratio(float(now.run.margin[i]))} = σ_min(K)/σ_max(J)"),
        ]
        brakes = [load for load in now.loads if not math.isnan(load.brake)]
        if brakes:
            loads = (f"{x.name} {words.number(x.brake)} {x.unit}" for x in brakes)
            pairs.append(("Brake load", ", ".join(loads)))
        return markup.block(
            markup.load_table(now.loads, history.setting.has_masses, ("healthy", "now")),
            markup.vector_table(history.setting.task, vectors),
            markup.facts(pairs, "measures"),
            testid="answer",
        )

    def _legend(self, picture: Picture, name: str, place: str) -> markup.Markup:
        notes = ["grey line: the tip's path"]
        if place != "hidden" and name != "healthy":
            where = "at the same place" if place == "in place" else "beside it"
            notes.insert(
                0, f"transparent arm: as if healthy, {where}; solid: {STROKES[name].words}"
            )
        return markup.legend(picture, (*notes, *self._session.panel.notes))
