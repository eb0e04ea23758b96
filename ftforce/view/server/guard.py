"""Access control of the page's server: only the page that it served itself may connect.

viser answers every request. Any web page could thus connect to the server on the user's machine
and eavesdrop, as the same-origin policy does not cover WebSockets; and so could any other user of
the machine, whose program can send any header. The page is therefore served only to those who know
a token, as notebooks do: it is part of the printed address, and the browser keeps it as a cookie,
without which nothing connects. The browser itself is started with a ticket that is good for one
request, as other users can see the arguments of a process.

viser has no hook for an access check, so the function that starts its server is replaced during
startup (`viser_private`); `server` verifies that the check is effective before anything is shown.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import re
import secrets
import socket
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit
from weakref import WeakKeyDictionary

from markupsafe import Markup

from ftforce.view.server import viser_private

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from websockets.datastructures import Headers

_LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(:[0-9]{1,5})?")
_CLOSE_TIMEOUT = 1.0  # s: how long shutdown waits for connections to close

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:; "
    "worker-src blob:; connect-src {connect} data: blob:; img-src data: blob:; "
    "style-src 'unsafe-inline'; font-src data:; form-action 'none'; base-uri 'none'"
)

ALIVE = "/alive"
"""Path that the page asks for to learn that the server has stopped."""

_WATCH = f"""
(() => {{
  let failures = 0, box = null;
  setInterval(async () => {{
    let alive = false;
    try {{
      const signal = AbortSignal.timeout(4000);
      alive = (await fetch("{ALIVE}", {{cache: "no-store", signal}})).ok;
    }} catch (problem) {{ /* nobody answers */ }}
    failures = alive ? 0 : failures + 1;
    if (failures > 1 && box === null) {{
      box = document.createElement("div");
      box.setAttribute("role", "alert");
      box.dataset.testid = "stopped";
      box.textContent = "ftforce has stopped: this page is no longer updated.";
      box.style.cssText = "position:fixed;top:0;left:0;right:0;z-index:10000;padding:8px;" +
        "background:#aa2814;color:#fff;font:600 14px system-ui,sans-serif;text-align:center";
      document.body.appendChild(box);
    }} else if (alive && box !== null) {{
      box.remove();
      box = null;
    }}
  }}, 2000);
}})();
"""

_lock = threading.Lock()  # `serving` replaces a process-wide function


@dataclass(frozen=True, slots=True)
class Names:
    """Host names under which the server may be addressed.

    Attributes
    ----------
    names :
        In lower case, without a port.
    any_address :
        Whether any IP literal is accepted. IP literals, unlike names, cannot be DNS-rebound.
    """

    names: frozenset[str]
    any_address: bool = False

    def accepts(self, name: str) -> bool:
        """Return whether the server may be addressed by ``name``."""
        return name.lower() in self.names or (self.any_address and _as_address(name) is not None)


def is_loopback(host: str) -> bool:
    """Return whether an address is reachable from this machine only."""
    address = _as_address(host)
    return host.lower() in _LOOPBACK or (address is not None and address.is_loopback)


def names_of(host: str) -> Names:
    """Return the host names accepted by a server that listens on ``host``."""
    if is_loopback(host):
        return Names(_LOOPBACK | {host.lower()})
    own = socket.gethostname().lower()
    return Names(_LOOPBACK | {host.lower(), own, f"{own}.local"}, any_address=True)


def content_policy(connect: str) -> str:
    """Return a Content-Security-Policy that lets viser's page work but contact no other host.

    Parameters
    ----------
    connect :
        Permitted connection targets, in addition to embedded data.
    """
    return " ".join(_POLICY.format(connect=connect).split())


def refusal(path: str, headers: Headers, names: Names, protocol: str) -> str:
    """Return why a request is refused; empty if it is accepted.

    Parameters
    ----------
    path :
        Request path with query.
    headers :
        Request headers.
    names :
        Host names of this server.
    protocol :
        WebSocket subprotocol, which identifies viser's version.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or (match := _HOST.fullmatch(hosts[0])) is None:
        return "exactly one Host header is required"
    if not names.accepts(match["name"].strip("[]")):
        return "unknown host name"
    own = f"http://{hosts[0]}"
    if headers.get_all("Upgrade"):
        return _connection_refusal(headers, own, protocol)
    if origins not in ([], [own]):
        return "cross-origin requests are not allowed"
    if viser_private.REDIRECTING & set(parse_qs(urlsplit(path).query, keep_blank_values=True)):
        return "the page must not connect to another server"
    return ""


