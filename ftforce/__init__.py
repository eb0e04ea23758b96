"""What a robot arm can still do when a joint fails.

>>> import ftforce
>>> arm = ftforce.load_robot("panda")
>>> result = ftforce.analyze(arm, locked=[1, 4], force=[0, 0, 50])
>>> result.verdict.value
'tolerated'
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ftforce.__version__ import __version__ as __version__
from ftforce.core.display import show_with

if TYPE_CHECKING:
    from ftforce.analysis.analyze import Analysis, analyze
    from ftforce.analysis.capability import capability
    from ftforce.analysis.census import Census, census
    from ftforce.batch.comparison import Comparison, compare
    from ftforce.batch.remapper import Remapper
    from ftforce.batch.result import Sweep
    from ftforce.batch.store.store import open_sweep
    from ftforce.batch.sweep import sweep
    from ftforce.core.faults import Fault, FaultMode, FaultSet
    from ftforce.core.remap import Remap, remap
    from ftforce.core.task import Task
    from ftforce.core.verdict import Verdict
    from ftforce.errors import FtforceError
    from ftforce.planning.path import plan
    from ftforce.planning.posture import best_posture
    from ftforce.planning.reach import reach
    from ftforce.report.files import save, to_dict
    from ftforce.robot.formats.dh import DHTable
    from ftforce.robot.formats.dh_to_urdf import write_robot
    from ftforce.robot.known_robots import known_robots
    from ftforce.robot.load import load_robot
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.history import History
    from ftforce.trajectory.history_files import load_history
    from ftforce.trajectory.simulate import simulate
    from ftforce.trajectory.timeline import Timeline, timeline

_HOMES = {
    "Analysis": "analysis.analyze",
    "Census": "analysis.census",
    "Comparison": "batch.comparison",
    "DHTable": "robot.formats.dh",
    "Fault": "core.faults",
    "FaultMode": "core.faults",
    "FaultSet": "core.faults",
    "FtforceError": "errors",
    "History": "trajectory.history",
    "Remap": "core.remap",
    "Remapper": "batch.remapper",
    "Robot": "robot.robot",
    "Sweep": "batch.result",
    "Task": "core.task",
    "Timeline": "trajectory.timeline",
    "Verdict": "core.verdict",
    "analyze": "analysis.analyze",
    "best_posture": "planning.posture",
    "capability": "analysis.capability",
    "census": "analysis.census",
    "compare": "batch.comparison",
    "known_robots": "robot.known_robots",
    "load_history": "trajectory.history_files",
    "load_robot": "robot.load",
    "open_sweep": "batch.store.store",
    "plan": "planning.path",
    "reach": "planning.reach",
    "remap": "core.remap",
    "save": "report.files",
    "simulate": "trajectory.simulate",
    "sweep": "batch.sweep",
    "timeline": "trajectory.timeline",
    "to_dict": "report.files",
    "write_robot": "robot.formats.dh_to_urdf",
}

__all__ = [
    "Analysis",
    "Census",
    "Comparison",
    "DHTable",
    "Fault",
    "FaultMode",
    "FaultSet",
    "FtforceError",
    "History",
    "Remap",
    "Remapper",
    "Robot",
    "Sweep",
    "Task",
    "Timeline",
    "Verdict",
    "analyze",
    "best_posture",
    "capability",
    "census",
    "compare",
    "known_robots",
    "load_history",
    "load_robot",
    "open_sweep",
    "plan",
    "reach",
    "remap",
    "save",
    "simulate",
    "sweep",
    "timeline",
    "to_dict",
    "write_robot",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that ``import ftforce`` stays fast."""
    if name not in _HOMES:
        raise AttributeError(f"module 'ftforce' has no attribute {name!r}")
    value = getattr(import_module(f"ftforce.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted([*__all__, "__version__"])


def _render(result: Any) -> Any:
    from ftforce.show.render import render  # rich: needed only when a result is displayed

    return render(result)


def _to_html(result: Any) -> str:
    from ftforce.show.render import to_html

    return to_html(result)


def _in_one_line(result: Any) -> str:
    from ftforce.report.one_line import in_one_line

    return in_one_line(result)


show_with(_render, _to_html, _in_one_line)
