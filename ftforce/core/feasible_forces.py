"""The forces F' that a damaged arm can hold at its tip (docs/theory/limits).

Motors, brakes and joints without torque each say something about ``τ = rnea + JᵀF'``:

    F' in range(K)                        what motors can command (the reading *commanded*)
    [rnea]_k + J_kᵀ F' = 0                 a joint k without torque
    -limit_i ≤ [rnea]_i + J_iᵀ F' ≤ limit_i   a motor or a brake whose limit is known

The first two make a plane, ``F' = F₀ + Z z``, and the third cuts a polytope out of it. In the
reading *held* the first is dropped: a load that is there already is carried by the locks.
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


_ROUNDING = 1e-12  # a torque smaller than this, relative to the arm's, is none


class LockModel(StrEnum):
    """What a lock is taken for."""

    COMMANDED = "commanded"
    """Only what the motors that are left can make (the paper's reading)."""
    HELD = "held"
    """Also what locks carry of a load that is there already, up to their brakes' limits."""

    @classmethod
    def parse(cls, reading: str) -> LockModel:
        """Return the reading of this name.

        Raises
        ------
        UnknownNameError
            There is no such reading.
        """
        try:
            return cls(reading)
        except ValueError:
            raise UnknownNameError("reading of a lock", reading, list(cls)) from None


class LimitingFactor(StrEnum):
    """What ends a capability."""

    LIMIT = "limit"
    """The torque limit of a motor or brake."""
    FAULT = "fault"
    """The fault itself: no motor commands this direction, or a joint without torque yields."""
    WEIGHT = "weight"
    """Weight and motion alone: the arm cannot carry itself."""
    UNLIMITED = "unlimited"
    """No limit that is known."""


class FeasibleForces(NamedTuple):
    """The set ``{F₀ + Z z : lower ≤ rows (F₀ + Z z) ≤ upper}`` in weighted task coordinates.

    Attributes
    ----------
    F0 :
        Smallest force that balances the joints without torque, shape (m,).
    Z :
        Orthonormal basis of the plane, square to ``F0``, shape (m, d).
    rows :
        J_iᵀ of the joints whose limit is known, shape (k, m).
    lower, upper :
        Bounds on J_iᵀ F', which is the limit without weight and motion, shape (k,).
    joints :
        Indices of these joints.
    unbalanced :
        Torque at the joints without torque that no force at the tip balances, relative to the
        arm's weight and motion; 0 is ideal.
    rtol :
        What is smaller than this, relative, counts as zero.
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
    def stands_still(self) -> bool:
        """Whether some force at the tip balances the joints without torque."""
        return self.unbalanced <= self.rtol


class Weakest(NamedTuple):
    """The direction in which the least force can be held.

    Attributes
    ----------
    direction :
        Unit vector in weighted task coordinates, shape (m,).
    reach :
        How far it goes.
    """

    direction: Vector
    reach: Reach


class Reach(NamedTuple):
    """How far a ray ``s·d``, s ≥ 0, lies inside the feasible forces.

    Attributes
    ----------
    minimum, maximum :
        The interval of s; ``maximum`` is infinite if no known limit ends it, and smaller than
        ``minimum`` if nothing of the ray lies inside.
    limiting_joints :
        Indices of the joints whose limits end it.
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
    reading: LockModel = LockModel.COMMANDED,
) -> FeasibleForces:
    """Return the forces that can be held.

    Parameters
    ----------
    reduced :
        The decomposed Jacobians.
    rnea :
        Torques for weight and motion after the fault, shape (n,).
    largest :
        Largest torque of each motor, or brake of a locked joint, NaN where unknown, shape (n,);
        ``None`` counts none.
    reading :
        What a lock is taken for.
    """
    swinging = reduced.swinging
    F0, unbalanced = np.zeros(reduced.m), 0.0
    if swinging is not None:
        weight = norm(rnea)
        if norm(rnea[swinging.joints]) > _ROUNDING * weight:
            F0 = swinging.support(rnea)
            unbalanced = norm(swinging.unbalanced(rnea)) / weight
    if reading is LockModel.COMMANDED:
        Z = reduced.damaged.U[:, : reduced.rank_after]
    else:
        Z = np.eye(reduced.m) if swinging is None else swinging.U[:, swinging.rank :]
    scale = reduced.sigma_max
    if largest is None:
        none = np.zeros(0)
        return FeasibleForces(
            F0, Z, np.zeros((0, reduced.m)), none, none, [], unbalanced, reduced.rtol, scale
        )
    # NaN is unknown; 0 is a joint without torque, which is in F0 and Z.
    joints = (largest > 0.0).nonzero()[0]
    weights, limit = rnea[joints], largest[joints]
    rows, bounds, names = reduced.J.T[joints], (-limit - weights, limit - weights), joints.tolist()
    return FeasibleForces(F0, Z, rows, *bounds, names, unbalanced, reduced.rtol, scale)


