"""Torque remap within torque limits: the feasible force closest to the desired one.

    minimise ‖F̂ - F'‖²  over F' = F₀ + Z z  subject to  lower ≤ rows F' ≤ upper

This is the quadratic program of docs/theory/limits, common to all fault modes. It has at most six
variables; daqp's dual active-set method solves it to rounding error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import (
    Matrix,
    Vector,
    as_floats,
    as_vector,
    norm,
    read_only,
    safe_divide,
)
from ftforce.core.feasible_forces import (
    NOTHING,
    FeasibleForces,
    LockModel,
    Reach,
    feasible_forces,
    reach,
)
from ftforce.core.limits import Limits, checked_limits
from ftforce.core.reduced_jacobian import (
    BORDERLINE_RTOL,
    RTOL,
    FreeJoints,
    ReducedJacobian,
    check_core_input,
    check_mask,
    check_tolerances,
    reduce,
)
from ftforce.core.remap import exerted_force
from ftforce.errors import DimensionError, InputError, SolverError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

_SLACK = 1e-9  # relative to a limit: a torque closer than this is at its limit
_INFEASIBLE = -1  # daqp's exit flag; positive flags are solutions
_MAX_VIOLATION = 1e-6  # of the unit: solutions that violate a limit by more are rejected
_FINEST = 1e-5  # of the distances in a problem: with a finer unit the solver sees rounding error
_THIN = 4e-11  # of the unit; daqp treats bounds closer than a quarter of it as equal
_EXACT = 1e-12  # of a limit: accuracy of the closed form
_ROUNDING = 1e-15  # relative to the terms of a sum
_PRECISION = {"primal_tol": 1e-11, "dual_tol": 1e-11}


class Nearest(NamedTuple):
    """The feasible force closest to the desired one.

    Attributes
    ----------
    F :
        Desired force F̂, weighted, shape (m,).
    F_after :
        Closest feasible force, weighted, shape (m,); ``None`` if no force is feasible.
    multipliers :
        Lagrange multipliers of the limits, positive at upper limits, shape (k,).
    """

    F: Vector
    F_after: Vector | None
    multipliers: Vector

    def residuals(self, feasible: FeasibleForces) -> dict[str, float]:
        """Return the relative residuals of the optimality (KKT) conditions.

        Parameters
        ----------
        feasible :
            The forces among which this one was sought.

        Returns
        -------
        :
            ``equality``: F' - F₀ - Z z; ``limit``: the largest limit violation; ``optimality``:
            the gradient of the Lagrangian, and complementary slackness. Empty if no force is
            feasible.
        """
        if self.F_after is None:
            return {}
        z = self.F_after.dot(feasible.Z)
        off = self.F_after - feasible.F0 - feasible.Z.dot(z)
        if feasible.bearings is not None and feasible.bearings.bears(self.F_after):
            off -= feasible.fixed.dot(off.dot(feasible.fixed))  # friction bears what Z leaves out
        A, y = feasible.rows.dot(feasible.Z), self.multipliers
        size = max(norm(self.F), norm(self.F_after))
        torque, width, rounding = self._torques(feasible)
        beyond = np.maximum(torque - feasible.upper, feasible.lower - torque) - rounding
        gradient = z - self.F.dot(feasible.Z) + y.dot(A)
        slack = np.where(y > 0.0, feasible.upper - torque, torque - feasible.lower) - rounding
        with np.errstate(over="ignore"):  # the limit may be almost zero
            beyond, slack = beyond / width, slack / width
        idle = np.abs(y * np.maximum(slack, 0.0)) * feasible.scale
        steepest = max(norm(gradient), float(idle.max(initial=0.0)))
        return {
            "equality": safe_divide(norm(off), size, norm(off)),
            "limit": max(0.0, float(beyond.max(initial=0.0))),
            "optimality": safe_divide(steepest, size, steepest),
        }

    def binding(self, feasible: FeasibleForces) -> tuple[int, ...]:
        """Return the indices of the joints whose torque is at its limit, from 0.

        Parameters
        ----------
        feasible :
            The forces among which this one was sought.
        """
        if self.F_after is None:
            return ()
        torque, width, rounding = self._torques(feasible)
        near = 2.0 * _SLACK * width + rounding
        at_limit = (torque >= feasible.upper - near) | (torque <= feasible.lower + near)
        bound = [j for j, at in zip(feasible.joints, at_limit.tolist(), strict=True) if at]
        return feasible.without_friction(bound)

    def _torques(self, feasible: FeasibleForces) -> tuple[Vector, Vector, Vector]:
        """Return the torques J_iᵀ F', half the width between limits, and the rounding error."""
        F, rows = self.F_after, feasible.rows
        assert F is not None
        size = max(norm(self.F), norm(F))
        bounds = np.maximum(np.abs(feasible.lower), np.abs(feasible.upper))
        rounding = _ROUNDING * (size * np.sqrt(np.vecdot(rows, rows)) + bounds)
        width = np.maximum(0.5 * (feasible.upper - feasible.lower), rounding)
        return rows.dot(F), width, rounding


