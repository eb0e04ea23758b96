"""Every known robot, and every URDF of example-robot-data, against Pinocchio's own reading."""

import os
import subprocess
import sys
from contextlib import contextmanager
from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest

from ftforce import known_robots, load_robot
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL
from ftforce.errors import FtforceError, InputError, URDFError
from ftforce.robot.formats.urdf import read_urdf
from ftforce.robot.kinematics import frame_jacobian
from ftforce.robot.model import full_model, restore_names
from ftforce.robot.posture import choose_posture, is_singular
from ftforce.robot.tip import tip_candidates
from helpers import CAMPAIGN

KNOWN = tuple(known_robots())
FILES = sorted(known_robots()["panda"].urdf.parents[2].rglob("*.urdf"))

UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint",
      "wrist_2_joint", "wrist_3_joint")  # fmt: skip
PR2 = ("shoulder_pan", "shoulder_lift", "upper_arm_roll", "elbow_flex", "forearm_roll",
       "wrist_flex", "wrist_roll")  # fmt: skip
BAXTER = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")


def numbered(name, first, last):
    return tuple(name.format(i) for i in range(first, last + 1))


ARMS = {  # joints along the chain, and their effort limits (N·m, N)
    "dh5": (numbered("joint{}", 1, 5), (150, 150, 80, 40, 20)),
    "panda": (numbered("panda_joint{}", 1, 7), (87, 87, 87, 87, 12, 12, 12)),
    "ur3": (UR, (56, 56, 28, 12, 12, 12)),
    "ur5": (UR, (150, 150, 150, 28, 28, 28)),
    "ur10": (UR, (330, 330, 150, 54, 54, 54)),
    "ur3e": (UR, (56, 56, 28, 12, 12, 12)),
    "ur5e": (UR, (150, 150, 150, 28, 28, 28)),
    "ur10e": (UR, (330, 330, 150, 56, 56, 56)),
    "ur16e": (UR, (330, 330, 150, 56, 56, 56)),
    "iiwa14": (numbered("joint_{}", 1, 7), (320, 320, 176, 176, 110, 40, 40)),
    "fr3": (numbered("fr3_joint{}", 1, 7), (87, 87, 87, 87, 12, 12, 12)),
    "gen3": (numbered("joint_{}", 1, 7), (39, 39, 39, 39, 9, 9, 9)),
    "xarm6": (numbered("joint{}", 1, 6), (50, 50, 32, 32, 32, 20)),
    "sawyer": (numbered("right_j{}", 0, 6), (80, 80, 40, 40, 9, 9, 9)),
    "xarm7": (numbered("joint{}", 1, 7), (50, 50, 30, 30, 30, 20, 20)),
    "kinova": (numbered("j2s6s200_joint_{}", 1, 6), (40, 80, 40, 20, 20, 20)),
    "z1": (numbered("joint{}", 1, 6), (30, 60, 30, 30, 30, 30)),
    "talos_left_arm": (numbered("arm_left_{}_joint", 2, 7), (22.32, 17.86, 17.86, 3, 6.6, 6.6)),
    "baxter_left": (tuple(f"left_{one}" for one in BAXTER), (50, 50, 50, 50, 15, 15, 15)),
    "baxter_right": (tuple(f"right_{one}" for one in BAXTER), (50, 50, 50, 50, 15, 15, 15)),
    "tiago": (
        ("torso_lift_joint", *numbered("arm_{}_joint", 1, 7)),
        (2000, 39, 39, 17.86, 17.86, 3, 6.6, 6.6),
    ),
    "pr2_left": (tuple(f"l_{one}_joint" for one in PR2), (30, 30, 30, 30, 30, 10, 10)),
    "pr2_right": (tuple(f"r_{one}_joint" for one in PR2), (30, 30, 30, 30, 30, 10, 10)),
    "canadarm2": (
        (
            "shoulder_roll",
            "shoulder_yaw",
            "shoulder_pitch",
            "elbow_pitch",
            "wrist_pitch",
            "wrist_yaw",
            "wrist_roll",
        ),
        (2332,) * 7,
    ),
    "so100": (
        ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
        (None, None, None, None, None),
    ),
    "so101": (
        ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
        (None, None, None, None, None),
    ),
}
WITHOUT_MASSES = {"iiwa14"}
SPECIAL = {
    "kinova": {1: "continuous", 4: "continuous", 6: "continuous"},
    "pr2_left": {5: "continuous", 7: "continuous"},
    "pr2_right": {5: "continuous", 7: "continuous"},
    "tiago": {1: "prismatic"},
}


