"""The page: driven through its controls without a browser, and in a real one."""

from __future__ import annotations

import dataclasses
import math
import shlex
import threading
import time
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from markupsafe import Markup
from typer.testing import CliRunner

import ftforce
from browser import Watched, chromium, recorded, watched
from ftforce import cli
from ftforce.core.faults import FaultSet
from ftforce.errors import InputError
from ftforce.report.analysis import verdict_sentence
from ftforce.view import session as module
from ftforce.view.geometry.meshes import Geometry, Part
from ftforce.view.model.answer import answer
from ftforce.view.model.state import Origin, command_line
from ftforce.view.modes import Mode, View
from ftforce.view.scene.picture import picture, rotation, scene_size
from ftforce.view.session import Session, open_page
from helpers import KNOWN, assert_close, initial_state
from urdfs import arm, joint


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def start(dh5):
    return initial_state(dh5, origin=Origin("dh5"), force=[80, 50, 10])


@pytest.fixture(scope="module")
def opened(dh5, start):
    with Session(dh5, start) as opened:
        yield opened


@pytest.fixture
def session(opened, start):
    """Go back to the question of the start."""
    opened.change(lambda _state: start)
    opened.settle()
    return opened


def put(session, **values):
    """Do what hands on the page do."""
    for name, value in values.items():
        session.panel.handle(name).value = value
    session.settle()


# ---- without a browser -----------------------------------------------------------------------


def test_a_session_opens_with_its_question_answered(session, dh5):
    assert session.address.startswith("http://127.0.0.1:")
    assert session.warning == session.problem == ""
    found = ftforce.analyze(dh5, force=[80, 50, 10])
    assert verdict_sentence(found) == verdict_sentence(session.answer.analysis)
    assert "Tolerated" in session.panel._banner.content


def test_a_verdict_is_marked_while_a_newer_question_is_open(session, monkeypatch):
    content = lambda: session.panel._banner.content  # noqa: E731
    assert 'data-testid="open"' not in content()
    asked, answered, compute = threading.Event(), threading.Semaphore(0), module.answer

    def slowly(*given):
        asked.set()
        assert answered.acquire(timeout=20)
        return compute(*given)

    monkeypatch.setattr(module, "answer", slowly)
    session.change(lambda state: state.failing(1, "locked"))
    assert 'data-testid="open"' in content()
    assert "Tolerated" in content()  # the earlier verdict, marked
    assert 'data-testid="open"' not in str(session.panel.static_parts())
    assert asked.wait(20)
    session.change(lambda state: state.failing(3, "locked"))  # while the first one is computed
    answered.release()
    with session._updated:
        assert session._updated.wait_for(lambda: session._newest - session._answered == 1, 20)
        assert 'data-testid="open"' in content()
    answered.release()
    session.settle()
    assert 'data-testid="open"' not in content()


def test_one_picture_is_saved_at_a_time(session):
    begun, done = threading.Event(), threading.Event()

    class Tab:
        def __init__(self):
            self.said, self.files = [], []

        def add_notification(self, *words, **_options):
            self.said.append(words)

        def send_file_download(self, name, data, **_options):
            self.files.append((name, data))

    def draw():
        begun.set()
        assert done.wait(20)
        return b"png"

    slow, others = Tab(), [Tab() for _ in range(40)]
    thread = threading.Thread(target=session._send, args=(slow, "png", draw))
    thread.start()
    assert begun.wait(20)
    for tab in others:
        session._send(tab, "png", draw)  # returns at once
        assert "another image or page is being saved" in tab.said[0][1]
    done.set()
    thread.join(20)
    assert slow.files == [("ftforce_dh5.png", b"png")]
    session._send(others[0], "png", lambda: b"next")
    assert others[0].files == [("ftforce_dh5.png", b"next")]


@pytest.mark.thorough
@pytest.mark.parametrize("name", KNOWN)
def test_every_known_robot_opens(name):
    robot = ftforce.load_robot(name)
    with Session(robot, initial_state(robot, origin=Origin(name), limits="urdf")) as session:
        assert session.problem == ""
        put(session, mode1="locked")
        assert session.answer.analysis.locked == (robot.names[1],)


