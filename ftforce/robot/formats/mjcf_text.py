"""The text of an MJCF file with what it includes, and without what ftforce does not use.

MuJoCo opens whatever file a model names, by any path; here files are opened only in the folder of
the main file, below it, and in the folders that the user names.
"""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

from ftforce.errors import URDFError, listed, printable
from ftforce.io.text import read_bytes, shortened
from ftforce.io.xml_text import read_xml

if TYPE_CHECKING:
    from collections.abc import Iterable
    from os import PathLike
    from xml.etree.ElementTree import Element

_MOST_ELEMENTS = 20_000  # for which MuJoCo takes some seconds
_MOST_BODIES = 5_000  # as links of a URDF
_DEEPEST = 200  # elements
_MOST_FILES = 100
_MESHES = (".stl", ".obj", ".msh")
_LARGEST_MESH = 20_000_000  # bytes
_MOST_DIGITS = 1_000_000  # characters of one attribute

# Of a model, sections that decide on kinematics, masses and motors.
_SECTIONS = frozenset(
    {"compiler", "option", "default", "asset", "worldbody", "equality", "tendon", "actuator"}
    | {"keyframe"}
)
_UNUSED = {  # elements that are left out, by the section or element that holds them
    "asset": frozenset({"texture", "material", "hfield", "skin", "model"}),
    "body": frozenset({"camera", "light"}),
    "default": frozenset({"material", "camera", "light", "pair"}),
    "compiler": frozenset({"lengthrange"}),
}
_GENERATED = frozenset({"composite", "flexcomp"})
_FILES = frozenset({"material", "hfield", "user"})  # attributes for what is left out
_NAMES = frozenset({"name", "class", "childclass", "file", "content_type", "model"})
_OUTSIDE = (
    "which lies outside the file's folder; name a folder that holds it with --package-path DIR "
    "(package_path=)"
)


class MjcfText(NamedTuple):
    """Text for MuJoCo.

    Attributes
    ----------
    xml :
        The document.
    name :
        Name of the model.
    notes :
        What was left out.
    folders :
        The folder of the file and those in which files may be opened.
    meshdir :
        Folder of the meshes, relative to the file.
    """

    xml: str
    name: str
    notes: tuple[str, ...]
    folders: tuple[Path, ...]
    meshdir: str

    def mesh(self, name: str) -> Path | None:
        """Return the path of a mesh file; ``None`` if there is none in the folders.

        Parameters
        ----------
        name :
            The file as the model names it.
        """
        found = _find(f"{self.meshdir}/{name}" if self.meshdir else name, self.folders)
        return found if isinstance(found, Path) else None

    def missing(self, name: str) -> Path:
        """Return the path at which a mesh that is not in the folders is missed.

        Parameters
        ----------
        name :
            The file as the model names it.
        """
        return self.folders[0] / Path(name).name

    def content(self, name: str) -> bytes | None:
        """Return the content of a mesh file that MuJoCo can read; ``None`` if there is none.

        Parameters
        ----------
        name :
            The file as the model names it.
        """
        path = self.mesh(name)
        if path is None or path.suffix.lower() not in _MESHES:
            return None
        try:
            return read_bytes(path, URDFError, "a mesh", _LARGEST_MESH)
        except URDFError:
            return None


def whole_text(root: Element, path: str | PathLike[str], folders: Iterable[Path]) -> MjcfText:
    """Return the text of a model for MuJoCo.

    Parameters
    ----------
    root :
        The root element of the file, which is changed.
    path :
        The file.
    folders :
        Folders besides the file's own of which files may be opened.

    Raises
    ------
    URDFError
        An included file is missing, malformed or outside the folders; the model is too large or too
        deep, attaches other models, or has numbers that are not finite.
    """
    name = root.get("model", "").strip() or Path(path).stem
    own = Path(path).absolute().parent
    allowed = tuple(folder.resolve() for folder in (own, *folders))
    _include(root, path, allowed)
    _check_size(root, path)
    notes = _prune(root, path)
    _check_numbers(root, path)
    meshdir = ""
    for compiler in root.findall("compiler"):
        meshdir = compiler.get("meshdir", compiler.get("assetdir", meshdir))
    xml = ElementTree.tostring(root, encoding="unicode")
    label = "".join(letter if letter.isprintable() else "?" for letter in name)
    return MjcfText(xml, label, notes, allowed, meshdir)


# ---- includes ----------------------------------------------------------------------------------


