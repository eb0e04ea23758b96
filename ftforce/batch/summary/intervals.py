"""Shares and quantiles estimated from counts, with confidence intervals.

The intervals are valid for independently drawn postures. For a Sobol sequence they are
conservative; for a grid or a recorded motion they only indicate the effect of the sample size.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ftforce.core.arrays import Vector

    Values = NDArray[np.float64]
    Counts = NDArray[np.int64]


def wilson(
    successes: ArrayLike, trials: ArrayLike, confidence: float = 0.95
) -> tuple[Values, Values]:
    """Return the ends of the Wilson score interval of a share; NaN without trials.

    E. B. Wilson, J. Amer. Statist. Assoc. 22 (1927) 209-212.

    Parameters
    ----------
    successes, trials :
        Counts, of shapes that broadcast.
    confidence :
        Confidence level, between 0 and 1.

    Raises
    ------
    InputError
        The confidence is not between 0 and 1.
    """
    from scipy.special import ndtri

    _check_confidence(confidence)
    x, n = np.broadcast_arrays(
        np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    )
    z = float(ndtri(0.5 + 0.5 * confidence))
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = (x + 0.5 * z * z) / (n + z * z)
        half = z / (n + z * z) * np.sqrt(x * ((n - x) / n) + 0.25 * z * z)
    none, every = x == 0.0, x == n  # where the formula gives 0 and 1 only up to rounding
    low = np.where(none, 0.0, np.maximum(centre - half, 0.0))
    high = np.where(every, 1.0, np.minimum(centre + half, 1.0))
    unknown = n == 0.0
    return np.where(unknown, math.nan, low), np.where(unknown, math.nan, high)


def quantile(histogram: Counts, edges: Vector, p: float) -> Values:
    """Return quantiles of binned samples, accurate to one bin; NaN for an empty histogram.

    The samples of a bin are assumed to be evenly spaced, and interpolated as `numpy.quantile`
    does: R. J. Hyndman and Y. Fan, Amer. Statist. 50 (1996) 361-365, definition 7.

    Parameters
    ----------
    histogram :
        Counts, shape (..., b). With one bin more than between the edges, the last is an overflow
        bin (infinity); with two more, the first is an underflow bin as well (0).
    edges :
        Bin edges, increasing, shape (b + 1,), (b,) or (b - 1,).
    p :
        Probability, from 0 to 1.

    Raises
    ------
    InputError
        ``p`` is not within 0 to 1, or the number of edges does not match the bins.
    """
    _check_share(p)
    lower, upper = _borders(histogram.shape[-1], edges)
    sums = np.cumsum(histogram, axis=-1)
    total = sums[..., -1]
    place = np.maximum(total - 1, 0) * p
    first = np.floor(place).astype(np.int64)
    last = np.minimum(first + 1, np.maximum(total - 1, 0))
    a, b = (_ordered(histogram, sums, rank, lower, upper) for rank in (first, last))
    part = place - first
    with np.errstate(invalid="ignore"):
        value = np.where((part == 0.0) | (a == b), a, a + part * (b - a))
    return np.where(total > 0, value, math.nan)


def quantile_interval(
    histogram: Counts, edges: Vector, p: float, confidence: float = 0.95, repeats: int = 1
) -> tuple[float, float]:
    """Return a distribution-free confidence interval of a quantile; NaN for an empty histogram.

    The number of samples below the quantile is binomial, so two order statistics enclose it:
    H. A. David and H. N. Nagaraja, Order Statistics, 3rd ed. (2003), section 7.1. The outer edges
    of their bins are returned, or the end of the scale where there are too few samples beyond.

    Parameters
    ----------
    histogram, edges, p :
        See `quantile`; the histogram has shape (b,).
    confidence :
        Confidence level, between 0 and 1.
    repeats :
        Number of samples counted per posture, which are not independent.

    Raises
    ------
    InputError
        ``p`` or the confidence is out of range, or the number of edges does not match the bins.
    """
    _check_share(p)
    _check_confidence(confidence)
    lower, upper = _borders(len(histogram), edges)
    n = int(histogram.sum()) // repeats
    if not n:
        return math.nan, math.nan
    below, above = _ranks(n, p, confidence)
    sums = np.cumsum(histogram)
    low, high = float(lower[0]), float(upper[-1])
    if below >= 1:  # the below-th smallest, counted from 1
        low = float(lower[np.searchsorted(sums, (below - 1) * repeats, side="right")])
    if above <= n:
        high = float(upper[np.searchsorted(sums, above * repeats - 1, side="right")])
    return low, high


def _ranks(n: int, p: float, confidence: float) -> tuple[int, int]:
    """Return the ranks, from 1, that enclose the quantile; 0 or n + 1 where there is none."""
    from scipy.special import bdtrik

    if p in {0.0, 1.0}:  # the ends of the distribution, which enclose all samples
        return (0, 1) if p == 0.0 else (n, n + 1)
    tail = 0.5 * (1.0 - confidence)
    return math.ceil(bdtrik(tail, n, p)), math.ceil(bdtrik(1.0 - tail, n, p)) + 1


def _borders(bins: int, edges: Vector) -> tuple[Vector, Vector]:
    """Return the edges of every bin: 0 to 0 for underflow, up to infinity for overflow."""
    extra = bins - (len(edges) - 1)
    if extra not in {0, 1, 2}:
        raise InputError(
            f"{len(edges)} edges make {len(edges) - 1} bins, optionally with an overflow bin, or "
            f"an underflow and an overflow bin; got {bins} bins"
        )
    below, above = [0.0] * (extra == 2), [math.inf] * (extra > 0)
    lower = np.concatenate((below, edges[:-1], edges[-1:] if extra else []))
    return lower, np.concatenate((below, edges[1:], above))


def _ordered(histogram: Counts, sums: Counts, rank: Counts, lower: Vector, upper: Vector) -> Values:
    """Return the samples of these ranks, from 0, assuming even spacing within a bin."""
    bin_of = np.argmax(sums > rank[..., None], axis=-1)
    count = np.take_along_axis(histogram, bin_of[..., None], -1)[..., 0]
    before = np.take_along_axis(sums, bin_of[..., None], -1)[..., 0] - count
    part = (rank - before + 0.5) / np.maximum(count, 1)
    low, high = lower[bin_of], upper[bin_of]
    with np.errstate(invalid="ignore"):  # the overflow bin ends at infinity
        return np.where(np.isinf(high), math.inf, low + part * (high - low))


def _check_share(p: float) -> None:
    if not 0.0 <= p <= 1.0:
        raise InputError(f"the probability of a quantile must be from 0 to 1, got {p!r}")


def _check_confidence(confidence: float) -> None:
    if not 0.0 < confidence < 1.0:
        raise InputError(
            f"the confidence level must be between 0 and 1, e.g. 0.95, got {confidence!r}"
        )
