"""The page as one file: it opens by itself, shows the arm and the answer, and asks nobody."""

import json

import numpy as np
import pytest

from browser import chromium, number_of_colours, watched
from ftforce.errors import FtforceError
from ftforce.source import write_whole
from ftforce.view import export, shapes
from ftforce.view.export import PANEL_WIDTH, record, scene_html
from ftforce.view.server import open_server

ANSWER = '<h2 data-testid="verdict">the fault is tolerated</h2><p>&lt;b&gt;no markup&lt;/b&gt;</p>'
TITLE = "ftforce: </title><script>document.body.remove()</script>"


@pytest.fixture(scope="module")
def opened():
    """Open a server with a red box that fills the middle of the picture."""
    opened = open_server(port=0)
    solid = shapes.box(1.0, 1.0, 1.0)
    opened.server.scene.add_mesh_simple(
        "/box", solid.vertices, solid.faces, color=(200, 30, 30), cast_shadow=False,
        receive_shadow=False,
    )  # fmt: skip
    opened.server.initial_camera.position = (3.0, 1.0, 1.0)
    opened.server.initial_camera.look_at = (0.0, 0.0, 0.0)
    opened.server.initial_camera.fov = 0.7
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def page(opened):
    return scene_html(opened.server, title=TITLE, answer_html=ANSWER)


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


def redness(pixels):
    """Return how many pixels are red, and the middle of them."""
    red = (pixels[..., 0] > 100) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)
    places = np.argwhere(red)
    return len(places), places.mean(axis=0) if len(places) else np.full(2, np.nan)


SCENE = {"x": PANEL_WIDTH, "y": 0, "width": 800 - PANEL_WIDTH, "height": 500}


# ---- as text ---------------------------------------------------------------------------------


def test_the_page_names_no_other_host_to_load_from(page):
    policy = page[page.index("Content-Security-Policy") :][:400]
    assert "default-src &#x27;none&#x27;" in policy
    assert "http" not in policy[: policy.index('">')].replace("http-equiv", "")
    assert page.index("Content-Security-Policy") < page.index("<script")
    assert "<title>Viser</title>" not in page


def test_the_answer_is_in_it_as_it_is_and_the_title_as_text(page):
    assert page.count(ANSWER) == 1
    assert page.count("<script>document.body.remove()") == 0
    assert "<title>ftforce: &lt;/title&gt;" in page


def test_another_page_of_visers_is_an_error_in_words(opened, monkeypatch):
    class Other:
        def as_html(self):
            return "<html><head></head><body></body></html>"

    with pytest.raises(FtforceError, match="viser's page is not as expected"):
        scene_html(opened.server, title="a", answer_html="b", recording=Other())
    with pytest.raises(FtforceError, match="viser's page is not as expected"):
        scene_html(opened.server, title="a", answer_html="b", recording=Other(), without=["/a"])


def test_a_recording_shows_every_frame(opened):
    shown = []
    recording = record(opened.server, range(5), 0.25, shown.append)
    assert shown == [0, 1, 2, 3, 4]
    still = scene_html(opened.server, title="a", answer_html="b")
    played = scene_html(opened.server, title="a", answer_html="b", recording=recording)
    assert len(played) > 0.9 * len(still)
    assert recording._time == pytest.approx(1.25)


# ---- in a browser ----------------------------------------------------------------------------


@pytest.mark.browser
def test_the_file_opens_by_itself(page, browser, tmp_path):
    path = write_whole(tmp_path / "scene.html", page)
    with watched(browser, path.as_uri()) as shown:
        shown.wait_for_scene(20, clip=SCENE)
        pixels = shown.pixels()
        count, middle = redness(pixels)
        # The scene is beside the answer, not behind it: the box is in the middle of what is left.
        assert count > 2000
        assert middle[1] == pytest.approx((PANEL_WIDTH + 800) / 2, abs=25)
        assert middle[0] == pytest.approx(250, abs=25)
        assert shown.page.title() == TITLE
        verdict = shown.page.get_by_test_id("verdict")
        assert verdict.is_visible()
        assert verdict.inner_text() == "the fault is tolerated"
        box = shown.page.locator("#ftforce-answer").bounding_box()
        assert (box["x"], box["width"]) == (0, PANEL_WIDTH)
        assert "<b>no markup</b>" in shown.page.locator("#ftforce-answer").inner_text()
        assert not shown.page.locator(".mantine-Notifications-root").first.is_visible()
        assert shown.errors == []
        assert shown.hosts() == set()
        assert [url for url in shown.requests if url.startswith("file:")] == [path.as_uri()]


@pytest.mark.browser
def test_the_file_can_be_turned(page, browser, tmp_path):
    path = write_whole(tmp_path / "scene.html", page)
    with watched(browser, path.as_uri()) as shown:
        shown.wait_for_scene(20, clip=SCENE)
        before = shown.pixels()
        shown.page.mouse.move(600, 250)
        shown.page.mouse.down()
        shown.page.mouse.move(700, 300, steps=5)
        shown.page.mouse.up()
        shown.page.wait_for_timeout(1000)
        assert (shown.pixels() != before).any(axis=2).sum() > 500


@pytest.mark.browser
def test_the_policy_keeps_a_file_from_asking_anybody(page, browser, tmp_path):
    reach = (
        "<img src='http://127.0.0.1:9/a.png'><script>"
        "fetch('http://127.0.0.1:9/b').catch(() => 0);"
        "try { new WebSocket('ws://127.0.0.1:9/c') } catch {}</script>"
    )
    path = write_whole(tmp_path / "scene.html", page.replace(ANSWER, ANSWER + reach))
    with watched(browser, path.as_uri()) as shown:
        shown.page.get_by_test_id("verdict").wait_for()
        shown.page.wait_for_timeout(500)
        refused = " ".join(shown.errors)
        for directive in ("img-src", "connect-src"):
            assert directive in refused, json.dumps(shown.errors)


@pytest.mark.browser
def test_a_recording_is_played(opened, browser, tmp_path):
    solid = shapes.box(0.3, 0.3, 0.3)
    node = opened.server.scene.add_mesh_simple(
        "/moving", solid.vertices, solid.faces, color=(20, 20, 220), cast_shadow=False,
        receive_shadow=False,
    )  # fmt: skip

    def show(height):
        node.position = (0.6, 0.0, height)

    recording = record(opened.server, np.linspace(-1.0, 1.0, 30), 0.1, show)
    page = scene_html(opened.server, title="a", answer_html=ANSWER, recording=recording)
    path = write_whole(tmp_path / "run.html", page)
    with watched(browser, path.as_uri()) as shown:
        shown.wait_for_scene(20, clip=SCENE)
        heights = set()
        for _ in range(12):
            pixels = shown.pixels()
            blue = (pixels[..., 2] > 100) & (pixels[..., 0] < 90)
            if blue.any():
                heights.add(int(np.argwhere(blue)[:, 0].mean()))
            shown.page.wait_for_timeout(150)
        assert len(heights) > 2
        assert shown.errors == []
        assert shown.hosts() == set()


def test_a_picture_of_one_colour_is_no_scene():
    assert number_of_colours(np.zeros((4, 4, 3), dtype=np.uint8)) == 1
    assert export.PANEL_WIDTH > 0
