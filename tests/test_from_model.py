"""Robots of Pinocchio models: the numbers of Pinocchio itself, and those of the URDF behind it."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import ftforce
from ftforce import Robot, known_robots, load_robot
from ftforce.errors import InputError, UnknownNameError, URDFError
from ftforce.robot.dynamics import mass_matrix, motion_torque, weight_torque
from ftforce.robot.kinematics import frame_jacobian

RNG = np.random.default_rng(3)
LINK = pin.Inertia(1.3, np.array([0.02, -0.05, 0.1]), np.diag([0.02, 0.03, 0.025]))
UP = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.4, 0.3), np.array([0.1, 0.05, 0.3]))
AXIS = np.array([0.6, 0.0, 0.8])


def add(model, parent, joint, name, tip=""):
    """Add a joint with a body, and a frame for a tool."""
    i = model.addJoint(parent, joint, UP, name)
    model.appendBodyToJoint(i, LINK, pin.SE3.Identity())
    if tip:
        model.addFrame(pin.Frame(tip, i, 0, UP, pin.FrameType.OP_FRAME))
    return i


def arm_on(joint):
    """Return a model: an arm of four joints on a joint, beside which another hangs."""
    model = pin.Model()
    model.name = "made"
    base = add(model, 0, joint, "root")
    last = add(model, base, pin.JointModelRevoluteUnaligned(AXIS), "turn")
    last = add(model, last, pin.JointModelRUBY(), "endless")
    last = add(model, last, pin.JointModelPrismaticUnaligned(AXIS), "slide")
    last = add(model, last, pin.JointModelRZ(), "wrist", "tool")
    return model


def directly(model, tip, joints, motion):
    """Return Jacobian, weight, rnea and mass matrix of joints, by Pinocchio called directly."""
    data, (q, v, a) = model.createData(), motion
    frame = model.getFrameId(tip)
    v_index = [model.joints[model.getJointId(name)].idx_v for name in joints]
    full = {"q": q, "v": np.zeros(model.nv), "a": np.zeros(model.nv)}
    full["v"][v_index], full["a"][v_index] = v, a
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
    weight = pin.computeGeneralizedGravity(model, data, q).copy()
    tau = pin.rnea(model, data, *full.values())
    M = pin.crba(model, data, q) - np.diag(model.armature)
    tau = tau - model.armature * full["a"]
    return J[:, v_index], weight[v_index], tau[v_index], M[np.ix_(v_index, v_index)]


def configuration(model, robot, q):
    """Return a configuration of a model with the joints of an arm at ``q``, others neutral."""
    full = pin.neutral(model)
    for name, x in zip(robot.names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        own = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        full[joint.idx_q : joint.idx_q + joint.nq] = own
    return full


def model_of(name):
    """Return the whole model of a known robot's URDF."""
    return pin.buildModelFromUrdf(str(known_robots()[name].urdf))


MODELS = {
    "manipulator": (pin.buildSampleModelManipulator(), "effector_body"),
    "panda": (model_of("panda"), "panda_hand_tcp"),
    "tiago": (model_of("tiago"), known_robots()["tiago"].tip),
    "free-flyer": (arm_on(pin.JointModelFreeFlyer()), "tool"),
    "planar": (arm_on(pin.JointModelPlanar()), "tool"),
}


@pytest.mark.parametrize(("model", "tip"), MODELS.values(), ids=MODELS)
def test_the_same_numbers_as_pinocchio(model, tip):
    model = model.copy()
    model.armature[:] = 0.1
    model.gravity.linear = np.array([0.5, -1.0, -3.7])
    robot = Robot.from_model(model, tip=tip)
    low, high = robot.ranges
    q, v, a = RNG.uniform(low, high), RNG.normal(size=robot.n), RNG.normal(size=robot.n)
    full = configuration(model, robot, q)
    J, weight, tau, M = directly(model, tip, robot.names, (full, v, a))
    np.testing.assert_allclose(frame_jacobian(robot, q), J, atol=1e-12)
    np.testing.assert_allclose(weight_torque(robot, q), weight, atol=1e-12)
    np.testing.assert_allclose(motion_torque(robot, q, v, a) + weight, tau, atol=1e-11)
    np.testing.assert_allclose(mass_matrix(robot, q), M, atol=1e-12)
    assert robot.armature.tolist() == [0.1] * robot.n
    assert any("gravity is that of the model" in note for note in robot.notes)


