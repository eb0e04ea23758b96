"""Which posture is analysed: given, named, or a default that says what it skipped and why."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce.analysis.question import Question
from ftforce.errors import InputError, UnknownNameError
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from ftforce.robot.mounting import Mounting
from ftforce.robot.posture import (
    SAMPLES,
    Posture,
    bent_posture,
    best_sample,
    choose_posture,
    is_singular,
    mid_range,
    samples,
)
from ftforce.trajectory import Path
from ftforce.view.model.state import command_line, initial_state
from helpers import assert_close, joint, load_text, serial_urdf, srdf_of

Y = {"axis": (0, 1, 0)}


def elbow(**limits):
    """Return the URDF of a turning shoulder and an elbow, singular where it is stretched."""
    return serial_urdf(
        ("revolute", {"xyz": (0, 0, 0.3), **limits}),
        ("revolute", {**Y, **limits}),
        ("revolute", {"xyz": (0.4, 0, 0), **Y, **limits}),
    ).replace("0.11 0.05 0.03", "0.3 0.0 0.0")


def state(*q):
    return dict(zip(("j1", "j2", "j3"), map(float, q), strict=False))


OUTSIDE, STRAIGHT, BENT, OTHER = (
    state(0, 0.5, 3.1),
    state(0, 0.5, 0),
    state(0, 0.5, 1),
    state(1, 1, 1),
)


# ---- default ---------------------------------------------------------------------------------

SKIPPED = "posture 'bent' ('far' is outside the limits, 'straight' is singular)"
NARROW = {"lower": 0.2, "upper": 1.6}
DEFAULTS = [  # limits, named postures: positions and source
    ({}, {"bent": BENT, "other": OTHER}, [0, 0.5, 1], "posture 'bent'"),
    ({}, {"other": OTHER, "bent": BENT}, [1, 1, 1], "posture 'other'"),
    ({}, {"far": OUTSIDE, "straight": STRAIGHT, "bent": BENT}, [0, 0.5, 1], SKIPPED),
    (NARROW, {"a": STRAIGHT}, [0.9] * 3, "mid-range ('a' is outside the limits)"),
    (NARROW, {}, [0.9] * 3, "mid-range"),
]


@pytest.mark.parametrize(("limits", "states", "q", "source"), DEFAULTS)
def test_the_default_is_the_first_posture_that_serves(limits, states, q, source):
    posture = choose_posture(load_text(elbow(**limits), srdf_of(**states)))
    assert_close(posture.q, q)
    assert (posture.source, posture.warnings) == (source, ())


def test_mid_range_is_bent_where_it_is_singular():
    arm = load_text(elbow(), srdf_of(far=OUTSIDE, straight=STRAIGHT))
    posture = choose_posture(arm)
    assert posture.source == (
        "bent: joint 3 turned from mid-range ('far' is outside the limits, "
        "'straight' is singular, mid-range is singular)"
    )
    assert not is_singular(arm, posture.q)
    assert_close(posture.q, [0, 0, -np.pi / 3])  # upwards
    np.testing.assert_array_equal(posture.q, bent_posture(arm))
    again = choose_posture(arm, name="bent")
    np.testing.assert_array_equal(again.q, posture.q)
    assert (again.source, again.warnings) == ("bent: joint 3 turned from mid-range", ())


def test_a_joint_is_bent_by_most_of_its_way_to_a_near_limit():
    arm = load_text(elbow(lower=-0.5, upper=0.5))
    assert_close(choose_posture(arm).q, [0, 0, -0.4])


def test_a_sample_is_taken_where_nothing_can_be_bent(monkeypatch):
    arm = load_text(elbow())
    monkeypatch.setattr("ftforce.robot.posture.bent_posture", lambda _: None)
    posture = choose_posture(arm)
    assert posture.source == "best of 64 samples clear of the base (mid-range is singular)"
    np.testing.assert_array_equal(posture.q, best_sample(arm))
    named = choose_posture(arm, name="bent")
    assert (named.source, named.q.tolist()) == ("mid-range (no bent posture helps)", [0, 0, 0])


def points(urdf, robot, q):
    """Return joints and tip in root axes, by Pinocchio's own reading of the file."""
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    configuration = pin.neutral(model)
    for name, value in zip(robot.names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        number = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = number
    pin.framesForwardKinematics(model, data, configuration)
    joints = [data.oMi[model.getJointId(name)].translation for name in robot.names]
    return np.array([*joints, data.oMf[model.getFrameId(robot.tip)].translation])


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "kinova", "talos_left_arm"])
def test_the_default_of_a_file_stays_above_the_base(name):
    """Of 198 arms with a sampled default, 49 had a joint below the base plane."""
    path = ftforce.known_robots()[name].urdf
    robot = ftforce.load_robot(path)
    posture = choose_posture(robot)
    assert posture.source.startswith("bent: joint")
    found = points(path.read_text(), robot, posture.q)
    assert found[1:, 2].min() >= min(found[0, 2], 0.0) - 1e-9
    assert np.linalg.norm(found[-1] - found[0]) > 0.25 * np.ptp(found, axis=0).max()
    s = np.linalg.svd(frame_jacobian(robot, posture.q), compute_uv=False)
    assert s[-1] > 0.01 * s[0]


