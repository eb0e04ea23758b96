"""census(): every fault set of a posture, as analyze() sees each, in the right order."""

import math
import pickle
import re
from dataclasses import FrozenInstanceError, replace
from itertools import combinations, pairwise

import numpy as np
import pytest

import ftforce
from ftforce import Verdict, analyze, census, load_robot
from ftforce.analysis.census import _order, _rank_joints
from ftforce.core.feasible_forces import LimitingFactor, LockModel
from ftforce.core.limits import Limits
from ftforce.errors import InputError
from ftforce.report.census import critical_joint
from ftforce.robot.kinematics import tip_pose
from ftforce.show.render import to_text
from helpers import (
    CAMPAIGN,
    arrays_in,
    assert_close,
    load_text,
    serial_urdf,
    stretched,
    without_masses,
)

FORCE = [80.0, 50.0, 10.0]
LEVEL = ("revolute", {"xyz": (0.3, 0, 0)})
SEVERITY = [Verdict.NOT_TOLERATED, Verdict.BORDERLINE, Verdict.TOLERATED]


def numbers(report):
    return [k + 1 for k in report.faults.joints]


POSTURE = [0.2, -0.4, 0.3, -1.9, 0.1, 1.6, 0.5]  # of panda: nothing is special there
MOTION = {"velocity": np.linspace(-1.0, 1.0, 7), "acceleration": np.linspace(2.0, -1.0, 7)}
LOAD = {"payload": "1.5@0,0.1,0.2", "gravity": [0.5, -1.0, -3.0], **MOTION}
TORQUE = [5.0, -2.0, 3.0, 4.0, -5.0, 1.0, 2.0]
BRAKES = Limits.of([87.0] * 4 + [12.0] * 3, [30.0, 25.0, np.nan, 20.0, 10.0, 5.0, 5.0])


EACH = [
    ("dh5", {"force": FORCE}),
    ("dh5", {"torque": [1.0, -2.0, 3.0, 4.0, -5.0], "rtol": 1e-4, "wary": 0.1}),
    ("panda", {"force": [1, -2, 3, 4, -5, 6], "task": "wrench", "length": 0.3}),
    ("panda", {"task": "wrench", "axes": "world"}),
    ("kinova", {"force": [5, 3], "task": "fy,mz"}),
    ("tiago", {"posture": "zero", "force": FORCE}),
    ("panda", {"q": POSTURE, "force": [20.0, -10.0, 5.0], "limits": "urdf"}),
    ("panda", {"q": POSTURE, "limits": BRAKES}),
    ("panda", {"q": POSTURE, "force": [100.0, -50.0, 25.0], "limits": BRAKES, **LOAD}),
    (
        "panda",
        {"q": POSTURE, "torque": TORQUE, "inverse": "dynamic", "payload": (1.0, (0, 0, 0.5))},
    ),
    ("panda", {"q": POSTURE, **LOAD}),
]


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize(("name", "options"), EACH, ids=str)
def test_every_set_is_what_analyze_says(name, options, mode):
    arm = ftforce.load_robot(name)
    result = census(arm, faults=2, mode=mode, **options)
    assert result.mode.value == mode
    sets = [*combinations(range(arm.n), 1), *combinations(range(arm.n), 2)]
    assert sorted(report.faults.joints for report in result.sets) == sorted(sets)
    assert sorted(report.joint for report in result.joints) == list(range(arm.n))
    for report in result.sets:
        assert_as_analyzed(report, analyze(arm, **{mode: numbers(report)}, **options))


def assert_as_analyzed(report, alone):
    assert report.faults == alone.faults
    assert report.verdict is alone.verdict
    assert report.can_stand_still == alone.can_stand_still
    assert report.rank_after == alone.reduced.rank_after
    assert report.rank_lost == alone.reduced.rank - alone.reduced.rank_after
    assert_close(report.margin, alone.margin, scale=1.0)
    assert_close(report.sigma_min_after, alone.reduced.damaged.s[-1], scale=1.0)
    K = alone.reduced.K
    lost = report.rank_after < len(K)
    assert report.condition_number == pytest.approx(math.inf if lost else np.linalg.cond(K))
    rho = alone.relative_manipulability
    assert_close(report.relative_manipulability, rho, scale=1.0, tol=1e-7)
    assert report.capability is None
    assert report.binding == (() if alone.bounded is None else alone.bounded.binding)
    if alone.force is None:
        assert report.after is report.jump is report.jump_norm is report.share is None
        return
    assert report.share == (None if alone.bounded is None else alone.bounded.share)
    if not alone.can_stand_still:
        assert report.after is report.jump is report.jump_norm is report.share is None
        assert report.relative_jump == 1.0
        return
    size = np.linalg.norm(alone.force.before)
    assert_close(report.after, alone.force.after, scale=size)
    assert_close(report.jump, alone.force.jump, scale=size)
    for norm in ("jump_norm", "moment_jump_norm"):
        one, other = getattr(report, norm), getattr(alone.force, norm)
        assert (one is None) == (other is None)
        assert_close(one or 0.0, other or 0.0, scale=size)
    weighted = [alone.task.weigh_force(x) for x in (alone.force.jump, alone.force.before)]
    relative = np.linalg.norm(weighted[0]) / np.linalg.norm(weighted[1])
    assert_close(report.relative_jump, relative, scale=1.0)


