"""A bar on stderr for work that takes its time."""

import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractContextManager

    from ftforce.analysis.question import Progress

PATIENCE = 1.0  # s without a progress bar


def progress_bar(what: str) -> "AbstractContextManager[Progress]":
    """Return a callback's context: a bar on stderr counts once the work has taken a second."""
    from rich.progress import MofNCompleteColumn

    return _bar(what, MofNCompleteColumn())


def rate_bar(what: str) -> "AbstractContextManager[Progress]":
    """Return the same for a bar with per cent and rate."""
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
    begun: int | None = None  # the first to come; what an earlier run did is not in the rate

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
