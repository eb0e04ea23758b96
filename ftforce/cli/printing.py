"""Standard output, with errors such as a full disk reported in one line."""

from __future__ import annotations

import errno
import io
import os
import sys
import warnings
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NoReturn

import typer

from ftforce.errors import FtforceError

if TYPE_CHECKING:
    from collections.abc import Iterator


NARROWEST = 20  # columns; fewer show no number of a table


class _Closed(io.TextIOBase):
    """Replacement for a closed stream: Python uses ``None``, which silently discards prints."""

    def write(self, _: str, /) -> NoReturn:
        raise OSError(errno.EBADF, "it is closed")


def prepare_streams() -> None:
    """Make any terminal usable.

    Characters that it cannot show are replaced, a closed standard output is an error, and a width
    in which nothing could be shown, such as ``COLUMNS=0`` of a serial console, is ignored.
    Warnings of Python take one line.
    """
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    for name in ("COLUMNS", "TERMINAL_WIDTH"):  # of rich; of typer, which takes it for a number
        width = os.environ.get(name, "")
        if width and not (width.isdecimal() and int(width) >= NARROWEST):
            del os.environ[name]
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    sys.stdout = sys.stdout or _Closed()


@contextmanager
def printing() -> Iterator[None]:
    """Report errors of standard output; only printing may happen within this context.

    Raises
    ------
    FtforceError
        Standard output cannot be written. A closed pipe is not reported as an error.
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
    """Return the message for a standard output that cannot be written."""
    return f"standard output cannot be written ({problem.strerror or problem})"


def silence() -> None:
    """Discard unwritten output, which the interpreter would otherwise try to flush on exit."""
    with suppress(OSError):  # the stream is not a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
