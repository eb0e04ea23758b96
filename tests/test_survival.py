"""Maps, rankings and histograms of sweeps: what they show is what the samples say."""

from __future__ import annotations

import dataclasses
from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.patches import StepPatch
from matplotlib.text import Text
from scipy.stats import binomtest

import ftforce
from ftforce.batch.summary.cells import PLANES, Cells, pooled
from ftforce.batch.sweep import sweep
from ftforce.batch.workspace_map import workspace_map
from ftforce.errors import InputError, UnknownNameError
from ftforce.report.map import map_document, map_rows, map_sentence
from ftforce.robot.kinematics import frame_jacobian
from ftforce.show import figures, plots
from ftforce.show.plots import workspace
from ftforce.show.render import to_text
from ftforce.show.tables.map import map_view
from helpers import CAMPAIGN, assert_close

pytestmark = pytest.mark.thorough

N = 4096


@pytest.fixture(scope="module")
def pairs():
    """Return a sweep of an arm of five joints in which some pairs are not tolerated."""
    arm = ftforce.load_robot("dh5")
    return sweep(arm, n=N, faults=2, force=[80, 50, 10], keep="all")


@pytest.fixture(scope="module")
def singles():
    """Return a sweep of single joints, some of whose postures are borderline."""
    return sweep(ftforce.load_robot("dh5"), n=N, force=[80, 50, 10], keep="all")


@pytest.fixture(scope="module")
def free():
    """Return a sweep with jumps, capabilities, and postures in which nothing holds the arm."""
    arm = ftforce.load_robot("panda")
    return sweep(arm, n=N, mode="free", force=[0, 0, 60], keep="all", cell=0.2)


@pytest.fixture(scope="module")
def sliding():
    """Return a sweep of an arm whose first joint is prismatic."""
    return sweep(ftforce.load_robot("tiago"), n=N, cell=0.15)


def samples(result, joints):
    """Return tips and whether the posture tolerates a set, from the samples alone."""
    tolerated = np.asarray(result.dataset["verdict"]) == 0
    if joints is None:
        return np.asarray(result.dataset["tip"]), tolerated.all(axis=1)
    names = [tuple(i + 1 for i in one.joints) for one in result.sets]
    return np.asarray(result.dataset["tip"]), tolerated[:, names.index(tuple(joints))]


def counted(result, joints, plane, at):
    """Return postures and those that tolerate, per cell of a plane, without the code's help."""
    tip, tolerated = samples(result, joints)
    grid = result.summary.workspace
    lost = ({0, 1, 2} - {"xyz".index(name) for name in plane}).pop()
    if at is not None:
        layer = np.floor((np.array([at]) - grid.origin[lost]) / grid.edge)
        inside = np.floor((tip[:, lost] - grid.origin[lost]) / grid.edge) == layer
        tip, tolerated = tip[inside], tolerated[inside]
    axes = ["xyz".index(name) for name in plane]
    edges = [grid.origin[i] + np.arange(grid.shape[i] + 1) * grid.edge for i in axes]
    every = np.histogram2d(*tip[:, axes].T, bins=edges)[0]
    return every, np.histogram2d(*tip[tolerated][:, axes].T, bins=edges)[0], edges


# The map


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize(("joints", "at"), [(None, None), ([2], None), ([2, 4], 0.17), (None, 0.0)])
def test_cells_are_shares_of_the_samples(singles, pairs, joints, plane, at):
    result = singles if joints is None else pairs  # no posture tolerates every pair
    ax = plots.survival(result, joints, plane=plane, at=at)
    mesh = ax.collections[0]
    every, tolerated, edges = counted(result, joints, plane, at)
    assert every.sum() == (N if at is None else every.sum()) > 0
    filled = every.T > 0
    assert (np.ma.getmaskarray(mesh.get_array()) == ~filled).all()
    assert_close(mesh.get_array().data[filled], tolerated.T[filled] / every.T[filled])
    assert 0 < tolerated.sum() < every.sum()  # or this would test nothing
    u, v = mesh.get_coordinates().transpose(2, 0, 1)
    assert_close(u, np.broadcast_to(edges[0], u.shape))
    assert_close(v, np.broadcast_to(edges[1][:, None], v.shape))
    assert (ax.get_xlabel(), ax.get_ylabel()) == (f"{plane[0]} [m]", f"{plane[1]} [m]")
    assert ax.get_aspect() == 1.0


