"""Which link is the tool, and which the base, when nobody said so."""

import math

import numpy as np
import pytest

import ftforce
from ftforce.batch.workspace_map import workspace_map
from ftforce.errors import InputError, UnknownNameError
from ftforce.report.files import to_dict
from ftforce.report.robot import robot_document
from ftforce.report.text import tip_in_words
from ftforce.robot.chain import choose_base, links_above, moving_path
from ftforce.robot.formats.urdf import read_urdf
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.posture import choose_posture
from ftforce.robot.srdf import Srdf
from ftforce.robot.tip import BY_NAME, choose_tip, tip_candidates
from ftforce.show.render import to_text
from ftforce.trajectory import Path
from urdfs import arm, chain, end_effector, hand, joint, link, load, mimic, robot, write

ENDS = "last link before several moving parts"


@pytest.fixture
def tree(tmp_path):
    """Return a function that reads a URDF."""
    return lambda text: read_urdf(write(tmp_path, text))


def tip_of(tree, srdf=None, tip=None, base=None):
    return choose_tip(tree, srdf or Srdf(), tip, base)[:2]


def fork(*more):
    """Return two arms of two joints each on a torso, and a head that does not move."""
    return robot(
        link("torso"), link("head"), joint("neck", "torso", "head", "fixed"),
        *(link(f"{side}{i}") for side in "lr" for i in (1, 2)),
        *(joint(f"{side}_shoulder", "torso", f"{side}1") for side in "lr"),
        *(joint(f"{side}_elbow", f"{side}1", f"{side}2") for side in "lr"),
        *more,
    )  # fmt: skip


def fixed(parent, child, **origin):
    """Return a link that is fixed to another."""
    return [link(child), joint(f"{child}_joint", parent, child, "fixed", **origin)]


def moving(parent, *children, kind="revolute", **options):
    """Return links in series, each moved by a joint."""
    ends = zip((parent, *children), children, strict=False)
    return [part for a, b in ends for part in (link(b), joint(f"{b}_joint", a, b, kind, **options))]


def fingers(parent, *children):
    return [part for child in children for part in moving(parent, child, kind="prismatic")]


def nameless(*more):
    """Return the arm with a last link whose name says nothing."""
    return arm(*more).replace('"tool"', '"end"')


# ---- from the tree alone ---------------------------------------------------------------------


def test_the_last_link_of_a_row(tree):
    assert tip_of(tree(arm())) == ("tool", "last link")
    ball = arm(link("ball"), joint("free", "l2", "ball", "floating"))
    assert tip_of(tree(ball)) == ("tool", "last link")
    assert tip_of(tree(arm()), Srdf(end_effectors=("tool",)), "l2") == ("l2", "given")


def test_fixed_links_at_the_end_are_followed_until_they_branch(tree):
    one = nameless(*fixed("end", "plate"), *fixed("plate", "peg"))
    assert tip_of(tree(one)) == ("peg", "last link")
    camera = nameless(*fixed("end", "plate"), *fixed("plate", "peg"), *fixed("plate", "eye"))
    assert tip_of(tree(camera)) == ("plate", "last link")


def test_the_numbering_is_followed_where_fixed_links_branch(tree):
    """A Panda's flange is panda_link8, beside the collision model of link7."""
    text = nameless(*fixed("end", "end_sc"), *fixed("end", "l5")).replace('"end"', '"l4"')
    assert tip_of(tree(text)) == ("l5", "last link")


def test_the_last_link_before_the_fingers(tree):
    assert tip_of(tree(nameless(*fingers("end", "f1", "f2")))) == ("end", ENDS)
    assert tip_of(tree(nameless(*fingers("end", "f1")))) == ("f1", "last link")


def test_fingers_behind_a_fixed_palm(tree):
    palm = fixed("end", "palm")
    assert tip_of(tree(nameless(*palm, *fingers("palm", "f1", "f2")))) == ("palm", ENDS)


def test_side_branches_that_do_not_move_are_no_branches(tree):
    text = nameless(*fixed("l2", "box"), *fixed("box", "plug"))
    assert tip_of(tree(text)) == ("end", "last link")
    moves_later = text.replace('"plug_joint" type="fixed"', '"plug_joint" type="revolute"')
    with pytest.raises(InputError, match="3 moving joints lie beyond 'l2'"):
        tip_of(tree(moves_later))


