"""Between the chain's n numbers and the configuration of its Pinocchio model.

Pinocchio gives a continuous joint two numbers (cos, sin) and leaves mimic joints free. The model's
joint angles are ``G q + g0`` with one row per model joint: a leader has a 1 in its column, its
followers their multipliers. So torques and Jacobian columns fold as ``Gᵀ τ`` and ``J G``: the
column of a follower belongs to its leader.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector

Indices: TypeAlias = NDArray[np.intp]


class Coordinates(NamedTuple):
    """The map from the chain to the model.

    Attributes
    ----------
    G :
        Shape (model.nv, n).
    offset :
        g0, shape (model.nv,), rad or m.
    plain_v, plain_q :
        Velocity and configuration indices of joints with one number.
    circle_v, circle_q :
        Velocity index, and index of the cosine, of continuous joints; the sine follows it.
    nq :
        Size of the model's configuration.
    is_identity :
        Whether the model's configuration is the chain's.
    """

    G: Matrix
    offset: Vector
    plain_v: Indices
    plain_q: Indices
    circle_v: Indices
    circle_q: Indices
    nq: int
    is_identity: bool

    def to_model(self, q: Vector) -> Vector:
        """Return the model's configuration, shape (nq,)."""
        if self.is_identity:
            return q
        angles = self.G.dot(q) + self.offset
        configuration = np.empty(self.nq)
        configuration[self.plain_q] = angles[self.plain_v]
        circle = angles[self.circle_v]
        configuration[self.circle_q] = np.cos(circle)
        configuration[self.circle_q + 1] = np.sin(circle)
        return configuration

    def fold(self, J: Matrix) -> Matrix:
        """Return the chain's columns of a Jacobian of the model, shape (..., n)."""
        if len(self.G) == 1:
            J = J.reshape(-1, 1)  # Pinocchio returns a single column as a vector
        if self.is_identity:
            return J
        folded: Matrix = J.dot(self.G)
        return folded

    def fold_torque(self, torque: Vector) -> Vector:
        """Return the chain's torques of the model's, Gᵀ τ, shape (n,): followers load leaders."""
        if self.is_identity:
            return torque.copy()  # it is a view of Pinocchio's workspace
        folded: Vector = torque.dot(self.G)
        return folded

    def rate(self, v: Vector) -> Vector:
        """Return the model's velocities or accelerations of the chain's, G v, shape (nv,)."""
        return v if self.is_identity else self.G.dot(v)
