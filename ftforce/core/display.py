"""Display of results in terminals and notebooks, through a hook that `ftforce` installs.

Packages below `ftforce.show` do not depend on it: rich is imported only when a result is displayed.
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
    """Install the functions that display results.

    Parameters
    ----------
    render :
        Converts a result to a rich renderable.
    to_html :
        Converts a result to HTML for notebooks.
    """
    _hooks[:] = [_Hook(render, to_html)]


class Displayed:
    """Mixin that adds ``__rich__`` for terminals and ``_repr_html_`` for notebooks."""

    __slots__ = ()

    def __rich__(self) -> Any:
        """Return the rich renderable."""
        return _hooks[0].render(self)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook."""
        return _hooks[0].to_html(self)
