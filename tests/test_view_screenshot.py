"""The scene as a picture: by a browser that is started for it, and leaves nothing behind."""

import io
import os
import stat
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from browser import needs_browser, red_box, reds
from ftforce.errors import FtforceError, InputError
from ftforce.view.server import screenshot as module
from ftforce.view.server.screenshot import find_browser, render_png, screenshot
from ftforce.view.server.server import open_server


@pytest.fixture(scope="module")
def opened():
    with closing(open_server(port=0)) as opened:
        red_box(opened.server)
        yield opened


def pixels_of(png):
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        assert (image.format, image.mode) == ("PNG", "RGB")
        return np.asarray(image)


def commands_with(path):
    """Return the processes in whose command line a path stands."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if str(path).encode() in (process / "cmdline").read_bytes():
                found.append(process.name)
        except OSError:  # it has ended
            continue
    return found


def left_behind(folder):
    """Return scratch folders, and processes that work in one."""
    return [path.name for path in folder.iterdir()] + commands_with(folder)


@pytest.fixture
def scratch(monkeypatch):
    """Have everything that is temporary in a folder of its own, with a short name."""
    with tempfile.TemporaryDirectory() as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        yield Path(folder)


@pytest.mark.browser
def test_the_scene_is_drawn_on_white_twice_the_same_and_nothing_is_left(opened, scratch, capfd):
    needs_browser()
    pixels = pixels_of(screenshot(opened.server, opened.address, 480, 320))
    assert pixels.shape == (320, 480, 3)
    assert (pixels[0, 0] == 255).all()
    red = reds(pixels)
    assert 0.05 < red.mean() < 0.6
    assert np.argwhere(red).mean(axis=0) == pytest.approx([160, 240], abs=15)
    assert (pixels == pixels_of(screenshot(opened.server, opened.address, 480, 320))).all()
    assert left_behind(scratch) == []
    assert capfd.readouterr() == ("", "")


def script(folder, text):
    """Return a program that takes a browser's place."""
    path = folder / "chromium"
    path.write_text(f"#!{sys.executable}\n{text}")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.fixture
def instead(tmp_path, monkeypatch):
    """Put a program where the browser is looked for."""

    def put(text):
        path = script(tmp_path, text)
        monkeypatch.setattr(module, "find_browser", lambda: str(path))
        return path

    return put


def test_a_browser_that_ends_is_an_error(opened, instead, scratch):
    instead("import sys; sys.exit(7)")
    with pytest.raises(FtforceError, match=r"exited unexpectedly \(status 7\)"):
        screenshot(opened.server, opened.address)
    assert left_behind(scratch) == []


@pytest.mark.thorough
@pytest.mark.parametrize("deaf", ["True", "len(sys.argv) == 2"])
def test_a_browser_that_does_nothing_is_ended_in_time(opened, instead, scratch, monkeypatch, deaf):
    # Its child, or both, ignore the polite signal.
    path = instead(
        "import signal, subprocess, sys, time\n"
        f"if {deaf}: signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "if len(sys.argv) > 2: subprocess.Popen([sys.executable, __file__, 'child'])\n"
        "time.sleep(600)\n"
    )
    monkeypatch.setattr(module, "_EXIT_TIMEOUT", 0.5)
    with pytest.raises(FtforceError, match="did not open the page in time"):
        screenshot(opened.server, opened.address, seconds=1.0)
    assert left_behind(scratch) == []
    end = time.monotonic() + 10.0
    while (running := commands_with(path)) and time.monotonic() < end:
        time.sleep(0.05)
    assert running == []


def test_a_browser_that_cannot_be_started_is_an_error(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "find_browser", lambda: str(tmp_path))
    with pytest.raises(FtforceError, match="cannot be started"):
        screenshot(opened.server, opened.address)


def test_a_browser_that_draws_nothing_is_an_error():
    class Tab:
        camera = None

        def get_render(self, *_, **__):
            raise TimeoutError("late")

    with pytest.raises(FtforceError, match=r"did not render the image \(late\)"):
        render_png(Tab(), 10, 10)


def test_a_tabs_own_picture_has_its_size_and_lies_on_white():
    class Tab:
        class camera:  # noqa: N801 # viser's
            image_width, image_height = 30, 20

        def get_render(self, height, width, **_):
            picture = np.zeros((height, width, 4), dtype=np.uint8)
            picture[..., 0], picture[:, 15:, 3] = 200, 128
            return picture

    pixels = pixels_of(render_png(Tab()))
    assert pixels.shape == (20, 30, 3)
    assert (pixels[:, :15] == 255).all()
    assert np.abs(pixels[:, 15:].astype(int) - [227, 127, 127]).max() <= 1
    assert pixels_of(render_png(Tab(), 8, 4)).shape == (4, 8, 3)


def test_pictures_are_taken_until_nothing_changes():
    class Tab:
        def __init__(self, *values):
            self.values, self.taken = list(values), 0

        def get_render(self, height, width, **_):
            value = self.values[min(self.taken, len(self.values) - 1)]
            self.taken += 1
            return np.full((height, width, 4), value, dtype=np.uint8)

    end = time.monotonic() + 10.0
    tab = Tab(0, 0, 50, 100)
    assert module._settled(tab, 2, 2, end)[0, 0, 0] == 100
    assert tab.taken == 5
    restless = Tab(*range(100))
    module._settled(restless, 2, 2, end)
    assert restless.taken == 1 + module._MAX_IMAGES


def test_no_browser_is_an_error_of_one_line(monkeypatch, opened):
    monkeypatch.setenv("PATH", os.devnull)
    monkeypatch.setattr(module, "_MAC_PATHS", ())
    with pytest.raises(
        FtforceError, match="requires Chromium or Chrome; not found on PATH: "
    ) as found:
        screenshot(opened.server, opened.address)
    assert "\n" not in str(found.value)


def test_the_browser_is_found_by_its_names(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    for name in reversed(module.BROWSERS):
        script(tmp_path, "").rename(tmp_path / name)
        assert find_browser() == str(tmp_path / name)
    monkeypatch.setenv("PATH", os.devnull)
    monkeypatch.setattr(module, "_MAC_PATHS", (str(tmp_path / "chromium"),))
    assert find_browser() == str(tmp_path / "chromium")


@pytest.mark.parametrize("size", [(0, 10), (10, -1), (10_000, 10)])
def test_a_size_that_is_none_is_an_error(opened, size):
    with pytest.raises(InputError, match="1 to 8192 px wide and high"):
        screenshot(opened.server, opened.address, *size)


@pytest.mark.parametrize("user", [0, 1000])
def test_only_root_goes_without_a_sandbox(instead, tmp_path, monkeypatch, user):
    instead(f"import sys; open({str(tmp_path / 'flags')!r}, 'w').write(' '.join(sys.argv))")
    monkeypatch.setattr(os, "geteuid", lambda: user)
    with module._browser(module.find_browser(), "http://a/", 30, 20) as process:
        process.wait(20)
    flags = (tmp_path / "flags").read_text().split()
    assert ("--no-sandbox" in flags) == (user == 0)
    assert "--window-size=30,20" in flags
    assert flags[-1] == "http://a/"
