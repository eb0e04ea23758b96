"""Measures of a fault set: margin, manipulability, lost directions, … (docs/theory)."""

from __future__ import annotations

import math
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import Matrix, Vector, read_only, safe_divide

if TYPE_CHECKING:
    from ftforce.core.reduced_jacobian import ReducedJacobian


def margin(reduced: ReducedJacobian) -> float:
    """Return σ_min(K) / σ_max(J); 0 if a direction is lost or J = 0.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    """
    return safe_divide(reduced.damaged.s[-1], reduced.sigma_max, 0.0)


def relative_manipulability(reduced: ReducedJacobian) -> float:
    """Return ρ = w(K)/w(J) (Roberts & Maciejewski 1996); NaN if w(J) = 0.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    """
    if reduced.rank < reduced.m:
        return math.nan
    return math.prod([a / b for a, b in zip(reduced.damaged.s, reduced.healthy.s, strict=True)])


def condition_number(reduced: ReducedJacobian) -> float:
    """Return σ_max(K)/σ_min(K); infinite if a direction is lost.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    """
    smallest = reduced.damaged.s[-1]
    return reduced.damaged.s[0] / smallest if reduced.rank_after == reduced.m else math.inf


def force_error(reduced: ReducedJacobian) -> float:
    """Return the largest tip force error per unit of torque error at the healthy joints.

    This is 1/σ for the smallest retained singular value of K, in N (or weighted N) per N·m;
    infinite if no direction is left.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    """
    r = reduced.rank_after
    return 1.0 / reduced.damaged.s[r - 1] if r else math.inf


def worst_manipulability_bound(n: int, m: int, f: int) -> float:
    """Return √(C(n-m, f)/C(n, f)), an upper bound on min ρ over f locked joints in any posture.

    Parameters
    ----------
    n, m, f :
        Numbers of joints, task rows and locked joints.
    """
    return math.sqrt(comb(n - m, f) / comb(n, f)) if n >= m else 0.0


def lost_directions(reduced: ReducedJacobian) -> Matrix:
    """Return the force directions that are lost through the fault.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.

    Returns
    -------
    :
        Orthonormal rows in weighted task coordinates, shape (rank - rank_after, m), aligned with
        task axes where possible, largest component positive.
    """
    count = reduced.rank - reduced.rank_after
    if count <= 0:
        return read_only(np.zeros((0, reduced.m)))
    lost = reduced.damaged.U[:, reduced.rank_after :]
    if reduced.rank < reduced.m:
        # The complement of range(K) also includes directions that the healthy arm lacks.
        lacking = lost.T @ reduced.healthy.U[:, reduced.rank :]
        lost = lost @ np.linalg.svd(lacking)[0][:, lacking.shape[1] :]
    return read_only(_along_axes(lost @ lost.T, count))


def _along_axes(projector: Matrix, count: int) -> Matrix:
    """Return an orthonormal basis of the range, by Gram-Schmidt with column pivoting."""
    rest = projector.copy()
    rows = []
    for _ in range(count):
        lengths = np.einsum("ij,ij->j", rest, rest)
        # Rounded, so that rounding error does not decide between columns of equal length.
        row = rest[:, int(np.argmax(np.round(lengths, 9)))]
        row = row / np.linalg.norm(row)
        row = np.where(np.abs(row) < 1e-14, 0.0, row)
        rest = rest - np.outer(row, row @ rest)
        rows.append(row * math.copysign(1.0, row[int(np.argmax(np.round(np.abs(row), 9)))]))
    return np.array(rows)


def force_contributions(reduced: ReducedJacobian, tau: Vector, F: Vector) -> Vector:
    """Return ‖(Jᵀ)†_k τ_k‖/‖F̂‖, the contribution of each joint (Table 2), shape (n,).

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    tau :
        Motor torques that produce the tip force, shape (n,).
    F :
        Force F̂, weighted, shape (m,).
    """
    units = np.eye(reduced.n)
    columns = [reduced.healthy.solve_transposed(unit, reduced.rtol) for unit in units]
    shares = _norms(np.array(columns), axis=1) * np.abs(tau)
    return read_only(safe_divide(shares, float(_norms(F)), np.zeros_like(shares)))


def velocity_contributions(J: Matrix, v: Vector) -> Vector:
    """Return ‖J_k v_k‖/‖J v‖, the contribution of each joint (Table 2), shape (n,).

    Parameters
    ----------
    J :
        Weighted task Jacobian, shape (m, n).
    v :
        Joint velocities, rad/s or m/s, shape (n,).
    """
    shares = _norms(J * v, axis=0)
    return read_only(safe_divide(shares, float(_norms(J @ v)), np.zeros_like(shares)))


def _norms(A: Matrix, axis: int | None = None) -> Vector:
    """Return the norm, scaled by powers of two so that the squares cannot overflow."""
    _, exponents = np.frexp(np.abs(A).max(axis=axis, keepdims=True))
    scaled = np.asarray(np.linalg.norm(np.ldexp(A, -exponents), axis=axis))
    norms: Vector = np.ldexp(scaled, exponents.reshape(scaled.shape))
    return norms
