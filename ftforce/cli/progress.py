"""A bar on stderr for work that takes its time."""

import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.fault_census import Progress

PATIENCE = 1.0  # s without a progress bar


@contextmanager
def progress_bar(what: str) -> "Iterator[Progress]":
    """Yield a callback that shows a bar on stderr once the work has taken a second."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    console = Console(file=sys.stderr)
    bar = Progress(
        what, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, transient=True,
    )  # fmt: skip
    work = bar.add_task(what)
    start, shown = time.monotonic(), False

    def update(done: int, total: int, /) -> None:
        nonlocal shown
        if console.is_terminal and not shown and time.monotonic() - start > PATIENCE:
            bar.start()
            shown = True
        if shown:
            bar.update(work, completed=done, total=total)

    try:
        yield update
    finally:
        if shown:
            bar.stop()
