"""A robot of another format as a URDF, with what a URDF cannot say.

All other formats become the root element of a URDF, so that one reader checks them all and the page
finds its shapes where it always does.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias
from xml.etree.ElementTree import Element, SubElement

from ftforce.robot.formats.tree import MOMENTS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import pinocchio as pin

    from ftforce.core.arrays import Vector
    from ftforce.robot.formats.tree import Flaw, Numbers

States: TypeAlias = "Mapping[str, Mapping[str, float]]"  # named postures: joint -> rad or m


class Converted(NamedTuple):
    """A robot description as the root element of a URDF.

    Attributes
    ----------
    root :
        The root element, ``<robot>``.
    notes :
        Remarks on the file.
    flaws :
        What single joints are that ftforce cannot analyse: it matters in the chain.
    states :
        Named postures that the file itself has, by joint name (rad, m).
    gravity :
        Gravity in root axes, m/s²; ``None`` if the file does not set it.
    incomplete :
        Links that lack a part of their mass, as a file that it follows from cannot be read.
    """

    root: Element
    notes: tuple[str, ...] = ()
    flaws: tuple[Flaw, ...] = ()
    states: States = MappingProxyType({})
    gravity: Numbers | None = None
    incomplete: frozenset[str] = frozenset()


class UniqueNames:
    """Names of links or of joints, each used once."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def new(self, name: str) -> str:
        """Return a name, with a number added if it is taken.

        Parameters
        ----------
        name :
            The name.
        """
        number, free = 2, name
        while free in self._taken:
            number, free = number + 1, f"{name}_{number}"
        self._taken.add(free)
        return free


class JointNumbers(NamedTuple):
    """What a URDF says of a joint besides its place; ``None`` where it is unknown."""

    axis: Vector | None = None
    lower: float | None = None
    upper: float | None = None
    effort: float | None = None
    velocity: float | None = None
    damping: float | None = None
    friction: float | None = None
    armature: float | None = None
    mimic: tuple[str, float, float] | None = None  # leader, multiplier, offset


NO_NUMBERS = JointNumbers()


def add_link(robot: Element, name: str, inertia: pin.Inertia | None, turned: pin.SE3) -> Element:
    """Add a link, and return its element.

    Parameters
    ----------
    robot :
        The root element.
    name :
        Name of the link.
    inertia :
        Mass, centre of mass (which is the origin of ``turned``) and moments; ``None`` for none.
    turned :
        Axes of the moments, in link axes.
    """
    link = SubElement(robot, "link", name=name)
    if inertia is not None:
        body = SubElement(link, "inertial")
        _add_origin(body, turned)
        SubElement(body, "mass", value=repr(float(inertia.mass)))
        I = inertia.inertia  # noqa: E741 # its usual symbol
        moments = (I[0, 0], I[0, 1], I[0, 2], I[1, 1], I[1, 2], I[2, 2])
        values = (repr(float(x)) for x in moments)
        SubElement(body, "inertia", dict(zip(MOMENTS, values, strict=True)))
    return link


def add_joint(
    robot: Element,
    name: str,
    kind: str,
    ends: tuple[str, str],
    at: pin.SE3,
    *,
    numbers: JointNumbers = NO_NUMBERS,
) -> None:
    """Add a joint.

    Parameters
    ----------
    robot :
        The root element.
    name, kind :
        Name and type of the joint.
    ends :
        Parent and child link.
    at :
        Placement in the parent link.
    numbers :
        Axis, limits and the rest.
    """
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=ends[0])
    SubElement(joint, "child", link=ends[1])
    _add_origin(joint, at)
    if numbers.axis is not None:
        SubElement(joint, "axis", xyz=_text(numbers.axis))
    for tag, keys in (
        ("limit", ("lower", "upper", "effort", "velocity")),
        ("dynamics", ("damping", "friction", "armature")),
    ):
        found = {key: getattr(numbers, key) for key in keys}
        given = {key: repr(float(x)) for key, x in found.items() if x is not None}
        if given or (tag == "limit" and kind in {"revolute", "prismatic"}):
            SubElement(joint, tag, given)
    if numbers.mimic is not None:
        leader, multiplier, offset = numbers.mimic
        factors = {"multiplier": repr(float(multiplier)), "offset": repr(float(offset))}
        SubElement(joint, "mimic", {"joint": leader, **factors})


def add_shape(link: Element, at: pin.SE3, shape: str, size: Mapping[str, str]) -> None:
    """Add a shape to a link, for the page.

    Parameters
    ----------
    link :
        Element of the link.
    at :
        Placement in link axes.
    shape, size :
        Element of the geometry, and its attributes.
    """
    visual = SubElement(link, "visual")
    _add_origin(visual, at)
    SubElement(SubElement(visual, "geometry"), shape, dict(size))


def _add_origin(parent: Element, at: pin.SE3) -> None:
    import pinocchio as pin  # imported lazily: a URDF needs nothing of it here

    if not at.isIdentity(0.0):
        rpy = pin.rpy.matrixToRpy(at.rotation)
        SubElement(parent, "origin", xyz=_text(at.translation), rpy=_text(rpy))


def _text(vector: Vector) -> str:
    return " ".join(repr(float(x)) for x in vector)
