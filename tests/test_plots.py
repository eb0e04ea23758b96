"""Plots: what they show is what was found, and everybody can read it, also in print."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from itertools import combinations, pairwise
from pathlib import Path as FilePath
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.text import Text
from scipy.optimize import linprog

import ftforce
from ftforce.core.limits import Limits
from ftforce.errors import FtforceError, InputError, OutputError, UnknownNameError
from ftforce.robot.kinematics import task_jacobian, tip_pose
from ftforce.robot.posture import choose_posture
from ftforce.show import figures, plots
from ftforce.show.plots import canvas
from ftforce.show.plots import timeline as heat
from ftforce.show.plots.capability import slices_of
from ftforce.show.plots.census import LOOKS
from ftforce.trajectory import Path
from ftforce.trajectory.history import History, JointInfo
from helpers import CAMPAIGN, assert_close, campaign

FOLDER = FilePath(__file__).parents[1]


def history_of(name, faults, force, **case):
    arm = ftforce.load_robot(name)
    q = choose_posture(arm, None, None).q
    x = tip_pose(arm, q)[1]
    line = Path.through([tuple(x), tuple(np.add(x, [0.02, 0.1, -0.05]))], speed=0.1)
    return ftforce.simulate(arm, line, q, force=force, faults=faults, rate=20, **case)


@pytest.fixture(scope="module")
def history():
    return history_of("dh5", ["1,2@0.5", "weak:4:0.5@0.6"], [80, 50, 10])


@pytest.fixture(scope="module")
def wrench_history():
    return history_of(
        "tiago", "free:4@0.5", [0, 20, -30, 1, 2, 3], task="wrench", remap=False, limits="urdf"
    )


@pytest.fixture(scope="module")
def timeline():
    arm = ftforce.load_robot("panda")
    q = choose_posture(arm, None, None).q
    x = tip_pose(arm, q)[1]
    line = Path.through([tuple(x), tuple(np.add(x, [0.1, 0.3, -0.1]))], speed=0.1)
    return ftforce.timeline(arm, line, q, faults=2, mode="free", force=[0, 0, 60], rate=3)


@pytest.fixture(scope="module")
def census():
    return ftforce.census(ftforce.load_robot("dh5"), faults=3, force=[80, 50, 10])


@pytest.fixture(scope="module")
def capability():
    arm = ftforce.load_robot("panda")
    limits = Limits.of(arm.effort, 0.3 * np.asarray(arm.effort))
    return ftforce.capability(arm, locked=[2, 4], limits=limits, axes="world")


def replaced(result, **values):
    """Return a result with other values: dataclasses with slots have no other way in tests."""
    copied = object.__new__(type(result))
    for name in type(result).__dataclass_fields__:
        object.__setattr__(copied, name, values.get(name, getattr(result, name)))
    return copied


def lines_of(ax, count):
    """Return the lines over time, without that at zero and those of faults."""
    return [line for line in ax.lines if len(line.get_xdata()) == count]


def texts_of(ax):
    return [text.get_text() for text in ax.findobj(Text)]


def legend_of(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def renderer_of(drawn):
    """Return what measures texts, after a drawing."""
    canvas_of = FigureCanvasAgg(drawn)
    canvas_of.draw()
    return canvas_of.get_renderer()


def fault_times(ax):
    """Return where dashed lines go from bottom to top."""
    return sorted(
        line.get_xdata()[0]
        for line in ax.lines
        if list(line.get_ydata()) == [0, 1] and line.get_linestyle() == "--"
    )


# What is shown


@pytest.mark.parametrize(
    ("run", "quantity"),
    [
        ("healthy", "motor"),
        ("unremapped", "U"),
        ("remapped", "force_part"),
        ("remapped", "rnea"),
        ("unremapped", "brake"),
    ],
)
def test_torques_are_those_of_the_run(history, run, quantity):
    ax = plots.torques(history, run, quantity=quantity)
    lines = lines_of(ax, len(history.t))
    values = getattr(history.runs[run], quantity)
    assert len(lines) == values.shape[1]
    for i, line in enumerate(lines):
        assert_close(line.get_xdata(), history.t)
        assert_close(line.get_ydata(), values[:, i])
        assert line.get_label() == f"{i + 1} joint{i + 1}"
    assert ax.get_ylabel().endswith("[N·m]")
    assert ax.get_xlabel() == "time [s]"


def test_a_line_has_a_gap_where_nothing_holds_the_arm(history):
    motor = history.remapped.motor.copy()
    motor[5:9] = np.nan
    broken = replaced(history, remapped=replaced(history.remapped, motor=motor))
    ax = plots.torques(broken)
    assert np.isnan(lines_of(ax, len(history.t))[0].get_ydata()[5:9]).all()
    assert legend_of(ax)[-1] == "gap: the arm cannot be held"
    assert "gap: the arm cannot be held" not in legend_of(plots.torques(history))


def test_units_of_a_prismatic_joint_stand_in_the_legend(wrench_history):
    ax = plots.torques(wrench_history, "unremapped")
    assert ax.get_ylabel() == "motor torque [N·m, N]"
    assert legend_of(ax)[:2] == ["1 torso_lift_joint [N]", "2 arm_1_joint [N·m]"]


def test_every_fault_is_marked_at_its_time(history):
    wanted = [event.time for event in history.setting.events]
    assert wanted == [0.5, 0.6]
    for draw in (plots.torques, plots.force, plots.jump, plots.path_error):
        ax = draw(history)
        assert_close(fault_times(ax), wanted)
        names = [text for text in ax.texts if "joint" in text.get_text()]
        assert {(text.xy[0], text.get_text()) for text in names} == {
            (0.5, "1 joint1 locked, 2 joint2 locked"),
            (0.6, "4 joint4 weak 0.5"),
        }


def test_a_fault_that_takes_no_room_is_named_by_numbers(history):
    full = canvas.fault_label(history, 0.5, 100)
    assert full == "1 joint1 locked, 2 joint2 locked"
    assert canvas.fault_label(history, 0.5, len(full)) == full
    assert canvas.fault_label(history, 0.5, len(full) - 1) == "1 locked, 2 locked"
    assert canvas.fault_label(history, 0.5, 10) == "1 locked and 1 more"
    assert canvas.fault_label(history, 0.6, 10) == "4 weak 0.5"


def test_force_shows_the_components_of_all_runs(history):
    ax = plots.force(history)
    lines = lines_of(ax, len(history.t))
    wanted = [run.force[:, i] for run in history.runs.values() for i in range(3)]
    assert len(lines) == len(wanted)
    for line, values in zip(lines, wanted, strict=True):
        assert_close(line.get_ydata(), values)
    assert ax.get_ylabel() == "force [N]"
    assert legend_of(ax) == ["fx", "fy", "fz", "as if healthy", "without remap", "with remap"]


def test_curves_that_coincide_are_all_seen():
    healthy, unremapped, remapped = canvas.STROKES.values()
    assert healthy.dashes == canvas.SOLID
    assert healthy.alpha < 1.0
    assert healthy.width > unremapped.width > remapped.width  # the later ones lie on top
    assert sum(remapped.dashes[1]) > 2.0
    assert unremapped.dashes != remapped.dashes


def test_forces_and_moments_share_no_axes(wrench_history):
    both = [plots.force(wrench_history, kind=kind) for kind in (None, "force", "moment")]
    assert [ax.get_ylabel() for ax in both] == [
        "force [N]\n(moments not shown)",
        "force [N]\n(moments not shown)",
        "moment [N·m]\n(forces not shown)",
    ]
    count = len(wrench_history.t)
    assert_close(lines_of(both[2], count)[1].get_ydata(), wrench_history.healthy.force[:, 4])
    assert len(lines_of(both[1], count)) == 6  # no run with the remap


def test_jump_and_path_error_are_sizes(history):
    ax = plots.jump(history)
    for line, run in zip(lines_of(ax, len(history.t)), history.runs.values(), strict=True):
        assert_close(line.get_ydata(), np.linalg.norm(run.jump, axis=1))
    assert ax.get_ylabel() == "‖ΔF‖ [N]"
    assert history.jump_norm(history.remapped).max() > 1.0  # or this would test nothing
    ax = plots.path_error(history)
    for line, run in zip(lines_of(ax, len(history.t)), history.runs.values(), strict=True):
        assert_close(line.get_ydata(), 1000.0 * np.linalg.norm(run.path_error, axis=1))
    assert ax.get_ylabel() == "path error [mm]"


def test_rounding_looks_like_nothing(history):
    noise = replaced(history.healthy, jump=np.full_like(history.healthy.jump, 1e-13))
    quiet = replaced(history, healthy=noise, unremapped=noise, remapped=noise)
    assert_close(plots.jump(quiet).get_ylim(), (-canvas.FLOOR, 1.0))
    assert plots.jump(history).get_ylim()[1] > history.jump_norm(history.remapped).max()


def test_the_path_is_in_metres_and_one_scale(history):
    ax = plots.path(history)
    drawn = [np.array(line.get_data_3d()).T for line in ax.lines]
    runs = [run.position for run in history.runs.values()]
    for got, wanted in zip(drawn, [history.path, *runs], strict=False):
        assert_close(got, wanted)
    assert legend_of(ax)[4:] == ["start", "end", "fault"]
    tip = history.remapped.position
    assert_close(drawn[4], tip[:1])
    assert_close(drawn[5], tip[-1:])
    assert_close(drawn[6], tip[[history.index(0.5), history.index(0.6)]])
    spans = [np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())]
    assert_close(spans, [spans[0]] * 3)
    assert_close(ax.get_box_aspect() / ax.get_box_aspect()[0], [1.0, 1.0, 1.0])
    assert [ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()] == ["x [m]", "y [m]", "z [m]"]


@pytest.mark.parametrize("quantity", heat.QUANTITIES)
def test_a_heat_map_shows_every_cell(timeline, quantity):
    ax = plots.heat_map(timeline, quantity=quantity)
    values = np.vstack([getattr(timeline, quantity).T, getattr(timeline.healthy, quantity)])
    mesh = ax.collections[0].get_array()
    assert mesh.shape == values.shape
    assert (np.ma.getmaskarray(mesh) == ~np.isfinite(values)).all()
    shown = ~np.ma.getmaskarray(mesh)
    assert_close(mesh.data[shown], values[shown])
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert labels[0] == "1 panda_joint1"
    assert labels[7] == "1 panda_joint1, 2 panda_joint2"
    assert labels[-1] == "none (healthy)"
    assert ax.get_ylabel() == "free joints"
    notes = legend_of(ax)
    assert notes[0] == "worst instant"
    assert ("the arm cannot be held" in notes) == np.isnan(values).any()
    assert np.isnan(timeline.jump).any()  # or this would test nothing
    marks = np.asarray(ax.collections[-1].get_offsets())
    name = "capability_time" if quantity == "capability" else "time"
    everyone = (*timeline.worst(), timeline.healthy_worst)
    when = {worst.faults: getattr(worst, name) for worst in everyone}
    assert_close(marks[:, 0], [when[one] for one in (*timeline.sets, ftforce.FaultSet())])
    assert_close(marks[:, 1], range(len(timeline.sets) + 1))


def test_a_heat_map_is_dark_where_it_is_bad_and_has_a_unit(timeline):
    for quantity, reverse, label in (
        ("jump", True, "‖ΔF‖ [N]"),
        ("margin", False, "σ_min(K) / σ_max(J)"),
        ("capability", False, "force [N]"),
    ):
        ax = plots.heat_map(timeline, quantity=quantity)
        colour = ax.collections[0].cmap
        assert bool(luminance(colour(0.0)) > luminance(colour(1.0))) is reverse
        assert label in [other.get_ylabel() for other in ax.figure.axes]


def test_what_no_known_limit_ends_is_white_and_not_a_colour(timeline):
    capability = timeline.capability.copy()
    capability[:, 3] = np.inf
    ax = plots.heat_map(replaced(timeline, capability=capability), quantity="capability")
    assert "no known limit" in legend_of(ax)
    painted, white = ax.collections[:2]
    assert np.ma.getmaskarray(painted.get_array())[3].all()
    assert not np.ma.getmaskarray(white.get_array())[3].any()
    assert to_rgb(white.to_rgba(0.0)) == (1.0, 1.0, 1.0)
    nowhere = replaced(timeline, capability=np.full_like(capability, np.inf))
    plots.heat_map(nowhere, quantity="capability")


def test_a_column_of_many_instants_shows_the_worst_of_them(timeline):
    count = 4 * heat.MOST_COLUMNS
    jump, margin = np.zeros((count, 28)), np.ones((count, 28))
    jump[1234, 2], margin[777, 5], jump[4, 1] = 50.0, 0.1, np.nan
    code = np.repeat(timeline.verdict[:1], count, axis=0)
    columns = {"jump": jump, "margin": margin, "verdict": code, "capability": margin}
    columns["held"] = margin
    columns["healthy"] = type(timeline.healthy)(
        *(np.zeros(count) for _ in range(4)), 0 * code[:, 0]
    )
    many = replaced(timeline, t=np.linspace(0.0, 8.0, count), **columns)
    cells = heat.cells_of(many, "jump", 40)
    assert cells.values.shape == (29, heat.MOST_COLUMNS)
    assert cells.values[2].max() == 50.0
    column = int(cells.values[2].argmax())
    assert cells.edges[column] <= many.t[1234] <= cells.edges[column + 1]
    assert np.isnan(cells.values[1]).sum() == 1
    assert heat.cells_of(many, "margin", 40).values[5].min() == 0.1
    assert cells.edges[0] == 0.0
    assert cells.edges[-1] == 8.0


def test_many_sets_are_cut_to_the_worst(timeline):
    ax = plots.heat_map(timeline, most=5)
    worst = {worst.faults for worst in timeline.worst()[:5]}
    kept = [one for one in timeline.sets if one in worst]
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert labels == [*heat.set_labels(timeline.robot, kept), "none (healthy)"]
    assert "the worst 5 of 28 sets" in ax.get_title()


def test_sets_of_long_names_are_named_by_numbers():
    robot = SimpleNamespace(names=tuple(f"a_rather_long_name_of_joint_{i}" for i in range(3)))
    sets = [ftforce.FaultSet.locked(joints) for joints in ([0], [0, 2])]
    assert heat.set_labels(robot, sets) == ["1 a_rather_long_name_of_joint_0", "1, 3"]


def test_census_bars_are_jumps_by_verdict(census):
    ax = plots.census(census, most=8)
    jumps = [report.jump_norm for report in census.sets[:8]]
    assert_close([bar.get_width() for bar in ax.patches], [*jumps, 0.0])
    assert ax.get_yticklabels()[-1].get_text() == "none (healthy)"
    shown = (*census.sets[:8], census.healthy)
    for bar, report in zip(ax.patches, shown, strict=True):
        colour, hatch = LOOKS[report.verdict]
        assert to_rgb(bar.get_facecolor()) == to_rgb(colour)
        assert (bar.get_hatch() or "") == hatch
    assert ax.get_xlabel() == "‖ΔF‖ [N]"
    assert ax.get_yticklabels()[0].get_text().startswith("1 joint1, ")
    assert ax.yaxis_inverted()
    assert set(legend_of(ax)) == {report.verdict.value for report in shown}
    assert "the worst 8 of 25 sets" in ax.get_title()


def test_census_bars_are_what_it_ranks_by():
    arm = ftforce.load_robot("panda")
    result = ftforce.census(arm, mode="free", rank_by="capability", direction=[0, 0, 1])
    ax = plots.census(result)
    wanted = [report.capability.commanded for report in (*result.sets, result.healthy)]
    assert np.isnan(wanted).any()
    assert_close([bar.get_width() for bar in ax.patches], np.nan_to_num(wanted))
    assert [text.get_text() for text in ax.texts][np.isnan(wanted).argmax()] == heat.NOTHING
    assert ax.get_xlabel() == "force [N]"
    margins = ftforce.census(arm)
    ax = plots.census(margins)
    everyone = (*margins.sets, margins.healthy)
    assert_close([bar.get_width() for bar in ax.patches], [one.margin for one in everyone])
    assert ax.get_xlabel() == "σ_min(K) / σ_max(J)"
    moments = ftforce.census(arm, task="moment", force=[1, 2, 3])
    assert plots.census(moments).get_xlabel() == "‖ΔF‖ [N·m]"
    none = ftforce.census(arm, rank_by="capability", limits=Limits.of([np.nan] * 7))
    assert "no known limit" in texts_of(plots.census(none))


# Slices, found independently


CASES = {
    "locked": {"locked": [2, 4]},
    "free": {"free": [4], "payload": 2.0},
    "tool": {"free": [4], "payload": 2.0, "axes": "tool"},
    "loose": {"free": [2, 4, 6], "payload": 2.0},
    "weak": {"weak": {2: 0.3, 6: 0.5}, "payload": 3.0},
    "moving": {"locked": [3], "velocity": 0.3 * np.ones(7), "acceleration": np.ones(7)},
    "wrench": {"locked": [5], "task": "wrench", "length": 0.2},
}


def farthest(result, rows, way, *, after, held):
    """Return how far the slice goes some way, by linear programming; ``None`` if it is empty.

    Unknowns: the force's two components, and the torques of the motors that are left.
    """
    analysis = result.analysis
    robot, task, faults = analysis.robot, analysis.task, analysis.faults
    J = task_jacobian(robot, analysis.posture.q, task)
    rnea = analysis.rnea.after if after else analysis.rnea.before
    n, failed = robot.n, faults if after else ftforce.FaultSet()
    bound = analysis.limits.largest_torques(failed)
    out = np.zeros(n, dtype=bool)
    out[list(failed.joints)] = [f.mode.value != "weak" for f in failed.faults]
    E = np.zeros((task.m, 2))
    E[rows, range(2)] = 1.0
    weights = np.ones(task.m) if task.weights is None else task.weights
    K = J[:, ~out] * weights[:, None]
    equal = [] if held else [np.hstack([E / weights[:, None], -K])]
    free = list(failed.free)
    equal.append(np.hstack([J[:, free].T @ E, np.zeros((len(free), K.shape[1]))]))
    right = np.concatenate([np.zeros(0 if held else task.m), -rnea[free]])
    known = np.flatnonzero(bound > 0.0)
    push = np.hstack([J[:, known].T @ E, np.zeros((len(known), K.shape[1]))])
    # The rank of K decides what can be commanded: any torques, of which only forces matter.
    found = linprog(
        -np.concatenate([way, np.zeros(K.shape[1])]),
        A_ub=np.vstack([push, -push]),
        b_ub=np.concatenate([bound[known] - rnea[known], bound[known] + rnea[known]]),
        A_eq=np.vstack(equal),
        b_eq=right,
        bounds=(None, None),
    )
    return None if found.status == 2 else -found.fun


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("x", "y"), [(0, 1), (2, 0), (1, 2)][: campaign(3)])
def test_slices_end_where_linear_programming_ends(case, x, y):
    arm = ftforce.load_robot("panda")
    limits = Limits.of(arm.effort, 0.3 * np.asarray(arm.effort))
    result = ftforce.capability(arm, limits=limits, **{"axes": "world", **CASES[case]})
    for one in slices_of(result, (x, y)):
        after, held = one.when != "before", one.when == "with locks"
        for angle in np.linspace(0.0, 2.0 * np.pi, campaign(7, 4)):
            way = np.array([np.cos(angle), np.sin(angle)])
            wanted = farthest(result, [x, y], way, after=after, held=held)
            if wanted is None:
                assert one.polytope.is_empty
                continue
            assert one.polytope.is_bounded
            got = (one.polytope.vertices @ way).max()
            assert_close(got, wanted, scale=100.0, tol=1e-6)


def test_the_polygon_drawn_is_the_slice(capability):
    ax = plots.capability(capability, ["fx", "fz"])
    before, held = [patch for patch in ax.patches if isinstance(patch, Polygon)]
    wanted = slices_of(capability, (0, 2))
    assert legend_of(ax) == [one.words for one in wanted]
    for patch, one in ((before, wanted[0]), (held, wanted[2])):
        corners = patch.get_xy()[:-1]
        assert_close(np.sort(corners, axis=0), np.sort(one.polytope.vertices, axis=0))
        turns = np.diff(np.vstack([corners, corners[:2]]), axis=0)
        signs = [np.sign(a[0] * b[1] - a[1] * b[0]) for a, b in pairwise(turns)]
        assert set(signs) in ({1.0}, {-1.0})  # convex: the corners go round
    line = next(line for line in ax.lines if line.get_label() == "after, commanded by motors")
    assert_close(np.sort(line.get_xydata(), axis=0), np.sort(wanted[1].polytope.vertices, axis=0))
    assert [ax.get_xlabel(), ax.get_ylabel()] == ["fx [N]", "fz [N]"]
    assert ax.get_aspect() == 1.0


def test_a_plane_of_two_units_has_two_scales():
    arm = ftforce.load_robot("panda")
    ax = plots.capability(ftforce.capability(arm, locked=[1], task="fx,my"))
    assert [ax.get_xlabel(), ax.get_ylabel()] == ["fx [N]", "my [N·m]"]
    assert ax.get_aspect() == "auto"


def test_what_has_no_outline_is_said():
    arm = ftforce.load_robot("dh5")
    nowhere = ftforce.capability(arm, locked=[2, 3, 4], limits=Limits.of([np.nan] * 5))
    assert "before, with locks: no known limit" in plots.capability(nowhere).get_title()
    one = ftforce.capability(arm, locked=[3], limits=Limits.of([150, *[np.nan] * 4]))
    ax = plots.capability(one)
    title = ax.get_title().replace("\n", " ")
    assert "no known limit along fx" in title
    slanted = plots.capability(one, ["fy", "fz"]).get_title().replace("\n", " ")
    assert "before, after, with locks: no known limit along (0.74, -0.67)" in slanted
    strip = np.abs(ax.patches[0].get_xy()).max()
    assert strip > 10.0 * np.abs([*ax.get_xlim(), *ax.get_ylim()]).max()
    panda = ftforce.load_robot("panda")
    heavy = ftforce.capability(panda, locked=[4], payload=200)
    assert (
        "before, after, with locks: the arm cannot be held" in plots.capability(heavy).get_title()
    )
    lost = ftforce.capability(panda, locked=[1, 2, 3, 4, 5, 6, 7])
    assert "after: no force" in plots.capability(lost).get_title()


# For all eyes, and in print


def luminance(colour):
    """Return the lightness L* of a colour, 0 to 100."""
    linear = linear_of(colour)
    Y = float(linear @ [0.2126, 0.7152, 0.0722])
    return 116.0 * np.cbrt(Y) - 16.0 if Y > 0.008856 else 903.3 * Y


def linear_of(colour):
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(linear):
    """Return CIELAB of linear RGB."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.clip(np.array(to_xyz) @ linear, 0.0, None) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


