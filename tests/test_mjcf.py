"""MJCF files, compared with MuJoCo itself: frames, weight, masses, limits and what is refused."""

import re
import sys

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from ftforce import cli, load_robot
from ftforce.errors import FtforceError, URDFError
from ftforce.robot.dynamics import mass_matrix, weight_torque
from ftforce.robot.kinematics import frame_jacobian, tip_pose
from ftforce.view.geometry.meshes import load_geometry
from ftforce.view.geometry.visuals import read_visuals
from mjcf_arms import ARMS

RNG = np.random.default_rng(18)


@pytest.fixture(params=ARMS)
def arm(request, tmp_path):
    """The text of an arm, and the arm."""
    text = ARMS[request.param]
    file = tmp_path / "arm.xml"
    file.write_text(text)
    return text, load_robot(file)


def in_mujoco(text, robot, q):
    """Return model and data at a posture, and the velocities there for those of the chain.

    Followers are put where ftforce has them; MuJoCo's own constraints say whether that is right.
    """
    spec = mujoco.MjSpec.from_string(text)
    for geom in [one for one in spec.geoms if one.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    model = spec.compile()
    data, fold = mujoco.MjData(model), np.zeros((model.nv, robot.n))
    for name, value in robot.held.items():
        data.joint(name).qpos = value
    G, offset = robot.coordinates.G, robot.coordinates.offset
    for i in range(1, robot.model.njoints):
        row, joint = robot.model.joints[i].idx_v, model.joint(robot.model.names[i])
        data.qpos[joint.qposadr] = G[row] @ q + offset[row]
        fold[joint.dofadr] = G[row]
    mujoco.mj_forward(model, data)
    is_equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[is_equality]).max(initial=0.0) < 1e-12
    J = data.efc_J.reshape(-1, model.nv)[is_equality]
    assert np.abs(J @ fold).max(initial=0.0) < 1e-12
    return model, data, fold


def test_the_same_arm_as_in_mujoco(arm):
    text, robot = arm
    assert robot.n >= 3
    low, high = robot.ranges
    for _ in range(3):
        q = RNG.uniform(low, high)
        model, data, fold = in_mujoco(text, robot, q)
        site, J = model.site(robot.tip).id, np.zeros((2, 3, model.nv))
        mujoco.mj_jacSite(model, data, *J, site)
        expected = J.reshape(6, -1) @ fold
        np.testing.assert_allclose(frame_jacobian(robot, q, "world"), expected, atol=1e-9)
        R, place = tip_pose(robot, q)
        np.testing.assert_allclose(place, data.site_xpos[site], atol=1e-9)
        np.testing.assert_allclose(R.ravel(), data.site_xmat[site], atol=1e-9)
        weight = fold.T @ data.qfrc_bias
        np.testing.assert_allclose(weight_torque(robot, q), weight, atol=1e-9)
        M = np.zeros((robot.n, model.nv))
        for row, v in zip(M, fold.T.copy(), strict=True):
            mujoco.mj_mulM(model, data, row, v)
        M -= model.dof_armature * fold.T  # counts on request only
        np.testing.assert_allclose(mass_matrix(robot, q), M @ fold, atol=1e-9)


# ---- what the files say ------------------------------------------------------------------------


def arm_of(folder, text, **options):
    """Return the arm of a text."""
    (folder / "arm.xml").write_text(text)
    return load_robot(folder / "arm.xml", **options)


def test_limits_of_joints_are_those_of_their_actuators(tmp_path):
    panda = arm_of(tmp_path, ARMS["panda"])
    assert panda.effort.tolist() == [87.0] * 4 + [12.0] * 3
    assert panda.lower[3] == -3.0718
    assert panda.armature.tolist() == [0.1] * 7
    assert panda.damping.tolist() == [1.0] * 7
    iiwa = arm_of(tmp_path, ARMS["iiwa14"])
    assert iiwa.effort.tolist() == [320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0]
    assert iiwa.friction.tolist() == [0.2] * 7
    np.testing.assert_allclose(iiwa.upper, np.radians([170, 120, 170, 120, 170, 120, 175]))
    assert arm_of(tmp_path, ARMS["xarm"]).effort.tolist() == [50.0] * 6  # actuatorfrcrange
    gantry = arm_of(tmp_path, ARMS["gantry"])
    # yaw: the smaller direction; pitch: 2 · 10 + 3 · 4 of two motors; others have no limit
    np.testing.assert_array_equal(gantry.effort, [300, np.nan, 60, 32, np.nan, np.nan, np.nan])
    assert any("yaw -60 to 80" in note for note in gantry.notes)
    assert any("no actuator acts: y, reach" in note for note in gantry.notes)
    assert gantry.joints[-1].type == "continuous"