def numbers_in(content):
    """Yield all numbers of a JSON document."""
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        for one in content:
            yield from numbers_in(one)
    elif isinstance(content, (int, float)):
        yield content


@pytest.mark.parametrize("name", ["panda", "xarm7", "talos_left_arm", "kinova", "tiago"])
def test_the_same_arm_as_of_the_urdf(name):
    known = known_robots()[name]
    arm = load_robot(known.urdf, tip=known.tip)
    robot = pickle.loads(pickle.dumps(Robot.from_model(model_of(name), tip=known.tip)))
    for key in ("name", "names", "tip", "base", "fixed"):
        assert getattr(robot, key) == getattr(arm, key), key
    for key in ("lower", "upper", "effort", "friction", "damping"):
        np.testing.assert_array_equal(getattr(robot, key), getattr(arm, key), key)
    q = RNG.uniform(*arm.ranges)
    results = [ftforce.analyze(r, locked=[2, 4], force=[5, 2, 1], q=q) for r in (robot, arm)]
    one, other = ([*numbers_in(ftforce.to_dict(result))] for result in results)
    assert len(one) > 50
    np.testing.assert_allclose(one, other, atol=1e-9)


def test_the_tip_is_chosen_as_in_the_urdf():
    assert Robot.from_model(model_of("panda")).tip == load_robot(known_robots()["panda"].urdf).tip
    robot = Robot.from_model(model_of("panda"), tip="panda_joint8", base="panda_link2")
    assert (robot.tip, robot.base, robot.n) == ("panda_joint8", "panda_link2", 5)
    with pytest.raises(UnknownNameError, match="did you mean 'panda_hand_tcp'"):
        Robot.from_model(model_of("panda"), tip="panda_hand_tpc")


def test_joints_of_several_degrees_of_freedom_outside_the_chain_are_held():
    model = arm_on(pin.JointModelRX())
    wrist = model.getJointId("wrist")
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX())
    composite.addJoint(pin.JointModelPY())
    for name, joint in {
        "ball": pin.JointModelSpherical(),
        "cross": pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
        "several": composite,
        "screw": pin.JointModelHZ(0.1),
    }.items():
        add(model, wrist, joint, name, f"{name}_tool")
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    robot = Robot.from_model(model, tip="tool", posture=q)
    chain = [model.joints[model.getJointId(name)].idx_v for name in robot.names]
    expected = pin.computeGeneralizedGravity(model, model.createData(), q)[chain]
    given = robot.postures["given"]
    np.testing.assert_allclose(weight_torque(robot, given), expected, atol=1e-12)
    assert sum("no single motor" in note for note in robot.notes) == 4
    for name, kind in {"ball": "Spherical", "cross": "Universal", "several": "Composite"}.items():
        with pytest.raises(URDFError, match=f"joint '{name}' is of type {kind}"):
            Robot.from_model(model, tip=f"{name}_tool")
    with pytest.raises(URDFError, match="joint 'screw' is of type H"):
        Robot.from_model(model, tip="screw_tool")


def test_postures_are_reference_configurations():
    model = arm_on(pin.JointModelFreeFlyer())
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    model.referenceConfigurations["stand"] = q
    robot = Robot.from_model(model, tip="tool", posture="stand")
    full = configuration(model, robot, robot.postures["stand"])
    full[:7] = q[:7]  # the free-flyer is held there, too
    np.testing.assert_allclose(full, q, atol=1e-12)
    J = directly(model, "tool", robot.names, (q, np.zeros(4), np.zeros(4)))[1]
    np.testing.assert_allclose(weight_torque(robot, robot.postures["stand"]), J, atol=1e-12)
    with pytest.raises(UnknownNameError, match="available: stand"):
        Robot.from_model(model, tip="tool", posture="sit")


