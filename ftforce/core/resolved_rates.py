"""Joint velocities that move a tip as asked: resolved rates (Whitney 1969), array in, array out.

Near a singularity the inverse is damped in the directions that need it (Maciejewski & Klein 1988);
a joint that would be too fast is held at its bound, and the others take over its share, which is
saturation in the null space (Flacco, De Luca & Khatib 2012).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.svd import Svd

if TYPE_CHECKING:
    from ftforce.core.arrays import Mask, Matrix, Vector

_ROUNDING = 1e-12  # relative: a velocity at its bound is not beyond it


class Bounds(NamedTuple):
    """Least and largest joint velocities, rad/s or m/s, shape (n,); least below largest."""

    lower: Vector
    upper: Vector


def resolved_rates(
    K: Svd, missing: Vector, v0: Vector, bounds: Bounds, damped_below: float
) -> Vector:
    """Return the smallest change of joint velocities that gives the tip what it misses.

    That is ``v₀ + K†(ẋ - J v₀)``: with v₀ = 0 the smallest velocities for ẋ, and with those of the
    healthy arm, 0 at locked joints, Appendix A.

    Parameters
    ----------
    K :
        Jacobian whose rows share a norm, (m, n), with zeros in the columns of joints that cannot
        be commanded, decomposed.
    missing :
        What the velocity of the tip lacks, ẋ - J v₀, shape (m,).
    v0 :
        Velocities to stay close to, shape (n,).
    bounds :
        They come first: what the tip then lacks of its velocity is lost.
    damped_below :
        Singular values below this are damped.
    """
    v: Vector = v0 + damped_inverse(K, missing, damped_below)
    lower, upper = bounds
    if not ((v > upper) | (v < lower)).any():
        return v
    moving, kept = np.any(K.A != 0.0, axis=0), v0.copy()
    while (worst := _worst(v, lower, upper, moving)) is not None:
        kept[worst] = upper[worst] if v[worst] > upper[worst] else lower[worst]
        moving[worst] = False
        v = kept + damped_inverse(without(K.A, ~moving), missing - K.A.dot(kept - v0), damped_below)
    return v


def damped_inverse(K: Svd, x: Vector, damped_below: float) -> Vector:
    """Return K† x, damped in the directions whose singular values σ are below a bound ε.

    ``σ/(σ² + λ²)`` with ``λ² = (1 - (σ/ε)²) (ε/2)²`` takes the place of 1/σ there: it goes on from
    1/σ at ε without a step, never exceeds 1.16/ε, and falls to 0 with σ.
    """
    weights = []
    for s in K.s:
        square = s * s
        if s < damped_below:
            square += 0.25 * (damped_below * damped_below - square)
        # Where σ is 0, the numerator is, too; through K it would only nearly be.
        weights.append(1.0 / square if s > 0.0 else 0.0)
    v: Vector = K.U.dot(x.dot(K.U) * weights).dot(K.A)
    return v


def without(J: Matrix, joints: Mask) -> Svd:
    """Return the decomposition of J with zeros in the columns of some joints."""
    return Svd(np.where(joints, 0.0, J), left_only=True)


def _worst(v: Vector, lower: Vector, upper: Vector, moving: Mask) -> int | None:
    """Return the moving joint farthest beyond its bound, ``None`` if all are within."""
    beyond = np.where(moving, np.maximum(v - upper, lower - v), 0.0)
    worst = int(beyond.argmax())
    return worst if beyond[worst] > _ROUNDING * max(abs(float(v[worst])), 1.0) else None
