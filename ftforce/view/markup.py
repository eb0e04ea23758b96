"""The page's answer as HTML: the only file that writes markup, so that no name can be any.

Every text goes through `text`. What `element` returns is a `Markup`, and only that is taken into
another element as it is; a plain string, whatever stands in it, is shown as text.
"""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce import sentences, words
from ftforce.faults import FaultMode
from ftforce.show.analysis import situation
from ftforce.view.colours import (
    ARROW_COLOURS,
    FAULT_COLOURS,
    NEUTRAL,
    RAMP,
    VERDICT_COLOURS,
    colour_of,
)
from ftforce.words import number, ratio, size

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ftforce.analysis import Analysis
    from ftforce.arrays import Vector
    from ftforce.fault_census import Census
    from ftforce.metrics import Verdict
    from ftforce.set_reports import SetReport
    from ftforce.task import Task
    from ftforce.view.answer import Answer, JointLoad
    from ftforce.view.colours import Colour
    from ftforce.view.picture import Picture

MOST_SETS = 40
_ROUNDING = 1e-6  # a share of a force that is smaller is none

STYLE = """
.ftf{font:12px/1.35 system-ui,'Noto Sans','DejaVu Sans',sans-serif;color:#1a1a1a;padding:4px 10px}
.ftf h3{font-size:12px;font-weight:600;margin:8px 0 2px}
.ftf table{border-collapse:collapse;width:100%;table-layout:fixed}
.ftf td,.ftf th{padding:1px 3px;text-align:right;white-space:nowrap}
.ftf td,.ftf th{overflow:hidden;text-overflow:ellipsis}
.ftf th{color:#666;font-weight:400}
.ftf .l{text-align:left}
.ftf .w{white-space:normal;overflow-wrap:anywhere}
.ftf .b td{font-weight:600;border-top:1px solid #ddd}
.ftf .bar{position:relative;height:12px;background:#eee;border:1px solid #bbb;box-sizing:border-box}
.ftf .bar i{position:absolute;left:0;top:0;bottom:0}
.ftf .over{color:#aa2814;font-weight:600}
.ftf .verdict{padding:7px 9px;border-radius:5px;color:#fff;font-size:12.5px;overflow-wrap:anywhere}
.ftf .warning{background:#fff4d6;border-left:3px solid #e69f00}
.ftf .warning{padding:2px 6px;margin:4px 0;overflow-wrap:anywhere}
.ftf .key{display:inline-block;width:14px;height:9px;margin-right:5px;border:1px solid #999}
.ftf .line{height:3px;border:0;vertical-align:middle}
.ftf .entry{display:inline-block;margin-right:10px}
.ftf .note{color:#666}
.ftf code{font:11px monospace;overflow-wrap:anywhere;user-select:all}
.ftf button{font:12px system-ui,sans-serif;padding:5px 10px;cursor:pointer;width:100%}
.ftf .plot{position:relative;height:96px;border:1px solid #bbb}
.ftf .plot svg{position:absolute;width:100%;height:100%;left:0;top:0}
.ftf .plot b{position:absolute;top:0;bottom:0;width:2px;margin-left:-1px;background:#000}
.ftf .ends{display:flex;justify-content:space-between;color:#666}
.ftf .names i{display:inline-block;width:14px;height:3px;margin-right:5px;vertical-align:middle}
.ftf summary{cursor:pointer;font-weight:600;margin-top:8px}
"""

# The text is in the element's data, never in the script.
_COPY = (
    "const b=this,t=b.dataset.text;"
    "const say=x=>{b.textContent=x;setTimeout(()=>{b.textContent=b.dataset.label},1500)};"
    "const old=()=>{const a=document.createElement('textarea');a.value=t;"
    "document.body.append(a);a.select();const ok=document.execCommand('copy');a.remove();"
    "say(ok?'copied':'select the text and copy it')};"
    "navigator.clipboard?navigator.clipboard.writeText(t).then(()=>say('copied'),old):old()"
)


class Markup(str):
    """HTML that is safe: made by `element`, of texts that were escaped."""

    __slots__ = ()


def text(words_: str) -> Markup:
    """Return a text as HTML that shows it, whatever stands in it."""
    return words_ if isinstance(words_, Markup) else Markup(html.escape(words_, quote=True))