def test_the_title_says_what_is_pooled(pairs):
    pooled_title = plots.survival(pairs).get_title()
    assert "whichever 1 or 2 joints lock" in pooled_title
    assert "xz plane, all y pooled, cells of 0.1 m" in pooled_title
    one = plots.survival(pairs, [4, 2], plane="xy", at=0.33).get_title()
    assert "joints 2 and 4 locked" in one
    assert "slice z = 0.3 to 0.4 m" in one
    assert "joint 3 (joint3) locked" in plots.survival(pairs, [3]).get_title()


def test_dots_mark_cells_whose_share_is_hardly_known(pairs):
    ax = plots.survival(pairs, [2, 4])
    every, tolerated, _ = counted(pairs, [2, 4], "xz", None)
    wanted = set()
    for i, j in np.argwhere(every > 0):
        found = binomtest(int(tolerated[i, j]), int(every[i, j])).proportion_ci(method="wilson")
        if found.high - found.low > workspace.UNSURE:
            wanted.add((i, j))
    assert 0 < len(wanted) < (every > 0).sum()
    grid = pairs.summary.workspace
    dots = np.asarray(ax.collections[-1].get_offsets())
    got = {
        tuple(np.floor((dot - np.array(grid.origin)[[0, 2]]) / grid.edge).astype(int))
        for dot in dots
    }
    assert got == wanted


def test_a_line_parts_bright_cells_from_white(pairs):
    ax = plots.survival(pairs)
    lines = next(one for one in ax.collections if isinstance(one, LineCollection))
    filled = np.pad(counted(pairs, None, "xz", None)[0] > 0, 1)
    borders = sum(int((np.diff(filled.astype(int), axis=axis) != 0).sum()) for axis in (0, 1))
    assert len(lines.get_segments()) == borders
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["no posture", "origin of the root's axes", workspace.UNSURE_WORDS]


def bar_of(ax):
    return next(one for one in ax.figure.axes if "tolerated" in one.get_ylabel())


def test_colours_are_as_fine_as_what_differs():
    postures = np.array([1000, 1000, 2, 0])
    one = workspace.scale_of(Cells.of(postures, np.array([995, 960, 0, 0])))
    assert one == workspace.Scale(0.95, reaches_below=True)  # the cell of two postures counts not
    sure = Cells.of(postures[:2], np.array([995, 960]))
    assert workspace.scale_of(sure) == workspace.Scale(0.95, reaches_below=False)
    half = Cells.of(postures[:2], np.array([995, 300]))
    assert workspace.scale_of(sure, half) == workspace.Scale(0.0, reaches_below=False)


def changed(result, share):
    """Return a sweep of which every cell tolerates all or nothing."""
    summary = result.summary
    new = dataclasses.replace(
        summary,
        cell_tolerates_all=summary.cell_postures * share,
        cell_tolerated=summary.cell_postures[:, None] * np.full(summary.n_sets, share),
    )
    return dataclasses.replace(result, summary=new)


@pytest.mark.parametrize("share", [0, 1])
def test_all_or_nothing_has_the_whole_scale(pairs, share):
    every = changed(pairs, share)
    ax = plots.survival(every)
    assert bar_of(ax).get_ylim() == (0.0, 1.0)
    assert set(np.ma.compressed(ax.collections[0].get_array())) == {share}
    text = map_sentence(workspace_map(every))
    assert text.startswith(("None of 4,096", "All of 4,096")[share])
    shown = to_text(map_view(workspace_map(every)))
    assert ("m, worst first" in shown) is not bool(share)
    plots.survival_3d(every)
    figures.figure(every)


