"""Process the chunks of a job on this machine, in threads: the kernels release the GIL."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple, Protocol

from ftforce.batch.compiled import compile_kernels
from ftforce.batch.sparing import sparing
from ftforce.batch.store import store
from ftforce.errors import InputError, OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator
    from concurrent.futures import Future

    import numpy as np
    from numpy.typing import NDArray

    from ftforce.analysis.question import Progress
    from ftforce.batch.job import Job, Samples
    from ftforce.batch.store.manifest import Files
    from ftforce.batch.store.store import OpenStore
    from ftforce.batch.summary.summary import Summary

MOST_PER_PROCESSOR = 16  # threads or processes; more only wait for each other
SAVE_INTERVAL = 5.0  # s between writes of the progress file
_BATCH_SECONDS = 1.0  # s that a thread adds to its own summary before it is merged


class BatchResult(NamedTuple):
    """Result of a batch of chunks, whose samples are already written.

    Attributes
    ----------
    chunks :
        Chunk numbers.
    summary :
        Summary over all of them.
    seconds :
        Time taken, s.
    files :
        The files of their samples.
    """

    chunks: list[int]
    summary: Summary
    seconds: float
    files: Files


class Runner(Protocol):
    """Function that processes chunks, in any order."""

    def __call__(
        self, job: Job, opened: OpenStore, sizer: BatchSizer, /
    ) -> Generator[BatchResult, None, None]:
        """Yield batches as they complete."""


class BatchSizer:
    """Splits the remaining chunks into batches of about equal duration.

    A summary takes megabytes regardless of the number of postures, so one per chunk would cost as
    much as the chunk itself. A batch therefore holds several chunks with one summary; batches
    shrink towards the end, so that all workers finish together.

    Parameters
    ----------
    chunks, count :
        Numbers of the remaining chunks, and how many there are.
    """

    def __init__(self, chunks: Iterator[int], count: int) -> None:
        self._chunks, self.left = chunks, count
        self._cost: float | None = None  # s per chunk
        self._lock = threading.Lock()

    def during(self, seconds: float) -> Iterator[int]:
        """Yield chunks to a thread one by one, until its time is over or all are handed out.

        Parameters
        ----------
        seconds :
            Target duration of the batch, s; 0 for one chunk.
        """
        end = time.monotonic() + seconds
        while taken := self._take(1):
            yield from taken
            if time.monotonic() >= end:
                return

    def stop(self) -> None:
        """Hand out no more chunks."""
        with self._lock:
            self._chunks, self.left = iter(()), 0

    def _take(self, most: int) -> list[int]:
        with self._lock:
            taken = list(islice(self._chunks, most))
            self.left -= len(taken)
        return taken

    def next(self, workers: int, seconds: float) -> list[int]:
        """Return the chunks of the next batch, an empty list once all are handed out.

        Parameters
        ----------
        workers :
            Number of concurrent workers.
        seconds :
            Target duration of the batch, s.
        """
        size = 1 if self._cost is None else int(seconds / max(self._cost, 1e-6))
        return self._take(max(1, min(size, self.left // (2 * workers))))

    def took(self, chunks: int, seconds: float) -> None:
        """Record the duration of a batch.

        Parameters
        ----------
        chunks :
            Number of chunks in the batch.
        seconds :
            Time taken, s.
        """
        self._cost = seconds / chunks


def run_chunks(
    job: Job,
    chunks: Iterable[int],
    write: Callable[[int, Samples], Files],
    summary: Summary | None = None,
) -> BatchResult:
    """Process some chunks in the calling thread, and write their samples.

    Parameters
    ----------
    job :
        The job.
    chunks :
        Chunk numbers.
    write :
        Called with each chunk number and its samples; returns the files that it wrote.
    summary :
        Summary to which the chunks are added; a new one by default.
    """
    start = time.monotonic()
    summary = job.empty_summary() if summary is None else summary
    done: list[int] = []
    files: Files = {}
    for index in chunks:
        samples = job.add(index, summary)
        if samples:
            files.update(write(index, samples))
        done.append(index)
    return BatchResult(done, summary, time.monotonic() - start, files)


def run(job: Job, opened: OpenStore, runner: Runner, progress: Progress | None = None) -> None:
    """Process the remaining chunks of a job, and save progress.

    Parameters
    ----------
    job :
        The job.
    opened :
        Store of its results.
    runner :
        Executes the chunks.
    progress :
        Called with the number of postures done and the total.

    Raises
    ------
    FtforceError
        A file cannot be read or written; finished chunks are kept.
    KeyboardInterrupt
        After Ctrl-C; its note says how many postures are kept.
    """
    done, total = opened.done, job.postures.count
    saved, is_consistent = time.monotonic(), True
    kept = int(opened.summary.postures)  # of an earlier run
    try:
        for result in _batches(job, opened, runner, opened.progress.lost.copy()):
            opened.progress.files.update(result.files)  # their summary is there already
            opened.progress.lost[result.chunks] = False
        for result in _batches(job, opened, runner, ~done):
            is_consistent = False
            if result.summary is not opened.summary:
                opened.summary.merge(result.summary)
            opened.progress.files.update(result.files)
            done[result.chunks] = True
            is_consistent = True
            if progress is not None:
                progress(int(opened.summary.postures), total)
            if time.monotonic() - saved > SAVE_INTERVAL:
                store.save_progress(opened)
                saved, kept = time.monotonic(), int(opened.summary.postures)
    except BaseException as problem:
        # After Ctrl-C during a merge the summary is inconsistent: keep what was saved last.
        if is_consistent and not done.all():
            with suppress(OutputError):  # do not mask the original error
                store.save_progress(opened)
                kept = int(opened.summary.postures)
        if isinstance(problem, OutputError):
            raise OutputError(problem.path, f"{problem.reason}; {_left(kept, total)}") from None
        if isinstance(problem, KeyboardInterrupt) and opened.path is not None:
            problem.add_note(_left(kept, total))
        raise


def _left(kept: int, total: int) -> str:
    """Return what a disk holds of a sweep that could not go on."""
    if kept == 0:
        return "no posture was kept"
    return f"{kept:,} of {total:,} postures are kept, and the same command resumes the sweep"


def _batches(
    job: Job, opened: OpenStore, runner: Runner, chosen: NDArray[np.bool_]
) -> Iterator[BatchResult]:
    """Yield the results of the chosen chunks, in batches."""
    count = int(chosen.sum())
    sizer = BatchSizer((index for index in range(job.chunks) if chosen[index]), count)
    with closing(runner(job, opened, sizer)) as parts:
        for result in parts if count else ():
            sizer.took(len(result.chunks), result.seconds)
            yield result


def threads_of(threads: int | None) -> int:
    """Return the number of threads; by default one per processor available to this process.

    Raises
    ------
    InputError
        It is not an integer from 1 to what `bounded_count` admits.
    """
    return processors() if threads is None else bounded_count(threads, "threads")


def processors() -> int:
    """Return the number of processors available to this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def bounded_count(count: object, name: str) -> int:
    """Return a number of threads or processes that this machine can run.

    Parameters
    ----------
    count, name :
        The number, and its name for messages.

    Raises
    ------
    InputError
        It is not a positive integer, or there are more than 16 for each processor.
    """
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise InputError(f"{name} must be a positive integer, got {count!r}")
    most = MOST_PER_PROCESSOR * processors()
    if count > most:
        raise InputError(
            f"{name} must not exceed {most} here, {MOST_PER_PROCESSOR} for each of "
            f"{processors()} processors; got {count:,}"
        )
    return count


