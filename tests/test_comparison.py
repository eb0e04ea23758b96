"""Arms side by side: every number of a report again, from all samples with NumPy and SciPy."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from rich.console import Console
from scipy.optimize import brentq
from scipy.stats import binomtest, norm

import ftforce
from ftforce.batch.comparison import _ranked, compare
from ftforce.batch.postures.drawn import Drawn
from ftforce.batch.summary.criticality import Estimate
from ftforce.batch.sweep import sweep
from ftforce.errors import FileError, InputError, UnknownNameError
from ftforce.report.comparison import comparison_document, comparison_rows, comparison_sentence
from ftforce.report.files import _unsigned
from ftforce.robot.formats.dh import DHRow, DHTable, MassModel
from ftforce.show.tables.comparison import comparison_view
from helpers import load_text, serial_urdf

pytestmark = pytest.mark.thorough

FORCE = [20.0, -30.0, 40.0]
NORM = math.sqrt(2900.0)
NAMES = ("dh5", "kinova")
BIN = 1e-3
DECADE = 10.0**0.01  # one bin of the capability


@pytest.fixture(scope="module")
def two():
    return [ftforce.load_robot(name) for name in NAMES]


@pytest.fixture(scope="module")
def sweeps(two):
    return [sweep(arm, n=3000, faults=2, force=FORCE, keep="all") for arm in two]


@pytest.fixture(scope="module")
def compared(sweeps):
    return compare(sweeps)


@pytest.fixture(scope="module", params=NAMES)
def pair(request, sweeps, compared):
    """Return a report and all samples of its arm."""
    one = next(one for one in sweeps if one.setting.robot == request.param)
    return compared[request.param], one.dataset.load(), one


def columns_of(one, size):
    return [s for s, faults in enumerate(one.sets) if len(faults) == size]


def wilson_of(share, n):
    """Return the ends of Wilson's interval from its definition, by root finding."""
    z = norm.ppf(0.975)

    def off(p, side):
        return (share - p) - side * z * math.sqrt(p * (1.0 - p) / n)

    low = brentq(off, 1e-12, share, args=(1,)) if share > 0.0 else 0.0
    return low, brentq(off, share, 1 - 1e-12, args=(-1,)) if share < 1.0 else 1.0


def test_the_share_tolerated_weighs_sizes_alike(pair):
    arm, data, one = pair
    good = data["verdict"].values == 0
    shares = [good[:, columns_of(one, size)].mean() for size in (1, 2)]
    assert arm.tolerated.value == pytest.approx(np.mean(shares), abs=1e-12)
    assert shares[0] > shares[1] + 0.01
    assert arm.tolerated.value != pytest.approx(good.mean(), abs=1e-3)
    np.testing.assert_allclose(arm.tolerated[1:], wilson_of(np.mean(shares), 3000), atol=1e-9)
    for report, share in zip(arm.sizes, shares, strict=True):
        assert report.tolerated.value == pytest.approx(share, abs=1e-12)
        np.testing.assert_allclose(report.tolerated[1:], wilson_of(share, 3000), atol=1e-9)


def test_postures_that_tolerate_every_set(pair):
    arm, data, _ = pair
    count = int((data["verdict"].values == 0).all(axis=1).sum())
    found = binomtest(count, 3000).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(arm.every, (count / 3000, found.low, found.high), atol=1e-12)
    assert arm.full_rank == np.mean(data["healthy_rank"].values == 3)


@pytest.mark.parametrize("name", ["margin", "rho"])
def test_quantiles_to_one_bin(pair, name):
    arm, data, one = pair
    for report in arm.sizes:
        values = data[name].values[:, columns_of(one, report.size)]
        wanted = np.nanquantile(values, [0.05, 0.5])
        found = [estimate.value for estimate in getattr(report, name)]
        np.testing.assert_allclose(found, wanted, atol=BIN)
        for estimate, x in zip(getattr(report, name), wanted, strict=True):
            assert estimate.low - BIN <= x <= estimate.high + BIN
    assert wanted[1] > 0.0  # not both in the first bin


