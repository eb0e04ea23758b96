"""The structure of the package: no circle, with lazy and type-only imports counted."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter

import grimp
import pytest


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
