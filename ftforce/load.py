"""From a URDF, or the name of a known robot, to a `Robot`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ftforce.arrays import Vector, read_only
from ftforce.coordinates import Coordinates
from ftforce.errors import InputError, UnknownNameError, URDFError, listed
from ftforce.registry import find_robot, known_robots
from ftforce.robot import BUILT_IN_POSTURES, Joint, Robot
from ftforce.srdf import Srdf, read_srdf
from ftforce.stderr import captured_stderr
from ftforce.tips import choose_base, choose_tip, moving_path, tip_candidates
from ftforce.urdf import HELD, MOVING, read_urdf

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.registry import KnownRobot
    from ftforce.urdf import UrdfJoint, UrdfTree

EFFORT_PLACEHOLDER = 1e4  # theory §5: from here on a limit is a placeholder, not a motor's


def load_robot(
    source: str | os.PathLike[str],
    *,
    tip: str | None = None,
    base: str | None = None,
    posture: str | None = None,
) -> Robot:
    """Load the chain base → tip of a URDF.

    Parameters
    ----------
    source :
        A path to a URDF, or a known robot's name (``ftforce robots`` lists them). An SRDF of the
        same name beside the URDF is read too.
    tip :
        Tip link. Without it: the registry's; the SRDF's end effector or chain tip; else the last
        link before the tree branches into several moving parts.
    base :
        Base link. Without it: the registry's; the SRDF chain's; else the root.
    posture :
        Named posture at which the joints outside the chain are fixed.

    Returns
    -------
    :
        The arm. Joints outside the chain are fixed, so fingers and other limbs never count.

    Raises
    ------
    FileError
        The URDF or SRDF cannot be read or is malformed.
    InputError
        Unknown robot, tip, base or posture; no tip is singled out; no joint moves the tip.

    Examples
    --------
    >>> load_robot("panda")
    <Robot 'panda': 7 joints, 'panda_link0' → 'panda_hand_tcp'>
    """
    known = _known(source)
    tree = read_urdf(source if known is None else known.urdf)
    srdf = _srdf(tree.path, known)
    chain = _choose_chain(tree, srdf, known, tip, base)
    postures, notes = _postures(chain, srdf, known)
    if posture is not None and posture not in {*srdf.states, *postures, *BUILT_IN_POSTURES}:
        raise UnknownNameError("posture", posture, [*postures, *BUILT_IN_POSTURES])
    preferred = (known.posture,) if known else tuple(name for name in postures if name)
    held = _held(chain, srdf, posture or (preferred[0] if preferred else ""))
    model = _reduced_model(chain, held)
    return Robot(
        name=known.name if known else tree.name,
        path=tree.path,
        tip=chain.tip,
        tip_source=chain.tip_source,
        base=chain.base,
        base_source=chain.base_source,
        joints=_joints(chain, known),
        model=model,
        tip_frame=model.getFrameId(chain.tip, pin.FrameType.BODY),
        coordinates=_coordinates(chain, model),
        postures=MappingProxyType(postures),
        preferred=preferred,
        held=MappingProxyType(held),
        fixed=frozenset(j.name for j in tree.joints.values() if j.type == "fixed"),
        tips=MappingProxyType(tip_candidates(tree)),
        mass=sum(inertia.mass for inertia in model.inertias.tolist()[1:]),
        notes=(*_chain_notes(chain, known), *notes),
    )


@dataclass(frozen=True, slots=True)
class _Chain:
    """The joints that count: leaders in the order of the path, and what follows each of them."""

    tree: UrdfTree
    tip: str
    tip_source: str
    base: str
    base_source: str
    leaders: tuple[UrdfJoint, ...]
    followers: Mapping[str, tuple[_Follower, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.leaders)

    @property
    def moving(self) -> frozenset[str]:
        """Names of all joints that stay free in the model."""
        following = (follower.name for all_of in self.followers.values() for follower in all_of)
        return frozenset((*self.names, *following))


@dataclass(frozen=True, slots=True)
class _Follower:
    name: str
    multiplier: float
    offset: float


def _known(source: str | os.PathLike[str]) -> KnownRobot | None:
    """Return the known robot of this name, or ``None`` if the source is a path."""
    if not isinstance(source, str) or os.sep in source or Path(source).suffix:
        return None
    if source not in known_robots() and Path(source).exists():
        return None
    return find_robot(source)


def _srdf(urdf: str, known: KnownRobot | None) -> Srdf:
    if known is not None:
        return read_srdf(known.srdf) if known.srdf else Srdf()
    beside = Path(urdf).with_suffix(".srdf")
    return read_srdf(beside) if beside.exists() else Srdf()


def _choose_chain(
    tree: UrdfTree, srdf: Srdf, known: KnownRobot | None, tip: str | None, base: str | None
) -> _Chain:
    if known is not None and tip is None:
        base = base or known.base or None
        tip_link, tip_source = choose_tip(tree, srdf, known.tip, base)
    else:
        tip_link, tip_source = choose_tip(tree, srdf, tip, base)
    base_link, base_source = choose_base(tree, srdf, tip_link, base)
    if known is not None and tip is None:
        tip_source = f"known robot {known.name}"
        base_source = tip_source if base == known.base else base_source
    leaders: dict[str, UrdfJoint] = {}
    for joint in moving_path(tree, base_link, tip_link):
        leader = tree.joints[_resolve(tree, joint).name]
        leaders.setdefault(leader.name, leader)
    if not leaders:
        raise InputError(
            f"{tree.path}: no joint moves the tip {tip_link!r} against the base {base_link!r}; "
            f"tips to choose from: {listed(tip_candidates(tree))}"
        )
    followers = _followers(tree, leaders)
    return _Chain(
        tree, tip_link, tip_source, base_link, base_source, tuple(leaders.values()), followers
    )


def _resolve(tree: UrdfTree, joint: UrdfJoint) -> _Follower:
    """Return the leader at the end of a chain of mimics: ``q = multiplier · q_leader + offset``."""
    multiplier, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += multiplier * joint.mimic.offset
        multiplier *= joint.mimic.multiplier
        joint = tree.joints[joint.mimic.leader]
    return _Follower(joint.name, multiplier, offset)


def _followers(
    tree: UrdfTree, leaders: Mapping[str, UrdfJoint]
) -> Mapping[str, tuple[_Follower, ...]]:
    found: dict[str, list[_Follower]] = {name: [] for name in leaders}
    for joint in tree.joints.values():
        if joint.mimic is not None:
            leader = _resolve(tree, joint)
            if leader.name in found:
                follower = _Follower(joint.name, leader.multiplier, leader.offset)
                found[leader.name].append(follower)
    return MappingProxyType({name: tuple(all_of) for name, all_of in found.items()})


def _joints(chain: _Chain, known: KnownRobot | None) -> tuple[Joint, ...]:
    corrected = {c.joint: c.effort for c in known.corrections} if known else {}
    joints = []
    for number, joint in enumerate(chain.leaders, start=1):
        effort = corrected.get(joint.name, joint.effort or 0.0)
        joints.append(
            Joint(
                number=number,
                name=joint.name,
                type=joint.type,
                lower=-np.inf if joint.lower is None else joint.lower,
                upper=np.inf if joint.upper is None else joint.upper,
                effort=effort if 0.0 < effort < EFFORT_PLACEHOLDER else None,
                velocity=joint.velocity or None,
                followers=tuple(f.name for f in chain.followers[joint.name]),
            )
        )
    return tuple(joints)


def _postures(
    chain: _Chain, srdf: Srdf, known: KnownRobot | None
) -> tuple[dict[str, Vector], list[str]]:
    """Return the named postures of the chain, and notes on those that could not be used."""
    postures: dict[str, Vector] = {}
    notes = []
    for name, state in srdf.states.items():
        missing = [joint for joint in chain.names if joint not in state]
        if not missing:
            postures[name] = read_only(np.array([state[joint] for joint in chain.names]))
        elif len(missing) < len(chain.names):
            notes.append(f"SRDF state {name!r} is left out: it does not place {listed(missing)}")
    for name, q in known.postures.items() if known else ():
        if len(q) == len(chain.names):  # they are given for the registry's own chain
            postures[name] = read_only(np.array(q))
    return postures, notes


def _held(chain: _Chain, srdf: Srdf, posture: str) -> dict[str, float]:
    """Return the joints outside the chain and where they are fixed: the state's value, or 0."""
    state = srdf.states.get(posture, {})
    tree, moving = chain.tree, chain.moving
    held: dict[str, float] = {}
    for joint in tree.joints.values():
        if joint.type in MOVING and joint.name not in moving:
            leader = _resolve(tree, joint)
            held[joint.name] = leader.offset + leader.multiplier * state.get(
                leader.name, _nearest_to_zero(tree.joints[leader.name])
            )
    return held


