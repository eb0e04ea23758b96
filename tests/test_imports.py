"""What an import costs: nothing heavy before it is needed."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

import ftforce

HEAVY = {"yourdfpy", "trimesh", "matplotlib", "numba", "dask", "viser", "scipy", "pydantic"}
DH5 = Path(__file__).parents[1] / "robots" / "dh5.urdf"


def loaded_by(*steps: str) -> list[set[str]]:
    """Return the modules that a fresh interpreter holds after each step of a program."""
    note = "\nprint(*sys.modules, file=sys.stderr)\n"
    code = "import sys\n" + note.join([*steps, ""])
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    return [set(line.split()) for line in done.stderr.splitlines()]


def command(*arguments: str) -> str:
    return (
        f"sys.argv = {['ftforce', *arguments]!r}\nfrom ftforce.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass"
    )


def test_libraries_are_loaded_when_they_are_needed():
    core = "from ftforce.core.remap import remap; ftforce.remap"
    first, then = loaded_by("import ftforce", core)
    assert not first & {"numpy", "pinocchio", "rich", "typer", *HEAVY}
    assert "numpy" in then
    assert not then & {"pinocchio", "rich", "typer", "ftforce.robot.robot", *HEAVY}


def test_commands_load_nothing_heavy():
    names = ("analyze", "census", "inspect")
    steps = (command("--help"), *(command(name, str(DH5)) for name in names))
    shown, *modules = loaded_by(*steps)
    assert not shown & {"numpy", "pinocchio", *HEAVY}
    for loaded in modules:
        assert "pinocchio" in loaded
        assert not loaded & {*HEAVY, "ssl", "importlib.metadata._meta", "ftforce.report.files"}
    assert not modules[0] & {"ftforce.robot.formats.dh", "ftforce.analysis.capability"}


def test_the_public_names_are_there():
    assert len(ftforce.__all__) <= 34  # docs/architecture says why more than 20
    assert sorted(ftforce.__all__) == ftforce.__all__
    for name in ftforce.__all__:
        assert getattr(ftforce, name).__name__ == name or not callable(getattr(ftforce, name))
    assert set(ftforce.__all__) <= set(dir(ftforce))


def test_no_module_hides_a_public_name():
    modules = {path.stem for path in Path(ftforce.__file__).parent.glob("*.py")}
    assert not modules & set(ftforce.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'analyse'"):
        ftforce.analyse  # noqa: B018


def test_the_version_is_that_of_the_package():
    assert importlib.metadata.version("ftforce") == ftforce.__version__
