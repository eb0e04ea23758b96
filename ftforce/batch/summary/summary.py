"""Summary of a sweep in integer counts, bitwise independent of the order of accumulation."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.batch.kernels.layout import CELL_BINS
from ftforce.batch.summary.bins import LINEAR_BINS
from ftforce.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import ArrayLike, NDArray

    from ftforce.batch.kernels.layout import Block
    from ftforce.batch.summary.bins import Bins, Workspace
    from ftforce.core.arrays import Matrix, Vector

    Counts = NDArray[np.int64]

_MEASURES = ("rank_lost", "margin", "rho", "jump", "capability")


def _add_block(summary: Summary, block: Block, start: int, *, compiled: bool) -> None:
    """Add a block of postures, in place.

    Parameters
    ----------
    summary, block, start, compiled :
        The summary, and the arguments of `Summary.add`.
    """
    count: Any  # the same functions, compiled or not
    if compiled:
        from ftforce.batch.kernels import counting as count
    else:
        from ftforce.batch.summary import counting as count
    _check(summary, block)
    k = len(block.tip)
    summary.postures[...] += k
    if k:
        _add_healthy(summary, block, count)
        _add_verdicts(summary, block, count)
        _add_measures(summary, block, start, count)


def _check(summary: Summary, block: Block) -> None:
    sets, k = summary.n_sets, len(block.tip)
    if block.verdict.shape != (sets, k):
        raise InputError(
            f"verdict of the block: expected shape ({sets}, {k}), got {block.verdict.shape}"
        )
    if block.tip.shape != (k, 3):
        raise InputError(f"tip of the block: expected shape ({k}, 3), got {block.tip.shape}")
    wanted = {"rank": (k,), "healthy_margin": (k,)}
    counted = [name for name in _MEASURES if getattr(summary, name) is not None]
    for name, shape in (wanted | dict.fromkeys(counted, (sets, k))).items():
        if (values := getattr(block, name)) is None or values.shape != shape:
            got = None if values is None else values.shape
            raise InputError(f"{name} of the block: expected shape {shape}, got {got}")
    for name, end in (("verdict", _VERDICTS), ("rank_lost", RANKS), ("rank", RANKS)):
        codes = getattr(block, name)
        if codes.size and not 0 <= codes.min() <= codes.max() < end:
            raise InputError(f"{name} of the block: expected values from 0 to {end - 1}")


def _add_healthy(summary: Summary, block: Block, count: Any) -> None:
    count.count_codes(np.ascontiguousarray(block.rank)[None], summary.healthy_rank[None])
    margin = np.ascontiguousarray(block.healthy_margin)[None]
    unknown = summary.healthy_unknown.reshape(1)  # a view
    count.count_linear(margin, 1.0, LINEAR_BINS, summary.healthy_margin[None], unknown)


def _add_verdicts(summary: Summary, block: Block, count: Any) -> None:
    verdict = np.ascontiguousarray(block.verdict)
    count.count_codes(verdict, summary.verdicts)
    count.count_codes(np.ascontiguousarray(block.rank_lost), summary.rank_lost)
    cell, outside = summary.workspace.index(block.tip, count.locate)
    summary.outside[...] += outside
    count.count_cells(
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


def _add_measures(summary: Summary, block: Block, start: int, count: Any) -> None:
    for name, extreme in (("margin", "min_margin"), ("rho", "min_rho"), ("jump", "max_jump")):
        if (counts := getattr(summary, name)) is None:
            continue
        values = np.ascontiguousarray(getattr(block, name))
        largest = summary.bins.force if name == "jump" else 1.0
        unknown = getattr(summary, f"{name}_unknown")
        count.count_linear(values, largest, LINEAR_BINS, counts, unknown)
        _update_extreme(summary, extreme, values, start)
    if summary.capability is not None and block.capability is not None:
        _add_capability(summary, np.ascontiguousarray(block.capability), count)
        _update_extreme(summary, "min_capability", block.capability, start)


def _add_capability(summary: Summary, values: Matrix, count: Any) -> None:
    bins, edges = summary.bins, summary.bins.capability
    outside = summary.capability_unlimited, summary.capability_unknown
    if hasattr(count, "leading_bits"):  # compiled
        found = count.leading_bits(values), edges, bins.capability_lookup
        count.count_logarithmic(values, *found, summary.capability, *outside)
    else:
        count.count_logarithmic(values, edges, summary.capability, *outside)


def _update_extreme(summary: Summary, name: str, values: Matrix, start: int) -> None:
    """Record the extreme of each row and its first occurrence, ignoring NaN."""
    largest = name.startswith("max")
    found = (np.fmax if largest else np.fmin).reduce(values, axis=1) + 0.0  # turns -0.0 into 0.0
    held, held_at = getattr(summary, name), getattr(summary, f"{name}_at")
    better = found > held if largest else found < held
    at = np.full(len(found), -1)
    for s in np.flatnonzero(better | ((found == held) & (start < held_at))).tolist():
        at[s] = start + np.argmax(values[s] == found[s])
    summary.take(name, found, at)


_MAX_BYTES = 1_000_000_000
_VERDICTS, RANKS = 3, 7


@dataclass(frozen=True, eq=False, kw_only=True)
class Summary:
    """Counts over postures, S fault sets and the cells of the workspace.

    All arrays are int64 counts, except those named ``min…``, ``max…`` or ``cell_min…``. The size is
    about 8·(S·(2017 + 1004 with a force + 906 with a direction) + cells·(66 + 2 S)) bytes. Arrays
    that need a force or direction are ``None`` without it.

    Attributes
    ----------
    bins, workspace :
        Histogram bins, and workspace cells.
    postures, outside :
        Number of postures, and of those whose tip lies outside the cells, shape ().
    healthy_rank, healthy_margin, healthy_unknown :
        Of the healthy arm: histogram of ranks 0 to 6, shape (7,); of margins, shape (1000,); and
        number of NaN margins, shape ().
    tolerated_sets :
        Postures that tolerate exactly j of the sets, shape (S + 1,).
    verdicts :
        Postures tolerated, borderline and not tolerated, shape (S, 3).
    rank_lost :
        Histogram of the rank lost, 0 to 6, shape (S, 7).
    margin, rho :
        Histograms, shape (S, 1000).
    jump :
        Histogram, the last bin for jumps larger than the force, shape (S, 1001).
    capability :
        Histogram, the first bin below the edges and the last above, shape (S, 902).
    margin_unknown, rho_unknown, jump_unknown, capability_unknown :
        Numbers of NaN, where J vanishes, w(J) = 0, or the arm cannot be held in static
        equilibrium, shape (S,).
    capability_unlimited :
        Postures where no known limit bounds the capability, shape (S,).
    min_margin, min_rho, max_jump, min_capability :
        Extremes of the finite values, shape (S,); ±infinity if there are none.
    min_margin_at, min_rho_at, max_jump_at, min_capability_at :
        First posture at which each occurs, shape (S,); -1 if there is none.
    cell_postures, cell_tolerates_all :
        Postures per cell, and those that tolerate every set, shape (cells,).
    cell_tolerated :
        Postures per cell that tolerate the set, shape (cells, S).
    cell_worst_margin, cell_worst_rho :
        Histograms over [0, 1] of the smallest margin and ρ of a posture, shape (cells, 32).
    cell_min_margin :
        Smallest margin, shape (cells, S); infinite in empty cells.
    """

    bins: Bins
    workspace: Workspace
    postures: Counts
    outside: Counts
    healthy_rank: Counts
    healthy_margin: Counts
    healthy_unknown: Counts
    tolerated_sets: Counts
    verdicts: Counts
    rank_lost: Counts
    margin: Counts
    margin_unknown: Counts
    min_margin: Vector
    min_margin_at: Counts
    rho: Counts
    rho_unknown: Counts
    min_rho: Vector
    min_rho_at: Counts
    jump: Counts | None = None
    jump_unknown: Counts | None = None
    max_jump: Vector | None = None
    max_jump_at: Counts | None = None
    capability: Counts | None = None
    capability_unknown: Counts | None = None
    capability_unlimited: Counts | None = None
    min_capability: Vector | None = None
    min_capability_at: Counts | None = None
    cell_postures: Counts
    cell_tolerates_all: Counts
    cell_tolerated: Counts
    cell_worst_margin: Counts
    cell_worst_rho: Counts
    cell_min_margin: Matrix

    @classmethod
    def empty(cls, n_sets: int, bins: Bins, workspace: Workspace) -> Summary:
        """Return an empty summary.

        Parameters
        ----------
        n_sets :
            Number of fault sets.
        bins, workspace :
            Histogram bins, and workspace cells.

        Raises
        ------
        InputError
            It would exceed 1 GB; the message says what to reduce.
        """
        check_summary_size(n_sets, bins, workspace)
        shapes = summary_shapes(n_sets, bins, workspace.cells)
        made = {name: _blank(name, shape) for name, shape in shapes.items()}
        return cls(bins=bins, workspace=workspace, **made)

    @property
    def n_sets(self) -> int:
        """Number of fault sets."""
        return len(self.verdicts)

    def add(self, block: Block, start: int, *, compiled: bool = True) -> None:
        """Add a block of postures, in place.

        Parameters
        ----------
        block :
            Results for k postures and S sets, with jumps and capabilities if the bins have them.
        start :
            Index of its first posture in the whole sweep, from 0.
        compiled :
            Whether compiled kernels count, or NumPy, with the same result.

        Raises
        ------
        InputError
            The number of sets differs, jumps or capabilities are missing, or a code is invalid.
        """
        _add_block(self, block, start, compiled=compiled)

    def merge(self, other: Summary) -> None:
        """Add the postures of another summary, in place; the order of merging does not matter.

        Parameters
        ----------
        other :
            Summary of other postures, for the same fault sets.

        Raises
        ------
        InputError
            Its bins, workspace or number of sets differ.
        """
        mine = (self.bins, self.workspace, self.n_sets)
        if mine != (other.bins, other.workspace, other.n_sets):
            raise InputError(
                "summaries can be merged only if their bins, workspace and fault sets are the same"
            )
        theirs = other.arrays()
        for name, array in self.arrays().items():
            if array.dtype == np.int64 and not name.endswith("_at"):
                np.add(array, theirs[name], out=array)
            elif name == "cell_min_margin":
                np.minimum(array, theirs[name], out=array)
            elif not name.endswith("_at"):
                self.take(name, theirs[name], theirs[f"{name}_at"])

    def take(self, name: str, value: Vector, at: Counts) -> None:
        """Update an array of extremes, in place; ties go to the earlier posture.

        Parameters
        ----------
        name :
            Name of the array, e.g. ``"min_margin"``.
        value, at :
            Candidate extremes and their first postures (-1 for none), shape (S,).
        """
        held, held_at = getattr(self, name), getattr(self, f"{name}_at")
        beyond = value > held if name.startswith("max") else value < held
        better = (at >= 0) & (beyond | ((value == held) & (at < held_at)))
        held[better], held_at[better] = value[better], at[better]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name, without copying."""
        return dict(self._arrays())

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, ArrayLike], bins: Bins, workspace: Workspace
    ) -> Summary:
        """Return a summary from copies of its arrays.

        Parameters
        ----------
        arrays :
            Arrays by name, as returned by `arrays`.
        bins, workspace :
            Histogram bins, and workspace cells.

        Raises
        ------
        InputError
            An array is missing, unknown, or of the wrong shape or type.
        """
        sets = np.shape(arrays["verdicts"])[:1] if "verdicts" in arrays else ()
        if not sets:
            raise InputError("missing array 'verdicts' of shape (sets, 3)")
        made = cls.empty(sets[0], bins, workspace)
        wanted = made.arrays()
        if different := sorted(wanted.keys() ^ arrays.keys()):
            raise InputError(
                f"missing or unknown arrays: {', '.join(different)}; expected: {', '.join(wanted)}"
            )
        for name, array in wanted.items():
            given = np.asarray(arrays[name])
            if (given.shape, given.dtype) != (array.shape, array.dtype):
                raise InputError(
                    f"{name}: expected {array.dtype} of shape {array.shape}, "
                    f"got {given.dtype} of shape {given.shape}"
                )
            array[...] = given
        return made

    def _arrays(self) -> Iterator[tuple[str, NDArray[Any]]]:
        for field in fields(self):
            if isinstance(value := getattr(self, field.name), np.ndarray):
                yield field.name, value


