"""census(): every fault set of a posture, as analyze() sees each, in the right order."""

import copy
import math
import pickle
from dataclasses import FrozenInstanceError
from itertools import combinations, pairwise

import numpy as np
import pytest

import ftforce
from ftforce import Verdict, analyze, census
from ftforce.errors import InputError
from ftforce.kinematics import tip_pose
from helpers import KNOWN, arrays_in, assert_close, load_text, serial_urdf, stretched

FORCE = [80.0, 50.0, 10.0]
LEVEL = ("revolute", {"xyz": (0.3, 0, 0)})
SEVERITY = [Verdict.NOT_TOLERATED, Verdict.BORDERLINE, Verdict.TOLERATED]


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def numbers(report):
    return [k + 1 for k in report.faults.joints]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("dh5", {"force": FORCE}),
        ("dh5", {}),
        ("dh5", {"torque": [1.0, -2.0, 3.0, 4.0, -5.0], "rtol": 1e-4, "wary": 0.1}),
        ("panda", {"force": [1, -2, 3, 4, -5, 6], "task": "wrench", "length": 0.3}),
        ("panda", {"task": "wrench", "axes": "world"}),
        ("kinova", {"force": [5, 3], "task": "fy,mz"}),
        ("tiago", {"posture": "zero", "force": FORCE}),
    ],
    ids=str,
)
def test_every_set_is_what_analyze_says(name, options):
    arm = ftforce.load_robot(name)
    result = census(arm, faults=2, **options)
    assert len(result.sets) == arm.n + math.comb(arm.n, 2)
    for report in result.sets:
        alone = analyze(arm, locked=numbers(report), **options)
        assert report.verdict is alone.verdict
        assert report.rank_after == alone.reduced.rank_after
        assert report.rank_lost == alone.reduced.rank - alone.reduced.rank_after
        assert_close(report.margin, alone.margin, scale=1.0)
        assert_close(report.sigma_min_after, alone.reduced.damaged.s[-1], scale=1.0)
        assert_close(
            report.relative_manipulability, alone.relative_manipulability, scale=1.0, tol=1e-7
        )
        if alone.force is None:
            assert report.after is report.jump is report.jump_norm is None
            assert report.relative_jump == float(report.rank_lost > 0)
            continue
        size = np.linalg.norm(alone.force.before)
        assert_close(report.after, alone.force.after, scale=size)
        assert_close(report.jump, alone.force.jump, scale=size)
        for norm in ("jump_norm", "moment_jump_norm"):
            one, other = getattr(report, norm), getattr(alone.force, norm)
            assert (one is None) == (other is None)
            assert_close(one or 0.0, other or 0.0, scale=size)
        weighted = [result.task.weigh_force(x) for x in (alone.force.jump, alone.force.before)]
        relative = np.linalg.norm(weighted[0]) / np.linalg.norm(weighted[1])
        assert_close(report.relative_jump, relative, scale=1.0)


@pytest.mark.parametrize("name", KNOWN)
def test_every_set_comes_once(name):
    arm = ftforce.load_robot(name)
    result = census(arm, faults=2)
    expected = [*combinations(range(arm.n), 1), *combinations(range(arm.n), 2)]
    assert sorted(report.faults.joints for report in result.sets) == sorted(expected)
    assert sorted(report.joint for report in result.joints) == list(range(arm.n))


@pytest.mark.parametrize("options", [{"force": FORCE}, {}, {"task": "wrench"}], ids=str)
def test_sets_come_worst_first(dh5, options):
    reports = census(dh5, faults=3, **options).sets
    for one, other in pairwise(reports):
        severity = [SEVERITY.index(report.verdict) for report in (one, other)]
        jumps = [round(report.relative_jump, 9) for report in (one, other)]
        assert severity == sorted(severity)
        if severity[0] == severity[1]:
            assert jumps == sorted(jumps, reverse=True)
        if severity[0] == severity[1] and jumps == [0.0, 0.0]:
            assert round(one.margin, 9) <= round(other.margin, 9)