def test_keyframes_are_postures(tmp_path):
    panda = arm_of(tmp_path, ARMS["panda"])
    assert panda.postures["home"].tolist() == [0, 0, 0, -1.57079, 0, 1.57079, -0.7853]
    assert panda.held["finger_joint1"] == 0.04
    assert panda.preferred == ("home",)
    odd = ARMS["panda"].replace('qpos="0 0', 'qpos="0')
    assert not arm_of(tmp_path, odd).postures


def test_floating_bases_are_held_and_bodies_keep_their_names(tmp_path):
    mobile = arm_of(tmp_path, ARMS["mobile"])
    assert any("'floating_base' (floating or planar) is held" in note for note in mobile.notes)
    assert "coupled" in mobile.joints[1].followers
    assert mobile.names == ("lift", "shoulder", "elbow")
    assert arm_of(tmp_path, ARMS["mobile"], base="mast", tip="middle").names == ("shoulder",)


def test_a_joint_that_an_equality_holds_is_fixed(tmp_path):
    hold = '<equality><joint joint1="f1" polycoef="0.3 0 0 0 0"/></equality>'
    option = '<option gravity="0 0 -1.62"/>'
    robot = arm_of(
        tmp_path, hand(f'{option}{hold}<keyframe><key qpos="1 2 3 1 0 0 0"/></keyframe>')
    )
    assert any("held fixed" in note and "f1 at 0.3" in note for note in robot.notes)
    assert robot.gravity.tolist() == [0.0, 0.0, -1.62]
    assert robot.postures["key0"].tolist() == [1.0, 2.0]


HAND = """
<mujoco>
  {extra}
  <worldbody>
    <body name="a">
      <joint name="j1" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.3"/>
      <body name="b" pos="0 0 0.3">
        <joint name="j2" axis="0 1 0" {joint}/>
        <geom {geom}/>
        <body name="tool0" pos="0 0 0.2">
          <geom size="0.02"/>
          <body name="finger1">
            <joint name="f1"/><geom size="0.01"/><body name="tip1" pos="0.1 0 0"/>
          </body>
          <body name="finger2">
            <joint name="f2" type="ball"/><geom size="0.01"/><body name="tip2"/>
          </body>
        </body>
      </body>
    </body>
    <body name="target" mocap="true" pos="0 0 0.5"/>
    <body name="post" pos="0 0 0.5"/>
  </worldbody>
</mujoco>
"""


def hand(extra="", joint="", geom='size="0.02"'):
    return HAND.format(extra=extra, joint=joint, geom=geom)


def equality(inside):
    return hand(f"<equality>{inside}</equality>")


NOTED = {
    "loop beyond": (
        equality('<connect name="c" body1="tip1" body2="tip2" anchor="0 0 0"/>'),
        "outside the chain: the connect constraint 'c' between 'tip1' and 'tip2' closes a loop",
    ),
    "mocap": (
        equality('<weld body1="tool0" body2="target"/>'),
        "a weld constraint between 'tool0' and 'target', a mocap body, is ignored",
    ),
    "polynomial": (
        equality('<joint joint1="f1" joint2="j1" polycoef="0 1 0.5 0 0"/>'),
        "joint 'f1' follows 'j1' by a polynomial",
    ),
    "ball": (hand(), "joint 'f2' is a ball joint"),
    "spring": (hand(joint='stiffness="3"'), "springs of joints (stiffness) are ignored: j2"),
    "tendon": (
        hand('<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'),
        "tendons are ignored: t",
    ),
    "generated": (
        hand().replace("</worldbody>", '<composite type="cable"/></worldbody>'),
        "parts of the model that are ignored: <composite>",
    ),
    "gravity": (hand('<option gravity="0 0 -1.62"/>'), "gravity is that of the file: (0, 0, -1.62"),
    "weightless": (
        hand('<option><flag gravity="disable"/></option>'),
        "gravity is that of the file: (0, 0, 0)",
    ),
    "mesh": (
        hand('<asset><mesh name="m" file="no.stl"/></asset>', geom='type="mesh" mesh="m"'),
        "the masses of b are incomplete: they follow from meshes that are missing",
    ),
}


