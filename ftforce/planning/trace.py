"""One-dimensional self-motion, traced by a predictor and a corrector (Allgower & Georg 1990)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.planning.target import residual_and_jacobian, residuals_and_jacobians

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.target import TipTarget
    from ftforce.robot.robot import Robot

RANK_RTOL = 1e-6
_CORRECTED = 1e-12  # residual, m and rad, at which a sample is on the manifold
_ROUGH = 1e-10  # what rounding may leave of it
_CORRECTIONS = 6
_SHORTEST = 1e-6  # rad or m; a step that fails at this length ends the trace
_TURN = 0.95  # cosine of the angle between the tangents at both ends of a step, at least
_SLIP = 0.1  # correction, of the step, at most
_DAMPING = 1e-14  # of the trace of J Jᵀ
_MOST = 20_000  # samples of a trace
CLOSED, AT_LIMIT, STOPPED = "closed", "at limit", "stopped"  # how a trace ends
_SIGN = 1e-6  # a tangent's component below this has no sign


@dataclass(frozen=True, eq=False)
class Manifold:
    """The equations of a self-motion, within limits.

    Attributes
    ----------
    robot, target :
        The arm, and what of its tip is kept.
    lower, upper :
        Position limits, rad or m, shape (n,).
    wide :
        Joints that reach the same place a turn apart, shape (n,).
    rank :
        Rank of the Jacobian of the kept rows, away from singular postures.
    """

    robot: Robot
    target: TipTarget
    lower: Vector
    upper: Vector
    wide: Mask
    rank: int

    @cached_property
    def moving(self) -> Mask:
        """Joints whose limits leave them room, shape (n,)."""
        return self.upper > self.lower

    @property
    def dimension(self) -> int:
        """Dimension of the self-motion."""
        return int(self.moving.sum()) - self.rank

    @cached_property
    def endless(self) -> Mask:
        """Joints without limits, which return to the same position after a turn, shape (n,)."""
        return self.wide & ~np.isfinite(self.lower) & ~np.isfinite(self.upper)

    def equations(self, q: Vector) -> tuple[Vector, Matrix]:
        """Return residual and derivative, without the columns of joints that are held.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        r, J = residual_and_jacobian(self.robot, q, self.target)
        return r, np.where(self.moving, J, 0.0)

    def corrected(self, q: Vector, joint: int | None = None) -> Vector | None:
        """Return the posture moved onto the manifold, ``None`` if that fails.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        joint :
            A joint that keeps its position.
        """
        for _ in range(_CORRECTIONS):
            r, J = self.equations(q)
            if (size := np.abs(r).max()) <= _CORRECTED:
                return q
            if joint is not None:
                J[:, joint] = 0.0
            G = J @ J.T
            G.flat[:: len(G) + 1] += _DAMPING * G.trace() + 1e-300
            q = q - np.linalg.solve(G, r) @ J
        size = np.abs(self.equations(q)[0]).max()
        return q if size <= _ROUGH else None

    def null_space(self, q: Vector) -> Matrix:
        """Return an orthonormal basis of the self-motion's tangents, shape (dimension, n).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        J = self.equations(q)[1][:, self.moving]
        found = np.zeros((J.shape[1] - self.rank, self.robot.n))
        found[:, self.moving] = np.linalg.svd(J)[2][self.rank :]
        return found

    def null_spaces(self, q: Matrix) -> Matrix:
        """Return `null_space` of N postures, shape (N, dimension, n).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (N, n).
        """
        J = residuals_and_jacobians(self.robot, q, self.target)[1][:, :, self.moving]
        found = np.zeros((len(q), J.shape[2] - self.rank, self.robot.n))
        found[:, :, self.moving] = np.linalg.svd(J)[2][:, self.rank :]
        return found

    def is_within(self, q: Vector) -> bool:
        """Return whether a posture is within the limits.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        """
        return bool(((q >= self.lower) & (q <= self.upper)).all())

    def between(self, a: Matrix, b: Matrix, turns: Mask) -> Matrix:
        """Return a - b, for some joints up to whole turns.

        Parameters
        ----------
        a, b :
            Joint positions, rad or m, shape (..., n).
        turns :
            Those joints, shape (n,).
        """
        apart = a - b
        apart[..., turns] -= 2.0 * np.pi * np.round(apart[..., turns] / (2.0 * np.pi))
        return apart


class Trace(NamedTuple):
    """A traced curve.

    Attributes
    ----------
    q :
        Samples in order, rad or m, shape (N, n).
    closed :
        Whether it is a loop.
    complete :
        Whether both ends, if there are any, are at limits.
    """

    q: Matrix
    closed: bool
    complete: bool


def trace(manifold: Manifold, q: Vector, step: float) -> Trace:
    """Return the whole curve through a posture, up to the limits or back to the posture.

    Parameters
    ----------
    manifold :
        A self-motion of dimension 1.
    q :
        A posture on it, rad or m, shape (n,).
    step :
        Longest distance between samples in joint space, rad or m.
    """
    t = manifold.null_space(q)[0]
    ahead, end = _march(manifold, q, t, step)
    ends = {end}
    if end != CLOSED:
        behind, end = _march(manifold, q, -t, step)
        ahead = behind[:0:-1] + ahead
        ends.add(end)
    closed = ends == {CLOSED}
    whole = _with_extremes(manifold, np.array(ahead), closed)
    return Trace(whole, closed, STOPPED not in ends)


def _march(manifold: Manifold, q: Vector, t: Vector, step: float) -> tuple[list[Vector], str]:
    """Return the samples in one direction, and how they end."""
    start, first, found, h = q, t, [q], step
    travelled = 0.0
    while len(found) < _MOST:
        advanced = _advance(manifold, q, t, h, step)
        if advanced is None:
            break
        new, t_new, h = advanced
        if travelled > step and t_new @ first > _TURN and _passes(manifold, q, new, start):
            return found, CLOSED
        if not manifold.is_within(new):
            end = _end(manifold, q, new)
            return (found if end is None else [*found, end]), AT_LIMIT
        travelled += float(np.linalg.norm(new - q))
        found.append(new)
        q, t = new, t_new
    return found, STOPPED


def _advance(
    manifold: Manifold, q: Vector, t: Vector, h: float, step: float
) -> tuple[Vector, Vector, float] | None:
    """Return the next sample, its tangent and the next step length, ``None`` if there is none."""
    while h >= _SHORTEST:
        predicted = q + h * t
        new = manifold.corrected(predicted)
        if new is not None and np.linalg.norm(new - predicted) <= _SLIP * h:
            N = manifold.null_space(new)
            along = (N @ t) @ N
            size = float(np.linalg.norm(along))
            if size >= _TURN:
                return new, along / size, min(step, 1.5 * h)
        h *= 0.5
    return None


def _passes(manifold: Manifold, q: Vector, new: Vector, start: Vector) -> bool:
    """Return whether the start lies between two samples, whole turns of endless joints apart."""
    to_start = manifold.between(start, q, manifold.endless)
    chord = new - q
    length = float(np.linalg.norm(chord))
    along = float(to_start @ chord) / length
    off = np.linalg.norm(to_start - along * chord / length)
    return bool(-1e-9 <= along <= length + 1e-9 and off <= _SLIP * length)


def _end(manifold: Manifold, q: Vector, new: Vector) -> Vector | None:
    """Return where the curve from q to a posture beyond the limits leaves them."""
    lower, upper = manifold.lower, manifold.upper
    for _ in range(len(q)):
        bound = np.clip(new, lower, upper)
        beyond = np.flatnonzero(new != bound)
        if not len(beyond):
            break
        shares = (bound[beyond] - q[beyond]) / (new[beyond] - q[beyond])
        first = int(shares.argmin())
        joint = int(beyond[first])
        guess = q + shares[first] * (new - q)
        guess[joint] = bound[joint]
        found = manifold.corrected(guess, joint)
        if found is None:
            return None
        new = found
    if not manifold.is_within(new) or np.linalg.norm(new - q) <= 1e-12:
        return None
    return new


def _with_extremes(manifold: Manifold, q: Matrix, closed: bool) -> Matrix:
    """Return the samples with those added at which a joint turns round, so that ranges are exact.

    Between two samples in which dq_i/ds has opposite signs, its zero is found by regula falsi.
    """
    if len(q) < 3:
        return q
    after = np.concatenate([q[1:], q[:1]]) if closed else q[1:]
    before = q if closed else q[:-1]
    chord = after - before
    chord = manifold.between(after, before, manifold.endless) if closed else chord
    t = manifold.null_spaces(q)[:, 0]
    t0 = t if closed else t[:-1]
    t1 = np.concatenate([t[1:], t[:1]]) if closed else t[1:]
    t0 = t0 * np.sign((t0 * chord).sum(axis=1))[:, None]
    t1 = t1 * np.sign((t1 * chord).sum(axis=1))[:, None]
    turns = (t0 * t1 < 0.0) & (np.minimum(np.abs(t0), np.abs(t1)) > _SIGN)
    at, joint = np.nonzero(turns)
    if not len(at):
        return q
    f = t0[at, joint], t1[at, joint]
    share, new = _zeros(manifold, before[at], chord[at], joint, f)
    fits = ((new >= manifold.lower) & (new <= manifold.upper)).all(axis=1)
    order = np.concatenate([np.arange(len(q), dtype=np.float64), at[fits] + share[fits]])
    whole: Matrix = np.concatenate([q, new[fits]])[np.argsort(order, kind="stable")]
    return whole


def _zeros(
    manifold: Manifold, q: Matrix, chord: Matrix, joint: NDArray[np.intp], f: tuple[Vector, Vector]
) -> tuple[Vector, Matrix]:
    """Return shares of the chords at which a component of the tangent vanishes, and postures."""
    (f0, f1), low, high = f, np.zeros(len(q)), np.ones(len(q))
    rows, share, new = np.arange(len(q)), low, q
    for _ in range(8):
        share = np.clip(low + (high - low) * f0 / (f0 - f1), 0.001, 0.999)
        new = _onto(manifold, q + share[:, None] * chord)
        t = manifold.null_spaces(new)[:, 0]
        slope = (t * np.sign((t * chord).sum(axis=1))[:, None])[rows, joint]
        is_low = slope * f0 > 0.0
        low, high = np.where(is_low, share, low), np.where(is_low, high, share)
        # Illinois: the end that stays loses half of its value.
        f0, f1 = np.where(is_low, slope, 0.5 * f0), np.where(is_low, 0.5 * f1, slope)
    return share, new


def _onto(manifold: Manifold, q: Matrix) -> Matrix:
    found = [manifold.corrected(one) for one in q]
    return np.array([b if a is None else a for a, b in zip(found, q, strict=True)])
