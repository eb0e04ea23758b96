"""Does the suite see mistakes? Make one of ``mutants.toml`` at a time, and run the tests.

``python tests/mutants.py`` tries them all, ``python tests/mutants.py ID …`` some. A mutant is

killed
    if a test fails: pytest ends with 1;
survived
    if all tests of its files pass;
error
    if nothing is said about the tests: its snippet does not stand in the code exactly once, the
    package cannot be imported with it, pytest ends otherwise, or takes longer than ``--timeout``
    (which counts as killed where the mutant may loop for ever).

The file is restored whatever happens, with its time, so that no cache of bytecode or kernels
becomes invalid. The status is 0 if there was no error, whatever survived.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

LIST = Path(__file__).with_suffix(".toml")
PASSED, FAILED, NOTHING_SELECTED = 0, 1, 5  # pytest's exit status
TIMED_OUT = -1000
SETTINGS = {
    "PYTHONDONTWRITEBYTECODE": "1",  # no bytecode of a mutant stays
    "PYTHONSAFEPATH": "1",
    "OMP_NUM_THREADS": "1",
    "NO_COLOR": "1",
}
_FIRST = re.compile(r"^(?:FAILED|ERROR) (\S+::.*?)(?: - .*)?$", re.MULTILINE)


class Mutant(NamedTuple):
    """A mistake that somebody could make.

    Attributes
    ----------
    id :
        Its name.
    file :
        From the root of the checkout. Where that has been moved, the one file of the package that
        has the snippet counts.
    old, new :
        What stands there exactly once, and what takes its place.
    tests :
        Names of test files that should see it, without ``test_`` and ``.py``.
    k :
        Which of their tests are tried first, as pytest's ``-k``: only to save time.
    plain :
        Whether its tests are those marked ``plain``, with kernels that are not compiled.
    compiles :
        Whether kernels are compiled anew for it, which goes into a folder of its own.
    loops :
        Whether it may loop for ever.
    """

    id: str
    file: str
    old: str
    new: str
    tests: list[str]
    k: str = ""
    plain: bool = False
    compiles: bool = False
    loops: bool = False


class Outcome(NamedTuple):
    """What became of a mutant: ``killed``, ``survived`` or ``error``, and by what."""

    mutant: Mutant
    word: str
    detail: str
    seconds: float

    def __str__(self) -> str:
        place = self.mutant.file.removeprefix("ftforce/")
        return f"{self.mutant.id:26} {place:28} {self.word:8} {self.seconds:5.1f} s  {self.detail}"


class MutantError(Exception):
    """Nothing can be said about a mutant."""


class Checkout(NamedTuple):
    """A checkout that is mutated, and the Python that its package is installed for."""

    root: Path
    python: str
    timeout: float

    def check(self, mutants: list[Mutant]) -> None:
        """Refuse another checkout's package, and files that differ from git's."""
        where = "import ftforce; print(ftforce.__file__)"
        found = self._run([self.python, "-c", where], SETTINGS).stdout.strip()
        if Path(found).parent != self.root / "ftforce":
            raise MutantError(f"{self.python} imports {found or 'nothing'}, not {self.root}")
        files = {mutant.file for mutant in mutants if (self.root / mutant.file).exists()}
        for moved in (mutant for mutant in mutants if mutant.file not in files):
            with suppress(MutantError):  # it is told when its turn comes
                files.add(str(self.place_of(moved).relative_to(self.root)))
        done = self._run(["git", "diff", "--name-only", "HEAD", "--", *sorted(files)], {})
        if done.returncode or done.stdout:
            changed = " ".join(done.stdout.split()) or done.stderr.strip()
            raise MutantError(f"not as git has it, perhaps a mutant was left: {changed}")

    def place_of(self, mutant: Mutant) -> Path:
        """Return the file that holds the snippet, once."""
        file = self.root / mutant.file
        candidates = [file] if file.exists() else sorted((self.root / "ftforce").rglob("*.py"))
        counts = {one: one.read_text("utf-8").count(mutant.old) for one in candidates}
        if sum(counts.values()) != 1:
            raise MutantError(f"the snippet is found {sum(counts.values())} times: {mutant.old!r}")
        return max(counts, key=counts.__getitem__)

    def judge(self, mutant: Mutant, *, confirm: bool) -> Outcome:
        """Try a mutant; ``confirm`` asks whether the test that fails passes without it."""
        start = time.monotonic()
        try:
            with mutated(self.place_of(mutant), mutant):
                word, detail = self._tried(mutant)
            if word == "killed" and "::" in detail and confirm:
                status, _ = self._pytest(mutant, [detail], "")
                if status != PASSED:
                    word, detail = "error", f"fails without the mutant, too: {detail}"
        except MutantError as problem:
            word, detail = "error", str(problem)
        return Outcome(mutant, word, detail, time.monotonic() - start)

    def _tried(self, mutant: Mutant) -> tuple[str, str]:
        given = [f"tests/test_{name}.py" for name in mutant.tests]
        files = [file for file in given if (self.root / file).exists()]
        if not files:
            raise MutantError(f"there is none of {', '.join(given)}")
        for k in dict.fromkeys([mutant.k, ""]):  # what does not kill is tried with all tests
            status, output = self._pytest(mutant, files, k)
            if status == FAILED:
                first = _FIRST.search(output)
                return "killed", first[1] if first else "?"
            if status == TIMED_OUT and mutant.loops:
                return "killed", "the time is up"
            if status not in {PASSED, NOTHING_SELECTED}:
                break
        if status == PASSED:
            return "survived", ""
        last = output.strip().rpartition("\n")[2]
        raise MutantError("the time is up" if status == TIMED_OUT else f"{status}: {last}")

    def _pytest(self, mutant: Mutant, tests: list[str], k: str) -> tuple[int, str]:
        marks = "plain and not browser" if mutant.plain else "not browser"
        command = [self.python, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", marks]
        command += [*(["-k", k] if k else []), *tests]
        settings = {**SETTINGS, **({"NUMBA_DISABLE_JIT": "1"} if mutant.plain else {})}
        with tempfile.TemporaryDirectory(prefix="mutant-") as scratch:
            if mutant.compiles:  # its kernels must not take the place of others
                settings["NUMBA_CACHE_DIR"] = scratch
            try:
                done = self._run(command, settings, self.timeout)
            except subprocess.TimeoutExpired:
                return TIMED_OUT, ""
        return done.returncode, done.stdout + done.stderr

    def _run(
        self, command: list[str], settings: dict[str, str], timeout: float = 60.0
    ) -> subprocess.CompletedProcess[str]:
        """Run a program in the checkout; with it end all processes that it has started."""
        process = subprocess.Popen(
            command, cwd=self.root, env={**os.environ, **settings}, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip
        try:
            output = process.communicate(timeout=timeout)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()
        return subprocess.CompletedProcess(command, process.returncode, *output)


@contextmanager
def mutated(file: Path, mutant: Mutant) -> Iterator[None]:
    """Make the mistake in a file meanwhile."""
    content, stat = file.read_bytes(), file.stat()
    try:
        file.write_text(content.decode().replace(mutant.old, mutant.new), "utf-8")
        yield
    finally:
        file.write_bytes(content)
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def read_mutants(ids: list[str]) -> list[Mutant]:
    """Return the mutants of these names, or all."""
    entries = tomllib.loads(LIST.read_text("utf-8"))
    if unknown := [name for name in ids if name not in entries]:
        raise MutantError(f"there is no mutant {', '.join(unknown)}; --list shows them")
    return [Mutant(id=name, **entries[name]) for name in ids or entries]


def parsed() -> argparse.Namespace:
    """Return the command line's options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("ids", nargs="*", metavar="ID", help="mutants; all if none is given")
    parser.add_argument("--list", action="store_true", help="list the mutants, and run nothing")
    parser.add_argument("--confirm", action="store_true", help="see that the test that fails "
                        "passes without the mutant")  # fmt: skip
    parser.add_argument("--root", type=Path, default=Path(__file__).parent.parent,
                        help="another checkout")  # fmt: skip
    parser.add_argument("--python", default=sys.executable, help="that has the checkout installed")
    parser.add_argument("--timeout", type=float, default=600.0, help="of one run of pytest, s")
    return parser.parse_args()


def main() -> int:
    """Try the mutants, one line each, and count them."""
    options = parsed()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the file is restored
    checkout = Checkout(options.root.resolve(), options.python, options.timeout)
    try:
        mutants = read_mutants(options.ids)
        if options.list:
            for one in mutants:
                print(f"{one.id:26} {one.file:36} {one.old!r} -> {one.new!r}")
            return 0
        checkout.check(mutants)
    except MutantError as problem:
        print(f"error: {problem}", file=sys.stderr)
        return 2
    outcomes = []
    for mutant in mutants:
        outcomes.append(checkout.judge(mutant, confirm=options.confirm))
        print(outcomes[-1], flush=True)
    counts = {word: sum(one.word == word for one in outcomes)
              for word in ("killed", "survived", "error")}  # fmt: skip
    print(", ".join(f"{count} {word}" for word, count in counts.items()), f"of {len(outcomes)}")
    return 1 if counts["error"] else 0


if __name__ == "__main__":
    sys.exit(main())