def test_the_borderline_and_the_critical_joint(pair):
    arm, data, one = pair
    verdict = data["verdict"].values
    for report in arm.sizes:
        assert report.sets == len(columns_of(one, report.size))
        share = np.mean(verdict[:, columns_of(one, report.size)] == 1)
        assert report.borderline == pytest.approx(share, abs=1e-12)
    with_joint = {
        joint: [s for s, faults in enumerate(one.sets) if joint in faults.joints]
        for joint in range(one.setting.n)
    }
    bad = {joint: np.mean(verdict[:, among] == 2) for joint, among in with_joint.items()}
    assert bad[arm.critical.joint] == max(bad.values()) > 0.0
    among = with_joint[arm.critical.joint]
    assert arm.critical_tolerated == pytest.approx(np.mean(verdict[:, among] == 0), abs=1e-12)


def test_the_mean_of_rho_follows_from_the_number_of_joints(pair):
    arm, data, one = pair
    n = one.setting.n
    for report in arm.sizes:
        rho = data["rho"].values[:, columns_of(one, report.size)]
        assert report.rho_bound == pytest.approx(np.sqrt(np.mean(rho**2)), rel=1e-9)
        wanted = math.comb(n - 3, report.size) / math.comb(n, report.size)
        assert report.rho_bound == pytest.approx(math.sqrt(wanted))


def test_the_worst_rho_of_a_posture(pair):
    arm, data, _ = pair
    wanted = np.median(data["rho"].values.min(axis=1))
    assert arm.worst_rho.value == pytest.approx(wanted, abs=1 / 32)
    assert arm.worst_rho.low <= wanted <= arm.worst_rho.high
    assert arm.evenness == arm.worst_rho.value / arm.sizes[1].rho_bound < 1.0


def test_jumps_over_the_force(pair):
    arm, data, one = pair
    for report in arm.sizes:
        values = data["jump"].values[:, columns_of(one, report.size)] / NORM
        wanted = np.quantile(values, [0.5, 0.95])
        np.testing.assert_allclose([x.value for x in report.jump], wanted, atol=BIN)
    assert arm.sizes[0].jump[0].value == 0.0  # no half bin: it is tolerated
    assert wanted[1] > 0.01 or arm.name == "kinova"


def test_capabilities(pair):
    arm, data, one = pair
    for report in arm.sizes:
        values = data["capability"].values[:, columns_of(one, report.size)]
        wanted = np.quantile(values, [0.05, 0.5])
        found = np.array([x.value for x in report.capability])
        assert np.all(np.abs(found - wanted) <= wanted * (DECADE - 1.0) + 1e-3)
    assert arm.healthy_capability is None  # a sweep does not hold it
    assert math.isnan(arm.capability_kept)


@pytest.mark.parametrize("enough", [0.95, 0.5])
def test_the_workspace(sweeps, enough):
    for arm in compare(sweeps, enough=enough).arms:
        one = next(one for one in sweeps if one.setting.robot == arm.name)
        grid, data = one.summary.workspace, one.dataset
        good = (data["verdict"].values == 0).all(axis=1)
        cells = np.floor((data["tip"].values - grid.origin) / grid.edge).astype(int)
        found, at = np.unique(cells, axis=0, return_inverse=True)
        share = np.bincount(at.ravel(), good) / np.bincount(at.ravel())
        place, volume = arm.workspace, grid.edge**3
        assert place.cell == grid.edge
        assert place.visited == pytest.approx(len(found) * volume)
        assert place.survived == pytest.approx((share >= enough).sum() * volume)
        assert place.some == pytest.approx((share > 0).sum() * volume)
        assert 0 <= place.survived <= place.some <= place.visited
        if arm.name == "kinova":  # of five joints not every pair can be tolerated
            assert 0 < place.survived < place.some < place.visited
        assert place.share == pytest.approx(np.mean(share >= enough))
        middle = np.array(grid.origin) + 0.5 * grid.edge * np.array(grid.shape)
        centres = grid.origin + (found + 0.5) * grid.edge
        assert place.reach == pytest.approx(np.linalg.norm(centres - middle, axis=1).max())


def test_the_healthy_arm_pushes_as_capability_says():
    found = compare(["dh5", "kinova"], n=64, direction=[1, 1, 1], axes="world", seed=3, payload=1.0)
    for arm in found.arms:
        robot = ftforce.load_robot(arm.name)
        most = []
        for q in Drawn.of(robot, 64, seed=3).block(0, 64):
            one = ftforce.capability(
                robot, q, locked=[1], direction=[1, 1, 1], axes="world", payload=1.0, limits="urdf"
            )
            amounts = {r.value: x for r, x in one.directions[-1].before.items()}
            most.append(amounts["commanded"].maximum)
        wanted = np.quantile(most, [0.05, 0.5])
        values = [x.value for x in arm.healthy_capability]
        assert np.all(np.abs(values - wanted) <= wanted * (DECADE - 1.0) + 1e-3)
        after = arm.sizes[0].capability[1].value
        assert arm.capability_kept == after / values[1] > 0.0


