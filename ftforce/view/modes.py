"""What may take the place of the ordinary answer: a history that plays, the points of a sweep."""

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
        HTML of `ftforce.view.page.answer`: where the verdict, the tables and the legend are.
    more :
        Shows what else belongs to it, at the same time.
    """

    picture: Picture
    top: Markup
    parts: Markup
    below: Markup = Markup()
    more: Callable[[], None] | None = None


class Host(Protocol):
    """The session, as a mode sees it.

    Attributes
    ----------
    server, panel, stage :
        viser's server, the controls and the scene.
    state :
        The newest question.
    picture :
        The last scene that was shown; ``None`` before the first.
    """

    server: viser.ViserServer
    panel: Panel
    stage: Stage
    state: State
    picture: Picture | None

    def change(self, change: Callable[[State], State]) -> None:
        """Change the newest question, and have it answered."""

    def refresh(self) -> None:
        """Have the newest question answered, or the mode asked, again."""


class Mode:
    """Something that takes posture and faults out of the user's hands: a history, a sweep.

    It fills its own tab, ``session.panel.first_tab``, and adds its own nodes to
    ``session.server.scene``; when its time, or its point, changes, it calls `Host.refresh`, or
    `Host.change` with another question.
    """

    tab = ""
    """What its tab is called, the first of the page."""

    takes_over = False
    """Whether posture, faults and load are its own: then the page asks nothing else."""

    def start(self, session: Host) -> None:
        """Begin; the session's page is up, and nothing was answered yet."""

    def view(self, state: State) -> View | None:  # noqa: ARG002 # others need it
        """Return what is shown now; ``None`` for the answer to the question.

        It is called by the session's worker, which shows the error if one is raised.
        """
        return None

    def set_geometry(self, geometry: Geometry) -> None:
        """Show the arm's links in scenes of its own; the session's lock is held."""

    def page(self) -> str | None:
        """Return what it shows as a page for a file; ``None`` for the scene as it is."""
        return None

    def part(self) -> Markup:
        """Return what stands beside the scene as it is, in a file, above the answer's tables."""
        return Markup()

    def stop(self) -> None:
        """End, and every thread of its own with it."""
