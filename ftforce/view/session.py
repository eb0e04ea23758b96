"""A page that is open: one question, one worker that answers it, and everybody who looks on.

Whoever changes the question only leaves the newest one and wakes the worker. So ten tabs, and one
that vanishes in the middle of a drag, share one question, and no answer is late by more than one.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError
from ftforce.view.model.answer import answer
from ftforce.view.model.state import HEALTHY, command_line
from ftforce.view.modes import Mode
from ftforce.view.page.answer import static_page
from ftforce.view.page.panel import Panel
from ftforce.view.scene.picture import HAND, picture, pulled
from ftforce.view.scene.stage import Stage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import viser

    from ftforce.core.arrays import Vector
    from ftforce.robot.robot import Robot
    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.model.answer import Answer
    from ftforce.view.model.state import State
    from ftforce.view.scene.picture import Picture

_MISTAKE = "a mistake in ftforce, please report it"


@contextmanager
def ctrl_c() -> Iterator[list[int]]:
    """Yield a list that is no longer empty once Ctrl-C was pressed.

    `KeyboardInterrupt` could be lost: trimesh catches it while it tries which libraries there are,
    one of which does not survive it, and Python itself drops it in a callback of a weak reference.
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
        The question with which it starts.
    host, port :
        Where it listens; without a port the first one that is free.
    mode :
        Takes over posture and faults; ``None`` if the user has them.

    Attributes
    ----------
    address :
        Where a browser finds the page.
    warning :
        What a user should know of the address; empty if only this machine reaches it.
    state :
        The newest question.
    answer, picture :
        The last that were shown; ``None`` before the first.
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
        self._refusal = ""  # of the last change
        self._failure = ""  # of the last question that was answered
        self._is_pulled = False
        self._lock = threading.RLock()
        self._news = threading.Condition(self._lock)
        self._asked, self._answered = 1, 0
        self._ends = threading.Event()
        self.seconds = 0.0
        self._open = open_server(host, port, title=f"ftforce {robot.name}")
        self.server: viser.ViserServer = self._open.server
        self.address, self.warning = self._open.address, self._open.warning
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
            self.mode.start(self)  # before anything is asked of it
            self._worker = threading.Thread(target=self._work, name="ftforce view", daemon=True)
            self._worker.start()
            self.settle()
            if (scene := self.picture) is not None:
                self.stage.look(scene)
        except BaseException:
            self.close()
            raise

    @property
    def problem(self) -> str:
        """Why the newest question has no answer; empty if it has."""
        with self._lock:
            return self._refusal or self._failure

    # ---- what anybody may do, from any thread ------------------------------------------------

    def change(self, change: Callable[[State], State]) -> None:
        """Change the newest question, and have it answered.

        Parameters
        ----------
        change :
            Makes another question of the newest one; an error that ftforce raises in it is shown
            in the banner, and the question stays.
        """
        with self._lock:
            try:
                self.state = change(self.state)
                self._refusal = ""
            except FtforceError as error:
                self._refusal = str(error)
            self._ask()

    def refresh(self) -> None:
        """Have the newest question answered, or the mode asked, again."""
        with self._lock:
            self._ask()

    def _ask(self) -> None:
        self._asked += 1
        self._news.notify_all()

    def settle(self, seconds: float = 60.0) -> None:
        """Wait until the newest question is answered and on its way to the tabs.

        Raises
        ------
        TimeoutError
            It was not in this time.
        """
        with self._news:
            asked = self._asked
            if not self._news.wait_for(lambda: self._answered >= asked, seconds):
                raise TimeoutError(f"no answer within {seconds:g} s")

    def pull(self, end: Callable[[], Vector], done: bool) -> None:
        """Move the end of the requested force to a place in the root's axes, m, shape (3,).

        What a hand that holds still moves is nobody's wish: the question stays.
        """
        with self._lock:
            self._is_pulled = not done  # the scale of the arrows stays as long as one is dragged
            shown, scene = self.answer, self.picture
            if shown is None or scene is None or not scene.can_pull:
                return
            place = end()
            if math.dist(place, scene.arrows[0].end) > 0.5 * HAND:
                wrench = pulled(scene, shown, place)
                self.change(lambda state: state.pushing(wrench))
            elif done:
                self._ask()  # all arrows in a scale that fits them

    def touch(self, joint: int) -> None:
        """Lock a joint (index from 0) that is healthy, and mend it if it is not."""
        if self.mode.takes_over:
            return

        def toggle(state: State) -> State:
            is_healthy = state.modes[joint] == HEALTHY
            return state.failing(joint, "locked" if is_healthy else HEALTHY)

        self.change(toggle)

    # ---- the worker --------------------------------------------------------------------------

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._asked > self._answered or self._ends.is_set())
                if self._ends.is_set():
                    return
                asked, state, earlier = self._asked, self.state, self.answer
                like = None
                if self._is_pulled and earlier is not None and earlier.state.task == state.task:
                    like = self.picture
            self._answer_now(state, earlier, like)
            with self._news:
                self._answered = asked
                self._news.notify_all()

    def _answer_now(self, state: State, earlier: Answer | None, like: Picture | None) -> None:
        """Answer a question, first all of it, then send it: a tab never shows half of two."""
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
            self._show_failure(str(error))
        except Exception as error:  # the page lives on; its user never meets a traceback
            self._show_failure(f"{_MISTAKE} ({error!r})")
        self.seconds = time.perf_counter() - started

    def _show(self, scene: Picture) -> None:
        self.picture, self._failure = scene, ""
        self.stage.update(scene)
        self.panel.sync(self.state)
        if self._refusal:
            self.panel.show_problem(self._refusal)

    def _show_failure(self, problem: str) -> None:
        with self._lock, self.server.atomic():
            self._failure = problem
            self.panel.show_problem(self.problem)
            self.panel.sync(self.state)

    # ---- beginning and end -------------------------------------------------------------------

    def load_geometry(self) -> None:
        """Load the arm's meshes and show them: seconds, so the page is up before."""
        from ftforce.view.geometry.meshes import load_geometry

        with ctrl_c() as pressed:
            geometry = load_geometry(self.robot)
        if pressed:
            raise KeyboardInterrupt
        self.set_geometry(geometry)

    def set_geometry(self, geometry: Geometry) -> None:
        """Show the arm's links."""
        with self._lock, self.server.atomic():
            self.stage.set_geometry(geometry)
            self.panel.notes = geometry.notes
            if self.picture is not None:
                self.stage.look(self.picture)
            self.mode.set_geometry(geometry)
        self.refresh()  # the legend says what is missing

    def run(self, announce: Callable[[], None] = lambda: None) -> None:
        """Load the meshes and stay open until Ctrl-C.

        Parameters
        ----------
        announce :
            Called as soon as Ctrl-C ends the page.
        """
        with ctrl_c() as pressed, suppress(KeyboardInterrupt):
            announce()
            self.load_geometry()
            while not (pressed or self._ends.wait(0.2)):
                pass
        self.close()

    def close(self) -> None:
        """End the worker, the mode and the server; may be called twice."""
        with self._news:
            was_open = not self._ends.is_set()
            self._ends.set()
            self._news.notify_all()
        if not was_open:
            return
        self.mode.stop()
        worker = getattr(self, "_worker", None)
        if worker is not None:
            worker.join(10.0)
        self._open.close()

    def __enter__(self) -> Session:
        """Return itself, open."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Close."""
        self.close()

    # ---- to take along -----------------------------------------------------------------------

    def page(self) -> str:
        """Return the page as HTML that needs no server, and asks none for anything."""
        from ftforce.view.server.export import scene_html

        if (page := self.mode.page()) is not None:
            return page
        with self._lock:
            part = self.panel.static_parts()
            if self.answer is not None and self.picture is not None:
                command = command_line(self.robot, self.answer.state)
                part = static_page(self.answer, self.picture, command, self.panel.notes)
            title, part = f"ftforce {self.robot.name}", self.mode.part() + part
            with self.server.atomic(), self.stage.without_handle():  # no tab sees that it is gone
                return scene_html(self.server, title=title, answer=part)

    def png(self) -> bytes:
        """Return the scene as a PNG, drawn by a browser without a window.

        Raises
        ------
        FtforceError
            There is no browser, or it fails.
        """
        from ftforce.view.server.screenshot import screenshot

        return screenshot(self.server, self.address)

    def save_page(self, client: Any) -> None:
        """Give a tab the page as a file that needs no server."""
        self._give(client, "html", lambda: self.page().encode())

    def save_picture(self, client: Any) -> None:
        """Give a tab the scene as it sees it, as a PNG."""
        from ftforce.view.server.screenshot import render_png

        self._give(client, "png", lambda: render_png(client))

    def _give(self, client: Any, ending: str, content: Callable[[], bytes]) -> None:
        """Give a tab a file, or tell it of the error: this happens in a thread of viser's."""
        name = f"{_file_name(self.robot)}.{ending}"
        try:
            given = content()
            client.send_file_download(name, given, save_immediately=True)
        except Exception as error:  # a tab that is gone, for one
            problem = str(error) if isinstance(error, FtforceError) else repr(error)
            with suppress(Exception):
                client.add_notification("Nothing was saved", problem, color="red")


def _file_name(robot: Robot) -> str:
    """Return a robot's name as part of a file's: whatever a URDF calls it."""
    kept = "".join(c if c.isalnum() or c in "-_" else "_" for c in robot.name)
    return f"ftforce_{kept[:60]}"