# Machado, Oliveira, Fernandes (2009), severity 1: red- and green-blindness.
BLIND = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
}


@pytest.mark.parametrize("vision", [None, *BLIND])
def test_colours_of_lines_are_told_apart(vision):
    matrix = np.eye(3) if vision is None else np.array(BLIND[vision])
    for one, other in combinations(canvas.LINE_COLOURS, 2):
        seen = [lab(np.clip(matrix @ linear_of(colour), 0.0, 1.0)) for colour in (one, other)]
        assert np.linalg.norm(seen[0] - seen[1]) > 15.0, (one, other)
    for colour in canvas.LINE_COLOURS:
        assert luminance(colour) < 75.0  # on white paper


def test_lines_are_told_apart_without_colour():
    lines = [canvas.line_of(i, 12, 100) for i in range(12)]
    for one, other in combinations(lines, 2):
        assert one["marker"] != other["marker"]
        assert one["markevery"] != other["markevery"]
    for one, other in pairwise(lines):
        assert one["linestyle"] != other["linestyle"]


def test_verdicts_are_told_apart_without_colour():
    looks = list(LOOKS.values())
    for (one, hatch), (other, other_hatch) in combinations(looks, 2):
        assert abs(luminance(one) - luminance(other)) > 10.0
        assert hatch != other_hatch