def test_of_equal_jumps_the_one_that_takes_fewer_faults_comes_first(dh5):
    reports = census(dh5, faults=3, force=FORCE).sets
    share = 80.0 / np.linalg.norm(FORCE)
    lost = [report for report in reports if report.relative_jump == pytest.approx(share)]
    assert len(lost) > 3
    assert numbers(lost[0]) == [3]
    assert [len(report.faults) for report in lost] == sorted(len(r.faults) for r in lost)


def test_joints_come_most_critical_first(dh5):
    result = census(dh5, faults=2, force=FORCE)
    first = result.joints[0]
    assert first.joint == 2
    assert (first.sets, first.not_tolerated, first.borderline) == (5, 5, 0)
    assert first.alone.faults.joints == (2,)
    for one, other in pairwise(result.joints):
        assert (one.not_tolerated, one.borderline) >= (other.not_tolerated, other.borderline)
    for joint in result.joints:
        own = [report for report in result.sets if joint.joint in report.faults.joints]
        assert joint.sets == len(own) == 5
        assert joint.not_tolerated == sum(r.verdict is Verdict.NOT_TOLERATED for r in own)
        assert joint.borderline == sum(r.verdict is Verdict.BORDERLINE for r in own)
        assert_close(joint.mean_relative_jump, np.mean([r.relative_jump for r in own]), scale=1)


def test_borderline_sets_make_a_joint_critical_too():
    arm, q = stretched(1e-3)
    result = census(arm, q)
    found = [(joint.not_tolerated, joint.borderline) for joint in result.joints]
    assert found == sorted(found, reverse=True)
    assert (0, 1) in found
    assert (0, 0) in found


def test_of_equally_critical_joints_the_smaller_margin_comes_first(panda):
    result = census(panda, force=FORCE)
    assert {report.verdict for report in result.sets} == {Verdict.TOLERATED}
    margins = [joint.alone.margin for joint in result.joints]
    assert margins == sorted(margins)


def test_head_of_a_census(dh5):
    result = census(dh5, faults=2, force=FORCE, rtol=1e-5, wary=0.1, axes="world")
    assert (result.robot, result.largest, result.rtol, result.wary) == (dh5, 2, 1e-5, 0.1)
    assert (result.rank, result.task.axes, result.posture.source) == (3, "world", "posture 'paper'")
    assert_close(result.requested, FORCE)
    assert_close(result.before, FORCE)
    without = census(dh5)
    assert without.requested is without.before is None


def test_a_force_that_even_the_healthy_arm_cannot_exert():
    arm = load_text(serial_urdf(*[LEVEL] * 3))
    result = census(arm, [0.1, 0.7, 0.9], force=[10, 20, 30])
    assert_close(result.requested, [10, 20, 30])
    assert_close(result.before, [10, 20, 0])
    assert result.rank == 2
    assert {report.verdict for report in result.sets} == {Verdict.TOLERATED}
    assert all(math.isnan(report.relative_manipulability) for report in result.sets)


def test_a_force_that_only_rounding_exerts():
    arm = load_text(serial_urdf(("revolute", {"rpy": (0.3, 0.7, 0.2)}), *[LEVEL] * 2))
    R, _ = tip_pose(arm, np.array([0.1, 0.7, 0.9]))
    result = census(arm, [0.1, 0.7, 0.9], faults=2, force=30.0 * R[:, 2], axes="world")
    assert {report.verdict for report in result.sets} == {Verdict.TOLERATED}
    assert_close([report.relative_jump for report in result.sets], 0.0, tol=1e-6)


def test_all_faults_at_once(dh5):
    report = next(r for r in census(dh5, faults=5, force=FORCE).sets if len(r.faults) == 5)
    assert_close(report.jump, FORCE)
    assert_close(report.relative_jump, 1.0)
    assert (report.rank_after, report.rank_lost, report.sigma_min_after) == (0, 3, 0.0)


