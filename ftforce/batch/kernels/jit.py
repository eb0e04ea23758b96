"""Compilation of kernels: once per machine, cached on disk, releasing the GIL.

Numba's cache tracks only the file of a kernel, so a kernel that calls others in another file would
keep using stale code, and give wrong results. Cache entries are therefore keyed by the content of
all files of this package, and of nothing else in ftforce.
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

# Products and sums may be fused; otherwise floating-point semantics are strict.
_FUSED = {"contract"}

UNKNOWN_CACHE = (
    f"the cache format of numba {numba.__version__} is unknown to ftforce; "
    "kernels are recompiled in every process"
)


def kernel(function: Callable[..., Any], **options: bool) -> Any:
    """Compile a function of numbers and arrays; division by zero gives infinity or NaN.

    Parameters
    ----------
    function :
        What to compile, for every combination of argument types on its first call.
    **options :
        Further options of numba's `njit`.
    """
    compile_: Any = njit  # its type annotations lack some options
    common = {"nogil": True, "error_model": "numpy", "fastmath": _FUSED, **options}
    compiled = compile_(function, cache=True, **common)
    if not isinstance(compiled, Dispatcher) or _is_keyed(compiled):  # plain Python if JIT is off
        return compiled
    warnings.warn(UNKNOWN_CACHE, RuntimeWarning, stacklevel=2)
    return compile_(function, cache=False, **common)


def compile_now(function: Callable[..., Any], signature: Any, **options: bool) -> Any:
    """Compile a kernel at once, for a single signature; calls never compile anything.

    Parameters
    ----------
    function :
        What to compile.
    signature :
        Its numba signature.
    **options :
        As of `kernel`.
    """
    compiled = kernel(function, **options)
    if isinstance(compiled, Dispatcher):
        compiled.compile(signature)
        compiled.disable_compile()
    return compiled


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call: no Python wrapper, which takes time to compile."""
    return kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False)


def _is_keyed(compiled: Any) -> bool:
    """Key the disk cache by the state of all kernels, and return whether that worked.

    Relies on private attributes, tested with numba 0.61 to 0.68.
    """
    cache: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if not (hasattr(cache, "_source_stamp") and hasattr(cache, "_version")):
        return False
    cache._source_stamp = _STATE
    # The version is compared before the index is unpickled: an older index may contain types that
    # no longer exist, and loading it would raise.
    cache._version = f"{numba.__version__} {_STATE}"
    return True


def _state() -> str:
    files = sorted(Path(__file__).parent.glob("*.py"))
    content = b"\0".join(file.read_bytes() for file in files)
    return hashlib.sha256(content).hexdigest()


_STATE = _state()