def _connection_refusal(headers: Headers, own: str, protocol: str) -> str:
    # Browsers always send an Origin that pages cannot forge; only non-browsers omit it.
    if headers.get_all("Origin") != [own]:
        return "only pages served by this server may connect"
    if headers.get_all("Sec-WebSocket-Protocol") != [protocol]:
        return "the page is from another version of viser; reload it"
    return ""


class Guard:
    """Checks requests, and adds security headers to responses.

    Parameters
    ----------
    names :
        Host names of the server.
    title :
        Page title.
    listening :
        Listening socket.
    """

    def __init__(self, names: Names, title: str, listening: socket.socket) -> None:
        self.names, self.title = names, title
        self._listening = listening
        self.token = secrets.token_urlsafe(24)
        self._tickets: set[str] = set()
        self.cookie = f"ftforce-{listening.getsockname()[1]}={self.token}"
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
        """Start the websockets server as viser would, but guarded and on our own socket.

        Parameters
        ----------
        serve :
            The function of websockets that starts a server.
        handler, process_request :
            viser's handlers of connections and requests.
        options :
            Further options that viser passes.
        """
        self.is_used = True
        options |= {
            "sock": self._listening,
            "process_request": self.wrap(process_request),
            "create_connection": self._tracked(),
            "close_timeout": _CLOSE_TIMEOUT,
            "logger": _null_logger(),
        }
        return serve(handler, **options)

    def wrap(self, answer: Any) -> Any:
        """Return viser's request handler, guarded."""

        def checked(connection: Any, request: Any) -> Any:
            try:
                reason = refusal(request.path, request.headers, self.names, self.protocol)
                reason = reason or self.stranger(request.path, request.headers)
            except ValueError:  # never sent by a browser
                reason = "the request is malformed"
            if reason:
                return self._harden(connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n"))
            if request.path == ALIVE:
                return self._harden(connection.respond(HTTPStatus.OK, "\n"))
            # An uncompressed response, in which the title can be replaced.
            _set_header(request, "Accept-Encoding", "identity")
            response = answer(connection, request)
            if response is not None:
                self._set_title(response)
                self._harden(response, f"'self' ws://{request.headers['Host']}")
                cookie = f"{self.cookie}; Path=/; HttpOnly; SameSite=Strict"
                _set_header(response, "Set-Cookie", cookie)
            return response

        return checked

    def stranger(self, path: str, headers: Headers) -> str:
        """Return why a request is refused that comes without the token; empty if it has it.

        Parameters
        ----------
        path :
            Request path with query.
        headers :
            Request headers.
        """
        cookies = (one.strip() for line in headers.get_all("Cookie") for one in line.split(";"))
        if any(_are_equal(one, self.cookie) for one in cookies):
            return ""
        for given in parse_qs(urlsplit(path).query).get("token", []):
            if _are_equal(given, self.token):
                return ""
            if given in self._tickets:
                self._tickets.discard(given)
                return ""
        return "open the address that ftforce printed: it contains the token of this page"

    def ticket(self) -> str:
        """Return a token that is good for one request, by which a browser gets the page."""
        ticket = secrets.token_urlsafe(24)
        self._tickets.add(ticket)
        return ticket

    def _tracked(self) -> Any:
        """Return a connection class that records connections for `abort_idle`."""
        from websockets.asyncio.server import ServerConnection

        transports = self._transports

        class Tracked(ServerConnection):
            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)
                loop = asyncio.get_running_loop()
                transports[self] = lambda: loop.call_soon_threadsafe(transport.abort)

        return Tracked

    def abort_idle(self) -> None:
        """Abort connections on which no request was sent; shutdown would wait for them.

        Browsers open such connections in advance.
        """
        from websockets.protocol import State

        for connection, abort in list(self._transports.items()):
            if connection.state is not State.OPEN:
                with suppress(RuntimeError):  # the server has already stopped
                    abort()

    def _set_title(self, response: Any) -> None:
        if response.headers.get("Content-Type", "").startswith("text/html"):
            watch = Markup("<script>{}</script>").format(Markup(_WATCH))
            page = viser_private.titled(response.body.decode(), self.title, watch)
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
    """Guard the server that viser starts within this context.

    Parameters
    ----------
    names, title, listening :
        As in `Guard`.
    """
    guard = Guard(names, title, listening)
    with _lock, viser_private.serving(guard.serve):
        yield guard


def _are_equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())


def _set_header(message: Any, name: str, value: str) -> None:
    """Set a header to a single value; assignment in websockets would add a second one."""
    if name in message.headers:
        del message.headers[name]
    message.headers[name] = value


def _null_logger() -> logging.Logger:
    """Return a logger without output: malformed requests from outside do not concern the user."""
    logger = logging.getLogger("ftforce.view")
    logger.disabled = True
    return logger


def _as_address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
