"""The same chunks on Dask: the only file that knows it.

Chunks are sent by number; a worker that is lost is survived, for Dask gives its chunks to another,
and writing a chunk twice writes the same bytes. The samples go from the workers straight into the
output, so workers must see the output's folder; only summaries travel back.
"""

from __future__ import annotations

from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError, InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ftforce.batch.job import Job
    from ftforce.batch.runner import Runner
    from ftforce.batch.store import Opened
    from ftforce.batch.summary import Summary

AHEAD = 4
"""Chunks that are given to each thread of the cluster beforehand."""
PATIENCE = 30.0  # s until a scheduler answers
_LOSSES = 10  # of workers that a chunk survives


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
    if workers is not None and (isinstance(workers, bool) or workers < 1):
        raise InputError(f"workers must be a whole number from 1 on, got {workers!r}")
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise FtforceError(
            "clusters need distributed: install the extra with pip install 'ftforce[cluster]'"
        ) from None

    def runner(job: Job, opened: Opened, chunks: Iterable[int]) -> Iterator[tuple[int, Summary]]:
        if job.keep != "summary" and output is None:
            raise InputError("samples from a cluster need an output that all workers see")
        with _client(workers, scheduler) as client:
            yield from _submit(client, job, opened, iter(chunks))

    return runner


@contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Connect, or start a cluster on this machine and end it afterwards."""
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as problem:
            raise InputError(
                f"no scheduler answers at {scheduler!r} ({problem}); "
                "an address looks like tcp://10.0.0.1:8786"
            ) from None
        with client:
            yield client
        return
    cluster = LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    )
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


def _submit(
    client: Any, job: Job, opened: Opened, chunks: Iterator[int]
) -> Iterator[tuple[int, Summary]]:
    """Give chunks to the workers, a few ahead, and take their summaries as they come."""
    from distributed import as_completed

    path = None if opened.path is None else str(opened.path.resolve())
    shared = client.scatter(job, broadcast=False)
    ahead = AHEAD * max(1, sum(client.nthreads().values()))

    def give(index: int) -> Any:
        return client.submit(do_chunk, shared, path, index, pure=False, retries=0)

    running = as_completed([give(index) for index in islice(chunks, ahead)], loop=client.loop)
    for future in running:
        index, arrays = future.result()
        from ftforce.batch.summary import Summary

        yield index, Summary.from_arrays(arrays, job.bins, job.workspace)
        for following in islice(chunks, 1):
            running.add(give(following))


def do_chunk(job: Job, path: str | None, index: int) -> tuple[int, dict[str, Any]]:
    """Do one chunk on a worker; return its number and the arrays of its summary."""
    summary, samples = job.run(index)
    if samples:
        from ftforce.batch.store import write_chunk

        assert path is not None
        write_chunk(Path(path), job, index, samples)
    return index, summary.arrays()
