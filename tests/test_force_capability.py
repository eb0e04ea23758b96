"""What can be held, by a ratio test, meets linear programs, the remap, and Pinocchio's torques."""

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog

import ftforce
from ftforce import Verdict, analyze, capability
from ftforce.analysis.capability import capability_of
from ftforce.core.feasible_forces import LimitingFactor, LockModel, reach
from ftforce.core.limits import Limits
from ftforce.errors import InputError
from ftforce.robot.dynamics import Payload
from helpers import (
    CAMPAIGN,
    QUARTER,
    assert_close,
    campaign,
    changed_model,
    load_text,
    serial_urdf,
    without_masses,
)
from problems import Problem, ray_by_highs

COMMANDED, HELD = LockModel
Q = np.array([0.2, -0.4, 0.3, -1.9, 0.1, 1.6, 0.5])  # of panda: nothing is special there
PROGRAM = 1e-6  # of a linear program's numbers; its solver takes torques to 1e-7 N·m
MOON = [0.1, -0.2, -1.6]


# ---- linear programs -------------------------------------------------------------------------


def problem_of(analysis, after):
    """Return the question that a linear program is asked."""
    faults = analysis.faults if after else ftforce.FaultSet()
    n, rnea = analysis.robot.n, analysis.rnea
    limits = np.where(faults.mask(n), analysis.limits.brake, analysis.limits.effort)
    limits = np.where(faults.mask(n), limits, faults.factors(n) * limits)
    free = np.isin(np.arange(n), faults.free)
    weight = rnea.after if after else rnea.before
    return Problem(analysis.J, np.zeros(n), faults.mask(n), free, limits, weight)


def assert_as_programmed(result, tol=PROGRAM):
    """Compare every direction of a capability with a linear program."""
    seen = []
    for report in result.directions:
        for after, amounts in ((False, report.before), (True, report.after)):
            for reading, amount in amounts.items():
                problem = problem_of(result.analysis, after)
                ends = ray_by_highs(problem, amount.direction, held=reading is HELD)
                least, most = ends or (math.nan, math.nan)
                assert math.isnan(amount.maximum) == math.isnan(most)
                assert math.isinf(amount.maximum) == math.isinf(most)
                if math.isfinite(most):
                    assert_close(amount.maximum, most, scale=1.0 + most, tol=tol)
                if math.isfinite(least):
                    assert_close(amount.minimum, least, scale=1.0 + least, tol=tol)
                seen.append(amount.end)
    return seen


LOCKS = [{"locked": [2]}, {"locked": [2, 4]}, {"locked": [1, 2, 3, 4, 5]}]
CASES = [
    *LOCKS,
    {"free": [6]},
    {"free": [1]},
    {"locked": [3], "free": [1]},
    {"weak": {2: 0.6, 4: 0.8}},
    {"weak": {5: 0.0}, "locked": [1]},
    {"locked": [2], "payload": "2@0,0,0.1"},
    {"locked": [2, 4], "velocity": [1.0] * 7, "acceleration": [2.0] * 7},
    {"locked": [2, 4], "gravity": MOON, "axes": "world"},
    {"locked": [4, 6], "task": "wrench", "length": 0.3},
    {"free": [1], "task": "wrench", "length": 0.3, "gravity": [0, 0, 0]},
    {"locked": [4, 6], "task": "mz,fx"},
    {"locked": [4, 6], "task": "moment", "length": 0.2},
]


@pytest.mark.no_cover
@pytest.mark.thorough
@pytest.mark.parametrize("brakes", [None, 60.0], ids=["no brakes", "brakes"])
@pytest.mark.parametrize("case", CASES if CAMPAIGN else CASES[::2], ids=str)
def test_panda_against_linear_programs(panda, case, brakes):
    limits = Limits.of(panda.effort, None if brakes is None else np.full(7, brakes))
    m = ftforce.Task.parse(case.get("task", "force")).m
    direction = np.linspace(1.0, -2.0, m)
    result = capability(panda, Q, limits=limits, direction=direction, **case)
    assert len(result.directions) == 2 * m + 1
    assert assert_as_programmed(result)


