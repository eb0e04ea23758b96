"""What the kernels are given, as arrays and numbers: mechanism, faults, question, answers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Iterable


LANES = 128
"""Postures that the kernels answer side by side."""

CELL_BINS = 32
"""Bins of margin and ρ, 0 to 1, in a cell of the workspace, and of a posture's smallest ρ."""

UNDECIDED = -1
"""Verdict, or rank, that is left to the accurate part."""

GUARD_BAND = 1.0 + 1e-6
"""Closer to a tolerance than this, relative, the fast parts decide nothing."""

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]
Whole = NDArray[np.int64]
Codes = NDArray[np.int8]

_LINE = 64  # bytes of a line of the caches


def aligned(
    shape: int | tuple[int, ...], kind: type = np.float64, multiple: int = _LINE, offset: int = 0
) -> NDArray[Any]:
    """Return an empty array that begins some bytes after a multiple of so many."""
    size = math.prod(shape if isinstance(shape, tuple) else (shape,)) * np.dtype(kind).itemsize
    raw = np.empty(size + 2 * multiple, np.uint8)
    first = -raw.ctypes.data % multiple + offset % multiple
    return raw[first : first + size].view(kind).reshape(shape)


def aligned_zeros(shape: int | tuple[int, ...], kind: type = np.float64) -> NDArray[Any]:
    """Return zeros that begin at a line of the caches, for a workspace.

    Workspaces are made by Python: to compile what makes them takes longer than all they are for.
    """
    zeros = aligned(shape, kind)
    zeros.fill(0)
    return zeros


def aligned_arrays(shapes: Iterable[int | tuple[int, ...]]) -> list[NDArray[Any]]:
    """Return zeros of these shapes, likewise."""
    return [aligned_zeros(shape) for shape in shapes]


class Mechanism(NamedTuple):
    """A tree of E joints with one degree of freedom each, driven by the chain's n numbers.

    Joint e turns about, or slides along, the z axis of its own frame by
    ``ratio · q[driver] + offset``. Parents come before their children.

    Attributes
    ----------
    parent :
        Index of the joint that carries each, -1 for the root, shape (E,).
    slides :
        Whether it is prismatic, shape (E,).
    placement :
        Its frame in its parent's before it moves: rotation by rows and translation, m, (E, 12).
    driver :
        Which of the n joints drives it, shape (E,).
    ratio, offset :
        1 and 0 but for mimic joints, shape (E,).
    moves_tip :
        Whether it lies between root and tip, shape (E,).
    tip :
        The tip's frame in that of the joint that carries it, as in ``placement``, shape (12,).
    tip_parent :
        Index of that joint.
    mass :
        Of what each joint carries up to the next ones, kg, shape (E,).
    centre :
        Centre of that mass in the joint's frame, m, shape (E, 3).
    gravity :
        In the root's axes, m/s², shape (3,).
    """

    parent: Whole
    slides: Mask
    placement: Matrix
    driver: Whole
    ratio: Vector
    offset: Vector
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
        True at the joints that a brake holds, and at those without torque, shape (S, n).
    swings :
        Whether any joint of the set is without torque, shape (S,).
    start, joints :
        Set s locks ``joints[start[s]:start[s + 1]]``.
    """

    locked: Mask
    free: Mask
    swings: Mask
    start: Whole
    joints: Whole


class Question(NamedTuple):
    """What is asked at every posture.

    Attributes
    ----------
    rows, weights :
        Rows of the frame Jacobian, linear first, and their weights (1 or L), shape (m,).
    in_tool :
        Whether the rows, the force and the direction are in the axes of the tip frame.
    is_whole :
        Whether the rows are all forces, all moments or both, in order: then everything that is
        reported is the same in all axes, and J is not turned into those of the tip.
    force :
        Weighted force that is asked for, shape (m,), or (0,) without.
    direction :
        Weighted direction of the capability, shape (m,), or (0,) without.
    effort, brake :
        Largest torques of motors and brakes, N·m (N), NaN where unknown, shape (n,).
    rtol, wary :
        Tolerances.
    weighs :
        Whether the arm's weight matters to what is asked.
    """

    rows: Whole
    weights: Vector
    in_tool: bool
    is_whole: bool
    force: Vector
    direction: Vector
    effort: Vector
    brake: Vector
    rtol: float
    wary: float
    weighs: bool


class Answers(NamedTuple):
    """Arrays that the kernels fill, as in `Block`; (0, 0) if not asked for.

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
"""Codes of the verdicts, from harmless to bad."""


class Block(NamedTuple):
    """k postures and S fault sets.

    Attributes
    ----------
    tip :
        Position of the tip in the root's axes, m, shape (k, 3).
    rank :
        Rank of the healthy arm, shape (k,).
    healthy_margin :
        σ_min(J)/σ_max(J), shape (k,).
    verdict :
        `TOLERATED`, `BORDERLINE` or `NOT_TOLERATED`, shape (S, k).
    rank_lost :
        Rank of J less that of K, shape (S, k).
    sigma_min, margin, rho :
        σ_min(K), σ_min(K)/σ_max(J) and ρ = w(K)/w(J) (NaN where w(J) = 0), shape (S, k).
    jump, moment_jump, relative_jump :
        ‖ΔF‖ of the forces, N (of the moments, N·m, if the task has no forces); of the moments,
        N·m; and the weighted ‖ΔF‖/‖F̂‖; NaN where the arm cannot stand still (then
        ``relative_jump`` is 1), shape (S, k). ``None`` without a force, the moments' also if the
        task has not both.
    capability :
        The largest force that can be commanded in the direction, N (N·m), infinite if no limit
        that is known ends it, NaN if the arm cannot stand still with any, shape (S, k); ``None``
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
