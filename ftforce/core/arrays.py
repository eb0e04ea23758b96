"""Array types, read-only results and the checks at the border that the mathematics trusts."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftforce.errors import DimensionError, InputError

Vector: TypeAlias = NDArray[np.float64]
Matrix: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]

_Size = TypeVar("_Size", float, Vector)

_FLOAT = np.dtype(np.float64)  # NumPy has one object for it: an identity costs the least


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Mark an array that we own as read-only and return it."""
    array.setflags(False)  # type: ignore[call-arg] # write=False; by keyword it takes twice the time
    return array


def as_vector(value: ArrayLike, size: int | None, name: str, hint: str = "") -> Vector:
    """Return a checked, read-only copy of ``value`` as a vector.

    Parameters
    ----------
    value :
        Anything NumPy can turn into a vector.
    size :
        The number of elements that is wanted; ``None`` takes any.
    name, hint :
        What the value is, and what a message should add about its elements.

    Raises
    ------
    DimensionError
        Wrong number of elements.
    InputError
        Not numbers, or not finite.
    """
    vector = as_floats(value, name)
    if vector.ndim != 1 or (size is not None and len(vector) != size):
        expected = (size,) if size is not None else (1,)
        raise DimensionError(name, expected, vector.shape, hint)
    check_finite(vector, name)
    return read_only(vector)


def as_floats(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return a copy of real numbers; complex ones, texts and truth values are none.

    Raises
    ------
    InputError
        Something else than real numbers, or a ragged list.
    """
    try:
        array = np.array(value)
    except ValueError:
        raise InputError(f"{name} needs numbers, got {value!r}") from None
    if array.dtype is _FLOAT:
        return array
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} needs numbers, got {value!r}")
    return array.astype(np.float64)


def check_finite(array: NDArray[np.float64], name: str) -> None:
    """Raise an error that shows where ``array`` holds NaN or infinity.

    Raises
    ------
    InputError
        An element is not finite.
    """
    if math.isfinite(np.vdot(array, array)):  # one fast pass for the good case
        return
    bad = np.argwhere(~np.isfinite(array))
    if not len(bad):  # finite numbers whose squares overflow
        raise InputError(f"{name} holds numbers too large to compute with")
    place = ", ".join(str(i + 1) for i in bad[0])
    raise InputError(
        f"{name} holds {array[tuple(bad[0])]} at position {place}; numbers must be finite"
    )


def norm(x: Vector) -> float:
    """Return ‖x‖, also where squares vanish or overflow."""
    return math.hypot(*x.tolist())


def over(x: _Size, scale: float, otherwise: _Size) -> _Size:
    """Return x / scale, or something else without a scale."""
    return x / scale if scale > 0.0 else otherwise


def is_number(value: object) -> bool:
    """Return whether a value is a finite real number; a truth value is none."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False