@pytest.mark.parametrize(("text", "note"), NOTED.values(), ids=NOTED)
def test_what_does_not_concern_the_arm_is_a_note(tmp_path, text, note):
    robot = arm_of(tmp_path, text)
    assert (robot.tip, robot.names) == ("tool0", ("j1", "j2"))
    assert [one for one in robot.notes if note in one]


REFUSED = {
    "loop": (
        equality('<connect name="c" body1="tool0" body2="post" anchor="0 0 0"/>'),
        {},
        "the connect constraint 'c' between 'tool0' and 'post' closes a loop; only open chains",
    ),
    "ball": (hand(), {"tip": "tip2"}, "joint 'f2' is a ball joint, which no single motor drives"),
    "polynomial": (
        equality('<joint joint1="j2" joint2="j1" polycoef="0 1 0.5 0 0"/>'),
        {},
        "joint 'j2' follows 'j1' by a polynomial, which is not supported",
    ),
    "attach": (
        hand().replace("<geom", '<attach model="m" prefix="p"/><geom', 1),
        {},
        "attaches another model .<attach>., which is not supported; let MuJoCo save it as one file",
    ),
    "schema": (
        hand(joint='colour="red"'),
        {},
        "MuJoCo rejects it: Schema violation: unrecognized attribute: 'colour' Element 'joint'$",
    ),
    "NaN": (hand(joint='ref="nan"'), {}, "<joint>: ref 'nan' is not finite"),
    "huge": (hand(joint='pos="0 1e99 0"'), {}, "joint 'j2': origin xyz '.*' is too large"),
    "infinite": (hand(joint='damping="inf"'), {}, "<joint>: damping 'inf' is not finite"),
    "deep": (
        hand().replace("<worldbody>", "<worldbody>" + "<frame>" * 300 + "</frame>" * 300),
        {},
        "is nested more than 200 elements deep",
    ),
    "copies": (
        hand().replace(
            "</worldbody>", '<replicate count="999999999"><body/></replicate></worldbody>'
        ),
        {},
        "has more than 5000 bodies",
    ),
    "nothing": ("<mujoco/>", {}, "no movable joint"),
    "args": (hand(), {"args": {"a": 1}}, "is an MJCF file: it takes no arguments"),
}


@pytest.mark.parametrize(("text", "options", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_analysed_is_one_clear_line(tmp_path, text, options, message):
    with pytest.raises(FtforceError, match=message) as caught:
        arm_of(tmp_path, text, **options)
    assert "\n" not in str(caught.value)


def test_an_arm_without_masses_has_kinematics(tmp_path):
    bare = re.sub("<geom [^>]*>", "", hand())
    robot = arm_of(tmp_path, bare)
    assert robot.mass == 0.0
    np.testing.assert_allclose(frame_jacobian(robot, np.zeros(2), "world")[0], [0.5, 0.2])


SHAPE = trimesh.creation.box((0.1, 0.06, 0.3)).apply_transform(
    trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0.2, 0.3))
)


SOLID = 'density="700"'
MESHES = {
    "stretched": ("stl", 'scale="1 2 1"', SOLID),
    "of an OBJ": ("obj", 'scale="1 2 1"', SOLID),
    "moved": ("stl", 'scale="1 2 3" refpos="0.1 0 0.2"', SOLID),
    "turned": ("stl", 'scale="2 2 2" refpos="0.1 0 0.2" refquat="0.8 0 0.6 0"', SOLID),
    "without mass": ("stl", 'scale="2 2 2" refpos="0.1 0 0.2" refquat="0.8 0 0.6 0"', 'mass="0"'),
}