def test_every_control_changes_what_it_says(session):
    put(session, limits=True, mode1="locked", mode3="weak", factor3=30.0, axes="world")
    state = session.state
    assert state.modes == ("healthy", "locked", "healthy", "weak", "healthy")
    assert (state.factors[3], state.task.axes, state.is_limited) == (0.3, "world", True)
    put(session, q2=-12.5, gravity=False, payload=2.0, force=(1.0, 2.0, 3.0), task="fx,fz")
    state = session.state
    assert state.q[2] == pytest.approx(math.radians(-12.5))
    assert (state.weighs, state.payload.mass, state.force.tolist()) == (False, 2.0, [1.0, 3.0])
    put(session, joint_friction=True, armature=True)
    assert (session.state.joint_friction, session.state.armature) == (True, True)
    put(session, task="wrench", length=0.5, moment=(4.0, 5.0, 6.0))
    assert session.state.task.length == 0.5
    assert session.state.force.tolist() == [1, 2, 3, 4, 5, 6]
    put(session, solid="ellipsoid", weakest=True, see_through=True, census_mode="free")
    put(session, census="single and double faults", load="every direction")
    shown = session.state.shown
    assert shown == (2, "free", "ellipsoid", True, True)
    assert session.answer.census.largest == 2
    assert session.answer.census.mode == "free"
    assert session.state.force is None
    assert session.problem == ""


def test_controls_follow_the_question(session, dh5):
    handle = session.panel.handle
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    session.change(lambda s: s.at(q).with_faults(FaultSet.locked([0, 4])).failing(2, "weak", 0.25))
    session.settle()
    assert [handle(f"q{i}").value for i in range(5)] == np.round(np.degrees(q), 2).tolist()
    assert [handle(f"mode{i}").value for i in range(5)] == list(session.state.modes)
    assert handle("factor2").value == 25.0
    assert [handle(f"factor{i}").visible for i in range(5)] == [False, False, True, False, False]
    assert handle("limits").value  # a weak joint brings them
    assert np.array_equal(session.state.q, q)  # rounding on the page is none of the question
    assert not handle("moment").visible
    put(session, task="wrench")
    assert handle("moment").visible
    session.panel._reset()
    session.settle()
    assert command_line(dh5, session.state) == "ftforce analyze dh5 --force=80.0,50.0,10.0"
    assert handle("q0").value == 10.0


def test_the_page_of_an_analysis_has_its_question_and_geometry(dh5):
    model = pin.buildSampleModelManipulator()
    robot = ftforce.Robot.from_model(model, tip="effector_body")
    result = ftforce.analyze(robot, q=[0.1, 0.4, 0.2, 0.8, 0.3, 0.5], locked=[2], force=[10, 0, 5])
    with open_page(result) as page:
        shown = page.answer.analysis
        np.testing.assert_array_equal(shown.force.after, result.force.after)
        np.testing.assert_array_equal(shown.torque.total_after, result.torque.total_after)
        assert page.state.is_limited is None  # no limits were given
        assert page.panel.notes == ("the robot has no visual geometry: links are shown as rods",)
    with open_page(ftforce.analyze(dh5, locked=[1], limits="urdf")) as page:
        assert page.state.is_limited
        assert page.state.force.tolist() == [20.0] * 3


def test_switches_of_the_drives_are_shown_where_they_count(session):
    handle = session.panel.handle

    def shown(**changes):
        session.change(lambda state: dataclasses.replace(state, **changes))
        session.settle()
        return handle("joint_friction").visible, handle("armature").visible

    assert shown() == (False, False)
    assert shown(acceleration=np.ones(5)) == (False, True)
    assert shown(acceleration=None, inverse="dynamic") == (False, True)
    assert shown(velocity=np.ones(5)) == (True, True)
    assert shown(velocity=None, inverse="euclidean", joint_friction=True) == (True, False)


