"""Time series as SVG charts, with a cursor at the current time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.view.page.html import element, style

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from markupsafe import Markup

    from ftforce.core.arrays import Vector


class Curve(NamedTuple):
    """A time series: name, values (NaN leaves a gap), CSS colour and SVG dash pattern."""

    name: str
    values: Vector
    colour: str
    dashes: str = ""


def chart(
    title: str, unit: str, t: Vector, curves: Sequence[Curve], marks: Iterable[float] = ()
) -> Markup:
    """Return an SVG chart from 0, or the lowest value, upwards; `cursor` marks a time in it.

    Parameters
    ----------
    title, unit :
        Title of the chart and unit of the values.
    t :
        Times, s, shape (N,).
    curves :
        Curves with values of shape (N,).
    marks :
        Times of vertical lines, s.
    """
    known = np.concatenate([[0.0], *(curve.values for curve in curves)])
    known = known[np.isfinite(known)]
    low, high = float(known.min()), float(known.max())
    height = max(high - low, 1e-9)
    first, length = float(t[0]), max(float(t[-1] - t[0]), 1e-9)
    x = 100.0 * (t - first) / length
    at = (100.0 * (mark - first) / length for mark in marks)
    parts = [_stroke([(place, 0.0), (place, 100.0)], "#555", "3 2") for place in at]
    for curve in curves:
        y = 100.0 * (high - curve.values) / height
        parts += [_stroke(run, curve.colour, curve.dashes) for run in _unbroken(x, y)]
    svg = element("svg", *parts, viewBox="0 -2 100 104", preserveAspectRatio="none")
    ends = (element("span", f"{x:g} s") for x in (first, first + length))
    return element(
        "div",
        element("h3", f"{title}: {low:.3g} to {high:.3g} {unit}"),
        element("div", svg, element("b"), class_="plot"),
        element("div", *ends, class_="ends"),
        element("div", *map(_name, curves), class_="names"),
    )


def _name(curve: Curve) -> Markup:
    sample = element("i", style=f"background:{curve.colour}")
    return element("span", sample, curve.name, class_="entry")


def cursor(share: float) -> Markup:
    """Return HTML that moves the cursors of all charts to a share of their duration, 0 to 1.

    A frame thus sends only a few bytes instead of the curves.
    """
    return style(f".ftf .plot b{{left:{100.0 * share:.2f}%}}")


def no_cursor() -> Markup:
    """Return HTML that hides the cursors of all charts, for pages on which they could not move."""
    return style(".ftf .plot b{display:none}")


def _stroke(points: Iterable[tuple[float, float]], colour: str, dashes: str = "") -> Markup:
    attributes = {"fill": "none", "stroke_width": "1.6", "vector_effect": "non-scaling-stroke"}
    places = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
    return element("polyline", points=places, stroke=colour, stroke_dasharray=dashes, **attributes)


def _unbroken(x: Vector, y: Vector) -> list[list[tuple[float, float]]]:
    """Return the runs of points between gaps."""
    known = np.flatnonzero(~np.isnan(y))
    runs = np.split(known, np.flatnonzero(np.diff(known) > 1) + 1)
    return [list(zip(x[k].tolist(), y[k].tolist(), strict=True)) for k in runs if len(k) > 1]
