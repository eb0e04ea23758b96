"""Ranks of sorted items, shared by ties."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Sequence


class Rank(NamedTuple):
    """The places that an item may take in a ranking, from 1.

    Attributes
    ----------
    first, last :
        The same without a tie; items that tie share theirs.
    """

    first: int
    last: int

    def __str__(self) -> str:
        """Return ``2``, or ``2–4`` for a tie."""
        return str(self.first) if self.first == self.last else f"{self.first}–{self.last}"


def ranks_of(keys: Iterable[Hashable]) -> tuple[Rank, ...]:
    """Return the ranks of items in their order; neighbours with equal keys tie.

    Parameters
    ----------
    keys :
        Sort keys without what only breaks ties, in the order of the items.
    """
    found: list[Rank] = []
    for _, group in groupby(keys):
        count, before = len(list(group)), len(found)
        found += [Rank(before + 1, before + count)] * count
    return tuple(found)


def ranks_of_intervals(intervals: Sequence[tuple[float, float]]) -> tuple[Rank, ...]:
    """Return the ranks that intervals allow: those that overlap share theirs; the largest is first.

    Parameters
    ----------
    intervals :
        Lower and upper ends.
    """
    return tuple(
        Rank(
            1 + sum(other_low > high for other_low, _ in intervals),
            len(intervals) - sum(other_high < low for _, other_high in intervals),
        )
        for low, high in intervals
    )