def summary_shapes(sets: int, bins: Bins, cells: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each array of a summary, by name.

    Parameters
    ----------
    sets, bins, cells :
        Numbers of fault sets and of cells, and the bins.
    """
    shapes: dict[str, tuple[int, ...]] = {"postures": (), "outside": (), "healthy_unknown": ()}
    shapes |= {"healthy_rank": (RANKS,), "healthy_margin": (LINEAR_BINS,)}
    shapes |= {"tolerated_sets": (sets + 1,), "verdicts": (sets, _VERDICTS)}
    shapes |= {"rank_lost": (sets, RANKS)}
    shapes |= _measure("margin", "min_margin", sets, LINEAR_BINS)
    shapes |= _measure("rho", "min_rho", sets, LINEAR_BINS)
    if bins.jump is not None:
        shapes |= _measure("jump", "max_jump", sets, len(bins.jump))
    if bins.capability is not None:
        shapes |= _measure("capability", "min_capability", sets, len(bins.capability) + 1)
        shapes["capability_unlimited"] = (sets,)
    shapes |= {f"cell_{name}": (cells,) for name in ("postures", "tolerates_all")}
    shapes |= {f"cell_{name}": (cells, sets) for name in ("tolerated", "min_margin")}
    shapes |= {f"cell_worst_{name}": (cells, CELL_BINS) for name in ("margin", "rho")}
    return shapes


def _measure(name: str, extreme: str, sets: int, bins: int) -> dict[str, tuple[int, ...]]:
    each = (sets,)
    return {name: (sets, bins), f"{name}_unknown": each, extreme: each, f"{extreme}_at": each}


def _blank(name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    if name.endswith("_at"):
        return np.full(shape, -1, np.int64)
    if name.startswith(("min", "cell_min")):
        return np.full(shape, math.inf)
    return np.full(shape, -math.inf) if name.startswith("max") else np.zeros(shape, np.int64)


def check_summary_size(sets: int, bins: Bins, workspace: Workspace) -> None:
    """Check that a summary fits in 1 GB.

    Parameters
    ----------
    sets, bins, workspace :
        Number of fault sets, the bins and the cells.

    Raises
    ------
    InputError
        It does not; the message says what to reduce.
    """
    shapes = summary_shapes(sets, bins, workspace.cells)
    size = 8 * sum(math.prod(shape) for shape in shapes.values())
    if size <= _MAX_BYTES:
        return
    of_cells = 8 * sum(math.prod(shape) for name, shape in shapes.items() if "cell" in name)
    advice = f"the number of fault sets ({sets})"
    if of_cells > size // 2:
        advice = f"the number of cells ({workspace.cells}), with an edge above {workspace.edge:g} m"
    raise InputError(
        f"the summary would need {size / 1e9:.3g} GB, above the maximum of 1 GB; reduce {advice}"
    )