def test_no_more_joints_are_bent_than_it_takes():
    """One is not enough for a UR5: two of its wrist axes are in line, and it is stretched."""
    path = ftforce.known_robots()["ur5"].urdf
    robot = ftforce.load_robot(path)
    assert np.count_nonzero(choose_posture(robot).q) == 2
    for number in range(1, 6):
        for angle in (np.pi / 3, -np.pi / 3):
            q = angle * np.eye(6)[number]
            J = frame_jacobian(robot, q)
            singular = max(np.linalg.cond(J), np.linalg.cond(J[:3])) > 100
            assert singular or points(path.read_text(), robot, q)[:, 2].min() < 0


@pytest.mark.parametrize(("roll", "side"), [(0.0, 1), (np.pi, -1)])
def test_an_arm_that_hangs_stays_below_its_base(roll, side):
    """The arm under a ceiling, and the same arm on a table: gravity is along -z in both."""
    placed = joint("mount", "fixed", "world", "base", xyz=(0, 0, 1.0), rpy=(roll, 0, 0))
    urdf = elbow().replace("<link", '<link name="world"/><link', 1)
    urdf = urdf.replace("</robot>", placed + "</robot>")
    robot = load_text(urdf, base="base")
    for posture in (choose_posture(robot), choose_posture(robot, name="sample")):
        heights = side * (points(urdf, robot, posture.q)[:, 2] - 1.0)
        assert heights.min() >= 0.0
        np.testing.assert_allclose(Mounting.of(robot).heights(posture.q), heights, atol=1e-12)


def test_what_is_clear_of_the_base():
    path = ftforce.known_robots()["ur5"].urdf
    robot = ftforce.load_robot(path)
    mounting, found = Mounting.of(robot), []
    for q in np.random.default_rng(3).uniform(-3, 3, (300, 6)):
        *joints, tip = here = points(path.read_text(), robot, q)
        column = np.linspace([[0, 0, 0], joints[0]], [joints[0], joints[1]], 2001).reshape(-1, 3)
        away = np.linalg.norm(column - tip, axis=1).min()
        length = np.linalg.norm(np.diff(here, axis=0), axis=1).sum()
        found.append((here[1:, 2].min() >= -1e-3, away >= 0.25 * length))
        assert mounting.is_clear(q) == all(found[-1])
    assert {(True, True), (False, True), (True, False)} <= set(found)


# ---- the default of a question -----------------------------------------------------------------

WRIST = [0.0, -1.8, 1.8, -1.57, 0.0, 0.0]  # wrist axes 1 and 3 in line: forces are kept
READY = [0.0, -1.8, 1.8, -1.57, 1.2, 0.0]


@pytest.fixture(scope="module")
def ur5():
    """Return a UR5 whose file brings a posture for forces, and one for everything."""
    path = ftforce.known_robots()["ur5"].urdf
    names = ftforce.load_robot("ur5").names
    home, up = (dict(zip(names, q, strict=True)) for q in (WRIST, READY))
    return load_text(path.read_text(), srdf_of(home=home, up=up))


