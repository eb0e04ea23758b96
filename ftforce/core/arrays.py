"""Array types, read-only arrays and input validation."""

from __future__ import annotations

import math
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from ftforce.errors import DimensionError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Vector: TypeAlias = "NDArray[np.float64]"
Matrix: TypeAlias = "NDArray[np.float64]"
Mask: TypeAlias = "NDArray[np.bool_]"

_Size = TypeVar("_Size", float, "Vector")

_LARGE, _SAFE = 1000, 1e100  # elements; a size whose square does not overflow
_FLOAT = np.dtype(np.float64)  # a singleton in NumPy, so it can be compared by identity


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Mark an array as read-only, in place, and return it."""
    array.setflags(False)  # type: ignore[call-arg] # write=False; twice as fast as the keyword
    return array


def as_vector(value: ArrayLike, size: int | None, name: str, hint: str = "") -> Vector:
    """Return a validated, read-only copy of ``value`` as a vector.

    Parameters
    ----------
    value :
        Anything NumPy can convert to a vector.
    size :
        Required number of elements; ``None`` for any.
    name, hint :
        Name of the value and an explanation of its elements, for error messages.

    Raises
    ------
    DimensionError
        The number of elements is wrong.
    InputError
        An element is not a finite real number.
    """
    vector = as_floats(value, name)
    if vector.ndim != 1 or (size is not None and len(vector) != size):
        expected = (size,) if size is not None else (1,)
        raise DimensionError(name, expected, vector.shape, hint)
    check_finite(vector, name)
    return read_only(vector)


def as_floats(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return a float copy of an array of real numbers; complex, text and boolean are rejected.

    Parameters
    ----------
    value :
        Anything NumPy can convert to an array.
    name :
        Name of the value, for error messages.

    Raises
    ------
    InputError
        The values are not real numbers, or form a ragged list.
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
    """Check that all elements are finite.

    Parameters
    ----------
    array :
        The array, of any shape.
    name :
        Name of the array, for error messages.

    Raises
    ------
    InputError
        An element is NaN or infinite; the message gives its position.
    """
    if array.size > _LARGE and array.max() < _SAFE and array.min() > -_SAFE:
        return  # a product of that size would start BLAS's threads
    if math.isfinite(np.vdot(array, array)):  # fast path: one pass
        return
    bad = np.argwhere(~np.isfinite(array))
    if not len(bad):  # finite elements whose squares overflow
        raise InputError(f"{name} contains numbers too large to compute with")
    place = ", ".join(str(i + 1) for i in bad[0])
    raise InputError(
        f"{name} contains {array[tuple(bad[0])]} at position {place}; numbers must be finite"
    )


def norm(x: Vector) -> float:
    """Return ‖x‖ without underflow or overflow of the squares."""
    return math.hypot(*x.tolist())


def safe_divide(x: _Size, scale: float, otherwise: _Size) -> _Size:
    """Return x / scale, or ``otherwise`` if the scale is zero.

    Parameters
    ----------
    x :
        A number or a vector.
    scale :
        Divisor, 0 or more.
    otherwise :
        Result if the divisor is zero.
    """
    return x / scale if scale > 0.0 else otherwise


def is_number(value: object) -> bool:
    """Return whether a value is a finite real number; booleans are rejected."""
    if value.__class__ is float:  # by far the most frequent
        return math.isfinite(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer too large for a float
        return False
