"""Draw the pictures of docs/guides/plots.md, as ``--plot`` does.

``python docs/examples/plots.py --output FOLDER``
"""

from __future__ import annotations

import argparse
from pathlib import Path

import ftforce
from ftforce.show.figures import save_figure
from ftforce.trajectory import Path as Line


def draw(folder: Path) -> None:
    """Draw a simulation, a timeline, a census and a capability of the Panda."""
    arm = ftforce.load_robot("panda")
    start = [0.306871, 0.0, 0.486876]  # where the default posture has the tip
    line = Line.through([start, [0.4, 0.3, 0.4]], speed=0.2)
    push = {"force": [0, 0, 30]}
    history = ftforce.simulate(arm, line, faults="free:4@1", **push)
    save_figure(history, folder / "plot-simulation.svg")
    instants = ftforce.timeline(arm, line, mode="free", rate=20, **push)
    save_figure(instants, folder / "timeline.svg")
    sets = ftforce.census(arm, faults=2, mode="free", **push)
    save_figure(sets, folder / "plot-census.svg")
    forces = ftforce.capability(arm, locked=[4], axes="world")
    save_figure(forces, folder / "plot-capability.svg")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(), metavar="FOLDER")
    draw(parser.parse_args().output)