def test_a_posture_is_named_until_a_slider_moves_it(session):
    handle = session.panel.handle
    put(session, posture="zero")
    assert session.state.q.tolist() == [0.0] * 5
    assert handle("posture").value == "zero"
    q = np.array([0.1, 1 / 3, 0.3, 0.4, 0.5])
    session.change(lambda state: state.at(q))
    put(session, q0=45.0)
    assert session.state.q.tolist() == [math.pi / 4, *q[1:]]  # the others keep their digits
    assert handle("posture").value == "select …"


def test_a_set_of_the_census_can_be_shown(session):
    put(session, census="single and double faults")
    sets = session.answer.census.sets
    label = session.panel._labels[7]
    session.panel._all_sets.value = label
    session.settle()
    assert session.answer.analysis.faults == sets[7].faults
    session.panel._show_set(0)
    session.settle()
    assert session.answer.analysis.faults == sets[0].faults
    assert session.panel._all_sets.value == session.panel._labels[0]
    assert session.answer.census.sets is sets  # the same for all faults


def test_a_click_on_the_arm_locks_and_mends(session):
    session.toggle(2)
    session.settle()
    assert session.answer.analysis.locked == ("joint3",)
    session.toggle(2)
    session.settle()
    assert session.answer.analysis.locked == ()


def test_the_force_can_be_pulled_and_keeps_its_scale_meanwhile(session):
    scales, arrow = session.picture.scales, session.picture.arrows[0]
    end = arrow.start + 4.0 * (arrow.end - arrow.start)
    session.drag(lambda: end, False)
    session.settle()
    assert session.state.force == pytest.approx([320, 200, 40], abs=0.005 / scales.force)
    assert session.picture.scales == scales
    session.drag(lambda: end, True)
    session.settle()
    assert session.picture.scales.force < scales.force
    assert session.panel.handle("force").value == tuple(session.state.force)


def test_a_hand_that_holds_still_changes_nothing(session):
    put(session, force=(80.37, 0.004, 0.0))
    before = session.state
    session.drag(lambda: session.picture.arrows[0].end, False)
    session.drag(lambda: session.picture.arrows[0].end, True)
    session.settle()
    assert session.state is before


def test_another_tab_may_change_the_task_while_the_force_is_dragging(session):
    end = 1.5 * session.picture.arrows[0].end
    session.drag(lambda: end, False)
    put(session, task="moment", moment=(1.0, 2.0, 3.0))
    assert all(np.isfinite(arrow.end).all() for arrow in session.picture.arrows)
    assert session.picture.arrows[0].length > 0.0
    session.drag(lambda: session.picture.arrows[0].end + 0.1, False)
    session.drag(lambda: session.picture.arrows[0].end + 0.1, True)
    session.settle()
    assert session.problem == ""
    assert not session._is_dragging
    assert session.state.force[0] > 1.0


def test_an_old_failure_is_no_answer_to_a_newer_question(session, monkeypatch):
    begun, asked = threading.Event(), threading.Event()

    def slow(robot, state, earlier=None):
        if state.modes[0] == "locked":
            begun.set()
            assert asked.wait(10.0)
            raise InputError("of the question before")
        return answer(robot, state, earlier)

    monkeypatch.setattr("ftforce.view.session.answer", slow)
    session.change(lambda state: state.failing(0, "locked"))
    assert begun.wait(10.0)
    session.change(lambda state: state.failing(0, "healthy"))
    asked.set()
    session.settle()
    assert session.problem == ""
    assert "of the question before" not in session.panel._banner.content
    assert session.answer.state is session.state


def test_what_was_not_saved_is_told_to_the_tab_that_asked(session, monkeypatch):
    told = []
    tab = SimpleNamespace(add_notification=lambda title, body, **_: told.append((title, body)))
    monkeypatch.setattr(session, "page", lambda: 1 / 0)
    session.save_page(tab)
    assert told == [("Saving failed", "ZeroDivisionError('division by zero')")]
    assert session.problem == ""


