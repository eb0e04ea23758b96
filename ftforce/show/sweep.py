"""Tables of a sweep."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.batch.bins import LINEAR_BINS
from ftforce.batch.statistics import quantile as quantile_of
from ftforce.show.tables import defined, facts, spaced, table, warning_lines
from ftforce.sweep_words import (
    direction_in_words,
    force_in_words,
    interval,
    share,
    sweep_sentence,
)
from ftforce.words import NEGLIGIBLE, ratio, size

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.batch.criticality import JointCriticality
    from ftforce.batch.result import Sweep
    from ftforce.batch.set_summaries import SetSummary
    from ftforce.show.tables import TitledTable

MOST_SETS = 20
"""How many fault sets a sweep's table shows, worst first."""
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
    """Return what was asked, as names and values."""
    setting = sweep.setting
    has_moments = any(name[0] == "m" for name in setting.components)
    length = f", characteristic length {setting.length:g} m" if has_moments else ""
    numbered = ", ".join(f"{i} {name}" for i, name in enumerate(setting.joints, start=1))
    axes = (
        "the tool frame" if setting.axes == "tool" else "the world (the robot's root), at the tip"
    )
    sizes = "1 joint" if setting.largest == 1 else f"1 to {setting.largest} joints"
    gravity = ", ".join(f"{g:g}" for g in setting.gravity)
    weight = [("Weight", f"gravity ({gravity}) m/s² in the root's axes{_payload(sweep)}")]
    weighs = setting.direction is not None or setting.mode == "free"
    stored = [] if sweep.path is None else [("Stored", f"{sweep.path} (kept: {setting.keep})")]
    return [
        ("Robot", f"{setting.robot}: {setting.n} joints, {setting.base} → {setting.tip}"),
        ("Joints", numbered),
        ("Axes", f"{setting.axes}: vectors are in the axes of {axes}"),
        ("Task", f"{setting.task} ({', '.join(setting.components)}){length}"),
        ("Postures", setting.postures),
        ("Faults", f"{len(sweep.sets)} sets of {sizes}, {setting.mode}"),
        ("Force", force_in_words(setting)),
        ("Capability", direction_in_words(setting)),
        *(weight if weighs else []),
        ("Tolerance", f"rank {setting.rtol:g}, wary below {setting.wary:g}"),
        *stored,
    ]


def _payload(sweep: Sweep) -> str:
    return "" if sweep.setting.payload is None else f"; payload {sweep.setting.payload}"


def joints_table(sweep: Sweep) -> TitledTable:
    """Return the joints, most critical first, with 95 % confidence intervals."""
    setting, joints = sweep.setting, sweep.joints
    several = setting.largest > 1
    capable = any(joint.capability is not None for joint in joints)
    result = table(
        "Joints, most critical first",
        "#", "joint", "not tolerated\n[%] (95 % interval)", "border-\nline [%]",
        *(["alone\n[%]"] if several else []), "margin\n5 %", "\n50 %", "ρ\n5 %", "\n50 %",
        *([f"force\n[{setting.capability_unit}]"] if capable else []), left=3, folded=(1,),
    )  # fmt: skip
    for joint in joints:
        result.add_row(*_joint(sweep, joint, several=several, capable=capable))
    notes = ["margin, ρ: quantiles over the postures when the joint fails alone"]
    if several:
        notes.insert(0, "not tolerated: of all cases, postures × sets that hold the joint")
        notes.insert(1, "alone: not tolerated when it fails alone")
    if capable:
        notes.append("force: median of the capability when it fails alone")
    result.caption = "\n".join(notes)
    return result


def _joint(
    sweep: Sweep, joint: JointCriticality, *, several: bool, capable: bool
) -> tuple[str | Text, ...]:
    amount = "–" if joint.capability is None else _amount(joint.capability.value)
    style = "bold red" if joint.not_tolerated.value > 0.0 else ""
    return (
        str(joint.joint + 1),
        sweep.setting.joints[joint.joint],
        Text(interval(joint.not_tolerated), style=style),
        share(joint.borderline),
        *([share(joint.alone.value)] if several else []),
        *(quantile(one.value) for one in (*joint.margin, *joint.rho)),
        *([amount] if capable else []),
    )