def test_a_tree_that_branches_at_once_lists_the_tips(tree):
    with pytest.raises(InputError, match="several moving parts at the link 'torso'") as caught:
        tip_of(tree(fork()))
    assert str(caught.value).endswith("choose a tip (--tip): l2 (2 joints), r2 (2 joints)")
    assert "which tip? " in str(caught.value)
    uneven = fork().replace('"l_elbow" type="revolute"', '"l_elbow" type="fixed"')
    with pytest.raises(InputError, match=r"tip \(--tip\): r2 \(2 joints\), l2 \(1 joint\)$"):
        tip_of(tree(uneven))


def test_a_base_above_one_arm_decides(tree):
    assert tip_of(tree(fork()), base="r1") == ("r2", "last link")
    with pytest.raises(InputError, match="no movable joint below the link 'head'"):
        tip_of(tree(fork()), base="head")


def test_nothing_moves(tree):
    for text in (robot(link("a")), robot(link("a"), link("b"), joint("j", "a", "b", "fixed"))):
        with pytest.raises(InputError, match=r"arm\.urdf: no movable joint below the link 'a'"):
            tip_of(tree(text))


def test_candidates_are_where_moving_parts_end(tree):
    assert tip_candidates(tree(fork())) == {"l2": 2, "r2": 2}
    assert list(tip_candidates(tree(arm(*hand("f1", "f2")))).items()) == [
        ("tool", 4), ("f1", 5), ("f2", 5)
    ]  # fmt: skip
    assert tip_candidates(tree(robot(link("a")))) == {}


# ---- the tool frame by name ------------------------------------------------------------------

ORDER = ("tool0", "gripper_tcp", "linkEE", "tool_plate", "endEffector", "iiwa-flange", "grasp_pose")


@pytest.mark.parametrize("count", range(1, len(ORDER) + 1))
def test_the_order_of_tool_frames(tree, count):
    """Each kind gives way to those before it, wherever it stands in the file."""
    frames = [part for name in ORDER[-count:][::-1] for part in fixed("end", name)]
    eye = fixed("end", "camera_link", xyz="0 0 1")
    found = choose_tip(tree(nameless(*eye, *frames)), Srdf(), None, None)
    assert found == (ORDER[-count], BY_NAME, {})


@pytest.mark.parametrize(
    "name",
    ["tool0", "robot_tool0", "panda_hand_tcp", "tcp_link", "ee_link", "iiwa_link_ee", "link_eef",
     "wrist_ft_tool_link", "TOOL", "j2s6s200_end_effector", "END-EFFECTOR", "end_effector_link",
     "right_endpoint", "flange", "joint6_flange", "grasping_frame", "gripper_frame_link"],
)  # fmt: skip
def test_names_that_makers_give_to_tool_frames(tree, name):
    text = nameless(*fixed("end", "eye"), *fixed("end", name), *fingers("end", "f1", "f2"))
    assert tip_of(tree(text)) == (name, BY_NAME)


@pytest.mark.parametrize("name", ["knee", "stool", "cetcp", "feet_link", "wheel", "beef", "agrasp"])
def test_names_that_only_contain_one(tree, name):
    text = nameless(*fixed("end", "eye"), *fixed("end", name))
    assert tip_of(tree(text)) == ("end", "last link")


def test_of_one_kind_the_plain_name_and_then_the_outermost(tree):
    kuka = nameless(*fixed("end", "iiwa_link_ee_kuka"), *fixed("end", "iiwa_link_ee"))
    assert tip_of(tree(kuka)) == ("iiwa_link_ee", BY_NAME)
    tiago = nameless(*fixed("end", "arm_tool_link"), *fixed("arm_tool_link", "hand_tool_link"))
    assert tip_of(tree(tiago.replace("base", "root"))) == ("hand_tool_link", "last link")


def test_only_what_is_fixed_to_the_last_link_counts(tree):
    text = nameless(*fixed("base", "tool0"), *fixed("l3", "tcp"), *fixed("end", "flange"))
    assert tip_of(tree(text)) == ("flange", "last link")
    ball = nameless(link("tool0"), joint("free", "end", "tool0", "floating"))
    assert tip_of(tree(ball))[0] == "end"