def test_the_page_can_be_taken_along_without_the_handle_to_drag(session):
    put(session, mode1="locked", mode2="locked")
    page = session.page()
    assert "<title>ftforce dh5</title>" in page
    assert 'data-testid="static"' in page
    assert verdict_sentence(session.answer.analysis) in page
    assert "--locked=2,3" in page
    visible = {m["name"]: m["visible"] for _, m in recorded(page)[0] if "visible" in m}
    assert not visible["/force/handle"]
    assert visible["/force/lost_0"]
    assert session.stage._handle.visible


def test_what_cannot_be_asked_is_said_and_the_page_lives_on(session):
    before = session.state
    put(session, length=-1.0)
    assert "characteristic length" in session.problem
    assert "characteristic length" in session.panel._banner.content
    assert session.state is before
    assert session.panel.handle("length").value == before.task.length  # no longer what was typed
    put(session, mode2="locked")
    assert session.problem == ""
    assert "joint3 locked" in session.panel._banner.content


def test_a_mistake_of_ours_is_no_end_of_the_page(session, monkeypatch):
    def fail(*_arguments):
        raise RuntimeError("<b>oops</b>")

    with monkeypatch.context() as patch:
        patch.setattr("ftforce.view.session.answer", fail)
        put(session, mode1="locked")
    assert "please report it" in session.problem
    assert "<b>" not in session.panel._banner.content
    put(session, mode2="locked")
    assert session.problem == ""
    assert session.answer.analysis.locked == ("joint2", "joint3")


def test_only_the_newest_question_is_answered(session, monkeypatch):
    asked = []

    def slow(robot, state, earlier):
        asked.append(state)
        time.sleep(0.05)
        return answer(robot, state, earlier)

    monkeypatch.setattr("ftforce.view.session.answer", slow)
    for degrees in range(100):
        session.panel.handle("q1").value = float(degrees)
    session.settle()
    assert len(asked) < 10
    assert session.answer.state is session.state
    assert session.state.q[1] == pytest.approx(math.radians(99))


def test_ten_hands_at_once_leave_one_question(session):
    def shake(i):
        for k in range(40):
            session.panel.handle(f"q{i % 5}").value = float(k + i)
            session.toggle(i % 5)

    threads = [threading.Thread(target=shake, args=(i,)) for i in range(10)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    session.settle()
    assert session.problem == ""
    assert session.answer.state is session.state
    shown = [session.panel.handle(f"q{i}").value for i in range(5)]
    assert_close(np.degrees(session.state.q), shown, tol=1e-3)
    assert [session.panel.handle(f"mode{i}").value for i in range(5)] == list(session.state.modes)


def changes(session, **values):
    """Return what of the scene is sent when hands do something: kinds and names."""
    recording = session.server.get_scene_serializer()
    recording.insert_sleep(1.0)
    put(session, **values)
    page = recording.as_html()
    return {(m["type"], m["name"]) for t, m in recorded(page)[0] if t and "/arm/" in m["name"]}


def test_the_scene_is_sent_only_where_it_changed(session):
    part = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], dtype=np.float32)
    face = np.array([[0, 1, 2]], dtype=np.uint32)
    parts = tuple(Part(j, part, face, False) for j in range(6))
    session.set_geometry(Geometry(parts, ("mesh x is missing",)))
    session.settle()
    assert "mesh x is missing" in session.panel._legend.content
    nodes = [one.node for one in session.stage._parts]
    for node, pose in zip(nodes, session.picture.joints, strict=True):
        assert_close(node.position, pose.position, tol=1e-6)
    poses = {name for kind, name in changes(session, q3=20.0) if kind.startswith("Set")}
    assert poses == {"/arm/4", "/arm/5"}  # behind joint 4; the colours of others may change
    assert {name for _, name in changes(session, mode4="locked")} == {"/arm/5"}


class Still(Mode):
    """A mode that shows one posture, whatever is asked."""

    tab, takes_over = "Still", True

    def __init__(self):
        self.calls = []

    def start(self, session):
        self.calls.append("start")
        self.session = session

    def view(self, state):
        robot = self.session.robot
        return View(picture(answer(robot, state.at(np.full(5, 0.5)))), Markup("top"), Markup("<p>"))

    def page(self):
        return "own page"

    def part(self):
        return Markup("own part")

    def stop(self):
        self.calls.append("stop")


