"""The files of a command line: what it reads, what it writes, and that writing destroys no input.

This is the one place that knows the files of all commands, by the names of their parameters.
"""

from __future__ import annotations

import os
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import TYPE_CHECKING, Any

import typer

from ftforce.errors import OutputError, printable
from ftforce.io.text import is_folder

if TYPE_CHECKING:
    from collections.abc import Iterator

INPUTS = {
    "robot": "the robot",
    "robots": "a robot",
    "package_path": "a package",
    "srdf": "the SRDF",
    "table": "the DH table",
    "trajectory": "the trajectory",
    "postures": "the postures",
    "limits": "the torque limits",
    "within": "the position limits",
    "friction": "the friction",
    "payload": "the payload",
    "history": "the history",
    "sweep": "the stored sweep",
}
"""Parameters that can name a file to read, and what it holds."""

OUTPUTS = {
    "output": "--output",
    "plot": "--plot",
    "export": "--export",
    "screenshot": "--screenshot",
}
"""Parameters that name a file to write, and their options."""

_WORDS = frozenset({"urdf", "none"})  # of --limits; no files, whatever the folder contains


def check_files(given: dict[str, Any]) -> None:
    """Reject outputs that would replace an input, or each other, before any work starts.

    Parameters
    ----------
    given :
        The arguments of a command by parameter.

    Raises
    ------
    OutputError
        An output is an input: the same file by device and inode, through links too; or one of the
        two is a folder that contains the other.
    BadParameter
        Two outputs are one file.
    """
    outputs = [
        (OUTPUTS[name], path)
        for name, paths in given.items()
        if paths and name in OUTPUTS
        for path in (paths if isinstance(paths, list) else [paths])
    ]
    if not outputs:
        return
    inputs = list(_inputs(given))
    for i, (option, path) in enumerate(outputs):
        for other, earlier in outputs[:i]:
            if _overlap(path, earlier):
                raise typer.BadParameter(
                    f"{printable(path)}: {other} and {option} need different files"
                )
        for what, source in inputs:
            if _overlap(path, source):
                raise OutputError(
                    path,
                    f"cannot be written: it would overwrite {what} ({printable(source)}), which "
                    f"is an input; choose another {option}",
                )


def _inputs(given: dict[str, Any]) -> Iterator[tuple[str, Path]]:
    """Yield the files that are read, and what they hold; a folder only if it is a stored sweep."""
    for name, what in INPUTS.items():
        value = given.get(name)
        for source in value if isinstance(value, list) else [value]:
            if source is None or (name == "limits" and source in _WORDS):
                continue
            for path in _files_of(source) if what.endswith("robot") else (Path(source),):
                if not is_folder(path) or path.suffix.lower() == ".zarr":
                    yield what, path


def _files_of(robot: str) -> tuple[Path, ...]:
    from ftforce.robot.known_robots import files_of

    return files_of(robot)


def _overlap(first: Path, second: Path) -> bool:
    """Return whether two paths are one file, or one contains the other."""
    try:
        return _key(first) in _keys(second) or _key(second) in _keys(first)
    except (OSError, ValueError):  # such a path cannot be read or written; that is reported later
        return False


def _keys(path: Path) -> set[object]:
    """Return the identities of a path and of the folders that contain it."""
    real = Path(os.path.realpath(path))
    return {_key(one) for one in (real, *real.parents)} - {None}


def _key(path: Path) -> object:
    """Return device and inode of a file or folder, else its path; ``None`` for pipes and devices.

    Those keep nothing that could be overwritten.
    """
    try:
        found = path.stat()
    except FileNotFoundError:
        return os.path.realpath(path)
    if not (S_ISREG(found.st_mode) or S_ISDIR(found.st_mode)):
        return None
    return found.st_dev, found.st_ino
