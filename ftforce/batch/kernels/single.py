"""One posture with a handful of fault sets at minimal latency: the kernel of `ftforce.Remapper`.

It gives the results of `ftforce.analyze`. J is decomposed, ``J = U diag(s) Vᵀ``, and everything
else is expressed in its left singular vectors: the rows of J become the orthogonal s_i v_iᵀ, F̂ is
one quotient per row, and K, which lacks only a few columns, is nearly diagonal. For most sets
σ_min(K) shows that no rank is lost; the others are left to `exact`.

Nothing here allocates: it is compiled without numba's allocator, so that it cannot.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from numba import boolean, float64, int64, types

from ftforce.batch.kernels import exact, slabs
from ftforce.batch.kernels.jit import compile_now, inner
from ftforce.batch.kernels.layout import GUARD_BAND, NOT_TOLERATED, TOLERATED

if TYPE_CHECKING:
    import numpy as np

DONE, MALFORMED = 0, 1
"""Return codes of `answer`; input of the wrong size or with non-finite numbers is malformed."""

FRAME, BODY = 16, 19
MATRICES, SQUARES, VECTORS, TORQUES, LINES = 4, 5, 12, 11, 9
"""Sizes of the workspace."""

SET_LANES = 8
"""Fault sets processed side by side: loops over them are innermost, so that they vectorize."""

_MIN_MARGIN = 1e-3
"""K Kᵀ does not determine a smaller σ_min/σ_max accurately enough."""

_MAX_SQUARE = 1e200  # of a sum of squares, so that products with it do not overflow
_ROUNDING = 1e-12  # smaller forces, relative to those given, are rounding errors
_ITERATIONS, _CONVERGED, _NEAR, _SHORTENED = 40, 1e-13, 1e-9, 1.0 - 1e-7
_TINY = 1e-300


class _Posture(NamedTuple):
    """A decomposed posture, in the left singular vectors of J; m task rows, n joints."""

    scratch: exact.Scratch  # its J has the rows s_i v_iᵀ, its F is F̂ in the left vectors
    left_vectors: np.ndarray  # (m, m): U
    task: np.ndarray  # argument of `answer`
    carried: np.ndarray  # (n,): torques that exert F̂, JᵀF̂
    before: np.ndarray  # (m,): F̂ in the task's axes, unweighted


def answer(
    is_force, tree, body, task, locked, free, limit, failed,
    frame, matrix, square, vector, side, line, torque, force, number, code,
    rnea, jacobian, q, given,
):  # fmt: skip
    """Evaluate one posture; return `DONE`, or `MALFORMED` without touching any output.

    Parameters
    ----------
    is_force :
        Whether a force is given, rather than torques.
    tree :
        For every joint its parent (-1 for the root), its driver, whether it is prismatic and
        whether it moves the tip; then the tip's parent and whether the rows are in tip axes;
        (E + 1, 4). ``None`` if Jacobians are given.
    body :
        Placement, ratio, offset, mass, centre and gain of every joint (`layout`); then the
        tip's placement and gravity, (E + 1, BODY); or ``None``.
    task :
        Rows of the frame Jacobian, their weights, the two tolerances, the friction of each joint,
        NaN where unknown, and for each joint the entries up to which its column is rounding,
        (4 + n, max(m, n, 2)).
    locked, free :
        True at the locked and at the free-swinging joints of each set, (S, n).
    limit :
        Largest torques with each set, NaN where unknown and 0 at free-swinging joints; then, for
        lower limits other than the upper ones, the middles between the two, (2 S, n);
        ``None`` if all sets only lock joints, without limits: then nothing else is compiled.
    failed :
        1 at the locked joints, SET_LANES sets at a time, (S / SET_LANES, n, SET_LANES).
    frame, matrix, square, vector, side, line :
        Workspace: (E + 1, FRAME), (MATRICES, m, n), (SQUARES, m, m), (VECTORS, m),
        (m, m, SET_LANES) and (LINES, SET_LANES).
    torque :
        Workspace, whose last row is the output τ_N; then the outputs U; (TORQUES + S, n).
    force :
        Outputs in the task's axes, unweighted: F̂, every F', every ΔF, (1 + 2 S, m).
    number, code :
        Outputs: margin, σ_min, and the norms of the jump's forces and moments, (4, S); verdict and
        lost ranks, with a row of workspace, (3, max(S, 2)).
    rnea, jacobian :
        Torques for weight and motion, (n,), and the weighted Jacobian, (m, n); or ``None``.
    q :
        Otherwise joint positions, rad or m, (n,).
    given :
        Force in the task's axes, unweighted, (m,); or torques (n,).
    """
    m, n, sets = matrix.shape[1], matrix.shape[2], locked.shape[0]
    if given.size != (m if is_force else n) or not _is_valid(given):
        return MALFORMED
    # What depends on arguments that are None is left out of the compiled code.
    if jacobian is not None:
        if jacobian.shape[0] != m or jacobian.shape[1] != n or rnea.size != n:
            return MALFORMED
        if not (_is_valid(rnea) and _are_valid(jacobian)):
            return MALFORMED
        _load(rnea, jacobian, torque[0], matrix[0])
    if q is not None:
        if q.size != n or not _is_valid(q):
            return MALFORMED
        _place(tree, body, q, frame)
        _task_jacobian(tree, body, task, frame, matrix[0])
        _drop_noise(task[4:], matrix[0])
        if limit is not None:
            _weight_torque(tree, body, frame, torque[0])
    work = slabs.Slabs(
        matrix[3], torque[4], torque[5], square[4], vector[7], vector[8], vector[9], vector[10],
        vector[11],
    )  # fmt: skip
    if limit is not None:
        exact.friction_under_weight(task[3, :n], torque[0], torque[3])
    scratch = exact.Scratch(
        code[2], work, matrix[0], square[0], vector[0], vector[1], vector[2], torque[0], matrix[1],
        square[1], vector[3], vector[4], matrix[2], vector[5], torque[1], torque[2], torque[3],
        square[3], vector[6], torque[7],
    )  # fmt: skip
    posture = _Posture(scratch, square[2], task, torque[6], force[0])
    has_force_to_keep = _evaluate_healthy(posture, is_force, given, torque[TORQUES - 1])
    clear = max(task[2, 1], _MIN_MARGIN) * GUARD_BAND
    is_clear = scratch.s[m - 1] > clear * scratch.s[0]
    for at in range(sets):
        U, after, jump = torque[TORQUES + at], force[1 + at], force[1 + sets + at]
        if is_clear and at % SET_LANES == 0:
            _margins(posture, failed[at // SET_LANES], side, line, line[8])
        margin = line[8, at % SET_LANES] if is_clear else 0.0
        number[0, at] = margin
        number[1, at] = margin * scratch.s[0]
        code[1, at] = 0
        keeps_rank, is_open = margin > clear, True
        if limit is not None:
            for k in range(n):
                scratch.middle[k] = limit[sets + at, k]
            if keeps_rank and not _any_true(free[at]):
                keeps_rank = _is_within(posture, limit[at])
                if not keeps_rank:
                    _limit_force(posture, locked[at], limit[at], at, code, U, after, jump)
                    is_open = False
            elif _any_true(free[at]) or _any_known(limit[at]):
                _settle_bounded(
                    posture, locked[at], free[at], limit[at], at, number, code, U, after, jump
                )
                keeps_rank, is_open = False, False
        if keeps_rank:
            _write_unchanged(posture, locked[at], U, after, jump)
            number[2, at] = 0.0
            number[3, at] = 0.0
            code[0, at] = TOLERATED
            continue
        if is_open:
            _settle_locked(posture, locked[at], at, number, code, U, after, jump)
        number[2, at], number[3, at] = _norms(task, jump)
        if not has_force_to_keep:
            code[0, at] = NOT_TOLERATED
    return DONE


@inner
def _is_valid(x):
    """Return whether all numbers are finite, and small enough not to overflow."""
    size = 0.0
    for i in range(x.size):
        size += x[i] * x[i]
    return size <= _MAX_SQUARE


@inner
def _are_valid(J):
    """Return whether all rows are valid."""
    found = True
    for i in range(J.shape[0]):
        found &= _is_valid(J[i])
    return found


@inner
def _load(rnea, jacobian, weight, J):
    """Copy what is given for a posture."""
    for k in range(rnea.size):
        weight[k] = rnea[k]
        for i in range(J.shape[0]):
            J[i, k] = jacobian[i, k]


@inner
def _any_true(mask):
    """Return whether any element of a mask is true."""
    found = False
    for k in range(mask.size):
        found |= mask[k]
    return found


@inner
def _any_known(limit):
    """Return whether any limit is known."""
    found = False
    for k in range(limit.size):
        found |= limit[k] > 0.0
    return found


# ---- kinematics --------------------------------------------------------------------------------


@inner
def _place(tree, body, q, frame):
    """Compute the frames of all joints and the tip in root axes: rotation by rows, translation."""
    last = tree.shape[0] - 1
    for e in range(last + 1):
        _compose_frame(tree[e, 0], body[e], frame, frame[e])
        if e == last:
            return
        own, angle = frame[e], body[e, 12] * q[tree[e, 1]] + body[e, 13]
        if tree[e, 2]:
            for i in range(3):
                own[9 + i] += own[3 * i + 2] * angle
            continue
        cosine, sine = math.cos(angle), math.sin(angle)
        for i in range(3):
            x, y = own[3 * i], own[3 * i + 1]
            own[3 * i] = cosine * x + sine * y
            own[3 * i + 1] = cosine * y - sine * x


@inner
def _compose_frame(parent, placement, frame, own):
    """Compose a placement with its parent frame: ``R = R_above P``, ``p = p_above + R_above t``."""
    if parent < 0:
        for i in range(12):
            own[i] = placement[i]
        return
    above = frame[parent]
    for i in range(3):
        x, y, z = above[3 * i], above[3 * i + 1], above[3 * i + 2]
        for k in range(3):
            own[3 * i + k] = x * placement[k] + y * placement[3 + k] + z * placement[6 + k]
        own[9 + i] = above[9 + i] + (x * placement[9] + y * placement[10] + z * placement[11])


@inner
def _task_jacobian(tree, body, task, frame, J):
    """Compute the weighted task Jacobian J̃, (m, n); mimic joints add to their leader's column."""
    last = tree.shape[0] - 1
    tip, in_tool = frame[last], tree[last, 1]
    for r in range(J.shape[0]):
        for k in range(J.shape[1]):
            J[r, k] = 0.0
    for e in range(last):
        if not tree[e, 3]:
            continue
        own, gain = frame[e], body[e, 18]
        u, v, w = gain * own[2], gain * own[5], gain * own[8]
        x, y, z = tip[9] - own[9], tip[10] - own[10], tip[11] - own[11]
        velocity = (v * z - w * y, w * x - u * z, u * y - v * x)
        linear, angular = velocity, (u, v, w)
        if tree[e, 2]:
            linear, angular = (u, v, w), (0.0, 0.0, 0.0)
        for r in range(J.shape[0]):
            row = int(task[0, r])
            a, b, c = linear if row < 3 else angular
            k = row % 3
            if in_tool:  # Rᵀ x
                along = tip[k] * a + tip[3 + k] * b + tip[6 + k] * c
            else:
                along = a if k == 0 else b if k == 1 else c
            J[r, tree[e, 1]] += task[1, r] * along


