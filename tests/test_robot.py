"""A robot answers which joint is meant, and stays as it was made."""

import copy
import pickle
import threading

import numpy as np
import pytest

from ftforce.errors import InputError
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from ftforce.robot.posture import best_sample, choose_posture, mid_range, samples
from urdfs import arm, followed, hand, joint, link, load, robot, state


@pytest.fixture
def four(tmp_path):
    """Return an arm with a follower, fingers, a fixed and a floating joint."""
    return load(
        tmp_path,
        arm(
            *hand("left", "right"), link("camera"), joint("mount", "l1", "camera", "fixed"),
            link("ball"), joint("free", "l1", "ball", "floating"), j3=followed(3, "j1", 2),
        ),
        robot(state("home", j1=0.5, j2=0.2, j4=0.3, left_joint=1.0)),
    )  # fmt: skip


def named(tmp_path, *names):
    """Return an arm whose joints have these names."""
    ends = ["base", *(f"l{i}" for i in range(len(names)))]
    joints = [joint(name, *ends[i : i + 2]) for i, name in enumerate(names)]
    return load(tmp_path, robot(*map(link, ends), *joints))


def test_joints_are_numbered_along_the_chain(four):
    assert [(joint.number, joint.name) for joint in four.joints] == [
        (1, "j1"),
        (2, "j2"),
        (3, "j4"),
    ]
    assert four.names == ("j1", "j2", "j4")
    assert four.numbered() == "1 j1, 2 j2, 3 j4"
    assert four.n == 3
    assert repr(four) == "<Robot 'arm': 3 joints, 'base' → 'tool'>"


@pytest.mark.parametrize(
    ("joint", "index"),
    [(1, 0), (np.int64(3), 2), ("2", 1), ("+2", 1), ("02", 1), ("j4", 2), (" j4 ", 2)],
)
def test_a_joint_is_a_number_or_a_name(four, joint, index):
    assert four.index(joint) == index


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (0, "joint number 0 is out of range; the chain has: 1 j1, 2 j2, 3 j4"),
        ("-1", "joint number -1 is out of range"),
        (np.int64(9), "joint number 9 is out of range"),
        ("j5", r"unknown joint 'j5' in the chain of 'arm'; available: j1, j2, j4"),
        ("J4", r"did you mean 'j4'\?"),
        ("j3", "joint 'j3' mimics 'j1'; give 'j1' instead"),
        ("left_joint", "joint 'left_joint' lies outside the chain from 'base' to 'tool' and is he"),
        ("mount", "joint 'mount' is held fixed and has no motor that could fail; the chain has: 1"),
        ("free", "joint 'free' is held fixed and has no motor that could fail"),
        ("", "unknown joint ''"),
        ("--2", "unknown joint '--2'"),
        ("٢", "unknown joint '٢'"),
        ("1_0", "unknown joint '1_0'"),
        ("9" * 5000, "unknown joint '9999"),
        (True, r"a joint is given by number \(1 to 3\) or name, got True"),
        (None, r"a joint is given by number \(1 to 3\) or name, got None"),
    ],
)
def test_what_is_no_joint_of_the_chain(four, joint, message):
    with pytest.raises(InputError, match=message) as caught:
        four.index(joint)
    if joint == "j5":
        assert (caught.value.available, caught.value.suggestion) == (("j1", "j2", "j4"), None)


