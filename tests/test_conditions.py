"""Gravity, payload and motion as a caller gives them, and what they take of the torques."""

import json
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce.analysis.conditions import Conditions, read_payload, rnea_change, tip_load
from ftforce.core.limits import Limits
from ftforce.core.reduced_jacobian import reduce
from ftforce.core.task import Task
from ftforce.errors import InputError
from ftforce.report.files import to_text
from ftforce.robot.dynamics import Payload, mass_matrix, motion_torque, weight_torque
from ftforce.robot.kinematics import task_jacobian
from helpers import assert_close, load_text, serial_urdf, without_masses

MOON = [0.0, 0.0, -1.6]
CHAIN = (
    ("revolute", {}),
    ("revolute", {"xyz": (0.3, 0.0, 0.1), "axis": (0, 1, 0)}),
    ("revolute", {"xyz": (0.2, 0.1, 0.0), "axis": (1, 0, 0)}),
)
Q = [0.3, -0.4, 0.5]
FORCE = [5.0, -3.0, 8.0]


@pytest.fixture(scope="module")
def weightless():
    return load_text(without_masses(serial_urdf(*CHAIN)))


@pytest.fixture(scope="module")
def no_hand():
    """An arm whose last link has no mass."""
    head, tail = serial_urdf(*CHAIN).split('<link name="l3">')
    joints = tail.index("<joint")
    return load_text(head + '<link name="l3">' + without_masses(tail[:joints]) + tail[joints:])


# ---- what is given ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "mass", "offset"),
    [
        (2.5, 2.5, (0, 0, 0)),
        (3, 3.0, (0, 0, 0)),
        (np.float32(0.5), 0.5, (0, 0, 0)),
        (np.int64(4), 4.0, (0, 0, 0)),
        ("2.5", 2.5, (0, 0, 0)),
        ("2.5@0,0,0.1", 2.5, (0, 0, 0.1)),
        (" 2 @ 1, -2e-1 ,.3 ", 2.0, (1, -0.2, 0.3)),
        ((2.0, [0.1, 0.2, 0.3]), 2.0, (0.1, 0.2, 0.3)),
        ((2.0, np.array([0.1, 0.2, 0.3])), 2.0, (0.1, 0.2, 0.3)),
        (Payload.of(7.0), 7.0, (0, 0, 0)),
        (0, 0.0, (0, 0, 0)),
    ],
    ids=repr,
)
def test_payloads(given, mass, offset):
    payload = read_payload(given)
    assert payload.mass == mass
    assert type(payload.mass) is float
    assert_close(payload.offset, offset)
    assert read_payload(None) is None


def turned(urdf, roll, pitch):
    """Return a URDF whose root link is fixed to an upright one, turned as the angles (rad) say."""
    root = pin.buildModelFromXML(urdf).frames[1].name
    joint = f'<joint name="mount" type="fixed"><parent link="upright"/><child link="{root}"/>'
    mount = f'{joint}<origin rpy="{roll} {pitch} 0"/></joint>'
    return urdf.replace("</robot>", f'<link name="upright"/>{mount}</robot>')


@pytest.mark.parametrize(
    ("mounted", "roll", "pitch"),
    [
        ("floor", 0, 0),
        ("wall", 0, 90),
        ("ceiling", 180, 0),
        ("30,-45", 30, -45),
        (" 0, 450", 0, 90),
    ],
)
def test_mounted_as_a_urdf_with_a_turned_root(mounted, roll, pitch):
    """The weight torques are those that Pinocchio finds for a root that is really turned."""
    arm = ftforce.load_robot("dh5")
    q = arm.postures["paper"]
    model = pin.buildModelFromXML(
        turned(Path(arm.path).read_text(encoding="utf-8"), *np.deg2rad([roll, pitch]))
    )
    expected = pin.computeGeneralizedGravity(model, model.createData(), q)
    analysis = ftforce.analyze(arm, q, locked=[2], gravity=mounted)
    assert_close(analysis.rnea.gravity, expected)
    if mounted.isalpha():  # exact, so that a table can say which axis points down
        assert np.count_nonzero(analysis.conditions.gravity) == 1


@pytest.mark.parametrize("mounted", ["upside down", "", "90", "1,2,3", "nan,0", "1e10,0"])
def test_what_is_no_mounting(panda, mounted):
    with pytest.raises(
        InputError, match=r"^a mounting is floor, wall, ceiling, or ROLL,PITCH in deg"
    ):
        ftforce.analyze(panda, gravity=mounted)