# ---- the remap -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "case", [{}, *LOCKS, {"weak": {2: 0.5}}, {"locked": [2], "free": []}], ids=str
)
def test_the_remap_keeps_what_can_be_commanded_and_no_more(panda, case):
    case = {"q": Q, **case}
    result = capability(panda, direction=[1, 2, -1], **case)
    for report in result.directions:
        amount = report.after[COMMANDED]
        if amount.end is LimitingFactor.FAULT:
            assert amount.maximum == 0.0
            lost = analyze(panda, force=amount.direction, limits="urdf", **case)
            assert lost.verdict is Verdict.NOT_TOLERATED
            continue
        assert amount.end is LimitingFactor.LIMIT
        force = amount.maximum * amount.direction
        inside = analyze(panda, force=force * (1.0 - 1e-9), limits="urdf", **case)
        assert inside.verdict is Verdict.TOLERATED
        assert_close(inside.force.jump, 0.0, scale=amount.maximum)
        beyond = analyze(panda, force=1.25 * force, limits="urdf", **case)
        assert beyond.force.jump_norm > 0.01 * amount.maximum
        assert beyond.bounded.share == pytest.approx(0.8)
        (joint,) = amount.limiting_joints
        total = analyze(panda, force=force, limits="urdf", **case).torque.total_after
        factor = dict(case.get("weak", {})).get(joint + 1, 1.0)
        assert_close(abs(total[joint]), factor * panda.effort[joint])


# ---- the weakest direction -------------------------------------------------------------------


def sampled_reach(result, after, reading, rng):
    """Return the smallest reach over weighted directions that the healthy arm has."""
    reduced = result.analysis.reduced
    space = reduced.healthy.U[:, : reduced.rank]
    feasible = result.feasible(after=after, reading=reading)
    directions = rng.normal(size=(campaign(3000, 1000), space.shape[1])) @ space.T
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return min(reach(feasible, d).maximum for d in directions)


@pytest.mark.parametrize(
    "case",
    [
        {"locked": [2]},
        {"locked": [2], "task": "fx,fz", "axes": "world"},
        {"weak": {6: 0.3}, "payload": 1.0},
        {"locked": [3], "task": "wrench", "length": 0.3},
        {"locked": [3], "task": "mx,fy"},
        {"locked": [3], "task": "mz,fx"},
        {"locked": [3], "task": "my,mz", "length": 0.2},
    ],
    ids=str,
)
def test_the_weakest_direction_against_sampled_ones(panda, case):
    result, rng = capability(panda, **case), np.random.default_rng(2)
    task = result.analysis.task
    unit = task.length if not task.force_rows else 1.0  # weighted: all N, or all N·m
    assert result.weakest.unit == ("N" if task.force_rows else "N·m")
    for after, amounts in ((False, result.weakest.before), (True, result.weakest.after)):
        for reading, amount in amounts.items():
            sampled = sampled_reach(result, after, reading, rng) * unit
            assert amount.maximum <= sampled
            if task.m < 4:
                assert amount.maximum > (0.97 if CAMPAIGN else 0.95) * sampled
            weighted = task.weigh_force(amount.direction)
            assert_close(np.linalg.norm(weighted) * unit, 1.0)
            feasible = result.feasible(after=after, reading=reading)
            assert_close(reach(feasible, weighted).maximum, amount.maximum)
            assert reach(feasible, weighted).limiting_joints == amount.limiting_joints
            near = weighted + 1e-3 * rng.normal(size=(campaign(50, 15), task.m)) * np.linalg.norm(
                weighted
            )
            for other in near / (np.linalg.norm(near, axis=1)[:, None] * unit):
                assert reach(feasible, other).maximum >= amount.maximum * (1.0 - 1e-12)


def test_a_lost_direction_is_the_weakest(panda):
    result = capability(panda, locked=[2, 4])
    amount = result.weakest.after[COMMANDED]
    assert (amount.maximum, amount.minimum, amount.end, amount.limiting_joints) == (
        0.0,
        0.0,
        LimitingFactor.FAULT,
        (1, 3),
    )
    assert_close(np.abs(amount.direction @ result.analysis.lost_directions.T), [1.0])
    assert result.weakest.after[HELD].end is LimitingFactor.LIMIT
    assert result.weakest.after[HELD].maximum > 1.0


