"""Compile all kernels ahead, for whoever builds a container or must never wait."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.analysis.question import AllFaultSets
from ftforce.batch.compiled import ENOUGH_POSTURES, are_kept, load_kernels
from ftforce.batch.postures.postures import Listed
from ftforce.batch.sweep import request_of, sweep_question
from ftforce.errors import FtforceError, UnknownNameError
from ftforce.robot.load import load_robot

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_FORCE: dict[str, Any] = {"force": [80.0, 50.0, 10.0]}
_WRENCH: dict[str, Any] = {
    "force": [80.0, 50.0, 10.0, 5.0, 2.0, 1.0],
    "task": "wrench",
    "length": 0.3,
}
_SWEEPS = {
    "force": ((_FORCE, "locked"),),
    "wrench": ((_WRENCH, "locked"),),
    "free": ((_FORCE, "free"), (_WRENCH, "free")),
}
KERNELS = (*_SWEEPS, "remapper")
"""What there is to compile: for sweeps of tasks of three rows, of other tasks and of free-swinging
joints, and for control loops."""


def warmup(
    kernels: Sequence[str] = KERNELS, report: Callable[[str, float], None] | None = None
) -> dict[str, float]:
    """Compile kernels that are not compiled yet, so that no later call waits for it.

    Parameters
    ----------
    kernels :
        Which ones, of ``KERNELS``.
    report :
        Called after each with its name and the time that it took, s.

    Returns
    -------
    :
        The time that each took, s.

    Raises
    ------
    UnknownNameError
        There is no group of kernels of that name.
    FtforceError
        The extra ``sweep`` is not installed, or no folder can keep what is compiled.
    """
    kernels = [kernels] if isinstance(kernels, str) else kernels
    for name in kernels:
        if name not in KERNELS:
            raise UnknownNameError("group of kernels", name, KERNELS)
    found = {}
    for name in kernels:
        start = time.monotonic()
        _compile(name)
        found[name] = time.monotonic() - start
        if report is not None:
            report(name, found[name])
    if not are_kept():
        raise FtforceError(
            "the kernels are compiled, but no folder can keep them: name one that can be written "
            "in NUMBA_CACHE_DIR"
        )
    return found


def _compile(name: str) -> None:
    robot = load_robot("dh5")
    if name == "remapper":
        from ftforce.batch.remapper import Remapper

        for mode in ("locked", "free"):  # with free-swinging joints as with limits
            Remapper(robot, mode=mode)
            Remapper(m=3, n=7, mode=mode)
        return
    q = np.random.default_rng(0).uniform(*robot.ranges, (ENOUGH_POSTURES, robot.n))
    q[0] = 0.0  # singular
    for asked, mode in _SWEEPS[name]:
        question, sets = sweep_question(robot, **asked), AllFaultSets.parse(robot, 2, mode)
        postures = Listed.of(robot, q)
        load_kernels(request_of(question, sets, postures, keep="worst", cell=None).job)
