"""Write results to files: JSON with its conventions; CSV, Excel, LaTeX and Markdown with units."""

from __future__ import annotations

import csv
import io
import json
import re
from functools import singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.analysis.analyze import Analysis
from ftforce.analysis.capability import Capability
from ftforce.analysis.census import Census
from ftforce.analysis.paper import Replication
from ftforce.batch.comparison import Comparison
from ftforce.batch.result import Sweep
from ftforce.batch.workspace_map import WorkspaceMap
from ftforce.errors import InputError, printable
from ftforce.io.text import write_whole
from ftforce.planning.joint_ranges import FORMATS as LIMITS_FORMATS
from ftforce.planning.path import PathPlan
from ftforce.planning.posture import BestPosture
from ftforce.planning.reach import FailureTolerantWorkspace
from ftforce.report.analysis import analysis_document, analysis_rows
from ftforce.report.capability import capability_document, capability_rows
from ftforce.report.census import census_document, census_rows
from ftforce.report.comparison import comparison_document, comparison_rows
from ftforce.report.fields import document
from ftforce.report.history import history_document, history_rows
from ftforce.report.map import map_document, map_rows
from ftforce.report.parts import SETTING_COLUMNS
from ftforce.report.plan import plan_document, plan_rows
from ftforce.report.posture import posture_document, posture_rows, posture_srdf
from ftforce.report.provenance import ORIGIN, POOLED, ROBOT_SHA256, Provenance, origin_of
from ftforce.report.reach import reach_document, reach_rows
from ftforce.report.robot import (
    replication_document,
    replication_rows,
    robot_document,
    robot_rows,
    robots_rows,
)
from ftforce.report.sweep import sweep_document, sweep_rows
from ftforce.report.timeline import timeline_document, timeline_rows
from ftforce.robot.robot import Robot
from ftforce.trajectory import history_files
from ftforce.trajectory.history import History
from ftforce.trajectory.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Iterator
    from os import PathLike
    from typing import TypeAlias

    from ftforce.report.fields import Document, Row

    Result: TypeAlias = (
        Analysis
        | BestPosture
        | Capability
        | Census
        | Comparison
        | History
        | PathPlan
        | FailureTolerantWorkspace
        | Replication
        | Robot
        | Sweep
        | Timeline
        | WorkspaceMap
    )


@singledispatch
def to_rows(result: object) -> list[Row]:
    """Return a result or a robot as table rows, header first.

    An analysis has one row per quantity and joint or component, a census one per fault set, a robot
    one per joint, a replication one per printed number.

    Parameters
    ----------
    result :
        A result or a robot.

    Raises
    ------
    InputError
        The object is neither a result nor a robot.
    """
    raise InputError(f"only a result or a robot can be written, got {type(result).__name__}")


to_rows.register(Analysis, analysis_rows)
to_rows.register(Census, census_rows)
to_rows.register(Capability, capability_rows)
to_rows.register(History, history_rows)
to_rows.register(Timeline, timeline_rows)
to_rows.register(PathPlan, plan_rows)
to_rows.register(BestPosture, posture_rows)
to_rows.register(FailureTolerantWorkspace, reach_rows)
to_rows.register(Robot, robot_rows)
to_rows.register(Replication, replication_rows)
to_rows.register(Comparison, comparison_rows)
to_rows.register(WorkspaceMap, map_rows)
to_rows.register(Sweep, sweep_rows)


@to_rows.register(list)
def _rows_of_all(robots: list[Any]) -> list[Row]:
    for one in robots:
        if not isinstance(one, Robot):
            raise InputError(f"a list can be written if it is of robots, not {type(one).__name__}")
    return robots_rows(robots)


def to_dict(result: object) -> Document:
    """Return a result or a robot as a dictionary of plain numbers, lists and strings.

    Unknown and undefined numbers are ``None``. docs/reference/json describes every key.

    Parameters
    ----------
    result :
        A result or a robot.

    Raises
    ------
    InputError
        The object is neither a result nor a robot.
    """
    return _document(result) | {"provenance": _origin(result)}


def _origin(result: object) -> Document:
    return document(ORIGIN, Provenance.of(result))


@singledispatch
def _document(result: object) -> Document:
    raise InputError(f"only a result or a robot can be written, got {type(result).__name__}")


