"""Whether an arm can finish its path whichever joint locks, at whichever waypoint."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.analysis.limits_files import URDF
from ftforce.analysis.question import AllFaultSets, Question
from ftforce.core.arrays import norm, read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.planning.objective import Objective
from ftforce.planning.projection import project

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.core.arrays import Mask, Matrix, Vector
    from ftforce.planning.locks import Locks
    from ftforce.planning.target import TipTarget
    from ftforce.planning.tool_path import ToolPath
    from ftforce.robot.robot import Robot

_ITERATIONS = 12  # of Newton's method; a step to the next waypoint needs about three
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
    t :
        Times of the waypoints at the speed that was asked for, s, shape (k,).
    holds :
        Whether the damaged arm finishes the path if a joint locks at a waypoint, shape (k, n).
    broken :
        The locks of which that was not shown.
    """

    t: Vector
    holds: Mask
    broken: tuple[Broken, ...]

    @property
    def share(self) -> float:
        """Share of waypoints and joints for which it holds."""
        return float(self.holds.mean())


@dataclass(frozen=True, eq=False)
class ForceKept:
    """Whether a force is kept when any joint locks.

    Attributes
    ----------
    objective :
        The largest force along that of the tool, or what is lost of it if there are no limits;
        fault set i is a lock of joint i.
    """

    objective: Objective

    @classmethod
    def parse(cls, robot: Robot, locks: Locks | None, **asked: Any) -> ForceKept:
        """Return the question whether a force is kept.

        Parameters
        ----------
        robot, locks :
            The arm, and joints that have locked before.
        asked :
            As of `Objective.parse`, with the force.
        """
        sets = AllFaultSets.of(robot.n, 1, FaultMode.LOCKED)
        own = () if locks is None else locks.joints
        if asked["limits"] is None and np.isfinite(robot.effort).any():
            asked["limits"] = URDF
        has_limits = Question.parse(robot, **asked).limits is not None
        objective = Objective.parse(robot, "capability" if has_limits else "jump", sets, **asked)
        return cls(
            replace(objective, sets=tuple(FaultSet.locked({i, *own}) for i in range(robot.n)))
        )

    def __call__(self, q: Matrix, joint: NDArray[np.intp]) -> Mask:
        """Return whether the force is kept in postures, with a joint locked in each, shape (k,).

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (k, n).
        joint :
            The locked joints, shape (k,).
        """
        F = self.objective.question.F
        assert F is not None
        found = self.objective.measured(q)[np.arange(len(q)), joint]
        if self.objective.name == "jump":
            return np.asarray(found <= self.objective.question.rtol * norm(F))
        return np.asarray(found >= norm(F) * (1.0 - _ROUNDING))


def guarantee_of(
    tool: ToolPath, q: Matrix, t: Vector, steps: Matrix, kept: ForceKept | None = None
) -> Guarantee:
    """Let every joint lock at every waypoint, and follow the rest of the path with the others.

    From waypoint to waypoint the other joints move as little as they can. An arm that follows so
    is a certificate: it was seen to finish. One that does not may finish on another way.

    Parameters
    ----------
    tool :
        The path of the tip.
    q :
        The path through the waypoints, rad or m, shape (k, n).
    t :
        Their times, s, shape (k,).
    steps :
        Largest motion of each joint from one waypoint to the next, rad or m, shape (k - 1, n).
    kept :
        Whether the force is kept; ``None`` if there is none to keep.
    """
    k, n = q.shape
    targets = tool.at(t)
    holds = np.ones((k, n), dtype=np.bool_)
    broken: list[Broken] = []
    # The arms that are on their way: where and which joint locked, and where they are.
    start, joint = np.zeros((2, 0), dtype=np.intp)
    at = np.zeros((0, n))
    for w in range(k):
        failures: list[tuple[str, int] | None] = []
        if w:
            at, failures = _followed(tool, at, joint, targets.at(w), steps[w - 1])
        at = np.concatenate([at, np.repeat(q[w : w + 1], n, axis=0)])
        start = np.concatenate([start, np.full(n, w, dtype=np.intp)])
        joint = np.concatenate([joint, np.arange(n)])
        failures += [None] * n
        if kept is not None:
            for i in np.flatnonzero(~kept(at, joint)).tolist():
                failures[i] = failures[i] or ("force", -1)
        for i, failure in enumerate(failures):
            if failure is not None:
                holds[start[i], joint[i]] = False
                broken.append(Broken(int(start[i]), int(joint[i]), w, *failure))
        left = np.array([failure is None for failure in failures])
        start, joint, at = start[left], joint[left], at[left]
    return Guarantee(read_only(t), read_only(holds), tuple(sorted(broken)))


def _followed(
    tool: ToolPath, at: Matrix, joint: NDArray[np.intp], target: TipTarget, step: Vector
) -> tuple[Matrix, list[tuple[str, int] | None]]:
    """Return where arms are after the next waypoint, and why those fail that do."""
    robot = tool.robot
    locked = np.broadcast_to(tool.locked, at.shape).copy()
    locked[np.arange(len(at)), joint] = True
    found, reached = project(robot, at, target, iterations=_ITERATIONS, locked=locked)
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
