"""A sweep cut into chunks, each of which any thread or worker can do on its own."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.summary import Summary

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.arrays import Matrix
    from ftforce.batch.bins import Bins, Workspace
    from ftforce.batch.plan import Evaluator, Plan
    from ftforce.batch.postures import Postures
    from ftforce.batch.results import Block

    Samples = dict[str, NDArray[Any]]

PIECE = 4096
"""Postures that are answered at once: their answers fit into the processor's caches."""

PER_SET = ("verdict", "rank_lost", "sigma_min", "margin", "rho", "jump", "moment_jump",
           "relative_jump", "capability")  # fmt: skip
PER_POSTURE = ("q", "tip", "healthy_rank", "healthy_margin")


@dataclass(frozen=True, eq=False)
class Job:
    """All that is needed to do any chunk.

    Attributes
    ----------
    plan :
        What is asked of every posture.
    postures :
        The postures.
    bins, workspace :
        Of the summary.
    keep :
        ``all``, ``worst`` or ``summary``.
    chunk :
        Postures per chunk.
    """

    plan: Plan
    postures: Postures
    bins: Bins
    workspace: Workspace
    keep: str
    chunk: int
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
        """Return the first posture of a chunk, and the first after it."""
        start = index * self.chunk
        return start, min(start + self.chunk, self.postures.count)

    def empty_summary(self) -> Summary:
        """Return the summary of no posture."""
        return Summary.empty(self.n_sets, self.bins, self.workspace)

    def run(self, index: int) -> tuple[Summary, Samples]:
        """Do a chunk.

        Returns
        -------
        :
            Its summary, and what is kept of its postures, by name: arrays of the chunk's length.

        Raises
        ------
        FileError
            The postures come from a file that cannot be read.
        """
        summary, pieces = self.empty_summary(), []
        start, stop = self.range(index)
        for first in range(start, stop, PIECE):
            q = self.postures.block(first, min(first + PIECE, stop))
            block = self._evaluator(q)
            summary.add(block, first)
            if self.keep != "summary":
                pieces.append(samples_of(q, block, self.keep))
        joined = (
            {name: np.concatenate([p[name] for p in pieces]) for name in pieces[0]}
            if pieces
            else {}
        )
        return summary, joined

    @property
    def _evaluator(self) -> Evaluator:
        try:
            found: Evaluator = self._per_thread.evaluator
        except AttributeError:
            found = self._per_thread.evaluator = self.plan.evaluator()
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Leave the per-thread workspaces behind when pickled."""
        return {name: value for name, value in self.__dict__.items() if name != "_per_thread"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore, and start with no workspace."""
        self.__dict__.update(state, _per_thread=threading.local())


def samples_of(q: Matrix, block: Block, keep: str) -> Samples:
    """Return what is kept of a block, each array with one row per posture.

    Parameters
    ----------
    q :
        The postures, shape (k, n).
    block :
        The answers.
    keep :
        ``all`` or ``worst``.
    """
    found: Samples = {
        "q": q,
        "tip": block.tip,
        "healthy_rank": block.rank,
        "healthy_margin": block.healthy_margin,
    }
    asked = {name: getattr(block, name) for name in PER_SET}
    asked = {name: values for name, values in asked.items() if values is not None}
    if keep == "all":
        return found | {name: values.T for name, values in asked.items()}
    worst = worst_sets(block)
    found["worst_set"] = worst.astype(np.int32)
    at = np.arange(len(q))
    return found | {f"worst_{name}": values[worst, at] for name, values in asked.items()}


def worst_sets(block: Block) -> NDArray[np.intp]:
    """Return the worst fault set of each posture, shape (k,).

    The worst verdict, then the largest relative jump, then the smallest margin, then the first.
    """
    jump = block.relative_jump
    keys = [block.margin, -block.verdict.astype(np.int64)]
    if jump is not None:
        keys.insert(1, -jump)
    rank: NDArray[np.intp] = np.lexsort(tuple(keys), axis=0)[0]
    return rank
