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
    in_one_line: Callable[[Any], str]


_hooks: list[_Hook] = []


def show_with(
    render: Callable[[Any], Any],
    to_html: Callable[[Any], str],
    in_one_line: Callable[[Any], str],
) -> None:
    """Install the functions that display results.

    Parameters
    ----------
    render :
        Converts a result to a rich renderable.
    to_html :
        Converts a result to HTML for notebooks.
    in_one_line :
        Converts a result to a line of text.
    """
    _hooks[:] = [_Hook(render, to_html, in_one_line)]


class Displayed:
    """Mixin: ``__rich__`` for terminals, ``_repr_html_`` for notebooks, and a short ``repr``.

    Dataclasses need ``repr=False``, or their own ``repr`` lists all of their arrays.
    """

    __slots__ = ()

    def __repr__(self) -> str:
        """Return what the result is of, and the verdict, in one line."""
        return _hooks[0].in_one_line(self)

    def __rich__(self) -> Any:
        """Return the rich renderable."""
        return _hooks[0].render(self)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook."""
        return _hooks[0].to_html(self)
