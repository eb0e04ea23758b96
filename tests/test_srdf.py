"""SRDFs: tips, chains and named postures, and which of them are taken."""

import pytest

from ftforce.errors import SRDFError
from ftforce.robot.srdf import Srdf, read_srdf
from urdfs import arm, chain, end_effector, load, robot, state

HOME = {"j1": 0.1, "j2": 0.2, "j3": 0.3, "j4": 0.4}


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "arm.srdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_srdf(path)

    return read


def test_what_matters_is_read(read, tmp_path):
    srdf = read(
        robot(
            end_effector("tool"), end_effector("tool"), end_effector("l3"), "<end_effector/>",
            chain("base", "tool"), chain("base", "tool"), chain("", "tool"), "<chain/>",
            '<virtual_joint name="v" type="floating" parent_frame="w" child_link="base"/>',
            '<disable_collisions link1="a" link2="b"/>',
            state("home", j1=1, j2="-2.5"), state("zero", j1=0), state(" ", j1=3),
        )
    )  # fmt: skip
    assert srdf.path == str(tmp_path / "arm.srdf")
    assert srdf.end_effectors == ("tool", "l3")
    assert srdf.chains == (("base", "tool"),)
    assert srdf.states == {"home": {"j1": 1.0, "j2": -2.5}, "zero": {"j1": 0.0}}


def test_without_an_srdf_nothing_is_known():
    assert (Srdf().end_effectors, Srdf().chains, dict(Srdf().states)) == ((), (), {})


def test_states_of_one_name_are_one_posture(read):
    srdf = read(robot(state("home", j1=1, j2=2), state("zero", j1=0), state("home", j2=5, j3=3)))
    assert srdf.states["home"] == {"j1": 1.0, "j2": 5.0, "j3": 3.0}
    assert tuple(srdf.states) == ("home", "zero")


def test_joints_with_several_numbers_are_passed_over(read):
    assert read(robot(state("home", root="0 0 1 0 0 0 1", j1=2))).states["home"] == {"j1": 2.0}


def test_states_cannot_be_changed(read):
    states = read(robot(state("home", j1=1))).states
    with pytest.raises(TypeError):
        states["home"]["j1"] = 2.0
    with pytest.raises(TypeError):
        states["zero"] = {}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty; expected an SRDF"),
        (b"\xff", "is not UTF-8 text"),
        ("<robot>", "is not well-formed XML"),
        ("<!DOCTYPE a><robot/>", "contains a DTD"),
        ("<srdf/>", "is not an SRDF: its root element is <srdf>, not <robot>"),
        (robot(state("a", j1="x")), "state 'a', joint 'j1': value 'x' is not a number"),
        (robot(state("a", j1="nan")), "state 'a', joint 'j1': value 'nan' is not finite"),
        (robot(state("a", j9="inf")), "state 'a', joint 'j9': value 'inf' is not finite"),
        (robot(state("a", j1="1e30")), "state 'a', joint 'j1': value '1e30' is too large"),
        (robot(state("a", j1="")), "state 'a', joint 'j1': value '': expected 1 number, got 0"),
        (robot(state("a", j1="1,5")), "state 'a', joint 'j1': value '1,5' is not a number"),
        (robot(state("a&#10;b")), r"the state name 'a\\nb' contains unprintable characters"),
    ],
)
def test_malformed_srdfs(read, tmp_path, content, message):
    with pytest.raises(SRDFError, match=message) as caught:
        read(content)
    assert caught.value.path == str(tmp_path / "arm.srdf")
    assert "\n" not in str(caught.value)


# ---- beside a URDF ---------------------------------------------------------------------------


def test_the_srdf_of_the_same_name_is_picked_up(tmp_path):
    assert load(tmp_path, arm()).postures == {}
    found = load(tmp_path, arm(), robot(state("home", **HOME)))
    assert {name: q.tolist() for name, q in found.postures.items()} == {
        "home": [0.1, 0.2, 0.3, 0.4]
    }


def test_a_broken_srdf_beside_a_fine_urdf_is_an_error(tmp_path):
    with pytest.raises(SRDFError, match=r"arm\.srdf: is not well-formed XML"):
        load(tmp_path, arm(), "<robot>")


def test_an_srdf_that_cannot_be_read_is_not_passed_over(tmp_path):
    (tmp_path / "arm.srdf").symlink_to("nowhere")
    with pytest.raises(SRDFError, match=r"arm\.srdf: no such file"):
        load(tmp_path, arm())
    (tmp_path / "arm.srdf").unlink()
    (tmp_path / "arm.srdf").mkdir()
    with pytest.raises(SRDFError, match=r"arm\.srdf: is a folder"):
        load(tmp_path, arm())


def test_a_state_for_part_of_the_chain_is_left_out_and_told(tmp_path):
    srdf = robot(state("part", j1=1, j3=1), state("other", finger=1), state("home", **HOME, x=9))
    found = load(tmp_path, arm(), srdf)
    assert tuple(found.postures) == ("home",)
    assert found.notes == ("posture 'part' is ignored: it has no position for j2, j4",)
