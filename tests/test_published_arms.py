"""Known robots generated from published numbers, against what a second source publishes."""

import numpy as np
import pinocchio as pin
import pytest

from ftforce import analyze, load_robot
from ftforce.errors import DHTableError, InputError
from ftforce.robot.dynamics import weight_torque
from ftforce.robot.formats.dh import DHFlange, DHRow, DHTable, MassModel, read_dh_table
from ftforce.robot.formats.dh_to_urdf import to_srdf, to_urdf, write_robot
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.known_robots import known_robots, robots_folder

HALF = np.pi / 2
GENERATED = [path.stem for path in sorted(robots_folder().glob("*.toml")) if path.stem != "robots"]

# config/NAME/default_kinematics.yaml of the ROS package ur_description: x, y, z of shoulder,
# forearm, wrist 1, wrist 2 and wrist 3, and rolls; the other numbers are zero or the same for all.
# Its repository has none of the UR10e: those of robotics-toolbox-python in the same places.
ROS = {
    "ur3e": (0.15185, -0.24355, (-0.2132, 0, 0.13105), -0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, (-0.3922, 0, 0.1333), -0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, (-0.57155, 0, 0.17415), -0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, (-0.36, 0, 0.17415), -0.11985, 0.11655),
}


def ros_frames(name, q):
    """Return the placements of the six moving links, as the URDF of ur_description has them."""
    shoulder, forearm, wrist_1, wrist_2, wrist_3 = ROS[name]
    steps = [
        ((0, 0, shoulder), (0, 0, 0)), ((0, 0, 0), (HALF, 0, 0)), ((forearm, 0, 0), (0, 0, 0)),
        (wrist_1, (0, 0, 0)), ((0, wrist_2, 0), (HALF, 0, 0)),
        ((0, wrist_3, 0), (HALF, np.pi, np.pi)),
    ]  # fmt: skip
    frames, here = [], pin.SE3.Identity()
    for (xyz, rpy), angle in zip(steps, q, strict=True):
        turn = pin.SE3(pin.utils.rotate("z", angle), np.zeros(3))
        here = here * pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz, float)) * turn
        frames.append(here)
    return frames


# Nguyen and Hughes (1994): each joint's place on the link before it, and its axis.
STATION_ARM = [
    ((1.3589, 0, 0), "x"), ((0, 0, 0.7026), "z"), ((0, -0.5692, 0), "y"), ((7.11, -0.475, 0), "y"),
    ((7.11, 0, 0), "y"), ((0, -0.5692, 0), "z"), ((0, 0, -0.7026), "x"),
]  # fmt: skip


def drawn(n, count=5):
    return np.random.default_rng(3).uniform(-3.0, 3.0, (count, n))


@pytest.mark.parametrize("name", ROS)
def test_the_tip_is_where_another_source_has_it(name):
    robot = load_robot(name)
    for q in drawn(6):
        R, p = tip_pose(robot, q)
        last = ros_frames(name, q)[-1]
        np.testing.assert_allclose(p, last.translation, atol=1e-12)
        np.testing.assert_allclose(R, last.rotation, atol=1e-12)


def test_the_tip_of_the_station_arm_is_where_the_paper_has_it():
    robot = load_robot("canadarm2")
    root = pin.SE3(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.zeros(3))
    tool = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    for q in drawn(7):
        here = pin.SE3.Identity()
        for (place, axis), angle in zip(STATION_ARM, q, strict=True):
            here = here * pin.SE3(np.eye(3), np.array(place, float))
            here = here * pin.SE3(pin.utils.rotate(axis, angle), np.zeros(3))
        here = root.inverse() * here * pin.SE3(tool.T, np.array([1.3589, 0, 0]))
        R, p = tip_pose(robot, q)
        np.testing.assert_allclose(p, here.translation, atol=1e-12)
        np.testing.assert_allclose(R, here.rotation, atol=1e-12)


# physical_parameters.yaml of the UR16e in ur_description, which converts what the maker publishes
# into the frames of its URDF: masses, and centres of mass in the frames of `ros_frames`.
UR16E = [
    (7.369, (0, -0.030, -0.016)), (10.45, (-0.1764, 0, 0.16)), (4.321, (-0.166, 0, 0.065)),
    (2.18, (0, -0.011, -0.009)), (2.033, (0, 0.012, -0.018)), (0.907, (0, 0, -0.044)),
]  # fmt: skip


