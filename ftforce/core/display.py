"""Results show themselves in terminals and notebooks.

This is the one place below `ftforce.show` that reaches up to it, and only when something is
displayed: a result that is computed with never loads rich.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType


class Displayed:
    """Adds ``__rich__`` for terminals and ``_repr_html_`` for notebooks."""

    __slots__ = ()

    def __rich__(self) -> RenderableType:
        """Return what rich prints."""
        from ftforce.show.render import render

        return render(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        from ftforce.show.render import to_html

        return to_html(self)
