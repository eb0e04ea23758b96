"""Conversion of a DH table to URDF and SRDF, using yourdfpy.

Frames
    Each row gives one URDF link. The z axis of link frame i is joint axis i, and the frame moves
    with the joint. The constant transform Rot_z(θ) Trans_z(d) Trans_x(a) Rot_x(α) that follows is
    the origin of the next joint, ``xyz = (a cos θ, a sin θ, d)`` and ``rpy = (α, 0, θ)``: exactly
    the angles of the table. θ and d come from row i; a and α from row i in the standard convention
    and from row i+1 in the modified one, whose first a and α belong to the base. The last transform
    is a fixed joint to the link ``tool``, which is DH frame n; with a flange, it leads to the link
    ``flange``, and a second fixed joint to ``tool``.
Unknown limits and masses
    URDF requires effort and velocity limits; 0 means unknown. Without a mass model the links
    have no ``<inertial>``.
"""

from __future__ import annotations

import math
import re
import shutil
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from xml.etree import ElementTree

import numpy as np

from ftforce.errors import DHTableError, OutputError, URDFError
from ftforce.robot.formats.dh import (
    BASE,
    FLANGE,
    FLANGE_JOINT,
    TIP,
    TIP_JOINT,
    DHTable,
    cos_sin,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from ftforce.core.arrays import Matrix
    from ftforce.robot.formats.dh import Convention, DHFlange, DHRow, MassModel

_Triple: TypeAlias = tuple[float, float, float]
_ZERO = (0.0, 0.0, 0.0)
_SLENDER = (
    0.02  # radius of links of unknown mass, as a share of the arm's length (m if it has none)
)


class Origin(NamedTuple):
    """A constant pose (m, rad) as in URDF, with rotation Rot_z(yaw) Rot_y(pitch) Rot_x(roll)."""

    xyz: _Triple
    rpy: _Triple = _ZERO


class _Rod(NamedTuple):
    """A straight segment of a link: length (m), pose of its centre (z along it), direction."""

    length: float
    origin: Origin
    axis: _Triple


class Body(NamedTuple):
    """A link, and the constant transform from its joint to the next one (rad, m)."""

    name: str
    theta: float
    d: float
    a: float
    alpha: float
    mass: float | None
    centre: _Triple | None = None  # of mass, in the frame of its joint

    @property
    def end(self) -> Origin:
        """Origin of the next joint."""
        c, s = cos_sin(self.theta)
        return Origin((self.a * c, self.a * s, self.d), (self.alpha, 0.0, self.theta))

    @property
    def rods(self) -> tuple[_Rod, ...]:
        """Segments along d and a; empty if the link has no length."""
        c, s = cos_sin(self.theta)
        middle = (self.a * c / 2, self.a * s / 2, self.d)
        upright = _Rod(abs(self.d), Origin((0.0, 0.0, self.d / 2)), (0.0, 0.0, 1.0))
        across = _Rod(abs(self.a), Origin(middle, (0.0, math.pi / 2, self.theta)), (c, s, 0.0))
        return tuple(rod for rod in (upright, across) if rod.length)


def _radius(table: DHTable) -> float:
    """Return the radius that the links are drawn with, m."""
    if table.mass is not None:
        return table.mass.radius
    total = sum(abs(row.a) + abs(row.d) for row in table.rows)
    return _SLENDER * total or _SLENDER


def _inertia_of(body: Body, model: MassModel) -> tuple[float, _Triple, Matrix]:
    """Return mass (kg), centre of mass (m) and inertia about it (kg·m²), shape (3, 3)."""
    r2 = model.radius * model.radius
    rods, density = body.rods, model.density or 0.0
    if not rods:
        mass = body.mass or density * 4 / 3 * math.pi * r2 * model.radius
        return mass, body.centre or _ZERO, 2 / 5 * mass * r2 * np.eye(3)
    lengths = np.array([rod.length for rod in rods])
    centres = np.array([rod.origin.xyz for rod in rods])
    share = lengths / lengths.sum()
    centre = (share[:, None] * centres).sum(axis=0)  # not @: BLAS rounding is platform-dependent
    inertia = np.zeros((3, 3))  # per kg
    for rod, part, arm in zip(rods, share, centres - centre, strict=True):
        thickness = 3 * r2 if model.model == "solid cylinder" else 0.0
        about, across = r2 / 2, (thickness + rod.length * rod.length) / 12
        inertia += part * (across * np.eye(3) + (about - across) * np.outer(rod.axis, rod.axis))
        inertia += part * ((arm * arm).sum() * np.eye(3) - np.outer(arm, arm))  # parallel axes
    mass = body.mass or density * math.pi * r2 * float(lengths.sum())
    x, y, z = body.centre or centre.tolist()
    return mass, (x, y, z), mass * inertia


def _check_inertia(inertia: Matrix, body: Body, model: MassModel, table: DHTable) -> None:
    """Check that an inertia is physical, e.g. not that of a rod thicker than it is long.

    Raises
    ------
    DHTableError
        The principal moments are not positive and finite, or violate the triangle inequality.
    """
    # The triangle inequality holds with equality for a flat disc, hence the slack of 1e-9.
    moments = np.linalg.eigvalsh(inertia) if np.isfinite(inertia).all() else np.zeros(3)
    if not (moments[0] > 0 and moments[2] <= (moments[0] + moments[1]) * (1 + 1e-9)):
        size = f"d = {body.d:g} m, a = {body.a:g} m, radius {model.radius:g} m"
        reason = f"link {body.name!r}: the inertia of a {model.model} of this size is unphysical"
        hint = "a link must be longer than it is thick, and of ordinary size"
        raise DHTableError(table.source or table.name, f"{reason} ({size}); {hint}")


def to_urdf(table: DHTable) -> str:
    """Return the arm as URDF text, written by yourdfpy and verified by reading it back.

    Parameters
    ----------
    table :
        The DH table.

    Raises
    ------
    DHTableError
        The inertia of a link is unphysical.
    URDFError
        yourdfpy rejects the text or reads a different arm from it.
    """
    import yourdfpy

    bodies = _bodies(table)
    origins: list[Origin] = []
    links = [_link(body, table, origins) for body in bodies]
    joints = _joints(table, bodies, origins)
    robot = yourdfpy.Robot(table.name, [*links, yourdfpy.Link(TIP)], joints)
    tree = yourdfpy.URDF(robot, build_scene_graph=False, load_meshes=False).write_xml()
    _write_numbers(tree, origins)
    content = BytesIO()
    tree.write(content, encoding="utf-8", pretty_print=True)
    text = _head(table) + content.getvalue().decode()
    _check_urdf(text, table)
    return text


def to_srdf(table: DHTable) -> str:
    """Return the SRDF text: group ``arm`` (the chain), its postures and the end effector.

    Parameters
    ----------
    table :
        The DH table.
    """
    robot = ElementTree.Element("robot", name=table.name)
    arm = ElementTree.SubElement(robot, "group", name="arm")
    ElementTree.SubElement(arm, "chain", base_link=BASE, tip_link=TIP)
    hand = ElementTree.SubElement(robot, "group", name="hand")
    ElementTree.SubElement(hand, "link", name=TIP)
    for name, q in table.postures.items():
        state = ElementTree.SubElement(robot, "group_state", name=name, group="arm")
        for joint, value in zip(table.joint_names, q.tolist(), strict=True):
            ElementTree.SubElement(state, "joint", name=joint, value=_digits(value))
    end = {"name": TIP, "parent_link": TIP, "group": "hand", "parent_group": "arm"}
    ElementTree.SubElement(robot, "end_effector", end)
    ElementTree.indent(robot)
    return _head(table) + ElementTree.tostring(robot, encoding="unicode") + "\n"


def write_robot(table: DHTable, path: str | PathLike[str]) -> tuple[Path, Path]:
    """Write a URDF and an SRDF of the same name, atomically: both files or neither.

    Parameters
    ----------
    table :
        The arm.
    path :
        Path of the URDF, ending in ``.urdf``. An existing file is replaced, and so is an SRDF
        beside it that was generated from a DH table; another SRDF is not.

    Returns
    -------
    :
        Paths of the URDF and the SRDF.

    Raises
    ------
    OutputError
        A file cannot be written, or the SRDF would replace one that was not generated.
    DHTableError, URDFError
        As in :func:`to_urdf`.
    """
    urdf = Path(path)
    if urdf.suffix.lower() != ".urdf":
        raise OutputError(urdf, "cannot be written: its name must end in .urdf")
    srdf = urdf.with_suffix(".srdf")
    try:
        for target in (urdf, srdf):
            _check_target(target, table.source)
        _check_generated(srdf)
        _replace_together({urdf: to_urdf(table), srdf: to_srdf(table)}, urdf.parent)
    except OSError as error:
        raise OutputError(urdf, f"cannot be written: {error.strerror or error}") from None
    return urdf, srdf


def _bodies(table: DHTable) -> list[Body]:
    rows: list[DHRow | DHFlange] = [*table.rows]
    if table.flange is not None:
        rows.append(table.flange)
    along_z = [(0.0, 0.0), *((row.theta, row.d) for row in rows)]
    along_x = [(row.a, row.alpha) for row in rows]
    along_x.insert(0 if table.convention == "standard" else len(along_x), (0.0, 0.0))
    masses = [None, *(row.mass for row in table.rows)]
    centres = [None, *(_centre_of(row, table.convention) for row in table.rows)]
    if table.flange is not None:  # it has no mass of its own
        masses, centres = [*masses, None], [*centres, None]
    steps = zip(table.link_names[:-1], along_z, along_x, masses, centres, strict=True)
    return [Body(name, *z, *x, mass, centre) for name, z, x, mass, centre in steps]


def _centre_of(row: DHRow, convention: Convention) -> _Triple | None:
    """Return the given centre of mass of a link in the frame of its joint.

    DH frame i is at the end of link i in the standard convention; in the modified one it lies θ and
    d further along the joint axis.
    """
    if row.centre is None:
        return None
    x, y, z = row.centre
    if convention == "standard":
        (c, s) = cos_sin(row.alpha)
        x, y, z = x + row.a, c * y - s * z, s * y + c * z
    c, s = cos_sin(row.theta)
    return c * x - s * y, s * x + c * y, z + row.d


def _link(body: Body, table: DHTable, origins: list[Origin]) -> Any:
    import yourdfpy

    radius = _radius(table)
    link = yourdfpy.Link(body.name)
    is_massless = body.name == BASE or (table.flange is not None and body.name == FLANGE)
    if not is_massless and table.mass is not None:
        with np.errstate(over="ignore", invalid="ignore"):  # _check_inertia rejects the result
            mass, centre, inertia = _inertia_of(body, table.mass)
        _check_inertia(inertia, body, table.mass, table)
        link.inertial = yourdfpy.Inertial(_noted(Origin(centre), origins), mass, inertia)
    for rod in body.rods:
        cylinder = yourdfpy.Geometry(cylinder=yourdfpy.Cylinder(radius, rod.length))
        link.visuals.append(yourdfpy.Visual(None, _noted(rod.origin, origins), cylinder))
    if not is_massless and not body.rods:
        ball = yourdfpy.Geometry(sphere=yourdfpy.Sphere(radius))
        link.visuals.append(yourdfpy.Visual(None, _noted(Origin(_ZERO), origins), ball))
    return link


def _joints(table: DHTable, bodies: list[Body], origins: list[Origin]) -> list[Any]:
    import yourdfpy

    joints = []
    named_rows = zip(table.joint_names, table.rows, strict=True)
    moved_bodies = bodies if table.flange is None else bodies[:-1]
    for (name, row), (parent, child) in zip(named_rows, pairwise(moved_bodies), strict=True):
        origin = _noted(parent.end, origins)
        limit = yourdfpy.Limit(row.effort or 0, row.velocity or 0, row.lower, row.upper)
        moved = (name, row.type, parent.name, child.name, origin, np.array([0, 0, 1]))
        joints.append(yourdfpy.Joint(*moved, limit=limit))
    if table.flange is not None:
        last = moved_bodies[-1]
        origin = _noted(last.end, origins)
        joints.append(yourdfpy.Joint(FLANGE_JOINT, "fixed", last.name, FLANGE, origin))
    origin = _noted(bodies[-1].end, origins)
    return [*joints, yourdfpy.Joint(TIP_JOINT, "fixed", bodies[-1].name, TIP, origin)]


def _noted(origin: Origin, origins: list[Origin]) -> Matrix:
    """Record an origin for :func:`_write_numbers` and return a placeholder for yourdfpy."""
    origins.append(origin)
    return np.eye(4)


def _write_numbers(tree: Any, origins: list[Origin]) -> None:
    # yourdfpy stores an origin as a matrix and recomputes its angles, which loses the last digit of
    # most numbers and the sign of some zeros. The exact numbers replace its placeholders here.
    for element, origin in zip(tree.iter("origin"), origins, strict=True):
        for key, numbers in origin._asdict().items():
            element.set(key, " ".join(map(str, numbers)))
    for element in tree.iter():
        for key, value in element.attrib.items():
            if key not in ("name", "type", "link"):
                element.set(key, " ".join(_digits(float(number)) for number in value.split()))


def _digits(number: float) -> str:
    """Return the shortest text that parses to the same double, without a sign for zero."""
    return repr(number + 0.0).removesuffix(".0")


_GENERATED = "<!-- generated by ftforce dh from"


def _head(table: DHTable) -> str:
    source = "a DH table" if table.source is None else table.source.name
    # XML comments must not contain a double hyphen.
    source = re.sub(r"[^\w. -]|-(?=-)", "_", source)
    comment = f"{_GENERATED} {source}; do not edit -->"
    return f'<?xml version="1.0" encoding="utf-8"?>\n{comment}\n'


def _check_urdf(text: str, table: DHTable) -> None:
    import yourdfpy

    robot = yourdfpy.URDF.load(BytesIO(text.encode()), load_meshes=False)
    if not robot.validate():
        raise URDFError(f"{table.name}.urdf", f"yourdfpy rejects it: {robot.errors[0]}")
    q = np.linspace(0.3, 0.8, len(table.rows))
    robot.update_cfg(q)
    poses = table.transforms(q)
    error = np.abs(robot.get_transform(TIP, BASE) - poses[-1]).max()
    # Not tighter: trimesh, used by yourdfpy, rounds poses within 1e-8 of the identity to it.
    if not error <= 1e-6 * np.abs(poses).max():
        raise URDFError(f"{table.name}.urdf", "its tip position differs from that of the DH table")


def _check_target(target: Path, source: Path | None) -> None:
    if target.exists() and not target.is_file():
        raise OutputError(target, "cannot be written: it exists and is not a regular file")
    if source is not None and target.exists() and source.exists() and target.samefile(source):
        raise OutputError(target, "cannot be written: it is the DH table itself")


def _check_generated(srdf: Path) -> None:
    """Check that an existing SRDF, whose name nobody gave, is one that this module wrote."""
    if not srdf.exists():
        return
    with srdf.open("rb") as stream:
        if _GENERATED.encode() not in stream.read(256):
            raise OutputError(
                srdf,
                "cannot be written: it exists and was not generated from a DH table; move it, or "
                "choose another name for the URDF, beside which the SRDF goes",
            )


def _replace_together(texts: Mapping[Path, str], folder: Path) -> None:
    # A directory next to the targets is on the same file system, where replacing is atomic.
    with TemporaryDirectory(prefix=".ftforce-", dir=folder) as scratch:
        new = {path: Path(scratch, "new-" + path.name) for path in texts}
        old = {path: Path(scratch, "old-" + path.name) for path in texts}
        for path, text in texts.items():
            new[path].write_bytes(text.encode())
            if path.exists():
                shutil.copy2(path, old[path])
        try:
            for path in texts:
                new[path].replace(path)
        except BaseException:
            for path in texts:
                if not new[path].exists():  # already replaced: restore the old file
                    old[path].replace(path) if old[path].exists() else path.unlink()
            raise
