"""Compiled kernels on disk: they are valid for one state of all kernels only."""

from __future__ import annotations

import errno
import hashlib
import importlib
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import ftforce
from ftforce.batch.kernels import jit

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")

PROGRAM = """
import sys
sys.path.insert(0, {folder!r})
from package import outer
f = outer.{name}
print(f(outer.{type}(1.0)) if f is outer.f else f(1.0), sum(f.stats.cache_hits.values()))
"""
OUTER = """
from numba import float64
from .jit import compile_now, kernel
from .deep import {type}, g

@kernel
def f(x):
    return g(x.value) + 1.0

def now(x):
    return g(x) + 1.0

now = compile_now(now, float64(float64))
"""
DEEP = """
from typing import NamedTuple
from .jit import inner

class {type}(NamedTuple):
    value: float

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

    def run(factor, beside="", name="f", kind="Number"):
        (folder / "outer.py").write_text(OUTER.format(type=kind))
        (folder / "deep.py").write_text(DEEP.format(factor=factor, type=kind))
        (tmp_path / "other.py").write_text(beside)
        program = PROGRAM.format(folder=str(tmp_path), name=name, type=kind)
        # -B: bytecode is valid for a size and a *second*; an edit may keep both
        done = subprocess.run(
            [sys.executable, "-B", "-c", program],
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        )
        value, hits = done.stdout.split()
        return float(value), int(hits)

    return run


@pytest.mark.thorough  # processes that compile
def test_an_edit_of_any_kernel_compiles_anew_and_one_elsewhere_does_not(package):
    assert package(2.0) == (3.0, 0)
    assert package(2.0, beside="x = 1") == (3.0, 1)
    assert package(5.0) == (6.0, 0)  # g is of another file than f


@pytest.mark.thorough
def test_a_kernel_compiled_on_import_follows_the_other_files_too(package):
    assert package(2.0, name="now") == (3.0, 0)
    assert package(2.0, name="now") == (3.0, 1)
    assert package(5.0, name="now") == (6.0, 0)


@pytest.mark.thorough
def test_a_cache_that_names_a_type_which_is_gone_is_stale_not_an_error(package):
    assert package(2.0, kind="Number") == (3.0, 0)
    assert package(2.0, kind="Value") == (3.0, 0)


@pytest.fixture
def doubled(tmp_path, monkeypatch):
    """Return a function that compiles another anew, or loads it: its value, and the cache hits."""
    (tmp_path / "doubles.py").write_text("def doubled(x):\n    return 2.0 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    function = importlib.import_module("doubles").doubled

    def run(x=1.0):
        compiled = jit.kernel(function)
        return compiled(x), sum(compiled.stats.cache_hits.values())

    yield run
    del sys.modules["doubles"]


@pytest.mark.parametrize("harm", ["cut", "empty", "bit", "lost"])
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_damaged_files_of_a_cache_are_compiled_anew(doubled, tmp_path, ending, harm):
    """Machine code with another bit would crash, or compute something else."""
    assert (doubled(), doubled()) == ((2.0, 0), (2.0, 1))
    (file,) = (tmp_path / "__pycache__").glob(f"*.{ending}")
    whole = file.read_bytes()
    for middle in (len(whole) // 2, len(whole) - 40):
        flipped = whole[:middle] + bytes([whole[middle] ^ 4]) + whole[middle + 1 :]
        damaged = {"cut": whole[:middle], "empty": b"", "bit": flipped}
        file.write_bytes(damaged[harm]) if harm in damaged else file.unlink()
        assert (doubled(), doubled()) == ((2.0, 0), (2.0, 1))  # and kept again


@pytest.mark.parametrize("other", ["signature", "kernel"])
def test_machine_code_of_another_is_compiled_anew(doubled, tmp_path, other):
    """Two processes at once may give one name to two signatures; a copied folder is mixed up."""
    assert (doubled(), doubled(1)) == ((2.0, 0), (2, 0))
    first, second = sorted((tmp_path / "__pycache__").glob("*.nbc"))
    if other == "kernel":
        (tmp_path / "halves.py").write_text("def doubled(x):\n    return 0.5 * x\n")
        assert jit.kernel(importlib.import_module("halves").doubled)(1.0) == 0.5
        (second,) = (tmp_path / "__pycache__").glob("halves*.nbc")
        del sys.modules["halves"]
    mine, theirs = first.read_bytes(), second.read_bytes()
    first.write_bytes(theirs)
    second.write_bytes(mine)
    assert (doubled(), doubled()) == ((2.0, 0), (2.0, 1))  # and kept again


@pytest.mark.parametrize("content", [b"cnowhere\nGone\n.", pickle.dumps((1, 2, 3))])
def test_machine_code_of_another_version_is_compiled_anew(doubled, tmp_path, content):
    """The index is written first, so it may name a file that an older version left."""
    assert doubled() == (2.0, 0)
    (file,) = (tmp_path / "__pycache__").glob("*.nbc")
    file.write_bytes(content + hashlib.sha256(content).digest())
    assert (doubled(), doubled()) == ((2.0, 0), (2.0, 1))


@pytest.mark.thorough
def test_cold_processes_at_once_are_both_right(doubled, tmp_path):
    """Each compiles other signatures first, and all of them in the end."""
    program = f"""
