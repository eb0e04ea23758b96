"""Results as plots: every function draws on Matplotlib axes and returns them.

Without ``ax``, a new figure is created, 180 mm wide and sized for print; it is available as
``ax.figure``. It is not managed by pyplot: to use ``plt.show()``, create the axes with pyplot and
pass them as ``ax``.
"""

from ftforce.show.plots.capability import capability
from ftforce.show.plots.census import census
from ftforce.show.plots.comparison import comparison
from ftforce.show.plots.plan import objective_over_time, planned_positions
from ftforce.show.plots.posture import along_self_motion
from ftforce.show.plots.reach import reach_map
from ftforce.show.plots.sweep import criticality, histogram
from ftforce.show.plots.timeline import heat_map
from ftforce.show.plots.trajectory import force, jump, path, path_error, torques
from ftforce.show.plots.workspace import survival, survival_3d

__all__ = [
    "along_self_motion",
    "capability",
    "census",
    "comparison",
    "criticality",
    "force",
    "heat_map",
    "histogram",
    "jump",
    "objective_over_time",
    "path",
    "path_error",
    "planned_positions",
    "reach_map",
    "survival",
    "survival_3d",
    "torques",
]