@pytest.mark.parametrize(("ending", "given", "mass"), MESHES.values(), ids=MESHES)
def test_meshes_are_mujocos(tmp_path, ending, given, mass):
    asset = f'<compiler meshdir="assets"/><asset><mesh file="rod.{ending}" {given}/></asset>'
    geom = f'type="mesh" mesh="rod" {mass} euler="10 0 20" pos="0 0.1 0"'
    text = hand(asset, geom=geom).replace("<geom", '<geom type="sphere" size="0.1"/><geom', 1)
    (tmp_path / "assets").mkdir()
    SHAPE.export(tmp_path / "assets" / f"rod.{ending}")
    robot = arm_of(tmp_path, text)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data = mujoco.MjData(model)
    data.qpos[:2] = q = np.array([0.4, -0.9])
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(weight_torque(robot, q), data.qfrc_bias[:2], atol=1e-9)
    # The page shows the file where MuJoCo has it, which moves its vertices to the centre of mass.
    shapes = read_visuals(robot.path, robot.description()).shapes
    (visual,) = [v for v in shapes if v.shape == "mesh"]
    vertices = np.unique(SHAPE.vertices, axis=0) * visual.size
    placed = vertices @ visual.placement[:3, :3].T + visual.placement[:3, 3]
    geom = int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)[0])
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[geom])
    theirs = model.mesh_vert @ R.reshape(3, 3).T + model.geom_pos[geom]
    distance, _ = cKDTree(placed).query(theirs)
    assert distance.max() < 1e-6  # files have single precision