_document.register(Analysis, analysis_document)
_document.register(Capability, capability_document)
_document.register(Census, census_document)
_document.register(Robot, robot_document)
_document.register(Replication, replication_document)
_document.register(History, history_document)
_document.register(Comparison, comparison_document)
_document.register(Sweep, sweep_document)
_document.register(WorkspaceMap, map_document)
_document.register(Timeline, timeline_document)
_document.register(PathPlan, plan_document)
_document.register(BestPosture, posture_document)
_document.register(FailureTolerantWorkspace, reach_document)


FORMATS = ("json", "csv", "xlsx", "tex", "md")
_HISTORY_FORMATS = (
    *FORMATS,
    "mcap",
    *(form for form in history_files.FORMATS if form not in FORMATS),
)


def save(result: Result, path: str | PathLike[str]) -> Path:
    """Write a result to a file atomically.

    CSV, NPZ and Parquet files of a history hold every instant and can be read back by
    `ftforce.load_history`; its JSON file is a summary.

    Parameters
    ----------
    result :
        A result or a robot.
    path :
        The file, with extension ``.json``, ``.csv``, ``.xlsx``, ``.tex`` or ``.md``; for a history
        also ``.npz``, ``.parquet`` or ``.mcap``, a trajectory for ROS 2; for a best posture also
        ``.srdf``; for a reach also ``.toml`` or ``.yaml``, its limits.

    Raises
    ------
    InputError
        The file name has another extension.
    OutputError
        The file cannot be written; no partial file remains.
    """
    form = Path(path).suffix.lower().removeprefix(".")
    known = _formats_of(result)
    if form not in known:
        endings = ", ".join(f".{ending}" for ending in known[:-1])
        raise InputError(f"{printable(path)}: the name must end in {endings} or .{known[-1]}")
    return write_whole(path, to_content(result, form))


def to_content(result: object, form: str) -> str | bytes:
    """Return the file content for a result.

    Parameters
    ----------
    result :
        A result or a robot.
    form :
        ``json``, ``csv``, ``xlsx``, ``tex`` or ``md``; for a history also ``npz``, ``parquet`` or
        ``mcap``, a trajectory for ROS 2; for a best posture also ``srdf``; for a reach also
        ``toml`` or ``yaml``, its limits.

    Raises
    ------
    FtforceError
        What writes this format is not installed.
    """
    if isinstance(result, History) and form in history_files.FORMATS:
        return history_files.history_bytes(result, form, _origin(result))
    if isinstance(result, BestPosture) and form == "srdf":
        return posture_srdf(result)
    if isinstance(result, FailureTolerantWorkspace) and form in LIMITS_FORMATS:
        return result.ranges.to_text(form)
    if isinstance(result, (History, PathPlan)) and form == "mcap":
        return _trajectory(result)
    return _workbook(result) if form == "xlsx" else to_text(result, form)


def _formats_of(result: object) -> tuple[str, ...]:
    """Return the endings of the files that hold a result as data."""
    if isinstance(result, History):
        return _HISTORY_FORMATS
    more = {PathPlan: ("mcap",), BestPosture: ("srdf",), FailureTolerantWorkspace: LIMITS_FORMATS}
    return (*FORMATS, *more.get(type(result), ()))


def _trajectory(result: History | PathPlan) -> bytes:
    """Return a motion for a controller: one that was planned, or the answer of a simulation.

    The latter has the torques to command; instants from which the arm cannot be held are left out.
    """
    from ftforce.io.bag import trajectory_bag

    if isinstance(result, PathPlan):
        motion = result.motion()._asdict()
        kinds = ("positions", "velocities", "accelerations")
        return trajectory_bag(
            result.robot.names, result.t, dict(zip(kinds, motion.values(), strict=True))
        )
    history, run = result, result.answer
    until = len(history.t) if run.falls_from is None else run.falls_from
    valid = np.flatnonzero(~np.isnan(run.motor[:until]).any(axis=1))
    points = {"positions": run.q, "velocities": run.v, "accelerations": run.a, "effort": run.motor}
    names = [joint.name for joint in history.setting.joints]
    return trajectory_bag(names, history.t[valid], {k: x[valid] for k, x in points.items()})


