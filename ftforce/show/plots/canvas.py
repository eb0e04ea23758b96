"""Common parts of the plots: axes sized for print, colours and line styles, fault marks."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from ftforce.errors import FtforceError, InputError
from ftforce.report.text import NEGLIGIBLE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.trajectory.history import History

Options: TypeAlias = dict[str, Any]
"""Keyword arguments for Matplotlib."""

WIDTH = 180.0 / 25.4  # in; two columns of a journal, or a page of A4
SMALL, TITLE = 7.0, 8.0  # pt; the smallest text, and titles
PRINT: Any = {
    "font.size": SMALL,
    "axes.titlesize": TITLE,
    "axes.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "legend.fontsize": SMALL,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "hatch.linewidth": 0.6,
}
"""Style for a figure 180 mm wide, printed at its original size."""

# Okabe and Ito's colour-blind safe palette, without its yellow, which is too pale for lines.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
LINE_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "p", "h")
SOLID, DASHED, DOTTED = (0, ()), (0, (5, 2.5)), (0, (0.1, 2.4))
_DASHES = (SOLID, (0, (6, 1.5)), (0, (6, 1.5, 1.2, 1.5)), (0, (2, 1.2)))

NOTHING = "the arm cannot be held"
NO_FAULT = "none (healthy)"
"""Label of the healthy arm among fault sets and joints."""
FLOOR = 0.03
"""Room below zero, relative to the largest value, so that zero can be seen."""
HIGHEST = 9.6  # in; a page of A4 with its caption
ROW = 0.16  # in; height of a row of text
LONGEST_NAME = 24  # characters of a joint's name

_ROW_OF_TEXT = 1.3  # line height, relative to the font size
_LETTER = 0.52  # average character width, relative to the font size
_ROOM = 0.8  # share of the axes' width left by legends, approximately


class Stroke(NamedTuple):
    """Line style of a run, chosen so that coinciding curves remain visible."""

    words: str
    colour: str
    dashes: tuple[float, Sequence[float]]
    width: float
    alpha: float

    def options(self, colour: str | None = None) -> dict[str, Any]:
        """Return line options, by default in the run's colour."""
        return {
            "color": colour or self.colour,
            "linestyle": self.dashes,
            "linewidth": self.width,
            "alpha": self.alpha,
            "dash_capstyle": "round" if self.dashes == DOTTED else "butt",
        }


STROKES = {
    "healthy": Stroke("as if healthy", SKY, SOLID, 4.0, 0.45),
    "unremapped": Stroke("without remap", VERMILION, DOTTED, 2.2, 1.0),
    "remapped": Stroke("with remap", BLACK, DASHED, 1.1, 1.0),
}


def line_of(i: int, count: int, samples: int) -> dict[str, Any]:
    """Return the options of line i of ``count``, distinguishable also without colour."""
    return {
        "color": LINE_COLOURS[i % len(LINE_COLOURS)],
        "linestyle": _DASHES[i % len(_DASHES)],
        "marker": MARKERS[i % len(MARKERS)],
        "markevery": sparse(i, count, samples),
    }