def test_frames_that_differ_are_told_with_their_distance(tree):
    there = {"xyz": "0 0.09 0", "rpy": "0 0 0"}
    near = {"xyz": "0.0009 0.09 0", "rpy": "0 0 0.017"}  # 0.9 mm, 0.97 degrees
    text = nameless(
        *fixed("end", "tool0", **there), *fixed("end", "ee_link", **near),
        *fixed("end", "tcp", xyz="0.3 0.09 0.4", rpy="0 0 0"),
        *fixed("tcp", "grasp", xyz="-0.3 0 -0.4", rpy="1.5707963267948966 0 0"),
    )  # fmt: skip
    found = choose_tip(tree(text), Srdf(), None, None)
    assert (found.link, list(found.others)) == ("tool0", ["tcp", "grasp"])
    assert found.others["tcp"] == pytest.approx((0.5, 0.0), abs=1e-12)
    assert found.others["grasp"] == pytest.approx((0.0, math.pi / 2), abs=1e-12)
    for other, moved in (("1.1", "0"), ("0.9", "0.018")):  # more than 1 mm or 1 degree
        far = near | {"xyz": f"0.000{other[0]}{other[2]} 0.09 0", "rpy": f"0 0 {moved}"}
        far["xyz"] = f"{float(other) / 1e3} 0.09 0"
        two = nameless(*fixed("end", "tool0", **there), *fixed("end", "ee_link", **far))
        assert list(choose_tip(tree(two), Srdf(), None, None).others) == ["ee_link"]


def every_result(found, folder):
    """Return one result of every kind about an arm, stored ones as they are read again."""
    start = tip_pose(found, choose_posture(found).q)[1]
    line = Path.through([start, start + np.array([0.01, 0.0, 0.01])], speed=0.05)
    asked = {"task": "fx,fz", "force": [1.0, 2.0]}
    ftforce.save(ftforce.simulate(found, line, rate=20, **asked), folder / "run.csv")
    ftforce.sweep(found, n=64, output=folder / "sweep.zarr", threads=1, **asked)
    stored = ftforce.open_sweep(folder / "sweep.zarr")
    return [
        ftforce.analyze(found, locked=1), ftforce.capability(found, locked=1),
        ftforce.census(found), ftforce.timeline(found, line, rate=20, **asked),
        ftforce.load_history(folder / "run.csv"), stored, workspace_map(stored),
        ftforce.compare([found, stored], n=64, threads=1, **asked),
    ]  # fmt: skip


@pytest.mark.thorough  # every kind of result, each computed once
def test_the_header_tells_the_other_frames(tmp_path):
    tools = [*fixed("end", "tool0", rpy="0 0 0", xyz="0 0 0"),
             *fixed("tool0", "ee_link", xyz="0 0 0.02", rpy="0 0 0.5")]  # fmt: skip
    found = load(tmp_path, nameless(*tools))
    words = "tool0 (tool frame by name), not ee_link (20.0 mm, 28.6° away)"
    assert tip_in_words(found) == words
    others = {"ee_link": {"distance": pytest.approx(0.02), "angle": pytest.approx(0.5)}}
    assert words in " ".join(to_text(found).split())
    assert robot_document(found)["other_tips"] == others
    for one in every_result(found, tmp_path):
        shown = to_text(one)
        assert words in " ".join(shown.split())
        assert max(map(len, shown.splitlines())) <= 80
        document = to_dict(one)
        for about in [document["robot"]] if "robot" in document else document["arms"]:
            assert (about["tip"], about["tip_source"]) == ("tool0", "tool frame by name")
            assert about["other_tips"] == others
    given = load(tmp_path, nameless(*tools), tip="ee_link")
    assert (tip_in_words(given), given.other_tips) == ("ee_link (given)", {})


# ---- the branch that is the arm --------------------------------------------------------------

SIX = ("a1", "a2", "a3", "a4", "a5", "a6")


def six(*more):
    """Return an arm of six joints a1 … a6 on a base."""
    return robot(link("base"), *moving("base", *SIX), *more)


