"""Compile the kernels once, in all processors, before many tests at once wait for them.

Run as a program; what is compiled stays on disk, for the processes that come after.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
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


if __name__ == "__main__":
    names = sys.argv[1:] or [*QUESTIONS, "control loop"]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(compile_for, names))
