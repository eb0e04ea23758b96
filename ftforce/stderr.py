"""What C++ libraries print on stderr, caught for an error message."""

from __future__ import annotations

import os
import tempfile
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_STDERR = 2
_lock = threading.Lock()  # the file descriptor belongs to the whole process


class Printed:
    """The text that was caught; empty until the context ends."""

    text = ""

    def __str__(self) -> str:
        """Return the text."""
        return self.text


@contextmanager
def captured_stderr() -> Iterator[Printed]:
    """Redirect the process's file descriptor 2, where sys.stderr cannot reach, and read it."""
    printed = Printed()
    with _lock, tempfile.TemporaryFile() as file:
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
