"""Inputs and outputs of the kernels as arrays: mechanism, faults, question, answers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Iterable


LANES = 128
"""Postures that the kernels process side by side."""

CELL_BINS = 32
"""Number of bins of margin and ρ, 0 to 1, per workspace cell, and of a posture's smallest ρ."""

UNDECIDED = -1
"""Placeholder for a verdict or rank that is left to `settle`."""

GUARD_BAND = 1.0 + 1e-6
"""Factor around a tolerance within which the fast kernels leave a case undecided."""

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]
Integers = NDArray[np.int64]
Codes = NDArray[np.int8]

_LINE = 64  # bytes per cache line


def aligned(
    shape: int | tuple[int, ...], dtype: type = np.float64, multiple: int = _LINE, offset: int = 0
) -> NDArray[Any]:
    """Return an uninitialized array at ``offset`` bytes past a multiple of ``multiple`` bytes.

    Parameters
    ----------
    shape, dtype :
        Shape and data type.
    multiple, offset :
        Alignment of the first element, bytes.
    """
    size = math.prod(shape if isinstance(shape, tuple) else (shape,)) * np.dtype(dtype).itemsize
    raw = np.empty(size + 2 * multiple, np.uint8)
    first = -raw.ctypes.data % multiple + offset % multiple
    return raw[first : first + size].view(dtype).reshape(shape)


def aligned_zeros(shape: int | tuple[int, ...], dtype: type = np.float64) -> NDArray[Any]:
    """Return zeros aligned to a cache line, for a workspace.

    Workspaces are allocated in Python, since compiling their allocation takes too long.

    Parameters
    ----------
    shape, dtype :
        Shape and data type.
    """
    zeros = aligned(shape, dtype)
    zeros.fill(0)
    return zeros


def aligned_arrays(shapes: Iterable[int | tuple[int, ...]]) -> list[NDArray[Any]]:
    """Return zeros of these shapes, aligned to cache lines."""
    return [aligned_zeros(shape) for shape in shapes]


class Mechanism(NamedTuple):
    """A tree of E joints with one degree of freedom each, driven by the chain's n positions.

    Joint e rotates about, or translates along, the z axis of its own frame by
    ``ratio · q[driver] + offset``. Parents come before their children.

    Attributes
    ----------
    parent :
        Index of each joint's parent joint, -1 for the root, shape (E,).
    is_prismatic :
        Whether it is prismatic, shape (E,).
    placement :
        Its frame in its parent's at zero displacement: row-major rotation and translation, m,
        shape (E, 12).
    driver :
        Index of the chain joint that drives it, shape (E,).
    ratio, offset :
        1 and 0 except for mimic joints, shape (E,).
    gain :
        Share of its column, and of its gravity torque, in those of its driver: ``ratio``, times
        the weight of the driver where hinges are weighed against slides, shape (E,).
    moves_tip :
        Whether it lies between root and tip, shape (E,).
    tip :
        The tip frame in that of its parent joint, as in ``placement``, shape (12,).
    tip_parent :
        Index of the tip's parent joint.
    mass :
        Mass between each joint and the next ones, kg, shape (E,).
    centre :
        Centre of that mass in the joint's frame, m, shape (E, 3).
    gravity :
        In root axes, m/s², shape (3,).
    """

    parent: Integers
    is_prismatic: Mask
    placement: Matrix
    driver: Integers
    ratio: Vector
    offset: Vector
    gain: Vector
    moves_tip: Mask
    tip: Vector
    tip_parent: int
    mass: Vector
    centre: Matrix
    gravity: Vector


class Faults(NamedTuple):
    """S fault sets.

    Attributes
    ----------
    locked, free :
        True at the locked joints, and at the free-swinging ones, shape (S, n).
    has_free :
        Whether any joint of the set is free-swinging, shape (S,).
    start, joints :
        Set s locks ``joints[start[s]:start[s + 1]]``.
    """

    locked: Mask
    free: Mask
    has_free: Mask
    start: Integers
    joints: Integers


