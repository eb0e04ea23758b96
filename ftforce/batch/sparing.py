"""Sweeps without the accurate kernels: NumPy settles the few cases that need them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.compiled import compiling_accurate, spare_postures
from ftforce.batch.job import Reusing

if TYPE_CHECKING:
    from ftforce.batch.job import Job
    from ftforce.batch.kernels.layout import Answers
    from ftforce.batch.plan import Plan
    from ftforce.core.arrays import Matrix


def sparing(job: Job) -> Job:
    """Return a job that compiles the accurate kernels only if many cases need them.

    Parameters
    ----------
    job :
        The job; one that stores samples stays as it is.
    """
    # What is stored never depends on which kernels are compiled.
    is_spared = job.keep == "summary" and not job.uses_numpy and spare_postures(job.plan)
    return replace(job, evaluator_type=SparingEvaluator) if is_spared else job


class SparingEvaluator(Reusing):
    """Evaluator that leaves what the fast kernels do not decide to NumPy, until it is too much.

    Verdicts and ranks are the same; other numbers may differ in their last digits.
    """

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.spare = spare_postures(plan)

    def _settle(self, answers: Answers, q: Matrix) -> None:
        if not self.spare:
            super()._settle(answers, q)
        elif not self._is_settled(answers, q):
            with compiling_accurate(self.plan):
                super()._settle(answers, q)

    def _is_settled(self, answers: Answers, q: Matrix) -> bool:
        """Settle with NumPy what is left undecided; return whether that is little enough."""
        from ftforce.batch.kernels.layout import UNDECIDED
        from ftforce.batch.numpy_path import settle_postures

        is_left = (answers.rank == UNDECIDED) | (answers.verdict == UNDECIDED).any(axis=0)
        left = np.flatnonzero(is_left)
        self.spare = max(self.spare - len(left), 0)
        if self.spare:
            settle_postures(self.plan, q, left, answers)
        return self.spare > 0
