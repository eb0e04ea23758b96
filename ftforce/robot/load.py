"""Loading of a `Robot` from a URDF or by the name of a known robot."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import Vector, read_only
from ftforce.errors import UnknownNameError, listed
from ftforce.robot.chain import Chain, choose_chain, leaders_of, moving_path
from ftforce.robot.formats.tree import HELD, MOVING
from ftforce.robot.formats.urdf import read_urdf
from ftforce.robot.model import coordinates_of, reduced_model, restore_names
from ftforce.robot.posture import usable_posture
from ftforce.robot.robot import BUILT_IN_POSTURES, Joint, Robot
from ftforce.robot.srdf import Srdf, read_srdf
from ftforce.robot.tip import GIVEN, tip_candidates

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ftforce.robot.formats.tree import UrdfJoint
    from ftforce.robot.known_robots import KnownRobot

_PLACEHOLDER = 1e4  # limits this large or larger are placeholders (docs/theory/limits)

_States: TypeAlias = "Mapping[str, Mapping[str, float]]"  # named postures: joint -> rad or m


def load_robot(
    source: str | os.PathLike[str],
    *,
    tip: str | None = None,
    base: str | None = None,
    posture: str | None = None,
) -> Robot:
    """Load the kinematic chain of a robot from base to tip.

    Parameters
    ----------
    source :
        Path of a URDF, or name of a known robot (``ftforce robots`` lists them). An SRDF of the
        same name in the same folder is also read.
    tip :
        Tip link. Default: that of the registry; else the end effector or chain tip of the SRDF;
        else the tool frame at the end of the arm (see the guide on chain and posture).
    base :
        Base link. Default: that of the registry; else that of the SRDF chain; else the root link.
    posture :
        Named posture at which the joints outside the chain are fixed. Default: the posture that is
        analysed by default.

    Returns
    -------
    :
        The arm. Joints outside the chain, such as those of fingers or other limbs, are fixed.

    Raises
    ------
    FileError
        The URDF or SRDF cannot be read or is malformed.
    InputError
        The robot, tip, base or posture is unknown, the tip is ambiguous, or no joint moves it.

    Examples
    --------
    >>> load_robot("panda")
    <Robot 'panda': 7 joints, 'panda_link0' → 'panda_hand_tcp'>
    """
    known = _known(source)
    tree = read_urdf(source if known is None else known.urdf)
    srdf = _srdf(tree.path, known)
    chain = choose_chain(tree, srdf, known, tip, base)
    states = _states(chain, srdf, known)
    postures, notes = _postures(chain, states)
    if posture is not None and posture not in {*states, *BUILT_IN_POSTURES}:
        raise UnknownNameError("posture", posture, [*postures, *BUILT_IN_POSTURES])
    preferred = (known.posture,) if known and known.posture in postures else tuple(postures)
    # A known robot's posture may cover joints outside the chain but not the chain itself.
    fallback = known.posture if known else ""
    first = next(iter(preferred), fallback) if posture is None else posture
    held = _held(chain, states.get(first, {}))
    model = reduced_model(chain, held)
    coordinates = coordinates_of(chain, model)
    tip_frame = model.getFrameId(tree.link_codes()[chain.tip], pin.FrameType.BODY)
    restore_names(model, tree)
    robot = Robot(
        name=known.name if known else tree.name,
        path=tree.path,
        tip=chain.tip,
        tip_source=chain.end.source,
        other_tips=MappingProxyType(dict(chain.end.others)),
        base=chain.base,
        base_source=chain.base_source,
        joints=_joints(chain, known),
        model=model,
        tip_frame=tip_frame,
        coordinates=coordinates,
        postures=MappingProxyType(postures),
        preferred=preferred,
        held=MappingProxyType(held),
        fixed=frozenset(j.name for j in tree.joints.values() if j.type not in MOVING),
        tips=MappingProxyType(tip_candidates(tree)),
        mass=sum(inertia.mass for inertia in model.inertias.tolist()[1:]),
        notes=(*_chain_notes(chain, srdf, known), *notes),
    )
    if posture is not None:
        return robot
    places = {name: _held(chain, states.get(name, {})) for name in (*preferred, fallback)}
    return _held_by_default(robot, chain, places, fallback)


def _known(source: str | os.PathLike[str]) -> KnownRobot | None:
    """Return the known robot with this name, or ``None`` if the source is a path."""
    if not isinstance(source, str) or os.sep in source or Path(source).suffix:
        return None
    from ftforce.robot.known_robots import find_robot, known_robots  # not needed for a path

    if source not in known_robots() and os.path.lexists(source):
        return None
    return find_robot(source)


def _srdf(urdf: str, known: KnownRobot | None) -> Srdf:
    if known is not None:
        return read_srdf(known.srdf) if known.srdf else Srdf()
    beside = Path(urdf).with_suffix(".srdf")
    return read_srdf(beside) if os.path.lexists(beside) else Srdf()


def _joints(chain: Chain, known: KnownRobot | None) -> tuple[Joint, ...]:
    corrected = {c.joint: c.effort for c in known.corrections} if known else {}
    joints = []
    for number, joint in enumerate(chain.leaders, start=1):
        lower, upper = _bounds(joint)
        joints.append(
            Joint(
                number=number,
                name=joint.name,
                type=joint.type,
                lower=lower,
                upper=upper,
                effort=_largest(corrected.get(joint.name, joint.effort)),
                velocity=_largest(joint.velocity),
                followers=tuple(f.name for f in chain.followers[joint.name]),
            )
        )
    return tuple(joints)


def _bounds(joint: UrdfJoint) -> tuple[float, float]:
    """Return the position limits; infinite if there are none or both are placeholders."""
    if joint.lower is None or joint.upper is None:
        return -np.inf, np.inf
    if joint.lower <= -_PLACEHOLDER and joint.upper >= _PLACEHOLDER:
        return -np.inf, np.inf
    return max(joint.lower, -_PLACEHOLDER), min(joint.upper, _PLACEHOLDER)


def _largest(limit: float | None) -> float | None:
    """Return an effort or velocity limit, or ``None`` if it is unknown."""
    return limit if limit is not None and 0.0 < limit < _PLACEHOLDER else None


def _states(chain: Chain, srdf: Srdf, known: KnownRobot | None) -> _States:
    """Return the named postures of SRDF and registry, by joint name."""
    states: dict[str, Mapping[str, float]] = dict(srdf.states)
    if known is not None and known.postures:
        # They refer to the chain of the registry, which may differ from the requested one.
        own = moving_path(chain.tree, known.base or chain.tree.root, known.tip)
        names = leaders_of(chain.tree, own)
        states |= {name: dict(zip(names, q, strict=True)) for name, q in known.postures.items()}
    return states


def _postures(chain: Chain, states: _States) -> tuple[dict[str, Vector], list[str]]:
    """Return the named postures of the chain, and notes on those that are incomplete."""
    postures: dict[str, Vector] = {}
    notes = []
    for name, state in states.items():
        missing = [joint for joint in chain.names if joint not in state]
        if not missing:
            postures[name] = read_only(np.array([state[joint] for joint in chain.names]))
        elif len(missing) < len(chain.names):
            notes.append(f"posture {name!r} is ignored: it has no position for {listed(missing)}")
    return postures, notes


def _held(chain: Chain, state: Mapping[str, float]) -> dict[str, float]:
    """Return the positions of the fixed joints: the state's, or the allowed value nearest 0."""
    joints = chain.tree.joints
    held: dict[str, float] = {}
    for joint in joints.values():
        if joint.type not in MOVING or joint.name in chain.moving:
            continue
        if (mimic := joint.mimic) is None:
            held[joint.name] = state.get(joint.name, _nearest_to_zero(joint))
        else:
            leader = state.get(mimic.leader, _nearest_to_zero(joints[mimic.leader]))
            held[joint.name] = mimic.offset + mimic.multiplier * leader
    return held


