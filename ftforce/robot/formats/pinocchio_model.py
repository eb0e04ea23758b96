"""Pinocchio models that were made elsewhere.

A model becomes a URDF: a link per body frame, with the inertia of a joint at the first of them.
Joints with several degrees of freedom are held where the given configuration has them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ftforce.errors import InputError, UnknownNameError
from ftforce.robot.formats.converted import (
    Converted,
    JointNumbers,
    UniqueNames,
    add_joint,
    add_link,
)
from ftforce.robot.formats.tree import Flaw

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from ftforce.core.arrays import Vector

_LARGEST = 1e300  # Pinocchio's limits of joints without any
_GRAVITY = (0.0, 0.0, -9.81)  # m/s², Pinocchio's default
_HELD = {"JointModelFreeFlyer": "floating", "JointModelPlanar": "planar"}
GIVEN = "given"
"""Name of a posture that is given as a configuration."""

_LINKS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)


def convert(model: pin.Model, tip: str | None, posture: str | ArrayLike | None) -> Converted:
    """Return the URDF of a model.

    Parameters
    ----------
    model :
        The model.
    tip :
        Name of a frame that becomes a link even if it is that of a joint; ``None`` for none.
    posture :
        Where joints of several degrees of freedom are held: name of a reference configuration, or
        a configuration of shape (nq,), which becomes the posture ``given``; else the neutral one.

    Raises
    ------
    InputError
        It is no Pinocchio model, or the posture is no configuration of it.
    UnknownNameError
        The tip is no frame of the model.
    """
    if not isinstance(model, pin.Model):
        hint = "; pass its .model" if hasattr(model, "model") else ""
        raise InputError(f"a pinocchio.Model is needed, got {type(model).__name__}{hint}")
    names = [frame.name for frame in model.frames]
    if tip is not None and tip not in names:
        raise UnknownNameError("tip frame", tip, dict.fromkeys(names), f"of {label(model)}")
    if not np.isfinite(model.gravity.linear).all():
        raise InputError(f"{label(model)}: its gravity is not finite: {model.gravity.linear}")
    own = {one.key(): np.array(one.data()) for one in model.referenceConfigurations}
    own = {name: q for name, q in own.items() if len(q) == model.nq}
    if posture is None or isinstance(posture, str):
        return _Conversion(model, tip, own.get(posture or "", pin.neutral(model))).result(own)
    q = _configuration(model, posture)
    return _Conversion(model, tip, q).result({**own, GIVEN: q})


def label(model: pin.Model) -> str:
    """Return a model's name for messages, where others have the path of a file.

    Parameters
    ----------
    model :
        The model.
    """
    name = "".join(letter if letter.isprintable() else "?" for letter in model.name or "robot")
    return f"Pinocchio model {name!r}"


def _configuration(model: pin.Model, q: ArrayLike) -> Vector:
    try:
        given = np.array(q, dtype=float)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != (model.nq,) or not np.isfinite(given).all():
        raise InputError(
            f"a posture of {label(model)} is a name or a configuration of {model.nq} numbers"
        )
    if not pin.isNormalized(model, given, 1e-6):
        raise InputError(
            "the configuration is not normalized: quaternions, and cos and sin of continuous "
            "joints, need length 1 (pinocchio.normalize)"
        )
    return given


class _Conversion:
    """One model on its way to a URDF."""

    def __init__(self, model: pin.Model, tip: str | None, q: Vector) -> None:
        self.model, self.q = model, q
        self.data = model.createData()
        pin.forwardKinematics(model, self.data, q)
        self.joint_names = UniqueNames()
        self.names = [self.joint_names.new(name) for name in model.names.tolist()]
        self.flaws: list[Flaw] = []
        self.robot = Element("robot", name=model.name or "robot")
        self.links, self.first = self._named_links(tip)

    def result(self, postures: Mapping[str, Vector]) -> Converted:
        """Return the URDF with all that was found, and with these postures."""
        model = self.model
        for i in range(model.njoints):
            inertia = model.inertias[i] if i else None
            at = pin.SE3.Identity() if inertia is None else pin.SE3(np.eye(3), inertia.lever)
            mass = None if inertia is None or _is_empty(inertia) else inertia
            add_link(self.robot, self.first[i], mass, at)
        for i in range(1, model.njoints):
            self._add_joint(i)
        for f, name in self.links.items():
            if name not in self.first:
                self._add_frame(f, name)
        own = tuple(model.gravity.linear.tolist())
        gravity = None if own == _GRAVITY else own
        states = {name: self._state(q) for name, q in postures.items()}
        notes = tuple(self._notes(gravity))
        return Converted(self.robot, notes, tuple(self.flaws), states, gravity)

    def _notes(self, gravity: tuple[float, ...] | None) -> list[str]:
        notes = []
        if gravity is not None:
            shown = ", ".join(f"{x:g}" for x in gravity)
            notes.append(f"gravity is that of the model: ({shown}) m/s²")
        if np.any(self.model.gravity.angular):
            notes.append("the angular part of the model's gravity is ignored")
        return notes

    # ---- links ---------------------------------------------------------------------------------

    def _named_links(self, tip: str | None) -> tuple[dict[int, str], list[str]]:
        """Return the names of the frames that become links, and those of the joints' own links."""
        model, unique = self.model, UniqueNames()
        links: dict[int, str] = {}
        own: dict[int, str] = {}
        bodies = [f for f, frame in enumerate(model.frames) if f and frame.type in _LINKS]
        for f in bodies:
            frame = model.frames[f]
            links[f] = unique.new(frame.name)
            is_first = frame.type == pin.FrameType.BODY and frame.parentJoint not in own
            if is_first and frame.placement.isIdentity(1e-15):
                own[frame.parentJoint] = links[f]
        for i in range(model.njoints):
            if i not in own:
                own[i] = unique.new(f"{self.names[i]}_body" if i else "universe")
        if tip is not None and tip not in {*links.values(), *own.values()}:
            chosen = next(f for f, frame in enumerate(model.frames) if frame.name == tip)
            links[chosen] = unique.new(tip)
        return links, [own[i] for i in range(model.njoints)]

    def _add_frame(self, f: int, name: str) -> None:
        """Fix a link to the one above its frame, or to its joint's own."""
        model, frame = self.model, self.model.frames[f]
        joint, above, at = frame.parentJoint, frame.parentFrame, frame.placement
        parent, fixed = self.first[joint], f"{name}_fixed"
        while above and above != f and model.frames[above].parentJoint == joint:
            higher = model.frames[above]
            if above in self.links:
                parent, at = self.links[above], higher.placement.actInv(at)
                break
            if higher.type == pin.FrameType.FIXED_JOINT:
                fixed = higher.name
            if higher.parentFrame >= above:
                break  # frames are listed from the root; anything else could be a circle
            above = higher.parentFrame
        add_link(self.robot, name, None, pin.SE3.Identity())
        add_joint(self.robot, self.joint_names.new(fixed), "fixed", (parent, name), at)

    # ---- joints --------------------------------------------------------------------------------

    def _add_joint(self, i: int) -> None:
        model, joint, name = self.model, self.model.joints[i], self.names[i]
        kind, mimic = joint.shortname(), None
        ends = self.first[model.parents[i]], self.first[i]
        if kind == "JointModelMimic":
            followed = joint.extract()
            leader = model.mimicked_joints[list(model.mimicking_joints).index(i)]
            mimic = self.names[leader], followed.scaling, followed.offset
        elif joint.nv != 1 or kind.startswith("JointModelH"):  # helical ones have one, too
            self._hold(i, kind, ends)
            return
        axis, is_slide = self._axis(i, 1.0 if mimic is None else mimic[1])
        if axis is None:
            self._hold(i, kind, ends)
            return
        numbers = JointNumbers(axis=axis, mimic=mimic)
        if mimic is None:
            numbers = self._limits(i, numbers, with_positions=joint.nq == 1)
        is_open = not is_slide and numbers.lower is None and numbers.upper is None
        moved = "prismatic" if is_slide else "continuous" if is_open else "revolute"
        place = model.jointPlacements[i]
        add_joint(self.robot, name, moved, ends, place, numbers=numbers)

    def _hold(self, i: int, kind: str, ends: tuple[str, str]) -> None:
        """Fix a joint of several degrees of freedom; only above the chain is that no matter."""
        name, held = self.names[i], _HELD.get(kind, "fixed")
        add_joint(self.robot, name, held, ends, self.data.liMi[i])
        if kind not in _HELD:
            short = kind.removeprefix("JointModel")
            reason = (
                f"joint {name!r} is of type {short}, which no single motor drives; only revolute "
                "and prismatic joints can be analysed"
            )
            self.flaws.append(Flaw("joint", name, reason, hides_motion=True))

    def _axis(self, i: int, factor: float) -> tuple[Vector | None, bool]:
        """Return a joint's axis in its own frame, and whether it slides, from how it moves.

        A mimic joint moves by a factor of its leader's speed.
        """
        model = self.model
        v = np.zeros(model.nv)
        joint = model.joints[i]
        v[joint.idx_v] = 1.0
        data = model.createData()
        pin.forwardKinematics(model, data, self.q, v)
        own = data.v[i] - data.liMi[i].actInv(data.v[model.parents[i]])
        linear, angular = np.linalg.norm(own.linear), np.linalg.norm(own.angular)
        scale = max(linear, angular)
        if scale == 0.0 or min(linear, angular) > 1e-12 * scale:
            return None, False
        moved = own.linear if linear > angular else own.angular
        return moved / factor, bool(linear > angular)

    def _limits(self, i: int, numbers: JointNumbers, *, with_positions: bool) -> JointNumbers:
        model, joint = self.model, self.model.joints[i]
        v = joint.idx_v
        lower = upper = None
        if with_positions:
            lower = float(model.lowerPositionLimit[joint.idx_q])
            upper = float(model.upperPositionLimit[joint.idx_q])
            if min(-lower, upper) >= _LARGEST:
                lower = upper = None
        motor = float(model.rotorInertia[v] * model.rotorGearRatio[v] ** 2)
        return numbers._replace(
            lower=lower,
            upper=upper,
            effort=_known(float(model.effortLimit[v])),
            velocity=_known(float(model.velocityLimit[v])),
            damping=_known(float(model.damping[v])),
            friction=_known(float(model.friction[v])),
            armature=_known(float(model.armature[v]) or motor),
        )

    def _state(self, q: Vector) -> dict[str, float]:
        """Return the positions of the revolute and prismatic joints of a configuration."""
        state = {}
        for i in range(1, self.model.njoints):
            joint = self.model.joints[i]
            if joint.nv == 1 and joint.nq in {1, 2}:
                own = q[joint.idx_q : joint.idx_q + joint.nq]
                state[self.names[i]] = float(own[0] if joint.nq == 1 else math.atan2(*own[::-1]))
        return state


def _is_empty(inertia: pin.Inertia) -> bool:
    return inertia.mass == 0.0 and not np.any(inertia.inertia)


def _known(limit: float) -> float | None:
    """Return a limit, or ``None`` for Pinocchio's largest number, or none at all."""
    return limit if abs(limit) < _LARGEST else None
