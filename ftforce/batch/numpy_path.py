"""The evaluation of postures with NumPy, for answers that should not wait for a compiler.

It gives what the compiled kernels give, from the same arrays, up to forty times slower: kinematics
of a whole stack of postures, then stacked linear algebra (`ftforce.core.stacks`,
`ftforce.core.stacked_ranks`, `ftforce.core.stacked_free`). Sets with several free-swinging joints,
or with free and locked ones, and cells within rounding error of a tolerance go through the
functions that `ftforce.analyze` calls.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.analysis.conditions import without_rounding
from ftforce.batch.kernels.layout import NOT_TOLERATED, UNDECIDED
from ftforce.batch.plan import as_block, empty_answers
from ftforce.core import measures
from ftforce.core.arrays import norm, read_only
from ftforce.core.bounded_remap import remap_inside
from ftforce.core.feasible_forces import LockModel, feasible_forces, reach
from ftforce.core.reduced_jacobian import FreeJoints, reduce_decomposed
from ftforce.core.remap import force_jump, supported_force
from ftforce.core.stacked_free import fill_free
from ftforce.core.stacked_ranks import settle_cells
from ftforce.core.stacks import cells_of, reach_of
from ftforce.core.svd import Svd
from ftforce.core.verdict import CODES, judge

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.batch.kernels.layout import Answers, Block, Mechanism, Question
    from ftforce.batch.plan import Plan
    from ftforce.core.arrays import Matrix, Vector
    from ftforce.core.reduced_jacobian import ReducedJacobian

    Stack = NDArray[np.float64]

_PAIRS = 2**14  # postures times fault sets at once, so that their matrices stay in the cache


class NumpyEvaluator:
    """Evaluates blocks of postures as `ftforce.batch.plan.Evaluator` does, without compiled code.

    Parameters
    ----------
    plan :
        What to compute.
    lock :
        Whether the capability is what motors can command, or what brakes hold too.
    """

    def __init__(self, plan: Plan, lock: LockModel = LockModel.COMMANDED) -> None:
        self.plan, self.lock = plan, lock

    def __call__(self, q: Matrix) -> Block:
        """Return the results for postures.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        """
        return as_block(evaluate(self.plan, q, self.lock))


def evaluate(plan: Plan, q: Matrix, lock: LockModel = LockModel.COMMANDED) -> Answers:
    """Return the results for postures, as the kernels give them.

    Parameters
    ----------
    plan, lock :
        What to compute, as in `NumpyEvaluator`.
    q :
        Joint positions, rad or m, shape (k, n).
    """
    answers = empty_answers(plan, len(q))
    size = max(1, _PAIRS // max(1, len(plan.faults.locked)))
    for first in range(0, len(q), size):
        rows = slice(first, first + size)
        _fill(plan, q[rows], _rows_of(answers, rows), lock)
    return answers


def _rows_of(answers: Answers, rows: slice) -> Answers:
    """Return views of the results of some postures."""
    whole = answers._asdict()
    parts = {
        name: values[rows] if name == "tip" else values[..., rows] for name, values in whole.items()
    }
    return answers._replace(**parts)


def _column_of(answers: Answers, s: int, i: int) -> Answers:
    """Return views of the results of one set in one posture."""
    at = slice(s, s + 1), slice(i, i + 1)
    parts = {
        name: values[at]
        for name in ("verdict", "jump", "moment_jump", "relative_jump")
        if (values := getattr(answers, name)).size
    }
    return answers._replace(**parts)


# ---- kinematics --------------------------------------------------------------------------------


class Placed(NamedTuple):
    """Kinematics of k postures.

    Attributes
    ----------
    tip :
        Positions of the tip in root axes, m, shape (k, 3).
    J :
        Weighted task Jacobians, shape (k, m, n), zero where they are rounding (theory §2.6).
    weight :
        Weighted gravity torques, shape (k, n); zero if they are not needed.
    """

    tip: Matrix
    J: Stack
    weight: Matrix


def place(mechanism: Mechanism, question: Question, q: Matrix) -> Placed:
    """Return the kinematics of postures.

    Parameters
    ----------
    mechanism, question :
        The arm, and what to compute.
    q :
        Joint positions, rad or m, shape (k, n).
    """
    R, p = _frames(mechanism, q)
    tip_R, tip_p, columns = _tip(mechanism, R, p, q)
    if question.in_tool:
        halves = columns.reshape(2, 3, *columns.shape[1:])
        columns = np.einsum("jik,hjnk->hink", tip_R, halves).reshape(columns.shape)
    J = np.ascontiguousarray(
        (question.weights[:, None, None] * columns[question.rows]).transpose(2, 0, 1)
    )
    J[(np.abs(J) <= question.floor).all(axis=(1, 2))] = 0.0
    weight = np.zeros((len(q), q.shape[1]))
    if question.needs_gravity:
        weight = _weight_torques(mechanism, R, p, q.shape[1])
    return Placed(np.ascontiguousarray(tip_p.T), J, weight)


def tip_kinematics(mechanism: Mechanism, q: Matrix) -> tuple[Stack, Matrix, Stack]:
    """Return rotations (k, 3, 3), positions (k, 3), and Jacobians (k, 6, n) of the tip.

    In root axes, the Jacobians at the tip point, linear rows first.

    Parameters
    ----------
    mechanism :
        The arm, its hinges and slides not weighted.
    q :
        Joint positions, rad or m, shape (k, n).
    """
    R, p, columns = _tip(mechanism, *_frames(mechanism, q), q)
    return R.transpose(2, 0, 1), p.T, columns.transpose(2, 0, 1)


def _tip(
    mechanism: Mechanism, R: list[Stack], p: list[Matrix], q: Matrix
) -> tuple[Stack, Matrix, Stack]:
    """Return rotation (3, 3, k), position (3, k) and Jacobian (6, n, k) of the tip, root axes."""
    above = mechanism.tip_parent
    tip_R = _turned(R[above], mechanism.tip[:9].reshape(3, 3))
    tip_p = p[above] + np.einsum("ijk,j->ik", R[above], mechanism.tip[9:])
    columns = np.zeros((6, q.shape[1], len(q)))
    for e in np.flatnonzero(mechanism.moves_tip).tolist():
        axis = mechanism.gain[e] * R[e][:, 2]
        moment = np.zeros_like(axis)
        linear = axis
        if not mechanism.is_prismatic[e]:
            linear, moment = _cross(axis, tip_p - p[e]), axis
        columns[:3, mechanism.driver[e]] += linear
        columns[3:, mechanism.driver[e]] += moment
    return tip_R, tip_p, columns


def _frames(mechanism: Mechanism, q: Matrix) -> tuple[list[Stack], list[Matrix]]:
    """Return the rotation (3, 3, k) and position (3, k) of every joint, in root axes."""
    angle = q[:, mechanism.driver].T * mechanism.ratio[:, None] + mechanism.offset[:, None]
    rotations: list[Stack] = []
    places: list[Matrix] = []
    k = len(q)
    for e, above in enumerate(mechanism.parent.tolist()):
        P, t = mechanism.placement[e, :9].reshape(3, 3), mechanism.placement[e, 9:]
        if above < 0:
            R, p = np.repeat(P[..., None], k, axis=2), np.repeat(t[:, None], k, axis=1)
        else:
            R = _turned(rotations[above], P)
            p = places[above] + np.einsum("ijk,j->ik", rotations[above], t)
        if mechanism.is_prismatic[e]:
            p = p + R[:, 2] * angle[e]
        else:
            c, s = np.cos(angle[e]), np.sin(angle[e])
            R = np.stack([c * R[:, 0] + s * R[:, 1], c * R[:, 1] - s * R[:, 0], R[:, 2]], axis=1)
        rotations.append(R)
        places.append(p)
    return rotations, places


def _turned(R: Stack, P: Matrix) -> Stack:
    """Return R P for rotations R, shape (3, 3, k)."""
    turned: Stack = np.einsum("ijk,jl->ilk", R, P)
    return turned


def _cross(a: Matrix, b: Matrix) -> Matrix:
    """Return a x b along the first axis, shape (3, k)."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _weight_torques(mechanism: Mechanism, R: list[Stack], p: list[Matrix], n: int) -> Matrix:
    """Return the weighted gravity torques of everything each joint carries, shape (k, n)."""
    g = mechanism.gravity
    mass = mechanism.mass.copy()
    moment = [  # first moments of the mass, kg·m
        m * (at + np.einsum("ijk,j->ik", turn, centre))
        for m, at, turn, centre in zip(mass, p, R, mechanism.centre, strict=True)
    ]
    torque = np.zeros((n, p[0].shape[1]))
    for e in reversed(range(len(mass))):
        axis, above = R[e][:, 2], mechanism.parent[e]
        if mechanism.is_prismatic[e]:
            along = mass[e] * (g @ axis)
        else:
            along = g @ _cross(axis, moment[e] - mass[e] * p[e])
        torque[mechanism.driver[e]] -= mechanism.gain[e] * along
        if above >= 0:
            mass[above] += mass[e]
            moment[above] = moment[above] + moment[e]
    return np.ascontiguousarray(torque.T)


