"""A sweep on the page: tip positions coloured by verdict; clicking one moves the arm there."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.friction import GIVEN, Friction
from ftforce.batch.store.store import open_sweep
from ftforce.batch.workspace_map import workspace_map
from ftforce.core.arrays import read_only
from ftforce.core.verdict import VERDICTS
from ftforce.errors import SweepError
from ftforce.report.text import percent
from ftforce.view.model.fitting import difference, displacement
from ftforce.view.model.state import in_components
from ftforce.view.modes import Mode
from ftforce.view.page import answer
from ftforce.view.scene.colours import interpolate
from ftforce.view.scene.picture import Line, scene_size
from ftforce.view.scene.stage import linear

if TYPE_CHECKING:
    import os

    from markupsafe import Markup
    from numpy.typing import NDArray

    from ftforce.batch.result import Sweep, SweepSetting
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot
    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.model.state import State
    from ftforce.view.modes import Host
    from ftforce.view.scene.colours import Colour

_MAX_POINTS = 20_000  # a browser without a GPU can still rotate this many
_EVERY = "every set"
# Matplotlib's cividis from 0 to 1, as in `ftforce map`: bright is good, dark is bad; readable
# with any kind of colour vision and in greyscale.
RAMP: tuple[Colour, ...] = (
    (0, 34, 78),
    (67, 78, 108),
    (125, 124, 120),
    (188, 174, 108),
    (254, 232, 56),
)
VERDICT_POINTS: tuple[Colour, ...] = (RAMP[4], RAMP[2], RAMP[0])  # in the order of `VERDICTS`
_SEED = 0  # always selects the same points
_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # where the ramp's colours are defined
_RADIUS = 0.007  # of a point, as a share of the size of the arm
_CELL_RADIUS = 0.35  # of a cell's marker, as a share of the cell's edge
_AIM_POINTS = 400  # enough points to aim the camera
_FORCE_DIGITS = 4
_SHOWN = ("all", *(verdict.value for verdict in VERDICTS), "none")

# An octahedron: eight triangles per point.
_CORNERS = np.array(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32
)
_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    dtype=np.uint32,
)


class Points(NamedTuple):
    """Postures of a sweep.

    Attributes
    ----------
    q :
        Joint positions, rad or m, shape (k, n).
    tip :
        Tip positions in root axes, m, shape (k, 3).
    verdict :
        Indices into `ftforce.core.verdict.VERDICTS`, one per selectable fault set, shape (k, s).
    worst :
        Index of the worst fault set of each posture, the first in case of ties, shape (k,).
    total :
        Number of completed postures in the sweep.
    """

    q: Matrix
    tip: Matrix
    verdict: NDArray[np.int8]
    worst: NDArray[np.int64]
    total: int


def survey(robot: Robot, state: State, path: str | os.PathLike[str]) -> Survey:
    """Return the view of a sweep stored by ``ftforce sweep``.

    Parameters
    ----------
    robot :
        The arm.
    state :
        Initial question of the page; its task and force are replaced by those of the sweep.
    path :
        Folder of the sweep.

    Raises
    ------
    SweepError
        There is no such sweep, it belongs to another arm, or it has no completed postures.
    """
    sweep = open_sweep(path)
    _check_fits(robot, sweep, path)
    if not sweep.done:
        raise SweepError(path, "has no finished postures yet; run its command again to resume it")
    found = Survey(robot, state, sweep)
    if found.points is not None:
        problem = displacement(robot, found.points.q[0], found.points.tip[0])
        if problem:
            raise SweepError(path, problem)
    return found


def _check_fits(robot: Robot, sweep: Sweep, path: str | os.PathLike[str]) -> None:
    """Check that a sweep belongs to this arm.

    Parameters
    ----------
    robot :
        The arm.
    sweep, path :
        The sweep, and its folder for the message.

    Raises
    ------
    SweepError
        It belongs to another arm; the message states the difference.
    """
    setting = sweep.setting
    if problem := difference(robot, setting, setting.joints, setting.joint_units):
        raise SweepError(path, problem)


def choices(sweep: Sweep) -> dict[str, tuple[int, ...] | None]:
    """Return the selectable fault sets: joint numbers from 1, by label.

    ``None`` stands for every set; it is the only choice if the sweep kept only the worst set of
    each posture.
    """
    found: dict[str, tuple[int, ...] | None] = {_EVERY: None}
    if sweep.setting.keep != "worst":
        for one in sweep.sets:
            found[str(one)] = tuple(joint + 1 for joint in one.joints)
    return found


def read_points(sweep: Sweep, count: int = _MAX_POINTS) -> Points | None:
    """Return postures of a sweep; ``None`` if it stored none.

    Parameters
    ----------
    sweep :
        The sweep.
    count :
        Maximum number of postures; if there are more, a random subset is returned.
    """
    if sweep.setting.keep == "summary":
        return None
    data = sweep.dataset
    name = "verdict" if sweep.setting.keep == "all" else "worst_verdict"
    tips = np.asarray(data["tip"].values)
    done = np.flatnonzero(np.isfinite(tips).all(axis=1))  # unfinished chunks hold NaN
    chosen = done
    if len(done) > count:
        chosen = np.sort(np.random.default_rng(_SEED).choice(done, count, replace=False))
    verdict = np.asarray(data[name].isel(posture=chosen).values).reshape(len(chosen), -1)
    q = np.asarray(data["q"].isel(posture=chosen).values)
    worst = verdict.argmax(axis=1)
    if name == "worst_verdict":
        worst = np.asarray(data["worst_set"].isel(posture=chosen).values)
    return Points(q, tips[chosen], verdict.astype(np.int8), worst.astype(np.int64), len(done))


def _friction(setting: SweepSetting) -> Friction | None:
    """Return the friction of a sweep's free-swinging joints; ``None`` if none swings."""
    if setting.friction is None:
        return None
    torque = [math.nan if x is None else x for x in setting.friction_torques]
    return Friction(read_only(np.array(torque)), (GIVEN,) * setting.n)