def sparse(i: int, count: int, samples: int) -> tuple[int, int]:
    """Return the ``markevery`` of line i of ``count``: few markers, staggered between lines."""
    step = max(samples // 8, 1)
    return step * (i + 1) // (count + 1), step


def needs_matplotlib() -> None:
    """Check that Matplotlib is installed.

    Raises
    ------
    FtforceError
        It is not installed, and the message says how to install it; or its settings, such as
        MPLBACKEND or a matplotlibrc, do not let it start.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise FtforceError("plots need matplotlib: pip install 'ftforce[plot]'") from None
    except (ValueError, OSError) as problem:
        reason = " ".join(str(problem).split())
        raise FtforceError(f"matplotlib does not start with its settings: {reason}") from None


@contextmanager
def canvas(ax: Axes | None, height: float, *, solid: bool = False) -> Iterator[Axes]:
    """Yield the axes to draw on: those given, or those of a new figure sized for print.

    Parameters
    ----------
    ax :
        Axes, or ``None`` for new ones.
    height :
        Height of a new figure, in.
    solid :
        Whether the axes are three-dimensional.

    Raises
    ------
    InputError
        ``ax`` is not an Axes object, or does not have the required dimension.
    """
    needs_matplotlib()
    from matplotlib import rc_context
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    if ax is not None:
        wanted = "projection='3d'" if solid else "two dimensions"
        if not isinstance(ax, Axes) or (ax.name == "3d") is not solid:
            name = getattr(ax, "name", None)
            got = f"axes of projection {name!r}" if isinstance(ax, Axes) else repr(ax)
            raise InputError(f"ax must be matplotlib axes with {wanted}, got {got}")
        before = {text: text.get_text() for text in texts_of(ax)}
        yield ax
        draw_literally(text for text in texts_of(ax) if text.get_text() != before.get(text))
        return
    with rc_context(PRINT):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        yield figure.add_subplot(projection="3d" if solid else None)
        fit_ticks(figure)
        draw_literally(texts_of(figure))


def draw_literally(texts: Iterable[Text]) -> None:
    """Draw texts as they are: a dollar sign in a name begins no formula."""
    for text in texts:
        text.set_parse_math(False)


def texts_of(artist: Artist) -> list[Text]:
    """Return the texts of a figure or axes, but not the numbers at axes, which may be formulas."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter, ScalarFormatter

    numbers = {
        text
        for axis in artist.findobj(Axis)
        if isinstance(axis.get_major_formatter(), (LogFormatter, ScalarFormatter))
        for tick in (*axis.majorTicks, *axis.minorTicks)
        for text in (tick.label1, tick.label2, axis.get_offset_text())
    }
    return [text for text in artist.findobj(Text) if text not in numbers]


def grid(ax: Axes, axis: Literal["both", "x"] = "both") -> None:
    """Draw a light grid behind everything."""
    ax.grid(axis=axis, color="0.9", linewidth=0.5)
    ax.set_axisbelow(True)


def mark(marker: str, colour: str, size: float, label: str, **options: Any) -> Line2D:
    """Return a black-edged marker as a legend handle."""
    from matplotlib.lines import Line2D

    look: Options = {"markeredgecolor": BLACK, "markeredgewidth": 0.8} | options
    face: Options = {"marker": marker, "markerfacecolor": colour, "markersize": size}
    return Line2D([], [], linestyle="none", label=label, **face, **look)


def cube(ax: Any, low: Vector, high: Vector, half: float, **ticks: Any) -> None:
    """Set equal scales on 3D axes: a cube of half side ``half`` around ``low`` to ``high``, m."""
    from matplotlib.ticker import MaxNLocator

    for name, middle in zip("xyz", (0.5 * (low + high)).tolist(), strict=True):
        getattr(ax, f"set_{name}lim")(middle - half, middle + half)
        getattr(ax, f"set_{name}label")(f"{name} [m]")
        getattr(ax, f"{name}axis").set_major_locator(MaxNLocator(**ticks))
        getattr(ax, f"{name}axis").labelpad = -2.0
    ax.tick_params(pad=-1.0)


def fit_ticks(figure: Figure) -> None:
    """Set the font size of tick labels, which are created after the style context has ended."""
    for ax in figure.axes:
        ax.tick_params(labelsize=SMALL, width=0.6, length=2.5)
        if ax.name != "3d":
            ax.tick_params(which="minor", width=0.4, length=1.5)


def key(ax: Axes, handles: Sequence[Any] | None = None, *, gap: bool = False) -> None:
    """Place the legend beside the axes; with ``gap``, it explains gaps in the curves."""
    from matplotlib.lines import Line2D

    found = list(ax.get_legend_handles_labels()[0] if handles is None else handles)
    if gap:
        found.append(Line2D([], [], linestyle="none", label=f"gap: {NOTHING}"))
    if not found:  # avoids a Matplotlib warning
        return
    place: Options = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.3}
    ax.legend(handles=found, **place, frameon=False, handlelength=3.4, labelspacing=0.3)


def wrapped(ax: Axes, lines: Sequence[str]) -> str:
    """Return the lines of a title, wrapped to the width of the axes."""
    from textwrap import wrap

    letters = int(width_of(ax) / (_LETTER * TITLE))
    return "\n".join(part for line in lines for part in wrap(line, max(letters, 20)))


def head(ax: Axes, title: str, handles: Sequence[Any]) -> None:
    """Put a title above the axes, with the legend between title and axes."""
    place: Options = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": len(handles)}
    space: Options = {
        "borderpad": 0.0,
        "borderaxespad": 0.4,
        "handlelength": 1.8,
        "columnspacing": 1.6,
    }
    ax.legend(handles=handles, **place, **space, frameon=False)
    _lift_titles(ax, 1)
    ax.set_title(title)


def _lift_titles(ax: Axes, rows: int) -> None:
    """Reserve rows of text between the axes and their title.

    Titles are placed above the tick labels of a top axis, so one with blank labels is added.
    """
    if rows:
        top = ax.secondary_xaxis("top")
        top.set_xticks([sum(ax.get_xlim()) / 2.0], ["\n".join(" " * rows)])
        top.tick_params(length=0.0, pad=4.0, labelsize=_size())


def fit(ax: Axes, values: Matrix, *, positive: bool = False, least: float = NEGLIGIBLE) -> None:
    """Fit the vertical axis to values, and to those of axes that share it.

    Values up to ``least`` are shown as zero. Positive values start above the lower end of the axis,
    so that a line at zero is not hidden by the frame.
    """
    drawn = [values, *(_heights(one) for one in ax.get_shared_y_axes().get_siblings(ax))]
    size = max(float(np.abs(x[np.isfinite(x)]).max(initial=0.0)) for x in drawn)
    if size <= least:
        ax.set_ylim(-FLOOR if positive else -1.0, 1.0)
    elif positive:
        ax.set_ylim(-FLOOR * size, 1.08 * size)
    else:
        ax.set_ylim(auto=True)
        ax.autoscale_view(scalex=False)
    # An offset text above the axis would overlap the labels there.
    ax.yaxis.set_major_formatter(_plain)


