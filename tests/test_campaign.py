"""The campaign: hostile command lines, calls and files, in numbers (docs/contributing).

Everything is drawn from the number of the case, which a failure prints; this repeats it alone:
``FTFORCE_CASE=1234 pytest tests/test_campaign.py -k "lines and 0"``. Files of sweeps and histories
are in test_damaged_files and test_history_files, kills in test_batch_store, names in test_names.
"""

from __future__ import annotations

import csv
import io
import json
import random
import re
import shutil
import subprocess
import sys
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

import ftforce
import hostile_calls
import hostile_lines
from ftforce import cli
from ftforce.batch import cluster
from ftforce.batch.postures.files import postures_from_file
from ftforce.errors import FtforceError, TrajectoryError
from ftforce.show import render
from ftforce.view.session import Session
from helpers import campaign
from sweeps import LONG, ROOT, content, differences
from test_damaged_files import HARMS, harmed

pytestmark = pytest.mark.thorough  # thousands of cases

PARTS = 6  # for as many processes
NO_PATH = "os.PathLike"  # of the TypeError that Python raises for what is no path


def in_one_line(message):
    return message.isprintable() and 0 < len(message) < 2000


# ---- command lines ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lines")
    hostile_lines.write_inputs(folder)
    return folder


def states(folder):
    """Return what shows that a file was written: device, inode, size and time."""
    found = {}
    for path in folder.rglob("*"):
        if not (path.is_dir() and not path.is_symlink()):
            about = path.lstat()
            found[path] = (about.st_ino, about.st_size, about.st_mtime_ns)
    return found


def read_whole(path, words):
    """Read a file that a command wrote; raise an error if a part is missing."""
    data = path.read_bytes()
    if "--format" in words:  # whatever the file is called
        form = words[words.index("--format") + 1]
        path = path.with_suffix(path.suffix if form == "table" else f".{form}")
    if path.name == ".zmetadata":
        ftforce.open_sweep(path.parent).dataset.load()
    elif path.suffix in {".npz", ".parquet"}:
        ftforce.load_history(path)
    elif path.suffix == ".json":
        json.loads(data, parse_constant=pytest.fail)
    elif path.suffix == ".csv":
        rows = list(csv.reader(io.StringIO(data.decode(), newline="")))
        assert len({len(row) for row in rows if row}) <= 2  # an analysis has two tables
    elif path.suffix in {".svg", ".urdf", ".srdf"}:
        ElementTree.fromstring(data)
    elif path.suffix in {".html", ".htm"}:
        assert data.rstrip().endswith(b"</html>")
    elif path.suffix in {".png", ".pdf"}:
        assert data[:4] in {b"\x89PNG", b"%PDF"}
        assert data.rstrip().endswith((b"IEND\xaeB`\x82", b"%%EOF"))


def what_is_wrong(words, result):
    """Return which kind of fault the end of a command is, and why; ``None`` if it is none."""
    said = [line for line in result.stderr.split("\n") if line]
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return "tracebacks", repr(result.exception)
    if result.exit_code not in (0, 1, 2) or "Traceback" in result.output:
        return "tracebacks", f"status {result.exit_code}: {result.output[-300:]}"
    if any("internal error" in line for line in said):
        return "tracebacks", said[-1]
    errors = [line for line in said if not line.startswith(("warning: ", "note: ", "wrote "))]
    is_clear = [error[:7] for error in errors] == ["error: "] * (result.exit_code != 0)
    if not is_clear or not all(map(in_one_line, said)) or (result.exit_code == 2 and result.stdout):
        return "unclear messages", repr(result.stdout[:200] + result.stderr)
    return None


@pytest.mark.parametrize("part", range(PARTS))
def test_random_command_lines(inputs, monkeypatch, tally, part):
    monkeypatch.chdir(inputs)
    monkeypatch.setattr(cluster, "TIMEOUT", 0.1)
    monkeypatch.setattr(Session, "run", lambda *_: None)  # serves until Ctrl-C
    untouched = states(inputs)
    before = {path: path.read_bytes() for path in untouched if path.is_file()}
    for number in tally.numbers("command lines", 5000, part, PARTS):
        words = hostile_lines.draw(number)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = CliRunner().invoke(cli.app, words, env={"COLUMNS": "80"})
        tally.tried(refused=result.exit_code != 0)
        case = f"{number}: ftforce {' '.join(map(repr, words))}"
        if wrong := what_is_wrong(words, result):
            tally.fails(wrong[0], case, wrong[1])
        now = states(inputs)
        if any(now.get(path) != state for path, state in untouched.items()):
            tally.fails("lost bytes", case, "an input was changed")
            break
        for path in now.keys() - untouched:
            try:
                read_whole(path, words)
            except Exception as problem:  # whatever a reader of half a file raises
                tally.fails("lost bytes", case, f"{path.name} is not whole: {problem!r}")
        remove(now.keys() - untouched, inputs)
    assert {path: path.read_bytes() for path in untouched if path.is_file()} == before