def _verdicts_of(points: Points, place: int | None) -> NDArray[np.int8]:
    """Return the verdict of each point for a fault set, shape (k,).

    Parameters
    ----------
    points :
        The points.
    place :
        Index of the fault set in the sweep; ``None`` for the worst of all sets.
    """
    found: NDArray[np.int8] = (
        points.verdict.max(axis=1) if place is None else points.verdict[:, place]
    )
    return found


def _verdict_colours(verdicts: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return the colours of verdicts, shape (k, 3)."""
    found: NDArray[np.uint8] = np.array(VERDICT_POINTS, dtype=np.uint8)[verdicts]
    return found


def share_colours(shares: Vector) -> NDArray[np.uint8]:
    """Return the colours of shares from 0 to 1, shape (k, 3)."""
    return interpolate(RAMP, shares)


class Survey(Mode):
    """A sweep on the page; a `ftforce.view.modes.Mode`.

    Parameters
    ----------
    robot :
        The arm.
    state :
        Initial question of the page.
    sweep :
        A sweep of this arm.
    """

    tab = "Sweep"

    def __init__(self, robot: Robot, state: State, sweep: Sweep) -> None:
        self.robot, self.sweep = robot, sweep
        self.points = read_points(sweep)
        self._choices = choices(sweep)
        self._chosen, self._shown = _EVERY, _SHOWN[0]
        self._question, self._is_same_question = state, True
        self._lock = threading.RLock()

    # ---- Mode --------------------------------------------------------------------------------

    def start(self, session: Host) -> None:
        """Show the points, and set the sweep's question."""
        self._session = session
        with session.panel.first_tab:
            self._build(session.server.gui)
        if self.points is None:
            self._nodes = self._add_cells(_EVERY)
        else:
            self._nodes = self._add_points(self.points)
            self._nodes.on_click(lambda event: self.move_to(event.instance_index))
        session.change(self._as_swept)
        self._question = session.state
        session.panel.set_initial(self._question)
        self._update_legend()

    def view(self, state: State) -> None:
        """Return ``None`` for the ordinary answer; the legend says if the question differs."""
        with self._lock:
            is_same = state.essence() == self._question.essence()
            if is_same != self._is_same_question:
                self._is_same_question = is_same
                self._update_legend()

    def set_geometry(self, geometry: Geometry) -> None:  # noqa: ARG002 # part of the interface
        """Aim the camera at all points; there is no second arm."""
        picture = self._session.picture
        if picture is not None:
            places = self._nodes.batched_positions
            few = places[:: 1 + len(places) // _AIM_POINTS]
            lines = tuple(Line(np.array([x, x], dtype=float), RAMP[0], "") for x in few)
            self._session.stage.aim(replace(picture, lines=lines))

    # ---- controls --------------------------------------------------------------------------------

    def move_to(self, point: int | None) -> None:
        """Move the arm to a point and apply the selected fault set.

        With "every set" selected, the worst set at that point is applied; if all sets are tolerated
        there, the faults are left unchanged.
        """
        points = self.points
        if points is None or point is None or not 0 <= point < len(points.q):
            return
        q, faults = points.q[point], self._faults()
        if faults is None and _verdicts_of(points, None)[point]:
            faults = self.sweep.sets[points.worst[point]]
        self._session.change(
            lambda state: state.at(q) if faults is None else state.at(q).with_faults(faults)
        )

    def choose(self, label: str) -> None:
        """Color the points by the verdict on a fault set, selected by its label on the page."""
        with self._lock:
            self._chosen = label
            if self.points is None:
                self._nodes.remove()
                self._nodes = self._add_cells(label)
            self._paint()
            self._update_legend()

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """Verdict of each point for the selected fault set, shape (k,)."""
        assert self.points is not None
        return _verdicts_of(self.points, self._place())

    def _place(self) -> int | None:
        joints = self._choices[self._chosen]
        return None if joints is None else self.sweep.index_of(joints)

    def _faults(self) -> Any:
        place = self._place()
        return None if place is None else self.sweep.sets[place]

    def _as_swept(self, state: State) -> State:
        """Return the sweep's question without limits, so that colours and verdict agree."""
        setting = self.sweep.setting
        question = replace(
            state.asking(setting.task, setting.axes, setting.length),
            rtol=setting.rtol,
            wary=setting.wary,
            is_limited=False,
            friction=_friction(setting),
            own_gravity=self._gravity(),
        )
        if setting.force is None:
            return question.loaded("every direction")
        return question.pushing(in_components(setting.components, np.array(setting.force)))

    def _gravity(self) -> Vector | None:
        own = read_only(np.array(self.sweep.setting.gravity, dtype=float))
        return None if np.array_equal(own, self.robot.model.gravity.linear) else own

    # ---- the page ----------------------------------------------------------------------------

    def _build(self, gui: Any) -> None:
        labels = tuple(self._choices)
        sets = gui.add_dropdown("Fault set", labels, initial_value=_EVERY)
        sets.on_update(lambda _event: self.choose(sets.value))
        kinds = _SHOWN if self.points is not None else (_SHOWN[0], _SHOWN[-1])
        shown = gui.add_dropdown("Show", kinds, initial_value=_SHOWN[0])
        shown.on_update(lambda _event: self._show(shown.value))
        self._legend = gui.add_html("")
        self.controls = {"sets": sets, "shown": shown}

    def _show(self, kind: str) -> None:
        with self._lock:
            self._shown = kind
            self._paint()

    def _paint(self) -> None:
        """Color the points and show those with the selected verdict."""
        self._nodes.visible = self._shown != _SHOWN[-1]
        if self.points is None:
            return
        verdicts = self.verdicts
        self._nodes.batched_colors = linear(_verdict_colours(verdicts))
        wanted = np.ones(len(verdicts), dtype=np.float32)  # points of zero size cannot be clicked
        if self._shown in _SHOWN[1:-1]:
            wanted *= verdicts == _SHOWN.index(self._shown) - 1
        self._nodes.batched_scales = wanted

    def _add_points(self, points: Points) -> Any:
        radius = _RADIUS * scene_size(self.robot)
        return self._add("/sweep/points", radius, points.tip, _verdict_colours(self.verdicts))

    def _add_cells(self, label: str) -> Any:
        located = workspace_map(self.sweep, self._choices[label]).located
        colours = share_colours(located.cells.share)
        return self._add("/sweep/cells", _CELL_RADIUS * located.edge, located.place, colours)

    def _add(self, name: str, radius: float, places: Matrix, colours: NDArray[np.uint8]) -> Any:
        return self._session.server.scene.add_batched_meshes_simple(
            name,
            radius * _CORNERS,
            _FACES,
            np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1)),
            places,
            batched_colors=linear(colours),
            batched_scales=np.ones(len(places), dtype=np.float32),
            lod="off",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
        )

    def part(self) -> Markup:
        """Return the legend of the point colours."""
        return self._cells_legend() if self.points is None else self._points_legend(self.points)

    def _update_legend(self) -> None:
        self._legend.content = str(self.part())

    def _points_legend(self, points: Points) -> Markup:
        verdicts, shown = self.verdicts, len(points.q)
        counts = np.bincount(verdicts, minlength=len(VERDICTS)).tolist()
        pairs = [
            (VERDICT_POINTS[i], f"{verdict}: {counts[i]:,} ({percent(counts[i] / shown)})")
            for i, verdict in enumerate(VERDICTS)
        ]
        number = f"{shown:,} points"
        if shown < points.total:
            number += f", a random subset of {points.total:,} postures"
        faults = ", with the fault set that is worst there" if self._chosen == _EVERY else ""
        notes = [f"{number}. Click a point to move the arm to its posture{faults}."]
        if self.sweep.setting.keep == "worst":
            notes.append("The sweep stored only the worst fault set of each posture.")
        return answer.keys(pairs, [*notes, *self._notes()], "sweep")

    def _cells_legend(self) -> Markup:
        labels = (f"tolerated in {share:.0%} of the postures" for share in _SHARES)
        pairs = list(zip(reversed(RAMP), labels, strict=True))
        note = (
            "Cell centres, coloured by the share of postures. The sweep stored only its summary, "
            "so a click cannot move the arm (this needs a sweep with --keep all or worst)."
        )
        return answer.keys(pairs, [note, *self._notes()], "sweep")

    def _notes(self) -> list[str]:
        setting, what = self.sweep.setting, self._chosen
        share = self.sweep.every_set.value
        if (place := self._place()) is not None:
            counts = self.sweep.summary.verdicts[place]
            share = float(counts[0] / counts.sum())
        force = "every direction of force"
        if setting.force is not None:
            values = ", ".join(f"{x:.{_FORCE_DIGITS}g}" for x in setting.force)
            force = f"force ({values}) in {setting.axes} axes"
        agrees = "as on this page"
        if not self._is_same_question:
            agrees = "unlike on this page (Reset restores them)"
        total = f"tolerated in {percent(share)} of all {self.sweep.done:,} postures"
        payload = f"The sweep had a payload, {setting.payload}; set it in the Force tab."
        return [
            f"Fault set: {what}, {setting.mode}: {total}.",
            f"Settings of the sweep: task {setting.task}, {force}; {agrees}.",
            *([payload] if setting.payload else []),
            *(f"Warning: {warning}." for warning in self.sweep.warnings),
        ]