# ---- all postures and sets at once -------------------------------------------------------------


def _fill(plan: Plan, q: Matrix, answers: Answers, lock: LockModel) -> None:
    """Fill in the results of a stack of postures."""
    faults, question = plan.faults, plan.question
    placed = place(plan.mechanism, question, q)
    answers.tip[:] = placed.tip
    force = question.force if question.force.size else None
    direction = question.direction if question.direction.size else None
    given = (placed.J, faults.locked | faults.free, force, direction)
    rtol, wary = question.rtol, question.wary
    cells = cells_of(*given, rtol=rtol, wary=wary, asks_weakest=False)
    healthy = settle_cells(cells, *given, rtol=rtol, wary=wary)
    left, borne = ~healthy.certain[:, None], None
    if faults.has_free.any():
        alone = ~faults.locked.any(axis=1) & (faults.free.sum(axis=1) == 1)
        left = left | (faults.has_free & ~alone)
        borne = fill_free(
            cells,
            healthy,
            placed.J,
            placed.weight,
            faults.free & alone[:, None],
            friction=question.friction,
            has_force=force is not None,
            direction=direction,
            rtol=rtol,
            wary=wary,
        )
    left = left | ~cells.certain
    answers.rank[:] = healthy.rank
    answers.healthy_margin[:] = healthy.margin
    answers.verdict[:] = cells.verdict.T
    answers.rank_lost[:] = cells.rank_lost.T
    answers.margin[:] = cells.margin.T
    answers.sigma_min[:] = cells.margin.T * cells.scale
    answers.rho[:] = cells.rho.T
    if force is not None:
        _write_jumps(question, cells.jump, np.linalg.norm(healthy.F, axis=1), answers)
    if direction is not None:
        largest = np.where(faults.locked, question.brake, question.effort)
        largest[faults.free] = 0.0
        commanded, held = reach_of(
            placed.J,
            placed.weight[:, None],
            largest,
            direction=direction,
            cells=cells,
            rtol=rtol,
            within=borne,
            middle=np.where(faults.locked | faults.free, 0.0, question.middle),
        )
        answers.capability[:] = (held if lock is LockModel.HELD else commanded).T
    for i in np.flatnonzero(left.any(axis=1)).tolist():
        one = _Posture(i, placed.J[i], placed.weight[i])
        _settle(plan, one, np.flatnonzero(left[i]).tolist(), answers, lock)