import sys
sys.path[:0] = [{str(tmp_path)!r}, {str(Path(ftforce.__file__).parents[1])!r}]
from ftforce.batch.kernels.jit import kernel
from doubles import doubled
import numpy as np
one, kinds = int(sys.argv[1]), [float, int, complex, np.float32, np.int8, bool]
f = kernel(doubled)
sys.stdin.readline()
print([f(kind(1)) == 2.0 for kind in kinds[one:] + kinds[:one]])
"""
    command = [sys.executable, "-c", program]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    running = [subprocess.Popen([*command, str(i)], **pipes) for i in (0, 3)]
    for process in running:
        process.stdin.write("go\n")
        process.stdin.flush()
    said = [process.communicate(timeout=60)[0] for process in running]
    assert said == [f"{[True] * 6}\n"] * 2
    assert [doubled(x)[0] for x in (1.0, 1, 1j, np.float32(1), np.int8(1), True)] == [
        2,
        2,
        2j,
        2,
        2,
        2,
    ]


def test_a_disk_on_which_no_kernel_can_be_kept(doubled, monkeypatch):
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._save_data", raising(full))
    assert (doubled(), doubled()) == ((2.0, 0), (2.0, 0))


def test_a_read_only_environment_and_home_is_one_warning(doubled, monkeypatch):
    monkeypatch.setattr("numba.core.caching.CompileResultCacheImpl._locator_classes", [])
    monkeypatch.setattr(jit, "_said", set())
    with pytest.warns(RuntimeWarning, match="no folder for compiled kernels can be writ") as said:
        assert (doubled(), doubled()) == ((2.0, 0), (2.0, 0))
    assert len(said) == 1


def raising(problem):
    def fail(*_):
        raise problem

    return fail


def test_the_cache_of_this_numba_can_be_keyed():
    assert jit._is_keyed(jit.njit(lambda x: x, cache=True)), jit.UNKNOWN_CACHE


def test_a_cache_that_is_unknown_is_not_used(monkeypatch):
    monkeypatch.setattr(jit, "_is_keyed", lambda compiled: False)
    with pytest.warns(RuntimeWarning, match=f"numba {numba.__version__} is unknown to ftforce"):
        compiled = jit.kernel(lambda x: x)
    assert type(compiled._cache).__name__ == "NullCache"


WITHOUT_PRIVATE_CLASSES = """
import numba.core.codegen
del numba.core.codegen.JITCodeLibrary
from ftforce.batch.kernels import jit
double = jit.inner(lambda x: 2.0 * x)
print(jit.kernel(lambda x: double(x) + 1.0)(20.5), jit.WHOLE)
"""


@pytest.mark.thorough  # a process that compiles
def test_kernels_compile_as_usual_where_numba_has_moved_what_is_private(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-c", WITHOUT_PRIVATE_CLASSES]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert done.stdout == "42.0 {}\n"
