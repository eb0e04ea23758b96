"""MJCF files, compared with MuJoCo itself: frames, weight, masses, limits and what is refused."""

import mujoco
import numpy as np
import pytest
from mjcf_arms import ARMS

from ftforce import load_robot
from ftforce.robot.dynamics import mass_matrix, weight_torque
from ftforce.robot.kinematics import frame_jacobian, tip_pose

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
