"""Map between the joint positions of a chain and the configuration of its Pinocchio model.

Pinocchio represents a continuous joint by two coordinates (cos, sin) and treats mimic joints as
independent. The joint positions of the model are ``G q + g0``, with one row per model joint: a
leader has a 1 in its own column, a follower its multiplier in the leader's column. Torques and
Jacobians of the model map back to the chain as ``Gᵀ τ`` and ``J G``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Matrix, Vector

Indices: TypeAlias = "NDArray[np.intp]"


class Coordinates(NamedTuple):
    """Affine map from the joint positions of the chain to the model.

    Attributes
    ----------
    G :
        Linear part, shape (model.nv, n).
    offset :
        Constant part g0, rad or m, shape (model.nv,).
    plain_v, plain_q :
        Velocity and configuration indices of joints with one coordinate.
    circle_v, circle_q :
        Velocity index and index of the cosine of continuous joints; the sine follows the cosine.
    nq :
        Dimension of the model's configuration.
    is_identity :
        Whether the model's configuration equals the chain's joint positions.
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
        """Return the model configuration, shape (nq,).

        Parameters
        ----------
        q :
            Joint positions along the chain, rad or m, shape (n,).
        """
        if self.is_identity:
            return q
        angles = self.G.dot(q) + self.offset
        configuration = np.empty(self.nq)
        configuration[self.plain_q] = angles[self.plain_v]
        circle = angles[self.circle_v]
        configuration[self.circle_q] = np.cos(circle)
        configuration[self.circle_q + 1] = np.sin(circle)
        return configuration

    def to_models(self, q: Matrix) -> Matrix:
        """Return the model configurations of N postures, shape (N, nq).

        Parameters
        ----------
        q :
            Joint positions along the chain, rad or m, shape (N, n).
        """
        return q if self.is_identity else np.array([self.to_model(one) for one in q])

    def fold(self, J: Matrix) -> Matrix:
        """Map a Jacobian of the model to the chain, J G, shape (..., n).

        Parameters
        ----------
        J :
            Jacobian of the model, shape (..., nv).
        """
        if len(self.G) == 1:
            J = J.reshape(-1, 1)  # Pinocchio returns a single column as a vector
        if self.is_identity:
            return J
        folded: Matrix = J.dot(self.G)
        return folded

    def fold_torque(self, torque: Vector) -> Vector:
        """Map torques of the model to the chain, Gᵀ τ, shape (n,); followers load their leaders.

        Parameters
        ----------
        torque :
            Torques of the model, N·m or N, shape (nv,).
        """
        if self.is_identity:
            return torque.copy()  # the input is a view of Pinocchio's data
        folded: Vector = torque.dot(self.G)
        return folded

    def rate(self, v: Vector) -> Vector:
        """Map joint velocities or accelerations of the chain to the model, G v, shape (nv,).

        Parameters
        ----------
        v :
            Joint velocities or accelerations along the chain, shape (n,).
        """
        return v if self.is_identity else self.G.dot(v)