FORM = r"a payload needs MASS or MASS@x,y,z \(kg, m\), e\.g\. 2\.5@0,0,0\.1, or a TOML file; "


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("nan", FORM + "'nan' is not finite"),
        ("x", FORM + "'x' is not a number"),
        ("2 3", FORM + "'2 3': expected 1 number, got 2"),
        ("2@1,2", FORM + "'1 2': expected 3 numbers, got 2"),
        ("2@a,b,c", FORM + "'a b c' is not a number"),
        ("2@1@2", FORM + "'1': expected 3 numbers, got 1"),
        ("2@1,2,3@4", FORM + "'4': expected 6 numbers, got 1"),
        ((2.0,), r"a payload is a mass and a position, \(mass, \(x, y, z\)\), got \(2\.0,\)"),
        ((2.0, (1, 2)), "the payload's position needs 3 numbers, got 2 numbers: x, y, z in m"),
        (-1, "the payload's mass must be 0 kg or more, got -1"),
        (True, "the payload needs a mass in kg, got True"),
        (
            1.7e308,
            r"the payload must not exceed 1e\+09 kg or lie farther than 1e\+09 m .*",
        ),
        (
            (1.0, (0, 2e9, 0)),
            r"the payload must not exceed 1e\+09 kg or lie farther than 1e\+09 m .*",
        ),
        ("1@0,,0,0.1", FORM + "nothing stands beside a comma in '0,,0,0.1'"),
    ],
    ids=repr,
)
def test_what_is_no_payload(given, message):
    with pytest.raises(InputError, match=f"^{message}$"):
        read_payload(given)


def test_the_largest_conditions_have_finite_results(panda):
    """Whatever is admitted can be written: JSON has neither infinity nor NaN."""
    huge = {"payload": (1e9, (1e9, 0, 0)), "gravity": [0, 0, -1e9], "acceleration": [1e9] * 7}
    for options in (huge, {"velocity": [1e9] * 7}):
        analysis = ftforce.analyze(panda, locked=[2], limits="urdf", **options)
        assert np.isfinite(analysis.rnea.before).all()
        assert analysis.verdict == "not tolerated"
        assert json.loads(to_text(analysis, "json"), parse_constant=pytest.fail)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gravity": 9.81}, "gravity needs 3 numbers, got .*: x, y, z in m/s², in root axes"),
        ({"velocity": [1, 2]}, "velocity needs 7 numbers, got 2 numbers: one per joint, 1 panda_j"),
        ({"acceleration": [0] * 6 + [math.inf]}, "acceleration contains inf at position 7"),
        ({"payload": -1}, "the payload's mass"),
        ({"payload": 1.7e308}, "the payload must not exceed"),  # its weight would be infinite
        ({"velocity": [1e10] * 7}, r"velocity must not exceed 1e\+09 rad/s or m/s, got"),
        ({"acceleration": [1e10] * 7}, r"acceleration must not exceed 1e\+09 rad/s² or m/s², got"),
        ({"gravity": [0, 0, -1e10]}, r"gravity must not exceed 1e\+09 m/s², got"),
    ],
    ids=str,
)
def test_malformed_conditions(panda, options, message):
    for ask in (Conditions.of, ftforce.analyze, ftforce.census, ftforce.capability):
        with pytest.raises(InputError, match=message):
            ask(panda, **options)


def test_conditions_are_checked_copies(panda):
    v, g = np.ones(7), np.array(MOON)
    conditions = Conditions.of(panda, velocity=v, gravity=g, payload="1@0,0,0.1")
    v[:], g[:] = 9.0, 9.0
    assert_close(conditions.velocity, np.ones(7))
    assert_close(conditions.gravity, MOON)
    assert not conditions.velocity.flags.writeable
    assert not conditions.gravity.flags.writeable
    assert not conditions.is_model_gravity
    assert conditions.acceleration is None
    plain = Conditions.of(panda)
    assert_close(plain.gravity, [0.0, 0.0, -9.81])
    assert plain.is_model_gravity
    assert plain.payload is plain.velocity is None


@pytest.mark.parametrize(
    ("options", "moves"),
    [
        ({}, False),
        ({"velocity": [0] * 7, "acceleration": [0] * 7}, False),
        ({"velocity": [0] * 6 + [1e-9]}, True),
        ({"acceleration": [1] + [0] * 6}, True),
        ({"payload": 2.0, "gravity": MOON}, False),
    ],
    ids=str,
)
def test_what_moves(panda, options, moves):
    assert Conditions.of(panda, **options).moves is moves


