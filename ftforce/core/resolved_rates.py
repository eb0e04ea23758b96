"""Resolved-rate control (Whitney 1969): joint velocities for a desired tip velocity.

Near a singularity the inverse is damped in the singular directions only (Maciejewski & Klein 1988).
Joints that would exceed their velocity bounds are saturated and the others compensate: saturation
in the null space (Flacco, De Luca & Khatib 2012).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.svd import Svd

if TYPE_CHECKING:
    from ftforce.core.arrays import Mask, Matrix, Vector

_ROUNDING = 1e-12  # relative; a velocity at its bound does not violate it


class Bounds(NamedTuple):
    """Lower and upper bounds of the joint velocities, rad/s or m/s, shape (n,)."""

    lower: Vector
    upper: Vector


def resolved_rates(
    K: Svd, missing: Vector, v0: Vector, bounds: Bounds, damped_below: float
) -> Vector:
    """Return the joint velocities closest to v₀ that give the tip its desired velocity.

    These are ``v₀ + K†(ẋ - J v₀)``: for v₀ = 0 the minimum-norm velocities for ẋ; for the healthy
    joint velocities with 0 at locked joints, the remap of Appendix A.

    Parameters
    ----------
    K :
        Decomposition of the weighted Jacobian, shape (m, n), with zero columns for joints that
        cannot be commanded.
    missing :
        Tip velocity error, ẋ - J v₀, shape (m,).
    v0 :
        Velocities to stay close to, shape (n,).
    bounds :
        Joint velocity bounds. They take precedence over the tip velocity.
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
        v = kept + damped_inverse(
            without_columns(K.A, ~moving), missing - K.A.dot(kept - v0), damped_below
        )
    return v


def damped_inverse(K: Svd, x: Vector, damped_below: float) -> Vector:
    """Return K† x, damped in directions whose singular values σ are below ε = ``damped_below``.

    There 1/σ is replaced by ``σ/(σ² + λ²)`` with ``λ² = (1 - (σ/ε)²) (ε/2)²``, which is continuous
    at σ = ε, never exceeds 1.16/ε, and vanishes with σ.

    Parameters
    ----------
    K :
        Decomposition of the Jacobian, shape (m, n).
    x :
        Tip velocity or displacement, shape (m,).
    damped_below :
        Singular values below this are damped.
    """
    weights = []
    for s in K.s:
        square = s * s
        if s < damped_below:
            square += 0.25 * (damped_below * damped_below - square)
        # For σ = 0 the result is exactly 0; the product with K would leave rounding error.
        weights.append(1.0 / square if s > 0.0 else 0.0)
    v: Vector = K.U.dot(x.dot(K.U) * weights).dot(K.A)
    return v


def without_columns(J: Matrix, joints: Mask) -> Svd:
    """Return the decomposition of J with the columns of the given joints zeroed.

    Parameters
    ----------
    J :
        Jacobian, shape (m, n).
    joints :
        True at the joints to remove, shape (n,).
    """
    return Svd(np.where(joints, 0.0, J), left_only=True)


def _worst(v: Vector, lower: Vector, upper: Vector, moving: Mask) -> int | None:
    """Return the moving joint farthest beyond its bound, or ``None`` if all are within."""
    beyond = np.where(moving, np.maximum(v - upper, lower - v), 0.0)
    worst = int(beyond.argmax())
    return worst if beyond[worst] > _ROUNDING * max(abs(float(v[worst])), 1.0) else None