@inner
def _drop_noise(floor, J):
    """Set J to zero if it holds nothing but rounding errors (theory §2.6)."""
    for r in range(J.shape[0]):
        for k in range(J.shape[1]):
            if abs(J[r, k]) > floor[k, r]:
                return
    for r in range(J.shape[0]):
        for k in range(J.shape[1]):
            J[r, k] = 0.0


@inner
def _weight_torque(tree, body, frame, weight):
    """Compute the weighted gravity torques, (n,), of everything each joint carries."""
    last = tree.shape[0] - 1
    g0, g1, g2 = body[last, 12], body[last, 13], body[last, 14]
    for k in range(weight.size):
        weight[k] = 0.0
    for e in range(last):
        own, mass = frame[e], body[e, 14]
        own[12] = mass
        for i in range(3):  # first moment of the mass, kg·m
            _place = own[3 * i] * body[e, 15] + own[3 * i + 1] * body[e, 16]
            own[13 + i] = mass * (own[9 + i] + _place + own[3 * i + 2] * body[e, 17])
    for e in range(last - 1, -1, -1):
        own, above = frame[e], tree[e, 0]
        u, v, w, mass = own[2], own[5], own[8], own[12]
        x, y, z = own[13] - mass * own[9], own[14] - mass * own[10], own[15] - mass * own[11]
        torque = g0 * (v * z - w * y) + g1 * (w * x - u * z) + g2 * (u * y - v * x)
        if tree[e, 2]:
            torque = mass * (u * g0 + v * g1 + w * g2)
        weight[tree[e, 1]] -= body[e, 18] * torque
        if above >= 0:
            for i in range(12, 16):
                frame[above, i] += own[i]