@pytest.mark.no_cover
@pytest.mark.thorough
def test_texts_are_large_enough_and_do_not_overlap(
    history, wrench_history, timeline, census, capability
):
    for result in (history, wrench_history, timeline, census, capability):
        drawn = figures.figure(result)
        assert_close(drawn.get_figwidth() * 25.4, 180.0)
        assert drawn.get_figheight() <= 9.7
        for text in drawn.findobj(Text):
            if text.get_text().strip() and text.get_visible():
                assert text.get_fontsize() >= 7.0, text
        renderer = renderer_of(drawn)
        for ax in drawn.axes:
            _assert_apart(ax, renderer)


def _assert_apart(ax, renderer):
    """Check that titles, labels, names of faults and the legend do not overlap."""
    texts = [*ax.texts, ax.title, ax._left_title, ax.xaxis.label, ax.yaxis.label]
    boxes = [Text.get_window_extent(text, renderer) for text in texts if text.get_text().strip()]
    if ax.get_legend() is not None:
        boxes.append(ax.get_legend().get_window_extent(renderer))
    whole = ax.figure.bbox
    for box in boxes:
        assert box.x0 >= -1.0
        assert box.x1 <= whole.x1 + 1.0
    for one, other in combinations(boxes, 2):
        width = min(one.x1, other.x1) - max(one.x0, other.x0)
        height = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert width <= 1.0 or height <= 1.0