CAPABILITIES = [
    {},
    {"direction": [1.0, 2.0, -2.0]},
    {"force": [20.0, -10.0, 5.0]},
    {"direction": [0.0, 0.0, 1.0], "force": [20.0, -10.0, 5.0], "limits": BRAKES, **LOAD},
    {"limits": BRAKES, "axes": "world", **LOAD},
    {"task": "wrench", "length": 0.3},
    {"task": "mz,fx", "direction": [1.0, 0.0], "limits": BRAKES},
    {"task": "moment", "length": 0.2, "gravity": [0, 0, 0]},
    {"task": "wrench", "length": 0.3, "direction": [1.0, 2.0, 3.0, 0.4, 0.5, 0.6]},
    {"task": "wrench", "length": 0.3, "force": [1.0, 2.0, 3.0, 0.4, 0.5, 0.6]},
    {"limits": BRAKES, "direction": [0.0, 0.0, 1.0], "faults": 5},
    {"limits": "none"},
]


@pytest.mark.no_cover
@pytest.mark.thorough
@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize("options", CAPABILITIES if CAMPAIGN else CAPABILITIES[1::2], ids=str)
def test_every_capability_is_what_capability_says(panda, mode, options):
    options = {"faults": 2, **options}
    result = census(panda, POSTURE, mode=mode, rank_by="capability", **options)
    asked = options.get("direction", options.get("force"))
    if asked is not None:
        linear = [i for i, name in enumerate(result.task.components) if name[0] == "f"]
        size = np.linalg.norm(np.array(asked)[linear]) or np.linalg.norm(asked)
        assert_close(result.direction, np.array(asked) / size)
    else:
        assert result.direction is None
    same = {k: v for k, v in options.items() if k not in {"direction", "faults", "force"}}
    if result.limits is None:
        same["limits"] = "none"
    for report in result.sets:
        other = ftforce.capability(
            panda, POSTURE, **{mode: numbers(report)}, direction=result.direction, **same
        )
        wanted = other.weakest if result.direction is None else other.directions[-1]
        amounts = [wanted.after[reading] for reading in LockModel]
        np.testing.assert_array_equal(
            [report.capability.commanded, report.capability.held], [x.maximum for x in amounts]
        )
        assert [report.capability.end, report.capability.held_end] == [x.end for x in amounts]
        np.testing.assert_array_equal(report.capability.minimum, amounts[0].minimum)
        by_fault = amounts[0].end is LimitingFactor.FAULT
        assert report.capability.limiting_joints == (() if by_fault else amounts[0].limiting_joints)


def key_of(report):
    amounts = (report.capability.commanded, report.capability.held)
    return tuple(-1.0 if math.isnan(x) else round(x, 9) for x in amounts)


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize("limits", ["urdf", BRAKES, "none"], ids=["urdf", "brakes", "none"])
def test_the_least_capability_comes_first(panda, mode, limits):
    result = census(
        panda,
        POSTURE,
        faults=5,
        mode=mode,
        rank_by="capability",
        limits=limits,
        direction=[0, 0, 1],
    )
    assert result.rank_by == "capability"
    keys = [key_of(report) for report in result.sets]
    assert keys == sorted(keys)
    for one, other in pairwise(result.sets):
        if key_of(one) == key_of(other):
            assert len(one.faults) <= len(other.faults)
    alone = [key_of(joint.alone) for joint in result.joints]
    assert alone == sorted(alone)
    for joint in result.joints:
        own = [r.capability.commanded for r in result.sets if joint.joint in r.faults.joints]
        if any(map(math.isnan, own)):
            assert math.isnan(joint.least_capability)
        else:
            assert joint.least_capability == min(own)
    for one, other in pairwise(result.joints):
        if key_of(one.alone) == key_of(other.alone):
            least = [-1.0 if math.isnan(x.least_capability) else x.least_capability
                     for x in (one, other)]  # fmt: skip
            assert least == sorted(least)