def _held_by_default(
    robot: Robot, chain: Chain, places: Mapping[str, dict[str, float]], fallback: str
) -> Robot:
    """Return the arm with the joints outside the chain fixed as in the default posture.

    They affect neither singularities nor limits of the chain, so they can be set afterwards.

    Parameters
    ----------
    robot, chain :
        The arm, with those joints fixed as in its first preferred posture.
    places :
        Positions of those joints in each posture.
    fallback :
        Posture to use for them if no preferred posture is a usable default.
    """
    if all(held == robot.held for held in places.values()):
        return robot  # the usual case: the choice makes no difference
    name, _ = usable_posture(robot)
    held = places[fallback if name is None else name]
    if held == robot.held:
        return robot
    model = reduced_model(chain, held)
    restore_names(model, chain.tree)
    return replace(robot, model=model, held=MappingProxyType(held))


def _nearest_to_zero(joint: UrdfJoint) -> float:
    if joint.lower is None or joint.upper is None:
        return 0.0
    return min(max(0.0, joint.lower), joint.upper)


def _chain_notes(chain: Chain, srdf: Srdf, known: KnownRobot | None) -> list[str]:
    notes = [*known.notes, *_corrections(chain, known)] if known else []
    if known is None and chain.end.source != GIVEN:
        named = dict.fromkeys(
            (*srdf.end_effectors, *(link for ends in srdf.chains for link in ends))
        )
        if lost := [link for link in named if link not in chain.tree.links]:
            notes.append(f"the SRDF names links that are not in the URDF: {listed(lost)}")
    held = [joint.name for joint in chain.tree.path_to(chain.tip) if joint.type in HELD]
    notes += [f"joint {name!r} (floating or planar) is held fixed" for name in held]
    return notes


def _corrections(chain: Chain, known: KnownRobot) -> list[str]:
    """Return notes on the corrected effort limits, grouped by reason."""
    joints: dict[str, list[str]] = {}
    for correction in known.corrections:
        if correction.joint in chain.names:
            value = f"{correction.effort:g} N·m" if correction.effort else "unknown"
            joints.setdefault(f"{value}; {correction.reason}", []).append(correction.joint)
    return [f"effort limit of {listed(names)}: {why}" for why, names in joints.items()]