@contextmanager
def silence():
    """Keep what Pinocchio prints off the terminal."""
    saved, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(null)


@lru_cache(maxsize=1)
def reference(path):
    """Return Pinocchio's own model of a file."""
    with silence():
        return pin.buildModelFromUrdf(str(path))


def postures(robot, count=5):
    """Return the default posture and some that are drawn within the limits."""
    lower = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    drawn = np.random.default_rng(7).uniform(lower, upper, (count, robot.n))
    return [choose_posture(robot).q, *drawn]


def whole_configuration(robot, model, q):
    """Return the configuration of the whole robot's model with the rest where it is held."""
    configuration = pin.neutral(model)
    for name, value in [*robot.held.items(), *zip(robot.names, q, strict=True)]:
        joint = model.joints[model.getJointId(name)]
        numbers = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = numbers
    return configuration


def symmetric(upper):
    """Return the matrix of which Pinocchio fills the upper half."""
    return np.triu(upper) + np.triu(upper, 1).T


# ---- the known robots ------------------------------------------------------------------------


@pytest.mark.parametrize("name", KNOWN)
def test_joints_limits_and_ends(name):
    robot, known = load_robot(name), known_robots()[name]
    names, effort = ARMS[name]
    assert robot.names == names
    assert tuple(joint.effort for joint in robot.joints) == effort
    types = ["revolute"] * robot.n
    for number, kind in SPECIAL.get(name, {}).items():
        types[number - 1] = kind
    assert [joint.type for joint in robot.joints] == types
    assert [joint.number for joint in robot.joints] == list(range(1, robot.n + 1))
    assert (robot.name, robot.tip, robot.path) == (name, known.tip, str(known.urdf))
    assert robot.tip_source == f"known robot {name}"
    assert all(joint.velocity for joint in robot.joints)
    assert np.all(robot.lower < robot.upper)
    assert robot.mass == 0.0 if name in WITHOUT_MASSES else robot.mass > 0.4
    assert set(known.postures) <= set(robot.postures)


@pytest.mark.parametrize("name", KNOWN)
def test_limits_are_the_urdfs(name):
    """Effort limits too, unless a correction is told with its reason."""
    robot, known = load_robot(name), known_robots()[name]
    theirs = reference(known.urdf)
    corrected = {correction.joint for correction in known.corrections}
    for joint in robot.joints:
        row = theirs.joints[theirs.getJointId(joint.name)]
        if joint.type != "continuous":
            assert theirs.lowerPositionLimit[row.idx_q] == joint.lower
            assert theirs.upperPositionLimit[row.idx_q] == joint.upper
        assert theirs.upperVelocityLimit[row.idx_v] == joint.velocity
        if joint.name in corrected:
            assert theirs.upperEffortLimit[row.idx_v] != joint.effort
            assert any(joint.name in note for note in robot.notes)
        else:
            assert theirs.upperEffortLimit[row.idx_v] == joint.effort
    assert corrected <= set(robot.names)


@pytest.mark.parametrize("name", KNOWN)
def test_the_default_posture_is_the_registrys_and_good(name):
    robot = load_robot(name)
    posture = choose_posture(robot)
    assert posture.source == f"posture '{known_robots()[name].posture}'"
    assert posture.warnings == ()
    assert np.all(posture.q >= robot.lower)
    assert np.all(posture.q <= robot.upper)
    assert not is_singular(robot, posture.q)
    s = np.linalg.svd(frame_jacobian(robot, posture.q), compute_uv=False)
    assert s[-1] > BORDERLINE_RTOL * s[0], "with room to spare for wrenches"