def test_a_mode_takes_over(dh5):
    mode = Still()
    with Session(dh5, initial_state(dh5), mode=mode) as session:
        panel = session.panel
        assert [part.content for part in (panel._banner, panel._answer)] == ["top", "<p>"]
        assert panel.first_tab is not None
        assert panel.handle("q0").disabled
        assert panel.handle("mode0").disabled
        with pytest.raises(KeyError):
            panel.handle("force")
        assert not panel.handle("see_through").disabled
        session.toggle(1)
        session.settle()
        assert session.state.modes[1] == "healthy"
        assert session.answer is None
        assert session.picture is not None
        assert session.page() == "own page"
        mode.page = lambda: None
        assert "own parttop<p></aside>" in session.page()
    assert mode.calls == ["start", "stop"]


def test_a_closed_session_leaves_no_thread_of_its_own(dh5):
    before = set(threading.enumerate())
    with Session(dh5, initial_state(dh5)) as session:
        own = set(threading.enumerate()) - before
        assert "ftforce view" in {thread.name for thread in own}
    assert not any(thread.name == "ftforce view" and thread.is_alive() for thread in own)
    session.close()  # again


# ---- in a browser ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


SCENE = {"x": 370, "y": 160, "width": 500, "height": 630}  # what is between the panels


class Seen:
    """The page in a browser: one tab, or several."""

    def __init__(self, browser, session):
        self.context = browser.new_context(viewport={"width": 1280, "height": 800})
        self.context.grant_permissions(
            ["clipboard-read", "clipboard-write"], origin=session.address.partition("/?")[0]
        )
        self.session, self.tabs = session, []
        self.page = self.open()

    def open(self):
        tab = Watched(self.context.new_page())
        self.tabs.append(tab)
        tab.page.goto(self.session.address)
        tab.page.get_by_test_id("verdict").wait_for()
        return tab.page

    def close(self):
        self.context.close()
        self.assert_clean()

    def assert_clean(self):
        for tab in self.tabs:
            assert tab.errors == []
            assert tab.hosts() == {"127.0.0.1"}

    def verdict(self, page=None):
        return (page or self.page).get_by_test_id("verdict").inner_text()

    def wait(self, words, page=None):
        (page or self.page).get_by_test_id("verdict").filter(has_text=words).wait_for()

    def cells(self, testid):
        rows = self.page.get_by_test_id(testid).locator("tbody tr")
        return [row.locator("td").all_inner_texts() for row in rows.all()]

    def scene(self):
        return self.tabs[0].pixels(clip=SCENE)

    def place_of(self, point):
        """Return where on the page a point in the root's axes, m, is seen, px."""
        camera = next(iter(self.session.server.get_clients().values())).camera
        box = self.page.locator("canvas").first.bounding_box()
        towards = camera.position - camera.look_at
        towards /= np.linalg.norm(towards)
        right = np.cross(camera.up_direction, towards)
        right /= np.linalg.norm(right)
        seen = np.array([right, np.cross(towards, right), towards]) @ (point - camera.position)
        share = seen[:2] / -seen[2] / math.tan(0.5 * camera.fov)
        middle = np.array([box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]])
        return middle + 0.5 * box["height"] * share * [1.0, -1.0]

    def wait_for_arm(self):
        for _ in range(100):
            if (self.scene().min(axis=2) < 140).sum() > 2000:  # something that is no floor
                return
            self.page.wait_for_timeout(200)
        pytest.fail("no arm appears")


@pytest.fixture(scope="module")
def shown(browser, dh5, start):
    with Session(dh5, start) as session:
        session.load_geometry()
        page = Seen(browser, session)
        page.wait_for_arm()
        yield page
        page.close()


@pytest.fixture
def seen(shown, start):
    """Go back to the question of the start, and to the first tab."""
    shown.session.change(lambda _state: start)
    shown.session.settle()
    shown.wait("every joint healthy")
    shown.page.get_by_role("tab", name="Arm", exact=True).click()
    yield shown
    shown.assert_clean()


