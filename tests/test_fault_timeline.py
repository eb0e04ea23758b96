"""Every fault set at every instant: each cell beside `analyze`, ratios with NumPy, the worst."""

import dataclasses
import math
from itertools import combinations, pairwise

import numpy as np
import pytest

import ftforce
from ftforce.core.limits import Limits
from ftforce.core.verdict import VERDICTS
from ftforce.errors import FtforceError, InputError
from ftforce.report.timeline import (
    faults_in_words,
    timeline_document,
    timeline_rows,
    timeline_sentence,
)
from ftforce.robot.kinematics import frame_jacobian
from ftforce.show.render import to_text
from ftforce.trajectory import Path, Recording
from ftforce.trajectory.simulate import simulate
from ftforce.trajectory.timeline import timeline
from helpers import assert_close, straight
from results import massless

PUSH = (80.0, 50.0, 10.0)  # N


def moving(robot, path, rate, q=None):
    """Return the healthy run of a simulation at the same instants."""
    return simulate(robot, path, q, force=(1, 0, 0), rate=rate).healthy


def assert_cells(robot, found, run, **options):
    """Compare every cell with `analyze`."""
    mode = found.mode.value
    moments_only = not found.task.force_rows
    for i in range(len(found.t)):
        for j, faults in enumerate(found.sets):
            joints = [joint + 1 for joint in faults.joints]
            told = ftforce.analyze(
                robot, found.q[i], **{mode: joints}, velocity=run.v[i], acceleration=run.a[i],
                **options,
            )  # fmt: skip
            assert VERDICTS[found.verdict[i, j]] is told.verdict
            assert found.margin[i, j] == pytest.approx(told.margin, rel=1e-9, abs=1e-12)
            if told.force is None or told.force.after is None:
                assert math.isnan(found.jump[i, j])
                continue
            wanted = told.force.moment_jump_norm if moments_only else told.force.jump_norm
            assert found.jump[i, j] == pytest.approx(wanted, rel=1e-6, abs=1e-7)


CASES = {
    "locked": ("dh5", {"force": PUSH, "faults": 2}),
    "free": ("dh5", {"force": PUSH, "mode": "free"}),
    "limits": ("panda", {"force": PUSH, "limits": "urdf"}),
    "free, limits": ("panda", {"force": (5, 8, 9), "limits": "urdf", "mode": "free"}),
    "world": ("panda", {"force": PUSH, "axes": "world"}),
    "wrench": ("ur5", {"force": (8, 5, 1, 1, 2, 3), "task": "wrench", "length": 0.3}),
    "moment": ("panda", {"force": (1, 2, 3), "task": "moment", "length": 0.2, "faults": 2}),
    "payload": ("panda", {"force": PUSH, "mode": "free", "payload": (2.0, (0, 0.1, 0))}),
    "gravity": ("ur5", {"force": PUSH, "mode": "free", "gravity": (1, -2, -3)}),
    "every force": ("dh5", {"faults": 2}),
    "sliding": ("tiago", {"force": (5, 8, 9)}),
    "continuous": ("kinova", {"force": (5, 8, 9), "mode": "free"}),
    "tolerances": ("dh5", {"force": PUSH, "rtol": 1e-4, "wary": 0.2}),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "options"), CASES.values(), ids=CASES)
def test_every_cell_is_an_analysis(name, options):
    robot, options = ftforce.load_robot(name), dict(options)
    path = straight(robot)
    found = timeline(robot, path, rate=2, **options)
    run = moving(robot, path, 2)
    assert_close(found.q, run.q, tol=1e-9)
    for name_ in ("faults", "mode"):
        options.pop(name_, None)
    assert_cells(robot, found, run, **options)


def test_sets_times_and_shapes(dh5):
    found = timeline(dh5, straight(dh5), force=PUSH, faults=2, rate=5)
    sets = [(i,) for i in range(5)] + list(combinations(range(5), 2))
    assert [faults.joints for faults in found.sets] == sets
    N = len(found.t)
    assert_close(found.t, np.arange(N) / 5)
    assert found.q.shape == (N, 5)
    for name in ("jump", "margin", "capability", "verdict"):
        cells = getattr(found, name)
        assert cells.shape == (N, 15)
        assert not cells.flags.writeable
    assert found.force.tolist() == list(PUSH)
    assert found.largest == 2
    assert found.limits is None
    assert found.capability_limits.source == "urdf"


# ---- capability ------------------------------------------------------------------------------


