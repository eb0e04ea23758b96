"""Many postures at once: locked joints with torque limits in force.

Where the closed form exceeds no limit, it is the answer. Elsewhere the feasible force closest to it
is sought by adding the most exceeded limit to those that bind, and dropping those that would pull
the wrong way, for a whole stack at once. A force that satisfies the conditions of optimality (KKT)
is the only one; where the limits that bind exclude each other (Farkas' lemma), there is none. What
is decided by neither, or has a torque within rounding error of its limit, is left to
`ftforce.core.bounded_remap`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.stacks import LEAST_MARGIN, Cells
from ftforce.core.verdict import CODES, Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector

_ROUNDING = 1e-12  # relative to a torque and its limit
_NEAR = 1e-6  # of a tolerance: closer values are not decided here
_ROUNDS = 12  # limits that are added before a cell is given up
_INDEPENDENT = 1e-8  # least determinant of the normals of the limits that bind


def within_limits(
    cells: Cells,
    J: NDArray[np.float64],
    rnea: NDArray[np.float64],
    largest: Matrix,
    *,
    locked: Mask,
    F: Vector | None,
    rtol: float,
    wary: float,
    middle: Matrix | None = None,
) -> Cells:
    """Return verdicts and force jumps within torque limits, wherever they are certain.

    Parameters
    ----------
    cells :
        The answers without limits, from `cells_of`.
    J, locked, F, rtol, wary :
        As in `cells_of`.
    rnea, largest, middle :
        As in `reach_of`.

    Returns
    -------
    :
        The cells; their jump is NaN where no force can be held.
    """
    after = (0.0 if F is None else F) - cells.jump  # the closed form, (N, S, m)
    torque = rnea + after @ J  # (N, S, n)
    rest = torque if middle is None else torque - middle
    with np.errstate(over="ignore"):
        beyond = np.abs(rest) - largest  # NaN where unknown
        slack = _ROUNDING * (np.abs(rnea) + np.abs(torque) + np.abs(torque - rest) + largest)
    certain = cells.certain & ~(np.abs(beyond) <= slack).any(axis=2)
    rows = np.nonzero(certain & (beyond > 0.0).any(axis=2))
    found = cells._replace(certain=certain, jump=cells.jump.copy(), verdict=cells.verdict.copy())
    if len(rows[0]):
        _fill_binding(
            found,
            rows,
            after[rows],
            J=J[rows[0]],
            load=np.broadcast_to(rnea, torque.shape)[rows],
            limit=np.broadcast_to(largest, torque.shape)[rows],
            middle=0.0 if middle is None else np.broadcast_to(middle, torque.shape)[rows],
            locked=locked[rows[1]],
            F=F,
            rtol=rtol,
            wary=wary,
        )
    return found


def _fill_binding(
    cells: Cells,
    rows: tuple[NDArray[np.intp], ...],
    closed: Matrix,
    *,
    J: NDArray[np.float64],
    load: Matrix,
    limit: Matrix,
    middle: Matrix | float,
    locked: Mask,
    F: Vector | None,
    rtol: float,
    wary: float,
) -> None:
    """Complete cells in which a limit binds, in place."""
    rest = load - middle
    scale = cells.scale[rows[0]]
    A = J.swapaxes(1, 2).copy()  # (c, n, m)
    lost = cells.margin[rows] < LEAST_MARGIN
    if lost.any():  # F' in range(K): the rows within it
        U, s, _ = np.linalg.svd(J[lost] * ~locked[lost, None])
        s = np.pad(s, ((0, 0), (0, U.shape[1] - s.shape[1])))
        U = U * (s > 0.5 * LEAST_MARGIN * scale[lost, None])[:, None]
        A[lost] = A[lost] @ (U @ U.swapaxes(1, 2))
    lever, least = np.linalg.norm(A, axis=2), (rtol * scale)[:, None]
    known = limit > 0.0
    short = known & (lever <= least)  # no force changes these torques
    bears = known & ~short
    lever[~bears] = np.inf
    with np.errstate(over="ignore"):
        lower = np.where(bears, (-limit - rest) / lever, -np.inf)
        upper = np.where(bears, (limit - rest) / lever, np.inf)
        slack = np.where(bears, (limit + np.abs(load) + np.abs(rest)) / lever, 0.0)
    slack = _ROUNDING * (slack + np.abs(closed).max(axis=1)[:, None])
    nearest, solved, empty = _nearest(A / lever[..., None], lower, upper, closed, slack)
    is_held = ~(empty | (short & (np.abs(rest) > limit)).any(axis=1))
    jump = np.where(is_held[:, None], closed - nearest + cells.jump[rows], np.nan)
    relative = _relative(jump, F, scale, load)
    code = np.full(len(jump), CODES[Verdict.BORDERLINE], dtype=np.int8)
    code[relative <= rtol] = CODES[Verdict.TOLERATED]
    code[(relative > wary) | ~is_held] = CODES[Verdict.NOT_TOLERATED]
    if F is None:
        code = np.maximum(code, cells.verdict[rows])  # also if a direction is lost
    edge = (np.abs(relative - rtol) <= _NEAR * rtol) | (np.abs(relative - wary) <= _NEAR * wary)
    edge |= (known & (np.abs(np.linalg.norm(A, axis=2) - least) <= _NEAR * least)).any(axis=1)
    cells.jump[rows], cells.verdict[rows] = jump, code
    cells.certain[rows] = (solved | ~is_held) & ~edge


def _relative(jump: Matrix, F: Vector | None, scale: Vector, load: Matrix) -> Vector:
    """Return ‖ΔF‖/‖F̂‖; for zero force, the supporting force relative to the gravity torques."""
    size = np.linalg.norm(jump, axis=1)
    if F is not None and F.any():
        return np.asarray(size / np.linalg.norm(F))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(size * scale / np.linalg.norm(load, axis=1))


def _nearest(
    a: NDArray[np.float64], lower: Matrix, upper: Matrix, x0: Matrix, slack: Matrix
) -> tuple[Matrix, Mask, Mask]:
    """Return the points of ``lower ≤ a x ≤ upper`` nearest to x0, where found, and where none is.

    Parameters
    ----------
    a :
        Unit normals, zero where there is no bound, shape (c, n, m).
    lower, upper :
        Bounds, infinite where there is none, shape (c, n).
    x0 :
        Points, shape (c, m).
    slack :
        Tolerance of each bound, shape (c, n).
    """
    x, solved, todo = x0.copy(), np.zeros(len(a), dtype=np.bool_), np.arange(len(a))
    side = np.zeros(a.shape[:2])  # 1 where the upper bound binds, -1 where the lower one does
    for _ in range(_ROUNDS):
        at = np.vecdot(a[todo], x[todo, None])
        over = np.maximum(at - upper[todo], lower[todo] - at) - slack[todo]
        over[side[todo] != 0.0] = -np.inf
        worst = over.argmax(axis=1)
        done = np.take_along_axis(over, worst[:, None], axis=1)[:, 0] <= 0.0
        solved[todo[done]] = True
        todo, worst, at = todo[~done], worst[~done], at[~done]
        if not len(todo):
            break
        above = at[np.arange(len(todo)), worst] > upper[todo, worst]
        side[todo, worst] = np.where(above, 1.0, -1.0)
        todo = _on_bounds(x, side, todo, (a, lower, upper, x0))
    left = np.flatnonzero(~solved)
    empty = np.zeros(len(a), dtype=np.bool_)
    empty[left] = _exclude_each_other(a[left], lower[left], upper[left], side[left])
    return x, solved, empty


def _exclude_each_other(
    a: NDArray[np.float64], lower: Matrix, upper: Matrix, side: Matrix
) -> NDArray[np.bool_]:
    """Return where the bounds at hand have no point in common, by Farkas' lemma.

    They have none if some nonnegative combination of them reads ``0 · x ≤ c`` with c < 0.
    """
    binds = side != 0.0
    normals = a * binds[..., None]
    gram = normals @ normals.swapaxes(1, 2) + np.eye(a.shape[1]) * ~binds[:, None]
    w = np.where(binds, np.linalg.eigh(gram)[1][..., 0], 0.0)
    y = w * side
    w = np.where(y.sum(axis=1, keepdims=True) < 0.0, -w, w)
    vanishes = np.linalg.norm(np.vecdot(normals.swapaxes(1, 2), w[:, None]), axis=1) <= _ROUNDING
    c = w * np.where(binds, np.where(side > 0.0, upper, lower), 0.0)
    positive = (w * side >= -_ROUNDING).all(axis=1)
    is_negative = c.sum(axis=1) < -_NEAR * np.abs(c).sum(axis=1)
    found: NDArray[np.bool_] = vanishes & positive & is_negative
    return found


def _on_bounds(
    x: Matrix,
    side: Matrix,
    todo: NDArray[np.intp],
    problem: tuple[NDArray[np.float64], Matrix, Matrix, Matrix],
) -> NDArray[np.intp]:
    """Project on the bounds that bind, dropping those that pull the wrong way, in place.

    Returns
    -------
    :
        The cells where this succeeds.
    """
    waiting, given_up = todo, []
    while len(waiting):
        a, lower, upper, x0 = (part[waiting] for part in problem)
        binds = side[waiting] != 0.0
        normals = a * binds[..., None]
        gram = normals @ normals.swapaxes(1, 2) + np.eye(a.shape[1]) * ~binds[:, None]
        alone = np.linalg.det(gram) > _INDEPENDENT
        given_up += waiting[~alone].tolist()
        bound = np.where(binds, np.where(side[waiting] > 0.0, upper, lower), 0.0)
        excess = np.where(binds, np.vecdot(normals, x0[:, None]) - bound, 0.0)
        gram[~alone] = np.eye(a.shape[1])
        y = np.linalg.solve(gram, excess[..., None])[..., 0]  # multipliers
        x[waiting] = x0 - np.vecdot(normals.swapaxes(1, 2), y[:, None])
        pull = y * side[waiting]
        wrong = alone & (pull < 0.0).any(axis=1)
        side[waiting[wrong], pull[wrong].argmin(axis=1)] = 0.0
        waiting = waiting[wrong]
    return np.setdiff1d(todo, given_up)