def defaults(robot, **asked):
    """Return the default postures of all functions that analyse one."""
    question = Question.parse(robot, **asked).placed()
    found = [question.place, ftforce.analyze(robot, **asked).posture]
    found.append(ftforce.census(robot, **asked).posture)
    if "force" not in asked:
        found.append(ftforce.capability(robot, **asked).analysis.posture)
    return found


@pytest.mark.parametrize(
    ("task", "q", "source"),
    [
        ("force", WRIST, "posture 'home'"),
        ("fx,fz", WRIST, "posture 'home'"),
        ("wrench", READY, "posture 'up' ('home' is singular)"),
    ],
)
def test_the_users_own_posture_is_used_where_the_question_can_be_answered(ur5, task, q, source):
    """The oracle: Pinocchio's Jacobian of the file, and NumPy's singular values of its rows."""
    rows = {"force": [0, 1, 2], "fx,fz": [0, 2], "wrench": [0, 1, 2, 3, 4, 5]}[task]
    model, frame = ur5.model, ur5.tip_frame
    for place, fits in ((WRIST, task != "wrench"), (READY, True)):
        J = pin.computeFrameJacobian(model, model.createData(), np.array(place), frame)[rows]
        s = np.linalg.svd(J, compute_uv=False)
        assert (s[-1] > 0.01 * s[0]) == fits
    for posture in defaults(ur5, task=task):
        assert (posture.q.tolist(), posture.source) == (q, source)
    asked = Question.parse(ur5, task=task).placed()
    page = initial_state(asked)
    assert page.posture.q.tolist() == q
    assert "--q" not in command_line(ur5, page)
    elsewhere = "wrench" if task != "wrench" else "force"  # asked anew, it has another default
    assert "--q" in command_line(ur5, page.asking(elsewhere, "tool", 1.0))


def test_a_path_starts_near_the_default_of_its_question(ur5):
    for task, m, wanted in (("force", 3, "'home'"), ("wrench", 6, "'up' ('home' is singular)")):
        x = tip_pose(ur5, np.array(WRIST if m == 3 else READY))[1]
        path = Path.through([x, x + np.array([0.0, 0.0, 0.01])], speed=0.1)
        run = ftforce.simulate(ur5, path, force=np.ones(m), task=task, rate=20)
        over = ftforce.timeline(ur5, path, task=task, rate=20)
        assert run.setting.start == over.start == f"posture {wanted}"


def hinge(srdf=None):
    """Return an arm of one hinge about z, which pushes across its lever only."""
    steps = [("revolute", {"lower": -3.0, "upper": 3.0})]
    return load_text(serial_urdf(*steps).replace("0.11 0.05 0.03", "0.4 0 0"), srdf)


def test_a_posture_that_cannot_exert_the_force_is_passed_over():
    """At 0 the tip moves along y, at a right angle along x: closed form."""
    along_x = {"force": [5.0, 0.0], "task": "fx,fy", "axes": "world"}
    states = srdf_of(out={"j1": 0.0}, side={"j1": math.pi / 2})
    for posture in defaults(hinge(states), **along_x):
        assert posture.source == "posture 'side' ('out' cannot exert the force)"
    for posture in defaults(hinge(states), **along_x | {"force": [0.0, 5.0]}):
        assert posture.source == "posture 'out'"
    for posture in defaults(hinge(), **along_x):  # not even the middle of the range
        assert posture.source == (
            "best of 64 samples clear of the base (mid-range cannot exert the force)"
        )


def test_where_no_posture_answers_the_error_does():
    with pytest.raises(InputError, match="even the healthy arm cannot exert this force"):
        ftforce.analyze(hinge(), force=[0, 0, 1])


def test_the_default_of_one_question_is_not_that_of_another(ur5):
    """Nothing is remembered that depends on the question."""
    for task, q in (("wrench", READY), ("force", WRIST), ("wrench", READY)):
        assert ftforce.analyze(ur5, task=task).posture.q.tolist() == q
    assert choose_posture(ur5).q.tolist() == READY  # of no question: good for all


# ---- named -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def arm():
    return load_text(elbow(), srdf_of(bent=BENT, far=OUTSIDE))


OUTSIDE_BY = "outside the joint limits: j3 = 3.1 (limits -3 to 3 rad)"


