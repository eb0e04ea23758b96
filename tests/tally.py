"""Counts of the campaign: what was tried, what was refused, and what went wrong."""

from __future__ import annotations

import os
from collections import Counter
from typing import TYPE_CHECKING, Any

from helpers import CAMPAIGN, campaign

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

FAULTS = ("silent differences", "tracebacks", "unclear messages", "lost bytes")
COLUMNS = ("attempts", "refusals", *FAULTS)
PROPERTY = "campaign"


class Tally:
    """The counts of one test, which fails at its end if anything went wrong.

    Parameters
    ----------
    record :
        pytest's ``record_property``, whose values come back from worker processes too.
    """

    def __init__(self, record: Callable[[str, object], None]) -> None:
        self._record, self._failures = record, []
        self._counts: Counter[str] = Counter()
        self.kind = ""

    def numbers(self, kind: str, full: int, part: int = 0, parts: int = 1) -> Iterable[int]:
        """Return the numbers of the cases to try: all of them in the campaign, else a tenth.

        One case alone is tried with its number in the variable ``FTFORCE_CASE``.

        Parameters
        ----------
        kind :
            What is counted, as the report names it.
        full, part, parts :
            How many there are, and which of several equal parts is wanted.
        """
        self.kind = kind
        wanted = os.environ.get("FTFORCE_CASE")
        return range(part, campaign(full), parts) if wanted is None else [int(wanted)]

    def count(self, kind: str, count: int, *, refused: int = 0) -> None:
        """Count cases of a kind that are checked together.

        Parameters
        ----------
        kind, count, refused :
            As of `numbers` and `tried`.
        """
        self.kind = kind
        self.tried(count, refused=refused)

    def tried(self, count: int = 1, *, refused: int = 0) -> None:
        """Count cases, and how many of them were refused.

        Parameters
        ----------
        count, refused :
            How many.
        """
        self._counts["attempts"] += count
        self._counts["refusals"] += refused

    def fails(self, fault: str, case: object, why: object) -> None:
        """Note what went wrong.

        Parameters
        ----------
        fault :
            One of `FAULTS`.
        case, why :
            The case, by which it can be repeated, and what is wrong with its result.
        """
        assert fault in FAULTS
        self._counts[fault] += 1
        self._failures.append(f"{fault}, case {case}: {why}")

    def close(self) -> None:
        """Record the counts, and fail if anything went wrong."""
        if self._counts:
            self._record(PROPERTY, [self.kind, [self._counts[name] for name in COLUMNS]])
        shown = self._failures[:20]
        assert not shown, "\n".join([f"{len(self._failures)} went wrong", *shown])


def table(reports: Iterable[Any]) -> list[str]:
    """Return the lines of the report.

    Parameters
    ----------
    reports :
        pytest's reports of all tests.
    """
    sums: dict[str, list[int]] = {}
    for report in reports:
        for name, value in getattr(report, "user_properties", ()):
            if name == PROPERTY and report.when == "teardown":
                kind, counts = value
                total = sums.setdefault(kind, [0] * len(COLUMNS))
                sums[kind] = [a + b for a, b in zip(total, counts, strict=True)]
    if not sums or not CAMPAIGN:
        return []
    rows = [
        *sorted(sums.items()),
        ("together", [sum(one) for one in zip(*sums.values(), strict=True)]),
    ]
    widths = [max(map(len, sums)), *(max(9, len(name)) for name in COLUMNS)]
    header = ("", *COLUMNS)
    lines = [header, *((kind, *(f"{x:,}" for x in counts)) for kind, counts in rows)]
    return [
        "  ".join([kind.ljust(widths[0]), *map(str.rjust, counts, widths[1:])])
        for kind, *counts in lines
    ]
