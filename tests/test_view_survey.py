"""A sweep on the page: colours are the sweep's verdicts, a click takes the arm to a posture."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import viser
from typer.testing import CliRunner

import ftforce
from browser import chromium, watched
from ftforce import cli
from ftforce.batch.workspace_map import workspace_map
from ftforce.core.verdict import VERDICTS
from ftforce.view.scene.stage import linear
from ftforce.view.session import Session
from ftforce.view.survey import RAMP, VERDICT_POINTS, choices, read_points, share_colours, survey
from helpers import assert_close, initial_state

pytestmark = pytest.mark.thorough

pytest.importorskip("zarr")

FORCE = [80.0, 50.0, 10.0]


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def stored(dh5, tmp_path_factory):
    """The same sweep, with all samples, with the worst and without."""
    folder = tmp_path_factory.mktemp("sweeps")
    paths = {keep: folder / f"{keep}.zarr" for keep in ("all", "worst", "summary")}
    for keep, path in paths.items():
        ftforce.sweep(dh5, n=512, force=FORCE, keep=keep, output=path, threads=1)
    return paths


def opened(dh5, path):
    state = initial_state(dh5)
    mode = survey(dh5, state, path)
    return Session(dh5, state, mode=mode), mode


@pytest.fixture
def clicks(monkeypatch):
    """Collect what a click on a button, by its label, or on points does."""
    found = {}

    def collecting(kind):
        real = kind.on_click

        def on_click(node, act):
            found[getattr(node, "label", "points")] = act
            return real(node, act)

        monkeypatch.setattr(kind, "on_click", on_click)

    collecting(viser.GuiButtonHandle)
    collecting(viser.BatchedMeshHandle)
    return found


@pytest.fixture
def page(dh5, stored, clicks):
    session, mode = opened(dh5, stored["all"])
    with session:
        yield session, mode


def test_colours_are_the_verdicts_of_the_sweep(page, stored):
    _, mode = page
    data = ftforce.open_sweep(stored["all"]).dataset
    assert len(set(data["verdict"].values.ravel().tolist())) > 1
    assert_close(mode._nodes.batched_positions, data["tip"].values, tol=1e-6)
    for label, place in (("every set", None), ("{3}", 2), ("{1}", 0), ("every set", None)):
        mode.controls["sets"].value = label
        verdicts = data["verdict"].values
        wanted = verdicts.max(axis=1) if place is None else verdicts[:, place]
        colours = linear(np.array(VERDICT_POINTS, dtype=float)[wanted])
        assert np.array_equal(mode._nodes.batched_colors, colours)
        counts = np.bincount(wanted, minlength=3)
        for verdict, count in zip(VERDICTS, counts, strict=True):
            assert f"{verdict}: {count:,} (" in mode._legend.content


def test_a_click_takes_the_arm_there_and_the_controls_go_on(page, stored, clicks):
    session, mode = page
    data = ftforce.open_sweep(stored["all"]).dataset
    mode.controls["sets"].value = "{3}"
    for point in (7, 300):
        clicks["points"](SimpleNamespace(instance_index=point))
        session.settle()
        q = data["q"].values[point]
        assert np.array_equal(session.state.q, q)
        found = session.answer.analysis
        assert found.locked == ("joint3",)
        assert found.verdict is VERDICTS[int(data["verdict"].values[point, 2])]
        assert found.force.jump_norm == pytest.approx(float(data["jump"].values[point, 2]))
        assert_close(session.picture.tip.position, data["tip"].values[point])
    session.panel.handle("mode2").value = "healthy"
    session.panel.handle("q1").value = 12.0
    session.settle()
    assert session.answer.analysis.locked == ()
    assert np.degrees(session.state.q[1]) == pytest.approx(12.0)
    before = session.state.q
    for nowhere in (None, -1, 512):
        mode.move_to(nowhere)
    session.settle()
    assert np.array_equal(session.state.q, before)


def test_a_click_on_a_dark_point_fails_the_set_that_is_worst_there(dh5, stored):
    verdicts = ftforce.open_sweep(stored["all"]).dataset["verdict"].values
    dark, bright = int(verdicts.max(axis=1).argmax()), int(verdicts.max(axis=1).argmin())
    assert verdicts[dark].max() > verdicts[bright].max() == 0
    for keep in ("all", "worst"):
        session, mode = opened(dh5, stored[keep])
        with session:
            assert "with the fault set that is worst there" in mode._legend.content
            mode.move_to(dark)
            session.settle()
            found = session.answer.analysis
            assert found.verdict is VERDICTS[int(verdicts[dark].max())]
            faults = session.state.faults
            mode.move_to(bright)
            session.settle()
            assert session.state.faults == faults


def test_reset_goes_back_to_the_sweep_s_question_and_the_legend_says_so(page, clicks):
    session, mode = page
    asked = session.state
    assert asked.force.tolist() == FORCE
    assert "force (80, 50, 10) in tool axes" in mode._legend.content
    session.panel.handle("task").value = "fx,fz"
    session.settle()
    assert "unlike on this page" in mode._legend.content
    session.panel.handle("axes").value = "world"
    session.change(lambda state: state.with_joint(1, 0.3))
    session.settle()
    clicks["Reset"](SimpleNamespace(client=None))
    session.settle()
    assert session.state.task == asked.task
    assert session.state.force.tolist() == FORCE
    assert "as on this page" in mode._legend.content


def test_tolerances_gravity_and_payload_are_the_sweep_s(dh5, tmp_path):
    path = tmp_path / "s.zarr"
    asked = {"task": "fx,fz", "axes": "world", "force": [1, 3], "gravity": [0, 0, -1.62]}
    asked["payload"] = (10.0 / 7.0, [0.0, 0.1, 1.0 / 3.0])
    kept = {"keep": "all", "output": path, "threads": 1}
    ftforce.sweep(dh5, n=64, rtol=1e-5, wary=0.05, joint_length=0.2, **asked, **kept)
    session, mode = opened(dh5, path)
    with session:
        state = session.state
        assert (state.rtol, state.wary, str(state.task)) == (1e-5, 0.05, "fx,fz")
        assert state.scale.length == 0.2
        assert state.gravity.tolist() == [0, 0, -1.62]
        carried = (state.payload.mass, state.payload.offset.tolist())
        assert carried == asked["payload"]
        assert "payload 1.42857 kg at (0, 0.1, 0.333333) m; as on this page" in mode.part()
        assert session.panel.handle("task").value == "fx,fz"
        verdicts = ftforce.open_sweep(path).dataset["verdict"].values
        mode.controls["sets"].value = "{2}"
        for point in range(0, 64, 8):
            mode.move_to(point)
            session.settle()
            assert session.answer.analysis.verdict is VERDICTS[int(verdicts[point, 1])]
        session.change(lambda state: state.carrying(None))
        session.settle()
        assert "unlike on this page" in mode.part()


def test_a_page_that_is_taken_along_says_what_the_colours_mean(page):
    session, _ = page
    taken = session.page()
    for verdict in VERDICTS:
        assert f"{verdict}: " in taken
    assert 'data-testid="static"' in taken


def test_an_arm_with_another_shape_does_not_fit(dh5, stored, monkeypatch):
    monkeypatch.setattr("ftforce.view.model.fitting.tip_pose", lambda robot, q: (None, np.ones(3)))
    with pytest.raises(ftforce.FtforceError, match="another arm"):
        survey(dh5, initial_state(dh5), stored["all"])


def test_points_of_one_verdict_can_be_shown(page, stored):
    _, mode = page
    worst = ftforce.open_sweep(stored["all"]).dataset["verdict"].values.max(axis=1)
    for code, verdict in enumerate(VERDICTS):
        mode.controls["shown"].value = verdict.value
        assert np.array_equal(mode._nodes.batched_scales > 0, worst == code)
    mode.controls["shown"].value = "none"
    assert not mode._nodes.visible
    mode.controls["shown"].value = "all"
    assert mode._nodes.visible
    assert (mode._nodes.batched_scales == 1).all()


def test_a_bounded_random_subset_is_the_same_every_time(stored):
    sweep = ftforce.open_sweep(stored["all"])
    some, again = read_points(sweep, 100), read_points(sweep, 100)
    assert some.q.shape == (100, 5)
    assert some.total == 512
    assert np.array_equal(some.q, again.q)
    everything = {tuple(q): i for i, q in enumerate(sweep.dataset["q"].values.tolist())}
    rows = [everything[tuple(q)] for q in some.q.tolist()]
    assert len(set(rows)) == 100
    assert np.ptp(rows) > 300
    assert np.array_equal(some.verdict, sweep.dataset["verdict"].values[rows])
    assert np.array_equal(some.tip, sweep.dataset["tip"].values[rows])


def test_of_the_worst_set_only_every_set_is_known(dh5, stored):
    session, mode = opened(dh5, stored["worst"])
    with session:
        assert list(choices(mode.sweep)) == ["every set"]
        everything = ftforce.open_sweep(stored["all"]).dataset["verdict"].values
        assert np.array_equal(mode.verdicts, everything.max(axis=1))
        assert "only the worst fault set of each posture" in mode._legend.content
        mode.move_to(3)
        session.settle()
        assert np.array_equal(session.state.q, mode.points.q[3])


def test_a_summary_shows_cells_and_says_that_none_can_be_entered(dh5, stored):
    session, mode = opened(dh5, stored["summary"])
    with session:
        assert "a click cannot move the arm" in mode._legend.content
        for label, joints in (("every set", None), ("{2}", (2,))):
            mode.controls["sets"].value = label
            located = workspace_map(mode.sweep, joints).located
            assert_close(mode._nodes.batched_positions, located.place, tol=1e-6)
            wanted = linear(share_colours(located.cells.share).astype(float))
            assert np.array_equal(mode._nodes.batched_colors, wanted)
        before = session.state.q
        mode.move_to(1)
        session.settle()
        assert np.array_equal(session.state.q, before)


def test_bright_is_good_as_on_the_map():
    matplotlib = pytest.importorskip("matplotlib")
    cividis = matplotlib.colormaps["cividis"]
    for colour, at in zip(RAMP, np.linspace(0.0, 1.0, 5), strict=True):
        assert np.abs(np.array(colour) - 255.0 * np.array(cividis(at)[:3])).max() < 2.0
    shown = share_colours(np.linspace(0.0, 1.0, 21)).astype(int).sum(axis=1)
    assert (np.diff(shown) > 0).all()
    assert VERDICT_POINTS[0] == RAMP[-1]


def test_what_does_not_fit_is_said_in_one_line(stored):
    given = ["view", "panda", "--no-browser", "--sweep", str(stored["summary"])]
    result = CliRunner().invoke(cli.build("view"), given)
    assert result.exit_code == 1
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.browser
def test_a_click_on_a_point_takes_the_arm_there(page):
    session, mode = page
    session.load_geometry()
    mode._nodes.batched_scales = 8.0 * np.ones(512, dtype=np.float32)  # whatever is hit, is one
    before = session.state.q
    with chromium() as browser, watched(browser, session.address, 1280, 800) as tab:
        tab.page.get_by_test_id("sweep").wait_for()
        tab.wait_for_scene(clip={"x": 370, "y": 160, "width": 500, "height": 630})
        for x, y in [(620, 440), (560, 480), (680, 400), (620, 540), (500, 440)]:
            tab.page.mouse.move(x, y)
            tab.page.wait_for_timeout(500)
            tab.page.mouse.click(x, y)
            tab.page.wait_for_timeout(1000)
            if not np.array_equal(session.state.q, before):
                break
        session.settle()
        assert (mode.points.q == session.state.q).all(axis=1).any()
        assert not np.array_equal(session.state.q, before)
        assert tab.errors == []
        assert tab.hosts() == {"127.0.0.1"}
