"""Regression splines for recorded motions: what their noise leaves of positions and derivatives.

A recording is rounded and noisy, and an interpolating spline differentiated twice amplifies that by
the square of the sampling rate. Here a quintic spline with few knots is fitted by least squares
instead. The spacing of its knots is chosen for each column by generalised cross-validation (Craven
& Wahba 1978), with the number of coefficients counted twice, which guards against noise that is not
white (Kim & Gu 2004). Where the finest spacing predicts best, no noise can be told from the motion,
and the samples are interpolated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Matrix, Vector

_DEGREE = 5
_FINEST = 3.0  # samples between knots
_RATIO = 2.0**0.5  # of one candidate spacing to the next
_COUNTED = 2.0  # times that a coefficient counts
_PIECE, _PIECES = 2048, 8  # samples on which the spacing of a long recording is chosen
_EDGE = 1.5  # of the spacing, at both ends: the second derivative is noisiest there
_SEED = 1


class Noise(NamedTuple):
    """What generalised cross-validation finds in samples, per column, shape (n,).

    Attributes
    ----------
    spacing :
        Best spacing of the knots, in units of time; 0 where interpolation is best.
    level :
        Standard deviation of the noise; 0 where none can be told from the motion.
    """

    spacing: Vector
    level: Vector


class Spline:
    """Splines of n columns over time, each with its own knots.

    Parameters
    ----------
    t :
        Times, increasing, shape (N,), N ≥ 4.
    x :
        Samples, shape (N, n).
    spacing :
        Spacing of the knots for each column, shape (n,); 0 interpolates by a cubic spline.

    Attributes
    ----------
    residual :
        Root mean square of the residuals, shape (n,).
    """

    def __init__(self, t: Vector, x: Matrix, spacing: Vector) -> None:
        self._n, self._parts = x.shape[1], []
        self.residual = np.zeros(self._n)
        for step in np.unique(spacing).tolist():
            group = np.flatnonzero(spacing == step)
            spline, rest = _fit(t, x[:, group], step)
            self._parts.append((group, spline))
            self.residual[group] = np.sqrt(rest / len(t))

    def __call__(self, t: Vector | float, derivative: int = 0) -> Any:
        """Return values or derivatives at times of any shape, shape (…, n)."""
        found = np.empty((*np.shape(t), self._n))
        for group, spline in self._parts:
            found[..., group] = spline(t, derivative)
        return found


def noise_of(t: Vector, x: Matrix) -> Noise:
    """Return the noise of samples and the spacing of knots that suits it.

    Long recordings are judged by eight pieces of 2048 samples.

    Parameters
    ----------
    t :
        Times, increasing, shape (N,), N ≥ 4.
    x :
        Samples, shape (N, n).
    """
    pieces = list(_pieces(t, x))
    count = sum(len(piece) for piece, _ in pieces)
    step = (t[-1] - t[0]) / (len(t) - 1)
    best, level = np.full(x.shape[1], np.inf), np.zeros(x.shape[1])
    spacing, width, finest = np.zeros(x.shape[1]), _FINEST * step, 0.0
    rounding = count * (4e-16 * np.maximum(x.max(axis=0), -x.min(axis=0))) ** 2
    while True:
        fits = [(_knots(piece, width), piece, samples) for piece, samples in pieces]
        used = sum(len(knots) - _DEGREE - 1 for knots, _, _ in fits)
        if _COUNTED * used < count:
            finest = finest or width
            rest = sum(_fitted(*fit)[1] for fit in fits)
            score = rest / (1.0 - _COUNTED * used / count) ** 2
            # Scores within rounding error are equal; then the smoother spline is as good.
            better = score <= best * (1.0 + 1e-9) + rounding
            spacing[better], best = width, np.minimum(score, best)
            level[better] = np.sqrt(rest / (count - used))[better]
            if (score > 100.0 * best).all():
                break
        if all(len(knots) <= 2 * _DEGREE + 2 for knots, _, _ in fits):
            break
        width *= _RATIO
    exact = spacing <= finest
    return Noise(np.where(exact, 0.0, spacing), np.where(exact, 0.0, level))


def gain_of(t: Vector, spacing: Vector, derivative: int) -> Vector:
    """Return the standard deviation of a derivative for noise of unit size, shape (n,).

    It is that of the splines through white noise (fixed seed) at the same times.

    Parameters
    ----------
    t :
        Times, shape (N,).
    spacing :
        Spacing of the knots for each column, shape (n,).
    derivative :
        1 or 2.
    """
    t = t[: _PIECE * _PIECES]
    e = np.random.default_rng(_SEED).standard_normal((len(t), 1))
    gains = {s: float(np.std(_fit(t, e, s)[0](t, derivative))) for s in np.unique(spacing).tolist()}
    return np.array([gains[s] for s in spacing.tolist()])


def suffices(t: Vector, spacing: float) -> bool:
    """Return whether there are enough samples for knots of a spacing, both in units of time."""
    return len(_knots(t, spacing)) - _DEGREE - 1 <= len(t)


def _pieces(t: Vector, x: Matrix) -> Iterator[tuple[Vector, Matrix]]:
    if len(t) <= _PIECE * _PIECES:
        yield t, x
        return
    for start in np.linspace(0, len(t) - _PIECE, _PIECES).astype(int).tolist():
        yield t[start : start + _PIECE], x[start : start + _PIECE]


def _knots(t: Vector, spacing: float) -> Vector:
    """Return knots that are as dense as the samples, spaced by about the given time."""
    intervals = max(round(float((t[-1] - t[0]) / spacing)), 1)
    widths = np.ones(intervals)
    widths[[0, -1]] = _EDGE
    places = np.concatenate([[0.0], np.cumsum(widths) / widths.sum()]) * (len(t) - 1)
    inner = np.interp(places, np.arange(len(t)), t)
    return np.concatenate([[t[0]] * _DEGREE, inner, [t[-1]] * _DEGREE])


def _fit(t: Vector, x: Matrix, spacing: float) -> tuple[Any, Vector]:
    """Return the spline of one spacing, and the sum of squares of the residuals, shape (n,)."""
    from scipy.interpolate import make_interp_spline

    if spacing == 0.0:
        return make_interp_spline(t, x, 3), np.zeros(x.shape[1])
    return _fitted(_knots(t, spacing), t, x)


def _fitted(knots: Vector, t: Vector, x: Matrix) -> tuple[Any, Vector]:
    """Return the least-squares spline, by banded normal equations, and its sums of squares.

    SciPy's `make_lsq_spline` takes minutes for 10⁵ knots.
    """
    from scipy.interpolate import BSpline
    from scipy.linalg import solveh_banded

    # All times lie between the knots; without `extrapolate` SciPy checks them one by one.
    B = BSpline.design_matrix(t, knots, _DEGREE, extrapolate=True)
    G = B.T @ B
    bands = np.zeros((_DEGREE + 1, G.shape[0]))
    for i in range(_DEGREE + 1):
        bands[_DEGREE - i, i:] = G.diagonal(i)
    c = solveh_banded(bands, B.T @ x)
    return BSpline(knots, c, _DEGREE), ((B @ c - x) ** 2).sum(axis=0)
