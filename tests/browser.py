"""A real browser for tests: Debian's Chromium, driven by Playwright."""

from __future__ import annotations

import base64
import io
import os
import re
from contextlib import contextmanager
from urllib.parse import urlsplit

import numpy as np
import pytest

from ftforce.errors import FtforceError
from ftforce.view.server.screenshot import find_browser

ARGS = (
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
SECONDS = 60.0  # how long anything may take on a busy machine


def needs_browser():
    """Return Chromium's path; without it skip the test, or fail it where all have to run."""
    try:
        import playwright  # noqa: F401

        return find_browser()
    except (ImportError, FtforceError) as problem:
        message = f"needs a browser: {problem}; apt-get install chromium, pip install playwright"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)


class Watched:
    """A page of which everything is noted that it prints and asks for.

    Attributes
    ----------
    page :
        Playwright's.
    errors :
        What the page's console shows as an error, and exceptions.
    requests :
        Every URL, of websockets too.
    """

    def __init__(self, page):
        self.page = page
        self.errors, self.requests = [], []
        page.set_default_timeout(1e3 * SECONDS)
        page.on("console", lambda m: m.type == "error" and self.errors.append(m.text))
        page.on("pageerror", lambda problem: self.errors.append(str(problem)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))

    def hosts(self):
        """Return the hosts that were asked for anything."""
        parts = [urlsplit(url) for url in self.requests]
        return {part.hostname for part in parts if part.scheme not in {"blob", "data", "file"}}

    def pixels(self, **options):
        """Return what the page looks like, shape (h, w, 3)."""
        from PIL import Image

        png = self.page.screenshot(**options)
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))

    def wait_for_scene(self, colours=200, **options):
        """Wait until the page shows a shaded scene; return its pixels."""
        for _ in range(int(4 * SECONDS)):
            pixels = self.pixels(**options)
            if number_of_colours(pixels) > colours:
                return pixels
            self.page.wait_for_timeout(250)
        raise AssertionError(f"no scene was drawn in {SECONDS:g} s; errors: {self.errors}")

    def wait_for_change(self, before, at_least, **options):
        """Wait until so many pixels differ from earlier ones, of the same part of the page."""
        for _ in range(50):
            difference = np.abs(self.pixels(**options).astype(int) - before).sum(axis=2)
            changed = (difference > 30).sum()
            if changed > at_least:
                return
            self.page.wait_for_timeout(200)
        raise AssertionError(f"only {changed} pixels have changed; errors: {self.errors}")


@contextmanager
def chromium():
    """Start Chromium; yield Playwright's browser."""
    needs_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, started(playwright) as browser:
        yield browser


@contextmanager
def started(playwright):
    """Start Chromium with a Playwright that runs already; yield its browser."""
    flags = [*ARGS, "--no-sandbox"] if os.geteuid() == 0 else list(ARGS)
    path = find_browser()
    browser = playwright.chromium.launch(executable_path=path, headless=True, args=flags)
    try:
        yield browser
    finally:
        browser.close()


@contextmanager
def watched(browser, url, width=800, height=500):
    """Open a page in a profile of its own; yield it as `Watched`."""
    context = browser.new_context(viewport={"width": width, "height": height})
    try:
        page = Watched(context.new_page())
        page.page.goto(url)
        yield page
    finally:
        context.close()


def number_of_colours(pixels):
    """Return how many colours a picture has."""
    return len(np.unique(pixels.reshape(-1, 3), axis=0))


def red_box(server):
    """Put a red box into a scene; it fills the middle of the picture."""
    from trimesh.creation import box

    solid = box((1.0, 1.0, 1.0))
    server.scene.add_mesh_simple(
        "/box",
        solid.vertices,
        solid.faces,
        color=(200, 30, 30),
        cast_shadow=False,
        receive_shadow=False,
    )
    server.initial_camera.position = (3.0, 1.0, 1.0)
    server.initial_camera.look_at = (0.0, 0.0, 0.0)
    server.initial_camera.fov = 0.7


def reds(pixels):
    """Return which pixels are red."""
    return (pixels[..., 0] > 100) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)


def recorded(page):
    """Return the messages that a page for a file holds, each with its time, and its length, s."""
    import msgspec
    import zstandard

    data = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', page)[1])
    inner = zstandard.ZstdDecompressor().decompress(data[8:], int.from_bytes(data[:8], "little"))
    length = int.from_bytes(inner[:8], "little")
    content = msgspec.msgpack.decode(inner[8 : 8 + length])
    return content["messages"], content["durationSeconds"]
