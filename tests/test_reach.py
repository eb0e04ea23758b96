"""The region that is reached whichever joint locks: bounds, estimate, and softened limits."""

import itertools
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

import ftforce
from ftforce.errors import FtforceError
from ftforce.planning import soften
from ftforce.planning.joint_ranges import JointRanges
from ftforce.planning.reach import KEPT, LOST, Search
from ftforce.show.plots import reach_map
from helpers import campaign
from test_cli import run
from test_self_motion import planar, srs

PUBLISHED = np.deg2rad([20.4, 102.6, 110.8])  # of the planar arm of three links of 1 m
WITHIN = np.column_stack([-PUBLISHED, PUBLISHED])


@pytest.fixture(scope="module")
def arm():
    return planar("continuous")


@pytest.fixture(scope="module")
def coarse(arm):
    return ftforce.reach(arm, within=WITHIN, release=True, cell=0.1)


def reaches(radius, first, second):
    """Return whether two links that turn freely reach a radius."""
    return (radius >= abs(first - second)) & (radius <= first + second)


def tolerated(points, within=WITHIN, positions=41):
    """Return which points the planar arm reaches whichever joint locks, by the triangle inequality.

    Before the fault within some limits, by default the published ones, after it without limits.
    """
    radius = np.linalg.norm(points, axis=1)
    kept = healthy(points, within)
    first, second, third = (np.linspace(*ends, positions) for ends in within)
    for a in first:
        elbow = np.array([np.cos(a), np.sin(a)])
        kept &= reaches(np.linalg.norm(points - elbow, axis=1), 1.0, 1.0)
    for b in second:
        kept &= reaches(radius, np.sqrt(2.0 + 2.0 * np.cos(b)), 1.0)
    for c in third:
        kept &= reaches(radius, 1.0, np.sqrt(2.0 + 2.0 * np.cos(c)))
    return kept


def healthy(points, within=WITHIN, positions=801):
    """Return which points the arm reaches within limits, by a scan of joint 1."""
    found = np.zeros(len(points), dtype=bool)
    for a in np.linspace(*within[0], positions):
        rest = points - [np.cos(a), np.sin(a)]
        distance = np.linalg.norm(rest, axis=1)
        fold = np.arccos(np.clip(0.5 * distance**2 - 1.0, -1.0, 1.0))  # |q3|, law of cosines
        for c in (fold, -fold):
            b = np.arctan2(rest[:, 1], rest[:, 0]) - np.arctan2(np.sin(c), 1.0 + np.cos(c)) - a
            b = (b + np.pi) % (2.0 * np.pi) - np.pi
            fits = [
                (x >= low) & (x <= high) for x, (low, high) in zip((b, c), within[1:], strict=True)
            ]
            found |= (distance <= 2.0) & fits[0] & fits[1]
    return found


def test_the_published_region_lies_between_the_bounds(coarse):
    """3.52 m² by a published grid, and 3.57 ± 0.05 m² by an independent scan."""
    assert coarse.inner <= 3.52 <= coarse.outer
    assert coarse.estimate == pytest.approx(3.54, abs=0.08)
    fine = Search.of(planar("continuous"), within=WITHIN, release=True, cell=0.05).result()
    assert fine.inner == 0.0  # not begun
    assert not fine.is_whole
    assert "interrupted" in fine.warnings[-1]


def test_cells_agree_with_the_triangle_inequality(coarse):
    places = coarse.places(np.ones(coarse.tolerated.shape, dtype=bool))
    by_scan = tolerated(places).reshape(coarse.tolerated.shape)
    assert (coarse.tolerated_middles == by_scan).mean() >= 0.999
    assert by_scan[coarse.tolerated == KEPT].all()
    assert not by_scan[coarse.tolerated == LOST].any()


def test_every_point_of_a_proved_cell_is_tolerated(coarse):
    rng = np.random.default_rng(5)
    middles = coarse.places(coarse.tolerated == KEPT)
    assert len(middles) > 50
    drawn = middles + rng.uniform(-0.5, 0.5, middles.shape) * coarse.edge
    corners = [
        middles + 0.4999 * coarse.edge * np.array(s) for s in itertools.product((1, -1), repeat=2)
    ]
    assert tolerated(np.concatenate([drawn, *corners]), positions=21).all()


def test_no_random_posture_reaches_an_excluded_cell(arm, coarse):
    rng = np.random.default_rng(6)
    q = rng.uniform(WITHIN[:, 0], WITHIN[:, 1], (20_000, 3)).cumsum(axis=1)
    tips = np.column_stack([np.cos(q).sum(axis=1), np.sin(q).sum(axis=1)])
    cells = np.floor((tips - coarse.origin) / coarse.edge).astype(int)
    assert (coarse.healthy[tuple(cells.T)] != LOST).all()


