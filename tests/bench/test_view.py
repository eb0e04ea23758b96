"""The page of `ftforce view`: how soon it answers, and how soon there is a picture."""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import cycle

import numpy as np
import pytest

import ftforce
from browser import needs_browser, started, watched
from effort import rounds
from ftforce.analysis.question import Question
from ftforce.robot.posture import choose_posture
from ftforce.view.model.state import initial_state
from ftforce.view.session import Session

BETWEEN_PANELS = {"x": 370, "y": 160, "width": 500, "height": 630}
CHANGE = "Panda with limits and the census of single faults: from a change to the new page"


@pytest.fixture(scope="module")
def session():
    arm = ftforce.load_robot("panda")
    question = Question.parse(arm, posture=choose_posture(arm), force=[0, 0, 50], limits="urdf")
    state = initial_state(question, are_limits_given=True).showing(census=1)
    with Session(arm, state) as page:
        page.load_geometry()
        yield page


def pushes(state, i):
    return state.pushing(np.array([0.0, 10.0 + i % 7, 50.0, 0.0, 0.0, 0.0]))


def moves(state, i):
    return state.with_joint(3, -1.5 - 0.01 * (i % 50))


def fails(state, i):
    return state.failing(1 + i % 3, "locked" if i % 6 < 3 else "healthy")


@pytest.mark.benchmark(group=CHANGE)
@pytest.mark.parametrize("change", [pushes, moves, fails])
def test_a_change_is_answered(benchmark, session, change):
    numbers = cycle(range(1, 1000))

    def once():
        i = next(numbers)
        session.change(lambda state: change(state, i))
        session.settle()

    benchmark.pedantic(once, rounds=rounds(100), warmup_rounds=10)
    assert session.problem == ""
    assert session.answer is not None
    assert len(session.answer.census.sets) == 7


@pytest.fixture(scope="module")
def playwright():
    """Start what drives the browser, which no user has to wait for."""
    needs_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        yield driver


@pytest.mark.benchmark(group="from `ftforce view panda`, browser and all, to a picture, s")
def test_the_first_picture_on_the_page(benchmark, playwright):
    """All of it: Python, the server, the meshes, the browser's start, drawing without a GPU."""

    def once():
        command = [sys.executable, "-m", "ftforce", "view", "panda", "--no-browser"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            address = re.search(r"http://\S+", server.stdout.readline())[0]
            with started(playwright) as browser, watched(browser, address, 1280, 800) as tab:
                scene = tab.wait_for_scene(clip=BETWEEN_PANELS)
            server.terminate()
        return scene

    scene = benchmark.pedantic(once, rounds=rounds(3))
    assert (scene.min(axis=2) < 140).sum() > 2000  # something that is no floor


@pytest.mark.benchmark(group="from `ftforce view panda`, browser and all, to a picture, s")
def test_the_first_picture_in_a_file(benchmark, tmp_path):
    """With three pictures of full size, until one follows itself."""
    needs_browser()
    file = tmp_path / "panda.png"
    command = [sys.executable, "-m", "ftforce", "view", "panda", "--screenshot", str(file)]
    benchmark.pedantic(subprocess.run, (command,), {"check": True}, rounds=rounds(3))
    assert file.stat().st_size > 10_000
