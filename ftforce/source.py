"""Text from a user's file, read defensively, and text into one, whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree
from xml.parsers import expat

from ftforce.errors import OutputError

if TYPE_CHECKING:
    from os import PathLike

    from ftforce.errors import FileError


def read_text(path: str | PathLike[str], error: type[FileError], kind: str) -> str:
    """Read a UTF-8 file.

    Parameters
    ----------
    path :
        The file.
    error :
        What to raise.
    kind :
        What the file should be, for messages, e.g. ``"a URDF"``.

    Raises
    ------
    FileError
        Of the type ``error``: the file is missing, unreadable, empty or not UTF-8 text.
    """
    file = Path(path)
    try:
        if not file.exists():
            raise error(path, f"no such file; {kind} was expected")
        if file.is_dir():
            raise error(path, f"is a folder; {kind} was expected")
        if not (file.is_file() or file.is_fifo()):  # a device might never end
            raise error(path, f"is not a regular file; {kind} was expected")
        data = file.read_bytes()
    except (OSError, ValueError) as problem:  # ValueError: a NUL character in the path
        reason = getattr(problem, "strerror", None) or str(problem)
        raise error(path, f"cannot be read ({reason})") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        reason = f"is not UTF-8 text (byte {problem.start}); {kind} was expected"
        raise error(path, reason) from None
    if "\0" in text:
        raise error(path, f"is a binary file; {kind} was expected")
    if not text.strip():
        raise error(path, f"is empty; {kind} was expected")
    return text


def parse_xml(text: str, path: str | PathLike[str], error: type[FileError]) -> ElementTree.Element:
    """Parse XML, refusing document type definitions and with them all entity tricks.

    Raises
    ------
    FileError
        Of the type ``error``: broken XML, or XML with a DTD.
    """
    try:
        _refuse_dtd(text, path, error)
        return ElementTree.fromstring(text)
    except (expat.ExpatError, ElementTree.ParseError) as problem:
        raise error(path, f"is not well-formed XML ({problem})") from None


class _RootReachedError(Exception):
    """Stop parsing: a DTD can stand only before the root element."""


def _refuse_dtd(text: str, path: str | PathLike[str], error: type[FileError]) -> None:
    def on_doctype(*_: object) -> None:
        raise error(path, "contains a DTD (<!DOCTYPE …>), which is refused; remove it")

    def on_root(*_: object) -> None:
        raise _RootReachedError

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = on_doctype
    parser.StartElementHandler = on_root
    with suppress(_RootReachedError):
        parser.Parse(text, True)


def write_whole(path: str | PathLike[str], text: str) -> Path:
    """Write a UTF-8 file, whole or not at all: into a file beside it, which then takes its place.

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left behind and an existing file is as it was.
    """
    import tempfile

    file = Path(path)
    if file.is_dir():
        raise OutputError(path, "cannot be written: it is a folder")
    if file.exists() and not file.is_file():  # a device or pipe cannot be replaced
        return _write_through(file, text)
    try:
        handle, scratch = tempfile.mkstemp(dir=file.parent, prefix=".ftforce-")
    except OSError as problem:
        raise OutputError(path, f"cannot be written ({problem.strerror})") from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as stream:
            stream.write(text)
        Path(scratch).chmod(file.stat().st_mode if file.exists() else 0o666 & ~_umask())
        Path(scratch).replace(file)
    except OSError as problem:
        raise OutputError(path, f"cannot be written ({problem.strerror})") from None
    finally:
        Path(scratch).unlink(missing_ok=True)
    return file


def _write_through(file: Path, text: str) -> Path:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise OutputError(file, f"cannot be written ({problem.strerror})") from None
    return file


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
