"""Self-motion of two or more dimensions, covered by a graph of samples."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ftforce.planning.projection import project

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.planning.trace import Manifold

MOST = 5_000
"""Samples of a manifold, in all its components."""
_APART = 0.6  # samples are this far apart, of the resolution
_ITERATIONS = 12


def cover(manifold: Manifold, q: Vector, resolution: float, most: int = MOST) -> Matrix:
    """Return samples of the piece of a self-motion that contains a posture, shape (N, n).

    From every sample, steps along its tangents are projected back; what is farther than 0.6 of the
    resolution from all samples is a new one. Each sample is joined to the one it was found from.

    Parameters
    ----------
    manifold :
        A self-motion of dimension 2 or more.
    q :
        A posture on it, rad or m, shape (n,).
    resolution :
        Length of the steps in joint space, rad or m.
    most :
        Number of samples, at most.
    """
    from scipy.spatial import cKDTree

    found = q[None]
    front = found
    while len(front) and len(found) < most:
        new = _neighbours(manifold, front, resolution)
        apart = cKDTree(found).query(new)[0] > _APART * resolution if len(new) else []
        front = _spread(new[apart], _APART * resolution) if len(new) else new
        front = front[: most - len(found)]
        found = np.concatenate([found, front])
    return found


def _neighbours(manifold: Manifold, q: Matrix, length: float) -> Matrix:
    """Return the postures on the manifold one step away from some, along axes of its tangents."""
    basis = manifold.null_spaces(q)
    d = basis.shape[1]
    signs = np.array([one for one in product((-1, 0, 1), repeat=d) if 0 < np.abs(one).sum() <= 2])
    directions = signs / np.linalg.norm(signs, axis=1, keepdims=True)
    steps = length * (directions @ basis)
    tried = (q[:, None] + steps).reshape(-1, q.shape[1])
    limits = np.array([manifold.lower, manifold.upper])
    new, reached = project(
        manifold.robot, tried, manifold.target, iterations=_ITERATIONS, limits=limits
    )
    # A projection that went far is on another part of the manifold.
    near = np.linalg.norm(new - np.repeat(q, len(signs), axis=0), axis=1) <= 1.5 * length
    chosen: Matrix = new[reached & near]
    return chosen


def _spread(q: Matrix, apart: float) -> Matrix:
    """Return those of some postures that are at least so far from the ones chosen before."""
    from scipy.spatial import cKDTree

    kept = np.ones(len(q), dtype=bool)
    pairs = sorted(cKDTree(q).query_pairs(apart)) if len(q) else []
    for i, j in pairs:
        if kept[i]:
            kept[j] = False
    spread: Matrix = q[kept]
    return spread