def test_arms_that_cannot_stand_still_come_before_all(panda):
    result = census(
        panda, POSTURE, faults=2, mode="free", rank_by="capability", direction=[0, 0, 1]
    )
    falls = [math.isnan(report.capability.commanded) for report in result.sets]
    assert any(falls)
    assert not all(falls)
    assert falls == sorted(falls, reverse=True)
    by_jump = census(panda, POSTURE, faults=4, mode="free", force=FORCE)
    keys = [(SEVERITY.index(r.verdict), r.can_stand_still) for r in by_jump.sets]
    assert keys == sorted(keys)
    assert {(0, False), (0, True)} <= set(keys)
    assert all(report.relative_jump == 1.0 for report in by_jump.sets if not report.can_stand_still)
    assert by_jump.joints[0].least_capability is None


def test_limits_and_direction_of_the_head(panda):
    plain = census(panda, rtol=1e-5, wary=0.1, axes="world")
    assert (plain.robot, plain.largest, plain.rtol, plain.wary) == (panda, 1, 1e-5, 0.1)
    assert (plain.rank, plain.task.axes) == (3, "world")
    assert plain.requested is plain.before is None
    assert (plain.limits, plain.mode.value, plain.rank_by) == (None, "locked", "jump")
    assert plain.direction is None
    ranked = census(panda, rank_by="capability")
    assert ranked.limits.source == "urdf"
    assert census(panda, rank_by="capability", limits="none").limits is None
    with pytest.raises(InputError, match="give it with rank_by='capability'"):
        census(panda, direction=[0, 0, 2])
    by_force = census(panda, force=[0, 3, 4], rank_by="capability")
    assert_close(by_force.direction, [0, 0.6, 0.8])
    nothing = census(panda, force=[0, 0, 0], rank_by="capability")
    assert nothing.direction is None


def test_a_moment_that_the_arm_lacks_leaves_no_rounding_for_a_direction():
    """The healthy arm's part of a moment alone may hold forces of 1e-17 N."""
    turned = ("revolute", {"rpy": (0.3, 0.7, 0.2)})
    arm = load_text(serial_urdf(turned, *[LEVEL] * 2, ("prismatic", {"xyz": (0.1, 0, 0)})))
    R, _ = tip_pose(arm, np.array([0.1, 0.7, 0.9, 0.2]))
    moment = [0.0, 0.0, 0.0, *(2.0 * R[:, 2])]
    options = {"task": "wrench", "axes": "world", "rank_by": "capability"}
    result = census(arm, [0.1, 0.7, 0.9, 0.2], force=moment, **options)
    assert_close(result.direction, [0, 0, 0, *R[:, 2]], tol=1e-7)


def test_warnings(panda):
    weightless = load_text(without_masses(serial_urdf(*[LEVEL] * 3)))
    said = "the URDF has no masses: the weight of the arm is missing"
    q = [0.1, 0.7, 0.9]
    assert census(weightless, q).warnings == ()
    assert census(weightless, q, mode="free").warnings == (said,)
    assert census(weightless, q, limits="urdf").warnings == (said,)
    assert census(weightless, q, limits="urdf", gravity=[0, 0, 0]).warnings == ()
    moving = census(weightless, q, limits="urdf", gravity=[0, 0, 0], velocity=[1, 0, 0])
    assert not moving.is_weight_known
    unknown = Limits.of(np.where(np.arange(7) == 1, np.nan, panda.effort))
    (warning,) = census(panda, limits=unknown).warnings
    assert "panda_joint2" in warning
    assert "unknown" in warning


@pytest.mark.parametrize("options", [{"force": FORCE}, {}, {"task": "wrench"}], ids=str)
def test_sets_come_worst_first(dh5, options):
    reports = census(dh5, faults=3, **options).sets
    for one, other in pairwise(reports):
        severity = [SEVERITY.index(report.verdict) for report in (one, other)]
        jumps = [round(report.relative_jump, 9) for report in (one, other)]
        assert severity == sorted(severity)
        if severity[0] == severity[1]:
            assert jumps == sorted(jumps, reverse=True)
        if severity[0] == severity[1] and jumps[0] == jumps[1]:
            assert one.rank_lost >= other.rank_lost
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
    found = [(joint.not_tolerated, joint.borderline) for joint in census(arm, q).joints]
    assert found == sorted(found, reverse=True)
    assert {(0, 1), (0, 0)} <= set(found)
    both = [(joint.not_tolerated, joint.borderline) for joint in census(arm, q, faults=2).joints]
    assert both == sorted(both, reverse=True)