def test_directions_that_even_the_healthy_arm_lacks_do_not_count():
    arm = load_text(serial_urdf(*[("revolute", {"xyz": (0.3, 0, 0)})] * 3))  # planar
    result = capability(arm, [0.1, 0.7, 0.9], locked=1)
    assert result.directions[4].name == "+fz"
    assert result.directions[4].before[COMMANDED].end is LimitingFactor.DIRECTION
    assert result.directions[4].after[COMMANDED].end is LimitingFactor.DIRECTION
    assert result.directions[4].before[COMMANDED].limiting_joints == ()
    assert result.weakest.before[COMMANDED].maximum > 1.0
    assert abs(result.weakest.before[COMMANDED].direction[2]) < 1e-12


# ---- payload ---------------------------------------------------------------------------------


def torques_with(arm, result, mass, *, after):
    """Return Pinocchio's torques of the arm with a mass at the tip, as one rigid body."""
    conditions = result.analysis.conditions
    offset = np.zeros(3) if conditions.payload is None else conditions.payload.offset
    model = changed_model(arm, conditions.gravity, Payload.of(mass, offset))
    locked = result.analysis.reduced.locked & after
    v, a = (
        np.zeros(arm.n) if x is None else np.where(locked, 0.0, x)
        for x in (conditions.velocity, conditions.acceleration)
    )
    G, q = arm.coordinates.G, arm.to_model(result.analysis.posture.q)
    return G.T @ pin.rnea(model, model.createData(), q, G @ v, G @ a)


def worst_share(arm, result, mass, *, after):
    """Return the largest share of a limit that any joint bears."""
    faults = result.analysis.faults if after else ftforce.FaultSet()
    largest = result.analysis.limits.largest_torques(faults)
    free = [fault.joint for fault in faults.faults if fault.is_free]
    torque = torques_with(arm, result, mass, after=after)
    assert_close(torque[free], 0.0, scale=10.0, tol=1e-6)
    shares = np.abs(np.delete(torque, free)) / np.delete(largest, free)
    return np.nanmax(shares)


LOADS = [
    {"locked": [2]},
    {"locked": [2, 4], "payload": "1.5@0.02,-0.05,0.1"},
    {"locked": [6], "velocity": [0.5] * 7, "acceleration": [2.0] * 7, "payload": 0.5},
    {"locked": [1, 3], "gravity": MOON},
    {"weak": {2: 0.5, 4: 0.7}, "velocity": [0.3] * 7},
    {"free": [1]},
    {"locked": [2], "velocity": [0.5] * 7, "gravity": [0, 0, 0]},
    {"locked": [5], "task": "wrench", "axes": "world"},
]


@pytest.mark.parametrize("brakes", [None, 45.0], ids=["no brakes", "brakes"])
@pytest.mark.parametrize("case", LOADS, ids=str)
def test_a_payload_is_just_within_the_limits(panda, case, brakes):
    limits = Limits.of(panda.effort, None if brakes is None else np.full(7, brakes))
    result = capability(panda, limits=limits, **case)
    present = result.analysis.conditions.payload
    there, offset = (0.0, (0, 0, 0)) if present is None else (present.mass, present.offset)
    for after, amount in zip((False, True), result.payload, strict=True):
        assert (amount.end, amount.minimum) == (LimitingFactor.LIMIT, 0.0)
        assert_close(worst_share(panda, result, there + amount.maximum, after=after), 1.0)
        assert worst_share(panda, result, there + 1.01 * amount.maximum, after=after) > 1.001
        assert worst_share(panda, result, there + 0.99 * amount.maximum, after=after) < 1.0
        torque = torques_with(panda, result, there + amount.maximum, after=after)
        faults = result.analysis.faults if after else ftforce.FaultSet()
        largest = limits.largest_torques(faults)
        assert_close(
            np.abs(torque[list(amount.limiting_joints)]), largest[list(amount.limiting_joints)]
        )
    for more, overloaded in ((0.99, ()), (1.01, result.payload[1].limiting_joints)):
        load = {**case, "payload": (there + more * result.payload[1].maximum, offset)}
        analysis = analyze(panda, limits=limits, **load)
        if "locked" not in case:  # brakes hold what motors could not
            assert analysis.bounded.overloaded == overloaded
        held = capability_of(analysis).feasible(after=True, reading=HELD)
        torque = held.rows @ held.F0
        assert bool(np.any((torque > held.upper) | (torque < held.lower))) == bool(overloaded)