# ---- before and after the lock ---------------------------------------------------------------


@pytest.mark.parametrize("moves", ["velocity", "acceleration", "both"])
def test_a_locked_joint_stands_still_and_the_others_move_on(panda, moves):
    q, v, a = np.random.default_rng(1).uniform(-1.0, 1.0, size=(3, 7))
    locked, payload = np.isin(np.arange(7), [1, 4]), Payload.of(2.0, (0.1, 0.0, 0.2))
    motion = {"velocity": v, "acceleration": a}
    given = motion if moves == "both" else {moves: motion[moves]}
    conditions = Conditions.of(panda, gravity=MOON, payload=payload, **given)
    change = rnea_change(panda, q, conditions, locked)
    both = [given.get(name, np.zeros(7)) for name in motion]
    G = weight_torque(panda, q, np.array(MOON), payload)
    before = motion_torque(panda, q, *both, payload)
    after = motion_torque(panda, q, *(np.where(locked, 0.0, x) for x in both), payload)
    assert np.abs(before - after).max() > 0.1
    assert_close(change.gravity, G)
    assert_close(change.motion_before, before)
    assert_close(change.motion_after, after)
    assert_close(change.before, G + before)
    assert_close(change.after, G + after)


def test_free_and_weak_joints_go_on_moving(panda):
    v = np.linspace(-1.0, 1.0, 7)
    moving = ftforce.analyze(panda, free=2, weak={5: 0.5}, velocity=v, acceleration=v)
    assert_close(moving.rnea.motion_after, moving.rnea.motion_before)
    locked = ftforce.analyze(panda, locked=6, free=2, velocity=v, acceleration=v)
    assert np.abs(locked.rnea.motion_after - locked.rnea.motion_before).max() > 1e-3


def test_a_locked_leader_stops_its_followers():
    steps = (*CHAIN, ("revolute", {"xyz": (0.2, 0, 0), "mimic": ("j2", -2.0, 0.1)}))
    arm = load_text(serial_urdf(*steps))
    v = np.array([1.0, 2.0, 3.0])
    result = ftforce.analyze(arm, Q, locked="j2", velocity=v, acceleration=v, force=FORCE)
    model_v = arm.coordinates.G @ [1.0, 0.0, 3.0]
    assert sorted(model_v) == [0.0, 0.0, 1.0, 3.0]
    model, q = arm.model, arm.to_model(np.array(Q))
    wanted = arm.coordinates.G.T @ pin.rnea(model, model.createData(), q, model_v, model_v)
    assert_close(result.rnea.after, wanted)
    assert_close(result.torque.brake_load[1], (wanted + result.J.T @ result.force.after)[1])


# ---- unknown masses --------------------------------------------------------------------------


def test_an_unknown_weight_stays_unknown(weightless):
    result = ftforce.analyze(weightless, Q, locked=2, force=FORCE)
    assert result.rnea.gravity is None
    assert not result.rnea.is_known
    assert result.torque.total_before is result.torque.total_after is None
    assert_close(result.torque.after, np.where([1, 0, 1], result.J.T @ FORCE, 0.0))
    assert result.warnings == (
        "the URDF has no masses: gravity torques of the arm are not included",
    )
    document = ftforce.to_dict(result)
    assert document["torque"]["total"] == {"before": None, "after": None}
    assert document["torque"]["gravity"] == {"before": None, "after": None}
    json.dumps(document, allow_nan=False)


def test_an_unknown_motion_stays_unknown(weightless):
    result = ftforce.analyze(weightless, Q, locked=2, force=FORCE, velocity=[1, 2, 3])
    assert result.rnea.motion_before is result.rnea.motion_after is result.impact is None
    assert result.torque.total_after is None
    assert result.warnings == (
        "the URDF has no masses: gravity and motion torques of the arm are not included",
    )
    assert_close(result.velocity.tip_before, result.J @ [1, 2, 3])


def test_without_gravity_no_mass_weighs(weightless):
    result = ftforce.analyze(weightless, Q, locked=2, force=FORCE, gravity=[0, 0, 0])
    assert result.warnings == ()
    assert_close(result.rnea.gravity, np.zeros(3))
    assert_close(result.torque.total_after, result.torque.after)
    moving = ftforce.analyze(weightless, Q, force=FORCE, gravity=[0, 0, 0], velocity=[1, 2, 3])
    assert moving.rnea.gravity is not None
    assert moving.rnea.motion_before is None
    assert moving.torque.total_before is None


