"""Draw the pictures of docs/guides/plots.md, as ``--plot`` does, and three of docs/index.md.

``python docs/examples/plots.py --output FOLDER``
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import ftforce
from ftforce.show import plots
from ftforce.show.figures import save_figure
from ftforce.trajectory import Path as Line


def draw(folder: Path) -> None:
    """Draw what `--plot` draws of the Panda, for seven commands."""
    arm = ftforce.load_robot("panda")
    start = [0.306871, 0.0, 0.486876]  # where the default posture has the tip
    line = Line.through([start, [0.4, 0.3, 0.4]], speed=0.2)
    push = {"force": [0, 0, 30]}
    history = ftforce.simulate(arm, line, faults="free:4@1", **push)
    save_figure(history, folder / "plot-simulation.svg")
    instants = ftforce.timeline(arm, line, mode="free", rate=20, **push)
    save_figure(instants, folder / "timeline.svg")
    across = Line.through([(0.5, -0.2, 0.4), (0.5, 0.2, 0.4)], speed=0.1, keep_orientation=True)
    save_figure(ftforce.plan(arm, across), folder / "plan.svg")
    paper = ftforce.load_robot("dh5")
    tool = Line.through([(0.9471, 0.2197, 0.1693), (0.8548, 0.3804, 0.2308)], speed=0.15)
    asked = {"force": [80.0, 50.0, 10.0], "axes": "world", "faults": 2, "waypoints": 20}
    lasting = ftforce.plan(paper, tool, maximize="jump", **asked)
    save_figure(lasting, folder / "plan-lock.svg")
    save_figure(ftforce.best_posture(arm, like="default"), folder / "posture.svg")
    save_figure(ftforce.reach(arm, soften=True, release=True), folder / "reach.svg")
    sets = ftforce.census(arm, faults=2, mode="free", **push)
    save_figure(sets, folder / "plot-census.svg")
    forces = ftforce.capability(arm, locked=[4], axes="world")
    save_figure(forces, folder / "plot-capability.svg")
    small = {"layout": "constrained", "figsize": (4.0, 2.5)}
    with rc_context({"font.size": 8, "svg.hashsalt": "ftforce"}):
        figure = Figure(**small)
        draw_polytope(figure, ftforce.capability(arm, weak={2: 0.3, 4: 0.3}, axes="world"))
        figure.savefig(folder / "front-polytope.svg", metadata={"Date": None})
        figure = Figure(**small)
        plots.force(history, ax=figure.add_subplot()).set_title("")
        figure.savefig(folder / "front-fault.svg", metadata={"Date": None})
        figure = Figure(**small)
        plots.heat_map(instants, ax=figure.add_subplot()).set_title("")
        figure.savefig(folder / "front-timeline.svg", metadata={"Date": None})


def draw_polytope(figure: Figure, result: ftforce.Capability) -> None:
    """Draw the forces that the arm can hold before and after the fault, in three dimensions."""
    before, after = (result.polytope(after=which) for which in (False, True))
    reach = abs(before.vertices).max()
    names = {"before": (before, "#56B4E9"), "after": (after, "#D55E00")}
    for place, (title, (polytope, colour)) in enumerate(names.items(), 1):
        ax = figure.add_subplot(1, 2, place, projection="3d")
        faces = [polytope.vertices[list(face)] for face in polytope.faces]
        ax.add_collection3d(
            Poly3DCollection(faces, facecolor=colour, edgecolor="black", linewidth=0.8, alpha=0.6)
        )
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-reach, reach), title=title)
        ax.set(xticks=(0,), yticks=(0,), zticks=(0,), xlabel="fx", ylabel="fy", zlabel="fz")
        ax.tick_params(labelbottom=False, labelleft=False, labelright=False, labeltop=False)
        ax.set_box_aspect((1, 1, 1), zoom=0.85)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(), metavar="FOLDER")
    draw(parser.parse_args().output)
