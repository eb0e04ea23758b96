"""Run what the README, the documentation and the help tell a reader to type, and compare outputs.

Every page gets a fresh folder. Of this repository's files it finds there only those that it names:
``docs/examples/NAME`` as ``NAME``, ``robots/NAME`` as ``robots/NAME``. Its blocks run in order and
share the folder and the names of Python, as in the hands of a reader. The exit status is 1 if a
command fails, if it prints something else than a session in ``docs/pictures`` shows for it, or if
an example (``>>>``) gives another result. ``python docs/examples/pages.py PAGE …`` runs some pages.

All runs in one process: libraries and compiled kernels are loaded once.
"""

from __future__ import annotations

import argparse
import contextlib
import doctest
import glob
import io
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import traceback
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from ftforce.cli import app
from ftforce.cli.examples import EXAMPLES

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PICTURES = HERE.parent / "pictures"
PAGES = ("README.md", "docs/**/*.md", "robots/*.md")
ROUNDING = 1e-9
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.FAIL_FAST

# What is not run, as a pattern of its text, and why. A pattern that nothing matches is an error.
NOT_RUN = {
    r"^(pip install|python3 -m venv|\. \.venv)": "installs: this script runs installed",
    r"^nox -s": "the sessions of nox, of which this script is a part",
    r"--scheduler tcp:|^#!/bin/bash\n#SBATCH|^helm |SLURMCluster|KubeCluster": "needs a cluster",
    r"workers=8": "starts eight processes; tests/test_batch_cluster.py starts two",
}

# What is run in another way: pattern, replacement, and why.
CHANGED = (
    (r"--samples 1e[69]( --workers 8)?", "--samples 1e4", "1e6 and 1e9 postures take too long"),
    (r"^(ftforce view .*)--screenshot \S+", r"\1--export view.html", "a picture needs Chromium"),
    (r"^(ftforce view (?!.*--export).*)", r"\1 --export view.html", "the page would stay open"),
)

RUN = {"console": "shell", "bash": "shell", "pycon": "doctest", "python": "python"}
SHOWN = {"text", "toml", "csv", "json", "latex", "dockerfile"}


class PageError(Exception):
    """A block that does not do what its page says."""


@dataclass(frozen=True)
class Step:
    """One thing to run: a command of the shell, an example (``>>>``) or a piece of Python."""

    kind: str
    text: str
    line: int


@dataclass
class Report:
    """What was run, what was not, and what failed."""

    run: int = 0
    failed: list[str] = field(default_factory=list)
    marks: set[str] = field(default_factory=set)  # of NOT_RUN and CHANGED, those that were met
    commands: set[str] = field(default_factory=set)


def steps(text: str, folder: Path) -> list[Step]:
    """Return what a page in a folder tells its reader to run, in order.

    Raises
    ------
    PageError
        A block has an unknown language, or does not end.
    """
    found: list[Step] = []
    lines = iter(enumerate(text.splitlines(), 1))
    for number, line in lines:
        fence = re.match(r" *(`{3,})([^`\s]*)(.*)", line)
        if fence is None:
            continue
        body = []
        for _, inner in lines:
            if inner.strip() == fence[1]:
                break
            if "```" in inner:
                raise PageError(f"line {number}: a block inside another would not be run")
            body.append(inner)
        else:
            raise PageError(f"line {number}: the block does not end")
        language, argument = fence[2], fence[3].strip()
        if language == "{literalinclude}":
            shown = _included(folder / argument, body)
            found += [Step("shell", command, number) for command in commands(shown, prompt=True)]
        elif language in RUN and RUN[language] != "shell":
            found.append(Step(RUN[language], "\n".join(body) + "\n", number))
        elif language in RUN:
            found += [Step("shell", command, number) for command in commands(body)]
        elif language not in SHOWN and not language.startswith("{"):
            raise PageError(f"line {number}: run or show a block {language!r}? see RUN and SHOWN")
    return found


