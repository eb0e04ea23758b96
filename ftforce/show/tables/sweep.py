"""Tables of a sweep."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.batch.summary.bins import LINEAR_BINS
from ftforce.report.measures import MARGIN, RHO
from ftforce.report.sweep import direction_in_words, force_in_words, interval, sweep_sentence
from ftforce.report.text import NEGLIGIBLE, axes_in_words, ratio, set_of, share
from ftforce.show.tables.analysis import arm_fact
from ftforce.show.tables.parts import (
    HEALTHY_ROW,
    amount,
    defined,
    facts,
    listing,
    spaced,
    warning_lines,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from ftforce.batch.result import Sweep
    from ftforce.batch.summary.criticality import JointCriticality, SetSummary
    from ftforce.show.tables.parts import TitledTable

MOST_SETS = 20
"""Maximum number of fault sets in a sweep's table, worst first."""
_BIN = 1.0 / LINEAR_BINS
_CELLS_LEFT = 0.95  # share of tolerated postures from which a cell counts as surviving


def sweep_view(sweep: Sweep, *, most: int = MOST_SETS) -> RenderableType:
    """Return the tables of a sweep, with the ``most`` worst fault sets."""
    has_sets = sweep.setting.largest > 1 or sweep.setting.force is not None
    return spaced(
        facts(sweep_facts(sweep)),
        joints_table(sweep),
        _sets(sweep, most) if has_sets else None,
        facts(_shares(sweep)),
        warning_lines(sweep.warnings),
        Text(sweep_sentence(sweep), style="bold"),
    )


def sweep_facts(sweep: Sweep) -> list[tuple[str, str]]:
    """Return the question as names and values."""
    setting = sweep.setting
    has_moments = any(name[0] == "m" for name in setting.components)
    length = f", characteristic length {setting.length:g} m" if has_moments else ""
    numbered = ", ".join(f"{i} {name}" for i, name in enumerate(setting.joints, start=1))
    sizes = "1 joint" if setting.largest == 1 else f"1 to {setting.largest} joints"
    gravity = ", ".join(f"{g:g}" for g in setting.gravity)
    payload = "" if setting.payload is None else f"; payload {setting.payload}"
    weight = [("Weight", f"gravity ({gravity}) m/s² in the root's axes{payload}")]
    weighs = setting.direction is not None or setting.mode == "free"
    stored = [] if sweep.path is None else [("Stored", f"{sweep.path} (kept: {setting.keep})")]
    return [
        arm_fact(setting.robot, setting.n, setting.base, setting.tip),
        ("Joints", numbered),
        ("Axes", f"{setting.axes}: vectors are in the axes of {axes_in_words(setting)}"),
        ("Task", f"{setting.task} ({', '.join(setting.components)}){length}"),
        ("Postures", setting.postures),
        ("Faults", f"{len(sweep.sets)} sets of {sizes}, {setting.mode}"),
        ("Force", force_in_words(setting)),
        ("Capability", direction_in_words(setting)),
        *(weight if weighs else []),
        *([("Friction", setting.friction)] if setting.friction else []),
        ("Tolerance", f"rank {setting.rtol:g}, borderline below {setting.wary:g}"),
        *stored,
    ]


def joints_table(sweep: Sweep) -> TitledTable:
    """Return the joints, most critical first, with 95 % confidence intervals."""
    several = sweep.setting.largest > 1
    capable = any(joint.capability is not None for joint in sweep.joints)
    pairs = zip(sweep.joints, map(str, sweep.joint_ranks), strict=True)
    rows = [[*_joint(sweep, *pair, capable=capable)] for pair in pairs]
    rows.append(_healthy(sweep, [heading for heading, _ in rows[0]]))
    result = listing("Joints, most critical first", rows, left=4, folded=(2,))
    notes = [
        "margin, ρ: quantiles over the postures when the joint fails alone",
        f"rank: by not tolerated; overlapping intervals share ranks; {HEALTHY_ROW}: healthy arm",
    ]
    if several:
        notes.insert(0, "not tolerated: of all cases, postures × sets that contain the joint")
        notes.insert(1, "alone: not tolerated when it fails alone")
    if capable:
        notes.append("force: median of the capability when it fails alone")
    result.caption = "\n".join(notes)
    return result


def _joint(
    sweep: Sweep, joint: JointCriticality, rank: str, *, capable: bool
) -> Iterator[tuple[str, str | Text]]:
    setting, lost = sweep.setting, joint.not_tolerated
    yield "rank", rank
    yield "#", str(joint.joint + 1)
    yield "joint", setting.joints[joint.joint]
    style = "bold red" if lost.value > 0.0 else ""
    yield "not tolerated\n[%] (95 % interval)", Text(interval(lost), style=style)
    yield "border-\nline [%]", share(joint.borderline)
    if setting.largest > 1:
        yield "alone\n[%]", share(joint.alone.value)
    for measure, (low, middle) in {MARGIN.symbol: joint.margin, RHO.symbol: joint.rho}.items():
        yield f"{measure}\n5 %", quantile(low.value)
        if measure == MARGIN.symbol or not (capable and setting.largest > 1):  # or 80 columns end
            yield "\n50 %", quantile(middle.value)
    if capable:
        median = "–" if joint.capability is None else amount(joint.capability.value)
        yield f"force\n[{setting.capability_unit}]", median


