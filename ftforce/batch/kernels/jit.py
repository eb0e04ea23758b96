"""Compilation of kernels: once per machine, cached on disk, releasing the GIL.

What only kernels call is neither optimized nor turned into machine code by itself, but only as a
part of the kernels (`ftforce.batch.kernels.pipeline`): half of the time of compilation.

Numba's cache tracks only the file of a kernel, so a kernel that calls others in another file would
keep using stale code, and give wrong results. Cache entries are therefore keyed by the content of
all files of this package, and of nothing else in ftforce.
"""

from __future__ import annotations

import hashlib
import pickle
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from numba import njit
from numba.core.dispatcher import Dispatcher

try:
    from ftforce.batch.kernels.pipeline import LOOP, PART, WHOLE
except (ImportError, AttributeError):  # numba has moved what is private of it
    LOOP = PART = WHOLE = {}

if TYPE_CHECKING:
    from collections.abc import Callable

# Products and sums may be fused; otherwise floating-point semantics are strict.
_FUSED = {"contract"}

UNKNOWN_CACHE = (
    f"the cache format of numba {numba.__version__} is unknown to ftforce; "
    "kernels are recompiled in every process"
)
NO_CACHE = (
    "no folder for compiled kernels can be written, so every run compiles them again, which takes "
    "ten seconds or more; name one in NUMBA_CACHE_DIR"
)
_COMMON = {"nogil": True, "error_model": "numpy", "fastmath": _FUSED, "no_cfunc_wrapper": True}
_ONLY_CALLED = {"no_cpython_wrapper": True, "_nrt": False}
_DIGEST = 32  # bytes of SHA-256
_USED_OF_CACHE = (
    *("_source_stamp", "_version", "_index_name", "_index_path", "_data_path"),
    *("_dump", "_load_index", "_load_data"),
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
    common = {**_COMMON, **WHOLE, **options}
    try:
        compiled = compile_(function, cache=True, **common)
    except RuntimeError:  # numba found no folder that can be written
        _warn_once(NO_CACHE)
        return compile_(function, cache=False, **common)
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
    """Compile a function that only kernels call, as a part of them.

    It needs no Python wrapper, which takes time to compile, and no place in the cache: the kernels
    contain it.

    Parameters
    ----------
    function :
        What to compile.
    """
    compile_: Any = njit
    return compile_(function, **_COMMON, **PART, **_ONLY_CALLED)


def inner_loop(function: Callable[..., Any]) -> Any:
    """Compile a function like `inner`, but optimize it by itself first.

    Loops over lanes of many arrays are vectorized only where the compiler can tell which of them
    overlap, which within a whole kernel it cannot.

    Parameters
    ----------
    function :
        What to compile.
    """
    compile_: Any = njit
    return compile_(function, **_COMMON, **LOOP, **_ONLY_CALLED)


def _warn_once(text: str) -> None:
    """Warn once for all kernels."""
    if text not in _said:
        _said.add(text)
        warnings.warn(text, RuntimeWarning, stacklevel=3)


_said: set[str] = set()


def _is_keyed(compiled: Any) -> bool:
    """Key the disk cache by the state of all kernels, and return whether that worked.

    Relies on private attributes, tested with numba 0.61 to 0.68.
    """
    cache: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if not all(hasattr(cache, name) for name in _USED_OF_CACHE):
        return False
    cache.__class__ = _verified(type(cache))
    cache._source_stamp = _STATE
    # The version is compared before the index is unpickled: an older index may contain types that
    # no longer exist, and loading it would raise.
    cache._version = f"{numba.__version__} {_STATE}"
    return True


def _verified(base: Any) -> Any:
    """Return numba's class of cache files with digests: only what was compiled for a call is run.

    Numba counts the files of a kernel, one for each signature, so two processes that compile at
    once may use one name for different signatures.
    """

    class Verified(base):  # type: ignore[misc]
        def save(self, key: Any, data: Any) -> None:
            with suppress(OSError):  # a full disk: the kernel is compiled, it is only not kept
                super().save(key, (self._meaning(key), data))

        def load(self, key: Any) -> Any:
            # The index may already name a file that an older version, or another process, wrote.
            match super().load(key):
                case (meaning, data) if meaning == self._meaning(key):
                    return data
            return None

        def _meaning(self, key: Any) -> str:
            return f"{self._index_name} {self._version} {key}"

        def _dump(self, obj: Any) -> bytes:
            content: bytes = super()._dump(obj)  # a pickle, which knows where it ends
            return content + hashlib.sha256(content).digest()

        def _load_index(self) -> Any:
            try:
                with Path(self._index_path).open("rb") as file:
                    pickle.load(file)
                    _check(file.read())
                return super()._load_index()
            except Exception:  # whatever a damaged pickle raises: the index is written anew
                return {}

        def _load_data(self, name: str) -> Any:
            content = Path(self._data_path(name)).read_bytes()
            _check(content)
            try:
                return pickle.loads(content)
            except Exception as problem:  # whatever a pickle of another version raises
                raise OSError("of another version") from problem

    return Verified


def _check(content: bytes) -> None:
    """Check the digest at the end.

    Raises
    ------
    OSError
        The content is damaged; numba compiles anew.
    """
    if hashlib.sha256(content[:-_DIGEST]).digest() != content[-_DIGEST:]:
        raise OSError("damaged")


def _state() -> str:
    files = sorted(Path(__file__).parent.glob("*.py"))
    content = b"\0".join(file.read_bytes() for file in files)
    return hashlib.sha256(content).hexdigest()


_STATE = _state()