@pytest.mark.thorough
def test_twelve_joints_of_long_names_have_room(history):
    names = [f"left_arm_shoulder_{i}_actuated_joint" for i in range(12)]
    infos = tuple(JointInfo(name, "revolute") for name in names)
    wide = replaced(history.remapped, motor=np.tile(history.remapped.motor, 3)[:, :12])
    setting = replaced(history.setting, joints=infos)
    many = History(setting, history.t, history.path, wide, wide, wide)
    drawn = figures.figure(many)
    renderer = renderer_of(drawn)
    ax = drawn.axes[0]
    assert len(legend_of(ax)) == 12
    assert len(set(legend_of(ax))) == 12
    legend = ax.get_legend().get_window_extent(renderer)
    below = drawn.axes[1].get_legend().get_window_extent(renderer)
    assert legend.y0 >= below.y1
    assert ax.bbox.width > 0.5 * drawn.bbox.width


# Axes, errors, files


def test_given_axes_are_returned_and_drawn_on(history, timeline, census, capability):
    for draw, result in (
        (plots.torques, history),
        (plots.force, history),
        (plots.jump, history),
        (plots.path_error, history),
        (plots.heat_map, timeline),
        (plots.census, census),
        (plots.capability, capability),
    ):
        ax = Figure().add_subplot()
        assert draw(result, ax=ax) is ax
        assert ax.get_xlabel()
        assert isinstance(draw(result), Axes)
        with pytest.raises(InputError, match="two dimensions, got axes of projection '3d'"):
            draw(result, ax=Figure().add_subplot(projection="3d"))
        with pytest.raises(InputError, match="matplotlib axes"):
            draw(result, ax="here")
    solid = Figure().add_subplot(projection="3d")
    assert plots.path(history, ax=solid) is solid
    with pytest.raises(InputError, match="projection='3d'"):
        plots.path(history, ax=Figure().add_subplot())