COUNTERWEIGHT = moving("a1", "spring_body", "spring_rod")
PARALLELOGRAM = [
    link("rod"), joint("rod_joint", "a1", "rod", more=mimic("a3_joint", -1)),
    link("plate"), joint("plate_joint", "rod", "plate", more=mimic("a2_joint")),
]  # fmt: skip
ASIDE = {
    "counterweight": moving("a1", "spring_body", "spring_rod"),
    "unnamed counterweight": moving("a1", "x", "y"),
    "parallelogram that follows": PARALLELOGRAM,
    "head": moving("a2", "neck", "head", "eye"),
    "lidar": moving("base", "velodyne"),
    "wheels": [*moving("base", "wheel_l"), *moving("base", "wheel_r")],
    "legs": [part for leg in "wxyz" for part in moving("base", f"{leg}1", f"{leg}2", f"{leg}3")],
}


@pytest.mark.parametrize("branch", ASIDE.values(), ids=ASIDE)
def test_what_is_no_arm_is_passed_by(tree, branch):
    """Like the counterweight of an IRB 6700, after which the chain would be joint_1 alone."""
    assert tip_of(tree(six(*branch, *fixed("a6", "tool0")))) == ("tool0", "last link")
    assert tip_of(tree(six(*branch, *fixed("a6", "plate_6")))) == ("plate_6", "last link")


def test_a_follower_beside_the_last_joint_is_no_branch(tree):
    rod = [link("rod"), joint("rod_joint", "l3", "rod", more=mimic("j2", -1))]
    assert tip_of(tree(nameless(*rod))) == ("end", "last link")
    driven = [link("rod"), joint("rod_joint", "l3", "rod")]
    assert tip_of(tree(nameless(*driven))) == ("l3", ENDS)


def test_a_branch_with_a_tool_frame_is_the_arm(tree):
    twin = moving("a1", "b2", "b3", "b4", "b5", "b6")
    assert tip_of(tree(six(*twin, *fixed("a6", "tool0")))) == ("tool0", "last link")
    assert tip_of(tree(six(*twin, *fixed("b6", "tool0")))) == ("tool0", "last link")
    for frames in ((), (*fixed("a6", "tool0"), *fixed("b6", "tcp"))):
        with pytest.raises(InputError, match=r"which tip.* at the link 'a1'; choose a tip"):
            tip_of(tree(six(*twin, *frames)))


def test_a_tool_frame_on_a_much_shorter_branch_is_a_question(tree):
    changer = [*moving("a1", "rack"), *fixed("rack", "tool1")]
    with pytest.raises(InputError, match=r"\(--tip\): tool1 \(2 joints\), a6 \(6 joints\)"):
        tip_of(tree(six(*changer)))
    assert tip_of(tree(six(*changer, *fixed("a6", "tool0"))))[0] == "tool0"


