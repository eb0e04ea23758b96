"""MJCF files, through MuJoCo itself: it resolves defaults, frames, angles and inertias.

A body becomes a link with the body's frame, and each of its joints a joint: several joints of one
body, or a joint away from the body's origin, have massless links between them. Sites become links
that are fixed to their body. MuJoCo opens no files: it is given the text of bodies, joints,
actuators, equalities and tendons, with what the file includes, and those meshes on which masses
depend.
"""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ftforce.errors import URDFError, listed, printable
from ftforce.robot.formats.converted import (
    Converted,
    JointNumbers,
    UniqueNames,
    add_joint,
    add_link,
    add_shape,
)
from ftforce.robot.formats.mjcf_text import MjcfText, whole_text
from ftforce.robot.formats.tree import Flaw
from ftforce.robot.stderr import captured_stderr

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from os import PathLike

    from ftforce.core.arrays import Vector

_INSTALL = "to read it, install MuJoCo: pip install 'ftforce[mjcf]'"
_GRAVITY = (0.0, 0.0, -9.81)  # m/s², MuJoCo's and Pinocchio's default
_SMALLEST = 1e-12  # kg and kg·m²: given to bodies without mass, which MuJoCo refuses
_NO_MASS = "mjMINVAL"  # in MuJoCo's message about them
_ALWAYS = 1  # of the compiler's inertiafromgeom
_MOVED = {"hinge": "revolute", "slide": "prismatic"}


def convert(root: Element, path: str | PathLike[str], folders: Iterable[Path]) -> Converted:
    """Return the robot that an MJCF file describes, as a URDF.

    Parameters
    ----------
    root :
        The root element of the file, ``<mujoco>``.
    path :
        The file.
    folders :
        Folders besides the file's own of which files may be opened.

    Raises
    ------
    URDFError
        MuJoCo is not installed or rejects the file, or an included file is missing, malformed or
        lies outside the folders.
    """
    try:
        import mujoco
    except ImportError:
        raise URDFError(path, f"is an MJCF file (<mujoco>); {_INSTALL}") from None
    text = whole_text(root, path, folders)
    try:
        with captured_stderr():
            try:
                model, meshes, keys, is_massless = _compiled(text, mujoco, with_meshes=True)
            except ValueError:  # perhaps because of a mesh
                model, meshes, keys, is_massless = _compiled(text, mujoco, with_meshes=False)
            _check_finite(model)
    except MemoryError:
        raise  # the machine's, not a flaw of the file
    except Exception as problem:  # ValueError or FatalError, by the version of MuJoCo
        raise URDFError(path, f"MuJoCo rejects it: {_reason(problem)}") from None
    return _Conversion(model, mujoco, text, meshes, is_massless).result(keys)


class _Compiled(NamedTuple):
    """A model; its meshes, keyframes, and whether bodies without mass had to be given some."""

    model: Any
    meshes: _Meshes
    keys: list[tuple[str, Vector]]
    is_massless: bool


def _compiled(text: MjcfText, mujoco: Any, *, with_meshes: bool) -> _Compiled:
    """Return MuJoCo's model of a text.

    Parameters
    ----------
    text :
        The text.
    mujoco :
        The library.
    with_meshes :
        Whether meshes that bodies have their mass from are opened.

    Raises
    ------
    ValueError
        MuJoCo rejects it.
    """
    spec = mujoco.MjSpec.from_string(text.xml)
    meshes = _without_meshes(spec, mujoco, text if with_meshes else None)
    keys = [(key.name, np.array(key.qpos)) for key in spec.keys]
    for key in list(spec.keys):
        spec.delete(key)
    spec.compiler.fusestatic = False  # their frames may be the tip
    spec.compiler.discardvisual = False
    spec.compiler.LRopt.mode = 0  # lengths of muscles would be simulated
    try:
        return _Compiled(spec.compile(), meshes, keys, is_massless=False)
    except ValueError as problem:
        if _NO_MASS not in str(problem):
            raise
    spec.compiler.boundmass = spec.compiler.boundinertia = _SMALLEST
    return _Compiled(spec.compile(), meshes, keys, is_massless=True)


def _check_finite(model: Any) -> None:
    """Check what is read of a model, which MuJoCo has computed from finite numbers.

    Raises
    ------
    ValueError
        A number is not finite.
    """
    for what in ("body", "jnt", "site", "geom"):
        for name in ("pos", "quat", "ipos", "iquat", "mass", "inertia", "axis"):
            values = getattr(model, f"{what}_{name}", None)
            if values is not None and not np.isfinite(values).all():
                raise ValueError(f"{name} of a {_IN_WORDS.get(what, what)} is not finite")
    if not np.isfinite(model.qpos0).all():
        raise ValueError("ref of a joint is not finite")


