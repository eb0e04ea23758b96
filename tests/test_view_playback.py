"""A history on the page: what is shown at a time is what its arrays hold there."""

from __future__ import annotations

import re
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import ftforce
from browser import chromium, recorded, watched
from ftforce import cli
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.io.text import write_whole
from ftforce.trajectory import Path
from ftforce.trajectory.history import JointInfo
from ftforce.view.animation import frame_times
from ftforce.view.geometry.meshes import Geometry, Part
from ftforce.view.page.history import charts
from ftforce.view.playback import Playback, _mark, check_fits, playback
from ftforce.view.scene.colours import FAULT_COLOURS, colour_of
from ftforce.view.scene.picture import joint_poses, rotation
from ftforce.view.scene.snapshots import faults_at, first_with, sentence, snapshot
from ftforce.view.server.export import PANEL_WIDTH
from ftforce.view.session import Session
from helpers import assert_close, initial_state

pytestmark = pytest.mark.thorough

FORCE = [80.0, 50.0, 10.0]


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def simulated(dh5):
    """Return what simulates the arm on a short line."""
    line = Path.through([(0.9, 0.3, 0.2), (0.85, 0.35, 0.25)], speed=0.05)

    def run(*faults, rate=20, force=FORCE, **options):
        return ftforce.simulate(dh5, line, force=force, rate=rate, faults=faults, **options)

    return run


@pytest.fixture(scope="module")
def history(simulated):
    return simulated("3@0.5", "weak:2:0.5@1", "4,5@1.3", rate=50, delay=0.1)


@pytest.fixture(scope="module")
def file(history, tmp_path_factory):
    path = tmp_path_factory.mktemp("history") / "run.npz"
    ftforce.save(history, path)
    return path


@pytest.fixture(scope="module")
def opened(dh5, file):
    state = initial_state(dh5)
    mode = playback(dh5, state, file)
    with Session(dh5, state, mode=mode) as session:
        yield session, mode


@pytest.fixture
def page(opened):
    """Go back to the start, paused, with all as it was."""
    session, mode = opened
    mode.pause()
    wanted = {"run": "with remap", "speed": "1×", "place": "in place"}
    for name, value in wanted.items():
        mode.controls[name].value = value
    mode.seek(0.0)
    session.settle()
    return session, mode


@contextmanager
def playing(robot, run, at=0.0):
    """Open the page of a run; yield session and mode."""
    mode = Playback(robot, run, at)
    with Session(robot, initial_state(robot), mode=mode) as session:
        yield session, mode


def arrows(session):
    return {arrow.kind: arrow for arrow in session.picture.arrows}


def forces(session):
    """Return what the arrows say, in the task's axes, N."""
    scene = session.picture
    R = rotation(scene.tip.wxyz)
    return {k: R.T @ (a.end - a.start) / scene.scales.force for k, a in arrows(session).items()}


@pytest.mark.parametrize("words", ["with remap", "without remap"])
@pytest.mark.parametrize("at", [0.0, 0.31, 0.5, 0.99, 1.0, 1.31, 1.5])
def test_what_is_shown_at_a_time_stands_in_the_arrays(page, dh5, history, words, at):
    session, mode = page
    mode.controls["run"].value = words
    mode.seek(at)
    session.settle()
    assert session.problem == ""
    run = {"with remap": history.remapped, "without remap": history.unremapped}[words]
    i = int(np.flatnonzero(history.t <= at + 1e-9)[-1])
    poses, tip = joint_poses(dh5, run.q[i])
    for shown, wanted in zip(session.picture.joints, poses, strict=True):
        assert_close(shown.position, wanted.position)
        assert_close(shown.wxyz, wanted.wxyz)
    assert_close(session.picture.tip.position, tip[1])
    found = forces(session)
    assert_close(found["requested"], FORCE, tol=1e-6)
    assert_close(found["kept"], np.nan_to_num(run.force[i]), tol=1e-8, scale=100.0)
    assert_close(found["lost"], np.nan_to_num(run.jump[i]), tol=1e-8, scale=100.0)
    loads = snapshot(history, mode.run, at).loads
    assert_close([load.after for load in loads], run.motor[i])
    assert_close([load.before for load in loads], history.healthy.motor[i])
    failed = {fault.joint: fault.mode for fault in faults_at(history, at).faults}
    for j, load in enumerate(loads):
        assert session.picture.colours[j + 1] == (
            FAULT_COLOURS[failed[j]] if j in failed else colour_of(None, run.used[i, j])
        )
        assert (load.brake == run.brake[i, j]) == (failed.get(j) is FaultMode.LOCKED)
    assert f": {run.verdicts[i]}." in session.panel._banner.content
    for torque, j in zip(run.motor[i], range(5), strict=True):
        if failed.get(j) is not FaultMode.LOCKED:
            assert f">{ftforce.report.text.number(float(torque))}<" in session.panel._answer.content


