"""The same chunks on Dask: the only file that knows it.

Chunks are sent by number, several in a turn; a worker that is lost is survived, for Dask gives its
turn to another, and writing a chunk twice writes the same bytes. The samples go from the workers
straight into the output, so workers must see the output's folder; only summaries travel back.
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
from ftforce.batch.store.folder import lock_of
from ftforce.errors import FtforceError, InputError, listed

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from ftforce.batch.job import Job, Samples
    from ftforce.batch.runner import BatchSizer, Runner, Turn
    from ftforce.batch.store.store import Opened
    from ftforce.core.arrays import Matrix

AHEAD = 2
"""Turns that are given to each thread of the cluster beforehand."""
PATIENCE = 30.0
"""s until a scheduler answers and has a worker."""
TURN = 2.0
"""s of a thread's turn, at least."""
RATE = 16.0
"""Turns that come back a second, at most: each brings a summary of megabytes to one process."""
LOSSES = 10
"""Workers of a cluster on this machine that a turn may lose; then it is what kills them."""
LOOK = 5.0
"""s between two looks at how many workers there are."""

_KEPT = "what is finished is kept if there is an --output: the same command goes on from there"


def on_cluster(workers: int | None, scheduler: str | None, output: object) -> Runner:
    """Return what does chunks on a Dask cluster.

    Parameters
    ----------
    workers :
        Processes of a cluster on this machine that is made for the purpose.
    scheduler :
        Or the address of a scheduler, e.g. ``tcp://10.0.0.1:8786``.
    output :
        Where samples are kept; ``None`` for nowhere.

    Raises
    ------
    InputError
        Both, or no whole number of workers.
    FtforceError
        Dask is not installed.
    """
    if workers is not None and scheduler is not None:
        raise InputError("give either a number of workers or the address of a scheduler, not both")
    whole = isinstance(workers, int) and not isinstance(workers, bool) and workers >= 1
    if workers is not None and not whole:
        raise InputError(f"workers must be a whole number from 1 on, got {workers!r}")
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise FtforceError(
            "clusters need distributed: install the extra with pip install 'ftforce[cluster]'"
        ) from None

    def runner(job: Job, opened: Opened, turns: BatchSizer) -> Generator[Turn, None, None]:
        if job.keep != "summary" and output is None:
            raise InputError("samples from a cluster need an output that all workers see")
        with _quiet(), _client(workers, scheduler) as client:
            yield from _submit(client, job, opened, turns)

    return runner


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log off the terminal: what matters comes as an error of ours."""
    import logging

    import distributed  # noqa: F401 - which makes its loggers, each with a level of its own

    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    except LostError:  # a client tries to come back, and says so, long after it was closed
        del before["distributed.client"]
        raise
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


class LostError(FtforceError):
    """The scheduler was lost."""


@contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Connect, or start a cluster on this machine and end it afterwards."""
    from distributed import Client

    if scheduler is not None:
        try:
            _ask(scheduler)
            client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except Exception as problem:  # what is no scheduler may make anything of the protocol
            reason = str(problem).partition("\n")[0] or type(problem).__name__
            raise InputError(
                f"no scheduler answers at {scheduler!r} ({reason}); "
                "an address looks like tcp://10.0.0.1:8786"
            ) from None
        with client:
            _check_workers(client, scheduler)
            yield client
        return
    with _local_cluster(workers) as cluster, Client(cluster, set_as_default=False) as client:
        yield client


def _ask(scheduler: str) -> None:
    """See that a scheduler answers: a client waits for ever for one that listens and is silent."""
    import asyncio
    from concurrent.futures import ThreadPoolExecutor

    from distributed import Security
    from distributed.core import rpc

    async def ask() -> None:
        security = Security().get_connection_args("client")
        async with rpc(scheduler, connection_args=security) as one:
            await asyncio.wait_for(one.identity(), PATIENCE)

    with ThreadPoolExecutor(1) as pool:  # the caller's thread may have a loop of its own
        pool.submit(lambda: asyncio.run(ask())).result()


