"""Closed-form solutions: torque remap and force jump, velocity remap and velocity jump.

Equation numbers are those of the paper, in the corrected form of docs/theory: the remapped torques
are ``U = ᔆJᵀ (Jᵀ)† τ`` (eq. 39, as used in eq. 42), the force jump is ``ΔF = (I - K K†) F̂``
(eq. 40).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Mask, Matrix, Vector, as_vector, read_only
from ftforce.core.display import Displayed
from ftforce.core.reduced_jacobian import (
    RTOL,
    ReducedJacobian,
    check_core_input,
    check_tolerances,
    reduce,
)
from ftforce.core.svd import Svd

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

PROOF_TOLERANCE = 1e-9


class Jump(NamedTuple):
    """Tip force before and after joints lock.

    Attributes
    ----------
    F :
        Force before the fault, F̂: the part that the healthy arm can exert, shape (m,).
    F_after :
        Force that the healthy joints can still produce, shape (m,).
    jump :
        ΔF = F̂ - F_after, shape (m,).
    """

    F: Vector
    F_after: Vector
    jump: Vector

    @property
    def jump_norm(self) -> float:
        """‖ΔF‖, in the unit of F."""
        return math.sqrt(float(self.jump.dot(self.jump)))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Remap(Displayed):
    """Remapped motor torques after joints lock, and the unavoidable force jump.

    Attributes
    ----------
    tau :
        Motor torques before the fault that produce the tip force, shape (n,).
    U :
        Motor torques to command after the fault, shape (n,); 0 at locked joints.
    F, F_after, jump :
        Tip force before and after the fault, and the jump ΔF = F - F_after, shape (m,).
    reduced :
        The decomposed Jacobians, with their ranks and the rank tolerance.
    """

    tau: Vector
    U: Vector
    F: Vector
    F_after: Vector
    jump: Vector
    reduced: ReducedJacobian

    @property
    def jump_norm(self) -> float:
        """‖ΔF‖, in the unit of F."""
        return math.sqrt(float(self.jump.dot(self.jump)))

    @property
    def self_motion(self) -> Vector:
        """Part of ``tau`` that drives self-motion and exerts no static force, (I - J†J) τ."""
        supporting: Vector = self.F.dot(self.reduced.J)
        return self.tau - supporting

    @property
    def brake_load(self) -> Vector:
        """Torque that each brake carries, J_Sᵀ F_after, shape (n,); 0 at healthy joints."""
        return np.where(self.reduced.locked, self.F_after.dot(self.reduced.J), 0.0)

    def residuals(self) -> Mapping[str, float]:
        """Return the relative residuals of the identities that define the remap; ideally 0.

        Returns
        -------
        :
            ``balance``: F̂ - F_after - ΔF; ``orthogonality``: ΔF · F_after; ``uncommandable``:
            KᵀΔF (the jump loads no healthy joint); ``statics``: U - KᵀF_after (the torques balance
            the force); ``self_motion``: J τ_N.
        """
        scale = self.reduced.sigma_max
        size = math.sqrt(float(self.tau.dot(self.tau)))
        laws = dict(force_residuals(self.reduced, self.U, self))
        laws["self_motion"] = _ratio(self.reduced.J @ self.self_motion, scale * size)
        return laws

    def is_proved(self, tolerance: float = PROOF_TOLERANCE) -> bool:
        """Return whether all residuals are within a tolerance.

        Parameters
        ----------
        tolerance :
            Largest relative residual accepted; the rank tolerance ``rtol`` is added to it.
        """
        return all(value <= tolerance + self.reduced.rtol for value in self.residuals().values())


class VelocityRemap(NamedTuple):
    """Joint velocities that best preserve the tip velocity after a fault (Appendix A).

    Attributes
    ----------
    before, after :
        Joint velocities before and after the fault, shape (n,); after it 0 at locked joints.
    tip_before, tip_after :
        Tip velocity before and after the fault, shape (m,).
    jump :
        ΔẊ = tip_after - tip_before, shape (m,).
    """

    before: Vector
    after: Vector
    tip_before: Vector
    tip_after: Vector
    jump: Vector


def remap(J: ArrayLike, tau: ArrayLike, locked: ArrayLike, *, rtol: float = RTOL) -> Remap:
    """Remap joint torques after joints lock, for a Jacobian from any library.

    Parameters
    ----------
    J :
        Task Jacobian at the tip, shape (m, n); rows in a common unit, weighted if necessary.
    tau :
        Motor torques that produce the tip force, without gravity and motion torques (N·m), shape
        (n,).
    locked :
        True at locked joints, shape (n,).
    rtol :
        Singular values up to ``rtol · σ_max(J)`` count as zero.

    Returns
    -------
    :
        Torques to command, tip force before and after the fault, and the jump.

    Raises
    ------
    InputError
        Shapes do not match, values are NaN or infinite, the mask is not boolean, or ``rtol`` is
        out of range.

    Examples
    --------
    >>> import numpy as np
    >>> J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    >>> result = remap(J, J.T @ [10.0, 5.0], np.array([False, True, False]))
    >>> result.U
    array([10.,  0.,  5.])
    >>> result.jump_norm
    0.0
    """
    J, mask = check_core_input(J, locked)
    if rtol != RTOL:
        check_tolerances(rtol, max(rtol, RTOL))
    tau = as_vector(tau, J.shape[1], "tau", "one torque per column of J")
    reduced = reduce(J, mask, rtol)
    change = force_jump(reduced, exerted_force(reduced, tau))
    return Remap(
        tau,
        read_only(remapped_torque(reduced, change.F)),
        change.F,
        change.F_after,
        change.jump,
        reduced,
    )


def exerted_force(reduced: ReducedJacobian, tau: Vector) -> Vector:
    """Return the tip force produced by joint torques, F̂ = (Jᵀ)† τ (eq. 18 with z = 0).

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    tau :
        Motor torques without gravity and motion torques, shape (n,).
    """
    return reduced.healthy.solve_transposed(tau, reduced.rtol)


def dynamically_exerted_force(reduced: ReducedJacobian, tau: Vector, M: Matrix) -> Vector:
    """Return the force that joint torques exert at a fixed tip while self-motion is unconstrained.

    This is ``F̂ = (J M⁻¹ Jᵀ)⁻¹ J M⁻¹ τ``, with the dynamically consistent inverse (Khatib 1987):
    the remainder of τ accelerates the arm along its self-motion and not the tip. For ``τ = JᵀF``
    it gives F, as `exerted_force` does.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    tau :
        Motor torques without gravity and motion torques, shape (n,).
    M :
        Mass matrix, positive definite, shape (n, n).
    """
    U = reduced.healthy.U[:, : reduced.rank]
    J = U.T.dot(reduced.J)  # restricted to range(J)
    over_M = np.linalg.solve(M, np.column_stack([J.T, tau]))
    F: Vector = U.dot(np.linalg.solve(J.dot(over_M[:, :-1]), J.dot(over_M[:, -1])))
    return F


def velocity_after_impact(M: Matrix, locked: Mask, v: Vector) -> Vector:
    """Return the joint velocities immediately after joints lock, before any controller acts.

    The impact is inelastic and conserves the generalized momentum of the other joints:
    ``v_H⁺ = v_H + M_HH⁻¹ M_HS v_S`` (docs/theory/velocity). Shape (n,), 0 at locked joints.

    Parameters
    ----------
    M :
        Mass matrix, shape (n, n).
    locked :
        True at locked joints, shape (n,).
    v :
        Joint velocities before the fault, rad/s or m/s, shape (n,).
    """
    after = np.where(locked, 0.0, v)
    if locked.any() and not locked.all():
        H = ~locked
        after[H] += np.linalg.solve(M[np.ix_(H, H)], M[np.ix_(H, locked)].dot(v[locked]))
    return after


def supported_force(reduced: ReducedJacobian, F: Vector) -> Vector:
    """Return the part of F that the healthy arm can exert, F̂ = J J† F.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Requested force, weighted, shape (m,).
    """
    return F if reduced.rank == reduced.m else reduced.healthy.project(F, reduced.rank)


def force_jump(reduced: ReducedJacobian, F: Vector) -> Jump:
    """Return the minimum force jump, ΔF = (I - K K†) F̂ (eq. 33, 40), for F̂ in range(J).

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂, weighted, shape (m,).
    """
    if reduced.rank_after == reduced.m:  # K K† = I: exactly no jump
        return Jump(read_only(F), F, read_only(np.zeros(reduced.m)))
    jump = reduced.damaged.project_out(F, reduced.rank_after)
    return Jump(read_only(F), read_only(F - jump), read_only(jump))


def remapped_torque(reduced: ReducedJacobian, F: Vector) -> Vector:
    """Return U = ᔆJᵀ F̂ (eq. 24; 39 as used in 42), shape (n,), 0 at locked joints.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂, weighted, shape (m,).
    """
    U: Vector = F.dot(reduced.damaged.A)
    return U


def velocity_remap(reduced: ReducedJacobian, v: Vector) -> VelocityRemap:
    """Return the velocity remap of Appendix A.

    ``Δv_H = K† x_S`` and ``ΔẊ = (K K† - I) x_S`` with ``x_S = Σ J_k v_k`` over the locked joints.
    H are the joints whose motors produce torque; free-swinging joints keep their velocities.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    v :
        Joint velocities before the fault, rad/s or m/s, shape (n,).
    """
    damaged, r = reduced.damaged, reduced.rank_after
    if reduced.free is not None:
        damaged = Svd(np.where(reduced.commanding, reduced.J, 0.0), left_only=True)
        r = damaged.rank(reduced.rtol * reduced.sigma_max)
    v_healthy = np.where(reduced.locked, 0.0, v)
    x_S = reduced.J.dot(v - v_healthy)
    after = v_healthy + np.where(reduced.commanding, damaged.solve(x_S, r), 0.0)
    jump = np.zeros(reduced.m) if r == reduced.m else -damaged.project_out(x_S, r)
    tip = reduced.J.dot(v)
    return VelocityRemap(
        v, read_only(after), read_only(tip), read_only(tip + jump), read_only(jump)
    )


def force_residuals(reduced: ReducedJacobian, U: Vector, change: Jump | Remap) -> dict[str, float]:
    """Return the force-related residuals of `Remap.residuals`.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    U :
        Motor torques after the fault, shape (n,).
    change :
        Tip force before and after the fault.
    """
    F, F_after, jump = change.F, change.F_after, change.jump
    size = math.sqrt(float(F.dot(F)))
    torque = reduced.sigma_max * size
    return {
        "balance": _ratio(F - F_after - jump, size),
        "orthogonality": _ratio(jump.dot(F_after), size * size),
        "uncommandable": _ratio(jump.dot(reduced.K), torque),
        "statics": _ratio(U - F_after.dot(reduced.K), torque),
    }


def _ratio(error: Vector | float, scale: float) -> float:
    if isinstance(error, float):  # whose square might overflow
        return float(abs(error)) / scale if scale > 0.0 else 0.0
    return float(np.linalg.norm(error)) / scale if scale > 0.0 else 0.0