def nearest_force(feasible: FeasibleForces, F: Vector) -> Nearest:
    """Return the feasible force closest to F, in weighted task coordinates.

    Parameters
    ----------
    feasible :
        The feasible forces.
    F :
        Desired force F̂, shape (m,).
    """
    multipliers = np.zeros(len(feasible.joints))
    bearings = feasible.bearings
    if not feasible.is_balanced:
        return Nearest(F, None, multipliers)
    if bearings is not None and bearings.bears(F) and _is_held(feasible, F):
        return Nearest(F, F, multipliers)
    wanted = F.dot(feasible.Z)
    unrestricted = len(wanted) == len(F)  # Z spans all forces, and F₀ is zero
    closed = F if unrestricted else feasible.F0 + feasible.Z.dot(wanted)
    if not feasible.joints or _is_within(feasible, closed):
        return Nearest(F, closed, multipliers)  # no limit is active: the closed form holds
    z = _solve(feasible, wanted, multipliers)
    return Nearest(F, None if z is None else feasible.F0 + feasible.Z.dot(z), multipliers)


def _is_held(feasible: FeasibleForces, F: Vector) -> bool:
    """Return whether a force that free-swinging joints bear is held as it is."""
    ray = reach(feasible, F) if F.any() else _at_rest(feasible)
    return ray.minimum <= 1.0 <= ray.maximum


def _is_within(feasible: FeasibleForces, F: Vector) -> bool:
    torque = feasible.rows.dot(F)
    # For a handful of joints, lists are faster than NumPy reductions.
    beyond = (torque > feasible.upper).tolist() + (torque < feasible.lower).tolist()
    return True not in beyond


