"""Doing the chunks of a job on this machine, in threads: the kernels let go of Python's lock."""

from __future__ import annotations

import os
import time
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import closing, suppress
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple, Protocol

from ftforce.batch.store import store
from ftforce.errors import InputError, OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator
    from concurrent.futures import Future

    from ftforce.analysis.question import Progress
    from ftforce.batch.job import Job, Samples
    from ftforce.batch.store.store import Opened
    from ftforce.batch.summary.summary import Summary

SAVING = 5.0  # s between two writings of the progress file
TURN = 1.0  # s that a thread counts into a summary of its own before it is added to the others


class Turn(NamedTuple):
    """Chunks that are done: their samples are written.

    Attributes
    ----------
    chunks :
        Numbers.
    summary :
        Of all of them.
    seconds :
        How long they took, s.
    """

    chunks: list[int]
    summary: Summary
    seconds: float


class Runner(Protocol):
    """Does chunks somewhere, in any order."""

    def __call__(
        self, job: Job, opened: Opened, turns: BatchSizer, /
    ) -> Generator[Turn, None, None]:
        """Yield turns as they are done."""


class BatchSizer:
    """Chunks that are to be done, dealt out in turns of about the same time.

    A summary is megabytes, whatever it counts: one for every chunk would cost as much as the
    chunk. So a turn is several chunks with one summary; fewer towards the end, for all to end at
    the same time.

    Parameters
    ----------
    chunks, count :
        Numbers of the chunks, and how many they are.
    """

    def __init__(self, chunks: Iterator[int], count: int) -> None:
        self._chunks, self.left = chunks, count
        self._cost: float | None = None  # s per chunk

    def take(self, hands: int, seconds: float) -> list[int]:
        """Return the chunks of the next turn, none if all are given.

        Parameters
        ----------
        hands :
            How many work at the same time.
        seconds :
            How long the turn should take.
        """
        size = 1 if self._cost is None else int(seconds / max(self._cost, 1e-6))
        taken = list(islice(self._chunks, max(1, min(size, self.left // (2 * hands)))))
        self.left -= len(taken)
        return taken

    def took(self, chunks: int, seconds: float) -> None:
        """Learn how long a turn took, s."""
        self._cost = seconds / chunks


def do_chunks(job: Job, chunks: list[int], write: Callable[[int, Samples], None]) -> Turn:
    """Do some chunks here and now, and write what is kept of each."""
    start, summary = time.monotonic(), job.empty_summary()
    for index in chunks:
        samples = job.add(index, summary)
        if samples:
            write(index, samples)
    return Turn(chunks, summary, time.monotonic() - start)


def run(job: Job, opened: Opened, runner: Runner, progress: Progress | None = None) -> None:
    """Do the chunks that are not done yet, and keep count.

    Parameters
    ----------
    job :
        What is to be done.
    opened :
        Where it is kept.
    runner :
        Who does it.
    progress :
        Called with the postures done, and their number.

    Raises
    ------
    FtforceError
        Something cannot be read or written; what is finished is kept.
    """
    done, total = opened.done, job.postures.count
    count = int((~done).sum())
    turns = BatchSizer((index for index in range(job.chunks) if not done[index]), count)
    saved, is_whole = time.monotonic(), True
    try:
        with closing(runner(job, opened, turns)) as parts:
            for turn in parts if count else ():
                turns.took(len(turn.chunks), turn.seconds)
                is_whole = False
                opened.summary.merge(turn.summary)
                done[turn.chunks] = True
                is_whole = True
                if progress is not None:
                    progress(int(opened.summary.postures), total)
                if time.monotonic() - saved > SAVING:
                    store.save_progress(opened)
                    saved = time.monotonic()
    finally:
        # Ctrl-C within a merge leaves half of it: then what was saved last is the truth.
        if is_whole and not done.all():
            with suppress(OutputError):  # the first trouble is the one to tell
                store.save_progress(opened)


def threads_of(threads: int | None) -> int:
    """Return how many threads to use; all processors this process may use if not said.

    Raises
    ------
    InputError
        It is no whole number from 1 on.
    """
    if threads is None:
        return (
            len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else os.cpu_count() or 1
        )
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise InputError(f"threads must be a whole number from 1 on, got {threads!r}")
    return threads


def in_threads(threads: int) -> Runner:
    """Return what does chunks in threads of this process."""

    def runner(job: Job, opened: Opened, turns: BatchSizer) -> Generator[Turn, None, None]:
        write = partial(store.write_samples, opened)
        # Samples take longer than the summary, and what is written should count soon.
        seconds = TURN if job.keep == "summary" else 0.0
        with ThreadPoolExecutor(threads) as pool:
            running: set[Future[Turn]] = set()
            try:
                while True:
                    while len(running) < 2 * threads and (chunks := turns.take(threads, seconds)):
                        running.add(pool.submit(do_chunks, job, chunks, write))
                    if not running:
                        return
                    ready, running = wait(running, return_when=FIRST_COMPLETED)
                    for future in ready:
                        yield future.result()
            finally:
                for future in running:
                    future.cancel()

    return runner
