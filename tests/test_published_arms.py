"""Known robots generated from published numbers, against what a second source publishes."""

import numpy as np
import pinocchio as pin
import pytest

from ftforce import load_robot
from ftforce.errors import DHTableError
from ftforce.robot.formats.dh import DHRow, DHTable, MassModel, read_dh_table
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


@pytest.mark.parametrize("name", GENERATED)
def test_the_files_are_those_that_ftforce_dh_makes(name):
    table = read_dh_table(robots_folder() / f"{name}.toml")
    assert known_robots()[name].urdf.read_text() == to_urdf(table)
    assert known_robots()[name].srdf.read_text() == to_srdf(table)


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