def test_mimic_joints_follow():
    urdf = known_robots()["panda"].urdf.read_text()
    mimic = '<mimic joint="panda_joint2" multiplier="-0.5" offset="0.1"/></joint>'
    head, tail = urdf.split('<joint name="panda_joint4" type="revolute">')
    own, tail = tail.split("</joint>", 1)
    urdf = f'{head}<joint name="panda_joint4" type="revolute">{own}{mimic}{tail}'
    model = pin.buildModelFromXML(urdf, mimic=True)
    robot = Robot.from_model(model, tip="panda_hand_tcp")
    assert robot.n == 6
    assert robot.joints[1].followers == ("panda_joint4",)
    q = RNG.uniform(*robot.ranges)
    full = np.concatenate([q, np.zeros(model.nq - 6)])
    data, frame = model.createData(), model.getFrameId("panda_hand_tcp")
    J = pin.computeFrameJacobian(model, data, full, frame, pin.LOCAL)[:, :6]
    np.testing.assert_allclose(frame_jacobian(robot, q), J, atol=1e-12)
    weight = pin.rnea(model, data, full, np.zeros(model.nv), np.zeros(model.nv))[:6]
    np.testing.assert_allclose(weight_torque(robot, q), weight, atol=1e-12)


@pytest.mark.parametrize("part", ["inertias", "jointPlacements"])
def test_numbers_that_are_not_finite_matter_in_the_chain(part):
    model = model_of("panda")
    finger = model.getJointId("panda_finger_joint1")
    if part == "inertias":
        model.inertias[finger] = pin.Inertia(np.nan, np.zeros(3), np.eye(3))
    else:
        model.jointPlacements[finger] = pin.SE3(np.eye(3), np.array([np.nan, 0, 0]))
    robot = Robot.from_model(model, tip="panda_link8")
    assert any("outside the chain" in note and "not finite" in note for note in robot.notes)
    with pytest.raises(URDFError, match=r"Pinocchio model 'panda': .* is not finite"):
        Robot.from_model(model, tip="panda_leftfinger")


def test_effort_limits():
    model = model_of("panda")
    given = {"panda_joint1": 50.0, "panda_joint3": None, "panda_joint4": np.inf}
    robot = Robot.from_model(model, tip="panda_link8", limits=given)
    assert [joint.effort for joint in robot.joints] == [50.0, 87.0, None, None, 12.0, 12.0, 12.0]
    robot = Robot.from_model(model, tip="panda_link8", limits=np.arange(1.0, 8.0))
    assert robot.effort.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    bare = arm_on(pin.JointModelRX())  # limits of Pinocchio's largest number
    assert not any(j.effort or j.velocity for j in Robot.from_model(bare, tip="tool").joints)


def with_gravity(gravity):
    model = model_of("panda")
    model.gravity.linear = np.array(gravity)
    return model


REFUSED = {
    "gravity": (with_gravity([0, 0, np.nan]), {}, "its gravity is not finite"),
    "no model": ("panda", {}, "a pinocchio.Model is needed, got str"),
    "wrapper": (pin.RobotWrapper(model_of("panda")), {}, r"got RobotWrapper; pass its \.model"),
    "short": (model_of("panda"), {"posture": [1.0]}, "is a name or a configuration of 9 numbers"),
    "text": (model_of("panda"), {"posture": ["a"] * 9}, "a configuration of 9 numbers"),
    "unnormalized": (arm_on(pin.JointModelFreeFlyer()), {"posture": np.ones(12)}, "normalized"),
    "few": (model_of("panda"), {"limits": [1.0]}, "or one per joint of panda_joint1"),
    "negative": (model_of("panda"), {"limits": {"panda_joint1": -1}}, "must be positive, got -1"),
    "joint": (model_of("panda"), {"limits": {"panda_joint": 1}}, "unknown joint 'panda_joint'"),
    "empty": (pin.Model(), {}, "no movable joint"),
}


@pytest.mark.parametrize(("model", "options", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_malformed_is_one_clear_line(model, options, message):
    with pytest.raises(InputError, match=message):
        Robot.from_model(model, **options)
