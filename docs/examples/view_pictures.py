"""Draw the pictures of the guide to `ftforce view`: whole pages, in Debian's Chromium.

``python docs/examples/view_pictures.py`` writes ``view-*.png`` into the current folder, or that of
``--output FOLDER``; it needs the extra ``view``, Playwright and Chromium.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image
from playwright.sync_api import sync_playwright

from ftforce.view.server.screenshot import find_browser

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SIZE = {"width": 1280, "height": 800}
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
DRAWN = 4000  # ms after the last click

PAGES = {
    "view-locked": "panda --locked 4 --force 0,0,50 --limits urdf",
    "view-lost": "dh5 --locked 2,4,5 --force 80,50,10",
    "view-census": "panda --force 0,0,50",
    "view-moments": "panda --task wrench --locked 1,4 --force 0,40,40,6,0,8",
    "view-history": "dh5 --history run.npz --at 70",
    "view-sweep": "panda --sweep panda.zarr",
}
TABS = {"view-census": "Census"}
FILES = [
    "simulate --paper -o run.npz",
    "sweep panda --samples 20000 --faults 2 --force 0,0,50 --keep all -o panda.zarr",
]


def ftforce(words: str, folder: Path) -> subprocess.Popen[str]:
    """Start a command of ftforce in a folder."""
    command = [sys.executable, "-m", "ftforce", *words.split()]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)


def draw(browser: Browser, name: str, folder: Path, output: Path) -> None:
    """Open a page, wait until it is drawn, and write it as a picture."""
    server = ftforce(f"view {PAGES[name]} --no-browser", folder)
    try:
        assert server.stdout is not None
        address = re.search(r"http://\S+", server.stdout.readline())
        assert address is not None
        page = browser.new_page(viewport=SIZE)
        page.goto(address[0])
        wait_until_drawn(page, TABS.get(name))
        picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        # A third of the bytes; the colours of keys and verdicts are few, and have to stay.
        few = picture.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        few.save(output / f"{name}.png", optimize=True)
        page.close()
    finally:
        server.terminate()
        server.wait()


def wait_until_drawn(page: Page, tab: str | None) -> None:
    """Wait for the answer, choose a tab, and let the scene come to rest."""
    page.get_by_test_id("verdict").first.wait_for(timeout=60_000)
    for notice in page.locator(".mantine-Notification-closeButton").all():
        notice.click()  # that there is no GPU
    if tab is not None:
        page.get_by_role("tab", name=tab).click()
    page.wait_for_timeout(DRAWN)


def main() -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--output", type=Path, default=Path())
    parser.add_argument("names", nargs="*", default=list(PAGES))
    chosen = parser.parse_args()
    flags = [*FLAGS, "--no-sandbox"] if os.geteuid() == 0 else FLAGS
    with tempfile.TemporaryDirectory() as work, sync_playwright() as playwright:
        for words in FILES:
            assert ftforce(words, Path(work)).wait() == 0
        browser = playwright.chromium.launch(executable_path=find_browser(), args=flags)
        for name in chosen.names:
            draw(browser, name, Path(work), chosen.output)
        browser.close()


if __name__ == "__main__":
    main()
