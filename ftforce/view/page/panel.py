"""The controls, shared by all tabs of the page, and the answer beside them.

Callbacks run concurrently in viser's threads, in any order. They therefore read the current value
of their control, change the current question accordingly, and leave the answer to the session's
single worker.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from markupsafe import Markup

from ftforce.core.faults import FaultMode
from ftforce.core.task import AXES
from ftforce.robot.dynamics import Payload
from ftforce.robot.posture import choose_posture
from ftforce.robot.robot import BUILT_IN_POSTURES
from ftforce.view.model.state import LOADS, MODES, SOLIDS, State, command_line, meant_position
from ftforce.view.page.answer import (
    answer_part,
    banner,
    census_part,
    command_part,
    legend,
    open_banner,
    problem_banner,
    set_label,
)
from ftforce.view.page.controls import Control, shortened, slider_range, slider_step, slider_value
from ftforce.view.scene.arrow_nodes import assign
from ftforce.view.scene.colours import VERDICT_COLOURS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import viser

    from ftforce.core.faults import FaultSet
    from ftforce.robot.robot import Joint, Robot
    from ftforce.view.model.answer import Answer
    from ftforce.view.model.controller import Controller
    from ftforce.view.scene.picture import Picture

    Change: TypeAlias = Callable[[State, Any], State]
    """Function that applies the value of a control to a question."""

_ANSWER_WIDTH, _CONTROL_WIDTH = 350, 385  # px
_TASKS = ("force", "moment", "wrench", "fx,fy", "fx,fz", "fy,fz", "fx", "fy", "fz")
_CENSUS = ("none", "single faults", "single and double faults")
_BUTTONS = 8  # number of buttons for the worst fault sets
_SELECT = "select …"
_MAX_PAYLOAD = 1000.0  # kg
_DIGITS = 4  # decimals of number inputs


class Panel:
    """The control panel on the right and the answer panel on the left.

    Parameters
    ----------
    server :
        The viser server.
    robot :
        The arm.
    state :
        Initial question.
    session :
        Controller that carries out user actions.
    first_tab :
        Label of a `Mode`'s own tab; empty for none.
    is_played :
        Whether a `Mode` determines posture, faults and load; the controls then only display
        posture and faults, and the question cannot be changed.

    Attributes
    ----------
    first_tab :
        The `Mode`'s tab, selected when the page opens; ``None`` if there is none.
    notes :
        Notes on the arm's meshes.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        robot: Robot,
        state: State,
        session: Controller,
        *,
        first_tab: str = "",
        is_played: bool = False,
    ) -> None:
        self.robot = robot
        self.notes: tuple[str, ...] = ()
        self._gui: Any = server.gui
        self._session = session
        self._start = state
        self._is_played = is_played
        self._thread = threading.local()  # whether this thread is writing control values
        self._controls: dict[str, Control] = {}
        self._labels: tuple[str, ...] = ()
        self._sets: tuple[FaultSet, ...] = ()
        others = (name for name in BUILT_IN_POSTURES if name not in robot.postures)
        self._postures = (_SELECT, *robot.postures, *others)
        self._initial = self._values(state)
        self._build_answer()
        self._build_controls(state, first_tab)

    # ---- layout ----------------------------------------------------------------------------------

    def _build_answer(self) -> None:
        panel = self._gui.add_panel()
        self._top = Markup()
        with panel.add_tab("Answer"):
            self._banner = self._gui.add_html("")
            self._answer = self._gui.add_html("")
            self._legend = self._gui.add_html("")
        panel.dock_left()
        panel.set_width(_ANSWER_WIDTH)

    def _build_controls(self, state: State, first_tab: str) -> None:
        gui = self._gui
        tabs = gui.add_tab_group()  # the first tab is the active one
        self.first_tab: Any = tabs.add_tab(first_tab) if first_tab else None
        with tabs.add_tab("Arm"):
            if self._is_played:
                self._build_display()
            self._build_arm(state)
        if not self._is_played:
            with tabs.add_tab("Force"):
                self._build_force(state)
            with tabs.add_tab("Census"):
                self._build_census()
        with tabs.add_tab("Export"):
            if not self._is_played:
                self._command = gui.add_html("")
            self._button("save_picture", "Save image", self._session.save_picture)
            self._button("save_page", "Save page", self._session.save_page)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_CONTROL_WIDTH)

    def _build_arm(self, state: State) -> None:
        hint = f"Initially: {state.posture.source}"
        self._choice("posture", "Posture", self._postures, self._in_posture, hint)
        self._button("reset", "Reset", lambda _client: self._reset())
        for i, joint in enumerate(self.robot.joints):
            self._build_slider(i, joint)
        for i, joint in enumerate(self.robot.joints):
            self._build_fault(i, joint)
        if self._is_played:
            for name, control in self._controls.items():
                control.handle.disabled = name != "see_through"

    def _build_slider(self, i: int, joint: Joint) -> None:
        low, high = slider_range(joint)
        unit = "m" if joint.unit == "m" else "degrees"

        def move(state: State, value: float) -> State:
            position = meant_position(joint.unit, value)
            return state.with_joint(i, min(max(position, joint.lower), joint.upper))

        slider = self._gui.add_slider(
            f"{joint.number} {shortened(joint.name)}",
            low,
            high,
            slider_step(joint),
            self._initial[f"q{i}"],
            hint=f"{joint.name}, {joint.type}, {unit}",
        )
        self._control(f"q{i}", slider, move)

    def _build_fault(self, i: int, joint: Joint) -> None:
        def fail(state: State, mode: str) -> State:
            return state.failing(i, mode)

        def weaken(state: State, percent: float) -> State:
            return state.failing(i, FaultMode.WEAK.value, percent / 100.0)

        self._choice(
            f"mode{i}", f"Fault {joint.number}", MODES, fail, f"Fault mode of {joint.name}"
        )
        factor = self._gui.add_slider(
            f"Torque {joint.number} (%)",
            0.0,
            100.0,
            0.1,
            self._initial[f"factor{i}"],
            visible=self._initial[f"mode{i}"] == FaultMode.WEAK,
            hint=f"Remaining share of the torque limit of {joint.name}",
        )
        self._control(f"factor{i}", factor, weaken)

    def _build_force(self, state: State) -> None:
        loads = tuple(x for x in LOADS if x != "torques" or state.torque is not None)
        hint = "A load at the tip, or 1 N (N·m) along each axis"
        self._choice("load", "Load", loads, State.loaded, hint)
        self._vector("force", "Force (N)", slice(0, 3))
        self._vector("moment", "Moment (N·m)", slice(3, 6))
        hint = "Components of force and moment to be exerted"
        self._choice("task", "Task", _tasks(str(state.task)), _set_task, hint)
        self._choice(
            "axes", "Axes", AXES, _set_axes, "tool: axes of the tip; world: axes of the root"
        )
        self._number("length", "Length L (m)", _set_length, 0.01, "Scales moments to forces")
        hint = f"Torque limits: {state.limits.source}"
        self._checkbox("limits", "Enforce torque limits", State.limited, hint)
        self._checkbox("gravity", "Gravity", State.weighing)
        maximum = max(_MAX_PAYLOAD, self._initial["payload"])
        self._number(
            "payload", "Payload (kg)", _set_payload, 0.1, "At the tip", min=0.0, max=maximum
        )
        hint = "Coulomb and viscous friction of the moving joints, from the robot or limits file"
        self._checkbox("joint_friction", "Joint friction", State.rubbing, hint)
        hint = "Reflected inertia of the motors' rotors, from the robot or limits file"
        self._checkbox("armature", "Rotor inertia", State.with_rotors, hint)
        hint = "Forces that can be exerted before and after the fault; a polytope needs limits"
        self._choice("solid", "Force set", SOLIDS, _option("solid"), hint)
        self._checkbox("weakest", "Weakest direction", _option("weakest"))
        self._build_display()

    def _build_display(self) -> None:
        self._checkbox("see_through", "Transparent arm", _option("see_through"))

    def _build_census(self) -> None:
        gui, modes = self._gui, (FaultMode.LOCKED.value, FaultMode.FREE.value)
        self._choice("census", "Census of", _CENSUS, _option("census", _CENSUS.index))
        self._choice("census_mode", "Fault mode", modes, _option("census_mode", FaultMode))
        self._all_sets = gui.add_dropdown(
            "Fault set", (_SELECT,), initial_value=_SELECT, hint="All fault sets, worst first"
        )
        self._chosen_set = Control(self._all_sets)
        self._all_sets.on_update(lambda _event: self._choose_set())
        self._buttons = [gui.add_button(_SELECT, visible=False) for _ in range(_BUTTONS)]
        for k, button in enumerate(self._buttons):
            button.on_click(lambda _event, k=k: self._show_set(k))
        self._census = gui.add_html("")

    # ---- control types ---------------------------------------------------------------------------

    def _choice(
        self,
        name: str,
        label: str,
        options: Sequence[str],
        apply: Change,
        hint: str | None = None,
    ) -> None:
        first = self._initial[name]
        handle = self._gui.add_dropdown(label, tuple(options), initial_value=first, hint=hint)
        self._control(name, handle, apply)

    def _checkbox(self, name: str, label: str, apply: Change, hint: str | None = None) -> None:
        handle = self._gui.add_checkbox(label, self._initial[name], hint=hint)
        self._control(name, handle, apply)

    def _number(
        self, name: str, label: str, apply: Change, step: float, hint: str, **ends: float
    ) -> None:
        handle = self._gui.add_number(label, self._initial[name], step=step, hint=hint, **ends)
        handle.precision = _DIGITS  # by default, viser derives it from the step
        self._control(name, handle, apply)

    def _vector(self, name: str, label: str, rows: slice) -> None:
        def set_load(state: State, value: tuple[float, float, float]) -> State:
            wrench = state.wrench.copy()
            wrench[rows] = value
            return state.pushing(wrench)

        handle = self._gui.add_vector3(
            label,
            self._initial[name],
            step=1.0,
            hint="Exerted by the robot on its environment, x, y, z in task axes; also set by "
            "dragging the handle at the tip of the blue arrow",
        )
        handle.precision = _DIGITS
        self._control(name, handle, set_load)

    def _control(self, name: str, handle: Any, apply: Change) -> None:
        """Register a control; ``apply`` changes a question according to its value.

        Controls are written by users and by the session's worker; `writing` marks the latter, whose
        updates must not change the question.
        """
        control = self._controls[name] = Control(handle)

        def update(_event: Any) -> None:
            if self.is_writing:
                return

            def change(state: State) -> State:
                # Evaluated under the session's lock: a delayed call still uses the current value.
                control.value = handle.value
                return apply(state, handle.value)

            self._session.change(change)

        handle.on_update(update)

    def _button(self, name: str, label: str, action: Callable[[Any], None]) -> None:
        handle = self._gui.add_button(label)
        handle.on_click(lambda event: action(event.client))
        self._controls[name] = Control(handle)

    # ---- use of the controls ---------------------------------------------------------------------

    def handle(self, name: str) -> Any:
        """Return viser's handle of a control: ``q0``, ``mode0``, ``force``, ``limits``, ….

        Setting its value has the same effect as changing it on the page.
        """
        return self._controls[name].handle

    def _in_posture(self, state: State, name: str) -> State:
        if name == _SELECT:
            return state
        return state.in_posture(choose_posture(self.robot, None, name))

    def set_initial(self, state: State) -> None:
        """Set the question to which Reset returns, for a `Mode` with its own question."""
        self._start = state

    def _reset(self) -> None:
        """Return to the initial question, keeping the display options."""
        start = self._start
        self._session.change(lambda state: start.showing(**state.shown._asdict()))

    def _choose_set(self) -> None:
        if self.is_writing:
            return
        value = self._chosen_set.value = self._all_sets.value
        if value in self._labels:
            self._show_set(self._labels.index(value))

    def _show_set(self, k: int) -> None:
        sets = self._sets
        if k < len(sets):
            self._session.change(lambda state: state.with_faults(sets[k]))

    # ---- updates ---------------------------------------------------------------------------------

    @property
    def is_writing(self) -> bool:
        """Whether this thread is writing control values, as opposed to a user changing them."""
        return getattr(self._thread, "writes", False)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Write control values without reacting: viser runs callbacks for such writes too."""
        self._thread.writes = True
        try:
            yield
        finally:
            self._thread.writes = False

    def sync(self, state: State) -> None:
        """Update the controls to a question; called with the session's lock held."""
        values = self._values(state)
        with self.writing():
            self._add_task_option(values["task"])
            for name in values.keys() & self._controls.keys():
                self._controls[name].show(values[name])
            visible = {f"factor{i}": mode == FaultMode.WEAK for i, mode in enumerate(state.modes)}
            visible |= dict.fromkeys(("moment", "length"), bool(state.task.moment_rows))
            visible |= _visible_drives(state)
            for name in visible.keys() & self._controls.keys():
                assign(self._controls[name].handle, "visible", visible[name])

    def _values(self, state: State) -> dict[str, Any]:
        """Return the value of each control for a question."""
        shown, task = state.shown, state.task
        name = state.posture.source.removeprefix("posture '").removesuffix("'")
        values: dict[str, Any] = {
            "posture": name if name in self._postures else _SELECT,
            "load": state.load,
            "force": tuple(state.wrench[:3].tolist()),
            "moment": tuple(state.wrench[3:].tolist()),
            "task": str(task),
            "axes": task.axes,
            "length": task.length,
            "limits": state.counts_limits,
            "gravity": state.weighs,
            "joint_friction": state.joint_friction,
            "armature": state.armature,
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
            values[f"factor{i}"] = round(100.0 * state.factors[i], 6)
        return values

    def _add_task_option(self, task: str) -> None:
        """Add a task to the choices if needed: a mode may use an unusual one."""
        if "task" in self._controls:
            control = self._controls["task"]
            if task not in control.handle.options:
                control.handle.options = _tasks(task)
                control.value = control.handle.value  # viser may have changed it

    def show(self, answer: Answer, picture: Picture) -> None:
        """Show an answer.

        Parameters
        ----------
        answer, picture :
            The answer and its scene.
        """
        self.show_parts(banner(answer), answer_part(answer), legend(picture, self.notes))
        if self._is_played:
            return
        command = command_line(self.robot, answer.state)
        _write(self._command, command_part(command, answer.state.origin.note))
        _write(self._census, census_part(answer.census, answer.analysis.faults.joints))
        self._show_sets(answer)

    def show_problem(self, problem: str) -> None:
        """Show why there is no answer, keeping the last answer below."""
        self._show_banner(problem_banner(problem))

    def _show_banner(self, banner: Markup) -> None:
        self._top = banner
        _write(self._banner, banner)

    def mark_open(self) -> None:
        """Mark the verdict as that of an earlier question, until the newest one is answered."""
        _write(self._banner, open_banner(self._top))

    def static_parts(self) -> Markup:
        """Return the answer's HTML as currently shown, without the mark of an open question."""
        parts = (self._answer, self._legend)
        return Markup().join([self._top, *(Markup(part.content) for part in parts)])

    def show_parts(self, top: Markup, parts: Markup, below: Markup) -> None:
        """Show HTML in place of the verdict, the tables and the legend.

        Parameters
        ----------
        top, parts, below :
            As in `ftforce.view.modes.View`.
        """
        self._show_banner(top)
        _write(self._answer, parts)
        _write(self._legend, below)

    def _show_sets(self, answer: Answer) -> None:
        reports = () if answer.census is None else answer.census.sets
        labels = tuple(set_label(report) for report in reports)
        self._sets = tuple(report.faults for report in reports)
        shown = answer.analysis.faults
        chosen = next(
            (label for label, faults in zip(labels, self._sets, strict=True) if faults == shown),
            _SELECT,
        )
        with self.writing():
            if labels != self._labels:
                self._labels = labels
                self._all_sets.options = (_SELECT, *labels)
                self._chosen_set.value = self._all_sets.value  # viser may select another value
            self._chosen_set.show(chosen)
        for k, button in enumerate(self._buttons):
            assign(button, "visible", k < len(labels))
            if k < len(labels):
                assign(button, "label", labels[k])
                assign(button, "color", VERDICT_COLOURS[reports[k].verdict])


def _visible_drives(state: State) -> dict[str, bool]:
    """Return which switches of the drives can make a difference; those that are on are shown."""
    is_running, is_speeding_up = state.velocity is not None, state.acceleration is not None
    has_rotors = is_running or is_speeding_up or state.inverse == "dynamic"
    return {
        "joint_friction": is_running or state.joint_friction,
        "armature": has_rotors or state.armature,
    }


def _tasks(task: str) -> tuple[str, ...]:
    """Return the selectable tasks, including the given one."""
    return _TASKS if task in _TASKS else (task, *_TASKS)


def _set_task(state: State, task: str) -> State:
    return state.asking(task, state.task.axes)


def _set_axes(state: State, axes: str) -> State:
    return state.asking(str(state.task), axes)


def _set_length(state: State, length: float) -> State:
    return state.asking(str(state.task), state.task.axes, length)


def _set_payload(state: State, mass: float) -> State:
    if state.payload is None or mass <= 0.0:
        return state.carrying(Payload.of(mass) if mass > 0.0 else None)
    inertia = state.payload.inertia  # of a body of the same shape
    inertia = None if inertia is None else inertia * (mass / state.payload.mass)
    return state.carrying(Payload.of(mass, state.payload.offset, inertia))


def _option(name: str, convert: Callable[[Any], Any] = lambda value: value) -> Change:
    """Return a function that sets one field of `Shown` from a control's value."""
    return lambda state, value: state.showing(**{name: convert(value)})


def _write(handle: Any, content: Markup) -> None:
    assign(handle, "content", str(content))  # viser requires a plain string