def test_the_weight_is_that_of_another_source():
    """The gravity torques are the derivatives of the potential energy."""
    robot = load_robot("ur16e")

    def energy(q):
        links = zip(ros_frames("ur16e", q), UR16E, strict=True)
        return sum(9.81 * mass * frame.act(np.array(at, float))[2] for frame, (mass, at) in links)

    for q in drawn(6, 3):
        steps = 1e-5 * np.eye(6)
        expected = [(energy(q + step) - energy(q - step)) / 2e-5 for step in steps]
        np.testing.assert_allclose(
            pin.computeGeneralizedGravity(robot.model, robot.data, robot.to_model(q)),
            expected, atol=1e-6,
        )  # fmt: skip


# The makers' own URDFs: each joint's origin (xyz, rpy; it turns about z, or where said about y or
# -y) and the mass and centre of mass of its link (kg, m), at last the tool's origin. From packages
# kuka_lbr_iiwa_support, franka_description (robots/fr3/*.yaml), kortex_description (without the
# vision module), xarm_description (masses: xArm 6, model 4, of docs.ufactory.cc) and
# sawyer_description (right_arm_base_link to right_hand).
MAKERS = {
    "iiwa14": """
0 0 0.1575  0 0 0
0 0 0.2025  0 0 0  y
0 0 0.2045  0 0 0
0 0 0.2155  0 0 0  -y
0 0 0.1845  0 0 0
0 0 0.2155  0 0 0  y
0 0 0.081   0 0 0
0 0 0.071   0 0 0""",
    "fr3": """
0 0 0.333        0 0 0                   2.9274653454 0.0000004128 -0.0181251324 -0.0386035970
0 0 0            -1.570796326794897 0 0  2.9355370338 0.0031828864 -0.0743221644 0.0088146084
0 -0.316 0       1.570796326794897 0 0   2.2449013699 0.0407015686 -0.0048200565 -0.0289730823
0.0825 0 0       1.570796326794897 0 0   2.6155955791 -0.0459100965 0.0630492960 -0.0085187868
-0.0825 0.384 0  -1.570796326794897 0 0  2.3271207594 -0.0016039605 0.0292536262 -0.0972965990
0 0 0            1.570796326794897 0 0   1.8170376524 0.0597131221 -0.0410294666 -0.0101692726
0.088 0 0        1.570796326794897 0 0   0.6271432862 0.0045225817 0.0086261921 -0.0161633251
0 0 0.107        0 0 0""",
    "gen3": """
0 0 0.15643             3.1416 0 0   1.3773 -2.3E-05 -0.010364 -0.07336
0 0.005375 -0.12838     1.5708 0 0   1.1636 -4.4E-05 -0.09958 -0.013278
0 -0.21038 -0.006375    -1.5708 0 0  1.1636 -4.4E-05 -0.006641 -0.117892
0 0.006375 -0.21038     1.5708 0 0   0.9302 -1.8E-05 -0.075478 -0.015006
0 -0.20843 -0.006375    -1.5708 0 0  0.6781 1E-06 -0.009432 -0.063883
0 0.00017505 -0.10593   1.5708 0 0   0.6781 1E-06 -0.045483 -0.00965
0 -0.10593 -0.00017505  -1.5708 0 0  0.364 -9.3E-05 0.000132 -0.022905
0 0 -0.061525           3.14159265358979 0 0""",
    "xarm6": """
0 0 0.267         0 0 0        2.53 -0.000164 0.03594 -0.0065
0 0 0             -1.5708 0 0  2.242 0.04084 -0.2403 0.03254
0.0535 -0.2845 0  0 0 0        2.019 0.0714 0.1268 0.0109
0.0775 0.3425 0   -1.5708 0 0  1.361 0.000185 0.01466 -0.02197
0 0 0             1.5708 0 0   1.345 0.06824 0.03342 0.00264
0.076 0.097 0     -1.5708 0 0  0.173 0.0008 -0.00359 -0.01326
0 0 0             0 0 0""",
    "sawyer": """
0 0 0.08          0 0 0                           5.3213 0.024366 0.010969 0.14363
0.081 0.05 0.237  -1.57079632679 1.57079632679 0  4.505 -0.0030849 -0.026811 0.092521
0 -0.14 0.1425    1.57079632679 0 0               1.745 -0.00016044 -0.014967 0.13582
0 -0.042 0.26     -1.57079632679 0 0              2.5097 -0.0048135 -0.0281 -0.084154
0 -0.125 -0.1265  1.57079632679 0 0               1.1136 -0.0018844 0.0069001 0.1341
0 0.031 0.275     -1.57079632679 0 0              1.5625 0.0061133 -0.023697 0.076416
0 -0.11 0.1053    -1.57079632679 -0.17453 3.1416  0.3292 -8.0726E-06 0.0085838 -0.0049566
0 0 0.0245        0 0 1.570796""",
}
AXES = {"z": (0, 0, 1), "y": (0, 1, 0), "-y": (0, -1, 0)}
# The makers round angles to 4 digits, and Kinova the lengths of its DH table to 0.1 mm.
FAR = {"iiwa14": 1e-12, "fr3": 1e-12, "gen3": 5e-4, "xarm6": 1e-5, "sawyer": 1e-6}  # m


