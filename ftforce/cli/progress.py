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


@contextmanager
def rate_bar(what: str) -> "Iterator[Progress]":
    """Yield a callback that shows a bar with rate and time left, once the work takes a second."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(file=sys.stderr)
    bar = Progress(
        what, BarColumn(), TextColumn("{task.percentage:.0f} %"), TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(), console=console, transient=True,
    )  # fmt: skip
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
            rate = (done - begun) / passed
            bar.update(work, completed=done, total=total, rate=f"{rate:,.0f} {what}/s")

    try:
        yield update
    finally:
        if shown:
            bar.stop()
