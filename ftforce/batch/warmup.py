"""Compile all kernels ahead, for whoever builds a container or must never wait."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.analysis.question import AllFaultSets
from ftforce.batch.compiled import load_kernels
from ftforce.batch.postures.postures import Listed
from ftforce.batch.sweep import request_of, sweep_question
from ftforce.robot.load import load_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_COUNT = 4096  # postures, so many that some are left to the accurate kernels
_FORCE: dict[str, Any] = {"force": [80.0, 50.0, 10.0]}
_WRENCH: dict[str, Any] = {"force": [80.0, 50.0, 10.0, 5.0, 2.0, 1.0], "task": "wrench"}
_SWEEPS = {
    "sweeps: tasks of three rows": (_FORCE, "locked"),
    "sweeps: other tasks": (_WRENCH | {"length": 0.3}, "locked"),
    "sweeps: three rows, free-swinging joints": (_FORCE, "free"),
    "sweeps: other tasks, free-swinging joints": (_WRENCH | {"length": 0.3}, "free"),
}
_CONTROL_LOOP = "control loop: Remapper"
KERNELS = (*_SWEEPS, _CONTROL_LOOP)
"""What there is to compile, by name."""


def warmup(
    kernels: Sequence[str] = KERNELS, report: Callable[[str, float], None] | None = None
) -> dict[str, float]:
    """Compile kernels that are not compiled yet, so that no later call waits for it.

    Parameters
    ----------
    kernels :
        Which ones, of `KERNELS`.
    report :
        Called after each with its name and the time that it took, s.

    Returns
    -------
    :
        The time that each took, s.

    Raises
    ------
    FtforceError
        The extra ``sweep`` is not installed.
    """
    found = {}
    for name in kernels:
        start = time.monotonic()
        _compile(name)
        found[name] = time.monotonic() - start
        if report is not None:
            report(name, found[name])
    return found


def _compile(name: str) -> None:
    robot = load_robot("dh5")
    if name == _CONTROL_LOOP:
        from ftforce.batch.remapper import Remapper

        Remapper(robot)(np.zeros(robot.n), np.zeros(robot.n))
        return
    asked, mode = _SWEEPS[name]
    q = np.random.default_rng(0).uniform(*robot.ranges, (_COUNT, robot.n))
    q[0] = 0.0  # singular
    sets = AllFaultSets.parse(robot, 2, mode)
    question = sweep_question(robot, **asked)
    load_kernels(request_of(question, sets, Listed.of(robot, q), keep="summary", cell=None).job)
