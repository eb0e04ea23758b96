"""The capability of an arm with no failed joint, over the postures of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.analysis.conditions import Conditions
from ftforce.analysis.limits_files import URDF, choose_limits
from ftforce.batch.arm_report import capability_of
from ftforce.batch.job import PIECE, Job
from ftforce.batch.runner import threads_of
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.batch.sweep import plan_of
from ftforce.core.faults import FaultSet
from ftforce.core.task import Task

if TYPE_CHECKING:
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.batch.postures.drawn import Drawn
    from ftforce.batch.result import SweepSetting
    from ftforce.batch.summary.criticality import Estimate
    from ftforce.robot.robot import Robot

_ANYWHERE = Workspace((0.0, 0.0, 0.0), 1.0, (1, 1, 1))


def healthy_capability(
    robot: Robot,
    setting: SweepSetting,
    postures: Drawn,
    *,
    limits: LimitsLike = None,
    payload: Any = None,
    threads: int | None = None,
) -> tuple[Estimate, Estimate] | None:
    """Return the quantiles 5 % and 50 % of the capability, N (N·m); ``None`` without a direction.

    Parameters
    ----------
    robot :
        The arm.
    setting :
        What its sweep asked.
    postures :
        Those of the sweep.
    limits, payload :
        As the sweep was given them.
    threads :
        On this machine; one per processor if not given.
    """
    from concurrent.futures import ThreadPoolExecutor

    if setting.direction is None:
        return None
    axes: Any = setting.axes
    plan = plan_of(
        robot,
        (FaultSet(),),
        Task.parse(setting.components, axes, setting.length),
        Conditions.of(robot, gravity=setting.gravity, payload=payload),
        weighs=True,
        force=None,
        direction=np.array(setting.direction),
        limits=choose_limits(robot, URDF if limits is None else limits),
        rtol=setting.rtol,
        wary=setting.wary,
    )
    job = Job(plan, postures, Bins(direction=True), _ANYWHERE, "summary", 4 * PIECE)
    summary = job.empty_summary()
    with ThreadPoolExecutor(threads_of(threads)) as pool:
        for part, _ in pool.map(job.run, range(job.chunks)):
            summary.merge(part)
    return capability_of(summary)
