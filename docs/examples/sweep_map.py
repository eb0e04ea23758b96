"""Draw maps and a comparison for the guides and the README, as ``--plot`` does.

``python docs/examples/sweep_map.py --output FOLDER``
"""

from __future__ import annotations

import argparse
from pathlib import Path

import ftforce
from ftforce.batch.sweep import sweep
from ftforce.batch.workspace_map import workspace_map
from ftforce.show.figures import save_figure


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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(), metavar="FOLDER")
    draw(parser.parse_args().output)