# ---- the healthy arm ---------------------------------------------------------------------------


@inner
def _evaluate_healthy(posture, is_force, given, self_motion):
    """Decompose J, and compute the force of the healthy arm: F̂ = (Jᵀ)† τ, or J J† F.

    Returns whether it can exert any of what is asked (theory §2.6).
    """
    J, s, F = posture.scratch.J, posture.scratch.s, posture.scratch.F
    m, n = J.shape
    exact.decompose(J, posture.left_vectors, s)
    rank = exact.rank_of(s, posture.task[2, 0] * s[0])
    posture.scratch.rank[0] = rank
    given_squared, exerted_squared = 0.0, 0.0
    for i in range(given.size):
        x = given[i] / posture.task[1, i] if is_force else given[i]
        given_squared += x * x
    for i in range(m):
        F[i] = 0.0
        if i < rank:
            if is_force:
                for r in range(m):
                    F[i] += posture.left_vectors[r, i] * (given[r] / posture.task[1, r])
            else:
                for k in range(n):
                    F[i] += J[i, k] * given[k]  # s_i v_iᵀ τ
                F[i] /= s[i] * s[i]  # eq. (18) with z = 0
        exerted_squared += F[i] * F[i]
    _joint_torques(J, F, posture.carried)
    if not is_force:
        exerted_squared = 0.0
        for k in range(n):
            exerted_squared += posture.carried[k] * posture.carried[k]
    # A force that is only rounding error is treated as zero, or its direction would matter.
    if not exerted_squared > _ROUNDING * _ROUNDING * given_squared:
        for i in range(m):
            F[i] = 0.0
        for k in range(n):
            posture.carried[k] = 0.0
    for k in range(n):
        self_motion[k] = 0.0 if is_force else given[k] - posture.carried[k]  # τ_N
    _into_task_axes(posture, F, posture.before)
    if is_force and rank == m:
        for i in range(m):
            posture.before[i] = given[i]
    return rank > 0 and not (is_force and given_squared > 0.0 and exact.norm(F) == 0.0)