ONE_JAW = [*fixed("a6", "hand_base"), *moving("hand_base", "jaw")]
GRIPPERS = {
    "one jaw": moving("a6", "jaw"),
    "one jaw that is called a gripper": [link("mover"), joint("jointGripper", "a6", "mover")],
    "leader and follower": [
        *moving("a6", "left"), link("right"),
        joint("right_joint", "a6", "right", more=mimic("left_joint", -1)),
    ],
    "two jaws": fingers("a6", "left", "right"),
    "two-link fingers": [*moving("a6", "finger_1", "tip_1"), *moving("a6", "finger_2", "tip_2")],
    "a hand": [
        *moving("a6", "thumb_1", "thumb_2", "thumb_3"),
        *moving("a6", "index_1", "index_2", "index_3"),
        *moving("a6", "pinky_1", "pinky_2", "pinky_3"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
def test_the_arm_ends_before_the_gripper(tmp_path, gripper):
    found = load(tmp_path, six(*gripper))
    assert (found.tip, found.n) == ("a6", 6)
    named = load(tmp_path, six(*gripper, *fixed("a6", "grasp_frame")))
    assert (named.tip, named.tip_source, named.n) == ("grasp_frame", BY_NAME, 6)


def test_a_jaw_beyond_a_named_frame_is_a_gripper_whatever_its_name(tree):
    for beyond in (("x",), ("x", "y")):
        text = six(*fixed("a6", "palm_tcp"), *moving("a6", *beyond))
        assert tip_of(tree(text)) == ("palm_tcp", BY_NAME)
    longer = six(*fixed("a6", "palm_tcp"), *moving("a6", "x", "y", "z"))
    assert tip_of(tree(longer)) == ("z", "last link")
    named = six(*fixed("a6", "changer_tool"), *moving("a6", "x"), *fixed("x", "tcp"))
    assert tip_of(tree(named)) == ("tcp", "last link")


def test_the_wrist_that_turns_a_gripper_is_a_joint_of_the_arm(tree):
    text = six(link("gripper"), joint("wrist_roll", "a6", "gripper"), *moving("gripper", "jaw"))
    assert tip_of(tree(text)) == ("gripper", ENDS)
    yaw = six(link("hand"), joint("GripperYaw", "a6", "hand"))
    assert tip_of(tree(yaw)) == ("hand", "last link")


def test_a_finger_on_its_own_is_an_arm(tree):
    alone = robot(link("base"), *moving("base", "finger_upper", "finger_middle", "finger_lower"))
    assert tip_of(tree(alone)) == ("finger_lower", "last link")
    wheel = robot(link("base"), *moving("base", "wheel"))
    assert tip_of(tree(wheel)) == ("wheel", "last link")


def test_a_gripper_on_its_own_is_a_question(tree):
    right = [link("right"), joint("right_joint", "base", "right", more=mimic("left_finger_joint"))]
    for beside in (right, moving("base", "right_finger")):
        text = robot(link("base"), *moving("base", "left_finger"), *beside)
        with pytest.raises(InputError, match=r"which tip\?.*left_finger \(1 joint\), right"):
            tip_of(tree(text))


def test_many_joints_beyond_the_tip_are_a_question(tree):
    two = [*moving("a6", "x"), *moving("a6", "y")]
    assert tip_of(tree(six(*two))) == ("a6", ENDS)
    with pytest.raises(
        InputError, match=r"which tip.*3 moving joints lie beyond 'a6'; choose a tip"
    ):
        tip_of(tree(six(*two, *moving("a6", "z"))))
    with pytest.raises(InputError, match="3 moving joints lie beyond 'tool0'"):
        tip_of(tree(six(*two, *moving("a6", "z"), *fixed("a6", "tool0"))))
    with pytest.raises(InputError, match="several moving parts at the link 'a6'"):
        tip_of(tree(six(*moving("a6", "x1", "x2", "x3"), *moving("a6", "y1", "y2", "y3"))))


def test_candidates_come_best_first(tree):
    """The wanted frames were missing, and finger tips stood first."""
    arms = [
        part
        for side in "lr"
        for part in (*moving("torso", f"{side}1", f"{side}2"), *fixed(f"{side}2", f"{side}_tcp"),
                     *moving(f"{side}2", f"{side}_finger_1", f"{side}_finger_2"))
    ]  # fmt: skip
    text = robot(link("torso"), *arms, *moving("torso", "head", "eye"), *moving("torso", "leg"))
    assert list(tip_candidates(tree(text)).items()) == [
        ("l_tcp", 2), ("r_tcp", 2), ("leg", 1), ("l_finger_2", 4), ("r_finger_2", 4), ("eye", 2)
    ]  # fmt: skip
    wanted = r"\(--tip\): l_tcp \(2 joints\), r_tcp \(2 joints\), leg \(1 joint\); or one of 3 on f"
    with pytest.raises(InputError, match=r"which tip\?.*" + wanted):
        tip_of(tree(text))


def test_the_arm_is_found_below_a_given_base(tree):
    text = six(*moving("base", *(f"b{i}" for i in range(6))), *COUNTERWEIGHT, *fixed("a6", "tcp"))
    assert tip_of(tree(text), base="a1") == ("tcp", "last link")
    assert tip_of(tree(text), base="b2") == ("b5", "last link")


# ---- from the SRDF ---------------------------------------------------------------------------


def test_the_srdfs_only_end_effector(tree):
    arms = tree(fork())
    assert tip_of(arms, Srdf(end_effectors=("l2",))) == ("l2", "SRDF end effector")
    assert tip_of(arms, Srdf(end_effectors=("l2", "lost"))) == ("l2", "SRDF end effector")
    assert tip_of(arms, Srdf(end_effectors=("torso", "r2"))) == ("r2", "SRDF end effector")


def test_the_srdfs_only_chain(tree):
    arms = tree(fork())
    srdf = Srdf(chains=(("torso", "r2"), ("l1", "l1")))
    assert tip_of(arms, srdf) == ("r2", "SRDF chain tip")
    both = Srdf(end_effectors=("l2",), chains=(("torso", "r2"),))
    assert tip_of(arms, both) == ("l2", "SRDF end effector")
    lost = Srdf(end_effectors=("lost",), chains=(("torso", "r2"),))
    assert tip_of(arms, lost) == ("r2", "SRDF chain tip")


@pytest.mark.parametrize(
    "ends", [("tool", "l1"), ("lost", "tool"), ("base", "lost"), ("l3", "l3"), ("f1", "f2")]
)
def test_a_chain_whose_base_is_not_above_its_tip_is_none(tree, ends):
    """Taking its tip alone would put the tool at the wrong end."""
    assert tip_of(tree(arm(*hand("f1", "f2"))), Srdf(chains=(ends,))) == ("tool", ENDS)


def test_several_tips_in_the_srdf_are_a_question(tree):
    arms = tree(fork())
    with pytest.raises(InputError, match=r"a\.srdf names several SRDF end effectors; choose one "):
        tip_of(arms, Srdf("a.srdf", end_effectors=("l2", "r2")))
    with pytest.raises(InputError, match=r"several SRDF chain tips; .*\(--tip\): l2, r2$"):
        tip_of(arms, Srdf("a.srdf", chains=(("torso", "l2"), ("torso", "r2"))))
    assert tip_of(arms, Srdf(end_effectors=("l2", "r2")), base="r1") == ("r2", "SRDF end effector")


# ---- from the caller -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ({"tip": "toool"}, r"unknown tip link 'toool' in .*arm\.urdf; .* did you mean 'tool'\?"),
        ({"tip": ""}, "unknown tip link '' in .*; available: base, l1, l2, l3, tool"),
        ({"tip": "j1"}, "unknown tip link 'j1'"),
        ({"base": "l11"}, r"unknown base link 'l11' in .* did you mean 'l1'\?"),
        ({"base": "", "tip": "tool"}, "unknown base link ''"),
    ],
)
def test_links_that_do_not_exist(tree, ends, message):
    with pytest.raises(UnknownNameError, match=message):
        tip_of(tree(arm()), **ends)


# ---- the base --------------------------------------------------------------------------------


def test_the_base_is_the_root_unless_something_says_otherwise(tree):
    one = tree(arm())
    chained = Srdf(chains=(("l1", "tool"), ("l2", "l3")))
    assert choose_base(one, Srdf(), "tool", None) == ("base", "root link")
    assert choose_base(one, chained, "tool", None) == ("l1", "SRDF chain")
    assert choose_base(one, chained, "tool", "l2") == ("l2", "given")
    two = Srdf(chains=(("l1", "tool"), ("l2", "tool")))
    assert choose_base(one, two, "tool", None) == ("base", "root link")
    below = Srdf(chains=(("tool", "l1"), ("lost", "tool")))
    assert choose_base(one, below, "l1", None) == ("base", "root link")


@pytest.mark.parametrize("base", ["l3", "tool", "f1"])
def test_a_base_that_is_not_above_the_tip(tree, base):
    with pytest.raises(InputError, match=f"'{base}' does not lie .* available: base, l1, l2$"):
        choose_base(tree(arm(*hand("f1"))), Srdf(), "l3", base)


def test_paths(tree):
    one = tree(arm(j2=joint("j2", "l1", "l2", "fixed")))
    assert [joint.name for joint in moving_path(one, "base", "tool")] == ["j1", "j3", "j4"]
    assert [joint.name for joint in moving_path(one, "l1", "tool")] == ["j3", "j4"]
    assert moving_path(one, "base", "base") == ()
    assert links_above(one, "l2") == ["base", "l1"]
    assert links_above(one, "base") == []


# ---- what the robot says about it ------------------------------------------------------------


def test_links_that_only_the_srdf_knows_are_told(tmp_path):
    srdf = robot(end_effector("gripper"), chain("world", "tool"))
    found = load(tmp_path, arm(), srdf)
    assert found.tip_source == "last link"
    assert found.notes == ("the SRDF names links that are not in the URDF: gripper, world",)
    assert load(tmp_path, arm(), srdf, tip="tool").notes == ()


def test_no_joint_between_base_and_tip(tmp_path):
    text = arm(link("flange"), joint("a", "base", "flange", "fixed"))
    with pytest.raises(
        InputError, match=r"no joint moves the tip 'flange' relative to the base 'base'"
    ):
        load(tmp_path, text, tip="flange")
    with pytest.raises(InputError, match=r"available tips: tool"):
        load(tmp_path, text, tip="base")
