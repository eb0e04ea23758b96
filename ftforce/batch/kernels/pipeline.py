"""Numba's compiler for kernels: what they call is compiled with them, not by itself.

Numba optimizes every function, with all that it calls, generates its machine code, and then does
the same again for each of its callers. With a dozen levels of small functions that takes longer
than all the rest. Here a function that only kernels call is a *part*: it stays as it was lowered
until a kernel, the *whole*, links all parts into one module, which is optimized once.

This uses numba's extension point for compilers, ``pipeline_class``, and private methods of its code
libraries, tested with numba 0.61 to 0.68. Where they are missing (`jit` notices if this module
cannot be imported) numba compiles as usual, which only takes longer.
"""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes

if TYPE_CHECKING:
    from collections.abc import Iterator


class _Part(JITCodeLibrary):
    """Code that is optimized and turned into machine code only as a part of a kernel."""

    _own: Any = None

    def finalize(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def own_module(self) -> Any:
        """Return the code without what it calls."""
        if self._own is None:
            self._own = super()._get_module_for_linking()
        return self._own

    def _get_module_for_linking(self) -> Any:
        """Return the code with all that it calls, for callers that are not kernels."""
        module = self.own_module().clone()
        for called in _all_called(self):
            module.link_in(_own_module(called), preserve=True)
        return module

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002 # no machine code
        return 0

    @property
    def codegen(self) -> Any:
        return _WithoutEnvironment(self._codegen)


class _Loop(_Part):
    """A part that is optimized by itself, with all that it calls, before kernels contain it."""

    def finalize(self) -> None:
        for called in _all_called(self):
            self._final_module.link_in(_own_module(called), preserve=True)
        self._linking_libraries = []
        self._optimize_final_module()
        super().finalize()


class _WithoutEnvironment:
    """A code generator for parts: they raise nothing, and so need no environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


class _Whole(JITCodeLibrary):
    """A kernel, with all its parts."""

    def finalize(self) -> None:
        for called in _all_called(self):
            self._final_module.link_in(_own_module(called), preserve=True)
        self._linking_libraries = []
        super().finalize()


def _own_module(library: Any) -> Any:
    """Return the code of a library: of a part without what it calls."""
    is_part = isinstance(library, _Part)
    return library.own_module() if is_part else library._get_module_for_linking()


def _all_called(library: Any) -> list[Any]:
    """Return what a library calls, and what its parts call in turn, each once."""
    found: dict[Any, None] = {}
    waiting = list(library._linking_libraries)
    while waiting:
        one = waiting.pop(0)
        if one not in found:
            found[one] = None
            waiting += one._linking_libraries if isinstance(one, _Part) else []
    return list(found)


def _into(library: type[JITCodeLibrary]) -> type[LoweringPass]:
    """Return a pass that has the code written into such a library."""

    class Into(LoweringPass):
        _name = f"into{library.__name__.lower()}"

        def __init__(self) -> None:
            LoweringPass.__init__(self)

        def run_pass(self, state: Any) -> bool:
            """Choose the library."""
            state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return True

    chosen: type[LoweringPass] = register_pass(mutates_CFG=False, analysis_only=True)(Into)
    return chosen


def _compiler(library: type[JITCodeLibrary]) -> type[CompilerBase]:
    """Return numba's compiler, writing into such a library."""
    into = _into(library)

    class Compiler(CompilerBase):
        def define_pipelines(self) -> list[Any]:
            """Return numba's passes with one more."""
            passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.add_pass_after(into, AnnotateTypes)
            passes.finalize()
            return [passes]

        def compile_extra(self, function: Any) -> Any:
            """Compile without garbage collections, which would look at millions of objects."""
            with _no_garbage_collection():
                return super().compile_extra(function)

    return Compiler


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


_USED = (
    "_finalize_dynamic_globals",
    "_get_module_for_linking",
    "_optimize_final_module",
    "finalize",
)
_IS_KNOWN = all(hasattr(JITCodeLibrary, name) for name in _USED)
PART = {"pipeline_class": _compiler(_Part)} if _IS_KNOWN else {}
"""Option of numba's `njit` for functions that only kernels call."""
LOOP = {"pipeline_class": _compiler(_Loop)} if _IS_KNOWN else {}
"""The same for functions that are optimized by themselves first."""
WHOLE = {"pipeline_class": _compiler(_Whole)} if _IS_KNOWN else {}
"""Option of numba's `njit` for kernels."""