def element(name: str, *children: str, **attributes: str) -> Markup:
    """Return an element; plain strings in it, and all its attributes, are escaped.

    Parameters
    ----------
    name :
        Of the element.
    children :
        Texts and `Markup`.
    attributes :
        ``class_`` is class, ``data_testid`` is data-testid; empty ones are left out.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value, quote=True)}"'
        for key, value in attributes.items()
        if value
    )
    return Markup(f"<{name}{given}>{''.join(map(text, children))}</{name}>")


def style() -> Markup:
    """Return what the other parts look like."""
    return Markup(f"<style>{STYLE}</style>")


def block(*children: str, testid: str = "") -> Markup:
    """Return a part of the page."""
    return element("div", *children, class_="ftf", data_testid=testid)


def css(colour: Colour) -> str:
    """Return a colour as CSS has it."""
    return f"rgb({colour[0]},{colour[1]},{colour[2]})"


def text_on(colour: Colour) -> str:
    """Return black or white, whichever is read better on a colour."""
    return "#000" if sum(colour) > 400 else "#fff"


# ---- the banner ------------------------------------------------------------------------------


def banner(answer: Answer) -> Markup:
    """Return the verdict in words, and the warnings."""
    analysis = answer.analysis
    verdict = _banner(
        VERDICT_COLOURS[analysis.verdict], sentences.verdict_sentence(analysis), "verdict"
    )
    doubts = [f"Warning: {doubt}." for doubt in analysis.warnings]
    if answer.census_problem:
        doubts.append(f"No census: {answer.census_problem}.")
    warnings = [element("div", doubt, class_="warning") for doubt in doubts]
    return block(style(), verdict, element("div", *warnings, data_testid="warnings"))


def verdict_banner(verdict: Verdict, words_: str, doubts: Iterable[str]) -> Markup:
    """Return a verdict in other words than the answer's, and what makes it doubtful."""
    warnings = [element("div", f"Warning: {doubt}.", class_="warning") for doubt in doubts]
    told = _banner(VERDICT_COLOURS[verdict], words_, "verdict")
    return block(style(), told, element("div", *warnings, data_testid="warnings"))


def problem_banner(problem: str) -> Markup:
    """Return why there is no answer."""
    return block(style(), _banner((90, 90, 90), problem, "verdict"))


def _banner(colour: Colour, words_: str, testid: str) -> Markup:
    look = f"background:{css(colour)}"
    return element("div", words_, class_="verdict", style=look, data_testid=testid, role="status")


# ---- tables ----------------------------------------------------------------------------------


def table(
    columns: Sequence[tuple[str, str, str]],
    rows: Iterable[Markup],
    testid: str,
) -> Markup:
    """Return a table.

    Parameters
    ----------
    columns :
        Title, class and CSS width of each.
    rows :
        Made by `row`.
    testid :
        For tests.
    """
    head = element(
        "tr", *(element("th", title, class_=kind, style=width and f"width:{width}")
                for title, kind, width in columns),
    )  # fmt: skip
    return element("table", element("thead", head), element("tbody", *rows), data_testid=testid)


def row(cells: Iterable[Markup], kind: str = "") -> Markup:
    """Return a row of a table."""
    return element("tr", *cells, class_=kind)


def cell(words_: str, kind: str = "", title: str = "") -> Markup:
    """Return a cell; ``title`` is shown when one points at it."""
    return element("td", words_, class_=kind, title=title)


def torque_table(answer: Answer) -> Markup:
    """Return what each motor gives before and after, with a bar against its limit."""
    return load_table(answer.loads, answer.analysis.rnea.is_known)


def load_table(
    loads: Sequence[JointLoad], has_masses: bool, names: tuple[str, str] = ("before", "after")
) -> Markup:
    """Return what each motor gives, with a bar against its limit.

    Parameters
    ----------
    loads :
        Of the joints.
    has_masses :
        Whether the weight is known.
    names :
        Of the two columns.
    """
    units = {load.unit for load in loads}
    unit = units.pop() if len(units) == 1 else "N·m, N"
    title = f"Motor torque [{unit}], " + ("weight included" if has_masses else "weight unknown")
    columns = [
        ("#", "l", "31px"), ("joint", "l", ""), (names[0], "", "56px"), (names[1], "", "51px"),
        ("of limit", "l", "50px"), ("", "", "40px"),
    ]  # fmt: skip
    rows = (_load_row(load) for load in loads)
    return element("div", element("h3", title), table(columns, rows, "torques"))


