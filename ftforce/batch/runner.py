"""Doing the chunks of a job on this machine, in threads: the kernels let go of Python's lock."""

from __future__ import annotations

import os
import time
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING, Protocol

from ftforce.batch import store
from ftforce.errors import InputError, OutputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ftforce.batch.job import Job, Samples
    from ftforce.batch.store import Opened
    from ftforce.batch.summary import Summary
    from ftforce.fault_census import Progress

SAVING = 5.0  # s between two writings of the progress file


class Runner(Protocol):
    """Does chunks somewhere, in any order."""

    def __call__(
        self, job: Job, opened: Opened, chunks: Iterable[int], /
    ) -> Iterator[tuple[int, Summary]]:
        """Yield each chunk and its summary once its samples are written."""


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
    total = job.postures.count
    pending = [index for index in range(job.chunks) if not opened.done[index]]
    finished = total - sum(_size(job, index) for index in pending)
    saved = time.monotonic()
    try:
        for index, summary in runner(job, opened, pending):
            opened.summary.merge(summary)
            opened.done[index] = True
            finished += _size(job, index)
            if progress is not None:
                progress(finished, total)
            if time.monotonic() - saved > SAVING:
                store.save_progress(opened)
                saved = time.monotonic()
    finally:
        if not opened.done.all():
            with suppress(OutputError):  # the first trouble is the one to tell
                store.save_progress(opened)


def _size(job: Job, index: int) -> int:
    start, stop = job.range(index)
    return stop - start


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

    def runner(job: Job, opened: Opened, chunks: Iterable[int]) -> Iterator[tuple[int, Summary]]:
        def work(index: int) -> tuple[int, Summary]:
            summary, samples = job.run(index)
            write(job, opened, index, samples)
            return index, summary

        todo = iter(chunks)
        with ThreadPoolExecutor(threads) as pool:
            running = {pool.submit(work, index) for index in islice(todo, 2 * threads)}
            try:
                while running:
                    ready, running = wait(running, return_when=FIRST_COMPLETED)
                    for future in ready:
                        yield future.result()
                        running |= {pool.submit(work, index) for index in islice(todo, 1)}
            finally:
                for future in running:
                    future.cancel()

    return runner


def write(job: Job, opened: Opened, index: int, samples: Samples) -> None:
    """Write what is kept of a chunk, if anything is."""
    if samples:
        store.write_samples(opened, job, index, samples)
