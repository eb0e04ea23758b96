"""Files that were answered wrongly once, as they came, with the values that are right.

What was wrong with each kind has tests of its own; here the whole way is gone, from the file to the
answer. The arms are simple enough for closed forms.
"""

import json

import numpy as np
import pinocchio as pin
import pytest
from test_kinematics import LEAD_SCREW

import ftforce
from ftforce.core.limits import Limits
from ftforce.robot.kinematics import tip_pose
from ftforce.trajectory import Path
from test_cli import run
from urdfs import load, write

BODY = (
    '<inertial><origin xyz="0 0 0.2"/><mass value="2"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
)
STEPS = ("0 0 0.3", "0 0 0.1", "0 0 0.5", "0 0 0.4", "0 0.1 0", "0 0 0.1")
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
CHAIN = ("a1", "a2", "a3", "a4", "a5", "a6")


def body(name, inner=BODY):
    return f'<link name="{name}">{inner}</link>'


def fixed(name, parent, child, xyz):
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/></joint>'
    )


def moving(name, parent, child, xyz, axis, *, kind="revolute", low=-2, high=2, effort=80):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" effort="{effort}" velocity="1"/></joint>'
    )


def six(*more, effort=80, head='<robot name="arm">'):
    """Return the arm of six joints that most of the files have in common."""
    links = [body("base", ""), *(body(f"l{i}") for i in range(1, 7))]
    parents = ("base", "l1", "l2", "l3", "l4", "l5")
    joints = [
        moving(f"a{i}", parent, f"l{i}", xyz, axis, effort=effort)
        for i, (parent, xyz, axis) in enumerate(zip(parents, STEPS, AXES, strict=True), 1)
    ]
    return "\n".join([head, *links, *joints, *more, "</robot>"])


def finger(name, child, axis, low, high):
    return moving(name, "hand", child, "0 0.06 0", axis, kind="prismatic", low=low, high=high)


FILES = {
    # content, tip, its position with all joints at zero, words of a note
    "blank_before_declaration": (
        '\n<?xml version="1.0"?>\n' + six(), "l6", (0, 0.1, 1.4),
        "XML declaration is not at the start",
    ),
    "latin1_declared": (
        ('<?xml version="1.0" encoding="ISO-8859-1"?>\n<!-- Länge in m -->\n' + six())
        .encode("latin-1"),
        "l6", (0, 0.1, 1.4), "iso-8859-1 text",
    ),
    "xacro_property_left": (
        six('<xacro:property name="thickness" value="0.01"/>',
            head='<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'),
        "l6", (0, 0.1, 1.4), "remains of xacro",
    ),
    "effort_2000_everywhere": (six(effort=2000), "l6", (0, 0.1, 1.4), "all 6 are 2000 N·m"),
    "two_tool_frames": (
        six(body("tool0", ""), body("ee_link", ""), fixed("t1", "l6", "tool0", "0 0.09 0"),
            fixed("t2", "l6", "ee_link", "0 0.09 0")),
        "tool0", (0, 0.19, 1.4), "",
    ),
    "counterweight_branch": (
        six(body("spring_body"), moving("s1", "l1", "spring_body", "-0.2 0 0", "0 1 0"),
            body("spring_rod"),
            moving("s2", "spring_body", "spring_rod", "0 0 0.3", "0 0 1", kind="prismatic", low=0,
                   high=0.04),
            body("tool0", ""), fixed("t", "l6", "tool0", "0 0.08 0")),
        "tool0", (0, 0.18, 1.4), "",
    ),
    "one_jaw": (
        six(body("gripper"), fixed("h", "l6", "gripper", "0 0.05 0"), body("grasp_frame", ""),
            fixed("t", "gripper", "grasp_frame", "0 0.1 0"), body("jaw"),
            moving("jaw_joint", "gripper", "jaw", "0.02 0.03 0", "0 0 1")),
        "grasp_frame", (0, 0.25, 1.4), "",
    ),
    "swapped_limits_outside": (
        six(body("hand"), fixed("h", "l6", "hand", "0 0.05 0"), body("fl"), body("fr"),
            finger("f1", "fl", "1 0 0", 0, 0.04), finger("f2", "fr", "-1 0 0", 0.04, 0)),
        "hand", (0, 0.15, 1.4), "'f2': lower limit 0.04 exceeds upper limit 0",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "tip", "x", "note"), FILES.values(), ids=FILES)
def test_the_arm_that_was_meant(tmp_path, content, tip, x, note):
    path = str(write(tmp_path, content))
    robot = ftforce.load_robot(path)
    assert (robot.names, robot.tip) == (CHAIN, tip)
    np.testing.assert_allclose(tip_pose(robot, np.zeros(6))[1], x, atol=1e-12)
    assert note in " ".join(run("inspect", path).stdout.split())
    assert next(iter(robot.tips)) == tip  # before the fingers
    census = json.loads(run("census", path, "--format", "json").stdout)
    assert len(census["sets"]) == 6