def test_a_later_title_takes_the_place_of_ours_above_the_faults(history):
    ax = plots.torques(history, ax=Figure().add_subplot())
    ax.set_title("Fig. 3")
    titles = [ax.get_title(loc) for loc in ("left", "center", "right")]
    assert titles == ["", "Fig. 3", ""]
    renderer = renderer_of(ax.figure)
    top = max(Text.get_window_extent(text, renderer).y1 for text in ax.texts)
    assert ax.title.get_window_extent(renderer).y0 >= top - 1.0


def test_wrong_names_are_refused(history, wrench_history, timeline, capability):
    with pytest.raises(UnknownNameError, match=r"unknown run 'helthy'.*did you mean 'healthy'"):
        plots.torques(history, "helthy")
    with pytest.raises(
        UnknownNameError, match="unknown run 'remapped'; available: healthy, unremapped;"
    ):
        plots.torques(wrench_history)
    with pytest.raises(UnknownNameError, match="unknown torque 'speed'"):
        plots.torques(history, quantity="speed")
    with pytest.raises(UnknownNameError, match="'moment' in the task 'force'; available: force"):
        plots.force(history, kind="moment")
    with pytest.raises(UnknownNameError, match="unknown quantity 'heat'; available: jump, margin"):
        plots.heat_map(timeline, quantity="heat")
    with pytest.raises(InputError, match="without a force there is no jump"):
        plots.heat_map(replaced(timeline, question=replaced(timeline.question, force=None)))
    with pytest.raises(UnknownNameError, match="unknown component 'mx' in the task 'force'"):
        plots.capability(capability, ["fx", "mx"])
    for components in (["fx"], ["fx", "fx"], ["fx", "fy", "fz"], []):
        with pytest.raises(InputError, match="two different components of the task"):
            plots.capability(capability, components)
    with pytest.raises(InputError, match="no figure for Robot; available for: History, Timeline"):
        figures.figure(ftforce.load_robot("dh5"))
    with pytest.raises(InputError, match="two different components"):
        figures.figure(ftforce.capability(ftforce.load_robot("dh5"), locked=[1], task="fx"))