def _workbook(result: object) -> bytes:
    from ftforce.report.spreadsheet import workbook

    name = "robots" if isinstance(result, list) else type(result).__name__.lower()
    sheets = [(name, _unsigned(to_rows(result)))]
    if isinstance(result, History):
        sheets.append(("instants", history_files.rows_of(result)))
    about = [("what", "value"), *origin_of(result), *_conventions(result)]
    return workbook([*sheets, ("about", about)])


def _conventions(result: object) -> list[tuple[str, str]]:
    """Return the conventions and units of a result's document as names and texts."""
    if isinstance(result, list):
        return []
    found = _document(result)
    return list(_flat(found.get("conventions", {"units": found.get("units")})))


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield names and texts of what a document holds; what is unknown is left out."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _flat(one, f"{name} {key}".strip().replace("_", " "))
    elif value is not None:
        yield name, ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _without_settings(rows: list[Row]) -> tuple[list[Row], list[tuple[str, str]]]:
    """Return rows without the settings that are the same in all of them, and what these say."""
    if rows and (digest := ROBOT_SHA256.heading) in rows[0]:  # too long for a table
        i = rows[0].index(digest)
        rows = [(*row[:i], *row[i + 1 :]) for row in rows]
    if len(rows) < 2:
        return rows, []
    names = {field.heading for field in SETTING_COLUMNS}
    same = [
        j
        for j, name in enumerate(rows[0])
        if name in names and all(row[j] == rows[1][j] for row in rows[2:])
    ]
    said = [(rows[0][j], str(rows[1][j])) for j in same if rows[1][j] is not None]
    kept = [tuple(x for j, x in enumerate(row) if j not in same) for row in rows]
    return kept, [one for one in said if one[0] != "limits"]  # which the provenance names


def to_text(result: object, form: str) -> str:
    """Return a result as a JSON document, or as a table in CSV, LaTeX or Markdown.

    Parameters
    ----------
    result :
        A result, a robot, or a list of robots.
    form :
        ``json``, ``csv``, ``tex`` or ``md``.
    """
    if form in {"tex", "md"}:
        from ftforce.report.text_tables import to_latex, to_markdown

        write = to_latex if form == "tex" else to_markdown
        rows, settings = _without_settings(_unsigned(to_rows(result)))
        return write(rows, [*origin_of(result), *settings])
    if form == "csv":
        return _csv(result)
    found = [to_dict(one) for one in result] if isinstance(result, list) else to_dict(result)
    content = json.dumps(_unsigned(found), indent=2, ensure_ascii=False, allow_nan=False)
    return "\n".join(map(_escaped, content.split("\n"))) + "\n"


def _csv(result: object) -> str:
    """Return the rows of a result, each followed by the columns by which files can be pooled."""
    header, *rows = _unsigned(to_rows(result)) or [()]
    about = document(POOLED, Provenance.of(result))
    pooled = {name: as_cell(text) for name, text in about.items() if name not in header}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*header, *pooled])
    writer.writerows([*map(as_cell, row), *pooled.values()] for row in rows)
    return text.getvalue()


def as_cell(value: Any) -> Any:
    """Return a value as a cell of a CSV table: a text that no spreadsheet takes for a formula.

    A text that begins like a formula gets an apostrophe in front, by which spreadsheets know texts;
    numbers and directions such as +fx stay. Unprintable characters are escaped.

    Parameters
    ----------
    value :
        A number, a text, or another value of a row.
    """
    if not isinstance(value, str):
        return value
    text = printable(value)
    if value.lstrip()[:1] in _FORMULA and not (_is_number(text) or _DIRECTION.fullmatch(text)):
        return f"'{text}"
    return text


# Also the full-width forms, which some spreadsheets take for the others.
_FORMULA = frozenset("=+-@＝＋－＠")
_DIRECTION = re.compile("[+-][fm][xyz]")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _escaped(line: str) -> str:
    """Return a line of a JSON document with unprintable characters escaped, as JSON has it."""
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line)


def _unsigned(value: Any) -> Any:
    """Return the value with every -0.0 replaced by 0.0."""
    if isinstance(value, float):
        return value + 0.0
    if isinstance(value, dict):
        return {key: _unsigned(one) for key, one in value.items()}
    return [_unsigned(one) for one in value] if isinstance(value, (list, tuple)) else value