def maker_model(name):
    """Return Pinocchio's model of a maker's arm, with a frame ``tool``."""
    lines = MAKERS[name].strip().splitlines()
    model, joint, at = pin.Model(), 0, pin.SE3.Identity()
    for line in lines:
        words = line.split()
        axis = words.pop() if words[-1][-1] == "y" else "z"
        x, y, z, roll, pitch, yaw, *mass = map(float, words)
        at = pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), np.array([x, y, z]))
        if line is lines[-1]:
            break
        turn = pin.JointModelRevoluteUnaligned(np.array(AXES[axis], float))
        joint = model.addJoint(joint, turn, at, f"{joint + 1}")
        if mass:
            lever, none = np.array(mass[1:]), np.zeros((3, 3))
            model.appendBodyToJoint(joint, pin.Inertia(mass[0], lever, none), pin.SE3.Identity())
    model.addFrame(pin.Frame("tool", joint, 0, at, pin.FrameType.OP_FRAME))
    return model


@pytest.mark.parametrize("name", MAKERS)
def test_poses_are_those_of_the_makers_urdf(name):
    robot, model = load_robot(name), maker_model(name)
    data = model.createData()
    for q in drawn(robot.n):
        pin.framesForwardKinematics(model, data, q)
        expected = data.oMf[model.getFrameId("tool")]
        R, p = tip_pose(robot, q)
        np.testing.assert_allclose(p, expected.translation, atol=FAR[name])
        np.testing.assert_allclose(R, expected.rotation, atol=3e-5)


@pytest.mark.parametrize("name", [name for name in MAKERS if name != "iiwa14"])
def test_the_weight_is_that_of_the_makers_urdf(name):
    robot, model = load_robot(name), maker_model(name)
    data = model.createData()
    assert robot.mass == pytest.approx(sum(body.mass for body in model.inertias), abs=1e-3)
    for q in drawn(robot.n):
        expected = pin.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(weight_torque(robot, q), expected, atol=0.02)  # 0.01 mm, 0.1 g


def test_the_maker_of_the_iiwa_publishes_no_masses_and_that_is_said():
    robot = load_robot("iiwa14")
    assert robot.mass == 0.0
    assert "the maker publishes no masses" in robot.notes[0]
    assert analyze(robot, locked=[2]).rnea.gravity is None


@pytest.mark.parametrize("name", GENERATED)
def test_the_files_are_those_that_ftforce_dh_makes(name):
    table = read_dh_table(robots_folder() / f"{name}.toml")
    assert known_robots()[name].urdf.read_text() == to_urdf(table)
    assert known_robots()[name].srdf.read_text() == to_srdf(table)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_flange_is_a_last_row_that_does_not_move(convention, tmp_path):
    """A joint in its place that stands at zero gives the same tool, and the same weight below."""
    rng = np.random.default_rng(6)
    rows = [DHRow(*rng.uniform(0.2, 1.0, 4), "revolute", -3, 3, mass=1.0) for _ in range(3)]
    flange = DHFlange(*rng.uniform(0.2, 1.0, 4))
    still = DHRow(flange.a, flange.alpha, flange.d, flange.theta, "revolute", -1, 1, mass=1e-9)
    solid = MassModel("thin rod", 0.01)
    fixed = DHTable("arm", convention, tuple(rows), solid, flange=flange)
    moved = DHTable("arm", convention, (*rows, still), solid)
    arm = load_robot(write_robot(fixed, tmp_path / "fixed.urdf")[0])
    other = load_robot(write_robot(moved, tmp_path / "moved.urdf")[0])
    assert (arm.n, arm.tip, other.n) == (3, "tool", 4)
    for q in drawn(3, 2):
        R, p = tip_pose(arm, q)
        expected = moved.transforms([*q, 0.0])[-1]
        np.testing.assert_allclose(fixed.transforms(q)[-1], expected, atol=1e-14)
        np.testing.assert_allclose(R, expected[:3, :3], atol=1e-14)
        np.testing.assert_allclose(p, expected[:3, 3], atol=1e-14)
        weight = weight_torque(other, np.array([*q, 0.0]))[:3]
        np.testing.assert_allclose(weight_torque(arm, q), weight, atol=1e-6)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_given_centre_of_mass_is_in_the_frame_of_its_link(convention, tmp_path):
    rng = np.random.default_rng(5)
    rows = tuple(
        DHRow(*rng.uniform(0.2, 1.0, 4), kind, -3, 3, mass=m, centre=tuple(rng.uniform(-1, 1, 3)))
        for kind, m in (("revolute", 1.0), ("prismatic", 2.0), ("revolute", 0.5))
    )
    table = DHTable("arm", convention, rows, MassModel("thin rod", 0.01))
    robot = load_robot(write_robot(table, tmp_path / "arm.urdf")[0])
    for q in drawn(3, 2):
        frames = table.transforms(q)[1:]
        centres = [T[:3, :3] @ row.centre + T[:3, 3] for T, row in zip(frames, rows, strict=True)]
        found = pin.centerOfMass(robot.model, robot.data, robot.to_model(q))
        expected = np.average(centres, axis=0, weights=[row.mass for row in rows])
        np.testing.assert_allclose(found, expected, atol=1e-12)