@pytest.mark.thorough
@pytest.mark.parametrize("ending", ["png", "pdf", "svg", "SVG"])
def test_files_are_what_they_are_called_and_repeat(census, tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    assert figures.save_figure(census, path) == path
    data = path.read_bytes()
    assert data == figures.figure_bytes(census, path)
    starts = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}
    assert data.startswith(starts[ending.lower()])
    assert b"CreationDate" not in data
    if ending == "svg":
        assert "date" not in data.decode()[:2000]
        assert float(ElementTree.fromstring(data).get("width").removesuffix("pt")) == (
            pytest.approx(180.0 / 25.4 * 72.0)
        )


@pytest.mark.no_cover
@pytest.mark.thorough
def test_bytes_do_not_depend_on_the_process(tmp_path):
    program = (
        "import ftforce, hashlib\n"
        "from ftforce.show.figures import figure_bytes\n"
        "result = ftforce.capability(ftforce.load_robot('dh5'), locked=[3])\n"
        "print(*(hashlib.sha256(figure_bytes(result, f'a.{x}')).hexdigest()"
        " for x in ('svg', 'pdf', 'png')))"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            check=True,
            env={"PYTHONHASHSEED": seed, "HOME": str(tmp_path), "MPLCONFIGDIR": str(tmp_path)},
        )
        for seed in "12"
    ]
    assert runs[0].stdout == runs[1].stdout
    assert len(set(runs[0].stdout.split())) == 3