@contextmanager
def _local_cluster(workers: int | None) -> Iterator[Any]:
    import logging

    import dask
    from distributed import LocalCluster

    # Workers are processes of their own, which find the level of their log here.
    about = {
        "distributed.scheduler.allowed-failures": LOSSES,
        "logging.distributed": "critical",
    }
    with (
        dask.config.set(about),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",  # none at all would be 8787, with a warning if taken
            host="127.0.0.1",
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        yield cluster


def _check_workers(client: Any, scheduler: str) -> None:
    """Wait for a worker, and see that all have this ftforce.

    Raises
    ------
    FtforceError
        There is no worker, or one that lacks ftforce or has another version.
    """
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise FtforceError(
            f"the scheduler at {scheduler} has no workers; start some, e.g. dask worker {scheduler}"
        ) from None
    versions = client.get_versions(packages=["ftforce"])  # its check=True warns, and of any package
    own = versions["client"]["packages"]["ftforce"]
    found = {name: one["packages"]["ftforce"] for name, one in versions["workers"].items()}
    wrong = [f"{name} has {one or 'none'}" for name, one in sorted(found.items()) if one != own]
    if wrong:
        raise FtforceError(f"all workers need ftforce {own}; {listed(wrong, 4)}")


def _submit(
    client: Any, job: Job, opened: Opened, turns: BatchSizer
) -> Generator[Turn, None, None]:
    """Give turns to the workers, a few ahead, and take their summaries as they come.

    Raises
    ------
    FtforceError
        What a worker says; or workers or the scheduler were lost.
    """
    from distributed import as_completed

    path = None if opened.path is None else str(opened.path.resolve())
    token = "" if opened.path is None else str(lock_of(opened.path).get("token"))
    running = as_completed(loop=client.loop)
    looked, threads = -math.inf, 1
    while True:
        if time.monotonic() - looked > LOOK:
            looked, threads = time.monotonic(), _threads(client)
        while running.count() < AHEAD * threads and (
            chunks := turns.take(AHEAD * threads, max(TURN, threads / RATE))
        ):
            task = (_posture_slice(job, chunks), path, token, __version__, chunks)
            # Not pure: Dask shall not compare tasks. The job goes with every turn, for what is
            # left on one worker is lost with it.
            running.add(client.submit(do_turn, *task, pure=False))
        if running.is_empty():
            return
        yield _result(next(running))


def _threads(client: Any) -> int:
    """Return how many threads the cluster has now, at least 1."""
    try:
        return max(1, int(sum(client.nthreads().values())))
    except Exception:  # it is asked again; if it is lost the turns say so
        return 1


def _result(future: Any) -> Turn:
    """Return what came of a turn.

    Raises
    ------
    FtforceError
        What a worker says; or workers or the scheduler were lost.
    """
    from concurrent.futures import CancelledError

    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    try:
        found: Turn = future.result()
    except FtforceError:
        raise
    except KilledWorker as problem:
        raise FtforceError(
            f"{problem.allowed_failures + 1} workers were lost at the same chunks: do they have "
            f"enough memory? {_KEPT}"
        ) from None
    except (CancelledError, CommClosedError):
        raise LostError(f"the scheduler was lost; {_KEPT}") from None
    except Exception as problem:
        text = f"{type(problem).__name__}: {problem}".partition("\n")[0]
        raise FtforceError(f"a worker failed ({text}); {_KEPT}") from problem
    return found


def do_turn(job: Job, path: str | None, token: str, version: str, chunks: list[int]) -> Turn:
    """Do some chunks on a worker.

    Parameters
    ----------
    job :
        The job.
    path, token :
        Of the folder of the samples, and of its lock.
    version :
        Of the ftforce that asks.
    chunks :
        Numbers.

    Raises
    ------
    FtforceError
        This worker has another ftforce, or something cannot be read or written.
    """
    from ftforce.batch.runner import do_chunks
    from ftforce.batch.store.store import write_chunk

    if version != __version__:  # a worker that came later
        raise FtforceError(f"all workers need ftforce {version}; one has {__version__}")

    def write(index: int, samples: Samples) -> None:
        if path is not None:
            write_chunk(Path(path), token, job, index, samples)

    return do_chunks(job, chunks, write)


def _posture_slice(job: Job, chunks: list[int]) -> Job:
    """Return a job that holds of given postures only what a turn needs."""
    if not isinstance(job.postures, Listed):
        return job
    rows = {index: job.postures.block(*job.range(index)) for index in chunks}
    return replace(job, postures=PostureSlice(rows, job.chunk, job.postures.count, job.postures.n))


@dataclass(frozen=True, eq=False)
class PostureSlice:
    """Some chunks of given postures.

    Attributes
    ----------
    rows :
        Joint positions of the chunks, rad or m, by number of the chunk.
    chunk :
        Postures per chunk.
    count, n :
        Number of all postures, and of joints.
    """

    rows: dict[int, Matrix]
    chunk: int
    count: int
    n: int

    def block(self, start: int, stop: int) -> Matrix:
        """Return postures that lie in one of the chunks, see `ftforce.batch.postures.Postures`."""
        index = start // self.chunk
        first = index * self.chunk
        return self.rows[index][start - first : stop - first].copy()

    def identity(self) -> dict[str, Any]:
        """Return nothing that could be compared: an excerpt is never stored."""
        return {"source": "excerpt"}
