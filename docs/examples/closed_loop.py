"""Let an arm in MuJoCo do what a History says, on the paper's line, and compare the forces.

The tip of the paper's arm goes along its line at 15 mm/s, once on a stiff wall that it presses with
50 N, once in a carriage on which it exerts (80, 50, 10) N. At 50 s joint 3 locks, or a joint goes
free. The controller gives the motor torques of the History, with springs and dampers that keep the
joints where the History has them.

``python docs/examples/closed_loop.py`` says in words how well the forces agree, and fails where
they do not; ``--output FILE`` draws them, as .svg or .png. It needs MuJoCo, SciPy and matplotlib,
and about a minute. The simulator is tests/closed_loop.py, the one that the tests use: it is found
by its place in the checkout, as MuJoCo is no part of ftforce.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import ftforce
from ftforce.trajectory import Path as TipPath

# In front: this file has the same name.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from closed_loop import SETTLED, Loop, press, seen_from

if TYPE_CHECKING:
    from ftforce import Robot
    from ftforce.trajectory.history import History

START, END = np.array([1.150, -0.134, 0.034]), np.array([0.781, 0.509, 0.280])  # m
POSTURE = np.deg2rad([-10.0, 18.0, -6.0, -5.0, -6.0])  # the arm is almost stretched there
SPEED = 0.015  # m/s
PRESS, PUSH = (50.0,), (80.0, 50.0, 10.0)  # N
TOWARDS = np.array([1.0, 1.0, -1.0])  # roughly where the wall is
FAULT = 50.0  # s
LOCKS = 3
AGREES = 0.02  # of the force
RATE = 20.0  # samples per second of the History

# Okabe and Ito's colours, which colour-blind people can tell apart; each line is named, too.
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#777777"
TOLD = {"linewidth": 6.0, "alpha": 0.35, "solid_capstyle": "butt"}
SEEN = {"linewidth": 1.1}
ASKED = {"color": GREY, "linewidth": 1.0, "linestyle": ":"}
AT_FAULT = {"color": "black", "linewidth": 1.0, "linestyle": "--"}
FIRST = {"marker": "x", "markersize": 7, "markeredgewidth": 1.6, "linestyle": "none"}


class Place(NamedTuple):
    """What the tip presses on.

    Attributes
    ----------
    name :
        In words.
    robot :
        The arm; its root has the axes in which forces are told.
    axes :
        Those axes, in the arm's own, as columns.
    task, asked :
        Components of the force, and what is asked for, N.
    labels :
        Of the components.
    wall :
        Direction of the wall, ``None`` for a carriage.
    freed :
        The joint that goes free.
    """

    name: str
    robot: Robot
    axes: np.ndarray
    task: str
    asked: tuple[float, ...]
    labels: tuple[str, ...]
    wall: tuple[float, float, float] | None
    freed: int

    def history(self, fault: str) -> History:
        """Return what ftforce says."""
        line = TipPath.through([START @ self.axes, END @ self.axes], speed=SPEED)
        return ftforce.simulate(
            self.robot, line, POSTURE,
            force=self.asked, task=self.task, axes="world", faults=fault, rate=RATE,
            gravity=np.array([0.0, 0.0, -9.81]) @ self.axes,
        )  # fmt: skip


class Panel(NamedTuple):
    """One simulation.

    Attributes
    ----------
    place :
        What the tip presses on.
    title :
        In words.
    history, seen :
        What ftforce says, and what happened.
    remapped :
        Whether the controller reacted.
    told :
        Force of the run with the remap, at the times of the simulation, shape (N, m).
    """

    place: Place
    title: str
    history: History
    seen: Loop
    remapped: bool
    told: np.ndarray

    @property
    def error(self) -> tuple[float, float]:
        """Largest difference of the forces before and after the fault, share of what is asked."""
        seen = self.seen
        return seen.error(seen.before, self.told), seen.error(seen.after, self.told)


def places(directory: Path) -> tuple[Place, Place]:
    """Return the wall, with axes of its own, and the carriage."""
    arm = ftforce.load_robot("dh5")
    along = (END - START) / np.linalg.norm(END - START)
    into = TOWARDS - (TOWARDS @ along) * along
    into /= np.linalg.norm(into)
    axes = np.column_stack([into, along, np.cross(into, along)])
    sloping = seen_from(arm, axes, directory / "wall.urdf")
    wall = Place("wall", sloping, axes, "fx", PRESS, ("into the wall",), (1.0, 0.0, 0.0), 3)
    carriage = Place("carriage", arm, np.eye(3), "force", PUSH, ("fx", "fy", "fz"), None, 1)
    return wall, carriage


def simulated(place: Place) -> list[Panel]:
    """Return the simulations in a place: locked, and free with and without the remap."""
    found = []
    words = {"": (LOCKS, "locks"), "free:": (place.freed, "goes free")}
    for mode, (joint, word) in words.items():
        fault = f"{mode}{joint}@{FAULT:g}"
        history = place.history(fault)
        for name, run in (
            ("with the remap", history.remapped),
            ("without remap", history.unremapped),
        ):
            remapped = run is history.remapped
            if not mode and not remapped:
                continue
            seen = press(place.robot, history, run, fault, wall=place.wall)
            if remapped:
                told = seen.told
            title = f"{place.name}: joint {joint} {word}, {name}"
            found.append(Panel(place, title, history, seen, remapped, told))
            print(in_words(found[-1]), flush=True)
    return found


def in_words(panel: Panel) -> str:
    """Return how well MuJoCo and the History agree."""
    seen, (before, after) = panel.seen, panel.error
    away, drift = 1e3 * seen.off_path(seen.after), seen.drift(seen.after)
    text = (
        f"{panel.title}\n  MuJoCo and the History with the remap differ by at most "
        f"{100 * before:.2g} % of {seen.asked:.4g} N before the fault, by {100 * after:.2g} % from "
        f"{SETTLED} s after it.\n  Then springs and dampers add at most "
        f"{100 * seen.controller_share(seen.after):.2g} % to the force, the tip is within "
        f"{away:.2g} mm of its line and each joint within {drift:.2g} rad of the History's."
    )
    if seen.brake.any():
        text += f"\n  The load of the brake is within {seen.brake_error(seen.after):.2g} N·m."
    if not panel.remapped:
        first = seen.force[seen.first] - first_instant(panel)
        text += (
            f"\n  In the first instant MuJoCo and the History without the remap differ by "
            f"{100 * np.linalg.norm(first) / seen.asked:.2g} %."
        )
    return text


def first_instant(panel: Panel) -> np.ndarray:
    """Return what the History says of old torques in the instant of the fault, N, shape (m,)."""
    return panel.history.unremapped.force[panel.history.index(FAULT)]


def is_as_expected(panel: Panel) -> bool:
    """Return whether the forces agree with the remap, and without it force or place are wrong."""
    before, after = panel.error
    lost = after > AGREES or panel.seen.off_path(panel.seen.after) > 0.01
    return before < AGREES and (after < AGREES if panel.remapped else lost)


# ---- the picture -----------------------------------------------------------------------------


def draw(axes: Any, panel: Panel) -> None:
    """Draw one simulation."""
    seen = panel.seen
    fine = np.abs(seen.t - FAULT - 0.1) < 0.4
    some = np.flatnonzero((np.arange(len(seen.t)) % 400 == 0) | fine)
    for i, colour in enumerate((BLUE, ORANGE, GREEN)[: len(panel.place.asked)]):
        axes.axhline(panel.place.asked[i], **ASKED)
        axes.plot(seen.t[some], panel.told[some, i], color=colour, **TOLD)
        axes.plot(seen.t[some], seen.force[some, i], color=colour, **SEEN)
        axes.annotate(
            panel.place.labels[i], (2.0, panel.place.asked[i]), (0, 6), color=colour,
            textcoords="offset points", weight="bold",
        )  # fmt: skip
        if not panel.remapped:
            axes.plot(FAULT, first_instant(panel)[i], color=colour, **FIRST)
    axes.axvline(FAULT, **AT_FAULT)
    before, after = panel.error
    away = 1e3 * seen.off_path(seen.after)
    text = (
        f"largest difference {100 * before:.1g} % before,\n{100 * after:.2g} % from {SETTLED} s "
        f"after; tip {away:.2g} mm off"
    )
    axes.text(
        0.03, 0.03, text, transform=axes.transAxes, fontsize=8, va="bottom",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
    )  # fmt: skip
    axes.set_title(panel.title, fontsize=9.5)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def figure(rows: list[list[Panel]]) -> Any:
    """Return the figure, a row for each place."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    drawing = Figure(figsize=(11.0, 6.6), layout="constrained")
    grid = drawing.subplots(len(rows), 3, sharex=True, sharey="row")
    for line, panels in zip(grid, rows, strict=True):
        for axes, panel in zip(line, panels, strict=True):
            draw(axes, panel)
        told = np.vstack([panel.told for panel in panels])
        asked = panels[0].place.asked
        low, high = min(0.0, told.min(), *asked), max(told.max(), *asked)
        line[0].set_ylim(low - 0.35 * (high - low), high + 0.15 * (high - low))
        line[0].set_ylabel("force on the " + panels[0].place.name + " [N]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    signs = {
        "asked for": Line2D([], [], **ASKED),
        "History, with the remap": Line2D([], [], color=GREY, **TOLD),
        "MuJoCo": Line2D([], [], color="black", **SEEN),
        f"the fault, {FAULT:g} s": Line2D([], [], **AT_FAULT),
        "History, without the remap, first instant": Line2D([], [], color="black", **FIRST),
    }
    drawing.legend(signs.values(), signs, loc="outside lower center", ncols=5, frameon=False)
    return drawing


def main() -> None:
    """Simulate, say what was seen, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, metavar="FILE", help="a picture, .svg or .png")
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as directory:
        rows = [simulated(place) for place in places(Path(directory))]
    if output is not None:
        import matplotlib as mpl

        with mpl.rc_context({"svg.hashsalt": "ftforce", "svg.fonttype": "path"}):
            metadata = {"Date": None} if output.suffix == ".svg" else {}
            figure(rows).savefig(output, metadata=metadata, dpi=150)
        print(f"wrote {output}")
    wrong = [panel.title for row in rows for panel in row if not is_as_expected(panel)]
    if wrong:
        sys.exit("not as expected: " + "; ".join(wrong))


if __name__ == "__main__":
    main()
