"""Whether an arm can finish its path whichever joint locks, at whichever waypoint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.planning.tool_path import project

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.tool_path import TipTargets
    from ftforce.robot.robot import Robot

_AT_LIMIT = 1e-9  # rad or m
_ROUNDING = 1e-9  # relative: a joint at its velocity limit is within it

REASONS = ("reach", "position limit", "velocity limit", "force")
"""Why the damaged arm stops following the path."""


class Broken(NamedTuple):
    """A lock after which the damaged arm was not seen to finish the path.

    Attributes
    ----------
    waypoint :
        Where the joint locks, from 0.
    joint :
        Index of the joint.
    until :
        The first waypoint that is not followed.
    reason :
        One of ``REASONS``.
    other :
        Index of the joint that is at its limit; -1 for none.
    """

    waypoint: int
    joint: int
    until: int
    reason: str
    other: int


@dataclass(frozen=True, eq=False)
class Guarantee:
    """What is guaranteed on a path through k waypoints.

    Attributes
    ----------
    holds :
        Whether the damaged arm finishes the path if a joint locks at a waypoint, shape (k, n).
    broken :
        The locks of which that was not shown.
    """

    holds: Mask
    broken: tuple[Broken, ...]

    @property
    def share(self) -> float:
        """Share of waypoints and joints for which it holds."""
        return float(self.holds.mean())


def guarantee(
    robot: Robot,
    q: Matrix,
    targets: TipTargets,
    steps: Matrix,
    keeps_force: Callable[[Matrix, NDArray[np.intp]], Mask] | None = None,
) -> Guarantee:
    """Let every joint lock at every waypoint, and follow the rest of the path with the others.

    From waypoint to waypoint the other joints move as little as they can. An arm that follows so
    is a certificate: it was seen to finish. One that does not may finish on another way.

    Parameters
    ----------
    robot :
        The arm.
    q :
        The path, rad or m, shape (k, n).
    targets :
        Targets of the tip at the k waypoints.
    steps :
        Largest motion of each joint from one waypoint to the next, rad or m, shape (k - 1, n).
    keeps_force :
        Whether the force is kept in postures, (N, n), with a joint locked, (N,); ``None`` if no
        force is to be kept.
    """
    k, n = q.shape
    holds = np.ones((k, n), dtype=np.bool_)
    broken: list[Broken] = []
    # The arms that are on their way: where and which joint locked, and where they are.
    start, joint = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    at = np.zeros((0, n))
    for w in range(k):
        at, failures = _followed(robot, at, joint, targets.one(w), steps[w - 1] if w else None)
        at = np.concatenate([at, np.repeat(q[w : w + 1], n, axis=0)])
        start = np.concatenate([start, np.full(n, w, dtype=np.intp)])
        joint = np.concatenate([joint, np.arange(n)])
        failures += [None] * n
        if keeps_force is not None:
            for i in np.flatnonzero(~keeps_force(at, joint)).tolist():
                failures[i] = failures[i] or ("force", -1)
        for i, failure in enumerate(failures):
            if failure is not None:
                holds[start[i], joint[i]] = False
                broken.append(Broken(int(start[i]), int(joint[i]), w, *failure))
        left = np.array([failure is None for failure in failures])
        start, joint, at = start[left], joint[left], at[left]
    return Guarantee(read_only(holds), tuple(sorted(broken)))


def _followed(
    robot: Robot,
    at: Matrix,
    joint: NDArray[np.intp],
    target: TipTargets,
    step: Vector | None,
) -> tuple[Matrix, list[tuple[str, int] | None]]:
    """Return where arms are after the next waypoint, and why those fail that do."""
    if not len(at):
        return at, []
    assert step is not None
    locked = np.zeros(at.shape, dtype=np.bool_)
    locked[np.arange(len(at)), joint] = True
    found, reached = project(robot, at, target, locked=locked)
    moved = np.abs(found - at) / step
    failures: list[tuple[str, int] | None] = []
    for i, is_there in enumerate(reached.tolist()):
        failures.append(None)
        if not is_there:
            is_at = (found[i] >= robot.upper - _AT_LIMIT) | (found[i] <= robot.lower + _AT_LIMIT)
            stopped = np.flatnonzero(is_at & ~locked[i])
            failures[i] = ("position limit", int(stopped[0])) if len(stopped) else ("reach", -1)
        elif moved[i].max() > 1.0 + _ROUNDING:
            failures[i] = ("velocity limit", int(moved[i].argmax()))
    return found, failures
