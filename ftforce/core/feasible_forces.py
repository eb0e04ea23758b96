"""The set of forces F' that a damaged arm can hold at its tip (docs/theory/limits).

Motors, brakes and free-swinging joints each constrain ``τ = rnea + JᵀF'``:

    F' in range(K)                        commandable by the motors (lock model *commanded* only)
    [rnea]_k + J_kᵀ F' = 0                 free-swinging joint k with a lever
    -ε_k ≤ [rnea]_k + J_kᵀ F' ≤ ε_k        free-swinging joint k without one: friction bears it
    -limit_i ≤ [rnea]_i + J_iᵀ F' ≤ limit_i   motor or brake i with a known limit

The equality constraints define an affine subspace, ``F' = F₀ + Z z``; the inequalities bound a
polytope in it. The lock model *held* drops the first constraint: locked joints carry existing load.

Whether a free-swinging joint has a lever depends on what is asked: for a force of any direction it
is the singular values of the columns J_S that count (theory §4), for one given force, the lever of
that force, J_kᵀ F'. A force without a lever at any of these joints is held by their friction.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import norm
from ftforce.core.limits import both_sides
from ftforce.errors import UnknownNameError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.core.reduced_jacobian import ReducedJacobian


_ROUNDING = 1e-12  # smaller torques, relative to the arm's, count as zero
SLIGHT = 1e-3  # of the friction of a joint: its weight asks for no force at the tip
SHARE_OF_WEIGHT = 1e-3  # of the largest weight torque: friction of a joint of unknown friction


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
    FRICTION = "friction"
    """The friction of a free-swinging joint, which yields beyond it."""


class Bearings(NamedTuple):
    """Free-swinging joints as they bear a tip force, with their friction.

    Attributes
    ----------
    joints :
        Indices of the f joints, from 0.
    rows :
        J_kᵀ of these joints, shape (f, m).
    weight :
        Their gravity and motion torques, shape (f,).
    unbalanced :
        The part of them that no tip force can balance, shape (f,): for joints with friction, the
        torque where the row is zero.
    friction :
        ε, the largest torque that friction bears, shape (f,).
    rounding :
        Torque that counts as zero.
    shortest :
        Torque per unit of force, up to which a force has no lever at these joints.
    is_ideal :
        Whether none of them has friction.
    """

    joints: list[int]
    rows: Matrix
    weight: Vector
    unbalanced: Vector
    friction: Vector
    rounding: float
    shortest: float
    is_ideal: bool

    @property
    def is_balanced(self) -> bool:
        """Whether some tip force, or friction, balances these joints."""
        if self.is_ideal:
            return norm(self.unbalanced) <= self.rounding
        return bool((np.abs(self.unbalanced) <= self.friction).all())

    @property
    def is_at_rest(self) -> bool:
        """Whether friction bears the weight, so that these joints need no tip force."""
        return bool((np.abs(self.weight) <= self.friction).all())

    def bears(self, F: Vector) -> bool:
        """Return whether friction bears a force as it is: it has no lever, and they are at rest.

        Parameters
        ----------
        F :
            Weighted force, shape (m,).
        """
        if self.is_ideal:
            return False
        lever = self.rows.dot(F)
        borne = np.abs(lever + self.weight) <= self.friction
        return bool((borne & (np.abs(lever) <= self.shortest * norm(F))).all())

    def torque(self, F: Vector) -> Vector:
        """Return the torque that is left for friction, [rnea]_S + J_Sᵀ F', shape (f,).

        Parameters
        ----------
        F :
            Weighted force, shape (m,).
        """
        lever = self.rows.dot(F)
        left = lever + self.weight
        size = np.abs(lever) + np.abs(self.weight)
        return np.where(np.abs(left) > _ROUNDING * size, left, 0.0)

    def interval(self, d: Vector, shortest: float) -> Reach:
        """Return the range of s, s ≥ 0, in which these joints bear ``s·d``.

        Parameters
        ----------
        d :
            Direction in weighted task coordinates, shape (m,).
        shortest :
            Levers of at most this size do not count.
        """
        lever, ray = self.rows.dot(d), Reach(0.0, math.inf)
        long = np.abs(lever) > self.shortest * norm(d)
        if long.any():
            ray = self._balanced(lever, long)
        for k in np.flatnonzero(~long).tolist():
            ray = ray.within(self._borne(k, float(lever[k]), shortest))
        return ray

    def _balanced(self, lever: Vector, long: Mask) -> Reach:
        """Return the range in which the force balances joints with a lever: one point, or none.

        It solves [rnea]_k + s J_kᵀ d = 0. Without a force, friction alone may bear the weight.
        """
        size = float(np.abs(lever[long]).max())
        x, w, most = lever[long] / size, self.weight[long], self.friction[long]
        w = np.where(np.abs(w) <= SLIGHT * most, 0.0, w) / size
        s = -float(x.dot(w) / x.dot(x)) + 0.0
        if s < 0.0 or (np.abs(s * x + w) * size > most).any():
            return Reach(0.0, 0.0) if self.is_at_rest else NOTHING
        return Reach(s, s)

    def _borne(self, k: int, x: float, shortest: float) -> Reach:
        """Return the range in which friction bears what a force with the lever x leaves."""
        w, most = float(self.weight[k]), float(self.friction[k])
        if abs(x) <= shortest:
            return Reach(0.0, math.inf) if abs(w) <= most else NOTHING
        first, last = sorted(((-most - w) / x, (most - w) / x))
        return Reach(first, last, (self.joints[k],))


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
        Indices of these joints, from 0. The last ones, if free-swinging joints lack a lever, are
        these, with their friction as limit.
    rtol :
        Relative tolerance below which values count as zero.
    scale :
        σ_max(J).
    bearings :
        The free-swinging joints; ``None`` if there are none.
    fixed :
        Orthonormal basis of the forces that the free-swinging joints determine, to which F₀
        belongs, shape (m, r).
    """

    F0: Vector
    Z: Matrix
    rows: Matrix
    lower: Vector
    upper: Vector
    joints: list[int]
    rtol: float
    scale: float
    bearings: Bearings | None
    fixed: Matrix

    @property
    def is_balanced(self) -> bool:
        """Whether some tip force balances the free-swinging joints, so that the arm can be held."""
        return self.bearings is None or self.bearings.is_balanced

    @property
    def is_at_rest(self) -> bool:
        """Whether the free-swinging joints, if any, need no force at the tip."""
        return self.bearings is None or self.bearings.is_at_rest

    def without_friction(self, joints: Iterable[int]) -> tuple[int, ...]:
        """Return the joints whose limit is that of a motor or brake.

        Parameters
        ----------
        joints :
            Indices of joints, free-swinging ones among them.
        """
        free = () if self.bearings is None else self.bearings.joints
        return tuple(j for j in joints if j not in free)


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

    def within(self, other: Reach) -> Reach:
        """Return the part that is in another range too.

        Parameters
        ----------
        other :
            The other range.
        """
        nearest = other if other.maximum < self.maximum else self
        return Reach(max(self.minimum, other.minimum), nearest.maximum, nearest.limiting_joints)