def ray_of(robot, q, rnea, locked, d):
    """Return the largest force along d that motors can make: a ratio test with NumPy."""
    J = frame_jacobian(robot, q, "tool")[:3]
    H = [i for i in range(robot.n) if i not in locked]
    K = J[:, H]
    if np.linalg.norm(K @ np.linalg.pinv(K, rcond=1e-6) @ d - d) > 1e-6:
        return 0.0
    lever = K.T @ d
    room = np.where(lever > 0.0, robot.effort[H] - rnea[H], robot.effort[H] + rnea[H])
    return float((room[lever != 0.0] / np.abs(lever[lever != 0.0])).min())


@pytest.mark.parametrize("name", ["dh5", "panda"])
def test_capability_along_a_direction_is_a_ratio(name):
    robot = ftforce.load_robot(name)
    path, d = straight(robot), np.array([1.0, 2.0, -2.0]) / 3.0
    found = timeline(robot, path, force=PUSH, direction=(3, 6, -6), faults=2, rate=2)
    run = moving(robot, path, 2)
    assert_close(found.direction, d)
    for i in range(len(found.t)):
        for j, faults in enumerate(found.sets):
            stop = [k not in faults.joints for k in range(robot.n)]
            rnea = ftforce.robot.dynamics.rnea_torque(
                robot, run.q[i], run.v[i] * stop, run.a[i] * stop
            )  # fmt: skip
            wanted = ray_of(robot, run.q[i], rnea, faults.joints, d)
            assert found.capability[i, j] == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def test_the_force_s_own_direction_and_the_weakest(dh5):
    path = straight(dh5)
    along = timeline(dh5, path, force=PUSH, rate=2)
    assert_close(along.direction, np.array(PUSH) / np.linalg.norm(PUSH))
    weakest = timeline(dh5, path, rate=2)
    assert weakest.direction is None
    assert (weakest.capability <= along.capability + 1e-9).all()
    run, rng = moving(dh5, path, 2), np.random.default_rng(0)
    i, j = 3, 0  # joint 1 locks
    still = np.array([0.0, 1.0, 1.0, 1.0, 1.0])
    rnea = ftforce.robot.dynamics.rnea_torque(dh5, run.q[i], run.v[i] * still, run.a[i] * still)
    directions = rng.normal(size=(500, 3))
    rays = [ray_of(dh5, run.q[i], rnea, (0,), d / np.linalg.norm(d))
            for d in directions]  # fmt: skip
    assert weakest.capability[i, j] <= min(rays) + 1e-9


def test_without_a_known_limit_nothing_ends_it(dh5):
    found = timeline(dh5, straight(dh5), force=PUSH, limits="none", rate=2)
    assert set(np.unique(found.capability)) <= {0.0, math.inf}
    assert found.capability_limits is None


# ---- the worst -------------------------------------------------------------------------------


def test_the_worst_instants_by_looking_at_all(dh5):
    found = timeline(dh5, straight(dh5, (-0.2, 0.2, 0.1)), force=PUSH, faults=3, rate=5)
    worst = found.worst()
    assert sorted(w.faults.joints for w in worst) == sorted(s.joints for s in found.sets)
    for instant in worst:
        j = found.sets.index(instant.faults)
        codes, jumps, margins = found.verdict[:, j], found.jump[:, j], found.margin[:, j]
        candidates = np.flatnonzero(codes == codes.max())
        assert instant.index in candidates
        assert instant.jump == jumps[instant.index]
        assert instant.jump >= jumps[candidates].max() - 1e-8
        assert instant.margin == margins[instant.index]
        same = candidates[jumps[candidates] > instant.jump - 1e-10]
        assert instant.margin <= margins[same].min() + 1e-8
        assert instant.time == found.t[instant.index]
        assert instant.verdict is VERDICTS[codes.max()]
        assert instant.capability == found.capability[:, j].min()
        at = int(np.flatnonzero(found.t == instant.capability_time)[0])
        assert found.capability[at, j] == instant.capability
        assert instant.not_tolerated == pytest.approx((codes == codes.max()).mean() if
                                                      instant.verdict.value == "not tolerated"
                                                      else 0.0)  # fmt: skip
    ranks = [VERDICTS.index(w.verdict) for w in worst]
    assert ranks == sorted(ranks, reverse=True)
    assert ranks[0] > ranks[-1]