@pytest.mark.no_cover
@pytest.mark.thorough
def test_heavy_figures_repeat(timeline, history):
    for result in (timeline, history) if CAMPAIGN else (history,):
        assert figures.figure_bytes(result, "a.svg") == figures.figure_bytes(result, "a.svg")


def test_endings_that_are_none_are_refused_and_nothing_is_written(census, tmp_path):
    for name in ("a.jpg", "a", "png", "a.svg.txt"):
        with pytest.raises(InputError, match=r"must end in one of \.png, \.pdf, \.svg"):
            figures.save_figure(census, tmp_path / name)
    with pytest.raises(OutputError):
        figures.save_figure(census, tmp_path / "missing" / "a.png")
    kept = tmp_path / "kept.svg"
    kept.write_text("mine")
    with pytest.raises(InputError):
        figures.save_figure("no result", kept)
    assert kept.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [kept]


def test_drawing_changes_no_settings(history, census):
    before = dict(rcParams)
    plots.torques(history)
    plots.path(history)
    figures.figure_bytes(census, "a.svg")
    assert dict(rcParams) == before


def test_without_matplotlib_one_sentence_says_what_to_do(census, history, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for draw in (figures.figure, plots.census):
        with pytest.raises(FtforceError, match=r"pip install 'ftforce\[plot\]'"):
            draw(census)
    with pytest.raises(FtforceError, match="plots need matplotlib"):
        plots.path(history)


def test_plots_load_matplotlib_late_and_pyplot_never():
    program = (
        "import sys, ftforce\n"
        "from ftforce.show import figures, plots\n"
        "assert 'matplotlib' not in sys.modules\n"
        "figures.figure(ftforce.census(ftforce.load_robot('dh5')))\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


# ---- what a reader has to see ------------------------------------------------------------------


def snippets(page):
    """Return the Python snippets of a page of the guides that draw."""
    text = (FOLDER / "docs" / "guides" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    return [block for block in blocks if "plots." in block]


def figures_of(snippet, names):
    """Run a snippet, and return the figures that it draws."""
    found = []
    for statement in ast.parse(snippet).body:
        if isinstance(statement, ast.Expr):
            drawn = eval(compile(ast.Expression(statement.value), "snippet", "eval"), names)
            found += [drawn.figure] if isinstance(drawn, Axes) or hasattr(drawn, "zaxis") else []
        else:
            exec(compile(ast.Module([statement], []), "snippet", "exec"), names)
    return list(dict.fromkeys([*found, *(x for x in names.values() if isinstance(x, Figure))]))


def assert_nothing_is_cut(figure):
    figure.set_canvas(FigureCanvasAgg(figure))
    figure.draw_without_rendering()
    width, height = figure.bbox.width, figure.bbox.height
    parts = [part for ax in figure.axes for part in (ax.title, ax.xaxis.label, ax.yaxis.label)]
    parts += [ax.get_legend() for ax in figure.axes if ax.get_legend()] + figure.legends
    parts += [text for ax in figure.axes for text in ax.texts]
    for part in parts:
        box = part.get_window_extent()
        if box.width and box.height:
            assert min(box.x0, box.y0) >= -1.0, part
            assert max(box.x1 - width, box.y1 - height) <= 1.0, part


@pytest.mark.thorough
@pytest.mark.parametrize("page", ["plots.md", "workspace-map.md"])
def test_no_legend_or_title_of_a_documented_snippet_is_cut(page, history, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    sweep = ftforce.sweep(ftforce.load_robot("panda"), n=500, force=[0, 0, 30])
    matplotlib.use("Agg")
    found = snippets(page)
    assert found
    for snippet in found:
        drawn = figures_of(snippet, {"history": history, "sweep": sweep, "plots": plots})
        assert drawn
        for figure in drawn:
            assert_nothing_is_cut(figure)
            tall = [ax for ax in figure.axes if "torque" in ax.get_ylabel()]
            assert len({ax.get_ylim() for ax in tall}) <= 1  # one scale
            for ax in tall:
                curves = np.concatenate([line.get_ydata() for line in ax.lines if
                                         len(line.get_ydata()) == len(history.t)])  # fmt: skip
                low, high = ax.get_ylim()
                assert low <= np.nanmin(curves) <= np.nanmax(curves) <= high


def test_zero_lies_inside_the_axes(history, census):
    for draw in (plots.jump, plots.path_error):
        assert draw(history).get_ylim()[0] < 0.0
    quiet = ftforce.census(ftforce.load_robot("panda"), force=[0, 0, 30])
    for result in (census, quiet):
        ax = plots.census(result)
        assert ax.get_xlim()[0] < 0.0
        zeros = [one for one in (*result.sets[:20], result.healthy) if one.jump_norm < 1e-9]
        marks = next(line for line in ax.lines if line.get_marker() == "|")
        assert len(marks.get_xdata()) == len(zeros) > 0


def test_plots_of_one_comparison_have_one_scale(history, capability):
    drawn = figures.figure(history)
    torques = [ax for ax in drawn.axes if ax.get_ylabel().startswith("motor torque")]
    assert len(torques) == 2
    assert torques[0].get_ylim() == torques[1].get_ylim()
    low, high = torques[0].get_ylim()
    for run in (history.healthy, history.remapped):
        assert low <= np.nanmin(run.motor) <= np.nanmax(run.motor) <= high
    planes = figures.figure(capability).axes
    assert len(planes) == 3
    assert len({(ax.get_xlim(), ax.get_ylim()) for ax in planes}) == 1
    corners = np.vstack([patch.get_xy() for ax in planes for patch in ax.patches])
    assert planes[0].get_xlim()[0] <= corners.min() <= corners.max() <= planes[0].get_xlim()[1]


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_a_file_does_not_depend_on_matplotlibrc(tmp_path, ending):
    """LaTeX may be missing, a font, or the format; equal results give identical bytes."""
    capability = ftforce.capability(ftforce.load_robot("dh5"), locked=[3])
    path = tmp_path / f"force.{ending}"
    wanted = figures.figure_bytes(capability, path)
    theirs = {
        "text.usetex": True,
        "font.family": "NoSuchFont",
        "figure.dpi": 1e9,
        "savefig.format": "xyz",
        "axes.formatter.use_mathtext": True,
        "lines.linewidth": 30.0,
    }
    with matplotlib.rc_context(theirs):
        assert figures.figure_bytes(capability, path) == wanted
        assert matplotlib.rcParams["text.usetex"] is True  # of the user's own figures


def test_characters_that_the_font_lacks_are_one_warning(tmp_path):
    text = (FilePath(__file__).parents[1] / "robots" / "dh5.urdf").read_text("utf-8")
    path = tmp_path / "arm.urdf"
    path.write_text(text.replace('"joint2"', '"関節"').replace('"joint3"', '"肘"'), "utf-8")
    census = ftforce.census(ftforce.load_robot(path, tip="tool"))
    with pytest.warns(RuntimeWarning, match="boxes for characters that its font lacks: ") as said:
        figures.figure_bytes(census, tmp_path / "census.svg")
    assert len(said) == 1
    assert set(str(said[0].message).partition("lacks: ")[2].split(", ")) == {"関", "節", "肘"}


def plotted(path, **environment):
    """Return what is said when a plot is made in another environment."""
    command = [sys.executable, "-m", "ftforce", "capability", "dh5", "--plot", str(path)]
    environment = {**os.environ, **environment}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.thorough  # a process that imports matplotlib and finds no list of fonts
def test_nothing_is_said_of_settings_that_no_plot_depends_on(tmp_path):
    """A folder that cannot be made, values that are none, and keys that are unknown."""
    settings = tmp_path / "matplotlibrc"
    settings.write_text("text.usetex: maybe\nfoo.bar: 3\nlines.linewidth: thick\n")
    path = tmp_path / "x.svg"
    done = plotted(path, MPLCONFIGDIR="/dev/null/none", MATPLOTLIBRC=str(settings))
    assert (done.returncode, done.stderr) == (0, f"wrote {path}\n")
    assert path.read_bytes().startswith(b"<?xml")


def test_settings_with_which_matplotlib_does_not_start_are_one_line():
    done = plotted("x.svg", MPLBACKEND="nosuch")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert done.stderr.startswith("error: matplotlib does not start with its settings: Key backend")
