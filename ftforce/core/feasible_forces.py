"""The set of forces F' that a damaged arm can hold at its tip (docs/theory/limits).

Motors, brakes and free-swinging joints each constrain ``τ = rnea + JᵀF'``:

    F' in range(K)                        commandable by the motors (lock model *commanded* only)
    [rnea]_k + J_kᵀ F' = 0                 free-swinging joint k
    -limit_i ≤ [rnea]_i + J_iᵀ F' ≤ limit_i   motor or brake i with a known limit

The equality constraints define an affine subspace, ``F' = F₀ + Z z``; the inequalities bound a
polytope in it. The lock model *held* drops the first constraint: locked joints carry existing load.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import norm
from ftforce.errors import UnknownNameError

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.reduced_jacobian import ReducedJacobian


_ROUNDING = 1e-12  # smaller torques, relative to the arm's, count as zero


class LockModel(StrEnum):
    """How a locked joint is modelled."""

    COMMANDED = "commanded"
    """Only forces that the remaining motors can produce (the paper's model)."""
    HELD = "held"
    """Also existing loads that the locked joints carry, up to their brake limits."""

    @classmethod
    def parse(cls, lock_model: str) -> LockModel:
        """Return the lock model with the given name.

        Parameters
        ----------
        lock_model :
            ``commanded`` or ``held``.

        Raises
        ------
        UnknownNameError
            There is no such lock model.
        """
        try:
            return cls(lock_model)
        except ValueError:
            raise UnknownNameError("lock model", lock_model, list(cls)) from None


class LimitingFactor(StrEnum):
    """What limits a force capability."""

    LIMIT = "limit"
    """The torque limit of a motor or brake."""
    FAULT = "fault"
    """The fault itself: no motor acts in this direction, or a free-swinging joint yields."""
    DIRECTION = "direction"
    """The arm itself: even without a fault no motor acts in this direction (J lacks rank)."""
    WEIGHT = "weight"
    """Gravity and motion torques alone exceed the limits: the arm cannot support itself."""
    UNLIMITED = "unlimited"
    """No known limit applies."""


class FeasibleForces(NamedTuple):
    """The set ``{F₀ + Z z : lower ≤ rows (F₀ + Z z) ≤ upper}`` in weighted task coordinates.

    Attributes
    ----------
    F0 :
        Minimum-norm force that balances the free-swinging joints, shape (m,).
    Z :
        Orthonormal basis of the subspace, orthogonal to ``F0``, shape (m, d).
    rows :
        J_iᵀ of the joints with a known limit, shape (k, m).
    lower, upper :
        Bounds on J_iᵀ F': the limits minus the gravity and motion torques, shape (k,).
    joints :
        Indices of these joints, from 0.
    unbalanced :
        Torque at the free-swinging joints that no tip force can balance, relative to the arm's
        gravity and motion torques; ideally 0.
    rtol :
        Relative tolerance below which values count as zero.
    scale :
        σ_max(J).
    """

    F0: Vector
    Z: Matrix
    rows: Matrix
    lower: Vector
    upper: Vector
    joints: list[int]
    unbalanced: float
    rtol: float
    scale: float

    @property
    def is_balanced(self) -> bool:
        """Whether some tip force balances the free-swinging joints, so that the arm can be held."""
        return self.unbalanced <= self.rtol


class Weakest(NamedTuple):
    """The direction in which the arm can hold the least force.

    Attributes
    ----------
    direction :
        Unit vector in weighted task coordinates, shape (m,).
    reach :
        Range of feasible forces along it.
    """

    direction: Vector
    reach: Reach


class Reach(NamedTuple):
    """The feasible part of a ray ``s·d``, s ≥ 0.

    Attributes
    ----------
    minimum, maximum :
        Interval of s. ``maximum`` is infinite if no known limit bounds it, and smaller than
        ``minimum`` if no point of the ray is feasible.
    limiting_joints :
        Indices of the joints whose limits determine ``maximum``, from 0.
    """

    minimum: float
    maximum: float
    limiting_joints: tuple[int, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether no part of the ray is feasible."""
        return self.maximum < self.minimum


NOTHING = Reach(0.0, -1.0)


def feasible_forces(
    reduced: ReducedJacobian,
    rnea: Vector,
    largest: Vector | None,
    lock_model: LockModel = LockModel.COMMANDED,
) -> FeasibleForces:
    """Return the set of forces that the arm can hold.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    rnea :
        Gravity and motion torques after the fault, shape (n,).
    largest :
        Maximum torque of each motor, or of the brake of a locked joint; NaN where unknown; shape
        (n,). ``None`` applies no limits.
    lock_model :
        How locked joints are modelled.
    """
    free = reduced.free
    F0, unbalanced = np.zeros(reduced.m), 0.0
    if free is not None:
        weight = norm(rnea)
        if norm(rnea[free.joints]) > _ROUNDING * weight:
            F0 = free.support(rnea)
            unbalanced = norm(free.unbalanced(rnea)) / weight
    if lock_model is LockModel.COMMANDED:
        Z = reduced.damaged.U[:, : reduced.rank_after]
    else:
        Z = np.eye(reduced.m) if free is None else free.U[:, free.rank :]
    scale = reduced.sigma_max
    if largest is None:
        none = np.zeros(0)
        return FeasibleForces(
            F0, Z, np.zeros((0, reduced.m)), none, none, [], unbalanced, reduced.rtol, scale
        )
    # NaN is unknown; 0 is a free-swinging joint, already accounted for in F0 and Z.
    joints = (largest > 0.0).nonzero()[0]
    weights, limit = rnea[joints], largest[joints]
    rows, bounds = reduced.J.T[joints], (-limit - weights, limit - weights)
    return FeasibleForces(F0, Z, rows, *bounds, joints.tolist(), unbalanced, reduced.rtol, scale)


def reach(feasible: FeasibleForces, d: Vector) -> Reach:
    """Return the feasible range of ``s·d``, s ≥ 0, by a ratio test.

    Parameters
    ----------
    feasible :
        The feasible forces.
    d :
        Direction in weighted task coordinates, shape (m,).
    """
    if not feasible.is_balanced:
        return NOTHING
    minimum, maximum = _on_plane(feasible, d)
    if maximum < minimum or not feasible.joints:
        return Reach(minimum, maximum)
    lever = feasible.rows.dot(d)
    size = feasible.rtol * feasible.scale * norm(d)
    limiting_joints: tuple[int, ...] = ()
    ends = []
    bounds = (feasible.lower.tolist(), feasible.upper.tolist())
    rows = zip(feasible.joints, lever.tolist(), *bounds, strict=True)
    for joint, x, lower, upper in rows:
        if abs(x) <= size:  # the force does not load this joint
            if lower > 0.0 or upper < 0.0:
                return NOTHING
            continue
        first, last = (lower / x, upper / x) if x > 0.0 else (upper / x, lower / x)
        minimum = max(minimum, first)
        ends.append((last, joint))
    if ends:
        nearest = min(end for end, _ in ends)
        if nearest < maximum:
            maximum = nearest
            limit = nearest + 1e-9 * abs(nearest)  # joints that reach their limits together
            limiting_joints = tuple(joint for end, joint in ends if end <= limit)
    return Reach(minimum, maximum, limiting_joints)


def is_beyond_arm(reduced: ReducedJacobian, d: Vector) -> bool:
    """Return whether even the healthy arm cannot exert a force along d: d is not in range(J).

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    d :
        Direction in weighted task coordinates, shape (m,).
    """
    U = reduced.healthy.U[:, : reduced.rank]
    return norm(d - U.dot(d.dot(U))) > reduced.rtol * norm(d)


def limiting_factor(
    feasible: FeasibleForces, ray: Reach, *, beyond_arm: bool = False
) -> LimitingFactor:
    """Return what limits the force along a ray.

    Parameters
    ----------
    feasible :
        The feasible forces.
    ray :
        Their range along the ray, from `reach`.
    beyond_arm :
        Whether even the healthy arm lacks the direction, from `is_beyond_arm`.
    """
    if ray.is_empty:
        balanced = feasible.is_balanced and not feasible.F0.any()
        return LimitingFactor.WEIGHT if balanced else LimitingFactor.FAULT
    if ray.limiting_joints:
        return LimitingFactor.LIMIT
    if math.isinf(ray.maximum):
        return LimitingFactor.UNLIMITED
    return LimitingFactor.DIRECTION if beyond_arm else LimitingFactor.FAULT


def weakest_direction(feasible: FeasibleForces, space: Matrix) -> Weakest:
    """Return the direction within a subspace in which the arm can hold the least force.

    Parameters
    ----------
    feasible :
        The feasible forces.
    space :
        Orthonormal basis of the directions to consider, shape (m, r); the first axis if r = 0.
    """
    if not space.size:
        space = np.eye(len(space), 1)
    if not feasible.is_balanced or feasible.F0.any():  # zero force is not feasible
        return Weakest(space[:, 0], NOTHING)
    missing = space - feasible.Z.dot(feasible.Z.T.dot(space))
    _, s, Vt = np.linalg.svd(missing)
    if s[0] > feasible.rtol:  # a lost direction; its sign is arbitrary
        direction = space.dot(Vt[0])
        largest = direction[int(np.argmax(np.abs(direction)))]
        direction = math.copysign(1.0, largest) * direction
        return Weakest(direction, reach(feasible, direction))  # zero force, or infeasible
    levers = feasible.rows.dot(space)
    size = np.sqrt(np.einsum("ij,ij->i", levers, levers))
    loaded = size > feasible.rtol * feasible.scale
    if not loaded.any():
        return Weakest(space[:, 0], reach(feasible, space[:, 0]))
    # The nearest of the planes ``J_iᵀ F = bound``, over both bounds of every joint.
    with np.errstate(over="ignore"):  # distant planes may overflow
        distance = np.minimum(feasible.upper, -feasible.lower) / np.where(loaded, size, 1.0)
    i = int(np.argmin(np.where(loaded, distance, math.inf)))
    sign = 1.0 if feasible.upper[i] <= -feasible.lower[i] else -1.0
    direction = sign * space.dot(levers[i] / size[i])
    return Weakest(direction, reach(feasible, direction))


def _on_plane(feasible: FeasibleForces, d: Vector) -> tuple[float, float]:
    """Return the interval of s for which ``s·d`` lies in the subspace ``F₀ + Z z``."""
    Z, F0 = feasible.Z, feasible.F0
    offset = norm(F0)
    if Z.shape[1] == len(d) and offset == 0.0:
        return 0.0, math.inf
    beyond = d - Z.dot(d.dot(Z))
    size = norm(beyond)
    if size <= feasible.rtol * norm(d):
        return (0.0, math.inf) if offset == 0.0 else (0.0, -1.0)
    if offset == 0.0:
        return 0.0, 0.0
    s = float((F0 / size).dot(beyond / size))
    miss = norm(s * beyond - F0)
    return (s, s) if s >= 0.0 and miss <= feasible.rtol * offset else (0.0, -1.0)
