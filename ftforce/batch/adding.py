"""Adding a block of postures to a summary: the checks, and which kernel counts what."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.batch.summary.bins import LINEAR_BINS
from ftforce.batch.summary.summary import RANKS, VERDICTS
from ftforce.errors import InputError

if TYPE_CHECKING:
    from ftforce.batch.results import Block
    from ftforce.batch.summary.summary import Summary
    from ftforce.core.arrays import Matrix

_MEASURES = ("rank_lost", "margin", "rho", "jump", "capability")


def add_block(summary: Summary, block: Block, start: int) -> None:
    """Count a block of postures, in place, see `Summary.add`."""
    _check(summary, block)
    k = len(block.tip)
    summary.postures[...] += k
    if k:
        _add_healthy(summary, block)
        _add_verdicts(summary, block)
        _add_measures(summary, block, start)


def _check(summary: Summary, block: Block) -> None:
    sets, k = summary.n_sets, len(block.tip)
    if block.verdict.shape != (sets, k):
        raise InputError(
            f"a block needs verdicts of shape ({sets}, {k}), got {block.verdict.shape}"
        )
    if block.tip.shape != (k, 3):
        raise InputError(f"a block needs tips of shape ({k}, 3), got {block.tip.shape}")
    wanted = {"rank": (k,), "healthy_margin": (k,)}
    counted = [name for name in _MEASURES if getattr(summary, name) is not None]
    for name, shape in (wanted | dict.fromkeys(counted, (sets, k))).items():
        if (values := getattr(block, name)) is None or values.shape != shape:
            raise InputError(f"a block needs an array {name!r} of shape {shape}")
    for name, end in (("verdict", VERDICTS), ("rank_lost", RANKS), ("rank", RANKS)):
        codes = getattr(block, name)
        if codes.size and not 0 <= codes.min() <= codes.max() < end:
            raise InputError(f"{name} of a block lies from 0 to {end - 1}")


def _add_healthy(summary: Summary, block: Block) -> None:
    from ftforce.batch.kernels.counting import count_codes, count_linear

    count_codes(np.ascontiguousarray(block.rank)[None], summary.healthy_rank[None])
    margin = np.ascontiguousarray(block.healthy_margin)[None]
    unknown = summary.healthy_unknown.reshape(1)  # a view
    count_linear(margin, 1.0, LINEAR_BINS, summary.healthy_margin[None], unknown)


def _add_verdicts(summary: Summary, block: Block) -> None:
    from ftforce.batch.kernels.counting import count_cells, count_codes

    verdict = np.ascontiguousarray(block.verdict)
    count_codes(verdict, summary.verdicts)
    count_codes(np.ascontiguousarray(block.rank_lost), summary.rank_lost)
    cell, outside = summary.workspace.index(block.tip)
    summary.outside[...] += outside
    count_cells(
        cell,
        verdict,
        np.ascontiguousarray(block.margin),
        np.ascontiguousarray(block.rho),
        summary.tolerated_sets,
        summary.cell_postures,
        summary.cell_tolerated,
        summary.cell_tolerates_all,
        summary.cell_worst_margin,
        summary.cell_worst_rho,
        summary.cell_min_margin,
    )


def _add_measures(summary: Summary, block: Block, start: int) -> None:
    from ftforce.batch.kernels.counting import count_linear

    for name, extreme in (("margin", "min_margin"), ("rho", "min_rho"), ("jump", "max_jump")):
        if (counts := getattr(summary, name)) is None:
            continue
        values = np.ascontiguousarray(getattr(block, name))
        largest = summary.bins.force if name == "jump" else 1.0
        unknown = getattr(summary, f"{name}_unknown")
        count_linear(values, largest, LINEAR_BINS, counts, unknown)
        _note(summary, extreme, values, start)
    if summary.capability is not None and block.capability is not None:
        _add_capability(summary, np.ascontiguousarray(block.capability))
        _note(summary, "min_capability", block.capability, start)


def _add_capability(summary: Summary, values: Matrix) -> None:
    from ftforce.batch.kernels.counting import count_logarithmic, leading_bits

    edges, guide = summary.bins.capability, summary.bins.capability_guide
    count_logarithmic(
        values,
        leading_bits(values),
        edges,
        guide,
        summary.capability,
        summary.capability_unlimited,
        summary.capability_unknown,
    )


def _note(summary: Summary, name: str, values: Matrix, start: int) -> None:
    """Note the rows' extremes and where they occur first; NaN is none."""
    largest = name.startswith("max")
    found = (np.fmax if largest else np.fmin).reduce(values, axis=1) + 0.0  # no negative zero
    held, held_at = getattr(summary, name), getattr(summary, f"{name}_at")
    better = found > held if largest else found < held
    at = np.full(len(found), -1)
    for s in np.flatnonzero(better | ((found == held) & (start < held_at))).tolist():
        at[s] = start + np.argmax(values[s] == found[s])
    summary.take(name, found, at)
