"""From files to robots: what counts as a joint, what is held, and where."""

import math
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from ftforce import known_robots, load_robot
from ftforce.errors import InputError, UnknownNameError, URDFError
from ftforce.robot.chain import MAX_JOINTS
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from ftforce.robot.posture import choose_posture
from helpers import differences, load_text, srdf_of
from urdfs import (
    LINKS,
    arm,
    chain,
    end_effector,
    followed,
    hand,
    joint,
    link,
    load,
    mimic,
    robot,
    state,
    write,
)

Q = np.array([0.3, -0.4, 0.5, 0.2])
HOME = {"j1": 0.3, "j2": -0.4, "j3": 0.5, "j4": 0.2}


def assert_consistent(robot_, q):
    """The Jacobian is the derivative of the pose, one column for each joint."""
    J = frame_jacobian(robot_, q, "world")
    assert J.shape == (6, robot_.n)
    np.testing.assert_allclose(J, differences(robot_, np.asarray(q)), atol=1e-8)


# ---- which joints count ----------------------------------------------------------------------


def test_fingers_and_limbs_do_not_count(tmp_path):
    alone = load(tmp_path, arm())
    equipped = load(tmp_path, arm(
        *hand("f1", "f2"), link("head"), joint("neck", "l1", "head", "continuous")), tip="tool",
    )  # fmt: skip
    assert equipped.names == alone.names
    assert equipped.model.nv == equipped.n == 4
    assert equipped.held == {"f1_joint": 0.0, "f2_joint": 0.0, "neck": 0.0}
    np.testing.assert_allclose(frame_jacobian(equipped, Q), frame_jacobian(alone, Q), atol=1e-15)


def test_a_tip_in_the_middle_cuts_the_chain(tmp_path):
    cut = load(tmp_path, arm(), tip="l2")
    assert cut.names == ("j1", "j2")
    assert set(cut.held) == {"j3", "j4"}
    assert_consistent(cut, Q[:2])


def test_fixed_joints_on_the_way(tmp_path):
    found = load(tmp_path, arm(j2=joint("j2", "l1", "l2", "fixed")))
    assert found.names == ("j1", "j3", "j4")
    assert [joint.number for joint in found.joints] == [1, 2, 3]
    assert found.fixed == {"j2"}
    assert_consistent(found, Q[:3])


@pytest.mark.parametrize(("number", "kind"), [(1, "floating"), (2, "planar")])
def test_floating_and_planar_joints_are_held_fixed(tmp_path, kind, number):
    def with_joint(type_):
        ends = LINKS[number - 1 : number + 1]
        held = {f"j{number}": joint("root_joint", *ends, type_, axis="0 0 1", limit="")}
        return load(tmp_path, arm(**held))

    found, fixed = with_joint(kind), with_joint("fixed")
    assert found.n == 3
    assert found.names == fixed.names
    assert found.notes == ("joint 'root_joint' (floating or planar) is held fixed",)
    np.testing.assert_allclose(
        frame_jacobian(found, Q[:3]), frame_jacobian(fixed, Q[:3]), atol=1e-15
    )
    with pytest.raises(InputError, match="joint 'root_joint' is held fixed"):
        found.index("root_joint")


def test_a_chain_of_too_many_joints_is_refused(tmp_path):
    links = [link(f"l{i}", "") for i in range(MAX_JOINTS + 2)]
    joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(MAX_JOINTS + 1)]
    path = write(tmp_path, robot(*links, *joints))
    assert load_robot(path, base="l1").n == MAX_JOINTS
    with pytest.raises(InputError, match=f"{MAX_JOINTS + 1} joints move between 'l0' and 'l101'"):
        load_robot(path)
    rays = [joint(f"j{i}", "l0", f"l{i + 1}", more=mimic("j0") if i else "") for i in range(101)]
    with pytest.raises(InputError, match="101 joints move"):
        load(tmp_path, robot(*links, *rays), tip="l1")


# ---- followers -------------------------------------------------------------------------------