def test_of_equally_critical_joints_the_smaller_margin_comes_first(panda):
    result = census(panda, force=FORCE)
    assert {report.verdict for report in result.sets} == {Verdict.TOLERATED}
    margins = [joint.alone.margin for joint in result.joints]
    assert margins == sorted(margins)


def test_a_force_that_even_the_healthy_arm_cannot_exert():
    arm = load_text(serial_urdf(*[LEVEL] * 3))
    result = census(arm, [0.1, 0.7, 0.9], force=[10, 20, 30])
    assert_close(result.requested, [10, 20, 30])
    assert_close(result.before, [10, 20, 0])
    assert result.rank == 2
    assert {report.verdict for report in result.sets} == {Verdict.TOLERATED}
    assert all(math.isnan(report.relative_manipulability) for report in result.sets)


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
    unseen = census(dh5, faults=1).worst_manipulability(2)
    assert math.isnan(unseen[0])
    assert unseen[1] == pytest.approx(math.sqrt(1 / 10))


def test_the_papers_bound_for_seven_joints(panda):
    worst, bound = census(panda, task="wrench").worst_manipulability()
    assert bound == pytest.approx(0.378, abs=5e-4)
    assert 0.0 <= worst <= bound


def test_progress_is_told_after_every_set(dh5):
    told = []
    census(dh5, faults=2, progress=lambda done, total: told.append((done, total)))
    assert told == [(done, 15) for done in range(1, 16)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"mode": "weak"},
            "fault sets of many joints are locked or free; weak joints",
        ),
        ({"mode": None}, "unknown fault mode None; available: locked, free"),
        ({"rank_by": "force"}, "unknown ranking 'force'; available: jump, capability"),
        ({"direction": [0, 0, 0]}, "the direction must not be zero"),
        *(
            ({"faults": size}, f"faults must be an integer from 1 to 7, got {size!r}")
            for size in (0, 8, True, 2.0, "2", None)
        ),
        ({"force": FORCE, "torque": [0] * 7}, "give either a force or torques"),
        ({"q": [0] * 4}, ""),
        ({"velocity": [1, 2]}, ""),
        ({"rtol": 2}, ""),
        ({"inverse": "static"}, ""),
    ],
    ids=str,
)
def test_malformed_values(panda, options, message):
    with pytest.raises(InputError) as caught:
        census(panda, **options)
    assert str(caught.value).startswith(message)


def test_too_many_sets_are_refused_before_any_work():
    arm = load_text(serial_urdf(*[("revolute", {"xyz": (0.1, 0, 0), "axis": (0, 1, 0)})] * 25))
    with pytest.raises(
        InputError, match=r"726,205 fault sets|1,807,780 fault sets of up to 8 of 25"
    ):
        census(arm, faults=8, progress=lambda *_: pytest.fail("work was done"))


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
    again = pickle.loads(pickle.dumps(result))
    assert [numbers(report) for report in again.sets] == [numbers(r) for r in result.sets]


def test_a_posture_is_looked_up_once_for_all_sets(dh5):
    result = census(dh5, [0.1, 0.2, 0.3, 0.4, 5.0], force=FORCE)
    assert result.posture.source == "given"
    assert "joint5 = 5" in result.posture.warnings[0]


# ---- what the ranking says of itself -----------------------------------------------------------

RANKED = (
    {"force": FORCE},
    {"rank_by": "capability"},
    {"rank_by": "capability", "force": FORCE, "faults": 2},
    {"mode": "free", "force": FORCE},
    {"mode": "free", "force": FORCE, "faults": 2},
    {"force": FORCE, "faults": 2, "limits": "urdf"},
    {"task": "wrench"},
    {},
)


@pytest.mark.parametrize("asked", RANKED, ids=str)
@pytest.mark.parametrize("name", ["dh5", "panda"])
def test_the_sentence_names_the_first_row_and_all_that_tie_with_it(name, asked):
    result = census(load_robot(name), **asked)
    sentence, robot = critical_joint(result), result.robot
    first = [joint for joint, rank in zip(result.joints, result.joint_ranks, strict=True)
             if rank.first == 1]  # fmt: skip
    assert first[0] is result.joints[0]
    named = {i for i in range(robot.n) if re.search(rf"\b{i + 1} {robot.names[i]}\b", sentence)}
    assert named == {joint.joint for joint in first}
    if result.largest == 1:  # both tables rank the same things, so in the same order
        alone = [joint.alone.faults for joint in result.joints]
        assert [report.faults for report in result.sets] == alone
        assert result.set_ranks == result.joint_ranks
    if "smallest margin" in sentence:
        least = min(joint.alone.margin for joint in result.joints)
        assert_close(first[0].alone.margin, least)


