"""Compile the kernels once, in all processors, before many tests at once wait for them.

Run as a program. Numba keeps what is compiled beside the installed kernels, and with a folder as
argument it is kept there, too, for the next environment: `python compile_kernels.py FOLDER`.
An entry counts only for the same kernels, Python, numba and processor, which numba checks.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import ftforce
from ftforce.batch.warmup import KERNELS, warmup


def entries(folder: Path) -> dict[str, int]:
    """Return the files of numba's cache, and what ftforce knows of it, with their last change."""
    kept = (*folder.glob("*.nb?"), *folder.glob("ftforce-kernels.*"))
    return {file.name: file.stat().st_mtime_ns for file in kept}


def copy(source: Path, target: Path) -> None:
    """Replace a folder's entries at once: another session may be reading them."""
    target.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(dir=target.parent))
    for name in entries(source):
        shutil.copy2(source / name, fresh)
    shutil.rmtree(target, ignore_errors=True)
    fresh.rename(target)


def main(kept: Path | None) -> None:
    """Compile what is not in the cache yet, and keep it."""
    beside = Path(ftforce.__file__).parent / "batch" / "kernels" / "__pycache__"
    if kept is not None:
        import numba

        kept = kept / f"{sys.implementation.cache_tag}-numba-{numba.__version__}"
        beside.mkdir(exist_ok=True)
        for name in entries(kept):
            shutil.copy2(kept / name, beside)
    before = entries(beside)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(warmup, [[name] for name in KERNELS]))
    if kept is not None and entries(beside) != before:
        copy(beside, kept)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