def settle_postures(plan: Plan, q: Matrix, at: NDArray[np.intp], answers: Answers) -> None:
    """Evaluate one by one what the fast kernels left undecided in some postures.

    Parameters
    ----------
    plan :
        What to compute.
    q :
        Joint positions, rad or m, shape (k, n).
    at :
        Indices of the postures in which a rank or a verdict is undecided.
    answers :
        Results for all k postures, which are completed.
    """
    if not len(at):
        return
    placed = place(plan.mechanism, plan.question, q[at])
    for one, i in enumerate(at.tolist()):
        left = answers.verdict[:, i] == UNDECIDED
        if answers.rank[i] == UNDECIDED:
            left[:] = True
        posture = _Posture(i, placed.J[one], placed.weight[one])
        _settle(plan, posture, np.flatnonzero(left).tolist(), answers)


def _write_jumps(question: Question, jump: Stack, size: Vector, answers: Answers) -> None:
    """Write the norms of weighted jumps, shape (k, S, m), for forces F̂ of weighted norms, (k,)."""
    relative = np.linalg.norm(jump, axis=2).T / np.where(size > 0.0, size, math.inf)
    answers.relative_jump[:] = np.where(np.isnan(relative), 1.0, relative)  # no equilibrium
    unweighted = jump * question.weights
    is_force = question.rows < 3
    forces = np.linalg.norm(unweighted[..., is_force], axis=2).T
    moments = np.linalg.norm(unweighted[..., ~is_force], axis=2).T
    answers.jump[:] = forces if is_force.any() else moments
    if answers.moment_jump.size:
        answers.moment_jump[:] = moments


