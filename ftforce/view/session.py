"""An open page: one current question, one worker thread that answers it, any number of tabs.

Changing the question only replaces the current one and wakes the worker. All tabs therefore share
one question, even if one disconnects in mid-drag, and an answer is at most one question behind.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError, out_of_memory
from ftforce.view.model.answer import answer
from ftforce.view.model.state import HEALTHY, command_line, initial_state
from ftforce.view.modes import Mode
from ftforce.view.page.answer import static_page
from ftforce.view.page.panel import Panel
from ftforce.view.scene.picture import DRAG_RESOLUTION, dragged_wrench, picture
from ftforce.view.scene.stage import Stage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import viser

    from ftforce.analysis.analyze import Analysis
    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot
    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.model.answer import Answer
    from ftforce.view.model.state import State
    from ftforce.view.scene.picture import Picture

_BUG = "internal error in ftforce, please report it"


@contextmanager
def _ctrl_c() -> Iterator[list[int]]:
    """Yield a list that becomes non-empty once Ctrl-C is pressed.

    `KeyboardInterrupt` is not reliable here: trimesh swallows it while importing optional
    libraries, and Python discards it in weakref callbacks.
    """
    pressed: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield pressed
        return
    before = signal.signal(signal.SIGINT, lambda number, _frame: pressed.append(number))
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)


class Session:
    """The page of one arm.

    Parameters
    ----------
    robot :
        The arm.
    state :
        Initial question.
    host, port :
        Address to listen on; without a port, the first free one.
    mode :
        Mode that determines posture and faults; ``None`` leaves them to the user.

    Attributes
    ----------
    address :
        URL of the page, with its token.
    warning :
        Warning about the address; empty if only this machine can reach it.
    state :
        The current question.
    answer, picture :
        The answer and scene shown last; ``None`` before the first.
    """

    answer: Answer | None = None
    picture: Picture | None = None

    def __init__(
        self,
        robot: Robot,
        state: State,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        mode: Mode | None = None,
    ) -> None:
        from ftforce.view.server.server import open_server

        self.robot = robot
        self.mode = mode or Mode()
        self.state = state
        self._change_error = ""  # error of the last change
        self._answer_error = ""  # error of the last answered question
        self._is_dragging = False
        self._lock = threading.RLock()
        self._updated = threading.Condition(self._lock)
        self._newest, self._answered = 1, 0
        self._closing = threading.Event()
        self._saving = threading.Lock()
        self.seconds = 0.0
        self._opened = open_server(host, port, title=f"ftforce {robot.name}")
        self.server: viser.ViserServer = self._opened.server
        self.address, self.warning = self._opened.address, self._opened.warning
        try:
            with self.server.atomic():
                self.stage = Stage(self.server, robot, self)
                self.panel = Panel(
                    self.server,
                    robot,
                    state,
                    self,
                    first_tab=self.mode.tab,
                    is_played=self.mode.takes_over,
                )
            self.mode.start(self)  # before it is queried
            self._worker = threading.Thread(target=self._work, name="ftforce view", daemon=True)
            self._worker.start()
            self.settle()
            if (scene := self.picture) is not None:
                self.stage.aim(scene)
        except BaseException:
            self.close()
            raise

    @property
    def problem(self) -> str:
        """Why the current question has no answer; empty if it has one."""
        with self._lock:
            return self._change_error or self._answer_error

    # ---- thread-safe interface -------------------------------------------------------------------

    def change(self, change: Callable[[State], State]) -> None:
        """Modify the current question and recompute the answer.

        Parameters
        ----------
        change :
            Maps the current question to a new one. If it raises an ftforce error, the error is
            shown in the banner and the question is kept.
        """
        with self._lock:
            try:
                self.state = change(self.state)
                self._change_error = ""
            except FtforceError as error:
                self._change_error = str(error)
            self._request()

    def refresh(self) -> None:
        """Recompute the answer, or query the mode again."""
        with self._lock:
            self._request()

    def _request(self) -> None:
        self._newest += 1
        self._mark_open()
        self._updated.notify_all()

    def _mark_open(self) -> None:
        """Mark the verdict on the page; not while a mode plays, which asks at every frame."""
        if not self.mode.takes_over:
            self.panel.mark_open()

    def settle(self, seconds: float = 60.0) -> None:
        """Wait until the current question is answered and sent to the tabs.

        Parameters
        ----------
        seconds :
            Timeout, s.

        Raises
        ------
        TimeoutError
            The timeout expired.
        """
        with self._updated:
            asked = self._newest
            if not self._updated.wait_for(lambda: self._answered >= asked, seconds):
                raise TimeoutError(f"no answer within {seconds:g} s")

    def drag(self, end: Callable[[], Vector], done: bool) -> None:
        """Move the tip of the requested force's arrow.

        Displacements below the drag resolution are ignored.

        Parameters
        ----------
        end :
            Returns the new position in root axes, m, shape (3,).
        done :
            Whether the drag has ended.
        """
        with self._lock:
            self._is_dragging = not done  # the arrow scale is fixed during a drag
            shown, scene = self.answer, self.picture
            if shown is None or scene is None or not scene.can_drag:
                return
            place = end()
            if math.dist(place, scene.arrows[0].end) > 0.5 * DRAG_RESOLUTION:
                wrench = dragged_wrench(scene, shown, place)
                self.change(lambda state: state.pushing(wrench))
            elif done:
                self._request()  # rescales the arrows to fit

    def toggle(self, joint: int) -> None:
        """Lock a healthy joint (index from 0), or restore a failed one."""
        if self.mode.takes_over:
            return

        def flip(state: State) -> State:
            is_healthy = state.modes[joint] == HEALTHY
            return state.failing(joint, "locked" if is_healthy else HEALTHY)

        self.change(flip)

    # ---- the worker --------------------------------------------------------------------------

    def _work(self) -> None:
        while True:
            with self._updated:
                self._updated.wait_for(
                    lambda: self._newest > self._answered or self._closing.is_set()
                )
                if self._closing.is_set():
                    return
                asked, state, earlier = self._newest, self.state, self.answer
                like = None
                if self._is_dragging and earlier is not None and earlier.state.task == state.task:
                    like = self.picture
            self._answer_now(state, earlier, like)
            with self._updated:
                self._answered = asked
                if self._newest > asked:  # the banner is that of an earlier question
                    self._mark_open()
                self._updated.notify_all()

    def _answer_now(self, state: State, earlier: Answer | None, like: Picture | None) -> None:
        """Compute the complete answer, then send it, so that tabs never show a mixed state."""
        started = time.perf_counter()
        try:
            view = self.mode.view(state)
            if view is None:
                found = answer(self.robot, state, earlier)
                scene = picture(found, like)
                with self._lock, self.server.atomic():
                    self.answer = found
                    self.panel.show(found, scene)
                    self._show(scene)
            else:
                with self._lock, self.server.atomic():
                    self.panel.show_parts(view.top, view.parts, view.below)
                    self._show(view.picture)
                    if view.more is not None:
                        view.more()
        except FtforceError as error:
            self._show_error(str(error))
        except MemoryError as error:
            self._show_error(out_of_memory(error))
        except Exception as error:  # keep the page alive and never show a traceback
            self._show_error(f"{_BUG} ({error!r})")
        self.seconds = time.perf_counter() - started

    def _show(self, scene: Picture) -> None:
        self.picture, self._answer_error = scene, ""
        self.stage.update(scene)
        self.panel.sync(self.state)
        if self._change_error:
            self.panel.show_problem(self._change_error)

    def _show_error(self, problem: str) -> None:
        with self._lock, self.server.atomic():
            self._answer_error = problem
            self.panel.show_problem(self.problem)
            self.panel.sync(self.state)

    # ---- start and stop --------------------------------------------------------------------------

    def load_geometry(self) -> None:
        """Load and show the arm's meshes; this takes seconds, so the page is opened first."""
        from ftforce.view.geometry.meshes import load_geometry

        with _ctrl_c() as pressed:
            geometry = load_geometry(self.robot)
        if pressed:
            raise KeyboardInterrupt
        self.set_geometry(geometry)

    def set_geometry(self, geometry: Geometry) -> None:
        """Set the meshes of the arm's links."""
        with self._lock, self.server.atomic():
            self.stage.set_geometry(geometry)
            self.panel.notes = geometry.notes
            if self.picture is not None:
                self.stage.aim(self.picture)
            self.mode.set_geometry(geometry)
        self.refresh()  # the legend lists missing meshes

    def run(self, announce: Callable[[], None] = lambda: None) -> None:
        """Load the meshes and keep the page open until Ctrl-C.

        Parameters
        ----------
        announce :
            Called once Ctrl-C is handled.
        """
        with _ctrl_c() as pressed, suppress(KeyboardInterrupt):
            announce()
            self.load_geometry()
            while not (pressed or self._closing.wait(0.2)):
                pass
        self.close()

    def close(self) -> None:
        """Stop the worker, the mode and the server; safe to call twice."""
        with self._updated:
            was_open = not self._closing.is_set()
            self._closing.set()
            self._updated.notify_all()
        if not was_open:
            return
        self.mode.stop()
        worker = getattr(self, "_worker", None)
        if worker is not None:
            worker.join(10.0)
        self._opened.close()

    def __enter__(self) -> Session:
        """Return the open session."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the session."""
        self.close()

    # ---- export ----------------------------------------------------------------------------------

    def page(self) -> str:
        """Return the page as self-contained HTML that makes no network requests."""
        from ftforce.view.server.export import scene_html

        if (page := self.mode.page()) is not None:
            return page
        with self._lock:
            part = self.panel.static_parts()
            if self.answer is not None and self.picture is not None:
                command = command_line(self.robot, self.answer.state)
                part = static_page(self.answer, self.picture, command, self.panel.notes)
            title, part = f"ftforce {self.robot.name}", self.mode.part() + part
            with self.server.atomic(), self.stage.without_handle():  # hidden from open tabs
                return scene_html(self.server, title=title, answer=part)

    def png(self) -> bytes:
        """Return the scene as a PNG, rendered by a headless browser.

        Raises
        ------
        FtforceError
            No browser is found, or it fails.
        """
        from ftforce.view.server.screenshot import screenshot

        return screenshot(self.server, self.address_for_browser())

    def address_for_browser(self) -> str:
        """Return a URL of the page that is good for one request; see `OpenServer`."""
        return self._opened.address_for_browser()

    def save_page(self, client: Any) -> None:
        """Send the page to a tab as a self-contained file."""
        self._send(client, "html", lambda: self.page().encode())

    def save_picture(self, client: Any) -> None:
        """Send the scene, as seen in a tab, to that tab as a PNG."""
        from ftforce.view.server.screenshot import render_png

        self._send(client, "png", lambda: render_png(client))

    def _send(self, client: Any, extension: str, content: Callable[[], bytes]) -> None:
        """Send a file to a tab, or notify it of the error: this runs in a viser thread.

        Only one is made at a time: tabs that do not draw would otherwise occupy all threads.
        """
        name = f"{_file_name(self.robot)}.{extension}"
        if not self._saving.acquire(blocking=False):
            with suppress(Exception):
                problem = "another image or page is being saved; try again when it is done"
                client.add_notification("Saving failed", problem, color="red")
            return
        try:
            data = content()
            client.send_file_download(name, data, save_immediately=True)
        except Exception as error:  # for example, the tab was closed
            problem = str(error) if isinstance(error, FtforceError) else repr(error)
            with suppress(Exception):
                client.add_notification("Saving failed", problem, color="red")
        finally:
            self._saving.release()


def open_page(result: Analysis, *, port: int | None = None) -> Session:
    """Open the page on this machine, with the question of an analysis and the arm's meshes.

    Parameters
    ----------
    result :
        The analysis. Without a force or torques the page starts with 20 N along each axis.
    port :
        Port to listen on; by default the first free one.

    Returns
    -------
    :
        The open page, to be closed: a context manager. `Session.address_for_browser` is its URL,
        `Session.page` and `Session.png` export it, and `Session.run` keeps it open until Ctrl-C.

    Raises
    ------
    FtforceError
        The extra ``view`` is not installed, or the port is taken.
    """
    has_limits = result.limits is not None
    state = initial_state(result.question, are_limits_given=has_limits)
    session = Session(result.robot, state, port=port)
    try:
        session.load_geometry()
        session.settle()
    except BaseException:
        session.close()
        raise
    return session


def _file_name(robot: Robot) -> str:
    """Return the robot's name in a form that is safe in a file name."""
    kept = "".join(c if c.isalnum() or c in "-_" else "_" for c in robot.name)
    return f"ftforce_{kept[:60]}"
