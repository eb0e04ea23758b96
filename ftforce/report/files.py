"""Results as files: JSON that carries its conventions, CSV with units."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ftforce.documents import to_dict
from ftforce.errors import InputError, printable
from ftforce.io.text import write_whole
from ftforce.rows import to_rows
from ftforce.trajectory import history_files
from ftforce.trajectory.history import History

if TYPE_CHECKING:
    from os import PathLike
    from typing import TypeAlias

    from ftforce.analysis.analyze import Analysis
    from ftforce.analysis.capability import Capability
    from ftforce.analysis.census import Census
    from ftforce.analysis.paper import Replication
    from ftforce.batch.comparison import Comparison
    from ftforce.batch.result import Sweep
    from ftforce.batch.workspace_map import WorkspaceMap
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.timeline import Timeline

    Result: TypeAlias = (
        Analysis
        | Capability
        | Census
        | Comparison
        | History
        | Replication
        | Robot
        | Sweep
        | Timeline
        | WorkspaceMap
    )

FORMATS = ("json", "csv")
HISTORY_FORMATS = ("json", *history_files.FORMATS)


def save(result: Result, path: str | PathLike[str]) -> Path:
    """Write a result to a file, whole or not at all.

    The name ends in ``.json`` or ``.csv``, or for a history in ``.npz`` or ``.parquet``. A
    history's CSV, NPZ and Parquet hold every instant, and `ftforce.load_history` reads them back;
    its JSON is a summary.

    Raises
    ------
    InputError
        The file's name ends otherwise.
    OutputError
        The file cannot be written; nothing is left behind.
    """
    form = Path(path).suffix.lower().removeprefix(".")
    known = HISTORY_FORMATS if isinstance(result, History) else FORMATS
    if form not in known:
        endings = ", ".join(f".{ending}" for ending in known[:-1])
        raise InputError(f"{printable(path)}: the name must end in {endings} or .{known[-1]}")
    return write_whole(path, to_content(result, form))


def to_content(result: object, form: str) -> str | bytes:
    """Return a result as the content of a file.

    Parameters
    ----------
    result :
        A result or a robot.
    form :
        ``json`` or ``csv``; for a history also ``npz`` or ``parquet``.
    """
    if isinstance(result, History) and form in history_files.FORMATS:
        return history_files.history_bytes(result, form)
    return to_text(result, form)


def to_text(result: object, form: str) -> str:
    """Return a result as the text of a JSON document or a CSV table.

    Parameters
    ----------
    result :
        A result or a robot, or for JSON a list of them.
    form :
        ``json`` or ``csv``.
    """
    if form == "csv":
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(_unsigned(to_rows(result)))
        return text.getvalue()
    document = [to_dict(one) for one in result] if isinstance(result, list) else to_dict(result)
    return json.dumps(_unsigned(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _unsigned(value: Any) -> Any:
    """Return the same with 0.0 for every -0.0, a sign that means nothing."""
    if isinstance(value, float):
        return value + 0.0
    if isinstance(value, dict):
        return {key: _unsigned(one) for key, one in value.items()}
    return [_unsigned(one) for one in value] if isinstance(value, (list, tuple)) else value