def test_a_robot_is_swept_like_a_sweep_of_it(two):
    asked = {"n": 2000, "seed": 5, "faults": 2, "force": FORCE, "cell": 0.2}
    swept, given = compare(NAMES, **asked), compare([sweep(arm, **asked) for arm in two])
    for one, other in zip(swept.arms, given.arms, strict=True):
        assert one.healthy_capability is not None
        assert replace(one, healthy_capability=None) == other


# ---- what is fair ------------------------------------------------------------------------------


def scaled(factor):
    """Return an arm whose lengths are multiplied."""
    rows = [(0.1, math.pi / 2, 0.3), (0.4, 0.0, 0.1), (0.2, -math.pi / 2, 0.1), (0.2, 0.0, 0.2),
            (0.1, math.pi / 2, 0.1)]  # fmt: skip
    return DHTable(
        name="design",
        convention="standard",
        rows=tuple(
            DHRow(a=a * factor, alpha=alpha, d=d * factor, theta=0.2, type="revolute",
                  lower=-2.0, upper=2.5)
            for a, alpha, d in rows
        ),
        mass=MassModel("solid cylinder", radius=0.03, density=2700.0),
    )  # fmt: skip


def test_size_does_not_count(tmp_path):
    files = [ftforce.write_robot(scaled(x), tmp_path / f"x{x:g}.urdf")[0] for x in (1.0, 3.0)]
    small, large = sorted(compare(files, n=4000, faults=2).arms, key=lambda arm: arm.name)
    assert (small.name, large.name) == ("design (x1.urdf)", "design (x3.urdf)")
    np.testing.assert_allclose(small.tolerated, large.tolerated, atol=1e-9)
    np.testing.assert_allclose(small.every, large.every, atol=1e-9)
    for one, other in zip(small.sizes, large.sizes, strict=True):
        np.testing.assert_allclose(one.margin, other.margin, atol=2 * BIN)
        np.testing.assert_allclose(one.rho, other.rho, atol=2 * BIN)
    assert small.evenness == pytest.approx(large.evenness, abs=1e-3)
    one, other = small.workspace, large.workspace
    assert other.reach == pytest.approx(3.0 * one.reach, rel=1e-9)
    assert other.visited == pytest.approx(27.0 * one.visited, rel=2e-3)
    assert other.share == pytest.approx(one.share, abs=2e-3)
    assert one.share > 0.1
    assert (small.first, small.last) == (large.first, large.last) == (1, 2)


def test_the_length_moves_margins_but_no_rho():
    short, long = (
        compare(["panda", "xarm7"], n=2000, task="wrench", length=length) for length in (0.3, 10.0)
    )
    for name in ("panda", "xarm7"):
        one, other = short[name].sizes[0], long[name].sizes[0]
        np.testing.assert_allclose(one.rho, other.rho, atol=1e-6)
        assert abs(one.margin[1].value - other.margin[1].value) > 0.01
        assert one.rho_bound == pytest.approx(math.sqrt(1 / 7))  # 0.378, theory §6


# ---- ranks -------------------------------------------------------------------------------------


def with_share(arm, name, value, half, every=0.5):
    return replace(
        arm, name=name, tolerated=Estimate(value, value - half, value + half),
        every=Estimate(every, every, every),
    )  # fmt: skip


def test_arms_whose_intervals_overlap_share_ranks(compared):
    arm = compared.arms[0]
    given = [
        with_share(arm, "d", 0.30, 0.01),
        with_share(arm, "b", 0.88, 0.02),
        with_share(arm, "a", 0.90, 0.01),
        with_share(arm, "c", 0.86, 0.01),
        with_share(arm, "f", 0.10, 0.01, every=0.2),
        with_share(arm, "e", 0.10, 0.01, every=0.3),
    ]
    found = [(one.name, one.first, one.last) for one in _ranked(given)]
    assert found == [("a", 1, 2), ("b", 1, 3), ("c", 2, 3), ("d", 4, 4), ("e", 5, 6), ("f", 5, 6)]


