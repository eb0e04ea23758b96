"""Capture of what C++ libraries print to stderr, for error messages."""

from __future__ import annotations

import os
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from collections.abc import Iterator

_STDERR = 2
_lock = threading.Lock()  # the file descriptor belongs to the whole process


class _Printed:
    """The captured text; empty until the context exits."""

    text = ""

    def __str__(self) -> str:
        """Return the text."""
        return self.text


@contextmanager
def captured_stderr() -> Iterator[_Printed]:
    """Capture output to file descriptor 2, which bypasses ``sys.stderr``.

    The descriptor belongs to the whole process: with several threads nothing is captured, since
    it would take what the others write.
    """
    printed = _Printed()
    if not _is_alone():
        yield printed
        return
    with _lock, _scratch_file() as file:
        try:
            saved = os.dup(_STDERR)
        except OSError:  # stderr is closed: nothing can be printed
            yield printed
            return
        os.dup2(file.fileno(), _STDERR)
        try:
            yield printed
        finally:
            os.dup2(saved, _STDERR)
            os.close(saved)
            file.seek(0)
            printed.text = file.read().decode(errors="replace")


def _is_alone() -> bool:
    """Return whether this is the only thread that could write."""
    return threading.active_count() == 1


def _scratch_file() -> BinaryIO:
    # A pipe could fill up and block the library that prints.
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("stderr"), "w+b")
    import tempfile  # imported lazily: takes 6 ms, and is needed only without memfd_create

    return tempfile.TemporaryFile()
