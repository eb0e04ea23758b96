"""Tables of a comparison."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.comparison_words import (
    comparison_sentence,
    critical_words,
    direction_words,
    fault_words,
    ranks,
)
from ftforce.show.tables import facts, spaced, table, warning_lines
from ftforce.sweep_words import force_in_words, share
from ftforce.words import ratio, size

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.batch.arm_report import ArmReport, SizeReport
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.criticality import Estimate
    from ftforce.show.tables import TitledTable

_AXES = {"tool": "the tool frame", "world": "the world (each robot's root), at the tip"}


def comparison_view(comparison: Comparison) -> RenderableType:
    """Return the tables of a comparison, the best arm first in each."""
    return spaced(
        facts(_situation(comparison)),
        _ranking(comparison),
        *(_distances(comparison, i) for i in range(comparison.question.largest)),
        _force(comparison),
        _workspace(comparison),
        warning_lines(comparison.warnings),
        Text(comparison_sentence(comparison), style="bold"),
    )


def _situation(comparison: Comparison) -> list[tuple[str, str]]:
    asked = comparison.question
    has_moments = any(name[0] == "m" for name in asked.components)
    length = f", characteristic length {asked.length:g} m for every arm" if has_moments else ""
    counts = sorted({arm.postures for arm in comparison.arms})
    each = f"{counts[0]:,}" if len(counts) == 1 else f"{counts[0]:,} to {counts[-1]:,}"
    found = [
        ("Faults", f"{fault_words(asked)}, every set of them"),
        ("Task", f"{asked.task} ({', '.join(asked.components)}){length}"),
        ("Axes", f"{asked.axes}: vectors are in the axes of {_AXES[asked.axes]}"),
        ("Force", force_in_words(asked)),
    ]
    if asked.direction is not None:
        found.append(("Limits", _limits(comparison)))
    drawn = all(arm.setting.is_random for arm in comparison.arms)
    within = "drawn within its joint limits" if drawn else "see the warnings"
    return [
        *found,
        ("Postures", f"{each} of each arm, {within}"),
        ("Tolerance", f"rank {asked.rtol:g}, wary below {asked.wary:g}"),
    ]


def _limits(comparison: Comparison) -> str:
    sources = sorted({str(arm.setting.limits) for arm in comparison.arms})
    named = sources[0] if len(sources) == 1 else "each arm's own"
    return f"{named}, for the capability; verdict and jump do not count them"


def _ranking(comparison: Comparison) -> TitledTable:
    result = table(
        f"Arms, best first ({len(comparison.arms)})", "rank", "arm", "n", "tolerated\n[%]",
        "interval\n[%]", "every\nset [%]", "critical\njoint", "with it\n[%]",
        left=2, folded=(1, 6),
    )  # fmt: skip
    for arm in comparison.arms:
        result.add_row(
            ranks(arm),
            arm.name + "*" * (not arm.is_whole),
            str(arm.setting.n),
            share(arm.tolerated.value),
            f"{share(arm.tolerated.low)}–{share(arm.tolerated.high)}",
            share(arm.every.value),
            critical_words(arm) if arm.critical_tolerated < 1.0 else "–",
            share(arm.critical_tolerated),
        )
    result.caption = (
        "tolerated: of postures x fault sets, more is better; borderline is not tolerated\n"
        "interval: 95 % confidence; arms whose intervals overlap share their ranks\n"
        "every set: of postures; with it: tolerated of the sets with the critical joint"
    )
    if not all(arm.is_whole for arm in comparison.arms):
        result.caption += "\n* healthy, it cannot command the whole task: see the warning"
    if comparison.question.largest > 1:
        result.caption += "\nsets of one size weigh as much as those of another"
    return result


def _distances(comparison: Comparison, i: int) -> TitledTable:
    """Return margin and ρ of the sets of one size."""
    asked = comparison.question
    several, is_last, is_locked = asked.largest > 1, i == asked.largest - 1, asked.mode == "locked"
    joints = "a single joint" if i == 0 else f"{i + 1} joints"
    columns = ["tolerated\n[%]"] * several + ["margin\n5 %", "\n50 %", "ρ\n5 %", "\n50 %"]
    columns += ["mean\nρ"] * is_locked + ["worst ρ\n50 %"] * is_last
    columns += ["even\n[%]"] * (is_last and is_locked)
    result = table(f"How far from losing a direction: sets of {joints}", "arm", *columns)
    for arm in comparison.arms:
        one = arm.sizes[i]
        cells = [share(one.tolerated.value)] * several
        cells += [_quantile(x, 1e-3) for x in (*one.margin, *one.rho)]
        cells += [_mean_rho(one)] * is_locked + [_quantile(arm.worst_rho, 1 / 32)] * is_last
        cells += [_evenness(arm, one)] * (is_last and is_locked)
        result.add_row(arm.name, *cells)
    notes = ["5 %, 50 %: of postures x sets, that many lie below; more is better"]
    notes += ["mean ρ: root of the mean square, by n alone: the same at (nearly) every posture"] * (
        is_locked
    )
    notes += ["worst ρ: a posture's smallest, the median"] * is_last
    if is_last and is_locked:
        notes.append("even: worst over mean ρ, which it cannot exceed; more is better")
    result.caption = "\n".join(notes)
    return result


def _mean_rho(one: SizeReport) -> str:
    unknown = math.isnan(one.rho_bound) or math.isnan(one.rho[1].value)
    return "–" if unknown else ratio(one.rho_bound)


def _quantile(found: Estimate, bin_width: float) -> str:
    """Write a quantile; in the lowest bin nothing tells it from 0."""
    if math.isnan(found.value):
        return "–"
    return f"<{bin_width:.2g}" if found.value < bin_width else ratio(found.value)


def _evenness(arm: ArmReport, one: SizeReport) -> str:
    if math.isnan(arm.evenness):
        return "–"
    if arm.worst_rho.value < 1 / 32:
        return f"<{100.0 / 32 / one.rho_bound:.0f}"
    return f"{100.0 * arm.evenness:.0f}"


def _force(comparison: Comparison) -> TitledTable | None:
    asked = comparison.question
    forced, capable = asked.force is not None, asked.direction is not None
    if not (forced or capable):
        return None
    unit = asked.capability_unit
    jumps = ("jump\n50 %", "[%]\n95 %") * forced
    amounts = (f"before\n5 % [{unit}]", "\n50 %", f"after\n5 % [{unit}]", "\n50 %", "kept\n[%]")
    result = table(
        "Force after a single fault", "arm", *jumps, *(amounts if capable else ()),
    )  # fmt: skip
    for arm in comparison.arms:
        one = arm.sizes[0]
        result.add_row(
            arm.name,
            *(() if one.jump is None else map(_jump, one.jump)),
            *(_capability_cells(arm, one) if capable else ()),
        )
    notes = ["jump: share of the force that is lost; less is better"] * forced
    if capable:
        notes += [
            f"before, after: largest commanded force along {direction_words(asked)}",
            "kept: median after over median before; –: unknown, or nothing before",
        ]
    if capable and asked.mode == "locked":
        notes += ["above 100: the brake holds a locked joint, and its motor's limit counts no more"]
    result.caption = "\n".join(notes)
    return result


def _jump(found: Estimate) -> str:
    return "≥100" if math.isinf(found.value) else share(found.value)


def _capability_cells(arm: ArmReport, one: SizeReport) -> list[str]:
    pairs = (arm.healthy_capability, one.capability)
    cells = [_amount(pair, k) for pair in pairs for k in (0, 1)]
    kept = arm.capability_kept
    return [*cells, f"{100.0 * kept:.0f}" if math.isfinite(kept) else "–"]


def _amount(pair: tuple[Estimate, Estimate] | None, k: int) -> str:
    if pair is None:
        return "–"
    return "no limit" if math.isinf(pair[k].value) else size(pair[k].value, 1)


def _workspace(comparison: Comparison) -> TitledTable:
    result = table(
        "Workspace", "arm", "reach\n[m]", "visited\n[m³]", "survived\n[m³]", "\n[%]",
        "some\n[m³]", "cell\n[m]",
    )  # fmt: skip
    for arm in comparison.arms:
        place = arm.workspace
        volumes = (place.visited, place.survived)
        result.add_row(
            arm.name,
            f"{place.reach:.2f}",
            *(f"{x:.3g}" for x in volumes),
            f"{100.0 * place.share:.1f}",
            f"{place.some:.3g}",
            f"{place.cell:.3f}",
        )
    result.caption = (
        f"survived: cells in which {100.0 * comparison.enough:g}% of the postures or more tolerate "
        "every set\n[%]: of the visited ones; some: cells in which at least one posture does"
    )
    return result
