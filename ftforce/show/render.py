"""Which table shows which result."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.analysis import Analysis
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.closed_forms import Remap
from ftforce.fault_census import Census
from ftforce.fault_timeline import Timeline
from ftforce.force_capability import Capability
from ftforce.history import History
from ftforce.replicate import Replication
from ftforce.robot import Robot
from ftforce.show.analysis import analysis_view
from ftforce.show.capability import capability_view
from ftforce.show.census import census_view
from ftforce.show.comparison import comparison_view
from ftforce.show.history import history_view
from ftforce.show.map import map_view
from ftforce.show.remap import remap_view
from ftforce.show.replication import replication_view
from ftforce.show.robot import robot_view
from ftforce.show.sweep import sweep_view
from ftforce.show.timeline import timeline_view

if TYPE_CHECKING:
    from rich.console import RenderableType


@singledispatch
def render(result: object) -> RenderableType:
    """Return what rich prints of a result."""
    return Text(repr(result))


render.register(Analysis, analysis_view)
render.register(Capability, capability_view)
render.register(Census, census_view)
render.register(Comparison, comparison_view)
render.register(History, history_view)
render.register(Remap, remap_view)
render.register(Replication, replication_view)
render.register(Robot, robot_view)
render.register(Sweep, sweep_view)
render.register(Timeline, timeline_view)
render.register(WorkspaceMap, map_view)
