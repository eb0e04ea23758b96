"""The folder of a sweep: locking, and writes that survive a power failure."""

from __future__ import annotations

import errno
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

    from filelock import FileLock

LOCK = ".ftforce.lock"
"""Lock file: marks a folder as an incomplete sweep of ftforce, and names the writing process."""
_PARTIAL = ".partial"
"""Suffix of files being written, also used by Zarr."""
_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL}


@contextmanager
def disk_errors(path: Path | None) -> Iterator[None]:
    """Convert file system errors to `OutputError`.

    Parameters
    ----------
    path :
        The folder, for the message; ``None`` for memory.

    Raises
    ------
    OutputError
        A file could not be written.
    """
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise OutputError(path or "memory", f"cannot be written ({reason})") from None


def lock(path: Path) -> FileLock:
    """Lock a folder, creating it if needed.

    The operating system releases the lock when the process ends, however it ends. The lock file
    remains until the sweep is complete; its content, see `lock_of`, is read by workers of the
    sweep and by processes that find the folder locked.

    Raises
    ------
    OutputError
        Another process is writing to the folder, or it cannot be created.
    """
    from filelock import FileLock, Timeout

    held = FileLock(path / LOCK, blocking=False, thread_local=False, fallback_to_soft=False)
    with disk_errors(path):
        path.mkdir(parents=True, exist_ok=True)
        try:
            held.acquire()
        except Timeout:
            who = lock_of(path)
            by = f" (process {who['process']} on {who['host']})" if who else ""
            raise OutputError(
                path,
                f"is being written by another sweep{by}; wait for it, or choose another --output",
            ) from None
        except OSError as problem:
            if problem.errno not in _NO_LOCKS:
                raise  # otherwise the file system has no locks, and the user is responsible
        who = {"process": os.getpid(), "host": socket.gethostname(), "token": uuid.uuid4().hex}
        try:
            (path / LOCK).write_text(json.dumps(who), "utf-8")
        except BaseException:
            held.release()
            raise
    return held


def lock_of(path: Path) -> dict[str, object]:
    """Return the content of the lock file: process, host and token; empty without a lock file."""
    try:
        found = json.loads((path / LOCK).read_text("utf-8"))
        return {name: found[name] for name in ("process", "host", "token")}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def write_durably(file: Path, data: bytes) -> None:
    """Write a file atomically, and wait until it is on disk.

    Parameters
    ----------
    file :
        Path of the file.
    data :
        Its content.
    """
    write_content(file, data)
    sync(file.parent)


def write_content(file: Path, data: bytes) -> None:
    """Write a file atomically, and wait until its content is on disk, but not its name.

    Parameters
    ----------
    file :
        Path of the file.
    data :
        Its content.
    """
    partial = file.with_name(file.name + _PARTIAL)
    with partial.open("wb") as stream:
        stream.write(data)
        stream.flush()
        sync(partial)
    partial.replace(file)


def sync(path: Path) -> None:
    """Flush a file, or the entries of a folder, to disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with _suppress_unsupported():
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _suppress_unsupported() -> Iterator[None]:
    """Ignore operations that the file system does not support: some cannot sync folders."""
    try:
        yield
    except OSError as problem:
        if problem.errno not in {errno.EINVAL, errno.ENOTSUP, errno.EBADF}:
            raise


def remove_partial(path: Path) -> None:
    """Remove files that a killed process left partially written, links, pipes and devices."""
    for entry in path.iterdir():
        if entry.is_symlink() or not (entry.is_dir() or entry.is_file()):
            entry.unlink()
    for left in path.rglob(f"*{_PARTIAL}"):
        left.unlink(missing_ok=True)


def is_partly_created(path: Path, known: Collection[str]) -> bool:
    """Return whether a folder is left over from a sweep killed during its creation.

    Parameters
    ----------
    path :
        The folder, from which no sweep can be read.
    known :
        Names of all files that ftforce creates there.
    """
    if not (path / LOCK).exists():
        return False
    names = {entry.name.removesuffix(_PARTIAL) for entry in path.iterdir()}
    return names <= {LOCK, *known}


def clear(path: Path, known: Collection[str]) -> None:
    """Remove what ftforce created in an incomplete folder, except its lock.

    Parameters
    ----------
    path :
        The folder.
    known :
        Names of all files that ftforce creates there.
    """
    for entry in path.iterdir():
        if entry.name.removesuffix(_PARTIAL) in known:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
            else:
                with suppress(FileNotFoundError):
                    entry.unlink()