def reach(feasible: FeasibleForces, d: Vector) -> Reach:
    """Return how far ``s·d``, s ≥ 0, is feasible: a ratio test, no solver.

    Parameters
    ----------
    feasible :
        The feasible forces.
    d :
        Direction in weighted task coordinates, shape (m,).
    """
    if not feasible.stands_still:
        return NOTHING
    least, most = _on_plane(feasible, d)
    if most < least or not feasible.joints:
        return Reach(least, most)
    lever = feasible.rows.dot(d)
    size = feasible.rtol * feasible.scale * norm(d)
    stops: tuple[int, ...] = ()
    ends = []
    bounds = (feasible.lower.tolist(), feasible.upper.tolist())
    rows = zip(feasible.joints, lever.tolist(), *bounds, strict=True)
    for joint, x, lower, upper in rows:
        if abs(x) <= size:  # the force does not load this joint: only its weight and motion do
            if lower > 0.0 or upper < 0.0:
                return NOTHING
            continue
        first, last = (lower / x, upper / x) if x > 0.0 else (upper / x, lower / x)
        least = max(least, first)
        ends.append((last, joint))
    if ends:
        nearest = min(end for end, _ in ends)
        if nearest < most:
            most = nearest
            stops = tuple(j for end, j in ends if end <= nearest + 1e-9 * abs(nearest))
    return Reach(least, most, stops)


def end_of(feasible: FeasibleForces, ray: Reach) -> LimitingFactor:
    """Return what ends a ray."""
    if ray.is_empty:
        balanced = feasible.stands_still and not feasible.F0.any()
        return LimitingFactor.WEIGHT if balanced else LimitingFactor.FAULT
    if ray.limiting_joints:
        return LimitingFactor.LIMIT
    return LimitingFactor.UNLIMITED if math.isinf(ray.maximum) else LimitingFactor.FAULT


def weakest_direction(feasible: FeasibleForces, space: Matrix) -> Weakest:
    """Return the direction of a space in which the smallest force ends the feasible ones.

    Parameters
    ----------
    feasible :
        The feasible forces.
    space :
        Orthonormal basis of the directions that count, shape (m, r); without any the first axis
        counts.
    """
    if not space.size:
        space = np.eye(len(space), 1)
    if not feasible.stands_still or feasible.F0.any():  # no force at all is not among them
        return Weakest(space[:, 0], NOTHING)
    missing = space - feasible.Z.dot(feasible.Z.T.dot(space))
    _, s, Vt = np.linalg.svd(missing)
    if s[0] > feasible.rtol:  # a direction of which nothing is left, either way along it
        direction = space.dot(Vt[0])
        largest = direction[int(np.argmax(np.abs(direction)))]
        direction = math.copysign(1.0, largest) * direction
        return Weakest(direction, reach(feasible, direction))  # 0, or nothing at all
    levers = feasible.rows.dot(space)
    size = np.sqrt(np.einsum("ij,ij->i", levers, levers))
    loaded = size > feasible.rtol * feasible.scale
    if not loaded.any():
        return Weakest(space[:, 0], reach(feasible, space[:, 0]))
    # The closest of the planes ``J_iᵀ F = bound``, both bounds of every joint.
    with np.errstate(over="ignore"):  # too far away for a number
        distance = np.minimum(feasible.upper, -feasible.lower) / np.where(loaded, size, 1.0)
    i = int(np.argmin(np.where(loaded, distance, math.inf)))
    sign = 1.0 if feasible.upper[i] <= -feasible.lower[i] else -1.0
    direction = sign * space.dot(levers[i] / size[i])
    return Weakest(direction, reach(feasible, direction))


def _on_plane(feasible: FeasibleForces, d: Vector) -> tuple[float, float]:
    """Return the interval of s for which ``s·d`` lies in the plane ``F₀ + Z z``."""
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
