"""A viser server that only its own page can talk to, from its start to its end."""

from __future__ import annotations

import contextlib
import io
import os
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError, InputError, printable
from ftforce.view.guard import guarding, is_loopback, names_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    import viser

    from ftforce.view.guard import Guard

FIRST_PORT = 8080
_MOST_PORTS = 100  # how many are tried before the system chooses
_OVERRIDE = "_VISER_PORT_OVERRIDE"  # would win over the port that we checked
_BRAND = (30, 90, 160)


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A server that is open.

    Attributes
    ----------
    server :
        viser's.
    address :
        Where a browser on this machine finds the page, with a slash at its end.
    port :
        Where it listens.
    warning :
        What a user should know of the address it listens on; empty if only this machine reaches
        it.
    """

    server: viser.ViserServer
    address: str
    port: int
    warning: str
    _guard: Guard

    def close(self) -> None:
        """Close the server and all connections; what viser prints is not shown."""
        self._guard.hang_up()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_server(
    host: str = "127.0.0.1", port: int | None = None, *, title: str = "ftforce"
) -> Opened:
    """Open a page that is empty yet.

    Parameters
    ----------
    host :
        Address to listen on. From others than loopback everybody who reaches it can use the page.
    port :
        Port to listen on; ``None`` for the first one from 8080 that is free, 0 for any.
    title :
        Of the page.

    Raises
    ------
    InputError
        The host is none of this machine's, or the port is taken.
    FtforceError
        viser is missing, or is a version that cannot be guarded.
    """
    if port is not None and not 0 <= port <= 65535:
        raise InputError(f"a port is a number from 1 to 65535, got {port}")
    viser = _viser()
    family, address = _resolved(host)
    chosen = _free_port(family, address, host) if port is None else port
    if port:
        _check_free(family, address, port, host)
    with (
        guarding(names_of(host), title) as guard,
        contextlib.redirect_stdout(io.StringIO()),
        _without_override(),
    ):
        server = viser.ViserServer(host=address, port=chosen, verbose=False)
    try:
        found = server.get_port()
        if port and found != port:  # somebody took it just now
            raise _taken(port, host)
        here = _reached_at(address)
        _check(guard, here, found)
        _close_tunnel(server)
        _set_up(server)
    except BaseException:
        Opened(server, "", 0, "", guard).close()
        raise
    return Opened(server, f"http://{_in_url(here)}:{found}/", found, exposure(host), guard)


def exposure(host: str) -> str:
    """Return a warning about an address to listen on; empty if only this machine reaches it."""
    if is_loopback(host):
        return ""
    return (
        f"everybody who reaches {printable(host)} can see and change what this page shows, "
        "without a password and unencrypted"
    )


def set_scene_defaults(server: viser.ViserServer) -> None:
    """Set light: without shadows and surroundings, which cost seconds where there is no GPU."""
    scene = server.scene
    scene.world_axes.visible = False
    scene.configure_environment_map(None)
    scene.configure_default_lights(True, cast_shadow=False)
    scene.add_light_ambient("/ambient", intensity=1.5)  # or the arm is black from below


def _set_up(server: viser.ViserServer) -> None:
    gui = server.gui
    gui.configure_theme(
        show_share_button=False, show_logo=False, control_width="large", brand_color=_BRAND
    )
    gui.set_panel_label("ftforce")
    set_scene_defaults(server)


def _viser() -> Any:
    try:
        import viser
    except ImportError:
        raise FtforceError("the page needs the extra `view`: pip install 'ftforce[view]'") from None
    return viser


# ---- address and port ------------------------------------------------------------------------


def _resolved(host: str) -> tuple[socket.AddressFamily, str]:
    """Return the address of a host: viser tries for ever to listen on one that is not ours."""
    name = "127.0.0.1" if host == "localhost" else host
    try:
        found = socket.getaddrinfo(name, 0, type=socket.SOCK_STREAM)
        family, *_, place = found[0]
        address = str(place[0])
        with _bound(family, address, 0):
            pass
    except (OSError, UnicodeError):
        raise InputError(
            f"{printable(host)!r} is no address of this machine; "
            "give 127.0.0.1, or 0.0.0.0 for all of its addresses"
        ) from None
    return family, address


@contextlib.contextmanager
def _bound(family: socket.AddressFamily, address: str, port: int) -> Iterator[socket.socket]:
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        if os.name == "posix":  # as asyncio does: a port that was closed just now is free
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, port))
        probe.listen(1)
        yield probe


def _free_port(family: socket.AddressFamily, address: str, host: str) -> int:
    for port in range(FIRST_PORT, FIRST_PORT + _MOST_PORTS):
        with contextlib.suppress(InputError):
            _check_free(family, address, port, host)
            return port
    return 0


def _check_free(family: socket.AddressFamily, address: str, port: int, host: str) -> None:
    try:
        with _bound(family, address, port):
            pass
    except PermissionError:
        raise InputError(
            f"port {port} needs an administrator's rights; give one from 1024 to 65535"
        ) from None
    except OSError:
        raise _taken(port, host) from None


def _taken(port: int, host: str) -> InputError:
    return InputError(
        f"port {port} of {printable(host)} is taken; end the program that uses it, give another "
        "--port, or none for the first one that is free"
    )


@contextlib.contextmanager
def _without_override() -> Iterator[None]:
    saved = os.environ.pop(_OVERRIDE, None)
    try:
        yield
    finally:
        if saved is not None:
            os.environ[_OVERRIDE] = saved


def _reached_at(address: str) -> str:
    """Return the address at which this machine finds a server that listens on ``address``."""
    return {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)


def _in_url(address: str) -> str:
    return f"[{address}]" if ":" in address else address


# ---- does the guard stand? -------------------------------------------------------------------


def _check(guard: Guard, address: str, port: int) -> None:
    """Ask as strangers would; fail unless they are refused.

    Raises
    ------
    FtforceError
        viser has changed, and anybody could connect.
    """
    own = f"{_in_url(address)}:{port}"
    connect = (
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        f"Sec-WebSocket-Protocol: {guard.protocol}\r\n"
    )
    strangers = (
        "Host: ftforce.invalid\r\n",
        f"Host: {own}\r\n{connect}",
        f"Host: {own}\r\nOrigin: http://ftforce.invalid\r\n{connect}",
    )
    if not guard.is_used or not all(_is_refused(address, port, one) for one in strangers):
        import viser

        raise FtforceError(
            f"viser {viser.__version__} cannot be guarded against other web pages; install the "
            "one that ftforce was tested with: pip install 'ftforce[view]'"
        )


def _is_refused(address: str, port: int, headers: str) -> bool:
    with socket.create_connection((address, port), timeout=10.0) as connection:
        connection.sendall(f"GET / HTTP/1.1\r\n{headers}\r\n".encode())
        return connection.recv(64).startswith(b"HTTP/1.1 403 ")


def _close_tunnel(server: Any) -> None:
    """Take away what a page could ask for: a tunnel that makes the server public.

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
        raise FtforceError(
            f"viser {viser.__version__} does not let its public tunnel be closed; install the one "
            "that ftforce was tested with: pip install 'ftforce[view]'"
        ) from None