def _solve(feasible: FeasibleForces, wanted: Vector, multipliers: Vector) -> Vector | None:
    """Return z, or ``None`` if infeasible, and write the multipliers in place."""
    A = feasible.rows.dot(feasible.Z)
    lower, upper = feasible.lower, feasible.upper
    if feasible.F0.dot(feasible.F0):
        offset = feasible.rows.dot(feasible.F0)
        lower, upper = lower - offset, upper - offset
    levers, least = np.sqrt(np.vecdot(A, A)), feasible.rtol * feasible.scale
    bounds = (lower, upper)
    z = _on_one_limit(A, wanted, multipliers, bounds=bounds, levers=levers, least=least)
    if z is not None:
        return z
    # daqp ignores short rows and has absolute tolerances. Normalising the rows turns the bounds
    # into distances; the narrowest interval sets the unit.
    low, high = lower.tolist(), upper.tolist()
    narrow, far = math.inf, norm(wanted)
    for i, lever in enumerate(levers.tolist()):
        if lever > least:
            low[i] /= lever
            high[i] /= lever
            narrow = min(narrow, high[i] - low[i])
            far = max(far, low[i], -high[i])  # lower bounds on a solution's distance from z = 0
        elif high[i] < 0.0 or low[i] > 0.0:  # no force changes this torque
            return None
        else:
            low[i], high[i], levers[i] = -math.inf, math.inf, math.inf
    if narrow == math.inf:
        return wanted
    unit = max(0.5 * narrow, _FINEST * far)
    lower, upper = (np.array([x / unit for x in side]) for side in (low, high))
    if narrow < _THIN * unit:  # thinner than rounding error: daqp would treat it as an equality
        thin = upper - lower < _THIN
        lower[thin], upper[thin] = lower[thin] - 0.5 * _THIN, upper[thin] + 0.5 * _THIN
    z, y = _quadratic_program(A / levers[:, None], wanted / unit, lower, upper)
    if z is None:
        if max(low) <= 0.0 <= min(high):  # z = 0 is within all limits
            raise SolverError("daqp reported a feasible quadratic program as infeasible")
        return None
    np.multiply(y, unit / levers, out=multipliers)
    solution: Vector = z * unit
    return solution


def _on_one_limit(
    A: Matrix,
    wanted: Vector,
    multipliers: Vector,
    *,
    bounds: tuple[Vector, Vector],
    levers: Vector,
    least: float,
) -> Vector | None:
    """Return z if only the most exceeded limit is active, else ``None``; write its multiplier.

    The projection onto that limit is optimal (KKT) if it keeps all others.
    """
    (lower, upper), torque = bounds, A.dot(wanted)
    sides = zip((torque - upper).tolist(), (lower - torque).tolist(), levers.tolist(), strict=True)
    distances = [
        max(above, below) / lever if lever > least else 0.0 for above, below, lever in sides
    ]
    farthest = max(distances)
    if farthest <= 0.0:  # the limit exceeded is that of a torque that no force changes
        return None
    i = distances.index(farthest)
    lever, there = levers.item(i), torque.item(i)
    bound = upper.item(i) if there > upper.item(i) else lower.item(i)
    step = (there - bound) / lever  # along the unit normal, positive above the upper limit
    z: Vector = wanted - (step / lever) * A[i]
    torque = A.dot(z)
    if abs(torque.item(i) - bound) > _EXACT * abs(bound):
        return None  # the force desired is too large for its difference from the limit
    torque[i] = bound
    if True in (torque > upper).tolist() or True in (torque < lower).tolist():
        return None
    multipliers[i] = step / lever
    return z


def _quadratic_program(
    A: Matrix, wanted: Vector, lower: Vector, upper: Vector
) -> tuple[Vector | None, Vector]:
    """Minimise ½‖z - wanted‖² subject to lower ≤ A z ≤ upper."""
    import daqp  # imported lazily: needed only when a limit is active

    identity, inequalities = _constant(*A.shape)
    z, _, flag, info = daqp.solve(
        identity, -wanted, np.ascontiguousarray(A), upper, lower, inequalities, **_PRECISION
    )
    if flag == _INFEASIBLE:
        return None, np.zeros(len(A))
    torque = A.dot(z)
    beyond = max((torque - upper).tolist() + (lower - torque).tolist())
    if flag <= 0 or not beyond <= _MAX_VIOLATION:  # some daqp versions report success wrongly
        raise SolverError(
            f"daqp did not solve the quadratic program (exit flag {flag}, limits exceeded by "
            f"{beyond:.1g})"
        )
    return z, info["lam"]


@lru_cache(maxsize=64)
def _constant(k: int, d: int) -> tuple[Matrix, Any]:
    return np.eye(d), np.zeros(k, dtype=np.intc)


