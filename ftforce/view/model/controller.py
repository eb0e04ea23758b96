"""What controls and scene may ask of the session, without knowing it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from ftforce.core.arrays import Vector
    from ftforce.view.model.state import State


class Controller(Protocol):
    """Takes what a user does on the page; may be called from any thread."""

    def change(self, change: Callable[[State], State]) -> None:
        """Change the newest question, and have it answered."""

    def pull(self, end: Callable[[], Vector], done: bool) -> None:
        """Move the end of the requested force to a place in the root's axes, m, shape (3,)."""

    def touch(self, joint: int) -> None:
        """Lock a joint (index from 0) that is healthy, and mend it if it is not."""

    def save_picture(self, event: Any) -> None:
        """Send the scene as a picture to the tab that asked for it."""

    def save_page(self, event: Any) -> None:
        """Send the page as a file to the tab that asked for it."""
