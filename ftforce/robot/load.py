"""Loading of a `Robot` from a URDF or by the name of a known robot."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ftforce.core.arrays import Vector, read_only
from ftforce.core.task import Task
from ftforce.errors import InputError, SRDFError, UnknownNameError, URDFError, listed
from ftforce.io.xml_text import XmlFile
from ftforce.robot.chain import Chain, choose_chain, leaders_of, moving_path
from ftforce.robot.formats.tree import HELD, MOVING
from ftforce.robot.formats.urdf import is_dh_table, read_urdf, robot_element, tree_of
from ftforce.robot.formats.xacro import PLAIN, XacroOptions, expand, is_xacro
from ftforce.robot.model import coordinates_of, reduced_model, restore_names
from ftforce.robot.plausibility import implausible_numbers
from ftforce.robot.posture import SINGULAR, is_singular_for, usable_posture
from ftforce.robot.robot import BUILT_IN_POSTURES, Joint, Robot
from ftforce.robot.srdf import Srdf, find_moveit, read_srdf, srdf_of
from ftforce.robot.tip import GIVEN, tip_candidates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import ArrayLike

    from ftforce.robot.formats.tree import UrdfJoint, UrdfTree
    from ftforce.robot.known_robots import KnownRobot

# Limits this large or larger are placeholders (docs/guides/limits-and-weight): no arm slides for a
# kilometre, but the motor of a lead screw may make a thousand turns.
_PLACEHOLDER = 1e4  # efforts, velocities and angles
_LONGEST_SLIDE = 1e3  # m
_FORCE = Task()

EffortsLike: TypeAlias = "Mapping[str, float | None] | Sequence[float | None] | Vector | None"
_States: TypeAlias = "Mapping[str, Mapping[str, float]]"  # named postures: joint -> rad or m


def load_robot(
    source: str | os.PathLike[str],
    *,
    tip: str | None = None,
    base: str | None = None,
    posture: str | None = None,
    args: Mapping[str, object] | None = None,
    package_path: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None = None,
    srdf: str | os.PathLike[str] | None = None,
) -> Robot:
    """Load the kinematic chain of a robot from base to tip.

    Parameters
    ----------
    source :
        Path of a URDF, a xacro file (.xacro), an MJCF file or a DH table (.toml), or name of a
        known robot (``ftforce robots`` lists them). A xacro file is a program: expand only files
        that you trust.
    tip :
        Tip link. Default: that of the registry; else the end effector or chain tip of the SRDF;
        else the tool frame at the end of the arm (see the guide on chain and posture).
    base :
        Base link. Default: that of the registry; else that of the SRDF chain; else the root link.
    posture :
        Named posture at which the joints outside the chain are fixed. Default: the posture that is
        analysed by default.
    args :
        Values for the ``<xacro:arg>`` of a xacro file, by name.
    package_path :
        Folders at or below which its ``$(find package)`` looks for packages; of an MJCF file,
        folders besides its own of which files may be included.
    srdf :
        SRDF with tip and named postures, also as a xacro file. Default: that of the registry; else
        one of the same name as the URDF, in the same folder; else, for a URDF in a package, the one
        that MoveIt's configuration of the robot has.

    Returns
    -------
    :
        The arm. Joints outside the chain, such as those of fingers or other limbs, are fixed.

    Raises
    ------
    FileError
        The URDF, xacro file, SRDF or DH table cannot be read, or the chain is malformed. What is
        malformed outside the chain becomes a note.
    InputError
        The robot, tip, base or posture is unknown, the tip is ambiguous, or no joint moves it.

    Examples
    --------
    >>> load_robot("panda")
    <Robot 'panda': 7 joints, 'panda_link0' → 'panda_hand_tcp'>
    """
    known = _known(source)
    options = XacroOptions.of(args, package_path)
    if known is not None and options != PLAIN:
        raise InputError(f"{known.name} is a known robot, not a xacro file: it takes no arguments")
    if srdf is not None and is_xacro(srdf) and is_xacro(source):
        options = options._replace(are_shared=True)
    tree, semantics, notes = _description(source, known, options, srdf)
    read = partial(robot_element, tree.path, options)
    return _robot(_Source(tree, semantics, known, read, notes), tip, base, posture)


class _Source(NamedTuple):
    """What a robot is made of.

    Attributes
    ----------
    tree, srdf, known :
        Contents of URDF and SRDF, and the registry entry.
    read :
        What reads or generates the URDF once more, for its geometry.
    notes :
        Remarks on the files.
    limits :
        Effort limits in place of those of the URDF; ``None`` for these.
    is_file :
        Whether there is a file.
    """

    tree: UrdfTree
    srdf: Srdf
    known: KnownRobot | None
    read: Callable[[], XmlFile]
    notes: tuple[str, ...] = ()
    limits: EffortsLike = None
    is_file: bool = True


def robot_of_model(
    model: pin.Model,
    *,
    tip: str | None = None,
    base: str | None = None,
    posture: str | ArrayLike | None = None,
    limits: EffortsLike = None,
) -> Robot:
    """Return the arm of a Pinocchio model; see `ftforce.Robot.from_model`.

    Parameters
    ----------
    model, tip, base, posture, limits :
        As there.

    Raises
    ------
    InputError
        As there.
    """
    from ftforce.robot.formats import pinocchio_model

    found = pinocchio_model.convert(model, tip, posture)
    name = posture if posture is None or isinstance(posture, str) else pinocchio_model.GIVEN
    tree = tree_of(found, pinocchio_model.label(model))
    read = partial(_element_of, ElementTree.tostring(found.root, encoding="unicode"))
    return _robot(_Source(tree, Srdf(), None, read, limits=limits, is_file=False), tip, base, name)


def _element_of(text: str) -> XmlFile:
    return XmlFile(ElementTree.fromstring(text), ())


def _robot(source: _Source, tip: str | None, base: str | None, posture: str | None) -> Robot:
    tree, srdf, known = source.tree, source.srdf, source.known
    chain = _chain(tree, srdf, known, tip, base)
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
    joints = _with_efforts(_joints(chain, known), source.limits)
    mass = sum(inertia.mass for inertia in model.inertias.tolist()[1:])
    robot = Robot(
        name=known.name if known else tree.name,
        path=tree.path if source.is_file else "",
        tip=chain.tip,
        tip_source=chain.end.source,
        other_tips=MappingProxyType(dict(chain.end.others)),
        base=chain.base,
        base_source=chain.base_source,
        joints=joints,
        model=model,
        tip_frame=tip_frame,
        coordinates=coordinates,
        postures=MappingProxyType(postures),
        preferred=preferred,
        held=MappingProxyType(held),
        fixed=frozenset(j.name for j in tree.joints.values() if j.type not in MOVING),
        mass=mass,
        _remarks=(*source.notes, *_chain_notes(chain, srdf, known), *notes),
        _read_description=source.read,
        _find_tips=partial(_tips, tree, chain),
        _find_implausible=partial(
            implausible_numbers, chain, joints, mass, same_motors=bool(known and known.same_motors)
        ),
    )
    if posture is not None:
        return robot
    places = {name: _held(chain, states.get(name, {})) for name in (*preferred, fallback)}
    return _held_by_default(robot, chain, places, fallback)


def _tips(tree: UrdfTree, chain: Chain) -> dict[str, int]:
    """Return the candidates for the tip; the one that was chosen, unless by the user, is first."""
    tips = tip_candidates(tree)
    if chain.end.source == GIVEN or chain.tip not in tips:
        return tips
    return {chain.tip: tips[chain.tip], **tips}


def _known(source: str | os.PathLike[str]) -> KnownRobot | None:
    """Return the known robot with this name, or ``None`` if the source is a path."""
    from ftforce.robot.known_robots import find_robot, is_name

    return find_robot(str(source)) if is_name(source) else None


def _description(
    source: str | os.PathLike[str],
    known: KnownRobot | None,
    options: XacroOptions,
    srdf: str | os.PathLike[str] | None,
) -> tuple[UrdfTree, Srdf, tuple[str, ...]]:
    """Return the contents of URDF and SRDF, and notes; those of a DH table are generated."""
    is_for_srdf = srdf is not None and is_xacro(srdf) and not is_xacro(source)
    tree = read_urdf(source if known is None else known.urdf, PLAIN if is_for_srdf else options)
    if srdf is not None:
        return tree, _given_srdf(srdf, tree, options), ()
    if known is not None:
        return tree, read_srdf(known.srdf) if known.srdf else Srdf(), ()
    if is_dh_table(source):
        from ftforce.robot.formats.dh import read_dh_table  # not needed for a URDF
        from ftforce.robot.formats.dh_to_urdf import to_srdf

        return tree, srdf_of(ElementTree.fromstring(to_srdf(read_dh_table(source))), source), ()
    from ftforce.robot.known_robots import srdf_beside

    beside = srdf_beside(Path(tree.path))
    if os.path.lexists(beside):
        return tree, read_srdf(beside), ()
    found, note = find_moveit(tree, beside)
    return tree, found, (note,) if note else ()


def _given_srdf(path: str | os.PathLike[str], tree: UrdfTree, options: XacroOptions) -> Srdf:
    """Return the contents of the SRDF that the user gives.

    Raises
    ------
    SRDFError
        It cannot be read, or has nothing in common with the URDF.
    """
    srdf = srdf_of(expand(path, options).root, path) if is_xacro(path) else read_srdf(path)
    if not srdf.fits(tree):
        robot = f"robot {srdf.name!r}" if srdf.name else "another robot"
        raise SRDFError(path, f"is for {robot}: none of its links and joints are in {tree.path}")
    return srdf


def _chain(
    tree: UrdfTree, srdf: Srdf, known: KnownRobot | None, tip: str | None, base: str | None
) -> Chain:
    try:
        return choose_chain(tree, srdf, known, tip, base)
    except InputError:
        for flaw in tree.flaws:
            if flaw.hides_motion:  # perhaps the reason why there seems to be no chain
                raise URDFError(tree.path, flaw.reason) from None
        raise


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
                friction=_of_followers(chain, joint, "friction", 1),
                followers=tuple(f.name for f in chain.followers[joint.name]),
                damping=_of_followers(chain, joint, "damping", 2),
                armature=_of_followers(chain, joint, "armature", 2),
            )
        )
    return tuple(joints)


def _with_efforts(joints: tuple[Joint, ...], limits: EffortsLike) -> tuple[Joint, ...]:
    """Return the joints with other effort limits, N·m or N: by name, or one per joint.

    Raises
    ------
    InputError
        A joint is unknown, the number of limits is wrong, or a limit is not positive.
    """
    if limits is None:
        return joints
    names = [joint.name for joint in joints]
    if isinstance(limits, Mapping):
        for name in limits:
            if name not in names:
                raise UnknownNameError("joint", name, names)
        given = [limits.get(joint.name, joint.effort) for joint in joints]
    else:
        given = list(limits) if isinstance(limits, (Sequence, np.ndarray)) else []
        if len(given) != len(joints):
            raise InputError(
                f"limits are {{joint: N·m}}, or one per joint of {listed(names)}; got {limits!r}"
            )
    return tuple(
        replace(joint, effort=_checked_effort(joint.name, value))
        for joint, value in zip(joints, given, strict=True)
    )


def _checked_effort(name: str, value: object) -> float | None:
    """Return an effort limit; ``None`` if it is unknown: None, NaN or infinite."""
    if value is None:
        return None
    is_number = isinstance(value, (int, float, np.integer, np.floating))
    if not is_number or isinstance(value, bool) or value <= 0:  # type: ignore[operator] # a number
        raise InputError(f"the effort limit of joint {name!r} must be positive, got {value!r}")
    return float(value) if math.isfinite(value) else None  # type: ignore[arg-type]


def _bounds(joint: UrdfJoint) -> tuple[float, float]:
    """Return the position limits; infinite where there is none or it is a placeholder."""
    largest = _LONGEST_SLIDE if joint.type == "prismatic" else _PLACEHOLDER
    lower = -np.inf if joint.lower is None or joint.lower <= -largest else joint.lower
    upper = np.inf if joint.upper is None or joint.upper >= largest else joint.upper
    return lower, upper


def _largest(limit: float | None) -> float | None:
    """Return an effort, velocity or friction, or ``None`` if it is unknown."""
    return limit if limit is not None and 0.0 < limit < _PLACEHOLDER else None


def _of_followers(chain: Chain, leader: UrdfJoint, name: str, power: int) -> float | None:
    """Return the friction, damping or armature of a joint and its followers as the leader feels it.

    That is ``Σ |multiplier|ᵖ value``: by virtual work, p is 1 for friction and 2 for the others.
    """
    joints = chain.tree.joints
    found = [(1.0, leader), *((f.multiplier, joints[f.name]) for f in chain.followers[leader.name])]
    known = [(abs(by) ** power, _largest(getattr(joint, name))) for by, joint in found]
    values = [by * value for by, value in known if value is not None]
    return _largest(sum(values)) if values else None


def _limit_notes(chain: Chain, known: KnownRobot | None) -> list[str]:
    """Return notes on limits of the chain that are no limits."""
    corrected = {c.joint for c in known.corrections} if known else set()
    efforts = [j for j in chain.leaders if j.name not in corrected and j.effort]
    odd = [f"{j.name} {j.effort:g}" for j in efforts if _largest(j.effort) is None]
    notes = [f"effort limits that count as unknown: {listed(odd)}"] if odd else []
    open_ended = []
    for joint in chain.leaders:
        lower, upper = _bounds(joint)
        for own, used in ((joint.lower, lower), (joint.upper, upper)):
            if own is not None and math.isinf(used):
                open_ended.append(f"{joint.name} {own:g}")
    if open_ended:
        notes.append(f"position limits that count as none: {listed(open_ended)}")
    return notes


def _states(chain: Chain, srdf: Srdf, known: KnownRobot | None) -> _States:
    """Return the named postures of SRDF and registry, by joint name."""
    states: dict[str, Mapping[str, float]] = {**chain.tree.states, **srdf.states}
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
    # As the default of a question about forces, the usual one.
    name, _ = usable_posture(robot, lambda q: SINGULAR * is_singular_for(robot, q, _FORCE))
    held = places[fallback if name is None else name]
    # Postures that hold them elsewhere are no defaults, whatever the question; those that were
    # skipped stay, to be told.
    last = len(robot.preferred) if name is None else robot.preferred.index(name)
    own = (one for i, one in enumerate(robot.preferred) if i < last or places[one] == held)
    robot = replace(robot, preferred=tuple(own))
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
    notes += [*chain.tree.notes, *_flaws_outside(chain), *_limit_notes(chain, known)]
    if known is None and chain.end.source != GIVEN:
        named = dict.fromkeys(
            (*srdf.end_effectors, *(link for ends in srdf.chains for link in ends))
        )
        if lost := [link for link in named if link not in chain.tree.links]:
            notes.append(f"the SRDF names links that are not in the URDF: {listed(lost)}")
    held = [joint.name for joint in chain.tree.path_to(chain.tip) if joint.type in HELD]
    notes += [f"joint {name!r} (floating or planar) is held fixed" for name in held]
    return notes


def _flaws_outside(chain: Chain) -> list[str]:
    """Return notes on what is malformed outside the chain.

    Raises
    ------
    URDFError
        A link or joint of the chain is malformed, or one between the root and the base.
    """
    if not chain.tree.flaws:
        return []
    path = chain.tree.path_to(chain.tip)
    joints = {*chain.moving, *chain.names, *(joint.name for joint in path)}
    links = {joint.child for joint in path}
    notes: dict[str, None] = {}  # several joints may have one flaw in common
    for flaw in chain.tree.flaws:
        if flaw.name in (joints if flaw.kind == "joint" else links):
            raise URDFError(chain.tree.path, flaw.reason)
        notes[f"ignored, as it lies outside the chain: {flaw.reason}"] = None
    return list(notes)


def _corrections(chain: Chain, known: KnownRobot) -> list[str]:
    """Return notes on the corrected effort limits, grouped by reason."""
    joints: dict[str, list[str]] = {}
    for correction in known.corrections:
        if correction.joint in chain.names:
            value = f"{correction.effort:g} N·m" if correction.effort else "unknown"
            joints.setdefault(f"{value}; {correction.reason}", []).append(correction.joint)
    return [f"effort limit of {listed(names)}: {why}" for why, names in joints.items()]