@inner
def _joint_torques(J, F, torque):
    """Compute the torques JᵀF."""
    for k in range(J.shape[1]):
        torque[k] = 0.0
        for i in range(J.shape[0]):
            torque[k] += J[i, k] * F[i]


@inner
def _into_task_axes(posture, x, out):
    """Transform a force from the left singular vectors of J to the task's axes, unweighted."""
    for r in range(x.size):
        out[r] = 0.0
        for i in range(x.size):
            out[r] += posture.left_vectors[r, i] * x[i]
        out[r] *= posture.task[1, r]


# ---- sets without a force jump ------------------------------------------------------------------


@inner
def _write_unchanged(posture, locked, U, after, jump):
    """Write the results of a set without a jump, U = ᔆJᵀ F̂ (eq. 24, 39 as in eq. 42)."""
    for k in range(U.size):
        U[k] = 0.0 if locked[k] else posture.carried[k]
    for i in range(after.size):
        after[i] = posture.before[i]
        jump[i] = 0.0


@inner
def _margins(posture, failed, A, line, margin):
    """Compute σ_min(K)/σ_max(J) of SET_LANES sets from A = K Kᵀ/σ_max(J)².

    Below `_MIN_MARGIN` the value is not accurate, only known to be below.
    """
    J, s = posture.scratch.J, posture.scratch.s
    m, n = J.shape
    scale = 1.0 / (s[0] * s[0])
    for i in range(m):
        for j in range(i + 1):
            for b in range(SET_LANES):
                A[i, j, b] = s[i] * s[i] * scale if i == j else 0.0
            for k in range(n):
                product = scale * J[i, k] * J[j, k]
                for b in range(SET_LANES):
                    A[i, j, b] -= failed[k, b] * product
            for b in range(SET_LANES):
                A[j, i, b] = A[i, j, b]
    tridiagonalize(A, line)
    smallest(A, line, margin)
    for b in range(SET_LANES):
        margin[b] = math.sqrt(max(margin[b], 0.0))