def _load_row(load: JointLoad) -> Markup:
    after = torque_text(load.after)
    hint = f"force part {torque_text(load.part_before)} → {torque_text(load.part_after)}"
    mode = None if load.fault is None else load.fault.mode
    if mode is FaultMode.LOCKED:
        after, hint = "brake", f"the brake carries {torque_text(load.brake)} {load.unit}; {hint}"
    colour = colour_of(mode, load.used)
    look = "" if mode is None else f"background:{css(colour)};color:{text_on(colour)}"
    # Not by colour alone; the names of joints leave no room for the whole word.
    place = str(load.number) if mode is None else f"{load.number} {mode[0].upper()}"
    name = load.name if load.fault is None else f"{load.name}: {load.fault}"
    limit = "unknown" if math.isnan(load.limit) else f"{load.limit:g} {load.unit}"
    return row(
        [
            element("td", place, class_="l", style=look, title=name),
            cell(load.name, "l", name),
            cell(torque_text(load.before), "", hint),
            cell(after, "", hint),
            element("td", bar(load.used, colour), title=f"limit {limit}"),
            cell(share_text(load.used), "over" if load.used > 1.0 else "", f"limit {limit}"),
        ]
    )


def torque_text(torque: float) -> str:
    """Return a torque, or what stands for one that is not known."""
    return "–" if math.isnan(torque) else number(torque)


def share_text(share: float) -> str:
    """Return a share of a limit in per cent."""
    if math.isinf(share):
        return "∞"
    return "?" if math.isnan(share) else f"{100.0 * share:.0f}%"


def bar(share: float, colour: Colour) -> Markup:
    """Return a bar that is as full as a share of a limit."""
    width = 0.0 if math.isnan(share) else 100.0 * min(share, 1.0)
    # The darker half of the ramp: its light end would vanish on a page.
    filled = element("i", style=f"width:{width:.0f}%;background:{css(colour)}")
    return element("div", filled, class_="bar")


def force_table(analysis: Analysis) -> Markup:
    """Return the force at the tip before and after, and its jump, per axis and their norms."""
    task, change = analysis.task, analysis.force
    if change is None:
        return element("div", element("h3", _force_title(task)), _unit_forces(analysis))
    vectors: list[tuple[str, Vector | None]] = [
        ("before", change.before), ("after", change.after), ("jump", change.jump)
    ]  # fmt: skip
    if change.requested is not None and words.is_noticeable(change.unsupported):
        vectors.insert(0, ("asked", change.requested))
    return vector_table(task, vectors)


def _force_title(task: Task) -> str:
    return f"Force at the tip, in the axes of {words.axes_in_words(task)}"


def vector_table(task: Task, vectors: Sequence[tuple[str, Vector | None]]) -> Markup:
    """Return named forces at the tip per axis, N and N·m, and their norms."""
    columns = [("", "l", "72px"), ("", "l", "34px"), *((name, "", "") for name, _ in vectors)]
    values = [vector for _, vector in vectors]
    parts = zip(task.components, task.units, strict=True)
    rows = [
        row([cell(name, "l"), cell(unit, "l"), *(cell(_component(x, i)) for x in values)])
        for i, (name, unit) in enumerate(parts)
    ]
    sizes = ("|force|", "N", task.force_rows), ("|moment|", "N·m", task.moment_rows)
    for name, unit, own in sizes:
        if own:
            norms = (cell(_norm(x, own)) for x in values)
            rows.append(row([cell(name, "l"), cell(unit, "l"), *norms], "b"))
    return element("div", element("h3", _force_title(task)), table(columns, rows, "forces"))


def _component(vector: Vector | None, i: int) -> str:
    return "–" if vector is None else size(float(vector[i]))


def _norm(vector: Vector | None, rows: tuple[int, ...]) -> str:
    return "–" if vector is None else size(float(np.linalg.norm(vector[list(rows)])))


def _unit_forces(analysis: Analysis) -> Markup:
    """Return what is kept and lost of 1 N (1 N·m) along each axis."""
    task = analysis.task
    columns = [("asked", "l", "64px"), *((name, "", "") for name in task.components)]
    rows = []
    for name, unit, (force, _) in zip(
        task.components, task.units, analysis.unit_forces, strict=True
    ):
        values = (cell(_component(force.after, i)) for i in range(task.m))
        rows.append(row([cell(f"{name} 1 {unit}", "l"), *values]))
    return table(columns, rows, "forces")


def facts(pairs: Iterable[tuple[str, str]], testid: str) -> Markup:
    """Return names and values in two columns."""
    rows = (row([cell(name, "l w"), cell(value, "l w")]) for name, value in pairs)
    return table([("", "l", "96px"), ("", "l", "")], rows, testid)


