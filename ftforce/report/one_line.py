"""A result in one line: what it is of, and the verdict. This is its ``repr``."""

from __future__ import annotations

import math
from functools import singledispatch

import numpy as np

from ftforce.analysis.analyze import Analysis
from ftforce.analysis.capability import Capability
from ftforce.analysis.census import Census
from ftforce.analysis.paper import Replication
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.core.remap import Remap
from ftforce.planning.path import PathPlan
from ftforce.planning.posture import BestPosture
from ftforce.planning.reach import FailureTolerantWorkspace
from ftforce.report.analysis import verdict_sentence
from ftforce.report.capability import capability_sentence
from ftforce.report.census import critical_joint
from ftforce.report.comparison import comparison_sentence
from ftforce.report.history import history_sentence
from ftforce.report.map import map_sentence
from ftforce.report.plan import plan_sentence
from ftforce.report.posture import posture_sentence
from ftforce.report.reach import reach_sentence
from ftforce.report.robot import replication_sentence
from ftforce.report.sweep import sweep_sentence
from ftforce.report.text import number
from ftforce.report.timeline import timeline_sentence
from ftforce.trajectory.history import History
from ftforce.trajectory.timeline import Timeline


def in_one_line(result: object) -> str:
    """Return the type of a result, what it is of, and the sentence that sums it up.

    Parameters
    ----------
    result :
        A result.
    """
    words = " ".join(_words(result).split()).removesuffix(".")
    return f"<{type(result).__name__} {words}>"


@singledispatch
def _words(result: object) -> str:
    return f"at {id(result):#x}"


@_words.register
def _(result: Analysis) -> str:
    return f"{result.robot.name!r}: {verdict_sentence(result)}"


@_words.register
def _(result: Census) -> str:
    return f"{result.robot.name!r}, {len(result.sets)} {result.mode} sets: {critical_joint(result)}"


@_words.register
def _(result: Capability) -> str:
    return f"{result.analysis.robot.name!r}: {capability_sentence(result)}"


@_words.register
def _(result: History) -> str:
    return f"{result.setting.robot!r}, {len(result.t):,} instants: {history_sentence(result)}"


@_words.register
def _(result: Timeline) -> str:
    return f"{result.robot.name!r}, {len(result.t):,} instants: {timeline_sentence(result)}"


@_words.register
def _(result: PathPlan) -> str:
    return f"{result.robot.name!r}, {len(result.t):,} instants: {plan_sentence(result)}"


@_words.register
def _(result: BestPosture) -> str:
    return f"{result.robot.name!r}: {posture_sentence(result)}"


@_words.register
def _(result: FailureTolerantWorkspace) -> str:
    return f"{result.robot.name!r}: {reach_sentence(result)}"


@_words.register
def _(result: Sweep) -> str:
    return f"{result.setting.robot!r}: {sweep_sentence(result)}"


@_words.register
def _(result: WorkspaceMap) -> str:
    return f"{result.sweep.setting.robot!r}: {map_sentence(result)}"


@_words.register
def _(result: Comparison) -> str:
    return f"of {len(result.arms)} arms: {comparison_sentence(result)}"


@_words.register
def _(result: Replication) -> str:
    return f"of the paper: {replication_sentence(result)}"


@_words.register
def _(result: Remap) -> str:
    before, jump = number(math.hypot(*result.F.tolist())), number(result.jump_norm)
    locked = int(np.count_nonzero(result.reduced.locked))
    return f"of {len(result.tau)} joints, {locked} locked: the force {before} jumps by {jump}"
