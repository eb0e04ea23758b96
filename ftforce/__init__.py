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

from ftforce.version import __version__ as __version__

if TYPE_CHECKING:
    from ftforce.analysis import Analysis, analyze
    from ftforce.batch.comparison import Comparison, compare
    from ftforce.batch.remapper import Remapper
    from ftforce.batch.result import Sweep
    from ftforce.batch.store import open_sweep
    from ftforce.batch.sweep import sweep
    from ftforce.closed_forms import Remap, remap
    from ftforce.dh import DHTable
    from ftforce.documents import to_dict
    from ftforce.errors import FtforceError
    from ftforce.fault_census import Census, census
    from ftforce.fault_timeline import Timeline, timeline
    from ftforce.faults import Fault, FaultMode, FaultSet
    from ftforce.files import save
    from ftforce.force_capability import capability
    from ftforce.generate import write_robot
    from ftforce.history import History
    from ftforce.history_files import load_history
    from ftforce.load import load_robot
    from ftforce.metrics import Verdict
    from ftforce.registry import known_robots
    from ftforce.robot import Robot
    from ftforce.simulation import simulate
    from ftforce.task import Task

_HOMES = {
    "Analysis": "analysis",
    "Census": "fault_census",
    "Comparison": "batch.comparison",
    "DHTable": "dh",
    "Fault": "faults",
    "FaultMode": "faults",
    "FaultSet": "faults",
    "FtforceError": "errors",
    "History": "history",
    "Remap": "closed_forms",
    "Remapper": "batch.remapper",
    "Robot": "robot",
    "Sweep": "batch.result",
    "Task": "task",
    "Timeline": "fault_timeline",
    "Verdict": "metrics",
    "analyze": "analysis",
    "capability": "force_capability",
    "census": "fault_census",
    "compare": "batch.comparison",
    "known_robots": "registry",
    "load_history": "history_files",
    "load_robot": "load",
    "open_sweep": "batch.store",
    "remap": "closed_forms",
    "save": "files",
    "simulate": "simulation",
    "sweep": "batch.sweep",
    "timeline": "fault_timeline",
    "to_dict": "documents",
    "write_robot": "generate",
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
    "capability",
    "census",
    "compare",
    "known_robots",
    "load_history",
    "load_robot",
    "open_sweep",
    "remap",
    "save",
    "simulate",
    "sweep",
    "timeline",
    "to_dict",
    "write_robot",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: ``import ftforce`` itself loads nothing heavy."""
    if name not in _HOMES:
        raise AttributeError(f"module 'ftforce' has no attribute {name!r}")
    value = getattr(import_module(f"ftforce.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted([*__all__, "__version__"])