def test_the_sentence_names_ties(compared):
    arm = compared.arms[0]
    apart = replace(compared, arms=_ranked([with_share(arm, x, y, 0.01) for x, y in
                                            (("a", 0.9), ("b", 0.5))]))  # fmt: skip
    said = comparison_sentence(apart)
    assert said.startswith(
        "a degrades most gracefully: with up to 2 joints locked it keeps the force for 90.0%"
    )
    assert "b degrades least gracefully: 50.0%" in said
    assert "overlap" not in said
    close = replace(compared, arms=_ranked([with_share(arm, x, 0.9, 0.01) for x in "abcdefg"]))
    said = comparison_sentence(close)
    assert "b, c, d, e and 2 more may be as good: the intervals overlap." in said
    assert "worst" not in said
    assert [one.name for one in close.best] == list("abcdefg")


def test_real_arms_are_ranked_by_their_shares(compared):
    shares = [arm.tolerated.value for arm in compared.arms]
    assert shares == sorted(shares, reverse=True)
    assert [arm.first for arm in compared.arms] == [1, 2]


# ---- names, and what is refused ----------------------------------------------------------------


def test_arms_of_one_name_are_told_apart(tmp_path):
    found = compare(["dh5", "dh5", "kinova"], n=200)
    assert {arm.name for arm in found.arms} == {"dh5 #1", "dh5 #2", "kinova"}
    assert found["dh5 #1"].tolerated == found["dh5 #2"].tolerated
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    files = [ftforce.write_robot(scaled(x), tmp_path / y / "arm.urdf")[0]
             for x, y in ((1.0, "a"), (1.5, "b"))]  # fmt: skip
    found = compare(files, n=200)
    assert {arm.name for arm in found.arms} == {f"design ({file})" for file in files}
    found = compare({"long": files[0], "short": "dh5"}, n=200)
    assert {arm.name for arm in found.arms} == {"long", "short"}
    with pytest.raises(UnknownNameError, match="long"):
        found["lon"]


DIFFERENT = {
    "faults": (2, "size of sets 1 and 2"),
    "mode": ("free", "mode locked and free"),
    "axes": ("world", "axes tool and world"),
    "task": ("fx,fz", "task (fx, fy, fz) and (fx, fz)"),
    "force": ([0, 0, 50], "force none and (0, 0, 50)"),
    "direction": ([0, 0, 50], "limits none and enforced"),
    "gravity": ([0, 0, 0], "gravity (0, 0, -9.81) and (0, 0, 0)"),
    "payload": (2.0, "payload none and 2"),
    "rtol": (1e-5, "rtol 1e-06 and 1e-05"),
    "wary": (0.1, "wary 0.01 and 0.1"),
}


@pytest.fixture(scope="module")
def plain(two):
    return sweep(two[0], n=64)


@pytest.mark.parametrize("key", DIFFERENT)
def test_different_questions_are_refused(two, plain, key):
    value, reason = DIFFERENT[key]
    with pytest.raises(InputError) as problem:
        compare([plain, sweep(two[1], n=64, **{key: value})])
    said = str(problem.value)
    assert said.startswith("dh5 and kinova have different settings: ")
    assert reason in said
    assert "\n" not in said


def test_the_length_is_of_the_question_if_there_are_moments(two):
    one, other = two
    compare([sweep(one, n=64, length=0.5), sweep(other, n=64)])
    wrenches = [sweep(one, n=64, task="wrench", length=0.5), sweep(other, n=64, task="wrench")]
    with pytest.raises(InputError, match=r"length 0\.5 and 1"):
        compare(wrenches)


def test_robots_and_sweeps_together(tmp_path):
    stored = tmp_path / "dh5.zarr"
    sweep(ftforce.load_robot("dh5"), n=500, force=FORCE, output=stored)
    found = compare([stored, "kinova"], n=500, force=FORCE)
    assert found["dh5"].path == str(stored)
    assert found["kinova"].path is None
    assert "cells of other sizes" in " ".join(found.warnings) or len(found.warnings) == 0
    seen = []
    with pytest.raises(InputError, match="dh5 and kinova have different settings: force"):
        compare(["kinova", stored], n=500, progress=lambda *x: seen.append(x))
    with pytest.raises(InputError, match=r"leave out n \(--samples\), force"):
        compare([stored, stored], n=500, force=FORCE)
    other = tmp_path / "other.zarr"
    sweep(ftforce.load_robot("ur5"), n=64, output=other)
    with pytest.raises(InputError, match="dh5 and ur5 have different settings: force"):
        compare(["kinova", stored, other], n=500, force=FORCE, progress=lambda *x: seen.append(x))
    assert seen == []  # nothing is swept for what will be refused
    with pytest.raises(FileError, match="no such folder"):
        compare([stored, tmp_path / "none.zarr"])
    with pytest.raises(FileError, match="is not a sweep"):
        compare([stored, tmp_path])


