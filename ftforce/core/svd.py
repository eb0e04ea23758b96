"""Singular value decomposition of small matrices, by Eigen's Jacobi SVD."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from eigenpy import ColPivHhJacobiSVD, DecompositionOptions

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix, Vector

_THIN_U_FULL_V = int(DecompositionOptions.ComputeThinU | DecompositionOptions.ComputeFullV)


class Svd:
    """Singular value decomposition ``A = U[:, :r] diag(s[:r]) Vᵀ`` by Jacobi rotations.

    Eigen's two-sided Jacobi SVD is used instead of LAPACK's divide and conquer because it computes
    small singular values, on which rank decisions depend, to high relative accuracy, and because a
    manipulator Jacobian takes 1.5 µs from Python instead of 8.5 µs. The decomposition is done in a
    workspace cached per thread and shape, which keeps V.

    Parameters
    ----------
    A :
        Finite matrix, shape (m, n).

    Attributes
    ----------
    A :
        The matrix, shape (m, n).
    U :
        All left singular vectors, shape (m, m).
    s :
        Singular values in descending order, padded with zeros to length m.
    """

    __slots__ = ("A", "U", "_count", "_workspace", "s")

    def __init__(self, A: Matrix, *, left_only: bool = False) -> None:
        m, n = A.shape
        self.A = A
        self._workspace = workspace = _workspace(A.shape, left_only)
        self._count = workspace.decompose(A)
        U = workspace.left_vectors()
        self.U = U if U.ndim == 2 else U.reshape(m, m)  # eigenpy returns a 1 x 1 matrix as a vector
        self.s: list[float] = workspace.solver.singularValues().tolist()
        if n < m:
            self.s += [0.0] * (m - n)

    def rank(self, threshold: float) -> int:
        """Return the number of singular values above ``threshold``.

        Parameters
        ----------
        threshold :
            Singular values up to it count as zero.
        """
        rank = len(self.s)
        while rank and self.s[rank - 1] <= threshold:
            rank -= 1
        return rank

    def solve_transposed(self, tau: Vector, rtol: float) -> Vector:
        """Return (Aᵀ)† tau, shape (m,); singular values up to ``rtol · s[0]`` count as zero.

        Parameters
        ----------
        tau :
            Right-hand side, shape (n,).
        rtol :
            Tolerance, relative to the largest singular value.
        """
        workspace = _workspace(self.A.shape, False)
        if workspace is not self._workspace or workspace.count != self._count:
            workspace.decompose(self.A)  # it has been used for another matrix since
        # Eigen keeps a singular value equal to the threshold; here it counts as zero.
        workspace.solver.setThreshold(rtol * (1.0 + 1e-15))
        F: Vector = workspace.solver.solve(tau)
        return F if F.ndim == 1 else F.reshape(-1)

    def solve(self, x: Vector, rank: int) -> Vector:
        """Return A† x, using the first ``rank`` singular values, shape (n,).

        Parameters
        ----------
        x :
            Right-hand side, shape (m,).
        rank :
            Number of singular values to use.
        """
        # V comes from a separate decomposition: Aᵀ U / s loses accuracy where s is small.
        decomposition = ColPivHhJacobiSVD(self.A.T, _THIN_U_FULL_V)
        U, V = decomposition.matrixV(), decomposition.matrixU()
        y = x.dot(U.reshape(len(x), -1)[:, :rank]) / self.s[:rank]
        v: Vector = V.reshape(len(V), -1)[:, :rank].dot(y)
        return v

    def project(self, x: Vector, rank: int) -> Vector:
        """Return A A† x, the projection of x onto the first ``rank`` left singular vectors.

        Parameters
        ----------
        x :
            Vector, shape (m,).
        rank :
            Number of singular vectors to project onto.
        """
        U = self.U[:, :rank]
        kept: Vector = U.dot(x.dot(U))
        return kept

    def project_out(self, x: Vector, rank: int) -> Vector:
        """Return (I - A A†) x, the projection of x onto the other left singular vectors.

        Parameters
        ----------
        x :
            Vector, shape (m,).
        rank :
            Number of singular vectors to exclude.
        """
        U = self.U[:, rank:]
        lost: Vector = U.dot(x.dot(U))
        return lost

    def __reduce__(self) -> tuple[type[Svd], tuple[Matrix]]:
        """Pickle the matrix only; the decomposition is recomputed."""
        return Svd, (self.A,)


class _Workspace:
    """Reusable Eigen solver for matrices of one shape; counts its decompositions.

    It decomposes Aᵀ, to solve for forces, or A itself if only U and s are needed.
    """

    __slots__ = ("count", "left_only", "solver")

    def __init__(self, shape: tuple[int, ...], left_only: bool) -> None:
        m, n = shape
        self.left_only = left_only
        self.solver = (
            ColPivHhJacobiSVD(m, n, int(DecompositionOptions.ComputeFullU))
            if left_only
            else ColPivHhJacobiSVD(n, m, _THIN_U_FULL_V)
        )
        self.count = 0

    def decompose(self, A: Matrix) -> int:
        self.solver.compute(A if self.left_only else A.T)
        self.count += 1
        return self.count

    def left_vectors(self) -> Matrix:
        U: Matrix = self.solver.matrixU() if self.left_only else self.solver.matrixV()
        return U


class _Workspaces(threading.local):
    def __init__(self) -> None:
        self.by_shape: dict[tuple[tuple[int, ...], bool], _Workspace] = {}


_workspaces = _Workspaces()


def _workspace(shape: tuple[int, ...], left_only: bool) -> _Workspace:
    key = (shape, left_only)
    workspace = _workspaces.by_shape.get(key)
    if workspace is None:
        workspace = _workspaces.by_shape[key] = _Workspace(shape, left_only)
    return workspace