def test_blocks_in_space_pool_the_samples(singles):
    ax = plots.survival_3d(singles, [2])
    found = workspace_map(singles, [2]).blocks
    tip, tolerated = samples(singles, [2])
    assert found.cells.postures.sum() == N
    for place, every, some in zip(
        found.place, found.cells.postures, found.cells.tolerated, strict=True
    ):
        inside = (np.abs(tip - place) < 0.5 * found.edge).all(axis=1)
        assert every == inside.sum()
        assert some == (inside & tolerated).sum()
    blocks = ax.collections[0]
    assert_close(np.array(blocks._offsets3d).T, found.place)
    colours = blocks._facecolors  # in the order of the blocks, not of their depth
    floor = workspace.scale_of(found.cells).floor
    order = np.argsort(found.cells.share.clip(floor))
    assert (np.diff(colours[order, 3]) <= 1e-12).all()  # the more tolerated, the fainter
    assert np.ptp(colours[:, 3]) > 0.5
    assert [ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()] == ["x [m]", "y [m]", "z [m]"]
    spans = [np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())]
    assert_close(spans, [spans[0]] * 3)


def test_pooling_loses_nothing():
    counts = np.arange(7 * 5 * 4).reshape(7, 5, 4)
    found = pooled(counts, 3, [1, 0, 2])
    assert found.shape == (2, 2, 1)
    assert found[0, 0, 0] == counts[1:4, :3, 2:].sum()
    assert found.sum() == counts[1:, :, 2:].sum()


# Joints


def alone(result, quantity, joint):
    names = [tuple(one.joints) for one in result.sets]
    return np.asarray(result.dataset[quantity])[:, names.index((joint,))]


def healthy_margins(result):
    """Return the margins of the healthy arm at the samples, by NumPy."""
    arm = ftforce.load_robot(result.setting.robot)
    J = [frame_jacobian(arm, q)[:3] for q in np.asarray(result.dataset["q"])]
    s = np.linalg.svd(J, compute_uv=False)
    return s[:, -1] / s[:, 0]


def steps_of(ax):
    """Return the steps of each row, from the top, as shares of their peak, and their edges."""
    patches = [one for one in ax.patches if isinstance(one, StepPatch)]
    return [
        ((one.get_data().baseline - one.get_data().values) / 0.86, one.get_data().edges)
        for one in patches
    ]


@pytest.mark.parametrize("quantity", ["rho", "margin"])
def test_histograms_are_those_of_the_samples(pairs, quantity):
    ax = plots.histogram(pairs, quantity)
    rows = steps_of(ax)
    assert len(rows) == 6  # the last one is the healthy arm
    marks = [np.asarray(one.get_offsets())[0] for one in ax.collections]
    for row, (heights, edges) in enumerate(rows):
        if row < 5:
            values = alone(pairs, quantity, pairs.joints[row].joint)
        else:
            values = np.ones(N) if quantity == "rho" else healthy_margins(pairs)
        counts, _ = np.histogram(np.clip(values, 0.0, 1.0), edges)
        assert counts.sum() == N
        assert_close(heights, counts / counts.max(), tol=1e-6)
        median, bad = (mark for mark in marks if row - 0.5 < mark[1] <= row + 0.5)
        assert_close(median[0], np.quantile(values, 0.5), tol=1.1e-3, scale=1.0)
        assert_close(bad[0], np.quantile(values, 0.05), tol=1.1e-3, scale=1.0)
    labels = [text.get_text() for text in ax.get_yticklabels()]
    names = [f"{one.joint + 1} joint{one.joint + 1}" for one in pairs.joints]
    assert labels == [*names, "none (healthy)"]


