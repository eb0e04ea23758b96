"""Who may talk to the page's server: only the page that it served itself.

viser answers everybody. A web page from anywhere could then connect to the server on the user's
own machine and read along, since a browser's rule of the same origin does not hold for
websockets. viser has no hook for a check, so its way of starting its server is wrapped while it
starts (`viser_private`); `server` makes sure that this worked before anything is shown.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import re
import socket
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit
from weakref import WeakKeyDictionary

from ftforce.view.server import viser_private

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from websockets.datastructures import Headers

_LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(:[0-9]{1,5})?")
_PATIENCE = 1.0  # s: how long the end waits for a connection that does not close

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:; "
    "worker-src blob:; connect-src {connect} data: blob:; img-src data: blob:; "
    "style-src 'unsafe-inline'; font-src data:; form-action 'none'; base-uri 'none'"
)

_lock = threading.Lock()  # what `serving` replaces belongs to the whole process


@dataclass(frozen=True, slots=True)
class Names:
    """What the server may be called in a request.

    Attributes
    ----------
    names :
        In small letters, without a port.
    any_address :
        Whether every IP address will do. None can be turned to point here by somebody else, as a
        name can.
    """

    names: frozenset[str]
    any_address: bool = False

    def hold(self, name: str) -> bool:
        """Whether the server may be called so."""
        return name.lower() in self.names or (self.any_address and _as_address(name) is not None)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    address = _as_address(host)
    return host.lower() in _LOOPBACK or (address is not None and address.is_loopback)


def names_of(host: str) -> Names:
    """Return what a server that listens on ``host`` may be called."""
    if is_loopback(host):
        return Names(_LOOPBACK | {host.lower()})
    own = socket.gethostname().lower()
    return Names(_LOOPBACK | {host.lower(), own, f"{own}.local"}, any_address=True)


def content_policy(connect: str) -> str:
    """Return a Content-Security-Policy under which viser's page works and asks nobody else.

    Parameters
    ----------
    connect :
        Where it may connect to, besides what it holds itself.
    """
    return " ".join(_POLICY.format(connect=connect).split())


def refusal(path: str, headers: Headers, names: Names, protocol: str) -> str:
    """Return why a request is refused; empty if it is not.

    Parameters
    ----------
    path :
        What is asked for, with its query.
    headers :
        Of the request.
    names :
        What this server may be called.
    protocol :
        The websocket's subprotocol, which names viser's version.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or (match := _HOST.fullmatch(hosts[0])) is None:
        return "one Host header is needed"
    if not names.hold(match["name"].strip("[]")):
        return "this server has another name"
    own = f"http://{hosts[0]}"
    if headers.get_all("Upgrade"):
        return _connection_refusal(headers, own, protocol)
    if origins not in ([], [own]):
        return "another page may not read this one"
    if viser_private.ELSEWHERE & set(parse_qs(urlsplit(path).query, keep_blank_values=True)):
        return "this page connects to no other server"
    return ""


def _connection_refusal(headers: Headers, own: str, protocol: str) -> str:
    # Browsers always send an Origin, and no page can forge it; without it, it is no browser.
    if headers.get_all("Origin") != [own]:
        return "only the page that this server sent may connect"
    if headers.get_all("Sec-WebSocket-Protocol") != [protocol]:
        return "the page is of another version; reload it"
    return ""


class Guard:
    """Checks requests, and adds to answers what browsers should enforce.

    Parameters
    ----------
    names :
        What the server may be called.
    title :
        Of the page.
    listening :
        Where it listens.
    """

    def __init__(self, names: Names, title: str, listening: socket.socket) -> None:
        self.names, self.title = names, title
        self._listening = listening
        self.protocol = viser_private.protocol()
        self.is_used = False
        self._transports: WeakKeyDictionary[Any, Callable[[], object]] = WeakKeyDictionary()

    def serve(
        self,
        serve: Callable[..., Any],
        handler: Any,
        *_where: Any,
        process_request: Any,
        **options: Any,
    ) -> Any:
        """Start a server of websockets' as viser would, guarded, at no other place than ours."""
        self.is_used = True
        options |= {
            "sock": self._listening,
            "process_request": self.wrap(process_request),
            "create_connection": self._tracked(),
            "close_timeout": _PATIENCE,
            "logger": _silent(),
        }
        return serve(handler, **options)

    def wrap(self, answer: Any) -> Any:
        """Return viser's function that answers requests, guarded."""

        def checked(connection: Any, request: Any) -> Any:
            try:
                reason = refusal(request.path, request.headers, self.names, self.protocol)
            except ValueError:  # what no browser sends
                reason = "the request is malformed"
            if reason:
                return self._harden(connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n"))
            # The title is to be found in the page.
            _set_header(request, "Accept-Encoding", "identity")
            response = answer(connection, request)
            if response is not None:
                self._name(response)
                self._harden(response, f"'self' ws://{request.headers['Host']}")
            return response

        return checked

    def _tracked(self) -> Any:
        """Return the class of connections that this guard can hang up."""
        from websockets.asyncio.server import ServerConnection

        transports = self._transports

        class Tracked(ServerConnection):
            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)
                loop = asyncio.get_running_loop()
                transports[self] = lambda: loop.call_soon_threadsafe(transport.abort)

        return Tracked

    def hang_up(self) -> None:
        """Cut connections that never asked for anything: the server's end waits for them.

        Browsers open some in advance.
        """
        from websockets.protocol import State

        for connection, abort in list(self._transports.items()):
            if connection.state is not State.OPEN:
                with suppress(RuntimeError):  # the server has ended
                    abort()

    def _name(self, response: Any) -> None:
        if response.headers.get("Content-Type", "").startswith("text/html"):
            page = viser_private.titled(response.body.decode(), self.title)
            response.body = page.encode()
            _set_header(response, "Content-Length", str(len(response.body)))

    @staticmethod
    def _harden(response: Any, connect: str = "'none'") -> Any:
        for name, value in {
            "Content-Security-Policy": f"{content_policy(connect)}; frame-ancestors 'none'",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
            "Connection": "close",
        }.items():
            _set_header(response, name, value)
        return response


@contextmanager
def guarding(names: Names, title: str, listening: socket.socket) -> Iterator[Guard]:
    """Guard the server that viser starts meanwhile.

    Parameters
    ----------
    names, title, listening :
        As in `Guard`.
    """
    guard = Guard(names, title, listening)
    with _lock, viser_private.serving(guard.serve):
        yield guard


def _set_header(message: Any, name: str, value: str) -> None:
    """Set a header to one value: websockets adds a second one to the first."""
    if name in message.headers:
        del message.headers[name]
    message.headers[name] = value


def _silent() -> logging.Logger:
    """Return a logger that prints nothing: what strangers send is no news to the user."""
    logger = logging.getLogger("ftforce.view")
    logger.disabled = True
    return logger


def _as_address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
