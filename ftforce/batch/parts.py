"""Kernels in parts: functions that numba inserts where they are called, and compiles only there.

A function that is compiled on its own is compiled again inside every caller, and inside the
caller's callers. So what is long and called once is a part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


def part(function: Callable[..., Any]) -> Any:
    """Let kernels insert a function: it is compiled with them, and not apart."""
    from numba import njit

    return njit(function, inline="always", error_model="numpy", fastmath={"contract"})