def remove(paths, folder):
    for path in {folder / path.relative_to(folder).parts[0] for path in paths}:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def test_the_lines_reach_every_command_and_option():
    for name, command in hostile_lines.commands().items():
        words = {word for number in range(1200) for word in hostile_lines.draw(number, name)}
        options = {parameter.opts[0] for parameter in command.params if parameter.opts}
        assert {o for o in options if o.startswith("--")} - words <= {"--help", "--debug"}, name


# ---- calls -----------------------------------------------------------------------------------


def documents(kind, name, words):
    """Return whether the documentation of an attribute contains one of these words."""
    for one in kind.__mro__:
        text = getattr(vars(one).get(name), "__doc__", None) or ""
        about = (one.__doc__ or "").partition("Attributes")
        entries = re.split(r"\n    (?=\S)", about[2])
        text += about[0] + " ".join(
            x for x in entries if name in re.split(" :|, ", x.split("\n")[0])
        )
        if any(word in text for word in words):
            return True
    return False


ELSEWHERE = ("likewise", "as the arrays of", "see `")  # where the text refers to another


def odd_numbers(value, seen):
    """Yield the attributes that hold NaN or infinity and do not say so."""
    if isinstance(value, (tuple, list)) and not hasattr(value, "_fields"):
        for item in value:
            yield from odd_numbers(item, seen)
    kind = type(value)
    is_ours = kind.__module__.startswith("ftforce") and not isinstance(value, ftforce.Robot)
    if not is_ours or id(value) in seen:
        return
    seen.add(id(value))
    for name in dir(kind):
        if name.startswith("_") or name in {"dataset", "question", "robot"}:
            continue
        found = getattr(value, name)
        numbers = np.asarray(found) if isinstance(found, (float, np.ndarray)) else np.zeros(0)
        if numbers.dtype.kind != "f":
            continue
        if np.isnan(numbers).any() and not documents(kind, name, ("NaN", *ELSEWHERE)):
            yield f"{kind.__name__}.{name} is NaN"
        if np.isinf(numbers).any() and not documents(kind, name, ("infinit", *ELSEWHERE)):
            yield f"{kind.__name__}.{name} is infinite"
        yield from () if callable(found) else odd_numbers(found, seen)


def unsaid(call, result, *, is_shown):
    """Yield what is wrong with a result."""
    yield from odd_numbers(result, set())
    if not in_one_line(repr(result)) and isinstance(result, ftforce.core.display.Displayed):
        yield f"its repr is {result!r}"
    if call.is_tame and hasattr(result, "is_proved") and not result.is_proved():
        yield f"it does not prove itself: {result.residuals()}"
    try:
        document = ftforce.to_dict(result)
    except FtforceError:  # an intermediate result
        return
    json.dumps(document, allow_nan=False)
    if is_shown:
        text = render.to_text(render.render(result))
        if found := re.search(r"(?<![\w-])(nan|inf)(?![\w-])", text):
            yield f"its tables say {found[0]}"


@pytest.mark.parametrize("part", range(PARTS))
def test_random_calls(tmp_path, monkeypatch, tally, part):
    monkeypatch.chdir(tmp_path)
    hostile_calls.robots(), hostile_calls.results()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of NumPy above all
        for number in tally.numbers("calls", 20_000, part, PARTS):
            call = None
            try:
                call = hostile_calls.draw(number, tmp_path)
                result = call()
                for why in unsaid(call, result, is_shown=number % 20 == 0):
                    tally.fails("silent differences", f"{number}: {call}", why)
            except FtforceError as problem:
                tally.tried(refused=1)
                if not in_one_line(str(problem)):
                    tally.fails("unclear messages", f"{number}: {call}", str(problem))
            except Exception as problem:  # nothing else may be raised
                is_no_path = isinstance(problem, TypeError) and NO_PATH in str(problem)
                tally.tried(refused=is_no_path)
                if not is_no_path:
                    tally.fails("tracebacks", f"{number}: {call}", repr(problem))
            else:
                tally.tried()


def test_every_public_name_is_called(tmp_path):
    called = {kind.function for kind in hostile_calls.KINDS}
    functions = {getattr(ftforce, name) for name in ftforce.__all__}
    by_others = {ftforce.Remapper, ftforce.to_dict, ftforce.write_robot, ftforce.DHTable}
    returned = {ftforce.Analysis, ftforce.Census, ftforce.Comparison, ftforce.History}
    returned |= {ftforce.Remap, ftforce.Robot, ftforce.Sweep, ftforce.Timeline}
    words = {ftforce.FaultMode, ftforce.Verdict, ftforce.FtforceError}
    assert functions - called == by_others | returned | words


# ---- files of postures -----------------------------------------------------------------------