@pytest.mark.parametrize("arms", [[], ["dh5"], "dh5"])
def test_a_comparison_needs_two(arms):
    with pytest.raises(InputError, match=r"two (arms )?or more"):
        compare(arms)


def test_an_arm_that_cannot_be_swept_is_named():
    arm = load_text(serial_urdf(("revolute", {}), ("prismatic", {})))
    slide = replace(arm.joints[1], lower=-math.inf, upper=math.inf)
    free = replace(arm, joints=(arm.joints[0], slide))
    with pytest.raises(InputError, match=r"^rail: .*has no position limits"):
        compare({"dh5": "dh5", "rail": free}, n=64)
    with pytest.raises(InputError, match=r"^dh5: faults must be an integer from 1 to 5, got 6"):
        compare(["kinova", "dh5"], n=64, faults=6)
    with pytest.raises(InputError, match="arms are robots"):
        compare(["dh5", 7])
    with pytest.raises(InputError, match="enough"):
        compare(NAMES, n=64, enough=0.0)


def test_the_progress_is_of_all_arms():
    seen = []
    compare(NAMES, n=70_000, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (140_000, 140_000)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert {total for _, total in seen} == {140_000}


def test_doubts():
    found = compare(["dh5", "tiago", "so101"], n=300, task="wrench", direction=[0, 0, 1, 0, 0, 0])
    said = " ".join(found.warnings)
    assert "dh5 at 0%, so101 at 0%" in said
    assert "1 rad of rotation: tiago" in said
    assert "unknown effort limits are not enforced: so101 (shoulder_pan" in said
    assert not found["dh5"].is_whole
    assert found["tiago"].is_whole
    few, many = (sweep(ftforce.load_robot(x), n=n) for x, n in (("dh5", 64), ("kinova", 128)))
    assert "128 of kinova" in " ".join(compare([few, many]).warnings)
    recorded = sweep(ftforce.load_robot("dh5"), np.zeros((3, 5)))
    assert "not drawn at random within the joint limits: dh5" in " ".join(
        compare([recorded, many]).warnings
    )


def printed(result):
    console = Console(file=io.StringIO(), width=80)
    console.print(comparison_view(result))
    return console.file.getvalue()


def test_an_arm_without_known_limits_is_not_the_strongest():
    found = compare(["dh5", "so101"], n=300, direction=[0, 0, 1])
    assert math.isinf(found["so101"].sizes[0].capability[1].value)
    assert math.isinf(found["so101"].healthy_capability[0].value)
    assert math.isnan(found["so101"].capability_kept)
    said = comparison_sentence(found)
    assert "of those whose limits are known" in said
    assert "dh5 retains the largest force along (0.00, 0.00, 1.00)" in said
    row = next(line for line in printed(found).splitlines() if "no limit" in line)
    assert row.split() == ["so101", *["no", "limit"] * 4, "–"]
    document = comparison_document(found)
    (one,) = (arm for arm in document["arms"] if arm["name"] == "so101")
    assert one["sizes"][0]["capability"]["q50"]["value"] is None


def test_forty_arms_with_long_names_fit(compared):
    arm = compared.arms[0]
    names = [f"a_design_of_which_the_name_is_too_long_for_a_table_{k:02}" for k in range(40)]
    many = replace(compared, arms=_ranked([with_share(arm, name, 0.9, 0.01) for name in names]))
    output = printed(many)
    assert all(len(line.rstrip()) <= 80 for line in output.splitlines())
    assert output.count("1–40") == 40
    together = "".join(output.split())
    assert "…" not in together
    assert "and 35 more may be as good" in " ".join(output.split())


def test_joints_that_swing_have_no_bound():
    found = compare(NAMES, n=300, mode="free", force=FORCE)
    for arm in found.arms:
        assert math.isnan(arm.sizes[0].rho_bound)
        assert math.isnan(arm.evenness)
        assert arm.sizes[0].jump[1].value > 0.5  # or infinite


# ---- files -------------------------------------------------------------------------------------


def test_the_document_holds_what_the_reports_say(compared):
    found = json.loads(json.dumps(comparison_document(compared), allow_nan=False))
    assert found["question"]["faults"] == 2
    assert found["question"]["force"] == FORCE
    assert found["question"]["length"] is None
    assert found["question"]["limits_count"] is True
    assert [arm["name"] for arm in found["arms"]] == [arm.name for arm in compared.arms]
    for one, arm in zip(found["arms"], compared.arms, strict=True):
        assert one["rank"] == [arm.first, arm.last]
        assert list(one["tolerated"].values()) == list(arm.tolerated)
        assert list(one["every"].values()) == list(arm.every)
        assert one["evenness"] == arm.evenness
        assert one["workspace"]["survived"] == arm.workspace.survived
        assert one["critical_joint"]["joint"] == arm.setting.joints[arm.critical.joint]
        assert one["healthy_capability"] is None
        for part, report in zip(one["sizes"], arm.sizes, strict=True):
            assert part["margin"]["q05"]["value"] == report.margin[0].value
            assert part["jump"]["q95"]["value"] == report.jump[1].value
            assert part["capability"]["q50"]["high"] == report.capability[1].high
    assert found["summary"] == comparison_sentence(compared)


def test_the_table_has_a_row_per_arm_and_size(compared):
    rows = comparison_rows(compared)
    text = io.StringIO()
    csv.writer(text).writerows(_unsigned(rows))
    found = list(csv.DictReader(io.StringIO(text.getvalue())))
    keys = [(row["arm"], int(row["size"])) for row in found]
    assert keys == [(arm.name, size) for arm in compared.arms for size in (1, 2)]
    for row in found:
        arm = compared[row["arm"]]
        report = arm.sizes[int(row["size"]) - 1]
        assert float(row["tolerated"]) == arm.tolerated.value
        assert float(row["size_low"]) == report.tolerated.low
        assert float(row["rho_q50"]) == report.rho[1].value
        assert float(row["capability_q05 [N]"]) == report.capability[0].value
        assert float(row["visited [m³]"]) == arm.workspace.visited
        assert row["healthy_capability_q50 [N]"] == row["length [m]"] == ""
        assert row["limits"] == "urdf"


# ---- plots -------------------------------------------------------------------------------------


def test_dots_stand_where_the_numbers_are(compared):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    from ftforce.show.plots.comparison import SHOWN, comparison, lay_out

    for shown in SHOWN:
        ax = Figure().subplots()
        assert comparison(compared, shown=shown, ax=ax) is ax
        dots, marks = ax.get_lines()[:2]
        (lines,) = (c for c in ax.collections if len(c.get_segments()) == 2)
        for row, arm in enumerate(compared.arms):
            ends = sorted(lines.get_segments()[row][:, 0])
            if shown in {"tolerated", "every"}:
                value, *wanted = (100.0 * x for x in getattr(arm, shown))
            else:
                few, half = getattr(arm.largest, shown)
                value, wanted = half.value, [few.value, half.value]
            assert dots.get_xdata()[row] == value
            np.testing.assert_allclose(ends, wanted)
            bound = arm.largest.rho_bound if shown == "rho" else math.nan
            np.testing.assert_equal(marks.get_xdata()[row], bound)
        labels = [tick.get_text() for tick in ax.get_yticklabels()]
        assert labels == [f"{arm.name}  {arm.first}" for arm in compared.arms]
    with pytest.raises(UnknownNameError, match="available: tolerated"):
        comparison(compared, shown="colour")
    ax = comparison(compared, most=1)
    assert len(ax.get_yticklabels()) == 1
    assert "the best 1 of 2 arms" in ax.get_title(loc="center") + ax.get_title(loc="left")
    drawn = Figure(layout="constrained")
    lay_out(drawn, compared)
    assert [one.get_title() for one in drawn.axes] == [
        "Tolerated", "Every set tolerated", "ρ, 2 joints", "Margin, 2 joints",
    ]  # fmt: skip


def test_pairs_of_five_joints_have_their_bound():
    """The bound of theory §6: Σ ρ² = C(n-m, f) over the sets, so the least is below the mean."""
    assert len(list(combinations(range(5), 2))) == math.comb(5, 2)
    found = compare(NAMES, n=200, faults=2)
    assert found["dh5"].largest.rho_bound == pytest.approx(math.sqrt(1 / 10))
    assert found["kinova"].largest.rho_bound == pytest.approx(math.sqrt(3 / 15))