def test_jumps_that_are_none_are_said_and_not_drawn(free):
    ax = plots.histogram(free, "jump")
    notes = {text.xy[1]: text.get_text() for text in ax.texts}
    *joints, (healthy, _) = steps_of(ax)
    assert not healthy.any()
    assert notes[len(joints)] == "no jump: 100 %"
    for row, (heights, edges) in enumerate(joints):
        values = alone(free, "jump", free.joints[row].joint)
        none = float((values < 0.06).sum()) / N
        falls = float(np.isnan(values).sum()) / N
        said = notes.get(row, "")
        assert (f"no jump: {100.0 * none:.3g} %" in said) or none < 0.01
        assert ("falls" in said) is (falls > 0.0)
        counts, _ = np.histogram(values[values >= 0.06], edges)
        assert_close(heights, counts / max(counts.max(), 1), tol=1e-6)
        marks = [np.asarray(one.get_offsets())[0] for one in ax.collections]
        bad = [x for x, y in marks if abs(y - row - 0.44) < 1e-9]  # the triangle, not the diamond
        large = np.nanquantile(values, 0.95)
        if large < 60.0:
            assert_close(bad, [large], tol=0.061, scale=1.0)
    assert any("falls" in note for note in notes.values())
    assert ax.get_xlabel() == "‖ΔF‖ [N]"


def test_capabilities_lie_on_a_logarithmic_axis(free):
    ax = plots.histogram(free, "capability")
    assert ax.get_xscale() == "log"
    assert ax.get_xlabel() == "force [N]"
    for row, (heights, edges) in enumerate(steps_of(ax)[:-1]):
        values = alone(free, "capability", free.joints[row].joint)
        counts, _ = np.histogram(values[np.isfinite(values)], edges)
        assert_close(heights, counts / max(counts.max(), 1), tol=1e-6)
        assert_close(np.diff(np.log10(edges)), 0.1, tol=1e-6)


def test_bars_and_whiskers_are_shares_with_wilsons_intervals(pairs):
    ax = plots.criticality(pairs)
    verdict = np.asarray(pairs.dataset["verdict"])
    lost, doubtful = ax.containers[0], ax.containers[1]
    whiskers = [one for one in ax.containers if hasattr(one, "has_xerr")]
    texts = [text.get_text() for text in ax.texts]
    for row, one in enumerate(pairs.joints):
        among = [s for s, faults in enumerate(pairs.sets) if one.joint in faults.joints]
        shares = [(verdict[:, among] == code).mean() for code in (2, 1)]
        assert_close(lost[row].get_width(), 100.0 * shares[0])
        assert_close(doubtful[row].get_width(), 100.0 * shares[1])
        assert_close(doubtful[row].get_x(), 100.0 * shares[0])
        for share, drawn in zip((shares[0], sum(shares)), whiskers, strict=True):
            low, high = drawn[2][0].get_segments()[row][:, 0]
            # Between the intervals of the whole numbers around it: postures x sets are averaged.
            counts = [int(np.floor(share * N)), int(np.ceil(share * N))]
            found = [binomtest(k, N).proportion_ci(method="wilson") for k in counts]
            assert 100.0 * found[0].low - 1e-9 <= low <= 100.0 * found[1].low + 1e-9
            assert 100.0 * found[0].high - 1e-9 <= high <= 100.0 * found[1].high + 1e-9
        assert texts[row].startswith(f"{100.0 * sum(shares):.3g} (")
    assert lost[0].get_width() > 0.0
    assert ax.get_ylim()[0] > ax.get_ylim()[1]  # the most critical on top
    totals = [bar.get_width() for bar in lost]
    assert totals == sorted(totals, reverse=True)


def test_where_nothing_is_lost_the_end_of_the_interval_is_said(sliding):
    ax = plots.criticality(sliding)
    most = binomtest(0, N).proportion_ci(method="wilson").high
    assert f"not tolerated: none (at most {100.0 * most:.2g} %)" in ax.get_xlabel()
    assert max(ax.get_xticks()) <= 100.0


# Words, files


