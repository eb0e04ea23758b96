"""``ftforce view`` as a user types it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
import webbrowser

import pytest
from PIL import Image
from typer.testing import CliRunner

import ftforce
from browser import needs_browser
from ftforce import cli
from ftforce.cli import view as command
from ftforce.view import session as module

PROGRAM = "from ftforce.cli import build; build('view')()"


def run(*arguments, status=0):
    result = CliRunner().invoke(cli.build("view"), ["view", *arguments], env={"COLUMNS": "80"})
    assert result.exit_code == status, result.output
    return result


@pytest.fixture
def opened(monkeypatch):
    """Collect the sessions that a command opens, and end each at once."""
    sessions, addresses = [], []

    def run_shortly(session, announce):
        announce()
        sessions.append((session.state, session.mode, session.problem))

    monkeypatch.setattr(module.Session, "run", run_shortly)
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    return sessions, addresses


def test_the_address_is_printed_and_the_browser_opened(opened):
    sessions, addresses = opened
    printed = run("dh5", "--force", "80,50,10", "--locked", "2,4").stdout
    (state, mode, problem), *_ = sessions
    (address,), shown = addresses, printed.split()[1]
    assert address.partition("=")[0] == shown.partition("=")[0]
    assert address != shown  # a ticket: other users can see the arguments of the browser
    assert printed.startswith("dh5: http://127.0.0.1:")
    assert (mode.takes_over, problem) == (False, "")
    assert state.modes == ("healthy", "locked", "healthy", "locked", "healthy")
    assert state.force.tolist() == [80, 50, 10]


def test_no_browser_opens_none(opened):
    _, addresses = opened
    run("dh5", "--no-browser")
    assert addresses == []


def test_every_option_of_analyze_is_one_of_view_and_means_the_same(opened):
    import inspect

    from ftforce.cli.analyze import analyze

    theirs, ours = (inspect.signature(one).parameters for one in (analyze, command.view))
    for name, parameter in theirs.items():
        if name != "outputs":  # a page has its own
            assert ours[name].annotation == parameter.annotation
            assert ours[name].default == parameter.default
    sessions, _ = opened
    given = (
        "--free=3 --weak=5:0.25 --posture=zero --torque=1.0,2.0,3.0,4.0,5.0,6.0,7.0 "
        "--velocity=1.0,0.0,0.0,0.0,0.0,0.0,0.0 --acceleration=0.0,2.0,0.0,0.0,0.0,0.0,0.0 "
        "--gravity=0.0,0.0,-1.0 --payload=2.0@0.0,0.0,0.1 --limits=none --friction=0.25 "
        "--inverse=dynamic --task=wrench --length=0.4 --axes=world --tip=panda_hand "
        "--rtol=1e-05 --wary=0.02"
    )
    run("panda", *given.split(), "--no-browser")
    arm = ftforce.load_robot("panda", tip="panda_hand")
    assert module.command_line(arm, sessions[0][0]) == f"ftforce analyze panda {given}"


def test_degrees_are_taken(opened):
    run("dh5", "--q", "10,70,25,65,90", "--deg", "--no-browser")
    assert opened[0][0][0].q[4] == pytest.approx(1.5707963)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nobody"], ""),
        (["dh5", "--force", "1,2"], ""),
        (["dh5", "--q", "0,0,0,0,0", "--posture", "zero"], ""),
        (["dh5", "--export", "nowhere/page.html"], "no such folder"),
        (["dh5", "--host", "203.0.113.7"], ""),
    ],
)
def test_what_is_wrong_is_said_in_one_line(opened, arguments, words):
    message = run(*arguments, status=1).stderr
    assert words in message
    assert message.startswith("error: ")
    assert len(message.splitlines()) == 1
    assert not opened[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--history", "a.npz", "--sweep", "b.zarr"], "not both"),
        (["--force", "1,2,3", "--torque", "1,2,3,4,5"], "not both"),
        (["--gravity", "0,0,0", "--mounted", "wall"], "not both"),
        (["--at", "3"], "--at requires --history"),
        (["--export", "page.pdf"], "must end in .html"),
        (["--screenshot", "page.jpg"], "must end in .png"),
        (["--history", "r.npz", "--force", "1,2,3"], "these itself; leave out --force"),
        (["--history", "r.npz", "--gravity", "0,0,0"], "leave out --gravity"),
        (["--history", "r.npz", "--limits", "urdf", "--q", "0"], "leave out --q, --limits"),
        (["--history", "r.npz", "--inverse", "dynamic"], "leave out --inverse"),
        (["--sweep", "s.zarr", "--task", "wrench"], "a sweep determines these itself"),
        (["--sweep", "s.zarr", "--payload", "1"], "leave out --payload"),
    ],
)
def test_what_excludes_each_other_is_refused(opened, arguments, words):
    message = run("dh5", *arguments, status=2).stderr
    assert words in message
    assert message.startswith("error: ")
    assert len(message.splitlines()) == 1
    assert not opened[0]


def test_without_viser_it_says_what_to_install(opened, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert "pip install 'ftforce[view]'" in run("dh5", status=1).stderr


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    """Not even markupsafe is there then, which the first imports of the view need."""
    for name in [name for name in sys.modules if name.startswith("ftforce.view")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "markupsafe", None)
    assert "pip install 'ftforce[view]'" in run("dh5", status=1).stderr


def test_other_machines_are_warned_of(opened):
    result = run("dh5", "--host", "0.0.0.0", "--no-browser")
    assert "warning: anyone who can reach 0.0.0.0" in result.stderr


def test_a_posture_that_holds_other_joints_is_noted(opened):
    sessions, _ = opened
    run("tiago", "--posture", "zero", "--no-browser")
    arm = ftforce.load_robot("tiago")
    elsewhere = ftforce.load_robot("tiago", posture="zero")
    note = sessions[0][0].origin.note
    assert bool(note) == (dict(arm.held) != dict(elsewhere.held))


def test_the_page_is_written_without_a_browser(opened, tmp_path):
    path = tmp_path / "scene.html"
    printed = run("dh5", "--locked", "2,3", "--force", "80,50,10", "--export", str(path)).stdout
    assert printed == f"wrote {path}\n"
    page = path.read_text()
    assert "80.00 N of 94.87 N can no longer be commanded" in page
    assert "<title>ftforce dh5</title>" in page
    assert not opened[0]  # no page stays open
    assert opened[1] == []


@pytest.mark.browser
def test_a_picture_is_written(opened, tmp_path):
    needs_browser()
    path = tmp_path / "scene.png"
    assert run("dh5", "--screenshot", str(path)).stdout == f"wrote {path}\n"
    with Image.open(path) as shown:
        assert shown.size == (1280, 800)
        assert len(shown.convert("RGB").getcolors(1 << 20)) > 200


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_ctrl_c_ends_it_cleanly():
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "view", "dh5", "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            address = process.stdout.readline().split()[1]
            with urllib.request.urlopen(address, timeout=20) as page:
                assert b"<title>" in page.read()
            process.send_signal(signal.SIGINT)  # while meshes and their libraries are loaded
            out, errors = process.communicate(timeout=20)
        finally:
            process.kill()
    assert (process.returncode, out, errors) == (0, "", "")