_IN_WORDS = {"jnt": "joint"}


def _reason(problem: Exception) -> str:
    """Return MuJoCo's message in one line, without numbers of lines in the text it was given."""
    lines = str(problem).replace("XML Error:", "").replace("Error:", "").splitlines()
    words = " ".join(part.split(", line ")[0].strip() for part in lines if part.strip())
    return printable(words)[:300] or type(problem).__name__


class _Mesh(NamedTuple):
    """A mesh that a geom shows.

    Attributes
    ----------
    file :
        Its file as written; empty if the model itself has the vertices.
    scale :
        Its scale along its axes.
    name :
        Its name.
    origin, turned :
        Frame of the mesh in that of its vertices: ``refpos``, and ``refquat`` beginning with the
        real part.
    """

    file: str
    scale: tuple[float, ...]
    name: str
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    turned: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)

    @property
    def is_drawn(self) -> bool:
        """Whether a URDF can describe it, which scales a mesh before it is turned."""
        is_straight = not any(self.turned[1:]) or len(set(self.scale)) == 1
        return bool(self.file) and is_straight

    def placement(self) -> pin.SE3:
        """Return the placement of the scaled vertices of the file in the frame of the mesh.

        MuJoCo's vertices are ``S Rᵀ (v - p)``.
        """
        turned = _pose(np.array(self.scale) * self.origin, np.array(self.turned))
        return turned.inverse()


class _Meshes(NamedTuple):
    """The geoms that need files.

    Attributes
    ----------
    shown :
        Their meshes, by the names that the geoms get.
    contents :
        Files that MuJoCo is given, by the names of the meshes.
    without_mass :
        Geoms whose mass follows from a mesh that cannot be read.
    colliding :
        Geoms that collide as the file has them.
    """

    shown: dict[str, _Mesh]
    contents: dict[str, bytes]
    without_mass: set[str]
    colliding: set[str]


def _without_meshes(spec: Any, mujoco: Any, text: MjcfText | None) -> _Meshes:
    """Replace geoms that need files by spheres without mass; return what they were.

    With a text, meshes that decide on a body's mass are kept, in memory.
    """
    kinds = mujoco.mjtGeom
    needing = (kinds.mjGEOM_MESH, kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF)
    for mesh in spec.meshes:
        mesh.name = mesh.name or Path(mesh.file).stem  # MuJoCo's own default
    files = {one.name: _mesh(one) for one in spec.meshes}
    found = _Meshes({}, {}, set(), set())
    for body in spec.bodies:
        for geom in body.geoms:
            if geom.type not in needing and not geom.meshname:
                continue
            mesh = files.get(geom.meshname)
            geom.name = f"mesh {len(found.shown)} of {body.name}"
            if geom.contype or geom.conaffinity:
                found.colliding.add(geom.name)
            geom.contype = geom.conaffinity = 0  # or MuJoCo would compute a convex hull
            found.shown[geom.name] = mesh or _Mesh("", (1.0, 1.0, 1.0), "")
            if _decides_on_mass(spec, body, geom):
                if mesh and text and not mesh.file:  # its vertices are in the text
                    found.contents[mesh.name] = b""
                    continue
                data = text.content(mesh.file) if mesh and text else None
                if mesh and data is not None:
                    found.contents[mesh.name] = data
                    continue
                found.without_mass.add(geom.name)
            geom.type, geom.meshname, geom.hfieldname = kinds.mjGEOM_SPHERE, "", ""
            geom.size, geom.mass = (1e-3, 0.0, 0.0), 0.0
    _give_contents(spec, found.contents)
    return found


def _give_contents(spec: Any, contents: dict[str, bytes]) -> None:
    """Give MuJoCo the content of meshes, and remove all others."""
    assets = {}
    for number, mesh in enumerate(list(spec.meshes)):
        if mesh.name in contents and not mesh.file:
            continue
        if mesh.name in contents:
            mesh.file = f"{number}{Path(mesh.file).suffix.lower()}"
            assets[mesh.file] = contents[mesh.name]
        else:
            spec.delete(mesh)
    spec.meshdir = ""
    spec.assets = assets