@pytest.mark.parametrize("name", KNOWN)
def test_jacobians_are_pinocchios_with_the_rest_held(name):
    """The whole robot, as Pinocchio itself reads it, moves its tip in the same way."""
    robot = load_robot(name)
    model = reference(known_robots()[name].urdf)
    data = model.createData()
    frame = model.getFrameId(robot.tip, pin.FrameType.BODY)
    columns = [model.joints[model.getJointId(name)].idx_v for name in robot.names]
    for q in postures(robot):
        configuration = whole_configuration(robot, model, q)
        for axes, frame_axes in (("tool", pin.LOCAL), ("world", pin.LOCAL_WORLD_ALIGNED)):
            J = pin.computeFrameJacobian(model, data, configuration, frame, frame_axes)
            np.testing.assert_allclose(frame_jacobian(robot, q, axes), J[:, columns], atol=1e-12)


@pytest.mark.parametrize("name", KNOWN)
def test_gravity_and_inertia_are_pinocchios_with_the_rest_held(name):
    """So masses and inertias of everything that hangs on the chain are there."""
    robot = load_robot(name)
    model = reference(known_robots()[name].urdf)
    q = choose_posture(robot).q
    configuration = whole_configuration(robot, model, q)
    columns = [model.joints[model.getJointId(name)].idx_v for name in robot.names]
    theirs = pin.computeGeneralizedGravity(model, model.createData(), configuration)[columns]
    ours = pin.computeGeneralizedGravity(robot.model, robot.data, robot.to_model(q))
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    theirs = symmetric(pin.crba(model, model.createData(), configuration))
    ours = symmetric(pin.crba(robot.model, robot.data, robot.to_model(q)))
    np.testing.assert_allclose(ours, theirs[np.ix_(columns, columns)], atol=1e-9)


PAIRS = (("baxter_left", "baxter_right"), ("pr2_left", "pr2_right"))


@pytest.mark.parametrize("name", sorted({*KNOWN}.difference(*PAIRS)))
def test_a_file_has_the_tip_of_the_known_robot(name):
    """The same question, asked with a name and with a path, is about the same tool."""
    known = known_robots()[name]
    by_path = load_robot(known.urdf)
    assert (by_path.tip, by_path.names) == (known.tip, load_robot(name).names)


@pytest.mark.parametrize("names", PAIRS)
def test_a_file_with_two_arms_is_a_question_answered_first_by_their_tips(names):
    first, second = (known_robots()[name] for name in names)
    with pytest.raises(InputError, match=r"which tip\?") as caught:
        load_robot(first.urdf)
    candidates = str(caught.value).partition("(--tip): ")[2].split(", ")
    assert {one.split(" (")[0] for one in candidates[:2]} == {first.tip, second.tip}


DOCUMENTED = {  # files beside those of the known robots: tip and number of joints
    "anymal-kinova": ("j2s6s200_end_effector", 6),
    "b1-z1": ("gripperStator", 6),
    "panda_collision": ("panda_hand_tcp", 7),
    "tiago_no_hand": ("wrist_ft_tool_link", 8),
    "ur10_joint_limited_robot": ("tool0", 6),
    "ur5_gripper": ("tool0", 6),
}


@pytest.mark.parametrize("name", DOCUMENTED)
def test_the_tool_frame_that_the_maker_documents(name):
    found = load_robot(next(path for path in FILES if path.stem == name))
    assert (found.tip, found.n) == DOCUMENTED[name]


# ---- every file ------------------------------------------------------------------------------


def attempt(path):
    """Return the robot of a file and the error, one of which is ``None``."""
    try:
        return load_robot(path), None
    except FtforceError as error:
        return None, error


