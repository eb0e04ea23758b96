"""Sessions of nox: `nox` runs the default ones, `nox --list` names all."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from itertools import chain

import nox

nox.needs_version = ">=2024.10.9"
nox.options.default_venv_backend = "uv|virtualenv"  # uv if it is there: minutes less
nox.options.error_on_missing_interpreters = False

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
ALL = "not browser"
MEASURED = "not no_cover and not browser"  # the others run in `tests`
QUICK = "not thorough and not browser"  # what is thorough runs on one Python
ENVIRONMENT = {
    # Installed code is tested, never the checkout; and no test depends on the caller's colours.
    "PYTHONSAFEPATH": "1",
    "NO_COLOR": "1",
    "OMP_NUM_THREADS": "1",
    # uv leaves it to the first import to compile; without a place for that, each of the
    # processes that tests start would compile NumPy, SciPy and pandas anew.
    "PYTHONDONTWRITEBYTECODE": "",
}
WORKERS = ("-n", str((os.cpu_count() or 1) + 1))  # tests that wait leave a processor free


def group(name: str) -> list[str]:
    """Return the requirements of a dependency group."""
    return nox.project.dependency_groups(PROJECT, name)


def install(session: nox.Session, *requirements: str) -> None:
    """Install ftforce, not editable, and put compiled kernels beside it.

    They are kept in nox's cache from one session to the next; without them each of the test
    processes would compile its own for a minute.
    """
    session.install(".[all]", *requirements)
    kept = str(session.cache_dir / "kernels")
    session.run("python", "tests/compile_kernels.py", kept, env=ENVIRONMENT)


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests on the current Python."""
    install(session, *group("test"))
    session.run("pytest", *(session.posargs or [*WORKERS, "-m", ALL]), env=ENVIRONMENT)


@nox.session(name="tests-all", python=FOUND, default=False)
def tests_all(session: nox.Session) -> None:
    """Run the tests on every supported Python that is found."""
    install(session, *group("test"))
    session.run("pytest", *(session.posargs or [*WORKERS, "-m", QUICK]), env=ENVIRONMENT)


@nox.session
def coverage(session: nox.Session) -> None:
    """Measure which lines and branches the tests reach."""
    install(session, *group("test"))
    # Branches need the C tracer before Python 3.14, where coverage takes sys.monitoring by itself.
    cover = [*WORKERS, "-q", "--cov", "--cov-branch"]
    unjudged = ["-m", MEASURED, "--cov-report=", "--cov-fail-under=0"]
    session.run("pytest", *cover, *unjudged, env=ENVIRONMENT)
    # Coverage does not see into compiled kernels: their tests run once more as plain Python.
    plain = {**ENVIRONMENT, "NUMBA_DISABLE_JIT": "1"}
    judged = ["--cov-append", "--cov-report=term-missing:skip-covered", "--cov-fail-under=95"]
    session.run("pytest", "-m", "plain", *cover, *judged, env=plain)


@nox.session(default=False)
def campaign(session: nox.Session) -> None:
    """Run the tests with all their random cases, ten times as many: before a release.

    The report at the end counts hostile command lines, calls, files, kills and racing writers.
    """
    install(session, *group("test"))
    environment = {**ENVIRONMENT, "FTFORCE_CAMPAIGN": "1"}
    session.run("pytest", *(session.posargs or [*WORKERS, "-m", ALL]), env=environment)


@nox.session(default=False)
def mutants(session: nox.Session) -> None:
    """Break the code in 60 places, one at a time, and see that the tests notice."""
    session.install("-e", ".[all]", *group("test"))
    session.run("python", "tests/mutants.py", *session.posargs, env=ENVIRONMENT)


@nox.session(default=False)
def browser(session: nox.Session) -> None:
    """Run the tests that drive Chromium, which has to be installed."""
    install(session, *group("test"))
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
    session.install(".[all]", *group("types"))
    session.run("mypy")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation; warnings are errors."""
    session.install(".[all]", *group("docs"))
    session.run("python", "docs/examples/architecture.py", "--check", env=ENVIRONMENT)
    session.run("sphinx-build", "-W", "--keep-going", "-b", "html", "docs", "docs/_build/html")


@nox.session
def examples(session: nox.Session) -> None:
    """Run the examples and what every page tells a reader to type; compare the outputs shown."""
    install(session, *group("docs"))
    for script in ("paper_case.py", "your_own_jacobian.py"):
        session.run("python", f"docs/examples/{script}", env=ENVIRONMENT)
    drawn = session.create_tmp()
    for script in ("fault_modes.py", "section_v.py", "closed_loop.py"):
        output = f"{drawn}/{script}.svg"
        session.run("python", f"docs/examples/{script}", "--output", output, env=ENVIRONMENT)
    for script in ("plots.py", "sweep_map.py"):
        session.run("python", f"docs/examples/{script}", "--output", drawn, env=ENVIRONMENT)
    # They import each other from their folder; ftforce is the installed one all the same.
    beside = {**ENVIRONMENT, "PYTHONSAFEPATH": ""}
    session.run("python", "docs/examples/pictures.py", "--check", env=beside)
    session.run("python", "docs/examples/pages.py", env=beside)


@nox.session
def minimums(session: nox.Session) -> None:
    """Run the tests with the oldest dependencies that pyproject.toml admits.

    With these nothing that ftforce uses may be deprecated; a newer release may deprecate it without
    breaking anybody's run.
    """
    extras = PROJECT["project"]["optional-dependencies"].values()
    admitted = chain(PROJECT["project"]["dependencies"], *extras)
    oldest = [re.sub(r">=([^,]+).*", r"==\1", one) for one in admitted if ">=" in one]
    install(session, *oldest, *group("test"))
    options = session.posargs or [*WORKERS, "-q", "-m", QUICK]
    strict = "filterwarnings=error:::ftforce\nerror:::test_"
    session.run("pytest", "-o", strict, *options, env=ENVIRONMENT)


@nox.session
def bench(session: nox.Session) -> None:
    """Measure side by side, in one run, against what a user would write instead."""
    install(session, *group("bench"))
    # As timeit has it: no garbage collection, warm caches.
    timing = ["--benchmark-disable-gc", "--benchmark-warmup=on", "--benchmark-sort=name"]
    columns = "--benchmark-columns=min,median,iqr"
    session.run("pytest", "tests/bench", *timing, columns, *session.posargs, env=ENVIRONMENT)