# ---- one posture and one set -------------------------------------------------------------------


class _Posture(NamedTuple):
    """One posture of a stack: its index, weighted Jacobian (m, n) and gravity torques (n,)."""

    i: int
    J: Matrix
    weight: Vector


def _settle(
    plan: Plan,
    posture: _Posture,
    sets: list[int],
    answers: Answers,
    lock: LockModel = LockModel.COMMANDED,
) -> None:
    """Evaluate sets in one posture as `ftforce.analyze` does."""
    question, faults, i = plan.question, plan.faults, posture.i
    healthy = Svd(read_only(posture.J.copy()))
    none = np.zeros(plan.n, np.bool_)
    whole = reduce_decomposed(healthy, none, question.rtol)
    answers.rank[i] = whole.rank
    answers.healthy_margin[i] = measures.margin(whole)
    F = None
    if question.force.size:
        F = supported_force(whole, question.force)
        F = without_rounding(F, F, question.force)
    for s in sets:
        free = None
        if faults.has_free[s]:
            free = FreeJoints.of(faults.free[s], question.friction, question.wary)
        reduced = reduce_decomposed(healthy, faults.locked[s], question.rtol, free)
        answers.rank_lost[s, i] = reduced.rank - reduced.rank_after
        answers.sigma_min[s, i] = reduced.damaged.s[-1]
        answers.margin[s, i] = measures.margin(reduced)
        answers.rho[s, i] = measures.relative_manipulability(reduced)
        _settle_force(plan, posture, reduced, F, _column_of(answers, s, i))
        if question.direction.size:
            answers.capability[s, i] = _capability(plan, reduced, posture.weight, s, lock)


def _settle_force(
    plan: Plan, posture: _Posture, reduced: ReducedJacobian, F: Vector | None, answers: Answers
) -> None:
    """Write the verdict and the jump of one set in one posture, the only one of the answers."""
    question = plan.question
    bounded, jump = None, None
    if reduced.free is not None:
        wanted = np.zeros(reduced.m) if F is None else F
        bounded = remap_inside(reduced, wanted, posture.weight, None)
        jump = bounded.jump
    elif F is not None:
        jump = force_jump(reduced, F).jump
    answers.verdict[:] = NOT_TOLERATED
    if reduced.rank > 0 and (F is None or F.any()):
        answers.verdict[:] = CODES[judge(reduced, F, question.wary, bounded)]
    if F is None:
        return
    lost = np.full(reduced.m, math.nan) if jump is None else jump
    _write_jumps(question, lost[None, None], np.array([norm(F)]), answers)


def _capability(
    plan: Plan, reduced: ReducedJacobian, weight: Vector, s: int, lock: LockModel
) -> float:
    """Return the largest force in the direction, commanded or held, NaN if there is none."""
    question, faults = plan.question, plan.faults
    largest = np.where(faults.locked[s], question.brake, question.effort)
    largest[faults.free[s]] = 0.0
    middle = np.where(faults.locked[s] | faults.free[s], 0.0, question.middle)
    both = np.array([middle - largest, middle + largest])
    ray = reach(feasible_forces(reduced, weight, both, lock), question.direction)
    return math.nan if ray.is_empty else ray.maximum
