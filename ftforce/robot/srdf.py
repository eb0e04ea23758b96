"""Reading of SRDF files: end effectors, chains and named postures; and where MoveIt keeps them."""

from __future__ import annotations

import os
from contextlib import suppress
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import SRDFError, listed, printable
from ftforce.io.text import check_name, read_numbers
from ftforce.io.xml_text import read_xml

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from os import PathLike
    from xml.etree.ElementTree import Element

    from ftforce.robot.formats.tree import UrdfTree


_CHOOSE = "--srdf or srdf= chooses"
_IS_XACRO = "is a xacro file, so it is evaluated only on request"
_ARE_XACRO = "are xacro files, so they are evaluated only on request"
_LEVELS = 4  # from a description to the package.xml of its package, at most
_MOST = 500  # entries of a folder that are looked at, and SRDFs that are opened


class Srdf(NamedTuple):
    """The parts of an SRDF that ftforce uses.

    Attributes
    ----------
    path :
        Path of the file; empty if there is none.
    name :
        Name of the robot that it is for.
    end_effectors :
        Parent links of the end effectors.
    chains :
        Pairs of base link and tip link.
    states :
        Joint positions (rad, m) of every named posture, by joint name. States of several groups
        with the same name form one posture; where they differ, the last one applies.
    """

    path: str = ""
    name: str = ""
    end_effectors: tuple[str, ...] = ()
    chains: tuple[tuple[str, str], ...] = ()
    states: Mapping[str, Mapping[str, float]] = MappingProxyType({})

    def fits(self, tree: UrdfTree) -> bool:
        """Return whether anything that it names is in a URDF.

        Parameters
        ----------
        tree :
            Contents of the URDF.
        """
        links = {*self.end_effectors, *(link for ends in self.chains for link in ends)}
        joints = {joint for state in self.states.values() for joint in state}
        return not (links or joints) or bool(links & {*tree.links} or joints & {*tree.joints})


def read_srdf(path: str | PathLike[str]) -> Srdf:
    """Read an SRDF.

    Raises
    ------
    SRDFError
        The file cannot be read, is not an SRDF, or has joint values that are not finite numbers.
    """
    return srdf_of(read_xml(path, SRDFError, "an SRDF").root, path)


def srdf_of(root: Element, path: str | PathLike[str]) -> Srdf:
    """Return the parts of an SRDF, given by its root element, that ftforce uses.

    Raises
    ------
    SRDFError
        As in `read_srdf`.
    """
    if root.tag != "robot":
        raise SRDFError(path, f"is not an SRDF: its root element is <{root.tag}>, not <robot>")
    ends = [e.get("parent_link", "") for e in root.iter("end_effector")]
    chains = [(e.get("base_link", ""), e.get("tip_link", "")) for e in root.iter("chain")]
    states: dict[str, dict[str, float]] = {}
    named = [("link", link) for link in (*ends, *(link for pair in chains for link in pair))]
    named += [("state", state.get("name", "")) for state in root.iter("group_state")]
    try:
        for kind, name in named:
            check_name(name, kind)
    except ValueError as problem:
        raise SRDFError(path, str(problem)) from None
    for state in root.iter("group_state"):
        states.setdefault(state.get("name", ""), {}).update(_values(state, path))
    return Srdf(
        str(path),
        root.get("name", ""),
        tuple(dict.fromkeys(filter(None, ends))),
        tuple(dict.fromkeys(chain for chain in chains if all(chain))),
        MappingProxyType({name: MappingProxyType(q) for name, q in states.items() if name.strip()}),
    )


