"""Kinematics and the fast part of the fault analysis, LANES postures side by side.

Every loop over lanes is innermost, over contiguous memory of a fixed length, so that the compiler
vectorizes it. Cases close to a tolerance are not decided here but in `exact`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ftforce.batch.kernels.jit import inner
from ftforce.batch.kernels.layout import LANES, aligned_arrays, aligned_zeros

# π/2 in three parts of 33 bits (Cody and Waite; values from fdlibm), so that the product of each
# with the number of a quadrant is exact.
_QUADRANTS = 2.0 / math.pi
_PIO2_1, _PIO2_2 = 1.57079632673412561417e00, 6.07710050630396597660e-11
_PIO2_3 = 2.02226624871116645580e-21
# Adding and subtracting it rounds to an integer, and vectorizes, unlike floor.
_ROUNDER = 1.5 * 2.0**52
_MAX_REDUCED = 1e5
"""Angles up to this, rad, are reduced with the three parts, larger ones by the C library."""

# Kernel polynomials of sine and cosine on [-π/4, π/4] (fdlibm, below one unit in the last place).
_S1, _S2, _S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S4, _S5, _S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C1, _C2, _C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C4, _C5, _C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11


class Kinematics(NamedTuple):
    """Workspace of LANES postures; E joints driven by n positions, m task rows."""

    chosen: np.ndarray  # (LANES,): which postures
    angle: np.ndarray  # (E, LANES)
    cosine: np.ndarray  # (LANES,)
    sine: np.ndarray  # (LANES,)
    frame: np.ndarray  # (E, 12, LANES): rotation by rows, then translation
    tip: np.ndarray  # (12, LANES)
    column: np.ndarray  # (6, LANES)
    J: np.ndarray  # (m, n, LANES)
    weight: np.ndarray  # (n, LANES): weighted gravity torques
    moment: np.ndarray  # (E, 3, LANES)
    mass: np.ndarray  # (E,)
    force: np.ndarray  # (6, LANES): requested force, in the axes of the rows
    direction: np.ndarray  # (6, LANES): direction of the capability


def workspace(joints, n, m):
    """Return a workspace.

    Parameters
    ----------
    joints :
        Number of joints of the mechanism.
    n, m :
        Numbers of joints of the chain and of task rows.
    """
    line, row, each = (LANES,), (6, LANES), (joints, LANES)
    kinematics = [each, line, line, (joints, 12, LANES), (12, LANES), row]
    loads = [(m, n, LANES), (n, LANES), (joints, 3, LANES), (joints,), row, row]
    return Kinematics(aligned_zeros(LANES, np.int64), *aligned_arrays([*kinematics, *loads]))


@inner
def _read_angles(mechanism, q, chosen, angle):
    """Read the positions of all joints in the chosen postures."""
    for e in range(mechanism.driver.size):
        d, ratio, offset = mechanism.driver[e], mechanism.ratio[e], mechanism.offset[e]
        for b in range(LANES):
            angle[e, b] = ratio * q[chosen[b], d] + offset


@inner
def sincos(angle, cosine, sine):
    """Compute cosine and sine of one row of angles.

    Parameters
    ----------
    angle :
        rad, shape (LANES,).
    cosine, sine :
        Filled with the results, shape (LANES,).
    """
    largest = 0.0
    for b in range(LANES):
        largest = max(largest, abs(angle[b]))
    for b in range(LANES):
        x = angle[b]
        k = (x * _QUADRANTS + _ROUNDER) - _ROUNDER
        r = ((x - k * _PIO2_1) - k * _PIO2_2) - k * _PIO2_3
        z = r * r
        s = r + r * z * (_S1 + z * (_S2 + z * (_S3 + z * (_S4 + z * (_S5 + z * _S6)))))
        c = 1.0 - 0.5 * z + z * z * (_C1 + z * (_C2 + z * (_C3 + z * (_C4 + z * (_C5 + z * _C6)))))
        quadrant = k - 4.0 * ((0.25 * k - 0.375 + _ROUNDER) - _ROUNDER)
        swapped = (quadrant == 1.0) | (quadrant == 3.0)
        u = s if swapped else c
        v = c if swapped else s
        cosine[b] = -u if (quadrant == 1.0) | (quadrant == 2.0) else u
        sine[b] = -v if quadrant >= 2.0 else v
    if not largest <= _MAX_REDUCED:
        for b in range(LANES):
            if not abs(angle[b]) <= _MAX_REDUCED:
                cosine[b] = math.cos(angle[b])
                sine[b] = math.sin(angle[b])


@inner
def _root_frame(placement, frame):
    """Place a frame that is fixed to the root."""
    for i in range(12):
        for b in range(LANES):
            frame[i, b] = placement[i]


@inner
def _compose_frame(above, placement, frame):
    """Compose a placement with its parent frame: ``R = R_above P``, ``p = p_above + R_above t``."""
    p00, p01, p02 = placement[0], placement[1], placement[2]
    p10, p11, p12 = placement[3], placement[4], placement[5]
    p20, p21, p22 = placement[6], placement[7], placement[8]
    t0, t1, t2 = placement[9], placement[10], placement[11]
    for i in range(3):
        for b in range(LANES):
            x, y, z = above[3 * i, b], above[3 * i + 1, b], above[3 * i + 2, b]
            frame[9 + i, b] = above[9 + i, b] + (x * t0 + y * t1 + z * t2)
            frame[3 * i, b] = x * p00 + y * p10 + z * p20
            frame[3 * i + 1, b] = x * p01 + y * p11 + z * p21
            frame[3 * i + 2, b] = x * p02 + y * p12 + z * p22


@inner
def _rotate_frame(frame, cosine, sine):
    """Rotate a frame about its z axis."""
    for i in range(3):
        for b in range(LANES):
            x, y = frame[3 * i, b], frame[3 * i + 1, b]
            frame[3 * i, b] = cosine[b] * x + sine[b] * y
            frame[3 * i + 1, b] = cosine[b] * y - sine[b] * x


@inner
def _translate_frame(frame, displacement):
    """Translate a frame along its z axis."""
    for i in range(3):
        for b in range(LANES):
            frame[9 + i, b] += frame[3 * i + 2, b] * displacement[b]


@inner
def place_frames(mechanism, q, chosen, work):
    """Compute the frames of all joints and of the tip in the chosen postures, in root axes.

    Parameters
    ----------
    mechanism :
        The arm.
    q :
        Joint positions, rad or m, shape (k, n).
    chosen :
        Indices of the postures, shape (LANES,).
    work :
        Workspace; its frames and tip are filled in.
    """
    _read_angles(mechanism, q, chosen, work.angle)
    for e in range(mechanism.parent.size):
        above = mechanism.parent[e]
        if above < 0:
            _root_frame(mechanism.placement[e], work.frame[e])
        else:
            _compose_frame(work.frame[above], mechanism.placement[e], work.frame[e])
        if mechanism.is_prismatic[e]:
            _translate_frame(work.frame[e], work.angle[e])
        else:
            sincos(work.angle[e], work.cosine, work.sine)
            _rotate_frame(work.frame[e], work.cosine, work.sine)
    _compose_frame(work.frame[mechanism.tip_parent], mechanism.tip, work.tip)


@inner
def place(mechanism, question, q, work):
    """Compute the frames, J, gravity torques, force and direction of the chosen postures.

    Parameters
    ----------
    mechanism, question :
        The arm, and what to compute.
    q :
        Joint positions, rad or m, shape (k, n).
    work :
        Workspace, with the postures chosen; all else is filled in.
    """
    place_frames(mechanism, q, work.chosen, work)
    task_jacobian(mechanism, question, work)
    _drop_noise(question.floor, work.J, work.column[0])
    _into_row_axes(question, question.force, work.tip, work.force)
    _into_row_axes(question, question.direction, work.tip, work.direction)
    if question.needs_gravity:
        weight_torque(mechanism, work)


@inner
def _jacobian_column(mechanism, e, work):
    """Compute the column of joint e of the weighted Jacobian, linear rows first, in root axes."""
    frame, tip, column, gain = work.frame[e], work.tip, work.column, mechanism.gain[e]
    if mechanism.is_prismatic[e]:
        for i in range(3):
            for b in range(LANES):
                column[i, b] = gain * frame[3 * i + 2, b]
                column[3 + i, b] = 0.0
        return
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for b in range(LANES):
            column[i, b] = gain * (
                frame[3 * j + 2, b] * (tip[9 + k, b] - frame[9 + k, b])
                - frame[3 * k + 2, b] * (tip[9 + j, b] - frame[9 + j, b])
            )
            column[3 + i, b] = gain * frame[3 * i + 2, b]


@inner
def _into_tip_axes(tip, vectors):
    """Rotate linear and angular rows into tip axes, Rᵀ x."""
    for half in range(0, 6, 3):
        for b in range(LANES):
            x, y, z = vectors[half, b], vectors[half + 1, b], vectors[half + 2, b]
            vectors[half, b] = tip[0, b] * x + tip[3, b] * y + tip[6, b] * z
            vectors[half + 1, b] = tip[1, b] * x + tip[4, b] * y + tip[7, b] * z
            vectors[half + 2, b] = tip[2, b] * x + tip[5, b] * y + tip[8, b] * z


@inner
def task_jacobian(mechanism, question, work):
    """Compute the weighted J̃, (m, n, LANES); mimic joints add to their leader's column.

    Parameters
    ----------
    mechanism, question :
        The arm, and the task.
    work :
        Workspace with the frames; its J is filled in.
    """
    J, column = work.J, work.column
    J[:] = 0.0
    for e in range(mechanism.parent.size):
        if not mechanism.moves_tip[e]:
            continue
        _jacobian_column(mechanism, e, work)
        if question.in_tool and not question.is_whole:
            _into_tip_axes(work.tip, column)
        for r in range(question.rows.size):
            row, weight, d = question.rows[r], question.weights[r], mechanism.driver[e]
            for b in range(LANES):
                J[r, d, b] += weight * column[row, b]


@inner
def _drop_noise(floor, J, excess):
    """Set J to zero in the lanes where it holds nothing but rounding errors (theory §2.6).

    Parameters
    ----------
    floor :
        Entries up to which J is rounding, shape (m, n).
    J :
        Weighted task Jacobians, shape (m, n, LANES).
    excess :
        Workspace, shape (LANES,).
    """
    for b in range(LANES):
        excess[b] = -math.inf
    for r in range(J.shape[0]):
        for k in range(J.shape[1]):
            for b in range(LANES):
                excess[b] = max(excess[b], abs(J[r, k, b]) - floor[r, k])
    for b in range(LANES):
        if excess[b] <= 0.0:
            for r in range(J.shape[0]):
                for k in range(J.shape[1]):
                    J[r, k, b] = 0.0


@inner
def weight_torque(mechanism, work):
    """Compute the weighted gravity torques, shape (n, LANES), of everything each joint carries.

    Parameters
    ----------
    mechanism :
        The arm.
    work :
        Workspace with the frames; its weight is filled in.
    """
    g0, g1, g2 = mechanism.gravity[0], mechanism.gravity[1], mechanism.gravity[2]
    work.weight[:] = 0.0
    for e in range(mechanism.parent.size):
        mass, c, frame = mechanism.mass[e], mechanism.centre[e], work.frame[e]
        for i in range(3):
            for b in range(LANES):
                place = (
                    frame[3 * i, b] * c[0] + frame[3 * i + 1, b] * c[1] + frame[3 * i + 2, b] * c[2]
                )
                work.moment[e, i, b] = mass * (frame[9 + i, b] + place)
        work.mass[e] = mass
    for e in range(mechanism.parent.size - 1, -1, -1):
        above, d, gain = mechanism.parent[e], mechanism.driver[e], mechanism.gain[e]
        frame, h, mass = work.frame[e], work.moment[e], work.mass[e]
        if mechanism.is_prismatic[e]:
            for b in range(LANES):
                along = frame[2, b] * g0 + frame[5, b] * g1 + frame[8, b] * g2
                work.weight[d, b] -= gain * mass * along
        else:
            for b in range(LANES):
                x = h[0, b] - mass * frame[9, b]
                y = h[1, b] - mass * frame[10, b]
                z = h[2, b] - mass * frame[11, b]
                u, v, w = frame[2, b], frame[5, b], frame[8, b]
                torque = g0 * (v * z - w * y) + g1 * (w * x - u * z) + g2 * (u * y - v * x)
                work.weight[d, b] -= gain * torque
        if above >= 0:
            work.mass[above] += mass
            for i in range(3):
                for b in range(LANES):
                    work.moment[above, i, b] += h[i, b]


@inner
def gram(J, A):
    """Compute the lower triangle of A = J Jᵀ, shape (m, m, LANES).

    Parameters
    ----------
    J :
        Shape (m, n, LANES).
    A :
        Filled with the result, shape (m, m, LANES).
    """
    m, n = J.shape[0], J.shape[1]
    for i in range(m):
        for j in range(i + 1):
            for b in range(LANES):
                A[i, j, b] = J[i, 0, b] * J[j, 0, b]
            for d in range(1, n):
                for b in range(LANES):
                    A[i, j, b] += J[i, d, b] * J[j, d, b]


@inner
def downdate(A, J, joints, B):
    """Compute B = A - Σ J_k J_kᵀ over the locked joints: K Kᵀ from J Jᵀ.

    Parameters
    ----------
    A :
        Lower triangle of J Jᵀ, shape (m, m, LANES).
    J :
        Shape (m, n, LANES).
    joints :
        Indices of the locked joints.
    B :
        Filled with the lower triangle of K Kᵀ, shape (m, m, LANES).
    """
    for i in range(A.shape[0]):
        for j in range(i + 1):
            for b in range(LANES):
                B[i, j, b] = A[i, j, b]
            for k in joints:
                for b in range(LANES):
                    B[i, j, b] -= J[i, k, b] * J[j, k, b]


@inner
def _into_row_axes(question, given, tip, vector):
    """Express a force or a direction in the axes of the rows, tip or root axes."""
    if not (question.in_tool and question.is_whole):
        for i in range(given.size):
            for b in range(LANES):
                vector[i, b] = given[i]
        return
    for i in range(given.size):
        first, row = i - i % 3, 3 * (i % 3)
        x, y, z = given[first], given[first + 1], given[first + 2]
        for b in range(LANES):
            vector[i, b] = tip[row, b] * x + tip[row + 1, b] * y + tip[row + 2, b] * z
