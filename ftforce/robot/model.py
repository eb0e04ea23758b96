"""Pinocchio model of a chain, built from a checked tree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import read_only
from ftforce.errors import URDFError
from ftforce.robot.chain import Follower
from ftforce.robot.coordinates import Coordinates
from ftforce.robot.stderr import captured_stderr

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.robot.chain import Chain
    from ftforce.robot.formats.tree import UrdfTree


def reduced_model(chain: Chain, held: Mapping[str, float]) -> pin.Model:
    """Return the model with all joints outside the chain fixed, named by codes (`UrdfTree.to_xml`).

    Parameters
    ----------
    chain :
        The chain, whose joints remain movable.
    held :
        Positions of the fixed joints, rad or m, by name.
    """
    full = full_model(chain.tree)
    codes = chain.tree.joint_codes()
    q = pin.neutral(full)  # floating and planar joints stay at their neutral pose
    for name, value in held.items():
        joint = full.joints[full.getJointId(codes[name])]
        if joint.nq == 1:
            q[joint.idx_q] = value
        else:
            q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    moving = {codes[name] for name in chain.moving}
    fixed = [i for i, code in enumerate(full.names.tolist()) if i and code not in moving]
    model = pin.buildReducedModel(full, fixed, q)
    if chain.tree.gravity is not None:
        model.gravity.linear = np.array(chain.tree.gravity)
    return model


def full_model(tree: UrdfTree) -> pin.Model:
    """Return the Pinocchio model of the whole tree, named by codes (`UrdfTree.to_xml`).

    Raises
    ------
    URDFError
        Pinocchio rejects the URDF although it passed the checks.
    """
    try:
        with captured_stderr() as printed:
            return pin.buildModelFromXML(tree.to_xml())
    except (ValueError, RuntimeError) as problem:
        reason = " ".join(f"{printed} {problem}".split())
        raise URDFError(tree.path, f"Pinocchio rejects the URDF: {reason}") from None


def restore_names(model: pin.Model, tree: UrdfTree) -> None:
    """Replace the codes from `UrdfTree.to_xml` in a model by the names of the URDF, in place.

    A link keeps its name: the frame of a fixed joint that has the same one is called
    ``NAME_joint``, so that Pinocchio finds the link's frame without its type and can reduce the
    model.

    Parameters
    ----------
    model :
        Pinocchio model named by codes.
    tree :
        Contents of the URDF.
    """
    codes = (*tree.link_codes().items(), *tree.joint_codes().items())
    names = {code: name for name, code in codes}
    model.name = tree.name
    for i in range(1, model.njoints):
        model.names[i] = names[model.names[i]]
    for frame in model.frames:
        frame.name = names.get(frame.name, frame.name)
    taken = {*model.names.tolist(), *(frame.name for frame in model.frames)}
    for frame in model.frames:
        if frame.type == pin.FrameType.FIXED_JOINT and frame.name in tree.links:
            while frame.name in taken:
                frame.name += "_joint"
            taken.add(frame.name)


def coordinates_of(chain: Chain, model: pin.Model) -> Coordinates:
    """Return the map from the chain's joint positions to a model named by codes.

    Parameters
    ----------
    chain :
        The chain.
    model :
        Its Pinocchio model, from `reduced_model`.
    """
    codes = chain.tree.joint_codes()
    G = np.zeros((model.nv, len(chain.leaders)))
    offset = np.zeros(model.nv)
    for column, leader in enumerate(chain.leaders):
        moved = [Follower(leader.name, 1.0, 0.0), *chain.followers[leader.name]]
        for joint in moved:
            if joint.name in chain.moving:
                row = model.joints[model.getJointId(codes[joint.name])].idx_v
                G[row, column], offset[row] = joint.multiplier, joint.offset
    joints = model.joints.tolist()[1:]
    plain = [joint for joint in joints if joint.nq == 1]
    circle = [joint for joint in joints if joint.nq == 2]
    same = model.nq == model.nv == len(chain.leaders) and np.array_equal(G, np.eye(model.nv))
    return Coordinates(
        G=read_only(G),
        offset=read_only(offset),
        plain_v=np.array([joint.idx_v for joint in plain], dtype=np.intp),
        plain_q=np.array([joint.idx_q for joint in plain], dtype=np.intp),
        circle_v=np.array([joint.idx_v for joint in circle], dtype=np.intp),
        circle_q=np.array([joint.idx_q for joint in circle], dtype=np.intp),
        nq=model.nq,
        is_identity=bool(same),
    )
