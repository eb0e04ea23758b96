"""Progress bars on stderr for long computations."""

import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractContextManager

    from ftforce.analysis.question import Progress

PATIENCE = 1.0  # s before a progress bar appears


def progress_bar(what: str) -> "AbstractContextManager[Progress]":
    """Return a context that yields a progress callback; the bar appears after one second."""
    from rich.progress import MofNCompleteColumn

    return _bar(what, MofNCompleteColumn())


def rate_bar(what: str) -> "AbstractContextManager[Progress]":
    """Return a context as `progress_bar` does, with percentage and rate in the bar."""
    from rich.progress import TextColumn

    return _bar(what, TextColumn("{task.percentage:.0f} %"), TextColumn("{task.fields[rate]}"))


@contextmanager
def _bar(what: str, *columns: Any) -> "Iterator[Progress]":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeRemainingColumn

    console = Console(file=sys.stderr)
    columns = (what, BarColumn(), *columns, TimeRemainingColumn())
    bar = Progress(*columns, console=console, transient=True)
    work = bar.add_task(what, rate="")
    start, shown = time.monotonic(), False
    begun: int | None = None  # excludes work of an earlier run from the rate

    def update(done: int, total: int, /) -> None:
        nonlocal shown, begun
        begun = done if begun is None else begun
        passed = time.monotonic() - start
        if console.is_terminal and not shown and passed > PATIENCE:
            bar.start()
            shown = True
        if shown:
            rate = f"{(done - begun) / passed:,.0f} {what}/s"
            bar.update(work, completed=done, total=total, rate=rate)

    try:
        yield update
    finally:
        if shown:
            bar.stop()
