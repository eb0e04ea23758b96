"""A viser server that only its own page can access, from startup to shutdown."""

from __future__ import annotations

import contextlib
import errno
import io
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError, InputError, printable
from ftforce.view import NEEDS_EXTRA
from ftforce.view.server.guard import guarding, is_loopback, names_of
from ftforce.view.server.viser_private import changed, close_tunnel

if TYPE_CHECKING:
    import viser

    from ftforce.view.server.guard import Guard

FIRST_PORT = 8080
_MAX_PORTS = 100  # ports tried before leaving the choice to the system
_BRAND = (30, 90, 160)


@dataclass(frozen=True, slots=True, eq=False)
class OpenServer:
    """An open server.

    Attributes
    ----------
    server :
        The viser server.
    address :
        URL of the page for a browser on this machine, with its token.
    port :
        Listening port.
    warning :
        Warning about the listening address; empty if only this machine can reach it.
    """

    server: viser.ViserServer
    address: str
    port: int
    warning: str
    _guard: Guard

    def address_for_browser(self) -> str:
        """Return a URL of the page that is good for one request.

        A browser started with it gets the page; other users, who can see the arguments of its
        process, then do not.
        """
        return self.address.replace(self._guard.token, self._guard.ticket())

    def close(self) -> None:
        """Close the server and all connections, suppressing viser's output."""
        self._guard.abort_idle()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_server(
    host: str = "127.0.0.1", port: int | None = None, *, title: str = "ftforce"
) -> OpenServer:
    """Open a server with an empty page.

    Parameters
    ----------
    host :
        Address to listen on. Except for loopback addresses, nothing that is sent is protected from
        others on the network.
    port :
        Port to listen on; ``None`` for the first free one from 8080, 0 for any.
    title :
        Page title.

    Raises
    ------
    InputError
        The host is not an address of this machine, or the port is in use.
    FtforceError
        viser is not installed, or its version cannot be guarded.
    """
    if port is not None and not 0 <= port <= 65535:
        raise InputError(f"the port must be from 0 (any free one) to 65535, got {port}")
    viser = _viser()
    listening = _listening(host, port)
    address, found, *_ = listening.getsockname()
    here = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.ExitStack() as cleanup:
        cleanup.callback(listening.close)
        with guarding(names_of(host), title, listening) as guard:
            server = viser.ViserServer(host=address, port=found, verbose=False)
        cleanup.pop_all()  # now owned by the server
    place = f"[{here}]:{found}" if ":" in here else f"{here}:{found}"
    address = f"http://{place}/?token={guard.token}"
    opened = OpenServer(server, address, found, exposure(host), guard)
    try:
        _check(guard, (here, found), place)
        close_tunnel(server)
        _set_up(server)
    except BaseException:
        opened.close()
        raise
    return opened


def exposure(host: str) -> str:
    """Return a warning about a listening address; empty if only this machine can reach it."""
    if is_loopback(host):
        return ""
    return (
        f"anyone who can reach {printable(host)} and knows the token in the address can see and "
        "control this page; nothing is encrypted, so those on the network may read the token"
    )


def _set_up(server: viser.ViserServer) -> None:
    gui, scene = server.gui, server.scene
    gui.configure_theme(
        show_share_button=False, show_logo=False, control_width="large", brand_color=_BRAND
    )
    gui.set_panel_label("ftforce")
    # No shadows or environment map: they take seconds without a GPU.
    scene.world_axes.visible = False
    scene.configure_environment_map(None)
    scene.configure_default_lights(True, cast_shadow=False)
    scene.add_light_ambient("/ambient", intensity=1.5)  # otherwise the arm is black from below


def _viser() -> Any:
    try:
        import viser
    except ImportError:
        raise FtforceError(NEEDS_EXTRA) from None
    return viser


# ---- address and port ------------------------------------------------------------------------


def _listening(host: str, port: int | None) -> socket.socket:
    """Return a listening socket; viser would retry forever, or use another port."""
    name = "127.0.0.1" if host == "localhost" else host
    ports = [*range(FIRST_PORT, FIRST_PORT + _MAX_PORTS), 0] if port is None else [port]
    try:
        family, *_, place = socket.getaddrinfo(name, 0, type=socket.SOCK_STREAM)[0]
        for number in ports[:-1]:
            with contextlib.suppress(OSError):
                return socket.create_server((str(place[0]), number), family=family)
        return socket.create_server((str(place[0]), ports[-1]), family=family)
    except (OSError, UnicodeError) as problem:
        raise _refused(host, port, getattr(problem, "errno", None)) from None


def _refused(host: str, port: int | None, reason: int | None) -> InputError:
    """Return the error for an address on which the server cannot listen."""
    if reason == errno.EACCES:
        message = f"port {port} requires administrator privileges; choose one from 1024 to 65535"
    elif reason == errno.EADDRINUSE:
        message = (
            f"port {port} of {printable(host)} is in use; stop the program that uses it, choose "
            "another --port, or omit it to use the first free one"
        )
    else:
        message = (
            f"{printable(host)!r} is not an address of this machine; "
            "use 127.0.0.1, or 0.0.0.0 for all of its addresses"
        )
    return InputError(message)


# ---- check of the guard ----------------------------------------------------------------------


def _check(guard: Guard, address: tuple[str, int], own: str) -> None:
    """Send requests as an outsider would; fail unless they are refused.

    Parameters
    ----------
    guard :
        The server's guard.
    address :
        Address and port of the server.
    own :
        The server's own Host header.

    Raises
    ------
    FtforceError
        viser has changed, and unauthorized clients could connect.
    """
    connect = (
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        f"Sec-WebSocket-Protocol: {guard.protocol}\r\n"
    )
    known = f"Cookie: {guard.cookie}\r\n"
    outsiders = (
        f"Host: ftforce.invalid\r\n{known}",
        f"Host: {own}\r\n{known}{connect}",
        f"Host: {own}\r\nOrigin: http://ftforce.invalid\r\n{known}{connect}",
        f"Host: {own}\r\n",
        f"Host: {own}\r\nOrigin: http://{own}\r\n{connect}",
    )
    if not guard.is_used or not all(_is_refused(address, headers) for headers in outsiders):
        raise changed("cannot be protected from other web pages")


def _is_refused(address: tuple[str, int], headers: str) -> bool:
    with socket.create_connection(address, timeout=10.0) as connection:
        connection.sendall(f"GET / HTTP/1.1\r\n{headers}\r\n".encode())
        return connection.recv(64).startswith(b"HTTP/1.1 403 ")