@dataclass(frozen=True, slots=True, eq=False)
class BoundedRemap:
    """Motor torques within limits after a fault, and the resulting tip force.

    Attributes
    ----------
    reduced :
        The decomposed Jacobians.
    rnea :
        Gravity and motion torques, shape (n,).
    feasible :
        The forces that the arm can hold.
    nearest :
        The feasible force closest to the desired one.
    """

    reduced: ReducedJacobian
    rnea: Vector
    feasible: FeasibleForces
    nearest: Nearest

    @property
    def F_after(self) -> Vector | None:
        """Force that can still be held, weighted, shape (m,); ``None`` if infeasible."""
        return self.nearest.F_after

    @property
    def jump(self) -> Vector | None:
        """Force jump ΔF = F̂ - F', weighted, shape (m,); ``None`` if infeasible."""
        return None if self.F_after is None else self.nearest.F - self.F_after

    @property
    def U(self) -> Vector | None:
        """Motor torques to command, including gravity and motion torques, shape (n,).

        Zero at locked and free-swinging joints; ``None`` if infeasible.
        """
        if self.F_after is None:
            return None
        torque = self.rnea + self.F_after.dot(self.reduced.J)
        return read_only(np.where(self.reduced.commanding, torque, 0.0))

    @property
    def share(self) -> float | None:
        """Largest s ≤ 1 for which s·F̂ can be held; ``None`` if there is none."""
        return share_of(self.feasible, self.nearest.F)

    @property
    def binding(self) -> tuple[int, ...]:
        """Indices of the joints whose torque is at the limit of motor or brake, from 0."""
        return self.nearest.binding(self.feasible)

    @property
    def overloaded(self) -> tuple[int, ...]:
        """Indices of the joints that gravity and motion torques alone overload (F₀ at the tip)."""
        return overloaded(self.feasible)

    def residuals(self) -> Mapping[str, float]:
        """Return the relative residuals of `Nearest.residuals`."""
        return self.nearest.residuals(self.feasible)


def bounded_remap(
    J: ArrayLike,
    tau: ArrayLike,
    locked: ArrayLike,
    *,
    limits: ArrayLike,
    free: ArrayLike | None = None,
    friction: ArrayLike | None = None,
    rnea: ArrayLike | None = None,
    rtol: float = RTOL,
) -> BoundedRemap:
    """Remap joint torques within limits after a fault, for a Jacobian from any library.

    Parameters
    ----------
    J :
        Task Jacobian at the tip, shape (m, n); rows in a common unit, weighted if necessary.
    tau :
        Motor torques that produce the tip force, without gravity and motion torques (N·m), shape
        (n,).
    locked :
        True at locked joints, shape (n,).
    limits :
        Maximum torque of each motor, or of the brake of a locked joint; NaN where unknown; shape
        (n,), or lower and upper limits as rows, shape (2, n).
    free :
        True at free-swinging joints, shape (n,).
    friction :
        Largest torque that the friction of a free-swinging joint bears, NaN for 0.1 % of the
        largest torque of ``rnea``, shape (n,); by default the joints are ideal.
    rnea :
        Gravity and motion torques, shape (n,); zero by default.
    rtol :
        Singular values up to ``rtol · σ_max(J)`` count as zero.

    Raises
    ------
    InputError
        Shapes do not match, a joint is both locked and free, a limit is not positive, or friction
        is negative.

    Examples
    --------
    >>> import numpy as np
    >>> J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    >>> unknown = float("nan")  # limit of the brake
    >>> tau, locked = J.T @ [10.0, 5.0], [False, True, False]
    >>> result = bounded_remap(J, tau, locked, limits=[6.0, unknown, 9.0])
    >>> result.U, result.binding, round(result.share, 12)
    (array([6., 0., 5.]), (0,), 0.6)
    """
    J, mask = check_core_input(J, locked)
    free_mask = None
    if free is not None:
        free_mask = check_mask(free, J.shape[1], "free")
        if (mask & free_mask).any():
            raise InputError(
                f"the joint of column {(mask & free_mask).argmax() + 1} of J cannot be both locked "
                "and free; a joint fails in only one mode"
            )
    check_tolerances(rtol, max(rtol, BORDERLINE_RTOL))
    n = J.shape[1]
    tau = as_vector(tau, n, "tau", "one torque per column of J")
    weight = np.zeros(n) if rnea is None else as_vector(rnea, n, "rnea", "one per column of J")
    largest = _checked_sides(limits, n)
    swinging = None
    if free_mask is not None and free_mask.any():
        largest[..., free_mask] = 0.0
        borne = _checked_friction(friction, n)
        swinging = FreeJoints.of(free_mask, borne, max(rtol, BORDERLINE_RTOL))
    reduced = reduce(J, mask, rtol, swinging)
    return remap_inside(reduced, exerted_force(reduced, tau), weight, largest)


