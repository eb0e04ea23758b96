"""Splines through recorded motions: what their noise leaves of positions and derivatives.

A recording is rounded and noisy, and an interpolating spline differentiated twice amplifies that by
the square of the sampling rate. Here a quintic spline is fitted instead, whose coefficients are
a sample of a smooth stationary process: Gaussian, with a squared-exponential covariance that is
`_REACH` knots long (Rasmussen & Williams 2006, §4.2; P-splines, Eilers & Marx 1996, with this
process in place of differences). Beyond the ends the process goes on, so there are no artificial
end conditions: neither do accelerations vanish there, nor is anything allowed that the motion
inside would make unlikely. The spacing of the knots, the size of the process and that of the noise
are, for each column, those that make the samples most likely. Knots are no closer than an arm can
follow: quicker changes are those of clocks and of packets that came late. Where the noise is next
to none, or knots two samples apart are the most likely ones, so that no noise can be told from the
motion, the samples are interpolated.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ftforce.core.arrays import Matrix, Vector

_DEGREE = 5
_ORDER = 8  # coefficients that determine the next, apart from its innovation
_REACH = 3.0  # knots: standard deviation of the covariance of coefficients
_FINEST = 2.0  # samples between knots
_QUICKEST = 0.04  # s between knots: the joints of an arm follow no more than about 8 Hz
_STEP = 2.0**0.5  # of one candidate spacing to the next
_RATIOS = 10.0 ** np.arange(3.0, -19.0, -1.0)  # noise variance over that of the process
_HOPELESS = 60.0  # more in -2 log likelihood than the best
_EXACT = 1e-9  # of the motion: smaller noise is not told from rounding
_SLIGHT = 1e-3  # of the accelerations: noise that interpolation leaves in them and that is let be
_PIECE, _PIECES = 2048, 4  # samples on which a long recording is judged
_SEED = 1


class Noise(NamedTuple):
    """What is found in samples, per column, shape (n,).

    Attributes
    ----------
    spacing :
        Most likely spacing of the knots, in units of time; 0 where samples are interpolated.
    ratio :
        Variance of the noise over that of the spline's coefficients.
    level :
        Standard deviation of the noise; 0 where none can be told from the motion.
    """

    spacing: Vector
    ratio: Vector
    level: Vector


class Spline:
    """Splines of n columns over time, each with its own knots.

    Parameters
    ----------
    t :
        Times, increasing, shape (N,), N ≥ 4.
    x :
        Samples, shape (N, n).
    spacing, ratio :
        For each column, as in `Noise`, shape (n,); a spacing of 0 interpolates by a cubic spline.
    """

    def __init__(self, t: Vector, x: Matrix, spacing: Vector, ratio: Vector) -> None:
        self._n = x.shape[1]
        groups = [(np.flatnonzero(spacing == one), one) for one in np.unique(spacing).tolist()]
        self._parts = [
            (group, _fit(t, x[:, group], one, ratio[group].tolist())) for group, one in groups
        ]

    def __call__(self, t: Vector | float, derivative: int = 0) -> Any:
        """Return values or derivatives at times of any shape, shape (…, n)."""
        found = np.empty((*np.shape(t), self._n))
        for group, spline in self._parts:
            found[..., group] = spline(t, derivative)
        return found


class _Problem:
    """Least squares with a prior, on one piece of a recording.

    Parameters
    ----------
    t :
        Times, shape (N,).
    spacing :
        Spacing of the knots.
    """

    def __init__(self, t: Vector, spacing: float) -> None:
        from scipy.interpolate import BSpline

        self.knots = _knots(t, spacing)
        self.B = BSpline.design_matrix(t, self.knots, _DEGREE)
        self.count = self.B.shape[1]
        G = self.B.T @ self.B
        self.G = np.zeros((_ORDER + 1, self.count))
        for i in range(min(_DEGREE, self.count - 1) + 1):
            self.G[_ORDER - i, i:] = G.diagonal(i)
        self.Q, self.log_det = _prior(self.count)

    def factor(self, ratio: float) -> Matrix:
        """Return the banded Cholesky factor of BᵀB + ratio·Q.

        Raises
        ------
        LinAlgError
            The ratio is too small for the gaps between samples.
        """
        from scipy.linalg import cholesky_banded

        return np.asarray(cholesky_banded(self.G + ratio * self.Q))

    def fit(self, factor: Matrix, x: Matrix) -> Matrix:
        """Return the coefficients for samples, shape (coefficients, n) or (coefficients,)."""
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((factor, False), self.B.T @ x))

    def misfit(self, factor: Matrix, x: Matrix, ratio: float) -> Vector:
        """Return ‖x − Bc‖² + ratio cᵀQc at the minimum, shape (n,)."""
        c = self.fit(factor, x)
        rest = ((x - self.B @ c) ** 2).sum(axis=0)
        for i in range(min(_ORDER + 1, self.count)):
            twice = 2.0 if i else 1.0
            rest += ratio * twice * (self.Q[_ORDER - i, i:] @ (c[i:] * c[: self.count - i]))
        return np.asarray(rest)


def noise_of(t: Vector, x: Matrix, spacing: float | None = None) -> Noise:
    """Return the noise of samples and the spline that suits it.

    Long recordings are judged by four pieces of 2048 samples.

    Parameters
    ----------
    t :
        Times, increasing, shape (N,), N ≥ 4.
    x :
        Samples, shape (N, n).
    spacing :
        Spacing of the knots that was asked for; by default the most likely one.
    """
    places = _pieces(len(t))
    count = sum(len(t[place]) for place in places)
    y, n = x - x.mean(axis=0), x.shape[1]
    rounding = count * (4e-16 * np.abs(x).max(axis=0)) ** 2 + 1e-300
    best, level = np.full(n, np.inf), np.zeros(n)
    found = np.zeros((2, n))
    for width in _widths(t) if spacing is None else (spacing,):
        problems = [_Problem(t[place], width) for place in places]
        used = sum(problem.count for problem in problems)
        fixed = used * np.log(_RATIOS) + sum(problem.log_det for problem in problems)
        scores, rests = np.full((2, len(_RATIOS), n), np.inf)
        for i, ratio in enumerate(_RATIOS.tolist()):
            try:
                factors = [problem.factor(ratio) for problem in problems]
            except np.linalg.LinAlgError:
                break
            parts = zip(problems, factors, places, strict=True)
            rests[i] = sum(p.misfit(f, y[place], ratio) for p, f, place in parts) + rounding
            # -2 log likelihood of the samples; the size of the process is the most likely one.
            det = 2.0 * sum(np.log(factor[-1]).sum() for factor in factors)
            scores[i] = count * np.log(rests[i]) + det - fixed[i]
        at = scores.argmin(axis=0)
        score, rest = (np.take_along_axis(z, at[None], axis=0)[0] for z in (scores, rests))
        better = score < best
        best[better], level[better] = score[better], np.sqrt(rest / count)[better]
        found[:, better] = np.stack([np.full(n, width), _vertex(scores, at)])[:, better]
        if not better.any() and (score > best + _HOPELESS).all():
            break
    exact = level <= _EXACT * np.abs(y).max(axis=0) + 1e-15 * np.abs(x).max(axis=0)
    if spacing is None:
        samples = found[0] * (len(t) - 1) / (t[-1] - t[0])  # from one knot to the next
        # Interpolation makes noise of about 3 level/step²; accelerations are about size/reach².
        exact |= 3.0 * np.sqrt(found[1]) * (_REACH * samples) ** 2 <= _SLIGHT
        exact |= samples <= _FINEST * (1.0 + 1e-9)
        found[:, exact] = 0.0
    return Noise(found[0], found[1], np.where(exact, 0.0, level))


def uncertainty_of(t: Vector, noise: Noise, derivative: int) -> Matrix:
    """Return the standard deviation of a derivative of the spline, in the middle and at the ends.

    For a spline with a prior it is that of its posterior distribution. For samples that are
    interpolated, it is that of the splines through white noise (fixed seed) at the same times.

    Parameters
    ----------
    t :
        Times, shape (N,).
    noise :
        As found by `noise_of`.
    derivative :
        1 or 2.

    Returns
    -------
    :
        Shape (2, n): in the middle, and at the worse of the two ends.
    """
    t = t[: _PIECE * _PIECES]
    gains = [_gain(t, *pair, derivative) for pair in zip(*noise[:2], strict=True)]
    return np.array(gains).T * noise.level


def suffices(t: Vector, spacing: float) -> bool:
    """Return whether there are enough samples for knots of a spacing, both in units of time."""
    return len(_knots(t, spacing)) - _DEGREE - 1 <= len(t)


def _gain(t: Vector, spacing: float, ratio: float, derivative: int) -> tuple[float, float]:
    """Return what `uncertainty_of` returns for noise of unit size."""
    from scipy.interpolate import BSpline

    if spacing == 0.0:
        e = np.random.default_rng(_SEED).standard_normal((len(t), 1))
        made = float(np.std(_fit(t, e, 0.0, [])(t, derivative)))
        return made, made
    problem = _Problem(t, spacing)
    factor = _factor(problem, ratio)
    at = np.array([0.5 * (t[0] + t[-1]), t[0], t[-1]])
    basis = BSpline(problem.knots, np.eye(problem.count), _DEGREE)(at, derivative)
    from scipy.linalg import cho_solve_banded

    variance = (basis.T * cho_solve_banded((factor, False), basis.T)).sum(axis=0)
    middle, *ends = np.sqrt(variance).tolist()
    return middle, max(ends)


def _widths(t: Vector) -> Iterator[float]:
    """Yield the candidates for the spacing of knots."""
    width = max(_FINEST * (t[-1] - t[0]) / (len(t) - 1), _QUICKEST)
    while width < _STEP * (t[-1] - t[0]):
        yield float(width)
        width *= _STEP


def _vertex(scores: Matrix, at: Any) -> Vector:
    """Return the most likely ratio between those tried, by a parabola, shape (n,)."""
    inner = np.clip(at, 1, len(scores) - 2)
    low, middle, high = (np.take_along_axis(scores, (inner + i)[None], 0)[0] for i in (-1, 0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        off = 0.5 * (low - high) / (low - 2.0 * middle + high)
    off = np.where((inner == at) & np.isfinite(off), np.clip(off, -0.5, 0.5), 0.0)
    return np.asarray(_RATIOS[at] * 10.0**-off)


def _pieces(count: int) -> list[slice]:
    if count <= _PIECE * _PIECES:
        return [slice(None)]
    starts = np.linspace(0, count - _PIECE, _PIECES).astype(int).tolist()
    return [slice(start, start + _PIECE) for start in starts]


def _knots(t: Vector, spacing: float) -> Vector:
    """Return knots that are as dense as the samples, spaced by about the given time."""
    intervals = max(round(float((t[-1] - t[0]) / spacing)), 1)
    inner = np.interp(np.linspace(0.0, len(t) - 1, intervals + 1), np.arange(len(t)), t)
    beyond = np.arange(1, _DEGREE + 1)
    before = inner[0] - beyond[::-1] * (inner[1] - inner[0])
    return np.concatenate([before, inner, inner[-1] + beyond * (inner[-1] - inner[-2])])


@lru_cache(1)
def _predictors() -> tuple[Matrix, Vector]:
    """Return rows that take c_k, c_k-1, … to the error of predicting c_k, and its variances."""
    from scipy.linalg import toeplitz

    covariance = np.exp(-0.5 * (np.arange(_ORDER + 1) / _REACH) ** 2)
    rows, variances = np.eye(1, _ORDER + 1).repeat(_ORDER + 1, axis=0), np.ones(_ORDER + 1)
    for k in range(1, _ORDER + 1):  # Yule–Walker equations
        weights = np.linalg.solve(toeplitz(covariance[:k]), covariance[1 : k + 1])
        rows[k, 1 : k + 1] = -weights
        variances[k] = 1.0 - weights @ covariance[1 : k + 1]
    return rows, variances


def _prior(count: int) -> tuple[Matrix, float]:
    """Return the precision of coefficients, as the upper bands, and the log of its determinant.

    It is that of an autoregressive process, hence banded, whose covariances up to `_ORDER` knots
    apart are exactly the squared-exponential ones.
    """
    rows, variances = _predictors()
    Q, first = np.zeros((_ORDER + 1, count)), min(_ORDER, count)
    for k in range(first):
        for i in range(k + 1):
            for j in range(i, k + 1):
                Q[_ORDER - (j - i), k - i] += rows[k, i] * rows[k, j] / variances[k]
    for i in range(_ORDER + 1):
        for j in range(i, _ORDER + 1):
            Q[_ORDER - (j - i), first - i : count - i] += rows[-1, i] * rows[-1, j] / variances[-1]
    steady = (count - first) * float(np.log(variances[-1]))
    return Q, -float(np.log(variances[:first]).sum()) - steady


def _factor(problem: _Problem, ratio: float) -> Matrix:
    """Return the factor for a ratio, or for the next larger one that samples allow."""
    while True:
        try:
            return problem.factor(ratio)
        except np.linalg.LinAlgError:
            ratio = max(10.0 * ratio, float(_RATIOS[-1]))


def _fit(t: Vector, x: Matrix, spacing: float, ratios: Sequence[float]) -> Any:
    """Return the splines of columns with the same knots, each column with its own ratio."""
    from scipy.interpolate import BSpline, make_interp_spline

    if spacing == 0.0:
        return make_interp_spline(t, x, 3)
    problem, mean = _Problem(t, spacing), x.mean(axis=0)
    factors = (_factor(problem, ratio) for ratio in ratios)
    columns = [problem.fit(*pair) for pair in zip(factors, (x - mean).T, strict=True)]
    c = np.column_stack(columns) + mean  # B-splines add up to 1
    return BSpline(problem.knots, c, _DEGREE)