@pytest.mark.browser
def test_locked_changes_verdict_and_table_to_the_numbers_of_analyze(seen, dh5):
    page = seen.page
    assert seen.verdict().startswith("Tolerated")
    for number in (2, 4, 5):
        page.get_by_label(f"Fault {number}", exact=True).click()
        page.get_by_role("option", name="locked", exact=True).click()
    seen.wait("43.66 N")
    found = ftforce.analyze(dh5, locked=[2, 4, 5], force=[80, 50, 10])
    assert seen.verdict() == verdict_sentence(found)
    rows, torque = seen.cells("torques"), found.torque
    numbers = zip(torque.total_before, torque.total_after, strict=True)
    for i, (cells, (before, after)) in enumerate(zip(rows, numbers, strict=True)):
        assert cells[1] == dh5.names[i]
        assert cells[2] == f"{before:.2f}"
        assert cells[3] == ("brake" if i in {1, 3, 4} else f"{after:.2f}")
    forces = seen.cells("forces")
    for cells, before, after, jump in zip(
        forces, found.force.before, found.force.after, found.force.jump, strict=False
    ):
        assert cells[2:] == [f"{x:.2f}" for x in (before, after, jump)]
    assert forces[3][4] == "43.66"


@pytest.mark.browser
def test_a_slider_moves_the_arm(seen):
    before = seen.scene().astype(int)
    row = seen.page.get_by_text("2 joint2").locator("xpath=ancestor::*[.//input][1]")
    box = row.locator("input").last
    box.fill("20")
    box.press("Enter")
    seen.tabs[0].wait_for_change(before, 3000, clip=SCENE)
    assert math.degrees(seen.session.state.q[1]) == pytest.approx(20.0)


@pytest.mark.browser
def test_a_force_is_typed_with_its_fractions(seen):
    page = seen.page
    page.get_by_role("tab", name="Force", exact=True).click()
    fields = page.locator("input:visible").and_(page.locator("[value='80']"))
    field = fields.element_handle()  # its value, by which it was found, changes
    field.fill("12.625")
    field.press("Enter")
    for _ in range(50):
        seen.session.settle()
        if seen.session.state.force[0] == 12.625:
            break
        page.wait_for_timeout(100)
    assert seen.session.state.force.tolist() == [12.625, 50, 10]
    assert page.locator("input:visible").and_(page.locator("[value='12.625']")).count() == 1


@pytest.mark.browser
def test_a_click_in_the_census_shows_that_fault(seen):
    seen.page.get_by_role("tab", name="Census").click()
    first = seen.cells("census")[0]
    assert first[0] == "{3}"
    seen.page.get_by_role("button").filter(has_text="{3} not tolerated").click()
    seen.wait("with joint3 locked")
    assert seen.session.answer.analysis.locked == ("joint3",)


@pytest.mark.browser
def test_command_page_and_picture_are_taken_along_by_a_click(seen):
    page = seen.page
    seen.session.panel.handle("mode1").value = "locked"
    seen.wait("joint2 locked")
    page.get_by_role("tab", name="Export").click()
    page.get_by_test_id("copy").click()
    page.get_by_test_id("copy").filter(has_text="copied").wait_for()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == command_line(seen.session.robot, seen.session.state)
    result = CliRunner().invoke(cli.app, shlex.split(copied)[1:], env={"COLUMNS": "400"})
    assert seen.verdict() in result.stdout
    for ending, start in (("html", b"<!doctype html>"), ("png", b"\x89PNG")):
        name = "Save page" if ending == "html" else "Save image"
        with page.expect_download() as given:
            page.get_by_role("button", name=name).click()
        assert given.value.suggested_filename == f"ftforce_dh5.{ending}"
        assert given.value.path().read_bytes().startswith(start)
    assert seen.session.problem == ""


