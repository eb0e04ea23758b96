"""The answer as HTML: verdict, tables, census, legend and command."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ftforce.report import analysis as sentences
from ftforce.report import text as words
from ftforce.report.census import critical_joint
from ftforce.report.text import ratio, size
from ftforce.show.tables.analysis import situation
from ftforce.view.page.html import block, cell, css, element, facts, row, style, table
from ftforce.view.page.tables import brake_loads, force_table, load_table
from ftforce.view.scene.colours import ARROW_COLOURS, FAULT_COLOURS, NEUTRAL, RAMP, VERDICT_COLOURS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from markupsafe import Markup

    from ftforce.analysis.census import Census
    from ftforce.analysis.fault_set import SetReport
    from ftforce.core.verdict import Verdict
    from ftforce.view.model.answer import Answer
    from ftforce.view.scene.colours import Colour
    from ftforce.view.scene.picture import Picture

_MAX_SETS = 40
_NO_EQUILIBRIUM = "no equilibrium"
_ROUNDING = 1e-6  # smaller shares of a force are treated as zero

# The text is passed as a data attribute and never becomes part of the script.
_COPY = (
    "const b=this,t=b.dataset.text;"
    "const say=x=>{b.textContent=x;setTimeout(()=>{b.textContent=b.dataset.label},1500)};"
    "const old=()=>{const a=document.createElement('textarea');a.value=t;"
    "document.body.append(a);a.select();const ok=document.execCommand('copy');a.remove();"
    "say(ok?'copied':'select the text and copy it')};"
    "navigator.clipboard?navigator.clipboard.writeText(t).then(()=>say('copied'),old):old()"
)


# ---- the banner ------------------------------------------------------------------------------


def banner(answer: Answer) -> Markup:
    """Return the verdict in words, with warnings."""
    analysis = answer.analysis
    no_census = [f"No census: {answer.census_problem}."] if answer.census_problem else []
    sentence = sentences.verdict_sentence(analysis)
    return verdict_banner(analysis.verdict, sentence, analysis.warnings, no_census)


def verdict_banner(
    verdict: Verdict, sentence: str, warnings: Iterable[str], notes: Iterable[str] = ()
) -> Markup:
    """Return the banner of a verdict.

    Parameters
    ----------
    verdict :
        The verdict, which determines the colour.
    sentence :
        The verdict in words.
    warnings :
        Reasons to doubt it, each shown as a warning.
    notes :
        Further sentences shown like warnings.
    """
    texts = [*(f"Warning: {warning}." for warning in warnings), *notes]
    shown = (element("div", text, class_="warning") for text in texts)
    headline = _banner(VERDICT_COLOURS[verdict], sentence)
    return block(style(), headline, element("div", *shown, data_testid="warnings"))


def problem_banner(problem: str) -> Markup:
    """Return the banner that states why there is no answer."""
    return block(style(), _banner((90, 90, 90), problem))


def open_banner(banner: Markup) -> Markup:
    """Return a banner with the mark that a newer question is open.

    Parameters
    ----------
    banner :
        The banner of an earlier question.
    """
    mark = element("div", "computing; this answers an earlier question", class_="open")
    return element("div", mark, banner, class_="ftf ftf-open", data_testid="open")


def _banner(colour: Colour, text: str) -> Markup:
    background, name = f"background:{css(colour)}", "verdict"
    return element("div", text, class_=name, style=background, data_testid=name, role="status")


# ---- the answer -----------------------------------------------------------------------------


def measures(answer: Answer) -> Markup:
    """Return margin, rank, lost directions, brake loads and further measures."""
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
        pairs.append(("At limit", names or "none"))
    pairs += brake_loads(answer.loads)
    if (weakest := answer.weakest) is not None:
        before, after = (_weakest(amount.maximum) for amount in weakest)
        unit = words.unit_of_size(analysis.task)
        pairs.append(("Weakest", f"{before} before, {after} after [{unit}]"))
    return facts(pairs, "measures")


def _weakest(capability: float) -> str:
    if math.isnan(capability):
        return "none"
    return "unlimited" if math.isinf(capability) else size(capability, 1)


def answer_part(answer: Answer) -> Markup:
    """Return the tables of torques and forces, and the measures."""
    analysis = answer.analysis
    settings = facts(situation(analysis), "question")
    question = element("details", element("summary", "Analysis settings"), settings)
    moves = analysis.conditions.moves
    torques = load_table(answer.loads, analysis.rnea.is_known, moves=moves)
    tables = torques, force_table(analysis), measures(answer)
    return block(*tables, question, testid="answer")


# ---- the census ------------------------------------------------------------------------------


def set_label(report: SetReport) -> str:
    """Return a fault set and its effect on one line of plain text."""
    share = report.relative_jump
    if not report.can_stand_still:
        return f"{_joints(report)} {_NO_EQUILIBRIUM}"
    lost = f", {100.0 * share:.2g}% lost" if share > _ROUNDING else ""
    return f"{_joints(report)} {report.verdict}{lost}"


def _joints(report: SetReport) -> str:
    return "{" + ", ".join(str(i + 1) for i in report.faults.joints) + "}"


def census_part(census: Census | None, chosen: tuple[int, ...] = ()) -> Markup:
    """Return all fault sets, worst first.

    Parameters
    ----------
    census :
        The census; ``None`` if not available.
    chosen :
        Joint indices of the current fault set.
    """
    if census is None:
        return block(element("span", "no census", class_="note"), testid="census")
    columns = [
        (census.mode.value, "l", "70px"),
        ("verdict", "l", ""),
        ("jump", "", "84px"),
        ("margin", "", "54px"),
    ]
    rows = [_set_row(report, chosen) for report in census.sets[:_MAX_SETS]]
    more = len(census.sets) - _MAX_SETS
    note = f"… and {more} more in the list above" if more > 0 else ""
    return block(
        element("div", critical_joint(census)),
        table(columns, rows, "census"),
        *_notes(note),
    )


def _set_row(report: SetReport, chosen: tuple[int, ...]) -> Markup:
    verdict = report.verdict.value if report.can_stand_still else _NO_EQUILIBRIUM
    colour = f"color:{css(VERDICT_COLOURS[report.verdict])}"
    parts = ((report.jump_norm, "N"), (report.moment_jump_norm, "N·m"))
    jump = " ".join(f"{size(norm)} {unit}" for norm, unit in parts if norm is not None) or "–"
    return row(
        [
            cell(_joints(report), "l"),
            element("td", verdict, class_="l", style=colour),
            cell(jump),
            cell(ratio(report.margin)),
        ],
        "b" if report.faults.joints == chosen else "",
    )


# ---- legend and command ----------------------------------------------------------------------


def legend(picture: Picture, remarks: Iterable[str] = ()) -> Markup:
    """Return the legend of colours, arrows and lines.

    Parameters
    ----------
    picture :
        The scene.
    remarks :
        Further notes, mostly on missing meshes.
    """
    entries = [_key(ARROW_COLOURS[arrow.kind], arrow.label, "line") for arrow in picture.arrows]
    lines = {line.label: line.colour for line in picture.lines}  # lost ones share one entry
    entries += [_key(colour, label, "line") for label, colour in lines.items()]
    entries += [_key(solid.colour, solid.label) for solid in picture.solids]
    entries += [
        _key(colour, f"{mode} ({mode[0].upper()})") for mode, colour in FAULT_COLOURS.items()
    ]
    entries.append(_key(NEUTRAL, "unknown"))
    steps = ", ".join(css(colour) for colour in RAMP)
    gradient = f"width:50px;background:linear-gradient(90deg,{steps})"
    ramp = element("span", class_="key", style=gradient)
    entries.append(element("span", ramp, "motor load, 0–100% of the limit", class_="entry"))
    notes = _notes(*picture.notes, *remarks)
    return block(element("h3", "Legend"), *entries, *notes, testid="legend")


def keys(pairs: Iterable[tuple[Colour, str]], notes: Iterable[str], testid: str) -> Markup:
    """Return a legend of colours, with notes.

    Parameters
    ----------
    pairs :
        Colours and what they stand for.
    notes :
        Sentences below the legend.
    testid :
        Identifier for tests.
    """
    entries = (_key(colour, label) for colour, label in pairs)
    return block(style(), *entries, *_notes(*notes), testid=testid)


def _notes(*notes: str) -> list[Markup]:
    return [element("div", note, class_="note") for note in notes]


def _key(colour: Colour, label: str, kind: str = "") -> Markup:
    sample = element("span", class_=f"key {kind}".strip(), style=f"background:{css(colour)}")
    return element("span", sample, label, class_="entry")


def command_part(command: str, note: str = "") -> Markup:
    """Return a command line with a copy button.

    Parameters
    ----------
    command :
        The command line.
    note :
        Sentence below it.
    """
    label = "Copy command line"
    button = element(
        "button", label, data_text=command, data_label=label, data_testid="copy", onclick=_COPY
    )
    shown = element("code", command, data_testid="command")
    return block(button, shown, *_notes(note))


def static_page(
    answer: Answer, picture: Picture, command: str, remarks: Iterable[str] = ()
) -> Markup:
    """Return the complete answer for a page without controls.

    Parameters
    ----------
    answer, picture :
        The answer and its scene.
    command :
        Command line that gives the same answer.
    remarks :
        Further notes for the legend.
    """
    parts = [banner(answer), answer_part(answer), legend(picture, remarks)]
    if answer.census is not None:
        parts.append(census_part(answer.census, answer.analysis.faults.joints))
    parts.append(command_part(command, answer.state.origin.note))
    return element("div", *parts, data_testid="static")