@pytest.mark.parametrize(
    ("joints", "indices"),
    [
        ((), ()),
        ("3,j1", (0, 2)),
        (" j2 , 3", (1, 2)),
        (2, (1,)),
        (np.int64(2), (1,)),
        ([3, "j1"], (0, 2)),
        ({"j2"}, (1,)),
        (iter([2, 1]), (0, 1)),
        (np.array([1, 3]), (0, 2)),
        ([False, True, False], (1,)),
        (np.array([True, False, True]), (0, 2)),
        ([False] * 3, ()),
    ],
)
def test_joints_may_be_given_in_many_ways(four, joints, indices):
    assert four.indices(joints) == indices


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ("1,1", r"joint 1 \(j1\) appears twice"),
        ([2, "j2"], r"joint 2 \(j2\) appears twice"),
        ("1;2", "unknown joint '1;2'"),
        ([True, False], "a joint mask needs 3 entries, one per joint, got 2"),
        (True, "a joint mask needs 3 entries"),
        ([True, 2, False], "got True"),
        (None, "got None"),
        ([[1, 2]], r"got \[1, 2\]"),
        (np.eye(3), "a joint is given by number"),
    ],
)
def test_sets_that_are_none(four, joints, message):
    with pytest.raises(InputError, match=message):
        four.indices(joints)


def test_a_name_that_is_a_number_must_be_unambiguous(tmp_path):
    arm_ = named(tmp_path, "1", "a", "2")
    assert arm_.index("1") == 0
    assert arm_.index(2) == 1
    assert arm_.index(3) == 2
    message = "'2' is ambiguous: it is the name of joint 3 and a joint number; the chain"
    with pytest.raises(InputError, match=message):
        arm_.index("2")


def test_names_with_commas_and_blanks_can_be_given(tmp_path):
    arm_ = named(tmp_path, "a,b", " c ", "b")
    assert arm_.indices("a,b") == (0,)
    assert arm_.indices(["a,b", " c "]) == (0, 1)
    assert arm_.indices("b") == (2,)
    assert arm_.index(" c ") == 1


# ---- limits ----------------------------------------------------------------------------------


def test_limits_are_those_of_the_urdf(tmp_path):
    found = load(
        tmp_path,
        arm(
            j1=joint("j1", "base", "l1", "continuous", limit='<limit effort="7"/>'),
            j2=joint("j2", "l1", "l2", "prismatic"),
            j3=joint("j3", "l2", "l3", limit='<limit lower="-1" upper="1" effort="0"/>'),
        ),
    )
    np.testing.assert_array_equal(found.lower, [-np.inf, -1, -1, -1])
    np.testing.assert_array_equal(found.upper, [np.inf, 2, 1, 2])
    np.testing.assert_array_equal(found.effort, [7, 10, np.nan, 10])
    assert [joint.effort for joint in found.joints] == [7, 10, None, 10]
    assert [joint.velocity for joint in found.joints] == [None, 3, None, 3]
    assert [joint.unit for joint in found.joints] == ["rad", "m", "rad", "rad"]
    assert [joint.torque_unit for joint in found.joints] == ["N·m", "N", "N·m", "N·m"]


@pytest.mark.parametrize(
    ("stated", "known"),
    [
        (None, None),
        (0, None),
        (1e-3, 1e-3),
        (9999, 9999),
        (1e4, None),
        (1e5, None),
        (1e308, None),
        ("Inf", None),
        ("-inf", None),
        (-5, None),
    ],
)
def test_effort_and_velocity_placeholders_are_unknown(tmp_path, stated, known):
    text = "" if stated is None else f' effort="{stated}" velocity="{stated}"'
    limit = f'<limit lower="-1" upper="1"{text}/>'
    first = load(tmp_path, arm(j1=joint("j1", "base", "l1", limit=limit))).joints[0]
    assert (first.effort, first.velocity) == (known, known)
    assert load(tmp_path, arm(j1=joint("j1", "base", "l1", limit=limit))).notes == (
        (f"effort limits that count as unknown: j1 {float(stated):g}",)
        if stated and known is None
        else ()
    )


