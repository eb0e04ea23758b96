"""Non-public parts of viser that the page depends on; tested with viser 1.1.1.

No other module uses them. Each has a test in ``tests/test_view_viser_private.py``, whose failure
names the tested version.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from ftforce.errors import FtforceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


TESTED = "1.1.1"

REDIRECTING = frozenset({"websocket", "playbackPath"})
"""URL parameters that make a page connect to another server and show its HTML.

Private: read by viser's page but undocumented. They cannot be disabled.
"""

ROOT, NOTICES = "#root", ".mantine-Notifications-root"
"""Selectors, in an exported page, of the scene's element and of the notices that would cover it.

Private: names in viser's built page. `as_html` has no option for either.
"""

_TITLE = "<title>Viser</title>"


def protocol() -> str:
    """Return the WebSocket subprotocol of viser's page.

    Private: an internal convention of viser's page and server, without public access.
    """
    import viser

    return f"viser-v{viser.__version__}"


@contextmanager
def serving(serve: Callable[..., Any]) -> Iterator[None]:
    """Replace the function with which viser starts its server, within this context.

    Private: viser looks up ``serve`` in ``websockets.asyncio.server`` at startup and passes it
    ``process_request``. `ViserServer` has no option to check requests.

    Parameters
    ----------
    serve :
        Called with websockets' own ``serve``, followed by the arguments that viser passes to it.
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
    """Disable the page's request for a tunnel that would make the server public.

    Private: the messages and their handlers. Overriding the public `request_share_url` in a
    subclass would miss future releases that open the tunnel in another way.

    Raises
    ------
    FtforceError
        viser's internals have changed.
    """
    import viser

    try:
        messages = viser._messages
        for request in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
            server._websock_server.unregister_handler(request)
    except (AttributeError, AssertionError, KeyError):
        raise changed("does not allow disabling its public tunnel") from None


def titled(page: str, title: str, before: Markup = Markup()) -> str:  # noqa: B008 # immutable
    """Return viser's page with its title replaced and HTML inserted; unchanged without a title.

    Private: the title in viser's page, which ``set_panel_label`` does not change.

    Parameters
    ----------
    page :
        The page's HTML.
    title :
        New title, as plain text.
    before :
        HTML inserted before the title, and thus before all scripts.
    """
    return page.replace(_TITLE, before + Markup("<title>{}</title>").format(title), 1)


def changed(what: str) -> FtforceError:
    """Return an error stating what is different in the installed version of viser."""
    import viser

    return FtforceError(
        f"viser {viser.__version__} {what}; install the version that ftforce was tested with: "
        "pip install 'ftforce[view]'"
    )