@pytest.mark.parametrize("asked", RANKED, ids=str)
def test_equal_values_share_a_rank_and_no_others(panda, asked):
    result = census(panda, **asked)
    pairs = list(zip(result.sets, result.set_ranks, strict=True))
    for (one, rank), (other, next_rank) in pairwise(pairs):
        if "rank_by" in asked:
            shown = [[x.capability.commanded, x.capability.held] for x in (one, other)]
        else:
            shown = [[SEVERITY.index(x.verdict), x.can_stand_still, x.relative_jump, x.rank_lost,
                      len(x.faults) * (x.relative_jump > 1e-9), x.margin]
                     for x in (one, other)]  # fmt: skip
        is_tie = np.allclose(*shown, rtol=1e-8, atol=1e-8, equal_nan=True)
        assert (rank == next_rank) is bool(is_tie)
    places = [rank.first for _, rank in pairs]
    assert all(pairs[place - 1][1].first == place for place in places)
    assert all(rank.last - rank.first + 1 == places.count(rank.first) for _, rank in pairs)


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_the_healthy_arm_is_the_baseline(panda, mode):
    result = census(panda, POSTURE, mode=mode, force=FORCE, rank_by="capability")
    alone = ftforce.capability(panda, POSTURE, direction=result.direction)
    commanded = alone.directions[-1].before["commanded"].maximum
    assert result.healthy.faults.joints == ()
    assert result.healthy.capability.commanded == commanded
    limited = analyze(panda, POSTURE, force=FORCE, limits="urdf")  # too large a force, healthy too
    assert_close(result.healthy.jump, limited.force.jump)
    assert (result.healthy.rank_lost, result.healthy.verdict) == (0, limited.verdict)
    for report in result.sets:
        kept = result.capability_kept(report)
        if not math.isnan(report.capability.commanded):
            assert_close(kept, report.capability.commanded / commanded)


def test_the_share_of_the_force_that_is_kept(dh5):
    result = census(dh5, faults=3, force=FORCE)
    F = np.array(FORCE, dtype=float)
    for report in result.sets:
        K = np.delete(analyze(dh5).J, report.faults.joints, axis=1)
        after = K @ np.linalg.pinv(K, rcond=1e-6) @ F
        assert_close(report.kept, F @ after / (F @ F), scale=1.0)
    assert result.healthy.kept == pytest.approx(1.0)
    assert {r.kept for r in census(dh5).sets} == {None}


def test_tables_and_documents_show_ranks_and_baseline(panda):
    result = census(panda, force=FORCE, rank_by="capability")
    shown = [line.split() for line in to_text(result).splitlines()]
    ranks = [str(rank) for rank in result.set_ranks]
    rows = [line for line in shown if len(line) > 5 and line[0] in ranks]
    assert [line[0] for line in rows] == [*ranks, *map(str, result.joint_ranks)]
    assert sum(line[:1] == ["none"] for line in shown) == 2
    assert max(map(len, to_text(result).splitlines())) <= 80


def test_an_arm_that_falls_is_worse_than_a_jump_beyond_the_force_in_both_tables(dh5):
    """A free-swinging joint may take more force than was requested; falling is still worse."""
    lost = [report for report in census(dh5, force=FORCE, mode="free").sets
            if report.verdict is Verdict.NOT_TOLERATED][:2]  # fmt: skip
    falls = replace(lost[0], can_stand_still=False, relative_jump=1.0)
    jumps = replace(lost[1], can_stand_still=True, relative_jump=3.0)
    others = [replace(report, relative_jump=0.0, can_stand_still=True,
                      verdict=Verdict.TOLERATED, rank_lost=0)
              for report in census(dh5).sets
              if report.faults.joints not in {one.faults.joints for one in lost}]  # fmt: skip
    reports = [jumps, *others, falls]
    sets = sorted(reports, key=_order(by_capability=False))
    joints = _rank_joints(dh5, reports, by_capability=False)
    assert sets[:2] == [falls, jumps]
    assert [joint.alone for joint in joints] == sets