def test_of_an_unknown_weight_the_payload_counts(weightless):
    limits = Limits.of([5.0, 5.0, 5.0])
    options = {"limits": limits, "payload": 1.0}
    result = ftforce.analyze(weightless, Q, force=[0.0, 0.0, 0.0], **options)
    carried = weight_torque(weightless, np.array(Q), payload=Payload.of(1.0))
    assert np.abs(carried).max() > 1.0
    assert_close(result.rnea.before, carried)
    assert result.rnea.gravity is None


def test_where_masses_are_impossible_the_impact_is_unknown_and_the_rest_is_told(no_hand):
    assert no_hand.mass == 2.0
    result = ftforce.analyze(no_hand, Q, locked=1, velocity=[1, 2, 3], force=FORCE)
    assert result.impact is None
    (warning,) = result.warnings
    assert warning.startswith("masses or inertias in the URDF are missing or unphysical")
    assert warning.endswith("velocities immediately after locking are unknown")
    assert_close(result.velocity.tip_before, result.J @ [1, 2, 3])
    assert result.torque.total_after is not None
    assert ftforce.to_dict(result)["velocity"]["impact"] is None
    for options in ({"velocity": [1, 2, 3], "free": 1}, {"locked": 1}):
        assert ftforce.analyze(no_hand, Q, force=FORCE, **options).warnings == ()
    carrying = ftforce.analyze(no_hand, Q, locked=1, velocity=[1, 2, 3], payload="1@0.1,0.2,0.3")
    assert carrying.impact is not None


# ---- inverses --------------------------------------------------------------------------------


def test_the_dynamic_inverse_needs_masses(weightless, no_hand):
    for ask in (ftforce.analyze, ftforce.census):
        with pytest.raises(InputError) as caught:
            ask(weightless, Q, torque=[1, 2, 3], inverse="dynamic")
        assert str(caught.value) == (
            "the dynamic inverse needs masses, but the URDF of 'arm' has none; "
            "use the euclidean one"
        )
        with pytest.raises(InputError, match="mass matrix of 'arm' is not positive definite"):
            ask(no_hand, Q, torque=[1, 2, 3], inverse="dynamic")


def loaded(panda, task, **options):
    q = np.array([0.2, -0.4, 0.3, -1.9, 0.1, 1.6, 0.5])
    wanted = Task.parse(task)
    J = task_jacobian(panda, q, wanted)
    load = tip_load(reduce(J, np.zeros(7, bool)), wanted, **options)
    return load, J, mass_matrix(panda, q)


@pytest.mark.parametrize("task", ["force", "fz", "wrench"])
def test_the_dynamic_inverse_by_its_definition(panda, task):
    tau = np.linspace(-20.0, 30.0, 7)
    _, J, M = loaded(panda, task, force=None, torque=tau)
    load, *_ = loaded(panda, task, force=None, torque=tau, M=M)
    # The tip is held: M a + JᵀF = τ and J a = 0.
    m = len(J)
    saddle = np.block([[M, J.T], [J, np.zeros((m, m))]])
    wanted = np.linalg.solve(saddle, [*tau, *np.zeros(m)])[7:]
    assert_close(load.F, wanted)
    plain, *_ = loaded(panda, task, force=None, torque=tau)
    assert np.linalg.norm(plain.F - wanted) > 1e-3 * np.linalg.norm(wanted)
    assert_close(plain.F, np.linalg.pinv(J.T) @ tau)
    F = np.arange(1.0, m + 1.0)
    for inverse in (None, M):  # torques of a force: both agree
        assert_close(loaded(panda, task, force=None, torque=J.T @ F, M=inverse)[0].F, F)


def test_the_dynamic_inverse_where_the_arm_lacks_a_direction():
    arm = load_text(serial_urdf(*[("revolute", {"xyz": (0.3, 0, 0)})] * 3))  # planar
    result = ftforce.analyze(arm, [0.1, 0.7, 0.9], torque=[1, 2, 3], inverse="dynamic")
    assert result.reduced.rank == 2
    M, J = mass_matrix(arm, np.array([0.1, 0.7, 0.9])), result.J[:2]
    saddle = np.block([[M, J.T], [J, np.zeros((2, 2))]])
    wanted = np.linalg.solve(saddle, [1, 2, 3, 0, 0])[3:]
    assert_close(result.force.before, [*wanted, 0.0])
    assert_close(result.torque.self_motion, [1, 2, 3] - J.T @ wanted)
