"""What all files of postures share: which column is whose joint's, and which numbers will do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.errors import InputError, listed
from ftforce.io.csv_table import POSITION_UNITS, find_columns
from ftforce.io.text import LARGEST_NUMBER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.robot import Robot

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
    units = {joint.name: POSITION_UNITS[joint.unit] for joint in robot.joints}
    if degrees:
        units = {name: {**known, "": known.get("deg", 1.0)} for name, known in units.items()}
    columns = find_columns(header, units)
    if missing := [name for name in robot.names if name not in columns]:
        raise InputError(
            f"lacks the column{'s' if len(missing) > 1 else ''} {listed(missing)}; postures need "
            f"every joint by its name; the columns are: {listed(header)}"
        )
    numbers, scales = zip(*(columns[name] for name in robot.names), strict=True)
    return numbers, read_only(np.array(scales))


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
