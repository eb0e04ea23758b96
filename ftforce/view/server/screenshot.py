"""The scene as an image, rendered by a headless browser."""

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
_MAX_SIDE = 8192  # px

_MAC_PATHS = (
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
    "--disable-dev-shm-usage",  # the 64 MB of a container's /dev/shm are too small
    "--password-store=basic",
    "--use-mock-keychain",
    # Software rendering: works without a GPU, and gives the same image on all machines.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-proxy-server",
)
_EXIT_TIMEOUT = 5.0  # s for the browser to exit
_MAX_FOLDER = 50  # socket paths are limited to 104 bytes on macOS; Chromium needs 45
_POLL_INTERVAL = 0.05  # s between polls
_MAX_IMAGES = 6  # attempts to obtain two equal images in a row


def screenshot(
    server: viser.ViserServer,
    address: str,
    width: int = 1280,
    height: int = 800,
    *,
    seconds: float = 120.0,
) -> bytes:
    """Return the scene as a PNG on white, rendered by a browser started for this purpose.

    Parameters
    ----------
    server, address :
        Server of the scene, and URL of its page.
    width, height :
        Image size, px.
    seconds :
        Total time limit, s.

    Raises
    ------
    FtforceError
        No browser is found, or rendering exceeds the time limit.
    InputError
        The image size is invalid.
    """
    if not (1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE):
        raise InputError(
            f"an image must be 1 to {_MAX_SIDE} px wide and high, got {width} x {height}"
        )
    end = time.monotonic() + seconds
    before = set(server.get_clients())
    with _browser(find_browser(), address, width, height) as process:
        client = _connected(server, before, process, end)
        return _png(_settled(client, width, height, end))


def render_png(
    client: Any, width: int | None = None, height: int | None = None, *, seconds: float = 60.0
) -> bytes:
    """Return the scene as seen in a tab, as a PNG on white.

    Parameters
    ----------
    client :
        viser's handle of the tab.
    width, height :
        Image size, px; by default that of the tab.
    seconds :
        Time limit, s.

    Raises
    ------
    FtforceError
        The tab was closed, or rendering exceeds the time limit.
    """
    camera = client.camera
    size = width or camera.image_width, height or camera.image_height
    return _png(_render(client, *size, time.monotonic() + seconds))


def find_browser() -> str:
    """Return the path of a Chromium-based browser.

    Raises
    ------
    FtforceError
        None is found; the message lists the places searched.
    """
    for name in BROWSERS:
        if found := shutil.which(name):
            return found
    for path in _MAC_PATHS:
        if Path(path).is_file():
            return path
    raise FtforceError(
        f"a screenshot requires Chromium or Chrome; not found on PATH: {', '.join(BROWSERS)}"
    )


@contextmanager
def _browser(
    executable: str, address: str, width: int, height: int
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a browser with a temporary profile; terminate it with all its child processes."""
    with tempfile.TemporaryDirectory(prefix="ftforce-", ignore_cleanup_errors=True) as folder:
        flags = [*_FLAGS, f"--window-size={width},{height}", f"--user-data-dir={folder}/profile"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            flags.append("--no-sandbox")  # Chromium's sandbox does not work as root
        scratch = {"XDG_CONFIG_HOME": folder, "XDG_CACHE_HOME": folder}
        if len(folder) <= _MAX_FOLDER:
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
            process.wait(_EXIT_TIMEOUT)
            break
    _signal(process, getattr(signal, "SIGKILL", signal.SIGTERM))  # remaining child processes


def _signal(process: subprocess.Popen[bytes], number: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, number)  # its own process group: see start_new_session
        else:
            process.send_signal(number)


def _connected(
    server: viser.ViserServer, before: set[int], process: subprocess.Popen[bytes], end: float
) -> Any:
    """Return the tab of the started browser as soon as it connects."""
    while True:
        new = [client for key, client in server.get_clients().items() if key not in before]
        if new:
            return new[0]
        if process.poll() is not None:
            raise FtforceError(f"the browser exited unexpectedly (status {process.returncode})")
        if time.monotonic() > end:
            raise FtforceError("the browser did not open the page in time")
        time.sleep(_POLL_INTERVAL)


def _settled(client: Any, width: int, height: int, end: float) -> NDArray[np.uint8]:
    """Return an image once two in a row are equal: meshes load one after the other."""
    last = _render(client, width, height, end)
    for _ in range(_MAX_IMAGES):
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
        raise FtforceError(f"the browser did not render the image ({problem})") from None
    return picture


def _png(picture: NDArray[np.uint8]) -> bytes:
    """Return an RGBA image, shape (h, w, 4), as a PNG on white."""
    from PIL import Image

    opacity = picture[..., 3:].astype(np.float32) / 255.0
    on_white = picture[..., :3] * opacity + 255.0 * (1.0 - opacity)
    stream = io.BytesIO()
    Image.fromarray(np.rint(on_white).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()
