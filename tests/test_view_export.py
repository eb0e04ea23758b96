"""The page as one file: it opens by itself, shows the arm and the answer, and asks nobody."""

import json
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from markupsafe import Markup

from browser import chromium, recorded, red_box, reds, watched
from ftforce.errors import FtforceError
from ftforce.io.text import write_whole
from ftforce.view.server.export import PANEL_WIDTH, record, scene_html
from ftforce.view.server.server import open_server
from ftforce.view.server.viser_private import NOTICES, TESTED

ANSWER = Markup(
    '<h2 data-testid="verdict">the fault is tolerated</h2><p>&lt;b&gt;no markup&lt;/b&gt;</p>'
)
TITLE = "ftforce: </title><script>document.body.remove()</script>"


@pytest.fixture(scope="module")
def opened():
    with closing(open_server(port=0)) as opened:
        red_box(opened.server)
        yield opened


@pytest.fixture(scope="module")
def page(opened):
    return scene_html(opened.server, title=TITLE, answer=ANSWER)


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


SCENE = {"x": PANEL_WIDTH, "y": 0, "width": 800 - PANEL_WIDTH, "height": 500}


# ---- as text ---------------------------------------------------------------------------------


def test_the_page_names_no_other_host_to_load_from(page):
    policy = page[page.index("Content-Security-Policy") :][:400]
    assert "default-src &#39;none&#39;" in policy
    assert "http" not in policy[: policy.index('">')].replace("http-equiv", "")
    assert page.index("Content-Security-Policy") < page.index("<script")
    assert "<title>Viser</title>" not in page


def test_markup_is_in_it_as_it_is_and_all_else_as_text(opened, page):
    assert page.count(ANSWER) == 1
    assert page.count("<script>document.body.remove()") == 0
    assert "<title>ftforce: &lt;/title&gt;" in page
    assert "&lt;b&gt;plain" in scene_html(opened.server, title="a", answer="<b>plain")


@pytest.mark.parametrize("page", ["<head></head><body></body>", "<title>Viser</title><body>"])
def test_another_page_of_visers_is_an_error_in_words(opened, page):
    other = SimpleNamespace(as_html=lambda: page)
    with pytest.raises(FtforceError, match="has an unexpected page format"):
        scene_html(opened.server, title="a", answer=ANSWER, recording=other)


def test_a_recording_has_every_frame_at_its_time(opened):
    node = opened.server.scene.add_frame("/moving", visible=False)

    def show(height):
        node.position = (0.6, 0.0, height)

    recording = record(opened.server, range(1, 6), 0.25, show)
    played = scene_html(opened.server, title="a", answer=ANSWER, recording=recording)
    messages, seconds = recorded(played)
    moves = [
        (t, m["position"][2])
        for t, m in messages
        if m.get("name") == "/moving" and t + m.get("position", [0, 0, 0])[2]
    ]
    assert moves == [(0.25 * (k - 1), k) for k in range(1, 6)]
    assert seconds == 1.25


# ---- in a browser ----------------------------------------------------------------------------


@pytest.mark.browser
def test_the_file_opens_by_itself_and_can_be_turned(page, browser, tmp_path):
    path = write_whole(tmp_path / "scene.html", page)
    with watched(browser, path.as_uri()) as shown:
        shown.wait_for_scene(20, clip=SCENE)
        red = reds(shown.pixels())
        # The scene is beside the answer, not behind it: the box is in the middle of what is left.
        assert red.sum() > 2000
        middle = np.argwhere(red).mean(axis=0)
        assert middle == pytest.approx([250, (PANEL_WIDTH + 800) / 2], abs=25)
        assert shown.page.title() == TITLE
        verdict = shown.page.get_by_test_id("verdict")
        assert verdict.is_visible()
        assert verdict.inner_text() == "the fault is tolerated"
        box = shown.page.locator("#ftforce-answer").bounding_box()
        assert (box["x"], box["width"]) == (0, PANEL_WIDTH)
        assert "<b>no markup</b>" in shown.page.locator("#ftforce-answer").inner_text()
        notices = shown.page.locator(NOTICES)
        assert notices.count() > 0, f"viser's notices have another name than in {TESTED}"
        assert not notices.first.is_visible()
        assert shown.errors == []
        assert shown.hosts() == set()
        assert [url for url in shown.requests if url.startswith("file:")] == [path.as_uri()]
        before = shown.pixels().astype(int)
        shown.page.mouse.move(600, 250)
        shown.page.mouse.down()
        shown.page.mouse.move(700, 300, steps=5)
        shown.page.mouse.up()
        shown.wait_for_change(before, 500)


@pytest.mark.browser
def test_the_policy_keeps_a_file_from_asking_anybody(page, browser, tmp_path):
    reach = (
        "<img src='http://127.0.0.1:9/a.png'><script>"
        "fetch('http://127.0.0.1:9/b').catch(() => 0);"
        "try { new WebSocket('ws://127.0.0.1:9/c') } catch {}</script>"
    )
    path = write_whole(tmp_path / "scene.html", page.replace(ANSWER, f"{ANSWER}{reach}"))
    with watched(browser, path.as_uri()) as shown:
        shown.page.get_by_test_id("verdict").wait_for()
        shown.page.wait_for_timeout(500)
        refused = " ".join(shown.errors)
        for directive in ("img-src", "connect-src"):
            assert directive in refused, json.dumps(shown.errors)