@inner
def tridiagonalize(A, line):
    """Reduce symmetric matrices to tridiagonal form by reflections H = I - β v vᵀ, A ← H A H.

    Stores the diagonals, and in A[k, k + 1] the squares of the off-diagonal elements.

    Parameters
    ----------
    A :
        The matrices, shape (m, m, SET_LANES); overwritten.
    line :
        Workspace, shape (LINES, SET_LANES).
    """
    m, w = A.shape[0], line
    beta, along = line[6], line[7]
    for k in range(m - 2):
        v = A[k]
        for b in range(SET_LANES):
            beta[b] = 0.0
        for i in range(k + 1, m):
            for b in range(SET_LANES):
                beta[b] += v[i, b] * v[i, b]
        for b in range(SET_LANES):
            square, head = beta[b], v[k + 1, b]
            length = math.sqrt(square)
            v[k + 1, b] = head + math.copysign(length, head)
            beta[b] = 1.0 / (square + abs(head) * length + _TINY)  # 2 / vᵀv
            A[k + 1, k, b] = square
            along[b] = 0.0
        for i in range(k + 1, m):
            for b in range(SET_LANES):
                w[i, b] = 0.0
            for j in range(k + 1, m):
                for b in range(SET_LANES):
                    w[i, b] += A[i, j, b] * v[j, b]
            for b in range(SET_LANES):
                w[i, b] *= beta[b]
                along[b] += w[i, b] * v[i, b]
        for i in range(k + 1, m):
            for b in range(SET_LANES):
                w[i, b] -= 0.5 * beta[b] * along[b] * v[i, b]
        for i in range(k + 1, m):
            for j in range(k + 1, m):
                for b in range(SET_LANES):
                    A[i, j, b] -= v[i, b] * w[j, b] + w[i, b] * v[j, b]
    if m > 1:
        for b in range(SET_LANES):
            A[m - 1, m - 2, b] *= A[m - 1, m - 2, b]


@inner
def smallest(A, line, x):
    """Compute the smallest eigenvalues of tridiagonal matrices.

    Laguerre's iteration on the characteristic polynomial approaches the root monotonically from
    below, with cubic convergence (Parlett 1964; all roots are real). Two roots too close to be
    resolved from a distance act like one between them, so every step is shortened slightly. The
    leading minors, all positive below the smallest root, verify that it was not passed. The result
    is NaN where rounding led past it, and 0 if there is no positive root or no convergence.

    Parameters
    ----------
    A :
        The matrices as left by `tridiagonalize`, shape (m, m, SET_LANES).
    line :
        Workspace, shape (LINES, SET_LANES).
    x :
        Filled with the eigenvalues, shape (SET_LANES,).
    """
    m = A.shape[0]
    p, dp, ddp, q, dq, ddq = line[0], line[1], line[2], line[3], line[4], line[5]
    last, minor = line[6], line[7]
    for b in range(SET_LANES):
        x[b] = 0.0
        last[b] = 0.0
    for _ in range(_ITERATIONS):
        for b in range(SET_LANES):
            p[b], dp[b], ddp[b] = A[0, 0, b] - x[b], -1.0, 0.0
            q[b], dq[b], ddq[b] = 1.0, 0.0, 0.0
            minor[b] = p[b]
        for i in range(1, m):
            for b in range(SET_LANES):
                a, c = A[i, i, b] - x[b], A[i, i - 1, b]
                up, dup, ddup = p[b], dp[b], ddp[b]
                p[b] = a * up - c * q[b]
                dp[b] = a * dup - up - c * dq[b]
                ddp[b] = a * ddup - 2.0 * dup - c * ddq[b]
                q[b], dq[b], ddq[b] = up, dup, ddup
                minor[b] = p[b] if p[b] < minor[b] else minor[b]
        remaining = 0
        for b in range(SET_LANES):
            over = 1.0 / p[b]
            G = -dp[b] * over  # Σ 1/(λ - x)
            H = G * G - ddp[b] * over  # Σ 1/(λ - x)²
            step = _SHORTENED * m / (G + math.sqrt(max((m - 1) * (m * H - G * G), 0.0)))
            if minor[b] > 0.0:  # below all roots
                x[b] += step
                last[b] = step
                remaining += 1 if step > _CONVERGED * x[b] else 0
            elif 0.0 <= last[b] <= _NEAR * x[b]:  # at the root, to rounding accuracy
                last[b] = 0.0
            elif last[b] > 0.0:  # rounding may have led slightly past the root
                x[b] -= 0.1 * _NEAR * x[b]
                last[b] = -1.0
                remaining += 1
            else:
                x[b] = math.nan
                last[b] = 0.0
        if remaining == 0:
            return
    for b in range(SET_LANES):
        x[b] = 0.0 if last[b] > _CONVERGED * x[b] else x[b]


