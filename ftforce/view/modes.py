"""Modes that replace the ordinary answer: playback of a history, points of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from markupsafe import Markup

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from ftforce.view.geometry.meshes import Geometry
    from ftforce.view.model.state import State
    from ftforce.view.page.panel import Panel
    from ftforce.view.scene.picture import Picture
    from ftforce.view.scene.stage import Stage


class View(NamedTuple):
    """What a `Mode` shows instead of the ordinary answer.

    Attributes
    ----------
    picture :
        The scene.
    top, parts, below :
        HTML from `ftforce.view.page.answer` in place of the verdict, the tables and the legend.
    more :
        Callback that shows whatever else belongs to the view, in the same update.
    """

    picture: Picture
    top: Markup
    parts: Markup
    below: Markup = Markup()
    more: Callable[[], None] | None = None


class Host(Protocol):
    """The session as seen by a mode.

    Attributes
    ----------
    server, panel, stage :
        The viser server, the controls and the scene.
    state :
        The current question.
    picture :
        The scene shown last; ``None`` before the first.
    """

    server: viser.ViserServer
    panel: Panel
    stage: Stage
    state: State
    picture: Picture | None

    def change(self, change: Callable[[State], State]) -> None:
        """Modify the current question and recompute the answer."""

    def refresh(self) -> None:
        """Recompute the answer, or query the mode again."""


class Mode:
    """A source of posture and faults other than the user: a history or a sweep.

    A mode fills its own tab, ``session.panel.first_tab``, and adds its own nodes to
    ``session.server.scene``. When its time or selected point changes, it calls `Host.refresh`, or
    `Host.change` with a new question.
    """

    tab = ""
    """Label of the mode's tab, the first of the page."""

    takes_over = False
    """Whether the mode alone determines posture, faults and load, so that the question is fixed."""

    def start(self, session: Host) -> None:
        """Start; the page is already open, but no question has been answered yet."""

    def view(self, state: State) -> View | None:  # noqa: ARG002 # part of the interface
        """Return the view to show now; ``None`` for the ordinary answer.

        Called by the session's worker thread, which displays any error raised here.
        """
        return None

    def set_geometry(self, geometry: Geometry) -> None:
        """Set the link meshes in the mode's own scenes; called with the session's lock held."""

    def page(self) -> str | None:
        """Return the mode as a page to be saved; ``None`` for the scene as it is."""
        return None

    def part(self) -> Markup:
        """Return HTML to be placed above the tables when the scene is saved as it is."""
        return Markup()

    def stop(self) -> None:
        """Stop, and join all threads of the mode."""
