"""Draw which forces a Panda can hold when joints lock, swing freely or get weak.

The drawing is a section: forces in the vertical plane of the arm, fy = 0. It needs matplotlib.
``python docs/examples/fault_modes.py`` writes fault-modes.svg into the current folder,
``--output FILE`` another file.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import ftforce

if TYPE_CHECKING:
    from ftforce.analysis.capability import Capability

HERE = Path(__file__).resolve().parent
PICTURE = Path("fault-modes.svg")
LIMITS = HERE / "panda_limits.toml"
PUSH = np.array([0.0, -50.0])  # N, down on a table

# Okabe and Ito's colours, which colour-blind people can tell apart. In print the hatch, the line
# style and the words tell the same.
BLUE, ORANGE, GREEN, PINK, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#777777"
HEALTHY = {"fill": False, "edgecolor": GREY, "linestyle": "--", "linewidth": 1.2}
HELD = {"facecolor": "none", "hatch": "////", "linewidth": 1.2}
SIGN = {"linestyle": "none", "color": "black"}
ASKED = SIGN | {"marker": "o", "markersize": 9, "markerfacecolor": "none"}
NEAREST = SIGN | {"marker": "x", "markersize": 7, "markeredgewidth": 2}
NO_FORCE = SIGN | {"marker": "+", "markersize": 10}


class Panel(NamedTuple):
    """One fault: title, options of `ftforce.capability`, colour."""

    title: str
    faults: dict[str, Any]
    colour: str


PANELS = (
    Panel("healthy", {}, BLUE),
    Panel("joints 2 and 4 locked", {"locked": [2, 4]}, ORANGE),
    Panel("joint 4 free", {"free": [4]}, PINK),
    Panel("joint 4 weak, 30 %", {"weak": {4: 0.3}}, GREEN),
)


def case(faults: dict[str, Any]) -> Capability:
    """Return the capability of the Panda in its default posture, in the plane x–z of its base."""
    arm = ftforce.load_robot("panda")
    return ftforce.capability(arm, limits=LIMITS, task="fx,fz", axes="world", **faults)


def corners(capability: Capability, *, after: bool, reading: str) -> np.ndarray:
    """Return the corners of the forces that can be held, round their middle, shape (k, 2)."""
    polytope = capability.polytope(after=after, reading=reading)
    assert polytope.is_bounded
    x, z = (polytope.vertices - polytope.vertices.mean(axis=0)).T
    return polytope.vertices[np.argsort(np.arctan2(z, x))]


def draw(axes: Any, panel: Panel) -> None:
    """Draw one panel."""
    found = case(panel.faults)
    axes.fill(*corners(found, after=False, reading="commanded").T, **HEALTHY)
    made = corners(found, after=True, reading="commanded")
    if "locked" in panel.faults:
        axes.fill(*corners(found, after=True, reading="held").T, edgecolor=panel.colour, **HELD)
    if len(made) > 2:
        axes.fill(*made.T, facecolor=panel.colour + "55", edgecolor=panel.colour, linewidth=1.8)
    else:  # a segment
        axes.plot(*made.T, color=panel.colour, linewidth=4, solid_capstyle="butt")
    result = ftforce.analyze(
        found.analysis.robot, limits=LIMITS, task="fx,fz", axes="world", force=PUSH, **panel.faults
    )
    assert result.force is not None
    axes.plot(0.0, 0.0, **NO_FORCE)
    axes.plot(*PUSH, **ASKED)
    axes.plot(*result.force.after, **NEAREST)
    axes.set(title=panel.title, xlabel="fx [N]", aspect="equal", axisbelow=True)
    axes.grid(color="#dddddd", linewidth=0.6)


def figure() -> Any:
    """Return the figure."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    drawing = Figure(figsize=(9.6, 5.4), layout="constrained")
    for axes, panel in zip(drawing.subplots(1, 4, sharex=True, sharey=True), PANELS, strict=True):
        draw(axes, panel)
    drawing.axes[0].set_ylabel("fz [N], up is positive")
    signs = {
        "force that is asked for, 50 N down": Line2D([], [], **ASKED),
        "what the motors can command (area or line)": Patch(fc="#bbbbbb", ec="black", lw=1.8),
        "what the motors command instead": Line2D([], [], **NEAREST),
        "what the locks help to hold": Patch(ec="black", **HELD),
        "no force": Line2D([], [], **NO_FORCE),
        "the healthy arm": Patch(**HEALTHY),
    }
    drawing.legend(signs.values(), signs, loc="outside lower center", ncols=3, frameon=False)
    return drawing


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=PICTURE, metavar="FILE")
    output = parser.parse_args().output
    import matplotlib as mpl

    with mpl.rc_context({"svg.hashsalt": "ftforce", "svg.fonttype": "path"}):
        figure().savefig(output, metadata={"Date": None})
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
