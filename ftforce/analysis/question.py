"""Validation and defaults of arguments that several analyses share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from ftforce.analysis.limits_files import URDF
from ftforce.core.arrays import Vector, as_vector
from ftforce.core.faults import FaultMode, FaultSet, count_fault_sets
from ftforce.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.core.task import Task
    from ftforce.robot.robot import Robot

MOST_SETS = 1_000_000  # about a minute and a gigabyte; a sweep stores no individual sets


class Progress(Protocol):
    """Callback with the number of fault sets completed and their total."""

    def __call__(self, done: int, total: int, /) -> None:
        """Report progress."""


def checked_mode(mode: FaultMode | str) -> FaultMode:
    """Return the fault mode for the analysis of many fault sets.

    Raises
    ------
    InputError
        The mode is unknown, or is ``weak``, which needs a factor per joint.
    """
    how = FaultMode.parse(mode)
    if how is FaultMode.WEAK:
        raise InputError(
            "many sets at once take locked or free joints; ask analyze about weak ones"
        )
    return how


def direction_or_force(task: Task, direction: ArrayLike | None, F: Vector | None) -> Vector | None:
    """Return the unit direction of a capability, unweighted; ``None`` for the weakest direction.

    Parameters
    ----------
    task :
        The task.
    direction :
        Requested direction in task axes, shape (m,).
    F :
        Weighted force that supplies the direction if none is requested.

    Raises
    ------
    InputError
        The direction is malformed or zero.
    """
    if direction is not None:
        names = ", ".join(task.components)
        vector = as_vector(direction, task.m, "direction", f"{names} of the task '{task}'")
        if not vector.any():
            raise InputError("the direction needs a component that is not zero")
        return task.direction_of(vector)
    if F is None or not F.any():
        return None
    return task.direction_of(task.unweigh_force(F))


def check_size(robot: Robot, faults: int) -> None:
    """Check the size of the largest fault sets.

    Raises
    ------
    InputError
        The size is not between 1 and n, or there are too many sets.
    """
    if isinstance(faults, bool) or not isinstance(faults, int) or not 1 <= faults <= robot.n:
        raise InputError(f"faults must be a number from 1 to {robot.n}, got {faults!r}")
    total = count_fault_sets(robot.n, faults)
    if total > MOST_SETS:
        raise InputError(
            f"{total:,} fault sets of up to {faults} of {robot.n} joints are more than one census "
            f"takes ({MOST_SETS:,}); ask for smaller sets"
        )


def limits_for(faults: FaultSet, limits: LimitsLike) -> LimitsLike:
    """Return the limits to apply; weak joints default to those of the URDF."""
    return URDF if limits is None and faults.in_mode(FaultMode.WEAK) else limits