@pytest.mark.parametrize(
    ("name", "q", "source", "warnings"),
    [
        ("bent", [0, 0.5, 1], "posture 'bent'", ()),
        ("zero", [0, 0, 0], "zero", ()),
        ("mid-range", [0, 0, 0], "mid-range", ()),
        ("far", [0, 0.5, 3.1], "posture 'far'", (OUTSIDE_BY,)),
    ],
)
def test_named_and_built_in_postures(arm, name, q, source, warnings):
    posture = choose_posture(arm, name=name)
    assert_close(posture.q, q)
    assert (posture.source, posture.warnings) == (source, warnings)


def test_unknown_postures_are_answered_with_the_known_ones(arm):
    message = (
        "unknown posture 'bend'; available: bent, far, mid-range, zero, bent, sample; "
        "did you mean 'bent'"
    )
    with pytest.raises(UnknownNameError, match=message):
        choose_posture(arm, name="bend")


def test_mid_range_is_the_middle_of_each_joints_limits():
    arm = load_text(
        serial_urdf(
            ("revolute", {"lower": -1.0, "upper": 2.0}),
            ("continuous", Y),
            ("prismatic", {"lower": 0.1, "upper": 0.5}),
        )
    )
    assert_close(mid_range(arm), [0.5, 0, 0.3])
    assert_close(choose_posture(arm, name="mid-range").q, [0.5, 0, 0.3])


# ---- given -----------------------------------------------------------------------------------


def test_given_positions_are_taken_as_they_are(arm):
    q = [0.1, 0.2, 0.3]
    posture = choose_posture(arm, q)
    assert_close(posture.q, q)
    assert (posture.source, posture.warnings) == ("given", ())
    assert not posture.q.flags.writeable


def test_a_posture_object_is_returned(arm):
    posture = Posture(np.array([0.1, 0.2, 0.3]), "somewhere")
    assert choose_posture(arm, posture) is posture
    with pytest.raises(FrozenInstanceError):
        posture.source = "elsewhere"


def test_degrees_are_converted_for_turning_joints_only():
    arm = load_text(serial_urdf(("revolute", {}), ("prismatic", {}), ("continuous", Y)))
    posture = choose_posture(arm, [90, 0.5, 540], degrees=True)
    assert_close(posture.q, [math.pi / 2, 0.5, 3 * math.pi])
    assert posture.warnings == ()
    assert_close(choose_posture(arm, [1.5, 0.5, 1.5]).q, [1.5, 0.5, 1.5])


OTHER_JOINTS = serial_urdf(("prismatic", {"upper": 0.35}), ("continuous", Y), ("revolute", Y))
WARNINGS = [
    ([3.5, 0, -4], "j1 = 3.5 (limits -3 to 3 rad), j3 = -4 (limits -3 to 3 rad)"),
    ([3 + 5e-7, 0, -3 - 5e-7], None),  # limits that were printed rounded
    ([3 + 2e-6, 0, 0], "j1 = 3 (limits -3 to 3 rad)"),
]


@pytest.mark.parametrize(("q", "words"), WARNINGS)
def test_positions_outside_the_limits_are_warned_about_joint_by_joint(arm, q, words):
    wanted = () if words is None else (f"outside the joint limits: {words}",)
    assert choose_posture(arm, q).warnings == wanted


def test_metres_and_continuous_joints():
    other = load_text(OTHER_JOINTS)
    assert choose_posture(other, [0.1, -50.0, 1.0]).warnings == ()
    (warning,) = choose_posture(other, [20.0, 1.0, 1.0]).warnings  # no degrees
    assert warning == "outside the joint limits: j1 = 20 (limits -3 to 0.35 m)"


@pytest.mark.parametrize(
    ("q", "mixed_up"),
    [
        ([10, 70, 25], True),  # degrees inside the limits
        ([0, 7, 0], True),
        ([0, 3.5, 0], False),  # less than two turns: just outside
        ([0, 6.2, 0], False),
        ([1000, 0, 0], False),  # outside as degrees too
    ],
)
def test_degrees_given_as_radians_are_noticed(arm, q, mixed_up):
    (warning,) = choose_posture(arm, q).warnings
    assert warning.endswith("; these look like degrees, but radians are expected") is mixed_up