def measures(answer: Answer) -> Markup:
    """Return margin, rank, lost directions, brake loads and what else measures the answer."""
    analysis = answer.analysis
    reduced, bounded = analysis.reduced, analysis.bounded
    rho = analysis.relative_manipulability
    kept = "undefined" if math.isnan(rho) else ratio(rho)
    pairs = [
        ("Margin", f"{ratio(analysis.margin)} = σ_min(K)/σ_max(J)"),
        ("Rank", f"{reduced.rank_after} of {reduced.m} (healthy arm: {reduced.rank}), ρ {kept}"),
        ("Lost", words.lost_directions(analysis.task, list(analysis.lost_directions))),
    ]
    if bounded is not None and analysis.limits is not None:
        names = ", ".join(analysis.robot.names[j] for j in bounded.binding)
        pairs.append(("At the limit", names or "none"))
    brakes = [load for load in answer.loads if not math.isnan(load.brake)]
    if brakes:
        loads = ", ".join(f"{x.name} {number(x.brake)} {x.unit}" for x in brakes)
        pairs.append(("Brake load", loads))
    if (weakest := answer.weakest) is not None:
        before, after = (_weakest(amount.most) for amount in weakest)
        unit = words.unit_of_size(analysis.task)
        pairs.append(("Weakest", f"{before} before, {after} after [{unit}]"))
    return facts(pairs, "measures")


def _weakest(most: float) -> str:
    if math.isnan(most):
        return "none"
    return "no limit" if math.isinf(most) else size(most, 1)


def answer_part(answer: Answer) -> Markup:
    """Return tables of torques and forces, and the measures."""
    question = element(
        "details", element("summary", "The question"),
        facts(situation(answer.analysis), "question"),
    )  # fmt: skip
    return block(
        torque_table(answer), force_table(answer.analysis), measures(answer), question,
        testid="answer",
    )  # fmt: skip


# ---- the census ------------------------------------------------------------------------------


def set_label(report: SetReport) -> str:
    """Return a fault set and what it does in a line, as plain text."""
    joints = ", ".join(str(i + 1) for i in report.faults.joints)
    if not report.can_stand_still:
        return f"{{{joints}}} cannot stand still"
    share = report.relative_jump
    lost = f", {100.0 * share:.2g}% lost" if share > _ROUNDING else ""
    return f"{{{joints}}} {report.verdict}{lost}"


def census_part(census: Census | None, chosen: tuple[int, ...] = ()) -> Markup:
    """Return all fault sets, worst first.

    Parameters
    ----------
    census :
        ``None`` if there is none.
    chosen :
        Indices of the joints of the set that is shown.
    """
    if census is None:
        return block(element("span", "no census", class_="note"), testid="census")
    columns = [
        (census.mode.value, "l", "70px"), ("verdict", "l", ""), ("jump", "", "84px"),
        ("margin", "", "54px"),
    ]  # fmt: skip
    rows = [_set_row(report, chosen) for report in census.sets[:MOST_SETS]]
    more = len(census.sets) - MOST_SETS
    note = f"… and {more} more in the list above" if more > 0 else ""
    return block(
        element("div", sentences.critical_joint(census)),
        table(columns, rows, "census"),
        element("div", note, class_="note"),
    )


def _set_row(report: SetReport, chosen: tuple[int, ...]) -> Markup:
    joints = "{" + ", ".join(str(i + 1) for i in report.faults.joints) + "}"
    verdict = report.verdict.value if report.can_stand_still else "cannot stand still"
    look = f"color:{css(VERDICT_COLOURS[report.verdict])}"
    parts = ((report.jump_norm, "N"), (report.moment_jump_norm, "N·m"))
    jump = " ".join(f"{size(norm)} {unit}" for norm, unit in parts if norm is not None) or "–"
    return row(
        [
            cell(joints, "l"),
            element("td", verdict, class_="l", style=look),
            cell(jump),
            cell(ratio(report.margin)),
        ],
        "b" if report.faults.joints == chosen else "",
    )


# ---- legend, command -------------------------------------------------------------------------


def legend(picture: Picture, remarks: Iterable[str] = ()) -> Markup:
    """Return what colours, arrows and lines mean; with remarks, on missing meshes mostly."""
    told = [_key(ARROW_COLOURS[arrow.kind], arrow.label, "line") for arrow in picture.arrows]
    told += [_key(colour, label, "line") for label, colour in _lines(picture).items()]
    told += [_key(solid.colour, solid.label) for solid in picture.solids]
    told += [_key(colour, f"{mode} ({mode[0].upper()})") for mode, colour in FAULT_COLOURS.items()]
    told.append(_key(NEUTRAL, "unknown"))
    steps = ", ".join(css(colour) for colour in RAMP)
    look = f"width:50px;background:linear-gradient(90deg,{steps})"
    ramp = element("span", class_="key", style=look)
    told.append(element("span", ramp, "motor load, 0–100% of its limit", class_="entry"))
    notes = (element("div", note, class_="note") for note in (*picture.notes, *remarks))
    return block(element("h3", "Legend"), *told, *notes, testid="legend")


