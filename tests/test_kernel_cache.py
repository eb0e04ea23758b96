"""Compiled kernels on disk: they count for one state of all kernels, and for nothing else."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numba
import pytest

from ftforce.batch.kernels import jit

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")

PROGRAM = """
import sys
sys.path.insert(0, {folder!r})
from package import outer
print(outer.f(1.0), sum(outer.f.stats.cache_hits.values()))
"""
OUTER = """
from .jit import kernel
from .deep import g

@kernel
def f(x):
    return g(x) + 1.0
"""
DEEP = """
from .jit import inner

@inner
def g(x):
    return {factor} * x
"""


@pytest.fixture
def package(tmp_path):
    """Return a function that writes a package of two kernels, and one that runs it."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "jit.py").write_text(Path(jit.__file__).read_text())
    (folder / "outer.py").write_text(OUTER)

    def run(factor, beside=""):
        (folder / "deep.py").write_text(DEEP.format(factor=factor))
        (tmp_path / "other.py").write_text(beside)
        program = PROGRAM.format(folder=str(tmp_path))
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
        )
        value, hits = done.stdout.split()
        return float(value), int(hits)

    return run


@pytest.mark.thorough  # processes that compile
def test_an_edit_of_any_kernel_compiles_anew_and_one_elsewhere_does_not(package):
    assert package(2.0) == (3.0, 0)
    assert package(2.0, beside="x = 1") == (3.0, 1)
    assert package(5.0) == (6.0, 0)  # g is of another file than f


def test_the_cache_of_this_numba_can_be_keyed():
    assert jit._is_keyed(jit.njit(lambda x: x, cache=True)), jit.UNKNOWN_CACHE


def test_a_cache_that_is_unknown_is_not_used(monkeypatch):
    monkeypatch.setattr(jit, "_is_keyed", lambda compiled: False)
    with pytest.warns(RuntimeWarning, match=f"numba {numba.__version__} keeps compiled code"):
        compiled = jit.kernel(lambda x: x)
    assert type(compiled._cache).__name__ == "NullCache"
