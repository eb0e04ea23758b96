"""Parts of viser that are not public, and that the page cannot do without; tried on viser 1.1.1.

Nothing else in ftforce relies on them. ``tests/test_view_viser_private.py`` has a test for each;
it names the version that was tried, so that a test that fails says what to look at.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from ftforce.errors import FtforceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


TRIED = "1.1.1"

ELSEWHERE = frozenset({"websocket", "playbackPath"})
"""Parameters of a page's address that make it connect to another server, and show its HTML.

Private: viser's page reads them, its documentation does not list them. No option turns them off.
"""

ROOT, NOTICES = "#root", ".mantine-Notifications-root"
"""Selectors of the scene's element, and of the notices that would cover it, in a page for a file.

Private: names in viser's built page. `as_html` has no option for either.
"""

_TITLE = "<title>Viser</title>"


def protocol() -> str:
    """Return the subprotocol of the websockets of viser's page.

    Private: a convention of viser's page and server. There is no public way to ask for it.
    """
    import viser

    return f"viser-v{viser.__version__}"


@contextmanager
def serving(serve: Callable[..., Any]) -> Iterator[None]:
    """Have the server that viser starts meanwhile started by another function.

    Private: that viser looks up ``serve`` in ``websockets.asyncio.server`` when it starts, and
    hands it ``process_request``. `ViserServer` takes no check of requests of its own.

    Parameters
    ----------
    serve :
        Called with websockets' own ``serve`` first, and then with what viser has for it.
    """
    import websockets.asyncio.server as websockets

    original = websockets.serve

    def replacement(*arguments: Any, **options: Any) -> Any:
        return serve(original, *arguments, **options)

    websockets.serve = replacement  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.serve = original  # type: ignore[misc]


def close_tunnel(server: Any) -> None:
    """Take away what a page could ask for: a tunnel that makes the server public.

    Private: the messages and their handlers. A subclass could override `request_share_url`, which
    is public, but would not notice a release that opens its tunnel another way.

    Raises
    ------
    FtforceError
        viser has changed.
    """
    import viser

    try:
        messages = viser._messages
        for request in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
            server._websock_server.unregister_handler(request)
    except (AttributeError, AssertionError, KeyError):
        raise changed("does not let its public tunnel be closed") from None


def titled(page: str, title: str, before: Markup = Markup()) -> str:  # noqa: B008 # immutable
    """Return viser's page with another title, and something before it; as it is if it has none.

    Private: what viser's page has as its title. ``set_panel_label`` does not change it.

    Parameters
    ----------
    page :
        HTML.
    title :
        As text.
    before :
        HTML that comes before it, and so before all scripts.
    """
    return page.replace(_TITLE, before + Markup("<title>{}</title>").format(title), 1)


def changed(what: str) -> FtforceError:
    """Return an error that says what the installed version of viser does not do any more."""
    import viser

    return FtforceError(
        f"viser {viser.__version__} {what}; install the one that ftforce was tested with: "
        "pip install 'ftforce[view]'"
    )
