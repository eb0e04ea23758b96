"""Sweeps in processes of their own, for tests that kill them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
LONG = 240.0  # s; more than any process here takes on a slow machine

_PLAIN = """
import json, signal, sys
import ftforce
from ftforce.batch.sweep import sweep

signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by what runs in the background
if __name__ == "__main__":
    asked = json.loads(sys.argv[1])
    {before}
    print("begins", flush=True)
    try:
        sweep(ftforce.load_robot(asked.pop("robot", "dh5")), **asked)
    except ftforce.FtforceError as problem:
        print(f"{{type(problem).__name__}}: {{problem}}", file=sys.stderr)
        sys.exit(3)
"""

# Loads everything once, then forks a process for each kill: starting Python anew takes seconds.
_KILLED = """
import json, os, signal, sys
import ftforce, zarr, xarray
from ftforce.batch import sweep as module

robot = ftforce.load_robot("dh5")
real = module.run_request
module.run_request = lambda asked, *_: asked.job.add(0, asked.job.empty_summary())
module.sweep(robot, n=4096, force=[80, 50, 10])  # loads the kernels and starts no thread
module.run_request = real
steps = 0

def counted(function):
    def step(*args, **more):
        global steps
        steps += 1
        if steps == point:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*args, **more)
    return step

for name in ("fsync", "replace", "mkdir", "unlink", "open"):
    setattr(os, name, counted(getattr(os, name)))
killed = []
for asked, points in json.loads(sys.argv[1]):
    killed.append(0)
    for point in points:
        child = os.fork()
        if not child:
            module.sweep(robot, **asked)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if os.WIFSIGNALED(status):
            killed[-1] += 1
        elif status:
            sys.exit("a process failed")
print(json.dumps(killed))
"""


def child(asked: dict, *, before: str) -> subprocess.Popen:
    """Start ``sweep(**asked)`` in another process, ``before`` being a statement.

    It writes "begins" when everything is imported, and an error of ftforce's on stderr.
    """
    script = _PLAIN.format(before=before)
    command = [sys.executable, "-W", "error", "-c", script, json.dumps(asked)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=ROOT)


def killed(asked: list[tuple[dict, list[int]]]) -> list[int]:
    """Start each ``sweep(**asked)`` again and again, each time killed by SIGKILL at a step.

    A step is a file that is opened, synced, replaced or removed, or a folder that is made. Returns
    how many were killed; those whose step never came ended by themselves.
    """
    command = [sys.executable, "-c", _KILLED, json.dumps(asked)]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=ROOT, timeout=LONG
    )
    assert not done.returncode, done.stderr
    found: list[int] = json.loads(done.stdout)
    return found


def content(folder: str | Path) -> dict[str, bytes]:
    """Return every file below a folder."""
    folder = Path(folder)
    files = (file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def differences(first: dict[str, bytes], second: dict[str, bytes]) -> list[str]:
    """Return the names of the files that are not the same in both."""
    return sorted(k for k in first.keys() | second.keys() if first.get(k) != second.get(k))