def _nearest_to_zero(joint: UrdfJoint) -> float:
    if joint.lower is None or joint.upper is None:
        return 0.0
    return min(max(0.0, joint.lower), joint.upper)


def _reduced_model(chain: _Chain, held: Mapping[str, float]) -> pin.Model:
    """Return Pinocchio's model with every joint outside the chain fixed."""
    try:
        with captured_stderr() as printed:
            full = pin.buildModelFromXML(chain.tree.to_xml())
    except (ValueError, RuntimeError) as problem:
        reason = " ".join(f"{printed} {problem}".split())
        raise URDFError(chain.tree.path, f"Pinocchio cannot read it: {reason}") from None
    q = pin.neutral(full)  # floating and planar roots stay at their neutral pose
    for name, value in held.items():
        joint = full.joints[full.getJointId(name)]
        if joint.nq == 1:
            q[joint.idx_q] = value
        else:
            q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    moving = chain.moving
    fixed = [i for i in range(1, full.njoints) if full.names[i] not in moving]
    return pin.buildReducedModel(full, fixed, q)


def _coordinates(chain: _Chain, model: pin.Model) -> Coordinates:
    G = np.zeros((model.nv, len(chain.leaders)))
    offset = np.zeros(model.nv)
    for column, leader in enumerate(chain.leaders):
        G[model.joints[model.getJointId(leader.name)].idx_v, column] = 1.0
        for follower in chain.followers[leader.name]:
            row = model.joints[model.getJointId(follower.name)].idx_v
            G[row, column], offset[row] = follower.multiplier, follower.offset
    plain = [joint for joint in model.joints.tolist()[1:] if joint.nq == 1]
    circle = [joint for joint in model.joints.tolist()[1:] if joint.nq == 2]
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


def _chain_notes(chain: _Chain, known: KnownRobot | None) -> list[str]:
    notes = list(known.notes) if known else []
    notes += _corrections(chain, known) if known else []
    held = [joint.name for joint in chain.tree.path_to(chain.tip) if joint.type in HELD]
    notes += [f"joint {name!r} (floating or planar) is held fixed" for name in held]
    return notes


def _corrections(chain: _Chain, known: KnownRobot) -> list[str]:
    """Say which effort limits were replaced and why, joints of one reason together."""
    joints: dict[str, list[str]] = {}
    for correction in known.corrections:
        if correction.joint in chain.names:
            value = f"{correction.effort:g} N·m" if correction.effort else "unknown"
            joints.setdefault(f"{value}; {correction.reason}", []).append(correction.joint)
    return [f"effort limit of {listed(names)}: {why}" for why, names in joints.items()]