def test_a_followers_column_belongs_to_its_leader(tmp_path):
    free = load(tmp_path, arm())
    led = load(tmp_path, arm(j3=followed(3, "j1", -2, 0.1)))
    assert led.names == ("j1", "j2", "j4")
    assert led.joints[0].followers == ("j3",)
    J = frame_jacobian(free, np.array([0.3, -0.4, -2 * 0.3 + 0.1, 0.2]))
    expected = np.column_stack([J[:, 0] - 2 * J[:, 2], J[:, 1], J[:, 3]])
    np.testing.assert_allclose(
        frame_jacobian(led, np.array([0.3, -0.4, 0.2])), expected, atol=1e-14
    )


def test_a_leader_above_the_base_moves_only_its_follower(tmp_path):
    free = load(tmp_path, arm(), base="l1")
    led = load(tmp_path, arm(j3=followed(3, "j1", -2)), base="l1")
    assert led.names == ("j2", "j1", "j4")
    q = np.array([-0.4, 0.3, 0.2])
    J = frame_jacobian(free, np.array([-0.4, -0.6, 0.2]))
    np.testing.assert_allclose(frame_jacobian(led, q), J * [1, -2, 1], atol=1e-14)


def test_fingers_that_follow_a_joint_of_the_chain_do_not_move_the_tip(tmp_path):
    finger = joint("f", "tool", "finger", "prismatic", more=mimic("j4", 0.1))
    led = load(tmp_path, arm(link("finger"), finger), tip="tool")
    assert led.joints[3].followers == ("f",)
    np.testing.assert_allclose(
        frame_jacobian(led, Q), frame_jacobian(load(tmp_path, arm()), Q), atol=1e-14
    )


# ---- where the rest is held ------------------------------------------------------------------


def test_joints_outside_are_held_at_the_posture(tmp_path):
    follower = joint("f3_joint", "tool", "f3", more=mimic("f1_joint", 2, 1))
    text = arm(*hand("f1", "f2"), link("f3"), follower)
    open_ = {"f1_joint": 0.5, "f2_joint": 0.5}
    srdf = robot(state("home", **HOME), state("open", **HOME, **open_), state("wide", f1_joint=1.5))

    def held(**options):
        return dict(load(tmp_path, text, srdf, tip="tool", **options).held)

    closed = {"f1_joint": 0.0, "f2_joint": 0.0, "f3_joint": 1.0}
    assert held() == held(posture="home") == held(posture="mid-range") == closed
    assert held(posture="open") == {**open_, "f3_joint": 2.0}
    assert held(posture="wide") == {"f1_joint": 1.5, "f2_joint": 0.0, "f3_joint": 4.0}
    with pytest.raises(
        UnknownNameError, match=r"unknown posture 'opn'; available: home, open, mid-range"
    ):
        held(posture="opn")


STRAIGHT = {"j1": 0.3, "j2": 0, "j3": 0, "j4": 0}
BENT = {"j1": 0.3, "j2": 0.4, "j3": 0.5, "j4": 0.2}


def headed(srdf_states=(), **options):
    """Load an arm in a vertical plane, straight at zero, whose first link carries a head."""
    straight = {"xyz": "0.4 0 0", "rpy": "0 0 0"}
    joints = {
        f"j{i}": joint(f"j{i}", *ends, **straight)
        for i, ends in enumerate(pairwise(LINKS), start=1)
    }
    neck = joint("neck", "l1", "head", xyz="0 0 0.5", rpy="0 0 0")
    srdf = srdf_of(**dict(srdf_states)) if srdf_states else None
    return load_text(arm(link("head"), neck, **joints), srdf, **{"tip": "tool", **options})


DEFAULTS = {
    # states in the order of the SRDF, the default and where it has the neck
    "first": ({"a": {**BENT, "neck": 0.6}, "b": {**BENT, "neck": 0.9}}, "a", 0.6),
    "first is singular": ({"a": {**STRAIGHT, "neck": 0.6}, "b": {**BENT, "neck": 0.9}}, "b", 0.9),
    "first is outside": (
        {"a": {**BENT, "j1": 9, "neck": 0.6}, "b": {**BENT, "neck": 0.9}},
        "b",
        0.9,
    ),
    "second has no neck": ({"a": {**STRAIGHT, "neck": 0.6}, "b": BENT}, "b", 0.0),
    "first has no arm": ({"a": {"neck": 0.6}, "b": {**BENT, "neck": 0.9}}, "b", 0.9),
    "none will do": ({"a": {**STRAIGHT, "neck": 0.6}}, "mid-range", 0.0),
}


