"""Draw maps and a comparison for the guides and the README, as ``--plot`` does; two are small.

``python docs/examples/sweep_map.py --output FOLDER``
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.legend import Legend

import ftforce
from ftforce.batch.sweep import sweep
from ftforce.batch.workspace_map import workspace_map
from ftforce.show import plots
from ftforce.show.figures import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(folder: Path) -> None:
    """Draw sweeps of TIAGo, whose first joint slides, and of the Panda; and four arms."""
    million = sweep(ftforce.load_robot("panda"), n=1e6, faults=2)
    save_figure(million, folder / "map-panda.svg")
    found = sweep(ftforce.load_robot("tiago"), n=2**17, force=[0, 0, 50])
    save_figure(found, folder / "map-tiago.svg")
    pairs = sweep(ftforce.load_robot("panda"), n=2**17, faults=2, force=[0, 0, 50])
    solid = workspace_map(pairs, solid=True, quantities=["capability"])
    save_figure(solid, folder / "map-solid.svg")
    arms = ftforce.compare(["panda", "kinova", "ur5", "dh5"], force=[0, 0, 50])
    save_figure(arms, folder / "plot-compare.svg")
    with rc_context({"font.size": 8, "svg.hashsalt": "ftforce"}):  # of docs/index.md
        figure = Figure(figsize=(4.0, 2.5), layout="constrained")
        without_key(plots.survival(million, plane="xz", ax=figure.add_subplot()))
        figure.axes[1].set_ylabel("tolerated [%]")
        figure.savefig(folder / "front-map.svg", metadata={"Date": None})
        figure = Figure(figsize=(4.0, 2.5), layout="constrained")
        without_key(plots.comparison(arms, shown="rho", ax=figure.add_subplot()))
        figure.savefig(folder / "front-compare.svg", metadata={"Date": None})


def without_key(ax: Axes) -> None:
    """Leave out the title and the key, which are too wide for a small figure."""
    ax.set_title("")
    for legend in [child for child in ax.get_children() if isinstance(child, Legend)]:
        legend.remove()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(), metavar="FOLDER")
    draw(parser.parse_args().output)
