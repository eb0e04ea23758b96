"""How kernels are compiled: once per machine, kept on disk, without Python's lock."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable

# Products may be fused with sums; nothing else is rounded otherwise than it is written.
_FUSED = {"contract"}


def kernel(function: Callable[..., Any], **options: bool) -> Any:
    """Compile a function of numbers and arrays; division by zero gives infinity or NaN."""
    compile_: Any = njit  # its annotations leave out some options
    compiled = compile_(
        function, cache=True, nogil=True, error_model="numpy", fastmath=_FUSED, **options
    )
    return keyed(compiled)


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call: without the door for Python, which costs time."""
    return kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False)


def keyed(compiled: Any) -> Any:
    """Let a kernel on disk count for this state of all kernels only.

    Numba looks at the file of the kernel alone. One that calls kernels of another file would go on
    with their old code, and with their old arguments, when that file changes.
    """
    kept = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if kept is not None and hasattr(kept, "_source_stamp"):
        kept._source_stamp = (kept._source_stamp, _STATE)
    return compiled


def _state() -> str:
    files = sorted(Path(__file__).parent.glob("*.py"))
    content = b"".join(file.read_bytes() for file in files)
    return hashlib.sha256(content).hexdigest()


_STATE = _state()
