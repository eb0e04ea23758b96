"""Save histories to CSV, NPZ and Parquet files and load them without loss.

A table (CSV, Parquet) has one row per run and instant, and one column per number, named with its
unit. The inputs of the simulation are stored as JSON: in the last column of the first row of a CSV
file, in the metadata of a Parquet file, in the array ``about`` of an NPZ file. They contain a
SHA-256 of themselves and of all numbers, by which altered data are noticed.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
from dataclasses import asdict
from itertools import chain, islice, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.core.arrays import read_only
from ftforce.core.task import Task
from ftforce.core.verdict import VERDICTS, Verdict
from ftforce.errors import FtforceError, InputError, TrajectoryError, printable
from ftforce.io.npz import read_npz
from ftforce.io.text import check_name, printable_texts, read_bytes
from ftforce.trajectory.history import (
    QUANTITIES,
    RUNS,
    SCALARS,
    EventReport,
    History,
    JointInfo,
    Run,
    Setting,
    width,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from os import PathLike

    from ftforce.core.arrays import Matrix

FORMATS = ("csv", "npz", "parquet")
_LONGEST_CELL = 10_000_000  # characters: one cell holds the whole setting as JSON
_LARGEST_FILE = 20_000_000_000  # bytes
_KIND = "a history written by ftforce (.csv, .npz or .parquet)"
_VERSION, _WITHOUT_DIGEST = 2, 1
_EXPANSION, _SMALL = 1000, 100_000_000  # times its size, or bytes, may a Parquet file unfold to
_ROWS = 10_000  # of a CSV file, converted at once
_ABOUT, _KEY = "about", b"ftforce"
_WORDS = [verdict.value for verdict in VERDICTS]
_LISTS = (
    "force",
    "effort",
    "effort_lower",
    "gravity",
    "payload_offset",
    "payload_inertia",
    "warnings",
    "notes",
)
_PER_JOINT = {"q": "", "v": "/s", "a": "/s²"}
_TORQUES = ("rnea", "force_part", "U", "motor", "brake", "unbalanced")
_PLACES = {
    "position": "m",
    "path_error": "m",
    "orientation_error": "rad",
    "velocity_jump": "m/s",
}


class Column(NamedTuple):
    """A column of the table.

    Attributes
    ----------
    quantity :
        Name of the array.
    component :
        Column index in the array; ``None`` if the quantity is a scalar per instant.
    header :
        Name and unit.
    """

    quantity: str
    component: int | None
    header: str


def columns_of(setting: Setting) -> list[Column]:
    """Return the table columns of a run."""
    columns: list[Column] = []
    for quantity in QUANTITIES:
        if quantity in SCALARS:
            continue
        names, units = _components(setting, quantity)
        columns += [
            Column(quantity, i, f"{quantity}_{name}" + (f" [{unit}]" if unit else ""))
            for i, (name, unit) in enumerate(zip(names, units, strict=True))
        ]
    return [*columns, *(Column(quantity, None, quantity) for quantity in SCALARS)]


def _components(setting: Setting, quantity: str) -> tuple[Sequence[str], Sequence[str]]:
    """Return names and units of the components of a quantity."""
    joints, task = setting.joints, setting.task
    if quantity in _PLACES:
        return "xyz", [_PLACES[quantity]] * 3
    if quantity == "orientation":
        return "xyzw", [""] * 4
    if quantity in {"force", "jump"}:
        return task.components, task.units
    names = [joint.name for joint in joints]
    if quantity in _TORQUES:
        return names, [joint.torque_unit for joint in joints]
    if quantity in _PER_JOINT:
        return names, [joint.unit + _PER_JOINT[quantity] for joint in joints]
    return names, [""] * len(joints)


def history_bytes(
    history: History, form: str, origin: Mapping[str, str | None] | None = None
) -> bytes:
    """Return the file content for a history.

    Parameters
    ----------
    history :
        The history.
    form :
        ``csv``, ``npz`` or ``parquet``.
    origin :
        What wrote the file and from which robot, to be told in it.

    Raises
    ------
    InputError
        Parquet is requested but pyarrow is not installed.
    """
    return {"csv": _csv_bytes, "npz": _npz_bytes, "parquet": _parquet_bytes}[form](
        history, _about(history, origin)
    )


def load_history(path: str | PathLike[str]) -> History:
    """Load a history written by `ftforce.save` or ``ftforce simulate -o``.

    All arrays are restored exactly.

    Parameters
    ----------
    path :
        A ``.csv``, ``.npz`` or ``.parquet`` file.

    Raises
    ------
    InputError
        The file name has another extension, or pyarrow is missing.
    TrajectoryError
        The file cannot be read, or is not a history written by ftforce.

    Examples
    --------
    >>> import ftforce
    >>> history = ftforce.load_history("run.npz")  # doctest: +SKIP
    """
    form = Path(path).suffix.lower().removeprefix(".")
    if form not in FORMATS:
        raise InputError(f"{printable(path)}: the name must end in .csv, .npz or .parquet")
    data = read_bytes(path, TrajectoryError, _KIND, _LARGEST_FILE)
    read = {"csv": _from_csv, "npz": _from_npz, "parquet": _from_parquet}[form]
    try:
        text, history = read(data)
        _check_digest(text, history)
        return history
    except MemoryError:
        raise
    except FtforceError as problem:
        if isinstance(problem, InputError):
            raise TrajectoryError(path, str(problem)) from None
        raise
    except Exception as problem:  # damaged files raise arbitrary errors in the readers
        raise TrajectoryError(
            path, f"is not an ftforce history, or is damaged ({printable(problem)})"
        ) from None


# ---- setting ---------------------------------------------------------------------------------


def _about(history: History, origin: Mapping[str, str | None] | None = None) -> str:
    setting = asdict(history.setting)
    task = history.setting.task
    for name in ("effort", "effort_lower"):
        setting[name] = [None if math.isnan(x) else x for x in getattr(history.setting, name)]
    setting["delay"] = None if math.isinf(history.setting.delay) else history.setting.delay
    setting["task"] = {"components": task.components, "axes": task.axes, "length": task.length}
    content = {
        "format": "ftforce history",
        "version": _VERSION,
        "runs": list(history.runs),
        "verdicts": _WORDS,
        "setting": setting,
    }
    if origin is not None:
        content["provenance"] = dict(origin)
    content["sha256"] = _digest(content, history)
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


def _digest(about: dict[str, Any], history: History) -> str:
    """Return the SHA-256 of the inputs and of all numbers of a history."""
    inputs = {key: value for key, value in about.items() if key != "sha256"}
    digest = hashlib.sha256(json.dumps(inputs, ensure_ascii=False).encode())
    arrays = [history.t, history.path]
    for run in history.runs.values():
        arrays += [getattr(run, quantity) for quantity in QUANTITIES]
    for array in arrays:
        # A CSV file has one NaN only.
        digest.update(np.where(np.isnan(array), np.nan, array).tobytes())
    return digest.hexdigest()


def _check_digest(text: str, history: History) -> None:
    """Check that a history is what was saved.

    Raises
    ------
    InputError
        Its numbers or inputs were altered.
    """
    about = json.loads(text)
    if about["version"] != _WITHOUT_DIGEST and about["sha256"] != _digest(about, history):
        raise InputError("is damaged: its numbers are not those that were saved")


def _read_about(text: str) -> tuple[Setting, list[str]]:
    about = json.loads(text)
    if about.get("format") != "ftforce history":
        raise InputError("is not an ftforce history")
    if about["version"] not in {_VERSION, _WITHOUT_DIGEST}:
        raise InputError(f"has format version {about['version']}; this ftforce reads {_VERSION}")
    content = about["setting"]
    for kind in ("robot", "base", "tip"):
        check_name(content[kind], kind)
    for joint in content["joints"]:
        check_name(joint["name"], "joint")
    content = printable_texts(content)
    for name in ("effort", "effort_lower"):
        content[name] = [math.nan if x is None else x for x in content.get(name, ())]
    content["delay"] = math.inf if content["delay"] is None else content["delay"]
    task = content["task"]
    setting = Setting(
        **{
            **content,
            "joints": tuple(JointInfo(**joint) for joint in content["joints"]),
            "task": Task(tuple(task["components"]), task["axes"], task["length"]),
            "events": tuple(map(_event, content["events"])),
            # An older version stored neither the numbers of the payload nor the choice of the tip.
            **{name: tuple(content.get(name, ())) for name in _LISTS},
            "other_tips": {k: tuple(v) for k, v in content.get("other_tips", {}).items()},
        }
    )
    runs = about["runs"]
    if runs not in [list(RUNS), list(RUNS[:2])] or about["verdicts"] != _WORDS:
        raise InputError("contains runs or verdicts unknown to this ftforce")
    return setting, runs


def _event(content: dict[str, Any]) -> EventReport:
    jumps = {name: tuple(content[name]) for name in ("impact_jump", "velocity_jump")}
    return EventReport(**{**content, **jumps, "verdict": Verdict(content["verdict"])})


def _history(setting: Setting, t: Matrix, path: Matrix, runs: dict[str, Any]) -> History:
    """Build a history from its arrays after checking their shapes."""
    count, n, m = len(t), len(setting.joints), setting.task.m
    found: dict[str, Run | None] = dict.fromkeys(RUNS)
    for name, arrays in runs.items():
        for quantity in QUANTITIES:
            size = width(quantity, n, m)
            wanted = (count,) if size is None else (count, size)
            kind = "int8" if quantity == "verdict" else "float64"
            if arrays[quantity].shape != wanted or arrays[quantity].dtype != kind:
                raise InputError(f"{quantity} has the wrong shape or type")
        codes = arrays["verdict"]
        if codes.size and not 0 <= codes.min() <= codes.max() < len(VERDICTS):
            raise InputError("contains an invalid verdict")
        found[name] = Run(**{quantity: read_only(arrays[quantity]) for quantity in QUANTITIES})
    if t.shape != (count,) or path.shape != (count, 3) or not count:
        raise InputError("times or path have the wrong shape")
    healthy, unremapped = found["healthy"], found["unremapped"]
    assert healthy is not None
    assert unremapped is not None
    return History(setting, read_only(t), read_only(path), healthy, unremapped, found["remapped"])


# ---- NPZ -------------------------------------------------------------------------------------


def _npz_bytes(history: History, about: str) -> bytes:
    arrays = {"about": np.array(about), "t": history.t, "path": history.path}
    for name, run in history.runs.items():
        arrays |= {f"{name}.{quantity}": getattr(run, quantity) for quantity in QUANTITIES}
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def _from_npz(data: bytes) -> tuple[str, History]:
    arrays = read_npz(data)
    if "about" not in arrays:
        raise InputError("is not an ftforce history: it does not describe the simulation")
    text = str(arrays["about"])
    setting, names = _read_about(text)
    runs = {
        name: {quantity: arrays[f"{name}.{quantity}"] for quantity in QUANTITIES} for name in names
    }
    return text, _history(setting, arrays["t"], arrays["path"], runs)


# ---- tables ----------------------------------------------------------------------------------

_SHARED = ("t [s]", "path_x [m]", "path_y [m]", "path_z [m]")


def _table(history: History) -> dict[str, Any]:
    """Return the columns of all runs, concatenated."""
    runs = history.runs
    count = len(history.t)
    table: dict[str, Any] = {"run": np.repeat(list(runs), count)}
    for header, values in zip(_SHARED, (history.t, *history.path.T), strict=True):
        table[header] = np.tile(values, len(runs))
    for quantity, index, header in columns_of(history.setting):
        arrays = [getattr(run, quantity) for run in runs.values()]
        table[header] = np.concatenate([x if index is None else x[:, index] for x in arrays])
    table["verdict"] = np.array(_WORDS)[table["verdict"]]
    return table


def _from_table(setting: Setting, names: list[str], table: dict[str, Any]) -> History:
    columns = columns_of(setting)
    wanted = ["run", *_SHARED, *(column.header for column in columns)]
    if list(table) != wanted:
        raise InputError("has columns that do not match the simulation it describes")
    count, rest = divmod(len(table["run"]), len(names))
    if rest or list(table["run"]) != [name for name in names for _ in range(count)]:
        raise InputError("has missing or reordered rows")
    codes = {word: code for code, word in enumerate(_WORDS)}
    table["verdict"] = np.array([codes[word] for word in table["verdict"]], dtype=np.int8)
    runs: dict[str, Any] = {}
    for i, name in enumerate(names):
        rows = slice(i * count, (i + 1) * count)
        arrays: dict[str, list[Any]] = {}
        for quantity, _, header in columns:
            arrays.setdefault(quantity, []).append(table[header][rows])
        runs[name] = {
            quantity: parts[0].copy() if quantity in SCALARS else np.stack(parts, axis=1)
            for quantity, parts in arrays.items()
        }
    t, *path = (table[header][:count] for header in _SHARED)
    return _history(setting, t.copy(), np.stack(path, axis=1), runs)


def rows_of(history: History) -> list[tuple[Any, ...]]:
    """Return all instants of all runs as table rows, header first; NaN becomes an empty cell.

    Parameters
    ----------
    history :
        The history.
    """
    table = _table(history)
    cells = (map(_cell, column.tolist()) for column in table.values())
    return [tuple(table), *zip(*cells, strict=True)]


def _csv_bytes(history: History, about: str) -> bytes:
    table = _table(history)
    found, last = io.BytesIO(), chain([about], repeat(""))
    with io.TextIOWrapper(found, "utf-8", newline="") as text:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*table, _ABOUT])
        for start in range(0, len(table["run"]), _ROWS):
            rows = (column[start : start + _ROWS].tolist() for column in table.values())
            cells = (map(_cell, column) for column in rows)
            writer.writerows(zip(*cells, last, strict=False))
        text.flush()
        return found.getvalue()


def _cell(value: Any) -> Any:
    """Format a number with full precision; NaN becomes an empty cell."""
    return "" if isinstance(value, float) and math.isnan(value) else value


def _from_csv(data: bytes) -> tuple[str, History]:
    usual = csv.field_size_limit(_LONGEST_CELL)  # process-wide, so it is restored
    try:
        stream = io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", newline="")
        rows = csv.reader(stream, strict=True)
        header, first = next(rows), next(rows, None)
        if header[-1:] != [_ABOUT] or first is None:
            raise InputError("is not an ftforce history: its last column is not 'about'")
        setting, names = _read_about(first[-1])
        table = _columns_of_rows(header[:-1], chain([first], rows))
    finally:
        csv.field_size_limit(usual)
    return first[-1], _from_table(setting, names, table)


def _columns_of_rows(header: list[str], rows: Iterator[list[str]]) -> dict[str, Any]:
    """Return the columns of a table, converting some rows at a time: texts take much memory."""
    table: dict[str, Any] = {name: [] for name in header}
    while some := list(islice(rows, _ROWS)):
        for name, cells in zip(header, zip(*some, strict=True), strict=False):
            is_text = name in {"run", "verdict"}
            table[name].append(cells if is_text else np.array([float(x or "nan") for x in cells]))
    return {name: np.concatenate(parts) for name, parts in table.items()}


def _parquet_bytes(history: History, about: str) -> bytes:
    parquet, arrow = _pyarrow()
    table = arrow.table(_table(history)).replace_schema_metadata({_KEY: about})
    stream = io.BytesIO()
    parquet.write_table(table, stream, write_page_checksum=True)
    return stream.getvalue()


def _from_parquet(data: bytes) -> tuple[str, History]:
    parquet, arrow = _pyarrow()
    file = parquet.ParquetFile(
        arrow.BufferReader(data), pre_buffer=False, page_checksum_verification=True
    )
    about, size = file.schema_arrow.metadata or {}, file.metadata
    if _KEY not in about:
        raise InputError("is not an ftforce history: it does not describe the simulation")
    if 8 * size.num_rows * size.num_columns > max(_SMALL, _EXPANSION * len(data)):
        raise InputError(f"declares {size.num_rows:,} rows, more than it can hold")
    text = about[_KEY].decode()
    setting, names = _read_about(text)
    # Single-threaded: reader threads can crash the interpreter at exit.
    table = file.read(use_threads=False)
    columns = {
        name: column.to_numpy() for name, column in zip(table.column_names, table, strict=True)
    }
    return text, _from_table(setting, names, columns)


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise FtforceError(
            "Parquet files need pyarrow: pip install 'ftforce[parquet]'; .npz and .csv do not"
        ) from None
    return parquet, pyarrow
