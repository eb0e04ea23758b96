"""SRDFs: tips, chains and named postures, and which of them are taken."""

import os

import pytest

from ftforce.errors import SRDFError
from ftforce.robot.load import load_robot
from ftforce.robot.srdf import Srdf, read_srdf
from urdfs import arm, chain, end_effector, load, robot, state, write

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


# ---- given, or in MoveIt's layout ------------------------------------------------------------


def test_a_given_srdf_takes_the_place_of_the_one_beside(tmp_path):
    other = tmp_path / "other.srdf"
    other.write_text(robot(state("away", **HOME), chain("base", "l3")), encoding="utf-8")
    urdf = write(tmp_path, arm(), robot(state("home", **HOME)))
    found = load_robot(urdf, srdf=other)
    assert (found.tip, tuple(found.postures)) == ("l3", ("away",))


def test_a_given_srdf_may_be_a_xacro_file(tmp_path):
    macro = '<xacro:macro name="named" params="n"><group_state name="${n}" group="arm">'
    joints = "".join(f'<joint name="{name}" value="${{0.1 * 2}}"/>' for name in HOME)
    text = f'{macro}{joints}</group_state></xacro:macro><xacro:named n="$(arg name)"/>'
    path = tmp_path / "arm.srdf.xacro"
    path.write_text(robot(text, attributes=' xmlns:xacro="x"'), encoding="utf-8")
    found = load_robot(write(tmp_path, arm()), srdf=path, args={"name": "away"})
    assert found.postures["away"].tolist() == [0.2] * 4


def test_an_srdf_of_another_robot_is_refused(tmp_path):
    other = tmp_path / "other.srdf"
    other.write_text(robot(state("home", wheel=1), name="rover"), encoding="utf-8")
    urdf = write(tmp_path, arm())
    with pytest.raises(SRDFError, match=r"other\.srdf: is for robot 'rover': none of its links"):
        load_robot(urdf, srdf=other)
    other.write_text("<robot/>", encoding="utf-8")  # says nothing that could be wrong
    assert load_robot(urdf, srdf=other).postures == {}


def package(folder, name, **files):
    """Make a package with files in a folder; return the last one."""
    (folder / name).mkdir(parents=True)
    (folder / name / "package.xml").touch()
    for place, (path, text) in files.items():
        (folder / name / place).mkdir(exist_ok=True)
        (folder / name / place / path).write_text(text, encoding="utf-8")
    return folder / name


@pytest.fixture
def workspace(tmp_path):
    """Return the URDF of a package, and a function that puts an SRDF into another package."""
    home = package(tmp_path / "src" / "arm_ros", "arm_description", urdf=("arm.urdf", arm()))

    def configured(place, text, name="arm.srdf"):
        return package(tmp_path / place, "my_moveit_config", config=(name, text))

    return home / "urdf" / "arm.urdf", configured


SRDF = robot(state("home", **HOME), end_effector("l3"))


@pytest.mark.parametrize(
    "place", ["src/arm_ros/arm_description", "src/arm_ros", "src"], ids=["in", "beside", "above"]
)
def test_the_srdf_of_a_moveit_configuration_is_found_and_told(workspace, place):
    urdf, configured = workspace
    config = configured(place, SRDF) / "config" / "arm.srdf"
    (config.parent / "broken.srdf").write_text("<robot", encoding="utf-8")
    (config.parent / "rover.srdf").write_text(SRDF.replace('"arm"', '"rover"', 1), encoding="utf-8")
    found = load_robot(urdf)
    assert (found.tip, tuple(found.postures)) == ("l3", ("home",))
    path = min(str(config), os.path.relpath(config), key=len)
    assert found.notes[0] == (
        f"tip and postures are those of {path}; --srdf or srdf= chooses another SRDF"
    )


def test_the_nearest_configuration_counts(workspace):
    urdf, configured = workspace
    configured("src", SRDF.replace("home", "far"))
    configured("src/arm_ros", SRDF.replace("home", "near"))
    assert tuple(load_robot(urdf).postures) == ("near",)


