"""Results show themselves in terminals and notebooks, through a hook that `ftforce` fills.

Nothing below `ftforce.show` knows a screen: a result that is computed with never loads rich.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable


class _Hook(NamedTuple):
    render: Callable[[Any], Any]
    to_html: Callable[[Any], str]


_hooks: list[_Hook] = []


def show_with(render: Callable[[Any], Any], to_html: Callable[[Any], str]) -> None:
    """Say how results are displayed.

    Parameters
    ----------
    render :
        Makes of a result what rich prints.
    to_html :
        Makes of it HTML for a notebook.
    """
    _hooks[:] = [_Hook(render, to_html)]


class Displayed:
    """Adds ``__rich__`` for terminals and ``_repr_html_`` for notebooks."""

    __slots__ = ()

    def __rich__(self) -> Any:
        """Return what rich prints."""
        return _hooks[0].render(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return _hooks[0].to_html(self)