@pytest.mark.parametrize("path", FILES, ids=lambda path: "/".join(path.parts[-3:]))
def test_every_urdf_loads_or_fails_clearly(path):
    robot, error = attempt(path)
    if robot is None:
        assert isinstance(error, (URDFError, InputError))
        assert str(path) in str(error)
        assert "\n" not in str(error)
    else:
        J = frame_jacobian(robot, choose_posture(robot).q)
        assert J.shape == (6, robot.n)
        assert np.isfinite(J).all()
        assert np.linalg.norm(J[:3]) > 0.0


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("baxter", "several moving parts at the link 'torso'; choose a tip"),
        ("iris_simple", "no movable joint below the link 'iris__base_link'"),
        ("ur3", "contains no <link>"),
    ],
)
def test_why_some_urdfs_do_not_load(name, reason):
    path = next(path for path in FILES if path.stem == name)
    with pytest.raises(FtforceError, match=reason):
        load_robot(path)


def test_malformed_fingers_matter_only_to_a_finger():
    path = next(path for path in FILES if path.stem == "alex_psyonic_hands")
    arm = load_robot(path, tip="LeftPsyonicAbilityBaseLink")
    lost = "joint 'Left_index_q2' mimics 'index_q1', which does not exist; did you"
    assert arm.n == 10
    assert any(
        note.startswith(f"ignored, as it lies outside the chain: {lost}") for note in arm.notes
    )
    with pytest.raises(URDFError, match=lost):
        load_robot(path, tip="Left_index_L2")


READABLE = [path for path in FILES if path.name not in {"ur3.urdf", "alex_psyonic_hands.urdf"}]


@pytest.mark.no_cover
@pytest.mark.thorough
@pytest.mark.parametrize("path", READABLE, ids=lambda path: "/".join(path.parts[-3:]))
def test_every_tip_candidate_can_be_chosen(path):
    tips = tip_candidates(read_urdf(path))
    for tip, count in list(tips.items())[:: 1 if CAMPAIGN else max(1, len(tips) - 1)]:
        robot = load_robot(path, tip=tip)
        assert robot.tip == tip
        assert robot.n + sum(len(joint.followers) for joint in robot.joints) >= count


@pytest.mark.parametrize(
    "path", [*READABLE, known_robots()["dh5"].urdf], ids=lambda path: "/".join(path.parts[-3:])
)
def test_the_stripped_model_is_pinocchios(path):
    """What we write anew from what we checked is the robot that the file describes.

    A fixed joint and a link of one name are told apart (``restore_names``).
    """
    tree = read_urdf(path)
    theirs, ours = reference(path), full_model(tree)
    restore_names(ours, tree)
    assert sorted(ours.names) == sorted(theirs.names)
    for frame in theirs.frames:
        if frame.type == pin.FrameType.FIXED_JOINT and frame.name in tree.links:
            frame.name += "_joint"
    frames = [sorted((frame.name, str(frame.type)) for frame in model.frames)
              for model in (ours, theirs)]  # fmt: skip
    assert frames[0] == frames[1]
    for i, name in enumerate(ours.names):
        j = theirs.getJointId(name)
        assert ours.joints[i].shortname() == theirs.joints[j].shortname()
        assert ours.names[ours.parents[i]] == theirs.names[theirs.parents[j]]
        np.testing.assert_allclose(
            ours.jointPlacements[i].homogeneous, theirs.jointPlacements[j].homogeneous, atol=1e-14
        )
        np.testing.assert_allclose(
            ours.inertias[i].toDynamicParameters(),
            theirs.inertias[j].toDynamicParameters(),
            atol=1e-12,
        )


def test_nothing_is_printed_by_the_way():
    """Pinocchio's library writes on stderr; a fresh process shows whether it gets through."""
    program = (
        "import sys\nfrom pathlib import Path\nimport ftforce\n"
        "for path in sys.argv[1:]:\n"
        "    try:\n        ftforce.load_robot(Path(path))\n"
        "    except ftforce.FtforceError:\n        pass\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, FILES)],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
