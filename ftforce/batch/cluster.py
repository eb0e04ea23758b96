"""Run the chunks of a sweep on a Dask cluster; the only module that imports Dask.

Chunks are sent by number, several per batch. Losing a worker is harmless: Dask reschedules its
batch, and writing a chunk twice writes the same bytes. Workers write samples straight to the
output, so they need access to its folder; only summaries are sent back.
"""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ftforce.__version__ import __version__
from ftforce.batch.postures.postures import Listed
from ftforce.batch.runner import bounded_count
from ftforce.batch.store.folder import lock_of
from ftforce.errors import FtforceError, InputError, listed

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from ftforce.batch.job import Job, Samples
    from ftforce.batch.runner import BatchResult, BatchSizer, Runner
    from ftforce.batch.store.manifest import Files
    from ftforce.batch.store.store import OpenStore
    from ftforce.core.arrays import Matrix

_QUEUED = 2
"""Batches queued per thread of the cluster."""
TIMEOUT = 30.0
"""Maximum time, s, for a scheduler to reply and to have a worker."""
_MIN_SECONDS = 2.0
"""Minimum duration of a batch, s."""
_MAX_RATE = 16.0
"""Maximum rate of returned batches, 1/s: each carries megabytes of summary to one process."""
_ALLOWED_FAILURES = 10
"""Local workers that a batch may lose before Dask gives it up."""
_POLL_INTERVAL = 5.0
"""Interval between checks of the number of workers, s."""

_RESUME = "with an --output, finished chunks are kept and the same command resumes the sweep"


def on_cluster(workers: int | None, scheduler: str | None, output: object) -> Runner:
    """Return a runner that executes chunks on a Dask cluster.

    Parameters
    ----------
    workers :
        Number of processes of a temporary cluster on this machine.
    scheduler :
        Alternatively, the address of a scheduler, e.g. ``tcp://10.0.0.1:8786``.
    output :
        Where samples are stored; ``None`` if they are not.

    Raises
    ------
    InputError
        Both are given, or the number of workers is not positive or beyond this machine.
    FtforceError
        Dask is not installed.
    """
    if workers is not None and scheduler is not None:
        raise InputError(
            "specify either a number of workers or the address of a scheduler, not both"
        )
    if workers is not None:
        bounded_count(workers, "workers")
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise FtforceError(
            "clusters require distributed (pip install 'ftforce[cluster]')"
        ) from None

    def runner(
        job: Job, opened: OpenStore, sizer: BatchSizer
    ) -> Generator[BatchResult, None, None]:
        if job.keep != "summary" and output is None:
            raise InputError(
                "storing samples on a cluster requires an output folder that all workers share"
            )
        with _quiet(), _client(workers, scheduler) as client:
            yield from _submit(client, job, opened, sizer)

    return runner


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's log; failures that matter are raised as ftforce errors."""
    import logging

    import distributed  # noqa: F401 - creates its loggers, each with its own level

    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    except _LostError:  # a closed client tries to reconnect, and logs it, for a long time
        del before["distributed.client"]
        raise
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


class _LostError(FtforceError):
    """The connection to the scheduler was lost."""


@contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Connect to a scheduler, or start a temporary cluster on this machine."""
    from distributed import Client

    if scheduler is not None:
        try:
            _ping(scheduler)
            client = Client(scheduler, timeout=TIMEOUT, set_as_default=False)
        except Exception as problem:  # a server that is not a scheduler can raise anything
            reason = str(problem).partition("\n")[0] or type(problem).__name__
            raise InputError(
                f"no scheduler responds at {scheduler!r} ({reason}); "
                "expected an address such as tcp://10.0.0.1:8786"
            ) from None
        with client:
            _check_workers(client, scheduler)
            yield client
        return
    with _local_cluster(workers) as cluster, Client(cluster, set_as_default=False) as client:
        yield client


def _ping(scheduler: str) -> None:
    """Check that the scheduler replies: a client would wait forever for a silent one."""
    import asyncio
    from concurrent.futures import ThreadPoolExecutor

    from distributed import Security
    from distributed.core import rpc

    async def ping() -> None:
        security = Security().get_connection_args("client")
        async with rpc(scheduler, connection_args=security) as server:
            await asyncio.wait_for(server.identity(), TIMEOUT)

    with ThreadPoolExecutor(1) as pool:  # the caller's thread may already run an event loop
        pool.submit(lambda: asyncio.run(ping())).result()


@contextmanager
def _local_cluster(workers: int | None) -> Iterator[Any]:
    import logging

    import dask
    from distributed import LocalCluster

    # Workers are separate processes; they read their log level from this configuration.
    about = {
        "distributed.scheduler.allowed-failures": _ALLOWED_FAILURES,
        "logging.distributed": "critical",
    }
    with (
        dask.config.set(about),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",  # ``None`` would mean 8787, with a warning if taken
            host="127.0.0.1",
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        yield cluster


def _check_workers(client: Any, scheduler: str) -> None:
    """Wait for a worker, and check that all run this version of ftforce.

    Raises
    ------
    FtforceError
        There is no worker, or one lacks ftforce or has a different version.
    """
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except TimeoutError:
        raise FtforceError(
            f"the scheduler at {scheduler} has no workers; start some, e.g. dask worker {scheduler}"
        ) from None
    versions = client.get_versions(packages=["ftforce"])  # check=True only warns, about any package
    own = versions["client"]["packages"]["ftforce"]
    found = {name: worker["packages"]["ftforce"] for name, worker in versions["workers"].items()}
    different = [
        f"{name} has {version or 'none'}"
        for name, version in sorted(found.items())
        if version != own
    ]
    if different:
        raise FtforceError(f"all workers must run ftforce {own}; {listed(different, 4)}")


def _submit(
    client: Any, job: Job, opened: OpenStore, sizer: BatchSizer
) -> Generator[BatchResult, None, None]:
    """Submit batches to the workers, a few ahead, and yield the results as they complete.

    Raises
    ------
    FtforceError
        A worker raised an error, or workers or the scheduler were lost.
    """
    from distributed import as_completed

    path = None if opened.path is None else str(opened.path.resolve())
    token = "" if opened.path is None else str(lock_of(opened.path).get("token"))
    running = as_completed(loop=client.loop)
    polled, threads = -math.inf, 1
    while True:
        if time.monotonic() - polled > _POLL_INTERVAL:
            polled, threads = time.monotonic(), _threads(client)
        while running.count() < _QUEUED * threads and (
            chunks := sizer.next(_QUEUED * threads, max(_MIN_SECONDS, threads / _MAX_RATE))
        ):
            task = (_posture_slice(job, chunks), path, token, __version__, chunks)
            # pure=False: Dask need not hash tasks. The job is sent with every batch, because data
            # scattered to a worker is lost with it.
            running.add(client.submit(run_batch, *task, pure=False))
        if running.is_empty():
            return
        yield _result(next(running))


def _threads(client: Any) -> int:
    """Return the current number of threads of the cluster, at least 1."""
    try:
        return max(1, int(sum(client.nthreads().values())))
    except Exception:  # queried again later; a lost scheduler shows up in the batches
        return 1


def _result(future: Any) -> BatchResult:
    """Return the result of a batch.

    Raises
    ------
    FtforceError
        A worker raised an error, or workers or the scheduler were lost.
    """
    from concurrent.futures import CancelledError

    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    try:
        found: BatchResult = future.result()
    except FtforceError:
        raise
    except KilledWorker as problem:
        raise FtforceError(
            f"{problem.allowed_failures + 1} workers were lost while processing the same chunks; "
            f"do they have enough memory? {_RESUME}"
        ) from None
    except (CancelledError, CommClosedError):
        raise _LostError(f"the connection to the scheduler was lost; {_RESUME}") from None
    except Exception as problem:
        text = f"{type(problem).__name__}: {problem}".partition("\n")[0]
        raise FtforceError(f"a worker failed ({text}); {_RESUME}") from problem
    return found


def run_batch(
    job: Job, path: str | None, token: str, version: str, chunks: list[int]
) -> BatchResult:
    """Process some chunks on a worker.

    Parameters
    ----------
    job :
        The job.
    path, token :
        Path of the sample folder, and token of its lock.
    version :
        Version of ftforce that submitted the job.
    chunks :
        Chunk numbers.

    Raises
    ------
    FtforceError
        The worker runs another version of ftforce, or a file cannot be read or written.
    """
    from ftforce.batch.runner import run_chunks
    from ftforce.batch.store.store import write_chunk

    if version != __version__:  # a worker that joined after `_check_workers`
        raise FtforceError(f"all workers must run ftforce {version}; one has {__version__}")

    def write(index: int, samples: Samples) -> Files:
        return {} if path is None else write_chunk(Path(path), token, job, index, samples)

    return run_chunks(job, chunks, write)


def _posture_slice(job: Job, chunks: list[int]) -> Job:
    """Return a copy of the job with only those of its listed postures that the batch needs."""
    if not isinstance(job.postures, Listed):
        return job
    rows = {index: job.postures.block(*job.range(index)) for index in chunks}
    return replace(job, postures=_PostureSlice(rows, job.chunk, job.postures.count, job.postures.n))


@dataclass(frozen=True, eq=False)
class _PostureSlice:
    """Some chunks of a listed set of postures.

    Attributes
    ----------
    rows :
        Joint positions of each chunk, rad or m, by chunk number.
    chunk :
        Postures per chunk.
    count, n :
        Total number of postures, and number of joints.
    """

    rows: dict[int, Matrix]
    chunk: int
    count: int
    n: int

    def block(self, start: int, stop: int) -> Matrix:
        """Return postures of one of the chunks, see `ftforce.batch.postures.Postures`.

        Parameters
        ----------
        start, stop :
            Half-open range of indices in all postures, within one chunk.
        """
        index = start // self.chunk
        first = index * self.chunk
        return self.rows[index][start - first : stop - first].copy()

    def identity(self) -> dict[str, Any]:
        """Return a placeholder: a slice is never stored."""
        return {"source": "slice"}