@pytest.mark.parametrize("form", ["npy", "csv", "parquet"])
@pytest.mark.parametrize("harm", HARMS)
def test_damaged_postures_are_read_whole_or_refused(dh5, tmp_path, tally, form, harm):
    """An altered number is another posture, but none may be lost or made up in silence."""
    from test_batch_posture_files import written_for

    path = written_for(dh5, tmp_path, form, 40)
    for number in tally.numbers("posture files", 1 if harm == "lost" else 300):
        before = harmed(path, harm, random.Random(f"{form} {harm} {number}"))
        after = path.read_bytes() if path.exists() else b""
        try:
            postures = postures_from_file(dh5, path)
            q = postures.block(0, postures.count)
        except TrajectoryError as problem:
            tally.tried(refused=1)
            if not in_one_line(str(problem)):
                tally.fails("unclear messages", number, str(problem))
        except Exception as problem:
            tally.tried()
            tally.fails("tracebacks", number, repr(problem))
        else:
            tally.tried()
            lines = [line for line in after.splitlines()[1:] if line.strip()]
            wanted = len(lines) if form == "csv" else 40
            if q.shape != (wanted, 5) or not np.isfinite(q).all():
                tally.fails("silent differences", number, f"{q.shape} instead of {wanted}")
        path.write_bytes(before)


# ---- several writers, and killed ones --------------------------------------------------------

_WRITERS = """
import json, os, signal, sys, time
import ftforce

robot = ftforce.load_robot("dh5")
sweep = lambda path: ftforce.sweep(robot, n=9000, chunk=4096, threads=1, output=path)
sweep(None)  # loads the kernels

def started(act):
    child = os.fork()
    if not child:
        status = 1
        try:
            act()
            status = 0
        except ftforce.FtforceError as problem:
            os.write(2, f"{problem}\\n".encode())
            status = 3
        finally:
            os._exit(status)
    return child

def status_of(child):
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

asked = json.loads(sys.argv[1])
found = {"raced": [], "killed": []}
for path in asked["raced"]:
    children = [started(lambda: sweep(path)) for _ in range(3)]
    found["raced"].append([status_of(child) for child in children])

results = [ftforce.analyze(robot, locked=i, force=[1, 2, 3]) for i in (1, 2)]
target = asked["target"]
contents = []
for result in results:
    ftforce.save(result, target)
    contents.append(open(target, "rb").read())

def killed_at(point):
    steps = 0
    def counted(function):
        def step(*args, **more):
            nonlocal steps
            steps += 1
            if steps == point:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*args, **more)
        return step
    for name in ("fsync", "replace", "rename", "open", "write", "close", "chmod", "fdopen"):
        setattr(os, name, counted(getattr(os, name)))
    ftforce.save(results[point % 2], target)

for point in range(1, asked["points"]):
    status = status_of(started(lambda: killed_at(point)))
    data = open(target, "rb").read() if os.path.exists(target) else b""
    found["killed"].append([status, data in contents])

def writes(result):
    for _ in range(asked["writes"]):
        ftforce.save(result, target)

children = [started(lambda: writes(result)) for result in results]
found["whole"] = [open(target, "rb").read() in contents for _ in range(asked["writes"])]
found["writers"] = [status_of(child) for child in children]
print(json.dumps(found))
"""


@pytest.mark.usefixtures("kernels")  # other processes may compile them meanwhile
def test_racing_and_killed_writers(dh5, tmp_path, tally):
    tally.kind = "racing and killed writers"
    rounds = campaign(20, 2)
    paths = [str(tmp_path / f"{i}.zarr") for i in range(rounds)]
    target = str(tmp_path / "out.json")
    asked = {"raced": paths, "target": target, "points": 15, "writes": campaign(500)}
    command = [sys.executable, "-W", "ignore", "-c", _WRITERS, json.dumps(asked)]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=ROOT, timeout=LONG
    )
    assert not done.returncode, done.stderr
    found = json.loads(done.stdout)
    ftforce.sweep(dh5, n=9000, chunk=4096, threads=1, output=tmp_path / "alone.zarr")
    for path, statuses in zip(paths, found["raced"], strict=True):
        tally.tried(len(statuses), refused=statuses.count(3))
        if 0 not in statuses or set(statuses) - {0, 3}:
            tally.fails("tracebacks", path, statuses)
        if differences(content(path), content(tmp_path / "alone.zarr")):
            tally.fails("lost bytes", path, "another sweep than that of one writer")
    # Beside them stands at most that kernels are compiled, on a machine with other work.
    said = [line for line in done.stderr.splitlines() if not line.startswith("compiling")]
    assert not [x for x in said if "is being written by another sweep (process" not in x]
    assert len(said) == sum(statuses.count(3) for statuses in found["raced"])
    for point, (status, is_whole) in enumerate(found["killed"], start=1):
        tally.tried()
        if status not in (0, -9) or not is_whole:
            tally.fails("lost bytes", f"killed at step {point}", status)
    assert [status for status, _ in found["killed"]].count(-9) >= 3
    assert found["killed"][-1][0] == 0  # every step was reached
    tally.tried(2 * asked["writes"])
    if not all(found["whole"]) or any(found["writers"]):
        tally.fails("lost bytes", "two writers of one file", found["writers"])
