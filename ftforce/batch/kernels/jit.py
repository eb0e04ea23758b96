"""How kernels are compiled: once per machine, kept on disk, without the GIL.

Numba's cache looks at the file of a kernel alone. One that calls kernels of another file would go
on with their old code, and old kernels are wrong numbers. So an entry counts for one state of all
files of this package, and for nothing else of ftforce.
"""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from numba import njit
from numba.core.dispatcher import Dispatcher

if TYPE_CHECKING:
    from collections.abc import Callable

# Products may be fused with sums; nothing else is rounded otherwise than it is written.
_FUSED = {"contract"}

UNKNOWN_CACHE = (
    f"numba {numba.__version__} keeps compiled code in a way that ftforce does not know; "
    "its kernels are compiled anew in every process"
)


def kernel(function: Callable[..., Any], **options: bool) -> Any:
    """Compile a function of numbers and arrays; division by zero gives infinity or NaN."""
    compile_: Any = njit  # its annotations leave out some options
    common = {"nogil": True, "error_model": "numpy", "fastmath": _FUSED, **options}
    compiled = compile_(function, cache=True, **common)
    if not isinstance(compiled, Dispatcher) or _is_keyed(compiled):  # plain Python if JIT is off
        return compiled
    warnings.warn(UNKNOWN_CACHE, RuntimeWarning, stacklevel=2)
    return compile_(function, cache=False, **common)


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call: without the door for Python, which costs time."""
    return kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False)


def _is_keyed(compiled: Any) -> bool:
    """Let what is on disk count for this state of all kernels only; return whether that worked.

    The attributes are private; tried on numba 0.61 to 0.68.
    """
    kept: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if not hasattr(kept, "_source_stamp"):
        return False
    kept._source_stamp = _STATE
    return True


def _state() -> str:
    files = sorted(Path(__file__).parent.glob("*.py"))
    content = b"\0".join(file.read_bytes() for file in files)
    return hashlib.sha256(content).hexdigest()


_STATE = _state()