def _mesh(mesh: Any) -> _Mesh:
    """Return what is needed of a mesh of MuJoCo."""
    scale, origin, turned = (tuple(x.tolist()) for x in (mesh.scale, mesh.refpos, mesh.refquat))
    return _Mesh(mesh.file, scale, mesh.name, origin, turned)


def _decides_on_mass(spec: Any, body: Any, geom: Any) -> bool:
    """Return whether the mass of a body follows from a geom, among others."""
    first, last = spec.compiler.inertiagrouprange
    counts = geom.density > 0.0 if math.isnan(geom.mass) else geom.mass > 0.0
    always = int(spec.compiler.inertiafromgeom) == _ALWAYS
    return bool(counts and first <= geom.group <= last and (always or not body.explicitinertial))


class _Conversion:
    """One model on its way to a URDF."""

    def __init__(
        self, model: Any, mujoco: Any, text: MjcfText, meshes: _Meshes, is_massless: bool
    ) -> None:
        self.model, self.mujoco, self.text, self.meshes = model, mujoco, text, meshes
        self.is_massless = is_massless
        self.notes = list(text.notes)
        self.flaws: list[Flaw] = []
        links, joints = UniqueNames(), UniqueNames()
        self.links = [links.new(model.body(i).name or f"body{i}") for i in range(model.nbody)]
        self.joints = [joints.new(model.joint(j).name or f"joint{j}") for j in range(model.njnt)]
        self.link_names, self.joint_names = links, joints
        self.kinds = [self.word(mujoco.mjtJoint, kind, "mjJNT_") for kind in model.jnt_type]
        self.mimics = self._mimics()
        self.efforts = self._efforts()

    @staticmethod
    def word(kinds: Any, value: int, prefix: str) -> str:
        """Return the name of one of MuJoCo's constants, e.g. ``hinge``."""
        return str(kinds(int(value)).name).removeprefix(prefix).lower()

    def result(self, keys: list[tuple[str, Vector]]) -> Converted:
        """Return the URDF with all that was found."""
        model = self.model
        robot = Element("robot", name=self.text.name)
        for i in range(model.nbody):
            self._add_body(robot, i)
        self._add_sites(robot)
        self._say_what_is_ignored()
        own = model.opt.gravity.tolist()
        if model.opt.disableflags & self.mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            own = [0.0] * 3
        gravity = None if tuple(own) == _GRAVITY else tuple(own)
        if gravity is not None:
            shown = ", ".join(f"{x:g}" for x in own)
            self.notes.append(f"gravity is that of the file: ({shown}) m/s²")
        states = {name or f"key{k}": self._state(q) for k, (name, q) in enumerate(keys)}
        return Converted(
            robot,
            tuple(self.notes),
            tuple(self.flaws),
            {name: state for name, state in states.items() if state},
            gravity,
            frozenset(self.links[i] for i in self._incomplete()),
        )

    def _incomplete(self) -> Iterator[int]:
        """Yield the bodies that lack the mass of a mesh."""
        for g in range(self.model.ngeom):
            if self.model.geom(g).name in self.meshes.without_mass:
                yield int(self.model.geom_bodyid[g])

    def _state(self, q: Vector) -> dict[str, float]:
        """Return the positions of hinges and slides in a keyframe; none if it does not fit."""
        model = self.model
        if len(q) != model.nq or not np.isfinite(q).all():
            return {}
        return {
            name: float(q[model.jnt_qposadr[j]])
            for j, name in enumerate(self.joints)
            if self.kinds[j] in _MOVED
        }

    # ---- links and joints ----------------------------------------------------------------------

    def _add_body(self, robot: Element, i: int) -> None:
        """Add a body and its joints, the frames of which MuJoCo composes one after the other."""
        model, name = self.model, self.links[i]
        place = _pose(model.body_ipos[i], model.body_iquat[i])
        link = add_link(robot, name, self._inertia(i), place)
        self._add_shapes(link, i)
        if i == 0:
            return
        parent, at = (
            self.links[model.body_parentid[i]],
            _pose(model.body_pos[i], model.body_quat[i]),
        )
        first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
        for j in range(first, first + count):
            before, after = self._around(j)
            is_last = j == first + count - 1 and after.isIdentity(0.0)
            child = name if is_last else self.link_names.new(f"{name}:{self.joints[j]}")
            if child != name:
                add_link(robot, child, None, pin.SE3.Identity())
            self._add_joint(robot, j, (parent, child), at * before)
            parent, at = child, after
        if parent != name:
            fixed = self.joint_names.new(f"{name}_fixed")
            add_joint(robot, fixed, "fixed", (parent, name), at)

    def _around(self, j: int) -> tuple[pin.SE3, pin.SE3]:
        """Return the transforms before and after the motion of a joint by its own coordinate.

        A hinge turns by q - ref about its anchor p: ``T(p) R(a, q - ref) T(-p)``.
        """
        model, kind = self.model, self.kinds[j]
        p, axis = model.jnt_pos[j].copy(), model.jnt_axis[j].copy()
        ref = float(model.qpos0[model.jnt_qposadr[j]])
        if kind == "slide":
            return pin.SE3(np.eye(3), -ref * axis), pin.SE3.Identity()
        if kind == "free":
            return pin.SE3.Identity(), pin.SE3.Identity()
        turned = pin.AngleAxis(-ref, axis).matrix() if kind == "hinge" and ref else np.eye(3)
        return pin.SE3(turned, p), pin.SE3(np.eye(3), -p)

    def _add_joint(self, robot: Element, j: int, ends: tuple[str, str], at: pin.SE3) -> None:
        model, name, kind = self.model, self.joints[j], self.kinds[j]
        if kind not in _MOVED:
            add_joint(robot, name, "floating" if kind == "free" else "fixed", ends, at)
            if kind == "ball":
                reason = f"joint {name!r} is a ball joint, which no single motor drives"
                self.flaws.append(Flaw("joint", name, reason, hides_motion=True))
            return
        lower = upper = None
        if model.jnt_limited[j]:
            lower, upper = model.jnt_range[j].tolist()
        mimic = self.mimics.get(name)
        if mimic is not None and not mimic[0]:  # held by an equality
            lower = upper = mimic[2]
            mimic = None
        is_open = kind == "hinge" and lower is None
        dof = int(model.jnt_dofadr[j])
        numbers = JointNumbers(
            axis=model.jnt_axis[j],
            lower=lower,
            upper=upper,
            effort=self.efforts.get(j),
            damping=float(model.dof_damping[dof]),
            friction=float(model.dof_frictionloss[dof]),
            armature=float(model.dof_armature[dof]),
            mimic=mimic,
        )
        moved = "continuous" if is_open else _MOVED[kind]
        add_joint(robot, name, moved, ends, at, numbers=numbers)

    def _inertia(self, i: int) -> pin.Inertia | None:
        mass, moments = float(self.model.body_mass[i]), self.model.body_inertia[i]
        if i == 0 or mass <= (_SMALLEST if self.is_massless else 0.0):
            return None
        return pin.Inertia(mass, np.zeros(3), np.diag(moments))

    def _add_sites(self, robot: Element) -> None:
        model = self.model
        for s in range(model.nsite):
            if name := model.site(s).name:
                link = self.link_names.new(name)
                at = _pose(model.site_pos[s], model.site_quat[s])
                add_link(robot, link, None, pin.SE3.Identity())
                ends = self.links[model.site_bodyid[s]], link
                add_joint(robot, self.joint_names.new(f"{link}_fixed"), "fixed", ends, at)

    # ---- equalities ----------------------------------------------------------------------------

    def _mimics(self) -> dict[str, tuple[str, float, float]]:
        """Return leader, multiplier and offset of joints that follow; no leader if they stay."""
        model, mimics = self.model, dict[str, tuple[str, float, float]]()
        ignored = []
        for e in range(model.neq):
            kind = self.word(self.mujoco.mjtEq, model.eq_type[e], "mjEQ_")
            if not model.eq_active0[e]:
                continue
            if kind in {"connect", "weld"}:
                self._close_loop(e, kind)
            elif kind == "joint":
                self._follow(e, mimics)
            else:
                ignored.append(model.eq(e).name or kind)
        if ignored:
            self.notes.append(f"equality constraints that are ignored: {listed(ignored)}")
        return mimics

    def _follow(self, e: int, mimics: dict[str, tuple[str, float, float]]) -> None:
        """Read q1 - ref1 = a0 + a1 (q2 - ref2) of two joints."""
        model = self.model
        follower, leader = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        a0, a1, *higher = model.eq_data[e, :5].tolist()
        name, start = self.joints[follower], model.qpos0[model.jnt_qposadr]
        if leader < 0:
            mimics[name] = "", 0.0, float(start[follower]) + a0
        elif any(higher) or name in mimics:
            how = "by a polynomial" if any(higher) else "besides another joint"
            reason = f"joint {name!r} follows {self.joints[leader]!r} {how}, which is not supported"
            self.flaws.append(Flaw("joint", name, reason))
        else:
            offset = float(start[follower]) + a0 - a1 * float(start[leader])
            mimics[name] = self.joints[leader], a1, offset

    def _close_loop(self, e: int, kind: str) -> None:
        """Note the joints between two bodies that are joined; a mocap body is no part of an arm."""
        model = self.model
        one, other = (int(x[e]) for x in (model.eq_obj1id, model.eq_obj2id))
        if model.eq_objtype[e] == self.mujoco.mjtObj.mjOBJ_SITE:
            one, other = (int(model.site_bodyid[s]) for s in (one, other))
        name = model.eq(e).name
        what = f"the {kind} constraint {name!r}" if name else f"a {kind} constraint"
        ends = f"between {self.links[one]!r} and {self.links[other]!r}"
        if max(model.body_mocapid[one], model.body_mocapid[other]) >= 0:
            self.notes.append(f"{what} {ends}, a mocap body, is ignored")
            return
        between = set(self._joints_above(one)) ^ set(self._joints_above(other))
        reason = f"{what} {ends} closes a loop; only open chains can be analysed"
        for j in sorted(between):
            self.flaws.append(Flaw("joint", self.joints[j], reason))

    def _joints_above(self, body: int) -> Iterator[int]:
        model = self.model
        while body:
            first = int(model.body_jntadr[body])
            yield from range(first, first + int(model.body_jntnum[body]))
            body = int(model.body_parentid[body])

    # ---- actuators -----------------------------------------------------------------------------

    def _efforts(self) -> dict[int, float]:
        """Return the largest torque or force of joints: the sum of their actuators' ranges."""
        model = self.model
        ranges: dict[int, Vector] = defaultdict(lambda: np.zeros(2))
        driven, others = set[int](), []
        for a in range(model.nu):
            kind = self.word(self.mujoco.mjtTrn, model.actuator_trntype[a], "mjTRN_")
            if kind not in {"joint", "jointinparent"}:
                others.append(f"{model.actuator(a).name or f'actuator{a}'} ({kind})")
                continue
            j = int(model.actuator_trnid[a, 0])
            driven.add(j)
            ranges[j] += _spread(float(model.actuator_gear[a, 0]), self._force_range(a))
        for j in range(model.njnt):
            if model.jnt_actfrclimited[j]:
                own = model.jnt_actfrcrange[j]
                ranges[j] = np.clip(ranges[j], *own) if j in driven else own.copy()
        if others:
            self.notes.append(
                f"actuators that do not act on a joint directly are ignored: {listed(others)}"
            )
        without = [name for j, name in enumerate(self.joints) if self._lacks_motor(j, ranges)]
        if without:
            self.notes.append(f"effort limits are unknown, as no actuator acts: {listed(without)}")
        return self._least(ranges)

    def _lacks_motor(self, j: int, ranges: Mapping[int, Vector]) -> bool:
        is_driven = j in ranges or self.joints[j] in self.mimics
        return self.kinds[j] in _MOVED and not is_driven

    def _least(self, ranges: dict[int, Vector]) -> dict[int, float]:
        """Return the smaller of the limits in both directions, and say where they differ."""
        efforts, uneven = {}, []
        for j, (low, high) in ranges.items():
            effort = min(-low, high)
            if 0.0 < effort < math.inf:
                efforts[j] = float(effort)
            if -low != high and self.kinds[j] in _MOVED:
                uneven.append(f"{self.joints[j]} {low:g} to {high:g}")
        if uneven:
            words = "efforts that differ by direction count as the smaller one, if it is positive"
            self.notes.append(f"{words}: {listed(uneven)}")
        return efforts

    def _force_range(self, a: int) -> tuple[float, float]:
        """Return the forces of an actuator; infinite where the file does not limit them."""
        model, mujoco = self.model, self.mujoco
        low, high = -math.inf, math.inf
        gain = self.word(mujoco.mjtGain, model.actuator_gaintype[a], "mjGAIN_")
        bias = self.word(mujoco.mjtBias, model.actuator_biastype[a], "mjBIAS_")
        dynamics = self.word(mujoco.mjtDyn, model.actuator_dyntype[a], "mjDYN_")
        is_motor = (gain, bias) == ("fixed", "none") and dynamics in {
            "none",
            "filter",
            "filterexact",
        }
        if is_motor and model.actuator_ctrllimited[a]:
            gain_of = float(model.actuator_gainprm[a, 0])
            low, high = _spread(gain_of, model.actuator_ctrlrange[a].tolist()).tolist()
        if model.actuator_forcelimited[a]:
            own = model.actuator_forcerange[a].tolist()
            low, high = max(low, own[0]), min(high, own[1])
        return low, high

    # ---- the page, and what is left --------------------------------------------------------------

    def _add_shapes(self, link: Element, i: int) -> None:
        """Add the shapes of a body: its visual geoms, or all if it has no others."""
        model = self.model
        first = int(model.body_geomadr[i])
        geoms = range(first, first + int(model.body_geomnum[i]))
        for g in [g for g in geoms if not self._collides(g)] or geoms:
            at = _pose(model.geom_pos[g], model.geom_quat[g])
            mesh = self.meshes.shown.get(model.geom(g).name)
            if mesh is not None:
                self._add_mesh(link, at, mesh)
                continue
            kind = self.word(self.mujoco.mjtGeom, model.geom_type[g], "mjGEOM_")
            for shape, place, size in _shapes(kind, model.geom_size[g].tolist()):
                sizes = {key: " ".join(map(repr, x)) for key, x in size.items()}
                add_shape(link, at * pin.SE3(np.eye(3), np.array(place)), shape, sizes)

    def _collides(self, g: int) -> bool:
        model = self.model
        is_colliding = bool(model.geom_contype[g] or model.geom_conaffinity[g])
        return is_colliding or model.geom(g).name in self.meshes.colliding

    def _add_mesh(self, link: Element, at: pin.SE3, mesh: _Mesh) -> None:
        """Add a mesh; one that is missing, or that a URDF cannot describe, is a rod in the page."""
        if not mesh.name:  # a height field is no part of an arm
            return
        given = {}
        if mesh.is_drawn:
            file = self.text.mesh(mesh.file) or self.text.missing(mesh.file)
            given = {"filename": str(file), "scale": " ".join(map(repr, mesh.scale))}
        add_shape(link, at * self._uncentred(mesh) * mesh.placement(), "mesh", given)

    def _uncentred(self, mesh: _Mesh) -> pin.SE3:
        """Return the frame of a mesh file in that of its geom, which MuJoCo moves to its centre."""
        if mesh.name not in self.meshes.contents:
            return pin.SE3.Identity()
        m = self.model.mesh(mesh.name).id
        return _pose(self.model.mesh_pos[m], self.model.mesh_quat[m]).inverse()

    def _say_what_is_ignored(self) -> None:
        model = self.model
        springs = [
            name
            for j, name in enumerate(self.joints)
            if self.kinds[j] in _MOVED and np.any(model.jnt_stiffness[j])
        ]
        tendons = [model.tendon(t).name or f"tendon{t}" for t in range(model.ntendon)]
        floated = [self.links[i] for i in np.flatnonzero(model.body_gravcomp)]
        for names, what in (
            (tendons, "tendons"),
            (springs, "springs of joints (stiffness)"),
            (floated, "gravity compensation (gravcomp) of bodies"),
        ):
            if names:
                self.notes.append(f"{what} are ignored: {listed(names)}")