# ---- sets with a possible jump ------------------------------------------------------------------


@inner
def _settle_locked(posture, locked, at, number, code, U, after, jump):
    """Evaluate a set of locked joints by the singular values of K, like the module `settle`."""
    scratch, rtol, wary = posture.scratch, posture.task[2, 0], posture.task[2, 1]
    exact.reduce_columns(scratch.J, locked, scratch.K)  # eq. (25), (26)
    exact.decompose(scratch.K, scratch.V, scratch.t)
    code[0, at] = exact.judge_locked(scratch, True, rtol, wary)
    for i in range(after.size):
        scratch.F0[i] = 0.0
    rank = exact.rank_of(scratch.t, rtol * scratch.s[0])
    exact.lose(scratch, rank)
    _write_margin(scratch, rank, at, number, code)
    if exact.norm(scratch.jump) == 0.0:
        _write_unchanged(posture, locked, U, after, jump)
    else:
        _write_jump(posture, locked, False, U, after, jump)


@inner
def _settle_bounded(posture, locked, free, limit, at, number, code, U, after, jump):
    """Evaluate a set with free-swinging joints or limits by singular values of K."""
    scratch, task = posture.scratch, posture.task
    rtol, wary, friction = task[2, 0], task[2, 1], task[3, : U.size]
    code[0, at] = exact.judge_free(scratch, locked, free, limit, friction, rtol, wary, True)
    ideal = exact.is_ideal(friction, free)
    exact.reduce(scratch, locked, free, ideal, wary, rtol)
    exact.decompose(scratch.K, scratch.V, scratch.t)
    rank = exact.rank_of(scratch.t, rtol * scratch.s[0])
    stands = exact.is_balanced(scratch, free, ideal, rtol)
    stands = stands and exact.hold(scratch, free, limit, rank, ideal, rtol, wary)
    _write_margin(scratch, rank, at, number, code)
    _write_held(posture, locked, stands, U, after, jump)


@inner
def _limit_force(posture, locked, limit, at, code, U, after, jump):
    """Evaluate a set that loses no direction, but whose torques exceed limits.

    The force closest to F̂ within them is sought among all forces, since K K† = I.
    """
    scratch, rtol, wary = posture.scratch, posture.task[2, 0], posture.task[2, 1]
    work, lost = scratch.slabs, scratch.jump
    for k in range(limit.size):
        work.width[k] = limit[k] if limit[k] > 0.0 else -1.0
        work.middle[k] = scratch.middle[k] - scratch.rnea[k]
        for i in range(lost.size):
            work.rows[i, k] = scratch.J[i, k]
    for i in range(lost.size):
        lost[i] = scratch.F[i]
    stands = slabs.nearest(work, lost, rtol * scratch.s[0])
    for i in range(lost.size):
        lost[i] = scratch.F[i] - lost[i]
    relative = exact.relative_jump(scratch, scratch.s[0]) if stands else math.inf
    code[0, at] = exact.verdict_of(relative <= wary, not relative <= rtol)
    _write_held(posture, locked, stands, U, after, jump)