def test_vertices_in_the_file_itself_weigh_and_are_rods_in_the_page(tmp_path):
    asset = '<asset><mesh name="m" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/></asset>'
    text = hand(asset, geom='type="mesh" mesh="m" density="7000"')
    robot = arm_of(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(text)
    assert robot.mass == pytest.approx(model.body("a").subtreemass[0])
    assert not [note for note in robot.notes if "incomplete" in note]
    (note,) = load_geometry(robot).notes
    assert "link 'b': a mesh without a file of its own" in note


def test_what_is_drawn_is_what_does_not_collide(tmp_path):
    shown = '<geom type="ellipsoid" size="0.1 0.2 0.3" contype="0" conaffinity="0" pos="0 0 1"/>'
    asset = '<asset><mesh name="m" file="m.stl"/></asset>'
    text = hand(asset, geom='type="mesh" mesh="m" mass="1"')
    SHAPE.export(tmp_path / "m.stl")

    def kinds(text):
        robot = arm_of(tmp_path, text)
        shapes = read_visuals(robot.path, robot.description()).shapes
        return robot, [v.shape for v in shapes if v.link == "b"]

    bar = text.replace('<geom type="mesh"', '<geom type="box" size="1 1 1"/><geom type="mesh"')
    assert kinds(bar)[1] == ["box", "mesh"]  # both collide
    robot, found = kinds(text.replace('<geom type="mesh"', shown + '<geom type="mesh"'))
    assert found == ["ellipsoid"]
    (part,) = [part for part in load_geometry(robot).parts if part.joint == 2]
    size = np.ptp(part.vertices, axis=0)
    # From the lowest point of the sphere at the tip, z = 0.18 m, to the ellipsoid's highest, 1.3 m.
    np.testing.assert_allclose(size, [0.2, 0.4, 1.12], rtol=1e-2)


@pytest.mark.parametrize("content", [b"", b"solid", b"\0" * 84 + b"\xff\xff\xff\x7f", b"v 1 nan x"])
def test_meshes_that_are_damaged_leave_the_mass_out(tmp_path, content):
    text = hand('<asset><mesh name="m" file="m.stl"/></asset>', geom='type="mesh" mesh="m"')
    (tmp_path / "m.stl").write_bytes(content)
    robot = arm_of(tmp_path, text)
    assert any("masses of b are incomplete" in note for note in robot.notes)
    text = text.replace("m.stl", "../../m.stl")
    assert not read_visuals(robot.path, arm_of(tmp_path, text).description()).notes


def test_without_mujoco_the_command_that_installs_it_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(URDFError, match=r"is an MJCF file .*pip install 'ftforce\[mjcf\]'"):
        arm_of(tmp_path, hand())


# ---- files -------------------------------------------------------------------------------------


@pytest.fixture
def parts(tmp_path):
    """A folder with an arm in two files, of which the second includes a third elsewhere."""
    scene = '<mujoco><include file="parts/arm.xml"/><statistic extent="1"/></mujoco>'
    inner = ARMS["ur5e"].replace("<default>", '<include file="{}"/><default>', 1)
    option = '<mujocoinclude><option gravity="0 0 -1"/></mujocoinclude>'
    files = {"arm/scene.xml": scene, "arm/parts/arm.xml": inner, "arm/parts/option.xml": option}
    files |= {"other/option.xml": option}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def included(folder, name):
    file = folder / "arm" / "parts" / "arm.xml"
    file.write_text(file.read_text().replace("{}", name))
    return folder / "arm" / "scene.xml"


@pytest.mark.parametrize("name", ["parts/option.xml", "option.xml", "{}/arm/parts/option.xml"])
def test_files_below_the_folder_are_included(parts, name):
    robot = load_robot(included(parts, name.format(parts)))
    assert (robot.n, robot.gravity.tolist()) == (6, [0.0, 0.0, -1.0])
    assert robot.path == str(parts / "arm" / "scene.xml")


@pytest.mark.parametrize("name", ["../other/option.xml", "{}/other/option.xml", "link.xml"])
def test_other_files_are_included_only_if_their_folder_is_named(parts, name):
    (parts / "arm" / "link.xml").symlink_to(parts / "other" / "option.xml")
    scene = included(parts, name.format(parts))
    with pytest.raises(URDFError, match=r"outside the file's folder; name a folder .*--package-pa"):
        load_robot(scene)
    assert load_robot(scene, package_path=parts / "other").gravity[2] == -1.0


INCLUDES = {
    "missing": ("nowhere.xml", "includes 'nowhere.xml', of which there is no file"),
    "itself": ("parts/arm.xml", "includes arm.xml twice"),
    "the first": ("scene.xml", "includes scene.xml twice"),
    "device": ("/dev/zero", "outside the file's folder"),
    "folder": ("parts", "of which there is no file"),
    "long": ("x" * 9999, "of which there is no file"),
    "no XML": ("parts/data.xml", "is not well-formed XML"),
    "DTD": ("parts/dtd.xml", "contains a DTD"),
}


@pytest.mark.parametrize(("name", "message"), INCLUDES.values(), ids=INCLUDES)
def test_what_cannot_be_included_is_one_clear_line(parts, name, message):
    (parts / "arm" / "parts" / "data.xml").write_text("root:x:0")
    (parts / "arm" / "parts" / "dtd.xml").write_text('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>')
    with pytest.raises(URDFError, match=message):
        load_robot(included(parts, name))


def test_on_the_command_line_and_in_the_page(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(ARMS["xarm"])
    result = CliRunner().invoke(cli.build("analyze"), ["analyze", str(file), "--locked", "2,4"])
    assert result.exit_code == 0, result.output
    assert "xarm: 6 joints, world → link_tcp" in result.output
    geometry = load_geometry(load_robot(file))
    assert [part.joint for part in geometry.parts] == [1, 2, 3, 4, 5, 6]
    assert not geometry.notes


def test_missing_meshes_are_rods_in_the_page(tmp_path):
    asset = '<asset><mesh name="m" file="../../no.stl"/></asset>'
    geometry = load_geometry(arm_of(tmp_path, hand(asset, geom='type="mesh" mesh="m" mass="1"')))
    assert [part.joint for part in geometry.parts] == [1, 2]
    assert [note for note in geometry.notes if f"{tmp_path}/no.stl' was not found" in note]