def test_a_payload_that_no_joint_feels_weighs_nothing():
    """All axes are vertical but for rounding: nothing ends the payload."""
    turned = {"rpy": (QUARTER, 0, 0), "axis": (0, 1, 0)}
    level = {"xyz": (0.3, 0, 0), "axis": (0, 1, 0)}
    arm = load_text(serial_urdf(("revolute", turned), ("revolute", level), ("revolute", level)))
    result = capability(arm, [0.1, 0.7, 0.9])
    assert result.analysis.rnea.gravity.any()  # 1e-15 N·m
    assert [amount.maximum for amount in result.payload] == [math.inf, math.inf]
    assert [amount.end for amount in result.payload] == [
        LimitingFactor.UNLIMITED,
        LimitingFactor.UNLIMITED,
    ]


SEESAW = serial_urdf(("revolute", {"axis": (0, 1, 0)})).replace("0.11 0.05 0.03", "1 0 0")
SEESAW = SEESAW.replace('<link name="l1"><inertial>', '<link name="l1"><inertial>'
                        '<origin xyz="-3 0 0"/>')  # fmt: skip


def test_a_payload_that_balances_a_free_joint_is_the_only_one():
    """The tool of 1 kg at 1 m, and 1 kg at -3 m on the other side: 2 kg more balance it."""
    arm = load_text(SEESAW)
    before, after = capability(arm, [0.0], free=1).payload
    assert before.end is LimitingFactor.LIMIT
    assert_close([before.minimum, before.maximum], [2.0 - 10.0 / 9.81, 2.0 + 10.0 / 9.81])
    assert_close([after.minimum, after.maximum], [2.0, 2.0])
    assert (after.end, after.limiting_joints) == (LimitingFactor.FAULT, (0,))
    other_way = capability(arm, [math.pi], free=1, gravity=[0, 0, 9.81], payload=3.0).payload[1]
    assert math.isnan(other_way.maximum)
    loaded = capability(arm, [0.0], free=1, payload=2.0).payload[1]
    assert_close([loaded.minimum, loaded.maximum], [0.0, 0.0], scale=1.0)
    assert analyze(arm, [0.0], free=1, payload=2.0).can_stand_still


def test_a_free_joint_that_the_payload_moves_carries_none(panda):
    result = capability(panda, free=[6], gravity=[0, 0, 0], velocity=[0.5] * 7)
    assert math.isnan(result.payload[1].maximum)
    vertical = capability(panda, free=[1])  # its axis is vertical: no weight turns it
    assert vertical.payload[1].end is LimitingFactor.LIMIT
    assert_close(vertical.payload[1].maximum, vertical.payload[0].maximum)


def test_payloads_without_masses():
    arm = load_text(
        without_masses(
            serial_urdf(
                ("revolute", {}), *[("revolute", {"xyz": (0.3, 0, 0), "axis": (0, 1, 0)})] * 2
            )
        )
    )
    result = capability(arm, [0.0, 0.0, 1.0])
    arms_length = 0.3 + 0.11 * math.cos(1.0) + 0.03 * math.sin(1.0)
    assert_close(result.payload[0].maximum, 10.0 / (9.81 * arms_length))
    assert result.analysis.warnings == (
        "the URDF has no masses: gravity torques of the arm are not included",
    )


# ---- ends ------------------------------------------------------------------------------------


