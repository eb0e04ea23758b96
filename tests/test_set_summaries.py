"""What a sweep says of fault sets, in numbers, words and tables, against its own samples."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.stats import binomtest

import ftforce
from ftforce.batch.kernels.layout import BORDERLINE, NOT_TOLERATED, TOLERATED
from ftforce.batch.summary.criticality import Estimate
from ftforce.report.files import to_text
from ftforce.report.sweep import force_in_words, interval, share, sweep_sentence
from ftforce.robot.kinematics import frame_jacobian
from ftforce.show.render import to_text as to_table
from results import csv_of

pytestmark = pytest.mark.thorough

N = 3000


@pytest.fixture(scope="module")
def swept():
    """Return a sweep whose samples are kept: pairs of locked joints, a force, limits."""
    arm = ftforce.load_robot("dh5")
    return ftforce.sweep(arm, n=N, faults=2, force=[80, 50, 10], keep="all", cell=0.3)


@pytest.fixture(scope="module")
def free():
    """Return a sweep of joints that swing free, whose jumps exceed the force."""
    arm = ftforce.load_robot("panda")
    return ftforce.sweep(arm, n=N, mode="free", force=[0, 0, 50], axes="world", keep="all")


@pytest.fixture(scope="module")
def bare():
    """Return a sweep without a force."""
    return ftforce.sweep(ftforce.load_robot("dh5"), n=500, faults=2)


def samples(sweep, one):
    """Return the samples of a set, by name."""
    s = sweep.sets.index(one.faults)
    dataset = sweep.dataset
    kept = [name for name, x in dataset.items() if x.dims == ("posture", "fault_set")]
    return {name: dataset[name].to_numpy()[:, s] for name in kept}


def check_share(estimate, count, trials):
    exact = binomtest(count, trials).proportion_ci(method="wilson")
    assert estimate.value == count / trials
    np.testing.assert_allclose(estimate[1:], (exact.low, exact.high), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("which", ["swept", "free"])
def test_a_set_is_what_its_samples_say(which, request):
    sweep = request.getfixturevalue(which)
    for one in sweep.ranked:
        found = samples(sweep, one)
        for code, estimate in (
            (TOLERATED, one.tolerated),
            (BORDERLINE, one.borderline),
            (NOT_TOLERATED, one.not_tolerated),
        ):
            check_share(estimate, int((found["verdict"] == code).sum()), N)
        assert one.loses_rank == (found["rank_lost"] > 0).mean()
        assert one.falls == np.isnan(found["jump"]).mean()
        check_quantiles(one.margin, found["margin"], (0.05, 0.5), 1e-3)
        check_quantiles(one.rho, found["rho"], (0.05, 0.5), 1e-3)


def check_quantiles(got, values, shares, bin_width):
    values = values[~np.isnan(values)]
    wanted = np.quantile(values, shares, method="nearest") if len(values) else [math.nan] * 2
    np.testing.assert_allclose(got, wanted, atol=1.01 * bin_width)


@pytest.mark.parametrize("which", ["swept", "free"])
def test_jumps_and_capabilities_of_a_set(which, request):
    sweep = request.getfixturevalue(which)
    force = float(np.hypot.reduce(sweep.setting.force))
    seen = set()
    for one in sweep.ranked:
        found = samples(sweep, one)
        jump = found["jump"][~np.isnan(found["jump"])]
        *quantiles, most = one.jump
        if not len(jump):
            assert np.isnan(one.jump).all()
            continue
        assert most == jump.max()
        for got, p in zip(quantiles, (0.5, 0.95), strict=True):
            wanted = np.quantile(jump, p, method="nearest")
            seen.add("above" if wanted > force else "within")
            if wanted > force * 1.001:
                assert got == math.inf
            else:
                assert got <= most
                assert abs(got - wanted) <= 1.01e-3 * force
        capable = np.nan_to_num(found["capability"], nan=0.0)
        for got, p in zip(one.capability, (0.05, 0.5), strict=True):
            wanted = np.quantile(capable, p, method="nearest")
            assert got == pytest.approx(wanted, rel=0.03, abs=1e-3)
    assert "within" in seen
    assert which == "swept" or "above" in seen


def test_sets_stand_in_the_order_that_is_promised(swept):
    shares = [(-one.not_tolerated.value, -one.borderline.value) for one in swept.ranked]
    assert shares == sorted(shares)
    assert {one.faults for one in swept.ranked} == set(swept.sets)


def test_postures_that_tolerate_every_set(swept):
    every = (swept.dataset["verdict"].to_numpy() == TOLERATED).all(axis=1).sum()
    check_share(swept.every_set, int(every), N)


def test_without_a_force_nothing_jumps_and_without_a_direction_nothing_is_pushed(bare):
    for one in bare.ranked:
        assert one.jump is None
        assert one.capability is None
        assert math.isnan(one.falls)


# ---- JSON, CSV, tables -----------------------------------------------------------------------


@pytest.mark.parametrize("which", ["swept", "free", "bare"])
def test_json_and_csv_say_the_same(which, request):
    sweep = request.getfixturevalue(which)
    document, rows = json.loads(to_text(sweep, "json")), csv_of(sweep)
    assert document["postures"]["done"] == sweep.done
    assert document["summary"] == sweep_sentence(sweep)
    assert document["every_set_tolerated"]["value"] == sweep.every_set.value
    names = sweep.setting.joints
    for one, row, ranked in zip(document["sets"], rows, sweep.ranked, strict=True):
        assert one["joints"] == row["joints"].split() == [names[i] for i in ranked.faults.joints]
        assert one["not_tolerated"]["value"] == float(row["not_tolerated"])
        assert one["tolerated"]["low"] == float(row["tolerated_low"])
        assert one["margin"]["5"] == float(row["margin_5"]) == ranked.margin[0]
        assert (one["jump"] is None) == (row["jump_most [N]"] == "") or one["jump"]["most"] is None
        assert row["task"] == "force"
    for one, joint in zip(document["joints"], sweep.joints, strict=True):
        assert one["joint"] == names[joint.joint]
        assert one["not_tolerated"]["high"] == joint.not_tolerated.high
        assert one["relative_manipulability"]["5"]["value"] == joint.rho[0].value


def test_the_table_shows_every_joint_with_its_interval(swept):
    text = to_table(swept)
    assert max(map(len, text.splitlines())) <= 80
    for joint in swept.joints:
        line = next(x for x in text.splitlines() if f"joint{joint.joint + 1} " in x and "(" in x)
        assert interval(joint.not_tolerated) in line
    assert "{2, 3}" in text
    assert f"{N:,} scrambled Sobol postures" in text


def test_the_table_of_jumps_above_the_force_does_not_call_them_the_largest(free):
    text = to_table(free)
    worst = next(one for one in free.ranked if one.jump[0] == math.inf)
    number = worst.faults.joints[0] + 1
    line = next(x for x in text.splitlines() if f" {{{number}}} " in x)
    assert ">50" in line
    assert f"{worst.jump[2]:.1f}" in line


def test_a_sweep_that_is_not_complete_says_so(bare):
    cut = dataclasses.replace(bare, setting=dataclasses.replace(bare.setting, count=4000))
    assert "only 500 of 4,000 postures are done" in cut.warnings[0]
    assert "only 500 of 4,000 postures" in " ".join(to_table(cut).split())


# ---- words -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "text"),
    [(0.0, "0"), (1.0, "100"), (1e-7, "<0.01"), (1.0 - 1e-7, ">99.99"), (0.01234, "1.23"),
     (0.5, "50.0"), (0.9951, "99.51"), (math.nan, "–")],
)  # fmt: skip
def test_shares_never_claim_none_or_all_wrongly(x, text):
    assert share(x) == text


def test_an_interval_is_written_behind_its_share():
    assert interval(Estimate(0.5, 0.4, 0.6)) == "50.0 (40.0–60.0)"
    assert interval(Estimate(math.nan, math.nan, math.nan)) == "–"


def test_the_sentence_names_the_critical_joint(swept, free):
    # only joints 1 and 2 push along the other joints' axes: without both that is lost
    assert "The critical joints are joint1 and joint2" in sweep_sentence(swept)
    assert "whichever 2 joints lock." in sweep_sentence(swept)
    assert "whichever joint becomes free-swinging." in sweep_sentence(free)
    assert force_in_words(swept.setting) == "fx 80.00 N, fy 50.00 N, fz 10.00 N"


def fake(sweep, shares, borderline=(), largest=1):
    """Return a sweep of other counts: shares of 1000 postures not tolerated when joints fail."""
    from ftforce.batch.summary.summary import Summary

    n = len(shares)
    summary = Summary.empty(n, sweep.summary.bins, sweep.summary.workspace)
    summary.postures[...] = 1000
    for s, (bad, doubt) in enumerate(zip(shares, borderline or [0] * n, strict=True)):
        summary.verdicts[s] = 1000 - bad - doubt, doubt, bad
    summary.tolerated_sets[-1] = 1000 - max(shares) - max(borderline or [0])
    setting = dataclasses.replace(
        sweep.setting, joints=sweep.setting.joints[:n], largest=largest, count=1000, force=None
    )
    return dataclasses.replace(sweep, setting=setting, sets=sweep.sets[:n], summary=summary)


def test_joints_that_cannot_be_told_apart_are_named_together(bare):
    assert "The critical joint is joint2: 40% of" in sweep_sentence(fake(bare, [0, 400, 0]))
    assert "No joint is critical" in sweep_sentence(fake(bare, [0, 0, 0]))
    assert "too close to tell apart" in sweep_sentence(fake(bare, [300, 310, 0]))
    assert "No joint is more critical than the others: 31%" in sweep_sentence(
        fake(bare, [300, 310, 305])
    )
    assert "Nothing is lost; the most critical joint is joint2: 10% of" in sweep_sentence(
        fake(bare, [0, 0, 0], [50, 100, 0])
    )
    # The first row of the table is the critical one, not the one that is borderline most often.
    found = sweep_sentence(fake(bare, [1, 0, 0], [50, 100, 0]))
    assert "Almost nothing is lost; the most critical joint is joint1: 0.1% of" in found
    assert found.endswith("joint2 is borderline most often: in 10% of the postures.")


@pytest.mark.parametrize("lost", [[0, 400, 0], [300, 310, 0], [1, 0, 0], [0, 0, 0], [5, 5, 900]])
@pytest.mark.parametrize("borderline", [[0, 0, 0], [50, 99, 0]])
def test_the_sentence_names_the_first_row_of_the_joints(bare, lost, borderline):
    sweep = fake(bare, lost, borderline)
    sentence = sweep_sentence(sweep).partition(". ")[2]
    assert f"joint{sweep.joints[0].joint + 1}" in sentence or "No joint is" in sentence
    for one, rank in zip(sweep.joints, sweep.joint_ranks, strict=True):
        own = one.not_tolerated
        below = [x for x in sweep.joints if x.not_tolerated.high < own.low]
        above = [x for x in sweep.joints if x.not_tolerated.low > own.high]
        assert rank == (len(above) + 1, 3 - len(below))


def test_the_tables_of_a_sweep_show_ranks_and_the_healthy_arm(swept):
    shown = to_table(swept).splitlines()
    assert max(map(len, shown)) <= 80
    rows = [line.split() for line in shown]
    first = swept.joints[0].joint
    assert rows[rows.index(["Joints,", "most", "critical", "first"]) + 3][1] == str(first + 1)
    healthy = next(row for row in rows if row[:1] == ["none"])
    low, middle = swept.healthy_margin
    arm = ftforce.load_robot("dh5")
    assert healthy[1:3] == [f"{low:.3g}", f"{middle:.3g}"]
    rng = np.random.default_rng(3)
    J = [frame_jacobian(arm, rng.uniform(arm.lower, arm.upper))[:3] for _ in range(2000)]
    s = np.linalg.svd(J, compute_uv=False)
    wanted = np.quantile(s[:, 2] / s[:, 0], [0.05, 0.5])
    np.testing.assert_allclose([low, middle], wanted, rtol=0.15)