def test_faults_come_from_their_time_on(history):
    locked, weak = Fault(2), Fault(1, FaultMode.WEAK, 0.5)
    assert faults_at(history, 0.49) == FaultSet()
    assert faults_at(history, 0.5) == FaultSet((locked,))
    assert faults_at(history, 1.0) == FaultSet((weak, locked))
    assert faults_at(history, 9.0) == FaultSet((weak, locked, Fault(3), Fault(4)))


def test_names_with_commas_and_modes_are_no_trap(history):
    names = ("a, 2 b locked", "b locked, 3", "c", "d", "e")
    joints = tuple(JointInfo(name, "revolute") for name in names)
    told = ", ".join(f"{i} {names[i - 1]} {how}" for i, how in ((1, "free"), (2, "weak 0.25")))
    event = replace(history.setting.events[0], all_faults=told)
    trap = replace(history, setting=replace(history.setting, joints=joints, events=(event,)))
    wanted = (Fault(0, FaultMode.FREE), Fault(1, FaultMode.WEAK, 0.25))
    assert faults_at(trap, 1.0) == FaultSet(wanted)


def test_the_page_says_what_happens(page, history):
    session, mode = page
    assert "every joint healthy" in session.panel._banner.content
    mode.seek(0.55)
    session.settle()
    assert "3 joint3 locked" in session.panel._banner.content
    assert "The remap takes effect at 0.6 s." in session.panel._banner.content
    mode.seek(mode.end)
    session.settle()
    missing = ftforce.report.text.amounts(history.setting.task, history.remapped.jump[-1])
    assert f"{missing} of 94.87 N is lost" in session.panel._banner.content
    assert [_mark(history, at) for at in (0.5, 1.0, 1.3)] == ["3", "2", "4,5"]
    shown = [session.panel.handle(f"mode{i}").value for i in range(5)]
    assert shown == ["healthy", "weak", "locked", "locked", "locked"]
    with pytest.raises(KeyError):  # it would say nothing of a history
        session.panel.handle("force")


def test_the_healthy_arm_stands_where_it_is_wanted(page, dh5, history):
    session, mode = page
    part = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], dtype=np.float32)
    face = np.array([[0, 1, 2]], dtype=np.uint32)
    session.set_geometry(Geometry(tuple(Part(j, part, face, False) for j in range(6)), ()))
    mode.controls["run"].value = "without remap"
    mode.seek(1.5)
    session.settle()
    nodes = [one.node for one in mode._healthy._stage._parts]
    poses, _ = joint_poses(dh5, history.healthy.q[history.index(1.5 + 1e-9)])
    other, _ = joint_poses(dh5, history.unremapped.q[history.index(1.5 + 1e-9)])
    assert np.abs(poses[-1].position - other[-1].position).max() > 1e-4
    for node, pose in zip(nodes, poses, strict=True):
        assert_close(node.position, pose.position, tol=1e-6)
        assert node.opacity < 1.0
    mode.controls["place"].value = "beside"
    session.settle()
    offsets = [node.position - pose.position for node, pose in zip(nodes, poses, strict=True)]
    assert np.ptp(offsets, axis=0).max() < 1e-6
    assert np.linalg.norm(offsets[0]) > 0.5
    assert "beside it" in session.panel._legend.content
    mode.controls["place"].value = "hidden"
    session.settle()
    assert not any(node.visible for node in nodes)