NOTHING = Reach(0.0, -1.0)


def feasible_forces(
    reduced: ReducedJacobian,
    rnea: Vector,
    largest: Vector | None,
    lock_model: LockModel = LockModel.COMMANDED,
    *,
    balance: float | None = None,
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
        (n,), or lower and upper limits, shape (2, n). ``None`` applies no limits.
    lock_model :
        How locked joints are modelled.
    balance :
        Torques at free-swinging joints up to this share of ‖rnea‖ count as balanced; by default
        the rank tolerance.
    """
    free, m, bearings = reduced.free, reduced.m, None
    F0, fixed = np.zeros(m), np.zeros((m, 0))
    if free is not None:
        bearings = _bearings(reduced, rnea, reduced.rtol if balance is None else balance)
        fixed = free.U[:, : free.rank]
        if bearings.weight.any():
            F0 = free.support(bearings.weight)
    if lock_model is LockModel.COMMANDED:
        Z = reduced.damaged.U[:, : reduced.rank_after]
    else:
        Z = np.eye(m) if free is None else free.U[:, free.rank :]
    if largest is None:
        rows, lower, upper = np.zeros((0, m)), np.zeros(0), np.zeros(0)
        joints: list[int] = []
    else:
        # NaN is unknown; 0 is a free-swinging joint.
        least, most = both_sides(largest)
        known = (most > least).nonzero()[0]
        weights = rnea[known]
        rows, lower, upper = reduced.J.T[known], least[known] - weights, most[known] - weights
        joints = known.tolist()
    if bearings is not None and not bearings.is_ideal and fixed.shape[1] < len(bearings.joints):
        rows = np.concatenate([rows, bearings.rows])
        lower = np.concatenate([lower, -bearings.friction - bearings.weight])
        upper = np.concatenate([upper, bearings.friction - bearings.weight])
        joints = joints + bearings.joints
    return FeasibleForces(
        F0, Z, rows, lower, upper, joints, reduced.rtol, reduced.sigma_max, bearings, fixed
    )


def _bearings(reduced: ReducedJacobian, rnea: Vector, balance: float) -> Bearings:
    """Return the free-swinging joints under their gravity and motion torques."""
    free = reduced.free
    assert free is not None
    joints, given, whole, scale = free.joints, free.given, norm(rnea), reduced.sigma_max
    weight = rnea[joints]
    weight[np.abs(weight) <= _ROUNDING * whole] = 0.0
    rounding, least = balance * whole, reduced.rtol * scale
    friction = np.maximum(friction_under(given.friction, rnea)[joints], rounding)
    rows = reduced.J.T[joints]
    if given.is_ideal:
        unbalanced = free.without_lever(weight, least)
    else:
        unbalanced = np.where(np.vecdot(rows, rows) <= least * least, weight, 0.0)
    shortest = least if given.is_ideal else given.lever * scale
    return Bearings(joints, rows, weight, unbalanced, friction, rounding, shortest, given.is_ideal)


def friction_under(friction: Vector, rnea: Vector) -> Vector:
    """Return the torque that friction bears, with a share of the weight where it is unknown.

    Parameters
    ----------
    friction :
        N·m (N), NaN where unknown, shape (n,).
    rnea :
        Gravity and motion torques, shape (n,).
    """
    unknown = np.isnan(friction)
    if True in unknown.tolist():
        return np.where(unknown, SHARE_OF_WEIGHT * np.abs(rnea).max(), friction)
    return friction


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
    size = feasible.rtol * feasible.scale * norm(d)
    ray = Reach(0.0, _on_plane(feasible, d))
    if feasible.bearings is not None:
        ray = ray.within(feasible.bearings.interval(d, size))
    return ray if ray.is_empty or not feasible.joints else ray.within(_limits(feasible, d, size))


def _limits(feasible: FeasibleForces, d: Vector, size: float) -> Reach:
    """Return the range of ``s·d`` within the limits; levers of at most ``size`` do not count."""
    lever = feasible.rows.dot(d)
    minimum, ends = 0.0, []
    motors = len(feasible.without_friction(feasible.joints))  # free-swinging joints come last
    bounds = (feasible.lower.tolist(), feasible.upper.tolist())
    rows = zip(feasible.joints[:motors], lever.tolist(), *bounds, strict=False)
    for joint, x, lower, upper in rows:
        if abs(x) <= size:  # the force does not load this joint
            if lower > 0.0 or upper < 0.0:
                return NOTHING
            continue
        first, last = (lower / x, upper / x) if x > 0.0 else (upper / x, lower / x)
        minimum = max(minimum, first)
        ends.append((last, joint))
    if not ends:
        return Reach(minimum, math.inf)
    nearest = min(end for end, _ in ends)
    limit = nearest + 1e-9 * abs(nearest)  # joints that reach their limits together
    return Reach(minimum, nearest, tuple(joint for end, joint in ends if end <= limit))


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
        return LimitingFactor.WEIGHT if feasible.is_at_rest else LimitingFactor.FAULT
    if ray.limiting_joints:
        is_limit = feasible.without_friction(ray.limiting_joints)
        return LimitingFactor.LIMIT if is_limit else LimitingFactor.FRICTION
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
    if not feasible.is_at_rest:  # zero force is not feasible
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


def _on_plane(feasible: FeasibleForces, d: Vector) -> float:
    """Return the largest s for which the motors, or brakes, can exert ``s·d`` at all."""
    Z, fixed = feasible.Z, feasible.fixed
    if Z.shape[1] == len(d):
        return math.inf
    beyond = d - Z.dot(d.dot(Z))
    if fixed.size:  # along these the free-swinging joints decide
        beyond -= fixed.dot(beyond.dot(fixed))
    return math.inf if norm(beyond) <= feasible.rtol * norm(d) else 0.0