@pytest.mark.parametrize(
    ("lower", "upper", "bounds"),
    [
        (-1e16, 1e16, (-np.inf, np.inf)),
        (-1e308, 3.4e38, (-np.inf, np.inf)),
        (-9999, 1e4, (-9999, np.inf)),
        (0, 1e308, (0, np.inf)),
        (-1e308, 0.5, (-np.inf, 0.5)),
        ("-Inf", "inf", (-np.inf, np.inf)),
    ],
)
def test_position_placeholders_are_no_limits(tmp_path, lower, upper, bounds):
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    found = load(tmp_path, arm(j2=joint("j2", "l1", "l2", limit=limit)))
    assert (found.lower[1], found.upper[1]) == bounds
    assert np.isfinite(frame_jacobian(found, np.zeros(4))).all()


def test_a_slide_of_a_kilometre_has_no_end(tmp_path):
    for lower, upper, bounds in ((0, 999, (0, 999)), (-1e3, 1, (-np.inf, 1))):
        limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
        found = load(tmp_path, arm(j2=joint("j2", "l1", "l2", "prismatic", limit=limit)))
        assert (found.lower[1], found.upper[1]) == bounds
        is_open = np.isinf(bounds).any()
        note = "position limits that count as none: j2 -1000"
        assert found.notes == ((note,) if is_open else ())


@pytest.mark.parametrize(
    ("kind", "lower", "upper", "middle"),
    [
        ("prismatic", 0, 1e6, 0),  # `halfopen.urdf`
        ("prismatic", -1e6, 1e6, 0),  # `fullopen.urdf`
        ("prismatic", 5, 1e6, 5),
        ("revolute", -1e6, -4, -4),
        ("revolute", -1, 1e6, 0),
    ],
)
def test_postures_of_joints_that_are_open_at_one_end(tmp_path, kind, lower, upper, middle):
    """They lie within the limit that there is, and close to 0."""
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    found = load(tmp_path, arm(j2=joint("j2", "l1", "l2", kind, limit=limit)))
    assert mid_range(found)[1] == middle
    low, high = found.ranges
    for q in (*samples(found), best_sample(found), choose_posture(found).q):
        assert ((found.lower <= q) & (q <= found.upper)).all()
        assert ((low <= q) & (q <= high)).all()
    assert abs(low[1]) + abs(high[1]) < 20
    assert high[1] - low[1] == pytest.approx(2 * np.pi)
    assert np.isfinite(tip_pose(found, mid_range(found))[1]).all()


# ---- it stays as it is -----------------------------------------------------------------------


def test_a_robot_cannot_be_changed(four):
    with pytest.raises(AttributeError):
        four.tip = "l1"
    with pytest.raises(TypeError):
        four.postures["home"] = np.zeros(3)
    with pytest.raises(TypeError):
        four.held["left_joint"] = 0.0
    for array in (four.lower, four.upper, four.effort, four.postures["home"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 9.0


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copied_robot_is_the_same_arm(four, duplicate):
    q = np.array([0.1, 0.2, 0.3])
    J = frame_jacobian(four, q)
    again = duplicate(four)
    assert again != four  # robots are compared by identity
    assert (again.names, again.tip, again.held, again.tips, again.notes) == (
        four.names, four.tip, four.held, four.tips, four.notes,
    )  # fmt: skip
    np.testing.assert_array_equal(frame_jacobian(again, q), J)
    with pytest.raises(TypeError):
        again.held["left_joint"] = 0.0


def test_every_thread_has_a_workspace(four):
    found = [four.data, four.data]
    thread = threading.Thread(target=lambda: found.append(four.data))
    thread.start()
    thread.join()
    assert found[0] is found[1]
    assert found[0] is not found[2]


def test_the_mass_is_what_moves(tmp_path):
    assert load(tmp_path, arm()).mass == pytest.approx(8.0)  # the base does not count
    assert load(tmp_path, arm(*hand("f1", "f2"))).mass == pytest.approx(12.0)
    assert load(tmp_path, arm(*hand("f1", "f2")), base="l1").mass == pytest.approx(10.0)
    bare = {name: link(name, "") for name in ("base", "l1", "l2", "l3", "tool")}
    assert load(tmp_path, arm(**bare)).mass == 0.0
