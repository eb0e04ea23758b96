"""The folder of a sweep: one writer at a time, files that survive a power cut."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import socket
import uuid
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from ftforce.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

LOCK = ".ftforce.lock"
"""File that says that the folder is ftforce's, who writes it, and that it is not complete."""
PARTIAL = ".partial"
"""How names end of files that are being written; Zarr's too."""
_NOT_ALLOWED = {errno.EACCES, errno.EPERM, errno.EROFS}
_TAKEN = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES}


@contextmanager
def disk_errors(path: Path | None) -> Iterator[None]:
    """Turn what a disk refuses into one clear line.

    Raises
    ------
    OutputError
        Something could not be written.
    """
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or str(problem)
        kept = "; what is finished is kept: the same command goes on from there"
        if problem.errno in _NOT_ALLOWED:
            kept = ""
        raise OutputError(path or "memory", f"cannot be written ({reason}){kept}") from None


class Lock:
    """A folder that no other process writes. Made by `lock`.

    The kernel lets go of it when the process ends, however it ends. It lies on a file that stays
    until the sweep is complete.

    Attributes
    ----------
    token :
        A word that is in the file too; who reads it there sees the same folder.
    """

    def __init__(self, descriptor: int, token: str) -> None:
        self._descriptor, self.token = descriptor, token

    def release(self) -> None:
        """Let others in."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def lock(path: Path) -> Lock:
    """Make a folder if there is none, and lock it.

    Raises
    ------
    OutputError
        Another process writes it, or it cannot be made.
    """
    with disk_errors(path):
        path.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            _take(descriptor, path)
            token = uuid.uuid4().hex
            who = {"process": os.getpid(), "host": socket.gethostname(), "token": token}
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, json.dumps(who).encode(), 0)
        except BaseException:
            os.close(descriptor)
            raise
    return Lock(descriptor, token)


def _take(descriptor: int, path: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as problem:
        if problem.errno not in _TAKEN:  # a file system without locks: the user has to take care
            return
        who = lock_of(path)
        by = f" (process {who['process']} on {who['host']})" if who else ""
        raise OutputError(
            path, f"is being written by another sweep{by}; wait for it, or give another --output"
        ) from None


def lock_of(path: Path) -> dict[str, object]:
    """Return what the lock's file says: process, host and token; nothing if there is none."""
    try:
        found = json.loads((path / LOCK).read_text("utf-8"))
        return {name: found[name] for name in ("process", "host", "token")}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def write_durably(file: Path, data: bytes) -> None:
    """Write a file whole or not at all, and wait until it is on the disk."""
    partial = file.with_name(file.name + PARTIAL)
    with partial.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    partial.replace(file)
    sync(file.parent)


def sync(path: Path) -> None:
    """Wait until a file, or which files a folder has, is on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with suppress_unsupported():
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def suppress_unsupported() -> Iterator[None]:
    """Go on where a file system cannot do such a thing: some cannot sync folders."""
    try:
        yield
    except OSError as problem:
        if problem.errno not in {errno.EINVAL, errno.ENOTSUP, errno.EBADF}:
            raise


def remove_partial(path: Path) -> None:
    """Remove what a killed process had half written."""
    for left in path.rglob(f"*{PARTIAL}"):
        left.unlink(missing_ok=True)


def is_half_made(path: Path, known: Collection[str]) -> bool:
    """Tell whether a folder is what is left of a sweep that was killed while it was made.

    Parameters
    ----------
    path :
        The folder; no sweep can be read from it.
    known :
        Names of what ftforce puts there.
    """
    if not (path / LOCK).exists():
        return False
    names = {entry.name.removesuffix(PARTIAL) for entry in path.iterdir()}
    return names <= {LOCK, *known}


def clear(path: Path, known: Collection[str]) -> None:
    """Remove what ftforce put into a half-made folder; its lock stays."""
    for entry in path.iterdir():
        if entry.name.removesuffix(PARTIAL) in known:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
            else:
                with suppress(FileNotFoundError):
                    entry.unlink()
