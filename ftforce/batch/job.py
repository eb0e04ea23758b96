"""A sweep split into independent chunks, for threads or workers."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.plan import Evaluator, as_block, empty_answers
from ftforce.batch.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ftforce.batch.kernels.layout import Answers, Block
    from ftforce.batch.plan import Plan
    from ftforce.batch.postures.postures import Postures
    from ftforce.batch.summary.bins import Bins, Workspace
    from ftforce.core.arrays import Matrix

    Samples = dict[str, NDArray[Any]]

PIECE = 4096
"""Postures in the smallest chunk; pieces are this number, halved or doubled repeatedly."""
_BLOCK_RESULTS = 2**17
"""Postures times fault sets evaluated at once: few enough for the results to stay in cache, and
enough for threads to acquire the GIL hundreds of times a second rather than thousands."""
_MIN_PIECE, _MAX_PIECE = PIECE // 16, 4 * PIECE

PER_SET = (
    *("verdict", "rank_lost", "sigma_min", "margin", "rho"),
    *("jump", "moment_jump", "relative_jump", "capability"),
)
PER_POSTURE = ("q", "tip", "healthy_rank", "healthy_margin")


@dataclass(frozen=True, eq=False)
class Job:
    """All that is needed to process any chunk.

    Attributes
    ----------
    plan :
        What to compute at every posture.
    postures :
        The postures.
    bins, workspace :
        Histogram bins and workspace cells of the summary.
    keep :
        ``all``, ``worst`` or ``summary``.
    chunk :
        Postures per chunk.
    uses_numpy :
        Whether postures are evaluated and counted with NumPy instead of the compiled kernels.
    evaluator_type :
        What evaluates them with the compiled kernels; ``None`` for `Reusing`.
    """

    plan: Plan
    postures: Postures
    bins: Bins
    workspace: Workspace
    keep: str
    chunk: int
    uses_numpy: bool = False
    evaluator_type: type[Evaluator] | None = None
    _per_thread: threading.local = field(default_factory=threading.local, init=False)

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return math.ceil(self.postures.count / self.chunk)

    @property
    def n_sets(self) -> int:
        """Number of fault sets."""
        return len(self.plan.faults.locked)

    def range(self, index: int) -> tuple[int, int]:
        """Return the half-open range of postures of a chunk."""
        start = index * self.chunk
        return start, min(start + self.chunk, self.postures.count)

    def empty_summary(self) -> Summary:
        """Return an empty summary."""
        return Summary.empty(self.n_sets, self.bins, self.workspace)

    @property
    def is_small(self) -> bool:
        """Whether setting up threads is not worthwhile."""
        return self.postures.count * max(1, self.n_sets) <= _BLOCK_RESULTS

    @property
    def piece(self) -> int:
        """Number of postures evaluated at once, a power of two."""
        fits = max(_MIN_PIECE, min(_MAX_PIECE, _BLOCK_RESULTS // max(1, self.n_sets)))
        return 1 << (fits.bit_length() - 1)

    def run(self, index: int) -> tuple[Summary, Samples]:
        """Process a chunk.

        Returns
        -------
        :
            Its summary, and its stored samples by name: arrays of the chunk's length.

        Raises
        ------
        FileError
            The postures come from a file that cannot be read.
        """
        summary = self.empty_summary()
        return summary, self.add(index, summary)

    def add(self, index: int, summary: Summary) -> Samples:
        """Process a chunk and add it to a summary, in place.

        Parameters
        ----------
        index :
            Number of the chunk, from 0.
        summary :
            Summary to which its postures are added.

        Returns
        -------
        :
            Its stored samples by name: arrays of the chunk's length.

        Raises
        ------
        FileError
            The postures come from a file that cannot be read; part of the chunk may have been
            added.
        """
        start, stop = self.range(index)
        kept: Samples = {}
        for first in range(start, stop, self.piece):
            last = min(first + self.piece, stop)
            q = self.postures.block(first, last)
            block = self.evaluator(q)
            summary.add(block, first, compiled=not self.uses_numpy)
            if self.keep == "summary":
                continue
            for name, values in samples_of(q, block, self.keep).items():
                if name not in kept:
                    kept[name] = np.empty((stop - start, *values.shape[1:]), values.dtype)
                kept[name][first - start : last - start] = values
        return kept

    @property
    def evaluator(self) -> Callable[[Matrix], Block]:
        """Evaluator of this thread; the next call overwrites what it returned."""
        try:
            found: Callable[[Matrix], Block] = self._per_thread.evaluator
        except AttributeError:
            found = self._per_thread.evaluator = self._new_evaluator()
        return found

    def _new_evaluator(self) -> Callable[[Matrix], Block]:
        if self.uses_numpy:
            from ftforce.batch.numpy_path import NumpyEvaluator

            return NumpyEvaluator(self.plan)
        return (self.evaluator_type or Reusing)(self.plan)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickling, without the workspaces of the threads."""
        return {name: value for name, value in self.__dict__.items() if name != "_per_thread"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state; workspaces are created on demand."""
        self.__dict__.update(state, _per_thread=threading.local())


class Reusing(Evaluator):
    """Evaluator that reuses its output arrays: the next block overwrites them.

    Allocating arrays of this size means mapping new pages, which costs as much as counting their
    contents and is serialized between threads.
    """

    _answers: Answers | None = None

    def __call__(self, q: Matrix) -> Block:
        """Return the results for postures, see `Evaluator`; valid until the next call."""
        answers = self._answers
        if answers is None or len(answers.tip) != len(q):
            answers = self._answers = empty_answers(self.plan, len(q))
        self._fill(answers, q)
        return as_block(answers)


def samples_of(q: Matrix, block: Block, keep: str) -> Samples:
    """Return the samples to store for a block, arrays with one row per posture.

    Parameters
    ----------
    q :
        Joint positions, rad or m, shape (k, n).
    block :
        Results at these postures.
    keep :
        ``all`` or ``worst``.
    """
    found: Samples = {
        "q": q,
        "tip": block.tip,
        "healthy_rank": block.rank,
        "healthy_margin": block.healthy_margin,
    }
    measures = {name: getattr(block, name) for name in PER_SET}
    measures = {name: values for name, values in measures.items() if values is not None}
    if keep == "all":
        return found | {name: values.T for name, values in measures.items()}
    worst = _worst_sets(block)
    found["worst_set"] = worst.astype(np.int32)
    at = np.arange(len(q))
    return found | {f"worst_{name}": values[worst, at] for name, values in measures.items()}


def _worst_sets(block: Block) -> NDArray[np.intp]:
    """Return the worst fault set of each posture, shape (k,).

    Ordered by worst verdict, then largest relative jump, then smallest margin, then index.
    """
    jump = block.relative_jump
    keys = [block.margin, -block.verdict.astype(np.int64)]
    if jump is not None:
        keys.insert(1, -jump)
    rank: NDArray[np.intp] = np.lexsort(tuple(keys), axis=0)[0]
    return rank