@pytest.mark.browser
def test_the_force_follows_the_hand(seen, dh5):
    before, scene = seen.session.state.force, seen.session.picture
    (arrow,) = (arrow for arrow in scene.arrows if arrow.kind == "requested")
    along = rotation(scene.tip.wxyz)[:, 0]  # tool x, in the root's axes
    grip = arrow.end + 0.07 * scene_size(dh5) * along  # on the handle's first axis
    pull = 0.15  # m
    x, y = seen.place_of(grip)
    to_x, to_y = seen.place_of(grip + pull * along)
    mouse = seen.page.mouse
    mouse.move(x, y)
    seen.page.wait_for_timeout(300)
    mouse.down()
    for part in np.linspace(0.0, 1.0, 12):
        mouse.move(x + part * (to_x - x), y + part * (to_y - y))
        seen.page.wait_for_timeout(60)
    mouse.up()
    for _ in range(50):
        force = seen.session.state.force
        if abs(force[0] - before[0] - pull / scene.scales.force) < 0.1 * pull / scene.scales.force:
            break
        seen.page.wait_for_timeout(100)
    assert force[0] - before[0] == pytest.approx(pull / scene.scales.force, rel=0.1)
    assert force[1:] == pytest.approx(before[1:], abs=0.02 * pull / scene.scales.force)
    seen.session.settle()
    seen.wait(f"{np.linalg.norm(force):.2f} N")
    assert seen.verdict() == verdict_sentence(ftforce.analyze(dh5, force=force))


@pytest.mark.browser
def test_tabs_share_one_page_and_one_may_vanish(seen):
    second = seen.open()
    seen.session.panel.handle("mode2").value = "locked"
    for page in (seen.page, second):
        seen.wait("joint3 locked", page)
    second.close()
    seen.page.get_by_label("Fault 3", exact=True).click()
    seen.page.get_by_role("option", name="healthy", exact=True).click()
    seen.wait("every joint healthy")
    assert seen.session.problem == ""


@pytest.mark.browser
def test_names_with_markup_appear_as_text(browser, tmp_path):
    bad = "&lt;img src=x onerror=&quot;window.pwned=1&quot;&gt;"
    path = tmp_path / "arm.urdf"
    text = arm(j2=joint(bad, "l1", "l2"))
    path.write_text(text.replace('<robot name="arm"', f'<robot name="{bad}"'))
    robot = ftforce.load_robot(path)
    name = '<img src=x onerror="window.pwned=1">'
    assert (robot.name, robot.names[1]) == (name, name)
    with Session(robot, initial_state(robot, locked=[2], force=[1, 2, 3])) as session:
        tab = Seen(browser, session)
        assert name in tab.verdict()
        for title in ("Force", "Census", "Export"):
            tab.page.get_by_role("tab", name=title).click()
            tab.page.wait_for_timeout(300)
        assert tab.page.locator('img[src="x"]').count() == 0
        assert tab.page.evaluate("window.pwned") is None
        assert tab.page.title().startswith("ftforce")
        tab.close()


@pytest.mark.browser
def test_a_page_says_that_its_server_has_stopped(browser, dh5, start):
    with Session(dh5, start) as session, watched(browser, session.address) as tab:
        tab.page.get_by_test_id("verdict").wait_for()
        assert tab.page.get_by_test_id("stopped").count() == 0
        session.close()
        tab.page.get_by_test_id("stopped").filter(has_text="no longer updated").wait_for()


@pytest.mark.browser
def test_an_open_question_is_seen_and_a_reload_needs_no_token(seen, monkeypatch):
    answered, compute = threading.Event(), module.answer

    def slowly(*given):
        assert answered.wait(30)
        return compute(*given)

    monkeypatch.setattr(module, "answer", slowly)
    seen.session.change(lambda state: state.failing(1, "locked"))
    mark = seen.page.get_by_text("this answers an earlier question")
    mark.wait_for()  # visible
    answered.set()
    seen.session.settle()
    mark.wait_for(state="detached")
    seen.wait("locked")
    tab = Watched(seen.context.new_page())
    tab.page.goto(seen.session.address.partition("?")[0])  # the cookie suffices
    tab.page.get_by_test_id("verdict").wait_for()
    tab.page.close()