@pytest.mark.parametrize(("states", "default", "neck"), DEFAULTS.values(), ids=DEFAULTS)
def test_joints_outside_are_held_where_the_default_posture_has_them(states, default, neck):
    """Their weight hangs on the arm: the default is the same as its posture by name."""
    found, named = headed(states), headed(states, posture=default)
    place = choose_posture(found)
    assert f"'{default}'" in place.source or place.source.startswith(default)
    assert found.held == named.held == {"neck": neck}
    weights = [
        pin.computeGeneralizedGravity(one.model, one.data, place.q).copy()
        for one in (found, named, headed({"other": {**BENT, "neck": neck + 1.1}}))
    ]
    np.testing.assert_array_equal(weights[0], weights[1])
    assert abs(weights[0][0] - weights[2][0]) > 0.1
    assert list(found.model.names) == list(named.model.names)
    assert_consistent(found, place.q)


def test_a_posture_that_holds_joints_outside_elsewhere_is_no_default():
    """Not of any question: its weight would be that of another posture."""
    states = {"a": {**BENT, "neck": 0.6}, "b": {**BENT, "neck": 0.9}, "c": {**BENT, "neck": 0.6}}
    assert headed(states).preferred == ("a", "c")
    later = {"z": {**STRAIGHT, "neck": 0.1}, **states}
    assert headed(later).preferred == ("z", "a", "c")  # "z" is singular, which is told
    assert choose_posture(headed(later)).source == "posture 'a' ('z' is singular)"


def test_joints_above_the_base_are_held_where_the_default_posture_has_them():
    """They turn the chain against the root, in whose axes a result may be wanted."""
    states = {"a": STRAIGHT, "b": {**BENT, "j1": 0.9}}
    found = headed(states, base="l1")
    place = choose_posture(found)
    assert place.source == "posture 'b' ('a' is singular)"
    assert found.held == {"j1": 0.9, "neck": 0.0}
    whole = frame_jacobian(headed(), np.array([0.9, *place.q]), "world")
    np.testing.assert_allclose(frame_jacobian(found, place.q, "world"), whole[:, 1:], atol=1e-14)


def test_a_known_robots_posture_holds_what_is_outside_another_chain():
    known, right = known_robots()["baxter_left"], load_robot("baxter_left", tip="right_gripper")
    (untucked,) = known.postures.values()
    held = [right.held[name] for name in load_robot(known.name).names]
    np.testing.assert_array_equal(held, untucked)
    assert choose_posture(right).source == "mid-range"


def test_joints_that_cannot_be_zero_are_held_at_the_nearest_limit(tmp_path):
    limit = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'
    finger = joint("f", "tool", "x", limit=limit.format(0.2, 0.9))
    thumb = joint("t", "tool", "y", limit=limit.format(-0.9, -0.3))
    found = load(tmp_path, arm(link("x"), link("y"), finger, thumb), tip="tool")
    assert found.held == {"f": 0.2, "t": -0.3}


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_every_kind_takes_one_number(tmp_path, kind):
    one = load(tmp_path, robot(link("a"), link("b"), joint("j", "a", "b", kind)))
    assert one.n == 1
    assert choose_posture(one).q.shape == (1,)
    found = load(tmp_path, arm(j2=joint("j2", "l1", "l2", kind)))
    assert [joint.type for joint in found.joints] == ["revolute", kind, "revolute", "revolute"]
    assert found.coordinates.is_identity == (kind != "continuous")
    assert_consistent(found, Q)


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_held_joints_are_where_they_are_said_to_be(tmp_path, kind):
    text = arm(j1=joint("j1", "base", "l1", kind))
    whole = load(tmp_path, text)
    part = load(tmp_path, text, robot(state("home", j1=0.7, j2=0, j3=0, j4=0)), base="l1")
    assert part.held == {"j1": 0.7}
    pose = tip_pose(whole, np.array([0.7, *Q[1:]]))
    for got, wanted in zip(tip_pose(part, Q[1:]), pose, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-14)