def _checked_sides(limits: ArrayLike, n: int) -> Vector:
    """Return a copy of limits, shape (n,), or of lower and upper ones, shape (2, n)."""
    values = as_floats(limits, "limits")
    if values.ndim == 2:
        if values.shape != (2, n):
            raise DimensionError("limits", (2, n), values.shape, "lower and upper limits")
        known = Limits.of(values[1], lower=values[0])
        return np.array(known.motor_bounds())
    largest = checked_limits(values, "limits")
    if len(largest) != n:
        hint = "one per column of J, NaN where unknown"
        raise DimensionError("limits", (n,), largest.shape, hint)
    return largest


def _checked_friction(friction: ArrayLike | None, n: int) -> Vector:
    """Return the friction of each joint, 0 by default."""
    if friction is None:
        return np.zeros(n)
    values = as_floats(friction, "friction")
    if values.shape != (n,):
        raise DimensionError("friction", (n,), values.shape, "one per column of J")
    if (values < 0.0).any() or np.isinf(values).any():
        raise InputError(f"friction must not be negative or infinite, got {values.tolist()}")
    return read_only(values)


def remap_inside(
    reduced: ReducedJacobian, F: Vector, rnea: Vector, largest: Vector | None
) -> BoundedRemap:
    """Remap within limits, given the weighted force F̂; arguments are not validated.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    F :
        Force F̂ that the healthy arm exerts, shape (m,).
    rnea :
        Gravity and motion torques after the fault, shape (n,).
    largest :
        Maximum torques of motors and brakes, NaN where unknown, shape (n,); ``None`` applies no
        limits.
    """
    feasible = feasible_forces(reduced, rnea, largest, LockModel.COMMANDED)
    return BoundedRemap(reduced, rnea, feasible, nearest_force(feasible, F))


def share_of(feasible: FeasibleForces, F: Vector) -> float | None:
    """Return the largest s ≤ 1 for which s·F is feasible, or ``None`` if there is none.

    Parameters
    ----------
    feasible :
        The feasible forces.
    F :
        Desired force, weighted, shape (m,).
    """
    ray = reach(feasible, F) if F.any() else _at_rest(feasible)
    if ray.minimum <= min(ray.maximum, 1.0):
        return min(ray.maximum, 1.0)
    return None if _at_rest(feasible).is_empty else 0.0


def _at_rest(feasible: FeasibleForces) -> Reach:
    """Return an unbounded range if zero force is feasible: any multiple of zero is zero."""
    inside = bool((feasible.lower <= 0.0).all() and (feasible.upper >= 0.0).all())
    return Reach(0.0, math.inf) if feasible.is_at_rest and inside else NOTHING


def overloaded(feasible: FeasibleForces) -> tuple[int, ...]:
    """Return the joints that gravity and motion torques overload, with only F₀ at the tip.

    Parameters
    ----------
    feasible :
        The forces that can be held, with the limits.
    """
    torque = feasible.rows.dot(feasible.F0)
    beyond = (torque > feasible.upper) | (torque < feasible.lower)
    exceeded = [j for j, over in zip(feasible.joints, beyond.tolist(), strict=True) if over]
    return feasible.without_friction(exceeded)
