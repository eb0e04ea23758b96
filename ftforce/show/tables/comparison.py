"""Tables of a comparison."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from ftforce.batch.kernels.layout import CELL_BINS
from ftforce.batch.summary.bins import LINEAR_BINS
from ftforce.report.comparison import comparison_sentence, critical_words, fault_words, ranks
from ftforce.report.measures import MARGIN, RHO
from ftforce.report.sweep import force_in_words
from ftforce.report.text import joint_kinds, ratio, share, tip_in_words, vector_in_words
from ftforce.show.tables.parts import (
    ABOVE_HEALTHY,
    amount,
    defined,
    facts,
    listing,
    spaced,
    warning_lines,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from ftforce.batch.arm_report import ArmReport, SizeReport
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.result import SweepSetting
    from ftforce.batch.summary.criticality import Estimate
    from ftforce.core.joint_scale import JointScale
    from ftforce.show.tables.parts import TitledTable

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


def _scale(comparison: Comparison) -> JointScale:
    """Return the weights of the first arm that has hinges and slides, or of the first arm."""
    scales = [arm.setting.scale for arm in comparison.arms]
    return next((scale for scale in scales if scale.is_mixed), scales[0])


def _situation(comparison: Comparison) -> list[tuple[str, str]]:
    asked = comparison.question
    has_moments = any(name[0] == "m" for name in asked.components)
    length = f", characteristic length {asked.length:g} m for every arm" if has_moments else ""
    counts = sorted({arm.postures for arm in comparison.arms})
    each = f"{counts[0]:,}" if len(counts) == 1 else f"{counts[0]:,} to {counts[-1]:,}"
    tips = (f"{arm.name}: {tip_in_words(arm.setting)}" for arm in comparison.arms)
    found = [
        ("Tips", "\n".join(tips)),
        ("Faults", f"{fault_words(asked)}, all such sets"),
        ("Task", f"{asked.task} ({', '.join(asked.components)}){length}"),
        ("Axes", f"{asked.axes}: vectors are in the axes of {_AXES[asked.axes]}"),
        *joint_kinds(_scale(comparison)),
        ("Force", force_in_words(asked)),
    ]
    if asked.direction is not None:
        found.append(("Limits", _limits(comparison)))
    drawn = all(arm.setting.is_random for arm in comparison.arms)
    within = "drawn within its joint limits" if drawn else "see the warnings"
    return [
        *found,
        ("Postures", f"{each} of each arm, {within}"),
        ("Tolerance", f"rank {asked.rtol:g}, borderline below {asked.wary:g}"),
    ]


def _limits(comparison: Comparison) -> str:
    sources = sorted({str(arm.setting.limits) for arm in comparison.arms})
    named = sources[0] if len(sources) == 1 else "each arm's own"
    return f"{named}, for the capability; verdict and jump ignore them"


def _ranking(comparison: Comparison) -> TitledTable:
    rows = map(_rank, comparison.arms)
    result = listing(f"Arms, best first ({len(comparison.arms)})", rows, left=2, folded=(1, 6))
    result.caption = (
        "tolerated: share of postures x fault sets (borderline is not); higher is better\n"
        "interval: 95 % confidence; arms whose intervals overlap share their ranks\n"
        "every set: of postures; with it: tolerated of the sets with the critical joint"
    )
    if not all(arm.is_whole for arm in comparison.arms):
        result.caption += "\n* cannot command the whole task even when healthy: see the warning"
    if comparison.question.largest > 1:
        result.caption += "\nevery size of fault set has the same weight"
    return result


def _rank(arm: ArmReport) -> Iterator[tuple[str, str]]:
    yield "rank", ranks(arm)
    yield "arm", arm.name + "*" * (not arm.is_whole)
    yield "n", str(arm.setting.n)
    yield "tolerated\n[%]", share(arm.tolerated.value)
    yield "interval\n[%]", f"{share(arm.tolerated.low)}–{share(arm.tolerated.high)}"
    yield "every\nset [%]", share(arm.every.value)
    yield "critical\njoint", critical_words(arm) if arm.critical_tolerated < 1.0 else "–"
    yield "with it\n[%]", share(arm.critical_tolerated)


def _distances(comparison: Comparison, i: int) -> TitledTable:
    """Return the table of margin and ρ for fault sets of one size."""
    asked = comparison.question
    is_last, is_locked = i == asked.largest - 1, asked.mode == "locked"
    joints = "a single joint" if i == 0 else f"{i + 1} joints"
    rows = [_distance(asked, arm, i) for arm in comparison.arms]
    result = listing(f"How far from losing a direction: sets of {joints}", rows)
    notes = ["5 %, 50 %: quantiles over postures x sets; higher is better"]
    if is_locked:
        same = "the same at (nearly) every posture"
        notes.append(f"mean ρ: root mean square, set by n alone: {same}")
    if is_last:
        notes.append("worst ρ: smallest ρ of a posture, median over the postures")
    if is_last and is_locked:
        notes.append("even: worst over mean ρ, which it cannot exceed; higher is better")
    result.caption = "\n".join(notes)
    return result


def _distance(asked: SweepSetting, arm: ArmReport, i: int) -> Iterator[tuple[str, str]]:
    one = arm.sizes[i]
    is_last, is_locked = i == asked.largest - 1, asked.mode == "locked"
    yield "arm", arm.name
    if asked.largest > 1:
        yield "tolerated\n[%]", share(one.tolerated.value)
    for measure, (low, middle) in {MARGIN.symbol: one.margin, RHO.symbol: one.rho}.items():
        yield f"{measure}\n5 %", _quantile(low, LINEAR_BINS)
        yield "\n50 %", _quantile(middle, LINEAR_BINS)
    if is_locked:
        yield "mean\nρ", _mean_rho(one)
    if is_last:
        yield "worst ρ\n50 %", _quantile(arm.worst_rho, CELL_BINS)
    if is_last and is_locked:
        yield "even\n[%]", _evenness(arm, one)


def _mean_rho(one: SizeReport) -> str:
    unknown = math.isnan(one.rho_bound) or math.isnan(one.rho[1].value)
    return "–" if unknown else ratio(one.rho_bound)


def _quantile(found: Estimate, bins: int) -> str:
    """Format a quantile; in the lowest bin it cannot be distinguished from 0."""
    return f"<{1 / bins:.2g}" if found.value < 1 / bins else defined(found.value)


def _evenness(arm: ArmReport, one: SizeReport) -> str:
    if math.isnan(arm.evenness):
        return "–"
    if arm.worst_rho.value < 1 / CELL_BINS:
        return f"<{100.0 / CELL_BINS / one.rho_bound:.0f}"
    return f"{100.0 * arm.evenness:.0f}"


def _force(comparison: Comparison) -> TitledTable | None:
    asked = comparison.question
    forced, capable = asked.force is not None, asked.direction is not None
    if not (forced or capable):
        return None
    rows = [
        [
            ("arm", arm.name),
            *zip(("jump\n50 %", "[%]\n95 %"), map(_jump, arm.sizes[0].jump or ()), strict=False),
            *(_capability_cells(arm, asked.capability_unit) if capable else ()),
        ]
        for arm in comparison.arms
    ]
    result = listing("Force after a single fault", rows)
    notes = ["jump: share of the force that is lost; lower is better"] * forced
    if capable:
        where = vector_in_words(asked.direction or ())
        notes += [
            f"before, after: largest commanded force along {where}",
            "kept: median after over median before; –: unknown, or nothing before",
        ]
    if capable and asked.mode == "locked":
        notes.append(ABOVE_HEALTHY)
    result.caption = "\n".join(notes)
    return result


def _jump(found: Estimate) -> str:
    return "≥100" if math.isinf(found.value) else share(found.value)


def _capability_cells(arm: ArmReport, unit: str) -> Iterator[tuple[str, str]]:
    pairs = {"before": arm.healthy_capability, "after": arm.sizes[0].capability}
    for when, pair in pairs.items():
        low, middle = ("–", "–") if pair is None else (amount(one.value) for one in pair)
        yield f"{when}\n5 % [{unit}]", low
        yield "\n50 %", middle
    kept = arm.capability_kept
    yield "kept\n[%]", f"{100.0 * kept:.0f}" if math.isfinite(kept) else "–"


def _workspace(comparison: Comparison) -> TitledTable:
    result = listing("Workspace", map(_place, comparison.arms))
    result.caption = (
        f"survived: cells in which {100.0 * comparison.enough:g}% of the postures or more tolerate "
        "every set\n[%]: of the visited ones; some: cells in which at least one posture does"
    )
    return result


def _place(arm: ArmReport) -> Iterator[tuple[str, str]]:
    place = arm.workspace
    yield "arm", arm.name
    yield "reach\n[m]", f"{place.reach:.2f}"
    yield "visited\n[m³]", f"{place.visited:.3g}"
    yield "survived\n[m³]", f"{place.survived:.3g}"
    yield "\n[%]", f"{100.0 * place.share:.1f}"
    yield "some\n[m³]", f"{place.some:.3g}"
    yield "cell\n[m]", f"{place.cell:.3f}"