PLANAR = """<robot name="planar2"><link name="base"/>{0}{1}<link name="tip"/>{2}{3}{4}</robot>"""
HALF = (
    '<inertial><mass value="2"/><origin xyz="0.5 0 0"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def test_infinite_efforts_are_unknown(tmp_path):
    """`cont_inf.urdf`: stretched out along x, 2 kg at 0.5 m and 1.5 m, and a load at 2 m."""
    turn = {"kind": "continuous", "low": "-Inf", "high": "Inf", "effort": "Inf"}
    path = str(
        write(
            tmp_path,
            PLANAR.format(
                body("l1", HALF),
                body("l2", HALF),
                moving("shoulder", "base", "l1", "0 0 0", "0 1 0", **turn),
                moving("elbow", "l1", "l2", "1 0 0", "0 1 0", **turn),
                fixed("f", "l2", "tip", "1 0 0"),
            ),
        )
    )
    robot = ftforce.load_robot(path)
    assert [joint.effort for joint in robot.joints] == [None, None]
    assert np.isinf(robot.lower).all()
    told = " ".join(run("inspect", path).stdout.split())
    assert "effort limits that count as unknown: shoulder inf, elbow inf" in told
    found = ftforce.analyze(robot, [0.0, 0.0], force=[10.0], task="fz", axes="world")
    # About y a positive torque lowers the tip.
    np.testing.assert_allclose(found.rnea.gravity, -2.0 * 9.81 * np.array([0.5 + 1.5, 0.5]))
    np.testing.assert_allclose(found.torque.before, [-20.0, -10.0])


def test_a_joint_that_cannot_move_is_no_joint(tmp_path):
    """`disguised_anchor.urdf`: a revolute joint from 0 to 0 between the world and the mount."""
    arm = "".join([
        '<robot name="rov_arm">', body("world", ""), body("mount"), *map(body, ("l1", "l2", "l3")),
        body("tip", ""),
        moving("anchor", "world", "mount", "0 0 1", "0 1 0", low=0, high=0, effort=0),
        moving("a1", "mount", "l1", "0 0 0.1", "0 0 1"),
        moving("a2", "l1", "l2", "0.1 0 0", "0 1 0"), moving("a3", "l2", "l3", "0.5 0 0", "0 1 0"),
        fixed("t", "l3", "tip", "0.4 0 0"), "</robot>",
    ])  # fmt: skip
    robot = load(tmp_path, arm)
    assert robot.names == ("a1", "a2", "a3")
    np.testing.assert_allclose(tip_pose(robot, np.zeros(3))[1], [1.0, 0.0, 1.1], atol=1e-12)
    assert any("anchor at 0" in note for note in robot.notes)


@pytest.mark.parametrize("low", ["0", "-1e6"])
def test_a_rail_without_an_end_stays_here(tmp_path, low):
    """`halfopen.urdf`, `fullopen.urdf`: no posture at 5,000 m, no workspace of 1e10 m³."""
    arm = "".join([
        '<robot name="lift">', body("base", ""), *map(body, ("car", "arm", "arm2")),
        body("tip", ""),
        moving("rail", "base", "car", "0 0 0", "1 0 0", kind="prismatic", low=low, high="1e6",
               effort=500),
        moving("pan", "car", "arm", "0 0 0", "0 0 1", effort=60),
        moving("lift", "arm", "arm2", "0.6 0 0", "0 1 0", effort=60),
        fixed("f", "arm2", "tip", "0.5 0 0"), "</robot>",
    ])  # fmt: skip
    path = str(write(tmp_path, arm))
    robot = ftforce.load_robot(path)
    assert abs(ftforce.analyze(robot).posture.q[0]) < 10.0
    assert "position limits that count as none" in " ".join(run("inspect", path).stdout.split())
    told = " ".join(run("sweep", path, "--samples", "500", status=1).output.split())
    assert (
        "no upper position limit; add it" if low == "0" else "no position limits; add them"
    ) in told


# ---- nothing to keep -------------------------------------------------------------------------

QUOTED = [
    "simulate", "dh5", "--posture", "paper", "--to", "0.5,0.6,0.35", "--speed", "0.1",
    "--task", "fz", "--axes", "world", "--force", "10", "--fault", "3@0",
]  # fmt: skip


def levers():
    """Return the levers of fz at the start, from Pinocchio: only joint 3 has one."""
    robot = ftforce.load_robot("dh5")
    q = robot.to_model(robot.postures["paper"])
    data = robot.model.createData()
    J = (
        pin.computeFrameJacobian(robot.model, data, q, robot.tip_frame, pin.LOCAL_WORLD_ALIGNED)
        @ robot.coordinates.G
    )
    return J[2]


def test_a_task_that_only_the_locked_joint_served(tmp_path):
    """36,294,262 N with joint 1 free, too; with --limits urdf 10 N were said to be kept."""
    J = np.abs(levers())
    assert np.delete(J, 2).max() < 1e-9 * J[2]
    for more in (["--fault", "free:1@0", "--no-remap"], ["--limits", "urdf"], ["--delay", "0.5"]):
        file = str(tmp_path / "run.npz")
        run(*QUOTED, "--rate", "100", *more, "-o", file)
        history = ftforce.load_history(file)
        for name, one in history.runs.items():
            if name != "healthy":
                assert abs(float(one.force[0, 0])) < 1e-6
                assert abs(float(one.jump[0, 0])) == pytest.approx(10.0)
                assert one.verdicts[0] == "not tolerated"
                assert np.abs(one.jump).max() < 10.0 + 1e-6  # nowhere more than there was
    robot = ftforce.load_robot("dh5")
    analysis = ftforce.analyze(
        robot, posture="paper", locked=3, force=[10.0], task="fz", axes="world", limits="urdf"
    )
    assert not analysis.force.after.any()


# ---- a wrapped recording ---------------------------------------------------------------------


def test_a_wrapped_recording_is_the_unwrapped_one(tmp_path):
    """`ur5_wrapped.csv`: six joints at constant speed need the weight's torques, not 591 N·m."""
    robot, t = ftforce.load_robot("ur5"), np.arange(200) / 50.0
    speed = np.array([0.1, 0.05, 0.0, 0.0, 0.0, 0.4])
    q = np.array([0.3, -1.2, 1.4, -1.0, -1.5, 2.6]) + t[:, None] * speed
    wrapped = np.where(q > np.pi, q - 2.0 * np.pi, q)
    assert np.ptp(wrapped[:, 5]) > 6.0
    model, data, G = robot.model, robot.model.createData(), robot.coordinates.G
    wanted = np.array(
        [pin.rnea(model, data, robot.to_model(x), G @ speed, 0.0 * speed) @ G for x in q]
    )
    for name, x in (("wrapped", wrapped), ("unwrapped", q)):
        path = tmp_path / f"{name}.csv"
        rows = [",".join(f"{value:.10g}" for value in row) for row in np.column_stack([t, x])]
        path.write_text("\n".join([f"t,{','.join(robot.names)}", *rows]))
        history = ftforce.simulate(robot, path, force=[0, 0, 10])
        at = np.searchsorted(t, history.t)
        np.testing.assert_allclose(history.healthy.rnea, wanted[at], atol=1e-4)
        shown = " ".join(run("timeline", "ur5", str(path), "--rate", "5").stdout.split())
        assert ("wrist_3_joint (at line 70)" in shown) == (name == "wrapped")
        assert "Tolerated" in shown


# ---- what is held, and what is reached -------------------------------------------------------


def test_what_the_arm_lacks_can_be_held_but_not_commanded():
    """Five joints and a wrench: no motor torque makes +fx alone, but the arm resists it."""
    robot = ftforce.load_robot("so101")
    found = ftforce.capability(robot, task="wrench", axes="world", limits=Limits.of([3.0] * 5))
    q, data, G = (
        robot.to_model(found.analysis.posture.q),
        robot.model.createData(),
        robot.coordinates.G,
    )
    weight = pin.computeGeneralizedGravity(robot.model, data, q) @ G
    J = pin.computeFrameJacobian(robot.model, data, q, robot.tip_frame, pin.LOCAL_WORLD_ALIGNED) @ G
    assert np.linalg.matrix_rank(J, 1e-6) == 5
    (fx,) = (d for d in found.directions if d.name == "+fx")
    room = np.where(J[0] > 0.0, 3.0 - weight, 3.0 + weight)
    assert fx.before["commanded"].maximum == 0.0
    assert fx.before["held"].maximum == pytest.approx((room / np.abs(J[0])).min())


def test_a_lead_screw_reaches_as_far_as_it_turns(tmp_path):
    """A slide that follows a screw, 0.01 m per rad: the bound was 0.1 m, with the tip at 0.91 m."""
    robot = load(tmp_path, LEAD_SCREW, tip="tip")
    there = Path.through([(0.4, 0, 0), (0.91, 0, 0)], speed=0.009)
    history = ftforce.simulate(robot, there, [30.0], task="fx", force=[1.0], rate=1)
    np.testing.assert_allclose(history.healthy.position[-1], [0.91, 0.0, 0.0], atol=1e-6)
    swept = ftforce.to_dict(ftforce.sweep(robot, n=64, task="fx"))["workspace"]
    assert swept["outside"] == 0
    assert swept["visited_cells"] * swept["edge"] == pytest.approx(0.9, abs=2.0 * swept["edge"])