def test_unknown_limits_end_nothing():
    arm = ftforce.load_robot("kinova")
    limits = Limits.of(np.full(arm.n, np.nan))
    result = capability(arm, locked=[2], limits=limits)
    for report in (*result.directions, result.weakest):
        for amounts in (report.before, report.after):
            for amount in amounts.values():
                assert (amount.maximum, amount.end, amount.limiting_joints) == (
                    math.inf,
                    LimitingFactor.UNLIMITED,
                    (),
                )
    assert [amount.maximum for amount in result.payload] == [math.inf] * 2
    none = capability(arm, locked=[2], limits="none")
    assert none.analysis.limits is None
    assert none.directions[0].after[COMMANDED].maximum == math.inf


def test_an_arm_that_cannot_carry_itself(panda):
    limits = Limits.of(np.where(np.isin(np.arange(7), [1, 3]), 5.0, panda.effort))
    result = capability(panda, Q, locked=[6], limits=limits)
    gravity = np.abs(result.analysis.rnea.gravity)
    assert gravity[1] > 5.0
    assert gravity[3] > 5.0
    nothing = [
        amounts[reading]
        for report in (*result.directions, result.weakest)
        for amounts in (report.before, report.after)
        for reading in LockModel
        if math.isnan(amounts[reading].maximum)
    ]
    assert len(nothing) > 20
    for amount in (*nothing, *result.payload):
        assert math.isnan(amount.maximum)
        assert math.isnan(amount.minimum)
        assert (amount.end, amount.limiting_joints) == (LimitingFactor.WEIGHT, (1, 3))
    assert result.polytope(after=True).is_empty is not result.analysis.can_stand_still


def test_a_force_that_helps_carry_the_arm_has_a_least_amount():
    """A lever of 1 m with 1 kg at its end and 10 N·m; its weight is half of that again too much."""
    urdf = serial_urdf(("revolute", {"axis": (0, 1, 0), "effort": 5.0}))
    arm = load_text(urdf.replace("0.11 0.05 0.03", "1 0 0"))
    result = capability(arm, [0.0], axes="world", direction=[0, 0, -1])
    down = result.directions[-1].before[COMMANDED]  # the arm leans on what is below it
    assert_close([down.minimum, down.maximum], [9.81 - 5.0, 9.81 + 5.0])
    assert (down.end, down.limiting_joints) == (LimitingFactor.LIMIT, (0,))
    up = result.directions[4].before[COMMANDED]
    assert math.isnan(up.maximum)


def test_a_free_joint_that_a_force_balances(panda):
    result = capability(panda, free=[6])
    analysis = result.analysis
    assert abs(analysis.rnea.gravity[5]) > 0.5
    lever = analysis.J[:, 5]
    balancing = -analysis.rnea.gravity[5] * lever / (lever @ lever)
    along = capability(panda, free=[6], direction=balancing).directions[-1].after
    for reading in LockModel:
        assert_close(
            [along[reading].minimum, along[reading].maximum], [np.linalg.norm(balancing)] * 2
        )
        assert (along[reading].end, along[reading].limiting_joints) == (LimitingFactor.FAULT, (5,))
    across = np.cross(lever, [1.0, 2.0, 3.0])
    square = capability(panda, free=[6], direction=across).directions[-1].after[COMMANDED]
    assert math.isnan(square.maximum)
    assert square.end is LimitingFactor.FAULT


def test_what_locks_cannot_be_blamed_for(panda):
    """A held force that ends at a fault ends at the joint without torque, not at the lock."""
    result = capability(panda, locked=[2], free=[1], direction=[0, 1, 0])
    ends = {
        amount.end: amount.limiting_joints for r in result.directions for amount in (r.after[HELD],)
    }
    assert ends[LimitingFactor.FAULT] == (0,)
    ends = {
        amount.end: amount.limiting_joints
        for r in result.directions
        for amount in (r.after[COMMANDED],)
    }
    assert ends[LimitingFactor.FAULT] == (0, 1)


