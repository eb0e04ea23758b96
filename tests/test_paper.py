"""Every number of the paper's case study (section IV), through the public interface.

The numbers are written out here once more, so that a slip in ftforce/analysis/paper.py shows.
"""

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce import Verdict
from ftforce.analysis.paper import Check, Outcome, paper_tables, replicate
from ftforce.robot.formats.dh import DHTable
from ftforce.robot.known_robots import robots_folder
from helpers import assert_close, load_table

FORCE = [80, 50, 10]
SPEED = [0.05, 0.40, 0.20, 0.10, 0.30]
TORQUE = (-35.01, -12.33, 26.85, 10.00, 4.00)
JUMPS = {
    (1,): 0.0,
    (2,): 0.0,
    (3,): 80.00,
    (4,): 0.0,
    (5,): 0.0,
    (2, 3): 80.00,
    (2, 4): 0.0,
    (2, 3, 4): 80.00,
    (2, 4, 5): 43.66,
}


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def healthy(arm):
    return ftforce.analyze(arm, posture="paper", force=FORCE, velocity=SPEED)


def printed(values, decimals=2):
    return [f"{value + 0.0:.{decimals}f}".replace("-0.00", "0.00") for value in values]


def changed(**steps):
    """Return the arm of Table 1 with other numbers in its second row."""
    table = DHTable.from_toml(robots_folder() / "dh5.toml")
    rows = list(table.rows)
    rows[1] = type(rows[1])(**{**vars(rows[1]), **steps})
    return load_table(
        DHTable("other", table.convention, tuple(rows), table.mass, dict(table.postures))
    )


def test_posture_and_jacobian_of_equation_34(healthy):
    assert_close(np.rad2deg(healthy.posture.q), [10, 70, 25, 65, 0])
    assert [printed(row) for row in healthy.J] == [
        ["0.00", "0.00", "0.16", "0.00", "0.00"],
        ["-0.57", "-0.15", "0.28", "0.20", "0.08"],
        ["-0.64", "-0.48", "0.00", "0.00", "0.00"],
    ]


def test_torques_of_table_2(healthy):
    assert printed(healthy.torque.before) == printed(TORQUE)


def test_share_of_each_joint_in_the_velocity_of_table_2(healthy):
    expected = ["0.19", "0.89", "0.28", "0.09", "0.11"]
    assert printed(healthy.velocity_contributions) == expected


def test_share_of_each_torque_as_the_paper_states_it(healthy):
    # Theory §7 rounds the third one to 1.73; it is 1.7352, so two decimals are 1.74.
    assert printed(healthy.force_contributions) == ["1.02", "0.54", "1.74", "0.45", "0.07"]
    assert healthy.force_contributions[2] == pytest.approx(1.735186, abs=1e-6)


def test_share_of_each_torque_as_table_2_prints_it(healthy):
    norm = np.linalg.norm(np.linalg.pinv(healthy.J.T), 2)
    share = norm * np.abs(healthy.torque.before) / np.linalg.norm(FORCE)
    assert printed(share) == ["3.18", "1.12", "2.44", "0.91", "0.36"]


def test_velocity_of_the_tip_is_in_metres_per_second(healthy):
    x, y, z = healthy.velocity.tip_before
    assert (f"{x:.3f}", f"{y:.2f}", f"{z:.2f}") == ("0.033", "0.01", "-0.23")


@pytest.mark.parametrize(("locked", "jump"), JUMPS.items(), ids=str)
def test_torques_and_jumps_of_equation_42_and_tables_3_to_5(arm, healthy, locked, jump):
    result = ftforce.analyze(arm, posture="paper", locked=locked, force=FORCE)
    expected = [0.0 if k in locked else tau for k, tau in enumerate(TORQUE, start=1)]
    assert printed(result.torque.after) == printed(expected)
    assert f"{result.force.jump_norm:.2f}" == f"{jump:.2f}"
    tolerated = Verdict.TOLERATED if jump == 0.0 else Verdict.NOT_TOLERATED
    assert result.verdict is tolerated
    by_torque = ftforce.analyze(arm, locked=locked, torque=healthy.torque.before)
    assert_close(by_torque.force.before, FORCE)
    assert f"{by_torque.force.jump_norm:.2f}" == f"{jump:.2f}"


def test_the_same_in_the_census(arm):
    sets = ftforce.census(arm, posture="paper", faults=3, force=FORCE).sets
    found = {tuple(k + 1 for k in report.faults.joints): report.jump_norm for report in sets}
    assert printed(found[locked] for locked in JUMPS) == printed(JUMPS.values())


