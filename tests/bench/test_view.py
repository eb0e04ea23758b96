"""The page of `ftforce view`: how soon it answers, and how soon there is a picture."""

from __future__ import annotations

import subprocess
import sys
from itertools import cycle

import numpy as np
import pytest

import ftforce
from effort import rounds
from ftforce.errors import FtforceError
from ftforce.view.screenshot import find_browser
from ftforce.view.session import Session
from ftforce.view.state import initial_state

CHANGE = "Panda with limits and the census of single faults: from a change to the new page"


@pytest.fixture(scope="module")
def session():
    arm = ftforce.load_robot("panda")
    state = initial_state(arm, force=[0, 0, 50], limits="urdf").showing(census=1)
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


@pytest.mark.benchmark(group="from `ftforce view panda` to its picture in a browser, s")
def test_the_first_picture(benchmark, tmp_path):
    """All of it: Python, the server, the meshes, the browser, drawing without a GPU."""
    try:
        find_browser()
    except FtforceError as problem:
        pytest.skip(str(problem))
    file = tmp_path / "panda.png"
    command = [sys.executable, "-m", "ftforce", "view", "panda", "--screenshot", str(file)]
    benchmark.pedantic(subprocess.run, (command,), {"check": True}, rounds=rounds(3))
    assert file.stat().st_size > 10_000