def _healthy(sweep: Sweep, headings: Sequence[str]) -> list[tuple[str, str | Text]]:
    """Return the row of the healthy arm, which loses nothing: its margins, and ρ = 1."""
    low, middle = map(quantile, sweep.healthy_margin)
    after = len(headings) - 1 - headings.index(f"{MARGIN.symbol}\n5 %")
    cells = ["", "", HEALTHY_ROW, *[""] * (len(headings) - 4 - after), low, middle]
    cells += [
        "1" if heading in {f"{RHO.symbol}\n5 %", "\n50 %"} else ""
        for heading in headings[len(cells) :]
    ]
    return list(zip(headings, cells, strict=True))


def quantile(x: float) -> str:
    """Format a quantile of margin or ρ; in the first bin it cannot be distinguished from 0."""
    return f"<{_BIN:g}" if x < _BIN else defined(x)


def _sets(sweep: Sweep, most: int) -> TitledTable:
    setting, ranked = sweep.setting, sweep.ranked
    jumps = any(one.jump is not None for one in ranked)
    capable = any(one.capability is not None for one in ranked)
    falls = any(one.falls > 0.0 for one in ranked)
    pairs = list(zip(ranked, map(str, sweep.set_ranks), strict=True))[:most]
    rows = [_set(sweep, *pair, falls=falls, jumps=jumps) for pair in pairs]
    result = listing(f"Fault sets, {setting.mode}, worst first", rows, left=2, folded=())
    notes = ["falls: the arm cannot be held in static equilibrium"] if falls else []
    if jumps:
        notes.append("jump: quantiles over the postures, and the largest")
    if capable:
        notes.append("force: quantiles of the capability")
    if len(ranked) > most:
        notes.append(f"… and {len(ranked) - most} more (--top)")
    result.caption = "\n".join(notes)
    return result


def _set(
    sweep: Sweep, one: SetSummary, rank: str, *, falls: bool, jumps: bool
) -> Iterator[tuple[str, str]]:
    setting = sweep.setting
    yield "rank", rank
    yield setting.mode, set_of(one.faults.joints)
    yield "not tol.\n[%]", share(one.not_tolerated.value)
    yield "border-\nline [%]", share(one.borderline.value)
    if falls:
        yield "falls\n[%]", share(one.falls)
    if jumps:
        headings = (f"jump 50 %\n[{setting.size_unit}]", "\n95 %", "\nmost")
        yield from zip(headings, _jumps(sweep, one), strict=True)
    yield f"{MARGIN.symbol}\n5 %", quantile(one.margin[0])
    yield f"{RHO.symbol}\n5 %", quantile(one.rho[0])
    if one.capability is not None:
        yield f"force 5 %\n[{setting.capability_unit}]", amount(one.capability[0])
        if not jumps:  # a table of 80 columns has room for either
            yield "\n50 %", amount(one.capability[1])


def _jumps(sweep: Sweep, one: SetSummary) -> tuple[str, ...]:
    """Return quantiles and maximum of the jump; in the first bin it cannot be told from 0."""
    edges = sweep.summary.bins.jump
    if one.jump is None or edges is None:
        return ("–", "–", "–")
    *quantiles, most = one.jump
    if most <= NEGLIGIBLE:
        return ("0", "0", "0")
    cells = (_jump(x, float(edges[1]), float(edges[-1])) for x in quantiles)
    return (*cells, amount(most))


def _jump(x: float, first: float, last: float) -> str:
    if math.isinf(x):
        return f">{ratio(last)}"
    return f"<{ratio(first)}" if x < first else amount(x)


def _shares(sweep: Sweep) -> list[tuple[str, str]]:
    summary = sweep.summary
    visited = summary.cell_postures > 0
    survives = summary.cell_tolerates_all[visited] >= _CELLS_LEFT * summary.cell_postures[visited]
    edge = summary.workspace.edge
    count = int(visited.sum())
    left = f"{share(float(survives.mean()))} % of them" if count else "none"
    total, full = max(sweep.done, 1), int(summary.healthy_rank[len(sweep.setting.components)])
    low, middle = map(quantile, sweep.healthy_margin)
    rank = f"full rank in {share(full / total)} % of the postures"
    room = f"{count:,} cells of {edge:g} m with postures, {count * edge**3:.3g} m³"
    return [
        ("Healthy arm", f"{rank}; margin {low} (5 %), {middle} (50 %)"),
        ("Every set tolerated", f"{interval(sweep.every_set)} % of the postures"),
        ("Workspace", f"{room}; in {left} {_CELLS_LEFT:.0%} of the postures tolerate every set"),
    ]