def test_an_instant_at_which_nothing_holds_the_arm_is_the_worst(dh5):
    found = timeline(dh5, straight(dh5), force=PUSH, mode="free", faults=4, rate=2)
    lost = np.isnan(found.jump)
    assert lost.any()
    for instant in found.worst():
        j = found.sets.index(instant.faults)
        assert math.isnan(instant.capability) == np.isnan(found.capability[:, j]).any()
        if lost[:, j].any() and found.verdict[lost[:, j], j].max() == found.verdict[:, j].max():
            assert math.isnan(instant.jump)
            assert lost[instant.index, j]
            assert instant.verdict is ftforce.Verdict.NOT_TOLERATED
    assert np.isnan(found.capability[lost]).all()


def test_the_worst_without_a_force_is_the_smallest_margin(dh5):
    found = timeline(dh5, straight(dh5, (-0.2, 0.2, 0.1)), rate=5)
    for instant in found.worst():
        j = found.sets.index(instant.faults)
        assert math.isnan(instant.jump)
        codes = found.verdict[:, j]
        candidates = found.margin[codes == codes.max(), j]
        assert instant.margin == pytest.approx(candidates.min(), abs=1e-8)


# ---- other robots and trajectories -----------------------------------------------------------


def test_a_recorded_motion(panda):
    t = np.linspace(0.0, 1.0, 6)
    q = ftforce.analyze(panda).posture.q + 0.1 * np.sin(np.outer(t, 1.0 + np.arange(7)))
    recording = Recording.of(panda, t, q)
    found = timeline(panda, recording, force=PUSH, mode="free")
    assert_close(found.q, q)
    assert found.start == "recorded"
    run = simulate(panda, recording, force=PUSH).healthy
    assert_cells(panda, found, run, force=PUSH)


def test_without_masses_it_warns(tmp_path, dh5):
    robot = massless(tmp_path)
    q = np.array([0.2, 0.5, 0.4, 0.3])
    found = timeline(robot, straight(robot, (-0.05, 0.02, 0.02), q=q), q, force=(5, 1, 2), rate=5)
    assert any("no masses" in warning for warning in found.warnings)
    assert not timeline(dh5, straight(dh5), force=PUSH, rate=1).warnings


def test_the_same_input_gives_the_same_bytes(dh5):
    one, other = (timeline(dh5, straight(dh5), force=PUSH, faults=2, rate=3) for _ in range(2))
    for name in ("t", "q", "jump", "margin", "capability", "verdict"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_progress_goes_up_to_the_end(dh5):
    seen = []
    found = timeline(dh5, straight(dh5), force=PUSH, rate=5, progress=lambda *x: seen.append(x))
    done, totals = zip(*seen, strict=True)  # the arm is moved, and then looked at
    assert set(totals) == {2 * len(found.t)}
    assert list(done) == sorted(done)
    assert done[-1] == totals[0]


# ---- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"faults": 6}, "faults must be an integer from 1 to 5, got 6"),
        ({"faults": True}, "faults must be an integer from 1 to 5, got True"),
        (
            {"mode": "weak"},
            "fault sets of many joints are locked or free; weak joints need individual",
        ),
        ({"direction": (0, 0, 0)}, "the direction must not be zero"),
        ({"force": (1, 2)}, ""),
        ({"rate": -1}, ""),
        ({"task": "push"}, ""),
        ({"limits": "what"}, ""),
        ({"posture": "nowhere"}, ""),
    ],
    ids=str,
)
def test_values_that_make_no_sense(dh5, options, message):
    with pytest.raises(FtforceError) as caught:
        timeline(dh5, straight(dh5), **{"rate": 1, **options})
    assert str(caught.value).startswith(message)


def test_too_many_cells(panda):
    with pytest.raises(InputError) as caught:
        timeline(panda, straight(panda), faults=3, rate=3e5)
    assert "of 63 fault sets exceed the maximum of 20,000,000 cells; ask for a lower rate" in str(
        caught.value
    )


@pytest.mark.thorough
def test_doubts_are_those_of_a_simulation(dh5):
    far = Path.through([(0.9, 0.3, 0.2), (1.6, 0.4, 0.25)], speed=0.3)
    push = {"force": [80, 50, 10], "rate": 10}
    found = timeline(dh5, far, **push).warnings
    wanted = simulate(dh5, far, **push).warnings
    assert len(found) >= 2
    assert found == wanted[: len(found)]
    rest = wanted[len(found) :]  # accelerations at its edge, and what motors would need
    assert all("change abruptly" in words or "effort limit" in words for words in rest)
    near = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.3)
    assert timeline(dh5, near, **push).warnings == ()


# ---- what the ranking says of itself -----------------------------------------------------------

RANKED = (
    ("panda", {"force": (0, 0, 30)}),
    ("panda", {"force": (0, 0, 30), "mode": "free"}),
    ("dh5", {"force": PUSH, "faults": 2}),
    ("dh5", {}),
)


