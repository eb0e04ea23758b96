"""What all files of postures share: which column is whose joint's, and which numbers will do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.arrays import read_only
from ftforce.errors import InputError, listed
from ftforce.source import LARGEST_NUMBER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.arrays import Matrix, Vector
    from ftforce.robot import Joint, Robot

ROWS = 1 << 16  # that are checked at a time


def matched(robot: Robot, header: tuple[str, ...], degrees: bool) -> tuple[tuple[int, ...], Vector]:
    """Find the columns of a robot's joints among others.

    Parameters
    ----------
    robot :
        The arm.
    header :
        Names of all columns; a joint's may carry a unit in brackets, ``elbow [deg]``.
    degrees :
        Whether angles are in degrees where no unit says otherwise.

    Returns
    -------
    :
        The column of each joint, from 0, and what turns it into rad or m, shape (n,).

    Raises
    ------
    InputError
        A joint is missing or there twice, or has a unit that it cannot have.
    """
    columns: dict[str, int] = {}
    scales = {}
    for i, cell in enumerate(header):
        name, unit = (cell, "") if cell in robot.names else split_unit(cell)
        if name not in robot.names:
            continue
        if name in columns:
            raise InputError(f"column {name!r} is there twice")
        columns[name] = i
        scales[name] = _scale(robot.joints[robot.names.index(name)], cell, unit, degrees)
    if missing := [name for name in robot.names if name not in columns]:
        raise InputError(
            f"lacks the column{'s' if len(missing) > 1 else ''} {listed(missing)}; postures need "
            f"every joint by its name; the columns are: {listed(header)}"
        )
    factors = np.array([scales[name] for name in robot.names])
    return tuple(columns[name] for name in robot.names), read_only(factors)


def split_unit(cell: str) -> tuple[str, str]:
    """Return name and unit of ``name [unit]``."""
    name, bracket, unit = cell.removesuffix("]").rpartition("[")
    if not bracket or not cell.endswith("]"):
        return cell, ""
    return name.strip(), unit.strip()


def _scale(joint: Joint, cell: str, unit: str, degrees: bool) -> float:
    known = {"m": 1.0} if joint.unit == "m" else {"rad": 1.0, "deg": math.radians(1.0)}
    if unit and unit not in known:
        raise InputError(f"column {cell!r}: its unit can be {' or '.join(known)}")
    return known[unit] if unit else known["deg" if degrees and "deg" in known else joint.unit]


def check_numbers(blocks: Iterator[Matrix], names: tuple[str, ...]) -> None:
    """Check that all numbers are finite and no nonsense.

    Raises
    ------
    InputError
        One is not; the message says where.
    """
    first = 0
    for block in blocks:
        wrong = ~(np.abs(block) <= LARGEST_NUMBER)  # NaN is not less
        if wrong.any():
            i, j = np.argwhere(wrong)[0].tolist()
            raise InputError(
                f"row {first + i + 1}, joint {names[j]}: {block[i, j]:g} cannot be used; every "
                f"posture needs every joint, a number up to {LARGEST_NUMBER:g}"
            )
        first += len(block)
