"""Results as plots: every function takes and returns axes of matplotlib.

Without axes there is a new figure, 180 mm wide, in sizes for print: ``ax.figure``. It is none of
pyplot's; for ``plt.show()`` make axes with pyplot and give them.
"""

from ftforce.show.plots.capability import capability
from ftforce.show.plots.census import census
from ftforce.show.plots.comparison import comparison
from ftforce.show.plots.sweep import criticality, histogram
from ftforce.show.plots.timeline import heat_map
from ftforce.show.plots.trajectory import force, jump, path, path_error, torques
from ftforce.show.plots.workspace import survival, survival_3d

__all__ = [
    "capability",
    "census",
    "comparison",
    "criticality",
    "force",
    "heat_map",
    "histogram",
    "jump",
    "path",
    "path_error",
    "survival",
    "survival_3d",
    "torques",
]