# ---- names -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "names",
    [
        {"j2": "l2", "j1": "base", "j3": "tool"},
        {"l1": "universe", "j2": "universe"},
        {"base": "universe"},
        {"j1": "universe", "tool": "universe"},
        {"base": "world", "j1": "root_joint"},
        {"j2": "link 1", "l2": "joint 1"},
        {"j1": "2", "j2": "3", "j3": "4", "j4": "1"},
        {"j2": "[red]関節", "tool": "tööl  "},
    ],
)
def test_links_and_joints_may_be_called_anything(tmp_path, names):
    """A link may be called like a joint, and both like frames that Pinocchio makes itself."""
    plain = load(tmp_path, arm(*hand("f1", "f2")))
    text = arm(*hand("f1", "f2"))
    for old in names:  # first to what no part is called
        text = text.replace(f'="{old}"', f'="<{old}>"')
    for old, new in names.items():
        text = text.replace(f'"<{old}>"', f'"{new}"')
    named = load(tmp_path, text)
    assert named.names == tuple(names.get(name, name) for name in plain.names)
    assert named.tip == names.get("tool", "tool")
    assert list(named.model.names) == ["universe", *named.names]
    assert named.model.frames[named.tip_frame].name == named.tip
    assert named.model.frames[named.tip_frame].type == pin.FrameType.BODY
    np.testing.assert_array_equal(frame_jacobian(named, Q), frame_jacobian(plain, Q))


# ---- known robots with another tip or base ---------------------------------------------------


def test_the_registrys_ends_can_be_replaced():
    elbow = load_robot("panda", tip="panda_link5")
    assert (elbow.n, elbow.tip_source) == (5, "given")
    assert elbow.postures["default"].tolist() == [0.0, -0.785398, 0.0, -2.35619, 0.0]
    lifting = load_robot("pr2_left", base="base_footprint")
    assert (lifting.names[0], lifting.base_source) == ("torso_lift_joint", "given")


def test_a_posture_is_not_given_to_another_arm():
    """Baxter's arms have seven joints each: a posture is more than seven numbers."""
    other = load_robot("baxter_left", tip="right_gripper")
    assert "untucked" not in other.postures
    assert other.names[0] == "right_s0"
    assert "untucked" not in choose_posture(other).source
    assert load_robot("baxter_left", tip="head").n == 1
    assert (other.held["left_s1"], other.held["left_e1"]) == (-1.0, 1.94)


def test_corrections_are_told_for_the_joints_of_the_chain():
    note = "effort limit of shoulder_pan_joint, shoulder_lift_joint: 56 N·m; the URDF has"
    assert any(one.startswith(note) for one in load_robot("ur3").notes)
    short = load_robot("ur3", tip="upper_arm_link")
    assert [joint.effort for joint in short.joints] == [56.0, 56.0]
    assert not any("wrist" in one for one in short.notes)


# ---- from everything else --------------------------------------------------------------------


def test_a_path_that_does_not_exist_is_no_name(tmp_path):
    for source in ("panda.urdf", "./panda", tmp_path / "panda"):
        with pytest.raises(URDFError, match="no such file; expected a URDF"):
            load_robot(source)


def test_the_srdf_names_the_hand(tmp_path):
    srdf = robot(end_effector("l3"), chain("l1", "l3"))
    found = load(tmp_path, arm(), srdf)
    assert (found.tip, found.tip_source) == ("l3", "SRDF end effector")
    assert (found.base, found.base_source) == ("l1", "SRDF chain")
    assert found.tips == {"tool": 4}


def test_tip_frames_have_the_fixed_joints_in_them(tmp_path):
    tool = [
        link("tcp"),
        joint("mount", "tool", "tcp", "fixed", xyz="0 0 0.5", rpy=f"0 0 {math.pi}"),
    ]
    plain, mounted = load(tmp_path, arm()), load(tmp_path, arm(*tool))
    assert mounted.tip == "tcp"
    R, p = tip_pose(plain, Q)
    np.testing.assert_allclose(tip_pose(mounted, Q)[1], p + R @ [0, 0, 0.5], atol=1e-14)
    np.testing.assert_allclose(tip_pose(mounted, Q)[0], R @ np.diag([-1, -1, 1]), atol=1e-14)
