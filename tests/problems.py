"""Random problems with limits, and independent answers: quadprog's and HiGHS's.

Nothing here knows of ftforce's parametrisation. A problem is written down as the theory has it:
equations and inequalities for the force F' itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import quadprog
from scipy.optimize import linprog

from ftforce.core.bounded_remap import bounded_remap
from ftforce.core.reduced_jacobian import RTOL

INDEPENDENT = 1e-7  # of equations with unit normals: what is less independent says nothing new


class Problem(NamedTuple):
    """What `bounded_remap` is asked: NaN is an unknown limit."""

    J: Any
    tau: Any
    locked: Any
    free: Any
    limits: Any
    rnea: Any

    @property
    def scale(self):
        """σ_max(J)."""
        return np.linalg.norm(self.J, 2)

    def remap(self, **changes):
        """Ask ftforce."""
        return bounded_remap(**{**self._asdict(), **changes})


class Space(NamedTuple):
    """``{F : E F = e, low ≤ A F ≤ high}``; joints names the rows of A.

    Some force that keeps the equations loads the joints that are loaded; the torque of others is
    the offset.
    """

    E: Any
    e: Any
    A: Any
    low: Any
    high: Any
    joints: Any
    loaded: Any
    offset: Any


# ---- drawing ---------------------------------------------------------------------------------


def draw_jacobian(rng, m, n):
    """Draw a Jacobian: generic, of integers, deficient, with parallel columns, with tiny ones."""
    kind = rng.choice(["generic", "integers", "deficient", "parallel", "tiny"])
    J = rng.normal(size=(m, n))
    if kind == "integers":
        J = rng.integers(-2, 3, size=(m, n)).astype(float)
    if kind == "deficient":
        rank = rng.integers(0, min(m, n) + 1)
        J = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    if kind == "parallel" and n > 1:
        one, other = rng.choice(n, 2, replace=False)
        J[:, one] = rng.choice([-2.0, 0.5, 1.0]) * J[:, other]
    if kind == "tiny":
        J[:, rng.integers(n)] *= rng.choice([1e-3, 1e-9, 1e-12, 0.0])
    return J * rng.choice([1.0, 1.0, 1e-3, 1e3])


def draw_problem(rng, m=None, n=None):
    """Draw a problem with up to 6 rows and 10 joints: locked, free, weak, limits, brakes, rnea."""
    m, n = m or int(rng.integers(1, 7)), n or int(rng.integers(1, 11))
    J = draw_jacobian(rng, m, n)
    state = rng.choice(["sound", "locked", "free", "weak"], size=n, p=[0.55, 0.2, 0.1, 0.15])
    limits = 10.0 ** rng.uniform(-1.0, 2.5, size=n)
    if rng.random() < 0.3:
        limits = np.full(n, rng.choice([5.0, 10.0]))
    limits[state == "weak"] *= rng.choice([0.01, 0.3, 1.0])
    limits[rng.random(n) < 0.25] = np.nan
    if rng.random() < 0.5:
        limits[state == "locked"] = np.nan  # brakes are seldom known
    rnea = rng.normal(size=n) * rng.choice([0.0, 0.1, 3.0, 30.0])
    tau = rng.normal(size=n) * 10.0 ** rng.uniform(-1.0, 3.0)
    if rng.random() < 0.5:
        tau = J.T @ (rng.normal(size=m) * 10.0 ** rng.uniform(-1.0, 3.0))
    if rng.random() < 0.05:
        tau = np.zeros(n)
    return Problem(J, tau, state == "locked", state == "free", limits, rnea)


def draw_extreme_problem(rng):
    """Draw a problem as no arm has it: limits, forces and lengths of 18 and more decades."""
    many = rng.random() < 0.05
    problem = draw_problem(rng, n=100 if many else None)
    limits, n = problem.limits.copy(), len(problem.limits)
    kind = rng.choice(["plain", "plain", "spread", "some", "all"])
    if kind == "spread":
        limits *= 10.0 ** rng.uniform(-9.0, 9.0, size=n)
    if kind == "some":
        limits[rng.random(n) < 0.3] = rng.choice([1e-300, 1e149])
    if kind == "all":
        limits[~np.isnan(limits)] = rng.choice([1e-300, 1e149, 1e-12])
    return problem._replace(
        J=problem.J * rng.choice([1.0, 1.0, 1e-9, 1e9]),
        tau=problem.tau * rng.choice([1.0, 1.0, 1e6, 1e12]),
        rnea=problem.rnea * rng.choice([1.0, 1.0, 1e-6, 1e3]),
        free=problem.free & (rng.random(n) < 0.1 if many else np.True_),
        limits=limits,
    )


# ---- answers ---------------------------------------------------------------------------------


def space_of(problem, *, held=False):
    """Return the forces that can be held; ``None`` if joints without torque have no balance."""
    J, scale = problem.J, problem.scale or 1.0
    m = len(J)
    equations, sides = [np.zeros((0, m))], [np.zeros(0)]
    if not held:  # no force along what the joints that are left do not move
        U, s, _ = np.linalg.svd(J[:, ~problem.locked] / scale)
        lost = U[:, np.count_nonzero(s > RTOL) :]
        equations.append(lost.T)
        sides.append(np.zeros(lost.shape[1]))
    if problem.free.any():
        U, s, Vt = np.linalg.svd(J[:, problem.free].T / scale)
        side = U.T @ (-problem.rnea[problem.free] / scale)
        rank = np.count_nonzero(s > RTOL)
        if np.linalg.norm(side[rank:]) * scale > RTOL * np.linalg.norm(problem.rnea):
            return None
        equations.append(Vt[:rank])
        sides.append(side[:rank] / s[:rank])
    U, s, Vt = np.linalg.svd(np.vstack(equations))
    rank = np.count_nonzero(s > INDEPENDENT)
    E, e = Vt[:rank], (U.T @ np.concatenate(sides))[:rank] / s[:rank]
    known = (problem.limits < 1e100) & ~problem.free
    limits, rnea = problem.limits[known], problem.rnea[known]
    A, joints = J.T[known], np.flatnonzero(known)
    loaded = np.linalg.norm(A @ Vt[rank:].T, axis=1) > RTOL * problem.scale
    return Space(E, e, A, -limits - rnea, limits - rnea, joints, loaded, A @ (E.T @ e))


def nearest_by_quadprog(problem, F, space):
    """Return the feasible force closest to F, ``None`` if quadprog finds none."""
    if space is None:
        return None
    loaded = space.loaded
    if np.any(((space.offset > space.high) | (space.offset < space.low))[~loaded]):
        return None
    length = np.linalg.norm(space.A[loaded], axis=1)
    A = space.A[loaded] / length[:, None]
    low, high = space.low[loaded] / length, space.high[loaded] / length
    C = np.vstack([space.E, A, -A])
    b = np.concatenate([space.e, low, -high])
    if not len(C):
        return F
    size = max(np.abs(F).max(), np.abs(b).max()) or 1.0
    try:
        return size * quadprog.solve_qp(np.eye(len(F)), F / size, C.T, b / size, len(space.E))[0]
    except ValueError:  # constraints are inconsistent
        return None


def margin_by_highs(problem):
    """Return the share of every limit that can be left free at once; negative if infeasible."""
    space = space_of(problem)
    if space is None:
        return -np.inf
    if not len(space.A):
        return np.inf
    width = 0.5 * (space.high - space.low)
    rows = np.vstack([space.A, -space.A]) / np.concatenate([width, width])[:, None]
    sides = np.concatenate([space.high, -space.low]) / np.concatenate([width, width])
    unit = 1.0 / (np.abs(rows).max() or 1.0)  # of force: HiGHS drops small coefficients
    m = len(problem.J)
    found = linprog(
        np.append(np.zeros(m), -1.0),
        A_ub=np.column_stack([unit * rows, np.ones(len(rows))]),
        b_ub=sides,
        A_eq=np.column_stack([space.E, np.zeros(len(space.E))]),
        b_eq=space.e / unit,
        bounds=[(None, None)] * m + [(None, 1.0)],
    )
    return found.x[-1] if found.status == 0 else -np.inf


def beyond(problem, F, space, *, size):
    """Return how far a force's torques lie beyond limits, in shares of them; rounding apart.

    What rtol takes for no lever may still be one with large forces, and is forgiven.
    """
    forgiven = np.where(space.loaded, 1e-14, RTOL) * problem.scale * size
    forgiven += 1e-14 * np.linalg.norm(problem.rnea)
    torque = space.A @ F
    over = np.maximum(torque - space.high, space.low - torque) - forgiven
    limits = problem.limits[space.joints]
    return max(0.0, *(over / (limits + forgiven)), 0.0)


def ray_by_highs(problem, d, *, held=False, most=None):
    """Return the least and the largest s ≥ 0 with s·d feasible, ``None`` if there is none.

    Levers and angles up to rtol count as zero, as everywhere.
    """
    space = space_of(problem, held=held)
    if space is None:
        return None
    lever, aside = space.A @ d, space.E @ d
    lever[np.abs(lever) <= RTOL * problem.scale * np.linalg.norm(d)] = 0.0
    if np.linalg.norm(aside) <= RTOL * np.linalg.norm(d):
        aside[:] = 0.0
    length = np.where(lever == 0.0, 1.0, np.abs(lever))  # HiGHS drops small coefficients
    rows = np.concatenate([lever / length, -lever / length])[:, None]
    sides = np.concatenate([space.high / length, -space.low / length])
    ends = []
    for sign in (1.0, -1.0):  # least, most
        found = linprog(
            [sign],
            A_ub=rows,
            b_ub=sides,
            A_eq=aside[:, None] / (np.linalg.norm(aside) or 1.0),
            b_eq=space.e / (np.linalg.norm(aside) or 1.0),
            bounds=[(0.0, most)],
        )
        if found.status == 2:
            return None
        ends.append(np.inf if found.status == 3 else found.x[0])
    return tuple(ends)
