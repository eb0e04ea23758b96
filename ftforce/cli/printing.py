"""Standard output, which may be full or closed: that is said in one line."""

from __future__ import annotations

import errno
import io
import os
import sys
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NoReturn

import typer

from ftforce.errors import FtforceError

if TYPE_CHECKING:
    from collections.abc import Iterator


class _Closed(io.TextIOBase):
    """Stands for a stream that is closed: Python has ``None``, on which prints vanish silently."""

    def write(self, _: str, /) -> NoReturn:
        raise OSError(errno.EBADF, "it is closed")


def prepare_streams() -> None:
    """Let a terminal that cannot show Ω show ? instead, and a closed standard output complain."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    sys.stdout = sys.stdout or _Closed()


@contextmanager
def printing() -> Iterator[None]:
    """Print on standard output in here, and only that.

    Raises
    ------
    FtforceError
        Standard output cannot be written. Who reads a pipe may close it: that is no error.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as problem:
        silence()
        raise FtforceError(reason_of(problem)) from problem


def say(text: str) -> None:
    """Print a line."""
    with printing():
        typer.echo(text)


def reason_of(problem: OSError) -> str:
    """Return what is said of a standard output that cannot be written."""
    return f"standard output cannot be written ({problem.strerror or problem})"


def silence() -> None:
    """Drop what is not printed yet; else the interpreter would try again when it ends, and fail."""
    with suppress(OSError):  # a stream that is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