def wait_for(true, seconds=20.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_it_plays_to_the_end_and_from_the_start_again(page):
    session, mode = page
    mode.controls["speed"].value = "5×"
    mode.play()
    assert mode._button.label == "Pause"
    wait_for(lambda: mode.time > 0.3)
    wait_for(lambda: not mode.is_playing)
    session.settle()
    assert mode.time == mode.end
    assert mode._button.label == "Play"
    assert session.picture is not None
    mode.play()
    wait_for(lambda: 0.0 < mode.time < mode.end)


def test_a_hand_on_the_slider_pauses_and_a_pause_holds(page, history):
    session, mode = page
    mode.play()
    wait_for(lambda: mode.time > 0.1)
    mode.controls["time"].value = 0.8
    session.settle()
    assert not mode.is_playing
    time.sleep(0.2)
    assert mode.time == pytest.approx(0.8, abs=1e-3)
    q = history.remapped.q[history.index(0.8 + 1e-9)]
    assert_close(session.state.q, q)


def test_nothing_is_analysed_while_it_plays(page, monkeypatch):
    session, mode = page

    def fail(*_arguments, **_options):
        raise AssertionError

    monkeypatch.setattr("ftforce.view.session.answer", fail)
    monkeypatch.setattr("ftforce.view.model.answer.analyze_question", fail)
    for at in np.linspace(0.0, 1.5, 20):
        mode.seek(float(at))
        session.settle()
        assert session.problem == ""


def test_a_closed_page_leaves_no_thread(dh5, history):
    before = set(threading.enumerate())
    with playing(dh5, history) as (_, mode):
        mode.play()
        own = set(threading.enumerate()) - before
        assert "ftforce playback" in {thread.name for thread in own}
    assert not any(t.name == "ftforce playback" and t.is_alive() for t in own)


def test_where_nothing_holds_the_arm_that_is_said(dh5, simulated):
    fallen = simulated("free:1,2,3,4,5@0.5")
    fall = fallen.remapped.falls_from
    with playing(dh5, fallen) as (session, mode):
        mode.seek(1.0)
        session.settle()
        assert session.problem == ""
        assert "the resulting motion is not simulated" in session.panel._banner.content
        assert np.isnan(fallen.remapped.force[fallen.index(1.0)]).all()
        assert arrows(session)["kept"].length == 0.0
        assert arrows(session)["lost"].length == 0.0
        assert arrows(session)["lost"].label == "lost: no static equilibrium"
        poses, _ = joint_poses(dh5, fallen.remapped.q[fall])
        assert_close(session.picture.joints[-1].position, poses[-1].position)


def test_a_fall_ends_what_is_told_though_the_arrays_go_on(simulated):
    fallen = simulated("free:2@0.3")
    fall = fallen.unremapped.falls_from
    assert np.isfinite(fallen.unremapped.force[-1]).all()
    before = snapshot(fallen, "unremapped", float(fallen.t[fall - 1]))
    assert before.kept is not None
    now = snapshot(fallen, "unremapped", 1.2)
    assert (now.kept, now.lost) == (None, None)
    assert now.q.tolist() == fallen.unremapped.q[fall].tolist()
    assert now.sample == fallen.index(1.2)  # the healthy arm goes on
    assert now.time == pytest.approx(1.2, abs=0.05)
    assert all(np.isnan([load.after, load.used]).all() for load in now.loads)
    told = sentence(fallen, "unremapped", now)
    assert "is lost" not in told
    assert (
        f"cannot be held in static equilibrium. This has been so since {fallen.t[fall]:g} s" in told
    )
    shown = str(charts(fallen, fallen.unremapped))
    last = max(
        float(point.split(",")[0])
        for line in re.findall(r'points="([^"]+)" stroke="rgb\(32,190', shown)
        for point in line.split()
    )
    assert last <= 100.0 * fallen.t[fall] / fallen.t[-1] + 0.1


def test_limits_and_marks_of_failed_joints_are_theirs(dh5, simulated):
    run = simulated("weak:3:0.5@0.3", "2@0.6", "3@1.2", limits="urdf")
    assert [_mark(run, at) for at in (0.3, 0.6, 1.2)] == ["3", "2", "3"]  # though 3 was weak
    loads = snapshot(run, "remapped", 1.0).loads
    assert loads[2].limit == 0.5 * dh5.effort[2]
    assert loads[2].used == pytest.approx(abs(loads[2].after) / loads[2].limit)
    assert loads[1].used == pytest.approx(float(run.remapped.used[run.index(1.0), 1]), nan_ok=True)


def test_every_remap_that_is_still_to_come_is_named(simulated):
    run = simulated("3@0.8", "1@1.0", delay=0.4)
    told = sentence(run, "remapped", snapshot(run, "remapped", 1.1))
    assert told.endswith("The remap takes effect at 1.2 s and 1.4 s.")


def test_a_fault_between_two_samples_is_told_with_the_first_that_knows(dh5):
    line = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.3)], speed=0.05)
    run = ftforce.simulate(dh5, line, force=FORCE, rate=3, faults=["2,3,4@0.5", "5@2.2"])
    with playing(dh5, run) as (session, mode):
        page = session.page()
        for event in run.setting.events:
            at = first_with(run, event.time)
            assert at >= event.time > at - 0.34
            assert f"{at:.2f} s, with remap, {event.all_faults}" in page
        mode.controls["time"].value = 0.5  # on the mark
        session.settle()
        assert session.state.faults == faults_at(run, 0.7)