def _included(path: Path, options: list[str]) -> list[str]:
    """Return the lines of a file that ``literalinclude`` shows."""
    lines = path.read_text("utf-8").splitlines()
    for option in options:
        key, _, value = option.strip().partition(": ")
        places = [i for i, line in enumerate(lines) if value.strip('"') in line]
        if key == ":start-at":
            lines = lines[places[0] :]
        elif key == ":end-before":
            lines = lines[: places[0]]
    return lines


def commands(lines: list[str], *, prompt: bool = False) -> list[str]:
    """Return the commands of a terminal, in which outputs may stand between lines with ``$``."""
    if lines and lines[0].startswith("#!"):
        return ["\n".join(lines)]  # a script
    if prompt or any(line.startswith("$ ") for line in lines):
        lines = [line[2:] for line in lines if line.startswith("$ ")]
    found, rest = [], iter(lines)
    for line in rest:
        end = re.search(r"<< *(\w+)$", line)
        if end is None:
            found += [part for part in line.split(" && ") if part]
            continue
        document = [line]
        while document[-1] != end[1]:
            document.append(next(rest))
        found.append("\n".join(document))
    return found


def sessions() -> dict[str, str]:
    """Return what the recorded sessions show, by `key` of the command."""
    found = {}
    for path in sorted(PICTURES.glob("*.txt")):
        for part in re.split(r"^\$ ", path.read_text("utf-8"), flags=re.MULTILINE)[1:]:
            command, _, output = part.partition("\n")
            found[key(command)] = output
    return found


def key(command: str) -> str:
    """Return a command without the files that it writes: they do not change what it prints."""
    return re.sub(r" (-o|--output|--plot) \S+", "", command)


