"""Wall time of whole commands, beside importing what they cannot do without."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from effort import rounds

FTFORCE = str(Path(sys.executable).with_name("ftforce"))
DH5 = Path(__file__).parents[2] / "robots" / "dh5.urdf"
GROUP = "whole command, goal for analyze: 1.15 times the imports"
COMMANDS = {
    "imports": [sys.executable, "-c", "import pinocchio, numpy, typer, rich.console, rich.table"],
    "analyze": [FTFORCE, "analyze", str(DH5), "--locked", "2,4"],
    "help": [FTFORCE, "--help"],
}


@pytest.mark.benchmark(group=GROUP)
@pytest.mark.parametrize("name", COMMANDS)
def test_command(benchmark, name):
    def run():
        return subprocess.run(COMMANDS[name], capture_output=True, check=True)

    done = benchmark.pedantic(run, rounds=rounds(15), warmup_rounds=rounds(2))
    assert done.returncode == 0