def test_of_several_none_is_read(workspace):
    urdf, configured = workspace
    config = configured("src/arm_ros", SRDF) / "config"
    (config / "arm_2.srdf").write_text(SRDF, encoding="utf-8")
    found = load_robot(urdf)
    assert (found.tip, dict(found.postures)) == ("tool", {})
    assert found.notes[0].startswith("2 SRDFs are for 'arm', so none is read: ")
    assert found.notes[0].endswith("arm_2.srdf; --srdf or srdf= chooses one")
    assert tuple(load_robot(urdf, srdf=config / "arm_2.srdf").postures) == ("home",)


def test_an_srdf_that_names_nothing_of_the_urdf_is_told_and_not_read(workspace):
    urdf, configured = workspace
    config = configured("src/arm_ros", SRDF) / "config"
    prefixed = arm()
    for name in ("base", "tool", "l1", "l2", "l3", "j1", "j2", "j3", *HOME):
        prefixed = prefixed.replace(f'"{name}"', f'"left_{name}"')
    urdf.write_text(prefixed, encoding="utf-8")
    found = load_robot(urdf)
    assert (found.tip, dict(found.postures)) == ("left_tool", {})
    path = min(str(config / "arm.srdf"), os.path.relpath(config / "arm.srdf"), key=len)
    assert found.notes[0] == f"{path} is not read: none of its links and joints are in the URDF"
    fitting = SRDF.replace('"l3"', '"left_l3"')  # beside one that fits it does not count
    (config / "left.srdf").write_text(fitting, encoding="utf-8")
    assert load_robot(urdf).tip == "left_l3"


def test_nothing_is_searched_outside_a_package(workspace, tmp_path):
    urdf, configured = workspace
    configured("src/arm_ros", SRDF)
    (urdf.parents[1] / "package.xml").unlink()
    assert load_robot(urdf).notes == ()
    linked = urdf.parents[2] / "other_moveit_config"
    (urdf.parents[1] / "package.xml").touch()
    (urdf.parents[2] / "my_moveit_config" / "config" / "arm.srdf").rename(tmp_path / "arm.srdf")
    linked.mkdir()
    (linked / "config").symlink_to(tmp_path)  # leads out of the tree
    assert load_robot(urdf).notes == ()
    package(tmp_path, "elsewhere", config=("arm.srdf", SRDF))
    (urdf.parents[2] / "linked_moveit_config").symlink_to(tmp_path / "elsewhere")
    assert load_robot(urdf).notes == ()


ONE = "--srdf or srdf= chooses one"


def test_xacro_files_of_srdfs_are_told_and_not_evaluated(workspace, tmp_path):
    urdf, configured = workspace
    trap = "${open('" + str(tmp_path / "trap") + "', 'w')}"
    text = SRDF.replace('"arm"', '"$(arg name)"', 1).replace("home", trap)
    text = text.replace("<robot", '<robot xmlns:xacro="x"', 1)
    config = configured("src/arm_ros", text, "arm.srdf.xacro") / "config"
    (config / "rover.srdf.xacro").write_text('<robot name="rover"/>', encoding="utf-8")
    (config / "broken.srdf.xacro").write_text("<robot", encoding="utf-8")
    found = load_robot(urdf)
    path = min(str(config / "arm.srdf.xacro"), os.path.relpath(config / "arm.srdf.xacro"), key=len)
    assert found.postures == {}
    assert found.notes[0] == (
        f"{path} is a xacro file, so it is evaluated only on request: --srdf or srdf= chooses it"
    )
    (urdf.parent / "arm.srdf.xacro").write_text(text, encoding="utf-8")
    both = load_robot(urdf).notes[0]
    assert f"{urdf.parent / 'arm.srdf.xacro'}, " in both
    assert both.endswith("are xacro files, so they are evaluated only on request: " + ONE)
    assert not (tmp_path / "trap").exists()
    configured("src", SRDF)  # any SRDF will do
    assert load_robot(urdf).notes[0].startswith("tip and postures are those of ")


def test_a_xacro_file_beside_a_urdf_outside_a_package_is_told(tmp_path):
    urdf = write(tmp_path, arm())
    (tmp_path / "arm.srdf.xacro").write_text(SRDF, encoding="utf-8")
    assert "arm.srdf.xacro is a xacro file, so it" in load_robot(urdf).notes[0]
    assert tuple(load_robot(urdf, srdf=tmp_path / "arm.srdf.xacro").postures) == ("home",)
