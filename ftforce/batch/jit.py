"""How kernels are compiled: once per machine, kept on disk, without Python's lock."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable

# Products may be fused with sums; nothing else is rounded otherwise than it is written.
_FUSED = {"contract"}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of numbers and arrays; division by zero gives infinity or NaN."""
    return njit(function, cache=True, nogil=True, error_model="numpy", fastmath=_FUSED)


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call: without the door for Python, which costs time."""
    compiled: Any = njit  # its annotations leave out the last three
    return compiled(
        function, cache=True, nogil=True, error_model="numpy", fastmath=_FUSED,
        no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False,
    )  # fmt: skip