@pytest.mark.parametrize("arguments", [["panda"], ["dh5", "--locked", "2"]])
def test_what_does_not_fit_is_said_in_one_line(file, arguments):
    given = ["view", *arguments, "--no-browser", "--history", str(file)]
    result = CliRunner().invoke(cli.build("view"), given)
    assert result.exit_code == 1
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.splitlines()) == 1


def test_another_arm_or_chain_does_not_fit(dh5, history):
    ur5, ur10 = (ftforce.load_robot(name) for name in ("ur5", "ur10"))
    assert ur5.names == ur10.names
    line = Path.through([(0.5, 0.2, 0.4), (0.5, 0.25, 0.4)], speed=0.05)
    run = ftforce.simulate(ur5, line, force=[0, 0, 10], rate=5)
    check_fits(ur5, run, "run.npz")
    renamed = replace(run, setting=replace(run.setting, robot=ur10.name))
    other = replace(history, setting=replace(history.setting, tip="elsewhere"))
    for robot, stored, words in (
        (dh5, run, "belongs to another arm, with joints"),
        (ur10, run, "belongs to another arm, ur5"),
        (ur10, renamed, r"its tip is 0\.\d+ m away"),
        (dh5, other, "belongs to another chain"),
    ):
        with pytest.raises(ftforce.FtforceError, match=words):
            check_fits(robot, stored, "run.npz")
    with pytest.raises(ftforce.FtforceError, match="faults are those of the history"):
        playback(dh5, initial_state(dh5, locked=[2]), "run.npz")


def test_moments_have_arrows_and_curves_of_their_own(dh5, simulated):
    run = simulated("3@0.5", task="fx,fz,my", length=0.3, joint_length=0.2, force=[30, 10, 4])
    with playing(dh5, run, 1.0) as (session, mode):
        assert session.problem == ""
        assert session.state.scale.length == 0.2
        scene, now = session.picture, snapshot(run, "remapped", 1.0)
        moments = {arrow.kind: arrow for arrow in scene.arrows if arrow.is_moment}
        assert moments["requested"].length == pytest.approx(4 * scene.scales.moment)
        assert moments["kept"].length == pytest.approx(abs(now.kept[2]) * scene.scales.moment)
        shown = mode._charts.content
        assert "Force at the tip: 0 to" in shown
        assert "Moment at the tip: 0 to" in shown


# ---- taken along -----------------------------------------------------------------------------


def texts(messages, name):
    """Return what a label says from which time on."""
    updates = [(t, x.get("updates", {})) for t, x in messages if x.get("name") == name]
    told = [(t, update["text"]) for t, update in updates if "text" in update]
    assert told
    return told


