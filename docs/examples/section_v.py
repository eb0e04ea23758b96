"""Draw the paper's simulation, Section V: Figs. 1 to 4.

``python docs/examples/section_v.py --output section-v.svg``
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from ftforce.show import plots
from ftforce.trajectory.section_v import section_v


def draw(path: Path) -> None:
    """Draw the four figures of the paper."""
    history = section_v(rate=20)
    with rc_context({"font.size": 8}):
        figure = Figure(figsize=(7.1, 9.0), layout="constrained")
        grid = figure.add_gridspec(4, 1, height_ratios=(2.4, 1.5, 1.5, 1.2))
        way = figure.add_subplot(grid[0], projection="3d")
        plots.path(history, ax=way).set_title("Fig. 1: path of the tip", loc="left")
        healthy, locked, force = (figure.add_subplot(grid[i]) for i in (1, 2, 3))
        plots.torques(history, "healthy", ax=healthy)
        plots.torques(history, "remapped", ax=locked)
        plots.force(history, ax=force)
        for axes, title in (
            (healthy, "Fig. 2: torques of the healthy arm"),
            (locked, "Fig. 3: torques, joint 3 locks after 50 s"),
            (force, "Fig. 4: force at the tip, healthy and faulty"),
        ):
            axes.set_title(title, loc="left", pad=14.0)  # above the mark of the fault
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("section-v.svg"), metavar="FILE")
    draw(parser.parse_args().output)
