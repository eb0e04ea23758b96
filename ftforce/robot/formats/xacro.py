"""Expansion of xacro files, by xacrodoc.

A xacro file is a program: it evaluates Python expressions and includes other files. Only files
whose name ends in ``.xacro`` are expanded; a URDF never is.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Mapping
from contextlib import redirect_stderr, suppress
from io import StringIO, TextIOBase
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import InputError, URDFError, listed, printable
from ftforce.io.text import read_text
from ftforce.io.xml_text import XmlFile, parse_xml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import TextIO
    from xml.dom.minidom import Document

    from xacrodoc import XacroDoc

_INSTALL = "to expand it, install xacrodoc: pip install 'ftforce[xacro]'"
_NO_PACKAGE = r"Package not found: (\S+)"
_NO_ARGUMENT = r"[Uu]ndefined substitution argument (\S+)"
_DECLARED = r"""<xacro:arg\s[^>]*?\bname\s*=\s*["']([^"']+)"""
_USED = r"\$\(\s*arg\s+([^\s)]+)"
_WARNING = r"^\W*(?:\[\d*m)?warning: (.*?)\s*$"
_MOST_WARNINGS = 5
_expanding = threading.Lock()  # xacro keeps its state in globals


class XacroOptions(NamedTuple):
    """What a xacro file needs besides itself.

    Attributes
    ----------
    args :
        Values of its ``<xacro:arg>``, with their names.
    packages :
        Folders in which, and below which, ``$(find package)`` looks for packages.
    are_shared :
        Whether the values are for another file, too, so that some may be unknown.
    """

    args: tuple[tuple[str, str], ...] = ()
    packages: tuple[Path, ...] = ()
    are_shared: bool = False

    @classmethod
    def of(
        cls,
        args: Mapping[str, object] | None,
        package_path: str | PathLike[str] | Iterable[str | PathLike[str]] | None,
    ) -> XacroOptions:
        """Return checked options.

        Parameters
        ----------
        args :
            Values by name; booleans become ``true`` and ``false``.
        package_path :
            A folder, or several.

        Raises
        ------
        InputError
            A folder does not exist, or the arguments have no names.
        """
        if isinstance(package_path, (str, PathLike)):
            package_path = [package_path]
        try:
            folders = tuple(Path(folder) for folder in package_path or ())
        except TypeError:
            raise InputError(
                f"the package path is a folder or several, got {package_path!r}"
            ) from None
        if not (args is None or isinstance(args, Mapping)):
            raise InputError(f"args are those of a xacro file, {{name: value}}, got {args!r}")
        for folder in folders:
            if not folder.is_dir():
                raise InputError(f"the package path {printable(folder)} is not a folder")
        given = tuple((str(name), _word(value)) for name, value in (args or {}).items())
        return cls(given, folders)


PLAIN = XacroOptions()
"""No options: those of every file that is not a xacro file."""


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def is_xacro(path: str | PathLike[str]) -> bool:
    """Return whether a file is one to expand, by its name.

    Parameters
    ----------
    path :
        The file.
    """
    return str(path).lower().endswith(".xacro")


def expand(path: str | PathLike[str], options: XacroOptions) -> XmlFile:
    """Return the root element of the URDF that a xacro file describes, and what xacro warns of.

    Packages are looked for in the given folders, then among the parent folders of the file, then
    where ROS has them; by their package.xml, or else by the name of the folder.

    Parameters
    ----------
    path :
        The file.
    options :
        What it needs besides itself.

    Raises
    ------
    URDFError
        xacrodoc is not installed, or xacro cannot expand the file.
    InputError
        The file has no argument of a given name: xacro itself would ignore the value.
    """
    try:
        from xacrodoc import packages
    except ImportError:
        raise URDFError(path, f"is a xacro file; {_INSTALL}") from None
    text = read_text(path, URDFError, "a xacro file")
    printed = _OfThisThread(sys.stderr)
    with _expanding, redirect_stderr(printed):
        before = packages._finder
        try:
            packages.reset()
            packages.walk_up_from(path)
            if options.packages:
                packages.look_in([str(folder) for folder in options.packages])
            found = _expanded(text, path, options)
            _find_meshes(found.dom, packages.get_path)
            expanded = found.dom.toxml()
            _check_arguments(text, path, options)
        except (MemoryError, InputError):
            raise  # the machine's or the caller's, not a flaw of the file
        except Exception as problem:  # whatever a program may raise
            raise URDFError(path, _reason(problem, options)) from None
        finally:
            packages._finder = before  # what others who use xacrodoc have set
    return XmlFile(parse_xml(expanded, path, URDFError), tuple(_warnings(printed.text())))


class _OfThisThread(TextIOBase):
    """Keeps what the thread that made it prints; what others print goes on to the stream."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream, self._kept, self._owner = stream, StringIO(), threading.get_ident()

    def write(self, text: str) -> int:
        """Write a text."""
        if threading.get_ident() == self._owner:
            return self._kept.write(text)
        return len(text) if self._stream is None else self._stream.write(text)

    def text(self) -> str:
        """Return what was kept."""
        return self._kept.getvalue()


def _warnings(printed: str) -> Iterator[str]:
    """Yield what xacro warned of, once; it says so for every use of a macro."""
    found = dict.fromkeys(re.findall(_WARNING, printed, re.MULTILINE))
    if found:
        yield f"xacro warns: {printable('; '.join([*found][:_MOST_WARNINGS]))}"


def _check_arguments(text: str, path: str | PathLike[str], options: XacroOptions) -> None:
    """Check that the file, or one that it includes, has the arguments that are given.

    Raises
    ------
    InputError
        It has none of that name.
    """
    import xacro

    if not options.args or options.are_shared:
        return
    texts = [text]
    for file in dict.fromkeys(xacro.all_includes):
        with suppress(OSError, UnicodeError):
            texts.append(Path(file).read_text(encoding="utf-8"))
    declared, used = (
        dict.fromkeys(name for one in texts for name in re.findall(pattern, one))
        for pattern in (_DECLARED, _USED)
    )
    for name, _ in options.args:
        if name not in {*declared, *used}:
            has = f"only {listed(map(printable, declared))}" if declared else "nor any other"
            raise InputError(f"{printable(path)} has no argument {printable(repr(name))}, {has}")


def _expanded(text: str, path: str | PathLike[str], options: XacroOptions) -> XacroDoc:
    """Return the expanded document; packages may be known by the names of their folders alone."""
    import xacro
    from xacrodoc import XacroDoc, packages

    named = {folder.name: folder for folder in _folders(path, options)}
    while True:
        xacro.init_stacks(str(path))  # what it includes is relative to it
        xacro.all_includes.clear()
        try:
            return XacroDoc.from_string(text, dict(options.args), resolve_packages=False)
        except Exception as problem:
            missing = re.search(_NO_PACKAGE, str(problem))
            if missing is None or missing[1] not in named:
                raise
            packages.update_package_cache({missing[1]: named.pop(missing[1])})


def _folders(path: str | PathLike[str], options: XacroOptions) -> Iterator[Path]:
    """Yield the folders that may be packages by their name: parents of the file, those given."""
    yield from Path(path).absolute().parents
    for folder in options.packages:
        yield folder.absolute()
        yield from (one.absolute() for one in folder.iterdir() if one.is_dir())


def _find_meshes(document: Document, path_of: Callable[[str], str]) -> None:
    """Replace ``package://`` by paths, where the package is found."""
    for mesh in document.getElementsByTagName("mesh"):
        scheme, separator, rest = mesh.getAttribute("filename").partition("package://")
        package, slash, file = rest.partition("/")
        if separator and slash and not scheme:
            with suppress(Exception):  # the geometry is not needed; what is missing is a rod
                mesh.setAttribute("filename", str(Path(path_of(package), file).absolute()))


def _reason(problem: Exception, options: XacroOptions) -> str:
    """Return why a file cannot be expanded, in one line, with what helps."""
    words = " ".join(str(problem).split()) or type(problem).__name__
    if found := re.search(_NO_PACKAGE, words):
        where = listed(map(str, options.packages), most=3)
        places = f" in {where}" if options.packages else ""
        return (
            f"needs the package {found[1]!r}, which is not found{places}; name a folder above it "
            "with --package-path DIR (package_path=)"
        )
    if found := re.search(_NO_ARGUMENT, words):
        return (
            f"needs a value for its argument {found[1]!r}: give it with --arg {found[1]}=VALUE "
            f"(args={{{found[1]!r}: …}})"
        )
    return f"cannot be expanded by xacro: {printable(words)[:300]}"