@pytest.mark.parametrize("locked", [[], [1], [1, 3]], ids=str)
def test_what_is_commanded_and_held_where_the_arm_itself_lacks_directions(locked):
    """Five joints for a wrench: K has the rank of J and yet the lock models differ (theory §5)."""
    arm = ftforce.load_robot("so101")
    result = capability(arm, locked=locked, task="wrench", limits=Limits.of([3.0] * arm.n))
    analysis, failed = result.analysis, [joint - 1 for joint in locked]
    assert np.linalg.matrix_rank(analysis.J) == 5
    weight, J = analysis.rnea.gravity, analysis.J
    K = np.delete(J, failed, axis=1)
    effort = np.where(np.isin(np.arange(arm.n), failed), np.inf, analysis.limits.effort)
    for report in result.directions:
        d = report.after[HELD].direction
        A = np.vstack([np.outer(J.T @ d, 1.0), -np.outer(J.T @ d, 1.0)])
        b = np.concatenate([effort - weight, effort + weight])
        known = np.isfinite(b)
        held = linprog([-1.0], A_ub=A[known], b_ub=b[known], bounds=[(0.0, None)])  # HiGHS
        assert_close(report.after[HELD].maximum, held.x[0] if held.status == 0 else math.inf)
        lost = np.linalg.norm(d - K @ np.linalg.pinv(K, rcond=1e-6) @ d) > 1e-6
        assert (report.after[COMMANDED].maximum == 0.0) is bool(lost)
        assert lost or report.after[COMMANDED].maximum == report.after[HELD].maximum
        beyond = np.linalg.norm(d - J @ np.linalg.pinv(J, rcond=1e-6) @ d) > 1e-6
        ends = {LimitingFactor.DIRECTION} if beyond else {LimitingFactor.FAULT}
        assert not lost or {report.after[COMMANDED].end} == ends
        assert report.before[COMMANDED].end is not LimitingFactor.FAULT
    assert (
        result.directions[0].after[COMMANDED].maximum
        == 0.0
        < result.directions[0].after[HELD].maximum
    )


@pytest.mark.parametrize("locked", [[2], [2, 4], [1, 2, 3], [1, 2, 3, 4]], ids=str)
def test_both_lock_models_agree_exactly_if_k_spans_the_task(panda, locked):
    result = capability(panda, Q, locked=locked)
    spans = np.linalg.matrix_rank(np.delete(result.analysis.J, [j - 1 for j in locked], 1)) == 3
    same = [
        report.after[COMMANDED].maximum == report.after[HELD].maximum
        for report in (*result.directions, result.weakest)
    ]
    assert all(same) is bool(spans)


# ---- directions, shapes, errors --------------------------------------------------------------


def test_names_units_and_directions(panda):
    result = capability(panda, task="fx,mz", direction=[3.0, 4.0], length=0.5)
    names = [(report.name, report.unit) for report in result.directions]
    assert names == [
        ("+fx", "N"), ("-fx", "N"), ("+mz", "N·m"), ("-mz", "N·m"), ("direction", "N"),
    ]  # fmt: skip
    assert_close(result.direction, [1.0, 4.0 / 3.0])
    assert_close(result.directions[1].after[HELD].direction, [-1.0, 0.0])
    moment = capability(panda, task="fx,mz", direction=[0.0, -4.0])
    assert moment.directions[-1].unit == "N·m"
    assert_close(moment.direction, [0.0, -1.0])
    assert capability(panda).direction is None


def test_a_moment_that_rounding_gave_a_force_stays_a_moment(panda):
    result = capability(panda, task="wrench", direction=[1e-17, 0, 0, 0, 0, 2.0])
    assert_close(result.direction, [0, 0, 0, 0, 0, 1.0])
    assert result.directions[-1].unit == "N·m"
    wanted = result.directions[10]
    assert wanted.name == "+mz"
    assert_close(result.directions[-1].after[HELD].maximum, wanted.after[HELD].maximum)


@pytest.mark.parametrize(
    ("direction", "message"),
    [
        ([0, 0, 0], "the direction must not be zero"),
        ([1, 2], "direction needs 3 numbers, got 2 numbers: fx, fy, fz of the task 'force'"),
    ],
    ids=repr,
)
def test_directions_that_are_none(panda, direction, message):
    with pytest.raises(InputError) as caught:
        capability(panda, direction=direction)
    assert str(caught.value) == message