def find_moveit(tree: UrdfTree, beside: Path) -> tuple[Srdf, str]:
    """Return the SRDF in the MoveIt configuration of a robot, and a note about what was found.

    It is looked for where MoveIt's setup assistant puts it, ``*moveit*config*/config/*.srdf``: in
    the package of the description, beside it, and beside the folder around it, nearest first. It
    must name the same robot. Nothing is searched for a description outside of a package.

    Where there is only a xacro file (``.srdf.xacro``), the note says how to read it: it is a
    program, so it is not evaluated unless the user names it.

    Parameters
    ----------
    tree :
        Contents of the URDF or xacro file.
    beside :
        Path of an SRDF beside it, where there is none.
    """
    robot = tree.name
    programs = [program] if os.path.lexists(program := f"{beside}.xacro") else []
    for folder in _around(Path(tree.path)):
        files = list(_files(folder))
        found = list(_srdfs_for(robot, files))
        strange = [one for one in found if not one.fits(tree)]  # e.g. without a prefix
        if strange and len(strange) == len(found):
            path = printable(_short(found[0].path))
            return Srdf(), f"{path} is not read: none of its links and joints are in the URDF"
        found = [one for one in found if one not in strange]
        paths = [_short(one.path) for one in found]
        if len(found) == 1:
            note = f"tip and postures are those of {printable(paths[0])}; {_CHOOSE} another SRDF"
            return found[0], note
        if found:
            note = f"{len(found)} SRDFs are for {robot!r}, so none is read: {listed(paths)}"
            return Srdf(), f"{note}; {_CHOOSE} one"
        programs += _programs_for(robot, files)
    if not programs:
        return Srdf(), ""
    paths = [_short(one) for one in dict.fromkeys(map(os.path.abspath, programs))]
    if len(paths) == 1:
        return Srdf(), f"{listed(paths)} {_IS_XACRO}: {_CHOOSE} it"
    return Srdf(), f"{listed(paths)} {_ARE_XACRO}: {_CHOOSE} one"


def _short(path: str) -> str:
    return min(path, os.path.relpath(path), key=len)


def _around(description: Path) -> Iterator[Path]:
    """Yield the package of a description, and the two folders above; nothing outside a package."""
    parents = list(islice(Path(os.path.realpath(description)).parents, _LEVELS))
    for package in parents:
        if (package / "package.xml").is_file():
            yield from (package, *islice(package.parents, 2))
            return


def _files(folder: Path) -> Iterator[Path]:
    """Yield the files in the MoveIt configurations that are, or are in, a folder."""
    for package in [folder, *(folder / name for name in sorted(_entries(folder)))]:
        if "moveit" in package.name and "config" in package.name and not package.is_symlink():
            for name in sorted(_entries(package / "config")):
                path = package / "config" / name
                if not path.is_symlink():
                    yield path


def _srdfs_for(robot: str, files: Iterable[Path]) -> Iterator[Srdf]:
    """Yield the SRDFs of a robot."""
    for path in files:
        if path.suffix.lower() == ".srdf":
            with suppress(SRDFError):  # another robot's may be malformed
                if (srdf := read_srdf(path)).name == robot:
                    yield srdf


def _programs_for(robot: str, files: Iterable[Path]) -> Iterator[str]:
    """Yield the xacro files of SRDFs that are a robot's, or whose name only xacro can tell."""
    for path in files:
        if path.name.lower().endswith(".srdf.xacro"):
            with suppress(SRDFError):
                name = read_xml(path, SRDFError, "an SRDF").root.get("name", "")
                if name == robot or "$" in name:
                    yield str(path)


def _entries(folder: Path) -> list[str]:
    """Return the names in a folder, not too many; none if it cannot be read or is a link."""
    try:
        with os.scandir(folder) as entries:
            return [] if folder.is_symlink() else [one.name for one in islice(entries, _MOST)]
    except OSError:
        return []


def _values(state: Element, path: str | PathLike[str]) -> dict[str, float]:
    values = {}
    for joint in state.iter("joint"):
        name, value = joint.get("name", ""), joint.get("value", "")
        if len(value.split()) > 1:  # a floating or planar joint, which is held fixed
            continue
        try:
            values[name] = read_numbers(value, 1)[0]
        except ValueError as problem:
            where = f"state {state.get('name')!r}, joint {name!r}"
            raise SRDFError(path, f"{where}: value {problem}") from None
    return values
