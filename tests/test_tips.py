"""Which link is the tool, and which the base, when nobody said so."""

import pytest

from ftforce.errors import InputError, UnknownNameError
from ftforce.robot.chain import choose_base, choose_tip, links_above, moving_path, tip_candidates
from ftforce.robot.formats.urdf import read_urdf
from ftforce.robot.srdf import Srdf
from urdfs import arm, chain, end_effector, hand, joint, link, load, robot, write

ENDS = "last link before several moving parts"


@pytest.fixture
def tree(tmp_path):
    """Return a function that reads a URDF."""
    return lambda text: read_urdf(write(tmp_path, text))


def tip_of(tree, srdf=None, tip=None, base=None):
    return choose_tip(tree, srdf or Srdf(), tip, base)


def fork(*more):
    """Return two arms of two joints each on a torso, and a head that does not move."""
    return robot(
        link("torso"), link("head"), joint("neck", "torso", "head", "fixed"),
        *(link(f"{side}{i}") for side in "lr" for i in (1, 2)),
        *(joint(f"{side}_shoulder", "torso", f"{side}1") for side in "lr"),
        *(joint(f"{side}_elbow", f"{side}1", f"{side}2") for side in "lr"),
        *more,
    )  # fmt: skip


# ---- from the tree alone ---------------------------------------------------------------------


def test_the_last_link_of_a_row(tree):
    assert tip_of(tree(arm())) == ("tool", "last link")
    ball = arm(link("ball"), joint("free", "l2", "ball", "floating"))
    assert tip_of(tree(ball)) == ("tool", "last link")
    assert tip_of(tree(arm()), Srdf(end_effectors=("tool",)), "l2") == ("l2", "given")


def test_fixed_links_at_the_end_are_followed_until_they_branch(tree):
    one = arm(link("flange"), link("tcp"), joint("a", "tool", "flange", "fixed"),
              joint("b", "flange", "tcp", "fixed"))  # fmt: skip
    assert tip_of(tree(one)) == ("tcp", "last link")
    camera = one.replace(
        "</robot>", link("eye") + joint("c", "flange", "eye", "fixed") + "</robot>"
    )
    assert tip_of(tree(camera)) == ("flange", "last link")


def test_the_last_link_before_the_fingers(tree):
    assert tip_of(tree(arm(*hand("f1", "f2")))) == ("tool", ENDS)
    assert tip_of(tree(arm(*hand("f1")))) == ("f1", "last link")


def test_fingers_behind_a_fixed_palm(tree):
    palm = [link("palm"), joint("wrist", "tool", "palm", "fixed")]
    fingers = [part.replace('"tool"', '"palm"') for part in hand("f1", "f2")]
    assert tip_of(tree(arm(*palm, *fingers))) == ("palm", ENDS)


def test_side_branches_that_do_not_move_are_no_branches(tree):
    text = arm(link("box"), link("plug"), joint("a", "l2", "box", "fixed"),
               joint("b", "box", "plug", "fixed"))  # fmt: skip
    assert tip_of(tree(text)) == ("tool", "last link")
    moves_later = text.replace('"b" type="fixed"', '"b" type="revolute"')
    assert tip_of(tree(moves_later)) == ("l2", ENDS)


def test_a_tree_that_branches_at_once_lists_the_tips(tree):
    with pytest.raises(InputError, match="several moving parts at the link 'torso'") as caught:
        tip_of(tree(fork()))
    assert str(caught.value).endswith("choose a tip (--tip): l2 (2 joints), r2 (2 joints)")
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
    assert tip_candidates(tree(arm(*hand("f1", "f2")))) == {"f1": 5, "f2": 5, "tool": 4}
    assert list(tip_candidates(tree(arm(*hand("f1", "f2"))))) == ["f1", "f2", "tool"]
    assert tip_candidates(tree(robot(link("a")))) == {}


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
