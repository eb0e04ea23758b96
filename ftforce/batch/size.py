"""How much room the samples of a sweep take on a disk, before any posture is analysed."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.job import samples_of
from ftforce.batch.plan import as_block, empty_answers
from ftforce.batch.store.folder import disk_errors
from ftforce.errors import OutputError, printable

if TYPE_CHECKING:
    from ftforce.batch.store.store import SweepRequest

# Compressed over plain size, measured on 66,000 postures of three robots.
_POSITIONS, _MEASURES, _CODES = 0.95, 0.88, 0.15
_ZERO_IF_LOST = frozenset({"sigma_min", "margin", "rho"})
_WORTH_SAYING = 1e6  # bytes
_UNITS = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "bytes"))


def check_room(request: SweepRequest, path: Path) -> None:
    """Say at a terminal how much a sweep will store, and refuse what the disk has no room for.

    Parameters
    ----------
    request :
        The sweep.
    path :
        Where it will be stored.

    Raises
    ------
    OutputError
        The disk has less free space than the samples take.
    """
    keep = request.job.keep
    if keep == "summary":
        return
    size = samples_size(request, keep)
    other = "all" if keep == "worst" else "worst"
    takes = f"about {_in_words(size)}"
    would = f"--keep {other} would be {_in_words(samples_size(request, other))}"
    with disk_errors(path):
        folder = next(one for one in Path(path).absolute().parents if one.exists())
        free = shutil.disk_usage(folder).free
    if free < size:
        raise OutputError(
            path,
            f"cannot be written: the sweep takes {takes}, and the disk has "
            f"{_in_words(free)} free; {would}, --keep summary stores no postures",
        )
    if size >= _WORTH_SAYING and sys.stderr is not None and sys.stderr.isatty():
        print(f"storing {takes} in {printable(path)}; {would}", file=sys.stderr, flush=True)


def samples_size(request: SweepRequest, keep: str) -> float:
    """Return about how many bytes the samples of a sweep take on a disk.

    Parameters
    ----------
    request :
        The sweep.
    keep :
        ``all`` or ``worst``.
    """
    job, setting, sets = request.job, request.setting, request.sets
    n, m = setting.n, len(setting.components)
    # Zeros take no room: the margins of sets that lose a direction in every posture, because a
    # joint swings freely or fewer joints are left than task rows, and the jumps of the others.
    is_lost = [setting.mode == "free" or n - len(faults) < m for faults in sets]
    lost = float(any(is_lost) if keep == "worst" else np.mean(is_lost))
    block = as_block(empty_answers(job.plan, 1))  # any numbers: only types and shapes count
    with np.errstate(all="ignore"):
        samples = samples_of(np.zeros((1, n)), block, keep)
    size = 0.0
    for name, values in samples.items():
        ratio = _CODES if values.dtype.kind == "i" else _MEASURES
        if name in {"q", "tip"}:
            ratio = _POSITIONS
        elif name.endswith("jump"):
            ratio *= lost
        elif name.removeprefix("worst_") in _ZERO_IF_LOST:
            ratio *= 1.0 - lost
        size += ratio * values.nbytes
    return size * job.postures.count


def _in_words(size: float) -> str:
    """Format a number of bytes with two digits."""
    size = float(f"{size:.2g}")
    scale, unit = next(one for one in _UNITS if size >= one[0] or one[0] == 1.0)
    return f"{size / scale:g} {unit}"