def run(command: str) -> tuple[int, str]:
    """Run ``ftforce …`` as a shell would; return the exit status and what is printed."""
    words = shlex.split(command)
    target = None
    if ">" in words:
        *words, _, target = words
    words = [one for word in words for one in (sorted(glob.glob(word)) or [word])]  # noqa: PTH207
    result = CliRunner(env={"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}).invoke(
        app, words[1:], prog_name="ftforce"
    )
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise PageError("".join(traceback.format_exception(result.exception)))
    if target is not None:
        Path(target).write_text(result.stdout, "utf-8")
    return result.exit_code, "\n".join(line.rstrip() for line in result.output.splitlines()) + "\n"


def check_command(command: str, expected: str | None) -> None:
    """Run a command, and compare what it prints with what a session shows.

    Raises
    ------
    PageError
        It fails, succeeds where the session shows an error, or prints something else.
    """
    if not command.startswith("ftforce "):
        other = subprocess.run(["bash", "-ec", command], check=False, capture_output=True)
        if other.returncode:
            raise PageError(f"exit status {other.returncode}\n{other.stderr.decode()}")
        return
    status, output = run(command)
    is_refused = expected is not None and expected.startswith("error: ")
    if (status != 0) != is_refused:
        raise PageError(f"exit status {status}\n{output}")
    if expected is not None and not is_same(*map(_printed, (expected, output))):
        raise PageError(f"docs/pictures shows something else; now it prints\n{output}")


def _printed(output: str) -> str:
    """Return an output without the names of the files that were written."""
    return re.sub(r"^wrote \S+\n", "", output, flags=re.MULTILINE).strip()


def is_same(old: str, new: str) -> bool:
    """Compare texts word for word and their numbers up to rounding."""
    number = r"(-?\d+\.?\d*(?:e[-+]?\d+)?)"
    for one, other in zip_longest(re.split(number, old), re.split(number, new), fillvalue=""):
        if one != other and not (re.fullmatch(number, one) and re.fullmatch(number, other)):
            return False
        if one != other and not math.isclose(float(one), float(other), abs_tol=ROUNDING):
            return False
    return True


def run_step(step: Step, names: dict[str, Any], expected: str | None) -> None:
    """Run one step in the current folder.

    Raises
    ------
    PageError
        It does not do what the page says.
    """
    if step.kind == "shell":
        check_command(step.text, expected)
    elif step.kind == "doctest":
        test = doctest.DocTestParser().get_doctest(step.text, names, "page", None, step.line)
        report = io.StringIO()
        runner = doctest.DocTestRunner(optionflags=FLAGS)
        failed = runner.run(test, out=report.write, clear_globs=False).failed
        names.update(test.globs)
        if failed:
            raise PageError(report.getvalue())
    else:
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                exec(step.text, names)
        except Exception as error:
            raise PageError(traceback.format_exc()) from error


def lay_out(text: str) -> None:
    """Copy the files that a page names into the current folder."""
    for folder, name in set(re.findall(r"\b(docs/examples|robots)/([\w.-]*\w)", text)):
        source = ROOT / folder / name
        target = Path("robots" if folder == "robots" else ".") / name
        target.parent.mkdir(exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target)
        elif source.suffix != ".py":
            shutil.copy(source, target)


def run_page(name: str, text: str, todo: list[Step], shown: dict[str, str], report: Report) -> None:
    """Run the steps of a page in a folder of its own."""
    names: dict[str, Any] = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        lay_out(text)
        for step in todo:
            report.commands.add(key(step.text))
            if marks := [mark for mark in NOT_RUN if re.search(mark, step.text)]:
                report.marks.update(marks)
                continue
            changed = step.text
            for pattern, replacement, _ in CHANGED if step.kind == "shell" else ():
                if re.search(pattern, changed):
                    report.marks.add(pattern)
                    changed = re.sub(pattern, replacement, changed)
            try:
                run_step(Step(step.kind, changed, step.line), names, shown.get(key(step.text)))
            except PageError as error:
                first = step.text.splitlines()[0]
                report.failed.append(f"{name}:{step.line}: {first}\n{error}")
            report.run += 1


def run_help(report: Report) -> None:
    """Run the examples of the help of every command; those of one may need the files of others."""
    todo = [Step("shell", f"ftforce {one}", 0) for pair in EXAMPLES.values() for one in pair]
    run_page("help", "docs/examples/rail_arm.toml", todo, {}, report)


def run_all(pages: list[Path]) -> Report:
    """Run pages, and the help; say what is not shown or not met any more."""
    report, shown = Report(), sessions()
    for page in pages:
        name = str(page.relative_to(ROOT))
        text = page.read_text("utf-8")
        try:
            todo = steps(text, page.parent)
        except PageError as error:
            report.failed.append(f"{name}: {error}")
            continue
        run_page(name, text, todo, shown, report)
    return report


def every_page() -> list[Path]:
    """Return the pages, the README first."""
    return [page for pattern in PAGES for page in sorted(ROOT.glob(pattern))]


def main() -> None:
    """Run all pages or those that are named, and say what failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE")
    chosen = [page.resolve() for page in parser.parse_args().pages]
    os.environ.pop("FORCE_COLOR", None)
    os.environ["MPLBACKEND"] = "agg"
    report = run_all(chosen or every_page())
    if not chosen:
        run_help(report)
        marks = {*NOT_RUN, *(pattern for pattern, _, _ in CHANGED)}
        report.failed += [f"no page has {mark} any more" for mark in marks - report.marks]
        hidden = sessions().keys() - report.commands
        report.failed += [f"docs/pictures has {one}, but no page shows it" for one in hidden]
    for mark in [mark for mark in NOT_RUN if mark in report.marks]:
        print(f"not run: {mark}: {NOT_RUN[mark]}")
    for pattern, replacement, reason in CHANGED:
        if pattern in report.marks:
            print(f"run as {replacement}: {reason}")
    print("\n".join(report.failed) or f"{report.run} blocks and commands do what the pages say")
    sys.exit(1 if report.failed else 0)


if __name__ == "__main__":
    main()
