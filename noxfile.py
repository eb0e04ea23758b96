"""Sessions: lint, types, tests, docs, examples, minimums, bench; and browser, if asked for."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys

import nox

nox.needs_version = ">=2024.10.9"
nox.options.default_venv_backend = "uv|virtualenv"  # uv if it is there: minutes less
nox.options.error_on_missing_interpreters = False
nox.options.sessions = ["lint", "types", "tests", "docs", "examples", "minimums", "bench"]

PROJECT = nox.project.load_toml("pyproject.toml")
SUPPORTED = ("3.11", "3.12", "3.13")


def works(version: str) -> bool:
    """Return whether this interpreter runs: a version manager's shim may exist and still fail."""
    path = shutil.which(f"python{version}")
    if path is None:
        return False
    return subprocess.run([path, "-c", ""], check=False, capture_output=True).returncode == 0


CURRENT = f"{sys.version_info.major}.{sys.version_info.minor}"
FOUND = [version for version in SUPPORTED if version == CURRENT or works(version)] or [CURRENT]
QUICK = "not thorough and not browser"  # what is thorough is so once
ENVIRONMENT = {
    # Installed code is tested, never the checkout; and no test depends on the caller's colours.
    "PYTHONSAFEPATH": "1",
    "NO_COLOR": "1",
    "OMP_NUM_THREADS": "1",
    # uv leaves it to the first import to compile; without a place for that, each of the hundreds
    # of processes that tests start would compile NumPy, SciPy and pandas anew.
    "PYTHONDONTWRITEBYTECODE": "",
}
WORKERS = str((os.cpu_count() or 1) + 1)  # tests that wait leave a processor free
KERNELS = ("python", "tests/compile_kernels.py")  # else every test process compiles its own


def group(name: str) -> list[str]:
    return nox.project.dependency_groups(PROJECT, name)


@nox.session(python=FOUND)
def tests(session: nox.Session) -> None:
    """Run the tests against an installed, non-editable ftforce, with coverage."""
    session.install(".", *group("test"))
    if session.posargs:
        session.run("pytest", *session.posargs, env=ENVIRONMENT)
        return
    if session.python != FOUND[0]:
        session.run("pytest", "-n", WORKERS, "-m", QUICK, env=ENVIRONMENT)
        return
    session.run(*KERNELS, env=ENVIRONMENT)
    coverage = ["-n", WORKERS, "--cov", "--cov-branch"]
    unjudged = ["-m", "not browser", "--cov-report=", "--cov-fail-under=0"]
    session.run("pytest", *coverage, *unjudged, env=ENVIRONMENT)
    # Coverage does not see into compiled kernels: their tests run once more as plain Python.
    plain = {**ENVIRONMENT, "NUMBA_DISABLE_JIT": "1"}
    more = ["--cov-append", "--cov-report=term-missing:skip-covered", "--cov-fail-under=95"]
    session.run("pytest", "-m", "plain", *coverage, *more, env=plain)


@nox.session
def browser(session: nox.Session) -> None:
    """Run the tests that drive Chromium, which has to be installed."""
    session.install(".", *group("test"))
    options = session.posargs or ["-n", "auto"]  # more of them would wait for each other too long
    session.run("pytest", "-m", "browser", *options, env=ENVIRONMENT)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style, and who imports whom."""
    session.install(*group("lint"), ".")
    session.run("ruff", "check")
    session.run("ruff", "format", "--check")
    session.run("lint-imports")


@nox.session
def types(session: nox.Session) -> None:
    """Check the types, strictly."""
    session.install(".", *group("types"))
    session.run("mypy")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation; warnings are errors."""
    session.install(".", *group("docs"))
    session.run("sphinx-build", "-W", "--keep-going", "-b", "html", "docs", "docs/_build/html")


@nox.session
def examples(session: nox.Session) -> None:
    """Run the examples, and see that every picture shows what the code prints today."""
    session.install(".", *group("docs"))
    for script in ("paper_case.py", "your_own_jacobian.py"):
        session.run("python", f"docs/examples/{script}", env=ENVIRONMENT)
    drawn = session.create_tmp()
    for script in ("fault_modes.py", "section_v.py", "closed_loop.py"):
        output = f"{drawn}/{script}.svg"
        session.run("python", f"docs/examples/{script}", "--output", output, env=ENVIRONMENT)
    for script in ("plots.py", "sweep_map.py"):
        session.run("python", f"docs/examples/{script}", "--output", drawn, env=ENVIRONMENT)
    session.run("python", "docs/examples/pictures.py", "--check", env=ENVIRONMENT)


@nox.session(python=FOUND[0])
def minimums(session: nox.Session) -> None:
    """Run the tests with the oldest dependencies that pyproject.toml admits."""
    oldest = [re.sub(r">=", "==", dependency) for dependency in PROJECT["project"]["dependencies"]]
    session.install(*oldest, ".", *group("test"))
    options = session.posargs or ["-m", QUICK]
    session.run("pytest", "-n", WORKERS, "-q", *options, env=ENVIRONMENT)


@nox.session
def bench(session: nox.Session) -> None:
    """Measure side by side, in one run, against what a user would write instead."""
    session.install(".", *group("bench"))
    session.run(*KERNELS, env=ENVIRONMENT)
    # As timeit has it: no garbage collection, warm caches.
    timing = ["--benchmark-disable-gc", "--benchmark-warmup=on", "--benchmark-sort=name"]
    columns = "--benchmark-columns=min,median,iqr"
    session.run("pytest", "tests/bench", *timing, columns, *session.posargs, env=ENVIRONMENT)