@pytest.mark.parametrize(("size", "bound"), [(1, math.sqrt(2 / 5)), (2, math.sqrt(1 / 10))])
def test_worst_manipulability_and_its_bound(dh5, size, bound):
    result = census(dh5, faults=2)
    worst, best_possible = result.worst_manipulability(size)
    rho = [
        analyze(dh5, locked=numbers(report)).relative_manipulability
        for report in result.sets
        if len(report.faults) == size
    ]
    assert_close(worst, min(rho), scale=1.0, tol=1e-7)
    assert best_possible == pytest.approx(bound)
    assert worst <= best_possible


def test_worst_manipulability_of_sizes_that_were_not_counted(dh5):
    worst, bound = census(dh5, faults=1).worst_manipulability(2)
    assert math.isnan(worst)
    assert bound == pytest.approx(math.sqrt(1 / 10))


def test_the_papers_bound_for_seven_joints(panda):
    worst, bound = census(panda, task="wrench").worst_manipulability()
    assert bound == pytest.approx(0.378, abs=5e-4)
    assert 0.0 <= worst <= bound


def test_progress_is_told_after_every_set(dh5):
    told = []
    census(dh5, faults=2, progress=lambda done, total: told.append((done, total)))
    assert told == [(done, 15) for done in range(1, 16)]


@pytest.mark.parametrize("faults", [0, -1, 6, True, 2.0, "2", None], ids=repr)
def test_sizes_that_do_not_exist(dh5, faults):
    with pytest.raises(InputError, match="faults must be a number from 1 to 5, got"):
        census(dh5, faults=faults)


def test_too_many_sets_are_refused_before_any_work():
    arm = load_text(serial_urdf(*[("revolute", {"xyz": (0.1, 0, 0), "axis": (0, 1, 0)})] * 25))
    with pytest.raises(
        InputError, match=r"726,205 fault sets|1,807,780 fault sets of up to 8 of 25"
    ):
        census(arm, faults=8, progress=lambda *_: pytest.fail("work was done"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"force": FORCE, "torque": [0] * 5}, "either a force or torques"),
        ({"force": [1, 2]}, "force needs 3 numbers, got 2"),
        ({"q": [0] * 4}, "q needs 5 numbers"),
        ({"rtol": 2}, "rtol must lie"),
        ({"task": "push"}, "no task component"),
        ({"posture": "home"}, "no posture"),
    ],
    ids=str,
)
def test_malformed_values_are_those_of_analyze(dh5, options, message):
    with pytest.raises(InputError, match=message):
        census(dh5, **options)


@pytest.mark.parametrize(
    "options",
    [{"force": FORCE}, {"force": [1, 2, 3, 4, 5, 6], "task": "wrench", "length": 0.3}, {}],
    ids=str,
)
def test_results_are_frozen_and_read_only(dh5, options):
    result = census(dh5, faults=2, **options)
    with pytest.raises(FrozenInstanceError):
        result.sets = ()
    with pytest.raises(FrozenInstanceError):
        result.sets[0].jump_norm = 0.0
    with pytest.raises(FrozenInstanceError):
        result.joints[0].sets = 0
    assert [name for name, array in arrays_in(result) if array.flags.writeable] == []


@pytest.mark.parametrize(
    "duplicate",
    [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))],
    ids=["copy", "deepcopy", "pickle"],
)
def test_results_can_be_copied_and_pickled(dh5, duplicate):
    result = census(dh5, faults=2, force=FORCE)
    again = duplicate(result)
    assert [numbers(report) for report in again.sets] == [numbers(r) for r in result.sets]
    pairs = zip(arrays_in(result), arrays_in(again), strict=True)
    for (name, array), (other_name, other) in pairs:
        assert name == other_name
        np.testing.assert_array_equal(array, other)
    assert [joint.joint for joint in again.joints] == [joint.joint for joint in result.joints]
    assert again.worst_manipulability() == result.worst_manipulability()


def test_a_posture_is_looked_up_once_for_all_sets(dh5):
    result = census(dh5, [0.1, 0.2, 0.3, 0.4, 5.0], force=FORCE)
    assert result.posture.source == "given"
    assert "joint5 = 5" in result.posture.warnings[0]