TABLE = """
name = "arm"
convention = "standard"
units = {{ length = "mm", angle = "deg" }}
rows = [{{ type = "revolute", a = 300, alpha = 0, d = 0, theta = 0, lower = -1, upper = 1, {} }}]
{}
"""
MASS = '[mass]\nmodel = "thin rod"\nradius = 10'


def test_a_centre_of_mass_has_the_unit_of_lengths(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(TABLE.format("mass = 2, centre = [-100, 0, 50]", MASS))
    assert read_dh_table(path).rows[0].centre == (-0.1, 0.0, 0.05)


def test_a_flange_has_the_units_of_the_table(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(
        TABLE.format("effort = 1", "flange = { a = 5, alpha = 180, d = 107, theta = 0 }")
    )
    assert read_dh_table(path).flange == DHFlange(0.005, np.pi, 0.107, 0.0)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("1", "flange: expected a table with a, alpha, d, theta; got 1"),
        ("{ a = 1, alpha = 0, d = 0 }", "flange: missing key 'theta'"),
        ("{ a = 1, alpha = 0, d = 0, theta = true }", "flange: theta needs a number, got True"),
        ("{ a = 1, alpha = 0, d = inf, theta = 0 }", "flange: d needs a finite number"),
        ("{ a = 1, alpha = 0, d = 0, theta = 0, mass = 1 }", "flange: unknown key 'mass'"),
    ],
)
def test_malformed_flanges(tmp_path, entry, message):
    path = tmp_path / "arm.toml"
    path.write_text(TABLE.format("effort = 1", f"flange = {entry}"))
    with pytest.raises(DHTableError, match=message):
        read_dh_table(path)


@pytest.mark.parametrize("link", ["flange", "flange_joint"])
def test_the_names_of_the_flange_are_taken_only_with_one(link, tmp_path):
    row = DHRow(0.3, 0, 0.1, 0, "revolute", -1, 1, mass=2.0, link=link)
    table = DHTable("arm", "standard", (row,), MassModel("thin rod", 0.01))
    assert load_robot(write_robot(table, tmp_path / "arm.urdf")[0]).mass == 2.0
    with pytest.raises(InputError, match=f"{link!r} appears twice"):
        DHTable("arm", "standard", (row,), table.mass, flange=DHFlange(0, 0, 0, 0))


@pytest.mark.parametrize(
    ("keys", "mass", "message"),
    [
        ("mass = 2, centre = 1", MASS, r"row 1: centre needs three numbers \[x, y, z\], got 1"),
        ("mass = 2, centre = [1, 2]", MASS, "row 1: centre needs three numbers"),
        ("mass = 2, centre = [1, 2, true]", MASS, "row 1: centre needs a number, got True"),
        ("mass = 2, centre = [1, 2, inf]", MASS, "row 1: centre needs a finite number"),
        ("centre = [1, 2, 3]", "", "row 1 has a centre of mass, but the table mass is missing"),
    ],
)
def test_malformed_centres_of_mass(tmp_path, keys, mass, message):
    path = tmp_path / "arm.toml"
    path.write_text(TABLE.format(keys, mass))
    with pytest.raises(DHTableError, match=message):
        read_dh_table(path)
