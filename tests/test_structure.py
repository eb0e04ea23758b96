"""The structure of the package: no circle, lone kernels, and a reference that is complete."""

from __future__ import annotations

import inspect
import re
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def imports():
    graph = grimp.build_graph("ftforce", exclude_type_checking_imports=False, cache_dir=None)
    return {one: graph.find_modules_directly_imported_by(one) for one in graph.modules}


def circle_in(imports):
    """Return the modules of a circle in order, an empty list if there is none."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_module_imports_itself_by_way_of_others(imports):
    assert len(imports) > 150
    assert circle_in(imports) == []
    assert circle_in({"a": {"b"}, "b": {"a"}})


def test_kernels_import_kernels_only(imports):
    home = "ftforce.batch.kernels"
    kernels = [one for one in imports if one.startswith(f"{home}.")]
    assert len(kernels) > 5
    assert all(target.startswith(home) for one in kernels for target in imports[one])


# ---- what the reference documents is public, and says what it takes ------------------------------

_ENTRY = re.compile(r"\.\. auto(module|function|class):: (\S+)\n((?:   :.*\n)*)")


def documented():
    """Yield the functions and methods that the reference documents, by name."""
    for page in (ROOT / "docs" / "reference").glob("*.md"):
        for kind, name, options in _ENTRY.findall(page.read_text("utf-8")):
            if kind != "module":
                yield from functions_of(name, resolve(name))
                continue
            module = import_module(name)
            listed = re.search(r":members: (.+)", options)
            hidden = re.search(r":exclude-members: (.+)", options)
            own = [key for key, value in vars(module).items() if is_own(module, key, value)]
            names = listed[1].split(", ") if listed else own
            for key in set(names) - set(hidden[1].split(", ") if hidden else ()):
                yield from functions_of(f"{name}.{key}", getattr(module, key))


def is_own(module, key, value):
    return key[0] != "_" and getattr(value, "__module__", None) == module.__name__


def resolve(name):
    path, _, last = name.rpartition(".")
    with suppress(ImportError):
        return getattr(import_module(path), last)
    return getattr(resolve(path), last)


def functions_of(name, value):
    if inspect.isfunction(value):
        yield name, value
    for key, member in vars(value).items() if inspect.isclass(value) else ():
        function = getattr(member, "__func__", member)
        if key[0] != "_" and inspect.isfunction(function):
            yield f"{name}.{key}", function


def test_every_public_function_says_what_it_takes():
    found = dict(documented())
    assert len(found) > 150
    for name, function in found.items():
        takes = set(inspect.signature(function).parameters) - {"self", "cls"}
        assert not takes or "Parameters\n---" in inspect.getdoc(function), name