def test_a_history_is_taken_along_as_a_page_that_plays(page, history):
    session, mode = page
    mode.controls["run"].value = "without remap"
    mode.seek(0.7)
    session.settle()
    before = session.picture
    taken = session.page()
    assert (session.picture, mode.time) == (before, 0.7)  # nobody's page has moved
    messages, seconds = recorded(taken)
    assert seconds == pytest.approx(mode.end, abs=0.06)
    clock, run = texts(messages, "/history/clock"), history.unremapped
    assert clock[0][1].startswith("0.0 s: healthy, tolerated")
    for at, text in clock:
        i = history.index(at + 1e-9)
        assert text.startswith(f"{history.t[i]:.1f} s: ")
        assert text.endswith(str(run.verdicts[i]))
        assert ("3 locked" in text) == (history.t[i] >= 0.5 - 1e-9)
    lost = texts(messages, "/force/lost_label")
    sizes = np.linalg.norm(run.jump, axis=1)
    assert lost[0][0] == pytest.approx(history.t[np.argmax(sizes > 1e-6)], abs=0.06)
    for at, text in lost:
        assert text == f"lost {sizes[history.index(at + 1e-9)]:.1f} N"
    for event in history.setting.events:
        assert f"{event.time:.2f} s, without remap, {event.all_faults}" in taken
    assert 'data-testid="charts"' in taken


@pytest.mark.parametrize(("end", "count"), [(1.0, 21), (0.001, 2), (4000.0, 1000)])
def test_frames_reach_from_the_start_to_the_end(end, count):
    times = frame_times(end)
    assert (len(times), times[0], times[-1]) == (count, 0.0, end)


def test_the_command_begins_at_a_time_and_takes_along(file, history, tmp_path):
    path = tmp_path / "run.html"
    given = ["view", "dh5", "--history", str(file), "--at", "1.1", "--export", str(path)]
    result = CliRunner().invoke(cli.build("view"), given)
    assert result.exit_code == 0, result.output
    assert len(texts(recorded(path.read_text())[0], "/history/clock")) > 5


def test_a_history_begins_where_it_is_asked_to(dh5, file, history):
    state = initial_state(dh5)
    mode = playback(dh5, state, file, at=1.1)
    with Session(dh5, state, mode=mode) as session:
        assert session.state.faults == faults_at(history, 1.1)
        assert mode.controls["time"].value == pytest.approx(1.1)
        assert "3 joint3 locked" in session.panel._banner.content
    close = playback(dh5, state, file, at=mode.end * (1.0 + 1e-6))  # as a message prints it
    with Session(dh5, state, mode=close) as session:
        assert close.time == mode.end
        assert session.problem == ""
    for at in (-0.1, mode.end + 0.1, float("nan")):
        with pytest.raises(ftforce.FtforceError, match="the history, which lasts from 0 to"):
            playback(dh5, state, file, at=at)


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


@pytest.mark.browser
def test_a_page_that_plays_moves_by_itself(page, browser, tmp_path):
    session, _ = page
    session.load_geometry()
    path = write_whole(tmp_path / "run.html", session.page())
    clip = {"x": PANEL_WIDTH, "y": 0, "width": 800 - PANEL_WIDTH, "height": 440}
    with watched(browser, path.as_uri()) as tab:
        tab.page.get_by_text("The full", exact=False).first.wait_for()
        before = tab.wait_for_scene(20, clip=clip).astype(int)
        tab.wait_for_change(before, 300, clip=clip)
        assert tab.errors == []
        assert tab.hosts() == set()


@pytest.mark.browser
def test_a_history_plays_in_the_browser(page, browser):
    session, mode = page
    session.load_geometry()
    clip = {"x": 370, "y": 160, "width": 500, "height": 630}
    with watched(browser, session.address, 1280, 800) as tab:
        tab.page.get_by_test_id("verdict").filter(has_text="every joint healthy").wait_for()
        before = tab.wait_for_scene(clip=clip).astype(int)
        mode.controls["speed"].value = "0.5×"
        tab.page.get_by_role("button", name="Play", exact=True).click()
        tab.page.get_by_test_id("verdict").filter(has_text="3 joint3 locked").wait_for()
        tab.page.get_by_role("button", name="Pause", exact=True).or_(
            tab.page.get_by_role("button", name="Play", exact=True)
        ).wait_for()
        mode.pause()
        assert mode.time >= 0.5
        tab.wait_for_change(before, 500, clip=clip)
        assert tab.page.get_by_test_id("charts").locator("polyline").count() >= 8
        assert tab.errors == []
        assert tab.hosts() == {"127.0.0.1"}
