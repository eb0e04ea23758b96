"""The controls of the page, shared by all its tabs, and the answer beside them.

Callbacks run in viser's threads, many at a time and in any order. So they read what their control
says now, change the newest question with it, and leave the answer to the session's one worker.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ftforce.dynamics import Payload
from ftforce.faults import FaultMode
from ftforce.posture import choose_posture
from ftforce.robot import BUILT_IN_POSTURES
from ftforce.task import AXES
from ftforce.view.arrow_nodes import assign
from ftforce.view.colours import VERDICT_COLOURS
from ftforce.view.controls import Control, shortened, slider_range, slider_step, slider_value
from ftforce.view.markup import (
    answer_part,
    banner,
    census_part,
    command_part,
    legend,
    problem_banner,
    set_label,
)
from ftforce.view.state import (
    LOADS,
    MODES,
    SOLIDS,
    State,
    command_line,
    meant_position,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import viser

    from ftforce.faults import FaultSet
    from ftforce.robot import Joint, Robot
    from ftforce.view.answer import Answer
    from ftforce.view.picture import Picture

ANSWER_WIDTH, CONTROL_WIDTH = 350, 385  # px
_TASKS = ("force", "moment", "wrench", "fx,fy", "fx,fz", "fy,fz", "fx", "fy", "fz")
_CENSUS = ("none", "single faults", "single and double faults")
_BUTTONS = 8  # fault sets that have a button of their own, the worst
_CHOOSE = "choose …"
_HEAVIEST = 1000.0  # kg
_DIGITS = 4  # after the point of what is typed


class Actions(Protocol):
    """What the controls do."""

    def change(self, change: Callable[[State], State]) -> None:
        """Change the newest question, and have it answered."""

    def save_picture(self, client: Any) -> None:
        """Give a tab the scene as a PNG."""

    def save_page(self, client: Any) -> None:
        """Give a tab the page as a file that needs no server."""


class Panel:
    """Controls to the right, the answer to the left.

    Parameters
    ----------
    server :
        The viser server.
    robot :
        The arm.
    state :
        The question with which the page starts.
    actions :
        What the controls do.
    is_played :
        Whether posture, faults and load are a `Mode`'s: then controls show the first two, and
        there is no question to be changed.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        robot: Robot,
        state: State,
        actions: Actions,
        *,
        is_played: bool = False,
    ) -> None:
        self.robot = robot
        self.notes: tuple[str, ...] = ()  # on the arm's meshes
        self._gui: Any = server.gui
        self._actions = actions
        self._start = state
        self._is_played = is_played
        self._own = threading.local()  # whether this thread is writing what the question says
        self._controls: dict[str, Control] = {}
        self._labels: tuple[str, ...] = ()
        self._sets: tuple[FaultSet, ...] = ()
        self._build_answer()
        self._build_controls(state)

    # ---- building ----------------------------------------------------------------------------

    def _build_answer(self) -> None:
        panel = self._gui.add_panel()
        with panel.add_tab("Answer"):
            self._banner = self._gui.add_html("")
            self._answer = self._gui.add_html("")
            self._legend = self._gui.add_html("")
        panel.dock_left()
        panel.set_width(ANSWER_WIDTH)

    def _build_controls(self, state: State) -> None:
        gui = self._gui
        self.tabs = gui.add_tab_group()
        with self.tabs.add_tab("Arm"):
            if self._is_played:
                self._build_look(state)
            self._build_arm(state)
        if not self._is_played:
            with self.tabs.add_tab("Force"):
                self._build_force(state)
            with self.tabs.add_tab("Census"):
                self._build_census(state)
        with self.tabs.add_tab("Take along"):
            if not self._is_played:
                self._command = gui.add_html("")
            self._button("save_picture", "Save picture", self._actions.save_picture)
            self._button("save_page", "Save page", self._actions.save_page)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(CONTROL_WIDTH)

    def _build_arm(self, state: State) -> None:
        gui, robot = self._gui, self.robot
        names = [*robot.postures, *(x for x in BUILT_IN_POSTURES if x not in robot.postures)]
        posture = gui.add_dropdown(
            "Posture", (_CHOOSE, *names), initial_value=_CHOOSE,
            hint=f"At the start: {state.posture.source}",
        )  # fmt: skip
        self._control("posture", posture, _CHOOSE, self._choose_posture)
        self._button("reset", "Reset", lambda _client: self._reset())
        for i, joint in enumerate(robot.joints):
            self._build_slider(i, joint, state)
        for i, joint in enumerate(robot.joints):
            self._build_fault(i, joint, state)
        if self._is_played:
            for name, control in self._controls.items():
                control.handle.disabled = name != "see_through"

    def _build_slider(self, i: int, joint: Joint, state: State) -> None:
        low, high = slider_range(joint)
        value = slider_value(joint, float(state.q[i]))
        unit = "m" if joint.unit == "m" else "degrees"
        slider = self._gui.add_slider(
            f"{joint.number} {shortened(joint.name)}", low, high, slider_step(joint), value,
            hint=f"{joint.name}, {joint.type}, {unit}",
        )  # fmt: skip

        def move(value: float) -> Callable[[State], State]:
            position = min(max(meant_position(joint.unit, value), joint.lower), joint.upper)
            return lambda state: state.with_joint(i, position)

        self._control(f"q{i}", slider, value, move)

    def _build_fault(self, i: int, joint: Joint, state: State) -> None:
        mode = self._gui.add_dropdown(
            f"Fault {joint.number}", MODES, initial_value=state.modes[i],
            hint=f"How {joint.name} fails",
        )  # fmt: skip
        self._control(f"mode{i}", mode, state.modes[i], lambda x: lambda s: s.failing(i, x))
        factor = self._gui.add_slider(
            f"Torque {joint.number} (%)", 0.0, 100.0, 0.1, _percent(state.factors[i]),
            visible=state.modes[i] == FaultMode.WEAK,
            hint=f"Share of its largest torque that {joint.name} can still give",
        )  # fmt: skip

        def weaken(percent: float) -> Callable[[State], State]:
            return lambda s: s.failing(i, FaultMode.WEAK.value, percent / 100.0)

        self._control(f"factor{i}", factor, _percent(state.factors[i]), weaken)

    def _build_force(self, state: State) -> None:
        gui, task = self._gui, state.task
        loads = tuple(x for x in LOADS if x != "torques" or state.torque is not None)
        self._control(
            "load",
            gui.add_dropdown("Load", loads, initial_value=state.load,
                             hint="A force at the tip, or what becomes of every direction"),
            state.load, lambda x: lambda s: s.loaded(x),
        )  # fmt: skip
        for key, label, rows in (("force", "Force (N)", slice(0, 3)), ("moment", "Moment (N·m)",
                                                                       slice(3, 6))):  # fmt: skip
            vector = gui.add_vector3(
                label, tuple(state.wrench[rows].tolist()), step=1.0,
                hint="Of the robot on its environment, x, y, z in the task's axes; or drag the "
                "handle at the tip of the blue arrow",
            )  # fmt: skip
            vector.precision = _DIGITS  # viser takes the step's, and lets nobody type more
            value = tuple(state.wrench[rows].tolist())
            self._control(key, vector, value, _pusher(rows))
        tasks = _TASKS if str(task) in _TASKS else (str(task), *_TASKS)
        self._control(
            "task", gui.add_dropdown("Task", tasks, initial_value=str(task),
                                     hint="Components of force and moment that count"),
            str(task), lambda x: lambda s: s.asking(x, s.task.axes),
        )  # fmt: skip
        self._control(
            "axes", gui.add_dropdown("Axes", AXES, initial_value=task.axes,
                                     hint="tool: of the tip; world: of the root, at the tip"),
            task.axes, lambda x: lambda s: s.asking(str(s.task), x),
        )  # fmt: skip
        length = gui.add_number(
            "Length L (m)", task.length, step=0.01, hint="Weighs moments against forces"
        )
        length.precision = _DIGITS
        self._control(
            "length", length,
            task.length, lambda x: lambda s: s.asking(str(s.task), s.task.axes, x),
        )  # fmt: skip
        self._build_conditions(state)
        self._build_shown(state)

    def _build_conditions(self, state: State) -> None:
        gui = self._gui
        self._control(
            "limits", gui.add_checkbox("Torque limits count", state.counts_limits,
                                       hint=f"Limits: {state.limits.source}"),
            state.counts_limits, lambda x: lambda s: s.limited(x),
        )  # fmt: skip
        self._control(
            "gravity", gui.add_checkbox("Gravity", state.weighs),
            state.weighs, lambda x: lambda s: s.weighing(x),
        )  # fmt: skip
        mass = 0.0 if state.payload is None else state.payload.mass
        payload = gui.add_number(
            "Payload (kg)", mass, min=0.0, max=max(_HEAVIEST, mass), step=0.1, hint="At the tip"
        )
        payload.precision = _DIGITS
        self._control(
            "payload", payload,
            mass, lambda x: lambda s: s.carrying(_payload(s, x)),
        )  # fmt: skip

    def _build_shown(self, state: State) -> None:
        gui, shown = self._gui, state.shown
        self._control(
            "solid", gui.add_dropdown("Forces as", SOLIDS, initial_value=shown.solid,
                                      hint="All forces before and after the fault; a polytope "
                                      "needs known limits"),
            shown.solid, lambda x: lambda s: s.showing(solid=x),
        )  # fmt: skip
        self._control(
            "weakest", gui.add_checkbox("Weakest direction", shown.weakest),
            shown.weakest, lambda x: lambda s: s.showing(weakest=x),
        )  # fmt: skip
        self._build_look(state)

    def _build_look(self, state: State) -> None:
        see_through = state.shown.see_through
        self._control(
            "see_through", self._gui.add_checkbox("See through the arm", see_through),
            see_through, lambda x: lambda s: s.showing(see_through=x),
        )  # fmt: skip

    def _build_census(self, state: State) -> None:
        gui, shown = self._gui, state.shown
        self._control(
            "census", gui.add_dropdown("Census of", _CENSUS, initial_value=_CENSUS[shown.census]),
            _CENSUS[shown.census], lambda x: lambda s: s.showing(census=_CENSUS.index(x)),
        )  # fmt: skip
        modes = (FaultMode.LOCKED.value, FaultMode.FREE.value)
        self._control(
            "census_mode", gui.add_dropdown("Joints are", modes, initial_value=modes[0]),
            shown.census_mode.value, lambda x: lambda s: s.showing(census_mode=FaultMode(x)),
        )  # fmt: skip
        self._all_sets = gui.add_dropdown(
            "Show a set", (_CHOOSE,), initial_value=_CHOOSE, hint="All fault sets, worst first"
        )
        self._chosen_set = Control(self._all_sets, _CHOOSE)
        self._all_sets.on_update(lambda _event: self._choose_set())
        self._buttons = [gui.add_button(_CHOOSE, visible=False) for _ in range(_BUTTONS)]
        for k, button in enumerate(self._buttons):
            button.on_click(lambda _event, k=k: self._show_set(k))
        self._census = gui.add_html("")

    def _control(
        self, name: str, handle: Any, value: Any, meaning: Callable[[Any], Callable[[State], State]]
    ) -> None:
        """Take a control into the panel; ``meaning`` makes a change of the question of its value.

        Its hand on the page and the session's worker write it; who writes says so, and what the
        question already says is nobody's wish.
        """
        control = self._controls[name] = Control(handle, value)

        def update(_event: Any) -> None:
            if getattr(self._own, "writes", False):
                return

            def change(state: State) -> State:
                # Under the session's lock: what the control says now, however late this runs.
                control.value = handle.value
                return meaning(handle.value)(state)

            self._actions.change(change)

        handle.on_update(update)

    def _button(self, name: str, label: str, act: Callable[[Any], None]) -> None:
        handle = self._gui.add_button(label)
        handle.on_click(lambda event: act(event.client))
        self._controls[name] = Control(handle, None)

    # ---- what controls mean ------------------------------------------------------------------

    def handle(self, name: str) -> Any:
        """Return viser's handle of a control: ``q0``, ``mode0``, ``force``, ``limits``, ….

        Setting its value does what a hand on the page does.
        """
        return self._controls[name].handle

    def _choose_posture(self, name: str) -> Callable[[State], State]:
        if name == _CHOOSE:
            return lambda state: state
        return lambda state: state.in_posture(choose_posture(self.robot, None, name))

    def begin_with(self, state: State) -> None:
        """Let Reset go back to another question: for a `Mode` that asks one."""
        self._start = state

    def _reset(self) -> None:
        """Go back to the question with which the page started; what is shown stays."""
        start = self._start
        self._actions.change(lambda state: start.showing(**state.shown._asdict()))

    def _choose_set(self) -> None:
        if getattr(self._own, "writes", False):
            return
        value = self._chosen_set.value = self._all_sets.value
        if value in self._labels:
            self._show_set(self._labels.index(value))

    def _show_set(self, k: int) -> None:
        sets = self._sets
        if k < len(sets):
            self._actions.change(lambda state: state.with_faults(sets[k]))

    # ---- writing -----------------------------------------------------------------------------

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Write controls without acting on it: viser calls callbacks of what it is told, too."""
        self._own.writes = True
        try:
            yield
        finally:
            self._own.writes = False

    def sync(self, state: State) -> None:
        """Let the controls show a question; the session's lock is held."""
        shown, task = state.shown, state.task
        values: dict[str, Any] = {
            "posture": self._posture_name(state),
            "load": state.load,
            "force": tuple(state.wrench[:3].tolist()),
            "moment": tuple(state.wrench[3:].tolist()),
            "task": str(task),
            "axes": task.axes,
            "length": task.length,
            "limits": state.counts_limits,
            "gravity": state.weighs,
            "payload": 0.0 if state.payload is None else state.payload.mass,
            "solid": shown.solid,
            "weakest": shown.weakest,
            "see_through": shown.see_through,
            "census": _CENSUS[shown.census],
            "census_mode": shown.census_mode.value,
        }
        for i, joint in enumerate(self.robot.joints):
            values[f"q{i}"] = slider_value(joint, float(state.q[i]))
            values[f"mode{i}"] = state.modes[i]
            values[f"factor{i}"] = _percent(state.factors[i])
        with self._writing():
            self._offer_task(str(task))
            for name, value in values.items():
                if name in self._controls:
                    self._controls[name].tell(value)
            for i, mode in enumerate(state.modes):
                _show(self._controls[f"factor{i}"].handle, mode == FaultMode.WEAK)
            for name in {"moment", "length"} & self._controls.keys():
                _show(self._controls[name].handle, bool(task.moment_rows))

    def _offer_task(self, task: str) -> None:
        """Let the task be one that can be chosen: a mode may have another than the usual ones."""
        if "task" in self._controls:
            handle = self._controls["task"].handle
            if task not in handle.options:
                handle.options = (task, *_TASKS)
                self._controls["task"].value = handle.value  # viser chooses when it is replaced

    def _posture_name(self, state: State) -> str:
        name = state.posture.source.removeprefix("posture '").removesuffix("'")
        return name if name in self._controls["posture"].handle.options else _CHOOSE

    def first_tab(self, label: str) -> Any:
        """Add a tab before the others, so that the page opens with it: for a `Mode`."""
        tab = self.tabs.add_tab(label)
        handles = self.tabs._tab_handles  # viser opens the first, and adds last
        handles.insert(0, handles.pop())
        self.tabs._rebuild_tab_props()
        return tab

    def show(self, answer: Answer, picture: Picture) -> None:
        """Show an answer."""
        _write(self._banner, banner(answer))
        _write(self._answer, answer_part(answer))
        _write(self._legend, legend(picture, self.notes))
        if self._is_played:
            return
        command = command_line(self.robot, answer.state)
        _write(self._command, command_part(command, answer.state.origin.note))
        _write(self._census, census_part(answer.census, answer.analysis.faults.joints))
        self._show_sets(answer)

    def show_problem(self, problem: str) -> None:
        """Show why there is no answer; the last one stays below."""
        _write(self._banner, problem_banner(problem))

    def static_parts(self) -> str:
        """Return the answer's HTML as it stands on the page."""
        parts = (self._banner, self._answer, self._legend)
        return "".join(part.content for part in parts)

    def show_parts(self, top: str, parts: str, below: str = "") -> None:
        """Show HTML of `ftforce.view.markup` instead of an answer: for a `Mode`."""
        _write(self._banner, top)
        _write(self._answer, parts)
        _write(self._legend, below)

    def _show_sets(self, answer: Answer) -> None:
        reports = () if answer.census is None else answer.census.sets
        labels = tuple(set_label(report) for report in reports)
        self._sets = tuple(report.faults for report in reports)
        shown = answer.analysis.faults
        chosen = next(
            (label for label, faults in zip(labels, self._sets, strict=True) if faults == shown),
            _CHOOSE,
        )
        with self._writing():
            if labels != self._labels:
                self._labels = labels
                self._all_sets.options = (_CHOOSE, *labels)
                self._chosen_set.value = self._all_sets.value  # viser chooses, if need be
            self._chosen_set.tell(chosen)
        for k, button in enumerate(self._buttons):
            _show(button, k < len(labels))
            if k < len(labels):
                assign(button, "label", labels[k])
                assign(button, "color", VERDICT_COLOURS[reports[k].verdict])


def _pusher(rows: slice) -> Callable[[Any], Callable[[State], State]]:
    def push(value: Any) -> Callable[[State], State]:
        def change(state: State) -> State:
            wrench = state.wrench.copy()
            wrench[rows] = value
            return state.pushing(wrench)

        return change

    return push


def _payload(state: State, mass: float) -> Payload | None:
    offset = np.zeros(3) if state.payload is None else state.payload.offset
    return Payload.of(mass, offset) if mass > 0.0 else None


def _percent(factor: float) -> float:
    return round(100.0 * factor, 6)


def _show(handle: Any, is_visible: bool) -> None:
    assign(handle, "visible", is_visible)


def _write(handle: Any, content: str) -> None:
    assign(handle, "content", str(content))  # viser knows plain strings only