class Question(NamedTuple):
    """What to compute at every posture.

    Attributes
    ----------
    rows, weights :
        Rows of the frame Jacobian, linear first, and their weights (1 or L), shape (m,).
    floor :
        Entries of the weighted J up to which it is rounding (theory §2.6), shape (m, n).
    in_tool :
        Whether the rows, the force and the direction are in tip axes.
    is_whole :
        Whether the rows are all forces, all moments or both, in order. All results are then the
        same in any axes, and J need not be rotated into tip axes.
    force :
        Weighted requested force, shape (m,), or (0,) without one.
    direction :
        Weighted direction of the capability, shape (m,), or (0,) without one.
    effort, brake :
        Largest torques of motors and brakes, weighted, NaN where unknown, shape (n,). Where the
        lower limit of a motor is another than the upper one, half the distance between them.
    middle :
        Middle between the two limits of each motor, weighted, shape (n,); 0 if they are the same.
    friction :
        Torques that the friction of free-swinging joints bears, weighted, NaN where it is a share
        of the largest gravity torque, shape (n,).
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    needs_gravity :
        Whether gravity torques are needed.
    """

    rows: Integers
    weights: Vector
    floor: Matrix
    in_tool: bool
    is_whole: bool
    force: Vector
    direction: Vector
    effort: Vector
    middle: Vector
    brake: Vector
    friction: Vector
    rtol: float
    wary: float
    needs_gravity: bool


class Answers(NamedTuple):
    """Output arrays of the kernels, as in `Block`; of shape (0, 0) if not requested.

    Attributes
    ----------
    tip, rank, healthy_margin :
        Shapes (k, 3), (k,) and (k,).
    verdict, rank_lost, sigma_min, margin, rho, jump, moment_jump, relative_jump, capability :
        Shape (S, k).
    """

    tip: Matrix
    rank: Codes
    healthy_margin: Vector
    verdict: Codes
    rank_lost: Codes
    sigma_min: Matrix
    margin: Matrix
    rho: Matrix
    jump: Matrix
    moment_jump: Matrix
    relative_jump: Matrix
    capability: Matrix


TOLERATED, BORDERLINE, NOT_TOLERATED = 0, 1, 2
"""Codes of the verdicts, from best to worst."""


class Block(NamedTuple):
    """Results for k postures and S fault sets.

    Attributes
    ----------
    tip :
        Position of the tip in root axes, m, shape (k, 3).
    rank :
        Rank of the healthy arm, shape (k,).
    healthy_margin :
        σ_min(J)/σ_max(J), shape (k,).
    verdict :
        `TOLERATED`, `BORDERLINE` or `NOT_TOLERATED`, shape (S, k).
    rank_lost :
        rank(J) - rank(K), shape (S, k).
    sigma_min, margin, rho :
        σ_min(K), σ_min(K)/σ_max(J) and ρ = w(K)/w(J) (NaN where w(J) = 0), shape (S, k).
    jump, moment_jump, relative_jump :
        ‖ΔF‖ of the forces, N (of the moments, N·m, if the task has no forces); of the moments,
        N·m; and the weighted ‖ΔF‖/‖F̂‖, shape (S, k). NaN where the arm cannot be held in static
        equilibrium, except ``relative_jump``, which is then 1. ``None`` without a force;
        ``moment_jump`` also unless the task has both forces and moments.
    capability :
        Largest force that can be commanded in the direction, N (N·m), infinite if no known limit
        bounds it, NaN if no force holds the arm in static equilibrium, shape (S, k); ``None``
        without a direction.
    """

    tip: Matrix
    rank: Codes
    healthy_margin: Vector
    verdict: Codes
    rank_lost: Codes
    sigma_min: Matrix
    margin: Matrix
    rho: Matrix
    jump: Matrix | None
    moment_jump: Matrix | None
    relative_jump: Matrix | None
    capability: Matrix | None