@inner
def _is_within(posture, limit):
    """Return whether the torques that exert F̂ and carry the weight are within the limits."""
    found = True
    for k in range(limit.size):
        torque = posture.carried[k] + posture.scratch.rnea[k] - posture.scratch.middle[k]
        found &= not (limit[k] > 0.0 and abs(torque) > limit[k])
    return found


@inner
def _write_margin(scratch, rank, at, number, code):
    """Write σ_min of K, decomposed, and how many ranks it lacks."""
    m = scratch.t.size
    code[1, at] = scratch.rank[0] - rank
    number[0, at] = scratch.t[m - 1] / scratch.s[0] if scratch.s[0] > 0.0 else 0.0
    number[1, at] = scratch.t[m - 1]


@inner
def _write_held(posture, locked, stands, U, after, jump):
    """Write the force closest to F̂ that can be held; NaN if the arm cannot stand still."""
    if not stands:
        for k in range(U.size):
            U[k] = math.nan
        for i in range(after.size):
            after[i] = math.nan
            jump[i] = math.nan
    elif exact.norm(posture.scratch.jump) == 0.0:
        _write_unchanged(posture, locked, U, after, jump)
    else:
        _write_jump(posture, locked, True, U, after, jump)


@inner
def _write_jump(posture, locked, changes, U, after, jump):
    """Write the jump ΔF, and U.

    Locked joints alone leave the other torques unchanged, U = ᔆJᵀ F̂; free-swinging joints and
    limits do not.
    """
    scratch = posture.scratch
    J, lost = scratch.J, scratch.jump
    _into_task_axes(posture, lost, jump)
    for i in range(lost.size):
        after[i] = posture.before[i] - jump[i]
    for k in range(U.size):
        U[k] = posture.carried[k]
        if changes:
            for i in range(lost.size):
                U[k] -= J[i, k] * lost[i]
        if locked[k]:
            U[k] = 0.0


@inner
def _norms(task, jump):
    """Return the norms of the forces, N, and of the moments, N·m."""
    forces, moments = 0.0, 0.0
    for i in range(jump.size):
        if task[0, i] < 3.0:
            forces += jump[i] * jump[i]
        else:
            moments += jump[i] * jump[i]
    return math.sqrt(forces), math.sqrt(moments)


_VECTOR = types.Array(float64, 1, "A", readonly=True)  # accepts strided and read-only ones
_GIVEN_MATRIX = types.Array(float64, 2, "A", readonly=True)
_MASK, _INTEGERS = types.Array(boolean, 2, "C"), types.Array(int64, 2, "C")
_MATRIX, _CUBE = types.Array(float64, 2, "C"), types.Array(float64, 3, "C")


@cache
def compiled(takes_jacobian, has_limits):
    """Return `answer`, compiled for one kind of arguments; what they do not need is left out.

    The GIL is not released: reacquiring it can take longer than the call. One explicit signature,
    so that nothing is ever compiled inside a control loop.

    Parameters
    ----------
    takes_jacobian :
        Whether it takes Jacobians, rather than postures.
    has_limits :
        Whether ``limit`` is given.
    """
    place = (types.none, types.none) if takes_jacobian else (_INTEGERS, _MATRIX)
    given: Any = (types.none, types.none, _VECTOR)
    if takes_jacobian:
        given = (_VECTOR, _GIVEN_MATRIX, types.none)
    signature = int64(
        boolean, *place, _MATRIX, _MASK, _MASK, _MATRIX if has_limits else types.none, _CUBE,
        types.none if takes_jacobian else _MATRIX, _CUBE, _CUBE, _MATRIX, _CUBE, _MATRIX,
        _MATRIX, _MATRIX, _MATRIX, _INTEGERS, *given, _VECTOR,
    )  # fmt: skip
    return compile_now(answer, signature, nogil=False, _nrt=False)