@pytest.mark.parametrize(("name", "options"), RANKED, ids=str)
def test_the_sentence_names_the_first_row_and_ranks_show_ties(name, options):
    robot = ftforce.load_robot(name)
    found = timeline(robot, straight(robot), rate=2, **options)
    worst, ranks, sentence = found.worst(), found.ranks(), timeline_sentence(found)
    assert faults_in_words(robot, worst[0].faults) in sentence
    assert ("tied with" in sentence) is (ranks[0].last > 1)
    if sentence.startswith("Tolerated"):
        assert_close(worst[0].margin, found.margin.min())
    for (one, rank), (other, after) in pairwise(zip(worst, ranks, strict=True)):
        keys = [
            (VERDICTS.index(x.verdict), x.not_tolerated, np.nan_to_num(x.jump, nan=1e9), x.margin)
            for x in (one, other)
        ]
        assert (rank == after) is bool(np.allclose(*keys, rtol=1e-8, atol=2e-9))
        assert after.first == rank.first if rank == after else after.first == rank.last + 1


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_held_beside_commanded_and_the_healthy_arm(panda, mode):
    found = timeline(panda, straight(panda), rate=2, mode=mode, force=PUSH)
    run = moving(panda, straight(panda), 2)
    for i in range(0, len(found.t), 2):
        moves = {"velocity": run.v[i], "acceleration": run.a[i], "direction": PUSH}
        for j, faults in enumerate(found.sets):
            joints = [joint + 1 for joint in faults.joints]
            told = ftforce.capability(panda, found.q[i], **{mode: joints}, **moves).directions[-1]
            for values, model in ((found.capability, "commanded"), (found.held, "held")):
                assert values[i, j] == pytest.approx(told.after[model].maximum, nan_ok=True)
            for values, model in ((found.healthy.capability, "commanded"),
                                  (found.healthy.held, "held")):  # fmt: skip
                assert values[i] == pytest.approx(told.before[model].maximum)
    assert not found.healthy.jump.any()
    for worst in found.worst():
        told = ftforce.analyze(
            panda, found.q[worst.index], **{mode: [j + 1 for j in worst.faults.joints]},
            force=PUSH, velocity=run.v[worst.index], acceleration=run.a[worst.index],
        )  # fmt: skip
        if told.force.after is None:
            assert math.isnan(worst.kept)
        else:
            assert_close(worst.kept, told.force.after @ PUSH / np.dot(PUSH, PUSH), scale=1.0)
        if math.isfinite(worst.capability):
            k = int(np.nanargmin(found.capability[:, found.sets.index(worst.faults)]))
            assert_close(worst.capability_kept, worst.capability / found.healthy.capability[k])


def test_unknown_limits_are_named(panda):
    limits = Limits.of([87.0, math.nan, 87.0, 87.0, 12.0, math.nan, 12.0])
    found = timeline(panda, straight(panda), rate=2, limits=limits)
    named = "unknown effort limits are not enforced: panda_joint2, panda_joint6"
    assert found.warnings == (named,)
    assert named in " ".join(to_text(found).split())
    assert timeline(panda, straight(panda), rate=2, limits="none").warnings == ()


def test_tables_and_files_show_held_ranks_and_the_healthy_arm(panda):
    found = timeline(panda, straight(panda), rate=2, force=(0, 0, 30))
    shown = to_text(found).splitlines()
    assert max(map(len, shown)) <= 80
    assert sum(line.split()[:1] == ["none"] for line in shown) == 2
    header, *rows = timeline_rows(found)
    healthy = [dict(zip(header, row, strict=True)) for row in rows if row[1] == "{}"]
    assert_close([row["held [N]"] for row in healthy], found.healthy.held)
    assert {row["capability_kept"] for row in healthy} == {1.0}
    document = timeline_document(found)
    assert_close(document["healthy"]["over_time"]["capability"], found.healthy.capability)
    assert [one["rank"] for one in document["sets"]] == list(map(list, found.ranks()))


def test_a_tolerated_set_has_no_jump_that_could_rank_it(panda):
    """What rounding leaves of a jump must not put a set before one of a smaller margin."""
    found = timeline(panda, straight(panda), rate=2, force=(0, 0, 30))
    widest = int(found.margin.min(axis=0).argmax())
    noisy = found.jump.copy()
    noisy[0, widest] = 1e-6
    ranked = dataclasses.replace(found, jump=noisy).worst()
    assert [one.faults for one in ranked] == [one.faults for one in found.worst()]
    assert ranked[0].margin == found.margin.min()