def _lines(picture: Picture) -> dict[str, Colour]:
    return {line.label: line.colour for line in picture.lines}  # of lost ones there may be more


def keys(pairs: Iterable[tuple[Colour, str]], notes: Iterable[str], testid: str) -> Markup:
    """Return what colours mean, and what else is to be said."""
    told = (element("div", note, class_="note") for note in notes)
    return block(style(), *(_key(colour, words_) for colour, words_ in pairs), *told, testid=testid)


# ---- curves over time ------------------------------------------------------------------------


class Curve(NamedTuple):
    """A quantity over time: name, values (NaN leaves a gap), colour of CSS, dashes of SVG."""

    name: str
    values: Vector
    colour: str
    dashes: str = ""


def chart(
    title: str, unit: str, t: Vector, curves: Sequence[Curve], marks: Iterable[float] = ()
) -> Markup:
    """Return curves over time as SVG, from 0 or the lowest value up; `cursor` marks a time.

    Parameters
    ----------
    title, unit :
        Of the values.
    t :
        Times, s, shape (N,).
    curves :
        Their values have shape (N,).
    marks :
        Times of vertical lines, s.
    """
    known = np.concatenate([[0.0], *(curve.values for curve in curves)])
    known = known[np.isfinite(known)]
    low, high = float(known.min()), float(known.max())
    height = max(high - low, 1e-9)
    first, length = float(t[0]), max(float(t[-1] - t[0]), 1e-9)
    x = 100.0 * (t - first) / length
    parts = [_stroke([(100.0 * (mark - first) / length, y) for y in (0.0, 100.0)], "#555", "3 2")
             for mark in marks]  # fmt: skip
    for curve in curves:
        y = 100.0 * (high - curve.values) / height
        parts += [_stroke(run, curve.colour, curve.dashes) for run in _unbroken(x, y)]
    svg = element("svg", *parts, viewBox="0 -2 100 104", preserveAspectRatio="none")
    names = (element("span", element("i", style=f"background:{c.colour}"), c.name, class_="entry")
             for c in curves)  # fmt: skip
    ends = (element("span", f"{x:g} s") for x in (first, first + length))
    return element(
        "div", element("h3", f"{title}: {low:.3g} to {high:.3g} {unit}"),
        element("div", svg, element("b"), class_="plot"), element("div", *ends, class_="ends"),
        element("div", *names, class_="names"),
    )  # fmt: skip


def cursor(share: float) -> Markup:
    """Return what puts the cursor of all charts at a share of their time, 0 to 1.

    So a frame sends a few bytes, and no curve again.
    """
    return Markup(f"<style>.ftf .plot b{{left:{100.0 * share:.2f}%}}</style>")


def no_cursor() -> Markup:
    """Return what hides the cursor of all charts: time goes on without them."""
    return Markup("<style>.ftf .plot b{display:none}</style>")


def _stroke(points: Iterable[tuple[float, float]], colour: str, dashes: str = "") -> Markup:
    places = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
    return element(
        "polyline", points=places, fill="none", stroke=colour, stroke_width="1.6",
        stroke_dasharray=dashes, vector_effect="non-scaling-stroke",
    )  # fmt: skip


def _unbroken(x: Vector, y: Vector) -> list[list[tuple[float, float]]]:
    """Return runs of points between gaps."""
    runs: list[list[tuple[float, float]]] = [[]]
    for point in zip(x.tolist(), y.tolist(), strict=True):
        if math.isnan(point[1]):
            runs.append([])
        else:
            runs[-1].append(point)
    return [run for run in runs if len(run) > 1]


def _key(colour: Colour, words_: str, kind: str = "") -> Markup:
    sample = element("span", class_=f"key {kind}".strip(), style=f"background:{css(colour)}")
    return element("span", sample, words_, class_="entry")


def command_part(command: str, note: str = "") -> Markup:
    """Return the command line with a button that copies it."""
    label = "Copy command line"
    button = element(
        "button", label, data_text=command, data_label=label, data_testid="copy", onclick=_COPY
    )
    shown = element("code", command, data_testid="command")
    return block(button, shown, element("div", note, class_="note"))


def static_page(
    answer: Answer, picture: Picture, command: str, remarks: Iterable[str] = ()
) -> Markup:
    """Return the whole answer for a page on which nothing can be changed."""
    parts = [banner(answer), answer_part(answer), legend(picture, remarks)]
    if answer.census is not None:
        parts.append(census_part(answer.census, answer.analysis.faults.joints))
    parts.append(command_part(command, answer.state.origin.note))
    return element("div", *parts, data_testid="static")