def _pose(position: Vector, quaternion: Vector) -> pin.SE3:
    """Return the placement of a MuJoCo frame, whose quaternions begin with the real part."""
    w, x, y, z = quaternion.tolist()
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), position.copy())


def _spread(factor: float, ends: tuple[float, float] | list[float]) -> Vector:
    """Return a range multiplied by a factor, which may be negative; 0 times infinity is 0."""
    products = [0.0 if factor == 0.0 else factor * end for end in ends]
    return np.array(sorted(products))


_Shape = tuple[str, tuple[float, float, float], dict[str, tuple[float, ...]]]
_HERE = (0.0, 0.0, 0.0)


def _shapes(kind: str, size: list[float]) -> list[_Shape]:
    """Return the shapes of a geom as a URDF has them: MuJoCo's sizes are halves."""
    a, b, c = size
    if kind == "box":
        return [("box", _HERE, {"size": (2 * a, 2 * b, 2 * c)})]
    ball: _Shape = ("sphere", _HERE, {"radius": (a,)})
    if kind == "sphere":
        return [ball]
    tube: _Shape = ("cylinder", _HERE, {"radius": (a,), "length": (2 * b,)})
    if kind == "cylinder":
        return [tube]
    if kind == "capsule":
        return [tube, *((ball[0], (0.0, 0.0, z), ball[2]) for z in (-b, b))]
    if kind == "ellipsoid":  # not of URDFs, but the page draws it
        return [("ellipsoid", _HERE, {"radii": (a, b, c)})]
    return []  # a plane has no size