def test_the_map_in_a_terminal_is_the_map(pairs):
    shown = to_text(map_view(workspace_map(pairs, plane="xz")))
    assert max(map(len, shown.splitlines())) <= 80
    every, tolerated, _ = counted(pairs, None, "xz", None)
    lines = shown.partition("[m]\n")[2].splitlines()[1:]
    columns = np.flatnonzero(every.any(1))
    rows = np.flatnonzero(every.any(0))[::-1]
    grid = pairs.summary.workspace
    for line, row in zip(lines, rows, strict=False):
        assert_close(float(line[:7]), grid.origin[2] + (row + 0.5) * grid.edge, tol=0.0051)
        cells = line[8:].ljust(3 * len(columns))
        for place, column in enumerate(columns):
            cell = cells[3 * place : 3 * place + 3].strip()
            if not every[column, row]:
                assert not cell
            elif every[column, row] == tolerated[column, row]:
                assert cell == "·"
            else:
                assert int(cell) == int(100 * tolerated[column, row] // every[column, row])


@pytest.mark.parametrize("quantity", ["rho", "margin", "jump", "capability"])
def test_quantiles_are_those_of_the_samples(free, quantity):
    shown = to_text(map_view(workspace_map(free, quantities=[quantity])))
    lines = shown.rpartition("quantiles over the postures\n")[2].splitlines()[1:]
    for line, one in zip(lines, free.joints, strict=False):
        number, name, *cells = line.split()
        assert (number, name) == (str(one.joint + 1), f"panda_joint{one.joint + 1}")
        values = alone(free, quantity, one.joint)
        if quantity == "capability":  # an arm that falls commands nothing
            values = np.nan_to_num(values)
        order = [0.05, 0.25, 0.5, 0.75, 0.95]
        order = [*order, 1.0] if quantity == "jump" else [0.0, *order]
        for cell, p in zip(cells, order, strict=True):
            wanted = float(np.nanquantile(values, p))
            if quantity == "capability" and p == 0.0:  # of those that do not fall
                stands = alone(free, quantity, one.joint)
                stands = stands[np.isfinite(stands)]
                assert (cell == "–") is not bool(len(stands))
                wanted = float(stands.min(initial=np.inf))
            if cell == "–":
                continue
            if cell.startswith("<"):
                assert wanted < float(cell[1:])
            elif cell.startswith(">"):
                assert wanted > 60.0
            else:
                within = 0.06 + 0.025 * wanted if quantity in {"jump", "capability"} else 0.006
                assert abs(float(cell) - wanted) <= within


def test_small_cells_are_pooled_until_80_columns_hold_them():
    fine = sweep(ftforce.load_robot("dh5"), n=512, cell=0.03)
    shown = to_text(map_view(workspace_map(fine)))
    assert max(map(len, shown.splitlines())) <= 80
    assert "pooled to cells of 0.09 m" in shown


def test_the_worst_blocks_are_surely_bad(singles):
    found = workspace_map(singles)
    worst, cells = found.worst(5), found.blocks.cells
    highs = [
        binomtest(int(t), int(n)).proportion_ci(method="wilson").high
        for t, n in zip(cells.tolerated, cells.postures, strict=True)
    ]
    assert_close([highs[i] for i in worst], sorted(highs)[:5])
    first = worst[0]
    shown = [line.split() for line in to_text(found).splitlines()]
    head = [
        "rank",
        "x",
        "[m]",
        "y",
        "[m]",
        "z",
        "[m]",
        "postures",
        "tolerated",
        "[%]",
        "at",
        "least",
        "at",
        "most",
    ]
    row = shown[shown.index(head) + 1]
    x, y, z = found.blocks.place[first]
    assert row[1:4] == [f"{value:.3f}" for value in (x, y, z)]
    assert f"({x:.4g}, {y:.4g}, {z:.4g})".replace("-", "−") in map_sentence(found)
    assert row[-1] == f"{100.0 * highs[first]:.1f}"
    assert f"at most {row[-1]}%" in map_sentence(found)
    ties = sum(abs(high - highs[first]) < 1e-9 for high in highs)
    assert row[0] == ("1" if ties == 1 else f"1–{ties}")
    assert f"{cells.tolerated[first]} of {cells.postures[first]} do." in map_sentence(found)


def test_rows_and_documents_are_the_samples(pairs):
    header, *rows = map_rows(workspace_map(pairs, [2, 4]))
    place = [header.index(f"{name} [m]") for name in "xyz"]
    tip, tolerated = samples(pairs, [2, 4])
    edge = pairs.summary.workspace.edge
    assert sum(row[header.index("postures")] for row in rows) == N
    for row in rows[::7]:
        middle = np.array([row[i] for i in place])
        inside = (np.abs(tip - middle) < 0.5 * edge).all(axis=1)
        assert row[0] == "{2, 4}"
        assert row[header.index("postures")] == inside.sum()
        assert row[header.index("tolerated")] == (inside & tolerated).sum()
        ends = binomtest(int((inside & tolerated).sum()), int(inside.sum()))
        wilson = ends.proportion_ci(method="wilson")
        assert_close([row[header.index(k)] for k in ("low", "high")], [wilson.low, wilson.high])
    document = map_document(workspace_map(pairs, plane="xz", at=0.0))
    assert len(document["sets"]) == 1 + len(pairs.sets)
    inside = np.floor((tip[:, 1] - pairs.summary.workspace.origin[1]) / edge) == 12
    assert sum(document["cells"]["postures"]) == inside.sum()
    every = {tuple(one["joints"] or ()): sum(one["tolerated"]) for one in document["sets"]}
    assert every["joint2", "joint4"] == (inside & tolerated).sum()
    assert every[()] == (inside & samples(pairs, None)[1]).sum()


def test_a_sweep_that_is_not_complete_says_so(pairs):
    more = dataclasses.replace(pairs.setting, count=2 * N)
    part = dataclasses.replace(pairs, setting=more)
    assert "4,096 of 8,192 postures" in to_text(map_view(workspace_map(part)))
    drawn = figures.figure(part)
    assert any("4,096 of 8,192 (not complete)" in t.get_text() for t in drawn.findobj(Text))
    blank = ftforce.batch.summary.summary.Summary.empty(
        pairs.summary.n_sets, pairs.summary.bins, pairs.summary.workspace
    )
    with pytest.raises(InputError, match="the sweep has no finished postures yet"):
        workspace_map(dataclasses.replace(pairs, summary=blank))


def test_what_is_not_there_is_refused(pairs, sliding):
    for wrong, error, words in (
        ({"joints": [1, 2, 3]}, InputError, r"no fault set \{1, 2, 3\}; available: \{1\}"),
        ({"plane": "zx"}, UnknownNameError, "unknown plane 'zx'; available: xy, xz, yz"),
        (
            {"plane": "xz", "at": 4.0},
            InputError,
            r"tip at y = 4 m; tip positions range from y = -1.1 to 1.2",
        ),
        ({"at": 4.0}, InputError, "a slice needs a plane"),
        ({"plane": "xy", "solid": True}, InputError, "three-dimensional plot has no plane"),
        ({"quantities": ["sigma"]}, UnknownNameError, "unknown quantity 'sigma'; available: rho"),
        ({"quantities": ["jump"]}, InputError, "no jump: it was run without a force"),
    ):
        with pytest.raises(error, match=words):
            workspace_map(sliding if "jump" in str(wrong) else pairs, **wrong)
    with pytest.raises(InputError, match=r"tip at y = 4 m"):
        plots.survival(pairs, at=4.0)
    with pytest.raises(InputError, match="the sweep has no jump"):
        plots.histogram(sliding, "jump")
    flat = figures.figure(pairs).axes[0]
    with pytest.raises(InputError, match="projection='3d'"):
        plots.survival_3d(pairs, ax=flat)


# The page


def with_joints(result, count):
    """Return a sweep as if of an arm of so many joints with long names."""
    names = tuple(f"left_arm_shoulder_{i}_actuated_joint" for i in range(1, count + 1))
    setting = dataclasses.replace(
        result.setting, joints=names, joint_units=("rad",) * count, largest=1
    )
    sets = tuple(ftforce.FaultSet.locked([i]) for i in range(count))
    chosen = np.arange(count) % result.setting.n
    arrays = {}
    for name, array in result.summary.arrays().items():
        arrays[name] = array
        if name in {"cell_tolerated", "cell_min_margin"}:
            arrays[name] = array[:, chosen]
        elif array.ndim and len(array) == result.summary.n_sets and "healthy" not in name:
            arrays[name] = array[chosen]
    arrays["tolerated_sets"] = np.zeros(count + 1, np.int64)
    summary = type(result.summary).from_arrays(
        arrays, result.summary.bins, result.summary.workspace
    )
    return dataclasses.replace(result, setting=setting, sets=sets, summary=summary)


def pages(pairs, free, sliding):
    yield with_joints(free, 12)
    yield workspace_map(free, [4], plane="xy", at=0.3, quantities=("jump", "capability"))
    yield workspace_map(free, solid=True, quantities=("rho", "margin", "jump", "capability"))
    if CAMPAIGN:
        yield pairs
        yield sliding


def test_a_page_fits_is_legible_and_nothing_overlaps(pairs, free, sliding):
    for result in pages(pairs, free, sliding):
        drawn = figures.figure(result)
        assert_close(drawn.get_figwidth() * 25.4, 180.0)
        assert drawn.get_figheight() <= 9.7
        canvas = FigureCanvasAgg(drawn)
        canvas.draw()
        renderer = canvas.get_renderer()
        boxes = []
        for ax in drawn.axes:
            texts = [*ax.texts, ax.title, ax._left_title, ax.xaxis.label, ax.yaxis.label]
            texts += ax.get_yticklabels() if ax.name != "3d" else []
            boxes += [
                (text.get_text(), Text.get_window_extent(text, renderer))
                for text in texts
                if text.get_text().strip()
            ]
            if ax.get_legend() is not None:
                boxes.append(("legend", ax.get_legend().get_window_extent(renderer)))
        for name, box in boxes:
            assert box.x0 >= -1.0, name
            assert box.x1 <= drawn.bbox.x1 + 1.0, name
        for (name, one), (other_name, other) in combinations(boxes, 2):
            width = min(one.x1, other.x1) - max(one.x0, other.x0)
            height = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert width <= 1.0 or height <= 1.0, (name, other_name)
        for text in drawn.findobj(Text):
            if text.get_text().strip() and text.get_visible():
                assert text.get_fontsize() >= 7.0, text


def test_maps_of_a_page_share_scale_and_bar(pairs):
    drawn = figures.figure(pairs)
    maps = drawn.axes[:3]
    FigureCanvasAgg(drawn).draw()
    for ax, plane in zip(maps, PLANES, strict=True):
        every, tolerated, _ = counted(pairs, None, plane, None)
        mesh = ax.collections[0]
        assert_close(mesh.get_array().compressed(), (tolerated / every.clip(1)).T[every.T > 0])
        assert mesh.get_clim() == maps[0].collections[0].get_clim()
    lengths = [ax.bbox.width / np.ptp(ax.get_xlim()) for ax in maps]  # pixels of a metre
    assert_close(lengths, [lengths[0]] * 3, tol=0.1)


@pytest.mark.no_cover
@pytest.mark.parametrize("ending", ["pdf", "svg"])
def test_pages_repeat_byte_by_byte(pairs, tmp_path, ending):
    files = [figures.save_figure(pairs, tmp_path / f"{i}.{ending}") for i in range(2)]
    assert files[0].read_bytes() == files[1].read_bytes()
    assert len(files[0].read_bytes()) < 500_000


def test_given_axes_are_drawn_on_and_returned(pairs):
    from matplotlib.figure import Figure

    for draw in (plots.survival, plots.histogram, plots.criticality):
        ax = Figure().add_subplot()
        assert draw(pairs, ax=ax) is ax
    solid = Figure().add_subplot(projection="3d")
    assert plots.survival_3d(pairs, ax=solid) is solid
