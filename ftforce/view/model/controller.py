"""Interface of the session to controls and scene, which do not depend on it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from ftforce.core.arrays import Vector
    from ftforce.view.model.state import State


class Controller(Protocol):
    """Receives user actions on the page; may be called from any thread."""

    def change(self, change: Callable[[State], State]) -> None:
        """Modify the current question and recompute the answer.

        Parameters
        ----------
        change :
            Maps the current question to a new one.
        """

    def drag(self, end: Callable[[], Vector], done: bool) -> None:
        """Move the tip of the requested force's arrow.

        Parameters
        ----------
        end :
            Returns the new position in root axes, m, shape (3,).
        done :
            Whether the drag has ended.
        """

    def toggle(self, joint: int) -> None:
        """Lock a healthy joint (index from 0), or restore a failed one."""

    def save_picture(self, event: Any) -> None:
        """Send an image of the scene to the tab that requested it."""

    def save_page(self, event: Any) -> None:
        """Send the page as a file to the tab that requested it."""
