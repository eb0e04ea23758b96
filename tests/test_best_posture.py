"""The best posture against closed-form grids, numpy alone, and the other commands."""

import json
import math
from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import ftforce
from ftforce.core.measures import relative_manipulability, worst_manipulability_bound
from ftforce.errors import InputError
from ftforce.planning.self_motion import self_motion
from ftforce.show.render import to_text
from ftforce.show.tables.posture import posture_view
from helpers import campaign, load_text, serial_urdf
from test_cli import run
from test_self_motion import planar, srs

PI = math.pi
MEASURES = ("margin", "rho")


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def worst_by_numpy(J, measure, faults=1):
    """Return the worst margin or ρ over all sets of locked joints, from Jacobians (N, m, n)."""
    n = J.shape[2]
    top = np.linalg.svd(J, compute_uv=False)
    whole = top.prod(axis=1)
    found = []
    for size in range(1, faults + 1):
        for lost in combinations(range(n), size):
            s = np.linalg.svd(np.delete(J, lost, axis=2), compute_uv=False)
            missing = s.shape[1] < J.shape[1]  # fewer joints than rows
            kept = np.zeros(len(J)) if missing else s.prod(axis=1) / whole
            least = np.zeros(len(J)) if missing else s[:, -1] / top[:, 0]
            found.append(least if measure == "margin" else kept)
    return np.min(found, axis=0)


def jacobians_by_pinocchio(arm, q, rows):
    data = arm.model.createData()
    return np.array([
        pin.computeFrameJacobian(arm.model, data, arm.to_model(one), arm.tip_frame, pin.LOCAL)[rows]
        for one in q
    ])  # fmt: skip


# ---- closed-form grids ---------------------------------------------------------------------------


def grid_of_planar(x, y, bound, count=20_001):
    """Return all postures of the planar arm at a point, for a grid of the first joint."""
    q1 = np.linspace(-bound, bound, count)
    ahead = np.array([x, y])[:, None] - np.array([np.cos(q1), np.sin(q1)])
    d = np.hypot(*ahead)
    q1, ahead, d = q1[d <= 2.0], ahead[:, d <= 2.0], d[d <= 2.0]
    bend = 2.0 * np.arccos(0.5 * d)
    found = []
    for way in (1.0, -1.0):
        first = np.arctan2(ahead[1], ahead[0]) - way * bend / 2.0 - q1
        found.append(np.array([q1, (first + PI) % (2.0 * PI) - PI, way * bend]).T)
    q = np.concatenate(found)
    return q[(np.abs(q) <= bound).all(axis=1)]


def jacobians_of_planar(q):
    total = np.cumsum(q, axis=1)
    sine, cosine = np.sin(total), np.cos(total)
    back = [slice(i, None) for i in range(3)]
    return np.array([
        [-sine[:, one].sum(axis=1) for one in back], [cosine[:, one].sum(axis=1) for one in back]
    ]).transpose(2, 0, 1)  # fmt: skip


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("bound", [PI, 2.0])
def test_best_posture_of_a_planar_arm_is_that_of_a_grid(measure, bound):
    arm, rng = planar(bound=bound), np.random.default_rng(4)
    for _ in range(campaign(40, 3)):
        r, angle = rng.uniform(0.5, 2.4), rng.uniform(-1.5, 1.5)
        x, y = r * math.cos(angle), r * math.sin(angle)
        found = ftforce.best_posture(arm, (x, y, 0.0), maximize=measure, task="fx,fy")
        worst = worst_by_numpy(jacobians_of_planar(grid_of_planar(x, y, bound)), measure)
        best = found.measured_after.min()
        assert best >= worst.max() * (1.0 - 1e-3)
        assert best <= worst.max() * (1.0 + 1e-3)  # the grid is as fine as that
        own = worst_by_numpy(jacobians_of_planar(found.after.q[None]), measure)
        assert_allclose(best, own[0], rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["panda", "canadarm2", "srs", "tiago", "dh5"])
def test_no_posture_of_a_finer_trace_is_better(name):
    """The other search: finer, from other starts, and every Jacobian by Pinocchio."""
    arm = srs() if name == "srs" else ftforce.load_robot(name)
    middle, half = 0.5 * (arm.ranges[0] + arm.ranges[1]), 0.25 * (arm.ranges[1] - arm.ranges[0])
    for seed in range(campaign(40, 1)):
        q = middle + half * np.random.default_rng(seed).uniform(-1.0, 1.0, arm.n)
        place = {"at": arm_tip(arm, q)} if name == "dh5" else {"like": q}
        found = ftforce.best_posture(arm, **place, task="fx,fz", restarts=campaign(128, 24))
        motion = found.self_motion
        coarser = None if motion.dimension == 1 else 0.8 * motion.step
        finer = self_motion(
            arm, motion.target, seed=seed + 77, step=0.02, resolution=coarser, restarts=24
        )
        best = worst_by_numpy(jacobians_by_pinocchio(arm, finer.q[:5000], [0, 2]), "margin").max()
        assert found.measured_after.min() >= best * (1.0 - 1e-3)