@dataclass(frozen=True)
class InThreads:
    """Runner that executes chunks in threads of this process, and compiles their kernels first.

    Attributes
    ----------
    threads :
        Number of threads.
    """

    threads: int

    def __call__(
        self, job: Job, opened: OpenStore, sizer: BatchSizer
    ) -> Generator[BatchResult, None, None]:
        """Yield batches as they complete.

        Parameters
        ----------
        job, opened, sizer :
            The job, the store of its results, and its remaining chunks.
        """
        job = sparing(job)
        compile_kernels(job)
        write = partial(store.write_samples, opened)
        is_alone = self.threads == 1 or (opened.path is None and job.is_small)
        # What is neither shared nor saved needs no summary of its own.
        whole = opened.summary if is_alone and opened.path is None else None
        # Samples cost more than the summary, and written chunks should be recorded soon.
        seconds = _BATCH_SECONDS if job.keep == "summary" else 0.0

        def batch() -> BatchResult | None:
            """Return a batch, ``None`` if all chunks are in the hands of other threads."""
            result = run_chunks(job, sizer.during(seconds), write, whole) if sizer.left else None
            return result if result is not None and result.chunks else None

        if is_alone:
            while (result := batch()) is not None:
                yield result
        else:
            yield from _in_pool(self.threads, batch, sizer)


def _in_pool(
    threads: int, batch: Callable[[], BatchResult | None], sizer: BatchSizer
) -> Generator[BatchResult, None, None]:
    """Yield batches from threads until the sizer has no more chunks."""
    with ThreadPoolExecutor(threads) as pool:
        running: set[Future[BatchResult | None]] = set()
        try:
            while running or sizer.left:
                while len(running) < 2 * threads and sizer.left:
                    running.add(pool.submit(batch))
                ready, running = wait(running, return_when=FIRST_COMPLETED)
                for future in ready:
                    if (result := future.result()) is not None:
                        yield result
        finally:
            sizer.stop()
            for future in running:
                future.cancel()