@pytest.mark.thorough  # the search for limits takes seconds
def test_softened_limits_tolerate_as_much_as_the_published_ones(arm, monkeypatch):
    """By a grid of the triangle inequality; the published limits have 3.52 m².

    At least 3.5 m² are found; a shorter search finds a little less.
    """
    monkeypatch.setattr(soften, "_POINTS", {2: campaign(4000, 1500)})
    monkeypatch.setattr(soften, "_GENERATIONS", campaign(80, 40))
    search = Search.of(arm, soften=True, release=True)
    search.soften()
    own, within = np.column_stack(arm.ranges), search.ranges.swept
    assert (within >= own[:, :1] - 1e-9).all()
    assert (within <= own[:, 1:] + 1e-9).all()
    edge = 0.04
    line = np.arange(-3.0, 3.0, edge)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    assert tolerated(points).sum() * edge**2 == pytest.approx(3.52, abs=0.05)
    assert tolerated(points, within).sum() * edge**2 >= campaign(350, 345) / 100


def test_softened_limits_tolerate_a_box_first(arm, monkeypatch):
    monkeypatch.setattr(soften, "_POINTS", {2: 500})
    monkeypatch.setattr(soften, "_GENERATIONS", 12)
    box = [[1.0, -0.1], [1.2, 0.1]]
    search = Search.of(arm, soften=True, around=box, release=True, cell=0.1)
    search.soften()
    points = np.stack(np.meshgrid([1.0, 1.1, 1.2], [-0.1, 0.0, 0.1]), axis=-1).reshape(-1, 2)
    assert tolerated(points, search.ranges.swept).all()
    found = search.result()
    assert found.softened
    assert_allclose(found.around, box)


@pytest.mark.thorough
def test_a_wrist_on_the_axis_of_the_last_joint_costs_nothing():
    """The arm with spherical shoulder and wrist tolerates locks at points, not at poses."""
    within = {4: (1.3, 1.6), **dict.fromkeys((1, 2, 3, 5, 6), (-0.5, 0.5))}
    found = ftforce.reach(srs(), within=within, release=True, cell=0.4)
    assert found.moving == 6
    assert found.estimate > 0.0
    assert found.lost_by[6] == 0.0


def test_limits_are_written_and_read(arm, tmp_path):
    ranges = JointRanges.of(arm, WITHIN)
    for ending in ("toml", "yaml"):
        file = tmp_path / f"limits.{ending}"
        file.write_text(ranges.to_text(ending))
        assert_allclose(JointRanges.of(arm, file).swept, ranges.swept)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"faults": 2}, "of single faults: faults = 1, got 2"),
        ({"mode": "free"}, "mode"),
        ({"cell": 0.0}, "must lie between 0 and the width of the reach"),
        ({"cell": 1e-5}, "choose at least"),
        ({"seed": -1}, "seed"),
        ({"release": 1}, "release is True or False"),
        ({"around": [[0, 0], [1, 1]]}, "ask for soften"),
        ({"soften": True, "around": [[1, 1], [0, 0]]}, "a lower and an upper corner"),
        ({"soften": True, "around": [[9, 9], [10, 10]]}, "reaches no point of the box"),
        ({"within": {1: (-4.0, 0.0)}}, "must lie within the arm's own"),
        ({"within": {1: (1.0, 0.0)}}, "the lower one, 1, is above the upper one, 0"),
        ({"within": "none.toml"}, "none.toml"),
        ({"within": 3}, "3 pairs of a lower and an upper one"),
        ({"task": "fx"}, "fx"),
    ],
)
def test_bad_questions_are_one_clear_line(arm, asked, message):
    with pytest.raises(FtforceError, match=message) as caught:
        ftforce.reach(arm, **asked)
    assert "\n" not in str(caught.value)


def test_command_writes_limits_cells_and_a_map(tmp_path):
    names = [tmp_path / name for name in ("r.json", "l.toml", "l.yaml", "c.csv", "m.svg")]
    files = [word for name in names[:4] for word in ("-o", str(name))]
    shown = run("reach", "dh5", "--cell", "0.4", *files, "--plot", str(names[4])).stdout
    words = " ".join(shown.split())
    assert "No point was found that is reached whichever joint locks" in words
    assert "collisions are not checked" in words
    written = json.loads(names[0].read_text())
    assert written["reach"]["inner"] <= written["reach"]["estimate"] <= written["reach"]["outer"]
    assert set(written["limits"]) == {f"joint{i}" for i in range(1, 6)}
    again = run("reach", "dh5", "--cell", "0.4", "--within", str(names[1]), "--format", "json")
    assert json.loads(again.stdout)["reach"] == written["reach"]
    assert names[3].read_text().startswith("x [m],y [m],z [m],edge [m],healthy,tolerated")
    assert names[4].read_text().lstrip().startswith("<?xml")


def test_map_tells_planes_that_there_are_not(coarse):
    assert reach_map(coarse).get_xlabel() == "x [m]"
    with pytest.raises(FtforceError, match="the plane is two of xy"):
        reach_map(coarse, "xz")
    with pytest.raises(FtforceError, match="no third axis"):
        reach_map(coarse, at=0.1)
    solid = ftforce.reach(ftforce.load_robot("dh5"), cell=0.5)
    assert "at y = " in reach_map(solid, "xz", at=0.1).get_title()
    with pytest.raises(FtforceError, match="the cells lie between"):
        reach_map(solid, at=99.0)


def test_points_have_states(coarse):
    assert coarse.state_at((9.0, 9.0)) == LOST
    with pytest.raises(FtforceError, match="2 finite coordinates"):
        coarse.state_at((1.0, 2.0, 3.0))
    assert "whichever joint locks" in str(coarse)