@pytest.mark.parametrize(
    ("q", "name", "message"),
    [
        ([0, 0], None, "q needs 3 numbers, got 2 numbers: one per joint, 1 j1, 2 j2"),
        ([0, np.nan, 0], None, "q contains nan at position 2"),
        ([0, 0, 0], "bent", r"either q or a posture, not both \(q and 'bent'\)"),
        (Posture(np.zeros(3), "given"), "bent", "not both"),
    ],
)
def test_malformed_positions(arm, q, name, message):
    with pytest.raises(InputError, match=message):
        choose_posture(arm, q, name)


@pytest.mark.parametrize("size", [2, 5])
def test_a_posture_object_of_another_arm(arm, size):
    with pytest.raises(InputError, match="3"):
        ftforce.analyze(arm, Posture(np.zeros(size), "another arm's"))


# ---- samples and singularity -----------------------------------------------------------------


def test_samples_are_reproducible_and_inside_the_limits():
    urdf = serial_urdf(("revolute", {"lower": 0.5, "upper": 0.6}), ("continuous", Y))
    one, other = (samples(load_text(urdf)) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    assert one.shape == (SAMPLES, 2)
    assert np.all((one[:, 0] >= 0.5) & (one[:, 0] <= 0.6))
    assert np.all(np.abs(one[:, 1]) <= math.pi)
    assert np.ptp(one[:, 0]) > 0.09
    assert np.ptp(one[:, 1]) > 5.0


def test_the_named_sample_is_the_best_conditioned_one():
    for name in ("dh5", "kinova"):
        arm = ftforce.load_robot(name)
        posture = choose_posture(arm, name="sample")
        assert posture.source == "best of 64 samples clear of the base"
        assert posture.warnings == ()
        clear = [q for q in samples(arm) if Mounting.of(arm).is_clear(q)]
        assert 0 < len(clear) < SAMPLES
        quality = [1 / np.linalg.cond(frame_jacobian(arm, q)[:3]) for q in clear]
        best = 1 / np.linalg.cond(frame_jacobian(arm, posture.q)[:3])
        assert best == pytest.approx(max(quality))


def test_the_best_sample_of_a_planar_arm_is_judged_in_its_plane():
    arm = load_text(serial_urdf(*[("revolute", {"xyz": (0.3, 0, 0)})] * 2))
    quality = [np.linalg.svd(frame_jacobian(arm, q)[:2])[1] for q in samples(arm)]
    best = np.linalg.svd(frame_jacobian(arm, best_sample(arm))[:2])[1]
    assert best[1] / best[0] == pytest.approx(max(s[1] / s[0] for s in quality))


@pytest.mark.parametrize(
    ("q", "singular"),
    [
        ([0.3, 0.5, 0.0], True),  # stretched
        ([0.3, 0.5, 1e-3], True),  # all but stretched
        ([0.3, 0.5, 0.5], False),
        ([0.3, 0.0, 2.9], False),
    ],
)
def test_a_stretched_elbow_is_singular(arm, q, singular):
    assert is_singular(arm, np.array(q)) is singular


def test_an_arm_is_measured_by_what_it_can_do_elsewhere():
    # A planar arm never has full rank; it is singular only where it is stretched.
    arm = load_text(serial_urdf(*[("revolute", {"xyz": (0.3, 0, 0)})] * 3))
    assert not is_singular(arm, np.array([0.0, 1.0, 1.0]))
    folded = load_text(
        serial_urdf(*[("revolute", {"xyz": (0.3, 0, 0)})] * 2).replace("0.11 0.05 0.03", "0.2 0 0")
    )
    assert is_singular(folded, np.array([0.4, 0.0]))


def test_a_wrist_singularity_counts_though_forces_are_kept():
    arm = ftforce.load_robot("ur5")
    q = np.array([0.0, -1.8, 1.8, -1.57, 0.0, 0.0])  # wrist axes 1 and 3 in line
    s = np.linalg.svd(frame_jacobian(arm, q)[:3], compute_uv=False)
    assert s[-1] > 0.01 * s[0]
    assert is_singular(arm, q)
