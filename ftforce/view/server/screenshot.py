"""The scene as a picture, drawn by a browser that nobody sees."""

from __future__ import annotations

import io
import os
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.errors import FtforceError, InputError, printable

if TYPE_CHECKING:
    from collections.abc import Iterator

    import viser
    from numpy.typing import NDArray

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
)
LARGEST_SIDE = 8192  # px

_ON_MAC = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
)
_FLAGS = (
    "--headless=new",
    "--hide-scrollbars",
    "--mute-audio",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--disable-quic",
    "--disable-dev-shm-usage",  # 64 MB in a container are too few
    "--password-store=basic",
    "--use-mock-keychain",
    # Without a GPU; pictures are then also the same everywhere.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-proxy-server",
)
_PATIENCE = 5.0  # s for a browser that is told to end
_LONGEST_FOLDER = 50  # a socket's path has 104 bytes on macOS, of which Chromium takes 45
_STEP = 0.05  # s between two looks
_MOST_PICTURES = 6  # until two in a row are the same


def screenshot(
    server: viser.ViserServer,
    address: str,
    width: int = 1280,
    height: int = 800,
    *,
    seconds: float = 120.0,
) -> bytes:
    """Return the scene as a PNG on white, drawn by a browser that is started for it.

    Parameters
    ----------
    server, address :
        What is drawn, and where its page is.
    width, height :
        Of the picture, px.
    seconds :
        How long it may take in all.

    Raises
    ------
    FtforceError
        There is no browser, or it does not draw in this time.
    InputError
        The size is none of a picture.
    """
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise InputError(f"a picture has 1 to {LARGEST_SIDE} px a side, got {width} x {height}")
    end = time.monotonic() + seconds
    before = set(server.get_clients())
    with _browser(find_browser(), address, width, height) as process:
        client = _connected(server, before, process, end)
        return _png(_settled(client, width, height, end))


def render_png(
    client: Any, width: int | None = None, height: int | None = None, *, seconds: float = 60.0
) -> bytes:
    """Return the scene as a tab sees it, as a PNG on white.

    Parameters
    ----------
    client :
        viser's handle of the tab.
    width, height :
        Of the picture, px; the tab's own if not given.
    seconds :
        How long it may take.

    Raises
    ------
    FtforceError
        The tab is gone, or does not draw in this time.
    """
    camera = client.camera
    size = width or camera.image_width, height or camera.image_height
    return _png(_render(client, *size, time.monotonic() + seconds))


def find_browser() -> str:
    """Return the path of Chromium or one of its kin.

    Raises
    ------
    FtforceError
        There is none; the message says where it was looked for.
    """
    for name in BROWSERS:
        if found := shutil.which(name):
            return found
    for path in _ON_MAC:
        if Path(path).is_file():
            return path
    raise FtforceError(
        f"a screenshot needs Chromium or Chrome; none of {', '.join(BROWSERS)} is on PATH"
    )


@contextmanager
def _browser(
    executable: str, address: str, width: int, height: int
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a browser that leaves nothing behind, and end it with all processes of its own."""
    with tempfile.TemporaryDirectory(prefix="ftforce-", ignore_cleanup_errors=True) as folder:
        flags = [*_FLAGS, f"--window-size={width},{height}", f"--user-data-dir={folder}/profile"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            flags.append("--no-sandbox")  # its sandbox does not work for root
        scratch = {"XDG_CONFIG_HOME": folder, "XDG_CACHE_HOME": folder}
        if len(folder) <= _LONGEST_FOLDER:
            scratch["TMPDIR"] = folder
        try:
            process = subprocess.Popen(
                [executable, *flags, address],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **scratch},
                start_new_session=True,
            )
        except OSError as problem:
            reason = problem.strerror or str(problem)
            raise FtforceError(f"{printable(executable)} cannot be started ({reason})") from None
        try:
            yield process
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    for number in (signal.SIGTERM, getattr(signal, "SIGKILL", signal.SIGTERM)):
        _signal(process, number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
            break
    _signal(process, getattr(signal, "SIGKILL", signal.SIGTERM))  # children that are left


def _signal(process: subprocess.Popen[bytes], number: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, number)  # its own group: see start_new_session
        else:
            process.send_signal(number)


def _connected(
    server: viser.ViserServer, before: set[int], process: subprocess.Popen[bytes], end: float
) -> Any:
    """Return the tab of our browser, as soon as it is there."""
    while True:
        new = [client for key, client in server.get_clients().items() if key not in before]
        if new:
            return new[0]
        if process.poll() is not None:
            raise FtforceError(f"the browser ended by itself (status {process.returncode})")
        if time.monotonic() > end:
            raise FtforceError("the browser did not open the page in time")
        time.sleep(_STEP)


def _settled(client: Any, width: int, height: int, end: float) -> NDArray[np.uint8]:
    """Return the picture that follows itself: meshes come into the scene one after the other."""
    last = _render(client, width, height, end)
    for _ in range(_MOST_PICTURES):
        picture = _render(client, width, height, end)
        if picture[..., 3].any() and np.array_equal(picture, last):
            break
        last = picture
    return picture


def _render(client: Any, width: int, height: int, end: float) -> NDArray[np.uint8]:
    seconds = max(end - time.monotonic(), 0.1)
    try:
        picture: NDArray[np.uint8] = client.get_render(
            height, width, transport_format="png", timeout=seconds
        )
    except (TimeoutError, RuntimeError) as problem:
        raise FtforceError(f"the browser drew no picture ({problem})") from None
    return picture


def _png(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture with transparency, shape (h, w, 4), as a PNG on white."""
    from PIL import Image

    opacity = picture[..., 3:].astype(np.float32) / 255.0
    on_white = picture[..., :3] * opacity + 255.0 * (1.0 - opacity)
    stream = io.BytesIO()
    Image.fromarray(np.rint(on_white).astype(np.uint8)).save(stream, "PNG", optimize=True)
    return stream.getvalue()
