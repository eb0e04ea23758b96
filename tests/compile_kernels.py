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
from typing import Any

import numpy as np

import ftforce

FORCE, WRENCH = [80.0, 50.0, 10.0], [80.0, 50.0, 10.0, 5.0, 2.0, 1.0]
QUESTIONS: dict[str, dict[str, Any]] = {
    "force": {"force": FORCE, "faults": 2},
    "wrench": {"force": WRENCH, "task": "wrench", "length": 0.3, "faults": 2},
    "free": {"force": FORCE, "mode": "free"},
}


def compile_for(name: str) -> None:
    """Ask a question at so many postures that some are left to the accurate kernels."""
    robot = ftforce.load_robot("panda")
    if name == "control loop":
        ftforce.Remapper(robot, faults=1)(np.zeros(robot.n), np.zeros(robot.n))
    else:
        ftforce.sweep(robot, n=5000, threads=1, **QUESTIONS[name])


def entries(folder: Path) -> dict[str, int]:
    """Return the files of numba's cache with the time of their last change."""
    return {file.name: file.stat().st_mtime_ns for file in folder.glob("*.nb?")}


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
        list(pool.map(compile_for, [*QUESTIONS, "control loop"]))
    if kept is not None and entries(beside) != before:
        copy(beside, kept)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