def _heights(ax: Axes) -> Vector:
    lines = [np.asarray(line.get_ydata(), dtype=np.float64).ravel() for line in ax.get_lines()]
    return np.concatenate(
        [np.zeros(1), *(y for y in lines if y.size > 2)]
    )  # without marks of faults


def _plain(value: float, _: float) -> str:
    return f"{value:g}".replace("-", "−")


def frame(ax: Axes, history: History, title: str, ylabel: str) -> None:
    """Set labels, grid, fault marks and title of axes over time."""
    ax.set_xlabel("time [s]")
    ax.set_ylabel(ylabel)
    grid(ax)
    first, last = float(history.t[0]), float(history.t[-1])
    ax.set_xlim(first, last if last > first else first + 1.0)
    _lift_titles(ax, _mark_faults(ax, history))
    ax.set_title(title)


def _mark_faults(ax: Axes, history: History) -> int:
    """Draw a labelled dashed line at each fault; return the number of label rows."""
    size, room = _size(), max(int(_ROOM * width_of(ax) / (_LETTER * _size())), 1)  # characters
    start, end = ax.get_xlim()
    taken: list[list[tuple[float, float]]] = []
    for time, at in _in_order(history, start, end):
        ax.axvline(time, color=BLACK, linewidth=0.8, linestyle=(0, (4, 2)), zorder=3)
        label = fault_label(history, time, int(room * max(at, 1.0 - at)))
        length = (len(label) + 1) / room
        row = _first_free(taken, at, (at, at + length) if at < 0.5 else (at - length, at))
        side = 0.0 if at < 0.5 else 1.0
        leader: Options = {"arrowstyle": "-", "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 0.0}
        ax.annotate(
            label,
            (time, 1.0),
            (0.0, 2.0 + _ROW_OF_TEXT * size * row),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            fontsize=size,
            ha="right" if side else "left",
            va="bottom",
            annotation_clip=False,
            arrowprops={**leader, "relpos": (side, 0.0)} if row else None,
        )
    return len(taken)


def _in_order(history: History, start: float, end: float) -> list[tuple[float, float]]:
    """Return fault times and relative positions, ordered so that leader lines cross no label.

    Labels are right of their line in the first half and left of it in the second; those closest to
    the middle get the lowest rows.
    """
    times = {event.time for event in history.setting.events}
    places = [(time, (time - start) / (end - start)) for time in times]

    def from_middle(place: tuple[float, float]) -> tuple[bool, float]:
        return place[1] >= 0.5, abs(place[1] - 0.5)

    return sorted(places, key=from_middle)


def _first_free(
    taken: list[list[tuple[float, float]]], at: float, span: tuple[float, float]
) -> int:
    """Reserve the lowest free row for a label, and space for its leader; return the row."""
    row = 0
    while row < len(taken) and any(span[0] < end and start < span[1] for start, end in taken[row]):
        row += 1
    if row == len(taken):
        taken.append([])
    taken[row].append(span)
    for lower in taken[:row]:
        lower.append((at - 1e-3, at + 1e-3))
    return row


def fault_label(history: History, time: float, most: int) -> str:
    """Return which joints fail at a time and how, in at most ``most`` characters if possible."""
    events = (event for event in history.setting.events if event.time == time)
    named = [part for event in events for part in event.faults.split(", ")]
    names = {f"{i} {joint.name} " for i, joint in enumerate(history.setting.joints, start=1)}
    short = [_without_name(part, names) for part in named]
    for label in (", ".join(named), ", ".join(short)):
        if len(label) <= most:
            return label
    return f"{short[0]} and {len(short) - 1} more" if len(short) > 1 else short[0]


def _without_name(part: str, names: set[str]) -> str:
    """Return ``3 locked`` for ``3 joint3 locked``."""
    found = next((name for name in names if part.startswith(name)), "")
    return f"{part.split(maxsplit=1)[0]} {part[len(found) :]}" if found else part


def shortened(text: str, most: int) -> str:
    """Shorten a text to ``most`` characters in the middle, as names differ at their ends."""
    if len(text) <= most:
        return text
    tail = max(most // 2, 1)
    return f"{text[: max(most - tail - 1, 1)]}…{text[-tail:]}"


def _size() -> float:
    """Return the font size of labels, pt; on user-supplied axes, that of the current style."""
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    return FontProperties(size=rcParams["legend.fontsize"]).get_size_in_points()


def width_of(ax: Axes) -> float:
    """Return the width of the axes, pt."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    return float(72.0 * ax.bbox.width / figure.dpi)