def arm_tip(arm, q):
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, arm.to_model(q))
    return data.oMf[arm.tip_frame].translation


# ---- what is known of it -------------------------------------------------------------------------


def test_tip_stays_and_every_set_is_as_the_census_says(panda):
    found = ftforce.best_posture(panda, like="default", faults=2, maximize="margin", restarts=16)
    start, end = (arm_tip(panda, q) for q in (found.before.q, found.after.q))
    assert_allclose(end, start, atol=1e-9)
    census = ftforce.census(panda, found.after.q, faults=2)
    margins = {one.faults: one.margin for one in census.sets}
    assert_allclose(found.measured_after, [margins[one] for one in found.sets], atol=1e-12)
    assert (found.after.q >= panda.lower).all()
    assert (found.after.q <= panda.upper).all()
    assert_allclose(found.gains, found.measured_after - found.measured_before)


@pytest.mark.thorough
def test_worst_manipulability_never_exceeds_the_bound(panda):
    rng, low, high = np.random.default_rng(8), *panda.ranges
    for _ in range(campaign(100, 3)):
        q = low + rng.random(7) * (high - low)
        found = ftforce.best_posture(panda, like=q, maximize="rho", task="wrench", restarts=12)
        assert found.bound == math.sqrt(1.0 / 7.0)
        assert found.measured_before.min() <= found.measured_after.min() <= found.bound


def test_payload_is_held_and_a_jump_is_minimised(panda):
    found = ftforce.best_posture(panda, like="default", maximize="payload", faults=2, restarts=12)
    for one, carried in zip(found.sets, found.measured_after.tolist(), strict=True):
        locked = [j + 1 for j in one.joints]
        payload = ftforce.capability(panda, found.after.q, locked=locked).payload[1]
        assert carried == pytest.approx(payload.maximum, rel=1e-9)
    asked = {"faults": 2, "force": (0, 0, 30), "restarts": 12}
    jump = ftforce.best_posture(panda, like="default", maximize="jump", **asked)
    assert jump.measured_after.max() <= 1e-9
    assert jump.measured_before.max() > 20.0
    assert jump.gains.max() == pytest.approx(jump.measured_before.max())


def test_capability_is_that_of_the_command(panda):
    asked = {"direction": (0, 0, 1), "axes": "world"}
    found = ftforce.best_posture(panda, like="default", maximize="capability", restarts=12, **asked)
    worst = [
        ftforce.capability(panda, found.after.q, locked=[i + 1], **asked).directions[-1]
        for i in range(7)
    ]
    forces = [one.after["commanded"].maximum for one in worst]
    assert_allclose(found.measured_after, forces, rtol=1e-9)


def test_ties_are_broken_by_the_distance_to_the_limits():
    """Mirrored postures are as good; of these, the one whose elbows have more room is chosen."""
    arm = planar()
    best = ftforce.best_posture(arm, (1.6, 0.0, 0.0), task="fx,fy", restarts=24)
    mirrored = worst_by_numpy(jacobians_of_planar(-best.after.q[None]), "margin")
    assert_allclose(mirrored, best.measured_after.min(), rtol=1e-9)
    assert best.is_tied
    z = {"axis": (0, 0, 1), "lower": -PI, "upper": PI}
    for low, high, way in ((-PI, 0.9 * PI, -1.0), (-0.9 * PI, PI, 1.0)):
        steps = [("revolute", {**z, "xyz": (x, 0, 0)}) for x in (0.0, 1.0, 1.0)]
        steps[2] = ("revolute", {**steps[2][1], "lower": low, "upper": high})
        text = serial_urdf(*steps).replace("0.11 0.05 0.03", "1.0 0.0 0.0")
        found = ftforce.best_posture(load_text(text), (1.6, 0.0, 0.0), task="fx,fy", restarts=24)
        assert_allclose(found.measured_after.min(), best.measured_after.min(), rtol=1e-6)
        room = np.minimum(found.after.q[2] - low, high - found.after.q[2])
        assert room >= np.minimum(-found.after.q[2] - low, high + found.after.q[2])
        assert way * found.after.q[2] > 0.0


def test_posture_before_is_the_given_one_or_the_closest(panda):
    q = np.array([0.3, 0.4, -0.2, -1.9, 0.4, 2.2, 0.1])
    given = ftforce.best_posture(panda, like=q, restarts=4)
    assert (given.before.q == q).all()
    assert given.before.source == "given"
    moved = ftforce.best_posture(panda, arm_tip(panda, q) + 1e-4, q=q, restarts=4)
    assert np.linalg.norm(moved.before.q - q) < 1e-3
    assert any("elsewhere" in note for note in moved.notes)
    assert any("may turn" in note for note in moved.notes)


