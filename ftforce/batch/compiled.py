"""Which kernels are compiled already, and whether a sweep should wait for those that are not.

Numba knows, but importing it takes half a second. A record beside its cache therefore names the
kinds of question whose kernels are compiled, and how long that took.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import threading
import time
from collections import defaultdict
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.batch.job import Job
    from ftforce.batch.plan import Plan

CAPABILITY, ACCURATE = "-capability", "-accurate"
MOST_NUMPY_SECONDS = 4.0
"""Time, s, that an evaluation with NumPy may take before compiling the kernels is worthwhile."""
_MOST_NUMPY_SECONDS_IN_ALL = 15.0  # s, of all questions of a kind in a process
_USUAL_SECONDS = 15.0  # of compilation, where it is not known
_TRIED = (16, 512)  # postures whose evaluation by NumPy is timed: a few, and then some more
_SPARE = 10_000
"""Postures that NumPy settles, about 2 s, before the accurate kernels are compiled, about 6 s."""
ENOUGH_POSTURES = 4096  # postures, so many that some are left to the accurate kernels
_RECORD = "ftforce-kernels.{key}.{kind}.txt"  # holds the time that compilation took, s
_KERNELS = Path(__file__).parent / "kernels"

_compiling = threading.Lock()  # of several threads, one says so
_ready: set[str] = set()  # kinds whose kernels this process has used
# Time, s, that this process has left to NumPy, by kind.
_spent: defaultdict[str, float] = defaultdict(float)


def kind_of(plan: Plan) -> str:
    """Return the kind of a question: those of one kind use the same kernels."""
    rows = "three" if plan.question.rows.size == 3 else "other"
    free = "-free" if plan.faults.has_free.any() else ""
    return f"{rows}{free}{CAPABILITY if plan.question.direction.size else ''}"


def is_ready(plan: Plan, kind: str = "") -> bool:
    """Return whether the kernels of a plan are compiled, or will not be.

    Parameters
    ----------
    plan :
        The plan.
    kind :
        Its kind, with ``ACCURATE`` for the accurate kernels too; by default without these.
    """
    return _is_ready(kind or kind_of(plan))


def _needed(job: Job) -> str:
    """Return the kind of kernels that a job needs; only what is stored needs the accurate ones.

    Those of a job that stores nothing are compiled when they are needed, see `spare_postures`.
    """
    return kind_of(job.plan) + ("" if job.keep == "summary" else ACCURATE)


def spare_postures(plan: Plan) -> int:
    """Return how many postures NumPy may settle before the accurate kernels are compiled.

    Parameters
    ----------
    plan :
        What is computed.
    """
    return 0 if _is_ready(kind_of(plan) + ACCURATE) else _SPARE


@contextmanager
def compiling_accurate(plan: Plan) -> Iterator[None]:
    """Say that the accurate kernels are compiled while they are, and record it.

    Parameters
    ----------
    plan :
        What is computed.
    """
    with (
        _compiling,
        announced(kind_of(plan) + ACCURATE, "kernels for cases close to a tolerance", 7.0),
    ):
        yield


def _is_ready(kind: str) -> bool:
    is_interpreted = os.environ.get("NUMBA_DISABLE_JIT", "0") not in {"", "0"}
    return is_interpreted or kind in _ready or (_key(), kind) in _recorded()


def with_faster_evaluator(job: Job) -> Job:
    """Return a job that evaluates its postures with NumPy if that is faster than compiling.

    Parameters
    ----------
    job :
        The job; that of a sweep which is resumed stays as it is.
    """
    if is_ready(job.plan):
        return job
    numpy_job, kind = replace(job, uses_numpy=True), kind_of(job.plan)
    seconds = _numpy_seconds(numpy_job)
    if seconds > MOST_NUMPY_SECONDS or seconds + _spent[kind] > _MOST_NUMPY_SECONDS_IN_ALL:
        return job
    _spent[kind] += seconds
    return numpy_job


def compile_kernels(job: Job) -> None:
    """Compile the kernels of a job now, and say so, unless that has been done or is not needed.

    Parameters
    ----------
    job :
        The job.
    """
    kind = _needed(job)
    if job.uses_numpy or kind in _ready:
        return
    if is_ready(job.plan, kind):
        _ready.add(kind)
        return
    _announce(kind, "kernels for this kind of question")
    load_kernels(job)


def _announce(kind: str, what: str, usual: float = _USUAL_SECONDS) -> None:
    last = [seconds for (_, other), seconds in _recorded().items() if other == kind]
    _say(f"compiling the {what}, once per installation: about {max(last, default=usual):.0f} s")


@contextmanager
def announced(kind: str, what: str, usual: float) -> Iterator[None]:
    """Say that something is compiled while it is, unless it has been, and record the time taken.

    Parameters
    ----------
    kind :
        What is compiled, in the record.
    what :
        The same in words.
    usual :
        Time that it takes, s, where nothing is recorded.
    """
    if _is_ready(kind):
        yield
        return
    _announce(kind, what, usual)
    start = time.monotonic()
    yield
    _record(kind, time.monotonic() - start)


def load_kernels(job: Job) -> None:
    """Compile the kernels of a job, or load those that are compiled.

    Parameters
    ----------
    job :
        The job.
    """
    kind, start = _needed(job), time.monotonic()
    was_ready = is_ready(job.plan, kind)
    q = job.postures.block(0, min(ENOUGH_POSTURES, job.postures.count))
    job.empty_summary().add(job.evaluator(q), 0)
    if not was_ready:
        _record(kind, time.monotonic() - start)


def are_kept() -> bool:
    """Return whether what this process compiled is kept for others."""
    return not _ready or any((_key(), kind) in _recorded() for kind in _ready)


def _record(kind: str, seconds: float) -> None:
    """Record that the kernels of a kind are compiled; if that fails, this process knows.

    Parameters
    ----------
    kind :
        The kind of question; what computes a capability, or what is close to a tolerance, computes
        all else too.
    seconds :
        Time that it took, s.
    """
    kinds = {kind, kind.replace(CAPABILITY, "")}
    kinds |= {one.removesuffix(ACCURATE) for one in kinds}
    _ready.update(kinds)
    for folder in _folders():
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            for one in kinds:
                file = folder / _RECORD.format(key=_key(), kind=one)
                file.write_text(f"{seconds:.1f}")
            break
    _recorded.cache_clear()


def _numpy_seconds(job: Job) -> float:
    """Return the time that all postures of a job take with NumPy, s, from a few of them."""
    count, seconds = job.postures.count, 0.0
    job.evaluator(job.postures.block(0, 1))  # what is imported and allocated only once
    for tried in _TRIED:
        q = job.postures.block(0, min(tried, count))
        start = time.perf_counter()
        job.evaluator(q)
        seconds = (time.perf_counter() - start) * count / len(q)
        if seconds > 10.0 * MOST_NUMPY_SECONDS:  # more than what a call costs explains
            break
    return seconds


def _say(text: str) -> None:
    """Print a message to stderr if that is a terminal or a notebook."""
    if sys.stderr is not None and (sys.stderr.isatty() or "ipykernel" in sys.modules):
        print(text, file=sys.stderr, flush=True)


def _folders() -> Iterator[Path]:
    """Yield the folders in which numba may keep what it compiles, as it chooses them."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(given)
        return
    yield _KERNELS / "__pycache__"
    with suppress(RuntimeError):  # no home
        usual = "Library/Caches" if sys.platform == "darwin" else ".cache"
        given = "" if sys.platform == "darwin" else os.environ.get("XDG_CACHE_HOME", "")
        yield Path(given or Path.home() / usual) / "numba"