def test_only_the_third_joint_is_critical_alone(arm):
    census = ftforce.census(arm, force=FORCE)
    lost = [report.faults.joints for report in census.sets if report.verdict != "tolerated"]
    assert lost == [(2,)]
    assert census.joints[0].joint == 2


def test_world_axes_give_another_force_jump(arm):
    # Theory §1: the same numbers of force mean another force there, so axes are always stated.
    result = ftforce.analyze(arm, locked=[2, 4, 5], force=FORCE, axes="world")
    assert f"{result.force.jump_norm:.1f}" == "66.2"


def test_replication_passes_with_its_errata():
    replication = replicate()
    assert replication.is_successful
    assert len(replication.checks) == 99
    counts = [replication.count(outcome) for outcome in Outcome]
    assert dict(zip(Outcome, counts, strict=True)) == {
        "pass": 91, "erratum": 8, "fail": 0, "computed": 0
    }  # fmt: skip
    assert not replication.is_of_another_arm


def test_replication_names_where_each_number_stands():
    tables = [check.table for check in replicate().checks]
    assert {table: tables.count(table) for table in tables} == {
        "J, eq. (34)": 15,
        "Table 2": 15,
        "Ẋ, section IV": 3,
        "¹J, eq. (35)": 12,
        "Eq. (42)": 6,
        "Table 3": 24,
        "Table 4": 12,
        "Table 5": 12,
    }
    excused = {check.table for check in replicate().checks if check.erratum}
    assert excused == {"Table 2", "Ẋ, section IV"}


def test_replication_prints_what_the_paper_prints():
    checks = replicate().checks
    torques = [float(c.printed) for c in checks if c.table == "Table 2" and c.column == "torque"]
    assert tuple(torques) == TORQUE
    jumps = [float(c.printed) for c in checks if c.row == "force jump"]
    assert jumps == list(JUMPS.values())


@pytest.mark.parametrize("step", [{"a": 0.33}, {"alpha": 0.0}, {"alpha": 1.55}])
def test_replication_fails_for_another_arm(step):
    replication = replicate(changed(**step))
    assert not replication.is_successful
    assert replication.count(Outcome.FAIL) > 5
    assert len(replication.checks) == 99


def test_the_tables_of_the_papers_arm_have_its_numbers():
    """Computed as those of another arm, they are the printed ones."""
    found = paper_tables(ftforce.load_robot("dh5"), posture="paper")
    assert found.is_of_another_arm
    printed = {(c.table, c.row, c.column): c for c in replicate().checks}
    for check in found.checks:
        assert check.outcome is Outcome.COMPUTED
        same = printed[check.table, check.row, check.column.replace("m/s", "cm/s")]
        assert check.computed == (same.explained if "m/s" in same.column else same.computed)
    assert len(found.checks) == len(printed)


def test_the_tables_of_a_longer_arm():
    panda = ftforce.load_robot("panda")
    found = paper_tables(panda, force=[10, 0, 20])
    single = {c.column for c in found.checks if c.table == "Table 3"}
    assert single == {f"{{{joint}}}" for joint in range(2, 8)}
    J = pin.computeFrameJacobian(
        panda.model, panda.data, panda.postures["default"], panda.tip_frame, pin.LOCAL
    )
    torque = [c.computed for c in found.checks if (c.table, c.column) == ("Table 2", "torque")]
    assert_close(np.array(torque), J[:3].T @ [10.0, 0.0, 20.0])
    assert len(paper_tables(panda, velocity=[0.0] * 7).checks) == len(found.checks)
    with pytest.raises(ftforce.FtforceError, match="velocity needs 7 numbers"):
        paper_tables(panda, velocity=[1, 2])


def test_replication_needs_the_posture_of_the_paper():
    with pytest.raises(ftforce.FtforceError, match="unknown posture 'paper'"):
        replicate(ftforce.load_robot("panda"))


@pytest.mark.parametrize(
    ("text", "computed", "explained", "outcome"),
    [
        ("1.74", 1.7352, 9.0, Outcome.PASS),
        ("1.74", 1.7349, 9.0, Outcome.FAIL),
        ("1.74", 1.745, 9.0, Outcome.PASS),
        ("1.74", 1.7451, 9.0, Outcome.FAIL),
        ("1.74", -1.74, 1.7352, Outcome.ERRATUM),
        ("1.74", np.nan, np.nan, Outcome.FAIL),
        ("80", 80.49, np.nan, Outcome.PASS),
        ("80", 79.4, np.nan, Outcome.FAIL),
    ],
)
def test_every_printed_digit_counts(text, computed, explained, outcome):
    assert Check("", "", "", text, computed, "known", explained).outcome is outcome