def test_arm_without_redundancy_has_one_posture_per_branch():
    arm = ftforce.load_robot("ur5e")
    found = ftforce.best_posture(arm, like=[0.3, -1.2, 1.4, -0.7, 0.9, 0.2], task="wrench")
    assert found.self_motion.dimension == 0
    assert len(found.self_motion.components) == 8
    shown = to_text(posture_view(found))
    assert "8 postures, one per branch" in shown
    assert "the arm has no self-motion here" in " ".join(shown.split())


# ---- the command ---------------------------------------------------------------------------------


def test_command_writes_what_other_commands_read(tmp_path):
    files = {end: tmp_path / f"best.{end}" for end in ("srdf", "json", "csv", "svg")}
    outputs = [word for end in ("srdf", "json", "csv") for word in ("-o", str(files[end]))]
    shown = run("posture", "panda", "--like", "default", "--restarts", "12", "--plot",
                str(files["svg"]), *outputs)  # fmt: skip
    assert "collisions are not checked" in shown.output
    assert "rises from 0.3 ({2}) to 0.413" in " ".join(shown.output.split())
    found = json.loads(files["json"].read_text())
    names = ftforce.load_robot("panda").names
    assert list(found["posture"]["after"]) == list(names)
    assert set(found["objective"]) >= {"name", "before", "after", "worst_set_before",
                                       "worst_set_after"}  # fmt: skip
    assert found["objective"]["worst_set_before"] == ["panda_joint2"]
    assert len(found["sets"]) == 7
    motion = found["self_motion"]
    assert set(motion["ranges"]) == set(names)
    assert len(motion["closed"]) == len(motion["components"])
    best = ftforce.load_robot("panda", srdf=files["srdf"])
    assert_allclose(best.postures["best"], list(found["posture"]["after"].values()), rtol=0)
    rows = files["csv"].read_text().splitlines()
    assert rows[0].startswith("fault_set,joints,before,after,gain,objective")
    assert len(rows) == 8
    assert "<svg" in files["svg"].read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give a position of the tip (at, --at), or a posture whose tip pose is kept"),
        (("--at", "2,0,0"), "the closest posture found is"),
        (("--at", "1,2"), "at needs 3 numbers"),
        (("--at", ".5,.1,.4", "--rpy", "1,2"), "rpy needs 3 numbers"),
        (("--like", "nowhere"), "unknown posture 'nowhere'"),
        (("--like", "default", "--rpy", "0,0,0"), "give either rpy or the posture"),
        (("--like", "default", "--maximize", "force"), "unknown measure to maximize 'force'"),
        (("--like", "default", "--maximize", "jump"), "the jump is that of a force"),
        (("--like", "default", "--restarts", "0"), "restarts must be an integer"),
    ],
)
def test_bad_command_lines_are_answered_in_one_line(words, message):
    shown = run("posture", "panda", *words, status=1)
    assert message in shown.output
    assert len(shown.output.strip().splitlines()) == 1


def test_limits_of_the_arm_that_exclude_the_point_are_an_error():
    with pytest.raises(InputError, match="within the joint limits: the closest posture found is"):
        ftforce.best_posture(planar(bound=0.2), (0.5, 0.0, 0.0), task="fx,fy")


def test_task_in_which_every_posture_loses_all_says_so():
    found = ftforce.best_posture(planar(), (1.5, 0.0, 0.0), restarts=8)  # no force along z
    assert found.measured_after.max() <= 1e-9
    assert any("another task" in warning for warning in found.warnings)


@pytest.mark.parametrize(("m", "n", "bound"), [(2, 3, 0.577), (3, 4, 0.500), (6, 7, 0.378)])
def test_random_jacobians_come_close_to_the_bound_and_never_exceed_it(m, n, bound):
    """√((n-m)/n), Roberts & Maciejewski 1996; found by a climb from random Jacobians."""
    rng = np.random.default_rng(m)

    best, J, step = 0.0, rng.normal(size=(m, n)), 0.5
    for _ in range(1500):
        tried = J + step * rng.normal(size=J.shape)
        if (value := worst_by_numpy(tried[None], "rho")[0]) > best:
            best, J = value, tried
        else:
            step = max(0.995 * step, 1e-3)
    assert worst_manipulability_bound(n, m, 1) == pytest.approx(bound, abs=5e-4)
    assert 0.97 * bound <= best <= bound + 5e-4
    sets = [ftforce.remap(J, np.ones(n), [k == i for k in range(n)]) for i in range(n)]
    assert min(relative_manipulability(one.reduced) for one in sets) == pytest.approx(best)