def _include(root: Element, path: str | PathLike[str], folders: tuple[Path, ...]) -> None:
    """Replace every ``<include>`` by what is in its file, which is included only once."""
    seen = {Path(path).resolve()}
    waiting = [(root, folders[0])]
    while waiting:
        parent, folder = waiting.pop()
        queue = [(child, folder) for child in reversed(parent)]
        children = []
        while queue:
            child, at = queue.pop()
            if child.tag == "include":
                file = _included(child.get("file", ""), path, (folders[0], at), folders)
                if file in seen or len(seen) > _MOST_FILES:
                    what = "twice" if file in seen else f"more than {_MOST_FILES} files"
                    raise URDFError(path, f"includes {printable(file.name)} {what}")
                seen.add(file)
                inner = read_xml(file, URDFError, "an MJCF file").root
                queue += [(one, file.parent) for one in reversed(inner)]
            else:
                children.append(child)
                waiting.append((child, at))
        parent[:] = children


def _included(
    name: str, path: str | PathLike[str], bases: Iterable[Path], folders: tuple[Path, ...]
) -> Path:
    found = _find(name, folders, bases)
    if isinstance(found, Path):
        return found
    if found:
        raise URDFError(path, f"includes {shortened(name)}, {_OUTSIDE}")
    raise URDFError(path, f"includes {shortened(name)}, of which there is no file")


def _find(name: str, folders: tuple[Path, ...], bases: Iterable[Path] = ()) -> Path | bool:
    """Return the file of a name in the folders, or else whether it lies outside them."""
    is_outside = False
    for base in (*bases, *folders):
        try:
            file = (base / name.replace("\\", "/")).resolve()
            if not any(file.is_relative_to(folder) for folder in folders):
                is_outside = True
            elif file.is_file():
                return file
        except (OSError, ValueError, RuntimeError):  # too long, a loop of links
            continue
    return is_outside


# ---- what MuJoCo is given ----------------------------------------------------------------------


def _check_size(root: Element, path: str | PathLike[str]) -> None:
    """Check number and depth of elements, and of the bodies that ``<replicate>`` makes."""
    waiting = [(root, 1, 1)]
    elements = bodies = 0
    while waiting:
        element, depth, copies = waiting.pop()
        if element.tag == "replicate":
            count = element.get("count", "1").strip()
            copies *= max(int(count), 1) if count.isascii() and count[:9].isdigit() else 1
        elements += copies
        bodies += copies * (element.tag == "body")
        if elements > _MOST_ELEMENTS or bodies > _MOST_BODIES:
            raise URDFError(
                path,
                f"has more than {_MOST_BODIES} bodies or {_MOST_ELEMENTS} elements, replicated "
                "ones included",
            )
        if depth > _DEEPEST:
            raise URDFError(path, f"is nested more than {_DEEPEST} elements deep")
        waiting += [(child, depth + 1, copies) for child in element]


def _prune(root: Element, path: str | PathLike[str]) -> tuple[str, ...]:
    """Remove what is not used, and return notes on that which could matter."""
    root[:] = [child for child in root if child.tag in _SECTIONS]
    lost: dict[str, None] = {}
    for parent in root.iter():
        kept = []
        for child in parent:
            if child.tag == "attach":
                raise URDFError(
                    path,
                    "attaches another model (<attach>), which is not supported; let MuJoCo save it "
                    "as one file: mujoco.MjSpec.from_file(FILE), compile(), to_xml()",
                )
            if child.tag in _GENERATED or child.tag == "plugin":
                lost[f"<{child.tag}>"] = None
            elif child.tag not in _UNUSED.get(_section(parent), ()):
                kept.append(child)
        parent[:] = kept
        for key in _FILES & parent.attrib.keys():
            del parent.attrib[key]
    return (f"parts of the model that are ignored: {listed(lost)}",) if lost else ()


def _section(element: Element) -> str:
    in_body = {"worldbody", "body", "frame", "replicate"}
    return "body" if element.tag in in_body else str(element.tag)


def _check_numbers(root: Element, path: str | PathLike[str]) -> None:
    """Check that all numbers are finite: of others MuJoCo warns in a file, and goes on."""
    for element in root.iter():
        for key, text in element.attrib.items():
            if key in _NAMES:
                continue
            if len(text) > _MOST_DIGITS:
                raise URDFError(path, f"<{element.tag}>: {key} is too long")
            if not key.endswith("range") and not _is_finite(text):
                raise URDFError(path, f"<{element.tag}>: {key} {shortened(text)} is not finite")
            if "nan" in text.lower().split():
                raise URDFError(path, f"<{element.tag}>: {key} {shortened(text)} is not a number")


def _is_finite(text: str) -> bool:
    """Return whether the numbers in a text are finite; words do not count."""
    for word in text.split():
        with suppress(ValueError):
            if not math.isfinite(float(word)):
                return False
    return True