@cache
def _recorded() -> dict[tuple[str, str], float]:
    """Return the time that compilation took, s, by state of the kernels and kind of question."""
    found = {}
    for folder in _folders():
        is_used = os.access(folder, os.W_OK)  # numba reads only where it can write
        # In a folder that several share, numba has one for each place of a package.
        own = hashlib.sha1(os.fsencode(_KERNELS), usedforsecurity=False).hexdigest()
        cached = chain(folder.glob("*.nbi"), folder.glob(f"{_KERNELS.name}_{own}/*.nbi"))
        if not is_used or next(cached, None) is None:  # or the cache was removed
            continue
        for file in folder.glob(_RECORD.format(key="*", kind="*")):
            with suppress(OSError, ValueError):
                _, key, kind, _ = file.name.split(".")
                found[key, kind] = float(file.read_text())
    return found


@cache
def _key() -> str:
    """Return a digest of all that a compiled kernel depends on."""
    parts = [sys.version, platform.machine(), _processor()]
    parts += [os.environ.get(f"NUMBA_CPU_{name}", "") for name in ("NAME", "FEATURES")]
    with suppress(PackageNotFoundError):
        parts.append(version("numba"))
    content = b"\0".join(file.read_bytes() for file in sorted(_KERNELS.glob("*.py")))
    return hashlib.sha256(content + "\0".join(parts).encode()).hexdigest()[:16]


def _processor() -> str:
    """Return model and abilities of the processor."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        return "\n".join(line for line in lines if line.startswith(("model name", "flags")))
    return platform.processor()