def quantile(x: float) -> str:
    """Write a quantile of margin or ρ; what lies in the first bin may be nothing."""
    return f"<{_BIN:g}" if x < _BIN else defined(x)


def _amount(x: float) -> str:
    return "–" if math.isnan(x) else "no limit" if math.isinf(x) else size(x, 1)


def _sets(sweep: Sweep, most: int) -> TitledTable:
    setting, ranked = sweep.setting, sweep.ranked
    jumps = any(one.jump is not None for one in ranked)
    capable = any(one.capability is not None for one in ranked)
    falls = any(one.falls > 0.0 for one in ranked)
    unit = setting.size_unit
    result = table(
        f"Fault sets, {setting.mode}, worst first",
        setting.mode, "not tol.\n[%]", "border-\nline [%]", *(["falls\n[%]"] if falls else []),
        *([f"jump 50 %\n[{unit}]", "\n95 %", "\nmost"] if jumps else []), "margin\n5 %", "ρ\n5 %",
        *([f"force 5 %\n[{setting.capability_unit}]", "\n50 %"] if capable else []), folded=(),
    )  # fmt: skip
    for one in ranked[:most]:
        result.add_row(
            "{" + ", ".join(str(i + 1) for i in one.faults.joints) + "}",
            share(one.not_tolerated.value),
            share(one.borderline.value),
            *([share(one.falls)] if falls else []),
            *(_jumps(sweep, one) if jumps else ()),
            quantile(one.margin[0]),
            quantile(one.rho[0]),
            *(map(_amount, one.capability) if one.capability is not None else ()),
        )
    notes = ["falls: nothing holds the arm"] if falls else []
    if jumps:
        notes.append("jump: quantiles over the postures, and the largest")
    if capable:
        notes.append("force: quantiles of the capability")
    if len(ranked) > most:
        notes.append(f"… and {len(ranked) - most} more (--top)")
    result.caption = "\n".join(notes)
    return result


def _jumps(sweep: Sweep, one: SetSummary) -> tuple[str, ...]:
    """Return the jump's quantiles and its largest; what lies in the first bin may be nothing."""
    edges = sweep.summary.bins.jump
    if one.jump is None or edges is None:
        return ("–", "–", "–")
    *quantiles, most = one.jump
    nothing = most <= NEGLIGIBLE
    cells = ["0" if nothing else _jump(x, float(edges[1]), float(edges[-1])) for x in quantiles]
    return (*cells, "0" if nothing else "–" if math.isnan(most) else size(most, 1))


def _jump(x: float, first: float, last: float) -> str:
    if math.isinf(x):
        return f">{ratio(last)}"
    return f"<{ratio(first)}" if x < first else _amount(x)


def _shares(sweep: Sweep) -> list[tuple[str, str]]:
    summary = sweep.summary
    visited = summary.cell_postures > 0
    survives = summary.cell_tolerates_all[visited] >= _CELLS_LEFT * summary.cell_postures[visited]
    edge = summary.workspace.edge
    count = int(visited.sum())
    left = f"{share(float(survives.mean()))} % of them" if count else "none"
    margins, total = summary.healthy_margin, max(sweep.done, 1)
    edges, full = summary.bins.share, int(summary.healthy_rank[len(sweep.setting.components)])
    low, middle = (quantile(float(quantile_of(margins, edges, p))) for p in (0.05, 0.5))
    rank = f"full rank in {share(full / total)} % of the postures"
    room = f"{count:,} cells of {edge:g} m with postures, {count * edge**3:.3g} m³"
    return [
        ("Healthy arm", f"{rank}; margin {low} (5 %), {middle} (50 %)"),
        ("Every set tolerated", f"{interval(sweep.every_set)} % of the postures"),
        ("Workspace", f"{room}; in {left} {_CELLS_LEFT:.0%} of the postures tolerate every set"),
    ]
